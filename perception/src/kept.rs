//! Fields of a scene that a camera sees again and again: a view is added, and nothing is fused anew.

use core::mem::take;
use std::sync::Arc;

use schema::{Lattice, VoxelGrid};

use crate::blocks::{Field as _, SurfaceBlocks, block_counts};
use crate::fuse::{Brick, Keeping, Sights, brick_counts};
use crate::seen::SeenPoint;
use crate::tsdf::truncation_m;

/// A field and, beside it, a finer one near what was seen, to which views are added one after the other: the bits of
/// [`Sights::fuse`] and [`Sights::fuse_near`] of all of them, but that a block of the finer field which no view before
/// saw knows only of those before that are given.
#[derive(Debug, Clone)]
pub struct KeptFields {
    truncation_voxels: f32,
    coarse: VoxelGrid,
    bricks: Vec<Brick>,
    fine: Option<(Arc<SurfaceBlocks>, Vec<Brick>)>,
}

impl KeptFields {
    /// Fields without a view. `truncation_voxels` as in [`crate::Tsdf::new`].
    #[must_use]
    pub fn new(coarse: Lattice, fine: Option<Lattice>, truncation_voxels: f32) -> Self {
        let nowhere = |lattice: Lattice| vec![false; block_counts(&lattice).iter().product()];
        Self {
            truncation_voxels,
            coarse: VoxelGrid { lattice: coarse, values: vec![0.0; coarse.len()] },
            bricks: vec![Brick::default(); brick_counts(&coarse).iter().product()],
            fine: fine.map(|lattice| (Arc::new(SurfaceBlocks::new(lattice, &nowhere(lattice))), Vec::new())),
        }
    }

    /// Adds views, of which `seen` has the points near which the finer field has values. `before` were added earlier.
    ///
    /// # Panics
    /// If the truncation is not above 0.
    pub fn add(&mut self, before: &Sights<'_>, views: &Sights<'_>, seen: &[Vec<SeenPoint>]) {
        let truncation_voxels = self.truncation_voxels;
        views.fuse_into(&mut self.coarse, &mut self.bricks, truncation_voxels, Keeping::Voxels);
        let Some((blocks, bricks)) = &mut self.fine else { return };
        let lattice = *blocks.lattice();
        let near = views.near_surfaces(&lattice, truncation_m(&lattice, truncation_voxels), seen);
        if let Some((more, places)) = blocks.with_more(&near) {
            let kept = |place: Option<usize>| place.map(|place| take(&mut bricks[place])).unwrap_or_default();
            *bricks = places.into_iter().map(kept).collect();
            *blocks = Arc::new(more);
        }
        views.fuse_blocks_into(Arc::make_mut(blocks), bricks, truncation_voxels, before, Keeping::Voxels);
    }

    /// The field, in VGN's values.
    #[must_use]
    pub fn coarse(&self) -> &VoxelGrid {
        &self.coarse
    }

    /// The finer field, if there is one.
    #[must_use]
    pub fn fine(&self) -> Option<Arc<SurfaceBlocks>> {
        self.fine.as_ref().map(|(blocks, _)| Arc::clone(blocks))
    }
}
