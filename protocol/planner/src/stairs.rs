//! Staircases: what a straight cut or an arc becomes, as a frame moves one axis.
//!
//! A path is cut into sections on which neither axis turns back. On each the ideal radius reaches the thresholds
//! between the slide's places one after the other: there the feed stops, and the slide goes a slot.

use core::f64::consts::{FRAC_PI_2, TAU};

use torno_gcode::Turn;
use torno_part::Place;

use crate::place::{Side, Slide};

/// Less is the noise of floating point, in mm.
const NOISE: f64 = 1e-9;
/// Chords stand for an arc where the part is cut, so near to it, in mm.
const SAGITTA: f64 = 0.001;
/// An arc of this angle or less has no length: it is a full turn, as in the interpreter.
const NO_ANGLE: f64 = 1e-12;

/// A part of a path on which neither axis turns back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Section {
    pub(crate) from: Place,
    pub(crate) to: Place,
    /// Of an arc: the centre, the radius, and whether it lies at greater `z` than the centre.
    round: Option<(Place, f64, bool)>,
}

impl Section {
    pub(crate) const fn straight(from: Place, to: Place) -> Self {
        Self { from, to, round: None }
    }

    /// Where the path has a radius that lies between those of its ends.
    fn z_at(&self, x: f64) -> f64 {
        let Self { from, to, round } = *self;
        let z = match round {
            None => from.z + (x - from.x) * ((to.z - from.z) / (to.x - from.x)),
            Some((centre, radius, right)) => {
                let up = x - centre.x;
                let along = (radius * radius - up * up).max(0.0).sqrt();
                if right { centre.z + along } else { centre.z - along }
            }
        };
        z.clamp(from.z.min(to.z), from.z.max(to.z))
    }

    /// Whether radii grow along it; None if they are the same.
    pub(crate) fn grows(&self) -> Option<bool> {
        let grown = self.to.x - self.from.x;
        (grown.abs() > NOISE).then_some(grown > 0.0)
    }

    /// Whether it goes along the bar at all.
    pub(crate) fn feeds(&self) -> bool {
        (self.to.z - self.from.z).abs() > NOISE
    }

    /// The next place of the slide on this section, and the ideal place at which it goes there.
    pub(crate) fn next(&self, slide: &Slide, side: Side, away: bool) -> Option<(Place, Slide)> {
        let grows = self.grows()?;
        let next = slide.next(grows);
        let threshold = match side {
            Side::Middle => f64::midpoint(slide.x(), next.x()),
            Side::Outside if grows == away => slide.x() + if grows { NOISE } else { -NOISE },
            Side::Outside => next.x(),
        };
        let beyond = if grows { self.to.x - threshold } else { threshold - self.to.x };
        let reached = if side == Side::Outside && grows != away { beyond >= -NOISE } else { beyond > NOISE };
        reached.then(|| {
            let x = threshold.clamp(self.from.x.min(self.to.x), self.from.x.max(self.to.x));
            (Place { z: self.z_at(x), x }, next)
        })
    }

    /// Chords that stand for it, as the places at which they end.
    pub(crate) fn chords(&self) -> impl Iterator<Item = Place> {
        let Self { from, to, round } = *self;
        let (count, first, step) = match round {
            None => (1, 0.0, 0.0),
            Some((centre, radius, _)) => {
                let first = libm::atan2(from.x - centre.x, from.z - centre.z);
                let last = libm::atan2(to.x - centre.x, to.z - centre.z);
                let turn = libm::remainder(last - first, TAU);
                let chord = 2.0 * libm::acos((1.0 - SAGITTA / radius).max(0.0));
                let count = (turn.abs() / chord).ceil().clamp(1.0, 1e4);
                (count as u32, first, turn / count)
            }
        };
        (1..=count).map(move |nth| match round {
            Some((centre, radius, _)) if nth < count => {
                let angle = first + step * f64::from(nth);
                Place { z: centre.z + radius * libm::cos(angle), x: centre.x + radius * libm::sin(angle) }
            }
            _ => to,
        })
    }
}

/// The sections of a path, one by one: an arc may have any number of turns.
#[derive(Clone, Debug)]
pub(crate) enum Sections {
    None,
    Straight(Section),
    Round(Round),
}

/// What is left of an arc.
#[derive(Clone, Debug)]
pub(crate) struct Round {
    at: Place,
    to: Place,
    centre: Place,
    radius: f64,
    /// Counterclockwise, from Z to X: 1, else −1.
    sense: i64,
    /// The quadrants' borders are numbered in the sense of the arc; at the last one nothing but the end follows.
    next: i64,
    last: i64,
    done: bool,
}

impl Round {
    /// An arc around a centre. If the radii at its ends differ, as an interpreter allows within limits, the centre is
    /// put where they are the same.
    pub(crate) fn new(from: Place, to: Place, centre: Place, turn: Turn, turns: u32) -> Self {
        let centre = centred(from, to, centre);
        let sense = if turn == Turn::Counterclockwise { 1 } else { -1 };
        let angle = |place: Place| sense as f64 * libm::atan2(place.x - centre.x, place.z - centre.z);
        let first = angle(from);
        let mut swept = angle(to) - first;
        if swept < 0.0 {
            swept += TAU;
        }
        if swept <= NO_ANGLE {
            swept += TAU;
        }
        swept += TAU * f64::from(turns.saturating_sub(1));
        // A border at an end is none.
        let border = |angle: f64, noise: f64| (angle / FRAC_PI_2 + noise).floor() as i64;
        Self {
            at: from,
            to,
            centre,
            radius: libm::hypot(from.x - centre.x, from.z - centre.z),
            sense,
            next: border(first, NOISE) + 1,
            last: border(first + swept, -NOISE),
            done: false,
        }
    }

    /// A border of quadrants.
    fn border(&self, number: i64) -> Place {
        let Self { centre, radius, .. } = *self;
        let (z, x) = match (number * self.sense).rem_euclid(4) {
            0 => (radius, 0.0),
            1 => (0.0, radius),
            2 => (-radius, 0.0),
            _ => (0.0, -radius),
        };
        Place { z: centre.z + z, x: centre.x + x }
    }
}

/// The place on the perpendicular bisector of two places that is nearest to a centre.
fn centred(from: Place, to: Place, centre: Place) -> Place {
    let (dz, dx) = (to.z - from.z, to.x - from.x);
    let square = dz * dz + dx * dx;
    if square <= NOISE * NOISE {
        return centre;
    }
    let along = (centre.z - f64::midpoint(from.z, to.z)) * dz + (centre.x - f64::midpoint(from.x, to.x)) * dx;
    Place { z: centre.z - along / square * dz, x: centre.x - along / square * dx }
}

impl Iterator for Sections {
    type Item = Section;

    fn next(&mut self) -> Option<Section> {
        match self {
            Self::None => None,
            Self::Straight(section) => {
                let section = *section;
                *self = Self::None;
                Some(section)
            }
            Self::Round(round) => round.next(),
        }
    }
}

impl Iterator for Round {
    type Item = Section;

    fn next(&mut self) -> Option<Section> {
        if self.done {
            return None;
        }
        let from = self.at;
        let to = if self.next <= self.last { self.border(self.next) } else { self.to };
        self.done = self.next > self.last;
        self.next += 1;
        self.at = to;
        let right = f64::midpoint(from.z, to.z) >= self.centre.z;
        Some(Section { from, to, round: Some((self.centre, self.radius, right)) })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const CENTRE: Place = Place { z: -10.0, x: 20.0 };

    fn on(degrees: f64) -> Place {
        let angle = degrees.to_radians();
        Place { z: CENTRE.z + 5.0 * libm::cos(angle), x: CENTRE.x + 5.0 * libm::sin(angle) }
    }

    fn ends(from: f64, to: f64, turn: Turn, turns: u32) -> Vec<(f64, f64)> {
        let round = Round::new(on(from), on(to), CENTRE, turn, turns);
        let tidy = |value: f64| (value * 1e6).round() / 1e6 + 0.0;
        round.map(|section| (tidy(section.to.z - CENTRE.z), tidy(section.to.x - CENTRE.x))).collect()
    }

    #[test]
    fn an_arc_is_cut_at_the_borders_of_quadrants_and_nowhere_else() {
        use Turn::{Clockwise, Counterclockwise};
        assert_eq!(ends(0.0, 90.0, Counterclockwise, 1), [(0.0, 5.0)]);
        assert_eq!(ends(90.0, 0.0, Clockwise, 1), [(5.0, 0.0)]);
        assert_eq!(ends(0.0, 90.0, Clockwise, 1), [(0.0, -5.0), (-5.0, 0.0), (0.0, 5.0)]);
        assert_eq!(ends(180.0, 360.0, Counterclockwise, 1), [(0.0, -5.0), (5.0, 0.0)]);
        let full = ends(0.0, 0.0, Counterclockwise, 1);
        assert_eq!(full, [(0.0, 5.0), (-5.0, 0.0), (0.0, -5.0), (5.0, 0.0)]);
        assert_eq!(ends(0.0, 0.0, Counterclockwise, 2), [&full[..], &full].concat());
        assert_eq!(ends(-36.869_897_645_844_02, 36.869_897_645_844_02, Counterclockwise, 1), [(5.0, 0.0), (4.0, 3.0)]);
    }

    #[test]
    fn an_arc_with_two_radii_gets_a_centre_with_one() {
        let (from, to) = (on(0.0), Place { z: -10.0, x: 25.02 });
        let found = centred(from, to, CENTRE);
        let radius = |place: Place| libm::hypot(place.z - found.z, place.x - found.x);
        assert!((radius(from) - radius(to)).abs() < 1e-12);
        assert!(libm::hypot(found.z - CENTRE.z, found.x - CENTRE.x) < 0.02);
    }

    #[test]
    fn chords_stay_near_the_arc() {
        let section = Round::new(on(0.0), on(90.0), CENTRE, Turn::Counterclockwise, 1).next().unwrap();
        let mut from = section.from;
        let mut count = 0;
        for to in section.chords() {
            let middle = libm::hypot(f64::midpoint(from.z, to.z) - CENTRE.z, f64::midpoint(from.x, to.x) - CENTRE.x);
            assert!((5.0 - SAGITTA..=5.0).contains(&middle), "{middle}");
            (from, count) = (to, count + 1);
        }
        assert_eq!((from, count), (section.to, 40));
    }

    proptest! {
        #[test]
        fn sections_join_and_neither_axis_turns_back_on_one(
            (from, to) in (-720.0..720.0, -720.0..720.0),
            clockwise: bool,
            turns in 1..4_u32,
        ) {
            let turn = if clockwise { Turn::Clockwise } else { Turn::Counterclockwise };
            let mut at = on(from);
            let mut count = 0;
            for section in Round::new(on(from), on(to), CENTRE, turn, turns) {
                prop_assert_eq!(section.from, at);
                let (a, b) = (section.from, section.to);
                for chord in section.chords() {
                    let between = |value: f64, one: f64, other: f64| {
                        (one.min(other) - 1e-9..=one.max(other) + 1e-9).contains(&value)
                    };
                    prop_assert!(between(chord.z, a.z, b.z) && between(chord.x, a.x, b.x));
                    prop_assert!((section.z_at(chord.x) - chord.z).abs() < 1e-3);
                }
                (at, count) = (section.to, count + 1);
            }
            prop_assert_eq!(at, on(to));
            prop_assert!(count <= 4 * turns + 1, "{}", count);
        }
    }
}
