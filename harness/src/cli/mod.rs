//! The command line.

#[cfg(target_os = "linux")]
mod board;
mod compare;
#[cfg(target_os = "linux")]
mod ctl;
mod diff;
#[cfg(not(target_os = "linux"))]
mod elsewhere;
mod engraver;
mod exit;
mod gcode;
mod identify;
#[cfg(target_os = "linux")]
mod join;
mod options;
mod output;
#[cfg(target_os = "linux")]
mod page;
mod replay;
mod run;
mod send;
mod servo;
mod sweep;
mod test;
mod trace;
mod tune;
#[cfg(target_os = "linux")]
mod up;

use std::fs::File;
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use anyhow::Context;
use clap::{Parser, Subcommand};
use torno::job::LineJob;
use torno::observe::log;
use torno::observe::stderr::{self, say};
use torno::platform::{FileLimit, Interrupt, has_room_for_files};
use torno::recorder::Recorder;
use torno::rig::file::{DEFAULT, RigFile};
use torno::text_file::TextError;
use torno_part::{Place, Profile};
use torno_protocol::lathe::Program;
use torno_trace::{Damage, Header, Trace};

#[cfg(not(target_os = "linux"))]
use elsewhere::{board, ctl, join, page, up};
use exit::{FAILED, INTERRUPTED, USAGE};
use gcode::plan::is_gcode;
use join::wait_for_boards;
use output::{OutputFile, colour, draw, print, print_beside, print_result, print_text, write_file, written};

/// A command needs room for so many open files before it does anything.
const FILES: usize = 8;

/// What a bare `torno` says.
const INTRODUCTION: &str = "\
torno emulates small serial-bus CNC machines: boards are processes, lines carry real waveforms.
  torno run     plays a program on a lathe, as fast as the computer can, and reports the result
  torno up      starts the lathe and gives your own program a serial port to it
  torno help    lists all commands; 'torno COMMAND --help' explains one
From a checkout, write 'cargo run -- run' for 'torno run'.
";

/// Emulates small serial-bus CNC machines, so that people can work without the machine.
#[derive(Debug, Parser)]
#[command(name = "torno", version, max_term_width = 100)]
#[command(
    after_help = "Exit status: 0 as expected, 1 a check failed, 2 wrong usage or broken input, 3 the rig broke or\n\
    cannot be recorded, 130 interrupted by Ctrl-C or a signal. 'up', which has no other end, then ends with 0,\n\
    or 1 if a board had died.\n\
    RUST_LOG sets what is logged on standard error, e.g. RUST_LOG=info, or of one board RUST_LOG=warn,depth=info."
)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    /// The form of the log on standard error
    #[arg(long, global = true, value_name = "FORM", value_enum, default_value_t)]
    log: log::Form,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Launches a rig and plays a whole program through it.
    Run(run::Arguments),
    /// Launches a rig and keeps it up, with a serial port for your own PC program.
    Up(up::Arguments),
    /// Looks into a rig that is up, breaks it, holds its time.
    Ctl(ctl::Arguments),
    /// Is the PC on any serial port: sends a program, honours the hold, shows the replies.
    Send(send::Arguments),
    /// Runs scenarios: programs with faults, and what must hold.
    Test(test::Arguments),
    /// Runs a scenario over seeds, and over ranges of whatever its files say.
    Sweep(sweep::Arguments),
    /// Finds the transfer function of a board's motor: from its own encoder, or from a file.
    Identify(identify::Arguments),
    /// Proposes a controller for a board's motor, says what it will do, and shows it on the rig.
    Tune(tune::Arguments),
    /// Plays a program on two rigs, and shows side by side what their buses cost.
    Compare(compare::Arguments),
    /// Is the PC program of the servo stand: checks, draws and runs motion programs.
    Servo(servo::Arguments),
    /// Shows what the loops of an engraver make of a program.
    Engraver(engraver::Arguments),
    /// Reads G-code: checks a program, prints the motions that it asks for, plans it for a lathe.
    Gcode(gcode::Arguments),
    /// Prints a recorded trace as a bus analyser would, or exports it.
    Trace(trace::Arguments),
    /// Lets a recorded session happen again, and checks that the same comes of it.
    Replay(replay::Arguments),
    /// Tells where two traces part.
    Diff(diff::Arguments),
    /// Is one board: what the launcher starts, or one by hand that joins a rig.
    Board(board::Arguments),
}

impl Command {
    /// What it logs where `RUST_LOG` says nothing.
    const fn logs(&self) -> &'static str {
        match self {
            Self::Up(_) => "info",
            Self::Test(_) | Self::Sweep(_) => "error",
            _ => "warn",
        }
    }
}

/// Runs the command line.
pub(crate) fn main(started: Instant) -> ExitCode {
    let code = run(started);
    stderr::flush();
    code
}

fn run(started: Instant) -> ExitCode {
    let Arguments { command, log } = Arguments::parse();
    let Some(command) = command else {
        return print(INTRODUCTION).map_or_else(|error| complain(&error), |()| ExitCode::SUCCESS);
    };
    log::init(command.logs(), log);
    let runtime = match runtime() {
        Ok(runtime) => runtime,
        Err(error) => return complain(&error),
    };
    let result = runtime.block_on(async {
        let _limit = FileLimit::is_an_error()?;
        match command {
            Command::Run(arguments) => arguments.run(started).await,
            Command::Up(arguments) => arguments.run().await,
            Command::Ctl(arguments) => arguments.run().await,
            Command::Send(arguments) => arguments.run(started).await,
            Command::Test(arguments) => arguments.run().await,
            Command::Sweep(arguments) => arguments.run().await,
            Command::Identify(arguments) => arguments.run().await,
            Command::Tune(arguments) => arguments.run().await,
            Command::Compare(arguments) => arguments.run().await,
            Command::Servo(arguments) => arguments.run().await,
            Command::Engraver(arguments) => arguments.run().await,
            Command::Gcode(arguments) => arguments.run().await,
            Command::Trace(arguments) => arguments.run(),
            Command::Replay(arguments) => arguments.run(started).await,
            Command::Diff(arguments) => arguments.run(),
            Command::Board(arguments) => arguments.run().await,
        }
    });
    result.unwrap_or_else(|error| complain(&error))
}

/// The runtime, if the limit of open files leaves room for it: it does not look itself.
fn runtime() -> anyhow::Result<tokio::runtime::Runtime> {
    has_room_for_files(FILES)
        .with_context(|| format!("no room for {FILES} open files: expected a higher limit (ulimit -n)"))?;
    Ok(tokio::runtime::Builder::new_current_thread().enable_all().build()?)
}

fn complain(error: &anyhow::Error) -> ExitCode {
    say(&format!("torno: {error:#}\n"));
    ExitCode::from(exit::code(error))
}

/// A rig and a program, from two optional words: a word that ends in `.frames` or as G-code does is a program.
fn rig_and_program(rig: Option<String>, program: Option<PathBuf>) -> (String, Option<PathBuf>) {
    match (rig, program) {
        (Some(word), None) if word.ends_with(".frames") || is_gcode(Path::new(&word)) => {
            (DEFAULT.to_owned(), Some(PathBuf::from(word)))
        }
        (rig, program) => (rig.unwrap_or_else(|| DEFAULT.to_owned()), program),
    }
}

/// A rig with values put in their places, each as `PLACE=VALUE`.
fn load_rig(rig: &str, set: &[String]) -> anyhow::Result<RigFile> {
    set.iter().try_fold(RigFile::load(rig)?, |file, set| {
        file.set(set).map_err(|message| anyhow::anyhow!("--set '{set}': {message}"))
    })
}

/// The span around everything that is logged about a rig.
fn rig_span(file: &RigFile) -> tracing::Span {
    tracing::error_span!("rig", name = file.name)
}

/// Refuses a rig whose PC sends no frames of the lathe.
fn plays_frames(file: &RigFile) -> anyhow::Result<()> {
    let (wanted, name, dialect) = (Program::DIALECT, &file.name, &file.pc.dialect);
    anyhow::ensure!(
        dialect.name() == wanted,
        "a program of frames is for rigs that speak {wanted}, and the rig '{name}' speaks {}: use '{}'",
        dialect.name(),
        dialect.player()
    );
    Ok(())
}

/// A program that a rig is to play.
struct Loaded {
    name: String,
    program: Program,
    /// What G-code asks for: the bar, as its path cuts it.
    asked: Option<Profile>,
}

/// The program in a file, or the demonstration. G-code is planned for the rig; it may call the place where the tool is
/// at the start something else than the rig does.
fn load_program(path: Option<&Path>, rig: &RigFile, at: Option<Place>) -> anyhow::Result<Loaded> {
    let is_gcode = path.is_some_and(is_gcode);
    anyhow::ensure!(is_gcode || at.is_none(), "--at: frames say nothing of places: expected a program of G-code");
    let Some(path) = path else {
        let (name, text) = demonstration(rig)?;
        return Ok(Loaded { name: name.to_owned(), program: Program::parse(text).context(name)?, asked: None });
    };
    let name = path.display().to_string();
    if is_gcode {
        let plan = gcode::plan::load(path, rig, at)?;
        return Ok(Loaded { name, program: plan.program, asked: plan.report.stock.map(|stock| stock.profile) });
    }
    let text = read_program(path)?;
    let program = Program::parse(&text).with_context(|| name.clone())?;
    Ok(Loaded { name, program, asked: None })
}

/// A program of lines that a rig is to play.
struct LoadedLines {
    name: String,
    job: LineJob,
    /// What it asks for, if it can be planned: the bar, as its path cuts it.
    asked: Option<Profile>,
}

/// The lines in a file, or those of the demonstration. They begin with where the tool stands: there, or where the rig
/// says it does.
fn load_lines(path: Option<&Path>, rig: &RigFile, at: Option<Place>) -> anyhow::Result<LoadedLines> {
    let (name, text) = match path {
        None => demonstration(rig).map(|(name, text)| (name.to_owned(), text.to_owned()))?,
        Some(path) => (path.display().to_string(), read_program(path)?),
    };
    let for_rig = torno::planning::settings(rig, at, Default::default()).ok();
    let at = at.or(for_rig.as_ref().map(|for_rig| for_rig.start));
    let first = at.map_or_else(String::new, torno::planning::first_line);
    if !first.is_empty() {
        say(&format!("before the program, to say where the tool stands: {first}"));
    }
    let asked = for_rig.and_then(|for_rig| gcode::plan::asked(&text, for_rig));
    Ok(LoadedLines { name, job: LineJob::new(&first, &text), asked })
}

/// What a rig plays where no program is named.
fn demonstration(rig: &RigFile) -> anyhow::Result<(&'static str, &'static str)> {
    let kind = &rig.boards[rig.pc.to.0].kind;
    torno_machines::program(kind)
        .with_context(|| format!("a board of kind '{kind}' has no program of its own: expected a program"))
}

/// The text of a program.
fn read_program(path: &Path) -> anyhow::Result<String> {
    let name = path.display().to_string();
    torno::text_file::read(path).map_err(|error| match error {
        TextError::Unreadable(error) => anyhow::Error::new(error).context(format!("cannot read the program '{name}'")),
        TextError::NotText { .. } => anyhow::Error::new(error).context(name),
    })
}

/// Opens a recording and writes its header.
fn start_recording(path: &Path, header: &Header) -> anyhow::Result<Recorder> {
    let file = Recorder::open(path)?;
    Ok(Recorder::begin(path, file, header)?)
}

/// The trace in a file, and whether it is whole. If it is not, says so on standard error.
fn load_trace(path: &Path) -> anyhow::Result<(Trace, Option<Damage>)> {
    let of_file = |damage: Damage| anyhow::Error::new(damage).context(format!("'{}'", path.display()));
    let file = File::open(path).map_err(|error| of_file(error.into()))?;
    let (trace, damage) = torno_trace::read(BufReader::new(file), RigFile::layout_of).map_err(of_file)?;
    if let Some(damage) = &damage {
        say(&format!("torno: '{}' {damage}, up to {}\n", path.display(), trace.settled));
    }
    Ok((trace, damage))
}

/// Does something in a thread of its own; None, if a signal came first. Then no one waits for it: what it still does
/// ends with the program.
async fn unless_interrupted<T: Send + 'static>(act: impl FnOnce() -> T + Send + 'static) -> io::Result<Option<T>> {
    let mut interrupt = Interrupt::listen()?;
    let (done, is_done) = tokio::sync::oneshot::channel();
    let thread = std::thread::spawn(move || drop(done.send(act())));
    tokio::select! {
        result = is_done => match result {
            Ok(result) => Ok(Some(result)),
            // It has panicked, and says why.
            Err(_) => thread.join().map_or_else(|panic| std::panic::resume_unwind(panic), |()| Ok(None)),
        },
        () = interrupt.received() => Ok(None),
    }
}

/// The processors, or one.
fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
