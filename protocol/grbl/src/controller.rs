//! The firmware's main loop: it takes lines out of the receive buffer, does what they say, and answers.

use std::collections::VecDeque;

use torno_protocol::time::{Instant, Span};

use crate::axes::{Axes, MOST};
use crate::block::Abilities;
use crate::code::{Alarm, Code};
use crate::execution::{Answer, Execution, Wait};
use crate::line::LineReader;
use crate::machine::{Machine, Overrides, Progress};
use crate::memory::Memory;
use crate::modal::{Modal, Spindle};
use crate::realtime::{Fate, Override, Realtime, fate};
use crate::report::{self, Cadence, Status, message};
use crate::state::State;

mod lines;

/// What the receive buffer holds, bytes.
pub const RECEIVE: usize = 128;
/// What the transmit buffer holds, bytes. The main loop waits while it is full.
const TRANSMIT: usize = 104;
/// How long the spindle and the coolant get after the door, before the motion goes on.
const DOOR_SPINDLE: Span = Span::from_secs(4);
const DOOR_COOLANT: Span = Span::from_secs(1);

/// What holds the main loop up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Suspended {
    #[default]
    No,
    /// The machine is about to stand.
    Stopping,
    /// It stands.
    Complete,
    /// A jog is about to end.
    JogCancel {
        /// The door has been opened meanwhile.
        door: bool,
    },
    /// The spindle and the coolant come back after the door.
    Restoring(Instant),
}

/// What looks for its end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Homing {
    #[default]
    No,
    /// `$HX`
    One,
    /// `$H`: startup lines follow.
    All,
}

/// A controller with the machine that it moves.
#[derive(Clone, Debug)]
pub struct Controller<M> {
    machine: M,
    abilities: Abilities,
    memory: Memory,
    modal: Modal,
    state: State,
    suspended: Suspended,
    /// A critical alarm: nothing but a reset is heard.
    dead: bool,
    /// A line beyond the soft limits waits for the machine to stand.
    beyond: bool,
    receive: VecDeque<u8>,
    transmit: VecDeque<u8>,
    reader: LineReader,
    /// Startup lines still to be done.
    startup: VecDeque<String>,
    execution: Option<Execution>,
    homing: Homing,
    /// `$H` is done and not answered yet: startup lines come first.
    homed: bool,
    /// `$SLP` after its `ok`.
    sleeps: bool,
    /// `$C` and `$RST`: a reset after the `ok`.
    resets: bool,
    /// A status is asked for.
    asked: bool,
    /// `~` came while the machine was about to stand.
    resumes: bool,
    overrides: Overrides,
    cadence: Cadence,
    /// As they are driven now.
    spindle: Spindle,
    rpm: f32,
    flood: bool,
    /// The operator has stopped the spindle during a hold, or it is to be stopped when the machine stands.
    spindle_stopped: bool,
    stops_spindle: bool,
    /// Since when a dwell is held up.
    held: Option<Instant>,
    probed: Axes,
}

impl<M: Machine> Controller<M> {
    /// A controller without power.
    pub fn new(memory: Memory, abilities: Abilities, mut machine: M) -> Self {
        machine.configure(&memory.settings);
        Self {
            machine,
            abilities,
            memory,
            modal: Modal::default(),
            state: State::Idle,
            suspended: Suspended::No,
            dead: false,
            beyond: false,
            receive: VecDeque::new(),
            transmit: VecDeque::new(),
            reader: LineReader::default(),
            startup: VecDeque::new(),
            execution: None,
            homing: Homing::No,
            homed: false,
            sleeps: false,
            resets: false,
            asked: false,
            resumes: false,
            overrides: Overrides::default(),
            cadence: Cadence::default(),
            spindle: Spindle::Off,
            rpm: 0.0,
            flood: false,
            spindle_stopped: false,
            stops_spindle: false,
            held: None,
            probed: [0.0; MOST],
        }
    }

    /// Power comes on.
    pub fn power_on(&mut self, now: Instant) {
        self.transmit.clear();
        self.state = if self.memory.settings.homes() { State::Alarm } else { State::Idle };
        self.restart(now);
        self.run(now);
    }

    /// What it keeps without power.
    pub const fn memory(&self) -> &Memory {
        &self.memory
    }

    /// What it is doing.
    pub const fn state(&self) -> State {
        self.state
    }

    /// The machine. [`run`](Self::run) must follow a change of it.
    pub const fn machine_mut(&mut self) -> &mut M {
        &mut self.machine
    }

    /// The machine.
    pub const fn machine(&self) -> &M {
        &self.machine
    }

    /// How many bytes wait in the receive buffer.
    pub fn waiting(&self) -> usize {
        self.receive.len()
    }

    /// A byte arrives. Says whether it was taken: one that finds the buffer full is lost.
    pub fn receive(&mut self, now: Instant, byte: u8) -> bool {
        let taken = match fate(byte) {
            Fate::Command(command) => {
                self.realtime(now, command);
                true
            }
            Fate::Ignored => true,
            Fate::Buffered if self.receive.len() == RECEIVE => false,
            Fate::Buffered => {
                self.receive.push_back(byte);
                true
            }
        };
        self.run(now);
        taken
    }

    /// Takes the next byte to send.
    pub fn poll_transmit(&mut self, now: Instant) -> Option<u8> {
        let byte = self.transmit.pop_front()?;
        if self.transmit.len() == TRANSMIT {
            self.run(now);
        }
        Some(byte)
    }

    /// When [`run`](Self::run) is to be called.
    pub fn poll_timeout(&self) -> Option<Instant> {
        if let Suspended::Restoring(until) = self.suspended {
            return Some(until);
        }
        match self.execution.as_ref()?.waits {
            Some(Wait::Until(until)) if self.suspended == Suspended::No => Some(until),
            _ => None,
        }
    }

    /// Does what can be done now.
    pub fn run(&mut self, now: Instant) {
        while let Some(progress) = self.machine.poll_progress() {
            self.progress(now, progress);
        }
        if let Suspended::Restoring(until) = self.suspended
            && until <= now
        {
            self.go_on(now);
        }
        while self.transmit.len() <= TRANSMIT && !self.dead {
            if self.asked {
                self.asked = false;
                self.status(now);
            } else if self.suspended != Suspended::No || self.state == State::Sleep || self.homing != Homing::No {
                return;
            } else if self.sleeps {
                self.sleep(now);
            } else if self.resets {
                self.reset(now);
            } else if self.execution.is_some() {
                if !self.advance(now) {
                    return;
                }
            } else if let Some(block) = self.startup.pop_front() {
                let text = block.clone().into_bytes();
                self.execute(&text, false, Answer::Startup { block });
            } else if core::mem::take(&mut self.homed) {
                self.answer(Ok(()));
            } else if let Some(c) = self.receive.pop_front() {
                if let Some(line) = self.reader.take(c) {
                    self.take(now, &line);
                }
            } else {
                self.start(now);
                return;
            }
        }
    }

    fn say(&mut self, line: &str) {
        self.transmit.extend(line.bytes().chain(*b"\r\n"));
    }

    fn tell(&mut self, message: &str) {
        self.say(&format!("[MSG:{message}]"));
    }

    fn answer(&mut self, result: Result<(), Code>) {
        match result {
            Ok(()) => self.say("ok"),
            Err(code) => self.say(&format!("error:{}", code as u8)),
        }
    }

    fn alarm(&mut self, now: Instant, alarm: Alarm) {
        self.state = State::Alarm;
        self.suspended = Suspended::No;
        self.say(&format!("ALARM:{}", alarm as u8));
        if alarm.is_critical() {
            self.tell(message::RESET);
            self.dead = true;
            self.drive_spindle(now, Spindle::Off, 0.0);
            self.set_flood(false);
        }
    }

    /// What follows a reset or power.
    fn restart(&mut self, now: Instant) {
        self.machine.forget(now);
        self.receive.clear();
        self.reader = LineReader::default();
        self.startup.clear();
        self.execution = None;
        self.suspended = Suspended::No;
        (self.dead, self.beyond, self.homing, self.homed) = Default::default();
        (self.sleeps, self.resets, self.asked, self.resumes) = Default::default();
        self.overrides = Overrides::default();
        self.cadence = Cadence::default();
        (self.spindle_stopped, self.stops_spindle, self.held) = Default::default();
        self.probed = [0.0; MOST];
        self.modal = Modal { position: self.place(now), ..Modal::default() };
        self.drive_spindle(now, Spindle::Off, 0.0);
        self.flood = false;
        self.say(report::BANNER);
        if matches!(self.state, State::Alarm | State::Sleep) {
            self.tell(message::LOCKED);
            self.state = State::Alarm;
        } else {
            self.state = State::Idle;
            self.start_up();
        }
    }

    fn start_up(&mut self) {
        self.startup = self.memory.startup.iter().filter(|line| !line.is_empty()).cloned().collect();
    }

    /// 0x18, and what is like it.
    fn reset(&mut self, now: Instant) {
        let moving = matches!(self.state, State::Run | State::Jog) || self.suspended == Suspended::Stopping;
        if self.state == State::Home && !self.dead {
            self.alarm(now, Alarm::HomingReset);
        } else if moving || matches!(self.suspended, Suspended::JogCancel { .. }) {
            self.alarm(now, Alarm::Aborted);
        }
        // What was being done is over, and answered.
        if let Some(execution) = self.execution.take() {
            self.finish(execution.answer, Ok(()));
        }
        if self.homing != Homing::No || self.homed {
            self.answer(Ok(()));
        }
        self.restart(now);
    }

    /// Where the machine is, mm.
    fn place(&self, now: Instant) -> Axes {
        let steps = self.machine.position(now);
        core::array::from_fn(|axis| steps[axis] as f32 / self.memory.settings.steps_per_mm[axis])
    }

    fn steps(&self, place: Axes) -> Axes<i32> {
        core::array::from_fn(|axis| libm::roundf(place[axis] * self.memory.settings.steps_per_mm[axis]) as i32)
    }

    fn status(&mut self, now: Instant) {
        let status = Status {
            state: self.state,
            complete: self.suspended == Suspended::Complete,
            restoring: matches!(self.suspended, Suspended::Restoring(_)),
            settings: &self.memory.settings,
            position: self.place(now),
            origin: self.modal.origin(&self.memory.systems),
            room: (self.machine.room(), RECEIVE - self.waiting()),
            rate: self.machine.rate(now),
            speed: self.rpm,
            spindle: self.spindle,
            flood: self.flood,
            ends: self.machine.ends(),
            overrides: self.overrides,
        };
        let line = status.line(&mut self.cadence);
        self.say(&line);
    }

    fn realtime(&mut self, now: Instant, command: Realtime) {
        match command {
            Realtime::Reset => self.reset(now),
            _ if self.dead => {}
            Realtime::Status => self.asked = true,
            Realtime::Resume => self.resume(now),
            Realtime::Hold => self.hold(now, State::Hold),
            Realtime::Door if self.homing != Homing::No => {
                self.alarm(now, Alarm::HomingDoor);
                self.reset(now);
            }
            Realtime::Door => {
                if !matches!(self.state, State::Alarm | State::Check) {
                    self.tell(message::DOOR);
                    self.hold(now, State::Door);
                }
            }
            Realtime::JogCancel if self.state == State::Jog => self.hold(now, State::Jog),
            Realtime::JogCancel => {}
            Realtime::Override(change) => self.override_by(now, change),
            Realtime::SpindleStop if self.state == State::Hold => {
                if self.spindle_stopped {
                    self.restore_spindle(now);
                } else {
                    self.stops_spindle = true;
                    self.stop_spindle(now);
                }
            }
            Realtime::SpindleStop => {}
            Realtime::Flood if matches!(self.state, State::Idle | State::Run | State::Hold | State::Jog) => {
                self.modal.flood = !self.modal.flood;
                if let Some(execution) = &mut self.execution {
                    execution.block.modal.flood = self.modal.flood;
                }
                self.set_flood(self.modal.flood);
            }
            Realtime::Flood => {}
        }
    }

    /// Stops the motion; `state` says what for.
    fn hold(&mut self, now: Instant, state: State) {
        match self.state {
            State::Alarm | State::Check | State::Sleep | State::Home => {}
            State::Jog => {
                // Whatever holds a jog ends it.
                let (Suspended::No | Suspended::JogCancel { .. }) = self.suspended else { return };
                if self.suspended == Suspended::No {
                    self.machine.hold(now);
                }
                let door = state == State::Door || self.suspended == Suspended::JogCancel { door: true };
                self.suspended = Suspended::JogCancel { door };
            }
            State::Run => {
                self.state = state;
                self.suspended = Suspended::Stopping;
                self.machine.hold(now);
            }
            State::Idle => {
                self.state = state;
                self.stand(now);
            }
            State::Hold | State::Door => {
                if state == State::Door {
                    self.state = State::Door;
                    if self.suspended != Suspended::Stopping {
                        self.stand(now);
                    }
                }
            }
        }
    }

    /// It stands, and waits for `~`. While the door is open, or was, nothing turns.
    fn stand(&mut self, now: Instant) {
        self.suspended = Suspended::Complete;
        self.held.get_or_insert(now);
        if self.state == State::Door {
            (self.spindle_stopped, self.stops_spindle) = (false, false);
            self.drive_spindle(now, Spindle::Off, 0.0);
            self.set_flood(false);
        }
        self.stop_spindle(now);
    }

    /// Stops the spindle, if the operator wants it and the machine stands.
    fn stop_spindle(&mut self, now: Instant) {
        if self.suspended == Suspended::Complete && core::mem::take(&mut self.stops_spindle) {
            self.spindle_stopped = self.modal.spindle != Spindle::Off;
            if self.spindle_stopped {
                self.drive_spindle(now, Spindle::Off, 0.0);
            }
        }
    }

    fn resume(&mut self, now: Instant) {
        match (self.state, self.suspended) {
            (State::Door, Suspended::Complete) => {
                let mut until = now;
                if self.modal.spindle != Spindle::Off {
                    self.drive_spindle(now, self.modal.spindle, self.modal.rpm);
                    until += DOOR_SPINDLE;
                }
                if self.modal.flood {
                    self.set_flood(true);
                    until += DOOR_COOLANT;
                }
                self.suspended = Suspended::Restoring(until);
            }
            (State::Hold, Suspended::Complete) => {
                if self.spindle_stopped {
                    self.restore_spindle(now);
                }
                self.go_on(now);
            }
            (State::Hold, Suspended::Stopping) => self.resumes = self.abilities.holds_slowly,
            (State::Idle, _) => self.start(now),
            _ => {}
        }
    }

    /// The hold is over, and so is a pause.
    fn go_on(&mut self, now: Instant) {
        self.suspended = Suspended::No;
        self.state = State::Idle;
        let held = self.held.take().map_or(Span::ZERO, |held| now.since(held));
        if let Some(execution) = &mut self.execution {
            match &mut execution.waits {
                Some(Wait::Resume) => execution.waits = None,
                Some(Wait::Until(until)) => *until += held,
                Some(Wait::Probe { .. }) | None => {}
            }
        }
        self.start(now);
    }

    fn restore_spindle(&mut self, now: Instant) {
        self.tell(message::SPINDLE);
        self.spindle_stopped = false;
        self.drive_spindle(now, self.modal.spindle, self.modal.rpm);
    }

    fn override_by(&mut self, now: Instant, change: Override) {
        let before = self.overrides;
        let changed = |value: u8, by: i8| value.saturating_add_signed(by).clamp(10, 200);
        match change {
            Override::FeedReset => self.overrides.feed = 100,
            Override::Feed(by) => self.overrides.feed = changed(before.feed, by),
            Override::Rapid(percent) => self.overrides.rapid = percent,
            Override::SpindleReset => self.overrides.spindle = 100,
            Override::Spindle(by) => self.overrides.spindle = changed(before.spindle, by),
        }
        if before != self.overrides {
            self.cadence.overrides_changed();
            self.machine.override_by(now, self.overrides);
        }
        if before.spindle != self.overrides.spindle && self.spindle != Spindle::Off {
            self.drive_spindle(now, self.spindle, self.modal.rpm);
        }
    }

    /// The program's end: nothing is overridden any more.
    fn override_all(&mut self, now: Instant) {
        if self.overrides != Overrides::default() {
            self.overrides = Overrides::default();
            self.machine.override_by(now, self.overrides);
        }
    }

    /// Drives the spindle with the speed that was programmed.
    fn drive_spindle(&mut self, now: Instant, sense: Spindle, programmed: f32) {
        let (fastest, slowest) = self.memory.settings.spindle_rpm();
        let asked = programmed * f32::from(self.overrides.spindle) / 100.0;
        let rpm = match asked {
            _ if sense == Spindle::Off => 0.0,
            asked if slowest >= fastest || asked >= fastest => fastest,
            asked if asked <= 0.0 => 0.0,
            asked => asked.max(slowest),
        };
        if (self.spindle, self.rpm) != (sense, rpm) {
            self.machine.spindle(now, sense, rpm);
        }
        (self.spindle, self.rpm) = (sense, rpm);
        self.cadence.overrides_changed();
    }

    fn set_flood(&mut self, flood: bool) {
        self.flood = flood;
        self.cadence.overrides_changed();
    }

    /// Starts the cycle, if motions wait for it.
    fn start(&mut self, now: Instant) {
        if self.state == State::Idle && self.suspended == Suspended::No && self.machine.has_motions() {
            self.state = State::Run;
            self.machine.start(now, self.overrides);
        }
    }

    fn progress(&mut self, now: Instant, progress: Progress) {
        match (progress, self.suspended) {
            // A reset asks for the position.
            _ if self.dead => {}
            (Progress::Failed(alarm), _) => {
                self.machine.forget(now);
                self.modal.position = self.place(now);
                self.alarm(now, alarm);
                if !self.dead {
                    self.give_up();
                }
            }
            (Progress::Homed, _) if self.homing == Homing::No => {}
            (Progress::Homed, _) => {
                self.state = State::Idle;
                self.modal.position = self.place(now);
                if core::mem::take(&mut self.homing) == Homing::All {
                    self.start_up();
                }
                self.homed = true;
            }
            (Progress::Finished | Progress::Held, Suspended::JogCancel { door }) => {
                self.machine.forget(now);
                self.modal.position = self.place(now);
                // A jog that waits for room is over, too.
                if self.execution.take().is_some() {
                    self.answer(Ok(()));
                }
                if door {
                    self.state = State::Door;
                    self.stand(now);
                } else {
                    self.suspended = Suspended::No;
                    self.state = State::Idle;
                }
            }
            (Progress::Finished | Progress::Held, Suspended::Stopping) => {
                self.stand(now);
                if self.beyond {
                    self.alarm(now, Alarm::SoftLimit);
                } else if core::mem::take(&mut self.resumes) {
                    self.resume(now);
                }
            }
            (Progress::Finished, _) => {
                if matches!(self.state, State::Run | State::Jog) {
                    self.state = State::Idle;
                } else {
                    // A motion that could not be stopped has ended.
                    self.modal.position = self.place(now);
                }
            }
            (Progress::Held, _) => {}
            (Progress::Message(message), _) => self.tell(&message),
        }
    }

    /// The machine has failed: what was being done is not.
    fn give_up(&mut self) {
        if let Some(execution) = self.execution.take() {
            self.finish(execution.answer, Err(Code::Locked));
        }
        if core::mem::take(&mut self.homing) != Homing::No {
            self.answer(Err(Code::Locked));
        }
    }

    fn sleep(&mut self, now: Instant) {
        self.sleeps = false;
        self.state = State::Sleep;
        self.drive_spindle(now, Spindle::Off, 0.0);
        self.set_flood(false);
        self.tell(message::SLEEP);
    }
}
