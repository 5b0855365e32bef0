//! WebDataset: a tar for each shard with a sample for each scene. The files of a sample are consecutive and share the
//! scene's name; the extension after the first dot determines the content and its decoder.
//!
//! ```text
//! scene-….grid.npy        float32, (1, R, R, R)
//! scene-….grasps.npy      float32, (attempts, 8): x_m, y_m, z_m, qx, qy, qz, qw, width_m (NaN: never closed)
//! scene-….labels.npy      uint8, (attempts,)
//! scene-….attempts.json   rows of `attempts`, every column by its name
//! scene-….objects.json    rows of `objects`
//! scene-….scene.json      row of `scenes` without the grid
//! ```

use std::io::{self, BufWriter, Write};

use arrow::error::ArrowError;
use program::Failure;
use program::text::grouped;
use schema::{AttemptRecord, SceneRows};
use tar::{Builder, EntryType, Header};

use super::folder::{ExportCounts, ExportFolder, Exported, ExportedFile};
use super::{npy, rows, scene_name};
use crate::format::encode;
use crate::store::failed;
use crate::{Dataset, DatasetInfo, Table};

const INFO: &str = "info.json";
const PAGE: &str = "README.md";

/// Writes the export.
pub(super) fn write(
    dataset: &Dataset,
    folder: ExportFolder,
    scenes_done: &mut dyn FnMut(u64),
) -> Result<Exported, Failure> {
    let info = dataset.info();
    folder.sweep("")?;
    let mut files = Vec::new();
    for shard in 0..dataset.shard_count() {
        let name = format!("shard-{shard:05}-of-{:05}.tar", info.shard_count);
        let scenes = info.scenes_of(shard);
        let scenes = scenes.end - scenes.start;
        let (bytes, sha256) = match (folder.storage.size(&name)?, folder.storage.digest(&name)?) {
            (Some(bytes), Some(sha256)) => {
                scenes_done(scenes);
                (bytes, sha256)
            }
            _ => write_shard(dataset, shard, &name, &folder, scenes_done)?,
        };
        files.push(ExportedFile { name, bytes, sha256, scenes });
    }
    let totals = &dataset.manifest().totals;
    let counts = ExportCounts {
        attempts: totals.labels.attempts,
        grasps: totals.labels.attempts,
        positives: totals.labels.positives,
        left_out: 0,
        scenes: info.scene_count,
        scenes_left_out: 0,
    };
    folder.storage.publish(INFO, info.to_json().as_bytes())?;
    folder.storage.publish(PAGE, page(&folder, info, &counts).as_bytes())?;
    folder.finish(counts, files)
}

/// Writes the tar of a shard; returns its size and SHA-256.
fn write_shard(
    dataset: &Dataset,
    shard: u32,
    name: &str,
    folder: &ExportFolder,
    scenes_done: &mut dyn FnMut(u64),
) -> Result<(u64, String), Failure> {
    let failed = |error: io::Error| failed("write a file", folder.storage.location(name))(error);
    let mut tar = Builder::new(BufWriter::new(folder.storage.stage(name)?));
    for rows in dataset.joined(shard, dataset.scenes(shard)?)? {
        append_sample(&mut tar, &rows?, dataset.info()).map_err(failed)?;
        scenes_done(1);
    }
    let buffer = tar.into_inner().map_err(failed)?;
    let staged = buffer.into_inner().map_err(|e| failed(e.into_error()))?;
    let ready = staged.finish()?;
    let written = (ready.bytes, ready.sha256.clone());
    ready.publish()?;
    Ok(written)
}

fn append_sample(tar: &mut Builder<impl Write>, rows: &SceneRows, info: &DatasetInfo) -> io::Result<()> {
    let (form, resolution) = (info.form(), info.grid.resolution);
    let told = |error: ArrowError| io::Error::other(error.to_string());
    let key = scene_name(rows.scene.scene_id);
    let grasps: Vec<f32> = rows.attempts.iter().flat_map(grasp).collect();
    let labels: Vec<u8> = rows.attempts.iter().map(AttemptRecord::label).collect();
    let attempts = encode::attempts(&rows.attempts, &info.models).map_err(told)?;
    let objects = encode::objects(&rows.objects, &info.models).map_err(told)?;
    let scene = encode::scenes(std::slice::from_ref(&rows.scene), info).map_err(told)?;
    let mut append = |ending: &str, bytes: &[u8]| append(tar, &format!("{key}.{ending}"), bytes);
    append("grid.npy", &npy::f32s(&[1, resolution, resolution, resolution], &rows.scene.tsdf))?;
    append("grasps.npy", &npy::f32s(&[rows.attempts.len(), 8], &grasps))?;
    append("labels.npy", &npy::u8s(&labels))?;
    append("attempts.json", rows::array(&rows::json(Table::Attempts, form, &attempts)).as_bytes())?;
    append("objects.json", rows::array(&rows::json(Table::Objects, form, &objects)).as_bytes())?;
    append("scene.json", format!("{}\n", rows::json(Table::Scenes, form, &scene).concat()).as_bytes())
}

fn grasp(attempt: &AttemptRecord) -> [f32; 8] {
    let pose = &attempt.workspace_from_grasp;
    let ([x, y, z], [qx, qy, qz, qw]) = (pose.translation.to_array(), pose.rotation.to_array());
    [x, y, z, qx, qy, qz, qw, attempt.width_m.unwrap_or(f32::NAN)]
}

/// A file of the tar, without owner and time, so that the same dataset gives the same bytes.
fn append(tar: &mut Builder<impl Write>, name: &str, bytes: &[u8]) -> io::Result<()> {
    let mut header = Header::new_ustar();
    header.set_entry_type(EntryType::Regular);
    header.set_mode(0o644);
    header.set_uid(0);
    header.set_gid(0);
    header.set_mtime(0);
    header.set_size(bytes.len() as u64);
    tar.append_data(&mut header, name, bytes)
}

fn page(folder: &ExportFolder, info: &DatasetInfo, counts: &ExportCounts) -> String {
    let last = info.shard_count - 1;
    format!(
        "# Grasp attempts as a WebDataset

{told} `info.json` is the dataset's: units, frames,
hand, procedure, config.

{attempts} attempts ({positives} held) in {scenes} scenes; nothing was left out. A sample is a scene:

| file | what |
|---|---|
| `grid.npy` | float32 (1, {side}, {side}, {side}), `grid[0, x, y, z]`: (tsdf + 1) / 2 where observed and \\|tsdf\\| < 0.98, else 0 |
| `grasps.npy` | float32 (attempts, 8): `x_m`, `y_m`, `z_m`, `qx`, `qy`, `qz`, `qw`, `width_m`; NaN if the fingers never closed |
| `labels.npy` | uint8 (attempts,): 1 if the object was held |
| `attempts.json`, `objects.json` | the rows with all their columns |
| `scene.json` | the scene's row, but for the grid |

```python
import numpy as np, webdataset as wds

samples = wds.WebDataset(\"shard-{{00000..{last:05}}}-of-{count:05}.tar\", shardshuffle=False).decode()
for grid, grasps, labels in samples.to_tuple(\"grid.npy\", \"grasps.npy\", \"labels.npy\"):
    voxels = np.floor(grasps[:, :3] / ({size_m} / {side})).astype(int)
    inside = ((voxels >= 0) & (voxels < {side})).all(axis=1)    # grasps outside the grid are in the data: no voxel learns from them
```

Rows of one scene may share a voxel: the yaws at one point of VGN's sampler are attempts of their own.
",
        told = folder.origin.told(),
        attempts = grouped(counts.attempts),
        positives = grouped(counts.positives),
        scenes = grouped(counts.scenes),
        side = info.grid.resolution,
        size_m = info.grid.size_m,
        count = info.shard_count,
    )
}
