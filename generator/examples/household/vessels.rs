//! Thin shells, what has a handle or a bow, and boxes.

use core::f32::consts::PI;

use schema::{Quat, Vec3, axis_angle};

use super::blocks::{
    Part, arc, block, circle, placed, prism, rectangle, shell, soft_box, stack, superellipse, sweep, vessel, walls,
};
use super::kinds::{Draw, SIDES, WALLS, inside, v};

/// Parts on their head: the floor of a vessel becomes the top of a dome.
fn turned_over(parts: Vec<Part>) -> Vec<Part> {
    placed(parts, axis_angle(Vec3::X, PI), Vec3::ZERO)
}

pub(super) fn tray(d: &mut Draw) -> Vec<Part> {
    let (long, high, wall) = (0.5 * d.mm(130.0, 210.0), d.mm(18.0, 35.0), d.mm(5.0, 7.0));
    let outline = superellipse(WALLS, 6.0, v(1.0, d.ratio(0.6, 0.8)));
    vessel(&outline, &[v(d.ratio(0.82, 0.92) * long, 0.0), v(long, high)], wall)
}

pub(super) fn lampshade(d: &mut Draw) -> Vec<Part> {
    let (rim, high, wall) = (d.mm(50.0, 80.0), d.mm(75.0, 125.0), d.mm(3.5, 4.5));
    shell(&circle(WALLS), &[v(rim, 0.0), v(rim * d.ratio(0.45, 0.8), high)], wall)
}

pub(super) fn teacup(d: &mut Draw) -> Vec<Part> {
    let (rim, flat, wall) = (d.mm(48.0, 65.0), d.mm(9.0, 14.0), d.mm(4.0, 5.0));
    let (foot, belly, high) = (d.mm(16.0, 22.0), d.mm(30.0, 38.0), d.mm(40.0, 58.0));
    let mut parts = vessel(&circle(WALLS), &[v(0.55 * rim, 0.0), v(rim, flat)], wall);
    let cup = vessel(&circle(WALLS), &[v(foot, 0.0), v(0.85 * belly, 0.4 * high), v(belly, high)], wall);
    parts.extend(placed(cup, Quat::IDENTITY, Vec3::Z * wall));
    parts
}

pub(super) fn kettle(d: &mut Draw) -> Vec<Part> {
    let (belly, high, thick) = (d.mm(34.0, 45.0), d.mm(50.0, 75.0), d.mm(4.0, 5.5));
    let (bow, spout) = (d.mm(45.0, 60.0), d.mm(18.0, 28.0));
    let top = high + 0.01;
    let body = [[0.8 * belly, 0.0], [belly, 0.3 * high], [0.72 * belly, high], [0.007, high], [0.007, top]];
    let mut parts = stack(&circle(SIDES), &body);
    let path = arc(v(0.0, 0.92 * high), v(0.68 * belly, bow), [0.0, 180.0], 7);
    parts.extend(sweep(&path, &circle(6), &[thick; 8]));
    let path = [v(0.88 * belly, 0.4 * high), v(belly + 0.5 * spout, 0.7 * high), v(belly + spout, 0.98 * high)];
    parts.extend(sweep(&path, &circle(6), &[0.009, 0.008, 0.007]));
    parts
}

pub(super) fn watering_can(d: &mut Draw) -> Vec<Part> {
    let (foot, high, wall) = (d.mm(32.0, 44.0), d.mm(50.0, 75.0), d.mm(4.0, 5.0));
    let (reach, rise, thick) = (d.mm(45.0, 70.0), d.mm(5.0, 30.0), d.mm(4.0, 5.5));
    let back = inside(foot) - 0.5 * wall;
    let mut parts = vessel(&circle(WALLS), &[v(foot, 0.0), v(foot, high)], wall);
    let [near, far] = [v(back, 0.3 * high), v(foot + reach, high + rise)];
    // The rose is the spout's last piece.
    let spout = [near, 0.5 * (near + far), far, far + 0.012 * (far - near).normalize()];
    parts.extend(sweep(&spout, &circle(8), &[0.009, 0.008, 0.007, 0.017]));
    let out = foot + d.mm(26.0, 36.0);
    let handle = [v(-back, 0.88 * high), v(-out, 1.05 * high), v(-back, 0.2 * high)];
    parts.extend(sweep(&handle, &rectangle(v(thick, 1.4 * thick)), &[1.0; 3]));
    parts
}

pub(super) fn suitcase(d: &mut Draw) -> Vec<Part> {
    let half = Vec3::new(0.5 * d.mm(90.0, 160.0), 0.5 * d.mm(32.0, 65.0), 0.5 * d.mm(65.0, 110.0));
    let (grip, gap, thick) = (d.mm(18.0, 28.0), d.mm(20.0, 28.0), d.mm(4.0, 5.5));
    let (low, top) = (half.z - 0.001, half.z + gap);
    let mut parts = vec![soft_box(half, d.mm(5.0, 12.0))];
    let path = [v(grip + 0.01, low), v(grip, top), v(-grip, top), v(-grip - 0.01, low)];
    parts.extend(sweep(&path, &rectangle(v(thick, 1.5 * thick)), &[1.0; 4]));
    parts
}

pub(super) fn plate(d: &mut Draw) -> Vec<Part> {
    let (rim, high, wall) = (d.mm(72.0, 110.0), d.mm(14.0, 24.0), d.mm(4.0, 5.5));
    let flat = rim * d.ratio(0.58, 0.68);
    vessel(&circle(WALLS), &[v(flat, 0.0), v(flat + 0.012, 0.65 * high), v(rim, high)], wall)
}

pub(super) fn cereal(d: &mut Draw) -> Vec<Part> {
    let (x, y, z) = (0.5 * d.mm(60.0, 150.0), 0.5 * d.mm(32.0, 70.0), d.mm(120.0, 240.0));
    vec![block([-x, -y, 0.0], [x, y, z])]
}

pub(super) fn packet(d: &mut Draw) -> Vec<Part> {
    let half = Vec3::new(0.5 * d.mm(60.0, 160.0), 0.5 * d.mm(36.0, 95.0), 0.5 * d.mm(24.0, 62.0));
    vec![soft_box(half, d.ratio(0.3, 0.9) * half.min_element())]
}

pub(super) fn can(d: &mut Draw) -> Vec<Part> {
    let (radius, high) = (d.mm(25.0, 38.0), d.mm(65.0, 135.0));
    let (neck, lid) = (radius * d.ratio(0.82, 0.97), d.mm(3.0, 9.0));
    stack(&circle(SIDES), &[[neck, 0.0], [radius, lid], [radius, high - lid], [neck, high]])
}

pub(super) fn lid(d: &mut Draw) -> Vec<Part> {
    let (rim, high, wall) = (d.mm(42.0, 75.0), d.mm(12.0, 24.0), d.mm(3.5, 5.0));
    let (neck, knob, stem) = (d.mm(5.0, 8.0), d.mm(11.0, 16.0), d.mm(6.0, 12.0));
    let dome = [v(0.45 * rim, 0.0), v(0.9 * rim, 0.6 * high), v(0.97 * rim, high)];
    let mut parts = turned_over(vessel(&circle(WALLS), &dome, wall));
    let levels = [[neck, 0.0], [neck, stem], [knob, stem], [knob, stem + 0.006], [0.7 * knob, stem + 0.012]];
    parts.extend(stack(&circle(8), &levels));
    parts
}

pub(super) fn bell(d: &mut Draw) -> Vec<Part> {
    let (rim, high, wall) = (d.mm(28.0, 40.0), d.mm(42.0, 65.0), d.mm(3.5, 5.0));
    let (grip, long) = (d.mm(6.0, 8.5), d.mm(35.0, 55.0));
    let flare = [v(0.4 * rim, 0.0), v(0.6 * rim, 0.12 * high), v(0.72 * rim, 0.7 * high), v(rim, high)];
    let mut parts = turned_over(vessel(&circle(WALLS), &flare, wall));
    parts.extend(stack(&circle(8), &[[0.6 * grip, 0.0], [grip, 0.6 * long], [0.8 * grip, long]]));
    parts
}

pub(super) fn jug(d: &mut Draw) -> Vec<Part> {
    let (belly, high, wall) = (d.mm(36.0, 46.0), d.mm(105.0, 150.0), d.mm(4.0, 5.5));
    let (neck, reach, thick) = (belly * d.ratio(0.55, 0.7), d.mm(20.0, 28.0), d.mm(4.0, 5.5));
    let profile = [v(0.75 * belly, 0.0), v(belly, 0.35 * high), v(neck, 0.75 * high), v(1.3 * neck, high)];
    let mut parts = vessel(&circle(WALLS), &profile, wall);
    let low = inside(0.75 * belly + 0.25 * neck) - 0.5 * wall;
    let out = belly + reach;
    let path = [
        v(low, 0.45 * high),
        v(out - 0.008, 0.52 * high),
        v(out, 0.72 * high),
        v(out - 0.01, 0.87 * high),
        v(inside(1.14 * neck) - 0.5 * wall, 0.88 * high),
    ];
    parts.extend(sweep(&path, &superellipse(6, 2.0, v(thick, 1.5 * thick)), &[1.0; 5]));
    parts
}

pub(super) fn milk_carton(d: &mut Draw) -> Vec<Part> {
    let (half, high, rise) = (0.5 * d.mm(48.0, 76.0), d.mm(85.0, 165.0), d.mm(20.0, 34.0));
    let (seam, crest) = (d.mm(1.8, 2.5), d.mm(8.0, 15.0));
    let top = high + rise;
    let gable = [rectangle(v(half, half)), rectangle(v(half, seam))];
    let roof = gable.iter().zip([high, top]).flat_map(|(ring, z)| ring.iter().map(move |p| p.extend(z))).collect();
    vec![block([-half, -half, 0.0], [half, half, high]), roof, block([-half, -seam, top], [half, seam, top + crest])]
}

pub(super) fn tissue_box(d: &mut Draw) -> Vec<Part> {
    let (long, high, wall) = (0.5 * d.mm(100.0, 140.0), d.mm(40.0, 75.0), d.mm(10.0, 16.0));
    let outline = superellipse(WALLS, d.ratio(4.0, 7.0), long * v(1.0, d.ratio(0.55, 0.8)));
    let slot = d.ratio(0.5, 0.65);
    let mut parts = prism(&outline, [0.0, high - wall]);
    parts.extend(walls(&outline, &[v(slot, high - wall), v(1.0, high - wall), v(1.0, high), v(slot, high)]));
    parts
}
