//! Many scenarios at once.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use super::Tested;
use super::{Keep, Scenario, record, show};
use crate::rig::{Driver, RigError};
use crate::session::{Audience, SessionError, in_process};

/// What has been done, on its way to whoever sees it.
struct Queue<R, S> {
    /// Results that others have to come before.
    early: BTreeMap<u64, R>,
    /// The number of the next that is seen.
    next: u64,
    see: S,
}

/// Does `count` things, `jobs` at once. Shows `see` what came of each with its number, in the order of the numbers, as
/// soon as that and all before it are done; `see` says whether to go on.
pub fn in_order<R: Send>(
    count: u64,
    jobs: usize,
    act: impl Fn(u64) -> R + Sync,
    see: impl FnMut(u64, R) -> ControlFlow<()> + Send,
) {
    let (next, stop) = (AtomicU64::new(0), AtomicBool::new(false));
    let queue = Mutex::new(Queue { early: BTreeMap::new(), next: 0, see });
    let work = || {
        while !stop.load(Ordering::Relaxed) {
            let number = next.fetch_add(1, Ordering::Relaxed);
            if number >= count {
                break;
            }
            let result = act(number);
            let mut queue = queue.lock().unwrap_or_else(PoisonError::into_inner);
            let queue = &mut *queue;
            queue.early.insert(number, result);
            while !stop.load(Ordering::Relaxed)
                && let Some(result) = queue.early.remove(&queue.next)
            {
                if (queue.see)(queue.next, result).is_break() {
                    stop.store(true, Ordering::Relaxed);
                }
                queue.next += 1;
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..count.min(jobs as u64) {
            scope.spawn(work);
        }
    });
}

/// Runs one, from a file of this name, and keeps of it what is wanted. Where boards are processes, not to be called
/// from within a runtime.
///
/// # Errors
/// [`SessionError`] if the rig itself breaks, or the recording cannot go on.
#[expect(clippy::disallowed_methods, reason = "how long a scenario takes is told beside its result")]
pub fn run_one(path: &str, scenario: &Scenario, driver: &Driver, keep: Keep) -> Result<Tested, SessionError> {
    let started = std::time::Instant::now();
    let session = record(scenario, driver, keep);
    let outcome = match driver {
        Driver::InProcess => in_process(session)?,
        Driver::Processes { .. } | Driver::ByHand { .. } => {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(RigError::from)?;
            runtime.block_on(session)?
        }
    };
    Ok(Tested::new(path, scenario, outcome, started.elapsed()))
}

/// The same for an audience, which then sets the pace, and from within a runtime.
///
/// # Errors
/// [`SessionError`] if the rig itself breaks, or the recording cannot go on.
#[expect(clippy::disallowed_methods, reason = "how long a scenario takes is told beside its result")]
pub async fn show_one(
    path: &str,
    scenario: &Scenario,
    driver: &Driver,
    keep: Keep,
    audience: Box<dyn Audience>,
) -> Result<Tested, SessionError> {
    let started = std::time::Instant::now();
    let outcome = show(scenario, driver, keep, audience).await?;
    Ok(Tested::new(path, scenario, outcome, started.elapsed()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The later, the sooner done.
    fn slowest_first(number: u64) -> u64 {
        std::thread::sleep(std::time::Duration::from_millis(10 - number));
        number * number
    }

    #[test]
    fn results_come_in_their_order_whatever_is_done_first() {
        for jobs in [1, 3, 20] {
            let mut seen = Vec::new();
            in_order(10, jobs, slowest_first, |number, result| {
                seen.push((number, result));
                ControlFlow::Continue(())
            });
            assert_eq!(seen, (0..10).map(|number| (number, number * number)).collect::<Vec<_>>(), "{jobs}");
        }
        in_order(0, 3, |_| (), |_, ()| panic!("there is nothing to see"));
    }

    #[test]
    fn nothing_is_seen_after_the_one_that_ends_it() {
        for jobs in [1, 3, 20] {
            let mut seen = Vec::new();
            in_order(10, jobs, slowest_first, |number, _| {
                seen.push(number);
                if number == 4 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            });
            assert_eq!(seen, [0, 1, 2, 3, 4], "{jobs}");
        }
    }
}
