//! Objects from meshes: each mesh is measured, simplified for cameras, decomposed into convex parts, measured again
//! and written to a catalogue.
//!
//! The mass properties of a watertight mesh are exact, but the physics uses its parts. Both are reported side by side,
//! with warnings about anything unusual. A file that cannot be used is listed with the reason, and the others go on.

mod described;
mod simplified;
mod source;
mod summary;
mod units;

pub use source::{Source, sources};
pub use summary::ImportedObject;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use glamx::DSymmetricEigen3;
use program::{ExitCode, Failure};
use rayon::prelude::*;
use schema::{HullError, MODELS_MAX, MassIntegrals, TriangleMesh};
use serde::Serialize;
use simulator::{ConvexParts, PartsParams, convex_parts, few_cornered_hull};

use self::simplified::simplified;
use self::summary::{catalogue_text, warnings};
use self::units::guessed_scale_m;
use crate::catalogue::{Catalogue, MASS_KG};
use crate::measured::{Measured, smallest_width_m};
use crate::mesh_file::{damaged, read_mesh, unusable};
use crate::models::Models;

/// Maximum number of hull corners for measuring the smallest width.
const WIDTH_CORNERS: usize = 64;
/// Maximum accepted length of the longest side.
const LONGEST_M: f64 = 10.0;
/// Maximum distance of its middle from the origin along an axis: files, and grasps in their frame, have single
/// precision, whose steps are 8 µm there, and 1 mm at 10 km.
const FAR_M: f64 = 100.0;
/// How much coarser parts become, as a share of the corners asked for, where finer ones are refused.
const COARSER: [f64; 3] = [0.75, 0.5, 0.25];
/// Fewest corners of a part, which `--corners-max` can ask for.
const CORNERS_MIN: usize = 8;

/// Density unless given, in kg/m³: hollow plastic, light wood.
const DENSITY_KG_M3: f64 = 400.0;

/// Settings of the import.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportParams {
    /// Metres per unit of the files, above 0. Guessed from the sizes if not given; metres for URDF and MJCF.
    pub scale: Option<f64>,
    /// Density of all objects in kg/m³, above 0; if not given a URDF's or MJCF's mass, else 400 kg/m³.
    pub density: Option<f64>,
    /// Mass of each object in kg, above 0, instead.
    pub mass: Option<f64>,
    /// Friction coefficient of all objects.
    pub friction: f32,
    /// The file in which the Python package says what it made of descriptions.
    pub described: Option<PathBuf>,
    /// Most convex parts of an object, 1 to 1024; 1 makes it its convex hull.
    pub hulls_max: u16,
    /// Most corners of a part, 8 to 64; an attempt takes longer with more.
    pub corners_max: u8,
    /// Objects are cut until their parts leave the surface by no more than this, in metres.
    pub tolerance_m: f32,
}

impl Default for ImportParams {
    /// Those of `graspmill objects import`.
    fn default() -> Self {
        Self {
            scale: None,
            density: None,
            mass: None,
            friction: 0.8,
            described: None,
            hulls_max: 1024,
            corners_max: 32,
            tolerance_m: 0.0008,
        }
    }
}

/// The result of an import.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Imported {
    /// The objects, in the files' order.
    pub objects: Vec<ImportedObject>,
    /// The files that could not be used.
    pub left_out: Vec<LeftOut>,
    /// Metres per unit of the files.
    pub scale_m: f64,
    /// Whether nobody gave that scale.
    pub is_scale_guessed: bool,
    /// The catalogue's text, which [`Catalogue::parse`] reads.
    #[serde(skip)]
    pub catalogue: String,
}

/// A file that made no object.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// The file.
    pub file: PathBuf,
    /// The reason, which names the file.
    pub reason: String,
}

/// Measures and decomposes meshes and makes a catalogue of them. Files are processed in parallel; the result does not
/// depend on the number of threads. `on_file` is called when work on a file ends.
///
/// # Errors
/// If no file can be used, with all reasons; if there are too many.
pub fn import_objects(
    sources: &[Source],
    params: &ImportParams,
    on_file: &(dyn Fn(&Path, Option<&str>) + Sync),
) -> Result<Imported, Failure> {
    if sources.len() > MODELS_MAX {
        let got = sources.len();
        return Err(unusable(format!("a dataset has at most {MODELS_MAX} objects, got {got} files")));
    }
    let without_own: Vec<&Source> = sources.iter().collect();
    let scale_m = params.scale.unwrap_or_else(|| guessed_scale_m(&without_own));
    let made = |source: &Source| {
        let scale_m = if source.described.is_some() { params.scale.unwrap_or(1.0) } else { scale_m };
        let made = Import { source, scale_m, params }.object();
        let reason = made.as_ref().err().map(ToString::to_string);
        on_file(&source.file, reason.as_deref());
        made
    };
    let made: Vec<_> = sources.par_iter().with_max_len(1).map(made).collect();
    let (mut objects, mut left_out, mut catalogue) = (Vec::new(), Vec::new(), HEAD.to_owned());
    let mut code = ExitCode::Config; // or `Data`, if a file is damaged
    for (source, one) in sources.iter().zip(made) {
        match one {
            Ok((object, text)) => {
                objects.push(object);
                catalogue += &text;
            }
            Err(error) => {
                code = code.min(error.exit_code());
                left_out.push(LeftOut { file: source.file.clone(), reason: error.to_string() });
            }
        }
    }
    if objects.is_empty() {
        let reasons: Vec<&str> = left_out.iter().map(|one| one.reason.as_str()).collect();
        return Err(Failure::new(code, format!("none of the files can be used:\n  {}", reasons.join("\n  "))));
    }
    let is_scale_guessed = params.scale.is_none();
    Ok(Imported { objects, left_out, scale_m, is_scale_guessed, catalogue })
}

const HEAD: &str = "\
# Objects made of meshes by `graspmill objects import`; configs/objects/everyday.toml says what the keys mean. Masses, friction
# and names may be changed by hand; sets of objects may be added.
";

/// The import of one object.
struct Import<'a> {
    source: &'a Source,
    /// Metres per unit of the file.
    scale_m: f64,
    params: &'a ImportParams,
}

impl Import<'_> {
    /// The object and its entry in the catalogue.
    fn object(&self) -> Result<(ImportedObject, String), Failure> {
        let file = &self.source.file;
        let (measured, mass_kg) = self.measured()?;
        // An object that is to be its hull is seen as that.
        let mesh = (self.params.hulls_max > 1).then(|| simplified(&measured.mesh, measured.middle_m)).transpose();
        let mesh = mesh.map_err(|error| damaged(&error, file))?;
        let made = |share: f64| {
            let params = PartsParams {
                parts_max: self.params.hulls_max.into(),
                corners_max: ((share * f64::from(self.params.corners_max)) as usize).max(CORNERS_MIN),
                tolerance_m: self.params.tolerance_m / share as f32,
            };
            let cut = || convex_parts(&measured.corners_m, &measured.mesh.triangles, &params);
            // The hull library panics on some scans; cut elsewhere, they have hulls.
            match catch_unwind(AssertUnwindSafe(cut)) {
                Ok(Ok(parts)) => self.with_parts(&measured, mass_kg, &parts, mesh.as_ref()),
                Ok(Err(error)) => Err(damaged(&error.to_string(), file)),
                Err(_) => Err(damaged("it cannot be decomposed, because a hull could not be made", file)),
            }
        };
        let is_refused =
            |made: &Result<_, Failure>| made.as_ref().is_err_and(|error| error.exit_code() == ExitCode::Data);
        let finest = made(1.0);
        if !is_refused(&finest) {
            return finest;
        }
        COARSER.into_iter().map(made).find(|coarser| !is_refused(coarser)).unwrap_or(finest)
    }

    /// The mesh in metres, and the mass in kilograms if the file has one.
    fn measured(&self) -> Result<(Measured, Option<f64>), Failure> {
        let Self { source, params, scale_m } = *self;
        let file = &source.file;
        let (mesh, mass_kg) = match &source.described {
            Some(described) => (described.mesh(file, scale_m)?, described.mass_kg),
            None => (read_mesh(file, file, scale_m)?, None),
        };
        let measured = Measured::of(mesh);
        let (longest_m, far_m) = (measured.extents_m.max_element(), measured.middle_m.abs().max_element());
        let limits = [(longest_m, LONGEST_M, "long"), (far_m, FAR_M, "from the origin of its file")];
        if let Some((got_m, most_m, what)) = limits.into_iter().find(|(got_m, most_m, _)| got_m > most_m) {
            let (file, scale) = (file.display(), scale_m * 0.001);
            return Err(unusable(format!(
                "it must be at most {most_m} m {what}, got {got_m} m: in millimetres? --scale {scale}: {file}"
            )));
        }
        Ok((measured, params.mass.or(mass_kg.filter(|_| params.density.is_none()))))
    }

    /// The object with these parts, as it is read from the catalogue. A part that is refused there is an error with
    /// [`ExitCode::Data`].
    fn with_parts(
        &self,
        measured: &Measured,
        mass_kg: Option<f64>,
        parts: &ConvexParts,
        mesh: Option<&TriangleMesh>,
    ) -> Result<(ImportedObject, String), Failure> {
        let file = &self.source.file;
        let damaged = |message: &str| damaged(message, file);
        let mut object = self.described(measured, mass_kg, parts).map_err(|error| damaged(&error.to_string()))?;
        let [least, most] = MASS_KG.map(f64::from);
        if !(least..=most).contains(&object.mass_kg) {
            let (mass_g, longest_mm) = (object.mass_kg * 1e3, measured.extents_m.max_element() * 1e3);
            return Err(unusable(format!(
                "its mass must be between {:.1} g and {most} kg, got {mass_g:.3} g: it is {longest_mm:.1} mm long with {} m a unit; \
                 give --scale, or --mass: {}",
                least * 1e3,
                object.scale_m,
                file.display()
            )));
        }
        let text = catalogue_text(&object, parts, mesh);
        let read = Catalogue::parse(&text, Path::new("the new catalogue")).map_err(|error| damaged(&error))?;
        Models::of(&read).map_err(|problems| damaged(&problems.join("; ")))?;
        object.warnings = warnings(&object, measured);
        Ok((object, text))
    }

    fn described(
        &self,
        measured: &Measured,
        mass_kg: Option<f64>,
        parts: &ConvexParts,
    ) -> Result<ImportedObject, HullError> {
        let Self { source, params, .. } = self;
        let of_parts =
            parts.hulls.iter().map(MassIntegrals::from).fold(MassIntegrals::ZERO, |sum, part| sum.plus(&part));
        let balance = measured.solid.unwrap_or(of_parts);
        let density_kg_m3 = params.density.unwrap_or(DENSITY_KG_M3);
        // An open mesh encloses nothing: its parts are thin or full as it is cut. Its hull is neither.
        let filled_m3 = match (measured.solid, measured.confused_share) {
            (Some(solid), _) => solid.volume_m3,
            (None, Some(_)) => measured.enclosed_m3,
            (None, None) => measured.hull_volume_m3,
        };
        let mut guesses = Vec::new();
        if params.scale.is_none() && source.described.is_none() {
            guesses.push(format!("one unit of its file is {} m, guessed from its size: give the scale", self.scale_m));
        }
        if mass_kg.or(params.density).is_none() {
            let mass_g = 1e3 * density_kg_m3 * filled_m3;
            guesses
                .push(format!("it weighs {mass_g:.1} g, of {density_kg_m3} kg/m3, guessed: give its mass or density"));
        }
        let mass_kg = mass_kg.unwrap_or(density_kg_m3 * filled_m3);
        let share = |solid: MassIntegrals| of_parts.volume_m3 / solid.volume_m3;
        let whole = few_cornered_hull(&measured.corners_m, WIDTH_CORNERS)?.0;
        Ok(ImportedObject {
            name: source.name.clone(),
            file: source.file.clone(),
            scale_m: self.scale_m,
            triangles: measured.mesh.triangles.len(),
            is_watertight: measured.seams.is_watertight(),
            bad_edges: measured.seams.open_edges + measured.seams.twisted_edges,
            extents_m: measured.extents_m.to_array(),
            middle_m: measured.middle_m.to_array(),
            volume_m3: measured.solid.map(|solid| solid.volume_m3),
            mass_kg,
            friction: params.friction,
            centre_of_mass_m: (balance.centre_m() + measured.middle_m).to_array(),
            inertia_kg_m2: DSymmetricEigen3::eigenvalues(balance.inertia_kg_m2(mass_kg)).to_array(),
            parts: parts.hulls.len(),
            part_corners_max: parts.hulls.iter().map(|hull| hull.corners_m().len()).max().unwrap_or(0),
            simplified_m: f64::from(parts.simplified_m),
            filled_m: f64::from(parts.filled_m),
            parts_volume_share: measured.solid.map(share),
            smallest_width_m: smallest_width_m(&whole, &measured.corners_m),
            guesses,
            warnings: Vec::new(),
        })
    }
}
