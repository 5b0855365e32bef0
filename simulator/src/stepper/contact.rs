//! The contact of two bodies in the solver: its points as lanes, and their impulses.
//!
//! All points of a contact are solved against each other before the velocities are touched again: a contact's four
//! points push nearly the same way, and one pass over them leaves a tenth of the load on the wrong points, so that a
//! heavy object slides as if friction were less.
//!
//! An angular velocity is along a body's principal axes and divided by the roots of its inverse moments, so that the
//! arm by which a turn moves a point is the arm by which an impulse at the point turns the body.

use schema::Vec3;
use wide::f32x4;

use super::patch::Patch;
use super::shape::Wide3;

/// Rounds over a contact's normals in a pass. With one, a heavy object slides 1.5 times as far as it should.
const NORMAL_ROUNDS: usize = 2;
/// Overlaps up to this are left alone: points that are pushed out of contact come back in the next step, and what they
/// hold trembles.
const SLOP_M: f32 = 0.000_05;
/// Bodies that overlap are not pushed apart faster than this.
const CORRECTION_M_S_MAX: f32 = 0.3;
/// A point is the same as in the last step if it is this near, seen from the second body.
const SAME_POINT_M: f32 = 0.0015;

/// A body's velocity and its (scaled) angular velocity, or the integrals of both.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Motion {
    pub(super) linear: f32x4,
    pub(super) angular: f32x4,
}

/// What a body answers to an impulse.
#[derive(Debug, Clone, Copy)]
pub(super) struct Answer {
    pub(super) centre_m: Vec3,
    pub(super) inverse_mass: f32,
    /// The principal axes in the world, and each by the root of its inverse moment.
    pub(super) principal: [Vec3; 3],
    pub(super) scaled_axes: [Vec3; 3],
}

/// What is touched.
#[derive(Debug, Clone, Copy)]
pub(super) enum Touched<'a> {
    Body(&'a Answer),
    /// A box that goes where it is told.
    Fixed,
    /// A finger, which has an inverse mass along the world's y.
    Finger {
        inverse_mass: f32,
    },
}

/// A contact of `T` bodies that turn: the second body alone, or both.
#[derive(Clone)]
pub(super) struct Contact<const T: usize> {
    pub(super) key: u64,
    /// What is touched: an obstacle's index, or a body's if `T` is 2.
    pub(super) first: usize,
    /// The body.
    pub(super) second: usize,
    pub(super) memory: Memory,
    points_m: [Vec3; 4],
    count: usize,
    friction: f32,
    gaps_m: f32x4,
    /// The normal and two tangents: one coordinate of all three each.
    directions: [f32x4; 3],
    /// By direction, turning body and axis: how far a turn moves each point.
    arms: [[Wide3; T]; 3],
    /// The same by direction, turning body and point: three axes.
    arms_of_point: [[[f32x4; 4]; T]; 3],
    /// What an impulse along a point's normal adds to the speeds of all points, along the normal by their own mass (so
    /// that it is 1 for the point itself), then along the tangents.
    from_normal: [[f32x4; 4]; 3],
    /// What an impulse along a point's tangents adds to those along the tangents.
    from_tangents: [[[f32x4; 4]; 2]; 2],
    mass_normal: f32x4,
    /// The inverse of a point's 2 × 2 block of tangents: xx, xy, yy; and of its larger eigenvalue.
    mass_tangents: [[f32; 4]; 4],
}

/// A contact with the table or the hand.
pub(super) type Single = Contact<1>;
/// A contact of two bodies.
pub(super) type Double = Contact<2>;

/// What the next step wants to know of a contact.
#[derive(Debug, Clone)]
pub(super) struct Memory {
    tangents: [Vec3; 2],
    /// The points from the second body's centre along its principal axes.
    anchors_m: [Vec3; 4],
    normal: [f32; 4],
    friction: [[f32; 4]; 2],
    /// Sum of all normal impulses of the step, in N s.
    pub(super) pressed: [f32; 4],
}

/// What a pass of the solver goes by.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pass {
    /// Whether bodies that overlap are pushed apart (the second pass takes out the speed that this gave).
    pub(super) corrects: bool,
    /// One over the length of the substep.
    pub(super) rate_hz: f32,
    /// Share of an overlap that is corrected, per second, and the softness of that push.
    pub(super) correction_1_s: f32,
    pub(super) softness: f32,
}

/// How a contact's bodies move: the second's linear motion less the first's, and those that turn.
pub(super) struct Relative<const T: usize> {
    pub(super) linear: f32x4,
    pub(super) angular: [f32x4; T],
}

/// What a pass adds: an impulse on the second body, and the turns.
pub(super) struct Push<const T: usize> {
    pub(super) impulse: f32x4,
    pub(super) angular: [f32x4; T],
}

pub(super) fn lanes(v: Vec3) -> f32x4 {
    f32x4::from([v.x, v.y, v.z, 0.0])
}

impl<const T: usize> Contact<T> {
    pub(super) fn new(
        key: u64,
        [first, second]: [usize; 2],
        friction: f32,
        patch: &Patch,
        touched: Touched<'_>,
        body: &Answer,
        last: Option<&Memory>,
    ) -> Self {
        let count = patch.count;
        let across = patch.normal.any_orthonormal_vector();
        let directions = [patch.normal, across, patch.normal.cross(across)];
        // The points that are not there are copies of the first, with no mass.
        let points_m: [Vec3; 4] = core::array::from_fn(|i| patch.points_m[if i < count { i } else { 0 }]);
        let point =
            |axis: usize| f32x4::from([points_m[0][axis], points_m[1][axis], points_m[2][axis], points_m[3][axis]]);
        let points = [point(0), point(1), point(2)];
        let to_second = from(points, body.centre_m);
        let anchors = in_axes(to_second, &body.principal);
        let mut arms = [[[f32x4::ZERO; 3]; T]; 3];
        // Impulses along the same direction move the bodies as a whole by the same, wherever they push.
        let mut shared = [body.inverse_mass; 3];
        let mut crossed = [0.0; 3];
        for (row, direction) in directions.iter().enumerate() {
            arms[row][0] = in_axes(turn(to_second, *direction), &body.scaled_axes);
        }
        match touched {
            Touched::Body(other) => {
                let to_first = from(points, other.centre_m);
                for (row, direction) in directions.iter().enumerate() {
                    arms[row][T - 1] = in_axes(turn(to_first, -*direction), &other.scaled_axes);
                    shared[row] += other.inverse_mass;
                }
            }
            Touched::Fixed => {}
            Touched::Finger { inverse_mass } => {
                let [n, a, b] = directions.map(|direction| direction.y);
                shared = [0, 1, 2].map(|row| shared[row] + inverse_mass * directions[row].y * directions[row].y);
                crossed = [inverse_mass * n * a, inverse_mass * n * b, inverse_mass * a * b];
            }
        }
        let mut arms_of_point = [[[f32x4::ZERO; 4]; T]; 3];
        for row in 0..3 {
            for turning in 0..T {
                let [x, y, z] = arms[row][turning];
                arms_of_point[row][turning] = f32x4::transpose([x, y, z, f32x4::ZERO]);
            }
        }
        let gaps_m: [f32; 4] = core::array::from_fn(|i| patch.gaps_m[if i < count { i } else { 0 }]);
        let coordinate = |axis: usize| f32x4::from([directions[0][axis], across[axis], directions[2][axis], 0.0]);
        let mut contact = Self {
            key,
            first,
            second,
            memory: Memory {
                tangents: [directions[1], directions[2]],
                anchors_m: columns(anchors),
                normal: [0.0; 4],
                friction: [[0.0; 4]; 2],
                pressed: [0.0; 4],
            },
            points_m,
            count,
            friction,
            gaps_m: f32x4::from(gaps_m),
            directions: [coordinate(0), coordinate(1), coordinate(2)],
            arms,
            arms_of_point,
            from_normal: [[f32x4::ZERO; 4]; 3],
            from_tangents: [[[f32x4::ZERO; 4]; 2]; 2],
            mass_normal: f32x4::ZERO,
            mass_tangents: [[0.0; 4]; 4],
        };
        contact.weigh(shared, crossed);
        if let Some(last) = last {
            contact.memory.take_from(last, count);
        }
        contact
    }

    /// What the points' impulses do to each other. `shared` is what an impulse along a direction gives to every point
    /// along it, `crossed` what one along the first, first and second direction gives along the second, third and
    /// third.
    fn weigh(&mut self, shared: [f32; 3], crossed: [f32; 3]) {
        let mut masses = [0.0; 4];
        for (point, mass) in masses.iter_mut().enumerate().take(self.count) {
            let [nn, nx, ny] = [
                self.response(0, 0, point, shared[0]),
                self.response(0, 1, point, crossed[0]),
                self.response(0, 2, point, crossed[1]),
            ];
            let [xx, xy, yx, yy] = [
                self.response(1, 1, point, shared[1]),
                self.response(1, 2, point, crossed[2]),
                self.response(2, 1, point, crossed[2]),
                self.response(2, 2, point, shared[2]),
            ];
            *mass = 1.0 / nn.as_array()[point];
            (self.from_normal[0][point], self.from_normal[1][point], self.from_normal[2][point]) = (nn, nx, ny);
            (self.from_tangents[0][0][point], self.from_tangents[0][1][point]) = (xx, xy);
            (self.from_tangents[1][0][point], self.from_tangents[1][1][point]) = (yx, yy);
            let [xx, xy, yy] = [xx, xy, yy].map(|lanes| lanes.as_array()[point]);
            let inverse = 1.0 / (xx * yy - xy * xy);
            let (middle, apart) = (0.5 * (xx + yy), 0.5 * (xx - yy));
            let largest = middle + (apart * apart + xy * xy).sqrt();
            self.mass_tangents[point] = [yy * inverse, -xy * inverse, xx * inverse, 1.0 / largest];
        }
        self.mass_normal = f32x4::from(masses);
        for column in &mut self.from_normal[0] {
            *column *= self.mass_normal;
        }
    }

    /// The speeds along `onto` that an impulse along `along` at a point gives to all points.
    #[inline(always)]
    fn response(&self, along: usize, onto: usize, point: usize, shared: f32) -> f32x4 {
        let mut sum = f32x4::splat(shared);
        for turning in 0..T {
            let arm = self.arms_of_point[along][turning][point].as_array();
            for (onto, along) in self.arms[onto][turning].iter().zip(arm) {
                sum += *onto * f32x4::splat(*along);
            }
        }
        sum
    }

    /// Whether anything pressed in the last step.
    pub(super) fn presses(&self) -> bool {
        self.memory.pressed.iter().any(|impulse| *impulse > 0.0)
    }

    /// The points that pressed in the last step, in metres, and the sum of their impulses, in N s.
    pub(super) fn bearing(&self) -> (Vec<Vec3>, f32) {
        let bearing = (0..self.count).filter(|point| self.memory.pressed[*point] > 0.0);
        (bearing.map(|point| self.points_m[point]).collect(), self.memory.pressed.iter().sum())
    }

    /// The impulses that the contact had before.
    #[inline(always)]
    pub(super) fn warm_start(&self) -> Push<T> {
        let [x, y] = self.memory.friction;
        self.push_of([self.memory.normal, x, y])
    }

    #[inline(always)]
    fn push_of(&self, impulses: [[f32; 4]; 3]) -> Push<T> {
        let sums = impulses.map(|[a, b, c, d]| (a + b) + (c + d));
        let along = f32x4::from([sums[0], sums[1], sums[2], 0.0]);
        let mut impulse = [0.0; 4];
        for (axis, coordinate) in self.directions.iter().enumerate() {
            let [n, x, y, _] = (*coordinate * along).to_array();
            impulse[axis] = n + x + y;
        }
        let mut angular = [f32x4::ZERO; T];
        for (turning, angular) in angular.iter_mut().enumerate() {
            let mut rows = [f32x4::ZERO; 3];
            for (row, sum) in rows.iter_mut().enumerate() {
                let arms = &self.arms_of_point[row][turning];
                let at = |point: usize| arms[point] * f32x4::splat(impulses[row][point]);
                *sum = (at(0) + at(1)) + (at(2) + at(3));
            }
            *angular = rows[0] + rows[1] + rows[2];
        }
        Push { impulse: f32x4::from(impulse), angular }
    }

    /// The points' speeds, or ways, along the three directions.
    #[inline(always)]
    fn along(&self, motion: &Relative<T>) -> [f32x4; 3] {
        let [x, y, z, _] = motion.linear.to_array();
        let [dx, dy, dz] = self.directions;
        let linear = (dx * f32x4::splat(x) + dy * f32x4::splat(y) + dz * f32x4::splat(z)).to_array();
        let mut along = [f32x4::splat(linear[0]), f32x4::splat(linear[1]), f32x4::splat(linear[2])];
        for (turning, angular) in motion.angular.iter().enumerate() {
            let angular = angular.to_array();
            for (row, along) in along.iter_mut().enumerate() {
                let [a, b, c] = self.arms[row][turning];
                *along += a * f32x4::splat(angular[0]) + b * f32x4::splat(angular[1]) + c * f32x4::splat(angular[2]);
            }
        }
        along
    }

    /// One pass over the contact: changes its impulses, and gives what they add. `ways` are since the step began.
    #[inline(always)]
    pub(super) fn solve(&mut self, pass: Pass, speeds: &Relative<T>, ways: &Relative<T>) -> Option<Push<T>> {
        let ways = self.along(ways);
        let [normal_speeds, x_speeds, y_speeds] = self.along(speeds);
        let gaps_m = self.gaps_m + ways[0];
        let rate = f32x4::splat(pass.rate_hz);
        let open = gaps_m.simd_gt(f32x4::ZERO);
        let push = if pass.corrects {
            ((gaps_m + f32x4::splat(SLOP_M)).fast_min(f32x4::ZERO) * f32x4::splat(pass.correction_1_s))
                .fast_max(f32x4::splat(-CORRECTION_M_S_MAX))
        } else {
            f32x4::ZERO
        };
        let normal_speeds = normal_speeds + open.bitselect(gaps_m * rate, push);
        let before = self.memory.normal;
        if before == [0.0; 4] && normal_speeds.simd_ge(f32x4::ZERO).all() {
            return None;
        }
        let mut tangent_speeds = [x_speeds, y_speeds];
        if pass.corrects {
            tangent_speeds[0] += ways[1] * rate;
            tangent_speeds[1] += ways[2] * rate;
        }
        let soft = f32x4::splat(if pass.corrects { pass.softness } else { 1.0 });
        let soft = open.bitselect(f32x4::ONE, soft).to_array();
        self.push(normal_speeds, soft);
        let mut changes = [[0.0_f32; 4]; 3];
        for point in 0..4 {
            changes[0][point] = self.memory.normal[point] - before[point];
            let change = f32x4::splat(changes[0][point]);
            tangent_speeds[0] += self.from_normal[1][point] * change;
            tangent_speeds[1] += self.from_normal[2][point] * change;
        }
        let before = self.memory.friction;
        self.rub(tangent_speeds);
        for tangent in 0..2 {
            for point in 0..4 {
                changes[1 + tangent][point] = self.memory.friction[tangent][point] - before[tangent][point];
            }
        }
        Some(self.push_of(changes))
    }

    /// Normal impulses: none pulls.
    #[inline(always)]
    fn push(&mut self, speeds: f32x4, soft: [f32; 4]) {
        let mut wanted = f32x4::from(self.memory.normal) - self.mass_normal * speeds;
        for _ in 0..NORMAL_ROUNDS {
            for (point, soft) in soft.iter().enumerate().take(self.count) {
                let old = self.memory.normal[point];
                let new = (soft * wanted.as_array()[point]).max(0.0);
                // Its own share of this is the gain itself, which it has already.
                wanted -= self.from_normal[0][point] * f32x4::splat(new - old);
                wanted.as_mut_array()[point] += new - old;
                self.memory.normal[point] = new;
            }
        }
    }

    /// Friction: in its cone at every point.
    #[inline(always)]
    fn rub(&mut self, [mut x_speeds, mut y_speeds]: [f32x4; 2]) {
        for point in 0..self.count {
            let limit = self.friction * self.memory.normal[point];
            let old = [self.memory.friction[0][point], self.memory.friction[1][point]];
            let (x, y) = (x_speeds.as_array()[point], y_speeds.as_array()[point]);
            let [xx, xy, yy, both] = self.mass_tangents[point];
            let mut new = [old[0] - (xx * x + xy * y), old[1] - (xy * x + yy * y)];
            if new[0] * new[0] + new[1] * new[1] > limit * limit {
                // It slides. What stops a point lies not along its velocity, for it turns the body too; friction does.
                new = [old[0] - both * x, old[1] - both * y];
                let squared = new[0] * new[0] + new[1] * new[1];
                let scale = limit / squared.sqrt();
                new = [new[0] * scale, new[1] * scale];
            }
            let gains = [new[0] - old[0], new[1] - old[1]];
            let (x_gain, y_gain) = (f32x4::splat(gains[0]), f32x4::splat(gains[1]));
            x_speeds += self.from_tangents[0][0][point] * x_gain + self.from_tangents[1][0][point] * y_gain;
            y_speeds += self.from_tangents[0][1][point] * x_gain + self.from_tangents[1][1][point] * y_gain;
            (self.memory.friction[0][point], self.memory.friction[1][point]) = (new[0], new[1]);
        }
    }

    /// Counts what pressed in a substep.
    pub(super) fn count_pressed(&mut self) {
        for (sum, impulse) in self.memory.pressed.iter_mut().zip(self.memory.normal) {
            *sum += impulse;
        }
    }
}

impl Memory {
    /// Starts from the impulses that the same points had in the last step.
    fn take_from(&mut self, last: &Self, count: usize) {
        for point in 0..count {
            let far = |old: usize| (last.anchors_m[old] - self.anchors_m[point]).length_squared();
            let nearest = (1..4).fold(0, |best, old| if far(old) < far(best) { old } else { best });
            if far(nearest) < SAME_POINT_M * SAME_POINT_M {
                self.normal[point] = last.normal[nearest];
                let friction =
                    last.tangents[0] * last.friction[0][nearest] + last.tangents[1] * last.friction[1][nearest];
                self.friction[0][point] = friction.dot(self.tangents[0]);
                self.friction[1][point] = friction.dot(self.tangents[1]);
            }
        }
    }
}

/// Points seen from another.
fn from(points: Wide3, at_m: Vec3) -> Wide3 {
    [points[0] - f32x4::splat(at_m.x), points[1] - f32x4::splat(at_m.y), points[2] - f32x4::splat(at_m.z)]
}

/// Vectors along three axes.
fn in_axes(vectors: Wide3, axes: &[Vec3; 3]) -> Wide3 {
    let [a, b, c] = axes;
    [super::shape::along(&vectors, *a), super::shape::along(&vectors, *b), super::shape::along(&vectors, *c)]
}

/// Vectors × a direction.
fn turn([x, y, z]: Wide3, direction: Vec3) -> Wide3 {
    let [dx, dy, dz] = [f32x4::splat(direction.x), f32x4::splat(direction.y), f32x4::splat(direction.z)];
    [y * dz - z * dy, z * dx - x * dz, x * dy - y * dx]
}

fn columns([x, y, z]: Wide3) -> [Vec3; 4] {
    let (x, y, z) = (x.to_array(), y.to_array(), z.to_array());
    [0, 1, 2, 3].map(|i| Vec3::new(x[i], y[i], z[i]))
}
