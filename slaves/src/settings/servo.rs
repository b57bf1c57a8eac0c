//! The settings of the servo stand's board.

use serde::{Deserialize, Serialize};

use super::within;

/// The settings of the servo stand's board.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ServoSettings {
    /// The motor, the screw and the carriage.
    pub plant: ServoPlant,
    /// What drives the motor.
    pub drive: ServoDrive,
    /// What the screw's position is measured with.
    pub encoder: ServoEncoder,
    /// The firmware.
    pub controller: ServoController,
}

/// The motor, its screw and its carriage (§2.2, §2.3).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ServoPlant {
    /// The motor's time constant, in s: 0.001 to 100. Default 0.03. (Ours; the sheet gives none.)
    pub tau_s: f64,
    /// The motor's speed at full drive, in rpm: 0.1 to 10000. Default 500 (§2.2).
    pub rpm: f64,
    /// The lead of the screw, in mm per revolution: 0.1 to 100. Default 2 (§2.3).
    pub pitch_mm: f64,
    /// The travel, in mm: 0.1 to 10000. Default 425 (§2.3).
    pub travel_mm: f64,
    /// How far beyond it at either side the carriage meets a hard stop, in mm: 0 to 100. Default 1. (Ours.)
    pub overtravel_mm: f64,
    /// Dead travel between screw and carriage, in mm: 0 to 10. Default 0.
    pub backlash_mm: f64,
    /// Coulomb friction, as a share of the torque at standstill with full drive: 0 to 2. Default 0.
    pub friction: f64,
    /// A torque in the negative sense whatever the motion, as such a share: −2 to 2. Default 0.
    pub load_torque: f64,
}

/// The motor's power supply, which the controller sets over the interface UP (Fig. 1).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ServoDrive {
    /// The supply, as a share of the 12 V that `plant.rpm` holds for: 0.01 to 2. Default 1.
    pub supply: f64,
    /// The fullest drive either way, in LSB: 1 to 32767. Default 127. (Ours: a signed byte for ±12 V.)
    pub full: u16,
}

/// The incremental encoder on the screw (MPL3).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ServoEncoder {
    /// Pulses a revolution: 1 to 1000000. Default 250 (§2.3: 125 a mm, 2 mm a revolution).
    pub pulses_per_rev: u32,
}

/// The firmware of the servo stand.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ServoController {
    /// Kx at power-on, in sixteenths of an LSB per count: 0 to 255. Default 16. (Ours.)
    pub kx: u8,
    /// Kv at power-on, in sixteenths of an LSB per count a tick: 0 to 255. Default 0. (Ours.)
    pub kv: u8,
    /// What Kv works on. Default the set point. (Ours; the sheet does not say.)
    pub kv_on: KvOn,
    /// The time between two increments, in ms: 1 to 100. Default 5 (§3.1: 200 a second).
    pub tick_ms: u32,
    /// A larger following error is a fault, in counts: 1 to 32767. Default 4000, which is 32 mm. (Ours.)
    pub error_max_counts: u16,
}

/// What Kv works on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum KvOn {
    /// The increment of the set point: feed-forward.
    #[default]
    SetPoint,
    /// The counts since the last tick, against the motion: damping.
    Position,
}

impl Default for ServoPlant {
    fn default() -> Self {
        Self {
            tau_s: 0.03,
            rpm: 500.0,
            pitch_mm: 2.0,
            travel_mm: 425.0,
            overtravel_mm: 1.0,
            backlash_mm: 0.0,
            friction: 0.0,
            load_torque: 0.0,
        }
    }
}

impl Default for ServoDrive {
    fn default() -> Self {
        Self { supply: 1.0, full: 127 }
    }
}

impl Default for ServoEncoder {
    fn default() -> Self {
        Self { pulses_per_rev: 250 }
    }
}

impl Default for ServoController {
    fn default() -> Self {
        Self { kx: 16, kv: 0, kv_on: KvOn::SetPoint, tick_ms: 5, error_max_counts: 4_000 }
    }
}

impl ServoSettings {
    /// Checks every field's range.
    ///
    /// # Errors
    /// The first field that is out of range: its name, what was expected, what was found.
    pub fn check(&self) -> Result<(), String> {
        let Self { plant, drive, encoder, controller } = self;
        within("plant.tau_s", plant.tau_s, 0.001, 100.0)?;
        within("plant.rpm", plant.rpm, 0.1, 10_000.0)?;
        within("plant.pitch_mm", plant.pitch_mm, 0.1, 100.0)?;
        within("plant.travel_mm", plant.travel_mm, 0.1, 10_000.0)?;
        within("plant.overtravel_mm", plant.overtravel_mm, 0.0, 100.0)?;
        within("plant.backlash_mm", plant.backlash_mm, 0.0, 10.0)?;
        within("plant.friction", plant.friction, 0.0, 2.0)?;
        within("plant.load_torque", plant.load_torque, -2.0, 2.0)?;
        within("drive.supply", drive.supply, 0.01, 2.0)?;
        within("drive.full", drive.full, 1.0, 32_767.0)?;
        within("encoder.pulses_per_rev", encoder.pulses_per_rev, 1.0, 1e6)?;
        within("controller.tick_ms", controller.tick_ms, 1.0, 100.0)?;
        within("controller.error_max_counts", controller.error_max_counts, 1.0, 32_767.0)
    }

    /// The motor's speed at full drive, in counts/s.
    pub(crate) fn full_counts_per_s(&self) -> f64 {
        self.plant.rpm * f64::from(self.encoder.pulses_per_rev) / 60.0
    }

    /// So many mm of carriage in counts.
    pub fn counts(&self, mm: f64) -> f64 {
        mm / self.plant.pitch_mm * f64::from(self.encoder.pulses_per_rev)
    }
}
