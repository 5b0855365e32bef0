//! Household objects against formulas, and the shipped files.

use core::f32::consts::PI;

use glamx::Vec2;
use schema::Vec3;
use simulator::convex_hull;

use super::blocks::{arc, circle, shell, soft_box, stack, superellipse, sweep, vessel, walls};
use super::*;

#[test]
fn the_shipped_files_have_these_objects() {
    for (split, name) in [(Split::Train, "household-train"), (Split::HeldOut, "household-held-out")] {
        assert!(generator::catalogue::built_in(name).unwrap() == household(split, 920, 1), "{name}");
    }
}

#[test]
fn an_object_depends_on_seed_kind_and_number_alone() {
    let text = |count, seed| household(Split::HeldOut, count, seed);
    let second = text(80, 1);
    let second = second.split("[[object]]").find(|object| object.contains("name = \"mug_001\"")).unwrap();
    assert!(text(46, 1).contains(second) && !text(80, 2).contains(second), "{second}");
}

#[test]
fn a_third_of_the_kinds_is_held_out() {
    let held_out = Kind::ALL.into_iter().filter(|kind| kind.is_held_out()).count();
    assert_eq!((Kind::ALL.len(), held_out), (69, 23));
}

fn volume_m3(parts: &[Part]) -> f32 {
    parts.iter().map(|part| convex_hull(part).unwrap().volume_m3()).sum()
}

/// Of a truncated cone.
fn cone_m3([low, high]: [f32; 2], height: f32) -> f32 {
    PI / 3.0 * height * (low * low + low * high + high * high)
}

#[test]
fn volumes_are_those_of_formulas() {
    let v = Vec2::new;
    let near = |name: &str, parts: &[Part], exact: f32, share: f32| {
        let got = volume_m3(parts) / exact;
        assert!((got - 1.0).abs() < share, "{name}: {got} of its volume");
    };
    // A tumbler: what is outside less what is inside, whose wall is measured across its slope.
    let (slope, wall) = (0.01_f32 / 0.09, 0.005);
    let across = wall * (1.0 + slope * slope).sqrt();
    let inner = [0.03 - across + wall * slope, 0.04 - across];
    let tumbler = cone_m3([0.03, 0.04], 0.09) - cone_m3(inner, 0.09 - wall);
    near("tumbler", &vessel(&circle(12), &[v(0.03, 0.0), v(0.04, 0.09)], wall), tumbler, 0.08);
    // A bowl that is half a ball, without the floor.
    let half = PI * 2.0 / 3.0 * (0.06_f32.powi(3) - 0.055_f32.powi(3));
    let ball = arc(v(0.0, 0.06), Vec2::splat(0.06), [-80.0, 0.0], 5);
    let lid = 2.0 * PI * 0.06 * 0.06 * (1.0 - libm::sinf(80_f32.to_radians())) * wall;
    near("bowl", &shell(&circle(24), &ball, wall), half - lid, 0.05);
    let octagon: Vec<Vec2> = circle(8).iter().map(|point| v(0.04, 0.0) + 0.01 * *point).collect();
    near("ring", &walls(&circle(14), &octagon), 2.0 * PI * PI * 0.04 * 0.01 * 0.01, 0.14);
    let bent = arc(Vec2::ZERO, Vec2::splat(0.06), [0.0, 90.0], 8);
    near("bend", &sweep(&bent, &circle(16), &[0.015; 9]), PI * 0.015 * 0.015 * 0.06 * 0.5 * PI, 0.04);
    let cone = sweep(&[v(0.0, 0.0), v(0.05, 0.0), v(0.1, 0.0)], &circle(24), &[0.03, 0.02, 0.01]);
    // A ball's eighths at the corners, quarters of cylinders along the edges, and blocks on the faces and within.
    let (half, radius) = (Vec3::new(0.05, 0.03, 0.02), 0.012);
    let inner = 2.0 * (half - Vec3::splat(radius));
    let faces = 2.0 * radius * (inner.x * inner.y + inner.y * inner.z + inner.z * inner.x);
    let round = PI * radius * radius * (inner.element_sum() + 4.0 / 3.0 * radius);
    near("soft box", &[soft_box(half, radius)], inner.element_product() + faces + round, 0.04);
    near("cone", &cone, cone_m3([0.03, 0.01], 0.1), 0.02);
    let stack =
        stack(&circle(24), &[[0.02, 0.0], [0.03, 0.02], [0.01, 0.05], [0.01, 0.07], [0.02, 0.07], [0.02, 0.08]]);
    let cones = [([0.02, 0.03], 0.02), ([0.03, 0.01], 0.03), ([0.01, 0.01], 0.02), ([0.02, 0.02], 0.01)];
    near("stack", &stack, cones.into_iter().map(|(radii, height)| cone_m3(radii, height)).sum(), 0.02);
    assert_eq!(stack.len(), 3, "a part goes on until the profile turns outwards or steps");
}

#[test]
fn a_superellipse_is_an_ellipse_and_a_rounded_rectangle() {
    let area = |power: f32| {
        let corners = superellipse(64, power, Vec2::new(0.03, 0.02));
        let next = corners.iter().cycle().skip(1);
        0.5 * corners.iter().zip(next).map(|(a, b)| a.perp_dot(*b)).sum::<f32>() / (4.0 * 0.03 * 0.02)
    };
    for (power, exact) in [(2.0, 0.25 * PI), (4.0, 0.927_037), (1.5, 0.684_464)] {
        assert!((area(power) / exact - 1.0).abs() < 0.01, "{power}: {}", area(power));
    }
}
