//! The dataset card: `README.md` for the Hugging Face Hub and for users.

use program::text::{grouped, percent, ratio};

use crate::DatasetInfo;
use crate::format::summary::Manifest;

/// The Hub's value for an unspecified licence is `unknown`. Only the owners of the data can choose one; they edit the
/// card, which is then not overwritten.
const HEAD: &str = "\
---
pretty_name: Grasp attempts in simulation
license: unknown
task_categories: [robotics]
tags: [robotics, grasping, simulation, parallel-jaw, tsdf]
configs:
- {config_name: attempts, data_files: \"attempts/*.parquet\", default: true}
- {config_name: scenes, data_files: \"scenes/*.parquet\"}
- {config_name: objects, data_files: \"objects/*.parquet\"}
";

/// By powers of ten, from 1,000 on.
const SIZES: [&str; 8] = ["n<1K", "1K<n<10K", "10K<n<100K", "100K<n<1M", "1M<n<10M", "10M<n<100M", "100M<n<1B", "n>1B"];

const TABLES: &str = "\
`attempts` has a row a grasp attempt, `objects` a row an object, `scenes` a row a scene with its voxel grid. `scene_id`
joins them; an attempt's target is the object with its `scene_id` and `object_id`. Each column's meaning is the
`description` in the Parquet metadata of its field; `graspmill manual markdown tables` prints all.

SI units; a name carries its unit. Quaternions are xyzw. `workspace`: a cube, origin at a lower corner, z up. `grasp`:
origin midway between the finger tips, +z approach, +y closing; a half turn about z is the same grasp. Frames, gripper,
the attempt's procedure and the convex parts of objects that are no primitives stand in `meta/info.json`.

A `rule` is a row of the paper's Appendix A, or it ends in `_normal` (VGN's: along the normal of a seen surface point),
`_proposal` (touches what was seen, and stands free), `_displaced` (a grasp that held, moved a little) or `_judged` (a
proposal that a judge held for the best).
";

/// The text of the card. The same dataset always has the same card.
pub(crate) fn card(info: &DatasetInfo, manifest: &Manifest) -> String {
    let (totals, labels) = (&manifest.totals, manifest.totals.labels);
    let size = SIZES[(labels.attempts.max(1).ilog10().saturating_sub(2) as usize).min(SIZES.len() - 1)];
    format!(
        "{HEAD}size_categories: [{size}]\n---\n\n# Grasp attempts in simulation\n\n{} parallel-jaw grasp attempts on {} objects in \
         {} random stacked scenes, executed in physics and labelled by how they ended. Positives : negatives = **{}** ({} held the \
         object). Made by Graspmill {} from seed {}; `meta/info.json` holds everything needed to make it again, byte for \
         byte.\n\n{TABLES}",
        grouped(labels.attempts),
        grouped(totals.objects),
        grouped(totals.scenes),
        ratio(labels.positives, labels.negatives()),
        percent(labels.positive_share()),
        info.code_version,
        info.seed,
    )
}
