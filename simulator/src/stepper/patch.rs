//! Where a convex part touches the table, a box of the gripper, or another part: up to four points.
//!
//! A hull touches a plane with all corners near it, four to a contact: corners of several of its faces bear, and one
//! that is not among the points sinks in, is pushed out, and the object trembles.
//!
//! Separating axes, then clipping. A face is the answer if its deepest point lies within the other's face and overlaps
//! little: then no other axis parts the bodies by more than that overlap beyond the face's, and the edges are not
//! asked.

use schema::Vec3;
use wide::f32x4;

use super::shape::{Edge, Hull, Part, along, bits};

/// Points this far apart are contacts already, so that a step cannot carry bodies through each other.
pub(super) const PREDICTION_M: f32 = 0.002;
/// Of the points of a contact, those that are no more than this higher than the deepest touch next.
const TOUCHING_M: f32 = 0.000_2;
/// Edges must part two bodies by this much more than faces do: a face's contact has several points.
const EDGE_PREFERENCE_M: f32 = 0.000_05;
/// A face is as deep as it says if a point is within this of it.
const DEEP_M: f32 = 0.000_01;
/// Sums of a few decimetres are exact to this.
const ROUNDING_M: f32 = 1e-6;
/// What is further than this from a box has no contact with it.
pub(super) const REACH_M: Vec3 = Vec3::splat(PREDICTION_M + ROUNDING_M);
/// Where bodies overlap by more than this, edges are asked even if a face would do.
const OVERLAP_M: f32 = 0.000_15;

/// Contact points of two bodies.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patch {
    /// From the first body to the second.
    pub(super) normal: Vec3,
    pub(super) count: usize,
    /// Halfway between the two surfaces.
    pub(super) points_m: [Vec3; 4],
    /// Distance of the surfaces, negative where they overlap.
    pub(super) gaps_m: [f32; 4],
}

/// A body's frame in the world: a point of the body goes to `origin_m` + its coordinates along `axes`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Frame {
    pub(super) axes: [Vec3; 3],
    pub(super) origin_m: Vec3,
}

/// Room for what a test writes down, so that a step allocates nothing.
#[derive(Default, Clone)]
pub(super) struct Scratch {
    polygon: Vec<Vec3>,
    spare: Vec<Vec3>,
    heights: Vec<f32>,
    near: Vec<(Vec3, f32)>,
    /// A face's normal along each of a box's axes.
    turned: Vec<[f32x4; 3]>,
    /// How far a box's centre is outside of a face.
    outside_m: Vec<f32x4>,
    /// Edges that are to be asked, as bits.
    asked: Vec<u64>,
    seen: Hull,
}

impl Frame {
    pub(super) fn in_world(&self, point_m: Vec3) -> Vec3 {
        self.origin_m + self.turn(point_m)
    }

    pub(super) fn turn(&self, v: Vec3) -> Vec3 {
        self.axes[0] * v.x + self.axes[1] * v.y + self.axes[2] * v.z
    }

    pub(super) fn in_body(&self, point_m: Vec3) -> Vec3 {
        self.turn_back(point_m - self.origin_m)
    }

    pub(super) fn turn_back(&self, v: Vec3) -> Vec3 {
        Vec3::new(self.axes[0].dot(v), self.axes[1].dot(v), self.axes[2].dot(v))
    }

    /// The world's axes in this frame.
    pub(super) fn turned_axes(&self) -> [Vec3; 3] {
        core::array::from_fn(|k| Vec3::new(self.axes[0][k], self.axes[1][k], self.axes[2][k]))
    }

    /// Another frame as it is in this one.
    pub(super) fn sees(&self, other: &Self) -> Self {
        Self { axes: other.axes.map(|axis| self.turn_back(axis)), origin_m: self.in_body(other.origin_m) }
    }

    pub(super) fn world(&self, patch: &Patch) -> Patch {
        let mut points_m = patch.points_m;
        for point in &mut points_m[..patch.count] {
            *point = self.in_world(*point);
        }
        Patch { normal: self.turn(patch.normal), points_m, ..*patch }
    }
}

impl Patch {
    fn flipped(self) -> Self {
        Self { normal: -self.normal, ..self }
    }

    fn is_as_deep_as(&self, gap_m: f32) -> bool {
        self.gaps_m[..self.count].iter().any(|gap| *gap <= gap_m + DEEP_M)
    }
}

/// The contacts of a part with a half-space that ends at `up`·x = `height_m`; the normal is `up`.
pub(super) fn on_plane(
    up: Vec3,
    height_m: f32,
    frame: &Frame,
    part: &Part,
    scratch: &mut Scratch,
    mut found: impl FnMut(&Patch),
) {
    let hull = &part.hull;
    let here_up = frame.turn_back(up);
    let here_m = height_m - up.dot(frame.origin_m);
    if here_up.dot(hull.centre_m) - hull.radius_m - here_m > PREDICTION_M {
        return;
    }
    if part.is_solid {
        if let Some(patch) = face_on_plane(here_up, here_m, part, scratch) {
            found(&frame.world(&patch));
        }
        return;
    }
    let near = &mut scratch.near;
    near.clear();
    near.extend(hull.corners_m.iter().map(|corner| (*corner, here_up.dot(*corner) - here_m)));
    near.retain(|(_, gap_m)| *gap_m < PREDICTION_M);
    while !near.is_empty() {
        let chosen = Chosen::of(near, here_up);
        found(&frame.world(&chosen.patch(near, here_up)));
        let mut place = 0..;
        near.retain(|_| place.next().is_some_and(|place| !chosen.places().contains(&place)));
    }
}

/// The corners of the face that looks down most, or the lowest corner if that face is not as low; in the part's frame.
fn face_on_plane(up: Vec3, height_m: f32, part: &Part, scratch: &mut Scratch) -> Option<Patch> {
    let hull = &part.hull;
    let low_m = hull.span(up)[0] - height_m;
    if low_m > PREDICTION_M {
        return None;
    }
    ring_of(part, hull, hull.face_towards(-up), &mut scratch.polygon);
    let patch = reduce(&scratch.polygon, up, height_m, up, None, &mut scratch.near);
    let corner = || {
        // The lowest corner need not belong to the face that looks down most.
        let height = |corner: &Vec3| up.dot(*corner);
        let lowest = hull.corners_m.iter().copied().min_by(|a, b| height(a).total_cmp(&height(b)));
        lowest.map(|corner| Chosen { places: [0; 4], count: 1 }.patch(&[(corner, low_m)], up))
    };
    patch.filter(|patch| patch.is_as_deep_as(low_m)).or_else(corner)
}

/// Whether a ball comes near a box.
pub(super) fn ball_near_box(centre_m: Vec3, radius_m: f32, box_centre_m: Vec3, half_m: Vec3) -> bool {
    let outside = ((centre_m - box_centre_m).abs() - half_m).max(Vec3::ZERO);
    let reach_m = radius_m + PREDICTION_M;
    outside.length_squared() < reach_m * reach_m
}

/// A part and a box whose axes are the world's; the normal points from the box to the part.
pub(super) fn on_box(
    box_centre_m: Vec3,
    half_m: Vec3,
    frame: &Frame,
    part: &Part,
    scratch: &mut Scratch,
) -> Option<Patch> {
    let hull = &part.hull;
    if !ball_near_box(frame.in_world(hull.centre_m), hull.radius_m, box_centre_m, half_m) {
        return None;
    }
    // Everything in the part's frame, where nothing of it has to be moved.
    let centre_m = frame.in_body(box_centre_m);
    let box_axes = frame.turned_axes();
    let mut best = Best { gap_m: f32::NEG_INFINITY, face: Side::First(0), normal: Vec3::ZERO };
    for (k, axis) in box_axes.iter().enumerate() {
        let ([low, high], middle) = (hull.span(*axis), axis.dot(centre_m));
        for (sign, gap_m) in [(1.0, low - middle - half_m[k]), (-1.0, middle - half_m[k] - high)] {
            if gap_m > best.gap_m {
                best = Best { gap_m, face: Side::First(k), normal: *axis * sign };
            }
        }
    }
    if best.gap_m > PREDICTION_M {
        return None;
    }
    scratch.turned.clear();
    scratch.outside_m.clear();
    let (h0, h1, h2) = (f32x4::splat(half_m.x), f32x4::splat(half_m.y), f32x4::splat(half_m.z));
    for (group, (normals, offsets)) in hull.wide_normals.iter().zip(&hull.wide_offsets).enumerate() {
        let turned = box_axes.map(|axis| along(normals, axis));
        let reach = turned[0].abs() * h0 + turned[1].abs() * h1 + turned[2].abs() * h2;
        let outside_m = along(normals, centre_m) - *offsets;
        let gaps = outside_m - reach;
        scratch.turned.push(turned);
        scratch.outside_m.push(outside_m);
        if !gaps.simd_gt(f32x4::splat(best.gap_m + 1e-6)).any() {
            continue;
        }
        for (lane, gap_m) in gaps.to_array().into_iter().enumerate() {
            // A box's face is preferred.
            if gap_m > best.gap_m + 1e-6 {
                let face = (4 * group + lane).min(hull.normals.len() - 1);
                best = Best { gap_m, face: Side::Second(face), normal: -hull.normals[face] };
            }
        }
    }
    if best.gap_m > PREDICTION_M {
        return None;
    }
    let gripper_box = TurnedBox { centre_m, half_m, axes: box_axes, world_centre_m: box_centre_m };
    let patch = gripper_box.patch(&best, None, frame, part, scratch);
    if best.gap_m > -OVERLAP_M && patch.is_some_and(|patch| patch.is_as_deep_as(best.gap_m)) {
        return patch;
    }
    let least_m = best.gap_m + if patch.is_some() { EDGE_PREFERENCE_M } else { 0.0 };
    let Some((gap_m, out, edge, k)) = gripper_box.apart_by_edges(part, scratch, least_m) else { return patch };
    if gap_m > PREDICTION_M {
        return None;
    }
    let reach = |i: usize| box_axes[i] * half_m[i].copysign(out.dot(box_axes[i]));
    let [from, to] = edge.corners.map(|corner| hull.corners_m[corner]);
    let on_m = nearest_on(from, to - from, centre_m - reach(0) - reach(1) - reach(2), box_axes[k]);
    // The faces that meet at the edges touch beside the crossing, too.
    let aligned = |k: &usize| box_axes[*k].dot(out).abs();
    let facing = [1, 2].into_iter().fold(0, |best, k| if aligned(&k) > aligned(&best) { k } else { best });
    let other = hull.face_towards(out);
    let face = if aligned(&facing) >= hull.normals[other].dot(out) { Side::First(facing) } else { Side::Second(other) };
    gripper_box.patch(&Best { gap_m, face, normal: -out }, Some(on_m), frame, part, scratch)
}

/// A box of the gripper in a part's frame.
struct TurnedBox {
    centre_m: Vec3,
    half_m: Vec3,
    axes: [Vec3; 3],
    world_centre_m: Vec3,
}

impl TurnedBox {
    /// The widest gap, if it is wider than `least_m`, along the common normal of an edge of the part and one of the
    /// box: the gap, the normal out of the part, the part's edge, and the axis of the box's. `seen` has the part's
    /// faces as the box sees them.
    fn apart_by_edges<'a>(
        &self,
        part: &'a Part,
        seen: &mut Scratch,
        mut least_m: f32,
    ) -> Option<(f32, Vec3, &'a Edge, usize)> {
        let (hull, Scratch { turned, outside_m, asked, .. }) = (&part.hull, seen);
        // However a box is turned, it reaches as far as its shortest side does. Seen from an edge, the box's centre is
        // no further along a normal between those of the edge's two faces than `stretch` times what it is along one.
        let far_m = least_m + self.half_m.min_element() - ROUNDING_M;
        let from_m = (far_m / part.stretch).min(far_m);
        part.mark_edges(outside_m, from_m, asked);
        let mut found = None;
        for edge in bits(asked).map(|number| &part.edges[number]) {
            let [a, b]: [[f32; 3]; 2] =
                edge.faces.map(|face| core::array::from_fn(|k| turned[face / 4][k].as_array()[face % 4]));
            for k in 0..3 {
                // The normals between the two faces' hold one that is square to the box's axis.
                if a[k] * b[k] < -1e-6 {
                    let [first, second] = edge.faces.map(|face| hull.normals[face]);
                    let across = first * b[k].abs() + second * a[k].abs();
                    let length = across.length();
                    let corner_m = hull.corners_m[edge.corners[0]];
                    let reach = (0..3).map(|i| across.dot(self.axes[i]).abs() * self.half_m[i]).sum::<f32>();
                    let gap = across.dot(self.centre_m - corner_m) - reach;
                    if gap > least_m * length {
                        least_m = gap / length;
                        found = Some((least_m, across / length, edge, k));
                    }
                }
            }
        }
        found
    }

    /// The points of a part's contact with the box along an axis. `crossing` is a point of the part's edge that crosses
    /// one of the box's.
    fn patch(
        &self,
        best: &Best,
        crossing: Option<Vec3>,
        frame: &Frame,
        part: &Part,
        scratch: &mut Scratch,
    ) -> Option<Patch> {
        let hull = &part.hull;
        match best.face {
            Side::First(k) => {
                // In the box's frame, the part's face is clipped by coordinates.
                ring_of(part, hull, hull.face_towards(-best.normal), &mut scratch.polygon);
                for corner in &mut scratch.polygon {
                    *corner = frame.in_world(*corner) - self.world_centre_m;
                }
                for other in [(k + 1) % 3, (k + 2) % 3] {
                    let mut axis = Vec3::ZERO;
                    axis[other] = 1.0;
                    clip(scratch, axis, self.half_m[other]);
                    clip(scratch, -axis, self.half_m[other]);
                }
                let normal = frame.turn(best.normal);
                let mut out = Vec3::ZERO;
                out[k] = 1.0_f32.copysign(normal[k]);
                let crossing = crossing.map(|point| (frame.in_world(point) - self.world_centre_m, best.gap_m));
                let patch = reduce(&scratch.polygon, out, self.half_m[k], normal, crossing, &mut scratch.near)?;
                Some(Patch { points_m: patch.points_m.map(|p| p + self.world_centre_m), ..patch })
            }
            Side::Second(face) => {
                let out = hull.normals[face];
                // The box's face that looks at it most.
                let facing = frame.turn(out);
                let size = facing.abs();
                let k = if size.x >= size.y && size.x >= size.z { 0 } else { 1 + usize::from(size.z > size.y) };
                let (k1, k2) = ((k + 1) % 3, (k + 2) % 3);
                let middle = self.centre_m - self.axes[k] * self.half_m[k].copysign(facing[k]);
                let (along_1, along_2) = (self.axes[k1] * self.half_m[k1], self.axes[k2] * self.half_m[k2]);
                scratch.polygon.clear();
                scratch.polygon.extend([
                    middle - along_1 - along_2,
                    middle + along_1 - along_2,
                    middle + along_1 + along_2,
                    middle - along_1 + along_2,
                ]);
                for (side, offset_m) in &part.faces[face].sides {
                    clip(scratch, *side, *offset_m);
                }
                // Seen from the part, the other body is the box.
                let crossing = crossing.map(|point| (point - best.normal * best.gap_m, best.gap_m));
                let offset_m = hull.offsets_m[face];
                let patch = reduce(&scratch.polygon, out, offset_m, -best.normal, crossing, &mut scratch.near)?;
                Some(frame.world(&patch.flipped()))
            }
        }
    }
}

/// Two parts of two bodies; the normal points from the first to the second. Also an axis along which they are apart by
/// more than contacts reach, if there is one, in the world.
pub(super) fn between(
    [first, second]: [&Part; 2],
    [first_frame, second_frame]: [&Frame; 2],
    scratch: &mut Scratch,
) -> Result<Patch, Option<Vec3>> {
    // In the second's frame.
    let axes = first_frame.axes.map(|axis| second_frame.turn_back(axis));
    let at_m = second_frame.in_body(first_frame.origin_m);
    let mut seen = core::mem::take(&mut scratch.seen);
    seen.see(&first.hull, &axes, at_m);
    let found = between_hulls(first, &seen, second, scratch);
    scratch.seen = seen;
    match found {
        Ok(patch) => Ok(second_frame.world(&patch)),
        Err(axis) => Err(axis.map(|axis| second_frame.turn(axis))),
    }
}

fn between_hulls(first: &Part, a: &Hull, second: &Part, scratch: &mut Scratch) -> Result<Patch, Option<Vec3>> {
    let b = &second.hull;
    let apart = b.centre_m - a.centre_m;
    let mut best = Best { gap_m: f32::NEG_INFINITY, face: Side::First(0), normal: Vec3::Z };
    for (face, (normal, offset_m)) in a.normals.iter().zip(&a.offsets_m).enumerate() {
        // Bodies that hardly overlap are not parted by a face that looks away.
        if normal.dot(apart) > 0.0 {
            let gap_m = b.span(*normal)[0] - offset_m;
            if gap_m > PREDICTION_M {
                return Err(Some(*normal));
            }
            if gap_m > best.gap_m {
                best = Best { gap_m, face: Side::First(face), normal: *normal };
            }
        }
    }
    for (face, (normal, offset_m)) in b.normals.iter().zip(&b.offsets_m).enumerate() {
        if normal.dot(apart) < 0.0 {
            let gap_m = a.span(*normal)[0] - offset_m;
            if gap_m > PREDICTION_M {
                return Err(Some(-*normal));
            }
            if gap_m > best.gap_m + 1e-6 {
                best = Best { gap_m, face: Side::Second(face), normal: -*normal };
            }
        }
    }
    let patch = patch_of_hulls(first, a, second, &best, None, scratch);
    if let Some(patch) = patch.filter(|patch| best.gap_m > -OVERLAP_M && patch.is_as_deep_as(best.gap_m)) {
        return Ok(patch);
    }
    let mut least_m = best.gap_m + if patch.is_some() { EDGE_PREFERENCE_M } else { 0.0 };
    let mut found = None;
    for edge in &first.edges {
        let [a1, a2] = edge.faces.map(|face| a.normals[face]);
        // Those on the far side; a narrower cone leaves out edges that do part the bodies.
        if (a1 + a2).dot(best.normal) < -0.5 {
            continue;
        }
        let [from, to] = edge.corners.map(|corner| a.corners_m[corner]);
        let along_a = to - from;
        for other in &second.edges {
            let [b1, b2] = other.faces.map(|face| -b.normals[face]);
            // Edges are the nearest features only if their arcs on the sphere of normals cross.
            if b1.dot(along_a) * b2.dot(along_a) >= 0.0 {
                continue;
            }
            let [b_from, b_to] = other.corners.map(|corner| b.corners_m[corner]);
            let along_b = b_to - b_from;
            if a1.dot(along_b) * a2.dot(along_b) >= 0.0 {
                continue;
            }
            let Some(mut normal) = along_a.cross(along_b).try_normalize() else { continue };
            if normal.dot(a1 + a2) < 0.0 {
                normal = -normal;
            }
            let gap_m = normal.dot(b_from - from);
            if normal.dot(b1 + b2) > 0.0 && gap_m > least_m {
                least_m = gap_m;
                found = Some((normal, b_from, along_b, from, along_a));
            }
        }
    }
    let Some((normal, b_from, along_b, from, along_a)) = found else { return patch.ok_or(None) };
    if least_m > PREDICTION_M {
        return Err(Some(normal));
    }
    let on_m = nearest_on(b_from, along_b, from, along_a);
    let (a_face, b_face) = (a.face_towards(normal), b.face_towards(-normal));
    let is_first = a.normals[a_face].dot(normal) >= -b.normals[b_face].dot(normal);
    let face = if is_first { Side::First(a_face) } else { Side::Second(b_face) };
    let best = Best { gap_m: least_m, face, normal };
    patch_of_hulls(first, a, second, &best, Some(on_m), scratch).ok_or(None)
}

/// The points of two hulls' contact along an axis. `crossing` is a point of the second's edge that crosses one of the
/// first's.
fn patch_of_hulls(
    first: &Part,
    a: &Hull,
    second: &Part,
    best: &Best,
    crossing: Option<Vec3>,
    scratch: &mut Scratch,
) -> Option<Patch> {
    let b = &second.hull;
    match best.face {
        Side::First(face) => {
            ring_of(second, b, b.face_towards(-best.normal), &mut scratch.polygon);
            let ring = &first.faces[face].ring;
            let out = a.normals[face];
            for (i, from) in ring.iter().enumerate() {
                let (from, to) = (a.corners_m[*from], a.corners_m[ring[(i + 1) % ring.len()]]);
                let side = (to - from).cross(out).normalize();
                clip(scratch, side, side.dot(from));
            }
            let crossing = crossing.map(|point| (point, best.gap_m));
            reduce(&scratch.polygon, out, a.offsets_m[face], best.normal, crossing, &mut scratch.near)
        }
        Side::Second(face) => {
            ring_of(first, a, a.face_towards(best.normal), &mut scratch.polygon);
            for (side, offset_m) in &second.faces[face].sides {
                clip(scratch, *side, *offset_m);
            }
            let crossing = crossing.map(|point| (point - best.normal * best.gap_m, best.gap_m));
            let (out, offset_m) = (b.normals[face], b.offsets_m[face]);
            reduce(&scratch.polygon, out, offset_m, -best.normal, crossing, &mut scratch.near).map(Patch::flipped)
        }
    }
}

/// The axis along which two bodies are farthest apart.
struct Best {
    gap_m: f32,
    face: Side,
    /// From the first to the second.
    normal: Vec3,
}

/// Whose face it is.
enum Side {
    First(usize),
    Second(usize),
}

/// The point of the edge `from` + t `along`, t in 0..=1, that is nearest to a line.
fn nearest_on(from: Vec3, along: Vec3, line_m: Vec3, line: Vec3) -> Vec3 {
    let to_line = line_m - from;
    let (a, b, c) = (along.length_squared(), along.dot(line), line.length_squared());
    let determinant = a * c - b * b;
    let parallel = determinant <= 1e-9 * a * c;
    let t = if parallel { 0.5 } else { (c * along.dot(to_line) - b * line.dot(to_line)) / determinant };
    from + along * t.clamp(0.0, 1.0)
}

fn ring_of(part: &Part, hull: &Hull, face: usize, polygon: &mut Vec<Vec3>) {
    polygon.clear();
    polygon.extend(part.faces[face].ring.iter().map(|corner| hull.corners_m[*corner]));
}

/// Keeps what lies on the inner side: normal·x ≤ offset.
fn clip(scratch: &mut Scratch, normal: Vec3, offset_m: f32) {
    let Scratch { polygon, spare, heights, .. } = scratch;
    heights.clear();
    heights.extend(polygon.iter().map(|corner| normal.dot(*corner) - offset_m));
    if heights.iter().all(|height| *height <= 0.0) {
        return;
    }
    spare.clear();
    for (i, corner) in polygon.iter().enumerate() {
        let next = if i + 1 == polygon.len() { 0 } else { i + 1 };
        let (here, there) = (heights[i], heights[next]);
        if here <= 0.0 {
            spare.push(*corner);
        }
        if (here <= 0.0) != (there <= 0.0) {
            spare.push(*corner + (polygon[next] - *corner) * (here / (here - there)));
        }
    }
    core::mem::swap(polygon, spare);
}

/// Up to four points of a polygon near the plane `out`·x = `offset_m`, from which gaps are measured along `axis`. The
/// normal is the axis. Where edges cross, none is deeper than the crossing.
fn reduce(
    polygon: &[Vec3],
    out: Vec3,
    offset_m: f32,
    axis: Vec3,
    crossing: Option<(Vec3, f32)>,
    near: &mut Vec<(Vec3, f32)>,
) -> Option<Patch> {
    near.clear();
    let slant = 1.0 / out.dot(axis);
    near.extend(crossing);
    let least_m = crossing.map_or(f32::NEG_INFINITY, |(_, gap_m)| gap_m);
    let gaps = polygon.iter().map(|p| (*p, ((out.dot(*p) - offset_m) * slant).max(least_m)));
    near.extend(gaps.filter(|(_, gap_m)| *gap_m < PREDICTION_M));
    (!near.is_empty()).then(|| Chosen::of(near, axis).patch(near, axis))
}

/// Up to four of some points with their gaps along an axis, by their places.
struct Chosen {
    places: [usize; 4],
    count: usize,
}

impl Chosen {
    /// The deepest, the farthest from it, and the farthest to either side of these two.
    fn of(near: &[(Vec3, f32)], axis: Vec3) -> Self {
        if near.len() <= 4 {
            return Self { places: [0, 1, 2, 3], count: near.len() };
        }
        let most = |value: &dyn Fn(&(Vec3, f32)) -> f32| {
            let better = |best: (usize, f32), (i, x): (usize, f32)| if x > best.1 { (i, x) } else { best };
            near.iter().map(value).enumerate().fold((0, f32::NEG_INFINITY), better)
        };
        let (a, negative_gap_m) = most(&|(_, gap_m)| -gap_m);
        let from = near[a].0;
        let (b, _) = most(&|(p, _)| (*p - from).length_squared());
        let aside = axis.cross(near[b].0 - from);
        let mut chosen = Self { places: [a, b, 0, 0], count: 2 };
        for side in [aside, -aside] {
            let beyond = |p: &Vec3| side.dot(*p - from);
            // Those that touch next come first: on a rim that rolls they are the neighbours, which would sink in
            // unseen.
            let touches = |gap_m: f32| gap_m + negative_gap_m < TOUCHING_M;
            let (mut c, mut way) = most(&|(p, gap_m)| if touches(*gap_m) { beyond(p) } else { 0.0 });
            if way <= 1e-9 {
                (c, way) = most(&|(p, _)| beyond(p));
            }
            if way > 1e-9 && c != a && c != b {
                chosen.places[chosen.count] = c;
                chosen.count += 1;
            }
        }
        chosen
    }

    fn places(&self) -> &[usize] {
        &self.places[..self.count]
    }

    fn patch(&self, near: &[(Vec3, f32)], axis: Vec3) -> Patch {
        let mut patch = Patch { normal: axis, count: self.count, points_m: [Vec3::ZERO; 4], gaps_m: [0.0; 4] };
        for (i, (point_m, gap_m)) in self.places().iter().map(|place| near[*place]).enumerate() {
            (patch.points_m[i], patch.gaps_m[i]) = (point_m - axis * (0.5 * gap_m), gap_m);
        }
        patch
    }
}
