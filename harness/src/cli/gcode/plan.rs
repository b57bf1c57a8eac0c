//! `torno gcode plan`, and the plan that other commands play.

use std::fmt;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use serde_json::json;
use torno::observe::stderr::say;
use torno::planning;
use torno::play::{Ended, Play, Played};
use torno::report::Bar;
use torno::rig::Driver;
use torno::rig::file::{DEFAULT, RigFile};
use torno_gcode::{Finding, Outcome, Place, Settings, Severity};
use torno_part::Place as InPlane;
use torno_planner::{Planned, Planner, Report, Side};
use torno_protocol::lathe::Program;

use super::as_json;
use super::reading::{Choice, Reading, Source, place};
use crate::cli::output::OutputFile;
use crate::cli::{FAILED, INTERRUPTED, Interrupt, USAGE, load_rig, print, print_beside};

/// So many errors of a program are told.
const ERRORS_MAX: usize = 20;
/// The names of files with G-code end like this, in whatever case.
const ENDINGS: [&str; 6] = ["ngc", "nc", "tap", "gcode", "cnc", "gc"];

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Arguments {
    #[command(flatten)]
    reading: Reading,
    #[command(flatten)]
    planning: Planning,
    /// Retracts no further than needed between two cuts, and tells what that saves
    #[arg(long)]
    optimise: bool,
    /// Writes the frames: a program for 'torno run' and 'torno send'; '-' is standard output
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Prints the result as one line of JSON
    #[arg(long)]
    json: bool,
}

/// How a program is planned.
#[derive(Debug, Default, clap::Args)]
pub(super) struct Planning {
    /// The rig that the frames are for: a built-in rig or a rig file [default, to plan: lathe]
    #[arg(long)]
    pub(super) rig: Option<String>,
    /// Sets what the rig file could say: BOARD.TABLE.FIELD, BOARD.clock_ppm or pc.FIELD (may be given several times)
    #[arg(long, value_name = "PLACE=VALUE")]
    set: Vec<String>,
    /// Where G28 and G30 go, in mm, X as a radius [default: where the tool is at the start]
    #[arg(long, value_name = "X,Z", value_parser = place, allow_hyphen_values = true)]
    park: Option<Place>,
    /// On which side of the asked path the tool goes
    #[arg(long, value_enum, default_value = "middle")]
    side: SideChoice,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
enum SideChoice {
    /// Half a slot to either side of it at most.
    #[default]
    Middle,
    /// Never in the part: up to a slot outside of it.
    Outside,
}

/// A program of G-code as frames, and what there is to say of it.
pub(in crate::cli) struct Plan {
    /// The frames; none if it is refused.
    pub(in crate::cli) program: Program,
    /// The line of the G-code that each frame comes from.
    lines: Vec<usize>,
    /// What the planner says.
    pub(in crate::cli) report: Report,
    /// What the interpreter says, with all findings.
    pub(super) outcome: Outcome,
}

/// Whether the file of this name holds G-code.
pub(in crate::cli) fn is_gcode(path: &Path) -> bool {
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    ENDINGS.iter().any(|known| ending.eq_ignore_ascii_case(known))
}

/// The plan of the G-code in a file for a rig, with no options. Its warnings are told on standard error.
///
/// # Errors
/// What is wrong with it, where it is refused.
pub(in crate::cli) fn load(path: &Path, file: &RigFile) -> anyhow::Result<Plan> {
    let reading = Reading::of(path);
    let plan = Plan::new(&reading, &mut reading.open()?, file, &Planning::default(), false)?;
    let told = plan.told(&reading);
    if plan.is_refused() {
        anyhow::bail!("{}\n{told}{} is refused", "the G-code cannot be executed", reading.name());
    }
    say(&told);
    Ok(plan)
}

impl Planning {
    /// The rig that was asked for.
    pub(super) fn rig(&self) -> anyhow::Result<RigFile> {
        load_rig(self.rig.as_deref().unwrap_or(DEFAULT), &self.set)
    }
}

impl Plan {
    /// The plan of a program for a rig.
    pub(super) fn new(
        reading: &Reading,
        source: &mut Source,
        file: &RigFile,
        planning: &Planning,
        optimise: bool,
    ) -> anyhow::Result<Self> {
        let side = if planning.side == SideChoice::Middle { Side::Middle } else { Side::Outside };
        let park = planning.park;
        let at = reading.at.map(|Place { x, z, .. }| InPlane { z, x });
        let planning = torno_planner::Settings { optimise, ..planning::settings(file, at, side)? };
        let start = Place { x: planning.start.x, z: planning.start.z, ..Place::default() };
        let settings = Settings { start, home: park.unwrap_or(start), ..reading.settings() };
        let mut planner = Planner::new(planning);
        let (mut frames, mut lines) = (Vec::new(), Vec::new());
        let mut take = |Planned { line, frame }| {
            frames.push(frame.emit());
            lines.push(line);
        };
        let mut outcome = reading.interpret(&settings, source, &mut |motion| {
            planner.take(&motion);
            core::iter::from_fn(|| planner.poll()).for_each(&mut take);
        })?;
        planner.finish();
        core::iter::from_fn(|| planner.poll()).for_each(take);
        let report = planner.report();
        let words: Vec<_> = report.findings.iter().map(|finding| (finding.line, finding.word)).collect();
        let columns = reading.columns(source, &words)?;
        outcome.findings = together(outcome.findings, &report.findings, &columns);
        if outcome.is_refused() {
            (frames, lines) = (Vec::new(), Vec::new());
        }
        Ok(Self { program: Program { frames }, lines, report, outcome })
    }

    fn is_refused(&self) -> bool {
        self.outcome.is_refused()
    }

    /// What is wrong with it, or strange, a line each.
    fn told(&self, reading: &Reading) -> String {
        self.outcome.findings.iter().map(|finding| reading.told(finding)).collect()
    }

    /// Writes the frames, each with the line that it comes from.
    fn write(&self, head: &str, file: &mut dyn Write) -> io::Result<()> {
        writeln!(file, "# {}", head.escape_debug())?;
        for (frame, line) in self.program.frames.iter().zip(&self.lines) {
            for byte in frame {
                write!(file, "{byte:02X} ")?;
            }
            writeln!(file, " # line {line}")?;
        }
        Ok(())
    }
}

/// What the interpreter and the planner have found, in the order of lines. A rapid cuts what an earlier line, which the
/// interpreter has refused, would have cut away: that is no error of its own.
fn together(found: Vec<Finding>, planned: &[torno_planner::Finding], columns: &[usize]) -> Vec<Finding> {
    let is_error = |finding: &&Finding| finding.severity == Severity::Error;
    let first = found.iter().filter(is_error).map(|finding| finding.line).min().unwrap_or(usize::MAX);
    let planned = planned.iter().zip(columns).filter(|(finding, _)| !finding.follows || finding.line < first);
    let planned = planned.map(|(torno_planner::Finding { line, severity, message, .. }, column)| Finding {
        line: *line,
        column: *column,
        severity: *severity,
        message: message.clone(),
    });
    let mut all: Vec<Finding> = found.into_iter().chain(planned).collect();
    all.sort_by_key(|finding| (finding.line, finding.column));
    let mut errors = 0;
    all.retain(|finding| {
        errors += usize::from(is_error(&finding));
        !is_error(&finding) || errors <= ERRORS_MAX
    });
    all
}

/// What is told of a plan.
struct Summary<'a> {
    name: String,
    rig: &'a str,
    plan: &'a Plan,
    played: &'a Played,
    /// What shorter retracts save, if they were asked for.
    saved_s: Option<f64>,
}

impl Summary<'_> {
    fn as_json(&self) -> serde_json::Value {
        let Self { name, rig, plan, played, saved_s } = self;
        let Report { worst, end, .. } = &plan.report;
        json!({
            "file": name,
            "rig": rig,
            "dialect": plan.outcome.dialect.name(),
            "lines": plan.outcome.lines,
            "motions": plan.outcome.motions,
            "frames": plan.program.frames.len(),
            "time_s": played.end.as_secs_f64(),
            "saved_s": saved_s,
            "outcome": played.outcome(),
            "worst_x_mm": worst.x,
            "worst_z_mm": worst.z,
            "end": { "x": end.x, "z": end.z },
            "warnings": plan.outcome.findings.iter().map(as_json).collect::<Vec<_>>(),
            "refused": [],
        })
    }
}

impl fmt::Display for Summary<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, rig, plan, played, saved_s } = self;
        let Outcome { dialect, lines, motions, .. } = &plan.outcome;
        let Report { worst, end, .. } = &plan.report;
        writeln!(f, "{:<9}{name} on {rig}: dialect {}, {lines} lines, {motions} motions", "program", dialect.name())?;
        writeln!(f, "{:<9}{}", "frames", plan.program.frames.len())?;
        writeln!(f, "{:<9}{:.3} s", "time", played.end.as_secs_f64())?;
        if let Some(saved) = saved_s {
            let share = 100.0 * saved / (played.end.as_secs_f64() + saved);
            writeln!(f, "{:<9}{saved:.3} s, {share:.0} %, by shorter retracts", "saved")?;
        }
        writeln!(f, "{:<9}{:.4} mm in X (radius), {:.4} mm in Z, from the asked path", "worst", worst.x, worst.z)?;
        writeln!(f, "{:<9}X {:.3}, Z {:.3} mm (X as a radius)", "end", end.x, end.z)?;
        writeln!(f, "{:<9}{}", "outcome", played.outcome())
    }
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        let Self { reading, planning, optimise, output, json } = self;
        let file = planning.rig()?;
        let mut source = reading.open()?;
        let plan = Plan::new(&reading, &mut source, &file, &planning, optimise)?;
        let name = reading.name();
        if plan.is_refused() {
            return refuse(&plan, &reading, &file.name, json);
        }
        let mut interrupt = Interrupt::listen()?;
        if let Some(path) = &output {
            let frames = plan.program.frames.len();
            let head = format!("{name}, planned for the rig {}: {frames} frames", file.name);
            OutputFile::create(path)?.write_by(|file| plan.write(&head, file))?;
        }
        let Some(played) = play(&file, &plan.program, &mut interrupt).await? else {
            return Ok(ExitCode::from(INTERRUPTED));
        };
        let mut saved_s = None;
        if optimise {
            let plain = Plan::new(&reading, &mut source, &file, &planning, false)?;
            let Some(plain) = play(&file, &plain.program, &mut interrupt).await? else {
                return Ok(ExitCode::from(INTERRUPTED));
            };
            saved_s = Some(plain.end.as_secs_f64() - played.end.as_secs_f64());
        }
        let summary = Summary { name, rig: &file.name, plan: &plan, played: &played, saved_s };
        let text = if json { format!("{}\n", summary.as_json()) } else { format!("{}{summary}", plan.told(&reading)) };
        print_beside(&[&output], &text)?;
        let completed = played.outcome == torno_protocol::lathe::Outcome::Completed;
        Ok(if completed { ExitCode::SUCCESS } else { ExitCode::from(FAILED) })
    }
}

/// Tells why nothing is planned.
fn refuse(plan: &Plan, reading: &Reading, rig: &str, json: bool) -> anyhow::Result<ExitCode> {
    let name = reading.name();
    if json {
        let (refused, warnings): (Vec<_>, Vec<_>) =
            plan.outcome.findings.iter().partition(|finding| finding.severity == Severity::Error);
        let objects = |findings: Vec<&Finding>| findings.into_iter().map(as_json).collect::<Vec<_>>();
        let result = json!({
            "file": name,
            "rig": rig,
            "dialect": plan.outcome.dialect.name(),
            "lines": plan.outcome.lines,
            "motions": plan.outcome.motions,
            "frames": 0,
            "time_s": null,
            "worst_x_mm": null,
            "worst_z_mm": null,
            "end": null,
            "warnings": objects(warnings),
            "refused": objects(refused),
        });
        print(&format!("{result}\n"))?;
    } else {
        let dialect = plan.outcome.dialect.name();
        print(&format!("{}{name} is refused (dialect {dialect})\n", plan.told(reading)))?;
    }
    Ok(ExitCode::from(USAGE))
}

/// Plays frames in this process, as fast as can be: the time that they take depends on what the machine did before, so
/// nothing less tells it. None, if a signal came first.
async fn play(file: &RigFile, program: &Program, interrupt: &mut Interrupt) -> anyhow::Result<Option<Played>> {
    // What becomes of the bar is of no interest.
    let file = RigFile { part: None, ..file.clone() };
    let bar = Bar::of_frames(program.frames.len());
    let play = Play::new(file, program.clone(), Driver::InProcess);
    let progress = |progress: torno::play::Progress<'_>| bar.update(progress.conversation.accepted, Some(progress.now));
    let played = play.record(None, progress, interrupt.received()).await?;
    bar.clear();
    Ok((played.ended != Ended::Interrupted).then_some(played))
}

impl Reading {
    /// A file, with no options.
    fn of(path: &Path) -> Self {
        Self {
            file: path.to_owned(),
            dialect: Choice::Auto,
            strict: false,
            block_delete: false,
            at: None,
            steps: Settings::default().steps_max,
        }
    }
}
