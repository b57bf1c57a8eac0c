//! `torno test`

mod select;

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use torno::observe::stderr::say;
use torno::recorder::Recorder;
use torno::report::Bar;
use torno::rig::Driver;
use torno::scenario::{
    Attempt, Broken, Keep, Scenario, TestReport, Tested, Verdict, in_order, run_one, seed_text, show_one,
};
use torno::session::{Audience, INTERRUPTED as ENDED, SessionError};

use super::options::Placement;
use super::page::{Role, WatchOptions};
use super::{
    FAILED, INTERRUPTED, Interrupt, OutputFile, USAGE, exit, print, print_text, processors, start_recording,
    unless_interrupted,
};
use select::Selected;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// Scenario files, or folders of them; of a folder, every scenario in it and in the folders below
    #[arg(required = true, value_name = "SCENARIO")]
    scenarios: Vec<PathBuf>,
    /// Only scenarios with this text in their name or in the path of their file, in capitals or not
    #[arg(short = 'k', long, value_name = "TEXT")]
    filter: Option<String>,
    /// Lists the scenarios instead of running them
    #[arg(long, conflicts_with_all = ["junit", "record"])]
    list: bool,
    /// Runs nothing more after the first scenario that does not pass
    #[arg(long)]
    fail_fast: bool,
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
    #[command(flatten)]
    watch: WatchOptions,
    /// Writes the results as JUnit XML; overwrites a file, also if there will be no results
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
    /// Prints a line of JSON for each scenario; before it, one for --page
    #[arg(long)]
    json: bool,
}

/// What is done.
struct Work {
    selected: Vec<Selected>,
    driver: Driver,
    recorder: Mutex<Option<Recorder>>,
    threads: usize,
    fail_fast: bool,
    bar: Bar,
    so_far: Mutex<SoFar>,
}

/// What has come of it so far.
#[derive(Default)]
struct SoFar {
    attempts: Vec<Attempt>,
    /// The exit status of the scenarios that could not be run.
    status: Option<u8>,
    /// No one waits for more of it.
    over: bool,
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        // First of all: what stands in the file must not be taken for the result of this run, however it ends.
        let junit = self.junit.as_ref().map(OutputFile::create).transpose()?;
        let selected = select::select(&self.scenarios, self.filter.as_deref(), self.seed)?;
        for error in selected.iter().filter_map(|selected| selected.scenario.as_ref().err()) {
            say(&format!("torno: {error:#}\n"));
        }
        if self.list {
            return self.list(&selected);
        }
        let driver = self.placement.or_in_process()?;
        let recorder = self.record.as_deref().map(|path| recorder(path, &selected)).transpose()?;
        let (page, audience) = if self.watch.is_asked() {
            let Scenario { file, rig, seed, .. } = the_only(&selected, "--page")?;
            self.watch.show(file, &file.header(rig, *seed, None), Role::Test, self.json)?
        } else {
            (None, None)
        };
        if !self.json {
            let scenarios = selected.iter().filter_map(|selected| selected.scenario.as_ref().ok());
            let random = scenarios.filter(|scenario| scenario.is_random());
            let line = |s: &Scenario| format!("{}: seed {}\n", s.name, seed_text(s.seed, &s.drawn));
            print(&random.map(line).collect::<String>())?;
        }
        let count = selected.len();
        let runs = selected.iter().any(|selected| selected.scenario.is_ok());
        let work = Arc::new(Work {
            selected,
            driver,
            recorder: Mutex::new(recorder),
            threads: self.jobs.map_or_else(processors, usize::from),
            fail_fast: self.fail_fast,
            bar: Bar::of_scenarios(count as u64),
            so_far: Mutex::default(),
        });
        let doing = Arc::clone(&work);
        let done = match audience {
            Some(audience) => work.show(audience).await?,
            None => unless_interrupted(move || doing.run()).await?,
        };
        work.bar.clear();
        if let Some(page) = page {
            page.end(work.outcome()).await;
        }
        let mut so_far = work.so_far();
        so_far.over = true;
        let attempts = std::mem::take(&mut so_far.attempts);
        let not_run = count - attempts.len();
        let report = TestReport::new(attempts, not_run);
        if let Some(file) = junit {
            file.write(report.junit()?)?;
        }
        if self.json {
            print(&report.json()?)?;
        } else if runs {
            print_text(&report)?;
        }
        if done.is_none() {
            say(&format!("torno: {ENDED}: {} of {count} scenarios are done\n", count - not_run));
            return Ok(ExitCode::from(INTERRUPTED));
        }
        Ok(match so_far.status {
            Some(status) => ExitCode::from(status),
            None if report.passed() => ExitCode::SUCCESS,
            None => ExitCode::from(FAILED),
        })
    }

    fn list(&self, selected: &[Selected]) -> anyhow::Result<ExitCode> {
        let scenarios = || selected.iter().filter_map(|s| Some((&s.path, &s.scenario.as_ref().ok()?.name)));
        let width = scenarios().map(|(path, _)| path.chars().count()).max().unwrap_or_default();
        let line = |(path, name): (&String, &String)| match self.json {
            true => serde_json::json!({ "path": path, "name": name }).to_string() + "\n",
            false => format!("{path:width$}  {name}\n"),
        };
        print(&scenarios().map(line).collect::<String>())?;
        let whole = selected.iter().all(|selected| selected.scenario.is_ok());
        Ok(if whole { ExitCode::SUCCESS } else { ExitCode::from(USAGE) })
    }
}

impl Work {
    fn run(&self) {
        let act = |n: u64| {
            let attempt = self.attempt(n as usize);
            self.bar.count();
            attempt
        };
        in_order(self.selected.len() as u64, self.threads, act, |_, (attempt, status)| {
            let mut so_far = self.so_far();
            if so_far.over {
                return ControlFlow::Break(());
            }
            let stop = self.fail_fast && attempt.verdict() != Some(Verdict::Passed);
            so_far.add(attempt, status);
            if stop { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
    }

    /// What comes of a scenario; and the exit status, if it cannot be run.
    fn attempt(&self, n: usize) -> (Attempt, Option<u8>) {
        let Selected { path, scenario, .. } = &self.selected[n];
        let scenario = match scenario {
            Ok(scenario) => scenario,
            Err(error) => return self.broken(n, error, USAGE),
        };
        self.came_of(n, run_one(path, scenario, &self.driver, self.keep()))
    }

    /// Shows the only scenario to somebody; None, if a signal came first.
    async fn show(&self, audience: Box<dyn Audience>) -> anyhow::Result<Option<()>> {
        let mut interrupt = Interrupt::listen()?;
        let Selected { path, .. } = &self.selected[0];
        let scenario = the_only(&self.selected, "--page")?;
        tokio::select! {
            tested = show_one(path, scenario, &self.driver, self.keep(), audience) => {
                let (attempt, status) = self.came_of(0, tested);
                self.so_far().add(attempt, status);
                Ok(Some(()))
            }
            () = interrupt.received() => Ok(None),
        }
    }

    /// The word for what has come of the only scenario.
    fn outcome(&self) -> &'static str {
        let so_far = self.so_far();
        let outcome = so_far.attempts.first().map(|attempt| attempt.verdict().map_or("broken", Verdict::name));
        outcome.unwrap_or(ENDED)
    }

    /// What is kept of the next scenario.
    fn keep(&self) -> Keep {
        let recorder = self.recorder.lock().unwrap_or_else(PoisonError::into_inner).take();
        recorder.map_or(Keep::Nothing, Keep::Recording)
    }

    fn so_far(&self) -> MutexGuard<'_, SoFar> {
        self.so_far.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What came of a scenario that could be run, or else the exit status.
    fn came_of(&self, n: usize, tested: Result<Tested, SessionError>) -> (Attempt, Option<u8>) {
        match tested {
            Ok(tested) => (Attempt::Tested(Box::new(tested)), None),
            Err(error) => {
                let error = error.into();
                self.bar.suspend(|| say(&format!("torno: {}: {error:#}\n", self.selected[n].path)));
                self.broken(n, &error, exit::code(&error))
            }
        }
    }

    /// A scenario that cannot be run, and the exit status.
    fn broken(&self, n: usize, error: &anyhow::Error, status: u8) -> (Attempt, Option<u8>) {
        let Selected { path, name, .. } = &self.selected[n];
        let (path, name, message) = (path.clone(), name.clone(), format!("{error:#}"));
        (Attempt::Broken(Broken { path, name, message }), Some(status))
    }
}

impl SoFar {
    fn add(&mut self, attempt: Attempt, status: Option<u8>) {
        self.attempts.push(attempt);
        self.status = self.status.max(status);
    }
}

/// The one scenario that an option is for.
fn the_only<'a>(selected: &'a [Selected], option: &str) -> anyhow::Result<&'a Scenario> {
    let [Selected { scenario: Ok(scenario), .. }] = selected else {
        let found = selected.iter().filter(|selected| selected.scenario.is_ok()).count();
        anyhow::bail!("{option}: expected one scenario, found {found}");
    };
    Ok(scenario)
}

/// A recording of the one scenario.
fn recorder(path: &Path, selected: &[Selected]) -> anyhow::Result<Recorder> {
    let Scenario { file, rig, seed, .. } = the_only(selected, "--record")?;
    start_recording(path, &file.header(rig, *seed, None))
}
