//! `graspmill gripper`: a gripper's measures, to be compared with the real gripper.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use program::{ExitCode, Failure, print, write};
use report::view::{Body, Class, Line, View, flat_points};
use schema::{FingerTip, Gripper, Pose, Quat, Vec3};
use settings::{Document, Value, settings};

/// Show a gripper's measures and its boxes, to compare it with the real one
#[derive(Debug, Args)]
#[command(after_help = ExitCode::HELP)]
pub(crate) struct Arguments {
    /// A built-in name, or the path of a file that ends in .toml (docs/own-gripper.md)
    gripper: String,

    /// Write a page on which the gripper can be turned about: its boxes with their sizes, and the grasp frame's axes
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

settings! {
    /// What names the gripper.
    struct Named {
        gripper: Gripper; by Gripper::read_named as
            "a gripper's name, a path that ends in .toml, or what such a file has",
    }
}

/// The gripper that an argument names.
pub(crate) fn named(gripper: &str) -> Result<Gripper, Failure> {
    let mut document = Document::parse("", Path::new("GRIPPER"))?;
    document.table_mut().insert("gripper".to_owned(), Value::String(gripper.to_owned()));
    Ok(document.read::<Named>()?.gripper)
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let gripper = named(&arguments.gripper)?;
    if let Some(path) = &arguments.html {
        write(path, page(&gripper))?;
    }
    print(table(&gripper))?;
    Ok(ExitCode::Ok)
}

/// The open gripper, pointing down, with the numbers of its file.
fn page(gripper: &Gripper) -> String {
    let mut view = View::new(&gripper.name);
    let down = Pose::from_parts(Vec3::ZERO, Quat::from_xyzw(1.0, 0.0, 0.0, 0.0));
    view.bodies.extend(gripper.open_gripper().iter().map(|part| {
        let [x_mm, y_mm, z_mm] = (2e3 * part.half_m).to_array();
        let label = format!("{x_mm:.1} mm along x, {y_mm:.1} mm along y, {z_mm:.1} mm along z");
        Body::of_box(Class::Gripper, label, part, &[down])
    }));
    let flange_m = gripper.target_from_flange(&Pose::IDENTITY).map(|flange| ("the flange", flange.translation));
    let axes =
        [("x", Vec3::X), ("y: closing", Vec3::Y), ("z: approach", Vec3::Z)].map(|(name, axis)| (name, 0.05 * axis));
    view.lines.extend(axes.into_iter().chain(flange_m).map(|(name, end_m)| {
        let points_m = flat_points([Vec3::ZERO, down.transform_point(end_m)]);
        Line { class: Class::Axes, label: name.to_owned(), points_m, frames: None }
    }));
    for (key, value) in gripper.numbers() {
        view.fact(key, value.to_string());
    }
    view.page()
}

/// The numbers as a table, lengths in millimetres.
fn table(gripper: &Gripper) -> String {
    let mut text = format!("{}\n", gripper.name);
    for (key, value) in gripper.numbers() {
        // Writing into a String cannot fail.
        let _ = match key.strip_suffix("_m").or(key.contains("_m_").then_some(key)) {
            Some(_) if !key.ends_with("_m_s") => writeln!(text, "  {key:<20}{:>8.1} mm", 1e3 * value),
            _ => writeln!(text, "  {key:<20}{value:>8}"),
        };
    }
    if let Some(FingerTip { thickness_m, length_m }) = gripper.finger_tip {
        let [thickness_mm, length_mm] = [thickness_m, length_m].map(|part_m| 1e3 * part_m);
        let _ = writeln!(text, "  finger_tip          {thickness_mm:>8.1} mm thick, {length_mm:.1} mm long");
    }
    text += &gripper.flange_from_grasp.map_or_else(
        || "  no flange_from_grasp: plans give no poses of the flange\n".to_owned(),
        |parts| {
            let [x, y, z] = parts.position_m.map(|along_m| 1e3 * along_m);
            format!("  flange_from_grasp   {x:>8.1} mm, {y:.1} mm, {z:.1} mm; quaternion {:?}\n", parts.quaternion_xyzw)
        },
    );
    text
}
