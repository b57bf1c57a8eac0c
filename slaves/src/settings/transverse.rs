//! The settings of the feed axis's board.

use serde::{Deserialize, Serialize};

use super::within;

/// The settings of the feed axis's board.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TransverseSettings {
    /// The motor, the screw and the carriage.
    pub plant: TransversePlant,
    /// What drives the motor.
    pub drive: TransverseDrive,
    /// What the motor's position is measured with.
    pub encoder: TransverseEncoder,
    /// The firmware.
    pub controller: TransverseController,
}

/// The motor of the feed axis, its screw and its carriage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TransversePlant {
    /// What moves. Default the motor.
    pub model: PositionModel,
    /// The motor's time constant, in s: 0.001 to 100. Default 0.71875 (the open loop behind Eq. 11: 1/(2ξω)).
    pub tau_s: f64,
    /// The motor's speed at full drive, in rpm: 0.1 to 10000. Default 500 (§4).
    pub rpm: f64,
    /// The lead of the screw, in mm per revolution: 0.1 to 100. Default 2. (Ours; the paper gives none.)
    pub pitch_mm: f64,
    /// The way from one end stop to the other, in mm: 0.1 to 10000. Default 160. (Ours.)
    pub travel_mm: f64,
    /// Dead travel between motor and carriage, in mm: 0 to 10. Default 0.
    pub backlash_mm: f64,
    /// Coulomb friction, as a share of the torque at standstill with full drive: 0 to 2. Default 0.
    pub friction: f64,
    /// A torque in the negative sense whatever the motion, as such a share: −2 to 2. Default 0.
    pub load_torque: f64,
    /// The coefficients of the model `eq-12`.
    pub eq12: Eq12,
}

/// What moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PositionModel {
    /// The open loop Km/(s(τs + 1)), with its carriage and its end stops.
    #[default]
    Motor,
    /// Eq. 12, from the drive in LSB to the position in counts, a step every sample; with nothing but end stops.
    #[serde(rename = "eq-12")]
    Eq12,
}

/// gain·(z + zero)/(z² − a1·z + a2): by default as the paper prints it, which is unstable.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Eq12 {
    /// −10 to 10. Default 0.0018695 (Eq. 12).
    pub gain: f64,
    /// −10 to 10. Default 0.9653 (Eq. 12; Eq. 11 gives 0.9853).
    pub zero: f64,
    /// −10 to 10. Default 1.958 (Eq. 12; Eq. 11 gives 1.953).
    pub a1: f64,
    /// −10 to 10. Default 0.9568 (Eq. 12; Eq. 11 gives 0.9565).
    pub a2: f64,
}

/// The H-bridge of the feed axis: a magnitude by a port and a D/A converter, and two pins for the sense (§4).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TransverseDrive {
    /// The supply, as a share of the one that `plant.rpm` holds for: 0.01 to 2. Default 1.
    pub supply: f64,
    /// The bits of the magnitude: 1 to 24. Default 8 (§4).
    pub bits: u32,
}

/// The encoder on the motor's shaft.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TransverseEncoder {
    /// Slots a revolution: 1 to 1000000. Default 900 (§4).
    pub slots_per_rev: u32,
}

/// The firmware of the feed axis. LSB are the drive's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TransverseController {
    /// The law. Default the PID.
    pub form: PositionForm,
    /// How the set point goes to its target. Default along a trapezoid.
    pub set_point: SetPoint,
    /// K1 = Kp (Eq. 14), in LSB per count: 0 to 1000000. Default 1.5. (Ours.)
    pub k1: f64,
    /// K2 = Kp/Ti (Eq. 14), in LSB per count and s: 0 to 1000000. Default 0.5. (Ours.)
    pub k2: f64,
    /// K3 = Kp·Td (Eq. 14), in LSB·s per count: 0 to 1000000. Default 0.27. (Ours.)
    pub k3: f64,
    /// The gain of the characterisation's loop (Fig. 9), in LSB per count: 0 to 1000000. Default 0.0905815:
    /// Km·255/7500.
    pub kch: f64,
    /// The largest error that is integrated, in counts: 0 to 1000000. Default 50. (Ours.)
    pub integral_zone_counts: u32,
    /// Feed-forward of the set point's speed, in LSB per count/s: 0 to 1000000. Default 0.034: 255/7500. (Ours.)
    pub kv: f64,
    /// Feed-forward of its acceleration, in LSB per count/s²: 0 to 1000000. Default 0.0244375: τ·kv. (Ours.)
    pub ka: f64,
    /// The set point's acceleration, in counts per sample²: 1 to 225. Default 3. (Ours.)
    pub accel_counts_per_sample2: u32,
    /// The sampling time, in ms: 1 to 1000. Default 30 (§4; Eq. 12 was computed with 32).
    pub sample_ms: u32,
    /// How near the target is in position, in counts: 0 to 1000. Default 1. (Ours.)
    pub in_position_counts: u32,
}

/// The law of the feed axis: the drive u for the error x, both at a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PositionForm {
    /// Eq. 14, with an integral state.
    #[default]
    Pid,
    /// Eq. 15 taken at its word: the whole output u(k−1) in the place of the integral state.
    Literal,
    /// Fig. 9: u = Kch·x, the loop in which the motor was characterised (Eq. 8 to 11).
    Characterisation,
    /// No loop: the set point, in counts, is the drive in LSB. (Ours.)
    Open,
}

/// How the set point goes to its target.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SetPoint {
    /// With limited speed and acceleration. (Ours.)
    #[default]
    Trapezoid,
    /// At once, whatever the sub-frame's speed.
    Step,
}

impl Default for TransversePlant {
    fn default() -> Self {
        Self {
            model: PositionModel::Motor,
            tau_s: 0.71875,
            rpm: 500.0,
            pitch_mm: 2.0,
            travel_mm: 160.0,
            backlash_mm: 0.0,
            friction: 0.0,
            load_torque: 0.0,
            eq12: Eq12::default(),
        }
    }
}

impl Default for Eq12 {
    fn default() -> Self {
        Self { gain: 0.001_869_5, zero: 0.9653, a1: 1.958, a2: 0.9568 }
    }
}

impl Default for TransverseDrive {
    fn default() -> Self {
        Self { supply: 1.0, bits: 8 }
    }
}

impl Default for TransverseEncoder {
    fn default() -> Self {
        Self { slots_per_rev: 900 }
    }
}

impl Default for TransverseController {
    fn default() -> Self {
        Self {
            form: PositionForm::Pid,
            set_point: SetPoint::Trapezoid,
            k1: 1.5,
            k2: 0.5,
            k3: 0.27,
            kch: 0.090_581_501_7,
            integral_zone_counts: 50,
            kv: 0.034,
            ka: 0.024_437_5,
            accel_counts_per_sample2: 3,
            sample_ms: 30,
            in_position_counts: 1,
        }
    }
}

impl TransverseSettings {
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
        within("plant.backlash_mm", plant.backlash_mm, 0.0, 10.0)?;
        within("plant.friction", plant.friction, 0.0, 2.0)?;
        within("plant.load_torque", plant.load_torque, -2.0, 2.0)?;
        within("plant.eq12.gain", plant.eq12.gain, -10.0, 10.0)?;
        within("plant.eq12.zero", plant.eq12.zero, -10.0, 10.0)?;
        within("plant.eq12.a1", plant.eq12.a1, -10.0, 10.0)?;
        within("plant.eq12.a2", plant.eq12.a2, -10.0, 10.0)?;
        within("drive.supply", drive.supply, 0.01, 2.0)?;
        within("drive.bits", drive.bits, 1.0, 24.0)?;
        within("encoder.slots_per_rev", encoder.slots_per_rev, 1.0, 1e6)?;
        within("controller.k1", controller.k1, 0.0, 1e6)?;
        within("controller.k2", controller.k2, 0.0, 1e6)?;
        within("controller.k3", controller.k3, 0.0, 1e6)?;
        within("controller.kch", controller.kch, 0.0, 1e6)?;
        within("controller.integral_zone_counts", controller.integral_zone_counts, 0.0, 1e6)?;
        within("controller.kv", controller.kv, 0.0, 1e6)?;
        within("controller.ka", controller.ka, 0.0, 1e6)?;
        within("controller.accel_counts_per_sample2", controller.accel_counts_per_sample2, 1.0, 225.0)?;
        within("controller.sample_ms", controller.sample_ms, 1.0, 1_000.0)?;
        within("controller.in_position_counts", controller.in_position_counts, 0.0, 1_000.0)
    }

    /// The motor's speed at full drive, in counts/s.
    pub(crate) fn full_counts_per_s(&self) -> f64 {
        self.plant.rpm * f64::from(self.encoder.slots_per_rev) / 60.0
    }

    /// So many mm of carriage in counts.
    pub(crate) fn counts(&self, mm: f64) -> f64 {
        mm / self.plant.pitch_mm * f64::from(self.encoder.slots_per_rev)
    }

    /// The sampling time, in s.
    pub(crate) fn sample_s(&self) -> f64 {
        f64::from(self.controller.sample_ms) / 1_000.0
    }
}
