//! How sure a number is.

use crate::{Purpose, Stream};

/// The 95 % interval of a value by bootstrap over groups, whose members are correlated: the middle of `draws` values.
/// `value` is that of groups drawn with replacement, given by their numbers, as many as there are; a draw without a
/// value does not count. `None` if no draw has one.
pub fn bootstrap(groups: usize, draws: u32, value: impl Fn(&[usize]) -> Option<f64>) -> Option<(f64, f64)> {
    let drawn = |draw| {
        let mut stream = Stream::new(0, 0, Purpose::Bootstrap, draw);
        value(&(0..groups).map(|_| stream.index(groups)).collect::<Vec<_>>())
    };
    let mut values: Vec<f64> = (0..draws).filter_map(drawn).collect();
    values.sort_by(f64::total_cmp);
    Some((quantile(&values, 0.025)?, quantile(&values, 0.975)?))
}

/// The same of a share, from the part and the whole of each group.
#[must_use]
pub fn bootstrap_share(groups: &[(u64, u64)], draws: u32) -> Option<(f64, f64)> {
    bootstrap(groups.len(), draws, |drawn| {
        let sum = |of: fn(&(u64, u64)) -> u64| drawn.iter().map(|group| of(&groups[*group])).sum::<u64>();
        let (part, whole) = (sum(|group| group.0), sum(|group| group.1));
        (whole > 0).then(|| part as f64 / whole as f64)
    })
}

/// A quantile of ascending values, linear between neighbours; `None` without values.
#[must_use]
pub fn quantile(ascending: &[f64], share: f64) -> Option<f64> {
    let last = ascending.len().checked_sub(1)?;
    let place = share * last as f64;
    let below = place as usize;
    let above = (below + 1).min(last);
    Some(ascending[below] + (place - below as f64) * (ascending[above] - ascending[below]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_lie_between_neighbours() {
        let ascending = [1.0, 2.0, 3.0, 4.0];
        assert_eq!(quantile(&ascending, 0.5), Some(2.5));
        assert!((quantile(&ascending, 0.9).unwrap() - 3.7).abs() < 1e-12);
        assert_eq!(quantile(&[], 0.5), None);
    }

    /// With one sample per group the interval is the binomial's. If the samples of a group agree, its width depends on
    /// the number of groups: √10 times wider for ten samples per group.
    #[test]
    fn an_interval_is_as_wide_as_groups_are_few() {
        let apart: Vec<(u64, u64)> = (0..400).map(|at| (u64::from(at % 5 > 0), 1)).collect();
        let together: Vec<(u64, u64)> = (0..40).map(|at| (10 * u64::from(at % 5 > 0), 10)).collect();
        for draws in [1000, 2000] {
            let (low, high) = bootstrap_share(&apart, draws).unwrap();
            let width = 2.0 * 1.96 * (0.8_f64 * 0.2 / 400.0).sqrt();
            assert!((high - low - width).abs() < 0.1 * width, "{low} {high}");
            assert!((low + high - 1.6).abs() < 0.01, "{low} {high}");
            let (few_low, few_high) = bootstrap_share(&together, draws).unwrap();
            let ratio = (few_high - few_low) / (high - low);
            assert!((ratio - 10.0_f64.sqrt()).abs() < 0.4, "{ratio}");
        }
    }

    /// Draws of empty groups alone are skipped, and the others are shares.
    #[test]
    fn empty_groups_are_drawn_but_never_divided_by() {
        assert_eq!(bootstrap_share(&[(0, 0), (1, 1), (0, 0), (0, 1)], 1000), Some((0.0, 1.0)));
        assert_eq!(bootstrap_share(&[(0, 0)], 1000), None);
        assert_eq!(bootstrap_share(&[], 1000), None);
    }
}
