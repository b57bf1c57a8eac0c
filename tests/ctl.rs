//! A rig that is up, steered and broken from outside, while a client is at its port.

#![allow(clippy::disallowed_methods, reason = "a pace is measured by the wall clock")]

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::common::{ACK, AT_REST, CAN, LONG, PATIENCE, SHORT, Up, XON, folder, kill, output, torno, wait_until};
use serde_json::Value;

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

fn control(up: &Up) -> String {
    up.ready["control"].as_str().unwrap().to_owned()
}

/// `torno ctl`, which must end well; its answer.
fn ctl(up: &Up, arguments: &[&str]) -> Value {
    let output = output(&[&["ctl", "--json", "--socket", &control(up)], arguments].concat());
    assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    crate::common::json(&output)
}

/// `torno ctl`, which must be refused; what it complains of.
fn refused(up: &Up, arguments: &[&str]) -> String {
    let output = output(&[&["ctl", "--socket", &control(up)], arguments].concat());
    assert_eq!(output.status.code(), Some(2), "{arguments:?}");
    stderr(&output)
}

fn board<'a>(state: &'a Value, name: &str) -> &'a Value {
    state["boards"].as_array().unwrap().iter().find(|board| board["name"] == name).unwrap()
}

fn end(mut up: Up) {
    kill("-INT", up.pid());
    assert!(up.child.wait().unwrap().success());
}

/// The same of a rig of which a board has died.
fn end_without_a_board(mut up: Up) {
    kill("-INT", up.pid());
    assert_eq!(up.child.wait().unwrap().code(), Some(1));
}

fn repeats(trace: &Path) {
    for driver in [&[][..], &["--processes"]] {
        let output = output(&[&["replay", trace.to_str().unwrap()], driver].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        assert!(String::from_utf8(output.stdout).unwrap().starts_with("same digest "));
    }
}

#[test]
fn what_is_done_to_a_live_rig_is_repeated_with_the_same_digest() {
    let folder = folder();
    let trace = folder.path().join("a.torno");
    let up = Up::start(&["--pace", "20", "--record", trace.to_str().unwrap()]);
    let mut pc = up.pc();
    ctl(&up, &["fault", "stall", "depth", "--name", "chip"]);
    pc.write(&SHORT);
    pc.expect(&[ACK]);
    ctl(&up, &["heal", "chip"]);
    while pc.read(1) != [XON] {}
    // A line that breaks in the middle of what comes.
    ctl(&up, &["fault", "flip", "pc_to_master", "5", "--nth", "3"]);
    pc.write(&LONG);
    pc.read(1);
    ctl(&up, &["fault", "noise", "master_to_depth", "--period", "20 ms", "--for", "300 ms"]);
    ctl(&up, &["power", "transverse", "off"]);
    ctl(&up, &["fault", "drift", "spindle", "0.1 %", "--for", "500 ms"]);
    ctl(&up, &["pause"]);
    ctl(&up, &["fault", "cut", "spindle_to_master", "--name", "wire", "--for", "100 s"]);
    ctl(&up, &["fault", "hang", "spindle", "--name", "hang", "--for", "100 s"]);
    ctl(&up, &["step", "700 ms"]);
    // Before their time.
    ctl(&up, &["heal", "wire"]);
    ctl(&up, &["heal", "hang"]);
    ctl(&up, &["power", "transverse", "on"]);
    ctl(&up, &["pace", "max"]);
    ctl(&up, &["resume"]);
    ctl(&up, &["pace", "20"]);
    ctl(&up, &["fault", "crash", "depth", "--when", "{ board = \"depth\", quantity = \"drive\", at_least = -1 }"]);
    end(up);
    repeats(&trace);
    let shown = output(&["trace", trace.to_str().unwrap(), "--kind", "inputs"]);
    let shown = String::from_utf8(shown.stdout).unwrap();
    for expected in ["shaft blocked", "shaft free", "bit 5 flipped", "noise", "supply off", "supply on", "ppb"] {
        assert!(shown.contains(expected), "{expected}\n{shown}");
    }
}

#[test]
fn a_rig_answers_and_ends_in_the_middle_of_a_long_step() {
    for driver in [&["--pace", "max"][..], &["--pace", "max", "--in-process"]] {
        let mut up = Up::start(driver);
        let mut pc = up.pc();
        // The spindle has much to report every second in which it turns.
        pc.write(&[0x4b, 0xe1, 0, 0, 0, 0, 0, 0]);
        pc.expect(&[ACK, XON]);
        ctl(&up, &["pause"]);
        let step = || {
            let mut step = torno(&["ctl", "--socket", &control(&up), "step", "100000000 s"]);
            step.stderr(Stdio::piped()).spawn().unwrap()
        };
        let now = || ctl(&up, &["state"])["ns"].as_u64().unwrap();
        let (first, before) = (step(), now());
        let mut reached = before;
        for _ in 0..3 {
            let last = reached;
            wait_until("time goes on", || {
                reached = now();
                reached > last
            });
        }
        let paused = ctl(&up, &["pause"])["ns"].as_u64().unwrap();
        assert!(paused >= reached, "{paused} {reached}");
        let first = first.wait_with_output().unwrap();
        assert!(stderr(&first).contains("is ended by a pause at "), "{}", stderr(&first));
        let again = step();
        wait_until("time goes on", || now() > paused);
        kill("-INT", up.pid());
        assert!(up.child.wait().unwrap().success());
        let again = again.wait_with_output().unwrap();
        assert!(!again.status.success(), "{again:?}");
    }
}

#[test]
fn what_is_asked_is_of_the_instant_at_which_it_is_asked() {
    // Nothing happens in this rig, so nothing but the question makes it look at the clock.
    let up = Up::start(&["--pace", "20"]);
    let asked = |request: &[&str]| {
        let begun = Instant::now();
        let ns = ctl(&up, request)["ns"].as_u64().unwrap();
        (begun, ns, Instant::now())
    };
    let (_, first, answered) = asked(&["state"]);
    std::thread::sleep(Duration::from_millis(150));
    let (begun, second, _) = asked(&["state"]);
    let wall_ns = |span: Duration| u64::try_from(span.as_nanos()).unwrap();
    assert!(second - first >= 20 * wall_ns(begun - answered) / 10 * 9, "{first} {second}");
    std::thread::sleep(Duration::from_millis(150));
    let (_, paused, _) = asked(&["pause"]);
    assert!(paused >= second + 2_000_000_000, "{second} {paused}");
    let pace = asked(&["resume"]).1;
    assert_eq!(pace, paused);
    end(up);
}

#[test]
fn an_empty_request_has_an_answer() {
    let up = Up::start(&[]);
    let mut socket = UnixStream::connect(control(&up)).unwrap();
    socket.write_all(b"\n  \r\n{\"do\":\"pause\"}\n").unwrap();
    let mut lines = BufReader::new(socket).lines().map(|line| serde_json::from_str::<Value>(&line.unwrap()).unwrap());
    for _ in 0..2 {
        assert_eq!(lines.next().unwrap()["error"], "expected a request, found an empty line");
    }
    assert!(lines.next().unwrap()["ok"]["ns"].is_u64());
    end(up);
}

#[test]
fn no_more_than_sixteen_watch_at_once() {
    let up = Up::start(&["--pace", "max"]);
    let watch = || {
        let mut socket = UnixStream::connect(control(&up)).unwrap();
        socket.write_all(b"{\"do\":\"watch\"}\n").unwrap();
        let mut answer = String::new();
        BufReader::new(socket.try_clone().unwrap()).read_line(&mut answer).unwrap();
        (socket, serde_json::from_str::<Value>(&answer).unwrap())
    };
    let mut watching: Vec<_> = (0..16).map(|_| watch()).collect();
    assert!(watching.iter().all(|(_, answer)| answer["ok"]["ns"].is_u64()), "{watching:?}");
    assert_eq!(watch().1["error"], "16 watch already: expected no more");
    watching.pop();
    wait_until("another may watch", || watch().1["ok"]["ns"].is_u64());
    end(up);
}

#[test]
fn a_socket_that_is_another_s_by_now_is_left_there() {
    let folder = folder();
    let path = folder.path().join("control");
    let up = Up::start(&["--control", path.to_str().unwrap()]);
    fs::remove_file(&path).unwrap();
    let _other = UnixListener::bind(&path).unwrap();
    end(up);
    assert!(UnixStream::connect(&path).is_ok());
}

#[test]
fn a_state_tells_who_waits_for_whom() {
    let up = Up::start(&["--pace", "20"]);
    let mut pc = up.pc();
    let state = ctl(&up, &["state"]);
    assert_eq!((&state["rig"], &state["pace"], &state["paused"]), (&"lathe".into(), &"20".into(), &false.into()));
    assert_eq!(board(&state, "depth")["pid"], up.board("depth"));
    assert_eq!(board(&state, "master")["waits_for"], serde_json::json!([]));
    pc.write(&LONG);
    pc.expect(&[ACK]);
    wait_until("only the depth moves", || {
        board(&ctl(&up, &["state"]), "master")["waits_for"] == serde_json::json!(["depth"])
    });
    kill("-STOP", up.board("depth"));
    up.wait_for_log("was stopped");
    assert_eq!(board(&ctl(&up, &["state"]), "depth")["process"], "stopped");
    kill("-CONT", up.board("depth"));
    up.wait_for_log("was continued");
    assert_eq!(board(&ctl(&up, &["state"]), "depth")["process"], "runs");
    let text = output(&["ctl", "--socket", &control(&up), "state"]);
    let text = String::from_utf8(text.stdout).unwrap();
    assert!(text.starts_with("lathe at ") && text.contains("\nmaster") && text.contains("slaves_busy"), "{text}");
    end(up);
}

#[test]
fn time_stands_still_and_goes_on_as_it_is_told() {
    let up = Up::start(&["--pace", "max"]);
    let mut pc = up.pc();
    let now = |up: &Up| ctl(up, &["state"])["ns"].as_u64().unwrap();
    ctl(&up, &["pause"]);
    let paused = now(&up);
    // What comes meanwhile waits.
    pc.write(&AT_REST);
    assert_eq!(now(&up), paused);
    assert!(pc.is_silent());
    assert_eq!(ctl(&up, &["step", "5 ms"])["ns"], paused + 5_000_000);
    assert_eq!(now(&up), paused + 5_000_000);
    assert!(pc.is_silent());
    assert_eq!(ctl(&up, &["step", "20 ms"])["ns"], paused + 25_000_000);
    pc.expect(&[ACK]);
    assert!(pc.is_silent());
    ctl(&up, &["resume"]);
    pc.expect(&[XON]);
    ctl(&up, &["pace", "0.001"]);
    assert_eq!(ctl(&up, &["state"])["pace"], "0.001");
    pc.write(&AT_REST);
    ctl(&up, &["pace", "1"]);
    pc.expect(&[ACK, XON]);
    assert!(refused(&up, &["pace", "fast"]).contains("expected 'max' or a number"));
    assert!(refused(&up, &["step", "5"]).contains("5"));
    end(up);
}

/// A client of the socket that speaks for itself.
struct Client {
    socket: BufReader<UnixStream>,
}

impl Client {
    fn of(up: &Up) -> Self {
        let socket = UnixStream::connect(control(up)).unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        Self { socket: BufReader::new(socket) }
    }

    fn send(&mut self, bytes: &[u8]) {
        self.socket.get_mut().write_all(bytes).unwrap();
    }

    fn read(&mut self) -> Value {
        let mut line = String::new();
        self.socket.read_line(&mut line).unwrap();
        serde_json::from_str(&line).unwrap_or_else(|_| panic!("no JSON: {line:?}"))
    }

    fn ask(&mut self, request: &Value) -> Value {
        self.send(format!("{request}\n").as_bytes());
        self.read()
    }

    /// What comes before the answer to the last request, and the answer.
    fn rows_and_answer(&mut self) -> (Vec<Value>, Value) {
        let mut rows = Vec::new();
        loop {
            let line = self.read();
            if line.get("ns").is_none() && line.get("lost").is_none() {
                return (rows, line);
            }
            rows.push(line);
        }
    }
}

/// A drift of one part in a million a second: it takes more than two days to where it cannot go on.
const SLOW_DRIFT: [&str; 4] = ["fault", "drift", "depth", "0.0001 %"];

#[test]
fn a_step_that_does_not_come_to_its_end_is_answered() {
    let up = Up::start(&["--pace", "1"]);
    // Much is to be done on the way.
    ctl(&up, &SLOW_DRIFT);
    for (ends, go_on) in [("pause", "resume"), ("resume", "pause")] {
        ctl(&up, &["pause"]);
        let mut client = Client::of(&up);
        client.send(b"{\"do\":\"step\",\"span\":\"100000 s\"}\n");
        let before = ctl(&up, &["state"])["ns"].as_u64().unwrap();
        wait_until("it is under way", || ctl(&up, &["state"])["ns"].as_u64().unwrap() > before);
        assert!(refused(&up, &["step", "1 s"]).contains("a step is under way already"));
        ctl(&up, &[ends]);
        let answer = client.read();
        assert!(answer["error"].as_str().unwrap().contains(&format!("is ended by a {ends} at ")), "{answer}");
        ctl(&up, &[go_on]);
    }
    end(up);
}

/// Time goes on for as long as there is something to do, and whoever asks for something is heard all the same.
#[test]
fn a_rig_that_never_falls_quiet_is_steered() {
    let up = Up::start(&["--pace", "max"]);
    ctl(&up, &["fault", "noise", "master_to_pc", "--period", "100 us"]);
    let mut client = Client::of(&up);
    let state = serde_json::json!({ "do": "state" });
    let before = client.ask(&state)["ok"]["ns"].as_u64().unwrap();
    wait_until("time goes on", || client.ask(&state)["ok"]["ns"].as_u64().unwrap() > before);
    let paused = client.ask(&serde_json::json!({ "do": "pause" }))["ok"]["ns"].as_u64();
    assert_eq!(client.ask(&state)["ok"]["ns"].as_u64(), paused);
    end(up);
}

#[test]
fn a_drift_that_goes_nowhere_does_not_drive_time() {
    let up = Up::start(&["--pace", "max"]);
    ctl(&up, &["fault", "drift", "depth", "0 %"]);
    let now = || ctl(&up, &["state"])["ns"].as_u64().unwrap();
    let before = now();
    assert!((0..5).all(|_| now() == before));
    ctl(&up, &["heal", "depth drift"]);
    end(up);
}

#[test]
fn whatever_a_client_sends_is_answered() {
    let up = Up::start(&[]);
    let mut client = Client::of(&up);
    let state = "{\"do\":\"state\"}\n";
    for (line, expected) in [
        (&b"{\"do\":\"stat\"}\n"[..], "expected a request: unknown variant `stat`"),
        (b"{\"do\":\"heal\",\"name\":\"\xff\"}\n", "expected a request in UTF-8, found something else at byte 21"),
    ] {
        client.send(line);
        let answer = client.read();
        assert!(answer["error"].as_str().unwrap().contains(expected), "{answer}");
        client.send(state.as_bytes());
        assert_eq!(client.read()["ok"]["rig"], "lathe");
    }
    // A line is as long as the longest program, quoted. One without an end is answered, too.
    let mib = b"x".repeat(1 << 20);
    (0..256).for_each(|_| client.send(&mib));
    client.send(b"x");
    let answer = client.read();
    assert!(answer["error"].as_str().unwrap().contains("no more than 268435456 bytes"), "{answer}");
    client.send(&[b"\n", state.as_bytes()].concat());
    assert_eq!(client.read()["ok"]["rig"], "lathe");
    end(up);
}

#[test]
fn a_rig_without_file_descriptors_is_steered_again_when_it_has_some() {
    let folder = folder();
    let script = "ulimit -n 48; exec \"$0\" up --json --link \"$1\"";
    let mut command = Command::new("sh");
    command.args(["-c", script, env!("CARGO_BIN_EXE_torno"), folder.path().join("pc").to_str().unwrap()]);
    let up = Up::launch(command, folder);
    let open = || fs::read_dir(format!("/proc/{}/fd", up.pid())).unwrap().count();
    let refuses = || up.log().contains("no one new can steer the rig for now");
    let mut clients = Vec::new();
    while !refuses() {
        let before = open();
        clients.push(UnixStream::connect(control(&up)).unwrap());
        wait_until("it is accepted or not", || open() > before || refuses());
    }
    assert!(clients.len() > 5, "{}", clients.len());
    clients.clear();
    assert_eq!(ctl(&up, &["state"])["rig"], "lathe");
    end(up);
}

#[test]
fn the_pc_has_a_supply_too() {
    let folder = folder();
    let trace = folder.path().join("a.torno");
    let up = Up::start(&["--pace", "20", "--record", trace.to_str().unwrap()]);
    let mut watch = Watch::start(&up, &["--json", "--board", "pc", "--kind", "inputs"]);
    let mut pc = up.pc();
    ctl(&up, &["power", "pc", "off"]);
    // As much as the UART's driver takes, and it is lost.
    pc.write(&[SHORT, SHORT].concat());
    watch.next_with("writes 0A E1");
    ctl(&up, &["fault", "power-off", "pc", "--name", "again"]);
    ctl(&up, &["heal", "again"]);
    pc.write(&AT_REST);
    pc.expect(&[ACK, XON]);
    end(up);
    repeats(&trace);
}

/// What a trace shows of these kinds before `until`, from `from` on: each row's text.
fn recorded(trace: &Path, kinds: &[&str], from: u64, until: u64) -> Vec<String> {
    let kinds: Vec<&str> = kinds.iter().flat_map(|kind| ["--kind", kind]).collect();
    let shown = output(&[&["trace", trace.to_str().unwrap(), "--json"], &kinds[..]].concat());
    let rows = String::from_utf8(shown.stdout).unwrap();
    let rows = rows.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    rows.filter(|row| (from..until).contains(&row["ns"].as_u64().unwrap())).map(|row| row.to_string()).collect()
}

const EVERYTHING: [&str; 6] = ["edges", "characters", "frames", "telemetry", "events", "inputs"];

fn watch(kinds: &[&str]) -> Value {
    serde_json::json!({ "do": "watch", "kinds": kinds })
}

#[test]
fn a_watch_shows_all_that_a_trace_does_in_order_of_time() {
    for pace in ["20", "max"] {
        shows_all_in_order(pace);
    }
}

fn shows_all_in_order(pace: &str) {
    let folder = folder();
    let trace = folder.path().join("a.torno");
    let up = Up::start(&["--pace", pace, "--record", trace.to_str().unwrap()]);
    let mut client = Client::of(&up);
    let from = client.ask(&watch(&EVERYTHING))["ok"]["ns"].as_u64().unwrap();
    let mut pc = up.pc();
    pc.write(&SHORT);
    pc.expect(&[ACK, XON]);
    pc.write(&SHORT);
    pc.expect(&[ACK]);
    // What moves on while nothing is said.
    client.send(b"{\"do\":\"pause\"}\n");
    let (mut rows, answer) = client.rows_and_answer();
    assert!(answer["ok"]["ns"].as_u64() > Some(from));
    ctl(&up, &["fault", "noise", "master_to_depth", "--period", "3 ms"]);
    client.send(b"{\"do\":\"step\",\"span\":\"30 s\"}\n");
    let (more, answer) = client.rows_and_answer();
    let until = answer["ok"]["ns"].as_u64().unwrap();
    assert!(more.len() > 10_000, "{}", more.len());
    rows.extend(more);
    end(up);
    repeats(&trace);
    // What is cut short stands at its last character, and comes when that shows; and a watch can begin in the middle of
    // a character.
    let from = from + 20_000_000;
    let whole = |row: &str| !row.contains("cut short");
    rows.retain(|row| row["ns"].as_u64() >= Some(from) && whole(&row.to_string()));
    let instants: Vec<u64> = rows.iter().map(|row| row["ns"].as_u64().unwrap()).collect();
    let early = instants.windows(2).position(|pair| pair[0] > pair[1]);
    assert_eq!(early.map(|place| &rows[place..place + 2]), None);
    let mut shown: Vec<String> = rows.iter().map(Value::to_string).collect();
    let mut recorded = recorded(&trace, &EVERYTHING, from, until);
    recorded.retain(|row| whole(row));
    shown.sort();
    recorded.sort();
    let missing = recorded.iter().zip(&shown).position(|(a, b)| a != b).map(|n| (&recorded[n], &shown[n]));
    assert_eq!((missing, shown.len()), (None, recorded.len()));
}

#[test]
fn what_a_motor_does_is_watched_when_it_does_it() {
    let up = Up::start(&["--pace", "20"]);
    let mut pc = up.pc();
    // 2000 rpm, and no drive: it coasts for half a minute, and no one asks its board for anything.
    for frame in [[0x64, 0, 0, 0, 0, 0, 0, 0], AT_REST] {
        pc.write(&frame);
        pc.expect(&[ACK, XON]);
    }
    ctl(&up, &["pace", "0.2"]);
    let mut watch = Watch::start(&up, &["--json", "--board", "spindle", "--kind", "telemetry"]);
    for _ in 0..3 {
        let row: Value = serde_json::from_str(&watch.next_with("speed_rpm")).unwrap();
        let late = ctl(&up, &["state"])["ns"].as_u64().unwrap() - row["ns"].as_u64().unwrap();
        // Ten seconds by the wall clock: patience, and no more.
        assert!(late < 2_000_000_000, "{late} ns");
    }
    end(up);
}

#[test]
fn whoever_reads_too_slowly_is_told_what_is_lost_and_holds_nobody_up() {
    let folder = folder();
    let trace = folder.path().join("a.torno");
    let up = Up::start(&["--record", trace.to_str().unwrap()]);
    ctl(&up, &["pause"]);
    let mut client = Client::of(&up);
    let from = client.ask(&watch(&["edges"]))["ok"]["ns"].as_u64().unwrap();
    ctl(&up, &["fault", "noise", "master_to_depth", "--period", "100 us"]);
    let until = ctl(&up, &["step", "20 s"])["ns"].as_u64().unwrap();
    client.send(b"{\"do\":\"state\"}\n");
    let (rows, _) = client.rows_and_answer();
    end(up);
    let (lost, rows): (Vec<&Value>, Vec<&Value>) = rows.iter().partition(|row| row.get("lost").is_some());
    let lost: u64 = lost.iter().map(|row| row["lost"].as_u64().unwrap()).sum();
    assert!(lost > 0 && rows.len() > 40_000, "{lost} of {}", rows.len());
    assert_eq!(rows.len() as u64 + lost, recorded(&trace, &["edges"], from, until).len() as u64);
}

/// Whoever watches, and the lines that came.
struct Watch {
    child: Child,
    lines: std::io::Lines<BufReader<std::process::ChildStdout>>,
}

impl Watch {
    fn start(up: &Up, arguments: &[&str]) -> Self {
        let mut command = torno(&["ctl", "--socket", &control(up), "watch"]);
        let mut child = command.args(arguments).stdout(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let begun = lines.next().unwrap().unwrap();
        assert!(begun.starts_with("watching from ") || begun.starts_with("{\"ns\":"), "{begun}");
        Self { child, lines }
    }

    /// The next line that has this in it.
    fn next_with(&mut self, text: &str) -> String {
        self.lines.by_ref().map(|line| line.unwrap()).find(|line| line.contains(text)).unwrap()
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
    }
}

#[test]
fn whoever_watches_sees_what_happens_decoded() {
    let up = Up::start(&["--pace", "20"]);
    let mut watch = Watch::start(&up, &["--json"]);
    let mut frames = Watch::start(&up, &["--kind", "frames", "--line", "pc_to_master"]);
    let mut pc = up.pc();
    pc.write(&AT_REST);
    pc.expect(&[ACK, XON]);
    let frame: Value = serde_json::from_str(&watch.next_with("frame: ")).unwrap();
    assert_eq!(frame["line"], "pc_to_master");
    let ack: Value = serde_json::from_str(&watch.next_with("ACK: the frame")).unwrap();
    assert!(ack["ns"].as_u64() > frame["ns"].as_u64());
    assert!(watch.next_with("\"quantity\":\"slaves_busy\"").contains("\"board\":\"master\""));
    assert!(frames.next_with("").contains("pc_to_master           > frame: spindle 0 rpm"));
    assert!(refused(&up, &["watch", "--line", "pc_to_mastr"]).contains("did you mean 'pc_to_master'?"));
    // The end of the rig is the end of the watch.
    end(up);
    assert!(watch.lines.all(|line| line.is_ok()));
    assert!(watch.child.wait().unwrap().success());
}

#[test]
fn a_file_breaks_a_live_rig() {
    let folder = folder();
    let faults = folder.path().join("faults.toml");
    let write = |text: &str| fs::write(&faults, text).unwrap();
    write(
        "[[fault]]\nname = \"late\"\nboard = \"depth\"\nkind = \"power-off\"\nwhen = { reply = \"XON\" }\n\
         [[fault]]\nname = \"never\"\nboard = \"depth\"\nkind = \"stall\"\nwhen = { reply = \"NAK d\" }\n\
         [[fault]]\nline = \"master_to_pc\"\nkind = \"double\"\nnth = 1\nat = \"1 ms\"\n",
    );
    let up = Up::start(&["--pace", "20", "--faults", faults.to_str().unwrap()]);
    let mut pc = up.pc();
    pc.write(&AT_REST);
    pc.expect(&[ACK, ACK, XON]);
    up.wait_for_log("fault 'late' begins");
    pc.write(&SHORT);
    pc.expect(&[ACK, CAN, b'd', b'n']);
    let state = ctl(&up, &["state"]);
    let names: Vec<&str> = state["faults"].as_array().unwrap().iter().map(|f| f["name"].as_str().unwrap()).collect();
    // The double has met its character.
    assert_eq!(names, ["late", "never"]);
    // One that waits can be called off; one that is there already is not put there again.
    assert!(refused(&up, &["fault", "stall", "depth", "--name", "late"]).contains("there is a fault 'late' already"));
    ctl(&up, &["heal", "late"]);
    up.wait_for_log("fault 'late' begins");
    kill("-INT", up.pid());
    up.wait_for_log("the fault 'never' has not fired");
    assert!(!up.log().contains("the fault 'late' has"));

    write("[[fault]]\nboard = \"dept\"\nkind = \"stall\"\n");
    let wrong = output(&["up", "--faults", faults.to_str().unwrap()]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(stderr(&wrong).contains("faults.toml:2:9: there is no board 'dept': did you mean 'depth'?"));
    let twice = "[[fault]]\nboard = \"depth\"\nkind = \"stall\"\n".repeat(2);
    write(&twice);
    let wrong = output(&["up", "--faults", faults.to_str().unwrap()]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(stderr(&wrong).contains("faults.toml:6:8: there is a fault 'depth stall' already"), "{}", stderr(&wrong));
    write("name = \"no faults\"\n");
    let wrong = output(&["up", "--faults", faults.to_str().unwrap()]);
    assert_eq!((wrong.status.code(), stderr(&wrong).contains("faults.toml:1:1: unknown field")), (Some(2), true));
}

/// On a wire that is held high it changes nothing; and still has no end.
#[test]
fn noise_that_nobody_sees_at_full_speed_is_no_hindrance() {
    let folder = folder();
    let faults = folder.path().join("faults.toml");
    let fault = |kind: &str| format!("[[fault]]\nline = \"master_to_transverse\"\n{kind}\n");
    let both = fault("kind = \"noise\"\nperiod = \"1 ms\"") + &fault("kind = \"stuck-high\"");
    fs::write(&faults, both).unwrap();
    let up = Up::start(&["--pace", "max", "--faults", faults.to_str().unwrap()]);
    wait_until("time goes on", || ctl(&up, &["state"])["ns"].as_u64().unwrap() > 10_000_000_000);
    end(up);
}

/// There is always something to do in it, but not at the cost of whoever asks.
#[test]
fn a_noisy_rig_at_full_speed_answers() {
    let folder = folder();
    let faults = folder.path().join("faults.toml");
    let noise = |line: &str| format!("[[fault]]\nline = \"{line}\"\nkind = \"noise\"\nperiod = \"1 ms\"\n");
    fs::write(&faults, noise("master_to_depth") + &noise("spindle_to_master")).unwrap();
    let up = Up::start(&["--pace", "max", "--faults", faults.to_str().unwrap()]);
    let mut pc = up.pc();
    pc.write(&AT_REST);
    pc.expect(&[ACK]);
    let now = || ctl(&up, &["state"])["ns"].as_u64().unwrap();
    let before = now();
    wait_until("time goes on", || now() > before + 1_000_000_000);
    // Noise that no one hears goes on with time.
    kill("-KILL", up.board("depth"));
    up.wait_for_log("died: signal: 9");
    let before = now();
    wait_until("time goes on", || now() > before + 1_000_000_000);
    end_without_a_board(up);
}

/// The engine waits for whoever watches; no one else must wait with it.
#[test]
fn a_fault_that_waited_does_not_hold_time() {
    let folder = folder();
    let (faults, trace) = (folder.path().join("faults.toml"), folder.path().join("a.torno"));
    let fault = |n: u32| {
        format!(
            "[[fault]]\nname = \"f{n}\"\nboard = \"depth\"\nkind = \"counts\"\nvalue = 1\n\
             when = {{ board = \"depth\", quantity = \"position_counts\", at_least = {n} }}\n"
        )
    };
    let later = "[[fault]]\nname = \"later\"\nboard = \"depth\"\nkind = \"stall\"\nat = \"1 s\"\n";
    fs::write(&faults, [1, 2, 4].map(fault).concat() + later).unwrap();
    let (faults, trace) = (faults.to_str().unwrap(), trace.as_path());
    let up = Up::start(&["--pace", "max", "--faults", faults, "--record", trace.to_str().unwrap()]);
    let mut pc = up.pc();
    ctl(&up, &["pause"]);
    // One that has not begun is healed for good.
    ctl(&up, &["heal", "later"]);
    pc.write(&[0, 0, 0, 0, 0, 0, 9, 0]);
    ctl(&up, &["step", "20 s"]);
    assert_eq!(board(&ctl(&up, &["state"]), "master")["telemetry"]["slaves_busy"], 0);
    pc.expect(&[ACK, XON]);
    end(up);
    repeats(trace);
}

#[test]
fn what_is_wrong_with_a_request_is_told() {
    let up = Up::start(&[]);
    for (arguments, expected) in [
        (&["fault", "cut", "master_to_dept"][..], "there is no line 'master_to_dept': did you mean 'master_to_depth'?"),
        (&["fault", "ct", "master_to_depth"], "there is no fault 'ct': did you mean 'cut'?"),
        (&["fault", "flip", "pc_to_master", "11"], "expected the bit, 0 (start) to 9 (stop)"),
        (&["fault", "stall", "depth", "--for", "3"], "3"),
        (&["fault", "stall", "depth", "--when", "XON"], "--when: expected a condition"),
        (&["fault", "stall", "depth", "--when", "{ reply = \"XONN\" }"], "did you mean 'XON'?"),
        (&["heal", "what"], "the fault 'what': it has not begun, or is over"),
        (&["power", "deph", "off"], "there is no board 'deph': did you mean 'depth'?"),
    ] {
        let complaint = refused(&up, arguments);
        assert!(complaint.contains(expected), "{arguments:?}: {complaint}");
    }
    end(up);
    let output = output(&["ctl", "--socket", "/nowhere/at-all", "state"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("no rig is to be steered at /nowhere/at-all"));
}

#[test]
fn the_socket_is_the_owners_and_goes_with_the_rig() {
    let folder = folder();
    let path = folder.path().join("steer");
    let word = path.to_str().unwrap();
    // One that no one listens to any more is replaced.
    drop(UnixListener::bind(&path).unwrap());
    let up = Up::start(&["--control", word]);
    assert_eq!(fs::symlink_metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
    assert!(ctl(&up, &["pause"])["ns"].is_u64());
    let link = folder.path().join("other");
    let second = output(&["up", "--link", link.to_str().unwrap(), "--control", word]);
    assert_eq!(second.status.code(), Some(2), "{}", stderr(&second));
    assert!(stderr(&second).contains("already steered at"), "{}", stderr(&second));
    assert!(!link.exists());
    end(up);
    assert!(!path.exists());
    fs::write(&path, "mine").unwrap();
    let third = output(&["up", "--link", link.to_str().unwrap(), "--control", word]);
    assert_eq!((third.status.code(), fs::read_to_string(&path).unwrap().as_str()), (Some(2), "mine"));
}
