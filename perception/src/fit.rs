//! Points as the fits of planes go over them again and again: by coordinate, so that the compiler vectorises the loops.

use glamx::{DMat3, DSymmetricEigen3, DVec3};
use schema::Vec3;

/// Points that are summed side by side, whatever the machine's vectors are: sums have one order. Ten sums of two fit
/// into the registers that all machines have.
const LANES: usize = 2;
/// Points that are passed over together if none of them is marked.
const RUN: usize = 16;
/// Sums of which planes are made.
const TERMS: usize = 10;

/// Points by coordinate.
#[derive(Debug)]
pub(crate) struct Coordinates {
    x_m: Vec<f32>,
    y_m: Vec<f32>,
    z_m: Vec<f32>,
}

impl Coordinates {
    pub(crate) fn new(points_m: &[Vec3]) -> Self {
        let of = |axis: usize| points_m.iter().map(|at| at[axis]).collect();
        Self { x_m: of(0), y_m: of(1), z_m: of(2) }
    }

    /// The number of points.
    pub(crate) fn len(&self) -> usize {
        self.x_m.len()
    }

    /// How many points are meant.
    pub(crate) fn count(&self, is_meant: impl Fn(Vec3) -> bool) -> usize {
        let all = self.x_m.iter().zip(&self.y_m).zip(&self.z_m);
        all.map(|((x, y), z)| u32::from(is_meant(Vec3::new(*x, *y, *z)))).sum::<u32>() as usize
    }

    /// Marks the points that are meant with 1, and others with 0; gives the sums of the marked ones, and whether a mark
    /// changed.
    pub(crate) fn mark(&self, is_meant: impl Fn(Vec3) -> bool, marks: &mut [i32]) -> (Sums, bool) {
        let all = self.x_m.iter().zip(&self.y_m).zip(&self.z_m);
        let mut changes = 0;
        for (mark, ((x, y), z)) in marks.iter_mut().zip(all) {
            let now = i32::from(is_meant(Vec3::new(*x, *y, *z)));
            changes |= *mark ^ now;
            *mark = now;
        }
        (self.sums(marks), changes != 0)
    }

    /// The sums of the marked points.
    fn sums(&self, marks: &[i32]) -> Sums {
        // Offsets from one of them: squares of large numbers would leave few digits to small differences.
        let first = marks.iter().position(|mark| *mark != 0).unwrap_or(0);
        let at = |from: &[f32]| f64::from(from.get(first).copied().unwrap_or(0.0));
        let origin_m = DVec3::new(at(&self.x_m), at(&self.y_m), at(&self.z_m));
        let mut lanes = [[0.0; LANES]; TERMS];
        let runs = self.x_m.chunks(RUN).zip(self.y_m.chunks(RUN)).zip(self.z_m.chunks(RUN)).zip(marks.chunks(RUN));
        for (((x_m, y_m), z_m), marks) in runs.filter(|(_, marks)| marks.iter().fold(0, |any, mark| any | mark) != 0) {
            let ((x_m, rest_x), (y_m, rest_y)) = (x_m.as_chunks(), y_m.as_chunks());
            let ((z_m, rest_z), (marks, rest)) = (z_m.as_chunks(), marks.as_chunks());
            for (((x_m, y_m), z_m), marks) in x_m.iter().zip(y_m).zip(z_m).zip(marks) {
                add(&mut lanes, origin_m, [x_m, y_m, z_m], marks);
            }
            for (((x_m, y_m), z_m), mark) in rest_x.iter().zip(rest_y).zip(rest_z).zip(rest) {
                let [x_m, y_m, z_m] = [x_m, y_m, z_m].map(|along_m| [*along_m; LANES]);
                add(&mut lanes, origin_m, [&x_m, &y_m, &z_m], &[*mark, 0]);
            }
        }
        Sums { origin_m, terms: lanes.map(|lanes| lanes.iter().sum()) }
    }

    /// Root mean square of what `off_m` says of the marked points; 0 of none.
    pub(crate) fn residual_m(&self, off_m: impl Fn(Vec3) -> f32, marks: &[i32]) -> f32 {
        let all = self.x_m.iter().zip(&self.y_m).zip(&self.z_m).zip(marks).filter(|(_, mark)| **mark != 0);
        let squares = all.map(|(((x, y), z), _)| f64::from(off_m(Vec3::new(*x, *y, *z))).powi(2));
        let (sum, count) = squares.fold((0.0, 0_u32), |(sum, count), square| (sum + square, count + 1));
        (sum / f64::from(count.max(1))).sqrt() as f32
    }
}

/// Adds points to sums.
#[inline(always)]
fn add(lanes: &mut [[f64; LANES]; TERMS], origin_m: DVec3, [x_m, y_m, z_m]: [&[f32; LANES]; 3], marks: &[i32; LANES]) {
    let (mut weight, mut x, mut y, mut z) = ([0.0; LANES], [0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for lane in 0..LANES {
        weight[lane] = f64::from(marks[lane]);
        x[lane] = weight[lane] * (f64::from(x_m[lane]) - origin_m.x);
        y[lane] = weight[lane] * (f64::from(y_m[lane]) - origin_m.y);
        z[lane] = weight[lane] * (f64::from(z_m[lane]) - origin_m.z);
    }
    let one = [1.0; LANES];
    let terms = [(weight, one), (x, one), (y, one), (z, one), (x, x), (x, y), (x, z), (y, y), (y, z), (z, z)];
    for (sums, (a, b)) in lanes.iter_mut().zip(terms) {
        for lane in 0..LANES {
            sums[lane] += a[lane] * b[lane];
        }
    }
}

/// Sums over some points.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sums {
    /// Where offsets begin.
    origin_m: DVec3,
    /// The number of points, the sums of their offsets' x, y and z, and those of xx, xy, xz, yy, yz and zz.
    terms: [f64; TERMS],
}

impl Sums {
    /// The plane with the least sum of squared distances, by its normal and offset: through the mean, with the normal
    /// along the direction of least variance.
    pub(crate) fn plane(&self) -> Option<(Vec3, f32)> {
        let [count, x, y, z, xx, xy, xz, yy, yz, zz] = self.terms;
        if count < 3.0 {
            return None;
        }
        let mean = DVec3::new(x, y, z) / count;
        let squares = DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz));
        let off = DMat3::from_cols(mean * x, mean * y, mean * z);
        // Ascending order: the first vector has the least variance.
        let normal = DSymmetricEigen3::new(squares - off).eigenvectors.x_axis.try_normalize()?;
        Some((normal.as_vec3(), normal.dot(self.origin_m + mean) as f32))
    }
}
