//! `torno engraver`

use std::path::PathBuf;
use std::process::ExitCode;

use torno::fault::{self, Planned};
use torno::job::LineJob;
use torno::play::Play;
use torno::report::{LoopComparison, LoopRow, cpu_percent};
use torno::rig::Driver;
use torno::rig::file::RigFile;
use torno::tracking::{Tracking, has_axes};
use torno_plot::{Colours, Figure, Format, Panel};

use super::options::drawing;
use super::output::{OutputFile, draw, print_beside, written};
use super::{INTERRUPTED, Interrupt, LoadedLines, load_lines, load_rig};

/// The loops: name, and what is set for them.
const LOOPS: [(&str, &[&str]); 5] = [
    ("open", &["mode=open"]),
    ("fixed 1 ms", &["mode=fixed", "period_ms=1"]),
    ("fixed 10 ms", &["mode=fixed", "period_ms=10"]),
    ("fixed 50 ms", &["mode=fixed", "period_ms=50"]),
    ("dynamic", &["mode=dynamic"]),
];

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Plays a program with an open, with fixed and with a dynamic loop, and shows beside one another what comes of it
    Compare(CompareArguments),
}

#[derive(Debug, clap::Args)]
struct CompareArguments {
    /// A program of G-code [default: a rosette]
    program: Option<PathBuf>,
    /// A built-in rig or a rig file
    #[arg(long, default_value = "engraver")]
    rig: String,
    /// Sets what the rig file could say (may be given several times)
    #[arg(long, value_name = "PLACE=VALUE")]
    set: Vec<String>,
    /// Breaks what this file says: [[fault]] tables as in a scenario
    #[arg(long, value_name = "FILE")]
    faults: Option<PathBuf>,
    /// Draws for each loop the way that was asked and the way that was gone (.svg); how far they are apart is magnified
    #[arg(long, value_name = "FILE", value_parser = drawing)]
    plot: Option<PathBuf>,
    /// Writes a page with the comparison and that picture (.html)
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Prints the comparison as one line of JSON
    #[arg(long)]
    json: bool,
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        match self.command {
            Command::Compare(arguments) => arguments.run().await,
        }
    }
}

/// A way with the name of its loop.
type NamedTracking = (&'static str, Tracking);

impl CompareArguments {
    async fn run(self) -> anyhow::Result<ExitCode> {
        let file = load_rig(&self.rig, &self.set)?;
        let Some(board) = file.boards.iter().find(|board| has_axes(&board.description)) else {
            anyhow::bail!("the rig '{}' has no loops to compare: expected one such as 'engraver'", file.name);
        };
        let board = board.name.clone();
        if let Some(set) = self.set.iter().find(|set| is_of_rows(&board, set)) {
            anyhow::bail!(
                "expected settings that all loops have in common, found '--set {set}': each row has a mode and a \
                 period of its own"
            );
        }
        let LoadedLines { name, job, .. } = load_lines(self.program.as_deref(), &file, None)?;
        let faults = match &self.faults {
            Some(path) => fault::load(path, &file.names(), None)?.faults,
            None => Vec::new(),
        };
        let report = self.report.as_ref().map(OutputFile::create).transpose()?;
        let mut interrupt = Interrupt::listen()?;
        let plays = async {
            let mut rows = Vec::new();
            let mut ways: Vec<NamedTracking> = Vec::new();
            for (loop_name, settings) in LOOPS {
                let set = |file: RigFile, setting: &&str| file.set(&format!("{board}.loop.{setting}"));
                let file = settings.iter().try_fold(file.clone(), set).map_err(anyhow::Error::msg)?;
                let (row, way) = play(loop_name, file, job.clone(), faults.clone(), &board).await?;
                rows.push(row);
                ways.extend(way.map(|way| (loop_name, way)));
            }
            anyhow::Ok((rows, ways))
        };
        let (loops, ways) = tokio::select! {
            done = plays => done?,
            () = interrupt.received() => return Ok(ExitCode::from(INTERRUPTED)),
        };
        let picture = figure(&name, &ways);
        let comparison = LoopComparison { program: name, loops };
        if let Some(path) = &self.plot {
            draw(path, &picture, &Colours::default())?;
        }
        if let Some(file) = report {
            let picture = picture.encode(Format::Svg, &Colours::default())?;
            file.write(comparison.html(&String::from_utf8_lossy(&picture)))?;
        }
        print_beside(&[&self.report, &self.plot], &written(self.json, &comparison)?)?;
        Ok(ExitCode::SUCCESS)
    }
}

/// Whether this sets what differs between the rows.
fn is_of_rows(board: &str, set: &str) -> bool {
    let field = set.split('=').next().and_then(|place| place.trim().strip_prefix(board)?.strip_prefix(".loop."));
    matches!(field, Some("mode" | "period_ms"))
}

async fn play(
    name: &'static str,
    file: RigFile,
    job: LineJob,
    faults: Vec<Planned>,
    board: &str,
) -> anyhow::Result<(LoopRow, Option<Tracking>)> {
    let header = file.header(&file.name, 0, None);
    let play = Play { faults, keep: Some(header), ..Play::of(file, job, Driver::InProcess) };
    let played = play.run(|_| ()).await?;
    let told = played.boards.iter().find(|ended| ended.name == board).map(|ended| &ended.telemetry);
    let all = |end: &str| {
        let values = told.into_iter().flatten().filter(|(name, _)| name.ends_with(end));
        values.map(|(_, value)| *value).collect::<Vec<i64>>()
    };
    let way = played.trace.as_ref().map(Tracking::of).transpose()?.flatten();
    let most_mm = |values: Vec<i64>| values.into_iter().map(i64::abs).max().unwrap_or(0) as f64 / 1e6;
    let checks = all("_checks");
    let in_a_second = |checks: i64| checks as f64 / played.end.as_secs_f64();
    let row = LoopRow {
        name,
        outcome: played.outcome(),
        worst_mm: most_mm(all("_worst_nm")),
        final_mm: way.as_ref().map_or(0.0, Tracking::last_mm),
        corrections: all("_corrections").into_iter().sum(),
        loops_per_s: in_a_second(checks.iter().copied().max().unwrap_or(0)),
        cpu_percent: cpu_percent(in_a_second(checks.iter().sum())),
        time_s: played.idle_after.filter(|_| played.job.alarm.is_none()).map(|time| time.as_secs_f64()),
        alarm: played.job.alarm,
    };
    Ok((row, way))
}

/// The ways below one another.
fn figure(program: &str, ways: &[NamedTracking]) -> Figure {
    let panels = ways.iter().filter_map(|(name, way)| way.magnified(name)).map(Panel::to_scale).collect();
    Figure { title: format!("{program}: where each loop goes"), panels }
}
