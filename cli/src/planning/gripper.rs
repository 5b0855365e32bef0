//! `graspmill gripper`: a hand's measures, to be compared with the real hand.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use program::{ExitCode, Failure, print, write};
use report::hand;
use schema::{FingerTip, Gripper};
use settings::{Document, Value, settings};

/// Show a gripper's measures, and draw it, to compare it with the real one
#[derive(Debug, Args)]
#[command(after_help = ExitCode::HELP)]
pub(crate) struct Arguments {
    /// A built-in name, or the path of a file that ends in .toml (docs/own-gripper.md)
    #[arg(value_name = "GRIPPER")]
    hand: String,

    /// Draw the hand from two sides, with its measures and the grasp frame's axes
    #[arg(long, value_name = "SVG")]
    picture: Option<PathBuf>,
}

settings! {
    /// What names the hand.
    struct Named {
        gripper: Gripper; by Gripper::read_named as "a hand's name, a path that ends in .toml, or what such a file has",
    }
}

/// The hand that an argument names.
pub(crate) fn named(hand: &str) -> Result<Gripper, Failure> {
    let mut document = Document::parse("", Path::new("HAND"))?;
    document.table_mut().insert("gripper".to_owned(), Value::String(hand.to_owned()));
    Ok(document.read::<Named>()?.gripper)
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let gripper = named(&arguments.hand)?;
    if let Some(path) = &arguments.picture {
        write(path, hand::svg(&gripper))?;
    }
    print(table(&gripper))?;
    Ok(ExitCode::Ok)
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
