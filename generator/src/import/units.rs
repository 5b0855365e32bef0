//! The unit of mesh files, which they do not name, and what a table says of single objects.

use std::collections::BTreeMap;
use std::path::Path;

use program::Failure;
use rayon::prelude::*;
use serde::Deserialize;

use super::source::Source;
use crate::mesh_file::{read_mesh, unusable};

/// Half of the objects are longer than this, as a rule: of the units in question, the one that is nearest to it counts.
const USUAL_M: f64 = 0.08;
/// Half of the objects are shorter than this in metres, or the files are in another unit.
const METRES_MAX: f64 = 0.5;

/// The scale of files whose unit nobody named, in metres, by their longest sides. Files of one import have one unit.
pub(super) fn guessed_scale_m(sources: &[&Source]) -> f64 {
    let longest = |source: &&Source| {
        let mesh = read_mesh(&source.file, &source.file, 1.0).ok().filter(|_| source.described.is_none())?;
        let [low, high] = mesh.bounds_m();
        Some((high - low).max_element())
    };
    let mut lengths: Vec<f64> = sources.par_iter().filter_map(longest).collect();
    lengths.sort_by(f64::total_cmp);
    lengths.get(lengths.len() / 2).map_or(1.0, |median| scale_for(*median))
}

fn scale_for(median: f64) -> f64 {
    let off = |scale_m: &f64| libm::log(median * scale_m / USUAL_M).abs();
    if median <= METRES_MAX {
        return 1.0; // no file format has a unit larger than a metre
    }
    [0.1, 0.01, 0.001].into_iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(1.0)
}

/// What a table says of an object, instead of the command line.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Own {
    pub(super) scale: Option<f64>,
    pub(super) mass_kg: Option<f64>,
    pub(super) density_kg_m3: Option<f64>,
    pub(super) friction: Option<f32>,
}

/// Reads a table of objects by name: `[mug]` with any of scale, mass_kg or density_kg_m3, friction.
///
/// # Errors
/// With everything that is wrong.
pub(super) fn own_values(path: &Path, sources: &[Source]) -> Result<BTreeMap<String, Own>, Failure> {
    let shown = path.display();
    let text = settings::read_text(path).map_err(|e| unusable(format!("failed to read the table: {e}: {shown}")))?;
    let table: BTreeMap<String, Own> = toml::from_str(&text).map_err(|e| unusable(format!("{e}: {shown}")))?;
    let mut problems = Vec::new();
    for (name, own) in &table {
        if !sources.iter().any(|source| source.name == *name) {
            problems.push(format!("{name}: there is no object of that name"));
        }
        for (key, value) in [("scale", own.scale), ("mass_kg", own.mass_kg), ("density_kg_m3", own.density_kg_m3)] {
            if let Some(value) = value.filter(|value| !(value.is_finite() && *value > 0.0)) {
                problems.push(format!("{name}: {key} must be above 0, got {value}"));
            }
        }
        if own.mass_kg.is_some() && own.density_kg_m3.is_some() {
            problems.push(format!("{name}: mass_kg or density_kg_m3 must be left out"));
        }
    }
    if problems.is_empty() { Ok(table) } else { Err(unusable(format!("{shown}:\n  {}", problems.join("\n  ")))) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn usual_sizes_tell_metres_centimetres_and_millimetres_apart() {
        for (median, expected) in [
            (0.003, 1.0),
            (0.12, 1.0),
            (0.4, 1.0),
            (1.5, 0.1),
            (5.0, 0.01),
            (16.0, 0.01),
            (40.0, 0.001),
            (150.0, 0.001),
        ] {
            assert!((scale_for(median) - expected).abs() < 1e-12, "{median}: {}", scale_for(median));
        }
    }
}
