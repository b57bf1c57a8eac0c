//! What a program asks for: a way over time, and its increments.

use crate::TICKS_PER_S;

/// Ticks are whole to within this much; a program that ends on one has no tick more. In ticks.
const WHOLE: f64 = 1e-6;

/// One element of a program.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Element {
    /// `x10 t2`: at constant speed.
    Constant {
        /// The way, in mm; 0 is a rest.
        x: f64,
        /// The time, in s: above 0.
        t: f64,
    },
    /// `p0 k5 x2`: at constant acceleration.
    Accelerated {
        /// The speed at its beginning, in mm/s.
        p: f64,
        /// The speed at its end, in mm/s, of the same sign.
        k: f64,
        /// The way, in mm, of the same sign; not 0.
        x: f64,
    },
}

impl Element {
    /// The way, in mm.
    pub const fn way_mm(self) -> f64 {
        match self {
            Self::Constant { x, .. } | Self::Accelerated { x, .. } => x,
        }
    }

    /// The time, in s.
    pub fn seconds(self) -> f64 {
        match self {
            Self::Constant { t, .. } => t,
            Self::Accelerated { p, k, x } => 2.0 * x / (p + k),
        }
    }

    /// The speed at its beginning, in mm/s.
    pub fn speed_mm_s(self) -> f64 {
        match self {
            Self::Constant { x, t } => x / t,
            Self::Accelerated { p, .. } => p,
        }
    }

    /// The acceleration, in mm/s².
    pub fn acceleration_mm_s2(self) -> f64 {
        match self {
            Self::Constant { .. } => 0.0,
            Self::Accelerated { p, k, x } => (k * k - p * p) / (2.0 * x),
        }
    }

    /// The greatest speed, in mm/s, without a sign.
    pub fn greatest_speed_mm_s(self) -> f64 {
        match self {
            Self::Constant { x, t } => (x / t).abs(),
            Self::Accelerated { p, k, .. } => p.abs().max(k.abs()),
        }
    }

    /// The way after so many seconds of it, in mm.
    pub fn way_at(self, seconds: f64) -> f64 {
        self.speed_mm_s() * seconds + self.acceleration_mm_s2() * seconds * seconds / 2.0
    }
}

/// An element in its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// The element.
    pub element: Element,
    /// Its line, from 1.
    pub line: usize,
    /// When it begins, in s.
    pub from_s: f64,
    /// Where it begins, in mm.
    pub from_mm: f64,
}

/// A program without an error.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Program {
    /// Its elements, in order. At least one.
    pub motions: Vec<Motion>,
}

impl Program {
    /// How long it takes, in s.
    pub fn seconds(&self) -> f64 {
        self.motions.last().map_or(0.0, |last| last.from_s + last.element.seconds())
    }

    /// Where it ends, in mm from its beginning.
    pub fn end_mm(&self) -> f64 {
        self.motions.last().map_or(0.0, |last| last.from_mm + last.element.way_mm())
    }

    /// How many increments it makes.
    pub fn ticks(&self) -> usize {
        (self.seconds() * TICKS_PER_S - WHOLE).ceil().max(0.0) as usize
    }

    /// The set point at each tick after the beginning, in counts of which so many are a mm: rounded over the whole, not
    /// for each increment, so that nothing drifts and the sum is exact.
    pub fn set_points(&self, counts_per_mm: f64) -> impl Iterator<Item = i64> + '_ {
        let (ticks, seconds, end) = (self.ticks(), self.seconds(), self.end_mm());
        let mut place = 0;
        (1..=ticks).map(move |tick| {
            let now = tick as f64 / TICKS_PER_S;
            while self.motions.get(place + 1).is_some_and(|next| next.from_s <= now) {
                place += 1;
            }
            let way = match self.motions.get(place) {
                Some(motion) if now < seconds - WHOLE / TICKS_PER_S => {
                    motion.from_mm + motion.element.way_at(now - motion.from_s)
                }
                _ => end,
            };
            (way * counts_per_mm + 0.5).floor() as i64
        })
    }

    /// The increments, in counts a tick: what is sent to the controller.
    pub fn increments(&self, counts_per_mm: f64) -> Vec<i8> {
        let mut before = 0;
        let increment = |set_point: i64| {
            let increment = set_point - before;
            before = set_point;
            increment.clamp(i64::from(i8::MIN), i64::from(i8::MAX)) as i8
        };
        self.set_points(counts_per_mm).map(increment).collect()
    }

    /// Points of the graph of way (mm) over time (s): the ends of each element, and enough between them for a parabola.
    pub fn graph(&self) -> Vec<(f64, f64)> {
        let points = |motion: &Motion| {
            let Motion { element, from_s, from_mm, .. } = *motion;
            let parts = if element.acceleration_mm_s2() == 0.0 { 1 } else { 32 };
            let point = move |part: i32| {
                let seconds = element.seconds() * f64::from(part) / f64::from(parts);
                (from_s + seconds, from_mm + element.way_at(seconds))
            };
            (0..=parts).map(point)
        };
        self.motions.iter().flat_map(points).collect()
    }
}
