//! Figures: panels one below the other, each with its axes, units, grid and legend.

use std::fmt;
use std::path::Path;

use plotters::prelude::*;

use crate::axis::{Axis, number, range};
use crate::bitmap::{Bitmap, Picture};
use crate::colours::Colours;

/// The width of a plot, in px.
const WIDTH: u32 = 960;
/// The height of a panel of height 1, in px.
const HEIGHT: f64 = 420.0;
/// What a panel has around its axes, in px: above, at the right, below and at the left; and what their numbers take.
const MARGINS: [u32; 4] = [12, 24, 12, 12];
const NUMBERS: (u32, u32) = (72, 44);
/// The most that a panel to scale is high.
const HIGHEST: f64 = 6.0;
/// The height of the title, in px.
const TITLE: u32 = 44;
/// Where a panel's axis is, in px.
const LEFT: i32 = 84;
/// What a name in the legend takes beside its letters, and the height of a row, in px.
const LEGEND: (i32, i32) = (56, 18);
/// A letter's width, in px, about.
const LETTER: f64 = 7.0;
/// Panels below a title.
#[derive(Clone, Debug, Default)]
pub struct Figure {
    /// The title.
    pub title: String,
    /// The panels, from above.
    pub panels: Vec<Panel>,
}

/// One pair of axes.
#[derive(Clone, Debug)]
pub struct Panel {
    /// What is on the horizontal axis, with its unit.
    pub x: String,
    /// What is on the vertical axis, with its unit.
    pub y: String,
    /// Its height; 1 is that of a panel on its own.
    pub height: f64,
    /// What is drawn, the first below the others.
    pub series: Vec<Series>,
}

/// Points that belong together.
#[derive(Clone, Debug)]
pub struct Series {
    /// Its name in the legend.
    pub name: String,
    /// How it is drawn.
    pub style: Style,
    /// The points, in order. Lines have a gap where one is no number.
    pub points: Vec<(f64, f64)>,
}

/// How points are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// As grey points: data.
    Dots,
    /// As a line.
    Line,
    /// As a thin grey line: what the others are seen against.
    Thin,
    /// As a dashed line.
    Dashed,
    /// Each value is held up to the next point.
    Steps,
}

impl Style {
    fn stroke(self, colour: RGBColor) -> ShapeStyle {
        colour.stroke_width(if self == Self::Thin { 1 } else { 2 })
    }
}

impl Series {
    /// A series.
    pub fn new(name: impl Into<String>, style: Style, points: Vec<(f64, f64)>) -> Self {
        let mut points = points;
        points.retain(|(x, y)| x.is_finite() && y.is_finite());
        if style == Style::Steps {
            let held: Vec<(f64, f64)> = points.windows(2).map(|pair| (pair[1].0, pair[0].1)).collect();
            let mut both: Vec<(f64, f64)> = points.iter().copied().zip(held).flat_map(|(a, b)| [a, b]).collect();
            both.extend(points.last());
            // A held value needs no more than its ends.
            both.dedup_by(|next, kept| next.1 == kept.1 && next.0 == kept.0);
            points = both;
        }
        Self { name: name.into(), style, points }
    }

    /// Lines that are not joined.
    pub fn pieces(name: impl Into<String>, style: Style, pieces: Vec<Vec<(f64, f64)>>) -> Self {
        let pieces = pieces.into_iter().map(|piece| Self::new("", style, piece).points);
        let points = pieces.flat_map(|piece| piece.into_iter().chain([(f64::NAN, f64::NAN)])).collect();
        Self { name: name.into(), style, points }
    }
}

/// A part of a drawing.
type Area<B> = DrawingArea<B, plotters::coord::Shift>;

/// Why there is no plot.
#[derive(Debug, thiserror::Error)]
#[error("cannot draw: {0}")]
pub struct PlotError(String);

impl PlotError {
    fn of(error: impl fmt::Display) -> Self {
        Self(error.to_string())
    }
}

/// What a figure can be written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Scalable Vector Graphics.
    Svg,
    /// Portable Network Graphics.
    Png,
}

impl Format {
    /// The format that a file's name asks for; SVG where it has no extension.
    pub fn of(path: &Path) -> Option<Self> {
        let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        match extension.as_deref() {
            None | Some("svg") => Some(Self::Svg),
            Some("png") => Some(Self::Png),
            Some(_) => None,
        }
    }
}

impl Figure {
    /// The figure in a format, in these colours.
    ///
    /// # Errors
    /// [`PlotError`] if it cannot be drawn.
    pub fn encode(&self, format: Format, colours: &Colours) -> Result<Vec<u8>, PlotError> {
        match format {
            Format::Svg => {
                let mut svg = String::new();
                self.draw(SVGBackend::with_string(&mut svg, self.size()), colours)?;
                Ok(svg.into_bytes())
            }
            Format::Png => {
                let mut picture = Picture::default();
                self.draw(Bitmap::new(self.size(), &mut picture), colours)?;
                picture.png().map_err(PlotError::of)
            }
        }
    }

    fn heights(&self) -> impl Iterator<Item = u32> {
        self.panels.iter().map(|panel| (HEIGHT * panel.height) as u32)
    }

    fn size(&self) -> (u32, u32) {
        (WIDTH, TITLE + self.heights().sum::<u32>())
    }

    fn draw<B: DrawingBackend>(&self, backend: B, colours: &Colours) -> Result<(), PlotError> {
        let root = backend.into_drawing_area();
        root.fill(&colours.background).map_err(PlotError::of)?;
        let title = ("sans-serif", 20).into_font().style(FontStyle::Bold);
        let (above, mut rest) = root.split_vertically(TITLE);
        above.draw(&Text::new(self.title.clone(), (16, 14), title.color(&colours.text))).map_err(PlotError::of)?;
        for (panel, height) in self.panels.iter().zip(self.heights()) {
            let (area, below) = rest.split_vertically(height);
            panel.draw(&area, colours)?;
            rest = below;
        }
        root.present().map_err(PlotError::of)
    }
}

impl Panel {
    /// The same, so high that a unit is as long upwards as along.
    #[must_use]
    pub fn to_scale(self) -> Self {
        let [x, y] = self.ranges();
        let [above, right, below, left] = MARGINS;
        let along = f64::from(WIDTH - left - right - NUMBERS.0);
        let upwards = along * (y.1 - y.0) / (x.1 - x.0);
        let legend = self.legend_places().last().map_or(0, |place| place.1);
        let high = upwards + f64::from(above + below + NUMBERS.1) + f64::from(legend);
        Self { height: ((high + 0.5) / HEIGHT).min(HIGHEST), ..self }
    }

    /// From where to where its axes go.
    fn ranges(&self) -> [(f64, f64); 2] {
        let all = || self.series.iter().flat_map(|series| &series.points).filter(|(x, _)| !x.is_nan());
        [range(all().map(|(x, _)| *x), 0.0), range(all().map(|(_, y)| *y), 0.06)]
    }

    fn draw<B: DrawingBackend>(&self, area: &Area<B>, colours: &Colours) -> Result<(), PlotError> {
        let [x, y] = self.ranges();
        let area = &self.legend(area, colours)?;
        let label = ("sans-serif", 14).into_font().color(&colours.text);
        let mut chart = ChartBuilder::on(area)
            .margin_top(MARGINS[0])
            .margin_right(MARGINS[1])
            .margin_bottom(MARGINS[2])
            .margin_left(MARGINS[3])
            .x_label_area_size(NUMBERS.1)
            .y_label_area_size(NUMBERS.0)
            .build_cartesian_2d(Axis(x), Axis(y))
            .map_err(PlotError::of)?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(colours.grid)
            .axis_style(colours.axes)
            .label_style(label.clone())
            .axis_desc_style(("sans-serif", 15).into_font().color(&colours.text))
            .x_desc(self.x.as_str())
            .y_desc(self.y.as_str())
            .x_labels(10)
            .y_labels(if self.height < 0.6 { 4 } else { 7 })
            .x_label_formatter(&|x| number(*x))
            .y_label_formatter(&|y| number(*y))
            .draw()
            .map_err(PlotError::of)?;
        for (series, colour) in self.series.iter().zip(self.colours(colours)) {
            let line = series.style.stroke(colour);
            for points in series.points.split(|(x, _)| x.is_nan()) {
                let points = points.iter().copied();
                match series.style {
                    Style::Dots => chart
                        .draw_series(points.map(|point| Circle::new(point, 2, colour.mix(0.7).filled())))
                        .map(|_| ()),
                    Style::Line | Style::Thin | Style::Steps => {
                        chart.draw_series(LineSeries::new(points, line)).map(|_| ())
                    }
                    Style::Dashed => chart.draw_series(DashedLineSeries::new(points, 7, 5, line)).map(|_| ()),
                }
                .map_err(PlotError::of)?;
            }
        }
        Ok(())
    }

    /// Data are grey; each of the others has a colour of its own.
    fn colours(&self, colours: &Colours) -> impl Iterator<Item = RGBColor> {
        let (data, mut lines) = (colours.data, colours.lines.into_iter().cycle());
        self.series.iter().map(move |series| match series.style {
            Style::Dots | Style::Thin => data,
            _ => lines.next().unwrap_or(data),
        })
    }

    /// Draws the legend at the top, where it covers nothing, if there is more than one series; gives what is left.
    fn legend<B: DrawingBackend>(&self, area: &Area<B>, colours: &Colours) -> Result<Area<B>, PlotError> {
        let places = self.legend_places();
        let Some((_, lowest)) = places.last().copied() else { return Ok(area.clone()) };
        for ((series, colour), (x, y)) in self.series.iter().zip(self.colours(colours)).zip(places) {
            let (line, ends) = (series.style.stroke(colour), vec![(x, y), (x + 24, y)]);
            match series.style {
                Style::Dots => area.draw(&Circle::new((x + 12, y), 3, colour.filled())),
                Style::Line | Style::Thin | Style::Steps => area.draw(&PathElement::new(ends, line)),
                Style::Dashed => area.draw(&plotters::element::DashedPathElement::new(ends, 7, 5, line)),
            }
            .map_err(PlotError::of)?;
            let words = ("sans-serif", 14).into_font().color(&colours.text);
            area.draw(&Text::new(series.name.clone(), (x + 32, y - 7), words)).map_err(PlotError::of)?;
        }
        Ok(area.split_vertically(lowest).1)
    }

    /// Where each series stands in the legend, in as many rows as they need; nowhere, if there is only one.
    fn legend_places(&self) -> Vec<(i32, i32)> {
        if self.series.len() < 2 {
            return Vec::new();
        }
        let (mut x, mut rows) = (LEFT, 1);
        let place = |series: &Series| {
            let width = LEGEND.0 + (series.name.chars().count() as f64 * LETTER) as i32;
            if x > LEFT && x + width > WIDTH as i32 {
                (x, rows) = (LEFT, rows + 1);
            }
            let at = (x, rows * LEGEND.1);
            x += width;
            at
        };
        self.series.iter().map(place).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn svg(figure: &Figure) -> String {
        String::from_utf8(figure.encode(Format::Svg, &Colours::default()).unwrap()).unwrap()
    }

    /// It stands above its panel, in as many rows as it needs.
    #[test]
    fn the_legend_covers_nothing() {
        let series = |name: &str| Series::new(name, Style::Line, vec![(0.0, 0.0), (1.0, 1.0)]);
        let long = "tp and ts, Eq 8-10 (the paper's), and then some";
        let panel = Panel { x: String::new(), y: String::new(), height: 0.6, series: vec![series(long); 4] };
        let svg = svg(&Figure { title: String::new(), panels: vec![panel] });
        let y = |line: &str| line.split("y=\"").nth(1).and_then(|y| y.split('"').next()?.parse::<f64>().ok());
        let lines: Vec<&str> = svg.split("<text").collect();
        let texts: Vec<f64> =
            lines.windows(1).filter(|line| line[0].contains("Eq 8-10")).filter_map(|line| y(line[0])).collect();
        assert!(texts.len() == 4 && texts[0] == texts[1] && texts[2] > texts[1], "{texts:?}");
        // Nothing of the panel reaches up there.
        let curve = svg.split("points=\"").skip(1).flat_map(|points| points.split('"').next().unwrap().split(' '));
        let above = curve.filter_map(|point| point.split_once(',')?.1.parse::<f64>().ok());
        let legend = texts[3] + 7.0;
        let drawn = above.filter(|y| *y > f64::from(TITLE) + 45.0).fold(f64::MAX, f64::min);
        assert!(drawn > legend, "{drawn} {legend}");
    }

    /// The points of a picture's lines, in px.
    fn lines(svg: &str) -> Vec<Vec<(f64, f64)>> {
        let point = |text: &str| text.split_once(',').map(|(x, y)| (x.parse().unwrap(), y.parse().unwrap())).unwrap();
        let lines = svg.split("points=\"").skip(1).map(|rest| rest.split('"').next().unwrap().trim());
        lines.map(|line| line.split(' ').map(point).collect()).collect()
    }

    #[test]
    fn a_panel_to_scale_is_so_and_pieces_are_not_joined() {
        for (width, count) in [(60.0, 1), (25.0, 9)] {
            // A square, and a line as long as it is wide, far from it.
            let square = vec![(0.0, 3.0), (10.0, 3.0), (10.0, 13.0), (0.0, 13.0)];
            let pieces = vec![square, vec![(width - 1.0, 7.0), (width, 7.0)]];
            let series = Series::pieces("a name in the legend", Style::Line, pieces);
            let panel = Panel { x: String::new(), y: String::new(), height: 1.0, series: vec![series; count] };
            let drawn = lines(&svg(&Figure { title: String::new(), panels: vec![panel.to_scale()] }));
            let square = drawn.iter().find(|line| line.len() == 4).unwrap();
            let (along, upwards) = (square[1].0 - square[0].0, square[1].1 - square[2].1);
            assert!((along - upwards).abs() <= 2.0 && along > 100.0, "{along} {upwards}");
            let shorter = drawn.iter().any(|line| line.len() == 2 && line[1].0 - line[0].0 < along / 9.0);
            assert!(shorter, "{drawn:?}");
        }
    }

    #[test]
    fn a_figure_has_its_words_and_bears_anything() {
        let series = |name: &str, style| Series::new(name, style, vec![(0.0, 1.0), (f64::NAN, 2.0), (2.0, 1.0)]);
        let styles = [("data", Style::Dots), ("model", Style::Line), ("Eq 4", Style::Dashed), ("drive", Style::Steps)];
        let panel = Panel {
            x: "time, s".to_owned(),
            y: "speed, rad/s".to_owned(),
            height: 1.0,
            series: styles.map(|(name, style)| series(name, style)).to_vec(),
        };
        let empty = Panel { series: Vec::new(), ..panel.clone() };
        let svg = svg(&Figure { title: "spindle".to_owned(), panels: vec![panel, empty] });
        for word in ["spindle", "time, s", "speed, rad/s", "data", "model", "Eq 4", "drive"] {
            assert!(svg.contains(word), "{word}");
        }
        assert!(!svg.contains("NaN"));
    }
}
