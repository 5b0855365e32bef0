//! Robot descriptions (URDF) as rigid objects: the collision geometry of all links, at zero joint angles, as one mesh.
//!
//! A link without collision geometry has its visual one. The mass is the sum of the links' masses.

use std::path::{Path, PathBuf};

use glamx::{DMat3, DVec3};
use program::{Context as _, Failure};
use quick_xml::events::{BytesStart, Event};
use schema::{Polyhedron, ShapeKind, Solid, Vec3};

use crate::catalogue::ellipsoid;
use crate::mesh::Mesh;
use crate::mesh_file::{BYTES_MAX, Parts, damaged, read_parts, unusable};

/// A body that a description describes.
pub(super) struct Described {
    pub(super) mesh: Mesh,
    pub(super) mass_kg: Option<f64>,
}

/// An element of an XML file.
struct Element {
    name: String,
    attributes: Vec<(String, String)>,
    children: Vec<Element>,
}

/// A rotation, then a translation in metres.
#[derive(Clone, Copy)]
struct Placed {
    turn: DMat3,
    at_m: DVec3,
}

impl Placed {
    const HERE: Self = Self { turn: DMat3::IDENTITY, at_m: DVec3::ZERO };

    fn then(self, inner: Self) -> Self {
        Self { turn: self.turn * inner.turn, at_m: self.at_m + self.turn * inner.at_m }
    }
}

/// Links in a chain, at most.
const CHAIN_MAX: usize = 1_000;

impl Element {
    fn children<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Self> {
        self.children.iter().filter(move |child| child.name == name)
    }

    fn child(&self, name: &str) -> Option<&Self> {
        self.children.iter().find(|child| child.name == name)
    }

    fn attribute(&self, key: &str) -> Option<&str> {
        self.attributes.iter().find(|(name, _)| name == key).map(|(_, value)| value.as_str())
    }

    /// The numbers of an attribute, or `otherwise` if there is none.
    fn numbers<const N: usize>(&self, key: &str, otherwise: Option<[f64; N]>) -> Result<[f64; N], String> {
        let name = &self.name;
        let Some(text) = self.attribute(key) else {
            return otherwise.ok_or_else(|| format!("{name} must have {key}"));
        };
        let numbers: Option<Vec<f64>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
        numbers
            .and_then(|numbers| numbers.try_into().ok())
            .filter(|numbers: &[f64; N]| numbers.iter().all(|number| number.is_finite()))
            .ok_or_else(|| format!("{key} of {name} must be {N} numbers, got {text:?}"))
    }

    /// The pose in the child `origin`.
    fn origin(&self) -> Result<Placed, String> {
        let Some(origin) = self.child("origin") else { return Ok(Placed::HERE) };
        let [roll, pitch, yaw] = origin.numbers("rpy", Some([0.0; 3]))?.map(libm::sincos);
        let about_x = DMat3::from_cols(DVec3::X, DVec3::new(0.0, roll.1, roll.0), DVec3::new(0.0, -roll.0, roll.1));
        let about_y = DMat3::from_cols(DVec3::new(pitch.1, 0.0, -pitch.0), DVec3::Y, DVec3::new(pitch.0, 0.0, pitch.1));
        let about_z = DMat3::from_cols(DVec3::new(yaw.1, yaw.0, 0.0), DVec3::new(-yaw.0, yaw.1, 0.0), DVec3::Z);
        let at_m = DVec3::from_array(origin.numbers("xyz", Some([0.0; 3]))?);
        Ok(Placed { turn: about_z * about_y * about_x, at_m })
    }
}

/// The meshes that a description names, as far as it can be read.
pub(super) fn meshes_of(file: &Path) -> Vec<PathBuf> {
    fn collect(element: &Element, file: &Path, found: &mut Vec<PathBuf>) {
        let name = if element.name == "mesh" { element.attribute("filename") } else { None };
        found.extend(name.map(|name| resolved(name, file)));
        element.children.iter().for_each(|child| collect(child, file, found));
    }
    let mut found = Vec::new();
    if let Ok(robot) = read(file) {
        collect(&robot, file, &mut found);
    }
    found
}

/// Reads a description and the meshes that it names. One unit of a mesh is `scale_m` metres, besides the description's
/// own scale.
pub(super) fn described(file: &Path, scale_m: f64) -> Result<Described, Failure> {
    let robot = read(file)?;
    let damaged = |message: String| damaged(&format!("not a whole URDF file: {message}"), file);
    let mut body: Parts = (Vec::new(), Vec::new());
    let mut mass_kg = 0.0;
    for link in robot.children("link") {
        let at = pose_of(&robot, link).map_err(damaged)?;
        if let Some(mass) = link.child("inertial").and_then(|inertial| inertial.child("mass")) {
            mass_kg += mass.numbers::<1>("value", None).map_err(damaged)?[0];
        }
        let kind = if link.child("collision").is_some() { "collision" } else { "visual" };
        for shape in link.children(kind) {
            let (corners, triangles) = shape_of(shape, file, scale_m, damaged)?;
            let at = at.then(shape.origin().map_err(damaged)?);
            let first = body.0.len() as u32; // files have less than a gigabyte
            body.0.extend(corners.into_iter().map(|corner| (at.turn * corner + at.at_m).to_array()));
            body.1.extend(triangles.into_iter().map(|triangle| triangle.map(|corner| first.saturating_add(corner))));
        }
    }
    let mesh = Mesh::new(&body.0, &body.1, 1.0).map_err(|message| self::damaged(&message, file))?;
    Ok(Described { mesh, mass_kg: (mass_kg > 0.0).then_some(mass_kg) })
}

/// Corners in metres in the shape's own frame, and triangles.
fn shape_of(
    shape: &Element,
    file: &Path,
    scale_m: f64,
    damaged: impl Fn(String) -> Failure,
) -> Result<(Vec<DVec3>, Vec<[u32; 3]>), Failure> {
    let geometry = shape.child("geometry").and_then(|geometry| geometry.children.first());
    let Some(geometry) = geometry else { return Err(damaged(format!("{} must have a geometry", shape.name))) };
    let solid = |kind, size: [f64; 3]| {
        let solid = Solid::new(kind, DVec3::from_array(size).as_vec3()).map_err(|e| damaged(e.to_string()))?;
        Ok::<_, Failure>(Polyhedron::from(&solid))
    };
    let number = |key| geometry.numbers::<1>(key, None).map_err(&damaged).map(|[number]| number);
    let polyhedron = match geometry.name.as_str() {
        "mesh" => {
            let name = geometry.attribute("filename").ok_or_else(|| damaged("mesh must have filename".to_owned()))?;
            let scale = DVec3::from_array(geometry.numbers("scale", Some([1.0; 3])).map_err(&damaged)?) * scale_m;
            let (corners, mut triangles) =
                read_parts(&resolved(name, file)).context(format_args!("a mesh of {}", file.display()))?;
            if scale.x * scale.y * scale.z < 0.0 {
                triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2)); // a mirrored mesh
            }
            return Ok((corners.into_iter().map(|corner| DVec3::from_array(corner) * scale).collect(), triangles));
        }
        "box" => solid(ShapeKind::Cuboid, geometry.numbers("size", None).map_err(&damaged)?)?,
        "cylinder" => {
            let (radius, length) = (number("radius")?, number("length")?);
            solid(ShapeKind::Cylinder, [2.0 * radius, 2.0 * radius, length])?
        }
        "sphere" => {
            let size_m = Vec3::splat(2.0 * number("radius")? as f32);
            Polyhedron::hull_of(&ellipsoid(size_m)).map_err(|e| damaged(e.to_string()))?
        }
        other => return Err(damaged(format!("geometry must be mesh, box, cylinder or sphere, got {other}"))),
    };
    let triangles = polyhedron.triangles().into_iter().map(|triangle| triangle.map(|corner| corner as u32)).collect();
    Ok((polyhedron.corners_m().iter().map(|corner| corner.as_dvec3()).collect(), triangles))
}

/// The pose of a link in the frame of the first one, with all joints at zero.
fn pose_of(robot: &Element, link: &Element) -> Result<Placed, String> {
    let mut name = link.attribute("name");
    let mut pose = Placed::HERE;
    let end = |joint: &Element, end: &str| joint.child(end).and_then(|of| of.attribute("link").map(str::to_owned));
    let mut parent;
    for _ in 0..CHAIN_MAX {
        let Some(joint) = robot.children("joint").find(|joint| end(joint, "child").as_deref() == name) else {
            return Ok(pose);
        };
        pose = joint.origin()?.then(pose);
        parent = end(joint, "parent");
        name = parent.as_deref();
    }
    Err(format!("its joints must be a tree of at most {CHAIN_MAX} links in a chain"))
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

/// The outermost element of a file.
fn read(file: &Path) -> Result<Element, Failure> {
    let bytes = program::read(file, BYTES_MAX)
        .map_err(|error| unusable(format!("failed to read it: {error}: {}", file.display())))?;
    let damaged = |message: &str| damaged(&format!("not a whole URDF file: {message}"), file);
    let text = str::from_utf8(&bytes).map_err(|error| damaged(&error.to_string()))?;
    let mut reader = quick_xml::Reader::from_str(text);
    // Elements that are open; the outermost stands for the file.
    let mut open = vec![Element { name: String::new(), attributes: Vec::new(), children: Vec::new() }];
    loop {
        match reader.read_event().map_err(|error| damaged(&error.to_string()))? {
            Event::Start(start) => open.push(element(&start).map_err(|error| damaged(&error))?),
            Event::Empty(start) => {
                let element = element(&start).map_err(|error| damaged(&error))?;
                open.last_mut().ok_or_else(|| damaged("an end without a start"))?.children.push(element);
            }
            Event::End(_) => {
                let last = open.pop().ok_or_else(|| damaged("an end without a start"))?;
                open.last_mut().ok_or_else(|| damaged("an end without a start"))?.children.push(last);
            }
            Event::Eof => break,
            _ => {}
        }
    }
    let is_closed = open.len() == 1;
    let robot = open.into_iter().next().and_then(|file| file.children.into_iter().find(|child| child.name == "robot"));
    robot.filter(|_| is_closed).ok_or_else(|| damaged("it must have an element robot, with its end"))
}

fn element(start: &BytesStart<'_>) -> Result<Element, String> {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let mut attributes = Vec::new();
    for attribute in start.attributes() {
        let attribute = attribute.map_err(|error| error.to_string())?;
        let raw = text(&attribute.value);
        let value = quick_xml::escape::unescape(&raw).map_err(|error| error.to_string())?.into_owned();
        attributes.push((text(attribute.key.as_ref()), value));
    }
    Ok(Element { name: text(start.name().as_ref()), attributes, children: Vec::new() })
}
