//! How the commands read a program of G-code.

use std::fs::File;
use std::io::{self, Read, Seek};
use std::path::{Path, PathBuf};

use anyhow::Context;
use torno::report::Bar;
use torno_gcode::{Columns, Dialect, Finding, Interpreter, Motion, Outcome, Place, Settings};

use crate::cli::output::is_output;

/// What is read of a file at once.
const BLOCK: usize = 64 * 1024;

/// A dialect, or none in particular.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Choice {
    /// What the program's first lines look like.
    Auto,
    /// RS274/NGC as LinuxCNC reads it.
    Linuxcnc,
    /// That of a Fanuc lathe, G-code system A.
    Fanuc,
}

/// How a program is read.
#[derive(Debug, clap::Args)]
pub(super) struct Reading {
    /// The G-code; '-' is standard input
    pub(super) file: PathBuf,
    /// The dialect
    #[arg(long, value_enum, default_value = "auto")]
    pub(super) dialect: Choice,
    /// Refuses what is a warning otherwise, such as an M code that is not known
    #[arg(long)]
    pub(super) strict: bool,
    /// Passes over blocks that begin with '/'
    #[arg(long)]
    pub(super) block_delete: bool,
    /// Where the tool is at the start, in mm, X as a radius [default: 0,0; to plan, where the
    /// rig's tool stands]
    #[arg(long, value_name = "X,Z", value_parser = place, allow_hyphen_values = true)]
    pub(super) at: Option<Place>,
    /// A program with loops or calls ends after so many lines at the latest
    #[arg(long, value_name = "N", default_value_t = Settings::default().steps_max)]
    pub(super) steps: u64,
}

pub(super) fn place(text: &str) -> Result<Place, String> {
    let number = |text: &str| text.trim().parse().ok().filter(|value: &f64| value.abs() < 1e6);
    let place = text.split_once(',').and_then(|(x, z)| Some((number(x)?, number(z)?)));
    let (x, z) = place.ok_or_else(|| "expected X,Z in mm, such as 12.5,1".to_owned())?;
    Ok(Place { x, z, ..Place::default() })
}

/// A program that can be read more than once: a regular file, or what came through a pipe.
pub(super) enum Source {
    File(File, u64),
    Bytes(Vec<u8>),
}

impl Reading {
    pub(super) fn name(&self) -> String {
        if is_output(&self.file) { "standard input".to_owned() } else { self.file.display().to_string() }
    }

    pub(super) fn settings(&self) -> Settings {
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
            ..Settings::default()
        }
    }

    pub(super) fn open(&self) -> anyhow::Result<Source> {
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
    pub(super) fn interpret(
        &self,
        settings: &Settings,
        source: &mut Source,
        sink: &mut dyn FnMut(Motion),
    ) -> anyhow::Result<Outcome> {
        let mut interpreter = Interpreter::new(settings);
        self.read(source, |bytes| {
            interpreter.push(bytes, sink);
            !interpreter.is_done()
        })?;
        Ok(interpreter.finish(sink))
    }

    /// The columns of words in the program: the line of each, and its letter.
    pub(super) fn columns(&self, source: &mut Source, words: &[(usize, u8)]) -> anyhow::Result<Vec<usize>> {
        let mut columns = Columns::new(words.iter().copied());
        if !words.is_empty() {
            self.read(source, |bytes| {
                columns.push(bytes);
                true
            })?;
        }
        Ok(columns.finish())
    }

    /// Reads the program, from its start, for as long as more is wanted.
    fn read(&self, source: &mut Source, mut take: impl FnMut(&[u8]) -> bool) -> anyhow::Result<()> {
        match source {
            Source::Bytes(bytes) => drop(take(bytes)),
            Source::File(file, length) => {
                let bar = Bar::of_bytes(*length);
                let read = read_file(file, &bar, take);
                bar.clear();
                read.with_context(|| format!("cannot read the program '{}'", self.name()))?;
            }
        }
        Ok(())
    }

    pub(super) fn told(&self, finding: &Finding) -> String {
        format!("{}:{finding}\n", self.name())
    }
}

fn read_file(file: &mut File, bar: &Bar, mut take: impl FnMut(&[u8]) -> bool) -> io::Result<()> {
    file.rewind()?;
    let mut block = vec![0; BLOCK];
    let mut done = 0;
    loop {
        let length = file.read(&mut block)?;
        if length == 0 || !take(&block[..length]) {
            return Ok(());
        }
        done += length;
        bar.reach(done as u64);
    }
}
