//! `graspmill objects make`: household objects, drawn by seed, as a catalogue.

use std::path::{Path, PathBuf};

use clap::Args;
use generator::catalogue::{Catalogue, CatalogueObject};
use generator::{HouseholdParams, Kind, Split, household};
use program::{ExitCode, Failure, print, write};
use report::document::{Block, Cell, Document, Table};
use report::picture::sheet;

use super::import::{check_target, write_catalogue};

/// Make household objects: kinds of things with random sizes, of convex parts, as a catalogue
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The catalogue to write; a config names it in [objects] as catalogue = "FILE"
    #[arg(long, value_name = "FILE")]
    out: PathBuf,

    /// Which kinds: train (to learn from), held-out (kept for tests) or all
    #[arg(long, default_value = "train", value_parser = split)]
    split: Split,

    /// Only these kinds of the split [default: all]
    #[arg(long, value_name = "KIND,...", value_delimiter = ',', value_parser = kind)]
    kinds: Vec<Kind>,

    /// Number of objects; the kinds take turns
    #[arg(long, value_name = "N", default_value_t = 270, value_parser = clap::value_parser!(u16).range(1..=1000))]
    count: u16,

    /// Seed of every object
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,

    /// Also draw the first object of each kind, as SVG
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,

    /// Replace an existing catalogue
    #[arg(long)]
    force: bool,
}

fn split(text: &str) -> Result<Split, String> {
    Split::from_name(text).ok_or_else(|| format!("must be one of {}", Split::ALL.map(Split::name).join(", ")))
}

fn kind(text: &str) -> Result<Kind, String> {
    Kind::from_name(text).ok_or_else(|| format!("must be one of {}", Kind::ALL.map(Kind::name).join(", ")))
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let Arguments { out, split, kinds, count, seed, picture, force } = arguments;
    let refused = |text: String| Failure::new(ExitCode::Config, text);
    let params = HouseholdParams { split: *split, kinds: kinds.clone(), count: usize::from(*count), seed: *seed };
    let text = household(&params).map_err(|problem| refused(format!("--{problem}")))?;
    check_target(out)?;
    let catalogue = Catalogue::parse(&text, out).map_err(refused)?;
    let of_kinds: Vec<_> = Kind::ALL.into_iter().map(|kind| (kind, of_kind(&catalogue, kind))).collect();
    let of_kinds: Vec<_> = of_kinds.into_iter().filter(|(_, objects)| !objects.is_empty()).collect();
    write_catalogue(out, &text, *force)?;
    if let Some(path) = picture {
        let cell = |(kind, objects): &(Kind, Vec<&CatalogueObject>)| {
            (kind.name(), objects[0].body.polyhedra(), usize::from(kind.is_held_out()))
        };
        write(path, sheet(&of_kinds.iter().map(cell).collect::<Vec<_>>()))?;
    }
    print(document(&of_kinds, out).text())?;
    Ok(ExitCode::Ok)
}

fn of_kind(catalogue: &Catalogue, kind: Kind) -> Vec<&CatalogueObject> {
    let is_of_kind =
        |object: &&CatalogueObject| object.body.name().rsplit_once('_').is_some_and(|(name, _)| name == kind.name());
    catalogue.objects().iter().filter(is_of_kind).collect()
}

fn document(of_kinds: &[(Kind, Vec<&CatalogueObject>)], out: &Path) -> Document {
    let row = |(kind, objects): &(Kind, Vec<&CatalogueObject>)| {
        let range = |of: &dyn Fn(&CatalogueObject) -> f32| {
            let values = || objects.iter().map(|object| of(object));
            let [low, high] = [values().fold(f32::INFINITY, f32::min), values().fold(0.0, f32::max)];
            Cell::number(format!("{low:.0} to {high:.0}"))
        };
        vec![
            Cell::from(kind.name()),
            Cell::from(if kind.is_held_out() { "held-out" } else { "train" }),
            Cell::Count(objects.len() as u64),
            range(&|object| object.body.polyhedra().len() as f32),
            range(&|object| 1000.0 * object.body.extents_m().max_element()),
            range(&|object| 1000.0 * object.body.extents_m().min_element()),
            range(&|object| 1000.0 * object.mass_kg),
        ]
    };
    let count: usize = of_kinds.iter().map(|(_, objects)| objects.len()).sum();
    let head = ["kind", "split", "objects", "parts", "longest side, mm", "shortest side, mm", "mass, g"];
    let blocks = vec![
        Block::Table(Table::new(head, of_kinds.iter().map(row))),
        Block::Text(format!("{count} objects written to {}", out.display())),
    ];
    Document { blocks, ..Document::default() }
}
