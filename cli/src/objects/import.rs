//! `graspmill objects import`: meshes to a catalogue of objects, with a table of the results.

use std::path::{Path, PathBuf};

use clap::{Args, value_parser};
use generator::{ImportParams, Imported, ImportedObject, LeftOut, import_objects, sources};
use indicatif::ProgressBar;
use program::text::percent;
use program::{ExitCode, Failure, json, print, print_error, write};
use report::document::{Block, Cell, Document, Table};

use crate::parse::between;
use crate::progress::style;

/// Make objects of your own meshes: measure them, decompose them into convex parts, write a catalogue
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Meshes (.obj, .stl, .ply, .glb), descriptions (.urdf, MuJoCo's .xml), and folders of them, with all folders
    /// within; the program of the Python package reads descriptions, with MuJoCo
    #[arg(required = true, value_name = "FOLDER|FILE")]
    meshes: Vec<PathBuf>,

    /// The catalogue to write; a config names it in [objects] as catalogue = "FILE"
    #[arg(long, value_name = "FILE")]
    out: PathBuf,

    #[command(flatten)]
    options: MeshOptions,

    /// Replace an existing catalogue
    #[arg(long)]
    force: bool,

    /// Print JSON instead of the table
    #[arg(long)]
    json: bool,
}

/// How meshes become objects.
#[derive(Debug, Args)]
pub(super) struct MeshOptions {
    /// Metres per unit of the files: 0.001 for millimetres; of a URDF or MJCF it changes the lengths, not the mass
    /// [default: guessed from the sizes, metres for URDF and MJCF]
    #[arg(long, value_name = "METRES", value_parser = positive)]
    scale: Option<f64>,

    /// Density of all objects in kg/m3 [default: a URDF's or MJCF's mass, else 400]
    #[arg(long, value_name = "KG/M3", value_parser = positive)]
    density: Option<f64>,

    /// Mass of each object in kg, instead
    #[arg(long, value_name = "KG", conflicts_with = "density", value_parser = positive)]
    mass: Option<f64>,

    /// Friction coefficient of all objects
    #[arg(long, value_name = "MU", default_value_t = 0.8, value_parser = between(0.0..=5.0_f32))]
    friction: f32,

    /// What the program of the Python package made of descriptions
    #[arg(long, hide = true, value_name = "FILE")]
    described: Option<PathBuf>,

    /// Most convex parts of an object; 1 makes it its convex hull
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = value_parser!(u16).range(1..=1024))]
    hulls_max: u16,

    /// Most corners of a part; an attempt takes longer with more
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = value_parser!(u8).range(8..=64))]
    corners_max: u8,

    /// An object is cut into more parts until they leave its surface by no more than this
    #[arg(long, value_name = "METRES", default_value_t = 0.0008, value_parser = between(0.000_05..=0.01_f32))]
    tolerance: f32,
}

/// A number above 0.
fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|e| format!("{e}"))?;
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err(format!("must be above 0, got {text}")) }
}

impl MeshOptions {
    pub(super) fn params(&self) -> ImportParams {
        ImportParams {
            scale: self.scale,
            density: self.density,
            mass: self.mass,
            friction: self.friction,
            described: self.described.clone(),
            hulls_max: self.hulls_max,
            corners_max: self.corners_max,
            tolerance_m: self.tolerance,
        }
    }
}

/// Says why files are left out.
pub(super) fn tell_left_out(left_out: &[LeftOut]) {
    left_out.iter().for_each(|one| print_error(&format!("left out: {}", one.reason)));
}

/// Shows on a bar that a file is done.
pub(super) fn tell(bar: &ProgressBar, file: &Path) {
    bar.set_message(file.display().to_string());
    bar.inc(1);
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    check_target(&arguments.out, arguments.force)?;
    let sources = sources(&arguments.meshes, arguments.options.described.as_deref())?;
    let bar = ProgressBar::new(sources.len() as u64).with_style(style("files"));
    let params = arguments.options.params();
    let imported = import_objects(&sources, &params, &|file, _| tell(&bar, file));
    bar.finish_and_clear();
    let imported = imported?;
    write(&arguments.out, &imported.catalogue)?;
    tell_left_out(&imported.left_out);
    print(if arguments.json { json(&imported)? } else { document(&imported, &arguments.out).text() })?;
    Ok(if imported.left_out.is_empty() { ExitCode::Ok } else { ExitCode::Partial })
}

/// Decomposing meshes takes minutes, so an output that cannot or must not be written is refused before.
fn check_target(path: &Path, replaces: bool) -> Result<(), Failure> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let why = if !folder.is_dir() || path.is_dir() {
        "--out must name a file in an existing folder"
    } else if path.is_file() && !replaces {
        "--out must name a new file, and this catalogue may have been edited; --force replaces it"
    } else {
        return Ok(());
    };
    Err(Failure::new(ExitCode::Config, format!("{why}: {}", path.display())))
}

fn document(imported: &Imported, out: &Path) -> Document {
    let row = |object: &ImportedObject| {
        let [x, y, z] = object.extents_m.map(|e| e * 1000.0);
        let or_none = |value: Option<f64>, text: &dyn Fn(f64) -> String| value.map_or("-".to_owned(), text);
        let numbers = [
            format!("{x:.1} x {y:.1} x {z:.1}"),
            or_none(object.volume_m3, &|volume| format!("{:.2}", volume * 1e6)),
            format!("{:.1}", object.mass_kg * 1000.0),
            object.parts.to_string(),
            object.part_corners_max.to_string(),
            or_none(object.parts_volume_share, &percent),
            format!("{:.1}", object.smallest_width_m * 1000.0),
        ];
        let (name, triangles) = (Cell::from(object.name.as_str()), Cell::Count(object.triangles as u64));
        let closed = Cell::Number(if object.is_watertight { "yes" } else { "no" }.to_owned());
        [name, triangles, closed].into_iter().chain(numbers.map(Cell::Number)).collect()
    };
    let head = [
        "object",
        "triangles",
        "closed",
        "size, mm",
        "volume, cm3",
        "mass, g",
        "parts",
        "corners",
        "parts' volume",
        "narrowest, mm",
    ];
    let warnings = |o: &ImportedObject| o.warnings.iter().map(|text| format!("{}: {text}", o.name)).collect::<Vec<_>>();
    let count = imported.objects.len();
    let plural = if count == 1 { "" } else { "s" };
    let origin = if imported.is_scale_guessed { "guessed from the sizes; --scale decides" } else { "--scale" };
    let scale_m = imported.scale_m;
    let blocks = vec![
        Block::Table(Table::new(head, imported.objects.iter().map(row))),
        Block::Warnings(imported.objects.iter().flat_map(warnings).collect()),
        Block::Text(format!("one unit of a mesh file is {scale_m} m ({origin})")),
        Block::Text(format!(
            "{count} object{plural} written to {}, {} left out",
            out.display(),
            imported.left_out.len()
        )),
    ];
    Document { blocks, ..Document::default() }
}
