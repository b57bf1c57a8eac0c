//! `torno gcode`

use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use serde_json::json;
use torno::report::Bar;
use torno_gcode::{Dialect, Finding, Interpreter, Kind, Motion, Outcome, Place, Settings, Severity};

use super::output::is_output;
use super::{USAGE, print};

/// What is read of a file at once.
const BLOCK: usize = 64 * 1024;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Interprets a program and tells everything that is wrong with it.
    Check(Check),
    /// Prints the canonical motions of a program, one JSON object a line.
    Canon(Canon),
}

/// A dialect, or none in particular.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Choice {
    /// What the program's first lines look like.
    Auto,
    /// RS274/NGC as LinuxCNC reads it.
    Linuxcnc,
    /// That of a Fanuc lathe, G-code system A.
    Fanuc,
}

/// How a program is read.
#[derive(Debug, clap::Args)]
struct Reading {
    /// The G-code; '-' is standard input
    file: PathBuf,
    /// The dialect
    #[arg(long, value_enum, default_value = "auto")]
    dialect: Choice,
    /// Refuses what is a warning otherwise, such as an M code that is not known
    #[arg(long)]
    strict: bool,
    /// Passes over blocks that begin with '/'
    #[arg(long)]
    block_delete: bool,
    /// Where the tool is at the start, in mm, X as a radius [default: 0,0]
    #[arg(long, value_name = "X,Z", value_parser = place, allow_hyphen_values = true)]
    at: Option<Place>,
    /// A program with loops or calls ends after so many lines at the latest
    #[arg(long, value_name = "N", default_value_t = Settings::default().steps_max)]
    steps: u64,
}

#[derive(Debug, clap::Args)]
struct Check {
    #[command(flatten)]
    reading: Reading,
    /// Prints the result as one line of JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
struct Canon {
    #[command(flatten)]
    reading: Reading,
    /// Prints coolant, tools and stops, too
    #[arg(long)]
    all: bool,
    /// The motions are JSON in any case
    #[arg(long, hide = true)]
    json: bool,
}

fn place(text: &str) -> Result<Place, String> {
    let number = |text: &str| text.trim().parse().ok().filter(|value: &f64| value.abs() < 1e6);
    let place = text.split_once(',').and_then(|(x, z)| Some((number(x)?, number(z)?)));
    let (x, z) = place.ok_or_else(|| "expected X,Z in mm, such as 12.5,1".to_owned())?;
    Ok(Place { x, z, ..Place::default() })
}

impl Arguments {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        match self.command {
            Command::Check(arguments) => arguments.run(),
            Command::Canon(arguments) => arguments.run(),
        }
    }
}

/// A program that can be read more than once: a regular file, or what came through a pipe.
enum Source {
    File(File, u64),
    Bytes(Vec<u8>),
}

impl Reading {
    fn name(&self) -> String {
        if is_output(&self.file) { "standard input".to_owned() } else { self.file.display().to_string() }
    }

    fn settings(&self) -> Settings {
        Settings {
            dialect: match self.dialect {
                Choice::Auto => None,
                Choice::Linuxcnc => Some(Dialect::LinuxCnc),
                Choice::Fanuc => Some(Dialect::Fanuc),
            },
            strict: self.strict,
            skip_deleted: self.block_delete,
            start: self.at.unwrap_or_default(),
            steps_max: self.steps,
        }
    }

    fn open(&self) -> anyhow::Result<Source> {
        let open = |path: &Path| -> io::Result<Source> {
            let mut bytes = Vec::new();
            if is_output(path) {
                io::stdin().lock().read_to_end(&mut bytes)?;
                return Ok(Source::Bytes(bytes));
            }
            let mut file = File::open(path)?;
            let about = file.metadata()?;
            if about.is_file() {
                return Ok(Source::File(file, about.len()));
            }
            file.read_to_end(&mut bytes)?;
            Ok(Source::Bytes(bytes))
        };
        open(&self.file).with_context(|| format!("cannot read the program '{}'", self.name()))
    }

    /// Interprets the program, from its start.
    fn interpret(&self, source: &mut Source, sink: &mut dyn FnMut(Motion)) -> anyhow::Result<Outcome> {
        let mut interpreter = Interpreter::new(&self.settings());
        match source {
            Source::Bytes(bytes) => interpreter.push(bytes, sink),
            Source::File(file, length) => {
                let bar = Bar::of_bytes(*length);
                let read = push_file(&mut interpreter, file, &bar, sink);
                bar.clear();
                read.with_context(|| format!("cannot read the program '{}'", self.name()))?;
            }
        }
        Ok(interpreter.finish(sink))
    }

    fn told(&self, finding: &Finding) -> String {
        format!("{}:{finding}\n", self.name())
    }
}

fn push_file(
    interpreter: &mut Interpreter,
    file: &mut File,
    bar: &Bar,
    sink: &mut dyn FnMut(Motion),
) -> io::Result<()> {
    file.rewind()?;
    let mut block = vec![0; BLOCK];
    let mut done = 0;
    while !interpreter.is_done() {
        let length = file.read(&mut block)?;
        if length == 0 {
            break;
        }
        interpreter.push(&block[..length], sink);
        done += length;
        bar.reach(done as u64);
    }
    Ok(())
}

impl Check {
    fn run(self) -> anyhow::Result<ExitCode> {
        let reading = &self.reading;
        let outcome = reading.interpret(&mut reading.open()?, &mut |_| {})?;
        let refused = outcome.is_refused();
        if self.json {
            let finding = |finding: &Finding| {
                json!({
                    "line": finding.line,
                    "column": finding.column,
                    "severity": if finding.severity == Severity::Error { "error" } else { "warning" },
                    "message": finding.message,
                })
            };
            let findings: Vec<_> = outcome.findings.iter().map(finding).collect();
            let result = json!({
                "file": reading.name(),
                "dialect": outcome.dialect.name(),
                "lines": outcome.lines,
                "motions": outcome.motions,
                "refused": refused,
                "findings": findings,
            });
            print(&format!("{result}\n"))?;
        } else {
            let findings: String = outcome.findings.iter().map(|finding| reading.told(finding)).collect();
            let Outcome { dialect, lines, motions, .. } = outcome;
            let name = reading.name();
            let verdict = if refused {
                format!("{name} is refused (dialect {})\n", dialect.name())
            } else {
                format!("{name} is understood: dialect {}, {lines} lines, {motions} motions\n", dialect.name())
            };
            print(&format!("{findings}{verdict}"))?;
        }
        Ok(if refused { ExitCode::from(USAGE) } else { ExitCode::SUCCESS })
    }
}

impl Canon {
    fn run(self) -> anyhow::Result<ExitCode> {
        let reading = &self.reading;
        let mut source = reading.open()?;
        // Nothing is printed of a program that is refused: whoever reads the motions does not see its end first.
        let outcome = reading.interpret(&mut source, &mut |_| {})?;
        for finding in &outcome.findings {
            eprint!("{}", reading.told(finding));
        }
        if outcome.is_refused() {
            return Ok(ExitCode::from(USAGE));
        }
        let mut output = BufWriter::new(io::stdout().lock());
        let mut written = Ok(());
        reading.interpret(&mut source, &mut |motion| {
            let aside = matches!(motion.kind, Kind::Coolant { .. } | Kind::Tool(_) | Kind::Stop { .. });
            if written.is_ok() && (self.all || !aside) {
                written = writeln!(output, "{motion}");
            }
        })?;
        match written.and_then(|()| output.flush()) {
            Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(error).context("cannot write the motions"),
            _ => Ok(ExitCode::SUCCESS),
        }
    }
}
