//! A chart of a page: rows below one another along one axis of time, as a strip-chart recorder or a logic analyser
//! shows them. Left of the axis stands what a row is.
//!
//! Colours are the page's: see its style. What lies along the time is a drawing of its own within the chart, which the
//! page's script stretches; its strokes are not stretched with it.

use std::fmt::Write;

use crate::axis::{number, range, ticks};
use crate::{Series, escaped};

/// The width of a chart, in px.
const WIDTH: u32 = 1000;
/// Left of the axis, and right of its end.
const SIDES: (u32, u32) = (176, 14);
/// The width along which the time goes, in px.
const ALONG: u32 = WIDTH - SIDES.0 - SIDES.1;
/// The room above the rows, for a label at the very end of an axis.
const ABOVE: u32 = 6;
/// The room of the time's axis.
const TIME: u32 = 30;

/// A chart.
pub struct Chart {
    /// Its name in the page.
    pub id: String,
    /// What it shows, for those who cannot see it.
    pub title: String,
    /// From where to where, in `unit`.
    pub range: (f64, f64),
    /// What the time is counted in.
    pub unit: &'static str,
    /// The rows, from above.
    pub rows: Vec<ChartRow>,
}

/// A row of a chart.
pub struct ChartRow {
    /// What it is.
    pub label: String,
    /// Its unit, or more about it.
    pub unit: String,
    /// What the lines are, by the number of their colours.
    pub keys: Vec<&'static str>,
    /// In px.
    pub height: u32,
    /// What is left free above it, in px.
    pub gap: u32,
    /// What does not go with the time: elements, as large as the row of a chart.
    pub axes: String,
    /// What does: elements.
    pub data: String,
    /// As large as this, across and down.
    pub size: (u32, u32),
}

impl Default for ChartRow {
    fn default() -> Self {
        let (label, unit, axes, data) = (String::new(), String::new(), String::new(), String::new());
        Self { label, unit, keys: Vec::new(), height: 0, gap: 0, axes, data, size: Self::UNITS }
    }
}

impl ChartRow {
    /// The width along which the time goes, in px.
    pub const ALONG: u32 = ALONG;
    /// The usual size of what goes with the time: far finer than what is seen.
    pub const UNITS: (u32, u32) = (20_000, 2_000);

    /// A row of so many px with its scale and, along the time, a line for each series; the first lies above the others.
    /// The values are multiples of `step`.
    pub fn of_series(series: &[Series], time: (f64, f64), height: u32, step: f64) -> Self {
        let y = range(series.iter().flat_map(|series| &series.points).map(|(_, y)| *y), 0.06);
        // Nothing stands between two of them.
        let y = (y.0, (y.1 + 0.06 * (y.1 - y.0)).max(y.0 + 1.2 * step));
        let labels = (height / 18).clamp(2, 7).min(((y.1 - y.0) / step).min(7.0).ceil() as u32);
        let along = |(low, high): (f64, f64), value: f64, last: u32| {
            ((value - low) / (high - low) * f64::from(last)).round() as i64
        };
        let (left, right, bottom) = (SIDES.0, WIDTH - SIDES.1 - 1, height - 1);
        let mut axes = format!("<g class=\"scale\"><path d=\"M{} 0V{bottom}\"/>", left - 1);
        for tick in ticks(y, labels as usize) {
            let at = i64::from(bottom) - along(y, tick, bottom);
            // Writing to a string cannot fail.
            let _ = write!(
                axes,
                "<path class=\"grid\" d=\"M{left} {at}H{right}\"/><path d=\"M{} {at}h5\"/>\
                 <text x=\"{}\" y=\"{at}\" dy=\"0.5ex\">{}</text>",
                left - 6,
                left - 10,
                number(tick)
            );
        }
        axes.push_str("</g>");
        let (across, down) = (Self::UNITS.0 - 1, Self::UNITS.1 - 1);
        let mut data = String::new();
        for (n, series) in series.iter().enumerate().rev() {
            let place = |(x, of): &(f64, f64)| (along(time, *x, across), i64::from(down) - along(y, *of, down));
            let mut places: Vec<(i64, i64)> = series.points.iter().map(place).collect();
            places.dedup();
            let points: Vec<String> = places.into_iter().map(|(x, y)| format!("{x},{y}")).collect();
            let _ = writeln!(data, "<polyline class=\"c{n}\" points=\"{}\"/>", points.join(" "));
        }
        Self { height, axes, data, ..Self::default() }
    }
}

impl Chart {
    /// The elements of the chart.
    pub fn svg(&self) -> String {
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

impl ChartRow {
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
