//! The command line.

use std::net::IpAddr;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use planner::Policy;
use program::manual::Manual;

/// Plans grasps from what a robot sees.
#[derive(Debug, Parser)]
#[command(version, after_help = format!("{EXAMPLES}\n\n{}", program::ExitCode::HELP))]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// From depth images, a TSDF or a cloud to ranked grasps, as JSON
    #[command(after_help = format!("{VIEWS_FILE}\n\n{EXAMPLES}\n\n{}", program::ExitCode::HELP))]
    Plan(Box<PlanArguments>),
    /// The same over HTTP
    #[command(after_help = program::ExitCode::HELP)]
    Serve(ServeArguments),
    /// What a plan costs on this machine
    #[command(after_help = program::ExitCode::HELP)]
    Bench(BenchArguments),
    /// Write shell completions, man pages, or this program's reference
    #[command(subcommand)]
    Manual(Manual),
}

/// The network and the settings.
#[derive(Debug, Args)]
pub(crate) struct PlannerArguments {
    /// Checkpoint of the network [default: the built-in models/paper-200k.safetensors]
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,

    /// Settings [default: the built-in configs/plan/paper.toml]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,

    /// Threads; never changes the plan [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
}

#[derive(Debug, Args)]
#[group(id = "source", required = true, multiple = false, args = ["views", "tsdf", "cloud", "demo"])]
pub(crate) struct PlanArguments {
    /// File (TOML or JSON) that names depth images and cameras, and may hold wishes; see below
    #[arg(long, value_name = "FILE")]
    pub views: Option<PathBuf>,

    /// NPY file of a TSDF in VGN's values, [40, 40, 40] or [1, 40, 40, 40]
    #[arg(long, value_name = "FILE")]
    pub tsdf: Option<PathBuf>,

    /// Point cloud in the workspace frame: PLY, PCD or NPY, in metres
    #[arg(long, value_name = "FILE")]
    pub cloud: Option<PathBuf>,

    /// The scene that comes with the program
    #[arg(long)]
    pub demo: bool,

    /// Of earlier versions: refused, with the way that replaced it
    #[arg(long, value_name = "DIR|URL", hide = true, value_parser = no_dataset)]
    pub dataset: Option<String>,

    /// From where the cloud was seen, again for each place [default: a PCD file's viewpoint, else straight above]
    #[arg(long, value_name = "X,Y,Z", requires = "cloud", value_parser = numbers::<3>, allow_hyphen_values = true)]
    pub eye: Vec<[f64; 3]>,

    /// How grasps are ranked: paper, vgn-random, vgn-best or flattest [default: the settings']
    #[arg(long, value_name = "NAME")]
    pub policy: Option<Policy>,

    /// Most grasps to give [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub grasps: Option<u32>,

    /// Drop grasps whose hand would hit the cloud on its way
    #[arg(long)]
    pub check_collisions: bool,

    /// Tell why candidates were dropped
    #[arg(long)]
    pub explain: bool,

    /// The workspace in the robot's base frame: grasps are given there, too
    #[arg(long, value_name = "X,Y,Z,QX,QY,QZ,QW", value_parser = numbers::<7>, allow_hyphen_values = true)]
    pub base_from_workspace: Option<[f64; 7]>,

    /// The wrist's orientation in the workspace; of a grasp and its half turn the nearer is given [default: straight
    /// down, x along the workspace's]
    #[arg(long, value_name = "QX,QY,QZ,QW", value_parser = numbers::<4>, allow_hyphen_values = true)]
    pub wrist: Option<[f64; 4]>,

    /// Write the plan here instead of to standard output
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,

    /// Draw the scene and its grasps
    #[arg(long, value_name = "PNG")]
    pub picture: Option<PathBuf>,

    /// Write the segmented cloud, for MeshLab, CloudCompare, or scripts/plan_rrd.py
    #[arg(long, value_name = "PLY")]
    pub ply: Option<PathBuf>,

    /// Print no summary
    #[arg(long, short)]
    pub quiet: bool,

    #[command(flatten)]
    pub planner: PlannerArguments,
}

#[derive(Debug, Args)]
pub(crate) struct ServeArguments {
    /// Address to listen on. There are no passwords: anyone who reaches it may use it
    #[arg(long, default_value = "127.0.0.1")]
    pub host: IpAddr,

    /// Port; 0 for any that is free
    #[arg(long, default_value_t = 8040)]
    pub port: u16,

    /// Largest request
    #[arg(long, value_name = "MIB", default_value_t = 64, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub body_mib_max: u16,

    /// Seconds from a request to its answer, at most
    #[arg(long, value_name = "S", default_value_t = 30, value_parser = clap::value_parser!(u16).range(1..=3600))]
    pub timeout_s: u16,

    /// Plans made at once
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub concurrent: u16,

    /// Plans that may wait; more are turned away
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u16).range(0..=1024))]
    pub queue: u16,

    #[command(flatten)]
    pub planner: PlannerArguments,
}

#[derive(Debug, Args)]
pub(crate) struct BenchArguments {
    /// How often to plan
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub plans: u32,

    /// Depth images and cameras [default: the demo]
    #[arg(long, value_name = "FILE")]
    pub views: Option<PathBuf>,

    /// Print JSON
    #[arg(long)]
    pub json: bool,

    #[command(flatten)]
    pub planner: PlannerArguments,
}

/// A robot's planner reads no datasets.
fn no_dataset(dataset: &str) -> Result<String, String> {
    Err(format!(
        "the planner reads no datasets: shards tsdf {dataset} --scene N --out scene.npy, then --tsdf scene.npy"
    ))
}

/// So many numbers with commas between them.
fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let read: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse::<f64>()).collect();
    let read = read.map_err(|e| format!("not a number: {e}"))?;
    let count = read.len();
    read.try_into().map_err(|_| format!("must be {N} numbers with commas between them, got {count}"))
}

const EXAMPLES: &str = "\
Examples:
  planner plan --demo --picture demo.png
  planner plan --views views.toml --check-collisions --out plan.json
  planner plan --cloud table.pcd --eye 0.15,-0.4,0.5 --explain
  shards tsdf grasps --scene 7 --out scene.npy && planner plan --tsdf scene.npy --policy vgn-best
  planner plan --demo --out plan.json --ply cloud.ply && python scripts/plan_rrd.py plan.json --cloud cloud.ply --out plan.rrd
  planner serve --port 8040
  planner bench

A plan without grasps is a plan, and says why: exit code 0.";

const VIEWS_FILE: &str = "\
A views file, in TOML (JSON has the same keys); lengths in metres, quaternions x, y, z, w:
  intrinsics = { fx_px = 540.0, fy_px = 540.0, cx_px = 320.0, cy_px = 240.0 }
  [[views]]
  depth = \"depth-0.png\"       # 16-bit PNG, NPY or EXR; beside this file
  depth_scale_m = 0.001       # metres a unit
  workspace_from_camera = { position_m = [0.15, -0.2, 0.5], quaternion_xyzw = [-0.954, 0.0, 0.0, 0.301] }
Instead of intrinsics for all, each view may have its own. A pose may be a matrix of 4 rows. With base_from_workspace, views may
have base_from_camera instead. tsdf or cloud (with eyes_m) may stand in place of views. The wishes policy, grasps_max,
check_collisions, explain and workspace_from_wrist may be there, too; the command line's count more (a flag cannot switch off).";
