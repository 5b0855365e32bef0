//! ×2 upsampling, linear or nearest, written as a small matrix along each axis.
//!
//! The dense network and the receptive field share the matrix; the latter uses only the required rows and columns.

use serde::Deserialize;
use settings::words;

words! {
    /// Interpolation between voxels when a grid is doubled.
    #[derive(Deserialize)]
    #[serde(rename_all = "lowercase")]
    pub enum Upsampling {
        /// Trilinear, half-pixel centres (`align_corners=False`), as in the paper.
        Linear = "linear",
        /// Each value eight times, as in VGN's code.
        Nearest = "nearest",
    }
}

impl Upsampling {
    /// The coarse positions, with weights, that contribute to fine position `fine` of `2 * coarse_len`.
    ///
    /// Linear: the source coordinate is `fine / 2 − 1/4`, clamped to 0 and the last position as in PyTorch. The two
    /// weights are ¼ and ¾ inside and refer to the same position at the ends.
    #[must_use]
    pub fn taps(self, fine: usize, coarse_len: usize) -> [(usize, f32); 2] {
        match self {
            Self::Nearest => [(fine / 2, 1.0), (fine / 2, 0.0)],
            Self::Linear if fine == 0 => [(0, 1.0), (0, 0.0)],
            Self::Linear => {
                let low = (fine - 1) / 2;
                let high = (low + 1).min(coarse_len - 1);
                let weight_high = if fine.is_multiple_of(2) { 0.75 } else { 0.25 };
                [(low, 1.0 - weight_high), (high, weight_high)]
            }
        }
    }

    /// First coarse position, inside or outside the volume, that contributes to fine positions from `fine` on.
    #[must_use]
    pub const fn first_coarse(self, fine: isize) -> isize {
        match self {
            Self::Linear => (fine - 1).div_euclid(2),
            Self::Nearest => fine.div_euclid(2),
        }
    }

    /// Maximum number of coarse positions that contribute to `fine_len` consecutive fine positions.
    #[must_use]
    pub const fn coarse_len(self, fine_len: usize) -> usize {
        match self {
            Self::Linear => fine_len / 2 + 2,
            Self::Nearest => fine_len / 2 + 1,
        }
    }

    /// Rows `fine_start..fine_start + fine_len`, columns `coarse_start..coarse_start + coarse_len` of the doubling
    /// matrix of an axis with `axis_len` coarse positions, row by row. Rows outside the volume are zero, which
    /// implements zero padding. Columns outside are zero, too, so values there do not count.
    #[must_use]
    pub fn window(
        self,
        axis_len: usize,
        fine_start: isize,
        fine_len: usize,
        coarse_start: isize,
        coarse_len: usize,
    ) -> Vec<f32> {
        let mut matrix = vec![0.0; fine_len * coarse_len];
        for row in 0..fine_len {
            let fine = fine_start + row as isize;
            if fine < 0 || fine >= 2 * axis_len as isize {
                continue;
            }
            for (coarse, weight) in self.taps(fine as usize, axis_len) {
                if weight > 0.0 {
                    let column = coarse as isize - coarse_start;
                    debug_assert!((0..coarse_len as isize).contains(&column), "the window misses a tap");
                    matrix[row * coarse_len + column as usize] += weight;
                }
            }
        }
        matrix
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_taps_are_those_of_half_pixel_centres() {
        for (fine, expected) in [
            (0, [(0, 1.0), (0, 0.0)]),
            (1, [(0, 0.75), (1, 0.25)]),
            (2, [(0, 0.25), (1, 0.75)]),
            (8, [(3, 0.25), (4, 0.75)]),
            (9, [(4, 0.75), (4, 0.25)]),
        ] {
            assert_eq!(Upsampling::Linear.taps(fine, 5), expected, "fine position {fine}");
        }
    }

    #[test]
    fn a_window_of_the_stated_length_always_holds_every_tap() {
        for mode in Upsampling::ALL {
            for fine_len in 1..10 {
                for fine_start in -9..29_isize {
                    let (start, len) = (mode.first_coarse(fine_start), mode.coarse_len(fine_len));
                    let matrix = mode.window(10, fine_start, fine_len, start, len);
                    for row in 0..fine_len {
                        let inside = (0..20).contains(&(fine_start + row as isize));
                        let sum: f32 = matrix[row * len..(row + 1) * len].iter().sum();
                        assert_eq!(sum, if inside { 1.0 } else { 0.0 }, "{mode:?} {fine_start}+{row}");
                    }
                }
            }
        }
    }
}
