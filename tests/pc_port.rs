//! The PC port from outside: a rig of real processes that is up, and serial clients that know nothing of it.
//!
//! A test waits for facts: for bytes, or for a line in the rig's log. Where time itself is tested, its bounds are lower
//! ones only: a busy machine is late, never early.

#![allow(clippy::disallowed_methods, reason = "a port at pace 1 is measured by the wall clock")]

use std::fs::{self, File};
use std::io::{Read, Write};
use std::os::unix::fs::{MetadataExt, chown};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

use crate::common::clients::*;
use crate::common::{ACK, AT_REST, LONG, NAK, PATIENCE, Pc, Up, XOFF, XON};
use crate::common::{folder, is_installed, kill, torno, wait_until};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serialport::{ClearBuffer, FlowControl, SerialPort};

// --- the conversation -----------------------------------------------------------------------------------------------

#[test]
fn two_frames_in_one_write_give_ack_xoff_xon_ack_xon() {
    let up = Up::start(&["--pace", "20"]);
    let mut pc = up.pc();
    pc.write(&[FEED, FEED].concat());
    pc.expect(&[ACK, XOFF, XON, ACK, XON]);
    assert!(pc.is_silent());
}

#[test]
fn third_frame_while_one_is_held_is_refused_and_the_held_one_executed() {
    let up = Up::start(&["--pace", "20"]);
    let mut pc = up.pc();
    pc.write(&[MEDIUM, FEED, AT_REST].concat());
    pc.expect(&[ACK, XOFF, NAK, b'o', XON, ACK, XON]);
    assert_eq!(times(&up, "distributed"), 2);
}

#[test]
fn frame_out_of_range_is_refused_at_once_also_while_slaves_are_busy() {
    let up = Up::start(&["--pace", "20"]);
    let mut pc = up.pc();
    let with = |at: usize, byte: u8| {
        let mut frame = FEED;
        frame[at] = byte;
        frame
    };
    for (wrong, letter) in [(with(4, 2), b'd'), (with(7, 0xff), b'd'), (with(0, 9), b's'), (with(1, 0), b's')] {
        pc.write(&wrong);
        pc.expect(&[NAK, letter]);
    }
    assert_eq!(times(&up, "distributed"), 0, "nothing of them moves");
    pc.write(&[MEDIUM, with(4, 2), with(0, 201), FEED].concat());
    pc.expect(&[ACK, NAK, b'd', NAK, b's', XOFF, XON, ACK, XON]);
}

#[test]
fn silence_in_mid_frame_cuts_the_part_short() {
    let up = Up::start(&[]);
    let mut pc = up.pc();
    for length in [1, 4, 7] {
        let start = Instant::now();
        pc.write(&FEED[..length]);
        pc.expect(&[NAK, b'c']);
        assert!(start.elapsed() >= Duration::from_millis(50));
    }
    pc.write(&AT_REST);
    pc.expect(&[ACK, XON]);
}

#[test]
fn answer_cannot_come_before_the_wire_time() {
    let up = Up::start(&[]);
    let mut pc = up.pc();
    for _ in 0..20 {
        let start = Instant::now();
        pc.write(&AT_REST);
        pc.expect(&[ACK]);
        // Eight characters in, four out, one reply; a receiver is sure of a character half a bit before its end.
        assert!(start.elapsed() >= Duration::from_micros(13_300), "{:?}", start.elapsed());
        pc.expect(&[XON]);
    }
}

#[test]
fn random_bytes_do_not_keep_a_valid_frame_after_a_gap_from_being_obeyed() {
    let up = traced(&["--pace", "200"]);
    let mut pc = up.pc();
    let mut random = ChaCha8Rng::seed_from_u64(2);
    for round in 1..=3 {
        let bytes = garbage(&mut random, 3_000);
        let before = times(&up, "pc: sent");
        pc.write(&bytes);
        wait_for_times(&up, "pc: sent", before + bytes.len());
        // A gap of twenty seconds to the rig. A held frame is distributed soon after the one before it is done.
        wait_until("the slaves stay at rest", || {
            is_at_rest(&up) && {
                thread::sleep(Duration::from_millis(100));
                is_at_rest(&up)
            }
        });
        let replies = pc.port.bytes_to_read().unwrap();
        assert!(replies > 0);
        pc.read(replies as usize);
        pc.write(&AT_REST);
        assert_eq!(pc.read(2), [ACK, XON], "round {round}");
    }
    assert!(times(&up, "distributed") > 3 && times(&up, "frame refused") > 100, "not random enough");
}

fn is_at_rest(up: &Up) -> bool {
    let log = up.log();
    let last = |text| log.rfind(text);
    last("distributed").max(last("frame held")) <= last("all slaves done")
}

/// Bytes of any value, frames that move a little, and parts of such frames.
fn garbage(random: &mut ChaCha8Rng, length: usize) -> Vec<u8> {
    let mut below = |n: u32| (random.next_u32() % n) as u8;
    let mut bytes = Vec::new();
    while bytes.len() < length {
        match below(3) {
            0 => (0..=below(20)).for_each(|_| bytes.push(below(256))),
            kind => {
                let frame = [10 + below(190), 1 + below(225), 0, below(256), below(2), 0, below(3), below(2)];
                let whole = if kind == 1 { 8 } else { 1 + below(7) };
                bytes.extend(&frame[..usize::from(whole)]);
            }
        }
    }
    bytes
}

// --- a client that is held by its operating system ------------------------------------------------------------------

/// More than the kernel holds for a client (9 to 21 KB): its write returns only when the rig has taken some.
#[test]
fn blocking_write_of_36_kb_is_held_and_nothing_of_it_is_lost() {
    const FRAMES: usize = 4500;
    let up = Up::start(&["--pace", "100"]);
    let mut pc = pc_with_ixon(&up);
    let mut writer = pc.port.try_clone_native().unwrap();
    // The log comes later than what it tells.
    let acknowledged = AtomicUsize::new(0);
    thread::scope(|scope| {
        let write = scope.spawn(|| {
            writer.write_all(&AT_REST.repeat(FRAMES)).unwrap();
            acknowledged.load(Ordering::Relaxed)
        });
        for _ in 0..FRAMES {
            // The terminal takes XON and XOFF for itself.
            assert_eq!(pc.read(1), [ACK]);
            acknowledged.fetch_add(1, Ordering::Relaxed);
        }
        let early = write.join().unwrap();
        assert!(early > 500, "the write returned before the kernel had room for the rest: {early}");
    });
    assert!(times(&up, "frame held") > FRAMES / 2);
    assert_eq!(times(&up, "refused"), 0, "{}", up.log());
}

#[test]
fn harness_that_was_stopped_for_a_while_loses_nothing_of_a_stream() {
    let up = Up::start(&[]);
    let mut pc = pc_with_ixon(&up);
    pc.write(&AT_REST.repeat(20));
    pc.expect(&[ACK]);
    kill("-STOP", up.pid());
    // Long enough for the rig to run out of all that it had taken from the kernel.
    thread::sleep(Duration::from_millis(600));
    kill("-CONT", up.pid());
    assert_eq!(pc.read(19), [ACK; 19], "{}", up.log());
}

#[test]
fn flush_by_the_client_leaves_only_what_the_uart_had_loaded() {
    let up = Up::start(&[]);
    let mut pc = pc_with_ixon(&up);
    pc.write(&[MEDIUM, AT_REST].concat());
    pc.write(&AT_REST.repeat(28));
    up.wait_for_log("frame held");
    pc.port.clear(ClearBuffer::Output).unwrap();
    // The first, the held one, and the few bytes that were under way when XOFF came.
    pc.expect(&[ACK, ACK, NAK, b'c']);
    pc.write(&AT_REST);
    pc.expect(&[ACK]);
    assert_eq!(times(&up, "distributed"), 3);
}

#[test]
fn flush_right_after_a_write_leaves_nothing_to_be_sent() {
    let up = Up::start(&[]);
    let mut pc = up.pc();
    for _ in 0..20 {
        pc.write(&AT_REST.repeat(6));
        pc.port.clear(ClearBuffer::Output).unwrap();
        // Longer than the silence that cuts a frame short.
        thread::sleep(Duration::from_millis(100));
    }
    assert_eq!(times(&up, "distributed"), 0, "{}", up.log());
    pc.port.clear(ClearBuffer::Input).unwrap();
    pc.write(&AT_REST);
    pc.expect(&[ACK, XON]);
}

// --- clients come and go --------------------------------------------------------------------------------------------

#[test]
fn client_that_closes_in_mid_frame_leaves_the_next_neither_bytes_nor_replies() {
    let up = traced(&[]);
    for round in 1..=3 {
        let mut first = up.pc();
        first.write(&FEED[..5]);
        drop(first);
        wait_for_times(&up, "frame refused: cut short", round);
        wait_for_times(&up, &format!("received {}", b'c'), round);
        wait_for_times(&up, "the PC port has been closed", 2 * round - 1);
        let mut second = up.pc();
        assert!(second.is_silent());
        second.write(&AT_REST);
        second.expect(&[ACK, XON]);
        drop(second);
        wait_for_times(&up, "the PC port has been closed", 2 * round);
    }
}

#[test]
fn client_that_closes_while_slaves_move_does_not_disturb_them() {
    let up = traced(&[]);
    let mut first = up.pc();
    first.write(&[FEED, AT_REST].concat());
    first.expect(&[ACK, XOFF]);
    drop(first);
    up.wait_for_log("the PC port has been closed");
    wait_for_times(&up, "all slaves done", 2);
    wait_for_times(&up, &format!("received {XON}"), 2);
    let mut second = up.pc();
    second.write(&AT_REST);
    second.expect(&[ACK, XON]);
    assert_eq!(times(&up, "distributed"), 3);
}

#[test]
fn wrong_speed_gives_framing_errors_until_it_is_put_right() {
    for baud in [4800, 19_200] {
        let up = Up::start(&[]);
        let mut pc = Pc::open(&up.link(), baud);
        // Two in one write, so that there is something on the wire after a character too many.
        pc.write(&[FEED, FEED].concat());
        up.wait_for_log("framing error on the line from the PC");
        up.wait_for_log("frame refused: line error");
        assert_eq!(times(&up, "distributed"), 0);
        // The refusal itself is unreadable at this speed. A client that restarts is understood after a silence.
        drop(pc);
        up.wait_for_log("the PC port has been closed");
        thread::sleep(Duration::from_millis(100));
        let mut pc = up.pc();
        pc.write(&AT_REST);
        pc.expect(&[ACK, XON]);
    }
}

#[test]
fn another_speed_than_the_rigs_is_a_warning_with_both() {
    let up = Up::start(&[]);
    let pc = Pc::open(&up.link(), 19_200);
    up.wait_for_log("the program at the PC port sets 19200 baud, but the rig's line has 9600 baud");
    drop(pc);
    up.wait_for_log("the PC port has been closed");
    let _slow = Pc::open(&up.link(), 10);
    up.wait_for_log("sets 10 baud, which its UART takes for 50, but the rig's line has 9600 baud");
}

/// The speed in a recording is the one that the line has.
#[test]
fn speed_below_the_uarts_is_recorded_as_the_uarts() {
    let place = folder();
    let file = place.path().join("t");
    let mut up = Up::start(&["--record", file.to_str().unwrap()]);
    let _slow = Pc::open(&up.link(), 10);
    up.wait_for_log("sets 10 baud");
    kill("-TERM", up.pid());
    up.child.wait().unwrap();
    let trace = torno(&["trace", file.to_str().unwrap()]).output().unwrap().stdout;
    let trace = String::from_utf8_lossy(&trace);
    assert!(trace.contains("sets 50 baud") && !trace.contains("sets 10 baud"), "{trace}");
}

/// On a pty `tcdrain` returns at once: the program sets another speed while its bytes still wait.
#[test]
fn bytes_leave_at_the_speed_at_which_they_were_written() {
    let up = Up::start(&[]);
    let mut pc = up.pc();
    // By then the rig has seen what opening the port has set.
    pc.write(&AT_REST);
    pc.expect(&[ACK, XON]);
    for round in 1..=10 {
        pc.write(&AT_REST.repeat(2));
        pc.port.flush().unwrap();
        pc.port.set_baud_rate(19_200).unwrap();
        wait_for_times(&up, "all slaves done", 1 + 2 * round);
        pc.port.set_baud_rate(9_600).unwrap();
        wait_for_times(&up, "sets 9600 baud", round);
        // What was heard at 19200 baud.
        pc.port.clear(ClearBuffer::Input).unwrap();
    }
    assert_eq!(times(&up, "frame refused"), 0, "{}", up.log());
}

/// The silence after a line error ends in nothing that the master tells: at full speed time passes it all the same.
#[test]
fn valid_frame_after_a_line_error_is_obeyed_at_full_speed_too() {
    let up = Up::start(&["--pace", "max"]);
    let mut pc = Pc::open(&up.link(), 1200);
    pc.write(&[0; 20]);
    up.wait_for_log("frame refused: line error");
    drop(pc);
    up.wait_for_log("the PC port has been closed");
    thread::sleep(Duration::from_millis(200));
    let mut pc = up.pc();
    pc.write(&AT_REST);
    pc.expect(&[ACK, XON]);
}

/// No one hears what the PC sends meanwhile, so nothing holds it back: it is sent once.
#[test]
fn what_is_sent_to_a_stopped_master_at_full_speed_is_sent_once() {
    let up = traced(&["--pace", "max"]);
    let master = up.board("master");
    let mut pc = up.pc();
    kill("-STOP", master);
    up.wait_for_log("was stopped");
    for n in 1..=3 {
        pc.write(&[0x80; 8]);
        wait_for_times(&up, "sent 128", 8 * n);
        thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(times(&up, "sent 128"), 24);
    kill("-CONT", master);
    up.wait_for_log("was continued");
    thread::sleep(Duration::from_millis(200));
    pc.write(&AT_REST);
    wait_for_times(&up, "distributed", 1);
}

/// The first is held, the second does not understand `XON`: it must not be the third who pays.
#[test]
fn stop_that_a_client_could_not_understand_the_end_of_does_not_outlive_it() {
    let up = traced(&[]);
    let mut first = pc_with_ixon(&up);
    // Three bytes more: few enough are left for the rig to take the second client's.
    first.write(&[&FEED[..], &FEED, &[0; 3]].concat());
    up.wait_for_log(&format!("received {XOFF}"));
    drop(first);
    wait_for_times(&up, "the PC port has been closed", 1);
    let mut second = Pc::open(&up.link(), 19_200);
    second.port.set_flow_control(FlowControl::Software).unwrap();
    second.write(&AT_REST);
    wait_for_times(&up, "all slaves done", 2);
    drop(second);
    wait_for_times(&up, "the PC port has been closed", 2);
    thread::sleep(Duration::from_millis(200));
    let mut third = up.pc();
    third.port.set_timeout(Duration::from_secs(5)).unwrap();
    third.write(&AT_REST);
    let reply = third.read(1)[0];
    assert!([ACK, NAK].contains(&reply), "{reply:02x}\n{}", up.log());
}

#[test]
fn long_stream_is_held_at_full_speed_too() {
    let up = Up::start(&["--pace", "max"]);
    let mut pc = pc_with_ixon(&up);
    // A quarter of a minute of virtual time, and as long again.
    pc.write(&MEDIUM.repeat(10));
    pc.expect(&[ACK; 10]);
    wait_for_times(&up, "all slaves done", 10);
}

#[test]
fn what_a_held_program_could_not_send_is_not_the_next_ones() {
    let up = traced(&["--pace", "20"]);
    let mut old = pc_with_ixon(&up);
    old.write(&[LONG, FEED, FEED, FEED, FEED].concat());
    old.expect(&[ACK]);
    up.wait_for_log("pc: received 19");
    drop(old);
    up.wait_for_log("the PC port has been closed");
    let mut new = up.pc();
    new.write(&AT_REST);
    // What the old one's UART had loaded at XOFF began that frame, so that the end of this one is cut short.
    new.expect(&[NAK, b'o', NAK, b'c']);
    up.wait_for_log("bytes that the program before could not send are dropped");
    new.write(&AT_REST);
    new.expect(&[NAK, b'o']);
    assert!(new.is_silent());
}

#[test]
fn what_a_held_program_could_not_send_gives_way_to_a_redirection_too() {
    let up = traced(&["--pace", "20"]);
    let mut old = pc_with_ixon(&up);
    old.write(&[LONG, FEED, FEED, FEED, FEED].concat());
    old.expect(&[ACK]);
    up.wait_for_log("pc: received 19");
    drop(old);
    up.wait_for_log("the PC port has been closed");
    for refused in 1..=2 {
        let sh = Command::new("sh").args(["-c", "printf 12345678 > \"$0\""]).arg(up.link()).status().unwrap();
        assert!(sh.success());
        wait_for_times(&up, "frame refused", refused);
    }
    up.wait_for_log("bytes that the program before could not send are dropped");
}

#[test]
fn held_program_that_has_closed_the_port_is_sent_to_its_end_while_nobody_else_writes() {
    let up = traced(&["--pace", "20"]);
    let mut old = pc_with_ixon(&up);
    old.write(&MEDIUM.repeat(5));
    old.expect(&[ACK]);
    up.wait_for_log("pc: received 19");
    drop(old);
    up.wait_for_log("the PC port has been closed");
    let _reader = up.pc();
    wait_for_times(&up, "all slaves done", 5);
}

#[test]
fn speed_that_no_uart_has_does_not_stop_the_rig() {
    let up = traced(&["--pace", "20"]);
    for (round, baud) in [(1, u32::MAX), (2, 1)] {
        let mut wrong = Pc::open(&up.link(), baud);
        wrong.write(&[0x55; 16]);
        drop(wrong);
        wait_for_times(&up, "pc: sent 85", 16 * round);
        // At pace 20 a second of silence: whatever the master made of it is over.
        thread::sleep(Duration::from_millis(50));
        let mut right = up.pc();
        right.write(&AT_REST);
        right.expect(&[ACK, XON]);
    }
}

// --- the link and who may use it ------------------------------------------------------------------------------------

#[test]
fn port_is_its_owners_alone_and_its_link_goes_with_the_rig() {
    let mut up = Up::start(&[]);
    let device = fs::metadata(up.link()).unwrap();
    assert_eq!(device.mode() & 0o777, 0o600);
    assert_eq!(device.uid(), rustix::process::geteuid().as_raw());
    assert!(fs::symlink_metadata(up.link()).unwrap().is_symlink());
    let pc = up.pc();
    kill("-TERM", up.pid());
    assert_eq!(up.child.wait().unwrap().code(), Some(0));
    assert!(fs::symlink_metadata(up.link()).is_err(), "the link is still there");
    drop(pc);
}

#[test]
fn second_rig_at_the_same_default_link_is_refused() {
    let runtime = folder();
    let command = || {
        let mut command = torno(&["up", "--json"]);
        command.env("XDG_RUNTIME_DIR", runtime.path());
        command
    };
    let mut first = Up::launch(command(), folder());
    assert_eq!(first.link(), runtime.path().join("torno/lathe-pc"));
    refused(command(), "is already up at");
    first.pc();
    // A harness that was killed leaves its link behind; the next one replaces it.
    first.child.kill().unwrap();
    first.child.wait().unwrap();
    assert!(fs::symlink_metadata(first.link()).is_ok());
    let second = Up::launch(command(), folder());
    let mut pc = second.pc();
    pc.write(&AT_REST);
    pc.expect(&[ACK, XON]);
}

#[test]
fn link_that_exists_or_cannot_be_made_is_refused() {
    let folder = folder();
    let there = folder.path().join("there");
    fs::write(&there, "mine").unwrap();
    refused(torno(&["up", "--link", there.to_str().unwrap()]), "already exists");
    assert_eq!(fs::read_to_string(&there).unwrap(), "mine");
    let nowhere = folder.path().join("nowhere/pc");
    refused(torno(&["up", "--link", nowhere.to_str().unwrap()]), "cannot put a link into the folder");
}

/// Expects exit code 2 and an error that says why.
fn refused(mut command: Command, why: &str) {
    let Output { status, stderr, .. } = command.output().unwrap();
    let stderr = String::from_utf8_lossy(&stderr);
    assert_eq!(status.code(), Some(2), "{stderr}");
    assert!(stderr.contains(why), "{stderr}");
}

/// Exclusive mode does not hold root back, so all this is done by somebody else.
#[test]
fn exclusive_mode_of_a_client_that_was_killed_does_not_lock_out_the_next() {
    let root = rustix::process::geteuid().is_root();
    let folder = folder();
    let own = |path: &Path| {
        if root {
            chown(path, Some(NOBODY), Some(NOBODY)).unwrap()
        }
    };
    // The target folder may be closed to others.
    let exe = folder.path().join("program");
    // By another process: one that this one forks meanwhile would keep a file open that it writes, which cannot be run.
    let copied = Command::new("install").args(["-m", "755", env!("CARGO_BIN_EXE_torno")]).arg(&exe).status();
    assert!(copied.unwrap().success());
    let program = program(folder.path(), &[LONG, AT_REST]);
    [folder.path(), &exe, &program].into_iter().for_each(own);
    let runtime = folder.path().to_owned();
    let somebody = |program: &Path, arguments: &[&str]| {
        let mut command = Command::new(program);
        command.args(arguments).env_remove("RUST_LOG").env("XDG_RUNTIME_DIR", &runtime).current_dir("/");
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        if root {
            command.uid(NOBODY).gid(NOBODY);
        }
        command
    };

    let up = Up::launch(somebody(&exe, &["up", "--json"]), folder);
    let link = up.link();
    let opens = || somebody(Path::new("sh"), &["-c", ": <>\"$0\"", link.to_str().unwrap()]).status().unwrap().success();
    assert!(opens());
    let arguments = ["send", program.to_str().unwrap(), "--port", link.to_str().unwrap()];
    let mut client = Killed(somebody(&exe, &arguments).spawn().unwrap());
    up.wait_for_log("frame held");
    assert!(!opens(), "torno send does not ask for exclusive mode: this test tests nothing");
    client.0.kill().unwrap();
    client.0.wait().unwrap();
    wait_until("the port may be opened again", opens);
}

// --- clients of others ----------------------------------------------------------------------------------------------

/// A process that does not outlive its test.
struct Killed(Child);

impl Drop for Killed {
    fn drop(&mut self) {
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

fn shell(script: &str, arguments: &[&Path]) -> Output {
    let output = Command::new("sh").arg("-euc").arg(script).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    output
}

#[test]
fn stty_and_a_shell_send_a_frame_and_read_the_replies() {
    let up = Up::start(&[]);
    let script = r"
        stty -F $0 9600 raw -echo
        exec 3<>$0
        printf '\0\0\0\0\0\0\0\0' >&3
        head -c 2 <&3
    ";
    assert_eq!(shell(script, &[&up.link()]).stdout, [ACK, XON]);
}

#[test]
fn stty_and_cat_send_a_program_that_is_held() {
    let up = Up::start(&[]);
    let folder = folder();
    let bytes = folder.path().join("program");
    fs::write(&bytes, [&FEED[..], &AT_REST.repeat(20)].concat()).unwrap();
    // No one has the port open any more while the rest leaves.
    shell("stty -F $0 9600 raw -echo ixon; cat $1 >$0", &[&up.link(), &bytes]);
    wait_for_times(&up, "all slaves done", 21);
    assert!(times(&up, "frame held") > 0);
    assert_eq!(times(&up, "refused"), 0, "{}", up.log());
}

/// Types a frame into a program that joins its standard streams to the port, and waits for the replies.
fn talks_through(program: &str, arguments: &[&str]) {
    let mut command = Command::new(program);
    let command = command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut terminal = Killed(command.spawn().unwrap());
    let mut output = terminal.0.stdout.take().unwrap();
    let (tell, told) = mpsc::channel();
    thread::spawn(move || {
        let mut byte = [0];
        while output.read_exact(&mut byte).is_ok() && tell.send(byte[0]).is_ok() {}
    });
    terminal.0.stdin.as_mut().unwrap().write_all(&AT_REST).unwrap();
    let mut heard = Vec::new();
    while !heard.ends_with(&[ACK, XON]) {
        heard.push(told.recv_timeout(PATIENCE).unwrap_or_else(|_| panic!("{program} has heard only {heard:02x?}")));
    }
}

#[test]
fn socat_talks_to_the_port() {
    if is_installed("socat", Command::new("socat").arg("-V")) {
        let up = Up::start(&[]);
        talks_through("socat", &["STDIO", &format!("{},b9600,raw,echo=0", up.link().display())]);
    }
}

#[test]
fn picocom_talks_to_the_port() {
    if is_installed("picocom", Command::new("picocom").arg("--help")) {
        let up = Up::start(&[]);
        talks_through("picocom", &["--quiet", "--no-escape", "--baud", "9600", up.link().to_str().unwrap()]);
    }
}

/// Runs a script with pyserial, with the port as its argument; false if it is not installed.
pub(crate) fn pyserial(up: &Up, script: &str) -> bool {
    let Some(python) = python_with_serial() else { return false };
    let port = up.ready["ports"]["pc"]["port"].as_str().unwrap();
    let output = Command::new(python).arg("-c").arg(script).arg(port).output().unwrap();
    assert!(output.status.success(), "{}\n{}", String::from_utf8_lossy(&output.stderr), up.log());
    true
}

/// A Python that has pyserial; none if there is none, which is said.
pub(crate) fn python_with_serial() -> Option<&'static str> {
    // A Python of one's own may hide the one that Debian's package belongs to.
    let has_serial = |python: &&str| {
        let check = Command::new(python).args(["-c", "import serial"]).output();
        check.is_ok_and(|output| output.status.success())
    };
    let python = ["python3", "/usr/bin/python3"].into_iter().find(has_serial);
    if python.is_none() {
        is_installed("pyserial", &mut Command::new("false"));
    }
    python
}

#[test]
fn pyserial_sends_a_program_and_is_held_by_reading_the_replies() {
    let up = Up::start(&[]);
    let script = "
import serial, sys
ACK, XON, XOFF = b'\\x06', b'\\x11', b'\\x13'
port = serial.Serial(sys.argv[1], 9600, timeout=60)
held = 0
for frame in [bytes.fromhex('00e100e100000100'), bytes(8)] * 2:
    port.write(frame)
    reply = None
    while reply != ACK:
        reply = port.read(1)
        assert reply in (ACK, XON, XOFF) and reply, reply
        held += reply == XOFF
assert port.read(1) == XON
assert held >= 2, held
";
    if pyserial(&up, script) {
        assert_eq!((times(&up, "distributed"), times(&up, "all slaves done")), (4, 4));
    }
}

#[test]
fn pyserial_with_xonxoff_is_held_by_blocking_writes_of_all_frames() {
    let up = Up::start(&[]);
    let script = "
import serial, sys
port = serial.Serial(sys.argv[1], 9600, xonxoff=True, timeout=60)
for frame in [bytes.fromhex('00e100e100000100')] + [bytes(8)] * 20:
    port.write(frame)
replies = port.read(21)
assert replies == b'\\x06' * 21, replies
";
    if pyserial(&up, script) {
        assert!(times(&up, "frame held") > 0);
    }
}

#[test]
fn examples_of_the_readme_do_as_it_says() {
    let up = Up::start(&["--pace", "20"]);
    let port = up.link();
    let examples = |language: &str| -> Vec<String> {
        let fence = format!("```{language}\n");
        let blocks = include_str!("../README.md").split(&fence).skip(1);
        blocks.map(|text| text.split("```").next().unwrap().replace("./lathe", port.to_str().unwrap())).collect()
    };
    for script in examples("sh") {
        assert_eq!(String::from_utf8_lossy(&shell(&script, &[]).stdout), " 06 11\n");
    }
    // One that would wait for ever is to fail.
    let alarm = format!("import signal; signal.alarm({})\n", PATIENCE.as_secs());
    let scripts = examples("python");
    for script in &scripts {
        if !pyserial(&up, &format!("{alarm}{script}")) {
            return;
        }
    }
    wait_for_times(&up, "all slaves done", 23);
    let refused = scripts[0].replace("4B E1", "09 E1").replace('\n', "\n    ");
    assert_ne!(refused, scripts[0]);
    let expected = "assert str(told).endswith(' is refused: s'), told";
    pyserial(
        &up,
        &format!("{alarm}try:\n    {refused}\nexcept SystemExit as told:\n    {expected}\nelse:\n    assert 0"),
    );
}

// --- at rest --------------------------------------------------------------------------------------------------------

/// How often the threads of a process have gone to sleep.
fn sleeps(pid: u64) -> u64 {
    let tasks = fs::read_dir(format!("/proc/{pid}/task")).unwrap().map(|task| task.unwrap().path().join("status"));
    let of_task = |path: PathBuf| -> u64 {
        let mut status = String::new();
        File::open(path).unwrap().read_to_string(&mut status).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("voluntary_ctxt_switches:"));
        line.unwrap().trim().parse().unwrap()
    };
    tasks.map(of_task).sum()
}

#[test]
fn rig_at_rest_polls_nothing() {
    let up = Up::start(&[]);
    let mut pc = up.pc();
    pc.write(&AT_REST);
    pc.expect(&[ACK, XON]);
    let boards = || -> u64 { up.boards().into_iter().map(sleeps).sum() };
    let before = (boards(), sleeps(up.pid()));
    // Elapsed time is what is measured here. Terminals elsewhere are not the rig's.
    (0..500).for_each(|_| {
        terminal();
        thread::sleep(Duration::from_millis(1));
    });
    let (boards, harness) = (boards() - before.0, sleeps(up.pid()) - before.1);
    assert!(boards <= 8, "the boards woke up {boards} times in half a second");
    assert!(harness <= 20, "the harness woke up {harness} times in half a second");
}
