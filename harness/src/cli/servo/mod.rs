//! `torno servo`

mod contour;
mod link;
mod run;
mod tell;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use serde_json::json;
use torno::observe::stderr::say;
use torno::rig::file::RigFile;
use torno::send::SendError;
use torno::servo::report::graph;
use torno::servo::{Controller, ControllerError, Gain, LineError, SerialDevice, ServoLine};
use torno_plot::{Colouring, Colours};
use torno_servo::{Compiled, Finding, Language, Limits, Severity, compile};

use super::options::picture;
use super::{
    FAILED, INTERRUPTED, Interrupt, OutputFile, USAGE, draw, load_rig, print, print_beside, read_program,
    start_recording, write_file,
};

/// The rig that is meant where no port is named.
const RIG: &str = "servo";

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Compiles a motion program and tells everything that is wrong with it.
    Check(Check),
    /// Draws the way of a motion program over time.
    Plot(Plot),
    /// Runs a motion program on the rig or on a real stand, and shows the following error.
    Run(run::Arguments),
    /// Looks for the controller; asks it for Kx and Kv, or sets them.
    Link(link::Arguments),
    /// Stops what moves; the loop holds the carriage there.
    Stop(tell::Arguments),
    /// Makes 0 of where the carriage stands.
    Home(tell::Arguments),
    /// Drives two such axes along a path, and compares how far they leave it with the formulas.
    Contour(contour::Arguments),
}

/// What a program must keep to.
#[derive(Debug, clap::Args)]
struct Stand {
    /// Counts of the encoder per mm, for another encoder or another lead of the screw
    #[arg(long, default_value_t = 125.0, value_name = "N", value_parser = positive)]
    counts_per_mm: f64,
    /// Where the carriage stands when the program begins, in mm
    #[arg(long, default_value_t = 0.0, value_name = "MM", allow_negative_numbers = true)]
    from: f64,
    /// The language of what Servo v1.0 says: messages about the program and about the link
    #[arg(long, default_value = "en", value_name = "en|pl", value_parser = language)]
    lang: Language,
}

/// The colours of a picture.
#[derive(Debug, clap::Args)]
struct Paint {
    /// A colour in the picture: background, grid, axes, text, data, or line1 to line6 (may be given several times)
    #[arg(long, value_name = "PART=RRGGBB")]
    colour: Vec<Colouring>,
}

#[derive(Debug, clap::Args)]
struct Check {
    /// The motion program
    program: PathBuf,
    #[command(flatten)]
    stand: Stand,
    /// Prints the result as one line of JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
struct Plot {
    /// The motion program
    program: PathBuf,
    /// Where to draw it (.svg or .png) [default: SVG on standard output]
    #[arg(short = 'o', long, alias = "out", value_name = "FILE", value_parser = picture, default_value = "-",
          hide_default_value = true)]
    plot: PathBuf,
    #[command(flatten)]
    paint: Paint,
    #[command(flatten)]
    stand: Stand,
}

/// Where the controller is.
#[derive(Debug, clap::Args)]
struct StandOptions {
    /// A serial port of a real stand or of 'torno up servo'; of several, the first with a controller [default: a rig of
    /// its own, in virtual time]
    #[arg(long, value_name = "PATH")]
    port: Vec<String>,
    /// The rig, built in or a file
    #[arg(long, default_value = RIG, conflicts_with = "port")]
    rig: String,
    /// Sets what the rig file could say, e.g. servo.plant.tau_s=0.05 (may be given several times)
    #[arg(long, value_name = "PLACE=VALUE", conflicts_with = "port")]
    set: Vec<String>,
}

fn positive(text: &str) -> Result<f64, String> {
    let value = text.replace(',', ".").parse().ok().filter(|value| (0.001..=100_000.0).contains(value));
    value.ok_or_else(|| "expected counts per mm, 0.001 to 100000".to_owned())
}

fn language(text: &str) -> Result<Language, String> {
    match text {
        "en" => Ok(Language::English),
        "pl" => Ok(Language::Polish),
        _ => Err("expected en or pl".to_owned()),
    }
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        match self.command {
            Command::Check(arguments) => arguments.run(),
            Command::Plot(arguments) => arguments.run(),
            Command::Run(arguments) => arguments.run().await,
            Command::Link(arguments) => arguments.run().await,
            Command::Stop(arguments) => arguments.stop().await,
            Command::Home(arguments) => arguments.home().await,
            Command::Contour(arguments) => arguments.run().await,
        }
    }
}

impl Stand {
    fn limits(&self) -> Limits {
        let usual = Limits::default();
        // The motor turns as fast with another encoder.
        Limits { counts_per_mm: self.counts_per_mm, from_mm: self.from, ..usual }
    }
}

/// A motion program in a file: its text and what came of it.
struct Source {
    name: String,
    text: String,
    compiled: Compiled,
}

impl Source {
    fn load(path: &Path, stand: &Stand) -> anyhow::Result<Self> {
        let name = path.display().to_string();
        let text = read_program(path)?;
        let compiled = compile(&text, &stand.limits());
        Ok(Self { name, text, compiled })
    }

    /// Everything found, each with its line and the word underlined.
    fn findings(&self, language: Language) -> String {
        let lines: Vec<&str> = self.text.lines().collect();
        let mut place = Column { line: 0, column: 1, rest: "" };
        let shown = |finding: &Finding| {
            let Finding { line, column, word, .. } = finding;
            // Of a long line, what is about the word: the same text is not shown with each of a thousand findings.
            let first = column.saturating_sub(SHOWN).max(1);
            if place.line != *line || place.column > first {
                let text = lines.get(line - 1).unwrap_or(&"").trim_start_matches('\u{feff}').trim_end();
                place = Column { line: *line, column: 1, rest: text };
            }
            place.go_to(first);
            let end = place.rest.char_indices().nth(2 * SHOWN).map_or(place.rest.len(), |(end, _)| end);
            let (before, text, after) =
                (if first > 1 { "…" } else { "" }, &place.rest[..end], if end < place.rest.len() { "…" } else { "" });
            // Tabs stay, so that the mark stands below the word however wide they are.
            let blank = text.chars().take(column - first).map(|c| if c == '\t' { '\t' } else { ' ' });
            let blank: String = before.chars().map(|_| ' ').chain(blank).collect();
            let marks = "^".repeat(word.chars().count().clamp(1, SHOWN));
            let kind = match (finding.problem.severity(), language) {
                (Severity::Error, _) => "",
                (Severity::Danger, Language::English) => "warning: ",
                (Severity::Danger, Language::Polish) => "ostrzeżenie: ",
                (Severity::Note, Language::English) => "note: ",
                (Severity::Note, Language::Polish) => "uwaga: ",
            };
            let message = finding.message(language);
            let margin = " ".repeat(line.to_string().len());
            format!(
                "{}:{line}:{column}: {kind}{message}\n {line} | {before}{text}{after}\n {margin} | {blank}{marks}\n",
                self.name
            )
        };
        self.compiled.findings.iter().map(shown).collect()
    }
}

/// So many characters of a line are shown before a word that is complained of, and as many from it on.
const SHOWN: usize = 60;

/// A place in a text that is gone through once.
struct Column<'a> {
    line: usize,
    /// The column, from 1, at which `rest` begins.
    column: usize,
    rest: &'a str,
}

impl Column<'_> {
    /// Goes on to a column of the same line.
    fn go_to(&mut self, column: usize) {
        let skipped = self.rest.char_indices().nth(column - self.column).map_or(self.rest.len(), |(at, _)| at);
        (self.column, self.rest) = (column, &self.rest[skipped..]);
    }
}

impl Check {
    fn run(self) -> anyhow::Result<ExitCode> {
        let source = Source::load(&self.program, &self.stand)?;
        let Compiled { program, findings } = &source.compiled;
        let verdict = source.compiled.verdict(self.stand.lang);
        if self.json {
            let finding = |finding: &Finding| {
                json!({
                    "line": finding.line,
                    "column": finding.column,
                    "word": finding.word,
                    "severity": match finding.problem.severity() {
                        Severity::Error => "error",
                        Severity::Danger => "warning",
                        Severity::Note => "note",
                    },
                    "message": finding.message(self.stand.lang),
                })
            };
            let findings: Vec<_> = findings.iter().map(finding).collect();
            let seconds = program.as_ref().map(|program| program.seconds());
            let ticks = program.as_ref().map(|program| program.ticks());
            let result = json!({ "verdict": verdict, "findings": findings, "seconds": seconds, "ticks": ticks });
            print(&format!("{result}\n"))?;
        } else {
            print(&format!("{}{verdict}\n", source.findings(self.stand.lang)))?;
        }
        Ok(if program.is_some() { ExitCode::SUCCESS } else { ExitCode::from(FAILED) })
    }
}

impl Plot {
    fn run(self) -> anyhow::Result<ExitCode> {
        let source = Source::load(&self.program, &self.stand)?;
        say(&source.findings(self.stand.lang));
        let Some(program) = &source.compiled.program else {
            say(&format!("{}\n", source.compiled.verdict(self.stand.lang)));
            return Ok(ExitCode::from(FAILED));
        };
        draw(&self.plot, &graph(&source.name, program), &self.paint.colours())?;
        Ok(ExitCode::SUCCESS)
    }
}

impl Paint {
    fn colours(&self) -> Colours {
        Colours::with(&self.colour)
    }
}

/// What came of a conversation with the controller. If it has none, the exit code.
type Outcome<T> = anyhow::Result<Result<T, ExitCode>>;

impl StandOptions {
    /// The rig that is meant if no port is named.
    fn rig(&self) -> anyhow::Result<RigFile> {
        let file = load_rig(&self.rig, &self.set)?;
        if file.pc.dialect.name() != RIG {
            let (name, player) = (&file.name, file.pc.dialect.player());
            anyhow::bail!("the rig '{name}' speaks {}, not {RIG}: use '{player}'", file.pc.dialect.name());
        }
        Ok(file)
    }

    /// The controller on the first of these ports that has one.
    async fn port(&self, lang: Language) -> Outcome<Controller<SerialDevice>> {
        let mut seen = BTreeSet::new();
        let mut unopened = true;
        for port in self.port.iter().filter(|port| seen.insert(port.as_str())) {
            let found = match SerialDevice::open(port) {
                Ok(line) => Controller::connect(line).await,
                Err(error) => Err(error.into()),
            };
            match found {
                Ok(controller) => return Ok(Ok(controller)),
                Err(error) => {
                    let is_port =
                        |error: &SendError| !matches!(error, SendError::Open { .. } | SendError::NoPort { .. });
                    unopened &= matches!(&error, ControllerError::Line(LineError::Serial(error)) if !is_port(error));
                    say(&format!("torno: {:#}\n", anyhow::Error::new(error)));
                }
            }
        }
        say(&format!("{}\n", not_connected(lang)));
        Ok(Err(ExitCode::from(if unopened { USAGE } else { FAILED })))
    }
}

/// That the controller has answered, and where (§3.1).
fn connected(lang: Language, on: &str) -> String {
    match lang {
        Language::English => format!("controller connected: {on}"),
        Language::Polish => format!("sterownik połączony: {on}"),
    }
}

/// That no controller has answered, and the status that Servo v1.0 shows then (§3.1).
const fn not_connected(lang: Language) -> &'static str {
    match lang {
        Language::English => "no answer from a controller: not connected",
        Language::Polish => "Brak odpowiedzi sterownika !\nnie połączony",
    }
}

/// Sets the gains that are given; gives both, as the controller says.
async fn gains<L: ServoLine>(
    controller: &mut Controller<L>,
    kx: Option<u8>,
    kv: Option<u8>,
) -> Result<(u8, u8), ControllerError> {
    let mut gains = [0; 2];
    for (place, (gain, value)) in gains.iter_mut().zip([(Gain::Kx, kx), (Gain::Kv, kv)]) {
        *place = match value {
            Some(value) => controller.set_gain(gain, value).await?,
            None => controller.gain(gain).await?,
        };
    }
    Ok(gains.into())
}
