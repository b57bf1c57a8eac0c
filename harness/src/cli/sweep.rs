//! `torno sweep`

use std::fmt;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;

use anyhow::Context;
use torno::observe::log;
use torno::report::{Bar, Tested, seed_text};
use torno::rig::Driver;
use torno::scenario::{Scenario, run_all};
use torno::sweep::{Run, Scene, Table, Variation, Verdict, cells, shrink};
use torno::trace::SessionError;

use super::{FAILED, print};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// A scenario file; with --merge, result files
    #[arg(required = true, value_name = "SCENARIO")]
    files: Vec<PathBuf>,
    /// Seeds 0 to N−1 for each combination of values
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    seeds: u64,
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
    /// Puts results of several shards (of --json) into one table
    #[arg(long)]
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
    values: Vec<(String, String)>,
    seed: u64,
}

impl Arguments {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        log::init("error");
        if self.merge {
            let runs = self.files.iter().map(|path| read(path)).collect::<anyhow::Result<Vec<_>>>()?.concat();
            return self.tell(&runs, None);
        }
        let [path] = &self.files[..] else { anyhow::bail!("expected one scenario, found {}", self.files.len()) };
        let scene = Scene::load(path)?;
        let jobs = self.jobs()?;
        let scenarios = jobs.iter().map(|job| scene.with(&job.values, job.seed)).collect::<Result<Vec<_>, _>>()?;
        let named: Vec<(String, Scenario)> =
            scenarios.into_iter().map(|scenario| (path.display().to_string(), scenario)).collect();
        let bar = Bar::of_scenarios(named.len());
        let threads =
            self.jobs.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), usize::from);
        let tested = run_all(&named, &Driver::InProcess, threads, |done| bar.count(done));
        bar.clear();
        let tested: Vec<Tested> = tested.into_iter().collect::<Result<_, SessionError>>()?;
        let runs: Vec<Run> = jobs.iter().zip(&tested).map(|(job, tested)| record(job, tested)).collect();
        let failed = runs.iter().position(|run| run.verdict != Verdict::Passed);
        let why = failed.map(|first| why(&scene, &jobs[first], &tested[first])).transpose()?;
        self.tell(&runs, why.as_deref())
    }

    /// What this shard is to do.
    fn jobs(&self) -> anyhow::Result<Vec<Job>> {
        let variations = self.vary.iter().map(|text| Variation::parse(text)).collect::<Result<Vec<_>, _>>()?;
        let all = cells(&variations)
            .into_iter()
            .flat_map(|values| (0..self.seeds).map(move |seed| Job { values: values.clone(), seed }));
        let shard = self.shard.unwrap_or(Shard { part: 1, of: 1 });
        Ok((0..).zip(all).filter(|(n, _)| n % shard.of == shard.part - 1).map(|(_, job)| job).collect())
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

fn record(job: &Job, tested: &Tested) -> Run {
    let outcome = &tested.outcome;
    Run {
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
    let seed = seed_text(job.seed, &tested.drawn);
    Ok(format!("\nfirst failure: {}seed {seed}, {faults}\n{}\n", values.concat(), failures.join("\n")))
}

fn read(path: &Path) -> anyhow::Result<Vec<Run>> {
    let name = path.display();
    let file = std::fs::File::open(path).with_context(|| format!("cannot read '{name}'"))?;
    let lines = (1..).zip(BufReader::new(file).lines());
    let run = |(number, line): (usize, std::io::Result<String>)| -> anyhow::Result<Run> {
        let line = line.with_context(|| format!("cannot read '{name}'"))?;
        serde_json::from_str(&line)
            .with_context(|| format!("{name}:{number}: expected a run, as sweep --json prints it"))
    };
    lines.map(run).collect()
}
