//! A way of lines and arcs, as a program asks for it.

use core::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::Nose;

/// An angle that is beyond the end of an arc by no more than this is on it: the noise of floating point.
const NOISE: f64 = 1e-12;

/// Where the tool's tip is, in mm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// Along the axis.
    pub z: f64,
    /// From the axis.
    pub x: f64,
}

/// A way of the tool's tip.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Path {
    /// Where it begins.
    pub start: Place,
    /// What follows.
    pub moves: Vec<Move>,
}

/// A part of a way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Move {
    /// Straight to a place.
    Line(Place),
    /// Along a circle.
    Arc(Arc),
}

/// A part of a circle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arc {
    /// Where it ends.
    pub to: Place,
    /// Its centre.
    pub centre: Place,
    /// Its sense, with z to the right and x upwards.
    pub clockwise: bool,
    /// Turns, the last one included: 1 is what is between its ends, or all around if they are the same.
    pub turns: u32,
}

impl Move {
    /// Where it ends.
    pub const fn end(&self) -> Place {
        match self {
            Self::Line(to) => *to,
            Self::Arc(arc) => arc.to,
        }
    }
}

impl Arc {
    /// The angle from its start to its end, in radians: above 0 if it is counterclockwise.
    pub(crate) fn swept(&self, from: Place) -> f64 {
        let (start, end) = (angle(self.centre, from), angle(self.centre, self.to));
        let sense = if self.clockwise { -1.0 } else { 1.0 };
        let once = positive((end - start) * sense);
        let once = if once <= NOISE { TAU } else { once };
        sense * (once + TAU * f64::from(self.turns.saturating_sub(1)))
    }
}

impl Path {
    /// Places along it, each move on its own from its begin to its end: on an arc, straight lines between them are
    /// nowhere further from it than `within`, in mm.
    pub fn places(&self, within: f64) -> impl Iterator<Item = Vec<Place>> + '_ {
        let begins = core::iter::once(self.start).chain(self.moves.iter().map(Move::end));
        begins.zip(&self.moves).map(move |(from, step)| match step {
            Move::Line(to) => vec![from, *to],
            Move::Arc(arc) => {
                let (radius, start, swept) = (distance(arc.centre, from), angle(arc.centre, from), arc.swept(from));
                let step = 2.0 * libm::acos((1.0 - within / radius).clamp(-1.0, 1.0));
                let count = (swept.abs() / step.max(1e-3)).ceil().max(1.0) as u32;
                let on = |n: u32| around(arc.centre, radius, start + swept * f64::from(n) / f64::from(count));
                core::iter::once(from).chain((1..count).map(on)).chain([arc.to]).collect()
            }
        })
    }
}

fn distance(centre: Place, place: Place) -> f64 {
    libm::hypot(place.z - centre.z, place.x - centre.x)
}

fn angle(centre: Place, place: Place) -> f64 {
    libm::atan2(place.x - centre.x, place.z - centre.z)
}

fn around(centre: Place, radius: f64, angle: f64) -> Place {
    Place { z: centre.z + radius * libm::cos(angle), x: centre.x + radius * libm::sin(angle) }
}

/// An angle in 0 to 2π.
fn positive(angle: f64) -> f64 {
    let rest = libm::fmod(angle, TAU);
    if rest < 0.0 { rest + TAU } else { rest }
}

/// The lowest that a nose comes on an arc: exactly, as it can only be the lowest at a point at few places of the arc.
pub(crate) struct ArcSweep<'a> {
    nose: &'a Nose,
    centre: Place,
    radius: f64,
    start: f64,
    swept: f64,
}

impl<'a> ArcSweep<'a> {
    pub(crate) fn new(nose: &'a Nose, from: Place, centre: Place, swept: f64) -> Self {
        Self { nose, centre, radius: distance(centre, from), start: angle(centre, from), swept }
    }

    pub(crate) fn end(&self) -> Place {
        self.at(self.start + self.swept)
    }

    /// Its extent along the axis.
    pub(crate) fn along(&self) -> (f64, f64) {
        let z = [0.0, PI].into_iter().filter(|angle| self.has(*angle)).chain(self.ends()).map(|angle| self.at(angle).z);
        z.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), z| (least.min(z), most.max(z)))
    }

    /// How low it comes.
    pub(crate) fn lowest(&self) -> f64 {
        let down = Some(-FRAC_PI_2).filter(|angle| self.has(*angle));
        down.into_iter().chain(self.ends()).map(|angle| self.at(angle).x).fold(f64::INFINITY, f64::min)
    }

    /// The lowest edge above a point of the axis. Where the edge has a slope it is where the arc has that slope; else
    /// at the ends of the arc, or where the edge changes from a straight part to the round one.
    pub(crate) fn height(&self, z: f64) -> f64 {
        let nose = self.nose;
        let round = nose.radius_mm();
        let across = |way: f64, radius: f64| {
            let cosine = (way - self.centre.z) / radius;
            let angle = if cosine.abs() <= 1.0 { libm::acos(cosine) } else { f64::NAN };
            [angle, -angle]
        };
        let parallel = nose.slopes().map(|slope| libm::atan2(1.0, -slope));
        let touching = [self.radius + round, self.radius - round].map(|radius| across(z - round, radius));
        let changing = nose.changes().map(|change| across(z - change, self.radius));
        let inner = touching.into_iter().chain(changing).flatten().chain(parallel).chain(parallel.map(|it| it + PI));
        let height = |angle: f64| {
            let tip = self.at(angle);
            tip.x + nose.height(z - tip.z)
        };
        inner.filter(|angle| self.has(*angle)).chain(self.ends()).map(height).fold(f64::INFINITY, f64::min)
    }

    fn at(&self, angle: f64) -> Place {
        around(self.centre, self.radius, angle)
    }

    const fn ends(&self) -> [f64; 2] {
        [self.start, self.start + self.swept]
    }

    fn has(&self, angle: f64) -> bool {
        positive((angle - self.start) * self.swept.signum()) <= self.swept.abs() + NOISE
    }
}
