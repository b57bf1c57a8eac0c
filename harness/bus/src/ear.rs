//! Makes characters of the edges on lines, with receivers like those that listened to them.

use torno_protocol::board::Stimulus;
use torno_protocol::clock::{Clock, Rate};
use torno_protocol::line::Edge;
use torno_protocol::time::Instant;
use torno_protocol::uart::{Character, Receiver};

use crate::BAUD;

use torno_engine::{Fact, Input, InputKind, LineId, NodeId};
use torno_protocol::layout::{Layout, LineLayout};

/// A character on a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineCharacter {
    /// When a receiver has it: in the middle of its stop bit.
    pub at: Instant,
    /// The line.
    pub line: LineId,
    /// What it is.
    pub character: Character,
}

/// Something that happens to a line, for its receiver.
#[derive(Clone, Debug)]
enum Step {
    Edges(Vec<Edge>),
    Tune(Instant, u32),
    Clock(Instant, Clock),
}

impl Step {
    /// When; a stimulus comes first at its instant.
    fn order(&self) -> (Instant, bool) {
        match self {
            Self::Edges(edges) => (edges.first().map_or(Instant::START, |edge| edge.at), true),
            Self::Tune(at, _) | Self::Clock(at, _) => (*at, false),
        }
    }
}

/// Hears the characters on the lines of a rig.
///
/// Each line is heard by a hardware receiver that runs on the clock of the board at its end. The PC's two lines are
/// heard at the speed that the PC has set: what is seen is what it sends and what it gets.
#[derive(Clone, Debug)]
pub struct Ears {
    lines: Vec<Ear>,
}

/// One line: what is known of it and has not been heard yet, and who listens.
#[derive(Clone, Debug)]
struct Ear {
    to: NodeId,
    /// The gateway's UART at one of its ends, if there is one.
    gateway: Option<NodeId>,
    steps: Vec<Step>,
    listener: Listener,
}

impl Ears {
    /// Ears that listen from the start.
    pub fn new(layout: &Layout) -> Self {
        let ear = |(line, info): (LineId, &LineLayout)| {
            let (from, to) = (info.from.0, info.to.0);
            let clock = layout.boards[to].clock;
            let gateway = [from, to].into_iter().find(|end| layout.boards[*end].is_gateway());
            let receiver = Receiver::hardware(Rate::hz(info.baud), clock);
            let listener =
                Listener { line, receiver, baud: info.baud, clock, sends: gateway == Some(from), next: None };
            Ear { to, gateway, steps: Vec::new(), listener }
        };
        Self { lines: layout.lines.iter().enumerate().map(ear).collect() }
    }

    /// Takes note of what came from outside and of what happened.
    pub fn note(&mut self, inputs: &[Input], facts: &[Fact]) {
        for Input { at, what, .. } in inputs {
            let InputKind::Stimulus { board, stimulus } = what else { continue };
            match *stimulus {
                Stimulus::Configure { baud, .. } if baud > 0 => {
                    let baud = baud.clamp(*BAUD.start(), *BAUD.end());
                    let theirs = self.lines.iter_mut().filter(|ear| ear.gateway == Some(*board));
                    theirs.for_each(|ear| ear.steps.push(Step::Tune(*at, baud)));
                }
                Stimulus::Clock(clock) => {
                    let theirs = self.lines.iter_mut().filter(|ear| ear.to == *board);
                    theirs.for_each(|ear| ear.steps.push(Step::Clock(*at, clock)));
                }
                _ => {}
            }
        }
        for fact in facts {
            if let Fact::Edges { line, edges } = fact
                && let Some(ear) = self.lines.get_mut(*line)
            {
                ear.steps.push(Step::Edges(edges.clone()));
            }
        }
    }

    /// The characters that have been heard before `until`, in order of time. Nothing before it is still to be noted.
    pub fn hear(&mut self, until: Instant) -> Vec<LineCharacter> {
        let mut heard: Vec<LineCharacter> = self.lines.iter_mut().flat_map(|ear| ear.hear(until)).collect();
        heard.sort_by_key(|heard| heard.at);
        heard
    }
}

impl Ear {
    fn hear(&mut self, until: Instant) -> Vec<LineCharacter> {
        self.steps.sort_by_key(Step::order);
        let due = self.steps.partition_point(|step| step.order().0 < until);
        let mut heard = Vec::new();
        self.steps.drain(..due).for_each(|step| self.listener.take(step, &mut heard));
        self.listener.drain(until, &mut heard);
        heard
    }
}

#[derive(Clone, Debug)]
struct Listener {
    line: LineId,
    receiver: Receiver,
    baud: u32,
    clock: Clock,
    /// The line's sender is the one whose speed changes: it changes with the next character.
    sends: bool,
    next: Option<u32>,
}

impl Listener {
    fn take(&mut self, step: Step, heard: &mut Vec<LineCharacter>) {
        match step {
            Step::Edges(edges) => {
                let Some(first) = edges.first() else { return };
                self.drain(first.at.next(), heard);
                if let Some(baud) = self.next.take() {
                    self.drain(Instant::NEVER, heard);
                    self.tune(baud, first.at);
                }
                self.receiver.hear(&edges);
            }
            Step::Clock(at, clock) => {
                self.drain(at.next(), heard);
                self.clock = clock;
                self.receiver.retune(&Receiver::hardware(Rate::hz(self.baud), clock), at);
            }
            Step::Tune(_, baud) if self.sends => self.next = Some(baud),
            Step::Tune(at, baud) => {
                self.drain(at.next(), heard);
                self.tune(baud, at);
            }
        }
    }

    fn tune(&mut self, baud: u32, at: Instant) {
        if baud != self.baud {
            self.baud = baud;
            self.receiver.replace_by(&Receiver::hardware(Rate::hz(baud), self.clock), at);
        }
    }

    /// Takes the characters before `until`.
    fn drain(&mut self, until: Instant, heard: &mut Vec<LineCharacter>) {
        while let Some(at) = self.receiver.poll_timeout().filter(|at| *at < until)
            && let Some(character) = self.receiver.take(at)
        {
            heard.push(LineCharacter { at, line: self.line, character });
        }
    }
}

#[cfg(test)]
mod tests {
    use torno_protocol::time::Span;
    use torno_protocol::uart::Transmitter;

    use super::*;
    use crate::PcUart;
    use torno_protocol::board::Board;
    use torno_protocol::layout::{BoardLayout, GATEWAY};

    const PC: NodeId = 1;
    const TO_BOARD: LineId = 0;
    const TO_PC: LineId = 1;

    fn ms(ms: u64) -> Instant {
        Instant::START + Span::from_millis(ms)
    }

    /// A board of some kind with a gateway.
    fn layout() -> Layout {
        let description = PcUart::new(9600, 1, Clock::TRUE).description();
        let board = |name: &str, kind: &str| BoardLayout {
            name: name.to_owned(),
            kind: kind.to_owned(),
            clock: Clock::TRUE,
            description: description.clone(),
        };
        let line = |from, to| LineLayout {
            name: format!("{from}_to_{to}"),
            from: (from, 0),
            to: (to, 0),
            baud: 9600,
            dialect: "none".to_owned(),
        };
        Layout { boards: vec![board("echo", "echo"), board("pc", GATEWAY)], lines: vec![line(PC, 0), line(0, PC)] }
    }

    /// A byte at this speed, from `at` on.
    fn sent(line: LineId, byte: u8, baud: u32, at: Instant) -> Fact {
        let mut uart = Transmitter::hardware(Rate::hz(baud), Clock::TRUE);
        uart.push(byte);
        Fact::Edges { line, edges: uart.load(at).unwrap().edges }
    }

    fn heard(inputs: &[Input], facts: &[Fact]) -> Vec<(u8, bool)> {
        let mut ears = Ears::new(&layout());
        ears.note(inputs, facts);
        let heard = ears.hear(Instant::NEVER);
        heard.iter().map(|heard| (heard.character.byte, heard.character.framing_error)).collect()
    }

    #[test]
    fn the_pcs_lines_are_heard_at_the_speed_that_it_sets() {
        let stimulus = Stimulus::Configure { baud: 4800, ixon: false };
        // In the middle of the first character, which stays what it is.
        let at = ms(1) + Span::from_micros(500);
        let inputs = [Input { given: at, at, what: InputKind::Stimulus { board: PC, stimulus } }];
        let facts =
            [sent(TO_BOARD, 0x4b, 9600, ms(1)), sent(TO_BOARD, 0x4b, 4800, ms(3)), sent(TO_PC, 0x06, 4800, ms(10))];
        assert_eq!(heard(&inputs, &facts), [(0x4b, false), (0x4b, false), (0x06, false)]);
        assert_ne!(heard(&[], &facts), [(0x4b, false), (0x4b, false), (0x06, false)]);
    }
}
