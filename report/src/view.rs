//! A view of things in space, at rest or moving: plain data, and the page that shows them.
//!
//! A [`View`] is what programs agree on: it is written as JSON, and [`View::page`] makes of it one HTML file that needs
//! nothing else. All places are in one frame, the workspace's: metres, z up.

mod page;
pub(crate) mod shapes;

use schema::{Pose, Vec3};
use serde::{Deserialize, Serialize};

/// The format's name and version, the first field of the JSON.
pub const FORMAT: &str = "graspmill-view/1";

/// What there is to see.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct View {
    /// [`FORMAT`].
    pub format: String,
    /// One line.
    pub title: String,
    /// Convex bodies.
    pub bodies: Vec<Body>,
    /// Lines.
    pub lines: Vec<Line>,
    /// Points.
    pub points: Vec<Points>,
    /// Moments, in order; none if nothing moves.
    pub frames: Vec<Frame>,
    /// What happens, in order.
    pub events: Vec<Event>,
    /// What is known besides.
    pub facts: Vec<Fact>,
    /// Classes that are hidden until the reader selects them.
    pub hidden: Vec<String>,
}

/// A convex polyhedron.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// What it is; what is of one class looks alike and is shown or not together.
    pub class: Class,
    /// What is said of it.
    pub label: String,
    /// Its corners in its own frame, in metres.
    pub corners_m: Vec<[f32; 3]>,
    /// Its faces: corners by number, counter-clockwise as seen from outside.
    pub faces: Vec<Vec<usize>>,
    /// Where it is, x, y, z (metres), then a unit quaternion x, y, z, w: once, or at every frame.
    pub poses: Vec<[f32; 7]>,
}

/// A line from point to point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// What it is.
    pub class: Class,
    /// What is said of it; may be empty.
    pub label: String,
    /// Its points, in metres.
    pub points_m: Vec<[f32; 3]>,
    /// The first and the last frame in which it is there; `None`: always.
    pub frames: Option<[usize; 2]>,
}

/// Points of one kind.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Points {
    /// What they are.
    pub class: Class,
    /// What is said of them; may be empty.
    pub label: String,
    /// Where they are, in metres.
    pub points_m: Vec<[f32; 3]>,
    /// The first and the last frame in which they are there; `None`: always.
    pub frames: Option<[usize; 2]>,
}

/// A moment.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// Seconds since the first.
    pub time_s: f32,
}

/// Something that happens.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Event {
    /// The frame at which it does.
    pub frame: usize,
    /// What kind of thing it is.
    pub kind: EventKind,
    /// In words.
    pub text: String,
}

/// Kinds of events.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// A phase begins and lasts until the next.
    Phase,
    /// Worth knowing.
    Note,
    /// What decided that a grasp holds.
    Held,
    /// What decided that it does not.
    Failed,
}

/// A key and its value, shown beside.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fact {
    /// What.
    pub key: String,
    /// How much.
    pub value: String,
}

/// What a thing in a view is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// The table's top.
    Table,
    /// The workspace.
    Workspace,
    /// An object.
    Object,
    /// The object that is to be grasped.
    Target,
    /// What was hit.
    Hit,
    /// The hand.
    Hand,
    /// What the hand passes on its way, or would.
    Swept,
    /// A grasp that held.
    Held,
    /// A grasp that lost its object.
    Slipped,
    /// A grasp that drove something else.
    HitOther,
    /// A grasp of nothing.
    Empty,
    /// A grasp whose hand collides on its way.
    ApproachCollision,
    /// A grasp whose hand collides before its way.
    PregraspCollision,
    /// A camera.
    Camera,
    /// The surface as the cameras saw it.
    Surface,
    /// Where things touch.
    Contact,
}

impl Class {
    /// The class of a grasp that ended so.
    #[must_use]
    pub fn of_outcome(outcome: schema::Outcome) -> Self {
        match outcome {
            schema::Outcome::Held => Self::Held,
            schema::Outcome::Slipped => Self::Slipped,
            schema::Outcome::HitOther => Self::HitOther,
            schema::Outcome::Empty => Self::Empty,
            schema::Outcome::ApproachCollision => Self::ApproachCollision,
            schema::Outcome::PregraspCollision => Self::PregraspCollision,
        }
    }
}

impl View {
    /// Nothing yet.
    #[must_use]
    pub fn new(title: impl Into<String>) -> Self {
        Self {
            format: FORMAT.to_owned(),
            title: title.into(),
            bodies: Vec::new(),
            lines: Vec::new(),
            points: Vec::new(),
            frames: Vec::new(),
            events: Vec::new(),
            facts: Vec::new(),
            hidden: Vec::new(),
        }
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

/// A pose as a view has it: x, y, z in metres, then the quaternion's x, y, z, w.
#[must_use]
pub fn flat(pose: &Pose) -> [f32; 7] {
    let ([x, y, z], [qx, qy, qz, qw]) = (pose.translation.to_array(), pose.rotation.to_array());
    [x, y, z, qx, qy, qz, qw]
}

/// Points as a view has them.
#[must_use]
pub fn flat_points(points_m: impl IntoIterator<Item = Vec3>) -> Vec<[f32; 3]> {
    points_m.into_iter().map(|point| point.to_array()).collect()
}
