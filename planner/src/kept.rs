//! A scene that is seen again and again, as by a wrist's camera on its way: images are added to what was seen before,
//! and the best hands of the last plan are looked at first.

use std::mem::take;

use perception::{KeptFields, SeenPoint, Sights, TRUNCATION_VOXELS};
use schema::{Grasp, Lattice, Vec3};

use crate::config::CloudParams;
use crate::frame::{self, FoundTable};
use crate::input::{InputError, check_image, refuse};
use crate::limits::WillDo;
use crate::observation::{PlanOptions, View};
use crate::plan::Plan;
use crate::planner::{Planner, Sight};
use crate::region::Region;
use crate::timing::timed;
use crate::volume::{Volume, Workspace, fine_lattice, must_fit, scaled, seen_off_table};

/// So many images are kept, the last ones: for widths, for what is out of sight, and for places that were not seen
/// before. The fields know all of them.
const IMAGES: usize = 8;
/// The fields reach further beyond things by this, so that they are not soon made again because of another one.
const MORE_VOXELS: f32 = 4.0;

/// What was seen of a scene, from plan to plan. A scene that has changed begins with a new one.
#[derive(Debug, Clone, Default)]
pub struct KeptScene {
    /// The last images, the newest first, in the workspace if the table is found; the first `new` are not yet in the
    /// fields.
    views: Vec<View>,
    new: usize,
    table: Option<FoundTable>,
    fields: Option<Fields>,
    known: Vec<Grasp>,
    /// For the next plan.
    warnings: Vec<String>,
}

/// What was fused, and for which workspace.
#[derive(Debug, Clone)]
struct Fields {
    workspace: Workspace,
    region: Region,
    fields: KeptFields,
    /// The last images, and what they show above the table.
    sights: Sights<'static>,
    above: Vec<Vec<SeenPoint>>,
}

impl KeptScene {
    /// Adds an image. If the table is to be found, poses are in the frame of the first image's camera.
    ///
    /// # Errors
    /// If an image's size differs from its intrinsics, or its depths cannot be metres.
    pub fn observe(&mut self, mut view: View) -> Result<(), InputError> {
        must_fit(0, &view)?;
        self.warnings.extend(check_image(&view.image)?);
        if let Some(table) = &self.table {
            view.camera.workspace_from_camera = table.workspace_from_first * view.camera.workspace_from_camera;
        }
        self.views.insert(0, view);
        self.new += 1;
        Ok(())
    }

    /// The last image.
    #[must_use]
    pub fn last(&self) -> Option<&View> {
        self.views.first()
    }

    /// Adds the new ones of the views to the fields.
    fn volume(&mut self, views: &[View], workspace: &Workspace, params: CloudParams) -> Volume {
        self.fields.take_if(|fields| fields.workspace != *workspace);
        let new = if self.fields.is_none() { views } else { &views[..self.new] };
        let mut warnings = Vec::new();
        let new = scaled(new, workspace, params, &mut warnings);
        let (sights, mut above) = (Sights::new(&new).into_owned(), seen_off_table(workspace, &new));
        let region = workspace.region(&above);
        let fields = match self.fields.take() {
            Some(mut kept) => {
                let before = kept.above.len();
                kept.above.append(&mut above);
                let [low_m, high_m] = kept.region.reach_m;
                let reach_m = [low_m.min(region.reach_m[0]), high_m.max(region.reach_m[1])];
                if contains(&kept.region.lattice, &region.lattice) {
                    kept.fields.add(&kept.sights, &sights, &kept.above[before..]);
                    kept.sights.extend(sights, IMAGES);
                } else {
                    kept.region.lattice = grown(&kept.region.lattice, &region.lattice);
                    kept.sights.extend(sights, usize::MAX);
                    kept.fields = empty(&kept.region.lattice, params);
                    kept.fields.add(&Sights::default(), &kept.sights, &kept.above);
                    kept.sights.extend(Sights::default(), IMAGES);
                }
                kept.region.reach_m = reach_m;
                kept.above.drain(..kept.above.len().saturating_sub(IMAGES));
                kept
            }
            None => {
                let lattice = match workspace {
                    // A network of voxels answers for its own grid.
                    Workspace::Cube(_) => region.lattice,
                    Workspace::Seen(..) => grown(&region.lattice, &region.lattice),
                };
                let mut fields = empty(&lattice, params);
                fields.add(&Sights::default(), &sights, &above);
                Fields { workspace: *workspace, region: Region { lattice, ..region }, fields, sights, above }
            }
        };
        let Fields { fields, region, .. } = self.fields.insert(fields);
        self.new = 0;
        Volume::of_fields(fields.coarse().clone(), fields.fine(), region.reach_m, params, warnings)
    }
}

fn empty(lattice: &Lattice, params: CloudParams) -> KeptFields {
    KeptFields::new(*lattice, fine_lattice(lattice, params), TRUNCATION_VOXELS)
}

/// Whether a lattice has the place of another.
fn contains(lattice: &Lattice, other: &Lattice) -> bool {
    let ([low, high], [a, b]) = (lattice.corners_m(), other.corners_m());
    let rounding_m = Vec3::splat(0.1 * lattice.voxel_size_m);
    a.cmpge(low - rounding_m).all() && b.cmple(high + rounding_m).all()
}

/// A lattice about two others, and a little more but not below.
fn grown(lattice: &Lattice, other: &Lattice) -> Lattice {
    let ([low, high], [a, b]) = (lattice.corners_m(), other.corners_m());
    let voxels = |at_m: Vec3| (at_m / lattice.voxel_size_m).round();
    let more = Vec3::splat(MORE_VOXELS);
    let (low, high) = (voxels(low.min(a)) - more.with_z(0.0), voxels(high.max(b)) + more);
    let counts = (high - low).to_array().map(|count| count as usize);
    Lattice { low_m: low * lattice.voxel_size_m, counts, ..*lattice }
}

impl Planner {
    /// Plans grasps from all images of a scene; the plan's camera is that of the newest. The last plan's best hands are
    /// asked about first, and fewer others are proposed; where none was good it is as [`Self::plan_with`].
    ///
    /// # Errors
    /// As [`Self::plan`]; if there is no image, or masks are given.
    pub fn plan_kept(
        &self,
        scene: &mut KeptScene,
        options: &PlanOptions,
        will_do: &WillDo<'_>,
    ) -> Result<Plan, InputError> {
        if scene.views.is_empty() {
            return refuse("an image must be observed before a plan, got none");
        }
        let (seed, mut timings_ms, mut warnings) = (self.config.seed, Vec::new(), take(&mut scene.warnings));
        match &options.find_table {
            None => {
                let (new, base) = (&scene.views[..scene.new], options.base_from_workspace);
                warnings.extend(frame::disagreements(new, base, &self.grid, seed));
            }
            Some(wanted) if scene.table.is_none() => {
                let find = || frame::find(&frame::shown_by(&scene.views), wanted, &self.grid, seed);
                let found = timed(&mut timings_ms, "table", find)?;
                frame::move_views(&mut scene.views, &found.workspace_from_first);
                warnings.extend(found.warning());
                scene.table = Some(found);
            }
            Some(_) => {}
        }
        let (views, known, table) = (take(&mut scene.views), take(&mut scene.known), scene.table.clone());
        let sight = Sight { views: Some(&views), view_count: views.len(), table, known: &known, timings_ms, warnings };
        let fused = &mut |workspace: &Workspace| Ok(scene.volume(&views, workspace, self.config.cloud));
        let planned = self.plan_seen(sight, options, will_do, fused);
        scene.views = views;
        let (plan, known) = planned?;
        scene.known = known;
        scene.views.truncate(IMAGES);
        Ok(plan)
    }
}
