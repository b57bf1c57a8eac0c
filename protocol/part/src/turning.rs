//! Turning: the tool goes its way, and what should not happen on it is noted.

use crate::{Nose, Place, Profile, Shaving};

/// Less is no cut, in mm of radius: it is how well the place of the tool is known.
const TOUCH: f64 = 0.001;
/// The depth of a cut is the mean over so much of the way, in mm.
const MEAN_OVER: f64 = 0.25;
/// What happens again within this is the same happening, in s.
const AGAIN: f64 = 1.0;

/// What should not happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Violation {
    /// The tool cuts, and the spindle stands.
    Stopped,
    /// The tool cuts at a rapid's speed.
    Rapid,
    /// The tool is where the chuck is.
    Chuck,
    /// The cut is deeper than is allowed.
    Deep,
    /// The tool cuts through to the surface on the other side.
    Wall,
}

impl Violation {
    /// Every one.
    pub const ALL: [Self; 5] = [Self::Stopped, Self::Rapid, Self::Chuck, Self::Deep, Self::Wall];

    /// Its name in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Stopped => "stopped",
            Self::Rapid => "rapid",
            Self::Chuck => "chuck",
            Self::Deep => "deep",
            Self::Wall => "wall",
        }
    }

    /// What it is, for people.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Stopped => "cutting with a stopped spindle",
            Self::Rapid => "rapid into the stock",
            Self::Chuck => "past the chuck",
            Self::Deep => "too deep a cut",
            Self::Wall => "through the wall",
        }
    }

    /// What its worst is counted in.
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Stopped => "mm off the radius",
            Self::Rapid => "mm/s",
            Self::Chuck => "mm beyond its jaws",
            Self::Deep => "mm deep",
            Self::Wall => "mm beyond it",
        }
    }
}

/// Something that should not have happened, and did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Happening {
    /// What.
    pub event: Violation,
    /// When it began and when it was last seen, in s.
    pub at: (f64, f64),
    /// Where the tool was when it began.
    pub place: Place,
    /// The most of it, in its [`Violation::unit`].
    pub worst: f64,
}

/// What is allowed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Above this feed, in mm/s, the tool must cut nothing.
    pub feed: f64,
    /// The deepest cut, in mm: the area that is taken off for each mm of way. None: any.
    pub depth: Option<f64>,
    /// Nearer to the axis than this, in mm, the tool must not go beyond the jaws. None: nowhere.
    pub chuck: Option<f64>,
}

/// How coarsely the tool's place is known, in mm: what is added to a count may have been gone before.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Resolution {
    /// Along the axis.
    pub z: f64,
    /// From the axis.
    pub x: f64,
}

/// A bar that is being turned.
#[derive(Clone, Debug)]
pub struct Turning {
    nose: Nose,
    limits: Limits,
    resolution: Resolution,
    profile: Profile,
    at: f64,
    place: Place,
    /// Where a straight way along the bar began on which nothing can happen but a deep cut: it is cut at once when it
    /// is long enough, as most of what a nose sweeps on a short one it sweeps again on the next.
    began: Option<Place>,
    /// Up to here that way cannot be a deep cut.
    shallow: Place,
    /// When each axis moved last, in s.
    moved: Place,
    rpm: f64,
    /// The area and the way of the cut under way, and since when.
    cut: (f64, f64),
    happenings: Vec<Happening>,
}

impl Turning {
    /// A bar, and a tool that stands at a place.
    pub fn new(bar: Profile, nose: Nose, limits: Limits, resolution: Resolution, place: Place) -> Self {
        Self {
            nose,
            limits,
            resolution,
            profile: bar,
            at: 0.0,
            place,
            began: None,
            shallow: place,
            moved: Place::default(),
            rpm: 0.0,
            cut: (0.0, 0.0),
            happenings: Vec::new(),
        }
    }

    /// The spindle turns at so many rpm from now on.
    pub fn spin(&mut self, rpm: f64) {
        if rpm == 0.0 {
            self.catch_up();
        }
        self.rpm = rpm;
    }

    /// By `at`, in s and never before the last, the tool has gone straight to a place.
    pub fn go(&mut self, at: f64, to: Place) {
        let feed = self.feed(at, to);
        let beyond = -self.profile.out() - to.z;
        let began = self.began.unwrap_or(self.place);
        let onward = (to.z - self.place.z) * (self.place.z - began.z) >= 0.0;
        let harmless = self.rpm != 0.0 && feed <= self.limits.feed && beyond <= 0.0;
        if harmless && onward && to.x == self.place.x {
            if self.began.is_none() {
                self.shallow = began;
            }
            (self.at, self.place, self.began) = (at, to, Some(began));
            if (to.z - self.shallow.z).abs() >= MEAN_OVER {
                if self.is_shallow(self.shallow, to) {
                    self.shallow = to;
                } else {
                    self.catch_up();
                }
            }
            return;
        }
        self.catch_up();
        let from = self.place;
        (self.at, self.place) = (at, to);
        let shaving = self.cut(from, to);
        if shaving.thickest > TOUCH {
            if self.rpm == 0.0 {
                self.note(Violation::Stopped, shaving.thickest);
            }
            if feed > self.limits.feed {
                self.note(Violation::Rapid, feed);
            }
        }
        self.watch_depth(shaving.area, from);
        if beyond > 0.0 && self.limits.chuck.is_none_or(|radius| to.x < radius) {
            self.note(Violation::Chuck, beyond);
        }
    }

    /// Cuts what has been gone and not cut yet.
    fn catch_up(&mut self) {
        let Some(began) = self.began.take() else { return };
        let from = self.shallow;
        if from != began {
            self.cut(began, from);
        }
        if from != self.place {
            let shaving = self.cut(from, self.place);
            self.watch_depth(shaving.area, from);
        }
    }

    fn cut(&mut self, from: Place, to: Place) -> Shaving {
        let shaving = self.profile.cut(&self.nose, from, to);
        if shaving.through > TOUCH {
            self.note(Violation::Wall, shaving.through);
        }
        shaving
    }

    /// Whether no part of a way of [`MEAN_OVER`] or more can be too deep a cut: a convex nose takes off no more area
    /// for each mm of way than the bar is thick there. (A tenth is for the points, which are not infinitely close.)
    fn is_shallow(&self, from: Place, to: Place) -> bool {
        let Some(limit) = self.limits.depth else { return true };
        self.cut.0 == 0.0 && self.profile.thickest(&self.nose, from, to) <= 0.9 * limit
    }

    /// The feed that is certain: at least the way less a count has been gone since the axis was last seen to move.
    fn feed(&mut self, at: f64, to: Place) -> f64 {
        let speed = |way: f64, count: f64, since: &mut f64| {
            if way == 0.0 {
                return 0.0;
            }
            let span = at - *since;
            *since = at;
            if span > 0.0 { (way.abs() - count).max(0.0) / span } else { 0.0 }
        };
        let z = speed(to.z - self.place.z, self.resolution.z, &mut self.moved.z);
        let x = speed(to.x - self.place.x, self.resolution.x, &mut self.moved.x);
        (z * z + x * x).sqrt()
    }

    fn watch_depth(&mut self, area: f64, from: Place) {
        let Some(limit) = self.limits.depth else { return };
        if area == 0.0 && self.cut.0 == 0.0 {
            return;
        }
        let (z, x) = (self.place.z - from.z, self.place.x - from.x);
        self.cut = (self.cut.0 + area, self.cut.1 + (z * z + x * x).sqrt());
        let (area, way) = self.cut;
        if way >= MEAN_OVER {
            self.cut = (0.0, 0.0);
            if area / way > limit {
                self.note(Violation::Deep, area / way);
            }
        }
    }

    fn note(&mut self, event: Violation, much: f64) {
        let (at, place) = (self.at, self.place);
        match self.happenings.iter_mut().rfind(|happening| happening.event == event) {
            Some(again) if at - again.at.1 <= AGAIN => {
                again.at.1 = at;
                again.worst = again.worst.max(much);
            }
            _ => self.happenings.push(Happening { event, at: (at, at), place, worst: much }),
        }
    }

    /// What is left of the bar, and what should not have happened.
    pub fn finish(mut self) -> (Profile, Vec<Happening>) {
        self.catch_up();
        (self.profile, self.happenings)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: Limits = Limits { feed: 10.0, depth: Some(1.5), chuck: Some(40.0) };

    /// Turns along places, each so many mm/s from the one before; the events that come of it.
    fn events(rpm: f64, ways: &[(f64, f64, f64)]) -> Vec<Happening> {
        let start = Place { z: 0.0, x: 15.0 };
        let nose = Nose::new(0.4, 90.0, 32.0).unwrap();
        let mut turning = Turning::new(Profile::bar(28.0, 60.0), nose, LIMITS, Resolution::default(), start);
        turning.spin(rpm);
        let (mut at, mut from) = (0.0, start);
        for &(z, x, speed) in ways {
            let length = ((z - from.z) * (z - from.z) + (x - from.x) * (x - from.x)).sqrt();
            let steps = (length / speed / 0.03).ceil().max(1.0);
            for step in 1..=steps as u32 {
                let share = f64::from(step) / steps;
                at += length / speed / steps;
                turning.go(at, Place { z: from.z + share * (z - from.z), x: from.x + share * (x - from.x) });
            }
            from = Place { z, x };
        }
        turning.finish().1
    }

    fn names(rpm: f64, ways: &[(f64, f64, f64)]) -> Vec<&'static str> {
        events(rpm, ways).iter().map(|happening| happening.event.name()).collect()
    }

    #[test]
    fn each_event_has_its_cause() {
        let careful = [(0.0, 13.0, 1.0), (-30.0, 13.0, 5.0), (-30.0, 14.5, 5.0), (0.0, 14.5, 50.0)];
        assert_eq!(names(1500.0, &careful), [""; 0]);
        assert_eq!(names(0.0, &careful), ["stopped"]);
        assert_eq!(names(1500.0, &[(0.0, 13.0, 1.0), (-30.0, 13.0, 12.0)]), ["rapid"]);
        assert_eq!(names(1500.0, &[(-61.0, 15.0, 50.0)]), ["chuck"]);
        assert_eq!(names(1500.0, &[(0.0, 41.0, 50.0), (-61.0, 41.0, 50.0)]), [""; 0]);
        assert_eq!(names(1500.0, &[(0.0, 12.4, 1.0), (-30.0, 12.4, 5.0)]), ["deep"]);
    }

    #[test]
    fn what_goes_on_is_one_happening_with_its_worst() {
        let found = events(1500.0, &[(0.0, 12.0, 1.0), (-10.0, 12.0, 5.0), (-20.0, 12.0, 20.0), (-30.0, 12.0, 12.0)]);
        let [deep, rapid] = &found[..] else { panic!("{found:?}") };
        assert_eq!((deep.event, rapid.event), (Violation::Deep, Violation::Rapid));
        assert!((deep.worst - 2.0).abs() < 0.1, "{deep:?}");
        assert!((rapid.worst - 20.0).abs() < 1e-6 && (rapid.place.z + 10.6).abs() < 0.1, "{rapid:?}");
        assert!(rapid.at.1 - rapid.at.0 > 1.2, "{rapid:?}");
    }

    #[test]
    fn a_coarse_count_is_no_rapid() {
        let nose = Nose::new(0.4, 90.0, 32.0).unwrap();
        let coarse = Resolution { z: 0.002, x: 0.18 };
        let start = Place { z: -5.0, x: 14.1 };
        let mut turning = Turning::new(Profile::bar(28.0, 60.0), nose, LIMITS, coarse, start);
        turning.spin(1500.0);
        turning.go(1.00, Place { z: -5.0, x: 13.92 });
        turning.go(1.01, Place { z: -5.0, x: 13.74 });
        assert_eq!(turning.finish().1, []);
    }
}
