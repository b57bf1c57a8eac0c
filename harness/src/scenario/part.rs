//! What a scenario expects of the part that is turned in it. The part is cut when all is done, and only if something is
//! expected of it.

use std::fmt;
use std::ops::Range;

use serde::Deserialize;
use toml::Spanned;
use torno_part::{Profile, Violation, deviation, is_within};
use torno_protocol::lathe::Program;

use crate::rig::file::RigFile;
use torno_machines::workpiece::Part;
use torno_machines::workpiece::Turned;
use torno_text::{Complaint, nearest, parse_length};

/// What is expected of a part.
#[derive(Clone, Debug)]
pub struct PartExpected {
    /// What the rig turns.
    pub part: Part,
    /// Diameters that it must have at the end.
    pub diameters: Vec<Diameter>,
    /// What must not happen on the way.
    pub never: Vec<Violation>,
}

/// A diameter of a part at a place: of its bore, if the tool cuts that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Diameter {
    /// Where: in mm from the face, which is 0; below 0 towards the chuck.
    pub z: f64,
    /// The diameter, in mm.
    pub diameter: f64,
    /// How far from that it may be, in mm.
    pub within: f64,
}

/// A part as it was asked for, by all frames up to a step.
#[derive(Clone, Debug)]
pub struct AsAsked {
    /// What was asked for.
    pub asked: Profile,
    /// How far from that a diameter may be, in mm.
    pub within: f64,
}

/// A diameter as a file says it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawDiameter {
    z: Spanned<String>,
    diameter: Spanned<String>,
    within: Spanned<String>,
}

/// What is expected of the part, if something is: at the end, on the way, or by steps that have been checked.
pub(super) fn check(
    file: &RigFile,
    diameters: &[RawDiameter],
    never: &[&Spanned<String>],
    checked: bool,
) -> Result<Option<PartExpected>, Complaint> {
    let place = diameters.iter().map(|diameter| diameter.z.span()).chain(never.iter().map(|event| event.span())).next();
    if place.is_none() && !checked {
        return Ok(None);
    }
    let part = part_of(file, place.unwrap_or(0..0))?.clone();
    let diameters = diameters.iter().map(|diameter| diameter.check(&part)).collect::<Result<_, _>>()?;
    let never = never.iter().map(|name| event(name, &part)).collect::<Result<_, _>>()?;
    Ok(Some(PartExpected { part, diameters, never }))
}

fn part_of(file: &RigFile, place: Range<usize>) -> Result<&Part, Complaint> {
    let complaint = || (place, format!("the rig '{}' turns no part: expected a [part] in its file", file.name));
    file.part.as_ref().ok_or_else(complaint)
}

/// The part that these frames ask for, and how far from it the one that is turned may be.
pub(super) fn as_asked(file: &RigFile, frames: &[u8], within: &Spanned<String>) -> Result<AsAsked, Complaint> {
    let part = part_of(file, within.span())?;
    if file.pc.dialect.name() != Program::DIALECT {
        let message = format!("the rig '{}' has no frames that ask for a part: expected a diameter", file.name);
        return Err((within.span(), message));
    }
    let within = length(within, 0.0, part.diameter)?;
    Ok(AsAsked { asked: part.asked(&Program { frames: frames.as_chunks().0.to_vec() }), within })
}

/// A length between bounds, in mm.
fn length(text: &Spanned<String>, least: f64, most: f64) -> Result<f64, Complaint> {
    let found = parse_length(text.get_ref()).map_err(|message| (text.span(), message))?;
    let message = || format!("'{}': expected {least} mm to {most} mm", text.get_ref());
    if (least..=most).contains(&found) { Ok(found) } else { Err((text.span(), message())) }
}

impl AsAsked {
    /// What contradicts it.
    pub fn contradicted(&self, turned: &Turned) -> Option<String> {
        let worst = deviation(&turned.profile, &self.asked);
        (!is_within(worst.diameter, self.within)).then(|| worst.to_string())
    }
}

impl fmt::Display for AsAsked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the part as asked within {} mm", self.within)
    }
}

fn event(name: &Spanned<String>, part: &Part) -> Result<Violation, Complaint> {
    let known = Violation::ALL.map(Violation::name);
    let event = Violation::ALL.into_iter().find(|event| event.name() == name.get_ref()).ok_or_else(|| {
        let message = format!("there is no event '{}' of a part{}", name.get_ref(), nearest(name.get_ref(), &known));
        (name.span(), message)
    })?;
    if event == Violation::Deep && part.limits.depth.is_none() {
        return Err((name.span(), "on this rig no cut is too deep: expected deepest_mm in its [part]".to_owned()));
    }
    if event == Violation::Wall && part.bore == 0.0 {
        return Err((name.span(), "on this rig no wall is cut through: expected bore_mm in its [part]".to_owned()));
    }
    Ok(event)
}

impl RawDiameter {
    fn check(&self, part: &Part) -> Result<Diameter, Complaint> {
        Ok(Diameter {
            z: length(&self.z, -part.out, 0.0)?,
            diameter: length(&self.diameter, 0.0, part.diameter)?,
            within: length(&self.within, 0.0, part.diameter)?,
        })
    }
}

impl Diameter {
    /// What contradicts it.
    pub fn contradicted(&self, turned: &Turned) -> Option<String> {
        let found = turned.profile.diameter(self.z).unwrap_or_default();
        (!is_within(found - self.diameter, self.within)).then(|| format!("{found:.3} mm"))
    }
}

impl fmt::Display for Diameter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "diameter at z = {} mm is {} mm within {} mm", self.z, self.diameter, self.within)
    }
}
