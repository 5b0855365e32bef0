//! The files that the code of VGN (Breyer et al. 2020) and GIGA (Jiang et al. 2021) trains on.
//!
//! ```text
//! grasps.csv             scene_id,qx,qy,qz,qw,i,j,k,width,label; i, j, k and width in voxels
//! scenes/scene-….npz     grid: float32, (1, 40, 40, 40)
//! raw/grasps.csv         the same rows, x, y, z in place of i, j, k, in metres: GIGA's loader reads these
//! raw/setup.json         size, intrinsic, max_opening_width, finger_depth
//! ```
//!
//! VGN's grasps have their origin between the roots of the fingers, ours between the tips. i, j, k are positions
//! divided by the voxel's side: VGN rounds them, so that a grasp gets the voxel whose lower corner is nearest, and its
//! detection takes that corner for the grasp's place. What VGN's recipe throws away (its notebook `data.ipynb`, GIGA's
//! `clean_balance_data.py`) is left out: grasps nearer to the workspace's faces than 20 mm. Some of them would have no
//! voxel, or none after a quarter turn.

use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use program::text::grouped;
use program::{Context, Failure};
use schema::{AttemptRecord, CameraParams, Gripper, Intrinsics, Vec3, samples_of};
use serde::Serialize;
use shards::{Dataset, DatasetInfo};

use super::{ExportCounts, ExportOrigin, failed, finish, part};
use crate::npy;

/// Voxels along a side in VGN's and GIGA's code, where the number stands in the network and the augmentation.
const RESOLUTION: usize = 40;
/// What is nearer to a face of the workspace is left out, as VGN's recipe does.
const MARGIN_M: f32 = 0.02;

/// The folders of an export, in which its files lie.
pub(super) const FOLDERS: [&str; 3] = ["", "scenes", "raw"];

/// Whether a dataset fits the format; else why it does not.
pub(super) fn suited(info: &DatasetInfo) -> Result<(), String> {
    let (taken, got) = (RESOLUTION, info.grid.resolution);
    match info.hands() {
        _ if got != taken => Err(format!("VGN's code takes grids of {taken}^3 voxels, the dataset has {got}^3")),
        [_] => Ok(()),
        hands => Err(format!("VGN's format has one hand, the dataset has {}", hands.len())),
    }
}

/// A grasp as VGN writes it, in metres.
struct Row {
    scene_id: u64,
    /// x, y, z, w.
    quaternion: [f32; 4],
    /// Midway between the roots of the fingers.
    origin_m: Vec3,
    width_m: f32,
    label: u8,
}

impl Row {
    /// `sample` is one of [`samples_of`]. A grasp that failed has the hand's opening for its width, as in VGN's data.
    fn new(sample: &AttemptRecord, gripper: &Gripper) -> Self {
        let pose = &sample.workspace_from_grasp;
        let label = sample.label();
        Self {
            scene_id: sample.scene_id,
            quaternion: pose.rotation.to_array(),
            origin_m: gripper.finger_roots_m(pose),
            width_m: sample.width_m.filter(|_| label == 1).unwrap_or(gripper.opening_m_max),
            label,
        }
    }

    /// Its line of a table that measures lengths in this unit.
    fn line(&self, unit_m: f32) -> String {
        let [x, y, z] = self.origin_m.to_array();
        let lengths = [x, y, z, self.width_m].map(|length_m| length_m / unit_m);
        let reals: String = self.quaternion.into_iter().chain(lengths).map(|real| format!("{real},")).collect();
        format!("{},{reals}{}\n", scene_name(self.scene_id), self.label)
    }

    fn is_inside(&self, info: &DatasetInfo) -> bool {
        let margin_m = MARGIN_M.max(info.grid.voxel_size_m());
        let range = margin_m..=info.grid.size_m - margin_m;
        self.origin_m.to_array().iter().all(|coordinate| range.contains(coordinate))
    }
}

/// A table of grasps; it gets its name when it is complete.
struct Table {
    file: File,
    path: PathBuf,
    /// The length that counts as 1, in metres.
    unit_m: f32,
}

impl Table {
    /// `axes` are the names of the origin's columns.
    fn begin(path: PathBuf, axes: &str, unit_m: f32) -> Result<Self, Failure> {
        let file = program::create(&part(&path)).context(failed(&path))?;
        let mut table = Self { file, path, unit_m };
        table.put(&format!("scene_id,qx,qy,qz,qw,{axes},width,label\n"))?;
        Ok(table)
    }

    fn put(&mut self, lines: &str) -> Result<(), Failure> {
        self.file.write_all(lines.as_bytes()).context(failed(&self.path))
    }
}

/// Writes everything but `export.json`.
pub(super) fn write(
    dataset: &Dataset,
    folder: &Path,
    origin: &ExportOrigin,
    scenes_done: &mut dyn FnMut(u64),
) -> Result<ExportCounts, Failure> {
    let info = dataset.info();
    let mut tables = [
        Table::begin(folder.join("grasps.csv"), "i,j,k", info.grid.voxel_size_m())?,
        Table::begin(folder.join("raw/grasps.csv"), "x,y,z", 1.0)?,
    ];
    let mut counts = ExportCounts { attempts: info.attempt_count, ..ExportCounts::default() };
    for shard in 0..dataset.shard_count() {
        let samples = samples_of(&dataset.read_attempts(shard)?);
        let rows = samples.iter().map(|sample| Row::new(sample, &info.gripper));
        let rows: Vec<Row> = rows.filter(|row| row.is_inside(info)).collect();
        for table in &mut tables {
            table.put(&rows.iter().map(|row| row.line(table.unit_m)).collect::<String>())?;
        }
        let mut scenes: Vec<u64> = rows.iter().map(|row| row.scene_id).collect();
        scenes.dedup();
        counts.left_out += (samples.len() - rows.len()) as u64;
        counts.grasps += rows.len() as u64;
        counts.positives += rows.iter().map(|row| u64::from(row.label)).sum::<u64>();
        counts.scenes += scenes.len() as u64;
        write_grids(dataset, shard, scenes, folder, scenes_done)?;
    }
    counts.scenes_left_out = info.scene_count - counts.scenes;
    tables.iter().try_for_each(|table| finish(&table.file, &table.path))?;
    program::write(&folder.join("raw/setup.json"), setup(info)?)?;
    program::write(&folder.join("README.md"), page(origin, info, &counts))?;
    Ok(counts)
}

/// Writes the grids of these scenes of a shard, but for those that are there.
fn write_grids(
    dataset: &Dataset,
    shard: u32,
    mut scenes: Vec<u64>,
    folder: &Path,
    scenes_done: &mut dyn FnMut(u64),
) -> Result<(), Failure> {
    let path = |scene_id: u64| folder.join(format!("scenes/{}.npz", scene_name(scene_id)));
    scenes.retain(|scene_id| !path(*scene_id).is_file());
    let all = dataset.info().scenes_of(shard);
    scenes_done(all.end - all.start - scenes.len() as u64);
    if scenes.is_empty() {
        return Ok(());
    }
    for rows in dataset.some_scenes(shard, scenes)? {
        let scene = rows?.scene;
        let path = path(scene.scene_id);
        let grid = npy::f32s(&[1, RESOLUTION, RESOLUTION, RESOLUTION], &scene.tsdf);
        program::write(&path, npy::npz("grid", &grid).context(failed(&path))?)?;
        scenes_done(1);
    }
    Ok(())
}

/// The name of a scene's files. It begins with letters, because pandas would read a name of digits as a number, and
/// VGN's code could not make a file name of it.
fn scene_name(scene_id: u64) -> String {
    format!("scene-{scene_id:09}")
}

#[derive(Serialize)]
struct Setup {
    size: f32,
    intrinsic: Intrinsic,
    max_opening_width: f32,
    finger_depth: f32,
}

#[derive(Serialize)]
struct Intrinsic {
    width: usize,
    height: usize,
    #[serde(rename = "K")]
    matrix: [f32; 9],
}

/// VGN's `setup.json`: side of the workspace, camera, opening of the hand, length of its fingers.
fn setup(info: &DatasetInfo) -> Result<String, Failure> {
    let lens = info.section::<CameraParams>("camera").map_or(Intrinsics::VGN, |camera| camera.intrinsics());
    program::json(&Setup {
        size: info.grid.size_m,
        intrinsic: Intrinsic {
            width: lens.width_px,
            height: lens.height_px,
            matrix: [lens.fx_px, 0.0, lens.cx_px, 0.0, lens.fy_px, lens.cy_px, 0.0, 0.0, 1.0],
        },
        max_opening_width: info.gripper.opening_m_max,
        finger_depth: info.gripper.finger_length_m,
    })
}

fn page(origin: &ExportOrigin, info: &DatasetInfo, counts: &ExportCounts) -> String {
    let ExportOrigin { exporter_version, dataset_id, dataset_code_version, dataset_seed, .. } = origin;
    format!(
        "# Grasps in VGN's format

Exported by Graspmill {exporter_version} from dataset `{dataset_id}` (made by {dataset_code_version} from seed {dataset_seed}).

{grasps} grasps ({positives} held) of {attempts} attempts in {scenes} scenes. {left_out} grasps were left out because their origin lies
nearer than {margin_mm} mm to a face of the workspace, as VGN's recipe does, and {scenes_left_out} scenes because no grasp of theirs was
left. The attempts along one point's normal make one grasp, the middle of the widest run of yaws that held.

- VGN: `Dataset(Path(\"this folder\"))` reads `grasps.csv` and `scenes/`. `i`, `j`, `k`, `width`: voxels of {voxel_mm} mm.
- GIGA: `DatasetVoxel(Path(\"this folder\"), Path(\"this folder/raw\"))` reads `raw/grasps.csv` and `raw/setup.json`. `x`, `y`, `z`,
  `width`: metres.
- `qx`, `qy`, `qz`, `qw`: workspace from grasp; the hand approaches along its +z and closes along y. The grasp's origin lies midway
  between the roots of the fingers, {finger_mm} mm behind their tips.
- `width`: opening between the fingers at the end of the hold; where the object was not held, the hand's largest opening.
- `grid`: (tsdf + 1) / 2 where observed and |tsdf| < 0.98, else 0; `grid[0, x, y, z]`.
",
        grasps = grouped(counts.grasps),
        positives = grouped(counts.positives),
        attempts = grouped(counts.attempts),
        scenes = grouped(counts.scenes),
        left_out = grouped(counts.left_out),
        scenes_left_out = grouped(counts.scenes_left_out),
        margin_mm = millimetres(MARGIN_M.max(info.grid.voxel_size_m())),
        voxel_mm = millimetres(info.grid.voxel_size_m()),
        finger_mm = millimetres(info.gripper.finger_length_m),
    )
}

/// For people, to a thousandth of a millimetre.
fn millimetres(length_m: f32) -> f64 {
    (f64::from(length_m) * 1e6).round() / 1e3
}
