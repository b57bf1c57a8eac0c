//! Records over a socket: the way between the harness and a board's process, for both ends.

use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::task::{Context, Poll, ready};

use bytes::BytesMut;
use rustix::io::Errno;
use rustix::net::RecvFlags;
use serde::Serialize;
use serde::de::DeserializeOwned;
use tokio::io::unix::AsyncFd;
use torno_protocol::record;

use crate::ready::{readable, writable};
use crate::traffic::Bytes;

/// One end of the way. It never blocks: what the socket does not take at once is queued, and is sent while the end
/// waits for the other's answer. As an end that has sent a grant, or the answer to one, waits for the other, no more
/// than that is queued.
#[derive(Debug)]
pub(crate) struct Channel {
    socket: AsyncFd<OwnedFd>,
    incoming: BytesMut,
    outgoing: BytesMut,
    /// So much of `outgoing` has been sent.
    sent: usize,
    /// Tells when the socket takes more; only while something is queued.
    writable: Option<AsyncFd<OwnedFd>>,
    bytes: Bytes,
}

impl Channel {
    pub(crate) fn new(socket: UnixStream) -> io::Result<Self> {
        socket.set_nonblocking(true)?;
        Ok(Self {
            socket: readable(socket)?,
            incoming: BytesMut::new(),
            outgoing: BytesMut::new(),
            sent: 0,
            writable: None,
            bytes: Bytes::default(),
        })
    }

    /// What has gone each way so far: sent to the other end, received from it.
    pub(crate) fn bytes(&self) -> Bytes {
        self.bytes
    }

    /// Sends a record, or queues what the socket does not take.
    pub(crate) fn send(&mut self, record: &impl Serialize) -> io::Result<()> {
        let queued = self.is_queued();
        if let Err(error) = record::encode(record, &mut self.outgoing) {
            self.forget();
            return Err(io::Error::other(error));
        }
        if queued { Ok(()) } else { self.write() }
    }

    fn is_queued(&self) -> bool {
        !self.outgoing.is_empty()
    }

    /// Sends what is queued, as far as the socket takes it.
    fn write(&mut self) -> io::Result<()> {
        while self.sent < self.outgoing.len() {
            match rustix::io::write(self.socket.get_ref(), &self.outgoing[self.sent..]) {
                Ok(n) => {
                    self.sent += n;
                    self.bytes.to += n as u64;
                }
                Err(Errno::AGAIN) => return Ok(()),
                Err(Errno::INTR) => {}
                Err(error) => {
                    self.forget();
                    return Err(error.into());
                }
            }
        }
        self.forget();
        Ok(())
    }

    /// Empties the queue.
    fn forget(&mut self) {
        self.outgoing.clear();
        self.sent = 0;
        self.writable = None;
    }

    /// Sends what is queued; ready when nothing is.
    fn poll_send(&mut self, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        while self.is_queued() {
            // With write interest, every read at the other end would wake this one: hence only for so long.
            let socket = match self.writable.take() {
                Some(socket) => socket,
                None => writable(self.socket.get_ref().try_clone()?)?,
            };
            let socket = self.writable.insert(socket);
            // Cleared before the attempt, so that room which comes after it is not missed.
            ready!(socket.poll_write_ready(context))?.clear_ready();
            self.write()?;
        }
        Poll::Ready(Ok(()))
    }

    /// The next record; `None` at the end of the stream. Meanwhile it sends what is queued.
    pub(crate) fn poll_receive<R: DeserializeOwned>(
        &mut self,
        context: &mut Context<'_>,
    ) -> Poll<io::Result<Option<R>>> {
        match self.poll_send(context) {
            // The other end is gone. What it has said before, and the end, are still to be read.
            Poll::Ready(Err(error)) if is_gone(&error) => {}
            Poll::Ready(Err(error)) => return Poll::Ready(Err(error)),
            Poll::Ready(Ok(())) | Poll::Pending => {}
        }
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
                Ok(Err(error)) if is_gone(&error) => return Poll::Ready(Ok(None)),
                Ok(Err(error)) => return Poll::Ready(Err(error)),
                Err(_would_block) => {}
            }
        }
    }

    /// Ready when the stream ends, while nothing is expected of it. What comes all the same is left for the next
    /// [`poll_receive`](Self::poll_receive), which then also finds the end.
    pub(crate) fn poll_ended(&mut self, context: &mut Context<'_>) -> Poll<()> {
        loop {
            let Ok(mut guard) = ready!(self.socket.poll_read_ready(context)) else { return Poll::Ready(()) };
            let mut byte = [0; 1];
            let peek = |socket: &AsyncFd<OwnedFd>| {
                Ok(rustix::net::recv(socket.get_ref(), &mut byte[..], RecvFlags::PEEK | RecvFlags::DONTWAIT)?.0)
            };
            match guard.try_io(peek) {
                Ok(Ok(0)) => return Poll::Ready(()),
                Ok(Ok(_)) => return Poll::Pending,
                Ok(Err(error)) if error.kind() == io::ErrorKind::Interrupted => {}
                Ok(Err(_)) => return Poll::Ready(()),
                Err(_would_block) => {}
            }
        }
    }
}

/// Whether a socket does not take anything as no one is at its other end.
pub(crate) fn is_gone(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::BrokenPipe | io::ErrorKind::ConnectionReset)
}

#[cfg(test)]
mod tests {
    use std::future::poll_fn;

    use super::*;

    /// Far more than a socket takes at once.
    const LONG: usize = 4 << 20;

    fn pair() -> (Channel, Channel) {
        let (a, b) = UnixStream::pair().unwrap();
        (Channel::new(a).unwrap(), Channel::new(b).unwrap())
    }

    async fn receive(channel: &mut Channel) -> io::Result<Option<String>> {
        poll_fn(|context| channel.poll_receive(context)).await
    }

    #[tokio::test]
    async fn what_the_socket_does_not_take_is_queued_and_sent_while_the_answer_is_waited_for() {
        let (mut a, mut b) = pair();
        let texts = ["x".repeat(LONG), "y".to_owned(), "z".repeat(LONG)];
        // No one reads yet: this would block.
        texts.iter().for_each(|text| a.send(text).unwrap());
        assert!(a.is_queued() && a.bytes().to < LONG as u64);
        let other = tokio::spawn(async move {
            for text in texts {
                assert_eq!(receive(&mut b).await.unwrap(), Some(text));
            }
            b.send(&"thanks").unwrap();
            assert_eq!(receive(&mut b).await.unwrap(), None);
            b
        });
        assert_eq!(receive(&mut a).await.unwrap().as_deref(), Some("thanks"));
        assert!(!a.is_queued() && a.writable.is_none());
        let bytes = a.bytes();
        drop(a);
        let theirs = other.await.unwrap().bytes();
        assert_eq!((theirs.to, theirs.from), (bytes.from, bytes.to));
        assert!(bytes.to > 2 * LONG as u64);
    }

    #[tokio::test]
    async fn what_fits_goes_at_once() {
        let (mut a, mut b) = pair();
        a.send(&"here").unwrap();
        assert!(!a.is_queued() && a.writable.is_none());
        assert_eq!(receive(&mut b).await.unwrap().as_deref(), Some("here"));
    }

    #[tokio::test]
    async fn what_the_other_end_has_said_before_it_went_is_read_though_nothing_can_be_sent() {
        let (mut a, mut b) = pair();
        a.send(&"x".repeat(LONG)).unwrap();
        b.send(&"farewell").unwrap();
        drop(b);
        assert_eq!(receive(&mut a).await.unwrap().as_deref(), Some("farewell"));
        assert_eq!(receive(&mut a).await.unwrap(), None);
        assert!(a.send(&"anyone?").is_err_and(|error| is_gone(&error)));
    }
}
