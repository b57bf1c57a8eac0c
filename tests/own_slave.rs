//! A program of one's own in the place of a board, and one that listens to a line.

use std::io::Read;
use std::process::{Child, Command, Stdio};

use crate::common::{ACK, CAN, Up, XON, folder, kill, output, torno, wait_until};
use crate::pc_port::python_with_serial;

const SLAVE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/depth.py");

/// The lathe without its depth board. The master is patient with a slave on a busy computer.
fn up_without_depth(arguments: &[&str]) -> Up {
    let folder = folder();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let mut command = torno(&["up", "--json", "--link", &path("pc"), "--set", "master.answer_ms=1000"]);
    command.args(arguments);
    Up::launch(command, folder)
}

/// The script, in the depth board's place.
struct Slave(Child);

impl Slave {
    /// None if it cannot be run here.
    fn at(port: &str) -> Option<Self> {
        let mut command = Command::new(python_with_serial()?);
        Some(Self(command.arg(SLAVE).arg(port).stdout(Stdio::piped()).spawn().unwrap()))
    }

    /// Ends it. Gives what it has told.
    fn end(mut self) -> String {
        self.0.kill().unwrap();
        let mut told = String::new();
        self.0.stdout.take().unwrap().read_to_string(&mut told).unwrap();
        self.0.wait().unwrap();
        told
    }
}

impl Drop for Slave {
    fn drop(&mut self) {
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

/// The port of a gateway, or of a tap, as pyserial opens it.
fn port<'a>(up: &'a Up, kind: &str, name: &str) -> &'a str {
    up.ready[kind][name]["port"].as_str().unwrap()
}

#[test]
fn a_script_takes_the_depth_boards_place_and_its_recording_needs_no_script() {
    let own = folder();
    let path = |name: &str| own.path().join(name).to_str().unwrap().to_owned();
    for transport in [path("depth"), "tcp://127.0.0.1:0".to_owned(), "rfc2217://127.0.0.1:0".to_owned()] {
        let (record, open, tap) = (path("a.torno"), format!("depth={transport}"), path("tap"));
        let tap_at = format!("master_to_depth={tap}");
        let mut up = up_without_depth(&["--open", &open, "--tap", &tap_at, "--record", &record]);
        assert_eq!(up.ready["open"], serde_json::json!(["depth"]));
        assert!(up.ready["boards"].get("depth").is_none());
        assert_eq!(port(&up, "taps", "master_to_depth"), tap);
        let mut tap = crate::common::Pc::open(tap.as_ref(), 9600);
        let Some(slave) = Slave::at(port(&up, "ports", "depth")) else { return };
        let program = path("a.frames");
        std::fs::write(&program, "00 e1 00 e1 00 00 02 00\n00 00 00 00 00 00 01 01\n").unwrap();
        let sent = output(&["send", &program, "--port", up.link().to_str().unwrap()]);
        assert!(sent.status.success(), "{}{}", String::from_utf8_lossy(&sent.stdout), up.log());
        // The master asks it every second, and it is dead.
        let mut pc = up.pc();
        pc.write(&[0, 0, 0, 0, 0, 0, 9, 0]);
        pc.expect(&[ACK]);
        // It has taken its sub-frame when it is asked again.
        let mut heard = Vec::new();
        while !heard.ends_with(&[0, 9, 0, 5]) {
            heard.extend(tap.read(1));
        }
        assert_eq!(heard[0], 5, "it is asked at the start");
        heard.retain(|byte| *byte != 5);
        assert_eq!(heard, [0, 2, 0, 0, 1, 1, 0, 9, 0]);
        assert_eq!(slave.end(), "2 slots out, to 2\n1 slots in, to 1\n9 slots out, to 10\n");
        pc.expect(&[CAN, b'd', b'n', XON]);
        kill("-INT", up.pid());
        up.child.wait().unwrap();
        let replayed = output(&["replay", &record]);
        assert!(replayed.status.success(), "{}", String::from_utf8_lossy(&replayed.stderr));
        let traced = output(&["trace", &record, "--kind", "frames", "--line", "depth_to_master"]);
        let traced = String::from_utf8(traced.stdout).unwrap();
        assert!(traced.contains("ACK: done (odd)") && traced.contains("ACK: done (even)"), "{traced}");
    }
}

#[test]
fn time_begins_when_a_program_is_in_the_place() {
    let own = folder();
    let place = own.path().join("depth");
    let up = up_without_depth(&["--open", &format!("depth={}", place.display())]);
    let state = || {
        let control = up.ready["control"].as_str().unwrap();
        let output = output(&["ctl", "--socket", control, "--json", "state"]);
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()
    };
    assert_eq!((&state()["ns"], &state()["paused"]), (&0.into(), &true.into()));
    let _slave = crate::common::Pc::open(&place, 9600);
    wait_until("time goes", || state()["ns"].as_u64() > Some(0));
    assert!(up.log().contains("'depth' is left out: nothing will be known of its telemetry, nor of the part"));
    assert!(!up.log().contains("deadlines pass in virtual time"));
}

#[test]
fn at_full_speed_the_rig_says_that_a_program_has_no_time_to_answer() {
    let own = folder();
    let up = up_without_depth(&["--open", &format!("depth={}", own.path().join("d").display()), "--pace", "max"]);
    assert!(up.log().contains("at pace max, deadlines pass in virtual time"), "{}", up.log());
}

#[test]
fn a_place_or_a_tap_that_there_is_not_is_refused() {
    for (arguments, expected) in [
        (["--open", "dept"], "--open 'dept': there is no board 'dept': did you mean 'depth'?"),
        (["--open", "master"], "the gateway 'pc' is at 'master'"),
        (["--open", "depth=udp://1"], "--open: 'udp://1' is no transport"),
        (["--tap", "master_to_dept"], "there is no line 'master_to_dept': did you mean 'master_to_depth'?"),
        (["--tap", "master_to_depth=tcp://x"], "--tap: 'tcp://x': expected an IP address"),
    ] {
        let folder = folder();
        let link = folder.path().join("pc");
        let output = output(&["up", "--link", link.to_str().unwrap(), arguments[0], arguments[1]]);
        let message = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && message.contains(expected), "{arguments:?}: {message}");
    }
}

#[test]
fn a_tap_hears_a_line_of_a_whole_rig_and_what_is_written_to_it_goes_nowhere() {
    let own = folder();
    let tap = format!("pc_to_master={}", own.path().join("tap").display());
    let up = Up::start(&["--pace", "20", "--tap", &tap, "--tap", "master_to_pc=tcp://127.0.0.1:0"]);
    let mut tap = crate::common::Pc::open(&own.path().join("tap"), 9600);
    let address = port(&up, "taps", "master_to_pc").strip_prefix("socket://").unwrap();
    let mut replies = std::net::TcpStream::connect(address).unwrap();
    replies.set_read_timeout(Some(crate::common::PATIENCE)).unwrap();
    tap.write(b"nowhere");
    // Whoever comes late to a line has missed something.
    for line in ["pc_to_master", "master_to_pc"] {
        up.wait_for_log(&format!("a program listens to {line}"));
    }
    let mut pc = up.pc();
    let frame = [0, 0xe1, 0, 1, 0, 0, 0, 0];
    pc.write(&frame);
    pc.expect(&[ACK, XON]);
    tap.expect(&frame);
    let mut heard = [0; 2];
    replies.read_exact(&mut heard).unwrap();
    assert_eq!(heard, [ACK, XON]);
}
