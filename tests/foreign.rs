//! Every parser and decoder of bytes that come from outside: what must hold whatever comes.
//!
//! Each takes any bytes, must come to an end, must not panic, and an error of a text must name a place in it. The fuzz
//! targets in `tests/fuzz` and the property tests in `anything.rs` call the same functions.

use std::ops::Range;
use std::sync::LazyLock;

use torno::control::Request;
use torno::fault;
use torno::planning;
use torno::rig::file::{RigFile, RigFileError};
use torno::rig::place;
use torno::scenario::{Scenario, ScenarioError};
use torno::sweep::{self, Grid, Run, Shard, SweepError, Variation};
use torno_bus::Names;
use torno_gcode::{Columns, Dialect, Interpreter, Kind, Settings, interpret};
use torno_planner::{Plan, Side};
use torno_port::LineCoding;
use torno_port::rfc2217::{Request as Request2217, Server};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{
    DepthSubFrame, Frame, Program, ProgramError, Reply, ReplyDecoder, SpindleSubFrame, TransverseSubFrame,
};
use torno_protocol::record::{self, FromBoard, ToBoard};
use torno_protocol::servo::{CHARACTER, Command, CommandDecoder};
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::Character;
use torno_servo::{Language, Limits};
use torno_trace::rows::{Filter, Wanted};
use torno_trace::{Damage, Writer, analyser};

/// A GRBL controller on a bench.
#[path = "../protocol/grbl/tests/common/mod.rs"]
mod controller;

/// A name, and what holds for all bytes.
type Entry = (&'static str, fn(&[u8]));

/// All of them. A fuzz target has the same name.
pub(crate) const ENTRIES: [Entry; 21] = [
    ("rig_file", rig_file),
    ("place", place_in_a_rig),
    ("scenario_file", scenario_file),
    ("fault_file", fault_file),
    ("program", program),
    ("csv", csv),
    ("variation", variation),
    ("sweep_rows", sweep_rows),
    ("quantity", quantity),
    ("request", request),
    ("to_board", to_board),
    ("from_board", from_board),
    ("trace", trace),
    ("trace_blocks", trace_blocks),
    ("motion_program", motion_program),
    ("servo_commands", servo_commands),
    ("lathe_bytes", lathe_bytes),
    ("grbl", controller::answers::hold),
    ("gcode", gcode),
    ("plan", plan),
    ("rfc2217", rfc2217),
];

/// Holds these bytes against the entry of that name.
pub(crate) fn run(name: &str, bytes: &[u8]) {
    let (_, holds) = ENTRIES.iter().find(|entry| entry.0 == name).unwrap_or_else(|| panic!("there is no {name}"));
    holds(bytes);
}

static LATHE: LazyLock<RigFile> = LazyLock::new(|| RigFile::load("lathe").expect("it is built in"));
static NAMES: LazyLock<Names> = LazyLock::new(|| LATHE.names());

/// A name that no file has.
const PATH: &str = "no/such/file";

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Whether there is such a place: a line of the text, and a character of that line, or the one behind it.
fn is_in(text: &str, line: usize, column: usize) -> bool {
    let lines: Vec<&str> = text.split('\n').collect();
    let length = |line: &&str| line.chars().count() + 1;
    (1..=lines.len()).contains(&line) && (1..=length(&lines[line - 1])).contains(&column)
}

/// A complaint begins with the file, a line and a column that there are.
fn is_placed(complaint: &str, text: &str) {
    let rest = complaint.strip_prefix(PATH).and_then(|rest| rest.strip_prefix(':'));
    let mut words = rest.unwrap_or_else(|| panic!("no file: {complaint}")).splitn(3, ':');
    let mut number = || words.next().and_then(|word| word.parse::<usize>().ok());
    let (Some(line), Some(column)) = (number(), number()) else { panic!("no line and column: {complaint}") };
    assert!(is_in(text, line, column), "no such place: {complaint}\n{text:?}");
    assert!(words.next().is_some_and(|what| !what.trim().is_empty()), "nothing is said: {complaint}");
}

fn rig_file(bytes: &[u8]) {
    let text = text(bytes);
    match RigFile::parse(PATH, &text) {
        Ok(file) => {
            assert_eq!(file.layout.lines.len() % 2, 0);
            assert!(file.margin() > Span::ZERO);
            // What has been read is what is read again.
            let again = RigFile::parse(PATH, &file.text).expect("it has been read before");
            assert_eq!(format!("{again:?}"), format!("{file:?}"));
        }
        Err(RigFileError::Invalid(invalid)) => is_placed(&invalid.to_string(), &text),
        Err(other) => panic!("{other}"),
    }
}

/// The first line is a place, the rest its value.
fn place_in_a_rig(bytes: &[u8]) {
    let text = text(bytes);
    let (place, value) = text.split_once('\n').unwrap_or((&text, "1"));
    let mut table: toml::Table = toml::from_str(&LATHE.text).expect("it is built in");
    if let Err(complaint) = place::set(&mut table, place, place::parsed(value)) {
        assert!(!complaint.is_empty());
    }
    match LATHE.with(place, value) {
        Ok(file) => assert_eq!(file.boards.len(), LATHE.boards.len()),
        Err(complaint) => assert!(!complaint.is_empty()),
    }
}

fn scenario_file(bytes: &[u8]) {
    let text = text(bytes);
    // A rig is read from any file that a scenario names: only those that are built in are no matter of chance.
    let named = text.lines().filter_map(|line| line.trim_start().strip_prefix("rig"));
    if named.clone().any(|rest| !["= \"lathe\"", "= \"servo\"", "= \"lathe-dspic\""].contains(&rest.trim())) {
        return;
    }
    match Scenario::parse(PATH, &text, None) {
        Ok(scenario) => drop(format!("{scenario:?}")),
        Err(ScenarioError::Invalid(invalid)) => is_placed(&invalid.to_string(), &text),
        Err(other) => panic!("{other}"),
    }
}

fn fault_file(bytes: &[u8]) {
    let text = text(bytes);
    match fault::parse(PATH, &text, &NAMES, None) {
        Ok(file) => drop(format!("{file:?}")),
        Err(invalid) => is_placed(&invalid.to_string(), &text),
    }
}

fn program(bytes: &[u8]) {
    let text = text(bytes);
    match Program::parse(&text) {
        Ok(program) => {
            assert_eq!(program.bytes().len(), 8 * program.frames.len());
            assert_eq!(program.destinations().len(), program.frames.len());
        }
        Err(ProgramError::NotAByte { line, column, found }) => {
            let there = text.lines().nth(line - 1).expect("a line of it");
            let there: String = there.chars().skip(column - 1).take(found.chars().count()).collect();
            assert_eq!(there, found);
        }
        Err(ProgramError::Length { line, found }) => assert!(found != 8 && (1..=text.lines().count()).contains(&line)),
        Err(ProgramError::Empty) => {}
    }
}

fn csv(bytes: &[u8]) {
    use torno::identify::csv::{CsvError, Encoder, parse};
    let text = text(bytes);
    for (counts_per_rev, bits) in [(None, None), (Some(500.0), None), (None, Some(8))] {
        match parse(PATH, &text, &Encoder { counts_per_rev, bits }) {
            Ok(measured) => assert!(measured.data.period() > 0.0, "{}", measured.data.period()),
            // A carriage return alone ends a line, too.
            Err(CsvError::Invalid(invalid)) => {
                is_placed(&invalid.to_string(), &text.replace("\r\n", "\n").replace('\r', "\n"))
            }
            Err(useless @ CsvError::Useless { .. }) => assert!(useless.to_string().starts_with(PATH)),
            Err(other) => panic!("{other}"),
        }
    }
}

fn variation(bytes: &[u8]) {
    let text = text(bytes);
    match Variation::parse(&text) {
        Ok(variation) => {
            assert!((1..=10_000.max(text.len())).contains(&variation.values.len()));
            let grid = Grid::new(vec![variation.clone()], 0, 1, Shard::WHOLE).unwrap();
            assert_eq!(grid.runs(), variation.values.len() as u64);
        }
        Err(error @ SweepError::Variation { .. }) => assert!(error.to_string().contains(&text)),
        Err(other) => panic!("{other}"),
    }
}

/// Each line is a run of a sweep.
fn sweep_rows(bytes: &[u8]) {
    let text = text(bytes);
    let run = |(n, line): (usize, &str)| Some((format!("file:{}", n + 1), serde_json::from_str::<Run>(line).ok()?));
    let placed: Vec<(String, Run)> = text.lines().enumerate().filter_map(run).collect();
    let given = placed.len();
    match sweep::merge(placed) {
        Ok((runs, missing)) => {
            assert_eq!(runs.len(), given);
            assert!(missing.is_none_or(|missing| missing.count + given as u64 == missing.of));
        }
        Err(error) => assert!(given == 0 || error.to_string().contains("file:"), "{error}"),
    }
}

fn quantity(bytes: &[u8]) {
    let text = text(bytes);
    let said = |complaint: String| assert!(complaint.contains(&text), "{complaint}");
    torno_text::parse_span(&text).map(drop).unwrap_or_else(said);
    torno_text::parse_ratio(&text).map(drop).unwrap_or_else(said);
    match torno_text::parse_length(&text) {
        Ok(mm) => assert!(mm.is_finite()),
        Err(complaint) => said(complaint),
    }
    match torno_text::Range::parse(&text) {
        Some(Ok(range)) => {
            let values = range.extremes().into_iter().chain([0.0, 0.3, 0.999].map(|fraction| range.draw(fraction)));
            // Its unit may be any word.
            let is_number = |value: &str| value.trim_start_matches('-').starts_with(|c: char| c.is_ascii_digit());
            values.for_each(|value| assert!(is_number(&value), "{text}: {value}"));
        }
        Some(Err(complaint)) => said(complaint),
        None => {}
    }
}

fn request(bytes: &[u8]) {
    let text = text(bytes);
    match serde_json::from_str::<Request>(&text) {
        Ok(request) => {
            if let Request::Fault { fault } = &request {
                fault_file(format!("[[fault]]\n{fault}").as_bytes());
            }
            let again = serde_json::to_string(&request).expect("it can be written");
            assert_eq!(serde_json::from_str::<Request>(&again).ok(), Some(request));
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

/// Takes records as a socket does, in pieces: all that is whole is taken, and an error ends it.
fn records<R>(bytes: &[u8])
where
    R: serde::Serialize + serde::de::DeserializeOwned + PartialEq + std::fmt::Debug,
{
    let mut buffer = bytes::BytesMut::new();
    for piece in bytes.chunks(7) {
        buffer.extend_from_slice(piece);
        loop {
            let before = buffer.len();
            match record::decode::<R>(&mut buffer) {
                Ok(None) => break,
                Ok(Some(found)) => {
                    assert!(buffer.len() < before, "nothing was taken");
                    let mut again = bytes::BytesMut::new();
                    record::encode(&found, &mut again).expect("it has been read");
                    assert_eq!(record::decode(&mut again), Ok(Some(found)));
                }
                Err(_) => return,
            }
        }
    }
}

fn to_board(bytes: &[u8]) {
    records::<ToBoard>(bytes);
}

fn from_board(bytes: &[u8]) {
    records::<FromBoard>(bytes);
}

fn trace(bytes: &[u8]) {
    let (trace, damage) = match torno_trace::read(bytes, RigFile::layout_of) {
        Ok(read) => read,
        Err(damage) => return is_placed_in(&damage, bytes),
    };
    if let Some(damage) = &damage {
        is_placed_in(damage, bytes);
    }
    // All of it can be shown.
    let kinds = ["edges", "characters", "frames", "telemetry", "events", "inputs"].map(str::to_owned).into();
    let filter = Filter::new(&trace.header, &Wanted { kinds, ..Wanted::default() }).expect("these are kinds");
    for row in analyser::rows(&trace, &filter, torno_machines::dialect) {
        assert!(!row.text(&trace.header, false).is_empty());
        assert!(row.json(&trace.header).is_object());
        drop(row.csv(&trace.header));
    }
    // And be written again.
    let mut again = Vec::new();
    let mut writer = Writer::new(&mut again, &trace.header).expect("memory takes everything");
    writer.note(&trace.inputs, &trace.facts, trace.settled).expect("memory takes everything");
    if let Some(end) = &trace.end {
        writer.finish(end).expect("memory takes everything");
        let (same, damage) = torno_trace::read(&again[..], RigFile::layout_of).expect("it has just been written");
        assert!(damage.is_none(), "{damage:?}");
        assert_eq!(same.facts, trace.facts);
        assert_eq!(same.inputs, trace.inputs);
    }
}

fn is_placed_in(damage: &Damage, bytes: &[u8]) {
    match damage {
        Damage::Truncated { byte } | Damage::Corrupt { byte } => assert!(*byte <= bytes.len() as u64, "{damage}"),
        Damage::Unreadable(_) => panic!("{damage}"),
        Damage::Foreign | Damage::Version(_) | Damage::NoEnd => {}
    }
}

/// The parts between bytes of 0xa7 are the payloads of blocks: what a checksum alone would turn away is read.
fn trace_blocks(bytes: &[u8]) {
    trace(&blocks(bytes.split(|byte| *byte == 0xa7)));
}

/// A trace of the lathe with these payloads.
pub(crate) fn blocks<'a>(payloads: impl Iterator<Item = &'a [u8]>) -> Vec<u8> {
    let mut file = Vec::new();
    let header = LATHE.header("lathe", 0, None);
    drop(Writer::new(&mut file, &header).expect("memory takes everything"));
    for (number, payload) in (1..).zip(payloads) {
        file.extend((payload.len() as u32).to_le_bytes());
        file.extend(xxhash_rust::xxh3::xxh3_64_with_seed(payload, number).to_le_bytes());
        file.extend(payload);
    }
    file
}

fn motion_program(bytes: &[u8]) {
    let text = text(bytes);
    let compiled = torno_servo::compile(&text, &Limits::default());
    for finding in &compiled.findings {
        for language in [Language::English, Language::Polish] {
            assert!(!finding.message(language).is_empty());
        }
        assert!(is_in(&text, finding.line, finding.column), "{finding:?} in {text:?}");
    }
    match &compiled.program {
        None => assert!(!compiled.findings.is_empty(), "it says nothing of {text:?}"),
        // A day at the most: no more than that has to be in memory.
        Some(program) if program.ticks() < 100_000 => {
            assert_eq!(program.increments(125.0).len(), program.ticks(), "{text:?}");
            assert!(program.graph().iter().all(|(s, mm)| s.is_finite() && mm.is_finite()), "{text:?}");
        }
        Some(program) => assert!(program.seconds().is_finite() && program.end_mm().is_finite()),
    }
}

/// Bytes without a gap; of two alike that follow one another, the second is a silence or a line error by turns.
fn servo_commands(bytes: &[u8]) {
    let mut decoder = CommandDecoder::new(Clock::TRUE);
    let (mut now, mut heard, mut wrong) = (Instant::START, Vec::new(), false);
    let mut before = None;
    for byte in bytes {
        let twice = before.replace(*byte) == Some(*byte);
        wrong ^= twice;
        now += if twice && !wrong { Span::from_millis(60) } else { CHARACTER };
        if let Some(at) = decoder.poll_timeout() {
            assert!(at > now - CHARACTER - Span::from_millis(60));
            heard.extend(decoder.handle_timeout(now));
        }
        heard.extend(decoder.push(now, Character { framing_error: twice && wrong, ..Character::good(*byte) }));
    }
    heard.extend(decoder.handle_timeout(now + Span::from_secs(1)));
    assert!(decoder.poll_timeout().is_none() && heard.len() <= bytes.len() + 1, "{heard:?}");
    for command in heard.into_iter().flatten() {
        assert_eq!(said(&command.emit()), [command]);
    }
}

/// The commands in these bytes, and the silence behind them.
fn said(bytes: &[u8]) -> Vec<Command> {
    let mut decoder = CommandDecoder::new(Clock::TRUE);
    let mut now = Instant::START;
    let mut heard: Vec<_> = Vec::new();
    for byte in bytes {
        now += CHARACTER;
        heard.extend(decoder.push(now, Character::good(*byte)));
    }
    heard.extend(decoder.handle_timeout(now + Span::from_secs(1)));
    heard.into_iter().flatten().collect()
}

/// Bytes from the PC are frames, those to it replies.
fn lathe_bytes(bytes: &[u8]) {
    for frame in bytes.as_chunks().0 {
        if let Ok(read) = Frame::parse(*frame) {
            assert_eq!(read.emit(), *frame);
        }
        let part = |range: Range<usize>| &frame[range];
        let spindle = part(0..1).first_chunk().and_then(|bytes| SpindleSubFrame::parse(*bytes).ok());
        assert!(spindle.is_none_or(|read| read.emit()[..] == frame[..1]));
        let transverse = part(1..5).first_chunk().and_then(|bytes| TransverseSubFrame::parse(*bytes).ok());
        assert!(transverse.is_none_or(|read| read.emit()[..] == frame[1..5]));
        let depth = part(5..8).first_chunk().and_then(|bytes| DepthSubFrame::parse(*bytes).ok());
        assert!(depth.is_none_or(|read| read.emit()[..] == frame[5..]));
    }
    let mut decoder = ReplyDecoder::default();
    let replies: Vec<Reply> = bytes.iter().flat_map(|byte| decoder.push(*byte)).collect();
    let sent: Vec<u8> = replies.iter().flat_map(|reply| reply.emit()).collect();
    assert!(bytes.starts_with(&sent) && bytes.len() - sent.len() < 3, "{replies:?}");
    assert!(replies.iter().all(|reply| !reply.code().is_empty() && !reply.to_string().is_empty()));
}

/// A client of a port that is controlled by RFC 2217: its first byte says how the stream is cut.
fn rfc2217(bytes: &[u8]) {
    let Some((size, bytes)) = bytes.split_first() else { return };
    let new = || Server::new(LineCoding::at(9600), false);
    let (mut whole, mut parts) = (new(), new());
    let data = |requests: Vec<Request2217>| {
        requests.into_iter().flat_map(|request| match request {
            Request2217::Data(bytes) => bytes,
            _ => Vec::new(),
        })
    };
    let expected: Vec<u8> = data(whole.receive(bytes)).collect();
    let cut: Vec<u8> = bytes
        .chunks(usize::from(*size).max(1))
        .flat_map(|part| data(parts.receive(part)).collect::<Vec<u8>>())
        .collect();
    assert_eq!(cut, expected);
    let answers = whole.take_answers();
    assert_eq!(parts.take_answers(), answers);
    // What it says itself at first, and no more than four times what it is told.
    assert!(answers.len() <= 12 + 4 * bytes.len(), "{} for {}", answers.len(), bytes.len());
}

/// A program of either dialect, whole and byte by byte.
fn gcode(bytes: &[u8]) {
    let text = text(bytes).replace("\r\n", "\n").replace('\r', "\n");
    let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
    for dialect in [Dialect::LinuxCnc, Dialect::Fanuc] {
        let settings = Settings { dialect: Some(dialect), steps_max: 2_000, ..Settings::default() };
        let (motions, outcome) = interpret(bytes, &settings);
        for finding in &outcome.findings {
            assert!(is_in(text, finding.line, finding.column), "{finding:?} in {text:?}");
            assert!(!finding.message.is_empty());
        }
        assert_eq!(motions.len() as u64, outcome.motions, "{text:?}");
        for (nth, motion) in (1..).zip(&motions) {
            assert_eq!(motion.to_string().parse().as_ref(), Ok(motion), "{text:?}");
            assert_eq!(motion.kind == Kind::End, nth == motions.len(), "{text:?}");
        }
        let mut again = Vec::new();
        let mut sink = |motion| again.push(motion);
        let mut interpreter = Interpreter::new(&settings);
        bytes.chunks(1).for_each(|byte| interpreter.push(byte, &mut sink));
        assert_eq!(interpreter.finish(&mut sink), outcome, "{text:?}");
        assert_eq!(again, motions, "{text:?}");
    }
}

/// G-code of either dialect, planned for the lathe: it comes to an end, and the master takes each frame.
fn plan(bytes: &[u8]) {
    let text = text(bytes).replace("\r\n", "\n").replace('\r', "\n");
    let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
    for (dialect, side) in [(Dialect::LinuxCnc, Side::Middle), (Dialect::Fanuc, Side::Outside)] {
        let planning = planning::settings(&LATHE, None, side).expect("it is built in");
        let start = torno_gcode::Place { x: planning.start.x, z: planning.start.z, ..torno_gcode::Place::default() };
        let settings = Settings { dialect: Some(dialect), steps_max: 500, start, home: start, ..Settings::default() };
        let (motions, _) = interpret(bytes, &settings);
        let slot = planning.scale.infeed.mm_per_slot;
        let mut plan: Plan<_> =
            torno_planner::plan(torno_planner::Settings { frames_max: 2_000, ..planning }, motions.into_iter());
        let frames: Vec<_> = plan.by_ref().collect();
        let report = plan.report();
        // Each motion and each end of travel may make a frame or two more than is counted.
        assert!(frames.len() as u64 == report.frames && frames.len() < 3_000, "{} in {text:?}", frames.len());
        for planned in &frames {
            assert_eq!(Frame::parse(planned.frame.emit()), Ok(planned.frame), "{text:?}");
        }
        let mut columns = Columns::new(report.findings.iter().map(|finding| (finding.line, finding.word)));
        columns.push(bytes);
        for (finding, column) in report.findings.iter().zip(columns.finish()) {
            assert!(is_in(text, finding.line.max(1), column), "{finding:?} at {column} in {text:?}");
            assert!(!finding.message.is_empty());
        }
        let bound = if side == Side::Middle { 0.5 * slot } else { slot };
        assert!(report.refused || report.worst.x <= bound + 1e-6, "{:?} in {text:?}", report.worst);
    }
}
