//! The pins between firmware and motors, as a logic analyser has them.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;

use crate::common::play::Dump;
use crate::common::{folder, is_installed, json, output};

/// Moves all three motors: 1500 rpm, 900 counts, three slots.
const PROGRAM: &str = "4B E1 03 84 00 00 03 00\n";

const PINS: [&str; 16] = [
    "depth_backward",
    "depth_encoder",
    "depth_forward",
    "spindle_encoder",
    "spindle_pwm",
    "transverse_backward",
    "transverse_d0",
    "transverse_d1",
    "transverse_d2",
    "transverse_d3",
    "transverse_d4",
    "transverse_d5",
    "transverse_d6",
    "transverse_d7",
    "transverse_encoder",
    "transverse_forward",
];

fn word(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// The rows of a recording's telemetry: time in s, board, quantity, value.
fn telemetry(trace: &Path) -> Vec<(f64, String, String, i64)> {
    let text = String::from_utf8(output(&["trace", word(trace), "--csv"]).stdout).unwrap();
    let row = |line: &str| {
        let [at, board, quantity, value] = line.split(',').collect::<Vec<_>>()[..] else { panic!("{line}") };
        (at.parse().unwrap(), board.to_owned(), quantity.to_owned(), value.parse().unwrap())
    };
    text.lines().skip(1).map(row).collect()
}

fn values(rows: &[(f64, String, String, i64)], board: &str, quantity: &str) -> Vec<(f64, i64)> {
    let its = rows.iter().filter(|(_, of, what, _)| of == board && what == quantity);
    its.map(|(at, _, _, value)| (*at, *value)).collect()
}

#[test]
fn pins_are_added_to_the_lines_and_change_nothing_else() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let run = |more: &[&str]| json(&output(&[&["run", "--json"], more].concat()));
    let fine = ["--vcd-step", "1 ns"];
    let plain = run(&[&["--vcd", word(&at("plain.vcd")), "--record", word(&at("a.torno"))], &fine[..]].concat());
    let pins =
        run(&[&["--vcd", word(&at("pins.vcd")), "--pins", "--record", word(&at("b.torno"))], &fine[..]].concat());
    run(&[&["--in-process", "--vcd", word(&at("one.vcd")), "--pins"], &fine[..]].concat());
    assert_eq!(plain["digest"], pins["digest"]);
    assert!(output(&["diff", word(&at("a.torno")), word(&at("b.torno"))]).status.success());
    // A trace that was recorded without them has them, too.
    assert!(
        output(&["trace", word(&at("a.torno")), "--vcd", word(&at("trace.vcd")), "--pins", "--vcd-step", "1 ns"])
            .status
            .success()
    );
    let file = |name: &str| fs::read_to_string(at(name)).unwrap();
    assert!(file("pins.vcd") == file("one.vcd") && file("pins.vcd") == file("trace.vcd"));
    let [plain, pins] = ["plain.vcd", "pins.vcd"].map(|name| Dump::read(&file(name)));
    let names: BTreeSet<&str> = pins.wires.keys().map(String::as_str).collect();
    let expected: BTreeSet<&str> = plain.wires.keys().map(String::as_str).chain(PINS).collect();
    assert_eq!(names, expected);
    assert!(plain.wires.iter().all(|(line, changes)| pins.wires[line] == *changes));
}

#[test]
fn the_one_board_lathe_has_the_same_pins_by_its_motors_names() {
    let folder = folder();
    let path = folder.path().join("a.vcd");
    let run = ["run", "lathe-dspic", "--in-process", "--vcd", word(&path), "--vcd-step", "1 ns", "--pins"];
    assert!(output(&run).status.success());
    let dump = Dump::read(&fs::read_to_string(&path).unwrap());
    let pins: Vec<String> = PINS.iter().map(|pin| format!("dspic_{pin}")).collect();
    assert!(pins.iter().all(|pin| dump.wires.contains_key(pin)), "{:?}", dump.wires.keys());
}

/// What a decoder of sigrok prints of a dump with a step of 100 ns: when each thing began and ended, in s, and what it
/// was: `1105921-1114113 pwm-1: 12.219238%`.
fn decoded(dump: &Path, decoder: &str, annotation: &str) -> Vec<([f64; 2], String)> {
    let mut command = Command::new("sigrok-cli");
    command.args(["-I", "vcd", "-i", word(dump), "-P", decoder, "-A", annotation, "--protocol-decoder-samplenum"]);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    // Edges are rounded to the nearest step, and some instants of telemetry are the edges' own.
    let seconds = |number: &str| number.parse::<f64>().unwrap() * 100e-9 + 60e-9;
    let read = |line: &str| {
        let (numbers, what) = line.split_once(' ').unwrap();
        let (begin, end) = numbers.split_once('-').unwrap();
        ([begin, end].map(seconds), what.split_once(": ").unwrap().1.to_owned())
    };
    String::from_utf8(output.stdout).unwrap().lines().map(read).collect()
}

#[test]
fn sigrok_decodes_the_drive_from_the_modulator_and_the_way_from_the_encoders() {
    if !is_installed("sigrok-cli", Command::new("sigrok-cli").arg("--version")) {
        return;
    }
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("a.frames"), PROGRAM).unwrap();
    let (program, dump, trace) = (at("a.frames"), at("a.vcd"), at("a.torno"));
    let run = ["run", "lathe", word(&program), "--in-process", "--vcd-step", "100 ns", "--pins"];
    let files = ["--vcd", word(&dump), "--record", word(&trace)];
    assert!(output(&[&run[..], &files].concat()).status.success());
    let rows = telemetry(&trace);

    // Each period has the duty of the drive that held when it began, within a step of the dump.
    let drives = values(&rows, "spindle", "drive");
    let duties = decoded(&dump, "pwm:data=spindle_pwm", "pwm=duty-cycle");
    let mut seen = BTreeSet::new();
    for ([begin, _], duty) in &duties {
        let drive = drives.iter().take_while(|(at, _)| at <= begin).last().unwrap().1;
        let duty: f64 = duty.trim_end_matches('%').parse().unwrap();
        let expected = 100.0 * drive as f64 / 1_023.0;
        assert!((duty - expected).abs() < 0.02, "{duty} at {begin} s: expected {expected} for {drive}");
        seen.insert(drive);
    }
    assert!(duties.len() > 1_000 && seen.len() > 20, "{} {seen:?}", duties.len());

    // The pulses are what the boards have counted, as long as they move one way.
    for (board, up_to) in [("transverse", 890), ("depth", 3)] {
        let decoder = format!("counter:data={board}_encoder:data_edge=rising");
        let pulses = decoded(&dump, &decoder, "counter=edge_count");
        let way = values(&rows, board, "position_counts");
        let mut furthest = 0;
        for (at, count) in way.into_iter().take_while(|(_, count)| *count <= up_to) {
            // What the decoder has counted ends with the edge.
            let counted = pulses.iter().filter(|([_, end], _)| *end <= at).count();
            assert_eq!(counted as i64, count, "{board} at {at} s");
            furthest = furthest.max(count);
        }
        assert!(furthest >= up_to - 30, "{board}: {furthest}");
    }
}
