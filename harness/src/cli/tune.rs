//! `torno tune`

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use torno::identify::Method;
use torno::identify::tune::{Comparison, Tuning};
use torno_identify::design::Structure;
use torno_plot::Colours;

use super::identify::{Identified, Source};
use super::options::picture;
use super::{draw, print_result};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    source: Source,
    /// Builds on this method's result [default: the recommended one with the narrowest interval]
    #[arg(long, value_enum)]
    method: Option<Method>,
    /// In degrees, 10 to 90
    #[arg(long, value_name = "DEGREES", default_value_t = torno_identify::design::PHASE_MARGIN, value_parser = degrees)]
    phase_margin: f64,
    /// Designs several controllers of an axis and shows them side by side: p, pi, pd, pid
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = structure)]
    compare: Vec<Structure>,
    /// Draws what the rig did, and what was foretold (.svg or .png)
    #[arg(short = 'o', long, value_name = "FILE", value_parser = picture)]
    plot: Option<PathBuf>,
    /// Prints everything as one line of JSON
    #[arg(long)]
    json: bool,
}

fn structure(text: &str) -> Result<Structure, String> {
    let known = Structure::ALL.into_iter().find(|known| known.name().eq_ignore_ascii_case(text));
    known.ok_or_else(|| "expected p, pi, pd or pid, with commas between".to_owned())
}

fn degrees(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if (10.0..=90.0).contains(&number) => Ok(number),
        _ => Err("expected 10 to 90".to_owned()),
    }
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        let Identified { identification, on_rig } = self.source.identify(self.method).await?;
        let subject = identification.subject.clone();
        if !self.compare.is_empty() {
            let comparison = Comparison::of(identification, on_rig.as_ref(), self.phase_margin, &self.compare);
            let comparison = comparison.await.context(subject)?;
            if let Some(path) = &self.plot {
                draw(path, &comparison.figure(), &Colours::default())?;
            }
            print_result(self.json, &comparison)?;
            return Ok(ExitCode::SUCCESS);
        }
        let tuning = Tuning::of(identification, on_rig.as_ref(), self.phase_margin).await.context(subject)?;
        if let Some(path) = &self.plot {
            draw(path, &tuning.figure(), &Colours::default())?;
        }
        print_result(self.json, &tuning)?;
        Ok(ExitCode::SUCCESS)
    }
}
