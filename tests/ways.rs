//! The ways into a rig that is up, other than a pty: clients over TCP and RFC 2217.

#![allow(clippy::disallowed_methods, reason = "a port at pace 1 is measured by the wall clock")]

use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::path::Path;

use crate::common::clients::{FEED, MEDIUM, times, wait_for_times};
use crate::common::{ACK, AT_REST, NAK, PATIENCE, Up, XOFF, XON, folder, output, torno, wait_until};
use crate::pc_port::pyserial;

/// A rig of this transport that logs every byte that the PC's UART sends and receives.
fn up_by(transport: &str, arguments: &[&str]) -> Up {
    logged_up_by("trace", transport, arguments)
}

pub(crate) fn logged_up_by(level: &str, transport: &str, arguments: &[&str]) -> Up {
    let folder = folder();
    let control = folder.path().join("control");
    let mut command = torno(&["up", "--json", "--transport", transport, "--control", control.to_str().unwrap()]);
    command.args(arguments).env("RUST_LOG", format!("torno={level}"));
    Up::launch(command, folder)
}

pub(crate) const TCP: &str = "tcp://127.0.0.1:0";
pub(crate) const RFC2217: &str = "rfc2217://127.0.0.1:0";

/// A client by TCP that blocks.
pub(crate) struct Client(pub(crate) TcpStream);

impl Client {
    pub(crate) fn of(up: &Up) -> Self {
        let url = up.ready["ports"]["pc"]["port"].as_str().unwrap();
        let stream = TcpStream::connect(url.split_once("://").unwrap().1).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream.set_nodelay(true).unwrap();
        Self(stream)
    }

    /// One that has the port.
    pub(crate) fn admitted(up: &Up) -> Self {
        let before = times(up, "has been opened");
        let client = Self::of(up);
        wait_for_times(up, "has been opened", before + 1);
        client
    }

    fn write(&mut self, bytes: &[u8]) {
        self.0.write_all(bytes).unwrap();
    }

    fn read(&mut self, n: usize) -> Vec<u8> {
        let mut bytes = vec![0; n];
        let read = self.0.read_exact(&mut bytes);
        assert!(read.is_ok(), "{read:?}");
        bytes
    }

    #[track_caller]
    fn expect(&mut self, bytes: &[u8]) {
        assert_eq!(self.read(bytes.len()), bytes, "expected {bytes:02x?}");
    }

    /// All that comes until the other end closes.
    pub(crate) fn read_all(&mut self) -> Vec<u8> {
        let mut all = Vec::new();
        match self.0.read_to_end(&mut all) {
            Err(error) if error.kind() != ErrorKind::ConnectionReset => panic!("{error}"),
            _ => all,
        }
    }
}

// --- TCP ------------------------------------------------------------------------------------------------------------

#[test]
fn a_client_by_tcp_has_the_same_conversation() {
    let up = up_by(TCP, &["--pace", "20"]);
    let port = &up.ready["ports"]["pc"];
    assert!(port["port"].as_str().unwrap().starts_with("socket://127.0.0.1:"), "{port}");
    assert!(port.get("path").is_none() && port["baud"] == 9600, "{port}");
    let mut pc = Client::of(&up);
    pc.write(&[FEED, FEED].concat());
    pc.expect(&[ACK, XOFF, XON, ACK, XON]);
    // Every byte is as good as any other.
    pc.write(&[0xff; 8]);
    pc.expect(&[NAK, b's']);
}

#[test]
fn a_second_client_is_told_why_it_is_refused_and_the_first_goes_on() {
    let up = up_by(TCP, &[]);
    let mut first = Client::admitted(&up);
    let told = String::from_utf8(Client::of(&up).read_all()).unwrap();
    let address = first.0.local_addr().unwrap();
    assert_eq!(told, format!("torno: {address} has this port open: one client at a time\r\n"));
    first.write(&AT_REST);
    first.expect(&[ACK, XON]);
    drop(first);
    let mut next = Client::admitted(&up);
    next.write(&AT_REST);
    next.expect(&[ACK, XON]);
    assert_eq!(times(&up, "has been closed"), 1);
}

/// The end of a connection may come after the next has begun.
#[test]
fn a_client_that_comes_just_before_the_other_goes_is_let_in() {
    let up = up_by(TCP, &[]);
    let first = Client::admitted(&up);
    let mut next = Client::of(&up);
    drop(first);
    next.write(&AT_REST);
    next.expect(&[ACK, XON]);
    assert_eq!(times(&up, "is refused"), 0);
}

#[test]
fn a_client_that_has_no_more_to_say_still_gets_its_replies() {
    let up = up_by(TCP, &["--pace", "20"]);
    let mut pc = Client::of(&up);
    pc.write(&FEED);
    pc.0.shutdown(Shutdown::Write).unwrap();
    pc.expect(&[ACK, XON]);
    up.wait_for_log("has been closed");
    // It no longer has the port.
    let mut next = Client::admitted(&up);
    next.write(&AT_REST);
    next.expect(&[ACK, XON]);
    assert_eq!(pc.read_all(), [0_u8; 0]);
}

#[test]
fn what_a_client_has_left_is_sent_before_what_the_next_writes() {
    let up = up_by(TCP, &["--pace", "20"]);
    let mut pc = Client::of(&up);
    // More than the port takes before it is wanted.
    pc.write(&AT_REST.repeat(60));
    drop(pc);
    let mut next = Client::admitted(&up);
    next.write(&[0, 0, 0, 0, 2, 0, 0, 0]);
    wait_for_times(&up, "pc: sent", 61 * 8);
    assert_eq!(times(&up, "pc: sent 2"), 1);
    assert!(up.log().trim_end().lines().rev().take(40).any(|line| line.contains("pc: sent 2")), "{}", up.log());
}

/// The client's writes block, once its own system, this one's and the port have no room.
#[test]
fn a_client_that_writes_more_than_is_wanted_has_to_wait() {
    let up = up_by(TCP, &[]);
    let pc = Client::admitted(&up);
    // The client's own system would take megabytes.
    rustix::net::sockopt::set_socket_send_buffer_size(&pc.0, 4096).unwrap();
    pc.0.set_nonblocking(true).unwrap();
    let mut written = 0;
    let mut is_full = || match (&pc.0).write(&AT_REST.repeat(512)) {
        Ok(length) => {
            written += length;
            false
        }
        Err(error) => error.kind() == ErrorKind::WouldBlock,
    };
    wait_until("no more can be written", &mut is_full);
    assert!(written < 200_000, "{written}");
}

#[test]
fn a_client_that_never_reads_stalls_nothing_and_what_it_does_not_read_is_lost() {
    // A status report has some sixty bytes. A log of every one of them would be what this measures.
    let up = logged_up_by("info", TCP, &["lathe-grbl", "--pace", "max"]);
    let mut pc = Client::of(&up);
    let before = memory(&up);
    // The client's own system would take megabytes, each way.
    rustix::net::sockopt::set_socket_recv_buffer_size(&pc.0, 4096).unwrap();
    rustix::net::sockopt::set_socket_send_buffer_size(&pc.0, 4096).unwrap();
    let ask = |pc: &mut Client| pc.write(&b"?".repeat(4096));
    wait_until("replies are lost", || {
        ask(&mut pc);
        up.log().contains("does not read")
    });
    let lost = times(&up, "does not read");
    wait_until("the rig goes on", || {
        ask(&mut pc);
        times(&up, "does not read") > lost
    });
    assert!(memory(&up) < before + 16_000, "{} kB, {before} kB before", memory(&up));
    drop(pc);
    let mut next = Client::admitted(&up);
    // What the one before has asked is still answered: whoever reads byte by byte would not keep up.
    let (mut heard, mut buffer) = (String::new(), [0; 4096]);
    while !heard.contains("Grbl 1.1h") {
        // Other tests have signals.
        let read = match next.0.read(&mut buffer) {
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            read => read.unwrap(),
        };
        assert!(read > 0, "closed after {heard}");
        heard.push_str(&String::from_utf8_lossy(&buffer[..read]));
        heard = heard.split_off(heard.len().saturating_sub(8192));
    }
}

/// Resident, in kB.
pub(crate) fn memory(up: &Up) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", up.pid())).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    line.split_whitespace().next().unwrap().parse().unwrap()
}

#[test]
fn a_connection_is_a_reset_where_opening_is_one() {
    let up = up_by(TCP, &["lathe-grbl", "--pace", "20"]);
    for n in 1..=2 {
        let mut pc = Client::admitted(&up);
        let hello = b"\r\nGrbl 1.1h ['$' for help]\r\n";
        // What was under way when the controller restarted may come before.
        let mut read = Vec::new();
        while !read.ends_with(hello) {
            read.extend(pc.read(1));
        }
        assert_eq!(times(&up, "has been opened"), n);
    }
}

#[test]
fn a_session_by_tcp_is_recorded_and_repeated_without_a_client() {
    let folder = folder();
    let path = folder.path().join("a.torno");
    let path = path.to_str().unwrap();
    let mut up = up_by(TCP, &["--pace", "max", "--record", path]);
    let mut pc = Client::of(&up);
    pc.write(&[FEED, MEDIUM].concat());
    pc.expect(&[ACK, XOFF, XON, ACK, XON]);
    crate::common::kill("-INT", up.pid());
    up.child.wait().unwrap();
    let output = output(&["replay", path]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn a_rig_file_can_name_the_transport_and_the_command_line_another() {
    let up = up_by("pc=tcp://127.0.0.1:0", &["--set", "pc.transport=rfc2217://127.0.0.1:1"]);
    assert!(up.ready["ports"]["pc"]["port"].as_str().unwrap().starts_with("socket://"));
    let folder = folder();
    let control = folder.path().join("control");
    let mut command = torno(&["up", "--json", "--control", control.to_str().unwrap()]);
    command.args(["--set", "pc.transport=rfc2217://127.0.0.1:0"]);
    let up = Up::launch(command, folder);
    assert!(up.ready["ports"]["pc"]["port"].as_str().unwrap().starts_with("rfc2217://127.0.0.1:"));
}

#[test]
fn what_cannot_be_is_refused_with_what_was_expected() {
    for (arguments, expected) in [
        (&["--transport", "udp://127.0.0.1:0"][..], "is no transport: expected pty, tcp://ADDRESS:PORT or rfc2217://"),
        (&["--transport", "tcp://nowhere:1"], "expected an IP address (or localhost) and a port"),
        (&["--transport", "pcc=pty"], "there is no gateway 'pcc': did you mean 'pc'?"),
        (&["--transport", TCP, "--link", "x"], "leave --link out"),
        (&["--transport", "tcp://192.0.2.1:0"], "cannot listen at 192.0.2.1:0: "),
        (&["--set", "pc.transport=ptty"], "'ptty' is no transport: expected pty"),
    ] {
        let output = output(&[&["up"], arguments].concat());
        let message = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && message.contains(expected), "{arguments:?}: {message}");
    }
    assert!(!Path::new("x").exists());
}

#[test]
fn an_address_that_others_reach_is_warned_of() {
    let up = up_by("tcp://0.0.0.0:0", &[]);
    assert!(up.log().contains("is not of this computer alone"), "{}", up.log());
    let up = up_by(TCP, &[]);
    assert!(!up.log().contains("is not of this computer alone"), "{}", up.log());
}

// --- RFC 2217 -------------------------------------------------------------------------------------------------------

#[test]
fn pyserial_by_tcp_and_by_rfc_2217_has_the_same_conversation() {
    for transport in [TCP, RFC2217] {
        let up = up_by(transport, &["--pace", "20"]);
        let script = r"
import serial, sys
port = serial.serial_for_url(sys.argv[1], 9600, timeout=60)
for frame in ['00e100e100000100', 'ffffffffffffffff', '0000000000000000']:
    port.write(bytes.fromhex(frame))
    reply = port.read(2)
    assert reply == (b'\x15s' if frame[0] == 'f' else b'\x06\x11'), reply
";
        if !pyserial(&up, script) {
            return;
        }
        assert_eq!(times(&up, "frame refused"), 1);
    }
}

#[test]
fn pyserial_changes_baud_format_and_sends_a_break_by_rfc_2217() {
    let up = up_by(RFC2217, &["--pace", "20"]);
    let script = r"
import serial, sys, time
ACK, XON, REFUSED = b'\x06', b'\x11', b'\x15l'
port = serial.serial_for_url(sys.argv[1], 9600, timeout=60)

def works():
    port.write(bytes(8))
    reply = port.read(2)
    assert reply == ACK + XON, reply

works()
# 0x00 at 8E1: its parity bit is 0, and stands where the master looks for the stop bit.
port.parity = serial.PARITY_EVEN
port.write(b'\x00')
# The two characters of the refusal follow each other: where this end looks for a stop bit, the second's start bit is.
assert port.read(2)[:1] == REFUSED[:1]
# At 8O1 the parity bit of 0x00 is 1, and passes for a stop bit.
port.parity = serial.PARITY_ODD
time.sleep(0.05)
port.reset_input_buffer()
works()
port.parity, port.stopbits = serial.PARITY_NONE, serial.STOPBITS_TWO
works()
port.stopbits = serial.STOPBITS_ONE
# At half the speed, the master finds low where it looks for the stop bit.
port.baudrate = 4800
port.write(b'\x00')
assert port.read(1)
port.baudrate = 9600
time.sleep(0.05)
port.reset_input_buffer()
works()
port.send_break(0.1)
reply = port.read(2)
assert reply == REFUSED, reply
time.sleep(0.05)
works()
port.break_condition = True
port.break_condition = False
assert port.read(2) == REFUSED
# What a UART does not have stays as it is, and pyserial is told so.
try:
    port.baudrate = 49
    raise SystemExit('49 baud')
except (ValueError, serial.SerialException):
    pass
assert port.cts and port.dsr and port.cd and not port.ri
";
    if pyserial(&up, script) {
        let log = up.log();
        // The mismatch, the lower speed, and two breaks.
        assert!(times(&up, "framing error on the line from the PC") >= 4, "{log}");
        for expected in ["sets 9600 baud, 8E1", "sets 9600 baud, 8N2", "sets 4800 baud, 8N1", "the rig's line has 8N1"]
        {
            assert!(log.contains(expected), "{expected}\n{log}");
        }
    }
}

#[test]
fn a_rising_dtr_is_the_reset_by_rfc_2217_and_not_the_connection() {
    let up = up_by(RFC2217, &["lathe-grbl", "--pace", "20"]);
    let script = r"
import serial, sys
port = serial.serial_for_url(sys.argv[1], 115200, timeout=20, do_not_open=True)
port.dtr = False
port.open()
port.write(b'$I\n')
assert port.readline().startswith(b'[VER:1.1h'), 'restarted'
port.dtr = True
while not (line := port.readline()).startswith(b'Grbl 1.1h'):
    assert line, 'not restarted'
port.dtr = True
port.write(b'$I\n')
while not (line := port.readline()).startswith(b'[VER:'):
    assert not line.startswith(b'Grbl'), 'restarted again'
port.dtr = False
port.dtr = True
while not (line := port.readline()).startswith(b'Grbl 1.1h'):
    assert line, 'not restarted'
";
    if pyserial(&up, script) {
        assert_eq!(times(&up, "raises DTR"), 2);
    }
}

#[test]
fn software_flow_control_by_rfc_2217_holds_the_uart_and_keeps_xon_to_itself() {
    let up = up_by(RFC2217, &["--pace", "20"]);
    let script = r"
import serial, sys
port = serial.serial_for_url(sys.argv[1], 9600, timeout=60, xonxoff=True)
port.write(bytes.fromhex('00e100e100000100') * 6)
assert port.read(6) == b'\x06' * 6
";
    if pyserial(&up, script) {
        assert_eq!(times(&up, "refused"), 0, "{}", up.log());
    }
}

#[test]
fn a_purge_forgets_what_is_not_sent_and_a_client_that_goes_ends_its_break() {
    let up = up_by(RFC2217, &[]);
    let mut pc = Client::of(&up);
    let control = |command: u8, value: u8| [255, 250, 44, command, value, 255, 240];
    // Software flow control; a frame that takes three seconds; others behind it; a purge of what is not sent.
    pc.write(&control(5, 2));
    pc.write(&MEDIUM);
    pc.write(&AT_REST.repeat(100));
    up.wait_for_log("frame held");
    pc.write(&control(12, 2));
    up.wait_for_log("all slaves done");
    wait_for_times(&up, "all slaves done", 2);
    assert!(times(&up, "distributed") <= 3, "{}", up.log());
    let sent = times(&up, "pc: sent");
    assert!(sent < 60, "{sent}");
    // The line is held low, until the client goes.
    pc.write(&control(5, 5));
    up.wait_for_log("line error");
    drop(pc);
    up.wait_for_log("has been closed");
    let mut next = Client::admitted(&up);
    // The silence after which the master listens again.
    std::thread::sleep(std::time::Duration::from_millis(100));
    let before = times(&up, "distributed");
    next.write(&AT_REST);
    wait_for_times(&up, "distributed", before + 1);
}

#[test]
fn malformed_half_and_endless_negotiation_does_no_harm() {
    let up = logged_up_by("info", RFC2217, &["--pace", "max"]);
    let before = memory(&up);
    let pc = Client::of(&up);
    rustix::net::sockopt::set_socket_recv_buffer_size(&pc.0, 4096).unwrap();
    // Two options that are refused for ever, and no one reads the refusals.
    pc.0.set_nonblocking(true).unwrap();
    let endless = [255, 253, 1, 255, 251, 77].repeat(1000);
    let mut is_full = || matches!((&pc.0).write(&endless), Err(error) if error.kind() == ErrorKind::WouldBlock);
    wait_until("the answers fill all there is", &mut is_full);
    assert!(memory(&up) < before + 16_000);
    drop(pc);
    for half in [&[255][..], &[255, 250], &[255, 250, 44, 1, 0], &[255, 253], &[255, 250, 44, 255]] {
        let mut pc = Client::admitted(&up);
        pc.write(half);
    }
    let mut pc = Client::admitted(&up);
    pc.write(&[255, 250, 44]);
    pc.write(&[7; 1_000_000]);
    pc.write(&[255, 240]);
    pc.write(&AT_REST);
    let mut read = Vec::new();
    while !read.ends_with(&[ACK, XON]) {
        read.extend(pc.read(1));
    }
    assert!(memory(&up) < before + 16_000);
}

#[test]
fn the_text_says_how_to_attach() {
    let folder = folder();
    let mut child = torno(&["up", "--transport", RFC2217, "--control"])
        .arg(folder.path().join("control"))
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let mut text = String::new();
    let mut out = std::io::BufReader::new(child.stdout.take().unwrap());
    while !text.contains("Ctrl-C") {
        std::io::BufRead::read_line(&mut out, &mut text).unwrap();
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let port = text.lines().find_map(|line| line.strip_prefix("PC port   rfc2217://127.0.0.1:")).unwrap();
    let port = port.split_once(' ').unwrap().0;
    let attach = format!("attach    python3 -m serial.tools.miniterm rfc2217://127.0.0.1:{port} 9600\n");
    assert!(text.contains(&attach) && !text.contains("torno send"), "{text}");
}
