//! Makes characters of a trace's edges, with the receivers that listened to them.

use torno_protocol::board::Stimulus;
use torno_protocol::clock::{Clock, Rate};
use torno_protocol::lathe::BAUD;
use torno_protocol::line::Edge;
use torno_protocol::time::Instant;
use torno_protocol::uart::{Character, Receiver};

use super::Trace;
use crate::engine::{Fact, LineId};
use crate::pc;
use crate::rig::file::RigFile;
use crate::rig::{Input, What};

/// A character on a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heard {
    /// When a receiver has it: in the middle of its stop bit.
    pub at: Instant,
    /// The line.
    pub line: LineId,
    /// What it is.
    pub character: Character,
}

/// Something that happens to a line, for its receiver.
enum Step<'a> {
    Edges(&'a [Edge]),
    Tune(Instant, u32),
    Clock(Instant, Clock),
}

impl Step<'_> {
    fn at(&self) -> Instant {
        match self {
            Self::Edges(edges) => edges.first().map_or(Instant::START, |edge| edge.at),
            Self::Tune(at, _) | Self::Clock(at, _) => *at,
        }
    }
}

/// The characters on all lines, in order of time.
///
/// Each line is heard by a hardware receiver that runs on the clock of the board at its end. The PC's two lines are
/// heard at the speed that the PC has set: what is seen is what it sends and what it gets.
pub fn characters(trace: &Trace) -> Vec<Heard> {
    let mut heard: Vec<Heard> = (0..trace.header.lines.len()).flat_map(|line| on_line(trace, line)).collect();
    heard.sort_by_key(|heard| heard.at);
    heard
}

/// The characters on one line, in order.
pub fn on_line(trace: &Trace, line: LineId) -> Vec<Heard> {
    // A trace of another version of torno may have a rig that this one cannot read.
    let rig = RigFile::parse(&trace.header.rig, &trace.header.text).ok();
    let pc = trace.header.boards.len().saturating_sub(1);
    let info = &trace.header.lines[line];
    let clock =
        rig.as_ref().map_or(Clock::TRUE, |rig| rig.boards.get(info.to).map_or(rig.pc.clock, |board| board.clock));
    let of_pc = info.from == pc || info.to == pc;
    let baud = rig.as_ref().filter(|_| of_pc).map_or(BAUD, |rig| rig.pc.baud);

    let mut steps: Vec<Step<'_>> = trace.facts.iter().filter_map(|fact| step(fact, line)).collect();
    if of_pc {
        steps.extend(trace.inputs.iter().filter_map(|input| tune(input, pc)));
    }
    steps.extend(trace.inputs.iter().filter_map(|input| match input.what {
        What::Stimulus { board, stimulus: Stimulus::Clock(clock) } if board == info.to => {
            Some(Step::Clock(input.at, clock))
        }
        _ => None,
    }));
    // A stimulus comes first at its instant.
    steps.sort_by_key(|step| (step.at(), matches!(step, Step::Edges(_))));

    let mut ear = Listener {
        line,
        receiver: Receiver::hardware(Rate::hz(baud), clock),
        baud,
        clock,
        sends: info.from == pc,
        next: None,
        heard: Vec::new(),
    };
    steps.into_iter().for_each(|step| ear.take(step));
    ear.drain(Instant::NEVER);
    ear.heard
}

fn step(fact: &Fact, line: LineId) -> Option<Step<'_>> {
    match fact {
        Fact::Edges { line: other, edges } if *other == line => Some(Step::Edges(edges)),
        _ => None,
    }
}

fn tune(input: &Input, pc: usize) -> Option<Step<'static>> {
    match input.what {
        What::Stimulus { board, stimulus: Stimulus::Configure { baud, .. } } if board == pc && baud > 0 => {
            Some(Step::Tune(input.at, baud.clamp(*pc::BAUD.start(), *pc::BAUD.end())))
        }
        _ => None,
    }
}

struct Listener {
    line: LineId,
    receiver: Receiver,
    baud: u32,
    clock: Clock,
    /// The line's sender is the one whose speed changes: it changes with the next character.
    sends: bool,
    next: Option<u32>,
    heard: Vec<Heard>,
}

impl Listener {
    fn take(&mut self, step: Step<'_>) {
        match step {
            Step::Edges(edges) => {
                let Some(first) = edges.first() else { return };
                self.drain(first.at);
                if let Some(baud) = self.next.take() {
                    self.drain(Instant::NEVER);
                    self.tune(baud, first.at);
                }
                self.receiver.hear(edges);
            }
            Step::Clock(at, clock) => {
                self.drain(at);
                self.clock = clock;
                self.receiver.retune(&Receiver::hardware(Rate::hz(self.baud), clock), at);
            }
            Step::Tune(_, baud) if self.sends => self.next = Some(baud),
            Step::Tune(at, baud) => {
                self.drain(at);
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

    /// Takes the characters that nothing from `until` on can change.
    fn drain(&mut self, until: Instant) {
        while let Some(at) = self.receiver.poll_timeout().filter(|at| *at <= until)
            && let Some(character) = self.receiver.take(at)
        {
            self.heard.push(Heard { at, line: self.line, character });
        }
    }
}

#[cfg(test)]
mod tests {
    use torno_protocol::time::Span;
    use torno_protocol::uart::Transmitter;

    use super::*;
    use crate::trace::Header;

    fn ms(ms: u64) -> Instant {
        Instant::START + Span::from_millis(ms)
    }

    fn trace() -> Trace {
        Trace::new(Header::new(&RigFile::load("lathe").unwrap(), "lathe", 0, None))
    }

    /// A byte at this speed, from `at` on.
    fn sent(trace: &mut Trace, line: &str, byte: u8, baud: u32, at: Instant) {
        let mut uart = Transmitter::hardware(Rate::hz(baud), Clock::TRUE);
        uart.push(byte);
        let edges = uart.load(at).unwrap().edges;
        let line = trace.line(line).unwrap();
        trace.facts.push(Fact::Edges { line, edges });
    }

    fn heard(trace: &Trace) -> Vec<(u8, bool)> {
        characters(trace).iter().map(|heard| (heard.character.byte, heard.character.framing_error)).collect()
    }

    #[test]
    fn the_pcs_lines_are_heard_at_the_speed_that_it_sets() {
        let mut trace = trace();
        let pc = trace.board("pc").unwrap();
        let stimulus = Stimulus::Configure { baud: 4800, ixon: false };
        // In the middle of the first character, which stays what it is.
        let at = ms(1) + Span::from_micros(500);
        trace.inputs.push(Input { given: at, at, what: What::Stimulus { board: pc, stimulus } });
        sent(&mut trace, "pc_to_master", 0x4b, 9600, ms(1));
        sent(&mut trace, "pc_to_master", 0x4b, 4800, ms(3));
        sent(&mut trace, "master_to_pc", 0x06, 4800, ms(10));
        assert_eq!(heard(&trace), [(0x4b, false), (0x4b, false), (0x06, false)]);
        trace.inputs.clear();
        assert_ne!(heard(&trace), [(0x4b, false), (0x4b, false), (0x06, false)]);
    }
}
