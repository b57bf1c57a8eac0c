//! The settings of the infeed axis's board.

use torno_protocol::settings;

use super::axis;
use crate::plant::PositionMotor;

/// Driven for so many slot times without a slot, the axis is stalled. (Ours.)
const STALL_SLOTS: f64 = 3.0;
/// But not sooner than this, in ms: a motor takes its time to start. (Ours.)
const STALL_MS: f64 = 200.0;

settings! {
    /// The settings of the infeed axis's board.
    pub struct DepthSettings {
        /// The motor, the screw and the slide.
        plant: DepthPlant;
        /// What drives the motor.
        drive: DepthDrive;
        /// What the slide's position is measured with.
        encoder: DepthEncoder;
        /// The firmware.
        controller: DepthController;
    }
}

settings! {
    /// The geared motor of the infeed axis, its screw and its slide.
    pub struct DepthPlant {
        /// The motor's time constant.
        tau_s: f64 = 0.05, 0.001..=10.0, "s", "ours";
        /// The motor's speed when driven.
        rpm: f64 = 8.0, 0.1..=1_000.0, "rpm", "§4";
        /// The lead of the screw.
        pitch_mm: f64 = 2.0, axis::PITCH_MM, "mm per revolution", "ours; the paper gives none";
        /// The way from one end stop to the other.
        travel_mm: f64 = 160.0, axis::TRAVEL_MM, "mm", "§4";
        /// Dead travel between motor and slide.
        backlash_mm: f64 = 0.0, axis::BACKLASH_MM, "mm", "ours";
        /// Coulomb friction, as a share of the torque at standstill when driven.
        friction: f64 = 0.0, axis::FRICTION, "", "ours";
        /// A torque in the negative sense whatever the motion, as such a share.
        load_torque: f64 = 0.0, axis::LOAD_TORQUE, "", "ours";
    }
}

settings! {
    /// The H-bridge of the infeed axis: two pins for the sense, and nothing between on and off (§4).
    pub struct DepthDrive {
        /// The supply, as a share of the one that `plant.rpm` holds for.
        supply: f64 = 1.0, axis::SUPPLY, "", "ours";
    }
}

settings! {
    /// The encoder along the slide.
    pub struct DepthEncoder {
        /// Its slots.
        slots: u32 = 900, 2..=100_000_000, "", "§4";
        /// The length over which they are spread. By default a slot is 0.1778 mm; with 153 it is the 0.17 mm that the
        /// paper prints.
        length_mm: f64 = 160.0, 1.0..=10_000.0, "mm", "§4";
    }
}

settings! {
    /// The firmware of the infeed axis.
    pub struct DepthController {
        /// The time between polls of the encoder.
        poll_ms: u32 = 10, 1..=1_000, "ms", "ours";
    }
}

impl DepthSettings {
    /// The speed when driven, in mm/s.
    pub fn speed_mm_per_s(&self) -> f64 {
        self.plant.pitch_mm * self.plant.rpm / 60.0
    }

    /// The speed that it cannot exceed, in mm/s: a torque in its sense helps.
    pub(crate) fn fastest_mm_per_s(&self) -> f64 {
        (self.drive.supply + self.plant.load_torque.abs()) * self.speed_mm_per_s()
    }

    /// The motor with its slide, in mm.
    pub(crate) fn motor(&self) -> PositionMotor {
        let Self { plant, drive, .. } = self;
        PositionMotor::new(plant.tau_s, self.speed_mm_per_s(), plant.travel_mm / 2.0)
            .with_load(plant.friction, plant.load_torque, drive.supply)
            .with_backlash(plant.backlash_mm)
    }

    /// Slots in a mm.
    pub fn slots_per_mm(&self) -> f64 {
        f64::from(self.encoder.slots) / self.encoder.length_mm
    }

    /// So many slots beyond the edge of its target's slot the slide comes to rest, without friction: half a time
    /// between polls passes until the firmware sees the edge, then the slide coasts.
    pub fn overrun_slots(&self) -> f64 {
        let slots_per_s = self.slots_per_mm() * self.speed_mm_per_s() * self.drive.supply;
        slots_per_s * (f64::from(self.controller.poll_ms) / 2_000.0 + self.plant.tau_s)
    }

    /// So many polls without a slot are a stall.
    pub(crate) fn stall_polls(&self) -> u32 {
        let slot_ms = 1_000.0 / (self.slots_per_mm() * self.speed_mm_per_s());
        let polls = (STALL_SLOTS * slot_ms).max(STALL_MS) / f64::from(self.controller.poll_ms);
        polls.ceil().max(2.0) as u32
    }
}
