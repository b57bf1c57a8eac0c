//! A gateway of a rig that is up: a serial port on one side, the UART of the rig on the other.

use torno_bus::{BAUD, STOPPED};
use torno_engine::{Fact, Input, InputKind, NodeId};
use torno_protocol::board::Stimulus;
use torno_protocol::layout::GATEWAY;
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::{BITS_PER_CHARACTER, Format};

use super::unread::Unread;
use crate::observe::log;
use crate::rig::file;
use crate::session::{Exchange, Happened, Session, SessionError};
use torno_port::{LineCoding, LineSettings, PcPort, PortEvent};

/// So many of the client's bytes wait in the driver at the most.
const DRIVER_QUEUE: usize = 16;
/// The driver takes a new helping when no more than this is left.
const DRIVER_LOW: usize = 4;
/// Nor more often than this: above some 40 000 baud a late computer leaves gaps.
const SLICE_MIN: Span = Span::from_millis(1);

/// A serial port and the UART behind it.
pub(super) struct Gateway {
    /// The place of the gateway in the rig file, and the number of its UART.
    place: usize,
    node: NodeId,
    /// The board that restarts when the port is opened.
    restarts: Option<NodeId>,
    /// For people.
    name: String,
    pub(super) port: PcPort,
    /// The rig's speed.
    rig: u32,
    /// What the bytes that go to the UART were written with.
    settings: LineSettings,
    /// The speed that the UART has.
    baud: u32,
    /// Bytes that the client has written and that are not yet on the line.
    queued: usize,
    /// Whether a client has ever opened the port.
    pub(super) was_opened: bool,
    /// Whether the client that has the port open has written.
    began: bool,
    /// The UART has been stopped by `XOFF`.
    held: bool,
    /// A program outside has the port open.
    is_open: bool,
    /// A program is played from here; it is held as the dialect says.
    plays: bool,
    holds: bool,
    /// When the UART's supply has gone or come, as far as that still lies ahead: what was to be sent by then is lost.
    supply: Vec<Instant>,
    /// The instant of the last thing that the UART has been told.
    told: Instant,
    unread: Unread,
}

impl Gateway {
    pub(super) fn new(place: usize, node: NodeId, gateway: &file::Gateway, port: PcPort) -> Self {
        let settings = LineSettings { coding: LineCoding::at(gateway.baud), ixon: false };
        let name = if gateway.name == GATEWAY { "PC".to_owned() } else { gateway.name.clone() };
        let supply = Vec::new();
        let baud = gateway.baud;
        Self {
            place,
            node,
            restarts: (gateway.open == file::Opening::Reset).then_some(gateway.to.0),
            name,
            port,
            rig: baud,
            settings,
            baud,
            queued: 0,
            was_opened: false,
            began: false,
            held: false,
            is_open: false,
            plays: false,
            holds: gateway.dialect.holds_the_pc(),
            supply,
            told: Instant::START,
            unread: Unread::default(),
        }
    }

    /// Where the client's bytes wait for the line: the span within which the UART can want more.
    pub(super) fn low(&self) -> Option<Span> {
        if self.queued == 0 {
            return None;
        }
        let low = BITS_PER_CHARACTER * DRIVER_LOW as u64 * 1_000_000_000 / u64::from(self.baud.max(1));
        Some(Span::from_nanos(low).max(SLICE_MIN))
    }

    /// Whether what comes from the client follows on what came before: that is not all sent yet.
    pub(super) const fn is_sending(&self) -> bool {
        self.queued > 0
    }

    /// How many of the client's bytes the driver takes; the others stay in the kernel.
    const fn room(&self) -> usize {
        if self.queued > DRIVER_LOW { 0 } else { DRIVER_QUEUE - self.queued }
    }

    /// Bytes that were written at another speed, or in another format, wait until the others are sent.
    fn coding(&self) -> Option<LineCoding> {
        self.is_sending().then_some(self.settings.coding)
    }

    /// Waits for something from the client. Cancel-safe.
    pub(super) async fn event(&mut self) -> std::io::Result<PortEvent> {
        let (room, coding) = (self.room(), self.coding());
        self.port.event(room, coding).await
    }

    /// The same, if it is there already.
    pub(super) fn try_event(&mut self) -> std::io::Result<Option<PortEvent>> {
        let (room, coding) = (self.room(), self.coding());
        self.port.try_event(room, coding)
    }

    /// Forgets what waited for the UART when its supply went or came.
    pub(super) fn lose_supply(&mut self, now: Instant) {
        let before = self.supply.len();
        self.supply.retain(|at| *at >= now);
        if self.supply.len() < before {
            self.queued = 0;
        }
    }

    /// Hands the client what has come for it by `now`.
    pub(super) fn deliver(
        &mut self,
        happened: &Happened,
        now: Instant,
        session: &mut Session,
    ) -> Result<(), SessionError> {
        for Input { at, what, .. } in &happened.inputs {
            if matches!(what, InputKind::Stimulus { board, stimulus: Stimulus::Power(_) } if *board == self.node) {
                self.supply.push(*at);
            }
        }
        for fact in &happened.facts {
            if let Fact::Telemetry { node, signal: STOPPED, value, .. } = fact
                && *node == self.node
            {
                self.held = *value != 0;
            }
        }
        let mut received = Vec::new();
        for (_, gateway, exchange) in &happened.outside {
            match exchange {
                _ if *gateway != self.place => {}
                Exchange::Sent(..) => self.queued = self.queued.saturating_sub(1),
                Exchange::Received(byte, _) => received.push(*byte),
                Exchange::Garbled(byte) => {
                    received.push(*byte);
                    self.port.tell_line_error(*byte == 0);
                }
            }
        }
        if received.is_empty() {
            return Ok(());
        }
        // A client that has only changed its speed since it last wrote is to be heard at the new one.
        let at = self.in_turn(now);
        self.configure(at, session)?;
        let lost = self.port.write(&received);
        if let Some(lost) = self.unread.add(lost) {
            tracing::warn!("the program at the {} port does not read: {lost} bytes are lost", self.name);
        }
        Ok(())
    }

    /// When what comes at `at` happens: not before what came ahead of it, which the wall clock, ahead of the rig, may
    /// have dated later.
    fn in_turn(&mut self, at: Instant) -> Instant {
        self.told = self.told.max(at);
        self.told
    }

    /// Takes what has come from the client.
    pub(super) fn take(&mut self, event: PortEvent, at: Instant, session: &mut Session) -> Result<(), SessionError> {
        let at = self.in_turn(at);
        log::set_time(at);
        self.began &= !matches!(event, PortEvent::Opened | PortEvent::Closed);
        match event {
            PortEvent::Data { coding, .. } => self.set(coding, at, session)?,
            _ => self.configure(at, session)?,
        }
        match event {
            PortEvent::Opened => self.is_open = true,
            PortEvent::Closed => self.is_open = false,
            _ => {}
        }
        match event {
            PortEvent::Data { bytes, .. } => {
                self.queued += bytes.len();
                session.stimulate(self.node, at, Stimulus::Write(bytes));
            }
            PortEvent::Flushed => {
                self.queued = 0;
                session.stimulate(self.node, at, Stimulus::Discard);
            }
            PortEvent::Opened => {
                tracing::info!("the {} port has been opened", self.name);
                self.unread.forget();
                self.was_opened = true;
                if !self.port.tells_dtr() {
                    self.restart(at, session);
                }
            }
            PortEvent::Ready => {
                tracing::info!("the program at the {} port raises DTR", self.name);
                self.restart(at, session);
            }
            PortEvent::Break(low) => {
                session.stimulate(self.node, at, Stimulus::Break(low));
            }
            PortEvent::Began => self.begin(at, session)?,
            PortEvent::Set => {}
            PortEvent::Closed => tracing::info!("the {} port has been closed", self.name),
        }
        Ok(())
    }

    /// Whether a program outside has the port open.
    pub(super) const fn is_open(&self) -> bool {
        self.is_open
    }

    /// Whether a program outside has the port open, or has left something that is not sent yet.
    pub(super) fn is_taken(&self) -> bool {
        self.is_open || (!self.plays && (self.queued > 0 || self.port.leftover() > 0))
    }

    /// A program is played from here (`true`), or is played no more: what is not sent yet is given up.
    pub(super) fn play(&mut self, plays: bool, at: Instant, session: &mut Session) -> Result<(), SessionError> {
        let at = self.in_turn(at);
        self.plays = plays;
        self.queued = 0;
        session.stimulate(self.node, at, Stimulus::Discard);
        if plays {
            self.restart(at, session);
        }
        self.configure(at, session)
    }

    /// Gives the UART bytes of the program that is played.
    pub(super) fn write(&mut self, bytes: Vec<u8>, at: Instant, session: &mut Session) {
        let at = self.in_turn(at);
        self.queued += bytes.len();
        session.stimulate(self.node, at, Stimulus::Write(bytes));
    }

    /// Restarts the board behind the port, if it is to.
    fn restart(&self, at: Instant, session: &mut Session) {
        if let Some(board) = self.restarts {
            session.stimulate(board, at, Stimulus::Reset);
        }
    }

    /// A client writes for the first time. If the one before has left the UART held, neither its hold nor what it could
    /// not send is this one's.
    fn begin(&mut self, at: Instant, session: &mut Session) -> Result<(), SessionError> {
        self.began = true;
        if core::mem::take(&mut self.held) {
            let left = self.port.forget_leftover() + self.queued;
            if left > 0 {
                tracing::warn!("{left} bytes that the program before could not send are dropped");
            }
            self.queued = 0;
            session.stimulate(self.node, at, Stimulus::Discard);
            self.settings.ixon = false;
            session.stimulate(self.node, at, Stimulus::Configure { baud: self.baud, ixon: false });
        }
        self.configure(at, session)
    }

    /// Sets the UART to what the client has set: its speed when all that was written at another is under way.
    fn configure(&mut self, at: Instant, session: &mut Session) -> Result<(), SessionError> {
        let coding = self.coding().unwrap_or_else(|| self.port.next_coding());
        self.set(coding, at, session)
    }

    /// Sets the UART to this coding of the client's. What the one before has left is still held as that one wanted.
    fn set(&mut self, coding: LineCoding, at: Instant, session: &mut Session) -> Result<(), SessionError> {
        let (coding, ixon) = if self.plays {
            (LineCoding::at(self.rig), self.holds)
        } else if let Some(ixon) = self.port.leftover_ixon() {
            (coding, ixon)
        } else if !self.began && self.queued > 0 {
            (coding, self.settings.ixon)
        } else {
            (coding, self.port.settings()?.ixon)
        };
        let settings = LineSettings { coding, ixon };
        if settings == self.settings {
            return Ok(());
        }
        let LineSettings { coding: before, ixon: flowed } = core::mem::replace(&mut self.settings, settings);
        let LineCoding { baud, format } = coding;
        let (name, rig, flow) = (&self.name, self.rig, if settings.ixon { "on" } else { "off" });
        tracing::info!("the program at the {name} port sets {baud} baud, {format}, XON/XOFF {flow}");
        // 0 hangs up; the cable has no line for that.
        let uart = if baud == 0 { self.baud } else { baud.clamp(*BAUD.start(), *BAUD.end()) };
        if baud != before.baud && uart != rig {
            let takes = if uart == baud { String::new() } else { format!(", which its UART takes for {uart}") };
            tracing::warn!("the program at the {name} port sets {baud} baud{takes}, but the rig's line has {rig} baud");
        }
        self.baud = uart;
        if (baud, settings.ixon) != (before.baud, flowed) {
            session.stimulate(self.node, at, Stimulus::Configure { baud: uart, ixon: settings.ixon });
        }
        if format != before.format {
            if format != Format::EIGHT_N_ONE {
                tracing::warn!("the program at the {name} port sets {format}, but the rig's line has 8N1");
            }
            session.stimulate(self.node, at, Stimulus::Format(format));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use torno_engine::Limit;

    use super::*;
    use crate::rig::Driver;
    use crate::rig::file::RigFile;
    use torno_port::LinkPath;
    use torno_port::Transport;

    #[tokio::test]
    async fn what_a_client_writes_stays_in_order_whatever_the_clocks_say() {
        let file = RigFile::load("lathe").unwrap();
        let folder = tempfile::tempdir().unwrap();
        let port = PcPort::open(Transport::Pty, LinkPath::Chosen(folder.path().join("pc")), file.pc.baud).unwrap();
        let mut session = Session::start(&file, &Driver::InProcess, file.pc.uart()).await.unwrap();
        let pc = session.rig().pc();
        let mut gateway = Gateway::new(0, pc, &file.pc, port);
        let coding = LineCoding::at(file.pc.baud);
        // Dated by the wall clock, which is ahead, and then by the rig's.
        for (byte, ms) in [(b'a', 10), (b'b', 5), (b'c', 20)] {
            let event = PortEvent::Data { bytes: vec![byte], coding };
            gateway.take(event, Instant::START + Span::from_millis(ms), &mut session).unwrap();
        }
        let mut sent = Vec::new();
        loop {
            let happened = session.step(Limit::until(Instant::START + Span::from_millis(100))).await.unwrap();
            for (_, _, exchange) in happened.outside {
                if let Exchange::Sent(byte, ..) = exchange {
                    sent.push(byte);
                }
            }
            if !happened.more {
                break;
            }
        }
        assert_eq!(sent, *b"abc");
    }

    #[tokio::test]
    async fn what_was_left_is_held_as_was_set_however_late_the_rig_is() {
        let file = RigFile::load("lathe").unwrap();
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("pc");
        let port = PcPort::open(Transport::Pty, LinkPath::Chosen(link.clone()), file.pc.baud).unwrap();
        let mut session = Session::start(&file, &Driver::InProcess, file.pc.uart()).await.unwrap();
        let pc = session.rig().pc();
        let mut gateway = Gateway::new(0, pc, &file.pc, port);
        // One sets the line, the next writes more than the driver takes: both have gone when the rig looks.
        let script = "stty -F \"$0\" raw -echo ixon && printf %064d 0 >\"$0\"";
        let clients = std::process::Command::new("sh").args(["-c", script]).arg(&link).status();
        assert!(clients.unwrap().success());
        loop {
            let event = gateway.event().await.unwrap();
            let is_data = matches!(event, PortEvent::Data { .. });
            gateway.take(event, Instant::START, &mut session).unwrap();
            if is_data {
                break;
            }
        }
        assert!(gateway.settings.ixon);
    }
}
