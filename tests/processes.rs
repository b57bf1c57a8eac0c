//! Boards as processes: killed, stopped, continued, and what is left when the harness ends.

#![allow(clippy::disallowed_methods, reason = "processes live and die by the wall clock")]

use std::collections::BTreeSet;
use std::fs;
use std::io::Read;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Output, Stdio};
use std::time::{Duration, Instant};

use crate::common::{ACK, AT_REST, CAN, LONG, NAK, PATIENCE, Pc, SHORT, Up, XOFF, XON};
use crate::common::{folder, is_alive, json, kill, torno, wait_until};

const BOARDS: [&str; 4] = ["master", "spindle", "transverse", "depth"];

/// Spindle to 200 rpm, and nothing else.
const SPINDLE: [u8; 8] = [0x0a, 0, 0, 0, 0, 0, 0, 0];
/// Depth 400 slots, and feed 1000 counts at 1 count per 30 ms: half a minute.
const BOTH: [u8; 8] = [0, 0x01, 0x03, 0xe8, 0, 0x01, 0x90, 0];
/// Feed 30000 counts at 1 count per 30 ms: a quarter of an hour.
const LONG_FEED: [u8; 8] = [0, 0x01, 0x75, 0x30, 0, 0, 0, 0];
/// Feed 225 counts: a fraction of a second.
const FEED: [u8; 8] = [0, 0xe1, 0x00, 0xe1, 0, 0, 0, 0];
/// Depth 10 slots out: seven seconds.
const FAR_OUT: [u8; 8] = [0, 0, 0, 0, 0, 0, 10, 0];
/// Depth 2 slots out, and in.
const OUT: [u8; 8] = [0, 0, 0, 0, 0, 0, 2, 0];
const IN: [u8; 8] = [0, 0, 0, 0, 0, 0, 2, 1];

/// Virtual seconds of the log's last line that says this.
fn logged_at(log: &str, text: &str) -> f64 {
    let line = log.lines().rfind(|line| line.contains(text)).unwrap_or_else(|| panic!("not logged: {text}\n{log}"));
    let stamp: String = line.trim_start().chars().take_while(|c| c.is_ascii_digit() || *c == '.').collect();
    stamp.parse().unwrap_or_else(|_| panic!("no time: {line}"))
}

fn distributed(up: &Up) -> usize {
    up.log().matches(" distributed").count()
}

/// Is silent for 60 ms of a rig at pace 20, after which the master takes whatever comes for a new frame. Silence is not
/// waited for, it is what the PC does here.
fn keep_silent() {
    std::thread::sleep(Duration::from_millis(60) / 20);
}

/// A rig at this pace, with a frame under way.
fn in_motion(pace: &str, frame: [u8; 8]) -> (Up, Pc) {
    let up = Up::start(&["--pace", pace]);
    let mut pc = up.pc();
    pc.write(&frame);
    pc.expect(&[ACK]);
    (up, pc)
}

// --- a board dies or is stopped -------------------------------------------------------------------------------------

#[test]
fn a_slave_that_is_killed_in_motion_is_reported_within_three_seconds_and_the_rest_goes_on() {
    for (board, frame) in [("depth", LONG), ("transverse", LONG_FEED)] {
        let (up, mut pc) = in_motion("20", frame);
        kill("-KILL", up.board(board));
        let letter = board.as_bytes()[0];
        pc.expect(&[CAN, letter, b'n', XON]);

        let (died, told) = ("died: signal: 9 (SIGKILL)", format!("slave '{}' does not answer", char::from(letter)));
        up.wait_for_log(&format!("board '{board}' (pid {}) {died}", up.board(board)));
        let (died, told) = (logged_at(&up.log(), died), logged_at(&up.log(), &told));
        assert!(died <= told && told < died + 3.0, "died at {died} s, told at {told} s");

        let (others, its) = if board == "depth" { (FEED, OUT) } else { (OUT, FEED) };
        for _ in 0..2 {
            keep_silent();
            pc.write(&others);
            pc.expect(&[ACK, XON]);
            keep_silent();
            pc.write(&its);
            pc.expect(&[NAK, b'f']);
        }
        assert!(pc.is_silent());
        assert_eq!(distributed(&up), 3);
    }
}

#[test]
fn a_slave_that_is_killed_in_motion_at_the_pace_of_the_clock_is_reported_within_three_seconds_of_it() {
    let (up, mut pc) = in_motion("1", LONG);
    let start = Instant::now();
    kill("-KILL", up.board("depth"));
    pc.expect(&[CAN, b'd', b'n', XON]);
    assert!(start.elapsed() < Duration::from_secs(3), "{:?}", start.elapsed());
}

#[test]
fn a_slave_that_is_killed_at_rest_is_missed_by_the_next_frame_that_needs_it() {
    let up = Up::start(&["--pace", "20"]);
    let mut pc = up.pc();
    // Then the master knows its slaves.
    pc.write(&SPINDLE);
    pc.expect(&[ACK, XON]);
    kill("-KILL", up.board("depth"));
    up.wait_for_log("board 'depth'");
    pc.write(&OUT);
    pc.expect(&[ACK, CAN, b'd', b'n', XON]);
    keep_silent();
    pc.write(&SPINDLE);
    pc.expect(&[ACK, XON]);
    assert!(pc.is_silent());
}

#[test]
fn a_frame_that_is_held_when_a_slave_dies_is_never_executed() {
    let (up, mut pc) = in_motion("20", LONG);
    pc.write(&FEED);
    pc.expect(&[XOFF]);
    kill("-KILL", up.board("depth"));
    pc.expect(&[CAN, b'd', b'n', XON]);
    keep_silent();
    pc.write(&SPINDLE);
    pc.expect(&[ACK, XON]);
    assert!(pc.is_silent());
    assert_eq!(distributed(&up), 2);
}

#[test]
fn no_frame_that_a_pc_sends_on_after_a_failure_is_executed() {
    // The other axis is at it for half a minute yet, so there is time to write before the XON.
    let (up, mut pc) = in_motion("20", BOTH);
    pc.write(&FEED);
    pc.expect(&[XOFF]);
    kill("-KILL", up.board("depth"));
    pc.expect(&[CAN, b'd', b'n']);
    // The rest of a program that knows of nothing. None of it needs the dead board. It is answered once.
    pc.write(&[FEED, SPINDLE, FEED, SPINDLE].concat());
    pc.expect(&[NAK, b'f']);
    pc.write(&[FEED; 8].concat());
    pc.expect(&[XON]);
    keep_silent();
    pc.write(&SPINDLE);
    pc.expect(&[ACK, XON]);
    assert!(pc.is_silent());
    assert_eq!(distributed(&up), 2);
}

#[test]
fn a_slave_that_is_stopped_in_motion_is_reported_and_is_back_when_it_is_continued() {
    let (up, mut pc) = in_motion("20", FAR_OUT);
    kill("-STOP", up.board("depth"));
    pc.expect(&[CAN, b'd', b'n', XON]);
    up.wait_for_log(&format!("board 'depth' (pid {}) was stopped", up.board("depth")));
    let (stopped, told) = (logged_at(&up.log(), "was stopped"), logged_at(&up.log(), "slave 'd' does not answer"));
    assert!(stopped <= told && told < stopped + 3.0, "stopped at {stopped} s, told at {told} s");

    // The rest goes on.
    keep_silent();
    pc.write(&FEED);
    pc.expect(&[ACK, XON]);
    keep_silent();
    pc.write(&OUT);
    pc.expect(&[NAK, b'f']);

    kill("-CONT", up.board("depth"));
    up.wait_for_log(&format!("board 'depth' (pid {}) was continued", up.board("depth")));
    // It is asked when it is needed; while it is still at what it was told before, the frame is held.
    let start = Instant::now();
    pc.write(&IN);
    loop {
        match pc.read(1)[0] {
            ACK => break,
            NAK => {
                pc.expect(b"f");
                keep_silent();
                pc.write(&IN);
            }
            byte => assert!([XOFF, XON].contains(&byte), "{byte:02x}"),
        }
        assert!(start.elapsed() < PATIENCE, "it never comes back");
    }
    pc.expect(&[XON]);
    up.wait_for_log("slave 'd' answers again");
    assert!(pc.is_silent());
}

#[test]
fn a_storm_of_stops_leaves_the_rig_up() {
    let (mut up, mut pc) = in_motion("100", LONG);
    for round in 0..150 {
        let board = up.board(["master", "depth"][round % 2]);
        ["-STOP", "-CONT"].iter().for_each(|signal| kill(signal, board));
    }
    // Whatever has been lost on the way, the master answers what comes after.
    pc.write(&AT_REST);
    while !matches!(pc.read(1)[0], ACK | NAK | CAN) {}
    kill("-INT", up.pid());
    assert_eq!(up.child.wait().unwrap().code(), Some(0), "{}", up.log());
}

#[test]
fn a_board_that_is_stopped_and_continued_at_once_loses_nothing() {
    // At the pace of the clock: a slave is asked whether it is there after a second.
    let (up, mut pc) = in_motion("1", OUT);
    for board in BOARDS {
        kill("-STOP", up.board(board));
        kill("-CONT", up.board(board));
    }
    pc.expect(&[XON]);
    pc.write(&[AT_REST, AT_REST].concat());
    pc.expect(&[ACK, XOFF, XON, ACK, XON]);
    assert!(pc.is_silent());
}

#[test]
fn a_frame_that_is_acknowledged_after_a_slave_came_back_in_motion_is_executed() {
    let (up, mut pc) = in_motion("20", LONG);
    kill("-STOP", up.board("depth"));
    pc.expect(&[CAN, b'd', b'n', XON]);
    kill("-CONT", up.board("depth"));
    up.wait_for_log("was continued");
    // It goes on with what it was told, for minutes. A frame that it cannot take must be refused, or held.
    for _ in 0..3 {
        keep_silent();
        pc.write(&IN);
        match pc.read(1)[0] {
            NAK => pc.expect(b"f"),
            XOFF => break,
            byte => {
                assert_eq!(byte, ACK);
                let log = up.log();
                assert!(!log.contains("dropped byte"), "acknowledged, and dropped by its slave:\n{log}");
                pc.expect(&[XON]);
                break;
            }
        }
    }
}

#[test]
fn a_master_that_is_killed_leaves_the_harness_up() {
    let (mut up, mut pc) = in_motion("20", LONG);
    kill("-KILL", up.board("master"));
    up.wait_for_log(&format!("board 'master' (pid {}) died: signal: 9 (SIGKILL)", up.board("master")));
    pc.write(&SHORT);
    // Others open and close the port, and the slaves live.
    drop(pc);
    up.wait_for_log("the PC port has been closed");
    up.pc().write(&SHORT);
    for board in ["spindle", "transverse", "depth"] {
        assert!(is_alive(up.board(board)), "{board}");
    }
    assert_eq!(up.child.try_wait().unwrap(), None);
    kill("-TERM", up.pid());
    assert_eq!(up.child.wait().unwrap().code(), Some(1));
}

#[test]
fn all_slaves_may_die_and_the_master_still_answers() {
    let (up, mut pc) = in_motion("20", LONG);
    up.wait_for_log("transverse: done");
    up.wait_for_log("spindle: done");
    for board in ["spindle", "transverse", "depth"] {
        kill("-KILL", up.board(board));
    }
    pc.expect(&[CAN, b'd', b'n', XON]);
    keep_silent();
    pc.write(&[0x0a, 0xe1, 0, 0xe1, 0, 0, 0, 0]);
    assert_eq!(pc.read(1), [ACK]);
    let mut failures = pc.read(6);
    failures.sort_unstable();
    let mut expected = [CAN, b's', b'n', CAN, b't', b'n'];
    expected.sort_unstable();
    assert_eq!(failures, expected);
    pc.expect(&[XON]);
    keep_silent();
    pc.write(&[0x0a, 0xe1, 0, 0xe1, 0, 0, 0, 9]);
    pc.expect(&[NAK, b'd']);
    pc.write(&AT_REST);
    pc.expect(&[ACK, XON]);
}

// --- the same during a run ------------------------------------------------------------------------------------------

/// `torno run` of a program, with the boards' processes as the system tells them.
struct Run {
    child: Option<Child>,
    log: PathBuf,
    _folder: tempfile::TempDir,
}

impl Run {
    fn start(frames: &[[u8; 8]], arguments: &[&str]) -> Self {
        let folder = folder();
        let line = |frame: &[u8; 8]| frame.map(|byte| format!("{byte:02x}")).join(" ");
        let program = folder.path().join("test.frames");
        fs::write(&program, frames.iter().map(line).collect::<Vec<_>>().join("\n")).unwrap();
        let log = folder.path().join("log");
        let mut command = torno(&["run", program.to_str().unwrap()]);
        command.args(arguments).env("RUST_LOG", "info");
        command.stdout(Stdio::piped()).stderr(fs::File::create(&log).unwrap());
        Self { child: Some(command.spawn().unwrap()), log, _folder: folder }
    }

    fn pid(&self) -> u64 {
        u64::from(self.child.as_ref().unwrap().id())
    }

    fn log(&self) -> String {
        fs::read_to_string(&self.log).unwrap()
    }

    fn wait_for_log(&mut self, text: &str) {
        wait_until(text, || {
            let ended = self.child.as_mut().unwrap().try_wait().unwrap();
            assert!(ended.is_none() || self.log().contains(text), "ended without: {text}\n{}", self.log());
            self.log().contains(text)
        });
    }

    /// The process of a board.
    fn board(&self, kind: &str) -> u64 {
        board_of(self.pid(), kind).unwrap_or_else(|| panic!("no {kind}"))
    }

    fn end(mut self) -> (Output, String) {
        let output = self.child.take().unwrap().wait_with_output().unwrap();
        (output, self.log())
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            child.kill().ok();
            child.wait().ok();
        }
    }
}

fn children(pid: u64) -> Vec<u64> {
    let tasks = fs::read_dir(format!("/proc/{pid}/task")).into_iter().flatten().flatten();
    let of_task = |task: fs::DirEntry| fs::read_to_string(task.path().join("children")).unwrap_or_default();
    let all: Vec<String> = tasks.map(of_task).collect();
    all.iter().flat_map(|some| some.split_whitespace()).filter_map(|pid| pid.parse().ok()).collect()
}

#[test]
fn a_slave_that_is_killed_during_a_run_ends_it_as_faulted_and_is_named() {
    for json_too in [true, false] {
        let arguments: &[&str] = if json_too { &["--pace", "20", "--json"] } else { &["--pace", "20"] };
        let mut run = Run::start(&[LONG, SHORT, SHORT], arguments);
        run.wait_for_log("frame 1 distributed");
        let depth = run.board("depth");
        kill("-KILL", depth);
        let (output, log) = run.end();
        assert_eq!(output.status.code(), Some(1), "{log}");
        let named = format!("board 'depth' (pid {depth}) died: signal: 9 (SIGKILL)");
        assert!(log.contains(&named), "{log}");
        if json_too {
            let summary = json(&output);
            assert_eq!(summary["outcome"], "faulted");
            assert_eq!(summary["failures"], serde_json::json!(["depth failed: no answer"]));
            assert!(summary["incidents"][0].as_str().unwrap().ends_with(&named), "{summary}");
            assert_eq!(summary["boards"]["depth"]["pid"].as_u64(), Some(depth));
            assert_eq!(summary["frames"]["accepted"], 1);
            assert_eq!(summary["boards"]["master"]["frames_distributed"], 1);
        } else {
            let text = String::from_utf8(output.stdout).unwrap();
            assert!(text.contains(&named) && text.contains("depth failed: no answer"), "{text}");
            assert!(text.ends_with("faulted\n"), "{text}");
        }
    }
}

/// Depth to and fro, for hours of virtual time.
fn for_hours() -> Vec<[u8; 8]> {
    let mut back = LONG;
    back[7] = 1;
    [LONG, back].into_iter().cycle().take(1000).collect()
}

#[test]
fn a_slave_that_dies_or_is_stopped_in_a_run_at_full_speed_ends_it_as_faulted() {
    for (signal, board, what) in [
        ("-KILL", "depth", "died: signal: 9"),
        ("-STOP", "depth", "was stopped"),
        ("-KILL", "spindle", "died: signal: 9"),
        ("-STOP", "transverse", "was stopped"),
    ] {
        let mut run = Run::start(&for_hours(), &["--json"]);
        run.wait_for_log("frame 5 distributed");
        let pid = run.board(board);
        kill(signal, pid);
        let (output, log) = run.end();
        assert_eq!(output.status.code(), Some(1), "{signal} {board}: {log}");
        let summary = json(&output);
        assert_eq!(summary["outcome"], "faulted", "{signal} {board}: {summary}");
        assert_eq!(summary["failures"], serde_json::json!([format!("{board} failed: no answer")]));
        let incident = format!("board '{board}' (pid {pid}) {what}");
        assert!(summary["incidents"][0].as_str().unwrap().contains(&incident), "{summary}");
        wait_until("it is gone", || !is_alive(pid));
    }
}

#[test]
fn a_master_that_dies_in_a_run_ends_it_as_unanswered() {
    for arguments in [&["--json"][..], &["--json", "--pace", "300"]] {
        let mut run = Run::start(&for_hours(), arguments);
        run.wait_for_log("frame 1 distributed");
        kill("-KILL", run.board("master"));
        let (output, log) = run.end();
        assert_eq!(output.status.code(), Some(1), "{log}");
        let summary = json(&output);
        assert_eq!(summary["outcome"], "unanswered");
        assert!(summary["incidents"][0].as_str().unwrap().contains("board 'master'"), "{summary}");
    }
}

// --- the harness ends -----------------------------------------------------------------------------------------------

fn are_gone_within_a_second(pids: &[u64], since: Instant) {
    wait_until("the boards are gone", || !pids.iter().any(|pid| is_alive(*pid)));
    assert!(since.elapsed() < Duration::from_secs(1), "{:?}", since.elapsed());
}

#[test]
fn all_boards_are_gone_within_a_second_when_the_harness_is_killed() {
    // The orphans are ours, of the same session: for these the system does nothing of its own accord, as it else does
    // for stopped orphans.
    rustix::process::set_child_subreaper(Some(rustix::process::getpid())).unwrap();
    for stopped in [&[][..], &["depth"], &BOARDS] {
        let (mut up, _pc) = in_motion("20", LONG);
        for board in stopped {
            kill("-STOP", up.board(board));
            up.wait_for_log(&format!("board '{board}' (pid {}) was stopped", up.board(board)));
        }
        let boards = up.boards();
        assert!(boards.iter().all(|pid| is_alive(*pid)));
        let start = Instant::now();
        kill("-KILL", up.pid());
        are_gone_within_a_second(&boards, start);
        assert_eq!(up.child.wait().unwrap().signal(), Some(9));
    }
}

#[test]
fn all_boards_are_gone_within_a_second_when_a_run_is_killed() {
    for pace in ["max", "20"] {
        let mut run = Run::start(&for_hours(), &["--pace", pace]);
        run.wait_for_log("frame 1 distributed");
        let boards = children(run.pid());
        assert_eq!(boards.len(), 4);
        let start = Instant::now();
        kill("-KILL", run.pid());
        are_gone_within_a_second(&boards, start);
    }
}

#[test]
fn a_rig_that_is_asked_to_end_ends_cleanly() {
    for signal in ["-INT", "-TERM", "-HUP"] {
        for stopped in [None, Some("master"), Some("depth")] {
            let (mut up, _pc) = in_motion("20", LONG);
            let (boards, link) = (up.boards(), up.link());
            if let Some(board) = stopped {
                kill("-STOP", up.board(board));
            }
            let start = Instant::now();
            kill(signal, up.pid());
            assert_eq!(up.child.wait().unwrap().code(), Some(0), "{signal}");
            assert!(fs::symlink_metadata(&link).is_err(), "{signal}: the link is left");
            are_gone_within_a_second(&boards, start);
        }
    }
}

#[test]
fn a_run_that_is_asked_to_end_leaves_no_board() {
    for signal in ["-INT", "-TERM"] {
        for pace in ["max", "1"] {
            let mut run = Run::start(&for_hours(), &["--pace", pace]);
            run.wait_for_log("frame 1 distributed");
            let boards = children(run.pid());
            let start = Instant::now();
            kill(signal, run.pid());
            let (output, log) = run.end();
            assert_eq!(output.status.code(), Some(130), "{signal} at pace {pace}: {log}");
            let summary = String::from_utf8_lossy(&output.stdout);
            assert!(summary.contains("\ninterrupted; master waits for ") && summary.contains("outcome"), "{summary}");
            are_gone_within_a_second(&boards, start);
        }
    }
}

// --- what a board has -----------------------------------------------------------------------------------------------

/// What the descriptors of a process lead to.
fn descriptors(pid: u64) -> Vec<(String, String)> {
    let entries = fs::read_dir(format!("/proc/{pid}/fd")).unwrap().map(|entry| entry.unwrap().path());
    let text = |path: &Path| path.to_string_lossy().into_owned();
    let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
    entries.map(|path| (name(&path), text(&fs::read_link(&path).unwrap()))).collect()
}

#[test]
fn a_board_has_nothing_of_the_harness_but_its_socket_and_the_log() {
    let (up, _pc) = in_motion("20", SHORT);
    // What whoever runs the tests has left open for all.
    let inherited = descriptors(u64::from(std::process::id()));
    let own = |pid| descriptors(pid).into_iter().filter(|descriptor| !inherited.contains(descriptor));
    let sockets =
        |pid| -> BTreeSet<String> { own(pid).map(|(_, to)| to).filter(|to| to.starts_with("socket:")).collect() };
    let mut others = sockets(up.pid());
    assert!(descriptors(up.pid()).iter().any(|(_, to)| to.contains("ptmx")), "the harness has the pty");
    for (name, pid) in BOARDS.iter().zip(up.boards()) {
        for (number, to) in own(pid) {
            let expected = match &*number {
                "0" => to.starts_with("socket:"),
                "1" => to == "/dev/null",
                "2" => to.ends_with("/log"),
                _ => to.starts_with("socket:") || to == "anon_inode:[eventpoll]" || to == "anon_inode:[eventfd]",
            };
            assert!(expected, "{name}: {number} -> {to}");
        }
        for socket in sockets(pid) {
            assert!(others.insert(socket.clone()), "{name} has {socket}, which another process has too");
        }
        assert!(fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap().ends_with(&format!("board\0{name}\0")));
    }
}

#[test]
fn the_boards_are_children_of_the_harness_and_of_different_process_groups() {
    let up = Up::start(&[]);
    let mut boards = up.boards();
    boards.sort_unstable();
    let mut found = children(up.pid());
    found.sort_unstable();
    assert_eq!(found, boards);
    // Ctrl-C in a terminal reaches the harness alone.
    let group = |pid: u64| {
        let mut stat = String::new();
        fs::File::open(format!("/proc/{pid}/stat")).unwrap().read_to_string(&mut stat).unwrap();
        stat.rsplit(')').next().unwrap().split_whitespace().nth(2).unwrap().to_owned()
    };
    assert!(boards.iter().all(|pid| group(*pid) != group(up.pid())));
}

#[test]
fn a_rig_at_a_pace_beyond_this_computer_can_still_be_ended() {
    let mut up = Up::start(&["--pace", "100000", "--in-process"]);
    let mut pc = up.pc();
    // More than the driver takes at once, so that it is always behind.
    pc.write(&[LONG, AT_REST, AT_REST].concat());
    pc.expect(&[ACK]);
    kill("-INT", up.pid());
    assert_eq!(up.child.wait().unwrap().code(), Some(0));
}

#[test]
fn a_run_at_a_pace_beyond_this_computer_says_that_it_is_behind() {
    // A feed on its way has something to tell each 30 ms.
    let mut back = LONG_FEED;
    back[4] = 1;
    let frames: Vec<[u8; 8]> = [LONG_FEED, back].into_iter().cycle().take(1000).collect();
    let mut run = Run::start(&frames, &["--pace", "100000"]);
    run.wait_for_log("WARN this computer is ");
    assert!(run.log().contains(" s behind; going on from here"), "{}", run.log());
}

// --- a scenario ----------------------------------------------------------------------------------------------------

/// The process of a board that this process has launched.
fn board_of(parent: u64, kind: &str) -> Option<u64> {
    let command = |pid: &u64| fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    children(parent).into_iter().find(|pid| command(pid).ends_with(format!("board\0{kind}\0").as_bytes()))
}

#[test]
fn a_board_that_is_killed_under_a_scenario_is_named_in_the_failure() {
    let folder = folder();
    let path = folder.path().join("long.toml");
    let frames = "\"00 01 00 64 00 00 02 00\", \"00 01 00 64 01 00 02 01\", ".repeat(4_000);
    let text = format!(
        "name = \"long\"\nend = \"100000 s\"\n[[step]]\ndoes = \"a long program\"\nsend = [{frames}]\n\
         [[expect.never]]\nreply = \"CAN\"\n"
    );
    fs::write(&path, text).unwrap();
    let arguments = ["test", "--processes", path.to_str().unwrap()];
    let command = torno(&arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut depth = None;
    wait_until("the depth board runs", || {
        depth = board_of(command.id().into(), "depth");
        depth.is_some()
    });
    let pid = depth.unwrap();
    // In the middle of the program: its process has had turns.
    wait_until("the depth board has worked", || {
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        stat.rsplit(' ').nth(38).is_some_and(|ticks| ticks != "0")
    });
    kill("-KILL", pid);
    let output = command.wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains(&format!("board 'depth' (pid {pid}) died: signal: 9 (SIGKILL)")), "{text}");
    assert!(text.contains("never the reply CAN"), "{text}");
}
