//! The three tables in the folders and under the names that they have in the dataset, written for old readers
//! ([`Dataset::write_plain`]). `meta/info.json` lies beside them, but no manifest, so that no program takes an export
//! for the dataset.

use std::path::Path;

use program::{Context, Failure};
use shards::layout::{INFO, table_file};
use shards::{Dataset, Table};

use super::{ExportCounts, ExportOrigin, failed, finish, part};

/// The folders of an export, in which its files lie.
pub(super) const FOLDERS: [&str; 5] = ["", "attempts", "scenes", "objects", "meta"];

/// Writes everything but `export.json`, and of a shard's tables those that are not there.
pub(super) fn write(
    dataset: &Dataset,
    folder: &Path,
    origin: &ExportOrigin,
    scenes_done: &mut dyn FnMut(u64),
) -> Result<ExportCounts, Failure> {
    for shard in 0..dataset.shard_count() {
        for table in Table::ALL {
            let path = folder.join(table_file(table, shard, dataset.shard_count()));
            if !path.is_file() {
                let file = program::create(&part(&path)).context(failed(&path))?;
                dataset.write_plain(shard, table, &file).context(failed(&path))?;
                finish(&file, &path)?;
            }
        }
        let scenes = dataset.info().scenes_of(shard);
        scenes_done(scenes.end - scenes.start);
    }
    program::write(&folder.join(INFO), dataset.info().to_json())?;
    program::write(&folder.join("README.md"), page(origin))?;
    let labels = dataset.manifest().totals.labels;
    let (grasps, positives, scenes) = (labels.attempts, labels.positives, dataset.info().scene_count);
    Ok(ExportCounts { attempts: grasps, grasps, positives, scenes, ..ExportCounts::default() })
}

fn page(origin: &ExportOrigin) -> String {
    let ExportOrigin { exporter_version, dataset_id, dataset_code_version, dataset_seed, .. } = origin;
    format!(
        "# Grasp attempts in plain Parquet

Exported by Graspmill {exporter_version} from dataset `{dataset_id}` (made by {dataset_code_version} from seed {dataset_seed}).

`attempts`, `scenes` and `objects` are the dataset's tables, row by row and bit by bit, for old readers of Parquet: floats are in the
plain encoding. `meta/info.json` has its settings. The dataset's own page describes the columns.
"
    )
}
