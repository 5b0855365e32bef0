//! A folder of pages that lead to each other: all scenes, or all objects of a set of grasps, and a page for each, which
//! holds the replays of its attempts. They share their style and scripts, which are files of the folder; nothing else
//! is asked for, so a browser opens it from a disk.

use std::io::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use schema::Outcome;
use serde::Serialize;

use super::View;
use crate::assets;

/// The page of all scenes.
pub const INDEX: &str = "index.html";
/// The page of statistics.
pub const REPORT: &str = "report.html";
/// What [`Listing`] becomes.
pub const LISTING: &str = "scenes.js";
/// What chooses among the scenes of the listing.
pub const BROWSE: &str = "browse.js";
pub(crate) const VIEWER: &str = "viewer.js";
pub(crate) const VIEWER_STYLE: &str = "viewer.css";

/// What the pages of a folder show.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Shelf {
    /// Scenes of a dataset, with their attempts.
    #[default]
    Scenes,
    /// Objects alone, with their grasps.
    Objects,
}

impl Shelf {
    /// What is on all pages, and what each of them has.
    pub(crate) fn words(self) -> [&'static str; 2] {
        match self {
            Self::Scenes => ["scenes", "attempts"],
            Self::Objects => ["objects", "grasps"],
        }
    }
}

/// The page of a scene.
#[must_use]
pub fn scene_file(scene: u64) -> String {
    format!("scene-{scene}.html")
}

/// The page of an object, whose name is that of its files.
#[must_use]
pub fn object_file(name: &str) -> String {
    format!("object-{name}.html")
}

/// Whether a file of the folder is the page of a scene or an object.
#[must_use]
pub fn is_page(name: &str) -> bool {
    let stem = name.strip_suffix(".html").unwrap_or_default();
    let scene = stem.strip_prefix("scene-");
    scene.is_some_and(|id| id.bytes().all(|byte| byte.is_ascii_digit())) || stem.starts_with("object-")
}

/// A packed replay's poses are whole numbers of this many parts of a metre, or of a quaternion's unit.
const PARTS: f32 = 1e5;

impl View {
    /// A replay for the page of its scene: its JSON, deflated, in base64, which `browse.js` unpacks. A body leaves out
    /// its shape and label where the body of `scene` at the same place has them. Where it moves, a pose is its
    /// difference from the last one, in hundred-thousandths of a metre or of a quaternion's unit. Points are rounded to
    /// a tenth of a millimetre.
    #[must_use]
    pub fn packed(mut self, scene: &Self) -> String {
        for (body, other) in self.bodies.iter_mut().zip(&scene.bodies) {
            if (&body.label, &body.corners_m, &body.faces) == (&other.label, &other.corners_m, &other.faces) {
                (body.label, body.corners_m, body.faces) = Default::default();
            }
        }
        for body in self.bodies.iter_mut().filter(|body| body.poses.len() > 1) {
            let mut last = [0.0; 7];
            for pose in &mut body.poses {
                let now = pose.map(|value| (value * PARTS).round());
                *pose = std::array::from_fn(|at| now[at] - last[at]);
                last = now;
            }
        }
        let points = self.points.iter_mut().flat_map(|points| &mut points.points_m).flatten();
        points.for_each(|value| *value = (*value * 1e4).round() / 1e4);
        let mut deflated = ZlibEncoder::new(Vec::new(), Compression::best());
        let bytes = deflated.write_all(self.to_json().as_bytes()).and_then(|()| deflated.finish());
        STANDARD.encode(bytes.expect("writing to memory cannot fail"))
    }
}

/// The files that the pages share: name and text.
#[must_use]
pub fn shared_files() -> [(&'static str, String); 3] {
    [
        (VIEWER, assets::VIEWER.to_owned()),
        (VIEWER_STYLE, format!("{}{}", assets::OUTCOMES, assets::VIEWER_STYLE)),
        (BROWSE, assets::BROWSE.to_owned()),
    ]
}

/// The scenes, or objects, of a folder with their attempts, for its scripts.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Listing {
    /// What the scenes are.
    pub shelf: Shelf,
    /// The scenes in the order of their pages.
    pub scenes: Vec<ListedScene>,
}

/// A scene of a listing.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ListedScene {
    /// Its place in the order of the pages.
    pub id: u64,
    /// What it is called: `scene 7`.
    pub name: String,
    /// Its page.
    pub file: String,
    /// The number of each attempt, and how it ended.
    pub attempts: Vec<(u32, Outcome)>,
}

impl Listing {
    /// The listing as a script.
    #[must_use]
    pub fn script(&self) -> String {
        let json = serde_json::to_string(self).expect("strings, numbers and lists are always JSON");
        format!("const listing = {json};\n")
    }
}

/// Where the page of a scene stands in a folder, and what it has besides the scene.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Place {
    /// What the folder's pages show.
    pub shelf: Shelf,
    /// The page before it.
    pub previous: Option<String>,
    /// The page after it.
    pub next: Option<String>,
    /// The scene's attempts, beside it.
    pub attempts: Vec<ListedAttempt>,
    /// Replays with the numbers of their attempts, as [`View::packed`] makes them; none if they could not be made.
    pub replays: Vec<(u32, String)>,
}

/// An attempt in the list beside a view.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ListedAttempt {
    /// Its number in its scene.
    pub attempt: u32,
    /// Its id: `7/19`.
    pub id: String,
    /// How it ended.
    pub outcome: Outcome,
    /// What else there is to say.
    pub words: String,
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use flate2::read::ZlibDecoder;
    use schema::{GripperBox, Pose, Vec3};

    use super::*;
    use crate::view::{Body, Class};

    #[test]
    fn only_pages_of_scenes_and_objects_are_taken_for_such() {
        assert!(is_page(&scene_file(7)) && is_page(&object_file("mug.2")));
        for name in ["scene-a.html", "index.html", "scene-7.htm", "my-scene-7.html", "scene-7.html.bak", "mug.html"] {
            assert!(!is_page(name), "{name}");
        }
    }

    #[test]
    fn a_packed_replay_leaves_out_what_its_scene_has() {
        let unit_box = GripperBox { centre_m: Vec3::ZERO, half_m: Vec3::ONE };
        let block = |class| Body::of_box(class, "block", &unit_box, &[Pose::IDENTITY]);
        let scene = View { bodies: vec![Body::table(0.3, 0.05), block(Class::Object)], ..View::new("Scene 7") };
        let mut replay = View { bodies: vec![Body::table(0.3, 0.1), block(Class::Target)], ..View::new("7/19: held") };
        let pose = |at: u16| [0.1, 0.2, 0.3 + f32::from(at) * 1e-3, 0.0, 0.0, 0.0, 1.0];
        replay.bodies[1].poses = (0..100).map(pose).collect();
        replay.bodies.push(Body { poses: replay.bodies[1].poses.clone(), ..block(Class::Gripper) });
        let packed = replay.clone().packed(&scene);
        assert!(packed.len() * 4 < replay.to_json().len(), "{}", packed.len());
        let mut json = String::new();
        ZlibDecoder::new(STANDARD.decode(packed).unwrap().as_slice()).read_to_string(&mut json).unwrap();
        let back: View = serde_json::from_str(&json).unwrap();
        let told = |body: &Body| (body.label.is_empty(), body.corners_m.len(), body.faces.len(), body.poses.len());
        let told: Vec<_> = back.bodies.iter().map(told).collect();
        assert_eq!(told, [(false, 8, 6, 1), (true, 0, 0, 100), (false, 8, 6, 100)], "the table is another");
        assert_eq!(back.bodies[1].poses[0], [10_000.0, 20_000.0, 30_000.0, 0.0, 0.0, 0.0, 100_000.0]);
        assert_eq!(back.bodies[1].poses[99], [0.0, 0.0, 100.0, 0.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn a_listing_is_a_script_of_one_constant() {
        let (name, file) = ("scene 7".to_owned(), scene_file(7));
        let scenes = vec![ListedScene { id: 7, name, file, attempts: vec![(19, Outcome::Held)] }];
        let script = Listing { shelf: Shelf::Scenes, scenes }.script();
        let json = script.strip_prefix("const listing = ").and_then(|rest| rest.strip_suffix(";\n")).unwrap();
        let back: serde_json::Value = serde_json::from_str(json).unwrap();
        assert_eq!(back["scenes"][0]["attempts"][0], serde_json::json!([19, "held"]));
    }
}
