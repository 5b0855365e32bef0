//! Doubling a patch, and the transpose of it, by the taps of each row.

use crate::receptive_field::{COARSEST, PatchSizes, axis_windows, window_from_whole_10};
use crate::upsampling::Upsampling;

/// The doubling of one axis of a patch: of which coarse positions each fine one is made, with weights.
#[derive(Debug, Clone)]
struct Axis {
    coarse: usize,
    taps: Vec<[(usize, f32); 2]>,
}

impl Axis {
    fn new(matrix: &[f32], coarse: usize) -> Self {
        let taps_of = |row: &[f32]| {
            let mut taps = [(0, 0.0); 2];
            let used = row.iter().copied().enumerate().filter(|(_, weight)| *weight != 0.0);
            for (slot, tap) in taps.iter_mut().zip(used) {
                *slot = tap;
            }
            taps
        };
        Self { coarse, taps: matrix.chunks_exact(coarse).map(taps_of).collect() }
    }

    /// `outer` blocks of `coarse` runs of `run` values become blocks of as many runs as there are fine positions.
    fn double(&self, run: usize, input: &[f32]) -> Vec<f32> {
        let mut output = vec![0.0; input.len() / self.coarse * self.taps.len()];
        let blocks = input.chunks_exact(self.coarse * run).zip(output.chunks_exact_mut(self.taps.len() * run));
        for (coarse, fine) in blocks {
            for (taps, to) in self.taps.iter().zip(fine.chunks_exact_mut(run)) {
                let [(a, wa), (b, wb)] = *taps;
                if wa != 0.0 {
                    let (a, b) = (&coarse[a * run..][..run], &coarse[b * run..][..run]);
                    for ((to, a), b) in to.iter_mut().zip(a).zip(b) {
                        *to = wa * a + wb * b;
                    }
                }
            }
        }
        output
    }

    /// The transpose of [`Self::double`].
    fn halve(&self, run: usize, input: &[f32]) -> Vec<f32> {
        let mut output = vec![0.0; input.len() / self.taps.len() * self.coarse];
        let blocks = input.chunks_exact(self.taps.len() * run).zip(output.chunks_exact_mut(self.coarse * run));
        for (fine, coarse) in blocks {
            for (taps, from) in self.taps.iter().zip(fine.chunks_exact(run)) {
                for (at, weight) in taps.iter().filter(|(_, weight)| *weight != 0.0) {
                    for (to, from) in coarse[at * run..][..run].iter_mut().zip(from) {
                        *to += weight * from;
                    }
                }
            }
        }
        output
    }
}

/// The doubling of a patch along its three axes.
#[derive(Debug, Clone)]
pub(crate) struct Doubling([Axis; 3]);

impl Doubling {
    /// The last two doublings around a voxel: of a whole volume of 10³, and of the patch that the last convolution
    /// makes of it.
    pub(crate) fn around(voxel: [usize; 3], mode: Upsampling) -> [Self; 2] {
        let from_whole = voxel.map(|coordinate| Axis::new(&window_from_whole_10(coordinate, mode), 2 * COARSEST));
        let from_patch = voxel.map(|coordinate| {
            let [.., window] = axis_windows(coordinate, mode);
            Axis::new(&window, PatchSizes::new(mode).conv3_out)
        });
        [Self(from_whole), Self(from_patch)]
    }

    /// The doubling of a whole volume of `n` positions a side, with so many zeros around what comes out.
    pub(crate) fn of_volume(n: usize, padding: usize, mode: Upsampling) -> Self {
        let matrix = mode.window(n, -(padding as isize), 2 * (n + padding), 0, n);
        Self(core::array::from_fn(|_| Axis::new(&matrix, n)))
    }

    /// Shapes: `[n, n, n, channels]` to `[m, m, m, channels]`.
    pub(crate) fn double(&self, channels: usize, patch: &[f32]) -> Vec<f32> {
        let [x, y, z] = &self.0;
        let along_x = x.double(y.coarse * z.coarse * channels, patch);
        let along_y = y.double(z.coarse * channels, &along_x);
        z.double(channels, &along_y)
    }

    /// The transpose. Shapes: `[m, m, m, channels]` to `[n, n, n, channels]`.
    pub(crate) fn halve(&self, channels: usize, patch: &[f32]) -> Vec<f32> {
        let [x, y, z] = &self.0;
        let along_z = z.halve(channels, patch);
        let along_y = y.halve(z.coarse * channels, &along_z);
        x.halve(y.coarse * z.coarse * channels, &along_y)
    }
}

#[cfg(test)]
mod tests {
    use schema::{Purpose, Stream};

    use super::*;

    /// ⟨double(a), b⟩ = ⟨a, halve(b)⟩ for any a and b.
    #[test]
    fn halving_is_the_transpose_of_doubling() {
        let mut draw = Stream::new(4, 0, Purpose::Views, 0);
        for mode in Upsampling::ALL {
            let sizes = crate::receptive_field::PatchSizes::new(mode);
            let coarse = [10, sizes.conv3_out];
            let fine = [sizes.conv3_in, sizes.heads_in];
            for voxel in [[0, 0, 0], [39, 20, 1], [17, 23, 39]] {
                for (level, doubling) in Doubling::around(voxel, mode).iter().enumerate() {
                    let mut values =
                        |side: usize| -> Vec<f32> { (0..side.pow(3) * 3).map(|_| draw.uniform(-1.0, 1.0)).collect() };
                    let (a, b) = (values(coarse[level]), values(fine[level]));
                    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum::<f64>();
                    let (forth, back) = (dot(&doubling.double(3, &a), &b), dot(&a, &doubling.halve(3, &b)));
                    assert!((forth - back).abs() < 1e-3, "{mode:?} {voxel:?} level {level}: {forth} {back}");
                }
            }
        }
    }
}
