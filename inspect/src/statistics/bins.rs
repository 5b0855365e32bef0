//! Histograms of attempts.

use serde::Serialize;
use shards::Tally;

/// A bar of a histogram: `low <= value < high`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Bin {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// How many they are.
    #[serde(flatten)]
    pub labels: Tally,
}

/// The bars of a histogram, from 0.
pub(super) fn bars(count: usize, step: f64) -> Vec<Bin> {
    // To a micrometre or microdegree, so that 3 * 0.01 reads 0.03.
    let edge = |i: usize| (i as f64 * step * 1e6).round() / 1e6;
    (0..count).map(|i| Bin { low: edge(i), high: edge(i + 1), labels: Tally::default() }).collect()
}

/// The bar of a value that is counted in bars; what lies outside counts at the ends.
pub(super) fn bar(bars: &mut [Bin], value: f64) -> &mut Tally {
    let last = bars.len() - 1;
    &mut bars[(value.max(0.0) as usize).min(last)].labels // whole, from 0, cut at the top
}
