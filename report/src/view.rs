//! A 3-D view of bodies, lines and points, at rest or moving: plain data, and the page that shows them.
//!
//! A [`View`] is the common format of all programs: it is serialised as JSON, and [`View::page`] makes a self-contained
//! HTML file of it. All positions are in the workspace frame: metres, z up.

pub mod folder;
mod page;
pub(crate) mod shapes;

pub use schema::{Event, EventKind};
use schema::{Outcome, Pose, Vec3};
use serde::{Deserialize, Serialize};

/// The format's name and version, the first field of the JSON.
pub const FORMAT: &str = "graspmill-view/1";

/// A 3-D view.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// [`FORMAT`].
    pub format: String,
    /// A title of one line.
    pub title: String,
    /// Bodies.
    pub bodies: Vec<Body>,
    /// Lines.
    pub lines: Vec<Line>,
    /// Points that no line connects.
    pub points: Vec<Line>,
    /// Frames, in order; none if nothing moves.
    pub frames: Vec<Frame>,
    /// Events, in order.
    pub events: Vec<Event>,
    /// Further facts.
    pub facts: Vec<Fact>,
    /// Classes that are hidden until the reader selects them.
    pub hidden: Vec<String>,
}

/// A surface of flat, convex faces, closed or not.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Body {
    /// Its class; members of a class look alike and are shown or hidden together.
    pub class: Class,
    /// Its label.
    pub label: String,
    /// Its corners in its own frame, in metres.
    pub corners_m: Vec<[f32; 3]>,
    /// Its faces: corner indices, counter-clockwise as seen from outside.
    pub faces: Vec<Vec<usize>>,
    /// Its pose: x, y, z (metres), then a unit quaternion x, y, z, w; one, or one per frame.
    pub poses: Vec<[f32; 7]>,
}

/// A polyline, or points of one kind.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// Its class.
    pub class: Class,
    /// Its label; may be empty.
    pub label: String,
    /// Its points, in metres.
    pub points_m: Vec<[f32; 3]>,
    /// The first and the last frame in which it is visible; `None`: always.
    pub frames: Option<[usize; 2]>,
}

/// A frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// Seconds since the first frame.
    pub time_s: f32,
}

/// A key with its value, shown beside the view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fact {
    /// The key.
    pub key: String,
    /// The value.
    pub value: String,
}

/// The class of an element of a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// The table's top.
    Table,
    /// What the objects lie in.
    Container,
    /// The workspace.
    Workspace,
    /// An object.
    Object,
    /// The target object.
    Target,
    /// The object that was hit.
    Hit,
    /// The gripper.
    Gripper,
    /// A camera.
    Camera,
    /// The observed surface.
    Surface,
    /// Where fingers press.
    Contact,
    /// The axes of a frame.
    Axes,
    /// A grasp, by its outcome.
    #[serde(untagged)]
    Grasp(Outcome),
}

impl View {
    /// An empty view.
    #[must_use]
    pub fn new(title: impl Into<String>) -> Self {
        Self { format: FORMAT.to_owned(), title: title.into(), ..Self::default() }
    }

    /// Adds a fact.
    pub fn fact(&mut self, key: &str, value: impl Into<String>) {
        self.facts.push(Fact { key: key.to_owned(), value: value.into() });
    }

    /// The JSON, in one line.
    #[must_use]
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("strings, numbers and lists are always JSON") + "\n"
    }
}

/// A pose in the format of a view: x, y, z in metres, then the quaternion's x, y, z, w.
#[must_use]
pub fn flat(pose: &Pose) -> [f32; 7] {
    let ([x, y, z], [qx, qy, qz, qw]) = (pose.translation.to_array(), pose.rotation.to_array());
    [x, y, z, qx, qy, qz, qw]
}

/// Points in the format of a view.
#[must_use]
pub fn flat_points(points_m: impl IntoIterator<Item = Vec3>) -> Vec<[f32; 3]> {
    points_m.into_iter().map(|point| point.to_array()).collect()
}
