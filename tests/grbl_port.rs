//! The port of the GRBL controller, with socat: a session as a person would type it.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{self, Receiver};
use std::thread;

use crate::common::clients::{times, wait_for_times};
use crate::common::{PATIENCE, Up, is_installed};

/// socat between its standard streams and the port.
struct Terminal {
    socat: Child,
    keys: ChildStdin,
    lines: Receiver<String>,
}

impl Terminal {
    fn open(up: &Up) -> Self {
        let port = format!("{},b115200,raw,echo=0", up.link().display());
        let mut command = Command::new("socat");
        let mut socat = command.arg("STDIO").arg(port).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let (keys, screen) = (socat.stdin.take().unwrap(), BufReader::new(socat.stdout.take().unwrap()));
        let (show, lines) = mpsc::channel();
        thread::spawn(move || screen.lines().map_while(Result::ok).try_for_each(|line| show.send(line)));
        Self { socat, keys, lines }
    }

    fn press(&mut self, keys: &str) {
        self.keys.write_all(keys.as_bytes()).unwrap();
    }

    /// All lines up to one that begins so; that is the last.
    fn until(&self, starts: &[&str]) -> Vec<String> {
        let mut shown = Vec::new();
        loop {
            let line = self.lines.recv_timeout(PATIENCE).unwrap_or_else(|_| panic!("no {starts:?} after {shown:?}"));
            let line = line.trim().to_owned();
            shown.push(line.clone());
            if starts.iter().any(|start| line.starts_with(start)) {
                return shown;
            }
        }
    }

    /// Types a line; gives what is shown up to its answer.
    fn line(&mut self, line: &str) -> Vec<String> {
        self.press(&format!("{line}\n"));
        self.until(&["ok", "error:"])
    }

    fn status(&mut self) -> String {
        self.press("?");
        self.until(&["<"]).pop().unwrap()
    }

    /// Asks until it is in this state; gives that status.
    fn wait_for(&mut self, state: &str) -> String {
        loop {
            let status = self.status();
            if status.starts_with(&format!("<{state}|")) {
                return status;
            }
        }
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        self.socat.kill().ok();
        self.socat.wait().ok();
    }
}

/// Z of a status, in the machine's coordinates.
fn z(status: &str) -> f64 {
    let place = status.split('|').find_map(|part| part.strip_prefix("MPos:")).unwrap();
    place.split(',').nth(2).unwrap().parse().unwrap()
}

#[test]
fn socat_asks_runs_a_job_holds_resumes_resets_in_motion_and_unlocks() {
    if !is_installed("socat", Command::new("socat").arg("-V")) {
        return;
    }
    // Slow enough to be seen in motion.
    let up = Up::start(&["lathe-grbl", "--pace", "20"]);
    let mut terminal = Terminal::open(&up);
    assert_eq!(terminal.until(&["Grbl"]).pop().unwrap(), "Grbl 1.1h ['$' for help]");
    assert!(terminal.line("$$").contains(&"$110=16.000".to_owned()));
    assert_eq!(terminal.line("$G")[0], "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]");
    let parameters = terminal.line("$#");
    assert!(parameters.contains(&"[G54:0.000,0.000,0.000]".to_owned()), "{parameters:?}");
    assert!(terminal.line("$I")[0].starts_with("[VER:1.1h."));

    // A job, with a hold in its longest motion.
    for line in ["G10 L20 P1 X14.3556 Z0", "G18 G21 G90", "M3 S600", "G0 X13 Z1", "G1 Z-40 F100"] {
        assert_eq!(terminal.line(line), ["ok"], "{line}");
    }
    while z(&terminal.status()) > -0.5 {}
    terminal.press("!");
    terminal.wait_for("Hold:1");
    let held = z(&terminal.wait_for("Hold:0"));
    assert!((-39.0..-0.5).contains(&held), "{held}");
    assert_eq!(z(&terminal.status()), held);
    terminal.press("~");
    terminal.wait_for("Run");
    assert_eq!(z(&terminal.wait_for("Idle")), -40.0);
    assert_eq!(terminal.line("G0 Z0"), ["ok"]);
    assert_eq!(z(&terminal.wait_for("Idle")), 0.0);

    // A reset in motion: the frame goes on to its end, and nothing comes after it.
    assert_eq!(terminal.line("G1 Z-40 F100"), ["ok"]);
    while z(&terminal.status()) > -0.5 {}
    let done = times(&up, "all slaves done");
    terminal.press("\u{18}");
    let shown = terminal.until(&["[MSG:'$H'|'$X' to unlock]"]);
    assert!(shown.contains(&"ALARM:3".to_owned()), "{shown:?}");
    assert_eq!(terminal.line("G0 Z0"), ["error:9"]);
    assert_eq!(terminal.line("$X"), ["[MSG:Caution: Unlocked]", "ok"]);
    wait_for_times(&up, "all slaves done", done + 1);
    assert_eq!(terminal.line("G0 Z0"), ["ok"]);
    assert_eq!(z(&terminal.wait_for("Idle")), 0.0);
}
