//! Draws a plot in pixels, for PNG: twice as fine as its SVG is meant, so that it is sharp on paper, too.
//!
//! Lines are drawn finer still and averaged. Letters come from a font of pixels (Noto Sans Mono) in the program itself:
//! what is drawn depends on no font of this computer.

use std::convert::Infallible;

use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster};
use plotters_backend::rasterizer::{draw_circle, draw_line, fill_polygon, polygonize};
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingBackend, DrawingErrorKind, FontTransform,
};

/// Pixels of the picture for one of the plot, each way.
const FINE: i32 = 2;
/// Points drawn for one pixel of the picture, each way.
const POINTS: i32 = 2;
/// The letters.
const WEIGHT: FontWeight = FontWeight::Regular;
const HEIGHT: RasterHeight = RasterHeight::Size24;
/// What stands for a letter that the font lacks.
const NO_LETTER: char = '?';

type Drawn = Result<(), DrawingErrorKind<Infallible>>;

/// A picture that is being drawn on.
pub(crate) struct Bitmap<'a> {
    points: Points,
    texts: Vec<Text>,
    picture: &'a mut Picture,
}

/// A picture: three bytes a pixel, by rows from above.
#[derive(Clone, Debug, Default)]
pub(crate) struct Picture {
    pub(crate) size: (u32, u32),
    pub(crate) pixels: Vec<u8>,
}

/// The points, finer than the pixels.
struct Points {
    size: (i32, i32),
    colours: Vec<[u8; 3]>,
}

/// What is written when all else is drawn.
struct Text {
    text: String,
    at: BackendCoord,
    anchor: (HPos, VPos),
    transform: FontTransform,
    colour: BackendColor,
}

/// A style as thick as it has to be in points.
struct Thick {
    colour: BackendColor,
    width: u32,
}

impl BackendStyle for Thick {
    fn color(&self) -> BackendColor {
        self.colour
    }

    fn stroke_width(&self) -> u32 {
        self.width
    }
}

fn thick(style: &impl BackendStyle) -> Thick {
    Thick { colour: style.color(), width: style.stroke_width() * (FINE * POINTS) as u32 }
}

fn fine((x, y): BackendCoord) -> BackendCoord {
    (x * FINE * POINTS, y * FINE * POINTS)
}

fn mix(below: &mut [u8], colour: BackendColor, share: f64) {
    let (red, green, blue) = colour.rgb;
    if share >= 1.0 {
        return below.copy_from_slice(&[red, green, blue]);
    }
    for (below, above) in below.iter_mut().zip([red, green, blue]) {
        let mixed = f64::from(*below) + (f64::from(above) - f64::from(*below)) * share;
        *below = mixed.round() as u8;
    }
}

impl<'a> Bitmap<'a> {
    /// An empty picture of a plot of this size; it is in `picture` when it has been presented.
    pub(crate) fn new((width, height): (u32, u32), picture: &'a mut Picture) -> Self {
        let size = (width as i32 * FINE * POINTS, height as i32 * FINE * POINTS);
        let points = Points { size, colours: vec![[255; 3]; size.0 as usize * size.1 as usize] };
        picture.size = (width * FINE as u32, height * FINE as u32);
        Self { points, texts: Vec::new(), picture }
    }

    /// Each pixel is the mean of its points.
    fn average(&mut self) {
        let (width, height) = (self.picture.size.0 as usize, self.picture.size.1 as usize);
        let (across, each) = (self.points.size.0 as usize, POINTS as usize);
        self.picture.pixels = Vec::with_capacity(3 * width * height);
        for y in 0..height {
            for x in 0..width {
                let places = (0..each * each).map(|n| (y * each + n / each) * across + x * each + n % each);
                let mut sum = [0; 3];
                for place in places {
                    sum.iter_mut().zip(self.points.colours[place]).for_each(|(sum, of)| *sum += u32::from(of));
                }
                self.picture.pixels.extend(sum.map(|sum| (sum / (POINTS * POINTS) as u32) as u8));
            }
        }
    }

    fn write(&mut self, Text { text, at, anchor, transform, colour }: &Text) {
        let (width, height) = extent(text);
        let left = match anchor.0 {
            HPos::Left => 0,
            HPos::Center => -width / 2,
            HPos::Right => -width,
        };
        let top = match anchor.1 {
            VPos::Top => 0,
            VPos::Center => -height / 2,
            VPos::Bottom => -height,
        };
        let letters =
            text.chars().filter_map(|c| get_raster(c, WEIGHT, HEIGHT).or(get_raster(NO_LETTER, WEIGHT, HEIGHT)));
        let (across, down) = (self.picture.size.0 as i32, self.picture.size.1 as i32);
        for (n, letter) in letters.enumerate() {
            for (y, row) in letter.rows().enumerate() {
                for (x, shade) in row.iter().enumerate().filter(|(_, shade)| **shade > 0) {
                    let x = left + (n * letter.width() + x) as i32;
                    let (x, y) = transform.transform(x, top + y as i32);
                    let (x, y) = (at.0 * FINE + x, at.1 * FINE + y);
                    if (0..across).contains(&x) && (0..down).contains(&y) {
                        let place = 3 * (y as usize * across as usize + x as usize);
                        let share = f64::from(*shade) / 255.0 * colour.alpha;
                        mix(&mut self.picture.pixels[place..place + 3], *colour, share);
                    }
                }
            }
        }
    }
}

/// The width and the height of a text, in pixels of the picture.
fn extent(text: &str) -> (i32, i32) {
    let letter = get_raster(NO_LETTER, WEIGHT, HEIGHT).map_or((0, 0), |letter| (letter.width(), letter.height()));
    ((text.chars().count() * letter.0) as i32, letter.1 as i32)
}

impl Points {
    /// Fills a rectangle, its edges too.
    fn fill(&mut self, from: BackendCoord, to: BackendCoord, colour: BackendColor) {
        let span = |from: i32, to: i32, size: i32| {
            let (from, to) = (from.min(to).clamp(0, size), (from.max(to) + 1).clamp(0, size));
            from as usize..to as usize
        };
        let (columns, rows) = (span(from.0, to.0, self.size.0), span(from.1, to.1, self.size.1));
        for row in self.colours.chunks_mut(self.size.0 as usize).skip(rows.start).take(rows.len()) {
            row[columns.clone()].iter_mut().for_each(|point| mix(point, colour, colour.alpha));
        }
    }
}

impl DrawingBackend for Points {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        (self.size.0 as u32, self.size.1 as u32)
    }

    fn ensure_prepared(&mut self) -> Drawn {
        Ok(())
    }

    fn present(&mut self) -> Drawn {
        Ok(())
    }

    fn draw_pixel(&mut self, (x, y): BackendCoord, colour: BackendColor) -> Drawn {
        if (0..self.size.0).contains(&x) && (0..self.size.1).contains(&y) {
            mix(&mut self.colours[y as usize * self.size.0 as usize + x as usize], colour, colour.alpha);
        }
        Ok(())
    }
}

impl DrawingBackend for Bitmap<'_> {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        let (width, height) = self.picture.size;
        (width / FINE as u32, height / FINE as u32)
    }

    fn ensure_prepared(&mut self) -> Drawn {
        Ok(())
    }

    fn present(&mut self) -> Drawn {
        self.average();
        let texts = core::mem::take(&mut self.texts);
        texts.iter().for_each(|text| self.write(text));
        Ok(())
    }

    fn draw_pixel(&mut self, at: BackendCoord, colour: BackendColor) -> Drawn {
        let (x, y) = fine(at);
        let last = FINE * POINTS - 1;
        self.points.fill((x, y), (x + last, y + last), colour);
        Ok(())
    }

    fn draw_line<S: BackendStyle>(&mut self, from: BackendCoord, to: BackendCoord, style: &S) -> Drawn {
        self.draw_path([from, to], style)
    }

    fn draw_rect<S: BackendStyle>(&mut self, from: BackendCoord, to: BackendCoord, style: &S, fill: bool) -> Drawn {
        if fill {
            self.points.fill(fine(from), fine(to), style.color());
            return Ok(());
        }
        let ((left, top), (right, bottom)) = (from, to);
        self.draw_path([from, (right, top), to, (left, bottom), from], style)
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(&mut self, path: I, style: &S) -> Drawn {
        let style = thick(style);
        let mut path: Vec<BackendCoord> = path.into_iter().map(fine).collect();
        path.dedup();
        if style.colour.alpha == 0.0 || path.len() < 2 {
            return Ok(());
        }
        // Piece by piece: a polygon around the whole would be hollow where the path crosses itself.
        for piece in path.windows(2) {
            let around = polygonize(piece, style.width);
            fill_polygon(&mut self.points, &around, &style.colour)?;
            draw_line(&mut self.points, piece[0], piece[1], &style.colour)?;
        }
        Ok(())
    }

    fn draw_circle<S: BackendStyle>(&mut self, at: BackendCoord, radius: u32, style: &S, fill: bool) -> Drawn {
        draw_circle(&mut self.points, fine(at), radius * (FINE * POINTS) as u32, &thick(style), fill)
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(&mut self, path: I, style: &S) -> Drawn {
        let path: Vec<BackendCoord> = path.into_iter().map(fine).collect();
        fill_polygon(&mut self.points, &path, &thick(style))
    }

    fn draw_text<S: BackendTextStyle>(&mut self, text: &str, style: &S, at: BackendCoord) -> Drawn {
        let anchor = style.anchor();
        self.texts.push(Text {
            text: text.to_owned(),
            at,
            anchor: (anchor.h_pos, anchor.v_pos),
            transform: style.transform(),
            colour: style.color(),
        });
        Ok(())
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        _: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<Infallible>> {
        let (width, height) = extent(text);
        Ok(((width / FINE) as u32, (height / FINE) as u32))
    }
}

impl Picture {
    /// As PNG.
    pub(crate) fn png(&self) -> Result<Vec<u8>, png::EncodingError> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.size.0, self.size.1);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.write_header()?.write_image_data(&self.pixels)?;
        Ok(bytes)
    }
}
