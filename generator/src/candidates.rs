//! Candidates: grasps drawn by the rules, not yet executed.

use schema::{Approach, Axis, Drawn, ObjectRecord, Pose, Rule, SLIDE_SHARE, Stream, TIP_DEPTH_M, Tilt, law_of};

use crate::config::RuleClosing;

/// A grasp to execute, with everything that was drawn for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// The target: its index in the scene.
    pub object_id: usize,
    /// Row of Appendix A, or the approach along the surface's normal.
    pub rule: Rule,
    /// Object axis along which the gripper closes, before the turn is applied.
    pub closing: Option<Axis>,
    /// r_y.
    pub tilt_rad: f32,
    /// r_x; 0 for rules without. Along a normal: the yaw.
    pub turn_rad: f32,
    /// d_z. Along a normal: depth of the tips below the surface.
    pub depth_m: f32,
    /// d_x; 0 for rules without.
    pub slide_m: f32,
    /// The grasp.
    pub workspace_from_grasp: Pose,
}

impl Candidate {
    /// A candidate of which nothing but the pose was drawn.
    pub(crate) fn undrawn(rule: Rule, object_id: usize, workspace_from_grasp: Pose) -> Self {
        let [tilt_rad, turn_rad, depth_m, slide_m] = [0.0; 4];
        Self { object_id, rule, closing: None, tilt_rad, turn_rad, depth_m, slide_m, workspace_from_grasp }
    }
}

/// Draws `count` candidates, distributed evenly over a scene's objects, and over each object's three rules.
///
/// # Panics
/// If there are no objects, or one is not a primitive.
#[must_use]
pub fn draw_candidates(
    objects: &[ObjectRecord],
    count: usize,
    closing: RuleClosing,
    stream: &mut Stream,
) -> Vec<Candidate> {
    assert!(!objects.is_empty(), "a scene without objects has no candidates");
    (0..count)
        .map(|attempt| {
            let (object_id, round) = (attempt % objects.len(), attempt / objects.len());
            draw_candidate(&objects[object_id], object_id, Axis::ALL[round % 3], closing, stream)
        })
        .collect()
}

/// Draws one candidate for an object, approached along one of its axes. Every rule makes the same number of draws.
///
/// # Panics
/// If the object is not a primitive: Appendix A has no rules for others.
#[must_use]
pub fn draw_candidate(
    object: &ObjectRecord,
    object_id: usize,
    approach: Axis,
    closing: RuleClosing,
    stream: &mut Stream,
) -> Candidate {
    let solid = object.shape.as_solid().expect("a config with a catalogue draws along normals");
    let rule = Rule { shape: solid.kind.into(), approach: Approach::Axis(approach) };
    let law = law_of(solid.kind, approach);
    let drawn = law.closing[stream.index(law.closing.len())];
    let width_m = |axis: &Axis| axis.of(solid.extents_m);
    let closing = match closing {
        RuleClosing::Drawn => drawn,
        RuleClosing::Narrowest => {
            law.closing.iter().copied().min_by(|a, b| width_m(a).total_cmp(&width_m(b))).unwrap_or(drawn)
        }
    };
    let (tilt, turn) = (stream.normal(0.0, 1.0), stream.uniform(0.0, 1.0));
    let (tip, slide) = (stream.uniform(TIP_DEPTH_M[0], TIP_DEPTH_M[1]), stream.normal(0.0, 1.0));
    let tilt_rad = match law.tilt {
        Tilt::Normal { std_rad } => std_rad * tilt,
        // Such a rule has no turn, so the uniform draw is free.
        Tilt::Uniform { max_rad } => max_rad * (2.0 * turn - 1.0),
    };
    let turn_rad = if law.turns { core::f32::consts::TAU * turn } else { 0.0 };
    let across = third(approach, closing);
    let depth_m = tip - 0.5 * approach.of(solid.extents_m);
    let slide_m = if law.slides { SLIDE_SHARE * across.of(solid.extents_m) * slide } else { 0.0 };
    let drawn = Drawn { approach, closing, turn_rad, tilt_rad, depth_m, slide_m };
    let workspace_from_grasp = drawn.workspace_from_grasp(&object.workspace_from_object);
    Candidate { object_id, rule, closing: Some(closing), tilt_rad, turn_rad, depth_m, slide_m, workspace_from_grasp }
}

fn third(a: Axis, b: Axis) -> Axis {
    Axis::ALL.into_iter().find(|axis| *axis != a && *axis != b).unwrap_or(a)
}

#[cfg(test)]
mod tests {
    use schema::{Purpose, Quat, ShapeKind, Solid, Vec3, axis_angle};

    use super::*;

    fn object(kind: ShapeKind, rotation: Quat) -> ObjectRecord {
        let extents = match kind {
            ShapeKind::Cylinder => Vec3::new(0.04, 0.04, 0.07),
            ShapeKind::HalfCylinder => Vec3::new(0.07, 0.06, 0.03),
            _ => Vec3::new(0.03, 0.05, 0.07),
        };
        ObjectRecord {
            scene_id: 1,
            object_id: 0,
            shape: Solid::new(kind, extents).unwrap().into(),
            mass_kg: 0.1,
            friction: 1.0,
            workspace_from_object: Pose::from_parts(Vec3::new(0.1, 0.2, 0.08), rotation),
        }
    }

    fn draws(kind: ShapeKind, approach: Axis, count: usize) -> Vec<Candidate> {
        let mut stream = Stream::new(3, 1, Purpose::Candidates, 0);
        (0..count)
            .map(|_| {
                let object = object(kind, stream.rotation());
                draw_candidate(&object, 0, approach, RuleClosing::Drawn, &mut stream)
            })
            .collect()
    }

    fn std(values: impl Iterator<Item = f32> + Clone) -> f32 {
        let n = values.clone().count() as f32;
        (values.map(|v| v * v).sum::<f32>() / n).sqrt()
    }

    /// The same draws, but for the closing axis where several are open, and what depends on it.
    #[test]
    fn closings_are_drawn_or_along_the_narrowest_open_axis() {
        for (kind, approach) in ShapeKind::ALL.into_iter().flat_map(|kind| Axis::ALL.map(|axis| (kind, axis))) {
            let object = object(kind, Quat::IDENTITY);
            let extents_m = object.shape.extents_m();
            let open = law_of(kind, approach).closing;
            let least_m = open.iter().map(|axis| axis.of(extents_m)).fold(f32::INFINITY, f32::min);
            let draw = |closing, seed| {
                draw_candidate(&object, 0, approach, closing, &mut Stream::new(seed, 1, Purpose::Candidates, 0))
            };
            let mut drawn_axes = Vec::new();
            for seed in 0..40 {
                let (drawn, narrow) = (draw(RuleClosing::Drawn, seed), draw(RuleClosing::Narrowest, seed));
                assert_eq!(narrow.closing.unwrap().of(extents_m), least_m, "{kind:?} {approach:?}");
                assert_eq!((drawn.tilt_rad, drawn.turn_rad), (narrow.tilt_rad, narrow.turn_rad));
                assert_eq!(drawn.depth_m, narrow.depth_m);
                drawn_axes.push(drawn.closing.unwrap());
            }
            assert!(open.iter().all(|axis| drawn_axes.contains(axis)), "{kind:?} {approach:?}");
        }
    }

    /// Compares every row of Appendix A with the printed distributions, independently of the table in the code.
    #[test]
    fn draws_follow_the_printed_laws() {
        const PI: f32 = core::f32::consts::PI;
        // shape, axis, normal tilt std (or None: uniform ±π/2), turns, l_z, slide stds allowed
        type Row = (ShapeKind, Axis, Option<f32>, bool, f32, bool);
        let rows: &[Row] = &[
            (ShapeKind::Cuboid, Axis::X, Some(PI / 18.0), false, 0.03, true),
            (ShapeKind::Cuboid, Axis::Y, Some(PI / 18.0), false, 0.05, true),
            (ShapeKind::Cuboid, Axis::Z, Some(PI / 18.0), false, 0.07, true),
            (ShapeKind::Cylinder, Axis::X, Some(PI / 18.0), true, 0.04, true),
            (ShapeKind::Cylinder, Axis::Y, Some(PI / 18.0), true, 0.04, true),
            (ShapeKind::Cylinder, Axis::Z, Some(PI / 18.0), false, 0.07, true),
            (ShapeKind::TriPrism, Axis::X, Some(PI / 27.0), false, 0.03, false),
            (ShapeKind::TriPrism, Axis::Y, Some(PI / 18.0), false, 0.05, true),
            (ShapeKind::TriPrism, Axis::Z, Some(PI / 18.0), false, 0.07, true),
            (ShapeKind::HalfCylinder, Axis::X, Some(PI / 24.0), false, 0.07, false),
            (ShapeKind::HalfCylinder, Axis::Y, None, false, 0.06, false),
            (ShapeKind::HalfCylinder, Axis::Z, None, false, 0.03, false),
        ];
        for (kind, axis, tilt_std, turns, l_z, slides) in rows {
            let drawn = draws(*kind, *axis, 20_000);
            let context = format!("{} {}", kind.name(), axis.name());
            let tilts = drawn.iter().map(|c| c.tilt_rad);
            match tilt_std {
                Some(expected) => assert!((std(tilts) / expected - 1.0).abs() < 0.03, "{context}"),
                None => {
                    assert!((std(tilts.clone()) / (PI / 12.0_f32.sqrt()) - 1.0).abs() < 0.03, "{context}");
                    assert!(tilts.clone().all(|t| t.abs() <= PI / 2.0), "{context}");
                }
            }
            let turned = drawn.iter().filter(|c| c.turn_rad > PI).count();
            assert_eq!(turned > 9_000 && turned < 11_000, *turns, "{context}: {turned} turned by more than π");
            for c in &drawn {
                let tip = c.depth_m + 0.5 * l_z;
                assert!((0.015 - 1e-6..0.035 + 1e-6).contains(&tip), "{context}: {c:?}");
            }
            let across =
                |c: &Candidate| third(*axis, c.closing.unwrap()).of(object(*kind, Quat::IDENTITY).shape.extents_m());
            let slide = std(drawn.iter().map(|c| c.slide_m / (across(c) / 6.0)));
            assert!((slide - if *slides { 1.0 } else { 0.0 }).abs() < 0.03, "{context}: {slide}");
        }
    }

    #[test]
    fn the_untilted_approach_points_down() {
        for kind in ShapeKind::ALL {
            for axis in Axis::ALL {
                for candidate in draws(kind, axis, 200) {
                    // Undo turn and tilt, after which it may point anywhere.
                    let undo = axis_angle(Vec3::Y, -candidate.tilt_rad).normalize();
                    let untilted =
                        candidate.workspace_from_grasp.rotation * undo * axis_angle(Vec3::X, -candidate.turn_rad);
                    assert!((untilted * Vec3::Z).z <= 1e-5, "{kind:?} {axis:?} {candidate:?}");
                }
            }
        }
    }

    #[test]
    fn offsets_are_along_the_grasps_own_axes() {
        for candidate in draws(ShapeKind::Cuboid, Axis::Z, 100) {
            let centre = candidate.workspace_from_grasp.inverse_transform_point(Vec3::new(0.1, 0.2, 0.08));
            let expected = -Vec3::new(candidate.slide_m, 0.0, candidate.depth_m);
            assert!((centre - expected).length() < 1e-6, "{candidate:?}: centre seen at {centre}");
        }
    }

    #[test]
    fn attempts_are_spread_evenly_over_objects_and_rules() {
        let objects = [ShapeKind::Cuboid, ShapeKind::Cylinder].map(|kind| object(kind, Quat::IDENTITY));
        let drawn = draw_candidates(&objects, 60, RuleClosing::Drawn, &mut Stream::new(1, 1, Purpose::Candidates, 0));
        for rule in Rule::of_the_paper().iter().take(6) {
            assert_eq!(drawn.iter().filter(|c| c.rule == *rule).count(), 10, "{}", rule.name());
        }
    }
}
