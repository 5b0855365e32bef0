//! A dataset's scene reaches the planner by the file that `graspmill dataset tsdf` writes, and gives the plan of the
//! stored values.

use planner::input::read_tsdf;
use planner::{BuiltIn, Observation, PlanOptions, Planner};
use schema::{Grid, VoxelGrid};
use shards::{Dataset, Draft};

use crate::synthetic;

#[test]
fn a_stored_scenes_file_gives_the_plan_of_its_stored_values() {
    let folder = tempfile::tempdir().unwrap();
    let info = synthetic::info(7, 1, 20, 10);
    assert_eq!(info.grid.resolution, Grid::PAPER.resolution);
    let draft = Draft::begin(folder.path(), &info).unwrap();
    let mut writer = draft.shard(0).unwrap();
    for scene in info.scenes_of(0) {
        writer.push(&synthetic::scene_rows(scene, info.seed, &info)).unwrap();
    }
    writer.commit().unwrap();
    draft.finalize().unwrap();

    let dataset = Dataset::open(folder.path()).unwrap();
    let stored = VoxelGrid::new(Grid::PAPER, dataset.read_scene(1).unwrap().scene.tsdf).unwrap();
    let file = read_tsdf(&inspect::tsdf(&dataset, 1).unwrap(), Grid::PAPER).unwrap();
    let planner = Planner::built_in(BuiltIn::Paper.config().unwrap()).unwrap();
    let options = PlanOptions { explain: true, ..PlanOptions::default() };
    let json = |voxels: VoxelGrid| {
        let plan = planner.plan(&Observation::Tsdf(voxels), &options).unwrap();
        serde_json::to_string(&plan).unwrap()
    };
    assert_eq!(json(file), json(stored));
}
