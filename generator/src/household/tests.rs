//! Household objects against formulas, the physics, and themselves.

use core::f32::consts::PI;
use std::path::Path;

use glamx::Vec2;
use schema::{Grid, Physics, Polyhedron, SettleParams, Vec3};
use simulator::{Body, convex_hull, settle};

use super::blocks::{arc, circle, shell, soft_box, stack, superellipse, sweep, vessel, walls};
use super::*;
use crate::catalogue::Catalogue;
use crate::config::{Config, Overrides};
use crate::measured::{overlap_share, smallest_width_m};
use crate::models::Models;
use crate::objects::draw_drops;

fn params(split: Split, kinds: &[Kind], count: usize, seed: u64) -> HouseholdParams {
    HouseholdParams { split, kinds: kinds.to_vec(), count, seed }
}

fn catalogue(params: &HouseholdParams) -> Catalogue {
    Catalogue::parse(&household(params).unwrap(), Path::new("household")).unwrap()
}

fn bodies(count: usize, seed: u64) -> Vec<Body> {
    catalogue(&params(Split::All, &[], count, seed)).objects().iter().map(|object| object.body.clone()).collect()
}

#[test]
fn objects_of_every_kind_are_sound_and_of_a_size_for_hands() {
    // Some 200 objects of each kind.
    for seed in 0..14 {
        let catalogue = catalogue(&params(Split::All, &[], MODELS_MAX, seed));
        assert_eq!(Models::of(&catalogue).unwrap().stored().len(), MODELS_MAX);
        for object in catalogue.objects() {
            let (name, sides_m, parts) = (object.body.name(), object.body.extents_m(), object.body.polyhedra().len());
            assert!((0.03..0.25).contains(&sides_m.max_element()), "{name}: {sides_m}");
            // What is wider has a wall that fingers reach around.
            assert!(sides_m.min_element() < 0.08 || parts > 10, "{name}: {sides_m}");
            assert!((0.004..1.0).contains(&object.mass_kg), "{name}: {} kg", object.mass_kg);
        }
    }
}

#[test]
fn an_object_depends_on_seed_kind_and_number_alone() {
    let text = |params: &HouseholdParams| household(params).unwrap();
    let all = text(&params(Split::All, &[], 140, 1));
    assert_eq!(all, text(&params(Split::All, &[], 140, 1)));
    let mugs = text(&params(Split::HeldOut, &[Kind::Mug], 3, 1));
    let [_, _, second, _] = mugs.split("[[object]]").collect::<Vec<_>>()[..] else { panic!("{mugs}") };
    assert!(all.contains(second) && second.contains("name = \"mug_001\""), "{second}");
    assert!(!text(&params(Split::All, &[], 140, 2)).contains(second));
}

/// Datasets of before name their objects by seed, kind and number alone.
#[test]
fn kinds_of_before_keep_their_objects() {
    let fnv = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    let digest = |split, kinds: &[Kind]| {
        household(&params(split, kinds, 270, 1)).unwrap().bytes().fold(0xcbf2_9ce4_8422_2325, fnv)
    };
    assert_eq!(digest(Split::Train, &Kind::ALL[..18]), 0x63db_6ff9_1634_d74c);
    assert_eq!(digest(Split::HeldOut, &Kind::ALL[18..27]), 0x5e03_8938_b012_b073);
}

#[test]
fn a_third_of_the_kinds_is_held_out() {
    let kinds = |split| params(split, &[], 1, 1).wanted().unwrap();
    let [train, held_out, all] = [Split::Train, Split::HeldOut, Split::All].map(kinds);
    assert_eq!((train.len(), held_out.len(), all.len()), (46, 23, 69));
    assert!(train.iter().all(|kind| !held_out.contains(kind)));
    let problem = household(&params(Split::Train, &[Kind::Cup, Kind::Mug], 2, 1)).unwrap_err();
    assert!(problem.contains("train") && problem.contains("mug"), "{problem}");
}

/// The gap between two convex bodies: the largest along a normal of a face or of two edges. Negative if they overlap.
fn gap_m(a: &Polyhedron, b: &Polyhedron) -> f32 {
    let faces = a.planes().chain(b.planes()).map(|plane| plane.normal);
    let across = a.edges_m().iter().flat_map(|one| b.edges_m().iter().map(|other| one.cross(*other)));
    let reach = |body: &Polyhedron, axis: Vec3| body.corners_m().iter().map(|c| axis.dot(*c)).fold(f32::MIN, f32::max);
    let axes = faces.chain(across).filter(|axis| axis.length() > 1e-8).map(Vec3::normalize);
    let gap = |axis| (-reach(a, axis) - reach(b, -axis)).max(-reach(b, axis) - reach(a, -axis));
    axes.map(gap).fold(f32::MIN, f32::max)
}

#[test]
fn parts_touch_and_hardly_overlap() {
    for body in bodies(2 * Kind::ALL.len(), 3) {
        let parts = body.polyhedra();
        let thin_m = parts.iter().map(|part| smallest_width_m(part, part.corners_m())).fold(f64::INFINITY, f64::min);
        assert!(thin_m > 0.0029, "{}: {thin_m} m", body.name());
        let overlap = overlap_share(&parts);
        assert!(overlap < 0.03, "{}: {overlap}", body.name());
        let mut joined = vec![0];
        while let Some(next) = (0..parts.len()).find(|part| {
            !joined.contains(part) && joined.iter().any(|other| gap_m(&parts[*part], &parts[*other]) < 1e-5)
        }) {
            joined.push(next);
        }
        assert_eq!(joined.len(), parts.len(), "{} falls apart", body.name());
    }
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

#[test]
fn dropped_objects_come_to_rest() {
    let config = |counts: &str| {
        let text = include_str!("../../../configs/generate/household.toml")
            .replace("split = \"train\"", "split = \"all\"")
            .replace("count = 920", "count = 138")
            .replace("counts = [1, 2, 3, 4, 5]", counts)
            .replace("[1.0, 1.0, 1.3, 1.3, 1.3]", "[1.0]");
        let document = settings::Document::parse(&text, Path::new("household.toml")).unwrap();
        Config::read(document, Overrides::default()).unwrap()
    };
    let physics: Physics = config("counts = [1]").physics;
    let (grid, mut rejected) = (Grid::PAPER, 0);
    for (counts, scenes) in [("counts = [1]", 138), ("counts = [5]", 12)] {
        let Config { objects, settle: params, .. } = config(counts);
        let params: SettleParams = params;
        for scene in 0..scenes {
            let drops = draw_drops(&objects, (&grid, [grid.size_m; 2]), f32::INFINITY, 7, scene, 0);
            rejected += u32::from(settle(&physics, &params, &grid, &[], &drops).is_err());
        }
    }
    assert!(rejected <= 4, "{rejected} of 150");
}
