//! `torno diff`

use std::path::PathBuf;
use std::process::ExitCode;

use serde_json::json;
use torno_trace::diff::{Extent, first_difference};

use super::{FAILED, USAGE, load_trace, print};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// A trace that '--record' has written
    a: PathBuf,
    /// Another
    b: PathBuf,
    /// Prints the result as one line of JSON
    #[arg(long)]
    json: bool,
}

impl Arguments {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let (a, a_damage) = load_trace(&self.a)?;
        let (b, b_damage) = load_trace(&self.b)?;
        let difference = first_difference(&a, &b, Extent::Whole, torno_machines::dialect);
        let text = match &difference {
            _ if self.json => {
                let difference = difference.as_ref().map(|difference| difference.json());
                format!("{}\n", json!({ "identical": difference.is_none(), "difference": difference }))
            }
            None => format!("identical: {} facts up to {}\n", a.facts.len(), a.until().max(b.until())),
            Some(difference) => difference.text(&self.a.display().to_string(), &self.b.display().to_string()),
        };
        print(&text)?;
        Ok(match difference {
            // What cannot be read may differ.
            _ if a_damage.is_some() || b_damage.is_some() => ExitCode::from(USAGE),
            Some(_) => ExitCode::from(FAILED),
            None => ExitCode::SUCCESS,
        })
    }
}
