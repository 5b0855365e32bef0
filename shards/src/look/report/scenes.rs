//! Scenes of a dataset as pictures.

use program::text::grouped;
use report::page::Picture;
use report::picture::{Hand, Scene, svg, width_m};
use schema::{ObjectRecord, Polyhedron, SceneRows};

use crate::{Dataset, DatasetInfo, ReadError};

/// Pictures of up to `count` scenes, spread evenly over the dataset.
pub(super) fn gallery(dataset: &Dataset, count: u64) -> Result<Vec<Picture>, ReadError> {
    let scenes = dataset.info().scene_count;
    let count = count.min(scenes);
    (0..count).map(|at| Ok(picture(dataset.info(), &dataset.read_scene(at * scenes / count)?))).collect()
}

fn picture(info: &DatasetInfo, rows: &SceneRows) -> Picture {
    let hands: Vec<Hand> = rows
        .attempts
        .iter()
        .map(|attempt| Hand {
            workspace_from_grasp: attempt.workspace_from_grasp,
            width_m: width_m(&info.gripper, attempt.width_m),
            held: attempt.label() == 1,
            strength: if attempt.label() == 1 { 1.0 } else { 0.4 },
        })
        .collect();
    let held = hands.iter().filter(|hand| hand.held).count();
    let scene = Scene {
        size_m: info.grid.size_m,
        table_z_m: info.grid.table_z_m,
        bodies: rows.objects.iter().flat_map(bodies).collect(),
        hands,
    };
    let objects = rows.objects.len();
    Picture {
        svg: svg(&scene),
        title: format!("Scene {}", grouped(rows.scene.scene_id)),
        caption: format!(
            "{objects} {}; {held} of {} attempts held",
            if objects == 1 { "object" } else { "objects" },
            rows.attempts.len()
        ),
    }
}

fn bodies(object: &ObjectRecord) -> impl Iterator<Item = (Polyhedron, usize)> {
    let parts = object.shape.parts().into_iter();
    parts.map(|part| (part.moved(&object.workspace_from_object), object.object_id as usize))
}
