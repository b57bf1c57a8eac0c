//! The feed axis over an envelope of friction and load: three programs, and what became of them.

#![allow(clippy::disallowed_methods, reason = "seconds of a move are only shown and compared")]

use torno_protocol::board::{MotorStimulus, Output};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{ACK, CAN};
use torno_slaves::{JudgedBy, Transverse, TransverseSettings};

use super::Bench;

/// The sampling time.
const SAMPLE_MS: u64 = 30;
const SAMPLE_S: f64 = 0.030;
/// After its `ACK` an axis is looked at for so many samples: 6 s. During the first second it may still creep.
const WATCHED: usize = 200;
const CREEPS: usize = 34;
/// A move that takes longer is lost: 2 min.
const LOST: usize = 4_000;

/// Shares of the torque at standstill.
pub(crate) const LOADS: [f64; 3] = [0.0, 0.15, -0.15];

/// 0 to 12 % of full drive.
pub(crate) fn frictions() -> impl Iterator<Item = f64> {
    (0..=24).map(|step| f64::from(step) * 0.005)
}

/// The rules and gains before: Eq. 14 and nothing else.
pub(crate) fn plain() -> TransverseSettings {
    let mut settings = TransverseSettings::default();
    let controller = &mut settings.controller;
    (controller.k2, controller.k2_standing, controller.breakaway) = (0.5, 0.5, 0.0);
    (controller.dead_band_counts, controller.wait_counts) = (0, 0);
    controller.judged_by = JudgedBy::Time;
    settings
}

/// These settings with so much friction and load.
pub(crate) fn against(settings: &TransverseSettings, friction: f64, load: f64) -> TransverseSettings {
    let mut settings = settings.clone();
    settings.plant.friction = friction;
    settings.plant.load_torque = load;
    settings
}

/// A sub-frame: counts a sample, and counts with a sign.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Move {
    pub(crate) speed: u8,
    pub(crate) way: i64,
}

/// The programs, by name.
pub(crate) fn programs() -> [(&'static str, Vec<Move>); 3] {
    [("demonstration", demonstration()), ("short moves", short()), ("long moves", long())]
}

/// What the feed axis does in the demonstration.
fn demonstration() -> Vec<Move> {
    let text = include_str!("../../../harness/builtin/shaft.frames");
    let frames = text.lines().filter(|line| !line.starts_with('#') && !line.is_empty());
    let moves = frames.map(|line| {
        let mut bytes = line.split_whitespace().skip(1).map(|byte| u8::from_str_radix(byte, 16).unwrap());
        let [speed, high, low, direction] = [(); 4].map(|()| bytes.next().unwrap());
        let way = i64::from(u16::from_be_bytes([high, low]));
        Move { speed, way: if direction == 0 { way } else { -way } }
    });
    moves.filter(|step| step.way != 0).collect()
}

/// 1 to 50 counts, with reversals, at several speeds.
fn short() -> Vec<Move> {
    let ways = [1, -1, 2, 3, -5, 50, -50, 7, -7, 20, 20, -2, 13, -40, 4, -30, 50, -1, 1, -2, 35, -3, 10, -50];
    let speeds = [1, 5, 20, 60, 112, 225];
    speeds.iter().flat_map(|speed| ways.map(|way| Move { speed: *speed, way })).collect()
}

/// As fast as the motor goes without a load, both ways.
fn long() -> Vec<Move> {
    [9_000, -9_000, 18_000, -30_000, 12_000, 2_000, -2_000].map(|way| Move { speed: 225, way }).to_vec()
}

/// What became of a program.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Verdict {
    /// `CAN`: false, as nothing is blocked. The program ends with it.
    pub(crate) stalls: usize,
    /// Moves that never ended.
    pub(crate) lost: usize,
    /// Moves that were more than a count off at their `ACK`.
    pub(crate) off: usize,
    /// Moves that were more than a count off for a while in the second after.
    pub(crate) restless: usize,
    /// Moves that were more than a count off after that.
    pub(crate) hunts: usize,
    /// The most counts made after that by an axis that arrived.
    pub(crate) creeps: usize,
    /// From the sub-frame to the reply, together.
    pub(crate) seconds: f64,
    /// How far an axis went beyond its target at most.
    pub(crate) overshoot: i64,
    /// How far one was behind its set point at most.
    pub(crate) lag: i64,
}

impl Verdict {
    /// No false stall, no hunting, every arrival within a count.
    pub(crate) fn is_good(&self) -> bool {
        self.stalls + self.lost + self.off + self.hunts == 0
    }
}

/// A board with its quantities as they are: position, set point, drive, offset.
#[derive(Clone)]
pub(crate) struct Feed {
    pub(crate) bench: Bench<Transverse>,
    values: [i64; 4],
}

impl Feed {
    pub(crate) fn new(settings: &TransverseSettings) -> Self {
        Self { bench: Bench::new(Transverse::new(settings, Clock::TRUE)), values: [0; 4] }
    }

    pub(crate) fn start(&mut self, step: Move) {
        let [high, low] = u16::try_from(step.way.abs()).unwrap().to_be_bytes();
        self.bench.send(&[step.speed, high, low, u8::from(step.way < 0)]);
    }

    /// One sample.
    pub(crate) fn sample(&mut self) -> [i64; 4] {
        self.bench.run_ms(SAMPLE_MS);
        for (_, output) in self.bench.outputs.drain(..) {
            if let Output::Telemetry { signal, value } = output {
                self.values[usize::from(signal)] = value;
            }
        }
        self.values
    }

    /// `ACK` or `CAN`, once it has come whole.
    pub(crate) fn reply(&mut self) -> Option<u8> {
        if !self.bench.sent.is_empty() {
            self.bench.run_ms(3);
        }
        self.bench.replies().first().copied()
    }

    /// Until there is a reply.
    pub(crate) fn replies_within(&mut self, samples: usize) -> Option<u8> {
        (0..samples).find_map(|_| {
            self.sample();
            self.reply()
        })
    }
}

/// Plays a program.
pub(crate) fn play(settings: &TransverseSettings, moves: &[Move]) -> Verdict {
    let mut feed = Feed::new(settings);
    let mut verdict = Verdict::default();
    let mut target = 0;
    for step in moves {
        target += step.way;
        feed.start(*step);
        let reply = (0..LOST).find_map(|_| {
            let [position, set_point, ..] = feed.sample();
            verdict.seconds += SAMPLE_S;
            verdict.lag = verdict.lag.max((set_point - position).abs());
            verdict.overshoot = verdict.overshoot.max((position - target) * step.way.signum());
            feed.reply()
        });
        if reply != Some(ACK) {
            verdict.stalls += usize::from(reply.is_some());
            verdict.lost += usize::from(reply.is_none());
            return verdict;
        }
        verdict.off += usize::from((feed.values[0] - target).abs() > 1);
        let positions: Vec<i64> = (0..WATCHED).map(|_| feed.sample()[0]).collect();
        let (first, then) = positions.split_at(CREEPS);
        let leaves = |positions: &[i64]| usize::from(positions.iter().any(|at| (at - target).abs() > 1));
        verdict.restless += leaves(first);
        verdict.hunts += leaves(then);
        verdict.creeps = verdict.creeps.max(then.windows(2).filter(|pair| pair[0] != pair[1]).count());
    }
    verdict
}

/// After how many seconds a shaft is told of that is blocked at any sample of several moves, for several frictions and
/// loads, at most. One that is within a count of its target may be done; one not told of within 10 s counts as these.
pub(crate) fn told_within(settings: &TransverseSettings) -> f64 {
    let moves = [(225, 9_000), (112, -4_500), (20, 600), (1, 20), (225, -50), (60, 3)];
    let cells = LOADS.into_iter().flat_map(|load| [0.0, 0.03, 0.12].map(|friction| against(settings, friction, load)));
    let told = cells.flat_map(|settings| moves.map(|(speed, way)| told_of(&settings, Move { speed, way })));
    told.map(|told| told.unwrap_or(10.0)).fold(0.0, f64::max)
}

fn told_of(settings: &TransverseSettings, step: Move) -> Option<f64> {
    let mut feed = Feed::new(settings);
    feed.start(step);
    let mut longest: f64 = 0.0;
    while feed.clone().reply().is_none() {
        let mut blocked = feed.clone();
        blocked.bench.stimulus(MotorStimulus::Stall(true).of(0));
        let from = blocked.bench.now;
        if blocked.replies_within(333)? == CAN {
            longest = longest.max(blocked.bench.now.since(from).as_secs_f64());
        }
        feed.sample();
    }
    Some(longest)
}
