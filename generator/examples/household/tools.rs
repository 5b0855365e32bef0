//! Long tools, flat things, weights and machine parts.

use core::f32::consts::FRAC_PI_2;

use schema::{Vec3, axis_angle};

use super::blocks::{Part, arc, around, block, circle, placed, prism, rectangle, stack, superellipse, sweep, walls};
use super::kinds::{Draw, SIDES, v};

pub(super) fn iron(d: &mut Draw) -> Vec<Part> {
    let (long, half, high) = (d.mm(50.0, 70.0), d.mm(26.0, 36.0), d.mm(24.0, 38.0));
    let (gap, thick) = (d.mm(24.0, 34.0), d.mm(7.0, 10.0));
    let sole = [v(-0.8 * long, -half), v(0.1 * long, -half), v(long, 0.0), v(0.1 * long, half), v(-0.8 * long, half)];
    let mut parts = stack(&sole, &[[1.0, 0.0], [1.0, 0.3 * high], [0.7, high]]);
    let (low, top) = (high - 0.001, high + gap);
    let path = [v(0.35 * long, low), v(0.35 * long, 0.9 * top), v(-0.45 * long, top), v(-0.45 * long, low)];
    parts.extend(sweep(&path, &superellipse(8, 2.0, v(0.8 * thick, thick)), &[1.0; 4]));
    parts
}

pub(super) fn spatula(d: &mut Draw) -> Vec<Part> {
    let (blade, half, thick) = (d.mm(55.0, 80.0), 0.5 * d.mm(40.0, 70.0), d.mm(3.5, 5.0));
    let (long, rise, grip) = (d.mm(100.0, 150.0), d.mm(15.0, 35.0), d.mm(4.0, 5.5));
    let outline = [v(-blade, -half), v(0.0, -0.6 * half), v(0.0, 0.6 * half), v(-blade, half)];
    let mut parts = prism(&outline, [0.0, thick]);
    let path = [v(-0.001, 0.5 * thick), v(0.2 * long, 0.8 * rise), v(long, rise)];
    parts.extend(sweep(&path, &superellipse(6, 2.0, v(grip, 1.8 * grip)), &[0.7, 0.8, 1.0]));
    parts
}

pub(super) fn whisk(d: &mut Draw) -> Vec<Part> {
    let (long, bulge, reach, wire) = (d.mm(80.0, 110.0), d.mm(22.0, 30.0), d.mm(70.0, 100.0), d.mm(2.0, 2.6));
    let grip = 0.36 * bulge + 1.4 * wire;
    let loops = arc(v(0.0, long + 0.42 * reach), v(bulge, 0.5 * reach), [-70.0, 90.0], 5);
    let mut parts = stack(&circle(8), &[[0.8 * grip, 0.0], [grip, 0.3 * long], [grip, long]]);
    parts.extend(around(6, &sweep(&loops, &circle(6), &[wire; 6])));
    parts
}

pub(super) fn rolling_pin(d: &mut Draw) -> Vec<Part> {
    let (roll, long) = (d.mm(17.0, 27.0), d.mm(110.0, 160.0));
    let (grip, end) = (roll * d.ratio(0.4, 0.55), d.mm(28.0, 42.0));
    let levels = [[0.8 * grip, -end], [grip, -0.5 * end], [0.7 * grip, 0.0]];
    let mirrored = levels.iter().rev().map(|[scale, z]| [*scale, long - z]);
    let roller = [[roll, 0.0], [roll, long]];
    stack(&circle(SIDES), &levels.into_iter().chain(roller).chain(mirrored).collect::<Vec<_>>())
}

pub(super) fn pliers(d: &mut Draw) -> Vec<Part> {
    let (long, jaw, half, thick) = (d.mm(80.0, 110.0), d.mm(32.0, 50.0), d.mm(6.0, 8.5), d.mm(6.0, 8.0));
    let open = d.ratio(0.1, 0.22);
    let lever = |turn: f32, low: f32| {
        let tip = [v(0.0, -half), v(jaw, -0.5 * half), v(jaw, 0.5 * half), v(0.0, half)];
        let mut parts = prism(&tip, [low, low + thick]);
        parts.push(block([-long, -half, low], [0.0, half, low + thick]));
        placed(parts, axis_angle(Vec3::Z, turn), Vec3::ZERO)
    };
    [lever(open, 0.0), lever(-open, thick)].concat()
}

pub(super) fn book(d: &mut Draw) -> Vec<Part> {
    let (x, y, z) = (0.5 * d.mm(100.0, 185.0), 0.5 * d.mm(65.0, 125.0), d.mm(10.0, 34.0));
    let (cover, over) = (d.mm(3.0, 3.6), 0.5 * d.mm(2.0, 4.0));
    let (far, top) = (x + over, z + cover);
    vec![
        block([-x, -y, 0.0], [x, y, z]),
        block([-far, -y, -cover], [far, y + over, 0.0]),
        block([-far, -y, z], [far, y + over, top]),
        block([-far, -y - cover, -cover], [far, -y, top]),
    ]
}

pub(super) fn phone(d: &mut Draw) -> Vec<Part> {
    let (x, y, thick) = (0.5 * d.mm(120.0, 165.0), 0.5 * d.mm(55.0, 77.0), d.mm(8.0, 13.0));
    let mut parts = prism(&superellipse(SIDES, 8.0, v(x, y)), [0.0, thick]);
    parts.push(block([0.5 * x, 0.1 * y, thick], [0.85 * x, 0.8 * y, thick + 0.003]));
    parts
}

pub(super) fn ruler(d: &mut Draw) -> Vec<Part> {
    let (long, half, thick) = (0.5 * d.mm(140.0, 240.0), 0.5 * d.mm(22.0, 40.0), d.mm(3.5, 6.0));
    // One long edge is thinner, as where the marks are.
    let section = [v(-half, 0.0), v(half, 0.0), v(half, 0.5 * thick), v(0.3 * half, thick), v(-half, thick)];
    vec![section.iter().flat_map(|p| [-long, long].map(|x| Vec3::new(x, p.x, p.y))).collect()]
}

pub(super) fn dumbbell(d: &mut Draw) -> Vec<Part> {
    let (head, wide) = (d.mm(18.0, 30.0), d.mm(22.0, 40.0));
    let (grip, long) = (d.mm(8.0, 12.0), d.mm(65.0, 100.0));
    let weight = |low: f32| {
        stack(
            &circle(6),
            &[[0.8 * head, low], [head, low + 0.006], [head, low + wide - 0.006], [0.8 * head, low + wide]],
        )
    };
    [weight(-wide), prism(&circle(SIDES).iter().map(|p| grip * *p).collect::<Vec<_>>(), [0.0, long]), weight(long)]
        .concat()
}

pub(super) fn gear(d: &mut Draw) -> Vec<Part> {
    let (teeth, root, high) = (8 + d.0.index(6), d.mm(18.0, 34.0), d.mm(10.0, 22.0));
    let (tooth, hub, stem) = (d.mm(5.0, 8.0), d.mm(8.0, 12.0), d.mm(4.0, 14.0));
    let (outline, half) = (circle(teeth), root / teeth as f32);
    let flat = root * outline[0].x;
    let mut parts = stack(&outline, &[[root, 0.0], [root, high]]);
    parts.extend(stack(&circle(SIDES), &[[hub, high], [hub, high + stem]]));
    let flank = [v(flat, -1.6 * half), v(flat + tooth, -half), v(flat + tooth, half), v(flat, 1.6 * half)];
    parts.extend(around(teeth, &prism(&flank, [0.0, high])));
    parts
}

pub(super) fn tee(d: &mut Draw) -> Vec<Part> {
    let (tube, long, branch) = (d.mm(10.0, 17.0), d.mm(32.0, 50.0), d.mm(28.0, 50.0));
    let (flange, thick) = (tube * d.ratio(1.2, 1.5), d.mm(6.0, 10.0));
    let ends = [
        [flange, -long],
        [flange, thick - long],
        [tube, thick - long],
        [tube, long - thick],
        [flange, long - thick],
        [flange, long],
    ];
    let mut parts = placed(stack(&circle(10), &ends), axis_angle(Vec3::Y, FRAC_PI_2), Vec3::ZERO);
    let (low, top) = (0.85 * tube, tube + branch);
    let levels = [[0.8 * tube, low], [0.8 * tube, top - thick], [flange, top - thick], [flange, top]];
    parts.extend(stack(&circle(10), &levels));
    parts
}

pub(super) fn wedge(d: &mut Draw) -> Vec<Part> {
    let (long, high, half, blunt) = (d.mm(60.0, 130.0), d.mm(22.0, 45.0), 0.5 * d.mm(28.0, 55.0), d.mm(3.5, 8.0));
    let section = [v(0.0, 0.0), v(long, 0.0), v(long, blunt), v(0.0, high)];
    vec![section.iter().flat_map(|p| [-half, half].map(|y| Vec3::new(p.x, y, p.y))).collect()]
}

pub(super) fn kettlebell(d: &mut Draw) -> Vec<Part> {
    let (ball, grip, wide) = (d.mm(26.0, 36.0), d.mm(6.0, 9.0), d.ratio(0.7, 0.9));
    let levels: Vec<[f32; 2]> =
        arc(v(0.0, 0.85 * ball), v(ball, ball), [-58.0, 70.0], 5).iter().map(|p| p.to_array()).collect();
    let (low, high) = (1.55 * ball, d.mm(26.0, 36.0));
    let mut parts = stack(&circle(SIDES), &levels);
    let top = low + high;
    let path = [
        v(0.5 * ball, low),
        v(wide * ball, low + 0.45 * high),
        v(0.7 * wide * ball, top),
        v(-0.7 * wide * ball, top),
        v(-wide * ball, low + 0.45 * high),
        v(-0.5 * ball, low),
    ];
    parts.extend(sweep(&path, &circle(8), &[grip; 6]));
    parts
}

pub(super) fn tongs(d: &mut Draw) -> Vec<Part> {
    let (long, apart) = (d.mm(120.0, 180.0), d.mm(11.0, 22.0));
    let strip = rectangle(v(d.mm(2.2, 3.0), d.mm(7.0, 11.0)));
    let side = [v(long, 0.7 * apart), v(0.45 * long, 1.2 * apart), v(0.06 * long, 0.8 * apart), v(0.0, 0.35 * apart)];
    let path: Vec<_> = side.iter().copied().chain(side.iter().rev().map(|p| v(p.x, -p.y))).collect();
    sweep(&path, &strip, &[1.0; 8])
}

pub(super) fn key(d: &mut Draw) -> Vec<Part> {
    let (bow, long, half, thick) = (d.mm(16.0, 24.0), d.mm(50.0, 80.0), d.mm(4.0, 6.0), d.mm(7.0, 11.0));
    let section = [v(bow, 0.0), v(bow, thick), v(0.55 * bow, thick), v(0.55 * bow, 0.0)];
    let mut parts = walls(&circle(10), &section);
    let (near, far) = (bow * circle(10)[0].x, bow + long);
    parts.push(block([near, -half, 0.0], [far, half, thick]));
    for (at, deep) in [(0.024, d.mm(8.0, 14.0)), (0.012, d.mm(8.0, 14.0))] {
        parts.push(block([far - at, half, 0.0], [far - at + 0.007, half + deep, thick]));
    }
    parts
}

pub(super) fn comb(d: &mut Draw) -> Vec<Part> {
    let (teeth, pitch, thick) = (9 + d.0.index(6), d.mm(8.0, 11.0), d.mm(4.0, 6.5));
    let (back, deep) = (d.mm(9.0, 14.0), d.mm(18.0, 30.0));
    let mut parts = vec![block([0.0, 0.0, 0.0], [(teeth as f32 - 0.5) * pitch, back, thick])];
    parts.extend((0..teeth).map(|tooth| {
        let x = tooth as f32 * pitch;
        block([x, -deep, 0.0], [x + 0.5 * pitch, 0.0, thick])
    }));
    parts
}

pub(super) fn horseshoe(d: &mut Draw) -> Vec<Part> {
    let (half, thick) = (v(d.mm(34.0, 46.0), d.mm(40.0, 55.0)), d.mm(6.0, 9.0));
    let path = arc(v(0.0, 0.0), half, [-58.0, 238.0], 9);
    sweep(&path, &rectangle(v(d.mm(7.0, 10.0), thick)), &[1.0; 10])
}
