//! The way of the tool that a program of G-code asks for, and its picture: what is asked, what is played, what comes of
//! it.

use torno_gcode::{Kind, Motion, Place as Position, Plane, Turn};
use torno_machines::workpiece::Part;
use torno_part::{Arc, GRID, Move, Path, Place, Profile, outline};
use torno_plot::{Figure, Panel, Series, Style};
use torno_protocol::lathe::Program;

/// What is drawn is so near to what is meant, in mm.
const FINE: f64 = 0.002;

/// The way that canonical motions ask for.
#[derive(Clone, Debug)]
pub struct Asked {
    /// The way, as the bar sees it.
    pub path: Path,
    /// How each of its moves is made.
    ways: Vec<MotionKind>,
    /// From the program's places to the bar's.
    shift: Place,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum MotionKind {
    Rapid,
    Feed,
    Arc,
}

impl Asked {
    /// A way that begins where the tool stands, `at` by the bar's places, which the program calls `start`.
    pub fn new(at: Place, start: Place) -> Self {
        let shift = Place { z: at.z - start.z, x: at.x - start.x };
        Self { path: Path { start: at, moves: Vec::new() }, ways: Vec::new(), shift }
    }

    /// The next motion. What does not move the tool in the plane of X and Z is passed over.
    pub fn take(&mut self, motion: &Motion) {
        let to = |to: Position| self.at(to.z, to.x);
        let (way, step) = match &motion.kind {
            Kind::Rapid { to: end } => (MotionKind::Rapid, Move::Line(to(*end))),
            Kind::Arc { to: end, plane: Plane::Zx, centre: [z, x], turn, turns, .. } => {
                let clockwise = *turn == Turn::Clockwise;
                (MotionKind::Arc, Move::Arc(Arc { to: to(*end), centre: self.at(*z, *x), clockwise, turns: *turns }))
            }
            Kind::Feed { to: end, .. } | Kind::Arc { to: end, .. } => (MotionKind::Feed, Move::Line(to(*end))),
            _ => return,
        };
        self.path.moves.push(step);
        self.ways.push(way);
    }

    fn at(&self, z: f64, x: f64) -> Place {
        Place { z: z + self.shift.z, x: x + self.shift.x }
    }

    fn pieces(&self, wanted: MotionKind) -> Vec<Vec<(f64, f64)>> {
        let places = self.path.places(FINE).zip(&self.ways).filter(|(_, way)| **way == wanted);
        places.map(|(places, _)| points(&places)).collect()
    }
}

fn points(places: &[Place]) -> Vec<(f64, f64)> {
    places.iter().map(|place| (place.z, place.x)).collect()
}

/// Where frames ask the tool of a rig to be, one after the other: the stairs.
pub fn stairs(part: &Part, program: &Program) -> Vec<Place> {
    let to = program.destinations().into_iter().map(|to| part.place(to.transverse, to.depth));
    core::iter::once(part.place(0, 0)).chain(to).collect()
}

/// What is in a picture.
#[derive(Clone, Debug)]
pub struct Picture<'a> {
    /// Its title.
    pub title: &'a str,
    /// What the program asks for.
    pub asked: &'a Asked,
    /// The bar, and the tool.
    pub part: &'a Part,
    /// The places that frames lead to, if there are frames.
    pub stairs: &'a [Place],
    /// The part that a run has turned, if there was one.
    pub turned: Option<&'a Profile>,
}

impl Picture<'_> {
    /// The picture: the axis of the bar across, the distance from it upwards. Above all of it to scale, below what the
    /// tool goes along, stretched.
    pub fn figure(&self) -> Figure {
        let whole = self.panel("x, mm (radius)", None).to_scale();
        let places = || self.asked.path.places(FINE).flatten().chain(self.stairs.iter().copied()).map(|place| place.z);
        let ends = (places().fold(f64::INFINITY, f64::min), places().fold(f64::NEG_INFINITY, f64::max));
        // Where the tool goes nowhere, there is nothing to see closer.
        let near = (ends.0 <= ends.1).then(|| self.panel("x, mm (radius), stretched", Some(ends)));
        Figure { title: self.title.to_owned(), panels: core::iter::once(whole).chain(near).collect() }
    }

    /// All of it, or what lies between two places along the axis.
    fn panel(&self, x: &str, between: Option<(f64, f64)>) -> Panel {
        let Self { asked, part, stairs, turned, .. } = self;
        let surface = |profile: &Profile| match between {
            None => {
                let mut corners = points(&outline(&profile.radii(), FINE));
                // With the face, from the other surface on.
                corners.insert(0, (0.0, profile.other()));
                corners
            }
            Some((least, most)) => {
                let radii = profile.radii();
                let point = |z: f64| ((-z / GRID).max(0.0) as usize).min(radii.len() - 1);
                let (first, last) = (point(most), point(least));
                let corners = outline(&radii[first..=last], FINE);
                corners.into_iter().map(|corner| (corner.z + Profile::z(first), corner.x)).collect()
            }
        };
        let mut stock = vec![surface(&part.bar())];
        if between.is_none() && part.bore > 0.0 {
            let tube = |diameter: f64| vec![(0.0, diameter / 2.0), (-part.out, diameter / 2.0)];
            stock.extend([part.bore, part.diameter].map(tube));
        }
        let series = [
            ("stock", Style::Thin, stock),
            ("frames", Style::Line, if stairs.is_empty() { Vec::new() } else { vec![points(stairs)] }),
            ("turned", Style::Line, turned.map(surface).into_iter().collect()),
            ("wanted", Style::Line, vec![surface(&part.contour(&asked.path))]),
            ("rapid", Style::Dashed, asked.pieces(MotionKind::Rapid)),
            ("feed", Style::Line, asked.pieces(MotionKind::Feed)),
            ("arc", Style::Line, asked.pieces(MotionKind::Arc)),
        ];
        let series = series.into_iter().filter(|(_, _, pieces)| !pieces.is_empty());
        let series = series.map(|(name, style, pieces)| Series::pieces(name, style, pieces)).collect();
        Panel { x: "z, mm".to_owned(), y: x.to_owned(), height: 1.0, series }
    }
}

#[cfg(test)]
mod tests {
    use torno_gcode::{Settings, interpret};

    use super::*;
    use crate::rig::file::RigFile;

    fn asked(text: &str, part: &Part) -> Asked {
        let start = part.place(0, 0);
        let settings =
            Settings { start: Position { x: start.x, z: start.z, ..Position::default() }, ..Settings::default() };
        let (motions, outcome) = interpret(text.as_bytes(), &settings);
        assert!(!outcome.is_refused(), "{outcome:?}");
        let mut asked = Asked::new(start, start);
        motions.iter().for_each(|motion| asked.take(motion));
        asked
    }

    const PROGRAM: &str = "G21 G18 G7 G90\nM3 S1500\nG0 X24 Z1\nG1 Z-10 F60\nG2 X28 Z-12 R2\nG0 X30\nG0 Z1\nM2\n";

    #[test]
    fn lines_and_arcs_are_swept_as_the_program_asks() {
        let part = RigFile::load("lathe").unwrap().part.unwrap();
        let contour = part.contour(&asked(PROGRAM, &part).path);
        assert_eq!(contour.diameter(-9.0), Some(24.0));
        // A fillet of 2 mm, and the nose's 0.4 beyond: its middle is 0.4 from the program's, which is (-10, 14).
        let fillet = |z: f64| 2.0 * (14.4 - (2.4_f64 * 2.4 - (z + 9.6) * (z + 9.6)).sqrt());
        for z in [-10.0, -11.0, -11.5] {
            assert!((contour.diameter(z).unwrap() - fillet(z).min(28.0)).abs() < 1e-9, "{z}");
        }
        assert_eq!(contour.diameter(-12.5), Some(28.0));
    }

    #[test]
    fn a_picture_shows_what_there_is() {
        let part = RigFile::load("lathe").unwrap().part.unwrap();
        let asked = asked(PROGRAM, &part);
        let program = Program::parse("4B 00 00 00 00 00 05 01\n4B 46 23 28 01 00 00 00").unwrap();
        let stairs = stairs(&part, &program);
        assert_eq!(stairs.len(), 3);
        let names = |picture: &Picture<'_>| -> Vec<String> {
            picture.figure().panels[0].series.iter().map(|series| series.name.clone()).collect()
        };
        let bare = Picture { title: "x", asked: &asked, part: &part, stairs: &[], turned: None };
        assert_eq!(names(&bare), ["stock", "wanted", "rapid", "feed", "arc"]);
        let turned = part.asked(&program);
        let whole = Picture { stairs: &stairs, turned: Some(&turned), ..bare };
        assert_eq!(names(&whole), ["stock", "frames", "turned", "wanted", "rapid", "feed", "arc"]);
        let still = Asked::new(asked.path.start, Place::default());
        assert_eq!(Picture { asked: &still, ..bare }.figure().panels.len(), 1);
        // Below, nothing is drawn of what the tool does not come to.
        let near = &whole.figure().panels[1].series;
        assert!(near.iter().all(|series| series.points.iter().all(|(z, _)| z.is_nan() || *z >= -20.0)), "{near:?}");
    }

    #[test]
    fn the_program_may_call_the_start_by_another_name() {
        let at = Place { z: 0.0, x: 14.5 };
        let mut asked = Asked::new(at, Place { z: 2.0, x: 0.0 });
        let to = Position { x: -1.0, z: -3.0, ..Position::default() };
        asked.take(&Motion { line: 1, kind: Kind::Rapid { to } });
        assert_eq!(asked.path.moves, [Move::Line(Place { z: -5.0, x: 13.5 })]);
    }
}
