//! The timers of an STM32F217: which rates one makes as PWM output, and what one counts as encoder interface (TIM
//! encoder mode 3: every edge of both channels).

/// What clocks the timers, in Hz.
const CLOCK_HZ: f64 = 120e6;

/// A prescaler and a reload of 16 bits each: one pulse in 35.79 s.
pub const SLOWEST_HZ: f64 = CLOCK_HZ / (65_536.0 * 65_536.0);

/// Pulses that a DM542 takes, which is less than what a timer makes.
pub const FASTEST_HZ: f64 = 200_000.0;

/// A timer that counts, and the total that the firmware makes of it.
///
/// The firmware looks every few pulses and adds up signed differences, so that an underflow or overflow of the register
/// does no harm as long as less than half its range passes between two looks. Only a jump can be too long.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Counter {
    bits: u32,
    start: u32,
    /// What the firmware has counted beyond the encoder.
    skew: i64,
}

impl Counter {
    pub(crate) const fn new(bits: u32, start: u32) -> Self {
        Self { bits, start, skew: 0 }
    }

    /// The register CNT when the encoder has counted so much.
    pub(crate) const fn register(&self, encoder: i64) -> u32 {
        let value = encoder.wrapping_add(self.start as i64);
        (value & ((1_i64 << self.bits) - 1)) as u32
    }

    /// The firmware's total when the encoder has counted so much.
    pub(crate) const fn total(&self, encoder: i64) -> i64 {
        encoder.wrapping_add(self.skew)
    }

    /// The encoder has counted from `before` to `after` between two looks.
    pub(crate) const fn jump(&mut self, before: i64, after: i64) {
        let unused = 64 - self.bits;
        let way = after.wrapping_sub(before);
        self.skew = self.skew.wrapping_add((way << unused >> unused).wrapping_sub(way));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_timer_makes_a_pulse_in_35_79_s_at_the_slowest() {
        assert_eq!((100.0 / SLOWEST_HZ).round(), 3_579.0);
    }

    /// From the reference 3000 counts (24.75 mm) are left until the register underflows.
    #[test]
    fn an_underflow_does_no_harm() {
        for (bits, below) in [(16, 65_535), (32, u32::MAX)] {
            let mut counter = Counter::new(bits, 3_000);
            let registers = [0, -2_999, -3_000, -3_001].map(|encoder| counter.register(encoder));
            assert_eq!(registers, [3_000, 1, 0, below]);
            assert_eq!(counter.total(-80_000), -80_000);
            counter.jump(-20_000, -52_768);
            assert_eq!(counter.total(-52_768), -52_768);
        }
    }

    #[test]
    fn half_a_range_between_two_looks_is_taken_for_the_other_half() {
        for (bits, expected) in [(16, -65_536), (32, 0)] {
            let mut counter = Counter::new(bits, 3_000);
            counter.jump(10, 10 + 32_768);
            assert_eq!(counter.total(0), expected);
        }
    }
}
