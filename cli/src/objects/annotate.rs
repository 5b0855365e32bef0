//! `graspmill objects annotate`: labelled grasps of objects alone, with a table of the results.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use clap::{Args, value_parser};
use generator::{AnnotateParams, Annotated, GraspShares, annotate, relabel};
use indicatif::ProgressBar;
use inspect::{given_grasps, grasp_sets, grasps_info, grasps_table};
use network::checkpoint::digest;
use program::text::percent;
use program::{
    Context as _, ExitCode, Failure, FolderLock, differences, print, print_error, start_threads, stop_on_signals, write,
};
use report::document::{Block, Cell, Document, Table};
use schema::{GripTest, Gripper, Pose};
use serde_json::{Value, json};

use super::import::{MeshOptions, tell, tell_left_out};
use crate::dataset::browse::grasp_pages;
use crate::parse::{between, one_of, others_do};
use crate::planning::gripper::named;
use crate::progress::style;

/// The largest `NAME.json` and `NAME.parquet` that are read.
const BYTES_MAX: [u64; 2] = [1 << 26, 1 << 30];

/// Label grasps of objects that float: drawn over their whole surface, executed, and, if asked, measured
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Meshes and descriptions, folders of them (as for objects import), and catalogues (.toml)
    #[arg(required = true, value_name = "MESH|FOLDER|CATALOGUE")]
    objects: Vec<PathBuf>,

    /// Folder for an object's files: NAME.parquet, NAME.json, and NAME.FORMAT with an ending for each --format
    #[arg(long, value_name = "DIR")]
    out: PathBuf,

    /// The gripper: a built-in name, or the path of a file that ends in .toml (docs/own-gripper.md)
    #[arg(long, value_name = "GRIPPER", default_value = "parallel_jaw_80")]
    gripper: String,

    /// Grasps of each object
    #[arg(long, value_name = "N", default_value_t = 2_000, value_parser = value_parser!(u32).range(1..=1_000_000))]
    grasps: u32,

    /// Go on until so many hold, and keep only those
    #[arg(long)]
    held_only: bool,

    /// Keep only so many of those that hold: the strongest of which none is within 20 mm and 30 degrees of a stronger
    /// one, strongest first; with --margins
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(1..=1_000_000))]
    best: Option<u32>,

    /// What the object must bear in the gripper: lift (its weight, under the gripper), turn (its weight in six
    /// directions), tug (GraspDataGen's pulls) or shake (as ACRONYM)
    #[arg(long, default_value = "turn", value_parser = one_of!(GripTest))]
    test: GripTest,

    /// Where the open gripper would touch the object on its way, push it aside, at most so far; more is a collision,
    /// and with 0 every touch
    #[arg(long, value_name = "METRES", default_value_t = 0.003, value_parser = between(0.0..=0.02_f32))]
    touch: f32,

    /// Shares of grasps between facing points, along normals, and displaced by up to 30 mm and 30 degrees
    #[arg(long, value_name = "A,N,D", default_value = "0.8,0.1,0.1", value_parser = shares)]
    shares: GraspShares,

    /// Measure for each grasp that holds the smallest friction and the strongest pull at which it does
    #[arg(long)]
    margins: bool,

    /// Repeat each grasp up to so often with errors as a calibration and a camera leave them, twice where all end
    /// alike, and give the share that holds; 0 for none
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = value_parser!(u32).range(0..=1_000))]
    repeats: u32,

    /// Drops that find the poses in which an object stands or lies; 0 for none
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = value_parser!(u32).range(0..=10_000))]
    drops: u32,

    /// Label the grasps of this file of one object instead of drawing some, and say how far its labels agree:
    /// NAME.parquet, or with the Python package ACRONYM's .h5, GraspGen's .json, isaac_grasp's .yaml, MolmoSpaces' .npz
    /// or GraspNet's .npy
    #[arg(long, value_name = "FILE", conflicts_with_all = ["grasps", "held_only", "best", "shares"])]
    relabel: Option<PathBuf>,

    /// Also write the sets of --out in these forms, with the Python package: acronym, graspgen, isaac_grasp,
    /// molmospaces, graspnet
    #[arg(long, value_name = "FORMAT,...")]
    format: Option<String>,

    /// Also write the pages of dataset browse into the folder pages of --out: each object with its grasps and replays
    #[arg(long)]
    pages: bool,

    /// Seed of every grasp
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,

    /// Worker threads [default: one per core]
    #[arg(long, value_name = "N", value_parser = value_parser!(u16).range(1..=4096))]
    threads: Option<u16>,

    #[command(flatten)]
    options: MeshOptions,
}

/// Three shares of at least 0 that are not all 0.
fn shares(text: &str) -> Result<GraspShares, String> {
    let numbers: Result<Vec<f32>, String> = text.split(',').map(|part| between(0.0..=1.0_f32)(part.trim())).collect();
    match numbers.as_deref() {
        Ok(&[antipodal, normal, displaced]) if antipodal + normal + displaced > 0.0 => {
            Ok(GraspShares { antipodal, normal, displaced })
        }
        _ => Err(format!("must be three numbers from 0 to 1 that are not all 0, got {text}")),
    }
}

impl Arguments {
    fn params(&self, gripper: Gripper) -> AnnotateParams {
        AnnotateParams {
            gripper,
            grasps: self.grasps as usize,
            is_held_only: self.held_only,
            best: self.best,
            shares: self.shares,
            test: self.test,
            touch_m_max: self.touch,
            margins: self.margins || self.best.is_some(),
            repeats: self.repeats,
            drops: self.drops,
            seed: self.seed,
            ..AnnotateParams::default()
        }
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    if arguments.format.is_some() {
        return Err(others_do("writes --format", "[grasps]"));
    }
    let mut params = arguments.params(named(&arguments.gripper)?);
    let given = arguments.relabel.as_deref().map(given_grasps).transpose()?;
    if let Some(given) = &given {
        params.grasps = given.len();
    }
    start_threads(arguments.threads)?;
    let on_first = || print_error("stopping: abandoning the object under way; a second signal stops at once");
    let stop = stop_on_signals(on_first).context("failed to listen for signals")?;
    let bar = ProgressBar::new_spinner();
    let import = arguments.options.params();
    let check = |name: &str| check_params(&arguments.out, name, &params);
    let read = Annotated::read(&arguments.objects, &import, &check, &|file, _| tell(&bar, file));
    bar.finish_and_clear();
    let (objects, left_out) = read?;
    tell_left_out(&left_out);
    if given.is_some() && objects.len() != 1 {
        let text = format!("--relabel needs one object, whose grasps the file has; there are {}", objects.len());
        return Err(Failure::new(ExitCode::Config, text));
    }
    let _lock = FolderLock::take(&arguments.out)?;
    // All are asked for before the first is made: a refusal must not come after hours.
    let plan = |object: &Annotated| -> Result<_, Failure> {
        let settings = settings(object, &params, given.as_deref());
        Ok((earlier(&arguments.out, object.object.body.name(), &settings)?, settings))
    };
    let planned = objects.iter().map(plan).collect::<Result<Vec<_>, _>>()?;
    let bar = ProgressBar::new((objects.len() * params.grasps) as u64).with_style(style("grasps"));
    let mut infos = Vec::new();
    for (number, (object, (done, settings))) in objects.iter().zip(planned).enumerate() {
        let begun = (number * params.grasps) as u64;
        bar.set_position(begun);
        bar.set_message(object.object.body.name().to_owned());
        let mut go_on = |made: usize| {
            bar.set_position(begun + made as u64);
            !stop.load(Ordering::Relaxed)
        };
        let info = match done {
            Some(done) => Some(done),
            None => made(object, &params, given.as_deref(), settings, &arguments.out, &mut go_on)?,
        };
        let Some(info) = info else {
            bar.finish_and_clear();
            print_error(&format!("stopped: {number} of {} objects are complete; run again to go on", objects.len()));
            return Ok(ExitCode::TryAgain);
        };
        infos.push(info);
    }
    bar.finish_and_clear();
    let mut code = if left_out.is_empty() { ExitCode::Ok } else { ExitCode::Partial };
    if arguments.pages && !infos.is_empty() {
        let (out, names) = (&arguments.out, grasp_sets(&arguments.out)?);
        let made = grasp_pages(out, &names, &out.join("pages"), true)?;
        code = if made == ExitCode::Ok { code } else { made };
    }
    print(document(&infos, left_out.len(), &arguments.out).text())?;
    Ok(code)
}

/// Annotates an object and writes its files; what its `NAME.json` says, or nothing if a signal came.
fn made(
    object: &Annotated,
    params: &AnnotateParams,
    given: Option<&[Pose]>,
    settings: Value,
    out: &Path,
    go_on: &mut dyn FnMut(usize) -> bool,
) -> Result<Option<Value>, Failure> {
    let set = match given {
        Some(given) => relabel(object, params, given, go_on),
        None => annotate(object, params, go_on),
    };
    let Some(set) = set else { return Ok(None) };
    let table = grasps_table(&set)?;
    let mut info = grasps_info(&set);
    info["settings_sha256"] = json!(digest(settings.to_string().as_bytes()));
    info["settings"] = settings;
    info["table_sha256"] = json!(digest(&table));
    let [about, path] = files(out, object.object.body.name());
    write(&path, table)?;
    // The last file: an object is complete if it is there, and the table is the one that it means.
    write(&about, format!("{info:#}\n"))?;
    Ok(Some(info))
}

/// `NAME.json` and `NAME.parquet`.
fn files(out: &Path, name: &str) -> [PathBuf; 2] {
    ["json", "parquet"].map(|ending| out.join(format!("{name}.{ending}")))
}

/// Everything that a set depends on.
fn settings(object: &Annotated, params: &AnnotateParams, given: Option<&[Pose]>) -> Value {
    let body = &object.object.body;
    let body = body.mesh().map_or_else(|| format!("{body:?}"), |mesh| format!("{body:?} {mesh:?}"));
    json!({
        "code_version": env!("CARGO_PKG_VERSION"),
        "params": params,
        // No part of a gripper's stored form, and files of others depend on it.
        "flange_from_grasp_m": params.gripper.flange_from_grasp.map(|flange| flange.position_m),
        "physics": generator::PHYSICS,
        "procedure": generator::PROCEDURE,
        "file": object.file,
        "file_sha256": object.file_sha256,
        "scale_m": object.scale_m,
        "origin_m": object.origin_m.to_array(),
        "mass_kg": object.object.mass_kg,
        "friction": object.object.friction,
        "body_sha256": digest(body.as_bytes()),
        "given_sha256": given.map(|given| digest(format!("{given:?}").as_bytes())),
    })
}

/// What an earlier run with these settings said of an object, if both files are as it wrote them. If one is not, a line
/// says so, and they are made again; other settings are an error.
fn earlier(out: &Path, name: &str, settings: &Value) -> Result<Option<Value>, Failure> {
    let [about, table] = files(out, name);
    let info: Value = serde_json::from_slice(&own_bytes(&about, BYTES_MAX[0])?).unwrap_or_default();
    let text = settings.to_string();
    let has_settings = info["settings_sha256"] == digest(text.as_bytes());
    if has_settings && info["table_sha256"] == digest(&own_bytes(&table, BYTES_MAX[1])?) {
        return Ok(Some(info));
    }
    // What was read of a text may differ in rounding from what the text was made of.
    let here: Value = serde_json::from_str(&text).unwrap_or_default();
    let others = differences("settings", &info["settings"], &here);
    if !(has_settings || info.is_null() || others.is_empty()) {
        return Err(refused(&others, &about));
    }
    if [&about, &table].into_iter().any(|path| fs::symlink_metadata(path).is_ok()) {
        let faulty = if has_settings { table } else { about };
        print_error(&format!("made again, for it is missing, cut, changed or a link: {}", faulty.display()));
    }
    Ok(None)
}

/// Refuses other parameters for a mesh before it is cut, which may take minutes; [`earlier`] compares the rest.
fn check_params(out: &Path, name: &str, params: &AnnotateParams) -> Result<(), Failure> {
    let [about, _] = files(out, name);
    let info: Value = serde_json::from_slice(&own_bytes(&about, BYTES_MAX[0])?).unwrap_or_default();
    let here: Value = serde_json::from_str(&json!(params).to_string()).unwrap_or_default();
    let there = &info["settings"]["params"];
    let others = differences("settings.params", there, &here);
    if there.is_null() || others.is_empty() { Ok(()) } else { Err(refused(&others, &about)) }
}

fn refused(others: &[String], about: &Path) -> Failure {
    let (others, about) = (others.join("; "), about.display());
    let text = format!("--out holds grasps of another object or with other settings: {others}: {about}");
    Failure::new(ExitCode::Config, text)
}

/// The bytes of a file; none where there is no file but a link, or nothing.
fn own_bytes(path: &Path, bytes_max: u64) -> Result<Vec<u8>, Failure> {
    if !fs::symlink_metadata(path).is_ok_and(|there| there.is_file()) {
        return Ok(Vec::new());
    }
    program::read(path, bytes_max).context(format_args!("failed to read {}", path.display()))
}

fn document(infos: &[Value], left_out: usize, out: &Path) -> Document {
    let number = |info: &Value, at: &str| info.pointer(at).and_then(Value::as_u64).unwrap_or(0);
    let name = |info: &Value| info["object"]["name"].as_str().unwrap_or_default().to_owned();
    let head = ["object", "grasps", "held", "slipped", "empty", "collisions", "pushed", "P(held)", "covered", "poses"];
    let row = |info: &Value| {
        let of = |outcome: &str| number(info, &format!("/outcomes/{outcome}"));
        let collisions = of("pregrasp_collision") + of("approach_collision");
        let [grasps, pushed] = ["/grasps", "/pushed"].map(|at| number(info, at));
        let counts = [grasps, of("held"), of("slipped"), of("empty"), collisions, pushed].map(Cell::Count);
        let share = |of: &str| Cell::Number(info[of].as_f64().map_or("-".to_owned(), percent));
        let poses = info["stable_poses"].as_array().map_or(0, Vec::len);
        let last = [share("p_held"), share("coverage"), Cell::Count(poses as u64)];
        [Cell::from(name(info))].into_iter().chain(counts).chain(last).collect()
    };
    let few = infos.iter().filter_map(|info| {
        let of = |key: &str| number(info, &format!("/settings/params/{key}"));
        let (made, all, best) = (number(info, "/grasps"), of("grasps"), of("best"));
        let (wanted, why) = match best {
            0 => (all, "the gripper finds no more between two of its sides"),
            _ => (best, "no more of those that hold are apart"),
        };
        (made < wanted).then(|| format!("{}: {made} grasps instead of {wanted}: {why}", name(info)))
    });
    let said = |info: &Value| {
        let texts = info["object"]["warnings"].as_array().into_iter().flatten().filter_map(Value::as_str);
        texts.map(|text| format!("{}: {text}", name(info))).collect::<Vec<_>>()
    };
    let [grasps, held] = ["/grasps", "/outcomes/held"].map(|at| infos.iter().map(|info| number(info, at)).sum::<u64>());
    let plural = if infos.len() == 1 { "" } else { "s" };
    let blocks = vec![
        Block::Table(Table::new(head, infos.iter().map(row))),
        Block::Warnings(infos.iter().flat_map(said).chain(few).collect()),
        Block::Text(format!(
            "{grasps} grasps of {} object{plural}, {held} held, in {}; {left_out} left out",
            infos.len(),
            out.display()
        )),
    ];
    Document { blocks, ..Document::default() }
}
