//! Puts the shards of a sweep together again.

use serde::{Deserialize, Serialize};

use super::Run;

/// The sweep that a run is a part of: all its shards say the same of it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Whole {
    /// A digest of what the scenario's file and its rig's say.
    pub files: String,
    /// Seeds for each combination of values.
    pub seeds: u64,
    /// What is varied, as it was given.
    pub vary: Vec<String>,
    /// All its runs.
    pub runs: u64,
}

/// Why results cannot be put together.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MergeError {
    /// There is nothing in them.
    #[error("--merge: there is no run in what is given: expected the --json of every shard of one sweep")]
    Nothing,
    /// They are of different sweeps.
    #[error("{one} and {other} are of different sweeps: {what}; expected the shards of one")]
    Mixed {
        /// A file and its line.
        one: String,
        /// Another.
        other: String,
        /// In what they differ.
        what: String,
    },
    /// A run is there twice.
    #[error("{one} and {other} are the same run, number {number} (seed {seed}): expected each shard once")]
    Twice {
        /// A file and its line.
        one: String,
        /// Another.
        other: String,
        /// The run's place in the sweep.
        number: u64,
        /// Its seed.
        seed: u64,
    },
    /// The sweep has no such run.
    #[error("{place}: run number {number} of a sweep of {runs}: expected 0 to {}", runs.saturating_sub(1))]
    Beyond {
        /// A file and its line.
        place: String,
        /// The run's place in the sweep.
        number: u64,
        /// The sweep's runs.
        runs: u64,
    },
}

/// Runs of a sweep that no one has given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Missing {
    /// So many.
    pub count: u64,
    /// Of so many.
    pub of: u64,
    /// The first one's place in the sweep.
    pub first: u64,
}

impl std::fmt::Display for Missing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { count, of, first } = self;
        write!(f, "{count} of {of} runs are missing, the first is number {first}: expected every shard of the sweep")
    }
}

impl Whole {
    /// In what it differs from another.
    fn unlike(&self, other: &Self) -> Option<String> {
        let (ours, theirs) = (self.vary.join(" "), other.vary.join(" "));
        if self.files != other.files {
            Some("their scenarios or rigs are not the same".to_owned())
        } else if ours != theirs {
            Some(format!("one varies '{ours}', the other '{theirs}'"))
        } else if self.seeds != other.seeds {
            Some(format!("one has {} seeds, the other {}", self.seeds, other.seeds))
        } else if self.runs != other.runs {
            Some(format!("one has {} runs, the other {}", self.runs, other.runs))
        } else {
            None
        }
    }
}

/// Puts the runs of one sweep in order, each with the file and line that it stands in. Says which are missing.
///
/// # Errors
/// [`MergeError`].
pub fn merge(mut placed: Vec<(String, Run)>) -> Result<(Vec<Run>, Option<Missing>), MergeError> {
    let (first_place, first) = placed.first().ok_or(MergeError::Nothing)?;
    let runs = first.sweep.runs;
    for (place, run) in &placed {
        if let Some(what) = first.sweep.unlike(&run.sweep) {
            return Err(MergeError::Mixed { one: first_place.clone(), other: place.clone(), what });
        }
        if run.number >= runs {
            return Err(MergeError::Beyond { place: place.clone(), number: run.number, runs });
        }
    }
    // Stable: of two that are the same, the one that was given first comes first.
    placed.sort_by_key(|(_, run)| run.number);
    let mut pairs = placed.iter().zip(placed.iter().skip(1));
    if let Some(((one, run), (other, _))) = pairs.find(|((_, a), (_, b))| a.number == b.number) {
        let (number, seed) = (run.number, run.seed);
        return Err(MergeError::Twice { one: one.clone(), other: other.clone(), number, seed });
    }
    let count = runs - placed.len() as u64;
    let first = (0..).zip(&placed).find(|(number, (_, run))| *number != run.number);
    let first = first.map_or(placed.len() as u64, |(number, _)| number);
    let missing = (count > 0).then_some(Missing { count, of: runs, first });
    Ok((placed.into_iter().map(|(_, run)| run).collect(), missing))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep::Verdict;

    fn whole() -> Whole {
        Whole { files: "f".to_owned(), seeds: 3, vary: vec!["a=1,2".to_owned()], runs: 6 }
    }

    fn run(number: u64) -> (String, Run) {
        let (scenario, digest, values) = ("s".to_owned(), String::new(), Vec::new());
        let (verdict, seed) = (Verdict::Passed, number % 3);
        let run =
            Run { sweep: whole(), number, scenario, values, seed, verdict, failure: None, digest, line_errors: None };
        (format!("file:{number}"), run)
    }

    fn runs(numbers: &[u64]) -> Vec<(String, Run)> {
        numbers.iter().map(|number| run(*number)).collect()
    }

    #[test]
    fn shards_are_put_in_the_order_of_the_whole() {
        let (merged, missing) = merge(runs(&[1, 3, 5, 0, 2, 4])).unwrap();
        assert_eq!(merged.iter().map(|run| run.number).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5]);
        assert_eq!(missing, None);
    }

    #[test]
    fn what_is_missing_is_counted() {
        let missing = |numbers: &[u64]| merge(runs(numbers)).unwrap().1;
        assert_eq!(missing(&[0, 2, 4]), Some(Missing { count: 3, of: 6, first: 1 }));
        assert_eq!(missing(&[0, 1, 2, 3, 4]), Some(Missing { count: 1, of: 6, first: 5 }));
        assert_eq!(missing(&[5]), Some(Missing { count: 5, of: 6, first: 0 }));
    }

    #[test]
    fn what_does_not_belong_together_is_refused() {
        assert_eq!(merge(Vec::new()), Err(MergeError::Nothing));
        let twice = MergeError::Twice { one: "file:4".to_owned(), other: "file:4".to_owned(), number: 4, seed: 1 };
        assert_eq!(merge(runs(&[4, 0, 4])), Err(twice));
        assert!(matches!(merge(runs(&[0, 6])), Err(MergeError::Beyond { number: 6, runs: 6, .. })));
        let others = [
            Whole { files: "g".to_owned(), ..whole() },
            Whole { seeds: 4, ..whole() },
            Whole { vary: vec!["a=1,3".to_owned()], ..whole() },
            Whole { runs: 7, ..whole() },
        ];
        for other in others {
            let mut mixed = runs(&[0, 1]);
            mixed[1].1.sweep = other;
            assert!(matches!(merge(mixed), Err(MergeError::Mixed { .. })));
        }
    }
}
