//! Numbers as spreadsheets write them: the decimal mark is a point or a comma, and the other may part thousands.
//!
//! `1.234` is 1.234 or 1234. Other numbers of the column tell which, or else those of other columns; where nothing
//! does, the column is refused.

use torno_text::Complaint;

use super::table::Cell;

/// What else may part thousands: space in three widths, and apostrophes.
const PARTING: [char; 5] = [' ', '\u{a0}', '\u{202f}', '\'', '’'];

/// What a number says of the marks in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Marks {
    /// There are none.
    None,
    /// This is the decimal mark.
    Decimal(char),
    /// This is the decimal mark, or else it parts thousands.
    Unclear(char),
}

/// The decimal mark of each of the columns, whose cells are `columns`. `commas` separate cells.
pub(super) fn decimal_marks(columns: &[Vec<&Cell>], commas: bool) -> Result<Vec<char>, Complaint> {
    let found: Vec<Option<char>> = columns.iter().map(|cells| proved(cells)).collect::<Result<_, _>>()?;
    let elsewhere = |mark: char| found.contains(&Some(mark));
    let decide = |(cells, found): (&Vec<&Cell>, &Option<char>)| {
        if let Some(mark) = found {
            return Ok(*mark);
        }
        let unclear = cells.iter().find_map(|cell| match marks(&cell.text) {
            Some(Marks::Unclear(mark)) => Some((cell, mark)),
            _ => None,
        });
        let Some((cell, mark)) = unclear else { return Ok('.') };
        let all = cells.iter().all(|cell| marks(&cell.text) == Some(Marks::Unclear(mark)));
        // Every number with three decimals is written by a program; every number above 1000 is by chance.
        let clear = match (elsewhere(mark), elsewhere(other(mark))) {
            (true, false) => true,
            (false, true) => false,
            _ => all || (mark == '.' && commas),
        };
        if clear { Ok(mark) } else { Err((cell.span.clone(), unclear_number(&cell.text, mark))) }
    };
    columns.iter().zip(&found).map(decide).collect()
}

/// The number of a cell in a column with this decimal mark.
pub(super) fn value(text: &str, decimal: char) -> Option<f64> {
    marks(text)?;
    let kept = text.chars().filter(|c| *c != other(decimal) && !PARTING.contains(c));
    let number: String = kept.map(|c| if c == decimal { '.' } else { c }).collect();
    number.parse().ok().filter(|number: &f64| number.is_finite())
}

const fn other(mark: char) -> char {
    if mark == '.' { ',' } else { '.' }
}

fn unclear_number(text: &str, mark: char) -> String {
    let whole: String = text.chars().filter(|c| *c != mark).collect();
    format!("'{text}' is {} or {whole}: expected numbers without marks between thousands", text.replace(mark, "."))
}

/// The decimal mark that the cells of one column prove.
fn proved(cells: &[&Cell]) -> Result<Option<char>, Complaint> {
    let mut first: Option<(char, &Cell)> = None;
    for cell in cells {
        let Some(Marks::Decimal(mark)) = marks(&cell.text) else { continue };
        match first {
            Some((before, found)) if before != mark => {
                let message =
                    format!("'{}' has the decimal mark '{mark}', '{}' before has '{before}'", cell.text, found.text);
                return Err((cell.span.clone(), format!("{message}: expected one of them in a column")));
            }
            _ => first = first.or(Some((mark, cell))),
        }
    }
    Ok(first.map(|(mark, _)| mark))
}

/// None if it is no number.
fn marks(text: &str) -> Option<Marks> {
    let unsigned = text.strip_prefix(['-', '+', '−']).unwrap_or(text);
    let (number, power) =
        unsigned.split_once(['e', 'E']).map_or((unsigned, None), |(number, power)| (number, Some(power)));
    if power.is_some_and(|power| power.parse::<i32>().is_err()) || !number.contains(|c: char| c.is_ascii_digit()) {
        return None;
    }
    let of = |mark: char| number.matches(mark).count();
    let parted = number.contains(PARTING);
    match (of('.'), of(',')) {
        (0, 0) => whole(number, &PARTING).then_some(Marks::None),
        (0, count) | (count, 0) => {
            let mark = if of('.') > 0 { '.' } else { ',' };
            if count > 1 {
                return whole(number, &[mark]).then_some(Marks::Decimal(other(mark)));
            }
            let (before, after) = number.split_once(mark)?;
            if !(before.is_empty() || whole(before, &PARTING)) || !after.chars().all(|c| c.is_ascii_digit()) {
                return None;
            }
            let thousands = (1..=3).contains(&before.len()) && !before.starts_with('0') && after.len() == 3;
            let unclear = thousands && !parted && power.is_none();
            Some(if unclear { Marks::Unclear(mark) } else { Marks::Decimal(mark) })
        }
        _ => {
            let (before, after) = number.rsplit_once(['.', ','])?;
            let decimal = number[before.len()..].chars().next()?;
            let is = whole(before, &[other(decimal)]) && after.chars().all(|c| c.is_ascii_digit());
            is.then_some(Marks::Decimal(decimal))
        }
    }
}

/// Digits, or digits in threes with one of `parting` between them.
fn whole(number: &str, parting: &[char]) -> bool {
    let Some(mark) = number.chars().find(|c| parting.contains(c)) else {
        return !number.is_empty() && number.chars().all(|c| c.is_ascii_digit());
    };
    number.split(mark).enumerate().all(|(place, group)| {
        let length = if place == 0 { (1..=3).contains(&group.len()) } else { group.len() == 3 };
        length && group.chars().all(|c| c.is_ascii_digit())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_number_says_of_its_marks() {
        for (text, expected) in [
            ("12", Some(Marks::None)),
            ("-0.5", Some(Marks::Decimal('.'))),
            ("0,123", Some(Marks::Decimal(','))),
            ("1.234", Some(Marks::Unclear('.'))),
            ("1,234e3", Some(Marks::Decimal(','))),
            ("1234.567", Some(Marks::Decimal('.'))),
            ("1.234,5", Some(Marks::Decimal(','))),
            ("1,234,567", Some(Marks::Decimal('.'))),
            ("1 234,567", Some(Marks::Decimal(','))),
            ("1'234'567", Some(Marks::None)),
            (".5", Some(Marks::Decimal('.'))),
            ("5.", Some(Marks::Decimal('.'))),
            ("1.2.3", None),
            ("12,34.5", None),
            ("1 23", None),
            ("nan", None),
            ("inf", None),
            ("1e", None),
            ("", None),
            (".", None),
        ] {
            assert_eq!(marks(text), expected, "{text}");
        }
        assert_eq!(value("-1.234,5", ','), Some(-1_234.5));
        assert_eq!(value("1 234.5e-1", '.'), Some(123.45));
    }
}
