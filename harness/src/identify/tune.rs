//! From a motor that is known to a controller for it: proposed, foretold, and shown on the rig.

use std::fmt::{self, Write as _};

use anstyle::{AnsiColor, Style};
use serde::Serialize;
use torno_identify::design::{Lead, Pid};
use torno_identify::discrete::Discrete;
use torno_identify::{Finding, FirstOrder, response};
use torno_protocol::board::Stimulus;
use torno_protocol::time::{Instant, Span};

use super::bench::Subject;
use super::report::{Identification, digits, short};
use crate::engine::Fact;
use crate::pc::PcUart;
use crate::report::plot::{Figure, Panel, Series, Style as Drawn};
use crate::rig::file::RigFile;
use crate::rig::kinds::motor::Law;
use crate::rig::{Driver, Rig, RigError};

/// Samples of a step response that is looked at, at least; and in time constants of the motor.
const SAMPLES: (usize, f64) = (400, 12.0);
/// The speed that the main motor is sent to, in the frame's unit of 20 rpm: 2000 rpm. (Ours.)
const SPEED: u8 = 100;
/// The feed's move: 9000 counts at 112 counts a sample, ten revolutions. (Ours.)
const MOVE: [u8; 4] = [112, 0x23, 0x28, 0];
/// How far that is.
const DISTANCE: f64 = 9_000.0;
/// The rig is watched for so long, in s.
const WATCHED: u64 = 20;
/// Counted speeds are averaged over so many windows, foretold and seen alike: one count is a large part of 2 %. (Ours.)
const MEAN_OF: usize = 8;
/// The frame is sent at this time.
const SENT: Span = Span::from_millis(10);

/// A controller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Controller {
    /// For speed.
    Lead(Lead),
    /// For position.
    Pid(Pid),
}

impl Controller {
    /// The controller that a law's values make.
    pub const fn of(law: &Law) -> Option<Self> {
        match law {
            Law::Lead([(_, alpha), (_, beta), (_, k)]) => Some(Self::Lead(Lead { alpha: *alpha, beta: *beta, k: *k })),
            Law::Pid([(_, k1), (_, k2), (_, k3)]) => Some(Self::Pid(Pid { k1: *k1, k2: *k2, k3: *k3 })),
            Law::OnOff => None,
        }
    }

    /// One with this phase margin, in degrees, its values rounded as they are told.
    fn design(axis: bool, model: &FirstOrder, period: f64, margin: f64) -> Result<Self, Finding> {
        Ok(if axis {
            let Pid { k1, k2, k3 } = Pid::design(model, period, margin)?;
            Self::Pid(Pid { k1: rounded(k1), k2: rounded(k2), k3: rounded(k3) })
        } else {
            let Lead { alpha, beta, k } = Lead::design(model, period, margin)?;
            Self::Lead(Lead { alpha: rounded(alpha), beta: rounded(beta), k: rounded(k) })
        })
    }

    fn open_loop(&self, model: &FirstOrder, period: f64) -> Discrete {
        match self {
            Self::Lead(lead) => lead.open_loop(model, period),
            Self::Pid(pid) => pid.open_loop(model, period),
        }
    }

    /// The values, in the order of the law's settings.
    const fn values(&self) -> [f64; 3] {
        match self {
            Self::Lead(lead) => [lead.alpha, lead.beta, lead.k],
            Self::Pid(pid) => [pid.k1, pid.k2, pid.k3],
        }
    }
}

impl fmt::Display for Controller {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lead(Lead { alpha, beta, k }) => write!(f, "alpha {alpha}, beta {beta}, k {k}"),
            Self::Pid(Pid { k1, k2, k3 }) => write!(f, "k1 {k1}, k2 {k2}, k3 {k3}"),
        }
    }
}

/// Four digits.
fn rounded(number: f64) -> f64 {
    format!("{number:.3e}").parse().unwrap_or(number)
}

/// What a loop will do.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Forecast {
    /// The closed loop's poles in z: real and imaginary parts, the largest modulus first.
    pub poles: Vec<[f64; 2]>,
    /// Where the open loop's gain is 1, in rad/s.
    pub crossover_rad_per_s: f64,
    /// In degrees.
    pub phase_margin_deg: f64,
    /// In dB; none if no gain is too much.
    pub gain_margin_db: Option<f64>,
    /// The time by which the loop may still be late, in s.
    pub delay_margin_s: f64,
    /// The response to a step so small that the drive stays off its limits.
    pub small_step: Option<Indices>,
}

/// What one says of a step response.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Indices {
    /// From 10 to 90 %, in s.
    pub rise_s: f64,
    /// To within 2 %, in s.
    pub settling_s: f64,
    /// In % of the step.
    pub overshoot_percent: f64,
}

impl From<response::StepResponse> for Indices {
    fn from(found: response::StepResponse) -> Self {
        let response::StepResponse { rise, settling, overshoot } = found;
        Self { rise_s: rise, settling_s: settling, overshoot_percent: 100.0 * overshoot }
    }
}

impl Forecast {
    /// Of a controller for a motor.
    ///
    /// # Errors
    /// [`Finding::Unstable`] if the loop is.
    pub fn of(controller: &Controller, model: &FirstOrder, period: f64) -> Result<Self, Finding> {
        let open = controller.open_loop(model, period);
        response::check_stable(&open)?;
        let margins = response::margins(&open).ok_or(Finding::NoConvergence)?;
        let step = open.closed().step(samples(model, period));
        let points: Vec<(f64, f64)> = (0..).zip(step).map(|(n, y)| (period * f64::from(n), y)).collect();
        Ok(Self {
            poles: open.closed_poles().iter().map(|pole| [pole.re, pole.im]).collect(),
            crossover_rad_per_s: margins.crossover,
            phase_margin_deg: margins.phase,
            gain_margin_db: margins.gain_db(),
            delay_margin_s: margins.delay(),
            small_step: response::of_step(&points, 0.0, 1.0).map(Indices::from),
        })
    }
}

fn samples(model: &FirstOrder, period: f64) -> usize {
    let (least, taus) = SAMPLES;
    least.max((taus * model.tau / period) as usize).min(100_000)
}

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
    path: Vec<(f64, f64)>,
    #[serde(skip)]
    wanted: Vec<(f64, f64)>,
    #[serde(skip)]
    drive: Vec<(f64, f64)>,
}

/// A controller that is proposed, and everything about it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Tuning {
    /// The motor.
    pub motor: Identification,
    /// `lead` or `pid`.
    pub law: &'static str,
    /// What is to be set, by the names of the board's settings where there is a board.
    pub settings: Vec<(String, f64)>,
    /// What it will do.
    pub forecast: Forecast,
    /// What the rig's own controller does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub present: Option<Forecast>,
    /// What is wrong with it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub present_finding: Option<String>,
    /// On the rig, as foretold: the main motor from rest to 2000 rpm, the drive within its limits.
    pub foretold: Option<Indices>,
    /// On the rig, with what is proposed.
    pub shown: Option<Seen>,
    /// On the rig, as it is.
    pub shown_present: Option<Seen>,
    #[serde(skip)]
    controller: Controller,
    #[serde(skip)]
    foretold_path: Vec<(f64, f64)>,
}

/// A line of a table: its name, what it tells of something, and with how many digits.
type Line<T, N> = (&'static str, fn(&T) -> N, usize);

/// Why there is no proposal.
#[derive(Debug, thiserror::Error)]
pub enum TuneError {
    /// The motor is switched, not regulated.
    #[error("board '{board}' is switched on and off: there is nothing to tune")]
    OnOff {
        /// The board.
        board: String,
    },
    /// Its law is one that shows what is wrong in the paper.
    #[error("board '{board}' has its controller in one of the paper's printed forms: set {board}.controller.form back")]
    AsPrinted {
        /// The board.
        board: String,
    },
    /// There is no such controller.
    #[error(transparent)]
    Finding(#[from] Finding),
    /// The board does not take it.
    #[error("board '{board}' does not take what is proposed: {message}")]
    Settings {
        /// The board.
        board: String,
        /// Why.
        message: String,
    },
    /// The rig broke.
    #[error(transparent)]
    Rig(#[from] RigError),
}

impl Tuning {
    /// Proposes a controller with this phase margin, in degrees; with a rig, shows it there.
    ///
    /// # Errors
    /// [`TuneError`] if there is none.
    pub async fn of(
        motor: Identification,
        on_rig: Option<&(RigFile, Subject)>,
        margin: f64,
    ) -> Result<Self, TuneError> {
        let (model, period) = (motor.result.model(), motor.period_s);
        if let Some((_, Subject { board, motor, .. })) = on_rig
            && motor.law == Law::OnOff
        {
            return Err(TuneError::OnOff { board: board.clone() });
        }
        if let Some((_, Subject { board, motor, .. })) = on_rig
            && motor.as_printed
        {
            return Err(TuneError::AsPrinted { board: board.clone() });
        }
        let controller = Controller::design(motor.axis, &model, period, margin)?;
        let forecast = Forecast::of(&controller, &model, period)?;
        let (law, names) = match controller {
            Controller::Lead(_) => ("lead", ["alpha", "beta", "k"]),
            Controller::Pid(_) => ("pid", ["k1", "k2", "k3"]),
        };
        let names = match on_rig.map(|(_, subject)| subject.motor.law) {
            Some(Law::Lead(settings) | Law::Pid(settings)) => settings.map(|(name, _)| name),
            _ => names,
        };
        let settings: Vec<(String, f64)> = names.map(str::to_owned).into_iter().zip(controller.values()).collect();
        let mut tuning = Self {
            motor,
            law,
            settings,
            forecast,
            present: None,
            present_finding: None,
            foretold: None,
            shown: None,
            shown_present: None,
            controller,
            foretold_path: Vec::new(),
        };
        if let Some((file, subject)) = on_rig {
            tuning.show(file, subject, &model).await?;
        }
        Ok(tuning)
    }

    async fn show(&mut self, file: &RigFile, subject: &Subject, model: &FirstOrder) -> Result<(), TuneError> {
        let present = Controller::of(&subject.motor.law);
        match present.map(|controller| Forecast::of(&controller, model, self.motor.period_s)) {
            Some(Ok(forecast)) => self.present = Some(forecast),
            Some(Err(finding)) => self.present_finding = Some(finding.to_string()),
            None => {}
        }
        if let Controller::Lead(lead) = self.controller {
            let wanted = f64::from(SPEED) * 20.0 * core::f64::consts::TAU / 60.0;
            let windows = (WATCHED as f64 / self.motor.period_s) as usize;
            let path = lead.simulate(model, self.motor.period_s, [0.0, wanted], subject.motor.full.0, windows);
            let path =
                smooth(&path.into_iter().map(|(t, y)| (t, 60.0 * y / core::f64::consts::TAU)).collect::<Vec<_>>());
            self.foretold = response::of_step(&path, 0.0, f64::from(SPEED) * 20.0).map(Indices::from);
            self.foretold_path = path;
        }
        let tuned = with_settings(file, subject, &self.settings)?;
        self.shown = Some(watch(&tuned, subject).await?);
        self.shown_present = Some(watch(file, subject).await?);
        Ok(())
    }
}

/// The rig with other settings of one board.
fn with_settings(file: &RigFile, subject: &Subject, settings: &[(String, f64)]) -> Result<RigFile, TuneError> {
    let board = &subject.board;
    settings.iter().try_fold(file.clone(), |file, (name, value)| {
        let set = file.with(&format!("{board}.{name}"), &value.to_string());
        set.map_err(|message| TuneError::Settings { board: board.clone(), message })
    })
}

/// Lets the PC send a frame, and watches the motor.
async fn watch(file: &RigFile, subject: &Subject) -> Result<Seen, RigError> {
    let pc = PcUart::new(file.pc.baud, file.pc.tx_fifo, file.pc.clock);
    let mut rig = Rig::start(file, &Driver::InProcess, pc).await?;
    let frame =
        if subject.is_axis() { [&[0], &MOVE[..], &[0, 0, 0]].concat() } else { [&[SPEED][..], &[0; 7]].concat() };
    let node = rig.pc();
    rig.stimulate(node, Instant::START + SENT.max(file.margin()), Stimulus::Write(frame));
    rig.settle(Instant::START + Span::from_secs(WATCHED)).await?;
    let signals: Vec<String> =
        rig.nodes()[subject.node].description.signals.iter().map(|signal| signal.name.clone()).collect();
    let mut history = Vec::new();
    for fact in rig.take_facts() {
        if let Fact::Telemetry { node, at, signal, value } = fact
            && node == subject.node
        {
            history.push((at, usize::from(signal), value as f64));
        }
    }
    history.sort_by_key(|(at, ..)| *at);
    Ok(Seen::of(subject, &signals, &history))
}

impl Seen {
    /// Of a board's telemetry, which tells changes only.
    fn of(subject: &Subject, signals: &[String], history: &[(Instant, usize, f64)]) -> Self {
        let place = |name: &str| signals.iter().position(|signal| signal == name);
        let period = f64::from(subject.motor.period_ms) / 1_000.0;
        // As it is at each sample.
        let sampled = |name: &str| -> Vec<(f64, f64)> {
            let mut changes = history.iter().filter(|(_, signal, _)| Some(*signal) == place(name)).peekable();
            let mut value = 0.0;
            let count = (WATCHED as f64 / period) as u32;
            let sample = |n: u32| {
                let t = period * f64::from(n);
                while let Some((_, _, next)) = changes.next_if(|(at, ..)| at.as_secs_f64() <= t + 0.5 * period) {
                    value = *next;
                }
                (t, value)
            };
            (0..count).map(sample).collect()
        };
        let drive = sampled("drive");
        if subject.is_axis() {
            let (path, wanted) = (sampled("position_counts"), sampled("set_point_counts"));
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
            sampled("speed_counts").into_iter().map(|(t, counts)| (t, rpm * counts)).collect();
        let wanted = sampled("set_point_rpm");
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
fn smooth(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mean = |n: usize| {
        let last = &points[n.saturating_sub(MEAN_OF - 1)..=n];
        (points[n].0, last.iter().map(|(_, y)| y).sum::<f64>() / MEAN_OF as f64)
    };
    (0..points.len()).map(mean).collect()
}

impl Tuning {
    /// For people.
    pub fn text(&self, colour: bool) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = self.write(&mut text, colour);
        text
    }

    fn write(&self, text: &mut String, colour: bool) -> fmt::Result {
        let style = |style: Style| if colour { style } else { Style::new() };
        let (bold, dim) = (style(Style::new().bold()), style(Style::new().dimmed()));
        let warn = style(AnsiColor::Red.on_default().bold());
        let Identification { subject, units, period_s, axis, result, .. } = &self.motor;
        let what = if *axis { "position" } else { "speed" };
        writeln!(text, "{:<10}{bold}{subject}{bold:#}: {what}, sampled every {} ms", "motor", short(1e3 * period_s))?;
        writeln!(text, "{:<10}{} {} per {}", "gain", digits(result.gain), units.speed, units.input)?;
        writeln!(text, "{:<10}{} s", "tau", digits(result.tau_s))?;
        let law = if *axis { "PID (Eq 13, 14)" } else { "lead compensator, incremental (Eq 7)" };
        writeln!(text, "{:<10}{law}: {bold}{}{bold:#}", "proposed", self.controller)?;
        writeln!(text)?;
        // Without a rig there is nothing beside it.
        let beside = |cell: String| if self.shown.is_some() { format!(" {cell:>12}") } else { String::new() };
        writeln!(text, "{dim}{:<30}{:>12}{}{dim:#}", "", "proposed", beside("as it is".to_owned()))?;
        let present = self.present.as_ref();
        let mut line = |name: &str, number: &dyn Fn(&Forecast) -> Option<String>| {
            let of = |forecast: Option<&Forecast>| forecast.and_then(number).unwrap_or_else(|| "-".to_owned());
            writeln!(text, "{name:<30}{:>12}{}", of(Some(&self.forecast)), beside(of(present)))
        };
        line("crossover, rad/s", &|f| Some(format!("{:.2}", f.crossover_rad_per_s)))?;
        line("phase margin, degrees", &|f| Some(format!("{:.1}", f.phase_margin_deg)))?;
        line("gain margin, dB", &|f| f.gain_margin_db.map(|db| format!("{db:.1}")))?;
        line("delay margin, ms", &|f| Some(format!("{:.0}", 1e3 * f.delay_margin_s)))?;
        line("largest pole", &|f| f.poles.first().map(|[re, im]| format!("{:.4}", libm::hypot(*re, *im))))?;
        line("small step: rise, s", &|f| f.small_step.map(|step| format!("{:.3}", step.rise_s)))?;
        line("  settling (2 %), s", &|f| f.small_step.map(|step| format!("{:.3}", step.settling_s)))?;
        line("  overshoot, %", &|f| f.small_step.map(|step| format!("{:.1}", step.overshoot_percent)))?;
        if let Some(finding) = &self.present_finding {
            writeln!(text, "{warn}as it is: {finding}{warn:#}")?;
        }
        if let (Some(shown), Some(present)) = (&self.shown, &self.shown_present) {
            writeln!(text)?;
            self.write_shown(text, shown, present, dim)?;
        }
        writeln!(text)?;
        writeln!(text, "{dim}to be set{dim:#}")?;
        for (name, value) in &self.settings {
            writeln!(text, "  {name} = {value:?}")?;
        }
        Ok(())
    }

    fn write_shown(&self, text: &mut String, shown: &Seen, present: &Seen, dim: Style) -> fmt::Result {
        let cell = |number: Option<f64>, digits: usize| number.map_or("-".to_owned(), |n| format!("{n:.digits$}"));
        if self.motor.axis {
            let head = format!("{DISTANCE} counts on the rig");
            writeln!(text, "{dim}{head:<30}{:>12} {:>12}{dim:#}", "proposed", "as it is")?;
            let lines: [Line<Seen, Option<f64>>; 3] = [
                ("following error, counts", |seen| seen.following_error_counts, 0),
                ("overshoot, counts", |seen| seen.overshoot_counts, 0),
                ("in position after, s", |seen| seen.in_position_s, 2),
            ];
            for (name, number, digits) in lines {
                writeln!(text, "{name:<30}{:>12} {:>12}", cell(number(shown), digits), cell(number(present), digits))?;
            }
            return Ok(());
        }
        let head = format!("0 to {} rpm on the rig", u32::from(SPEED) * 20);
        writeln!(text, "{dim}{head:<30}{:>12} {:>12} {:>12}{dim:#}", "proposed", "as it is", "foretold")?;
        let lines: [Line<Indices, f64>; 3] = [
            ("rise, s", |step| step.rise_s, 3),
            ("settling (2 %), s", |step| step.settling_s, 3),
            ("overshoot, %", |step| step.overshoot_percent, 1),
        ];
        for (name, number, digits) in lines {
            let of = |step: &Option<Indices>| cell(step.as_ref().map(number), digits);
            let (shown, present, foretold) = (of(&shown.step), of(&present.step), of(&self.foretold));
            writeln!(text, "{name:<30}{shown:>12} {present:>12} {foretold:>12}")?;
        }
        Ok(())
    }

    /// What was seen on the rig, and what was foretold; without a rig, the response to a small step.
    pub fn figure(&self) -> Figure {
        let panel = |y: &str, height: f64, series: Vec<Series>| Panel {
            x: "time, s".to_owned(),
            y: y.to_owned(),
            height,
            series,
        };
        let title = format!("{}: {}", self.motor.subject, self.controller);
        let (Some(shown), Some(present)) = (&self.shown, &self.shown_present) else {
            let (model, period) = (self.motor.result.model(), self.motor.period_s);
            let step = self.controller.open_loop(&model, period).closed().step(samples(&model, period));
            let points: Vec<(f64, f64)> = (0..).zip(step).map(|(n, y)| (period * f64::from(n), y)).collect();
            let settled = self.forecast.small_step.map_or(f64::MAX, |step| 2.0 * step.settling_s);
            let points = points.into_iter().filter(|(t, _)| *t <= settled).collect();
            return Figure {
                title,
                panels: vec![panel("share of a small step", 1.0, vec![Series::new("response", Drawn::Line, points)])],
            };
        };
        let last = self.last_change();
        let until = |points: &[(f64, f64)]| points.iter().copied().filter(|(t, _)| *t <= last).collect::<Vec<_>>();
        let mut panels = Vec::new();
        let mut paths = vec![
            Series::new("proposed", Drawn::Line, until(&shown.path)),
            Series::new("as it is", Drawn::Line, until(&present.path)),
        ];
        if self.motor.axis {
            paths.push(Series::new("set point", Drawn::Dashed, until(&shown.wanted)));
            panels.push(panel("position, counts", 0.8, paths));
            let lag = |seen: &Seen| {
                let pairs = seen.wanted.iter().zip(&seen.path);
                until(&pairs.map(|((t, wanted), (_, y))| (*t, wanted - y)).collect::<Vec<_>>())
            };
            let lags = vec![
                Series::new("proposed", Drawn::Line, lag(shown)),
                Series::new("as it is", Drawn::Line, lag(present)),
            ];
            panels.push(panel("following error, counts", 0.6, lags));
        } else {
            paths.push(Series::new("foretold", Drawn::Dashed, until(&self.foretold_path)));
            paths.push(Series::new("set point", Drawn::Dashed, until(&shown.wanted)));
            panels.push(panel("speed, rpm", 1.0, paths));
        }
        let drives = vec![
            Series::new("proposed", Drawn::Steps, until(&shown.drive)),
            Series::new("as it is", Drawn::Steps, until(&present.drive)),
        ];
        panels.push(panel("drive, LSB", 0.5, drives));
        Figure { title, panels }
    }

    /// Some time after which nothing changes any more, in s.
    fn last_change(&self) -> f64 {
        let seen = [&self.shown, &self.shown_present].into_iter().flatten();
        let last = seen.filter_map(|seen| {
            let (_, end) = *seen.path.last()?;
            let out = seen.path.iter().rposition(|(_, y)| (y - end).abs() > 0.02 * end.abs().max(1.0))?;
            Some(seen.path[out].0)
        });
        1.5 * last.fold(0.0, f64::max) + 0.5
    }
}
