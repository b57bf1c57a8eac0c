//! The pair itself: its master side in packet mode, and one slave descriptor kept open.

use std::ffi::{OsStr, c_int};
use std::io;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

use rustix::fd::{AsFd, OwnedFd};
use rustix::fs::{self, Gid, Mode, OFlags, Uid};
use rustix::io::{Errno, ioctl_fionbio, ioctl_fionread, retry_on_intr};
use rustix::ioctl::{Opcode, Setter, ioctl};
use rustix::process::geteuid;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{
    self, Action, ControlModes, InputModes, OptionalActions, QueueSelector, Termios, ioctl_tiocnxcl,
};
use tokio::io::unix::AsyncFd;

use super::PortError;
use crate::ready::readable;

/// Bytes of one read: what the kernel's line discipline holds, and the status byte.
const READ_MAX: usize = 4096 + 1;

/// Status byte of a read in packet mode: data follow (`TIOCPKT_DATA` in `asm-generic/ioctls.h`).
const STATUS_DATA: u8 = 0;
/// Status bit: the client has flushed its output (`TIOCPKT_FLUSHWRITE`).
const STATUS_FLUSHED_OUTPUT: u8 = 1 << 1;
/// Status bits: the client has turned XON/XOFF off or on (`TIOCPKT_NOSTOP`, `TIOCPKT_DOSTOP`).
const STATUS_FLOW_CONTROL: u8 = 1 << 4 | 1 << 5;

/// What the client has set its end of the line to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineSettings {
    /// Speed at which the client sends, in baud; any number, not only the standard ones. 0 (`B0`) is a line hung up.
    pub baud: u32,
    /// Whether XOFF and XON stop and restart the client's writes.
    pub ixon: bool,
}

/// What the master side had to say.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Look {
    /// Nothing.
    Nothing,
    /// There are bytes, but none was wanted.
    Unwanted,
    /// The client's bytes.
    Data(Vec<u8>),
    /// The client has flushed its output. What it had written and was still here is gone.
    Flushed,
    /// The client has turned XON/XOFF on or off.
    FlowControl,
}

#[derive(Debug)]
pub(super) struct Pty {
    master: AsyncFd<OwnedFd>,
    /// Kept open so that the master never sees a hang-up, and to act on the client's side of the tty.
    slave: OwnedFd,
    path: PathBuf,
    buffer: Box<[u8]>,
    /// Bytes that were in the master's line discipline at the last look, before which no flush went unnoticed.
    backlog: usize,
}

impl Pty {
    /// Not made by `tokio_serial::SerialStream::pair`: that leaves both descriptors inheritable, so that a board's
    /// process would keep the port alive, and it has neither packet mode nor a view of the client's settings.
    pub(super) fn open(baud: u32) -> Result<Pty, PortError> {
        let step = PortError::pty;
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let master = openpt(flags).map_err(step("open /dev/ptmx for a new pty"))?;
        grantpt(&master).and_then(|()| unlockpt(&master)).map_err(step("unlock the new pty"))?;
        let name = ptsname(&master, Vec::new()).map_err(step("learn the name of the new pty"))?;
        let path = PathBuf::from(OsStr::from_bytes(name.as_bytes()));
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC | OFlags::NONBLOCK;
        let slave = fs::open(&path, flags, Mode::empty()).map_err(step("open the new pty's slave side"))?;
        make_private(&slave).map_err(step("make the new pty the user's alone"))?;
        let set = set_line(&slave, baud).map_err(step("set the new pty's speed"))?;
        if baud == 0 || set.output_speed() != baud {
            return Err(PortError::Baud { baud });
        }
        packet_mode(&master)
            .and_then(|()| ioctl_fionbio(&master, true))
            .map_err(step("put the new pty into packet mode"))?;
        let master = readable(master).map_err(PortError::watch)?;
        Ok(Pty { master, slave, path, buffer: vec![0; READ_MAX].into(), backlog: 0 })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    #[cfg(test)]
    pub(super) fn master(&self) -> rustix::fd::BorrowedFd<'_> {
        self.master.get_ref().as_fd()
    }

    /// The client's present settings: on the master side, Linux tells those of the slave side.
    pub(super) fn settings(&self) -> io::Result<LineSettings> {
        let termios = termios::tcgetattr(self.master.get_ref())?;
        Ok(LineSettings { baud: termios.output_speed(), ixon: termios.input_modes.contains(InputModes::IXON) })
    }

    /// Takes what is there, at most `max` bytes of data.
    pub(super) fn look(&mut self, max: usize) -> io::Result<Look> {
        loop {
            // Before the read: a flush that the read does not tell of comes after these bytes.
            let held = usize::try_from(ioctl_fionread(self.master.get_ref())?).unwrap_or(0);
            let Some((status, data)) = self.read(max)? else {
                self.backlog = 0;
                return Ok(Look::Nothing);
            };
            if status == STATUS_DATA {
                self.backlog = held.saturating_sub(data.len());
                return Ok(if max == 0 { Look::Unwanted } else { Look::Data(data) });
            }
            if status & STATUS_FLUSHED_OUTPUT != 0 {
                self.discard_backlog()?;
                return Ok(Look::Flushed);
            }
            if status & STATUS_FLOW_CONTROL != 0 {
                return Ok(Look::FlowControl);
            }
            // What is left tells of flushed input and of stopped and restarted output: nothing to us.
        }
    }

    /// Drops what the client has flushed: the kernel empties its queue, but not what had reached the master's line
    /// discipline (up to 4095 bytes). Bytes first seen along with the flush may be newer than it, and stay.
    fn discard_backlog(&mut self) -> io::Result<()> {
        while self.backlog > 0 {
            let Some((_, data)) = self.read(self.backlog)? else { break };
            self.backlog -= data.len();
        }
        self.backlog = 0;
        Ok(())
    }

    /// One read: its status byte, and at most `max` bytes. A read of no data still tells a status, or that there are
    /// bytes.
    fn read(&mut self, max: usize) -> io::Result<Option<(u8, Vec<u8>)>> {
        let room = max.saturating_add(1).min(READ_MAX);
        match retry_on_intr(|| rustix::io::read(self.master.get_ref(), &mut self.buffer[..room])) {
            Ok(length) => {
                let read = self.buffer[..length].split_first();
                Ok(read.map(|(&status, data)| (status, data.to_vec())))
            }
            Err(Errno::AGAIN) => Ok(None),
            Err(errno) => Err(errno.into()),
        }
    }

    /// Waits until [`look`](Pty::look) may find something new.
    pub(super) async fn ready(&self) -> io::Result<()> {
        self.master.readable().await?.clear_ready();
        Ok(())
    }

    /// Writes towards the client without waiting. Returns how many bytes went.
    pub(super) fn write(&self, bytes: &[u8]) -> usize {
        let mut written = 0;
        while written < bytes.len() {
            match retry_on_intr(|| rustix::io::write(self.master.get_ref(), &bytes[written..])) {
                Ok(0) | Err(_) => break,
                Ok(length) => written += length,
            }
        }
        written
    }

    /// Undoes what the last client may have left: replies that it did not read, and stopped output.
    pub(super) fn forget_replies_and_restart(&self) -> io::Result<()> {
        termios::tcflush(&self.slave, QueueSelector::IFlush)?;
        // Off and on: on its own, TCOON does not undo a stop by XOFF.
        termios::tcflow(&self.slave, Action::OOff)?;
        termios::tcflow(&self.slave, Action::OOn)?;
        Ok(())
    }

    /// Lets anyone who may, open the port, whatever the last client had asked for.
    pub(super) fn clear_exclusive(&self) -> io::Result<()> {
        Ok(ioctl_tiocnxcl(&self.slave)?)
    }
}

/// The current user's, mode 0600: a mount option of devpts may say otherwise.
fn make_private(slave: &OwnedFd) -> rustix::io::Result<()> {
    let user = geteuid();
    if Uid::from_raw(fs::fstat(slave)?.st_uid) != user {
        fs::fchown(slave, Some(user), None::<Gid>)?;
    }
    fs::fchmod(slave, Mode::RUSR | Mode::WUSR)
}

/// Raw and 8N1 at `baud`. Returns what the kernel made of it.
fn set_line(slave: &OwnedFd, baud: u32) -> rustix::io::Result<Termios> {
    let mut termios = termios::tcgetattr(slave)?;
    termios.make_raw();
    termios.input_modes.remove(InputModes::IXOFF | InputModes::IXANY);
    termios.control_modes.remove(ControlModes::CSIZE | ControlModes::PARENB | ControlModes::CSTOPB);
    termios.control_modes.remove(ControlModes::CRTSCTS);
    termios.control_modes.insert(ControlModes::CS8 | ControlModes::CREAD | ControlModes::CLOCAL);
    termios.set_speed(baud)?;
    termios::tcsetattr(slave, OptionalActions::Now, &termios)?;
    termios::tcgetattr(slave)
}

/// Makes reads on the master begin with a status byte. Not `EXTPROC`, which would tell of changed settings too: with
/// it the kernel no longer obeys XOFF.
#[allow(unsafe_code)]
fn packet_mode(master: impl AsFd) -> rustix::io::Result<()> {
    #[cfg(not(any(
        target_arch = "x86_64",
        target_arch = "x86",
        target_arch = "aarch64",
        target_arch = "arm",
        target_arch = "riscv64"
    )))]
    compile_error!("look up this machine's TIOCPKT: a few differ from asm-generic/ioctls.h");
    const TIOCPKT: Opcode = 0x5420;
    // SAFETY: TIOCPKT reads one int through its pointer, and changes no memory of ours.
    unsafe { ioctl(master, Setter::<TIOCPKT, c_int>::new(1)) }
}
