//! The settings of the feed axis's board.

use core::ops::RangeInclusive;

use torno_protocol::settings::OutOfRange;
use torno_protocol::{choice, settings};

use super::{axis, timing};
use crate::schedule::Timing;

settings! {
    /// The settings of the feed axis's board.
    pub struct TransverseSettings {
        /// The motor, the screw and the carriage.
        plant: TransversePlant;
        /// What drives the motor.
        drive: TransverseDrive;
        /// What the motor's position is measured with.
        encoder: TransverseEncoder;
        /// The firmware.
        controller: TransverseController;
    }
}

settings! {
    /// The motor of the feed axis, its screw and its carriage.
    pub struct TransversePlant {
        /// What moves.
        model: PositionModel = PositionModel::Motor, PositionModel::NAMES, "", "ours";
        /// The motor's time constant: that of the open loop behind Eq. 11, 1/(2ξω).
        tau_s: f64 = 0.71875, axis::TAU_S, "s", "Eq. 11";
        /// The motor's speed at full drive.
        rpm: f64 = 500.0, axis::RPM, "rpm", "§4";
        /// The lead of the screw.
        pitch_mm: f64 = 2.0, axis::PITCH_MM, "mm per revolution", "ours; the paper gives none";
        /// The way from one end stop to the other.
        travel_mm: f64 = 160.0, axis::TRAVEL_MM, "mm", "ours";
        /// Dead travel between motor and carriage.
        backlash_mm: f64 = 0.0, axis::BACKLASH_MM, "mm", "ours";
        /// Coulomb friction, as a share of the torque at standstill with full drive.
        friction: f64 = 0.0, axis::FRICTION, "", "ours";
        /// A torque in the negative sense whatever the motion, as such a share.
        load_torque: f64 = 0.0, axis::LOAD_TORQUE, "", "ours";
        /// The dead time between drive and motor: of an amplifier, of a gear that gives.
        dead_ms: f64 = 0.0, axis::DEAD_MS, "ms", "ours";
        /// The coefficients of the model `eq-12`.
        eq12: Eq12;
    }
}

choice! {
    /// What moves.
    pub enum PositionModel {
        /// The open loop Km/(s(τs + 1)), with its carriage and its end stops.
        Motor = "motor",
        /// Eq. 12, from the drive in LSB to the position in counts, a step every sample; with nothing but end stops.
        Eq12 = "eq-12",
    }
}

settings! {
    /// gain·(z + zero)/(z² − a1·z + a2): by default as the paper prints it, which is unstable.
    pub struct Eq12 {
        /// The gain.
        gain: f64 = 0.001_869_5, -10.0..=10.0, "", "Eq. 12";
        /// The zero, negated. (Eq. 11 gives 0.9853.)
        zero: f64 = 0.9653, -10.0..=10.0, "", "Eq. 12";
        /// What weighs the output before. (Eq. 11 gives 1.953.)
        a1: f64 = 1.958, -10.0..=10.0, "", "Eq. 12";
        /// What weighs the output before that, negated. (Eq. 11 gives 0.9565.)
        a2: f64 = 0.9568, -10.0..=10.0, "", "Eq. 12";
    }
}

settings! {
    /// The H-bridge of the feed axis: a magnitude by a port and a D/A converter, and two pins for the sense (§4).
    pub struct TransverseDrive {
        /// The supply, as a share of the one that `plant.rpm` holds for.
        supply: f64 = 1.0, axis::SUPPLY, "", "ours";
        /// The bits of the magnitude.
        bits: u32 = 8, 1..=24, "", "§4";
    }
}

settings! {
    /// The encoder on the motor's shaft.
    pub struct TransverseEncoder {
        /// Slots a revolution.
        slots_per_rev: u32 = 900, 1..=1_000_000, "", "§4";
    }
}

settings! {
    /// The firmware of the feed axis. LSB are the drive's.
    pub struct TransverseController where TransverseController::check_jitter {
        /// The law.
        form: PositionForm = PositionForm::Pid, PositionForm::NAMES, "", "§4";
        /// How the set point goes to its target.
        set_point: SetPoint = SetPoint::Trapezoid, SetPoint::NAMES, "", "ours";
        /// K1 = Kp (Eq. 14).
        k1: f64 = 1.5, GAIN, "LSB per count", "ours";
        /// K2 = Kp/Ti (Eq. 14).
        k2: f64 = 1.0, GAIN, "LSB per count and s", "ours";
        /// K2 while set point and axis stand.
        k2_standing: f64 = 3.0, GAIN, "LSB per count and s", "ours";
        /// How fast the integral's growth grows while the axis stands out of its dead band; 0: it does not.
        breakaway: f64 = 500.0, GAIN, "LSB/s²", "ours";
        /// With set point and axis standing, so small an error is not integrated: friction holds the axis there.
        dead_band_counts: u32 = 1, 0..=1_000, "counts", "ours";
        /// K3 = Kp·Td (Eq. 14).
        k3: f64 = 0.27, GAIN, "LSB·s per count", "ours";
        /// The gain of the characterisation's loop (Fig. 9): Km·255/7500.
        kch: f64 = 0.090_581_501_7, GAIN, "LSB per count", "Eq. 11";
        /// The largest error that is integrated.
        integral_zone_counts: u32 = 50, 0..=1_000_000, "counts", "ours";
        /// Feed-forward of the set point's speed: 255/7500.
        kv: f64 = 0.034, GAIN, "LSB per count/s", "ours";
        /// Feed-forward of its acceleration: τ·kv.
        ka: f64 = 0.024_437_5, GAIN, "LSB per count/s²", "ours";
        /// The set point's acceleration.
        accel_counts_per_sample2: u32 = 3, 1..=225, "counts per sample²", "ours";
        /// A set point that is so far ahead waits for the axis. Without a load none is (813 counts); 0: it never waits.
        wait_counts: u32 = 900, 0..=1_000_000, "counts", "ours";
        /// What makes the axis done, and what stalled.
        judged_by: JudgedBy = JudgedBy::Motion, JudgedBy::NAMES, "", "ours";
        /// The sampling time. (Eq. 12 was computed with 32.)
        sample_ms: u32 = 30, 1..=1_000, "ms", "§4";
        /// How near the target is in position.
        in_position_counts: u32 = 1, 0..=1_000, "counts", "ours";
        /// How late a sample may be. It must not be later than the next one.
        jitter_us: u32 = 0, timing::JITTER_US, "µs", "ours";
        /// The seed of these delays: with another one there are others.
        jitter_seed: u32 = 0, timing::SEED, "", "ours";
    }
}

const GAIN: RangeInclusive<f64> = 0.0..=1e6;

choice! {
    /// The law of the feed axis: the drive u for the error x, both at a sample.
    pub enum PositionForm {
        /// Eq. 14, with an integral state.
        Pid = "pid",
        /// Eq. 15 taken at its word: the whole output u(k−1) in the place of the integral state.
        Literal = "literal",
        /// Fig. 9: u = Kch·x, the loop in which the motor was characterised (Eq. 8 to 11).
        Characterisation = "characterisation",
        /// No loop: the set point, in counts, is the drive in LSB. (Ours.)
        Open = "open",
    }
}

choice! {
    /// What makes an axis done, and what makes it stalled.
    pub enum JudgedBy {
        /// Done: 0.24 s in position, moving by no more than that; a sample at the target counts twice. Stalled: fully
        /// driven for 0.36 s without a count. Without `breakaway`, or with another law than `pid`, the drive need not
        /// ever be full: then `time` holds for a stall.
        Motion = "motion",
        /// Done: 0.12 s in position. Stalled: driven for 1.02 s without a count, however weakly.
        Time = "time",
    }
}

choice! {
    /// How the set point goes to its target.
    pub enum SetPoint {
        /// With limited speed and acceleration. (Ours.)
        Trapezoid = "trapezoid",
        /// At once, whatever the sub-frame's speed.
        Step = "step",
    }
}

impl TransverseSettings {
    /// The motor's speed at full drive, in counts/s.
    pub(crate) fn full_counts_per_s(&self) -> f64 {
        self.plant.rpm * f64::from(self.encoder.slots_per_rev) / 60.0
    }

    /// So many mm of carriage in counts.
    pub fn counts(&self, mm: f64) -> f64 {
        mm / self.plant.pitch_mm * f64::from(self.encoder.slots_per_rev)
    }

    /// The sampling time, in s.
    pub fn sample_s(&self) -> f64 {
        f64::from(self.controller.sample_ms) / 1_000.0
    }
}

impl TransverseController {
    /// When it samples.
    pub(crate) const fn timing(&self) -> Timing {
        timing::of(self.sample_ms, self.jitter_us, self.jitter_seed)
    }

    fn check_jitter(&self) -> Result<(), OutOfRange> {
        timing::check(self.sample_ms, self.jitter_us)
    }
}
