//! `torno gcode`

pub(super) mod plan;
mod plot;
mod reading;

use std::io::{self, BufWriter, Write};
use std::process::ExitCode;

use anyhow::Context;
use serde_json::json;
use torno_gcode::{Finding, Kind, Outcome, Severity};

use super::{USAGE, print};
use plan::{Plan, Planning};
use reading::Reading;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Interprets a program and tells everything that is wrong with it; for a rig, also what cannot be done there.
    Check(Check),
    /// Prints the canonical motions of a program, one JSON object a line.
    Canon(Canon),
    /// Plans a program for a lathe: frames that its master takes, how long they take, and what cannot be done.
    Plan(plan::Arguments),
    /// Draws a program for a lathe: the path that it asks for, the frames' path, the part that comes of it.
    Plot(plot::Arguments),
}

#[derive(Debug, clap::Args)]
struct Check {
    #[command(flatten)]
    reading: Reading,
    #[command(flatten)]
    planning: Planning,
    /// Prints the result as one line of JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
struct Canon {
    #[command(flatten)]
    reading: Reading,
    /// Prints coolant, tools and stops, too
    #[arg(long)]
    all: bool,
    /// The motions are JSON in any case
    #[arg(long, hide = true)]
    json: bool,
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        match self.command {
            Command::Check(arguments) => arguments.run(),
            Command::Canon(arguments) => arguments.run(),
            Command::Plan(arguments) => arguments.run().await,
            Command::Plot(arguments) => arguments.run().await,
        }
    }
}

/// A finding as an object of JSON.
fn as_json(finding: &Finding) -> serde_json::Value {
    json!({
        "line": finding.line,
        "column": finding.column,
        "severity": if finding.severity == Severity::Error { "error" } else { "warning" },
        "message": finding.message,
    })
}

impl Check {
    fn run(self) -> anyhow::Result<ExitCode> {
        let reading = &self.reading;
        let outcome = if self.planning.rig.is_some() {
            Plan::new(reading, &self.planning.rig()?, &self.planning, |_| {})?.outcome
        } else {
            reading.interpret(&reading.settings(), &mut reading.open()?, &mut |_| {})?
        };
        let refused = outcome.is_refused();
        if self.json {
            let findings: Vec<_> = outcome.findings.iter().map(as_json).collect();
            let result = json!({
                "file": reading.name(),
                "dialect": outcome.dialect.name(),
                "lines": outcome.lines,
                "motions": outcome.motions,
                "refused": refused,
                "findings": findings,
            });
            print(&format!("{result}\n"))?;
        } else {
            let findings: String = outcome.findings.iter().map(|finding| reading.told(finding)).collect();
            let Outcome { dialect, lines, motions, .. } = outcome;
            let name = reading.name();
            let verdict = if refused {
                format!("{name} is refused (dialect {})\n", dialect.name())
            } else {
                format!("{name} is understood: dialect {}, {lines} lines, {motions} motions\n", dialect.name())
            };
            print(&format!("{findings}{verdict}"))?;
        }
        Ok(if refused { ExitCode::from(USAGE) } else { ExitCode::SUCCESS })
    }
}

impl Canon {
    fn run(self) -> anyhow::Result<ExitCode> {
        let reading = &self.reading;
        let mut source = reading.open()?;
        // Nothing is printed of a program that is refused: whoever reads the motions does not see its end first.
        let settings = reading.settings();
        let outcome = reading.interpret(&settings, &mut source, &mut |_| {})?;
        for finding in &outcome.findings {
            eprint!("{}", reading.told(finding));
        }
        if outcome.is_refused() {
            return Ok(ExitCode::from(USAGE));
        }
        let mut output = BufWriter::new(io::stdout().lock());
        let mut written = Ok(());
        reading.interpret(&settings, &mut source, &mut |motion| {
            let aside = matches!(motion.kind, Kind::Coolant { .. } | Kind::Tool(_) | Kind::Stop { .. });
            if written.is_ok() && (self.all || !aside) {
                written = writeln!(output, "{motion}");
            }
        })?;
        match written.and_then(|()| output.flush()) {
            Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(error).context("cannot write the motions"),
            _ => Ok(ExitCode::SUCCESS),
        }
    }
}
