//! What tests of a whole run share: a play in processes, and a reader of waveform dumps of their own.

use std::collections::BTreeMap;

use torno::fault::{self, Planned};
use torno::play::{Play, Played};
use torno::rig::Driver;
use torno::rig::file::RigFile;
use torno_protocol::lathe::Program;
use torno_protocol::time::{Instant, Span};
use torno_trace::Timescale;

pub(crate) const ENQ: u8 = 0x05;
pub(crate) const BEL: u8 = 0x07;
pub(crate) const CAN: u8 = 0x18;

/// The lines of the rig: the PC's, then the slaves', each with the bytes of a frame that its slave gets.
pub(crate) const PC_LINES: [&str; 2] = ["pc_to_master", "master_to_pc"];
pub(crate) const SLAVE_LINES: [(&str, &str, std::ops::Range<usize>); 3] = [
    ("master_to_spindle", "spindle_to_master", 0..1),
    ("master_to_transverse", "transverse_to_master", 1..5),
    ("master_to_depth", "depth_to_master", 5..8),
];

pub(crate) const BAUD: u64 = 9600;
pub(crate) const SECOND: u64 = 1_000_000_000;
/// A character of ten bits, in nanoseconds.
pub(crate) const CHARACTER: u64 = 10 * SECOND / BAUD;

pub(crate) fn processes() -> Driver {
    Driver::Processes { exe: env!("CARGO_BIN_EXE_torno").into() }
}

pub(crate) fn block_on<T>(future: impl Future<Output = T>) -> T {
    tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap().block_on(future)
}

pub(crate) fn seconds(seconds: f64) -> Instant {
    Instant::from_nanos((seconds * SECOND as f64) as u64)
}

/// What the lathe plays where no program is named.
pub(crate) const DEMONSTRATION: &str = include_str!("../../harness/builtin/shaft.frames");

pub(crate) fn demonstration() -> Program {
    Program::parse(DEMONSTRATION).unwrap()
}

/// The faults of a file.
pub(crate) fn planned(file: &RigFile, text: &str) -> Vec<Planned> {
    fault::parse("faults.toml", text, &file.names(), None).unwrap().faults
}

/// Plays frames in processes while this breaks, with all waveforms.
pub(crate) fn play(frames: &[[u8; 8]], faults: &str) -> Played {
    let file = RigFile::load("lathe").unwrap();
    let faults = planned(&file, faults);
    let program = Program { frames: frames.to_vec() };
    let play = Play { faults, waveforms: true, ..Play::new(file, program, processes()) };
    block_on(play.run(|_| ())).unwrap()
}

/// A waveform dump, read by these tests' own means: for each wire its changes.
pub(crate) struct Dump {
    pub(crate) wires: BTreeMap<String, Vec<(u64, bool)>>,
    pub(crate) end: u64,
}

/// A decoded character: the instant of its start bit, and its byte.
pub(crate) type Heard = (u64, u8);

impl Dump {
    pub(crate) fn read(text: &str) -> Self {
        let (head, body) = text.split_once("$enddefinitions $end").unwrap();
        assert!(head.contains("$timescale 1 ns $end"), "{head}");
        let mut names = BTreeMap::new();
        for declaration in head.split("$var ").skip(1) {
            let words: Vec<&str> = declaration.split_whitespace().collect();
            assert_eq!((words[0], words[1], words[4]), ("wire", "1", "$end"), "{declaration}");
            names.insert(words[2], words[3].to_owned());
        }
        let mut wires: BTreeMap<String, Vec<(u64, bool)>> = names.values().map(|name| (name.clone(), vec![])).collect();
        let mut now = None;
        for word in body.split_whitespace().filter(|word| !word.starts_with('$')) {
            if let Some(time) = word.strip_prefix('#') {
                let time = time.parse::<u64>().unwrap();
                assert!(now.is_none_or(|now| now < time), "time must go on at {time}");
                now = Some(time);
            } else {
                let (level, id) = word.split_at(1);
                let level = match level {
                    "0" => false,
                    "1" => true,
                    _ => panic!("no level: {word}"),
                };
                wires.get_mut(&names[id]).unwrap().push((now.unwrap(), level));
            }
        }
        Self { wires, end: now.unwrap() }
    }

    pub(crate) fn of(played: &Played) -> Self {
        let mut bytes = Vec::new();
        played
            .waveforms
            .as_ref()
            .unwrap()
            .write(&mut bytes, played.end, Span::from_millis(2), Timescale::NANOSECOND)
            .unwrap();
        Self::read(std::str::from_utf8(&bytes).unwrap())
    }

    /// The level of a wire at an instant.
    pub(crate) fn level(&self, wire: &str, at: u64) -> bool {
        let changes = &self.wires[wire];
        changes[changes.partition_point(|(time, _)| *time <= at) - 1].1
    }

    /// The characters on a wire: each bit is sampled once, in its middle.
    pub(crate) fn characters(&self, wire: &str) -> Vec<Heard> {
        let bit = |start: u64, n: u64| self.level(wire, start + (2 * n + 1) * SECOND / (2 * BAUD));
        let mut characters: Vec<Heard> = Vec::new();
        let mut free = 0;
        for (start, _) in self.wires[wire].iter().filter(|(_, level)| !*level) {
            if *start < free {
                continue;
            }
            assert!(!bit(*start, 0) && bit(*start, 9), "{wire}: no start or no stop bit at {start}");
            characters.push((*start, (0..8).map(|n| u8::from(bit(*start, n + 1)) << n).sum()));
            // In the middle of the stop bit a decoder begins to look for the next start bit.
            free = start + 19 * SECOND / (2 * BAUD);
        }
        characters
    }

    pub(crate) fn bytes(&self, wire: &str) -> Vec<u8> {
        self.characters(wire).iter().map(|(_, byte)| *byte).collect()
    }

    /// The characters on a wire, put together as they follow one another without a gap.
    pub(crate) fn bursts(&self, wire: &str) -> Vec<(u64, Vec<u8>)> {
        let mut bursts: Vec<(u64, Vec<u8>)> = Vec::new();
        let mut last = 0;
        for (start, byte) in self.characters(wire) {
            match bursts.last_mut() {
                Some((_, bytes)) if start < last + 2 * CHARACTER => bytes.push(byte),
                _ => bursts.push((start, vec![byte])),
            }
            last = start;
        }
        bursts
    }

    /// When the PC begins to read this reply for the first time.
    pub(crate) fn replied_at(&self, byte: u8) -> u64 {
        self.characters("master_to_pc").iter().find(|(_, found)| *found == byte).unwrap().0
    }
}
