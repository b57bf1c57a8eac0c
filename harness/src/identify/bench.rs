//! The bench: a board's motor is driven in its service mode, and its encoder listened to.

use torno_identify::{Data, Finding, Sample, Sensor, prbs};
use torno_protocol::board::{Description, MotorStimulus, Role};
use torno_protocol::clock::{Clock, Rate, Ticks};
use torno_protocol::time::{Instant, Span};

use super::dac::{Dac, Instrument};
use crate::rig::Driver;
use crate::rig::file::RigFile;
use crate::session::{Session, SessionError};
use torno_engine::NodeId;
use torno_machines::kinds;
use torno_machines::kinds::KindError;
use torno_machines::motor::{Encoder, Law, Motor};
use torno_text::nearest;

/// A step that no one sized is two thirds of full drive: 20 V of the main motor's 30. (Ours.)
const STEP: f64 = 2.0 / 3.0;
/// A sequence's, if the motor can be driven both ways: 240 of 255 LSB. (Ours.)
const SEQUENCE: f64 = 240.0 / 255.0;
/// How long a sequence holds each value, in s. (Ours: near the motors' time constants.)
const HOLD: f64 = 0.6;
/// The step of a loop's set point, in counts: the largest at which its drive stays off its limits. (Ours.)
pub const LOOP_STEP: i64 = 2_700;
/// The loop's gain, in LSB a count: Km/K0, for which the closed loop is the paper's Eq. 11.
pub const LOOP_GAIN: f64 = 0.090_582;
/// How far from mid-travel an axis may go, as a share of its travel either way. (Ours.)
const ROOM: f64 = 0.5;
/// The rig is left alone for so many samples before.
const BEFORE: u64 = 1;

/// What a motor is driven with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Excitation {
    /// A step: of the drive (Eq. 2), or, if the motor moves an axis, of the set point of a proportional loop (Fig. 9).
    Step,
    /// A pseudo-random binary sequence.
    Prbs,
}

impl Excitation {
    /// How long it takes if no one says: enough for the paper's method, and for a percent.
    pub const fn seconds(self, axis: bool) -> f64 {
        match self {
            Self::Step if axis => 10.0,
            Self::Step => 20.0,
            Self::Prbs => 60.0,
        }
    }
}

/// What is to be done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// What the motor is driven with.
    pub excitation: Excitation,
    /// For how long, in s.
    pub seconds: f64,
    /// The largest drive, in the motor's unit; None for a good one.
    pub level: Option<f64>,
    /// Of the sequence.
    pub seed: u64,
    /// What tells the motor's speed.
    pub instrument: Instrument,
}

/// What came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Drive and speed.
    pub data: Data,
    /// If it was a step of a loop's set point: how many counts, times since it, and positions in counts.
    pub closed: Option<(i64, Vec<(f64, f64)>)>,
    /// What it was, in words: `20 V for 20 s`.
    pub what: String,
}

/// An experiment whose data are of no use.
#[derive(Clone, Debug, PartialEq)]
pub struct Useless {
    /// What was done.
    pub what: String,
    /// Why.
    pub finding: Finding,
}

/// A motor on the bench.
#[derive(Clone, Debug, PartialEq)]
pub struct Subject {
    /// The board's place in the rig.
    pub node: NodeId,
    /// The board's name, with a dot and the motor's if it has several.
    pub board: String,
    /// The motor.
    pub motor: Motor,
    /// Its place among the board's motors.
    place: u8,
    clock: Clock,
}

/// Why there is nothing to identify.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// There is no such board.
    #[error("there is no board '{board}' in the rig '{rig}'{hint}")]
    NoBoard {
        /// The rig.
        rig: String,
        /// The board.
        board: String,
        /// What could be meant.
        hint: String,
    },
    /// The board drives nothing.
    #[error("board '{board}' {why}")]
    NoMotor {
        /// The board.
        board: String,
        /// What it lacks, and which boards do not.
        why: String,
    },
    /// The board drives several motors.
    #[error("board '{board}' has several motors: expected one of {known}")]
    SeveralMotors {
        /// The board.
        board: String,
        /// Their names, as they are given.
        known: String,
    },
    /// The board has no motor of that name.
    #[error("there is no motor '{motor}' on board '{board}'{hint}")]
    NoSuchMotor {
        /// The motor.
        motor: String,
        /// The board.
        board: String,
        /// What could be meant.
        hint: String,
    },
    /// A level that the drive cannot have.
    #[error("level {found}: expected above 0 and up to {full} {unit}, which is full drive")]
    Level {
        /// What was asked for.
        found: f64,
        /// Full drive.
        full: f64,
        /// Its unit.
        unit: &'static str,
    },
    /// Nothing that the converter could count.
    #[error(
        "--instrument: board '{board}' has no converter of frequency to voltage: expected the main motor, whose speed \
         is counted, or no --instrument"
    )]
    NoConverter {
        /// The board.
        board: String,
    },
    /// A time that is none.
    #[error("{found} s is no such time: expected 1 s to 3600 s")]
    Seconds {
        /// What was asked for.
        found: f64,
    },
    /// The board's settings are wrong.
    #[error(transparent)]
    Kind(#[from] KindError),
    /// The rig broke.
    #[error(transparent)]
    Session(#[from] SessionError),
}

impl Subject {
    /// The motor of a board.
    ///
    /// # Errors
    /// [`BenchError`] if there is no such board, or no motor on it.
    pub fn find(file: &RigFile, subject: &str) -> Result<Self, BenchError> {
        let (board, which) = subject.split_once('.').map_or((subject, None), |(board, motor)| (board, Some(motor)));
        let names: Vec<&str> = file.boards.iter().map(|board| board.name.as_str()).collect();
        let Some(node) = names.iter().position(|name| *name == board) else {
            let (rig, hint) = (file.name.clone(), nearest(board, &names));
            return Err(BenchError::NoBoard { rig, board: board.to_owned(), hint });
        };
        let found = &file.boards[node];
        let description = &found.description;
        let several: Vec<&str> =
            (0..description.motors.len() as u8).filter_map(|motor| description.motor_name(motor)).collect();
        let place = match which {
            None if !several.is_empty() => {
                let known: Vec<String> = several.iter().map(|motor| format!("{board}.{motor}")).collect();
                return Err(BenchError::SeveralMotors { board: board.to_owned(), known: known.join(", ") });
            }
            None => 0,
            Some(which) => match several.iter().position(|motor| *motor == which) {
                Some(place) => place as u8,
                None => {
                    let (motor, hint) = (which.to_owned(), nearest(which, &several));
                    return Err(BenchError::NoSuchMotor { motor, board: board.to_owned(), hint });
                }
            },
        };
        let motor = kinds::motor(&found.kind, &found.settings, place)?.map_err(|lacks| {
            let has_motor = |other: &&crate::rig::file::Board| {
                other.description.motors.len() == 1
                    && kinds::motor(&other.kind, &other.settings, 0).is_ok_and(|motor| motor.is_ok())
            };
            let known: Vec<&str> = file.boards.iter().filter(has_motor).map(|board| board.name.as_str()).collect();
            let expected = if known.is_empty() {
                "no board of this rig has one that can be driven freely".to_owned()
            } else {
                format!("expected one of {}", known.join(", "))
            };
            BenchError::NoMotor { board: board.to_owned(), why: format!("{lacks}: {expected}") }
        })?;
        Ok(Self { node, board: subject.to_owned(), motor, place, clock: found.clock })
    }

    /// Where the rig has a setting of this motor that its law calls so.
    pub fn setting(&self, name: &str) -> String {
        format!("{}.{name}", self.board)
    }

    /// Its place among the board's motors.
    pub const fn place(&self) -> u8 {
        self.place
    }

    /// The place of a quantity of this motor among those of its board.
    pub fn signal(&self, board: &Description, role: Role, unit: Option<&str>) -> Option<u8> {
        board.signal(self.place, role, unit)
    }

    /// Whether it moves an axis, whose position its law regulates.
    pub const fn is_axis(&self) -> bool {
        matches!(self.motor.law, Law::Pid(_))
    }

    /// Runs the rig with it.
    ///
    /// # Errors
    /// [`BenchError`] if the plan cannot be followed; within, [`Useless`] if nothing came of it.
    pub async fn run(&self, file: &RigFile, plan: &Plan) -> Result<Result<Recording, Useless>, BenchError> {
        let program = Program::new(self, plan)?;
        let what = program.what.clone();
        let counts = if let Kind::Loop { counts, .. } = program.kind { counts } else { LOOP_STEP };
        let session = Session::start(file, &Driver::InProcess, file.pc.uart()).await?.quiet();
        let dac = self.converter(plan.instrument)?;
        let raw = self.drive(session, program, plan.seconds).await?;
        let data = match self.data(&raw, dac) {
            Ok(data) => data,
            Err(finding) => return Ok(Err(Useless { what, finding })),
        };
        let closed = (plan.excitation == Excitation::Step && self.is_axis()).then(|| {
            let origin = raw[0];
            let point = |point: &Point| (point.time - origin.time, (point.count - origin.count) as f64);
            (counts, raw[1..].iter().map(point).collect())
        });
        Ok(Ok(Recording { data, closed, what }))
    }

    /// The converter at this motor, if the instrument is one.
    ///
    /// # Errors
    /// [`BenchError::NoConverter`] if it has nothing to count.
    pub fn converter(&self, instrument: Instrument) -> Result<Option<Dac>, BenchError> {
        let dac = Dac::new(instrument, &self.motor);
        if dac.is_some() && self.motor.encoder != Encoder::Window {
            return Err(BenchError::NoConverter { board: self.board.clone() });
        }
        Ok(dac)
    }

    async fn drive(&self, mut session: Session, mut program: Program, seconds: f64) -> Result<Vec<Point>, BenchError> {
        let rate = Rate::fraction(1_000, u64::from(self.motor.period_ms));
        let ticks = Ticks::new(Instant::START, rate, self.clock);
        let board = &session.rig().nodes()[self.node].description;
        let counted = match self.motor.encoder {
            Encoder::Window => self.signal(board, Role::Speed, Some("counts")),
            Encoder::Position => self.signal(board, Role::Position, None),
        };
        let [counted, driven] = [counted, self.signal(board, Role::Drive, None)].map(|place| place.unwrap_or(u8::MAX));
        let count = (seconds * 1_000.0 / f64::from(self.motor.period_ms)).round() as u64;
        let mut points: Vec<Point> = Vec::new();
        for n in BEFORE..=BEFORE + count {
            // What the board does at the tick itself, however late, and then what it is told.
            let after = (ticks.at(n) + Span::from_micros(u64::from(self.motor.jitter_us))).next();
            session.settle(after, |_| ()).await?;
            let [count, drive] = [counted, driven].map(|signal| session.telemetry().value(self.node, signal));
            if let Some(last) = points.last_mut() {
                last.drive = drive;
            }
            let time = ticks.at(n).as_secs_f64();
            points.push(Point { time, count, drive: 0 });
            let per_mille = program.next(points.len() - 1, count);
            session.stimulate(self.node, after, MotorStimulus::Drive(per_mille).of(self.place));
        }
        Ok(points)
    }

    /// Points as intervals: each with the drive that was set at its beginning.
    fn data(&self, points: &[Point], dac: Option<Dac>) -> Result<Data, Finding> {
        let motor = &self.motor;
        let sample = |pair: &[Point]| {
            let counts = match motor.encoder {
                Encoder::Window => pair[1].count,
                Encoder::Position => pair[1].count - pair[0].count,
            };
            let counts = dac.map_or(counts as f64, |dac| dac.counts(counts));
            let speed = counts * motor.count / (pair[1].time - pair[0].time);
            Sample { time: pair[1].time, input: pair[0].drive as f64 * motor.full.0 / motor.full.1 as f64, speed }
        };
        let samples: Vec<Sample> = points.windows(2).map(sample).collect();
        let start = points.first().map_or(0.0, |first| first.time);
        let counts = dac.map_or(1.0, |dac| dac.resolution());
        let quantum = counts * motor.count * 1_000.0 / f64::from(motor.period_ms);
        Data::new(Sensor::Mean, start, samples, quantum).map(Data::from_rest)
    }
}

/// What was counted at a tick, and the drive from there on.
#[derive(Clone, Copy, Debug)]
struct Point {
    time: f64,
    count: i64,
    drive: i64,
}

/// What the bench tells the board, tick by tick.
struct Program {
    motor: Motor,
    kind: Kind,
    what: String,
}

enum Kind {
    Hold(i32),
    Loop { counts: i64, origin: Option<i64> },
    Sequence { bits: Vec<bool>, levels: [i32; 2], hold: usize, origin: Option<i64> },
}

impl Program {
    fn new(subject: &Subject, plan: &Plan) -> Result<Self, BenchError> {
        let motor = subject.motor;
        let (full, unit) = (motor.full.0, motor.input_unit);
        let Plan { excitation, seconds, level, seed, .. } = *plan;
        if !(1.0..=3_600.0).contains(&seconds) {
            return Err(BenchError::Seconds { found: seconds });
        }
        let good = match (excitation, motor.travel) {
            _ if motor.law == Law::OnOff => full,
            (Excitation::Prbs, Some(_)) => SEQUENCE * full,
            _ => STEP * full,
        };
        let asked = level;
        let level = level.unwrap_or(good);
        if !(level > 0.0 && level <= full) {
            return Err(BenchError::Level { found: level, full, unit });
        }
        let per_mille = |level: f64| (1_000.0 * level / full).round() as i32;
        let (kind, what) = match (excitation, motor.travel) {
            (Excitation::Step, _) if subject.is_axis() => {
                // The drive is largest at the step itself.
                let counts = asked.map_or(LOOP_STEP, |level| (level / LOOP_GAIN).round() as i64);
                let what = format!("step of {counts} counts in a loop of {LOOP_GAIN} LSB/count for {seconds} s");
                (Kind::Loop { counts, origin: None }, what)
            }
            (Excitation::Step, _) => {
                (Kind::Hold(per_mille(level)), format!("step of {} {unit} for {seconds} s", short(level)))
            }
            (Excitation::Prbs, travel) => {
                let low = if travel.is_some() { -level } else { 0.5 * level };
                let hold = (HOLD * 1_000.0 / f64::from(motor.period_ms)).round().max(1.0) as usize;
                let count = (seconds / HOLD).ceil() as usize + 2;
                let levels = [per_mille(low), per_mille(level)];
                let kind = Kind::Sequence { bits: prbs::bits(seed, count), levels, hold, origin: None };
                (kind, format!("PRBS of {} and {} {unit} for {seconds} s", short(low), short(level)))
            }
        };
        Ok(Self { motor, kind, what })
    }

    /// The drive from sample `n` on, in per mille of full, with the encoder at `count`.
    fn next(&mut self, n: usize, count: i64) -> i32 {
        let full = self.motor.full.1 as f64;
        match &mut self.kind {
            Kind::Hold(per_mille) => *per_mille,
            Kind::Loop { counts, origin } => {
                let error = *counts - (count - *origin.get_or_insert(count));
                (1_000.0 * (LOOP_GAIN * error as f64).round() / full).round() as i32
            }
            Kind::Sequence { bits, levels, hold, origin } => {
                let gone = count - *origin.get_or_insert(count);
                let place = (n / *hold).min(bits.len() - 1);
                let room = self.motor.travel.map_or(f64::MAX, |travel| ROOM * f64::from(travel));
                // An axis that would go too far goes back instead.
                if n.is_multiple_of(*hold) && gone as f64 > room {
                    bits[place] = false;
                } else if n.is_multiple_of(*hold) && (gone as f64) < -room {
                    bits[place] = true;
                }
                levels[usize::from(bits[place])]
            }
        }
    }
}

/// Without digits that say nothing.
fn short(number: f64) -> String {
    let text = format!("{number:.2}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
