//! Two rigs side by side: what their buses cost.

use std::fmt;

use anstyle::{AnsiColor, Style};
use serde::Serialize;

use crate::observe::{Account, Axis, Spread};
use torno_protocol::time::Span;

/// One program on two rigs; as JSON, one object on one line.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// The program.
    pub program: String,
    /// Its frames.
    pub frames: usize,
    /// The rigs.
    pub rigs: [Side; 2],
    rows: Vec<ComparedQuantity>,
}

/// How the program ended on one rig.
#[derive(Clone, Debug, Serialize)]
pub struct Side {
    /// The rig.
    pub rig: String,
    /// What was set in it.
    pub set: Vec<String>,
    /// `completed`, `rejected`, `faulted`, `unanswered`.
    pub outcome: &'static str,
    /// The digest of everything that happened.
    pub digest: String,
    /// Virtual seconds until the rig was quiet.
    pub virtual_s: f64,
    /// What the buses have cost.
    #[serde(skip)]
    pub account: Account,
}

/// One quantity of both.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct ComparedQuantity {
    quantity: String,
    unit: &'static str,
    /// None: the rig has no such thing, or it did not come to it.
    values: [Option<f64>; 2],
    /// The second less the first.
    difference: Option<f64>,
    /// The second over the first.
    ratio: Option<f64>,
    /// For people.
    #[serde(skip)]
    digits: usize,
}

impl ComparedQuantity {
    fn new(quantity: impl Into<String>, unit: &'static str, digits: usize, values: [Option<f64>; 2]) -> Self {
        let both = values[0].zip(values[1]);
        let ratio = both.filter(|(a, b)| *a != 0.0 && a.signum() == b.signum()).map(|(a, b)| b / a);
        Self { quantity: quantity.into(), unit, values, difference: both.map(|(a, b)| b - a), ratio, digits }
    }
}

impl Comparison {
    /// Of a program of so many frames on two rigs.
    pub fn new(program: String, frames: usize, rigs: [Side; 2]) -> Self {
        let rows = rows(&rigs);
        Self { program, frames, rigs, rows }
    }

    /// The program went through on both.
    pub fn completed(&self) -> bool {
        self.rigs.iter().all(|side| side.outcome == "completed")
    }
}

/// For people, with the colours of a terminal: what writes it elsewhere strips them.
impl fmt::Display for Comparison {
    fn fmt(&self, text: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (bold, dim) = (Style::new().bold(), Style::new().dimmed());
        let label = |row: &ComparedQuantity| {
            if row.unit.is_empty() { row.quantity.clone() } else { format!("{}, {}", row.quantity, row.unit) }
        };
        let first = self.rows.iter().map(|row| label(row).chars().count()).max().unwrap_or_default();
        let widths = [0, 1].map(|n: usize| self.rigs[n].rig.chars().count().max(10));
        writeln!(text, "{:<9}{}, {} frames", "program", self.program, self.frames)?;
        for side in self.rigs.iter().filter(|side| !side.set.is_empty()) {
            writeln!(text, "{:<9}{}: {}", "set", side.rig, side.set.join(", "))?;
        }
        let [a, b] = [&self.rigs[0].rig, &self.rigs[1].rig];
        let [wide_a, wide_b] = widths;
        writeln!(
            text,
            "\n{bold}{:<first$}  {a:>wide_a$}  {b:>wide_b$}  {:>11}  {:>7}{bold:#}",
            "", "difference", "ratio"
        )?;
        let outcome = |n: usize| {
            let side = &self.rigs[n];
            let colour = if side.outcome == "completed" { AnsiColor::Green } else { AnsiColor::Red };
            let (style, width) = (colour.on_default(), widths[n]);
            format!("{style}{:>width$}{style:#}", side.outcome)
        };
        writeln!(text, "{:<first$}  {}  {}", "outcome", outcome(0), outcome(1))?;
        for row in &self.rows {
            let digits = row.digits;
            let value = |n: usize| row.values[n].map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"));
            let difference = row.difference.map_or_else(String::new, |by| format!("{:+.digits$}", by + 0.0));
            let ratio = row.ratio.map_or_else(String::new, |ratio| format!("{ratio:.3}"));
            let (a, b) = (value(0), value(1));
            write!(text, "{:<first$}  {a:>wide_a$}  {b:>wide_b$}", label(row))?;
            let rest = format!("  {difference:>11}  {ratio:>7}");
            writeln!(text, "{dim}{}{dim:#}", rest.trim_end())?;
        }
        Ok(())
    }
}

fn rows(rigs: &[Side; 2]) -> Vec<ComparedQuantity> {
    let of = |what: &dyn Fn(&Side) -> Option<f64>| [what(&rigs[0]), what(&rigs[1])];
    let seconds = |what: fn(&Account) -> Span| of(&|side| Some(what(&side.account).as_secs_f64()));
    let mut rows = vec![
        ComparedQuantity::new("boards", "", 0, of(&|side| Some(side.account.boards as f64))),
        ComparedQuantity::new("whole program", "s", 3, of(&|side| Some(side.virtual_s))),
        ComparedQuantity::new("the PC is held", "s", 3, seconds(|account| account.held)),
    ];
    type Of = fn(&Account) -> Spread;
    let spreads: [(&str, Of); 4] = [
        ("last byte to ACK, not held", |account| account.answer),
        ("XON to ACK of the frame held", |account| account.held_answer),
        ("ACK to XON", |account| account.execution),
        ("last byte to XON", |account| account.whole),
    ];
    for (name, spread) in spreads {
        let mean = of(&|side| spread(&side.account).mean_s().map(|mean| mean * 1e3));
        let worst = of(&|side| {
            let spread = spread(&side.account);
            spread.mean_s().map(|_| spread.worst.as_secs_f64() * 1e3)
        });
        rows.push(ComparedQuantity::new(name, "ms", 3, mean));
        rows.push(ComparedQuantity::new(format!("{name}, longest"), "ms", 3, worst));
    }
    rows.extend(axis_rows(rigs));
    for (n, name) in ["from the PC", "to the PC"].into_iter().enumerate() {
        rows.push(ComparedQuantity::new(name, "bytes", 0, of(&|side| Some(side.account.pc_bytes[n] as f64))));
    }
    let between = |side: &Side| side.account.bytes.values().sum::<u64>() as f64;
    rows.push(ComparedQuantity::new("between boards", "bytes", 0, of(&|side| Some(between(side)))));
    let lines = union(rigs, |account| account.bytes.keys().cloned().collect());
    for line in lines {
        let bytes = of(&|side| side.account.bytes.get(&line).map(|bytes| *bytes as f64));
        rows.push(ComparedQuantity::new(format!("  {line}"), "bytes", 0, bytes));
    }
    rows
}

fn axis_rows(rigs: &[Side; 2]) -> Vec<ComparedQuantity> {
    let names = union(rigs, |account| account.axes.iter().map(|axis| axis.name.clone()).collect());
    let row = |name: &String, what: &str, of: fn(&Axis) -> Option<i64>| {
        let found = |side: &Side| side.account.axes.iter().find(|axis| axis.name == *name).and_then(of);
        let values = [0, 1].map(|n: usize| found(&rigs[n]).map(|value| value as f64));
        let row = ComparedQuantity::new(format!("{name}: {what}"), "counts", 0, values);
        row.values.iter().any(Option::is_some).then_some(row)
    };
    let following = names.iter().filter_map(|name| row(name, "worst following error", |axis| axis.following_error));
    let ends = names.iter().filter_map(|name| row(name, "ends at", |axis| Some(axis.position)));
    following.chain(ends).collect()
}

/// Names of the first, and what the second has beyond them.
fn union(rigs: &[Side; 2], names: impl Fn(&Account) -> Vec<String>) -> Vec<String> {
    let mut all = names(&rigs[0].account);
    all.extend(names(&rigs[1].account));
    let mut seen = std::collections::BTreeSet::new();
    all.retain(|name| seen.insert(name.clone()));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_one_rig_has_not_has_neither_difference_nor_ratio() {
        let row = |values| ComparedQuantity::new("bytes", "", 0, values);
        let found = |row: ComparedQuantity| (row.difference, row.ratio);
        assert_eq!(found(row([Some(4.0), Some(1.0)])), (Some(-3.0), Some(0.25)));
        assert_eq!(found(row([Some(0.0), Some(1.0)])), (Some(1.0), None));
        assert_eq!(found(row([Some(-2.0), Some(1.0)])), (Some(3.0), None), "a ratio of what?");
        assert_eq!(found(row([Some(4.0), None])), (None, None));
    }
}
