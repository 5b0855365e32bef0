//! Objects from meshes: each mesh is measured, decomposed into convex parts, measured again, and written to a
//! catalogue.
//!
//! The mass properties of a watertight mesh are exact, but the physics uses its parts. Both are reported side by side,
//! with warnings about anything unusual.

use std::fmt::Write as _;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use clap::Args;
use glamx::DSymmetricEigen3;
use program::{ExitCode, Failure};
use rayon::prelude::*;
use schema::{HullError, MODELS_MAX};
use serde::Serialize;
use simulator::{ConvexParts, PartsParams, convex_parts, few_cornered_hull};

use crate::catalogue::Catalogue;
use crate::config::Config;
use crate::mass_integrals::{MassIntegrals, relative_difference};
use crate::measured::{Measured, integrals_of, overlap_share, smallest_width_m};
use crate::mesh::Seams;
use crate::mesh_file::{ENDINGS, damaged, ending, read_mesh, unusable};
use crate::models::Models;

/// A mesh is convex if its hull is larger by less than this share.
const CONVEX_SHARE: f64 = 0.01;
/// Maximum number of hull corners for measuring the smallest width.
const WIDTH_CORNERS: usize = 64;
/// Maximum concavity of a part, as a share of the longest side.
const CONCAVITY: f32 = 0.002;
/// If an object's longest side is not between these, a warning questions its units.
const PLAUSIBLE_M: [f64; 2] = [0.005, 1.0];
/// Maximum accepted length of the longest side.
const LONGEST_M: f64 = 10.0;
/// Larger differences between mesh and parts cause a warning: volume, inertia, overlap.
const VOLUME_SHARE: f64 = 0.05;
const INERTIA_SHARE: f64 = 0.1;
const OVERLAP_SHARE: f64 = 0.05;
/// Decimals of a corner in a catalogue: a tenth of a micrometre.
const DECIMALS: usize = 7;

/// Friction unless given: wood, card and plastic against rubber.
const FRICTION: f32 = 0.8;
/// Density unless given, in kg/m³: hollow plastic, light wood.
const DENSITY_KG_M3: f64 = 400.0;

/// Settings of the import.
#[derive(Debug, Clone, PartialEq, Args)]
pub struct ImportParams {
    /// Metres per unit of the files: 0.001 for millimetres
    #[arg(long, value_name = "METRES", default_value_t = 1.0, value_parser = positive)]
    scale: f64,

    /// Density of all objects in kg/m3 [default: 400]
    #[arg(long, value_name = "KG/M3", value_parser = positive)]
    density: Option<f64>,

    /// Mass of each object in kg, instead
    #[arg(long, value_name = "KG", conflicts_with = "density", value_parser = positive)]
    mass: Option<f64>,

    /// Friction coefficient of all objects
    #[arg(long, value_name = "MU", default_value_t = FRICTION)]
    friction: f32,

    /// Most convex parts of an object; 1 makes it its convex hull
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u8).range(1..=64))]
    hulls_max: u8,

    /// Most corners of a part; an attempt takes longer with more
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::value_parser!(u8).range(8..=64))]
    corners_max: u8,

    /// Voxels along an object's longest side; objects are cut along voxels
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(16..=256))]
    voxels: u32,
}

/// A number above 0.
fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|e| format!("{e}"))?;
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err(format!("must be above 0, got {text}")) }
}

/// The result of an import.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Imported {
    /// The objects, in the files' order.
    pub objects: Vec<ImportedObject>,
    /// The catalogue's text, which [`Catalogue::parse`] reads.
    #[serde(skip)]
    pub catalogue: String,
}

/// An imported mesh.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ImportedObject {
    /// Its name: the file's without its extension, in lower case.
    pub name: String,
    /// The file.
    pub file: PathBuf,
    /// Triangles with a positive area.
    pub triangles: usize,
    /// Whether it encloses a volume.
    pub is_watertight: bool,
    /// Edges that do not belong to two triangles of opposite direction.
    pub bad_edges: usize,
    /// Full lengths of its bounding box along the file's axes, in metres.
    pub extents_m: [f64; 3],
    /// Volume of the mesh in cubic metres, if it is watertight.
    pub volume_m3: Option<f64>,
    /// Mass in kilograms.
    pub mass_kg: f64,
    /// Centre of mass in the file's frame, in metres: of the mesh if it is watertight, otherwise of the parts.
    pub centre_of_mass_m: [f64; 3],
    /// Principal moments of inertia about it, in kg m², smallest first; of the mesh or of the parts.
    pub inertia_kg_m2: [f64; 3],
    /// Volume of its convex hull in cubic metres.
    pub hull_volume_m3: f64,
    /// Convex parts.
    pub parts: usize,
    /// Largest number of corners of a part.
    pub part_corners_max: usize,
    /// Largest distance in metres by which the mesh lies outside its simplified parts.
    pub simplified_m: f64,
    /// Volume of all parts in cubic metres; overlaps count twice, as in the mass.
    pub parts_volume_m3: f64,
    /// The parts' volume as a share of the mesh's.
    pub parts_volume_share: Option<f64>,
    /// Share of the union of the parts that lies in more than one of them.
    pub parts_overlap_share: f64,
    /// Relative difference of the parts' inertia from the mesh's.
    pub parts_inertia_difference: Option<f64>,
    /// The smallest distance between two parallel planes that enclose the object, in metres.
    pub smallest_width_m: f64,
    /// Whether the open hand spans that distance.
    pub fits_gripper: bool,
    /// Whether it fits the workspace in any orientation.
    pub fits_workspace: bool,
    /// Warnings as text.
    pub warnings: Vec<String>,
}

/// The mesh files of some paths: files as given, and the meshes in folders, sorted by name.
///
/// # Errors
/// For a folder that cannot be listed or has no mesh.
pub fn mesh_files(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut files = Vec::new();
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let shown = path.display();
        let unlisted = |error| unusable(format!("failed to list the folder: {error}: {shown}"));
        let entries = std::fs::read_dir(path).map_err(unlisted)?.collect::<Result<Vec<_>, _>>().map_err(unlisted)?;
        let mut found: Vec<PathBuf> = entries.into_iter().map(|entry| entry.path()).collect();
        found.retain(|file| ending(file).is_some_and(|ending| ENDINGS.contains(&ending.as_str())));
        if found.is_empty() {
            return Err(unusable(format!("there is no .{} file: {shown}", ENDINGS.join(" or ."))));
        }
        found.sort();
        files.extend(found);
    }
    Ok(files)
}

/// Measures and decomposes meshes and makes a catalogue of them. Files are processed in parallel; the result does not
/// depend on the number of threads.
///
/// # Errors
/// With all files that cannot be used.
pub fn import_objects(files: &[PathBuf], params: &ImportParams, config: &Config) -> Result<Imported, Failure> {
    for (place, file) in files.iter().enumerate() {
        let name = name_of(file);
        if let Some(other) = files[..place].iter().find(|other| name_of(other) == name) {
            let (other, file) = (other.display(), file.display());
            return Err(unusable(format!("two files make an object called {name}: {other} and {file}")));
        }
    }
    if files.len() > MODELS_MAX {
        let got = files.len();
        return Err(unusable_files(
            ExitCode::Config,
            &[format!("a dataset has at most {MODELS_MAX} objects, got {got} files")],
        ));
    }
    let made: Vec<_> = files.par_iter().with_max_len(1).map(|file| guarded(file, params, config)).collect();
    let (mut objects, mut catalogue) = (Vec::new(), HEAD.to_owned());
    let (mut problems, mut code) = (Vec::new(), ExitCode::Config); // or `Data`, if a file is damaged
    for one in made {
        match one {
            Ok((object, text)) => {
                objects.push(object);
                catalogue += &text;
            }
            Err(error) => {
                code = code.min(error.exit_code());
                problems.push(error.to_string());
            }
        }
    }
    if !problems.is_empty() {
        return Err(unusable_files(code, &problems));
    }
    // The written text must be readable: masses have limits, and rounded corners must still have hulls.
    let read = Catalogue::parse(&catalogue, Path::new("the new catalogue")).map_err(unusable)?;
    Models::of(&read).map_err(|problems| unusable_files(ExitCode::Config, &problems))?;
    Ok(Imported { objects, catalogue })
}

fn unusable_files(code: ExitCode, problems: &[String]) -> Failure {
    let count = problems.len();
    Failure::new(code, format!("{count} of the files cannot be used:\n  {}", problems.join("\n  ")))
}

const HEAD: &str = "\
# Objects made of meshes by `generator import-objects`; configs/objects/everyday.toml says what the keys mean. Masses, friction
# and names may be changed by hand; sets of objects may be added.
";

/// An object's name: characters that need no quotes in a table or a query.
fn name_of(file: &Path) -> String {
    let stem = file.file_stem().map_or_else(Default::default, |stem| stem.to_string_lossy().to_ascii_lowercase());
    stem.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}

/// The hull library panics on some scans. Such a file is reported, and the others continue.
fn guarded(file: &Path, params: &ImportParams, config: &Config) -> Result<(ImportedObject, String), Failure> {
    let failed = |_| Err(damaged("it cannot be decomposed, because a hull could not be made", file));
    catch_unwind(AssertUnwindSafe(|| import_one(file, params, config))).unwrap_or_else(failed)
}

fn import_one(file: &Path, params: &ImportParams, config: &Config) -> Result<(ImportedObject, String), Failure> {
    let mesh = read_mesh(file, params.scale)?;
    let damaged = |error: HullError| damaged(&error.to_string(), file);
    let measured = Measured::of(mesh);
    let longest_m = measured.extents_m.max_element();
    if longest_m > LONGEST_M {
        let (file, scale) = (file.display(), params.scale * 0.001);
        return Err(unusable(format!(
            "it must be at most {LONGEST_M} m long, got {longest_m} m: in millimetres? --scale {scale}: {file}"
        )));
    }
    let hull_of = |parts_max| {
        let parts = PartsParams {
            parts_max,
            corners_max: params.corners_max.into(),
            resolution: params.voxels,
            concavity: CONCAVITY,
        };
        convex_parts(&measured.corners_m, &measured.mesh.triangles, &parts).map_err(damaged)
    };
    let is_convex =
        measured.solid.is_some_and(|solid| solid.volume_m3 >= (1.0 - CONVEX_SHARE) * measured.hull_volume_m3);
    let parts = hull_of(if is_convex { 1 } else { params.hulls_max.into() })?;
    let object = described(file, params, config, &measured, &parts).map_err(damaged)?;
    let text = catalogue_text(&object, params, &parts);
    Ok((object, text))
}

fn described(
    file: &Path,
    params: &ImportParams,
    config: &Config,
    measured: &Measured,
    parts: &ConvexParts,
) -> Result<ImportedObject, HullError> {
    let of_parts = parts.hulls.iter().map(integrals_of).fold(MassIntegrals::ZERO, |sum, part| sum.plus(&part));
    let balance = measured.solid.unwrap_or(of_parts);
    let density_kg_m3 = params.density.unwrap_or(DENSITY_KG_M3);
    let mass_kg = params.mass.unwrap_or(density_kg_m3 * balance.volume_m3);
    let inertia = balance.inertia_kg_m2(mass_kg);
    let whole = few_cornered_hull(&measured.corners_m, WIDTH_CORNERS)?.0;
    let smallest_width_m = smallest_width_m(&whole, &measured.corners_m);
    let mut object = ImportedObject {
        name: name_of(file),
        file: file.to_owned(),
        triangles: measured.mesh.triangles.len(),
        is_watertight: measured.seams.is_watertight(),
        bad_edges: measured.seams.open_edges + measured.seams.twisted_edges,
        extents_m: measured.extents_m.to_array(),
        volume_m3: measured.solid.map(|solid| solid.volume_m3),
        mass_kg,
        centre_of_mass_m: (balance.centre_m() + measured.middle_m).to_array(),
        inertia_kg_m2: DSymmetricEigen3::eigenvalues(inertia).to_array(),
        hull_volume_m3: measured.hull_volume_m3,
        parts: parts.hulls.len(),
        part_corners_max: parts.hulls.iter().map(|hull| hull.corners_m().len()).max().unwrap_or(0),
        simplified_m: f64::from(parts.simplified_m),
        parts_volume_m3: of_parts.volume_m3,
        parts_volume_share: measured.solid.map(|solid| of_parts.volume_m3 / solid.volume_m3),
        parts_overlap_share: overlap_share(&parts.hulls),
        parts_inertia_difference: measured.solid.map(|_| relative_difference(of_parts.inertia_kg_m2(mass_kg), inertia)),
        smallest_width_m,
        fits_gripper: smallest_width_m < f64::from(config.gripper.opening_m_max),
        fits_workspace: measured.extents_m.length() <= f64::from(config.grid.size_m),
        warnings: Vec::new(),
    };
    object.warnings = warnings(&object, params.scale, config, measured);
    Ok(object)
}

/// What is unusual about an object, one sentence each.
fn warnings(object: &ImportedObject, scale: f64, config: &Config, measured: &Measured) -> Vec<String> {
    let longest_m = measured.extents_m.max_element();
    let of_parts = "volume, mass and inertia are those of the parts";
    let mut told = Vec::new();
    if !object.is_watertight {
        let Seams { open_edges, twisted_edges } = measured.seams;
        told.push(format!(
            "not watertight: {open_edges} edges do not belong to two triangles, {twisted_edges} have theirs turned against \
             each other; {of_parts}"
        ));
    } else if object.volume_m3.is_none() {
        told.push(format!("watertight, but without a volume; {of_parts}"));
    }
    if measured.was_inside_out {
        told.push("its triangles were inside out; they were reversed".to_owned());
    }
    if measured.mesh.degenerate_count > 0 {
        told.push(format!("{} triangles without an area were dropped", measured.mesh.degenerate_count));
    }
    if longest_m > PLAUSIBLE_M[1] {
        let scale = scale * 0.001;
        told.push(format!("{longest_m:.3} m long: if the file is in millimetres, give --scale {scale}"));
    }
    if longest_m < PLAUSIBLE_M[0] {
        let (longest_mm, scale) = (longest_m * 1000.0, scale * 1000.0);
        told.push(format!("{longest_mm:.3} mm long: if the file is in metres, give --scale {scale}"));
    }
    if !object.fits_gripper {
        let (width_mm, opening_mm) = (object.smallest_width_m * 1000.0, config.gripper.opening_m_max * 1000.0);
        told.push(format!(
            "{width_mm:.1} mm at its narrowest, and the hand opens {opening_mm:.1} mm: only a rim or a handle can be held"
        ));
    }
    if !object.fits_workspace {
        let side_m = config.grid.size_m;
        told.push(format!(
            "its bounding box's diagonal must be at most the workspace's side, {side_m} m, to be dropped"
        ));
    }
    if let Some(share) = object.parts_volume_share.filter(|share| (share - 1.0).abs() > VOLUME_SHARE) {
        let cure = if share > 1.0 {
            "--hulls-max: the parts fill hollows"
        } else {
            "--corners-max: the parts cut off rounded surfaces"
        };
        told.push(format!("the parts have {:.1} % of its volume; more {cure}", 100.0 * share));
    }
    if let Some(share) = object.parts_inertia_difference.filter(|share| *share > INERTIA_SHARE) {
        told.push(format!("the parts' inertia is {:.1} % from the mesh's", 100.0 * share));
    }
    if object.parts_overlap_share > OVERLAP_SHARE {
        told.push(format!("{:.1} % of the parts' volume overlaps", 100.0 * object.parts_overlap_share));
    }
    told
}

/// The object as a catalogue entry. Corners are relative to the centre of the mesh's bounding box.
fn catalogue_text(object: &ImportedObject, params: &ImportParams, parts: &ConvexParts) -> String {
    let name_of_file = object.file.file_name().map_or_else(Default::default, |name| name.to_string_lossy());
    let state = match object.parts_volume_share {
        Some(share) => format!("parts with {:.1} % of its volume", 100.0 * share),
        None => "not watertight".to_owned(),
    };
    let source = format!("{name_of_file}, {} m a unit; {} triangles; {state}", params.scale, object.triangles);
    let mut text = String::new();
    let mass_kg = (object.mass_kg * 1e6).round() / 1e6;
    let _ = write!(
        text,
        "\n[[object]]\nname = \"{}\"\nmass_kg = {mass_kg:?}\nfriction = {:?}\nsource = {}\n",
        object.name,
        params.friction,
        toml::Value::String(source)
    );
    for hull in &parts.hulls {
        text +=
            "\n[[object.part]]\nshape = \"hull\"\nat_m = [0.0, 0.0, 0.0]\nturn_deg = [0.0, 0.0, 0.0]\ncorners_m = [\n";
        for corner in hull.corners_m() {
            let [x, y, z] = corner.to_array().map(decimal);
            let _ = writeln!(text, "    [{x}, {y}, {z}],");
        }
        text += "]\n";
    }
    text
}

/// A length with as many decimals as it needs, at least one and at most [`DECIMALS`].
fn decimal(metres: f32) -> String {
    let text = format!("{metres:.DECIMALS$}");
    let short = text.trim_end_matches('0');
    let short = if short.ends_with('.') { format!("{short}0") } else { short.to_owned() };
    if short == "-0.0" { "0.0".to_owned() } else { short }
}
