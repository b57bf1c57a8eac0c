//! A gateway of a rig that is up: a serial port on one side, the UART of the rig on the other.

use torno_bus::STOPPED;
use torno_engine::{Fact, Input, InputKind, NodeId};
use torno_protocol::board::Stimulus;
use torno_protocol::layout::GATEWAY;
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::BITS_PER_CHARACTER;

use crate::observe::log;
use crate::port::{LineSettings, PcPort, PortEvent};
use crate::rig::file;
use crate::session::{Exchange, Happened, Session, SessionError};

/// So many of the client's bytes wait in the driver at the most. Its settings are read with each helping, so a new
/// speed holds at most this many characters late.
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
    /// For people.
    name: String,
    pub(super) port: PcPort,
    settings: LineSettings,
    /// Bytes that the client has written and that are not yet on the line.
    queued: usize,
    /// Whether the client that has the port open has written.
    began: bool,
    /// The UART has been stopped by `XOFF`.
    held: bool,
    /// When the UART's supply has gone or come, as far as that still lies ahead: what was to be sent by then is lost.
    supply: Vec<Instant>,
}

impl Gateway {
    pub(super) fn new(place: usize, node: NodeId, gateway: &file::Gateway, port: PcPort) -> Self {
        let settings = LineSettings { baud: gateway.baud, ixon: false };
        let name = if gateway.name == GATEWAY { "PC".to_owned() } else { gateway.name.clone() };
        let supply = Vec::new();
        Self { place, node, name, port, settings, queued: 0, began: false, held: false, supply }
    }

    /// Where the client's bytes wait for the line: the span within which the UART can want more.
    pub(super) fn low(&self) -> Option<Span> {
        if self.queued == 0 {
            return None;
        }
        let low = BITS_PER_CHARACTER * DRIVER_LOW as u64 * 1_000_000_000 / u64::from(self.settings.baud.max(1));
        Some(Span::from_nanos(low).max(SLICE_MIN))
    }

    /// Whether what comes from the client follows on what came before: that is not all sent yet.
    pub(super) const fn is_sending(&self) -> bool {
        self.queued > 0
    }

    /// How many of the client's bytes the driver takes; the others stay in the kernel.
    pub(super) const fn room(&self) -> usize {
        if self.queued > DRIVER_LOW { 0 } else { DRIVER_QUEUE - self.queued }
    }

    /// Waits for something from the client. Cancel-safe.
    pub(super) async fn event(&mut self) -> std::io::Result<PortEvent> {
        let room = self.room();
        self.port.event(room).await
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
                Exchange::Received(byte, _) | Exchange::Garbled(byte) => received.push(*byte),
            }
        }
        if received.is_empty() {
            return Ok(());
        }
        // A client that has only changed its speed since it last wrote is to be heard at the new one.
        self.configure(now, session)?;
        let lost = self.port.write(&received);
        if lost > 0 {
            tracing::warn!("the program at the {} port does not read: {lost} bytes are lost", self.name);
        }
        Ok(())
    }

    /// Takes what has come from the client.
    pub(super) fn take(&mut self, event: PortEvent, at: Instant, session: &mut Session) -> Result<(), SessionError> {
        log::set_time(at);
        self.began &= !matches!(event, PortEvent::Opened | PortEvent::Closed);
        self.configure(at, session)?;
        match event {
            PortEvent::Data(bytes) => {
                self.queued += bytes.len();
                session.stimulate(self.node, at, Stimulus::Write(bytes));
            }
            PortEvent::Flushed => {
                self.queued = 0;
                session.stimulate(self.node, at, Stimulus::Discard);
            }
            PortEvent::Opened => tracing::info!("the {} port has been opened", self.name),
            PortEvent::Began => self.begin(at, session)?,
            PortEvent::FlowControl => {}
            PortEvent::Closed => tracing::info!("the {} port has been closed", self.name),
        }
        Ok(())
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
            let LineSettings { baud, .. } = self.settings;
            self.settings.ixon = false;
            session.stimulate(self.node, at, Stimulus::Configure { baud, ixon: false });
        }
        self.configure(at, session)
    }

    /// Sets the UART to what the client has set. What the one before has left is still sent as that one wanted.
    fn configure(&mut self, at: Instant, session: &mut Session) -> Result<(), SessionError> {
        if self.port.leftover() > 0 || (!self.began && self.queued > 0) {
            return Ok(());
        }
        let settings = self.port.settings()?;
        if settings != self.settings {
            self.settings = settings;
            let LineSettings { baud, ixon } = settings;
            let (name, flow) = (&self.name, if ixon { "on" } else { "off" });
            tracing::info!("the program at the {name} port sets {baud} baud, XON/XOFF {flow}");
            session.stimulate(self.node, at, Stimulus::Configure { baud, ixon });
        }
        Ok(())
    }
}
