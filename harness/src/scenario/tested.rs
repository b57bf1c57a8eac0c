//! How scenarios ended: for people, as JSON, as JUnit XML.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use anstyle::AnsiColor;
use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};
use serde::Serialize;

use super::{Failure, Outcome};

/// A scenario that has been run.
#[derive(Clone, Debug)]
pub struct Tested {
    /// Its file.
    pub path: String,
    /// Its name.
    pub name: String,
    /// Its seed.
    pub seed: u64,
    /// What has been drawn by lot from it.
    pub drawn: Vec<(String, String)>,
    /// How it ended.
    pub outcome: Outcome,
    /// How long it took.
    pub wall: Duration,
}

impl Tested {
    /// The command that runs it again.
    pub fn again(&self) -> String {
        format!("torno test {} --seed {}", shell_word(&self.path), self.seed)
    }
}

/// A word as a shell takes it.
pub fn shell_word(text: &str) -> String {
    format!("'{}'", text.replace('\'', r"'\''"))
}

/// Where everything random comes from, and what has been drawn from it.
pub fn seed_text(seed: u64, drawn: &[(String, String)]) -> String {
    let drawn = drawn.iter().map(|(place, value)| format!(", {place} = {value}"));
    format!("{seed}{}", drawn.collect::<String>())
}

/// How all of them ended.
pub struct TestReport {
    tested: Vec<Tested>,
}

#[derive(Serialize)]
struct Line<'a> {
    name: &'a str,
    path: &'a str,
    seed: u64,
    drawn: BTreeMap<&'a str, &'a str>,
    outcome: &'a str,
    virtual_s: f64,
    wall_s: f64,
    digest: String,
    replies: &'a [String],
    failures: Vec<FailureLine<'a>>,
    again: String,
}

#[derive(Serialize)]
struct FailureLine<'a> {
    step: Option<usize>,
    does: Option<&'a str>,
    expected: &'a str,
    came: &'a str,
    at_s: f64,
    board: Option<&'a str>,
    context: &'a [String],
}

impl<'a> From<&'a Failure> for FailureLine<'a> {
    fn from(failure: &'a Failure) -> Self {
        Self {
            step: failure.step.as_ref().map(|(number, _)| *number),
            does: failure.step.as_ref().map(|(_, does)| does.as_str()),
            expected: &failure.expected,
            came: &failure.came,
            at_s: failure.at.as_secs_f64(),
            board: failure.board.as_deref(),
            context: &failure.context,
        }
    }
}

impl TestReport {
    /// Of these.
    pub const fn new(tested: Vec<Tested>) -> Self {
        Self { tested }
    }

    /// Whether all passed.
    pub fn passed(&self) -> bool {
        self.tested.iter().all(|tested| tested.outcome.failures.is_empty())
    }

    /// A line of JSON for each.
    ///
    /// # Errors
    /// None that can happen to what a rig tells.
    pub fn json(&self) -> serde_json::Result<String> {
        self.tested.iter().map(|tested| Ok(serde_json::to_string(&line(tested))? + "\n")).collect()
    }

    /// As JUnit XML.
    ///
    /// # Errors
    /// If a name cannot be written as XML.
    pub fn junit(&self) -> Result<String, quick_junit::SerializeError> {
        let mut suite = TestSuite::new("torno");
        for tested in &self.tested {
            let status = match tested.outcome.failures.first() {
                None => TestCaseStatus::success(),
                Some(first) => {
                    let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
                    let text: Vec<String> = tested.outcome.failures.iter().map(ToString::to_string).collect();
                    status.set_message(format!("expected {}, came {}", first.expected, first.came));
                    status.set_description(format!("{}\n  again     {}", text.join("\n"), tested.again()));
                    status
                }
            };
            let mut case = TestCase::new(&tested.name, status);
            case.set_classname(&tested.path).set_time(tested.wall);
            suite.add_test_case(case);
        }
        let mut report = Report::new("torno test");
        report.add_test_suite(suite);
        report.to_string()
    }
}

/// For people: a line for each, and for one that failed what explains it; with the colours of a terminal.
impl fmt::Display for TestReport {
    fn fmt(&self, text: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [good, bad] = [AnsiColor::Green, AnsiColor::Red].map(|colour| colour.on_default().bold());
        let width = self.tested.iter().map(|tested| tested.name.chars().count()).max().unwrap_or(0);
        for tested in &self.tested {
            let failed = !tested.outcome.failures.is_empty();
            let (style, word) = if failed { (bad, "FAILED") } else { (good, "passed") };
            let virtual_s = tested.outcome.end.as_secs_f64();
            let wall = tested.wall.as_secs_f64() * 1e3;
            let name = &tested.name;
            writeln!(text, "{style}{word}{style:#}  {name:width$}  {virtual_s:>9.3} s virtual  {wall:>8.1} ms")?;
            if failed {
                writeln!(text, "  seed      {}", seed_text(tested.seed, &tested.drawn))?;
            }
            for failure in &tested.outcome.failures {
                writeln!(text, "{failure}")?;
            }
            if failed {
                writeln!(text, "  again     {}", tested.again())?;
            }
        }
        let failed = self.tested.iter().filter(|tested| !tested.outcome.failures.is_empty()).count();
        let passed = self.tested.len() - failed;
        match failed {
            0 => writeln!(text, "{good}{passed} passed{good:#}"),
            _ => writeln!(text, "{bad}{failed} failed{bad:#}, {passed} passed"),
        }
    }
}

fn line(tested: &Tested) -> Line<'_> {
    let Tested { path, name, seed, drawn, outcome, wall } = tested;
    Line {
        name,
        path,
        seed: *seed,
        drawn: drawn.iter().map(|(place, value)| (place.as_str(), value.as_str())).collect(),
        outcome: outcome.verdict().name(),
        virtual_s: outcome.end.as_secs_f64(),
        wall_s: wall.as_secs_f64(),
        digest: outcome.digest.to_string(),
        replies: &outcome.replies,
        failures: outcome.failures.iter().map(FailureLine::from).collect(),
        again: tested.again(),
    }
}
