//! A controller on the rig: the board itself runs it, and its telemetry is what was seen.

use serde::Serialize;
use torno_identify::{FirstOrder, response};
use torno_protocol::board::{Description, Role, Stimulus};
use torno_protocol::time::{Instant, Span};

use super::error::TuneError;
use super::forecast::{Controller, Indices};
use crate::identify::bench::Subject;
use crate::rig::Driver;
use crate::rig::file::RigFile;
use crate::session::{Session, SessionError};
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
    #[serde(skip)]
    pub(super) path: Vec<(f64, f64)>,
    #[serde(skip)]
    pub(super) wanted: Vec<(f64, f64)>,
    #[serde(skip)]
    pub(super) drive: Vec<(f64, f64)>,
}

/// The rig with other settings of one board.
pub(super) fn with_settings(
    file: &RigFile,
    subject: &Subject,
    form: Option<&(String, &'static str)>,
    settings: &[(String, f64)],
) -> Result<RigFile, TuneError> {
    let values = settings.iter().map(|(place, value)| (place, value.to_string()));
    let form = form.map(|(place, form)| (place, (*form).to_owned()));
    form.into_iter().chain(values).try_fold(file.clone(), |file, (place, value)| {
        let set = file.with(place, &value);
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

/// Lets the PC send a frame, and watches the motor.
pub(super) async fn watch(file: &RigFile, subject: &Subject, seconds: u64) -> Result<Seen, SessionError> {
    let mut session = Session::start(file, &Driver::InProcess, file.pc.uart()).await?.quiet();
    let frame =
        if subject.is_axis() { [&[0], &MOVE[..], &[0, 0, 0]].concat() } else { [&[SPEED][..], &[0; 7]].concat() };
    let node = session.rig().pc();
    session.stimulate(node, Instant::START + SENT.max(file.margin()), Stimulus::Write(frame));
    let mut history = Vec::new();
    let end = Instant::START + Span::from_secs(seconds);
    session
        .settle(end, |happened| {
            for fact in happened.facts {
                if let Fact::Telemetry { node, at, signal, value } = fact
                    && node == subject.node
                {
                    history.push((at, signal, value as f64));
                }
            }
        })
        .await?;
    history.sort_by_key(|(at, ..)| *at);
    Ok(Seen::of(subject, &session.rig().nodes()[subject.node].description, &history, seconds))
}

impl Seen {
    /// Of a board's telemetry, which tells changes only.
    pub(super) fn of(subject: &Subject, board: &Description, history: &[(Instant, u8, f64)], seconds: u64) -> Self {
        let period = f64::from(subject.motor.period_ms) / 1_000.0;
        // As it is at each sample.
        let sampled = |role: Role, unit: Option<&str>| -> Vec<(f64, f64)> {
            let place = subject.signal(board, role, unit);
            let mut changes = history.iter().filter(|(_, signal, _)| Some(*signal) == place).peekable();
            let mut value = 0.0;
            let count = (seconds as f64 / period) as u32;
            let sample = |n: u32| {
                let t = period * f64::from(n);
                while let Some((_, _, next)) = changes.next_if(|(at, ..)| at.as_secs_f64() <= t + 0.5 * period) {
                    value = *next;
                }
                (t, value)
            };
            (0..count).map(sample).collect()
        };
        let drive = sampled(Role::Drive, None);
        if subject.is_axis() {
            let (path, wanted) = (sampled(Role::Position, None), sampled(Role::SetPoint, None));
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
                path,
                wanted,
                drive,
                ..Self::default()
            };
        }
        let rpm = subject.motor.count * 60.0 / core::f64::consts::TAU / period;
        let counted: Vec<(f64, f64)> =
            sampled(Role::Speed, Some("counts")).into_iter().map(|(t, counts)| (t, rpm * counts)).collect();
        let wanted = sampled(Role::SetPoint, None);
        // Time counts from the sample at which the frame has arrived.
        let begin = wanted.iter().position(|(_, rpm)| *rpm > 0.0).unwrap_or(0);
        let shift =
            |points: &[(f64, f64)]| points[begin..].iter().map(|(t, y)| (t - points[begin].0, *y)).collect::<Vec<_>>();
        let path = smooth(&shift(&counted));
        let step = response::of_step(&path, 0.0, f64::from(SPEED) * 20.0).map(Indices::from);
        Self { step, path, wanted: shift(&wanted), drive: shift(&drive), ..Self::default() }
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
