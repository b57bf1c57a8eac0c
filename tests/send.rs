//! `torno send`: the PC on any serial port.

#![allow(clippy::disallowed_methods, reason = "a port at pace 1 is measured by the wall clock")]

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::thread;

use crate::common::clients::*;
use crate::common::{AT_REST, Up};
use crate::common::{folder, json, output, torno};
use serde_json::Value;

/// Sends a program, and gives the summary and the exit code.
fn send(program: &Path, port: &Path, more: &[&str]) -> (Value, Option<i32>) {
    let arguments = ["send", program.to_str().unwrap(), "--json", "--port", port.to_str().unwrap()];
    let output = output(&[&arguments, more].concat());
    (json(&output), output.status.code())
}

/// A terminal: its master side, and the path of the other.
fn pty() -> (File, PathBuf) {
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&master).and_then(|()| unlockpt(&master)).unwrap();
    let path = PathBuf::from(ptsname(&master, Vec::new()).unwrap().into_string().unwrap());
    (master.into(), path)
}

/// What a command comes to whose standard error is a terminal, and what that shows.
pub(crate) fn on_a_terminal(mut command: Command) -> (Output, String) {
    let (master, path) = pty();
    command.env("TERM", "xterm").stderr(File::options().read(true).write(true).open(path).unwrap());
    let screen = thread::spawn(move || {
        let mut shown = Vec::new();
        (&master).read_to_end(&mut shown).ok();
        String::from_utf8_lossy(&shown).into_owned()
    });
    let output = command.output().unwrap();
    // It holds the last descriptor of the terminal: with it, the reading ends.
    drop(command);
    (output, screen.join().unwrap())
}

/// What `torno send` of a frame at rest writes to standard output, and to standard error if that is a terminal.
fn sent_from(up: &Up, more: &[&str], stderr_is_a_terminal: bool) -> (String, String) {
    let folder = folder();
    let (program, port) = (program(folder.path(), &[AT_REST]), up.link());
    let arguments = ["send", program.to_str().unwrap(), "--port", port.to_str().unwrap()];
    let mut command = torno(&[&arguments, more].concat());
    let (output, shown) = if stderr_is_a_terminal {
        on_a_terminal(command)
    } else {
        let output = command.output().unwrap();
        let shown = String::from_utf8_lossy(&output.stderr).into_owned();
        (output, shown)
    };
    (String::from_utf8(output.stdout).unwrap(), shown)
}

#[test]
fn program_is_sent_frame_by_frame_as_held() {
    let up = Up::start(&[]);
    let folder = folder();
    let (summary, code) = send(&program(folder.path(), &[FEED, AT_REST, FEED, AT_REST]), &up.link(), &[]);
    assert_eq!((summary["outcome"].as_str(), code), (Some("completed"), Some(0)), "{summary}");
    let frames = &summary["frames"];
    assert_eq!((&frames["sent"], &frames["accepted"], &frames["rejected"]), (&4.into(), &4.into(), &0.into()));
    assert!(frames["held"].as_u64().unwrap() >= 2, "{summary}");
    assert_eq!((times(&up, "distributed"), times(&up, "all slaves done")), (4, 4));
}

#[test]
fn demonstration_is_sent_to_its_end() {
    let up = Up::start(&["--pace", "max"]);
    let demonstration = Path::new(env!("CARGO_MANIFEST_DIR")).join("builtin/shaft.frames");
    let (summary, code) = send(&demonstration, &up.link(), &[]);
    assert_eq!((summary["outcome"].as_str(), code), (Some("completed"), Some(0)), "{summary}");
    assert_eq!(summary["frames"]["accepted"], summary["frames"]["total"]);
}

#[test]
fn replies_go_to_standard_output_and_the_bar_to_a_terminal_only() {
    let up = Up::start(&["--pace", "20"]);
    for terminal in [false, true] {
        let (output, shown) = sent_from(&up, &[], terminal);
        let replies: Vec<&str> = output.lines().filter_map(|line| line.split_once(" s  ")).map(|(_, r)| r).collect();
        assert_eq!(replies, ["ACK", "XON"], "{output}\n{shown}");
        assert!(output.ends_with("outcome  completed\n"), "{output}");
        assert!(!shown.contains("ACK") && shown.contains("of 1") == terminal, "{shown:?}");

        let (output, shown) = sent_from(&up, &["--json"], terminal);
        assert_eq!(serde_json::from_str::<Value>(&output).unwrap()["outcome"], "completed");
        assert!(!shown.contains("ACK") && shown.contains("of 1") == terminal, "{shown:?}");
    }
}

#[test]
fn program_with_a_refused_frame_ends_as_rejected() {
    let up = Up::start(&["--pace", "20"]);
    let folder = folder();
    let mut wrong = AT_REST;
    wrong[7] = 2;
    let (summary, code) = send(&program(folder.path(), &[AT_REST, wrong, FEED]), &up.link(), &[]);
    assert_eq!((summary["outcome"].as_str(), code), (Some("rejected"), Some(1)), "{summary}");
    assert_eq!(summary["frames"]["refusals"], Value::from(vec!["direction"]));
    assert_eq!(summary["frames"]["accepted"], 2);
}

#[test]
fn program_that_nobody_answers_ends_as_unanswered() {
    let (_mute, port) = pty();
    let folder = folder();
    let (summary, code) = send(&program(folder.path(), &[AT_REST, AT_REST]), &port, &["--timeout", "0.2"]);
    assert_eq!((summary["outcome"].as_str(), code), (Some("unanswered"), Some(1)), "{summary}");
    assert_eq!((&summary["frames"]["sent"], &summary["frames"]["accepted"]), (&1.into(), &0.into()));
}
