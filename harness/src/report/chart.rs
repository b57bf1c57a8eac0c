//! A chart of a page: rows below one another along one axis of time, as a strip-chart recorder or a logic analyser
//! shows them. Left of the axis stands what a row is.
//!
//! Colours are the page's: see its style. What lies along the time is a drawing of its own within the chart, which the
//! page's script stretches; its strokes are not stretched with it.

use std::fmt::Write;

use super::drawing::escaped;
use super::plot::{number, ticks};

/// The width of a chart, in px.
const WIDTH: u32 = 1000;
/// Left of the axis, and right of its end.
pub(super) const SIDES: (u32, u32) = (176, 14);
/// The width along which the time goes.
pub(super) const ALONG: u32 = WIDTH - SIDES.0 - SIDES.1;
/// The room above the rows, for a label at the very end of an axis.
const ABOVE: u32 = 6;
/// The room of the time's axis.
const TIME: u32 = 30;

/// A chart.
pub(super) struct Chart {
    /// Its name in the page.
    pub(super) id: String,
    /// What it shows, for those who cannot see it.
    pub(super) title: String,
    /// From where to where, in `unit`.
    pub(super) range: (f64, f64),
    /// What the time is counted in.
    pub(super) unit: &'static str,
    /// The rows, from above.
    pub(super) rows: Vec<Row>,
}

/// A row of a chart.
#[derive(Default)]
pub(super) struct Row {
    /// What it is.
    pub(super) label: String,
    /// Its unit, or more about it.
    pub(super) unit: String,
    /// What the lines are, by the number of their colours.
    pub(super) keys: Vec<&'static str>,
    /// In px.
    pub(super) height: u32,
    /// What is left free above it, in px.
    pub(super) gap: u32,
    /// What does not go with the time: elements, as large as the row of a chart.
    pub(super) axes: String,
    /// What does: elements.
    pub(super) data: String,
    /// As large as this.
    pub(super) size: (u32, u32),
}

impl Row {
    /// The whole chart is as wide as this.
    pub(super) const WIDTH: u32 = WIDTH;
}

impl Chart {
    /// The elements of the chart.
    pub(super) fn svg(&self) -> String {
        let height = ABOVE + self.rows.iter().map(|row| row.gap + row.height).sum::<u32>();
        let mut svg = String::new();
        let (id, title, all) = (escaped(&self.id), escaped(&self.title), height + TIME);
        let (from, to) = self.range;
        // Writing to a string cannot fail.
        let _ = writeln!(
            svg,
            "<svg class=\"chart\" id=\"{id}\" viewBox=\"0 0 {WIDTH} {all}\" role=\"img\" aria-label=\"{title}\" \
             data-from=\"{from}\" data-to=\"{to}\" data-left=\"{}\" data-along=\"{ALONG}\">",
            SIDES.0,
        );
        self.write_time(&mut svg, height);
        let mut y = ABOVE;
        for row in &self.rows {
            y += row.gap;
            row.write(&mut svg, y);
            y += row.height;
        }
        svg.push_str("</svg>\n");
        svg
    }

    fn write_time(&self, svg: &mut String, height: u32) {
        let (left, bottom) = (SIDES.0, height + 17);
        let _ = writeln!(svg, "<text class=\"dim\" x=\"0\" y=\"{bottom}\">time, {}</text>", self.unit);
        let _ = write!(svg, "<g class=\"time\" data-height=\"{height}\">");
        let (from, to) = self.range;
        let ticks = if to > from { ticks(self.range, 12) } else { Vec::new() };
        for time in ticks {
            let x = f64::from(left) + (time - from) / (to - from) * f64::from(ALONG);
            let _ = write!(
                svg,
                "<path d=\"M{x:.1} 0V{}\"/><text x=\"{x:.1}\" y=\"{bottom}\">{}</text>",
                height + 4,
                number(time)
            );
        }
        svg.push_str("</g>\n");
    }
}

impl Row {
    fn write(&self, svg: &mut String, y: u32) {
        let Self { label, unit, height, size: (units, high), .. } = self;
        let (left, middle) = (SIDES.0, if *height < 40 { height / 2 + 4 } else { 15 });
        let _ = write!(svg, "<g class=\"row\" transform=\"translate(0 {y})\">{}", self.axes);
        let _ = write!(svg, "<text class=\"label\" x=\"0\" y=\"{middle}\">{}</text>", escaped(label));
        if !unit.is_empty() {
            let _ = write!(svg, "<text class=\"dim\" x=\"0\" y=\"{}\">{}</text>", middle + 17, escaped(unit));
        }
        for (n, key) in self.keys.iter().enumerate() {
            let y = middle + 36 + 17 * n as u32;
            let _ = write!(
                svg,
                "<path class=\"key c{n}\" d=\"M0 {}h16\"/><text class=\"dim\" x=\"22\" y=\"{y}\">{}</text>",
                y - 4,
                escaped(key)
            );
        }
        let _ = writeln!(
            svg,
            "<svg class=\"data\" x=\"{left}\" width=\"{ALONG}\" height=\"{height}\" viewBox=\"0 0 {units} {high}\" \
             preserveAspectRatio=\"none\">{}</svg></g>",
            self.data
        );
    }
}
