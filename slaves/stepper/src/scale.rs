//! Lengths: what a pulse, a count and an electrical turn are, for the firmware and in truth.
//!
//! The firmware reckons in whole picometres (thousand-millionths of a degree on an axis that turns). The machine is
//! reckoned in whole units that are a fraction of both the true pulse and the true count, so that where a count changes
//! is exact however far the axis goes.

use torno_protocol::clock::gcd;

/// A count as the paper reckons it: π(20.25 + 0.5)/8000 mm. A toothed pulley takes 22 teeth of 3 mm instead.
pub const PAPER_COUNT_PM: i64 = 8_148_506;

/// Picometres in a mm.
const PM_PER_MM: f64 = 1e9;

/// A pulse has at least so many units, so that what is no multiple of it is rounded finely.
const LEAST: u128 = 1 << 24;
/// A pulse has at most so many units, so that 10⁹ of them fit.
const MOST: u128 = 1 << 32;

/// The pulses a revolution with which the default dead band is N. With more of them it is as long. (Ours.)
const DEAD_BAND_PER_REV: i64 = 2_000;

/// Full steps of an electrical turn.
const FULL_STEPS_OF_A_TURN: i128 = 4;

/// What the lengths follow from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lengths {
    /// The way of a motor's revolution.
    pub(crate) rev_pm: i64,
    pub(crate) pulses_per_rev: u32,
    pub(crate) full_steps: u32,
    /// So many counts are a way.
    pub(crate) counts: u32,
    pub(crate) counts_pm: i64,
    /// What the firmware takes a count for, if not for what it is.
    pub(crate) firmware_count_pm: Option<i64>,
}

/// What follows from an axis's settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scale {
    /// A pulse as the firmware reckons it.
    pub pulse_pm: i64,
    /// A count as the firmware reckons it.
    pub firmware_count_pm: i64,
    /// A pulse in units.
    pub(crate) pulse: i64,
    /// A count in units.
    pub(crate) count: i64,
    /// An electrical turn in units.
    pub(crate) turn: i64,
    /// A motor's revolution in pm, and the pulses in it.
    rev_pm: i64,
    pulses_per_rev: i64,
}

impl Scale {
    /// Zeros are taken as one.
    pub(crate) fn new(lengths: Lengths) -> Self {
        let Lengths { rev_pm, counts_pm, firmware_count_pm, .. } = lengths;
        let some = |n: u32| i64::from(n.max(1));
        let (pulses_per_rev, full_steps, counts) =
            (some(lengths.pulses_per_rev), some(lengths.full_steps), some(lengths.counts));
        let (rev_pm, counts_pm) = (rev_pm.max(1), counts_pm.max(1));
        let wide = |n: i64| u128::from(n.unsigned_abs());
        let (pulse, count) = commensurable(wide(rev_pm) * wide(counts), wide(counts_pm) * wide(pulses_per_rev));
        let turn = rounded(i128::from(pulse) * i128::from(pulses_per_rev) * FULL_STEPS_OF_A_TURN, full_steps.into());
        Self {
            pulse_pm: rounded(rev_pm.into(), pulses_per_rev.into()).max(1),
            firmware_count_pm: firmware_count_pm.unwrap_or(rounded(counts_pm.into(), counts.into())).max(1),
            pulse,
            count,
            turn: turn.max(4),
            rev_pm,
            pulses_per_rev,
        }
    }

    /// A pulse in mm.
    pub fn pulse_mm(&self) -> f64 {
        self.rev_pm as f64 / self.pulses_per_rev as f64 / PM_PER_MM
    }

    /// A count in pm, as it is.
    pub fn count_pm(&self) -> i64 {
        self.pm(self.count)
    }

    /// N = ⌈count/pulse⌉: the least pulses that are a count.
    pub fn least_pulses(&self) -> u32 {
        u32::try_from((self.firmware_count_pm + self.pulse_pm - 1) / self.pulse_pm).unwrap_or(u32::MAX)
    }

    /// The default dead band: N, but with finer microsteps not less than with the paper's, 10 µm with its belt. A rotor
    /// swings as far whatever its microsteps are. (Ours.)
    pub fn dead_band_pulses(&self) -> u32 {
        let least = self.least_pulses();
        if self.pulses_per_rev <= DEAD_BAND_PER_REV {
            return least;
        }
        let ceil = |a: i128, b: i128| (a + b - 1) / b;
        let per_rev = i128::from(DEAD_BAND_PER_REV);
        let coarse = ceil(i128::from(self.firmware_count_pm) * per_rev, self.rev_pm.into());
        let pulses = ceil(coarse * i128::from(self.pulses_per_rev), per_rev);
        u32::try_from(pulses).unwrap_or(u32::MAX).max(least)
    }

    /// Units as picometres.
    pub(crate) fn pm(&self, units: i64) -> i64 {
        let product = i128::from(units) * i128::from(self.rev_pm);
        let divisor = i128::from(self.pulse) * i128::from(self.pulses_per_rev);
        rounded(product, divisor)
    }

    /// Picometres as units.
    pub(crate) fn units(&self, pm: i64) -> i64 {
        let product = i128::from(pm) * i128::from(self.pulse) * i128::from(self.pulses_per_rev);
        rounded(product, i128::from(self.rev_pm))
    }

    /// A length in mm as units.
    pub(crate) fn units_of_mm(&self, mm: f64) -> i64 {
        self.units(libm::round(mm * PM_PER_MM) as i64)
    }
}

/// To the nearest, and to the larger one from between; what does not fit is the end of the range.
fn rounded(product: i128, divisor: i128) -> i64 {
    let quotient = (product + divisor / 2).div_euclid(divisor);
    i64::try_from(quotient).unwrap_or(if quotient < 0 { i64::MIN } else { i64::MAX })
}

/// Two lengths as multiples of a common unit.
fn commensurable(first: u128, second: u128) -> (i64, i64) {
    let common = gcd(first, second);
    let (mut first, mut second) = (first / common, second / common);
    if first > MOST {
        // No exact unit is coarse enough. The error is below 10⁻⁹ of a count.
        second = (second * MOST + first / 2) / first;
        first = MOST;
    }
    let times = LEAST.div_ceil(first);
    let small = |wide: u128| i64::try_from(wide).unwrap_or(i64::MAX).max(1);
    (small(first * times), small(second * times))
}

#[cfg(test)]
mod tests {
    use crate::settings::{AxisSettings, CountScale, Sensor};

    #[test]
    fn the_papers_axis_moves_by_2500_nm_a_pulse_and_8250_nm_a_count() {
        let scale = AxisSettings::default().scale();
        assert_eq!((scale.pulse_pm, scale.firmware_count_pm, scale.least_pulses()), (2_500_000, 8_250_000, 4));
        // 10 and 33, as often as it takes; 40 pulses an electrical turn.
        assert_eq!((scale.count * 10, scale.turn), (scale.pulse * 33, scale.pulse * 40));
        assert_eq!([scale.pm(scale.pulse), scale.units(8_250_000)], [2_500_000, scale.count]);
        assert_eq!(scale.pulse_mm(), 0.0025);
    }

    #[test]
    fn the_period_follows_encoder_screw_and_drive() {
        let least = |change: &dyn Fn(&mut AxisSettings)| {
            let mut settings = AxisSettings::default();
            change(&mut settings);
            settings.scale().least_pulses()
        };
        assert_eq!(least(&|axis| axis.encoder.belt_lines = 1_000), 7);
        assert_eq!(least(&|axis| axis.encoder.belt_lines = 500), 14);
        assert_eq!(least(&|axis| axis.mechanics.lead_mm = 4.0), 5);
        assert_eq!(least(&|axis| axis.drive.pulses_per_rev = 4_000), 7);
        assert_eq!(least(&|axis| axis.control.scale = CountScale::Paper), 4);
        assert_eq!(least(&|axis| axis.control.sensor = Sensor::Motor), 1);
        let rotary = AxisSettings::rotary().scale();
        assert_eq!((rotary.pulse_pm, rotary.firmware_count_pm, rotary.least_pulses()), (30_000_000, 45_000_000, 2));
    }

    #[test]
    fn the_dead_band_is_as_long_with_finer_microsteps() {
        let band = |mut settings: AxisSettings, per_rev, sensor| {
            (settings.drive.pulses_per_rev, settings.control.sensor) = (per_rev, sensor);
            settings.scale().dead_band_pulses()
        };
        let [belt, scale] = [Sensor::Belt, Sensor::Scale];
        let of_belt = |per_rev| band(AxisSettings::default(), per_rev, belt);
        assert_eq!([200, 1_000, 2_000, 3_000, 4_000, 20_000, 102_400].map(of_belt), [1, 2, 4, 6, 8, 40, 205]);
        assert_eq!([2_000, 20_000].map(|per_rev| band(AxisSettings::default(), per_rev, scale)), [1, 10]);
        assert_eq!([2_000, 20_000].map(|per_rev| band(AxisSettings::rotary(), per_rev, belt)), [2, 20]);
    }

    #[test]
    fn lengths_without_a_common_unit_are_close() {
        let mut settings = AxisSettings::default();
        settings.mechanics.lead_mm = 5.000_000_007;
        settings.drive.pulses_per_rev = 12_801;
        settings.encoder.belt_pitch_mm = 3.000_000_001;
        let scale = settings.scale();
        let expected = (5.000_000_007 / 12_801.0) / (66.000_000_022 / 8_000.0);
        let found = scale.pulse as f64 / scale.count as f64;
        assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        assert_eq!(scale.units(scale.pm(123_456 * scale.pulse)) / scale.pulse, 123_456);
    }
}
