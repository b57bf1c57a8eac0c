//! What came of a sweep: how often each outcome came, for each combination of values.

use std::fmt::Write as _;

use serde::{Deserialize, Serialize};

use super::Run;
use crate::scenario::Outcome;

/// How a run of a sweep ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Everything held.
    Passed,
    /// Something did not, and the PC was told of a refusal or a failure.
    Told,
    /// Something did not, and nobody was told.
    Untold,
}

impl Verdict {
    /// Of a scenario's outcome.
    pub fn of(outcome: &Outcome) -> Self {
        let told = |reply: &String| reply.starts_with("NAK") || reply.starts_with("CAN");
        match outcome.failures.is_empty() {
            true => Self::Passed,
            false if outcome.replies.iter().any(told) => Self::Told,
            false => Self::Untold,
        }
    }
}

/// Counts of verdicts, a row for each combination of values.
#[derive(Clone, Debug, Default)]
pub struct Table {
    columns: Vec<String>,
    rows: Vec<(Vec<String>, [u64; 3])>,
}

impl Table {
    /// Of these runs, in the order of their first appearance.
    pub fn new(runs: &[Run]) -> Self {
        let mut table = Self::default();
        for run in runs {
            let values: Vec<String> = run.values.iter().map(|(_, value)| value.clone()).collect();
            table.columns = run.values.iter().map(|(path, _)| path.clone()).collect();
            let row = match table.rows.iter().position(|(other, _)| *other == values) {
                Some(row) => row,
                None => {
                    table.rows.push((values, [0; 3]));
                    table.rows.len() - 1
                }
            };
            table.rows[row].1[run.verdict as usize] += 1;
        }
        table
    }

    fn cells(&self) -> Vec<Vec<String>> {
        let heads = ["runs", "passed", "told", "untold"].map(str::to_owned);
        let head = self.columns.iter().cloned().chain(heads).collect();
        let row = |(values, counts): &(Vec<String>, [u64; 3])| {
            let total = counts.iter().sum::<u64>();
            values.iter().cloned().chain([total].iter().chain(counts).map(u64::to_string)).collect()
        };
        core::iter::once(head).chain(self.rows.iter().map(row)).collect()
    }

    /// Aligned, for people. `told`: something failed and the PC heard of it; `untold`: it did not.
    pub fn text(&self) -> String {
        let cells = self.cells();
        let columns = cells.first().map_or(0, Vec::len);
        let width = |column: usize| cells.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..columns).map(width).collect();
        let mut text = String::new();
        for row in &cells {
            let padded: Vec<String> = row.iter().zip(&widths).map(|(cell, width)| format!("{cell:>width$}")).collect();
            _ = writeln!(text, "{}", padded.join("  "));
        }
        text
    }

    /// As CSV.
    pub fn csv(&self) -> String {
        let quoted = |cell: &String| if cell.contains([',', '"']) { format!("{cell:?}") } else { cell.clone() };
        self.cells().iter().map(|row| row.iter().map(quoted).collect::<Vec<_>>().join(",") + "\n").collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep::Whole;

    fn run(value: &str, verdict: Verdict) -> Run {
        let (scenario, digest) = ("s".to_owned(), String::new());
        let values = vec![("fault.x.value".to_owned(), value.to_owned())];
        let sweep = Whole { files: String::new(), seeds: 3, vary: Vec::new(), runs: 3 };
        Run { sweep, number: 0, scenario, values, seed: 0, verdict, failure: None, digest }
    }

    #[test]
    fn a_row_counts_the_verdicts_of_one_combination() {
        let runs = [run("1 %", Verdict::Passed), run("2 %", Verdict::Told), run("1 %", Verdict::Untold)];
        let table = Table::new(&runs);
        assert_eq!(table.csv(), "fault.x.value,runs,passed,told,untold\n1 %,2,1,0,1\n2 %,1,0,1,0\n");
        assert_eq!(table.text().lines().nth(1), Some("          1 %     2       1     0       1"));
    }
}
