//! What descriptions of bodies in XML have in common: elements with attributes, poses, and the shapes of a body as one
//! mesh.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glamx::{DMat3, DVec3};
use program::{Context as _, Failure};
use quick_xml::events::{BytesStart, Event};
use schema::{Polyhedron, ShapeKind, Solid, Vec3};

use crate::catalogue::ellipsoid;
use crate::mesh::Mesh;
use crate::mesh_file::{BYTES_MAX, Parts, append, damaged, read_parts, unusable};

/// Largest number: its square is a number, too.
const NUMBER_MAX: f64 = 1e30;
/// Elements within elements, at most; what is deeper is made to exhaust the stack.
const ELEMENTS_DEEP: usize = 1000;

/// A body that a description describes.
pub(super) struct Described {
    pub(super) mesh: Mesh,
    pub(super) mass_kg: Option<f64>,
}

/// An element of an XML file.
pub(super) struct Element {
    pub(super) name: String,
    attributes: Vec<(String, String)>,
    pub(super) children: Vec<Element>,
}

/// A rotation, then a translation in metres.
#[derive(Clone, Copy)]
pub(super) struct Placed {
    pub(super) turn: DMat3,
    pub(super) at_m: DVec3,
}

impl Placed {
    pub(super) const HERE: Self = Self { turn: DMat3::IDENTITY, at_m: DVec3::ZERO };

    pub(super) fn then(self, inner: Self) -> Self {
        Self { turn: self.turn * inner.turn, at_m: self.at_m + self.turn * inner.at_m }
    }
}

impl Element {
    pub(super) fn children<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Self> {
        self.children.iter().filter(move |child| child.name == name)
    }

    pub(super) fn child(&self, name: &str) -> Option<&Self> {
        self.children.iter().find(|child| child.name == name)
    }

    pub(super) fn attribute(&self, key: &str) -> Option<&str> {
        self.attributes.iter().find(|(name, _)| name == key).map(|(_, value)| value.as_str())
    }

    /// The numbers of an attribute, or `otherwise` if there is none.
    pub(super) fn numbers<const N: usize>(&self, key: &str, otherwise: Option<[f64; N]>) -> Result<[f64; N], String> {
        let name = &self.name;
        let Some(text) = self.attribute(key) else {
            return otherwise.ok_or_else(|| format!("{name} must have {key}"));
        };
        let numbers: Option<Vec<f64>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
        numbers
            .and_then(|numbers| numbers.try_into().ok())
            .filter(|numbers: &[f64; N]| numbers.iter().all(|number| number.abs() <= NUMBER_MAX))
            .ok_or_else(|| format!("{key} of {name} must be {N} numbers of at most {NUMBER_MAX:e}, got {text:?}"))
    }

    /// The mass in an attribute.
    pub(super) fn mass_kg(&self, key: &str) -> Result<f64, String> {
        let [mass_kg] = self.numbers(key, None)?;
        if mass_kg < 0.0 {
            return Err(format!("{key} of {} must be 0 or more, got {mass_kg}", self.name));
        }
        Ok(mass_kg)
    }
}

/// Corners in metres in a shape's own frame, and triangles.
pub(super) type Shape = (Vec<DVec3>, Vec<[u32; 3]>);

/// A primitive of these full lengths in metres, centred, a cylinder along z.
pub(super) fn solid(kind: ShapeKind, size_m: [f64; 3]) -> Result<Shape, String> {
    let solid = Solid::new(kind, DVec3::from_array(size_m).as_vec3()).map_err(|error| error.to_string())?;
    Ok(surface_of(&Polyhedron::from(&solid)))
}

fn surface_of(polyhedron: &Polyhedron) -> Shape {
    let triangles = polyhedron.triangles().into_iter().map(|triangle| triangle.map(|corner| corner as u32)).collect();
    (polyhedron.corners_m().iter().map(|corner| corner.as_dvec3()).collect(), triangles)
}

/// Shapes in one frame, and the meshes that were read for them.
#[derive(Default)]
pub(super) struct Shapes {
    parts: Parts,
    read: BTreeMap<PathBuf, Parts>,
    /// By the bits of lengths.
    round: BTreeMap<[u64; 4], Shape>,
}

impl Shapes {
    /// An ellipsoid of these full lengths in metres, its halves apart along z by `length_m`: a capsule.
    pub(super) fn round(&mut self, size_m: [f64; 3], length_m: f64) -> Result<Shape, String> {
        // Models repeat their shapes, thousands of times in made ones, and a hull takes its time.
        let [x, y, z] = size_m;
        let key = [x, y, z, length_m].map(f64::to_bits);
        if let Some(shape) = self.round.get(&key) {
            return Ok(shape.clone());
        }
        let points = ellipsoid(DVec3::from_array(size_m).as_vec3());
        let apart = |point: Vec3| point + Vec3::Z * (0.5 * length_m as f32).copysign(point.z);
        let points: Vec<Vec3> = if length_m > 0.0 { points.into_iter().map(apart).collect() } else { points };
        let shape = surface_of(&Polyhedron::hull_of(&points).map_err(|error| error.to_string())?);
        self.round.insert(key, shape.clone());
        Ok(shape)
    }

    /// A mesh that a description names, one of its units being `scale_m` metres along each axis; turned over if it is
    /// mirrored.
    pub(super) fn mesh(&mut self, mesh: &Path, scale_m: DVec3, file: &Path) -> Result<Shape, Failure> {
        if !self.read.contains_key(mesh) {
            let parts = read_parts(mesh).context(format_args!("a mesh of {}", file.display()))?;
            self.read.insert(mesh.to_owned(), parts);
        }
        let (corners, triangles) = &self.read[mesh];
        let is_mirrored = scale_m.x * scale_m.y * scale_m.z < 0.0;
        let turned = |[a, b, c]: &[u32; 3]| if is_mirrored { [*a, *c, *b] } else { [*a, *b, *c] };
        let scaled = |corner: &[f64; 3]| DVec3::from_array(*corner) * scale_m;
        Ok((corners.iter().map(scaled).collect(), triangles.iter().map(turned).collect()))
    }

    /// Adds a shape.
    ///
    /// # Errors
    /// As [`append`].
    pub(super) fn add(&mut self, at: Placed, (corners, triangles): Shape) -> Result<(), String> {
        let placed = |corner: DVec3| (at.turn * corner + at.at_m).to_array();
        append(&mut self.parts, corners.into_iter().map(placed), triangles.into_iter())
    }

    /// The body; a mass of 0 is none.
    pub(super) fn body(self, mass_kg: f64, file: &Path) -> Result<Described, Failure> {
        let (corners, triangles) = self.parts;
        let mesh = Mesh::new(&corners, &triangles, 1.0).map_err(|message| damaged(&message, file))?;
        Ok(Described { mesh, mass_kg: (mass_kg > 0.0).then_some(mass_kg) })
    }
}

/// The outermost element of a file of this kind, which must be one of `roots`.
pub(super) fn read(file: &Path, kind: &str, roots: &[&str]) -> Result<Element, Failure> {
    let bytes = program::read(file, BYTES_MAX)
        .map_err(|error| unusable(format!("failed to read it: {error}: {}", file.display())))?;
    parse(&bytes, roots).map_err(|message| damaged(&format!("not a whole {kind} file: {message}"), file))
}

/// The same of its bytes.
pub(super) fn parse(bytes: &[u8], roots: &[&str]) -> Result<Element, String> {
    let text = str::from_utf8(bytes).map_err(|error| error.to_string())?;
    let mut reader = quick_xml::Reader::from_str(text);
    // Elements that are open; the outermost stands for the file.
    let mut open = vec![Element { name: String::new(), attributes: Vec::new(), children: Vec::new() }];
    loop {
        match reader.read_event().map_err(|error| error.to_string())? {
            Event::Start(_) if open.len() > ELEMENTS_DEEP => {
                return Err(format!("elements must be nested at most {ELEMENTS_DEEP} deep"));
            }
            Event::Start(start) => open.push(element(&start)?),
            Event::Empty(start) => {
                let element = element(&start)?;
                open.last_mut().ok_or("an end without a start")?.children.push(element);
            }
            Event::End(_) => {
                let last = open.pop().ok_or("an end without a start")?;
                open.last_mut().ok_or("an end without a start")?.children.push(last);
            }
            Event::Eof => break,
            _ => {}
        }
    }
    let is_closed = open.len() == 1;
    let is_root = |child: &Element| roots.contains(&child.name.as_str());
    let outermost = open.into_iter().next().and_then(|file| file.children.into_iter().find(is_root));
    let root = roots[0];
    outermost.filter(|_| is_closed).ok_or_else(|| format!("it must have an element {root}, with its end"))
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
