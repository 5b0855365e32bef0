//! What a judge sees of hands, for networks of others.

use network::judge::{Crop, JudgeInputs, PaddedGrid};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;
use schema::Grid;

use crate::fault::free;
use crate::pool::on_threads;
use crate::scene::{Simulation, poses};

/// Hands that one thread cuts out together.
const TOGETHER: usize = 64;

/// Hands that are cut out before they are added to the others.
const AT_A_TIME: usize = 4096;

/// How some hands are seen in grids of one kind.
#[pyclass(frozen, module = "graspmill._native")]
#[derive(Debug)]
pub(crate) struct Crops {
    pub(crate) crops: Vec<Crop>,
    resolution: usize,
}

impl Crops {
    pub(crate) fn of<'a>(hands: impl Iterator<Item = (&'a schema::Gripper, f32)>, grid: &Grid) -> Self {
        let crops = hands.map(|(gripper, pregrasp_m)| Crop::new(gripper, pregrasp_m, grid)).collect();
        Self { crops, resolution: grid.resolution }
    }
}

#[pymethods]
impl Crops {
    /// Of one hand, in grids of so many voxels along a side, of a size, with the table's top at a height, in metres.
    #[new]
    fn new(hand: &Simulation, resolution: usize, size_m: f32, table_z_m: f32) -> Self {
        let grid = Grid { resolution, size_m, table_z_m };
        Self::of([(&hand.gripper, hand.procedure.pregrasp_distance_m)].into_iter(), &grid)
    }

    /// Crops, surroundings and facts, flat, of poses in grids (flat; VGN's values). Of each pose its grid's place among
    /// them, which of the hands it is, the number of views, and whether it is mirrored in x (1), y (2) or both (3). And
    /// of each whether it hits the table for certain, so that there is nothing to ask.
    #[expect(clippy::type_complexity, reason = "its caller in Python unpacks it")]
    fn see<'py>(
        &self,
        py: Python<'py>,
        grids: PyReadonlyArray1<'_, f32>,
        workspace_from_grasp: PyReadonlyArray2<'_, f32>,
        rows: PyReadonlyArray2<'_, u32>,
    ) -> PyResult<([Bound<'py, PyArray1<f32>>; 3], Bound<'py, PyArray1<bool>>)> {
        let (grids, poses) = (grids.as_array(), poses(&workspace_from_grasp));
        let rows: Vec<[usize; 4]> =
            rows.as_array().rows().into_iter().map(|row| std::array::from_fn(|at| row[at] as usize)).collect();
        let flat: Vec<f32> = grids.iter().copied().collect();
        let seen = || {
            on_threads(0, || {
                let padded: Vec<PaddedGrid> = flat
                    .par_chunks_exact(self.resolution.pow(3))
                    .map(|values| PaddedGrid::new(self.resolution, values))
                    .collect();
                let part = |(poses, rows): (&[schema::Pose], &[[usize; 4]])| {
                    let mut inputs = JudgeInputs::with_capacity(poses.len());
                    for (pose, [grid, hand, views, mirrored]) in poses.iter().zip(rows) {
                        let mirrored = [mirrored & 1 == 1, mirrored & 2 == 2];
                        inputs.push(&self.crops[*hand], &padded[*grid], pose, *views, mirrored);
                    }
                    inputs.without_padding()
                };
                // Some at a time, so that no more than the result is held twice.
                let mut all = [const { Vec::new() }; 3];
                for (poses, rows) in poses.chunks(AT_A_TIME).zip(rows.chunks(AT_A_TIME)) {
                    let parts: Vec<_> = poses.par_chunks(TOGETHER).zip(rows.par_chunks(TOGETHER)).map(part).collect();
                    for part in parts {
                        all.iter_mut().zip(part).for_each(|(all, part)| all.extend(part));
                    }
                }
                all
            })
        };
        let all = free(py, seen)?;
        let hits = poses.iter().zip(&rows).map(|(pose, row)| self.crops[row[1]].hits_table(pose));
        let hits = hits.collect::<Vec<bool>>().into_pyarray(py);
        Ok((all.map(|values| values.into_pyarray(py)), hits))
    }
}
