//! A board in a process of its own, at the other end of a socket.

use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{ExitStatus, Stdio};
use std::task::{Context, Poll, ready};

use rustix::process::{Pid, WaitId, WaitIdOptions};
use tokio::process::{Child, Command};
use torno_protocol::record::{Batch, FromBoard, Setup, Timed, ToBoard};

use super::Bytes;
use crate::channel::{Channel, is_gone};

/// A board's process.
#[derive(Debug)]
pub(super) struct BoardProcess {
    child: Child,
    pid: Pid,
    channel: Channel,
    /// The beginning of the batch that is coming in.
    told: Vec<Timed>,
}

/// What has become of a board's process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProcessChange {
    /// It was stopped.
    Stopped,
    /// It was continued.
    Continued,
    /// It died.
    Died(ExitStatus),
}

impl BoardProcess {
    /// Starts `exe board KIND` with a socket for its standard input, and sets it up.
    pub(super) fn launch(exe: &Path, setup: Setup) -> io::Result<Self> {
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
        let mut process = Self { child, pid, channel: Channel::new(ours)?, told: Vec::new() };
        process.send(&ToBoard::Setup(setup))?;
        Ok(process)
    }

    pub(super) fn pid(&self) -> Pid {
        self.pid
    }

    /// What has gone to the process and come from it.
    pub(super) fn bytes(&self) -> Bytes {
        self.channel.bytes()
    }

    /// If the process has died, its socket's end will say so.
    pub(super) fn send(&mut self, record: &ToBoard) -> io::Result<()> {
        match self.channel.send(record) {
            Err(error) if is_gone(&error) => Ok(()),
            sent => sent,
        }
    }

    /// The board's next record; `None` if the board is gone.
    pub(super) fn poll_receive(&mut self, context: &mut Context<'_>) -> Poll<io::Result<Option<FromBoard>>> {
        loop {
            return Poll::Ready(Ok(match ready!(self.channel.poll_receive(context))? {
                Some(FromBoard::Told(told)) => {
                    self.told.extend(told);
                    continue;
                }
                Some(FromBoard::Batch(mut batch)) if !self.told.is_empty() => {
                    self.told.append(&mut batch.outputs);
                    Some(FromBoard::Batch(Batch { outputs: core::mem::take(&mut self.told), ..batch }))
                }
                record => record,
            }));
        }
    }

    /// What has become of the process since the last call.
    pub(super) fn change(&mut self) -> io::Result<Option<ProcessChange>> {
        if let Some(status) = self.child.try_wait()? {
            return Ok(Some(ProcessChange::Died(status)));
        }
        let options = WaitIdOptions::STOPPED | WaitIdOptions::CONTINUED | WaitIdOptions::NOHANG;
        match rustix::process::waitid(WaitId::Pid(self.pid), options) {
            Ok(Some(status)) if status.stopped() => Ok(Some(ProcessChange::Stopped)),
            Ok(Some(status)) if status.continued() => Ok(Some(ProcessChange::Continued)),
            Ok(_) => Ok(None),
            // It has died in between: the next call will say so.
            Err(rustix::io::Errno::CHILD) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// Waits for the death of a process whose socket has ended.
    pub(super) async fn died(&mut self) -> io::Result<ExitStatus> {
        self.child.start_kill().ok();
        self.child.wait().await
    }
}
