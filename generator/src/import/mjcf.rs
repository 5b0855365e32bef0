//! Models of MuJoCo (MJCF) as rigid objects: the colliding geoms of all bodies, at zero joint angles, as one mesh.
//!
//! If nothing collides, all geoms count. The mass is MuJoCo's: the sum of what the bodies' `inertial` say, or of their
//! geoms' masses and densities; planes and other geoms of the world itself are its surroundings, unless it has no
//! bodies. What is not followed is refused by name.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use glamx::{DMat3, DQuat, DVec3};
use program::Failure;
use schema::{MassIntegrals, ShapeKind};
use simulator::hull_volume_m3;

use super::xml::{self, Described, Element, Placed, Shape, Shapes};
use crate::mesh_file::damaged;

/// The outermost element of a model, and of a file that models include.
const ROOT: &str = "mujoco";
const PART: &str = "mujocoinclude";
/// Bodies, frames, classes or included files within each other, at most.
const DEPTH_MAX: usize = 100;
/// Most geoms of an object, and most bodies and frames, each as often as it is repeated.
const GEOMS_MAX: usize = 20_000;
/// What changes a shape's place or size in a way that is not followed.
const UNREAD: [&str; 4] = ["vertex", "refpos", "refquat", "shellinertia"];
/// What makes bodies in a way that is not followed.
const MAKERS: [&str; 4] = ["attach", "composite", "flexcomp", "flex"];
/// Unless its geoms or their classes say otherwise, in kg/m³.
const DENSITY_KG_M3: f64 = 1000.0;

/// Whether a file is such a model, as far as it can be read.
pub(super) fn is_model(file: &Path) -> bool {
    xml::read(file, "MJCF", &[ROOT]).is_ok()
}

/// The meshes that a model names, as far as it can be read.
pub(super) fn meshes_of(file: &Path) -> Vec<PathBuf> {
    let Ok(root) = read(file) else { return Vec::new() };
    let model = Model::new(file, &root);
    model.meshes.values().filter_map(|mesh| mesh.attribute("file")).map(|name| model.resolved(name)).collect()
}

/// Reads a model and the meshes that it names. One unit of a mesh is `scale_m` metres, besides the model's own scale.
pub(super) fn described(file: &Path, scale_m: f64) -> Result<Described, Failure> {
    body_of(&read(file)?, file, scale_m)
}

/// The same of a model's outermost element.
pub(super) fn body_of(root: &Element, file: &Path, scale_m: f64) -> Result<Described, Failure> {
    let model = Model::new(file, root);
    let damaged = |message: String| damaged(&format!("not a usable MJCF file: {message}"), file);
    let mut found = Found::default();
    let worlds = || root.children("worldbody");
    let is_all = !worlds().any(has_bodies);
    for world in worlds() {
        let within = Within { at: Placed::HERE, class: None, counts: is_all.then_some(true), depth: 0 };
        model.collect(world, within, &mut found).map_err(damaged)?;
    }
    let Found { geoms, mut mass_kg, .. } = found;
    let collides = geoms.iter().any(|geom| geom.collides);
    let mut shapes = Shapes::default();
    for geom in &geoms {
        let is_shown = geom.collides || !collides;
        if !is_shown && !geom.counts {
            continue;
        }
        let (at, shape, volume_m3) = model.placed_shape(geom, scale_m, &mut shapes, damaged)?;
        if geom.counts {
            mass_kg += model.mass_kg(geom, volume_m3).map_err(damaged)?;
        }
        if is_shown {
            shapes.add(at, shape).map_err(damaged)?;
        }
    }
    let [total_kg] = model.compiler_numbers("settotalmass", [-1.0]).map_err(damaged)?;
    shapes.body(if total_kg > 0.0 { total_kg } else { mass_kg }, file)
}

/// A model with all files that it includes.
fn read(file: &Path) -> Result<Element, Failure> {
    fn expand(
        element: &mut Element,
        of: [&Path; 2],
        depth: usize,
        seen: &mut BTreeSet<PathBuf>,
    ) -> Result<(), Failure> {
        let [main, file] = of;
        for mut child in std::mem::take(&mut element.children) {
            if child.name != "include" {
                expand(&mut child, of, depth, seen)?;
                element.children.push(child);
                continue;
            }
            let refused = |message: &str| damaged(&format!("not a usable MJCF file: {message}"), file);
            let name = child.attribute("file").ok_or_else(|| refused("include must have file"))?;
            let beside = |file: &Path| file.parent().unwrap_or(Path::new("")).join(name);
            let path = Some(beside(file)).filter(|path| path.is_file()).unwrap_or_else(|| beside(main));
            if depth >= DEPTH_MAX || !seen.insert(path.canonicalize().unwrap_or_else(|_| path.clone())) {
                return Err(refused(&format!("{name} is included twice")));
            }
            let mut included = xml::read(&path, "MJCF", &[PART, ROOT])?;
            expand(&mut included, [main, &path], depth + 1, seen)?;
            element.children.append(&mut included.children);
        }
        Ok(())
    }
    let mut root = xml::read(file, "MJCF", &[ROOT, PART])?;
    if root.name == PART {
        return Err(damaged("a part of a model: give the file that includes it", file));
    }
    expand(&mut root, [file, file], 0, &mut BTreeSet::new())?;
    Ok(root)
}

fn has_bodies(element: &Element) -> bool {
    element.children.iter().any(|child| child.name == "body" || (is_frame(child) && has_bodies(child)))
}

fn is_frame(element: &Element) -> bool {
    matches!(element.name.as_str(), "frame" | "replicate")
}

/// What says the mass of a body; it may stand in a frame.
fn inertial_of(body: &Element) -> Option<&Element> {
    body.children.iter().find_map(|child| match child.name.as_str() {
        "inertial" => Some(child),
        _ if is_frame(child) => inertial_of(child),
        _ => None,
    })
}

/// A model and where it was read.
struct Model<'a> {
    file: &'a Path,
    root: &'a Element,
    /// The defaults of classes, first the ones that count most; under no name those of all.
    defaults: BTreeMap<Option<&'a str>, Vec<&'a Element>>,
    meshes: BTreeMap<String, &'a Element>,
}

/// Where an element is, and how its geoms count.
#[derive(Clone, Copy)]
struct Within<'a> {
    at: Placed,
    class: Option<&'a str>,
    /// Whether masses of geoms count; nothing if the geoms do not.
    counts: Option<bool>,
    depth: usize,
}

/// What was found in bodies.
#[derive(Default)]
struct Found<'a> {
    geoms: Vec<Geom<'a>>,
    /// What bodies say of themselves.
    mass_kg: f64,
    visits: usize,
}

struct Geom<'a> {
    element: &'a Element,
    class: Option<&'a str>,
    body: Placed,
    collides: bool,
    /// Whether its mass is one of the object's.
    counts: bool,
}

impl<'a> Model<'a> {
    fn new(file: &'a Path, root: &'a Element) -> Self {
        let mut model = Self { file, root, defaults: BTreeMap::new(), meshes: BTreeMap::new() };
        // Of two that say the same, the later one counts.
        let mut main: Vec<&Element> = root.children("default").collect();
        main.reverse();
        for defaults in &main {
            model.classes(defaults, &main, 0);
        }
        model.defaults.insert(None, main);
        for mesh in root.children("asset").flat_map(|asset| asset.children("mesh")) {
            let stem = |file: &str| Path::new(file).file_stem().map(|stem| stem.to_string_lossy().into_owned());
            let name = mesh.attribute("name").map(str::to_owned).or_else(|| stem(mesh.attribute("file")?));
            model.meshes.entry(name.unwrap_or_default()).or_insert(mesh);
        }
        model
    }

    /// Adds the defaults of a class and of the classes in it.
    fn classes(&mut self, defaults: &'a Element, around: &[&'a Element], depth: usize) {
        if let Some(class) = defaults.attribute("class") {
            self.defaults.entry(Some(class)).or_insert_with(|| around.to_vec());
        }
        for inner in defaults.children("default").filter(|_| depth < DEPTH_MAX) {
            self.classes(inner, &[&[inner], around].concat(), depth + 1);
        }
    }

    fn compiler(&self, key: &str) -> Option<&'a str> {
        self.root.children("compiler").filter_map(|compiler| compiler.attribute(key)).last()
    }

    fn compiler_numbers<const N: usize>(&self, key: &str, otherwise: [f64; N]) -> Result<[f64; N], String> {
        let giver = self.root.children("compiler").filter(|compiler| compiler.attribute(key).is_some()).last();
        giver.map_or(Ok(otherwise), |compiler| compiler.numbers(key, None))
    }

    fn resolved(&self, name: &str) -> PathBuf {
        let folder = self.file.parent().unwrap_or(Path::new(""));
        let within = self.compiler("meshdir").or_else(|| self.compiler("assetdir")).unwrap_or("");
        let stripped = Path::new(name).file_name().filter(|_| self.compiler("strippath") == Some("true"));
        folder.join(within).join(stripped.map_or(Path::new(name), Path::new))
    }

    /// An element and its defaults, first the one that counts most: itself, its class, the classes around that, and the
    /// class of all.
    fn layers(&self, element: &'a Element, class: Option<&'a str>) -> Vec<&'a Element> {
        let class = element.attribute("class").or(class);
        let defaults = self.defaults.get(&class).unwrap_or(&self.defaults[&None]);
        let named = defaults.iter().flat_map(|defaults| defaults.children(&element.name));
        std::iter::once(element).chain(named).collect()
    }

    /// Adds the geoms and masses of a body, a frame or the world, and of what is in it.
    fn collect(&self, body: &'a Element, within: Within<'a>, found: &mut Found<'a>) -> Result<(), String> {
        let Within { at, class, counts, depth } = within;
        found.visits += 1;
        if depth > DEPTH_MAX || found.visits > GEOMS_MAX {
            return Err(format!("its bodies must be at most {GEOMS_MAX}, nested at most {DEPTH_MAX} deep"));
        }
        if let Some(maker) = body.children.iter().find(|child| MAKERS.contains(&child.name.as_str())) {
            return Err(format!(
                "{} is not followed: save the model as MuJoCo compiles it (mj_saveLastXML)",
                maker.name
            ));
        }
        let [first, last] = self.compiler_numbers("inertiagrouprange", [f64::NEG_INFINITY, f64::INFINITY])?;
        for geom in body.children("geom").filter(|_| counts.is_some()) {
            let layers = self.layers(geom, class);
            if value(&layers, "type") == Some("plane") {
                continue;
            }
            if found.geoms.len() >= GEOMS_MAX {
                return Err(format!("it must have at most {GEOMS_MAX} geoms"));
            }
            let number = |key, otherwise| numbers::<1>(&layers, key, Some([otherwise])).map(|[number]| number);
            let collides = number("contype", 1.0)? != 0.0 || number("conaffinity", 1.0)? != 0.0;
            let counts = counts == Some(true) && (first..=last).contains(&number("group", 0.0)?);
            found.geoms.push(Geom { element: geom, class, body: at, collides, counts });
        }
        for inner in body.children.iter().filter(|child| child.name == "body" || is_frame(child)) {
            let class = inner.attribute("childclass").or(class);
            let within = Within { class, depth: depth + 1, ..within };
            if inner.name == "replicate" {
                let [count] = inner.numbers("count", None)?;
                let offset_m = DVec3::from_array(inner.numbers("offset", Some([0.0; 3]))?);
                let euler = inner.numbers("euler", Some([0.0; 3]))?;
                // Angles are multiplied, offsets are along axes that are turned so far.
                let mut copy = Placed::HERE;
                for place in 0..count.clamp(0.0, GEOMS_MAX as f64) as usize {
                    copy.turn = self.turned_by(euler.map(|angle| angle * place as f64))?;
                    self.collect(inner, Within { at: at.then(copy), ..within }, found)?;
                    copy.at_m += copy.turn * offset_m;
                }
                continue;
            }
            let mut within = Within { at: at.then(self.pose_of(&[inner])?), ..within };
            if inner.name == "body" {
                let from_geoms = self.compiler("inertiafromgeom");
                let own = inertial_of(inner).filter(|_| from_geoms != Some("true"));
                found.mass_kg += own.map_or(Ok(0.0), |inertial| inertial.mass_kg("mass"))?;
                within.counts = Some(own.is_none() && from_geoms != Some("false"));
            }
            self.collect(inner, within, found)?;
        }
        Ok(())
    }

    /// What a geom of this volume weighs.
    fn mass_kg(&self, geom: &Geom<'a>, volume_m3: f64) -> Result<f64, String> {
        let layers = self.layers(geom.element, geom.class);
        if let Some(element) = giver(&layers, "mass") {
            return element.mass_kg("mass");
        }
        Ok(giver(&layers, "density").map_or(Ok(DENSITY_KG_M3), |element| element.mass_kg("density"))? * volume_m3)
    }

    /// Radians of an angle of one unit.
    fn angle_rad(&self) -> f64 {
        if self.compiler("angle") == Some("radian") { 1.0 } else { core::f64::consts::PI / 180.0 }
    }

    fn turned_by(&self, euler: [f64; 3]) -> Result<DMat3, String> {
        let order = self.compiler("eulerseq").unwrap_or("xyz");
        if order.len() != 3 || !order.chars().all(|axis| "xyzXYZ".contains(axis)) {
            return Err(format!("eulerseq must be three of x, y, z, X, Y, Z, got {order}"));
        }
        let about = |(axis, angle): (char, f64)| match axis {
            'x' | 'X' => DMat3::from_rotation_x(angle),
            'y' | 'Y' => DMat3::from_rotation_y(angle),
            _ => DMat3::from_rotation_z(angle),
        };
        let steps = order.chars().zip(euler.map(|angle| angle * self.angle_rad()));
        // About turned axes, or, in capitals, about those of the frame.
        Ok(steps.fold(
            DMat3::IDENTITY,
            |turn, step| {
                if step.0.is_lowercase() { turn * about(step) } else { about(step) * turn }
            },
        ))
    }

    /// The pose of an element, given with its defaults.
    fn pose_of(&self, layers: &[&Element]) -> Result<Placed, String> {
        if let Some(key) = UNREAD.into_iter().find(|key| value(layers, key).is_some()) {
            return Err(format!("{key} of {} is not followed", layers[0].name));
        }
        let at_m = DVec3::from_array(numbers(layers, "pos", Some([0.0; 3]))?);
        let turn = if value(layers, "euler").is_some() {
            self.turned_by(numbers(layers, "euler", None)?)?
        } else if value(layers, "xyaxes").is_some() {
            let [a, b, c, d, e, f] = numbers(layers, "xyaxes", None)?;
            let (x, y) = (DVec3::new(a, b, c).normalize_or_zero(), DVec3::new(d, e, f));
            let y = (y - x * x.dot(y)).try_normalize().filter(|_| x != DVec3::ZERO);
            let y = y.ok_or("xyaxes must be two axes that are not parallel")?;
            DMat3::from_cols(x, y, x.cross(y))
        } else if value(layers, "zaxis").is_some() {
            let z = DVec3::from_array(numbers(layers, "zaxis", None)?).try_normalize();
            DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, z.ok_or("zaxis must have a length")?))
        } else if value(layers, "axisangle").is_some() {
            let [x, y, z, turned] = numbers(layers, "axisangle", None)?;
            let axis = DVec3::new(x, y, z).try_normalize().ok_or("axisangle must have an axis")?;
            DMat3::from_axis_angle(axis, turned * self.angle_rad())
        } else {
            let [w, x, y, z] = numbers(layers, "quat", Some([1.0, 0.0, 0.0, 0.0]))?;
            let turn = DQuat::from_xyzw(x, y, z, w);
            if turn.length().is_nan() || turn.length() <= 0.0 {
                return Err("quat must not be zero".to_owned());
            }
            DMat3::from_quat(turn.normalize())
        };
        Ok(Placed { turn, at_m })
    }

    /// Where a geom is, its surface and its volume in cubic metres.
    fn placed_shape(
        &self,
        geom: &Geom<'a>,
        scale_m: f64,
        shapes: &mut Shapes,
        damaged: impl Fn(String) -> Failure,
    ) -> Result<(Placed, Shape, f64), Failure> {
        let layers = self.layers(geom.element, geom.class);
        let ends = value(&layers, "fromto").map(|_| numbers::<6>(&layers, "fromto", None)).transpose();
        let ends = ends.map_err(&damaged)?.map(|[a, b, c, d, e, f]| [DVec3::new(a, b, c), DVec3::new(d, e, f)]);
        let own = match ends {
            Some([from, to]) => {
                let along =
                    (from - to).try_normalize().ok_or_else(|| damaged("fromto must have two ends".to_owned()))?;
                Placed { turn: DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, along)), at_m: 0.5 * (from + to) }
            }
            None => self.pose_of(&layers).map_err(&damaged)?,
        };
        let at = geom.body.then(own);
        let name = value(&layers, "mesh");
        let kind = value(&layers, "type").unwrap_or(if name.is_some() { "mesh" } else { "sphere" });
        if let Some(name) = name.filter(|_| kind == "mesh") {
            let (shape, volume_m3) = self.mesh(name, scale_m, shapes, damaged)?;
            return Ok((at, shape, volume_m3));
        }
        if name.is_some() || kind == "mesh" {
            return Err(damaged("a geom must name its mesh if it is of type mesh, and only then".to_owned()));
        }
        // Half lengths; those that a kind does not have may be zero.
        let sizes = value(&layers, "size").unwrap_or("").split_whitespace().map(|word| word.parse::<f64>().ok());
        let mut sizes: Vec<f64> = sizes.map_while(|size| size.filter(|size| *size > 0.0 && size.is_finite())).collect();
        if let (Some([from, to]), Some(first)) = (ends, sizes.first().copied()) {
            let half = 0.5 * (from - to).length();
            sizes = if matches!(kind, "capsule" | "cylinder") { vec![first, half] } else { vec![first, first, half] };
        }
        let ball = core::f64::consts::PI * 4.0 / 3.0;
        let (shape, volume_m3) = match (kind, &sizes[..]) {
            ("box", [x, y, z, ..]) => (xml::solid(ShapeKind::Cuboid, [2.0 * x, 2.0 * y, 2.0 * z]), 8.0 * x * y * z),
            ("cylinder", [r, half, ..]) => {
                let shape = xml::solid(ShapeKind::Cylinder, [2.0 * r, 2.0 * r, 2.0 * half]);
                (shape, core::f64::consts::TAU * r * r * half)
            }
            ("sphere", [r, ..]) => (shapes.round([2.0 * r; 3], 0.0), ball * r * r * r),
            ("ellipsoid", [x, y, z, ..]) => (shapes.round([2.0 * x, 2.0 * y, 2.0 * z], 0.0), ball * x * y * z),
            ("capsule", [r, half, ..]) => {
                (shapes.round([2.0 * r; 3], 2.0 * half), ball * r * r * r + core::f64::consts::TAU * r * r * half)
            }
            ("box" | "cylinder" | "sphere" | "ellipsoid" | "capsule", _) => {
                let got = value(&layers, "size").unwrap_or("");
                return Err(damaged(format!("a {kind} must have its sizes, got {got:?}")));
            }
            _ => {
                let known = "mesh, box, cylinder, sphere, ellipsoid or capsule";
                return Err(damaged(format!("a geom must be {known}, got {kind}")));
            }
        };
        Ok((at, shape.map_err(damaged)?, volume_m3))
    }

    /// A mesh, and the volume that MuJoCo takes for its mass.
    fn mesh(
        &self,
        name: &str,
        scale_m: f64,
        shapes: &mut Shapes,
        damaged: impl Fn(String) -> Failure,
    ) -> Result<(Shape, f64), Failure> {
        let mesh = self.meshes.get(name).ok_or_else(|| damaged(format!("there is no mesh {name}")))?;
        let layers = self.layers(mesh, None);
        if let Some(key) = UNREAD.into_iter().find(|key| value(&layers, key).is_some()) {
            return Err(damaged(format!("{key} of mesh {name} is not followed")));
        }
        let file = mesh.attribute("file").ok_or_else(|| damaged(format!("mesh {name} must have file")))?;
        let scale = DVec3::from_array(numbers(&layers, "scale", Some([1.0; 3])).map_err(&damaged)?);
        let shape @ (corners, triangles) = &shapes.mesh(&self.resolved(file), scale * scale_m, self.file)?;
        let ends = triangles.iter().map(|triangle| triangle.map(|corner| corners.get(corner as usize).copied()));
        let triangles: Vec<[DVec3; 3]> = ends.filter_map(|[a, b, c]| Some([a?, b?, c?])).collect();
        let volume_m3 = match value(&layers, "inertia").unwrap_or("legacy") {
            "convex" => {
                hull_volume_m3(&corners.iter().map(|corner| corner.as_vec3()).collect::<Vec<_>>()).unwrap_or(0.0)
            }
            "exact" => MassIntegrals::of(triangles).volume_m3.abs(),
            // Pyramids over all triangles, whichever way they face, from the middle of those from the surface's middle.
            "legacy" => {
                let mean = |parts: &mut dyn Iterator<Item = (f64, DVec3)>| {
                    let (sum, weighted) = parts.fold((0.0, DVec3::ZERO), |(sum, weighted), (weight, at)| {
                        (sum + weight, weighted + at * weight)
                    });
                    weighted / sum
                };
                let pyramid_m3 =
                    |[a, b, c]: &[DVec3; 3], top: DVec3| (*a - top).dot((*b - top).cross(*c - top)).abs() / 6.0;
                let area_m2 = |[a, b, c]: &[DVec3; 3]| 0.5 * (*b - *a).cross(*c - *a).length();
                let centre = |[a, b, c]: &[DVec3; 3]| (*a + *b + *c) / 3.0;
                let surface = mean(&mut triangles.iter().map(|t| (area_m2(t), centre(t))));
                let middle =
                    mean(&mut triangles.iter().map(|t| (pyramid_m3(t, surface), 0.75 * centre(t) + 0.25 * surface)));
                triangles.iter().map(|triangle| pyramid_m3(triangle, middle)).sum()
            }
            other => return Err(damaged(format!("inertia {other} of mesh {name} is not followed"))),
        };
        Ok((shape.clone(), volume_m3))
    }
}

/// Which gives an attribute: an element or, if it has none, its defaults.
fn giver<'a>(layers: &[&'a Element], key: &str) -> Option<&'a Element> {
    layers.iter().copied().find(|element| element.attribute(key).is_some())
}

/// The attribute.
fn value<'a>(layers: &[&'a Element], key: &str) -> Option<&'a str> {
    giver(layers, key)?.attribute(key)
}

/// The same as numbers.
fn numbers<const N: usize>(layers: &[&Element], key: &str, otherwise: Option<[f64; N]>) -> Result<[f64; N], String> {
    giver(layers, key).unwrap_or(layers[0]).numbers(key, otherwise)
}
