//! The contract of a board: a state machine without I/O.
//!
//! # The driving rule
//!
//! After every `handle_…` call, drain [`Board::poll_output`] until it gives `None`; only then ask
//! [`Board::poll_timeout`] for the next deadline. [`Cell`](crate::stepping::Cell) is the one place that does so.
//!
//! # The order of simultaneous things
//!
//! At one instant: stimuli first, in the order of their arrival; then characters, by port; then the deadline.

use serde::{Deserialize, Serialize};

use crate::clock::Clock;
use crate::line::{Edge, Level};
use crate::time::{Instant, Span};
use crate::train::Train;
use crate::uart::{Character, Format, Receiver};

/// A board: firmware, UARTs and, where it drives a motor, the plant.
///
/// A board never fails and never panics, whatever reaches it: a bad byte is an event. It must be deterministic: its
/// state is a function of what reached it and when. A clone goes the same way as the original.
pub trait Board: Clone {
    /// What the board consists of, seen from outside. The same for the board's whole life.
    fn description(&self) -> Description;

    /// The receiver of each port, in the order of [`Description::ports`], as it hears from now on. Asked for at the
    /// start, at power-on, and after [`Stimulus::Clock`].
    fn receivers(&self) -> Vec<Receiver>;

    /// Something reached the board.
    fn handle_input(&mut self, now: Instant, input: Input);

    /// A deadline that [`Board::poll_timeout`] gave is due. `now` can be later: after a hang, or if firmware is slow.
    fn handle_timeout(&mut self, now: Instant);

    /// The next thing that the board does, at the instant of the last `handle_…` call.
    fn poll_output(&mut self) -> Option<Output>;

    /// A receiver that takes the place of a port's present one: its speed has been changed.
    fn poll_receiver(&mut self) -> Option<(u8, Receiver)> {
        None
    }

    /// The board's next deadline.
    fn poll_timeout(&self) -> Option<Deadline>;

    /// When the board concludes something from the silence of the world outside the rig, if that stays silent. With a
    /// person at the other end and time running free, this must not pass in no time at all.
    fn silence(&self) -> Option<Instant> {
        None
    }

    /// Nothing can leave the board by a port until something reaches it, however long it is left alone. It may still
    /// have deadlines, for telemetry.
    fn mute(&self) -> bool {
        self.poll_timeout().is_none()
    }

    /// What the board's quantities are at `at`, which does not lie before what it has handled: for whoever looks
    /// between two tellings. Only those of something that moves by itself need be there.
    fn quantities(&self, at: Instant) -> Vec<(u8, i64)> {
        _ = at;
        Vec::new()
    }

    /// What the board keeps without power. None, if its settings cannot say what it keeps at the start.
    fn kept(&self) -> Option<Kept> {
        None
    }

    /// Puts a logic analyser on the board's pins, for [`Board::pins`]. For a board as at power-on. Without it, nothing
    /// of them is computed.
    fn watch_pins(&mut self) {}

    /// What the watched pins have done before `until`, which does not lie before what the board has handled.
    fn pins(&mut self, until: Instant) -> Vec<Pin> {
        _ = until;
        Vec::new()
    }
}

/// What a board keeps without power.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Kept {
    /// The setting that says what a board keeps at the start: lines of text.
    pub setting: String,
    /// The lines with which another board would keep the same.
    pub lines: Vec<String>,
}

/// A pin of a board, other than those of its ports.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pin {
    /// Its name, unique on the board.
    pub name: String,
    /// Its level at the start.
    pub first: Level,
    /// Its edges, in order.
    pub edges: Vec<Edge>,
}

impl Pin {
    /// A pin on which nothing has happened yet.
    pub fn new(name: &str, first: Level) -> Self {
        Self { name: name.to_owned(), first, edges: Vec::new() }
    }

    /// Its level after its last edge.
    pub fn level(&self) -> Level {
        self.edges.last().map_or(self.first, |edge| edge.level)
    }

    /// Sets its level at `at`, which does not lie before its last edge. Two edges at one instant are none.
    pub fn set(&mut self, at: Instant, level: Level) {
        if self.level() == level {
            return;
        }
        if self.edges.pop_if(|last| last.at == at).is_none() {
            self.edges.push(Edge { at, level });
        }
    }
}

/// A pin of which the board tells while it runs, by levels and trains of pulses.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct OutputPin {
    /// Its name, unique on the board.
    pub name: String,
    /// Its level at the start.
    pub first: Level,
}

/// What a board puts on an output pin. It takes the place of whatever was still to come there; a pulse that has begun
/// goes on to its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum PinOutput {
    /// This level, from now on.
    Level(Level),
    /// These pulses, the first one not before now; the pin is low between them and after them.
    Pulses(Train),
}

/// What reaches a board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Input {
    /// A character on a port.
    Character {
        /// The port's place in [`Description::ports`].
        port: u8,
        /// What was received.
        character: Character,
    },
    /// Something that does not come over a line.
    Stimulus(Stimulus),
}

/// What can reach a board other than over its lines.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Stimulus {
    /// The firmware stops running (`true`) or runs on. Hardware receivers, outputs and the plant are not affected.
    /// The stepping loop sees to it; boards are not told. Power-on ends every hang.
    Hang(bool),
    /// The firmware restarts. The plant stays where it is.
    Reset,
    /// Something happens to a motor, or to what it moves. Boards without this motor ignore it.
    Motor {
        /// The motor's place in [`Description::motors`].
        motor: u8,
        /// What.
        what: MotorStimulus,
    },
    /// The program behind a PC's UART writes bytes to be sent.
    Write(Vec<u8>),
    /// The program behind a PC's UART discards what has not been sent.
    Discard,
    /// The program behind a PC's UART sets its speed in baud and whether `XON`/`XOFF` hold the transmitter.
    Configure {
        /// Bits per second.
        baud: u32,
        /// `XOFF` stops the transmitter, `XON` starts it.
        ixon: bool,
    },
    /// The supply is gone (`false`) or back. Without it lines are idle from that instant on, nothing is received, no
    /// firmware runs and drives are off; plants coast. With it the firmware restarts, as after a
    /// [`Stimulus::Reset`], and whatever it counted counts from 0 again. What is so already stays as it is.
    ///
    /// The stepping loop sees to the lines and to the silence. Boards are told, for their firmware and plants; what
    /// they put out besides telemetry does not leave them. Without supply a board is told of nothing but what
    /// happens to its plant, its oscillator and its settings.
    Power(bool),
    /// The firmware is busy for so long after each character and each deadline that it handles; zero heals.
    ///
    /// Meanwhile characters wait: two in the FIFO of a hardware UART, which overruns then; one in the variable of a
    /// software UART, whose interrupt still samples, and which the next character overwrites untold. (Ours.) Deadlines
    /// are late. The stepping loop sees to it; boards are not told.
    Slow(Span),
    /// The oscillator has this error from now on. UARTs keep to the old one up to the end of the character under way,
    /// timers up to the deadline that is set.
    Clock(Clock),
    /// The board's process is stopped (`true`) or goes on: a hang during which nothing can come from the board. So
    /// a [`Stimulus::Reset`] or [`Stimulus::Power`] that falls into it happens when the process goes on. The stepping
    /// loop sees to it; boards are not told.
    Stop(bool),
    /// The program behind a PC's UART sets the format of characters, both ways.
    Format(Format),
    /// The program behind a PC's UART holds the line low (`true`), or no longer.
    Break(bool),
}

/// What can happen to a motor, or to what it moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum MotorStimulus {
    /// The shaft is blocked (`true`) or free again.
    Stall(bool),
    /// The encoder at once loses (negative) or invents (positive) so many counts, in the sense in which it counted
    /// last. The firmware finds out when it next looks.
    Counts(i32),
    /// A load on the motor's shaft that opposes motion in either sense and never causes any, in per mille of the torque
    /// at standstill with full drive and nominal supply; 0 (and below) is none.
    Load(i32),
    /// The motor's supply, in per mille of nominal; 1000 heals.
    Supply(u16),
    /// Dead travel between an axis's motor and its carriage, in counts of its encoder; 0 heals. Motors
    /// without an axis ignore it.
    Backlash(u16),
    /// Something hard (a chip, a clamp) stops an axis's carriage so many counts from mid-travel, on the side given by
    /// the sign; one that is beyond it already, where it stands. One a side; 0 removes both. Motors without
    /// an axis ignore it.
    EndStop(i32),
    /// The service mode in which motors are characterised: the firmware drives with so many per mille of full drive,
    /// negative the other way round, from now on and whatever its control law says, which stands still meanwhile; 0 and
    /// a reset end it. (Ours: the paper's motors were characterised on the bench, by hand.) One that drives in one
    /// sense only takes a negative one for none.
    Drive(i32),
    /// A constant force on a stepper's carriage in the negative sense, in per mille of the holding torque; in the
    /// positive one if negative. 0 heals.
    Push(i32),
    /// A stepper's rotor slips by so many electrical turns at once.
    Slip(i32),
    /// A stepper's drive loses one pulse in so many; 0 heals.
    Skip(u32),
    /// A hit bends the mechanism for good: the carriage is so many micrometres from where the motor puts it.
    Shift(i32),
    /// The channels of a stepper's encoder are exchanged (`true`), or right again.
    Swap(bool),
    /// One channel of a stepper's encoder is dead; none heals.
    Dead(Option<Channel>),
}

/// A channel of an encoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Channel {
    /// A.
    A,
    /// B.
    B,
}

impl MotorStimulus {
    /// It happens to the motor at this place in [`Description::motors`].
    pub const fn of(self, motor: u8) -> Stimulus {
        Stimulus::Motor { motor, what: self }
    }
}

/// What a board does.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Output {
    /// A character is committed to a port's line.
    Character {
        /// The port's place in [`Description::ports`].
        port: u8,
        /// The character's edges, the first one not before the instant of the output.
        edges: Vec<Edge>,
        /// The end of its stop bit. No further edge comes before.
        end: Instant,
    },
    /// The port goes idle now; edges committed for later will not come.
    Cut {
        /// The port's place in [`Description::ports`].
        port: u8,
    },
    /// A quantity that has changed.
    Telemetry {
        /// The quantity's place in [`Description::signals`].
        signal: u8,
        /// Its new value, in the signal's unit.
        value: i64,
    },
    /// Something worth telling.
    Event {
        /// The event's place in [`Description::events`].
        event: u8,
        /// The event's value: see the event's text.
        value: i64,
    },
    /// An output pin does something: one output for a whole train of pulses.
    Pin {
        /// The pin's place in [`Description::pins`].
        pin: u8,
        /// What.
        what: PinOutput,
    },
}

/// When a board wants to run next, and why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Deadline {
    /// When.
    pub at: Instant,
    /// Why, for people.
    pub why: &'static str,
}

/// What a board consists of, seen from outside.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Description {
    /// The ports' names.
    pub ports: Vec<String>,
    /// The quantities in its telemetry.
    pub signals: Vec<Signal>,
    /// The events' texts; `{}` stands for the value, `{c}` for the value as a character.
    pub events: Vec<String>,
    /// What tells which boards it waits for.
    pub waits: Vec<Wait>,
    /// What it can do that some boards cannot.
    pub capabilities: Vec<Capability>,
    /// Its motors.
    pub motors: Vec<Motor>,
    /// The pins that it reports.
    pub pins: Vec<OutputPin>,
}

/// A motor of a board.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Motor {
    /// Its name, unique on the board.
    pub name: String,
    /// What it can do that some motors cannot.
    pub capabilities: Vec<Capability>,
}

/// A quantity whose bits tell what a board waits for.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Wait {
    /// The quantity's place in [`Description::signals`].
    pub signal: u8,
    /// For each of its bits, from the lowest: the port whose other end is waited for while the bit is set.
    pub ports: Vec<u8>,
}

/// What makes a stimulus mean something to a board or a motor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Capability {
    /// [`Stimulus::Reset`]: the board has firmware.
    Reset,
    /// [`MotorStimulus::Stall`], [`MotorStimulus::Counts`], [`MotorStimulus::Load`] and [`MotorStimulus::Supply`]: it
    /// is a motor with an encoder.
    Motor,
    /// [`MotorStimulus::Backlash`] and [`MotorStimulus::EndStop`]: the motor drives an axis.
    Axis,
    /// [`MotorStimulus::Push`], [`MotorStimulus::Slip`], [`MotorStimulus::Skip`], [`MotorStimulus::Shift`],
    /// [`MotorStimulus::Swap`] and [`MotorStimulus::Dead`]: it is a stepper whose encoder has two channels.
    Stepper,
}

/// A quantity in a board's telemetry.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Signal {
    /// Its name, for people. Nothing is read out of it.
    pub name: String,
    /// Its value before the first telemetry.
    pub initial: i64,
    /// Its unit; empty if it has none.
    pub unit: String,
    /// What it is.
    pub role: Role,
    /// The motor that it is about, by its place in [`Description::motors`].
    pub motor: Option<u8>,
}

/// What a quantity is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Role {
    /// What a motor's speed or position is to be.
    SetPoint,
    /// Where a motor is, as its firmware counts.
    Position,
    /// How fast a motor turns.
    Speed,
    /// How strongly a motor is driven.
    Drive,
    /// The following error: the set point less what came of it.
    Error,
    /// How far a motor still has to go.
    Remaining,
    /// How far a carriage is from where its firmware believes it to be.
    Offset,
    /// What a board is at: a number that stands for something, or its bits do.
    State,
    /// None of these.
    #[default]
    Other,
}

impl Signal {
    /// A quantity that is `initial` at the start. Nothing else is known of it.
    pub fn new(name: &str, initial: i64) -> Self {
        Self { name: name.to_owned(), initial, unit: String::new(), role: Role::Other, motor: None }
    }

    /// The same in this unit.
    #[must_use]
    pub fn with_unit(self, unit: &str) -> Self {
        Self { unit: unit.to_owned(), ..self }
    }

    /// The same with this role.
    #[must_use]
    pub fn with_role(self, role: Role) -> Self {
        Self { role, ..self }
    }

    /// The same of the motor at this place in [`Description::motors`].
    #[must_use]
    pub fn of_motor(self, motor: u8) -> Self {
        Self { motor: Some(motor), ..self }
    }
}

impl Description {
    /// The place of the quantity of a motor that has this role and, if that is asked for, this unit.
    pub fn signal(&self, motor: u8, role: Role, unit: Option<&str>) -> Option<u8> {
        let is_it = |signal: &Signal| {
            (signal.motor, signal.role) == (Some(motor), role) && unit.is_none_or(|unit| signal.unit == unit)
        };
        self.signals.iter().position(is_it).and_then(|place| u8::try_from(place).ok())
    }

    /// The name of one of several motors; none if it is the board's only one, which the board's name stands for.
    pub fn motor_name(&self, motor: u8) -> Option<&str> {
        let several = &self.motors[..];
        several.get(usize::from(motor)).filter(|_| several.len() > 1).map(|motor| motor.name.as_str())
    }
}

/// An event's text with its value filled in.
pub fn event_text(text: &str, value: i64) -> String {
    let character = u8::try_from(value).unwrap_or(b'?');
    text.replace("{}", &value.to_string()).replace("{c}", &char::from(character).to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motors_quantity_is_found_by_its_role_and_unit() {
        let speed = |unit: &str, motor| Signal::new("name", 0).with_unit(unit).with_role(Role::Speed).of_motor(motor);
        let signals = vec![
            Signal::new("name", 0),
            speed("counts", 0),
            speed("rpm", 0),
            speed("rpm", 1).with_role(Role::SetPoint),
        ];
        let motor = |name: &str| Motor { name: name.to_owned(), capabilities: Vec::new() };
        let description = Description { signals, motors: vec![motor("x")], ..Description::default() };
        let places = [
            description.signal(0, Role::Speed, None),
            description.signal(0, Role::Speed, Some("rpm")),
            description.signal(0, Role::Speed, Some("mm")),
            description.signal(0, Role::SetPoint, None),
            description.signal(1, Role::SetPoint, None),
            description.signal(1, Role::Speed, None),
        ];
        assert_eq!(places, [Some(1), Some(2), None, None, Some(3), None]);
        assert_eq!(description.motor_name(0), None, "the board's name stands for it");
        let two = Description { motors: vec![motor("x"), motor("y")], ..Description::default() };
        assert_eq!([0, 1, 2].map(|motor| two.motor_name(motor)), [Some("x"), Some("y"), None]);
    }

    #[test]
    fn an_events_text_shows_its_value_as_a_number_and_as_a_character() {
        let texts = [("done", 7), ("{} of {}", -12), ("refused ({c})", 115), ("{c}", 256)];
        let texts = texts.map(|(text, value)| event_text(text, value));
        assert_eq!(texts, ["done", "-12 of -12", "refused (s)", "?"]);
    }

    /// A board that says no more than it must.
    #[derive(Clone)]
    struct Plain(Option<Deadline>);

    impl Board for Plain {
        fn description(&self) -> Description {
            Description::default()
        }

        fn receivers(&self) -> Vec<Receiver> {
            Vec::new()
        }

        fn handle_input(&mut self, _: Instant, _: Input) {}

        fn handle_timeout(&mut self, _: Instant) {}

        fn poll_output(&mut self) -> Option<Output> {
            None
        }

        fn poll_timeout(&self) -> Option<Deadline> {
            self.0
        }
    }

    #[test]
    fn by_default_a_board_is_mute_without_a_deadline_and_waits_for_no_silence() {
        let waiting = Plain(Some(Deadline { at: Instant::START, why: "test" }));
        assert_eq!((Plain(None).mute(), waiting.mute()), (true, false));
        assert_eq!((Plain(None).silence(), waiting.silence()), (None, None));
    }
}
