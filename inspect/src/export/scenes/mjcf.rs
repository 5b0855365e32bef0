//! MuJoCo's files. Hulls are written by their corners into the file itself, so that a scene is one file.
//!
//! Two bodies have the product of their frictions in our physics, in MuJoCo the larger of the two. So the pairs of a
//! scene's bodies are listed with their products; what a user adds meets them by MuJoCo's own rule. Contacts are as
//! hard as in the cross-check (`scripts/crosscheck/mujoco_engine.py`): with MuJoCo's soft default objects creep.

use std::fmt::Write as _;

use schema::{Gripper, HandBox, Polyhedron};

use super::world::{Item, Part, TABLE_HALF_M, World, palm_mass_kg, spaced, wxyz};

/// Length of a step, in seconds; the time constant of a contact must be at least twice that.
const TIME_STEP_S: f32 = 0.002;
/// Colours of objects, in turn: red, green, blue.
const COLOURS: [[f32; 3]; 6] =
    [[0.8, 0.35, 0.3], [0.3, 0.55, 0.8], [0.4, 0.7, 0.4], [0.85, 0.65, 0.3], [0.6, 0.45, 0.75], [0.5, 0.7, 0.7]];

/// The scene.
pub(super) fn scene(world: &World) -> String {
    let mut text = format!("<mujoco model=\"scene-{:09}\">\n", world.scene_id);
    put(&mut text, format_args!("  <compiler angle=\"radian\" autolimits=\"true\"/>"));
    options(&mut text, world);
    put(&mut text, format_args!("  <asset>"));
    for item in &world.objects {
        for (name, part) in item.part_names().iter().zip(&item.parts) {
            if let Part::Hull(hull) = part {
                mesh(&mut text, name, hull);
            }
        }
    }
    for (number, wall) in world.walls.iter().enumerate() {
        mesh(&mut text, &wall_name(number), wall);
    }
    put(&mut text, format_args!("  </asset>\n  <worldbody>"));
    surroundings(&mut text, world);
    world.objects.iter().enumerate().for_each(|(number, item)| body(&mut text, number, item));
    put(&mut text, format_args!("  </worldbody>\n  <contact>"));
    pairs(&mut text, world);
    text + "  </contact>\n</mujoco>\n"
}

fn put(text: &mut String, line: std::fmt::Arguments<'_>) {
    // Writing into a String cannot fail.
    let _ = writeln!(text, "{line}");
}

fn options(text: &mut String, world: &World) {
    let (gravity, width, height) = (world.physics.gravity_m_s2, world.lens.width_px, world.lens.height_px);
    put(
        text,
        format_args!(
            "  <option timestep=\"{TIME_STEP_S}\" gravity=\"0 0 {}\" cone=\"elliptic\" integrator=\"implicitfast\" \
             impratio=\"10\" noslip_iterations=\"10\"/>",
            -gravity
        ),
    );
    put(text, format_args!("  <visual><global offwidth=\"{width}\" offheight=\"{height}\"/></visual>"));
    let hard = format!("condim=\"3\" solref=\"{} 1\" solimp=\"0.99 0.99 0.0001\"", 2.0 * TIME_STEP_S);
    put(text, format_args!("  <default>\n    <geom {hard}/>\n    <pair {hard}/>\n  </default>"));
}

fn mesh(text: &mut String, name: &str, hull: &Polyhedron) {
    let corners = spaced(hull.corners_m().iter().flat_map(|corner| corner.to_array()));
    put(text, format_args!("    <mesh name=\"{name}\" vertex=\"{corners}\"/>"));
}

fn wall_name(number: usize) -> String {
    format!("container_part_{number}")
}

/// Light, table, container and cameras.
fn surroundings(text: &mut String, world: &World) {
    let (friction, middle_m) = (world.physics.table_friction, 0.5 * world.grid.size_m);
    put(text, format_args!("    <light pos=\"{middle_m} {middle_m} 2\" dir=\"0 0 -1\" directional=\"true\"/>"));
    put(
        text,
        format_args!(
            "    <geom name=\"table\" type=\"box\" pos=\"{}\" size=\"{}\" friction=\"{friction}\" rgba=\"0.75 0.75 0.72 1\"/>",
            spaced(world.table_centre_m()),
            spaced(TABLE_HALF_M)
        ),
    );
    for number in 0..world.walls.len() {
        let name = wall_name(number);
        put(
            text,
            format_args!(
                "    <geom name=\"{name}\" type=\"mesh\" mesh=\"{name}\" friction=\"{friction}\" rgba=\"0.6 0.65 0.7 1\"/>"
            ),
        );
    }
    let angle_deg = world.field_of_view_rad().to_degrees();
    for (number, pose) in world.cameras_looking_back().enumerate() {
        put(
            text,
            format_args!(
                "    <camera name=\"camera_{number}\" pos=\"{}\" quat=\"{}\" fovy=\"{angle_deg}\" resolution=\"{} {}\"/>",
                spaced(pose.translation.to_array()),
                spaced(wxyz(pose.rotation)),
                world.lens.width_px,
                world.lens.height_px
            ),
        );
    }
}

fn body(text: &mut String, number: usize, item: &Item) {
    let (pose, mass) = (&item.row.workspace_from_object, &item.mass);
    put(
        text,
        format_args!(
            "    <body name=\"{}\" pos=\"{}\" quat=\"{}\">\n      <freejoint name=\"{}\"/>",
            item.name,
            spaced(pose.translation.to_array()),
            spaced(wxyz(pose.rotation)),
            item.name
        ),
    );
    put(
        text,
        format_args!(
            "      <inertial pos=\"{}\" mass=\"{}\" fullinertia=\"{}\"/>",
            spaced(mass.centre_m),
            mass.mass_kg,
            spaced(mass.inertia_kg_m2)
        ),
    );
    let look = format!("friction=\"{}\" rgba=\"{} 1\"", item.row.friction, spaced(COLOURS[number % COLOURS.len()]));
    for (name, part) in item.part_names().iter().zip(&item.parts) {
        let shape = match part {
            Part::Cuboid(half_m) => format!("type=\"box\" size=\"{}\"", spaced(half_m.to_array())),
            Part::Hull(_) => format!("type=\"mesh\" mesh=\"{name}\""),
        };
        put(text, format_args!("      <geom name=\"{name}\" {shape} {look}/>"));
    }
    put(text, format_args!("    </body>"));
}

/// Every pair of shapes that may touch, with the product of their frictions.
fn pairs(text: &mut String, world: &World) {
    let mut pair = |one: &str, other: &str, friction: f32| {
        put(text, format_args!("    <pair geom1=\"{one}\" geom2=\"{other}\" friction=\"{friction} {friction}\"/>"));
    };
    let fixed: Vec<String> = std::iter::once("table".to_owned()).chain((0..world.walls.len()).map(wall_name)).collect();
    for (number, item) in world.objects.iter().enumerate() {
        let names = item.part_names();
        for (name, still) in names.iter().flat_map(|name| fixed.iter().map(move |still| (name, still))) {
            pair(name, still, item.row.friction * world.physics.table_friction);
        }
        for other in &world.objects[number + 1..] {
            let others = other.part_names();
            for (name, its) in names.iter().flat_map(|name| others.iter().map(move |its| (name, its))) {
                pair(name, its, item.row.friction * other.row.friction);
            }
        }
    }
}

/// The hand: a palm with two fingers that slide, in the grasp frame. A finger's motor has its full force at rest and
/// none at its speed, as in our physics. A limit of the force would be reached at rest, and MuJoCo's implicit step
/// leaves the damping out where it is: a finger would jump to many times its speed.
pub(super) fn hand(hand: &Gripper) -> String {
    let (speed, force) = (hand.closing_speed_m_s, hand.finger_force_n);
    let mut text =
        "<mujoco model=\"hand\">\n  <compiler autolimits=\"true\"/>\n  <option integrator=\"implicitfast\"/>\n\
                    \x20 <worldbody>\n    <body name=\"hand\">\n      <site name=\"grasp\" size=\"0.002\"/>\n"
            .to_owned();
    put(&mut text, format_args!("      {}", hand_geom("palm", &hand.palm(), palm_mass_kg(hand), hand.friction)));
    let fingers = hand.fingers(hand.opening_m_max);
    for ((name, inwards), finger) in [("left_finger", 1.0), ("right_finger", -1.0)].into_iter().zip(&fingers) {
        put(
            &mut text,
            format_args!(
                "      <body name=\"{name}\" gravcomp=\"1\">\n        <joint name=\"{name}\" type=\"slide\" axis=\"0 {inwards} 0\" \
                 range=\"0 {}\"/>",
                0.5 * hand.opening_m_max
            ),
        );
        put(&mut text, format_args!("        {}", hand_geom(name, finger, hand.finger_mass_kg, hand.friction)));
        put(&mut text, format_args!("      </body>"));
    }
    text += "    </body>\n  </worldbody>\n  <contact>\n";
    for (one, other) in [("hand", "left_finger"), ("hand", "right_finger"), ("left_finger", "right_finger")] {
        put(&mut text, format_args!("    <exclude body1=\"{one}\" body2=\"{other}\"/>"));
    }
    text += "  </contact>\n  <actuator>\n";
    for name in ["left_finger", "right_finger"] {
        put(
            &mut text,
            format_args!(
                "    <velocity name=\"{name}\" joint=\"{name}\" kv=\"{}\" ctrlrange=\"-{speed} {speed}\"/>",
                force / speed
            ),
        );
    }
    text + "  </actuator>\n</mujoco>\n"
}

fn hand_geom(name: &str, shape: &HandBox, mass_kg: f32, friction: f32) -> String {
    let (centre, half) = (spaced(shape.centre_m.to_array()), spaced(shape.half_m.to_array()));
    format!(
        "<geom name=\"{name}\" type=\"box\" pos=\"{centre}\" size=\"{half}\" mass=\"{mass_kg}\" friction=\"{friction}\"/>"
    )
}
