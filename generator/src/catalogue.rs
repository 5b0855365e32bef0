//! Objects from a file: rigid bodies of convex parts with mass and friction, and sets of objects for a scene.
//!
//! `configs/objects/everyday.toml` explains the keys; docs/everyday-objects.md the origin of its sizes. Datasets and
//! experiments read the same files; [`crate::import_objects`] writes them from meshes.

use std::f64::consts::{PI, TAU};
use std::fmt::Write as _;
use std::io::{self, ErrorKind};
use std::path::Path;
use std::sync::Arc;

use schema::{Pose, ShapeKind, Solid, TriangleMesh, Vec3, axis_angle, pose_from_parts};
use serde::Deserialize;
use simulator::{Body, Part, PartShape, convex_hull};

use crate::mesh_file::BYTES_MAX;

/// The built-in catalogues, as they lie in `configs/objects`: as text, or compressed by zstd.
const BUILT_IN: [(&str, &[u8]); 3] = [
    ("everyday", include_bytes!("../../configs/objects/everyday.toml")),
    ("household-train", include_bytes!("../../configs/objects/household-train.toml.zst")),
    ("household-held-out", include_bytes!("../../configs/objects/household-held-out.toml.zst")),
];
/// Of every file that zstd compressed.
const ZSTD_START: &[u8] = &[0x28, 0xb5, 0x2f, 0xfd];

/// The text of a built-in catalogue; `None` if there is none of that name.
#[must_use]
pub fn built_in(name: &str) -> Option<String> {
    let (_, bytes) = BUILT_IN.into_iter().find(|(own, _)| *own == name)?;
    let text = if bytes.starts_with(ZSTD_START) { zstd::decode_all(bytes).ok()? } else { bytes.to_vec() };
    String::from_utf8(text).ok()
}

/// The names of the built-in catalogues, as text.
pub(crate) fn built_in_names() -> String {
    BUILT_IN.map(|(name, _)| format!("`{name}`")).join(", ")
}

/// Smallest and largest mass.
pub(crate) const MASS_KG: [f32; 2] = [1e-4, 100.0];

/// Number of points on an ellipsoid.
const ELLIPSOID_POINTS: usize = 60;

/// A catalogue of objects.
#[derive(Debug, Clone, PartialEq)]
pub struct Catalogue {
    things: Vec<CatalogueObject>,
    sets: Vec<(String, Vec<usize>)>,
}

/// An object of a catalogue.
#[derive(Debug, Clone, PartialEq)]
pub struct CatalogueObject {
    /// Its shape, with its name.
    pub body: Body,
    /// Mass in kilograms.
    pub mass_kg: f32,
    /// Coulomb friction coefficient.
    pub friction: f32,
    /// The origin of the body's frame in the frame of the catalogue's numbers, which has the same axes.
    pub origin_m: Vec3,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Raw {
    object: Vec<RawObject>,
    #[serde(default)]
    set: Vec<RawSet>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawObject {
    name: String,
    mass_kg: f32,
    friction: f32,
    #[serde(rename = "source")]
    _source: String,
    mesh: Option<TriangleMesh>,
    part: Vec<RawPart>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawPart {
    shape: String,
    size_m: Option<[f32; 3]>,
    corners_m: Option<Vec<[f32; 3]>>,
    at_m: [f32; 3],
    turn_deg: [f32; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawSet {
    name: String,
    objects: Vec<String>,
}

impl Catalogue {
    /// A built-in catalogue, or else a file by its path relative to `folder`.
    ///
    /// # Errors
    /// A message with everything that is wrong.
    pub fn named(name: &str, folder: &Path) -> Result<Self, String> {
        built_in(name).map_or_else(|| Self::read(&folder.join(name)), |text| Self::parse(&text, Path::new(name)))
    }

    /// Reads a file.
    ///
    /// # Errors
    /// A message with everything that is wrong.
    pub fn read(path: &Path) -> Result<Self, String> {
        let unread = |error| format!("failed to read the objects: {error}: {}", path.display());
        let text = |bytes| String::from_utf8(bytes).map_err(|error| io::Error::new(ErrorKind::InvalidData, error));
        Self::parse(&program::read(path, BYTES_MAX).and_then(text).map_err(unread)?, path)
    }

    /// Parses a catalogue; `path` is for messages.
    ///
    /// # Errors
    /// A message with everything that is wrong.
    pub fn parse(text: &str, path: &Path) -> Result<Self, String> {
        let raw: Raw = toml::from_str(text).map_err(|e| format!("{e}: {}", path.display()))?;
        let mut problems = Vec::new();
        let mut things: Vec<CatalogueObject> = Vec::new();
        for object in &raw.object {
            if things.iter().any(|thing| thing.body.name() == object.name) {
                problems.push(format!("{}: there is another object of that name", object.name));
            }
            match thing(object) {
                Ok(thing) => things.push(thing),
                Err(problem) => problems.push(format!("{}: {problem}", object.name)),
            }
        }
        let number = |name: &String| things.iter().position(|thing| thing.body.name() == name);
        let mut sets = Vec::new();
        for RawSet { name, objects } in &raw.set {
            let missing = objects.iter().filter(|name| number(name).is_none());
            problems.extend(missing.map(|missing| format!("set {name}: there is no object {missing}")));
            if number(name).is_some() || sets.iter().any(|(other, _)| other == name) || objects.is_empty() {
                problems.push(format!("set {name}: a set must have a unique name and at least one object"));
            }
            sets.push((name.clone(), objects.iter().filter_map(number).collect()));
        }
        if problems.is_empty() {
            return Ok(Self { things, sets });
        }
        let (count, plural) = (problems.len(), if problems.len() == 1 { "" } else { "s" });
        Err(format!("{count} problem{plural} in the objects {}:\n  {}", path.display(), problems.join("\n  ")))
    }

    /// All objects, in the file's order.
    #[must_use]
    pub fn objects(&self) -> &[CatalogueObject] {
        &self.things
    }

    /// The objects of a set, or the object of that name; `None` if there is neither.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<Vec<&CatalogueObject>> {
        let set = self.sets.iter().find(|(set, _)| set == name);
        let of_set = set.map(|(_, numbers)| numbers.iter().map(|number| &self.things[*number]).collect());
        of_set.or_else(|| self.things.iter().find(|thing| thing.body.name() == name).map(|thing| vec![thing]))
    }

    /// The names of all sets and objects.
    #[must_use]
    pub fn names(&self) -> Vec<&str> {
        self.things
            .iter()
            .map(|thing| thing.body.name())
            .chain(self.sets.iter().map(|(name, _)| name.as_str()))
            .collect()
    }
}

fn thing(object: &RawObject) -> Result<CatalogueObject, String> {
    for (key, value, low, high) in
        [("mass_kg", object.mass_kg, MASS_KG[0], MASS_KG[1]), ("friction", object.friction, 0.0, 5.0)]
    {
        if !(low..=high).contains(&value) {
            return Err(format!("{key} must be between {low} and {high}, got {value}"));
        }
    }
    let part = |(number, raw): (usize, &RawPart)| part(raw).map_err(|problem| format!("part {number}: {problem}"));
    let parts = object.part.iter().enumerate().map(part).collect::<Result<Vec<_>, _>>()?;
    let first_m = parts.first().map_or(Vec3::ZERO, |part| part.object_from_part.translation);
    let body = Body::of_parts(object.name.clone(), parts).map_err(|e| e.to_string())?;
    let origin_m = first_m - body.parts()[0].object_from_part.translation;
    let mesh = object.mesh.as_ref().map(|mesh| Arc::new(mesh.moved(-origin_m)));
    let body = body.with_mesh(mesh);
    Ok(CatalogueObject { body, mass_kg: object.mass_kg, friction: object.friction, origin_m })
}

fn part(raw: &RawPart) -> Result<Part, String> {
    let size_m = || raw.size_m.map(Vec3::from_array).ok_or_else(|| format!("a {} needs size_m", raw.shape));
    let hull = |points_m: &[Vec3]| convex_hull(points_m).map(PartShape::Hull).map_err(|e| e.to_string());
    let shape = match raw.shape.as_str() {
        "hull" => {
            let corners_m = raw.corners_m.as_ref().ok_or("a hull needs corners_m")?;
            hull(&corners_m.iter().copied().map(Vec3::from_array).collect::<Vec<_>>())?
        }
        "ellipsoid" => hull(&ellipsoid(size_m()?))?,
        name => {
            let kinds = ShapeKind::ALL.map(ShapeKind::name).join(", ");
            let kind = ShapeKind::from_name(name)
                .ok_or_else(|| format!("shape must be one of {kinds}, hull, ellipsoid, got {name}"))?;
            PartShape::Solid(Solid::new(kind, size_m()?)?)
        }
    };
    let turned = |axis: Vec3| axis_angle(axis, Vec3::from_array(raw.turn_deg).dot(axis).to_radians());
    let rotation = (turned(Vec3::Z) * turned(Vec3::Y) * turned(Vec3::X)).normalize();
    let object_from_part: Pose = pose_from_parts(rotation, Vec3::from_array(raw.at_m));
    Ok(Part { shape, object_from_part })
}

/// Points spread evenly over an ellipsoid with these axes: a spiral from pole to pole (Fibonacci lattice), plus both
/// poles and the four ends of the other axes, so that its lengths are exact.
pub(crate) fn ellipsoid(size_m: Vec3) -> Vec<Vec3> {
    let golden = TAU * (1.0 - 1.0 / ((1.0 + 5.0_f64.sqrt()) / 2.0));
    let spiral = (0..ELLIPSOID_POINTS).map(|number| {
        let z = 1.0 - (2.0 * number as f64 + 1.0) / ELLIPSOID_POINTS as f64;
        let (sin, cos) = libm::sincos((golden * number as f64) % (2.0 * PI));
        let across = (1.0 - z * z).sqrt();
        Vec3::new((across * cos) as f32, (across * sin) as f32, z as f32)
    });
    let ends = [Vec3::X, Vec3::Y, Vec3::Z].into_iter().flat_map(|axis| [axis, -axis]);
    spiral.chain(ends).map(|point| 0.5 * size_m * point).collect()
}

/// An object of hulls as an entry of a catalogue, with what cameras see if it is a mesh; corners of hulls, in metres,
/// have at most so many decimals.
#[must_use]
pub fn object_text<'a>(
    name: &str,
    mass_kg: f64,
    friction: f32,
    source: String,
    mesh: Option<&TriangleMesh>,
    parts: impl Iterator<Item = &'a [Vec3]>,
    decimals: usize,
) -> String {
    let mut text = String::new();
    let (mass_kg, source) = ((mass_kg * 1e6).round() / 1e6, toml::Value::String(source));
    // Writing to a String cannot fail, here and below.
    let _ = write!(
        text,
        "\n[[object]]\nname = \"{name}\"\nmass_kg = {mass_kg:?}\nfriction = {friction:?}\nsource = {source}\n"
    );
    if let Some(mesh) = mesh.and_then(|mesh| toml::to_string(mesh).ok()) {
        let _ = write!(text, "\n[object.mesh]\n{mesh}");
    }
    for corners_m in parts {
        text +=
            "\n[[object.part]]\nshape = \"hull\"\nat_m = [0.0, 0.0, 0.0]\nturn_deg = [0.0, 0.0, 0.0]\ncorners_m = [\n";
        for corner_m in corners_m {
            let [x, y, z] = corner_m.to_array().map(|metres| decimal(metres, decimals));
            let _ = writeln!(text, "    [{x}, {y}, {z}],");
        }
        text += "]\n";
    }
    text
}

/// A length with as many decimals as it needs, at least one.
fn decimal(metres: f32, decimals: usize) -> String {
    let text = format!("{metres:.decimals$}");
    let short = text.trim_end_matches('0');
    let short = if short.ends_with('.') { format!("{short}0") } else { short.to_owned() };
    if short == "-0.0" { "0.0".to_owned() } else { short }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    const ONE: &str = r#"
        [[object]]
        name = "mallet"
        mass_kg = 0.2
        friction = 0.9
        source = "a test"
        [[object.part]]
        shape = "cylinder"
        size_m = [0.02, 0.02, 0.1]
        at_m = [0.0, 0.0, 0.05]
        turn_deg = [0.0, 0.0, 0.0]
        [[object.part]]
        shape = "cuboid"
        size_m = [0.08, 0.03, 0.04]
        at_m = [0.0, 0.0, 0.12]
        turn_deg = [0.0, 0.0, 90.0]
        [[set]]
        name = "two"
        objects = ["mallet", "mallet"]
    "#;

    fn problems_of(text: &str) -> Vec<String> {
        let error = Catalogue::parse(text, Path::new("objects.toml")).unwrap_err();
        error.lines().skip(1).map(|line| line.trim().to_owned()).collect()
    }

    #[test]
    fn parts_are_placed_as_the_file_says() {
        let catalogue = Catalogue::parse(ONE, Path::new("objects.toml")).unwrap();
        let body = &catalogue.find("mallet").unwrap()[0].body;
        // A quarter turn about z: the head is 80 mm long along y.
        assert!((body.extents_m() - Vec3::new(0.03, 0.08, 0.14)).length() < 1e-6, "{}", body.extents_m());
        let head = Vec3::new(0.0, 0.039, 0.05);
        assert!(body.distance_outside_m(head) < 0.0 && body.distance_outside_m(-head) > 0.0);
        assert_eq!(catalogue.find("two").unwrap().len(), 2);
        assert!(catalogue.find("three").is_none());
    }

    /// Cameras see the mesh where the file has it, whatever the parts' middle is.
    #[test]
    fn a_mesh_lies_where_the_file_says_and_is_written_as_it_is_read() {
        let corners_m = [Vec3::ZERO, Vec3::new(0.04, 0.0, 0.0), Vec3::new(0.0, 0.04, 0.0), Vec3::new(0.0, 0.0, 0.06)];
        let mesh = TriangleMesh::new(&corners_m, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]).unwrap();
        let source = "a test".to_owned();
        let text = object_text("wedge", 0.1, 0.5, source, Some(&mesh), [&corners_m[..]].into_iter(), 7);
        let catalogue = Catalogue::parse(&text, Path::new("objects.toml")).unwrap();
        let thing = &catalogue.objects()[0];
        assert_eq!(thing.origin_m, Vec3::new(0.02, 0.02, 0.03));
        let [found, parts] = [thing.body.mesh().unwrap().corners_m(), thing.body.polyhedra()[0].corners_m()];
        for corner_m in corners_m {
            let is_there = |of: &[Vec3]| of.iter().any(|m| (*m + thing.origin_m - corner_m).length() < 2e-7);
            assert!(is_there(found) && is_there(parts), "{corner_m}: {found:?}, {parts:?}");
        }
        let broken = text.replace("1 2 3\"", "1 2 4\"");
        let told = Catalogue::parse(&broken, Path::new("objects.toml")).unwrap_err();
        assert!(told.contains("a mesh's triangles must name its 4 corners from 0, got 4"), "{told}");
    }

    #[test]
    fn everything_that_is_wrong_is_reported() {
        let text = ONE.replace("mass_kg = 0.2", "mass_kg = 0.0").replace("\"mallet\", \"mallet\"", "\"maul\"");
        let problems = problems_of(&text);
        assert!(problems[0].starts_with("mallet: mass_kg"), "{problems:?}");
        assert!(problems[1].starts_with("set two:") && problems[1].contains("maul"), "{problems:?}");
        let problems = problems_of(&ONE.replace("\"cylinder\"", "\"pipe\""));
        assert!(problems[0].starts_with("mallet: part 0: shape"), "{problems:?}");
        assert!(Catalogue::parse("object = 1", Path::new("objects.toml")).is_err());
    }

    #[test]
    fn the_shipped_objects_are_the_papers_eleven_and_a_cylinder() {
        let catalogue = Catalogue::named("everyday", Path::new("")).unwrap();
        assert_eq!(catalogue.things.len(), 12);
        assert_eq!(catalogue.sets.iter().map(|(_, objects)| objects.len()).collect::<Vec<_>>(), [3, 5, 5, 5]);
        for thing in &catalogue.things {
            let (extents_m, density) = (thing.body.extents_m(), thing.mass_kg / thing.body.volume_m3());
            assert!(extents_m.max_element() < 0.2 && extents_m.min_element() > 0.01, "{}", thing.body.name());
            assert!((50.0..2_000.0).contains(&density), "{}: {density} kg/m3", thing.body.name());
        }
    }

    #[test]
    fn the_household_objects_are_sound_and_of_a_size_for_grippers() {
        let [train, held_out] =
            ["household-train", "household-held-out"].map(|name| Catalogue::named(name, Path::new("")).unwrap().things);
        let kind = |thing: &CatalogueObject| thing.body.name().rsplit_once('_').unwrap().0.to_owned();
        let kinds = |things: &[CatalogueObject]| things.iter().map(kind).collect::<BTreeSet<_>>();
        assert_eq!((train.len(), held_out.len()), (920, 920));
        assert_eq!((kinds(&train).len(), kinds(&held_out).len()), (46, 23));
        assert!(kinds(&train).is_disjoint(&kinds(&held_out)));
        for thing in train.iter().chain(&held_out) {
            let (name, sides_m, parts) = (thing.body.name(), thing.body.extents_m(), thing.body.polyhedra().len());
            assert!((0.03..0.25).contains(&sides_m.max_element()), "{name}: {sides_m}");
            // What is wider has a wall that fingers reach around.
            assert!(sides_m.min_element() < 0.08 || parts > 10, "{name}: {sides_m}");
            assert!((0.004..1.0).contains(&thing.mass_kg), "{name}: {} kg", thing.mass_kg);
        }
    }

    #[test]
    fn an_ellipsoid_is_as_long_as_it_says_and_nearly_as_big() {
        let size_m = Vec3::new(0.04, 0.05, 0.06);
        let hull = convex_hull(&ellipsoid(size_m)).unwrap();
        let exact = core::f32::consts::PI / 6.0 * size_m.x * size_m.y * size_m.z;
        assert!((0.9..1.0).contains(&(hull.volume_m3() / exact)), "{} of {exact}", hull.volume_m3());
        let low = hull.corners_m().iter().copied().reduce(Vec3::min).unwrap();
        assert!((low + 0.5 * size_m).length() < 1e-6);
    }
}
