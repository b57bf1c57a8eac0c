//! Taps: ports at which a program outside hears what is on a line of the rig.

use std::future::{Future, poll_fn};
use std::io;
use std::task::Poll;

use torno_bus::Ears;
use torno_engine::LineId;
use torno_protocol::layout::Layout;
use torno_protocol::time::Instant;

use super::unread::Unread;
use crate::session::Happened;
use torno_port::{PcPort, PortEvent};

/// The taps of a rig.
pub(super) struct Taps {
    ears: Ears,
    taps: Vec<Tap>,
}

struct Tap {
    /// The line that is heard, and its name.
    line: LineId,
    name: String,
    /// Where it is heard.
    port: PcPort,
    unread: Unread,
}

impl Tap {
    /// A client comes or goes; what it writes goes nowhere.
    fn take(&mut self, event: &PortEvent) {
        if *event == PortEvent::Opened {
            tracing::info!("a program listens to {}", self.name);
            self.unread.forget();
        }
    }
}

impl Taps {
    /// Taps at these lines.
    pub(super) fn new(layout: &Layout, taps: Vec<(LineId, PcPort)>) -> Self {
        let name = |line: LineId| layout.lines[line].name.clone();
        let tap = |(line, port)| Tap { line, name: name(line), port, unread: Unread::default() };
        let taps = taps.into_iter().map(tap).collect();
        Self { ears: Ears::new(layout), taps }
    }

    /// The ports, with the names of their lines.
    pub(super) fn ports(&self) -> impl Iterator<Item = (&str, &PcPort)> {
        self.taps.iter().map(|tap| (tap.name.as_str(), &tap.port))
    }

    /// Takes note of what has happened.
    pub(super) fn note(&mut self, happened: &Happened) {
        if !self.taps.is_empty() {
            self.ears.note(&happened.inputs, &happened.facts);
            self.deliver(happened.settled);
        }
    }

    /// Passes on what has been heard before `until`. Everything before that has happened.
    pub(super) fn deliver(&mut self, until: Instant) {
        if self.taps.is_empty() {
            return;
        }
        let heard = self.ears.hear(until);
        for Tap { line, name, port, unread } in &mut self.taps {
            let bytes: Vec<u8> =
                heard.iter().filter(|heard| heard.line == *line).map(|heard| heard.character.byte).collect();
            let lost = if bytes.is_empty() { 0 } else { port.write(&bytes) };
            if let Some(lost) = unread.add(lost) {
                tracing::warn!("the program at the tap of {name} does not read: {lost} bytes are lost");
            }
        }
    }

    /// Lets clients in and out; what they write goes nowhere.
    pub(super) fn attend(&mut self) -> io::Result<()> {
        for tap in &mut self.taps {
            while let Some(event) = tap.port.try_event(usize::MAX, None)? {
                tap.take(&event);
            }
        }
        Ok(())
    }

    /// Waits for a client to come or to go. Cancel-safe.
    pub(super) async fn event(&mut self) -> io::Result<()> {
        let attend = async |tap: &mut Tap| {
            let event = tap.port.event(usize::MAX, None).await?;
            tap.take(&event);
            Ok(())
        };
        let mut events: Vec<_> = self.taps.iter_mut().map(|tap| Box::pin(attend(tap))).collect();
        poll_fn(|context| {
            for event in &mut events {
                if let Poll::Ready(event) = event.as_mut().poll(context) {
                    return Poll::Ready(event);
                }
            }
            Poll::Pending
        })
        .await
    }
}
