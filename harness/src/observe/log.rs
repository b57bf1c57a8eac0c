//! The log: what the boards tell, and what happens to their rig, on standard error, stamped with virtual time.
//!
//! What a line is about goes with it in fields: `board`, `event` and `value` of what a board tells, the virtual time
//! `ns`, and others. The text form shows the message alone; the JSON form shows everything, and the spans around it.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use anstream::{AutoStream, ColorChoice};
use anstyle::{AnsiColor, Style};
use serde::Serialize;
use serde_json::Value;
use torno_protocol::board::event_text;
use torno_protocol::time::Instant;
use tracing::field::{Field, Visit};
use tracing::level_filters::LevelFilter;
use tracing::subscriber::Interest;
use tracing::{Event, Level, Metadata, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields, FormattedFields, MakeWriter};
use tracing_subscriber::layer::{Context, Filter, SubscriberExt};
use tracing_subscriber::registry::LookupSpan;
use tracing_subscriber::util::SubscriberInitExt;

use super::stderr;
use crate::rig::{Incident, Rig};
use torno_engine::NodeId;

/// The target of what is said about one board. A target is fixed in the program, and boards are not: which board it is
/// stands in the field `board`, and [`Wanted`] takes that for a target too.
const BOARD: &str = "torno::board";

/// The virtual time of the last thing logged, in nanoseconds.
static NOW: AtomicU64 = AtomicU64::new(0);

/// The form of the log.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Form {
    /// A line of text for each message.
    #[default]
    Text,
    /// A JSON object for each message, one a line.
    Json,
}

/// Starts logging to standard error, which never holds anything up. `RUST_LOG` says what is logged; without it,
/// `default` does.
pub fn init(default: &str, form: Form) {
    let wanted = std::env::var("RUST_LOG").unwrap_or_default();
    let wanted = if wanted.trim().is_empty() { default } else { &wanted };
    let wanted = Wanted(wanted.parse().or_else(|_| default.parse()).unwrap_or_default());
    // A second call, in a test, changes nothing.
    let ansi = AutoStream::choice(&std::io::stderr()) != ColorChoice::Never;
    let lines = stderr::for_log(match form {
        Form::Text => |lost| dropped(lost).text(),
        Form::Json => |lost| dropped(lost).json(),
    });
    subscriber(wanted, form, ansi, move || lines.clone()).try_init().ok();
}

fn subscriber<W>(wanted: Wanted, form: Form, ansi: bool, to: W) -> impl Subscriber + Send + Sync
where
    W: for<'a> MakeWriter<'a> + Send + Sync + 'static,
{
    let lines = tracing_subscriber::fmt::layer().with_ansi(ansi).with_writer(to);
    let lines = match form {
        Form::Text => lines.event_format(Text).boxed(),
        Form::Json => lines.event_format(Json).fmt_fields(Json).boxed(),
    };
    tracing_subscriber::registry().with(lines.with_filter(wanted))
}

/// Sets the stamp of what is logged next.
pub fn set_time(now: Instant) {
    NOW.store(now.as_nanos(), Ordering::Relaxed);
}

/// Warns that this computer is so far behind the pace, in wall time, and that time goes on from `due` all the same.
pub fn behind(due: Instant, by: Duration) {
    set_time(due);
    let by_s = by.as_secs_f64();
    tracing::warn!(ns = due.as_nanos(), by_s, "this computer is {by_s:.1} s behind; going on from here");
}

/// Warns that a fault has begun.
pub fn begun(fault: &str, since: Instant) {
    set_time(since);
    tracing::warn!(ns = since.as_nanos(), fault, "fault '{fault}' begins");
}

/// Warns of what has become of a board's process.
pub fn incident(incident: &Incident) {
    let Incident { at, board, pid, .. } = incident;
    set_time(*at);
    tracing::warn!(target: BOARD, ns = at.as_nanos(), board, pid, "{incident}");
}

/// Logs an event of a board and, on the finest level, of a gateway.
pub fn event(rig: &Rig, node: NodeId, at: Instant, event: u8, value: i64) {
    let board = &rig.nodes()[node];
    let Some(text) = board.description.events.get(usize::from(event)) else { return };
    set_time(at);
    tell(rig.layout().boards[node].is_gateway(), at, &board.name, text, value);
}

fn tell(is_gateway: bool, at: Instant, board: &str, event: &str, value: i64) {
    let ns = at.as_nanos();
    if is_gateway {
        tracing::trace!(target: BOARD, ns, board, event, value, "{}", event_text(event, value));
    } else {
        tracing::info!(target: BOARD, ns, board, event, value, "{}", event_text(event, value));
    }
}

/// What is to be logged, as `RUST_LOG` says it. The name of a board is a target for what is said about that board, and
/// goes before all other targets: `warn,depth=info`.
struct Wanted(Targets);

impl Wanted {
    /// The most that any target wants.
    fn most(&self) -> LevelFilter {
        let default = self.0.default_level().unwrap_or(LevelFilter::OFF);
        self.0.iter().map(|(_, level)| level).fold(default, Ord::max)
    }

    fn wants_of(&self, board: &str, level: &Level) -> bool {
        match self.0.iter().find(|(target, _)| *target == board) {
            Some((_, most)) => *level <= most,
            None => self.0.would_enable(BOARD, level),
        }
    }
}

impl<S: Subscriber> Filter<S> for Wanted {
    fn enabled(&self, metadata: &Metadata<'_>, _: &Context<'_, S>) -> bool {
        // Spans are for all messages in them.
        metadata.is_span() || metadata.target() == BOARD || self.0.would_enable(metadata.target(), metadata.level())
    }

    fn callsite_enabled(&self, metadata: &'static Metadata<'static>) -> Interest {
        if metadata.is_event() && metadata.target() == BOARD {
            let all = *metadata.level() <= self.most();
            return if all { Interest::sometimes() } else { Interest::never() };
        }
        let wanted = metadata.is_span() || self.0.would_enable(metadata.target(), metadata.level());
        if wanted { Interest::always() } else { Interest::never() }
    }

    fn event_enabled(&self, event: &Event<'_>, _: &Context<'_, S>) -> bool {
        if event.metadata().target() != BOARD {
            return true;
        }
        let mut board = Board::default();
        event.record(&mut board);
        self.wants_of(&board.0, event.metadata().level())
    }

    fn max_level_hint(&self) -> Option<LevelFilter> {
        Some(self.most())
    }
}

/// The board that a message is about.
#[derive(Default)]
struct Board(String);

impl Visit for Board {
    fn record_debug(&mut self, _: &Field, _: &dyn fmt::Debug) {}

    fn record_str(&mut self, field: &Field, value: &str) {
        if field.name() == "board" {
            value.clone_into(&mut self.0);
        }
    }
}

/// What a message says.
#[derive(Default, Serialize)]
struct LogLine {
    ns: u64,
    level: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    board: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    event: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    value: Option<i64>,
    message: String,
    #[serde(flatten)]
    others: BTreeMap<&'static str, Value>,
    /// Of each span around it, its fields.
    #[serde(flatten)]
    spans: BTreeMap<&'static str, Value>,
}

impl LogLine {
    fn by(event: &Event<'_>) -> Self {
        let level = event.metadata().level().as_str();
        let mut said = Self { ns: NOW.load(Ordering::Relaxed), level, ..Self::default() };
        event.record(&mut said);
        said
    }
}

impl LogLine {
    /// As a line of text without colours.
    fn text(&self) -> String {
        let time = Instant::from_nanos(self.ns).to_string();
        format!("{time:>14} {:>5} {}\n", self.level, self.message)
    }

    /// As a line of JSON.
    fn json(&self) -> String {
        serde_json::to_string(self).unwrap_or_default() + "\n"
    }
}

impl Visit for LogLine {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        self.record_str(field, &format!("{value:?}"));
    }

    fn record_str(&mut self, field: &Field, value: &str) {
        match field.name() {
            "message" => self.message = value.to_owned(),
            "board" => self.board = Some(value.to_owned()),
            "event" => self.event = Some(value.to_owned()),
            name => drop(self.others.insert(name, value.into())),
        }
    }

    fn record_i64(&mut self, field: &Field, value: i64) {
        match field.name() {
            "value" => self.value = Some(value),
            name => drop(self.others.insert(name, value.into())),
        }
    }

    fn record_u64(&mut self, field: &Field, value: u64) {
        match field.name() {
            "ns" => self.ns = value,
            name => drop(self.others.insert(name, value.into())),
        }
    }

    fn record_f64(&mut self, field: &Field, value: f64) {
        self.others.insert(field.name(), value.into());
    }

    fn record_bool(&mut self, field: &Field, value: bool) {
        self.others.insert(field.name(), value.into());
    }
}

/// That so many lines have been dropped.
fn dropped(lines: u64) -> LogLine {
    let message = format!("{lines} lines dropped: no one reads standard error");
    LogLine { ns: NOW.load(Ordering::Relaxed), level: Level::WARN.as_str(), message, ..LogLine::default() }
}

struct Text;

impl<S, N> FormatEvent<S, N> for Text
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(&self, _: &FmtContext<'_, S, N>, mut writer: Writer<'_>, event: &Event<'_>) -> fmt::Result {
        let LogLine { ns, level, board, event, message, others, .. } = LogLine::by(event);
        let (dim, colour) = match writer.has_ansi_escapes() {
            true => (Style::new().dimmed(), colour(level)),
            false => (Style::new(), Style::new()),
        };
        let time = Instant::from_nanos(ns).to_string();
        write!(writer, "{dim}{time:>14}{dim:#} {colour}{level:>5}{colour:#} ")?;
        if let (Some(board), Some(_)) = (board, event) {
            write!(writer, "{board}: ")?;
        }
        writer.write_str(&message)?;
        if let Some(Value::String(error)) = others.get("error") {
            write!(writer, " error={error}")?;
        }
        writeln!(writer)
    }
}

fn colour(level: &str) -> Style {
    let colour = match level {
        "ERROR" => AnsiColor::Red,
        "WARN" => AnsiColor::Yellow,
        "INFO" => AnsiColor::Green,
        "DEBUG" => AnsiColor::Blue,
        _ => AnsiColor::Magenta,
    };
    colour.on_default()
}

struct Json;

impl<S, N> FormatEvent<S, N> for Json
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(&self, context: &FmtContext<'_, S, N>, mut writer: Writer<'_>, event: &Event<'_>) -> fmt::Result {
        let mut said = LogLine::by(event);
        for span in context.event_scope().into_iter().flatten() {
            let extensions = span.extensions();
            let fields = extensions.get::<FormattedFields<N>>().map_or("{}", |fields| fields.as_str());
            said.spans.insert(span.name(), serde_json::from_str(fields).unwrap_or_default());
        }
        writeln!(writer, "{}", serde_json::to_string(&said).map_err(|_| fmt::Error)?)
    }
}

/// The fields of a span.
impl<'writer> FormatFields<'writer> for Json {
    fn format_fields<R: tracing_subscriber::field::RecordFields>(
        &self,
        mut writer: Writer<'writer>,
        fields: R,
    ) -> fmt::Result {
        let mut said = LogLine::default();
        fields.record(&mut said);
        write!(writer, "{}", serde_json::to_string(&said.others).map_err(|_| fmt::Error)?)
    }
}

#[cfg(test)]
mod tests {
    use std::io;
    use std::sync::{Arc, Mutex};

    use super::*;

    #[derive(Clone, Default)]
    struct Lines(Arc<Mutex<Vec<u8>>>);

    impl io::Write for Lines {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().unwrap().write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    /// What is written of the same messages, in this form.
    fn written(wanted: &str, form: Form, ansi: bool) -> String {
        let lines = Lines::default();
        let to = lines.clone();
        let subscriber = subscriber(Wanted(wanted.parse().unwrap()), form, ansi, move || to.clone());
        tracing::subscriber::with_default(subscriber, || {
            let _rig = tracing::error_span!("rig", name = "lathe").entered();
            let at = Instant::from_nanos;
            tell(false, at(1_500_000), "master", "frame {} accepted", 7);
            tell(false, at(2_000_000), "depth", "done", 0);
            tell(true, at(3_000_000), "pc", "sends {}", 10);
            begun("noise", at(4_000_000));
            let (board, what) = ("depth".to_owned(), crate::rig::ProcessChange::Stopped);
            incident(&Incident { at: at(5_000_000), board, pid: 9, what });
        });
        let bytes = lines.0.lock().unwrap().clone();
        String::from_utf8(bytes).unwrap()
    }

    const MASTER: &str = "     0.001500s  INFO master: frame 7 accepted\n";
    const DEPTH: &str = "     0.002000s  INFO depth: done\n";
    const PC: &str = "     0.003000s TRACE pc: sends 10\n";
    const FAULT: &str = "     0.004000s  WARN fault 'noise' begins\n";
    const STOPPED: &str = "     0.005000s  WARN board 'depth' (pid 9) was stopped: it hangs\n";

    #[test]
    fn a_board_is_a_target_and_goes_before_the_others() {
        for (wanted, expected) in [
            ("trace", vec![MASTER, DEPTH, PC, FAULT, STOPPED]),
            ("info", vec![MASTER, DEPTH, FAULT, STOPPED]),
            ("warn", vec![FAULT, STOPPED]),
            ("error", vec![]),
            ("master=info", vec![MASTER]),
            ("depth=info", vec![DEPTH, STOPPED]),
            ("depth=warn", vec![STOPPED]),
            ("warn,master=info", vec![MASTER, FAULT, STOPPED]),
            ("info,depth=off", vec![MASTER, FAULT]),
            ("pc=trace", vec![PC]),
            ("torno=trace", vec![MASTER, DEPTH, PC, FAULT, STOPPED]),
            // The beginning of a name is not the name.
            ("mast=info", vec![]),
            ("masters=info", vec![]),
        ] {
            assert_eq!(written(wanted, Form::Text, false), expected.concat(), "{wanted}");
        }
    }

    #[test]
    fn a_terminal_gets_colours() {
        let text = written("warn", Form::Text, true);
        let expected = "\u{1b}[2m     0.004000s\u{1b}[0m \u{1b}[33m WARN\u{1b}[0m fault 'noise' begins\n";
        assert_eq!(text.split_inclusive('\n').next(), Some(expected));
    }

    #[test]
    fn json_has_everything_in_fields() {
        let text = written("master=info,pc=trace,torno=warn", Form::Json, false);
        let rig = r#","rig":{"name":"lathe"}}"#;
        let (frame, sends) = ("\"event\":\"frame {} accepted\"", "\"event\":\"sends {}\"");
        let stopped = "\"message\":\"board 'depth' (pid 9) was stopped: it hangs\"";
        let expected = [
            format!(
                r#"{{"ns":1500000,"level":"INFO","board":"master",{frame},"value":7,"message":"frame 7 accepted"{rig}"#
            ),
            format!(r#"{{"ns":3000000,"level":"TRACE","board":"pc",{sends},"value":10,"message":"sends 10"{rig}"#),
            format!(r#"{{"ns":4000000,"level":"WARN","message":"fault 'noise' begins","fault":"noise"{rig}"#),
            format!(r#"{{"ns":5000000,"level":"WARN","board":"depth",{stopped},"pid":9{rig}"#),
        ];
        assert_eq!(text.lines().collect::<Vec<_>>(), expected);
    }
}
