//! The passes of the solver over a contact.
//!
//! Where all points that bear press and stick, a pass is a product with matrices that are made once a step; else the
//! points are solved one after the other.

use wide::f32x4;

use super::Contact;

/// Rounds over a contact's normals in a pass. With one, a heavy object slides 1.5 times as far as it should.
const NORMAL_ROUNDS: usize = 2;
/// Where all points press, as many rounds as two to this power cost the same: they are one matrix.
const DOUBLINGS: usize = 3;
/// Overlaps up to this are left alone: points that are pushed out of contact come back in the next step, and what they
/// hold trembles.
const SLOP_M: f32 = 0.000_05;
/// Bodies that overlap are not pushed apart faster than this.
const CORRECTION_M_S_MAX: f32 = 0.3;

/// What a pass of the solver goes by.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::stepper) struct Pass {
    /// Whether bodies that overlap are pushed apart (the second pass takes out the speed that this gave).
    pub(in crate::stepper) corrects: bool,
    /// One over the length of the substep.
    pub(in crate::stepper) rate_hz: f32,
    /// Share of an overlap that is corrected, per second, and the softness of that push.
    pub(in crate::stepper) correction_1_s: f32,
    pub(in crate::stepper) softness: f32,
}

/// How a contact's bodies move: the second's linear motion less the first's, and those that turn.
pub(in crate::stepper) struct Relative<const T: usize> {
    pub(in crate::stepper) linear: f32x4,
    pub(in crate::stepper) angular: [f32x4; T],
}

/// What a pass adds: an impulse on the second body, and the turns.
pub(in crate::stepper) struct Push<const T: usize> {
    pub(in crate::stepper) impulse: f32x4,
    pub(in crate::stepper) angular: [f32x4; T],
}

impl<const T: usize> Contact<T> {
    pub(super) fn likely_to_press(&self) -> f32x4 {
        self.gaps_m.simd_le(f32x4::ZERO) | self.memory.normal.simd_gt(f32x4::ZERO)
    }

    /// Makes the matrices: the sweeps of [`Self::press_each`] and [`Self::rub_each`], without limits, over unit
    /// vectors.
    pub(super) fn foresee(&mut self) {
        self.bearing = self.likely_to_press();
        let bears = self.bearing.to_array().map(|lane| lane.to_bits() != 0);
        let columns = self.from_normal[0].map(f32x4::to_array);
        let mut rows = [f32x4::ZERO; 4];
        let by_others = |rows: &[f32x4; 4], i: usize| product(rows, f32x4::from(columns.map(|column| column[i])));
        for i in (0..self.count).filter(|i| bears[*i]) {
            rows[i] = UNIT[i] - by_others(&rows, i);
        }
        for _ in 0..DOUBLINGS {
            // What is left undone is done in the same way.
            let left: [f32x4; 4] = core::array::from_fn(|i| UNIT[i] - rows[i] - by_others(&rows, i));
            rows = rows.map(|row| row + product(&left, row));
        }
        self.pressed_by = f32x4::transpose(rows);
        let from = self.from_tangents.map(|onto| onto.map(|columns| columns.map(f32x4::to_array)));
        let masses = self.mass_tangents.map(f32x4::to_array);
        let mut rows = [[[f32x4::ZERO; 4]; 2]; 2];
        for i in (0..self.count).filter(|i| bears[*i]) {
            let mut speeds = [[UNIT[i], f32x4::ZERO], [f32x4::ZERO, UNIT[i]]];
            for j in 0..i {
                for (along, row) in rows.iter().enumerate() {
                    for (onto, speeds) in speeds.iter_mut().enumerate() {
                        let share = f32x4::splat(from[along][onto][j][i]);
                        speeds[0] += row[0][j] * share;
                        speeds[1] += row[1][j] * share;
                    }
                }
            }
            let [xx, xy, yy, _] = [0, 1, 2, 3].map(|entry| f32x4::splat(-masses[entry][i]));
            for of in 0..2 {
                let [x, y] = [speeds[0][of], speeds[1][of]];
                (rows[0][of][i], rows[1][of][i]) = (xx * x + xy * y, xy * x + yy * y);
            }
        }
        self.rubbed_by = rows.map(|along| along.map(f32x4::transpose));
    }

    /// The impulses that the contact had before.
    #[inline(always)]
    pub(in crate::stepper) fn warm_start(&self) -> Push<T> {
        let [x, y] = self.memory.friction;
        self.push_of([self.memory.normal, x, y])
    }

    #[inline(always)]
    fn push_of(&self, impulses: [f32x4; 3]) -> Push<T> {
        let [a, b, c, d] = f32x4::transpose([impulses[0], impulses[1], impulses[2], f32x4::ZERO]);
        let along = (a + b) + (c + d);
        let [x, y, z] = self.directions.map(|coordinate| coordinate * along);
        let [n, t, u, _] = f32x4::transpose([x, y, z, f32x4::ZERO]);
        let mut angular = [f32x4::ZERO; T];
        for (turning, angular) in angular.iter_mut().enumerate() {
            let [n, x, y] = [0, 1, 2].map(|row| product(&self.arms_of_point[row][turning], impulses[row]));
            *angular = n + x + y;
        }
        Push { impulse: n + t + u, angular }
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

    /// The bodies have moved by `ways` since the step began.
    #[inline(always)]
    pub(in crate::stepper) fn advance(&mut self, ways: &Relative<T>) {
        self.ways_m = self.along(ways);
    }

    /// One pass over the contact: changes its impulses, and gives what they add.
    #[inline(always)]
    pub(in crate::stepper) fn solve(&mut self, pass: &Pass, speeds: &Relative<T>) -> Option<Push<T>> {
        let [normal_speeds, x_speeds, y_speeds] = self.along(speeds);
        let gaps_m = self.gaps_m + self.ways_m[0];
        let rate = f32x4::splat(pass.rate_hz);
        let open = gaps_m.simd_gt(f32x4::ZERO);
        let is_spring = self.yields > 0.0;
        let push = if is_spring {
            gaps_m * rate
        } else if pass.corrects {
            ((gaps_m + f32x4::splat(SLOP_M)).fast_min(f32x4::ZERO) * f32x4::splat(pass.correction_1_s))
                .fast_max(f32x4::splat(-CORRECTION_M_S_MAX))
        } else {
            f32x4::ZERO
        };
        let normal_speeds = normal_speeds + open.bitselect(gaps_m * rate, push);
        let before = self.memory.normal;
        if (before.simd_gt(f32x4::ZERO) | normal_speeds.simd_lt(f32x4::ZERO)).none() {
            return None;
        }
        let mut tangent_speeds = [x_speeds, y_speeds];
        let mut soft = f32x4::ONE;
        if pass.corrects {
            tangent_speeds[0] += self.ways_m[1] * rate;
            tangent_speeds[1] += self.ways_m[2] * rate;
            soft = if is_spring { soft } else { open.bitselect(soft, f32x4::splat(pass.softness)) };
        }
        // A spring keeps the speed that it gave: it presses by how deep it is when the substep ends.
        if pass.corrects || !is_spring {
            self.bear(normal_speeds + before * f32x4::splat(self.yields), soft);
        }
        let normal_gains = self.memory.normal - before;
        for (speeds, from) in tangent_speeds.iter_mut().zip(&self.from_normal[1..]) {
            *speeds += product(from, normal_gains);
        }
        let before = self.memory.friction;
        let [[xx, xy], [yx, yy]] = &self.rubbed_by;
        let [along_x, along_y] = tangent_speeds;
        let x = before[0] + (product(xx, along_x) + product(xy, along_y));
        let y = before[1] + (product(yx, along_x) + product(yy, along_y));
        let limits = self.memory.normal * f32x4::splat(self.friction);
        let foreseen = self.bearing | limits.simd_le(f32x4::ZERO);
        if (foreseen & (x * x + y * y).simd_le(limits * limits)).all() {
            self.memory.friction = [x, y];
        } else {
            self.rub_each(tangent_speeds, limits);
        }
        let [x, y] = self.memory.friction;
        Some(self.push_of([normal_gains, x - before[0], y - before[1]]))
    }

    /// Changes the normal impulses by what ends these speeds.
    #[inline(always)]
    fn bear(&mut self, speeds: f32x4, soft: f32x4) {
        let (before, wanted) = (self.memory.normal, self.mass_normal * speeds);
        let change = (soft - f32x4::ONE) * before - soft * wanted;
        let gains = product(&self.pressed_by, change);
        let pressed = before + gains;
        // What the others would want: to pull, from nothing.
        let stay = (change - product(&self.from_normal[0], gains)).fast_max(before).simd_le(f32x4::ZERO);
        if self.bearing.bitselect(pressed.simd_ge(f32x4::ZERO), stay).all() {
            self.memory.normal = pressed;
        } else {
            self.press_each((before - wanted) * soft, soft);
        }
    }

    /// Normal impulses, one after the other: none pulls.
    #[inline(always)]
    fn press_each(&mut self, mut wanted: f32x4, soft: f32x4) {
        let columns = self.from_normal[0].map(|column| column * soft);
        let mut impulses = self.memory.normal.to_array();
        for _ in 0..NORMAL_ROUNDS {
            // With lanes that are known when this is compiled, nothing goes through memory.
            press::<0>(&mut wanted, &mut impulses, columns[0]);
            if self.count > 1 {
                press::<1>(&mut wanted, &mut impulses, columns[1]);
            }
            if self.count > 2 {
                press::<2>(&mut wanted, &mut impulses, columns[2]);
            }
            if self.count > 3 {
                press::<3>(&mut wanted, &mut impulses, columns[3]);
            }
        }
        self.memory.normal = f32x4::from(impulses);
    }

    /// Friction, one point after the other: in its cone at every one.
    #[inline(always)]
    fn rub_each(&mut self, mut speeds: [f32x4; 2], limits: f32x4) {
        let mut impulses = self.memory.friction.map(f32x4::to_array);
        self.rub_at::<0>(&mut speeds, &mut impulses, limits);
        if self.count > 1 {
            self.rub_at::<1>(&mut speeds, &mut impulses, limits);
        }
        if self.count > 2 {
            self.rub_at::<2>(&mut speeds, &mut impulses, limits);
        }
        if self.count > 3 {
            self.rub_at::<3>(&mut speeds, &mut impulses, limits);
        }
        self.memory.friction = impulses.map(f32x4::from);
    }

    #[inline(always)]
    fn rub_at<const P: usize>(
        &self,
        [x_speeds, y_speeds]: &mut [f32x4; 2],
        [x_impulses, y_impulses]: &mut [[f32; 4]; 2],
        limits: f32x4,
    ) {
        let old = [x_impulses[P], y_impulses[P]];
        let (x, y) = (x_speeds.as_array()[P], y_speeds.as_array()[P]);
        let [xx, xy, yy, both] = self.mass_tangents.map(|entries| entries.as_array()[P]);
        let mut new = [old[0] - (xx * x + xy * y), old[1] - (xy * x + yy * y)];
        let limit = limits.as_array()[P];
        if new[0] * new[0] + new[1] * new[1] > limit * limit {
            // It slides. What stops a point lies not along its velocity, for it turns the body too; friction does.
            new = [old[0] - both * x, old[1] - both * y];
            let squared = new[0] * new[0] + new[1] * new[1];
            let scale = limit / squared.sqrt();
            new = [new[0] * scale, new[1] * scale];
        }
        let (x_gain, y_gain) = (f32x4::splat(new[0] - old[0]), f32x4::splat(new[1] - old[1]));
        *x_speeds += self.from_tangents[0][0][P] * x_gain + self.from_tangents[1][0][P] * y_gain;
        *y_speeds += self.from_tangents[0][1][P] * x_gain + self.from_tangents[1][1][P] * y_gain;
        (x_impulses[P], y_impulses[P]) = (new[0], new[1]);
    }

    /// Counts what pressed in a substep.
    pub(in crate::stepper) fn count_pressed(&mut self) {
        self.memory.pressed += self.memory.normal;
    }
}

/// One for a point.
const UNIT: [f32x4; 4] = [
    f32x4::new([1.0, 0.0, 0.0, 0.0]),
    f32x4::new([0.0, 1.0, 0.0, 0.0]),
    f32x4::new([0.0, 0.0, 1.0, 0.0]),
    f32x4::new([0.0, 0.0, 0.0, 1.0]),
];

/// A matrix of columns by a vector.
#[inline(always)]
fn product(columns: &[f32x4; 4], vector: f32x4) -> f32x4 {
    let at = |point: usize| columns[point] * f32x4::splat(vector.as_array()[point]);
    (at(0) + at(1)) + (at(2) + at(3))
}

/// Gives a point the normal impulse that it wants; `column` is what that gives the others.
#[inline(always)]
fn press<const P: usize>(wanted: &mut f32x4, impulses: &mut [f32; 4], column: f32x4) {
    let new = wanted.as_array()[P].max(0.0);
    *wanted -= column * f32x4::splat(new - impulses[P]);
    impulses[P] = new;
}
