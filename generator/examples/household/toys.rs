//! Toys, furniture of dolls, and fruit.

use core::f32::consts::{FRAC_PI_2, PI};

use schema::{Quat, Vec3, axis_angle};

use super::blocks::{Part, arc, around, block, circle, placed, prism, rectangle, stack, sweep};
use super::kinds::{Draw, SIDES, v};

pub(super) fn egg(d: &mut Draw) -> Vec<Part> {
    let (radius, longer) = (d.mm(20.0, 30.0), d.ratio(1.25, 1.5));
    let half = |upper: f32, angles| arc(v(0.0, 0.0), radius * v(1.0, upper), angles, 4);
    let points = [half(1.0, [-75.0, 0.0]), half(longer, [20.0, 80.0])].concat();
    stack(&circle(SIDES), &points.iter().map(|p| p.to_array()).collect::<Vec<_>>())
}

pub(super) fn carrot(d: &mut Draw) -> Vec<Part> {
    let (thick, long, leaf) = (d.mm(13.0, 21.0), d.mm(100.0, 165.0), d.mm(15.0, 35.0));
    let root = [[0.2 * thick, 0.0], [0.85 * thick, 0.6 * long], [thick, 0.93 * long], [0.6 * thick, long]];
    stack(&circle(8), &[&root[..], &[[0.3 * thick, long], [0.3 * thick, long + leaf]]].concat())
}

pub(super) fn star(d: &mut Draw) -> Vec<Part> {
    let (points, reach, high) = (5 + d.0.index(2), d.mm(32.0, 58.0), d.mm(9.0, 24.0));
    let (sin, cos) = libm::sincosf(PI / points as f32);
    let notch = reach * d.ratio(0.45, 0.58) * v(cos, sin);
    let kite = [v(0.0, 0.0), v(notch.x, -notch.y), v(reach, -0.002), v(reach, 0.002), notch];
    around(points, &prism(&kite, [0.0, high]))
}

pub(super) fn chair(d: &mut Draw) -> Vec<Part> {
    let (half, deep, leg, thick) = (0.5 * d.mm(44.0, 68.0), 0.5 * d.mm(44.0, 64.0), d.mm(30.0, 55.0), d.mm(5.0, 8.0));
    let (post, back) = (d.mm(5.5, 8.0), d.mm(35.0, 65.0));
    let column = |x: f32, y: f32, low: f32, high: f32| {
        block([x - 0.5 * post, y - 0.5 * post, low], [x + 0.5 * post, y + 0.5 * post, high])
    };
    let (x, y) = (half - 0.5 * post, deep - 0.5 * post);
    let mut parts = vec![block([-half, -deep, 0.0], [half, deep, thick])];
    parts.extend([(x, y), (x, -y), (-x, y), (-x, -y)].map(|(x, y)| column(x, y, -leg, 0.0)));
    parts.extend([x, -x].map(|x| column(x, y, thick, thick + back)));
    let slat = half - post;
    parts.push(block([-slat, y - 0.4 * post, thick + 0.4 * back], [slat, y + 0.4 * post, thick + back]));
    parts
}

pub(super) fn pawn(d: &mut Draw) -> Vec<Part> {
    let (base, long, head) = (d.mm(16.0, 25.0), d.mm(30.0, 55.0), d.mm(10.0, 15.0));
    let neck = 0.011 + long;
    let foot = [[base, 0.0], [base, 0.005], [0.75 * base, 0.011], [0.5 * base, 0.011], [0.35 * base, neck]];
    let collar = [[0.6 * base, neck], [0.6 * base, neck + 0.005]];
    let ball = arc(v(0.0, neck + 0.003 + 0.9 * head), v(head, head), [-50.0, 75.0], 4);
    let mut levels = [&foot[..], &collar].concat();
    levels.push([ball[0].x, neck + 0.005]);
    levels.extend(ball[1..].iter().map(|p| p.to_array()));
    stack(&circle(SIDES), &levels)
}

pub(super) fn car(d: &mut Draw) -> Vec<Part> {
    let (half, broad, high) = (0.5 * d.mm(70.0, 120.0), 0.5 * d.mm(26.0, 44.0), d.mm(14.0, 22.0));
    let (cabin, wheel, tyre) = (d.mm(12.0, 20.0), d.mm(9.0, 14.0), d.mm(5.0, 9.0));
    let mut parts = vec![block([-half, -broad, 0.0], [half, broad, high])];
    let roof = stack(&rectangle(v(0.5 * half, 0.9 * broad)), &[[1.0, high], [0.75, high + cabin]]);
    parts.extend(placed(roof, Quat::IDENTITY, Vec3::X * -0.15 * half));
    let round = placed(
        prism(&circle(10).iter().map(|p| wheel * *p).collect::<Vec<_>>(), [0.0, tyre]),
        axis_angle(Vec3::X, -FRAC_PI_2),
        Vec3::Y * broad,
    );
    for (turn, x) in [(0.0, 0.6), (0.0, -0.6), (PI, 0.6), (PI, -0.6)] {
        let side = placed(round.clone(), axis_angle(Vec3::Z, turn), Vec3::new(x * half, 0.0, 0.2 * wheel));
        parts.extend(side);
    }
    parts
}

pub(super) fn pear(d: &mut Draw) -> Vec<Part> {
    let (belly, longer) = (d.mm(25.0, 36.0), d.ratio(0.9, 1.15));
    let z = |share: f32| belly * (1.0 + share * longer);
    let mut points = arc(v(0.0, belly), v(belly, belly), [-70.0, 40.0], 5);
    points.extend([v(0.58 * belly, z(0.95)), v(0.5 * belly, z(1.3)), v(0.28 * belly, z(1.6))]);
    points.extend([v(0.0025, z(1.6)), v(0.0025, z(1.6) + d.mm(10.0, 20.0))]);
    stack(&circle(SIDES), &points.iter().map(|p| p.to_array()).collect::<Vec<_>>())
}

pub(super) fn arch(d: &mut Draw) -> Vec<Part> {
    let (radius, thick, deep, leg) = (d.mm(24.0, 40.0), d.mm(5.5, 9.0), 0.5 * d.mm(20.0, 45.0), d.mm(10.0, 35.0));
    let mut path = arc(v(0.0, 0.0), v(radius, radius), [0.0, 180.0], 6);
    path.insert(0, v(radius, -leg));
    path.push(v(-radius, -leg));
    sweep(&path, &rectangle(v(thick, deep)), &[1.0; 9])
}

pub(super) fn brick(d: &mut Draw) -> Vec<Part> {
    let (unit, high, studs) = (d.mm(15.0, 22.0), d.ratio(0.6, 1.2), 2 + d.0.index(3));
    let mut parts = vec![block([0.0, 0.0, 0.0], [studs as f32 * unit, 2.0 * unit, high * unit])];
    let stud = stack(&circle(8), &[[0.3 * unit, 0.0], [0.3 * unit, 0.22 * unit]]);
    parts.extend((0..2 * studs).flat_map(|at| {
        let middle = Vec3::new((at / 2) as f32 + 0.5, (at % 2) as f32 + 0.5, high);
        placed(stud.clone(), Quat::IDENTITY, unit * middle)
    }));
    parts
}

pub(super) fn stool(d: &mut Draw) -> Vec<Part> {
    let (seat, high, thick) = (d.mm(24.0, 38.0), d.mm(40.0, 70.0), d.mm(7.0, 11.0));
    let (leg, splay, legs) = (d.mm(3.5, 5.0), d.ratio(0.75, 1.0), 3 + d.0.index(2));
    let mut parts = stack(&circle(SIDES), &[[seat, 0.0], [seat, thick]]);
    let path = [v(0.55 * seat, 0.001), v(splay * seat, -high)];
    parts.extend(around(legs, &sweep(&path, &circle(6), &[leg; 2])));
    parts
}
