//! USD as text, with the schemas of UsdPhysics: metres, kilograms, z up.
//!
//! How two frictions combine is not a matter of UsdPhysics, but of the engine; `physxMaterial:frictionCombineMode` asks
//! PhysX for our product. The tokens of a prim's type and schemas are USD's own.

use std::fmt::Write as _;

use schema::{Gripper, HandBox, Polyhedron, Pose, Vec3, bounds_m};

use super::world::{Item, Mass, Part, TABLE_HALF_M, World, listed, palm_mass_kg, wxyz};

/// Focal length of every camera, in tenths of a metre, as USD counts it; only its ratio to the aperture matters.
const FOCAL: f32 = 0.24;

/// Lines of text at a depth.
struct Stage {
    text: String,
    depth: usize,
}

impl Stage {
    fn new(root: &str) -> Self {
        let head = format!(
            "#usda 1.0\n(\n    defaultPrim = \"{root}\"\n    kilogramsPerUnit = 1\n    metersPerUnit = 1\n    upAxis = \"Z\"\n)\n\n"
        );
        Self { text: head, depth: 0 }
    }

    fn line(&mut self, line: impl std::fmt::Display) {
        // Writing into a String cannot fail.
        let _ = writeln!(self.text, "{:width$}{line}", "", width = 4 * self.depth);
    }

    /// A prim with its applied schemas and what `inside` writes into it.
    fn prim(&mut self, kind: &str, name: &str, schemas: &[&str], inside: impl FnOnce(&mut Self)) {
        self.line(format_args!("def {kind} \"{name}\""));
        if !schemas.is_empty() {
            let schemas = listed(schemas.iter().map(|schema| format!("\"{schema}\"")));
            self.line(format_args!("(\n{0:1$}    prepend apiSchemas = [{schemas}]\n{0:1$})", "", 4 * self.depth));
        }
        self.line("{");
        self.depth += 1;
        inside(self);
        self.depth -= 1;
        self.line("}");
    }

    fn placed(&mut self, pose: &Pose) {
        self.line(format_args!("quatf xformOp:orient = ({})", listed(wxyz(pose.rotation))));
        self.line(format_args!("double3 xformOp:translate = ({})", listed(pose.translation.to_array())));
        self.line("uniform token[] xformOpOrder = [\"xformOp:translate\", \"xformOp:orient\"]");
    }

    fn mass(&mut self, mass: &Mass) {
        let (moments, axes) = mass.principal;
        self.line(format_args!("point3f physics:centerOfMass = ({})", listed(mass.centre_m)));
        self.line(format_args!("float3 physics:diagonalInertia = ({})", listed(moments)));
        self.line(format_args!("float physics:mass = {}", mass.mass_kg));
        self.line(format_args!("quatf physics:principalAxes = ({})", listed(wxyz(axes))));
    }

    fn cuboid(&mut self, name: &str, centre_m: Vec3, half_m: Vec3, material: &str) {
        let schemas = ["PhysicsCollisionAPI", "MaterialBindingAPI"];
        self.prim("Cube", name, &schemas, |stage| {
            stage.line("float3[] extent = [(-1, -1, -1), (1, 1, 1)]");
            stage.line(format_args!("rel material:binding:physics = <{material}>"));
            stage.line("double size = 2");
            stage.line(format_args!("float3 xformOp:scale = ({})", listed(half_m.to_array())));
            stage.line(format_args!("double3 xformOp:translate = ({})", listed(centre_m.to_array())));
            stage.line("uniform token[] xformOpOrder = [\"xformOp:translate\", \"xformOp:scale\"]");
        });
    }

    fn hull(&mut self, name: &str, hull: &Polyhedron, material: &str) {
        let schemas = ["PhysicsCollisionAPI", "PhysicsMeshCollisionAPI", "MaterialBindingAPI"];
        let points = |corners: &[Vec3]| listed(corners.iter().map(|corner| format!("({})", listed(corner.to_array()))));
        let rings = || hull.faces().iter().map(|face| &face.ring);
        self.prim("Mesh", name, &schemas, |stage| {
            stage.line(format_args!("float3[] extent = [{}]", points(&bounds_m(hull.corners_m()))));
            stage.line(format_args!("int[] faceVertexCounts = [{}]", listed(rings().map(Vec::len))));
            stage.line(format_args!("int[] faceVertexIndices = [{}]", listed(rings().flatten())));
            stage.line(format_args!("rel material:binding:physics = <{material}>"));
            stage.line("uniform token physics:approximation = \"convexHull\"");
            stage.line(format_args!("point3f[] points = [{}]", points(hull.corners_m())));
            stage.line("uniform token subdivisionScheme = \"none\"");
        });
    }

    fn material(&mut self, name: &str, friction: f32) {
        self.prim("Material", name, &["PhysicsMaterialAPI", "PhysxMaterialAPI"], |stage| {
            stage.line(format_args!("float physics:dynamicFriction = {friction}"));
            stage.line("float physics:restitution = 0");
            stage.line(format_args!("float physics:staticFriction = {friction}"));
            stage.line("uniform token physxMaterial:frictionCombineMode = \"multiply\"");
        });
    }
}

/// The scene.
pub(super) fn scene(world: &World) -> String {
    let mut stage = Stage::new("World");
    stage.prim("Xform", "World", &[], |stage| {
        stage.prim("PhysicsScene", "physicsScene", &[], |stage| {
            stage.line("vector3f physics:gravityDirection = (0, 0, -1)");
            stage.line(format_args!("float physics:gravityMagnitude = {}", world.physics.gravity_m_s2));
        });
        stage.prim("Scope", "materials", &[], |stage| {
            stage.material("table", world.physics.table_friction);
            world.objects.iter().for_each(|item| stage.material(&item.name, item.row.friction));
        });
        let (centre_m, half_m) = (Vec3::from_array(world.table_centre_m()), Vec3::from_array(TABLE_HALF_M));
        stage.cuboid("table", centre_m, half_m, "/World/materials/table");
        if !world.walls.is_empty() {
            stage.prim("Xform", "container", &[], |stage| {
                for (number, wall) in world.walls.iter().enumerate() {
                    stage.hull(&format!("part_{number}"), wall, "/World/materials/table");
                }
            });
        }
        world.objects.iter().for_each(|item| object(stage, item));
        cameras(stage, world);
    });
    stage.text
}

fn object(stage: &mut Stage, item: &Item) {
    let schemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"];
    stage.prim("Xform", &item.name, &schemas, |stage| {
        stage.mass(&item.mass);
        stage.placed(&item.row.workspace_from_object);
        let material = format!("/World/materials/{}", item.name);
        for (number, part) in item.parts.iter().enumerate() {
            let name = format!("part_{number}");
            match part {
                Part::Cuboid(half_m) => stage.cuboid(&name, Vec3::ZERO, *half_m, &material),
                Part::Hull(hull) => stage.hull(&name, hull, &material),
            }
        }
    });
}

fn cameras(stage: &mut Stage, world: &World) {
    let lens = &world.lens;
    for (number, pose) in world.cameras_looking_back().enumerate() {
        stage.prim("Camera", &format!("camera_{number}"), &[], |stage| {
            stage.line("float2 clippingRange = (0.01, 100)");
            stage.line(format_args!("float focalLength = {FOCAL}"));
            stage.line(format_args!("float horizontalAperture = {}", FOCAL * lens.width_px as f32 / lens.fx_px));
            stage.line(format_args!("float verticalAperture = {}", FOCAL * lens.height_px as f32 / lens.fy_px));
            stage.placed(&pose);
        });
    }
}

/// The hand: a palm with two fingers that slide, in the grasp frame. A finger's drive has its full force at rest and
/// none at its speed, as in our physics.
pub(super) fn hand(hand: &Gripper) -> String {
    let mut stage = Stage::new("hand");
    let [left, right] = hand.fingers(hand.opening_m_max);
    stage.prim("Xform", "hand", &["PhysicsArticulationRootAPI"], |stage| {
        stage.prim("Scope", "materials", &[], |stage| stage.material("hand", hand.friction));
        body(stage, "palm", &hand.palm(), palm_mass_kg(hand));
        body(stage, "left_finger", &left, hand.finger_mass_kg);
        body(stage, "right_finger", &right, hand.finger_mass_kg);
        // A joint slides along its frames' +y; half a turn about z makes that the workspace's −y.
        slide(stage, hand, "left_finger", "(1, 0, 0, 0)");
        slide(stage, hand, "right_finger", "(0, 0, 0, 1)");
    });
    stage.text
}

fn body(stage: &mut Stage, name: &str, of: &HandBox, mass_kg: f32) {
    stage.prim("Xform", name, &["PhysicsRigidBodyAPI", "PhysicsMassAPI"], |stage| {
        stage.mass(&Mass::of_box(of, mass_kg));
        stage.cuboid("box", of.centre_m, of.half_m, "/hand/materials/hand");
    });
}

fn slide(stage: &mut Stage, hand: &Gripper, finger: &str, axes: &str) {
    stage.prim("PhysicsPrismaticJoint", &format!("{finger}_slide"), &["PhysicsDriveAPI:linear"], |stage| {
        stage.line(format_args!(
            "float drive:linear:physics:damping = {}",
            hand.finger_force_n / hand.closing_speed_m_s
        ));
        stage.line(format_args!("float drive:linear:physics:maxForce = {}", hand.finger_force_n));
        stage.line("float drive:linear:physics:stiffness = 0");
        stage.line("float drive:linear:physics:targetVelocity = 0");
        stage.line("uniform token drive:linear:physics:type = \"force\"");
        stage.line("uniform token physics:axis = \"Y\"");
        stage.line("rel physics:body0 = </hand/palm>");
        stage.line(format_args!("rel physics:body1 = </hand/{finger}>"));
        for number in 0..2 {
            stage.line(format_args!("point3f physics:localPos{number} = (0, 0, 0)"));
            stage.line(format_args!("quatf physics:localRot{number} = {axes}"));
        }
        stage.line("float physics:lowerLimit = 0");
        stage.line(format_args!("float physics:upperLimit = {}", 0.5 * hand.opening_m_max));
    });
}
