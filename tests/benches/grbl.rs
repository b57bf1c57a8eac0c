//! The rig with the GRBL controller: what a sender waits for, and what the rig costs meanwhile.

use std::collections::VecDeque;
use std::fmt::Write as _;
use std::io::{Read, Write as _};
use std::thread;
use std::time::{Duration, Instant};

use super::common::{Pc, Up};
use super::{bare, busy, busy_for, by_each_transport, lateness, ms, own_memory, processes, row};

/// The controller's speed.
const BAUD: u32 = 115_200;
/// A character at it.
const CHARACTER_MS: f64 = 10e3 / BAUD as f64;
/// By then a controller that a client has reset has booted.
const BOOTED: Duration = Duration::from_secs(1);
/// What the receive buffer holds for a sender that counts characters.
const BUFFER: usize = 127;
/// A client that shows the state asks so often.
const POLL: Duration = Duration::from_millis(200);

/// A client that has waited for the banner.
fn client(up: &Up) -> Pc {
    let mut pc = Pc::open(&up.link(), BAUD);
    while !line(&mut pc.port).starts_with("Grbl") {}
    pc
}

fn line(port: &mut impl Read) -> String {
    let mut line = String::new();
    while !line.ends_with('\n') {
        let mut byte = [0];
        port.read_exact(&mut byte).unwrap();
        line.push(char::from(byte[0]));
    }
    line
}

/// How late a status comes by each transport, in turn; and, as often and in between, a bare timer and a pty.
fn status(asked: usize) {
    let ups = by_each_transport(&["lathe-grbl"]);
    let mut pcs = ups.each_ref().map(|up| super::client(up, BAUD));
    thread::sleep(BOOTED);
    for pc in &mut pcs {
        // By RFC 2217 the connection is no reset, and there is no banner to wait for.
        pc.write_all(b"G4P0\n").unwrap();
        while line(pc) != "ok\r\n" {}
    }
    let (mut later, mut alone) = ([const { Vec::new() }; 3], Vec::new());
    for _ in 0..asked {
        let mut wire = 0.0;
        for (pc, later) in pcs.iter_mut().zip(&mut later) {
            let start = Instant::now();
            pc.write_all(b"?").unwrap();
            let status = line(pc);
            wire = (1 + status.len()) as f64 * CHARACTER_MS;
            later.push(ms(start.elapsed()) - wire);
        }
        alone.push(bare(wire));
    }
    lateness("grbl, status later than the wire, p99", later, alone, "statuses");
}

/// One line after the other, each when the one before is answered.
fn ask(pc: &mut Pc, text: &str) {
    pc.write(text.as_bytes());
    assert_eq!(line(&mut pc.port), "ok\r\n", "{text}");
}

/// Everything. So many `?` are timed, so many lines answered, and a client that polls is watched for so long.
pub(super) fn measure(asked: usize, rest: Duration, lines: usize) {
    status(asked);
    let up = Up::start(&["lathe-grbl"]);
    let mut pc = client(&up);
    let of_all = processes(&up).len();
    row("grbl, resident", "45 MB", &format!("{:.1} MB with shared pages once, {of_all} processes", own_memory(&up)));
    let polled = {
        let stop = Instant::now() + rest;
        let poll = thread::spawn(move || {
            while Instant::now() < stop {
                pc.write(b"?");
                line(&mut pc.port);
                thread::sleep(POLL);
            }
        });
        let used = busy_for(&up, rest);
        poll.join().unwrap();
        used
    };
    row("grbl, at rest, polled each 200 ms", "1 % of a core", &format!("{polled:.2} %"));
    drop(up);

    let up = Up::start(&["lathe-grbl", "--pace", "max"]);
    let mut pc = client(&up);
    let start = Instant::now();
    (0..lines).for_each(|_| ask(&mut pc, "G4P0\n"));
    let rate = lines as f64 / start.elapsed().as_secs_f64();
    row("grbl, ok round trips, max", "500 a second", &format!("{rate:.0} a second ({lines} lines)"));

    ask(&mut pc, "G18G21G91\n");
    stream(&up, &mut pc, lines, "modes", |_| "G91\n".to_owned());
    stream(&up, &mut pc, lines, "motions", |n| format!("G1Z{}0.02F900\n", if n % 2 == 0 { "" } else { "-" }));
}

/// A job of so many lines, streamed by counting characters; and what used the processors meanwhile.
fn stream(up: &Up, pc: &mut Pc, lines: usize, what: &str, line_of: impl Fn(usize) -> String) {
    let (start, before, own) = (Instant::now(), busy(up), busy_here());
    let (mut in_flight, mut counted) = (VecDeque::new(), 0);
    let mut chunk = String::new();
    for n in 0..lines {
        let text = line_of(n);
        while counted + text.len() > BUFFER {
            send(pc, &mut chunk);
            answered(pc, &mut in_flight, &mut counted);
        }
        counted += text.len();
        in_flight.push_back(text.len());
        chunk.write_str(&text).unwrap();
    }
    send(pc, &mut chunk);
    while !in_flight.is_empty() {
        answered(pc, &mut in_flight, &mut counted);
    }
    let wall = start.elapsed().as_secs_f64();
    let [rig, client] = [busy(up) - before, busy_here() - own].map(|used| used / wall * 100.0);
    let found =
        format!("{wall:.1} s, {:.0} a second; rig {rig:.0} %, client {client:.0} % of a core", lines as f64 / wall);
    row(&format!("grbl, job of {lines} {what}, max"), "", &found);
}

fn send(pc: &mut Pc, chunk: &mut String) {
    if !chunk.is_empty() {
        pc.write(chunk.as_bytes());
        chunk.clear();
    }
}

fn answered(pc: &mut Pc, in_flight: &mut VecDeque<usize>, counted: &mut usize) {
    assert_eq!(line(&mut pc.port), "ok\r\n");
    *counted -= in_flight.pop_front().unwrap();
}

/// Seconds of a core that this process has used.
fn busy_here() -> f64 {
    super::busy_of(u64::from(std::process::id()))
}
