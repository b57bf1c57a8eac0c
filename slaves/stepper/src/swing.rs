//! The rotor that swings: with inertia and damping, integrated in substeps, and only while it swings.
//!
//! With the electrical angles θ of the rotor and Ω·t of the field, their difference φ, torque q, friction F and push:
//! θ″ = ω²(q·sin φ − push − F·sgn θ′) + 2ζω(Ω − θ′). Dry friction holds a rotor that stands as long as nothing exceeds
//! it, and stops one whose speed comes to zero. (All of this ours; the paper has no model of the motor.)
//!
//! Where it neither swings nor stands, it follows the field at the lag of the closed form. Within [`LOCK`] of that, it
//! is locked to the field and no longer integrated, until something changes. With ζ = 0.1 and 150 Hz a swing falls to
//! 1/e in 10.6 ms, so that a rotor is locked a tenth of a second after a slip.
//!
//! Substeps end at pulses, or at equal parts of one. A substep is reckoned as a whole when it begins; wherever time is
//! cut within it, rotor and field are on the way between its ends. So it matters not how time is cut.
//!
//! # The start–stop limit
//!
//! The largest speed at which a rotor follows from rest at once, under a load L, without damping and with a field that
//! moves evenly: v = f0·E·√(2B), B = 2·cos a − L(π − 2a), a = asin L. It is the energy that the field gives the rotor
//! until it lags by π − a. With 150 Hz and E = 0.1 mm: 30.00 mm/s at L = 0, 27.62 at 0.1, 22.73 at 0.3, 17.56 at 0.5.
//! With q falling from v_c = 50 mm/s: 28.02, 25.76, 21.19, 16.42.
//!
//! Damping as modelled here drags the rotor along with the field, and raises the limit; a field that moves in steps
//! lowers it, hardly with 40 pulses a turn, much with full steps (4 a turn). In mm/s, without v_c, measured:
//!
//! | L | even, ζ = 0 | 0.05 | 0.1 | 0.2 | 40 steps, ζ = 0 | 0.1 | 4 steps, ζ = 0 | 0.1 |
//! |---|---|---|---|---|---|---|---|---|
//! | 0.1 | 27.61 | 30.47 | 33.44 | 39.68 | 27.67 | 33.63 | 24.83 | 30.91 |
//! | 0.3 | 22.73 | 25.18 | 27.75 | 33.15 | 22.73 | 27.78 | 19.16 | 24.73 |
//! | 0.5 | 17.54 | 19.60 | 21.73 | 26.22 | 17.59 | 21.73 | 9.31 | 18.04 |
//!
//! # Ramps
//!
//! A step Δv of the speed swings the rotor by Δv/ω: 10.6 µm at 10 mm/s, which is beyond the loop's dead band of 10 µm.
//! Ramps up to 25 mm/s, with 12 phases of the encoder: where the speed is gained in steps of 5 ms, 200 mm/s² never
//! disturb the loop; 300 do so in one phase, 1000 in four. Where it is gained from pulse to pulse, 500 mm/s² are safe,
//! 700 are not in one phase, 1000 in two. A loop that pauses finds nothing to correct once the rotor has settled; one
//! that corrects at once takes the swing for lost steps, makes it worse, and may end in an alarm.
//!
//! A correction may leave an error just below the dead band. In the ramp after it a small swing is then enough for the
//! next stop, so that after a shock a loop that pauses may stop several times and find nothing to correct.

use core::f64::consts::TAU;

use crate::mechanics::Mechanics;
use crate::rotor::Load;
use crate::settings::MotorSettings;

/// The longest substep, in nanoseconds.
pub(crate) const SUBSTEP_NS: i64 = 100_000;

/// A rotor that swings by less is locked: in radians of an electrical turn. Of the paper's 40 pulses a turn it is
/// two thousandths of one.
const LOCK: f64 = TAU * 5e-5;

/// A rotor that can swing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Swing {
    /// ω, and 2ζω.
    omega: f64,
    drag: f64,
    /// A rotor that swings by less is locked: in radians.
    lock: f64,
    /// How fast the rotor turns, in rad/s; none while it is locked to the field.
    pub(crate) speed: Option<f64>,
    /// How many substeps there have been.
    pub(crate) substeps: u64,
}

/// What acts on the rotor in a substep.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Forces {
    /// The largest torque of the field.
    pub(crate) torque: f64,
    pub(crate) load: Load,
    /// How fast the field turns, in rad/s.
    pub(crate) field: f64,
}

/// What becomes of the rotor in a substep.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion {
    /// The share of the substep after which friction has stopped it; 1 if it has not.
    pub(crate) share: f64,
    /// How far it turns, in radians.
    pub(crate) turned: f64,
    /// Its speed then.
    pub(crate) speed: f64,
}

/// A substep in which the rotor turns evenly, from one place to another: in units of the train, or in nanoseconds
/// without one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Path {
    pub(crate) from: i64,
    pub(crate) to: i64,
    /// Rotor and carriage at its beginning, and how far the rotor turns.
    rotor: i64,
    carriage: i64,
    turned: i64,
}

/// A substep under way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Step {
    pub(crate) path: Path,
    /// How far it has come.
    pub(crate) at: i64,
    /// The rotor's speed at its beginning and at its end.
    speeds: (f64, f64),
}

impl Swing {
    /// None for a rotor in closed form.
    pub(crate) fn new(motor: &MotorSettings) -> Option<Self> {
        let omega = TAU * motor.rotor_hz;
        let lock = if motor.lock { LOCK } else { 0.0 };
        let swing = Self { omega, drag: 2.0 * motor.damping * omega, lock, speed: Some(0.0), substeps: 0 };
        (omega > 0.0).then_some(swing)
    }

    /// The drag of a field that turns so fast on a rotor that stands, as a share of the holding torque.
    pub(crate) const fn pull(&self, field: f64) -> f64 {
        self.drag * field / (self.omega * self.omega)
    }

    /// Whether a rotor that is so far from where it would be, and so much faster, is to be locked.
    pub(crate) fn is_close(&self, angle: f64, speed: f64) -> bool {
        let speed = speed / self.omega;
        angle * angle + speed * speed <= self.lock * self.lock
    }

    /// The rotor lags by `lag` and turns at `speed`: how it moves in so many seconds.
    pub(crate) fn motion(&self, forces: &Forces, lag: f64, speed: f64, seconds: f64) -> Motion {
        let Forces { torque, load: Load { friction, push }, field } = *forces;
        let square = self.omega * self.omega;
        let driven = |lag: f64| square * (torque * libm::sin(lag) - push) + self.drag * field;
        let now = driven(lag);
        let sense = (if speed == 0.0 { now } else { speed }).signum();
        let braked = square * friction * sense;
        // The velocity Verlet method, with the drag taken implicitly.
        let acceleration = now - braked - self.drag * speed;
        let turned = seconds * (speed + seconds / 2.0 * acceleration);
        let then = driven(lag + field * seconds - turned) - braked;
        let end = (speed + seconds / 2.0 * (acceleration + then)) / (1.0 + seconds / 2.0 * self.drag);
        if friction == 0.0 || end * sense >= 0.0 {
            return Motion { share: 1.0, turned, speed: end };
        }
        if speed == 0.0 {
            return Motion { share: 1.0, turned: 0.0, speed: 0.0 };
        }
        let share = speed / (speed - end);
        Motion { share, turned: speed * share * seconds / 2.0, speed: 0.0 }
    }
}

impl Step {
    pub(crate) const fn new(path: Path, speeds: (f64, f64)) -> Self {
        Self { path, at: path.from, speeds }
    }

    /// The rotor's speed.
    pub(crate) fn speed(&self) -> f64 {
        let Path { from, to, .. } = self.path;
        let share = if self.at == to { 1.0 } else { (self.at - from) as f64 / (to - from) as f64 };
        self.speeds.0 + share * (self.speeds.1 - self.speeds.0)
    }
}

impl Path {
    pub(crate) const fn new(from: i64, to: i64, begin: &Mechanics, turned: i64) -> Self {
        Self { from, to, rotor: begin.rotor, carriage: begin.carriage, turned }
    }

    /// The mechanics when the rotor has come to this place.
    pub(crate) fn at(&self, place: i64, mechanics: &Mechanics) -> Mechanics {
        let mut mechanics = *mechanics;
        (mechanics.rotor, mechanics.carriage) = (self.rotor, self.carriage);
        mechanics.turn(if place == self.to {
            self.turned
        } else {
            (i128::from(self.turned) * i128::from(place - self.from) / i128::from(self.to - self.from)) as i64
        });
        mechanics
    }
}
