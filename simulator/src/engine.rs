//! rapier, set up so that friction holds: the settings, and what is put into its world.
//!
//! With rapier's own defaults a gripped object creeps out of the jaws: soft contacts (30 Hz) let it sink and slide,
//! friction is left out of the bias pass, and recycled contacts are stale. What holds was found by agreement with
//! PyBullet over gripped objects: see [`Physics::FAITHFUL`].

use rapier3d::prelude::*;
use schema::{Mat3, Physics, Polyhedron, Pose};

use crate::SceneObject;
use crate::body::{Body, PartShape};
use crate::faceted::{shape_of, shape_of_hull};
use crate::mass_scaling::LeastInertia;

/// The engine's parameters for a step.
fn integration(physics: &Physics) -> IntegrationParameters {
    let softness = |of: SpringCoefficients<Real>| SpringCoefficients {
        natural_frequency: physics.contact_frequency_hz,
        damping_ratio: of.damping_ratio,
    };
    IntegrationParameters {
        dt: physics.dt_s(),
        num_solver_iterations: physics.solver_iterations,
        contact_softness: softness(SpringCoefficients::contact_defaults()),
        static_contact_softness: softness(SpringCoefficients::contact_static_defaults()),
        contact_recycling: false,
        friction_in_bias_pass: true,
        friction_model: FrictionModel::Coulomb,
        length_unit: LENGTH_UNIT_M * UNITS_PER_M,
        ..IntegrationParameters::default()
    }
}

/// The engine's unit of length: inside, a metre is 64 units (a power of two, so that conversion rounds nothing). In
/// metres parry takes the edges of small faces for parallel, whatever their angle: its clipping compares products of
/// squared lengths with a fixed 1e-7, below which all edges under 2 cm fall. A finger's edge across a facet then got
/// one contact point instead of two, and what it held swung about that point.
pub(crate) const UNITS_PER_M: f32 = 64.0;

/// rapier's idea of a typical size. It scales the slop (0.5 %) and the reach of speculative contacts (2 %): 0.5 mm and
/// 2 mm here, for objects of a few centimetres.
pub(crate) const LENGTH_UNIT_M: f32 = 0.1;

/// The table is a thick box, not a half-space: against a half-space parry never asks a shape which corners lie next to
/// the contact (see `faceted`), and an upright cylinder topples.
const TABLE_HALF_M: schema::Vec3 = schema::Vec3::new(1.5, 1.5, 0.5);

/// An object as the engine knows it, ready to be put into worlds.
pub(crate) struct EngineBody {
    shape: SharedShape,
    pub(crate) mass_properties: MassProperties,
    friction: f32,
    /// Share of its inertia that has weight.
    pub(crate) weight_share: f32,
}

impl EngineBody {
    /// A body that is no less sluggish than `least`.
    pub(crate) fn of(object: &SceneObject, least: LeastInertia) -> Self {
        let SceneObject { body, mass_kg, friction, .. } = object;
        let (shape, mut mass_properties) = joined(body);
        let gyration_m =
            (mass_properties.principal_inertia().min_element() / mass_properties.mass()).sqrt() / UNITS_PER_M;
        let inertia_kg = mass_kg.max(least.with_gyration_kg(gyration_m));
        mass_properties.set_mass(inertia_kg, true);
        Self { shape, mass_properties, friction: *friction, weight_share: mass_kg / inertia_kg }
    }
}

/// The parts of a body as one shape, and their mass properties at density 1. One shape, not a collider for each part:
/// contacts are then asked for by object, and the mass properties are ours, not the engine's sum (see [`sum`]).
fn joined(body: &Body) -> (SharedShape, MassProperties) {
    let shape = |part: &PartShape| match part {
        PartShape::Solid(solid) => shape_of(solid, UNITS_PER_M),
        PartShape::Hull(hull) => shape_of_hull(hull, UNITS_PER_M),
    };
    let parts: Vec<(Pose, SharedShape)> =
        body.parts().iter().map(|part| (in_units(part.object_from_part), shape(&part.shape))).collect();
    if let [(pose, shape)] = &parts[..]
        && *pose == Pose::IDENTITY
    {
        return (shape.clone(), shape.mass_properties(1.0));
    }
    let of_parts: Vec<MassProperties> =
        parts.iter().map(|(pose, shape)| shape.mass_properties(1.0).transform_by(pose)).collect();
    (SharedShape::compound(parts), sum(&of_parts))
}

/// Mass properties of several things joined, by parallel axes.
///
/// parry finds a sum's principal axes by products of its columns. Of a diagonal inertia with two equal smaller moments
/// it then takes x for the axis of one of them, whatever it is: a plate across x, cut in two, would turn about x with
/// half its inertia.
fn sum(parts: &[MassProperties]) -> MassProperties {
    let mass: f32 = parts.iter().map(MassProperties::mass).sum();
    let centre = parts.iter().map(|part| part.local_com * part.mass()).sum::<Vector>() / mass;
    let about_centre = |part: &MassProperties| {
        let off = part.local_com - centre;
        let outer = Mat3::from_cols(off * off.x, off * off.y, off * off.z);
        let shifted = Mat3::from_diagonal(Vector::splat(off.length_squared())) - outer;
        part.reconstruct_inertia_matrix() + shifted * part.mass()
    };
    let inertia = parts.iter().map(about_centre).fold(Mat3::ZERO, |all, part| all + part);
    let diagonal = Vector::new(inertia.x_axis.x, inertia.y_axis.y, inertia.z_axis.z);
    if inertia == Mat3::from_diagonal(diagonal) {
        return MassProperties::new(centre, mass, diagonal);
    }
    MassProperties::with_inertia_matrix(centre, mass, inertia)
}

/// A world with a table whose top is at `table_z_m` in the workspace, and the fixtures that stand there.
pub(crate) fn world_with_table(
    physics: &Physics,
    gravity_m_s2: Vector,
    world_from_workspace: &Pose,
    table_z_m: f32,
    fixtures: &[Polyhedron],
) -> PhysicsWorld {
    let mut world = PhysicsWorld {
        gravity: gravity_m_s2 * UNITS_PER_M,
        integration_parameters: integration(physics),
        ..PhysicsWorld::default()
    };
    let friction = physics.table_friction;
    let centre = Pose::from_parts(Vector::new(0.0, 0.0, table_z_m - TABLE_HALF_M.z), Rotation::IDENTITY);
    add_fixed_box(&mut world, *world_from_workspace * centre, TABLE_HALF_M, friction);
    for fixture in fixtures {
        let collider = ColliderBuilder::new(shape_of_hull(fixture, UNITS_PER_M));
        world.colliders.insert(surface(collider.position(in_units(*world_from_workspace)), friction));
    }
    world
}

/// Adds a box that never moves.
pub(crate) fn add_fixed_box(world: &mut PhysicsWorld, pose: Pose, half_m: Vector, friction: f32) -> ColliderHandle {
    let half = half_m * UNITS_PER_M;
    let collider = ColliderBuilder::cuboid(half.x, half.y, half.z).position(in_units(pose));
    world.colliders.insert(surface(collider, friction))
}

/// Adds a free object. One that is not awake stands still until something touches it.
pub(crate) fn add_object(
    world: &mut PhysicsWorld,
    engine_body: &EngineBody,
    world_from_object: Pose,
    is_awake: bool,
) -> RigidBodyHandle {
    let body = RigidBodyBuilder::dynamic().pose(in_units(world_from_object));
    let body = body.gravity_scale(engine_body.weight_share);
    let mut body = body.can_sleep(!is_awake).build();
    if !is_awake {
        // Once awake, it stays awake.
        body.activation_mut().time_until_sleep = f32::MAX;
        body.sleep();
    }
    let collider = ColliderBuilder::new(engine_body.shape.clone()).mass_properties(engine_body.mass_properties);
    world.insert(body, surface(collider, engine_body.friction)).0
}

/// Where a body's frame is.
pub(crate) fn pose_of(world: &PhysicsWorld, body: RigidBodyHandle) -> Pose {
    let pose = world.bodies[body].position();
    Pose::from_parts(pose.translation / UNITS_PER_M, pose.rotation)
}

fn in_units(pose: Pose) -> Pose {
    Pose::from_parts(pose.translation * UNITS_PER_M, pose.rotation)
}

/// A collider with a friction that is multiplied by the other's, and that nothing bounces off.
pub(crate) fn surface(collider: ColliderBuilder, friction: f32) -> ColliderBuilder {
    collider.friction(friction).friction_combine_rule(CoefficientCombineRule::Multiply).restitution(0.0)
}

#[cfg(test)]
mod tests {
    use schema::{Quat, ShapeKind, Solid, Vec3, axis_angle};

    use super::*;
    use crate::Part;

    fn cuboid(extents_m: Vec3) -> Solid {
        Solid::new(ShapeKind::Cuboid, extents_m).unwrap()
    }

    fn compound(parts: &[(Vec3, Vec3)]) -> Body {
        let part = |(extents_m, at_m): &(Vec3, Vec3)| Part {
            shape: PartShape::Solid(cuboid(*extents_m)),
            object_from_part: Pose::from_translation(*at_m),
        };
        Body::of_parts("boxes", parts.iter().map(part).collect()).unwrap()
    }

    /// Mass in kg, centre of mass in m, and inertia about it in kg m², all as the engine has them in a body of a world.
    fn mass_of(body: &Body, mass_kg: f32) -> (f32, Vec3, Mat3) {
        let at = Pose::IDENTITY;
        let mut world = world_with_table(&Physics::FAITHFUL, Vec3::ZERO, &at, -1.0, &[]);
        let object = SceneObject { body: body.clone(), mass_kg, friction: 1.0, workspace_from_object: at };
        let handle = add_object(&mut world, &EngineBody::of(&object, LeastInertia::NONE), at, true);
        world.step();
        let found = world.bodies[handle].mass_properties().local_mprops;
        let inertia = found.reconstruct_inertia_matrix() * (1.0 / (UNITS_PER_M * UNITS_PER_M));
        (found.mass(), found.local_com / UNITS_PER_M, inertia)
    }

    fn assert_inertia(found: Mat3, expected: Mat3, context: &str) {
        let scale = expected.x_axis.x + expected.y_axis.y + expected.z_axis.z;
        let off = found - expected;
        let off = [off.x_axis, off.y_axis, off.z_axis].iter().map(|c| c.abs().max_element()).fold(0.0, f32::max);
        assert!(off < 1e-4 * scale, "{context}: {found:?} instead of {expected:?}");
    }

    /// Inertia of a cuboid about its centre: m/12 (b² + c²) about each axis.
    fn inertia_of_cuboid(e: Vec3, mass_kg: f32) -> Mat3 {
        let squares = e * e;
        Mat3::from_diagonal((Vec3::splat(squares.element_sum()) - squares) * (mass_kg / 12.0))
    }

    #[test]
    fn a_cuboid_cut_in_two_weighs_and_turns_as_it_did() {
        // The last is a plate across x whose two smaller moments are equal to the bit: so many 256ths of a metre.
        let plate = Vec3::new(1.0, 20.0, 20.0) / 256.0;
        for extents in [Vec3::new(0.04, 0.06, 0.08), Vec3::new(0.08, 0.02, 0.02), plate] {
            for share in [0.25, 0.5] {
                let [left, right] = [share, 1.0 - share].map(|s| Vec3::new(extents.x, s * extents.y, extents.z));
                let cut = compound(&[(left, Vec3::ZERO), (right, Vec3::Y * (0.5 * extents.y))]);
                let (mass_kg, centre_m, inertia) = mass_of(&cut, 0.3);
                assert!((mass_kg - 0.3).abs() < 1e-6 && centre_m.length() < 1e-6, "{mass_kg} kg at {centre_m}");
                assert_inertia(inertia, inertia_of_cuboid(extents, 0.3), &format!("{extents} at {share}"));
                let (_, _, plain) = mass_of(&cuboid(extents).into(), 0.3);
                assert_inertia(plain, inertia_of_cuboid(extents, 0.3), "the engine's own");
            }
        }
    }

    #[test]
    fn a_dumb_bell_is_as_parallel_axes_say() {
        // Two cubes, one of twice the other's edge, so of eight times its mass, 0.1 m apart along a slanted line.
        let (small, large, mass_kg) = (0.02, 0.04, 0.9);
        let turn = axis_angle(Vec3::Z, 0.3) * axis_angle(Vec3::Y, 0.8);
        let part = |edge: f32, along_m: f32| Part {
            shape: PartShape::Solid(cuboid(Vec3::splat(edge))),
            object_from_part: Pose::from_parts(turn * Vec3::X * along_m, turn),
        };
        let bell = Body::of_parts("dumb_bell", vec![part(small, 0.0), part(large, 0.1)]).unwrap();
        let apart_m = bell.parts()[1].object_from_part.translation - bell.parts()[0].object_from_part.translation;
        assert!((apart_m - turn * Vec3::X * 0.1).length() < 1e-6);
        let expected_centre_m = bell.parts()[0].object_from_part.translation + apart_m * (8.0 / 9.0);
        let (found_kg, centre_m, inertia) = mass_of(&bell, mass_kg);
        assert!((found_kg - mass_kg).abs() < 1e-6 && (centre_m - expected_centre_m).length() < 1e-6, "{centre_m}");
        let [light_kg, heavy_kg] = [mass_kg / 9.0, 8.0 * mass_kg / 9.0];
        let own = (light_kg * small * small + heavy_kg * large * large) / 6.0;
        let lever = light_kg * heavy_kg / mass_kg * 0.1 * 0.1;
        let r = Mat3::from_quat(turn);
        let expected = r * Mat3::from_diagonal(Vec3::new(own, own + lever, own + lever)) * r.transpose();
        assert_inertia(inertia, expected, "dumb-bell");
    }

    #[test]
    fn one_solid_alone_is_the_solid() {
        for (kind, extents) in [
            (ShapeKind::Cuboid, Vec3::new(0.03, 0.05, 0.07)),
            (ShapeKind::Cylinder, Vec3::new(0.04, 0.04, 0.07)),
            (ShapeKind::TriPrism, Vec3::new(0.08, 0.05, 0.04)),
            (ShapeKind::HalfCylinder, Vec3::new(0.06, 0.06, 0.03)),
        ] {
            let solid = Solid::new(kind, extents).unwrap();
            let part =
                Part { shape: PartShape::Solid(solid), object_from_part: Pose::from_parts(Vec3::ZERO, Quat::IDENTITY) };
            let alone = Body::of_parts("alone", vec![part]).unwrap();
            assert_eq!(mass_of(&alone, 0.2), mass_of(&solid.into(), 0.2), "{kind:?}");
        }
    }
}
