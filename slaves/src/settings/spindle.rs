//! The settings of the main motor's board.

use torno_protocol::settings::OutOfRange;
use torno_protocol::{choice, settings};

use super::{axis, timing};
use crate::schedule::Timing;

settings! {
    /// The settings of the main motor's board.
    pub struct SpindleSettings {
        /// The motor.
        plant: SpindlePlant;
        /// What drives it.
        drive: SpindleDrive;
        /// What it is measured with.
        encoder: SpindleEncoder;
        /// The firmware.
        controller: SpindleController;
    }
}

settings! {
    /// The main motor.
    pub struct SpindlePlant {
        /// The gain. (Its unit is inferred: 5500 rpm at 30 V.)
        km_rad_per_s_volt: f64 = 19.0, 0.1..=1_000.0, "rad/s per V", "§4";
        /// The time constant.
        tau_s: f64 = 2.8, 0.01..=1_000.0, "s", "§4";
        /// Coulomb friction, as a share of the torque at standstill with full drive.
        friction: f64 = 0.0, axis::FRICTION, "", "ours";
        /// The cut's torque, as such a share. It opposes motion, and turns nothing.
        load_torque: f64 = 0.0, 0.0..=2.0, "", "ours";
        /// The dead time between drive and motor: of an amplifier, of a gear that gives.
        dead_ms: f64 = 0.0, axis::DEAD_MS, "ms", "ours";
    }
}

settings! {
    /// The main motor's power stage: one transistor, which cannot brake (§4).
    pub struct SpindleDrive {
        /// The voltage at full drive.
        supply_v: f64 = 30.0, 1.0..=1_000.0, "V", "§4";
        /// The bits of the pulse's width: by default the PIC's own.
        bits: u32 = 10, 1..=24, "", "ours";
    }
}

settings! {
    /// The main motor's encoder.
    pub struct SpindleEncoder {
        /// Pulses per revolution.
        pulses_per_rev: u32 = 50, 1..=1_000_000, "", "§4";
    }
}

settings! {
    /// The main motor's firmware.
    pub struct SpindleController where SpindleController::check_jitter {
        /// What the compensator's output is.
        form: LeadForm = LeadForm::Incremental, LeadForm::NAMES, "", "§4";
        /// The compensator's gain (Eq. 7).
        k: f64 = 0.30, 0.0..=100.0, "V per rad/s", "ours";
        /// The compensator's zero (Eq. 7).
        alpha: f64 = 0.97, 0.0..=1.0, "", "ours";
        /// The compensator's pole, negated (Eq. 7).
        beta: f64 = -0.60, -0.99..=0.99, "", "ours";
        /// The window in which pulses are counted. (Eq. 6 was computed with 32.)
        window_ms: u32 = 30, 5..=1_000, "ms", "§4";
        /// The supply that the firmware reckons with.
        supply_v: f64 = 30.0, 1.0..=1_000.0, "V", "§4";
        /// The motor's gain that the feed-forward form reckons with.
        km_rad_per_s_volt: f64 = 19.0, 0.1..=1_000.0, "rad/s per V", "§4";
        /// How late a sample may be. It must not be later than the next one.
        jitter_us: u32 = 0, timing::JITTER_US, "µs", "ours";
        /// The seed of these delays: with another one there are others.
        jitter_seed: u32 = 0, timing::SEED, "", "ours";
    }
}

choice! {
    /// What the output c of the compensator is (Eq. 7), with u the drive in V, r the set point and e the error in
    /// rad/s.
    pub enum LeadForm {
        /// The change of the drive, u(k) = u(k−1) + c(k): "la modificación necesaria del ancho del pulso" (§4).
        Incremental = "incremental",
        /// What is added to the drive that the set point takes: u = r/km + c. (Ours.)
        FeedForward = "feed-forward",
        /// The drive itself, u = c: Eq. 7 taken at its word. It leaves a standing error.
        Literal = "literal",
    }
}

impl SpindleSettings {
    /// What a count in a window is, in rpm.
    pub(crate) fn rpm_per_count(&self) -> f64 {
        60_000.0 / (f64::from(self.encoder.pulses_per_rev) * f64::from(self.controller.window_ms))
    }
}

impl SpindleController {
    /// When it samples.
    pub(crate) const fn timing(&self) -> Timing {
        timing::of(self.window_ms, self.jitter_us, self.jitter_seed)
    }

    fn check_jitter(&self) -> Result<(), OutOfRange> {
        timing::check(self.window_ms, self.jitter_us)
    }
}
