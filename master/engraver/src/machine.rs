//! The controller's machine: motions in, trains of pulses out.
//!
//! The planner lives in a time of its own, the plan's. While all axes wait for the loop of one, that time stands; so
//! the plan is behind the board's time by a span that grows with each wait.

use std::collections::VecDeque;

use torno_grbl::code::Alarm;
use torno_grbl::machine::{self, Move, Overrides, Progress};
use torno_grbl::memory::Settings;
use torno_grbl::{Axes, Rate, Spindle};
use torno_grbl_board::{SIGNALS, Wired};
use torno_motion::{AxisLimits, Limits};
use torno_protocol::board::{
    Capability, Channel, Deadline, Description, Motor, MotorStimulus, Output, OutputPin, Pin, Role, Signal,
};
use torno_protocol::line::Level;
use torno_protocol::time::{Instant, Span};
use torno_stepper::{Axis, AxisSettings, Cause, Fault, Law, State};

use crate::homing::{Homing, Next, Surroundings, found_at};
use crate::joint::{self, Joint, LoopReport, Piece};
use crate::motions::Motions;
use crate::settings::{EngraverSettings, Others};

/// The letters of the axes.
const NAMES: [&str; 4] = ["x", "y", "z", "a"];
/// The one of them that turns: it has no ends, and its lengths are degrees.
const A: usize = 3;
const PM_PER_MM: f64 = 1e9;

/// The machine: a planner, and the axes.
#[derive(Clone, Debug)]
pub struct Machine {
    motions: Motions,
    joints: Vec<Joint>,
    settings: Settings,
    pulse_mm: [f64; 4],
    count_pm: [i64; 4],
    /// From one index mark of an encoder to the next; 0 without a loop.
    mark_mm: [f64; 4],
    half_travel_mm: [f64; 4],
    /// How fast each gains speed, in steps/s².
    gains: [f64; 4],
    others: Others,
    law: Law,
    /// The controller's position is the plan's and this, in steps.
    zero: Axes<i32>,
    rpm: f32,
    /// The plan's time is so far behind.
    behind: Span,
    /// The plan's time, while it stands.
    frozen: Option<Instant>,
    /// Where the segment that the axes have been given starts.
    given: Option<Instant>,
    /// Motions run, or are being stopped.
    moves: bool,
    /// They are to stand.
    holds: bool,
    /// The loops look once more then.
    ends: Option<Instant>,
    /// They have; what they find is corrected.
    ended: bool,
    homing: Option<Homing>,
    /// While an axis moves, where it is is told so often, and then.
    tells_every: Span,
    tells: Option<Instant>,
    now: Instant,
    progress: VecDeque<Progress>,
}

impl Machine {
    pub(crate) fn new(settings: &EngraverSettings) -> Self {
        let count = settings.axes as usize;
        let own: Vec<_> = (0..count).map(|axis| settings.axis(axis)).collect();
        let of = |value: &dyn Fn(usize) -> f64| core::array::from_fn(|n| if n < count { value(n) } else { 1.0 });
        let pulse_mm = of(&|n| own[n].scale().pulse_mm());
        let joints = own.iter().zip((0u8..).step_by(2)).map(|(own, pin)| Joint::new(Axis::new(own), pin));
        Self {
            motions: Motions::new(settings, limits(&Settings::default())),
            joints: joints.collect(),
            settings: Settings::default(),
            pulse_mm,
            count_pm: core::array::from_fn(|n| own.get(n).map_or(1, |own| own.scale().count_pm())),
            mark_mm: core::array::from_fn(|n| own.get(n).map_or(0.0, AxisSettings::index_mm)),
            half_travel_mm: of(&|n| own[n].mechanics.travel_mm / 2.0),
            gains: [1.0; 4],
            others: settings.others,
            law: settings.r#loop.law,
            zero: [0; 4],
            rpm: 0.0,
            behind: Span::ZERO,
            frozen: None,
            given: None,
            moves: false,
            holds: false,
            ends: None,
            ended: false,
            homing: None,
            tells_every: Span::from_millis(settings.tell_ms.into()),
            tells: None,
            now: Instant::START,
            progress: VecDeque::new(),
        }
    }

    /// X, Y, Z or A, by its place.
    pub fn axis(&self, axis: usize) -> Option<&Axis> {
        self.joints.get(axis).map(Joint::axis)
    }

    /// The plan's time.
    fn plan_time(&self, now: Instant) -> Instant {
        self.frozen.unwrap_or(Instant::from_nanos(now.as_nanos().saturating_sub(self.behind.as_nanos())))
    }

    /// Gives the axes the segment that is under way, if it is another one than before.
    fn take_segment(&mut self, now: Instant) -> bool {
        let time = self.plan_time(now);
        let Some(segment) = self.motions.segment().copied() else {
            let gone = self.given.take().is_some();
            if gone {
                self.joints.iter_mut().for_each(|joint| joint.cut_plan(time));
            }
            return gone;
        };
        if self.given.replace(segment.start) == Some(segment.start) {
            return false;
        }
        let (at, issued) = (self.motions.position(time), segment.issued(time));
        for (n, joint) in self.joints.iter_mut().enumerate() {
            let from = i64::from(at[n]) - i64::from(issued[n]);
            joint.push(Piece { start: segment.start, end: segment.end, from, train: segment.trains[n] });
        }
        true
    }

    /// Does all that is due.
    fn proceed(&mut self, now: Instant) {
        self.now = now;
        loop {
            let mut more = self.take_segment(now);
            for n in 0..self.joints.len() {
                while self.joints[n].poll_timeout().is_some_and(|deadline| deadline.at <= now) {
                    self.joints[n].axis_mut(now).handle_timeout(now);
                    more = true;
                }
                while let Some(said) = self.joints[n].poll(now) {
                    match said {
                        LoopReport::Stopped => self.stopped(now, n),
                        LoopReport::Alarm(alarm) => self.give_up(now, n, alarm),
                        LoopReport::Index => self.pass_index(now, n),
                        LoopReport::Miscounted(counts) => self.tell_miscounted(n, counts),
                    }
                    more = true;
                }
            }
            more |= self.thaw(now);
            let shift = self.behind;
            if self.frozen.is_none() {
                more |= self.motions.advance(self.plan_time(now));
                more |= self.take_segment(now);
                for (joint, gain) in self.joints.iter_mut().zip(self.gains) {
                    more |= joint.follow(now, shift, gain);
                    more |= joint.begin(now, shift);
                }
            }
            more |= self.end(now);
            if self.tells.is_some_and(|at| at <= now) {
                self.tell(now);
                self.tells = self.is_busy().then(|| now + self.tells_every);
            }
            if !more {
                return;
            }
        }
    }

    /// The loop of an axis has stopped its train.
    fn stopped(&mut self, now: Instant, axis: usize) {
        // If the motion was over but for its last pulses, its end is to come once more.
        self.ends = None;
        if self.others == Others::GoOn && !self.ended {
            return self.joints[axis].stop(now);
        }
        if self.frozen.is_none() {
            let time = self.plan_time(now);
            self.frozen = Some(time);
            self.joints.iter_mut().for_each(|joint| joint.cut(now));
            if self.law == Law::Pause {
                // It begins again from rest.
                self.motions.stop(time);
                self.take_segment(now);
            }
        }
        self.watch(now);
    }

    /// The loops are done: the plan's time goes on.
    fn thaw(&mut self, now: Instant) -> bool {
        let ready = self.joints.iter().all(Joint::is_ready);
        let Some(time) = self.frozen.take_if(|_| ready) else { return false };
        self.behind = now.since(time);
        if self.law == Law::Pause && self.moves && !self.holds && !self.ended {
            self.motions.start(time);
        }
        self.take_segment(now);
        let shift = self.behind;
        self.joints.iter_mut().for_each(|joint| joint.go_on(now, shift));
        true
    }

    /// The loop of an axis gives up: all axes stand.
    fn give_up(&mut self, now: Instant, axis: usize, alarm: torno_stepper::Alarm) {
        let name = NAMES[axis].to_uppercase();
        let (mm, short) = (alarm.error_pm as f64 / PM_PER_MM, if alarm.error_pm < 0 { "too far" } else { "short" });
        let unit = if axis == A { "deg" } else { "mm" };
        let what = match alarm.cause {
            Cause::Stalled => "stalled",
            Cause::TooFar => "lost",
        };
        self.forget_all(now);
        self.progress.push_back(Progress::Message(format!("{name} {what}, {:.4} {unit} {short}", mm.abs())));
        let searching = self.homing.take().is_some();
        self.progress.push_back(Progress::Failed(if searching { Alarm::NoEnd } else { Alarm::Aborted }));
        self.tell(now);
        self.tell_rest(now);
    }

    /// A search for the index mark of an axis has found it.
    fn pass_index(&mut self, now: Instant, axis: usize) {
        if let Some(homing) = &mut self.homing
            && homing.passes_mark(axis)
        {
            self.motions.hold(self.plan_time(now));
        }
    }

    fn tell_miscounted(&mut self, axis: usize, counts: i64) {
        let what = if counts > 0 { "had lost" } else { "had invented" };
        let text = format!("{} {what} {} counts", NAMES[axis].to_uppercase(), counts.unsigned_abs());
        self.progress.push_back(Progress::Message(text));
    }

    /// Stands at once, and forgets the motions.
    fn forget_all(&mut self, now: Instant) {
        let time = self.plan_time(now);
        self.motions.abort(time);
        self.behind = now.since(time);
        (self.frozen, self.given, self.ends) = (None, None, None);
        (self.moves, self.holds, self.ended) = (false, false, false);
        let at = self.motions.position(time);
        for (joint, at) in self.joints.iter_mut().zip(at) {
            joint.forget(now, i64::from(at));
        }
    }

    /// Ends the motions that are done.
    fn end(&mut self, now: Instant) -> bool {
        if !self.moves || self.frozen.is_some() {
            return false;
        }
        let shift = self.behind;
        let done = self.motions.segment().is_none() && self.joints.iter().all(|joint| joint.is_done(now, shift));
        match (self.ended, self.ends) {
            (false, None) if done => {
                // What rounding has left over comes now.
                self.joints.iter_mut().for_each(|joint| joint.go_on(now, shift));
                self.ends = self.joints.iter().map(Joint::until).chain([now.next()]).max();
                true
            }
            (false, Some(at)) if at <= now => {
                self.ends = None;
                self.ended = true;
                self.joints.iter_mut().for_each(|joint| joint.finish(now));
                true
            }
            (true, _) if self.joints.iter().all(Joint::is_ready) => {
                self.ended = false;
                self.rest(now);
                true
            }
            _ => false,
        }
    }

    /// All axes stand, and their loops are content.
    fn rest(&mut self, now: Instant) {
        self.moves = false;
        self.tell(now);
        self.tell_rest(now);
        if let Some(homing) = self.homing.take() {
            return self.search(now, homing);
        }
        let holds = core::mem::take(&mut self.holds);
        self.progress.push_back(if holds { Progress::Held } else { Progress::Finished });
    }

    /// Goes on with a search for the ends.
    fn search(&mut self, now: Instant, mut homing: Homing) {
        let time = self.plan_time(now);
        // A mark may have ended the motion before its end.
        self.motions.abort(time);
        let negative = self.settings.homes_negative();
        let to_end = |n: usize| {
            let joint = self.joints.get(n)?;
            let end = if *negative.get(n)? { -self.half_travel_mm[n] } else { self.half_travel_mm[n] };
            Some(end - joint.axis().carriage(now) as f64 / PM_PER_MM)
        };
        let next = homing.next(&Surroundings {
            settings: &self.settings,
            to_end: core::array::from_fn(|n| to_end(n).unwrap_or(0.0)),
            mark: self.mark_mm,
            travel: self.half_travel_mm.map(|half| 2.0 * half),
        });
        match next {
            Next::Leg(leg) => {
                for (joint, _) in self.joints.iter_mut().zip(leg.marks).filter(|(_, looks)| *looks) {
                    joint.axis_mut(now).seek_index(now);
                }
                let at = self.motions.position(time);
                let to = core::array::from_fn(|n| at[n].wrapping_add((leg.way[n] / self.pulse_mm[n]).round() as i32));
                self.homing = Some(homing);
                self.run(now, to, torno_motion::Rate::Jog(leg.rate));
            }
            Next::NoEnd => self.progress.push_back(Progress::Failed(Alarm::NoEnd)),
            Next::Done => self.found(now, &homing),
        }
    }

    /// All ends are found.
    fn found(&mut self, now: Instant, homing: &Homing) {
        let at = self.motions.position(self.plan_time(now));
        for (n, joint) in self.joints.iter_mut().enumerate() {
            if homing.has(n) {
                joint.axis_mut(now).reference(now);
                let place = if n == A { 0.0 } else { found_at(&self.settings, n) };
                self.zero[n] = ((place / self.pulse_mm[n]).round() as i32).wrapping_sub(at[n]);
            }
        }
        self.progress.push_back(Progress::Homed);
    }

    /// Does one motion of the machine's own.
    fn run(&mut self, now: Instant, to: [i32; 4], rate: torno_motion::Rate) {
        let time = self.plan_time(now);
        self.motions.push(time, to, rate);
        self.motions.start(time);
        self.moves = true;
        self.watch(now);
    }

    fn is_busy(&self) -> bool {
        self.moves || self.joints.iter().any(|joint| joint.axis().state() == State::Correcting)
    }

    /// From now on it is told where it is.
    fn watch(&mut self, now: Instant) {
        self.tells.get_or_insert(now + self.tells_every);
    }

    fn tell_rest(&mut self, now: Instant) {
        for (n, joint) in self.joints.iter_mut().enumerate() {
            joint.tell_rest(now, first_signal(n));
        }
    }

    fn tell(&mut self, now: Instant) {
        for (n, joint) in self.joints.iter_mut().enumerate() {
            joint.tell(now, self.pulse_mm[n] * 1e6, first_signal(n));
        }
    }
}

/// The number of the first quantity of an axis.
const fn first_signal(axis: usize) -> u8 {
    SIGNALS + axis as u8 * joint::SIGNALS
}

/// What the planner has to know of the settings.
fn limits(settings: &Settings) -> Limits {
    let axis = |n: usize| AxisLimits {
        steps_per_mm: settings.steps_per_mm[n].into(),
        max_rate: settings.max_rate[n].into(),
        acceleration: settings.acceleration[n].into(),
    };
    Limits { axes: core::array::from_fn(axis), junction_deviation: settings.junction_deviation().into() }
}

impl machine::Machine for Machine {
    fn configure(&mut self, settings: &Settings) {
        self.motions.set_limits(limits(settings));
        let gain = |n: usize| f64::from(settings.acceleration[n]) * f64::from(settings.steps_per_mm[n]);
        self.gains = core::array::from_fn(|n| gain(n).max(1.0));
        self.settings = settings.clone();
    }

    fn room(&self) -> usize {
        self.motions.room()
    }

    fn has_motions(&self) -> bool {
        !self.motions.is_empty()
    }

    fn push(&mut self, now: Instant, motion: Move) {
        let rate = match motion.rate {
            Rate::Rapid => torno_motion::Rate::Rapid,
            Rate::Feed(rate) => torno_motion::Rate::Feed(rate.into()),
            Rate::Jog(rate) => torno_motion::Rate::Jog(rate.into()),
            Rate::PerTurn(way) => torno_motion::Rate::Feed((way * self.rpm).into()),
            Rate::PerMinute(part) => torno_motion::Rate::InverseTime(part.into()),
        };
        let to = core::array::from_fn(|n| motion.to[n].wrapping_sub(self.zero[n]));
        self.motions.push(self.plan_time(now), to, rate);
        self.proceed(now);
    }

    fn start(&mut self, now: Instant, overrides: Overrides) {
        for joint in &mut self.joints {
            if joint.axis().state() == State::Alarmed {
                // Whoever has unlocked it takes the place where it stands for the right one.
                joint.axis_mut(now).reference(now);
            }
        }
        let time = self.plan_time(now);
        self.motions.set_overrides(time, overrides.feed, overrides.rapid);
        (self.moves, self.holds) = (true, false);
        (self.ends, self.ended) = (None, false);
        if self.frozen.is_none() || self.law == Law::AtOnce {
            self.motions.start(time);
        }
        self.watch(now);
        self.proceed(now);
    }

    fn hold(&mut self, now: Instant) {
        self.holds = true;
        self.motions.hold(self.plan_time(now));
        self.proceed(now);
    }

    fn forget(&mut self, now: Instant) {
        self.homing = None;
        self.forget_all(now);
        self.proceed(now);
    }

    fn home(&mut self, now: Instant, axes: Axes<bool>) {
        for joint in &mut self.joints {
            joint.axis_mut(now).reference(now);
        }
        self.homing = Some(Homing::new(axes));
        self.rest(now);
        self.proceed(now);
    }

    fn spindle(&mut self, _: Instant, sense: Spindle, rpm: f32) {
        self.rpm = if sense == Spindle::Off { 0.0 } else { rpm };
    }

    fn override_by(&mut self, now: Instant, overrides: Overrides) {
        self.motions.set_overrides(self.plan_time(now), overrides.feed, overrides.rapid);
        self.proceed(now);
    }

    fn position(&self, now: Instant) -> Axes<i32> {
        let at = self.motions.position(self.plan_time(now));
        core::array::from_fn(|n| at[n].wrapping_add(self.zero[n]))
    }

    fn rate(&self, now: Instant) -> f32 {
        if self.frozen.is_some() { 0.0 } else { self.motions.rate(self.plan_time(now)) as f32 }
    }

    fn ends(&self) -> Axes<bool> {
        let at_end = |n: usize| {
            let joint = self.joints.get(n).filter(|_| n != A)?;
            Some((joint.axis().carriage(self.now) as f64 / PM_PER_MM).abs() >= self.half_travel_mm[n])
        };
        core::array::from_fn(|n| at_end(n).unwrap_or(false))
    }

    fn poll_progress(&mut self) -> Option<Progress> {
        self.progress.pop_front()
    }
}

impl Wired for Machine {
    fn describe(&self, description: &mut Description) {
        for (motor, name) in (0u8..).zip(NAMES).take(self.joints.len()) {
            let signal = |what: &str, unit: &str, role| {
                Signal::new(&format!("{name}_{what}"), 0).with_unit(unit).with_role(role).of_motor(motor)
            };
            // A turns: a millionth of a degree is to it what a nanometre is to the others.
            let unit = if usize::from(motor) == A { "udeg" } else { "nm" };
            description.signals.extend([
                signal(&format!("command_{unit}"), unit, Role::SetPoint),
                signal(&format!("carriage_{unit}"), unit, Role::Position),
                signal("corrections", "", Role::Other),
                signal("checks", "", Role::Other),
                signal(&format!("worst_{unit}"), unit, Role::Other),
            ]);
            description.motors.push(Motor {
                name: name.to_owned(),
                capabilities: vec![Capability::Motor, Capability::Axis, Capability::Stepper],
            });
            let pin = |what: &str| OutputPin { name: format!("{name}_{what}"), first: Level::Low };
            description.pins.extend([pin("step"), pin("direction")]);
        }
    }

    fn quantities(&self, at: Instant) -> Vec<(u8, i64)> {
        let values = |(n, joint): (usize, &Joint)| (first_signal(n)..).zip(joint.values(at, self.pulse_mm[n] * 1e6));
        self.joints.iter().enumerate().flat_map(values).collect()
    }

    fn watch_pins(&mut self) {
        self.joints.iter_mut().zip(NAMES).for_each(|(joint, name)| joint.watch(name));
    }

    fn pins(&mut self, until: Instant) -> Vec<Pin> {
        self.joints.iter_mut().flat_map(|joint| joint.pins(until)).collect()
    }

    fn restart(&mut self, now: Instant) {
        self.homing = None;
        self.forget_all(now);
        self.progress.clear();
        let at = self.motions.position(self.plan_time(now));
        self.zero = at.map(i32::wrapping_neg);
        // The timers begin again.
        self.joints.iter_mut().for_each(|joint| joint.axis_mut(now).reference(now));
    }

    fn power(&mut self, now: Instant, on: bool) {
        for joint in &mut self.joints {
            joint.axis_mut(now).fault(now, Fault::Supply(if on { 1_000 } else { 0 }));
        }
    }

    fn disturb(&mut self, now: Instant, motor: u8, what: MotorStimulus) {
        let count_pm = self.count_pm.get(usize::from(motor)).copied().unwrap_or(1);
        let Some(joint) = self.joints.get_mut(usize::from(motor)) else { return };
        let fault = match what {
            MotorStimulus::Stall(stalled) => Fault::Stall(stalled),
            MotorStimulus::Counts(counts) => Fault::Counts(counts.into()),
            MotorStimulus::Load(per_mille) => Fault::Load(per_mille.max(0).unsigned_abs()),
            MotorStimulus::Supply(per_mille) => Fault::Supply(per_mille.into()),
            MotorStimulus::Backlash(0) => Fault::Backlash(None),
            MotorStimulus::Backlash(counts) => {
                Fault::Backlash(Some(u32::try_from(i64::from(counts) * count_pm).unwrap_or(u32::MAX)))
            }
            MotorStimulus::EndStop(counts) => Fault::EndStop(i64::from(counts) * count_pm),
            MotorStimulus::Push(per_mille) => Fault::Push(per_mille),
            MotorStimulus::Slip(turns) => Fault::Slip(turns),
            MotorStimulus::Skip(every) => Fault::Skip(every),
            MotorStimulus::Shift(um) => Fault::Shift(i64::from(um) * 1_000_000),
            MotorStimulus::Swap(swapped) => Fault::SwappedChannels(swapped),
            MotorStimulus::Dead(channel) => Fault::DeadChannel(channel.map(|channel| match channel {
                Channel::A => torno_stepper::Channel::A,
                Channel::B => torno_stepper::Channel::B,
            })),
            // Nobody drives a stepper by hand.
            MotorStimulus::Drive(_) => return,
        };
        joint.axis_mut(now).fault(now, fault);
        self.proceed(now);
    }

    fn step(&mut self, now: Instant) {
        self.proceed(now);
    }

    fn poll_timeout(&self, _: Instant) -> Option<Deadline> {
        let at = |at: Option<Instant>, why| at.map(|at| Deadline { at, why });
        let shift = self.behind;
        let goes_on = self.frozen.is_none();
        let segment = self.motions.segment().filter(|_| goes_on).map(|segment| segment.end + shift);
        let pieces = self.joints.iter().filter(|_| goes_on && self.moves && !self.ended);
        let pieces = pieces.filter_map(|joint| joint.next(shift)).filter(|at| *at > self.now).min();
        let loops = self.joints.iter().filter_map(Joint::poll_timeout);
        let own = [
            at(segment, "a segment ends"),
            at(pieces, "an axis goes on"),
            at(self.ends, "the motion ends"),
            at(self.tells, "positions are told"),
        ];
        loops.chain(own.into_iter().flatten()).min_by_key(|deadline| deadline.at)
    }

    fn poll_output(&mut self, _: Instant) -> Option<Output> {
        self.joints.iter_mut().find_map(Joint::poll_output)
    }
}
