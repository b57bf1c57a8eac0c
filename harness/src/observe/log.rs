//! The log: what the boards tell, on standard error, stamped with virtual time.

use std::fmt;
use std::io::IsTerminal;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use torno_protocol::board::event_text;
use torno_protocol::time::Instant;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::FormatTime;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

use crate::rig::Rig;
use torno_engine::Fact;

/// The virtual time of the last thing logged, in nanoseconds.
static NOW: AtomicU64 = AtomicU64::new(0);

struct VirtualTime;

impl FormatTime for VirtualTime {
    fn format_time(&self, writer: &mut Writer<'_>) -> fmt::Result {
        let now = Instant::from_nanos(NOW.load(Ordering::Relaxed));
        write!(writer, "{:>14}", now.to_string())
    }
}

/// Starts logging to standard error. `RUST_LOG` says what; without it, `default` does.
pub fn init(default: &str) {
    let wanted = std::env::var("RUST_LOG").unwrap_or_default();
    let wanted = if wanted.trim().is_empty() { default } else { &wanted };
    let filter: Targets = wanted.parse().or_else(|_| default.parse()).unwrap_or_default();
    let lines = tracing_subscriber::fmt::layer()
        .with_timer(VirtualTime)
        .with_target(false)
        .with_ansi(std::io::stderr().is_terminal())
        .with_writer(std::io::stderr);
    // A second call, in a test, changes nothing.
    tracing_subscriber::registry().with(filter).with(lines).try_init().ok();
}

/// Sets the stamp of what is logged next.
pub fn set_time(now: Instant) {
    NOW.store(now.as_nanos(), Ordering::Relaxed);
}

/// Warns that this computer is so far behind the pace, in wall time, and that time goes on from `due` all the same.
pub fn behind(due: Instant, by: Duration) {
    set_time(due);
    tracing::warn!("this computer is {:.1} s behind; going on from here", by.as_secs_f64());
}

/// Warns that a fault has begun.
pub fn begun(fault: &str, since: Instant) {
    set_time(since);
    tracing::warn!("fault '{fault}' begins");
}

/// Logs a fact: events of boards, and on the finest level each byte of the PC.
pub fn log(rig: &Rig, fact: &Fact) {
    let Fact::Event { node, at, event, value } = fact else { return };
    let board = &rig.nodes()[*node];
    let Some(text) = board.description.events.get(usize::from(*event)) else { return };
    set_time(*at);
    if rig.layout().boards[*node].is_gateway() {
        tracing::trace!("{}: {}", board.name, event_text(text, *value));
    } else {
        tracing::info!("{}: {}", board.name, event_text(text, *value));
    }
}
