//! `torno tune`

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use torno::identify::Method;
use torno::identify::tune::{Code, Comparison, Language, Tuning};
use torno_identify::design::Structure;
use torno_plot::Colours;

use super::identify::{Identified, Source};
use super::options::picture;
use super::output::{is_output, write_file};
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
    /// Prints the proposed controller as code for a firmware, with test vectors from the board
    #[arg(long, value_enum, value_name = "LANGUAGE", conflicts_with = "compare")]
    code: Option<Language>,
    /// Draws what the rig did, and what was foretold (.svg or .png); with --code, writes the code (.c)
    #[arg(short = 'o', long, value_name = "FILE", value_parser = destination)]
    plot: Option<PathBuf>,
    /// Prints everything as one line of JSON
    #[arg(long)]
    json: bool,
}

fn structure(text: &str) -> Result<Structure, String> {
    let known = Structure::ALL.into_iter().find(|known| known.name().eq_ignore_ascii_case(text));
    known.ok_or_else(|| "expected p, pi, pd or pid, with commas between".to_owned())
}

/// A picture, or a file of C.
fn destination(text: &str) -> Result<PathBuf, String> {
    if is_code(Path::new(text)) { Ok(PathBuf::from(text)) } else { picture(text) }
}

fn is_code(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "c")
}

fn degrees(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if (10.0..=90.0).contains(&number) => Ok(number),
        _ => Err("expected 10 to 90".to_owned()),
    }
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        let path = self.plot.as_deref();
        anyhow::ensure!(
            path.is_none_or(|path| is_output(path) || is_code(path) == self.code.is_some()),
            "-o {}: expected a name that ends in {}",
            path.unwrap_or(Path::new("")).display(),
            if self.code.is_some() { ".c, for code" } else { ".svg or .png; .c is for --code" }
        );
        let Identified { identification, on_rig } = self.source.identify(self.method).await?;
        let subject = identification.subject.clone();
        if let Some(language) = self.code {
            let code = Code::of(&identification, on_rig.as_ref(), self.phase_margin, language).context(subject)?;
            return match path.filter(|path| !is_output(path) && !self.json) {
                Some(path) => write_file(path, &code.source),
                None => print_result(self.json, &code),
            }
            .map(|()| ExitCode::SUCCESS);
        }
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
