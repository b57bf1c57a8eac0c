//! From a motor that is known to a controller for it: proposed, foretold, and shown on the rig.

use std::fmt;

use anstyle::{AnsiColor, Style};
use serde::Serialize;
use torno_identify::design::{Lead, Pid, Printed};
use torno_identify::discrete::Discrete;
use torno_identify::{Complex, Finding, FirstOrder, response};
use torno_protocol::board::{Description, Role, Stimulus};
use torno_protocol::time::{Instant, Span};

use super::bench::Subject;
use super::report::{Identification, digits, short};
use crate::rig::Driver;
use crate::rig::file::RigFile;
use crate::session::{Session, SessionError};
use torno_engine::Fact;
use torno_machines::motor::{Form, Law, Motor};
use torno_plot::{Figure, Panel, Series, Style as Drawn};

/// Samples of a step response that is looked at, at least; and in time constants of the motor.
const SAMPLES: (usize, f64) = (400, 12.0);
/// And in time constants of its slowest pole.
const POLES: f64 = 8.0;
/// The speed that the main motor is sent to, in the frame's unit of 20 rpm: 2000 rpm. (Ours.)
const SPEED: u8 = 100;
/// The feed's move: 9000 counts at 112 counts a sample, ten revolutions. (Ours.)
const MOVE: [u8; 4] = [112, 0x23, 0x28, 0];
/// How far that is.
const DISTANCE: f64 = 9_000.0;
/// The rig is watched for so long, in s, at least and at most; and in time constants of the motor.
const WATCHED: u64 = 20;
const LONGEST: u64 = 600;
const TAUS: f64 = 6.0;
/// Where a board's settings have the form of its law.
const FORM: &str = "controller.form";
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
    /// Where the open loop's gain is 1, in rad/s; none if it is below 1 at every frequency.
    pub crossover_rad_per_s: Option<f64>,
    /// In degrees.
    pub phase_margin_deg: Option<f64>,
    /// In dB; none if no gain is too much.
    pub gain_margin_db: Option<f64>,
    /// The time by which the loop may still be late, in s.
    pub delay_margin_s: Option<f64>,
    /// The response to a step so small that the drive stays off its limits.
    pub small_step: Option<Indices>,
    /// What is missing in the end, in % of the set point; none if nothing is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub standing_error_percent: Option<f64>,
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
        Self::of_loop(&controller.open_loop(model, period), model)
    }

    /// Of an open loop with this motor.
    fn of_loop(open: &Discrete, model: &FirstOrder) -> Result<Self, Finding> {
        response::check_stable(open)?;
        let (period, margins) = (open.period, response::margins(open));
        let step = open.closed().step(samples(open, model));
        // A loop without an integrator settles, too, only elsewhere.
        let end = open.closed().at(Complex::new(1.0, 0.0)).re;
        let points: Vec<(f64, f64)> = (0..).zip(step).map(|(n, y)| (period * f64::from(n), y)).collect();
        Ok(Self {
            poles: open.closed_poles().iter().map(|pole| [pole.re, pole.im]).collect(),
            crossover_rad_per_s: margins.map(|margins| margins.crossover),
            phase_margin_deg: margins.map(|margins| margins.phase),
            gain_margin_db: margins.and_then(|margins| margins.gain_db()),
            delay_margin_s: margins.map(|margins| margins.delay()),
            small_step: response::of_step(&points, 0.0, end).map(Indices::from),
            standing_error_percent: Some(100.0 * (1.0 - end)).filter(|error| error.abs() > 1e-6),
        })
    }
}

/// How long its slowest pole takes, too.
fn samples(open: &Discrete, model: &FirstOrder) -> usize {
    let (least, taus) = SAMPLES;
    let slowest = open.closed_poles().first().map_or(0.0, |pole| libm::hypot(pole.re, pole.im));
    let long = (taus * model.tau / open.period).max(POLES / (1.0 - slowest).max(1e-9));
    least.max(long as usize).min(100_000)
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
    /// The form of the law that is to be set, where the board has another.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub form: Option<(String, &'static str)>,
    /// What is to be set, and where, if there is a rig.
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
    Session(#[from] SessionError),
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
        if model.gain < 0.0 {
            return Err(Finding::Backwards { gain: model.gain }.into());
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
        let form = on_rig.filter(|(_, subject)| subject.motor.printed.is_some());
        let form = form.map(|(_, subject)| (subject.setting(FORM), working_form(&controller)));
        let placed = |name: &str| on_rig.map_or_else(|| name.to_owned(), |(_, subject)| subject.setting(name));
        let settings: Vec<(String, f64)> = names.map(placed).into_iter().zip(controller.values()).collect();
        let mut tuning = Self {
            motor,
            law,
            form,
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
        match present_loop(&subject.motor, model, self.motor.period_s) {
            Some(open) => match Forecast::of_loop(&open, model) {
                Ok(forecast) => self.present = Some(forecast),
                Err(finding) => self.present_finding = Some(finding.to_string()),
            },
            None => self.present_finding = Some("there is no loop: the set point is the drive".to_owned()),
        }
        if let Controller::Lead(lead) = self.controller {
            let wanted = f64::from(SPEED) * 20.0 * core::f64::consts::TAU / 60.0;
            let windows = (watched(model) as f64 / self.motor.period_s) as usize;
            let path = lead.simulate(model, self.motor.period_s, [0.0, wanted], subject.motor.full.0, windows);
            let path =
                smooth(&path.into_iter().map(|(t, y)| (t, 60.0 * y / core::f64::consts::TAU)).collect::<Vec<_>>());
            self.foretold = response::of_step(&path, 0.0, f64::from(SPEED) * 20.0).map(Indices::from);
            self.foretold_path = path;
        }
        let tuned = with_settings(file, subject, self.form.as_ref(), &self.settings)?;
        let seconds = watched(model);
        self.shown = Some(watch(&tuned, subject, seconds).await?);
        self.shown_present = Some(watch(file, subject, seconds).await?);
        Ok(())
    }
}

/// The rig with other settings of one board.
fn with_settings(
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
const fn working_form(controller: &Controller) -> &'static str {
    match controller {
        Controller::Lead(_) => "incremental",
        Controller::Pid(_) => "pid",
    }
}

/// The loop as the board has it now, in whatever form; None if there is none.
fn present_loop(motor: &Motor, model: &FirstOrder, period: f64) -> Option<Discrete> {
    let controller = Controller::of(&motor.law)?;
    let printed = match (motor.printed, controller) {
        (None, _) => return Some(controller.open_loop(model, period)),
        (Some(Form::Lead), Controller::Lead(lead)) => Printed::Lead(lead),
        (Some(Form::Pid), Controller::Pid(pid)) => Printed::Pid(pid),
        (Some(Form::Proportional(k)), _) => Printed::Proportional(k),
        _ => return None,
    };
    Some(printed.open_loop(model, period))
}

/// How long the rig is watched, in s: until a slow motor has got there, too.
fn watched(model: &FirstOrder) -> u64 {
    ((TAUS * model.tau).ceil() as u64).clamp(WATCHED, LONGEST)
}

/// Lets the PC send a frame, and watches the motor.
async fn watch(file: &RigFile, subject: &Subject, seconds: u64) -> Result<Seen, SessionError> {
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
    fn of(subject: &Subject, board: &Description, history: &[(Instant, u8, f64)], seconds: u64) -> Self {
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
fn smooth(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mean = |n: usize| {
        let last = &points[n.saturating_sub(MEAN_OF - 1)..=n];
        (points[n].0, last.iter().map(|(_, y)| y).sum::<f64>() / MEAN_OF as f64)
    };
    (0..points.len()).map(mean).collect()
}

/// For people, with the colours of a terminal: what writes it elsewhere strips them.
impl fmt::Display for Tuning {
    fn fmt(&self, text: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (bold, dim) = (Style::new().bold(), Style::new().dimmed());
        let warn = AnsiColor::Red.on_default().bold();
        let Identification { subject, units, period_s, axis, result, .. } = &self.motor;
        let what = if *axis { "position" } else { "speed" };
        writeln!(text, "{:<10}{bold}{subject}{bold:#}: {what}, sampled every {} ms", "motor", short(1e3 * period_s))?;
        writeln!(text, "{:<10}{} {} per {}", "gain", digits(result.gain), units.speed, units.input)?;
        writeln!(text, "{:<10}{} s", "tau", digits(result.tau_s))?;
        for warning in &result.warnings {
            writeln!(text, "{warn}{:<10}{warning}{warn:#}", "warning")?;
        }
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
        line("crossover, rad/s", &|f| f.crossover_rad_per_s.map(|omega| format!("{omega:.2}")))?;
        line("phase margin, degrees", &|f| f.phase_margin_deg.map(|phase| format!("{phase:.1}")))?;
        line("gain margin, dB", &|f| f.gain_margin_db.map(|db| format!("{db:.1}")))?;
        line("delay margin, ms", &|f| f.delay_margin_s.map(|delay| format!("{:.0}", 1e3 * delay)))?;
        line("largest pole", &|f| f.poles.first().map(|[re, im]| format!("{:.4}", libm::hypot(*re, *im))))?;
        line("small step: rise, s", &|f| f.small_step.map(|step| format!("{:.3}", step.rise_s)))?;
        line("  settling (2 %), s", &|f| f.small_step.map(|step| format!("{:.3}", step.settling_s)))?;
        line("  overshoot, %", &|f| f.small_step.map(|step| format!("{:.1}", step.overshoot_percent)))?;
        for (name, forecast) in [("proposed", Some(&self.forecast)), ("as it is", present)] {
            let Some(forecast) = forecast else { continue };
            if forecast.crossover_rad_per_s.is_none() {
                writeln!(
                    text,
                    "{warn}{name}: the loop's gain is below 1 at every frequency: there are no margins{warn:#}"
                )?;
            }
            if forecast.small_step.is_none() {
                writeln!(
                    text,
                    "{warn}{name}: the small step does not settle within 8 time constants of its slowest pole{warn:#}"
                )?;
            }
            if let Some(error) = forecast.standing_error_percent {
                writeln!(text, "{warn}{name}: {error:.1} % of the set point are missing in the end{warn:#}")?;
            }
        }
        if let Some(finding) = &self.present_finding {
            writeln!(text, "{warn}as it is: {finding}{warn:#}")?;
        }
        if let (Some(shown), Some(present)) = (&self.shown, &self.shown_present) {
            writeln!(text)?;
            self.write_shown(text, shown, present, dim)?;
        }
        if let Some([proposed, present]) = self.slower() {
            let (proposed, present) = (short(proposed), short(present));
            writeln!(
                text,
                "{warn}slower: on the rig the proposed controller needs {proposed} s, what is there {present} s; a \
                 smaller --phase-margin makes it quicker{warn:#}"
            )?;
        }
        writeln!(text)?;
        writeln!(text, "{dim}to be set{dim:#}")?;
        // As `--set` takes it.
        if let Some((place, form)) = &self.form {
            writeln!(text, "  {place}={form}")?;
        }
        for (name, value) in &self.settings {
            writeln!(text, "  {name}={value:?}")?;
        }
        Ok(())
    }
}

impl Tuning {
    /// What the proposed controller and the present one need on the rig, in s, if the proposed one needs longer.
    fn slower(&self) -> Option<[f64; 2]> {
        let needs = |seen: &Seen| seen.in_position_s.or(seen.step.map(|step| step.settling_s));
        let both = [needs(self.shown.as_ref()?)?, needs(self.shown_present.as_ref()?)?];
        (both[0] > both[1]).then_some(both)
    }

    fn write_shown(&self, text: &mut fmt::Formatter<'_>, shown: &Seen, present: &Seen, dim: Style) -> fmt::Result {
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
            for (name, seen) in [("proposed", shown), ("as it is", present)] {
                if seen.in_position_s.is_none() {
                    let seconds = watched(&self.motor.result.model());
                    writeln!(text, "{name}: it does not come to stay within a count in {seconds} s")?;
                }
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
        for (name, step) in [("proposed", shown.step), ("as it is", present.step), ("foretold", self.foretold)] {
            if step.is_none() {
                let seconds = watched(&self.motor.result.model());
                writeln!(text, "{name}: it does not get there and stay within {seconds} s")?;
            }
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
            let open = self.controller.open_loop(&model, period);
            let step = open.closed().step(samples(&open, &model));
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
