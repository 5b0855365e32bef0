//! What a judge sees of grasps, for networks of others.

use network::judge::{BOX, CHANNELS, Crop, FACTS, JudgeInputs, PaddedGrid, WIDE_BOX, WIDE_CHANNELS};
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use program::Failure;
use pyo3::prelude::*;
use rayon::prelude::*;
use schema::{Grid, Vec3};

use crate::fault::{array, free, raised, reserved, room};
use crate::pool::on_threads;
use crate::scene::{Simulation, poses};

/// Grasps that one thread cuts out together.
const TOGETHER: usize = 16;

/// Grasps that are cut out before they are added to the others, and between two looks for a signal.
const AT_A_TIME: usize = 1024;

/// Values of a grasp: its crop, its surroundings, its facts.
const VALUES: [usize; 3] =
    [BOX[0] * BOX[1] * BOX[2] * CHANNELS, WIDE_BOX[0] * WIDE_BOX[1] * WIDE_BOX[2] * WIDE_CHANNELS, FACTS];

/// How some grippers are seen in grids of one kind.
#[pyclass(frozen, module = "graspmill._native")]
#[derive(Debug)]
pub(crate) struct Crops {
    pub(crate) crops: Vec<Crop>,
    resolution: usize,
}

impl Crops {
    pub(crate) fn of<'a>(grippers: impl Iterator<Item = (&'a schema::Gripper, f32)>, grid: &Grid) -> Self {
        let crops = grippers.map(|(gripper, pregrasp_m)| Crop::new(gripper, pregrasp_m, grid)).collect();
        Self { crops, resolution: grid.resolution }
    }
}

#[pymethods]
impl Crops {
    /// Of one gripper, in grids of so many voxels along a side, of a size, with the table's top at a height, in metres.
    #[new]
    fn new(simulation: &Simulation, resolution: usize, size_m: f32, table_z_m: f32) -> Self {
        let grid = Grid { resolution, size_m, table_z_m };
        Self::of([(&simulation.gripper, simulation.procedure.pregrasp_distance_m)].into_iter(), &grid)
    }

    /// Crops, surroundings and facts, flat, of poses in grids (flat; VGN's values). Of each pose its grid's place among
    /// them, which of the grippers it is of, the number of views, and whether it is mirrored in x (1), y (2) or both
    /// (3). And of each whether it hits the table for certain, so that there is nothing to ask.
    #[expect(clippy::type_complexity, reason = "its caller in Python unpacks it")]
    fn see<'py>(
        &self,
        py: Python<'py>,
        grids: PyReadonlyArray1<'_, f32>,
        workspace_from_grasp: PyReadonlyArray2<'_, f32>,
        rows: PyReadonlyArray2<'_, u32>,
    ) -> PyResult<([Bound<'py, PyArray1<f32>>; 3], Bound<'py, PyArray1<bool>>)> {
        // A grid is held again as it came, and padded, with two numbers for each of its own. Of the grasps that are cut
        // out there is a copy, and what is being made.
        let grasps = workspace_from_grasp.as_array().nrows();
        let values = VALUES.iter().sum::<usize>() * (grasps + 2 * grasps.min(AT_A_TIME));
        room(size_of::<f32>() * (4 * grids.as_array().len() + values))?;
        let (grids, poses) = (grids.as_array(), poses(&workspace_from_grasp));
        let rows: Vec<[usize; 4]> =
            rows.as_array().rows().into_iter().map(|row| std::array::from_fn(|at| row[at] as usize)).collect();
        let flat: Vec<f32> = grids.iter().copied().collect();
        let pad = |values| PaddedGrid::new(Vec3::ZERO, [self.resolution; 3], values);
        let pad_all = || flat.par_chunks_exact(self.resolution.pow(3)).map(pad).collect();
        let padded: Vec<PaddedGrid> = free(py, || on_threads(0, pad_all))?;
        let part = |(poses, rows): (&[schema::Pose], &[[usize; 4]])| {
            let mut inputs = JudgeInputs::with_capacity(poses.len());
            for (pose, [grid, gripper, views, mirrored]) in poses.iter().zip(rows) {
                let mirrored = [mirrored & 1 == 1, mirrored & 2 == 2];
                inputs.push(&self.crops[*gripper], &padded[*grid], pose, *views, mirrored);
            }
            inputs.without_padding()
        };
        let mut all = [const { Vec::new() }; 3];
        for (all, values) in all.iter_mut().zip(VALUES) {
            *all = reserved(values * poses.len()).map_err(|failure| raised(&failure))?;
        }
        for (poses, rows) in poses.chunks(AT_A_TIME).zip(rows.chunks(AT_A_TIME)) {
            py.check_signals()?;
            let see = || poses.par_chunks(TOGETHER).zip(rows.par_chunks(TOGETHER)).map(part).collect::<Vec<_>>();
            free(py, || {
                for part in on_threads(0, see)? {
                    all.iter_mut().zip(part).for_each(|(all, part)| all.extend(part));
                }
                Ok::<_, Failure>(())
            })?;
        }
        let hits = poses.iter().zip(&rows).map(|(pose, row)| self.crops[row[1]].hits_table(pose)).collect();
        let [crops, wide, facts] = all;
        Ok(([array(py, crops)?, array(py, wide)?, array(py, facts)?], array(py, hits)?))
    }
}
