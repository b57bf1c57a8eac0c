//! The converter with which the paper's main motor was characterised (§4): the pulses of a window go to an R-2R ladder
//! of 8 bits, whose voltage an oscilloscope shows (Fig. 8).
//!
//! The paper has 5 V at 5500 rpm. These are 137.5 pulses in 30 ms, and as they are they make 2.69 V of a ladder whose
//! 256 steps are 5 V: the 5 V take 1.85 steps a pulse.

use serde::Serialize;
use torno_machines::motor::Motor;

/// The ladder's reference, in V, and its steps. (The 8 bits are the paper's; the 5 V are a PIC's supply.)
const REFERENCE_V: f64 = 5.0;
const STEPS: f64 = 256.0;
/// 255 steps are 137.5 pulses: 5500 rpm (§4), with 50 pulses a revolution for 30 ms.
const FULL_SCALE: (i64, i64) = (510, 275);
/// The speed of which the paper tells the voltage, in rad/s.
const SPEED_OF_5_V: f64 = 5_500.0 * core::f64::consts::TAU / 60.0;

/// What tells the speed of a motor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Instrument {
    /// What the board's firmware counts.
    #[default]
    Counter,
    /// The paper's converter of frequency to voltage, with the 5 V at 5500 rpm that it has.
    Dac,
    /// The same with the count as it is, as the paper describes it: 2.7 V at 5500 rpm.
    DacUnscaled,
}

/// A converter at a motor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Dac {
    /// One step of the ladder, in V.
    pub volts_per_step: f64,
    /// Steps of the ladder for each pulse in a window.
    pub steps_per_count: f64,
    /// The voltage of 1 rad/s.
    pub volts_per_rad_per_s: f64,
    /// The voltage of 5500 rpm, as far as the ladder goes.
    pub volts_at_5500_rpm: f64,
    #[serde(skip)]
    scale: (i64, i64),
}

impl Dac {
    /// The converter, if the instrument is one.
    pub fn new(instrument: Instrument, motor: &Motor) -> Option<Self> {
        let scale = match instrument {
            Instrument::Counter => return None,
            Instrument::Dac => FULL_SCALE,
            Instrument::DacUnscaled => (1, 1),
        };
        let volts_per_step = REFERENCE_V / STEPS;
        let steps_per_count = scale.0 as f64 / scale.1 as f64;
        let window_s = f64::from(motor.period_ms) / 1_000.0;
        let volts_per_rad_per_s = volts_per_step * steps_per_count * window_s / motor.count;
        let volts_at_5500_rpm = (volts_per_rad_per_s * SPEED_OF_5_V).min(volts_per_step * (STEPS - 1.0));
        Some(Self { volts_per_step, steps_per_count, volts_per_rad_per_s, volts_at_5500_rpm, scale })
    }

    /// What the ladder's steps make of a count: to the nearest, and no more than it has.
    pub fn counts(&self, counted: i64) -> f64 {
        let (above, below) = self.scale;
        let step = ((2 * counted * above + below).div_euclid(2 * below)).clamp(0, STEPS as i64 - 1);
        step as f64 / self.steps_per_count
    }

    /// How far two speeds are apart that it tells apart, in counts: one, if a step is less.
    pub fn resolution(&self) -> f64 {
        (1.0 / self.steps_per_count).max(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use torno_machines::kinds;

    fn spindle(instrument: Instrument) -> Option<Dac> {
        Dac::new(instrument, &kinds::motor("spindle", "", 0).unwrap().unwrap())
    }

    /// §4: 5500 rpm are 5 V. A ladder's highest step is one below its reference.
    #[test]
    fn the_papers_5_volts_take_1_85_steps_a_pulse() {
        let volts = |instrument| spindle(instrument).unwrap().volts_at_5500_rpm;
        assert!((volts(Instrument::Dac) - 255.0 * 5.0 / 256.0).abs() < 1e-9);
        assert!((volts(Instrument::DacUnscaled) - 137.5 * 5.0 / 256.0).abs() < 1e-9);
        assert_eq!(spindle(Instrument::Counter), None);
    }

    #[test]
    fn a_count_becomes_the_nearest_step_and_never_more_than_255() {
        let dac = spindle(Instrument::Dac).unwrap();
        let steps = [0, 1, 2, 100, 137, 138, 1_000].map(|count| (dac.counts(count) * dac.steps_per_count).round());
        assert_eq!(steps, [0.0, 2.0, 4.0, 185.0, 254.0, 255.0, 255.0]);
        let plain = spindle(Instrument::DacUnscaled).unwrap();
        assert_eq!([0, 137, 300].map(|count| plain.counts(count)), [0.0, 137.0, 255.0]);
    }
}
