//! What ends a command before its own end: Ctrl-C, and the signals of a service manager.

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, ExitStatus, Stdio};
use std::time::Duration;

use crate::common::clients::program;
use crate::common::{AT_REST, LONG, Up, folder, kill, output, torno, wait_until};
use serde_json::Value;

/// Waits for its end, and not for ever.
fn ended(child: &mut Child) -> ExitStatus {
    let mut status = None;
    wait_until("the command ends", || {
        status = child.try_wait().unwrap();
        status.is_some()
    });
    status.unwrap()
}

/// The JSON in the last line that it prints.
fn last_line(child: &mut Child) -> Value {
    let lines: Vec<String> = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap).collect();
    serde_json::from_str(lines.last().unwrap()).unwrap()
}

#[test]
fn a_log_that_nobody_reads_holds_nothing_up_and_signals_end_it() {
    let folder = folder();
    let program = program(folder.path(), &[AT_REST; 3_000]);
    let run = |more: &[&str]| {
        let mut command = torno(&[&["run", "lathe", program.to_str().unwrap(), "--json"], more].concat());
        command.env("RUST_LOG", "trace").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    };
    for driver in [&[][..], &["--in-process"]] {
        let mut whole = run(driver);
        assert!(ended(&mut whole).success());
        assert_eq!(last_line(&mut whole)["outcome"], "completed");
        // The pipe is full; the rest has been dropped.
        let mut logged = Vec::new();
        whole.stderr.take().unwrap().read_to_end(&mut logged).unwrap();
        assert!((32 << 10..1 << 20).contains(&logged.len()), "{}", logged.len());
        for signal in ["-INT", "-TERM"] {
            let mut paced = run(&[&["--pace", "20"], driver].concat());
            // Long enough for more than a pipe holds.
            std::thread::sleep(Duration::from_millis(1_500));
            kill(signal, paced.id().into());
            assert_eq!(ended(&mut paced).code(), Some(130));
            assert_eq!(last_line(&mut paced)["outcome"], "interrupted");
        }
    }
}

#[test]
fn every_signal_that_ends_a_program_ends_a_rig_in_order() {
    for signal in ["-INT", "-TERM", "-HUP", "-QUIT", "-USR1", "-USR2", "-ALRM"] {
        let mut up = Up::start(&[]);
        let (link, control) = (up.link(), up.ready["control"].as_str().unwrap().to_owned());
        kill(signal, up.pid());
        let status = ended(&mut up.child);
        assert!(status.success(), "{signal}: {status}, by {:?}", status.signal());
        assert!(link.symlink_metadata().is_err() && fs::metadata(&control).is_err(), "{signal}");
    }
}

#[test]
fn a_hangup_that_is_ignored_stays_so() {
    let folder = folder();
    let link = folder.path().join("pc");
    let up = torno(&["up", "--json", "--link", link.to_str().unwrap()]);
    let mut shell = std::process::Command::new("sh");
    shell.args(["-c", "trap '' HUP && exec \"$@\"", "sh"]).arg(up.get_program()).args(up.get_args());
    let mut up = Up::launch(shell, folder);
    kill("-HUP", up.pid());
    kill("-PIPE", up.pid());
    let control = up.ready["control"].as_str().unwrap();
    assert!(output(&["ctl", "--socket", control, "state"]).status.success());
    kill("-TERM", up.pid());
    assert!(ended(&mut up.child).success());
}

#[test]
fn a_program_that_is_interrupted_is_summed_up() {
    let folder = folder();
    let program = program(folder.path(), &[LONG]);
    let up = Up::start(&[]);
    let (link, program) = (up.link(), program.to_str().unwrap());
    let commands = [
        &["send", program, "--json", "--port", link.to_str().unwrap()][..],
        &["run", "lathe", program, "--json", "--pace", "1"],
    ];
    for arguments in commands {
        let mut command =
            torno(arguments).env("RUST_LOG", "info").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut log = BufReader::new(command.stderr.take().unwrap()).lines();
        // The frame is distributed.
        assert!(log.any(|line| line.is_ok_and(|line| line.contains("ACK") || line.contains("distributed"))));
        kill("-INT", command.id().into());
        assert_eq!(ended(&mut command).code(), Some(130), "{arguments:?}");
        let summary = last_line(&mut command);
        assert_eq!((&summary["outcome"], &summary["frames"]["sent"]), (&"interrupted".into(), &1.into()), "{summary}");
    }
}

#[test]
fn a_rig_that_was_up_is_summed_up_and_fails_if_a_board_has_died() {
    let folder = folder();
    for dies in [false, true] {
        let link = folder.path().join("pc");
        let arguments = ["up", "--json", "--link", link.to_str().unwrap()];
        let mut up = torno(&arguments).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut lines = BufReader::new(up.stdout.take().unwrap()).lines();
        let ready: Value = serde_json::from_str(&lines.next().unwrap().unwrap()).unwrap();
        if dies {
            kill("-KILL", ready["boards"]["depth"]["pid"].as_u64().unwrap());
            let control = ready["control"].as_str().unwrap();
            wait_until("the rig knows it", || {
                let state = output(&["ctl", "--socket", control, "--json", "state"]).stdout;
                String::from_utf8(state).unwrap().contains("gone")
            });
        }
        kill("-INT", up.id().into());
        assert_eq!(ended(&mut up).code(), Some(i32::from(dies)));
        let left: Value = serde_json::from_str(&lines.next().unwrap().unwrap()).unwrap();
        assert_eq!(left["outcome"], "ended");
        assert!(left["virtual_s"].as_f64().unwrap() > 0.0);
        let incidents = left["incidents"].as_array().unwrap();
        assert_eq!(incidents.len(), usize::from(dies), "{left}");
        assert!(!dies || incidents[0].as_str().unwrap().contains("board 'depth'"), "{left}");
    }
}
