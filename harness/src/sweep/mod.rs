//! Sweeps: a scenario over seeds and over ranges of anything that its files say.

mod merge;
mod shrink;
mod table;
mod vary;

pub use merge::{MergeError, Missing, Whole, merge};
pub use shrink::shrink;
pub use table::{Table, Verdict};
pub use vary::{Scene, SweepError, Variation};

use serde::{Deserialize, Serialize};

/// One run of a sweep.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// The sweep that it is a part of.
    pub sweep: Whole,
    /// Its place in that, from 0: seed by seed, for one combination of values after the other.
    pub number: u64,
    /// The scenario's name.
    pub scenario: String,
    /// What was varied, and to what.
    pub values: Vec<(String, String)>,
    /// The seed.
    pub seed: u64,
    /// How it ended.
    pub verdict: Verdict,
    /// What did not hold first, if something did not.
    pub failure: Option<String>,
    /// The digest.
    pub digest: String,
    /// How many characters a receiver has got with an error, if they were counted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub line_errors: Option<u64>,
}

/// One command does so many runs at the most: half an hour's, at 500 a second.
pub const RUNS_MAX: u64 = 1_000_000;

/// All runs of a sweep: seed by seed, for one combination of the variations' values after the other.
#[derive(Clone, Debug)]
pub struct Grid {
    variations: Vec<Variation>,
    first_seed: u64,
    seeds: u64,
    shard: Shard,
    runs: u64,
}

/// Part `part` of `of`, from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Which.
    pub part: u64,
    /// Of how many.
    pub of: u64,
}

impl Shard {
    /// All of it.
    pub const WHOLE: Self = Self { part: 1, of: 1 };

    /// How many of so many runs it has.
    const fn share(self, runs: u64) -> u64 {
        runs / self.of + (runs % self.of >= self.part) as u64
    }
}

/// A run that is to be done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Job {
    /// Its place in the sweep, from 0.
    pub number: u64,
    /// What is varied, and to what.
    pub values: Vec<(String, String)>,
    /// The seed.
    pub seed: u64,
}

impl Grid {
    /// Every combination of the variations' values with so many seeds from the first on, of which a shard is done.
    ///
    /// # Errors
    /// [`SweepError::Many`]: what is to be done is more than one command does.
    pub fn new(variations: Vec<Variation>, first_seed: u64, seeds: u64, shard: Shard) -> Result<Self, SweepError> {
        let counts = variations.iter().map(|variation| variation.values.len() as u128);
        let runs = counts.fold(u128::from(seeds), u128::saturating_mul);
        let many = |of: u128| SweepError::Many { runs, of };
        let whole = u64::try_from(runs).map_err(|_| many(runs.div_ceil(u128::from(RUNS_MAX))))?;
        if shard.share(whole) > RUNS_MAX {
            return Err(many(runs.div_ceil(u128::from(RUNS_MAX))));
        }
        Ok(Self { variations, first_seed, seeds, shard, runs: whole })
    }

    /// The runs of all shards.
    pub const fn runs(&self) -> u64 {
        self.runs
    }

    /// The runs of this shard.
    pub const fn ours(&self) -> u64 {
        self.shard.share(self.runs)
    }

    /// The `n`-th run of this shard, from 0.
    pub fn job(&self, n: u64) -> Job {
        let number = n * self.shard.of + self.shard.part - 1;
        let mut cell = number / self.seeds;
        // The last varies first.
        let mut values: Vec<(String, String)> = Vec::new();
        for variation in self.variations.iter().rev() {
            let count = variation.values.len() as u64;
            values.push((variation.path.clone(), variation.values[(cell % count) as usize].clone()));
            cell /= count;
        }
        values.reverse();
        Job { number, values, seed: self.first_seed + number % self.seeds }
    }

    /// Combinations in which each value occurs.
    pub fn each_value(&self) -> impl Iterator<Item = Vec<(String, String)>> {
        let first = |variation: &Variation| (variation.path.clone(), variation.values[0].clone());
        let alone = self.variations.iter().enumerate().flat_map(move |(place, variation)| {
            variation.values.iter().map(move |value| {
                let mut values: Vec<_> = self.variations.iter().map(first).collect();
                values[place].1.clone_from(value);
                values
            })
        });
        alone.chain(self.variations.is_empty().then(Vec::new))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn variation(path: &str, values: &[&str]) -> Variation {
        Variation { path: path.to_owned(), values: values.iter().map(|value| (*value).to_owned()).collect() }
    }

    fn grid(first: u64, seeds: u64, shard: Shard) -> Grid {
        Grid::new(vec![variation("a", &["1", "2"]), variation("b", &["x", "y", "z"])], first, seeds, shard).unwrap()
    }

    #[test]
    fn seed_by_seed_for_one_combination_after_the_other() {
        let grid = grid(4, 2, Shard::WHOLE);
        let told = |n| {
            let Job { number, values, seed } = grid.job(n);
            (number, values.into_iter().map(|(_, value)| value).collect::<String>(), seed)
        };
        let first = ["1x", "1x", "1y", "1y", "1z", "1z", "2x"];
        for (n, values) in first.iter().enumerate() {
            assert_eq!(told(n as u64), (n as u64, (*values).to_owned(), 4 + n as u64 % 2));
        }
        assert_eq!(told(11), (11, "2z".to_owned(), 5));
        assert_eq!(grid.ours(), 12);
    }

    #[test]
    fn shards_share_all_runs() {
        for of in [1, 2, 5, 7, 40] {
            let shards: Vec<Grid> = (1..=of).map(|part| grid(0, 3, Shard { part, of })).collect();
            let mut numbers: Vec<u64> =
                shards.iter().flat_map(|grid| (0..grid.ours()).map(|n| grid.job(n).number)).collect();
            numbers.sort_unstable();
            assert_eq!(numbers, (0..18).collect::<Vec<_>>(), "{of}");
        }
    }

    #[test]
    fn what_is_too_much_for_one_command_is_not_for_shards() {
        let thousand: Vec<String> = (0..1000).map(|n| n.to_string()).collect();
        let thousand: Vec<&str> = thousand.iter().map(String::as_str).collect();
        let grid = |times: usize, seeds, part, of| {
            let variations = (0..times).map(|n| variation(&n.to_string(), &thousand)).collect();
            Grid::new(variations, 0, seeds, Shard { part, of })
        };
        assert_eq!(grid(2, 1, 1, 1).unwrap().ours(), RUNS_MAX);
        let told = grid(2, 3, 1, 1).unwrap_err().to_string();
        assert!(told.contains("3000000 runs") && told.contains("at most 1000000") && told.contains("I/3"), "{told}");
        assert_eq!(grid(2, 3, 3, 3).unwrap().ours(), RUNS_MAX);
        assert!(grid(2, 3, 1, 2).is_err());
        // Beyond 64 bits, and beyond 128.
        for times in [7, 20] {
            assert!(grid(times, u64::MAX, 1, u64::MAX).is_err());
        }
    }

    #[test]
    fn each_value_is_checked_without_all_combinations() {
        let values: Vec<_> = grid(0, 9, Shard::WHOLE).each_value().collect();
        assert_eq!(values.len(), 5);
        assert!(Grid::new(Vec::new(), u64::MAX, 1, Shard::WHOLE).unwrap().each_value().eq([Vec::new()]));
    }
}
