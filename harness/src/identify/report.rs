//! What the methods make of data, side by side.

use std::cmp::Ordering;
use std::fmt::{self, Write as _};

use anstyle::{AnsiColor, Style};
use serde::Serialize;
use torno_identify::discrete::Discrete;
use torno_identify::{
    Data, Estimate, Finding, FirstOrder, Fitted, Sample, SecondOrder, arx, doubt, nls, second_order, step,
};

use super::bench::{LOOP_GAIN, Recording, Useless};
use super::dac::Dac;
use torno_plot::{Figure, Panel, Series, Style as Drawn};

/// The units of a motor's input and speed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Units {
    /// `V`
    pub input: String,
    /// `rad/s`
    pub speed: String,
}

/// A fit that explains less, in %, is a poor one, unless it is the counts that are coarse. (Ours.)
const POOR: f64 = 75.0;
/// Two results contradict each other whose intervals, made so much wider, do not touch. (Ours: one pair in 10 000.)
const TOO_FAR: f64 = 1.5;
/// They are the same if they are nearer than that share, whatever the intervals. (Ours.)
const SAME: f64 = 0.002;
/// Where there are no intervals, such a share is too much. (Ours.)
const ALIKE: f64 = 0.05;

/// A way from data to a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The paper's for the main motor: Eq. 4 at 63 % of the final value.
    Eq4,
    /// The same, averaged from 20 to 90 %.
    Eq4Mean,
    /// The slope of the logarithm, from 20 to 90 %.
    LogLinear,
    /// The paper's for the feed axis: tp and ts of the closed loop (Eq. 8 to 10).
    PeakSettling,
    /// tp and the overshoot of the closed loop.
    PeakOvershoot,
    /// Non-linear least squares on the closed loop, the hold's lag taken out.
    ClosedNls,
    /// Least-squares ARX: a warning.
    ArxLs,
    /// ARX by instrumental variables.
    ArxIv,
    /// Non-linear least squares on what was driven and counted.
    Nls,
    /// The same, with Coulomb friction in the model.
    NlsFriction,
    /// The same, with a dead time between drive and motor.
    NlsDead,
    /// The same, with an offset of the sensor.
    NlsOffset,
}

impl Method {
    /// All, as they are shown.
    const ALL: [Self; 12] = [
        Self::Eq4,
        Self::Eq4Mean,
        Self::LogLinear,
        Self::PeakSettling,
        Self::PeakOvershoot,
        Self::ClosedNls,
        Self::ArxLs,
        Self::ArxIv,
        Self::Nls,
        Self::NlsFriction,
        Self::NlsDead,
        Self::NlsOffset,
    ];

    const fn words(self) -> &'static str {
        match self {
            Self::Eq4 => "Eq 4 at 63 % (the paper's)",
            Self::Eq4Mean => "Eq 4, mean of 20 to 90 %",
            Self::LogLinear => "log-linear least squares",
            Self::PeakSettling => "tp and ts, Eq 8-10 (the paper's)",
            Self::PeakOvershoot => "tp and overshoot",
            Self::ClosedNls => "non-linear LS, closed loop",
            Self::ArxLs => "ARX, least squares: biased",
            Self::ArxIv => "ARX, instrumental variables",
            Self::Nls => "non-linear least squares",
            Self::NlsFriction => "non-linear LS, with friction",
            Self::NlsDead => "non-linear LS, with dead time",
            Self::NlsOffset => "non-linear LS, with offset",
        }
    }

    /// Whether it needs the response of a closed loop.
    const fn of_loop(self) -> bool {
        matches!(self, Self::PeakSettling | Self::PeakOvershoot | Self::ClosedNls)
    }

    /// Whether it can be used on data of this kind at all.
    fn fits(self, data: &Data, closed: bool) -> bool {
        match self {
            Self::Eq4 | Self::Eq4Mean | Self::LogLinear => data.step().is_some() && !closed,
            Self::ArxIv => data.step().is_none() && !closed,
            Self::NlsFriction => data.step().is_none(),
            Self::ArxLs => !closed,
            _ if self.of_loop() => closed,
            _ => true,
        }
    }

    /// Whether it looks for something that most motors and sensors do not have.
    const fn is_extra(self) -> bool {
        matches!(self, Self::NlsFriction | Self::NlsDead | Self::NlsOffset)
    }

    /// Whether its result is worth to be built on.
    const fn is_recommended(self) -> bool {
        matches!(self, Self::Nls | Self::ArxIv) || self.is_extra()
    }

    fn apply(self, recording: &Recording) -> Result<(Fitted, Option<SecondOrder>), Finding> {
        let data = &recording.data;
        let closed = || -> Result<SecondOrder, Finding> {
            let points = recording.closed.as_ref().map_or(&[][..], |(_, points)| points);
            match self {
                Self::PeakSettling => second_order::by_peak_and_settling(&second_order::read(points)?),
                Self::PeakOvershoot => second_order::by_peak_and_overshoot(&second_order::read(points)?),
                _ => Ok(second_order::without_hold(&second_order::by_least_squares(points)?, data.period())),
            }
        };
        let open = match self {
            Self::Eq4 => step::one_point(data),
            Self::Eq4Mean => step::averaged(data),
            Self::LogLinear => step::log_linear(data),
            Self::ArxLs => arx::least_squares(data),
            Self::ArxIv => arx::instrumental_variables(data),
            Self::Nls => nls::first_order(data),
            Self::NlsFriction => nls::with_friction(data),
            Self::NlsDead => nls::with_dead_time(data),
            Self::NlsOffset => nls::with_offset(data),
            Self::PeakSettling | Self::PeakOvershoot | Self::ClosedNls => {
                let closed = closed()?;
                let FirstOrder { gain, tau } = closed.open_loop();
                return Ok((Fitted::bare(gain / LOOP_GAIN, tau), Some(closed)));
            }
        };
        open.map(|fitted| (fitted, None))
    }
}

/// What one method made of one run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MethodResult {
    /// The method.
    pub method: Method,
    /// Worth to be built on.
    pub recommended: bool,
    /// Speed per unit of input.
    pub gain: Option<f64>,
    /// Where it is in 95 of 100 cases.
    pub gain_interval: Option<[f64; 2]>,
    /// The time constant, in s.
    pub tau_s: Option<f64>,
    /// Where it is in 95 of 100 cases.
    pub tau_s_interval: Option<[f64; 2]>,
    /// The natural frequency of the closed loop, in rad/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub omega_rad_per_s: Option<f64>,
    /// The damping of the closed loop.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub xi: Option<f64>,
    /// How much of the response the model explains, in %.
    pub fit_percent: Option<f64>,
    /// What it leaves, root mean square, in units of speed.
    pub residual_rms: Option<f64>,
    /// Coulomb friction, in units of input, if the method looks for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Where it is in 95 of 100 cases.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction_interval: Option<[f64; 2]>,
    /// The dead time between drive and motor, in s, if the method looks for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dead_s: Option<f64>,
    /// Where it is in 95 of 100 cases.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dead_s_interval: Option<[f64; 2]>,
    /// What the sensor tells too much, in units of speed, if the method looks for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub offset: Option<f64>,
    /// Where it is in 95 of 100 cases.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub offset_interval: Option<[f64; 2]>,
    /// What speaks against the model; then there are no intervals, as they are those of another motor.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub doubts: Vec<String>,
    /// Why there is no result.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub finding: Option<String>,
    #[serde(skip)]
    fitted: Option<Fitted>,
}

impl MethodResult {
    fn of(method: Method, recording: &Recording) -> Self {
        let result = method.apply(recording).and_then(|(fitted, closed)| {
            nls::check_fit(&recording.data, &fitted)?;
            Ok((fitted, closed))
        });
        let (mut fitted, closed) = match &result {
            Ok((fitted, closed)) => (Some(fitted.clone()), *closed),
            Err(_) => (None, None),
        };
        let asked = fitted.as_ref().filter(|_| method.is_recommended());
        let mut doubts = asked.map_or(Vec::new(), |fitted| doubt::of(&recording.data, fitted));
        if let Some(fitted) = fitted.as_mut().filter(|_| !doubts.is_empty()) {
            fitted.forget_intervals();
        }
        // The intervals are right even so: the model has the offset.
        let offset = fitted.as_ref().and_then(|fitted| fitted.offset);
        doubts.extend(offset.map(|offset| Finding::Offset { offset: four_digits(offset.value) }));
        let of = |number: fn(&Fitted) -> Estimate| fitted.as_ref().map(number);
        let (gain, tau) = (of(|fitted| fitted.gain), of(|fitted| fitted.tau));
        let friction = fitted.as_ref().and_then(|fitted| fitted.friction);
        let dead = fitted.as_ref().and_then(|fitted| fitted.dead);
        Self {
            method,
            recommended: method.is_recommended() && fitted.is_some(),
            gain: gain.map(|gain| gain.value),
            gain_interval: gain.and_then(|gain| gain.interval()),
            tau_s: tau.map(|tau| tau.value),
            tau_s_interval: tau.and_then(|tau| tau.interval()),
            omega_rad_per_s: closed.map(|closed| closed.omega),
            xi: closed.map(|closed| closed.xi),
            fit_percent: fitted.as_ref().map(|fitted| nls::fit_percent(&recording.data, fitted)),
            residual_rms: fitted.as_ref().map(|fitted| nls::residual_rms(&recording.data, fitted)),
            friction: friction.map(|friction| friction.value),
            friction_interval: friction.and_then(|friction| friction.interval()),
            dead_s: dead.map(|dead| dead.value),
            dead_s_interval: dead.and_then(|dead| dead.interval()),
            offset: offset.map(|offset| offset.value),
            offset_interval: offset.and_then(|offset| offset.interval()),
            doubts: doubts.iter().map(Finding::to_string).collect(),
            finding: result.err().map(|finding| finding.to_string()),
            fitted,
        }
    }

    /// The less, the better: what nothing speaks against, and then what has the narrower interval, or fits better.
    fn rank(&self) -> (bool, f64, f64) {
        let tau = self.fitted.as_ref().and_then(|fitted| fitted.tau.percent());
        let width = tau.filter(|percent| percent.is_finite()).unwrap_or(f64::MAX);
        (!self.doubts.is_empty(), width, -self.fit_percent.unwrap_or(f64::MIN))
    }

    /// Takes the intervals away: they are those of another motor.
    fn doubt(&mut self, doubt: String) {
        (self.gain_interval, self.tau_s_interval, self.dead_s_interval) = (None, None, None);
        if let Some(fitted) = &mut self.fitted {
            fitted.forget_intervals();
        }
        self.doubts.push(doubt);
    }
}

/// Where one experiment shows friction, models without it are wrong in all of them.
fn doubt_what_lacks_friction(runs: &mut [Experiment]) {
    let rows = || runs.iter().flat_map(|run| run.methods.iter().map(move |row| (run, row)));
    let found =
        rows().find(|(_, row)| row.method == Method::NlsFriction && row.fitted.is_some() && row.doubts.is_empty());
    let Some((input, friction)) = found.and_then(|(run, row)| Some((run.input.clone(), row.friction?))) else { return };
    for row in runs.iter_mut().flat_map(|run| &mut run.methods) {
        if row.recommended && row.friction.is_none() && row.doubts.is_empty() {
            row.doubt(format!("friction of {} shows in the {input}, and is not in this model", digits(friction)));
        }
    }
}

/// Where one experiment shows a dead time, models without it are wrong in all of them.
fn doubt_what_lacks_dead_time(runs: &mut [Experiment]) {
    let rows = || runs.iter().flat_map(|run| run.methods.iter().map(move |row| (run, row)));
    let sound = rows().filter(|(_, row)| row.doubts.is_empty());
    let Some((input, dead)) = sound.filter_map(|(run, row)| Some((run.input.clone(), row.dead_s?))).next() else {
        return;
    };
    for row in runs.iter_mut().flat_map(|run| &mut run.methods) {
        if row.recommended && row.dead_s.is_none() && row.doubts.is_empty() {
            row.doubt(format!("a dead time of {} s shows in the {input}, and is not in this model", digits(dead)));
        }
    }
}

/// Where the sensor is off, models without that take it for gain.
fn doubt_what_lacks_offset(runs: &mut [Experiment]) {
    for run in runs {
        let Some(offset) = run.methods.iter().find_map(|row| row.offset) else { continue };
        for row in run.methods.iter_mut().filter(|row| row.recommended && row.offset.is_none()) {
            row.doubt(format!(
                "an offset of {} shows while the motor stands, and is not in this model",
                digits(offset)
            ));
        }
    }
}

/// Two results that cannot both be right, in words: the two that are furthest apart.
fn contradiction<'a>(rows: impl Iterator<Item = (&'a Experiment, &'a MethodResult)>, units: &Units) -> Option<String> {
    let mut rows: Vec<(&Experiment, &MethodResult)> =
        rows.filter(|(_, row)| row.recommended && row.fitted.is_some()).collect();
    if rows.iter().any(|(_, row)| row.doubts.is_empty()) {
        rows.retain(|(_, row)| row.doubts.is_empty());
    } else if rows.iter().any(|(_, row)| row.offset.is_some()) {
        rows.retain(|(_, row)| row.offset.is_some());
    }
    let pairs = (0..rows.len()).flat_map(|a| (a + 1..rows.len()).map(move |b| (a, b)));
    let apart = |a: Estimate, b: Estimate| {
        let difference = (a.value - b.value).abs();
        let halves = a.half.zip(b.half).map(|(a, b)| TOO_FAR * (a + b));
        let share = if halves.is_some() { SAME } else { ALIKE };
        let allowed = halves.unwrap_or(0.0).max(share * a.value.abs().max(b.value.abs()));
        difference / allowed
    };
    let seen = pairs.filter_map(|(a, b)| {
        let (of_a, of_b) = (rows[a].1.fitted.as_ref()?, rows[b].1.fitted.as_ref()?);
        let (gain, tau) = (apart(of_a.gain, of_b.gain), apart(of_a.tau, of_b.tau));
        Some((gain.max(tau), gain > tau, a, b))
    });
    let (apart, of_gain, a, b) = seen.max_by(|a, b| a.0.total_cmp(&b.0))?;
    if apart <= 1.0 {
        return None;
    }
    let told = |n: usize| {
        let (run, row) = rows[n];
        let number = if of_gain { row.gain } else { row.tau_s };
        format!("{} ({}, {})", digits(number.unwrap_or_default()), row.method.words(), run.input)
    };
    let (what, unit) =
        if of_gain { ("gain", format!("{} per {}", units.speed, units.input)) } else { ("tau", "s".to_owned()) };
    let (a, b) = (told(a), told(b));
    Some(format!("the results contradict each other: {what} is {a} or {b}, in {unit}: this motor is no single lag"))
}

/// One run and what came of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Experiment {
    /// What it was.
    pub input: String,
    /// How many samples there are.
    pub samples: usize,
    /// The methods.
    pub methods: Vec<MethodResult>,
    /// Why nothing came of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub finding: Option<String>,
    /// Why there is no dead time.
    #[serde(skip)]
    no_dead: Option<String>,
    #[serde(skip)]
    recording: Option<Recording>,
}

/// A motor, identified.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Identification {
    /// What was identified: a board of a rig, or a file.
    pub subject: String,
    /// The units.
    pub units: Units,
    /// The sample time, in s.
    pub period_s: f64,
    /// Its position is what matters, not its speed.
    pub axis: bool,
    /// What was taken for granted, or out of the data.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// What has made a voltage of the speed, if anything has.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub converter: Option<Dac>,
    /// What is to be built on.
    pub result: Outcome,
    /// Everything that was tried.
    pub runs: Vec<Experiment>,
}

/// What is to be built on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outcome {
    /// By which method.
    pub method: Method,
    /// From which run.
    pub input: String,
    /// In s: numerator and denominator, the highest power first, from input to speed; for an axis, to position.
    pub s: [Vec<f64>; 2],
    /// In z, the same, held and sampled every `period_s`.
    pub z: [Vec<f64>; 2],
    /// Speed per unit of input.
    pub gain: f64,
    /// Where it is in 95 of 100 cases.
    pub gain_interval: Option<[f64; 2]>,
    /// The time constant, in s.
    pub tau_s: f64,
    /// Where it is in 95 of 100 cases.
    pub tau_s_interval: Option<[f64; 2]>,
    /// Coulomb friction, in units of input, if the motor has any that shows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Where it is in 95 of 100 cases.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction_interval: Option<[f64; 2]>,
    /// The dead time between drive and motor, in s, which `s` and `z` do not have; None if none shows.
    pub dead_s: Option<f64>,
    /// Where it is in 95 of 100 cases.
    pub dead_s_interval: Option<[f64; 2]>,
    /// How much of the response the model explains, in %.
    pub fit_percent: f64,
    /// What speaks against it.
    pub warnings: Vec<String>,
    #[serde(skip)]
    no_dead: Option<String>,
    #[serde(skip)]
    model: FirstOrder,
}

impl Outcome {
    /// The model.
    pub const fn model(&self) -> FirstOrder {
        self.model
    }
}

impl Identification {
    /// Lets the methods work on all recordings; with `only`, that one method.
    ///
    /// # Errors
    /// Why no method that is worth it came to a result.
    pub fn of(
        subject: String,
        units: Units,
        axis: bool,
        recordings: Vec<Result<Recording, Useless>>,
        only: Option<Method>,
    ) -> Result<Self, String> {
        let mut runs: Vec<Experiment> =
            recordings.into_iter().map(|recording| Experiment::of(recording, only)).collect();
        runs.retain(|run| !run.methods.is_empty() || run.finding.is_some());
        doubt_what_lacks_friction(&mut runs);
        doubt_what_lacks_offset(&mut runs);
        doubt_what_lacks_dead_time(&mut runs);
        let rows = || runs.iter().flat_map(|run| run.methods.iter().map(move |row| (run, row)));
        let worthy = rows().filter(|(_, row)| row.fitted.is_some() && (only.is_some() || row.recommended));
        let best = worthy.min_by(|(_, a), (_, b)| a.rank().partial_cmp(&b.rank()).unwrap_or(Ordering::Equal));
        let Some((run, best)) = best else {
            let findings = rows().filter_map(|(run, row)| {
                let finding = row.finding.as_ref().filter(|_| only.is_some() || row.method.is_recommended())?;
                Some(format!("{}: {}: {finding}", run.input, row.method.words()))
            });
            // What the others found is no result, but it helps to see what is wrong.
            let others = rows().filter_map(|(run, row)| {
                let (gain, tau) = (digits(row.gain?), digits(row.tau_s?));
                let words = row.method.words();
                Some(format!("{}: not to be relied on: {words}: gain {gain}, tau {tau} s", run.input))
            });
            let useless = runs.iter().filter_map(|run| Some(format!("{}: {}", run.input, run.finding.as_ref()?)));
            let findings: Vec<String> = useless.chain(findings).chain(others).collect();
            return Err(match (findings.is_empty(), only) {
                (true, Some(only)) => format!("{} cannot be used on such data", only.words()),
                _ if findings.len() == 1 => findings.concat(),
                _ => findings.iter().map(|finding| format!("\n  {finding}")).collect(),
            });
        };
        let MethodResult { method, fitted: Some(fitted), fit_percent, doubts, .. } = best else {
            return Err("no method came to a result".to_owned());
        };
        let mut warnings = doubts.clone();
        let contradiction = contradiction(rows(), &units);
        let agreed = contradiction.is_none();
        warnings.extend(contradiction);
        let seen = run.recording.as_ref().map_or(0.0, |recording| recording.data.quantum());
        let beside = |recording: &Recording| nls::fit_beside_readings(&recording.data, fitted);
        let fit = run.recording.as_ref().map_or(0.0, beside);
        if doubts.is_empty() && fit < POOR && best.residual_rms.is_some_and(|left| left > 2.0 * seen) {
            warnings.push(format!("the model explains {fit:.0} % of the response only: do not build on it"));
        }
        if fitted.gain.value < 0.0 {
            warnings.push(Finding::Backwards { gain: fitted.gain.value }.to_string());
        }
        let period_s = run.recording.as_ref().map_or(0.0, |recording| recording.data.period());
        let model = fitted.model();
        let z = if axis { Discrete::position(&model, period_s) } else { Discrete::speed(&model, period_s) };
        let (a, b) = (1.0 / model.tau, model.gain / model.tau);
        let result = Outcome {
            method: *method,
            input: run.input.clone(),
            s: [vec![b], if axis { vec![1.0, a, 0.0] } else { vec![1.0, a] }],
            z: [z.numerator.0, z.denominator.0],
            gain: model.gain,
            gain_interval: fitted.gain.interval().filter(|_| agreed),
            tau_s: model.tau,
            tau_s_interval: fitted.tau.interval().filter(|_| agreed),
            friction: fitted.friction.map(|friction| friction.value),
            friction_interval: fitted.friction.and_then(|friction| friction.interval()),
            dead_s: fitted.dead.map(|dead| dead.value),
            dead_s_interval: fitted.dead.and_then(|dead| dead.interval()).filter(|_| agreed),
            fit_percent: fit_percent.unwrap_or_default(),
            warnings,
            // Beside friction or an offset it was not looked for.
            no_dead: run.no_dead.clone().filter(|_| !method.is_extra()),
            model,
        };
        Ok(Self { subject, units, period_s, axis, notes: Vec::new(), converter: None, result, runs })
    }

    /// The data of the run that is built on, with its model and the paper's over it, and the input below. Where a
    /// converter has made a voltage of the speed, as an oscilloscope shows it: held from the end of a window on.
    pub fn figure(&self) -> Figure {
        let run = self.runs.iter().find(|run| run.input == self.result.input);
        let Some((run, recording)) = run.and_then(|run| Some((run, run.recording.as_ref()?))) else {
            return Figure::default();
        };
        let data = &recording.data;
        let (name, drawn, scale) = match &self.converter {
            Some(dac) => ("converter", Drawn::Steps, dac.volts_per_rad_per_s),
            None => ("counted", Drawn::Dots, 1.0),
        };
        let shown_at = |(t, sample): (f64, &Sample)| if self.converter.is_some() { sample.time } else { t };
        let times = || data.instants().into_iter().zip(data.samples()).map(shown_at);
        let measured = times().zip(data.samples()).map(|(t, sample)| (t, scale * sample.speed)).collect();
        let mut series = vec![Series::new(name, drawn, measured)];
        let shown = |row: &&MethodResult| {
            row.method == self.result.method || matches!(row.method, Method::Eq4 | Method::PeakSettling)
        };
        let mut rows: Vec<&MethodResult> = run.methods.iter().filter(shown).collect();
        rows.sort_by_key(|row| row.method != self.result.method);
        for row in rows {
            let Some(fitted) = &row.fitted else { continue };
            let style = if row.method == self.result.method { Drawn::Line } else { Drawn::Dashed };
            let model = times().zip(nls::simulate(data, fitted)).map(|(t, speed)| (t, scale * speed)).collect();
            series.push(Series::new(row.method.words(), style, model));
        }
        let mut panels = Vec::new();
        // A motor that was at rest was not driven before.
        let mut input: Vec<(f64, f64)> = Vec::new();
        if data.starts_at_rest() {
            input.push((data.start(), 0.0));
        }
        let starts = core::iter::once(data.start()).chain(data.samples().iter().map(|sample| sample.time));
        input.extend(starts.zip(data.samples()).map(|(start, sample)| (start, sample.input)));
        input.extend(data.samples().last().map(|last| (last.time, last.input)));
        let Units { input: input_unit, speed } = &self.units;
        let panel = |y: String, height: f64, series: Vec<Series>| Panel { x: "time, s".to_owned(), y, height, series };
        if let Some((counts, points)) = &recording.closed {
            let mut series = vec![Series::new("counted", Drawn::Dots, points.clone())];
            let closed = run.methods.iter().filter(|row| row.method.of_loop());
            let closed = closed.filter_map(|row| Some((row, SecondOrder { omega: row.omega_rad_per_s?, xi: row.xi? })));
            series.extend(closed.map(|(row, model)| {
                let at = |(t, _): &(f64, f64)| (*t, *counts as f64 * second_order::respond(&model, *t));
                let style = if row.method == Method::ClosedNls { Drawn::Line } else { Drawn::Dashed };
                Series::new(row.method.words(), style, points.iter().map(at).collect())
            }));
            panels.push(panel("position, counts".to_owned(), 0.8, series));
        }
        let what = if self.converter.is_some() { "converter, V".to_owned() } else { format!("speed, {speed}") };
        panels.push(panel(what, 1.0, series));
        panels.push(panel(format!("input, {input_unit}"), 0.45, vec![Series::new("input", Drawn::Steps, input)]));
        Figure { title: format!("{}: {}", self.subject, self.result.input), panels }
    }
}

/// For people, with the colours of a terminal: what writes it elsewhere strips them.
impl fmt::Display for Identification {
    fn fmt(&self, text: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (bold, dim) = (Style::new().bold(), Style::new().dimmed());
        let warn = AnsiColor::Yellow.on_default();
        let Outcome { method, input, s, z, gain, gain_interval, tau_s, tau_s_interval, fit_percent, .. } = &self.result;
        let Units { input: input_unit, speed } = &self.units;
        let what = if self.axis { "position" } else { "speed" };
        writeln!(text, "{:<9}{bold}{}{bold:#}: {what} ({speed} per {input_unit})", "motor", self.subject)?;
        let (late, beside) = match self.result.dead_s {
            Some(dead) => (format!(" e^(-{} s)", digits(dead)), ", without the dead time"),
            None => (String::new(), ""),
        };
        let normal = normal_form(*gain, *tau_s, self.axis);
        writeln!(text, "{:<9}{bold}{}{late}{bold:#} = {normal}{late}", "in s", ratio(s, 's'))?;
        let period = short(1e3 * self.period_s);
        writeln!(text, "{:<9}{bold}{}{bold:#}   held and sampled every {period} ms{beside}", "in z", ratio(z, 'z'))?;
        writeln!(text, "{:<9}{}", "gain", estimate(*gain, *gain_interval, &format!("{speed} per {input_unit}")))?;
        writeln!(text, "{:<9}{}", "tau", estimate(*tau_s, *tau_s_interval, "s"))?;
        if let Some(friction) = self.result.friction {
            writeln!(text, "{:<9}{}", "friction", estimate(friction, self.result.friction_interval, input_unit))?;
        }
        if let Some(dead) = self.result.dead_s {
            writeln!(text, "{:<9}{}", "dead", estimate(dead, self.result.dead_s_interval, "s"))?;
        }
        if let Some(none) = &self.result.no_dead {
            writeln!(text, "{:<9}{none}", "dead")?;
        }
        writeln!(text, "{:<9}{fit_percent:.1} % of the response; {}, {input}", "fit", method.words())?;
        if let Some(dac) = &self.converter {
            let step = self.runs.iter().find_map(|run| run.recording.as_ref()?.data.step());
            dac.write(text, *gain, input_unit, step.map(|(input, _)| input))?;
        }
        for note in &self.notes {
            writeln!(text, "{:<9}{note}", "note")?;
        }
        for warning in &self.result.warnings {
            writeln!(text, "{warn}{:<9}{warning}{warn:#}", "warning")?;
        }
        for run in &self.runs {
            writeln!(text)?;
            if let Some(finding) = &run.finding {
                writeln!(text, "{bold}{}{bold:#}", run.input)?;
                writeln!(text, "  {warn}{finding}{warn:#}")?;
                continue;
            }
            writeln!(text, "{bold}{} ({} samples){bold:#}", run.input, run.samples)?;
            let head =
                format!("  {:<34}{:>10} {:>8}{:>11} {:>8}{:>8}", "method", "gain", "95 %", "tau s", "95 %", "fit");
            writeln!(text, "{dim}{head}{dim:#}")?;
            for row in &run.methods {
                row.write(text, warn)?;
            }
        }
        Ok(())
    }
}

impl Dac {
    fn write(&self, text: &mut fmt::Formatter<'_>, gain: f64, input_unit: &str, step: Option<f64>) -> fmt::Result {
        let Self { volts_per_step, steps_per_count, volts_per_rad_per_s, volts_at_5500_rpm, .. } = self;
        let (mv, steps) = (1e3 * volts_per_step, short(*steps_per_count));
        writeln!(text, "{:<9}8 bits, R-2R: {mv:.2} mV a step, a count times {steps}", "ladder")?;
        writeln!(text, "{:<9}5500 rpm are {volts_at_5500_rpm:.2} V", "")?;
        let gain = gain * volts_per_rad_per_s;
        write!(text, "{:<9}{} V per {input_unit}", "in volts", digits(gain))?;
        if let Some(input) = step {
            let settled = gain * input;
            let risen = settled * (1.0 - libm::exp(-1.0));
            let input = short(input);
            write!(text, "; a step of {input} {input_unit} ends at {settled:.2} V, and is at {risen:.2} V after tau")?;
        }
        writeln!(text)
    }
}

impl Experiment {
    fn of(recording: Result<Recording, Useless>, only: Option<Method>) -> Self {
        let recording = match recording {
            Ok(recording) => recording,
            Err(Useless { what, finding }) => {
                let finding = Some(finding.to_string());
                return Self { input: what, samples: 0, methods: Vec::new(), finding, no_dead: None, recording: None };
            }
        };
        let closed = recording.closed.is_some();
        let wanted = Method::ALL.into_iter().filter(|method| only.is_none_or(|only| only == *method));
        let methods = wanted.filter(|method| method.fits(&recording.data, closed));
        let mut methods: Vec<MethodResult> = methods.map(|method| MethodResult::of(method, &recording)).collect();
        let no_dead = methods.iter().find(|row| row.method == Method::NlsDead).and_then(|row| row.finding.clone());
        // Most motors have none: there is nothing to be told of that.
        methods.retain(|row| only.is_some() || !row.method.is_extra() || row.fitted.is_some());
        Self {
            input: recording.what.clone(),
            samples: recording.data.samples().len(),
            methods,
            finding: None,
            no_dead,
            recording: Some(recording),
        }
    }
}

impl MethodResult {
    fn write(&self, text: &mut fmt::Formatter<'_>, warn: Style) -> fmt::Result {
        let mark = match (self.recommended, self.doubts.is_empty()) {
            (true, true) => '*',
            (true, false) => '?',
            _ => ' ',
        };
        let warned = self.method == Method::ArxLs || self.finding.is_some() || !self.doubts.is_empty();
        let warn = if warned { warn } else { Style::new() };
        write!(text, "{mark} {warn}{:<34}", self.method.words())?;
        if let Some(finding) = &self.finding {
            return writeln!(text, "{finding}{warn:#}");
        }
        let number = |number: Option<f64>| number.map_or(String::new(), digits);
        let percent = |number: Option<f64>, interval: Option<[f64; 2]>| {
            let half = |(interval, number): ([f64; 2], f64)| half_width(interval, number);
            interval.zip(number).map_or(String::new(), half)
        };
        let (gain, tau) = (percent(self.gain, self.gain_interval), percent(self.tau_s, self.tau_s_interval));
        write!(text, "{:>10} {gain:>8}{:>11} {tau:>8}", number(self.gain), number(self.tau_s))?;
        write!(text, "{:>6.1} %", self.fit_percent.unwrap_or_default())?;
        if let (Some(omega), Some(xi)) = (self.omega_rad_per_s, self.xi) {
            write!(text, "   wn {omega:.4} rad/s, xi {xi:.4}")?;
        }
        if let Some(friction) = self.friction {
            write!(text, "   friction {}", digits(friction))?;
        }
        if let Some(dead) = self.dead_s {
            write!(text, "   dead time {} s", digits(dead))?;
        }
        if let Some(offset) = self.offset {
            write!(text, "   offset {}", digits(offset))?;
        }
        writeln!(text, "{warn:#}")?;
        self.doubts.iter().try_for_each(|doubt| writeln!(text, "    {warn}{doubt}{warn:#}"))
    }
}

/// Half of an interval, in % of the number.
fn half_width([low, high]: [f64; 2], number: f64) -> String {
    let percent = 50.0 * ((high - low) / number).abs();
    if percent < 0.005 { "<0.01 %".to_owned() } else { format!("±{percent:.2} %") }
}

fn estimate(value: f64, interval: Option<[f64; 2]>, unit: &str) -> String {
    let range = interval.map_or(String::new(), |[low, high]| {
        format!("   95 %: {} to {} ({})", digits(low), digits(high), half_width([low, high], value))
    });
    format!("{} {unit}{range}", digits(value))
}

/// K/(τs + 1), with the integrator of an axis.
fn normal_form(gain: f64, tau: f64, axis: bool) -> String {
    let lag = format!("{} s + 1", digits(tau));
    if axis { format!("{}/(s ({lag}))", digits(gain)) } else { format!("{}/({lag})", digits(gain)) }
}

fn ratio([numerator, denominator]: &[Vec<f64>; 2], variable: char) -> String {
    let (above, below) = (polynomial(numerator, variable), polynomial(denominator, variable));
    if numerator.len() > 1 { format!("({above})/({below})") } else { format!("{above}/({below})") }
}

/// A polynomial, the highest power's coefficient first.
pub(super) fn polynomial(coefficients: &[f64], variable: char) -> String {
    let mut text = String::new();
    for (n, coefficient) in coefficients.iter().enumerate() {
        let power = match coefficients.len() - 1 - n {
            0 => String::new(),
            1 => variable.to_string(),
            power => format!("{variable}^{power}"),
        };
        if *coefficient == 0.0 {
            continue;
        }
        let sign = match (text.is_empty(), *coefficient < 0.0) {
            (true, true) => "-",
            (true, false) => "",
            (false, true) => " - ",
            (false, false) => " + ",
        };
        let size = coefficient.abs();
        let number = if size == 1.0 && !power.is_empty() { String::new() } else { digits(size) };
        let space = if number.is_empty() || power.is_empty() { "" } else { " " };
        let _ = write!(text, "{sign}{number}{space}{power}");
    }
    if text.is_empty() { "0".to_owned() } else { text }
}

/// Five digits that say something; poles near 1 need them.
pub(super) fn digits(number: f64) -> String {
    if number == 0.0 || !number.is_finite() {
        return number.to_string();
    }
    let before = libm::floor(libm::log(number.abs()) / core::f64::consts::LN_10) as i32 + 1;
    let after = (5 - before).clamp(0, 12) as usize;
    format!("{number:.after$}")
}

/// As many as a person reads.
fn four_digits(number: f64) -> f64 {
    format!("{number:.3e}").parse().unwrap_or(number)
}

/// Without digits that say nothing.
pub(super) fn short(number: f64) -> String {
    let text = format!("{number:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_read_as_one_writes_them() {
        assert_eq!(polynomial(&[1.0, -1.952_783, 0.956_497], 'z'), "z^2 - 1.9528 z + 0.95650");
        assert_eq!(polynomial(&[1.0, 1.391_304, 0.0], 's'), "s^2 + 1.3913 s");
        assert_eq!(ratio(&[vec![6.785_714], vec![1.0, 0.357_143]], 's'), "6.7857/(s + 0.35714)");
        assert_eq!(digits(5_443.1), "5443.1");
    }
}
