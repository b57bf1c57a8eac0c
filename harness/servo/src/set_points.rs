//! Where a program's set point is at each tick, in exact arithmetic: a place half-way between two counts is common, and
//! the rounding errors of floating point would decide it.
//!
//! Numbers are decimals as they stand in the program, to the digits that an `f64` holds: 15 at the least. Elements take
//! fractions of a second (`p0 k3 x1`: 2/3 s), so all times are multiples of one common fraction of a second.

use num_bigint::BigInt;
use num_integer::Integer;

use crate::RATE;
use crate::element::Element;

/// A program that ends less than one of these behind a tick ends on it: numbers that a computer has written may be off
/// by a last digit. So many are a tick.
const PARTS: u32 = 1_000_000;

/// The set points, in counts, each to the nearest; a half goes up.
pub(crate) struct SetPoints {
    /// So many units are a mm, a mm/s, and a count per mm.
    unit: BigInt,
    /// So many units of time are a tick. Every element begins at a whole unit of time.
    per_tick: BigInt,
    counts_per_mm: BigInt,
    courses: Vec<Course>,
    end: BigInt,
    ticks: usize,
    /// The tick before the next one, and the element that it is in.
    tick: usize,
    place: usize,
}

/// An element. `u` units of time behind its beginning it has come by (linear·u + square·u²) / divisor mm.
struct Course {
    /// In units of time.
    from: BigInt,
    /// In units.
    from_mm: BigInt,
    linear: BigInt,
    square: BigInt,
    divisor: BigInt,
}

impl SetPoints {
    pub(crate) fn new(elements: &[Element], counts_per_mm: f64) -> Self {
        let elements = || elements.iter().copied();
        let numbers = elements().flat_map(numbers).chain([counts_per_mm]);
        let unit = BigInt::from(10).pow(numbers.map(places).max().unwrap_or(0));
        let units = |value: f64| in_units(value, &unit);
        // The time of an element, as a fraction of a second.
        let time = |element| match element {
            Element::Constant { t, .. } => (units(t), unit.clone()),
            Element::Accelerated { p, k, x } => lowest(2 * units(x), units(p) + units(k)),
        };
        // The lowest multiple of all denominators. So many units of time are a tick, RATE times as many a second.
        let per_tick = elements().fold(BigInt::from(1), |multiple, element| {
            let of = time(element).1;
            // The remainder is small, the multiple need not be.
            let common = (&multiple % &of).gcd(&of);
            multiple * (of / common)
        });
        let per_second = &per_tick * RATE;
        let (mut from, mut from_mm) = (BigInt::ZERO, BigInt::ZERO);
        let mut course = |element| {
            let (above, below) = time(element);
            let (linear, square, divisor) = match element {
                Element::Constant { x, t } => (units(x), BigInt::ZERO, units(t) * &per_second),
                Element::Accelerated { p, k, x } => {
                    let [p, k, x] = [p, k, x].map(units);
                    let square = &k * &k - &p * &p;
                    (4 * &p * &x * &per_second, square, 4 * x * &unit * &per_second * &per_second)
                }
            };
            let course = Course { from: from.clone(), from_mm: from_mm.clone(), linear, square, divisor };
            from += above * (&per_second / below);
            from_mm += units(element.way_mm());
            course
        };
        let courses = elements().map(&mut course).collect();
        let ticks = Integer::div_ceil(&(from * PARTS - &per_tick), &(&per_tick * PARTS));
        Self {
            counts_per_mm: units(counts_per_mm),
            courses,
            end: from_mm,
            ticks: ticks.try_into().unwrap_or(0),
            tick: 0,
            place: 0,
            per_tick,
            unit,
        }
    }

    pub(crate) const fn ticks(&self) -> usize {
        self.ticks
    }

    /// The nearest count to above/below mm; the upper one of two.
    fn nearest(&self, above: &BigInt, below: &BigInt) -> i64 {
        let below: BigInt = 2 * below * &self.unit;
        let with_half: BigInt = 2 * above * &self.counts_per_mm + &below / 2;
        with_half.div_floor(&below).try_into().unwrap_or(0)
    }
}

impl Iterator for SetPoints {
    type Item = i64;

    fn next(&mut self) -> Option<i64> {
        if self.tick >= self.ticks {
            return None;
        }
        self.tick += 1;
        if self.tick == self.ticks {
            return Some(self.nearest(&self.end, &self.unit));
        }
        let now = self.tick * &self.per_tick;
        while self.courses.get(self.place + 1).is_some_and(|next| next.from <= now) {
            self.place += 1;
        }
        let Course { from, from_mm, linear, square, divisor } = self.courses.get(self.place)?;
        let gone = now - from;
        let above = from_mm * divisor + &self.unit * &gone * (linear + square * &gone);
        Some(self.nearest(&above, &(&self.unit * divisor)))
    }
}

const fn numbers(element: Element) -> [f64; 3] {
    match element {
        Element::Constant { x, t } => [x, t, 0.0],
        Element::Accelerated { p, k, x } => [p, k, x],
    }
}

/// The decimal places of a number, as it is written shortest.
fn places(value: f64) -> u32 {
    value.to_string().split_once('.').map_or(0, |(_, fraction)| fraction.len() as u32)
}

/// A number of no more decimal places than a unit has.
fn in_units(value: f64, unit: &BigInt) -> BigInt {
    let digits = value.to_string().replace('.', "").parse().unwrap_or(BigInt::ZERO);
    digits * unit / BigInt::from(10).pow(places(value))
}

/// A fraction above 0 in its lowest terms.
fn lowest(above: BigInt, below: BigInt) -> (BigInt, BigInt) {
    let common = above.gcd(&below);
    // Both are negative in an element that goes back.
    let common = if below < BigInt::ZERO { -common } else { common };
    (above / &common, below / common)
}
