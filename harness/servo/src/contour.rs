//! Two axes along a path, and how far they leave it: the sheet's "dynamiczne odchyłki toru" (§1.1), after Pritschow.
//!
//! An axis lags its set point by Δ = v/KV (type 1, gain KV, no feed-forward). On a straight line two like axes lag
//! along the line and leave it by nothing; what they leave is a corner, a curve, and a line if they are unlike.

use crate::TICKS_PER_S;

/// The axes begin so long after the start of the run, and rest so long at its end, in s.
const REST_S: f64 = 1.0;
/// The legs of a corner and the length of a line, in multiples of the way in which an error settles. In s of motion.
const LEG_S: f64 = 1.0;
/// Turns of a circle; the last one is measured.
const TURNS: f64 = 2.0;
/// The nearest approach to a corner of two like axes without a motor's lag, in Δ.
const CORNER: f64 = 0.508_863_006_2;
/// A picture of a corner shows so much around it, in mm.
const AROUND_MM: f64 = 1.0;
/// The step with which a corner with lag is integrated, in s.
const STEP_S: f64 = 2e-5;

/// What path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// Along x, then along y: a right angle.
    Corner,
    /// At so many degrees to x.
    Line(f64),
    /// Of this radius, in mm.
    Circle(f64),
    /// From point to point: to (2, 1) legs, each axis by itself as fast as it may; the path is of no account.
    Points,
    /// The same points in a straight line: contour control.
    Straight,
}

/// A path and a speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Task {
    /// The path.
    pub shape: Shape,
    /// The speed along it, in mm/s: above 0.
    pub speed_mm_s: f64,
}

/// The two axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axes {
    /// The loops' gains, in 1/s.
    pub kv: [f64; 2],
    /// The motors' time constant, in s.
    pub tau_s: f64,
}

/// A place, in mm.
pub type Point = (f64, f64);

impl Task {
    /// The set point at each tick, from (0, 0).
    pub fn path(&self) -> Vec<Point> {
        let Self { shape, speed_mm_s: v } = *self;
        let leg = v * LEG_S;
        let along = |from: Point, to: Point, v: f64| {
            let (dx, dy) = (to.0 - from.0, to.1 - from.1);
            let way = libm::hypot(dx, dy);
            let ticks = (way / v * TICKS_PER_S).round().max(1.0) as usize;
            (1..=ticks).map(move |tick| {
                let share = tick as f64 / ticks as f64;
                (from.0 + dx * share, from.1 + dy * share)
            })
        };
        let rest = |at: Point| core::iter::repeat_n(at, (REST_S * TICKS_PER_S) as usize);
        match shape {
            Shape::Corner => {
                let (corner, end) = ((leg, 0.0), (leg, leg));
                along((0.0, 0.0), corner, v).chain(along(corner, end, v)).chain(rest(end)).collect()
            }
            Shape::Line(degrees) => {
                let angle = degrees.to_radians();
                let end = (2.0 * leg * libm::cos(angle), 2.0 * leg * libm::sin(angle));
                along((0.0, 0.0), end, v).chain(rest(end)).collect()
            }
            Shape::Straight => {
                let end = (2.0 * leg, leg);
                along((0.0, 0.0), end, v * libm::sqrt(1.25)).chain(rest(end)).collect()
            }
            Shape::Points => {
                let (both, end) = ((leg, leg), (2.0 * leg, leg));
                // Each axis at v: together faster along the diagonal.
                let fast = v * core::f64::consts::SQRT_2;
                along((0.0, 0.0), both, fast).chain(along(both, end, v)).chain(rest(end)).collect()
            }
            Shape::Circle(radius) => {
                let start = (2.0 * radius, radius);
                let ticks = (TURNS * self.turn_ticks() as f64) as usize;
                let turn = (1..=ticks).map(move |tick| {
                    let angle = tick as f64 / TICKS_PER_S * v / radius;
                    (radius + radius * libm::cos(angle), radius + radius * libm::sin(angle))
                });
                along((0.0, 0.0), start, v).chain(rest(start)).chain(turn).collect()
            }
        }
    }

    /// The ticks of one turn of a circle; 0 of anything else.
    fn turn_ticks(&self) -> usize {
        match self.shape {
            Shape::Circle(radius) => (core::f64::consts::TAU * radius / self.speed_mm_s * TICKS_PER_S).round() as usize,
            _ => 0,
        }
    }

    /// The lines or the arc that is asked for, for a picture. Of a corner, what is near it.
    pub fn asked(&self) -> Vec<Point> {
        let leg = self.speed_mm_s * LEG_S;
        match self.shape {
            Shape::Corner => vec![(leg - AROUND_MM, 0.0), (leg, 0.0), (leg, AROUND_MM)],
            Shape::Points | Shape::Straight => vec![(0.0, 0.0), (2.0 * leg, leg)],
            Shape::Line(degrees) => {
                let angle = degrees.to_radians();
                vec![(0.0, 0.0), (2.0 * leg * libm::cos(angle), 2.0 * leg * libm::sin(angle))]
            }
            Shape::Circle(radius) => {
                let point = |n: i32| {
                    let angle = f64::from(n) / 180.0 * core::f64::consts::PI;
                    (radius + radius * libm::cos(angle), radius + radius * libm::sin(angle))
                };
                (0..=360).map(point).collect()
            }
        }
    }

    /// The deviation that the formulas give, in mm: without and with the motors' lag. The circle's is how much smaller
    /// its radius gets. Of points there is none.
    pub fn predicted(&self, axes: Axes) -> Option<[f64; 2]> {
        let Self { shape, speed_mm_s: v } = *self;
        let [kvx, kvy] = axes.kv;
        match shape {
            Shape::Corner => Some([CORNER * v * (1.0 / kvx + 1.0 / kvy) / 2.0, corner_with_lag(v, axes)]),
            Shape::Line(degrees) => {
                let angle = degrees.to_radians();
                let line = v * libm::sin(angle) * libm::cos(angle) * (1.0 / kvx - 1.0 / kvy).abs();
                Some([line, line])
            }
            Shape::Straight => {
                let line = v * libm::sqrt(1.25) * 0.4 * (1.0 / kvx - 1.0 / kvy).abs();
                Some([line, line])
            }
            Shape::Circle(radius) => {
                let w = v / radius;
                let share = |kv: f64, tau: f64| 1.0 / libm::hypot(1.0 - w * w * tau / kv, w / kv);
                let smaller = |tau| radius * (1.0 - (share(kvx, tau) + share(kvy, tau)) / 2.0);
                Some([smaller(0.0), smaller(axes.tau_s)])
            }
            Shape::Points => None,
        }
    }

    /// Where axes are at each tick that are sampled as the controller's loop is, without its rounding.
    pub fn sampled(&self, axes: Axes) -> Vec<Point> {
        let period = 1.0 / TICKS_PER_S;
        let left = libm::exp(-period / axes.tau_s);
        let (mut at, mut speed) = ([0.0; 2], [0.0; 2]);
        let tick = |place: Point| {
            let before = (at[0], at[1]);
            for (axis, set_point) in [place.0, place.1].into_iter().enumerate() {
                let toward = axes.kv[axis] * (set_point - at[axis]);
                at[axis] += toward * period + (speed[axis] - toward) * axes.tau_s * (1.0 - left);
                speed[axis] = toward + (speed[axis] - toward) * left;
            }
            before
        };
        self.path().into_iter().map(tick).collect()
    }

    /// The deviation of what was driven: the place at each tick of [`Task::path`]. In mm.
    ///
    /// A corner's is the nearest approach to it, a line's the mean over the second half of the way, a circle's the mean
    /// over the last turn of how much smaller its radius is; that of points, how far the path leaves the straight line.
    pub fn measured(&self, driven: &[Point]) -> f64 {
        let leg = self.speed_mm_s * LEG_S;
        match self.shape {
            Shape::Corner => {
                let to_corner = |pair: &[Point]| distance((leg, 0.0), pair[0], pair[1]);
                driven.windows(2).map(to_corner).fold(f64::INFINITY, f64::min)
            }
            Shape::Circle(radius) => {
                let turn = &driven[driven.len().saturating_sub(self.turn_ticks())..];
                let smaller = |place: &Point| radius - libm::hypot(place.0 - radius, place.1 - radius);
                turn.iter().map(smaller).sum::<f64>() / turn.len().max(1) as f64
            }
            Shape::Line(_) | Shape::Straight => {
                let moving = driven.len().saturating_sub((REST_S * TICKS_PER_S) as usize);
                let part = &driven[moving / 2..moving];
                part.iter().map(|place| self.off_line(*place)).sum::<f64>().abs() / part.len().max(1) as f64
            }
            Shape::Points => driven.iter().map(|place| self.off_line(*place).abs()).fold(0.0, f64::max),
        }
    }

    /// How far to the left of the line that is asked for.
    fn off_line(&self, place: Point) -> f64 {
        let end = self.asked().last().copied().unwrap_or_default();
        (end.0 * place.1 - end.1 * place.0) / libm::hypot(end.0, end.1)
    }

    /// What was driven, with what it leaves of the asked path magnified.
    pub fn magnified(&self, driven: &[Point], times: f64) -> Vec<Point> {
        let asked = self.asked();
        let of_place = |place: &Point| {
            let foot = asked.windows(2).map(|pair| foot(*place, pair[0], pair[1]));
            let nearest = foot.min_by(|a, b| apart(*a, *place).total_cmp(&apart(*b, *place))).unwrap_or(*place);
            (nearest.0 + times * (place.0 - nearest.0), nearest.1 + times * (place.1 - nearest.1))
        };
        // Neither the way to a circle nor the rest at the end of a line is a part of it.
        let rest = (REST_S * TICKS_PER_S) as usize;
        let part = match self.shape {
            Shape::Circle(_) => &driven[driven.len().saturating_sub(self.turn_ticks())..],
            Shape::Corner | Shape::Points => driven,
            Shape::Line(_) | Shape::Straight => &driven[..driven.len().saturating_sub(rest)],
        };
        let corner = (self.speed_mm_s * LEG_S, 0.0);
        let is_shown = |place: &&Point| self.shape != Shape::Corner || apart(**place, corner) <= AROUND_MM;
        part.iter().filter(is_shown).map(of_place).collect()
    }
}

fn apart(a: Point, b: Point) -> f64 {
    libm::hypot(a.0 - b.0, a.1 - b.1)
}

/// The point of a line's part from `a` to `b` that is nearest to `place`.
fn foot(place: Point, a: Point, b: Point) -> Point {
    let (dx, dy) = (b.0 - a.0, b.1 - a.1);
    let length = dx * dx + dy * dy;
    if length == 0.0 {
        return a;
    }
    let share = (((place.0 - a.0) * dx + (place.1 - a.1) * dy) / length).clamp(0.0, 1.0);
    (a.0 + dx * share, a.1 + dy * share)
}

fn distance(place: Point, a: Point, b: Point) -> f64 {
    apart(place, foot(place, a, b))
}

/// The nearest approach to a corner of two axes KV/(τs² + s + KV), integrated.
fn corner_with_lag(v: f64, axes: Axes) -> f64 {
    let Axes { kv: [kvx, kvy], tau_s } = axes;
    let ([mut x, mut y], [mut vx, mut vy]) = ([-v / kvx, 0.0], [v, 0.0]);
    let mut nearest = f64::INFINITY;
    let steps = (1.0 / STEP_S) as usize;
    for n in 0..steps {
        let t = n as f64 * STEP_S;
        vx += STEP_S * (-vx - kvx * x) / tau_s;
        vy += STEP_S * (-vy + kvy * (v * t - y)) / tau_s;
        x += STEP_S * vx;
        y += STEP_S * vy;
        nearest = nearest.min(libm::hypot(x, y));
    }
    nearest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn predicted(shape: Shape, speed_mm_s: f64, kv: [f64; 2]) -> [f64; 2] {
        Task { shape, speed_mm_s }.predicted(Axes { kv, tau_s: 0.03 }).unwrap()
    }

    #[test]
    fn the_formulas_give_the_known_figures() {
        for (shape, speed, kv, ideal, lag, within) in [
            (Shape::Corner, 10.0, [20.0; 2], 0.254_431_5, 0.125_966, 5e-4),
            (Shape::Corner, 16.666_667, [20.0; 2], 0.424_052_5, 0.209_943, 8e-4),
            (Shape::Line(45.0), 10.0, [20.0, 18.0], 0.027_777_777_8, 0.027_777_777_8, 1e-8),
            (Shape::Circle(10.0), 10.0, [20.0; 2], 0.012_476_611_2, -0.002_489_679_5, 1e-8),
            (Shape::Circle(5.0), 10.0, [20.0; 2], 0.024_814_049_0, -0.005_0, 2e-4),
        ] {
            let found = predicted(shape, speed, kv);
            assert!((found[0] - ideal).abs() < 1e-6, "{shape:?}: {found:?}");
            assert!((found[1] - lag).abs() < within, "{shape:?}: {found:?}");
        }
        assert_eq!(
            Task { shape: Shape::Points, speed_mm_s: 10.0 }.predicted(Axes { kv: [20.0; 2], tau_s: 0.03 }),
            None
        );
    }

    /// Axes of first order, sampled finely: what is measured is what the formulas say.
    #[test]
    fn what_is_measured_of_ideal_axes_is_what_is_predicted() {
        for (shape, kv) in [
            (Shape::Corner, [20.0; 2]),
            (Shape::Line(45.0), [20.0, 18.0]),
            (Shape::Straight, [20.0, 18.0]),
            (Shape::Circle(10.0), [20.0; 2]),
            (Shape::Circle(5.0), [20.0; 2]),
        ] {
            let task = Task { shape, speed_mm_s: 10.0 };
            let mut at = (0.0, 0.0);
            let mut before = (0.0, 0.0);
            let follow = |at: f64, from: f64, to: f64, kv: f64| {
                // Exactly, for a set point that goes evenly from one tick to the next.
                let (t, v) = (1.0 / TICKS_PER_S, (to - from) * TICKS_PER_S);
                let lag = from - at - v / kv;
                to - v / kv - lag * libm::exp(-kv * t)
            };
            let driven: Vec<Point> = task
                .path()
                .into_iter()
                .map(|to| {
                    at = (follow(at.0, before.0, to.0, kv[0]), follow(at.1, before.1, to.1, kv[1]));
                    before = to;
                    at
                })
                .collect();
            let (found, expected) = (task.measured(&driven), predicted(shape, 10.0, kv)[0]);
            assert!((found / expected - 1.0).abs() < 0.01, "{shape:?}: {found}, expected {expected}");
        }
    }

    #[test]
    fn from_point_to_point_the_path_is_of_no_account() {
        let task = Task { shape: Shape::Points, speed_mm_s: 10.0 };
        // The diagonal's corner (10, 10) lies 4.47 mm from the line to (20, 10).
        assert!((task.measured(&task.path()) - 20.0 / 20f64.sqrt()).abs() < 1e-9);
    }
}
