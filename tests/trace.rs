//! Traces from outside: recorded by `run` and `up`, then printed, exported, repeated and compared.

use std::collections::BTreeSet;
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Output, Stdio};
use std::time::Duration;

use crate::common::{ACK, LONG, NAK, SHORT, Up, XOFF, XON, folder, json, kill, output, torno, wait_until};
use crate::ears;
use serde_json::Value;
use serialport::SerialPort;
use torno::fault;
use torno::play::Play;
use torno::recorder::Recorder;
use torno::rig::Driver;
use torno::rig::file::RigFile;
use torno_protocol::lathe::Program;
use torno_protocol::time::{Instant, Span};
use torno_trace::analyser::{self, Analyser};
use torno_trace::rows::{Filter, Row, Wanted};

/// Depth 5 slots out: about three seconds.
const MEDIUM: [u8; 8] = [0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x05, 0x00];
/// Feed 30000 counts at 1 count per 30 ms: a quarter of an hour.
const LONG_FEED: [u8; 8] = [0, 0x01, 0x75, 0x30, 0, 0, 0, 0];
/// Spindle to 2000 rpm: it coasts for long when it is no longer driven.
const SPIN: [u8; 8] = [0x64, 0, 0, 0, 0, 0, 0, 0];

fn word(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

fn complaint(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// Runs the demonstration, or what the arguments say, with a recording; gives the trace and what was printed.
fn recorded(folder: &Path, name: &str, arguments: &[&str]) -> (PathBuf, Value) {
    let path = folder.join(name);
    let output = output(&[&["run", "--json", "--record", word(&path)], arguments].concat());
    (path, json(&output))
}

/// A command on a trace, which must end like this.
fn on(code: i32, arguments: &[&str]) -> Output {
    let output = output(arguments);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {}{}", stdout(&output), complaint(&output));
    assert!(!complaint(&output).contains("panicked"), "{}", complaint(&output));
    output
}

fn program(folder: &Path, name: &str, frames: &[[u8; 8]]) -> PathBuf {
    let line = |frame: &[u8; 8]| frame.map(|byte| format!("{byte:02x}")).join(" ");
    let path = folder.join(name);
    fs::write(&path, frames.iter().map(line).collect::<Vec<_>>().join("\n")).unwrap();
    path
}

// --- recording ------------------------------------------------------------------------------------------------------

#[test]
fn a_run_that_is_recorded_is_repeated_with_the_same_digest() {
    let folder = folder();
    let failing = program(folder.path(), "failing.frames", &[[9; 8], SHORT, SHORT]);
    for arguments in [&[][..], &["--in-process"], &["--pace", "1000"], &["--pace", "50"], &[word(&failing)]] {
        let (trace, summary) = recorded(folder.path(), "run.trace", arguments);
        for driver in [&[][..], &["--processes"]] {
            let output = on(0, &[&["replay", word(&trace)], driver].concat());
            let digest = summary["digest"].as_str().unwrap();
            assert!(stdout(&output).starts_with(&format!("same digest {digest}: ")), "{}", stdout(&output));
        }
    }
}

#[test]
fn recording_changes_nothing() {
    let folder = folder();
    let (_, with) = recorded(folder.path(), "run.trace", &[]);
    let without = json(&output(&["run", "--json"]));
    assert_eq!((&with["digest"], &with["frames"]), (&without["digest"], &without["frames"]));
}

#[test]
fn a_recording_is_private_and_overwrites_nothing_but_a_trace() {
    let folder = folder();
    let (trace, _) = recorded(folder.path(), "run.trace", &[]);
    assert_eq!(fs::metadata(&trace).unwrap().permissions().mode() & 0o777, 0o600);
    let length = fs::metadata(&trace).unwrap().len();
    recorded(folder.path(), "run.trace", &[]);
    assert_eq!(fs::metadata(&trace).unwrap().len(), length);

    let letter = folder.path().join("letter");
    fs::write(&letter, "Dear torno").unwrap();
    let missing = folder.path().join("missing/run.trace");
    for command in ["run", "up"] {
        let output = on(2, &[command, "--record", word(&letter)]);
        assert!(complaint(&output).contains("is no trace, and is left as it is"), "{}", complaint(&output));
        let output = on(2, &[command, "--record", word(&missing)]);
        assert!(complaint(&output).contains("cannot record to"), "{}", complaint(&output));
    }
    assert_eq!(fs::read_to_string(&letter).unwrap(), "Dear torno");
}

#[test]
fn a_full_disk_ends_a_run_and_says_how_far_the_recording_is_good() {
    for command in ["run", "up"] {
        let output = on(3, &[command, "--record", "/dev/full"]);
        assert!(complaint(&output).contains("it is good for nothing yet: No space left"), "{}", complaint(&output));
    }
    let folder = folder();
    let trace = folder.path().join("run.trace");
    let torno = env!("CARGO_BIN_EXE_torno");
    // Files may have no more than 80 blocks of 512 bytes or 1 KiB: the demonstration has 105 KiB.
    let script = format!("trap '' XFSZ; ulimit -f 80; exec {torno} run --record {}", word(&trace));
    let output = std::process::Command::new("sh").args(["-c", &script]).output().unwrap();
    assert_eq!(output.status.code(), Some(3), "{}", complaint(&output));
    assert_eq!(stdout(&output), "");
    assert!(complaint(&output).contains("cannot go on; it is good"), "{}", complaint(&output));
    let output = on(2, &["trace", word(&trace)]);
    assert!(complaint(&output).contains("ends within a block"), "{}", complaint(&output));
}

// --- a rig that is up -----------------------------------------------------------------------------------------------

/// A rig at pace 20 that is recorded.
fn up(folder: &Path) -> (Up, PathBuf) {
    let trace = folder.join("up.trace");
    (Up::start(&["--pace", "20", "--record", word(&trace)]), trace)
}

/// Is silent for 400 ms of a rig at pace 20, after which the master takes whatever comes for a new frame. Silence is
/// not waited for, it is what the PC does here.
fn keep_silent() {
    std::thread::sleep(Duration::from_millis(400) / 20);
}

/// Ends it as Ctrl-C does.
fn end(up: Up) {
    end_with(0, up);
}

/// The same, with this exit status: 1 if a board has died.
fn end_with(code: i32, mut up: Up) {
    kill("-INT", up.pid());
    assert_eq!(up.child.wait().unwrap().code(), Some(code));
}

fn repeats(trace: &Path) {
    for driver in [&[][..], &["--processes"]] {
        let output = on(0, &[&["replay", word(trace)], driver].concat());
        assert!(stdout(&output).starts_with("same digest "), "{}", stdout(&output));
    }
    // Each board does the same by itself.
    let lines = trace.with_extension("vcd");
    on(0, &["trace", word(trace), "--vcd", word(&lines), "--pins"]);
}

#[test]
fn what_a_client_and_signals_did_is_repeated_with_the_same_digest() {
    let folder = folder();
    let (up, trace) = up(folder.path());
    let mut pc = up.pc();
    pc.write(&[SHORT, SHORT].concat());
    pc.expect(&[ACK, XOFF, XON, ACK, XON]);
    pc.write(&SHORT[..5]);
    pc.expect(&[NAK, b'c']);
    // At a wrong speed the master understands nothing, and neither does the client.
    pc.port.set_baud_rate(4800).unwrap();
    pc.write(&SHORT);
    up.wait_for_log("sets 4800 baud");
    up.wait_for_log("frame refused: line error");
    pc.read(1);
    keep_silent();
    pc.port.set_baud_rate(9600).unwrap();
    let garbage = pc.port.bytes_to_read().unwrap();
    pc.read(garbage as usize);
    pc.write(&MEDIUM);
    pc.expect(&[ACK]);
    kill("-STOP", up.board("depth"));
    up.wait_for_log("was stopped");
    kill("-CONT", up.board("depth"));
    up.wait_for_log("was continued");
    // Asked meanwhile, it may have been given up.
    while pc.read(1) != [XON] {}
    keep_silent();
    pc.write(&LONG_FEED);
    pc.expect(&[ACK]);
    pc.write(&SHORT[..3]);
    end(up);
    repeats(&trace);

    let shown = stdout(&on(0, &["trace", word(&trace)]));
    for expected in [
        "< writes 0A E1 00 E1 00 00 01 00",
        "> frame: spindle 200 rpm, transverse +225 counts at 225 per 30 ms, depth +1 slots",
        "! frame cut short after 5 of 8 bytes",
        "! NAK: a frame is refused (cut short)",
        "< sets 4800 baud, XON/XOFF off",
        "depth                  < process stopped: hangs",
        "depth                  < process continued",
        "> XOFF: a frame is held",
    ] {
        assert!(shown.contains(expected), "lacks {expected}:\n{shown}");
    }
    // A line shows what the master has heard: what the PC has written, until it sets another speed.
    let lines = on(0, &["trace", word(&trace), "--line", "pc_to_master", "--kind", "characters", "--json"]);
    let byte = |line: &str| serde_json::from_str::<Value>(line).unwrap()["byte"].as_u64().unwrap() as u8;
    let bytes: Vec<u8> = stdout(&lines).lines().map(byte).collect();
    let expected = [&SHORT[..], &SHORT, &SHORT[..5]].concat();
    assert_eq!(bytes[..expected.len()], expected);
    let (recording, _) = torno_trace::read(fs::File::open(&trace).unwrap(), RigFile::layout_of).unwrap();
    let from_pc = |errors: BTreeSet<(u64, String)>| -> Vec<u64> {
        errors.into_iter().filter(|(_, line)| line == "pc_to_master").map(|(ns, _)| ns).collect()
    };
    let errors = from_pc(ears::told(&recording));
    assert!(!errors.is_empty(), "the master has met none");
    assert_eq!(errors, from_pc(ears::marked(&recording)));
}

#[test]
fn boards_that_die_or_stay_stopped_are_repeated_with_the_same_digest() {
    let folder = folder();
    let (up, trace) = up(folder.path());
    let mut pc = up.pc();
    pc.write(&SPIN);
    pc.expect(&[ACK, XON]);
    // The spindle turns, and tells so.
    pc.write(&LONG);
    pc.expect(&[ACK]);
    kill("-KILL", up.board("spindle"));
    up.wait_for_log("died: signal: 9");
    kill("-STOP", up.board("depth"));
    up.wait_for_log("was stopped");
    up.wait_for_log("slave 'd' does not answer");
    end_with(1, up);
    repeats(&trace);
}

#[test]
fn noise_goes_on_whoever_is_lost_and_is_repeated_with_the_same_digest() {
    let folder = folder();
    let faults = folder.path().join("noise.toml");
    let cases = [
        ("depth_to_master", "-KILL", "depth", false),
        ("master_to_depth", "-KILL", "depth", false),
        ("depth_to_master", "-STOP", "master", false),
        ("master_to_depth", "-STOP", "master", true),
        ("pc_to_master", "-STOP", "master", true),
    ];
    for (n, (line, signal, board, goes_on)) in cases.into_iter().enumerate() {
        let noise = format!("[[fault]]\nline = \"{line}\"\nkind = \"noise\"\nperiod = \"2 ms\"\n");
        fs::write(&faults, noise).unwrap();
        let trace = folder.path().join(format!("{n}.trace"));
        let up = Up::start(&["--pace", "5", "--faults", word(&faults), "--record", word(&trace)]);
        // Behind the noise on its line the master may not understand; that changes nothing here.
        let mut pc = up.pc();
        pc.write(&LONG);
        pc.read(1);
        kill(signal, up.board(board));
        up.wait_for_log(if signal == "-KILL" { "died: signal: 9" } else { "was stopped" });
        let state = || json(&output(&["ctl", "--json", "--socket", up.ready["control"].as_str().unwrap(), "state"]));
        let lost_at = state()["ns"].as_u64().unwrap();
        wait_until("a second is over", || state()["ns"].as_u64().unwrap() > lost_at + 1_000_000_000);
        if goes_on {
            kill("-CONT", up.board(board));
            up.wait_for_log("was continued");
        }
        end_with(i32::from(signal == "-KILL"), up);
        repeats(&trace);
    }
}

#[test]
fn a_client_that_nobody_hears_is_repeated_with_the_same_digest() {
    let folder = folder();
    let trace = folder.path().join("up.trace");
    let up = Up::start(&["--pace", "max", "--record", word(&trace)]);
    kill("-KILL", up.board("master"));
    up.wait_for_log("died: signal: 9");
    let mut pc = up.pc();
    for n in 1..4 {
        pc.write(&SHORT);
        // What the PC has sent by then stays sent.
        let arguments = ["trace", word(&trace), "--board", "pc", "--kind", "events"];
        wait_until("it is on the line", || stdout(&output(&arguments)).lines().count() == 8 * n);
    }
    end_with(1, up);
    repeats(&trace);
}

#[test]
fn a_recording_whose_writer_is_killed_is_repeated_as_far_as_it_goes() {
    let folder = folder();
    let (mut up, trace) = up(folder.path());
    let mut pc = up.pc();
    pc.write(&SHORT);
    pc.expect(&[ACK, XON]);
    wait_until("the reply is in the trace", || shows(&trace, "XON: all slaves are done"));
    pc.write(&LONG);
    pc.expect(&[ACK]);
    wait_until("the rest comes by and by", || shows(&trace, "depth +400 slots"));
    kill("-KILL", up.pid());
    up.child.wait().unwrap();
    let output = on(2, &["trace", word(&trace)]);
    assert!(complaint(&output).contains("its writer was ended"), "{}", complaint(&output));
    let output = on(2, &["replay", word(&trace)]);
    assert!(stdout(&output).starts_with("the same as far as it is recorded: "), "{}", stdout(&output));
    assert!(complaint(&output).contains("its writer was ended"), "{}", complaint(&output));
}

/// A process that does not outlive its test.
struct Killed(Child);

impl Drop for Killed {
    fn drop(&mut self) {
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

/// What a recording shows by now.
fn shows(trace: &Path, text: &str) -> bool {
    stdout(&output(&["trace", word(trace)])).contains(text)
}

#[test]
fn a_run_that_is_killed_has_recorded_all_but_its_last_second() {
    let folder = folder();
    let trace = folder.path().join("run.trace");
    let long = program(folder.path(), "long.frames", &[LONG_FEED]);
    let mut run = Killed(torno(&["run", word(&long), "--pace", "1", "--record", word(&trace)]).spawn().unwrap());
    // Far less than a block; and for a quarter of an hour nothing more is said.
    wait_until("the frame and its reply are in the trace", || shows(&trace, "> ACK: the frame"));
    wait_until("what the motor does follows", || shows(&trace, "position_counts = 20\n"));
    run.0.kill().unwrap();
    run.0.wait().unwrap();
    let output = on(2, &["trace", word(&trace)]);
    assert!(complaint(&output).contains("its writer was ended"), "{}", complaint(&output));
    assert!(stdout(&output).contains("> frame: "), "{}", stdout(&output));
    on(2, &["replay", word(&trace)]);
}

// --- printing and exporting -----------------------------------------------------------------------------------------

#[test]
fn the_waveforms_of_a_trace_are_those_of_the_run() {
    let folder = folder();
    let (a, b) = (folder.path().join("a.vcd"), folder.path().join("b.vcd"));
    let (trace, _) = recorded(folder.path(), "run.trace", &["--vcd", word(&a)]);
    assert_eq!(stdout(&on(0, &["trace", word(&trace), "--vcd", word(&b)])), "");
    assert!(fs::read(&a).unwrap() == fs::read(&b).unwrap());
}

#[test]
fn filters_show_what_they_name_and_nothing_else() {
    let folder = folder();
    let (trace, _) = recorded(folder.path(), "run.trace", &[]);
    let shown = |arguments: &[&str]| stdout(&on(0, &[&["trace", word(&trace)], arguments].concat()));
    let first = shown(&["--line", "pc_to_master", "--kind", "characters", "--to", "0.012"]);
    assert_eq!(first, "    0.010996094  pc_to_master             4B  'K'\n");
    let frames = shown(&["--line", "pc_to_master", "--kind", "frames"]);
    assert_eq!(frames.lines().count(), 30);
    let edges = shown(&["--line", "pc_to_master", "--kind", "edges", "--from", "0.01", "--to", "0.011"]);
    assert_eq!(edges.lines().count(), 8, "{edges}");
    let replies = shown(&["--line", "master_to_pc", "--kind", "frames"]);
    let of = |text: &str| replies.matches(text).count();
    assert_eq!((of("> ACK"), of("> XOFF"), of("!")), (30, 29, 0), "{replies}");
    let both = shown(&["--board", "depth", "--line", "depth_to_master", "--kind", "events", "--kind", "frames"]);
    assert_eq!((both.matches("* done").count(), both.matches("> ACK: done").count()), (30, 30));
    assert_eq!(shown(&["--kind", "frames"]).matches('!').count(), 0);
    assert!(!shown(&[]).contains('\x1b'), "no colour into a pipe");

    let csv = shown(&["--csv", "--board", "spindle"]);
    assert!(csv.starts_with("time_s,board,quantity,value\n0.019303385,spindle,set_point_rpm,1500\n"), "{csv}");
    let telemetry = shown(&["--board", "spindle", "--kind", "telemetry"]);
    assert_eq!(csv.lines().count(), telemetry.lines().count() + 1);
}

/// Whoever watches a rig while it runs sees what a trace of it shows.
#[test]
fn an_analyser_shows_the_same_however_it_is_asked() {
    let folder = folder();
    let (path, _) = recorded(folder.path(), "a.torno", &["--in-process"]);
    let (trace, _) = torno_trace::read(BufReader::new(fs::File::open(path).unwrap()), RigFile::layout_of).unwrap();
    let kinds = ["edges", "characters", "frames", "telemetry", "events", "inputs"].map(str::to_owned).to_vec();
    let filter = Filter::new(&trace.header, &Wanted { kinds, ..Wanted::default() }).unwrap();
    let mut analyser = Analyser::new(&trace.header, filter.clone(), torno_machines::dialect);
    analyser.note(&trace.inputs, &[]);
    let (mut rows, mut until) = (Vec::new(), Instant::START);
    while until < trace.until() {
        let from = until;
        until += Span::from_micros(777_777);
        let new = trace.facts.iter().filter(|fact| (from..until).contains(&fact.at()));
        analyser.note(&[], &new.cloned().collect::<Vec<_>>());
        rows.extend(analyser.take(until));
    }
    rows.extend(analyser.end());
    let text = |rows: &[Row]| {
        let mut text: Vec<String> = rows.iter().map(|row| row.text(&trace.header, false)).collect();
        text.sort();
        text
    };
    assert!(rows.len() > 10_000);
    assert_eq!(text(&rows), text(&analyser::rows(&trace, &filter, torno_machines::dialect)));
}

#[test]
fn an_unknown_name_is_answered_with_the_nearest() {
    let folder = folder();
    let (trace, _) = recorded(folder.path(), "run.trace", &[]);
    for (arguments, expected) in [
        (["--line", "pc_to_mastr"], "unknown line 'pc_to_mastr': did you mean 'pc_to_master'?"),
        (["--board", "dept"], "unknown board 'dept': did you mean 'depth'?"),
        (["--kind", "event"], "unknown kind 'event': did you mean 'events'?"),
        (["--from", "soon"], "expected a time, such as '1.5 s'"),
    ] {
        let output = on(2, &[&["trace", word(&trace)], &arguments[..]].concat());
        assert!(complaint(&output).contains(expected), "{}", complaint(&output));
        assert_eq!(stdout(&output), "");
    }
}

#[test]
fn a_reader_that_has_seen_enough_is_no_error() {
    let folder = folder();
    let (trace, _) = recorded(folder.path(), "run.trace", &[]);
    let mut command = torno(&["trace", word(&trace)]);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut first = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut first).unwrap();
    assert!(child.wait().unwrap().success());
    let mut complaint = String::new();
    child.stderr.unwrap().read_to_string(&mut complaint).unwrap();
    assert_eq!(complaint, "");
}

#[test]
fn a_file_that_is_no_whole_trace_is_shown_as_far_as_it_goes() {
    let folder = folder();
    let (trace, _) = recorded(folder.path(), "run.trace", &[]);
    let bytes = fs::read(&trace).unwrap();
    let rows = stdout(&on(0, &["trace", word(&trace)])).lines().count();
    let broken = folder.path().join("broken.trace");
    let mut changed = bytes.clone();
    changed[bytes.len() - 100] ^= 1;
    for (content, expected, some) in [
        (&bytes[..bytes.len() - 100], "ends within a block at byte", true),
        (&changed, "is damaged: the block at byte", true),
        (&bytes[..4], "is no trace: expected a file that", false),
        (b"solid torno\n", "is no trace: expected a file that", false),
        (b"", "is no trace", false),
    ] {
        fs::write(&broken, content).unwrap();
        let output = on(2, &["trace", word(&broken)]);
        assert!(complaint(&output).contains(expected), "{}", complaint(&output));
        let shown = stdout(&output).lines().count();
        assert!(if some { 0 < shown && shown < rows } else { shown == 0 }, "{shown} of {rows}");
        let page = folder.path().join("page.html");
        for arguments in [
            &["trace", word(&broken), "--json"][..],
            &["trace", word(&broken), "--csv"],
            &["trace", word(&broken), "--vcd", word(&folder.path().join("lines.vcd"))],
            &["trace", word(&broken), "--report", word(&page)],
            &["diff", word(&trace), word(&broken)],
            &["diff", word(&broken), word(&broken)],
            &["replay", word(&broken)],
            &["replay", word(&broken), "--json"],
        ] {
            let output = on(2, arguments);
            assert!(complaint(&output).contains(expected), "{arguments:?}: {}", complaint(&output));
            let shown = !stdout(&output).is_empty() || arguments.contains(&"--vcd") || arguments.contains(&"--report");
            assert!(shown || !some, "{arguments:?}");
        }
        assert_eq!(page.exists(), some);
        fs::remove_file(&page).ok();
    }
    let output = on(2, &["trace", word(&folder.path().join("missing"))]);
    assert!(complaint(&output).contains("missing': cannot be read: No such file"), "{}", complaint(&output));
}

// --- comparing ------------------------------------------------------------------------------------------------------

#[test]
fn two_traces_of_the_same_are_identical() {
    let folder = folder();
    let (a, _) = recorded(folder.path(), "a.trace", &[]);
    let (b, _) = recorded(folder.path(), "b.trace", &["--in-process", "--pace", "5000"]);
    assert!(stdout(&on(0, &["diff", word(&a), word(&b)])).starts_with("identical: "));
    assert_eq!(json(&on(0, &["diff", "--json", word(&a), word(&b)]))["identical"], true);
}

#[test]
fn the_first_difference_is_named() {
    let folder = folder();
    let slower = {
        let mut frame = SHORT;
        frame[1] = 0xe0;
        frame
    };
    let one = program(folder.path(), "one.frames", &[SHORT, SHORT]);
    let two = program(folder.path(), "two.frames", &[SHORT, slower]);
    let (a, _) = recorded(folder.path(), "a.trace", &[word(&one)]);
    let (b, _) = recorded(folder.path(), "b.trace", &[word(&two)]);
    let shown = stdout(&on(1, &["diff", word(&a), word(&b)]));
    // The ninth character follows eight: 10 ms and 80 bits after the start.
    assert!(shown.starts_with("first difference at 0.0"), "{shown}");
    assert!(shown.contains(" on pc\n") || shown.contains(" on pc_to_master\n"), "{shown}");
    assert!(shown.contains("sent 225") && shown.contains("sent 224"), "{shown}");
    assert!(shown.contains("> sub-frame: spindle 200 rpm"), "what was before is shown:\n{shown}");
    let difference = json(&on(1, &["diff", "--json", word(&a), word(&b)]));
    assert_eq!(difference["identical"], false);
    assert_eq!(difference["difference"]["place"], "pc");

    let rig = folder.path().join("my.toml");
    let lathe = include_str!("../harness/builtin/lathe.toml");
    fs::write(&rig, lathe.replace("tx_fifo = 1 ", "clock_ppm = 50\ntx_fifo = 1 ")).unwrap();
    let (c, _) = recorded(folder.path(), "c.trace", &[word(&rig), word(&one)]);
    let shown = stdout(&on(1, &["diff", word(&a), word(&c)]));
    assert!(shown.contains("the line goes high, in character 0A  LF, of frame: spindle 200 rpm"), "{shown}");
}

// --- what breaks on the way -----------------------------------------------------------------------------------------

#[test]
fn cuts_and_stimuli_are_repeated_with_the_same_digest() {
    let folder = folder();
    let path = folder.path().join("play.trace");
    let file = RigFile::load("lathe").unwrap();
    let at = |line_or_board: &str, kind: &str, ms: u64| {
        format!("[[fault]]\n{line_or_board}\nkind = \"{kind}\"\nat = \"{ms} ms\"\n")
    };
    let faults = [
        at("line = \"depth_to_master\"", "cut", 300),
        at("board = \"transverse\"", "stall", 400),
        at("board = \"spindle\"\nfor = \"600 ms\"", "hang", 100),
        at("board = \"master\"", "reset", 22),
    ];
    let faults = fault::parse("faults.toml", &faults.concat(), &file.names(), None).unwrap().faults;
    let header = file.header("lathe", 0, Some("test"));
    let recorder = Recorder::begin(&path, Recorder::open(&path).unwrap(), &header).unwrap();
    let program = Program { frames: vec![SHORT, MEDIUM] };
    let play = Play { faults, ..Play::new(file, program, Driver::InProcess) };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let played = runtime.block_on(play.record(Some(recorder), |_| (), std::future::pending())).unwrap();
    let output = on(0, &["replay", word(&path)]);
    assert!(stdout(&output).starts_with(&format!("same digest {}", played.digest)));
    let shown = stdout(&on(0, &["trace", word(&path), "--kind", "inputs"]));
    for expected in ["fault 1: is cut", "shaft blocked", "hangs", "runs on", "is reset"] {
        assert!(shown.contains(expected), "{shown}");
    }
}

#[test]
fn a_recording_that_is_over_leaves_its_file_free_whoever_still_has_a_copy_of_the_descriptor() {
    let folder = folder();
    let path = folder.path().join("a.torno");
    let file = Recorder::open(&path).unwrap();
    // As a process has it that is being started.
    let copy = file.try_clone().unwrap();
    let header = RigFile::load("lathe").unwrap().header("lathe", 0, None);
    let recorder = Recorder::begin(&path, file, &header).unwrap();
    Recorder::open(&path).unwrap_err();
    drop(recorder);
    Recorder::open(&path).unwrap();
    drop(copy);
}

/// Faults at instants, in steps, by what is seen and by what is heard; on lines and boards. Its last step fails.
const SCENARIO: &str = r#"
name = "everything at once"
rig = "lathe"
seed = 7

[[fault]]
name = "noise"
line = "spindle_to_master"
kind = "noise"
period = "2ms"
width = "60us"
at = "30ms"
for = "200ms"

[[fault]]
name = "flip"
line = "pc_to_master"
kind = "flip"
nth = 11
value = 3

[[fault]]
name = "stall"
board = "depth"
kind = "stall"
for = "300ms"
when = { board = "depth", quantity = "position_counts", at_least = 1 }

[[fault]]
name = "slow"
board = "master"
kind = "slow"
value = "300us"
when = { line = "pc_to_master", character = 4 }
for = "1s"

[[step]]
does = "sends a frame"
send = ["0A E1 00 E1 00 00 03 00"]

[[step]]
does = "awaits the reply"
wait = { reply = "ACK", within = "1s" }

[[step]]
does = "breaks the cable"
break = { name = "short", line = "depth_to_master", kind = "short", with = "transverse_to_master" }

[[step]]
does = "sends another"
send = ["0A E1 00 E1 00 00 01 00"]

[[step]]
does = "lets time pass"
run = "150ms"

[[step]]
does = "mends the cable"
heal = "short"

[[step]]
does = "lets time pass"
run = "900ms"

[[step]]
does = "looks"
check = { board = "depth", quantity = "position_counts", equals = -99 }
"#;

#[test]
fn a_scenario_is_repeated_with_the_same_digest() {
    let folder = folder();
    let (path, trace) = (folder.path().join("all.toml"), folder.path().join("test.trace"));
    fs::write(&path, SCENARIO).unwrap();
    for driver in [&[][..], &["--processes"]] {
        let tested = json(&on(1, &[&["test", "--json", word(&path), "--record", word(&trace)], driver].concat()));
        repeats(&trace);
        let shown = stdout(&on(0, &["replay", word(&trace)]));
        assert!(shown.contains(tested["digest"].as_str().unwrap()), "{shown}\n{tested}");
        let shown = stdout(&on(0, &["trace", word(&trace), "--kind", "inputs"]));
        for expected in [
            "spindle_to_master      < fault ",
            "noise, a pulse of up to ",
            "pc_to_master           < fault ",
            "character 11 from here has bit 3 flipped",
            "depth                  < shaft blocked",
            "depth                  < shaft free",
            "master                 < takes ",
            "master                 < is slow no more",
            "touches transverse_to_master",
            " ends\n",
        ] {
            assert!(shown.contains(expected), "lacks {expected}:\n{shown}");
        }
    }
}

#[test]
fn one_scenario_is_recorded_and_no_more() {
    let folder = folder();
    let (path, trace) = (folder.path().join("all.toml"), folder.path().join("test.trace"));
    fs::write(&path, SCENARIO).unwrap();
    let output = on(2, &["test", word(&path), word(&path), "--record", word(&trace)]);
    assert!(complaint(&output).contains("--record: expected one scenario, found 2"), "{}", complaint(&output));
    assert!(!trace.exists());
}
