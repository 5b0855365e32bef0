//! `generator import-objects`: meshes to a catalogue of objects, with a table of the results.

use std::fmt::Write as _;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use clap::Args;
use generator::{Config, ImportParams, Imported, ImportedObject, Overrides, import_objects, mesh_files};
use program::text::{grouped, percent};
use program::{Context, ExitCode, Failure, json, print, write};
use simulator::PartsParams;

/// Friction unless the command line gives one: wood, card and plastic against rubber.
const FRICTION: f32 = 0.8;
/// Density unless the command line gives one, in kg/m³: hollow plastic, light wood.
const DENSITY_KG_M3: f64 = 400.0;

/// Make objects of your own meshes: measure them, decompose them into convex parts, write a catalogue
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Meshes (.obj, .stl, .ply), and folders of them
    #[arg(required = true, value_name = "FOLDER|FILE")]
    meshes: Vec<PathBuf>,

    /// The catalogue to write; a config names it in [objects] as catalogue = "FILE"
    #[arg(long, value_name = "FILE")]
    out: PathBuf,

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

    /// Config whose hand and workspace the objects must fit [default: the built-in configs/generate/paper.toml]
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,

    /// Replace an existing catalogue
    #[arg(long)]
    force: bool,

    /// Print JSON instead of the table
    #[arg(long)]
    json: bool,
}

/// A number above 0.
fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|e| format!("{e}"))?;
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err(format!("must be above 0, got {text}")) }
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let Config { gripper, grid, .. } = Config::load(arguments.config.as_deref(), Overrides::default())?;
    let parts = PartsParams {
        parts_max: arguments.hulls_max.into(),
        corners_max: arguments.corners_max.into(),
        resolution: arguments.voxels,
        concavity: 0.002,
    };
    let params = ImportParams {
        scale_m: arguments.scale,
        density_kg_m3: arguments.density.unwrap_or(DENSITY_KG_M3),
        mass_kg: arguments.mass,
        friction: arguments.friction,
        parts,
        gripper,
        grid,
    };
    check_target(&arguments.out)?;
    let imported = import_objects(&mesh_files(&arguments.meshes)?, &params)?;
    write_catalogue(&arguments.out, &imported.catalogue, arguments.force)?;
    print(if arguments.json { json(&imported)? } else { table(&imported, &arguments.out) })?;
    Ok(ExitCode::Ok)
}

/// Decomposing meshes takes minutes, so unwritable outputs are reported before.
fn check_target(path: &Path) -> Result<(), Failure> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if folder.is_dir() && !path.is_dir() {
        return Ok(());
    }
    let text = format!("--out must name a file in an existing folder: {}", path.display());
    Err(Failure::new(ExitCode::Config, text))
}

/// Leaves an existing file as it is, unless `replaces`.
fn write_catalogue(path: &Path, text: &str, replaces: bool) -> Result<(), Failure> {
    match std::fs::read(path) {
        Ok(existing) if existing == text.as_bytes() => return Ok(()),
        Ok(_) if !replaces => {
            let path = path.display();
            let text = format!("another catalogue exists, and may have been edited; --force replaces it: {path}");
            return Err(Failure::new(ExitCode::Config, text));
        }
        Ok(_) => {}
        Err(error) if error.kind() == ErrorKind::NotFound => {}
        Err(error) => return Err(error).context(format_args!("failed to read {}", path.display())),
    }
    write(path, text)
}

fn table(imported: &Imported, out: &Path) -> String {
    let width = imported.objects.iter().map(|object| object.name.len()).max().unwrap_or(0).max("object".len());
    let mut text = format!(
        "{:<width$}  triangles  closed            size, mm  volume, cm3   mass, g  hull, cm3  parts  corners   parts' volume  \
         inertia off  overlap  narrowest, mm\n",
        "object"
    );
    for object in &imported.objects {
        let ImportedObject { name, triangles, parts, part_corners_max, .. } = object;
        let [x, y, z] = object.extents_m.map(|e| e * 1000.0);
        let size = format!("{x:.1} x {y:.1} x {z:.1}");
        let or_none = |value: Option<f64>, text: &dyn Fn(f64) -> String| value.map_or("-".to_owned(), text);
        let _ = writeln!(
            text,
            "{name:<width$}  {:>9}  {:>6}  {size:>18}  {:>11}  {:>8.1}  {:>9.2}  {parts:>5}  {part_corners_max:>7}  {:>14}  \
             {:>11}  {:>7}  {:>13.1}",
            grouped(*triangles as u64),
            if object.is_watertight { "yes" } else { "no" },
            or_none(object.volume_m3, &|volume| format!("{:.2}", volume * 1e6)),
            object.mass_kg * 1000.0,
            object.hull_volume_m3 * 1e6,
            or_none(object.parts_volume_share, &percent),
            or_none(object.parts_inertia_difference, &percent),
            percent(object.parts_overlap_share),
            object.smallest_width_m * 1000.0,
        );
    }
    let warnings = imported.objects.iter().flat_map(|o| o.warnings.iter().map(move |warning| (&o.name, warning)));
    for (place, (name, warning)) in warnings.enumerate() {
        text += if place == 0 { "\n" } else { "" };
        let _ = writeln!(text, "warning: {name}: {warning}");
    }
    let count = imported.objects.len();
    let _ = writeln!(text, "\n{count} object{} written to {}", if count == 1 { "" } else { "s" }, out.display());
    text
}
