//! `torno trace`

use std::io::{self, BufWriter, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use torno::pins::pins;
use torno::report::Cut;
use torno::report::page::Page;
use torno::saving::{SESSION, write_waveforms};
use torno::servo::report::facts;
use torno::speed::with_speeds;
use torno_protocol::time::Instant;
use torno_trace::Timescale;
use torno_trace::analyser::rows;
use torno_trace::rows::{CSV_HEADER, Filter, Row, Wanted};

use super::options::{drawing, time, timescale};
use super::{OutputFile, USAGE, colour, load_trace, write_file};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The trace that '--record' has written
    file: PathBuf,
    /// Nothing before this, in virtual time
    #[arg(long, value_name = "TIME", value_parser = instant)]
    from: Option<Instant>,
    /// Nothing after this, in virtual time
    #[arg(long, value_name = "TIME", value_parser = instant)]
    to: Option<Instant>,
    #[command(flatten)]
    shown: Shown,
    /// Writes every line of the rig as a one-bit signal (VCD); prints nothing
    #[arg(long, value_name = "FILE", conflicts_with_all = ["csv", "json", "from", "to", "line", "board", "kind"])]
    vcd: Option<PathBuf>,
    /// Adds the pins between firmware and motors to --vcd: pulse-width modulator, H-bridge, encoder
    #[arg(long, requires = "vcd")]
    pins: bool,
    /// The unit of time of --vcd: 1, 10 or 100 of ns or us, or 1 ms
    #[arg(long, value_name = "TIME", default_value = "1 us", value_parser = timescale, requires = "vcd")]
    vcd_step: Timescale,
    /// Writes a page to look at: motion, the bus, the part, the figures (HTML, one file); prints nothing
    #[arg(long, value_name = "FILE",
          conflicts_with_all = ["vcd", "csv", "json", "from", "to", "line", "board", "kind"])]
    report: Option<PathBuf>,
    /// Draws the part that was turned into this file (SVG); '-' is standard output; prints nothing
    #[arg(long, value_name = "FILE", value_parser = drawing,
          conflicts_with_all = ["report", "vcd", "csv", "json", "from", "to", "line", "board", "kind"])]
    part: Option<PathBuf>,
    /// Prints telemetry as comma-separated values, one row a change
    #[arg(long, conflicts_with_all = ["json", "kind", "line"])]
    csv: bool,
    /// Prints one JSON object a line
    #[arg(long)]
    json: bool,
}

/// What is shown of what happened.
#[derive(Debug, clap::Args)]
pub(super) struct Shown {
    /// Only this line, as 'pc_to_master'; may be repeated, and joined with --board
    #[arg(long, value_name = "NAME")]
    pub(super) line: Vec<String>,
    /// Only this board; may be repeated, and joined with --line
    #[arg(long, value_name = "NAME")]
    pub(super) board: Vec<String>,
    /// Only edges, characters, frames, telemetry, events, inputs or pins; may be repeated [default: all but edges]
    #[arg(long, value_name = "KIND")]
    pub(super) kind: Vec<String>,
}

fn instant(text: &str) -> Result<Instant, String> {
    time(text).map(|since_start| Instant::START + since_start)
}

impl Arguments {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let (trace, damage) = load_trace(&self.file)?;
        if let Some(path) = &self.vcd {
            let pins = if self.pins { pins(&trace)? } else { Vec::new() };
            let file = OutputFile::create(path)?;
            file.write_by(|file| write_waveforms(&trace, pins, self.vcd_step, file))?;
        } else if let Some(path) = &self.report {
            let name = self.file.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
            let title = &format!("the recording {name}");
            let cut = Cut::of(&trace);
            let page =
                Page { trace: &trace, title, summary: None, cut: cut.as_ref(), faults: &[], facts: &facts(&trace) };
            write_file(path, page.html())?;
        } else if let Some(path) = &self.part {
            let none =
                || format!("--part: the rig '{}' turns no part: expected a [part] in its file", trace.header.rig);
            let program = trace.header.program.as_deref().unwrap_or(SESSION);
            write_file(path, Cut::of(&trace).with_context(none)?.draw(&trace.header.rig, program))?;
        } else {
            let (kinds, csv) = if self.csv { (vec!["telemetry".to_owned()], true) } else { (self.shown.kind, false) };
            let from = self.from.unwrap_or(Instant::START);
            let wanted = Wanted { from, to: self.to, lines: self.shown.line, boards: self.shown.board, kinds };
            let trace = if csv { with_speeds(&trace) } else { trace };
            let rows = rows(&trace, &Filter::new(&trace.header, &wanted)?, torno_machines::dialect);
            let colour = colour();
            let show = |row: &Row| match () {
                () if csv => row.csv(&trace.header).unwrap_or_default(),
                () if self.json => row.json(&trace.header).to_string(),
                () => row.text(&trace.header, colour),
            };
            match print_rows(csv.then_some(CSV_HEADER), rows.iter().map(show)) {
                Err(error) if error.kind() == io::ErrorKind::BrokenPipe => {}
                printed => printed.context("cannot write the result")?,
            }
        }
        Ok(if damage.is_some() { ExitCode::from(USAGE) } else { ExitCode::SUCCESS })
    }
}

fn print_rows(first: Option<&str>, rows: impl Iterator<Item = String>) -> io::Result<()> {
    let mut output = BufWriter::new(io::stdout().lock());
    for row in first.map(str::to_owned).into_iter().chain(rows) {
        writeln!(output, "{row}")?;
    }
    output.flush()
}
