//! Compares drawn numbers with their distributions: histograms and Pearson's χ².

use schema::{AttemptRecord, Axis, SLIDE_SHARE, ShapeKind, Solid, TIP_DEPTH_M, Tilt, law_of};
use serde::Serialize;

use super::bins::bin;

/// Number of bars of a histogram.
const BARS: usize = 24;
/// Bars with a smaller expected count are merged with their neighbours for χ².
const EXPECTED_MIN: f64 = 5.0;

/// Most different numbers of objects in a scene that are compared with their law.
const DROPPED_MAX: u64 = 100;

/// The name of the fit of a catalogue's objects.
pub(crate) const MODELS: &str = "objects of the catalogue";

/// The distribution of a number.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Law {
    /// Uniform in the histogram's range.
    Uniform,
    /// Standard normal.
    StandardNormal,
    /// Whole numbers with the weights of the config.
    Weights,
}

/// A histogram with its expected shares. Values outside the range count in the outermost bars.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Fit {
    /// Name of the number.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Its distribution.
    pub law: Law,
    /// Whether the data contain every draw, so that the distribution must fit: objects that fell off the table are
    /// missing.
    pub complete: bool,
    /// Its range.
    pub range: [f64; 2],
    /// Counts by bar.
    pub counts: Vec<u64>,
    /// Expected shares.
    pub expected: Vec<f64>,
}

/// Pearson's test.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ChiSquare {
    /// Σ (observed − expected)² / expected.
    pub(crate) statistic: f64,
    /// Number of bars minus one.
    pub(crate) degrees: usize,
    /// Probability that a sample of the distribution deviates at least as much.
    pub(crate) p: f64,
}

impl Fit {
    fn new(name: &'static str, unit: &'static str, law: Law, complete: bool, range: [f64; 2]) -> Self {
        // The cumulative distribution at the lower end of a bar.
        let below = |at: usize| {
            let value = range[0] + (range[1] - range[0]) * at as f64 / BARS as f64;
            match law {
                _ if at == 0 => 0.0,
                _ if at == BARS => 1.0,
                Law::StandardNormal => 0.5 * libm::erfc(-value / core::f64::consts::SQRT_2),
                Law::Uniform | Law::Weights => (value - range[0]) / (range[1] - range[0]),
            }
        };
        let expected = (0..BARS).map(|at| below(at + 1) - below(at)).collect();
        Self { name, unit, law, complete, range, counts: vec![0; BARS], expected }
    }

    /// Objects of a catalogue by their numbers: each is drawn as often as the others.
    pub(crate) fn of_models(counts: Vec<u64>) -> Self {
        let bars = counts.len();
        Self {
            name: MODELS,
            unit: "number in the catalogue",
            law: Law::Uniform,
            complete: false,
            range: [0.0, bars as f64],
            expected: vec![1.0 / bars as f64; bars],
            counts,
        }
    }

    /// Objects dropped in a scene: numbers, and their relative frequencies. `None` if they do not make a law.
    pub(crate) fn of_dropped(numbers: &[u64], weights: &[f64], complete: bool) -> Option<Self> {
        let (low, high) = (*numbers.iter().min()?, *numbers.iter().max()?);
        let all: f64 = weights.iter().sum();
        if weights.len() != numbers.len() || high - low > DROPPED_MAX || all <= 0.0 {
            return None;
        }
        let bars = (high - low) as usize + 1;
        let mut expected = vec![0.0; bars];
        for (number, weight) in numbers.iter().zip(weights) {
            expected[(number - low) as usize] += weight / all;
        }
        Some(Self {
            name: "objects dropped in a scene",
            unit: "objects",
            law: Law::Weights,
            complete,
            range: [low as f64 - 0.5, high as f64 + 0.5],
            counts: vec![0; bars],
            expected,
        })
    }

    fn count(&mut self, value: f64) {
        let ([low, high], bars) = (self.range, self.counts.len());
        self.counts[bin((value - low) / (high - low) * bars as f64, bars)] += 1;
    }

    /// Number of draws.
    pub(crate) fn total(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// The deviation of the draws from the distribution; `None` for too few draws.
    pub(crate) fn chi_square(&self) -> Option<ChiSquare> {
        let total = self.total() as f64;
        let mut joined: Vec<(f64, f64)> = Vec::new();
        let mut open = (0.0, 0.0);
        for (count, share) in self.counts.iter().zip(&self.expected) {
            open = (open.0 + *count as f64, open.1 + share * total);
            if open.1 >= EXPECTED_MIN {
                joined.push(open);
                open = (0.0, 0.0);
            }
        }
        let last = joined.last_mut()?;
        *last = (last.0 + open.0, last.1 + open.1);
        let degrees = joined.len() - 1;
        let statistic = joined.iter().map(|(seen, expected)| (seen - expected).powi(2) / expected).sum();
        (degrees > 0).then(|| ChiSquare { statistic, degrees, p: above(statistic, degrees) })
    }
}

/// Probability that χ² exceeds a value: a sum of half as many terms as degrees of freedom.
fn above(statistic: f64, degrees: usize) -> f64 {
    let half = 0.5 * statistic;
    let is_odd = !degrees.is_multiple_of(2);
    // The first term and the start of the sum: an even number of degrees has no normal tail in it.
    let (mut sum, mut term, mut place) = if is_odd {
        (libm::erfc(half.sqrt()), libm::exp(-half) * (half / core::f64::consts::PI).sqrt() * 2.0, 1.5)
    } else {
        (0.0, libm::exp(-half), 1.0)
    };
    for _ in 0..degrees / 2 {
        sum += term;
        term *= half / place;
        place += 1.0;
    }
    sum
}

/// The numbers with known distributions: those of Appendix A, and the sizes in the config.
#[derive(Debug, Clone)]
pub(crate) struct Fits {
    tilt_normal: Fit,
    tilt_uniform: Fit,
    turn: Fit,
    tip_depth: Fit,
    slide: Fit,
    size: Option<Fit>,
    dropped: Option<Fit>,
}

impl Fits {
    /// `size_m`: smallest and largest free extent, if the config contains it; `dropped`: the fit of the number of
    /// objects, likewise.
    pub(crate) fn new(size_m: Option<[f64; 2]>, dropped: Option<Fit>) -> Self {
        let normal = |name| Fit::new(name, "σ", Law::StandardNormal, true, [-4.0, 4.0]);
        let tip_mm = TIP_DEPTH_M.map(|m| 1000.0 * f64::from(m));
        let size = size_m.map(|range| Fit::new("free extents", "mm", Law::Uniform, false, range.map(|m| 1000.0 * m)));
        Self {
            tilt_normal: normal("tilt r_y of rules with a normal law"),
            tilt_uniform: Fit::new("tilt r_y of half-cylinders' sides", "°", Law::Uniform, true, [-90.0, 90.0]),
            turn: Fit::new("turn r_x of cylinders", "°", Law::Uniform, true, [0.0, 360.0]),
            tip_depth: Fit::new(
                "depth of the tips behind the near face, d_z + l_z / 2",
                "mm",
                Law::Uniform,
                true,
                tip_mm,
            ),
            slide: normal("slide d_x, in l_x / 6"),
            size,
            dropped,
        }
    }

    pub(crate) fn count_attempt(&mut self, attempt: &AttemptRecord, target: &Solid) {
        let (Some(approach), Some(closing)) = (attempt.rule.approach.axis(), attempt.closing) else { return };
        let law = law_of(target.kind, approach);
        let tilt_rad = f64::from(attempt.tilt_rad);
        match law.tilt {
            Tilt::Normal { std_rad } => self.tilt_normal.count(tilt_rad / f64::from(std_rad)),
            Tilt::Uniform { .. } => self.tilt_uniform.count(tilt_rad.to_degrees()),
        }
        if law.turns {
            self.turn.count(f64::from(attempt.turn_rad).to_degrees());
        }
        let tip_m = attempt.depth_m + 0.5 * approach.of(target.extents_m);
        self.tip_depth.count(1000.0 * f64::from(tip_m));
        let across = Axis::ALL.into_iter().find(|axis| *axis != approach && *axis != closing);
        if let Some(across) = across.filter(|_| law.slides) {
            self.slide.count(f64::from(attempt.slide_m / (SLIDE_SHARE * across.of(target.extents_m))));
        }
    }

    pub(crate) fn count_dropped(&mut self, objects: u32) {
        self.dropped.iter_mut().for_each(|fit| fit.count(f64::from(objects)));
    }

    pub(crate) fn count_object(&mut self, solid: &Solid) {
        let Some(size) = &mut self.size else { return };
        let [x, y, z] = solid.extents_m.to_array();
        let free: &[f32] = match solid.kind {
            ShapeKind::Cuboid | ShapeKind::TriPrism => &[x, y, z],
            ShapeKind::Cylinder => &[x, z],
            ShapeKind::HalfCylinder => &[x, y],
        };
        free.iter().for_each(|m| size.count(1000.0 * f64::from(*m)));
    }

    /// Those with any draws.
    pub(crate) fn finish(self) -> Vec<Fit> {
        let Self { tilt_normal, tilt_uniform, turn, tip_depth, slide, size, dropped } = self;
        let all = [Some(tip_depth), Some(tilt_normal), Some(tilt_uniform), Some(turn), Some(slide), size, dropped];
        all.into_iter().flatten().filter(|fit| fit.total() > 0).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// scipy.stats.chi2.sf.
    const EXPECTED: [(f64, usize, f64); 7] = [
        (0.5, 1, 4.795001221869534e-1),
        (3.84, 1, 5.004352124870519e-2),
        (12.592, 6, 4.999245818920999e-2),
        (23.0, 23, 4.607708905522919e-1),
        (60.0, 23, 3.820557959229886e-5),
        (73.6, 23, 3.340220847002128e-7),
        (40.0, 22, 1.081171882665272e-2),
    ];

    #[test]
    fn tails_are_those_of_scipy() {
        for (statistic, degrees, expected) in EXPECTED {
            let p = above(statistic, degrees);
            assert!((p / expected - 1.0).abs() < 1e-9, "{statistic} {degrees}: {p} against {expected}");
        }
    }

    #[test]
    fn shares_of_a_law_are_all_of_it() {
        for law in [Law::Uniform, Law::StandardNormal] {
            let fit = Fit::new("", "", law, true, [-4.0, 4.0]);
            assert!((fit.expected.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            assert!(fit.expected.iter().all(|share| *share > 0.0));
        }
    }

    #[test]
    fn draws_from_the_law_pass_and_others_do_not() {
        let even = |to: f64| {
            let mut fit = Fit::new("", "", Law::Uniform, true, [0.0, 1.0]);
            (0..2400).for_each(|at| fit.count(to * (f64::from(at) + 0.5) / 2400.0));
            fit.chi_square().unwrap()
        };
        assert!(even(1.0).statistic < 1e-9 && even(1.0).p > 0.999, "{:?}", even(1.0));
        // A tenth of the range is never drawn: two bars and a part of one stay empty.
        assert!(even(0.9).p < 1e-12, "{:?}", even(0.9));
        assert_eq!(even(1.0).degrees, BARS - 1);
    }

    #[test]
    fn an_object_that_is_missing_shows_among_the_others() {
        let of = |counts: [u64; 4]| Fit::of_models(counts.to_vec()).chi_square().unwrap();
        assert!(of([50, 52, 47, 51]).p > 0.9 && of([66, 66, 66, 2]).p < 1e-9);
        assert_eq!(of([50, 52, 47, 51]).degrees, 3);
    }

    #[test]
    fn scenes_of_few_objects_show_where_others_are_thrown_away() {
        let of = |counts: [u32; 5]| {
            let mut fit = Fit::of_dropped(&[1, 2, 3, 4, 6], &[1.0, 1.0, 1.0, 1.5, 1.5], true).unwrap();
            for (number, count) in [1, 2, 3, 4, 6].into_iter().zip(counts) {
                (0..count).for_each(|_| fit.count(f64::from(number)));
            }
            assert_eq!((fit.total(), fit.counts[4]), (u64::from(counts.iter().sum::<u32>()), 0));
            fit.chi_square().unwrap()
        };
        assert!(of([100, 100, 100, 150, 150]).p > 0.999, "{:?}", of([100, 100, 100, 150, 150]));
        assert!(of([324, 100, 80, 60, 36]).p < 1e-12);
        assert!(Fit::of_dropped(&[1, 2], &[1.0], true).is_none() && Fit::of_dropped(&[], &[], true).is_none());
    }

    #[test]
    fn bars_that_expect_too_little_are_joined() {
        let mut fit = Fit::new("", "", Law::StandardNormal, true, [-4.0, 4.0]);
        (0..100).for_each(|at| fit.count(if at % 2 == 0 { -0.5 } else { 0.5 }));
        let found = fit.chi_square().unwrap();
        assert!(found.degrees < BARS / 2 && found.degrees > 3, "{found:?}");
        assert!(Fit::new("", "", Law::Uniform, true, [0.0, 1.0]).chi_square().is_none(), "of nothing nothing is said");
    }
}
