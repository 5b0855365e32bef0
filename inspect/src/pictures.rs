//! Scenes of a dataset as pictures.

use program::text::grouped;
use report::document::Picture;
use report::picture::{Grasp, Scene, svg};
use report::view::folder::scene_file;
use schema::{AttemptRecord, ObjectRecord, Polyhedron, SceneRows};
use shards::DatasetInfo;

use crate::view::attempt_label;

/// Up to `count` of these scenes, one from each of as many equal parts: at places within the parts that do not repeat
/// (multiples of the golden ratio), for grippers take turns from scene to scene.
#[must_use]
pub fn spread(scenes: &[u64], count: usize) -> Vec<u64> {
    const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;
    let count = count.min(scenes.len());
    let start = |part: usize| part * scenes.len() / count;
    let place = |part: usize| {
        let long = (start(part + 1) - start(part)) as u128;
        start(part) + ((u128::from(GOLDEN.wrapping_mul(part as u64)) * long) >> 64) as usize
    };
    (0..count).map(|part| scenes[place(part)]).collect()
}

/// A scene with all its attempts, drawn or in words alone; `is_link`: it leads to the scene's page in the same folder.
pub(crate) fn picture(info: &DatasetInfo, rows: &SceneRows, is_drawn: bool, is_link: bool) -> Picture {
    let held = rows.attempts.iter().filter(|attempt| attempt.label() == 1).count();
    let objects = rows.objects.len();
    Picture {
        svg: if is_drawn { scene_svg(info, rows) } else { String::new() },
        title: format!("Scene {}", grouped(rows.scene.scene_id)),
        caption: format!(
            "{objects} {}; {held} of {} attempts held",
            if objects == 1 { "object" } else { "objects" },
            rows.attempts.len()
        ),
        link: is_link.then(|| scene_file(rows.scene.scene_id)),
    }
}

fn scene_svg(info: &DatasetInfo, rows: &SceneRows) -> String {
    let drawn = |attempt: &AttemptRecord| Grasp {
        workspace_from_grasp: attempt.workspace_from_grasp,
        width_m: attempt.width_m.unwrap_or(info.gripper_of(attempt.scene_id).opening_m_max),
        outcome: attempt.outcome,
        label: attempt_label(attempt),
    };
    svg(&Scene {
        size_m: info.grid.size_m,
        table_z_m: info.grid.table_z_m,
        bodies: rows.objects.iter().flat_map(bodies).collect(),
        fixtures: rows.scene.fixtures(&info.grid),
        grasps: rows.attempts.iter().map(drawn).collect(),
    })
}

fn bodies(object: &ObjectRecord) -> impl Iterator<Item = (Polyhedron, usize)> {
    let parts = object.shape.parts().into_iter();
    parts.map(|part| (part.moved(&object.workspace_from_object), object.object_id as usize))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_are_spread_without_repeating_and_do_not_walk_in_step() {
        let all: Vec<u64> = (0..100).collect();
        let shown = spread(&all, 12);
        assert!(shown.len() == 12 && shown.windows(2).all(|pair| pair[0] < pair[1]), "{shown:?}");
        assert!(
            shown
                .iter()
                .enumerate()
                .all(|(part, scene)| (part as u64 * 100 / 12..(part as u64 + 1) * 100 / 12).contains(scene))
        );
        for grippers in 2..=4 {
            let turns: std::collections::BTreeSet<u64> = shown.iter().map(|scene| scene % grippers).collect();
            assert_eq!(turns.len() as u64, grippers, "of {grippers} grippers that take turns all are seen: {shown:?}");
        }
        assert_eq!(spread(&[3, 5], 12), [3, 5]);
        assert_eq!(spread(&[], 12), Vec::<u64>::new());
    }
}
