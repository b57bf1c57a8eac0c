//! The settings of the infeed axis's board.

use serde::{Deserialize, Serialize};

use super::within;

/// Driven for so many slot times without a slot, the axis is stalled. (Ours.)
const STALL_SLOTS: f64 = 3.0;
/// But not sooner than this, in ms: a motor takes its time to start. (Ours.)
const STALL_MS: f64 = 200.0;

/// The settings of the infeed axis's board.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DepthSettings {
    /// The motor, the screw and the slide.
    pub plant: DepthPlant,
    /// What drives the motor.
    pub drive: DepthDrive,
    /// What the slide's position is measured with.
    pub encoder: DepthEncoder,
    /// The firmware.
    pub controller: DepthController,
}

/// The geared motor of the infeed axis, its screw and its slide.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DepthPlant {
    /// The motor's time constant, in s: 0.001 to 10. Default 0.05. (Ours.)
    pub tau_s: f64,
    /// The motor's speed when driven, in rpm: 0.1 to 1000. Default 8 (§4).
    pub rpm: f64,
    /// The lead of the screw, in mm per revolution: 0.1 to 100. Default 2. (Ours; the paper gives none.)
    pub pitch_mm: f64,
    /// The way from one end stop to the other, in mm: 0.1 to 10000. Default 160 (§4).
    pub travel_mm: f64,
    /// Dead travel between motor and slide, in mm: 0 to 10. Default 0.
    pub backlash_mm: f64,
    /// Coulomb friction, as a share of the torque at standstill when driven: 0 to 2. Default 0.
    pub friction: f64,
    /// A torque in the negative sense whatever the motion, as such a share: −2 to 2. Default 0.
    pub load_torque: f64,
}

/// The H-bridge of the infeed axis: two pins for the sense, and nothing between on and off (§4).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DepthDrive {
    /// The supply, as a share of the one that `plant.rpm` holds for: 0.01 to 2. Default 1.
    pub supply: f64,
}

/// The encoder along the slide.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DepthEncoder {
    /// Its slots: 2 to 100000000. Default 900 (§4).
    pub slots: u32,
    /// The length over which they are spread, in mm: 1 to 10000. Default 160 (§4): a slot is 0.1778 mm. With 153 it
    /// is the 0.17 mm that the paper prints.
    pub length_mm: f64,
}

/// The firmware of the infeed axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DepthController {
    /// The time between polls of the encoder, in ms: 1 to 1000. Default 10. (Ours.)
    pub poll_ms: u32,
}

impl Default for DepthPlant {
    fn default() -> Self {
        Self {
            tau_s: 0.05,
            rpm: 8.0,
            pitch_mm: 2.0,
            travel_mm: 160.0,
            backlash_mm: 0.0,
            friction: 0.0,
            load_torque: 0.0,
        }
    }
}

impl Default for DepthDrive {
    fn default() -> Self {
        Self { supply: 1.0 }
    }
}

impl Default for DepthEncoder {
    fn default() -> Self {
        Self { slots: 900, length_mm: 160.0 }
    }
}

impl Default for DepthController {
    fn default() -> Self {
        Self { poll_ms: 10 }
    }
}

impl DepthSettings {
    /// Checks every field's range.
    ///
    /// # Errors
    /// The first field that is out of range: its name, what was expected, what was found.
    pub fn check(&self) -> Result<(), String> {
        let Self { plant, drive, encoder, controller } = self;
        within("plant.tau_s", plant.tau_s, 0.001, 10.0)?;
        within("plant.rpm", plant.rpm, 0.1, 1_000.0)?;
        within("plant.pitch_mm", plant.pitch_mm, 0.1, 100.0)?;
        within("plant.travel_mm", plant.travel_mm, 0.1, 10_000.0)?;
        within("plant.backlash_mm", plant.backlash_mm, 0.0, 10.0)?;
        within("plant.friction", plant.friction, 0.0, 2.0)?;
        within("plant.load_torque", plant.load_torque, -2.0, 2.0)?;
        within("drive.supply", drive.supply, 0.01, 2.0)?;
        within("encoder.slots", encoder.slots, 2.0, 1e8)?;
        within("encoder.length_mm", encoder.length_mm, 1.0, 10_000.0)?;
        within("controller.poll_ms", controller.poll_ms, 1.0, 1_000.0)
    }

    /// The speed when driven, in mm/s.
    pub(crate) fn speed_mm_per_s(&self) -> f64 {
        self.plant.pitch_mm * self.plant.rpm / 60.0
    }

    /// Slots in a mm.
    pub fn slots_per_mm(&self) -> f64 {
        f64::from(self.encoder.slots) / self.encoder.length_mm
    }

    /// So many polls without a slot are a stall.
    pub(crate) fn stall_polls(&self) -> u32 {
        let slot_ms = 1_000.0 / (self.slots_per_mm() * self.speed_mm_per_s());
        let polls = (STALL_SLOTS * slot_ms).max(STALL_MS) / f64::from(self.controller.poll_ms);
        polls.ceil().max(2.0) as u32
    }
}
