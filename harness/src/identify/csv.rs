//! What somebody else has measured: values separated by commas, or else by semicolons or tabs.
//!
//! The first line names the columns, in any order: `time_s`; `input`; and one of `counts` (of the encoder since the row
//! before), `position` (of the encoder, counted on) or `speed` (at that time). A unit may follow each name but the
//! first: `input_v`, `speed_rpm`. An input holds from its row to the next. Lines that are empty or begin with `#` are
//! passed over.

use std::path::Path;

use torno_identify::{Data, Finding, Sample, Sensor, nls};

use super::Units;
use crate::text_file::TextError;
use torno_text::{Invalid, nearest};

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

/// What the output column is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Output {
    Counts,
    Position,
    Speed,
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
}

/// Reads a file. With `counts_per_rev`, counts are turned into rad.
///
/// # Errors
/// [`CsvError`]: where, what was expected, what was found.
pub fn read(path: &Path, counts_per_rev: Option<f64>) -> Result<Measured, CsvError> {
    let name = path.display().to_string();
    let text = crate::text_file::read(path).map_err(|source| CsvError::Unreadable { path: name.clone(), source })?;
    parse(&name, &text, counts_per_rev)
}

/// Reads a file's text. `path` is for the messages.
///
/// # Errors
/// As there.
pub fn parse(path: &str, text: &str, counts_per_rev: Option<f64>) -> Result<Measured, CsvError> {
    let invalid = |place: &str, message: String| {
        let start = place.as_ptr() as usize - text.as_ptr() as usize;
        CsvError::Invalid(Invalid::at(path, text, start..start + place.len(), message))
    };
    // What some programs begin a file with says only that it is text.
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut lines = text.lines().filter(|line| !line.trim().is_empty() && !line.trim_start().starts_with('#'));
    let Some(head) = lines.next() else {
        return Err(invalid(&text[..0], "expected a line with the columns' names: time_s,input,counts".to_owned()));
    };
    let columns = Columns::find(head).map_err(|(place, message)| invalid(place, message))?;
    let mut rows: Vec<[f64; 3]> = Vec::new();
    for line in lines {
        let cells: Vec<&str> = line.split(columns.separator).collect();
        if cells.len() != columns.count {
            let message = format!("expected {} values, found {}", columns.count, cells.len());
            return Err(invalid(cells.get(columns.count).unwrap_or(&line), message));
        }
        let mut row = [0.0; 3];
        for (value, place) in row.iter_mut().zip(columns.places) {
            let cell = bare(cells[place]);
            // Where a comma does not separate values, it may separate decimals.
            let number = if columns.separator == ',' { cell.to_owned() } else { cell.replace(',', ".") };
            *value = number.parse().ok().filter(|number: &f64| number.is_finite()).ok_or_else(|| {
                invalid(if cell.is_empty() { cells[place] } else { cell }, format!("expected a number, found '{cell}'"))
            })?;
        }
        if let Some([before, ..]) = rows.last()
            && row[0] <= *before
        {
            let message = format!("expected a time above {before} s, found {} s", row[0]);
            return Err(invalid(cells[columns.places[0]].trim(), message));
        }
        rows.push(row);
    }
    columns.data(&rows, counts_per_rev).map_err(|finding| CsvError::Useless { path: path.to_owned(), finding })
}

/// Without space and quotes around it.
fn bare(cell: &str) -> &str {
    let cell = cell.trim();
    cell.strip_prefix('"').and_then(|cell| cell.strip_suffix('"')).unwrap_or(cell).trim()
}

struct Columns {
    /// What separates values.
    separator: char,
    /// Where time, input and output are.
    places: [usize; 3],
    count: usize,
    output: Output,
    input_unit: Option<String>,
    speed_unit: Option<String>,
}

/// A unit as it is written; the names of columns are in small letters.
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

impl Columns {
    fn find(head: &str) -> Result<Self, (&str, String)> {
        const KNOWN: [&str; 5] = ["time_s", "input", "counts", "position", "speed"];
        let mut places: [Option<usize>; 3] = [None; 3];
        let (mut output, mut input_unit, mut speed_unit) = (Output::Counts, None, None);
        let separator = [',', ';', '\t'].into_iter().find(|separator| head.contains(*separator)).unwrap_or(',');
        for (place, cell) in head.split(separator).enumerate() {
            let name = bare(cell);
            let (word, unit) = name.split_once('_').map_or((name, None), |(word, unit)| (word, Some(unit_of(unit))));
            let role = match word {
                "time" if unit.as_deref() == Some("s") => 0,
                "input" => {
                    input_unit = unit;
                    1
                }
                "counts" => 2,
                "position" => {
                    output = Output::Position;
                    2
                }
                "speed" => {
                    (output, speed_unit) = (Output::Speed, unit);
                    2
                }
                _ => return Err((cell, format!("unknown column '{name}'{}", nearest(name, &KNOWN)))),
            };
            if places[role].replace(place).is_some() {
                let what = ["time", "input", "output (counts, position or speed)"][role];
                return Err((cell, format!("expected one column with the {what}, found another, '{name}'")));
            }
        }
        let count = head.split(separator).count();
        match places {
            [Some(time), Some(input), Some(out)] => {
                Ok(Self { separator, places: [time, input, out], count, output, input_unit, speed_unit })
            }
            [time, input, _] => {
                let missing = match (time, input) {
                    (None, _) => "time_s",
                    (_, None) => "input",
                    _ => "counts, position or speed",
                };
                Err((head, format!("expected a column {missing}, found '{}'", head.trim())))
            }
        }
    }

    fn data(&self, rows: &[[f64; 3]], counts_per_rev: Option<f64>) -> Result<Measured, Finding> {
        let count = counts_per_rev.map_or(1.0, |counts| core::f64::consts::TAU / counts);
        let sample = |pair: &[[f64; 3]]| {
            let [[start, input, before], [time, _, now]] = [pair[0], pair[1]];
            let speed = match self.output {
                Output::Counts => now * count / (time - start),
                Output::Position => (now - before) * count / (time - start),
                Output::Speed => now,
            };
            Sample { time, input, speed }
        };
        let samples: Vec<Sample> = rows.windows(2).map(sample).collect();
        let counts = self.output != Output::Speed;
        let sensor = if counts { Sensor::Mean } else { Sensor::Instant };
        let start = rows.first().map_or(0.0, |row| row[0]);
        let mut lengths: Vec<f64> = rows.windows(2).map(|pair| pair[1][0] - pair[0][0]).collect();
        lengths.sort_by(f64::total_cmp);
        let quantum = lengths.get(lengths.len() / 2).filter(|_| counts).map_or(0.0, |length| count / length);
        let data = Data::new(sensor, start, samples, quantum)?;
        let data = if nls::begins_at_rest(&data) { data.from_rest() } else { data };
        let input = self.input_unit.clone().unwrap_or_else(|| "input".to_owned());
        let speed = match (&self.speed_unit, counts_per_rev) {
            (_, Some(_)) if counts => "rad/s".to_owned(),
            _ if counts => "counts/s".to_owned(),
            (unit, _) => unit.clone().unwrap_or_else(|| "speed".to_owned()),
        };
        Ok(Measured { data, units: Units { input, speed }, axis: self.output == Output::Position })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn complaint(text: &str) -> String {
        parse("my.csv", text, None).unwrap_err().to_string()
    }

    #[test]
    fn complaints_say_where_and_what_was_expected() {
        for (text, expected) in [
            ("", "my.csv:1:1: expected a line with the columns' names"),
            ("time_s,input\n", "my.csv:1:1: expected a column counts, position or speed, found 'time_s,input'"),
            ("time_s,inptu,counts\n", "my.csv:1:8: unknown column 'inptu': did you mean 'input'?"),
            ("time_ms,input,counts\n", "my.csv:1:1: unknown column 'time_ms': did you mean 'time_s'?"),
            ("time_s,counts,input,speed\n", "my.csv:1:21: expected one column with the output"),
            ("# log\ntime_s,input,counts\n0,0,0\n0.03,20,1.x\n", "my.csv:4:9: expected a number, found '1.x'"),
            ("time_s,input,counts\n0,0,0\n0.03,,1\n", "my.csv:3:6: expected a number, found ''"),
            ("time_s,input,counts\n0,0,nan\n", "my.csv:2:5: expected a number, found 'nan'"),
            ("time_s,input,counts\n0,0,0\n0.03,20\n", "my.csv:3:1: expected 3 values, found 2"),
            ("time_s,input,counts\n0,0,0\n0.03,20,1,7\n", "my.csv:3:11: expected 3 values, found 4"),
            (
                "time_s,input,counts\n0,0,0\n0.03,2,1\n0.03,2,1\n",
                "my.csv:4:1: expected a time above 0.03 s, found 0.03 s",
            ),
            (
                "time_s,input,counts\n0,0,0\n0.03,2,1\n",
                "my.csv: the data are too short: expected at least 20 samples, found 1",
            ),
        ] {
            let found = complaint(text);
            assert!(found.starts_with(expected), "{found}\nexpected {expected}");
        }
    }

    #[test]
    fn what_spreadsheets_write_is_read() {
        let row = |n: u32| format!("{:.2},5,{:.3}\n", 0.02 * f64::from(n), 100.0 * -libm::expm1(-0.04 * f64::from(n)));
        let rows: String = (0..150).map(row).collect();
        let expected = parse("my.csv", &format!("time_s,input_v,speed\n{rows}"), None).unwrap();
        let quoted = format!("\u{feff}\"time_s\",\"input_v\",\"speed\"\n{rows}");
        let semicolons = format!("time_s;input_v;speed\n{}", rows.replace(',', ";").replace('.', ","));
        let tabs = format!("time_s\tinput_v\tspeed\n{}", rows.replace(',', "\t"));
        for text in [quoted, semicolons, tabs] {
            assert_eq!(parse("my.csv", &text, None).unwrap(), expected, "{}", &text[..40]);
        }
        // The motor was at rest, although the first sample is 4 % of the last and the second 8 %.
        assert!(expected.data.starts_at_rest());
    }

    #[test]
    fn rows_that_are_missing_are_told_by_their_place() {
        let row = |n: u32| format!("{:.2},5,{}\n", 0.02 * f64::from(n), n * n / 40);
        let rows: String = (0..200).filter(|n| *n < 100 || n % 3 == 0).map(row).collect();
        let measured = parse("my.csv", &format!("time_s,input,position\n{rows}"), None).unwrap();
        assert!((measured.data.period() - 0.02).abs() < 1e-9);
        let finding = measured.data.even_period().unwrap_err().to_string();
        assert_eq!(finding, "the samples are not evenly spaced: expected 0.02 s, found 0.06 s up to sample 100");
    }

    #[test]
    fn counts_position_and_speed_are_the_same_motor() {
        let lag = |t: f64| 100.0 * (t - 0.5 * -libm::expm1(-t / 0.5));
        let mut texts =
            ["time_s,input_v,counts\n", "input_v,time_s,position\n", "time_s,input_v,speed_rpm\n"].map(str::to_owned);
        for n in 0..200 {
            let (t, before) = (0.05 * f64::from(n), 0.05 * f64::from(n - 1).max(0.0));
            texts[0] += &format!("{t},10,{}\n", lag(t) - lag(before));
            texts[1] += &format!("10, {t}, {}\r\n", lag(t));
            texts[2] += &format!("{t},10,{}\n", 100.0 * -libm::expm1(-t / 0.5));
        }
        let units = ["counts/s", "counts/s", "rpm"];
        for (text, unit) in texts.iter().zip(units) {
            let measured = parse("my.csv", text, None).unwrap();
            assert_eq!((measured.units.input.as_str(), measured.units.speed.as_str()), ("V", unit));
            let fitted = torno_identify::nls::first_order(&measured.data).unwrap();
            assert!((fitted.gain.value - 10.0).abs() < 1e-6 && (fitted.tau.value - 0.5).abs() < 1e-6, "{fitted:?}");
        }
    }
}
