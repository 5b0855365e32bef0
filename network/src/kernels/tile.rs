//! The three products of which a convolution's step consists, on memory as it lies.
//!
//! As a product of matrices, a convolution's left matrix repeats every input kernel³ times. Here it is never written:
//! in channels-last order, the inputs of an output are one run of memory along z for each tap (a pair of kernel x and
//! y), so a product takes where its rows begin and how far each tap lies from there ([`super::conv`]).
//!
//! `T` rows by `R` vectors of columns are summed in registers. Each sum has its own order, whatever `T`, `R` and the
//! machine's vectors are. Tiles must have constant sizes: the compiler keeps sums in memory as soon as a loop over them
//! has a length that it does not know (half the speed, measured).

use pulp::{Arch, Simd, WithSimd};

/// Columns are padded to a multiple of this, the longest vector there is; no vector is cut.
pub(crate) const LANES: usize = 16;

/// `outputs[place(row)] = start + Σ over taps and runs of input · weight`, one row an output position.
pub(crate) struct Forward<'a> {
    pub inputs: &'a [f32],
    /// Where each row's inputs begin.
    pub rows: &'a [usize],
    /// How far each tap's run lies from there.
    pub taps: &'a [usize],
    /// Values in a run.
    pub run: usize,
    /// `[taps, run, columns]`.
    pub weights: &'a [f32],
    /// What every sum begins with, `[columns]`.
    pub start: &'a [f32],
    /// Whether negative sums become 0.
    pub relu: bool,
    /// Where each row's columns go.
    pub places: &'a [usize],
    pub outputs: &'a mut [f32],
}

/// `d_inputs[row, tap, run] += Σ over columns of gradient · weight`: the transpose of [`Forward`].
pub(crate) struct Backward<'a> {
    /// `[rows, columns]`.
    pub gradients: &'a [f32],
    pub rows: &'a [usize],
    pub taps: &'a [usize],
    /// Values in a run, a multiple of [`LANES`].
    pub run: usize,
    /// `[taps, columns, run]`.
    pub weights: &'a [f32],
    pub d_inputs: &'a mut [f32],
}

/// `d_weights[tap, run, column] += Σ over rows of input · gradient`.
pub(crate) struct Weights<'a> {
    pub inputs: &'a [f32],
    pub rows: &'a [usize],
    pub taps: &'a [usize],
    pub run: usize,
    /// `[rows, columns]`.
    pub gradients: &'a [f32],
    /// `[taps, run, columns]`.
    pub d_weights: &'a mut [f32],
}

/// Does the work with the longest vectors that the machine has.
pub(crate) fn run(work: impl WithSimd<Output = ()>) {
    Arch::new().dispatch(work);
}

impl Forward<'_> {
    /// All rows, `R` vectors of columns from vector `first` on; gives `R`.
    #[inline(always)]
    fn rows<S: Simd, const T: usize, const R: usize>(&mut self, simd: S, first: usize) -> usize {
        // The first layer's runs are so short that their loop costs more than its sums, unless its length is known.
        match self.run {
            5 => self.rows_of::<S, T, R, 5>(simd, first),
            _ => self.rows_of::<S, T, R, 0>(simd, first),
        }
    }

    /// With runs of `RUN` values, or of any number if it is 0.
    #[inline(always)]
    fn rows_of<S: Simd, const T: usize, const R: usize, const RUN: usize>(&mut self, simd: S, first: usize) -> usize {
        let (rows, rest) = self.rows.as_chunks::<T>();
        let (places, places_of_rest) = self.places.as_chunks::<T>();
        for (rows, places) in rows.iter().zip(places) {
            self.tile::<S, T, R, RUN>(simd, first, rows, places);
        }
        // One row at a time would wait for each product.
        let (rows, rest) = rest.as_chunks::<4>();
        let (places, places_of_rest) = places_of_rest.as_chunks::<4>();
        for (rows, places) in rows.iter().zip(places) {
            self.tile::<S, 4, R, RUN>(simd, first, rows, places);
        }
        for (row, place) in rest.iter().zip(places_of_rest) {
            self.tile::<S, 1, R, RUN>(simd, first, &[*row], &[*place]);
        }
        R
    }

    #[inline(always)]
    fn tile<S: Simd, const T: usize, const R: usize, const RUN: usize>(
        &mut self,
        simd: S,
        first: usize,
        rows: &[usize; T],
        places: &[usize; T],
    ) {
        let run = if RUN > 0 { RUN } else { self.run };
        let pitch = self.start.len() / S::F32_LANES;
        let weights = S::as_simd_f32s(self.weights).0;
        let start = &S::as_simd_f32s(self.start).0[first..][..R];
        let mut sums: [[S::f32s; R]; T] = [core::array::from_fn(|r| start[r]); T];
        for (tap, weights) in self.taps.iter().zip(weights.chunks_exact(run * pitch)) {
            let inputs: [&[f32]; T] = core::array::from_fn(|t| &self.inputs[rows[t] + tap..][..run]);
            for k in 0..run {
                let weights = &weights[k * pitch + first..][..R];
                for t in 0..T {
                    let input = simd.splat_f32s(inputs[t][k]);
                    for r in 0..R {
                        sums[t][r] = simd.mul_add_e_f32s(input, weights[r], sums[t][r]);
                    }
                }
            }
        }
        let zero = simd.splat_f32s(0.0);
        for t in 0..T {
            let outputs = &mut self.outputs[places[t] + first * S::F32_LANES..][..R * S::F32_LANES];
            let outputs = &mut S::as_mut_simd_f32s(outputs).0[..R];
            for r in 0..R {
                // In this order, what is no number stays none, and training notices.
                outputs[r] = if self.relu { simd.max_f32s(zero, sums[t][r]) } else { sums[t][r] };
            }
        }
    }
}

impl WithSimd for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let vectors = self.start.len() / S::F32_LANES;
        let mut first = 0;
        while first < vectors {
            first += match (S::F32_LANES, vectors - first) {
                (LANES, 1) => self.rows::<S, 16, 1>(simd, first),
                (LANES, 2) => self.rows::<S, 12, 2>(simd, first),
                (LANES, 4) => self.rows::<S, 6, 4>(simd, first),
                (LANES, _) => self.rows::<S, 8, 3>(simd, first),
                (_, 1) => self.rows::<S, 8, 1>(simd, first),
                _ => self.rows::<S, 6, 2>(simd, first),
            };
        }
    }
}

impl Backward<'_> {
    /// All rows of a tap, `R` vectors of the run from vector `first` on; gives `R`.
    #[inline(always)]
    fn rows<S: Simd, const T: usize, const R: usize>(&mut self, simd: S, tap: usize, first: usize) -> usize {
        let (tiles, rest) = self.rows.as_chunks::<T>();
        for (tile, rows) in tiles.iter().enumerate() {
            self.tile::<S, T, R>(simd, tap, first, tile * T, rows);
        }
        for (at, row) in rest.iter().enumerate() {
            self.tile::<S, 1, R>(simd, tap, first, tiles.len() * T + at, &[*row]);
        }
        R
    }

    #[inline(always)]
    fn tile<S: Simd, const T: usize, const R: usize>(
        &mut self,
        simd: S,
        tap: usize,
        first: usize,
        first_row: usize,
        rows: &[usize; T],
    ) {
        let columns = self.gradients.len() / self.rows.len();
        let pitch = self.run / S::F32_LANES;
        let weights = S::as_simd_f32s(&self.weights[tap * columns * self.run..][..columns * self.run]).0;
        let gradients: [&[f32]; T] = core::array::from_fn(|t| &self.gradients[(first_row + t) * columns..][..columns]);
        let mut sums = [[simd.splat_f32s(0.0); R]; T];
        for k in 0..columns {
            let weights = &weights[k * pitch + first..][..R];
            for t in 0..T {
                let gradient = simd.splat_f32s(gradients[t][k]);
                for r in 0..R {
                    sums[t][r] = simd.mul_add_e_f32s(gradient, weights[r], sums[t][r]);
                }
            }
        }
        let run = self.taps[tap] + first * S::F32_LANES;
        for t in 0..T {
            let d_inputs = &mut self.d_inputs[rows[t] + run..][..R * S::F32_LANES];
            let d_inputs = &mut S::as_mut_simd_f32s(d_inputs).0[..R];
            for r in 0..R {
                d_inputs[r] = simd.add_f32s(d_inputs[r], sums[t][r]);
            }
        }
    }
}

impl WithSimd for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let vectors = self.run / S::F32_LANES;
        for tap in 0..self.taps.len() {
            let mut first = 0;
            while first < vectors {
                first += match (S::F32_LANES, vectors - first) {
                    (LANES, 1) => self.rows::<S, 12, 1>(simd, tap, first),
                    (LANES, 2 | 4 | 5) => self.rows::<S, 12, 2>(simd, tap, first),
                    (LANES, _) => self.rows::<S, 8, 3>(simd, tap, first),
                    (_, 1) => self.rows::<S, 8, 1>(simd, tap, first),
                    _ => self.rows::<S, 6, 2>(simd, tap, first),
                };
            }
        }
    }
}

impl Weights<'_> {
    /// All weights, in blocks of `G` taps by `J` places of the run by `R` vectors of columns from vector `first` on;
    /// gives `R`.
    #[inline(always)]
    fn blocks<S: Simd, const G: usize, const J: usize, const R: usize>(&mut self, simd: S, first: usize) -> usize {
        for tap in (0..self.taps.len()).step_by(G) {
            let whole = self.run / J * J;
            for place in (0..whole).step_by(J) {
                self.block::<S, G, J, R>(simd, tap, place, first);
            }
            for g in 0..G {
                for place in whole..self.run {
                    self.block::<S, 1, 1, R>(simd, tap + g, place, first);
                }
            }
        }
        R
    }

    #[inline(always)]
    fn block<S: Simd, const G: usize, const J: usize, const R: usize>(
        &mut self,
        simd: S,
        tap: usize,
        place: usize,
        first: usize,
    ) {
        let pitch = self.gradients.len() / self.rows.len() / S::F32_LANES;
        let taps: [usize; G] = core::array::from_fn(|g| self.taps[tap + g] + place);
        let gradients = S::as_simd_f32s(self.gradients).0;
        let mut sums = [[[simd.splat_f32s(0.0); R]; J]; G];
        for (row, gradient) in self.rows.iter().zip(gradients.chunks_exact(pitch)) {
            let gradient = &gradient[first..][..R];
            for g in 0..G {
                let inputs = &self.inputs[row + taps[g]..][..J];
                for j in 0..J {
                    let input = simd.splat_f32s(inputs[j]);
                    for r in 0..R {
                        sums[g][j][r] = simd.mul_add_e_f32s(input, gradient[r], sums[g][j][r]);
                    }
                }
            }
        }
        let d_weights = S::as_mut_simd_f32s(self.d_weights).0;
        for g in 0..G {
            for j in 0..J {
                let to = &mut d_weights[((tap + g) * self.run + place + j) * pitch + first..][..R];
                for r in 0..R {
                    to[r] = simd.add_f32s(to[r], sums[g][j][r]);
                }
            }
        }
    }
}

impl WithSimd for Weights<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let vectors = self.gradients.len() / self.rows.len() / S::F32_LANES;
        let mut first = 0;
        while first < vectors {
            first += match (S::F32_LANES, vectors - first) {
                // The first layer: runs of five values, 25 taps.
                (LANES, 1) if self.run == 5 && self.taps.len().is_multiple_of(5) => {
                    self.blocks::<S, 5, 5, 1>(simd, first)
                }
                // The judge's first layer: runs of twelve values.
                (LANES, 1) if self.run == 12 => self.blocks::<S, 1, 12, 1>(simd, first),
                (LANES, 1) => self.blocks::<S, 1, 20, 1>(simd, first),
                (LANES, 4) => self.blocks::<S, 1, 6, 4>(simd, first),
                (LANES, _) if vectors - first >= 2 => self.blocks::<S, 1, 12, 2>(simd, first),
                (_, 1) => self.blocks::<S, 1, 10, 1>(simd, first),
                _ if self.run == 5 => self.blocks::<S, 1, 5, 2>(simd, first),
                _ => self.blocks::<S, 1, 6, 2>(simd, first),
            };
        }
    }
}
