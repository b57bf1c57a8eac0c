//! The main motor's board (§4, Eq. 1 to 7): speed counted in windows, a lead compensator, a PWM of 10 bits.

use torno_protocol::board::{Capability, Role, Signal};
use torno_protocol::lathe::{Fault, SpindleSubFrame};
use torno_protocol::time::{Instant, Span};

use crate::control::Lead;
use crate::drive::{self, Pwm};
use crate::encoder::Encoder;
use crate::machine::{Machine, Progress, quantity};
use crate::pins::Stage;
use crate::plant::{Plant, Rotor, SpeedMotor};
use crate::rehearsal::{Rehearsal, SpeedLaw, SpeedSample};
use crate::schedule::Timing;
use crate::settings::{LeadForm, SpindleController, SpindleSettings};
use crate::slave::Slave;
use crate::task::Task;

/// The windows whose mean is compared with the set point: 0.24 s, enough to take out the jitter of a count. (Ours.)
const MEAN_OF: usize = 8;
/// Consecutive windows without a pulse after which a driven motor is stalled: about 1 s. (Ours.)
const STALL_WINDOWS: u32 = 34;
/// A drive above which any motor turns that can: 10 % of full. (Ours.)
const STALL_DRIVE: f64 = 0.1;
/// 1 rpm in rad/s.
const RPM: f64 = core::f64::consts::TAU / 60.0;

/// The main motor's board.
///
/// It executes a sub-frame until the mean of eight windows is within half a count of the set point, and regulates on.
pub type Spindle = Slave<SpindleMachine, { SpindleSubFrame::LENGTH }>;

/// What the main motor's board does but for the link to its master.
pub type SpindleTask = Task<SpindleMachine>;

/// The main motor and its control law.
#[derive(Clone, Debug)]
pub struct SpindleMachine {
    rotor: Rotor,
    firmware: Firmware,
}

#[derive(Clone, Debug)]
struct Firmware {
    lead: Lead,
    pwm: Pwm,
    /// What the firmware takes the supply for, in V.
    supply_v: f64,
    /// What it takes the motor's gain for, in rad/s per V.
    km: f64,
    /// The drive above which standing still is a stall, in LSB.
    stall_drive: i64,
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
        let SpindleController { form, k, alpha, beta, supply_v, km_rad_per_s_volt, .. } = settings.controller;
        let pwm = Pwm::new(settings.drive.bits);
        Self {
            lead: Lead::new(form, alpha, beta, k, supply_v),
            pwm,
            supply_v,
            km: km_rad_per_s_volt,
            stall_drive: pwm.width(STALL_DRIVE),
            rpm_per_count: settings.rpm_per_count(),
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

    /// The control law: the pulse's width for the next window, as a share of the whole.
    fn control(&mut self) -> f64 {
        if self.service != 0 {
            self.drive = self.service;
            return self.pwm.share(self.drive);
        }
        if self.set_point_rpm == 0 {
            self.lead.reset();
            self.drive = 0;
            return 0.0;
        }
        // In half counts the PIC needs no fractions: the set point's unit of 20 rpm is half a count of 40 rpm.
        let set_point_rpm = self.set_point_rpm as f64;
        let error_rpm = set_point_rpm - self.speed_counts() as f64 * self.rpm_per_count;
        let volts = self.lead.step(error_rpm * RPM, set_point_rpm * RPM / self.km);
        self.drive = self.pwm.width(volts / self.supply_v);
        self.pwm.share(self.drive)
    }

    fn is_done(&self) -> bool {
        if self.set_point_rpm == 0 {
            return self.windows == [0; MEAN_OF];
        }
        (self.speed_rpm() - self.set_point_rpm as f64).abs() <= self.rpm_per_count / 2.0
    }

    /// Whether the window that has ended makes the motor stalled.
    fn is_stalled(&mut self, armed: bool) -> bool {
        let idle = self.speed_counts() == 0 && self.set_point_rpm != 0 && self.drive > self.stall_drive;
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

impl Machine for SpindleMachine {
    type Settings = SpindleSettings;
    type SubFrame = SpindleSubFrame;

    fn new(settings: &SpindleSettings) -> (Self, Timing) {
        let SpindleSettings { plant, drive, encoder, controller } = settings;
        let motor = SpeedMotor::new(plant.km_rad_per_s_volt, plant.tau_s, drive.supply_v)
            .with_load(plant.friction + plant.load_torque);
        let rotor = Rotor::new(motor, Encoder::new(f64::from(encoder.pulses_per_rev)), drive.supply_v, plant.dead_ms);
        (Self { rotor, firmware: Firmware::new(settings) }, controller.timing())
    }

    fn signals(&self) -> [Signal; 4] {
        [
            quantity("speed_counts", Role::Speed, "counts"),
            quantity("speed_rpm", Role::Speed, "rpm"),
            quantity("set_point_rpm", Role::SetPoint, "rpm"),
            quantity("drive", Role::Drive, "LSB"),
        ]
    }

    fn values(&self) -> [i64; 4] {
        let firmware = &self.firmware;
        let speed_rpm = firmware.speed_rpm().round() as i64;
        [firmware.speed_counts(), speed_rpm, firmware.set_point_rpm, firmware.drive]
    }

    fn capabilities(&self) -> &'static [Capability] {
        Rotor::CAPABILITIES
    }

    fn stage(&self) -> Stage {
        Stage::Pwm(self.firmware.pwm.full() as i64)
    }

    fn plant(&mut self) -> &mut dyn Plant {
        &mut self.rotor
    }

    fn start(&mut self, _now: Instant, sub_frame: SpindleSubFrame) {
        self.firmware.set_point_rpm = i64::from(sub_frame.rpm());
    }

    fn sample(&mut self, now: Instant, busy: bool) -> Progress {
        let count = self.rotor.advance(now);
        self.firmware.count(count);
        // While it regulates, only a shaft that somebody has blocked, or loaded beyond what the motor can do, stands
        // still; the detector speaks for no other reason, whatever the settings. (Ours.)
        if self.firmware.is_stalled(busy || self.rotor.is_held()) {
            self.firmware.switch_off();
            self.rotor.drive(0.0);
            return Progress::Failed(Fault::Stalled);
        }
        let share = self.firmware.control();
        self.rotor.drive(share);
        if busy && self.firmware.is_done() { Progress::Done } else { Progress::Going }
    }

    fn serve(&mut self, per_mille: i32) {
        let firmware = &mut self.firmware;
        firmware.service = drive::service(per_mille, firmware.pwm.full()).max(0);
        firmware.drive = firmware.service;
        self.rotor.drive(firmware.pwm.share(firmware.drive));
    }

    fn reset(&mut self, now: Instant) {
        let count = self.rotor.advance(now);
        self.firmware.switch_off();
        self.firmware.windows = [0; MEAN_OF];
        self.firmware.sum = 0;
        self.firmware.count = count;
        self.rotor.drive(0.0);
    }

    fn is_at_rest(&self) -> bool {
        let firmware = &self.firmware;
        firmware.set_point_rpm == 0
            && firmware.drive == 0
            && firmware.windows == [0; MEAN_OF]
            && !self.rotor.exceeds(firmware.count)
    }

    fn is_on_watch(&self) -> bool {
        self.rotor.is_held() && self.firmware.set_point_rpm != 0
    }
}

impl Rehearsal {
    /// The main motor from rest to three speeds and to a stop; none of a law in another form than the working one.
    pub fn of_speed(settings: &SpindleSettings) -> Option<Self> {
        let works = settings.controller.form == LeadForm::Incremental;
        works.then(|| Self::Speed(SpeedLaw::of(settings), rehearse(settings)))
    }
}

/// From rest to three speeds, the second by coasting, and to a stop: what the law was given, and its drive.
fn rehearse(settings: &SpindleSettings) -> Vec<SpeedSample> {
    let (mut machine, timing) = SpindleMachine::new(settings);
    let sample = Span::from_millis(u64::from(timing.period_ms));
    let mut now = Instant::START;
    let mut samples = Vec::new();
    for (set_point, windows) in [(100_u8, 120), (40, 150), (0, 5), (75, 120)] {
        let Ok(sub_frame) = SpindleSubFrame::parse([set_point]) else { continue };
        machine.start(now, sub_frame);
        for _ in 0..windows {
            // A motor that cannot turn is no matter of the law.
            if let Progress::Failed(_) = machine.sample(now, false) {
                return samples;
            }
            let (counts, drive) = (machine.firmware.speed_counts(), machine.firmware.drive);
            samples.push(SpeedSample { set_point: i64::from(set_point), counts, drive });
            now += sample;
        }
    }
    samples
}

#[cfg(test)]
mod tests {
    use torno_protocol::board::MotorStimulus;
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
            Self { machine: SpindleMachine::new(&SpindleSettings::default()).0, now: Instant::START }
        }

        fn go(&mut self, rpm: u16, windows: usize) -> Vec<f64> {
            self.machine.start(self.now, SpindleSubFrame::parse([u8::try_from(rpm / 20).unwrap()]).unwrap());
            let window = |_| {
                self.machine.sample(self.now, true);
                self.now += WINDOW;
                self.machine.rotor.rpm_at(self.now)
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
    fn a_motor_that_stands_is_reported_only_while_busy_or_blocked() {
        let mut weak = SpindleSettings::default();
        weak.plant.km_rad_per_s_volt = 0.0;
        let fails = |busy: bool, blocked: bool| {
            let (mut machine, _) = SpindleMachine::new(&weak);
            machine.start(Instant::START, SpindleSubFrame::parse([75]).unwrap());
            machine.plant().disturb(Instant::START, &MotorStimulus::Stall(blocked));
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
            let found = mean(&drives) / 1_023.0;
            assert!((found - duty).abs() < 0.002, "{rpm}: {found}");
        }
    }
}
