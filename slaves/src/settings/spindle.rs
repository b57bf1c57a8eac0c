//! The settings of the main motor's board.

use serde::{Deserialize, Serialize};

use super::within;

/// The settings of the main motor's board.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SpindleSettings {
    /// The motor.
    pub plant: SpindlePlant,
    /// What drives it.
    pub drive: SpindleDrive,
    /// What it is measured with.
    pub encoder: SpindleEncoder,
    /// The firmware.
    pub controller: SpindleController,
}

/// The main motor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SpindlePlant {
    /// The gain, in rad/s per V: 0.1 to 1000. Default 19 (§4; the unit is inferred: 5500 rpm at 30 V).
    pub km_rad_per_s_volt: f64,
    /// The time constant, in s: 0.01 to 1000. Default 2.8 (§4).
    pub tau_s: f64,
    /// Coulomb friction, as a share of the torque at standstill with full drive: 0 to 2. Default 0.
    pub friction: f64,
    /// The cut's torque, as such a share: 0 to 2. It opposes motion, and turns nothing. Default 0.
    pub load_torque: f64,
}

/// The main motor's power stage: one transistor, which cannot brake (§4).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SpindleDrive {
    /// The voltage at full drive, in V: 1 to 1000. Default 30 (§4).
    pub supply_v: f64,
    /// The bits of the pulse's width: 1 to 24. Default 10, the PIC's own. (Ours.)
    pub bits: u32,
}

/// The main motor's encoder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SpindleEncoder {
    /// Pulses per revolution: 1 to 1000000. Default 50 (§4).
    pub pulses_per_rev: u32,
}

/// The main motor's firmware.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SpindleController {
    /// What the compensator's output is. Default incremental.
    pub form: LeadForm,
    /// The compensator's gain (Eq. 7), in V per rad/s: 0 to 100. Default 0.30. (Ours.)
    pub k: f64,
    /// The compensator's zero (Eq. 7): 0 to 1. Default 0.97. (Ours.)
    pub alpha: f64,
    /// The compensator's pole, negated (Eq. 7): −0.99 to 0.99. Default −0.60. (Ours.)
    pub beta: f64,
    /// The window in which pulses are counted, in ms: 5 to 1000. Default 30 (§4; Eq. 6 was computed with 32).
    pub window_ms: u32,
    /// The supply that the firmware reckons with, in V: 1 to 1000. Default 30 (§4).
    pub supply_v: f64,
    /// The motor's gain that the feed-forward form reckons with, in rad/s per V: 0.1 to 1000. Default 19 (§4).
    pub km_rad_per_s_volt: f64,
}

/// What the output c of the compensator is (Eq. 7), with u the drive in V, r the set point and e the error in rad/s.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LeadForm {
    /// The change of the drive, u(k) = u(k−1) + c(k): "la modificación necesaria del ancho del pulso" (§4).
    #[default]
    Incremental,
    /// What is added to the drive that the set point takes: u = r/km + c. (Ours.)
    FeedForward,
    /// The drive itself, u = c: Eq. 7 taken at its word. It leaves a standing error.
    Literal,
}

impl Default for SpindlePlant {
    fn default() -> Self {
        Self { km_rad_per_s_volt: 19.0, tau_s: 2.8, friction: 0.0, load_torque: 0.0 }
    }
}

impl Default for SpindleDrive {
    fn default() -> Self {
        Self { supply_v: 30.0, bits: 10 }
    }
}

impl Default for SpindleEncoder {
    fn default() -> Self {
        Self { pulses_per_rev: 50 }
    }
}

impl Default for SpindleController {
    fn default() -> Self {
        Self {
            form: LeadForm::Incremental,
            k: 0.30,
            alpha: 0.97,
            beta: -0.60,
            window_ms: 30,
            supply_v: 30.0,
            km_rad_per_s_volt: 19.0,
        }
    }
}

impl SpindleSettings {
    /// Checks every field's range.
    ///
    /// # Errors
    /// The first field that is out of range: its name, what was expected, what was found.
    pub fn check(&self) -> Result<(), String> {
        let Self { plant, drive, encoder, controller } = self;
        within("plant.km_rad_per_s_volt", plant.km_rad_per_s_volt, 0.1, 1_000.0)?;
        within("plant.tau_s", plant.tau_s, 0.01, 1_000.0)?;
        within("plant.friction", plant.friction, 0.0, 2.0)?;
        within("plant.load_torque", plant.load_torque, 0.0, 2.0)?;
        within("drive.supply_v", drive.supply_v, 1.0, 1_000.0)?;
        within("drive.bits", drive.bits, 1.0, 24.0)?;
        within("encoder.pulses_per_rev", encoder.pulses_per_rev, 1.0, 1e6)?;
        within("controller.k", controller.k, 0.0, 100.0)?;
        within("controller.alpha", controller.alpha, 0.0, 1.0)?;
        within("controller.beta", controller.beta, -0.99, 0.99)?;
        within("controller.window_ms", controller.window_ms, 5.0, 1_000.0)?;
        within("controller.supply_v", controller.supply_v, 1.0, 1_000.0)?;
        within("controller.km_rad_per_s_volt", controller.km_rad_per_s_volt, 0.1, 1_000.0)
    }
}
