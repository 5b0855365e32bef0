//! Draws follow the laws of Appendix A and of the config: Pearson's χ² of many draws. `generator/src/candidates.rs`
//! compares the laws with the printed ones.

use generator::{Config, Overrides, RuleClosing, draw_candidate, draw_drops};
use schema::{Axis, ObjectRecord, Pose, Purpose, SLIDE_SHARE, ShapeKind, Solid, Stream, TIP_DEPTH_M, Tilt, law_of};

/// Bars of a histogram, each of which has the same share of a law.
const BARS: usize = 24;
/// Once in a million runs; the seeds are fixed.
const P_MIN: f64 = 1e-6;

/// A value's place in a law: the share of the law below it.
type Place = f64;

/// The probability that draws of a law are at least as far from it as these.
fn p_of(places: &[Place]) -> f64 {
    let mut counts = [0_u32; BARS];
    for place in places {
        assert!((0.0..=1.0).contains(place), "{place}");
        counts[((place * BARS as f64) as usize).min(BARS - 1)] += 1;
    }
    p_of_counts(&counts, &[1.0 / BARS as f64; BARS])
}

fn p_of_counts(counts: &[u32], shares: &[f64]) -> f64 {
    let total = f64::from(counts.iter().sum::<u32>());
    let expected = shares.iter().map(|share| share * total);
    let terms = counts.iter().zip(expected).map(|(count, expected)| (f64::from(*count) - expected).powi(2) / expected);
    above(terms.sum(), counts.len() - 1)
}

/// Probability that χ² exceeds a value: a sum of half as many terms as degrees of freedom.
fn above(statistic: f64, degrees: usize) -> f64 {
    let half = 0.5 * statistic;
    // The first term and the start of the sum: an even number of degrees has no normal tail in it.
    let (mut sum, mut term, mut place) = if degrees.is_multiple_of(2) {
        (0.0, libm::exp(-half), 1.0)
    } else {
        (libm::erfc(half.sqrt()), libm::exp(-half) * (half / core::f64::consts::PI).sqrt() * 2.0, 1.5)
    };
    for _ in 0..degrees / 2 {
        sum += term;
        term *= half / place;
        place += 1.0;
    }
    sum
}

fn normal(value: f64) -> Place {
    0.5 * libm::erfc(-value / core::f64::consts::SQRT_2)
}

fn uniform(value: f32, [low, high]: [f32; 2]) -> Place {
    let place = f64::from(value - low) / f64::from(high - low);
    // Rounding.
    if (-1e-5..1.0 + 1e-5).contains(&place) { place.clamp(0.0, 1.0) } else { place }
}

/// Values of scipy.stats.chi2.sf, and draws that are and are not of a law.
#[test]
fn the_test_tells_laws_apart() {
    for (statistic, degrees, expected) in [
        (0.5, 1, 4.795001221869534e-1),
        (3.84, 1, 5.004352124870519e-2),
        (12.592, 6, 4.999245818920999e-2),
        (23.0, 23, 4.607708905522919e-1),
        (73.6, 23, 3.340220847002128e-7),
        (40.0, 22, 1.081171882665272e-2),
    ] {
        let p = above(statistic, degrees);
        assert!((p / expected - 1.0).abs() < 1e-9, "{statistic} {degrees}: {p} against {expected}");
    }
    let even = |to: f64| (0..2400).map(|at| to * (f64::from(at) + 0.5) / 2400.0).collect::<Vec<_>>();
    assert!(p_of(&even(1.0)) > 0.999 && p_of(&even(0.9)) < 1e-12);
    assert!(p_of_counts(&[324, 100, 80, 96], &[0.25; 4]) < 1e-12);
}

#[test]
fn grasps_follow_appendix_a() {
    let (mut tilts, mut turns, mut tips, mut slides) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut stream = Stream::new(11, 1, Purpose::Candidates, 0);
    for (kind, axis) in ShapeKind::ALL.into_iter().flat_map(|kind| Axis::ALL.map(|axis| (kind, axis))) {
        let extents_m = match kind {
            ShapeKind::Cylinder => [0.04, 0.04, 0.07],
            ShapeKind::HalfCylinder => [0.07, 0.06, 0.03],
            _ => [0.03, 0.05, 0.07],
        };
        let object = ObjectRecord {
            scene_id: 1,
            object_id: 0,
            shape: Solid::new(kind, extents_m.into()).unwrap().into(),
            mass_kg: 0.1,
            friction: 1.0,
            workspace_from_object: Pose::IDENTITY,
        };
        let law = law_of(kind, axis);
        for _ in 0..5_000 {
            let drawn = draw_candidate(&object, 0, axis, RuleClosing::Drawn, &mut stream);
            tilts.push(match law.tilt {
                Tilt::Normal { std_rad } => normal(f64::from(drawn.tilt_rad / std_rad)),
                Tilt::Uniform { max_rad } => uniform(drawn.tilt_rad, [-max_rad, max_rad]),
            });
            if law.turns {
                turns.push(uniform(drawn.turn_rad, [0.0, core::f32::consts::TAU]));
            }
            let [side_m, closing] = [axis.of(extents_m.into()), drawn.closing.unwrap().of(extents_m.into())];
            tips.push(uniform(drawn.depth_m + 0.5 * side_m, TIP_DEPTH_M));
            if law.slides {
                let across_m = extents_m.iter().sum::<f32>() - side_m - closing;
                slides.push(normal(f64::from(drawn.slide_m / (SLIDE_SHARE * across_m))));
            }
        }
    }
    for (name, places) in [("tilt", tilts), ("turn", turns), ("depth of the tips", tips), ("slide", slides)] {
        assert!(places.len() >= 10_000 && p_of(&places) > P_MIN, "{name}: p = {}", p_of(&places));
    }
}

#[test]
fn objects_follow_the_config() {
    let config = Config::load(None, Overrides::default()).unwrap();
    let (objects, grid) = (&config.objects, &config.grid);
    let mut counts = vec![0; objects.counts.len()];
    let mut sizes = Vec::new();
    for scene_id in 0..4_000 {
        let drops = draw_drops(objects, grid, [0.3; 2], f32::INFINITY, config.seed, scene_id, 0);
        let number = objects.counts.iter().position(|count| *count == drops.len()).unwrap();
        counts[number] += 1;
        for drop in &drops {
            let solid = drop.body.as_solid().unwrap();
            let [x, y, z] = solid.extents_m.to_array();
            let free = match solid.kind {
                ShapeKind::Cuboid | ShapeKind::TriPrism => vec![x, y, z],
                ShapeKind::Cylinder => vec![x, z],
                ShapeKind::HalfCylinder => vec![x, y],
            };
            sizes.extend(free.into_iter().map(|side_m| uniform(side_m, objects.size_m)));
        }
    }
    let all: f32 = objects.count_weights.iter().sum();
    let shares: Vec<f64> = objects.count_weights.iter().map(|weight| f64::from(weight / all)).collect();
    assert!(p_of_counts(&counts, &shares) > P_MIN, "numbers of objects: {counts:?}");
    assert!(p_of(&sizes) > P_MIN, "sizes: p = {}", p_of(&sizes));
}
