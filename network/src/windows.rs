//! The dense network on grids of other sizes.

use crate::dense::{DenseGrids, DenseNetwork};
use crate::receptive_field::RESOLUTION;

/// Neighbouring windows are at most so many voxels apart, so that a voxel is far from the faces of one of them.
const APART_MAX: usize = RESOLUTION / 2;
/// The logit where no window lies: a quality of 0.
const NOTHING: f32 = f32::NEG_INFINITY;

/// Where windows begin along an axis of so many voxels, and for each voxel the window in whose middle it is nearest.
fn windows(side: usize) -> (Vec<usize>, Vec<usize>) {
    let room = side.saturating_sub(RESOLUTION);
    let steps = room.div_ceil(APART_MAX);
    let starts: Vec<usize> = (0..=steps).map(|step| step * room / steps.max(1)).collect();
    let off = |voxel: usize, start: usize| (2 * voxel + 1).abs_diff(2 * start + RESOLUTION);
    let nearest = |voxel| (0..starts.len()).min_by_key(|window| off(voxel, starts[*window])).unwrap_or(0);
    let owners = (0..side).map(nearest).collect();
    (starts, owners)
}

impl DenseNetwork {
    /// One grid of `side`³ values, x slowest, as [`Self::infer`] does it for 40³. The network has learnt with the table
    /// near the bottom of its grid, so windows of 40³ slide over the floor, and each voxel has the answer of the window
    /// in whose middle it is nearest; a smaller grid is one of 40³ of which the rest was not observed. Voxels higher
    /// than 40 have no answer: a quality of 0.
    ///
    /// # Panics
    /// If it has another number of values.
    #[must_use]
    pub fn infer_over(&self, side: usize, grid: &[f32]) -> DenseGrids {
        if side == RESOLUTION {
            return self.infer(grid);
        }
        assert_eq!(grid.len(), side.pow(3), "one value a voxel");
        let (starts, owners) = windows(side);
        let (voxels, height) = (side.pow(3), side.min(RESOLUTION));
        let lines = |start: usize| (start..side.min(start + RESOLUTION)).enumerate();
        let mut all = DenseGrids {
            quality_logit: vec![NOTHING; voxels],
            rotation: [vec![0.0; 3 * voxels], vec![1.0; voxels]].concat(),
            width_voxels: vec![0.0; voxels],
            tips_voxels: Vec::new(),
        };
        for (window_x, x0) in starts.iter().enumerate() {
            for (window_y, y0) in starts.iter().enumerate() {
                let columns = || lines(*x0).flat_map(|x| lines(*y0).map(move |y| (x, y)));
                let mut window = vec![0.0; RESOLUTION.pow(3)];
                for ((to_x, x), (to_y, y)) in columns() {
                    let (to, from) = ((to_x * RESOLUTION + to_y) * RESOLUTION, (x * side + y) * side);
                    window[to..to + height].copy_from_slice(&grid[from..from + height]);
                }
                let seen = self.infer(&window);
                let tips = seen.tips_voxels.len() / RESOLUTION.pow(3);
                all.tips_voxels.resize(tips * voxels, 0.0);
                let is_own = |((_, x), (_, y)): &((usize, usize), (usize, usize))| {
                    (owners[*x], owners[*y]) == (window_x, window_y)
                };
                for (to, from, parts) in [
                    (&mut all.quality_logit, &seen.quality_logit, 1),
                    (&mut all.rotation, &seen.rotation, 4),
                    (&mut all.width_voxels, &seen.width_voxels, 1),
                    (&mut all.tips_voxels, &seen.tips_voxels, tips),
                ] {
                    for ((from_x, x), (from_y, y)) in columns().filter(is_own) {
                        let (column, own) = ((x * side + y) * side, (from_x * RESOLUTION + from_y) * RESOLUTION);
                        for part in 0..parts {
                            let values = &from[part * RESOLUTION.pow(3) + own..][..height];
                            to[part * voxels + column..][..height].copy_from_slice(values);
                        }
                    }
                }
            }
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::head::Head;
    use crate::layers::initial_of;
    use crate::upsampling::Upsampling;

    #[test]
    fn windows_cover_every_voxel_and_the_nearest_answers() {
        assert_eq!(windows(40), (vec![0], vec![0; 40]));
        assert_eq!(windows(27), (vec![0], vec![0; 27]));
        for side in 41..=80 {
            let (starts, owners) = windows(side);
            assert_eq!((starts[0], starts[starts.len() - 1] + RESOLUTION), (0, side));
            assert!(starts.windows(2).all(|pair| pair[1] - pair[0] <= APART_MAX), "{starts:?}");
            for (voxel, owner) in owners.iter().enumerate() {
                let within = voxel - starts[*owner];
                assert!(within < RESOLUTION, "{side}: {voxel}");
                // Of inner windows only the middle half answers.
                let is_inner = (10..side - 10).contains(&voxel);
                assert!(!is_inner || (10..=30).contains(&within), "{side}: voxel {voxel} is {within} of its window");
            }
        }
    }

    #[test]
    fn every_voxel_has_the_answer_of_its_window() {
        let value = |n: usize| ((n * 7919 % 1009) as f32 / 1009.0 - 0.5) * 0.2;
        for (head, side) in [(Head::Quaternion, 27), (Head::Quaternion, 53), (Head::Closings, 47)] {
            let network = DenseNetwork::new(&initial_of(head.layers(), 1), Upsampling::Linear, head);
            let grid: Vec<f32> = (0..side * side * side).map(|n| value(n) + 0.5).collect();
            let all = network.infer_over(side, &grid);
            let (starts, owners) = windows(side);
            for [x, y, z] in [[0, 0, 0], [5, 26, 11], [26, 3, 26], [side - 1, side - 1, 20], [side / 2, side / 2, 13]] {
                let [x0, y0] = [starts[owners[x]], starts[owners[y]]];
                let at = |x: usize, y: usize, z: usize| {
                    let is_inside = [x, y, z].iter().all(|at| *at < side);
                    if is_inside { grid[(x * side + y) * side + z] } else { 0.0 }
                };
                let window: Vec<f32> =
                    (0..RESOLUTION.pow(3)).map(|n| at(x0 + n / 1600, y0 + n / 40 % 40, n % 40)).collect();
                let (one, from, to) =
                    (network.infer(&window), ((x - x0) * 40 + y - y0) * 40 + z, (x * side + y) * side + z);
                assert_eq!(all.quality_logit[to], one.quality_logit[from]);
                assert_eq!(all.width_voxels[to], one.width_voxels[from]);
                for part in 0..4 {
                    assert_eq!(all.rotation[part * side.pow(3) + to], one.rotation[part * 64_000 + from]);
                }
                assert_eq!(all.tips_voxels.len() * 64_000, one.tips_voxels.len() * side.pow(3));
                for part in 0..one.tips_voxels.len() / 64_000 {
                    assert_eq!(all.tips_voxels[part * side.pow(3) + to], one.tips_voxels[part * 64_000 + from]);
                }
            }
            let above = 20 * side + side - 1;
            assert_eq!(all.quality_logit[above] == NOTHING, side > RESOLUTION);
        }
    }
}
