//! The board with somebody at its port, who sends the next line when the one before is answered.

// Not every test uses all of it.
#![allow(dead_code)]

use std::collections::VecDeque;

use torno_engraver::{Engraver, EngraverSettings, engraver};
use torno_protocol::board::{Board, Input, MotorStimulus, Output, PinOutput};
use torno_protocol::clock::Clock;
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::Character;

/// A byte at 115 200 baud.
const CHARACTER: Span = Span::from_nanos(86_806);

pub(crate) struct Bench {
    board: Engraver,
    pub(crate) now: Instant,
    heard: String,
    /// What the board's quantities are.
    pub(crate) values: Vec<i64>,
    /// Everything that it did, but characters.
    pub(crate) outputs: Vec<(Instant, Output)>,
    /// What is going to happen.
    pub(crate) stimuli: VecDeque<(Instant, u8, MotorStimulus)>,
    /// Lines that came by themselves.
    pub(crate) lines: Vec<String>,
    pub(crate) deadlines: u64,
    /// Where the carriages of X and Y are, mm, so often.
    pub(crate) every: Option<(Span, Vec<[f64; 2]>)>,
}

impl Bench {
    /// One with settings as in a rig file (TOML), past its banner. Its rotors are in closed form.
    pub(crate) fn new(settings: &str) -> Self {
        Self::with_rotor(settings, 0.0)
    }

    /// The same with rotors that swing at so many Hz.
    pub(crate) fn with_rotor(settings: &str, rotor_hz: f64) -> Self {
        let mut settings: EngraverSettings = toml::from_str(settings).unwrap();
        settings.motor.rotor_hz = rotor_hz;
        settings.check().unwrap();
        let mut bench = Self {
            board: engraver(&settings, Clock::TRUE),
            now: Instant::START,
            heard: String::new(),
            values: vec![0; 64],
            outputs: Vec::new(),
            stimuli: VecDeque::new(),
            lines: Vec::new(),
            deadlines: 0,
            every: None,
        };
        bench.run_to(Instant::START + Span::from_millis(400));
        assert!(bench.heard.contains("Grbl 1.1h"), "{}", bench.heard);
        bench.heard.clear();
        bench
    }

    /// Sends a line, waits for its answer, and gives all that was said.
    pub(crate) fn line(&mut self, line: &str) -> Vec<String> {
        self.send(&format!("{line}\n"));
        self.wait_for(|heard| heard.contains("ok\r\n") || heard.contains("error:") || heard.contains("ALARM:"))
    }

    pub(crate) fn send(&mut self, bytes: &str) {
        for byte in bytes.chars() {
            self.run_to(self.now + CHARACTER);
            let character = Character::good(u8::try_from(u32::from(byte)).unwrap());
            self.board.handle_input(self.now, Input::Character { port: 0, character });
            self.drain();
        }
    }

    /// Runs until what has been heard is as wanted; gives its lines.
    pub(crate) fn wait_for(&mut self, wanted: impl Fn(&str) -> bool) -> Vec<String> {
        let end = self.now + Span::from_secs(10_000);
        while !(wanted(&self.heard) && self.heard.ends_with('\n')) {
            let next = self.next().expect("nothing more happens");
            assert!(next < end, "heard: {}", self.heard);
            self.run_to(next.next());
        }
        let heard = core::mem::take(&mut self.heard);
        heard.lines().map(str::to_owned).filter(|line| !line.is_empty()).collect()
    }

    /// Sends bytes, and gives what was said until nothing more happens.
    pub(crate) fn says(&mut self, bytes: &[u8]) -> Vec<String> {
        for byte in bytes {
            self.run_to(self.now + CHARACTER);
            self.board.handle_input(self.now, Input::Character { port: 0, character: Character::good(*byte) });
            self.drain();
        }
        while let Some(next) = self.next() {
            self.run_to(next.next());
        }
        let heard = core::mem::take(&mut self.heard);
        heard.lines().map(str::to_owned).collect()
    }

    /// The status.
    pub(crate) fn status(&mut self) -> String {
        self.send("?");
        self.wait_for(|heard| heard.contains('>')).concat()
    }

    /// Waits until it is idle, or has stopped for good.
    pub(crate) fn rest(&mut self) -> String {
        loop {
            let status = self.status();
            if !["<Run", "<Jog", "<Home"].iter().any(|busy| status.contains(busy)) {
                return status;
            }
            self.run_to(self.now + Span::from_millis(20));
        }
    }

    /// Where a carriage is, in mm from where it was at the start: to be asked at rest.
    pub(crate) fn carriage(&self, axis: usize) -> f64 {
        self.values[2 + 5 * axis] as f64 / 1e6
    }

    /// How far the carriage of an axis was off while the program moved it, mm.
    pub(crate) fn worst(&self, axis: usize) -> f64 {
        self.board.controller().machine().axis(axis).unwrap().stats(self.now).worst_pm.abs() as f64 / 1e9
    }

    pub(crate) fn corrections(&self, axis: usize) -> i64 {
        self.values[3 + 5 * axis]
    }

    /// The pulses on a step pin, with their sense.
    pub(crate) fn pulses(&self, axis: u8) -> i64 {
        let (mut sum, mut sense, mut last) = (0, 1, None::<torno_protocol::train::Train>);
        for (at, output) in &self.outputs {
            match output {
                Output::Pin { pin, what: PinOutput::Pulses(train) } if *pin == 2 * axis => {
                    sum += last.replace(*train).map_or(0, |last| sense * last.begun(*at).cast_signed());
                }
                Output::Pin { pin, what: PinOutput::Level(level) } if *pin == 2 * axis + 1 => {
                    sum += last.take().map_or(0, |last| sense * last.begun(*at).cast_signed());
                    sense = if *level == torno_protocol::line::Level::Low { 1 } else { -1 };
                }
                _ => {}
            }
        }
        sum + last.map_or(0, |last| sense * last.begun(self.now).cast_signed())
    }

    fn next(&self) -> Option<Instant> {
        let due = self.board.poll_timeout().map(|deadline| deadline.at);
        due.into_iter().chain(self.stimuli.front().map(|(at, ..)| *at)).min()
    }

    pub(crate) fn run_to(&mut self, until: Instant) {
        while let Some(at) = self.next().filter(|at| *at < until) {
            self.sample(at);
            self.now = at.max(self.now);
            match self.stimuli.front() {
                Some((due, motor, what)) if *due <= at => {
                    let stimulus = what.of(*motor);
                    self.stimuli.pop_front();
                    self.board.handle_input(self.now, Input::Stimulus(stimulus));
                }
                _ => {
                    self.deadlines += 1;
                    self.board.handle_timeout(self.now);
                }
            }
            self.drain();
        }
        self.sample(until);
        self.now = until;
    }

    /// Looks at the carriages until then.
    fn sample(&mut self, until: Instant) {
        let Some((every, places)) = &mut self.every else { return };
        let mut at = self.now;
        while at < until {
            let at_mm = |axis| self.board.controller().machine().axis(axis).unwrap().carriage(at) as f64 / 1e9;
            places.push([at_mm(0), at_mm(1)]);
            at += *every;
        }
    }

    fn drain(&mut self) {
        while let Some(output) = self.board.poll_output() {
            match output {
                Output::Character { ref edges, .. } => {
                    // Ten bits, the start bit first; the line is idle high.
                    let start = edges[0].at;
                    let bit = |n: u64| {
                        let at = start + Span::from_nanos(CHARACTER.as_nanos() * (2 * n + 1) / 20);
                        let before = edges.iter().take_while(|edge| edge.at <= at).count();
                        u8::from(edges[before - 1].level == torno_protocol::line::Level::High)
                    };
                    self.heard.push(char::from((0..8).map(|n| bit(n + 1) << n).sum::<u8>()));
                }
                Output::Telemetry { signal, value } => self.values[usize::from(signal)] = value,
                Output::Cut { .. } => {}
                output => self.outputs.push((self.now, output)),
            }
        }
    }
}
