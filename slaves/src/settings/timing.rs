//! When the firmware samples, for all boards that have jitter.

use core::ops::RangeInclusive;

use torno_protocol::settings::OutOfRange;

use crate::schedule::{Jitter, Timing};

pub(super) const JITTER_US: RangeInclusive<u32> = 0..=1_000_000;
pub(super) const SEED: RangeInclusive<u32> = 0..=1_000_000;

pub(super) const fn of(period_ms: u32, longest_us: u32, seed: u32) -> Timing {
    Timing { period_ms, jitter: Jitter { longest_us, seed } }
}

/// A sample comes before the next one.
pub(super) fn check(period_ms: u32, jitter_us: u32) -> Result<(), OutOfRange> {
    let period_us = period_ms.saturating_mul(1_000);
    if jitter_us <= period_us {
        return Ok(());
    }
    let message = format!("expected 0 to {period_us}, the time between two samples, found {jitter_us}");
    Err(OutOfRange { field: "jitter_us".to_owned(), message })
}
