//! Options that several commands have, and how their values are read.

use std::path::PathBuf;

use anyhow::Context;
use torno::kept::KeptFile;
use torno::rig::Driver;
use torno::rig::file::RigFile;
use torno_plot::Format;
use torno_protocol::board::Kept;
use torno_protocol::time::Span;
use torno_text::parse_span;
use torno_trace::Timescale;

/// Where the boards run.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct Placement {
    /// Runs the boards in this process: what commands do that check, sweep or repeat
    #[arg(long, conflicts_with = "processes")]
    in_process: bool,
    /// Runs each board in a process of its own: what commands do that launch a rig. The result is the same
    #[arg(long)]
    processes: bool,
}

impl Placement {
    /// One of the two was asked for.
    pub(super) const fn is_chosen(self) -> bool {
        self.in_process || self.processes
    }

    /// In processes, where there can be such, unless something else was asked for.
    pub(super) fn or_processes(self) -> anyhow::Result<Driver> {
        let in_process = self.in_process || !(self.processes || Driver::has_processes());
        if in_process { Ok(Driver::InProcess) } else { processes() }
    }

    /// In this process, unless something else was asked for.
    pub(super) fn or_in_process(self) -> anyhow::Result<Driver> {
        if self.processes { processes() } else { Ok(Driver::InProcess) }
    }
}

fn processes() -> anyhow::Result<Driver> {
    anyhow::ensure!(Driver::has_processes(), "--processes: boards run in processes of their own on Linux only");
    Ok(Driver::Processes { exe: std::env::current_exe().context("cannot find this program, to start the boards")? })
}

/// Files for what boards keep without power.
#[derive(Debug, clap::Args)]
pub(super) struct Eeprom {
    /// Keeps a board's EEPROM in this file, from one session to the next: a line for each thing, as in the rig file.
    /// BOARD is needed if several boards of the rig have one (may be given several times)
    #[arg(long = "eeprom", value_name = "[BOARD=]FILE")]
    files: Vec<String>,
}

impl Eeprom {
    /// Opens the files; gives the rig whose boards keep at the start what they say.
    pub(super) fn open(&self, rig: RigFile) -> anyhow::Result<(Vec<KeptFile>, RigFile)> {
        self.files.iter().try_fold((Vec::new(), rig), |(mut files, rig), text| {
            let (file, rig) = KeptFile::open(text, &rig).context("--eeprom")?;
            files.push(file);
            Ok((files, rig))
        })
    }
}

/// The places in the rig file of the boards whose files these are.
pub(super) fn keepers(files: &[KeptFile]) -> Vec<usize> {
    files.iter().map(KeptFile::board).collect()
}

/// Writes what the boards keep at the end.
pub(super) fn write_kept(files: &[KeptFile], kept: &[Option<Kept>]) -> anyhow::Result<()> {
    for (file, kept) in files.iter().zip(kept) {
        match kept {
            Some(kept) => file.write(kept)?,
            None => tracing::warn!(
                "board '{}' cannot say what it keeps: '{}' stays as it was",
                file.name(),
                file.path().display()
            ),
        }
    }
    Ok(())
}

/// A time with its unit; a number alone is in seconds.
pub(super) fn time(text: &str) -> Result<Span, String> {
    let seconds = text.trim().parse::<f64>().is_ok();
    let text = if seconds { format!("{} s", text.trim()) } else { text.to_owned() };
    parse_span(&text).map_err(|_| "expected a time, such as '1.5 s', '200 ms', or 1.5 for seconds".to_owned())
}

/// The unit of time of a waveform dump.
pub(super) fn timescale(text: &str) -> Result<Timescale, String> {
    let message = "expected 1, 10 or 100 of ns or us, or 1 ms";
    Timescale::new(time(text)?).ok_or_else(|| message.to_owned())
}

/// Where a picture goes: its name says in which format.
pub(super) fn picture(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match Format::of(&path) {
        Some(_) => Ok(path),
        None => Err("expected a name that ends in .svg or .png, or '-' for SVG on standard output".to_owned()),
    }
}

/// Where a drawing goes, which is SVG.
pub(super) fn drawing(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match Format::of(&path) {
        Some(Format::Svg) => Ok(path),
        _ => Err("the drawing is SVG: expected a name that ends in .svg, or '-' for standard output".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_has_a_unit_or_is_in_seconds() {
        for (text, ms) in [("5", 5_000), ("0.1", 100), ("1e-3", 1), (" 2 ", 2_000), ("100 ms", 100), ("1.5s", 1_500)] {
            assert_eq!(time(text), Ok(Span::from_millis(ms)), "{text}");
        }
        for wrong in ["", "-1", "5 m", "inf", "nan", "1e300", "s", "ms"] {
            assert!(time(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn the_name_of_a_picture_says_its_format() {
        for (name, is_picture, is_drawing) in [
            ("x.svg", true, true),
            ("x.SVG", true, true),
            ("-", true, true),
            ("x", true, true),
            ("a.b/x", true, true),
            ("x.png", true, false),
            ("x.jpg", false, false),
            ("x.pdf", false, false),
        ] {
            assert_eq!((picture(name).is_ok(), drawing(name).is_ok()), (is_picture, is_drawing), "{name}");
        }
    }
}
