//! `torno sweep`

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use anyhow::Context;
use torno::observe::stderr::say;
use torno::report::Bar;
use torno::rig::Driver;
use torno::scenario::{Keep, Tested, in_order, run_one, seed_text, shell_word};
use torno::session::INTERRUPTED as ENDED;
use torno::sweep::{Grid, Job, Run, Scene, Shard, Table, Variation, Verdict, Whole, merge, shrink};

use super::{FAILED, INTERRUPTED, USAGE, print, processors, unless_interrupted};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// A scenario file; with --merge, result files
    #[arg(required = true, value_name = "SCENARIO")]
    files: Vec<PathBuf>,
    /// Seeds 0 to N−1 for each combination of values
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    seeds: u64,
    /// This seed only: how a failure is looked at again
    #[arg(long, value_name = "N", conflicts_with_all = ["seeds", "shard", "merge"])]
    seed: Option<u64>,
    /// What to vary: fault.NAME.FIELD, line.LINE.noise, BOARD.TABLE.FIELD, BOARD.clock_ppm or pc.FIELD, as
    /// PLACE=FROM..TO, PLACE=FROM..TO/COUNT or PLACE=VALUE,VALUE… (may be given several times)
    #[arg(long, value_name = "PLACE=VALUES")]
    vary: Vec<String>,
    /// So many runs at once [default: one a processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Does only part I of N, for another machine to do the others
    #[arg(long, value_name = "I/N", conflicts_with = "merge", value_parser = shard)]
    shard: Option<Shard>,
    /// Puts the results of all shards (of --json) into one table
    #[arg(long, conflicts_with_all = ["seeds", "vary", "jobs"])]
    merge: bool,
    /// Counts line errors, too: the characters that a receiver has got with an error
    #[arg(long, conflicts_with = "merge")]
    line_errors: bool,
    /// Prints the table as CSV
    #[arg(long, conflicts_with = "json")]
    csv: bool,
    /// Prints a line of JSON for each run, as soon as it and all before it are done; the table goes to standard error
    #[arg(long)]
    json: bool,
}

fn shard(text: &str) -> Result<Shard, String> {
    let numbers = text.split_once('/').and_then(|(part, of)| Some((part.parse().ok()?, of.parse().ok()?)));
    match numbers {
        Some((part, of)) if (1..=of).contains(&part) => Ok(Shard { part, of }),
        _ => Err("expected I/N, with I from 1 to N".to_owned()),
    }
}

/// What is done, and how.
struct Work {
    path: String,
    scene: Scene,
    grid: Grid,
    sweep: Whole,
    threads: usize,
    line_errors: bool,
    json: bool,
    bar: Bar,
    so_far: Mutex<SoFar>,
}

/// What has come of the sweep so far.
#[derive(Default)]
struct SoFar {
    table: Table,
    /// Its runs.
    done: u64,
    /// The first run that failed, and the first that was inconclusive.
    firsts: [Option<(Job, Tested)>; 2],
    /// Why it cannot go on.
    error: Option<anyhow::Error>,
    /// No one waits for more of it.
    over: bool,
}

impl Arguments {
    pub(super) async fn run(mut self) -> anyhow::Result<ExitCode> {
        if self.merge {
            return self.put_together();
        }
        let [path] = &self.files[..] else { anyhow::bail!("expected one scenario, found {}", self.files.len()) };
        let scene = Scene::load(path)?;
        let variations = self.vary.iter().map(|text| Variation::parse(text)).collect::<Result<Vec<_>, _>>()?;
        let (first_seed, seeds) = self.seed.map_or((0, self.seeds), |seed| (seed, 1));
        let grid = Grid::new(variations, first_seed, seeds, self.shard.unwrap_or(Shard::WHOLE))?;
        // What is wrong with a value is told before anything runs; what is wrong with several together, when it runs.
        grid.each_value().try_for_each(|values| scene.with(&values, first_seed).map(drop))?;
        let vary = std::mem::take(&mut self.vary);
        let work = Arc::new(Work {
            path: path.display().to_string(),
            sweep: Whole { files: scene.digest(), seeds, vary, runs: grid.runs() },
            threads: self.jobs.map_or_else(processors, usize::from),
            line_errors: self.line_errors,
            json: self.json,
            bar: Bar::of_scenarios(grid.ours()),
            so_far: Mutex::default(),
            scene,
            grid,
        });
        let doing = Arc::clone(&work);
        let why = unless_interrupted(move || doing.run()).await?;
        work.bar.clear();
        let mut so_far = work.so_far();
        so_far.over = true;
        self.tell(&so_far.table, why.as_deref().unwrap_or_default())?;
        if let Some(error) = so_far.error.take() {
            return Err(error);
        }
        if why.is_none() {
            say(&format!("torno: {ENDED}: {} of {} runs are done\n", so_far.done, work.grid.ours()));
            return Ok(ExitCode::from(INTERRUPTED));
        }
        Ok(verdict(&so_far.table))
    }

    fn put_together(&self) -> anyhow::Result<ExitCode> {
        let runs = self.files.iter().map(|path| read(path)).collect::<anyhow::Result<Vec<_>>>()?.concat();
        let (runs, missing) = merge(runs)?;
        if self.json {
            runs.iter().try_for_each(print_run)?;
        }
        let table = Table::new(&runs);
        self.tell(&table, "")?;
        let Some(missing) = missing else { return Ok(verdict(&table)) };
        say(&format!("torno: --merge: {missing}\n"));
        Ok(ExitCode::from(USAGE))
    }

    /// Prints the table; beside lines of JSON, where it is none of them.
    fn tell(&self, table: &Table, why: &str) -> anyhow::Result<()> {
        match (self.json, self.csv) {
            (true, _) => say(&(table.text() + why)),
            (_, true) => print(&table.csv())?,
            _ => print(&(table.text() + why))?,
        }
        Ok(())
    }
}

fn verdict(table: &Table) -> ExitCode {
    if table.passed() { ExitCode::SUCCESS } else { ExitCode::from(FAILED) }
}

fn print_run(run: &Run) -> anyhow::Result<()> {
    print(&(serde_json::to_string(run)? + "\n"))
}

impl Work {
    fn so_far(&self) -> MutexGuard<'_, SoFar> {
        self.so_far.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does all runs. Gives what explains the first that did not pass.
    fn run(&self) -> String {
        let act = |n| {
            let tested = self.test(&self.grid.job(n));
            self.bar.count();
            tested
        };
        in_order(self.grid.ours(), self.threads, act, |n, tested| self.see(self.grid.job(n), tested));
        let [failed, inconclusive] = std::mem::take(&mut self.so_far().firsts);
        match (failed, inconclusive) {
            (Some((job, tested)), _) => why(&self.scene, &job, &tested).unwrap_or_else(|error| {
                self.so_far().error.get_or_insert(error);
                String::new()
            }),
            (None, Some((job, tested))) => told("inconclusive", "", &job, &tested),
            (None, None) => String::new(),
        }
    }

    /// What came of a run, and how many line errors it had, if they are counted.
    fn test(&self, job: &Job) -> anyhow::Result<(Tested, Option<u64>)> {
        let scenario = self.scene.with(&job.values, job.seed)?;
        let keep = if self.line_errors { Keep::Trace } else { Keep::Nothing };
        let mut tested = run_one(&self.path, &scenario, &Driver::InProcess, keep)?;
        let errors = tested.outcome.trace.take().map(|trace| trace.line_errors());
        Ok((tested, errors))
    }

    /// Takes note of what came of a run.
    fn see(&self, job: Job, tested: anyhow::Result<(Tested, Option<u64>)>) -> ControlFlow<()> {
        let mut so_far = self.so_far();
        if so_far.over {
            return ControlFlow::Break(());
        }
        let noted = tested.and_then(|(tested, line_errors)| {
            let run = Run { line_errors, ..record(&self.sweep, &job, &tested) };
            if self.json {
                self.bar.suspend(|| print_run(&run))?;
            }
            so_far.table.add(&run);
            so_far.done += 1;
            let [failed, inconclusive] = &mut so_far.firsts;
            match run.verdict {
                Verdict::Passed => {}
                Verdict::Told | Verdict::Untold => drop(failed.get_or_insert((job, tested))),
                Verdict::Inconclusive => drop(inconclusive.get_or_insert((job, tested))),
            }
            Ok(())
        });
        match noted {
            Ok(()) => ControlFlow::Continue(()),
            Err(error) => {
                so_far.error = Some(error);
                ControlFlow::Break(())
            }
        }
    }
}

fn record(sweep: &Whole, job: &Job, tested: &Tested) -> Run {
    let outcome = &tested.outcome;
    Run {
        sweep: sweep.clone(),
        number: job.number,
        scenario: tested.name.clone(),
        values: job.values.clone(),
        seed: job.seed,
        verdict: Verdict::of(outcome),
        failure: outcome.first_failure().map(|f| format!("expected {}, came {}", f.expected, f.came)),
        digest: outcome.digest.to_string(),
        line_errors: None,
    }
}

/// The first failure, with the fewest faults that still cause one.
fn why(scene: &Scene, job: &Job, tested: &Tested) -> anyhow::Result<String> {
    let all = scene.faults(&job.values);
    let fails = |faults: &[String]| -> anyhow::Result<bool> {
        let without: Vec<String> = all.iter().filter(|fault| !faults.contains(fault)).cloned().collect();
        // Without its faults there may be nothing left in it.
        let Ok(scenario) = scene.without(&without).with(&job.values, job.seed) else { return Ok(false) };
        Ok(Verdict::of(&run_one(&tested.path, &scenario, &Driver::InProcess, Keep::Nothing)?.outcome).is_failure())
    };
    let needed = shrink(&all, fails)?;
    let faults =
        if needed.is_empty() { ", even without a fault".to_owned() } else { format!(", by {}", needed.join(", ")) };
    Ok(told("failure", &faults, job, tested))
}

/// What is told of the first run that did not pass.
fn told(what: &str, by: &str, job: &Job, tested: &Tested) -> String {
    let values: String = job.values.iter().map(|(path, value)| format!("{path} = {value}, ")).collect();
    let failures: Vec<String> = tested.outcome.failures.iter().map(ToString::to_string).collect();
    let (seed, again, failures) = (seed_text(job.seed, &tested.drawn), again(job, tested), failures.join("\n"));
    format!("\nfirst {what}: {values}seed {seed}{by}\n{failures}\n  again     {again}\n")
}

/// The command that runs it again.
fn again(job: &Job, tested: &Tested) -> String {
    if job.values.is_empty() {
        return tested.again();
    }
    let vary = job.values.iter().map(|(place, value)| format!(" --vary {}", shell_word(&format!("{place}={value}"))));
    format!("torno sweep {} --seed {}{}", shell_word(&tested.path), job.seed, vary.collect::<String>())
}

/// The runs in a file of results, each with where it stands.
fn read(path: &Path) -> anyhow::Result<Vec<(String, Run)>> {
    let name = path.display();
    let lines = torno::text_file::lines(path).with_context(|| format!("cannot read '{name}'"))?;
    let lines = (1..).zip(lines);
    let run = |(number, line): (usize, std::io::Result<String>)| -> anyhow::Result<(String, Run)> {
        let line = line.with_context(|| format!("cannot read '{name}'"))?;
        let place = format!("{name}:{number}");
        let run = serde_json::from_str(&line)
            .with_context(|| format!("{place}: expected a run, as sweep --json prints it"))?;
        Ok((place, run))
    };
    lines.map(run).collect()
}
