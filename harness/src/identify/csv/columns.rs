//! What the columns hold, by their names: a word and a unit, as in `input_v`, `Speed [rpm]` or `time (ms)`.

use torno_text::{Complaint, nearest};

use super::table::Cell;

const KNOWN: [&str; 5] = ["time_s", "input", "counts", "position", "speed"];
/// Units of time, in s.
const TIMES: [(&str, f64); 7] =
    [("s", 1.0), ("sec", 1.0), ("ms", 1e-3), ("us", 1e-6), ("µs", 1e-6), ("ns", 1e-9), ("min", 60.0)];
/// Names that a count may have for a unit.
const COUNTS: [&str; 6] = ["counts", "count", "ticks", "pulses", "slots", "steps"];
/// Units of angle: what one revolution is in them.
const ANGLES: [(&str, f64); 5] =
    [("rad", core::f64::consts::TAU), ("deg", 360.0), ("°", 360.0), ("rev", 1.0), ("turns", 1.0)];

/// What the output column is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Output {
    /// What the encoder has counted since the row before.
    Counts,
    /// What it has counted in all.
    Position,
    /// A position in a unit of its own.
    Measured,
    /// The speed at that time.
    Speed,
}

impl Output {
    /// As it is called.
    pub(super) const fn word(self) -> &'static str {
        match self {
            Self::Counts => "count",
            Self::Position | Self::Measured => "position",
            Self::Speed => "speed",
        }
    }

    /// Whether it tells how fast the motor is, and not where.
    pub(super) const fn is_rate(self) -> bool {
        matches!(self, Self::Counts | Self::Speed)
    }

    /// Whether the encoder's counts are in it as they are.
    pub(super) const fn is_counts(self) -> bool {
        matches!(self, Self::Counts | Self::Position)
    }
}

/// Where time, input and output are, and in what units.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Columns {
    pub(super) places: [usize; 3],
    pub(super) output: Output,
    /// The unit of time, and what it is in s.
    pub(super) time: (&'static str, f64),
    /// The time column names no unit.
    pub(super) assumed: bool,
    pub(super) input_unit: Option<String>,
    /// Of a speed, or of a position that is measured.
    pub(super) output_unit: Option<String>,
}

/// A unit as it is written; the names of columns are often in small letters.
fn unit_of(name: &str) -> String {
    match name {
        "v" => "V",
        "mv" => "mV",
        "a" => "A",
        "ma" => "mA",
        unit => unit,
    }
    .to_owned()
}

/// A column's word, in small letters, and its unit.
fn parts(name: &str) -> (String, Option<String>) {
    let end = name.find(|c: char| !c.is_alphabetic()).unwrap_or(name.len());
    let (word, unit) = name.split_at(end);
    let unit = unit.trim_matches(|c: char| c.is_whitespace() || "_-:;,()[]".contains(c));
    (word.to_lowercase(), (!unit.is_empty()).then(|| unit_of(unit)))
}

impl Columns {
    pub(super) fn find(head: &[Cell]) -> Result<Self, Complaint> {
        let mut places: [Option<usize>; 3] = [None; 3];
        let (mut output, mut time, mut input_unit, mut output_unit) = (Output::Counts, None, None, None);
        for (place, cell) in head.iter().enumerate() {
            let name = &cell.text;
            let wrong = |message: String| Err((cell.span.clone(), message));
            let (word, unit) = parts(name);
            let role = match (word.as_str(), unit) {
                // Spreadsheets end each line with what separates cells.
                ("", None) if place + 1 == head.len() => continue,
                ("time" | "t", unit) => {
                    if let Some(unit) = unit {
                        let Some(known) = TIMES.iter().find(|(name, _)| *name == unit) else {
                            return wrong(format!("unknown unit of time '{unit}': expected s, ms, us, ns or min"));
                        };
                        time = Some(*known);
                    }
                    0
                }
                ("input", unit) => {
                    input_unit = unit;
                    1
                }
                ("counts", None) => 2,
                ("position", unit) => {
                    output_unit = unit.filter(|unit| !COUNTS.contains(&unit.as_str()));
                    output = if output_unit.is_some() { Output::Measured } else { Output::Position };
                    2
                }
                ("speed", unit) => {
                    (output, output_unit) = (Output::Speed, unit);
                    2
                }
                _ => return wrong(format!("unknown column '{name}'{}", nearest(name, &KNOWN))),
            };
            if places[role].replace(place).is_some() {
                let what = ["time", "input", "output (counts, position or speed)"][role];
                return wrong(format!("expected one column with the {what}, found another, '{name}'"));
            }
        }
        match places {
            [Some(at), Some(input), Some(out)] => Ok(Self {
                places: [at, input, out],
                output,
                time: time.unwrap_or(TIMES[0]),
                assumed: time.is_none(),
                input_unit,
                output_unit,
            }),
            [time, input, _] => {
                let missing = match (time, input) {
                    (None, _) => "time_s",
                    (_, None) => "input",
                    _ => "counts, position or speed",
                };
                let names: Vec<&str> = head.iter().map(|cell| cell.text.as_str()).collect();
                let span = head.first().map_or(0..0, |cell| cell.span.clone());
                Err((span, format!("expected a column {missing}, found '{}'", names.join(","))))
            }
        }
    }

    /// Whether what is known of the encoder can be used on these columns.
    pub(super) fn check(&self, head: &[Cell], per_rev: bool, bits: bool) -> Result<(), Complaint> {
        let cell = &head[self.places[2]];
        let useless = [("--counts-per-rev", per_rev), ("--unwrap", bits)];
        match useless.into_iter().find(|(_, given)| *given && !self.output.is_counts()) {
            Some((option, _)) => {
                let expected = "expected a column counts or position in counts";
                Err((cell.span.clone(), format!("{option} has no effect on '{}': {expected}", cell.text)))
            }
            None => Ok(()),
        }
    }

    /// What a revolution is in the output's unit, if that is an angle.
    pub(super) fn revolution(&self) -> Option<f64> {
        let unit = self.output_unit.as_deref().filter(|_| self.output == Output::Measured)?;
        ANGLES.iter().find(|(name, _)| *name == unit).map(|(_, revolution)| *revolution)
    }
}
