//! The board with a PC at its port, and nothing at the machine's.

#![allow(clippy::unwrap_used, reason = "part of tests")]

use torno_grbl_board::{Grbl, GrblSettings};
use torno_protocol::board::{Board as _, Kept, Output, Stimulus};
use torno_protocol::clock::{Clock, Rate};
use torno_protocol::record::Heard;
use torno_protocol::stepping::Cell;
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::{Character, Receiver, Transmitter};

const RATE: Rate = Rate::hz(115_200);

struct Bench {
    cell: Cell<Grbl>,
    now: Instant,
    pc: Transmitter,
    line: Receiver,
    said: Vec<u8>,
    /// The events: number and value.
    events: Vec<(u8, i64)>,
}

impl Bench {
    /// One that has said who it is.
    fn new(settings: &GrblSettings) -> Self {
        let mut bench = Self {
            cell: Cell::new(Grbl::new(settings, Clock::TRUE)),
            now: Instant::START,
            pc: Transmitter::hardware(RATE, Clock::TRUE),
            line: Receiver::hardware(RATE, Clock::TRUE),
            said: Vec::new(),
            events: Vec::new(),
        };
        bench.starts();
        bench
    }

    fn starts(&mut self) {
        assert_eq!(self.hears(Span::from_millis(400)), ["", "Grbl 1.1h ['$' for help]"]);
    }

    /// What it says to a line.
    fn says(&mut self, line: &str) -> Vec<String> {
        self.send(format!("{line}\n").as_bytes());
        self.hears(Span::from_millis(200))
    }

    fn send(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.pc.push(*byte);
            let loaded = self.pc.load(self.now.max(self.pc.free_at())).unwrap();
            self.cell.hear(&Heard::Edges { port: 0, edges: loaded.edges });
            self.run_to(loaded.end);
        }
    }

    fn hears(&mut self, time: Span) -> Vec<String> {
        self.run_to(self.now + time);
        let text = String::from_utf8(core::mem::take(&mut self.said)).unwrap();
        text.split_terminator("\r\n").map(str::to_owned).collect()
    }

    fn run_to(&mut self, until: Instant) {
        let Self { cell, line, said, events, .. } = self;
        cell.run(until, |_, output| match &output {
            Output::Character { port: 0, edges, .. } => {
                line.hear(edges);
                while let Some(at) = line.poll_timeout() {
                    said.extend(line.take(at).and_then(Character::ok));
                }
            }
            Output::Event { event, value } => events.push((*event, *value)),
            _ => {}
        });
        self.now = until;
    }

    fn stimulus(&mut self, stimulus: Stimulus) {
        self.cell.hear(&Heard::Stimulus { at: self.now, stimulus });
        self.run_to(self.now + Span::from_micros(1));
    }
}

/// The settings of a rig file.
fn settings(toml: &str) -> GrblSettings {
    let settings: GrblSettings = toml::from_str(toml).unwrap();
    settings.check().unwrap();
    settings
}

#[test]
fn the_eeprom_outlives_a_reset_and_the_power() {
    let stored = ["$110=12.5", "$N0=G18", "$I=bench", "G10L2P2X1.5", "G28.1"];
    let kept = |bench: &mut Bench| {
        assert!(bench.says("$$").contains(&"$110=12.500".to_owned()));
        assert_eq!(bench.says("$N")[0], "$N0=G18");
        assert_eq!(bench.says("$I")[0], "[VER:1.1h.20190830:BENCH]");
        assert_eq!(bench.says("$#")[1], "[G55:1.500,0.000,0.000]");
    };
    let mut bench = Bench::new(&GrblSettings::default());
    for line in stored {
        assert_eq!(bench.says(line), ["ok"], "{line}");
    }
    kept(&mut bench);
    for stimulus in [vec![Stimulus::Reset], vec![Stimulus::Power(false), Stimulus::Power(true)]] {
        stimulus.into_iter().for_each(|stimulus| bench.stimulus(stimulus));
        let banner = ["", "Grbl 1.1h ['$' for help]", ">G18:ok"];
        assert_eq!(bench.hears(Span::from_millis(400)), banner);
        kept(&mut bench);
    }
}

#[test]
fn the_eeprom_begins_with_what_the_rig_file_says() {
    let mut bench = Bench::new(&settings(r#"eeprom = ["$110=12.5", "[G54:1,0,-2]", "$10=3"]"#));
    assert!(bench.says("$$").contains(&"$110=12.500".to_owned()));
    assert!(bench.says("$$").contains(&"$112=1000.000".to_owned()), "what it does not say is as the machine makes it");
    assert_eq!(bench.says("$#")[0], "[G54:1.000,0.000,-2.000]");
    let restored = bench.says("$RST=*");
    assert_eq!(restored[..2], ["[MSG:Restoring defaults]", "ok"]);
    assert!(bench.says("$$").contains(&"$110=16.000".to_owned()), "the defaults are the machine's");
}

#[test]
fn what_the_eeprom_holds_is_told_as_the_setting_of_another_board() {
    let mut bench = Bench::new(&settings(r#"eeprom = ["$110=12.5", "$10=3"]"#));
    for line in ["$10=1", "$I=BENCH", "G10L2P2X1.5Z-0.0625"] {
        assert_eq!(bench.says(line), ["ok"], "{line}");
    }
    let Kept { setting, lines } = bench.cell.board().kept().unwrap();
    assert_eq!(lines, ["$110=12.5", "$I=BENCH", "[G55:1.5,0,-0.0625]"]);
    let mut other = Bench::new(&settings(&format!("{setting} = {lines:?}")));
    assert_eq!(other.says("$#")[1], "[G55:1.500,0.000,-0.063]");
    assert_eq!(other.cell.board().kept().unwrap().lines, lines);
}

#[test]
fn an_eeprom_that_cannot_be_is_told() {
    let wrong = |line: &str| toml::from_str::<GrblSettings>(line).unwrap().check().unwrap_err().to_string();
    assert_eq!(
        wrong(r#"eeprom = ["$110=12.5", "$103=1"]"#),
        "eeprom: '$103=1': expected a setting that the controller has (error:3)"
    );
    assert!(wrong(r#"eeprom = ["G0X1"]"#).starts_with("eeprom: 'G0X1' is nothing that is kept: expected a line like"));
}

#[test]
fn the_room_in_the_buffers_is_that_of_the_rig_file() {
    for blocks in [1, 15, 1000] {
        let mut bench = Bench::new(&settings(&format!(r#"blocks = {blocks}{}eeprom = ["$10=2"]"#, '\n')));
        assert!(bench.says("$I")[1].starts_with(&format!("[OPT:V,{blocks},128")), "{blocks}");
        let status = |bench: &mut Bench| bench.says("?").into_iter().find(|line| line.starts_with('<')).unwrap();
        // The line end after the status is in the buffer no more.
        assert!(status(&mut bench).contains(&format!("|Bf:{blocks},128|")), "{blocks}");
        // Nothing is at the machine's port, so that a motion takes its time.
        bench.says("G1Z-1F100");
        assert!(status(&mut bench).contains(&format!("|Bf:{},128|", blocks - 1)), "{blocks}");
    }
}

#[test]
fn while_a_dwell_holds_it_up_it_takes_128_bytes_and_tells_of_the_129th() {
    let mut bench = Bench::new(&GrblSettings::default());
    bench.send(b"G4P2\n");
    bench.send(&[b'\n'; 128]);
    assert_eq!((bench.said.len(), bench.events.len()), (0, 0));
    bench.send(b"\r");
    assert_eq!(bench.events, [(0, i64::from(b'\r'))]);
    assert_eq!(bench.cell.board().description().events[0], "the receive buffer is full: {} is lost");
    assert_eq!(bench.hears(Span::from_secs(3)), ["ok"; 1 + 128]);
}
