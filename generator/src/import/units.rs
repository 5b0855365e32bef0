//! The unit of mesh files, which they do not name.

use rayon::prelude::*;

use super::source::Source;
use crate::mesh_file::read_mesh;

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
