//! The PC's serial port as a TCP socket: one client at a time, which sends bytes alone, or speaks RFC 2217.
//!
//! The bytes of a client stay in the kernel until they are wanted, but for a few, so that its writes block as they do
//! at a driver whose queue is full. What waits for a client that does not read is bounded. A connection that ends in
//! the direction towards the rig has closed the port; it still gets replies until it ends in the other direction, too,
//! or another client comes.

use std::collections::VecDeque;
use std::future::poll_fn;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::task::{Context, Poll, Waker};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::{Sleep, sleep};

use super::PortError;
use super::event::{LineCoding, LineSettings, PortEvent};
use super::queue::Queue;
use super::rfc2217::{Request, Server};

/// So many bytes are taken from a client before they are wanted, as by a serial driver. Others stay in the kernel.
const AHEAD: usize = 256;
/// So many of a client that speaks RFC 2217: a purge comes behind the bytes that it is for.
const AHEAD_RFC2217: usize = 1 << 14;
/// So many bytes are read at once.
const READ: usize = 1 << 12;
/// So many things that clients have done wait to be told, before another is heard.
const EVENTS: usize = 1 << 10;
/// DC1 and DC3 (ITU-T T.50).
const XON: u8 = 0x11;
const XOFF: u8 = 0x13;
/// So many bytes at most wait for the line of clients that have gone.
const LEFT_MAX: usize = 1 << 16;
/// So many bytes at most wait here for a client that does not read, beyond those in the kernel.
const OUT_MAX: usize = 1 << 14;
/// What the kernel is asked to hold each way. It takes twice that, for its own use of it.
const KERNEL: u32 = 1 << 14;
/// So many reads are done in a row.
const AT_ONCE: usize = 16;
/// So many changes of clients wait to be told before another client is let in.
const CHANGES: usize = 4;
/// Clients that have connected and not been let in.
const BACKLOG: u32 = 16;
/// So long a client waits for the one before it to be gone: the end of a connection may come after the next has begun.
/// (Ours.)
const GRACE: Duration = Duration::from_millis(200);
/// Where no client can be accepted, as for want of a file descriptor, the next attempt is made so much later.
const AGAIN: Duration = Duration::from_millis(100);

/// The emulated rig's side of a serial port that clients reach by TCP. Dropped, it closes the connection.
#[derive(Debug)]
pub struct TcpPort {
    address: SocketAddr,
    accepting: JoinHandle<()>,
    connections: mpsc::Receiver<(TcpStream, SocketAddr)>,
    client: Option<Client>,
    /// Who has come while another was there.
    waiting: Option<PendingConnection>,
    /// What clients have written.
    queue: Queue,
    /// Who has come and gone.
    changes: VecDeque<PortEvent>,
    line: LineSettings,
    /// Whether clients speak RFC 2217.
    controls: bool,
    /// Whether a client has set the line, and no one has been told.
    set: bool,
}

/// A connection.
#[derive(Debug)]
struct Client {
    stream: TcpStream,
    peer: SocketAddr,
    /// It has closed the port, but may still read.
    has_left: bool,
    /// The other end of its RFC 2217.
    server: Option<Server>,
    /// It wants nothing that is received for now.
    suspended: bool,
    /// What has been received for it, as it goes over the connection.
    received: Vec<u8>,
    /// What is being written to it: that cannot be taken back.
    out: VecDeque<u8>,
}

/// A connection that is let in or refused before long.
#[derive(Debug)]
struct PendingConnection {
    stream: TcpStream,
    peer: SocketAddr,
    until: Pin<Box<Sleep>>,
}

impl TcpPort {
    /// Listens at `address` for clients of a port at `baud`, 8N1, that control it by RFC 2217 or just send bytes.
    ///
    /// # Errors
    /// [`PortError::Listen`] if the system refuses.
    ///
    /// # Panics
    /// Outside a tokio runtime with I/O enabled.
    pub(super) fn open(address: SocketAddr, controls: bool, baud: u32) -> Result<Self, PortError> {
        let refused = |cause| PortError::Listen { address, cause };
        let listener = listen(address).map_err(refused)?;
        let address = listener.local_addr().map_err(refused)?;
        let (sender, connections) = mpsc::channel(1);
        Ok(Self {
            address,
            accepting: tokio::spawn(accept(listener, sender)),
            connections,
            client: None,
            waiting: None,
            queue: Queue::default(),
            changes: VecDeque::new(),
            line: LineSettings { coding: LineCoding::at(baud), ixon: false },
            controls,
            set: false,
        })
    }

    /// Where it listens.
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// As pyserial opens it.
    pub fn url(&self) -> String {
        format!("{}://{}", if self.controls { "rfc2217" } else { "socket" }, self.address)
    }

    /// Whether clients control the port by RFC 2217.
    pub const fn controls(&self) -> bool {
        self.controls
    }

    pub(super) const fn settings(&self) -> LineSettings {
        self.line
    }

    pub(super) fn next_coding(&self) -> LineCoding {
        self.queue.next_coding().unwrap_or(self.line.coding)
    }

    pub(super) async fn event(&mut self, max: usize, coding: Option<LineCoding>) -> io::Result<PortEvent> {
        poll_fn(|context| match self.next(max, coding, context) {
            Some(event) => Poll::Ready(Ok(event)),
            None => Poll::Pending,
        })
        .await
    }

    pub(super) fn try_event(&mut self, max: usize, coding: Option<LineCoding>) -> io::Result<Option<PortEvent>> {
        Ok(self.next(max, coding, &mut Context::from_waker(Waker::noop())))
    }

    pub(super) fn write(&mut self, bytes: &[u8]) -> usize {
        // What comes before the rig has been told of a client is not for this one.
        let is_new = self.changes.contains(&PortEvent::Opened);
        let Some(client) = self.client.as_mut().filter(|_| !is_new) else { return 0 };
        // A terminal takes them for itself.
        let is_flow = |byte: u8| self.controls && self.line.ixon && (byte == XON || byte == XOFF);
        let mut lost = 0;
        for byte in bytes.iter().copied().filter(|byte| !is_flow(*byte)) {
            if client.received.len() >= OUT_MAX {
                lost += 1;
            } else if self.controls {
                client.received.extend(Server::encode(&[byte]));
            } else {
                client.received.push(byte);
            }
        }
        self.flush(&mut Context::from_waker(Waker::noop()));
        lost
    }

    /// A character has come with an error.
    pub(super) fn tell_line_error(&mut self, is_break: bool) {
        if let Some(client) = &mut self.client
            && client.out.len() < OUT_MAX
            && let Some(server) = &mut client.server
        {
            server.tell_line_error(is_break);
            client.out.extend(server.take_answers());
        }
    }

    pub(super) fn leftover(&self) -> usize {
        self.queue.leftover()
    }

    pub(super) fn leftover_ixon(&self) -> Option<bool> {
        self.queue.leftover_ixon()
    }

    pub(super) fn forget_leftover(&mut self) -> usize {
        self.queue.forget_leftover()
    }

    fn next(&mut self, max: usize, coding: Option<LineCoding>, context: &mut Context<'_>) -> Option<PortEvent> {
        self.attend(context);
        let change = self.changes.pop_front();
        let change = change.or_else(|| core::mem::take(&mut self.set).then_some(PortEvent::Set));
        change.or_else(|| self.queue.next(max, coding))
    }

    /// Takes in what has happened; has whoever waits woken when there is more.
    fn attend(&mut self, context: &mut Context<'_>) {
        self.flush(context);
        self.listen(context);
        while self.changes.len() < CHANGES && self.answer_next(context) {
            self.listen(context);
        }
    }

    /// Lets the next client in, if no one has the port open, or refuses it. Says whether there was one.
    fn answer_next(&mut self, context: &mut Context<'_>) -> bool {
        if self.waiting.is_none()
            && let Poll::Ready(Some((stream, peer))) = self.connections.poll_recv(context)
        {
            self.waiting = Some(PendingConnection { stream, peer, until: Box::pin(sleep(GRACE)) });
        }
        let Some(waiting) = &mut self.waiting else { return false };
        let is_late = waiting.until.as_mut().poll(context).is_ready();
        // That the one before has gone is not known yet if its bytes were not wanted.
        if self.client.as_ref().is_some_and(Client::is_hung_up) {
            self.hear_out();
        }
        let present = self.client.as_ref().filter(|client| !client.has_left).map(|client| client.peer);
        if present.is_some() && !is_late {
            return false;
        }
        let Some(PendingConnection { stream, peer, .. }) = self.waiting.take() else { return false };
        match present {
            Some(present) => {
                tracing::warn!("a client at {peer} is refused: {present} has the port open");
                refuse(stream, present);
            }
            None => self.welcome(stream, peer, context),
        }
        true
    }

    /// Lets a client in.
    fn welcome(&mut self, stream: TcpStream, peer: SocketAddr, context: &mut Context<'_>) {
        // Without it, a reply can wait for the acknowledgement of the one before.
        stream.set_nodelay(true).ok();
        let LineSettings { coding, ixon } = self.line;
        let mut server = self.controls.then(|| Server::new(coding, ixon));
        let out = server.as_mut().map_or_else(Vec::new, Server::take_answers).into();
        let (suspended, received) = (false, Vec::new());
        self.client = Some(Client { stream, peer, has_left: false, server, suspended, received, out });
        self.flush(context);
        self.queue.forget_beginnings();
        self.changes.push_back(PortEvent::Opened);
    }

    /// Writes what waits for the client, as far as it can be.
    fn flush(&mut self, context: &mut Context<'_>) {
        while let Some(client) = &mut self.client
            && client.has_something()
            && client.stream.poll_write_ready(context).is_ready()
        {
            match client.stream.try_write(client.out.as_slices().0) {
                Ok(written) => drop(client.out.drain(..written)),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                Err(_) => self.lose(),
            }
        }
    }

    /// Takes what the client has written, as far as there is room for it.
    fn listen(&mut self, context: &mut Context<'_>) {
        let mut buffer = [0; READ];
        for _ in 0..AT_ONCE {
            let room = self.room();
            let Some(client) = self.client.as_mut().filter(|client| room > 0 && !client.has_left) else { return };
            if client.stream.poll_read_ready(context).is_pending() {
                return;
            }
            let read = client.stream.try_read(&mut buffer[..room]);
            self.take(read, &buffer);
            self.flush(context);
        }
        context.waker().wake_by_ref();
    }

    /// So many bytes are read from the client at once: none if too much waits.
    fn room(&self) -> usize {
        // Answers to what it has said wait to be written.
        let answers = self.client.as_ref().map_or(0, |client| client.out.len());
        if answers >= OUT_MAX || self.queue.len() >= EVENTS {
            return 0;
        }
        let ahead = if self.controls { AHEAD_RFC2217 } else { AHEAD };
        let room = ahead.saturating_sub(self.queue.held());
        room.min(LEFT_MAX.saturating_sub(self.queue.leftover())).min(READ)
    }

    /// The client has closed the port: takes what it has left.
    fn hear_out(&mut self) {
        let mut buffer = [0; READ];
        while let Some(client) = self.client.as_mut().filter(|client| !client.has_left) {
            let room = LEFT_MAX.saturating_sub(self.queue.leftover() + self.queue.held()).min(READ);
            if room == 0 || self.queue.len() >= EVENTS {
                tracing::warn!("what a client wrote last before it closed the port is lost: too much waits already");
                return self.leave();
            }
            // Not by the runtime, which may not know yet that there is something to be read.
            match rustix::io::read(&client.stream, &mut buffer[..room]) {
                Err(Errno::AGAIN) => return,
                read => self.take(read.map_err(Into::into), &buffer),
            }
        }
    }

    /// Takes what has been read.
    fn take(&mut self, read: io::Result<usize>, buffer: &[u8]) {
        match read {
            Ok(0) => self.leave(),
            Ok(length) => self.hear(&buffer[..length]),
            Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted) => {}
            Err(_) => self.lose(),
        }
    }

    /// Takes what the client has said.
    fn hear(&mut self, bytes: &[u8]) {
        let Some(client) = &mut self.client else { return };
        let Some(server) = &mut client.server else { return self.queue.put(bytes.to_vec(), self.line.coding) };
        for request in server.receive(bytes) {
            match request {
                Request::Data(bytes) => self.queue.put(bytes, self.line.coding),
                Request::Coding(coding) => (self.line.coding, self.set) = (coding, true),
                Request::FlowControl(ixon) => (self.line.ixon, self.set) = (ixon, true),
                Request::Break(low) => self.queue.hold(low),
                // Once is enough, however often it has risen meanwhile.
                Request::Dtr(true) if self.changes.back() != Some(&PortEvent::Ready) => {
                    self.changes.push_back(PortEvent::Ready);
                }
                Request::Dtr(_) => {}
                Request::PurgeReceived => client.received.clear(),
                Request::PurgeSent => self.queue.flush(),
                Request::Suspend(suspended) => client.suspended = suspended,
            }
        }
        client.out.extend(server.take_answers());
    }

    /// The client has closed the port.
    fn leave(&mut self) {
        if let Some(client) = self.client.as_mut().filter(|client| !client.has_left) {
            client.has_left = true;
            if client.server.as_ref().is_some_and(Server::is_low) {
                self.queue.hold(false);
            }
            self.queue.leave(self.line.ixon);
            self.changes.push_back(PortEvent::Closed);
        }
    }

    /// The connection has ended in both directions.
    fn lose(&mut self) {
        self.leave();
        self.client = None;
    }
}

impl Drop for TcpPort {
    fn drop(&mut self) {
        self.accepting.abort();
    }
}

impl Client {
    /// Whether something is to be written to it. What has been received follows on all else.
    fn has_something(&mut self) -> bool {
        if self.out.is_empty() && !self.suspended {
            self.out = core::mem::take(&mut self.received).into();
        }
        !self.out.is_empty()
    }

    /// Whether it has closed the port, which may not have been read yet.
    fn is_hung_up(&self) -> bool {
        let mut polled = [PollFd::new(&self.stream, PollFlags::RDHUP)];
        let gone = PollFlags::RDHUP | PollFlags::HUP | PollFlags::ERR;
        poll(&mut polled, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })).is_ok() && polled[0].revents().intersects(gone)
    }
}

fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4()? } else { TcpSocket::new_v6()? };
    // A rig that is started again finds its address free.
    socket.set_reuseaddr(true)?;
    // Connections have what the listener has.
    socket.set_recv_buffer_size(KERNEL)?;
    socket.set_send_buffer_size(KERNEL)?;
    socket.bind(address)?;
    socket.listen(BACKLOG)
}

/// Accepts clients for as long as somebody takes them.
async fn accept(listener: TcpListener, connections: mpsc::Sender<(TcpStream, SocketAddr)>) {
    let mut failing = false;
    loop {
        let accepted = listener.accept().await;
        let failed = core::mem::replace(&mut failing, accepted.is_err());
        match accepted {
            Ok(connection) => {
                if connections.send(connection).await.is_err() {
                    return;
                }
            }
            Err(error) => {
                if !failed {
                    tracing::warn!(%error, "no one new can open the port for now");
                }
                tokio::time::sleep(AGAIN).await;
            }
        }
    }
}

/// Says why, and closes the connection.
fn refuse(stream: TcpStream, present: SocketAddr) {
    let text = format!("torno: {present} has this port open: one client at a time\r\n");
    // The runtime does not know yet that it can be written. If this fails, the client has gone.
    let Ok(stream) = stream.into_std() else { return };
    let _ = io::Write::write_all(&mut &stream, text.as_bytes());
    let _ = stream.shutdown(std::net::Shutdown::Write);
    // With bytes that no one has read, the close would be a reset, and could overtake the text.
    let _ = io::Read::read(&mut &stream, &mut [0; AHEAD]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_client_waits_for_the_one_before_it_to_be_gone() {
        let mut port = TcpPort::open("127.0.0.1:0".parse().unwrap(), false, 9600).unwrap();
        let connect = |port: &TcpPort| std::net::TcpStream::connect(port.address()).unwrap();
        let first = connect(&port);
        assert_eq!(port.event(64, None).await.unwrap(), PortEvent::Opened);
        let _next = connect(&port);
        let comes = async {
            while port.waiting.is_none() {
                assert_eq!(port.try_event(64, None).unwrap(), None);
                tokio::task::yield_now().await;
            }
        };
        tokio::time::timeout(Duration::from_secs(10), comes).await.expect("it has to wait");
        drop(first);
        for event in [PortEvent::Closed, PortEvent::Opened] {
            assert_eq!(port.event(64, None).await.unwrap(), event);
        }
    }
}
