//! `graspmill plan`: an observation to ranked grasps.

use std::path::{Path, PathBuf};

use clap::Args;
use planner::input::{
    BoxInput, ConeInput, InputError, OrientationInput, PoseInput, PosePartsInput, ReadLens, Request, RequestInput,
    SourceInput, ViewInput, assemble, from_file, read_color, read_file, read_intrinsics,
};
use planner::{Policy, View, demo};
use program::{ExitCode, Failure, json, print, print_error, write};
use schema::Grid;

use super::show::{draw_into, page};
use super::{NetworkArguments, console};
use crate::parse::one_of;

/// Plan grasps from depth images, a TSDF or a cloud
#[derive(Debug, Args)]
#[command(after_help = format!("{VIEWS_FILE}\n\n{EXAMPLES}\n\n{}", ExitCode::HELP))]
#[group(id = "source", required = true, multiple = false, args = ["depth", "views", "tsdf", "cloud", "demo"])]
pub(crate) struct Arguments {
    /// Depth image of one camera, a 16-bit PNG or NPY; the workspace is put on the table that it shows
    #[arg(long, value_name = "FILE", requires = "intrinsics")]
    depth: Option<PathBuf>,

    /// Its camera's intrinsics: a matrix, or fx_px, fy_px, cx_px, cy_px in JSON or TOML; with the Python package also a
    /// ROS CameraInfo, a RealSense profile, or what Open3D or OpenCV wrote
    #[arg(long, value_name = "FILE", requires = "depth")]
    intrinsics: Option<PathBuf>,

    /// Metres per unit of the depth image [default: 0.001 for integers, 1 for floats]
    #[arg(long, value_name = "M", requires = "depth")]
    depth_scale: Option<f64>,

    /// The camera in the workspace, if that is known
    #[arg(long, value_name = "X,Y,Z,QX,QY,QZ,QW", requires = "depth", value_parser = numbers::<7>, allow_hyphen_values = true)]
    workspace_from_camera: Option<[f64; 7]>,

    /// What to grasp in the depth image: an image of its size, not 0 where the target is
    #[arg(long, value_name = "FILE", requires = "depth")]
    mask: Option<PathBuf>,

    /// Direction of gravity in the frame of the camera or the cloud, to find the table [default: the camera stands
    /// upright and looks down]
    #[arg(long, value_name = "X,Y,Z", value_parser = numbers::<3>, allow_hyphen_values = true)]
    down: Option<[f64; 3]>,

    /// The first camera, or the cloud's, in the robot's base frame, where the table is found: grasps are returned in
    /// the base's frame too, and gravity is along its -z
    #[arg(long, value_name = "X,Y,Z,QX,QY,QZ,QW", value_parser = numbers::<7>, allow_hyphen_values = true)]
    base_from_camera: Option<[f64; 7]>,

    /// File (TOML or JSON) that names depth images and cameras, and may hold options; see below
    #[arg(long, value_name = "FILE")]
    views: Option<PathBuf>,

    /// NPY file of a TSDF in VGN's values, [40, 40, 40] or [1, 40, 40, 40]; as many as --workspace-size takes
    #[arg(long, value_name = "FILE")]
    tsdf: Option<PathBuf>,

    /// Point cloud in the workspace frame: NPY, with the Python package also PLY or PCD, in metres
    #[arg(long, value_name = "FILE")]
    cloud: Option<PathBuf>,

    /// Cloud of what to grasp, in the frame of --cloud, which has the rest of the scene
    #[arg(long, value_name = "FILE", requires = "cloud", conflicts_with = "target")]
    object: Option<PathBuf>,

    /// The cloud's frame in the workspace, or table: it is in its camera's frame, and the workspace is put on the table
    #[arg(long, value_name = "table|POSE", requires = "cloud", value_parser = place, allow_hyphen_values = true)]
    workspace_from_cloud: Option<PoseInput>,

    /// The built-in scene
    #[arg(long)]
    demo: bool,

    /// Where the cloud was seen from; repeat for several places [default: a PCD file's viewpoint, else straight above]
    #[arg(long, value_name = "X,Y,Z", requires = "cloud", value_parser = numbers::<3>, allow_hyphen_values = true)]
    eye: Vec<[f64; 3]>,

    /// How grasps are ranked: paper, vgn-random or vgn-best [default: the settings']
    #[arg(long, value_name = "NAME", value_parser = one_of!(Policy))]
    policy: Option<Policy>,

    /// Most grasps to return [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    grasps: Option<u32>,

    /// Drop grasps at which the gripper would hit the cloud on its way
    #[arg(long)]
    check_collisions: bool,

    /// The best grasp of each object first, then the others
    #[arg(long)]
    each: bool,

    /// The best grasp of the last plan, in the frame of --avoid: of grasps about as good as the best, the nearest to it
    /// comes first
    #[arg(long, value_name = "X,Y,Z,QX,QY,QZ,QW", value_parser = numbers::<7>, allow_hyphen_values = true)]
    previous: Option<[f64; 7]>,

    /// Report why candidates were dropped
    #[arg(long)]
    explain: bool,

    /// Side of a judge's workspace, 0.2 to 1.2 m, in which objects stand and are grasped [default: what is seen within
    /// reach]
    #[arg(long, value_name = "M")]
    workspace_size: Option<f64>,

    /// The workspace in the robot's base frame: grasps are returned in that frame too
    #[arg(long, value_name = "X,Y,Z,QX,QY,QZ,QW", value_parser = numbers::<7>, allow_hyphen_values = true)]
    base_from_workspace: Option<[f64; 7]>,

    /// The wrist's orientation in the workspace: of a grasp and its half turn, the nearer one is returned [default:
    /// straight down, x along the workspace's]
    #[arg(long, value_name = "QX,QY,QZ,QW", value_parser = numbers::<4>, allow_hyphen_values = true)]
    wrist: Option<[f64; 4]>,

    /// A grasp that failed, in the workspace: no grasp within 10 mm and 30° of it is returned; repeat for several
    #[arg(long, value_name = "X,Y,Z,QX,QY,QZ,QW", value_parser = numbers::<7>, allow_hyphen_values = true)]
    avoid: Vec<[f64; 7]>,

    /// A thing to be left for now: no grasp whose tips are within the radius of this point, in the workspace or, where
    /// the table is found, in the first camera's frame; repeat for several
    #[arg(long, value_name = "X,Y,Z,RADIUS", value_parser = numbers::<4>, allow_hyphen_values = true)]
    avoid_object: Vec<[f64; 4]>,

    /// Only grasps of the object at this point of the workspace; masks of single objects go into the views file
    #[arg(long, value_name = "X,Y,Z", value_parser = numbers::<3>, allow_hyphen_values = true)]
    target: Option<[f64; 3]>,

    /// Only grasps that approach within an angle, in radians, of a direction of the workspace: 0,0,-1,0.5 is down
    /// within 29°
    #[arg(long, value_name = "X,Y,Z,RAD", value_parser = numbers::<4>, allow_hyphen_values = true)]
    approach: Option<[f64; 4]>,

    /// A plane that the open gripper does not cross on its way: its normal, which points to where the gripper may be,
    /// and its offset in metres; repeat for several. 0,1,0,0.05 keeps the gripper at y of 50 mm or more
    #[arg(long, value_name = "NX,NY,NZ,OFFSET", value_parser = numbers::<4>, allow_hyphen_values = true)]
    keep_out: Vec<[f64; 4]>,

    /// Only grasps whose tips are within this box of the workspace: its lower and its upper corner
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", value_parser = numbers::<6>, allow_hyphen_values = true)]
    reach: Option<[f64; 6]>,

    /// Write the plan here, as JSON
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,

    /// Print the plan as JSON, and the table to standard error
    #[arg(long)]
    json: bool,

    /// Write the scene and its grasps as a page, to be turned about
    #[arg(long, value_name = "HTML")]
    html: Option<PathBuf>,

    /// Draw the best grasps into the first camera's image: into --color, else into its depth, in grey
    #[arg(long, value_name = "PNG")]
    overlay: Option<PathBuf>,

    /// The colour image that belongs to the first depth image, PNG or JPEG
    #[arg(long, value_name = "FILE", requires = "overlay")]
    color: Option<PathBuf>,

    /// Print no table
    #[arg(long, short)]
    quiet: bool,

    #[command(flatten)]
    network: NetworkArguments,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let planner = arguments.network.planner()?;
    let Request { observation, options, warnings } = request(arguments, planner.grid)?;
    let mut plan = planner.plan(&observation, &options)?;
    plan.warnings.extend(warnings);
    if let Some(path) = &arguments.html {
        write(path, page(&plan, &planner.config.gripper, &title(arguments)))?;
    }
    if let Some(path) = &arguments.overlay {
        let read =
            |path: &PathBuf| read_color(&read_file(path)?).map_err(|error| error.at(&path.display().to_string()));
        let color = arguments.color.as_ref().map(read).transpose()?;
        let first = observation.images().and_then(<[View]>::first);
        write(path, draw_into(color, first, &plan, &planner.config.gripper)?)?;
    }
    if let Some(path) = &arguments.out {
        write(path, json(&plan)?)?;
    }
    if arguments.json {
        print(json(&plan)?)?;
    }
    let table = console::summary(&plan);
    match (arguments.quiet, arguments.json) {
        (true, _) => {}
        (false, true) => print_error(table.trim_end()),
        (false, false) => print(table)?,
    }
    Ok(ExitCode::Ok)
}

/// What is to be planned: a file's request or one made of flags, which count more than the file.
fn request(arguments: &Arguments, grid: Grid) -> Result<Request, InputError> {
    if let Some(path) = &arguments.views {
        return from_file(path, grid, |input| add_flags(arguments, input));
    }
    let mut input = if arguments.demo { demo::request()? } else { RequestInput::default() };
    let mut warning = None;
    if let (Some(depth), Some(lens_file)) = (&arguments.depth, &arguments.intrinsics) {
        let (intrinsics, said) = lens(lens_file)?;
        warning = said;
        let path = |path: &PathBuf| SourceInput::Path(path.to_string_lossy().into_owned());
        input.views = Some(vec![ViewInput {
            depth: path(depth),
            mask: arguments.mask.as_ref().map(path),
            depth_scale_m: arguments.depth_scale,
            intrinsics: Some(intrinsics),
            workspace_from_camera: Some(arguments.workspace_from_camera.map_or(PoseInput::Table, pose)),
            camera_from_workspace: None,
            base_from_camera: None,
            camera_from_base: None,
            first_from_camera: None,
        }]);
    }
    add_flags(arguments, &mut input);
    let mut request = assemble(&input, Some(Path::new("")), grid)?;
    request.warnings.extend(warning);
    Ok(request)
}

fn add_flags(arguments: &Arguments, input: &mut RequestInput) {
    let source =
        |path: &Option<PathBuf>| path.as_ref().map(|path| SourceInput::Path(path.to_string_lossy().into_owned()));
    set(&mut input.tsdf, source(&arguments.tsdf));
    set(&mut input.cloud, source(&arguments.cloud));
    set(&mut input.object, source(&arguments.object));
    set(&mut input.eyes_m, some(&arguments.eye));
    set(&mut input.workspace_from_cloud, arguments.workspace_from_cloud.clone());
    set(&mut input.down, arguments.down);
    set(&mut input.base_from_camera, arguments.base_from_camera.map(pose));
    set(&mut input.policy, arguments.policy);
    set(&mut input.grasps_max, arguments.grasps.map(|count| count as usize));
    set(&mut input.check_collisions, arguments.check_collisions.then_some(true));
    set(&mut input.each, arguments.each.then_some(true));
    set(&mut input.previous, arguments.previous.map(pose));
    set(&mut input.explain, arguments.explain.then_some(true));
    set(&mut input.workspace_size_m, arguments.workspace_size);
    set(&mut input.base_from_workspace, arguments.base_from_workspace.map(pose));
    set(&mut input.avoid, some(&arguments.avoid).map(|grasps| grasps.into_iter().map(pose).collect()));
    set(&mut input.avoid_objects, some(&arguments.avoid_object));
    set(&mut input.target_m, arguments.target);
    let cone = |[x, y, z, angle_rad_max]: [f64; 4]| ConeInput { direction: [x, y, z], angle_rad_max };
    set(&mut input.approach, arguments.approach.map(cone));
    set(&mut input.keep_out, some(&arguments.keep_out));
    let corners = |[x, y, z, high @ ..]: [f64; 6]| BoxInput { low_m: [x, y, z], high_m: high };
    set(&mut input.reach, arguments.reach.map(corners));
    set(&mut input.workspace_from_wrist, arguments.wrist.map(|quaternion_xyzw| OrientationInput { quaternion_xyzw }));
}

/// A flag counts more than the file.
fn set<T>(key: &mut Option<T>, flag: Option<T>) {
    *key = flag.or(key.take());
}

/// A flag that may be repeated, if it was given.
fn some<T: Clone>(flags: &[T]) -> Option<Vec<T>> {
    (!flags.is_empty()).then(|| flags.to_vec())
}

fn pose([x, y, z, quaternion_xyzw @ ..]: [f64; 7]) -> PoseInput {
    PoseInput::Parts(PosePartsInput { position_m: [x, y, z], quaternion_xyzw })
}

/// A pose, or the word for a table that is to be found.
fn place(text: &str) -> Result<PoseInput, String> {
    if text == "table" { Ok(PoseInput::Table) } else { numbers(text).map(pose) }
}

fn lens(path: &Path) -> Result<ReadLens, InputError> {
    read_intrinsics(&read_file(path)?).map_err(|error| error.at(&path.display().to_string()))
}

fn title(arguments: &Arguments) -> String {
    let path = [&arguments.depth, &arguments.views, &arguments.tsdf, &arguments.cloud].into_iter().flatten().next();
    let name = path.and_then(|path| path.file_name());
    name.map_or_else(|| "demo".to_owned(), |name| name.to_string_lossy().into_owned())
}

/// So many numbers with commas between them.
fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let read: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse::<f64>()).collect();
    let read = read.map_err(|e| format!("not a number: {e}"))?;
    let count = read.len();
    read.try_into().map_err(|_| format!("must be {N} numbers with commas between them, got {count}"))
}

const VIEWS_FILE: &str = "\
A views file, in TOML (JSON has the same keys); lengths in metres, quaternions x, y, z, w:
  intrinsics = { fx_px = 540.0, fy_px = 540.0, cx_px = 320.0, cy_px = 240.0 }
  [[views]]
  depth = \"depth-0.png\"       # 16-bit PNG or NPY; beside this file
  depth_scale_m = 0.001       # metres per unit
  workspace_from_camera = { position_m = [0.15, -0.2, 0.5], quaternion_xyzw = [-0.954, 0.0, 0.0, 0.301] }
Instead of intrinsics for all, each view may have its own. A pose may be a matrix of 4 rows. Instead of workspace_from_camera,
a view may have its inverse camera_from_workspace or, with base_from_workspace, base_from_camera or camera_from_base. With
workspace_from_camera = \"table\" in the first view the table is found, other views have first_from_camera, and base_from_camera
beside the views is the first camera's pose in the base's frame.
tsdf or cloud (with eyes_m) may stand in place of views. The options policy, grasps_max, check_collisions, each, previous, explain, avoid,
workspace_from_wrist, workspace_size_m, avoid_objects, target_m, approach, keep_out and reach may be there, too; the command line takes precedence (a flag cannot switch one off).";

const EXAMPLES: &str = "\
Examples:
  graspmill plan --depth depth.png --intrinsics camera.json --gripper franka_hand --overlay grasps.png
  graspmill plan --demo --html demo.html
  graspmill plan --views views.toml --check-collisions --out plan.json
  graspmill plan --cloud table.npy --eye 0.15,-0.4,0.5 --explain
  graspmill plan --tsdf scene.npy --config paper
  graspmill gripper franka_hand --html gripper.html
  graspmill serve --port 8040

If no grasp is found, the plan says why, and the exit code is still 0. Programs read the plan with --json or from the file of --out.";
