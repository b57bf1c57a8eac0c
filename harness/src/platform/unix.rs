use std::fs::{OpenOptions, Permissions};
use std::future::poll_fn;
use std::io::{self, IsTerminal, Write};
use std::os::fd::AsFd;
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::Path;
use std::task::Poll;

use rustix::event::{PollFd, PollFlags};
use rustix::fs::{FileType, OFlags, Stat};
use rustix::io::Errno;
use rustix::process::Signal as Signals;
use tokio::signal::unix::{Signal, SignalKind, signal};

/// A new file is for its owner.
const OWNERS: u32 = 0o600;

/// What ends a command, in order.
const ENDING: [Signals; 7] =
    [Signals::INT, Signals::TERM, Signals::HUP, Signals::QUIT, Signals::USR1, Signals::USR2, Signals::ALARM];

/// The signals by which a person or a service manager ends a command: all that end a program which knows none of them,
/// and can be caught. One that is ignored from the start, as by `nohup`, stays so.
pub struct Interrupt {
    signals: Vec<Signal>,
}

impl Interrupt {
    /// Listens from here on.
    ///
    /// # Errors
    /// If the system refuses.
    ///
    /// # Panics
    /// Outside a tokio runtime with I/O enabled.
    pub fn listen() -> io::Result<Self> {
        let ignored = ignored_signals();
        let asks = |kind: &Signals| *kind != Signals::HUP || ignored >> (kind.as_raw() - 1) & 1 == 0;
        let signals = ENDING.iter().filter(|kind| asks(kind)).map(|kind| signal(SignalKind::from_raw(kind.as_raw())));
        Ok(Self { signals: signals.collect::<io::Result<_>>()? })
    }

    /// Waits for one.
    pub async fn received(&mut self) {
        poll_fn(|context| {
            let ready = self.signals.iter_mut().any(|signal| signal.poll_recv(context).is_ready());
            if ready { Poll::Ready(()) } else { Poll::Pending }
        })
        .await;
    }
}

/// A bit for each signal that is ignored since before this program began. Only Linux tells.
fn ignored_signals() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or_default()
}

/// While there is one, whoever writes beyond the limit of a file's size gets an error, and not a signal that kills.
pub struct FileLimit(#[expect(dead_code, reason = "it is there for as long as it is held")] Signal);

impl FileLimit {
    /// Makes it so.
    ///
    /// # Errors
    /// If the system refuses.
    ///
    /// # Panics
    /// Outside a tokio runtime with I/O enabled.
    pub fn is_an_error() -> io::Result<Self> {
        signal(SignalKind::from_raw(Signals::XFSZ.as_raw())).map(Self)
    }
}

/// Looks whether the limit of open files leaves room for so many more.
///
/// # Errors
/// If it does not.
pub fn has_room_for_files(files: usize) -> io::Result<()> {
    let dup = |_| io::stderr().as_fd().try_clone_to_owned();
    (0..files).map(dup).collect::<Result<Vec<_>, _>>().map(drop)
}

/// Has new files made for their owner alone.
pub(crate) fn owner_only(options: &mut OpenOptions) -> &mut OpenOptions {
    options.mode(OWNERS)
}

/// The permissions of a file that is for its owner, where files have such.
pub(crate) fn owners_permissions() -> Option<Permissions> {
    Some(Permissions::from_mode(OWNERS))
}

/// Removes a file that is still open. Its name is free at once.
pub(crate) fn remove_open_file(path: &Path) -> io::Result<()> {
    std::fs::remove_file(path)
}

/// It can be opened, and is no terminal.
pub(crate) fn is_no_terminal(path: &Path) -> bool {
    // Who opens a pipe would otherwise wait for its other end.
    let waits_for_nothing = OFlags::NONBLOCK.bits() as i32;
    let opened = OpenOptions::new().read(true).custom_flags(waits_for_nothing).open(path);
    opened.is_ok_and(|file| !file.is_terminal())
}

/// Whether standard error is a file, which takes all at once.
pub(crate) fn stderr_is_file() -> bool {
    let is_file = |stat: Stat| FileType::from_raw_mode(stat.st_mode).is_file();
    rustix::fs::fstat(rustix::stdio::stderr()).is_ok_and(is_file)
}

/// The file itself, without the lock of the standard library's: who holds that while no one reads holds up all others.
pub(crate) struct Stderr;

impl Write for Stderr {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let stderr = rustix::stdio::stderr();
        loop {
            match rustix::io::write(stderr, bytes) {
                // Somebody else has made it so.
                Err(Errno::AGAIN) => {
                    rustix::event::poll(&mut [PollFd::new(&stderr, PollFlags::OUT)], None)?;
                }
                Err(Errno::INTR) => {}
                written => return Ok(written?),
            }
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
