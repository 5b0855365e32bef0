//! The contact of two bodies in the solver: its points as lanes, and their impulses.
//!
//! All points of a contact are solved against each other before the velocities are touched again: a contact's four
//! points push nearly the same way, and one pass over them leaves a tenth of the load on the wrong points, so that a
//! heavy object slides as if friction were less.
//!
//! An angular velocity is along a body's principal axes and divided by the roots of its inverse moments, so that the
//! arm by which a turn moves a point is the arm by which an impulse at the point turns the body.

mod pass;

use schema::Vec3;
use wide::f32x4;

use super::patch::Patch;
use super::shape::Wide3;
pub(super) use pass::{Pass, Push, Relative};

/// A point is the same as in the last step if it is this near, seen from the second body.
const SAME_POINT_M: f32 = 0.0015;

/// A body's velocity and its (scaled) angular velocity, or the integrals of both.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Motion {
    pub(super) linear: f32x4,
    pub(super) angular: f32x4,
}

/// What a body answers to an impulse.
#[derive(Debug, Clone, Copy, Default)]
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
    /// A jaw that answers as a body does that turns about one axis, whose turn also moves all of it.
    Jaw {
        answer: &'a Answer,
        along: Vec3,
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
    /// How far the points have moved along the three directions since the step began.
    ways_m: [f32x4; 3],
    /// The normal and two tangents: one coordinate of all three each.
    directions: [f32x4; 3],
    /// By direction, turning body and axis: how far a turn moves each point.
    arms: [[Wide3; T]; 3],
    /// The same by direction, turning body and point: three axes.
    arms_of_point: [[[f32x4; 4]; T]; 3],
    /// What an impulse along a point's normal adds to the speeds of all points, along the normal by their own mass (and
    /// 0 for the point itself), then along the tangents.
    from_normal: [[f32x4; 4]; 3],
    /// What an impulse along a point's tangents adds to those along the tangents.
    from_tangents: [[[f32x4; 4]; 2]; 2],
    mass_normal: f32x4,
    /// How fast a point goes in that a spring lets in for each unit of its impulse in a substep; 0 if it is hard.
    yields: f32,
    /// The points that are likely to press, as a mask.
    bearing: f32x4,
    /// What [`Self::press_each`] and [`Self::rub_each`] come to if these points press and stick and the others do not
    /// press, as matrices: the normal impulses' changes from what is wanted, and along each tangent the friction's from
    /// the speeds along each. A column for every point.
    pressed_by: [f32x4; 4],
    rubbed_by: [[[f32x4; 4]; 2]; 2],
    /// The inverse of a point's 2 × 2 block of tangents: xx, xy, yy; and of its larger eigenvalue.
    mass_tangents: [f32x4; 4],
}

/// A contact with the table or the gripper.
pub(super) type Single = Contact<1>;
/// A contact of two bodies.
pub(super) type Double = Contact<2>;

/// What the next step wants to know of a contact.
#[derive(Debug, Clone)]
pub(super) struct Memory {
    tangents: [Vec3; 2],
    /// The points from the second body's centre along its principal axes.
    anchors_m: Wide3,
    normal: f32x4,
    friction: [f32x4; 2],
    /// Sum of all normal impulses of the step, in N s.
    pub(super) pressed: f32x4,
}

pub(super) fn lanes(v: Vec3) -> f32x4 {
    f32x4::from([v.x, v.y, v.z, 0.0])
}

/// The contacts of a step, and what is left of those of the step before. Each is written where it stays: it is larger
/// than what is computed for it in the time that moving it takes.
#[derive(Clone, Default)]
pub(super) struct Contacts<const T: usize> {
    slots: Vec<Contact<T>>,
    count: usize,
    last_slots: Vec<Contact<T>>,
    last_count: usize,
}

impl<const T: usize> Contacts<T> {
    pub(super) fn begin_step(&mut self) {
        core::mem::swap(&mut self.slots, &mut self.last_slots);
        (self.last_count, self.count) = (self.count, 0);
    }

    /// A contact of what is `touched` with a `body`: its friction, and how it yields; `key` is the same in every step.
    pub(super) fn add(
        &mut self,
        key: u64,
        ids: [usize; 2],
        [friction, yields]: [f32; 2],
        patch: &Patch,
        touched: Touched<'_>,
        body: &Answer,
    ) {
        if self.count == self.slots.len() {
            self.slots.push(Contact::BLANK);
        }
        let contact = &mut self.slots[self.count];
        self.count += 1;
        ([contact.first, contact.second], contact.key) = (ids, key);
        (contact.friction, contact.yields) = (friction, yields);
        contact.lay_out(patch, touched, body);
        // A part may touch a plane with several contacts.
        let last = self.last_slots[..self.last_count].iter().filter(|last| last.key == key);
        contact.memory.take_from(last.map(|last| &last.memory), contact.count);
        contact.foresee();
    }

    pub(super) fn iter(&self) -> core::slice::Iter<'_, Contact<T>> {
        self.slots[..self.count].iter()
    }

    pub(super) fn iter_mut(&mut self) -> core::slice::IterMut<'_, Contact<T>> {
        self.slots[..self.count].iter_mut()
    }
}

impl<const T: usize> Contact<T> {
    const BLANK: Self = Self {
        key: 0,
        first: 0,
        second: 0,
        memory: Memory {
            tangents: [Vec3::ZERO; 2],
            anchors_m: [f32x4::ZERO; 3],
            normal: f32x4::ZERO,
            friction: [f32x4::ZERO; 2],
            pressed: f32x4::ZERO,
        },
        points_m: [Vec3::ZERO; 4],
        count: 0,
        friction: 0.0,
        gaps_m: f32x4::ZERO,
        ways_m: [f32x4::ZERO; 3],
        directions: [f32x4::ZERO; 3],
        arms: [[[f32x4::ZERO; 3]; T]; 3],
        arms_of_point: [[[f32x4::ZERO; 4]; T]; 3],
        from_normal: [[f32x4::ZERO; 4]; 3],
        from_tangents: [[[f32x4::ZERO; 4]; 2]; 2],
        mass_normal: f32x4::ZERO,
        yields: 0.0,
        bearing: f32x4::ZERO,
        pressed_by: [f32x4::ZERO; 4],
        rubbed_by: [[[f32x4::ZERO; 4]; 2]; 2],
        mass_tangents: [f32x4::ZERO; 4],
    };

    /// Computes all but the impulses and what follows from them.
    fn lay_out(&mut self, patch: &Patch, touched: Touched<'_>, body: &Answer) {
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
        let arms = &mut self.arms;
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
            Touched::Jaw { answer, along } => {
                let to_first = from(points, answer.centre_m);
                for (row, direction) in directions.iter().enumerate() {
                    arms[row][T - 1] = in_axes(turn(to_first, -*direction), &answer.scaled_axes);
                    arms[row][T - 1][0] -= f32x4::splat(along.dot(*direction));
                }
            }
            Touched::Fixed => {}
            Touched::Finger { inverse_mass } => {
                let [n, a, b] = directions.map(|direction| direction.y);
                shared = [0, 1, 2].map(|row| shared[row] + inverse_mass * directions[row].y * directions[row].y);
                crossed = [inverse_mass * n * a, inverse_mass * n * b, inverse_mass * a * b];
            }
        }
        for (of_point, arms) in self.arms_of_point.iter_mut().zip(&self.arms) {
            for (of_point, [x, y, z]) in of_point.iter_mut().zip(arms) {
                *of_point = f32x4::transpose([*x, *y, *z, f32x4::ZERO]);
            }
        }
        let gaps_m: [f32; 4] = core::array::from_fn(|i| patch.gaps_m[if i < count { i } else { 0 }]);
        let coordinate = |axis: usize| f32x4::from([directions[0][axis], across[axis], directions[2][axis], 0.0]);
        (self.memory.tangents, self.memory.anchors_m) = ([directions[1], directions[2]], anchors);
        (self.points_m, self.count) = (points_m, count);
        (self.gaps_m, self.ways_m) = (f32x4::from(gaps_m), [f32x4::ZERO; 3]);
        self.directions = [coordinate(0), coordinate(1), coordinate(2)];
        self.weigh(shared, crossed);
    }

    /// What the points' impulses do to each other. `shared` is what an impulse along a direction gives to every point
    /// along it, `crossed` what one along the first, first and second direction gives along the second, third and
    /// third.
    fn weigh(&mut self, shared: [f32; 3], crossed: [f32; 3]) {
        let mut masses = [0.0; 4];
        let mut tangents = [[0.0; 4]; 4];
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
            *mass = 1.0 / (nn.as_array()[point] + self.yields);
            (self.from_normal[0][point], self.from_normal[1][point], self.from_normal[2][point]) = (nn, nx, ny);
            (self.from_tangents[0][0][point], self.from_tangents[0][1][point]) = (xx, xy);
            (self.from_tangents[1][0][point], self.from_tangents[1][1][point]) = (yx, yy);
            let [xx, xy, yy] = [xx, xy, yy].map(|lanes| lanes.as_array()[point]);
            let inverse = 1.0 / (xx * yy - xy * xy);
            let (middle, apart) = (0.5 * (xx + yy), 0.5 * (xx - yy));
            let largest = middle + (apart * apart + xy * xy).sqrt();
            let entries = [yy * inverse, -xy * inverse, xx * inverse, 1.0 / largest];
            tangents.iter_mut().zip(entries).for_each(|(row, entry)| row[point] = entry);
        }
        self.mass_normal = f32x4::from(masses);
        self.mass_tangents = tangents.map(f32x4::from);
        for (point, column) in self.from_normal[0].iter_mut().enumerate() {
            *column *= self.mass_normal * OTHERS[point];
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

    /// The next step with the same points.
    pub(super) fn go_on(&mut self) {
        self.gaps_m += self.ways_m[0];
        (self.ways_m, self.memory.pressed) = ([f32x4::ZERO; 3], f32x4::ZERO);
        if (self.likely_to_press() ^ self.bearing).any() {
            self.foresee();
        }
    }

    /// Whether anything pressed in the last step.
    pub(super) fn presses(&self) -> bool {
        self.memory.pressed.simd_gt(f32x4::ZERO).any()
    }

    /// The points that pressed in the last step, in metres, and the sum of their impulses, in N s.
    pub(super) fn bearing(&self) -> (Vec<Vec3>, f32) {
        let pressed = self.memory.pressed.to_array();
        let bearing = (0..self.count).filter(|point| pressed[*point] > 0.0);
        (bearing.map(|point| self.points_m[point]).collect(), pressed.iter().sum())
    }
}

impl Memory {
    /// Starts from the impulses that the same points had in the last step.
    fn take_from<'a>(&mut self, all_last: impl Iterator<Item = &'a Self>, count: usize) {
        let [mut normal, mut along_x, mut along_y] = [[0.0; 4]; 3];
        let mut least = [SAME_POINT_M * SAME_POINT_M; 4];
        for last in all_last {
            let anchors_m = self.anchors_m.map(f32x4::to_array);
            for point in 0..count {
                let [x, y, z] = [0, 1, 2].map(|axis| last.anchors_m[axis] - f32x4::splat(anchors_m[axis][point]));
                let far = (x * x + y * y + z * z).to_array();
                let nearest = (1..4).fold(0, |best, old| if far[old] < far[best] { old } else { best });
                if far[nearest] < least[point] {
                    least[point] = far[nearest];
                    let [x, y] = last.friction.map(|impulses| impulses.as_array()[nearest]);
                    let friction = last.tangents[0] * x + last.tangents[1] * y;
                    normal[point] = last.normal.as_array()[nearest];
                    along_x[point] = friction.dot(self.tangents[0]);
                    along_y[point] = friction.dot(self.tangents[1]);
                }
            }
        }
        self.pressed = f32x4::ZERO;
        (self.normal, self.friction) = (f32x4::from(normal), [f32x4::from(along_x), f32x4::from(along_y)]);
    }
}

/// One for every point but one.
const OTHERS: [f32x4; 4] = [
    f32x4::new([0.0, 1.0, 1.0, 1.0]),
    f32x4::new([1.0, 0.0, 1.0, 1.0]),
    f32x4::new([1.0, 1.0, 0.0, 1.0]),
    f32x4::new([1.0, 1.0, 1.0, 0.0]),
];

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
