//! Each trap of a pty, with real ones. A test waits for what it expects; `WAIT` only bounds a failure.

use std::fs::{self as files, File, Permissions};
use std::future::Future;
use std::io;
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt, symlink};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::pin::pin;
use std::process::{Command, Stdio};
use std::task::{Context, Poll, Waker};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::OwnedFd;
use rustix::fs::inotify::{self, CreateFlags, WatchFlags};
use rustix::fs::{Gid, Mode, OFlags, Uid, chown, open};
use rustix::io::{Errno, ioctl_fionread};
use rustix::process::geteuid;
use rustix::termios::{
    self, Action, ControlModes, InputModes, LocalModes, OptionalActions, OutputModes, QueueSelector,
};
use tempfile::TempDir;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio_serial::{SerialPort, SerialPortBuilderExt};

use super::link::Link;
use super::{LineCoding, LineSettings, LinkPath, PortError, PortEvent, PtyPort};

mod clients;
mod order;

const WAIT: Duration = Duration::from_secs(10);
const RIG_BAUD: u32 = 115_200;
const XON: u8 = 0x11;
const XOFF: u8 = 0x13;
const NOBODY: u32 = 65_534;

struct Bench {
    port: PtyPort,
    folder: TempDir,
}

impl Bench {
    fn new() -> Bench {
        let folder = tempfile::tempdir().unwrap();
        let port = PtyPort::open(LinkPath::Chosen(folder.path().join("rig-pc")), RIG_BAUD).unwrap();
        Bench { port, folder }
    }

    /// Opens the port as a client that sets nothing, and has the port notice.
    async fn client(&mut self) -> Client {
        let client = Client::open(self.port.link());
        assert_eq!(self.event().await, PortEvent::Opened);
        client
    }

    async fn event(&mut self) -> PortEvent {
        self.event_up_to(4096).await
    }

    /// The next event, but for changes of flow control and a client's first words.
    async fn event_up_to(&mut self, max: usize) -> PortEvent {
        within(self.next_event(max)).await
    }

    async fn next_event(&mut self, max: usize) -> PortEvent {
        loop {
            match self.port.event(max, None).await.unwrap() {
                PortEvent::Set | PortEvent::Began => {}
                event => return event,
            }
        }
    }

    async fn data(&mut self, length: usize) -> Vec<u8> {
        let mut all = Vec::new();
        while all.len() < length {
            match self.event().await {
                PortEvent::Data { bytes, .. } => all.extend(bytes),
                other => panic!("{other:?} after {} of {length} bytes", all.len()),
            }
        }
        all
    }

    /// Whether there is nothing to tell, with no time given for it to come.
    fn is_quiet(&mut self, max: usize) -> bool {
        matches!(pin!(self.next_event(max)).poll(&mut Context::from_waker(Waker::noop())), Poll::Pending)
    }

    /// Waits until so many bytes are held by the port, and by the kernel where the master side reads them.
    async fn arrived(&self, length: u64) {
        let arrived = || {
            let desk = self.port.unattended();
            desk.held() as u64 + ioctl_fionread(desk.pty.master()).unwrap() >= length
        };
        eventually(arrived).await;
    }

    /// What a reader of the master side would be woken by; polling also has the kernel hand over what is on its way.
    fn poll_master(&self) -> PollFlags {
        let all = PollFlags::IN | PollFlags::PRI;
        let desk = self.port.unattended();
        let mut polled = [PollFd::from_borrowed_fd(desk.pty.master(), all)];
        poll(&mut polled, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })).unwrap();
        polled[0].revents()
    }

    /// Writes replies, of which none may be lost.
    fn reply(&mut self, bytes: &[u8]) {
        assert_eq!(self.port.write(bytes), 0, "a reply was lost");
    }
}

/// A client that does not block.
struct Client(OwnedFd);

impl Client {
    fn open(path: &Path) -> Client {
        Client(open(path, OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC, Mode::empty()).unwrap())
    }

    fn write(&self, bytes: &[u8]) -> Result<usize, Errno> {
        rustix::io::write(&self.0, bytes)
    }

    /// Writes until the kernel takes no more.
    fn fill(&self, byte: u8) -> usize {
        let mut taken = 0;
        while let Ok(length) = self.write(&[byte; 512]) {
            taken += length;
        }
        taken
    }

    fn read(&self, length: usize) -> Vec<u8> {
        let mut all = Vec::new();
        while all.len() < length {
            assert!(self.readable(WAIT), "{} of {length} bytes came", all.len());
            let mut buffer = vec![0; length - all.len()];
            let got = rustix::io::read(&self.0, &mut buffer).unwrap();
            all.extend(&buffer[..got]);
        }
        all
    }

    /// Whether anything has come; polling also has the kernel hand over what is on its way.
    fn readable(&self, wait: Duration) -> bool {
        let wait = Timespec::try_from(wait).unwrap();
        poll(&mut [PollFd::new(&self.0, PollFlags::IN)], Some(&wait)).unwrap() > 0
    }

    fn set(&self, change: impl FnOnce(&mut termios::Termios)) {
        let mut termios = termios::tcgetattr(&self.0).unwrap();
        change(&mut termios);
        termios::tcsetattr(&self.0, OptionalActions::Now, &termios).unwrap();
    }

    fn set_ixon(&self) {
        self.set(|termios| termios.input_modes.insert(InputModes::IXON));
    }
}

async fn within<T>(future: impl Future<Output = T>) -> T {
    tokio::time::timeout(WAIT, future).await.expect("what was waited for never came")
}

async fn eventually(mut fact: impl FnMut() -> bool) {
    let wait = async {
        while !fact() {
            tokio::task::yield_now().await;
        }
    };
    within(wait).await;
}

/// Does what the port is to find out later.
fn unnoticed<T>(port: &PtyPort, act: impl FnOnce() -> T) -> T {
    let _unattended = port.unattended();
    act()
}

/// Drops a client, and waits until the system has noticed, while no one attends to the port.
///
/// The wait is needed because another test may be starting a process, which has a copy of the descriptor until it runs
/// its program.
fn close(port: &PtyPort, client: Client) {
    let notices = inotify::init(CreateFlags::CLOEXEC).unwrap();
    inotify::add_watch(&notices, port.path(), WatchFlags::CLOSE).unwrap();
    drop(client);
    poll(&mut [PollFd::new(&notices, PollFlags::IN)], Some(&Timespec::try_from(WAIT).unwrap())).unwrap();
}

/// What a client writes at the rig's speed.
fn data(bytes: &[u8]) -> PortEvent {
    PortEvent::Data { bytes: bytes.to_vec(), coding: LineCoding::at(RIG_BAUD) }
}

/// Runs `script` as a user who is not root, with the port's path as `$0`. None if this is not root's to do.
fn as_nobody(port: &PtyPort, script: &str) -> Option<bool> {
    if !geteuid().is_root() {
        return None;
    }
    chown(port.path(), Some(Uid::from_raw(NOBODY)), None::<Gid>).unwrap();
    let mut sh = Command::new("sh");
    sh.arg("-c").arg(script).arg(port.path()).uid(NOBODY).gid(NOBODY).current_dir("/").stderr(Stdio::null());
    Some(sh.status().unwrap().success())
}

// --- a fresh port ---------------------------------------------------------------------------------------------------

#[tokio::test]
async fn fresh_port_has_the_rigs_settings_and_is_the_users_alone() {
    let bench = Bench::new();
    let device = files::metadata(bench.port.path()).unwrap();
    assert!(device.file_type().is_char_device());
    assert_eq!((device.mode() & 0o777, device.uid()), (0o600, geteuid().as_raw()));
    assert_eq!(files::read_link(bench.port.link()).unwrap(), bench.port.path());
    assert_eq!(bench.port.settings().unwrap(), LineSettings { coding: LineCoding::at(RIG_BAUD), ixon: false });

    let termios = termios::tcgetattr(&Client::open(bench.port.path()).0).unwrap();
    assert_eq!(termios.control_modes & (ControlModes::CSIZE | ControlModes::CSTOPB), ControlModes::CS8);
    assert!(!termios.local_modes.intersects(LocalModes::ECHO | LocalModes::ICANON | LocalModes::ISIG));
    assert_eq!(termios.output_modes & OutputModes::OPOST, OutputModes::empty());
}

#[tokio::test]
async fn reply_before_the_client_sets_anything_is_not_echoed() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    bench.reply(b"ok\n\x03");
    assert_eq!(client.read(4), b"ok\n\x03");
    client.write(b"x").unwrap();
    assert_eq!(bench.data(1).await, b"x");
    assert!(bench.is_quiet(4096));
}

#[tokio::test]
async fn serial_crate_talks_through_the_link() {
    let mut bench = Bench::new();
    let path = bench.port.link().to_str().unwrap();
    let mut client = tokio_serial::new(path, 250_000).open_native_async().unwrap();
    assert_eq!(bench.event().await, PortEvent::Opened);
    assert_eq!(bench.port.settings().unwrap(), LineSettings { coding: LineCoding::at(250_000), ixon: false });
    client.write_all(b"M114\n").await.unwrap();
    assert_eq!(bench.data_until_flush_or(5).await, b"M114\n");
    bench.reply(b"ok\n");
    let mut answer = [0; 3];
    within(client.read_exact(&mut answer)).await.unwrap();
    assert_eq!(&answer, b"ok\n");
    client.clear(tokio_serial::ClearBuffer::Output).unwrap();
    assert_eq!(bench.event().await, PortEvent::Flushed);
    drop(client);
    assert_eq!(bench.event().await, PortEvent::Closed);
}

impl Bench {
    /// Like `data`, for clients that flush as they open.
    async fn data_until_flush_or(&mut self, length: usize) -> Vec<u8> {
        loop {
            match self.event().await {
                PortEvent::Flushed => {}
                PortEvent::Data { mut bytes, .. } => {
                    if bytes.len() < length {
                        bytes.extend(self.data(length - bytes.len()).await);
                    }
                    return bytes;
                }
                other => panic!("{other:?} instead of data"),
            }
        }
    }
}

// --- what the client chooses ----------------------------------------------------------------------------------------

#[tokio::test]
async fn settings_follow_the_client_at_any_speed() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    for baud in [9_600, 250_000, 123_457, 3_000_000] {
        client.set(|termios| termios.set_speed(baud).unwrap());
        assert_eq!(bench.port.settings().unwrap(), LineSettings { coding: LineCoding::at(baud), ixon: false });
    }
    client.set_ixon();
    assert_eq!(bench.port.settings().unwrap(), LineSettings { coding: LineCoding::at(3_000_000), ixon: true });
    assert_eq!(within(bench.port.event(0, None)).await.unwrap(), PortEvent::Set);
    assert!(bench.is_quiet(4096));
}

#[tokio::test]
async fn odd_rig_speed_is_kept_and_no_speed_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let place = || LinkPath::Chosen(folder.path().join("pc"));
    let port = PtyPort::open(place(), 83_333).unwrap();
    assert_eq!(port.settings().unwrap().coding.baud, 83_333);
    drop(port);
    let error = PtyPort::open(place(), 0).unwrap_err().to_string();
    assert_eq!(error, "cannot run the port at 0 baud: a speed from 1 to 4294967295 was expected");
    assert!(PtyPort::open(place(), u32::MAX).is_ok());
}

#[tokio::test]
async fn parity_and_modem_lines_are_not_carried() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    client.set(|termios| {
        termios.control_modes.remove(ControlModes::CSIZE);
        termios.control_modes.insert(ControlModes::PARENB | ControlModes::CS7);
    });
    let modes = termios::tcgetattr(&client.0).unwrap().control_modes;
    assert_eq!(modes & (ControlModes::CSIZE | ControlModes::PARENB), ControlModes::CS8);
    termios::tcsendbreak(&client.0).unwrap();
    assert!(bench.is_quiet(4096));
    let path = bench.port.path().to_str().unwrap();
    let mut with_lines = tokio_serial::new(path, 9_600).open_native_async().unwrap();
    assert!(with_lines.write_request_to_send(true).is_err());
}

// --- flow control ---------------------------------------------------------------------------------------------------

#[tokio::test]
async fn xoff_stops_the_next_write_and_xon_resumes_it() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    client.set_ixon();
    client.write(b"before").unwrap();
    bench.reply(&[XOFF, b'!']);
    assert_eq!(client.read(1), b"!");
    assert_eq!(client.write(b"stopped"), Err(Errno::AGAIN));
    assert_eq!(bench.data(6).await, b"before", "what was written stays readable");
    bench.reply(&[XON, b'?']);
    assert_eq!(client.read(1), b"?");
    assert_eq!(client.write(b"after"), Ok(5));
    assert_eq!(bench.data(5).await, b"after");
}

#[tokio::test]
async fn xoff_is_a_byte_like_any_other_without_ixon() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    bench.reply(&[XOFF, XON]);
    assert_eq!(client.read(2), [XOFF, XON]);
    assert_eq!(client.write(b"on"), Ok(2));
}

#[tokio::test]
async fn unwanted_data_stay_in_the_kernel_and_block_the_client() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    let mut taken = 0;
    for _ in 0..1000 {
        // As bytes move on inside the kernel there is room for a few more, but not without end.
        taken += client.fill(b'a');
        assert!(bench.is_quiet(0));
    }
    assert!((4_096..65_536).contains(&taken), "{taken} bytes were taken");
    assert_eq!(bench.event_up_to(16).await, data(&[b'a'; 16]));
    assert!(bench.is_quiet(0));
    let rest = bench.data(taken - 16).await;
    assert_eq!(rest.len(), taken - 16);
    assert_eq!(client.write(b"b"), Ok(1));
}

#[tokio::test]
async fn replies_that_the_client_does_not_read_are_counted_as_lost() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    let mut lost = 0;
    let mut written = 0;
    while lost == 0 {
        lost = bench.port.write(&[b'r'; 1000]);
        written += 1000 - lost;
        assert!(written < 1_000_000, "no end to what the kernel holds");
    }
    assert!(lost <= 1000);
    assert_eq!(client.read(written).len(), written);
    assert!(!client.readable(Duration::ZERO));
}

#[tokio::test]
async fn flush_by_the_client_is_told_and_empties_what_was_unread() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    client.write(&[b'o'; 3000]).unwrap();
    assert_eq!(bench.event_up_to(1).await, data(b"o"));
    bench.arrived(2999).await;
    assert!(bench.is_quiet(0));
    termios::tcflush(&client.0, QueueSelector::OFlush).unwrap();
    client.write(b"new").unwrap();
    assert_eq!(bench.event_up_to(0).await, PortEvent::Flushed);
    assert_eq!(bench.data(3).await, b"new");
    assert!(bench.is_quiet(4096));
}

#[tokio::test]
async fn flush_of_a_full_buffer_leaves_nothing_and_ends_the_wait_for_room() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    client.fill(b'o');
    bench.arrived(4095).await;
    assert!(bench.is_quiet(0));
    termios::tcflush(&client.0, QueueSelector::IOFlush).unwrap();
    assert_eq!(bench.event_up_to(0).await, PortEvent::Flushed);
    assert!(bench.is_quiet(4096), "old bytes survived the flush");
    assert_eq!(client.write(b"new"), Ok(3));
    assert_eq!(bench.data(3).await, b"new");
}

#[tokio::test]
async fn flush_of_the_clients_input_is_no_event() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    bench.reply(b"old");
    assert!(client.readable(WAIT));
    termios::tcflush(&client.0, QueueSelector::IFlush).unwrap();
    assert!(!client.readable(Duration::ZERO));
    assert!(bench.is_quiet(4096));
}

// --- clients come and go --------------------------------------------------------------------------------------------

#[tokio::test]
async fn port_without_clients_neither_fails_nor_spins() {
    let mut bench = Bench::new();
    assert!(bench.is_quiet(4096));
    for _ in 0..3 {
        drop(bench.client().await);
        assert_eq!(bench.event().await, PortEvent::Closed);
        assert!(bench.is_quiet(4096));
        assert_eq!(bench.poll_master(), PollFlags::empty(), "no hang-up that would wake a reader for ever");
    }
}

#[tokio::test]
async fn last_close_is_told_and_only_the_last() {
    let mut bench = Bench::new();
    // Both open unnoticed, then both close unnoticed: equal notices that inotify would merge.
    let open = || Client::open(bench.port.path());
    let (first, second) = unnoticed(&bench.port, || (open(), open()));
    assert_eq!(bench.event().await, PortEvent::Opened);
    drop(first);
    assert!(bench.is_quiet(4096));
    bench.reply(b"still there");
    assert_eq!(second.read(11), b"still there");
    let third = Client::open(bench.port.path());
    assert!(bench.is_quiet(4096));
    unnoticed(&bench.port, || drop((second, third)));
    assert_eq!(bench.event().await, PortEvent::Closed);
    assert!(bench.is_quiet(4096));
}

#[tokio::test]
async fn duplicates_of_a_descriptor_count_as_one_client() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    let copy = client.0.try_clone().unwrap();
    drop(client);
    assert!(bench.is_quiet(4096));
    drop(copy);
    assert_eq!(bench.event().await, PortEvent::Closed);
}

#[tokio::test]
async fn write_then_close_loses_nothing() {
    let mut bench = Bench::new();
    for size in [1_usize, 4_095, 4_096, 20_000] {
        let sent: Vec<u8> = (0..size).map(|index| u8::try_from(index % 251).unwrap()).collect();
        let client = Client::open(bench.port.path());
        let taken = client.write(&sent).unwrap();
        assert!(taken == size || taken > 4_096, "{taken} of {size} bytes were taken");
        drop(client);
        assert_eq!(bench.event().await, PortEvent::Opened);
        assert_eq!(bench.event().await, PortEvent::Closed);
        assert!(bench.is_quiet(0));
        assert_eq!(bench.data(taken).await, sent[..taken]);
        assert!(bench.is_quiet(4096));
    }
}

#[tokio::test]
async fn shell_redirection_loses_nothing() {
    let mut bench = Bench::new();
    let status = Command::new("sh").arg("-c").arg("printf 'G28\\n' > \"$0\"").arg(bench.port.link()).status();
    assert!(status.unwrap().success());
    assert_eq!(bench.event().await, PortEvent::Opened);
    assert_eq!(bench.event().await, PortEvent::Closed);
    assert_eq!(bench.data(4).await, b"G28\n");
}

#[tokio::test]
async fn next_client_that_comes_at_once_gets_through() {
    let mut bench = Bench::new();
    let first = Client::open(bench.port.path());
    first.write(b"one").unwrap();
    let second = unnoticed(&bench.port, || {
        close(&bench.port, first);
        let second = Client::open(bench.port.path());
        second.set(|termios| termios.set_speed(19_200).unwrap());
        second.write(b"two").unwrap();
        second
    });
    for expected in [PortEvent::Opened, PortEvent::Closed, PortEvent::Opened] {
        assert_eq!(bench.event().await, expected);
    }
    assert_eq!(bench.data(6).await, b"onetwo");
    assert_eq!(bench.port.settings().unwrap().coding.baud, 19_200, "the reset spares whoever is there");
    bench.reply(b"ok");
    assert_eq!(second.read(2), b"ok");
}

#[tokio::test]
async fn what_a_client_has_left_is_told_apart_from_what_the_next_one_writes() {
    let mut bench = Bench::new();
    for forget in [false, true] {
        let old = bench.client().await;
        old.write(b"old").unwrap();
        assert_eq!(within(bench.port.event(0, None)).await.unwrap(), PortEvent::Began);
        bench.arrived(3).await;
        drop(old);
        assert_eq!(bench.event_up_to(0).await, PortEvent::Closed);
        assert!(bench.is_quiet(0));
        let new = Client::open(bench.port.link());
        assert_eq!(bench.event_up_to(0).await, PortEvent::Opened);
        assert_eq!(bench.event_up_to(2).await, data(b"ol"));
        new.write(b"new").unwrap();
        assert_eq!(within(bench.port.event(0, None)).await.unwrap(), PortEvent::Began, "even if no data are wanted");
        if forget {
            assert_eq!(bench.port.forget_leftover(), 1);
        } else {
            assert_eq!(bench.event().await, data(b"d"));
        }
        assert_eq!(bench.event().await, data(b"new"));
        drop(new);
        assert_eq!(bench.event().await, PortEvent::Closed);
    }
}

#[tokio::test]
async fn old_replies_do_not_reach_the_next_client() {
    let mut bench = Bench::new();
    let first = bench.client().await;
    bench.reply(&[b'o'; 6000]);
    drop(first);
    assert_eq!(bench.port.write(b"for no one"), 0);
    assert_eq!(bench.event().await, PortEvent::Closed);
    assert_eq!(bench.port.write(b"for no one"), 0);
    let second = bench.client().await;
    assert!(!second.readable(Duration::ZERO));
    bench.reply(b"new");
    assert_eq!(second.read(3), b"new");
}

#[tokio::test]
async fn what_comes_before_the_rig_knows_a_client_is_not_for_this_one() {
    let mut bench = Bench::new();
    drop(bench.client().await);
    assert_eq!(bench.event().await, PortEvent::Closed);
    let next = Client::open(bench.port.path());
    bench.reply(b"old");
    assert_eq!(bench.event().await, PortEvent::Opened);
    bench.reply(b"new");
    assert_eq!(next.read(3), b"new");
}

#[tokio::test]
async fn settings_outlive_the_client() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    client.set_ixon();
    client.set(|termios| {
        termios.set_speed(1_200).unwrap();
        termios.local_modes.insert(LocalModes::ECHO | LocalModes::ICANON);
    });
    client.write(b"slow").unwrap();
    unnoticed(&bench.port, || close(&bench.port, client));
    assert_eq!(bench.event().await, PortEvent::Closed);
    assert_eq!(bench.port.settings().unwrap(), LineSettings { coding: LineCoding::at(1_200), ixon: true });
    let slow = PortEvent::Data { bytes: b"slow".to_vec(), coding: LineCoding::at(1_200) };
    assert_eq!(bench.event().await, slow);
    assert_eq!(bench.port.settings().unwrap(), LineSettings { coding: LineCoding::at(1_200), ixon: true });
    let next = termios::tcgetattr(&bench.client().await.0).unwrap();
    assert!(next.local_modes.contains(LocalModes::ECHO | LocalModes::ICANON));
}

#[tokio::test]
async fn stopped_output_is_restarted_for_the_next_client() {
    let mut bench = Bench::new();
    let by_tcflow: fn(&mut Bench, &Client) = |_, client| termios::tcflow(&client.0, Action::OOff).unwrap();
    let by_xoff: fn(&mut Bench, &Client) = |bench, client| {
        client.set_ixon();
        bench.reply(&[XOFF, b'!']);
        assert_eq!(client.read(1), b"!");
    };
    for stop in [by_tcflow, by_xoff] {
        let client = bench.client().await;
        stop(&mut bench, &client);
        assert_eq!(client.write(b"x"), Err(Errno::AGAIN));
        drop(client);
        assert_eq!(bench.event().await, PortEvent::Closed);
        let next = bench.client().await;
        assert_eq!(next.write(b"x"), Ok(1));
        assert_eq!(bench.data(1).await, b"x");
        drop(next);
        assert_eq!(bench.event().await, PortEvent::Closed);
    }
}

#[tokio::test]
async fn stopped_output_is_restarted_even_if_the_next_client_is_there_already() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    client.set_ixon();
    bench.reply(&[XOFF, b'!']);
    assert_eq!(client.read(1), b"!");
    let next = unnoticed(&bench.port, || {
        close(&bench.port, client);
        let next = Client::open(bench.port.path());
        assert_eq!(next.write(b"x"), Err(Errno::AGAIN));
        next
    });
    assert_eq!(bench.event().await, PortEvent::Closed);
    assert_eq!(bench.event().await, PortEvent::Opened);
    assert_eq!(next.write(b"x"), Ok(1));
    assert_eq!(bench.data(1).await, b"x");
}

#[tokio::test]
async fn exclusive_mode_ends_with_its_client() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    termios::ioctl_tiocexcl(&client.0).unwrap();
    let Some(opened) = as_nobody(&bench.port, "exec 3<>\"$0\"") else {
        eprintln!("skipped: only root can open the port as another user, and root is not kept out by exclusive mode");
        return;
    };
    assert!(!opened, "exclusive mode keeps others out while its client is there");
    drop(client);
    assert_eq!(bench.event().await, PortEvent::Closed);
    // For as long as it takes to be noticed, if another test starts a process meanwhile: see `clients.rs`.
    assert_eq!(as_nobody(&bench.port, "exec 3<>\"$0\"; sleep 0.05"), Some(true));
    assert_eq!(bench.event().await, PortEvent::Opened);
    assert_eq!(bench.event().await, PortEvent::Closed);
}

/// The rig may be busy: no one asks the port for events.
#[tokio::test]
async fn exclusive_mode_ends_with_its_client_even_if_the_rig_does_not_look() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    termios::ioctl_tiocexcl(&client.0).unwrap();
    drop(client);
    if geteuid().is_root() {
        eventually(|| as_nobody(&bench.port, "exec 3<>\"$0\"") == Some(true)).await;
    } else {
        eventually(|| open(bench.port.path(), OFlags::RDWR | OFlags::NOCTTY, Mode::empty()).is_ok()).await;
    }
}

#[tokio::test]
async fn lost_notices_cost_a_recount() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    let limit: usize = files::read_to_string("/proc/sys/fs/inotify/max_queued_events").unwrap().trim().parse().unwrap();
    let path = bench.port.path().to_owned();
    // An open and a close give two notices that are not equal.
    unnoticed(&bench.port, || (0..=limit / 2).for_each(|_| drop(Client::open(&path))));
    client.write(b"here").unwrap();
    assert_eq!(bench.data_after_any_change(4).await, b"here");
    bench.reply(b"ok");
    assert_eq!(client.read(2), b"ok");
    while !bench.is_quiet(4096) {
        tokio::task::yield_now().await;
    }
    drop(client);
    assert_eq!(bench.event().await, PortEvent::Closed);
}

impl Bench {
    /// Like `data`, whoever has opened and closed the port before.
    async fn data_after_any_change(&mut self, length: usize) -> Vec<u8> {
        loop {
            match self.event().await {
                PortEvent::Opened | PortEvent::Closed => {}
                PortEvent::Data { mut bytes, .. } => {
                    if bytes.len() < length {
                        bytes.extend(self.data(length - bytes.len()).await);
                    }
                    return bytes;
                }
                other => panic!("{other:?} instead of data"),
            }
        }
    }
}

#[tokio::test]
async fn dropped_port_hangs_up_and_takes_its_link_along() {
    let mut bench = Bench::new();
    let client = bench.client().await;
    let link = bench.port.link().to_owned();
    let Bench { port, folder } = bench;
    drop(port);
    assert!(files::symlink_metadata(&link).is_err());
    eventually(|| client.write(b"x") == Err(Errno::IO)).await;
    drop(folder);
}

// --- links ----------------------------------------------------------------------------------------------------------

#[tokio::test]
async fn chosen_link_must_be_free_and_in_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let at = |path: PathBuf| PtyPort::open(LinkPath::Chosen(path), RIG_BAUD).unwrap_err().to_string();
    let taken = folder.path().join("taken");
    symlink("/nowhere", &taken).unwrap();
    assert_eq!(
        at(taken.clone()),
        format!("{} already exists: remove it or choose another with --link", taken.display())
    );
    assert!(files::symlink_metadata(&taken).is_ok(), "it is left alone");
    let missing = folder.path().join("missing");
    let error = at(missing.join("pc"));
    assert!(error.starts_with(&format!("cannot put a link into the folder {}: ", missing.display())), "{error}");
    assert!(error.ends_with("; create it, or choose another with --link"), "{error}");
}

#[tokio::test]
async fn link_that_leads_elsewhere_by_now_is_left_alone() {
    let bench = Bench::new();
    let link = bench.port.link().to_owned();
    files::remove_file(&link).unwrap();
    symlink("/dev/null", &link).unwrap();
    drop(bench.port);
    assert_eq!(files::read_link(&link).unwrap(), Path::new("/dev/null"));
}

#[test]
fn default_link_replaces_a_dead_harness_but_not_a_live_one() {
    let runtime = tempfile::tempdir().unwrap();
    let folder = runtime.path().join("torno");
    let target = Path::new("/dev/pts/some");
    let live = Link::of_rig(&folder, "lathe", "pc", target).unwrap();
    assert_eq!(live.path(), folder.join("lathe-pc"));
    assert_eq!(files::metadata(&folder).unwrap().mode() & 0o777, 0o700);
    let error = Link::of_rig(&folder, "lathe", "pc", target).unwrap_err().to_string();
    let link = folder.join("lathe-pc");
    let expected = format!("a rig 'lathe' is already up at {}: choose another link with --link", link.display());
    assert_eq!(error, expected);
    let other = Link::of_rig(&folder, "mill", "pc", target).unwrap();
    drop((live, other));
    assert!(files::symlink_metadata(&link).is_err());

    // A killed harness leaves its link, and a lock file that no one has locked.
    symlink("/dev/pts/gone", &link).unwrap();
    let next = Link::of_rig(&folder, "lathe", "pc", target).unwrap();
    assert_eq!(files::read_link(next.path()).unwrap(), target);
    drop(next);

    File::create(&link).unwrap();
    assert!(matches!(Link::of_rig(&folder, "lathe", "pc", target), Err(PortError::Exists { path }) if path == link));
    assert!(matches!(Link::of_rig(&folder, "a/b", "pc", target), Err(PortError::RigName { .. })));
}

#[test]
fn default_folder_must_be_private() {
    let runtime = tempfile::tempdir().unwrap();
    let target = Path::new("/dev/pts/some");
    let refusal = |folder: &Path| Link::of_rig(folder, "lathe", "pc", target).unwrap_err().to_string();

    let open = runtime.path().join("open");
    files::create_dir(&open).unwrap();
    for mode in [0o750, 0o701, 0o777] {
        files::set_permissions(&open, Permissions::from_mode(mode)).unwrap();
        let problem = "others have access to it: remove it, or choose a link with --link";
        assert_eq!(refusal(&open), format!("folder {} must be yours alone (mode 0700), but {problem}", open.display()));
    }
    files::set_permissions(&open, Permissions::from_mode(0o700)).unwrap();
    let elsewhere = runtime.path().join("elsewhere");
    symlink(&open, &elsewhere).unwrap();
    assert!(refusal(&elsewhere).contains("it is a link or a file"));
    if geteuid().is_root() {
        chown(&open, Some(Uid::from_raw(NOBODY)), None::<Gid>).unwrap();
        assert!(refusal(&open).contains("it belongs to another user"));
    } else {
        eprintln!("not checked: only root can make a folder that belongs to another user");
    }
    assert!(refusal(&runtime.path().join("no/folder")).starts_with("cannot put a link into the folder"));
}

#[test]
fn errors_are_io_errors_of_the_system_with_advice() {
    let error = PortError::watch(io::Error::from_raw_os_error(24)).to_string();
    assert!(error.starts_with("cannot watch who opens the port: Too many open files"), "{error}");
    assert!(error.ends_with("see /proc/sys/fs/inotify and the limit of open files (ulimit -n)"), "{error}");
}
