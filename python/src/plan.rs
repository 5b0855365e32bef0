//! The planner, in this process.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2, ToPyArray};
use planner::{Cone, Config, Limits, Observation, PlanOptions, Policy, Target, View, plane};
use program::{Failure, json};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use schema::{Gripper, Pose, Quat, Vec3, VoxelGrid};

use crate::fault::{free, raised, wrong};
use crate::pool::on_threads;
use crate::scene::{Seven, Simulation, camera, image, pose};

/// A network and settings, ready to plan; planning changes nothing, so any number of threads may.
#[pyclass(frozen, module = "graspmill._native")]
#[derive(Debug)]
pub(crate) struct Planner {
    planner: planner::Planner,
    threads: usize,
}

/// Options of a plan, as Python has them.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct Request {
    workspace_size_m: Option<f32>,
    base_from_workspace: Option<Seven>,
    workspace_from_wrist: Option<[f32; 4]>,
    policy: Option<String>,
    check_collisions: Option<bool>,
    grasps_max: Option<usize>,
    explain: bool,
    avoid: Vec<Seven>,
    /// A direction and an angle.
    approach: Option<([f32; 3], f32)>,
    /// Normals and offsets.
    keep_out: Vec<[f32; 4]>,
    /// The lower and the upper corner.
    reach: Option<[[f32; 3]; 2]>,
    target_m: Option<[f32; 3]>,
    /// Called with a grasp, position and quaternion.
    accept: Option<Py<PyAny>>,
}

impl Request {
    fn options(self) -> PyResult<(PlanOptions, Option<Py<PyAny>>)> {
        let options = PlanOptions {
            workspace_size_m: self.workspace_size_m,
            base_from_workspace: self.base_from_workspace.map(pose),
            workspace_from_wrist: self.workspace_from_wrist.map(|wrist| Quat::from_array(wrist).normalize()),
            policy: self.policy.map(Policy::try_from).transpose().map_err(wrong)?,
            check_collisions: self.check_collisions,
            grasps_max: self.grasps_max,
            explain: self.explain,
            avoid: self.avoid.into_iter().map(pose).collect(),
            limits: Limits {
                approach: self.approach.map(|(direction, angle)| Cone::about(Vec3::from_array(direction), angle)),
                keep_out: self.keep_out.into_iter().map(|[x, y, z, off]| plane(Vec3::new(x, y, z), off)).collect(),
                reach_m: self.reach.map(|corners| corners.map(Vec3::from_array)),
                target: self.target_m.map(|point_m| Target::Point(Vec3::from_array(point_m))),
            },
        };
        Ok((options, self.accept))
    }
}

#[pymethods]
impl Planner {
    /// A planner with settings (a name or a file), a network's file, and a hand.
    #[new]
    fn new(
        py: Python<'_>,
        config: Option<PathBuf>,
        model: Option<PathBuf>,
        hand: Option<&Simulation>,
        threads: usize,
    ) -> PyResult<Self> {
        let hand = hand.map(|simulation| simulation.gripper.clone());
        let made = || {
            let mut config = Config::load(config.as_deref())?;
            config.gripper = hand.unwrap_or(config.gripper);
            match &model {
                Some(model) => planner::Planner::new(model, config),
                None => planner::Planner::built_in(config),
            }
        };
        Ok(Self { planner: free(py, made)?, threads })
    }

    /// A workspace of a size, by default the network's: its side in metres, voxels along a side, the table's height in
    /// metres.
    fn grid(&self, workspace_size_m: Option<f32>) -> (f32, usize, f32) {
        let grid = PlanOptions { workspace_size_m, ..PlanOptions::default() }.workspace(&self.planner.grid);
        (grid.size_m, grid.resolution, grid.table_z_m)
    }

    /// SHA-256 of the network's file.
    #[getter]
    fn model_id(&self) -> &str {
        &self.planner.model_id
    }

    /// The hand's name.
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
    ) -> PyResult<Plan> {
        let (mut options, accept) = request.options()?;
        if let Some(masks) = masks {
            let pixels = |mask: &PyReadonlyArray2<'_, bool>| mask.as_array().iter().copied().collect();
            let masks = masks.iter().map(|mask| mask.as_ref().map(pixels)).collect();
            options.limits.target = Some(Target::Masks(masks));
        }
        let cameras = intrinsics.into_iter().zip(workspace_from_camera);
        let seen = depths.iter().zip(cameras);
        let views = seen.map(|(depth, (lens, at))| View { image: image(depth), camera: camera(lens, at) });
        self.plan(py, Observation::Views(views.collect()), options, accept)
    }

    /// A plan from a cloud, `[N, 3]` in the workspace, seen from `[M, 3]`, in metres.
    fn plan_cloud(
        &self,
        py: Python<'_>,
        points_m: PyReadonlyArray2<'_, f32>,
        eyes_m: PyReadonlyArray2<'_, f32>,
        request: Request,
    ) -> PyResult<Plan> {
        let points = |rows: &PyReadonlyArray2<'_, f32>| -> Vec<Vec3> {
            rows.as_array().rows().into_iter().map(|row| Vec3::new(row[0], row[1], row[2])).collect()
        };
        let (options, accept) = request.options()?;
        self.plan(py, Observation::Cloud { points_m: points(&points_m), eyes_m: points(&eyes_m) }, options, accept)
    }

    /// A plan from a TSDF in VGN's values, flat.
    fn plan_tsdf(&self, py: Python<'_>, values: PyReadonlyArray1<'_, f32>, request: Request) -> PyResult<Plan> {
        let (values, (options, accept)) = (values.as_array().iter().copied().collect(), request.options()?);
        let grid = options.workspace(&self.planner.grid);
        let grid = VoxelGrid::new(grid, values).map_err(|error| wrong(format!("{error}: tsdf")))?;
        self.plan(py, Observation::Tsdf(grid), options, accept)
    }
}

impl Planner {
    fn plan(
        &self,
        py: Python<'_>,
        observation: Observation,
        options: PlanOptions,
        accept: Option<Py<PyAny>>,
    ) -> PyResult<Plan> {
        let raised = Mutex::new(None);
        let called = |accept: &Py<PyAny>, pose: &Pose| {
            let mut raised = raised.lock().unwrap_or_else(PoisonError::into_inner);
            let ([x, y, z], [qx, qy, qz, qw]) = (pose.translation.to_array(), pose.rotation.to_array());
            // After an exception nothing more is asked.
            raised.is_none()
                && Python::attach(|py| accept.call1(py, ([x, y, z, qx, qy, qz, qw],))?.extract(py)).unwrap_or_else(
                    |error| {
                        *raised = Some(error);
                        false
                    },
                )
        };
        let will_do = |pose: &Pose| accept.as_ref().is_none_or(|accept| called(accept, pose));
        let plan = || self.planner.plan_with(&observation, &options, &will_do).map_err(Failure::from);
        let plan = free(py, || on_threads(self.threads, plan)?)?;
        if let Some(error) = raised.into_inner().unwrap_or_else(PoisonError::into_inner) {
            return Err(error);
        }
        Ok(Plan { plan, gripper: self.planner.config.gripper.clone() })
    }
}

/// Ranked grasps.
#[pyclass(frozen, module = "graspmill._native")]
#[derive(Debug)]
pub(crate) struct Plan {
    plan: planner::plan::Plan,
    gripper: Gripper,
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

    /// A picture of the scene and its grasps, as a PNG.
    fn picture<'py>(&self, py: Python<'py>, title: &str) -> PyResult<Bound<'py, PyBytes>> {
        let drawn = || on_threads(0, || planner::picture::draw(&self.plan, &self.gripper, title))?;
        Ok(PyBytes::new(py, &free(py, drawn)?))
    }

    /// The points of the segmented surface, flat, in metres.
    fn cloud<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        let flat: Vec<f32> = self.plan.cloud.points_m.iter().flat_map(|point| point.to_array()).collect();
        flat.to_pyarray(py)
    }
}
