//! Hostile load at the PC port: what a rig must outlive, and what it costs.
//!
//! In CI at a small size. With `TORNO_HOSTILE=1` at the size of the figures in docs/port.md, with the figures on
//! standard error: `TORNO_HOSTILE=1 cargo test -p torno --test whole hostile -- --nocapture --test-threads=1`.
//! `TORNO_HOSTILE_SECONDS` is how long the stream at line rate lasts, 600 without it.

#![allow(clippy::disallowed_methods, reason = "a load has a duration by the wall clock")]

use std::fs::{self, File};
use std::io::{Read, Write};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serialport::{ClearBuffer, SerialPort};

use crate::common::clients::terminal;
use crate::common::{ACK, AT_REST, PATIENCE, Pc, Up, XON, kill, wait_until};
use crate::ways::{Client, RFC2217, TCP, logged_up_by, memory};

fn size(small: usize, full: usize) -> usize {
    if std::env::var_os("TORNO_HOSTILE").is_some() { full } else { small }
}

/// Tells a figure, past the test harness.
fn tell(up: &Up, what: &str) {
    let status = fs::read_to_string(format!("/proc/{}/status", up.pid())).unwrap();
    let memory = |name: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(name));
        line.unwrap().split_whitespace().next().unwrap().parse::<u64>().unwrap() / 1024
    };
    let text = format!("{what}; harness {} MB, at most {} MB\n", memory("VmRSS:"), memory("VmHWM:"));
    std::io::stderr().write_all(text.as_bytes()).unwrap();
}

/// A client that opens the port as soon as it can: the one before may have had it for itself.
fn client(up: &Up, baud: u32) -> Pc {
    let mut opened = None;
    wait_until("the port can be opened", || {
        opened = serialport::new(up.link().to_str().unwrap(), baud).timeout(PATIENCE).open_native().ok();
        opened.is_some()
    });
    Pc { port: opened.unwrap() }
}

/// The rig still does what it is for.
fn works(up: &Up) {
    let mut pc = client(up, 9_600);
    pc.port.set_timeout(Duration::from_secs(2)).unwrap();
    let start = Instant::now();
    let mut executes = || {
        // The silence after which the master listens again.
        thread::sleep(Duration::from_millis(200));
        pc.port.clear(ClearBuffer::Input).unwrap();
        let mut replies = [0; 2];
        // There may be no room, while much is left to be sent.
        pc.port.write_all(&AT_REST).and_then(|()| pc.port.read_exact(&mut replies)).is_ok() && replies == [ACK, XON]
    };
    // What clients have left is sent first.
    let patience = Duration::from_secs(size(60, 1_800) as u64);
    while !executes() {
        assert!(start.elapsed() < patience, "a frame is not executed");
    }
}

/// Writes random bytes until `goes_on` says no, while all replies are read. Says how many there were of both.
fn noise(up: &Up, goes_on: impl FnMut(usize) -> bool) -> (usize, usize) {
    let mut pc = client(up, 9_600);
    let mut reader = pc.port.try_clone_native().unwrap();
    reader.set_timeout(Duration::from_millis(500)).unwrap();
    pc.port.set_timeout(Duration::from_secs(600)).unwrap();
    noise_between(
        reader,
        pc.port,
        goes_on,
        |_| (),
        |port| {
            if size(1, 0) == 1 {
                // At line rate, what the kernel holds would take 20 s.
                port.clear(ClearBuffer::Output).unwrap();
            }
        },
    )
}

/// The same, over any two ends of a port, with noise that `garble` may change; at the end, `give_up` may take back what
/// is not sent. A read must not last.
fn noise_between<W: Write>(
    mut reader: impl Read + Send + 'static,
    mut writer: W,
    mut goes_on: impl FnMut(usize) -> bool,
    garble: impl Fn(&mut [u8]),
    give_up: impl FnOnce(&mut W),
) -> (usize, usize) {
    let (over, ended) = std::sync::mpsc::channel::<()>();
    let replies = thread::spawn(move || {
        let (mut replies, mut buffer) = (0, [0; 4096]);
        loop {
            match reader.read(&mut buffer) {
                Ok(0) => return replies,
                Ok(read) => replies += read,
                Err(_) if ended.try_recv().is_ok() => return replies,
                Err(_) => {}
            }
        }
    });
    let (mut random, mut bytes, mut written) = (ChaCha8Rng::seed_from_u64(12), [0; 1024], 0);
    while goes_on(written) {
        random.fill_bytes(&mut bytes);
        garble(&mut bytes);
        writer.write_all(&bytes).unwrap();
        written += bytes.len();
    }
    give_up(&mut writer);
    over.send(()).unwrap();
    (written, replies.join().unwrap())
}

#[test]
fn random_bytes_at_full_speed() {
    let bytes = size(20_000, 10_000_000);
    let up = Up::start(&["--pace", "max"]);
    let start = Instant::now();
    let (written, replies) = noise(&up, |written| written < bytes);
    works(&up);
    let lost = up.log().matches("bytes are lost").count();
    tell(&up, &format!("noise at max: {written} bytes in {:.1?}, {replies} replies, {lost} losses", start.elapsed()));
    assert_eq!(lost, 0);
}

#[test]
fn random_bytes_at_line_rate() {
    let full = std::env::var("TORNO_HOSTILE_SECONDS").map_or(600, |text| text.parse().unwrap());
    let lasts = Duration::from_secs(size(2, full) as u64);
    let up = Up::start(&[]);
    let start = Instant::now();
    let (written, replies) = noise(&up, |_| start.elapsed() < lasts);
    let lost = up.log().matches("bytes are lost").count();
    tell(&up, &format!("noise at line rate: {written} bytes in {lasts:?}, {replies} replies, {lost} losses"));
    // What the kernel holds at the end is sent first: at most 20 s at line rate.
    works(&up);
    assert_eq!(lost, 0);
}

#[test]
fn clients_that_die_in_mid_write() {
    let clients = size(20, 400);
    let up = Up::start(&["--pace", "max"]);
    for n in 0..clients {
        let port = File::options().write(true).open(up.link()).unwrap();
        let mut cat = Command::new("cat").arg("/dev/urandom").stdin(Stdio::null()).stdout(port).spawn().unwrap();
        thread::sleep(Duration::from_millis(n as u64 % 20));
        cat.kill().unwrap();
        cat.wait().unwrap();
    }
    works(&up);
    tell(&up, &format!("deaths in mid-write: {clients}"));
}

#[test]
fn reopenings_at_several_speeds() {
    let times = size(200, 10_000);
    let up = Up::start(&["--pace", "max"]);
    let start = Instant::now();
    for n in 0..times {
        let speed = [9_600, 19_200, 115_200, 1_200][n % 4];
        let mut pc = client(&up, speed);
        if n % 3 == 0 {
            pc.write(&AT_REST[..n % 8]);
        }
    }
    works(&up);
    tell(&up, &format!("reopenings: {times} in {:.1?}", start.elapsed()));
}

/// The rig is stopped meanwhile: a queue that these fill has overflowed when it looks again.
#[test]
fn terminals_opened_elsewhere() {
    let terminals = 10_000;
    let up = Up::start(&[]);
    let mut pc = up.pc();
    pc.write(&AT_REST);
    pc.expect(&[ACK, XON]);
    kill("-STOP", up.pid());
    (0..terminals).for_each(|_| terminal());
    kill("-CONT", up.pid());
    for _ in 0..5 {
        (0..size(200, 2_000)).for_each(|_| terminal());
        pc.write(&AT_REST);
        pc.expect(&[ACK, XON]);
    }
    tell(&up, &format!("terminals elsewhere: {}", terminals + 5 * size(200, 2_000)));
}

// --- TCP and RFC 2217 -----------------------------------------------------------------------------------------------

/// The rig still does what it is for, whatever was left.
fn works_by(up: &Up) {
    let executes = || {
        // The silence after which the master listens again.
        thread::sleep(Duration::from_millis(200));
        let mut pc = Client::of(up);
        pc.0.set_read_timeout(Some(Duration::from_secs(2))).unwrap();
        let mut replies = Vec::new();
        let mut buffer = [0; 64];
        pc.0.write_all(&AT_REST).unwrap();
        while let Ok(read @ 1..) = pc.0.read(&mut buffer) {
            replies.extend(&buffer[..read]);
            if replies.ends_with(&[ACK, XON]) {
                return true;
            }
        }
        false
    };
    let (start, patience) = (Instant::now(), Duration::from_secs(size(60, 1_800) as u64));
    while !executes() {
        assert!(start.elapsed() < patience, "a frame is not executed");
    }
}

/// Without growth: what it has after a load is what it has after a small one.
fn assert_small(up: &Up, before: u64) {
    let after = memory(up);
    assert!(after < before + 16_000, "{before} kB before, {after} kB after");
}

fn random_bytes_by(transport: &str) {
    let bytes = size(20_000, 10_000_000);
    let up = logged_up_by("warn", transport, &["--pace", "max"]);
    let (before, start) = (memory(&up), Instant::now());
    let writer = Client::of(&up).0;
    let reader = writer.try_clone().unwrap();
    reader.set_read_timeout(Some(Duration::from_millis(500))).unwrap();
    let (written, replies) = noise_between(reader, writer, |written| written < bytes, |_| (), |_| ());
    let lasted = start.elapsed();
    works_by(&up);
    tell(&up, &format!("noise by {transport}: {written} bytes in {lasted:.1?}, {replies} bytes back"));
    assert_small(&up, before);
}

#[test]
fn random_bytes_by_tcp() {
    random_bytes_by(TCP);
}

#[test]
fn random_bytes_by_rfc_2217() {
    random_bytes_by(RFC2217);
}

fn connections_by(transport: &str) {
    let times = size(300, 1_000_000);
    let up = logged_up_by("error", transport, &["--pace", "max"]);
    let (before, start) = (memory(&up), Instant::now());
    let mut made = 0;
    while made < times {
        made += 1;
        let n = made;
        let mut pc = Client::of(&up);
        match n % 4 {
            0 => drop(pc.0.write_all(&AT_REST[..n % 8])),
            1 => drop(pc.0.write_all(&[255, 250, 44, 5][..n % 5])),
            _ => {}
        }
        // Closed by a reset: the system keeps the address of each that is closed in another way for a minute.
        if n >= 100 {
            rustix::net::sockopt::set_socket_linger(&pc.0, Some(Duration::ZERO)).unwrap();
        }
        // With more than the system lets wait, the next would be kept waiting for a second. Who is refused knows that
        // all before have been attended to.
        if n % 8 == 0 {
            assert!(Client::of(&up).read_all().starts_with(b"torno: "));
            made += 1;
        }
    }
    let lasted = start.elapsed();
    works_by(&up);
    tell(&up, &format!("connections by {transport}: {times} in {lasted:.1?}"));
    assert_small(&up, before);
}

#[test]
fn connections_by_tcp() {
    connections_by(TCP);
}

#[test]
fn connections_by_rfc_2217() {
    connections_by(RFC2217);
}

/// Telnet that means something, and telnet that does not: all of it ends at the port.
#[test]
fn negotiation_by_rfc_2217() {
    const COMMANDS: [u8; 10] = [0, 1, 2, 3, 4, 6, 7, 10, 11, 12];
    let bytes = size(20_000, 10_000_000);
    let up = logged_up_by("warn", RFC2217, &["--pace", "max"]);
    let (before, start) = (memory(&up), Instant::now());
    let writer = Client::of(&up).0;
    let reader = writer.try_clone().unwrap();
    reader.set_read_timeout(Some(Duration::from_millis(500))).unwrap();
    // A verb and an option; and a subnegotiation of any command and content, but breaks, which are for the line.
    let garble = |noise: &mut [u8]| {
        for words in noise.chunks_exact_mut(8) {
            let [kind, a, b, c, ..] = *words else { return };
            match kind % 2 {
                0 => words[..6].copy_from_slice(&[255, 251 + a % 4, b, 255, 251 + c % 4, 44]),
                _ => words[..4].copy_from_slice(&[255, 250, 44, COMMANDS[usize::from(a) % COMMANDS.len()]]),
            }
            words[6..].copy_from_slice(&[255, 240]);
        }
    };
    let (written, back) = noise_between(reader, writer, |written| written < bytes, garble, |_| ());
    let lasted = start.elapsed();
    works_by(&up);
    tell(&up, &format!("negotiation: {written} bytes in {lasted:.1?}, {back} bytes back"));
    assert_small(&up, before);
}
