//! Grasps of others, read to be labelled again: GraspGen's JSON, MolmoSpaces' `.npz` and GraspNet's `.npy`. The package
//! reads ACRONYM, `isaac_grasp` and our own table besides (`graspmill.read_grasps`).

use std::io::{Cursor, Read as _};
use std::path::Path;

use program::{Context as _, ExitCode, Failure};
use schema::{Gripper, Mat3, ObjectGrasps, Outcome, Pose, Quat, Vec3};
use serde_json::{Value, json};

use super::foreign::{GRASPNET_DEPTH_M, base_to_tips_m};
use crate::npy;

/// The largest file that is read.
const BYTES_MAX: u64 = 1 << 30;
/// The most grasps of a file.
const GRASPS_MAX: usize = 1_000_000;
/// Rotations have columns of length 1 that are square to each other, up to this.
const ROTATION_ERROR_MAX: f32 = 1e-3;

/// The grasps of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct GivenGrasps {
    /// In the object's frame; the grasp's has +z approach, +y closing, its origin midway between the tips.
    pub object_from_grasps: Vec<Pose>,
    /// Whether each held, if the file says so.
    pub held: Option<Vec<bool>>,
}

impl GivenGrasps {
    /// Reads a file; its ending says whose form it has. Where a file does not say how far its frame is from the tips,
    /// it is as far as the hand's base is.
    ///
    /// # Errors
    /// [`Failure`] if the file cannot be read, is damaged, or has a form that only the package reads.
    pub fn read(path: &Path, gripper: &Gripper) -> Result<Self, Failure> {
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default();
        let parse: fn(&[u8], &Gripper) -> Result<Self, String> = match ending.as_str() {
            "json" => graspgen,
            "npz" => molmospaces,
            "npy" => graspnet,
            _ => {
                let rule = "a file of given grasps must be GraspGen's .json, MolmoSpaces' .npz or GraspNet's .npy; Python's \
                            graspmill.read_grasps reads ACRONYM's .h5, isaac_grasp's .yaml and our .parquet, and writes \
                            GraspGen's";
                return Err(Failure::new(ExitCode::Config, format!("{rule}: {}", path.display())));
            }
        };
        let bytes = program::read(path, BYTES_MAX).context(format_args!("failed to read {}", path.display()))?;
        let wrong = |text: String| Failure::new(ExitCode::Data, format!("{text}: {}", path.display()));
        parse(&bytes, gripper).map_err(wrong)
    }

    /// How far the file's labels agree with those of a set of the same grasps: `given_held`, `same` of `grasps`, and
    /// Cohen's `kappa`, null where one side has one label alone; nothing if the file has no labels.
    #[must_use]
    pub fn agreement(&self, set: &ObjectGrasps) -> Option<Value> {
        let theirs = self.held.as_ref()?;
        let same = theirs.iter().zip(&set.grasps).filter(|(held, grasp)| **held == (grasp.outcome == Outcome::Held));
        let (same, all) = (same.count(), theirs.len() as f64);
        let given_held = theirs.iter().filter(|held| **held).count();
        let [a, b] = [given_held, set.count(Outcome::Held)].map(|held| held as f64 / all);
        let chance = a * b + (1.0 - a) * (1.0 - b);
        let kappa = (chance < 1.0).then(|| (same as f64 / all - chance) / (1.0 - chance));
        Some(json!({ "given_held": given_held, "same": same, "grasps": theirs.len(), "kappa": kappa }))
    }
}

/// Origin at the hand's base, +z approach, +x closing.
fn graspgen(bytes: &[u8], gripper: &Gripper) -> Result<GivenGrasps, String> {
    let file: Value = serde_json::from_slice(bytes).map_err(|error| format!("the file must be JSON, got {error}"))?;
    let depth_m = match &file["gripper"]["depth"] {
        Value::Null => base_to_tips_m(gripper),
        depth => {
            let known = depth.as_f64().filter(|depth_m| (0.0..=10.0).contains(depth_m));
            known.ok_or_else(|| format!("gripper.depth must be from 0 to 10 m, got {depth}"))? as f32
        }
    };
    let list = |name: &str| {
        let list = file["grasps"][name].as_array().filter(|list| list.len() <= GRASPS_MAX);
        list.ok_or_else(|| format!("grasps.{name} must be a list of at most {GRASPS_MAX}"))
    };
    let quarter = core::f32::consts::FRAC_1_SQRT_2;
    let base_from_grasp = Pose::from_parts(Vec3::new(0.0, 0.0, depth_m), Quat::from_xyzw(0.0, 0.0, -quarter, quarter));
    let pose = |(number, rows): (usize, &Value)| {
        let rows: Option<Vec<Vec<f64>>> = serde_json::from_value(rows.clone()).ok();
        let flat =
            rows.filter(|rows| rows.len() == 4 && rows.iter().all(|row| row.len() == 4)).map(|rows| rows.concat());
        let flat = flat.ok_or_else(|| format!("grasps.transforms[{number}] must be four rows of four numbers"))?;
        Ok(of_matrix(number, &flat)? * base_from_grasp)
    };
    let object_from_grasps = list("transforms")?.iter().enumerate().map(pose).collect::<Result<Vec<_>, String>>()?;
    let is_held =
        |value: &Value| value.as_bool().or_else(|| value.as_u64().filter(|one| *one <= 1).map(|one| one == 1));
    let held = list("object_in_gripper")?.iter().map(is_held).collect::<Option<Vec<bool>>>();
    let held = held.filter(|held| held.len() == object_from_grasps.len());
    let rule = || format!("grasps.object_in_gripper must be {} of true and false", object_from_grasps.len());
    Ok(GivenGrasps { held: Some(held.ok_or_else(rule)?), object_from_grasps })
}

/// Our own frame; the file has no labels.
fn molmospaces(bytes: &[u8], _: &Gripper) -> Result<GivenGrasps, String> {
    let broken =
        |error: &dyn std::fmt::Display| format!("the file must be an .npz with the array transforms, got {error}");
    let mut files = zip::ZipArchive::new(Cursor::new(bytes)).map_err(|error| broken(&error))?;
    let file = files.by_name("transforms.npy").map_err(|error| broken(&error))?;
    let mut array = Vec::new();
    file.take(BYTES_MAX).read_to_end(&mut array).map_err(|error| broken(&error))?;
    let rows = npy::rows(&array, &[4, 4], GRASPS_MAX)?;
    let poses = rows.iter().enumerate().map(|(number, flat)| of_matrix(number, flat));
    Ok(GivenGrasps { object_from_grasps: poses.collect::<Result<_, String>>()?, held: None })
}

/// +x approach, +y closing, origin 20 mm behind the tips; the file has scores, and no labels.
fn graspnet(bytes: &[u8], _: &Gripper) -> Result<GivenGrasps, String> {
    let rows = npy::rows(bytes, &[17], GRASPS_MAX)?;
    let pose = |(number, row): (usize, &Vec<f64>)| {
        let [theirs, at_m] = [&row[4..13], &row[13..16]];
        // Ours: x = their −z, y = their y, z = their x.
        let rows = [0, 1, 2].map(|i| [-theirs[3 * i + 2], theirs[3 * i + 1], theirs[3 * i], at_m[i]]);
        let grasp_from_tips = Pose::from_translation(Vec3::new(0.0, 0.0, GRASPNET_DEPTH_M));
        Ok(of_matrix(number, &[rows.concat(), vec![0.0, 0.0, 0.0, 1.0]].concat())? * grasp_from_tips)
    };
    let poses = rows.iter().enumerate().map(pose);
    Ok(GivenGrasps { object_from_grasps: poses.collect::<Result<_, String>>()?, held: None })
}

/// A pose of 16 numbers, row by row.
fn of_matrix(number: usize, flat: &[f64]) -> Result<Pose, String> {
    let at = |row: usize, column: usize| flat[4 * row + column] as f32;
    let column = |c: usize| Vec3::new(at(0, c), at(1, c), at(2, c));
    let turned = Mat3::from_cols(column(0), column(1), column(2));
    let error =
        (turned.transpose() * turned - Mat3::IDENTITY).to_cols_array().into_iter().map(f32::abs).fold(0.0, f32::max);
    // Not a number is no rotation either.
    let is_rigid = error <= ROTATION_ERROR_MAX && turned.determinant() > 0.0 && column(3).is_finite();
    if !is_rigid {
        return Err(format!("grasp {number} must have a rotation and a position, got {flat:?}"));
    }
    Ok(Pose::from_parts(column(3), Quat::from_mat3(&turned).normalize()))
}
