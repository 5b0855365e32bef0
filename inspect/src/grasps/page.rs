//! Objects' grasps to look at: a folder with a list of them, and a page for each object in space, on which a click
//! on a grasp leads to its replay.

use std::path::Path;

use program::Failure;
use program::text::{grouped, percent};
use report::document::{Block, Card, Document};
use report::view::folder::{INDEX, ListedAttempt, Shelf, object_file};
use report::view::{Body, Class, Line, View};
use schema::{Margins, ObjectGrasp, ObjectGrasps, Outcome, Pose};

use super::stored::read_grasp_set;
use super::{free_share, grasp_sets};
use crate::browse::{Lists, write};
use crate::replay::{Replays, of_object};
use crate::spread::spread;

/// Grasps that a page shows, spread over all: at most, at least, and on all pages together. A replay takes a few
/// kilobytes.
const SHOWN: [usize; 2] = [200, 24];
const SHOWN_OF_ALL: usize = 24_000;

/// Writes the pages of the sets of these names in a folder, in order, as [`crate::browse`] does for scenes. A set at a
/// time is in memory.
///
/// # Errors
/// If `out` has files of others, a set cannot be read, or a file not written.
pub fn browse_grasps(folder: &Path, names: &[String], out: &Path, has_replays: bool) -> Result<Replays, Failure> {
    let files = names.iter().map(|name| object_file(name)).collect();
    let mut lists = Lists::begin(out, Shelf::Objects, files)?;
    let mut done = Replays::default();
    let [most, least] = SHOWN;
    let count = (SHOWN_OF_ALL / names.len().max(1)).clamp(least, most);
    let (mut cards, mut shown, mut all) = (Vec::new(), 0, 0);
    for (at, name) in names.iter().enumerate() {
        let set = read_grasp_set(folder, name)?;
        let numbers = spread(&(0..set.grasps.len() as u64).collect::<Vec<_>>(), count);
        let view = grasps_view(&set, &numbers);
        let replays = done.kept(|| if has_replays { of_object(&set, &numbers, &view) } else { Ok(Vec::new()) });
        let listed = |number: &u64| {
            let grasp = &set.grasps[*number as usize];
            let (id, words) = (number.to_string(), words(&set, grasp));
            ListedAttempt { attempt: *number as u32, id, outcome: grasp.outcome, words }
        };
        lists.add(at as u64, name.clone(), &view, numbers.iter().map(listed).collect(), replays)?;
        cards.push(card(&set, name));
        (shown, all) = (shown + numbers.len(), all + set.grasps.len());
    }
    lists.finish()?;
    let objects = grasp_sets(folder)?.len();
    let text = format!(
        "{} of {objects} objects, with {} of {} grasps. A name leads to its object, which can be turned; a \
         grasp there leads to its replay.",
        names.len(),
        grouped(shown as u64),
        grouped(all as u64)
    );
    let blocks = vec![Block::Text(text), Block::Filter, Block::Gallery(cards)];
    let footer = format!("graspmill dataset browse, Graspmill {}", env!("CARGO_PKG_VERSION"));
    write(out, INDEX, &Document { title: "Grasps of objects".to_owned(), blocks, footer }.html())?;
    Ok(done)
}

/// An object in the list.
fn card(set: &ObjectGrasps, name: &str) -> Card {
    let (held, all) = (set.count(Outcome::Held) as u64, set.grasps.len() as u64);
    let caption = format!("{} of {} grasps held", grouped(held), grouped(all));
    Card { title: name.to_owned(), caption, link: object_file(name) }
}

/// An object with some of its grasps as forks, those that held last. A fork says what is known of its grasp.
fn grasps_view(set: &ObjectGrasps, numbers: &[u64]) -> View {
    let held = grouped(set.count(Outcome::Held) as u64);
    let mut view = View::new(format!("{}: {held} of {} grasps held", set.name, grouped(set.grasps.len() as u64)));
    let part = |part| Body::of_part(Class::Object, set.name.clone(), part, &[Pose::IDENTITY]);
    view.bodies.extend(set.parts.iter().map(part));
    let is_held = |number: &u64| set.grasps[*number as usize].outcome == Outcome::Held;
    let (last, first): (Vec<u64>, Vec<u64>) = numbers.iter().partition(|number| is_held(number));
    for number in first.iter().chain(&last) {
        let grasp = &set.grasps[*number as usize];
        let (pose, width_m) = (&grasp.object_from_grasp, grasp.width_m.unwrap_or(set.gripper.opening_m_max));
        let class = Class::Grasp(grasp.outcome);
        view.lines.push(Line::fork(class, label(set, *number, grasp), &set.gripper, pose, width_m));
    }
    view.fact("gripper", format!("{}, opens {:.0} mm", set.gripper.name, set.gripper.opening_m_max * 1000.0));
    view.fact("test", set.test.name());
    view.fact("mass", format!("{:.0} g", set.mass_kg * 1000.0));
    view.fact("friction", format!("{:.2}", set.friction));
    view.fact("shown", format!("{} of {}", numbers.len(), grouped(set.grasps.len() as u64)));
    for outcome in Outcome::ALL {
        view.fact(outcome.name(), grouped(set.count(outcome) as u64));
    }
    if let Some(coverage) = set.coverage {
        view.fact("covered", percent(f64::from(coverage)));
    }
    view.hidden = ["approach_collision", "pregrasp_collision", "empty"].map(str::to_owned).into();
    view
}

/// A grasp's name and outcome, and what is known of it.
fn label(set: &ObjectGrasps, number: u64, grasp: &ObjectGrasp) -> String {
    format!("{}/{number}: {}\n{}", set.name, grasp.outcome.name(), words(set, grasp))
}

/// How a grasp was drawn, and what was measured.
fn words(set: &ObjectGrasps, grasp: &ObjectGrasp) -> String {
    let share = |of: Option<f32>, what: &str| of.map(|of| format!("{} {what}", percent(f64::from(of))));
    let length = |of_m: Option<f32>, what: &str| of_m.map(|of_m| format!("{:.1} mm{what}", of_m * 1000.0));
    let margins = grasp.margins.map(|Margins { friction_min, tug_max_g }| match friction_min {
        Some(friction) => format!("holds with a friction from {friction:.2} on, and up to {tug_max_g:.1} g"),
        None => format!("slips or turns in some direction above {tug_max_g:.2} g, less than its weight"),
    });
    let known = [
        Some(grasp.source.name().to_owned()),
        length(grasp.width_m, ""),
        length(grasp.clearance_m, " clear on its way"),
        length(grasp.pushed_m, " pushed aside"),
        margins,
        share(grasp.p_held, "of its repeats hold"),
        share(free_share(grasp, &set.stable_poses), "of the ways to lie leave it free"),
    ];
    known.into_iter().flatten().collect::<Vec<_>>().join(", ")
}
