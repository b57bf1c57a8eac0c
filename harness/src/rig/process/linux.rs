use std::future::poll_fn;
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{ExitStatus, Stdio};
use std::task::{Context, Poll, ready};

use rustix::process::{Pid, WaitId, WaitIdOptions};
use rustix::thread::CpuSet;
use tokio::process::{Child, Command};
use tokio::signal::unix::{Signal, SignalKind, signal};
use torno_protocol::board::{Description, Kept};
use torno_protocol::record::{FromBoard, Report, Setup, Timed, ToBoard, VERSION};
use torno_protocol::time::Instant;

use crate::channel::{Channel, is_gone};
use crate::rig::{Bytes, ProcessChange, RigError, SLOW_BOARD};

/// Boards can have processes of their own.
pub(in crate::rig) const SUPPORTED: bool = true;

/// News of the processes that the harness has started.
#[derive(Debug)]
pub(in crate::rig) struct Children(Signal);

impl Children {
    /// Listens from here on.
    pub(in crate::rig) fn listen() -> io::Result<Self> {
        signal(SignalKind::child()).map(Self)
    }

    /// Ready when something has become of one of them.
    pub(in crate::rig) fn poll_news(&mut self, context: &mut Context<'_>) -> Poll<()> {
        self.0.poll_recv(context).map(drop)
    }
}

/// A board's process, at the other end of a socket.
#[derive(Debug)]
pub struct BoardProcess {
    origin: Origin,
    channel: Channel,
    /// The beginning of the report that is coming in.
    told: Vec<Timed>,
}

/// Who started it.
#[derive(Debug)]
enum Origin {
    /// The harness did.
    Launched { child: Child, pid: Pid },
    /// Somebody else did, and it has joined. The system tells only what its socket tells.
    Joined {
        /// Not known if it is not visible here, as in another container.
        pid: Option<Pid>,
        /// Its socket has ended.
        gone: bool,
    },
}

/// Why a process is not the board that it should be.
#[derive(Debug)]
pub(in crate::rig) enum Unfit {
    /// It says nothing.
    Slow,
    /// It says what is no record.
    Record(io::Error),
    /// Why, for people.
    Other(String),
}

impl std::fmt::Display for Unfit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Slow => write!(f, "has not answered for {} s", SLOW_BOARD.as_secs()),
            Self::Record(error) => write!(f, "sends what is no record: {error}"),
            Self::Other(message) => f.write_str(message),
        }
    }
}

impl BoardProcess {
    /// Starts `exe board KIND` with a socket for its standard input, and sets it up.
    pub(in crate::rig) fn launch(exe: &Path, setup: Setup) -> io::Result<Self> {
        let (ours, theirs) = UnixStream::pair()?;
        let child = Command::new(exe)
            .args(["board", &setup.kind])
            .stdin(Stdio::from(OwnedFd::from(theirs)))
            .stdout(Stdio::null())
            // Ctrl-C in the terminal is for the harness, which then ends its boards.
            .process_group(0)
            .kill_on_drop(true)
            .spawn()?;
        let pid = child.id().and_then(|id| Pid::from_raw(id as i32)).ok_or(io::ErrorKind::NotFound)?;
        Self::set_up(Origin::Launched { child, pid }, ours, setup)
    }

    /// Sets up one that has joined.
    pub(in crate::rig) fn joined(stream: tokio::net::UnixStream, setup: Setup) -> io::Result<Self> {
        let pid = stream.peer_cred()?.pid().and_then(Pid::from_raw);
        Self::set_up(Origin::Joined { pid, gone: false }, stream.into_std()?, setup)
    }

    fn set_up(origin: Origin, socket: UnixStream, setup: Setup) -> io::Result<Self> {
        let mut process = Self { origin, channel: Channel::new(socket)?, told: Vec::new() };
        process.send(&ToBoard::Setup(setup))?;
        Ok(process)
    }

    /// Its number; None, if it is not visible here.
    pub(in crate::rig) fn pid(&self) -> Option<u32> {
        let pid = match &self.origin {
            Origin::Launched { pid, .. } => Some(*pid),
            Origin::Joined { pid, .. } => *pid,
        };
        pid.map(|pid| pid.as_raw_nonzero().get() as u32)
    }

    /// Waits until one that was started has said that it is what it should be. One that has joined has.
    pub(in crate::rig) async fn introduce(&mut self, name: &str, expected: &Description) -> Result<(), RigError> {
        if matches!(self.origin, Origin::Joined { .. }) {
            return Ok(());
        }
        let board = name.to_owned();
        self.check(expected).await.map_err(|unfit| match unfit {
            Unfit::Slow => RigError::Slow { board },
            Unfit::Record(source) => RigError::Launch { board, source },
            Unfit::Other(message) => RigError::Board { board, message },
        })
    }

    /// Waits until it has said that it is what it should be.
    pub(in crate::rig) async fn check(&mut self, expected: &Description) -> Result<(), Unfit> {
        let other = |message: &str| Err(Unfit::Other(message.to_owned()));
        let answer = tokio::time::timeout(SLOW_BOARD, poll_fn(|context| self.poll_receive(context)));
        match answer.await.map_err(|_| Unfit::Slow)?.map_err(Unfit::Record)? {
            Some(FromBoard::Ready { version, .. }) if version != VERSION => {
                Err(Unfit::Other(format!("expected a board of version {VERSION}, found version {version}")))
            }
            Some(FromBoard::Ready { description, .. }) if description == *expected => Ok(()),
            Some(FromBoard::Ready { .. }) => other("expected another description of the board: it is another build"),
            Some(FromBoard::Broken(message)) => Err(Unfit::Other(message)),
            None => other("its process ended at once"),
            Some(FromBoard::Report(_) | FromBoard::Told(_) | FromBoard::Kept(_)) => {
                other("answered before it was asked")
            }
        }
    }

    /// What the board keeps without power; None, if it is gone, or does not answer.
    pub(in crate::rig) async fn kept(&mut self, until: Instant) -> io::Result<Option<Kept>> {
        self.send(&ToBoard::Keep(until))?;
        let answer = tokio::time::timeout(SLOW_BOARD, poll_fn(|context| self.poll_receive(context)));
        match answer.await {
            Ok(Ok(Some(FromBoard::Kept(kept)))) => Ok(kept),
            Ok(Ok(None)) | Err(_) => Ok(None),
            Ok(Ok(Some(_))) => Err(io::Error::other("something else than what it keeps")),
            Ok(Err(error)) => Err(error),
        }
    }

    /// What has gone to the process and come from it.
    pub(in crate::rig) fn bytes(&self) -> Bytes {
        self.channel.bytes()
    }

    /// If the process has died, its socket's end will say so.
    pub(in crate::rig) fn send(&mut self, record: &ToBoard) -> io::Result<()> {
        match self.channel.send(record) {
            Err(error) if is_gone(&error) => Ok(()),
            sent => sent,
        }
    }

    /// The board's next record; `None` if the board is gone.
    pub(in crate::rig) fn poll_receive(&mut self, context: &mut Context<'_>) -> Poll<io::Result<Option<FromBoard>>> {
        loop {
            return Poll::Ready(Ok(match ready!(self.channel.poll_receive(context))? {
                Some(FromBoard::Told(told)) => {
                    self.told.extend(told);
                    continue;
                }
                Some(FromBoard::Report(mut report)) if !self.told.is_empty() => {
                    self.told.append(&mut report.outputs);
                    Some(FromBoard::Report(Report { outputs: core::mem::take(&mut self.told), ..report }))
                }
                record => record,
            }));
        }
    }

    /// What has become of the process since the last call.
    pub(in crate::rig) fn change(&mut self) -> io::Result<Option<ProcessChange>> {
        let (child, pid) = match &mut self.origin {
            Origin::Launched { child, pid } => (child, *pid),
            Origin::Joined { gone, .. } => return Ok(core::mem::take(gone).then_some(ProcessChange::Died(None))),
        };
        if let Some(status) = child.try_wait()? {
            return Ok(Some(ProcessChange::Died(Some(status))));
        }
        let options = WaitIdOptions::STOPPED | WaitIdOptions::CONTINUED | WaitIdOptions::NOHANG;
        match rustix::process::waitid(WaitId::Pid(pid), options) {
            Ok(Some(status)) if status.stopped() => Ok(Some(ProcessChange::Stopped)),
            Ok(Some(status)) if status.continued() => Ok(Some(ProcessChange::Continued)),
            Ok(_) => Ok(None),
            // It has died in between: the next call will say so.
            Err(rustix::io::Errno::CHILD) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// Waits until the socket of one that has joined ends while nothing is expected of it; the next
    /// [change](Self::change) says so.
    pub(in crate::rig) fn poll_gone(&mut self, context: &mut Context<'_>) -> Poll<()> {
        let Origin::Joined { gone, .. } = &mut self.origin else { return Poll::Pending };
        ready!(self.channel.poll_ended(context));
        *gone = true;
        Poll::Ready(())
    }

    /// Waits for the death of a process whose socket has ended; says how it died, if that can be known.
    pub(in crate::rig) async fn died(&mut self) -> io::Result<Option<ExitStatus>> {
        let Origin::Launched { child, .. } = &mut self.origin else { return Ok(None) };
        child.start_kill().ok();
        child.wait().await.map(Some)
    }
}

/// See [`Rig::share_one_processor`](crate::rig::Rig::share_one_processor).
pub(in crate::rig) fn share_one_processor<'a>(processes: impl Iterator<Item = &'a BoardProcess>) {
    let launched = processes.filter_map(|process| match process.origin {
        Origin::Launched { pid, .. } => Some(pid),
        Origin::Joined { .. } => None,
    });
    let pids: Vec<Pid> = launched.collect();
    if pids.is_empty() {
        return;
    }
    let mut cpus = CpuSet::new();
    cpus.set(rustix::thread::sched_getcpu());
    for pid in pids.into_iter().map(Some).chain([None]) {
        if let Err(error) = rustix::thread::sched_setaffinity(pid, &cpus) {
            tracing::debug!(%error, "cannot keep the boards on one processor");
        }
    }
}
