//! One scene's TSDF as a file that the planner reads.

use program::{ExitCode, Failure};
use schema::Grid;
use shards::Dataset;

use crate::npy;

/// A scene's TSDF as a `.npy` of float32, `[40, 40, 40]`, in VGN's values: `graspmill plan --tsdf` plans on it.
///
/// # Errors
/// [`Failure`] if the scene cannot be read, or the dataset's grid is not the planner's.
pub fn tsdf(dataset: &Dataset, scene_id: u64) -> Result<Vec<u8>, Failure> {
    let (grid, wanted) = (dataset.info().grid, Grid::PAPER);
    if grid.resolution != wanted.resolution || (grid.size_m - wanted.size_m).abs() >= 1e-6 {
        let told = |grid: Grid| (grid.resolution, grid.size_m);
        let ((side, wanted_m), (resolution, size_m)) = (told(wanted), told(grid));
        let text = format!(
            "the dataset's grid must have {side} voxels a side over {wanted_m} m, got {resolution} over {size_m} m: {}",
            dataset.location()
        );
        return Err(Failure::new(ExitCode::Config, text));
    }
    Ok(npy::f32s(&[grid.resolution; 3], &dataset.read_scene(scene_id)?.scene.tsdf))
}

#[cfg(test)]
mod tests {
    use shards::Draft;

    use super::*;
    use crate::synthetic;

    fn dataset(folder: &std::path::Path, resolution: usize) -> Dataset {
        let mut info = synthetic::info(7, 1, 20, 10);
        info.grid = Grid { resolution, ..Grid::PAPER };
        let draft = Draft::begin(folder, &info).unwrap();
        let mut writer = draft.shard(0).unwrap();
        for scene in info.scenes_of(0) {
            writer.push(&synthetic::scene_rows(scene, info.seed, &info)).unwrap();
        }
        writer.commit().unwrap();
        draft.finalize().unwrap();
        Dataset::open(folder).unwrap()
    }

    #[test]
    fn a_scenes_values_are_written_as_they_are_stored() {
        let folder = tempfile::tempdir().unwrap();
        let dataset = dataset(folder.path(), 40);
        let stored = synthetic::scene_rows(1, dataset.info().seed, dataset.info()).scene.tsdf;
        let bytes = tsdf(&dataset, 1).unwrap();
        let (head, values) = bytes.split_at(bytes.len() - 4 * 64_000);
        assert!(
            String::from_utf8_lossy(head).contains("'descr': '<f4', 'fortran_order': False, 'shape': (40, 40, 40,)")
        );
        assert!(values == stored.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>());
        let error = tsdf(&dataset, 2).unwrap_err();
        assert_eq!(
            (error.exit_code(), error.to_string()),
            (ExitCode::Config, "scene must be below 2, got 2".to_owned())
        );
    }

    #[test]
    fn other_grids_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let error = tsdf(&dataset(folder.path(), 8), 0).unwrap_err();
        assert_eq!(error.exit_code(), ExitCode::Config);
        let message = error.to_string();
        assert!(message.contains("40 voxels a side over 0.3 m, got 8 over 0.3 m"), "{message}");
    }
}
