//! Lines of cells: what separates them, what is quoted, and where each of them stands.

use std::ops::Range;

use csv_core::{ReadFieldResult, Reader, ReaderBuilder};
use torno_text::Complaint;

/// What may separate cells; of those that make as many cells of the first line, the first.
const SEPARATORS: [u8; 3] = [b'\t', b';', b','];

/// A cell: what it says, without quotes and space around it, and where.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Cell {
    pub(super) text: String,
    pub(super) span: Range<usize>,
}

/// A file's cells.
pub(super) struct Table {
    /// What separates cells.
    pub(super) separator: u8,
    /// The first line's.
    pub(super) head: Vec<Cell>,
    /// Those of each line that says something, as many as in the first.
    pub(super) rows: Vec<Vec<Cell>>,
}

impl Table {
    /// The cells of a text. A line `sep=;` before all others says what separates them, as spreadsheets write it. Lines
    /// that are empty or begin with `#` are passed over.
    pub(super) fn read(text: &str) -> Result<Self, Complaint> {
        let mut start = 0;
        let mut lines = text.split_inclusive('\n').filter_map(|line| {
            let line = (start, line.trim_end_matches('\n'));
            start += line.1.len() + 1;
            (!line.1.trim().is_empty() && !line.1.trim_start().starts_with('#')).then_some(line)
        });
        let mut next = lines.next();
        let said = next.and_then(|(_, line)| separator_of(line));
        if said.is_some() {
            next = lines.next();
        }
        let Some((start, line)) = next else {
            return Err((0..0, "expected a line with the columns' names: time_s,input,counts".to_owned()));
        };
        let separator = match said {
            Some(separator) => separator,
            None => likeliest(line, start)?,
        };
        let head = split(line, start, separator)?;
        let mut rows = Vec::new();
        for (start, line) in lines {
            let cells = split(line, start, separator)?;
            if cells.iter().all(|cell| cell.text.is_empty()) {
                continue;
            }
            if cells.len() != head.len() {
                let place = cells.get(head.len()).map_or(start..start + line.len(), |cell| cell.span.clone());
                return Err((place, format!("expected {} values, found {}", head.len(), cells.len())));
            }
            rows.push(cells);
        }
        Ok(Self { separator, head, rows })
    }
}

/// What a line `sep=;` says.
fn separator_of(line: &str) -> Option<u8> {
    let said = line.trim_matches(|c: char| c == '"' || c == ' ');
    let separator = said.get(..4).filter(|word| word.eq_ignore_ascii_case("sep=")).map(|_| &said[4..])?;
    match separator.as_bytes() {
        // Spreadsheets write a tab as it is, people write `\t`.
        [] | [b'\\', b't'] => Some(b'\t'),
        [separator] => Some(*separator),
        _ => None,
    }
}

/// The separator that makes most cells of a line.
fn likeliest(line: &str, start: usize) -> Result<u8, Complaint> {
    let mut best = (0, b',');
    for separator in SEPARATORS {
        let cells = split(line, start, separator)?.len();
        if cells > best.0 {
            best = (cells, separator);
        }
    }
    Ok(if best.0 > 1 { best.1 } else { b',' })
}

/// The cells of a line that begins at `start`.
fn split(line: &str, start: usize, separator: u8) -> Result<Vec<Cell>, Complaint> {
    let mut reader: Reader = ReaderBuilder::new().delimiter(separator).build();
    let (mut from, mut at, mut written) = (0, 0, 0);
    let mut text = vec![0; line.len() + 1];
    let mut cells = Vec::new();
    loop {
        let (result, read, wrote) = reader.read_field(&line.as_bytes()[at..], &mut text[written..]);
        (at, written) = (at + read, written + wrote);
        match result {
            // What is left of the line is told with nothing more to read.
            ReadFieldResult::InputEmpty => {}
            ReadFieldResult::OutputFull => text.push(0),
            ReadFieldResult::Field { record_end } => {
                let to = if record_end { line.len() } else { at - 1 };
                let source = &line[from..to];
                let place = start + from..start + to;
                if !source.matches('"').count().is_multiple_of(2) {
                    return Err((place, format!("expected a quote at the end of {}", source.trim())));
                }
                let inner = String::from_utf8_lossy(&text[..written]).into_owned();
                let before = source.len() - source.trim_start().len();
                let place = if source.trim().is_empty() {
                    place
                } else {
                    start + from + before..start + from + before + source.trim().len()
                };
                cells.push(Cell { text: bare(&inner).to_owned(), span: place });
                if record_end {
                    return Ok(cells);
                }
                (from, written) = (at, 0);
            }
            ReadFieldResult::End => return Ok(cells),
        }
    }
}

/// Without space, and the quotes that stand behind space.
fn bare(cell: &str) -> &str {
    let cell = cell.trim();
    cell.strip_prefix('"').and_then(|cell| cell.strip_suffix('"')).unwrap_or(cell).trim()
}
