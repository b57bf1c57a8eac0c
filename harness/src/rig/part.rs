//! The rig file's `[part]`: the bar, the nose, what is allowed, and which quantities of which boards move the tool.

use serde::Deserialize;
use toml::Spanned;
use torno_part::{Limits, Nose, Place, Profile, Resolution};
use torno_protocol::lathe::Program;

use super::file::Board;
use super::kinds::axis::mm_per_count;
use super::names::Names;
use torno_engine::NodeId;
use torno_text::Complaint;

/// The part that a rig turns. (Ours: the lathe paper cuts nothing.)
#[derive(Clone, Debug)]
pub struct Part {
    /// The bar's diameter, in mm: 1 to 1000.
    pub diameter: f64,
    /// The bar's length, in mm: 1 to 2000.
    pub length: f64,
    /// How far the bar stands out of the chuck, in mm: 1 to its length.
    pub out: f64,
    /// The tool's nose.
    pub nose: Nose,
    /// What is allowed.
    pub limits: Limits,
    /// The axis along the bar: from the bar's face, away from the chuck.
    pub z: Axis,
    /// The axis across it: from the bar's surface, away from its middle.
    pub x: Axis,
    /// The spindle's speed, in rpm.
    pub spindle: Source,
}

/// An axis of the tool.
#[derive(Clone, Debug)]
pub struct Axis {
    /// How far it has gone since the start, in mm.
    pub way: Source,
    /// Where the tool stands at the start, in mm.
    pub start: f64,
}

/// Where a number comes from: the sum of some of a board's quantities, scaled.
#[derive(Clone, Debug)]
pub struct Source {
    /// The board.
    pub node: NodeId,
    /// The quantities' numbers.
    pub signals: Vec<u8>,
    /// What one count is worth; below 0, if the board counts the other way.
    pub per_count: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawPart {
    diameter_mm: Spanned<f64>,
    length_mm: Spanned<f64>,
    out_mm: Spanned<f64>,
    nose: Spanned<RawNose>,
    rapid_mm_per_s: Spanned<f64>,
    deepest_mm: Option<Spanned<f64>>,
    chuck_mm: Option<Spanned<f64>>,
    z: RawAxis,
    x: RawAxis,
    spindle: RawSpindle,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawNose {
    radius_mm: f64,
    lead_deg: f64,
    trail_deg: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawAxis {
    board: Spanned<String>,
    quantities: Spanned<Vec<Spanned<String>>>,
    mm_per_count: Option<Spanned<f64>>,
    start_mm: Spanned<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawSpindle {
    board: Spanned<String>,
    quantities: Spanned<Vec<Spanned<String>>>,
    rpm_per_count: Spanned<f64>,
}

/// What the board's own screw and encoder make of a count of these quantities, if they all count its carriage.
fn by_the_board(board: &Board, quantities: &[Spanned<String>]) -> Option<f64> {
    let worth = |name: &Spanned<String>| mm_per_count(&board.kind, &board.settings, name.get_ref()).ok().flatten();
    let first = worth(quantities.first()?)?;
    quantities.iter().all(|name| worth(name) == Some(first)).then_some(first)
}

impl RawPart {
    /// The part, on a rig with these names and boards.
    pub(super) fn check(&self, names: &Names, boards: &[Board]) -> Result<Part, Complaint> {
        let within = |name: &str, value: &Spanned<f64>, least: f64, most: f64| {
            let found = *value.get_ref();
            let fits = (least..=most).contains(&found);
            let complaint = || (value.span(), format!("{name} = {found}: expected {least} to {most}"));
            fits.then_some(found).ok_or_else(complaint)
        };
        let source = |board: &Spanned<String>,
                      quantities: &Spanned<Vec<Spanned<String>>>,
                      scale: (&str, Option<&Spanned<f64>>)| {
            let node = names.board(board)?;
            let signals =
                quantities.get_ref().iter().map(|name| names.signal(node, name)).collect::<Result<Vec<_>, _>>()?;
            if signals.is_empty() {
                return Err((quantities.span(), format!("expected quantities of '{}', found none", board.get_ref())));
            }
            let per_count = match scale {
                (name, Some(worth)) => {
                    let per_count = within(name, worth, -1_000.0, 1_000.0)?;
                    if per_count == 0.0 {
                        return Err((worth.span(), format!("{name} = 0: expected what one count is worth")));
                    }
                    per_count
                }
                (name, None) => by_the_board(&boards[node], quantities.get_ref())
                    .ok_or_else(|| (quantities.span(), format!("no board counts a carriage so: expected {name}")))?,
            };
            Ok(Source { node, signals, per_count })
        };
        let axis = |raw: &RawAxis| {
            let way = source(&raw.board, &raw.quantities, ("mm_per_count", raw.mm_per_count.as_ref()))?;
            Ok::<_, Complaint>(Axis { way, start: within("start_mm", &raw.start_mm, -2_000.0, 2_000.0)? })
        };
        let length = within("length_mm", &self.length_mm, 1.0, 2_000.0)?;
        let RawNose { radius_mm, lead_deg, trail_deg } = *self.nose.get_ref();
        let depth = self.deepest_mm.as_ref().map(|depth| within("deepest_mm", depth, 0.001, 1_000.0)).transpose()?;
        let chuck = self.chuck_mm.as_ref().map(|chuck| within("chuck_mm", chuck, 1.0, 2_000.0)).transpose()?;
        Ok(Part {
            diameter: within("diameter_mm", &self.diameter_mm, 1.0, 1_000.0)?,
            length,
            out: within("out_mm", &self.out_mm, 1.0, length)?,
            nose: Nose::new(radius_mm, lead_deg, trail_deg).map_err(|message| (self.nose.span(), message))?,
            limits: Limits {
                feed: within("rapid_mm_per_s", &self.rapid_mm_per_s, 0.001, 1_000.0)?,
                depth,
                chuck: chuck.map(|diameter| diameter / 2.0),
            },
            z: axis(&self.z)?,
            x: axis(&self.x)?,
            spindle: source(
                &self.spindle.board,
                &self.spindle.quantities,
                ("rpm_per_count", Some(&self.spindle.rpm_per_count)),
            )?,
        })
    }
}

impl Part {
    /// The bar as it stands out of the chuck, uncut.
    pub fn bar(&self) -> Profile {
        Profile::bar(self.diameter, self.out)
    }

    /// Where the tool is when the axes have gone so many counts from the start.
    pub fn place(&self, z: i64, x: i64) -> Place {
        Place {
            z: self.z.start + self.z.way.per_count * z as f64,
            x: self.diameter / 2.0 + self.x.start + self.x.way.per_count * x as f64,
        }
    }

    /// What a count is worth.
    pub const fn resolution(&self) -> Resolution {
        Resolution { z: self.z.way.per_count.abs(), x: self.x.way.per_count.abs() }
    }

    /// The part that a program asks for: the tool goes straight from where each frame begins to where it asks it to be.
    pub fn asked(&self, program: &Program) -> Profile {
        let mut profile = self.bar();
        let mut from = self.place(0, 0);
        for destination in program.destinations() {
            let to = self.place(destination.transverse, destination.depth);
            profile.cut(&self.nose, from, to);
            from = to;
        }
        profile
    }
}

#[cfg(test)]
mod tests {
    use crate::rig::file::RigFile;

    const LATHE: &str = include_str!("../../builtin/lathe.toml");

    fn with(from: &str, to: &str) -> String {
        assert!(LATHE.contains(from), "{from}");
        let text = LATHE.replacen(from, to, 1);
        RigFile::parse("my.toml", &text).map(|_| "fine".to_owned()).unwrap_or_else(|error| error.to_string())
    }

    #[test]
    fn a_rig_need_not_turn_a_part() {
        let text = LATHE.split("[part]").next().unwrap();
        assert!(RigFile::parse("my.toml", text).unwrap().part.is_none());
        assert!(RigFile::load("lathe").unwrap().part.is_some());
    }

    #[test]
    fn complaints_say_where_and_what_was_expected() {
        for (from, to, expected) in [
            ("diameter_mm = 28", "diameter_mm = 0", "diameter_mm = 0: expected 1 to 1000"),
            ("out_mm = 60", "out_mm = 81", "out_mm = 81: expected 1 to 80"),
            ("lead_deg = 90", "lead_deg = 91", "lead_deg = 91: expected 1 to 90"),
            ("lead_deg = 90", "leed_deg = 90", "unknown field `leed_deg`"),
            ("rapid_mm_per_s = 10", "rapid_mm_per_s = nan", "rapid_mm_per_s = NaN: expected 0.001 to 1000"),
            (
                "[part.x]\nboard = \"depth\"",
                "[part.x]\nboard = \"dept\"",
                "there is no board 'dept': did you mean 'depth'?",
            ),
            (
                "\"speed_rpm\"",
                "\"speed_rpn\"",
                "there is no quantity of 'spindle' 'speed_rpn': did you mean 'speed_rpm'?",
            ),
            ("[\"speed_rpm\"]", "[]", "expected quantities of 'spindle', found none"),
            ("rpm_per_count = 1", "rpm_per_count = 0", "rpm_per_count = 0: expected what one count is worth"),
        ] {
            let line = LATHE[..LATHE.find(from).unwrap()].matches('\n').count() + from.matches('\n').count() + 1;
            let found = with(from, to);
            assert!(found.starts_with(&format!("my.toml:{line}:")) && found.contains(expected), "{found}\n{expected}");
        }
    }
}
