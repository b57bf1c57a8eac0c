//! What is made of a session for a file, while the session goes on: a recording, a report, a drawing of the part, the
//! lines for a logic analyser, the path of the tool.

use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Seek, Write};
use std::path::Path;

use serde::{Deserialize, Serialize};
use torno_plot::{Colours, Format};
use torno_protocol::board::Pin;
use torno_protocol::layout::Layout;
use torno_protocol::time::Span;
use torno_trace::{Timescale, Trace, Waveforms};

use crate::platform::owner_only;
use crate::report::page::Page;
use crate::report::{Cut, FaultSummary};
use crate::rig::file::RigFile;
use crate::servo::report::facts;
use crate::spool::{SoFar, nameless};
use crate::tracking::{Tracking, has_axes};

/// What stands for the name of a program in what is made of a session in which programs outside have played.
pub const SESSION: &str = "a live session";
/// Goes on for so long after the end of a waveform dump whose rig this version cannot read: two characters at 50 baud.
const LONG_TAIL: Span = Span::from_millis(400);

/// What can be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Product {
    /// A trace, which can be repeated.
    Recording,
    /// A page to look at (HTML).
    Report,
    /// A drawing of the part (SVG).
    Part,
    /// Every line for a logic analyser (VCD).
    Vcd,
    /// The path asked of the tool, and the one that it went (SVG).
    Path,
}

/// What is made of a session.
#[derive(Clone, Debug)]
pub struct Saving {
    /// What.
    pub product: Product,
    /// What has happened so far.
    pub so_far: SoFar,
    /// The faults that have begun, by their names.
    pub faults: Vec<FaultSummary>,
}

/// A file that has no name yet but the one that is proposed.
#[derive(Debug)]
pub struct Saved {
    /// What a person would call it.
    pub name: String,
    /// Its media type (RFC 6838).
    pub media: &'static str,
    /// How many bytes it has.
    pub bytes: u64,
    /// The file, from its beginning.
    pub file: File,
}

impl Product {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Recording, Self::Report, Self::Part, Self::Vcd, Self::Path];

    /// What behind the rig's name is its file's usual name, and its media type.
    const fn ending(self) -> (&'static str, &'static str) {
        match self {
            Self::Recording => (".torno", "application/octet-stream"),
            Self::Report => ("-report.html", "text/html; charset=utf-8"),
            Self::Part => ("-part.svg", "image/svg+xml"),
            Self::Vcd => (".vcd", "application/octet-stream"),
            Self::Path => ("-path.svg", "image/svg+xml"),
        }
    }

    /// Whether it can be made of a session of this rig.
    ///
    /// # Errors
    /// Why not, for people.
    pub fn check(self, rig: &RigFile) -> Result<(), String> {
        let name = &rig.name;
        match self {
            Self::Part if rig.part.is_none() => {
                Err(format!("the rig '{name}' turns no part: expected a [part] in its file"))
            }
            Self::Path if !any_has_axes(&rig.layout) => Err(format!(
                "no board of the rig '{name}' tells in nm where its axes are: expected a rig such as 'engraver'"
            )),
            _ => Ok(()),
        }
    }
}

fn any_has_axes(layout: &Layout) -> bool {
    layout.boards.iter().any(|board| has_axes(&board.description))
}

impl Saving {
    /// Makes it. It can take seconds.
    ///
    /// # Errors
    /// Why it cannot be made, for people.
    pub fn make(&self, rig: &str) -> Result<Saved, String> {
        let failed = |error: &dyn std::fmt::Display| format!("it cannot be made: {error}");
        let (mut writer, mut file) = nameless("saved").map_err(|error| failed(&error))?;
        self.write(&mut BufWriter::new(&mut writer)).map_err(|error| failed(&error))?;
        let (ending, media) = self.product.ending();
        let bytes = writer.stream_position().and_then(|bytes| file.rewind().map(|()| bytes));
        Ok(Saved { name: format!("{rig}{ending}"), media, bytes: bytes.map_err(|error| failed(&error))?, file })
    }

    fn write(&self, to: &mut impl Write) -> Result<(), Box<dyn std::error::Error>> {
        if self.product == Product::Recording {
            self.so_far.write(&mut *to)?;
            return Ok(to.flush()?);
        }
        let trace = &self.so_far.trace()?;
        let cut = || Cut::of(trace);
        match self.product {
            Product::Recording => {}
            Product::Report => {
                to.write_all(report(trace, cut().as_ref(), &self.faults).as_bytes())?;
            }
            Product::Part => {
                let drawing = cut().map(|cut| cut.draw(&trace.header.rig, SESSION));
                to.write_all(drawing.unwrap_or_default().as_bytes())?;
            }
            Product::Vcd => write_waveforms(trace, Vec::new(), Timescale::MICROSECOND, &mut *to)?,
            Product::Path => {
                let tracking = Tracking::of(trace)?;
                let figure = tracking.map(|it| it.figure(&format!("{SESSION} on {}", trace.header.rig)));
                let drawing = figure.map(|figure| figure.encode(Format::Svg, &Colours::default())).transpose()?;
                to.write_all(&drawing.unwrap_or_default())?;
            }
        }
        Ok(to.flush()?)
    }
}

/// The report of a session (HTML).
pub fn report(trace: &Trace, cut: Option<&Cut>, faults: &[FaultSummary]) -> String {
    Page { trace, title: SESSION, summary: None, cut, faults, facts: &facts(trace) }.html()
}

/// A file for what was made, which no one but its owner can read if it is new.
///
/// # Errors
/// If the system refuses it.
pub fn create(path: &Path) -> io::Result<File> {
    owner_only(OpenOptions::new().write(true).create(true).truncate(true)).open(path)
}

/// Writes every line of a trace, and these pins, for a logic analyser.
///
/// # Errors
/// Whatever writing gives.
pub fn write_waveforms(trace: &Trace, pins: Vec<Pin>, scale: Timescale, file: impl Write) -> io::Result<()> {
    let mut waveforms = Waveforms::new(&trace.header.layout);
    trace.facts.iter().for_each(|fact| waveforms.add(fact));
    waveforms.add_pins(pins);
    let end = trace.end.as_ref().map_or(trace.settled, |end| end.at);
    let tail = RigFile::parse(&trace.header.rig, &trace.header.text).map_or(LONG_TAIL, |file| file.margin());
    waveforms.write(file, end, tail, scale)
}
