//! The settings of an axis: what the machine is, and what the firmware's loop makes of it.
//!
//! Lengths of an axis that turns are in degrees instead of mm.

use torno_protocol::settings::OutOfRange;
use torno_protocol::{choice, settings};

use crate::scale::{Lengths, PAPER_COUNT_PM, Scale};
use crate::timer;

settings! {
    /// One closed-loop stepper axis. By default it is the paper's Y axis.
    pub struct AxisSettings where AxisSettings::check_together {
        /// The stepper motor.
        motor: MotorSettings;
        /// What takes the pulses.
        drive: DriveSettings;
        /// What the motor moves.
        mechanics: MechanicsSettings;
        /// What the motion is measured with.
        encoder: EncoderSettings;
        /// The loop in the firmware.
        control: LoopSettings;
    }
}

settings! {
    /// The stepper motor. Its rotor swings, or is in closed form: without inertia, it follows the field with the play
    /// that friction leaves it.
    pub struct MotorSettings {
        /// Full steps a revolution: 1.8°. Four of them are an electrical turn.
        full_steps: u32 = 200, 4..=2_000, "", "paper";
        /// Coulomb friction, as a share of the holding torque.
        friction: f64 = 0.05, 0.0..=10.0, "", "ours";
        /// The speed v_c at which the torque has fallen to 1/√2: q(v) = 1/√(1 + (v/v_c)²); 0: it does not fall.
        corner_mm_per_s: f64 = 50.0, 0.0..=10_000.0, "mm/s", "ours";
        /// The largest jump of the speed that a motor in closed form follows without load; 0: any. By default that of
        /// a rotor which swings at 150 Hz.
        start_mm_per_s: f64 = 28.0, 0.0..=10_000.0, "mm/s", "ours";
        /// The frequency at which the rotor swings about the field without load; 0: it is in closed form.
        rotor_hz: f64 = 150.0, 0.0..=400.0, "Hz", "ours";
        /// ζ: the damping of a rotor that swings.
        damping: f64 = 0.1, 0.0..=2.0, "", "ours";
        /// A rotor that hardly swings is locked to the field; without that, it is integrated for ever, to compare.
        lock: bool = true, false..=true, "", "ours";
    }
}

settings! {
    /// The drive. By default it is a DM542.
    pub struct DriveSettings {
        /// Pulses that turn the motor once.
        pulses_per_rev: u32 = 2_000, 200..=102_400, "", "paper";
        /// Pulses at a higher rate are lost.
        max_hz: f64 = 200_000.0, 1.0..=10_000_000.0, "Hz", "DM542";
        /// Pulses that are high or low for a shorter time are lost.
        min_pulse_us: f64 = 2.5, 0.0..=1_000.0, "µs", "DM542";
    }
}

choice! {
    /// What makes a way of the motor's turn.
    pub enum Transmission {
        /// A ball screw.
        Screw = "screw",
        /// A pinion on a rack.
        Rack = "rack",
    }
}

settings! {
    /// What the motor moves.
    pub struct MechanicsSettings {
        /// What makes a way of the motor's turn.
        transmission: Transmission = Transmission::Screw, Transmission::NAMES, "", "paper";
        /// The lead of the screw: 1605. Of an axis that turns, the degrees of a motor's revolution.
        lead_mm: f64 = 5.0, 0.01..=1_000.0, "mm per revolution", "paper";
        /// The teeth of the pinion on a rack.
        pinion_teeth: u32 = 20, 4..=1_000, "", "ours";
        /// The pitch of a rack: π times its module.
        rack_pitch_mm: f64 = core::f64::consts::PI, 0.1..=100.0, "mm", "ours";
        /// Dead travel between screw and carriage. At the start the carriage lies against the flank that pushes it in
        /// the positive sense.
        backlash_mm: f64 = 0.0, 0.0..=10.0, "mm", "ours";
        /// The way from one end stop to the other. At the start the carriage is in the middle.
        travel_mm: f64 = 300.0, 0.1..=100_000.0, "mm", "ours";
    }
}

choice! {
    /// What the loop measures.
    pub enum Sensor {
        /// The carriage, by a belt that turns an encoder (the paper's).
        Belt = "belt",
        /// The motor's shaft: half-closed, so the loop does not see the backlash.
        Motor = "motor",
        /// The carriage, by a grating along it.
        Scale = "scale",
    }
}

settings! {
    /// What the motion is measured with. The counter takes all four edges of a line.
    pub struct EncoderSettings {
        /// The teeth of the pulley on the encoder of the belt.
        belt_teeth: u32 = 22, 1..=1_000, "", "paper";
        /// The pitch of the belt: HTD-3M.
        belt_pitch_mm: f64 = 3.0, 0.1..=1_000.0, "mm", "paper";
        /// Lines of the belt's encoder: E6B2-CWZ6C.
        belt_lines: u32 = 2_000, 1..=1_000_000, "per revolution", "paper";
        /// Lines of an encoder on the motor's shaft.
        motor_lines: u32 = 1_000, 1..=1_000_000, "per revolution", "ours";
        /// A count of a grating.
        scale_um: f64 = 1.0, 0.001..=1_000.0, "µm", "ours";
        /// Where in a count the encoder is at the start, as a share of it: by default in the middle.
        phase: f64 = 0.5, 0.0..=0.999_999, "", "ours";
        /// From one reference mark of a grating to the next. An encoder has one a revolution.
        scale_mark_mm: f64 = 50.0, 0.001..=10_000.0, "mm", "ours";
        /// The bits of the timer that counts: 16 on TIM3 and TIM4, 32 on TIM2 and TIM5.
        counter_bits: u32 = 32, 16..=32, "", "STM32F217";
        /// Where the timer begins.
        counter_start: u32 = 3_000, 0..=65_535, "", "paper";
    }
}

choice! {
    /// When the loop looks.
    pub enum Mode {
        /// Every so many pulses of the program.
        Dynamic = "dynamic",
        /// Every so many milliseconds, at rest too.
        Fixed = "fixed",
        /// Never.
        Open = "open",
    }
}

choice! {
    /// What the loop does about an error.
    pub enum Law {
        /// The train stops, the rotor settles, pulses are added, and the program goes on with a ramp. (Ours.)
        Pause = "pause",
        /// Pulses are put in between those of the program at its rate, and nothing settles. (The paper's wording.)
        AtOnce = "at-once",
    }
}

choice! {
    /// What the firmware takes a count for.
    pub enum CountScale {
        /// What it is.
        Exact = "exact",
        /// What the paper reckons with a pulley's outer diameter: 0.008148506 mm instead of 0.00825.
        Paper = "paper",
        /// `count_pm`.
        Own = "own",
    }
}

settings! {
    /// The loop in the firmware.
    pub struct LoopSettings {
        /// When the loop looks.
        mode: Mode = Mode::Dynamic, Mode::NAMES, "", "paper";
        /// What the loop measures.
        sensor: Sensor = Sensor::Belt, Sensor::NAMES, "", "paper";
        /// What the loop does about an error.
        law: Law = Law::Pause, Law::NAMES, "", "ours";
        /// The period of a `fixed` loop.
        period_ms: f64 = 1.0, 0.01..=10_000.0, "ms", "ours";
        /// N: a `dynamic` loop looks every so many pulses; 0: the least that are a count.
        pulses: u32 = 0, 0..=1_000_000, "pulses", "paper: 4";
        /// The least error that the loop corrects; 0: N, and with more than 2000 pulses a revolution, unless N is
        /// set, as long as N is with 2000: 10 µm.
        dead_band_pulses: u32 = 0, 0..=1_000_000, "pulses", "ours";
        /// How long the rotor settles before it is looked at.
        settle_ms: f64 = 10.0, 0.0..=10_000.0, "ms", "ours";
        /// The rate of the pulses that are added.
        correct_hz: f64 = 1_000.0, timer::SLOWEST_HZ..=timer::FASTEST_HZ, "Hz", "ours";
        /// So many tries after a correction may bring less than half a count.
        tries: u32 = 10, 0..=1_000, "", "ours";
        /// A larger error stops all axes.
        stop_mm: f64 = 1.0, 0.000_001..=1_000.0, "mm", "ours";
        /// What the firmware takes a count for.
        scale: CountScale = CountScale::Exact, CountScale::NAMES, "", "ours";
        /// The scale `own`: picometres a count.
        count_pm: u64 = 8_250_000, 1..=1_000_000_000, "pm", "ours";
        /// Backlash that the firmware makes up for whenever the sense changes, before it moves on.
        backlash_mm: f64 = 0.0, 0.0..=10.0, "mm", "ours";
        /// Accepts N and a dead band below a count.
        force: bool = false, false..=true, "", "ours";
    }
}

impl MechanicsSettings {
    /// The way of a motor's revolution in mm.
    pub fn mm_per_rev(&self) -> f64 {
        match self.transmission {
            Transmission::Screw => self.lead_mm,
            Transmission::Rack => f64::from(self.pinion_teeth) * self.rack_pitch_mm,
        }
    }
}

impl EncoderSettings {
    /// The counts from one index mark to the next.
    pub(crate) fn counts_per_index(&self, sensor: Sensor) -> i64 {
        match sensor {
            Sensor::Belt => 4 * i64::from(self.belt_lines),
            Sensor::Motor => 4 * i64::from(self.motor_lines),
            Sensor::Scale => libm::round(self.scale_mark_mm * 1_000.0 / self.scale_um) as i64,
        }
    }
}

impl AxisSettings {
    /// An axis that turns, in degrees: 6:1, 0.03° a pulse, 0.045° a count. (Ours.)
    pub fn rotary() -> Self {
        let mut axis = Self::default();
        axis.mechanics.lead_mm = 60.0;
        axis.mechanics.travel_mm = 36_000.0;
        axis.encoder.belt_teeth = 1;
        axis.encoder.belt_pitch_mm = 360.0;
        axis
    }

    /// From one index mark of the encoder to the next, in mm; 0 if there is no loop that could look at it.
    pub fn index_mm(&self) -> f64 {
        match self.control.mode {
            Mode::Open => 0.0,
            _ => self.encoder.counts_per_index(self.control.sensor) as f64 * self.scale().count_pm() as f64 / 1e9,
        }
    }

    /// The lengths that follow from the settings.
    pub fn scale(&self) -> Scale {
        let pm = |mm: f64| (libm::round(mm * 1e9) as i64).max(1);
        let (encoder, control) = (&self.encoder, &self.control);
        let rev_pm = pm(self.mechanics.mm_per_rev());
        let belt_pm = pm(f64::from(encoder.belt_teeth) * encoder.belt_pitch_mm);
        // All four edges of a line.
        let (counts_pm, counts) = match control.sensor {
            Sensor::Belt => (belt_pm, 4 * encoder.belt_lines),
            Sensor::Motor => (rev_pm, 4 * encoder.motor_lines),
            Sensor::Scale => (pm(encoder.scale_um / 1_000.0), 1),
        };
        Scale::new(Lengths {
            rev_pm,
            pulses_per_rev: self.drive.pulses_per_rev,
            full_steps: self.motor.full_steps,
            counts_pm,
            counts,
            firmware_count_pm: match control.scale {
                CountScale::Exact => None,
                CountScale::Paper => Some(PAPER_COUNT_PM),
                CountScale::Own => i64::try_from(control.count_pm).ok(),
            },
        })
    }

    /// Checks a speed that the axis is to have: a timer must be able to make its pulses, and the drive to take them.
    ///
    /// # Errors
    /// What was expected, and what was found.
    pub fn check_speed(&self, mm_per_s: f64) -> Result<(), String> {
        let mm = self.scale().pulse_mm();
        let hz = mm_per_s / mm;
        let fastest = timer::FASTEST_HZ.min(self.drive.max_hz);
        if (timer::SLOWEST_HZ..=fastest).contains(&hz) {
            return Ok(());
        }
        let (least, most) = (timer::SLOWEST_HZ * mm, fastest * mm);
        Err(format!(
            "expected {least:.7} to {most} mm/s, found {mm_per_s}: a pulse is {mm} mm, and a timer makes one pulse in \
             35.79 s to {fastest} in a second"
        ))
    }

    fn check_together(&self) -> Result<(), OutOfRange> {
        let wrong = |field: &str, message: String| Err(OutOfRange { field: field.to_owned(), message });
        let (scale, control) = (self.scale(), &self.control);
        if ![16, 32].contains(&self.encoder.counter_bits) {
            return wrong("encoder.counter_bits", format!("expected 16 or 32, found {}", self.encoder.counter_bits));
        }
        if control.correct_hz > self.drive.max_hz {
            let (max, found) = (self.drive.max_hz, control.correct_hz);
            return wrong("control.correct_hz", format!("expected at most {max}, what the drive takes, found {found}"));
        }
        let least = scale.least_pulses();
        let below = |field: &str, found: u32, what: &str| {
            let mm = f64::from(found) * scale.pulse_mm();
            wrong(
                field,
                format!(
                    "expected {least} or more, found {found}: {mm} mm are less than a count of {} mm, so {what}; \
                     `force = true` accepts it",
                    scale.firmware_count_pm as f64 / 1e9
                ),
            )
        };
        if (1..least).contains(&control.pulses) && !control.force {
            return below("control.pulses", control.pulses, "the loop looks more often than the encoder can tell");
        }
        let dead_band = if control.dead_band_pulses == 0 { control.pulses } else { control.dead_band_pulses };
        if (1..least).contains(&dead_band) && !control.force {
            let what = "the loop takes the encoder's steps for lost pulses and hunts";
            return below("control.dead_band_pulses", dead_band, what);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checked(change: impl FnOnce(&mut AxisSettings)) -> String {
        let mut settings = AxisSettings::default();
        change(&mut settings);
        settings.check().map_or_else(|wrong| wrong.to_string(), |()| "fine".to_owned())
    }

    #[test]
    fn the_defaults_are_in_range_and_so_is_an_axis_that_turns() {
        assert_eq!(AxisSettings::default().check(), Ok(()));
        assert_eq!(AxisSettings::rotary().check(), Ok(()));
        assert_eq!(PAPER_COUNT_PM, 8_148_506);
    }

    #[test]
    fn the_least_pulses_of_a_count_are_refused_without_force() {
        let three = |force| {
            checked(|axis| {
                axis.control.pulses = 3;
                axis.control.force = force;
            })
        };
        let expected = "control.pulses: expected 4 or more, found 3: 0.0075 mm are less than a count of 0.00825 mm, so \
                        the loop looks more often than the encoder can tell; `force = true` accepts it";
        assert_eq!([three(false), three(true)], [expected, "fine"]);
        let dead_band = checked(|axis| axis.control.dead_band_pulses = 2);
        assert!(
            dead_band.starts_with("control.dead_band_pulses: expected 4 or more, found 2: 0.005 mm"),
            "{dead_band}"
        );
        assert!(dead_band.contains("hunts"), "{dead_band}");
    }

    #[test]
    fn a_scale_of_nothing_and_a_rate_that_no_timer_makes_are_refused() {
        let expected = "control.count_pm: expected 1 to 1000000000, found 0";
        assert_eq!(checked(|axis| axis.control.count_pm = 0), expected);
        for hz in [0.0, 0.027, 200_001.0, f64::NAN] {
            let wrong = checked(|axis| axis.control.correct_hz = hz);
            assert!(wrong.starts_with("control.correct_hz: expected 0.0279"), "{wrong}");
        }
        assert_eq!(checked(|axis| axis.control.correct_hz = 0.028), "fine");
        let slower = checked(|axis| {
            axis.drive.max_hz = 500.0;
        });
        assert_eq!(slower, "control.correct_hz: expected at most 500, what the drive takes, found 1000");
        assert_eq!(checked(|axis| axis.encoder.counter_bits = 24), "encoder.counter_bits: expected 16 or 32, found 24");
    }

    #[test]
    fn a_speed_needs_a_timer_that_makes_its_pulses() {
        let axis = AxisSettings::default();
        assert_eq!([axis.check_speed(0.000_07), axis.check_speed(500.0)], [Ok(()), Ok(())]);
        let expected = "expected 0.0000698 to 500 mm/s, found 500.1: a pulse is 0.0025 mm, and a timer makes one pulse \
                        in 35.79 s to 200000 in a second";
        assert_eq!(axis.check_speed(500.1), Err(expected.to_owned()));
        assert!(axis.check_speed(0.000_069).is_err());
        assert!(axis.check_speed(f64::NAN).is_err());
    }
}
