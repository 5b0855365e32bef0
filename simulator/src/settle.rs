//! Dropping objects until they rest (paper 2.3, Fig. 2).
//!
//! The objects fall one after the other into an open box. When the last one rests, the box is removed, and the pile
//! comes to rest again. The free part of a fall is not simulated, and resting objects sleep until something touches
//! them. Objects that have left the workspace are not part of the scene.
//!
//! Fixtures stand there from the beginning, so that objects fall between the walls of a bin. One that does not stand on
//! the table, such as the board of a shelf, would be in the way: it is put in when the objects rest, and those that
//! reach up to it are taken out.

use schema::{Grid, Physics, Polyhedron, Pose, SettleParams, Vec3, bounds_m};

use crate::attempt::Objects;
use crate::bodies::{PileEngine, RapierPile};
use crate::mass_scaling::LeastInertia;
use crate::stepper::Stepper;
use crate::{Scene, SceneObject};

/// A scene that came to rest.
#[derive(Debug, Clone, PartialEq)]
pub struct Settled {
    /// The objects that stayed in the workspace.
    pub scene: Scene,
    /// Simulated time, in seconds.
    pub settle_time_s: f32,
}

/// Why a scene was rejected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unsettled {
    /// An object still moved at the time limit.
    Moving {
        /// The one that moved fastest, by its place among those that were dropped.
        fastest: usize,
    },
    /// No object stayed in the workspace.
    Empty,
    /// A pose is not finite, or an object was shot through the table or far away.
    Unstable,
}

/// A falling object is simulated from this far above what it may hit.
const NEAR_M: f32 = 0.005;
/// An object this far from the workspace's centre, or this deep in the table, was shot away by the engine.
const ESCAPE_DISTANCE_M: f32 = 2.0;
const SUNK_DEPTH_M: f32 = 0.01;

/// A fixture that begins this far above the table does not stand on it.
const STANDS_M: f32 = 1e-4;

/// Drops `drops` one by one among `fixtures` into a box over the workspace and waits until they rest.
///
/// # Errors
/// [`Unsettled`] says why the scene is rejected; the caller draws another.
pub fn settle(
    physics: &Physics,
    params: &SettleParams,
    grid: &Grid,
    fixtures: &[Polyhedron],
    drops: &[SceneObject],
) -> Result<Settled, Unsettled> {
    let bottom_z_m = |fixture: &Polyhedron| bounds_m(fixture.corners_m())[0].z;
    let stands = |fixture: &Polyhedron| bottom_z_m(fixture) < grid.table_z_m + STANDS_M;
    let (standing, hung): (Vec<Polyhedron>, Vec<Polyhedron>) = fixtures.iter().cloned().partition(stands);
    let things = Objects::of(physics, drops, &standing, LeastInertia::NONE);
    let mut pile = Pile::new(physics, params, grid, &standing, &things);
    pile.heap.add_walls(grid.size_m);
    for (drop, known) in drops.iter().zip(0..) {
        let fall = Fall::until_near(physics, params, heights_m(drop)[0] - pile.top_z_m(&drops[..known]));
        let mut pose = drop.workspace_from_object;
        pose.translation.z -= fall.way_m;
        pile.add(&pose, -Vec3::Z * fall.speed_m_s);
        pile.steps += fall.steps;
        pile.rest()?;
    }
    pile.heap.remove_walls();
    pile.rest()?;
    let mut objects = pile.objects(drops)?;
    objects.retain(|object| is_over_workspace(object, grid));
    let below_z_m = hung.iter().map(bottom_z_m).fold(f32::INFINITY, f32::min);
    objects.retain(|object| heights_m(object)[1] < below_z_m);
    if objects.is_empty() {
        return Err(Unsettled::Empty);
    }
    if hung.is_empty() {
        return Ok(pile.settled(objects));
    }
    let again = settle_again(physics, params, grid, fixtures, &objects)?;
    let settle_time_s = again.settle_time_s + pile.steps as f32 * physics.dt_s();
    if again.scene.objects.is_empty() { Err(Unsettled::Empty) } else { Ok(Settled { settle_time_s, ..again }) }
}

/// Lets the `objects` that an attempt left behind come to rest among `fixtures`, without walls. An object that rests
/// outside the workspace is removed, and the others come to rest again. The result may be empty.
///
/// # Errors
/// [`Unsettled::Moving`], with a place among the objects that are left, or [`Unsettled::Unstable`]; an empty scene is
/// valid.
pub fn settle_again(
    physics: &Physics,
    params: &SettleParams,
    grid: &Grid,
    fixtures: &[Polyhedron],
    objects: &[SceneObject],
) -> Result<Settled, Unsettled> {
    let mut objects = objects.to_vec();
    let mut steps = 0;
    // The loop ends: every round but the last has fewer objects.
    loop {
        all_sane(&objects, grid)?;
        let things = Objects::of(physics, &objects, fixtures, LeastInertia::NONE);
        let mut pile = Pile { steps, ..Pile::new(physics, params, grid, fixtures, &things) };
        for object in &objects {
            pile.add(&object.workspace_from_object, Vec3::ZERO);
        }
        if !objects.is_empty() {
            pile.rest()?;
        }
        let count = objects.len();
        let mut rested = pile.objects(&objects)?;
        rested.retain(|object| is_over_workspace(object, grid));
        if rested.len() == count {
            return Ok(pile.settled(rested));
        }
        steps = pile.steps;
        objects = rested;
    }
}

/// Objects that come to rest on the table.
struct Pile<'a> {
    physics: &'a Physics,
    params: &'a SettleParams,
    grid: &'a Grid,
    fixtures: &'a [Polyhedron],
    heap: Box<dyn PileEngine + 'a>,
    count: usize,
    steps: usize,
}

impl<'a> Pile<'a> {
    /// A table with `fixtures` for `things`, of which none is there yet.
    fn new(
        physics: &'a Physics,
        params: &'a SettleParams,
        grid: &'a Grid,
        fixtures: &'a [Polyhedron],
        things: &'a Objects,
    ) -> Self {
        let settling = Physics { solver_iterations: params.solver_iterations, ..*physics };
        let heap: Box<dyn PileEngine + 'a> = match things {
            Objects::Stepper(things) => Box::new(Stepper::pile(&settling, params.damping_1_s, things, grid.table_z_m)),
            Objects::Rapier(things) => Box::new(RapierPile::new(&settling, params, things, grid.table_z_m)),
        };
        Self { physics, params, grid, fixtures, heap, count: 0, steps: 0 }
    }

    fn add(&mut self, pose: &Pose, velocity_m_s: Vec3) {
        self.heap.add(pose, velocity_m_s);
        self.count += 1;
    }

    /// Height of the highest corner of the dropped objects and the fixtures, or of the table.
    fn top_z_m(&self, dropped: &[SceneObject]) -> f32 {
        let corner_z_m = dropped.iter().zip(0..).flat_map(|(drop, id)| {
            let pose = self.heap.pose(id);
            drop.body.vertices_m().into_iter().map(move |corner| pose.transform_point(corner).z)
        });
        let fixed_z_m = self.fixtures.iter().flat_map(Polyhedron::corners_m).map(|corner| corner.z);
        corner_z_m.chain(fixed_z_m).fold(self.grid.table_z_m, f32::max)
    }

    /// Simulates until every body rests.
    fn rest(&mut self) -> Result<(), Unsettled> {
        let (physics, params) = (self.physics, self.params);
        let (wanted, limit) = (physics.steps(params.rest_time_s), physics.steps(params.time_s_max));
        let slow = [params.linear_speed_m_s_max, params.angular_speed_rad_s_max];
        let mut resting = 0;
        for step in 1..=limit {
            self.heap.step();
            let still = (0..self.count).all(|id| self.heap.is_slow(id, Vec3::ZERO, slow));
            resting = if still { resting + 1 } else { 0 };
            if resting >= wanted {
                self.steps += step;
                self.heap.fall_asleep();
                return Ok(());
            }
        }
        let excess = |id: usize| {
            let [linear_m_s, angular_rad_s] = self.heap.velocities(id).map(Vec3::length);
            (linear_m_s / slow[0]).max(angular_rad_s / slow[1])
        };
        let fastest = (0..self.count).max_by(|a, b| excess(*a).total_cmp(&excess(*b)));
        Err(Unsettled::Moving { fastest: fastest.unwrap_or(0) })
    }

    /// The objects at the poses that they have now.
    fn objects(&self, objects: &[SceneObject]) -> Result<Vec<SceneObject>, Unsettled> {
        let moved = |(object, id): (&SceneObject, usize)| SceneObject {
            workspace_from_object: self.heap.pose(id),
            ..object.clone()
        };
        let objects: Vec<SceneObject> = objects.iter().zip(0..).map(moved).collect();
        all_sane(&objects, self.grid)?;
        Ok(objects)
    }

    fn settled(&self, objects: Vec<SceneObject>) -> Settled {
        let scene = Scene { table_z_m: self.grid.table_z_m, fixtures: self.fixtures.to_vec(), objects };
        Settled { scene, settle_time_s: self.steps as f32 * self.physics.dt_s() }
    }
}

/// A fall through empty air.
struct Fall {
    steps: usize,
    way_m: f32,
    speed_m_s: f32,
}

impl Fall {
    /// The part of a fall of `height_m` during which nothing is near.
    fn until_near(physics: &Physics, params: &SettleParams, height_m: f32) -> Self {
        let (dt_s, mut fall) = (physics.dt_s(), Self { steps: 0, way_m: 0.0, speed_m_s: 0.0 });
        loop {
            let speed_m_s = (fall.speed_m_s + physics.gravity_m_s2 * dt_s) / (1.0 + params.damping_1_s * dt_s);
            let way_m = fall.way_m + speed_m_s * dt_s;
            if way_m + NEAR_M > height_m {
                return fall;
            }
            fall = Self { steps: fall.steps + 1, way_m, speed_m_s };
        }
    }
}

/// Heights of an object's lowest and highest corner.
fn heights_m(object: &SceneObject) -> [f32; 2] {
    let z_m = |corner: Vec3| object.workspace_from_object.transform_point(corner).z;
    let heights_m = object.body.vertices_m().into_iter().map(z_m);
    heights_m.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], z_m| [low.min(z_m), high.max(z_m)])
}

fn all_sane(objects: &[SceneObject], grid: &Grid) -> Result<(), Unsettled> {
    let middle = Vec3::splat(0.5 * grid.size_m);
    let is_sane = |object: &SceneObject| {
        (object.workspace_from_object.translation - middle).length() < ESCAPE_DISTANCE_M
            && heights_m(object)[0] > grid.table_z_m - SUNK_DEPTH_M
    };
    if objects.iter().all(is_sane) { Ok(()) } else { Err(Unsettled::Unstable) }
}

fn is_over_workspace(object: &SceneObject, grid: &Grid) -> bool {
    let point = object.workspace_from_object.translation;
    [point.x, point.y].iter().all(|c| (0.0..grid.size_m).contains(c))
}
