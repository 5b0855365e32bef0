//! Which grasps are wanted: of what, from where, and where the gripper may be.

use std::sync::atomic::{AtomicUsize, Ordering};

use perception::{Pieces, Rim, Wall, nearest, walls};
use rayon::prelude::*;
use schema::{GripperBox, Plane, Pose, Vec3};

use crate::config::Config;
use crate::gripper_volume::{GripperVolume, TABLE_M};
use crate::observation::{Cone, Limits, Mask, View};
use crate::plan::{Limit, SegmentedCloud};

/// A point of the surface is what a pixel shows if their depths differ by no more than this.
const SAME_M: f32 = 0.015;
/// The object of a target point is the one with a point of its surface within this.
const TARGET_NEAR_M: f32 = 0.05;
/// A point of the surface is a target's if one of its points is within this: what separates the points of a thin cloud.
const TARGET_POINT_M: f32 = 0.006;
/// A gripper leaves as it came, over this distance, and hits a wall if it meets more of its points: they are noisy.
const WAY_OUT_M: f32 = 0.1;
const WALL_POINTS_MAX: usize = 5;
/// What is further from all that was seen of a wall is a part of it that things hide.
const FACE_M: f32 = 0.008;
/// Grasps are proposed about no more points than this.
const ABOUT_MAX: usize = 400;
/// A rim of which less than this share is on straight walls is that of another container.
const STRAIGHT_SHARE: f32 = 0.75;

/// Of each of some grasps, in the workspace, whether it will do.
pub type WillDo<'a> = dyn Fn(&[Pose]) -> Vec<bool> + Sync + 'a;

/// Limits, ready to be held against grasps; it counts what they refuse.
pub(crate) struct Limiter<'a> {
    limits: &'a Limits,
    /// The corners of the open gripper at the grasp and before it, in the grasp frame.
    corners_m: Vec<Vec3>,
    between_fingers: GripperVolume,
    /// Points of the surface off the table, sorted along x: the target's, and the others.
    target_m: Option<[Vec<Vec3>; 2]>,
    walls: Walls,
    /// What a leaving gripper passes, and its corners.
    way_out: GripperVolume,
    way_out_corners_m: Vec<Vec3>,
    /// Whether a camera looks at the fingers.
    is_in_sight: &'a (dyn Fn(&Pose) -> bool + Sync),
    /// The caller's own.
    will_do: &'a WillDo<'a>,
    refused: [AtomicUsize; Limit::ALL.len()],
}

impl<'a> Limiter<'a> {
    /// Limits for the gripper of some settings. `target_m` has the surface's points that are the target's, and the
    /// others; none if there is no target.
    pub(crate) fn new(
        limits: &'a Limits,
        config: &Config,
        mut target_m: Option<[Vec<Vec3>; 2]>,
        mut walls: Walls,
        is_in_sight: &'a (dyn Fn(&Pose) -> bool + Sync),
        will_do: &'a WillDo<'a>,
    ) -> Self {
        let Config { gripper, collision, .. } = config;
        let swept_back = |way_m| gripper.open_gripper().iter().map(|part| part.swept_back(way_m)).collect::<Vec<_>>();
        let (way_out, swept) = (swept_back(WAY_OUT_M), swept_back(collision.pregrasp_distance_m));
        let corners_m = swept.iter().flat_map(corners).collect();
        // So that each grasp looks at few of them.
        let of_walls = [&mut walls.things_m, &mut walls.walls_m];
        for points_m in target_m.iter_mut().flatten().chain(of_walls) {
            points_m.sort_by(|a, b| a.x.total_cmp(&b.x));
        }
        Self {
            limits,
            corners_m,
            between_fingers: GripperVolume::between_fingers(gripper),
            target_m,
            walls,
            way_out_corners_m: way_out.iter().flat_map(corners).collect(),
            way_out: GripperVolume::new(way_out),
            is_in_sight,
            will_do,
            refused: Default::default(),
        }
    }

    /// Some of the wanted points, all over them; none if any may be gripped.
    pub(crate) fn about_m(&self) -> Vec<Vec3> {
        let wanted_m = self.target_m.as_ref().map_or(&self.walls.things_m, |[target_m, _]| target_m);
        wanted_m.iter().copied().step_by(wanted_m.len() / ABOUT_MAX + 1).collect()
    }

    /// Whether walls of a container were found.
    pub(crate) fn is_in_container(&self) -> bool {
        !self.walls.walls_m.is_empty()
    }

    /// Whether a board may lie on them of which nothing was seen.
    pub(crate) fn may_have_board(&self) -> bool {
        self.walls.board.is_some_and(|board| !board.is_seen)
    }

    /// The upper edges of these walls.
    pub(crate) fn edges_m(&self) -> &[Vec<[f32; 3]>] {
        &self.walls.edges_m
    }

    /// Whether a gripper on its way out gets to where a board may be.
    pub(crate) fn meets_board(&self, workspace_from_grasp: &Pose) -> bool {
        let is_over = |board: &Wall| self.way_out_corners_m.iter().any(|at| board.is_over(*workspace_from_grasp * *at));
        self.walls.board.as_ref().is_some_and(is_over)
    }

    /// Of each grasp the first limit that it breaks. The caller is asked once, about all that break no other.
    pub(crate) fn broken(&self, workspace_from_grasps: &[Pose]) -> Vec<Option<Limit>> {
        let mut broken: Vec<Option<Limit>> =
            workspace_from_grasps.par_iter().with_min_len(32).map(|pose| self.find(pose)).collect();
        let left: Vec<usize> = (0..broken.len()).filter(|place| broken[*place].is_none()).collect();
        if !left.is_empty() {
            let asked: Vec<Pose> = left.iter().map(|place| workspace_from_grasps[*place]).collect();
            for (place, will_do) in left.into_iter().zip((self.will_do)(&asked)) {
                broken[place] = (!will_do).then_some(Limit::Accept);
            }
        }
        for limit in broken.iter().flatten() {
            self.refused[*limit as usize].fetch_add(1, Ordering::Relaxed);
        }
        broken
    }

    fn find(&self, workspace_from_grasp: &Pose) -> Option<Limit> {
        let Limits { approach, keep_out, reach_m, avoid_objects, target: _ } = self.limits;
        let tips_m = workspace_from_grasp.translation;
        if let Some(Cone { direction, angle_rad_max }) = approach {
            let cos = (workspace_from_grasp.rotation * Vec3::Z).dot(*direction);
            if libm::acosf(cos.clamp(-1.0, 1.0)) > *angle_rad_max {
                return Some(Limit::Approach);
            }
        }
        let is_outside = |[low, high]: &[Vec3; 2]| tips_m.cmplt(*low).any() || tips_m.cmpgt(*high).any();
        if reach_m.as_ref().is_some_and(is_outside) {
            return Some(Limit::Reach);
        }
        if avoid_objects.iter().any(|ball| (tips_m - ball.centre_m).length() < ball.radius_m) {
            return Some(Limit::AvoidObjects);
        }
        let is_beyond = |plane: &Plane| {
            self.corners_m.iter().any(|corner| plane.normal.dot(*workspace_from_grasp * *corner) < plane.offset_m)
        };
        if keep_out.iter().any(is_beyond) {
            return Some(Limit::KeepOut);
        }
        let between = |points_m: &[Vec3]| self.between_fingers.points_inside_sorted(workspace_from_grasp, points_m);
        let is_of_others = |[of_target, of_others]: &[Vec<Vec3>; 2]| {
            let wanted = between(of_target);
            wanted == 0 || between(of_others) > wanted
        };
        if self.target_m.as_ref().is_some_and(is_of_others) {
            return Some(Limit::Target);
        }
        let Walls { things_m, walls_m, board, .. } = &self.walls;
        // Who wants a wall says so. A wall takes no part in other grasps: it holds what is gripped with it.
        let closes_on_wall = || between(things_m) == 0 || between(walls_m) > WALL_POINTS_MAX;
        let leaves_through = || self.way_out.points_inside_sorted(workspace_from_grasp, walls_m) > WALL_POINTS_MAX;
        let meets_wall = (self.target_m.is_none() && closes_on_wall())
            || (board.is_some_and(|board| board.is_seen) && self.meets_board(workspace_from_grasp))
            || leaves_through();
        if !walls_m.is_empty() && meets_wall {
            return Some(Limit::Walls);
        }
        (!(self.is_in_sight)(workspace_from_grasp)).then_some(Limit::Unseen)
    }

    /// What was refused, in words: `412 by approach, 7 by target`; none if nothing was.
    pub(crate) fn rejections(&self) -> Option<String> {
        let counts = Limit::ALL.map(|limit| (self.refused[limit as usize].load(Ordering::Relaxed), limit.name()));
        let counts: Vec<String> =
            counts.iter().filter(|(count, _)| *count > 0).map(|(count, name)| format!("{count} by {name}")).collect();
        (!counts.is_empty()).then(|| counts.join(", "))
    }
}

/// The corners of a part of a gripper, in the grasp frame.
pub(crate) fn corners(part: &GripperBox) -> impl Iterator<Item = Vec3> + use<> {
    let GripperBox { centre_m, half_m } = *part;
    (0..8).map(move |corner| {
        let side = |axis: u8| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
        centre_m + half_m * Vec3::new(side(0), side(1), side(2))
    })
}

/// The points of a surface off the table that masks show, and the others. A point is shown by a pixel of a view with a
/// mask onto which it falls and whose depth is its own.
pub(crate) fn seen_points(points_m: &[Vec3], views: &[View], masks: &[Option<Mask>], table_z_m: f32) -> [Vec<Vec3>; 2] {
    let masked: Vec<_> = views
        .iter()
        .zip(masks)
        .filter_map(|(view, mask)| Some((view, mask.as_ref()?, view.camera.workspace_from_camera.inverse())))
        .collect();
    let is_target = |point_m: &Vec3| {
        masked.iter().any(|(view, mask, camera_from_workspace)| {
            let local_m = *camera_from_workspace * *point_m;
            let Some([u, v]) = view.camera.intrinsics.project(local_m) else { return false };
            let is_it = view.image.at([u, v]).is_some_and(|depth_m| (depth_m - local_m.z).abs() <= SAME_M);
            is_it && mask[v * view.image.width_px + u]
        })
    };
    let off_table = points_m.iter().copied().filter(|point| point.z > table_z_m + TABLE_M);
    let (target, others) = off_table.partition(is_target);
    [target, others]
}

/// The points of a surface off the table that are a target's, by points of it, and the others.
pub(crate) fn near_points(points_m: &[Vec3], target_m: &[Vec3], table_z_m: f32) -> [Vec<Vec3>; 2] {
    let off_table: Vec<Vec3> = points_m.iter().copied().filter(|point| point.z > table_z_m + TABLE_M).collect();
    let near = nearest(&off_table, target_m, TARGET_POINT_M);
    let of =
        |wanted: bool| off_table.iter().zip(&near).filter(move |(_, it)| it.is_some() == wanted).map(|(at, _)| *at);
    [of(true).collect(), of(false).collect()]
}

/// A container, if there is one.
#[derive(Debug, Default)]
pub(crate) struct Walls {
    /// Points of the surface off the table that are of no wall and not behind one.
    things_m: Vec<Vec3>,
    walls_m: Vec<Vec3>,
    /// The front edge of a board over it.
    board: Option<Wall>,
    /// The upper edges of walls, each a line of points in metres.
    edges_m: Vec<Vec<[f32; 3]>>,
}

impl Walls {
    /// Those among the points of a surface that cameras saw.
    pub(crate) fn among(points_m: &[Vec3], pieces: &Pieces, views: &[View], table_z_m: f32) -> Self {
        let mut walls = walls(points_m, table_z_m);
        let eyes_m: Vec<Vec3> = views.iter().map(|view| view.camera.workspace_from_camera.translation).collect();
        let found = (0..walls.len()).find_map(|n| Some((n, walls[n].board(&walls, points_m, &eyes_m, table_z_m)?)));
        let board = found.map(|(n, board)| (walls.remove(n), board).1);
        let is_straight = |rim: &Rim| {
            let straight = rim.edge_m.iter().filter(|at| walls.iter().any(|wall| wall.has(**at))).count();
            straight as f32 >= STRAIGHT_SHARE * rim.edge_m.len() as f32
        };
        let rim = pieces.rim().filter(|rim| board.is_none() && !is_straight(rim));
        if rim.is_some() {
            walls.clear();
        } else if walls.is_empty() {
            return Self::default();
        }
        let off_table = points_m.iter().copied().filter(|point| point.z > table_z_m + TABLE_M);
        walls.retain(|wall| wall.bottom_m < wall.top_m);
        let is_wall = |at: &Vec3| {
            // Below a board's edge are things.
            let is_edge = board.as_ref().is_some_and(|edge| edge.is_board(*at));
            let is_corner = |wall: &Wall| walls.iter().any(|next| wall.turns_into(next, *at));
            is_edge
                || walls.iter().any(|wall| wall.has(*at) || is_corner(wall))
                || rim.iter().any(|rim| pieces.is_of(rim, *at))
        };
        let (mut walls_m, mut things_m): (Vec<Vec3>, Vec<Vec3>) = off_table.partition(is_wall);
        things_m.retain(|at| !walls.iter().any(|wall| wall.is_behind(*at)));
        // Things hide parts of walls.
        let faces_m: Vec<Vec3> = walls.iter().flat_map(|wall| wall.face_m(table_z_m)).collect();
        let shown = nearest(&faces_m, &walls_m, FACE_M);
        walls_m.extend(faces_m.iter().zip(shown).filter(|(_, shown)| shown.is_none()).map(|(at, _)| *at));
        let edges_m = walls.iter().chain(&board).map(|wall| wall.edge_m().to_vec());
        let edges_m = edges_m
            .chain(rim.map(|rim| rim.edge_m))
            .map(|edge| edge.iter().map(|at| at.to_array()).collect::<Vec<_>>());
        Self { things_m, walls_m, board, edges_m: edges_m.collect() }
    }
}

/// The points of the object at a point, and those of everything else but the table. Without an object near it there are
/// none of it.
pub(crate) fn object_points(cloud: &SegmentedCloud, target_m: Vec3) -> [Vec<Vec3>; 2] {
    let nearest = cloud.of_objects().min_by(|a, b| (a.0 - target_m).length().total_cmp(&(b.0 - target_m).length()));
    let chosen =
        nearest.filter(|(point_m, _)| (*point_m - target_m).length() <= TARGET_NEAR_M).map(|(_, object)| object);
    let (target, others): (Vec<_>, Vec<_>) = cloud.of_objects().partition(|(_, object)| Some(*object) == chosen);
    [target, others].map(|points| points.into_iter().map(|(point_m, _)| point_m).collect())
}

#[cfg(test)]
mod tests {
    use schema::axis_angle;

    use super::*;
    use crate::gripper_volume::WRIST_DOWN;
    use crate::{Ball, BuiltIn, Target};

    fn everything(poses: &[Pose]) -> Vec<bool> {
        vec![true; poses.len()]
    }

    fn broken(limits: &Limits, grasp: &Pose) -> Option<Limit> {
        let config = BuiltIn::Judge.config().unwrap();
        Limiter::new(limits, &config, None, Walls::default(), &|_| true, &everything).broken(&[*grasp])[0]
    }

    #[test]
    fn each_limit_refuses_what_breaks_it_and_nothing_else() {
        let down = Pose::from_parts(Vec3::new(0.1, 0.2, 0.08), WRIST_DOWN);
        let tilted = Pose::from_parts(down.translation, axis_angle(Vec3::X, 0.5) * WRIST_DOWN);
        let cone = |angle_rad_max| Some(Cone { direction: Vec3::NEG_Z, angle_rad_max });
        let approach = |angle| Limits { approach: cone(angle), ..Limits::default() };
        assert_eq!(broken(&approach(0.1), &down), None);
        assert_eq!(broken(&approach(0.49), &tilted), Some(Limit::Approach));
        assert_eq!(broken(&approach(0.51), &tilted), None);
        let reach = |low: f32| Limits { reach_m: Some([Vec3::splat(low), Vec3::splat(0.3)]), ..Limits::default() };
        assert_eq!((broken(&reach(0.07), &down), broken(&reach(0.09), &down)), (None, Some(Limit::Reach)));
        let near = |radius_m: f32| Limits {
            avoid_objects: vec![Ball { centre_m: Vec3::new(0.1, 0.17, 0.04), radius_m }],
            ..Limits::default()
        };
        assert_eq!((broken(&near(0.049), &down), broken(&near(0.051), &down)), (None, Some(Limit::AvoidObjects)));
        // The palm is 120 mm broad along the closing direction, here y: it reaches to 0.2 - 0.06.
        let wall = |y_m: f32| Plane { normal: Vec3::Y, offset_m: y_m };
        let keep_out = |y_m: f32| Limits { keep_out: vec![wall(y_m)], ..Limits::default() };
        assert_eq!((broken(&keep_out(0.135), &down), broken(&keep_out(0.145), &down)), (None, Some(Limit::KeepOut)));
        // Under a shelf: the gripper comes from 50 mm behind.
        let shelf =
            |z_m: f32| Limits { keep_out: vec![Plane { normal: Vec3::NEG_Z, offset_m: -z_m }], ..Limits::default() };
        let config = BuiltIn::Judge.config().unwrap();
        let gripper = &config.gripper;
        let top_m = 0.08 + gripper.finger_length_m + gripper.palm_length_m + 0.05;
        assert_eq!(broken(&shelf(top_m - 0.001), &down), Some(Limit::KeepOut));
        assert_eq!(broken(&shelf(top_m + 0.001), &down), None);
        let none = Limits::default();
        let left = |poses: &[Pose]| poses.iter().map(|pose| pose.translation.x < 0.1).collect();
        let is_near = |pose: &Pose| pose.translation.y < 0.3;
        let limiter = Limiter::new(&none, &config, None, Walls::default(), &is_near, &left);
        let beside = Pose::from_parts(Vec3::new(0.09, 0.2, 0.08), WRIST_DOWN);
        let far = Pose::from_parts(Vec3::new(0.09, 0.4, 0.08), WRIST_DOWN);
        assert_eq!(limiter.broken(&[far, down, beside]), [Some(Limit::Unseen), Some(Limit::Accept), None]);
        assert_eq!(limiter.rejections().as_deref(), Some("1 by unseen, 1 by accept"));
    }

    #[test]
    fn a_hand_that_touches_a_wall_is_refused_and_one_beside_it_is_not() {
        let (config, limits) = (BuiltIn::Judge.config().unwrap(), Limits::default());
        let down = Pose::from_parts(Vec3::new(0.1, 0.2, 0.08), WRIST_DOWN);
        // Points from the fingers up to the palm, which is 120 mm broad along y.
        let wall = |y_m: f32| -> Vec<Vec3> {
            let at = |n: u8| Vec3::new(0.05 + 0.004 * f32::from(n % 25), y_m, 0.1 + 0.008 * f32::from(n / 25));
            (0..250).map(at).collect()
        };
        let thing_m = vec![Vec3::new(0.1, 0.2, 0.09)];
        let found = |things_m: &[Vec3], walls_m: Vec<Vec3>| {
            let walls = Walls { things_m: things_m.to_vec(), walls_m, ..Walls::default() };
            let limiter = Limiter::new(&limits, &config, None, walls, &|_| true, &everything);
            (limiter.broken(&[down])[0], limiter.rejections())
        };
        assert_eq!(found(&thing_m, wall(0.265)), (None, None));
        let refused = (Some(Limit::Walls), Some("1 by walls".to_owned()));
        assert_eq!(found(&thing_m, wall(0.255)), refused, "the palm touches it");
        assert_eq!(found(&thing_m, wall(0.22)), refused, "it is between the fingers");
        assert_eq!(found(&[], wall(0.265)), refused, "it closes on nothing");
        assert_eq!(found(&[], Vec::new()), (None, None), "there is no container");
    }

    #[test]
    fn a_hand_that_leaves_through_a_board_is_refused_if_the_board_was_seen() {
        let (config, limits) = (BuiltIn::Judge.config().unwrap(), Limits::default());
        let down = Pose::from_parts(Vec3::new(0.1, 0.2, 0.08), WRIST_DOWN);
        // The palm's upper side is 90 mm over the tips, and goes up by 100 mm.
        let found = |bottom_m: f32, is_seen: bool| {
            let (inward, ends_m) = (schema::Vec2::Y, [-0.3, 0.3]);
            let edge = Wall { inward, offset_m: 0.05, ends_m, top_m: bottom_m, bottom_m, slope: 0.0, is_seen };
            let (things_m, walls_m) = (vec![Vec3::new(0.1, 0.2, 0.09)], vec![Vec3::splat(1.0)]);
            let walls = Walls { things_m, walls_m, board: Some(edge), ..Walls::default() };
            let limiter = Limiter::new(&limits, &config, None, walls, &|_| true, &everything);
            (limiter.broken(&[down])[0], limiter.may_have_board(), limiter.meets_board(&down))
        };
        assert_eq!(found(0.25, true), (Some(Limit::Walls), false, true));
        assert_eq!(found(0.25, false), (None, true, true), "nobody knows");
        assert_eq!(found(0.30, true), (None, false, false), "it is higher");
    }

    #[test]
    fn a_hand_holds_the_target_if_most_between_its_fingers_is_of_it() {
        let config = BuiltIn::Judge.config().unwrap();
        let target = Target::Point(Vec3::ZERO);
        let limits = Limits { target: Some(target), ..Limits::default() };
        let down = Pose::from_parts(Vec3::new(0.1, 0.2, 0.08), WRIST_DOWN);
        let (here, there) = (Vec3::new(0.1, 0.2, 0.09), Vec3::new(0.1, 0.23, 0.1));
        let cases = [
            ([vec![here], vec![]], None),
            ([vec![], vec![here]], Some(Limit::Target)),
            ([vec![here], vec![there, there]], Some(Limit::Target)),
            ([vec![here; 2], vec![there; 2]], None),
            ([vec![Vec3::new(0.2, 0.2, 0.09)], vec![]], Some(Limit::Target)),
        ];
        for (points, expected) in cases {
            let limiter =
                Limiter::new(&limits, &config, Some(points.clone()), Walls::default(), &|_| true, &everything);
            assert_eq!(limiter.broken(&[down]), [expected], "{points:?}");
            assert_eq!(limiter.rejections(), expected.map(|_| "1 by target".to_owned()));
        }
    }
}
