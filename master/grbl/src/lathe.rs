//! The lathe as the controller's machine: motions become frames, and one frame after the other is done.

use std::collections::VecDeque;

use torno_gcode::{Feed, Kind, Motion, Place, Sense, Speed};
use torno_grbl::code::Alarm;
use torno_grbl::machine::{Machine, Move, Overrides, Progress};
use torno_grbl::memory::Settings;
use torno_grbl::{Axes, Rate, Spindle};
use torno_planner::{Planner, Scale, Side, Standing};
use torno_protocol::board::{Deadline, Description, Output};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{
    self, CHARACTER, FRAME_GAP, Fault, Frame, Party, Reply, ReplyDecoder, Slave, TransverseSubFrame,
};
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::{Receiver, Transmitter};

use crate::settings::GrblSettings;
use crate::wired::{PORTS, Wired};

/// X, Y, Z.
const X: usize = 0;
const Z: usize = 2;
/// A unit of the main motor's speed, rpm.
const RPM: f32 = 20.0;
/// A frame that the master has refused is sent again so often: noise may have spoilt it. (Ours.)
const TRIES: u32 = 3;
/// The silence after a refusal: what the master refuses in mid-frame is still being sent.
const AFTER_REFUSAL: Span =
    Span::from_nanos(FRAME_GAP.as_nanos() + CHARACTER.times(Frame::LENGTH as u64 + 1).as_nanos());
/// What the operator is told if a frame is given up.
const NO_ANSWER: &str = "The machine does not answer";
/// The planner turns its spindle, so that everything can be cut: the board's own is the controller's.
const TURNS: Kind = Kind::Spindle { sense: Sense::Clockwise, speed: Speed::Constant(1_000.0) };

/// What it is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Mode {
    /// Motions wait for a start.
    #[default]
    Stands,
    Runs,
    /// It stands after the frame that is under way.
    Holds,
    /// It looks for the end of an axis, and goes back a little.
    Homes(Homing),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Homing {
    Seek(usize),
    Return(usize),
    End,
}

/// How far a frame goes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Travel {
    slots: i32,
    counts: i32,
    /// Units of the feed.
    speed: u8,
}

/// A frame that the master has.
#[derive(Clone, Copy, Debug)]
struct Flight {
    way: Travel,
    since: Instant,
    /// It is given up then.
    until: Instant,
    tries: u32,
    /// A slave has failed with it: it is not done, but over.
    failed: bool,
}

/// The lathe, behind its master.
#[derive(Clone, Debug)]
pub struct Lathe {
    scale: Scale,
    blocks: usize,
    /// What the homed axes go back, mm.
    pull_off: f64,
    hold: Span,
    jog: Span,
    patience: Span,
    mode: Mode,
    /// What is left to do; the first one is in the planner if a motion is under way.
    motions: VecDeque<Move>,
    planner: Planner,
    under_way: bool,
    /// What is left of a frame that would take too long, or was refused.
    rest: Option<Travel>,
    /// How often the next frame has been refused.
    tries: u32,
    overrides: Overrides,
    flight: Option<Flight>,
    /// Where it stands, and where the controller's zero is.
    at: Standing,
    zero: [i64; 2],
    /// Units of the main motor: as asked for, and as told.
    spindle: u8,
    told: u8,
    /// No frame before.
    quiet_until: Instant,
    ends: Axes<bool>,
    replies: ReplyDecoder,
    /// To the master, with the receiver's clock.
    clock: Clock,
    transmitter: Transmitter,
    /// Its line goes idle.
    cut: bool,
    progress: VecDeque<Progress>,
}

impl Lathe {
    pub(crate) fn new(settings: &GrblSettings, clock: Clock) -> Self {
        let scale = settings.scale();
        let seconds = |s: f64| Span::from_nanos((s * 1e9) as u64);
        Self {
            scale,
            blocks: settings.blocks as usize,
            pull_off: 0.0,
            hold: seconds(settings.hold_s),
            jog: seconds(settings.jog_s),
            patience: seconds(settings.patience_s),
            mode: Mode::Stands,
            motions: VecDeque::new(),
            planner: planner(scale, Standing::default()),
            under_way: false,
            rest: None,
            tries: 0,
            overrides: Overrides::default(),
            flight: None,
            at: Standing::default(),
            zero: [0; 2],
            spindle: 0,
            told: 0,
            quiet_until: Instant::START,
            ends: Axes::default(),
            replies: ReplyDecoder::default(),
            clock,
            transmitter: Transmitter::hardware(lathe::RATE, clock),
            cut: false,
            progress: VecDeque::new(),
        }
    }

    fn has_something(&self) -> bool {
        self.mode != Mode::Stands || self.spindle != self.told
    }

    /// The frame is done, or over.
    fn done(&mut self, now: Instant) {
        let Some(flight) = self.flight.take() else { return };
        if flight.failed {
            self.quiet_until = now + FRAME_GAP;
            return;
        }
        self.advance(flight.way);
        if self.mode == Mode::Stands && !self.has_motions() {
            // It was forgotten, and has gone on by itself.
            self.replan();
            self.progress.push_back(Progress::Finished);
        }
    }

    /// The carriage and the slide have gone so far.
    fn advance(&mut self, way: Travel) {
        self.at.count += i64::from(way.counts);
        self.at.slot += i64::from(way.slots);
        if way.slots != 0 {
            self.at.sense = i64::from(way.slots.signum());
        }
    }

    /// The frame was refused: nothing of it is done.
    fn refused(&mut self, now: Instant) {
        let Some(Flight { way, tries, .. }) = self.flight.take() else { return };
        self.quiet_until = now + AFTER_REFUSAL;
        if tries == TRIES {
            return self.fail(Alarm::Aborted);
        }
        let rest = self.rest.unwrap_or_default();
        self.tries = tries + 1;
        self.rest = Some(Travel {
            slots: way.slots + rest.slots,
            counts: way.counts + rest.counts,
            speed: way.speed.max(rest.speed),
        });
    }

    /// Nothing is heard of the frame any more: its answer is lost, or the machine is dead.
    fn gave_no_answer(&mut self, now: Instant, flight: Flight) {
        self.advance(self.moved(now));
        self.flight = None;
        self.quiet_until = now + AFTER_REFUSAL;
        if !flight.failed {
            self.progress.push_back(Progress::Message(NO_ANSWER.to_owned()));
            self.fail(Alarm::Aborted);
        }
    }

    fn failed(&mut self, now: Instant, party: Party, fault: Fault) {
        let homing = match self.mode {
            Mode::Homes(Homing::Seek(axis)) => Some(axis),
            _ => None,
        };
        let axis = match party {
            Party::Slave(Slave::Depth) => Some(X),
            Party::Slave(Slave::Transverse) => Some(Z),
            _ => None,
        };
        self.advance(self.moved(now));
        if let Some(flight) = &mut self.flight {
            flight.failed = true;
        }
        if fault == Fault::EndOfTravel && homing.is_some() && homing == axis {
            self.mode = Mode::Homes(Homing::Return(axis.unwrap_or_default()));
            return;
        }
        if let (Fault::EndOfTravel, Some(axis)) = (fault, axis) {
            self.ends[axis] = true;
        }
        self.fail(match fault {
            Fault::EndOfTravel | Fault::Stalled => Alarm::HardLimit,
            Fault::NoAnswer | Fault::Garbled | Fault::Restarted => Alarm::Aborted,
        });
    }

    fn fail(&mut self, alarm: Alarm) {
        self.mode = Mode::Stands;
        self.progress.push_back(Progress::Failed(alarm));
    }

    fn replan(&mut self) {
        self.planner = planner(self.scale, self.at);
        self.under_way = false;
        self.rest = None;
    }

    /// Goes on, if nothing is under way.
    fn go_on(&mut self, now: Instant) {
        if let Some(flight) = self.flight.filter(|flight| flight.until <= now) {
            self.gave_no_answer(now, flight);
        }
        if self.flight.is_some() || now < self.quiet_until {
            return;
        }
        if self.spindle != self.told {
            return self.send(now, Travel::default());
        }
        match self.mode {
            Mode::Stands => {}
            Mode::Holds => {
                self.mode = Mode::Stands;
                self.progress.push_back(Progress::Held);
            }
            Mode::Runs => match self.next_frame() {
                Some(way) => self.send(now, way),
                None => {
                    self.mode = Mode::Stands;
                    self.progress.push_back(Progress::Finished);
                }
            },
            Mode::Homes(homing) => self.home_on(now, homing),
        }
    }

    /// The next frame of the motions, as long as it may take.
    fn next_frame(&mut self) -> Option<Travel> {
        let way = match self.rest.take() {
            Some(way) => way,
            None => self.planned()?,
        };
        let jogs = self.motions.front().is_some_and(|motion| matches!(motion.rate, Rate::Jog(_)));
        let longest = if jogs { self.jog } else { self.hold };
        let now = self.part(way, longest);
        let rest = Travel { slots: way.slots - now.slots, counts: way.counts - now.counts, speed: way.speed };
        self.rest = Some(rest).filter(|rest| (rest.slots, rest.counts) != (0, 0));
        Some(now)
    }

    /// The next frame of the plan.
    fn planned(&mut self) -> Option<Travel> {
        loop {
            let planned = self.planner.poll().or_else(|| {
                self.planner.flush();
                self.planner.poll()
            });
            if let Some(planned) = planned {
                // A frame for the planner's own spindle moves nothing.
                if let Some(way) = Some(way_of(&planned.frame)).filter(|way| (way.slots, way.counts) != (0, 0)) {
                    return Some(way);
                }
                continue;
            }
            if core::mem::take(&mut self.under_way) {
                self.motions.pop_front();
            }
            let motion = *self.motions.front()?;
            self.under_way = true;
            self.plan(&motion);
        }
    }

    fn plan(&mut self, motion: &Move) {
        let zero = self.zero_place();
        let to = Place {
            x: f64::from(motion.place[X]) + zero.x,
            z: f64::from(motion.place[Z]) + zero.z,
            ..Place::default()
        };
        let from = self.planner.place();
        let length = libm::hypot(to.x - from.x, to.z - from.z);
        let kind = match motion.rate {
            Rate::Rapid => Kind::Rapid { to },
            Rate::Feed(feed) | Rate::Jog(feed) => Kind::Feed { to, feed: self.feed(f64::from(feed)) },
            Rate::PerTurn(feed) => Kind::Feed { to, feed: self.feed(f64::from(feed * self.rpm())) },
            Rate::PerMinute(part) => Kind::Feed { to, feed: self.feed(f64::from(part) * length) },
        };
        self.planner.take(&Motion { line: 0, kind });
    }

    /// A feed that the machine has.
    fn feed(&self, mm_per_min: f64) -> Feed {
        Feed::PerMinute(mm_per_min.max(self.scale.feed.unit()))
    }

    /// The spindle's speed, as it is asked for.
    fn rpm(&self) -> f32 {
        f32::from(self.spindle) * RPM
    }

    fn zero_place(&self) -> Place {
        let [slot, count] = self.zero;
        Place {
            x: slot as f64 * self.scale.infeed.mm_per_slot,
            z: count as f64 * self.scale.feed.mm_per_count,
            ..Place::default()
        }
    }

    /// What of a frame can be done in that time.
    fn part(&self, way: Travel, longest: Span) -> Travel {
        let speed = self.overridden(way.speed);
        let seconds = longest.as_nanos() as f64 / 1e9;
        let counts = (seconds / self.scale.feed.sample_s * f64::from(speed)).max(1.0) as i32;
        let slots = (seconds * self.slots_per_s()).max(1.0) as i32;
        Travel { slots: way.slots.clamp(-slots, slots), counts: way.counts.clamp(-counts, counts), speed }
    }

    /// How long a frame takes by its profile, one axis after the other.
    fn time(&self, way: Travel) -> Span {
        let counts = f64::from(way.counts.abs()) / f64::from(way.speed.max(1)) * self.scale.feed.sample_s;
        let slots = f64::from(way.slots.abs()) / self.slots_per_s();
        Span::from_nanos(((counts + slots) * 1e9) as u64)
    }

    fn slots_per_s(&self) -> f64 {
        self.scale.infeed.mm_per_s / self.scale.infeed.mm_per_slot.abs()
    }

    /// The speed of a frame with the operator's change of it.
    fn overridden(&self, units: u8) -> u8 {
        let percent = match self.motions.front().map(|motion| motion.rate) {
            Some(Rate::Rapid) => self.overrides.rapid,
            Some(Rate::Feed(_) | Rate::PerTurn(_) | Rate::PerMinute(_)) => self.overrides.feed,
            Some(Rate::Jog(_)) | None => 100,
        };
        let units = (u32::from(units) * u32::from(percent) + 50) / 100;
        units.clamp(1, u32::from(TransverseSubFrame::SPEED_MAX)) as u8
    }

    fn send(&mut self, now: Instant, way: Travel) {
        let Ok(frame) = Frame::moving(self.spindle, way.counts, way.speed, way.slots) else {
            return self.fail(Alarm::Aborted);
        };
        self.told = self.spindle;
        for byte in frame.emit() {
            self.transmitter.push(byte);
        }
        let tries = core::mem::take(&mut self.tries);
        let until = now + self.time(way).times(2) + self.patience;
        self.flight = Some(Flight { way, since: now, until, tries, failed: false });
        self.ends = Axes::default();
    }

    fn home_on(&mut self, now: Instant, homing: Homing) {
        let along = |axis: usize, way: i32| {
            let (slots, counts) = if axis == X { (way, 0) } else { (0, way) };
            Travel { slots, counts, speed: TransverseSubFrame::SPEED_MAX }
        };
        match homing {
            Homing::Seek(axis) => {
                let outward = if self.mm_per_step(axis) > 0.0 { 1 } else { -1 };
                let way = self.part(along(axis, outward * i32::from(u16::MAX)), self.hold);
                self.send(now, way);
            }
            Homing::Return(axis) => {
                // The end is the axis's zero.
                let (zero, at) = if axis == X { (0, self.at.slot) } else { (1, self.at.count) };
                self.zero[zero] = at;
                let back = (-self.pull_off / self.mm_per_step(axis)).round() as i32;
                self.send(now, along(axis, back));
                self.mode = Mode::Homes(if axis == X { Homing::Seek(Z) } else { Homing::End });
            }
            Homing::End => {
                self.mode = Mode::Stands;
                self.replan();
                self.progress.push_back(Progress::Homed);
            }
        }
    }

    const fn mm_per_step(&self, axis: usize) -> f64 {
        if axis == X { self.scale.infeed.mm_per_slot } else { self.scale.feed.mm_per_count }
    }

    /// How far the frame under way has got, as its profile says.
    fn moved(&self, now: Instant) -> Travel {
        let Some(Flight { way, since, .. }) = self.flight.filter(|flight| !flight.failed) else {
            return Travel::default();
        };
        let seconds = now.since(since).as_nanos() as f64 / 1e9;
        let counted = (seconds / self.scale.feed.sample_s * f64::from(way.speed)) as i32;
        let slid = (seconds * self.slots_per_s()) as i32;
        Travel {
            slots: way.slots.signum() * slid.min(way.slots.abs()),
            counts: way.counts.signum() * counted.min(way.counts.abs()),
            speed: way.speed,
        }
    }
}

impl Machine for Lathe {
    fn configure(&mut self, settings: &Settings) {
        self.pull_off = f64::from(settings.pull_off());
    }

    fn room(&self) -> usize {
        self.blocks - self.motions.len().min(self.blocks)
    }

    fn has_motions(&self) -> bool {
        !self.motions.is_empty()
    }

    fn push(&mut self, _: Instant, motion: Move) {
        self.motions.push_back(motion);
    }

    fn remark(&self, motion: &Move) -> Option<String> {
        let unit = self.scale.feed.unit();
        let feed = match motion.rate {
            Rate::Feed(feed) | Rate::Jog(feed) => feed,
            Rate::PerTurn(feed) => feed * self.rpm(),
            Rate::Rapid | Rate::PerMinute(_) => return None,
        };
        (f64::from(feed) < 0.99 * unit).then(|| format!("Feed raised to {unit:.3}"))
    }

    fn start(&mut self, now: Instant, overrides: Overrides) {
        self.overrides = overrides;
        self.mode = Mode::Runs;
        self.go_on(now);
    }

    fn hold(&mut self, now: Instant) {
        self.mode = Mode::Holds;
        self.go_on(now);
    }

    fn forget(&mut self, _: Instant) {
        self.motions.clear();
        self.mode = Mode::Stands;
        self.replan();
    }

    /// Always both of them: there is no `$HX`.
    fn home(&mut self, now: Instant, _: Axes<bool>) {
        self.mode = Mode::Homes(Homing::Seek(X));
        self.go_on(now);
    }

    fn spindle(&mut self, now: Instant, sense: Spindle, rpm: f32) {
        self.spindle = match sense {
            Spindle::Off => 0,
            Spindle::Clockwise | Spindle::Counterclockwise => (rpm / RPM).round() as u8,
        };
        self.go_on(now);
    }

    fn override_by(&mut self, _: Instant, overrides: Overrides) {
        self.overrides = overrides;
    }

    fn position(&self, now: Instant) -> Axes<i32> {
        let moved = self.moved(now);
        let sign = |axis: usize| if self.mm_per_step(axis) < 0.0 { -1 } else { 1 };
        let x = (self.at.slot + i64::from(moved.slots) - self.zero[0]) * sign(X);
        let z = (self.at.count + i64::from(moved.counts) - self.zero[1]) * sign(Z);
        [x as i32, 0, z as i32, 0]
    }

    fn rate(&self, _: Instant) -> f32 {
        let Some(flight) = &self.flight else { return 0.0 };
        match flight.way {
            Travel { slots: 0, counts: 0, .. } => 0.0,
            Travel { slots: 0, speed, .. } => (f64::from(speed) * self.scale.feed.unit()) as f32,
            _ => (self.scale.infeed.mm_per_s * 60.0) as f32,
        }
    }

    fn ends(&self) -> Axes<bool> {
        self.ends
    }

    fn poll_progress(&mut self) -> Option<Progress> {
        self.progress.pop_front()
    }
}

impl Wired for Lathe {
    fn describe(&self, description: &mut Description) {
        description.ports.push("machine".to_owned());
    }

    fn receivers(&self) -> Vec<Receiver> {
        vec![Receiver::hardware(lathe::RATE, self.clock)]
    }

    fn restart(&mut self, now: Instant) {
        self.forget(now);
        self.flight = None;
        self.zero = [self.at.slot, self.at.count];
        self.replies = ReplyDecoder::default();
        self.transmitter.clear();
        self.cut = true;
        self.progress.clear();
        (self.spindle, self.told) = (0, 0);
        self.quiet_until = now + FRAME_GAP;
        self.replan();
    }

    fn retune(&mut self, clock: Clock) {
        self.clock = clock;
        self.transmitter.retune(lathe::RATE, clock);
    }

    fn hear(&mut self, now: Instant, _: u8, byte: u8) {
        for reply in self.replies.push(byte) {
            match reply {
                Reply::Xon => self.done(now),
                Reply::Nak(_) => self.refused(now),
                Reply::Can(party, fault) => self.failed(now, party, fault),
                Reply::Ack | Reply::Xoff | Reply::Unknown(_) => {}
            }
        }
        self.go_on(now);
    }

    fn step(&mut self, now: Instant) {
        self.go_on(now);
    }

    fn poll_timeout(&self, now: Instant) -> Option<Deadline> {
        let waits = match &self.flight {
            Some(flight) => Some(flight.until),
            None => (self.quiet_until > now && self.has_something()).then_some(self.quiet_until),
        };
        let due = waits.map(|at| Deadline { at, why: "the machine may be told" });
        let next = self.transmitter.poll_timeout();
        let next = next.map(|at| Deadline { at, why: "the next character to the machine" });
        due.into_iter().chain(next).min_by_key(|deadline| deadline.at)
    }

    fn poll_output(&mut self, now: Instant) -> Option<Output> {
        if core::mem::take(&mut self.cut) {
            return Some(Output::Cut { port: PORTS });
        }
        let loaded = self.transmitter.load(now)?;
        Some(Output::Character { port: PORTS, edges: loaded.edges, end: loaded.end })
    }
}

/// A planner at that place; places are those of the machine.
fn planner(scale: Scale, at: Standing) -> Planner {
    let settings = torno_planner::Settings {
        scale,
        start: Default::default(),
        side: Side::Middle,
        bore: false,
        optimise: false,
        stock: None,
        frames_max: u64::MAX - 1,
    };
    let mut planner = Planner::standing(settings, at);
    planner.take(&Motion { line: 0, kind: TURNS });
    planner
}

/// How far a frame goes.
fn way_of(Frame { transverse, depth, .. }: &Frame) -> Travel {
    Travel {
        slots: depth.direction().sign() as i32 * i32::from(depth.distance()),
        counts: transverse.direction().sign() as i32 * i32::from(transverse.distance()),
        speed: transverse.speed(),
    }
}
