//! The colours of a plot, and how they are said.

use plotters::style::RGBColor;
use torno_text::nearest;

/// Colours that are told apart by most eyes (Okabe and Ito).
const LINES: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
];
/// The parts that have a colour, as they are said.
const PARTS: [&str; 11] =
    ["background", "grid", "axes", "text", "data", "line1", "line2", "line3", "line4", "line5", "line6"];

/// The colours of a plot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Colours {
    pub(crate) background: RGBColor,
    pub(crate) grid: RGBColor,
    pub(crate) axes: RGBColor,
    pub(crate) text: RGBColor,
    pub(crate) data: RGBColor,
    pub(crate) lines: [RGBColor; 6],
}

impl Default for Colours {
    fn default() -> Self {
        Self {
            background: RGBColor(255, 255, 255),
            grid: RGBColor(222, 222, 222),
            axes: RGBColor(80, 80, 80),
            text: RGBColor(0, 0, 0),
            data: RGBColor(110, 110, 110),
            lines: LINES,
        }
    }
}

/// A part of a plot and its colour, as `line1=ff8800`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Colouring {
    part: &'static str,
    colour: RGBColor,
}

impl std::str::FromStr for Colouring {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, colour) = text.split_once('=').ok_or("expected PART=RRGGBB, as line1=ff8800")?;
        let part = PARTS.into_iter().find(|part| *part == name);
        let part = part.ok_or_else(|| format!("there is no part '{name}'{}", nearest(name, &PARTS)))?;
        let digits = colour.strip_prefix('#').unwrap_or(colour);
        let number = u32::from_str_radix(digits, 16).ok().filter(|_| digits.len() == 6 && !digits.starts_with('+'));
        let [_, red, green, blue] =
            number.ok_or_else(|| format!("expected six hexadecimal digits, found '{colour}'"))?.to_be_bytes();
        Ok(Self { part, colour: RGBColor(red, green, blue) })
    }
}

impl Colours {
    /// The usual ones, with these instead.
    pub fn with(colourings: &[Colouring]) -> Self {
        let mut colours = Self::default();
        for Colouring { part, colour } in colourings {
            let place = match *part {
                "background" => &mut colours.background,
                "grid" => &mut colours.grid,
                "axes" => &mut colours.axes,
                "text" => &mut colours.text,
                "data" => &mut colours.data,
                line => {
                    let n = line.bytes().last().map_or(0, |digit| usize::from(digit.saturating_sub(b'1')));
                    &mut colours.lines[n % LINES.len()]
                }
            };
            *place = *colour;
        }
        colours
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_part_takes_a_colour() {
        let all: Vec<Colouring> = PARTS.iter().map(|part| format!("{part}=#010203").parse().unwrap()).collect();
        let one = RGBColor(1, 2, 3);
        let Colours { background, grid, axes, text, data, lines } = Colours::with(&all);
        assert!([background, grid, axes, text, data].iter().chain(&lines).all(|colour| *colour == one));
        assert_eq!(Colours::with(&["line2=0000ff".parse().unwrap()]).lines[1], RGBColor(0, 0, 255));
        for (text, expected) in [
            ("line1", "expected PART=RRGGBB, as line1=ff8800"),
            ("line1=red", "expected six hexadecimal digits, found 'red'"),
            ("line1=+12345", "expected six hexadecimal digits, found '+12345'"),
            ("lin1=ff0000", "there is no part 'lin1': did you mean 'line1'?"),
        ] {
            assert_eq!(text.parse::<Colouring>(), Err(expected.to_owned()), "{text}");
        }
    }
}
