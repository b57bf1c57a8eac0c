//! Lines: what they ask for is done step by step, and then answered.

use torno_protocol::time::{Instant, Span};

use super::{Controller, Homing, RECEIVE};
use crate::axes;
use crate::block::{self, Context};
use crate::code::{Alarm, Code};
use crate::execution::{Answer, Execution, Wait};
use crate::line::TextLine;
use crate::machine::{Machine, Move};
use crate::modal::{Modal, Spindle};
use crate::number;
use crate::path::{Rate, Straight};
use crate::report::{self, message};
use crate::state::State;
use crate::steps::Step;
use crate::system::{self, Command, Restore};

/// A dwell is made of such steps.
const DWELL: Span = Span::from_millis(50);
const DWELLS_PER_S: f32 = 20.0;

/// What became of a line for the planner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pushed {
    Taken,
    Full,
}

impl<M: Machine> Controller<M> {
    pub(super) fn take(&mut self, now: Instant, line: &TextLine) {
        match line {
            TextLine::TooLong => self.answer(Err(Code::LineTooLong)),
            TextLine::Text(text) => match text.as_slice() {
                [] => self.answer(Ok(())),
                [b'$', text @ ..] => match system::read(text, self.state) {
                    Ok(command) => self.command(now, command),
                    Err(code) => self.answer(Err(code)),
                },
                _ if matches!(self.state, State::Alarm | State::Jog) => self.answer(Err(Code::Locked)),
                text => self.execute(text, false, Answer::Ok),
            },
        }
    }

    pub(super) fn execute(&mut self, text: &[u8], is_jog: bool, answer: Answer) {
        let context = Context { modal: &self.modal, memory: &self.memory, abilities: &self.abilities };
        match block::read(text, is_jog, context) {
            Ok(mut block) => {
                if matches!(answer, Answer::Stored { .. }) {
                    block.steps.push_back(Step::Write);
                }
                self.execution = Some(Execution { block, waits: None, answer });
            }
            Err(code) => self.finish(answer, Err(code)),
        }
    }

    pub(super) fn finish(&mut self, answer: Answer, result: Result<(), Code>) {
        match answer {
            Answer::Ok => {}
            Answer::Stored { number, block } => {
                if result.is_ok()
                    && let Some(line) = self.memory.startup.get_mut(number)
                {
                    *line = block;
                }
            }
            Answer::Startup { block } => self.transmit.extend(format!(">{block}:").bytes()),
        }
        self.answer(result);
    }

    fn command(&mut self, now: Instant, command: Command) {
        match command {
            Command::Help => self.say(report::HELP),
            Command::Settings => self.memory.settings.lines().iter().for_each(|line| self.say(line)),
            Command::Modes => self.say(&report::modes(&self.modal, &self.memory.settings)),
            Command::Check if self.state == State::Check => {
                self.tell(message::DISABLED);
                self.resets = true;
            }
            Command::Check => {
                self.tell(message::ENABLED);
                self.state = State::Check;
            }
            Command::Unlock if self.state == State::Alarm => {
                self.tell(message::UNLOCKED);
                self.state = State::Idle;
            }
            Command::Unlock => {}
            Command::Places => {
                let probed = report::probed(self.probed, &self.memory.settings);
                let lines = report::places(&self.modal, &self.memory, &probed);
                lines.iter().for_each(|line| self.say(line));
            }
            Command::Home { .. } if !self.memory.settings.homes() => return self.answer(Err(Code::HomingDisabled)),
            Command::Home { axis } => return self.home(now, &axis),
            Command::Sleep => self.sleeps = true,
            Command::Info => {
                let lines = report::info(&self.memory, self.abilities.single_homing, self.machine.room(), RECEIVE);
                lines.iter().for_each(|line| self.say(line));
            }
            Command::StoreInfo(info) => self.memory.info = info,
            Command::Startup => {
                for (number, line) in self.memory.startup.clone().iter().enumerate() {
                    self.say(&format!("$N{number}={line}"));
                }
            }
            Command::StoreStartup { number, block } => {
                let text = String::from_utf8_lossy(&block).into_owned();
                return self.execute(&block, false, Answer::Stored { number: usize::from(number), block: text });
            }
            Command::Store { number, value } => {
                let result = self.memory.settings.store(number, value);
                self.machine.configure(&self.memory.settings);
                if !self.memory.settings.lathe_mode() {
                    self.modal.leave_lathe_mode();
                }
                return self.answer(result);
            }
            Command::Restore(what) => {
                match what {
                    Restore::Settings => self.memory.restore_settings(),
                    Restore::Places => self.memory.restore_places(),
                    Restore::All => self.memory.restore(),
                }
                self.machine.configure(&self.memory.settings);
                self.tell(message::DEFAULTS);
                self.resets = true;
            }
            Command::Jog(words) => return self.execute(&words, true, Answer::Ok),
        }
        self.answer(Ok(()));
    }

    /// `$H`, with what follows it. The answer comes when it is done.
    fn home(&mut self, now: Instant, axis: &[u8]) {
        let count = self.memory.settings.axes;
        let one = match axis {
            [letter] if self.abilities.single_homing => axes::of_letter(*letter, count),
            _ => None,
        };
        self.state = State::Home;
        if one.is_none() && !axis.is_empty() {
            // The firmware forgets that it does not home. It takes lines, and moves nothing until a reset.
            return self.answer(Err(Code::InvalidStatement));
        }
        self.homing = if one.is_some() { Homing::One } else { Homing::All };
        self.machine.home(now, core::array::from_fn(|axis| axis < count && one.is_none_or(|one| one == axis)));
    }

    /// Goes on with the line that is being done. Says whether it got on.
    pub(super) fn advance(&mut self, now: Instant) -> bool {
        let Some(mut execution) = self.execution.take() else { return false };
        let got_on = self.step(now, &mut execution);
        self.execution = Some(execution);
        if got_on && self.execution.as_ref().is_some_and(|e| e.block.steps.is_empty() && e.waits.is_none()) {
            let Some(Execution { block, answer, .. }) = self.execution.take() else { return false };
            self.modal = block.modal;
            self.finish(answer, Ok(()));
        }
        got_on
    }

    /// Does the next step of a line, as far as it can. Says whether it got on.
    fn step(&mut self, now: Instant, execution: &mut Execution) -> bool {
        match execution.waits {
            Some(Wait::Until(until)) if until > now => return false,
            Some(Wait::Until(_)) => execution.waits = None,
            Some(Wait::Resume) => return false,
            Some(Wait::Probe { no_error }) => {
                if self.moves(now) {
                    return false;
                }
                execution.waits = None;
                self.probe_ends(now, no_error);
            }
            None => {}
        }
        let Some(step) = execution.block.steps.front_mut() else { return true };
        let checks = self.state == State::Check;
        if !checks && step.waits() && self.moves(now) {
            return false;
        }
        let keeps = match step {
            Step::Line(line) => {
                let line = *line;
                match self.push(now, line) {
                    Pushed::Taken => false,
                    Pushed::Full => return false,
                }
            }
            Step::Arc(arc) => {
                if checks {
                    false
                } else if let Some(line) = arc.clone().next() {
                    match self.push(now, line) {
                        Pushed::Taken => _ = arc.next(),
                        Pushed::Full => return false,
                    }
                    true
                } else {
                    false
                }
            }
            other => {
                let step = other.clone();
                execution.waits = self.act(now, step, &mut execution.block.modal);
                false
            }
        };
        if !keeps {
            execution.block.steps.pop_front();
        }
        true
    }

    /// Whether the machine still has something to do; sees to it that it does it.
    fn moves(&mut self, now: Instant) -> bool {
        self.start(now);
        matches!(self.state, State::Run | State::Jog) || self.machine.has_motions()
    }

    fn push(&mut self, now: Instant, line: Straight) -> Pushed {
        let is_jog = matches!(line.rate, Rate::Jog(_));
        let settings = &self.memory.settings;
        if settings.soft_limits() && !is_jog && settings.is_beyond(line.to) {
            self.beyond = true;
            if self.state == State::Run {
                self.hold(now, State::Hold);
            } else {
                self.alarm(now, Alarm::SoftLimit);
            }
            return Pushed::Full;
        }
        if self.state == State::Check {
            return Pushed::Taken;
        }
        if self.machine.room() == 0 {
            self.start(now);
            return Pushed::Full;
        }
        let motion = Move { to: self.steps(line.to), place: line.to, rate: line.rate };
        if let Some(remark) = self.machine.remark(&motion) {
            self.tell(&remark);
        }
        self.machine.push(now, motion);
        if is_jog && self.state == State::Idle && self.machine.has_motions() {
            self.state = State::Jog;
            self.machine.start(now, self.overrides);
        }
        Pushed::Taken
    }

    /// Does a step that is no motion.
    fn act(&mut self, now: Instant, step: Step, after: &mut Modal) -> Option<Wait> {
        let checks = self.state == State::Check;
        match step {
            Step::Line(_) | Step::Arc(_) => {}
            Step::Origin => self.cadence.origin_moved(),
            Step::System { system, origin } => {
                self.memory.systems[system] = origin;
                if system == after.system {
                    self.cadence.origin_moved();
                }
            }
            Step::Home { home, place } => self.memory.homes[home] = place,
            Step::Spindle { sense, rpm } if !checks => {
                (self.modal.spindle, self.modal.rpm) = (sense, rpm);
                self.drive_spindle(now, sense, rpm);
            }
            Step::Flood(flood) if !checks => {
                self.modal.flood = flood;
                self.set_flood(flood);
            }
            Step::Dwell { seconds } if !checks => {
                // It counts steps, with 16 bits.
                let steps = number::unsigned(libm::ceilf(DWELLS_PER_S * seconds)) as u16;
                return Some(Wait::Until(now + DWELL.times(u64::from(steps))));
            }
            // The firmware holds no feed in an alarm, which a probe in the same line has given.
            Step::Pause if !checks && self.state != State::Alarm => {
                self.hold(now, State::Hold);
                return Some(Wait::Resume);
            }
            Step::Probe { probe, .. } if !checks && probe.away => {
                after.position = self.modal.position;
                self.alarm(now, Alarm::ProbeInitial);
            }
            Step::Probe { probe, line } if !checks => {
                if self.push(now, line) == Pushed::Taken {
                    return Some(Wait::Probe { no_error: probe.no_error });
                }
            }
            Step::End => {
                self.override_all(now);
                if !checks {
                    self.cadence.origin_moved();
                    self.drive_spindle(now, Spindle::Off, 0.0);
                    self.set_flood(false);
                }
                self.tell(message::END);
            }
            Step::Write
            | Step::Spindle { .. }
            | Step::Flood(_)
            | Step::Dwell { .. }
            | Step::Pause
            | Step::Probe { .. } => {}
        }
        None
    }

    /// There is no probe, so that nothing is met.
    fn probe_ends(&mut self, now: Instant, no_error: bool) {
        if no_error {
            self.probed = self.place(now);
        } else {
            self.alarm(now, Alarm::ProbeContact);
        }
        let probed = report::probed(self.probed, &self.memory.settings);
        self.say(&probed);
    }
}
