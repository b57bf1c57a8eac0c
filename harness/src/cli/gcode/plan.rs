//! `torno gcode plan`, and the plan that other commands play.

use std::fmt;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use serde_json::json;
use torno::observe::stderr::say;
use torno::planning;
use torno::play::{Play, PlayEnd, Played};
use torno::report::Bar;
use torno::rig::Driver;
use torno::rig::file::{DEFAULT, RigFile};
use torno_gcode::{Dialect, Finding, Motion, Outcome, Place, Settings, Severity};
use torno_part::{Place as InPlane, Profile};
use torno_planner::{Planned, Planner, Report, Side};
use torno_protocol::lathe::Program;

use super::as_json;
use super::reading::{Choice, Reading, place};
use crate::cli::output::OutputFile;
use crate::cli::{FAILED, INTERRUPTED, Interrupt, USAGE, load_rig, print_beside};

/// So many errors of a program are told.
const ERRORS_MAX: usize = 20;
/// A longer plan is not played: that takes minutes.
const PLAYED_MAX: usize = 200_000;
/// The names of files with G-code end like this, in whatever case.
const ENDINGS: [&str; 6] = ["ngc", "nc", "tap", "gcode", "cnc", "gc"];

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Arguments {
    #[command(flatten)]
    reading: Reading,
    #[command(flatten)]
    planning: Planning,
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
    /// Retracts no further than needed between two cuts; 'plan' tells what that saves
    #[arg(long)]
    optimise: bool,
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
    /// The frames with retracts as the program has them, if they were to be shorter.
    plain: Option<Program>,
}

/// Whether the file of this name holds G-code.
pub(in crate::cli) fn is_gcode(path: &Path) -> bool {
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    ENDINGS.iter().any(|known| ending.eq_ignore_ascii_case(known))
}

/// The plan of the G-code in a file for a rig, with no options but what it calls the place where the tool is at the
/// start. Its warnings are told on standard error.
///
/// # Errors
/// What is wrong with it, where it is refused.
pub(in crate::cli) fn load(path: &Path, file: &RigFile, at: Option<InPlane>) -> anyhow::Result<Plan> {
    let at = at.map(in_space);
    let reading = Reading { at, ..Reading::of(path) };
    let plan = Plan::new(&reading, file, &Planning::default(), |_| {})?;
    let told = plan.told(&reading);
    if plan.is_refused() {
        anyhow::bail!("{}\n{told}{} is refused", "the G-code cannot be executed", reading.name());
    }
    say(&told);
    Ok(plan)
}

/// What lines for a controller ask for on a rig: the bar, as their path cuts it. None, if they cannot be planned.
pub(in crate::cli) fn asked(text: &str, for_rig: torno_planner::Settings) -> Option<Profile> {
    let plan = planning::Plan::new(text, for_rig, Some(Dialect::LinuxCnc));
    let is_refused = plan.is_refused();
    plan.report.stock.filter(|_| !is_refused).map(|stock| stock.profile)
}

/// What a program calls the place where the tool is at the start, as an option says it.
pub(in crate::cli) fn start(text: &str) -> Result<InPlane, String> {
    place(text).map(in_plane)
}

fn in_plane(Place { x, z, .. }: Place) -> InPlane {
    InPlane { z, x }
}

/// A place of the tool as the interpreter has it.
fn in_space(InPlane { z, x }: InPlane) -> Place {
    Place { x, z, ..Place::default() }
}

impl Planning {
    /// The rig that was asked for.
    pub(super) fn rig(&self) -> anyhow::Result<RigFile> {
        load_rig(self.rig.as_deref().unwrap_or(DEFAULT), &self.set)
    }

    /// How a program is interpreted that calls the place where the tool is at the start so.
    pub(super) fn settings(&self, reading: &Reading, start: InPlane) -> Settings {
        let start = in_space(start);
        Settings { start, home: self.park.unwrap_or(start), ..reading.settings() }
    }
}

impl Plan {
    /// The plan of a program for a rig. Its motions are shown to `also`, too.
    pub(super) fn new(
        reading: &Reading,
        file: &RigFile,
        planning: &Planning,
        mut also: impl FnMut(&Motion),
    ) -> anyhow::Result<Self> {
        let side = if planning.side == SideChoice::Middle { Side::Middle } else { Side::Outside };
        let for_rig = planning::settings(file, reading.start(), side)?;
        let settings = planning.settings(reading, for_rig.start);
        let optimise = planning.optimise;
        let mut source = reading.open()?;
        let mut plain = optimise.then(|| (Planner::new(for_rig.clone()), Vec::new()));
        let mut planner = Planner::new(torno_planner::Settings { optimise, ..for_rig });
        let (mut frames, mut lines) = (Vec::new(), Vec::new());
        let mut take = |Planned { line, frame }| {
            frames.push(frame.emit());
            lines.push(line);
        };
        let mut outcome = reading.interpret(&settings, &mut source, &mut |motion| {
            also(&motion);
            planner.take(&motion);
            core::iter::from_fn(|| planner.poll()).for_each(&mut take);
            if let Some((planner, frames)) = &mut plain {
                planner.take(&motion);
                frames.extend(core::iter::from_fn(|| planner.poll()).map(|planned| planned.frame.emit()));
            }
        })?;
        planner.finish();
        core::iter::from_fn(|| planner.poll()).for_each(take);
        let plain = plain.and_then(|(mut planner, mut frames)| {
            planner.finish();
            frames.extend(core::iter::from_fn(|| planner.poll()).map(|planned| planned.frame.emit()));
            (!planner.report().refused).then_some(Program { frames })
        });
        let report = planner.report();
        let words: Vec<_> = report.findings.iter().map(|finding| (finding.line, finding.word)).collect();
        let columns = reading.columns(&mut source, &words)?;
        outcome.findings = together(outcome.findings, &report.findings, &columns);
        if outcome.is_refused() {
            (frames, lines) = (Vec::new(), Vec::new());
        }
        Ok(Self { program: Program { frames }, lines, report, outcome, plain })
    }

    pub(super) fn is_refused(&self) -> bool {
        self.outcome.is_refused()
    }

    /// What is wrong with it, or strange, a line each.
    pub(super) fn told(&self, reading: &Reading) -> String {
        self.outcome.findings.iter().map(|finding| reading.told(finding)).collect()
    }

    /// Whether playing it takes minutes.
    fn is_long(&self) -> bool {
        [Some(&self.program), self.plain.as_ref()].into_iter().flatten().any(|it| it.frames.len() > PLAYED_MAX)
    }

    /// Plays it. None, if a signal came first.
    async fn play(&self, file: &RigFile, interrupt: &mut Interrupt) -> anyhow::Result<Option<Times>> {
        // What becomes of the bar is of no interest.
        let file = &RigFile { part: None, ..file.clone() };
        let Some(played) = play(file, &self.program, interrupt).await? else { return Ok(None) };
        let mut saved_s = None;
        if let Some(plain) = &self.plain {
            let Some(plain) = play(file, plain, interrupt).await? else { return Ok(None) };
            saved_s = Some(plain.end.as_secs_f64() - played.end.as_secs_f64());
        }
        Ok(Some(Times { played, saved_s }))
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

/// What playing a plan has told.
struct Times {
    played: Played,
    /// What shorter retracts save, if they were asked for.
    saved_s: Option<f64>,
}

/// What is told of a plan.
struct Summary<'a> {
    name: String,
    rig: &'a str,
    plan: &'a Plan,
    /// None, if it has not been played.
    times: Option<Times>,
}

impl Summary<'_> {
    fn as_json(&self) -> serde_json::Value {
        let Self { name, rig, plan, times } = self;
        let Plan { report: Report { worst, end, .. }, outcome, .. } = plan;
        let (refused, warnings): (Vec<_>, Vec<_>) =
            outcome.findings.iter().partition(|finding| finding.severity == Severity::Error);
        let objects = |findings: Vec<&Finding>| findings.into_iter().map(as_json).collect::<Vec<_>>();
        let is_planned = refused.is_empty();
        let played = times.as_ref().map(|times| &times.played);
        json!({
            "file": name,
            "rig": rig,
            "dialect": outcome.dialect.name(),
            "lines": outcome.lines,
            "motions": outcome.motions,
            "frames": plan.program.frames.len(),
            "time_s": played.map(|played| played.end.as_secs_f64()),
            "saved_s": times.as_ref().and_then(|times| times.saved_s),
            "outcome": played.map(Played::outcome),
            "worst_x_mm": is_planned.then_some(worst.x),
            "worst_z_mm": is_planned.then_some(worst.z),
            "end": is_planned.then(|| json!({ "x": end.x, "z": end.z })),
            "warnings": objects(warnings),
            "refused": objects(refused),
        })
    }
}

impl fmt::Display for Summary<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, rig, plan, times } = self;
        let Outcome { dialect, lines, motions, .. } = &plan.outcome;
        if plan.is_refused() {
            return writeln!(f, "{name} is refused (dialect {})", dialect.name());
        }
        let Report { worst, end, .. } = &plan.report;
        writeln!(f, "{:<9}{name} on {rig}: dialect {}, {lines} lines, {motions} motions", "program", dialect.name())?;
        writeln!(f, "{:<9}{}", "frames", plan.program.frames.len())?;
        match times {
            Some(Times { played, saved_s }) => {
                let time = played.end.as_secs_f64();
                writeln!(f, "{:<9}{time:.3} s", "time")?;
                if let Some(saved) = saved_s {
                    let share = 100.0 * saved / (time + saved);
                    writeln!(f, "{:<9}{saved:.3} s, {share:.0} %, by shorter retracts", "saved")?;
                }
            }
            None => writeln!(f, "{:<9}not known: a plan of more than {PLAYED_MAX} frames is not played", "time")?,
        }
        writeln!(f, "{:<9}{:.4} mm in X (radius), {:.4} mm in Z, from the asked path", "worst", worst.x, worst.z)?;
        writeln!(f, "{:<9}X {:.3}, Z {:.3} mm (X as a radius)", "end", end.x, end.z)?;
        writeln!(f, "{:<9}{}", "outcome", times.as_ref().map_or("planned", |times| times.played.outcome()))
    }
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        let Self { reading, planning, output, json } = self;
        let file = planning.rig()?;
        let plan = Plan::new(&reading, &file, &planning, |_| {})?;
        let name = reading.name();
        let mut times = None;
        if !plan.is_refused() {
            let mut interrupt = Interrupt::listen()?;
            if let Some(path) = &output {
                let frames = plan.program.frames.len();
                let head = format!("{name}, planned for the rig {}: {frames} frames", file.name);
                OutputFile::create(path)?.write_by(|file| plan.write(&head, file))?;
            }
            if !plan.is_long() {
                times = plan.play(&file, &mut interrupt).await?;
                if times.is_none() {
                    return Ok(ExitCode::from(INTERRUPTED));
                }
            }
        }
        let code = match &times {
            _ if plan.is_refused() => ExitCode::from(USAGE),
            Some(times) if times.played.outcome != torno::job::Outcome::Completed => ExitCode::from(FAILED),
            _ => ExitCode::SUCCESS,
        };
        let summary = Summary { name, rig: &file.name, plan: &plan, times };
        let text = if json { format!("{}\n", summary.as_json()) } else { format!("{}{summary}", plan.told(&reading)) };
        // Of a program that is refused, no file is written.
        let beside = output.filter(|_| !plan.is_refused());
        print_beside(&[&beside], &text)?;
        Ok(code)
    }
}

/// Plays frames in this process, as fast as can be: the time that they take depends on what the machine did before, so
/// nothing less tells it. None, if a signal came first.
pub(super) async fn play(
    file: &RigFile,
    program: &Program,
    interrupt: &mut Interrupt,
) -> anyhow::Result<Option<Played>> {
    let bar = Bar::of_frames(program.frames.len());
    let play = Play::new(file.clone(), program.clone(), Driver::InProcess);
    let progress =
        |progress: torno::play::Progress<'_>| bar.update(progress.job.tally.accepted, Some(progress.now), "");
    let played = play.record(None, progress, interrupt.received()).await?;
    bar.clear();
    Ok((played.ended != PlayEnd::Interrupted).then_some(played))
}

impl Reading {
    /// What the program calls the place where the tool is at the start, if that is said.
    pub(super) fn start(&self) -> Option<InPlane> {
        self.at.map(in_plane)
    }

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
