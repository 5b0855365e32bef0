//! A stepper made for grasp attempts and for piles: a table, a gripper, walls, fixtures, and a few bodies of convex
//! parts.
//!
//! The method is rapier's: substeps with warm-started, soft contacts and Coulomb cones, each solved once with and twice
//! without the push against overlap (with one such pass, what is pressed from both sides trembles: the fingers take 97
//! steps to stop and lift instead of 60). What makes it fast is what an attempt is: few bodies of which most never
//! move, a gripper that does not turn (so that its boxes stay parallel to the axes), and fingers with one direction of
//! freedom, which need no joints. Bodies sleep until something comes within [`patch::PREDICTION_M`] of them.
//!
//! All arithmetic is in single precision, four lanes wide on every machine, with nothing fused: the same bits anywhere.

mod attempt;
mod contact;
mod jaws;
mod patch;
mod pile;
mod push;
mod shape;
#[cfg(test)]
mod tests;

use schema::{Physics, Pose, Quat, Vec3};
use wide::f32x4;

use crate::bodies::Bodies;
use contact::{Answer, Contact, Contacts, Motion, Pass, Relative, Touched, lanes};
use patch::{Frame, Patch, Scratch};
use push::{push_both, push_led, push_one, relative};
use shape::Thing;

pub(crate) use jaws::Jaws;
use jaws::Led;
pub(crate) use shape::{Things, Wide3, span, wide};

/// rapier's damping ratio of contact springs.
const CONTACT_DAMPING_RATIO: f32 = 10.0;
/// Bodies whose contacts are kept touch where they did until they have gone this far, in metres: less than fingers sink
/// in.
const KEEPS_M: f32 = 0.000_03;
/// So many passes it takes until two springs that press on a thing agree.
const SPRING_SWEEPS: usize = 5;
/// What a contact's `first` is for the table; then come the gripper's boxes, then the four walls, then the fixtures.
const TABLE: usize = 0;
const WALLS: usize = 4;
const FIXTURES: usize = 8;

/// The state of an attempt, in the frame of the grasp, or of a pile, in that of the workspace.
#[derive(Clone, Default)]
pub(crate) struct Stepper<'a> {
    things: &'a [Thing],
    fixtures: &'a [shape::Part],
    /// The workspace, in which fixtures are.
    workspace: Frame,
    table_friction: f32,
    step_s: f32,
    substeps: usize,
    gravity_m_s2: Vec3,
    /// How this frame turns, if it does.
    turning: Option<Turning>,
    pub(crate) damping_1_s: f32,
    /// The table, then walls.
    planes: Vec<Plane>,
    passes: [Pass; 3],
    pub(crate) jaws: Jaws,
    /// Of the first things.
    bodies: Vec<Body>,
    singles: Contacts<1>,
    doubles: Contacts<2>,
    /// With led jaws.
    led: Contacts<2>,
    /// How far bodies and fingers may go before contacts are looked for anew; until then they go on with the points
    /// that they have. In metres.
    keeps_m: f32,
    /// How far they have gone since contacts were looked for.
    gone_m: f32,
    /// Axes along which parts of two bodies were apart when last asked.
    apart: Vec<(u64, Vec3)>,
    queue: Vec<usize>,
    scratch: Scratch,
    /// The parts of two bodies that are near each other.
    near_parts: [Vec<usize>; 2],
}

/// Where a half-space ends that nothing enters: normal·x = offset.
#[derive(Clone, Copy)]
struct Plane {
    normal: Vec3,
    offset_m: f32,
}

#[derive(Clone, Default)]
struct Body {
    rotation: Quat,
    frame: Frame,
    answer: Answer,
    velocity_m_s: Vec3,
    spin_rad_s: Vec3,
    speeds: Motion,
    /// The integral of that since the step began.
    ways: Motion,
    weight_share: f32,
    is_awake: bool,
}

impl Body {
    fn new(thing: &Thing, pose: &Pose, is_awake: bool) -> Self {
        let (centre_m, inverse_mass) = (pose.transform_point(thing.centre_m), 1.0 / thing.mass_kg);
        let answer = Answer { centre_m, inverse_mass, ..Answer::default() };
        let (rotation, weight_share) = (pose.rotation, thing.weight_share);
        let mut body = Self { rotation, answer, weight_share, is_awake, ..Self::default() };
        body.place(thing);
        body
    }

    /// Its frame and its centre of mass, as the world or a led jaw sees them.
    fn seen_from(&self, led: Option<&Led>) -> (Frame, Vec3) {
        match led {
            Some(led) => (led.frame.sees(&self.frame), led.frame.in_body(self.answer.centre_m)),
            None => (self.frame, self.answer.centre_m),
        }
    }

    /// Brings what follows from centre and rotation up to date.
    fn place(&mut self, thing: &Thing) {
        let axes = axes_of(self.rotation);
        let turned = Frame { axes, origin_m: Vec3::ZERO }.turn(thing.centre_m);
        self.frame = Frame { axes, origin_m: self.answer.centre_m - turned };
        self.answer.principal =
            if thing.principal == Quat::IDENTITY { axes } else { axes_of(self.rotation * thing.principal) };
        let roots = thing.root_inverse_inertia.to_array();
        self.answer.scaled_axes = core::array::from_fn(|i| self.answer.principal[i] * roots[i]);
    }

    fn begin_step(&mut self, thing: &Thing) {
        let roots = thing.root_inverse_inertia.to_array();
        let angular = [0, 1, 2].map(|i| self.answer.principal[i].dot(self.spin_rad_s) / roots[i]);
        self.speeds = Motion { linear: lanes(self.velocity_m_s), angular: lanes(Vec3::from_array(angular)) };
        self.ways = Motion::default();
    }

    /// Gains what a body that nothing holds gains in a frame that turns: by Euler's, the centrifugal and Coriolis's
    /// acceleration, and as its own spin precesses.
    fn sway(&mut self, thing: &Thing, turning: &Turning, time_s: f32) {
        let Turning { pivot_m, rate_rad_s: rate, change_rad_s2: change } = *turning;
        let [[way_m, _], [velocity_m_s, spin_rad_s]] = [self.in_world(self.ways), self.in_world(self.speeds)];
        let from_pivot_m = self.answer.centre_m + way_m - pivot_m;
        let linear_m_s2 =
            -change.cross(from_pivot_m) - rate.cross(rate.cross(from_pivot_m)) - 2.0 * rate.cross(velocity_m_s);
        let time_s = time_s * self.weight_share;
        self.speeds.linear += lanes(linear_m_s2 * time_s);
        let axes = self.answer.principal;
        let along = |v: Vec3| Vec3::from_array(axes.map(|axis| axis.dot(v)));
        let inverse = thing.root_inverse_inertia * thing.root_inverse_inertia;
        let spin = along(rate + spin_rad_s);
        let precession_rad_s2 = -spin.cross(spin / inverse) * inverse;
        let angular_rad_s2 = precession_rad_s2 - along(change + rate.cross(spin_rad_s));
        self.speeds.angular += lanes(angular_rad_s2 * time_s / thing.root_inverse_inertia);
    }

    /// Linear and angular part of speeds or ways, in the world.
    fn in_world(&self, motion: Motion) -> [Vec3; 2] {
        let ([x, y, z, _], [a, b, c, _]) = (motion.linear.to_array(), motion.angular.to_array());
        let [first, second, third] = self.answer.scaled_axes;
        [Vec3::new(x, y, z), first * a + second * b + third * c]
    }

    /// Gives how far any of it has gone, at most, in metres.
    fn end_step(&mut self, thing: &Thing) -> f32 {
        [self.velocity_m_s, self.spin_rad_s] = self.in_world(self.speeds);
        let [way_m, turn_rad] = self.in_world(self.ways);
        self.answer.centre_m += way_m;
        let half = turn_rad * 0.5;
        self.rotation = (Quat::from_xyzw(half.x, half.y, half.z, 1.0) * self.rotation).normalize();
        self.place(thing);
        way_m.length() + thing.radius_m * turn_rad.length()
    }
}

/// How a frame turns in which nothing else does: about a point, at a rate that changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Turning {
    pub(crate) pivot_m: Vec3,
    pub(crate) rate_rad_s: Vec3,
    pub(crate) change_rad_s2: Vec3,
}

fn axes_of(rotation: Quat) -> [Vec3; 3] {
    [rotation * Vec3::X, rotation * Vec3::Y, rotation * Vec3::Z]
}

impl<'a> Stepper<'a> {
    /// The `things` at rest on a table at `table_z_m`, and a gripper at `workspace_from_grasp`. Things are asleep until
    /// touched, unless `all_awake`.
    pub(crate) fn new(
        physics: &Physics,
        jaws: Jaws,
        things: &'a Things,
        table_z_m: f32,
        workspace_from_grasp: &Pose,
        all_awake: bool,
    ) -> Self {
        let grasp_from_workspace = workspace_from_grasp.inverse();
        let mut stepper = Self::empty(physics, things, table_z_m, &grasp_from_workspace);
        stepper.jaws = jaws;
        let body = |thing: &Thing| Body::new(thing, &(grasp_from_workspace * thing.workspace_from_object), all_awake);
        stepper.bodies.extend(things.moving.iter().map(body));
        stepper
    }

    /// A table for a pile of `things`, of which none is there yet.
    pub(crate) fn pile(physics: &Physics, damping_1_s: f32, things: &'a Things, table_z_m: f32) -> Self {
        Self { damping_1_s, ..Self::empty(physics, things, table_z_m, &Pose::IDENTITY) }
    }

    fn empty(physics: &Physics, things: &'a Things, table_z_m: f32, world_from_workspace: &Pose) -> Self {
        let Things { moving: things, fixtures } = things;
        let up = world_from_workspace.rotation * Vec3::Z;
        let table_m = up.dot(world_from_workspace.transform_point(Vec3::new(0.0, 0.0, table_z_m)));
        let substep_s = physics.dt_s() / physics.solver_iterations as f32;
        let frequency = core::f32::consts::TAU * physics.contact_frequency_hz;
        let correction_1_s = frequency / (substep_s * frequency + 2.0 * CONTACT_DAMPING_RATIO);
        let left = 1.0 / (substep_s * correction_1_s) - 1.0;
        let compliance = left * left / ((1.0 + left) * 4.0 * CONTACT_DAMPING_RATIO * CONTACT_DAMPING_RATIO);
        let pass = |corrects: bool| Pass {
            corrects,
            rate_hz: 1.0 / substep_s,
            correction_1_s,
            softness: 1.0 / (1.0 + compliance),
        };
        Self {
            things,
            fixtures,
            workspace: Frame {
                axes: axes_of(world_from_workspace.rotation),
                origin_m: world_from_workspace.translation,
            },
            table_friction: physics.table_friction,
            step_s: physics.dt_s(),
            substeps: physics.solver_iterations,
            gravity_m_s2: up * -physics.gravity_m_s2,
            planes: vec![Plane { normal: up, offset_m: table_m }],
            passes: [pass(true), pass(false), pass(false)],
            jaws: Jaws::absent(),
            ..Self::default()
        }
    }

    /// From now on, whatever is free gains `gravity_m_s2` in this frame, which turns besides if `turning` says so.
    pub(crate) fn accelerate(&mut self, gravity_m_s2: Vec3, turning: Option<Turning>) {
        (self.gravity_m_s2, self.turning) = (gravity_m_s2, turning);
    }

    /// From now on contacts are not looked for while everything stays where it is. Nothing may be asleep.
    pub(crate) fn keep_contacts(&mut self) {
        (self.keeps_m, self.gone_m) = (KEEPS_M, f32::INFINITY);
    }

    /// Where a finger presses on a body: the middle of the points on the part on which it presses most.
    pub(crate) fn pressed_at_m(&self, finger: usize, id: usize) -> Option<Vec3> {
        let on = self.singles.iter().filter(|c| c.first == 1 + finger && c.second == id).map(Contact::bearing);
        let led = self.led.iter().filter(|c| c.first == finger && c.second == id).map(Contact::bearing);
        let most = on.chain(led).filter(|(points_m, _)| !points_m.is_empty()).max_by(|a, b| a.1.total_cmp(&b.1));
        most.map(|(points_m, _)| points_m.iter().sum::<Vec3>() / points_m.len() as f32)
    }

    /// A body's own mass as a share of its inertia, which is 1 but for light ones in a strong gripper.
    pub(crate) fn weight_share(&self, id: usize) -> f32 {
        self.bodies[id].weight_share
    }

    /// The centre of mass of a body.
    pub(crate) fn centre_m(&self, id: usize) -> Vec3 {
        self.bodies[id].answer.centre_m
    }

    fn find_contacts(&mut self) {
        self.singles.begin_step();
        self.doubles.begin_step();
        self.led.begin_step();
        self.jaws.lead();
        self.queue.clear();
        for id in 0..self.bodies.len() {
            if self.bodies[id].is_awake || self.is_near_gripper(id) {
                self.bodies[id].is_awake = true;
                self.queue.push(id);
            }
        }
        let mut next = 0;
        while next < self.queue.len() {
            let id = self.queue[next];
            next += 1;
            self.touch_planes(id);
            self.touch_fixtures(id);
            for other in 0..self.bodies.len() {
                // Those before it in the queue have asked already.
                if !self.queue[..next].contains(&other) {
                    self.touch_each_other(id, other);
                }
            }
        }
        for which in [2, 0, 1] {
            for id in 0..self.bodies.len() {
                if self.bodies[id].is_awake {
                    self.touch_gripper(which, id);
                }
            }
        }
    }

    fn is_near_gripper(&mut self, id: usize) -> bool {
        let (body, thing) = (&self.bodies[id], &self.things[id]);
        (0..3).any(|which| {
            let (frame, near_m) = body.seen_from(self.jaws.led[which].as_ref());
            (0..self.jaws.boxes[which].len()).any(|number| {
                let (centre_m, half_m) = self.jaws.box_at(which, number);
                patch::ball_near_box(near_m, thing.radius_m, centre_m, half_m)
                    && thing
                        .parts
                        .iter()
                        .any(|part| patch::on_box(centre_m, half_m, &frame, part, &mut self.scratch).is_some())
            })
        })
    }

    fn touch_planes(&mut self, id: usize) {
        let (body, thing) = (&self.bodies[id], &self.things[id]);
        for (which, plane) in self.planes.iter().enumerate() {
            let Plane { normal, offset_m } = *plane;
            if normal.dot(body.answer.centre_m) - thing.radius_m - offset_m > patch::PREDICTION_M {
                continue;
            }
            let obstacle = if which == 0 { TABLE } else { WALLS + which - 1 };
            for (part, shape) in thing.parts.iter().enumerate() {
                let friction = self.table_friction * thing.friction;
                let key = key([obstacle, 0], [id, part]);
                patch::on_plane(normal, offset_m, &body.frame, shape, &mut self.scratch, |patch| {
                    self.singles.add(key, [obstacle, id], [friction, 0.0], patch, Touched::Fixed, &body.answer);
                });
            }
        }
    }

    fn touch_fixtures(&mut self, id: usize) {
        let (thing, fixtures) = (&self.things[id], self.fixtures);
        for (number, fixture) in fixtures.iter().enumerate() {
            for (part, shape) in thing.parts.iter().enumerate() {
                let key = key([FIXTURES, number], [id, part]);
                let frames = [self.workspace, self.bodies[id].frame];
                if let Some(patch) = self.patch_between(key, frames, [fixture, shape]) {
                    let friction = self.table_friction * thing.friction;
                    let answer = &self.bodies[id].answer;
                    self.singles.add(key, [FIXTURES, id], [friction, 0.0], &patch, Touched::Fixed, answer);
                }
            }
        }
    }

    fn touch_gripper(&mut self, which: usize, id: usize) {
        let (body, thing, led) = (&self.bodies[id], &self.things[id], self.jaws.led[which].as_ref());
        let surface =
            [self.jaws.friction * thing.friction, self.jaws.yields(which, self.substeps as f32 / self.step_s)];
        let (frame, near_m) = body.seen_from(led);
        for number in 0..self.jaws.boxes[which].len() {
            let (centre_m, half_m) = self.jaws.box_at(which, number);
            if !patch::ball_near_box(near_m, thing.radius_m, centre_m, half_m) {
                continue;
            }
            let (at_m, reach_m) = (frame.in_body(centre_m), half_m + patch::REACH_M);
            for (part, shape) in thing.near_box(at_m, reach_m, frame.turned_axes()) {
                let Some(patch) = patch::on_box(centre_m, half_m, &frame, shape, &mut self.scratch) else { continue };
                let key = key([1 + which, number], [id, part]);
                if let Some(Led { frame, answer, along }) = led {
                    let jaw = Touched::Jaw { answer, along: *along };
                    self.led.add(key, [which, id], surface, &frame.world(&patch), jaw, &body.answer);
                    continue;
                }
                let finger = Touched::Finger { inverse_mass: self.jaws.inverse_mass(which) };
                self.singles.add(key, [1 + which, id], surface, &patch, finger, &body.answer);
            }
        }
    }

    fn touch_each_other(&mut self, id: usize, other: usize) {
        let (first, second) = (id.min(other), id.max(other));
        let reach_m = self.things[first].radius_m + self.things[second].radius_m + patch::PREDICTION_M;
        let apart_m = self.bodies[first].answer.centre_m - self.bodies[second].answer.centre_m;
        if apart_m.length_squared() > reach_m * reach_m {
            return;
        }
        let things = self.things;
        let mut near = core::mem::take(&mut self.near_parts);
        for (found, [id, other]) in near.iter_mut().zip([[first, second], [second, first]]) {
            // Of many parts few come near.
            let (frame, centre_m) = (&self.bodies[id].frame, self.bodies[other].answer.centre_m);
            let is_near = |part: &usize| {
                let hull = &things[id].parts[*part].hull;
                let reach_m = hull.radius_m + things[other].radius_m + patch::PREDICTION_M;
                (frame.in_world(hull.centre_m) - centre_m).length_squared() <= reach_m * reach_m
            };
            found.clear();
            found.extend((0..things[id].parts.len()).filter(is_near));
        }
        for part in near[0].iter().copied() {
            for other_part in near[1].iter().copied() {
                let (shape, other_shape) = (&things[first].parts[part], &things[second].parts[other_part]);
                let key = key([64 + first, part], [second, other_part]);
                let frames = [first, second].map(|id| self.bodies[id].frame);
                if let Some(patch) = self.patch_between(key, frames, [shape, other_shape]) {
                    let [a, b] = [&self.bodies[first].answer, &self.bodies[second].answer];
                    let friction = things[first].friction * things[second].friction;
                    self.doubles.add(key, [first, second], [friction, 0.0], &patch, Touched::Body(a), b);
                    if !self.bodies[other].is_awake {
                        self.bodies[other].is_awake = true;
                        self.queue.push(other);
                    }
                }
            }
        }
        self.near_parts = near;
    }

    fn patch_between(&mut self, key: u64, frames: [Frame; 2], parts: [&shape::Part; 2]) -> Option<Patch> {
        let centres_m: [Vec3; 2] = core::array::from_fn(|i| frames[i].in_world(parts[i].hull.centre_m));
        let apart_m = centres_m[1] - centres_m[0];
        let reach_m = parts[0].hull.radius_m + parts[1].hull.radius_m + patch::PREDICTION_M;
        if apart_m.length_squared() > reach_m * reach_m {
            return None;
        }
        let known = self.apart.iter().position(|(of, _)| *of == key);
        if let Some(known) = known {
            let axis = self.apart[known].1;
            let span =
                |i: usize| parts[i].hull.span(frames[i].turn_back(axis)).map(|x| x + axis.dot(frames[i].origin_m));
            if span(1)[0] - span(0)[1] > patch::PREDICTION_M {
                return None;
            }
        }
        match patch::between(parts, [&frames[0], &frames[1]], &mut self.scratch) {
            Ok(patch) => Some(patch),
            Err(axis) => {
                match (axis, known) {
                    (Some(axis), Some(known)) => self.apart[known].1 = axis,
                    (Some(axis), None) => self.apart.push((key, axis)),
                    (None, _) => {}
                }
                None
            }
        }
    }

    fn solve(&mut self) {
        let substep_s = self.step_s / self.substeps as f32;
        let closed_m = self.jaws.closed_m();
        for (body, thing) in self.bodies.iter_mut().zip(self.things).filter(|(body, _)| body.is_awake) {
            body.begin_step(thing);
        }
        self.jaws.begin_step();
        let (gained, kept) = (lanes(self.gravity_m_s2 * substep_s), 1.0 / (1.0 + self.damping_1_s * substep_s));
        for substep in 0..self.substeps {
            let begun_s = substep as f32 * substep_s;
            for body in self.bodies.iter_mut().filter(|body| body.is_awake) {
                let gained = gained * f32x4::splat(body.weight_share);
                body.speeds.linear = (body.speeds.linear + gained) * f32x4::splat(kept);
                body.speeds.angular *= f32x4::splat(kept);
            }
            if let Some(turning) = &self.turning {
                for (body, thing) in self.bodies.iter_mut().zip(self.things).filter(|(body, _)| body.is_awake) {
                    body.sway(thing, turning, substep_s);
                }
            }
            self.warm_start();
            self.jaws.begin_substep(closed_m, begun_s);
            for pass in self.passes {
                for _ in 0..if pass.corrects && self.jaws.depth_m > 0.0 { SPRING_SWEEPS } else { 1 } {
                    self.jaws.solve(substep_s);
                    self.pass(&pass);
                }
                if pass.corrects {
                    for body in self.bodies.iter_mut().filter(|body| body.is_awake) {
                        body.ways.linear += body.speeds.linear * f32x4::splat(substep_s);
                        body.ways.angular += body.speeds.angular * f32x4::splat(substep_s);
                    }
                    self.jaws.advance(substep_s);
                    self.advance(begun_s + substep_s);
                }
            }
            self.singles.iter_mut().for_each(Contact::count_pressed);
            self.doubles.iter_mut().for_each(Contact::count_pressed);
            self.led.iter_mut().for_each(Contact::count_pressed);
        }
    }

    fn warm_start(&mut self) {
        for contact in self.doubles.iter() {
            let push = contact.warm_start();
            push_both(&mut self.bodies, contact, push);
        }
        for contact in self.singles.iter() {
            let push = contact.warm_start();
            push_one(&mut self.bodies[contact.second], &mut self.jaws, contact, push);
        }
        for contact in self.led.iter() {
            push_led(&mut self.bodies[contact.second], &mut self.jaws, contact, contact.warm_start());
        }
        self.jaws.warm_start();
    }

    /// Tells the contacts how far the bodies have moved since the step began, `time_s` ago.
    fn advance(&mut self, time_s: f32) {
        for contact in self.doubles.iter_mut() {
            let [a, b] = [&self.bodies[contact.first], &self.bodies[contact.second]];
            contact.advance(&relative(a.ways, b.ways));
        }
        for contact in self.singles.iter_mut() {
            let ways = self.bodies[contact.second].ways;
            let [_, way] = self.jaws.motion(contact.first, time_s);
            contact.advance(&Relative { linear: ways.linear - way, angular: [ways.angular] });
        }
        for contact in self.led.iter_mut() {
            let (ways, [_, [palm, way]]) =
                (self.bodies[contact.second].ways, self.jaws.led_motion(contact.first, time_s));
            contact.advance(&Relative { linear: ways.linear - palm, angular: [ways.angular, way] });
        }
    }

    /// One pass over all contacts.
    fn pass(&mut self, pass: &Pass) {
        for contact in self.doubles.iter_mut() {
            let [a, b] = [&self.bodies[contact.first], &self.bodies[contact.second]];
            if let Some(push) = contact.solve(pass, &relative(a.speeds, b.speeds)) {
                push_both(&mut self.bodies, contact, push);
            }
        }
        for contact in self.singles.iter_mut() {
            let body = &mut self.bodies[contact.second];
            let [speed, _] = self.jaws.motion(contact.first, 0.0);
            let speeds = Relative { linear: body.speeds.linear - speed, angular: [body.speeds.angular] };
            if let Some(push) = contact.solve(pass, &speeds) {
                push_one(body, &mut self.jaws, contact, push);
            }
        }
        for contact in self.led.iter_mut() {
            let body = &mut self.bodies[contact.second];
            let [[palm, speed], _] = self.jaws.led_motion(contact.first, 0.0);
            let speeds = Relative { linear: body.speeds.linear - palm, angular: [body.speeds.angular, speed] };
            if let Some(push) = contact.solve(pass, &speeds) {
                push_led(body, &mut self.jaws, contact, push);
            }
        }
    }
}

impl Bodies for Stepper<'_> {
    fn step(&mut self) {
        if self.gone_m < self.keeps_m {
            self.singles.iter_mut().for_each(Contact::go_on);
            self.doubles.iter_mut().for_each(Contact::go_on);
            self.led.iter_mut().for_each(Contact::go_on);
        } else {
            self.find_contacts();
            self.gone_m = 0.0;
        }
        let before_m = self.jaws.closed_m();
        self.solve();
        for (body, thing) in self.bodies.iter_mut().zip(self.things).filter(|(body, _)| body.is_awake) {
            self.gone_m += body.end_step(thing);
        }
        self.jaws.end_step(self.step_s);
        self.gone_m += self.jaws.closed_m().iter().zip(before_m).map(|(now, before)| (now - before).abs()).sum::<f32>();
    }

    fn pose(&self, object_id: usize) -> Pose {
        let body = &self.bodies[object_id];
        Pose::from_parts(body.frame.origin_m, body.rotation)
    }

    fn velocities(&self, object_id: usize) -> [Vec3; 2] {
        let body = &self.bodies[object_id];
        [body.velocity_m_s, body.spin_rad_s]
    }
}

/// Identifies the contact of two parts.
fn key([first, first_part]: [usize; 2], [second, second_part]: [usize; 2]) -> u64 {
    (first as u64) << 48 | (first_part as u64) << 32 | (second as u64) << 16 | second_part as u64
}
