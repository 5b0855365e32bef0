//! Objects from meshes: each mesh is measured, decomposed into convex parts, measured again, and written to a
//! catalogue.
//!
//! The mass properties of a watertight mesh are exact, but the physics uses its parts. Both are reported side by side,
//! with warnings about anything unusual.

use std::fmt::Write as _;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use glamx::{DSymmetricEigen3, DVec3};
use program::{ExitCode, Failure};
use rayon::prelude::*;
use schema::{Grid, Gripper, HullError, MODELS_MAX, Polyhedron, Vec3};
use serde::Serialize;
use simulator::{ConvexParts, PartsParams, convex_parts, few_cornered_hull, hull_volume_m3};

use crate::catalogue::Catalogue;
use crate::mass_integrals::{MassIntegrals, relative_difference};
use crate::mesh::{Mesh, Seams};
use crate::mesh_file::{ENDINGS, damaged, ending, read_mesh, unusable};
use crate::models::Models;

/// A mesh is convex if its hull is larger by less than this share.
const CONVEX_SHARE: f64 = 0.01;
/// Maximum number of hull corners for measuring the smallest width.
const WIDTH_CORNERS: usize = 64;
/// Cells along each side of the lattice for measuring overlaps.
const LATTICE: usize = 48;
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

/// Settings of the import.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportParams {
    /// Metres per unit of the files.
    pub scale_m: f64,
    /// Density of all objects in kg/m³.
    pub density_kg_m3: f64,
    /// Mass of each object in kg, instead.
    pub mass_kg: Option<f64>,
    /// Coulomb friction coefficient.
    pub friction: f32,
    /// How finely meshes are decomposed.
    pub parts: PartsParams,
    /// The hand that objects should fit.
    pub gripper: Gripper,
    /// The workspace that objects should fit.
    pub grid: Grid,
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
pub fn import_objects(files: &[PathBuf], params: &ImportParams) -> Result<Imported, Failure> {
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
    let made: Vec<_> = files.par_iter().with_max_len(1).map(|file| guarded(file, params)).collect();
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
fn guarded(file: &Path, params: &ImportParams) -> Result<(ImportedObject, String), Failure> {
    let failed = |_| Err(damaged("it cannot be decomposed, because a hull could not be made", file));
    catch_unwind(AssertUnwindSafe(|| import_one(file, params))).unwrap_or_else(failed)
}

fn import_one(file: &Path, params: &ImportParams) -> Result<(ImportedObject, String), Failure> {
    let mesh = read_mesh(file, params.scale_m)?;
    let damaged = |error: HullError| damaged(&error.to_string(), file);
    let measured = Measured::of(mesh);
    let longest_m = measured.extents_m.max_element();
    if longest_m > LONGEST_M {
        let (file, scale) = (file.display(), params.scale_m * 0.001);
        return Err(unusable(format!(
            "it must be at most {LONGEST_M} m long, got {longest_m} m: in millimetres? --scale {scale}: {file}"
        )));
    }
    let hull_of = |parts_max| {
        let parts = PartsParams { parts_max, ..params.parts };
        convex_parts(&measured.corners_m, &measured.mesh.triangles, &parts).map_err(damaged)
    };
    let is_convex =
        measured.solid.is_some_and(|solid| solid.volume_m3 >= (1.0 - CONVEX_SHARE) * measured.hull_volume_m3);
    let parts = hull_of(if is_convex { 1 } else { params.parts.parts_max })?;
    let object = described(file, params, &measured, &parts).map_err(damaged)?;
    let text = catalogue_text(&object, params, &parts);
    Ok((object, text))
}

/// A mesh and its measurements before decomposition.
struct Measured {
    mesh: Mesh,
    seams: Seams,
    was_inside_out: bool,
    extents_m: DVec3,
    /// The centre of the bounding box, in the file's frame; all other fields are relative to it.
    middle_m: DVec3,
    corners_m: Vec<Vec3>,
    /// The integrals, if the mesh is watertight and encloses a volume.
    solid: Option<MassIntegrals>,
    hull_volume_m3: f64,
}

impl Measured {
    fn of(mesh: Mesh) -> Self {
        let seams = mesh.seams();
        let [low, high] = mesh.bounds_m();
        let middle_m = 0.5 * (low + high);
        let integrals = MassIntegrals::of(mesh.triangles_about(middle_m));
        let was_inside_out = seams.is_watertight() && integrals.volume_m3 < 0.0;
        let mesh = if was_inside_out { mesh.turned_inside_out() } else { mesh };
        let solid = seams.is_watertight().then(|| MassIntegrals::of(mesh.triangles_about(middle_m)));
        let corners_m = mesh.corners_about(middle_m);
        Self {
            seams,
            was_inside_out,
            extents_m: high - low,
            middle_m,
            hull_volume_m3: hull_volume_m3(&corners_m).unwrap_or(0.0),
            corners_m,
            solid: solid.filter(|solid| solid.volume_m3 > 0.0),
            mesh,
        }
    }
}

fn integrals_of(hull: &Polyhedron) -> MassIntegrals {
    let corners: Vec<DVec3> = hull.corners_m().iter().map(|c| c.as_dvec3()).collect();
    MassIntegrals::of(hull.triangles().into_iter().map(|triangle| triangle.map(|i| corners[i])))
}

fn described(
    file: &Path,
    params: &ImportParams,
    measured: &Measured,
    parts: &ConvexParts,
) -> Result<ImportedObject, HullError> {
    let of_parts = parts.hulls.iter().map(integrals_of).fold(MassIntegrals::ZERO, |sum, part| sum.plus(&part));
    let balance = measured.solid.unwrap_or(of_parts);
    let mass_kg = params.mass_kg.unwrap_or(params.density_kg_m3 * balance.volume_m3);
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
        fits_gripper: smallest_width_m < f64::from(params.gripper.opening_m_max),
        fits_workspace: measured.extents_m.length() <= f64::from(params.grid.size_m),
        warnings: Vec::new(),
    };
    object.warnings = warnings(&object, params, measured);
    Ok(object)
}

/// What is unusual about an object, one sentence each.
fn warnings(object: &ImportedObject, params: &ImportParams, measured: &Measured) -> Vec<String> {
    let longest_m = measured.extents_m.max_element();
    let Seams { open_edges, twisted_edges } = measured.seams;
    let (width_mm, opening_mm) = (object.smallest_width_m * 1000.0, params.gripper.opening_m_max * 1000.0);
    let volume_share = object.parts_volume_share.unwrap_or(1.0);
    let inertia_share = object.parts_inertia_difference.unwrap_or(0.0);
    let cure = if volume_share > 1.0 {
        "--hulls-max: the parts fill hollows"
    } else {
        "--corners-max: the parts cut off rounded surfaces"
    };
    let of_parts = "volume, mass and inertia are those of the parts";
    let told = [
        (
            !object.is_watertight,
            format!(
                "not watertight: {open_edges} edges do not belong to two triangles, {twisted_edges} have theirs turned against \
                 each other; {of_parts}"
            ),
        ),
        (object.is_watertight && object.volume_m3.is_none(), format!("watertight, but without a volume; {of_parts}")),
        (measured.was_inside_out, "its triangles were inside out; they were reversed".to_owned()),
        (
            measured.mesh.degenerate_count > 0,
            format!("{} triangles without an area were dropped", measured.mesh.degenerate_count),
        ),
        (
            longest_m > PLAUSIBLE_M[1],
            format!("{longest_m:.3} m long: if the file is in millimetres, give --scale {}", params.scale_m * 0.001),
        ),
        (
            longest_m < PLAUSIBLE_M[0],
            format!(
                "{:.3} mm long: if the file is in metres, give --scale {}",
                longest_m * 1000.0,
                params.scale_m * 1000.0
            ),
        ),
        (
            !object.fits_gripper,
            format!(
                "{width_mm:.1} mm at its narrowest, and the hand opens {opening_mm:.1} mm: only a rim or a handle can be held"
            ),
        ),
        (
            !object.fits_workspace,
            format!(
                "its bounding box's diagonal must be at most the workspace's side, {} m, to be dropped",
                params.grid.size_m
            ),
        ),
        (
            (volume_share - 1.0).abs() > VOLUME_SHARE,
            format!("the parts have {:.1} % of its volume; more {cure}", 100.0 * volume_share),
        ),
        (
            inertia_share > INERTIA_SHARE,
            format!("the parts' inertia is {:.1} % from the mesh's", 100.0 * inertia_share),
        ),
        (
            object.parts_overlap_share > OVERLAP_SHARE,
            format!("{:.1} % of the parts' volume overlaps", 100.0 * object.parts_overlap_share),
        ),
    ];
    told.into_iter().filter(|(holds, _)| *holds).map(|(_, warning)| warning).collect()
}

/// The smallest width of points over the directions in which a hull can be narrowest: normal to a face, or to two
/// edges.
fn smallest_width_m(hull: &Polyhedron, points_m: &[Vec3]) -> f64 {
    let edges = hull.edges_m();
    let faces = hull.planes().map(|plane| plane.normal);
    let across = edges.iter().enumerate().flat_map(|(i, a)| edges[..i].iter().map(|b| a.cross(*b)));
    let width_m = |points_m: &[Vec3], axis: Vec3| {
        let along = points_m.iter().map(|point| axis.dot(*point));
        along.clone().fold(f32::NEG_INFINITY, f32::max) - along.fold(f32::INFINITY, f32::min)
    };
    let mut best_m = f32::INFINITY;
    for axis in faces.chain(across).filter_map(Vec3::try_normalize) {
        // The hull's own corners first: few directions need a check of all points.
        if width_m(hull.corners_m(), axis) < best_m {
            best_m = best_m.min(width_m(points_m, axis));
        }
    }
    f64::from(best_m)
}

/// The share of the parts' union that lies in more than one of them, by sampling a lattice.
fn overlap_share(hulls: &[Polyhedron]) -> f64 {
    let corners = || hulls.iter().flat_map(Polyhedron::corners_m).copied();
    let (low, high) = (corners().fold(Vec3::INFINITY, Vec3::min), corners().fold(Vec3::NEG_INFINITY, Vec3::max));
    let planes: Vec<_> = hulls.iter().map(|hull| hull.planes().collect::<Vec<_>>()).collect();
    let (mut once, mut more) = (0_u64, 0_u64);
    for cell in 0..LATTICE.pow(3) {
        let along = [cell / LATTICE / LATTICE, cell / LATTICE % LATTICE, cell % LATTICE];
        let share = Vec3::from_array(along.map(|k| (k as f32 + 0.5) / LATTICE as f32));
        let point = low + (high - low) * share;
        let holders = planes.iter().filter(|of| of.iter().all(|p| p.normal.dot(point) < p.offset_m)).take(2).count();
        once += u64::from(holders >= 1);
        more += u64::from(holders >= 2);
    }
    if once == 0 { 0.0 } else { more as f64 / once as f64 }
}

/// The object as a catalogue entry. Corners are relative to the centre of the mesh's bounding box.
fn catalogue_text(object: &ImportedObject, params: &ImportParams, parts: &ConvexParts) -> String {
    let name_of_file = object.file.file_name().map_or_else(Default::default, |name| name.to_string_lossy());
    let state = match object.parts_volume_share {
        Some(share) => format!("parts with {:.1} % of its volume", 100.0 * share),
        None => "not watertight".to_owned(),
    };
    let source = format!("{name_of_file}, {} m a unit; {} triangles; {state}", params.scale_m, object.triangles);
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
