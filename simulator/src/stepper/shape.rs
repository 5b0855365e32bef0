//! What a step asks of an object: its convex parts laid out for contacts, and its mass.

use schema::{Polyhedron, Pose, Quat, Vec3, bounds_m};
use wide::f32x4;

use crate::engine::{EngineBody, UNITS_PER_M};
use crate::mass_scaling::LeastInertia;
use crate::{PartShape, SceneObject};

/// What a stepper moves, and what stands in its way beside the table.
pub(crate) struct Things {
    pub(crate) moving: Vec<Thing>,
    /// In the workspace.
    pub(super) fixtures: Vec<Part>,
}

impl Things {
    /// Objects and fixtures of a scene; no object is less sluggish than `least`.
    pub(crate) fn of(objects: &[SceneObject], fixtures: &[Polyhedron], least: LeastInertia) -> Self {
        Self {
            moving: objects.iter().map(|object| Thing::of(object, least)).collect(),
            fixtures: fixtures.iter().map(|fixture| Part::new(fixture, false)).collect(),
        }
    }
}

/// One coordinate each of four points or normals.
pub(crate) type Wide3 = [f32x4; 3];

/// Four points or normals; the last of fewer is repeated to fill up.
pub(crate) fn wide(points: &[Vec3]) -> Wide3 {
    let at = |lane: usize| points[lane.min(points.len() - 1)];
    core::array::from_fn(|axis| f32x4::from(core::array::from_fn(|lane| at(lane)[axis])))
}

/// The interval that points cover along an axis.
pub(crate) fn span(points: &[Wide3], axis: Vec3) -> [f32; 2] {
    let first = points.first().map_or(f32x4::ZERO, |c| along(c, axis));
    let (mut low, mut high) = (first, first);
    for points in &points[1..] {
        let x = along(points, axis);
        low = low.fast_min(x);
        high = high.fast_max(x);
    }
    let (low, high) = (low.to_array(), high.to_array());
    [low[0].min(low[1]).min(low[2].min(low[3])), high[0].max(high[1]).max(high[2].max(high[3]))]
}

/// An object, in its own frame.
pub(crate) struct Thing {
    pub(super) parts: Vec<Part>,
    /// The middles and half lengths of the parts' bounding boxes, four at a time.
    pub(super) boxes_m: Vec<[Wide3; 2]>,
    /// Its inertia.
    pub(super) mass_kg: f32,
    /// Share of that which has weight.
    pub(super) weight_share: f32,
    pub(super) friction: f32,
    /// Centre of mass.
    pub(crate) centre_m: Vec3,
    /// Every corner is within this of the centre of mass.
    pub(super) radius_m: f32,
    /// Square roots of the inverse principal moments, in 1/√(kg m²).
    pub(super) root_inverse_inertia: Vec3,
    /// From the principal axes to the object's.
    pub(super) principal: Quat,
    pub(super) workspace_from_object: Pose,
}

/// A convex part.
pub(super) struct Part {
    pub(super) hull: Hull,
    pub(super) edges: Vec<Edge>,
    pub(super) faces: Vec<FaceOf>,
    /// Of each face, the edges about it: a bit for every edge, in words of 64.
    pub(super) edges_of: Vec<Vec<u64>>,
    /// The largest of the edges' [`Edge::stretch`].
    pub(super) stretch: f32,
    /// Whether it is one of the four solids. Such a one touches a plane with one face, so that datasets of primitives
    /// keep their bytes.
    pub(super) is_solid: bool,
}

/// Corners and faces of a part, in some frame.
#[derive(Default, Clone)]
pub(super) struct Hull {
    pub(super) centre_m: Vec3,
    pub(super) radius_m: f32,
    /// Middle and half lengths of its bounding box; of a hull that is seen from another frame those of its own.
    pub(super) box_m: [Vec3; 2],
    pub(super) corners_m: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) offsets_m: Vec<f32>,
    /// Corners, then normals and offsets, four at a time; the last is repeated to fill up.
    pub(super) wide_corners: Vec<Wide3>,
    pub(super) wide_normals: Vec<Wide3>,
    pub(super) wide_offsets: Vec<f32x4>,
}

/// Where two faces meet.
pub(super) struct Edge {
    pub(super) corners: [usize; 2],
    pub(super) faces: [usize; 2],
    /// A mean of the normals of the two faces, however weighted, is no shorter than the inverse of this.
    pub(super) stretch: f32,
}

/// A face's corners in order, and for each side the half-space on its inner side (outward normal in the face's plane,
/// and offset).
pub(super) struct FaceOf {
    pub(super) ring: Vec<usize>,
    pub(super) sides: Vec<(Vec3, f32)>,
}

impl Thing {
    /// An object; its mass properties are rapier's.
    pub(super) fn of(object: &SceneObject, least: LeastInertia) -> Self {
        let EngineBody { mass_properties: mass, weight_share, .. } = EngineBody::of(object, least);
        let units = UNITS_PER_M;
        let is_solid = object.body.parts().iter().map(|part| matches!(part.shape, PartShape::Solid(_)));
        let parts: Vec<Part> =
            object.body.polyhedra().iter().zip(is_solid).map(|(part, is_solid)| Part::new(part, is_solid)).collect();
        let centre_m = mass.local_com / units;
        let moments = mass.principal_inertia() / (units * units);
        let corners_m = parts.iter().flat_map(|part| &part.hull.corners_m);
        let boxes_of =
            |parts: &[Part]| [0, 1].map(|i| wide(&parts.iter().map(|p| p.hull.box_m[i]).collect::<Vec<_>>()));
        Self {
            boxes_m: parts.chunks(4).map(boxes_of).collect(),
            radius_m: corners_m.map(|c| (*c - centre_m).length()).fold(0.0, f32::max),
            parts,
            mass_kg: mass.mass(),
            weight_share,
            friction: object.friction,
            centre_m,
            root_inverse_inertia: Vec3::new(1.0 / moments.x.sqrt(), 1.0 / moments.y.sqrt(), 1.0 / moments.z.sqrt()),
            principal: mass.principal_inertia_local_frame,
            workspace_from_object: object.workspace_from_object,
        }
    }

    /// The parts, with their numbers, whose bounding boxes meet a box at a place in this thing's frame, with such axes.
    pub(super) fn near_box(&self, at_m: Vec3, half_m: Vec3, axes: [Vec3; 3]) -> impl Iterator<Item = (usize, &Part)> {
        self.boxes_m.iter().enumerate().flat_map(move |(group, [middles_m, reaches_m])| {
            let apart = |k: usize| {
                let reach_m = along(reaches_m, axes[k].abs()) + f32x4::splat(half_m[k]);
                (along(middles_m, axes[k]) - f32x4::splat(axes[k].dot(at_m))).abs().simd_gt(reach_m)
            };
            let apart = (apart(0) | apart(1) | apart(2)).to_bitmask();
            let numbers = (0..4).filter(move |lane| apart >> lane & 1 == 0).map(move |lane| 4 * group + lane);
            numbers.filter_map(|number| Some((number, self.parts.get(number)?)))
        })
    }
}

impl Part {
    pub(super) fn new(polyhedron: &Polyhedron, is_solid: bool) -> Self {
        let corners_m = polyhedron.corners_m().to_vec();
        let faces: Vec<FaceOf> = polyhedron
            .faces()
            .iter()
            .map(|face| {
                let side = |(a, b): (usize, usize)| {
                    let out = (corners_m[b] - corners_m[a]).cross(face.plane.normal).normalize();
                    (out, out.dot(corners_m[a]))
                };
                FaceOf { ring: face.ring.clone(), sides: pairs(&face.ring).map(side).collect() }
            })
            .collect();
        let mut edges = Vec::new();
        for (first, face) in faces.iter().enumerate() {
            for (a, b) in pairs(&face.ring) {
                let across = |other: &FaceOf| pairs(&other.ring).any(|side| side == (b, a));
                if let Some(second) = faces[first + 1..].iter().position(across) {
                    let faces = [first, first + 1 + second];
                    let [one, other] = faces.map(|face| polyhedron.faces()[face].plane.normal);
                    edges.push(Edge { corners: [a, b], faces, stretch: 2.0 / (one + other).length() });
                }
            }
        }
        let [low_m, high_m] = bounds_m(&corners_m);
        let mut hull = Hull {
            box_m: [0.5 * (low_m + high_m), 0.5 * (high_m - low_m)],
            centre_m: polyhedron.centre_m(),
            radius_m: polyhedron.radius_m(),
            corners_m,
            normals: polyhedron.planes().map(|plane| plane.normal).collect(),
            offsets_m: polyhedron.planes().map(|plane| plane.offset_m).collect(),
            ..Hull::default()
        };
        hull.widen();
        let mut edges_of = vec![vec![0; edges.len().div_ceil(64)]; faces.len()];
        for (number, edge) in edges.iter().enumerate() {
            edge.faces.iter().for_each(|face| edges_of[*face][number / 64] |= 1 << (number % 64));
        }
        let stretch = edges.iter().map(|edge| edge.stretch).fold(1.0, f32::max);
        Self { hull, edges, faces, edges_of, stretch, is_solid }
    }
}

impl Part {
    /// Sets the bits of the edges about the faces of which something is outside by `from_m` or more; `outside_m` has
    /// four faces at a time.
    pub(super) fn mark_edges(&self, outside_m: &[f32x4], from_m: f32, marked: &mut Vec<u64>) {
        marked.clear();
        marked.resize(self.edges.len().div_ceil(64), 0);
        for (group, outside_m) in outside_m.iter().enumerate() {
            let lanes = outside_m.simd_ge(f32x4::splat(from_m)).to_bitmask();
            for face in (0..4).filter(|lane| lanes >> lane & 1 == 1).map(|lane| 4 * group + lane) {
                let Some(edges) = self.edges_of.get(face) else { break };
                marked.iter_mut().zip(edges).for_each(|(marked, edges)| *marked |= edges);
            }
        }
    }
}

/// The places of the bits that are set, in order.
pub(super) fn bits(words: &[u64]) -> impl Iterator<Item = usize> {
    words.iter().enumerate().flat_map(|(place, word)| {
        let next = |word: &u64| Some(word & (word - 1)).filter(|word| *word != 0);
        core::iter::successors(Some(*word).filter(|word| *word != 0), next)
            .map(move |word| 64 * place + word.trailing_zeros() as usize)
    })
}

impl Hull {
    fn widen(&mut self) {
        self.wide_corners.clear();
        self.wide_corners.extend(self.corners_m.chunks(4).map(wide));
        self.wide_normals.clear();
        self.wide_normals.extend(self.normals.chunks(4).map(wide));
        self.wide_offsets.clear();
        self.wide_offsets.extend(
            self.offsets_m.chunks(4).map(|o| f32x4::from(core::array::from_fn(|lane| o[lane.min(o.len() - 1)]))),
        );
    }

    /// Makes this the hull `of`, seen from another frame: a point goes to `at_m` + its coordinates along `axes`.
    pub(super) fn see(&mut self, of: &Self, axes: &[Vec3; 3], at_m: Vec3) {
        let turned = |v: Vec3| axes[0] * v.x + axes[1] * v.y + axes[2] * v.z;
        self.centre_m = at_m + turned(of.centre_m);
        self.radius_m = of.radius_m;
        self.corners_m.clear();
        self.corners_m.extend(of.corners_m.iter().map(|c| at_m + turned(*c)));
        self.normals.clear();
        self.normals.extend(of.normals.iter().map(|n| turned(*n)));
        self.offsets_m.clear();
        self.offsets_m.extend(self.normals.iter().zip(&of.offsets_m).map(|(n, offset_m)| offset_m + n.dot(at_m)));
        self.widen();
    }

    /// The interval that the hull covers along an axis.
    pub(super) fn span(&self, axis: Vec3) -> [f32; 2] {
        span(&self.wide_corners, axis)
    }

    /// The face whose normal points most along `axis`.
    pub(super) fn face_towards(&self, axis: Vec3) -> usize {
        let mut best = (0, f32::NEG_INFINITY);
        for (group, normals) in self.wide_normals.iter().enumerate() {
            let along = along(normals, axis);
            if !along.simd_gt(f32x4::splat(best.1)).any() {
                continue;
            }
            for (lane, x) in along.to_array().into_iter().enumerate() {
                if x > best.1 {
                    best = (4 * group + lane, x);
                }
            }
        }
        // The last may be repeated.
        best.0.min(self.normals.len() - 1)
    }
}

/// The coordinate of four points along an axis.
#[inline(always)]
pub(crate) fn along(points: &Wide3, axis: Vec3) -> f32x4 {
    points[0] * f32x4::splat(axis.x) + points[1] * f32x4::splat(axis.y) + points[2] * f32x4::splat(axis.z)
}

/// Consecutive pairs of a ring.
fn pairs(ring: &[usize]) -> impl Iterator<Item = (usize, usize)> {
    ring.iter().copied().zip(ring.iter().copied().cycle().skip(1))
}
