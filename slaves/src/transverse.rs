//! The feed axis's board (§4, Eq. 8 to 15): a set point that moves along a trapezoid, and a PID that follows it.

use serde::{Deserialize, Serialize};
use torno_protocol::board::Stimulus;
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{Fault, Refusal, TransversePart};
use torno_protocol::time::Instant;

use crate::control::{Gains, Pid, Profile};
use crate::encoder::{Counter, Encoder};
use crate::plant::PositionMotor;
use crate::settings::{service_drive, within};
use crate::slave::{Machine, Progress, Slave};

/// The largest drive either way, in LSB: 8 bits, and two pins for the sense (§4).
const DRIVE_MAX: f64 = 255.0;
/// In position for so many samples, the axis is done. (Ours.)
const SETTLED_SAMPLES: u32 = 4;
/// How near the target is in position, in counts. (Ours.)
const IN_POSITION: i64 = 1;
/// Without a count for so many samples, an axis that is not in position is stalled: about 1 s. (Ours.)
const STALL_SAMPLES: u32 = 34;

/// The settings of the feed axis's board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TransverseSettings {
    /// The motor's time constant, in s: 0.001 to 100. Default 0.71875 (the open loop behind Eq. 11: 1/(2ξω)).
    pub tau_s: f64,
    /// The motor's speed per LSB of drive, in counts/s: 0.1 to 10000. Default 7500/255 (500 rpm, 900 slots; §4).
    pub counts_per_s_per_lsb: f64,
    /// K1 = Kp (Eq. 14), in LSB per count: 0 to 1000. Default 1.5. (Ours.)
    pub k1: f64,
    /// K2 = Kp/Ti (Eq. 14), in LSB per count and s: 0 to 1000. Default 0.5. (Ours.)
    pub k2: f64,
    /// K3 = Kp·Td (Eq. 14), in LSB·s per count: 0 to 1000. Default 0.27. (Ours.)
    pub k3: f64,
    /// The largest error that is integrated, in counts: 0 to 1000000. Default 50. (Ours.)
    pub integral_zone_counts: u32,
    /// The set point's acceleration, in counts per sample²: 1 to 225. Default 3. (Ours.)
    pub accel_counts_per_sample2: u32,
    /// The sampling time, in ms: 5 to 1000. Default 30 (§4).
    pub sample_ms: u32,
    /// The way from one end stop to the other, in counts: 2 to 1000000. Default 72000: 160 mm with a lead of 2 mm.
    /// (Ours; the paper gives no lead.)
    pub travel_counts: u32,
}

impl Default for TransverseSettings {
    fn default() -> Self {
        Self {
            tau_s: 0.71875,
            counts_per_s_per_lsb: 7_500.0 / 255.0,
            k1: 1.5,
            k2: 0.5,
            k3: 0.27,
            integral_zone_counts: 50,
            accel_counts_per_sample2: 3,
            sample_ms: 30,
            travel_counts: 72_000,
        }
    }
}

impl TransverseSettings {
    /// Checks every field's range.
    ///
    /// # Errors
    /// The first field that is out of range: its name, what was expected, what was found.
    pub fn check(&self) -> Result<(), String> {
        within("tau_s", self.tau_s, 0.001, 100.0)?;
        within("counts_per_s_per_lsb", self.counts_per_s_per_lsb, 0.1, 10_000.0)?;
        within("k1", self.k1, 0.0, 1_000.0)?;
        within("k2", self.k2, 0.0, 1_000.0)?;
        within("k3", self.k3, 0.0, 1_000.0)?;
        within("integral_zone_counts", self.integral_zone_counts, 0.0, 1e6)?;
        within("accel_counts_per_sample2", self.accel_counts_per_sample2, 1.0, 225.0)?;
        within("sample_ms", self.sample_ms, 5.0, 1_000.0)?;
        within("travel_counts", self.travel_counts, 2.0, 1e6)
    }

    fn sample_s(&self) -> f64 {
        f64::from(self.sample_ms) / 1_000.0
    }
}

/// The feed axis's board.
///
/// It executes a sub-frame until the set point has arrived and the axis has been within one count of it for four
/// samples; then it holds the axis there.
pub type Transverse = Slave<TransverseMachine, { TransversePart::LENGTH }, 4>;

impl Transverse {
    /// The board as at power-on: the carriage stands in mid-travel.
    pub fn new(settings: &TransverseSettings, clock: Clock) -> Self {
        Self::with(TransverseMachine::new(settings), settings.sample_ms, clock)
    }
}

/// The feed axis and its control law.
#[derive(Clone, Debug)]
pub struct TransverseMachine {
    motor: PositionMotor,
    counts_per_s_per_lsb: f64,
    /// On the motor's shaft (§4: 900 slots a revolution), so that it does not see backlash.
    encoder: Encoder,
    counter: Counter,
    /// Where the carriage was when the firmware last counted, by the true count.
    carriage: i64,
    firmware: Firmware,
}

#[derive(Clone, Debug)]
struct Firmware {
    pid: Pid,
    profile: Profile,
    /// LSB per count/sample of the set point's speed, and per count/sample² of its acceleration: what the motor needs.
    feed_forward: (f64, f64),
    /// The loop is closed. It is open from power-on, a reset or a fault to the next sub-frame. (Ours.)
    holding: bool,
    count: i64,
    /// The sense of the move under way.
    direction: i64,
    settled: u32,
    still: u32,
    drive: i64,
    /// The drive of the service mode; 0 without it.
    service: i64,
}

impl Firmware {
    fn new(settings: &TransverseSettings) -> Self {
        let sample_s = settings.sample_s();
        let zone = f64::from(settings.integral_zone_counts);
        let gains = Gains { k1: settings.k1, k2: settings.k2, k3: settings.k3, zone };
        let per_speed = 1.0 / (sample_s * settings.counts_per_s_per_lsb);
        Self {
            pid: Pid::new(gains, sample_s, DRIVE_MAX),
            profile: Profile::new(settings.accel_counts_per_sample2),
            feed_forward: (per_speed, per_speed * settings.tau_s / sample_s),
            holding: false,
            count: 0,
            direction: 0,
            settled: 0,
            still: 0,
            drive: 0,
            service: 0,
        }
    }

    fn start(&mut self, part: TransversePart) {
        self.profile.go(part.direction().sign() * i64::from(part.distance()), i64::from(part.speed()));
        self.direction = if part.distance() == 0 { 0 } else { part.direction().sign() };
        self.holding = true;
        self.settled = 0;
        self.still = 0;
    }

    /// Opens the loop. The set point is where the axis is.
    fn let_go(&mut self, count: i64) {
        self.holding = false;
        self.drive = 0;
        self.service = 0;
        self.pid.reset();
        self.stand_at(count);
    }

    fn stand_at(&mut self, count: i64) {
        self.count = count;
        self.profile.rest_at(count);
    }

    fn control(&mut self) {
        self.profile.step();
        let (per_speed, per_acceleration) = self.feed_forward;
        let feed_forward =
            per_speed * self.profile.speed() as f64 + per_acceleration * self.profile.acceleration() as f64;
        self.drive = self.pid.step((self.profile.set_point() - self.count) as f64, feed_forward);
    }

    fn progress(&mut self, moved: bool) -> Progress {
        let to_go = (self.profile.target() - self.count).abs();
        self.still = if moved || to_go <= IN_POSITION { 0 } else { self.still + 1 };
        self.settled = if self.profile.is_finished() && to_go <= IN_POSITION { self.settled + 1 } else { 0 };
        if self.still >= STALL_SAMPLES {
            Progress::Failed(Fault::Stalled)
        } else if self.settled >= SETTLED_SAMPLES {
            Progress::Done
        } else {
            Progress::Going
        }
    }
}

impl TransverseMachine {
    fn new(settings: &TransverseSettings) -> Self {
        let full = DRIVE_MAX * settings.counts_per_s_per_lsb;
        let encoder = Encoder::new(1.0);
        Self {
            motor: PositionMotor::new(settings.tau_s, full, f64::from(settings.travel_counts) / 2.0),
            counts_per_s_per_lsb: settings.counts_per_s_per_lsb,
            encoder,
            counter: Counter::new(encoder),
            carriage: 0,
            firmware: Firmware::new(settings),
        }
    }

    fn advance(&mut self, now: Instant) -> i64 {
        self.motor.advance(now);
        self.carriage = self.encoder.count(self.motor.carriage());
        self.counter.count(self.motor.position())
    }

    fn let_go(&mut self, count: i64) {
        self.firmware.let_go(count);
        self.motor.drive(0.0);
    }

    fn is_coasting(&self) -> bool {
        self.counter.count_at(self.motor.coast_end()) != self.firmware.count
    }
}

impl Machine<{ TransversePart::LENGTH }, 4> for TransverseMachine {
    const SIGNALS: [&'static str; 4] = ["position_counts", "set_point_counts", "drive", "carriage_offset_counts"];

    fn values(&self) -> [i64; 4] {
        let offset = self.carriage.saturating_sub(self.firmware.count);
        [self.firmware.count, self.firmware.profile.set_point(), self.firmware.drive, offset]
    }

    fn start(&mut self, now: Instant, part: [u8; TransversePart::LENGTH]) -> Result<(), Refusal> {
        let part = TransversePart::parse(part)?;
        if !self.firmware.holding {
            let count = self.advance(now);
            self.firmware.stand_at(count);
        }
        self.firmware.start(part);
        Ok(())
    }

    fn sample(&mut self, now: Instant, busy: bool) -> Progress {
        let count = self.advance(now);
        if self.firmware.service != 0 {
            self.firmware.count = count;
            return Progress::Going;
        }
        if !self.firmware.holding {
            self.firmware.stand_at(count);
            return Progress::Going;
        }
        let moved = count != self.firmware.count;
        self.firmware.count = count;
        self.firmware.control();
        self.motor.drive(self.counts_per_s_per_lsb * self.firmware.drive as f64);
        if !busy {
            return Progress::Going;
        }
        let end_stop = self.motor.end_stop();
        let progress = if end_stop != 0 && end_stop == self.firmware.direction {
            Progress::Failed(Fault::EndOfTravel)
        } else {
            self.firmware.progress(moved)
        };
        if let Progress::Failed(_) = progress {
            self.let_go(count);
        }
        progress
    }

    fn stall(&mut self, now: Instant, blocked: bool) {
        self.motor.advance(now);
        self.motor.block(blocked);
    }

    fn disturb(&mut self, now: Instant, stimulus: &Stimulus) {
        self.motor.advance(now);
        match stimulus {
            Stimulus::Counts(counts) => self.counter.invent(self.motor.position(), *counts),
            Stimulus::Load(per_mille) => self.motor.set_load(*per_mille),
            Stimulus::Supply(per_mille) => self.motor.set_supply(*per_mille),
            Stimulus::Backlash(counts) => self.motor.set_backlash(self.encoder.way(i32::from(*counts))),
            Stimulus::EndStop(counts) => self.motor.set_stop(self.encoder.way(*counts)),
            Stimulus::Drive(per_mille) => {
                self.firmware.service = service_drive(*per_mille, DRIVE_MAX);
                self.firmware.drive = self.firmware.service;
                self.motor.drive(self.counts_per_s_per_lsb * self.firmware.drive as f64);
            }
            _ => {}
        }
    }

    fn power(&mut self, now: Instant) {
        self.motor.advance(now);
        self.counter.restart(self.motor.position());
        self.reset(now);
    }

    fn reset(&mut self, now: Instant) {
        let count = self.advance(now);
        self.let_go(count);
    }

    fn is_at_rest(&self) -> bool {
        let firmware = &self.firmware;
        let level = firmware.profile.is_finished() && firmware.profile.target() == firmware.count;
        firmware.drive == 0 && level && firmware.pid.is_level() && !self.is_coasting()
    }
}

#[cfg(test)]
mod tests {
    use torno_protocol::time::Span;

    use super::*;

    const SAMPLE: Span = Span::from_millis(30);

    /// What became of one sub-frame: per sample, the lag behind the set point and the true position.
    struct Run {
        path: Vec<(i64, f64)>,
        ended: Option<(usize, Progress)>,
    }

    fn run(settings: &TransverseSettings, part: [u8; 4], samples: usize) -> Run {
        let mut machine = TransverseMachine::new(settings);
        let mut now = Instant::START;
        machine.start(now, part).unwrap();
        let mut run = Run { path: Vec::new(), ended: None };
        for n in 0..samples {
            let progress = machine.sample(now, run.ended.is_none());
            if progress != Progress::Going {
                run.ended = run.ended.or(Some((n, progress)));
            }
            let lag = machine.firmware.profile.set_point() - machine.firmware.count;
            run.path.push((lag, machine.motor.position()));
            now += SAMPLE;
        }
        run
    }

    #[test]
    fn the_defaults_are_in_range_and_nonsense_is_named() {
        assert_eq!(TransverseSettings::default().check(), Ok(()));
        let settings = TransverseSettings { accel_counts_per_sample2: 0, ..TransverseSettings::default() };
        assert_eq!(settings.check(), Err("accel_counts_per_sample2: expected 1 to 225, found 0".to_owned()));
    }

    #[test]
    fn nine_thousand_counts_follow_the_trapezoid_closely() {
        let Run { path, ended } = run(&TransverseSettings::default(), [112, 0x23, 0x28, 0], 250);
        let lag = path.iter().map(|(lag, _)| lag.abs()).max().unwrap();
        let peak = path.iter().map(|(_, x)| *x).fold(0.0, f64::max);
        assert!(lag <= 12, "{lag}");
        assert!(peak - 9_000.0 <= 4.9, "{peak}");
        // 119 samples of set point, 0.45 s to be in position, 4 samples to be sure of it.
        let Some((samples, Progress::Done)) = ended else { panic!("{ended:?}") };
        assert!((119..=119 + 15 + 4).contains(&samples), "{samples}");
        assert!((path[249].1 - 9_000.0).abs() < 1.0);
    }

    #[test]
    fn without_feed_forward_the_axis_would_lag_ten_times_as_far() {
        let mut machine = TransverseMachine::new(&TransverseSettings::default());
        machine.firmware.feed_forward = (0.0, 0.0);
        machine.start(Instant::START, [112, 0x23, 0x28, 0]).unwrap();
        let lags = (0..150u64).map(|n| {
            machine.sample(Instant::START + SAMPLE.times(n), true);
            (machine.firmware.profile.set_point() - machine.firmware.count).abs()
        });
        let lag = lags.max().unwrap();
        assert!((115..=130).contains(&lag), "{lag}");
    }

    #[test]
    fn a_move_of_900_counts_that_is_all_but_a_step_takes_0_7_s() {
        let settings = TransverseSettings { accel_counts_per_sample2: 225, ..TransverseSettings::default() };
        let Run { path, ended } = run(&settings, [225, 0x03, 0x84, 1], 200);
        let first = |level: f64| path.iter().position(|(_, x)| -x >= level).unwrap();
        let rise = SAMPLE.as_secs_f64() * (first(810.0) - first(90.0)) as f64;
        let peak = path.iter().map(|(_, x)| -*x).fold(0.0, f64::max);
        assert!((rise - 0.39).abs() <= 0.039, "{rise}");
        assert!(peak < 909.0, "{peak}");
        assert!(matches!(ended, Some((_, Progress::Done))), "{ended:?}");
    }
}
