//! How fast and how large it is: `cargo bench --bench speed`, with `-- --quick` for a first impression, with `-- grbl`
//! the rig with the GRBL controller only, with `-- --latency` the port only.
//!
//! Prints a table of what was wanted and what was found; judges nothing, for a busy machine would be judged too. The
//! program is built as for a release, and is measured from outside: what its user waits for, and what `/proc` says.

#![allow(clippy::unwrap_used, reason = "without an answer there is nothing to measure")]
#![allow(clippy::disallowed_methods, reason = "this measures by the wall clock")]

#[allow(dead_code, reason = "of what the tests share, it uses a part")]
#[path = "../common/mod.rs"]
mod common;
mod engraver;
mod grbl;
mod lockstep;
mod masters;

use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use common::{ACK, AT_REST, LONG, Pc, Up, XON, folder, json, rig_of, torno};
use serde_json::Value;
use serialport::{FlowControl, SerialPort, TTYPort};

/// Eight characters in, four out on the longest link, one reply: 13 at 9600 baud.
const WIRE_MS: f64 = 13.0 * 10.0 / 9.6;

/// Character times of one run in lockstep: ten virtual seconds.
const CHARACTERS: usize = 9600;

struct Effort {
    runs: usize,
    idle: Duration,
    motion: Duration,
    frames: usize,
    lines: usize,
}

fn main() {
    if lockstep::was_peer() {
        return;
    }
    let quick = std::env::args().any(|argument| argument == "--quick");
    let effort = if quick {
        Effort { runs: 3, idle: Duration::from_secs(1), motion: Duration::from_secs(2), frames: 40, lines: 1_000 }
    } else {
        Effort { runs: 15, idle: Duration::from_secs(5), motion: Duration::from_secs(10), frames: 200, lines: 10_000 }
    };
    println!();
    if std::env::args().any(|argument| argument == "grbl") {
        return grbl::measure(2 * effort.frames, effort.motion, effort.lines);
    }
    if std::env::args().any(|argument| argument == "--latency") {
        return latency(effort.frames);
    }
    runs(effort.runs);
    println!();
    curve(effort.runs.div_ceil(3));
    println!();
    engraver::shuttle(effort.runs.div_ceil(3));
    println!();
    row("figure", "wanted", "found");
    sweep(effort.runs);
    readiness(effort.runs);
    let up = Up::start(&[]);
    load(&up, &effort);
    memory(&up);
    drop(up);
    latency(effort.frames);
    grbl::measure(2 * effort.frames, effort.motion, effort.lines);
    println!();
}

fn row(figure: &str, wanted: &str, found: &str) {
    println!("{figure:<38} {wanted:<14} {found}");
}

/// Smallest, median and largest.
fn spread(mut values: Vec<f64>) -> (f64, f64, f64) {
    values.sort_by(f64::total_cmp);
    (values[0], values[values.len() / 2], values[values.len() - 1])
}

fn ms(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}

// --- torno run ------------------------------------------------------------------------------------------------------

/// A kind of run: its name, what is wanted of it, its arguments, and how often the program is in it.
type Kind<'a> = (&'a str, &'a str, Vec<&'a str>);

/// Virtual over wall time, whole commands, beside plain lockstep on the same machine at the same time: one of each in
/// grant, so that whatever else the machine does weighs on all.
fn runs(n: usize) {
    let folder = folder();
    let long = folder.path().join("ten-times.frames");
    let demonstration = Path::new(env!("CARGO_MANIFEST_DIR")).join("builtin/shaft.frames");
    fs::write(&long, fs::read_to_string(demonstration).unwrap().repeat(10)).unwrap();
    let long = long.to_str().unwrap();
    let kinds: [Kind<'_>; 4] = [
        ("run, five processes", "5000x", vec![]),
        ("run, in process", "40000x", vec!["--in-process"]),
        ("run, ten times the program, processes", "8000x", vec![long]),
        ("run, ten times the program, in process", "40000x", vec!["--in-process", long]),
    ];
    let mut walls = kinds.each_ref().map(|_| Vec::new());
    let mut virtual_s = [0.0; 4];
    let mut lockstep = Vec::new();
    for _ in 0..n {
        for (kind, (_, _, arguments)) in kinds.iter().enumerate() {
            let (wall, summary) = run(arguments);
            walls[kind].push(wall);
            virtual_s[kind] = summary["virtual_s"].as_f64().unwrap();
        }
        lockstep.push(lockstep::speed(CHARACTERS));
    }
    let (slowest, baseline, fastest) = spread(lockstep);
    println!("{:<38} {:<8} {:>8}  {:>12}  found", "virtual over wall time", "wanted", "found", "of lockstep");
    let row = |figure: &str, wanted: &str, speed: f64, found: &str| {
        println!("{figure:<38} {wanted:<8} {speed:>7.0}x  {:>12.1}  {found}", speed / baseline);
    };
    let span = CHARACTERS as f64 * 10.0 / 9600.0;
    row(
        "lockstep, five processes, no work",
        "",
        baseline,
        &format!("{span:.0} s, {slowest:.0}x to {fastest:.0}x, {n} runs"),
    );
    for (((figure, wanted, _), walls), virtual_s) in kinds.iter().zip(walls).zip(virtual_s) {
        let (min, median, max) = spread(walls);
        let found = format!("{virtual_s:.0} s in {median:.1} ms ({min:.1} to {max:.1}, {n} runs)");
        row(figure, wanted, virtual_s * 1e3 / median, &found);
    }
}

/// The whole command, as its user waits for it, in milliseconds; and what it says.
fn run(arguments: &[&str]) -> (f64, Value) {
    let start = Instant::now();
    let output = torno(&[&["run", "--json"], arguments].concat()).output().unwrap();
    let wall = ms(start.elapsed());
    let summary = json(&output);
    assert_eq!(summary["outcome"], "completed", "{summary}");
    (wall, summary)
}

/// Whole runs of the demonstration, as a sweep does them: on all processors, without a recording.
fn sweep(n: usize) {
    let scenario = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/sweeps/demonstration.toml");
    let rate = || {
        let start = Instant::now();
        let output = torno(&["sweep", scenario, "--seeds", "200", "--json"]).output().unwrap();
        let wall = start.elapsed().as_secs_f64();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        output.stdout.split(|byte| *byte == b'\n').filter(|line| !line.is_empty()).count() as f64 / wall
    };
    let (min, median, max) = spread(std::iter::repeat_with(rate).take(n).collect());
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let found = format!("{median:.0} a second ({min:.0} to {max:.0}, {n} sweeps of 200, {cores} cores)");
    row("sweep, runs of the demonstration", "500 a second", &found);
}

/// What a master with three slaves adds to a rig: wall time per virtual second from when all boards stand, and grants
/// of boards per virtual second. One of each in turn.
fn curve(n: usize) {
    let folder = folder();
    let sizes = [1, 2, 5, 10];
    let files = sizes.map(|masters| {
        let path = folder.path().join(format!("{masters}.toml"));
        fs::write(&path, rig_of(masters)).unwrap();
        path.to_str().unwrap().to_owned()
    });
    let measured = |arguments: &[&str]| {
        let (_, summary) = run(arguments);
        let stats = &summary["stats"];
        let number = |name: &str| stats[name].as_f64().unwrap();
        let wall_us = (number("waiting_s") + number("own_s")) * 1e6;
        (wall_us / summary["virtual_s"].as_f64().unwrap(), number("grants_per_virtual_s"), number("starting_s") * 1e3)
    };
    let mut found = sizes.map(|_| [const { Vec::new() }; 3]);
    for _ in 0..n {
        for (size, masters) in sizes.into_iter().enumerate() {
            found[size][0].push(measured(&["--stats", &files[size]]));
            found[size][1].push(measured(&["--stats", "--in-process", &files[size]]));
            let masters::Cost { virtual_s, wall, grants } = masters::all_at_work(masters);
            found[size][2].push((wall.as_secs_f64() * 1e6 / virtual_s, grants as f64 / virtual_s, 0.0));
        }
    }
    let [idle, in_process, at_work] = ["one at work, processes", "one at work, in process", "all at work, in process"];
    println!("{:<17}{idle:>35}{in_process:>31}{at_work:>40}", "us/virtual s");
    print!("{:<8} {:>7} ", "masters", "boards");
    println!(
        "{:>11} {:>9} {:>12} {:>18} {:>11} {:>17} {:>9} {:>11}",
        "us", "grants/s", "start in ms", "us", "grants/s", "us", "per board", "grants/s"
    );
    for (masters, found) in sizes.into_iter().zip(found) {
        let boards = 4 * masters;
        let median =
            |of: &[(f64, f64, f64)], part: fn(&(f64, f64, f64)) -> f64| spread(of.iter().map(part).collect()).1;
        let [(a, ta, start), (b, tb, _), (c, tc, _)] =
            found.each_ref().map(|of| (median(of, |x| x.0), median(of, |x| x.1), median(of, |x| x.2)));
        print!("{masters:<8} {boards:>7} {a:>11.1} {ta:>9.2} {start:>12.1} {b:>18.1} {tb:>11.2} ");
        println!("{c:>17.1} {:>9.2} {tc:>11.2}", c / boards as f64);
    }
}

// --- torno up -------------------------------------------------------------------------------------------------------

fn readiness(n: usize) {
    let once = || {
        let start = Instant::now();
        let up = Up::start(&[]);
        let wall = ms(start.elapsed());
        drop(up);
        wall
    };
    let (min, median, max) = spread(std::iter::repeat_with(once).take(n).collect());
    row("up, until ready", "150 ms", &format!("{median:.1} ms ({min:.1} to {max:.1}, {n} starts)"));
}

fn load(up: &Up, effort: &Effort) {
    let idle = busy_for(up, effort.idle);
    row("up, at rest", "1 % of a core", &format!("{idle:.2} %"));
    let mut pc = up.pc();
    pc.write(&LONG);
    pc.expect(&[ACK]);
    let motion = busy_for(up, effort.motion);
    row("up, in motion, pace 1", "5 % of a core", &format!("{motion:.2} %"));
    pc.port.set_flow_control(FlowControl::Software).unwrap();
    pc.write(&AT_REST.repeat(30));
    let held = busy_for(up, effort.motion);
    row("up, in motion, a stream held", "5 % of a core", &format!("{held:.2} %"));
}

/// Percent of a core that all five processes use together.
fn busy_for(up: &Up, wall: Duration) -> f64 {
    let (start, before) = (Instant::now(), busy(up));
    thread::sleep(wall);
    (busy(up) - before) / start.elapsed().as_secs_f64() * 100.0
}

/// Seconds of a core that all five have used. Not `stat`, which counts in hundredths.
fn busy(up: &Up) -> f64 {
    processes(up).into_iter().map(busy_of).sum()
}

/// The same of one process.
fn busy_of(pid: u64) -> f64 {
    let of_task = |path: &Path| {
        let text = fs::read_to_string(path.join("schedstat")).unwrap();
        text.split_whitespace().next().unwrap().parse::<f64>().unwrap() / 1e9
    };
    let tasks = fs::read_dir(format!("/proc/{pid}/task")).unwrap();
    tasks.map(|task| of_task(&task.unwrap().path())).sum()
}

fn processes(up: &Up) -> Vec<u64> {
    let mut processes = up.boards();
    processes.push(up.pid());
    processes
}

/// The sum of a field of all processes in `/proc`, in MB.
fn sum(up: &Up, file: &str, field: &str) -> f64 {
    let of_process = |pid: u64| -> f64 {
        let text = fs::read_to_string(format!("/proc/{pid}/{file}")).unwrap();
        let line = text.lines().find_map(|line| line.strip_prefix(field)).unwrap();
        line.trim_end_matches("kB").trim().parse().unwrap()
    };
    processes(up).into_iter().map(of_process).sum::<f64>() / 1e3 * 1.024
}

/// What it has resident, with shared pages once, in MB.
fn own_memory(up: &Up) -> f64 {
    sum(up, "smaps_rollup", "Pss:")
}

fn memory(up: &Up) {
    let (resident, own) = (sum(up, "status", "VmRSS:"), own_memory(up));
    row("up, resident, five processes", "60 MB", &format!("{resident:.1} MB, {own:.1} MB with shared pages once"));
}

/// How late an `ACK` comes by a pty, by TCP and by RFC 2217, in turn; and, as often and in between, how late a bare
/// timer and a byte through a pty are. No rig can do better than that: on a busy machine both wait for a processor.
fn latency(frames: usize) {
    let ups = by_each_transport(&[]);
    let mut pcs = ups.each_ref().map(|up| client(up, 9600));
    let (mut later, mut alone) = ([const { Vec::new() }; 3], Vec::new());
    for _ in 0..frames {
        for (pc, later) in pcs.iter_mut().zip(&mut later) {
            let mut replies = [0];
            let start = Instant::now();
            pc.write_all(&AT_REST).unwrap();
            pc.read_exact(&mut replies).unwrap();
            later.push(ms(start.elapsed()) - WIRE_MS);
            assert_eq!(replies, [ACK]);
            pc.read_exact(&mut replies).unwrap();
            assert_eq!(replies, [XON]);
        }
        alone.push(bare(WIRE_MS));
    }
    lateness("up, ACK later than the wire, p99", later, alone, "frames");
}

/// Rigs that are reached by a pty, by TCP and by RFC 2217.
fn by_each_transport(arguments: &[&str]) -> [Up; 3] {
    [None, Some("tcp"), Some("rfc2217")].map(|scheme| match scheme {
        None => Up::start(arguments),
        Some(scheme) => {
            let folder = folder();
            let mut command = torno(&["up", "--json", "--transport", &format!("{scheme}://127.0.0.1:0"), "--control"]);
            command.arg(folder.path().join("control")).args(arguments);
            Up::launch(command, folder)
        }
    })
}

/// How late it was by each transport, and without a rig.
fn lateness(figure: &str, [pty, tcp, rfc2217]: [Vec<f64>; 3], alone: Vec<f64>, what: &str) {
    row(figure, "3 ms", &late(pty, what));
    row("the same by TCP", "1 ms more", &late(tcp, what));
    row("the same by RFC 2217", "1 ms more", &late(rfc2217, what));
    row("a timer and a pty alone, p99", "", &late(alone, what));
}

/// How late a timer of so many milliseconds and then a byte through a pty are, in milliseconds.
fn bare(timer_ms: f64) -> f64 {
    let (mut near, mut far) = TTYPort::pair().unwrap();
    far.set_timeout(Duration::from_secs(10)).unwrap();
    let start = Instant::now();
    thread::sleep(Duration::from_secs_f64(timer_ms / 1e3));
    near.write_all(&[ACK]).unwrap();
    far.read_exact(&mut [0]).unwrap();
    ms(start.elapsed()) - timer_ms
}

/// What is late, for people.
fn late(mut values: Vec<f64>, what: &str) -> String {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
    format!("{:.2} ms (median {:.2}, max {:.2}, {} {what})", at(0.99), at(0.5), at(1.0), values.len())
}

trait Duplex: Read + Write {}
impl<T: Read + Write> Duplex for T {}

/// A client that blocks.
fn client(up: &Up, baud: u32) -> Box<dyn Duplex> {
    let port = up.ready["ports"]["pc"]["port"].as_str().unwrap();
    let Some((scheme, address)) = port.split_once("://") else { return Box::new(Pc::open(&up.link(), baud).port) };
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_nodelay(true).unwrap();
    if scheme == "rfc2217" {
        // Four options are negotiated at first.
        stream.read_exact(&mut [0; 12]).unwrap();
    }
    Box::new(stream)
}
