//! A convex part, ready for many lines: eight of its planes are looked at together.

use schema::{Plane, Vec3};
use wide::f32x8;

use crate::normals::Within;

const LANES: usize = 8;
/// No plane's number, below all.
const NONE: f32 = -1.0;

/// The planes of a convex part, and a ball about it.
pub(super) struct LinedPart {
    pub(super) planes: Vec<Plane>,
    /// The normals' x, y and z and the offsets of eight planes each; the last are filled up with what has no sides.
    lanes: Vec<[f32x8; 4]>,
    middle_m: Vec3,
    radius_m: f32,
}

impl LinedPart {
    pub(super) fn new(planes: Vec<Plane>, corners_m: &[Vec3]) -> Self {
        let lanes = planes.chunks(LANES).map(|planes| {
            let mut lanes = [[0.0; LANES], [0.0; LANES], [0.0; LANES], [f32::INFINITY; LANES]];
            for (lane, Plane { normal, offset_m }) in planes.iter().enumerate() {
                let numbers = [normal.x, normal.y, normal.z, *offset_m];
                (0..4).for_each(|number| lanes[number][lane] = numbers[number]);
            }
            lanes.map(f32x8::new)
        });
        let middle_m = corners_m.iter().sum::<Vec3>() / corners_m.len().max(1) as f32;
        let radius_m = corners_m.iter().map(|corner_m| (*corner_m - middle_m).length()).fold(0.0, f32::max);
        Self { lanes: lanes.collect(), planes, middle_m, radius_m }
    }

    /// As [`crate::normals::within`], to the bit, but for a line that ends at the part before its start: of that it may
    /// be `None`.
    pub(super) fn within(&self, at_m: Vec3, direction: Vec3) -> Option<Within> {
        let to_m = self.middle_m - at_m;
        let (along_m, far_m) = (to_m.dot(direction), 1.001 * self.radius_m + 1e-5);
        if along_m < -far_m || to_m.length_squared() - along_m * along_m > far_m * far_m {
            return None;
        }
        let splat = |at: Vec3| at.to_array().map(f32x8::splat);
        let ([to_x, to_y, to_z], [at_x, at_y, at_z]) = (splat(direction), splat(at_m));
        let (mut enter_m, mut exit_m) = (f32x8::splat(f32::NEG_INFINITY), f32x8::splat(f32::INFINITY));
        let (mut enters, mut exits, mut is_beside) = (f32x8::splat(NONE), f32x8::splat(NONE), f32x8::ZERO);
        let mut number = f32x8::ZERO;
        for [x, y, z, offset_m] in &self.lanes {
            let speed = *x * to_x + *y * to_y + *z * to_z;
            let gap_m = *offset_m - (*x * at_x + *y * at_y + *z * at_z);
            let way_m = gap_m / speed;
            let is_entered = speed.simd_lt(f32x8::ZERO) & way_m.simd_gt(enter_m);
            let is_left = speed.simd_gt(f32x8::ZERO) & way_m.simd_lt(exit_m);
            enter_m = is_entered.bitselect(way_m, enter_m);
            enters = is_entered.bitselect(number, enters);
            exit_m = is_left.bitselect(way_m, exit_m);
            exits = is_left.bitselect(number, exits);
            is_beside |= speed.simd_eq(f32x8::ZERO) & gap_m.simd_lt(f32x8::ZERO);
            number += f32x8::ONE;
        }
        let [enter_m, exit_m, enters, exits] = [enter_m, exit_m, enters, exits].map(f32x8::to_array);
        // Of planes that are met at once the first one counts.
        let place = |numbers: &[f32; LANES], lane: usize| numbers[lane] as usize * LANES + lane;
        let (mut first, mut last) = (None::<usize>, None::<usize>);
        for lane in 0..LANES {
            let is_first = |other: usize| {
                enter_m[lane] > enter_m[other]
                    || (enter_m[lane] == enter_m[other] && place(&enters, lane) < place(&enters, other))
            };
            if enters[lane] >= 0.0 && first.is_none_or(is_first) {
                first = Some(lane);
            }
            let is_last = |other: usize| {
                exit_m[lane] < exit_m[other]
                    || (exit_m[lane] == exit_m[other] && place(&exits, lane) < place(&exits, other))
            };
            if exits[lane] >= 0.0 && last.is_none_or(is_last) {
                last = Some(lane);
            }
        }
        let first = first.filter(|_| !is_beside.any())?;
        let (enter_m, exit_m) = (enter_m[first], last.map_or(f32::INFINITY, |lane| exit_m[lane]));
        let exit_normal = last.map_or(Vec3::ZERO, |lane| self.planes[place(&exits, lane)].normal);
        let normal = self.planes[place(&enters, first)].normal;
        (enter_m < exit_m).then_some(Within { enter_m, exit_m, normal, exit_normal })
    }
}

#[cfg(test)]
mod tests {
    use schema::{Polyhedron, Purpose, ShapeKind, Solid, Stream};
    use simulator::Body;

    use super::*;
    use crate::normals::within;

    /// Lines from anywhere, and along axes, beside edges and through corners, where planes are met at once.
    #[test]
    fn lines_end_where_the_plain_loop_says() {
        let mut stream = Stream::new(5, 0, Purpose::Views, 0);
        let kinds = [ShapeKind::Cuboid, ShapeKind::Cylinder, ShapeKind::TriPrism, ShapeKind::HalfCylinder];
        for kind in kinds {
            let high_m = if kind == ShapeKind::HalfCylinder { 0.03 } else { 0.06 };
            let extents_m = Vec3::new(0.06, 0.06, high_m);
            let body: Body = Solid::new(kind, extents_m).unwrap().into();
            let polyhedra = body.polyhedra();
            let polyhedron: &Polyhedron = &polyhedra[0];
            let part = LinedPart::new(polyhedron.planes().collect(), polyhedron.corners_m());
            let (mut hits, count) = (0, 20_000);
            for number in 0..count {
                let at_m = stream.point(Vec3::splat(-0.06), Vec3::splat(0.06));
                let whole = |at: Vec3, unit: f32| (at / unit).round() * unit;
                let (at_m, direction) = match number % 3 {
                    0 => (at_m, stream.rotation() * Vec3::X),
                    1 => (whole(at_m, 0.01), [Vec3::X, Vec3::NEG_Y, Vec3::Z][number / 3 % 3]),
                    _ => (whole(at_m, 0.03), whole(at_m, 0.03).normalize_or(Vec3::X)),
                };
                let (plain, fast) = (within(&part.planes, at_m, direction), part.within(at_m, direction));
                let bits = |found: &Within| {
                    let Within { enter_m, exit_m, normal, exit_normal } = found;
                    ([enter_m.to_bits(), exit_m.to_bits()], *normal, *exit_normal)
                };
                let plain = plain.filter(|plain| plain.exit_m > 0.0);
                let fast = fast.filter(|fast| fast.exit_m > 0.0);
                assert_eq!(plain.as_ref().map(bits), fast.as_ref().map(bits), "{kind:?} {at_m} {direction}");
                hits += usize::from(plain.is_some());
            }
            assert!(hits > count / 20, "{kind:?}: {hits}");
        }
    }
}
