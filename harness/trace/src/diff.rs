//! Finds where two traces part.
//!
//! Facts of different lines and boards are settled in an order that means nothing, so each line and each board is
//! compared with its namesake, and of all differences the earliest is told.

use serde_json::{Value, json};
use torno_protocol::line::Level;
use torno_protocol::time::Instant;

use super::Trace;
use super::analyser::rows;
use super::rows::{Filter, Row, RowPlace, UnknownName, Wanted};
use torno_bus::{Dialects, Readers};
use torno_engine::Fact;

/// Rows before a difference that are shown.
const CONTEXT: usize = 5;

/// Where two traces part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// When.
    pub at: Instant,
    /// The line or the board.
    pub place: String,
    /// What the one trace has there; none if it has nothing more.
    pub a: Option<Side>,
    /// What the other has.
    pub b: Option<Side>,
    /// What both have before, as text.
    pub context: Vec<String>,
}

/// What a trace has at a difference.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Side {
    /// When.
    pub at: Instant,
    /// What.
    pub what: String,
}

/// What is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// All of both.
    Whole,
    /// All of the first, of which the end is missing: the second may have more.
    Beginning,
}

/// One thing in the life of a line or a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Moment<'a> {
    Edge { at: Instant, level: Level },
    Other(&'a Fact),
}

impl Moment<'_> {
    fn at(&self) -> Instant {
        match self {
            Self::Edge { at, .. } => *at,
            Self::Other(fact) => fact.at(),
        }
    }

    /// The same in two traces, in which lines and boards may have other numbers.
    fn is(&self, own: &Trace, other: &Self, others: &Trace) -> bool {
        match (self, other) {
            (Self::Edge { .. }, Self::Edge { .. }) => self == other,
            (Self::Other(a), Self::Other(b)) => {
                let row = |trace: &Trace, fact: &Fact| Row::of_fact(&trace.header, fact).first().map(Row::what);
                let value = |fact: &Fact| match fact {
                    Fact::Telemetry { value, .. } | Fact::Event { value, .. } => Some(*value),
                    Fact::Edges { .. } | Fact::Pin { .. } => None,
                };
                let kind = core::mem::discriminant(*a) == core::mem::discriminant(*b);
                kind && self.at() == other.at() && value(a) == value(b) && row(own, a) == row(others, b)
            }
            _ => false,
        }
    }
}

/// What a line or a board is compared by.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Name {
    // Of what differs at one instant, the line is told.
    Line(String),
    Board(String),
}

impl Name {
    fn place_in(&self, trace: &Trace) -> Option<RowPlace> {
        match self {
            Self::Line(name) => trace.header.layout.line(name).map(RowPlace::Line),
            Self::Board(name) => trace.header.layout.board(name).map(RowPlace::Board),
        }
    }

    fn all_of(trace: &Trace) -> impl Iterator<Item = Self> {
        let lines = trace.header.layout.lines.iter().map(|line| Self::Line(line.name.clone()));
        lines.chain(trace.header.layout.boards.iter().map(|board| Self::Board(board.name.clone())))
    }
}

/// Where the lives of a line or a board part in two traces.
struct Parting<'a> {
    at: Instant,
    name: &'a Name,
    a: Option<Moment<'a>>,
    b: Option<Moment<'a>>,
}

/// The earliest difference, if there is one. `dialects` are for its text.
pub fn first_difference(a: &Trace, b: &Trace, extent: Extent, dialects: Dialects) -> Option<Difference> {
    let mut names: Vec<Name> = Name::all_of(a).chain(Name::all_of(b)).collect();
    names.sort();
    names.dedup();
    let (of_a, of_b) = (streams(a), streams(b));
    let none = Vec::new();
    let part = |name| -> Option<Parting<'_>> {
        let one = Name::place_in(name, a).map_or(&none, |place| of_a.of(place));
        let two = Name::place_in(name, b).map_or(&none, |place| of_b.of(place));
        let same = one.iter().zip(two).take_while(|(one, two)| one.is(a, two, b)).count();
        let (one, two) = (one.get(same).copied(), two.get(same).copied());
        if one.is_none() && extent == Extent::Beginning {
            return None;
        }
        let at = one.iter().chain(&two).map(Moment::at).min()?;
        Some(Parting { at, name, a: one, b: two })
    };
    // Of several at one instant this is the first.
    let Parting { at, name, a: one, b: two } = names.iter().filter_map(part).min_by_key(|parting| parting.at)?;
    Some(Difference {
        at,
        place: match name {
            Name::Line(name) | Name::Board(name) => name.clone(),
        },
        a: one.map(|moment| side(a, name.place_in(a), moment, dialects)),
        b: two.map(|moment| side(b, name.place_in(b), moment, dialects)),
        context: context(a, at, dialects).unwrap_or_default(),
    })
}

struct Streams<'a> {
    lines: Vec<Vec<Moment<'a>>>,
    boards: Vec<Vec<Moment<'a>>>,
}

impl<'a> Streams<'a> {
    fn of(&self, place: RowPlace) -> &Vec<Moment<'a>> {
        match place {
            RowPlace::Line(line) => &self.lines[line],
            RowPlace::Board(board) => &self.boards[board],
        }
    }
}

fn streams(trace: &Trace) -> Streams<'_> {
    let mut streams = Streams {
        lines: vec![Vec::new(); trace.header.layout.lines.len()],
        boards: vec![Vec::new(); trace.header.layout.boards.len()],
    };
    for fact in &trace.facts {
        match fact {
            Fact::Edges { line, edges } => {
                let edges = edges.iter().map(|edge| Moment::Edge { at: edge.at, level: edge.level });
                streams.lines[*line].extend(edges);
            }
            Fact::Telemetry { node, .. } | Fact::Event { node, .. } | Fact::Pin { node, .. } => {
                streams.boards[*node].push(Moment::Other(fact));
            }
        }
    }
    streams
}

/// What a moment is, and of which character and message it is a part.
fn side(trace: &Trace, place: Option<RowPlace>, moment: Moment<'_>, dialects: Dialects) -> Side {
    let at = moment.at();
    let what = match moment {
        Moment::Other(fact) => Row::of_fact(&trace.header, fact).first().map_or_else(String::new, Row::what),
        Moment::Edge { level, .. } => {
            let mut what = format!("the line goes {}", if level == Level::High { "high" } else { "low" });
            let heard = trace.characters();
            let on_line = |line: usize| place == Some(RowPlace::Line(line));
            if let Some(character) = heard.iter().find(|heard| on_line(heard.line) && heard.at >= at) {
                what += &format!(", in character {}", Row::character(character).what());
                let messages = Readers::new(&trace.header.layout, dialects).messages(&heard);
                let message = messages.iter().find(|other| on_line(other.line) && other.at >= character.at);
                what += &message.map_or_else(String::new, |message| format!(", of {}", message.text));
            }
            what
        }
    };
    Side { at, what }
}

/// The last rows before `at`.
fn context(trace: &Trace, at: Instant, dialects: Dialects) -> Result<Vec<String>, UnknownName> {
    let filter = Filter::new(&trace.header, &Wanted::default())?;
    let mut rows = rows(trace, &filter, dialects);
    rows.retain(|row| row.at < at);
    let from = rows.len().saturating_sub(CONTEXT);
    Ok(rows[from..].iter().map(|row| row.text(&trace.header, false)).collect())
}

impl Difference {
    /// The difference for people, over a few lines. `a` and `b` are the names of the two traces.
    pub fn text(&self, a: &str, b: &str) -> String {
        let mut text = format!("first difference at {} on {}\n", seconds(self.at), self.place);
        self.context.iter().for_each(|row| text += &format!("  {row}\n"));
        for (name, side) in [(a, &self.a), (b, &self.b)] {
            let what = side
                .as_ref()
                .map_or_else(|| "nothing more".to_owned(), |side| format!("{}  {}", seconds(side.at), side.what));
            text += &format!("{name}: {what}\n");
        }
        text
    }

    /// The difference for programs. `ns` is in nanoseconds.
    pub fn json(&self) -> Value {
        let side =
            |side: &Option<Side>| side.as_ref().map(|side| json!({ "ns": side.at.as_nanos(), "what": side.what }));
        json!({
            "ns": self.at.as_nanos(),
            "place": self.place,
            "a": side(&self.a),
            "b": side(&self.b),
            "context": self.context,
        })
    }
}

fn seconds(at: Instant) -> String {
    let nanos = at.as_nanos();
    format!("{}.{:09} s", nanos / 1_000_000_000, nanos % 1_000_000_000)
}
