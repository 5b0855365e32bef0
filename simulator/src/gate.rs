//! The geometric gate: does the open gripper reach the grasp without touching anything?
//!
//! The approach is a straight line along the grasp's z axis, and the gripper is made of boxes along the grasp's axes;
//! so what a box sweeps is a longer box, and the test is exact, without time steps. The boxes are first grown by the
//! gripper's clearance: whatever comes nearer than that counts as touched, in every engine that repeats an attempt.

use schema::{Gripper, GripperBox, HitKind, Outcome, Pose, Procedure, Vec3};

use crate::tested_part::{PlacedPart, TestedPart};
use crate::{Scene, SceneObject};

/// What was hit first: the target, then another object, then the container, then the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Hit {
    /// What it was.
    pub kind: HitKind,
    /// Which object.
    pub object_id: Option<usize>,
}

impl Hit {
    /// The table.
    pub(crate) const TABLE: Self = Self { kind: HitKind::Table, object_id: None };

    /// A fixture of the scene.
    pub(crate) const CONTAINER: Self = Self { kind: HitKind::Container, object_id: None };

    /// An object, the target or another.
    pub(crate) fn object(object_id: usize, target: usize) -> Self {
        let kind = if object_id == target { HitKind::Target } else { HitKind::Other };
        Self { kind, object_id: Some(object_id) }
    }
}

/// A fixture is looked for this far above a grasp.
const COVER_M: f32 = 0.5;
/// So many halvings of a way give a thousandth of it.
const FINE: usize = 10;
/// Whereto a gripper may give way to an object, in the frame of the grasp: to the sides, or back; and steps a metre.
const ASIDE: [Vec3; 5] = [Vec3::Y, Vec3::NEG_Y, Vec3::X, Vec3::NEG_X, Vec3::NEG_Z];
const ASIDE_STEPS: f32 = 2_000.0;

/// Parts in their frame, and where that is in the workspace.
type Obstacle = (Vec<TestedPart>, Pose);

/// A scene and a gripper, made ready for the test.
#[derive(Clone)]
pub struct Gate {
    table_z_m: f32,
    /// Of each object.
    obstacles: Vec<Obstacle>,
    fixtures: Obstacle,
    pregrasp: Vec<GripperBox>,
    approach: Vec<GripperBox>,
}

impl Gate {
    /// Makes scene and gripper ready.
    #[must_use]
    pub fn new(scene: &Scene, gripper: &Gripper, procedure: &Procedure) -> Self {
        let hulls = |o: &SceneObject| o.body.polyhedra().iter().map(TestedPart::new).collect();
        let obstacles = scene.objects.iter().map(|o| (hulls(o), o.workspace_from_object)).collect();
        let fixtures = (scene.fixtures.iter().map(TestedPart::new).collect(), Pose::IDENTITY);
        let back = Vec3::new(0.0, 0.0, procedure.pregrasp_distance_m);
        let open = gripper.open_gripper();
        let pregrasp = open.iter().map(|b| b.moved(-back).grown(gripper.clearance_m)).collect();
        let swept = |b: &GripperBox| b.swept_back(procedure.pregrasp_distance_m).grown(gripper.clearance_m);
        let approach = open.iter().map(swept).collect();
        Self { table_z_m: scene.table_z_m, obstacles, fixtures, pregrasp, approach }
    }

    /// The collision that keeps the gripper from the grasp, if there is one.
    #[must_use]
    pub fn blocked(&self, workspace_from_grasp: &Pose, target: usize) -> Option<(Outcome, Hit)> {
        let hit = |boxes: &[GripperBox]| self.first_hit(boxes, workspace_from_grasp, target);
        let approach = hit(&self.approach)?;
        // The sweep holds the pre-grasp gripper, so only a blocked sweep needs the second look.
        Some(match hit(&self.pregrasp) {
            Some(pregrasp) => (Outcome::PregraspCollision, pregrasp),
            None => (Outcome::ApproachCollision, approach),
        })
    }

    /// How far the open gripper comes on its way from the pre-grasp before it touches anything, at most to the grasp,
    /// in metres, to a thousandth of the way; `None` if it touches something at the pre-grasp.
    #[must_use]
    pub fn free_way_m(&self, workspace_from_grasp: &Pose) -> Option<f32> {
        let way_m = self.approach[0].half_m.z - self.pregrasp[0].half_m.z;
        // What a box does not touch on the whole way, it touches on no part of it.
        let touched = self.touched(&self.swept(way_m), workspace_from_grasp);
        let free = |share: f32| {
            let boxes = self.swept(share * way_m);
            touched.iter().all(|(which, part)| !part.overlaps(&boxes[*which]))
                && !self.is_in_table(&boxes, workspace_from_grasp)
        };
        if touched.is_empty() && free(1.0) {
            return Some(2.0 * way_m);
        }
        free(0.0).then(|| halved(1.0, FINE, free)[0] * 2.0 * way_m)
    }

    /// By how much the boxes of the whole way can grow before they touch an object, in metres, between two ends, to a
    /// thousandth of what lies between them. Below 0 it is how far they overlap along the axis that parts them first:
    /// there, a box may shrink beyond its middle.
    pub(crate) fn room_m(&self, workspace_from_grasp: &Pose, object_id: usize, [least_m, most_m]: [f32; 2]) -> f32 {
        let near = self.near(workspace_from_grasp, object_id, most_m);
        let is_free = |more_m: f32| !overlap(&near, &self.grown(least_m + more_m));
        if near.is_empty() { most_m } else { least_m + halved(most_m - least_m, FINE, is_free)[0] }
    }

    /// The shortest way to the side or back, in the frame of the grasp, that frees a gripper from an object that it
    /// touches, in steps of half a millimetre; `None` if `most_m` is not enough.
    pub(crate) fn way_aside_m(&self, workspace_from_grasp: &Pose, object_id: usize, most_m: f32) -> Option<Vec3> {
        let near = self.near(workspace_from_grasp, object_id, most_m);
        let is_free = |way_m: &Vec3| {
            let moved: Vec<GripperBox> = self.approach.iter().map(|b| b.moved(*way_m)).collect();
            !overlap(&near, &moved)
        };
        // 0.003 times 2,000 may be a little less than 6.
        let steps = (most_m * ASIDE_STEPS + 0.01) as u16;
        (1..=steps).flat_map(|step| ASIDE.map(|along| along * (f32::from(step) / ASIDE_STEPS))).find(is_free)
    }

    /// The parts of an object, in the frame of a grasp, that the boxes of the whole way overlap when they have grown.
    fn near(&self, workspace_from_grasp: &Pose, object_id: usize, margin_m: f32) -> Vec<PlacedPart> {
        self.overlapped(Some(object_id), workspace_from_grasp, &self.grown(margin_m)).collect()
    }

    fn grown(&self, margin_m: f32) -> Vec<GripperBox> {
        self.approach.iter().map(|b| b.grown(margin_m)).collect()
    }

    /// The boxes, grown, and swept from the pre-grasp over twice `half_way_m`.
    pub(crate) fn swept(&self, half_way_m: f32) -> Vec<GripperBox> {
        let along = Vec3::Z * half_way_m;
        let swept = |b: &GripperBox| GripperBox { centre_m: b.centre_m + along, half_m: b.half_m + along };
        self.pregrasp.iter().map(swept).collect()
    }

    /// Each box with each part of objects and fixtures that it overlaps, in the frame of a grasp.
    fn touched(&self, boxes: &[GripperBox], workspace_from_grasp: &Pose) -> Vec<(usize, PlacedPart)> {
        let all = (0..self.obstacles.len()).map(Some).chain([None]);
        let parts = all.flat_map(|object_id| self.overlapped(object_id, workspace_from_grasp, boxes));
        let mut touched = Vec::new();
        for part in parts {
            let on = (0..boxes.len()).filter(|which| part.overlaps(&boxes[*which]));
            touched.extend(on.map(|which| (which, part.clone())));
        }
        touched
    }

    fn is_in_table(&self, boxes: &[GripperBox], workspace_from_grasp: &Pose) -> bool {
        let low = boxes.iter().map(|b| b.lowest_z_m(workspace_from_grasp)).fold(f32::INFINITY, f32::min);
        low < self.table_z_m
    }

    /// Where the objects are.
    pub(crate) fn poses(&self) -> impl ExactSizeIterator<Item = Pose> {
        self.obstacles.iter().map(|(_, pose)| *pose)
    }

    /// An object in the frame of a grasp.
    pub(crate) fn pose_from(&self, workspace_from_grasp: &Pose, object_id: usize) -> Pose {
        workspace_from_grasp.inverse() * self.obstacles[object_id].1
    }

    /// The parts of all objects and the fixtures that are near one of some boxes, in the frame of a grasp.
    pub(crate) fn placed(&self, workspace_from_grasp: &Pose, boxes: &[GripperBox]) -> Vec<PlacedPart> {
        let grasp_from_workspace = workspace_from_grasp.inverse();
        let near = |(hulls, pose): &Obstacle| -> Vec<PlacedPart> {
            let pose = grasp_from_workspace * *pose;
            hulls.iter().filter(|hull| hull.is_near(&pose, boxes)).map(|hull| hull.placed(&pose)).collect()
        };
        self.obstacles.iter().chain([&self.fixtures]).flat_map(near).collect()
    }

    /// Whether the scene has fixtures.
    pub(crate) fn has_fixtures(&self) -> bool {
        !self.fixtures.0.is_empty()
    }

    /// Whether a fixture is straight above the grasp, as the board of a shelf.
    pub(crate) fn is_covered(&self, workspace_from_grasp: &Pose) -> bool {
        let point = GripperBox { centre_m: Vec3::ZERO, half_m: Vec3::splat(1e-3) };
        let at = Pose::from_translation(workspace_from_grasp.translation);
        self.touches_fixtures(&at, &[point.swept(Vec3::Z * COVER_M)])
    }

    /// Whether any of `boxes`, in the frame of a grasp, overlaps a fixture.
    pub(crate) fn touches_fixtures(&self, workspace_from_grasp: &Pose, boxes: &[GripperBox]) -> bool {
        self.overlapped(None, workspace_from_grasp, boxes).next().is_some()
    }

    /// How far each jaw of an open gripper at a grasp can close before it meets a fixture, at most its whole way, in
    /// metres, to a thousandth of that.
    pub(crate) fn free_closing_m(&self, workspace_from_grasp: &Pose, gripper: &Gripper) -> [f32; 2] {
        let ways_m = gripper.ways_m();
        let free =
            |side: usize, way_m: f32| !self.touches_fixtures(workspace_from_grasp, &gripper.jaw_sweep(side, way_m));
        [0, 1].map(|side| {
            if !self.has_fixtures() || free(side, ways_m[side]) {
                return ways_m[side];
            }
            halved(ways_m[side], FINE, |way_m| free(side, way_m))[0]
        })
    }

    /// The parts of an object, or the fixtures, somewhere else.
    pub(crate) fn placed_at(&self, object_id: Option<usize>, pose: &Pose) -> Vec<PlacedPart> {
        self.obstacle(object_id).0.iter().map(|hull| hull.placed(pose)).collect()
    }

    /// The parts of an object, or the fixtures, in the frame of a grasp, that any of `boxes` overlaps.
    pub(crate) fn overlapped(
        &self,
        object_id: Option<usize>,
        workspace_from_grasp: &Pose,
        boxes: &[GripperBox],
    ) -> impl Iterator<Item = PlacedPart> {
        let (hulls, workspace_from_part) = self.obstacle(object_id);
        let grasp_from_part = workspace_from_grasp.inverse() * *workspace_from_part;
        let near = hulls.iter().filter_map(move |hull| hull.near(&grasp_from_part, boxes));
        near.filter(move |part| boxes.iter().any(|b| part.overlaps(b)))
    }

    fn obstacle(&self, object_id: Option<usize>) -> &Obstacle {
        object_id.map_or(&self.fixtures, |id| &self.obstacles[id])
    }

    fn first_hit(&self, boxes: &[GripperBox], workspace_from_grasp: &Pose, target: usize) -> Option<Hit> {
        let touches = |id: &usize| self.overlapped(Some(*id), workspace_from_grasp, boxes).next().is_some();
        let others = (0..self.obstacles.len()).filter(|id| *id != target);
        if let Some(id) = core::iter::once(target).chain(others).find(touches) {
            return Some(Hit::object(id, target));
        }
        if self.touches_fixtures(workspace_from_grasp, boxes) {
            return Some(Hit::CONTAINER);
        }
        self.is_in_table(boxes, workspace_from_grasp).then_some(Hit::TABLE)
    }
}

/// How far a way is free that is not free up to `most`, from below and from above, by so many halvings.
pub(crate) fn halved(most: f32, halvings: usize, is_free: impl Fn(f32) -> bool) -> [f32; 2] {
    let (mut low, mut high) = (0.0, most);
    for _ in 0..halvings {
        let middle = 0.5 * (low + high);
        *if is_free(middle) { &mut low } else { &mut high } = middle;
    }
    [low, high]
}

fn overlap(parts: &[PlacedPart], boxes: &[GripperBox]) -> bool {
    parts.iter().any(|part| boxes.iter().any(|b| part.overlaps(b)))
}

#[cfg(test)]
pub(crate) mod tests {
    use schema::{Purpose, ShapeKind, Solid, Stream};

    use super::*;

    pub(crate) type V = [f64; 3];

    fn dot(a: V, b: V) -> f64 {
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    }

    fn cross(a: V, b: V) -> V {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    }

    pub(crate) fn points(vertices: &[Vec3], pose: &Pose) -> Vec<V> {
        vertices.iter().map(|v| pose.transform_point(*v).to_array().map(f64::from)).collect()
    }

    /// Width of the widest gap between two convex point sets along any axis that could part them (negative: overlap).
    /// The slow, obvious way: in double precision, every difference of two corners is taken for an edge.
    pub(crate) fn widest_gap(a: &[V], b: &[V]) -> f64 {
        let edges = |p: &[V]| -> Vec<V> {
            let all = p
                .iter()
                .enumerate()
                .flat_map(|(i, u)| p[i + 1..].iter().map(move |v| [v[0] - u[0], v[1] - u[1], v[2] - u[2]]));
            let mut unique: Vec<V> = Vec::new();
            for e in all {
                let length = dot(e, e).sqrt();
                let e = e.map(|c| c / length);
                if !unique.iter().any(|u| dot(cross(*u, e), cross(*u, e)) < 1e-10) {
                    unique.push(e);
                }
            }
            unique
        };
        let (ea, eb) = (edges(a), edges(b));
        let pairs = |x: &[V], y: &[V]| -> Vec<V> { x.iter().flat_map(|u| y.iter().map(|v| cross(*u, *v))).collect() };
        let mut axes = pairs(&ea, &eb);
        axes.extend(pairs(&ea, &ea));
        axes.extend(pairs(&eb, &eb));
        let mut widest = f64::NEG_INFINITY;
        for axis in axes {
            let length = dot(axis, axis).sqrt();
            if length < 1e-9 {
                continue;
            }
            let span = |p: &[V]| {
                p.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
                    let x = dot(*v, axis) / length;
                    (low.min(x), high.max(x))
                })
            };
            let ((a_low, a_high), (b_low, b_high)) = (span(a), span(b));
            widest = widest.max(b_low - a_high).max(a_low - b_high);
        }
        widest
    }

    #[test]
    fn the_gate_agrees_with_separating_axes_in_double_precision() {
        let gripper = Gripper::from_toml(include_str!("../../configs/grippers/parallel_jaw_80.toml")).unwrap();
        let mut stream = Stream::new(5, 0, Purpose::Candidates, 0);
        let (mut touching, mut clear) = (0, 0);
        for case in 0..400 {
            let kind = ShapeKind::ALL[case % 4];
            let extents = match kind {
                ShapeKind::Cylinder => Vec3::new(0.04, 0.04, 0.07),
                ShapeKind::HalfCylinder => Vec3::new(0.06, 0.06, 0.03),
                _ => Vec3::new(0.03, 0.05, 0.07),
            };
            let solid = Solid::new(kind, extents).unwrap();
            let pose = Pose::from_parts(stream.point(Vec3::splat(-0.07), Vec3::splat(0.07)), stream.rotation());
            let finger = gripper.open_gripper()[case % 3].swept_back(0.05);
            let object = SceneObject { body: solid.into(), mass_kg: 0.1, friction: 1.0, workspace_from_object: pose };
            let scene = Scene { table_z_m: -1.0, fixtures: Vec::new(), objects: vec![object] };
            let gate = Gate::new(&scene, &gripper, &Procedure::PAPER);
            let (hulls, pose_of_object) = &gate.obstacles[0];
            let got = hulls[0].near(pose_of_object, &[finger]).is_some_and(|part| part.overlaps(&finger));
            let corners: Vec<Vec3> = (0..8)
                .map(|c| {
                    let sign = |bit: usize| if c >> bit & 1 == 0 { -1.0 } else { 1.0 };
                    finger.centre_m + finger.half_m * Vec3::new(sign(0), sign(1), sign(2))
                })
                .collect();
            let gap = widest_gap(&points(&corners, &Pose::IDENTITY), &points(&solid.vertices_m(), &pose));
            if gap.abs() > 2e-6 {
                assert_eq!(got, gap < 0.0, "case {case} {kind:?}: gap {gap}");
            }
            if got { touching += 1 } else { clear += 1 }
        }
        assert!(touching > 50 && clear > 50, "{touching} touch, {clear} are clear");
    }
}
