//! The part that came of a run, beside the one that was asked for.

use torno_part::{Profile, Side};
use torno_protocol::board::Stimulus;
use torno_protocol::lathe::Program;

use super::PartSummary;
use super::drawing::Drawing;
use crate::rig::file::RigFile;
use torno_engine::InputKind;
use torno_machines::workpiece::Part;
use torno_machines::workpiece::{ToolPath, Turned};
use torno_trace::Trace;

/// The part that a run has turned.
#[derive(Clone, Debug)]
pub struct Cut {
    part: Part,
    /// What was asked for, if that is known.
    asked: Option<Profile>,
    turned: Turned,
    /// What is told of it.
    pub summary: PartSummary,
}

impl Cut {
    /// What came of a bar, and what was asked for, if that is known, within what tolerance in mm.
    pub fn new(part: Part, asked: Option<Profile>, turned: Turned, tolerance: Option<f64>) -> Self {
        Self { summary: PartSummary::new(&part, &turned, asked.as_ref(), tolerance), part, asked, turned }
    }

    /// The same from a trace; None, if its rig turns no part. What was asked for is known of a program of frames that
    /// was played.
    pub fn of(trace: &Trace) -> Option<Self> {
        let rig = RigFile::parse(&trace.header.rig, &trace.header.text).ok()?;
        let takes_frames = rig.pc.dialect.name() == Program::DIALECT;
        let part = rig.part?;
        let pc = trace.header.layout.gateways().next()?;
        let written = trace.inputs.iter().filter_map(|input| match &input.what {
            InputKind::Stimulus { board, stimulus: Stimulus::Write(bytes) } if *board == pc => Some(bytes),
            _ => None,
        });
        let bytes: Vec<u8> = written.flatten().copied().collect();
        let played = || part.asked(&Program { frames: bytes.as_chunks().0.to_vec() });
        let asked = trace.header.program.as_ref().filter(|_| takes_frames).map(|_| played());
        let mut path = ToolPath::new(&part);
        trace.facts.iter().for_each(|fact| path.add(fact));
        Some(Self::new(part, asked, path.cut(), None))
    }

    /// Its profile beside the one that was asked for, point by point from the face on: CSV. Where nobody knows what was
    /// asked for, what was got stands for it.
    pub fn csv(&self) -> String {
        let [got, asked] =
            [&self.turned.profile, self.asked.as_ref().unwrap_or(&self.turned.profile)].map(Profile::radii);
        let both = |got: f64, asked: f64| format!(",{got:.4},{asked:.4}");
        let bar = self.part.diameter / 2.0;
        let has_bore = self.part.bore > 0.0;
        let head = if has_bore { ",bore_radius_mm,bore_radius_asked_mm" } else { "" };
        let mut text = format!("z_mm,radius_mm,radius_asked_mm{head}\n");
        for (point, (got, asked)) in got.iter().zip(&*asked).enumerate() {
            let turned = both(*got, *asked);
            let (outside, bore) = match self.part.side {
                Side::Outside if has_bore => (turned, both(self.part.bore / 2.0, self.part.bore / 2.0)),
                Side::Outside => (turned, String::new()),
                Side::Inside => (both(bar, bar), turned),
            };
            text += &format!("{:.2}{outside}{bore}\n", Profile::z(point));
        }
        text
    }

    /// The drawing of it, as the text of an SVG file.
    pub fn draw(&self, rig: &str, program: &str) -> String {
        let Self { part, asked, turned, summary } = self;
        Drawing { rig, program, part, turned, asked: asked.as_ref(), summary }.svg()
    }
}
