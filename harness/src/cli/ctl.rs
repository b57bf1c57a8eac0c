//! `torno ctl`

use std::fmt::Write as _;
use std::io::{self, BufRead, BufReader, BufWriter, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};
use serde_json::Value;
use torno::control::{Begun, Done, File, Form, KeptState, ProgramState, Request, State};
use torno::fault::{BOARD_KINDS, LINE_KINDS};
use torno::observe::stderr::say;
use torno::rig::file::DEFAULT;
use torno::saving::{Product, create};
use torno_port::default_folder;
use torno_protocol::time::Instant;
use torno_text::nearest;

use super::output::is_output;
use super::trace::Shown;
use super::{USAGE, colour, print_beside, read_program};

const MIB: f64 = 1_048_576.0;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The rig, at its usual place
    #[arg(long, default_value = DEFAULT, value_name = "NAME", global = true)]
    rig: String,
    /// The control socket that 'torno up' has announced, instead
    #[arg(long, value_name = "PATH", conflicts_with = "rig", global = true)]
    socket: Option<PathBuf>,
    /// Prints the answer as JSON, as the rig gives it
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Shows boards, telemetry, who waits for whom, and the faults that last
    State,
    /// Breaks a line or a board, in the words of scenario files
    Fault(Box<FaultArguments>),
    /// Ends a fault, or disarms one that waits for something
    Heal {
        /// What 'fault' has called it
        name: String,
    },
    /// Switches a board's supply, or the PC's
    Power {
        /// The board, or 'pc'
        board: String,
        /// On or off
        #[arg(value_parser = ["on", "off"])]
        switch: String,
    },
    /// Lets time stand still
    Pause,
    /// Lets time go on
    Resume,
    /// Lets time go on for a while, at once, and then stand still
    Step {
        /// How long, as '10 ms'
        span: String,
    },
    /// Sets how fast time goes
    Pace {
        /// Virtual seconds per second, or 'max'
        pace: String,
    },
    /// Looks at a program before it is played: what is wrong with it, and how long it takes
    Preview {
        /// The program's file
        program: PathBuf,
    },
    /// Plays a program at the PC's port: frames, or lines for a controller
    Play {
        /// The program's file
        program: PathBuf,
    },
    /// Sends no more of that program
    Stop,
    /// Saves what has happened so far: a recording, a report (HTML), the part (SVG), every line (VCD), or the path of
    /// the tool (SVG)
    Save {
        /// What
        #[arg(value_parser = product)]
        what: Product,
        /// The file; one that is new no one else can read; '-' is standard output
        file: PathBuf,
    },
    /// Prints what happens from now on, until it is ended
    Watch(Shown),
}

#[derive(Debug, clap::Args)]
struct FaultArguments {
    /// What: cut, stuck-low, stuck-high, short, noise, flip, delay, drop, double (lines); crash, hang, reset,
    /// power-off, brown-out, slow, clock, drift, counts, stall, load, supply, backlash, end-stop,
    /// push, slip, skip, shift, swap, dead (boards)
    kind: String,
    /// Which line or board
    place: String,
    /// How much, for those that need it: 10, '2 %', '5 ms'
    #[arg(allow_hyphen_values = true)]
    value: Option<String>,
    /// How long it lasts, as '100 ms' [default: until it is healed]
    #[arg(long, value_name = "TIME")]
    r#for: Option<String>,
    /// What to call it [default: PLACE KIND]
    #[arg(long)]
    name: Option<String>,
    /// When it begins, as in a scenario: '{ reply = "XON" }' [default: now]
    #[arg(long, value_name = "CONDITION")]
    when: Option<String>,
    /// The other line, of a short
    #[arg(long, value_name = "LINE")]
    with: Option<String>,
    /// Which character from now on (flip, delay, drop, double)
    #[arg(long, value_name = "N")]
    nth: Option<i64>,
    /// Which edge of it (delay)
    #[arg(long, value_name = "N")]
    edge: Option<i64>,
    /// The mean time between pulses (noise)
    #[arg(long, value_name = "TIME")]
    period: Option<String>,
    /// How long a pulse lasts at the most (noise)
    #[arg(long, value_name = "TIME")]
    width: Option<String>,
}

impl FaultArguments {
    /// The fault as a scenario would say it.
    fn toml(&self) -> anyhow::Result<String> {
        let place = match self.kind.as_str() {
            kind if LINE_KINDS.contains(&kind) => "line",
            kind if BOARD_KINDS.contains(&kind) => "board",
            kind => bail!("there is no fault '{kind}'{}", nearest(kind, &[&LINE_KINDS[..], &BOARD_KINDS].concat())),
        };
        let mut table = toml::Table::new();
        let mut put = |field: &str, value: Option<toml::Value>| {
            if let Some(value) = value {
                table.insert(field.to_owned(), value);
            }
        };
        let text = |text: &Option<String>| text.clone().map(toml::Value::String);
        let number =
            |text: &String| text.parse().map_or_else(|_| toml::Value::String(text.clone()), toml::Value::Integer);
        put(place, Some(self.place.clone().into()));
        put("kind", Some(self.kind.clone().into()));
        put("value", self.value.as_ref().map(number));
        put("for", text(&self.r#for));
        put("name", text(&self.name));
        put("with", text(&self.with));
        put("nth", self.nth.map(toml::Value::Integer));
        put("edge", self.edge.map(toml::Value::Integer));
        put("period", text(&self.period));
        put("width", text(&self.width));
        if let Some(when) = &self.when {
            let of_file: Result<toml::Table, _> = toml::from_str(&format!("when = {when}"));
            let wrong = "--when: expected a condition as scenarios have it, as '{ reply = \"XON\" }'";
            put("when", Some(of_file.ok().and_then(|mut table| table.remove("when")).context(wrong)?));
        }
        Ok(toml::to_string(&table)?)
    }
}

impl Command {
    fn request(&self, json: bool) -> anyhow::Result<Request> {
        Ok(match self {
            Self::State => Request::State,
            Self::Fault(fault) => Request::Fault { fault: fault.toml()? },
            Self::Heal { name } => Request::Heal { name: name.clone() },
            Self::Power { board, switch } => Request::Power { board: board.clone(), on: switch == "on" },
            Self::Pause => Request::Pause,
            Self::Resume => Request::Resume,
            Self::Step { span } => Request::Step { span: span.clone() },
            Self::Pace { pace } => Request::Pace { pace: pace.clone() },
            Self::Preview { program } => Request::Preview { program: read_program(program)? },
            Self::Play { program } => Request::Play { program: read_program(program)? },
            Self::Stop => Request::Stop,
            Self::Save { what, .. } => Request::Save { what: *what },
            Self::Watch(Shown { line, board, kind }) => {
                let form = match () {
                    () if json => Form::Json,
                    () if colour() => Form::Colour,
                    () => Form::Text,
                };
                Request::Watch { lines: line.clone(), boards: board.clone(), kinds: kind.clone(), form }
            }
        })
    }

    /// The file that is written, if one is.
    fn file(&self) -> Option<PathBuf> {
        if let Self::Save { file, .. } = self { Some(file.clone()) } else { None }
    }

    /// The answer for people.
    fn text(&self, answer: Value) -> anyhow::Result<String> {
        let at = |ns: u64| Instant::from_nanos(ns);
        Ok(match self {
            Self::State => state_text(&serde_json::from_value(answer)?)?,
            Self::Fault(_) => match serde_json::from_value(answer)? {
                Begun { name, since: Some(since) } => format!("fault '{name}' begins at {}\n", at(since)),
                Begun { name, since: None } => format!("fault '{name}' lies in wait\n"),
            },
            Self::Preview { program } => preview_text(&program.display().to_string(), &answer),
            Self::Save { file, .. } => {
                let File { ns, bytes, .. } = serde_json::from_value(answer)?;
                format!("'{}' holds what happened before {}: {bytes} bytes\n", file.display(), at(ns))
            }
            _ => {
                let Done { ns } = serde_json::from_value(answer)?;
                let watching = if matches!(self, Self::Watch(_)) { "watching from" } else { "at" };
                format!("{watching} {}\n", at(ns))
            }
        })
    }
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        let request = self.command.request(self.json)?;
        let path = self.socket.unwrap_or_else(|| default_folder().join(format!("{}-control", self.rig)));
        let socket = UnixStream::connect(&path)
            .with_context(|| format!("no rig is to be steered at {} (is 'torno up' running?)", path.display()))?;
        let mut line = serde_json::to_string(&request)?;
        line.push('\n');
        (&socket).write_all(line.as_bytes()).context("the rig does not listen")?;
        let mut answers = BufReader::new(socket);
        line.clear();
        answers.read_line(&mut line).context("the rig does not answer")?;
        if line.is_empty() {
            bail!("the rig has ended");
        }
        let mut answer: Value = serde_json::from_str(&line).context("the rig does not answer in our words")?;
        if let Some(error) = answer.get("error").and_then(Value::as_str) {
            say(&format!("torno: {error}\n"));
            return Ok(ExitCode::from(USAGE));
        }
        if let Command::Save { file, .. } = &self.command {
            let File { bytes, .. } = serde_json::from_value(answer["ok"].clone())?;
            receive(&mut answers, bytes, file)?;
        }
        let is_refused = answer["ok"]["refused"] == true;
        let watches = matches!(self.command, Command::Watch(_));
        match answer.get_mut("ok").map(Value::take) {
            Some(ok) => {
                let text = if self.json { format!("{ok}\n") } else { self.command.text(ok)? };
                print_beside(&[&self.command.file()], &text)?;
            }
            None => bail!("the rig does not answer in our words"),
        }
        if watches {
            follow(answers)?;
        }
        Ok(if is_refused { ExitCode::from(USAGE) } else { ExitCode::SUCCESS })
    }
}

/// What is known of a program, for people.
fn preview_text(name: &str, preview: &Value) -> String {
    let problems = preview["problems"].as_array().into_iter().flatten().filter_map(Value::as_str);
    let mut text: String = problems.map(|problem| format!("{name}: {problem}\n")).collect();
    for event in preview["events"].as_array().into_iter().flatten() {
        let place = (event["from_s"].as_f64(), event["z_mm"].as_f64());
        let (event, (seconds, z)) = (event["event"].as_str().unwrap_or_default(), place);
        text += &format!("{name}: {event} at {:.3} s, z = {:.2} mm\n", seconds.unwrap_or(0.0), z.unwrap_or(0.0));
    }
    text + &match (preview["refused"] == true, preview["seconds"].as_f64()) {
        (true, _) => format!("{name} is refused\n"),
        (false, Some(seconds)) => format!("{name} takes {seconds:.3} s\n"),
        (false, None) => format!("{name} has not been rehearsed to its end\n"),
    }
}

/// Writes the bytes that follow into a file.
fn receive(answers: &mut impl Read, bytes: u64, path: &Path) -> anyhow::Result<()> {
    let cannot = || format!("cannot write '{}'", path.display());
    let mut file: Box<dyn Write> =
        if is_output(path) { Box::new(io::stdout().lock()) } else { Box::new(create(path).with_context(cannot)?) };
    let copied = io::copy(&mut answers.take(bytes), &mut file).and_then(|copied| file.flush().map(|()| copied));
    if copied.with_context(cannot)? < bytes {
        bail!("the rig has ended before all of '{}' had come", path.display());
    }
    Ok(())
}

fn product(text: &str) -> Result<Product, String> {
    let name = |product: &Product| serde_json::to_value(product).is_ok_and(|name| name == text);
    let found = Product::ALL.into_iter().find(name);
    found.ok_or_else(|| "expected recording, report, part, vcd or path".to_owned())
}

/// Prints what follows, as it comes. That no one reads it ends it, and is no error.
fn follow(mut answers: BufReader<UnixStream>) -> anyhow::Result<()> {
    let mut output = BufWriter::new(io::stdout().lock());
    let mut line = Vec::new();
    loop {
        line.clear();
        if answers.read_until(b'\n', &mut line).context("the rig is lost")? == 0 {
            return Ok(());
        }
        // What has come already is printed at once.
        let more = answers.buffer().contains(&b'\n');
        match output.write_all(&line).and_then(|()| if more { Ok(()) } else { output.flush() }) {
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => return Ok(()),
            written => written.context("cannot write the result")?,
        }
    }
}

fn state_text(state: &State) -> anyhow::Result<String> {
    let mut text = String::new();
    let paused = if state.paused { ", time stands still" } else { "" };
    writeln!(text, "{} at {}, pace {}{paused}\n", state.rig, Instant::from_nanos(state.ns), state.pace)?;
    let width = |heading: &str, of: &dyn Fn(&torno::control::BoardState) -> String| {
        state.boards.iter().map(|board| of(board).chars().count()).chain([heading.len()]).max().unwrap_or_default()
    };
    let waits = |board: &torno::control::BoardState| match &board.waits_for[..] {
        [] => "-".to_owned(),
        names => names.join(", "),
    };
    let (names, waiting) = (width("board", &|board| board.name.clone()), width("waits for", &waits));
    writeln!(text, "{:<names$}  {:>7}  {:<7}  {:<waiting$}  telemetry", "board", "pid", "process", "waits for")?;
    for board in &state.boards {
        let telemetry: Vec<String> = board.telemetry.iter().map(|(name, value)| format!("{name} {value}")).collect();
        let (name, pid, process, waits) = (&board.name, board.pid, &board.process, waits(board));
        writeln!(text, "{name:<names$}  {pid:>7}  {process:<7}  {waits:<waiting$}  {}", telemetry.join(", "))?;
    }
    if let Some(ProgramState { accepted, of, outcome }) = &state.program {
        let outcome = outcome.as_ref().map_or_else(String::new, |outcome| format!(", {outcome}"));
        writeln!(text, "\nprogram {accepted} of {of} accepted{outcome}")?;
    }
    if let Some(KeptState { bytes, of, until }) = &state.kept {
        let until = until.map_or_else(String::new, |ns| format!(", nothing after {}", Instant::from_nanos(ns)));
        writeln!(text, "\nkept    {:.1} of {} MiB{until}", *bytes as f64 / MIB, of / (1 << 20))?;
    }
    for (n, fault) in state.faults.iter().enumerate() {
        let since = match fault.since {
            Some(since) => format!("since {}", Instant::from_nanos(since)),
            None => "lies in wait".to_owned(),
        };
        let until = fault.until.map_or_else(String::new, |until| format!(", until {}", Instant::from_nanos(until)));
        writeln!(text, "{}fault '{}' {since}{until}", if n == 0 { "\n" } else { "" }, fault.name)?;
    }
    Ok(text)
}
