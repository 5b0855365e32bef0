//! Objects' grasps to look at: a folder with a list of them, and a page for each object in space, on which a click
//! on a grasp leads to its replay.

use std::cmp::Reverse;
use std::path::Path;

use program::Failure;
use program::text::{grouped, percent};
use report::document::{Block, Card, Document};
use report::view::folder::{INDEX, ListedAttempt, Shelf, object_file};
use report::view::{Body, Class, Line, View, flat_points};
use schema::{Margins, ObjectGrasp, ObjectGrasps, Outcome, Pose, Surface};

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
        let mut numbers = spread(&(0..set.grasps.len() as u64).collect::<Vec<_>>(), count);
        let grasp = |number: &u64| &set.grasps[*number as usize];
        numbers.sort_by_key(|number| Reverse(grasp(number).strength()));
        let view = grasps_view(&set, &numbers);
        let replays = done.kept(|| if has_replays { of_object(&set, &numbers, &view) } else { Ok(Vec::new()) });
        let listed = |number: &u64| {
            let (id, words) = (number.to_string(), words(&set, grasp(number)));
            ListedAttempt { attempt: *number as u32, id, outcome: grasp(number).outcome, words }
        };
        lists.add(at as u64, name.clone(), &view, numbers.iter().map(listed).collect(), replays)?;
        let [held, grasps] = [set.count(Outcome::Held), set.grasps.len()].map(|count| grouped(count as u64));
        let caption = format!("{held} of {grasps} grasps held");
        cards.push(Card { title: name.clone(), caption, link: object_file(name) });
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

/// An object with some of its grasps, the strongest first, as forks, and where those that held press. A fork says what
/// is known of its grasp.
fn grasps_view(set: &ObjectGrasps, numbers: &[u64]) -> View {
    let held = grouped(set.count(Outcome::Held) as u64);
    let mut view = View::new(format!("{}: {held} of {} grasps held", set.name, grouped(set.grasps.len() as u64)));
    let surface = Surface::of(set.mesh.as_deref(), &set.parts);
    view.bodies.push(Body::of_surface(Class::Object, set.name.clone(), surface, &[Pose::IDENTITY]));
    let mut contacts_m = Vec::new();
    for number in numbers.iter().rev() {
        let grasp = &set.grasps[*number as usize];
        let (pose, width_m) = (&grasp.object_from_grasp, grasp.width_m.unwrap_or(set.gripper.opening_m_max));
        let class = Class::Grasp(grasp.outcome);
        let label = format!("{}/{number}: {}\n{}", set.name, grasp.outcome.name(), words(set, grasp));
        view.lines.push(Line::fork(class, label, &set.gripper, pose, width_m));
        contacts_m.extend(grasp.contacts_m.into_iter().flatten().filter(|_| grasp.outcome == Outcome::Held));
    }
    let (label, points_m) = ("where fingers press that hold it".to_owned(), flat_points(contacts_m));
    let contacts = Line { class: Class::Contact, label, points_m, frames: None };
    view.points.extend((!contacts.points_m.is_empty()).then_some(contacts));
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
        length(grasp.clearance_m.filter(|m| *m >= 0.0), " clear on its way"),
        length(grasp.clearance_m.filter(|m| *m < 0.0).map(|m| -m), " into the object on its way"),
        length(grasp.pushed_m, " pushed aside"),
        margins,
        share(grasp.p_held, "of its repeats hold"),
        share(free_share(grasp, &set.stable_poses), "of the ways to lie leave it free"),
    ];
    known.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grasps::stored::tests::set;

    #[test]
    fn a_page_shows_the_mesh_the_contacts_of_what_held_and_the_weakest_first() {
        let mut set = set();
        let shown = |set: &ObjectGrasps| {
            let mut view = grasps_view(set, &[4, 0, 1]);
            (view.bodies.remove(0), view)
        };
        let (body, view) = shown(&set);
        let mesh = set.mesh.clone().unwrap();
        assert_eq!(body.corners_m, flat_points(mesh.corners_m().iter().copied()));
        assert_eq!((body.faces, view.bodies), (vec![vec![0, 1, 2], vec![2, 1, 3]], Vec::new()));
        let held = [4, 0, 1].into_iter().filter(|number| set.grasps[*number].outcome == Outcome::Held);
        let contacts: usize = held.map(|number| set.grasps[number].contacts_m.into_iter().flatten().count()).sum();
        assert_eq!(view.points.iter().map(|points| points.points_m.len()).sum::<usize>(), contacts);
        let numbers: Vec<&str> = view.lines.iter().filter_map(|line| line.label.split([':', '/']).nth(1)).collect();
        assert_eq!(numbers, ["1", "0", "4"], "the strongest is drawn over the others");
        // Without a mesh all parts are one body.
        set.mesh = None;
        let (body, view) = shown(&set);
        assert_eq!((body.corners_m.len(), body.faces.len(), view.bodies.len()), (8, 6, 0));
    }

    #[test]
    fn a_clearance_below_zero_is_in_the_way() {
        let set = set();
        let said =
            |clearance_m: f32| words(&set, &ObjectGrasp { clearance_m: Some(clearance_m), ..set.grasps[0].clone() });
        assert!(said(0.0012).contains(", 1.2 mm clear on its way"), "{}", said(0.0012));
        assert!(said(-0.0147).contains(", 14.7 mm into the object on its way"), "{}", said(-0.0147));
    }
}
