//! What a logic analyser sees between a motor's firmware and its motor: the pins of its drive, and its encoder's.
//!
//! - `pwm`: the pulse-width modulator of the main motor. The paper does not say its frequency. (Ours: 1220.7 Hz, what a
//!   PIC of 20 MHz with a prescaler of 16 makes of 1024 steps.) In each period the pin is high for the drive's share of
//!   full drive, from the period's beginning on; full drive is high throughout. A new width holds from the next period
//!   on, as in a PIC; switched off, the pin is low at once.
//! - `forward`, `backward`: the two pins of an H-bridge; `d0` and so on: the port with the drive's magnitude, which a
//!   D/A converter makes a voltage of (§4). These change when the firmware sets them.
//! - `encoder`: high where the sensor looks through a slot, low at a bar. The count changes at one edge of a slot: a
//!   rising one in the positive sense, a falling one in the negative sense. What a fault makes the firmware count is
//!   not on the pin.

use torno_protocol::board::Pin;
use torno_protocol::clock::{Clock, Rate, Ticks};
use torno_protocol::line::Level;
use torno_protocol::time::{Instant, Span};

use crate::plant::Motion;

/// Periods of the pulse-width modulator in a second.
const PWM_RATE: Rate = Rate::fraction(20_000_000, 16 * 1_024);

/// What drives a motor, as its pins show it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// A transistor that is switched by a pulse-width modulator, whose fullest drive is so many LSB.
    Pwm(i64),
    /// An H-bridge, with a magnitude of so many bits; without bits it is switched on and off.
    Bridge(u32),
}

/// The pins of one motor.
#[derive(Clone, Debug)]
pub(crate) struct Pins {
    drive: Drive,
    encoder: Pin,
    /// The motor since the last event of its board.
    motion: Motion,
}

#[derive(Clone, Debug)]
enum Drive {
    Pwm(Pwm),
    Bridge { forward: Pin, backward: Pin, magnitude: Vec<Pin> },
}

impl Pins {
    pub(crate) fn new(stage: Stage, clock: Clock, motion: Motion) -> Self {
        let low = |name: &str| Pin::new(name, Level::Low);
        let drive = match stage {
            Stage::Pwm(full) => Drive::Pwm(Pwm::new(full, clock)),
            Stage::Bridge(bits) => Drive::Bridge {
                forward: low("forward"),
                backward: low("backward"),
                magnitude: (0..bits).map(|bit| low(&format!("d{bit}"))).collect(),
            },
        };
        Self { drive, encoder: Pin::new("encoder", level_of(motion.place())), motion }
    }

    /// An event of the board at `now`: the motor has come so far, and is driven with so many LSB from now on.
    pub(crate) fn note(&mut self, now: Instant, motion: Motion, lsb: i64) {
        self.follow(motion.at());
        // A gap that closes moves a slide at once.
        self.encoder.set(now, level_of(motion.place()));
        self.motion = motion;
        match &mut self.drive {
            Drive::Pwm(pwm) => pwm.set(now, lsb),
            Drive::Bridge { forward, backward, magnitude } => {
                forward.set(now, level(lsb > 0));
                backward.set(now, level(lsb < 0));
                for (bit, pin) in magnitude.iter_mut().enumerate() {
                    pin.set(now, level(lsb.unsigned_abs() >> bit & 1 == 1));
                }
            }
        }
    }

    /// The board's clock is another from now on.
    pub(crate) fn retune(&mut self, now: Instant, clock: Clock) {
        if let Drive::Pwm(pwm) = &mut self.drive {
            pwm.retune(now, clock);
        }
    }

    /// What they have done before `until`.
    pub(crate) fn until(&mut self, until: Instant) -> Vec<Pin> {
        self.follow(until - Span::from_nanos(1));
        let drive = match &mut self.drive {
            Drive::Pwm(pwm) => {
                pwm.run(until);
                vec![pwm.pin.clone()]
            }
            Drive::Bridge { forward, backward, magnitude } => {
                [forward.clone(), backward.clone()].into_iter().chain(magnitude.iter().cloned()).collect()
            }
        };
        let mut pins: Vec<Pin> = drive.into_iter().chain([self.encoder.clone()]).collect();
        pins.iter_mut().for_each(|pin| pin.edges.retain(|edge| edge.at < until));
        pins
    }

    fn follow(&mut self, until: Instant) {
        for (at, place) in self.motion.edges(until) {
            self.encoder.set(at, level_of(place));
        }
    }
}

const fn level(high: bool) -> Level {
    if high { Level::High } else { Level::Low }
}

/// Through an open part of the disc light comes.
const fn level_of(place: i64) -> Level {
    level(place % 2 == 0)
}

/// A pulse-width modulator with its pin.
#[derive(Clone, Debug)]
struct Pwm {
    pin: Pin,
    full: i64,
    width: i64,
    periods: Ticks,
    /// The number of the next period.
    next: u64,
}

impl Pwm {
    fn new(full: i64, clock: Clock) -> Self {
        let periods = Ticks::new(Instant::START, PWM_RATE, clock);
        Self { pin: Pin::new("pwm", Level::Low), full, width: 0, periods, next: 0 }
    }

    /// Goes through the periods that begin before `until`.
    fn run(&mut self, until: Instant) {
        if self.width == 0 {
            self.next = self.next.max(self.periods.first_from(until));
            return;
        }
        while self.periods.at(self.next) < until {
            let (begin, end) = (self.periods.at(self.next), self.periods.at(self.next + 1));
            self.pin.set(begin, Level::High);
            if self.width < self.full {
                let period = u128::from(end.since(begin).as_nanos());
                let (width, full) = (self.width.unsigned_abs(), self.full.unsigned_abs());
                let high = (period * u128::from(width) + u128::from(full) / 2) / u128::from(full);
                self.pin.set(begin + Span::from_nanos(high as u64), Level::Low);
            }
            self.next += 1;
        }
    }

    fn set(&mut self, now: Instant, width: i64) {
        self.run(now);
        self.width = width.clamp(0, self.full);
        if self.width == 0 {
            self.pin.edges.retain(|edge| edge.at <= now);
            self.pin.set(now, Level::Low);
        }
    }

    fn retune(&mut self, now: Instant, clock: Clock) {
        self.run(now);
        let coming = self.periods.at(self.next);
        self.periods = Ticks::new(coming, PWM_RATE, clock);
        self.next = 0;
    }
}
