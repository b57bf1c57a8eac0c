//! `torno identify`

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use torno::identify::bench::{Excitation, Plan, Recording, Subject};
use torno::identify::csv::{self, Encoder, Measured};
use torno::identify::dac::Instrument;
use torno::identify::{Identification, Method, Units};
use torno::rig::file::{DEFAULT, RigFile};
use torno_plot::Colours;
use torno_protocol::time::Span;

use super::options::{picture, time};
use super::{draw, load_rig, print_result};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    source: Source,
    /// Only this method [default: all that the data allow]
    #[arg(long, value_enum)]
    method: Option<Method>,
    /// Draws the data and the model's response over it (.svg or .png)
    #[arg(short = 'o', long, value_name = "FILE", value_parser = picture)]
    plot: Option<PathBuf>,
    /// Prints everything as one line of JSON
    #[arg(long)]
    json: bool,
}

/// Where the data come from.
#[derive(Debug, clap::Args)]
pub(super) struct Source {
    /// A built-in rig or a rig file [default: lathe]
    #[arg(required_unless_present = "from", conflicts_with = "from")]
    rig: Option<String>,
    /// A board of it that drives a motor, or BOARD.MOTOR if it drives several; a single word is one
    board: Option<String>,
    /// What the motor is driven with [default: both]
    #[arg(long, value_enum, conflicts_with = "from")]
    input: Option<Excitation>,
    /// How long it is driven [default: 20 s for a step (10 s in a loop), 60 s for a PRBS]
    #[arg(long = "for", alias = "seconds", conflicts_with = "from", value_name = "TIME", value_parser = time)]
    lasting: Option<Span>,
    /// The largest drive, in the motor's own unit: V of the main motor, LSB of the feed's, whose loop gets a step
    /// for it [default: a good one]
    #[arg(long, conflicts_with = "from", allow_negative_numbers = true)]
    level: Option<f64>,
    /// What tells the motor's speed
    #[arg(long, value_enum, default_value = "counter", conflicts_with = "from")]
    instrument: Instrument,
    /// Of the PRBS
    #[arg(long, default_value_t = 0, conflicts_with = "from")]
    seed: u64,
    /// Sets what the rig file could say: BOARD.TABLE.FIELD, BOARD.clock_ppm or pc.FIELD (may be given several times)
    #[arg(long, value_name = "PLACE=VALUE", conflicts_with = "from")]
    set: Vec<String>,
    /// Takes data of a real motor: columns time_s (or _ms), input (held to the next row), and counts (since the row
    /// before), position (counted on, or position_rad) or speed (at that time); a unit may follow: input_v, speed_rpm
    #[arg(long, value_name = "FILE.csv")]
    from: Option<PathBuf>,
    /// Counts of the encoder in a revolution, so that speed is in rad/s instead of counts/s
    #[arg(long, value_name = "N", requires = "from", value_parser = positive)]
    counts_per_rev: Option<f64>,
    /// Unwraps the encoder's counter, which has so many bits: 8 or 16, as a rule
    #[arg(long, value_name = "BITS", requires = "from", value_parser = clap::value_parser!(u32).range(4..=32))]
    unwrap: Option<u32>,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number > 0.0 && number.is_finite() => Ok(number),
        _ => Err("expected a number above 0".to_owned()),
    }
}

/// A motor and what is known of it.
pub(super) struct Identified {
    pub(super) identification: Identification,
    /// The rig and the motor, if it is one of a rig.
    pub(super) on_rig: Option<(RigFile, Subject)>,
}

impl Source {
    /// Gets the data and lets the methods work on them.
    pub(super) async fn identify(&self, method: Option<Method>) -> anyhow::Result<Identified> {
        match &self.from {
            Some(path) => self.read_file(path, method),
            None => self.run_rig(method).await,
        }
    }

    fn read_file(&self, path: &Path, method: Option<Method>) -> anyhow::Result<Identified> {
        let encoder = Encoder { counts_per_rev: self.counts_per_rev, bits: self.unwrap };
        let Measured { data, units, axis, notes } = csv::read(path, &encoder)?;
        let subject = path.display().to_string();
        let what = format!("{:.3} s of data", data.seconds());
        let recordings = vec![Ok(Recording { data, closed: None, what })];
        let identification = Identification::of(subject.clone(), units, axis, recordings, method);
        let mut identification = identification.map_err(anyhow::Error::msg).context(subject)?;
        identification.notes = notes;
        Ok(Identified { identification, on_rig: None })
    }

    async fn run_rig(&self, method: Option<Method>) -> anyhow::Result<Identified> {
        let (rig, board) = match (self.rig.as_deref(), self.board.as_deref()) {
            (Some(rig), Some(board)) => (rig, board),
            (Some(board), None) => (DEFAULT, board),
            (None, _) => anyhow::bail!("expected a board"),
        };
        let file = load_rig(rig, &self.set)?;
        let subject = Subject::find(&file, board)?;
        let inputs = self.input.map_or(vec![Excitation::Step, Excitation::Prbs], |input| vec![input]);
        let mut recordings = Vec::new();
        for excitation in inputs {
            let seconds = self.lasting.map_or_else(|| excitation.seconds(subject.is_axis()), |span| span.as_secs_f64());
            let Self { level, seed, instrument, .. } = *self;
            let plan = Plan { excitation, seconds, level, seed, instrument };
            recordings.push(subject.run(&file, &plan).await?);
        }
        let motor = &subject.motor;
        let units = Units { input: motor.input_unit.to_owned(), speed: format!("{}/s", motor.unit) };
        let name = format!("{board} of {}", file.name);
        let identification = Identification::of(name.clone(), units, subject.is_axis(), recordings, method);
        let mut identification = identification.map_err(anyhow::Error::msg).context(name)?;
        identification.converter = subject.converter(self.instrument)?;
        Ok(Identified { identification, on_rig: Some((file, subject)) })
    }
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        let Identified { identification, .. } = self.source.identify(self.method).await?;
        if let Some(path) = &self.plot {
            draw(path, &identification.figure(), &Colours::default())?;
        }
        print_result(self.json, &identification)?;
        Ok(ExitCode::SUCCESS)
    }
}
