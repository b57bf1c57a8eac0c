//! What somebody else has measured: values separated by commas, or else by semicolons or tabs.
//!
//! The first line names the columns, in any order: `time_s` (or another unit); `input`; and one of `counts` (of the
//! encoder since the row before), `position` (of the encoder, counted on, or in the unit that is named) or `speed` (at
//! that time). An input holds from its row to the next. What cannot be read in one way only is refused, and so are
//! readings that no motor can have made.

mod columns;
mod number;
mod readings;
mod table;
#[cfg(test)]
mod tests;

use core::f64::consts::TAU;
use std::path::Path;

use torno_identify::{Data, Finding, Sample, Sensor, nls, wheel};

use self::columns::{Columns, Output};
use self::number::decimal_marks;
use self::readings::Readings;
use self::table::{Cell, Table};
use super::Units;
use crate::text_file::TextError;
use torno_text::{Complaint, Invalid};

/// A multiple is one within this share of what it is a multiple of.
const MULTIPLE: f64 = 0.02;
/// The least that a position moves by may be so many steps.
const PARTS: u32 = 12;
/// Fewer moves are multiples of a step by chance.
const ENOUGH: usize = 20;
/// A smaller step, as a share of the largest position, is the last digit that was written.
const FINE: f64 = 1e-7;

/// Why a file gives no data.
#[derive(Debug, thiserror::Error)]
pub enum CsvError {
    /// It cannot be read.
    #[error("cannot read '{path}'")]
    Unreadable {
        /// The file.
        path: String,
        /// Why.
        source: TextError,
    },
    /// It is not what it should be.
    #[error(transparent)]
    Invalid(#[from] Invalid),
    /// The data are of no use.
    #[error("{path}: {finding}")]
    Useless {
        /// The file.
        path: String,
        /// Why.
        finding: Finding,
    },
}

/// What somebody knows of the encoder.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Encoder {
    /// Its counts in a revolution: they are turned into rad.
    pub counts_per_rev: Option<f64>,
    /// How many bits its counter has, which wraps.
    pub bits: Option<u32>,
}

/// A file's data.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// Input and speed.
    pub data: Data,
    /// Their units.
    pub units: Units,
    /// The output is the position of an axis.
    pub axis: bool,
    /// What was taken for granted, or out of the data.
    pub notes: Vec<String>,
}

/// Reads a file.
///
/// # Errors
/// [`CsvError`]: where, what was expected, what was found.
pub fn read(path: &Path, encoder: &Encoder) -> Result<Measured, CsvError> {
    let name = path.display().to_string();
    let text = crate::text_file::read(path).map_err(|source| CsvError::Unreadable { path: name.clone(), source })?;
    parse(&name, &text, encoder)
}

/// Reads a file's text. `path` is for the messages.
///
/// # Errors
/// As there.
pub fn parse(path: &str, text: &str, encoder: &Encoder) -> Result<Measured, CsvError> {
    // Some programs end lines with a carriage return alone.
    let text = text.replace("\r\n", "\n").replace('\r', "\n");
    let invalid = |(span, message): Complaint| CsvError::Invalid(Invalid::at(path, &text, span, message));
    let table = Table::read(&text).map_err(invalid)?;
    let columns = Columns::find(&table.head).map_err(invalid)?;
    columns.check(&table.head, encoder.counts_per_rev.is_some(), encoder.bits.is_some()).map_err(invalid)?;
    let mut rows = numbers(&table, &columns).map_err(invalid)?;
    let wrong = |(row, message): (usize, String)| invalid((table.rows[row][columns.places[2]].span.clone(), message));
    if let Some(bits) = encoder.bits {
        readings::unwrap(&mut rows, columns.output, bits).map_err(wrong)?;
    }
    let count = if columns.output.is_counts() { 1.0 } else { smallest_step(&rows, columns.output) };
    if let Some(found) = (Readings { output: columns.output, rows: &rows, count }).check() {
        return Err(wrong(found));
    }
    measured(&columns, &rows, encoder.counts_per_rev, count)
        .map_err(|finding| CsvError::Useless { path: path.to_owned(), finding })
}

/// Time in s, input and output of each row.
fn numbers(table: &Table, columns: &Columns) -> Result<Vec<[f64; 3]>, Complaint> {
    let cells = columns.places.map(|place| table.rows.iter().map(|row| &row[place]).collect::<Vec<_>>());
    let marks = decimal_marks(&cells, table.separator == b',')?;
    let (unit, second) = columns.time;
    let mut rows: Vec<[f64; 3]> = Vec::new();
    let mut before = f64::MIN;
    for row in 0..table.rows.len() {
        let mut values = [0.0; 3];
        for ((value, cells), mark) in values.iter_mut().zip(&cells).zip(&marks) {
            let Cell { text, span } = cells[row];
            *value = number::value(text, *mark)
                .ok_or_else(|| (span.clone(), format!("expected a number, found '{text}'")))?;
        }
        if values[0] <= before {
            let message = format!("expected a time above {before} {unit}, found {} {unit}", values[0]);
            return Err((cells[0][row].span.clone(), message));
        }
        before = values[0];
        values[0] *= second;
        rows.push(values);
    }
    Ok(rows)
}

/// What a position moves by at least, if all that it moves by are multiples of it; otherwise 0.
fn smallest_step(rows: &[[f64; 3]], output: Output) -> f64 {
    if output != Output::Measured {
        return 0.0;
    }
    let mut moved: Vec<f64> = rows.windows(2).map(|pair| (pair[1][2] - pair[0][2]).abs()).collect();
    moved.retain(|moved| *moved > 0.0);
    moved.sort_by(f64::total_cmp);
    let largest = rows.iter().map(|row| row[2].abs()).fold(0.0, f64::max);
    let Some(least) = moved.first().filter(|least| moved.len() >= ENOUGH && **least > FINE * largest) else {
        return 0.0;
    };
    (1..=PARTS).find_map(|parts| step_of(&moved, least / f64::from(parts))).unwrap_or(0.0)
}

/// The step of which all are multiples, if it is near `step`: what many steps make tells it better than one.
fn step_of(moved: &[f64], step: f64) -> Option<f64> {
    let (mut sum, mut steps) = (0.0, 0.0);
    for moved in moved {
        let step = if steps > 0.0 { sum / steps } else { step };
        let times = libm::round(moved / step);
        if (moved / step - times).abs() > MULTIPLE {
            return None;
        }
        (sum, steps) = (sum + moved, steps + times);
    }
    Some(sum / steps)
}

/// The data of the rows; `count` is what the encoder moves by at least.
fn measured(
    columns: &Columns,
    rows: &[[f64; 3]],
    counts_per_rev: Option<f64>,
    count: f64,
) -> Result<Measured, Finding> {
    let scale = counts_per_rev.map_or(1.0, |counts| TAU / counts);
    let sample = |pair: &[[f64; 3]]| {
        let [[start, input, before], [time, _, now]] = [pair[0], pair[1]];
        let speed = match columns.output {
            Output::Counts => now * scale / (time - start),
            Output::Position | Output::Measured => (now - before) * scale / (time - start),
            Output::Speed => now,
        };
        Sample { time, input, speed }
    };
    let samples: Vec<Sample> = rows.windows(2).map(sample).collect();
    let sensor = if columns.output == Output::Speed { Sensor::Instant } else { Sensor::Mean };
    let start = rows.first().map_or(0.0, |row| row[0]);
    let mut lengths: Vec<f64> = rows.windows(2).map(|pair| pair[1][0] - pair[0][0]).collect();
    lengths.sort_by(f64::total_cmp);
    let quantum = lengths.get(lengths.len() / 2).map_or(0.0, |length| count * scale / length);
    let data = Data::new(sensor, start, samples, quantum)?;
    let mut data = if nls::begins_at_rest(&data) { data.from_rest() } else { data };
    let mut notes = Vec::new();
    if columns.assumed {
        notes.push("the time has no unit, and is taken for seconds".to_owned());
    }
    let revolution = counts_per_rev.map(|_| TAU).or(columns.revolution());
    if let Some((centred, off)) = revolution.and_then(|revolution| wheel::centred(&data, revolution)) {
        let off = match columns.output_unit.as_deref() {
            Some(unit) => format!("{off:.3} {unit}"),
            None => format!("{:.2} counts", off / scale),
        };
        notes.push(format!("the code wheel is off its centre: its error of up to {off} is taken out of the data"));
        data = centred;
    }
    let input = columns.input_unit.clone().unwrap_or_else(|| "input".to_owned());
    let unit = columns.output_unit.as_deref();
    let speed = match columns.output {
        Output::Speed => unit.unwrap_or("speed").to_owned(),
        Output::Measured => format!("{}/s", unit.unwrap_or_default()),
        _ if counts_per_rev.is_some() => "rad/s".to_owned(),
        _ => "counts/s".to_owned(),
    };
    let axis = matches!(columns.output, Output::Position | Output::Measured);
    Ok(Measured { data, units: Units { input, speed }, axis, notes })
}
