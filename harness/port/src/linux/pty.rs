//! The pair itself: its master side in packet mode, and one slave descriptor kept open.

use std::ffi::{OsStr, c_int};
use std::io;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::{AsFd, OwnedFd};
use rustix::fs::{self, Gid, Mode, OFlags, Uid};
use rustix::io::{Errno, ioctl_fionbio, ioctl_fionread, retry_on_intr};
use rustix::ioctl::{Getter, Opcode, Setter, ioctl};
use rustix::process::geteuid;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{
    self, Action, ControlModes, InputModes, OptionalActions, QueueSelector, Termios, ioctl_tiocexcl, ioctl_tiocnxcl,
};

use super::PortError;
use super::event::{LineCoding, LineSettings};
use super::order::{Mark, Order};

/// Bytes of one read: what the kernel's line discipline holds, and the status byte.
const READ_MAX: usize = 4096 + 1;

/// Status byte of a read in packet mode: data follow (`TIOCPKT_DATA` in `asm-generic/ioctls.h`).
const STATUS_DATA: u8 = 0;
/// Status bit: the client has flushed its output (`TIOCPKT_FLUSHWRITE`).
const STATUS_FLUSHED_OUTPUT: u8 = 1 << 1;

/// Something that the client has done.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum ClientAction {
    /// It has written these bytes, at this speed.
    Data(Vec<u8>, u32),
    /// It has flushed its output. What it had written before and was still here is gone.
    Flushed,
    /// It has set the line to another speed, or turned XON/XOFF on or off.
    Set,
}

#[derive(Debug)]
pub(super) struct Pty {
    master: [OwnedFd; 2],
    /// Kept open so that the master never sees a hang-up, and to act on the client's side of the tty. None if somebody
    /// took the port for itself just when it was let go.
    slave: Option<[OwnedFd; 2]>,
    path: PathBuf,
    buffer: Box<[u8]>,
    order: Order,
    /// What has happened since the last look.
    marks: Vec<Mark>,
    /// Whether some of it has been noted that no one has been told of.
    untold: bool,
    /// Whether that look has read anything.
    has_read: bool,
    /// Whether the last thing was that the client set the line.
    wakes: bool,
    /// What the line was set to at the last look.
    line: LineSettings,
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
        let slave = open_slave(&path).map_err(step("open the new pty's slave side"))?;
        make_private(&slave).map_err(step("make the new pty the user's alone"))?;
        let set = set_line(&slave, baud).map_err(step("set the new pty's speed"))?;
        if baud == 0 || set.output_speed() != baud {
            return Err(PortError::Baud { baud });
        }
        packet_mode(&master)
            .and_then(|()| ioctl_fionbio(&master, true))
            .map_err(step("put the new pty into packet mode"))?;
        let order = Order::new().map_err(|errno| PortError::watch(errno.into()))?;
        let master = twice(master).map_err(PortError::watch)?;
        let watched = || order.watch(&master[0], Mark::Arrived).and_then(|()| order.watch(&master[1], Mark::Told));
        watched().map_err(|errno| PortError::watch(errno.into()))?;
        let line = LineSettings { coding: LineCoding::at(baud), ixon: false };
        let (buffer, marks) = (vec![0; READ_MAX].into(), Vec::new());
        let (untold, has_read, wakes) = (false, false, false);
        let mut pty =
            Pty { master, slave: None, path, buffer, order, marks, untold, has_read, wakes, line, backlog: 0 };
        pty.attach(slave).map_err(PortError::watch)?;
        Ok(pty)
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn order(&self) -> &Order {
        &self.order
    }

    #[cfg(test)]
    pub(super) fn master(&self) -> rustix::fd::BorrowedFd<'_> {
        self.master[0].as_fd()
    }

    /// What the line was set to at the last [look](Pty::look).
    pub(super) fn line(&self) -> LineSettings {
        self.line
    }

    /// The client's present settings: on the master side, Linux tells those of the slave side.
    fn settings(&self) -> io::Result<LineSettings> {
        let termios = termios::tcgetattr(&self.master[0])?;
        let coding = LineCoding::at(termios.output_speed());
        Ok(LineSettings { coding, ixon: termios.input_modes.contains(InputModes::IXON) })
    }

    /// Notes in which order things have happened, for the next [look](Pty::look). Says whether there is anything.
    pub(super) fn note_order(&mut self) -> io::Result<bool> {
        let mut marks = self.order.take()?;
        let anything = marks.iter().any(|mark| *mark != Mark::Wrote) | core::mem::take(&mut self.untold);
        // After a look that has read something, this one tells nothing. If the client has written, its bytes set
        // another.
        if core::mem::take(&mut self.has_read) {
            marks.retain(|mark| *mark != Mark::Wrote);
        }
        // New settings set both marks, and this may have fallen in between.
        if core::mem::take(&mut self.wakes) && marks.first() == Some(&Mark::Wrote) {
            marks.remove(0);
        }
        self.wakes = marks.last() == Some(&Mark::Set);
        self.marks.extend(marks);
        Ok(anything)
    }

    /// Takes in what the client has done, with at most `room` bytes of data; but if it has set another speed, with all
    /// that it had written before, up to `most`.
    pub(super) fn look(&mut self, room: usize, most: usize) -> io::Result<Vec<ClientAction>> {
        let said = self.listen(room, most)?;
        self.marks.clear();
        Ok(said)
    }

    fn listen(&mut self, room: usize, most: usize) -> io::Result<Vec<ClientAction>> {
        let has_arrived = self.marks.contains(&Mark::Arrived);
        let (mut said, mut data) = (Vec::new(), Vec::new());
        let mut older = self.backlog;
        while let Some((status, bytes)) = self.read(room - data.len())? {
            if status == STATUS_DATA {
                if bytes.is_empty() {
                    break;
                }
                data.extend(bytes);
            } else if status & STATUS_FLUSHED_OUTPUT != 0 {
                self.discard_flushed(older.saturating_sub(data.len()))?;
                data.clear();
                older = 0;
                said.push(ClientAction::Flushed);
            }
            // What is left says that input was flushed, output stopped or restarted, or XON/XOFF turned on or off,
            // which the settings tell: nothing to us.
        }
        let line = self.settings()?;
        if line == self.line {
            if !data.is_empty() {
                said.push(ClientAction::Data(data, line.coding.baud));
            }
            return Ok(said);
        }
        let was = core::mem::replace(&mut self.line, line).coding.baud;
        if line.coding.baud != was {
            let (wrote, set) = self.places(Mark::Set)?;
            let wrote_first = wrote.zip(set).is_some_and(|(wrote, set)| wrote < set);
            // The kernel was full, and nothing has come since.
            let all_waited = older > 0 && !has_arrived;
            if wrote_first || all_waited {
                older = most;
            }
        }
        while line.coding.baud != was && data.len() < older.min(most) {
            match self.read(older.min(most) - data.len())? {
                Some((STATUS_DATA, bytes)) if !bytes.is_empty() => data.extend(bytes),
                Some((STATUS_DATA, _)) | None => break,
                // The next look cannot be told of a flush that this one has taken.
                Some((status, _)) if status & STATUS_FLUSHED_OUTPUT != 0 => {
                    self.discard_flushed(0)?;
                    data.clear();
                    said.push(ClientAction::Flushed);
                }
                Some(_) => {}
            }
        }
        let newer = data.split_off(older.min(data.len()));
        said.push(ClientAction::Set);
        said.extend([(data, was), (newer, line.coding.baud)].map(|(data, baud)| ClientAction::Data(data, baud)));
        said.retain(|said| !matches!(said, ClientAction::Data(data, _) if data.is_empty()));
        Ok(said)
    }

    /// The places of the first write and of something else among what has happened since the last look.
    fn places(&mut self, other: Mark) -> io::Result<(Option<usize>, Option<usize>)> {
        // It may have happened since the order was noted.
        let more = self.order.take()?;
        self.untold |= !more.is_empty();
        self.marks.extend(more);
        let place = |mark| self.marks.iter().position(|other| *other == mark);
        // A status wakes those that wait for bytes, too, after those that wait for it.
        let arrived = place(Mark::Arrived).filter(|at| place(Mark::Told).is_none_or(|told| *at < told));
        let wrote = [place(Mark::Wrote), arrived].into_iter().flatten().min();
        Ok((wrote, place(other)))
    }

    /// Drops what the client has flushed: the kernel empties its queue, but not what had reached the master's line
    /// discipline (up to 4095 bytes). If the client has written since it flushed, that is `older` bytes; otherwise all
    /// that is there. What it has written in between two looks both before and after the flush cannot be told apart.
    fn discard_flushed(&mut self, older: usize) -> io::Result<()> {
        // First, so that a write that comes after it is noted or not counted.
        let there = self.readable()?;
        let (wrote, flushed) = self.places(Mark::Told)?;
        // Not noted are a write between the last read and the note, and a flush whose status has been read already.
        let wrote_after = wrote.zip(flushed).is_some_and(|(wrote, flushed)| wrote > flushed);
        let mut left = if wrote_after { older.min(there) } else { there };
        while left > 0 {
            match self.read(left)? {
                Some((STATUS_DATA, data)) if data.is_empty() => break,
                Some((_, data)) => left -= data.len(),
                None => break,
            }
        }
        Ok(())
    }

    /// So many bytes are in the master's line discipline.
    fn readable(&self) -> io::Result<usize> {
        Ok(usize::try_from(ioctl_fionread(&self.master[0])?).unwrap_or(0))
    }

    /// One read: its status byte, and at most `max` bytes. A read of no data still tells a status, or that there are
    /// bytes.
    fn read(&mut self, max: usize) -> io::Result<Option<(u8, Vec<u8>)>> {
        let room = max.saturating_add(1).min(READ_MAX);
        // Before the read: a flush that the read does not show comes after these bytes.
        let held = self.readable()?;
        match retry_on_intr(|| rustix::io::read(&self.master[0], &mut self.buffer[..room])) {
            Ok(length) => {
                let read = self.buffer[..length].split_first();
                let read = read.map(|(&status, data)| (status, data.to_vec()));
                if let Some((STATUS_DATA, data)) = &read {
                    self.has_read |= !data.is_empty();
                    self.backlog = held.saturating_sub(data.len());
                }
                Ok(read)
            }
            // With EIO, no one has the port open.
            Err(Errno::AGAIN | Errno::IO) => {
                self.backlog = 0;
                Ok(None)
            }
            Err(errno) => Err(errno.into()),
        }
    }

    /// Writes towards the client without waiting. Returns how many bytes went.
    pub(super) fn write(&self, bytes: &[u8]) -> usize {
        let mut written = 0;
        while written < bytes.len() {
            match retry_on_intr(|| rustix::io::write(&self.master[0], &bytes[written..])) {
                Ok(0) | Err(_) => break,
                Ok(length) => written += length,
            }
        }
        written
    }

    /// Undoes what the last client may have left: replies that it did not read, and stopped output.
    pub(super) fn forget_replies_and_restart(&self) -> io::Result<()> {
        let Some([slave, _]) = &self.slave else { return Ok(()) };
        termios::tcflush(slave, QueueSelector::IFlush)?;
        // Off and on: on its own, TCOON does not undo a stop by XOFF.
        termios::tcflow(slave, Action::OOff)?;
        termios::tcflow(slave, Action::OOn)?;
        Ok(())
    }

    /// Whether the client has asked that no one else may open the port.
    pub(super) fn is_exclusive(&self) -> io::Result<bool> {
        Ok(self.slave.as_ref().map_or(Ok(false), |[slave, _]| exclusive_mode(slave))?)
    }

    /// Lets anyone who may, open the port, whatever the last client had asked for.
    pub(super) fn clear_exclusive(&self) -> io::Result<()> {
        Ok(self.slave.as_ref().map_or(Ok(()), |[slave, _]| ioctl_tiocnxcl(slave))?)
    }

    /// Asks what a client had asked for.
    pub(super) fn make_exclusive(&self) -> io::Result<()> {
        Ok(self.slave.as_ref().map_or(Ok(()), |[slave, _]| ioctl_tiocexcl(slave))?)
    }

    /// Closes the port's own slave descriptor, until it is [taken up](Pty::take_up) again.
    pub(super) fn let_go(&mut self) {
        self.slave = None;
    }

    /// Whether no one has the slave side open: after it has been [let go](Pty::let_go). Waits for it for so long, if
    /// that is given, or until there are notices.
    pub(super) fn is_hung_up(&self, wait: Option<(&OwnedFd, Duration)>) -> io::Result<bool> {
        let at_once = Timespec { tv_sec: 0, tv_nsec: 0 };
        let (notices, wait) = wait.map_or((None, at_once), |(notices, wait)| {
            let wait = Timespec::try_from(wait).unwrap_or(at_once);
            (Some(notices), wait)
        });
        let mut polled = vec![PollFd::new(&self.master[0], PollFlags::empty())];
        polled.extend(notices.map(|notices| PollFd::new(notices, PollFlags::IN)));
        retry_on_intr(|| poll(&mut polled, Some(&wait)))?;
        Ok(polled[0].revents().contains(PollFlags::HUP))
    }

    /// Opens the slave side again. Says whether it could.
    pub(super) fn take_up(&mut self) -> io::Result<bool> {
        match open_slave(&self.path) {
            Ok(slave) => self.attach(slave).map(|()| true),
            // Somebody has just taken the port for itself; then the master side shows its close.
            Err(Errno::BUSY) => Ok(false),
            Err(errno) => Err(errno.into()),
        }
    }

    fn attach(&mut self, slave: OwnedFd) -> io::Result<()> {
        let slave = twice(slave)?;
        // Who waits last is woken first: new settings wake both, and are to be noted first.
        self.order.watch(&slave[0], Mark::Wrote)?;
        self.order.watch(&slave[1], Mark::Set)?;
        self.slave = Some(slave);
        // Both are listed from the start. That tells nothing.
        let marks = self.order.take()?;
        self.marks.extend(marks.into_iter().filter(|mark| !matches!(mark, Mark::Wrote | Mark::Set)));
        Ok(())
    }
}

/// A descriptor and its duplicate.
fn twice(descriptor: OwnedFd) -> io::Result<[OwnedFd; 2]> {
    let duplicate = descriptor.try_clone()?;
    Ok([descriptor, duplicate])
}

/// Only for reading: so its close is told apart from a client's that writes.
fn open_slave(path: &Path) -> rustix::io::Result<OwnedFd> {
    fs::open(path, OFlags::RDONLY | OFlags::NOCTTY | OFlags::CLOEXEC | OFlags::NONBLOCK, Mode::empty())
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

/// Makes reads on the master begin with a status byte. Not `EXTPROC`, which would show changed settings too: with
/// it the kernel no longer acts on XOFF.
#[allow(unsafe_code)]
fn packet_mode(master: impl AsFd) -> rustix::io::Result<()> {
    const TIOCPKT: Opcode = 0x5420;
    // SAFETY: TIOCPKT reads one int through its pointer, and changes no memory of ours.
    unsafe { ioctl(master, Setter::<TIOCPKT, c_int>::new(1)) }
}

#[allow(unsafe_code)]
fn exclusive_mode(slave: impl AsFd) -> rustix::io::Result<bool> {
    const TIOCGEXCL: Opcode = 0x8004_5440;
    // SAFETY: TIOCGEXCL writes one int through its pointer, and nothing else.
    let exclusive = unsafe { ioctl(slave, Getter::<TIOCGEXCL, c_int>::new()) }?;
    Ok(exclusive != 0)
}

#[cfg(not(any(
    target_arch = "x86_64",
    target_arch = "x86",
    target_arch = "aarch64",
    target_arch = "arm",
    target_arch = "riscv64"
)))]
compile_error!("look up this machine's TIOCPKT and TIOCGEXCL: a few differ from asm-generic/ioctls.h");
