//! A scene's rows from its number: objects, rest, views, TSDF, candidates, attempts.

use std::ops::ControlFlow;

use perception::{Sensor, SensorParams, Tsdf, camera_at, draw_kind};
use schema::{
    AttemptRecord, Container, Intrinsics, ObjectRecord, Purpose, SceneRecord, SceneRejections, SceneRows, Stream, View,
    VoxelGrid,
};
use simulator::{AttemptWorld, Execution, Scene, SceneObject, SceneRays, Settled, Unsettled, settle, settle_again};

use crate::candidates::Candidate;
use crate::config::Config;
use crate::containers::{draw_container, in_front, room_m};
use crate::mixture::{Observed, Source, displaced, sources};
use crate::objects::draw_drops;
use crate::packed::draw_packed;
use crate::robustness::Repeats;

/// Why there is no scene.
#[derive(Debug, thiserror::Error, Clone, Copy, PartialEq, Eq)]
pub enum NoScene {
    /// Every try was rejected.
    #[error(
        "scene {scene_id} was rejected {tries} times ({} unsettled, {} empty, {} unstable); \
         the limit is settle.tries_max = {tries}",
        .rejections.unsettled, .rejections.empty, .rejections.unstable
    )]
    Rejected {
        /// The scene.
        scene_id: u64,
        /// Tries.
        tries: u32,
        /// Why each failed.
        rejections: SceneRejections,
    },
    /// Cancelled by the caller.
    #[error("the scene was abandoned")]
    Abandoned,
}

/// A part of the work on a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Dropping objects that do not come to rest: a scene that is thrown away.
    Rejected,
    /// Dropping objects until they rest.
    Settled,
    /// Depth and TSDF of all views.
    Observed,
    /// Drawing candidates, and making the scene ready for attempts.
    Prepared,
    /// One attempt.
    Attempted,
}

/// Makes the rows of scene `scene_id` with `attempt_count` attempts: a pure function of its arguments.
///
/// # Errors
/// [`NoScene`] if no try came to rest.
pub fn make_scene(config: &Config, scene_id: u64, attempt_count: u32) -> Result<SceneRows, NoScene> {
    make_scene_watched(config, scene_id, attempt_count, &mut |_| ControlFlow::Continue(()))
}

/// [`make_scene`], which also tells when each stage ends, and abandons the scene if `on_stage` breaks.
///
/// # Errors
/// [`NoScene`] if no try came to rest, or the scene was abandoned.
pub fn make_scene_watched(
    config: &Config,
    scene_id: u64,
    attempt_count: u32,
    on_stage: &mut dyn FnMut(Stage) -> ControlFlow<()>,
) -> Result<SceneRows, NoScene> {
    let mut ended = |stage: Stage| match on_stage(stage) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(NoScene::Abandoned),
    };
    let container = draw_container(&config.container, config.seed, scene_id);
    let (settled, dropped_count, rejections) =
        settled_scene(config, scene_id, container.as_ref(), &mut || ended(Stage::Rejected))?;
    ended(Stage::Settled)?;

    let objects = object_records(config, scene_id, &settled.scene);
    // The attempts run on the rows, as they are stored.
    let scene =
        Scene::from_records(config.grid.table_z_m, settled.scene.fixtures, &objects, config.objects.catalogue.bodies());
    let mut views_stream = Stream::new(config.seed, scene_id, Purpose::Views, 0);
    let views = draw_kind(&config.views, &config.view_kinds, &config.grid, &mut views_stream);
    let views = in_front(container.as_ref(), views);
    let rays = SceneRays::new(&scene);
    let tsdf = observe(config, scene_id, &rays, &views);
    ended(Stage::Observed)?;

    let mut candidates_stream = Stream::new(config.seed, scene_id, Purpose::Candidates, 0);
    let count = attempt_count as usize;
    let observed = Observed { config, scene: &scene, objects: &objects, rays: &rays, views: &views, tsdf: &tsdf };
    let mut candidates = Vec::with_capacity(count);
    for (source, count) in sources(config, count) {
        candidates.extend(observed.draw(source, count, &mut candidates_stream));
    }
    if candidates.is_empty() {
        // Nothing was proposed and nothing else is wanted.
        candidates = observed.draw(Source::Normals, count, &mut candidates_stream);
    }
    let (physics, gripper, procedure) = (&config.physics, config.gripper.of_scene(scene_id), &config.procedure);
    let world = AttemptWorld::new(physics, gripper, procedure, &scene);
    for candidate in &mut candidates {
        let beside = world.beside_fixed_jaw(&candidate.workspace_from_grasp, candidate.object_id);
        candidate.workspace_from_grasp = beside;
    }
    let robustness = config.robustness.as_ref();
    let repeats = Repeats::of_scene(robustness, config.seed, scene_id, physics, gripper, procedure, &scene);
    ended(Stage::Prepared)?;

    let mut execute = |(candidate, attempt_id): (&Candidate, u32)| {
        let execution = world.execute(&candidate.workspace_from_grasp, candidate.object_id);
        let mut record = attempt_record(scene_id, attempt_id, candidate, &execution);
        record.robustness = repeats.as_ref().and_then(|repeats| repeats.robustness(&record));
        ended(Stage::Attempted)?;
        Ok::<_, NoScene>(record)
    };
    let mut attempts: Vec<AttemptRecord> = candidates.iter().zip(0..).map(&mut execute).collect::<Result<_, _>>()?;
    // What is missing of the proposals where few were found is displaced, too.
    let displaced = displaced(config, &attempts, count - attempts.len(), scene_id);
    for placed in displaced.iter().zip(attempts.len() as u32..) {
        attempts.push(execute(placed)?);
    }

    let scene = SceneRecord {
        scene_id,
        dropped_count,
        object_count: objects.len() as u32,
        attempt_count,
        settle_time_s: settled.settle_time_s,
        rejections,
        views,
        tsdf: tsdf.values,
        container,
    };
    Ok(SceneRows { scene, objects, attempts })
}

/// A scene at rest, the number of objects dropped, and the tries before, at each of which `on_rejected` is called.
fn settled_scene(
    config: &Config,
    scene_id: u64,
    container: Option<&Container>,
    on_rejected: &mut dyn FnMut() -> Result<(), NoScene>,
) -> Result<(Settled, u32, SceneRejections), NoScene> {
    let mut rejections = SceneRejections::default();
    let Config { objects, grid, seed, physics, settle: params, .. } = config;
    let span_m = span_m(config, scene_id);
    let (room_m, fixtures) =
        (room_m(container, objects.side_m(grid)), container.map_or_else(Vec::new, |it| it.parts(grid)));
    for attempt in 0..params.tries_max {
        let (drops, settled) = match packed_scene(config, container, span_m, scene_id, attempt) {
            // In a low shelf there may be a place for none.
            Some(placed) if placed.is_empty() => (placed, Err(Unsettled::Empty)),
            Some(placed) => {
                let settled = settle_again(physics, params, grid, &fixtures, &placed);
                (placed, settled)
            }
            None => {
                let drops = draw_drops(objects, grid, room_m, span_m, *seed, scene_id, attempt);
                let settled = settle(physics, params, grid, &fixtures, &drops);
                (drops, settled)
            }
        };
        match settled {
            Ok(settled) => return Ok((settled, drops.len() as u32, rejections)),
            Err(Unsettled::Moving { .. }) => rejections.unsettled += 1,
            Err(Unsettled::Empty) => rejections.empty += 1,
            Err(Unsettled::Unstable) => rejections.unstable += 1,
        }
        on_rejected()?;
    }
    Err(NoScene::Rejected { scene_id, tries: params.tries_max, rejections })
}

/// Objects that are wider than this are drawn anew.
fn span_m(config: &Config, scene_id: u64) -> f32 {
    let drawn = Stream::new(config.seed, scene_id, Purpose::Spanned, 0).uniform(0.0, 1.0);
    if drawn < config.spanned_share { config.gripper.of_scene(scene_id).span_m() } else { f32::INFINITY }
}

/// The objects of a scene that is packed, if it is one of those.
fn packed_scene(
    config: &Config,
    container: Option<&Container>,
    span_m: f32,
    scene_id: u64,
    attempt: u32,
) -> Option<Vec<SceneObject>> {
    let (packed, objects) = (config.packed.as_ref()?, &config.objects);
    // Whether a scene is packed does not depend on the tries.
    let is_packed = Stream::new(config.seed, scene_id, Purpose::Packed, 0).uniform(0.0, 1.0) < packed.share;
    let mut stream = Stream::new(config.seed, scene_id, Purpose::Packed, 1 + attempt);
    let count = *stream.weighted(&objects.counts, &objects.count_weights);
    is_packed.then(|| draw_packed(objects, packed, &config.grid, container, span_m, count, &mut stream))
}

/// The TSDF of a scene from its views.
fn observe(config: &Config, scene_id: u64, rays: &SceneRays, views: &[View]) -> VoxelGrid {
    let mut tsdf = Tsdf::new(config.grid, config.tsdf.truncation_voxels);
    let lens = config.camera.intrinsics();
    let cameras = views.iter().map(|view| camera_at(view, &config.grid, lens));
    match &config.sensor {
        // A ray is cast only for pixels onto which a voxel projects.
        None => cameras.for_each(|camera| {
            let seen = rays.seen_from(&camera);
            tsdf.integrate_lines(&camera, |pixels, depths_m| seen.depths_at(pixels, depths_m));
        }),
        Some(params) => {
            let mut sensor = sensor(params, config.seed, scene_id, &lens);
            cameras.for_each(|camera| {
                let image = sensor.image(&camera, |real| rays.render(real));
                let image = sensor.corrected(image, &camera, &config.grid);
                tsdf.integrate(&camera, |pixel| image.at(pixel));
            });
        }
    }
    tsdf.to_voxels()
}

/// The sensor of a scene of a dataset.
pub(crate) fn sensor<'a>(params: &'a SensorParams, seed: u64, scene_id: u64, lens: &Intrinsics) -> Sensor<'a> {
    Sensor::draw(params, lens.fx_px, Stream::new(seed, scene_id, Purpose::DepthNoise, 0))
}

fn object_records(config: &Config, scene_id: u64, scene: &Scene) -> Vec<ObjectRecord> {
    scene
        .objects
        .iter()
        .zip(0..)
        .map(|(object, object_id)| ObjectRecord {
            scene_id,
            object_id,
            shape: config.objects.catalogue.shape_of(&object.body),
            mass_kg: object.mass_kg,
            friction: object.friction,
            workspace_from_object: object.workspace_from_object,
        })
        .collect()
}

fn attempt_record(scene_id: u64, attempt_id: u32, candidate: &Candidate, execution: &Execution) -> AttemptRecord {
    AttemptRecord {
        scene_id,
        attempt_id,
        object_id: candidate.object_id as u32,
        rule: candidate.rule,
        closing: candidate.closing,
        tilt_rad: candidate.tilt_rad,
        turn_rad: candidate.turn_rad,
        depth_m: candidate.depth_m,
        slide_m: candidate.slide_m,
        workspace_from_grasp: candidate.workspace_from_grasp,
        outcome: execution.outcome,
        hit: execution.hit.map(|hit| hit.kind),
        hit_object_id: execution.hit.and_then(|hit| hit.object_id).map(|id| id as u32),
        width_m: execution.width_m,
        robustness: None,
    }
}
