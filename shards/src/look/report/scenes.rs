//! Scenes of a dataset as pictures.

use program::Failure;
use program::text::grouped;
use report::document::{Drawing, Picture};
use report::picture::{Hand, Scene, svg, width_m};
use schema::{AttemptRecord, ObjectRecord, Polyhedron, SceneRows};

use crate::{Dataset, DatasetInfo};

/// Pictures of up to `count` scenes, spread evenly over the dataset.
pub(super) fn gallery(dataset: &Dataset, count: u64) -> Result<Vec<Picture>, Failure> {
    let scenes = dataset.info().scene_count;
    let count = count.min(scenes);
    (0..count).map(|at| Ok(picture(dataset.info(), &dataset.read_scene(at * scenes / count)?))).collect()
}

fn picture(info: &DatasetInfo, rows: &SceneRows) -> Picture {
    let held = rows.attempts.iter().filter(|attempt| attempt.label() == 1).count();
    let objects = rows.objects.len();
    Picture::new(
        Drawing::Svg(scene_svg(info, rows, &rows.attempts, 0.4)),
        format!("Scene {}", grouped(rows.scene.scene_id)),
        format!(
            "{objects} {}; {held} of {} attempts held",
            if objects == 1 { "object" } else { "objects" },
            rows.attempts.len()
        ),
    )
}

/// A scene and the hand of each of these attempts, as SVG; hands that failed are drawn with a strength from 0 to 1.
#[must_use]
pub fn scene_svg(info: &DatasetInfo, rows: &SceneRows, attempts: &[AttemptRecord], failed_strength: f32) -> String {
    let hand = |attempt: &AttemptRecord| Hand {
        workspace_from_grasp: attempt.workspace_from_grasp,
        width_m: width_m(&info.gripper, attempt.width_m),
        held: attempt.label() == 1,
        strength: if attempt.label() == 1 { 1.0 } else { failed_strength },
    };
    svg(&Scene {
        size_m: info.grid.size_m,
        table_z_m: info.grid.table_z_m,
        bodies: rows.objects.iter().flat_map(bodies).collect(),
        hands: attempts.iter().map(hand).collect(),
    })
}

fn bodies(object: &ObjectRecord) -> impl Iterator<Item = (Polyhedron, usize)> {
    let parts = object.shape.parts().into_iter();
    parts.map(|part| (part.moved(&object.workspace_from_object), object.object_id as usize))
}
