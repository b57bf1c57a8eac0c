//! What came of a sweep: how often each outcome came, for each combination of values.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::{Deserialize, Serialize};

use super::Run;
use crate::scenario::{Outcome, Verdict as Shown};

/// How a run of a sweep ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Everything held.
    Passed,
    /// Something did not, and the PC was told of a refusal or a failure.
    Told,
    /// Something did not, and no one was told.
    Untold,
    /// Nothing failed, but a fault has not fired.
    Inconclusive,
}

impl Verdict {
    /// Of a scenario's outcome.
    pub fn of(outcome: &Outcome) -> Self {
        let told = |reply: &String| reply.starts_with("NAK") || reply.starts_with("CAN");
        match outcome.verdict() {
            Shown::Passed => Self::Passed,
            Shown::Inconclusive => Self::Inconclusive,
            Shown::Failed if outcome.replies.iter().any(told) => Self::Told,
            Shown::Failed => Self::Untold,
        }
    }

    /// Whether something did not hold.
    pub const fn is_failure(self) -> bool {
        matches!(self, Self::Told | Self::Untold)
    }
}

/// Counts of verdicts, a row for each combination of values.
#[derive(Clone, Debug, Default)]
pub struct Table {
    columns: Vec<String>,
    rows: Vec<Combination>,
    places: BTreeMap<Vec<String>, usize>,
}

/// The counts of one combination of values.
#[derive(Clone, Debug)]
struct Combination {
    values: Vec<String>,
    verdicts: [u64; 4],
    /// The line errors of all its runs, if they were counted in each.
    line_errors: Option<u64>,
}

impl Table {
    /// Of these runs, in the order of their first appearance.
    pub fn new(runs: &[Run]) -> Self {
        let mut table = Self::default();
        runs.iter().for_each(|run| table.add(run));
        table
    }

    /// Counts one more.
    pub fn add(&mut self, run: &Run) {
        let values: Vec<String> = run.values.iter().map(|(_, value)| value.clone()).collect();
        let row = match self.places.get(&values) {
            Some(row) => *row,
            None => {
                self.columns = run.values.iter().map(|(path, _)| path.clone()).collect();
                self.places.insert(values.clone(), self.rows.len());
                self.rows.push(Combination { values, verdicts: [0; 4], line_errors: Some(0) });
                self.rows.len() - 1
            }
        };
        let row = &mut self.rows[row];
        row.verdicts[run.verdict as usize] += 1;
        row.line_errors = row.line_errors.zip(run.line_errors).map(|(sum, more)| sum + more);
    }

    /// Whether each combination of values has passed at least once, and none has failed.
    pub fn passed(&self) -> bool {
        self.rows
            .iter()
            .all(|Combination { verdicts: [passed, told, untold, _], .. }| *passed > 0 && told + untold == 0)
    }

    fn cells(&self, verdicts: usize) -> Vec<Vec<String>> {
        let heads = ["runs", "passed", "told", "untold", "inconclusive"].map(str::to_owned);
        let counted = self.rows.iter().any(|row| row.line_errors.is_some());
        let last = counted.then(|| "line errors".to_owned());
        let head = self.columns.iter().cloned().chain(heads.into_iter().take(1 + verdicts)).chain(last).collect();
        let row = |Combination { values, verdicts: counts, line_errors }: &Combination| {
            let total = counts.iter().sum::<u64>();
            let errors = counted.then(|| line_errors.map_or_else(|| "-".to_owned(), |errors| errors.to_string()));
            let counts = [total].into_iter().chain(counts[..verdicts].iter().copied());
            values.iter().cloned().chain(counts.map(|count| count.to_string())).chain(errors).collect()
        };
        core::iter::once(head).chain(self.rows.iter().map(row)).collect()
    }

    /// Aligned, for people. `told`: something failed and the PC heard of it; `untold`: it did not. The column
    /// `inconclusive` stands there if there is something in it, the column `line errors` if they were counted.
    pub fn text(&self) -> String {
        let inconclusive = self.rows.iter().any(|row| row.verdicts[Verdict::Inconclusive as usize] > 0);
        let cells = self.cells(if inconclusive { 4 } else { 3 });
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
        self.cells(4).iter().map(|row| row.iter().map(quoted).collect::<Vec<_>>().join(",") + "\n").collect()
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
        Run { sweep, number: 0, scenario, values, seed: 0, verdict, failure: None, digest, line_errors: None }
    }

    #[test]
    fn a_row_counts_the_verdicts_of_one_combination() {
        let runs = [run("1 %", Verdict::Passed), run("2 %", Verdict::Told), run("1 %", Verdict::Untold)];
        let table = Table::new(&runs);
        assert_eq!(table.csv(), "fault.x.value,runs,passed,told,untold,inconclusive\n1 %,2,1,0,1,0\n2 %,1,0,1,0,0\n");
        assert_eq!(table.text().lines().nth(1), Some("          1 %     2       1     0       1"));
        let table = Table::new(&[&runs[..], &[run("2 %", Verdict::Inconclusive)]].concat());
        assert_eq!(table.text().lines().nth(2), Some("          2 %     2       0     1       0             1"));
    }

    #[test]
    fn line_errors_are_summed_where_every_run_has_counted_them() {
        let run = |value, line_errors| Run { line_errors, ..run(value, Verdict::Passed) };
        let table = Table::new(&[run("1 %", Some(2)), run("1 %", Some(3)), run("2 %", Some(4)), run("2 %", None)]);
        let expected =
            "fault.x.value,runs,passed,told,untold,inconclusive,line errors\n1 %,2,2,0,0,0,5\n2 %,2,2,0,0,0,-\n";
        assert_eq!(table.csv(), expected);
        assert_eq!(table.text().lines().nth(1), Some("          1 %     2       2     0       0            5"));
    }

    #[test]
    fn every_row_must_pass_once_and_never_fail() {
        use Verdict::{Inconclusive, Passed, Told, Untold};
        let passed = |runs: &[(&str, Verdict)]| {
            Table::new(&runs.iter().map(|(value, verdict)| run(value, *verdict)).collect::<Vec<_>>()).passed()
        };
        assert!(passed(&[]));
        assert!(passed(&[("1 %", Passed), ("2 %", Passed)]));
        assert!(passed(&[("1 %", Inconclusive), ("1 %", Passed)]));
        assert!(!passed(&[("1 %", Inconclusive), ("2 %", Passed)]));
        assert!(!passed(&[("1 %", Passed), ("1 %", Told)]));
        assert!(!passed(&[("1 %", Untold), ("2 %", Passed)]));
    }
}
