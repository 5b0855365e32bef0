//! Choosing some of many.

/// Up to `count` of these scenes, one from each of as many equal parts: at places within the parts that do not repeat
/// (multiples of the golden ratio), for grippers take turns from scene to scene.
#[must_use]
pub fn spread(scenes: &[u64], count: usize) -> Vec<u64> {
    const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;
    let count = count.min(scenes.len());
    let start = |part: usize| part * scenes.len() / count;
    let place = |part: usize| {
        let long = (start(part + 1) - start(part)) as u128;
        start(part) + ((u128::from(GOLDEN.wrapping_mul(part as u64)) * long) >> 64) as usize
    };
    (0..count).map(|part| scenes[place(part)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_are_spread_without_repeating_and_do_not_walk_in_step() {
        let all: Vec<u64> = (0..100).collect();
        let shown = spread(&all, 12);
        assert!(shown.len() == 12 && shown.windows(2).all(|pair| pair[0] < pair[1]), "{shown:?}");
        assert!(
            shown
                .iter()
                .enumerate()
                .all(|(part, scene)| (part as u64 * 100 / 12..(part as u64 + 1) * 100 / 12).contains(scene))
        );
        for grippers in 2..=4 {
            let turns: std::collections::BTreeSet<u64> = shown.iter().map(|scene| scene % grippers).collect();
            assert_eq!(turns.len() as u64, grippers, "of {grippers} grippers that take turns all are seen: {shown:?}");
        }
        assert_eq!(spread(&[3, 5], 12), [3, 5]);
        assert_eq!(spread(&[], 12), Vec::<u64>::new());
    }
}
