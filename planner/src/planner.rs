//! All stages of planning: volume, network, detections, objects, ranking.

use std::mem::take;
use std::path::Path;
use std::sync::Arc;

use grasps::{Judge, ObservedScene};
use network::{Architecture, DenseNetwork, VoxelParams, checkpoint};
use perception::{Pieces, PlaneParams};
use program::Failure;
use schema::{Grid, Lattice, Plane, Pose, Purpose, Stream, Vec3, VoxelGrid};

use crate::config::{BuiltIn, Config, Policy};
use crate::doubt::{Doubt, Doubts, cuts};
use crate::frame::{self, FoundTable};
use crate::gripper_volume::GripperVolume;
use crate::input::{InputError, read_file, refuse};
use crate::limits::{Limiter, Walls, WillDo, near_points, object_points, seen_points};
use crate::method::{Candidates, Method, Request, Stage};
use crate::objects::{each_first, tell};
use crate::observation::{Observation, PlanOptions, Target};
use crate::plan::{DroppedCandidate, FORMAT, Funnel, Plan, RankedGrasp, RejectReason, SegmentedCloud};
use crate::segment::{Segments, segment};
use crate::steady::put_first;
use crate::timing::{Timings, timed};
use crate::volume::fuse;
use crate::voxel::VoxelMethod;
use crate::width::Widths;
use crate::{plausible, rank};

/// A network's file, and its path in the source tree.
type Weights = (&'static [u8], &'static str);

/// The built-in networks for some settings, of which the first that answers for a gripper is taken: those of a single
/// one, then that of many.
fn weights(named: BuiltIn) -> &'static [Weights] {
    match named {
        BuiltIn::Judge => &[
            (include_bytes!("../../models/judge.safetensors"), "models/judge.safetensors"),
            (include_bytes!("../../models/judge-so-101.safetensors"), "models/judge-so-101.safetensors"),
            (include_bytes!("../../models/judge-any-jaw.safetensors"), "models/judge-any-jaw.safetensors"),
        ],
        BuiltIn::Paper => {
            &[(include_bytes!("../../models/paper-closings.safetensors"), "models/paper-closings.safetensors")]
        }
        BuiltIn::Vgn => &[(include_bytes!("../../models/vgn.safetensors"), "models/vgn.safetensors")],
    }
}

/// The warning if another gripper is asked for than the one that a built-in network's settings have, for which alone it
/// was trained.
fn other_gripper(config: &Config) -> Result<Option<String>, Failure> {
    let own = config.network.config()?.gripper;
    let (network, name, given) = (config.network.name(), &own.name, &config.gripper.name);
    Ok((own.numbers() != config.gripper.numbers()).then(|| {
        format!(
            "the network {network} was trained for the gripper {name}, not for {given}: its widths and qualities are those of {name}"
        )
    }))
}

/// A network and settings, ready to plan. Planning does not change it.
#[derive(Debug, Clone)]
pub struct Planner {
    method: Arc<dyn Method>,
    /// SHA-256 of the network's file.
    pub model_id: String,
    /// The settings.
    pub config: Config,
    /// The workspace that the network was trained in: that of requests that want no other.
    pub grid: Grid,
    /// A warning for every plan.
    pub(crate) warning: Option<String>,
}

impl Planner {
    /// A planner with the network of a checkpoint's file.
    ///
    /// # Errors
    /// If the file cannot be read or is no checkpoint of this network.
    pub fn new(model: &Path, config: Config) -> Result<Self, Failure> {
        Self::from_bytes(&read_file(model)?, model, config)
    }

    /// A planner with the weights that come with the program for these settings and this gripper (`models/`).
    ///
    /// # Errors
    /// If no judge was trained for the settings' gripper.
    pub fn built_in(config: Config) -> Result<Self, Failure> {
        let warning = if config.network == BuiltIn::Judge { None } else { other_gripper(&config)? };
        let of = |(file, path): &Weights| Self::from_bytes(file, Path::new(path), config.clone());
        let (last, others) = weights(config.network).split_last().expect("each has one");
        let made = others.iter().find_map(|one| of(one).ok()).map_or_else(|| of(last), Ok)?;
        Ok(Self { warning, ..made })
    }

    fn from_bytes(file: &[u8], path: &Path, mut config: Config) -> Result<Self, Failure> {
        // Judges learned with fingers that are as thick at their tips, and their grasps are better where such are asked
        // about: beside rims a gripper with thin tips may stand where it presses on one side only.
        config.gripper.finger_tip = None;
        let checkpoint = checkpoint::from_bytes(file, path)?;
        let (needed, got) = (config.network.network_kind(), checkpoint.architecture.kind());
        if got != needed {
            let what =
                format!("{}: network = \"{}\" of the settings (--config)", path.display(), config.network.name());
            return Err(got.refused(&what, needed));
        }
        let method: Arc<dyn Method> = match &checkpoint.architecture {
            Architecture::Voxel(VoxelParams { head, upsampling, origin }) => {
                let network = DenseNetwork::new(&checkpoint.vector, *upsampling, *head);
                Arc::new(VoxelMethod { network, origin: *origin })
            }
            Architecture::Judge(_) => Arc::new(Judge::new(&checkpoint, &config.gripper, &Grid::PAPER)?),
        };
        Ok(Self { method, model_id: checkpoint::digest(file), config, grid: Grid::PAPER, warning: None })
    }

    /// Plans grasps. An empty scene, or one without a good grasp, gives a plan without grasps that says why.
    ///
    /// # Errors
    /// [`InputError`] if the observation contradicts itself or the network.
    pub fn plan(&self, observation: &Observation, options: &PlanOptions) -> Result<Plan, InputError> {
        self.plan_with(observation, options, &|poses| vec![true; poses.len()])
    }

    /// The same with a limit of the caller's: whether grasps, in the workspace, will do. A judge is asked about no
    /// grasp that will not, and proposes more where few are left.
    ///
    /// # Errors
    /// As [`Self::plan`].
    pub fn plan_with(
        &self,
        observation: &Observation,
        options: &PlanOptions,
        will_do: &WillDo<'_>,
    ) -> Result<Plan, InputError> {
        if self.config.network != BuiltIn::Judge && options.workspace(&self.grid) != self.grid {
            let (name, side_m) = (self.config.network.name(), self.grid.size_m);
            return refuse(format!(
                "must be {side_m} for the network {name}, which answers for voxels: workspace_size_m"
            ));
        }
        let (seed, mut timings_ms) = (self.config.seed, Vec::new());
        let mut warnings: Vec<String> = self.warning.iter().cloned().collect();
        frame::check_object(observation, options.limits.target.as_ref())?;
        let Some(wanted) = &options.find_table else {
            let doubts = plausible::of_given(observation, options, &self.grid, seed);
            warnings.extend(doubts.iter().cloned());
            let plan = self.plan_in(observation, None, options, will_do, timings_ms, warnings);
            // A mistake may be why a cloud cannot have been seen.
            return plan.map_err(|error| doubts.iter().fold(error, |error, said| error.at(said)));
        };
        if let Some((floating, found, said)) = frame::alone(observation, wanted, &self.grid, seed)? {
            warnings.push(said);
            let moved = frame::moved(&floating, &found.workspace_from_first);
            let options = options.seen_from(found.workspace_from_first);
            return self.plan_in(&moved, Some(found), &options, will_do, timings_ms, warnings);
        }
        let found = timed(&mut timings_ms, "table", || frame::find(observation, wanted, &self.grid, seed))?;
        let moved = frame::moved(observation, &found.workspace_from_first);
        warnings.extend(plausible::of_found(observation, &moved, &found, wanted, &self.grid, seed));
        warnings.extend(found.warning());
        let options = options.seen_from(found.workspace_from_first);
        self.plan_in(&moved, Some(found), &options, will_do, timings_ms, warnings)
    }

    /// The same of an observation in the workspace, on the table that was found if it was asked for.
    fn plan_in(
        &self,
        observation: &Observation,
        table: Option<FoundTable>,
        options: &PlanOptions,
        will_do: &WillDo<'_>,
        mut timings_ms: Timings,
        mut warnings: Vec<String>,
    ) -> Result<Plan, InputError> {
        let (views, workspace) = (observation.images(), self.method.workspace(&self.config, options));
        let mut volume = timed(&mut timings_ms, "fuse", || fuse(observation, &workspace, self.config.cloud))?;
        let (rendered, table_z_m) = (take(&mut volume.rendered), volume.grid.lattice.table_z_m);
        let shown = views.unwrap_or(&rendered);
        let pieces = timed(&mut timings_ms, "pieces", || Pieces::new(&volume.points_m, table_z_m));
        let walls = match self.config.collision.walls {
            true => timed(&mut timings_ms, "walls", || Walls::among(&volume.points_m, &pieces, shown, table_z_m)),
            false => Walls::default(),
        };
        // An object that floats has no plane under it, its sides are its own, and its cloud shows nothing beside it.
        let floating = table.as_ref().is_some_and(|found| found.candidates.is_empty()).then(|| {
            let plane = PlaneParams { share_min: 1.0, ..self.config.plane };
            Config { plane, ..self.config.clone() }
        });
        let segmented = floating.as_ref().unwrap_or(&self.config);
        // Who says what is wanted means it, and a cube of voxels ends everywhere.
        let is_cube = workspace.within_m.is_none() || matches!(observation, Observation::Tsdf(_));
        let is_for_all = !is_cube && options.limits.target.is_none();
        let ends_m = volume.grid.lattice.corners_m();
        let cuts = || cuts(views.unwrap_or_default(), &volume.points_m, ends_m, table_z_m);
        let joined = if is_for_all { pieces.joined(&volume.points_m, &cuts()) } else { Vec::new() };
        let doubts = Doubts::new(&self.config.gripper, &volume.points_m, &joined, table_z_m);
        // The object at a point takes the segments; otherwise the network runs beside the segmentation.
        let mut segments = None;
        let target_points = options.limits.target.as_ref().map(|target| match target {
            Target::Point(target_m) => {
                let (cloud, _) = segments.insert(segment(take(&mut volume.points_m), segmented));
                object_points(cloud, *target_m)
            }
            Target::Masks(masks) => seen_points(&volume.points_m, shown, masks, self.grid.table_z_m),
            Target::Points(target_m) => near_points(&volume.points_m, target_m, table_z_m),
        });
        let widths = Widths::new(shown, table_z_m, &self.config.gripper);
        let in_sight = |pose: &Pose| floating.is_some() || !widths.is_out_of_sight(pose);
        let limiter = Limiter::new(&options.limits, &self.config, target_points, walls, &in_sight, will_do);
        let observed = ObservedScene {
            field: &volume.grid,
            fine: volume.fine.as_ref(),
            views: observation.views(),
            reach_m: volume.reach_m,
        };
        let request = Request { config: &self.config, options, limiter: &limiter, widths: &widths, doubts: &doubts };
        let (scene, mut segment_ms) = (scene_number(&volume.grid), Vec::new());
        let (candidates, segments) = rayon::join(
            || self.method.candidates(observed, scene, &request, &mut timings_ms),
            || {
                let segments = || segments.unwrap_or_else(|| segment(volume.points_m, segmented));
                timed(&mut segment_ms, "segment", segments)
            },
        );
        timings_ms.append(&mut segment_ms);
        let workspace_from_first = match views {
            Some(views) => views.first().map(|view| view.camera.workspace_from_camera),
            None => table.as_ref().map(|found| found.workspace_from_first),
        };
        let seen = Seen { region: volume.grid.lattice, scene, workspace_from_first, table };
        let mut plan = timed(&mut timings_ms, "rank", || self.rank(candidates, segments, seen, &request));
        warnings.extend(views.into_iter().flat_map(|views| frame::cut(views, volume.reach_m, table_z_m)));
        warnings.extend(volume.warnings);
        plan.warnings.splice(0..0, warnings);
        plan.timings_ms = timings_ms;
        Ok(plan)
    }

    fn rank(&self, mut candidates: Candidates, segments: Segments, seen: Seen, request: &Request<'_>) -> Plan {
        let (options, (cloud, mut objects)) = (request.options, segments);
        self.method.settle(&mut candidates, request);
        let (collision, found) = (&self.config.collision, candidates.grasps.len());
        if options.check_collisions.unwrap_or(collision.check) {
            let sweep = GripperVolume::swept(&self.config.gripper, collision);
            candidates.drop_where(|ranked| {
                let points = sweep.points_inside(&ranked.workspace_from_grasp, &cloud.points_m);
                (points > collision.points_max).then_some(RejectReason::Collision { points })
            });
        }
        candidates.end_stage("collision_free", format!("the gripper's way is blocked for all {found} detections"));
        let policy = options.policy.unwrap_or(self.config.ranking.policy);
        rank::attribute(&mut candidates.grasps, &cloud, &objects, &self.config.ranking);
        request.widths.measure(&mut candidates.grasps);
        candidates.drop_where(|ranked| {
            ranked.doubt = ranked.doubt.max(request.doubts.of(&ranked.workspace_from_grasp));
            (ranked.doubt == Some(Doubt::Flying)).then_some(RejectReason::Flying)
        });
        let is_any = !candidates.grasps.is_empty();
        let none_ranked = if is_any { "no grasps were asked for" } else { "all grasps hold flying points" };
        let Candidates { mut grasps, mut dropped, mut stages } = candidates;
        let chance = Stream::new(self.config.seed, seen.scene, Purpose::Ranking, 0);
        rank::order(&mut grasps, policy, chance);
        if let Some(previous) = &options.previous {
            let sure = |ranked: &RankedGrasp| if ranked.doubt.is_none() { ranked.quality } else { 0.0 };
            put_first(&mut grasps, previous, |ranked| (sure(ranked), ranked.workspace_from_grasp));
        }
        if options.each {
            each_first(&mut grasps);
        }
        let beyond = grasps.split_off(grasps.len().min(options.grasps_max.unwrap_or(usize::MAX)));
        dropped.extend(beyond.iter().map(|ranked| DroppedCandidate::new(ranked, RejectReason::BeyondLimit)));
        for (place, ranked) in grasps.iter_mut().enumerate() {
            let workspace_from_flange = self.config.gripper.target_from_flange(&ranked.workspace_from_grasp);
            let in_base = |workspace_from: Pose| options.base_from_workspace.map(|base| base * workspace_from);
            ranked.rank = place + 1;
            ranked.camera_from_grasp =
                seen.workspace_from_first.map(|first| first.inverse() * ranked.workspace_from_grasp);
            ranked.base_from_grasp = in_base(ranked.workspace_from_grasp);
            ranked.workspace_from_flange = workspace_from_flange;
            ranked.base_from_flange = workspace_from_flange.and_then(in_base);
        }
        stages.push(Stage::new("ranked", grasps.len(), none_ranked));
        dropped.sort_by(|a, b| b.quality.total_cmp(&a.quality));
        tell(&mut objects, &grasps, &dropped, &cloud, request);
        let mut plan = Plan {
            format: FORMAT,
            model: self.model_id.clone(),
            policy,
            gripper: self.config.gripper.name.clone(),
            flange_from_grasp: self.config.gripper.flange_from_grasp.map(|parts| parts.pose()),
            region: seen.region,
            workspace_from_camera: seen.workspace_from_first,
            table: seen.table,
            walls: request.limiter.edges_m().to_vec(),
            reason: grasps.is_empty().then(|| reason(&stages, &cloud)),
            grasps,
            warnings: Vec::new(),
            objects,
            cloud,
            funnel: Funnel(stages.iter().map(|stage| (stage.name, stage.count)).collect()),
            dropped: if options.explain { dropped } else { Vec::new() },
            timings_ms: Vec::new(),
        };
        plan.warnings = self.warnings(&plan);
        plan
    }

    /// The network was trained with the table at one height, so an error in the workspace's pose shows here first.
    fn misplaced_table(&self, region: &Lattice, plane: &Plane) -> Option<String> {
        let normal = plane.normal;
        let middle_m = 0.5 * region.corners_m().iter().sum::<Vec3>();
        let height_m = (plane.offset_m - normal.truncate().dot(middle_m.truncate())) / normal.z;
        let is_level = normal.z > TABLE_COS_MIN; // otherwise the plane is a wall, not a table
        (is_level && (height_m - region.table_z_m).abs() > TABLE_OFF_M_MAX).then(|| {
            format!(
                "the largest plane lies at z = {:.0} mm, the network has learnt with tables at {:.0} mm: is the workspace's frame \
                 where the cameras' poses say?",
                1000.0 * height_m,
                1000.0 * region.table_z_m
            )
        })
    }

    fn warnings(&self, plan: &Plan) -> Vec<String> {
        let mut warnings = Vec::new();
        if plan.cloud.points_m.is_empty() {
            return warnings;
        }
        // Of views their own images say more.
        let plane = plan.cloud.plane.as_ref().filter(|_| plan.workspace_from_camera.is_none());
        warnings.extend(plane.and_then(|found| self.misplaced_table(&plan.region, &found.plane)));
        if plan.policy != Policy::Paper {
            return warnings;
        }
        if plan.cloud.plane.is_none() {
            warnings.push("no plane was found: nothing was taken away before clustering".to_owned());
        }
        if plan.objects.is_empty() {
            warnings
                .push("no cluster of points is large enough for an object: grasps are ranked by quality".to_owned());
        }
        warnings
    }
}

/// What a plan says of its observation.
struct Seen {
    region: Lattice,
    /// A number that distinguishes scenes.
    scene: u64,
    /// The first camera, or the sensor of a cloud.
    workspace_from_first: Option<Pose>,
    table: Option<FoundTable>,
}

/// A table further than this from its height in training causes a warning: more than a voxel.
const TABLE_OFF_M_MAX: f32 = 0.01;
/// Cosine of the largest tilt of a table.
const TABLE_COS_MIN: f32 = 0.9;

/// Why there are no grasps: the first stage that no candidate passed.
fn reason(stages: &[Stage], cloud: &SegmentedCloud) -> String {
    if cloud.points_m.is_empty() {
        return "empty scene: no surface was seen in the workspace".to_owned();
    }
    stages.iter().find(|stage| stage.count == 0).map(|stage| stage.none.clone()).unwrap_or_default()
}

/// A number of the grid's bits: random choices differ between scenes and repeat in the same scene.
fn scene_number(grid: &VoxelGrid) -> u64 {
    fnv1a(grid.values.iter().map(|value| value.to_bits()))
}

/// FNV-1a over numbers.
pub(crate) fn fnv1a(numbers: impl Iterator<Item = impl Into<u64>>) -> u64 {
    numbers.fold(0xcbf2_9ce4_8422_2325, |sum, number| (sum ^ number.into()).wrapping_mul(0x100_0000_01b3))
}
