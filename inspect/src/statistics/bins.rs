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

/// The bin of a value counted in bins; what lies outside counts at the ends.
pub(super) fn bin(value: f64, count: usize) -> usize {
    (value.max(0.0) as usize).min(count - 1) // whole, from 0, cut at the top
}

/// The bars of a histogram, from 0.
pub(super) fn bins(tallies: &[Tally], step: f64) -> Vec<Bin> {
    // To a micrometre or microdegree, so that 3 * 0.01 reads 0.03.
    let edge = |i: usize| (i as f64 * step * 1e6).round() / 1e6;
    let bin = |(i, labels): (usize, &Tally)| Bin { low: edge(i), high: edge(i + 1), labels: *labels };
    tallies.iter().enumerate().map(bin).collect()
}
