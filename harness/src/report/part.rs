//! What is told of the part that a run has turned.

use std::fmt;

use anstyle::{AnsiColor, Style};
use serde::Serialize;
use torno_part::{Cylinder, Deviation, GRID, Happening, Profile, SHOULDER, Side, cylinders, deviation, is_within};

use torno_machines::workpiece::Part;
use torno_machines::workpiece::Turned;

/// The part at the end of a program.
#[derive(Clone, Debug, Serialize)]
pub struct PartSummary {
    /// Shoulders are found within so many mm; diameters on a cylinder are exact.
    pub grid_mm: f64,
    /// The surface that is turned: `outside` or `inside`.
    pub side: &'static str,
    /// The cylinders that it has, from the face on.
    pub cylinders: Vec<Measure>,
    /// The cylinders that the program asked for; none, where nobody knows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub asked: Option<Vec<Measure>>,
    /// Where it is furthest from what was asked, if that is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub worst: Option<Worst>,
    /// What was required of it, if something was.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub required: Option<Required>,
    /// What should not have happened.
    pub events: Vec<EventSummary>,
}

/// What was required of a part: a verdict.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Required {
    /// No diameter may be further from what was asked, in mm.
    pub tolerance_mm: f64,
    /// None is.
    pub met: bool,
}

/// A cylinder.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Measure {
    /// Its diameter, in mm.
    pub diameter_mm: f64,
    /// Where it begins, in mm from the face, which is 0.
    pub from_mm: f64,
    /// Where it ends, towards the chuck, which is below 0.
    pub to_mm: f64,
    /// Its length, in mm.
    pub length_mm: f64,
    /// It is the bar, uncut.
    pub stock: bool,
}

/// The worst deviation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Worst {
    /// How much more is left than asked, in mm of diameter.
    pub diameter_mm: f64,
    /// Where.
    pub z_mm: f64,
    /// Of which surface.
    #[serde(skip)]
    pub side: Side,
}

/// Something that should not have happened.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct EventSummary {
    /// Its name: `stopped`, `rapid`, `chuck`, `deep`, `wall`.
    pub event: &'static str,
    /// When it began, in virtual seconds.
    pub from_s: f64,
    /// When it was last seen.
    pub until_s: f64,
    /// Where the tool was.
    pub z_mm: f64,
    /// The same, from the middle of the bar.
    pub x_mm: f64,
    /// The most of it: off the radius, feed, beyond the jaws, depth of the cut, beyond the wall.
    pub worst: f64,
    /// What it is, for people.
    #[serde(skip)]
    pub text: &'static str,
    /// What `worst` is counted in.
    pub unit: &'static str,
}

/// To a tenth of a micrometre: what lies below is noise of floating point.
fn mm(value: f64) -> f64 {
    let rounded = (value * 1e4).round() / 1e4;
    if rounded == 0.0 { 0.0 } else { rounded }
}

impl From<Cylinder> for Measure {
    fn from(cylinder: Cylinder) -> Self {
        Self {
            diameter_mm: mm(cylinder.diameter),
            from_mm: mm(cylinder.from),
            to_mm: mm(cylinder.to),
            length_mm: mm(cylinder.length()),
            stock: cylinder.stock,
        }
    }
}

impl From<&Happening> for EventSummary {
    fn from(happening: &Happening) -> Self {
        let Happening { event, at, place, worst } = happening;
        Self {
            event: event.name(),
            from_s: at.0,
            until_s: at.1,
            z_mm: mm(place.z),
            x_mm: mm(place.x),
            worst: mm(*worst),
            text: event.text(),
            unit: event.unit(),
        }
    }
}

/// The cylinders that were turned, from the face, in words: diameter and length of each.
pub(super) fn sizes(measures: &[Measure], by: &str) -> String {
    let turned = measures.iter().filter(|measure| !measure.stock);
    let size = |measure: &Measure| format!("{:.2} {by} {:.2}", measure.diameter_mm, measure.length_mm);
    let sizes: Vec<String> = turned.map(size).collect();
    // A cone, a face or a fillet is none.
    if sizes.is_empty() { "no cylinder".to_owned() } else { format!("{} mm", sizes.join(", ")) }
}

impl PartSummary {
    /// What is told of a part, beside what was asked for, if that is known, and within what tolerance.
    pub fn new(part: &Part, turned: &Turned, asked: Option<&Profile>, tolerance: Option<f64>) -> Self {
        // A fillet and what the edge leaves of it.
        let between = 2.0 * part.nose.radius_mm() + 2.0 * GRID;
        let measures = |profile| cylinders(profile, between).into_iter().map(Measure::from).collect();
        let worst = asked.map(|asked| deviation(&turned.profile, asked));
        let required = |worst: &Deviation| {
            tolerance.map(|tolerance_mm| Required { tolerance_mm, met: is_within(worst.diameter, tolerance_mm) })
        };
        Self {
            grid_mm: GRID,
            side: part.side.name(),
            cylinders: measures(&turned.profile),
            asked: asked.map(measures),
            required: worst.as_ref().and_then(required),
            worst: worst.map(|worst| Worst { diameter_mm: mm(worst.diameter), z_mm: mm(worst.z), side: worst.side }),
            events: turned.happenings.iter().map(EventSummary::from).collect(),
        }
    }

    /// Whether it is as it was required to be.
    pub fn is_as_required(&self) -> bool {
        self.required.is_none_or(|required| required.met)
    }

    /// Whether it is not what somebody wants: what was required is not met; or nothing was, and it is further from what
    /// was asked than a shoulder may be.
    pub(super) fn is_off(&self) -> bool {
        let far = || self.worst.is_some_and(|worst| !is_within(worst.diameter_mm, SHOULDER));
        self.required.map_or_else(far, |required| !required.met)
    }

    /// What is to be said of the worst deviation beyond itself.
    pub(super) fn verdict(&self) -> String {
        match self.required {
            Some(Required { tolerance_mm, met: true }) => format!("within the tolerance of {tolerance_mm} mm"),
            Some(Required { tolerance_mm, met: false }) => format!("NOT within the tolerance of {tolerance_mm} mm"),
            None if self.is_off() => format!("more than {SHOULDER} mm, but no tolerance was required"),
            None => String::new(),
        }
    }

    pub(super) fn write(&self, text: &mut fmt::Formatter<'_>, problem: Style) -> fmt::Result {
        let turned = sizes(&self.cylinders, "x");
        let done = if self.side == Side::Inside.name() { "bored " } else { "turned" };
        writeln!(text, "{:<9}{done} {turned} (diameter x length, from the face)", "part")?;
        if let Some(asked) = &self.asked {
            writeln!(text, "{:<9}asked  {}", "", sizes(asked, "x"))?;
        }
        let style = match self.required {
            _ if self.is_off() => problem,
            Some(_) => AnsiColor::Green.on_default().bold(),
            None => Style::new(),
        };
        let verdict = Some(self.verdict()).filter(|verdict| !verdict.is_empty());
        let verdict = verdict.map_or_else(String::new, |verdict| format!("; {verdict}"));
        if let Some(worst) = &self.worst {
            writeln!(text, "{:<9}{style}worst  {worst}{verdict}{style:#}", "")?;
        }
        for event in &self.events {
            let EventSummary { from_s, z_mm, worst, text: what, unit, .. } = event;
            writeln!(
                text,
                "{:<9}{problem}{what}{problem:#} at {from_s:.3} s, z = {z_mm:.2} mm: {worst:.2} {unit}",
                ""
            )?;
        }
        Ok(())
    }
}

impl fmt::Display for Worst {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Deviation { diameter: self.diameter_mm, z: self.z_mm, side: self.side }.fmt(f)
    }
}
