//! A controller that moves a planner, and a sender that counts characters at 115 200 baud.

use std::collections::VecDeque;

use torno_grbl::controller::{Controller, RECEIVE};
use torno_grbl::machine::{Machine, Move, Overrides, Progress};
use torno_grbl::memory::{Memory, Settings};
use torno_grbl::{Abilities, Axes, Rate as Asked, Spindle};
use torno_motion::{AxisLimits, Limits, Planner, Rate};
use torno_protocol::time::{Instant, Span};

/// The firmware's.
const ABILITIES: Abilities =
    Abilities { axes: [true, true, true, false], counterclockwise: true, single_homing: false, holds_slowly: false };
/// Ten bits at 115 200 baud.
const CHARACTER: Span = Span::from_nanos(86_806);
const SAMPLE: Span = Span::from_millis(10);

/// Alike axes; the third one is what a GRBL machine's Z often is.
pub(crate) fn limits() -> Limits {
    let axis = |max_rate, acceleration| AxisLimits { steps_per_mm: 250.0, max_rate, acceleration };
    let (fast, slow) = (axis(3000.0, 500.0), axis(1000.0, 200.0));
    Limits { axes: [fast, fast, slow, fast], junction_deviation: 0.01 }
}

/// The planner as the controller's machine.
#[derive(Clone, Debug)]
pub(crate) struct Bench {
    pub planner: Planner,
    progress: VecDeque<Progress>,
    pub segments: u32,
}

impl Machine for Bench {
    fn room(&self) -> usize {
        self.planner.room()
    }

    fn has_motions(&self) -> bool {
        !self.planner.is_empty()
    }

    fn push(&mut self, now: Instant, motion: Move) {
        let rate = match motion.rate {
            Asked::Rapid => Rate::Rapid,
            Asked::Feed(rate) => Rate::Feed(rate.into()),
            Asked::Jog(rate) => Rate::Jog(rate.into()),
            Asked::PerMinute(rate) => Rate::InverseTime(rate.into()),
            Asked::PerTurn(_) => unreachable!("no program has a feed a turn"),
        };
        self.planner.push(now, motion.to, rate);
    }

    fn start(&mut self, now: Instant, _: Overrides) {
        self.planner.start(now);
    }

    fn hold(&mut self, now: Instant) {
        self.planner.hold(now);
    }

    fn forget(&mut self, now: Instant) {
        self.planner.abort(now);
    }

    fn home(&mut self, _: Instant, _: Axes<bool>) {}

    fn spindle(&mut self, _: Instant, _: Spindle, _: f32) {}

    fn override_by(&mut self, now: Instant, overrides: Overrides) {
        self.planner.set_overrides(now, overrides.feed, overrides.rapid);
    }

    fn position(&self, now: Instant) -> Axes<i32> {
        self.planner.position(now)
    }

    fn rate(&self, now: Instant) -> f32 {
        self.planner.rate(now) as f32
    }

    fn ends(&self) -> Axes<bool> {
        [false; 4]
    }

    fn poll_progress(&mut self) -> Option<Progress> {
        self.progress.pop_front()
    }
}

/// What a program was seen to do.
pub(crate) struct Seen {
    /// Steps of X, Y and Z every 10 ms from the first byte sent.
    pub places: Vec<[i32; 3]>,
    /// How many segments there were.
    pub segments: u32,
}

/// Streams a program. Lines are read in no time.
pub(crate) fn stream(program: &str) -> Seen {
    let limits = limits();
    let mut settings = Settings::default();
    for n in 0..3 {
        settings.max_rate[n] = limits.axes[n].max_rate as f32;
        settings.acceleration[n] = limits.axes[n].acceleration as f32;
    }
    let bench = Bench { planner: Planner::new(limits, 15), progress: VecDeque::new(), segments: 0 };
    let mut controller = Controller::new(Memory::new(settings), ABILITIES, bench);
    controller.power_on(Instant::START);
    while controller.poll_transmit(Instant::START).is_some() {}

    let mut places = vec![];
    let mut lines: VecDeque<&str> = program.lines().collect();
    let mut unanswered: VecDeque<usize> = VecDeque::new();
    let mut wire: VecDeque<(Instant, u8)> = VecDeque::new();
    let mut answers: VecDeque<(Instant, u8)> = VecDeque::new();
    let (mut sent, mut answered, mut sample) = (Instant::START, Instant::START, Instant::START);
    loop {
        // What happens next, or a look at the place.
        let room = |text: &str| unanswered.iter().sum::<usize>() + text.len() < RECEIVE;
        let fits = lines.front().is_some_and(|text| room(text));
        let events = [
            wire.front().map(|byte| byte.0),
            answers.front().map(|byte| byte.0),
            controller.machine().planner.segment().map(|segment| segment.end),
            fits.then_some(sent),
        ];
        let Some(next) = events.into_iter().flatten().min() else { break };
        if sample <= next {
            places.push(place(&controller, sample));
            sample += SAMPLE;
            continue;
        }
        let now = next;
        if fits && sent <= now {
            let text = lines.pop_front().unwrap();
            for byte in text.bytes().chain(*b"\n") {
                sent += CHARACTER;
                wire.push_back((sent, byte));
            }
            unanswered.push_back(text.len() + 1);
        } else if let Some(byte) = due(&mut wire, now) {
            assert!(controller.receive(now, byte), "the receive buffer is full");
        } else if let Some(byte) = due(&mut answers, now) {
            if byte == b'\n' {
                unanswered.pop_front();
                sent = sent.max(now);
            }
        } else {
            let bench = controller.machine_mut();
            while bench.planner.advance(now) {
                bench.segments += 1;
                if bench.planner.segment().is_none() {
                    let held = !bench.planner.is_empty();
                    bench.progress.push_back(if held { Progress::Held } else { Progress::Finished });
                }
            }
            controller.run(now);
        }
        while let Some(byte) = controller.poll_transmit(now) {
            answered = answered.max(now) + CHARACTER;
            answers.push_back((answered, byte));
        }
    }
    places.push(place(&controller, sample));
    Seen { places, segments: controller.machine().segments }
}

fn place(controller: &Controller<Bench>, at: Instant) -> [i32; 3] {
    let [x, y, z, _] = controller.machine().position(at);
    [x, y, z]
}

/// Takes the next byte, if it has come until `now`.
fn due(queue: &mut VecDeque<(Instant, u8)>, now: Instant) -> Option<u8> {
    let byte = queue.front().filter(|byte| byte.0 <= now)?.1;
    queue.pop_front();
    Some(byte)
}
