//! The infeed axis's board (§4): a slow motor that is switched on and off.

use torno_protocol::board::Stimulus;
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{DepthPart, Fault, Refusal};
use torno_protocol::time::Instant;

use crate::control::OnOff;
use crate::drive::{self, Bridge};
use crate::encoder::{Counter, Encoder};
use crate::plant::PositionMotor;
use crate::settings::DepthSettings;
use crate::slave::{Machine, Progress, Slave};
use crate::task::Task;

/// In position for so many polls, the axis is done. (Ours.)
const SETTLED_POLLS: u32 = 4;
/// How near the target is in position, in slots. (Ours.)
const IN_POSITION: i64 = 1;

/// The infeed axis's board.
///
/// It executes a sub-frame until the drive is off and the axis has been within one slot of its target for four polls.
pub type Depth = Slave<DepthMachine, { DepthPart::LENGTH }, 4>;

/// What the infeed axis's board does but for the link to its master.
pub type DepthTask = Task<DepthMachine, { DepthPart::LENGTH }, 4>;

impl Depth {
    /// The board as at power-on: the slide stands in mid-travel.
    pub fn new(settings: &DepthSettings, clock: Clock) -> Self {
        Self::with(DepthTask::new(settings, clock), clock)
    }
}

impl DepthTask {
    /// The same: the slide stands in mid-travel.
    pub fn new(settings: &DepthSettings, clock: Clock) -> Self {
        Self::with(DepthMachine::new(settings), settings.controller.poll_ms, clock)
    }
}

/// The infeed axis and its control law.
#[derive(Clone, Debug)]
pub struct DepthMachine {
    motor: PositionMotor,
    speed_mm_per_s: f64,
    /// Along the slide (§4: linear, 900 slots in 160 mm), so that it sees what the slide does, backlash and all.
    encoder: Encoder,
    counter: Counter,
    /// Where the slide was when the firmware last counted, by the true count.
    carriage: i64,
    firmware: Firmware,
    /// The drive of the service mode; 0 without it.
    service: i64,
}

#[derive(Clone, Debug)]
struct Firmware {
    law: OnOff,
    stall_polls: u32,
    /// Where the axis was last sent. Lost with a reset or a fault: then it is where the axis stands.
    target: Option<i64>,
    count: i64,
    /// Polls in a row in position, and without a slot.
    settled: u32,
    still: u32,
}

impl Firmware {
    fn new(settings: &DepthSettings) -> Self {
        let stall_polls = settings.stall_polls();
        Self { law: OnOff::default(), stall_polls, target: Some(0), count: 0, settled: 0, still: 0 }
    }

    fn remaining(&self) -> i64 {
        self.target.map_or(0, |target| target.saturating_sub(self.count))
    }

    fn start(&mut self, part: DepthPart) {
        let distance = part.direction().sign() * i64::from(part.distance());
        self.target = Some(self.target.unwrap_or(self.count).saturating_add(distance));
        self.settled = 0;
        self.still = 0;
        if distance != 0 {
            self.law.start(self.remaining());
        }
    }

    fn switch_off(&mut self) {
        self.law.stop();
        self.target = None;
    }

    fn poll(&mut self, moved: bool) -> Progress {
        self.still = if moved { 0 } else { self.still.saturating_add(1) };
        if self.law.drive() != 0 && self.still >= self.stall_polls {
            return Progress::Failed(Fault::Stalled);
        }
        let driven = self.law.drive() != 0;
        self.law.step(self.remaining(), self.still >= SETTLED_POLLS);
        if driven != (self.law.drive() != 0) {
            self.still = 0;
        }
        let settled = self.law.drive() == 0 && self.remaining().abs() <= IN_POSITION;
        self.settled = if settled { self.settled + 1 } else { 0 };
        if self.settled >= SETTLED_POLLS { Progress::Done } else { Progress::Going }
    }
}

impl DepthMachine {
    fn new(settings: &DepthSettings) -> Self {
        let speed_mm_per_s = settings.speed_mm_per_s();
        let encoder = Encoder::new(settings.slots_per_mm());
        let DepthSettings { plant, drive, .. } = settings;
        let motor = PositionMotor::new(plant.tau_s, speed_mm_per_s, plant.travel_mm / 2.0);
        Self {
            motor: motor.with_load(plant.friction, plant.load_torque, drive.supply).with_backlash(plant.backlash_mm),
            speed_mm_per_s,
            encoder,
            counter: Counter::new(encoder),
            carriage: 0,
            firmware: Firmware::new(settings),
            service: 0,
        }
    }

    fn advance(&mut self, now: Instant) -> bool {
        self.motor.advance(now);
        let before = self.firmware.count;
        self.carriage = self.encoder.count(self.motor.carriage());
        self.firmware.count = self.counter.count(self.motor.carriage());
        self.firmware.count != before
    }

    fn drive(&self) -> i64 {
        if self.service == 0 { self.firmware.law.drive() } else { self.service }
    }

    fn apply(&mut self) {
        self.motor.drive(self.speed_mm_per_s * Bridge::set(self.drive()).drive());
    }
}

impl Machine<{ DepthPart::LENGTH }, 4> for DepthMachine {
    const SIGNALS: [&'static str; 4] = ["position_counts", "remaining_counts", "drive", "carriage_offset_counts"];

    fn values(&self) -> [i64; 4] {
        let offset = self.carriage.saturating_sub(self.firmware.count);
        [self.firmware.count, self.firmware.remaining(), self.drive(), offset]
    }

    fn start(&mut self, now: Instant, part: [u8; DepthPart::LENGTH]) -> Result<(), Refusal> {
        let part = DepthPart::parse(part)?;
        self.advance(now);
        self.firmware.start(part);
        self.apply();
        Ok(())
    }

    fn sample(&mut self, now: Instant, busy: bool) -> Progress {
        let moved = self.advance(now);
        if !busy || self.service != 0 {
            return Progress::Going;
        }
        let end_stop = self.motor.end_stop();
        let progress = if end_stop != 0 && end_stop == self.firmware.law.drive() {
            Progress::Failed(Fault::EndOfTravel)
        } else {
            self.firmware.poll(moved)
        };
        if let Progress::Failed(_) = progress {
            self.firmware.switch_off();
        }
        self.apply();
        progress
    }

    fn stall(&mut self, now: Instant, blocked: bool) {
        self.motor.advance(now);
        self.motor.block(blocked);
    }

    fn disturb(&mut self, now: Instant, stimulus: &Stimulus) {
        self.motor.advance(now);
        match stimulus {
            Stimulus::Counts(counts) => self.counter.invent(self.motor.carriage(), *counts),
            // The motor is switched on or off, nothing between.
            Stimulus::Drive(per_mille) => {
                self.service = drive::service(*per_mille, 1.0);
                self.apply();
            }
            _ => self.motor.disturb(stimulus, |counts| self.encoder.way(counts)),
        }
    }

    fn power(&mut self, now: Instant) {
        self.motor.advance(now);
        self.counter.restart(self.motor.carriage());
        self.reset(now);
    }

    fn reset(&mut self, now: Instant) {
        self.advance(now);
        self.firmware.switch_off();
        self.service = 0;
        self.apply();
    }

    fn is_at_rest(&self) -> bool {
        self.drive() == 0 && self.counter.count_at(self.motor.carriage_coast_end()) == self.firmware.count
    }
}
