//! The figures of the main motor (§4, Eq. 1 to 7), found again at the real board: sub-frames in, telemetry out.
//!
//! Where a figure needs a finer look than 50 pulses and 10 bits give, the board has a finer disc and a finer drive,
//! which its rig file could say as well; the motor and the law are the same.

#![allow(clippy::unwrap_used, reason = "part of tests")]
#![allow(clippy::disallowed_methods, reason = "what is compared with a tolerance may differ in its last digits")]

mod common;

use core::f64::consts::{E, PI, TAU};

use common::response::{changed, crossing, differences, near, peak, poles, recurrence, sampled, settled, spectrum};
use common::{Bench, s, spindle};
use torno_protocol::board::MotorStimulus;
use torno_protocol::clock::Clock;
use torno_protocol::time::Instant;
use torno_slaves::{LeadForm, Spindle, SpindleSettings};

/// Pulses a revolution of the finer disc.
const FINE: u32 = 1_000_000;
/// The full drive of 24 bits, in LSB.
const FULL: f64 = 16_777_215.0;

/// A finer disc and drive.
fn fine() -> SpindleSettings {
    let mut settings = SpindleSettings::default();
    settings.encoder.pulses_per_rev = FINE;
    settings.drive.bits = 24;
    settings
}

/// No loop: the drive is what the set point takes by the gain that the firmware reckons with.
fn open(mut settings: SpindleSettings) -> SpindleSettings {
    settings.controller.form = LeadForm::FeedForward;
    settings.controller.k = 0.0;
    settings
}

/// Full drive, whatever the set point.
fn full_drive(settings: SpindleSettings) -> SpindleSettings {
    let mut settings = open(settings);
    settings.controller.km_rad_per_s_volt = 0.1;
    settings
}

/// A step to `rpm`, from where the board was.
struct Step {
    bench: Bench<Spindle>,
    window_ms: u64,
    rpm_per_count: f64,
    /// The drive's first instant.
    from: Instant,
}

impl Step {
    fn new(settings: &SpindleSettings, rpm: u32, seconds: u64) -> Self {
        settings.check().unwrap();
        let bench = Bench::new(Spindle::new(settings, Clock::TRUE));
        let window_ms = u64::from(settings.controller.window_ms);
        let rpm_per_count = 60_000.0 / (f64::from(settings.encoder.pulses_per_rev) * window_ms as f64);
        let step = Self { bench, window_ms, rpm_per_count, from: Instant::START };
        step.then(rpm, seconds)
    }

    fn then(mut self, rpm: u32, seconds: u64) -> Self {
        let before = self.bench.now;
        self.bench.send(&[u8::try_from(rpm / 20).unwrap()]);
        self.bench.run_ms(s(seconds));
        self.from = changed(&self.bench, "drive", before);
        self
    }

    /// The mean speed of each window since the step, in rpm; the first begins with it.
    fn rpm(&self) -> Vec<f64> {
        let windows = self.bench.now.since(self.from).as_nanos() / (self.window_ms * 1_000_000);
        let counts = sampled(&self.bench, "speed_counts", self.from, self.window_ms, windows);
        counts[1..].iter().map(|count| count * self.rpm_per_count).collect()
    }

    /// A place among the windows in s after the step: a count belongs to the middle of its window.
    fn seconds(&self, window: f64) -> f64 {
        (window + 0.5) * self.window_ms as f64 / 1_000.0
    }

    /// When the speed comes to `rpm`.
    fn reaches(&self, rpm: f64) -> f64 {
        self.seconds(crossing(&self.rpm(), rpm))
    }

    /// The mean speed of the last `windows` windows, in rpm.
    fn steady(&self, windows: usize) -> f64 {
        let rpm = self.rpm();
        rpm[rpm.len() - windows..].iter().sum::<f64>() / windows as f64
    }

    /// The drive, in V of a supply of 30 V.
    fn volts(&self) -> f64 {
        self.bench.value("drive") as f64 / FULL * 30.0
    }
}

/// Gain in rad/s per V and pole of the model in z that the board's response has at a window of so many ms (Eq. 6).
fn sampled_model(window_ms: u32) -> (f64, f64) {
    let mut settings = open(fine());
    settings.controller.window_ms = window_ms;
    let step = Step::new(&settings, 4_000, 60);
    let rpm = step.rpm();
    // What is left to the end falls by the pole each window: a hundred of them say it to many digits.
    let end = step.steady(50);
    let pole = ((end - rpm[101]) / (end - rpm[1])).powf(0.01);
    let gain = end * TAU / 60.0 / step.volts();
    (gain, pole)
}

#[test]
fn equation_5_is_the_motor() {
    let (km, pole) = sampled_model(30);
    let tau = -0.030 / pole.ln();
    near("km", km, 19.0, 1e-4);
    near("tau", tau, 2.8, 1e-4);
    near("Eq. 5, numerator", km / tau, 6.785_714_285_714, 5e-5);
    near("Eq. 5, pole", 1.0 / tau, 0.357_142_857_143, 5e-5);
}

#[test]
fn equation_6_is_the_motor_every_32_ms_and_not_every_30() {
    let model = |window_ms| {
        let (km, pole) = sampled_model(window_ms);
        (km * (1.0 - pole), pole)
    };
    let [t30, t32, t33] = [30, 32, 33].map(model);
    near("Eq. 6 at 32 ms, numerator", t32.0, 0.215_906_753, 5e-6);
    near("Eq. 6 at 32 ms, pole", t32.1, 0.988_636_487, 1e-6);
    near("Eq. 6 as printed, numerator", t32.0, 0.215_91, 5e-6);
    near("Eq. 6 as printed, pole", t32.1, 0.988_6, 5e-5);
    near("Eq. 6 at 30 ms, numerator", t30.0, 0.202_484_754, 2e-6);
    near("Eq. 6 at 30 ms, pole", t30.1, 0.989_342_908, 1e-6);
    let sampling = 0.032 + 0.001 * (0.215_91 - t32.0) / (t33.0 - t32.0);
    near("the sampling time of Eq. 6 as printed", sampling, 0.032_000_5, 2e-6);
}

#[test]
fn thirty_volts_give_5443_rpm_and_5500_rpm_a_gain_of_19_2() {
    let step = Step::new(&full_drive(fine()), 4_000, 60);
    assert_eq!(step.volts(), 30.0);
    near("rpm at 30 V", step.steady(50), 5_443.099_1, 0.01);
    let mut settings = full_drive(SpindleSettings::default());
    settings.plant.km_rad_per_s_volt = 19.198_622;
    settings.drive.bits = 8;
    let step = Step::new(&settings, 4_000, 90);
    near("rpm with km of 5500 rpm", step.steady(1_000), 5_500.0, 0.1);
    near("counts a window at 5500 rpm", step.steady(1_000) / 40.0, 137.5, 0.01);
    near("rpm per LSB of 8 bits", step.steady(1_000) / step.bench.value("drive") as f64, 21.568_627, 1e-3);
}

#[test]
fn a_speed_takes_its_voltage() {
    for (rpm, volts) in [(200, 1.102_313), (1_500, 8.267_349), (4_000, 22.046_264)] {
        let step = Step::new(&open(fine()), rpm, 60);
        near("volts", step.volts(), volts, 1e-5);
        near("rpm", step.steady(50), f64::from(rpm), 0.01);
    }
}

#[test]
fn a_count_is_40_rpm_and_with_32_ms_37_5() {
    for (window_ms, rpm_per_count) in [(30, 40.0), (32, 37.5)] {
        let mut settings = open(SpindleSettings::default());
        settings.drive.bits = 24;
        settings.controller.window_ms = window_ms;
        for rpm in [200, 4_000] {
            let step = Step::new(&settings, rpm, 120);
            let counts = step.steady(2_000) / step.rpm_per_count;
            near("rpm per count", f64::from(rpm) / counts, rpm_per_count, 0.01 * rpm_per_count * 40.0 / f64::from(rpm));
            if window_ms == 30 {
                near("counts", counts, f64::from(rpm) / 40.0, 0.002);
            }
        }
    }
}

#[test]
fn full_voltage_reaches_4000_rpm_no_sooner_than_the_motor_can() {
    let mut settings = full_drive(fine());
    settings.controller.window_ms = 5;
    let step = Step::new(&settings, 4_000, 5);
    for (rpm, seconds) in [(400.0, 0.213_718), (3_600.0, 3.032_120), (3_920.0, 3.566_084)] {
        near("reached at", step.reaches(rpm), seconds, 2e-5);
    }
}

#[test]
fn the_spindle_coasts_and_does_not_brake() {
    let step = Step::new(&open(fine()), 4_000, 70).then(0, 20);
    assert_eq!(step.bench.value("drive"), 0);
    near("4000 to 200 rpm", step.reaches(200.0), 8.388_050, 1e-4);
}

#[test]
fn the_open_loop_rises_in_6_15_s_and_settles_in_11_s() {
    let step = Step::new(&open(fine()), 1_500, 30);
    near("rise", step.reaches(1_350.0) - step.reaches(150.0), 6.152_2, 1e-3);
    near("settling", step.seconds(settled(&step.rpm(), 1_500.0, 30.0)), 10.953_7, 1e-3);
}

/// Eq. 4: τ = −t0/ln(1 − w(t0)/w(∞)). An error of w is least felt at t0 = τ, and there e times in τ.
#[test]
fn equation_4_is_least_sensitive_after_one_time_constant() {
    let step = Step::new(&open(fine()), 4_000, 60);
    let end = step.steady(50);
    let tau = |at: f64, rpm: f64| -at / (1.0 - rpm / end).ln();
    let felt = |(window, rpm): (usize, &f64)| {
        let at = step.seconds(window as f64);
        let error = 1e-5 * end;
        let (low, high) = (tau(at, rpm - error), tau(at, rpm + error));
        (at, (low - high) / tau(at, *rpm) / 2e-5)
    };
    let (at, least) = step.rpm()[3..400]
        .iter()
        .enumerate()
        .map(|(n, rpm)| felt((n + 3, rpm)))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .unwrap();
    near("sensitivity", least, E, 1e-3);
    near("at", at, 2.8, 0.1);
}

#[test]
fn a_unit_of_the_speed_byte_is_20_rpm_from_10_to_200() {
    for (byte, rpm) in [(10, 200), (11, 220), (200, 4_000)] {
        let mut bench = spindle();
        bench.send(&[byte]);
        bench.run_ms(100);
        assert_eq!(bench.value("set_point_rpm"), rpm);
    }
    for byte in [9, 201] {
        let mut bench = spindle();
        bench.send(&[byte]);
        bench.run_ms(100);
        assert_eq!((bench.value("set_point_rpm"), bench.events()), (0, vec!["sub-frame refused (s)".to_owned()]));
    }
}

// --- the lead compensator -------------------------------------------------------------------------------------------

/// The speed and the error after a step from 2000 to 2200 rpm with everything fine, in rpm, relative to the start.
fn small_step(window_ms: u32) -> (Step, Vec<f64>) {
    let mut settings = fine();
    settings.controller.window_ms = window_ms;
    let step = Step::new(&settings, 2_000, 90).then(2_200, 60);
    let rpm = step.rpm().iter().map(|rpm| rpm - 2_000.0).collect();
    (step, rpm)
}

#[test]
fn the_closed_loop_has_these_poles() {
    for (window_ms, expected) in [
        (30, [(0.9647, 0.0), (0.7971, 0.1021), (0.7971, -0.1021)]),
        (32, [(0.9654, 0.0), (0.7954, 0.1194), (0.7954, -0.1194)]),
    ] {
        let (_, rpm) = small_step(window_ms);
        // The slow pole is what is left in the end; without it, the pair is what is seen at first. The fourth pole, at
        // 0, is gone after a window.
        let changes = differences(&rpm);
        let slow = ((rpm[110] - rpm[80]) / (rpm[80] - rpm[50])).powf(1.0 / 30.0);
        let rest: Vec<f64> = changes.windows(2).map(|pair| pair[1] - slow * pair[0]).collect();
        let pair = poles(&recurrence(&rest[2..25], 2));
        let found = [(slow, 0.0), pair[0], pair[1]];
        for ((re, im), (expected_re, expected_im)) in found.iter().zip(expected) {
            near("pole", *re, expected_re, if expected_im == 0.0 { 3e-4 } else { 1.5e-3 });
            near("pole, imaginary", *im, expected_im, 4e-3);
        }
    }
}

/// The open loop's frequency response: that of what was measured over that of the error which caused it.
#[test]
fn the_margins_are_62_degrees_and_22_db() {
    let (_, rpm) = small_step(30);
    let output: Vec<f64> = [0.0].into_iter().chain(rpm).collect();
    let error: Vec<f64> = output.iter().map(|rpm| 200.0 - rpm).collect();
    let (output, error) = (differences(&output), differences(&error));
    // The error jumped with the step, from 0 to 200 rpm.
    let error: Vec<f64> = [200.0].into_iter().chain(error).collect();
    let output: Vec<f64> = [0.0].into_iter().chain(output).collect();
    let open_loop = |omega: f64| {
        let ((a, b), (c, d)) = (spectrum(&output, omega * 0.030), spectrum(&error, omega * 0.030));
        let size = c * c + d * d;
        let (re, im) = ((a * c + b * d) / size, (b * c - a * d) / size);
        (re.hypot(im), im.atan2(re))
    };
    let find = |mut low: f64, mut high: f64, above: &dyn Fn(f64) -> bool| {
        for _ in 0..60 {
            let middle = (low + high) / 2.0;
            if above(middle) { low = middle } else { high = middle }
        }
        low
    };
    let crossover = find(1.0, 20.0, &|omega| open_loop(omega).0 > 1.0);
    near("crossover", crossover, 4.902, 0.01);
    near("phase margin", (open_loop(crossover).1 + PI).to_degrees(), 61.86, 0.1);
    let turning = find(10.0, 100.0, &|omega| open_loop(omega).1 < 0.0);
    near("gain margin", -20.0 * open_loop(turning).0.log10(), 22.14, 0.1);
}

#[test]
fn a_small_step_rises_in_0_24_s_and_overshoots_by_11_per_cent() {
    let (step, rpm) = small_step(30);
    let rise = step.seconds(crossing(&rpm, 180.0)) - step.seconds(crossing(&rpm, 20.0));
    near("rise", rise, 0.24, 0.024);
    near("settling", step.seconds(settled(&rpm, 200.0, 4.0)), 2.04, 0.204);
    near("overshoot", (peak(&rpm).1 / 200.0 - 1.0) * 100.0, 11.2, 1.12);
}

#[test]
fn from_rest_to_4000_rpm_takes_2_9_s_and_settles_in_4_5() {
    let step = Step::new(&SpindleSettings::default(), 4_000, 20);
    near("rise", step.reaches(3_600.0) - step.reaches(400.0), 2.88, 0.03 * 2.88);
    near("settling", step.seconds(settled(&step.rpm(), 4_000.0, 80.0)), 4.53, 0.03 * 4.53);
    let mean: Vec<f64> = step.rpm().windows(8).map(|windows| windows.iter().sum::<f64>() / 8.0).collect();
    assert!(mean.iter().all(|rpm| *rpm <= 4_020.0));
}

#[test]
fn with_50_pulses_and_10_bits_the_mean_is_right() {
    for (rpm, error, tolerance) in [(200, 0.9, 2.0), (1_500, 0.0, 0.5), (4_000, 0.0, 0.5)] {
        let step = Step::new(&SpindleSettings::default(), rpm, 60);
        near("mean", step.steady(1_000), f64::from(rpm) + error, tolerance);
    }
}

#[test]
fn a_load_of_500_rpm_makes_a_dip_of_32_rpm_and_no_standing_error() {
    let mut step = Step::new(&fine(), 2_000, 90);
    let before = step.bench.now;
    // 500 rpm of 5443.1, in per mille.
    step.bench.stimulus(MotorStimulus::Load(92).of(0));
    step.bench.run_ms(s(60));
    step.from = changed(&step.bench, "speed_counts", before);
    let lowest = step.rpm().iter().copied().fold(f64::MAX, f64::min);
    near("dip", lowest - 2_000.0, -32.0, 5.0);
    near("residual", step.steady(100) - 2_000.0, 0.0, 1.0);
}

#[test]
fn whole_numbers_of_8_bits_do_as_well() {
    let mut settings = SpindleSettings::default();
    // LSB of 10 bits per half count, in V per rad/s.
    settings.controller.k = 21.5 * 30.0 / 1_023.0 / (20.0 * TAU / 60.0);
    settings.controller.alpha = 248.0 / 256.0;
    settings.controller.beta = -154.0 / 256.0;
    for (byte, rpm) in [(10, 200.9), (75, 1_500.0), (100, 2_000.0), (200, 4_000.0)] {
        near("mean", Step::new(&settings, byte * 20, 60).steady(1_000), rpm, 2.0);
    }
}

/// Eq. 7 taken at its word: a loop of type 0.
#[test]
fn the_literal_form_leaves_an_error_of_a_fifth() {
    let mut settings = fine();
    settings.controller.form = LeadForm::Literal;
    (settings.controller.k, settings.controller.alpha, settings.controller.beta) = (1.0, 0.9, -0.5);
    for rpm in [1_500, 4_000] {
        let (set_point, steady) = (f64::from(rpm), Step::new(&settings, rpm, 60).steady(100));
        near("standing error, %", (1.0 - steady / set_point) * 100.0, 20.833_333, 1e-3);
        near("L0", steady / (set_point - steady), 3.8, 1e-3);
    }
    settings.encoder.pulses_per_rev = 50;
    settings.drive.bits = 10;
    near("rpm", Step::new(&settings, 1_500, 60).steady(1_000), 1_187.5, 3.0);
}

#[test]
fn the_feed_forward_form_is_right_until_there_is_a_load() {
    let mut settings = fine();
    settings.controller.form = LeadForm::FeedForward;
    (settings.controller.k, settings.controller.alpha, settings.controller.beta) = (1.0, 0.9, -0.7);
    near("rpm", Step::new(&settings, 1_500, 60).steady(100), 1_500.0, 0.1);
    settings.plant.load_torque = 500.0 / 5_443.099_1;
    // Divided by 1 + L0 = 1 + 19·0.1/0.3.
    near("rpm under load", Step::new(&settings, 1_500, 60).steady(100), 1_500.0 - 500.0 / (1.0 + 19.0 / 3.0), 0.2);
}

#[test]
fn a_zero_on_the_motors_pole_makes_a_long_way_slow() {
    let mut settings = SpindleSettings::default();
    (settings.controller.k, settings.controller.alpha, settings.controller.beta) = (0.25, 0.989_342_91, -0.6);
    let step = Step::new(&settings, 4_000, 40);
    near("rise", step.reaches(3_600.0) - step.reaches(400.0), 6.15, 0.03 * 6.15);
    near("settling", step.seconds(settled(&step.rpm(), 4_000.0, 80.0)), 11.13, 0.03 * 11.13);
}
