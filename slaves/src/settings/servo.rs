//! The settings of the servo stand's board.

use torno_protocol::settings::OutOfRange;
use torno_protocol::{choice, settings};

use super::{axis, timing};
use crate::schedule::Timing;

settings! {
    /// The settings of the servo stand's board.
    pub struct ServoSettings {
        /// The motor, the screw and the carriage.
        plant: ServoPlant;
        /// What drives the motor.
        drive: ServoDrive;
        /// What the screw's position is measured with.
        encoder: ServoEncoder;
        /// The firmware.
        controller: ServoController;
    }
}

settings! {
    /// The motor, its screw and its carriage (§2.2, §2.3).
    pub struct ServoPlant {
        /// The motor's time constant.
        tau_s: f64 = 0.03, axis::TAU_S, "s", "ours; the sheet gives none";
        /// The motor's speed at full drive.
        rpm: f64 = 500.0, axis::RPM, "rpm", "§2.2";
        /// The lead of the screw.
        pitch_mm: f64 = 2.0, axis::PITCH_MM, "mm per revolution", "§2.3";
        /// The travel.
        travel_mm: f64 = 425.0, axis::TRAVEL_MM, "mm", "§2.3";
        /// How far beyond it at either side the carriage meets a hard stop.
        overtravel_mm: f64 = 1.0, 0.0..=100.0, "mm", "ours";
        /// Dead travel between screw and carriage.
        backlash_mm: f64 = 0.0, axis::BACKLASH_MM, "mm", "ours";
        /// Coulomb friction, as a share of the torque at standstill with full drive.
        friction: f64 = 0.0, axis::FRICTION, "", "ours";
        /// A torque in the negative sense whatever the motion, as such a share.
        load_torque: f64 = 0.0, axis::LOAD_TORQUE, "", "ours";
        /// The dead time between drive and motor: of an amplifier, of a gear that gives.
        dead_ms: f64 = 0.0, axis::DEAD_MS, "ms", "ours";
    }
}

settings! {
    /// The motor's power supply, which the controller sets over the interface UP (Fig. 1).
    pub struct ServoDrive {
        /// The supply, as a share of the 12 V that `plant.rpm` holds for.
        supply: f64 = 1.0, axis::SUPPLY, "", "ours";
        /// The fullest drive either way: by default a signed byte for ±12 V.
        full: u16 = 127, 1..=32_767, "LSB", "ours";
    }
}

settings! {
    /// The incremental encoder on the screw (MPL3).
    pub struct ServoEncoder {
        /// Pulses a revolution: 125 a mm, 2 mm a revolution.
        pulses_per_rev: u32 = 250, 1..=1_000_000, "", "§2.3";
    }
}

settings! {
    /// The firmware of the servo stand.
    pub struct ServoController where ServoController::check_jitter {
        /// Kx at power-on.
        kx: u8 = 16, 0..=255, "LSB/16 per count", "ours";
        /// Kv at power-on.
        kv: u8 = 0, 0..=255, "LSB/16 per count a tick", "ours";
        /// What Kv works on.
        kv_on: KvOn = KvOn::SetPoint, KvOn::NAMES, "", "ours; the sheet does not say";
        /// The time between two increments: 200 a second.
        tick_ms: u32 = 5, 1..=100, "ms", "§3.1";
        /// A larger following error is a fault. By default it is 32 mm.
        error_max_counts: u16 = 4_000, 1..=32_767, "counts", "ours";
        /// How late a sample may be. It must not be later than the next one.
        jitter_us: u32 = 0, timing::JITTER_US, "µs", "ours";
        /// The seed of these delays: with another one there are others.
        jitter_seed: u32 = 0, timing::SEED, "", "ours";
    }
}

choice! {
    /// What Kv works on.
    pub enum KvOn {
        /// The increment of the set point: feed-forward.
        SetPoint = "set-point",
        /// The counts since the last tick, against the motion: damping.
        Position = "position",
    }
}

impl ServoSettings {
    /// The motor's speed at full drive, in counts/s.
    pub(crate) fn full_counts_per_s(&self) -> f64 {
        self.plant.rpm * f64::from(self.encoder.pulses_per_rev) / 60.0
    }

    /// So many mm of carriage in counts.
    pub fn counts(&self, mm: f64) -> f64 {
        mm / self.plant.pitch_mm * f64::from(self.encoder.pulses_per_rev)
    }
}

impl ServoController {
    /// When it samples.
    pub(crate) const fn timing(&self) -> Timing {
        timing::of(self.tick_ms, self.jitter_us, self.jitter_seed)
    }

    fn check_jitter(&self) -> Result<(), OutOfRange> {
        timing::check(self.tick_ms, self.jitter_us)
    }
}
