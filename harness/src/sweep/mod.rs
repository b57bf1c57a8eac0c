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
}

/// Every combination of the variations' values.
pub fn cells(variations: &[Variation]) -> Vec<Vec<(String, String)>> {
    variations.iter().fold(vec![Vec::new()], |cells, variation| {
        let with = |cell: &Vec<(String, String)>, value: &String| {
            let mut cell = cell.clone();
            cell.push((variation.path.clone(), value.clone()));
            cell
        };
        cells.iter().flat_map(|cell| variation.values.iter().map(|value| with(cell, value))).collect()
    })
}
