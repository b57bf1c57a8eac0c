//! The PC's UART: what a driver and a serial chip do, as a board of the rig.

use std::collections::VecDeque;
use std::ops::RangeInclusive;

use torno_protocol::board::{Board, Deadline, Description, Input, Output, Role, Signal, Stimulus, Wait};
use torno_protocol::clock::{Clock, Rate};
use torno_protocol::line::{Edge, Level};
use torno_protocol::time::Instant;
use torno_protocol::uart::{Character, Format, Receiver, Transmitter};

/// DC3, the software flow control's "stop" (ITU-T T.50).
const XOFF: u8 = 0x13;
/// DC1, its "go on".
const XON: u8 = 0x11;

/// What a program does when a byte has come.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// Nothing.
    Nothing,
    /// It sends these bytes, behind what is not sent yet.
    Send(Vec<u8>),
    /// It gives up what has not been sent yet.
    GiveUp,
}

/// A program behind the PC's UART that must be answered in virtual time.
pub trait Conversation: Clone {
    /// A byte has come. Says what the program does because of it, at once.
    fn hear(&mut self, byte: u8) -> Answer;

    /// Whether the next of the bytes that wait, the first of these, goes to the chip now. If it says so, it goes.
    fn lets_go(&mut self, _waiting: &VecDeque<u8>) -> bool {
        true
    }
}

/// No program: whoever is behind the UART is outside the rig.
#[derive(Clone, Copy, Debug)]
pub struct Outside;

impl Conversation for Outside {
    fn hear(&mut self, _: u8) -> Answer {
        Answer::Nothing
    }
}

/// What the PC's UART tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PcEvent {
    /// A byte has gone onto the line.
    Sent(u8),
    /// A byte has come.
    Received(u8),
    /// A character has come with an error; it is handed on as it is.
    Garbled(u8),
}

impl PcEvent {
    const TEXTS: [&str; 3] = ["sent {}", "received {}", "received with an error {}"];

    /// The event that the numbers of a [`Fact::Event`](torno_engine::Fact::Event) stand for.
    pub fn from_numbers(event: u8, value: i64) -> Option<Self> {
        let byte = u8::try_from(value).ok()?;
        match event {
            0 => Some(Self::Sent(byte)),
            1 => Some(Self::Received(byte)),
            2 => Some(Self::Garbled(byte)),
            _ => None,
        }
    }

    fn output(self) -> Output {
        let (event, byte) = match self {
            Self::Sent(byte) => (0, byte),
            Self::Received(byte) => (1, byte),
            Self::Garbled(byte) => (2, byte),
        };
        Output::Event { event, value: i64::from(byte) }
    }
}

/// The speeds that the chip can have, in baud. Beyond them it takes the nearest.
pub const BAUD: RangeInclusive<u32> = 50..=4_000_000;

/// The number of the event that a byte has come.
pub const RECEIVED: u8 = 1;

/// The number of the UART's one quantity: whether `XOFF` has stopped it.
pub const STOPPED: u8 = 0;

/// A serial chip with a transmit FIFO, and the driver that feeds it.
///
/// With `ixon` the driver stops feeding it on `XOFF` and goes on at `XON`; what the chip has already loaded still
/// goes out.
#[derive(Clone, Debug)]
pub struct PcUart<P = Outside> {
    clock: Clock,
    baud: u32,
    format: Format,
    ixon: bool,
    fifo: usize,
    /// What the driver has not yet given to the chip.
    queue: VecDeque<u8>,
    /// How much of the chip's FIFO is full.
    loaded: usize,
    transmitter: Transmitter,
    hold: Break,
    stopped: bool,
    retuned: bool,
    program: P,
    outputs: VecDeque<Output>,
}

/// A break: the line held low. It begins when the character on the line is over, and lasts two characters at least, so
/// that every receiver finds it.
#[derive(Clone, Copy, Debug, Default)]
struct Break {
    /// Whether the program has asked for one that has not begun yet.
    due: bool,
    /// Whether it has not asked for the end of the last one.
    wanted: bool,
    /// When the line may rise again, while it is held.
    least: Option<Instant>,
    /// After a break, the line is high for a character at least.
    over: Instant,
}

impl Break {
    const fn set(&mut self, wanted: bool) {
        self.due |= wanted;
        self.wanted = wanted;
    }

    /// Whether the line is not to be held for longer than it must.
    const fn ends(&self) -> bool {
        !self.wanted || self.due
    }
}

impl PcUart {
    /// A UART that is used from outside the rig, at `baud` with `fifo` characters between driver and line.
    pub fn new(baud: u32, fifo: usize, clock: Clock) -> Self {
        Self {
            clock,
            baud,
            format: Format::EIGHT_N_ONE,
            ixon: false,
            fifo,
            queue: VecDeque::new(),
            loaded: 0,
            transmitter: Transmitter::hardware(Rate::hz(baud), clock),
            hold: Break::default(),
            stopped: false,
            retuned: false,
            program: Outside,
            outputs: VecDeque::new(),
        }
    }

    /// With a program behind it that is held by `XON`/`XOFF`.
    pub fn with_program<P: Conversation>(self, program: P) -> PcUart<P> {
        let Self { clock, baud, format, fifo, queue, loaded, transmitter, hold, stopped, retuned, outputs, .. } = self;
        let ixon = true;
        PcUart { clock, baud, format, ixon, fifo, queue, loaded, transmitter, hold, stopped, retuned, program, outputs }
    }
}

impl<P: Conversation> PcUart<P> {
    fn receive(&mut self, character: Character) {
        let Some(byte) = character.ok() else {
            self.outputs.push_back(PcEvent::Garbled(character.byte).output());
            return;
        };
        self.outputs.push_back(PcEvent::Received(byte).output());
        if self.ixon && (byte == XOFF || byte == XON) {
            self.stop(byte == XOFF);
        }
        match self.program.hear(byte) {
            Answer::Nothing => {}
            Answer::Send(bytes) => self.queue.extend(bytes),
            Answer::GiveUp => self.queue.clear(),
        }
    }

    fn stop(&mut self, stopped: bool) {
        if self.stopped != stopped {
            self.stopped = stopped;
            self.outputs.push_back(Output::Telemetry { signal: STOPPED, value: i64::from(stopped) });
        }
    }

    fn configure(&mut self, baud: u32, ixon: bool) {
        if !ixon {
            self.stop(false);
        }
        self.ixon = ixon;
        // 0 hangs up; the cable has no line for that.
        let baud = if baud == 0 { self.baud } else { baud.clamp(*BAUD.start(), *BAUD.end()) };
        if baud != self.baud {
            self.baud = baud;
            self.retuned = true;
            self.transmitter.retune(Rate::hz(baud), self.clock);
        }
    }

    fn set_format(&mut self, format: Format) {
        if format != self.format {
            self.format = format;
            self.retuned = true;
            self.transmitter.set_format(format);
        }
    }

    fn receiver(&self) -> Receiver {
        Receiver::hardware(Rate::hz(self.baud), self.clock).with_format(self.format)
    }

    /// The supply goes or comes: what was to be sent is lost, and `XOFF` is forgotten.
    fn power(&mut self) {
        self.queue.clear();
        self.loaded = 0;
        self.transmitter = Transmitter::hardware(Rate::hz(self.baud), self.clock);
        self.transmitter.set_format(self.format);
        self.hold = Break::default();
        self.stop(false);
    }

    /// Begins and ends a break, as far as the program wants that and it can be. Says whether the line is held.
    fn holds(&mut self, now: Instant) -> bool {
        let level = match self.hold.least {
            None if self.hold.due && self.transmitter.free_at() <= now && self.hold.over <= now => {
                self.hold.due = false;
                self.hold.least = Some(now + self.transmitter.character_from(now).times(2));
                Level::Low
            }
            Some(least) if self.hold.ends() && least <= now => {
                self.hold.least = None;
                self.hold.over = now + self.transmitter.character_from(now);
                Level::High
            }
            held => return held.is_some() || self.hold.over > now,
        };
        self.outputs.push_back(Output::Character { port: 0, edges: vec![Edge { at: now, level }], end: now.next() });
        true
    }

    /// The driver feeds the chip, the chip its shift register.
    fn feed(&mut self, now: Instant) {
        loop {
            while !self.stopped
                && self.loaded < self.fifo
                && !self.queue.is_empty()
                && self.program.lets_go(&self.queue)
                && let Some(byte) = self.queue.pop_front()
            {
                self.transmitter.push(byte);
                self.loaded += 1;
            }
            if self.holds(now) {
                return;
            }
            let Some(loaded) = self.transmitter.load(now) else { return };
            self.loaded -= 1;
            self.outputs.push_back(PcEvent::Sent(loaded.byte).output());
            self.outputs.push_back(Output::Character { port: 0, edges: loaded.edges, end: loaded.end });
        }
    }
}

impl<P: Conversation> Board for PcUart<P> {
    fn description(&self) -> Description {
        Description {
            ports: vec!["cable".to_owned()],
            signals: vec![Signal::new("stopped", 0).with_role(Role::State)],
            events: PcEvent::TEXTS.map(str::to_owned).to_vec(),
            waits: vec![Wait { signal: STOPPED, ports: vec![0] }],
            capabilities: Vec::new(),
            motors: Vec::new(),
            pins: Vec::new(),
        }
    }

    fn receivers(&self) -> Vec<Receiver> {
        vec![self.receiver()]
    }

    fn handle_input(&mut self, now: Instant, input: Input) {
        match input {
            Input::Character { character, .. } => self.receive(character),
            Input::Stimulus(Stimulus::Write(bytes)) => self.queue.extend(bytes),
            Input::Stimulus(Stimulus::Discard) => self.queue.clear(),
            Input::Stimulus(Stimulus::Configure { baud, ixon }) => self.configure(baud, ixon),
            Input::Stimulus(Stimulus::Format(format)) => self.set_format(format),
            Input::Stimulus(Stimulus::Break(wanted)) => self.hold.set(wanted),
            Input::Stimulus(Stimulus::Power(_)) => self.power(),
            Input::Stimulus(Stimulus::Clock(clock)) => {
                self.clock = clock;
                self.transmitter.retune(Rate::hz(self.baud), clock);
            }
            Input::Stimulus(_) => {}
        }
        self.feed(now);
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.feed(now);
    }

    fn poll_output(&mut self) -> Option<Output> {
        self.outputs.pop_front()
    }

    fn poll_receiver(&mut self) -> Option<(u8, Receiver)> {
        core::mem::take(&mut self.retuned).then(|| (0, self.receiver()))
    }

    fn poll_timeout(&self) -> Option<Deadline> {
        let over = |at: Instant| at.max(self.hold.over);
        let (at, why) = match self.hold.least {
            Some(least) => (self.hold.ends().then_some(least), "the end of a break"),
            None if self.hold.due => (Some(over(self.transmitter.free_at())), "a break"),
            None => (self.transmitter.poll_timeout().map(over), "the next character"),
        };
        at.map(|at| Deadline { at, why })
    }
}

#[cfg(test)]
mod tests {
    use torno_protocol::record::Heard;
    use torno_protocol::stepping::Cell;
    use torno_protocol::time::Span;

    use super::*;

    fn ms(ms: u64) -> Instant {
        Instant::START + Span::from_millis(ms)
    }

    /// Gives up on the letter `q`.
    #[derive(Clone)]
    struct Quitter;

    impl Conversation for Quitter {
        fn hear(&mut self, byte: u8) -> Answer {
            match byte {
                b'q' => Answer::GiveUp,
                b'?' => Answer::Send(vec![0xaa, 0xbb]),
                _ => Answer::Nothing,
            }
        }
    }

    /// The bytes that go out before `until`, with `reply` starting at 5 ms.
    fn sent(uart: PcUart<impl Conversation>, reply: &[u8], until: Instant) -> Vec<u8> {
        let mut cell = Cell::new(uart);
        cell.hear(&Heard::Stimulus { at: ms(1), stimulus: Stimulus::Write((0..32).collect()) });
        let mut master = Transmitter::hardware(Rate::hz(9600), Clock::TRUE);
        for byte in reply {
            master.push(*byte);
            let edges = master.load(ms(5).max(master.free_at())).unwrap().edges;
            cell.hear(&Heard::Edges { port: 0, edges });
        }
        let mut sent = Vec::new();
        cell.run(until, |_, output| {
            if let Output::Event { event, value } = output
                && let Some(PcEvent::Sent(byte)) = PcEvent::from_numbers(event, value)
            {
                sent.push(byte);
            }
        });
        sent
    }

    fn uart(fifo: usize) -> PcUart {
        PcUart::new(9600, fifo, Clock::TRUE)
    }

    fn held(fifo: usize) -> PcUart<Quitter> {
        uart(fifo).with_program(Quitter)
    }

    #[test]
    fn bytes_leave_at_the_baud_rate() {
        assert_eq!(sent(uart(1), &[], ms(1) + Span::from_nanos(10_416_671)).len(), 11);
        assert_eq!(sent(uart(1), &[], ms(100)).len(), 32);
    }

    #[test]
    fn xoff_stops_all_but_what_is_loaded() {
        // XOFF is understood 5.99 ms after the start: five characters are out or on the line.
        assert_eq!(sent(held(1), &[XOFF], ms(1000)), [0, 1, 2, 3, 4, 5]);
        assert_eq!(sent(held(16), &[XOFF], ms(1000)).len(), 21);
        assert_eq!(sent(uart(1), &[XOFF], ms(1000)).len(), 32);
    }

    #[test]
    fn xon_goes_on_without_a_loss() {
        assert_eq!(sent(held(1), &[XOFF, XON], ms(1000)), (0..32).collect::<Vec<u8>>());
    }

    #[test]
    fn a_program_can_give_up() {
        assert!(sent(held(1), b"q", ms(1000)).len() < 12);
    }

    #[test]
    fn a_program_can_answer_bytes_with_bytes() {
        let answered = sent(held(1), b"q??", ms(1000));
        assert_eq!(answered[answered.len() - 4..], [0xaa, 0xbb, 0xaa, 0xbb]);
    }

    #[test]
    fn another_speed_holds_from_the_next_character() {
        let mut cell = Cell::new(uart(1));
        cell.hear(&Heard::Stimulus { at: ms(1), stimulus: Stimulus::Write(vec![0; 2]) });
        cell.hear(&Heard::Stimulus { at: ms(1).next(), stimulus: Stimulus::Configure { baud: 4800, ixon: false } });
        let mut ends = Vec::new();
        cell.run(ms(100), |at, output| {
            if let Output::Character { end, .. } = output {
                ends.push(end.since(at).as_nanos());
            }
        });
        assert_eq!(ends, [1_041_667, 2_083_333]);
    }

    /// What a receiver without parity hears of a UART that is given these stimuli.
    fn heard(stimuli: &[(Instant, Stimulus)]) -> Vec<Character> {
        let mut cell = Cell::new(uart(1));
        stimuli.iter().for_each(|(at, stimulus)| cell.hear(&Heard::Stimulus { at: *at, stimulus: stimulus.clone() }));
        let mut receiver = Receiver::hardware(Rate::hz(9600), Clock::TRUE);
        let mut heard = Vec::new();
        cell.run(ms(1000), |at, output| {
            while receiver.poll_timeout().is_some_and(|due| due < at) {
                heard.extend(receiver.take(at));
            }
            match output {
                Output::Character { edges, .. } => receiver.hear(&edges),
                Output::Cut { .. } => receiver.hear_cut(at),
                Output::Telemetry { .. } | Output::Event { .. } | Output::Pin { .. } => {}
            }
        });
        heard.extend(core::iter::from_fn(|| receiver.poll_timeout().and_then(|at| receiver.take(at))));
        heard
    }

    const BREAK: Character = Character { byte: 0, framing_error: true, overrun: false };

    #[test]
    fn a_break_is_one_framing_error_and_harms_nothing_before_and_after_it() {
        let good = |bytes: &[u8]| bytes.iter().map(|byte| Character::good(*byte)).collect::<Vec<_>>();
        let write = |at, bytes: &[u8]| (at, Stimulus::Write(bytes.to_vec()));
        let hold = |at, on| (at, Stimulus::Break(on));
        // In the middle of a character, and written meanwhile.
        let long = [write(ms(1), b"a"), hold(ms(1).next(), true), write(ms(3), b"bc"), hold(ms(250), false)];
        let expected = [good(b"a"), vec![BREAK], good(b"bc")].concat();
        assert_eq!(heard(&long), expected);
        // Over before it can begin, and two in a row.
        let short = [write(ms(1), b"a"), hold(ms(1).next(), true), hold(ms(1).next().next(), false)];
        assert_eq!(heard(&short), [good(b"a"), vec![BREAK]].concat());
        let twice = [hold(ms(1), true), hold(ms(1), false), hold(ms(8), true), hold(ms(8), false), write(ms(8), b"b")];
        assert_eq!(heard(&twice), [vec![BREAK; 2], good(b"b")].concat());
    }

    #[test]
    fn a_break_ends_with_the_supply() {
        let power = |at, on| (at, Stimulus::Power(on));
        let hold = |at, on| (at, Stimulus::Break(on));
        let late = (ms(40), Stimulus::Write(b"a".to_vec()));
        let stimuli = [hold(ms(1), true), power(ms(10), false), hold(ms(11), true), power(ms(20), true), late];
        let heard = heard(&stimuli);
        assert_eq!(heard.last(), Some(&Character::good(b'a')), "{heard:?}");
    }

    #[test]
    fn another_format_holds_both_ways() {
        use torno_protocol::uart::Parity;
        let even = Stimulus::Format(Format { parity: Parity::Even, ..Format::EIGHT_N_ONE });
        let heard = heard(&[(ms(1), even.clone()), (ms(2), Stimulus::Write(vec![0x06, 0x07]))]);
        assert_eq!(heard, [Character { framing_error: true, ..Character::good(0x06) }, Character::good(0x07)]);
        // Two that follow each other without a gap: the second's start bit is where a stop bit is wanted.
        let mut cell = Cell::new(uart(1));
        cell.hear(&Heard::Stimulus { at: ms(1), stimulus: even });
        let mut master = Transmitter::hardware(Rate::hz(9600), Clock::TRUE);
        for byte in [0xff, 0xff] {
            master.push(byte);
            let edges = master.load(ms(5).max(master.free_at())).unwrap().edges;
            cell.hear(&Heard::Edges { port: 0, edges });
        }
        let mut events = Vec::new();
        cell.run(ms(100), |_, output| {
            if let Output::Event { event, value } = output {
                events.extend(PcEvent::from_numbers(event, value));
            }
        });
        assert_eq!(events[0], PcEvent::Garbled(0xff));
    }

    /// How long each of three characters that are written at 1 ms takes, in ns.
    fn characters(stimuli: &[(Instant, Stimulus)]) -> Vec<u64> {
        let mut cell = Cell::new(uart(1));
        cell.hear(&Heard::Stimulus { at: ms(1), stimulus: Stimulus::Write(vec![0; 3]) });
        for (at, stimulus) in stimuli {
            cell.hear(&Heard::Stimulus { at: *at, stimulus: stimulus.clone() });
        }
        let mut lengths = Vec::new();
        cell.run(ms(100), |at, output| {
            if let Output::Character { end, .. } = output {
                lengths.push(end.since(at).as_nanos());
            }
        });
        lengths
    }

    #[test]
    fn another_oscillator_holds_from_the_next_character() {
        let fast = Stimulus::Clock(Clock::from_ppb(100_000_000).unwrap());
        assert_eq!(characters(&[(ms(1).next(), fast)]), [1_041_667, 946_970, 946_970]);
    }

    #[test]
    fn without_supply_what_was_to_be_sent_is_lost() {
        let power = |at, on| (at, Stimulus::Power(on));
        let late = (ms(3), Stimulus::Write(vec![0; 5]));
        assert_eq!(characters(&[power(ms(1).next(), false), late, power(ms(4), true)]).len(), 1);
        let again = (ms(5), Stimulus::Write(vec![0; 5]));
        assert_eq!(characters(&[power(ms(1).next(), false), power(ms(4), true), again]).len(), 6);
    }
}
