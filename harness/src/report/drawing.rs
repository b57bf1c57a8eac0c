//! The drawing of a part (SVG): stock, asked and got, to scale, as a workshop draws it.
//!
//! An A4 sheet across, in mm: the half section with its dimensions, under it how far the part is from what was asked
//! for along the same axis, and a title block. ISO 128 (lines), 129-1 (dimensions) and 5455 (scales), as far as they
//! go.

use std::fmt::{Display, Write};

use torno_part::{Place, Profile, Side, deviations, outline};
use torno_plot::escaped;

use super::{Measure, PartSummary};
use torno_machines::workpiece::Part;
use torno_machines::workpiece::Turned;

const SHEET: (f64, f64) = (297.0, 210.0);
const MARGIN: f64 = 10.0;
/// Scales, the largest first: paper over part.
const SCALES: [(f64, &str); 9] = [
    (10.0, "10:1"),
    (5.0, "5:1"),
    (2.0, "2:1"),
    (1.0, "1:1"),
    (0.5, "1:2"),
    (0.2, "1:5"),
    (0.1, "1:10"),
    (0.05, "1:20"),
    (0.02, "1:50"),
];
/// What the bar may take of the sheet, between its dimensions.
const ROOM: (f64, f64) = (185.0, 62.0);
/// Where the bar's axis lies.
const AXIS: f64 = 62.0;
/// A jaw of the chuck, and how far the bar is drawn beyond it.
const JAW: (f64, f64) = (16.0, 12.0);
const IN_CHUCK: f64 = 22.0;
/// From one dimension line to the next.
const DIMENSION: f64 = 7.0;
/// So many dimensions and rows have a place.
const MOST: usize = 5;
/// The strip of deviations: its middle and half its height.
const STRIP: (f64, f64) = (148.0, 9.0);
const TITLE: (f64, f64) = (120.0, 36.0);
/// A drawn outline is so near to the true one, in mm of paper.
const FINE: f64 = 0.01;

/// What it looks like; the sheet can be a part of a page with a style of its own.
const STYLE: &str = "
.sheet text { font-family: Helvetica, Arial, 'Liberation Sans', sans-serif; font-size: 3.2px; fill: #111; }
.sheet .small { font-size: 2.6px; } .sheet .large { font-size: 5px; font-weight: bold; } .sheet .grey { fill: #555; }
.sheet line, .sheet path, .sheet rect, .sheet polyline { fill: none; stroke: #111; stroke-width: 0.18; }
.sheet .frame, .sheet .got { stroke-width: 0.5; stroke-linejoin: round; } .sheet .edge { stroke-width: 0.35; }
.sheet .asked { stroke: #0057b8; stroke-width: 0.25; stroke-dasharray: 2 0.8; }
.sheet .stock { stroke: #777; stroke-width: 0.25; stroke-dasharray: 6 1 0.6 1 0.6 1; }
.sheet .axis { stroke-width: 0.18; stroke-dasharray: 8 1 1 1; }
.sheet .grid { stroke: #ccc; } .sheet .dimension { stroke: #333; } .sheet .arrow { fill: #333; stroke: none; }
.sheet .thick { fill: #f2a3a0; stroke: none; } .sheet .thin { fill: #9cc3ef; stroke: none; }
.sheet .paper { fill: #fff; stroke: #fff; } .sheet .hatched { fill: url(#hatch); stroke: none; }
.sheet .jaw { fill: #e4e4e4; stroke: #555; stroke-width: 0.3; }
.sheet .worst { fill: #b00020; } .sheet .leader { stroke: #b00020; } .sheet .wrong { fill: #b00020; stroke: none; }
.sheet .halo { paint-order: stroke; stroke: #fff; stroke-width: 0.8px; stroke-linejoin: round; }
";

/// About how wide a character of a dimension is, in mm.
const CHARACTER: f64 = 1.76;

/// What is drawn.
#[derive(Clone, Copy, Debug)]
pub struct Drawing<'a> {
    /// The rig's name.
    pub rig: &'a str,
    /// The program's name.
    pub program: &'a str,
    /// What the rig turns.
    pub part: &'a Part,
    /// The part that came of it.
    pub turned: &'a Turned,
    /// The part that the program asked for, if that is known.
    pub asked: Option<&'a Profile>,
    /// What is told of both.
    pub summary: &'a PartSummary,
}

/// A sheet that is being drawn on, and where the part lies on it.
struct Sheet {
    svg: String,
    scale: f64,
    /// Where the bar's face is.
    face: f64,
}

impl Drawing<'_> {
    /// The drawing, as the text of an SVG file.
    pub fn svg(&self) -> String {
        let (bar, out) = (self.part.diameter, self.part.out);
        let fits = |scale: f64| bar * scale <= ROOM.1 && out * scale <= ROOM.0;
        let (scale, name) = SCALES.into_iter().find(|(scale, _)| fits(*scale)).unwrap_or((0.02, "1:50"));
        // In the middle of what the dimensions at the right leave.
        let left = MARGIN + IN_CHUCK + 4.0;
        let face = left + (ROOM.0 + out * scale) / 2.0;
        let mut sheet = Sheet { svg: String::new(), scale, face };
        sheet.begin(self.program);
        self.draw_fills(&mut sheet);
        self.draw_chuck(&mut sheet);
        self.draw_outlines(&mut sheet);
        self.draw_diameters(&mut sheet);
        self.draw_lengths(&mut sheet);
        self.draw_worst(&mut sheet);
        self.draw_strip(&mut sheet);
        self.draw_legend(&mut sheet);
        self.draw_notes(&mut sheet);
        self.draw_title(&mut sheet, name);
        sheet.svg.push_str("</svg>\n");
        sheet.svg
    }

    /// What is drawn of a profile, from the face on.
    fn corners(radii: &[f64], sheet: &Sheet) -> Vec<Place> {
        outline(radii, FINE / sheet.scale)
    }

    fn turned(measures: &[Measure]) -> impl Iterator<Item = &Measure> {
        measures.iter().filter(|measure| !measure.stock)
    }

    /// The cylinder that was asked for where one was turned.
    fn asked_for(&self, got: &Measure) -> Option<&Measure> {
        let shared = |asked: &&Measure| asked.from_mm.min(got.from_mm) - asked.to_mm.max(got.to_mm);
        Self::turned(self.summary.asked.as_deref().unwrap_or_default())
            .max_by(|a, b| shared(a).total_cmp(&shared(b)))
            .filter(|asked| shared(asked) > got.length_mm / 2.0)
    }

    fn draw_fills(&self, sheet: &mut Sheet) {
        if let Some(asked) = self.asked {
            self.draw_differences(asked, sheet);
        }
        let end = -self.part.out - self.in_chuck(sheet) / sheet.scale;
        let [mut outer, mut inner] = self.surfaces(&self.turned.profile, sheet);
        outer.extend([-self.part.out, end].map(|z| Place { z, x: self.part.diameter / 2.0 }));
        if self.part.bore > 0.0 {
            inner.push(Place { z: end, x: self.part.bore / 2.0 });
        }
        sheet.fill("hatched", &outer, &inner, &[-1.0]);
    }

    /// What was left on, and what was cut too deep.
    fn draw_differences(&self, asked: &Profile, sheet: &mut Sheet) {
        let (got, asked) = (self.turned.profile.radii(), asked.radii());
        let both: Vec<f64> = got.iter().zip(&*asked).map(|(got, asked)| got.min(*asked)).collect();
        // A bore that is too wide is cut too deep, and it is seen only where the part is cut open.
        let (thin, thick, sides) = match self.part.side {
            Side::Outside => (&asked, &got, &[1.0, -1.0][..]),
            Side::Inside => (&got, &asked, &[-1.0][..]),
        };
        for (class, radii) in [("thin", &**thin), ("thick", &**thick), ("paper", &both)] {
            let corners = Self::corners(radii, sheet);
            sheet.fill(class, &corners, &[], sides);
        }
    }

    /// The outside and the bore, from the face on; nothing without a bore.
    fn surfaces(&self, profile: &Profile, sheet: &Sheet) -> [Vec<Place>; 2] {
        let turned = Self::corners(&profile.radii(), sheet);
        let x = profile.other();
        let other = if x > 0.0 { [0.0, -self.part.out].map(|z| Place { z, x }).to_vec() } else { Vec::new() };
        if self.part.side == Side::Outside { [turned, other] } else { [other, turned] }
    }

    /// How much of the bar is drawn inside the chuck, on paper.
    fn in_chuck(&self, sheet: &Sheet) -> f64 {
        ((self.part.length - self.part.out) * sheet.scale).min(IN_CHUCK)
    }

    fn draw_chuck(&self, sheet: &mut Sheet) {
        let Part { diameter, length, out, .. } = *self.part;
        let rest = self.in_chuck(sheet);
        let (jaws, radius) = (sheet.x(-out), diameter / 2.0 * sheet.scale);
        for sign in [-1.0, 1.0] {
            let top = if sign < 0.0 { AXIS - radius - JAW.1 } else { AXIS + radius };
            sheet.rect("jaw", (jaws - JAW.0, top), JAW);
            sheet.line("got", (jaws, AXIS + sign * radius), (jaws - rest, AXIS + sign * radius));
        }
        let end = jaws - rest;
        if self.part.bore > 0.0 {
            let wall = sheet.y(-self.part.bore / 2.0);
            sheet.line("got", (jaws, wall), (end, wall));
        }
        if (length - out) * sheet.scale > rest {
            sheet.broken_off(end, radius);
        } else {
            sheet.line("got", (end, AXIS - radius), (end, AXIS + radius));
        }
        sheet.text("small grey", (jaws - JAW.0 / 2.0, AXIS - radius - JAW.1 / 2.0 + 1.0), "middle", "chuck");
    }

    fn draw_outlines(&self, sheet: &mut Sheet) {
        let out = self.part.out;
        let bar = self.part.bar();
        let known = [("stock", Some(&bar)), ("got", Some(&self.turned.profile)), ("asked", self.asked)];
        let shown = || known.into_iter().filter_map(|(class, profile)| Some((class, profile?)));
        for (sign, (class, profile)) in [1.0, -1.0].into_iter().flat_map(|sign| shown().map(move |it| (sign, it))) {
            let [outer, inner] = self.surfaces(profile, sheet);
            sheet.outline(class, &outer, sign);
            if sign < 0.0 && !inner.is_empty() {
                let points: Vec<(f64, f64)> = inner.iter().map(|it| (sheet.x(it.z), sheet.y(-it.x))).collect();
                sheet.polyline(class, &points);
            }
        }
        // Seen from outside, a shoulder is an edge across the half that is not cut open.
        let outside = if self.part.side == Side::Outside { &self.summary.cylinders[..] } else { &[] };
        for pair in outside.windows(2) {
            let (z, radius) = (pair[0].to_mm, pair[0].diameter_mm.max(pair[1].diameter_mm) / 2.0);
            sheet.line("edge", (sheet.x(z), AXIS), (sheet.x(z), sheet.y(radius)));
        }
        let left = sheet.x(-out) - IN_CHUCK - 3.0;
        sheet.line("axis", (left, AXIS), (sheet.face + 5.0, AXIS));
    }

    /// At the right: one line beyond the other, the thinnest next to the face.
    fn draw_diameters(&self, sheet: &mut Sheet) {
        let mut cylinders: Vec<&Measure> = Self::turned(&self.summary.cylinders).take(MOST).collect();
        cylinders.sort_by(|a, b| a.diameter_mm.total_cmp(&b.diameter_mm));
        let mut x = sheet.face + 9.0;
        for cylinder in cylinders {
            let (top, bottom) = (sheet.y(cylinder.diameter_mm / 2.0), sheet.y(-cylinder.diameter_mm / 2.0));
            let from = sheet.x(cylinder.from_mm) + 0.8;
            sheet.line("dimension", (from, top), (x + 1.5, top));
            sheet.line("dimension", (from, bottom), (x + 1.5, bottom));
            let asked = self.asked_for(cylinder).map(|asked| asked.diameter_mm);
            sheet.dimension((x, bottom), (x, top), &format!("Ø{}", got_and_asked(cylinder.diameter_mm, asked)));
            x += DIMENSION;
        }
        let radius = self.part.diameter / 2.0;
        let (top, bottom) = (sheet.y(radius), sheet.y(-radius));
        sheet.line("dimension", (sheet.face + 0.8, top), (x + 1.5, top));
        sheet.line("dimension", (sheet.face + 0.8, bottom), (x + 1.5, bottom));
        sheet.dimension((x, bottom), (x, top), &format!("bar Ø{}", self.part.diameter));
    }

    /// Below: all from the face.
    fn draw_lengths(&self, sheet: &mut Sheet) {
        let mut y = sheet.y(-self.part.diameter / 2.0) + 7.0;
        let mut lengths: Vec<(f64, f64, String)> = Self::turned(&self.summary.cylinders)
            .take(MOST)
            .map(|got| {
                let asked = self.asked_for(got).map(|asked| -asked.to_mm);
                (got.to_mm, got.diameter_mm / 2.0, got_and_asked(-got.to_mm, asked))
            })
            .collect();
        lengths.sort_by(|a, b| b.0.total_cmp(&a.0));
        lengths.push((-self.part.out, self.part.diameter / 2.0, format!("{} out of the chuck", self.part.out)));
        let face = match self.part.side {
            Side::Outside => self.turned.profile.radii()[0],
            Side::Inside => self.part.diameter / 2.0,
        };
        let last = y + DIMENSION * (lengths.len() - 1) as f64 + 1.5;
        sheet.line("dimension", (sheet.face, sheet.y(-face) + 0.8), (sheet.face, last));
        for (z, radius, text) in lengths {
            sheet.line("dimension", (sheet.x(z), sheet.y(-radius) + 0.8), (sheet.x(z), y + 1.5));
            sheet.dimension((sheet.x(z), y), (sheet.face, y), &text);
            y += DIMENSION;
        }
    }

    fn draw_worst(&self, sheet: &mut Sheet) {
        let Some(worst) = self.summary.worst.filter(|worst| worst.diameter_mm != 0.0) else { return };
        let radius = self.turned.profile.diameter(worst.z_mm).unwrap_or_default() / 2.0;
        // A bore is seen where the part is cut open.
        let above = if self.part.side == Side::Outside { radius } else { -radius };
        let tip = (sheet.x(worst.z_mm), sheet.y(above));
        let top = sheet.y(self.part.diameter / 2.0) - 7.0;
        sheet.line("leader", (tip.0, top + 1.0), tip);
        sheet.arrow("wrong", tip, (0.0, 1.0));
        let text = format!("worst: {:+.2} mm of diameter at z = {:.2}", worst.diameter_mm, worst.z_mm);
        let anchor = if self.part.side == Side::Outside { "middle" } else { "end" };
        sheet.text("worst halo", (tip.0, top), anchor, &text);
    }

    /// How much thicker than asked, along the bar.
    fn draw_strip(&self, sheet: &mut Sheet) {
        let Some(asked) = self.asked else { return };
        let off = deviations(&self.turned.profile, asked);
        let most = off.iter().fold(0.0, |most: f64, off| most.max(off.abs()));
        let range = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 50.0].into_iter().find(|range| *range >= most).unwrap_or(1e3);
        let (middle, half) = STRIP;
        let y = |off: f64| middle - off / range * half;
        let (left, right) = (sheet.x(-self.part.out), sheet.face);
        for (level, sign) in [(range, "+"), (0.0, ""), (-range, "−")] {
            sheet.line("grid", (left, y(level)), (right, y(level)));
            sheet.text("small", (right + 1.5, y(level) + 0.9), "start", &format!("{sign}{}", level.abs()));
        }
        let step = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0].into_iter();
        let step = step.clone().find(|step| step * sheet.scale >= 14.0).unwrap_or(500.0);
        for n in 0..=(self.part.out / step + 1e-9) as u32 {
            let x = sheet.x(-step * f64::from(n));
            sheet.line("grid", (x, middle - half), (x, middle + half));
            let label = if n == 0 { "z = 0".to_owned() } else { format!("−{}", step * f64::from(n)) };
            sheet.text("small", (x, middle + half + 3.2), "middle", &label);
        }
        let points: Vec<(f64, f64)> =
            outline(&off, range / half * 0.05).into_iter().map(|Place { z, x }| (sheet.x(z), y(x))).collect();
        sheet.polyline("edge", &points);
        let how = match self.part.side {
            Side::Outside => "thicker (+) or thinner (−)",
            Side::Inside => "narrower (+) or wider (−)",
        };
        let title = format!("{how} than asked, in mm of diameter, along the bar");
        sheet.text("small", (left, middle - half - 1.5), "start", &title);
    }

    fn draw_legend(&self, sheet: &mut Sheet) {
        let mut x = MARGIN + 6.0;
        let y = MARGIN + 6.0;
        let known = self.asked.is_some();
        for (class, text) in [("got", "got"), ("asked", "asked"), ("stock", "bar")] {
            if class == "asked" && !known {
                continue;
            }
            sheet.line(class, (x, y - 1.0), (x + 10.0, y - 1.0));
            sheet.text("small", (x + 11.5, y), "start", text);
            x += 26.0;
        }
        let differences = [("thick", "left on"), ("thin", "cut too deep")];
        for (class, text) in differences.into_iter().filter(|_| known) {
            sheet.rect(class, (x, y - 2.4), (5.0, 3.0));
            sheet.text("small", (x + 6.5, y), "start", text);
            x += 24.0;
        }
        let text = if known { "dimensions in mm: got (asked)" } else { "dimensions in mm" };
        sheet.text("small", (SHEET.0 - MARGIN - 6.0, y), "end", text);
    }

    /// What should not have happened, at the lower left.
    fn draw_notes(&self, sheet: &mut Sheet) {
        let (x, mut y) = (MARGIN + 6.0, SHEET.1 - MARGIN - TITLE.1 + 4.0);
        let events = &self.summary.events;
        if events.is_empty() {
            sheet.text("small", (x, y), "start", "Nothing happened on the way that should not have.");
        }
        for event in events.iter().take(MOST) {
            let (what, unit) = (event.text, event.unit);
            let text = format!("{what} at {:.3} s, z = {:.2}: {:.2} {unit}", event.from_s, event.z_mm, event.worst);
            sheet.text("small worst", (x, y), "start", &text);
            y += 4.0;
        }
        if events.len() > MOST {
            sheet.text("small worst", (x, y), "start", &format!("and {} more", events.len() - MOST));
        }
        let cylinders = Self::turned(&self.summary.cylinders).count();
        if cylinders > MOST {
            let more = cylinders - MOST;
            let text = format!("{more} more cylinder{}: no room for dimensions", if more == 1 { "" } else { "s" });
            sheet.text("small", (x, SHEET.1 - MARGIN - 4.0), "start", &text);
        }
    }

    fn draw_title(&self, sheet: &mut Sheet, scale: &str) {
        let (width, height) = TITLE;
        let (left, top) = (SHEET.0 - MARGIN - width, SHEET.1 - MARGIN - height);
        sheet.rect("frame", (left, top), TITLE);
        let rows = 4.0;
        let row = |n: f64| top + 10.0 + n * (height - 10.0) / rows;
        for n in [0.0, 1.0, 2.0, 3.0] {
            sheet.line("dimension", (left, row(n)), (left + width, row(n)));
        }
        let middle = left + width / 2.0;
        sheet.line("dimension", (middle, row(0.0)), (middle, row(3.0)));
        sheet.text("large", (left + 3.0, top + 6.8), "start", "turned part");
        sheet.text("small grey", (left + width - 3.0, top + 6.8), "end", "torno");
        let part = self.part;
        let nose = format!("R{}", part.nose.radius_mm());
        let bore = if part.bore > 0.0 { format!(", bore Ø{}", part.bore) } else { String::new() };
        let bar = format!("Ø{} × {}{bore}", part.diameter, part.length);
        let cells = [
            ("program", self.program.to_owned()),
            ("rig", self.rig.to_owned()),
            ("bar", bar),
            ("nose", nose),
            ("scale", scale.to_owned()),
            ("units", "mm".to_owned()),
        ];
        for (n, (name, value)) in cells.iter().enumerate() {
            let x = if n % 2 == 0 { left } else { middle };
            let y = row((n / 2) as f64) + 4.4;
            sheet.text("small grey", (x + 3.0, y), "start", name);
            sheet.text("", (x + 19.0, y), "start", &shortened(value, 24));
        }
        let worst = self.summary.worst.map_or_else(|| "what was asked is not known".to_owned(), |it| it.to_string());
        sheet.text("small grey", (left + 3.0, row(3.0) + 4.4), "start", "worst");
        sheet.text("", (left + 19.0, row(3.0) + 4.4), "start", &worst);
    }
}

/// The end of a long name: that is where files differ.
fn shortened(text: &str, most: usize) -> String {
    let count = text.chars().count();
    if count <= most {
        text.to_owned()
    } else {
        format!("…{}", text.chars().skip(count - most + 1).collect::<String>())
    }
}

fn got_and_asked(got: f64, asked: Option<f64>) -> String {
    asked.map_or_else(|| format!("{got:.2}"), |asked| format!("{got:.2} ({asked:.2})"))
}

impl Sheet {
    fn x(&self, z: f64) -> f64 {
        self.face + z * self.scale
    }

    fn y(&self, radius: f64) -> f64 {
        AXIS - radius * self.scale
    }

    /// Writing to a string cannot fail.
    fn put(&mut self, text: impl Display) {
        let _ = writeln!(self.svg, "{text}");
    }

    fn begin(&mut self, title: &str) {
        let (width, height) = SHEET;
        self.put(format_args!(
            "<svg class=\"sheet\" xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}mm\" height=\"{height}mm\" \
             viewBox=\"0 0 {width} {height}\">"
        ));
        self.put(format_args!("<title>{}</title>", escaped(title)));
        self.put(format_args!("<style>{STYLE}</style>"));
        self.put(
            "<defs><pattern id=\"hatch\" width=\"2.2\" height=\"2.2\" patternUnits=\"userSpaceOnUse\" \
             patternTransform=\"rotate(45)\"><path d=\"M0 0V2.2\" style=\"stroke-width:0.25\"/></pattern></defs>",
        );
        self.rect("paper", (0.0, 0.0), SHEET);
        self.rect("frame", (MARGIN, MARGIN), (width - 2.0 * MARGIN, height - 2.0 * MARGIN));
    }

    fn line(&mut self, class: &str, from: (f64, f64), to: (f64, f64)) {
        let ((a, b), (c, d)) = (from, to);
        self.put(format_args!("<line class=\"{class}\" x1=\"{a:.2}\" y1=\"{b:.2}\" x2=\"{c:.2}\" y2=\"{d:.2}\"/>"));
    }

    fn rect(&mut self, class: &str, (x, y): (f64, f64), (width, height): (f64, f64)) {
        self.put(format_args!(
            "<rect class=\"{class}\" x=\"{x:.2}\" y=\"{y:.2}\" width=\"{width:.2}\" height=\"{height:.2}\"/>"
        ));
    }

    fn polyline(&mut self, class: &str, points: &[(f64, f64)]) {
        let points: Vec<String> = points.iter().map(|(x, y)| format!("{x:.2},{y:.2}")).collect();
        self.put(format_args!("<polyline class=\"{class}\" points=\"{}\"/>", points.join(" ")));
    }

    fn text(&mut self, class: &str, (x, y): (f64, f64), anchor: &str, text: &str) {
        let text = escaped(text);
        self.put(format_args!(
            "<text class=\"{class}\" x=\"{x:.2}\" y=\"{y:.2}\" text-anchor=\"{anchor}\">{text}</text>"
        ));
    }

    /// The freehand line where a bar that goes on is no longer drawn.
    fn broken_off(&mut self, x: f64, radius: f64) {
        let (top, bottom, bend) = (AXIS - radius, AXIS + radius, 1.5);
        let (a, b) = (x - bend, x + bend);
        self.put(format_args!(
            "<path class=\"edge\" d=\"M{x:.2} {top:.2}C{a:.2} {AXIS} {b:.2} {AXIS} {x:.2} {bottom:.2}\"/>"
        ));
    }

    /// What lies between an inner outline, or the axis, and an outer one, on these sides of it.
    fn fill(&mut self, class: &str, outer: &[Place], inner: &[Place], sides: &[f64]) {
        let (Some(first), Some(last)) = (outer.first(), outer.last()) else { return };
        let axis = [first, last].map(|end| Place { z: end.z, x: 0.0 });
        let inner = if inner.is_empty() { &axis } else { inner };
        for side in sides {
            let around = outer.iter().chain(inner.iter().rev());
            let points: Vec<String> =
                around.map(|it| format!("{:.2} {:.2}", self.x(it.z), self.y(side * it.x))).collect();
            self.put(format_args!("<path class=\"{class}\" d=\"M{}Z\"/>", points.join("L")));
        }
    }

    /// A profile's outline, with its face, on one side of the axis.
    fn outline(&mut self, class: &str, corners: &[Place], side: f64) {
        let face = corners.first().map(|first| (self.x(first.z), AXIS));
        let corners = corners.iter().map(|corner| (self.x(corner.z), self.y(side * corner.x)));
        let points: Vec<(f64, f64)> = face.into_iter().chain(corners).collect();
        self.polyline(class, &points);
    }

    /// An arrow's head, with its tip at a place, pointing that way.
    fn arrow(&mut self, class: &str, (x, y): (f64, f64), (dx, dy): (f64, f64)) {
        let (length, half) = (2.4, 0.45);
        let (bx, by) = (x - dx * length, y - dy * length);
        let (ax, ay, cx, cy) = (bx - dy * half, by + dx * half, bx + dy * half, by - dx * half);
        self.put(format_args!("<path class=\"{class}\" d=\"M{x:.2} {y:.2}L{ax:.2} {ay:.2}L{cx:.2} {cy:.2}Z\"/>"));
    }

    /// A dimension line with its text: across, above it; upright, read from the right.
    fn dimension(&mut self, from: (f64, f64), to: (f64, f64), text: &str) {
        let ((ax, ay), (bx, by)) = (from, to);
        let length = ((bx - ax) * (bx - ax) + (by - ay) * (by - ay)).sqrt();
        if length < 1e-6 {
            return;
        }
        let way = ((bx - ax) / length, (by - ay) / length);
        // Too short for both arrows: they point inwards, from outside.
        let inwards = if length < 7.0 { -1.0 } else { 1.0 };
        self.line("dimension", from, to);
        self.arrow("arrow", from, (-way.0 * inwards, -way.1 * inwards));
        self.arrow("arrow", to, (way.0 * inwards, way.1 * inwards));
        // Nor is there room for the text then: it stands beyond the far arrow, on the line drawn longer.
        let wide = CHARACTER * text.chars().count() as f64;
        let (middle, anchor) = if wide + 1.0 > length {
            let beyond = 4.0;
            self.line("dimension", to, (bx + way.0 * (beyond + wide), by + way.1 * (beyond + wide)));
            ((bx + way.0 * beyond, by + way.1 * beyond), "start")
        } else {
            ((f64::midpoint(ax, bx), f64::midpoint(ay, by)), "middle")
        };
        let text = escaped(text);
        if ax == bx {
            let (x, y) = (middle.0 - 1.0, middle.1);
            self.put(format_args!(
                "<text class=\"halo\" transform=\"translate({x:.2} {y:.2}) rotate(-90)\" \
                 text-anchor=\"{anchor}\">{text}</text>"
            ));
        } else {
            let (x, y) = (middle.0, middle.1 - 1.0);
            self.put(format_args!(
                "<text class=\"halo\" x=\"{x:.2}\" y=\"{y:.2}\" text-anchor=\"{anchor}\">{text}</text>"
            ));
        }
    }
}
