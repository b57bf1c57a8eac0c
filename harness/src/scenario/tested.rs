//! How scenarios ended: for people, and as JSON.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use anstyle::AnsiColor;
use serde::Serialize;

use super::junit::junit;
use super::{Failure, Outcome, Scenario, Verdict};

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
    /// What came of a scenario from a file of this name, and how long that took.
    pub fn new(path: &str, scenario: &Scenario, outcome: Outcome, wall: Duration) -> Self {
        let (path, name, seed, drawn) = (path.to_owned(), scenario.name.clone(), scenario.seed, scenario.drawn.clone());
        Self { path, name, seed, drawn, outcome, wall }
    }

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

/// A scenario of which there is no verdict: its file is none, or its rig broke.
#[derive(Clone, Debug)]
pub struct Broken {
    /// Its file.
    pub path: String,
    /// Its name, if that is known.
    pub name: Option<String>,
    /// What is wrong.
    pub message: String,
}

/// What came of a scenario.
#[derive(Clone, Debug)]
pub enum Attempt {
    /// It has been run.
    Tested(Box<Tested>),
    /// It could not be.
    Broken(Broken),
}

impl Attempt {
    /// The scenario's file.
    pub fn path(&self) -> &str {
        match self {
            Self::Tested(tested) => &tested.path,
            Self::Broken(broken) => &broken.path,
        }
    }

    /// Its name; or its file, if it has none.
    pub fn name(&self) -> &str {
        match self {
            Self::Tested(tested) => &tested.name,
            Self::Broken(broken) => broken.name.as_ref().unwrap_or(&broken.path),
        }
    }

    /// How long it took.
    pub(super) const fn wall(&self) -> Duration {
        match self {
            Self::Tested(tested) => tested.wall,
            Self::Broken(_) => Duration::ZERO,
        }
    }

    /// What it has shown, if it could be run.
    pub fn verdict(&self) -> Option<Verdict> {
        match self {
            Self::Tested(tested) => Some(tested.outcome.verdict()),
            Self::Broken(_) => None,
        }
    }
}

/// How all of them ended.
pub struct TestReport {
    attempts: Vec<Attempt>,
    not_run: usize,
}

#[derive(Serialize)]
struct TestedScenario<'a> {
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

#[derive(Serialize)]
struct BrokenLine<'a> {
    name: Option<&'a str>,
    path: &'a str,
    outcome: &'static str,
    error: &'a str,
}

impl TestReport {
    /// Of these; so many more have not been run.
    pub const fn new(attempts: Vec<Attempt>, not_run: usize) -> Self {
        Self { attempts, not_run }
    }

    /// Whether all passed.
    pub fn passed(&self) -> bool {
        self.count(Some(Verdict::Passed)) == self.attempts.len()
    }

    /// How many have shown this; None: how many could not be run.
    pub fn count(&self, verdict: Option<Verdict>) -> usize {
        self.attempts.iter().filter(|attempt| attempt.verdict() == verdict).count()
    }

    /// A line of JSON for each.
    ///
    /// # Errors
    /// None that can happen to what a rig tells.
    pub fn json(&self) -> serde_json::Result<String> {
        let line = |attempt: &Attempt| match attempt {
            Attempt::Tested(tested) => serde_json::to_string(&line(tested)),
            Attempt::Broken(Broken { path, name, message }) => {
                let (name, outcome) = (name.as_deref(), "broken");
                serde_json::to_string(&BrokenLine { name, path, outcome, error: message })
            }
        };
        self.attempts.iter().map(|attempt| Ok(line(attempt)? + "\n")).collect()
    }

    /// As JUnit XML.
    ///
    /// # Errors
    /// If a name cannot be written as XML.
    pub fn junit(&self) -> Result<String, quick_junit::SerializeError> {
        junit(&self.attempts)
    }
}

/// For people: a line for each, and for one that did not pass what explains it; with the colours of a terminal.
impl fmt::Display for TestReport {
    fn fmt(&self, text: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [good, bad, open] = [AnsiColor::Green, AnsiColor::Red, AnsiColor::Yellow].map(|c| c.on_default().bold());
        let [failed, inconclusive, passed, broken] =
            [Some(Verdict::Failed), Some(Verdict::Inconclusive), Some(Verdict::Passed), None].map(|v| self.count(v));
        let longest = if inconclusive > 0 { "INCONCLUSIVE".len() } else { "passed".len() };
        let width = self.attempts.iter().map(|attempt| attempt.name().chars().count()).max().unwrap_or(0);
        for attempt in &self.attempts {
            let (style, word) = match attempt.verdict() {
                Some(Verdict::Passed) => (good, "passed"),
                Some(Verdict::Failed) => (bad, "FAILED"),
                Some(Verdict::Inconclusive) => (open, "INCONCLUSIVE"),
                None => (bad, "BROKEN"),
            };
            let (name, path) = (attempt.name(), attempt.path());
            write!(text, "{style}{word:longest$}{style:#}  {name:width$}  ")?;
            let Attempt::Tested(tested) = attempt else {
                writeln!(text, "{:>9}    {:7}  {:>8}     {path}", "-", "", "-")?;
                continue;
            };
            let virtual_s = tested.outcome.end.as_secs_f64();
            let wall = tested.wall.as_secs_f64() * 1e3;
            writeln!(text, "{virtual_s:>9.3} s virtual  {wall:>8.1} ms  {path}")?;
            if attempt.verdict() == Some(Verdict::Passed) {
                continue;
            }
            writeln!(text, "  seed      {}", seed_text(tested.seed, &tested.drawn))?;
            for failure in &tested.outcome.failures {
                writeln!(text, "{failure}")?;
            }
            writeln!(text, "  again     {}", tested.again())?;
        }
        let counts = [
            (failed, bad, "failed"),
            (broken, bad, "broken"),
            (inconclusive, open, "inconclusive"),
            (passed, good, "passed"),
            (self.not_run, open, "not run"),
        ];
        let told = counts.iter().filter(|(count, _, what)| *count > 0 || *what == "passed");
        let told: Vec<String> = told.map(|(count, style, what)| format!("{style}{count} {what}{style:#}")).collect();
        writeln!(text, "{}", told.join(", "))
    }
}

fn line(tested: &Tested) -> TestedScenario<'_> {
    let Tested { path, name, seed, drawn, outcome, wall } = tested;
    TestedScenario {
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
