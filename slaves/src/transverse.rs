//! The feed axis's board (§4, Eq. 8 to 15): a set point that moves along a trapezoid, and a PID that follows it.

use torno_protocol::board::{Capability, Role, Signal};
use torno_protocol::lathe::{Fault, TransverseSubFrame};
use torno_protocol::time::{Instant, Span};

use crate::control::{Gains, Pid, Profile, STANDS_MS, Sample};
use crate::drive::Bridge;
use crate::encoder::Encoder;
use crate::machine::{Machine, Progress, quantity};
use crate::pins::Stage;
use crate::plant::{Axis, Plant, PositionMotor, SampledPlant};
use crate::rehearsal::{FeedLaw, FeedSample, Rehearsal};
use crate::schedule::Timing;
use crate::settings::{JudgedBy, PositionForm, PositionModel, TransverseController, TransverseSettings};
use crate::slave::Slave;
use crate::task::Task;

/// In position for so long, the axis is done. (Ours.)
const SETTLED_MS: u32 = 120;
/// Driven for so long without a count, an axis that is not in position is stalled: 34 samples of 30 ms. (Ours.)
const STALL_MS: u32 = 1_020;
/// So for full drive: 12 samples of 30 ms. Any motor that can turn its shaft makes a count in one or two. (Ours.)
const FULL_DRIVE_MS: u32 = 360;

/// The feed axis's board.
///
/// It executes a sub-frame until the set point has arrived and the axis stands within one count of it; then it holds
/// the axis there.
pub type Transverse = Slave<TransverseMachine, { TransverseSubFrame::LENGTH }>;

/// What the feed axis's board does but for the link to its master.
pub type TransverseTask = Task<TransverseMachine>;

/// The feed axis and its control law.
#[derive(Clone, Debug)]
pub struct TransverseMachine {
    /// Its encoder is on the motor's shaft (§4: 900 slots a revolution).
    axis: Axis,
    /// Where the carriage was when the firmware last counted, by the true count.
    carriage: i64,
    firmware: Firmware,
    /// Of the drive's magnitude.
    bits: u32,
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
    /// Where it was when it began to be in position.
    settled_at: i64,
    still: u32,
    in_position: i64,
    judged_by: JudgedBy,
    /// A weaker drive without a count makes no stall.
    stall_drive: i64,
    settled_samples: u32,
    stall_samples: u32,
    drive: i64,
    /// The drive of the service mode; 0 without it.
    service: i64,
}

impl Firmware {
    fn new(settings: &TransverseSettings) -> Self {
        let TransverseController { form, k1, k2, k3, kch, kv, ka, sample_ms, .. } = settings.controller;
        let controller = &settings.controller;
        let sample_s = settings.sample_s();
        let gains = Gains {
            k1,
            k2,
            k3,
            k2_standing: controller.k2_standing,
            breakaway: controller.breakaway,
            dead_band: f64::from(controller.dead_band_counts.min(controller.in_position_counts)),
            zone: f64::from(controller.integral_zone_counts),
            kch,
        };
        let full = Bridge::full(settings.drive.bits);
        let by_motion = controller.judged_by == JudgedBy::Motion;
        let by_drive = by_motion && form == PositionForm::Pid && controller.breakaway > 0.0;
        let (settled_ms, stall_ms) =
            (if by_motion { STANDS_MS } else { SETTLED_MS }, if by_drive { FULL_DRIVE_MS } else { STALL_MS });
        Self {
            pid: Pid::new(form, gains, sample_s, full),
            profile: Profile::new(controller.set_point, controller.accel_counts_per_sample2, controller.wait_counts),
            feed_forward: (kv / sample_s, ka / (sample_s * sample_s)),
            holding: false,
            count: 0,
            direction: 0,
            settled: 0,
            settled_at: 0,
            still: 0,
            in_position: i64::from(controller.in_position_counts),
            judged_by: controller.judged_by,
            stall_drive: if by_drive { full as i64 } else { 1 },
            settled_samples: settled_ms.div_ceil(sample_ms),
            stall_samples: stall_ms.div_ceil(sample_ms),
            drive: 0,
            service: 0,
        }
    }

    fn start(&mut self, sub_frame: TransverseSubFrame) {
        self.profile.go(sub_frame.direction().sign() * i64::from(sub_frame.distance()), i64::from(sub_frame.speed()));
        self.direction = if sub_frame.distance() == 0 { 0 } else { sub_frame.direction().sign() };
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

    fn control(&mut self, moved: bool) {
        self.profile.step(self.count);
        let (per_speed, per_acceleration) = self.feed_forward;
        let feed_forward =
            per_speed * self.profile.speed() as f64 + per_acceleration * self.profile.acceleration() as f64;
        let set_point = self.profile.set_point();
        self.drive = self.pid.step(Sample {
            error: (set_point - self.count) as f64,
            set_point: set_point as f64,
            feed_forward,
            finished: self.profile.is_finished(),
            moved,
        });
    }

    fn progress(&mut self, moved: bool) -> Progress {
        let to_go = (self.profile.target() - self.count).abs();
        let goes = moved || to_go <= self.in_position || self.drive.abs() < self.stall_drive;
        self.still = if goes { 0 } else { self.still + 1 };
        self.settle(to_go);
        if self.still >= self.stall_samples {
            Progress::Failed(Fault::Stalled)
        } else if self.settled >= self.settled_samples {
            Progress::Done
        } else {
            Progress::Going
        }
    }

    /// For how many samples it has been in position. Judged by motion, it must not pass through, and a sample at the
    /// target itself counts twice.
    fn settle(&mut self, to_go: i64) {
        let by_motion = self.judged_by == JudgedBy::Motion;
        let passes = by_motion && (self.count - self.settled_at).abs() > self.in_position;
        if !self.profile.is_finished() || to_go > self.in_position {
            self.settled = 0;
            return;
        }
        if self.settled == 0 || passes {
            self.settled = 0;
            self.settled_at = self.count;
        }
        self.settled += if by_motion && to_go == 0 { 2 } else { 1 };
    }
}

impl TransverseMachine {
    fn advance(&mut self, now: Instant) -> i64 {
        let count = self.axis.advance(now);
        self.carriage = self.axis.carriage();
        count
    }

    fn let_go(&mut self, count: i64) {
        self.firmware.let_go(count);
        self.axis.switch_off();
    }
}

impl Machine for TransverseMachine {
    type Settings = TransverseSettings;
    type SubFrame = TransverseSubFrame;

    fn new(settings: &TransverseSettings) -> (Self, Timing) {
        let TransverseSettings { plant, drive, controller, .. } = settings;
        let (full, end) = (settings.full_counts_per_s(), settings.counts(plant.travel_mm) / 2.0);
        let motor = PositionMotor::new(plant.tau_s, full, end)
            .with_load(plant.friction, plant.load_torque, drive.supply)
            .with_backlash(settings.counts(plant.backlash_mm));
        let eq12 = &plant.eq12;
        let sampled = match plant.model {
            PositionModel::Motor => None,
            PositionModel::Eq12 => Some(SampledPlant::new(eq12.gain, eq12.zero, eq12.a1, eq12.a2, end)),
        };
        let axis = Axis::new(motor, Encoder::new(1.0), full, Bridge::full(drive.bits))
            .with_sampled(sampled)
            .with_dead_time(plant.dead_ms);
        (Self { axis, carriage: 0, firmware: Firmware::new(settings), bits: drive.bits }, controller.timing())
    }

    fn signals(&self) -> [Signal; 4] {
        [
            quantity("position_counts", Role::Position, "counts"),
            quantity("set_point_counts", Role::SetPoint, "counts"),
            quantity("drive", Role::Drive, "LSB"),
            quantity("carriage_offset_counts", Role::Offset, "counts"),
        ]
    }

    fn values(&self) -> [i64; 4] {
        let offset = self.carriage.saturating_sub(self.firmware.count);
        [self.firmware.count, self.firmware.profile.set_point(), self.firmware.drive, offset]
    }

    fn capabilities(&self) -> &'static [Capability] {
        Axis::CAPABILITIES
    }

    fn stage(&self) -> Stage {
        Stage::Bridge(self.bits)
    }

    fn plant(&mut self) -> &mut dyn Plant {
        &mut self.axis
    }

    fn start(&mut self, now: Instant, sub_frame: TransverseSubFrame) {
        if !self.firmware.holding {
            let count = self.advance(now);
            self.firmware.stand_at(count);
        }
        self.firmware.start(sub_frame);
    }

    fn sample(&mut self, now: Instant, busy: bool) -> Progress {
        let count = self.advance(now);
        if self.firmware.service != 0 {
            self.firmware.count = count;
            self.axis.drive(self.firmware.drive);
            return Progress::Going;
        }
        if !self.firmware.holding {
            self.firmware.stand_at(count);
            self.axis.drive(self.firmware.drive);
            return Progress::Going;
        }
        let moved = count != self.firmware.count;
        self.firmware.count = count;
        self.firmware.control(moved);
        self.axis.drive(self.firmware.drive);
        if !busy {
            return Progress::Going;
        }
        let end_stop = self.axis.end_stop();
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

    fn serve(&mut self, per_mille: i32) {
        self.firmware.service = self.axis.service(per_mille);
        self.firmware.drive = self.firmware.service;
        self.axis.drive(self.firmware.drive);
    }

    fn reset(&mut self, now: Instant) {
        let count = self.advance(now);
        self.let_go(count);
    }

    fn is_at_rest(&self) -> bool {
        let firmware = &self.firmware;
        let level = firmware.profile.is_finished() && firmware.profile.target() == firmware.count;
        firmware.drive == 0 && level && firmware.pid.is_level() && !self.axis.leaves(firmware.count)
    }
}

impl Rehearsal {
    /// Moves of the feed axis, on a motor with friction, so that every rule is met; none of a law in another form than
    /// the working one.
    pub fn of_feed(settings: &TransverseSettings) -> Option<Self> {
        let works = settings.controller.form == PositionForm::Pid;
        works.then(|| Self::Feed(FeedLaw::of(settings), rehearse(settings)))
    }
}

/// The friction of a rehearsal, as a share of the torque at standstill with full drive. (Ours.)
const REHEARSED_FRICTION: f64 = 0.05;

/// Moves both ways, long, short and as fast as the motor goes: what the law was given, and its drive.
fn rehearse(settings: &TransverseSettings) -> Vec<FeedSample> {
    let mut settings = settings.clone();
    settings.plant.friction = settings.plant.friction.max(REHEARSED_FRICTION);
    let (mut machine, timing) = TransverseMachine::new(&settings);
    let sample = Span::from_millis(u64::from(timing.period_ms));
    let mut now = Instant::START;
    let mut samples = Vec::new();
    for (speed, distance, direction) in [(60, 1_000_u16, 0), (5, 30, 1), (1, 2, 0), (225, 3_000, 1), (20, 7, 0)] {
        let [high, low] = distance.to_be_bytes();
        let Ok(sub_frame) = TransverseSubFrame::parse([speed, high, low, direction]) else { continue };
        machine.start(now, sub_frame);
        for _ in 0..90 {
            let before = machine.firmware.count;
            // An axis that is stuck or out of travel is no matter of the law.
            if let Progress::Failed(_) = machine.sample(now, true) {
                return samples;
            }
            let Firmware { profile, count, drive, .. } = &machine.firmware;
            samples.push(FeedSample {
                error: profile.set_point() - count,
                speed: profile.speed(),
                acceleration: profile.acceleration(),
                finished: profile.is_finished(),
                moved: *count != before,
                drive: *drive,
            });
            now += sample;
        }
    }
    samples
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAMPLE: Span = Span::from_millis(30);

    /// What became of one sub-frame: per sample, the lag behind the set point and the true position.
    struct Run {
        path: Vec<(i64, f64)>,
        ended: Option<(usize, Progress)>,
    }

    fn run(settings: &TransverseSettings, sub_frame: [u8; 4], samples: usize) -> Run {
        let (mut machine, _) = TransverseMachine::new(settings);
        let mut now = Instant::START;
        machine.start(now, TransverseSubFrame::parse(sub_frame).unwrap());
        let mut run = Run { path: Vec::new(), ended: None };
        for n in 0..samples {
            let progress = machine.sample(now, run.ended.is_none());
            if progress != Progress::Going {
                run.ended = run.ended.or(Some((n, progress)));
            }
            let lag = machine.firmware.profile.set_point() - machine.firmware.count;
            run.path.push((lag, machine.axis.motor()));
            now += SAMPLE;
        }
        run
    }

    #[test]
    fn nine_thousand_counts_follow_the_trapezoid_closely() {
        let Run { path, ended } = run(&TransverseSettings::default(), [112, 0x23, 0x28, 0], 250);
        let lag = path.iter().map(|(lag, _)| lag.abs()).max().unwrap();
        let peak = path.iter().map(|(_, x)| *x).fold(0.0, f64::max);
        assert!(lag <= 12, "{lag}");
        assert!(peak - 9_000.0 <= 4.9, "{peak}");
        // 119 samples of set point, 0.45 s to be in position, up to 8 samples to be sure of it.
        let Some((samples, Progress::Done)) = ended else { panic!("{ended:?}") };
        assert!((119..=119 + 15 + 8).contains(&samples), "{samples}");
        assert!((path[249].1 - 9_000.0).abs() < 1.0);
    }

    #[test]
    fn without_feed_forward_the_axis_would_lag_ten_times_as_far() {
        let (mut machine, _) = TransverseMachine::new(&TransverseSettings::default());
        machine.firmware.feed_forward = (0.0, 0.0);
        machine.start(Instant::START, TransverseSubFrame::parse([112, 0x23, 0x28, 0]).unwrap());
        let lags = (0..150u64).map(|n| {
            machine.sample(Instant::START + SAMPLE.times(n), true);
            (machine.firmware.profile.set_point() - machine.firmware.count).abs()
        });
        let lag = lags.max().unwrap();
        assert!((115..=130).contains(&lag), "{lag}");
    }

    #[test]
    fn a_move_of_900_counts_that_is_all_but_a_step_takes_0_7_s() {
        let mut settings = TransverseSettings::default();
        settings.controller.accel_counts_per_sample2 = 225;
        let Run { path, ended } = run(&settings, [225, 0x03, 0x84, 1], 200);
        let first = |level: f64| path.iter().position(|(_, x)| -x >= level).unwrap();
        let rise = SAMPLE.as_secs_f64() * (first(810.0) - first(90.0)) as f64;
        let peak = path.iter().map(|(_, x)| -*x).fold(0.0, f64::max);
        assert!((rise - 0.39).abs() <= 0.039, "{rise}");
        assert!(peak < 909.0, "{peak}");
        assert!(matches!(ended, Some((_, Progress::Done))), "{ended:?}");
    }

    /// The delay margin of the default gains is 73 ms: what `torno tune transverse` says.
    #[test]
    fn a_dead_time_beyond_the_delay_margin_makes_the_loop_unstable() {
        let ends = |dead_ms: f64| {
            let mut settings = TransverseSettings::default();
            settings.plant.dead_ms = dead_ms;
            let Run { path, ended } = run(&settings, [112, 0x23, 0x28, 0], 700);
            let last = path[600..].iter().map(|(_, x)| (x - 9_000.0).abs()).fold(0.0, f64::max);
            (ended.map(|(_, progress)| progress), last)
        };
        for dead_ms in [0.0, 20.0, 55.0] {
            let (ended, off) = ends(dead_ms);
            assert!(ended == Some(Progress::Done) && off <= 1.5, "{dead_ms}: {ended:?} {off}");
        }
        for dead_ms in [85.0, 120.0] {
            let (ended, off) = ends(dead_ms);
            assert!(ended.is_none() && off > 10.0, "{dead_ms}: {ended:?} {off}");
        }
    }
}
