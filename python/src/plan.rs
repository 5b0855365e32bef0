//! The planner, in this process.

use std::path::PathBuf;
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};

use graspmill::planning::show::{draw_into, page};
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use planner::input::{check_image, options_from_json};
use planner::plan::PointLabel;
use planner::{Config, Observation, PlanOptions, Target, View, WillDo};
use program::{Failure, json};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use schema::{ColorImage, Gripper, Pose, Vec3, VoxelGrid};

use crate::fault::{array, free, raised, room, wrong};
use crate::pool::{Apart, on_threads};
use crate::scene::{Seven, Simulation, camera, image, seven};

/// Memory for making a planner, whose weights are prepared on all threads, in bytes.
const PLANNER_BYTES: usize = 48 << 20;
/// Memory for the plan of anything, in bytes, and for each pixel or point besides; and for a picture.
const PLAN_BYTES: usize = 256 << 20;
const POINT_BYTES: usize = 40;
const PICTURE_BYTES: usize = 128 << 20;

/// A network and settings, ready to plan; planning changes nothing, so any number of threads may.
#[pyclass(frozen, module = "graspmill._native")]
#[derive(Debug)]
pub(crate) struct Planner {
    planner: Arc<planner::Planner>,
    threads: usize,
}

/// What is asked for beside the observation.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct Request {
    /// The options in the JSON of a request.
    options: String,
    /// Whether poses are in the first camera's frame, or a cloud in its sensor's.
    finds_table: bool,
    /// Whether the caller is asked about grasps.
    is_asked: bool,
}

impl Request {
    fn options(&self) -> PyResult<PlanOptions> {
        options_from_json(self.options.as_bytes(), self.finds_table).map_err(|error| {
            let text = error.to_string();
            // An argument comes before its rule.
            let turned = text.rsplit_once(": ").filter(|(rule, _)| rule.starts_with("must"));
            wrong(turned.map_or_else(|| text.clone(), |(rule, name)| format!("{name} {rule}")))
        })
    }
}

#[pymethods]
impl Planner {
    /// A planner with settings (a name or a file), a network's file, and a gripper.
    #[new]
    fn new(
        py: Python<'_>,
        config: Option<PathBuf>,
        model: Option<PathBuf>,
        gripper: Option<&Simulation>,
        threads: usize,
    ) -> PyResult<Self> {
        room(PLANNER_BYTES)?;
        let gripper = gripper.map(|simulation| simulation.gripper.clone());
        let made = || {
            let mut config = Config::load(config.as_deref())?;
            config.gripper = gripper.unwrap_or(config.gripper);
            match &model {
                Some(model) => planner::Planner::new(model, config),
                None => planner::Planner::built_in(config),
            }
        };
        Ok(Self { planner: Arc::new(free(py, || on_threads(threads, made)?)?), threads })
    }

    /// The workspace of a request, by default the network's: its side in metres, voxels along a side, the table's
    /// height in metres.
    fn grid(&self, request: Option<Request>) -> PyResult<(f32, usize, f32)> {
        let options = request.map(|request| request.options()).transpose()?.unwrap_or_default();
        let grid = options.workspace(&self.planner.grid);
        Ok((grid.size_m, grid.resolution, grid.table_z_m))
    }

    /// SHA-256 of the network's file.
    #[getter]
    fn model_id(&self) -> &str {
        &self.planner.model_id
    }

    /// The gripper's name.
    #[getter]
    fn gripper_name(&self) -> &str {
        &self.planner.config.gripper.name
    }

    /// A plan from depth images, `[height, width]` each in metres, of what masks of their sizes show, or of everything.
    fn plan_views(
        &self,
        py: Python<'_>,
        depths: Vec<PyReadonlyArray2<'_, f32>>,
        intrinsics: Vec<[f32; 6]>,
        workspace_from_camera: Vec<Seven>,
        masks: Option<Vec<Option<PyReadonlyArray2<'_, bool>>>>,
        request: Request,
    ) -> PyResult<Planned> {
        room(PLAN_BYTES + POINT_BYTES * depths.iter().map(|depth| depth.as_array().len()).sum::<usize>())?;
        let (is_asked, mut options) = (request.is_asked, request.options()?);
        if let Some(masks) = masks {
            let pixels = |mask: &PyReadonlyArray2<'_, bool>| mask.as_array().iter().copied().collect();
            let masks = masks.iter().map(|mask| mask.as_ref().map(pixels)).collect();
            options.limits.target = Some(Target::Masks(masks));
        }
        let cameras = intrinsics.into_iter().zip(workspace_from_camera);
        let seen = depths.iter().zip(cameras);
        let views: Vec<View> = seen.map(|(depth, (lens, at))| View::new(image(depth), camera(lens, at))).collect();
        let check = |(number, view): (usize, &View)| -> PyResult<Option<String>> {
            let said = check_image(&view.image).map_err(|error| wrong(format!("{error}: depth image {number}")))?;
            Ok(said.map(|said| format!("{said}: depth image {number}")))
        };
        let warnings = views.iter().enumerate().filter_map(|view| check(view).transpose()).collect::<PyResult<_>>()?;
        self.plan(py, Observation::Views(views), options, is_asked, warnings)
    }

    /// A plan from a cloud, `[N, 3]` in the workspace, seen from `[M, 3]`, of the object with these points or, if there
    /// are none, of anything, in metres.
    fn plan_cloud(
        &self,
        py: Python<'_>,
        points_m: PyReadonlyArray2<'_, f32>,
        eyes_m: PyReadonlyArray2<'_, f32>,
        object_m: PyReadonlyArray2<'_, f32>,
        request: Request,
    ) -> PyResult<Planned> {
        room(PLAN_BYTES + POINT_BYTES * (points_m.as_array().nrows() + object_m.as_array().nrows()))?;
        let points = |rows: &PyReadonlyArray2<'_, f32>| -> Vec<Vec3> {
            rows.as_array().rows().into_iter().map(|row| Vec3::new(row[0], row[1], row[2])).collect()
        };
        let (is_asked, mut options) = (request.is_asked, request.options()?);
        let (mut points_m, object_m) = (points(&points_m), points(&object_m));
        points_m.extend(&object_m);
        if !object_m.is_empty() {
            options.limits.target = Some(Target::Points(object_m));
        }
        self.plan(py, Observation::Cloud { points_m, eyes_m: points(&eyes_m) }, options, is_asked, Vec::new())
    }

    /// A plan from a TSDF in VGN's values, flat.
    fn plan_tsdf(&self, py: Python<'_>, values: PyReadonlyArray1<'_, f32>, request: Request) -> PyResult<Planned> {
        room(PLAN_BYTES + POINT_BYTES * values.as_array().len())?;
        let (is_asked, options) = (request.is_asked, request.options()?);
        let values = values.as_array().iter().copied().collect();
        let grid = options.workspace(&self.planner.grid);
        let grid = VoxelGrid::new(grid, values).map_err(|error| wrong(format!("{error}: tsdf")))?;
        self.plan(py, Observation::Tsdf(grid), options, is_asked, Vec::new())
    }
}

impl Planner {
    fn plan(
        &self,
        py: Python<'_>,
        observation: Observation,
        options: PlanOptions,
        is_asked: bool,
        warnings: Vec<String>,
    ) -> PyResult<Planned> {
        let first = observation.images().and_then(<[View]>::first).cloned();
        let planner = Arc::clone(&self.planner);
        planned(py, self.threads, is_asked, move |will_do| {
            let mut plan = planner.plan_with(&observation, &options, will_do)?;
            plan.warnings.extend(warnings);
            Ok(Plan { plan, gripper: planner.config.gripper.clone(), first })
        })
    }
}

/// Makes a plan; if its caller is asked about grasps, on threads of its own.
fn planned(
    py: Python<'_>,
    threads: usize,
    is_asked: bool,
    plan: impl FnOnce(&WillDo<'_>) -> Result<Plan, Failure> + Send + 'static,
) -> PyResult<Planned> {
    if !is_asked {
        let plan = || on_threads(threads, || plan(&|poses: &[Pose]| vec![true; poses.len()]))?;
        return Ok(Planned::Plan(free(py, plan)?));
    }
    let (answer, answers) = channel();
    let answers = Mutex::new(answers);
    let steps = Apart::start(threads, move |tell, _| {
        let will_do = |poses: &[Pose]| {
            let answers = answers.lock().unwrap_or_else(PoisonError::into_inner);
            // Nobody answers after an exception.
            _ = tell.send(Ok(Step::Asked(poses.iter().map(seven).collect())));
            answers.recv().unwrap_or_else(|_| vec![false; poses.len()])
        };
        plan(&will_do).map(Step::Planned)
    })?;
    Ok(Planned::Planning(Planning { steps, answer: Some(answer) }))
}

/// A plan, or one whose caller is asked about its grasps.
#[derive(Debug, IntoPyObject)]
#[expect(clippy::large_enum_variant, reason = "made once a call, and consumed at once")]
enum Planned {
    Plan(Plan),
    Planning(Planning),
}

/// The next thing that planning tells: grasps that it asks about, or the plan.
#[derive(Debug, IntoPyObject)]
#[expect(clippy::large_enum_variant, reason = "made once a call, and consumed at once")]
enum Step {
    Asked(Vec<Seven>),
    Planned(Plan),
}

/// A plan that is being made, on threads of its own: its caller decides about grasps, and may wait for another plan.
#[pyclass(module = "graspmill._native")]
#[derive(Debug)]
pub(crate) struct Planning {
    steps: Apart<Step>,
    answer: Option<Sender<Vec<bool>>>,
}

#[pymethods]
impl Planning {
    /// Whether each of the grasps that it asked about will do; then the next ones, or the plan.
    fn next(&mut self, py: Python<'_>, will_do: Option<Vec<bool>>) -> PyResult<Step> {
        // A plan that failed tells so below.
        _ = will_do.and_then(|will_do| self.answer.as_ref()?.send(will_do).ok());
        self.steps.next(py)
    }

    /// Asks no more: the plan ends soon, and nobody gets it.
    fn leave(&mut self) {
        self.answer = None;
    }
}

/// Ranked grasps.
#[pyclass(frozen, module = "graspmill._native")]
#[derive(Debug)]
pub(crate) struct Plan {
    plan: planner::plan::Plan,
    gripper: Gripper,
    /// For pictures.
    first: Option<View>,
}

#[pymethods]
impl Plan {
    /// The plan as JSON, the same as the command's and the service's.
    fn json(&self) -> PyResult<String> {
        json(&self.plan).map_err(|failure| raised(&failure))
    }

    /// The milliseconds of its stages.
    #[getter]
    fn timings_ms(&self) -> Vec<(&'static str, f64)> {
        self.plan.timings_ms.clone()
    }

    /// The scene and its grasps as a page of HTML, to be turned about.
    fn page(&self, py: Python<'_>, title: &str) -> PyResult<String> {
        room(PICTURE_BYTES)?;
        free(py, || Ok::<_, Failure>(page(&self.plan, &self.gripper, title)))
    }

    /// The best grasps in an image of the first camera, `[height, width, 3]`, or in its depth in grey, as a PNG.
    fn overlay<'py>(&self, py: Python<'py>, image: Option<PyReadonlyArray3<'_, u8>>) -> PyResult<Bound<'py, PyBytes>> {
        let given = image.map(|image| {
            let pixels = image.as_array();
            ColorImage {
                width_px: pixels.shape()[1],
                height_px: pixels.shape()[0],
                pixels: pixels.rows().into_iter().map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect(),
            }
        });
        room(PICTURE_BYTES)?;
        let png = free(py, || draw_into(given, self.first.as_ref(), &self.plan, &self.gripper))?;
        PyBytes::new_with(py, png.len(), |bytes| {
            bytes.copy_from_slice(&png);
            Ok(())
        })
    }

    /// The points of the segmented surface, flat, in metres.
    fn cloud<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f32>>> {
        array(py, self.plan.cloud.points_m.iter().flat_map(|point| point.to_array()).collect())
    }

    /// What each of them is of: the object's index, -1 for noise, -2 for the table.
    fn labels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<i32>>> {
        let number = |label: &PointLabel| match label {
            PointLabel::Plane => -2,
            PointLabel::Noise => -1,
            PointLabel::Object(object) => i32::try_from(*object).unwrap_or(i32::MAX),
        };
        array(py, self.plan.cloud.labels.iter().map(number).collect())
    }
}
