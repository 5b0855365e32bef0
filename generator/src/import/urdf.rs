//! Robot descriptions (URDF) as rigid objects: the collision geometry of all links, at zero joint angles, as one mesh.
//!
//! A link without collision geometry has its visual one. The mass is the sum of the links' masses.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glamx::{DMat3, DVec3};
use program::Failure;
use schema::ShapeKind;

use super::xml::{self, Described, Element, Placed, Shape, Shapes};
use crate::mesh_file::damaged;

/// Links in a chain, at most.
const CHAIN_MAX: usize = 1_000;

/// The pose in the child `origin`.
fn origin_of(element: &Element) -> Result<Placed, String> {
    let Some(origin) = element.child("origin") else { return Ok(Placed::HERE) };
    let [roll, pitch, yaw] = origin.numbers("rpy", Some([0.0; 3]))?;
    let turn = DMat3::from_rotation_z(yaw) * DMat3::from_rotation_y(pitch) * DMat3::from_rotation_x(roll);
    Ok(Placed { turn, at_m: DVec3::from_array(origin.numbers("xyz", Some([0.0; 3]))?) })
}

/// The meshes that a description names, as far as it can be read.
pub(super) fn meshes_of(file: &Path) -> Vec<PathBuf> {
    fn collect(element: &Element, file: &Path, found: &mut Vec<PathBuf>) {
        let name = if element.name == "mesh" { element.attribute("filename") } else { None };
        found.extend(name.map(|name| resolved(name, file)));
        element.children.iter().for_each(|child| collect(child, file, found));
    }
    let mut found = Vec::new();
    if let Ok(robot) = xml::read(file, "URDF", &["robot"]) {
        collect(&robot, file, &mut found);
    }
    found
}

/// Reads a description and the meshes that it names. One unit of a mesh is `scale_m` metres, besides the description's
/// own scale.
pub(super) fn described(file: &Path, scale_m: f64) -> Result<Described, Failure> {
    body_of(&xml::read(file, "URDF", &["robot"])?, file, scale_m)
}

/// The same of a description's outermost element.
pub(super) fn body_of(robot: &Element, file: &Path, scale_m: f64) -> Result<Described, Failure> {
    let damaged = |message: String| damaged(&format!("not a whole URDF file: {message}"), file);
    let mut shapes = Shapes::default();
    let mut mass_kg = 0.0;
    let mut poses = Poses::of(robot);
    for link in robot.children("link") {
        let at = poses.at(link.attribute("name"), 0).map_err(damaged)?;
        if let Some(mass) = link.child("inertial").and_then(|inertial| inertial.child("mass")) {
            mass_kg += mass.mass_kg("value").map_err(damaged)?;
        }
        let kind = if link.child("collision").is_some() { "collision" } else { "visual" };
        for shape in link.children(kind) {
            let surface = shape_of(shape, file, scale_m, &mut shapes, damaged)?;
            shapes.add(at.then(origin_of(shape).map_err(damaged)?), surface).map_err(damaged)?;
        }
    }
    shapes.body(mass_kg, file)
}

fn shape_of(
    shape: &Element,
    file: &Path,
    scale_m: f64,
    shapes: &mut Shapes,
    damaged: impl Fn(String) -> Failure,
) -> Result<Shape, Failure> {
    let geometry = shape.child("geometry").and_then(|geometry| geometry.children.first());
    let Some(geometry) = geometry else { return Err(damaged(format!("{} must have a geometry", shape.name))) };
    let number = |key| geometry.numbers::<1>(key, None).map_err(&damaged).map(|[number]| number);
    let solid = match geometry.name.as_str() {
        "mesh" => {
            let name = geometry.attribute("filename").ok_or_else(|| damaged("mesh must have filename".to_owned()))?;
            let scale = DVec3::from_array(geometry.numbers("scale", Some([1.0; 3])).map_err(&damaged)?) * scale_m;
            return shapes.mesh(&resolved(name, file), scale, file);
        }
        "box" => xml::solid(ShapeKind::Cuboid, geometry.numbers("size", None).map_err(&damaged)?),
        "cylinder" => {
            let (radius, length) = (number("radius")?, number("length")?);
            xml::solid(ShapeKind::Cylinder, [2.0 * radius, 2.0 * radius, length])
        }
        "sphere" => shapes.round([2.0 * number("radius")?; 3], 0.0),
        other => return Err(damaged(format!("geometry must be mesh, box, cylinder or sphere, got {other}"))),
    };
    solid.map_err(damaged)
}

/// The poses of links in the frame of the first one, with all joints at zero.
struct Poses<'a> {
    /// Of a link, the joint that moves it and the link that this joint is at.
    joints: BTreeMap<&'a str, (&'a Element, Option<&'a str>)>,
    known: BTreeMap<&'a str, Placed>,
}

impl<'a> Poses<'a> {
    fn of(robot: &'a Element) -> Self {
        let mut joints = BTreeMap::new();
        for joint in robot.children("joint") {
            let end = |end| joint.child(end).and_then(|of| of.attribute("link"));
            if let Some(child) = end("child") {
                joints.entry(child).or_insert((joint, end("parent")));
            }
        }
        Self { joints, known: BTreeMap::new() }
    }

    fn at(&mut self, name: Option<&'a str>, depth: usize) -> Result<Placed, String> {
        let Some((name, (joint, parent))) = name.and_then(|name| Some((name, *self.joints.get(name)?))) else {
            return Ok(Placed::HERE);
        };
        if let Some(pose) = self.known.get(name) {
            return Ok(*pose);
        }
        if depth >= CHAIN_MAX {
            return Err(format!("its joints must be a tree of at most {CHAIN_MAX} links in a chain"));
        }
        let pose = self.at(parent, depth + 1)?.then(origin_of(joint)?);
        self.known.insert(name, pose);
        Ok(pose)
    }
}

/// The file that a description names. A package is looked for in the folders above.
fn resolved(name: &str, file: &Path) -> PathBuf {
    let folder = file.parent().unwrap_or(Path::new(""));
    let Some(in_package) = name.strip_prefix("package://") else {
        return folder.join(name.strip_prefix("file://").unwrap_or(name));
    };
    let path = Path::new(in_package);
    let inside = path.components().skip(1).collect::<PathBuf>();
    let places = folder.ancestors().flat_map(|above| [above.join(path), above.join(&inside)]);
    places.into_iter().find(|place| place.is_file()).unwrap_or_else(|| folder.join(inside))
}
