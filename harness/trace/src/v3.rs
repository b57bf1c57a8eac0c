//! Version 3 of the format: its header says less of the lines and nothing of the clocks; its descriptions say less of
//! quantities and motors; its stimuli of a motor are of two forms.

use serde::Deserialize;
use torno_engine::{Disturbance, InputKind};
use torno_protocol::board::{self, Capability, MotorStimulus, Role, Wait};
use torno_protocol::clock::Clock;
use torno_protocol::layout::{BoardLayout, Layout, LineLayout};
use torno_protocol::time::{Instant, Span};

use crate::{Header, format};

/// The number of this version.
pub(crate) const VERSION: u16 = 3;

/// The speed of the lines of a rig that cannot be built.
const UNKNOWN_BAUD: u32 = 9600;

/// The name of a board's only motor, which had none.
const ONLY_MOTOR: &str = "motor";

#[derive(Deserialize)]
struct HeaderV3 {
    torno: String,
    rig: String,
    text: String,
    seed: u64,
    program: Option<String>,
    boards: Vec<Board>,
    lines: Vec<Line>,
}

#[derive(Deserialize)]
struct Board {
    name: String,
    kind: String,
    description: Description,
}

#[derive(Deserialize)]
struct Line {
    name: String,
    from: usize,
    to: usize,
}

#[derive(Deserialize)]
struct Description {
    ports: Vec<String>,
    signals: Vec<Signal>,
    events: Vec<String>,
    waits: Vec<Wait>,
    heeds: Vec<Heeds>,
    motors: Vec<Motor>,
}

#[derive(Deserialize)]
struct Signal {
    name: String,
    initial: i64,
}

#[derive(Clone, Copy, PartialEq, Eq, Deserialize)]
enum Heeds {
    Reset,
    Motor,
    Axis,
}

#[derive(Deserialize)]
struct Motor {
    name: String,
    heeds: Vec<Heeds>,
}

#[derive(Deserialize)]
enum InputKindV3 {
    Stimulus { board: usize, stimulus: Stimulus },
    Disturbed { line: usize, fault: u32, disturbance: Disturbance },
    Healed { line: usize, fault: u32 },
    Stopped { board: usize, told: Instant },
    Continued { board: usize },
    Died { board: usize, told: Instant },
}

#[derive(Deserialize)]
enum Stimulus {
    Hang(bool),
    Reset,
    Stall(bool),
    Write(Vec<u8>),
    Discard,
    Configure { baud: u32, ixon: bool },
    Power(bool),
    Slow(Span),
    Clock(Clock),
    Counts(i32),
    Load(i32),
    Supply(u16),
    Backlash(u16),
    EndStop(i32),
    Stop(bool),
    Drive(i32),
    Of(u8, MotorStimulus),
}

/// Reads a header. What it does not say is what the rig that its text describes has today, as far as it can be built
/// and has the same boards and lines; and of a quantity, what a board of the same kind says of one of that name.
pub(crate) fn header(bytes: &[u8], layout: impl Fn(&str, &str) -> Option<(Layout, String)>) -> Option<Header> {
    let HeaderV3 { torno, rig, text, seed, program, boards, lines } = postcard::from_bytes(bytes).ok()?;
    if lines.iter().any(|line| line.from >= boards.len() || line.to >= boards.len()) {
        return None;
    }
    let (today, text) = layout(&rig, &text).map_or((None, text), |(layout, text)| (Some(layout), text));
    let alone = |Board { name, kind, description }| {
        let known = today.iter().flat_map(|layout| &layout.boards).find(|board| board.kind == kind);
        let description = description.with(known.map(|board| &board.description));
        BoardLayout { name, kind, clock: Clock::TRUE, description, receivers: Vec::new() }
    };
    let boards: Vec<BoardLayout> = boards.into_iter().map(alone).collect();
    let layout = match today {
        Some(today) if is_same(&today, &boards, &lines) => today,
        today => {
            let mut layout = Layout { boards, lines: lines.into_iter().map(Line::alone).collect() };
            format::take_receivers(&mut layout, today.as_ref());
            layout
        }
    };
    Some(Header { torno, rig, text, seed, program, layout })
}

/// Reads what came from outside; gives the bytes that follow it.
pub(crate) fn what(bytes: &[u8]) -> Option<(InputKind, &[u8])> {
    let (what, rest) = postcard::take_from_bytes::<InputKindV3>(bytes).ok()?;
    Some((what.into(), rest))
}

fn is_same(layout: &Layout, boards: &[BoardLayout], lines: &[Line]) -> bool {
    let same_board =
        |(a, b): (&BoardLayout, &BoardLayout)| (&a.name, &a.kind, &a.description) == (&b.name, &b.kind, &b.description);
    let same_line = |(a, b): (&LineLayout, &Line)| (&a.name, a.from.0, a.to.0) == (&b.name, b.from, b.to);
    layout.boards.len() == boards.len()
        && layout.lines.len() == lines.len()
        && layout.boards.iter().zip(boards).all(same_board)
        && layout.lines.iter().zip(lines).all(same_line)
}

impl Line {
    /// All that is known of it without its rig.
    fn alone(self) -> LineLayout {
        let Self { name, from, to } = self;
        LineLayout { name, from: (from, 0), to: (to, 0), baud: UNKNOWN_BAUD, dialect: String::new() }
    }
}

impl Description {
    /// With what a board of the same kind says of its quantities today.
    fn with(self, known: Option<&board::Description>) -> board::Description {
        let Self { ports, signals, events, waits, heeds, motors } = self;
        let signal = |Signal { name, initial }| {
            let known = known.iter().flat_map(|known| &known.signals).find(|signal| signal.name == name);
            let (unit, role, motor) =
                known.map_or((String::new(), Role::Other, None), |known| (known.unit.clone(), known.role, known.motor));
            board::Signal { name, initial, unit, role, motor }
        };
        let of_the_board = |heeds: &Heeds| *heeds == Heeds::Reset;
        let (own, of_motor): (Vec<Heeds>, Vec<Heeds>) = heeds.into_iter().partition(of_the_board);
        let only = (!of_motor.is_empty()).then(|| Motor { name: ONLY_MOTOR.to_owned(), heeds: of_motor });
        let motor = |Motor { name, heeds }| board::Motor { name, capabilities: capabilities(&heeds) };
        board::Description {
            ports,
            signals: signals.into_iter().map(signal).collect(),
            events,
            waits,
            capabilities: capabilities(&own),
            motors: only.into_iter().chain(motors).map(motor).collect(),
            pins: Vec::new(),
        }
    }
}

fn capabilities(heeds: &[Heeds]) -> Vec<Capability> {
    let capability = |heeds: &Heeds| match heeds {
        Heeds::Reset => Capability::Reset,
        Heeds::Motor => Capability::Motor,
        Heeds::Axis => Capability::Axis,
    };
    heeds.iter().map(capability).collect()
}

impl From<InputKindV3> for InputKind {
    fn from(what: InputKindV3) -> Self {
        match what {
            InputKindV3::Stimulus { board, stimulus } => Self::Stimulus { board, stimulus: stimulus.into() },
            InputKindV3::Disturbed { line, fault, disturbance } => Self::Disturbed { line, fault, disturbance },
            InputKindV3::Healed { line, fault } => Self::Healed { line, fault },
            InputKindV3::Stopped { board, told } => Self::Stopped { board, told },
            InputKindV3::Continued { board } => Self::Continued { board },
            InputKindV3::Died { board, told } => Self::Died { board, told },
        }
    }
}

impl From<Stimulus> for board::Stimulus {
    fn from(stimulus: Stimulus) -> Self {
        match stimulus {
            Stimulus::Hang(hung) => Self::Hang(hung),
            Stimulus::Reset => Self::Reset,
            Stimulus::Write(bytes) => Self::Write(bytes),
            Stimulus::Discard => Self::Discard,
            Stimulus::Configure { baud, ixon } => Self::Configure { baud, ixon },
            Stimulus::Power(on) => Self::Power(on),
            Stimulus::Slow(by) => Self::Slow(by),
            Stimulus::Clock(clock) => Self::Clock(clock),
            Stimulus::Stop(stopped) => Self::Stop(stopped),
            Stimulus::Stall(blocked) => MotorStimulus::Stall(blocked).of(0),
            Stimulus::Counts(counts) => MotorStimulus::Counts(counts).of(0),
            Stimulus::Load(load) => MotorStimulus::Load(load).of(0),
            Stimulus::Supply(supply) => MotorStimulus::Supply(supply).of(0),
            Stimulus::Backlash(counts) => MotorStimulus::Backlash(counts).of(0),
            Stimulus::EndStop(counts) => MotorStimulus::EndStop(counts).of(0),
            Stimulus::Drive(drive) => MotorStimulus::Drive(drive).of(0),
            Stimulus::Of(motor, what) => what.of(motor),
        }
    }
}

#[cfg(test)]
mod tests {
    use torno_protocol::board::Stimulus;

    use super::*;

    /// Byte for byte, as version 3 was written.
    #[test]
    fn what_comes_from_outside_is_read_as_it_was_written() {
        let of_board_2 =
            |bytes: &[u8]| what(&[&[0, 2], bytes, &[7]].concat()).map(|(what, rest)| (what, rest.to_vec()));
        for (bytes, stimulus) in [
            (&[0, 1][..], Stimulus::Hang(true)),
            (&[1], Stimulus::Reset),
            (&[2, 1], MotorStimulus::Stall(true).of(0)),
            (&[3, 2, 8, 9], Stimulus::Write(vec![8, 9])),
            (&[4], Stimulus::Discard),
            (&[5, 0x80, 0x4b, 1], Stimulus::Configure { baud: 9600, ixon: true }),
            (&[6, 0], Stimulus::Power(false)),
            (&[7, 5], Stimulus::Slow(Span::from_nanos(5))),
            (&[8, 1], Stimulus::Clock(Clock::from_ppb(-1).unwrap())),
            (&[9, 5], MotorStimulus::Counts(-3).of(0)),
            (&[10, 4], MotorStimulus::Load(2).of(0)),
            (&[11, 3], MotorStimulus::Supply(3).of(0)),
            (&[12, 4], MotorStimulus::Backlash(4).of(0)),
            (&[13, 2], MotorStimulus::EndStop(1).of(0)),
            (&[14, 1], Stimulus::Stop(true)),
            (&[15, 2], MotorStimulus::Drive(1).of(0)),
            (&[16, 1, 0, 1], MotorStimulus::Stall(true).of(1)),
            (&[16, 1, 1, 5], MotorStimulus::Counts(-3).of(1)),
            (&[16, 1, 2, 4], MotorStimulus::Load(2).of(1)),
            (&[16, 1, 3, 3], MotorStimulus::Supply(3).of(1)),
            (&[16, 1, 4, 4], MotorStimulus::Backlash(4).of(1)),
            (&[16, 1, 5, 2], MotorStimulus::EndStop(1).of(1)),
            (&[16, 2, 6, 1], MotorStimulus::Drive(-1).of(2)),
        ] {
            assert_eq!(of_board_2(bytes), Some((InputKind::Stimulus { board: 2, stimulus }, vec![7])), "{bytes:?}");
        }
        assert_eq!(of_board_2(&[17]), None);
        let told = Instant::from_nanos(3);
        for (bytes, expected) in [
            (&[1, 4, 9, 0][..], InputKind::Disturbed { line: 4, fault: 9, disturbance: Disturbance::Cut }),
            (&[2, 4, 9], InputKind::Healed { line: 4, fault: 9 }),
            (&[3, 1, 3], InputKind::Stopped { board: 1, told }),
            (&[4, 1], InputKind::Continued { board: 1 }),
            (&[5, 1, 3], InputKind::Died { board: 1, told }),
        ] {
            assert_eq!(what(bytes), Some((expected, &[][..])));
        }
    }

    #[test]
    fn a_description_gets_what_a_board_of_its_kind_says_today() {
        let old = || Description {
            ports: vec!["p".to_owned()],
            signals: ["x", "old"].map(|name| Signal { name: name.to_owned(), initial: 4 }).into(),
            events: Vec::new(),
            waits: Vec::new(),
            heeds: vec![Heeds::Reset, Heeds::Motor, Heeds::Axis],
            motors: Vec::new(),
        };
        let today = board::Signal::new("x", 0).with_unit("mm").with_role(Role::Position).of_motor(0);
        let known = board::Description { signals: vec![today.clone()], ..board::Description::default() };
        let read = old().with(Some(&known));
        assert_eq!(read.signals, [board::Signal { initial: 4, ..today }, board::Signal::new("old", 4)]);
        assert_eq!(read.capabilities, [Capability::Reset]);
        assert_eq!(read.motors[0].capabilities, [Capability::Motor, Capability::Axis]);
        assert_eq!(old().with(None).signals[0], board::Signal::new("x", 4));
    }
}
