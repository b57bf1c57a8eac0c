//! The servo stand's PC program at serial ports: that of a rig, and those at which something is wrong.

#![allow(clippy::disallowed_methods, reason = "how long a port takes is measured by the wall clock")]

use std::fs;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Output, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::common::{Pc, Up, folder, json, kill, output, torno, wait_until};

/// An error at a port is told within this time.
const TOLD: Duration = Duration::from_secs(2);

fn written(folder: &Path, text: &str) -> String {
    let path = folder.join("program.txt");
    fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

fn servo(arguments: &[&str]) -> Output {
    output(&[&["servo"], arguments].concat())
}

fn told(output: &Output) -> (Option<i32>, String, String) {
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

/// A command that runs, and is not left behind.
struct Running(Child);

impl Running {
    fn servo(arguments: &[&str]) -> Self {
        let mut command = torno(&[&["servo"], arguments].concat());
        Self(command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap())
    }

    fn signal(&self, signal: &str) {
        kill(signal, u64::from(self.0.id()));
    }

    /// Waits for its end; says the same as [`told`].
    fn end(mut self) -> (Option<i32>, String, String) {
        let [mut out, mut error] = [String::new(), String::new()];
        self.0.stdout.take().unwrap().read_to_string(&mut out).unwrap();
        self.0.stderr.take().unwrap().read_to_string(&mut error).unwrap();
        (self.0.wait().unwrap().code(), out, error)
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

/// A terminal: its master side, and the path of the other.
fn pty() -> (fs::File, PathBuf) {
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&master).and_then(|()| unlockpt(&master)).unwrap();
    let path = PathBuf::from(ptsname(&master, Vec::new()).unwrap().into_string().unwrap());
    (master.into(), path)
}

/// What a stand-in for a controller has seen and done.
#[derive(Clone, Debug, Default)]
struct Seen {
    /// Bytes of the download under way.
    downloaded: usize,
    /// Bytes of telemetry that it has sent.
    ticks: usize,
    /// When it sent the last one.
    last: Option<Instant>,
    runs: bool,
}

/// A stand-in for a controller at a terminal: it answers, takes a program, and sends at most so many bytes of
/// telemetry; after them it is dead.
struct StandIn {
    port: PathBuf,
    seen: Arc<Mutex<Seen>>,
    _thread: JoinHandle<()>,
}

impl StandIn {
    fn start(most: usize) -> Self {
        let (master, port) = pty();
        let seen = Arc::new(Mutex::new(Seen::default()));
        let shared = Arc::clone(&seen);
        let thread = std::thread::spawn(move || attend(&master, most, &shared));
        Self { port, seen, _thread: thread }
    }

    fn port(&self) -> &str {
        self.port.to_str().unwrap()
    }

    fn seen(&self) -> Seen {
        self.seen.lock().unwrap().clone()
    }
}

/// Is the stand-in until the program at the port has gone.
fn attend(master: &fs::File, most: usize, seen: &Mutex<Seen>) {
    let byte = || {
        let mut byte = [0];
        (&*master).read_exact(&mut byte).ok().map(|()| byte[0])
    };
    let say = |byte: u8| (&*master).write_all(&[byte]).unwrap();
    let mut left = most;
    while let Some(command) = byte() {
        match command {
            _ if left == 0 => {}
            b'C' => say(b'c'),
            b'x' | b'v' => say(16),
            b'D' => {
                let length = [byte(), byte()].map(Option::unwrap);
                for _ in 0..u16::from_le_bytes(length) {
                    if byte().is_none() {
                        return;
                    }
                    seen.lock().unwrap().downloaded += 1;
                }
            }
            b'R' => seen.lock().unwrap().runs = true,
            b'S' => seen.lock().unwrap().runs = false,
            _ => {}
        }
        while left > 0 && seen.lock().unwrap().runs && !is_readable(master) {
            say(3);
            left -= 1;
            let mut seen = seen.lock().unwrap();
            (seen.ticks, seen.last) = (seen.ticks + 1, Some(Instant::now()));
        }
    }
}

/// Whether something comes within 5 ms, a tick.
fn is_readable(file: &fs::File) -> bool {
    use rustix::event::{PollFd, PollFlags, Timespec, poll};
    let tick = Timespec { tv_sec: 0, tv_nsec: 5_000_000 };
    poll(&mut [PollFd::new(file, PollFlags::IN)], Some(&tick)).unwrap() > 0
}

/// No one has the port: it can be had for oneself alone.
fn is_free(port: &str) -> bool {
    serialport::new(port, 9600).open_native().is_ok()
}

#[test]
fn at_a_serial_port_it_is_the_same() {
    let up = Up::start(&["servo"]);
    let port = up.link();
    let port = port.to_str().unwrap();
    let folder = folder();
    let program = written(folder.path(), "x4 t0.5\nx0 t0.3\ne\n");
    // The first port is not there; the second has the controller.
    let output = servo(&["run", &program, "--port", "/dev/nowhere", "--port", port, "--kx", "20", "--json"]);
    let report = json(&output);
    assert_eq!((report["outcome"].as_str(), report["ticks"].as_u64()), (Some("completed"), Some(160)));
    assert_eq!((report["set_counts"].as_i64(), report["kx"].as_u64()), (Some(500), Some(20)));
    assert!(told(&output).2.contains("cannot open the serial port '/dev/nowhere'"));
    // The port is free again, and the controller has kept what it was told.
    let (code, out, _) = told(&servo(&["link", "--port", port, "--lang", "pl"]));
    assert_eq!((code, out), (Some(0), format!("sterownik połączony: {port}\nKx 20, Kv 0\n")));
}

/// What `torno servo link` says of a port at which somebody answers so, and how long it took.
fn answered(answer: &'static [u8]) -> (Option<i32>, String, Duration) {
    let (mut master, path) = pty();
    let answering = std::thread::spawn(move || {
        let mut byte = [0];
        // After the client has gone there is nothing to read.
        while master.read(&mut byte).is_ok_and(|n| n > 0) {
            if byte == *b"C" {
                master.write_all(answer).unwrap();
            }
        }
    });
    let begun = Instant::now();
    let (code, _, error) = told(&servo(&["link", "--port", path.to_str().unwrap(), "--lang", "pl"]));
    let took = begun.elapsed();
    drop(answering);
    (code, error, took)
}

#[test]
fn a_port_without_a_controller_is_told_within_two_seconds() {
    let (code, error, took) = answered(b"");
    assert!(code == Some(1) && error.contains("no answer from the controller on /dev/pts/"), "{error}");
    assert!(
        error.ends_with("Brak odpowiedzi sterownika !\nnie połączony\n") && took < Duration::from_secs(2),
        "{error} {took:?}"
    );
    let (code, error, _) = answered(b"AT\r\n");
    assert!(code == Some(1) && error.contains("expected 63 ('c'), found 41"), "{error}");
    let (code, _, error) = told(&servo(&["link", "--port", "/dev/nowhere"]));
    assert!(code == Some(2) && error.contains("cannot open the serial port '/dev/nowhere'"), "{error}");
}

#[test]
fn a_port_that_speaks_all_the_time_is_no_controller() {
    let (mut master, path) = pty();
    let speaking = std::thread::spawn(move || {
        let mut byte = [0];
        while master.read(&mut byte).is_ok_and(|n| n > 0) {
            master.write_all(&b"$GPGGA,123519,4807.038,N\r\n".repeat(20)).unwrap();
        }
    });
    let begun = Instant::now();
    let folder = folder();
    let program = written(folder.path(), "x10 t2\ne\n");
    let (code, out, error) = told(&servo(&["run", &program, "--port", path.to_str().unwrap()]));
    assert!(code == Some(1) && out.is_empty() && error.contains("is no controller of the servo stand"), "{error}");
    assert!(begun.elapsed() < TOLD);
    speaking.join().unwrap();
}

#[test]
fn a_busy_port_is_told_and_left_to_whom_it_belongs() {
    let (_master, path) = pty();
    let other = Pc::open(&path, 9600);
    let port = path.to_str().unwrap();
    let begun = Instant::now();
    let (code, _, error) = told(&servo(&["link", "--port", port]));
    assert!(begun.elapsed() < TOLD);
    let expected = format!("cannot open the serial port '{port}': Unable to acquire exclusive lock");
    assert!(code == Some(2) && error.contains(&expected), "{error}");
    drop(other);
    // A process that another test is starting has a copy of the port until it runs its program.
    let is_free = || !told(&servo(&["link", "--port", port])).2.contains(&expected);
    wait_until("the port is free", is_free);
    let (code, _, error) = told(&servo(&["link", "--port", port]));
    assert!(code == Some(1) && error.contains("no answer from the controller"), "{error}");
}

#[test]
fn a_controller_that_falls_silent_at_a_port_is_told_and_the_port_released() {
    let stand_in = StandIn::start(100);
    let folder = folder();
    let program = written(folder.path(), "x10 t2\ne\n");
    let (code, out, error) = told(&servo(&["run", &program, "--port", stand_in.port()]));
    let took = stand_in.seen().last.unwrap().elapsed();
    let expected = format!("the controller on {} has fallen silent after 100 of 400 ticks", stand_in.port());
    assert!(code == Some(1) && out.is_empty() && error.contains(&expected), "{error}");
    assert!(took < TOLD, "{took:?}");
}

#[test]
fn a_port_that_is_unplugged_in_mid_run_is_told() {
    let (mut master, path) = pty();
    let port = path.to_str().unwrap().to_owned();
    let answering = std::thread::spawn(move || {
        let mut byte = [0];
        loop {
            master.read_exact(&mut byte).unwrap();
            match byte {
                [b'C'] => master.write_all(b"c").unwrap(),
                [b'x' | b'v'] => master.write_all(&[16]).unwrap(),
                [b'R'] => return Instant::now(),
                _ => {}
            }
        }
    });
    let folder = folder();
    let program = written(folder.path(), "x1 t0.1\ne\n");
    let (code, _, error) = told(&servo(&["run", &program, "--port", &port]));
    let took = answering.join().unwrap().elapsed();
    assert!(code == Some(1) && error.contains(&format!("the serial port '{port}' failed")), "{error}");
    assert!(took < TOLD, "{took:?}");
}

#[test]
fn ctrl_c_in_mid_run_stops_the_carriage_and_releases_the_port() {
    let up = Up::start(&["servo"]);
    let port = up.link();
    let port = port.to_str().unwrap();
    let folder = folder();
    let program = written(folder.path(), "x20 t4\ne\n");
    let running = Running::servo(&["run", &program, "--port", port, "--json"]);
    up.wait_for_log("run begins");
    assert!(!is_free(port));
    running.signal("-INT");
    let (code, out, error) = running.end();
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!((code, report["outcome"].as_str()), (Some(130), Some("interrupted")), "{error}");
    up.wait_for_log("run stopped after");
    assert!(is_free(port));
    let (code, out, _) = told(&servo(&["link", "--port", port]));
    assert!(code == Some(0) && out.starts_with("controller connected: "), "{out}");
}

#[test]
fn ctrl_c_in_a_download_leaves_no_run_behind() {
    let stand_in = StandIn::start(1_000);
    let folder = folder();
    let program = written(folder.path(), "x425 t25.5\ne\n");
    let running = Running::servo(&["run", &program, "--port", stand_in.port()]);
    wait_until("a part of the program has come", || stand_in.seen().downloaded > 300);
    running.signal("-INT");
    let begun = Instant::now();
    let (code, ..) = running.end();
    let seen = stand_in.seen();
    assert!(code == Some(130) && begun.elapsed() < TOLD, "{code:?} {:?}", begun.elapsed());
    assert!(!seen.runs && seen.ticks == 0 && seen.downloaded < 5_100, "{seen:?}");
}

#[test]
fn a_carriage_that_was_left_in_motion_is_stopped_and_homed() {
    let up = Up::start(&["servo"]);
    let port = up.link();
    let port = port.to_str().unwrap();
    let folder = folder();
    let program = written(folder.path(), "x60 t12\ne\n");
    let running = Running::servo(&["run", &program, "--port", port]);
    up.wait_for_log("run begins");
    running.signal("-KILL");
    running.end();
    // In motion it answers nothing.
    let (code, _, error) = told(&servo(&["home", "--port", port]));
    assert!(code == Some(1) && error.contains("or it is in motion"), "{error}");
    assert_eq!(told(&servo(&["stop", "--port", port])), (Some(0), format!("stopped: {port}\n"), String::new()));
    up.wait_for_log("run stopped after");
    assert_eq!(told(&servo(&["home", "--port", port])), (Some(0), format!("position is 0: {port}\n"), String::new()));
    up.wait_for_log("homed");
}
