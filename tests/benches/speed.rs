//! How fast and how large it is: `cargo bench --bench speed`, with `-- --quick` for a first impression.
//!
//! Prints a table of what was wanted and what was found; judges nothing, for a busy machine would be judged too. The
//! program is built as for a release, and is measured from outside: what its user waits for, and what `/proc` says.

#![allow(clippy::unwrap_used, reason = "without an answer there is nothing to measure")]
#![allow(clippy::disallowed_methods, reason = "this measures by the wall clock")]

#[path = "../common/mod.rs"]
mod common;

use std::fs;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use common::{ACK, AT_REST, LONG, Up, XON, folder, json, torno};
use serialport::{FlowControl, SerialPort};

/// Eight characters in, four out on the longest link, one reply: 13 at 9600 baud.
const WIRE_MS: f64 = 13.0 * 10.0 / 9.6;

struct Effort {
    runs: usize,
    idle: Duration,
    motion: Duration,
    frames: usize,
}

fn main() {
    let quick = std::env::args().any(|argument| argument == "--quick");
    let effort = if quick {
        Effort { runs: 3, idle: Duration::from_secs(1), motion: Duration::from_secs(2), frames: 40 }
    } else {
        Effort { runs: 15, idle: Duration::from_secs(5), motion: Duration::from_secs(10), frames: 200 }
    };
    println!();
    row("figure", "wanted", "found");
    runs(effort.runs);
    readiness(effort.runs);
    let up = Up::start(&[]);
    load(&up, &effort);
    memory(&up);
    drop(up);
    latency(effort.frames);
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

fn runs(n: usize) {
    let folder = folder();
    let long = folder.path().join("ten-times.frames");
    let demonstration = Path::new(env!("CARGO_MANIFEST_DIR")).join("builtin/shaft.frames");
    fs::write(&long, fs::read_to_string(demonstration).unwrap().repeat(10)).unwrap();
    let long = long.to_str().unwrap();
    run("run, five processes", "1000x", &["run", "--json"], n);
    run("run, in process", "", &["run", "--json", "--in-process"], n);
    run("run, ten times the program, processes", "1000x", &["run", "--json", long], n.div_ceil(3));
    run("run, ten times the program, in process", "", &["run", "--json", "--in-process", long], n.div_ceil(3));
}

/// The whole command, as its user waits for it.
fn run(figure: &str, wanted: &str, arguments: &[&str], n: usize) {
    let mut virtual_s = 0.0;
    let once = || {
        let start = Instant::now();
        let output = torno(arguments).output().unwrap();
        let wall = ms(start.elapsed());
        let summary = json(&output);
        assert_eq!(summary["outcome"], "completed", "{summary}");
        virtual_s = summary["virtual_s"].as_f64().unwrap();
        wall
    };
    let (min, median, max) = spread(std::iter::repeat_with(once).take(n).collect());
    let speed = virtual_s * 1e3 / median;
    let found = format!("{speed:.0}x  {virtual_s:.0} s in {median:.1} ms ({min:.1} to {max:.1}, {n} runs)");
    row(figure, wanted, &found);
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
    let of_task = |path: &Path| {
        let text = fs::read_to_string(path.join("schedstat")).unwrap();
        text.split_whitespace().next().unwrap().parse::<f64>().unwrap() / 1e9
    };
    let of_process = |pid: u64| -> f64 {
        let tasks = fs::read_dir(format!("/proc/{pid}/task")).unwrap();
        tasks.map(|task| of_task(&task.unwrap().path())).sum()
    };
    processes(up).into_iter().map(of_process).sum()
}

fn processes(up: &Up) -> Vec<u64> {
    let mut processes = up.boards();
    processes.push(up.pid());
    processes
}

fn memory(up: &Up) {
    let sum = |file: &str, field: &str| -> f64 {
        let of_process = |pid: u64| -> f64 {
            let text = fs::read_to_string(format!("/proc/{pid}/{file}")).unwrap();
            let line = text.lines().find_map(|line| line.strip_prefix(field)).unwrap();
            line.trim_end_matches("kB").trim().parse().unwrap()
        };
        processes(up).into_iter().map(of_process).sum::<f64>() / 1e3 * 1.024
    };
    let (resident, own) = (sum("status", "VmRSS:"), sum("smaps_rollup", "Pss:"));
    row("up, resident, five processes", "60 MB", &format!("{resident:.1} MB, {own:.1} MB with shared pages once"));
}

fn latency(frames: usize) {
    let up = Up::start(&[]);
    let mut pc = up.pc();
    let mut late = Vec::new();
    for _ in 0..frames {
        let start = Instant::now();
        pc.write(&AT_REST);
        pc.expect(&[ACK]);
        late.push(ms(start.elapsed()) - WIRE_MS);
        pc.expect(&[XON]);
    }
    late.sort_by(f64::total_cmp);
    let at = |share: f64| late[((late.len() - 1) as f64 * share).round() as usize];
    let found = format!("{:.2} ms (median {:.2}, max {:.2}, {frames} frames)", at(0.99), at(0.5), at(1.0));
    row("up, ACK later than the wire, p99", "3 ms", &found);
}
