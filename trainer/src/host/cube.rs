//! Convolutions over cubes of positions as runs of memory.
//!
//! A cube of side `n` holds `channels` values at each position, x slowest, channels fastest. One output of a convolution
//! is a row of kernel³ · channels inputs; for fixed kernel x and y, those along z are one run. What lies outside the cube
//! is zero, and nothing is scattered there.

/// A convolution over a cube.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cube {
    /// Side of the input.
    pub n: usize,
    /// Values at a position of the input.
    pub channels: usize,
    /// Side of the kernel.
    pub kernel: usize,
    /// Positions between outputs.
    pub stride: usize,
    /// Zeros at each side.
    pub padding: usize,
}

/// A run of one output's row that lies inside the cube: where it begins in the row and in the cube, and its length.
struct Run {
    row: usize,
    cube: usize,
    len: usize,
}

impl Cube {
    /// Side of the output.
    pub(crate) fn outputs(&self) -> usize {
        (self.n + 2 * self.padding - self.kernel) / self.stride + 1
    }

    /// Values of a row.
    pub(crate) fn row_len(&self) -> usize {
        self.kernel.pow(3) * self.channels
    }

    /// Values of the cube.
    pub(crate) fn len(&self) -> usize {
        self.n.pow(3) * self.channels
    }

    /// The rows of every output, one cube after the other.
    pub(crate) fn gather(&self, cubes: &[f32]) -> Vec<f32> {
        let len = cubes.len() / self.len() * self.outputs().pow(3) * self.row_len();
        if self.padding == 0 {
            // Every row is whole, and its runs come in order: nothing has to be zero before.
            let mut rows = Vec::with_capacity(len);
            for cube in cubes.chunks_exact(self.len()) {
                for output in 0..self.outputs().pow(3) {
                    self.for_runs(output, |run| rows.extend_from_slice(&cube[run.cube..run.cube + run.len]));
                }
            }
            return rows;
        }
        let mut rows = vec![0.0; len];
        let rows_of_cubes = rows.chunks_exact_mut(self.outputs().pow(3) * self.row_len());
        for (cube, rows) in cubes.chunks_exact(self.len()).zip(rows_of_cubes) {
            for (output, row) in rows.chunks_exact_mut(self.row_len()).enumerate() {
                self.for_runs(output, |run| {
                    row[run.row..run.row + run.len].copy_from_slice(&cube[run.cube..run.cube + run.len]);
                });
            }
        }
        rows
    }

    /// Adds every row to the inputs that it was gathered from.
    pub(crate) fn scatter(&self, rows: &[f32], cube: &mut [f32]) {
        for (output, row) in rows.chunks_exact(self.row_len()).enumerate() {
            self.for_runs(output, |run| {
                let from = &row[run.row..run.row + run.len];
                for (to, value) in cube[run.cube..run.cube + run.len].iter_mut().zip(from) {
                    *to += value;
                }
            });
        }
    }

    fn for_runs(&self, output: usize, mut visit: impl FnMut(Run)) {
        let (n, kernel, outputs) = (self.n, self.kernel, self.outputs());
        let first = |at: usize| (at * self.stride) as isize - self.padding as isize;
        let (x, y, z) =
            (first(output / (outputs * outputs)), first(output / outputs % outputs), first(output % outputs));
        let inside = |start: isize| {
            let skipped = (-start).max(0) as usize;
            skipped..kernel.min((n as isize - start).max(0) as usize)
        };
        let along_z = inside(z);
        if along_z.is_empty() {
            return;
        }
        let len = along_z.len() * self.channels;
        let cube_z = (z + along_z.start as isize) as usize;
        for kernel_x in inside(x) {
            let cube_x = (x + kernel_x as isize) as usize;
            for kernel_y in inside(y) {
                let cube_y = (y + kernel_y as isize) as usize;
                visit(Run {
                    row: ((kernel_x * kernel + kernel_y) * kernel + along_z.start) * self.channels,
                    cube: ((cube_x * n + cube_y) * n + cube_z) * self.channels,
                    len,
                });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every element by itself, from the definition of a convolution.
    fn gathered_slowly(cube: &Cube, values: &[f32]) -> Vec<f32> {
        let (n, k, m) = (cube.n as isize, cube.kernel, cube.outputs());
        let mut rows = Vec::new();
        for output in 0..m.pow(3) {
            for tap in 0..k.pow(3) {
                let at = |out: usize, tap: usize| (out * cube.stride + tap) as isize - cube.padding as isize;
                let place =
                    [at(output / (m * m), tap / (k * k)), at(output / m % m, tap / k % k), at(output % m, tap % k)];
                let is_inside = place.iter().all(|p| (0..n).contains(p));
                let start = ((place[0] * n + place[1]) * n + place[2]) * cube.channels as isize;
                rows.extend(
                    (0..cube.channels as isize).map(|c| if is_inside { values[(start + c) as usize] } else { 0.0 }),
                );
            }
        }
        rows
    }

    #[test]
    fn rows_are_those_of_a_convolution_and_scattering_is_the_transpose() {
        for (n, channels, kernel, stride, padding) in
            [(6, 2, 3, 1, 0), (6, 1, 5, 2, 2), (5, 3, 3, 2, 1), (5, 2, 3, 1, 1)]
        {
            let cube = Cube { n, channels, kernel, stride, padding };
            let values: Vec<f32> = (0..cube.len()).map(|i| i as f32 + 1.0).collect();
            let rows = cube.gather(&values);
            assert_eq!(rows, gathered_slowly(&cube, &values), "{cube:?}");
            // Each value comes back as often as it was taken.
            let mut counts = vec![0.0; cube.len()];
            let rows = cube.gather(&vec![1.0; cube.len()]);
            cube.scatter(&rows, &mut counts);
            let total: f32 = rows.iter().sum();
            assert_eq!(counts.iter().sum::<f32>(), total);
            for (i, count) in counts.into_iter().enumerate() {
                assert_eq!(count, rows_with(&cube, i), "{cube:?} {i}");
            }
        }
    }

    /// How many rows hold value `i`.
    fn rows_with(cube: &Cube, i: usize) -> f32 {
        let mut values = vec![0.0; cube.len()];
        values[i] = 1.0;
        gathered_slowly(cube, &values).iter().sum()
    }
}
