//! `torno test`

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use torno::recorder::Recorder;
use torno::report::Bar;
use torno::scenario::{Scenario, TestReport, run_all, run_one, seed_text};
use torno::session::SessionError;

use super::options::Placement;
use super::{FAILED, print, print_text, start_recording, write_file};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// Scenario files, or folders of them
    #[arg(required = true, value_name = "SCENARIO")]
    scenarios: Vec<PathBuf>,
    /// Where everything random comes from, instead of what the scenario says
    #[arg(long)]
    seed: Option<u64>,
    /// So many scenarios at once [default: one a processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    #[command(flatten)]
    placement: Placement,
    /// Records everything that happens, for 'torno trace', 'torno replay' and 'torno diff'; overwrites a trace. For one
    /// scenario
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Writes the results as JUnit XML
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
    /// Prints a line of JSON for each scenario
    #[arg(long)]
    json: bool,
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        let mut scenarios = Vec::new();
        for path in files(&self.scenarios)? {
            let scenario = Scenario::load(&path, self.seed)?;
            scenarios.push((path.display().to_string(), scenario));
        }
        let driver = self.placement.or_in_process()?;
        let recorder = self.record.as_deref().map(|path| recorder(path, &scenarios)).transpose()?;
        if !self.json {
            let random = scenarios.iter().filter(|(_, scenario)| scenario.is_random());
            let line = |(_, s): &(String, Scenario)| format!("{}: seed {}\n", s.name, seed_text(s.seed, &s.drawn));
            print(&random.map(line).collect::<String>())?;
        }
        let jobs = self.jobs.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), usize::from);
        let bar = Bar::of_scenarios(scenarios.len() as u64);
        let tested = match (&scenarios[..], recorder) {
            ([(path, scenario)], Some(recorder)) => vec![alone(|| run_one(path, scenario, &driver, Some(recorder)))],
            _ => run_all(&scenarios, &driver, jobs, || bar.count()),
        };
        bar.clear();
        let report = TestReport::new(tested.into_iter().collect::<Result<Vec<_>, SessionError>>()?);
        if let Some(path) = &self.junit {
            write_file(path, report.junit()?)?;
        }
        if self.json { print(&report.json()?) } else { print_text(&report) }?;
        Ok(if report.passed() { ExitCode::SUCCESS } else { ExitCode::from(FAILED) })
    }
}

/// Does something in a thread of its own: here is a runtime.
fn alone<T: Send>(act: impl FnOnce() -> T + Send) -> T {
    std::thread::scope(|scope| scope.spawn(act).join()).unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

/// A recording of the one scenario.
fn recorder(path: &Path, scenarios: &[(String, Scenario)]) -> anyhow::Result<Recorder> {
    let [(_, Scenario { file, rig, seed, .. })] = scenarios else {
        anyhow::bail!("--record: expected one scenario, found {}", scenarios.len());
    };
    start_recording(path, &file.header(rig, *seed, None))
}

/// The files themselves, and those in folders, by name.
fn files(paths: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let entries =
            std::fs::read_dir(path).with_context(|| format!("cannot read the folder '{}'", path.display()))?;
        let mut found: Vec<PathBuf> = entries.filter_map(|entry| entry.ok().map(|entry| entry.path())).collect();
        found.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
        found.sort();
        anyhow::ensure!(!found.is_empty(), "{}: expected scenarios (*.toml), found none", path.display());
        files.extend(found);
    }
    Ok(files)
}
