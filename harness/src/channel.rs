//! Records over a socket: the way between the harness and a board's process, for both ends.

use std::io;
use std::ops::{Add, Sub};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::task::{Context, Poll, ready};

use bytes::BytesMut;
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::io::Errno;
use serde::Serialize;
use serde::de::DeserializeOwned;
use tokio::io::unix::AsyncFd;
use torno_protocol::record;

use crate::readable::readable;

/// How long the other end may leave the socket full.
const FULL: Timespec = Timespec { tv_sec: 10, tv_nsec: 0 };

/// Bytes over a socket.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Bytes {
    /// To the other end.
    pub to: u64,
    /// From the other end.
    pub from: u64,
}

impl Add for Bytes {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { to: self.to + other.to, from: self.from + other.from }
    }
}

impl Sub for Bytes {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self { to: self.to - other.to, from: self.from - other.from }
    }
}

/// One end of the way.
#[derive(Debug)]
pub(crate) struct Channel {
    socket: AsyncFd<OwnedFd>,
    incoming: BytesMut,
    outgoing: BytesMut,
    bytes: Bytes,
}

impl Channel {
    pub(crate) fn new(socket: UnixStream) -> io::Result<Self> {
        socket.set_nonblocking(true)?;
        let (incoming, outgoing) = (BytesMut::new(), BytesMut::new());
        Ok(Self { socket: readable(socket)?, incoming, outgoing, bytes: Bytes::default() })
    }

    /// What has gone each way so far: sent to the other end, received from it.
    pub(crate) fn bytes(&self) -> Bytes {
        self.bytes
    }

    pub(crate) fn send(&mut self, record: &impl Serialize) -> io::Result<()> {
        self.outgoing.clear();
        record::encode(record, &mut self.outgoing).map_err(io::Error::other)?;
        self.bytes.to += self.outgoing.len() as u64;
        let mut rest = &self.outgoing[..];
        while !rest.is_empty() {
            match rustix::io::write(self.socket.get_ref(), rest) {
                Ok(n) => rest = &rest[n..],
                Err(Errno::AGAIN) => {
                    let mut writable = [PollFd::new(self.socket.get_ref(), PollFlags::OUT)];
                    if rustix::event::poll(&mut writable, Some(&FULL))? == 0 {
                        return Err(io::ErrorKind::TimedOut.into());
                    }
                }
                Err(Errno::INTR) => {}
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    /// The next record; `None` at the end of the stream.
    pub(crate) fn poll_receive<R: DeserializeOwned>(
        &mut self,
        context: &mut Context<'_>,
    ) -> Poll<io::Result<Option<R>>> {
        loop {
            if let Some(record) = record::decode(&mut self.incoming).map_err(io::Error::other)? {
                return Poll::Ready(Ok(Some(record)));
            }
            let mut guard = ready!(self.socket.poll_read_ready(context))?;
            let mut chunk = [0; 16 << 10];
            match guard.try_io(|socket| Ok(rustix::io::read(socket.get_ref(), &mut chunk)?)) {
                Ok(Ok(0)) => return Poll::Ready(Ok(None)),
                Ok(Ok(n)) => {
                    self.incoming.extend_from_slice(&chunk[..n]);
                    self.bytes.from += n as u64;
                    if n < chunk.len() {
                        // Nothing is left to read: saves the read that would say so.
                        guard.clear_ready();
                    }
                }
                Ok(Err(error)) if error.kind() == io::ErrorKind::Interrupted => {}
                Ok(Err(error)) if error.kind() == io::ErrorKind::ConnectionReset => return Poll::Ready(Ok(None)),
                Ok(Err(error)) => return Poll::Ready(Err(error)),
                Err(_would_block) => {}
            }
        }
    }
}
