//! Datasets.

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};
use std::{mem, process};

use generator::{AttemptId, Config, Overrides, bodies_of, depth_images, physics_of};
use inspect::{replayed, scene_view};
use network::head::Head;
use network::upsampling::Upsampling;
use network::{GraspOrigin, VoxelParams};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use program::{ExitCode, Failure};
use pyo3::prelude::*;
use pyo3::types::{PyCapsule, PyDict};
use schema::{
    AttemptRecord, CameraParams, DepthImage, HitKind, Intrinsics, Outcome, Polyhedron, Pose, SceneRows, SettleParams,
    samples_of,
};
use shards::{Location, Table};
use simulator::Body;
use trainer::config::{SplitBy, SplitConfig};
use trainer::data::{GraspDataset, SplitBits};
use trainer::device::Device;
use trainer::judge::Judge;
use trainer::method::Method;
use trainer::split::split;
use trainer::voxel::Voxel;

use crate::crops::Crops;
use crate::fault::{array, free, raised, reserved, wrong};
use crate::pool::on_threads;
use crate::scene::{Scene, Simulation, place, rows};

/// A convex polyhedron: corners in metres, and the faces' corners by number, counter-clockwise seen from outside.
type Hull = (Vec<[f32; 3]>, Vec<Vec<usize>>);

/// A complete dataset.
#[pyclass(frozen, module = "graspmill._native")]
#[derive(Debug)]
pub(crate) struct Dataset {
    dataset: Arc<shards::Dataset>,
    /// The bodies of its models, whose hulls are computed when the first scene is asked for.
    bodies: OnceLock<Vec<Body>>,
    /// The process that opened it: the client of a store has threads, which do not outlive a fork.
    process: u32,
}

impl Drop for Dataset {
    /// In a forked child the threads of a store's client are not there, and to wait for them would take for ever: what
    /// the child has of them stays.
    fn drop(&mut self) {
        if self.is_foreign() {
            mem::forget(Arc::clone(&self.dataset));
        }
    }
}

impl Dataset {
    /// Whether it has threads of another process.
    fn is_foreign(&self) -> bool {
        self.process != process::id() && !matches!(self.dataset.location(), Location::Path(_))
    }

    /// The dataset, if this process may read it.
    fn read(&self) -> PyResult<&Arc<shards::Dataset>> {
        if !self.is_foreign() {
            return Ok(&self.dataset);
        }
        let text =
            format!("a dataset of a store must be opened again in a forked process: {}", self.dataset.location());
        Err(wrong(text))
    }

    fn bodies(&self) -> PyResult<&[Body]> {
        if let Some(bodies) = self.bodies.get() {
            return Ok(bodies);
        }
        let bodies = bodies_of(self.dataset.info()).map_err(|failure| raised(&failure))?;
        Ok(self.bodies.get_or_init(|| bodies))
    }

    /// How its objects came to rest; of datasets that do not say it, the paper's way.
    fn settle(&self) -> PyResult<SettleParams> {
        if let Some(settle) = self.dataset.info().section::<SettleParams>("settle") {
            return Ok(settle);
        }
        let paper = Config::load(None, Overrides::default()).map_err(|error| raised(&error.into()))?;
        Ok(paper.settle)
    }

    fn scene_rows(&self, py: Python<'_>, scene_id: u64) -> PyResult<SceneRows> {
        let dataset = self.read()?;
        free(py, || dataset.read_scene(scene_id))
    }
}

#[pymethods]
impl Dataset {
    /// Opens the dataset in a folder or at a URL.
    #[new]
    fn new(py: Python<'_>, path: &str) -> PyResult<Self> {
        let location = Location::parse(path).map_err(wrong)?;
        let dataset = Arc::new(free(py, || shards::Dataset::open(location))?);
        Ok(Self { dataset, bodies: OnceLock::new(), process: process::id() })
    }

    /// Its id.
    #[getter]
    fn id(&self) -> &str {
        self.dataset.id()
    }

    /// Its folder or URL.
    #[getter]
    fn location(&self) -> String {
        self.dataset.location().to_string()
    }

    /// `meta/info.json`.
    fn info(&self) -> String {
        self.dataset.info().to_json()
    }

    /// The numbers of shards, scenes and attempts, and of attempts with label 1.
    #[getter]
    fn counts(&self) -> (u32, u64, u64, u64) {
        let info = self.dataset.info();
        let held = self.dataset.manifest().shards.iter().map(|shard| shard.counts.labels.positives).sum();
        (info.shard_count, info.scene_count, info.attempt_count, held)
    }

    /// The scenes of a shard, from and to.
    fn scenes_of(&self, shard: u32) -> PyResult<(u64, u64)> {
        if shard >= self.dataset.shard_count() {
            return Err(wrong(format!("shard must be below {}, got {shard}", self.dataset.shard_count())));
        }
        let scenes = self.dataset.info().scenes_of(shard);
        Ok((scenes.start, scenes.end))
    }

    /// The rows of a table in some shards as a capsule of Arrow's C stream.
    fn stream<'py>(
        &self,
        py: Python<'py>,
        table: &str,
        from_: u32,
        to: u32,
        grids: bool,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        let tables = || Table::ALL.map(Table::name).join(", ");
        let table = Table::from_name(table)
            .ok_or_else(|| wrong(format!("table must be one of {}, got {table:?}", tables())))?;
        let stream = self.read()?.stream(table, from_..to, grids).map_err(|failure| raised(&failure))?;
        PyCapsule::new_with_value(py, stream, c"arrow_array_stream")
    }

    /// A scene: its objects at rest, the simulation of its attempts, and its rows as arrays.
    fn scene<'py>(&self, py: Python<'py>, scene_id: u64) -> PyResult<(Scene, Simulation, Bound<'py, PyDict>)> {
        let (rows_, info) = (self.scene_rows(py, scene_id)?, self.dataset.info());
        let scene = simulator::Scene::from_records(
            info.grid.table_z_m,
            rows_.scene.fixtures(&info.grid),
            &rows_.objects,
            self.bodies()?,
        );
        let simulation = Simulation {
            gripper: info.gripper_of(scene_id).clone(),
            physics: physics_of(&info.config).map_err(|failure| raised(&failure))?,
            procedure: info.procedure,
            settle: self.settle()?,
            grid: info.grid,
        };
        let found = PyDict::new(py);
        let container = rows_.scene.container.map(|container| (container, info.grid.size_m));
        let SceneRows { scene: head, attempts, .. } = rows_;
        let cameras = head.views.iter().map(|view| view.workspace_from_camera(&info.grid));
        found.set_item("workspace_from_camera", rows(py, cameras)?)?;
        found.set_item("workspace_from_grasp", rows(py, attempts.iter().map(|row| row.workspace_from_grasp))?)?;
        let side = info.grid.resolution;
        found.set_item("tsdf", array(py, head.tsdf)?.reshape([side, side, side])?)?;
        found.set_item("width_m", array(py, attempts.iter().map(width_m).collect())?)?;
        found.set_item("outcome", array(py, attempts.iter().map(|row| row.outcome as u8).collect())?)?;
        found.set_item("target", array(py, attempts.iter().map(|row| row.object_id).collect())?)?;
        let hit = |row: &AttemptRecord| row.hit.map_or(-1, |hit| place(&HitKind::ALL, &hit) as i8);
        found.set_item("hit", array(py, attempts.iter().map(hit).collect())?)?;
        let object = |row: &AttemptRecord| row.hit_object_id.map_or(-1, |id| id as i32);
        found.set_item("hit_object", array(py, attempts.iter().map(object).collect())?)?;
        let rules: Vec<&str> = attempts.iter().map(|row| row.rule.name()).collect();
        found.set_item("rule", rules)?;
        Ok((Scene { scene, container }, simulation, found))
    }

    /// The samples of some scenes of a shard, ascending, of voxels or of grasps: their grids, flat in one array; of
    /// each sample its pose (`[N, 7]`; of voxels at the network's origin) and its opening; and of each its scene's
    /// place among them, its attempt, its outcome, the number of its gripper and that of its scene's views (`[N, 5]`).
    #[expect(clippy::type_complexity, reason = "its caller in Python unpacks it")]
    fn samples<'py>(
        &self,
        py: Python<'py>,
        shard: u32,
        scenes: Vec<u64>,
        of_grasps: bool,
        origin_behind_tips_m: f32,
    ) -> PyResult<(
        Bound<'py, PyArray1<f32>>,
        Bound<'py, PyArray2<f32>>,
        Bound<'py, PyArray1<f32>>,
        Bound<'py, PyArray2<u32>>,
    )> {
        let (first, end) = self.scenes_of(shard)?;
        if !scenes.is_sorted() || scenes.iter().any(|scene| !(first..end).contains(scene)) {
            return Err(wrong(format!("scenes of shard {shard} must be ascending, from {first} to below {end}")));
        }
        let (dataset, grippers) = (self.read()?, self.dataset.info().grippers().len() as u64);
        let read = || {
            let mut grids = reserved(scenes.len() * dataset.info().grid.len())?;
            let mut samples = Vec::new();
            for (place, rows) in (0_u32..).zip(dataset.some_scenes(shard, scenes)?) {
                let SceneRows { scene, attempts, .. } = rows?;
                grids.extend(scene.tsdf);
                let (gripper, views) = ((scene.scene_id % grippers) as u32, scene.views.len() as u32);
                let own = if of_grasps { attempts } else { samples_of(&attempts) };
                samples.extend(
                    own.into_iter().map(|row| ([place, row.attempt_id, row.outcome as u32, gripper, views], row)),
                );
            }
            Ok::<_, Failure>((grids, samples))
        };
        let (grids, samples) = free(py, read)?;
        let origin = GraspOrigin::behind_tips(if of_grasps { 0.0 } else { origin_behind_tips_m });
        let at_origin = |row: &AttemptRecord| Pose {
            translation: origin.of_m(&row.workspace_from_grasp),
            ..row.workspace_from_grasp
        };
        let (numbers, samples): (Vec<[u32; 5]>, Vec<AttemptRecord>) = samples.into_iter().unzip();
        Ok((
            array(py, grids)?,
            rows(py, samples.iter().map(at_origin))?,
            array(py, samples.iter().map(width_m).collect())?,
            array(py, numbers.into_flattened())?.reshape([samples.len(), 5])?,
        ))
    }

    /// How its grippers are seen by a judge.
    fn crops(&self) -> Crops {
        let info = self.dataset.info();
        let grippers = info.grippers().iter().map(|gripper| (gripper, info.procedure.pregrasp_distance_m));
        Crops::of(grippers, &info.grid)
    }

    /// The set of every attempt as the trainer splits them for the paper's network, or for a judge: 0 for none, 1 to
    /// train on, 2 for held-out attempts, 3 for held-out scenes.
    fn split<'py>(
        &self,
        py: Python<'py>,
        seed: u64,
        by: &str,
        shares: [f64; 2],
        of_grasps: bool,
        origin_behind_tips_m: f32,
    ) -> PyResult<Bound<'py, PyArray1<u8>>> {
        let by = if by == "scene" { SplitBy::Scene } else { SplitBy::Attempt };
        let ([test_share, other_share], judge) = (shares, Judge { crops: self.crops().crops });
        let origin = GraspOrigin::behind_tips(origin_behind_tips_m);
        let params = VoxelParams { head: Head::Quaternion, upsampling: Upsampling::Linear, origin };
        let voxel = Voxel::new(params, Device::Host);
        let (config, location) = (SplitConfig { by, test_share, other_share }, self.dataset.location());
        self.read()?;
        let marked = || {
            let datasets = [shards::Dataset::open(location)?];
            let marks = on_threads(0, || {
                if of_grasps {
                    marks_of(&datasets, judge, seed, &config)
                } else {
                    marks_of(&datasets, voxel, seed, &config)
                }
            })??;
            let of_shard = |marks: &SplitBits| {
                marks.scenes().flat_map(|scene| marks.of_scene(scene)).map(|(_, mark)| mark).collect::<Vec<u8>>()
            };
            Ok::<_, Failure>(marks.iter().flat_map(of_shard).collect::<Vec<u8>>())
        };
        array(py, free(py, marked)?)
    }

    /// The lens of the scenes' cameras: width, height, fx, fy, cx, cy in pixels.
    fn intrinsics(&self) -> PyResult<[f32; 6]> {
        let Some(camera) = self.dataset.info().section::<CameraParams>("camera") else {
            let failure = Failure::new(ExitCode::Data, "meta/info.json has no camera that this program knows");
            return Err(raised(&failure));
        };
        let Intrinsics { width_px, height_px, fx_px, fy_px, cx_px, cy_px } = camera.intrinsics();
        Ok([width_px as f32, height_px as f32, fx_px, fy_px, cx_px, cy_px])
    }

    /// The depth images of a scene, `[height, width]` each, in metres.
    fn depth_images<'py>(&self, py: Python<'py>, scene_id: u64) -> PyResult<Vec<Bound<'py, PyArray2<f32>>>> {
        let rows = self.scene_rows(py, scene_id)?;
        let images = free(py, || on_threads(0, || depth_images(self.dataset.info(), &rows))?)?;
        let array = |image: DepthImage| array(py, image.depth_m)?.reshape([image.height_px, image.width_px]);
        images.into_iter().map(array).collect()
    }

    /// Reads and checks everything, and gives the problems.
    fn verify(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        let location = self.dataset.location();
        Ok(free(py, || shards::verify(location, |_| ()))?.problems)
    }

    /// Statistics: as JSON, or as a page.
    fn report(&self, py: Python<'_>, html: bool) -> PyResult<String> {
        let dataset = self.read()?;
        let made = || {
            let report = inspect::report(dataset)?;
            if html { Ok(report.page(dataset).html()) } else { program::json(&report) }
        };
        free(py, made)
    }

    /// A scene in 3-D, as a page.
    fn scene_page(&self, py: Python<'_>, scene_id: u64) -> PyResult<String> {
        let rows = self.scene_rows(py, scene_id)?;
        free(py, || Ok::<_, Failure>(scene_view(self.dataset.info(), self.dataset.id(), &rows).page()))
    }

    /// The convex parts of a scene: of each object, in its frame, and of what they lie in, in the workspace.
    fn hulls(&self, py: Python<'_>, scene_id: u64) -> PyResult<(Vec<Vec<Hull>>, Vec<Hull>)> {
        let rows = self.scene_rows(py, scene_id)?;
        let hull = |part: &Polyhedron| -> Hull {
            let corners_m = part.corners_m().iter().map(|corner| corner.to_array()).collect();
            (corners_m, part.faces().iter().map(|face| face.ring.clone()).collect())
        };
        let made = || {
            let objects = rows.objects.iter().map(|row| row.shape.parts().iter().map(hull).collect()).collect();
            let fixtures = rows.scene.fixtures(&self.dataset.info().grid);
            Ok::<_, Failure>((objects, fixtures.iter().map(hull).collect()))
        };
        free(py, made)
    }

    /// An attempt, executed again before the reader's eyes, as a page.
    fn replay_page(&self, py: Python<'_>, scene_id: u64, attempt_id: u32) -> PyResult<String> {
        let dataset = self.read()?;
        let replay = || replayed(dataset, AttemptId { scene_id, attempt_id });
        Ok(free(py, || on_threads(0, replay)?)?.1.page())
    }

    /// The names of outcomes and of what may be hit, in the order of their numbers.
    #[staticmethod]
    fn names() -> (Vec<&'static str>, Vec<&'static str>) {
        (Outcome::ALL.map(Outcome::name).to_vec(), HitKind::ALL.map(HitKind::name).to_vec())
    }
}

/// The opening at an attempt's end; NaN where the fingers never closed.
fn width_m(row: &AttemptRecord) -> f32 {
    row.width_m.unwrap_or(f32::NAN)
}

/// The set of every attempt of some datasets, as the trainer splits them for a method.
fn marks_of(
    datasets: &[shards::Dataset],
    method: impl Method,
    seed: u64,
    config: &SplitConfig,
) -> Result<Vec<SplitBits>, Failure> {
    let mut found = GraspDataset::survey(datasets, method, &AtomicBool::new(false), &|| ())?;
    split(&mut found.marks, seed, config)?;
    Ok(found.marks)
}
