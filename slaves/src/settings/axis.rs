//! The ranges that the plants of all axes have in common.

use core::ops::RangeInclusive;

pub(super) const TAU_S: RangeInclusive<f64> = 0.001..=100.0;
pub(super) const RPM: RangeInclusive<f64> = 0.1..=10_000.0;
pub(super) const PITCH_MM: RangeInclusive<f64> = 0.1..=100.0;
pub(super) const TRAVEL_MM: RangeInclusive<f64> = 0.1..=10_000.0;
pub(super) const BACKLASH_MM: RangeInclusive<f64> = 0.0..=10.0;
/// A share of the torque at standstill with full drive, as the next one.
pub(super) const FRICTION: RangeInclusive<f64> = 0.0..=2.0;
pub(super) const LOAD_TORQUE: RangeInclusive<f64> = -2.0..=2.0;
/// Between drive and motor.
pub(super) const DEAD_MS: RangeInclusive<f64> = 0.0..=1_000.0;
/// A share of the supply that the motor's speed holds for.
pub(super) const SUPPLY: RangeInclusive<f64> = 0.01..=2.0;
