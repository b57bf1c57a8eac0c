//! A bus analyser: makes rows of what happens in a rig, afterwards or while it happens.

use torno_protocol::time::Instant;

use super::rows::{Filter, Kind, Row};
use super::{Header, Trace};
use torno_bus::{Dialects, Ears, Readers};
use torno_engine::{Fact, Input};

/// What the filter shows of a trace, in order of time.
pub fn rows(trace: &Trace, filter: &Filter, dialects: Dialects) -> Vec<Row> {
    let mut analyser = Analyser::new(&trace.header, filter.clone(), dialects);
    analyser.note(&trace.inputs, &trace.facts);
    analyser.end()
}

/// A bus analyser.
#[derive(Debug)]
pub struct Analyser {
    header: Header,
    filter: Filter,
    /// Who hears and reads the lines, if anybody wants to know.
    lines: Option<(Ears, Readers)>,
    /// What is not settled yet.
    rows: Vec<Row>,
}

impl Analyser {
    /// An analyser of a rig like this, from now on.
    pub fn new(header: &Header, filter: Filter, dialects: Dialects) -> Self {
        let reads = filter.kinds.contains(&Kind::Characters) || filter.kinds.contains(&Kind::Frames);
        let lines = reads.then(|| (Ears::new(&header.layout), Readers::new(&header.layout, dialects)));
        Self { header: header.clone(), filter, lines, rows: Vec::new() }
    }

    /// The same with ears that have heard of what came before.
    #[must_use]
    pub fn with_ears(self, ears: &Ears) -> Self {
        Self { lines: self.lines.map(|(_, readers)| (ears.clone(), readers)), ..self }
    }

    /// Takes note of what came from outside and of what happened.
    pub fn note(&mut self, inputs: &[Input], facts: &[Fact]) {
        self.rows.extend(inputs.iter().map(|input| Row::of_input(&self.header, input)));
        let edges = self.filter.kinds.contains(&Kind::Edges);
        let wanted = facts.iter().filter(|fact| edges || !matches!(fact, Fact::Edges { .. }));
        self.rows.extend(wanted.flat_map(|fact| Row::of_fact(&self.header, fact)));
        if let Some((ears, _)) = &mut self.lines {
            ears.note(inputs, facts);
        }
    }

    /// The rows before `until`, in order of time. Nothing before it is still to be noted. A message that was cut short
    /// comes when that shows.
    pub fn take(&mut self, until: Instant) -> Vec<Row> {
        if let Some((ears, readers)) = &mut self.lines {
            let heard = ears.hear(until);
            self.rows.extend(heard.iter().map(Row::character));
            readers.hear(&heard);
            self.rows.extend(readers.take().into_iter().map(Row::message));
        }
        self.rows.retain(|row| self.filter.shows(row));
        self.rows.sort_by_key(|row| row.at);
        let due = self.rows.partition_point(|row| row.at < until);
        self.rows.drain(..due).collect()
    }

    /// The rest: nothing more will come.
    pub fn end(mut self) -> Vec<Row> {
        let mut rows = self.take(Instant::NEVER);
        if let Some((_, readers)) = &mut self.lines {
            readers.end();
            self.rows.extend(readers.take().into_iter().map(Row::message));
            rows.extend(self.take(Instant::NEVER));
            rows.sort_by_key(|row| row.at);
        }
        rows
    }
}
