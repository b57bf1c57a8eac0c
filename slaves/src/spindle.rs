//! The main motor's board (§4, Eq. 1 to 7): speed counted in windows, a lead compensator, a PWM of 10 bits.

use serde::{Deserialize, Serialize};
use torno_protocol::board::Stimulus;
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{Fault, Refusal, SpindlePart};
use torno_protocol::time::Instant;

use crate::control::Lead;
use crate::encoder::{Counter, Encoder};
use crate::plant::SpeedMotor;
use crate::settings::{service_drive, within};
use crate::slave::{Machine, Progress, Slave};

/// Pulses of the encoder per revolution (§4).
const PULSES_PER_REV: f64 = 50.0;
/// The longest pulse of the PWM, in LSB: 10 bits, the PIC's own. (Ours.)
const DRIVE_MAX: f64 = 1_023.0;
/// The windows whose mean is compared with the set point: 0.24 s, enough to take out the jitter of a count. (Ours.)
const MEAN_OF: usize = 8;
/// Consecutive windows without a pulse after which a driven motor is stalled: about 1 s. (Ours.)
const STALL_WINDOWS: u32 = 34;
/// A drive that turns any motor that can turn, in LSB: 10 %. (Ours.)
const STALL_DRIVE: i64 = 102;
/// 1 rpm in rad/s.
const RPM: f64 = core::f64::consts::TAU / 60.0;

/// The settings of the main motor's board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SpindleSettings {
    /// The motor's gain, in rad/s per V: 0.1 to 1000. Default 19 (§4; the unit is inferred: 5500 rpm at 30 V).
    pub km_rad_per_s_volt: f64,
    /// The motor's time constant, in s: 0.01 to 1000. Default 2.8 (§4).
    pub tau_s: f64,
    /// The voltage at full drive, in V: 1 to 1000. Default 30 (§4).
    pub supply_v: f64,
    /// The window in which pulses are counted, in ms: 5 to 1000. Default 30 (§4; Eq. 6 was computed with 32).
    pub window_ms: u32,
    /// The compensator's zero (Eq. 7): 0 to 1. Default 0.97. (Ours.)
    pub alpha: f64,
    /// The compensator's pole, negated (Eq. 7): −0.99 to 0.99. Default −0.60. (Ours.)
    pub beta: f64,
    /// The compensator's gain (Eq. 7), in V per rad/s: 0.0001 to 100. Default 0.30. (Ours.)
    pub k: f64,
}

impl Default for SpindleSettings {
    fn default() -> Self {
        Self { km_rad_per_s_volt: 19.0, tau_s: 2.8, supply_v: 30.0, window_ms: 30, alpha: 0.97, beta: -0.60, k: 0.30 }
    }
}

impl SpindleSettings {
    /// Checks every field's range.
    ///
    /// # Errors
    /// The first field that is out of range: its name, what was expected, what was found.
    pub fn check(&self) -> Result<(), String> {
        within("km_rad_per_s_volt", self.km_rad_per_s_volt, 0.1, 1_000.0)?;
        within("tau_s", self.tau_s, 0.01, 1_000.0)?;
        within("supply_v", self.supply_v, 1.0, 1_000.0)?;
        within("window_ms", self.window_ms, 5.0, 1_000.0)?;
        within("alpha", self.alpha, 0.0, 1.0)?;
        within("beta", self.beta, -0.99, 0.99)?;
        within("k", self.k, 0.000_1, 100.0)
    }
}

/// The main motor's board.
///
/// It executes a sub-frame until the mean of eight windows is within half a count of the set point, and regulates on.
pub type Spindle = Slave<SpindleMachine, { SpindlePart::LENGTH }, 4>;

impl Spindle {
    /// The board as at power-on: the motor stands.
    pub fn new(settings: &SpindleSettings, clock: Clock) -> Self {
        Self::with(SpindleMachine::new(settings), settings.window_ms, clock)
    }
}

/// The main motor and its control law.
#[derive(Clone, Debug)]
pub struct SpindleMachine {
    motor: SpeedMotor,
    counter: Counter,
    firmware: Firmware,
}

#[derive(Clone, Debug)]
struct Firmware {
    lead: Lead,
    supply_v: f64,
    rpm_per_count: f64,
    set_point_rpm: i64,
    /// The encoder's count at the end of the last window.
    count: i64,
    windows: [i64; MEAN_OF],
    newest: usize,
    sum: i64,
    empty: u32,
    drive: i64,
    /// The drive of the service mode; 0 without it.
    service: i64,
}

impl Firmware {
    fn new(settings: &SpindleSettings) -> Self {
        let SpindleSettings { supply_v, window_ms, alpha, beta, k, .. } = *settings;
        Self {
            lead: Lead::new(alpha, beta, k, supply_v),
            supply_v,
            rpm_per_count: 60_000.0 / (PULSES_PER_REV * f64::from(window_ms)),
            set_point_rpm: 0,
            count: 0,
            windows: [0; MEAN_OF],
            newest: 0,
            sum: 0,
            empty: 0,
            drive: 0,
            service: 0,
        }
    }

    fn speed_counts(&self) -> i64 {
        self.windows[self.newest]
    }

    fn speed_rpm(&self) -> f64 {
        self.sum as f64 * self.rpm_per_count / MEAN_OF as f64
    }

    /// A window ends with the encoder at `count`.
    fn count(&mut self, count: i64) {
        // It counts pulses, not which way: where some are lost, those that come next make up for them. (Ours.)
        let pulses = count.saturating_sub(self.count).max(0);
        self.count = self.count.saturating_add(pulses);
        self.newest = (self.newest + 1) % MEAN_OF;
        self.sum += pulses - self.windows[self.newest];
        self.windows[self.newest] = pulses;
    }

    /// The control law: the mean voltage for the next window.
    fn control(&mut self) -> f64 {
        if self.service != 0 {
            self.drive = self.service;
            return self.drive as f64 / DRIVE_MAX * self.supply_v;
        }
        if self.set_point_rpm == 0 {
            self.lead.reset();
            self.drive = 0;
            return 0.0;
        }
        // In half counts the PIC needs no fractions: the set point's unit of 20 rpm is half a count of 40 rpm.
        let error_rpm = self.set_point_rpm as f64 - self.speed_counts() as f64 * self.rpm_per_count;
        let volts = self.lead.step(error_rpm * RPM);
        let drive = (volts / self.supply_v * DRIVE_MAX).round();
        self.drive = drive as i64;
        drive / DRIVE_MAX * self.supply_v
    }

    fn is_done(&self) -> bool {
        if self.set_point_rpm == 0 {
            return self.windows == [0; MEAN_OF];
        }
        (self.speed_rpm() - self.set_point_rpm as f64).abs() <= self.rpm_per_count / 2.0
    }

    /// Whether the window that has ended makes the motor stalled.
    fn is_stalled(&mut self, armed: bool) -> bool {
        let idle = self.speed_counts() == 0 && self.set_point_rpm != 0 && self.drive > STALL_DRIVE;
        self.empty = if armed && idle { self.empty.saturating_add(1) } else { 0 };
        self.empty >= STALL_WINDOWS
    }

    fn switch_off(&mut self) {
        self.set_point_rpm = 0;
        self.empty = 0;
        self.lead.reset();
        self.drive = 0;
        self.service = 0;
    }
}

impl SpindleMachine {
    fn new(settings: &SpindleSettings) -> Self {
        Self {
            motor: SpeedMotor::new(settings.km_rad_per_s_volt, settings.tau_s, settings.supply_v),
            counter: Counter::new(Encoder::new(PULSES_PER_REV)),
            firmware: Firmware::new(settings),
        }
    }

    fn advance(&mut self, now: Instant) -> i64 {
        self.motor.advance(now);
        self.counter.count(self.motor.angle_rev())
    }
}

impl Machine<{ SpindlePart::LENGTH }, 4> for SpindleMachine {
    const SIGNALS: [&'static str; 4] = ["speed_counts", "speed_rpm", "set_point_rpm", "drive"];

    fn values(&self) -> [i64; 4] {
        let firmware = &self.firmware;
        let speed_rpm = firmware.speed_rpm().round() as i64;
        [firmware.speed_counts(), speed_rpm, firmware.set_point_rpm, firmware.drive]
    }

    fn start(&mut self, _now: Instant, part: [u8; SpindlePart::LENGTH]) -> Result<(), Refusal> {
        self.firmware.set_point_rpm = i64::from(SpindlePart::parse(part)?.rpm());
        Ok(())
    }

    fn sample(&mut self, now: Instant, busy: bool) -> Progress {
        let count = self.advance(now);
        self.firmware.count(count);
        // While it regulates, only a shaft that somebody has blocked, or loaded beyond what the motor can do, stands
        // still; the detector speaks for no other reason, whatever the settings. (Ours.)
        if self.firmware.is_stalled(busy || self.motor.is_held()) {
            self.firmware.switch_off();
            self.motor.drive(0.0);
            return Progress::Failed(Fault::Stalled);
        }
        let volts = self.firmware.control();
        self.motor.drive(volts);
        if busy && self.firmware.is_done() { Progress::Done } else { Progress::Going }
    }

    fn stall(&mut self, now: Instant, blocked: bool) {
        self.motor.advance(now);
        self.motor.block(blocked);
    }

    fn disturb(&mut self, now: Instant, stimulus: &Stimulus) {
        self.motor.advance(now);
        match stimulus {
            Stimulus::Counts(counts) => self.counter.invent(self.motor.angle_rev(), *counts),
            Stimulus::Load(per_mille) => self.motor.set_load(*per_mille),
            Stimulus::Supply(per_mille) => self.motor.set_supply(*per_mille),
            Stimulus::Drive(per_mille) => {
                self.firmware.service = service_drive(*per_mille, DRIVE_MAX).max(0);
                self.firmware.drive = self.firmware.service;
                self.motor.drive(self.firmware.drive as f64 / DRIVE_MAX * self.firmware.supply_v);
            }
            _ => {}
        }
    }

    fn power(&mut self, now: Instant) {
        self.motor.advance(now);
        self.counter.restart(self.motor.angle_rev());
        self.reset(now);
    }

    fn reset(&mut self, now: Instant) {
        let count = self.advance(now);
        self.firmware.switch_off();
        self.firmware.windows = [0; MEAN_OF];
        self.firmware.sum = 0;
        self.firmware.count = count;
        self.motor.drive(0.0);
    }

    fn is_at_rest(&self) -> bool {
        let firmware = &self.firmware;
        firmware.set_point_rpm == 0
            && firmware.drive == 0
            && firmware.windows == [0; MEAN_OF]
            && self.counter.count_at(self.motor.coast_end_rev()) <= firmware.count
    }

    fn is_on_watch(&self) -> bool {
        self.motor.is_held() && self.firmware.set_point_rpm != 0
    }
}

#[cfg(test)]
mod tests {
    use torno_protocol::time::Span;

    use super::*;

    const WINDOW: Span = Span::from_millis(30);

    /// A machine with its own time, and the true speed in rpm at the end of each window.
    struct Run {
        machine: SpindleMachine,
        now: Instant,
    }

    impl Run {
        fn new() -> Self {
            Self { machine: SpindleMachine::new(&SpindleSettings::default()), now: Instant::START }
        }

        fn go(&mut self, rpm: u16, windows: usize) -> Vec<f64> {
            self.machine.start(self.now, [u8::try_from(rpm / 20).unwrap()]).unwrap();
            let window = |_| {
                self.machine.sample(self.now, true);
                self.now += WINDOW;
                let mut motor = self.machine.motor.clone();
                motor.advance(self.now);
                motor.rpm()
            };
            (0..windows).map(window).collect()
        }
    }

    fn mean(values: &[f64]) -> f64 {
        values.iter().sum::<f64>() / values.len() as f64
    }

    fn time(windows: usize) -> f64 {
        WINDOW.as_secs_f64() * windows as f64
    }

    #[test]
    fn the_defaults_are_in_range_and_nonsense_is_named() {
        assert_eq!(SpindleSettings::default().check(), Ok(()));
        let settings = SpindleSettings { tau_s: -1.0, ..SpindleSettings::default() };
        assert_eq!(settings.check(), Err("tau_s: expected 0.01 to 1000, found -1".to_owned()));
    }

    #[test]
    fn a_motor_that_stands_is_reported_only_while_busy_or_blocked() {
        let weak = SpindleSettings { km_rad_per_s_volt: 0.0, ..SpindleSettings::default() };
        let fails = |busy: bool, blocked: bool| {
            let mut machine = SpindleMachine::new(&weak);
            machine.start(Instant::START, [75]).unwrap();
            machine.stall(Instant::START, blocked);
            (0..100).any(|n| machine.sample(Instant::START + WINDOW.times(n), busy) == Progress::Failed(Fault::Stalled))
        };
        let found = [(false, false), (false, true), (true, false)].map(|(busy, blocked)| fails(busy, blocked));
        assert_eq!(found, [false, true, true]);
    }

    #[test]
    fn the_loop_leaves_no_standing_error() {
        for (rpm, expected, tolerance) in [(200, 200.9, 2.0), (1_500, 1_500.0, 0.5), (4_000, 4_000.0, 0.5)] {
            let speeds = Run::new().go(rpm, 1_500);
            let mean = mean(&speeds[1_000..]);
            assert!((mean - expected).abs() < tolerance, "{rpm}: {mean}");
        }
    }

    #[test]
    fn from_rest_to_4000_rpm_takes_2_9_s_and_settles_in_4_5_s() {
        let speeds = Run::new().go(4_000, 800);
        let first = |rpm: f64| speeds.iter().position(|speed| *speed >= rpm).unwrap();
        let rise = time(first(3_600.0) - first(400.0));
        let settled = time(speeds.iter().rposition(|speed| (speed - 4_000.0).abs() > 80.0).unwrap() + 2);
        let peak = speeds.iter().copied().fold(0.0, f64::max);
        assert!((rise - 2.88).abs() < 0.03 * 2.88, "{rise}");
        assert!((settled - 4.53).abs() < 0.03 * 4.53, "{settled}");
        assert!(peak < 4_020.0, "{peak}");
    }

    #[test]
    fn a_small_step_overshoots_by_less_than_a_count() {
        let mut run = Run::new();
        run.go(2_000, 1_000);
        let speeds = run.go(2_200, 400);
        let peak = speeds.iter().copied().fold(0.0, f64::max);
        assert!(peak > 2_200.0 && peak < 2_240.0, "{peak}");
        let first = |rpm: f64| speeds.iter().position(|speed| *speed >= rpm).unwrap();
        let rise = time(first(2_180.0) - first(2_020.0));
        assert!((rise - 0.24).abs() < 0.05, "{rise}");
    }

    #[test]
    fn stopping_is_coasting() {
        let mut run = Run::new();
        run.go(4_000, 1_000);
        let speeds = run.go(0, 600);
        let reached = time(speeds.iter().position(|speed| *speed <= 200.0).unwrap() + 1);
        assert!((reached - 8.388).abs() <= 0.030, "{reached}");
    }

    /// The compensator drives again from somewhat above 300 rpm on, so that the speed does not fall below the set
    /// point.
    #[test]
    fn slowing_down_to_200_rpm_does_not_undershoot_by_a_count() {
        let mut run = Run::new();
        run.go(4_000, 1_000);
        let speeds = run.go(200, 600);
        let near = time(speeds.iter().position(|speed| *speed <= 1_000.0).unwrap() + 1);
        assert!((near - 3.882).abs() <= 0.030, "{near}");
        let least = speeds.iter().copied().fold(f64::MAX, f64::min);
        let arrived = time(speeds.iter().position(|speed| *speed <= 220.0).unwrap() + 1);
        assert!(least > 160.0 && arrived < 10.0, "{least} {arrived}");
    }

    #[test]
    fn the_drive_settles_at_the_duty_that_the_speed_needs() {
        for (rpm, duty) in [(200, 0.0367), (1_500, 0.2756), (4_000, 0.7349)] {
            let mut run = Run::new();
            run.go(rpm, 1_000);
            let drives: Vec<f64> = (0..200).map(|_| (run.go(rpm, 1), run.machine.firmware.drive as f64).1).collect();
            let found = mean(&drives) / DRIVE_MAX;
            assert!((found - duty).abs() < 0.002, "{rpm}: {found}");
        }
    }
}
