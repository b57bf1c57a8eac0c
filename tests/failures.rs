//! Boards, wires and motors that fail while a whole program runs.

use std::collections::BTreeSet;
use std::io::Write;

use crate::common::play::*;
use crate::common::{ACK, NAK, XOFF, XON, folder, json, output};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use torno::job::Outcome;
use torno::play::Played;
use torno::rig::file::RigFile;
use torno::rig::{Driver, Rig};
use torno_bus::{PcEvent, PcUart};
use torno_engine::{Fact, Limit};
use torno_protocol::board::Stimulus;
use torno_protocol::lathe::{Fault, Slave};
use torno_protocol::time::{Instant, Span};

// --- faults on the way ----------------------------------------------------------------------------------------------

const TURNING: [u8; 8] = [0x4b, 0, 0, 0, 0, 0, 0, 0];
/// Feed 9000 counts at 10 counts per 30 ms: 27 s.
const FEED: [u8; 8] = [0x4b, 0x0a, 0x23, 0x28, 0x00, 0, 0, 0];
/// Depth 400 slots out: four and a half minutes.
const INFEED: [u8; 8] = [0x4b, 0, 0, 0, 0, 0x01, 0x90, 0];

/// A board fails in motion, with a frame held and more to come. Checks what follows, and gives the final telemetry.
fn fails(motion: [u8; 8], broken: &str, at: f64, slave: Slave, fault: Fault) -> Played {
    let played = play(&[TURNING, motion, FEED, INFEED, FEED], broken);
    assert_eq!(played.outcome, Outcome::Faulted);
    assert_eq!(played.job.tally.failures, [(slave.into(), fault)]);

    let dump = Dump::of(&played);
    let can = [CAN, slave.letter(), fault.letter()];
    let replies = [&[ACK, XOFF, XON, ACK, XOFF][..], &can, &[XON]].concat();
    assert_eq!(dump.bytes("master_to_pc"), replies);
    let broken = (at * SECOND as f64) as u64;
    let told = dump.replied_at(CAN);
    assert!(broken < told && told + 3 * CHARACTER < broken + 3 * SECOND, "at {at} s, told at {told} ns");

    // The two frames before the fault went out, and no later one.
    for (wire, _, part) in SLAVE_LINES {
        let parts: Vec<_> = dump.bursts(wire).into_iter().filter(|(_, burst)| *burst != [ENQ]).collect();
        let expected = [TURNING, motion].map(|frame| frame[part.clone()].to_vec());
        assert_eq!(parts.iter().map(|(_, part)| part.clone()).collect::<Vec<_>>(), expected, "{wire}");
    }
    assert_eq!(telemetry(&played, "master", "frames_distributed"), 2);
    assert_eq!(telemetry(&played, "master", "slaves_busy"), 0);
    assert_eq!(telemetry(&played, "master", "frame_held"), 0);
    played
}

fn telemetry(played: &Played, board: &str, quantity: &str) -> i64 {
    played.boards.iter().find(|other| other.name == board).unwrap().telemetry[quantity]
}

fn cut(line: &str, at: f64) -> String {
    format!("[[fault]]\nline = \"{line}\"\nkind = \"cut\"\nat = \"{at} s\"\n")
}

fn board_fault(board: &str, kind: &str, at: f64) -> String {
    format!("[[fault]]\nboard = \"{board}\"\nkind = \"{kind}\"\nat = \"{at} s\"\n")
}

#[test]
fn a_slave_whose_answers_are_cut_off_in_motion_is_reported_within_three_seconds() {
    for at in [7.0, 20.5] {
        let played = fails(INFEED, &cut("depth_to_master", at), at, Slave::Depth, Fault::NoAnswer);
        // No one told the axis to stop: it does what it was told, and no more.
        assert_eq!(telemetry(&played, "depth", "position_counts"), 400);
        assert_eq!(telemetry(&played, "transverse", "position_counts"), 0);
    }
    fails(FEED, &cut("transverse_to_master", 12.345), 12.345, Slave::Transverse, Fault::NoAnswer);
}

#[test]
fn a_slave_that_is_cut_off_from_its_master_in_motion_is_reported_within_three_seconds() {
    for at in [5.0, 12.3] {
        let played = fails(FEED, &cut("master_to_transverse", at), at, Slave::Transverse, Fault::NoAnswer);
        assert_eq!(telemetry(&played, "transverse", "position_counts"), 9000);
        assert_eq!(telemetry(&played, "depth", "position_counts"), 0);
    }
    fails(INFEED, &cut("master_to_depth", 6.0), 6.0, Slave::Depth, Fault::NoAnswer);
}

#[test]
fn a_slave_that_starts_anew_in_motion_is_not_taken_for_done() {
    for (motion, slave) in [(FEED, Slave::Transverse), (INFEED, Slave::Depth)] {
        fails(motion, &board_fault(slave.name(), "reset", 10.0), 10.0, slave, Fault::Restarted);
        let off = board_fault(slave.name(), "power-off", 10.0);
        let played = fails(motion, &format!("{off}for = \"300 ms\"\n"), 10.0, slave, Fault::Restarted);
        // It counts from 0 again, the carriage does not.
        assert!(telemetry(&played, slave.name(), "position_counts") < 3_000);
        assert!(telemetry(&played, slave.name(), "carriage_offset_counts") > 5);
        fails(motion, &off, 10.0, slave, Fault::NoAnswer);
    }
}

#[test]
fn a_motor_that_stalls_in_motion_is_reported_and_switched_off() {
    for (motion, at, slave) in [(FEED, 10.0, Slave::Transverse), (INFEED, 10.0, Slave::Depth)] {
        let played = fails(motion, &board_fault(slave.name(), "stall", at), at, slave, Fault::Stalled);
        assert_eq!(telemetry(&played, slave.name(), "drive"), 0);
        let position = telemetry(&played, slave.name(), "position_counts");
        assert!((1..8000).contains(&position), "{position}");
    }
}

#[test]
fn a_spindle_that_stalls_while_it_starts_is_reported() {
    let played = play(&[TURNING, FEED, FEED], &board_fault("spindle", "stall", 0.1));
    assert_eq!(played.outcome, Outcome::Faulted);
    assert_eq!(played.job.tally.failures, [(Slave::Spindle.into(), Fault::Stalled)]);
    let dump = Dump::of(&played);
    assert_eq!(dump.bytes("master_to_pc"), [ACK, XOFF, CAN, b's', b's', XON]);
    assert!(dump.replied_at(CAN) < 3 * SECOND + SECOND / 10);
    assert_eq!(telemetry(&played, "transverse", "position_counts"), 0);
    assert_eq!((telemetry(&played, "spindle", "drive"), telemetry(&played, "spindle", "speed_rpm")), (0, 0));
}

#[test]
fn a_spindle_that_stalls_while_an_axis_moves_is_reported() {
    let at = 10.0;
    let played = fails(FEED, &board_fault("spindle", "stall", at), at, Slave::Spindle, Fault::Stalled);
    assert_eq!(telemetry(&played, "transverse", "position_counts"), 9000);
}

#[test]
fn an_axis_that_runs_into_its_end_of_travel_is_reported() {
    // From mid-travel: 450 slots, and 36000 counts.
    let feed = [0x00, 0xe1, 0x75, 0x30, 0x01, 0, 0, 0];
    let infeed = [0x00, 0, 0, 0, 0, 0x01, 0x2c, 0x01];
    for (frame, slave, least) in [(infeed, Slave::Depth, -455..=-445), (feed, Slave::Transverse, -36_050..=-35_950)] {
        let played = play(&[frame, frame, frame, TURNING], "");
        assert_eq!(played.outcome, Outcome::Faulted);
        assert_eq!(played.job.tally.failures, [(slave.into(), Fault::EndOfTravel)]);
        let can = [CAN, slave.letter(), b'e'];
        let replies = [&[ACK, XOFF, XON, ACK, XOFF][..], &can, &[XON]].concat();
        assert_eq!(Dump::of(&played).bytes("master_to_pc"), replies);
        assert!(least.contains(&telemetry(&played, slave.name(), "position_counts")), "{:?}", played.boards.len());
        assert_eq!(telemetry(&played, slave.name(), "drive"), 0);
        assert_eq!(telemetry(&played, "spindle", "set_point_rpm"), 0);
    }
}

/// After so many seconds the master knows its slaves.
const STARTED: f64 = 0.02;

/// A rig in this process whose PC writes what the test says.
struct Bench {
    rig: Rig,
    counts: Counts,
    now: Instant,
}

impl Bench {
    fn new(settings: &str) -> Self {
        let text = include_str!("../harness/builtin/lathe.toml").replacen(MASTER, settings, 1);
        let file = RigFile::parse("test.toml", &text).unwrap();
        let uart = PcUart::new(file.pc.baud, file.pc.tx_fifo, file.pc.clock);
        let rig = block_on(Rig::start(&file, &Driver::InProcess, uart)).unwrap();
        let counts = Counts::new(&rig);
        let mut bench = Self { rig, counts, now: Instant::START };
        assert!(bench.run(STARTED).is_empty(), "with the master and its slaves started there is nothing to tell");
        bench
    }

    fn write(&mut self, frame: [u8; 8]) {
        let pc = self.rig.pc();
        self.rig.stimulate(pc, self.now, Stimulus::Write(frame.to_vec()));
    }

    fn hang(&mut self, slave: Slave, at: Instant, hung: bool) {
        let node = self.rig.nodes().iter().position(|node| node.name == slave.name()).unwrap();
        self.rig.stimulate(node, at, Stimulus::Hang(hung));
    }

    /// What the PC receives until `seconds` have passed.
    fn run(&mut self, seconds: f64) -> Vec<u8> {
        self.now += Span::from_micros((seconds * 1e6) as u64);
        block_on(self.rig.advance(Limit::until(self.now))).unwrap();
        self.counts.add(&mut self.rig);
        std::mem::take(&mut self.counts.received)
    }

    fn of(&self, board: &str, quantity: &str) -> i64 {
        self.counts.of(&self.rig, board, quantity)
    }
}

const MASTER: &str = "kind = \"master\"";
/// A master that gives a slave up as soon as it may.
const HASTY: &str = "kind = \"master\"\n[board.settings]\nenquiries = 2\nanswer_ms = 8\nenquiry_period_ms = 100";

#[test]
fn what_a_slave_missed_while_it_hung_it_does_not_do_once_it_is_given_up() {
    let frame = [0x4b, 0xe1, 0x00, 0xe1, 0, 0, 2, 0];
    for slave in Slave::ALL {
        for settings in [MASTER, HASTY] {
            let mut bench = Bench::new(settings);
            bench.hang(slave, bench.now, true);
            bench.write(frame);
            assert_eq!(bench.run(30.0), [ACK, CAN, slave.letter(), b'n', XON], "{slave:?}");
            bench.hang(slave, bench.now, false);
            assert!(bench.run(30.0).is_empty());
            let set_points = [("spindle", 1_500), ("transverse", 225), ("depth", 2)];
            for ((board, expected), its) in set_points.into_iter().zip(Slave::ALL) {
                let quantity = if its == Slave::Spindle { "set_point_rpm" } else { "position_counts" };
                let expected = if its == slave { 0 } else { expected };
                assert!((bench.of(board, quantity) - expected).abs() <= 1, "{slave:?} hung: {board}");
            }
            // It is asked when a frame needs it, and then takes the next.
            bench.write(frame);
            assert_eq!(bench.run(0.1), [NAK, b'f']);
            bench.write(frame);
            assert_eq!(bench.run(60.0), [ACK, XON]);
        }
    }
}

/// However long a slave hangs while its part comes, even in the middle of it, and whenever it goes on.
#[test]
fn the_pc_is_told_that_a_frame_is_done_only_if_every_slave_did_its_part() {
    let frame = [0x4b, 0xe1, 0x00, 0xe1, 0, 0, 2, 0];
    // The parts begin when the frame's eight characters have come.
    let part = seconds(STARTED) + Span::from_nanos(8 * CHARACTER);
    let quarters = |n: u64| Span::from_nanos(n * CHARACTER / 4);
    let mut outcomes = BTreeSet::new();
    for (slave, quantity, target) in [
        (Slave::Spindle, "set_point_rpm", 1_500),
        (Slave::Transverse, "position_counts", 225),
        (Slave::Depth, "position_counts", 2),
    ] {
        let bytes = SLAVE_LINES[slave as usize].2.len() as u64;
        for (from, until) in (0..=4 * bytes + 4).flat_map(|from| {
            let until = [1, 4, 9, 14, 18, 40].map(|more| part + quarters(from + more)).into_iter();
            let asked =
                [1_000.5, 1_011.0, 1_012.5, 1_015.0, 1_032.0, 1_040.0, 2_000.0].map(|ms| seconds(STARTED + ms / 1e3));
            until.chain(asked).map(move |until| (from, until))
        }) {
            let mut bench = Bench::new(MASTER);
            bench.hang(slave, part + quarters(from), true);
            bench.hang(slave, until, false);
            bench.write(frame);
            let replies = bench.run(30.0);
            let position = bench.of(slave.name(), quantity);
            let moved = (position - target).abs() <= 1;
            assert!(moved || position == 0, "{slave:?} hangs from {from} quarters until {until}: {position}");
            let what = match &replies[..] {
                [ACK, XON] => "done",
                [ACK, CAN, letter, b'g', XON] if *letter == slave.letter() => "garbled",
                [ACK, CAN, letter, b'n', XON] if *letter == slave.letter() => "no answer",
                other => panic!("{slave:?} hangs from {from} quarters until {until}: {other:02x?}"),
            };
            let expected = match what {
                "done" => true,
                // One that has its part when it hangs goes on with it afterwards.
                "no answer" if from > 4 * bytes => true,
                "no answer" if from + 2 >= 4 * bytes => moved,
                _ => false,
            };
            assert_eq!(moved, expected, "{slave:?} hangs from {from} quarters until {until}: {what}");
            outcomes.insert((slave, what));
        }
    }
    assert_eq!(outcomes.len(), 9, "{outcomes:?}");
}

// --- frames that are refused ----------------------------------------------------------------------------------------

#[test]
fn bad_frames_are_refused_with_reasons_and_move_nothing_while_the_others_are_executed() {
    let folder = folder();
    let path = folder.path().join("bad.frames");
    let mut file = std::fs::File::create(&path).unwrap();
    // The bad ones would move everything, were it not for one byte.
    let lines = [
        "0A 00 00 00 00 00 00 00",
        "32 E1 10 00 02 00 40 00 # feed direction",
        "0A E1 03 E8 00 00 05 00",
        "32 E1 10 00 00 00 40 02 # depth direction",
        "03 E1 10 00 00 00 40 00 # spindle speed",
        "32 00 10 00 00 00 40 00 # no speed for a distance",
        "32 E2 10 00 00 00 40 00 # feed speed",
        "0A E1 00 64 01 00 02 01",
    ];
    writeln!(file, "{}", lines.join("\n")).unwrap();
    let run = output(&["run", path.to_str().unwrap(), "--json"]);
    assert_eq!(run.status.code(), Some(1));
    let summary = json(&run);
    assert_eq!(summary["outcome"], "rejected");
    let frames = &summary["frames"];
    assert_eq!(frames["refusals"], serde_json::json!(["direction", "direction", "speed", "speed", "speed"]));
    for (name, expected) in [("sent", 8), ("accepted", 3), ("rejected", 5)] {
        assert_eq!(frames[name].as_u64(), Some(expected), "{name}");
    }
    for (board, quantity, expected) in [
        ("master", "frames_distributed", 3),
        ("spindle", "set_point_rpm", 200),
        ("transverse", "position_counts", 900),
        ("depth", "position_counts", 3),
    ] {
        let found = summary["boards"][board][quantity].as_i64().unwrap();
        // An axis is in position within one count.
        assert!((found - expected).abs() <= 1, "{board} {quantity}: {found}");
    }

    let run = output(&["run", path.to_str().unwrap()]);
    assert_eq!(run.status.code(), Some(1));
    let text = String::from_utf8(run.stdout).unwrap();
    assert!(text.contains("refused: direction, direction, speed, speed, speed"), "{text}");
    assert!(text.ends_with("rejected\n"), "{text}");
}

#[test]
fn after_hours_of_any_bytes_a_frame_is_obeyed() {
    for seed in 0..4 {
        block_on(hours_of_any_bytes(seed));
    }
}

async fn hours_of_any_bytes(seed: u64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let file = RigFile::load("lathe").unwrap();
    let uart = PcUart::new(file.pc.baud, file.pc.tx_fifo, file.pc.clock);
    let mut rig = Rig::start(&file, &Driver::InProcess, uart).await.unwrap();
    let pc = rig.pc();
    let mut counts = Counts::new(&rig);
    let mut now = Instant::START;
    while now < seconds(3600.0) {
        let baud = [9600, 9600, 9600, 4800, 19_200][random.next_u32() as usize % 5];
        rig.stimulate(pc, now, Stimulus::Configure { baud, ixon: random.next_u32() % 4 == 0 });
        rig.stimulate(pc, now, Stimulus::Write(any_bytes(&mut random)));
        // From a microsecond to a minute.
        now +=
            Span::from_micros(random.next_u64() % [100, 10_000, 100_000, 60_000_000][random.next_u32() as usize % 4]);
        rig.advance(Limit::until(now)).await.unwrap();
        counts.add(&mut rig);
    }
    rig.stimulate(pc, now, Stimulus::Discard);
    rig.stimulate(pc, now, Stimulus::Configure { baud: BAUD as u32, ixon: false });
    rig.advance(Limit::NONE).await.unwrap();
    counts.add(&mut rig);
    assert!(rig.engine().is_quiet(), "seed {seed}: the rig never comes to rest");
    assert!(counts.of(&rig, "master", "frames_distributed") > 5, "seed {seed}: nothing happened");

    let depth = counts.of(&rig, "depth", "position_counts");
    let frames = counts.of(&rig, "master", "frames_distributed");
    counts.received.clear();
    // Towards the middle, where there is room; after a silence.
    let towards = u8::from(depth > 0);
    rig.stimulate(
        pc,
        now.max(rig.engine().frontier()) + Span::from_millis(100),
        Stimulus::Write(vec![0, 0, 0, 0, 0, 0, 20, towards]),
    );
    rig.advance(Limit::NONE).await.unwrap();
    counts.add(&mut rig);
    assert_eq!(counts.received, [ACK, XON], "seed {seed}");
    assert_eq!(counts.of(&rig, "master", "frames_distributed"), frames + 1);
    let moved = counts.of(&rig, "depth", "position_counts") - depth;
    assert!((moved.abs() - 20).abs() <= 2 && (moved < 0) == (depth > 0), "seed {seed}: {depth} and {moved}");
}

/// Now and then a frame, sometimes with a byte wrong or missing; else anything.
fn any_bytes(random: &mut ChaCha8Rng) -> Vec<u8> {
    let mut byte = |values: u32| (random.next_u32() % values) as u8;
    let mut bytes = vec![byte(250), 1 + byte(230), byte(8), byte(255), byte(2), 0, byte(60), byte(2)];
    match byte(5) {
        0 => {}
        1 => bytes[usize::from(byte(8))] = byte(255),
        2 => bytes.truncate(usize::from(byte(8))),
        3 => bytes = bytes.repeat(1 + usize::from(byte(6))),
        _ => bytes = (0..byte(100)).map(|_| byte(256)).collect(),
    }
    bytes
}

/// The last telemetry of a rig, and what its PC has received.
struct Counts {
    telemetry: torno::observe::Telemetry,
    received: Vec<u8>,
}

impl Counts {
    fn new(rig: &Rig) -> Self {
        Self { telemetry: torno::observe::Telemetry::new(rig), received: Vec::new() }
    }

    fn add(&mut self, rig: &mut Rig) {
        for fact in rig.take_facts() {
            self.telemetry.add(&fact);
            if let Fact::Event { node, event, value, .. } = fact
                && node == rig.pc()
                && let Some(PcEvent::Received(byte)) = PcEvent::from_numbers(event, value)
            {
                self.received.push(byte);
            }
        }
    }

    fn of(&self, rig: &Rig, board: &str, quantity: &str) -> i64 {
        self.telemetry.of(rig.nodes().iter().position(|node| node.name == board).unwrap())[quantity]
    }
}
