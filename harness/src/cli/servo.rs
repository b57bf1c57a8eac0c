//! `torno servo`

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use serde_json::json;
use torno::observe::log;
use torno::report::Status;
use torno::report::plot::Figure;
use torno::rig::Driver;
use torno::send::SendError;
use torno::servo::contour::{self, Contour};
use torno::servo::controller::parts;
use torno::servo::report::graph;
use torno::servo::{Controller, ControllerError, Ended, Gain, Line, LineError, Report, RigLine, SerialLine};
use torno::text::{self, TextError};
use torno_servo::contour::{Shape, Task};
use torno_servo::{Compiled, Finding, Language, Limits, Severity, compile};

use super::{FAILED, INTERRUPTED, Interrupt, USAGE, load_rig, print};

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
    Run(Run),
    /// Looks for the controller; asks it for Kx and Kv, or sets them.
    Link(Link),
    /// Drives two such axes along a path, and compares how far they leave it with the formulas.
    Contour(Contouring),
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
    /// The language of messages about the program
    #[arg(long, default_value = "en", value_name = "en|pl", value_parser = language)]
    lang: Language,
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
    /// The picture, as SVG [default: standard output]
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    stand: Stand,
}

/// Where the controller is.
#[derive(Debug, clap::Args)]
struct Place {
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

#[derive(Debug, clap::Args)]
struct Run {
    /// The motion program
    program: PathBuf,
    #[command(flatten)]
    place: Place,
    #[command(flatten)]
    stand: Stand,
    /// Sets Kx before: 0 to 255
    #[arg(long, value_name = "N")]
    kx: Option<u8>,
    /// Sets Kv before: 0 to 255
    #[arg(long, value_name = "N")]
    kv: Option<u8>,
    /// Sends even a program that leaves the travel or is too fast for the motor
    #[arg(long)]
    force: bool,
    /// Draws the run: positions, and the following error of the last 4 s, as SVG; '-' is standard output
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Writes the data, a line a tick; '-' is standard output
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Prints the report as one line of JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
struct Link {
    #[command(flatten)]
    place: Place,
    /// Sets Kx: 0 to 255
    #[arg(long, value_name = "N")]
    kx: Option<u8>,
    /// Sets Kv: 0 to 255
    #[arg(long, value_name = "N")]
    kv: Option<u8>,
    /// The language of what is said
    #[arg(long, default_value = "en", value_name = "en|pl", value_parser = language)]
    lang: Language,
    /// Prints the result as one line of JSON
    #[arg(long)]
    json: bool,
}

/// A path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Track {
    /// A right angle.
    Corner,
    /// At 45 degrees.
    Line,
    /// Two turns.
    Circle,
    /// To a point, each axis by itself.
    Points,
    /// To the same point, in a straight line.
    Straight,
}

#[derive(Debug, clap::Args)]
struct Contouring {
    /// The paths [default: all]
    #[arg(value_enum)]
    paths: Vec<Track>,
    /// The speed along the path, in mm/s
    #[arg(long, default_value_t = 10.0, value_name = "MM/S", value_parser = speed)]
    speed: f64,
    /// The circle's radius, in mm
    #[arg(long, default_value_t = 10.0, value_name = "MM", value_parser = radius)]
    radius: f64,
    /// Kx of the axis x: 1 to 255
    #[arg(long, default_value_t = 20, value_name = "N", value_parser = clap::value_parser!(u8).range(1..))]
    kx: u8,
    /// Kx of the axis y: 1 to 255
    #[arg(long, default_value_t = 18, value_name = "N", value_parser = clap::value_parser!(u8).range(1..))]
    kx_of_y: u8,
    /// The motors' time constant, in s
    #[arg(long, default_value_t = 0.03, value_name = "S", value_parser = tau)]
    tau: f64,
    /// Draws the paths, as SVG; '-' is standard output
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Prints the result as one line of JSON
    #[arg(long)]
    json: bool,
}

fn within(text: &str, least: f64, most: f64) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value| (least..=most).contains(value));
    value.ok_or_else(|| format!("expected {least} to {most}"))
}

fn speed(text: &str) -> Result<f64, String> {
    within(text, 0.1, 15.0)
}

fn radius(text: &str) -> Result<f64, String> {
    within(text, 0.5, 100.0)
}

fn tau(text: &str) -> Result<f64, String> {
    within(text, 0.001, 0.2)
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
        log::init("warn");
        match self.command {
            Command::Check(arguments) => arguments.run(),
            Command::Plot(arguments) => arguments.run(),
            Command::Run(arguments) => arguments.run().await,
            Command::Link(arguments) => arguments.run().await,
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
        let text = text::read(path).map_err(|error| match error {
            TextError::Unreadable(error) => {
                anyhow::Error::new(error).context(format!("cannot read the program '{name}'"))
            }
            TextError::NotText { .. } => anyhow::Error::new(error).context(name.clone()),
        })?;
        let compiled = compile(&text, &stand.limits());
        Ok(Self { name, text, compiled })
    }

    /// Everything found, each with its line and the word underlined.
    fn findings(&self, language: Language) -> String {
        let lines: Vec<&str> = self.text.lines().collect();
        let shown = |finding: &Finding| {
            let Finding { line, column, word, .. } = finding;
            let text = lines.get(line - 1).unwrap_or(&"").trim_start_matches('\u{feff}').trim_end();
            // Tabs stay, so that the mark stands below the word however wide they are.
            let blank: String = text.chars().take(column - 1).map(|c| if c == '\t' { '\t' } else { ' ' }).collect();
            let marks = "^".repeat(word.chars().count().max(1));
            let kind = match (finding.problem.severity(), language) {
                (Severity::Error, _) => "",
                (Severity::Danger, Language::English) => "warning: ",
                (Severity::Danger, Language::Polish) => "ostrzeżenie: ",
                (Severity::Note, Language::English) => "note: ",
                (Severity::Note, Language::Polish) => "uwaga: ",
            };
            let message = finding.message(language);
            let margin = " ".repeat(line.to_string().len());
            format!("{}:{line}:{column}: {kind}{message}\n {line} | {text}\n {margin} | {blank}{marks}\n", self.name)
        };
        self.compiled.findings.iter().map(shown).collect()
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
        eprint!("{}", source.findings(self.stand.lang));
        let Some(program) = &source.compiled.program else {
            eprintln!("{}", source.compiled.verdict(self.stand.lang));
            return Ok(ExitCode::from(FAILED));
        };
        let out = self.out.unwrap_or_else(|| PathBuf::from("-"));
        draw(&out, &graph(&source.name, program))?;
        Ok(ExitCode::SUCCESS)
    }
}

fn draw(path: &Path, figure: &Figure) -> anyhow::Result<()> {
    write(path, &figure.svg()?)
}

fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    if path == Path::new("-") {
        return print(text);
    }
    std::fs::write(path, text).with_context(|| format!("cannot write '{}'", path.display()))
}

/// What came of a conversation with the controller. If it has none, the exit code.
type Outcome<T> = anyhow::Result<Result<T, ExitCode>>;

impl Place {
    /// The controller on the rig, if no port is named.
    async fn rig(&self) -> anyhow::Result<Controller<RigLine>> {
        let file = load_rig(&self.rig, &self.set)?;
        if file.dialect.name() != RIG {
            let (name, player) = (&file.name, file.dialect.player());
            anyhow::bail!("the rig '{name}' speaks {}, not {RIG}: use '{player}'", file.dialect.name());
        }
        let line = RigLine::start(&file, &Driver::InProcess).await?;
        Ok(Controller::connect(line).await?)
    }

    /// The controller on the first of these ports that has one.
    async fn port(&self, lang: Language) -> Outcome<Controller<SerialLine>> {
        let mut seen = BTreeSet::new();
        let mut unopened = true;
        for port in self.port.iter().filter(|port| seen.insert(port.as_str())) {
            let found = match SerialLine::open(port) {
                Ok(line) => Controller::connect(line).await,
                Err(error) => Err(error.into()),
            };
            match found {
                Ok(controller) => return Ok(Ok(controller)),
                Err(error) => {
                    unopened &= matches!(error, ControllerError::Line(LineError::Serial(SendError::Open { .. })));
                    eprintln!("torno: {:#}", anyhow::Error::new(error));
                }
            }
        }
        if lang == Language::Polish {
            eprintln!("Brak odpowiedzi sterownika !");
        }
        Ok(Err(ExitCode::from(if unopened { USAGE } else { FAILED })))
    }
}

impl Run {
    async fn run(self) -> anyhow::Result<ExitCode> {
        let source = Source::load(&self.program, &self.stand)?;
        eprint!("{}", source.findings(self.stand.lang));
        if source.compiled.program.is_none() || !(self.force || source.compiled.can_be_driven()) {
            let english = "nothing is sent to the controller";
            let refused = if source.compiled.program.is_some() { english } else { "" };
            let verdict = source.compiled.verdict(self.stand.lang);
            eprintln!("{}", if refused.is_empty() { verdict } else { refused });
            return Ok(ExitCode::from(FAILED));
        }
        if self.place.port.is_empty() {
            let controller = self.place.rig().await?;
            return self.on(controller, &source).await;
        }
        match self.place.port(self.stand.lang).await? {
            Ok(controller) => self.on(controller, &source).await,
            Err(code) => Ok(code),
        }
    }

    async fn on<L: Line>(&self, mut controller: Controller<L>, source: &Source) -> anyhow::Result<ExitCode> {
        let Some(program) = &source.compiled.program else { return Ok(ExitCode::from(FAILED)) };
        let gains = gains(&mut controller, self.kx, self.kv).await?;
        let mut report = Report {
            program: source.name.clone(),
            on: controller.line().name().to_owned(),
            gains,
            counts_per_mm: self.stand.counts_per_mm,
            ended: Ended::Completed,
            set_points: program.set_points(self.stand.counts_per_mm).collect(),
            samples: Vec::new(),
        };
        let increments = program.increments(self.stand.counts_per_mm);
        let mut interrupt = Interrupt::listen()?;
        let mut stopped = false;
        let status = Status::new();
        let all = increments.len();
        for part in parts(&increments) {
            let before = report.samples.len();
            controller.download(part, |gone, of| status.show(|| format!("download {gone} of {of} bytes"))).await?;
            let samples = &mut report.samples;
            let run = controller.run(part.len(), |mut sample| {
                sample.tick += before;
                samples.push(sample);
                let (tick, shown) = (sample.tick, sample.shown);
                status.show(|| format!("tick {tick} of {all}  error {shown:+4} counts"));
                true
            });
            report.ended = tokio::select! {
                ended = run => ended?,
                () = interrupt.received() => {
                    stopped = true;
                    Ended::Stopped
                }
            };
            if stopped {
                controller.stop().await?;
            }
            if report.ended != Ended::Completed {
                break;
            }
        }
        status.clear();
        if let Some(path) = &self.out {
            draw(path, &report.figure())?;
        }
        if let Some(path) = &self.csv {
            write(path, &report.csv())?;
        }
        let on_output = [&self.out, &self.csv].into_iter().flatten().any(|path| path == Path::new("-"));
        let text = if self.json { format!("{}\n", report.json()) } else { report.text() };
        if on_output {
            eprint!("{text}")
        } else {
            print(&text)?
        }
        Ok(match report.ended {
            Ended::Completed => ExitCode::SUCCESS,
            Ended::Early => ExitCode::from(FAILED),
            Ended::Stopped => ExitCode::from(INTERRUPTED),
        })
    }
}

impl Contouring {
    async fn run(self) -> anyhow::Result<ExitCode> {
        let file = load_rig(RIG, &[format!("servo.plant.tau_s={}", self.tau)])?;
        let all = [Track::Corner, Track::Line, Track::Circle, Track::Points, Track::Straight];
        let paths = if self.paths.is_empty() { &all[..] } else { &self.paths };
        let mut contours = Vec::new();
        for path in paths {
            let shape = match path {
                Track::Corner => Shape::Corner,
                Track::Line => Shape::Line(45.0),
                Track::Circle => Shape::Circle(self.radius),
                Track::Points => Shape::Points,
                Track::Straight => Shape::Straight,
            };
            // Like axes show what the path does to them, unlike ones what they do to a line.
            let alike = matches!(path, Track::Corner | Track::Circle);
            let kx = [self.kx, if alike { self.kx } else { self.kx_of_y }];
            let task = Task { shape, speed_mm_s: self.speed };
            contours.push(contour::drive(&file, task, kx, self.tau).await?);
        }
        if let Some(path) = &self.out {
            draw(path, &contour::figure(&contours))?;
        }
        let of = |contour: &Contour| {
            let Contour { measured, sampled, predicted, .. } = contour;
            json!({
                "path": contour.name(),
                "deviation_mm": measured,
                "sampled_mm": sampled,
                "formula_mm": predicted,
            })
        };
        let text = if self.json {
            format!("{}\n", serde_json::Value::from(contours.iter().map(of).collect::<Vec<_>>()))
        } else {
            contours.iter().map(Contour::text).collect()
        };
        if self.out.as_deref() == Some(Path::new("-")) {
            eprint!("{text}")
        } else {
            print(&text)?
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// Sets the gains that are given; gives both, as the controller says.
async fn gains<L: Line>(
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

impl Link {
    async fn run(self) -> anyhow::Result<ExitCode> {
        if self.place.port.is_empty() {
            let controller = self.place.rig().await?;
            return self.on(controller).await;
        }
        match self.place.port(self.lang).await? {
            Ok(controller) => self.on(controller).await,
            Err(code) => Ok(code),
        }
    }

    async fn on<L: Line>(&self, mut controller: Controller<L>) -> anyhow::Result<ExitCode> {
        let (kx, kv) = gains(&mut controller, self.kx, self.kv).await?;
        let on = controller.line().name().to_owned();
        let connected = match self.lang {
            Language::English => "controller connected",
            Language::Polish => "sterownik połączony",
        };
        print(&if self.json {
            format!("{}\n", json!({ "on": on, "kx": kx, "kv": kv }))
        } else {
            format!("{connected}: {on}\nKx {kx}, Kv {kv}\n")
        })?;
        Ok(ExitCode::SUCCESS)
    }
}
