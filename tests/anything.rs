//! Bytes from outside, whatever they are: any, valid ones that were changed, and valid ones.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use proptest::prelude::*;
use proptest::sample::{Index, select};
use proptest::test_runner::{Config, TestRunner};
use torno::control::{Form, Request};
use torno::fault;
use torno::rig::file::RigFile;
use torno::rig::{Driver, Rig};
use torno::scenario::Scenario;
use torno_protocol::board::{Kept, Stimulus};
use torno_protocol::lathe::{Frame, Program};
use torno_protocol::line::{Edge, Level};
use torno_protocol::record::{self, FromBoard, Grant, Heard, Report, Setup, ToBoard};
use torno_protocol::servo::Command;
use torno_protocol::time::{Instant, Span};

use crate::common::play::{DEMONSTRATION, block_on};
use crate::foreign::{ENTRIES, run};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
/// Cases of each property: PROPTEST_CASES says another number.
const CASES: u32 = 200;

/// Whether `PROPTEST_CASES` asks for another number of cases.
fn config() -> Config {
    let asked = std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok());
    Config { cases: asked.unwrap_or(CASES), failure_persistence: None, ..Config::default() }
}

fn check<T: std::fmt::Debug>(strategy: impl Strategy<Value = T>, holds: impl Fn(T)) {
    let outcome = TestRunner::new(config()).run(&strategy, |case| {
        holds(case);
        Ok(())
    });
    outcome.unwrap_or_else(|failure| panic!("{failure}"));
}

fn files(folder: &str, ending: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(Path::new(ROOT).join(folder)).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<PathBuf> =
        entries.filter(|path| path.extension().is_some_and(|found| found == ending)).collect();
    files.sort();
    files
}

fn read(paths: Vec<PathBuf>) -> Vec<Vec<u8>> {
    paths.into_iter().map(|path| fs::read(path).unwrap()).collect()
}

/// The recordings of all versions.
fn recordings() -> Vec<Vec<u8>> {
    let versions = fs::read_dir(format!("{ROOT}/tests/recordings")).unwrap();
    let mut names: Vec<String> = versions.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names.iter().flat_map(|name| read(files(&format!("tests/recordings/{name}"), "torno"))).collect()
}

/// The valid files for an entry: what is changed.
fn corpus(name: &str) -> Vec<Vec<u8>> {
    let texts = |texts: &[&str]| texts.iter().map(|text| text.as_bytes().to_vec()).collect::<Vec<_>>();
    match name {
        "rig_file" => read(files("harness/builtin", "toml")),
        "place" => texts(&[
            "spindle.controller.k\n0.25",
            "depth.clock_ppm\n200",
            "pc.baud\n9600",
            "board.depth.clock_ppm\n-1e3",
        ]),
        "scenario_file" => {
            let folders = ["tests/scenarios", "tests/errata", "tests/sweeps"];
            read(folders.iter().flat_map(|folder| files(folder, "toml")).collect())
        }
        "fault_file" => {
            let scenarios = corpus("scenario_file").into_iter().map(|file| String::from_utf8(file).unwrap());
            let faults = |text: String| text.split_once("[[fault]]").map(|(_, rest)| format!("[[fault]]{rest}"));
            let only = |text: String| text.split("\n[expect").next().unwrap_or_default().to_owned().into_bytes();
            scenarios.filter_map(faults).map(only).collect()
        }
        "program" => read(files("harness/builtin", "frames")),
        "csv" => {
            let row = |n: u32| format!("{:.2},5,{:.1}\n", 0.02 * f64::from(n), 90.0 - 80.0 / f64::from(n + 1));
            let rows: String = (0..40).map(row).collect();
            let texts =
                ["time_s,input_v,speed\n", "time_s,input,counts\n", "# log\n\u{feff}\"time_s\",input,position\n"]
                    .map(|head| format!("{head}{rows}"));
            let semicolons = texts[0].replace(',', ";").replace('.', ",");
            texts.into_iter().chain([semicolons]).map(String::into_bytes).collect()
        }
        "variation" => {
            texts(&["fault.noise.period=1 ms,3 ms", "master.clock_ppm=-70000..70000/57", "a=1 s..3 s/5", "b=3..16"])
        }
        "sweep_rows" => {
            let row = |n: u32| {
                format!(
                    "{{\"sweep\":{{\"files\":\"f\",\"seeds\":2,\"vary\":[\"a=1,2\"],\"runs\":4}},\"number\":{n},\
                     \"scenario\":\"s\",\"values\":[[\"a\",\"1\"]],\"seed\":{},\"verdict\":\"passed\",\"failure\":null,\
                     \"digest\":\"d\"}}\n",
                    n % 2
                )
            };
            vec![(0..4).map(row).collect::<String>().into_bytes()]
        }
        "quantity" => {
            let wide = [format!("-{0}..{0}", "9".repeat(308)), format!("-{} s..1 ns", "9".repeat(305))];
            let plain = ["1.5 s", "200ms", "-500 ppm", "3 %", "0.4 mm", "1 s..3 s", "1..16", "5 %..20 %", "1 ms..2 s"];
            plain.map(str::to_owned).into_iter().chain(wide).map(String::into_bytes).collect()
        }
        "request" => texts(&[
            r#"{"do":"state"}"#,
            r#"{"do":"fault","fault":"line = \"pc_to_master\"\nkind = \"cut\"\nfor = \"1 s\""}"#,
            r#"{"do":"power","board":"depth","on":false}"#,
            r#"{"do":"step","span":"10 ms"}"#,
            r#"{"do":"watch","lines":["pc_to_master"],"boards":[],"kinds":["frames"],"form":"text"}"#,
        ]),
        "to_board" => vec![encoded(&to_board_records())],
        "from_board" => vec![encoded(&from_board_records())],
        "trace" => recordings(),
        "trace_blocks" => {
            // The payloads of recordings, without header and checksums.
            recordings().iter().map(|file| payloads(file)).collect()
        }
        "gcode" | "plan" => {
            let programs = ["modes", "arcs", "offsets", "expressions", "flow", "spindle", "text", "shaft"];
            let read = |name: &str| fs::read(format!("{ROOT}/protocol/gcode/tests/programs/{name}.ngc")).unwrap();
            programs.into_iter().map(read).collect()
        }
        "motion_program" => texts(&[
            "p0 k5 x2\nx10 t2\np5 k0 x2\ne\n",
            "p0 k-5 x-2\nx-10 t2 # back\np-5 k0 x-2\n\nx0 t0.5\ne\n",
            "p5k5x3\ne",
        ]),
        "servo_commands" => vec![
            [Command::Link, Command::SetKx(16), Command::GetKx, Command::SetKv(0), Command::GetKv, Command::Run]
                .iter()
                .flat_map(Command::emit)
                .collect(),
            Command::Download((0..60).map(|n| n - 30).collect()).emit(),
        ],
        "lathe_bytes" => vec![
            Program::parse(DEMONSTRATION).unwrap().bytes(),
            b"\x06\x13\x11\x06\x15d\x15o\x18sn\x18mr\x18de\x11".to_vec(),
        ],
        // A byte from 0xc0 on moves the machine on.
        "grbl" => texts(&[
            "$$\n$G\n$I\n$#\n$N0=M0\n$22=1\n$H\n\u{18}$X\n?",
            "G21G18\nM3S500\nG1X1Z-2F100\nG2X1Y1R1\nG4P1\n!~M0\r\n~M2\n",
            "$C\nG0X1Y2Z3(comment)\n;rest\n$C\n$J=G91X1F100\n$RST=*\n$SLP\n",
        ])
        .into_iter()
        .map(|text| [&text[..], &[0xc0, 0xc5, b'\n', 0x84, b'~', 0xc5, 0x85, 0xc1, 0xc2, 0xc3, 0x18, 0xc4]].concat())
        .collect(),
        "rfc2217" => vec![
            // Cut after each byte: agreements, every command, a break, data with a doubled IAC.
            b"\x01\xff\xfd\x00\xff\xfb\x2c\xff\xfd\x03\xff\xfa\x2c\x01\x00\x00\x12\xc0\xff\xf0a\xff\xffb".to_vec(),
            (0..13).flat_map(|n| [255, 250, 44, n, n / 2, 255, 240, b'x']).chain([255, 243]).collect(),
        ],
        other => panic!("of what should {other} be made?"),
    }
}

fn payloads(file: &[u8]) -> Vec<u8> {
    // Magic and version, then blocks of length, checksum and payload; the first is the header.
    let mut rest = &file[10..];
    let mut found: Vec<&[u8]> = Vec::new();
    while let Some((length, tail)) = rest.split_first_chunk() {
        let (payload, tail) = tail[8..].split_at(u32::from_le_bytes(*length) as usize);
        found.push(payload);
        rest = tail;
    }
    found[1..].join(&0xa7)
}

fn encoded<R: serde::Serialize>(records: &[R]) -> Vec<u8> {
    let mut buffer = bytes::BytesMut::new();
    records.iter().for_each(|record| record::encode(record, &mut buffer).unwrap());
    buffer.to_vec()
}

fn to_board_records() -> Vec<ToBoard> {
    let edges = |n: u64| (0..n).map(|n| Edge { at: Instant::from_nanos(1000 * n), level: Level::Low }).collect();
    let heard = vec![Heard::Edges { port: 1, edges: edges(5) }];
    let grant = Grant { commit: Instant::from_nanos(7), until: Instant::from_nanos(9000), heard };
    vec![
        ToBoard::Setup(Setup::default()),
        ToBoard::Heard(vec![Heard::Edges { port: 0, edges: edges(3) }]),
        ToBoard::Grant(grant),
        ToBoard::Keep(Instant::from_nanos(11)),
    ]
}

fn from_board_records() -> Vec<FromBoard> {
    let kept = Kept { setting: "s".to_owned(), lines: vec!["a".to_owned(), String::new()] };
    vec![
        FromBoard::Broken("no".to_owned()),
        FromBoard::Report(Report::default()),
        FromBoard::Told(Vec::new()),
        FromBoard::Kept(Some(kept)),
    ]
}

// --- any bytes, and valid ones that were changed --------------------------------------------------------------------

/// What words of a file are replaced by.
const WORDS: [&str; 40] = [
    "",
    "0",
    "-1",
    "1",
    "9",
    "255",
    "256",
    "65536",
    "-0.0",
    "1e400",
    "1e308",
    "-1e308",
    "5e-324",
    "nan",
    "inf",
    "\"\"",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551616",
    "true",
    "[]",
    "{}",
    "[[fault]]",
    "[[step]]",
    "\"1e18 ns\"",
    "\"0 s\"",
    "\"1 s..3 s\"",
    "\"-1e300..1e300\"",
    "\"depth\"",
    "\"pc\"",
    "\"pc_to_master\"",
    "\"noise\"",
    "\"?18\"",
    "\"\u{1F980}\"",
    "\u{0}",
    "=",
    "..",
    "when",
    "for",
    "at",
];

/// A change of a file.
#[derive(Clone, Debug)]
enum Change {
    Byte(Index, u8),
    Insert(Index, Vec<u8>),
    Remove(Index, usize),
    Cut(Index),
    /// A word gives way to another one.
    Word(Index, &'static str),
    /// A word gives way to another one of the file.
    Swap(Index, Index),
    /// A line is there once more, elsewhere.
    Line(Index, Index),
    Without(Index),
}

fn changes() -> impl Strategy<Value = Vec<Change>> {
    let at = any::<Index>;
    let change = prop_oneof![
        1 => (at(), any::<u8>()).prop_map(|(at, byte)| Change::Byte(at, byte)),
        1 => (at(), prop::collection::vec(any::<u8>(), 1..6)).prop_map(|(at, bytes)| Change::Insert(at, bytes)),
        1 => (at(), 1..9usize).prop_map(|(at, length)| Change::Remove(at, length)),
        1 => at().prop_map(Change::Cut),
        4 => (at(), select(&WORDS[..])).prop_map(|(at, word)| Change::Word(at, word)),
        4 => (at(), at()).prop_map(|(at, from)| Change::Swap(at, from)),
        2 => (at(), at()).prop_map(|(from, to)| Change::Line(from, to)),
        2 => at().prop_map(Change::Without),
    ];
    prop::collection::vec(change, 1..5)
}

/// Where the words of a file are: what stands between spaces, quotes too.
fn words(file: &[u8]) -> Vec<std::ops::Range<usize>> {
    let mut found: Vec<std::ops::Range<usize>> = Vec::new();
    let mut quoted = false;
    for (at, byte) in file.iter().enumerate() {
        quoted ^= *byte == b'"';
        let separates = !quoted && (byte.is_ascii_whitespace() || b",;=:{}[]".contains(byte));
        match found.last_mut() {
            Some(last) if last.end == at && !separates => last.end += 1,
            _ if !separates => found.push(at..at + 1),
            _ => {}
        }
    }
    found
}

fn changed(mut file: Vec<u8>, changes: &[Change]) -> Vec<u8> {
    for change in changes {
        if file.is_empty() {
            break;
        }
        let length = file.len();
        let lines = |file: &[u8]| file.split_inclusive(|byte| *byte == b'\n').map(<[u8]>::to_vec).collect::<Vec<_>>();
        match change {
            Change::Byte(at, byte) => file[at.index(length)] = *byte,
            Change::Insert(at, bytes) => drop(file.splice(at.index(length)..at.index(length), bytes.clone())),
            Change::Remove(at, some) => drop(file.drain(at.index(length)..(at.index(length) + some).min(length))),
            Change::Cut(at) => file.truncate(at.index(length)),
            Change::Word(at, word) => {
                let words = words(&file);
                if !words.is_empty() {
                    file.splice(at.get(&words).clone(), word.bytes());
                }
            }
            Change::Swap(at, from) => {
                let words = words(&file);
                if !words.is_empty() {
                    let word = file[from.get(&words).clone()].to_vec();
                    file.splice(at.get(&words).clone(), word);
                }
            }
            Change::Line(from, to) => {
                let mut lines = lines(&file);
                let line = from.get(&lines).clone();
                lines.insert(to.index(lines.len()), line);
                file = lines.concat();
            }
            Change::Without(at) => {
                let mut lines = lines(&file);
                lines.remove(at.index(lines.len()));
                file = lines.concat();
            }
        }
    }
    file
}

/// Holds for any bytes, for the valid files, and for those changed.
fn holds(name: &str) {
    let holds = |bytes: &[u8]| run(name, bytes);
    let corpus = corpus(name);
    corpus.iter().for_each(|file| holds(file));
    check(prop::collection::vec(any::<u8>(), 0..300), |bytes| holds(&bytes));
    let signs = select(b" \n\t\"'=.,:;[]{}#-+_/0123456789abcdefghijklmnopqrstuvwxyz%".to_vec());
    check(prop::collection::vec(signs, 0..80), |bytes| holds(&bytes));
    check((select(corpus), changes()), |(file, changes)| holds(&changed(file, &changes)));
}

macro_rules! entries {
    ($($name:ident)*) => {
        /// The entries that have a test.
        const TESTED: &[&str] = &[$(stringify!($name)),*];
        $(
            #[test]
            fn $name() {
                holds(stringify!($name));
            }
        )*
    };
}

entries! {
    rig_file place scenario_file fault_file program csv variation sweep_rows quantity request to_board from_board trace
    trace_blocks motion_program servo_commands lathe_bytes grbl gcode plan rfc2217
}

#[test]
fn each_entry_has_a_test_and_a_fuzz_target() {
    let entries: BTreeSet<&str> = ENTRIES.iter().map(|entry| entry.0).collect();
    assert_eq!(entries, TESTED.iter().copied().collect());
    let manifest: toml::Table = fs::read_to_string(format!("{ROOT}/tests/fuzz/Cargo.toml")).unwrap().parse().unwrap();
    let targets: BTreeSet<&str> =
        manifest["bin"].as_array().unwrap().iter().map(|bin| bin["name"].as_str().unwrap()).collect();
    assert_eq!(targets, entries);
    for name in entries {
        let target = fs::read_to_string(format!("{ROOT}/tests/fuzz/fuzz_targets/{name}.rs")).unwrap();
        assert!(target.contains(&format!("\"{name}\"")), "{name}");
    }
}

// --- valid ones -----------------------------------------------------------------------------------------------------

/// A whole or broken number, as people write it.
fn number() -> impl Strategy<Value = String> {
    prop_oneof![
        (0..10_000u32).prop_map(|n| n.to_string()),
        (0..1_000_000u32).prop_map(|n| format!("{}", f64::from(n) / 1e3))
    ]
}

fn time() -> impl Strategy<Value = String> {
    (number(), select(&["", " "][..]), select(&["s", "ms", "us", "µs", "ns"][..]))
        .prop_map(|(n, gap, unit)| n + gap + unit)
}

/// Faults that the lathe can have, as their tables.
fn faults() -> impl Strategy<Value = String> {
    let line = select(RigFile::load("lathe").unwrap().names().lines);
    let slave = select(&["spindle", "transverse", "depth"][..]);
    let board = select(&["master", "spindle", "transverse", "depth"][..]);
    let plain = |kinds: &'static [&'static str]| select(kinds);
    let of_a_line = prop_oneof![
        plain(&["cut", "stuck-low", "stuck-high"]).prop_map(|kind| format!("kind = \"{kind}\"\n")),
        (1..2000u32).prop_map(|ms| format!("kind = \"noise\"\nperiod = \"{ms} ms\"\n")),
        (1..50u32, 0..10u8).prop_map(|(nth, bit)| format!("kind = \"flip\"\nnth = {nth}\nvalue = {bit}\n")),
        (1..50u32, plain(&["drop", "double"])).prop_map(|(nth, kind)| format!("kind = \"{kind}\"\nnth = {nth}\n")),
    ];
    let of_a_board = prop_oneof![
        plain(&["crash", "hang", "power-off"]).prop_map(|kind| format!("kind = \"{kind}\"\n")),
        (-20..=20i32).prop_map(|percent| format!("kind = \"clock\"\nvalue = \"{percent} %\"\n")),
        time().prop_map(|time| format!("kind = \"slow\"\nvalue = \"{time}\"\n")),
    ];
    let of_a_motor = prop_oneof![
        Just("kind = \"stall\"\n".to_owned()),
        (0..=200u32).prop_map(|percent| format!("kind = \"load\"\nvalue = \"{percent} %\"\n")),
        (-100..100i32).prop_map(|counts| format!("kind = \"counts\"\nvalue = {counts}\n")),
    ];
    let place = prop_oneof![
        (line, of_a_line).prop_map(|(line, what)| format!("line = \"{line}\"\n{what}")),
        (board, of_a_board).prop_map(|(board, what)| format!("board = \"{board}\"\n{what}")),
        (slave, of_a_motor).prop_map(|(board, what)| format!("board = \"{board}\"\n{what}")),
    ];
    let when = prop_oneof![Just(String::new()), (0..9000u32).prop_map(|ms| format!("at = \"{ms} ms\"\n"))];
    (place, when).prop_map(|(place, when)| place + &when)
}

#[test]
fn valid_faults_are_taken_by_files_scenarios_and_requests() {
    let names = RigFile::load("lathe").unwrap().names();
    check(prop::collection::vec(faults(), 1..5), |faults| {
        let named = faults.iter().enumerate().map(|(n, fault)| format!("[[fault]]\nname = \"f{n}\"\n{fault}"));
        let text: String = named.collect();
        let file = fault::parse("a.toml", &text, &names, None).unwrap_or_else(|error| panic!("{error}\n{text}"));
        assert_eq!(file.faults.len(), faults.len());
        let scenario = format!("name = \"a\"\nend = \"1 s\"\n{text}");
        let scenario = Scenario::parse("a.toml", &scenario, None).unwrap_or_else(|error| panic!("{error}\n{text}"));
        assert_eq!(scenario.faults.len(), faults.len());
        let request = Request::Fault { fault: faults[0].clone() };
        let line = serde_json::to_string(&request).unwrap();
        assert_eq!(serde_json::from_str::<Request>(&line).unwrap(), request);
    });
}

#[test]
fn valid_requests_are_read_as_they_were_written() {
    let name = || "[a-z0-9_-]{0,12}";
    let names = || prop::collection::vec(name(), 0..3);
    let form = select(&[Form::Json, Form::Text, Form::Colour][..]);
    let requests = prop_oneof![
        select(&[Request::State, Request::Pause, Request::Resume][..]),
        any::<String>().prop_map(|fault| Request::Fault { fault }),
        name().prop_map(|name| Request::Heal { name }),
        (name(), any::<bool>()).prop_map(|(board, on)| Request::Power { board, on }),
        time().prop_map(|span| Request::Step { span }),
        name().prop_map(|pace| Request::Pace { pace }),
        (names(), names(), names(), form).prop_map(|(lines, boards, kinds, form)| Request::Watch {
            lines,
            boards,
            kinds,
            form
        }),
    ];
    check(requests, |request| {
        let line = serde_json::to_string(&request).unwrap();
        assert!(!line.contains('\n'), "{line}");
        assert_eq!(serde_json::from_str::<Request>(&line).unwrap(), request);
    });
}

#[test]
fn valid_programs_are_read_as_they_were_written() {
    let frames = prop::collection::vec(any::<[u8; 8]>(), 1..30);
    check((frames, select(&["", "  # a comment", "\t#", "\n\n# 12"][..])), |(frames, comment)| {
        let line = |frame: &[u8; 8]| frame.map(|byte| format!("{byte:02x}")).join(" ") + comment + "\n";
        let program = Program::parse(&frames.iter().map(line).collect::<String>()).unwrap();
        assert_eq!(program.frames, frames);
    });
}

#[test]
fn frames_that_are_taken_are_all_within_range() {
    check(any::<[u8; 8]>(), |frame| {
        // What the README says: directions 0 or 1, no distance without a speed.
        let wrong = frame[4] > 1 || frame[7] > 1 || (frame[1] == 0 && (frame[2], frame[3]) != (0, 0));
        assert!(!wrong || Frame::parse(frame).is_err(), "{frame:02x?}");
    });
}

#[test]
fn valid_quantities_are_what_they_say() {
    let units = [("s", 1_000_000_000), ("ms", 1_000_000), ("us", 1_000), ("µs", 1_000), ("ns", 1)];
    check((0..1_000_000u64, select(units.to_vec()), select(&["", " "][..])), |(n, (unit, ns), gap)| {
        assert_eq!(torno_text::parse_span(&format!("{n}{gap}{unit}")), Ok(Span::from_nanos(n * ns)));
    });
    check((-100_000..100_000i64, select(&[("%", 10_000_000), ("ppm", 1_000)][..])), |(n, (unit, ppb))| {
        let ratio = torno_text::parse_ratio(&format!("{n} {unit}"));
        assert_eq!(ratio.ok(), Some(n * ppb).filter(|ratio| ratio.abs() <= 1_000_000_000_000), "{n} {unit}");
    });
    check((-1000..1000i32, 0..1000i32, 2..50usize), |(from, more, count)| {
        let text = format!("a.b={from}..{}/{count}", from + more);
        let variation = torno::sweep::Variation::parse(&text).unwrap();
        assert_eq!((variation.path.as_str(), variation.values.len()), ("a.b", count));
        assert_eq!(
            (variation.values[0].clone(), variation.values[count - 1].clone()),
            (from.to_string(), (from + more).to_string())
        );
    });
}

#[test]
fn valid_motion_programs_are_compiled() {
    // There and back again, each way from rest to rest.
    let legs = prop::collection::vec((1..200u32, 4..40u32), 1..6);
    check(legs, |legs| {
        let leg = |(tenths, deciseconds): &(u32, u32)| {
            let (mm, s) = (f64::from(*tenths) / 10.0, f64::from(*deciseconds) + f64::from(*tenths) / 10.0);
            format!("x{mm} t{s}\nx-{mm} t{s}\n")
        };
        let text = legs.iter().map(leg).collect::<String>() + "e\n";
        let compiled = torno_servo::compile(&text, &torno_servo::Limits::default());
        let program = compiled.program.as_ref().unwrap_or_else(|| panic!("{:?}\n{text}", compiled.findings));
        assert!(compiled.can_be_driven(), "{:?}\n{text}", compiled.findings);
        let counts: i64 = program.increments(125.0).iter().map(|step| i64::from(*step)).sum();
        assert!(program.end_mm().abs() < 1e-9 && counts == 0, "{} mm, {counts} counts", program.end_mm());
    });
}

#[test]
fn a_rig_that_is_taken_can_be_started_and_goes_on() {
    let boards =
        prop::collection::vec((select(&["master", "spindle", "transverse", "depth"][..]), -1000..1000i32), 1..5);
    let baud = select(&[300, 1200, 9600, 115_200][..]);
    check((boards, baud, any::<bool>()), |(mut boards, baud, links)| {
        // The PC needs a master.
        boards.push(("master", 0));
        let mut text =
            format!("name = \"any\"\ndialect = \"lathe\"\n[pc]\nport = \"b{}.pc\"\nbaud = {baud}\n", boards.len() - 1);
        for (n, (kind, ppm)) in boards.iter().enumerate() {
            text += &format!("[[board]]\nname = \"b{n}\"\nkind = \"{kind}\"\nclock_ppm = {ppm}\n");
        }
        let mut linked = BTreeSet::new();
        for (n, (kind, _)) in boards.iter().enumerate().filter(|_| links) {
            if *kind != "master" && linked.insert(*kind) {
                text += &format!("[[link]]\nends = [\"b{}.{kind}\", \"b{n}.master\"]\n", boards.len() - 1);
            }
        }
        let file = RigFile::parse("any.toml", &text).unwrap_or_else(|error| panic!("{error}\n{text}"));
        let events = block_on(async {
            let mut rig = Rig::start(&file, &Driver::InProcess, file.pc.uart()).await.unwrap();
            let pc = rig.pc();
            rig.stimulate(pc, Instant::from_nanos(10_000_000), Stimulus::Write(vec![0; 8]));
            rig.settle(Instant::START + Span::from_millis(300)).await.unwrap();
            rig.take_facts().len()
        });
        assert!(events > 0, "{text}");
    });
}

#[test]
fn traces_that_were_cut_are_read_as_far_as_they_go() {
    let files = recordings();
    check((select(files), any::<Index>()), |(file, at)| {
        let whole = torno_trace::read(&file[..], RigFile::layout_of).unwrap().0;
        let Ok((part, damage)) = torno_trace::read(&file[..at.index(file.len())], RigFile::layout_of) else { return };
        assert!(damage.is_some() && whole.facts.starts_with(&part.facts) && whole.inputs.starts_with(&part.inputs));
    });
}
