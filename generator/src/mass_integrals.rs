//! Exact integrals of a closed surface: volume, centre and second moments, as sums over its triangles.
//!
//! Each triangle forms a tetrahedron with the origin, whose integrals are polynomials of its corners. Triangles that
//! face the origin have a negative sign. Sums are in double precision in the triangles' order.

/// The integrals of 1, x and x xᵀ over a body, in metres to the third, fourth and fifth power.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct MassIntegrals {
    volume_m3: f64,
    first_m4: [f64; 3],
    second_m5: [[f64; 3]; 3],
}

impl MassIntegrals {
    /// The integrals of a body enclosed by triangles that face outwards; corners in metres.
    #[must_use]
    pub fn of(triangles_m: impl IntoIterator<Item = [[f64; 3]; 3]>) -> Self {
        let mut sum = Self::default();
        for [a, b, c] in triangles_m {
            let volume = dot(a, cross(b, c)) / 6.0;
            let corners = [a, b, c];
            let total: [f64; 3] = core::array::from_fn(|i| a[i] + b[i] + c[i]);
            sum.volume_m3 += volume;
            for i in 0..3 {
                sum.first_m4[i] += volume * total[i] / 4.0;
                for j in 0..3 {
                    let squares: f64 = corners.iter().map(|p| p[i] * p[j]).sum();
                    sum.second_m5[i][j] += volume * (total[i] * total[j] + squares) / 20.0;
                }
            }
        }
        sum
    }

    /// The integrals of two bodies together.
    #[must_use]
    pub fn plus(mut self, other: &Self) -> Self {
        self.volume_m3 += other.volume_m3;
        for i in 0..3 {
            self.first_m4[i] += other.first_m4[i];
            for j in 0..3 {
                self.second_m5[i][j] += other.second_m5[i][j];
            }
        }
        self
    }

    /// Volume in cubic metres; negative if the triangles face inwards.
    #[must_use]
    pub fn volume_m3(&self) -> f64 {
        self.volume_m3
    }

    /// The centre of mass, in metres.
    #[must_use]
    pub fn centre_m(&self) -> [f64; 3] {
        self.first_m4.map(|m| m / self.volume_m3)
    }

    /// The inertia tensor about the centre of mass for a uniform body of `mass_kg`, in kg m².
    #[must_use]
    pub fn inertia_kg_m2(&self, mass_kg: f64) -> [[f64; 3]; 3] {
        let centre = self.centre_m();
        let spread = |i: usize, j: usize| self.second_m5[i][j] / self.volume_m3 - centre[i] * centre[j];
        let trace = (0..3).map(|i| spread(i, i)).sum::<f64>();
        core::array::from_fn(|i| core::array::from_fn(|j| mass_kg * (if i == j { trace } else { 0.0 } - spread(i, j))))
    }
}

/// Jacobi sweeps; five are enough to diagonalise a 3 × 3 matrix in double precision.
const SWEEPS: usize = 12;

/// The eigenvalues of a symmetric matrix, smallest first (Jacobi's rotations).
#[must_use]
pub fn principal_values(mut m: [[f64; 3]; 3]) -> [f64; 3] {
    for _ in 0..SWEEPS {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if m[p][q] == 0.0 {
                continue;
            }
            let theta = (m[q][q] - m[p][p]) / (2.0 * m[p][q]);
            let tangent = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let cos = 1.0 / (tangent * tangent + 1.0).sqrt();
            let sin = tangent * cos;
            let old = m;
            for k in 0..3 {
                m[k][p] = cos * old[k][p] - sin * old[k][q];
                m[k][q] = sin * old[k][p] + cos * old[k][q];
            }
            let half = m;
            m[p] = core::array::from_fn(|k| cos * half[p][k] - sin * half[q][k]);
            m[q] = core::array::from_fn(|k| sin * half[p][k] + cos * half[q][k]);
        }
    }
    let mut values = [m[0][0], m[1][1], m[2][2]];
    values.sort_by(f64::total_cmp);
    values
}

/// Difference of two tensors relative to the second (Frobenius norms).
#[must_use]
pub fn relative_difference(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> f64 {
    let norm = |of: &dyn Fn(usize, usize) -> f64| (0..9).map(|k| of(k / 3, k % 3)).map(|x| x * x).sum::<f64>().sqrt();
    norm(&|i, j| a[i][j] - b[i][j]) / norm(&|i, j| b[i][j])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use schema::{Purpose, Stream, Vec3};

    use super::*;
    use crate::mesh::Mesh;
    use crate::mesh::tests::closed_box;

    fn of(mesh: &Mesh) -> MassIntegrals {
        MassIntegrals::of(mesh.triangles_about([0.0; 3]))
    }

    fn assert_near(got: f64, expected: f64, share: f64) {
        assert!((got - expected).abs() <= share * expected.abs().max(1e-12), "{got} instead of {expected}");
    }

    #[test]
    fn a_box_has_the_textbooks_inertia_however_it_is_turned() {
        let [x, y, z] = [0.03, 0.05, 0.07];
        let (corners, triangles) = closed_box([x, y, z]);
        let exact = [(y * y + z * z), (x * x + z * z), (x * x + y * y)].map(|sum| 0.2 * sum / 12.0);
        let box_of = |corners: &[[f64; 3]]| of(&Mesh::new(corners, &triangles, 1.0).unwrap());
        let integrals = box_of(&corners);
        assert_near(integrals.volume_m3(), x * y * z, 1e-12);
        for (axis, size) in [x, y, z].into_iter().enumerate() {
            assert_near(integrals.centre_m()[axis], 0.5 * size, 1e-12);
            assert_near(integrals.inertia_kg_m2(0.2)[axis][axis], exact[axis], 1e-12);
        }
        let mut sorted = exact;
        sorted.sort_by(f64::total_cmp);
        let mut stream = Stream::new(1, 1, Purpose::Objects, 0);
        for _ in 0..20 {
            let (turn, at) = (stream.rotation(), stream.point(Vec3::splat(-0.1), Vec3::splat(0.1)));
            let moved: Vec<[f64; 3]> = corners
                .iter()
                .map(|c| (turn * Vec3::from_array(c.map(|v| v as f32)) + at).to_array().map(f64::from))
                .collect();
            let values = principal_values(box_of(&moved).inertia_kg_m2(0.2));
            for (got, expected) in values.into_iter().zip(sorted) {
                assert_near(got, expected, 1e-5); // the turned corners are rounded to single precision
            }
        }
    }

    #[test]
    fn a_tetrahedron_has_the_textbooks_integrals() {
        let corners = [[0.0; 3], [0.06, 0.0, 0.0], [0.0, 0.03, 0.0], [0.0, 0.0, 0.09]];
        let triangles = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let integrals = of(&Mesh::new(&corners, &triangles, 1.0).unwrap());
        let [a, b, c] = [0.06, 0.03, 0.09];
        assert_near(integrals.volume_m3(), a * b * c / 6.0, 1e-12);
        for (got, edge) in integrals.centre_m().into_iter().zip([a, b, c]) {
            assert_near(got, edge / 4.0, 1e-12);
        }
        // About its centre: 3/80 of the squares on the diagonal, edge · edge / 80 off it.
        let inertia = integrals.inertia_kg_m2(1.0);
        assert_near(inertia[0][0], 3.0 / 80.0 * (b * b + c * c), 1e-12);
        assert_near(inertia[2][2], 3.0 / 80.0 * (a * a + b * b), 1e-12);
        assert_near(inertia[0][1], a * b / 80.0, 1e-12);
        assert_near(inertia[1][2], b * c / 80.0, 1e-12);
    }

    /// Rings of latitude: the difference from the true ball falls with the square of the ring spacing.
    #[test]
    fn a_fine_ball_comes_near_the_balls_formulas() {
        let (rings, sectors, radius) = (60_u32, 120_u32, 0.04);
        let mut corners = vec![[0.0, 0.0, radius], [0.0, 0.0, -radius]];
        for ring in 1..rings {
            let (sin, cos) = libm::sincos(core::f64::consts::PI * f64::from(ring) / f64::from(rings));
            corners.extend((0..sectors).map(|sector| {
                let (s, c) = libm::sincos(core::f64::consts::TAU * f64::from(sector) / f64::from(sectors));
                [radius * sin * c, radius * sin * s, radius * cos]
            }));
        }
        let at = |ring: u32, sector: u32| 2 + (ring - 1) * sectors + sector % sectors;
        let mut triangles = Vec::new();
        for sector in 0..sectors {
            triangles.push([0, at(1, sector), at(1, sector + 1)]);
            triangles.push([1, at(rings - 1, sector + 1), at(rings - 1, sector)]);
            for ring in 1..rings - 1 {
                let [a, b] = [at(ring, sector), at(ring, sector + 1)];
                let [c, d] = [at(ring + 1, sector), at(ring + 1, sector + 1)];
                triangles.extend([[a, c, d], [a, d, b]]);
            }
        }
        let mesh = Mesh::new(&corners, &triangles, 1.0).unwrap();
        assert!(mesh.seams().is_watertight());
        let integrals = of(&mesh);
        assert_near(integrals.volume_m3(), 4.0 / 3.0 * core::f64::consts::PI * radius.powi(3), 3e-3);
        for value in principal_values(integrals.inertia_kg_m2(0.3)) {
            assert_near(value, 0.4 * 0.3 * radius * radius, 3e-3);
        }
        assert_near(of(&mesh.turned_inside_out()).volume_m3(), -integrals.volume_m3(), 1e-12);
    }

    #[test]
    fn two_halves_are_the_whole() {
        let (corners, triangles) = closed_box([0.03, 0.05, 0.07]);
        let whole = of(&Mesh::new(&corners, &triangles, 1.0).unwrap());
        let (low, _) = closed_box([0.03, 0.05, 0.035]);
        let high: Vec<[f64; 3]> = low.iter().map(|[x, y, z]| [*x, *y, z + 0.035]).collect();
        let [low, high] = [low, high].map(|half| of(&Mesh::new(&half, &triangles, 1.0).unwrap()));
        let sum = low.plus(&high);
        assert_near(sum.volume_m3(), whole.volume_m3(), 1e-12);
        let (a, b) = (sum.inertia_kg_m2(1.0), whole.inertia_kg_m2(1.0));
        assert!(relative_difference(&a, &b) < 1e-12);
        assert!(relative_difference(&low.inertia_kg_m2(1.0), &b) > 0.1);
    }
}
