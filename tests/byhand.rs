//! Boards by hand: `--await` leaves a place open, `torno board --join` takes it.

use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::process::{Child, Output, Stdio};

use serde_json::Value;

use crate::common::clients::program;
use crate::common::{SHORT, folder, is_alive, json, kill, output, torno, wait_until};

/// A command that waits for boards.
struct Waiting {
    child: Child,
    folder: tempfile::TempDir,
    /// What it has announced.
    places: Value,
    stdout: BufReader<std::process::ChildStdout>,
}

impl Waiting {
    /// `torno ARGUMENTS --json --await BOARD=…` for each board, which joins in a folder of the test's own.
    fn start(arguments: &[&str], boards: &[&str]) -> Self {
        let folder = folder();
        let mut command = torno(arguments);
        command.arg("--json").env("RUST_LOG", "info");
        for board in boards {
            command.arg("--await").arg(format!("{board}={}", folder.path().join(board).display()));
        }
        let log = std::fs::File::create(folder.path().join("log")).unwrap();
        let mut child = command.stdout(Stdio::piped()).stderr(log).spawn().unwrap();
        let mut stdout = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        stdout.read_line(&mut line).unwrap();
        let places = serde_json::from_str(&line).unwrap_or_else(|_| panic!("does not wait: {line:?}"));
        Self { child, folder, places, stdout }
    }

    fn socket(&self, board: &str) -> PathBuf {
        PathBuf::from(self.places["await"][board]["socket"].as_str().unwrap())
    }

    /// Starts a board of this kind at the place of `board`.
    fn join(&self, kind: &str, board: &str) -> Child {
        let socket = self.socket(board);
        let mut command = torno(&["board", kind, "--join", socket.to_str().unwrap()]);
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    }

    fn log(&self) -> String {
        std::fs::read_to_string(self.folder.path().join("log")).unwrap()
    }

    fn wait_for_log(&self, text: &str) {
        wait_until(text, || self.log().contains(text));
    }

    /// Waits for its end: its exit status, and the rest of what it printed.
    fn end(mut self) -> (Option<i32>, String) {
        let mut rest = String::new();
        self.stdout.read_to_string(&mut rest).unwrap();
        (self.child.wait().unwrap().code(), rest)
    }
}

impl Drop for Waiting {
    fn drop(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
    }
}

fn complaint(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

#[test]
fn boards_by_hand_give_the_same_digest_as_those_of_the_launcher() {
    let frames = folder();
    let program = program(frames.path(), &[SHORT]);
    let run = ["run", program.to_str().unwrap()];
    let launched = json(&output(&[&run[..], &["--json"]].concat()));
    let some: [(&[&str], &[&str]); 3] =
        [(&["depth"], &[]), (&["depth", "master"], &[]), (&["transverse"], &["--in-process"])];
    for (boards, arguments) in some {
        let waiting = Waiting::start(&[&run[..], arguments].concat(), boards);
        let joined: Vec<Child> = boards.iter().map(|board| waiting.join(board, board)).collect();
        let (code, summary) = waiting.end();
        let summary: Value = serde_json::from_str(&summary).unwrap();
        assert_eq!((code, &summary["digest"]), (Some(0), &launched["digest"]), "{boards:?}");
        for (board, child) in boards.iter().zip(joined) {
            assert_eq!(summary["boards"][board]["pid"], child.id());
            let output = child.wait_with_output().unwrap();
            assert_eq!((output.status.code(), complaint(&output).as_str()), (Some(0), ""));
        }
    }
}

#[test]
fn a_place_is_for_its_owner_and_is_gone_when_it_is_taken() {
    let waiting = Waiting::start(&["up", "--link", "/dev/null/none"], &["depth"]);
    let socket = waiting.socket("depth");
    let place = &waiting.places["await"]["depth"];
    assert_eq!(place["command"], format!("torno board depth --join {}", socket.display()));
    let there = std::fs::symlink_metadata(&socket).unwrap();
    assert!(there.file_type().is_socket());
    assert_eq!(there.permissions().mode() & 0o777, 0o600);
    let child = waiting.join("depth", "depth");
    wait_until("the socket is gone", || !socket.exists());
    // The port cannot be put there: the rig ends before it has begun, and the board says so.
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(complaint(&output).contains("the rig let this board go before its first grant"), "{}", complaint(&output));
    assert_eq!(waiting.end().0, Some(2));
}

#[test]
fn a_board_of_another_kind_is_refused_at_both_ends_and_the_rig_still_waits() {
    let frames = folder();
    let program = program(frames.path(), &[SHORT]);
    let waiting = Waiting::start(&["run", program.to_str().unwrap()], &["depth"]);
    let refused = waiting.join("spindle", "depth").wait_with_output().unwrap();
    let why = "expected a board of kind 'depth', found kind 'spindle'";
    assert_eq!(refused.status.code(), Some(2));
    assert_eq!(complaint(&refused), format!("torno: this is not the board that the rig waits for: {why}\n"));
    waiting.wait_for_log(&format!("what has joined as board 'depth' is refused: {why}; the rig still waits"));
    let board = waiting.join("depth", "depth");
    assert_eq!(waiting.end().0, Some(0));
    assert!(board.wait_with_output().unwrap().status.success());
}

#[test]
fn strangers_are_refused_and_there_is_an_end_to_it() {
    let waiting = Waiting::start(&["run"], &["depth"]);
    for n in 1..=16 {
        let mut stranger = UnixStream::connect(waiting.socket("depth")).unwrap();
        // A record of one byte that is none; the last ones hang up.
        if n < 10 {
            stranger.write_all(&[1, 0, 0, 0, 99]).unwrap();
        }
        stranger.shutdown(std::net::Shutdown::Write).unwrap();
        stranger.read_to_end(&mut Vec::new()).ok();
    }
    assert!(waiting.log().contains("what has joined as board 'depth' is refused: sends what is no record"));
    let log = waiting.folder.path().join("log");
    let folder = tempfile::tempdir().unwrap();
    let kept = folder.path().join("log");
    std::fs::hard_link(log, &kept).unwrap();
    assert_eq!(waiting.end().0, Some(2));
    let log = std::fs::read_to_string(kept).unwrap();
    let end =
        "torno: --await: board 'depth': 16 have been refused in its place; the last one: its process ended at once";
    assert_eq!(log.lines().last(), Some(end), "{log}");
}

#[test]
fn a_board_by_hand_that_dies_is_named_at_once_and_the_rest_stays_up() {
    let folder = folder();
    let link = folder.path().join("pc");
    let mut waiting = Waiting::start(&["up", "--link", link.to_str().unwrap()], &["depth"]);
    let mut board = waiting.join("depth", "depth");
    let mut line = String::new();
    waiting.stdout.read_line(&mut line).unwrap();
    let ready: Value = serde_json::from_str(&line).unwrap();
    let pid = u64::from(board.id());
    assert_eq!(ready["boards"]["depth"]["pid"], pid);
    // Nothing is asked of it: its death must be seen all the same.
    kill("-KILL", pid);
    waiting.wait_for_log(&format!("board 'depth' (pid {pid}) died: its socket has ended"));
    board.wait().unwrap();
    assert!(is_alive(ready["boards"]["master"]["pid"].as_u64().unwrap()));
    kill("-INT", u64::from(waiting.child.id()));
    assert_eq!(waiting.end().0, Some(1));
}

#[test]
fn a_board_by_hand_ends_with_its_rig() {
    let folder = folder();
    let link = folder.path().join("pc");
    let mut waiting = Waiting::start(&["up", "--link", link.to_str().unwrap()], &["depth"]);
    let board = waiting.join("depth", "depth");
    waiting.stdout.read_line(&mut String::new()).unwrap();
    kill("-INT", u64::from(waiting.child.id()));
    assert_eq!(waiting.end().0, Some(0));
    assert_eq!(board.wait_with_output().unwrap().status.code(), Some(0));
}

#[test]
fn ctrl_c_ends_the_wait() {
    for (command, code) in [("run", 130), ("up", 0)] {
        let waiting = Waiting::start(&[command], &["spindle", "depth"]);
        let sockets = ["spindle", "depth"].map(|board| waiting.socket(board));
        let joined = waiting.join("spindle", "spindle");
        waiting.wait_for_log("board 'spindle' has joined");
        kill("-INT", u64::from(waiting.child.id()));
        assert_eq!(waiting.end(), (Some(code), String::new()));
        assert!(sockets.iter().all(|socket| !socket.exists()));
        assert_eq!(joined.wait_with_output().unwrap().status.code(), Some(2));
    }
}

#[test]
fn the_places_are_told_in_text_and_have_a_usual_path() {
    let runtime = folder();
    let mut command = torno(&["run", "--await", "depth"]);
    command.env("XDG_RUNTIME_DIR", runtime.path()).stdout(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let socket = runtime.path().join("torno/lathe-depth-join");
    assert_eq!(line, format!("waits for board 'depth': torno board depth --join {}\n", socket.display()));
    let second = torno(&["run", "--await", "depth"]).env("XDG_RUNTIME_DIR", runtime.path()).output().unwrap();
    let busy = format!("a rig already waits for a board at {}: choose another place with --await", socket.display());
    assert!(complaint(&second).contains(&busy), "{}", complaint(&second));
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn a_rig_file_may_leave_a_place_open() {
    let folder = folder();
    let rig = folder.path().join("my.toml");
    let kind = "kind = \"depth\"";
    let text = include_str!("../harness/builtin/lathe.toml");
    std::fs::write(&rig, text.replacen(kind, &format!("{kind}\nawait = true"), 1)).unwrap();
    let frames = program(folder.path(), &[SHORT]);
    let arguments = [rig.to_str().unwrap(), frames.to_str().unwrap()];
    // A command that does not wait starts it as any other.
    let in_process = output(&["compare", "lathe", arguments[0], arguments[1]]);
    assert!(in_process.status.success(), "{}", complaint(&in_process));
    for boards in [&["spindle", "depth"][..], &["depth"]] {
        let waiting = Waiting::start(&[&["run"], &arguments[..]].concat(), boards);
        assert_eq!(waiting.places["await"].as_object().unwrap().len(), boards.len());
        let joined: Vec<Child> = boards.iter().map(|board| waiting.join(board, board)).collect();
        assert_eq!(waiting.end().0, Some(0));
        joined.into_iter().for_each(|mut child| assert!(child.wait().unwrap().success()));
    }
    let usual = torno(&["run", arguments[0]]).env("XDG_RUNTIME_DIR", folder.path()).stdout(Stdio::piped()).spawn();
    let mut usual = usual.unwrap();
    let mut line = String::new();
    BufReader::new(usual.stdout.take().unwrap()).read_line(&mut line).unwrap();
    assert!(line.starts_with("waits for board 'depth': torno board depth --join "), "{line}");
    usual.kill().unwrap();
    usual.wait().unwrap();
}

#[test]
fn what_cannot_be_awaited_or_joined_is_told() {
    let folder = folder();
    let nowhere = folder.path().join("nowhere");
    let nowhere = nowhere.to_str().unwrap();
    let twice = format!("depth={nowhere}");
    let some: [(&[&str], &str); 4] = [
        (&["up", "--await", "deph"], "--await: there is no board 'deph': did you mean 'depth'?"),
        (&["run", "--await", "pc=x"], "--await: there is no board 'pc'"),
        (&["run", "--await", &twice, "--await", &twice], "--await: board 'depth' is named twice"),
        (&["board", "depth", "--join", nowhere], "no rig waits for a board at "),
    ];
    for (arguments, expected) in some {
        let output = output(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(complaint(&output).contains(expected), "{}", complaint(&output));
    }
}
