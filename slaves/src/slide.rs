//! The infeed's slide, followed from outside.

use torno_protocol::time::{Instant, Span};

use crate::plant::PositionMotor;
use crate::settings::DepthSettings;

/// Nearer than this, in mm, it is where it comes to rest.
const NEAR: f64 = 1e-6;
/// A board's oscillator is no slower than this, as a share of nominal time.
const SLOWEST_CLOCK: f64 = 1.25;

/// The place of the infeed's slide between two edges of its encoder.
///
/// A count is a slot, and the slide stops just past an edge. Where, the law of the motor says. This is that law once
/// more, told what the board reports of its drive and its count. While nothing is broken it is where the board's own
/// slide is. A count that contradicts it puts it there: at an edge that the slide has come over, or into its slot.
#[derive(Clone, Debug)]
pub struct Slide {
    motor: PositionMotor,
    at: Instant,
    tau_s: f64,
    full: f64,
    slots_per_mm: f64,
    /// How far it can have gone before the firmware sees that it has come over an edge, in mm.
    late: f64,
    drive: i64,
    count: i64,
    /// Where it stands in mm, once it does.
    rest: Option<f64>,
}

impl Slide {
    /// As at power-on: at rest in mid-travel, in the middle of slot 0.
    pub fn new(settings: &DepthSettings) -> Self {
        Self {
            motor: settings.motor(),
            at: Instant::START,
            tau_s: settings.plant.tau_s,
            full: settings.speed_mm_per_s(),
            slots_per_mm: settings.slots_per_mm(),
            late: SLOWEST_CLOCK * settings.fastest_mm_per_s() * f64::from(settings.controller.poll_ms) / 1_000.0,
            drive: 0,
            count: 0,
            rest: None,
        }
    }

    /// Lets the time up to `now` pass with the drive as it is.
    pub fn advance(&mut self, now: Instant) {
        self.motor.advance(now);
        self.at = now;
        if self.drive == 0 && self.rest.is_none() && self.remaining().abs() <= NEAR {
            self.rest = Some(self.motor.carriage_coast_end());
        }
    }

    /// The board drives the motor this way from now on: −1, 0 or +1.
    pub fn drive(&mut self, drive: i64) {
        self.motor.drive(self.full * drive.signum() as f64);
        self.drive = drive;
        if drive != 0 {
            self.rest = None;
        }
    }

    /// The slide is in this slot, by the true count: if in another than before, it has just come over the edge.
    pub fn count(&mut self, count: i64) {
        let way = (count - self.count).signum() as f64;
        self.count = count;
        let place = self.motor.carriage();
        let edge = self.edge(-0.5 * way);
        let off = if way == 0.0 {
            self.within(place) - place
        } else {
            self.within(edge + way * ((place - edge) * way).clamp(0.0, self.late)) - place
        };
        if off != 0.0 {
            self.motor.shift(off);
            self.rest = None;
        }
    }

    /// Where it is, in counts from the start.
    pub fn counts(&self) -> f64 {
        // Beyond the edge of its slot it would have been counted, unless it is blocked.
        self.within(self.rest.unwrap_or(self.motor.carriage())) * self.slots_per_mm
    }

    /// When it will stand, if it coasts.
    pub fn stands_at(&self) -> Option<Instant> {
        let remaining = self.remaining().abs();
        if self.drive != 0 || self.rest.is_some() || !remaining.is_finite() {
            return None;
        }
        // With friction it stands sooner.
        let left_s = self.tau_s * libm::log((remaining / NEAR).max(1.0));
        Some(self.at + Span::from_nanos((left_s * 1e9) as u64) + Span::from_millis(1))
    }

    /// How far it goes on if it is not driven, in mm.
    fn remaining(&self) -> f64 {
        self.motor.carriage_coast_end() - self.motor.carriage()
    }

    /// The place in its slot that is nearest to one, in mm.
    fn within(&self, place: f64) -> f64 {
        place.clamp(self.edge(-0.5), self.edge(0.5))
    }

    /// So many slots from the middle of its slot, in mm.
    fn edge(&self, slots: f64) -> f64 {
        (self.count as f64 + slots) / self.slots_per_mm
    }
}
