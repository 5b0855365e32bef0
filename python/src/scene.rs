//! Scenes and the label oracle.

use generator::{Config, Overrides};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use perception::fuse_images;
use program::{ExitCode, Failure};
use pyo3::prelude::*;
use rayon::prelude::*;
/// The seven numbers of a pose.
pub(crate) use report::view::flat as seven;
use schema::{
    Camera, Container, ContainerKind, DepthImage, Grid, Gripper, HitKind, Intrinsics, Model, ModelPart, Physics,
    Polyhedron, Pose, Procedure, Quat, SettleParams, ShapeKind, Solid, TriangleMesh, Vec3,
};
use serde_json::json;
use simulator::{
    AttemptWorld, Execution, Part, PartShape, PartsParams, SceneObject, SceneRays, Settled, Unsettled, convex_parts,
    settle, settle_again,
};
use std::path::PathBuf;
use std::sync::Arc;

use crate::fault::{array, free, raised, reserved, room, wrong};
use crate::pool::{Apart, on_threads};

/// Attempts between two looks for a signal.
const TOGETHER: usize = 2048;
/// Memory for each of a pose's numbers in [`execute`], in bytes: the poses, and what comes of them.
const ATTEMPT_BYTES: usize = 24;
/// Memory for the decomposition of any mesh, in bytes, and for each of its triangles.
const MESH_BYTES: usize = 64 << 20;
const TRIANGLE_BYTES: usize = 1024;

/// A pose as Python gives it: a position in metres and a quaternion x, y, z, w.
pub(crate) type Seven = [f32; 7];

/// The pose of seven numbers. A quaternion of length 1 keeps its bits.
pub(crate) fn pose([x, y, z, qx, qy, qz, qw]: Seven) -> Pose {
    let rotation = Quat::from_xyzw(qx, qy, qz, qw);
    let is_unit = (rotation.length_squared() - 1.0).abs() < 1e-5;
    Pose::from_parts(Vec3::new(x, y, z), if is_unit { rotation } else { rotation.normalize() })
}

/// Rows of poses.
pub(crate) fn poses(rows: &PyReadonlyArray2<'_, f32>) -> Vec<Pose> {
    let rows = rows.as_array();
    rows.rows().into_iter().map(|row| pose(std::array::from_fn(|number| row[number]))).collect()
}

/// Poses as rows.
pub(crate) fn rows<'py>(py: Python<'py>, poses: impl Iterator<Item = Pose>) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let flat: Vec<f32> = poses.flat_map(|pose| seven(&pose)).collect();
    let count = flat.len() / 7;
    array(py, flat)?.reshape([count, 7])
}

/// A camera of six numbers (width, height, fx, fy, cx, cy; in pixels) and a pose.
pub(crate) fn camera([width, height, fx_px, fy_px, cx_px, cy_px]: [f32; 6], at: Seven) -> Camera {
    let intrinsics = Intrinsics { width_px: width as usize, height_px: height as usize, fx_px, fy_px, cx_px, cy_px };
    Camera { intrinsics, workspace_from_camera: pose(at) }
}

/// The simulation of an attempt and of rest: a gripper, an engine, a procedure.
#[pyclass(frozen, module = "graspmill._native")]
#[derive(Debug)]
pub(crate) struct Simulation {
    pub(crate) gripper: Gripper,
    pub(crate) physics: Physics,
    pub(crate) procedure: Procedure,
    pub(crate) settle: SettleParams,
    pub(crate) grid: Grid,
}

#[pymethods]
impl Simulation {
    /// Those of a generator's config (the paper's without a file), with some keys set.
    #[new]
    fn new(config: Option<PathBuf>, set: Vec<(String, String)>) -> PyResult<Self> {
        room(0)?;
        let overrides = Overrides { set: &set, ..Overrides::default() };
        let config = Config::load(config.as_deref(), overrides).map_err(|error| raised(&error.into()))?;
        let Config { physics, procedure, settle, grid, gripper, .. } = config;
        let Some(gripper) = gripper.only().cloned() else {
            return Err(wrong("gripper must be one, got several or ranges"));
        };
        Ok(Self { gripper, physics, procedure, settle, grid })
    }

    /// The same with some keys set: the rest stays as it is, the gripper, too, unless it is set.
    fn adjusted(&self, set: Vec<(String, String)>) -> PyResult<Self> {
        let own =
            [("physics", json!(self.physics)), ("procedure", json!(self.procedure)), ("settle", json!(self.settle))];
        let own = own.iter().flat_map(|(section, values)| {
            let values = values.as_object().into_iter().flatten();
            values.map(move |(key, value)| (format!("{section}.{key}"), value.to_string()))
        });
        let is_other_gripper = set.iter().any(|(key, _)| key == "gripper" || key.starts_with("gripper."));
        let made = Self::new(None, own.chain(set).collect())?;
        Ok(if is_other_gripper { made } else { Self { gripper: self.gripper.clone(), ..made } })
    }

    /// The gripper in JSON, as datasets store it.
    #[getter]
    fn gripper(&self) -> PyResult<String> {
        serde_json::to_string(&self.gripper).map_err(|error| wrong(error.to_string()))
    }

    /// What its joint is at, open and closed, if its file has it.
    #[getter]
    fn joint(&self) -> Option<[f32; 2]> {
        self.gripper.joint.map(|joint| [joint.open, joint.closed])
    }

    /// Its grasp frame in the frame of the robot's flange, as position and quaternion, if its file has it.
    #[getter]
    fn flange_from_grasp(&self) -> Option<Vec<f32>> {
        let parts = self.gripper.flange_from_grasp?;
        Some(parts.position_m.into_iter().chain(parts.quaternion_xyzw).collect())
    }

    /// Names of the grippers that need no file.
    #[staticmethod]
    fn gripper_names() -> Vec<&'static str> {
        Gripper::BUILT_IN.map(|(name, _)| name).to_vec()
    }
}

/// The corners of a part, in metres.
type Corners = Vec<[f32; 3]>;
/// The corners of a mesh, in metres, and its triangles.
type PlainMesh = (Corners, Vec<[u32; 3]>);

/// The shape of an object.
#[pyclass(frozen, module = "graspmill._native")]
#[derive(Debug, Clone)]
pub(crate) struct Body {
    body: simulator::Body,
    /// The middle of its bounding box in the frame in which it was given.
    centre_m: Vec3,
    /// How far its parts leave the surface of a mesh, in metres.
    #[pyo3(get)]
    off_m: f32,
}

#[pymethods]
impl Body {
    /// What pickle makes again: a primitive shape, or the hulls of the corners of a compound's parts, and its mesh.
    #[new]
    #[pyo3(signature = (name, extents_m, parts, mesh=None))]
    fn new(name: String, extents_m: [f32; 3], parts: Option<Vec<Corners>>, mesh: Option<PlainMesh>) -> PyResult<Self> {
        let Some(parts) = parts else { return Self::solid(&name, extents_m) };
        let points = |corners: Corners| corners.into_iter().map(Vec3::from_array).collect::<Vec<_>>();
        let parts = parts.into_iter().map(|corners| ModelPart { corners_m: points(corners) }).collect();
        let mesh = mesh.map(|(corners, triangles)| TriangleMesh::new(&points(corners), triangles).map(Arc::new));
        let (mesh, extents_m) = (mesh.transpose().map_err(wrong)?, Vec3::from_array(extents_m));
        let model = Model { name, mass_kg: 0.0, friction: 0.0, extents_m, volume_m3: 0.0, parts, mesh };
        let body = simulator::Body::of_model(&model).map_err(|error| wrong(error.to_string()))?;
        Ok(Self { body, centre_m: Vec3::ZERO, off_m: 0.0 })
    }

    /// The arguments with which pickle makes it again.
    fn __getnewargs__(&self) -> (&str, [f32; 3], Option<Vec<Corners>>, Option<PlainMesh>) {
        let plain = |corners_m: &[Vec3]| corners_m.iter().map(|corner| corner.to_array()).collect::<Corners>();
        let parts = || self.body.polyhedra().iter().map(|part| plain(part.corners_m())).collect();
        let mesh = self.body.mesh().map(|mesh| (plain(mesh.corners_m()), mesh.triangles().to_vec()));
        (self.name(), self.extents_m(), self.body.as_solid().is_none().then(parts), mesh)
    }

    /// One of the four primitive shapes.
    #[staticmethod]
    fn solid(kind: &str, extents_m: [f32; 3]) -> PyResult<Self> {
        let names = || ShapeKind::ALL.map(ShapeKind::name).join(", ");
        let kind = ShapeKind::from_name(kind)
            .ok_or_else(|| wrong(format!("shape must be one of {}, got {kind:?}", names())))?;
        let solid = Solid::new(kind, Vec3::from_array(extents_m)).map_err(wrong)?;
        Ok(Self { body: solid.into(), centre_m: Vec3::ZERO, off_m: 0.0 })
    }

    /// A mesh, decomposed into convex parts. After a signal the decomposition, one call of another crate, goes on by
    /// itself.
    #[staticmethod]
    fn mesh(
        py: Python<'_>,
        name: String,
        vertices_m: PyReadonlyArray2<'_, f32>,
        triangles: PyReadonlyArray2<'_, u32>,
        parts_max: usize,
        corners_max: usize,
        tolerance_m: f32,
    ) -> PyResult<Self> {
        room(8 * (vertices_m.as_array().len() + triangles.as_array().len()))?;
        let corners: Vec<Vec3> =
            vertices_m.as_array().rows().into_iter().map(|row| Vec3::new(row[0], row[1], row[2])).collect();
        let triangles: Vec<[u32; 3]> =
            triangles.as_array().rows().into_iter().map(|row| [row[0], row[1], row[2]]).collect();
        if let Some(corner) = triangles.iter().flatten().find(|corner| **corner as usize >= corners.len()) {
            return Err(wrong(format!("faces must be below the number of vertices, {}, got {corner}", corners.len())));
        }
        let params = PartsParams { parts_max, corners_max, tolerance_m };
        room(MESH_BYTES + TRIANGLE_BYTES * triangles.len())?;
        let made = move || {
            let parts = convex_parts(&corners, &triangles, &params);
            let refused = |error: String| Failure::new(ExitCode::Config, format!("mesh {name}: {error}"));
            let parts = parts.map_err(|error| refused(error.to_string()))?;
            let [low, high] = schema::bounds_m(parts.hulls.iter().flat_map(|hull| hull.corners_m()));
            let part = |hull| Part { shape: PartShape::Hull(hull), object_from_part: Pose::IDENTITY };
            let body = simulator::Body::of_parts(name.clone(), parts.hulls.into_iter().map(part).collect());
            let (body, centre_m) = (body.map_err(|error| refused(error.to_string()))?, 0.5 * (low + high));
            // What is to be its hull is seen as that.
            let mesh = (parts_max > 1).then(|| {
                let corners: Vec<Vec3> = corners.iter().map(|corner_m| *corner_m - centre_m).collect();
                TriangleMesh::new(&corners, triangles).map(Arc::new)
            });
            let body = body.with_mesh(mesh.transpose().map_err(refused)?);
            Ok(Self { body, centre_m, off_m: parts.filled_m.max(parts.simplified_m) })
        };
        Apart::start(0, move |_, _| made())?.next(py)
    }

    /// What it is called.
    #[getter]
    fn name(&self) -> &str {
        self.body.name()
    }

    /// Full lengths of its bounding box, in metres.
    #[getter]
    fn extents_m(&self) -> [f32; 3] {
        self.body.extents_m().to_array()
    }

    /// Volume of its parts in cubic metres.
    #[getter]
    fn volume_m3(&self) -> f32 {
        self.body.volume_m3()
    }

    /// The middle of its bounding box in the frame in which it was given, in metres.
    #[getter]
    fn centre_m(&self) -> [f32; 3] {
        self.centre_m.to_array()
    }

    /// The corners of each of its convex parts in its frame, in metres, `[N, 3]` each.
    fn parts<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyArray2<f32>>>> {
        let part = |polyhedron: &Polyhedron| {
            let flat: Vec<f32> = polyhedron.corners_m().iter().flat_map(|corner| corner.to_array()).collect();
            let count = flat.len() / 3;
            array(py, flat)?.reshape([count, 3])
        };
        self.body.polyhedra().iter().map(part).collect()
    }
}

impl Body {
    /// The shape.
    pub(crate) fn body(&self) -> &simulator::Body {
        &self.body
    }
}

/// Objects on a table.
#[pyclass(frozen, module = "graspmill._native")]
#[derive(Debug, Clone)]
pub(crate) struct Scene {
    pub(crate) scene: simulator::Scene,
    /// What the objects lie in, and the side of the workspace in whose middle it stands.
    pub(crate) container: Option<(Container, f32)>,
}

/// A container as Python has it: its kind, its sizes, and the workspace's side.
type PlainContainer = (String, [f32; 5], f32);

#[pymethods]
impl Scene {
    /// Objects with their poses, `[N, 7]`, on a table of this height, in a container or none.
    #[new]
    fn new(
        bodies: Vec<Py<Body>>,
        masses_kg: Vec<f32>,
        frictions: Vec<f32>,
        workspace_from_object: PyReadonlyArray2<'_, f32>,
        table_z_m: f32,
        container: Option<PlainContainer>,
    ) -> PyResult<Self> {
        let made = |(kind, sizes, size_m): PlainContainer| {
            let names = || ContainerKind::ALL.map(ContainerKind::name).join(", ");
            let kind = ContainerKind::from_name(&kind)
                .ok_or_else(|| wrong(format!("kind must be one of {}, got {kind:?}", names())))?;
            let (container, grid) = (Container::of_sizes(kind, sizes), Grid { size_m, table_z_m, ..Grid::PAPER });
            container.check(&grid).map_err(wrong)?;
            Ok::<_, PyErr>(((container, size_m), container.parts(&grid)))
        };
        let (container, fixtures) = container.map(made).transpose()?.unzip();
        let given = bodies.iter().zip(masses_kg).zip(frictions).zip(poses(&workspace_from_object));
        let object = |(((body, mass_kg), friction), at): (((&Py<Body>, f32), f32), Pose)| SceneObject {
            body: body.get().body.clone(),
            mass_kg,
            friction,
            workspace_from_object: at,
        };
        let (fixtures, objects) = (fixtures.unwrap_or_default(), given.map(object).collect());
        Ok(Self { scene: simulator::Scene { table_z_m, fixtures, objects }, container })
    }

    /// The scene at rest: objects dropped one by one into a box about the workspace, or let go where they are.
    fn settle(&self, py: Python<'_>, simulation: &Simulation, drop: bool) -> PyResult<Self> {
        let Simulation { physics, settle: params, grid, .. } = simulation;
        let grid = Grid { table_z_m: self.scene.table_z_m, ..*grid };
        let simulator::Scene { objects, fixtures, .. } = &self.scene;
        let rest = || {
            let settled = if drop {
                settle(physics, params, &grid, fixtures, objects)
            } else {
                settle_again(physics, params, &grid, fixtures, objects)
            };
            settled.map_err(|unsettled| {
                let text = match unsettled {
                    Unsettled::Moving { fastest } => {
                        let name = objects.get(fastest).map_or("an object", |object| object.body.name());
                        format!(
                            "the objects must rest within {} s of the last drop; {name} moved on",
                            params.time_s_max
                        )
                    }
                    Unsettled::Empty => "no object stayed in the workspace".to_owned(),
                    Unsettled::Unstable => "objects overlap, or one was shot away".to_owned(),
                };
                Failure::new(ExitCode::Data, text)
            })
        };
        let Settled { scene, .. } = free(py, rest)?;
        Ok(Self { scene, container: self.container })
    }

    /// What the objects lie in.
    #[getter]
    fn container(&self) -> Option<PlainContainer> {
        self.container.map(|(container, size_m)| (container.kind.name().to_owned(), container.sizes(), size_m))
    }

    /// The number of objects.
    fn __len__(&self) -> usize {
        self.scene.objects.len()
    }

    /// The table's height in metres.
    #[getter]
    fn table_z_m(&self) -> f32 {
        self.scene.table_z_m
    }

    /// The shape, mass and friction of an object.
    fn object(&self, number: usize) -> Option<(Body, f32, f32)> {
        let object = self.scene.objects.get(number)?;
        Some((Body { body: object.body.clone(), centre_m: Vec3::ZERO, off_m: 0.0 }, object.mass_kg, object.friction))
    }

    /// The objects' poses, `[N, 7]`.
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        rows(py, self.scene.objects.iter().map(|object| object.workspace_from_object))
    }

    /// The depth image of a camera, `[height, width]`, in metres along its z; 0 where it sees nothing.
    fn render<'py>(
        &self,
        py: Python<'py>,
        intrinsics: [f32; 6],
        workspace_from_camera: Seven,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let camera = camera(intrinsics, workspace_from_camera);
        room(size_of::<f32>() * camera.intrinsics.width_px * camera.intrinsics.height_px)?;
        let image = free(py, || on_threads(0, || SceneRays::new(&self.scene).render(&camera)))?;
        array(py, image.depth_m)?.reshape([image.height_px, image.width_px])
    }
}

/// The TSDF of depth images, flat, in VGN's values: `depths` of `[height, width]` each, with a camera.
#[pyfunction]
pub(crate) fn fuse<'py>(
    py: Python<'py>,
    depths: Vec<PyReadonlyArray2<'py, f32>>,
    intrinsics: Vec<[f32; 6]>,
    workspace_from_camera: Vec<Seven>,
    resolution: usize,
    size_m: f32,
    truncation_voxels: f32,
) -> PyResult<Bound<'py, PyArray1<f32>>> {
    let grid = Grid { size_m, resolution, ..Grid::PAPER };
    room(size_of::<f32>() * (grid.len() + depths.iter().map(|depth| depth.as_array().len()).sum::<usize>()))?;
    let images: Vec<DepthImage> = depths.iter().map(image).collect();
    let cameras = intrinsics.into_iter().zip(workspace_from_camera).map(|(lens, at)| camera(lens, at));
    let views: Vec<(Camera, &DepthImage)> = cameras.zip(&images).collect();
    let fused = || on_threads(0, || fuse_images(grid, truncation_voxels, &views));
    array(py, free(py, fused)?.values)
}

/// A depth image of an array.
pub(crate) fn image(depth_m: &PyReadonlyArray2<'_, f32>) -> DepthImage {
    let depth_m = depth_m.as_array();
    let (height_px, width_px) = depth_m.dim();
    DepthImage { width_px, height_px, depth_m: depth_m.iter().copied().collect() }
}

/// Outcomes as numbers of [`schema::Outcome::ALL`], openings (NaN where the fingers never closed), what was hit (-1 for
/// nothing, else the number in [`HitKind::ALL`]), which object (-1 for none), and the targets.
type Executed<'py> = (
    Bound<'py, PyArray1<u8>>,
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray1<i8>>,
    Bound<'py, PyArray1<i32>>,
    Bound<'py, PyArray1<u32>>,
);

/// Executes grasps, `[N, 7]`, each in a fresh copy of the scene. `targets` has the object of each; without them it is
/// the one that is nearest to the tips. One thread is the caller's.
#[pyfunction]
pub(crate) fn execute<'py>(
    py: Python<'py>,
    scene: &Scene,
    workspace_from_grasp: PyReadonlyArray2<'py, f32>,
    targets: Option<PyReadonlyArray1<'py, u32>>,
    simulation: &Simulation,
    threads: usize,
) -> PyResult<Executed<'py>> {
    room(ATTEMPT_BYTES * workspace_from_grasp.as_array().len())?;
    let (scene, grasps) = (&scene.scene, poses(&workspace_from_grasp));
    let targets: Vec<usize> = match targets {
        Some(targets) => targets.as_array().iter().map(|target| *target as usize).collect(),
        None => grasps.iter().map(|grasp| scene.nearest(grasp.translation).unwrap_or(usize::MAX)).collect(),
    };
    if let Some(target) = targets.iter().find(|target| **target >= scene.objects.len()) {
        let text = if *target == usize::MAX {
            "the scene has no objects".to_owned()
        } else {
            format!("targets must be below the number of objects, {}, got {target}", scene.objects.len())
        };
        return Err(wrong(text));
    }
    let asked: Vec<(Pose, usize)> = grasps.into_iter().zip(targets).collect();
    let mut ended: Vec<Execution> = reserved(asked.len()).map_err(|failure| raised(&failure))?;
    for some in asked.chunks(TOGETHER) {
        py.check_signals()?;
        let work = || {
            let world = AttemptWorld::new(&simulation.physics, &simulation.gripper, &simulation.procedure, scene);
            let run = |(grasp, target): &(Pose, usize)| world.execute(grasp, *target);
            if threads == 1 {
                return Ok(some.iter().map(run).collect());
            }
            // One by one: some take a hundred times as long as others.
            on_threads(threads, || some.par_iter().with_max_len(1).map(run).collect::<Vec<_>>())
        };
        ended.extend(free(py, work)?);
    }
    let kind = |execution: &Execution| execution.hit.map_or(-1, |hit| place(&HitKind::ALL, &hit.kind) as i8);
    let object = |execution: &Execution| execution.hit.and_then(|hit| hit.object_id).map_or(-1, |id| id as i32);
    Ok((
        array(py, ended.iter().map(|execution| execution.outcome as u8).collect())?,
        array(py, ended.iter().map(|execution| execution.width_m.unwrap_or(f32::NAN)).collect())?,
        array(py, ended.iter().map(kind).collect())?,
        array(py, ended.iter().map(object).collect())?,
        array(py, asked.iter().map(|(_, target)| *target as u32).collect())?,
    ))
}

/// The place of a word among all.
pub(crate) fn place<T: PartialEq>(all: &[T], one: &T) -> usize {
    all.iter().position(|other| other == one).unwrap_or(0)
}
