//! Plots and charts, made in memory.
//!
//! A [`Figure`] is a picture of its own, as SVG or PNG: panels below one another, each with its axes. A [`Chart`] is a
//! part of a page: rows along one axis of time, in the colours of the page, which its script can stretch.

mod axis;
mod bitmap;
mod chart;
mod colours;
mod figure;

pub use chart::{Chart, ChartRow};
pub use colours::{Colouring, Colours};
pub use figure::{Figure, Format, Panel, PlotError, Series, Style};

/// Text in SVG or HTML.
pub fn escaped(text: &str) -> String {
    let legal = |c: &char| !c.is_control();
    let escape = |c: char| match c {
        '&' => "&amp;".to_owned(),
        '<' => "&lt;".to_owned(),
        '>' => "&gt;".to_owned(),
        '"' => "&quot;".to_owned(),
        c => c.to_string(),
    };
    text.chars().filter(legal).map(escape).collect()
}
