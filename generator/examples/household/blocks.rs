//! Building blocks: convex parts, each as the points whose hull it is.
//!
//! Round walls are rings of pieces that meet in planes through the axis; bent bodies are rows of pieces that meet in
//! planes across the path. So parts touch, do not overlap, and have flat faces at any size.

use core::f64::consts::TAU;

use glamx::Vec2;
use schema::{Quat, Vec3, axis_angle};

/// The corners of a convex part, in metres.
pub(super) type Part = Vec<Vec3>;

/// The corners of a regular polygon on the circle of radius 1; the middle of a side is at +x.
pub(super) fn circle(sides: usize) -> Vec<Vec2> {
    superellipse(sides, 2.0, Vec2::ONE)
}

/// Corners on |x/a|^p + |y/b|^p = 1 with the normals of a regular polygon, so that no two sides are nearly in line.
/// Two is an ellipse, four a rounded rectangle.
pub(super) fn superellipse(sides: usize, power: f32, half: Vec2) -> Vec<Vec2> {
    let power = f64::from(power);
    let corner = |number: usize| {
        let (sin, cos) = libm::sincos((number as f64 + 0.5) * TAU / sides as f64);
        let along = [cos, sin].map(|c: f64| libm::pow(c.abs(), 1.0 / (power - 1.0)).copysign(c));
        let norm = libm::pow(along.iter().map(|c| libm::pow(c.abs(), power)).sum(), 1.0 / power);
        half * Vec2::new((along[0] / norm) as f32, (along[1] / norm) as f32)
    };
    (0..sides).map(corner).collect()
}

/// Points on an arc of an ellipse in degrees from +x, both ends included.
pub(super) fn arc(centre: Vec2, half: Vec2, [from_deg, to_deg]: [f32; 2], pieces: usize) -> Vec<Vec2> {
    let at = |number: usize| {
        let angle_deg = from_deg + (to_deg - from_deg) * number as f32 / pieces as f32;
        let (sin, cos) = libm::sincosf(angle_deg.to_radians());
        centre + half * Vec2::new(cos, sin)
    };
    (0..=pieces).map(at).collect()
}

/// An outline, scaled to each level: (scale, height), from the bottom up. Where the profile is concave, and where two
/// levels have one height, another part begins.
pub(super) fn stack(outline: &[Vec2], levels: &[[f32; 2]]) -> Vec<Part> {
    let slope = |level: usize| (levels[level + 1][0] - levels[level][0]) / (levels[level + 1][1] - levels[level][1]);
    let is_step = |level: usize| levels[level + 1][1] <= levels[level][1];
    let (mut parts, mut first) = (Vec::new(), 0);
    for last in 1..levels.len() {
        if is_step(last - 1) {
            first = last;
            continue;
        }
        if last + 1 == levels.len() || is_step(last) || slope(last) > slope(last - 1) {
            let ring = |[scale, z]: &[f32; 2]| outline.iter().map(|p| (*scale * *p).extend(*z)).collect::<Vec<_>>();
            parts.push(levels[first..=last].iter().flat_map(ring).collect());
            first = last;
        }
    }
    parts
}

/// A convex outline between two heights.
pub(super) fn prism(outline: &[Vec2], [low, high]: [f32; 2]) -> Vec<Part> {
    stack(outline, &[[1.0, low], [1.0, high]])
}

/// A wall along an outline: the section's points are (scale of the outline, height). A part for each side.
pub(super) fn walls(outline: &[Vec2], section: &[Vec2]) -> Vec<Part> {
    let sides = outline.iter().zip(outline.iter().cycle().skip(1));
    let piece =
        |(a, b): (&Vec2, &Vec2)| section.iter().flat_map(|s| [a, b].map(|end| (s.x * *end).extend(s.y))).collect();
    sides.map(piece).collect()
}

/// A wall of one thickness inside a profile of (scale of the outline, height), from the bottom up.
pub(super) fn shell(outline: &[Vec2], profile: &[Vec2], wall_m: f32) -> Vec<Part> {
    sections(profile, wall_m).iter().flat_map(|section| walls(outline, section)).collect()
}

/// The same with a floor.
pub(super) fn vessel(outline: &[Vec2], profile: &[Vec2], wall_m: f32) -> Vec<Part> {
    let low = Vec2::new(0.0, profile[0].y);
    let sections = sections(&[&[low], profile].concat(), wall_m);
    let [_, outer, inner, _] = sections[0];
    let floor = stack(outline, &[outer.to_array(), inner.to_array()]);
    floor.into_iter().chain(sections[1..].iter().flat_map(|section| walls(outline, section))).collect()
}

/// The quadrilaterals between a path and the path at a distance to its left, one for each piece.
fn sections(path: &[Vec2], distance: f32) -> Vec<[Vec2; 4]> {
    let left: Vec<Vec2> = path.iter().zip(mitres(path)).map(|(point, mitre)| *point + distance * mitre).collect();
    (1..path.len()).map(|end| [path[end - 1], path[end], left[end], left[end - 1]]).collect()
}

/// At each point of a path the vector to the parallel path at distance 1 on its left.
fn mitres(path: &[Vec2]) -> Vec<Vec2> {
    let normals: Vec<Vec2> = path.windows(2).map(|ends| (ends[1] - ends[0]).normalize().perp()).collect();
    let mitre = |point: usize| {
        let sum = normals[point.saturating_sub(1)] + normals[point.min(normals.len() - 1)];
        sum * (2.0 / sum.length_squared())
    };
    (0..path.len()).map(mitre).collect()
}

/// A body along a path in the plane of x and z with an outline (x across the path, y along y) that is scaled at each
/// point. Each piece is a part of a pyramid, so its sides are flat although its ends are not parallel.
pub(super) fn sweep(path: &[Vec2], outline: &[Vec2], scales: &[f32]) -> Vec<Part> {
    let (mitres, upright) = (mitres(path), |p: Vec2| Vec3::new(p.x, 0.0, p.y));
    let begin = |o: &Vec2| scales[0] * (o.x * upright(mitres[0]) + o.y * Vec3::Y) + upright(path[0]);
    let mut ring: Vec<Vec3> = outline.iter().map(begin).collect();
    let mut parts = Vec::new();
    for end in 1..path.len() {
        let [from, to, normal] = [path[end - 1], path[end], mitres[end].perp()].map(upright);
        let narrowing = 1.0 - scales[end] / scales[end - 1];
        // From each corner towards the pyramid's apex to the plane in which this piece ends.
        let project = |corner: &Vec3| {
            let along = to - from + narrowing * (from - *corner);
            *corner + along * ((to - *corner).dot(normal) / along.dot(normal))
        };
        let next: Vec<Vec3> = ring.iter().map(project).collect();
        parts.push([&ring[..], &next].concat());
        ring = next;
    }
    parts
}

/// A box between two corners.
pub(super) fn block(low: [f32; 3], high: [f32; 3]) -> Part {
    (0..8_usize).map(|c| Vec3::from_array(core::array::from_fn(|axis| [low, high][c >> axis & 1][axis]))).collect()
}

/// A rectangle as an outline.
pub(super) fn rectangle(half: Vec2) -> Vec<Vec2> {
    superellipse(4, 2.0, core::f32::consts::SQRT_2 * half)
}

/// A box about the origin whose edges and corners are rounded with a radius, in two steps.
pub(super) fn soft_box(half: Vec3, radius_m: f32) -> Part {
    let corner = |signs: Vec3| {
        let towards = (1..8).map(move |axes| Vec3::from_array([1, 2, 4].map(|axis| f32::from(axes & axis > 0))));
        towards.map(move |towards| signs * (half + radius_m * (towards.normalize() - Vec3::ONE)))
    };
    block([-1.0; 3], [1.0; 3]).into_iter().flat_map(corner).collect()
}

/// The same parts several times around z.
pub(super) fn around(count: usize, parts: &[Part]) -> Vec<Part> {
    let turned = |number: usize| {
        placed(parts.to_vec(), axis_angle(Vec3::Z, core::f32::consts::TAU * number as f32 / count as f32), Vec3::ZERO)
    };
    (0..count).flat_map(turned).collect()
}

/// The same parts turned about the origin, then shifted.
pub(super) fn placed(parts: Vec<Part>, turn: Quat, at_m: Vec3) -> Vec<Part> {
    parts.into_iter().map(|part| part.into_iter().map(|corner| turn * corner + at_m).collect()).collect()
}
