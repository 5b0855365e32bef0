//! Exact integrals of a closed surface: volume, centre and second moments, as sums over its triangles.
//!
//! Each triangle forms a tetrahedron with the origin, whose integrals are polynomials of its corners. Triangles that
//! face the origin have a negative sign. Sums are in double precision in the triangles' order.

use glamx::{DMat3, DVec3};

use crate::Polyhedron;

/// The integrals over a body of density 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MassIntegrals {
    /// Volume in cubic metres; negative if the triangles are inside out.
    pub volume_m3: f64,
    first_m4: DVec3,
    second_m5: DMat3,
}

impl MassIntegrals {
    /// Of no body.
    pub const ZERO: Self = Self { volume_m3: 0.0, first_m4: DVec3::ZERO, second_m5: DMat3::ZERO };

    /// The integrals of the body that triangles enclose. They are counterclockwise from outside, in metres.
    #[must_use]
    pub fn of(triangles_m: impl IntoIterator<Item = [DVec3; 3]>) -> Self {
        let mut sum = Self::ZERO;
        for [a, b, c] in triangles_m {
            let volume_m3 = a.dot(b.cross(c)) / 6.0;
            let total = a + b + c;
            let squares = outer(total) + (outer(a) + outer(b) + outer(c));
            sum =
                sum.plus(&Self { volume_m3, first_m4: volume_m3 * total / 4.0, second_m5: volume_m3 * squares / 20.0 });
        }
        sum
    }

    /// The integrals over two bodies together.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            volume_m3: self.volume_m3 + other.volume_m3,
            first_m4: self.first_m4 + other.first_m4,
            second_m5: self.second_m5 + other.second_m5,
        }
    }

    /// Centre of mass in metres.
    #[must_use]
    pub fn centre_m(&self) -> DVec3 {
        self.first_m4 / self.volume_m3
    }

    /// Inertia about the centre of mass in kg m², along the axes, for a body of this mass.
    #[must_use]
    pub fn inertia_kg_m2(&self, mass_kg: f64) -> DMat3 {
        let spread = self.second_m5 / self.volume_m3 - outer(self.centre_m());
        let trace = spread.x_axis.x + spread.y_axis.y + spread.z_axis.z;
        mass_kg * (DMat3::from_diagonal(DVec3::splat(trace)) - spread)
    }
}

impl From<&Polyhedron> for MassIntegrals {
    fn from(polyhedron: &Polyhedron) -> Self {
        let corner = |number: usize| polyhedron.corners_m()[number].as_dvec3();
        Self::of(polyhedron.triangles().into_iter().map(|triangle| triangle.map(corner)))
    }
}

fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

#[cfg(test)]
mod tests {
    use glamx::DSymmetricEigen3;

    use super::*;
    use crate::{Purpose, Stream, Vec3};

    fn of(corners: &[[f64; 3]], triangles: &[[u32; 3]]) -> MassIntegrals {
        MassIntegrals::of(triangles.iter().map(|t| t.map(|corner| DVec3::from_array(corners[corner as usize]))))
    }

    /// A box with a corner at the origin: corners, and triangles that face outwards.
    fn closed_box(size: [f64; 3]) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
        let corner = |c: usize| core::array::from_fn(|axis| if c >> axis & 1 == 1 { size[axis] } else { 0.0 });
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = quads.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        ((0..8).map(corner).collect(), triangles)
    }

    fn assert_near(got: f64, expected: f64, share: f64) {
        assert!((got - expected).abs() <= share * expected.abs().max(1e-12), "{got} instead of {expected}");
    }

    #[test]
    fn a_box_has_the_textbooks_inertia_however_it_is_turned() {
        let [x, y, z] = [0.03, 0.05, 0.07];
        let (corners, triangles) = closed_box([x, y, z]);
        let exact = [(y * y + z * z), (x * x + z * z), (x * x + y * y)].map(|sum| 0.2 * sum / 12.0);
        let box_of = |corners: &[[f64; 3]]| of(corners, &triangles);
        let integrals = box_of(&corners);
        assert_near(integrals.volume_m3, x * y * z, 1e-12);
        for (axis, size) in [x, y, z].into_iter().enumerate() {
            assert_near(integrals.centre_m()[axis], 0.5 * size, 1e-12);
            assert_near(integrals.inertia_kg_m2(0.2).col(axis)[axis], exact[axis], 1e-12);
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
            let values = DSymmetricEigen3::eigenvalues(box_of(&moved).inertia_kg_m2(0.2)).to_array();
            for (got, expected) in values.into_iter().zip(sorted) {
                assert_near(got, expected, 1e-5); // the turned corners are rounded to single precision
            }
        }
    }

    #[test]
    fn a_tetrahedron_has_the_textbooks_integrals() {
        let corners = [[0.0; 3], [0.06, 0.0, 0.0], [0.0, 0.03, 0.0], [0.0, 0.0, 0.09]];
        let triangles = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let integrals = of(&corners, &triangles);
        let [a, b, c] = [0.06, 0.03, 0.09];
        assert_near(integrals.volume_m3, a * b * c / 6.0, 1e-12);
        for (got, edge) in integrals.centre_m().to_array().into_iter().zip([a, b, c]) {
            assert_near(got, edge / 4.0, 1e-12);
        }
        // About its centre: 3/80 of the squares on the diagonal, edge · edge / 80 off it.
        let inertia = integrals.inertia_kg_m2(1.0);
        assert_near(inertia.col(0)[0], 3.0 / 80.0 * (b * b + c * c), 1e-12);
        assert_near(inertia.col(2)[2], 3.0 / 80.0 * (a * a + b * b), 1e-12);
        assert_near(inertia.col(0)[1], a * b / 80.0, 1e-12);
        assert_near(inertia.col(1)[2], b * c / 80.0, 1e-12);
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
        let integrals = of(&corners, &triangles);
        assert_near(integrals.volume_m3, 4.0 / 3.0 * core::f64::consts::PI * radius.powi(3), 3e-3);
        for value in DSymmetricEigen3::eigenvalues(integrals.inertia_kg_m2(0.3)).to_array() {
            assert_near(value, 0.4 * 0.3 * radius * radius, 3e-3);
        }
        let inside_out: Vec<[u32; 3]> = triangles.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
        assert_near(of(&corners, &inside_out).volume_m3, -integrals.volume_m3, 1e-12);
    }

    #[test]
    fn two_halves_are_the_whole() {
        let (corners, triangles) = closed_box([0.03, 0.05, 0.07]);
        let whole = of(&corners, &triangles);
        let (low, _) = closed_box([0.03, 0.05, 0.035]);
        let high: Vec<[f64; 3]> = low.iter().map(|[x, y, z]| [*x, *y, z + 0.035]).collect();
        let [low, high] = [low, high].map(|half| of(&half, &triangles));
        let sum = low.plus(&high);
        assert_near(sum.volume_m3, whole.volume_m3, 1e-12);
        let (a, b) = (sum.inertia_kg_m2(1.0), whole.inertia_kg_m2(1.0));
        let norm = |m: DMat3| m.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt();
        assert!(norm(a - b) < 1e-12 * norm(b));
        assert!(norm(low.inertia_kg_m2(1.0) - b) > 0.1 * norm(b));
    }
}
