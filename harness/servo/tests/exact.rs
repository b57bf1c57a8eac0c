//! Set points, tick by tick, beside a second computation in fractions of whole numbers, which shares nothing with the
//! compiler's: it has its own elements, and reads no text.

#![allow(clippy::unwrap_used, reason = "in a test, a panic is an answer")]

use torno_servo::{Limits, compile};

const RATE: i128 = 200;
const COUNTS_PER_MM: i128 = 125;

/// A fraction in its lowest terms, above a number over 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Fraction(i128, i128);

impl Fraction {
    const ZERO: Self = Self(0, 1);

    fn new(above: i128, below: i128) -> Self {
        let (mut a, mut b) = (above.abs(), below.abs());
        while b != 0 {
            (a, b) = (b, a % b);
        }
        let common = a.max(1) * below.signum();
        Self(above / common, below / common)
    }

    fn plus(self, other: Self) -> Self {
        let above = self.0.checked_mul(other.1).unwrap().checked_add(other.0.checked_mul(self.1).unwrap());
        Self::new(above.unwrap(), self.1.checked_mul(other.1).unwrap())
    }

    fn times(self, other: Self) -> Self {
        Self::new(self.0.checked_mul(other.0).unwrap(), self.1.checked_mul(other.1).unwrap())
    }

    fn minus(self, other: Self) -> Self {
        self.plus(Self(-other.0, other.1))
    }

    fn over(self, other: Self) -> Self {
        self.times(Self::new(other.1, other.0))
    }

    fn is_before(self, other: Self) -> bool {
        self.minus(other).0 < 0
    }
}

/// An element in thousandths: p, k and x, or x and t.
#[derive(Clone, Copy, Debug)]
enum Thousandths {
    Constant([i128; 2]),
    Accelerated([i128; 3]),
}

use Thousandths::{Accelerated, Constant};

fn decimal(thousandths: i128) -> String {
    let sign = if thousandths < 0 { "-" } else { "" };
    format!("{sign}{}.{:03}", thousandths.abs() / 1_000, thousandths.abs() % 1_000)
}

impl Thousandths {
    fn text(self) -> String {
        match self {
            Constant([x, t]) => format!("x{} t{}\n", decimal(x), decimal(t)),
            Accelerated([p, k, x]) => format!("p{} k{} x{}\n", decimal(p), decimal(k), decimal(x)),
        }
    }

    fn way(self) -> Fraction {
        let (Constant([x, _]) | Accelerated([_, _, x])) = self;
        Fraction::new(x, 1_000)
    }

    fn seconds(self) -> Fraction {
        match self {
            Constant([_, t]) => Fraction::new(t, 1_000),
            Accelerated([p, k, x]) => Fraction::new(2 * x, p + k),
        }
    }

    /// The way after a part of its time.
    fn way_at(self, seconds: Fraction) -> Fraction {
        match self {
            Constant(_) => self.way().times(seconds).over(self.seconds()),
            Accelerated([p, k, _]) => {
                let gained = Fraction::new(k - p, 2_000).times(seconds).over(self.seconds());
                Fraction::new(p, 1_000).plus(gained).times(seconds)
            }
        }
    }
}

/// The set points, and how many of them are half-way between two counts before they are rounded.
fn reference(elements: &[Thousandths]) -> (Vec<i64>, usize) {
    let (mut set_points, mut halves) = (Vec::new(), 0);
    let all = elements.iter().fold(Fraction::ZERO, |all, element| all.plus(element.seconds()));
    let mut tick = 0;
    let mut over = false;
    while !over {
        tick += 1;
        let now = Fraction::new(tick, RATE);
        over = !now.is_before(all);
        let (mut begins, mut way) = (Fraction::ZERO, Fraction::ZERO);
        for element in elements {
            let ends = begins.plus(element.seconds());
            let is_within = begins.is_before(now) && now.is_before(ends);
            way = match (is_within, now.is_before(ends)) {
                (true, _) => way.plus(element.way_at(now.minus(begins))),
                (false, true) => way,
                (false, false) => way.plus(element.way()),
            };
            begins = ends;
        }
        let counts = way.times(Fraction(COUNTS_PER_MM, 1));
        halves += usize::from(counts.1 == 2);
        set_points.push(counts.plus(Fraction(1, 2)));
    }
    (set_points.iter().map(|counts| counts.0.div_euclid(counts.1) as i64).collect(), halves)
}

/// The set points of a program, if both computations agree; and how many were half-way.
fn compared(elements: &[Thousandths]) -> (Vec<i64>, usize) {
    let text = elements.iter().map(|element| element.text()).chain(["e\n".to_owned()]).collect::<String>();
    let program = compile(&text, &Limits::default()).program.unwrap();
    let found: Vec<i64> = program.set_points(COUNTS_PER_MM as f64).collect();
    let (expected, halves) = reference(elements);
    assert_eq!(found, expected, "{text}");
    assert_eq!(program.ticks(), expected.len(), "{text}");
    (found, halves)
}

/// Elements of which the ticks often fall half-way between two counts, and elements that take fractions of a second.
fn elements() -> Vec<Thousandths> {
    vec![
        Constant([20_000, 2_000]),
        Constant([-20_000, 2_000]),
        Constant([0, 500]),
        Constant([10_000, 2_000]),
        Constant([-3_000, 1_250]),
        Constant([7_100, 700]),
        Constant([1_000, 333]),
        Accelerated([0, 5_000, 2_000]),
        Accelerated([5_000, 0, 2_000]),
        Accelerated([0, -5_000, -2_000]),
        Accelerated([0, 3_000, 1_000]),
        Accelerated([4_000, 12_000, 1_600]),
        Accelerated([-12_000, -4_000, -1_600]),
        Accelerated([7_000, 6_000, 1_001]),
    ]
}

#[test]
fn a_half_rounds_up_whatever_the_sense_of_motion() {
    let (forth, halves) = compared(&[Constant([20_000, 2_000]), Constant([0, 500])]);
    assert_eq!((halves, &forth[..4]), (100, &[6, 13, 19, 25][..]));
    // -6.25, -12.5, -18.75, -25: the half goes up again.
    assert_eq!(compared(&[Constant([-20_000, 2_000])]).0[..4], [-6, -12, -19, -25]);
}

#[test]
fn every_pair_of_elements_has_the_set_points_of_whole_numbers() {
    let mut all = 0;
    for first in elements() {
        for second in elements() {
            all += compared(&[first, second]).1;
        }
    }
    assert!(all > 5_000, "only {all} halves");
}

#[test]
fn fractions_of_a_second_add_up_to_a_whole() {
    let third = Accelerated([0, 3_000, 1_000]);
    for others in [vec![], vec![Constant([20_000, 2_000])], vec![Accelerated([7_000, 6_000, 1_001])]] {
        let elements: Vec<_> = [third; 3].into_iter().chain(others).chain([Constant([20_000, 2_000])]).collect();
        compared(&elements);
    }
    // 3 x 2/3 s are 400 ticks and no more.
    assert_eq!(compared(&[third; 3]).0.len(), 400);
}

/// Speeds of one to a hundred: no common fraction of their times fits into 128 bits.
#[test]
fn times_without_a_common_measure_are_exact_too() {
    let there = |n: i32| format!("p{n}.01 k0 x1\n");
    let text: String = (1..=100).map(there).chain(["x20 t2\ne\n".to_owned()]).collect();
    let program = compile(&text, &Limits::default()).program.unwrap();
    let set_points: Vec<i64> = program.set_points(125.0).collect();
    assert_eq!((set_points.len(), set_points.last()), (program.ticks(), Some(&15_000)));
    assert!(set_points.windows(2).all(|pair| (0..=127).contains(&(pair[1] - pair[0]))));
}

/// A computer writes 0.1 + 0.2 like this. It is no tick more.
#[test]
fn a_last_digit_makes_no_tick() {
    for (text, ticks) in [
        ("x1 t0.30000000000000004\ne\n", 60),
        ("x1 t0.3\ne\n", 60),
        ("x1 t0.30001\ne\n", 61),
        ("x0.1 t0.004\ne\n", 1),
        ("x0 t0.000000004\ne\n", 0),
    ] {
        assert_eq!(compile(text, &Limits::default()).program.unwrap().ticks(), ticks, "{text}");
    }
}

/// The decimal that was typed, not the binary number below it that an `f64` holds: 1.25 mm are 158.5 counts.
#[test]
fn another_screw_counts_exactly_too() {
    let program = compile("x10 t1\ne\n", &Limits::default()).program.unwrap();
    for (counts_per_mm, counts) in [(126.7, 158), (126.8, 159)] {
        assert_eq!(program.set_points(counts_per_mm).nth(24), Some(counts), "{counts_per_mm}");
    }
}
