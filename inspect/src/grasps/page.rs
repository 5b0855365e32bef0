//! An object's grasps to look at: one object in space, and a catalogue as a grid of pictures.

use program::Failure;
use program::text::{grouped, percent};
use report::document::{Block, Document, Drawing, Picture};
use report::picture::{Hand, Scene, svg};
use report::view::{Body, Class, Line, View};
use schema::{ObjectGrasp, ObjectGrasps, Outcome, Pose, Vec3, bounds_m};
use serde_json::Value;

use super::free_share;
use crate::pictures::spread;

/// Grasps that a page shows, spread over all.
const SHOWN: usize = 200;
/// Hands in a picture of the grid.
const PICTURED: usize = 16;

/// An object with its grasps as forks, those that held last. A fork says what is known of its grasp.
#[must_use]
pub fn grasps_view(set: &ObjectGrasps) -> View {
    let held = set.count(Outcome::Held);
    let mut view = View::new(format!("{}: {held} of {} grasps held", set.name, grouped(set.grasps.len() as u64)));
    view.bodies
        .extend(set.parts.iter().map(|part| Body::of_part(Class::Object, set.name.clone(), part, &[Pose::IDENTITY])));
    let numbers: Vec<u64> = (0..set.grasps.len() as u64).collect();
    let shown = spread(&numbers, SHOWN);
    for is_held in [false, true] {
        for number in &shown {
            let grasp = &set.grasps[*number as usize];
            if (grasp.outcome == Outcome::Held) == is_held {
                let width_m = grasp.width_m.unwrap_or(set.gripper.opening_m_max);
                let class = Class::Grasp(grasp.outcome);
                view.lines.push(Line::fork(
                    class,
                    label(set, *number, grasp),
                    &set.gripper,
                    &grasp.object_from_grasp,
                    width_m,
                ));
            }
        }
    }
    view.fact("hand", format!("{}, opens {:.0} mm", set.gripper.name, set.gripper.opening_m_max * 1000.0));
    view.fact("test", set.test.name());
    view.fact("mass", format!("{:.0} g", set.mass_kg * 1000.0));
    view.fact("friction", format!("{:.2}", set.friction));
    view.fact("shown", format!("{} of {}", shown.len(), set.grasps.len()));
    for outcome in Outcome::ALL {
        view.fact(outcome.name(), set.count(outcome).to_string());
    }
    if let Some(coverage) = set.coverage {
        view.fact("covered", percent(f64::from(coverage)));
    }
    view.hidden = ["approach_collision", "pregrasp_collision", "empty"].map(str::to_owned).into();
    view
}

/// A grasp in words.
fn label(set: &ObjectGrasps, number: u64, grasp: &ObjectGrasp) -> String {
    let mut text = format!("grasp {number}, {}\n{}", grasp.source.name(), grasp.outcome.name());
    if let Some(width_m) = grasp.width_m {
        text += &format!(", {:.1} mm", width_m * 1000.0);
    }
    if let Some(margins) = grasp.margins {
        let tug_g = margins.tug_max_g;
        text += &match margins.friction_min {
            Some(friction) => format!("\nholds with a friction from {friction:.2} on, and up to {tug_g:.1} g"),
            None => format!("\nslips or turns in some direction above {tug_g:.2} g, less than its weight"),
        };
    }
    if let Some(share) = grasp.robust_share {
        text += &format!("\n{} of moved repeats", percent(f64::from(share)));
    }
    if let Some(share) = free_share(grasp, &set.stable_poses) {
        text += &format!("\nfree on a table in {}", percent(f64::from(share)));
    }
    text
}

/// A picture (SVG) of an object with some grasps that held.
#[must_use]
pub fn grasps_svg(set: &ObjectGrasps) -> String {
    let held: Vec<&ObjectGrasp> = set.held().collect();
    let numbers: Vec<u64> = (0..held.len() as u64).collect();
    let size_m = 2.0 * set.extents_m.length().max(set.gripper.opening_m_max);
    let [low_m, high_m] = bounds_m(set.parts.iter().flat_map(|part| part.corners_m()));
    let middle_m = 0.5 * (low_m + high_m);
    let lift_m = Vec3::new(0.5 * size_m, 0.5 * size_m, 0.5 * set.extents_m.length()) - middle_m;
    let placed = |pose: &Pose| Pose::from_parts(pose.translation + lift_m, pose.rotation);
    let hand = |number: u64| {
        let grasp = held[number as usize];
        Hand {
            workspace_from_grasp: placed(&grasp.object_from_grasp),
            width_m: grasp.width_m.unwrap_or(set.gripper.opening_m_max),
            outcome: grasp.outcome,
            label: label(set, number, grasp),
            strength: 1.0,
        }
    };
    svg(&Scene {
        size_m,
        table_z_m: 0.0,
        bodies: set.parts.iter().map(|part| (part.moved(&placed(&Pose::IDENTITY)), 0)).collect(),
        fixtures: Vec::new(),
        hands: spread(&numbers, PICTURED).into_iter().map(hand).collect(),
    })
}

/// The page of all objects: what `NAME.json` says of each, and its picture.
///
/// # Errors
/// [`Failure`] if the page cannot be made.
pub fn grasps_index(objects: impl IntoIterator<Item = (Value, String)>) -> Result<String, Failure> {
    let picture = |(info, drawing): (Value, String)| {
        let name = info["object"]["name"].as_str().unwrap_or_default().to_owned();
        let caption = format!("{} of {} grasps held", info["outcomes"][Outcome::Held.name()], info["grasps"]);
        Picture { link: Some(format!("{name}.html")), ..Picture::new(Drawing::Svg(drawing), name, caption) }
    };
    let pictures = objects.into_iter().map(picture).collect();
    let text = "A picture has up to 16 grasps that held, and leads to its object, which can be turned; there a fork says what is known \
                of its grasp, and each outcome can be hidden.";
    let blocks = vec![Block::Text(text.to_owned()), Block::Legend(vec![Outcome::Held]), Block::Gallery(pictures)];
    let footer = format!("graspmill objects annotate, Graspmill {}", env!("CARGO_PKG_VERSION"));
    Document { title: "Grasps of objects".to_owned(), blocks, footer }.html()
}
