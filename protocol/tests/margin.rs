//! How far two clocks may be apart before a link makes its first error, in theory and as measured.
//!
//! A receiver takes the first tick that sees the start bit for its beginning. So it is late by `u` ticks, 0 ≤ u < 1.
//! With `n` ticks a bit it decides bit `k` (0: start, 9: stop) at the tick `n k + v`: `n k + v + u` ticks after the
//! edge. In bits of the sender that is `r (n k + v + u) / n`, where `r` is the receiver's bit over the sender's. It
//! must lie in the sender's bit `k`: from `k` to `k + 1`.
//!
//! - Early, u = 0: the stop bit is the first to be left: r = 9 n / (9 n + v).
//! - Late, u → 1, one character: the last data bit, as the line stays high after the stop bit: r = 9 n / (8 n + v + 1).
//! - Late, u → 1, characters back to back: the receiver is to be done with the stop bit when the next start edge comes:
//!   r = 10 n / (9 n + d + 1), where `d` is the tick of the bit at which it is done.
//!
//! Software: n = 3, v = d = 1. Hardware: n = 16, v = 8 (of three votes, the middle one decides), d = 9.

use torno_protocol::clock::{Clock, Rate, Ticks};
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::{Receiver, TickTimer, Transmitter};

const RATE: Rate = Rate::hz(9600);
/// In ppm.
const STEP: i32 = 50;

/// Which oscillator is off.
#[derive(Clone, Copy, Debug)]
enum Off {
    Sender,
    Receiver,
}

/// Which way a link goes.
#[derive(Clone, Copy, Debug)]
enum Way {
    HardwareToSoftware,
    SoftwareToHardware,
}

fn clock(ppm: i32) -> Clock {
    Clock::from_ppb(ppm * 1_000).expect("it is in the range of clocks")
}

/// Whether these bytes, sent back to back from `from` on, are received as they are, and nothing else is.
fn passes(way: Way, off: Off, ppm: i32, bytes: &[u8], from: Instant) -> bool {
    let (sender, receiver) = match off {
        Off::Sender => (clock(ppm), Clock::TRUE),
        Off::Receiver => (Clock::TRUE, clock(ppm)),
    };
    let (mut sender, mut receiver) = match way {
        Way::HardwareToSoftware => (Transmitter::hardware(RATE, sender), TickTimer::new(RATE, receiver).receiver(0)),
        Way::SoftwareToHardware => (TickTimer::new(RATE, sender).transmitter(0), Receiver::hardware(RATE, receiver)),
    };
    bytes.iter().for_each(|byte| sender.push(*byte));
    let mut now = from;
    for _ in bytes {
        now = sender.poll_timeout().map_or(now, |at| at.max(now));
        let loaded = sender.load(now).expect("it is free and has a byte");
        receiver.hear(&loaded.edges);
        now = loaded.end;
    }
    let mut got = Vec::new();
    while let Some(character) = receiver.poll_timeout().and_then(|at| receiver.take(at)) {
        got.push(character.ok());
    }
    got.iter().copied().eq(bytes.iter().map(|byte| Some(*byte)))
}

/// Whether all of many bytes pass at every phase of the two clocks.
fn always_passes(way: Way, off: Off, ppm: i32, characters: usize) -> bool {
    let ticks = Ticks::new(Instant::START, RATE.times(3), clock(if let Off::Receiver = off { ppm } else { 0 }));
    // Spread over all phases; and at and just behind a tick of a software receiver.
    let even = (0..300).map(|n| Instant::from_nanos(5_000_000 + n * 993_680));
    let latency = Span::from_nanos(3_000);
    let at_a_tick = (100..103).flat_map(|n| [ticks.at(n) + latency, (ticks.at(n) + latency).next()]);
    let bytes = [0x00, 0xff, 0x7f, 0x80, 0x55].map(|byte| [byte, 0x00]);
    even.chain(at_a_tick).all(|from| bytes.iter().all(|bytes| passes(way, off, ppm, &bytes[..characters], from)))
}

/// The first error, in ppm; looked for closely only near where it is to come.
fn first_error(way: Way, off: Off, sign: i32, characters: usize) -> i32 {
    let near = theory(way, off, sign, characters).abs() as i32;
    let looks = |ppm: &i32| ppm % (20 * STEP) == 0 || (ppm - near).abs() < 10 * STEP;
    let mut errors = (STEP..70_000).step_by(STEP as usize).filter(looks);
    sign * errors.find(|ppm| !always_passes(way, off, sign * ppm, characters)).expect("the search has no end")
}

/// The theory's first error, in ppm.
fn theory(way: Way, off: Off, sign: i32, characters: usize) -> f64 {
    let (n, v, d) = match way {
        Way::HardwareToSoftware => (3.0, 1.0, 1.0),
        Way::SoftwareToHardware => (16.0, 8.0, 9.0),
    };
    // A fast sender's bits, and those of a true one beside a slow receiver's, are short: the receiver is late.
    let late = (sign > 0) == matches!(off, Off::Sender);
    let r = match (late, characters) {
        (false, _) => 9.0 * n / (9.0 * n + v),
        (true, 1) => 9.0 * n / (8.0 * n + v + 1.0),
        (true, _) => 10.0 * n / (9.0 * n + d + 1.0),
    };
    1e6 * match off {
        Off::Sender => r - 1.0,
        Off::Receiver => 1.0 / r - 1.0,
    }
}

/// The documentation has the table that comes out.
#[test]
fn the_first_error_comes_where_theory_has_it() {
    let mut table = String::new();
    for (way, name) in
        [(Way::HardwareToSoftware, "hardware → software"), (Way::SoftwareToHardware, "software → hardware")]
    {
        for (off, sign, which) in [
            (Off::Sender, 1, "sender fast"),
            (Off::Sender, -1, "sender slow"),
            (Off::Receiver, 1, "receiver fast"),
            (Off::Receiver, -1, "receiver slow"),
        ] {
            table += &format!("| {name} | {which} ");
            for characters in [1, 2] {
                let (measured, theory) = (first_error(way, off, sign, characters), theory(way, off, sign, characters));
                let beyond = f64::from(measured.abs()) - theory.abs();
                assert!((0.0..4.0 * f64::from(STEP)).contains(&beyond), "{name}, {which}: {measured}, {theory}");
                table += &format!("| {theory:.0} | {measured} ");
            }
            table += "|\n";
        }
    }
    let page = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/sweeps.md")).unwrap();
    assert!(page.contains(&table), "docs/sweeps.md should have these rows:\n{table}");
}
