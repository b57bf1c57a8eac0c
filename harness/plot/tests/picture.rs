//! What is in a PNG.

#![allow(clippy::unwrap_used, reason = "in a test, a panic is an answer")]

use torno_plot::{Colouring, Colours, Figure, Format, Panel, Series, Style};

/// Size and pixels.
fn drawn(colours: &[&str], title: &str) -> ((u32, u32), Vec<[u8; 3]>) {
    let colours: Vec<Colouring> = colours.iter().map(|colour| colour.parse().unwrap()).collect();
    let series = Series::new("s", Style::Line, vec![(0.0, 0.0), (1.0, 1.0)]);
    let panel = Panel { x: "t".to_owned(), y: "s".to_owned(), height: 1.0, series: vec![series] };
    let png =
        Figure { title: title.to_owned(), panels: vec![panel] }.encode(Format::Png, &Colours::with(&colours)).unwrap();
    let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    ((info.width, info.height), bytes.chunks(3).map(|pixel| pixel.try_into().unwrap()).collect())
}

#[test]
fn a_picture_has_its_lines_and_letters_in_their_colours() {
    let colours = ["background=102030", "text=00ff00", "line1=ff0000", "grid=102030", "axes=102030"];
    let (size, pixels) = drawn(&colours, "wykres ż");
    assert_eq!((size, pixels[0]), ((1_920, 928), [0x10, 0x20, 0x30]));
    let count = |colour: [u8; 3]| pixels.iter().filter(|pixel| **pixel == colour).count();
    // The line goes over the whole panel, four pixels thick.
    assert!(count([0xff, 0, 0]) > 4_000, "{}", count([0xff, 0, 0]));
    assert!(count([0, 0xff, 0]) > 100, "{}", count([0, 0xff, 0]));
    // Nothing else is in it than these and what is between them and the ground.
    let red_and_green = pixels.iter().filter(|[red, green, _]| *red > 0x80 && *green > 0x80).count();
    assert_eq!(red_and_green, 0);
    let (_, without) = drawn(&colours, "");
    let above = |pixels: &[[u8; 3]]| pixels[..80 * 1_920].iter().filter(|pixel| pixel[1] > 0x80).count();
    assert!(above(&pixels) > 100 && above(&without) == 0);
}
