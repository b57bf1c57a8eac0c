//! Makes characters of the edges on lines, with receivers like those that listened to them.

use torno_protocol::board::Stimulus;
use torno_protocol::clock::{Clock, Rate};
use torno_protocol::line::Edge;
use torno_protocol::time::Instant;
use torno_protocol::uart::{Character, Format, Receiver, ReceiverKind, TickTimer};

use crate::BAUD;

use torno_engine::{Fact, Input, InputKind, LineId, NodeId};
use torno_protocol::layout::{Layout, LineLayout};

/// A character on a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineCharacter {
    /// When the receiver at the line's end has it: in the middle of its stop bit.
    pub at: Instant,
    /// The line.
    pub line: LineId,
    /// What it is.
    pub character: Character,
}

/// Something that happens to a line, or to the board at its end.
#[derive(Clone, Debug)]
enum Step {
    Edges(Vec<Edge>),
    Stimulus(Instant, Stimulus),
    Gone(Instant),
}

impl Step {
    /// When; what happens to the board comes first at its instant.
    fn order(&self) -> (Instant, bool) {
        match self {
            Self::Edges(edges) => (edges.first().map_or(Instant::START, |edge| edge.at), true),
            Self::Stimulus(at, _) | Self::Gone(at) => (*at, false),
        }
    }
}

/// Hears the characters on the lines of a rig.
///
/// Each line is heard by a receiver like the one at its end: of the same kind, on the clock of that board, and deaf
/// while that one is. What becomes of a character when a board's firmware is late is not heard here: the board tells.
#[derive(Clone, Debug)]
pub struct Ears {
    lines: Vec<Ear>,
}

/// One line: what is known of it and has not been heard yet, and who listens.
#[derive(Clone, Debug)]
struct Ear {
    /// The board at its end.
    to: NodeId,
    steps: Vec<Step>,
    listener: Listener,
}

impl Ears {
    /// Ears that listen from the start.
    pub fn new(layout: &Layout) -> Self {
        let ear = |(line, info): (LineId, &LineLayout)| {
            let to = info.to.0;
            let listener = Listener::new(line, layout.receiver(info), layout.boards[to].clock);
            Ear { to, steps: Vec::new(), listener }
        };
        Self { lines: layout.lines.iter().enumerate().map(ear).collect() }
    }

    /// Takes note of what came from outside and of what happened.
    pub fn note(&mut self, inputs: &[Input], facts: &[Fact]) {
        for Input { at, what, .. } in inputs {
            let (board, step) = match what {
                InputKind::Stimulus { board, stimulus } => (board, Step::Stimulus(*at, stimulus.clone())),
                InputKind::Stopped { board, .. } => (board, Step::Stimulus(*at, Stimulus::Stop(true))),
                InputKind::Continued { board } => (board, Step::Stimulus(*at, Stimulus::Stop(false))),
                InputKind::Died { board, .. } => (board, Step::Gone(*at)),
                InputKind::Disturbed { .. } | InputKind::Healed { .. } => continue,
            };
            let theirs = self.lines.iter_mut().filter(|ear| ear.to == *board);
            theirs.for_each(|ear| ear.steps.push(step.clone()));
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

/// A receiver like that of a board's port, with as much of the board's state as decides what it hears: see
/// [`Cell`](torno_protocol::stepping::Cell), which rules it.
#[derive(Clone, Debug)]
struct Listener {
    line: LineId,
    kind: ReceiverKind,
    format: Format,
    clock: Clock,
    /// In which a software receiver lives.
    timer: TickTimer,
    receiver: Receiver,
    off: bool,
    hung: u32,
    /// Its process is stopped. How its supply was switched meanwhile.
    stopped: Option<Vec<bool>>,
    gone: bool,
}

impl Listener {
    fn new(line: LineId, kind: ReceiverKind, clock: Clock) -> Self {
        let timer = TickTimer::new(kind.baud(), clock);
        let format = Format::EIGHT_N_ONE;
        let receiver = receiver(kind, format, &timer, clock);
        Self { line, kind, format, clock, timer, receiver, off: false, hung: 0, stopped: None, gone: false }
    }

    fn take(&mut self, step: Step, heard: &mut Vec<LineCharacter>) {
        match step {
            Step::Edges(edges) => {
                let Some(first) = edges.first() else { return };
                self.drain(first.at.next(), heard);
                self.receiver.hear(&edges);
            }
            Step::Stimulus(at, stimulus) => {
                self.drain(at, heard);
                self.stimulus(at, &stimulus);
            }
            Step::Gone(at) => {
                self.drain(at, heard);
                self.gone = true;
            }
        }
    }

    fn stimulus(&mut self, at: Instant, stimulus: &Stimulus) {
        match (stimulus, &mut self.stopped) {
            (Stimulus::Power(on), Some(missed)) => missed.push(*on),
            (Stimulus::Power(on), None) => self.power(at, *on),
            (Stimulus::Stop(true), stopped) => _ = stopped.get_or_insert_default(),
            (Stimulus::Stop(false), stopped) => {
                let missed = stopped.take().unwrap_or_default();
                missed.into_iter().for_each(|on| self.power(at, on));
            }
            (Stimulus::Hang(true), _) => self.hung += 1,
            (Stimulus::Hang(false), _) => self.hung = self.hung.saturating_sub(1),
            (Stimulus::Clock(clock), _) => {
                self.clock = *clock;
                self.timer.retune(at, *clock);
                self.receiver.retune(&self.tuned(), at);
            }
            (Stimulus::Configure { baud, .. }, _) => self.configure(at, *baud),
            (Stimulus::Format(format), _) => self.set_format(at, *format),
            _ => {}
        }
    }

    fn power(&mut self, at: Instant, on: bool) {
        if on != self.off {
            return;
        }
        (self.off, self.hung) = (!on, 0);
        if on {
            // A character that began before is none.
            self.receiver.replace_by(&self.tuned(), at);
        }
    }

    /// A gateway's UART is set to another speed.
    fn configure(&mut self, at: Instant, baud: u32) {
        let ReceiverKind::Hardware { baud: present } = &mut self.kind else { return };
        let wanted = Rate::hz(baud.clamp(*BAUD.start(), *BAUD.end()));
        if baud > 0 && wanted != *present {
            *present = wanted;
            self.receiver.replace_by(&self.tuned(), at);
        }
    }

    /// A gateway's UART is set to another format.
    fn set_format(&mut self, at: Instant, format: Format) {
        if format != self.format && self.kind.is_buffered() {
            self.format = format;
            self.receiver.replace_by(&self.tuned(), at);
        }
    }

    /// The receiver as it hears from now on.
    fn tuned(&self) -> Receiver {
        receiver(self.kind, self.format, &self.timer, self.clock)
    }

    /// What it receives reaches the board's firmware, or hardware that keeps it.
    const fn hears(&self) -> bool {
        let runs = self.hung == 0 && self.stopped.is_none();
        !self.gone && !self.off && (runs || self.kind.is_buffered())
    }

    /// Takes the characters before `until`.
    fn drain(&mut self, until: Instant, heard: &mut Vec<LineCharacter>) {
        while let Some(at) = self.receiver.poll_timeout().filter(|at| *at < until)
            && let Some(character) = self.receiver.take(at)
        {
            if self.hears() {
                heard.push(LineCharacter { at, line: self.line, character });
            }
        }
    }
}

fn receiver(kind: ReceiverKind, format: Format, timer: &TickTimer, clock: Clock) -> Receiver {
    match kind {
        ReceiverKind::Hardware { baud } => Receiver::hardware(baud, clock).with_format(format),
        ReceiverKind::Software { link, .. } => timer.receiver(link),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use torno_protocol::board::{self, Board, Deadline, Output};
    use torno_protocol::layout::{BoardLayout, GATEWAY};
    use torno_protocol::line::Level;
    use torno_protocol::record::Heard;
    use torno_protocol::stepping::Cell;
    use torno_protocol::time::Span;
    use torno_protocol::uart::Transmitter;

    use super::*;
    use crate::PcUart;

    const RATE: Rate = Rate::hz(9600);
    const PC: NodeId = 1;
    const TO_BOARD: LineId = 0;
    const TO_PC: LineId = 1;

    fn ms(ms: u64) -> Instant {
        Instant::START + Span::from_millis(ms)
    }

    /// A board with such a receiver, and a gateway.
    fn layout(kind: ReceiverKind, clock: Clock) -> Layout {
        let uart = PcUart::new(9600, 1, Clock::TRUE);
        let board = |name: &str, kind: &str, clock: Clock, receiver: ReceiverKind| BoardLayout {
            name: name.to_owned(),
            kind: kind.to_owned(),
            clock,
            description: uart.description(),
            receivers: vec![receiver],
        };
        let line = |from, to| LineLayout {
            name: format!("{from}_to_{to}"),
            from: (from, 0),
            to: (to, 0),
            baud: 9600,
            dialect: "none".to_owned(),
        };
        let gateway = board("pc", GATEWAY, Clock::TRUE, uart.receivers()[0].kind());
        Layout { boards: vec![board("echo", "echo", clock, kind), gateway], lines: vec![line(PC, 0), line(0, PC)] }
    }

    /// A byte at this speed, from `at` on.
    fn sent(line: LineId, byte: u8, baud: u32, at: Instant) -> Fact {
        let mut uart = Transmitter::hardware(Rate::hz(baud), Clock::TRUE);
        uart.push(byte);
        Fact::Edges { line, edges: uart.load(at).unwrap().edges }
    }

    fn input(board: NodeId, at: Instant, stimulus: Stimulus) -> Input {
        Input { given: at, at, what: InputKind::Stimulus { board, stimulus } }
    }

    #[test]
    fn each_end_hears_at_its_own_speed() {
        // In the middle of the first character.
        let at = ms(1) + Span::from_micros(500);
        let slower = input(PC, at, Stimulus::Configure { baud: 4800, ixon: false });
        let facts =
            [sent(TO_BOARD, 0x4b, 9600, ms(1)), sent(TO_BOARD, 0x4b, 9600, ms(3)), sent(TO_PC, 0x06, 4800, ms(10))];
        let heard = |inputs: &[Input]| -> Vec<(u8, bool)> {
            let mut ears = Ears::new(&layout(ReceiverKind::Hardware { baud: RATE }, Clock::TRUE));
            ears.note(inputs, &facts);
            ears.hear(Instant::NEVER)
                .iter()
                .map(|heard| (heard.character.byte, heard.character.framing_error))
                .collect()
        };
        assert_eq!(heard(&[slower]), [(0x4b, false), (0x4b, false), (0x06, false)]);
        assert_eq!(heard(&[])[..2], [(0x4b, false), (0x4b, false)]);
        assert_ne!(heard(&[])[2..], [(0x06, false)]);
    }

    /// Keeps what reaches its firmware.
    #[derive(Clone)]
    struct Listening {
        kind: ReceiverKind,
        clock: Clock,
        timer: TickTimer,
        heard: Vec<(Instant, Character)>,
    }

    impl Board for Listening {
        fn description(&self) -> board::Description {
            board::Description::default()
        }

        fn receivers(&self) -> Vec<Receiver> {
            vec![receiver(self.kind, Format::EIGHT_N_ONE, &self.timer, self.clock)]
        }

        fn handle_input(&mut self, now: Instant, input: board::Input) {
            match input {
                board::Input::Character { character, .. } => self.heard.push((now, character)),
                board::Input::Stimulus(Stimulus::Clock(clock)) => {
                    self.clock = clock;
                    self.timer.retune(now, clock);
                }
                board::Input::Stimulus(_) => {}
            }
        }

        fn handle_timeout(&mut self, _: Instant) {}

        fn poll_output(&mut self) -> Option<Output> {
            None
        }

        fn poll_timeout(&self) -> Option<Deadline> {
            None
        }
    }

    fn stimuli(halts: bool) -> impl Strategy<Value = Stimulus> {
        let clock = (-60_000_000..60_000_000i32).prop_map(|ppb| Stimulus::Clock(Clock::from_ppb(ppb).unwrap()));
        let halt = prop_oneof![any::<bool>().prop_map(Stimulus::Hang), any::<bool>().prop_map(Stimulus::Stop)];
        let halt = if halts { halt.boxed() } else { Just(Stimulus::Reset).boxed() };
        prop_oneof![2 => clock, 2 => any::<bool>().prop_map(Stimulus::Power), 3 => halt]
    }

    /// A receiver, and what happens to its line and its board: gaps between edges, and stimuli.
    fn lives() -> impl Strategy<Value = (ReceiverKind, i32, Vec<u64>, Vec<(u64, Stimulus)>)> {
        let kind = prop_oneof![
            Just(ReceiverKind::Hardware { baud: RATE }),
            (0..3u32).prop_map(|link| ReceiverKind::Software { baud: RATE, link })
        ];
        // Bits of a sender whose clock may be off, and noise.
        let gap = prop_oneof![4 => (1..10u64).prop_map(|bits| bits * 103_000), 1 => 1..2_000_000u64];
        kind.prop_flat_map(move |kind| {
            // What hardware keeps for firmware that is late, the firmware has later.
            let stimuli = prop::collection::vec((0..60_000_000u64, stimuli(!kind.is_buffered())), 0..20);
            (Just(kind), -60_000_000..60_000_000i32, prop::collection::vec(gap.clone(), 2..150), stimuli)
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2_000))]

        #[test]
        fn an_ear_hears_what_reaches_the_board((kind, ppb, gaps, mut stimuli) in lives(), pause in 0..60_000_000u64) {
            let clock = Clock::from_ppb(ppb).unwrap();
            stimuli.sort_by_key(|(at, _)| *at);
            let mut t = Instant::START;
            let levels = [Level::Low, Level::High].into_iter().cycle();
            let edges: Vec<Edge> = gaps.into_iter().zip(levels).map(|(gap, level)| {
                t += Span::from_nanos(gap);
                Edge { at: t, level }
            }).collect();
            let timer = TickTimer::new(RATE, clock);
            let mut cell = Cell::new(Listening { kind, clock, timer, heard: Vec::new() });
            let mut ears = Ears::new(&layout(kind, clock));
            for (at, stimulus) in stimuli {
                let at = Instant::from_nanos(at);
                ears.note(&[input(0, at, stimulus.clone())], &[]);
                cell.hear(&Heard::Stimulus { at, stimulus });
            }
            for edges in edges.chunks(7) {
                ears.note(&[], &[Fact::Edges { line: TO_BOARD, edges: edges.to_vec() }]);
                cell.hear(&Heard::Edges { port: 0, edges: edges.to_vec() });
            }
            cell.run(Instant::NEVER, |_, _| {});
            // Bit by bit, or at once.
            let heard = [ears.hear(Instant::from_nanos(pause)), ears.hear(Instant::NEVER)].concat();
            let heard: Vec<(Instant, Character)> = heard.iter().map(|heard| (heard.at, heard.character)).collect();
            prop_assert_eq!(heard, cell.board().heard.clone());
        }
    }

    #[test]
    fn what_happens_to_the_board_comes_before_a_character_of_the_same_instant() {
        let heard = |off: Option<Instant>| {
            let mut ears = Ears::new(&layout(ReceiverKind::Hardware { baud: RATE }, Clock::TRUE));
            let inputs: Vec<Input> = off.into_iter().map(|at| input(0, at, Stimulus::Power(false))).collect();
            ears.note(&inputs, &[sent(TO_BOARD, 0x4b, 9600, ms(3))]);
            ears.hear(Instant::NEVER)
        };
        let at = heard(None)[0].at;
        assert_eq!([at, at.next()].map(|off| heard(Some(off)).len()), [0, 1]);
    }

    #[test]
    fn hardware_hears_while_the_firmware_hangs_and_nobody_without_supply_or_process() {
        let hardware = ReceiverKind::Hardware { baud: RATE };
        let software = ReceiverKind::Software { baud: RATE, link: 0 };
        let dead = |at| Input { given: at, at, what: InputKind::Died { board: 0, told: at } };
        let stopped = |at| Input { given: at, at, what: InputKind::Stopped { board: 0, told: at } };
        for (what, by_hardware, by_software) in [
            (input(0, ms(1), Stimulus::Hang(true)), 1, 0),
            (input(0, ms(1), Stimulus::Stop(true)), 1, 0),
            (stopped(ms(1)), 1, 0),
            (input(0, ms(1), Stimulus::Power(false)), 0, 0),
            (dead(ms(1)), 0, 0),
            (input(0, ms(1), Stimulus::Reset), 1, 1),
            (dead(ms(9)), 1, 1),
        ] {
            let heard = |kind| {
                let mut ears = Ears::new(&layout(kind, Clock::TRUE));
                ears.note(core::slice::from_ref(&what), &[sent(TO_BOARD, 0x4b, 9600, ms(3))]);
                ears.hear(Instant::NEVER).len()
            };
            assert_eq!((heard(hardware), heard(software)), (by_hardware, by_software), "{what:?}");
        }
    }
}
