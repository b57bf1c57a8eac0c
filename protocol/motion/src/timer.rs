//! The firmware's step timer, which makes each motion a little slower than planned.
//!
//! It counts the 16 MHz of an ATmega328P from 0 to a limit, the limit included, so that each tick is a cycle longer
//! than was reckoned. Slow steps are divided into 2, 4 or 8 ticks, so that there are more than 8000 ticks a second.
//! At 25 mm/s and 250 steps/mm a step takes 2562 cycles in place of 2560: in the recordings of the firmware a cruise is
//! 0.08 % slower than asked, which is 1 mm in a minute.

/// Cycles in a second.
const CLOCK: f64 = 16e6;
/// A tick has fewer cycles than this, unless there are eight in a step.
const LONGEST_TICK: f64 = 2000.0;

/// By which factor the timer makes a step longer that is to take `step` s.
pub(crate) fn stretch(step: f64) -> f64 {
    let exact = step * CLOCK;
    let cycles = libm::ceil(exact);
    let ticks = [1.0, 2.0, 4.0].into_iter().find(|ticks| cycles < LONGEST_TICK * ticks).unwrap_or(8.0);
    (libm::floor(cycles / ticks) + 1.0) * ticks / exact
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tick_is_a_cycle_longer_than_reckoned() {
        assert_eq!(stretch(1600.0 / CLOCK), 1601.0 / 1600.0);
        assert_eq!(stretch(2560.0 / CLOCK), 2562.0 / 2560.0);
        assert_eq!(stretch(4001.0 / CLOCK), 4004.0 / 4001.0);
        assert_eq!(stretch(16e5 / CLOCK), 1_600_008.0 / 16e5);
    }
}
