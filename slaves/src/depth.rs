//! The infeed axis's board (§4): a slow motor that is switched on and off.

use torno_protocol::board::{Capability, Role, Signal};
use torno_protocol::lathe::{DepthSubFrame, Fault};
use torno_protocol::time::Instant;

use crate::control::OnOff;
use crate::encoder::Encoder;
use crate::machine::{Machine, Progress, quantity};
use crate::pins::Stage;
use crate::plant::{Axis, Plant};
use crate::schedule::Timing;
use crate::settings::DepthSettings;
use crate::slave::Slave;
use crate::task::Task;

/// In position for so many polls, the axis is done. (Ours.)
const SETTLED_POLLS: u32 = 4;
/// How near the target is in position, in slots. (Ours.)
const IN_POSITION: i64 = 1;

/// The infeed axis's board.
///
/// It executes a sub-frame until the drive is off and the axis has been within one slot of its target for four polls.
pub type Depth = Slave<DepthMachine, { DepthSubFrame::LENGTH }>;

/// What the infeed axis's board does but for the link to its master.
pub type DepthTask = Task<DepthMachine>;

/// The infeed axis and its control law.
#[derive(Clone, Debug)]
pub struct DepthMachine {
    /// Its encoder lies along the slide (§4: linear, 900 slots in 160 mm).
    axis: Axis,
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

    fn start(&mut self, sub_frame: DepthSubFrame) {
        let distance = sub_frame.direction().sign() * i64::from(sub_frame.distance());
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
    fn advance(&mut self, now: Instant) -> bool {
        let before = self.firmware.count;
        self.firmware.count = self.axis.advance(now);
        self.carriage = self.axis.carriage();
        self.firmware.count != before
    }

    fn drive(&self) -> i64 {
        if self.service == 0 { self.firmware.law.drive() } else { self.service }
    }
}

impl Machine for DepthMachine {
    type Settings = DepthSettings;
    type SubFrame = DepthSubFrame;

    fn new(settings: &DepthSettings) -> (Self, Timing) {
        let encoder = Encoder::new(settings.slots_per_mm());
        // The motor is switched on or off, nothing between.
        let axis = Axis::new(settings.motor(), encoder, settings.speed_mm_per_s(), 1.0).with_encoder_along_slide();
        let timing = Timing::exact(settings.controller.poll_ms);
        (Self { axis, carriage: 0, firmware: Firmware::new(settings), service: 0 }, timing)
    }

    fn signals(&self) -> [Signal; 4] {
        [
            quantity("position_counts", Role::Position, "counts"),
            quantity("remaining_counts", Role::Remaining, "counts"),
            quantity("drive", Role::Drive, ""),
            quantity("carriage_offset_counts", Role::Offset, "counts"),
        ]
    }

    fn values(&self) -> [i64; 4] {
        let offset = self.carriage.saturating_sub(self.firmware.count);
        [self.firmware.count, self.firmware.remaining(), self.drive(), offset]
    }

    fn capabilities(&self) -> &'static [Capability] {
        Axis::CAPABILITIES
    }

    fn stage(&self) -> Stage {
        Stage::Bridge(0)
    }

    fn plant(&mut self) -> &mut dyn Plant {
        &mut self.axis
    }

    fn start(&mut self, now: Instant, sub_frame: DepthSubFrame) {
        self.advance(now);
        self.firmware.start(sub_frame);
        self.axis.drive(self.drive());
    }

    fn sample(&mut self, now: Instant, busy: bool) -> Progress {
        let moved = self.advance(now);
        if !busy || self.service != 0 {
            return Progress::Going;
        }
        let end_stop = self.axis.end_stop();
        let progress = if end_stop != 0 && end_stop == self.firmware.law.drive() {
            Progress::Failed(Fault::EndOfTravel)
        } else {
            self.firmware.poll(moved)
        };
        if let Progress::Failed(_) = progress {
            self.firmware.switch_off();
        }
        self.axis.drive(self.drive());
        progress
    }

    fn serve(&mut self, per_mille: i32) {
        self.service = self.axis.service(per_mille);
        self.axis.drive(self.drive());
    }

    fn reset(&mut self, now: Instant) {
        self.advance(now);
        self.firmware.switch_off();
        self.service = 0;
        self.axis.drive(0);
    }

    fn is_at_rest(&self) -> bool {
        self.drive() == 0 && !self.axis.leaves(self.firmware.count)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use torno_protocol::board::MotorStimulus;
    use torno_protocol::time::Span;

    use super::*;
    use crate::Slide;

    /// A machine, and a slide that is told what telemetry reports of it.
    struct Followed {
        machine: DepthMachine,
        slide: Slide,
        told: [i64; 2],
        now: Instant,
    }

    impl Followed {
        fn new(settings: &DepthSettings) -> Self {
            let (machine, _) = DepthMachine::new(settings);
            Self { machine, slide: Slide::new(settings), told: [0; 2], now: Instant::START }
        }

        fn tell(&mut self) {
            let [position, _, drive, offset] = self.machine.values();
            if self.told != [position + offset, drive] {
                self.told = [position + offset, drive];
                self.slide.advance(self.now);
                self.slide.drive(drive);
                self.slide.count(position + offset);
            }
        }

        /// A move to its end, and what follows it within `more` polls; gives how far slide and machine were apart.
        fn go(&mut self, slots: i8, more: u32) -> f64 {
            let direction = u8::from(slots < 0);
            self.machine.start(self.now, DepthSubFrame::parse([0, slots.unsigned_abs(), direction]).unwrap());
            self.tell();
            let (mut worst, mut left) = (0.0, None);
            while left != Some(0) {
                self.now += Span::from_millis(10);
                let progress = self.machine.sample(self.now, left.is_none());
                self.tell();
                left = match left {
                    None if progress == Progress::Going => None,
                    None => Some(more),
                    Some(left) => Some(left - 1),
                };
                worst = self.apart().max(worst);
            }
            worst
        }

        /// In slots.
        fn apart(&mut self) -> f64 {
            self.slide.advance(self.now);
            (self.slide.counts() - self.machine.axis.slide() * 5.625).abs()
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        #[test]
        fn a_slide_that_is_followed_is_where_it_is(
            moves in proptest::collection::vec((-9_i8..=9, 0_u32..100), 1..8),
            (tau_s, rpm, friction, load_torque) in (0.005..0.2, 4.0..30.0, 0.0..0.5, 0.0..0.4_f64),
            backlash_mm in 0.0..0.3,
        ) {
            let mut settings = DepthSettings::default();
            for (loaded, backlash) in [(0.0, 0.0), (1.0, backlash_mm)] {
                settings.plant.tau_s = tau_s;
                settings.plant.rpm = rpm;
                settings.plant.friction = loaded * friction;
                settings.plant.load_torque = loaded * load_torque.min(0.9 * friction);
                settings.plant.backlash_mm = backlash;
                let mut followed = Followed::new(&settings);
                for (slots, more) in &moves {
                    let worst = followed.go(*slots, *more);
                    // A poll may come late for an edge: up to there the count holds it back.
                    let late = rpm / 60.0 * 2.0 * 0.010 * 5.625 + 1e-5;
                    prop_assert!(worst <= late, "{worst}");
                }
                followed.go(0, 200);
                prop_assert!(followed.apart() < 2e-5);
            }
        }
    }

    #[test]
    fn a_slide_stands_where_it_was_last_and_beyond_the_middle_of_its_slot() {
        let mut followed = Followed::new(&DepthSettings::default());
        followed.go(4, 100);
        let out = followed.slide.counts();
        assert!((3.5..3.65).contains(&out) && followed.slide.stands_at().is_none(), "{out}");
        followed.go(0, 100);
        assert_eq!(followed.slide.counts(), out);
        followed.go(5, 0);
        followed.go(-5, 100);
        let back = followed.slide.counts();
        assert!((4.35..4.5).contains(&back) && (0.75..0.85).contains(&(back - out)), "{out} {back}");
    }

    #[test]
    fn what_blocks_a_slide_is_seen_within_its_slot() {
        let mut followed = Followed::new(&DepthSettings::default());
        followed.go(2, 100);
        followed.machine.plant().disturb(followed.now, &MotorStimulus::Stall(true));
        followed.go(9, 100);
        assert!(followed.apart() < 1.0 && followed.slide.counts() == 2.5, "{:?}", followed.slide);
        followed.machine.plant().disturb(followed.now, &MotorStimulus::Stall(false));
        followed.go(2, 100);
        assert!(followed.apart() < 0.02, "{:?}", followed.slide);
    }

    /// What became of each poll, with the axis at these counts: the drive after it, and whether it was done.
    fn polls(target: u8, counts: &[i64]) -> Vec<(i64, bool)> {
        let mut firmware = Firmware::new(&DepthSettings::default());
        firmware.start(DepthSubFrame::parse([0, target, 0]).unwrap());
        let poll = |count: &i64| {
            let moved = *count != firmware.count;
            firmware.count = *count;
            let progress = firmware.poll(moved);
            (firmware.law.drive(), progress == Progress::Done)
        };
        counts.iter().map(poll).collect()
    }

    #[test]
    fn beyond_its_target_it_drives_back_once_it_has_stood_for_four_polls() {
        let found = polls(2, &[1, 2, 4, 5, 5, 5, 5, 5, 4, 2, 2]);
        let drives: Vec<i64> = found.iter().map(|(drive, _)| *drive).collect();
        assert_eq!(drives, [1, 0, 0, 0, 0, 0, 0, -1, -1, 0, 0]);
        assert!(found.iter().all(|(_, done)| !done));
    }

    #[test]
    fn it_is_done_at_the_fourth_poll_within_a_slot_of_its_target() {
        for counts in [[1, 2, 2, 2, 2, 2], [1, 2, 3, 3, 3, 3], [1, 2, 3, 2, 1, 2]] {
            let found: Vec<bool> = polls(2, &counts).iter().map(|(_, done)| *done).collect();
            assert_eq!(found, [false, false, false, false, true, true], "{counts:?}");
        }
        // One poll outside, and it counts again.
        let found: Vec<bool> = polls(2, &[2, 2, 2, 4, 3, 3, 3, 3]).iter().map(|(_, done)| *done).collect();
        assert_eq!(found, [false, false, false, false, false, false, false, true]);
    }

    #[test]
    fn it_stops_past_the_first_edge_of_its_slot_by_what_the_settings_say() {
        for poll_ms in [1, 10, 40] {
            let mut settings = DepthSettings::default();
            settings.controller.poll_ms = poll_ms;
            let slots_per_mm = settings.slots_per_mm();
            let (overrun, poll) = (settings.overrun_slots(), f64::from(poll_ms) / 1_000.0);
            let (mut machine, _) = DepthMachine::new(&settings);
            let mut now = Instant::START;
            let mut slot = 0.0;
            for (slots, direction) in [(5, 1), (3, 1), (4, 0), (2, 0), (6, 1)] {
                machine.start(now, DepthSubFrame::parse([0, slots, direction]).unwrap());
                let sense = if direction == 0 { 1.0 } else { -1.0 };
                slot += sense * f64::from(slots);
                loop {
                    now += Span::from_millis(u64::from(poll_ms));
                    if machine.sample(now, true) == Progress::Done {
                        break;
                    }
                }
                // To the very end of coasting.
                now += Span::from_secs(1);
                machine.advance(now);
                let expected = slot - sense * (0.5 - overrun);
                let off = machine.axis.motor() * slots_per_mm - expected;
                // Where between two polls the edge lies is left open.
                let open = 0.5 * poll * slots_per_mm * settings.speed_mm_per_s() + 1e-3;
                assert!(off.abs() <= open, "{poll_ms} ms: {off} of {open} slots");
            }
        }
    }
}
