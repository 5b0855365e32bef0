//! The first kinds: how big each is, and of which parts it is made. Lengths are drawn in millimetres; z is up.

use core::f32::consts::FRAC_PI_2;

use glamx::Vec2;
use schema::{Quat, Stream, Vec3, axis_angle};

use super::blocks::{Part, arc, around, block, circle, placed, shell, stack, superellipse, sweep, vessel, walls};

/// Sides of a round wall: each is a part.
pub(super) const WALLS: usize = 12;
/// Sides of a round solid.
pub(super) const SIDES: usize = 16;

/// A draw of dimensions.
pub(super) struct Draw(pub(super) Stream);

impl Draw {
    /// A length in metres, uniform between these millimetres.
    pub(super) fn mm(&mut self, low: f32, high: f32) -> f32 {
        self.0.uniform(0.001 * low, 0.001 * high)
    }

    /// A ratio or an angle, uniform.
    pub(super) fn ratio(&mut self, low: f32, high: f32) -> f32 {
        self.0.uniform(low, high)
    }
}

pub(super) fn v(x: f32, y: f32) -> Vec2 {
    Vec2::new(x, y)
}

/// The distance of the sides of a round wall of this radius from the axis.
pub(super) fn inside(radius_m: f32) -> f32 {
    radius_m * circle(WALLS)[0].x
}

pub(super) fn cup(d: &mut Draw) -> Vec<Part> {
    let (foot, high, wall) = (d.mm(20.0, 32.0), d.mm(60.0, 110.0), d.mm(3.5, 5.5));
    vessel(&circle(WALLS), &[v(foot, 0.0), v(foot * d.ratio(1.05, 1.4), high)], wall)
}

pub(super) fn bowl(d: &mut Draw) -> Vec<Part> {
    let (foot, rim, high, wall) = (d.mm(15.0, 28.0), d.mm(38.0, 65.0), d.mm(30.0, 55.0), d.mm(3.5, 6.0));
    let belly = foot + d.ratio(0.6, 0.75) * (rim - foot);
    vessel(&circle(WALLS), &[v(foot, 0.0), v(belly, 0.4 * high), v(rim, high)], wall)
}

pub(super) fn bottle(d: &mut Draw) -> Vec<Part> {
    let outline = superellipse(SIDES, d.ratio(2.0, 5.0), v(1.0, d.ratio(0.6, 1.0)));
    let (belly, body, shoulder) = (d.mm(20.0, 34.0), d.mm(60.0, 110.0), d.mm(12.0, 30.0));
    let (neck, below_cap, cap) = (belly * d.ratio(0.35, 0.5), d.mm(8.0, 20.0), d.mm(10.0, 18.0));
    let top = body + shoulder + below_cap;
    let glass = [[0.9 * belly, 0.0], [belly, 0.005], [belly, body], [neck, body + shoulder], [neck, top]];
    stack(&outline, &[&glass[..], &[[1.2 * neck, top], [1.2 * neck, top + cap]]].concat())
}

pub(super) fn jar(d: &mut Draw) -> Vec<Part> {
    let (belly, high, lid) = (d.mm(24.0, 40.0), d.mm(45.0, 95.0), d.mm(10.0, 16.0));
    let glass = [[0.88 * belly, 0.0], [belly, 0.006], [belly, high - 0.008], [0.82 * belly, high]];
    stack(&circle(SIDES), &[&glass[..], &[[0.92 * belly, high], [0.92 * belly, high + lid]]].concat())
}

pub(super) fn saucer(d: &mut Draw) -> Vec<Part> {
    let (rim, high, wall) = (d.mm(45.0, 70.0), d.mm(12.0, 22.0), d.mm(4.0, 6.0));
    vessel(&circle(WALLS), &[v(rim * d.ratio(0.5, 0.65), 0.0), v(rim, high)], wall)
}

pub(super) fn pan(d: &mut Draw) -> Vec<Part> {
    let (rim, high, wall) = (d.mm(32.0, 48.0), d.mm(25.0, 45.0), d.mm(3.5, 5.0));
    let (long, half, thick) = (d.mm(65.0, 95.0), d.mm(7.0, 11.0), d.mm(6.0, 9.0));
    let mut parts = vessel(&circle(WALLS), &[v(0.9 * rim, 0.0), v(rim, high)], wall);
    parts.push(block([inside(rim) - 0.5 * wall, -half, high - thick], [rim + long, half, high]));
    parts
}

pub(super) fn ladle(d: &mut Draw) -> Vec<Part> {
    let (rim, high, wall) = (d.mm(20.0, 32.0), d.mm(14.0, 24.0), d.mm(3.5, 5.0));
    let (long, rise, thick) = (d.mm(90.0, 120.0), d.mm(10.0, 40.0), d.mm(4.0, 6.0));
    let mut parts = vessel(&circle(WALLS), &[v(0.6 * rim, 0.0), v(rim, high)], wall);
    let path =
        [v(inside(rim) - wall, high - thick), v(rim + 0.25 * long, high + 0.35 * rise), v(rim + long, high + rise)];
    parts.extend(sweep(&path, &circle(6), &[thick; 3]));
    parts
}

pub(super) fn elbow(d: &mut Draw) -> Vec<Part> {
    let (tube, legs, angle_deg) = (d.mm(9.0, 20.0), [d.mm(20.0, 55.0), d.mm(20.0, 55.0)], d.ratio(50.0, 110.0));
    let bend = tube * d.ratio(1.5, 2.5);
    let mut path = arc(v(0.0, bend), Vec2::splat(bend), [-90.0, angle_deg - 90.0], 4);
    let (sin, cos) = libm::sincosf(angle_deg.to_radians());
    path.insert(0, v(-legs[0], 0.0));
    path.push(path[5] + legs[1] * v(cos, sin));
    sweep(&path, &circle(10), &[tube; 7])
}

pub(super) fn carton(d: &mut Draw) -> Vec<Part> {
    let (x, y, z) = (0.5 * d.mm(50.0, 120.0), 0.5 * d.mm(30.0, 68.0), d.mm(20.0, 60.0));
    let (over, lid) = (d.mm(1.5, 3.0), d.mm(8.0, 16.0));
    vec![block([-x, -y, 0.0], [x, y, z]), block([-x - over, -y - over, z], [x + over, y + over, z + lid])]
}

pub(super) fn open_box(d: &mut Draw) -> Vec<Part> {
    let (x, y, z) = (0.5 * d.mm(60.0, 130.0), 0.5 * d.mm(45.0, 100.0), d.mm(25.0, 60.0));
    let wall = d.mm(4.0, 7.0);
    let (in_x, in_y) = (x - wall, y - wall);
    vec![
        block([-x, -y, 0.0], [x, y, wall]),
        block([-x, -y, wall], [-in_x, y, z]),
        block([in_x, -y, wall], [x, y, z]),
        block([-in_x, -y, wall], [in_x, -in_y, z]),
        block([-in_x, in_y, wall], [in_x, y, z]),
    ]
}

pub(super) fn pebble(d: &mut Draw) -> Vec<Part> {
    let outline = superellipse(12, d.ratio(1.8, 4.0), v(d.mm(18.0, 36.0), d.mm(18.0, 36.0)));
    let profile = superellipse(12, d.ratio(1.8, 4.0), v(1.0, d.mm(14.0, 34.0)));
    let mut levels: Vec<[f32; 2]> = profile.iter().filter(|p| p.x > 0.0).map(|p| p.to_array()).collect();
    levels.sort_by(|a, b| a[1].total_cmp(&b[1]));
    stack(&outline, &levels)
}

pub(super) fn screwdriver(d: &mut Draw) -> Vec<Part> {
    let (grip, long) = (d.mm(10.0, 16.0), d.mm(70.0, 100.0));
    let (blade, reach) = (d.mm(3.0, 5.0), d.mm(55.0, 90.0));
    let handle = [[0.75 * grip, 0.0], [grip, 0.2 * long], [0.9 * grip, 0.75 * long], [0.6 * grip, long]];
    stack(&circle(8), &[&handle[..], &[[blade, long], [blade, long + reach]]].concat())
}

pub(super) fn brush(d: &mut Draw) -> Vec<Part> {
    let (x, y, thick) = (0.5 * d.mm(110.0, 170.0), 0.5 * d.mm(26.0, 44.0), d.mm(10.0, 16.0));
    let bristles = d.mm(16.0, 32.0);
    let mut parts = stack(&superellipse(SIDES, 4.0, v(x, y)), &[[1.0, 0.0], [1.0, thick]]);
    parts.push(block([0.1 * x, -0.76 * y, -bristles], [0.88 * x, 0.76 * y, 0.0]));
    parts
}

pub(super) fn banana(d: &mut Draw) -> Vec<Part> {
    let (thick, bend, half_deg) = (d.mm(13.0, 19.0), d.mm(60.0, 95.0), 0.5 * d.ratio(75.0, 115.0));
    let path = arc(Vec2::ZERO, Vec2::splat(bend), [90.0 - half_deg, 90.0 + half_deg], 6);
    sweep(&path, &circle(6), &[0.35, 0.8, 1.0, 1.0, 1.0, 0.8, 0.35].map(|share| share * thick))
}

pub(super) fn funnel(d: &mut Draw) -> Vec<Part> {
    let (spout, rim, wall) = (d.mm(9.0, 13.0), d.mm(32.0, 50.0), d.mm(3.5, 4.5));
    let (low, cone) = (d.mm(25.0, 45.0), d.mm(35.0, 60.0));
    shell(&circle(10), &[v(spout, 0.0), v(spout, low), v(rim, low + cone)], wall)
}

pub(super) fn spool(d: &mut Draw) -> Vec<Part> {
    let (rim, flange, long) = (d.mm(18.0, 34.0), d.mm(5.0, 10.0), d.mm(25.0, 65.0));
    let core = rim * d.ratio(0.4, 0.7);
    let top = flange + long;
    let levels = [[rim, 0.0], [rim, flange], [core, flange], [core, top], [rim, top], [rim, top + flange]];
    stack(&circle(SIDES), &levels)
}

pub(super) fn goblet(d: &mut Draw) -> Vec<Part> {
    let (foot, thick, stem, long) = (d.mm(22.0, 32.0), d.mm(4.0, 7.0), d.mm(4.5, 7.0), d.mm(20.0, 45.0));
    let (rim, high, wall) = (d.mm(26.0, 38.0), d.mm(40.0, 65.0), d.mm(3.5, 5.0));
    let (outline, low) = (circle(10), thick + long);
    let mut parts = stack(&outline, &[[foot, 0.0], [0.85 * foot, thick], [stem, thick], [stem, low]]);
    parts.extend(vessel(&outline, &[v(0.4 * rim, low), v(rim, low + 0.5 * high), v(0.95 * rim, low + high)], wall));
    parts
}

pub(super) fn board(d: &mut Draw) -> Vec<Part> {
    let (x, y, thick) = (0.5 * d.mm(80.0, 130.0), 0.5 * d.mm(50.0, 100.0), d.mm(8.0, 22.0));
    let (tab, half) = (d.mm(20.0, 40.0), d.mm(8.0, 16.0));
    let mut parts = stack(&superellipse(SIDES, d.ratio(4.0, 8.0), v(x, y)), &[[1.0, 0.0], [1.0, thick]]);
    parts.push(block([0.97 * x, -half, 0.0], [x + tab, half, thick]));
    parts
}

pub(super) fn mug(d: &mut Draw) -> Vec<Part> {
    let (radius, high, wall) = (d.mm(30.0, 42.0), d.mm(70.0, 100.0), d.mm(4.0, 6.0));
    let (reach, thick, broad) = (d.mm(24.0, 34.0), d.mm(3.5, 5.0), d.mm(5.0, 8.0));
    let mut parts = vessel(&circle(WALLS), &[v(radius, 0.0), v(radius, high)], wall);
    let path = arc(v(inside(radius) - 0.5 * wall, 0.5 * high), v(reach, 0.33 * high), [-90.0, 90.0], 6);
    parts.extend(sweep(&path, &superellipse(6, 2.0, v(thick, broad)), &[1.0; 7]));
    parts
}

pub(super) fn bulb(d: &mut Draw) -> Vec<Part> {
    let (globe, thread, long) = (d.mm(24.0, 34.0), d.mm(11.0, 14.0), d.mm(18.0, 26.0));
    let middle = long + globe * d.ratio(1.5, 1.7);
    let ball = arc(v(0.0, middle), Vec2::splat(globe), [-45.0, 75.0], 4);
    let screw = [[0.6 * thread, 0.0], [thread, 0.004], [thread, long]];
    let levels: Vec<[f32; 2]> = screw.into_iter().chain(ball.iter().map(|p| p.to_array())).collect();
    stack(&circle(SIDES), &levels)
}

pub(super) fn ring(d: &mut Draw) -> Vec<Part> {
    let (radius, thick) = (d.mm(24.0, 48.0), d.mm(5.0, 11.0));
    let (across, along) = (v(radius, 0.0), v(thick, thick * d.ratio(0.6, 1.8)));
    walls(&circle(14), &circle(8).iter().map(|point| across + along * *point).collect::<Vec<_>>())
}

pub(super) fn bracket(d: &mut Draw) -> Vec<Part> {
    let (long, leg, thick) = (d.mm(40.0, 80.0), d.mm(35.0, 75.0), d.mm(6.0, 11.0));
    let broad = d.mm(24.0, 45.0);
    let upright = |x: f32| block([x, 0.0, thick], [x + thick, broad, leg]);
    let mut parts = vec![block([0.0, 0.0, 0.0], [long, broad, thick])];
    match d.0.index(3) {
        0 => parts.push(upright(0.0)),
        1 => parts.push(upright(0.5 * (long - thick))),
        _ => parts.extend([upright(0.0), upright(long - thick)]),
    }
    parts
}

pub(super) fn boot(d: &mut Draw) -> Vec<Part> {
    let (shaft, long, toe, ankle) = (d.mm(18.0, 25.0), d.mm(85.0, 125.0), d.mm(14.0, 20.0), d.mm(32.0, 45.0));
    let (high, wall, broad) = (d.mm(35.0, 60.0), d.mm(4.0, 6.0), shaft * d.ratio(0.95, 1.1));
    // A circle whose front half is shifted has the circle's directions, so what connects the two has flat faces.
    let sole = |radius: f32, reach: f32, z: f32| -> Part {
        let shifted =
            |point: &Vec2| (radius * *point + if point.x > 0.0 { v(reach, 0.0) } else { Vec2::ZERO }).extend(z);
        circle(WALLS).iter().map(shifted).collect()
    };
    let reach = long - 2.0 * broad;
    let mut parts = shell(&circle(WALLS), &[v(shaft, ankle), v(shaft, ankle + high)], wall);
    parts.push([sole(broad, reach, 0.0), sole(broad, reach, toe)].concat());
    parts.push([sole(0.95 * broad, 0.95 * reach, toe), sole(shaft, 0.0, ankle)].concat());
    parts
}

pub(super) fn hammer(d: &mut Draw) -> Vec<Part> {
    let (grip, long, head, half) = (d.mm(10.0, 14.0), d.mm(105.0, 145.0), d.mm(11.0, 16.0), d.mm(30.0, 48.0));
    let mut parts = stack(&superellipse(8, 2.5, v(1.0, 0.75)), &[[grip, 0.0], [0.75 * grip, long]]);
    let levels = [[0.55 * head, -half], [head, 0.0], [head, 0.9 * half]];
    let across = axis_angle(Vec3::Y, FRAC_PI_2);
    parts.extend(placed(stack(&circle(8), &levels), across, Vec3::Z * (long + head * circle(8)[0].x)));
    parts
}

pub(super) fn knob(d: &mut Draw) -> Vec<Part> {
    let (hub, reach, high) = (d.mm(13.0, 18.0), d.mm(28.0, 38.0), d.mm(14.0, 22.0));
    let (stem, half, arms) = (d.mm(15.0, 35.0), d.mm(6.0, 8.5), 3 + d.0.index(3));
    let core = 0.6 * hub;
    let mut parts = stack(&circle(WALLS), &[[core, -stem], [core, 0.0], [hub, 0.0], [hub, high]]);
    parts.extend(around(arms, &[block([0.93 * hub, -half, 0.0], [reach, half, 0.8 * high])]));
    parts
}

pub(super) fn basket(d: &mut Draw) -> Vec<Part> {
    let (rim, high, wall) = (d.mm(40.0, 55.0), d.mm(30.0, 50.0), d.mm(5.0, 7.0));
    let (bow, thick) = (d.mm(35.0, 55.0), d.mm(3.5, 5.0));
    let outline = superellipse(WALLS, 3.0, v(1.0, d.ratio(0.65, 0.9)));
    let end = rim * outline[0].x - 0.5 * wall;
    let mut parts = vessel(&outline, &[v(0.85 * rim, 0.0), v(rim, high)], wall);
    let path = arc(v(0.0, high - 0.002), v(end, bow), [0.0, 180.0], 8);
    parts.extend(sweep(&path, &circle(6), &[thick; 9]));
    parts
}

pub(super) fn wrench(d: &mut Draw) -> Vec<Part> {
    let (long, half, thick) = (0.5 * d.mm(80.0, 115.0), d.mm(7.0, 9.5), d.mm(7.0, 10.0));
    let (eye, jaw) = (d.mm(12.0, 16.0), d.mm(12.0, 18.0));
    let neck = [v(long, -half), v(long, half), v(long + 0.012, 1.9 * half), v(long + 0.012, -1.9 * half)];
    let mut parts = vec![block([-long, -half, 0.0], [long, half, thick])];
    parts.push(neck.iter().flat_map(|point| [point.extend(0.0), point.extend(thick)]).collect());
    for [low, high] in [[-1.9, -0.8], [0.8, 1.9]] {
        parts.push(block([long + 0.012, low * half, 0.0], [long + 0.012 + jaw, high * half, thick]));
    }
    let section = [v(eye, 0.0), v(eye, thick), v(0.55 * eye, thick), v(0.55 * eye, 0.0)];
    parts.extend(placed(walls(&circle(10), &section), Quat::IDENTITY, Vec3::X * -(long + 0.85 * eye)));
    parts
}
