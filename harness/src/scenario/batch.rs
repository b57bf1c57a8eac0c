//! Many scenarios at once.

use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::Tested;
use super::{Scenario, record};
use crate::recorder::Recorder;
use crate::rig::{Driver, RigError};
use crate::session::{SessionError, in_process};

/// Runs all, `jobs` at once; `done` hears how many are. The results are in the order of the scenarios, which come with
/// their files' names.
pub fn run_all(
    scenarios: &[(String, Scenario)],
    driver: &Driver,
    jobs: usize,
    done: impl Fn(usize) + Sync,
) -> Vec<Result<Tested, SessionError>> {
    let next = AtomicUsize::new(0);
    let results: Mutex<Vec<(usize, Result<Tested, SessionError>)>> = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..jobs.min(scenarios.len()) {
            scope.spawn(|| {
                loop {
                    let place = next.fetch_add(1, Ordering::Relaxed);
                    let Some((path, scenario)) = scenarios.get(place) else { break };
                    let tested = run_one(path, scenario, driver, None);
                    let mut results = results.lock().unwrap_or_else(PoisonError::into_inner);
                    results.push((place, tested));
                    done(results.len());
                }
            });
        }
    });
    let mut results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    results.sort_by_key(|(place, _)| *place);
    results.into_iter().map(|(_, tested)| tested).collect()
}

/// Runs one, and records it.
///
/// # Errors
/// [`SessionError`] if the rig itself breaks, or the recording cannot go on.
pub fn run_recorded(
    path: &str,
    scenario: &Scenario,
    driver: &Driver,
    recorder: Recorder,
) -> Result<Tested, SessionError> {
    let run = || run_one(path, scenario, driver, Some(recorder));
    // In a thread of its own, as all: whoever asks may be in a runtime.
    std::thread::scope(|scope| scope.spawn(run).join()).unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

#[expect(clippy::disallowed_methods, reason = "how long a scenario takes is told beside its result")]
fn run_one(
    path: &str,
    scenario: &Scenario,
    driver: &Driver,
    recorder: Option<Recorder>,
) -> Result<Tested, SessionError> {
    let started = std::time::Instant::now();
    let session = record(scenario, driver, recorder);
    let outcome = match driver {
        Driver::InProcess => in_process(session)?,
        Driver::Processes { .. } | Driver::ByHand { .. } => {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(RigError::from)?;
            runtime.block_on(session)?
        }
    };
    let (path, name, seed, drawn) = (path.to_owned(), scenario.name.clone(), scenario.seed, scenario.drawn.clone());
    Ok(Tested { path, name, seed, drawn, outcome, wall: started.elapsed() })
}
