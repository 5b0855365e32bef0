//! The triangles of a convex hull, in exact arithmetic.
//!
//! Points are added one by one: the triangles visible from a new point are removed, and the point is connected to the
//! boundary of the hole. Coordinates are rounded to integer multiples of 2⁻³⁶ m (15 pm), so that the side of a plane on
//! which a point lies is the sign of an integer. No tolerance is needed, and the triangles always close, also for
//! coplanar points.

use std::collections::BTreeSet;

use crate::Vec3;

/// A corner is less than 10 m from the origin along each axis, so volumes have less than 125 bits.
const UNITS_PER_M: f64 = (1_u64 << 36) as f64;

type Point = [i128; 3];

/// The hull's triangles, counter-clockwise seen from outside; `None` if all points are coplanar. The time grows with
/// the square of the number of points.
pub(crate) fn triangles_of_hull(points_m: &[Vec3]) -> Option<Vec<[Vec3; 3]>> {
    let units = |metres: f32| (f64::from(metres) * UNITS_PER_M).round() as i128;
    let points: Vec<Point> = points_m.iter().map(|point| point.to_array().map(units)).collect();
    let mut triangles = tetrahedron(&points)?;
    for (number, point) in points.iter().enumerate() {
        let sees = |triangle: &[usize; 3]| volume(triangle.map(|corner| points[corner]), *point) > 0;
        let (seen, kept): (Vec<_>, Vec<_>) = triangles.into_iter().partition(sees);
        let edges: BTreeSet<[usize; 2]> = seen.into_iter().flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
        let rim = edges.iter().filter(|[a, b]| !edges.contains(&[*b, *a]));
        triangles = kept.into_iter().chain(rim.map(|[a, b]| [*a, *b, number])).collect();
    }
    Some(triangles.into_iter().map(|triangle| triangle.map(|corner| points_m[corner])).collect())
}

/// Four triangles of the first points that are not coplanar.
fn tetrahedron(points: &[Point]) -> Option<Vec<[usize; 3]>> {
    let first = *points.first()?;
    let b = points.iter().position(|point| *point != first)?;
    let c = points.iter().position(|point| cross(minus(points[b], first), minus(*point, first)) != [0; 3])?;
    let base = [first, points[b], points[c]];
    let top = points.iter().position(|point| volume(base, *point) != 0)?;
    let [b, c] = if volume(base, points[top]) > 0 { [c, b] } else { [b, c] };
    Some(vec![[0, b, c], [b, 0, top], [c, b, top], [0, c, top]])
}

/// Six times the volume between a triangle and a point, positive if the point is on the triangle's outer side.
fn volume([a, b, c]: [Point; 3], point: Point) -> i128 {
    let (normal, arm) = (cross(minus(b, a), minus(c, a)), minus(point, a));
    normal[0] * arm[0] + normal[1] * arm[1] + normal[2] * arm[2]
}

fn minus(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
