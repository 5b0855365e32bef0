//! Proposes grasp candidates: poses at which the open gripper is free of what was seen of a scene, and closes on
//! something.
//!
//! A candidate touches a point of the seen surface. Either a finger closes along the point's normal, from any side that
//! is not below; or the gripper comes along the normal, tilted a little, and closes in any direction. Where nobody saw
//! the opposite side, it is drawn. Where the gripper would hit the table, or sweep through what was seen, nothing is
//! proposed. The [`Judge`] predicts whether a candidate succeeds.

mod judge;
mod space;
mod things;

use core::f32::consts::{FRAC_PI_2, FRAC_PI_6, PI};

use perception::SurfaceBlocks;
use rayon::prelude::*;
use schema::{Grasp, Gripper, GripperBox, Mat3, Pose, Quat, Stream, Vec3, VoxelGrid, axis_angle, pose_from_parts};

pub use judge::{Judge, ScoredGrasp};
use space::{Looks, Space, looks_of};

/// Share of candidates at which a finger closes along the normal; at the others the gripper comes along it.
const CLOSING_SHARE: f32 = 0.7;
/// Maximum tilt of a gripper that comes along a normal.
const TILT_RAD_MAX: f32 = FRAC_PI_6;
/// Approaches rise by at most this sine: they come from above or from the side.
const APPROACH_RISE_MAX: f32 = 0.05;
/// How far behind the touched point the tips end, and at the least before it.
const DEPTH_M: [f32; 2] = [-0.005, 0.04];
/// The least width of what fingers close on.
const WIDTH_M_MIN: f32 = 0.006;
/// How deep under a touched point the sides of what is touched are sought, if the gripper comes along the normal.
const INTO_M: f32 = 0.008;
/// How deep under a touched point the walk to the opposite side begins: on the surface itself noise decides.
const UNDER_M: f32 = 0.004;
/// Draws for each wanted candidate after which the search ends.
const TRIES_MAX: usize = 40;
/// Draws that are examined together; fewer where few candidates are wanted.
const ROUND: usize = 1024;

/// What was seen of a scene.
#[derive(Debug, Clone, Copy)]
pub struct ObservedScene<'a> {
    /// As a TSDF of the judge's voxels.
    pub field: &'a VoxelGrid,
    /// The same of finer voxels, if there are any: grasps are fitted to it more closely.
    pub fine: Option<&'a SurfaceBlocks>,
    /// From how many views.
    pub views: usize,
    /// The lower and the upper corner of the box in which candidates touch something, in metres.
    pub reach_m: [Vec3; 2],
}

/// A gripper, prepared for the search.
#[derive(Debug, Clone)]
pub struct CandidateSampler {
    span_m: f32,
    /// The gripper, if it has a fixed jaw.
    one_sided: Option<Gripper>,
    swept: Vec<GripperBox>,
    /// Points of the swept gripper in the grasp frame, in groups, those at the tips first.
    looks: Vec<Looks>,
}

/// What is drawn for one candidate.
struct Draw {
    point: usize,
    closes: bool,
    /// Angle of the approach about the closing direction, or of the closing direction about the approach.
    turn_rad: f32,
    tilt_rad: f32,
    /// Shares of what is left to choose: the depth above the table, the width where it was not seen, the place between
    /// the fingers.
    depth: f32,
    width: f32,
    offset: f32,
    flip: bool,
}

impl Draw {
    /// `surfaces`: all of it, and where a finger can close; of these points only `wanted`, where there are some.
    fn new(surfaces: &[Vec<(Vec3, Vec3)>; 2], wanted: &Wanted, stream: &mut Stream) -> Self {
        let closes = stream.uniform(0.0, 1.0) < CLOSING_SHARE && !surfaces[1].is_empty();
        let (all, wanted) = (&surfaces[usize::from(closes)], &wanted[usize::from(closes)]);
        Self {
            point: if wanted.is_empty() { stream.index(all.len()) } else { wanted[stream.index(wanted.len())] },
            closes,
            turn_rad: stream.uniform(-1.0, 1.0),
            tilt_rad: stream.uniform(0.0, TILT_RAD_MAX),
            depth: stream.uniform(0.0, 1.0),
            width: stream.uniform(0.0, 1.0),
            offset: stream.uniform(-1.0, 1.0),
            flip: stream.uniform(0.0, 1.0) < 0.5,
        }
    }
}

/// Points of the surfaces, by their numbers: of all, and of those where a finger can close; none for any of them.
type Wanted = [Vec<usize>; 2];

/// Of each of some grasps whether it is wanted.
pub type AreWanted<'a> = dyn Fn(&[Grasp]) -> Vec<bool> + 'a;

/// Where a grasp would fit better, if that is known: moved, and turned as it is.
pub type Better<'a> = dyn Fn(&Grasp) -> Option<Grasp> + Sync + 'a;

/// How candidates are spread over what was seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Spread {
    /// Evenly over its surface.
    Evenly,
    /// What is apart from each other has shares: half of the candidates, and half of those that the judge is asked
    /// about first, are the same for each thing. Then more are sought on things without a sure grasp.
    Shared,
    /// The same with nearly all that the judge is asked about, more on these things, several times, and the best grasp
    /// of each thing is looked at as closely as the best of all.
    Each,
}

/// What grasps a judge is to find.
#[derive(Clone, Copy)]
pub struct Search<'a> {
    /// Number of candidates to propose.
    pub proposals: usize,
    /// Of these, the number that the judge is asked about.
    pub asked: usize,
    /// How both are spread.
    pub spread: Spread,
    /// A grasp of an earlier search, about which the judge is asked, too, where it is still free.
    pub previous: Option<Grasp>,
    /// Distance between the tips of the best ones.
    pub apart_m: f32,
    /// Places near which candidates are proposed; none for anywhere.
    pub about_m: &'a [Vec3],
    /// Which candidates may be proposed.
    pub are_wanted: &'a AreWanted<'a>,
    /// Where the best grasps are moved.
    pub better: &'a Better<'a>,
}

impl CandidateSampler {
    /// Prepares a gripper that starts `pregrasp_distance_m` behind its grasp.
    #[must_use]
    pub fn new(gripper: &Gripper, pregrasp_distance_m: f32) -> Self {
        let swept = |b: GripperBox| b.swept_back(pregrasp_distance_m).grown(gripper.clearance_m);
        let swept: Vec<GripperBox> = gripper.open_gripper().into_iter().map(swept).collect();
        let mut looks: Vec<Looks> = swept.iter().flat_map(looks_of).collect();
        looks.sort_by(|a, b| b.middle_m.z.total_cmp(&a.middle_m.z));
        Self { span_m: gripper.span_m(), one_sided: gripper.fixed_side().map(|_| gripper.clone()), swept, looks }
    }

    /// At most `count` candidates in a scene, with the widths on which they close as far as these were seen; fewer if
    /// no more are found. A pure function of its arguments, whatever the number of threads.
    #[must_use]
    pub fn sample(&self, field: &VoxelGrid, count: usize, stream: &mut Stream) -> Vec<Grasp> {
        let space = Space::new(field, None, field.lattice.corners_m());
        let (every, counts) = (&|grasps: &[Grasp]| vec![true; grasps.len()], [count, count * TRIES_MAX]);
        let found = self.search(&space, &Default::default(), every, counts, stream);
        found.into_iter().map(|(_, grasp)| grasp).collect()
    }

    /// [`Self::sample`] in a scene that is prepared, for several searches, on the `wanted` points of its surfaces, of
    /// candidates that are wanted; each with the point that it touches. So many at most are found, and drawn.
    fn search(
        &self,
        space: &Space<'_>,
        wanted: &Wanted,
        are_wanted: &AreWanted<'_>,
        [count, draws_max]: [usize; 2],
        stream: &mut Stream,
    ) -> Vec<(Vec3, Grasp)> {
        let mut found = Vec::with_capacity(count);
        if space.surfaces[0].is_empty() {
            return found;
        }
        let together = ROUND.min(4 * count.max(1));
        for _ in 0..draws_max.div_ceil(together) {
            let draws: Vec<Draw> = (0..together).map(|_| Draw::new(&space.surfaces, wanted, stream)).collect();
            let candidate = |draw: &Draw| self.candidate(space, draw);
            let round: Vec<Option<Grasp>> = draws.par_iter().with_min_len(64).map(candidate).collect();
            let touched_m = |draw: &Draw| space.surfaces[usize::from(draw.closes)][draw.point].0;
            let round: Vec<(Vec3, Grasp)> =
                draws.iter().zip(round).filter_map(|(draw, grasp)| Some((touched_m(draw), grasp?))).collect();
            let grasps: Vec<Grasp> = round.iter().map(|(_, grasp)| *grasp).collect();
            found.extend(kept(&round, &are_wanted(&grasps)));
            if found.len() >= count {
                break;
            }
        }
        found.truncate(count);
        found
    }

    /// The candidate of a draw at its point of the surface, if the gripper is free there.
    fn candidate(&self, space: &Space<'_>, draw: &Draw) -> Option<Grasp> {
        let (point_m, normal) = space.surfaces[usize::from(draw.closes)][draw.point];
        let span_m = self.span_m;
        let (rotation, width_m, centre_m) = if draw.closes {
            let rotation = approach_about(normal, FRAC_PI_2 * draw.turn_rad, draw.flip);
            if rises(rotation) {
                return None;
            }
            // The same for each candidate that closes at this point.
            let behind_m = *space.behind_m[draw.point]
                .get_or_init(|| space.way_out_m(point_m - UNDER_M * normal, -normal, span_m - UNDER_M));
            let width_m =
                behind_m.map_or(WIDTH_M_MIN + draw.width * (span_m - WIDTH_M_MIN), |behind_m| UNDER_M + behind_m);
            (rotation, width_m, point_m - 0.5 * width_m * normal)
        } else {
            let tilted = axis_angle(perpendicular(normal, PI * draw.offset), draw.tilt_rad) * normal;
            let rotation = from_axes(perpendicular(-tilted, PI * draw.turn_rad), -tilted);
            if rises(rotation) {
                return None;
            }
            let (middle_m, across) = (point_m - INTO_M * normal, rotation * Vec3::Y);
            let out_m = |along: Vec3| space.way_out_m(middle_m, along, span_m);
            match out_m(-across).and_then(|before_m| Some((before_m, out_m(across)?))) {
                Some((before_m, behind_m)) => {
                    (rotation, before_m + behind_m, point_m + 0.5 * (behind_m - before_m) * across)
                }
                None => (rotation, draw.width * span_m, point_m),
            }
        };
        if width_m > span_m || (draw.closes && width_m < WIDTH_M_MIN) {
            return None;
        }
        let approach = rotation * Vec3::Z;
        // What is between the fingers need not be in their middle; a fixed one is beside it.
        let slack_m = match &self.one_sided {
            Some(gripper) => gripper.aside_m(width_m),
            None => 0.25 * (span_m - width_m) * draw.offset,
        };
        let middle_m = centre_m + rotation * Vec3::new(0.0, slack_m, 0.0);
        let at_m = |depth_m: f32| pose_from_parts(rotation, middle_m + approach * depth_m);
        // The tips go no deeper than the table lets them.
        let deepest_m = if approach.z < 0.0 { self.above_m(space, &at_m(0.0)) / -approach.z } else { DEPTH_M[1] };
        if deepest_m < DEPTH_M[0] {
            return None;
        }
        let depth_m = DEPTH_M[0] + draw.depth * (deepest_m.min(DEPTH_M[1]) - DEPTH_M[0]);
        let workspace_from_grasp = at_m(depth_m);
        self.is_free(space, &workspace_from_grasp).then_some(Grasp { workspace_from_grasp, width_m })
    }

    /// How high the swept gripper is above the table.
    fn above_m(&self, space: &Space<'_>, workspace_from_grasp: &Pose) -> f32 {
        let lowest_m = self.swept.iter().map(|b| b.lowest_z_m(workspace_from_grasp));
        lowest_m.fold(f32::INFINITY, f32::min) - space.field.lattice.table_z_m
    }

    /// Whether neither the table nor what was seen is in the gripper's way.
    fn is_free(&self, space: &Space<'_>, workspace_from_grasp: &Pose) -> bool {
        let Pose { rotation, translation, .. } = *workspace_from_grasp;
        self.above_m(space, workspace_from_grasp) >= 0.0 && !space.is_in_the_way(rotation, translation, &self.looks)
    }
}

/// Whether the gripper comes from below.
fn rises(rotation: Quat) -> bool {
    (rotation * Vec3::Z).z > APPROACH_RISE_MAX
}

/// The orientation that closes along `closing` and approaches in the plane across it, `turn_rad` from the steepest way
/// down.
fn approach_about(closing: Vec3, turn_rad: f32, flip: bool) -> Quat {
    let y = if flip { -closing } else { closing };
    let down = (-Vec3::Z + y * y.z).normalize();
    let z = axis_angle(y, turn_rad) * down;
    from_axes(y, z)
}

/// A unit vector across `axis`, `turn_rad` from a fixed one.
fn perpendicular(axis: Vec3, turn_rad: f32) -> Vec3 {
    let start = if axis.z.abs() > 0.9 { Vec3::X } else { Vec3::Z };
    axis_angle(axis, turn_rad) * axis.cross(start).normalize()
}

fn from_axes(y: Vec3, z: Vec3) -> Quat {
    Quat::from_mat3(&Mat3::from_cols(y.cross(z), y, z)).normalize()
}

/// Those of some things that are to be kept.
fn kept<T: Copy>(all: &[T], keeps: &[bool]) -> Vec<T> {
    all.iter().zip(keeps).filter(|(_, is_kept)| **is_kept).map(|(one, _)| *one).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use network::checkpoint;
    use perception::TRUNCATION_VOXELS;
    use schema::{Grid, Pose, Procedure, Purpose};

    use super::*;

    /// A box of 40 x 50 x 60 mm on the table, seen from all sides.
    const MIDDLE_M: Vec3 = Vec3::new(0.15, 0.15, 0.08);
    const HALF_M: Vec3 = Vec3::new(0.02, 0.025, 0.03);

    fn depth_in_box_m(point_m: Vec3) -> f32 {
        (HALF_M - (point_m - MIDDLE_M).abs()).min_element()
    }

    fn field_of(resolution: usize) -> VoxelGrid {
        field_with(resolution, &[[MIDDLE_M, HALF_M]])
    }

    /// Boxes on the table, by their middles and halves of their sides.
    fn field_with(resolution: usize, boxes: &[[Vec3; 2]]) -> VoxelGrid {
        let (grid, n) = (Grid { resolution, ..Grid::PAPER }, resolution);
        let value = |index: usize| {
            let at_m = grid.centre_m([index / (n * n), index / n % n, index % n]);
            let to_box = |[middle_m, half_m]: &[Vec3; 2]| {
                let off_m = (at_m - *middle_m).abs() - *half_m;
                off_m.max(Vec3::ZERO).length() + off_m.max_element().min(0.0)
            };
            let to_box = boxes.iter().map(to_box).fold(f32::INFINITY, f32::min);
            let truncation_m = TRUNCATION_VOXELS * grid.voxel_size_m();
            let tsdf = (to_box.min(at_m.z - 0.05) / truncation_m).clamp(-1.0, 1.0);
            if tsdf.abs() < 0.98 { 0.5 * (tsdf + 1.0) } else { 0.0 }
        };
        VoxelGrid::new(grid, (0..grid.len()).map(value).collect()).unwrap()
    }

    fn field() -> VoxelGrid {
        field_of(40)
    }

    fn proposed(count: usize) -> (Gripper, Vec<Grasp>) {
        let gripper = Gripper::from_toml(Gripper::BUILT_IN[0].1).unwrap();
        let sampler = CandidateSampler::new(&gripper, Procedure::PAPER.pregrasp_distance_m);
        let candidates = sampler.sample(&field(), count, &mut Stream::new(1, 0, Purpose::Proposals, 0));
        (gripper, candidates)
    }

    /// How deep the deepest point of the gripper, on its way to any of these grasps, is in the box.
    fn deepest_m(gripper: &Gripper, grasps: &[Grasp]) -> f32 {
        let boxes = gripper.open_gripper();
        let swept: Vec<_> = boxes.iter().map(|b| b.swept_back(Procedure::PAPER.pregrasp_distance_m)).collect();
        let points_m: Vec<Vec3> = swept.iter().flat_map(looks_of).flat_map(|looks| looks.points_m).collect();
        let depths_m = grasps
            .iter()
            .flat_map(|grasp| points_m.iter().map(|point_m| depth_in_box_m(grasp.workspace_from_grasp * *point_m)));
        depths_m.fold(f32::NEG_INFINITY, f32::max)
    }

    #[test]
    fn candidates_are_free_and_come_from_above_or_from_the_side() {
        let (gripper, candidates) = proposed(500);
        assert_eq!(candidates.len(), 500);
        let boxes = gripper.open_gripper();
        let swept: Vec<_> = boxes.iter().map(|b| b.swept_back(Procedure::PAPER.pregrasp_distance_m)).collect();
        for Grasp { workspace_from_grasp: pose, .. } in &candidates {
            assert!((pose.rotation * Vec3::Z).z <= APPROACH_RISE_MAX);
            assert!(swept.iter().all(|b| b.lowest_z_m(pose) > 0.05));
        }
        // The field's voxels are 7.5 mm, and it is looked up without interpolation.
        let deepest_m = deepest_m(&gripper, &candidates);
        assert!(deepest_m < 0.012, "{deepest_m}");
        let rise = |grasp: &Grasp| (grasp.workspace_from_grasp.rotation * Vec3::Z).z;
        let level = candidates.iter().filter(|grasp| rise(grasp) > -0.3).count();
        let steep = candidates.iter().filter(|grasp| rise(grasp) < -0.8).count();
        assert!(level > 50 && steep > 50, "{level} {steep}");
    }

    fn every(grasps: &[Grasp]) -> Vec<bool> {
        vec![true; grasps.len()]
    }

    fn nowhere(_: &Grasp) -> Option<Grasp> {
        None
    }

    fn search(spread: Spread) -> Search<'static> {
        let (are_wanted, better) = (&every, &nowhere);
        Search { proposals: 256, asked: 64, spread, previous: None, apart_m: 0.01, about_m: &[], are_wanted, better }
    }

    fn shipped() -> Judge {
        let gripper = Gripper::from_toml(Gripper::BUILT_IN[0].1).unwrap();
        let weights = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/judge.safetensors");
        Judge::new(&checkpoint::read(&weights).unwrap(), &gripper, &Grid::PAPER).unwrap()
    }

    fn judged(judge: &Judge, field: &VoxelGrid, scene: u64, search: &Search<'_>) -> Vec<ScoredGrasp> {
        let seen = ObservedScene { field, fine: None, views: 6, reach_m: field.lattice.corners_m() };
        judge.scored_grasps(seen, search, &mut Stream::new(1, scene, Purpose::Proposals, 0)).0
    }

    fn searched(
        sampler: &CandidateSampler,
        space: &Space<'_>,
        wanted: &Wanted,
        are_wanted: &AreWanted<'_>,
        count: usize,
    ) -> Vec<Grasp> {
        let (counts, mut stream) = ([count, count * TRIES_MAX], Stream::new(1, 0, Purpose::Proposals, 0));
        let found = sampler.search(space, wanted, are_wanted, counts, &mut stream);
        found.into_iter().map(|(_, grasp)| grasp).collect()
    }

    /// Those on a face of the box, when only its points are wanted.
    #[test]
    fn a_search_keeps_to_the_wanted_points() {
        let (gripper, all) = proposed(200);
        let field = field();
        let sampler = CandidateSampler::new(&gripper, Procedure::PAPER.pregrasp_distance_m);
        let space = Space::new(&field, None, field.lattice.corners_m());
        let corner_m = MIDDLE_M + HALF_M;
        let wanted = space.near(&[corner_m], 0.02);
        assert!(wanted.iter().zip(&space.surfaces).all(|(near, all)| !near.is_empty() && near.len() < all.len() / 2));
        let near = searched(&sampler, &space, &wanted, &every, 200);
        let off_m = |grasps: &[Grasp]| {
            let off_m = grasps.iter().map(|grasp| (grasp.workspace_from_grasp.translation - corner_m).length());
            off_m.sum::<f32>() / grasps.len() as f32
        };
        assert!(off_m(&near) < 0.85 * off_m(&all), "{} {}", off_m(&near), off_m(&all));
        assert!(space.near(&[], 1.0).iter().all(Vec::is_empty));
        let is_steep = |grasp: &Grasp| (grasp.workspace_from_grasp.rotation * Vec3::Z).z < -0.8;
        let steep = |grasps: &[Grasp]| grasps.iter().map(is_steep).collect();
        // Others take the place of candidates that are not wanted.
        let found = searched(&sampler, &space, &wanted, &steep, 200);
        assert!(found.len() == 200 && found.iter().all(is_steep) && !near.iter().all(is_steep));
    }

    /// Groups of points that are far from all that was seen are skipped, and change no answer.
    #[test]
    fn a_gripper_is_in_the_way_where_one_of_its_points_is() {
        let (gripper, field, fine) = (proposed(1).0, field(), SurfaceBlocks::from(&field_of(120)));
        let sampler = CandidateSampler::new(&gripper, Procedure::PAPER.pregrasp_distance_m);
        let space = Space::new(&field, Some(&fine), field.lattice.corners_m());
        let mut stream = Stream::new(4, 0, Purpose::Views, 0);
        let (mut free, count) = (0, 3000);
        for _ in 0..count {
            let (at_m, rotation) = (stream.point(Vec3::splat(-0.05), Vec3::splat(0.35)), stream.rotation());
            let is_in_the_way = space.is_in_the_way(rotation, at_m, &sampler.looks);
            let one = |point_m: &Vec3| {
                let looks = [Looks { middle_m: *point_m, points_m: vec![*point_m] }];
                space.is_in_the_way(rotation, at_m, &looks)
            };
            assert_eq!(is_in_the_way, sampler.looks.iter().flat_map(|looks| &looks.points_m).any(one), "{at_m}");
            free += usize::from(!is_in_the_way);
        }
        assert!((count / 10..count * 9 / 10).contains(&free), "{free}");
    }

    #[test]
    fn candidates_are_freer_in_a_finer_field() {
        let (gripper, coarse) = proposed(500);
        let (field, fine) = (field(), field_of(120));
        let sampler = CandidateSampler::new(&gripper, Procedure::PAPER.pregrasp_distance_m);
        let fine = SurfaceBlocks::from(&fine);
        let space = Space::new(&field, Some(&fine), field.lattice.corners_m());
        let none = Default::default();
        let candidates = searched(&sampler, &space, &none, &every, 500);
        assert_eq!(candidates.len(), 500);
        let [before_m, after_m] = [&coarse, &candidates].map(|grasps| deepest_m(&gripper, grasps));
        // A millimetre is not in the way.
        assert!(before_m > 0.003 && after_m < 0.002, "{before_m} {after_m}");
    }

    #[test]
    fn most_candidates_have_the_box_between_the_fingers_and_know_its_width() {
        let (gripper, candidates) = proposed(500);
        let half_y_m = 0.5 * gripper.opening_m_max;
        let holds = |grasp: &&Grasp| {
            let steps = || (-20_i8..=20).map(|step| f32::from(step) / 20.0);
            steps().any(|y| {
                (1_u8..=10).any(|z| {
                    let at = Vec3::new(0.0, y * half_y_m, -0.003 * f32::from(z));
                    depth_in_box_m(grasp.workspace_from_grasp * at) > 0.0
                })
            })
        };
        let between = candidates.iter().filter(holds).count();
        assert!(between > 300, "{between} of 500");
        // Closing across the box, 40 or 50 mm, as far as normals of a field of 7.5 mm lie straight across.
        let known = |grasp: &&Grasp| [0.04, 0.05].iter().any(|side| (grasp.width_m - side).abs() < 0.002);
        let known = candidates.iter().filter(known).count();
        assert!(known > 150, "{known} of 500");
    }

    #[test]
    fn a_thing_ends_where_its_neighbour_has_not_begun() {
        // Two slabs of 20 mm across x, 15 mm apart.
        let value = |index: usize| {
            let x_m = Grid::PAPER.centre_m([index / 1600, 0, 0]).x;
            let to_slab_m = [0.1_f32, 0.135].map(|middle_m| (x_m - middle_m).abs() - 0.01).into_iter().reduce(f32::min);
            0.5 * (to_slab_m.unwrap() / 0.03).clamp(-0.9, 0.9) + 0.5
        };
        let slabs = VoxelGrid::new(Grid::PAPER, (0..64_000).map(value).collect()).unwrap();
        let way_m = |x_m: f32, most_m: f32| {
            let found = Space::new(&slabs, None, slabs.lattice.corners_m()).way_out_m(
                Vec3::new(x_m, 0.15, 0.15),
                Vec3::X,
                most_m,
            );
            found.map(|found_m| x_m + found_m)
        };
        let ends = |end_m: Option<f32>, at_m: f32| end_m.is_some_and(|end_m| (end_m - at_m).abs() < 0.002);
        for from_m in [0.095, 0.1, 0.107] {
            assert!(ends(way_m(from_m, 0.08), 0.11), "{from_m}: {:?}", way_m(from_m, 0.08));
        }
        assert_eq!(way_m(0.115, 0.08), None);
        // All of the way counts, also if it is no whole number of steps; what is longer is not found.
        assert!(ends(way_m(0.091, 0.0195), 0.11));
        assert_eq!(way_m(0.091, 0.01), None);
    }

    #[test]
    fn an_empty_table_has_no_candidates_and_the_same_stream_gives_the_same_candidates() {
        let empty = VoxelGrid::new(Grid::PAPER, vec![0.0; 64_000]).unwrap();
        let gripper = Gripper::from_toml(Gripper::BUILT_IN[0].1).unwrap();
        let mut stream = Stream::new(1, 0, Purpose::Proposals, 0);
        assert!(CandidateSampler::new(&gripper, 0.05).sample(&empty, 10, &mut stream).is_empty());
        assert_eq!(proposed(300).1, proposed(500).1[..300]);
    }

    /// A little aside the judge is as sure of grasps on a box, in the air above it is not.
    #[test]
    fn the_best_grasps_go_to_a_better_place_if_the_judge_is_as_sure() {
        let (judge, field) = (shipped(), field());
        let tips_m = |off_m: Option<Vec3>| -> Vec<Vec3> {
            let better = |grasp: &Grasp| {
                let pose = grasp.workspace_from_grasp;
                let moved = |off_m: Vec3| Pose { translation: pose.translation + off_m, ..pose };
                off_m.map(|off_m| Grasp { workspace_from_grasp: moved(off_m), ..*grasp })
            };
            let found = judged(&judge, &field, 0, &Search { better: &better, ..search(Spread::Evenly) });
            found.iter().map(|scored| scored.grasp.workspace_from_grasp.translation).collect()
        };
        let as_proposed_m = tips_m(None);
        let moved_by_m = |off_m: Vec3| -> Vec<f32> {
            let nearest_m = |at_m: &Vec3| {
                as_proposed_m.iter().map(|from_m| (*at_m - *from_m).length()).fold(f32::INFINITY, f32::min)
            };
            tips_m(Some(off_m)).iter().map(nearest_m).filter(|by_m| *by_m > 1e-6).collect()
        };
        let by_m = moved_by_m(Vec3::new(0.0, 0.0, 0.001));
        assert!((1..=6).contains(&by_m.len()), "{by_m:?}");
        assert!(by_m.iter().all(|by_m| (by_m - 0.001).abs() < 1e-5 || (by_m - 0.0005).abs() < 1e-5), "{by_m:?}");
        assert_eq!(moved_by_m(Vec3::new(0.0, 0.0, 0.2)), [0.0; 0]);
    }

    /// A cube of 24 mm beside the box.
    const CUBE_M: [Vec3; 2] = [Vec3::new(0.24, 0.24, 0.062), Vec3::splat(0.012)];

    #[test]
    fn what_is_apart_has_its_share_and_one_thing_alone_changes_nothing() {
        let (gripper, judge, one) = (Gripper::from_toml(Gripper::BUILT_IN[0].1).unwrap(), shipped(), field());
        let alone = judged(&judge, &one, 0, &search(Spread::Evenly));
        for spread in [Spread::Shared, Spread::Each] {
            assert_eq!(judged(&judge, &one, 0, &search(spread)), alone);
        }
        let both = field_with(40, &[[MIDDLE_M, HALF_M], CUBE_M]);
        let at_cube = |grasps: &[Grasp]| {
            let tips_m = grasps.iter().map(|grasp| grasp.workspace_from_grasp.translation);
            tips_m.filter(|tips_m| (*tips_m - CUBE_M[0]).length() < 0.05).count()
        };
        let space = Space::new(&both, None, both.lattice.corners_m());
        let (sampler, none) = (CandidateSampler::new(&gripper, 0.05), Default::default());
        let things = things::Things::new(&space, &none);
        assert_eq!(things.count(), 2);
        let shared = things.shared(&space, &none, |_| true);
        let [few, many] = [&none, &shared].map(|wanted| at_cube(&searched(&sampler, &space, wanted, &every, 500)));
        assert!(few > 0 && 10 * many > 13 * few, "{few} and {many} of 500");
        // Half of 48 are shared by two.
        let on_cube = space.surfaces[0].iter().find(|(at_m, _)| (*at_m - CUBE_M[0]).length() < 0.03).unwrap();
        let cube = things.at(on_cube.0).unwrap();
        let asked = [Spread::Shared, Spread::Each].map(|spread| {
            let of_cube = |one: &&ScoredGrasp| one.thing == Some(cube);
            judged(&judge, &both, 0, &search(spread)).iter().filter(of_cube).count()
        });
        // Nearly all of them where each counts.
        assert!(asked[0] >= 12 && asked[1] >= 20 && asked[1] > asked[0], "{asked:?}");
    }

    #[test]
    fn a_previous_grasp_is_asked_about_where_it_is_free() {
        let (judge, field) = (shipped(), field());
        let best = judged(&judge, &field, 0, &search(Spread::Shared))[0].grasp;
        let is_asked = |previous: Grasp| {
            let search = Search { previous: Some(previous), ..search(Spread::Shared) };
            judged(&judge, &field, 1, &search).iter().any(|judged| judged.grasp == previous)
        };
        assert!(judged(&judge, &field, 1, &search(Spread::Shared)).iter().all(|judged| judged.grasp != best));
        assert!(is_asked(best));
        let mut in_the_table = best;
        in_the_table.workspace_from_grasp.translation.z = 0.0;
        assert!(!is_asked(in_the_table));
    }
}
