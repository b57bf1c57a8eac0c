//! What the tests of the whole share: the program under test, a rig that is up, a PC at its port.

#![allow(clippy::disallowed_methods, reason = "patience has an end by the wall clock")]

pub(crate) mod browser;
pub(crate) mod clients;
pub(crate) mod play;

use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use serialport::{SerialPort, TTYPort};

/// How long anything may take before a test gives it up. Never waited for in a test that passes.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);

pub(crate) const ACK: u8 = 0x06;
pub(crate) const XON: u8 = 0x11;
pub(crate) const XOFF: u8 = 0x13;
pub(crate) const NAK: u8 = 0x15;
pub(crate) const CAN: u8 = 0x18;

/// Moves nothing and leaves the spindle standing: done after a few samples.
pub(crate) const AT_REST: [u8; 8] = [0; 8];
/// Spindle to 200 rpm, feed 225 counts, depth 1 slot out: done after about a second.
pub(crate) const SHORT: [u8; 8] = [0x0a, 0xe1, 0x00, 0xe1, 0x00, 0x00, 0x01, 0x00];
/// Depth 400 slots: four and a half minutes.
pub(crate) const LONG: [u8; 8] = [0x00, 0x00, 0x00, 0x00, 0x00, 0x01, 0x90, 0x00];

/// The program under test.
pub(crate) fn torno(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_torno"));
    command.args(arguments).env_remove("RUST_LOG").stdin(Stdio::null());
    command
}

/// Runs it to its end.
pub(crate) fn output(arguments: &[&str]) -> Output {
    torno(arguments).output().unwrap()
}

/// Writes a scenario, and tests it through the binary: the exit code, standard output, standard error, the path.
pub(crate) fn test(text: &str) -> (Option<i32>, String, String, String) {
    let folder = folder();
    let path = folder.path().join("a.toml");
    std::fs::write(&path, text).unwrap();
    let path = path.to_str().unwrap().to_owned();
    let output = output(&["test", &path]);
    let [out, err] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    (output.status.code(), out, err, path)
}

/// Whether a program that others wrote is there, as `check` finds out. Where it is not, says that its test is skipped;
/// in CI it must be there.
pub(crate) fn is_installed(name: &str, check: &mut Command) -> bool {
    let found = check.stdin(Stdio::null()).output().is_ok_and(|output| output.status.success());
    if !found {
        assert!(std::env::var_os("CI").is_none(), "{name} is not installed, and in CI nothing is skipped");
        // Not `eprintln`, which the test harness keeps to itself.
        std::io::stderr().write_all(format!("skipped: {name} is not installed\n").as_bytes()).unwrap();
    }
    found
}

/// What it printed as JSON, one line.
pub(crate) fn json(output: &Output) -> Value {
    let text = std::str::from_utf8(&output.stdout).unwrap();
    assert_eq!(text.lines().count(), 1, "{text}\n{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_str(text).unwrap()
}

/// A rig file of so many masters with three slaves each: `master0`, `spindle0`… The PC is at the first one; nothing
/// is at the PC's port of the others, which idle.
pub(crate) fn rig_of(masters: usize) -> String {
    let mut text = "name = \"masters\"\ndialect = \"lathe\"\n[pc]\nport = \"master0.pc\"\n".to_owned();
    for n in 0..masters {
        for kind in ["master", "spindle", "transverse", "depth"] {
            text += &format!("[[board]]\nname = \"{kind}{n}\"\nkind = \"{kind}\"\n");
        }
        for slave in ["spindle", "transverse", "depth"] {
            text += &format!("[[link]]\nends = [\"master{n}.{slave}\", \"{slave}{n}.master\"]\n");
        }
    }
    text
}

/// The lathe with a boring bar in a bore of 10 mm, two slots clear of its wall: a file of a folder.
pub(crate) fn boring(folder: &Path) -> String {
    let text = include_str!("../../harness/builtin/lathe.toml");
    let text = text.replacen("out_mm = 60", "bore_mm = 10\nout_mm = 60", 1);
    let text = text.replacen("trail_deg = 32 }", "trail_deg = 32, cuts = \"inside\" }", 1);
    let path = folder.join("boring.toml");
    std::fs::write(&path, text.replacen("start_mm = 0.35555555555556", "start_mm = -0.35555555555556", 1)).unwrap();
    path.to_str().unwrap().to_owned()
}

/// A folder of the test's own.
pub(crate) fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

/// Waits for a fact, without hope of being told. Says whether it came true.
pub(crate) fn comes_true(mut fact: impl FnMut() -> bool) -> bool {
    let start = Instant::now();
    loop {
        if fact() {
            return true;
        }
        if start.elapsed() > PATIENCE {
            return false;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Waits for a fact that has to come true.
pub(crate) fn wait_until(what: &str, fact: impl FnMut() -> bool) {
    assert!(comes_true(fact), "never came true: {what}");
}

/// Whether a process runs, or is stopped: not whether it has died and waits to be buried.
pub(crate) fn is_alive(pid: u64) -> bool {
    let Ok(status) = std::fs::read_to_string(format!("/proc/{pid}/stat")) else { return false };
    let state = status.rsplit(')').next().and_then(|rest| rest.split_whitespace().next());
    !matches!(state, Some("Z" | "X"))
}

/// Waits until a process has something in mind for Ctrl-C, other than to die of it.
pub(crate) fn wait_until_interruptible(pid: u64) {
    wait_until("SIGINT is caught", || {
        let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
        let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).unwrap().trim();
        u64::from_str_radix(caught, 16).unwrap() & 0b10 != 0
    });
}

/// Sends a signal, as a user would.
pub(crate) fn kill(signal: &str, pid: u64) {
    let status = Command::new("kill").args([signal, &pid.to_string()]).status().unwrap();
    assert!(status.success(), "kill {signal} {pid}");
}

/// A rig that is up, until it is dropped.
pub(crate) struct Up {
    pub(crate) child: Child,
    pub(crate) ready: Value,
    folder: tempfile::TempDir,
}

impl Up {
    /// `torno up --json` with more arguments, in a folder of its own; waits until it is ready.
    pub(crate) fn start(arguments: &[&str]) -> Self {
        let folder = folder();
        // Where the tests run under nohup, a hangup would be ignored.
        let mut command = Command::new("env");
        command.args(["--default-signal=HUP", "-u", "RUST_LOG", env!("CARGO_BIN_EXE_torno"), "up", "--json", "--link"]);
        command.arg(folder.path().join("pc")).args(arguments).stdin(Stdio::null());
        Self::launch(command, folder)
    }

    /// Any command that ends in `torno up --json`; its log goes into `folder`.
    pub(crate) fn launch(mut command: Command, folder: tempfile::TempDir) -> Self {
        let log = std::fs::File::create(folder.path().join("log")).unwrap();
        let mut child = command.stdout(Stdio::piped()).stderr(log).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let ready = serde_json::from_str(&line).unwrap_or_else(|_| panic!("not ready: {line:?}"));
        Self { child, ready, folder }
    }

    pub(crate) fn pid(&self) -> u64 {
        u64::from(self.child.id())
    }

    pub(crate) fn board(&self, name: &str) -> u64 {
        self.ready["boards"][name]["pid"].as_u64().unwrap()
    }

    pub(crate) fn boards(&self) -> Vec<u64> {
        ["master", "spindle", "transverse", "depth"].map(|name| self.board(name)).to_vec()
    }

    pub(crate) fn link(&self) -> PathBuf {
        PathBuf::from(self.ready["ports"]["pc"]["path"].as_str().unwrap())
    }

    /// What it has logged so far.
    pub(crate) fn log(&self) -> String {
        std::fs::read_to_string(self.folder.path().join("log")).unwrap()
    }

    pub(crate) fn wait_for_log(&self, text: &str) {
        assert!(comes_true(|| self.log().contains(text)), "never logged: {text}\n{}", self.log());
    }

    pub(crate) fn pc(&self) -> Pc {
        Pc::open(&self.link(), 9600)
    }
}

impl Drop for Up {
    fn drop(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
    }
}

/// A PC at a serial port: a client that blocks.
pub(crate) struct Pc {
    pub(crate) port: TTYPort,
}

impl Pc {
    pub(crate) fn open(path: &Path, baud: u32) -> Self {
        let port = serialport::new(path.to_str().unwrap(), baud).timeout(PATIENCE).open_native().unwrap();
        Self { port }
    }

    pub(crate) fn write(&mut self, bytes: &[u8]) {
        self.port.write_all(bytes).unwrap();
    }

    /// The next `n` bytes.
    pub(crate) fn read(&mut self, n: usize) -> Vec<u8> {
        let mut bytes = vec![0; n];
        let mut got = 0;
        while got < n {
            match self.port.read(&mut bytes[got..]) {
                Ok(more) => got += more,
                // By news of a child that another test in this process has.
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::TimedOut => panic!("only {:02x?} came", &bytes[..got]),
                Err(error) => panic!("{error}"),
            }
        }
        bytes
    }

    /// Expects exactly these bytes next.
    pub(crate) fn expect(&mut self, bytes: &[u8]) {
        assert_eq!(self.read(bytes.len()), bytes, "expected {bytes:02x?}");
    }

    /// Whether nothing has come that has not been read.
    pub(crate) fn is_silent(&self) -> bool {
        self.port.bytes_to_read().unwrap() == 0
    }
}
