//! A controller on the rig: the board itself runs it, and its telemetry is what was seen.

use std::fmt;

use serde::Serialize;
use torno_identify::{FirstOrder, response};
use torno_protocol::board::{Description, Role, Stimulus};
use torno_protocol::time::{Instant, Span};

use super::error::TuneError;
use super::forecast::{Controller, Indices};
use crate::identify::bench::Subject;
use crate::rig::Driver;
use crate::rig::file::RigFile;
use crate::session::{Exchange, Session, SessionError};
use torno_engine::Fact;

/// The speed that the main motor is sent to, in the frame's unit of 20 rpm: 2000 rpm. (Ours.)
pub(super) const SPEED: u8 = 100;
/// The feed's move: 9000 counts at 112 counts a sample, ten revolutions. (Ours.)
const MOVE: [u8; 4] = [112, 0x23, 0x28, 0];
/// How far that is.
pub(super) const DISTANCE: f64 = 9_000.0;
/// The rig is watched for so long, in s, at least and at most; and in time constants of the motor.
const WATCHED: u64 = 20;
const LONGEST: u64 = 600;
const TAUS: f64 = 6.0;
/// Counted speeds are averaged over so many windows, foretold and seen alike: one count is a large part of 2 %. (Ours.)
const MEAN_OF: usize = 8;
/// The frame is sent at this time.
const SENT: Span = Span::from_millis(10);
/// Where a board's settings have the form of its law.
pub(super) const FORM: &str = "controller.form";
/// Where a board's settings say how the set point of an axis goes to its target.
const SET_POINT: &str = "controller.set_point";
/// A small step takes this share of full drive at first, and has so many counts at most. (Ours.)
const STEP_SHARE: f64 = 0.8;
const STEP_MOST: f64 = 2_000.0;
/// With an integral: what lies within its zone. (Ours: the board's default.)
const STEP_INTEGRATED: f64 = 50.0;
/// An axis that is done and still moves by more counts within so many samples hunts. (Ours.)
const HUNTS: f64 = 2.0;
const LAST_OF: usize = 100;

/// What was seen on the rig.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Seen {
    /// For a speed: how it rose.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step: Option<Indices>,
    /// For an axis: the largest distance from its moving set point, in counts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub following_error_counts: Option<f64>,
    /// For an axis: how far it went beyond its target, in counts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub overshoot_counts: Option<f64>,
    /// For an axis: from the end of its set point's way until it stays within a count, in s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub in_position_s: Option<f64>,
    /// For an axis: what is left of the way in the end, in counts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steady_error_counts: Option<f64>,
    /// For an axis: what became of the move.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// For an axis: a small step of its set point.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub small_step: Option<SmallStep>,
    #[serde(skip)]
    pub(super) path: Vec<(f64, f64)>,
    #[serde(skip)]
    pub(super) wanted: Vec<(f64, f64)>,
    #[serde(skip)]
    pub(super) drive: Vec<(f64, f64)>,
}

/// A small step of an axis's set point, on the rig.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SmallStep {
    /// How far.
    pub counts: u16,
    /// Settled within 2 % or a count.
    pub response: Option<Indices>,
    /// Shares of the step.
    #[serde(skip)]
    pub(super) points: Vec<(f64, f64)>,
}

/// The rig with other settings of one board.
pub(super) fn with_settings(
    file: &RigFile,
    subject: &Subject,
    form: Option<&(String, &'static str)>,
    settings: &[(String, f64)],
) -> Result<RigFile, TuneError> {
    let values = settings.iter().map(|(place, value)| (place.clone(), value.to_string()));
    with(file, subject, form.map(|(place, form)| (place.clone(), (*form).to_owned())).into_iter().chain(values))
}

/// The same, of settings in words.
pub(super) fn with(
    file: &RigFile,
    subject: &Subject,
    settings: impl IntoIterator<Item = (String, String)>,
) -> Result<RigFile, TuneError> {
    settings.into_iter().try_fold(file.clone(), |file, (place, value)| {
        let set = file.with(&place, &value);
        set.map_err(|message| TuneError::Settings { board: subject.board.clone(), message })
    })
}

/// The form of a law that works.
pub(super) const fn working_form(controller: &Controller) -> &'static str {
    match controller {
        Controller::Lead(_) => "incremental",
        Controller::Pid(_) => "pid",
    }
}

/// How long the rig is watched, in s: until a slow motor has got there, too.
pub(super) fn watched(model: &FirstOrder) -> u64 {
    ((TAUS * model.tau).ceil() as u64).clamp(WATCHED, LONGEST)
}

/// Lets the PC send the usual frame, and watches the motor.
pub(super) async fn watch(file: &RigFile, subject: &Subject, seconds: u64) -> Result<Seen, SessionError> {
    let frame =
        if subject.is_axis() { [&[0], &MOVE[..], &[0, 0, 0]].concat() } else { [&[SPEED][..], &[0; 7]].concat() };
    Ok(Seen::of(subject, &History::of(file, subject, frame, seconds).await?))
}

/// Lets the set point of an axis jump by as many counts as leave the drive off its limits, and watches it: the board
/// itself, with all its rules.
pub(super) async fn small_step(
    file: &RigFile,
    subject: &Subject,
    controller: &Controller,
    seconds: u64,
) -> Result<Option<SmallStep>, TuneError> {
    let Controller::Pid(controller) = controller else { return Ok(None) };
    let file = with(file, subject, [(subject.setting(SET_POINT), "step".to_owned())])?;
    let period = f64::from(subject.motor.period_ms) / 1_000.0;
    let first = controller.k1 + controller.k2 * period + controller.k3 / period;
    let most = if controller.k2 == 0.0 { STEP_MOST } else { STEP_INTEGRATED };
    let counts = (STEP_SHARE * subject.motor.full.0 / first).clamp(1.0, most) as u16;
    let [high, low] = counts.to_be_bytes();
    let history = History::of(&file, subject, vec![0, 1, high, low, 0, 0, 0, 0], seconds).await?;
    let (path, wanted) = (history.of_role(subject, Role::Position), history.of_role(subject, Role::SetPoint));
    let path = from_the_step(&wanted, &path);
    let to = f64::from(counts);
    let response = response::of_step_within(&path, [0.0, to], (1.0 / to).max(0.02)).map(Indices::from);
    let points = path.into_iter().map(|(t, y)| (t, y / to)).collect();
    Ok(Some(SmallStep { counts, response, points }))
}

/// From the sample on at which the set point has moved, and time from there.
fn from_the_step(wanted: &[(f64, f64)], points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let begin = wanted.iter().position(|(_, wanted)| *wanted > 0.0).unwrap_or(0);
    points[begin..].iter().map(|(t, y)| (t - points[begin].0, *y)).collect()
}

/// A board's telemetry while a frame was executed, and what the PC was told.
struct History {
    description: Description,
    changes: Vec<(Instant, u8, f64)>,
    replies: Vec<String>,
    /// The time between samples, how late one may be, both in s, and how many there were.
    period: f64,
    jitter: f64,
    samples: u32,
}

impl History {
    async fn of(file: &RigFile, subject: &Subject, frame: Vec<u8>, seconds: u64) -> Result<Self, SessionError> {
        let mut session = Session::start(file, &Driver::InProcess, file.pc.uart()).await?.quiet();
        let node = session.rig().pc();
        session.stimulate(node, Instant::START + SENT.max(file.margin()), Stimulus::Write(frame));
        let (mut changes, mut replies) = (Vec::new(), Vec::new());
        let end = Instant::START + Span::from_secs(seconds);
        session
            .settle(end, |happened| {
                for (_, exchange) in happened.pc() {
                    if let Exchange::Received(_, said) = exchange {
                        replies.extend(said.iter().map(|reply| reply.code.clone()));
                    }
                }
                for fact in happened.facts {
                    if let Fact::Telemetry { node, at, signal, value } = fact
                        && node == subject.node
                    {
                        changes.push((at, signal, value as f64));
                    }
                }
            })
            .await?;
        changes.sort_by_key(|(at, ..)| *at);
        let period = f64::from(subject.motor.period_ms) / 1_000.0;
        let description = session.rig().nodes()[subject.node].description.clone();
        Ok(Self {
            description,
            changes,
            replies,
            period,
            jitter: f64::from(subject.motor.jitter_us) / 1e6,
            samples: (seconds as f64 / period) as u32,
        })
    }

    /// A quantity as it is at each sample: telemetry tells changes only.
    fn of_role(&self, subject: &Subject, role: Role) -> Vec<(f64, f64)> {
        self.of_unit(subject, role, None)
    }

    fn of_unit(&self, subject: &Subject, role: Role, unit: Option<&str>) -> Vec<(f64, f64)> {
        let place = subject.signal(&self.description, role, unit);
        let mut changes = self.changes.iter().filter(|(_, signal, _)| Some(*signal) == place).peekable();
        let mut value = 0.0;
        // Later than this sample, and before the next one.
        let between = 0.5 * (self.period + self.jitter);
        let sample = |n: u32| {
            let t = self.period * f64::from(n);
            while let Some((_, _, next)) = changes.next_if(|(at, ..)| at.as_secs_f64() <= t + between) {
                value = *next;
            }
            (t, value)
        };
        (0..self.samples).map(sample).collect()
    }
}

impl Seen {
    fn of(subject: &Subject, history: &History) -> Self {
        let drive = history.of_role(subject, Role::Drive);
        if subject.is_axis() {
            let (path, wanted) = (history.of_role(subject, Role::Position), history.of_role(subject, Role::SetPoint));
            let lag = path.iter().zip(&wanted).map(|((_, y), (_, r))| (r - y).abs()).fold(0.0, f64::max);
            let peak = path.iter().map(|(_, y)| *y).fold(0.0, f64::max);
            let end = wanted.iter().position(|(_, r)| *r == DISTANCE).map(|place| wanted[place].0);
            let out = path.iter().rposition(|(_, y)| (y - DISTANCE).abs() > 1.0);
            let there = out.and_then(|place| path.get(place + 1)).map(|(t, _)| *t);
            let in_position_s = end.zip(there).map(|(end, there)| (there - end).max(0.0));
            return Self {
                following_error_counts: Some(lag),
                overshoot_counts: Some((peak - DISTANCE).max(0.0)),
                in_position_s,
                steady_error_counts: path.last().map(|(_, y)| DISTANCE - y),
                verdict: Some(Verdict::of(&path, &history.replies)),
                path,
                wanted,
                drive,
                ..Self::default()
            };
        }
        let rpm = subject.motor.count * 60.0 / core::f64::consts::TAU / history.period;
        let counted = history.of_unit(subject, Role::Speed, Some("counts"));
        let counted: Vec<(f64, f64)> = counted.into_iter().map(|(t, counts)| (t, rpm * counts)).collect();
        let wanted = history.of_role(subject, Role::SetPoint);
        // Time counts from the sample at which the frame has arrived.
        let path = smooth(&from_the_step(&wanted, &counted));
        let step = response::of_step(&path, 0.0, f64::from(SPEED) * 20.0).map(Indices::from);
        let (drive, wanted) = (from_the_step(&wanted, &drive), from_the_step(&wanted, &wanted));
        Self { step, path, wanted, drive, ..Self::default() }
    }
}

/// What has become of a move.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The board has said that it is done, and the axis has stayed where it was.
    Done,
    /// The board has said that it is done, and the axis moves to and fro.
    Hunts,
    /// The board has not said that it is done.
    Busy,
    /// What the PC was told.
    Failed(String),
}

impl Verdict {
    fn of(path: &[(f64, f64)], replies: &[String]) -> Self {
        if let Some(told) = replies.iter().find(|reply| reply.starts_with("CAN")) {
            return Self::Failed(told.clone());
        }
        if !replies.iter().any(|reply| reply == "XON") {
            return Self::Busy;
        }
        let last = &path[path.len() - path.len().min(LAST_OF)..];
        let (low, high) = last.iter().fold((f64::MAX, f64::MIN), |(low, high), (_, y)| (low.min(*y), high.max(*y)));
        if high - low > HUNTS { Self::Hunts } else { Self::Done }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Done => "done",
            Self::Hunts => "hunts",
            Self::Busy => "busy",
            Self::Failed(told) => told,
        })
    }
}

/// The mean of each point and those before it.
pub(super) fn smooth(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mean = |n: usize| {
        let last = &points[n.saturating_sub(MEAN_OF - 1)..=n];
        (points[n].0, last.iter().map(|(_, y)| y).sum::<f64>() / MEAN_OF as f64)
    };
    (0..points.len()).map(mean).collect()
}
