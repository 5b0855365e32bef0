//! Normal variates on a coarse lattice over an image, interpolated bilinearly: noise that is smooth over a few pixels.

use schema::{DepthImage, Stream};

/// Independent N(0, std²) values at lattice points that are evenly spaced over an image.
pub(super) struct Lattice {
    width_px: usize,
    height_px: usize,
    columns: usize,
    rows: usize,
    columns_per_px: f32,
    rows_per_px: f32,
    values: Vec<f32>,
}

impl Lattice {
    /// Draws values at points that are as far apart as cells of these sizes along u and v, in pixels.
    pub(super) fn of_cells(image: &DepthImage, [along_px, down_px]: [f32; 2], std: f32, stream: &mut Stream) -> Self {
        // Rounded up, so that the smallest image has a lattice point.
        let points = |pixels: usize, cell_px: f32| (pixels as f32 / cell_px).ceil() as usize;
        Self::draw(image, [points(image.width_px, along_px), points(image.height_px, down_px)], std, stream)
    }

    /// Draws `columns` times `rows` values for an image of this size.
    pub(super) fn draw(image: &DepthImage, [columns, rows]: [usize; 2], std: f32, stream: &mut Stream) -> Self {
        Self {
            width_px: image.width_px,
            height_px: image.height_px,
            columns,
            rows,
            columns_per_px: columns as f32 / image.width_px as f32,
            rows_per_px: rows as f32 / image.height_px as f32,
            values: (0..columns * rows).map(|_| stream.normal(0.0, std)).collect(),
        }
    }

    /// The value at a pixel. Beyond the lattice's edges it is 0, as in the image resizing that GIGA calls
    /// (`skimage.transform.resize`, `order=1`, `mode="constant"`).
    pub(super) fn at(&self, u: usize, v: usize) -> f32 {
        let [x, y] = self.place(u, v);
        let top = y.floor();
        let share = y - top;
        self.between(x, top) * (1.0 - share) + self.between(x, top + 1.0) * share
    }

    /// The values at all pixels, scaled to the standard deviation of the lattice points.
    ///
    /// A weighted mean of independent values has Σw² of their variance: a quarter of it midway between four points.
    /// Dividing by √Σw² over the existing points corrects that. There must be at least one point, and at most one per
    /// pixel.
    pub(super) fn even(&self) -> Vec<f32> {
        let columns: Vec<(f32, f32)> =
            (0..self.width_px).map(|u| self.place(u, 0)[0]).map(|x| (x, squared_shares(x, self.columns))).collect();
        let between = |y: f32| -> Vec<f32> { columns.iter().map(|(x, _)| self.between(*x, y)).collect() };
        let mut values = Vec::with_capacity(self.width_px * self.height_px);
        let (mut top, mut upper, mut lower) = (f32::NAN, Vec::new(), Vec::new());
        for v in 0..self.height_px {
            let y = self.place(0, v)[1];
            if y.floor() != top {
                top = y.floor();
                (upper, lower) = (between(top), between(top + 1.0));
            }
            let (share, squared) = (y - top, squared_shares(y, self.rows));
            let rows = upper.iter().zip(&lower).zip(&columns);
            values.extend(rows.map(|((upper, lower), (_, columns))| {
                (upper * (1.0 - share) + lower * share) / (columns * squared).sqrt()
            }));
        }
        values
    }

    /// The position of a pixel, in lattice points.
    fn place(&self, u: usize, v: usize) -> [f32; 2] {
        [(u as f32 + 0.5) * self.columns_per_px - 0.5, (v as f32 + 0.5) * self.rows_per_px - 0.5]
    }

    /// The value between the points on both sides of `x` in a row of points.
    fn between(&self, x: f32, y: f32) -> f32 {
        let left = x.floor();
        let share = x - left;
        self.point(left, y) * (1.0 - share) + self.point(left + 1.0, y) * share
    }

    fn point(&self, x: f32, y: f32) -> f32 {
        let inside = x >= 0.0 && y >= 0.0 && x < self.columns as f32 && y < self.rows as f32;
        if inside { self.values[y as usize * self.columns + x as usize] } else { 0.0 }
    }
}

/// Sum of the squared weights of the points on both sides of `x`, out of `count` on an axis.
fn squared_shares(x: f32, count: usize) -> f32 {
    let share = x - x.floor();
    let squared = |point: f32, share: f32| if (0.0..count as f32).contains(&point) { share * share } else { 0.0 };
    squared(x.floor(), 1.0 - share) + squared(x.floor() + 1.0, share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::tests::{flat_image, moments, stream};

    /// Corners, edges and every phase between the points. The variance of n normal variates is known to √(2 / n), as a
    /// share; five times that for the worst of 108 pixels.
    #[test]
    fn even_values_have_one_variance_at_every_pixel() {
        let (image, lattices) = (flat_image(12, 9, 1.0), 4000);
        let mut stream = stream(1);
        let mut values = vec![Vec::new(); 12 * 9];
        for _ in 0..lattices {
            let lattice = Lattice::draw(&image, [4, 3], 0.5, &mut stream);
            for (values, even) in values.iter_mut().zip(lattice.even()) {
                values.push(f64::from(even));
            }
        }
        let count = f64::from(lattices);
        for (pixel, values) in values.iter().enumerate() {
            let (mean, variance) = moments(values);
            assert!(mean.abs() < 5.0 * 0.5 / count.sqrt(), "mean {mean} at {pixel}");
            assert!((variance / 0.25 - 1.0).abs() < 5.0 * (2.0 / count).sqrt(), "variance {variance} at {pixel}");
        }
    }

    #[test]
    fn a_lattice_of_one_point_is_that_value_everywhere() {
        let lattice = Lattice::draw(&flat_image(3, 2, 1.0), [1, 1], 1.0, &mut stream(2));
        let even = lattice.even();
        assert_eq!(even.len(), 6);
        for (pixel, value) in even.iter().enumerate() {
            assert!((value - lattice.values[0]).abs() < 1e-5, "{value} at {pixel}");
        }
    }
}
