//! Models of MuJoCo (MJCF) as rigid objects: the colliding geoms of all bodies, at zero joint angles, as one mesh.
//!
//! If nothing collides, all geoms count. The mass is the sum of what the bodies' `inertial` say, or their geoms; planes
//! and other geoms of the world itself are its surroundings, unless it has no bodies.

use std::path::{Path, PathBuf};

use glamx::{DMat3, DQuat, DVec3};
use program::Failure;
use schema::ShapeKind;

use super::xml::{self, Described, Element, Placed, Shape, Shapes};
use crate::mesh_file::damaged;

/// The outermost element.
const ROOT: &str = "mujoco";
/// Bodies within bodies, at most.
const DEPTH_MAX: usize = 100;
/// What changes a shape's place or size in a way that is not followed.
const UNREAD: [&str; 5] = ["xyaxes", "zaxis", "vertex", "refpos", "refquat"];

/// Whether a file is such a model, as far as it can be read.
pub(super) fn is_model(file: &Path) -> bool {
    xml::read(file, "MJCF", ROOT).is_ok()
}

/// The meshes that a model names, as far as it can be read.
pub(super) fn meshes_of(file: &Path) -> Vec<PathBuf> {
    let Ok(root) = xml::read(file, "MJCF", ROOT) else { return Vec::new() };
    let model = Model { file, root: &root };
    model.meshes().filter_map(|mesh| mesh.attribute("file")).map(|name| model.resolved(name)).collect()
}

/// Reads a model and the meshes that it names. One unit of a mesh is `scale_m` metres, besides the model's own scale.
pub(super) fn described(file: &Path, scale_m: f64) -> Result<Described, Failure> {
    let root = xml::read(file, "MJCF", ROOT)?;
    let model = Model { file, root: &root };
    let damaged = |message: String| damaged(&format!("not a usable MJCF file: {message}"), file);
    if !model.all(ROOT, "include").is_empty() {
        return Err(damaged("include is not followed: give the file that is included".to_owned()));
    }
    let mut found = Found::default();
    for world in root.children("worldbody") {
        if world.child("body").is_none() {
            model.collect(world, Placed::HERE, None, 0, &mut found).map_err(damaged)?;
        }
        for body in world.children("body") {
            model.collect(body, Placed::HERE, None, 0, &mut found).map_err(damaged)?;
        }
    }
    let collides = found.geoms.iter().any(|geom| geom.collides);
    let mut shapes = Shapes::default();
    for geom in found.geoms.iter().filter(|geom| geom.collides || !collides) {
        let (at, shape) = model.placed_shape(geom, scale_m, damaged)?;
        shapes.add(at, shape);
    }
    shapes.body(found.mass_kg, file)
}

/// A model and where it was read.
#[derive(Clone, Copy)]
struct Model<'a> {
    file: &'a Path,
    root: &'a Element,
}

/// What was found in bodies.
#[derive(Default)]
struct Found<'a> {
    geoms: Vec<Geom<'a>>,
    mass_kg: f64,
}

struct Geom<'a> {
    element: &'a Element,
    class: Option<&'a str>,
    body: Placed,
    collides: bool,
}

impl<'a> Model<'a> {
    /// The elements of a name in sections of a name.
    fn all(self, section: &'a str, name: &'a str) -> Vec<&'a Element> {
        let sections = self.root.children(section).flat_map(move |section| section.children(name));
        if section == ROOT { self.root.children(name).collect() } else { sections.collect() }
    }

    fn meshes(self) -> impl Iterator<Item = &'a Element> {
        self.all("asset", "mesh").into_iter()
    }

    fn compiler(self, key: &str) -> Option<&'a str> {
        self.root.children("compiler").filter_map(|compiler| compiler.attribute(key)).last()
    }

    fn resolved(self, name: &str) -> PathBuf {
        let folder = self.file.parent().unwrap_or(Path::new(""));
        let within = self.compiler("meshdir").or_else(|| self.compiler("assetdir")).unwrap_or("");
        folder.join(within).join(name)
    }

    /// An element and its defaults, first the one that counts most: itself, its class, the classes around that, and the
    /// class of all.
    fn layers(self, element: &'a Element, class: Option<&str>) -> Vec<&'a Element> {
        fn way<'a>(defaults: &'a Element, class: &str, depth: usize) -> Option<Vec<&'a Element>> {
            if defaults.attribute("class") == Some(class) {
                return Some(vec![defaults]);
            }
            let mut inner = defaults.children("default").filter(|_| depth < DEPTH_MAX);
            let mut found = inner.find_map(|inner| way(inner, class, depth + 1))?;
            found.push(defaults);
            Some(found)
        }
        let class = element.attribute("class").or(class);
        let of_class = |class| self.root.children("default").find_map(|defaults| way(defaults, class, 0));
        let defaults = class.and_then(of_class).unwrap_or_else(|| self.root.children("default").collect());
        let named = defaults.into_iter().flat_map(|defaults| defaults.children(&element.name).collect::<Vec<_>>());
        std::iter::once(element).chain(named).collect()
    }

    /// Adds the geoms and masses of a body and the bodies within it.
    fn collect(
        self,
        body: &'a Element,
        parent: Placed,
        class: Option<&'a str>,
        depth: usize,
        found: &mut Found<'a>,
    ) -> Result<(), String> {
        if depth > DEPTH_MAX {
            return Err(format!("its bodies must be nested at most {DEPTH_MAX} deep"));
        }
        let class = body.attribute("childclass").or(class);
        let at = parent.then(self.pose_of(&[body])?);
        let own_mass = body.child("inertial").map(|inertial| inertial.mass_kg("mass")).transpose()?;
        found.mass_kg += own_mass.unwrap_or(0.0);
        for geom in body.children("geom") {
            let layers = self.layers(geom, class);
            if value(&layers, "type") == Some("plane") {
                continue;
            }
            let number = |key, otherwise| numbers::<1>(&layers, key, Some([otherwise])).map(|[number]| number);
            if own_mass.is_none() {
                found.mass_kg += giver(&layers, "mass").map_or(Ok(0.0), |element| element.mass_kg("mass"))?;
            }
            let collides = number("contype", 1.0)? != 0.0 || number("conaffinity", 1.0)? != 0.0;
            found.geoms.push(Geom { element: geom, class, body: at, collides });
        }
        body.children("body").try_for_each(|inner| self.collect(inner, at, class, depth + 1, found))
    }

    /// The pose of an element, given with its defaults.
    fn pose_of(self, layers: &[&Element]) -> Result<Placed, String> {
        if let Some(key) = UNREAD.into_iter().find(|key| value(layers, key).is_some()) {
            return Err(format!("{key} of {} is not followed", layers[0].name));
        }
        let angle = if self.compiler("angle") == Some("radian") { 1.0 } else { core::f64::consts::PI / 180.0 };
        let at_m = DVec3::from_array(numbers(layers, "pos", Some([0.0; 3]))?);
        let turn = if value(layers, "euler").is_some() {
            let [a, b, c] = numbers::<3>(layers, "euler", None)?.map(|degree| degree * angle);
            if let Some(order) = self.compiler("eulerseq").filter(|order| *order != "xyz") {
                return Err(format!("eulerseq must be xyz, got {order}"));
            }
            DMat3::from_rotation_x(a) * DMat3::from_rotation_y(b) * DMat3::from_rotation_z(c)
        } else if value(layers, "axisangle").is_some() {
            let [x, y, z, turned] = numbers(layers, "axisangle", None)?;
            let axis = DVec3::new(x, y, z).try_normalize().ok_or("axisangle must have an axis")?;
            DMat3::from_axis_angle(axis, turned * angle)
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

    fn placed_shape(
        self,
        geom: &Geom<'a>,
        scale_m: f64,
        damaged: impl Fn(String) -> Failure,
    ) -> Result<(Placed, Shape), Failure> {
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
        if kind == "mesh" {
            let name = name.ok_or_else(|| damaged("a geom of type mesh must name its mesh".to_owned()))?;
            return Ok((at, self.mesh(name, scale_m, damaged)?));
        }
        // Half lengths; how many are read depends on the kind.
        let sizes = value(&layers, "size").unwrap_or("").split_whitespace().map(|word| word.parse::<f64>().ok());
        let sizes: Option<Vec<f64>> = sizes.collect();
        let mut sizes =
            sizes.filter(|sizes| sizes.iter().all(|size| size.is_finite() && *size > 0.0)).unwrap_or_default();
        if let (Some([from, to]), Some(first)) = (ends, sizes.first().copied()) {
            let half = 0.5 * (from - to).length();
            sizes = if matches!(kind, "capsule" | "cylinder") { vec![first, half] } else { vec![first, first, half] };
        }
        let shape = match (kind, &sizes[..]) {
            ("box", [x, y, z, ..]) => xml::solid(ShapeKind::Cuboid, [2.0 * x, 2.0 * y, 2.0 * z]),
            ("cylinder", [r, half, ..]) => xml::solid(ShapeKind::Cylinder, [2.0 * r, 2.0 * r, 2.0 * half]),
            ("sphere", [r, ..]) => xml::round([2.0 * r; 3], 0.0),
            ("ellipsoid", [x, y, z, ..]) => xml::round([2.0 * x, 2.0 * y, 2.0 * z], 0.0),
            ("capsule", [r, half, ..]) => xml::round([2.0 * r; 3], 2.0 * half),
            ("box" | "cylinder" | "sphere" | "ellipsoid" | "capsule", _) => {
                Err(format!("a {kind} must have its sizes, got {:?}", value(&layers, "size").unwrap_or("")))
            }
            _ => Err(format!("a geom must be mesh, box, cylinder, sphere, ellipsoid or capsule, got {kind}")),
        };
        Ok((at, shape.map_err(damaged)?))
    }

    fn mesh(self, name: &str, scale_m: f64, damaged: impl Fn(String) -> Failure) -> Result<Shape, Failure> {
        let stem = |file: &str| Path::new(file).file_stem().map(|stem| stem.to_string_lossy().into_owned());
        let is_meant = |mesh: &&Element| match mesh.attribute("name") {
            Some(own) => own == name,
            None => mesh.attribute("file").and_then(stem).as_deref() == Some(name),
        };
        let mesh = self.meshes().find(is_meant).ok_or_else(|| damaged(format!("there is no mesh {name}")))?;
        let layers = self.layers(mesh, None);
        if let Some(key) = UNREAD.into_iter().find(|key| value(&layers, key).is_some()) {
            return Err(damaged(format!("{key} of mesh {name} is not followed")));
        }
        let file = mesh.attribute("file").ok_or_else(|| damaged(format!("mesh {name} must have file")))?;
        let scale = DVec3::from_array(numbers(&layers, "scale", Some([1.0; 3])).map_err(damaged)?);
        xml::scaled_mesh(&self.resolved(file), scale * scale_m, self.file)
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
