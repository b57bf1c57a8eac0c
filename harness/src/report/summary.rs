//! The summary at the end of a program.

use std::collections::BTreeMap;
use std::fmt;

use anstyle::{AnsiColor, Style};
use serde::Serialize;
use torno_protocol::time::Instant;

use super::{PartSummary, Stats};
use crate::job::{LineJob, Tally};

/// What is told at the end of a program; as JSON, one object on one line.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// The rig, or the port of a machine that is none of ours.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rig: Option<String>,
    /// The serial port, where one was named.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub port: Option<String>,
    /// The program.
    pub program: String,
    /// How it ended: `completed`, `rejected`, `faulted`, `unanswered`, `interrupted`.
    pub outcome: &'static str,
    /// The frames, if it was made of frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frames: Option<Frames>,
    /// The lines, if it was made of lines.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lines: Option<Lines>,
    /// Failures that the PC was told of.
    pub failures: Vec<String>,
    /// Virtual seconds until the rig was quiet.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub virtual_s: Option<f64>,
    /// Virtual seconds from the first byte that was sent until the controller was idle, all lines being answered.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub idle_after_s: Option<f64>,
    /// Wall seconds of the whole command.
    pub wall_s: f64,
    /// Virtual over wall time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub speedup: Option<f64>,
    /// The seed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// The digest of everything that happened.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub digest: Option<String>,
    /// The harness's process.
    pub pid: u32,
    /// What became of the boards' processes.
    pub incidents: Vec<String>,
    /// The faults that have begun.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<FaultSummary>,
    /// The boards.
    pub boards: BTreeMap<String, BoardSummary>,
    /// The part that was turned, if the rig turns one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub part: Option<PartSummary>,
    /// What it cost, if that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stats: Option<Stats>,
    #[serde(skip)]
    /// The boards' names in the order of the rig.
    pub order: Vec<String>,
}

/// A fault that has begun.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FaultSummary {
    /// Its name.
    pub name: String,
    /// When it began, s.
    pub from_s: f64,
}

impl FaultSummary {
    /// Those that have begun, and when.
    pub fn of(begun: &[(String, Instant)]) -> Vec<Self> {
        begun.iter().map(|(name, since)| Self { name: name.clone(), from_s: since.as_secs_f64() }).collect()
    }

    /// All of them in one text; None, if there are none.
    pub fn text(faults: &[Self]) -> Option<String> {
        let names = faults.iter().map(|Self { name, from_s }| format!("{name} at {from_s:.3} s"));
        (!faults.is_empty()).then(|| names.collect::<Vec<_>>().join(", "))
    }
}

/// The frames of a program.
#[derive(Clone, Debug, Serialize)]
pub struct Frames {
    /// Frames in the program.
    pub total: usize,
    /// Sent.
    pub sent: usize,
    /// Acknowledged.
    pub accepted: usize,
    /// Held for a while.
    pub held: usize,
    /// Refused.
    pub rejected: usize,
    /// Why, in order.
    pub refusals: Vec<String>,
}

/// The lines of a program.
#[derive(Clone, Debug, Serialize)]
pub struct Lines {
    /// Lines in the program.
    pub total: usize,
    /// Sent.
    pub sent: usize,
    /// Answered with `ok`.
    pub accepted: usize,
    /// Refused.
    pub rejected: usize,
    /// Which and why, in order.
    pub refusals: Vec<String>,
}

impl Lines {
    /// What came of a job.
    pub fn new(job: &LineJob) -> Self {
        Self {
            total: job.total(),
            sent: job.sent,
            accepted: job.accepted,
            rejected: job.refused.len(),
            refusals: job.refused.iter().map(|(line, why)| format!("{why} in line {line}")).collect(),
        }
    }
}

impl Frames {
    /// The tally of a conversation.
    pub fn new(conversation: &Tally, total: usize) -> Self {
        Self {
            total,
            sent: conversation.sent,
            accepted: conversation.accepted,
            held: conversation.held,
            rejected: conversation.refusals.len(),
            refusals: conversation.refusals.iter().map(ToString::to_string).collect(),
        }
    }
}

/// A board at the end.
#[derive(Clone, Debug, Serialize)]
pub struct BoardSummary {
    /// Its process.
    pub pid: u32,
    /// The last value of each of its quantities.
    #[serde(flatten)]
    pub telemetry: BTreeMap<String, i64>,
}

/// What failed, in words.
pub fn failures(conversation: &Tally) -> Vec<String> {
    conversation.failures.iter().map(|(party, fault)| format!("{} failed: {fault}", party.name())).collect()
}

impl Summary {
    /// What was refused, and why.
    pub fn refusals(&self) -> &[String] {
        let frames = self.frames.as_ref().map(|frames| &frames.refusals[..]);
        frames.or(self.lines.as_ref().map(|lines| &lines.refusals[..])).unwrap_or_default()
    }
}

/// For people, with the colours of a terminal: what writes it elsewhere strips them.
impl fmt::Display for Summary {
    fn fmt(&self, text: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (bold, dim) = (Style::new().bold(), Style::new().dimmed());
        if !self.boards.is_empty() {
            writeln!(text, "{bold}{:<12} {:>8}  at the end{bold:#}", "process", "pid")?;
            writeln!(text, "{:<12} {:>8}  {dim}time, lines and the PC{dim:#}", "harness", self.pid)?;
            for name in &self.order {
                let Some(board) = self.boards.get(name) else { continue };
                let telemetry = board.telemetry.iter().map(|(name, value)| format!("{name} {value}"));
                let telemetry = telemetry.collect::<Vec<_>>().join(", ");
                writeln!(text, "{name:<12} {:>8}  {dim}{telemetry}{dim:#}", board.pid)?;
            }
            writeln!(text)?;
        }
        let problem = AnsiColor::Red.on_default().bold();
        for line in self.incidents.iter().chain(&self.failures) {
            writeln!(text, "{problem}{line}{problem:#}")?;
        }
        if !self.refusals().is_empty() {
            writeln!(text, "{problem}refused: {}{problem:#}", self.refusals().join(", "))?;
        }
        let place = self.rig.as_deref().or(self.port.as_deref()).unwrap_or_default();
        writeln!(text, "{:<9}{} on {place}", "program", self.program)?;
        if let Some(Frames { total, sent, accepted, held, rejected, .. }) = self.frames {
            writeln!(
                text,
                "{:<9}{sent} of {total} sent, {accepted} accepted, {held} held for a while, {rejected} rejected",
                "frames"
            )?;
        }
        if let Some(Lines { total, sent, accepted, rejected, .. }) = self.lines {
            writeln!(text, "{:<9}{sent} of {total} sent, {accepted} accepted, {rejected} rejected", "lines")?;
        }
        if let Some(seconds) = self.idle_after_s {
            writeln!(text, "{:<9}after {seconds:.3} s, all lines being answered", "idle")?;
        }
        match (self.virtual_s, self.speedup) {
            (Some(seconds), Some(speedup)) => {
                writeln!(
                    text,
                    "{:<9}{seconds:.3} s virtual in {:.3} s: {speedup:.0} x real time",
                    "time", self.wall_s
                )?;
            }
            _ => writeln!(text, "{:<9}{:.3} s", "time", self.wall_s)?,
        }
        if let Some(faults) = FaultSummary::text(&self.faults) {
            writeln!(text, "{:<9}{faults}", "faults")?;
        }
        if let Some(part) = &self.part {
            part.write(text, problem)?;
        }
        if let (Some(digest), Some(seed)) = (&self.digest, self.seed) {
            writeln!(text, "{:<9}{digest} (seed {seed})", "digest")?;
        }
        let as_required = self.part.as_ref().is_none_or(PartSummary::is_as_required);
        let good = self.outcome == "completed" && as_required;
        let outcome = if good { AnsiColor::Green } else { AnsiColor::Red }.on_default().bold();
        let but = if as_required { "" } else { ", but the part is not within its tolerance" };
        writeln!(text, "{:<9}{outcome}{}{but}{outcome:#}", "outcome", self.outcome)?;
        match &self.stats {
            Some(stats) => stats.write(text, bold),
            None => Ok(()),
        }
    }
}
