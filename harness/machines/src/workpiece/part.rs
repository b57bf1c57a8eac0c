//! The rig file's `[part]`: the bar, the nose, what is allowed, and which quantities of which boards move the tool.

use serde::Deserialize;
use toml::Spanned;
use torno_part::{Limits, Move, Nose, Path, Place, Profile, Resolution, Side};
use torno_protocol::board::Role;
use torno_protocol::lathe::Program;

use torno_bus::Names;
use torno_engine::NodeId;
use torno_slaves::Slide;
use torno_text::Complaint;

use crate::kinds::Carriage;

/// The part that a rig turns. (Ours: the lathe paper cuts nothing.)
#[derive(Clone, Debug)]
pub struct Part {
    /// The bar's diameter, in mm: 1 to 1000.
    pub diameter: f64,
    /// The bar's length, in mm: 1 to 2000.
    pub length: f64,
    /// How far the bar stands out of the chuck, in mm: 1 to its length.
    pub out: f64,
    /// The diameter of the bore all through the bar, in mm; 0 without one.
    pub bore: f64,
    /// The surface that the tool cuts.
    pub side: Side,
    /// The tool's nose.
    pub nose: Nose,
    /// What is allowed.
    pub limits: Limits,
    /// The axis along the bar: from the bar's face, away from the chuck.
    pub z: Axis,
    /// The axis across it: from the surface that the tool cuts, away from the bar's middle.
    pub x: Axis,
    /// The spindle's speed, in rpm.
    pub spindle: Source,
}

/// An axis of the tool.
#[derive(Clone, Debug)]
pub struct Axis {
    /// How far it has gone since the start, in mm.
    pub way: Source,
    /// What follows it between two counts, if they are far apart.
    pub follower: Option<Follower>,
    /// Where the tool stands at the start, in mm.
    pub start: f64,
}

/// What follows a slide between two of its counts.
#[derive(Clone, Debug)]
pub struct Follower {
    /// The quantity of the same board that says how the slide is driven.
    pub drive: u8,
    /// As at the start.
    pub slide: Slide,
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

/// The `[part]` table of a rig file, not checked yet.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawPart {
    diameter_mm: Spanned<f64>,
    length_mm: Spanned<f64>,
    out_mm: Spanned<f64>,
    bore_mm: Option<Spanned<f64>>,
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
    #[serde(default)]
    cuts: Cuts,
}

/// The surface that a nose cuts, as a file says it.
#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Cuts {
    #[default]
    Outside,
    Inside,
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

/// What moves with a motor of a board, by the board's own screw and encoder.
pub type Carriages<'a> = &'a dyn Fn(NodeId, u8) -> Option<Carriage>;

/// The motor of a board that these quantities count the carriage of, if they all count the same.
fn motor_of(names: &Names, node: NodeId, signals: &[u8]) -> Option<u8> {
    let motor = |signal: &u8| {
        let signal = names.descriptions[node].signals.get(usize::from(*signal))?;
        signal.motor.filter(|_| matches!(signal.role, Role::Position | Role::Offset))
    };
    let first = motor(signals.first()?)?;
    signals.iter().all(|signal| motor(signal) == Some(first)).then_some(first)
}

impl RawPart {
    /// The part, on a rig with these names.
    ///
    /// # Errors
    /// Where, and what was expected.
    pub fn check(&self, names: &Names, carriages: Carriages<'_>) -> Result<Part, Complaint> {
        let within = |name: &str, value: &Spanned<f64>, least: f64, most: f64| {
            let found = *value.get_ref();
            let fits = (least..=most).contains(&found);
            let complaint = || (value.span(), format!("{name} = {found}: expected {least} to {most}"));
            fits.then_some(found).ok_or_else(complaint)
        };
        let quantities = |board: &Spanned<String>, quantities: &Spanned<Vec<Spanned<String>>>| {
            let node = names.board(board)?;
            let signals =
                quantities.get_ref().iter().map(|name| names.signal(node, name)).collect::<Result<Vec<_>, _>>()?;
            if signals.is_empty() {
                return Err((quantities.span(), format!("expected quantities of '{}', found none", board.get_ref())));
            }
            Ok((node, signals))
        };
        let worth = |name: &str, value: &Spanned<f64>| {
            let per_count = within(name, value, -1_000.0, 1_000.0)?;
            if per_count == 0.0 {
                return Err((value.span(), format!("{name} = 0: expected what one count is worth")));
            }
            Ok(per_count)
        };
        let axis = |raw: &RawAxis| {
            let (node, signals) = quantities(&raw.board, &raw.quantities)?;
            let motor = motor_of(names, node, &signals);
            let carriage = motor.and_then(|motor| carriages(node, motor));
            let per_count = match (&raw.mm_per_count, &carriage) {
                (Some(value), _) => worth("mm_per_count", value)?,
                (None, Some(carriage)) => carriage.mm_per_count,
                (None, None) => {
                    let message = "no board counts a carriage so: expected mm_per_count";
                    return Err((raw.quantities.span(), message.to_owned()));
                }
            };
            let drive = motor.and_then(|motor| names.descriptions[node].signal(motor, Role::Drive, None));
            let slide = carriage.and_then(|carriage| carriage.slide);
            Ok(Axis {
                way: Source { node, signals, per_count },
                follower: drive.zip(slide).map(|(drive, slide)| Follower { drive, slide }),
                start: within("start_mm", &raw.start_mm, -2_000.0, 2_000.0)?,
            })
        };
        let (node, signals) = quantities(&self.spindle.board, &self.spindle.quantities)?;
        let spindle = Source { node, signals, per_count: worth("rpm_per_count", &self.spindle.rpm_per_count)? };
        let length = within("length_mm", &self.length_mm, 1.0, 2_000.0)?;
        let RawNose { radius_mm, lead_deg, trail_deg, cuts } = *self.nose.get_ref();
        let diameter = within("diameter_mm", &self.diameter_mm, 1.0, 1_000.0)?;
        let bore = self.bore_mm.as_ref().map_or(Ok(0.0), |bore| {
            let found = *bore.get_ref();
            let message = || format!("bore_mm = {found}: expected more than 0, and less than diameter_mm, {diameter}");
            if found > 0.0 && found < diameter { Ok(found) } else { Err((bore.span(), message())) }
        })?;
        let side = match cuts {
            Cuts::Outside => Side::Outside,
            Cuts::Inside if bore > 0.0 => Side::Inside,
            Cuts::Inside => {
                let message = "cuts = \"inside\": expected bore_mm, the diameter of the bore that it cuts, in [part]";
                return Err((self.nose.span(), message.to_owned()));
            }
        };
        let depth = self.deepest_mm.as_ref().map(|depth| within("deepest_mm", depth, 0.001, 1_000.0)).transpose()?;
        let chuck = self.chuck_mm.as_ref().map(|chuck| within("chuck_mm", chuck, 1.0, 2_000.0)).transpose()?;
        Ok(Part {
            diameter,
            length,
            out: within("out_mm", &self.out_mm, 1.0, length)?,
            bore,
            side,
            nose: Nose::new(radius_mm, lead_deg, trail_deg).map_err(|message| (self.nose.span(), message))?,
            limits: Limits {
                feed: within("rapid_mm_per_s", &self.rapid_mm_per_s, 0.001, 1_000.0)?,
                depth,
                chuck: chuck.map(|diameter| diameter / 2.0),
            },
            z: axis(&self.z)?,
            x: axis(&self.x)?,
            spindle,
        })
    }
}

impl Part {
    /// The bar as it stands out of the chuck, uncut.
    pub fn bar(&self) -> Profile {
        Profile::tube(self.side, self.diameter, self.bore, self.out)
    }

    /// Where the tool is when the axes have gone so many counts from the start, and stand in the middle of the last.
    pub fn place(&self, z: i64, x: i64) -> Place {
        self.between(z as f64, x as f64)
    }

    /// The same between two counts.
    pub fn between(&self, z: f64, x: f64) -> Place {
        Place {
            z: self.z.start + self.z.way.per_count * z,
            x: self.surface() / 2.0 + self.x.start + self.x.way.per_count * x,
        }
    }

    /// The diameter of the surface that the tool cuts, uncut, in mm.
    pub const fn surface(&self) -> f64 {
        match self.side {
            Side::Outside => self.diameter,
            Side::Inside => self.bore,
        }
    }

    /// The contour that a way of the tool asks for, exactly.
    pub fn contour(&self, path: &Path) -> Profile {
        let mut profile = self.bar();
        profile.sweep(&self.nose, path);
        profile
    }

    /// What a count is worth.
    pub const fn resolution(&self) -> Resolution {
        Resolution { z: self.z.way.per_count.abs(), x: self.x.way.per_count.abs() }
    }

    /// The part that a program asks for: the tool goes straight from where each frame begins to where it asks it to be.
    pub fn asked(&self, program: &Program) -> Profile {
        let places = program.destinations().into_iter().map(|to| self.place(to.transverse, to.depth));
        self.contour(&Path { start: self.place(0, 0), moves: places.map(Move::Line).collect() })
    }
}
