//! URDF, one robot a body, and the meshes of their hulls as OBJ. Poses are in `scene.json`, for URDF has no place for
//! them; what stands still is in the workspace's frame already.
//!
//! `contact` is not of URDF's standard: Bullet and what descends from it read the friction there, others ignore it.

use schema::{Gripper, HandBox, Polyhedron};

use super::world::{Mass, Part, TABLE_HALF_M, World, palm_mass_kg, spaced};

/// The folder of the meshes.
pub(super) const MESHES: &str = "meshes";

/// Files by their names in a scene's folder.
pub(super) fn files(world: &World) -> Vec<(String, String)> {
    let friction = world.physics.table_friction;
    let table = shape(&spaced(world.table_centre_m()), &cuboid(TABLE_HALF_M));
    let mut files = vec![("table.urdf".to_owned(), robot("table", &link("table", friction, STILL, &table)))];
    if !world.walls.is_empty() {
        let mut shapes = String::new();
        for (number, wall) in world.walls.iter().enumerate() {
            shapes += &hull(&mut files, format!("container_part_{number}"), wall);
        }
        let text = robot("container", &link("container", friction, STILL, &shapes));
        files.push(("container.urdf".to_owned(), text));
    }
    for item in &world.objects {
        let mut shapes = String::new();
        for (name, part) in item.part_names().into_iter().zip(&item.parts) {
            shapes += &match part {
                Part::Cuboid(half_m) => shape("0 0 0", &cuboid(half_m.to_array())),
                Part::Hull(polyhedron) => hull(&mut files, name, polyhedron),
            };
        }
        let text = robot(&item.name, &link(&item.name, item.row.friction, &inertial(&item.mass), &shapes));
        files.push((format!("{}.urdf", item.name), text));
    }
    files.push(("hand.urdf".to_owned(), hand(world.hand)));
    files
}

fn robot(name: &str, inside: &str) -> String {
    format!("<?xml version=\"1.0\"?>\n<robot name=\"{name}\">\n{inside}</robot>\n")
}

fn link(name: &str, friction: f32, inertial: &str, shapes: &str) -> String {
    format!(
        "  <link name=\"{name}\">\n    <contact><lateral_friction value=\"{friction}\"/></contact>\n{inertial}{shapes}  </link>\n"
    )
}

/// Of what stands still: without it Bullet assumes a kilogram, and warns.
const STILL: &str = "    <inertial><mass value=\"0\"/><inertia ixx=\"0\" ixy=\"0\" ixz=\"0\" iyy=\"0\" iyz=\"0\" izz=\"0\"/></inertial>\n";

fn inertial(mass: &Mass) -> String {
    let [xx, yy, zz, xy, xz, yz] = mass.inertia_kg_m2;
    format!(
        "    <inertial>\n      <origin xyz=\"{}\"/>\n      <mass value=\"{}\"/>\n      <inertia ixx=\"{xx}\" ixy=\"{xy}\" \
         ixz=\"{xz}\" iyy=\"{yy}\" iyz=\"{yz}\" izz=\"{zz}\"/>\n    </inertial>\n",
        spaced(mass.centre_m),
        mass.mass_kg
    )
}

/// A shape that is seen and collides.
fn shape(at: &str, geometry: &str) -> String {
    ["visual", "collision"].map(|kind| format!("    <{kind}><origin xyz=\"{at}\"/>{geometry}</{kind}>\n")).concat()
}

fn cuboid(half_m: [f32; 3]) -> String {
    format!("<geometry><box size=\"{}\"/></geometry>", spaced(half_m.map(|half_m| 2.0 * half_m)))
}

/// A hull, whose mesh becomes a file.
fn hull(files: &mut Vec<(String, String)>, name: String, polyhedron: &Polyhedron) -> String {
    let path = format!("{MESHES}/{name}.obj");
    files.push((path.clone(), obj(polyhedron)));
    shape("0 0 0", &format!("<geometry><mesh filename=\"{path}\"/></geometry>"))
}

/// A polyhedron as OBJ, in metres.
fn obj(polyhedron: &Polyhedron) -> String {
    let corners = polyhedron.corners_m().iter().map(|corner| format!("v {}\n", spaced(corner.to_array())));
    let triangles = polyhedron.triangles();
    let triangles = triangles.iter().map(|triangle| format!("f {}\n", spaced(triangle.map(|corner| corner + 1))));
    corners.chain(triangles).collect()
}

/// The hand: a palm with two fingers that slide, in the grasp frame.
fn hand(hand: &Gripper) -> String {
    let body = |name: &str, of: &HandBox, mass_kg: f32| {
        let (at, mass) = (spaced(of.centre_m.to_array()), Mass::of_box(of, mass_kg));
        link(name, hand.friction, &inertial(&mass), &shape(&at, &cuboid(of.half_m.to_array())))
    };
    let mut text = body("hand", &hand.palm(), palm_mass_kg(hand));
    let fingers = hand.fingers(hand.opening_m_max);
    for ((name, inwards), finger) in [("left_finger", 1), ("right_finger", -1)].into_iter().zip(&fingers) {
        text += &body(name, finger, hand.finger_mass_kg);
        text += &format!(
            "  <joint name=\"{name}\" type=\"prismatic\">\n    <parent link=\"hand\"/>\n    <child link=\"{name}\"/>\n    \
             <axis xyz=\"0 {inwards} 0\"/>\n    <limit lower=\"0\" upper=\"{}\" effort=\"{}\" velocity=\"{}\"/>\n  </joint>\n",
            0.5 * hand.opening_m_max,
            hand.finger_force_n,
            hand.closing_speed_m_s
        );
    }
    robot("hand", &text)
}
