//! What is in a chart of a page.

#![allow(clippy::unwrap_used, reason = "in a test, a panic is an answer")]

use torno_plot::{Chart, ChartRow, Series, Style};

fn chart(series: &[Series]) -> String {
    let row = ChartRow { label: "a < b".to_owned(), gap: 16, ..ChartRow::of_series(series, (0.0, 10.0), 92, 1.0) };
    let rows = vec![row, ChartRow { height: 22, ..ChartRow::default() }];
    Chart { id: "it".to_owned(), title: "speed".to_owned(), range: (0.0, 10.0), unit: "s", rows }.svg()
}

#[test]
fn a_series_is_drawn_over_the_whole_of_its_row() {
    let up = Series::new("up", Style::Line, vec![(0.0, 0.0), (5.0, 200.0), (5.0, 200.0), (10.0, 100.0)]);
    let flat = Series::new("flat", Style::Steps, vec![(0.0, 0.0), (10.0, 0.0)]);
    let svg = chart(&[up, flat]);
    let lines: Vec<&str> = svg.lines().filter(|line| line.contains("<polyline")).collect();
    // The first lies above the second. 1999 units are 224.72 high: above the greatest, 6 % are free, twice.
    let [below, above] = lines[..] else { panic!("{svg}") };
    assert!(below.contains("class=\"c1\" points=\"0,1999 19999,1999\""), "{below}");
    assert!(above.contains("class=\"c0\" points=\"0,1999 10000,220 19999,1109\""), "{above}");
    assert!(svg.contains("viewBox=\"0 0 20000 2000\" preserveAspectRatio=\"none\""), "{svg}");
}

#[test]
fn a_row_has_its_scale_at_round_numbers_and_its_label_as_text() {
    let svg = chart(&[Series::new("s", Style::Line, vec![(0.0, 0.0), (10.0, 200.0)])]);
    let labels: Vec<&str> = svg.split("dy=\"0.5ex\">").skip(1).map(|rest| rest.split('<').next().unwrap()).collect();
    assert_eq!(labels, ["0", "50", "100", "150", "200"]);
    assert!(svg.contains("<path class=\"grid\" d=\"M176 91H985\"/>"), "{svg}");
    assert!(svg.contains(">a &lt; b</text>"), "{svg}");
}

#[test]
fn nothing_to_draw_is_drawn_as_nothing() {
    let svg = chart(&[Series::new("none", Style::Line, vec![(0.0, f64::NAN)])]);
    assert!(svg.contains("<polyline class=\"c0\" points=\"\"/>") && !svg.contains("NaN"), "{svg}");
}
