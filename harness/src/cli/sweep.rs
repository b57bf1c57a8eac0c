//! `torno sweep`

use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;

use anyhow::Context;
use torno::observe::stderr::say;
use torno::report::Bar;
use torno::rig::Driver;
use torno::scenario::{Scenario, Tested, run_all, seed_text, shell_word};
use torno::session::SessionError;
use torno::sweep::{Run, Scene, Table, Variation, Verdict, Whole, cells, merge, shrink};

use super::{FAILED, USAGE, print};

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
    #[arg(long, value_name = "I/N", conflicts_with = "merge")]
    shard: Option<Shard>,
    /// Puts the results of all shards (of --json) into one table
    #[arg(long, conflicts_with_all = ["seeds", "vary", "jobs"])]
    merge: bool,
    /// Prints the table as CSV
    #[arg(long, conflicts_with = "json")]
    csv: bool,
    /// Prints a line of JSON for each run
    #[arg(long)]
    json: bool,
}

/// Part `part` of `of`, from 1.
#[derive(Clone, Copy, Debug)]
struct Shard {
    part: u64,
    of: u64,
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(part, of)| Some((part.parse().ok()?, of.parse().ok()?)));
        match numbers {
            Some((part, of)) if (1..=of).contains(&part) => Ok(Self { part, of }),
            _ => Err("expected I/N, with I from 1 to N".to_owned()),
        }
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.part, self.of)
    }
}

/// A run that is to be done.
struct Job {
    number: u64,
    values: Vec<(String, String)>,
    seed: u64,
}

impl Arguments {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        if self.merge {
            let runs = self.files.iter().map(|path| read(path)).collect::<anyhow::Result<Vec<_>>>()?.concat();
            let (runs, missing) = merge(runs)?;
            let told = self.tell(&runs, None)?;
            let Some(missing) = missing else { return Ok(told) };
            say(&format!("torno: --merge: {missing}\n"));
            return Ok(ExitCode::from(USAGE));
        }
        let [path] = &self.files[..] else { anyhow::bail!("expected one scenario, found {}", self.files.len()) };
        let scene = Scene::load(path)?;
        let variations = self.vary.iter().map(|text| Variation::parse(text)).collect::<Result<Vec<_>, _>>()?;
        let cells = cells(&variations);
        let seeds = self.seed.map_or(self.seeds, |_| 1);
        let runs = seeds.saturating_mul(cells.len() as u64);
        let sweep = Whole { files: scene.digest(), seeds, vary: self.vary.clone(), runs };
        let jobs = self.jobs(&cells);
        let scenarios = jobs.iter().map(|job| scene.with(&job.values, job.seed)).collect::<Result<Vec<_>, _>>()?;
        let named: Vec<(String, Scenario)> =
            scenarios.into_iter().map(|scenario| (path.display().to_string(), scenario)).collect();
        let bar = Bar::of_scenarios(named.len());
        let threads =
            self.jobs.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), usize::from);
        let tested = run_all(&named, &Driver::InProcess, threads, |done| bar.count(done));
        bar.clear();
        let tested: Vec<Tested> = tested.into_iter().collect::<Result<_, SessionError>>()?;
        let runs: Vec<Run> = jobs.iter().zip(&tested).map(|(job, tested)| record(&sweep, job, tested)).collect();
        let failed = runs.iter().position(|run| run.verdict != Verdict::Passed);
        let why = failed.map(|first| why(&scene, &jobs[first], &tested[first])).transpose()?;
        self.tell(&runs, why.as_deref())
    }

    fn seeds_of_each(&self) -> std::ops::Range<u64> {
        self.seed.map_or(0..self.seeds, |seed| seed..seed.saturating_add(1))
    }

    /// What this shard is to do.
    fn jobs(&self, cells: &[Vec<(String, String)>]) -> Vec<Job> {
        let all = cells.iter().flat_map(|values| self.seeds_of_each().map(move |seed| (values, seed)));
        let shard = self.shard.unwrap_or(Shard { part: 1, of: 1 });
        let ours = (0..).zip(all).filter(|(number, _)| number % shard.of == shard.part - 1);
        ours.map(|(number, (values, seed))| Job { number, values: values.clone(), seed }).collect()
    }

    fn tell(&self, runs: &[Run], why: Option<&str>) -> anyhow::Result<ExitCode> {
        let passed = runs.iter().all(|run| run.verdict == Verdict::Passed);
        let text = match (self.json, self.csv) {
            (true, _) => {
                runs.iter().map(|run| Ok(serde_json::to_string(run)? + "\n")).collect::<anyhow::Result<_>>()?
            }
            (_, true) => Table::new(runs).csv(),
            _ => Table::new(runs).text() + why.unwrap_or_default(),
        };
        print(&text)?;
        // A table of what fails is a result; a single combination is a test.
        Ok(if passed || !self.vary.is_empty() || self.merge { ExitCode::SUCCESS } else { ExitCode::from(FAILED) })
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
        failure: outcome.failures.first().map(|f| format!("expected {}, came {}", f.expected, f.came)),
        digest: outcome.digest.to_string(),
    }
}

/// The first failure, with the fewest faults that still cause one.
fn why(scene: &Scene, job: &Job, tested: &Tested) -> anyhow::Result<String> {
    let all = scene.faults(&job.values);
    let fails = |faults: &[String]| -> anyhow::Result<bool> {
        let without: Vec<String> = all.iter().filter(|fault| !faults.contains(fault)).cloned().collect();
        // Without its faults there may be nothing left in it.
        let Ok(scenario) = scene.without(&without).with(&job.values, job.seed) else { return Ok(false) };
        let tested = run_all(&[(tested.path.clone(), scenario)], &Driver::InProcess, 1, |_| ());
        Ok(tested.into_iter().collect::<Result<Vec<_>, _>>()?.iter().any(|tested| !tested.outcome.failures.is_empty()))
    };
    let needed = shrink(&all, fails)?;
    let values: Vec<String> = job.values.iter().map(|(path, value)| format!("{path} = {value}, ")).collect();
    let faults =
        if needed.is_empty() { "even without a fault".to_owned() } else { format!("by {}", needed.join(", ")) };
    let failures: Vec<String> = tested.outcome.failures.iter().map(ToString::to_string).collect();
    let (seed, again, failures) = (seed_text(job.seed, &tested.drawn), again(job, tested), failures.join("\n"));
    Ok(format!("\nfirst failure: {}seed {seed}, {faults}\n{failures}\n  again     {again}\n", values.concat()))
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
