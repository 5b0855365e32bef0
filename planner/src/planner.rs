//! All stages of planning: volume, network, detections, objects, ranking.

use std::mem::take;
use std::path::Path;
use std::sync::OnceLock;
use std::time::Instant;

use hands::{Judge, Judged, Seen};
use network::{Architecture, DenseGrids, DenseNetwork, GraspOrigin, checkpoint};
use program::Failure;
use rayon::prelude::*;
use schema::{Grasp, Grid, Plane, Pose, Purpose, Quat, Stream, Vec3, VoxelGrid, pose_from_parts};

use crate::closing::Closer;
use crate::config::{BuiltIn, ClosingBy, Config, Policy, WithoutObject};
use crate::detect::{Detected, Detection, Side, detect};
use crate::hand::{Sweep, WRIST_DOWN, are_alike, towards_wrist};
use crate::input::{InputError, read_file, refuse};
use crate::limits::{Limiter, object_points, seen_points};
use crate::observation::{Limits, Mask, Observation, SeenView, Target, Wishes};
use crate::plan::{
    DroppedCandidate, FORMAT, Funnel, Plan, PointLabel, RankedGrasp, RejectReason, SeenObject, SegmentedCloud,
};
use crate::rank;
use crate::segment::Surface;
use crate::volume::fuse;

/// A network's file, and its path in the source tree.
type Weights = (&'static [u8], &'static str);

/// The built-in networks for some settings: one for a single hand, and one for those that it does not answer for.
fn weights(named: BuiltIn) -> (Weights, Option<Weights>) {
    match named {
        BuiltIn::Judge => (
            (include_bytes!("../../models/judge.safetensors"), "models/judge.safetensors"),
            Some((include_bytes!("../../models/judge-any-jaw.safetensors"), "models/judge-any-jaw.safetensors")),
        ),
        BuiltIn::Paper => {
            ((include_bytes!("../../models/paper-200k.safetensors"), "models/paper-200k.safetensors"), None)
        }
        BuiltIn::Vgn => ((include_bytes!("../../models/vgn.safetensors"), "models/vgn.safetensors"), None),
    }
}

/// The warning for a built-in network that answers for voxels if another hand is asked for than the one that its
/// settings have: it has no input for a hand.
fn other_hand(config: &Config) -> Result<Option<String>, Failure> {
    let own = config.network.config()?.gripper;
    if matches!(config.network, BuiltIn::Judge) || own.numbers() == config.gripper.numbers() {
        return Ok(None);
    }
    let (network, own, given) = (config.network.name(), own.name, &config.gripper.name);
    Ok(Some(format!(
        "the network {network} was trained for the hand {own}, not for {given}: its widths and qualities are those of {own}"
    )))
}

/// A network and settings, ready to plan. Planning does not change it.
#[derive(Debug, Clone)]
pub struct Planner {
    network: Network,
    /// SHA-256 of the network's file.
    pub model_id: String,
    /// The settings.
    pub config: Config,
    /// The workspace that the network was trained in: that of requests that want no other.
    pub grid: Grid,
    /// A warning for every plan.
    warning: Option<String>,
}

/// A planner, and beside it those that come with the program, for requests that name one; each is made when it is first
/// asked for.
#[derive(Debug)]
pub struct Planners {
    /// The planner of requests that name none.
    pub own: Planner,
    named: [OnceLock<Result<Planner, Failure>>; BuiltIn::ALL.len()],
}

impl Planners {
    /// The planners beside `own`.
    #[must_use]
    pub fn new(own: Planner) -> Self {
        Self { own, named: [const { OnceLock::new() }; BuiltIn::ALL.len()] }
    }

    /// The planner of a request. Its hand is always that of the own planner.
    ///
    /// # Errors
    /// If the named settings' network was not trained for that hand.
    pub fn of(&self, named: Option<BuiltIn>) -> Result<&Planner, InputError> {
        let Some(named) = named else { return Ok(&self.own) };
        let make = || {
            let gripper = self.own.config.gripper.clone();
            Planner::built_in(Config { gripper, ..named.config()? })
        };
        let made = self.named[named as usize].get_or_init(make);
        made.as_ref().map_err(|failure| InputError::Value(format!("{failure}: config")))
    }
}

/// What answers: for voxels, or for hands.
#[derive(Debug, Clone)]
enum Network {
    Voxel(Box<DenseNetwork>, GraspOrigin),
    Judge(Box<Judge>),
}

impl Planner {
    /// A planner with the network of a checkpoint's file.
    ///
    /// # Errors
    /// If the file cannot be read or is no checkpoint of this network.
    pub fn new(model: &Path, config: Config) -> Result<Self, Failure> {
        Self::from_bytes(&read_file(model)?, model, config)
    }

    /// A planner with the weights that come with the program for these settings and this hand (`models/`).
    ///
    /// # Errors
    /// If no judge was trained for the settings' hand.
    pub fn built_in(config: Config) -> Result<Self, Failure> {
        let warning = other_hand(&config)?;
        let (own, others) = weights(config.network);
        let of = |(file, path): Weights| Self::from_bytes(file, Path::new(path), config.clone());
        let made = of(own).or_else(|why| others.map_or(Err(why), of))?;
        Ok(Self { warning, ..made })
    }

    fn from_bytes(file: &[u8], path: &Path, config: Config) -> Result<Self, Failure> {
        let (checkpoint, grid) = (checkpoint::from_bytes(file, path)?, Grid::PAPER);
        let (needed, got) = (config.network.network_kind(), checkpoint.architecture.kind());
        if got != needed {
            let what =
                format!("{}: network = \"{}\" of the settings (--config)", path.display(), config.network.name());
            return Err(got.refused(&what, needed));
        }
        let network = match &checkpoint.architecture {
            Architecture::Voxel(params) => Network::Voxel(Box::new(checkpoint.dense()?), params.origin),
            Architecture::Judge(_) => Network::Judge(Box::new(Judge::new(&checkpoint, &config.gripper, &grid)?)),
        };
        let model_id = checkpoint::digest(file);
        Ok(Self { network, model_id, config, grid, warning: None })
    }

    /// Plans grasps. An empty scene, or one without a good grasp, gives a plan without grasps that says why.
    ///
    /// # Errors
    /// [`InputError`] if the observation contradicts itself or the network.
    pub fn plan(&self, observation: &Observation, wishes: &Wishes) -> Result<Plan, InputError> {
        self.plan_with(observation, wishes, &|_| true)
    }

    /// The same with a limit of the caller's: whether a grasp, in the workspace, will do. A judge is asked about no
    /// hand that will not, and proposes more where few are left.
    ///
    /// # Errors
    /// As [`Self::plan`].
    pub fn plan_with(
        &self,
        observation: &Observation,
        wishes: &Wishes,
        will_do: &(dyn Fn(&Pose) -> bool + Sync),
    ) -> Result<Plan, InputError> {
        let mut timings_ms = Vec::new();
        let grid = wishes.workspace(&self.grid);
        let volume = timed(&mut timings_ms, "fuse", || fuse(observation, &grid, self.config.cloud))?;
        let mut surface = Surface::Points(volume.points_m);
        let points_m = self.target_points(observation, &mut surface, &wishes.limits)?;
        let Config { gripper, collision, .. } = &self.config;
        let limiter = Limiter::new(&wishes.limits, gripper, collision.pregrasp_distance_m, points_m, will_do);
        let seen = Seen { field: &volume.grid, fine: volume.fine.as_ref(), views: observation.views() };
        let found = self.find(seen, surface, (wishes, &limiter), &mut timings_ms);
        let mut plan = timed(&mut timings_ms, "rank", || self.rank(found, (wishes, &limiter)));
        plan.warnings.splice(0..0, self.warning.iter().cloned().chain(volume.warnings));
        plan.timings_ms = timings_ms;
        Ok(plan)
    }

    /// The points of the surface that are the target's, and the others; none if everything is wanted. The object at a
    /// point takes the segments.
    fn target_points(
        &self,
        observation: &Observation,
        surface: &mut Surface,
        limits: &Limits,
    ) -> Result<Option<[Vec<Vec3>; 2]>, InputError> {
        match (&limits.target, observation) {
            (None, _) => Ok(None),
            (Some(Target::Point(target_m)), _) => {
                let (cloud, objects) = take(surface).segmented(&self.config);
                let points_m = object_points(&cloud, *target_m);
                *surface = Surface::Segments(cloud, objects);
                Ok(Some(points_m))
            }
            (Some(Target::Seen(masks)), Observation::Views(views)) => {
                let fit = |(view, mask): (&SeenView, &Option<Mask>)| {
                    mask.as_ref().is_none_or(|mask| mask.len() == view.image.depth_m.len())
                };
                if masks.len() != views.len() || !views.iter().zip(masks).all(fit) {
                    return refuse("masks must have the sizes of their depth images, one for each view or none: mask");
                }
                Ok(Some(seen_points(surface.points_m(), views, masks, self.grid.table_z_m)))
            }
            (Some(Target::Seen(_)), _) => refuse("masks go with views: mask"),
        }
    }

    /// Runs the network and the segmentation of the cloud in parallel.
    fn find(
        &self,
        seen: Seen<'_>,
        surface: Surface,
        (wishes, limiter): (&Wishes, &Limiter<'_>),
        timings_ms: &mut Timings,
    ) -> Found {
        let (grid, mut segment_ms) = (seen.field, Vec::new());
        let scene = scene_number(grid);
        let candidates = || match &self.network {
            Network::Voxel(network, origin) => self.detections((network, *origin), grid, wishes, timings_ms),
            Network::Judge(judge) => {
                let mut stream = Stream::new(self.config.seed, scene, Purpose::Proposals, 0);
                // As dense in a larger workspace as in the network's.
                let areas = (grid.grid.size_m / self.grid.size_m).powi(2).max(1.0);
                let proposals = (self.config.judge.proposals as f32 * areas).round() as usize;
                // As it is offered: of a hand and its half turn the one nearer to the wrist.
                let wrist = wishes.workspace_from_wrist.unwrap_or(WRIST_DOWN);
                let is_wanted =
                    |hand: &Grasp| limiter.broken(&towards_wrist(&hand.workspace_from_grasp, wrist)).is_none();
                let hands = timed(timings_ms, "judge", || judge.hands(seen, proposals, &mut stream, &is_wanted));
                self.judged(&grid.grid, &hands, wishes)
            }
        };
        let objects = || timed(&mut segment_ms, "segment", || surface.segmented(&self.config));
        let (candidates, (cloud, objects)) = rayon::join(candidates, objects);
        timings_ms.append(&mut segment_ms);
        Found { grid: grid.grid, scene, candidates, cloud, objects }
    }

    /// VGN's detections, with the grasps that the paper's network predicts there.
    fn detections(
        &self,
        (network, origin): (&DenseNetwork, GraspOrigin),
        VoxelGrid { grid, values }: &VoxelGrid,
        wishes: &Wishes,
        timings_ms: &mut Timings,
    ) -> Candidates {
        let grids = timed(timings_ms, "network", || network.infer_over(grid.resolution, values));
        let detected: Detected = timed(timings_ms, "detect", || {
            let sigmoid = |logit: &f32| 1.0 / (1.0 + libm::expf(-logit));
            let quality: Vec<f32> = grids.quality_logit.iter().map(sigmoid).collect();
            let asked = (Side::of(origin), &self.config.detection);
            detect(grid, values, &quality, &grids.width_voxels, asked)
        });
        let misses = if wishes.explain { detected.misses(grid, &self.config.detection) } else { Vec::new() };
        let grasp_at = |detection: &Detection| grasp_at(grid, detection, (&grids, origin), wishes);
        let missed = |(miss, reason)| DroppedCandidate::new(&grasp_at(&miss), reason);
        Candidates {
            grasps: detected.found.iter().map(grasp_at).collect(),
            dropped: misses.into_iter().map(missed).collect(),
            funnel: detected.funnel,
            quality_best: detected.quality_best,
        }
    }

    /// Of judged hands, best first, those that reach ε and are apart from better ones.
    fn judged(&self, grid: &Grid, hands: &[Judged], wishes: &Wishes) -> Candidates {
        let wrist = wishes.workspace_from_wrist.unwrap_or(WRIST_DOWN);
        let (epsilon, apart_m) = (self.config.detection.quality_min, self.config.judge.apart_m);
        let (mut grasps, mut kept, mut dropped, mut reached) = (Vec::new(), Vec::<&Judged>::new(), Vec::new(), 0);
        for judged in hands {
            let tips_m = judged.hand.workspace_from_grasp.translation;
            let inside_m = tips_m.clamp(Vec3::ZERO, Vec3::splat(grid.size_m * (1.0 - f32::EPSILON)));
            let grasp = RankedGrasp {
                rank: 0,
                workspace_from_grasp: towards_wrist(&judged.hand.workspace_from_grasp, wrist),
                base_from_grasp: None,
                workspace_from_flange: None,
                base_from_flange: None,
                width_m: judged.hand.width_m,
                quality: judged.quality(),
                object: None,
                rho_m: None,
                voxel: grid.voxel_at(inside_m).unwrap_or_default(),
            };
            let reason = if grasp.quality < epsilon {
                let (outcome, probability) = judged.likeliest();
                Some(RejectReason::Judged { outcome, probability })
            } else {
                reached += 1;
                if is_avoided(&grasp.workspace_from_grasp, wishes) {
                    Some(RejectReason::Avoided)
                } else {
                    kept.iter().any(|better| better.is_near(judged, apart_m)).then_some(RejectReason::Suppressed)
                }
            };
            match reason {
                Some(reason) => dropped.push(DroppedCandidate::new(&grasp, reason)),
                None => {
                    grasps.push(grasp);
                    kept.push(judged);
                }
            }
        }
        let (voxels, proposed, detections) = (grid.len(), hands.len(), grasps.len());
        let funnel = Funnel {
            voxels,
            near_surface: proposed,
            width_within_limits: proposed,
            quality_reached: reached,
            detections,
            ..Funnel::default()
        };
        Candidates { grasps, dropped, funnel, quality_best: hands.first().map_or(0.0, Judged::quality) }
    }

    fn rank(&self, found: Found, (wishes, limiter): (&Wishes, &Limiter<'_>)) -> Plan {
        let Found {
            grid,
            scene,
            candidates: Candidates { mut grasps, mut dropped, mut funnel, quality_best },
            cloud,
            objects,
        } = found;
        if self.config.detection.closing == ClosingBy::Seen && matches!(self.network, Network::Voxel(..)) {
            self.close(&mut grasps, &cloud, wishes, &mut dropped);
        }
        drop_where(&mut grasps, &mut dropped, |ranked| {
            is_avoided(&ranked.workspace_from_grasp, wishes).then_some(RejectReason::Avoided)
        });
        if matches!(self.network, Network::Voxel(..)) {
            drop_where(&mut grasps, &mut dropped, |ranked| {
                limiter.broken(&ranked.workspace_from_grasp).map(|limit| RejectReason::Limited { limit })
            });
        }
        let limited = limiter.told();
        funnel.hands_found = grasps.len();
        let collision = &self.config.collision;
        if wishes.check_collisions.unwrap_or(collision.check) {
            let sweep = Sweep::new(&self.config.gripper, collision);
            drop_where(&mut grasps, &mut dropped, |ranked| {
                let points = sweep.points_hit(&ranked.workspace_from_grasp, &cloud.points_m);
                (points > collision.points_max).then_some(RejectReason::Collision { points })
            });
        }
        funnel.collision_free = grasps.len();
        let policy = wishes.policy.unwrap_or(self.config.ranking.policy);
        rank::attribute(&mut grasps, &cloud, &objects, &self.config.ranking);
        drop_where(&mut grasps, &mut dropped, |ranked| {
            rank::is_left_out(ranked, policy, &self.config.ranking).then_some(RejectReason::NoObject)
        });
        rank::order(&mut grasps, policy, Stream::new(self.config.seed, scene, Purpose::Ranking, 0));
        let beyond = grasps.split_off(grasps.len().min(wishes.grasps_max.unwrap_or(usize::MAX)));
        dropped.extend(beyond.iter().map(|ranked| DroppedCandidate::new(ranked, RejectReason::BeyondLimit)));
        for (place, ranked) in grasps.iter_mut().enumerate() {
            let workspace_from_flange = self.config.gripper.target_from_flange(&ranked.workspace_from_grasp);
            let in_base = |workspace_from: Pose| wishes.base_from_workspace.map(|base| base * workspace_from);
            ranked.rank = place + 1;
            ranked.base_from_grasp = in_base(ranked.workspace_from_grasp);
            ranked.workspace_from_flange = workspace_from_flange;
            ranked.base_from_flange = workspace_from_flange.and_then(in_base);
        }
        funnel.ranked = grasps.len();
        dropped.sort_by(|a, b| b.quality.total_cmp(&a.quality));
        let avoided = dropped.iter().filter(|candidate| candidate.reason == RejectReason::Avoided).count();
        let mut plan = Plan {
            format: FORMAT,
            model: self.model_id.clone(),
            policy,
            gripper: self.config.gripper.name.clone(),
            flange_from_grasp: self.config.gripper.flange_from_grasp.map(|parts| parts.pose()),
            grid,
            grasps,
            reason: None,
            warnings: Vec::new(),
            objects,
            cloud,
            funnel,
            dropped: if wishes.explain { dropped } else { Vec::new() },
            timings_ms: Vec::new(),
        };
        plan.reason = plan.grasps.is_empty().then(|| self.reason(&plan, (quality_best, avoided, limited), wishes));
        plan.warnings = self.warnings(&plan);
        plan
    }

    /// Closes each hand on what was seen; grasps of which none closes are dropped.
    fn close(
        &self,
        grasps: &mut Vec<RankedGrasp>,
        cloud: &SegmentedCloud,
        wishes: &Wishes,
        dropped: &mut Vec<DroppedCandidate>,
    ) {
        let Config { gripper, collision, .. } = &self.config;
        let things = cloud.points_m.iter().zip(&cloud.labels).filter(|(_, label)| **label != PointLabel::Plane);
        let closer = Closer::new(gripper, collision, &cloud.points_m, things.map(|(point, _)| *point).collect());
        let hands: Vec<Option<Grasp>> =
            grasps.par_iter().map(|ranked| closer.closed(&ranked.workspace_from_grasp)).collect();
        let wrist = wishes.workspace_from_wrist.unwrap_or(WRIST_DOWN);
        let mut hands = hands.into_iter();
        drop_where(grasps, dropped, |ranked| {
            let Some(hand) = hands.next().flatten() else { return Some(RejectReason::NoClosing) };
            ranked.workspace_from_grasp = towards_wrist(&hand.workspace_from_grasp, wrist);
            ranked.width_m = hand.width_m;
            None
        });
    }

    /// Why there are no grasps: the first stage that no candidate passed.
    fn reason(
        &self,
        plan: &Plan,
        (quality_best, avoided, limited): (f32, usize, Option<String>),
        wishes: &Wishes,
    ) -> String {
        let (params, funnel) = (&self.config.detection, &plan.funnel);
        if wishes.grasps_max == Some(0) {
            "no grasps were asked for".to_owned()
        } else if plan.cloud.points_m.is_empty() {
            "empty scene: no surface was seen in the workspace".to_owned()
        } else if let (true, Some(told)) = (funnel.near_surface == 0 || funnel.hands_found == 0, &limited) {
            format!("no hand keeps the limits that were asked for: {told}")
        } else if funnel.near_surface == 0 && matches!(self.network, Network::Judge(_)) {
            "no collision-free grasp candidate was found on the observed surface".to_owned()
        } else if funnel.near_surface == 0 {
            "no voxel on the grasps' side of a surface was seen".to_owned()
        } else if funnel.width_within_limits == 0 {
            let (low, high) = (params.width_voxels_min, params.width_voxels_max);
            format!("no grasp has a width between {low} and {high} voxels")
        } else if funnel.quality_reached == 0 {
            // Rounded down, so that 0.8997 does not become 0.9.
            let best = (quality_best * 1e3).floor() * 1e-3;
            format!("no grasp has a quality of {} or more: the best has {best:.3}", params.quality_min)
        } else if avoided > 0 && funnel.hands_found == 0 {
            format!("all {avoided} grasps are like hands that failed")
        } else if funnel.hands_found == 0 {
            format!("no collision-free grasp at any of the {} detections", funnel.detections)
        } else if funnel.collision_free == 0 {
            format!("the hand's way is blocked for all {} detections", funnel.detections)
        } else if plan.objects.is_empty() {
            "no cluster of points is large enough for an object, and grasps without one are dropped".to_owned()
        } else {
            "no grasp belongs to an object, and others are dropped".to_owned()
        }
    }

    /// The network was trained with the table at one height, so an error in the workspace's pose shows here first.
    fn misplaced_table(&self, grid: &Grid, plane: &Plane) -> Option<String> {
        let normal = plane.normal;
        let middle = 0.5 * grid.size_m;
        let height_m = (plane.offset_m - middle * (normal.x + normal.y)) / normal.z;
        let is_level = normal.z > TABLE_COS_MIN; // otherwise the plane is a wall, not a table
        (is_level && (height_m - grid.table_z_m).abs() > TABLE_OFF_M_MAX).then(|| {
            format!(
                "the largest plane lies at z = {:.0} mm, the network has learnt with tables at {:.0} mm: is the workspace's frame \
                 where the cameras' poses say?",
                1000.0 * height_m,
                1000.0 * grid.table_z_m
            )
        })
    }

    fn warnings(&self, plan: &Plan) -> Vec<String> {
        let mut warnings = Vec::new();
        if plan.cloud.points_m.is_empty() {
            return warnings;
        }
        warnings.extend(plan.cloud.plane.as_ref().and_then(|found| self.misplaced_table(&plan.grid, &found.plane)));
        if plan.policy != Policy::Paper {
            return warnings;
        }
        if plan.cloud.plane.is_none() {
            warnings.push("no plane was found: nothing was taken away before clustering".to_owned());
        }
        if plan.objects.is_empty() && self.config.ranking.without_object == WithoutObject::Last {
            warnings
                .push("no cluster of points is large enough for an object: grasps are ranked by quality".to_owned());
        }
        warnings
    }
}

/// A table further than this from its height in training causes a warning: more than a voxel.
const TABLE_OFF_M_MAX: f32 = 0.01;
/// Cosine of the largest tilt of a table.
const TABLE_COS_MIN: f32 = 0.9;

/// What the network and the segmentation found.
struct Found {
    /// The workspace.
    grid: Grid,
    /// A number that distinguishes scenes.
    scene: u64,
    candidates: Candidates,
    cloud: SegmentedCloud,
    objects: Vec<SeenObject>,
}

/// Grasps that reach ε, and the others if requested.
struct Candidates {
    grasps: Vec<RankedGrasp>,
    dropped: Vec<DroppedCandidate>,
    funnel: Funnel,
    quality_best: f32,
}

/// The grasp that the network predicts in a voxel, turned towards the wrist.
fn grasp_at(
    grid: &Grid,
    detection: &Detection,
    (grids, origin): (&DenseGrids, GraspOrigin),
    wishes: &Wishes,
) -> RankedGrasp {
    let Detection { voxel, quality } = *detection;
    let (flat, count) = (grid.flat(voxel), grid.len());
    let [x, y, z, w] = [0, 1, 2, 3].map(|part| grids.rotation[part * count + flat]);
    let rotation = Quat::from_xyzw(x, y, z, w).normalize();
    let workspace_from_grasp = pose_from_parts(rotation, origin.tips_m(voxel, rotation, grid));
    RankedGrasp {
        rank: 0,
        workspace_from_grasp: towards_wrist(&workspace_from_grasp, wishes.workspace_from_wrist.unwrap_or(WRIST_DOWN)),
        base_from_grasp: None,
        workspace_from_flange: None,
        base_from_flange: None,
        width_m: grids.width_voxels[flat] * grid.voxel_size_m(),
        quality,
        object: None,
        rho_m: None,
        voxel,
    }
}

/// Whether a grasp is like a hand that failed.
fn is_avoided(workspace_from_grasp: &Pose, wishes: &Wishes) -> bool {
    wishes.avoid.iter().any(|failed| are_alike(failed, workspace_from_grasp))
}

/// Moves grasps with a reason to drop them from one list to the other.
fn drop_where(
    grasps: &mut Vec<RankedGrasp>,
    dropped: &mut Vec<DroppedCandidate>,
    mut reason: impl FnMut(&mut RankedGrasp) -> Option<RejectReason>,
) {
    grasps.retain_mut(|ranked| {
        let reason = reason(ranked);
        dropped.extend(reason.map(|reason| DroppedCandidate::new(ranked, reason)));
        reason.is_none()
    });
}

/// FNV-1a over the grid's bits: random choices differ between scenes and repeat in the same scene.
fn scene_number(grid: &VoxelGrid) -> u64 {
    let bits = grid.values.iter().map(|value| u64::from(value.to_bits()));
    bits.fold(0xcbf2_9ce4_8422_2325, |sum, bits| (sum ^ bits).wrapping_mul(0x100_0000_01b3))
}

/// Stages and their times in milliseconds.
pub(crate) type Timings = Vec<(&'static str, f64)>;

/// Runs a stage and adds its time.
pub(crate) fn timed<T>(timings_ms: &mut Timings, stage: &'static str, run: impl FnOnce() -> T) -> T {
    let began = Instant::now();
    let result = run();
    timings_ms.push((stage, began.elapsed().as_secs_f64() * 1e3));
    result
}
