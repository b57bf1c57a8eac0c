//! P, PI, PD and PID for one axis side by side: what each foretells, and what the board makes of it.

use std::fmt;

use anstyle::{AnsiColor, Style};
use serde::Serialize;
use torno_identify::design::Structure;
use torno_machines::motor::Law;
use torno_plot::{Figure, Panel, Series, Style as Drawn};

use super::error::TuneError;
use super::forecast::{Controller, Forecast, present_loop, small_step};
use super::rig::{DISTANCE, FORM, Seen, SmallStep, small_step as small_step_on, watch, watched, with, working_form};
use super::text::{Indicator, MARGINS, STEP};
use crate::identify::bench::Subject;
use crate::identify::report::Identification;
use crate::rig::file::RigFile;

/// The friction of the second move, as a share of the torque at standstill with full drive. (Ours.)
const FRICTION: f64 = 0.05;
/// The board's rules against friction: with K2 itself for `k2_standing`, and without the others, there is Eq. 14 alone.
const K2_STANDING: &str = "controller.k2_standing";
const RULES: [&str; 2] = ["controller.breakaway", "controller.dead_band_counts"];

/// Controllers of several structures for one axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// The motor.
    pub motor: Identification,
    /// In degrees, of each that is proposed.
    pub phase_margin_deg: f64,
    /// The friction of the second move, as a share of the torque at standstill with full drive.
    pub friction: f64,
    /// The controllers; the last is the board's own as it is.
    pub controllers: Vec<Compared>,
}

/// One of them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Compared {
    /// `P`, `PI`, `PD`, `PID`, or `as it is`.
    pub name: &'static str,
    /// K1, K2 and K3.
    pub gains: [f64; 3],
    /// What it foretells; none if the loop is unstable.
    pub forecast: Option<Forecast>,
    /// Why there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub finding: Option<String>,
    /// The usual move, on the rig as it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shown: Option<Seen>,
    /// The same with friction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub with_friction: Option<Seen>,
    #[serde(skip)]
    response: Vec<(f64, f64)>,
}

impl Comparison {
    /// Designs a controller of each structure with this phase margin, in degrees, and lets the board run each.
    ///
    /// # Errors
    /// [`TuneError`] if the motor moves no axis, or a controller cannot be had.
    pub async fn of(
        motor: Identification,
        on_rig: Option<&(RigFile, Subject)>,
        margin: f64,
        structures: &[Structure],
    ) -> Result<Self, TuneError> {
        if !motor.axis {
            return Err(TuneError::NoAxis);
        }
        let mut comparison = Self { motor, phase_margin_deg: margin, friction: FRICTION, controllers: Vec::new() };
        let (model, period) = (comparison.motor.result.model(), comparison.motor.period_s);
        for structure in structures {
            let controller = Controller::of_parts(*structure, &model, period, margin)?;
            comparison.add(structure.name(), controller, true, on_rig).await?;
        }
        if let Some((_, subject)) = on_rig
            && let Some(controller) = Controller::of(&subject.motor.law)
        {
            comparison.add(AS_IT_IS, controller, false, on_rig).await?;
        }
        Ok(comparison)
    }

    async fn add(
        &mut self,
        name: &'static str,
        controller: Controller,
        proposed: bool,
        on_rig: Option<&(RigFile, Subject)>,
    ) -> Result<(), TuneError> {
        let (model, period) = (self.motor.result.model(), self.motor.period_s);
        let open = match on_rig {
            Some((_, subject)) if !proposed => present_loop(&subject.motor, &model, period),
            _ => Some(controller.open_loop(&model, period)),
        };
        let forecast = open.as_ref().map(|open| Forecast::of_loop(open, &model));
        let (forecast, finding) = match forecast {
            Some(Ok(forecast)) => (Some(forecast), None),
            Some(Err(finding)) => (None, Some(finding.to_string())),
            None => (None, Some("there is no loop".to_owned())),
        };
        let response = open.filter(|_| forecast.is_some()).map_or(Vec::new(), |open| small_step(&open, &model));
        let gains = controller.values();
        let mut compared = Compared { name, gains, forecast, finding, shown: None, with_friction: None, response };
        if let Some((file, subject)) = on_rig {
            let tuned = if proposed { with_controller(file, subject, &controller)? } else { file.clone() };
            let seconds = watched(&model);
            let mut shown = watch(&tuned, subject, seconds).await?;
            shown.small_step = small_step_on(&tuned, subject, &controller, seconds).await?;
            compared.shown = Some(shown);
            let rubs = with(&tuned, subject, [(subject.setting("plant.friction"), FRICTION.to_string())])?;
            compared.with_friction = Some(watch(&rubs, subject, seconds).await?);
        }
        self.controllers.push(compared);
        Ok(())
    }
}

/// The name of what the rig has.
const AS_IT_IS: &str = "as it is";

/// The rig with this controller, and nothing but it.
fn with_controller(file: &RigFile, subject: &Subject, controller: &Controller) -> Result<RigFile, TuneError> {
    let Law::Pid(settings) = subject.motor.law else { return Ok(file.clone()) };
    let values = controller.values();
    let gains = settings.map(|(name, _)| name).into_iter().zip(values).chain([(K2_STANDING, values[1])]);
    let rules = RULES.map(|name| (name, 0.0));
    let form = subject.motor.printed.map(|_| (FORM, working_form(controller).to_owned()));
    let all = gains.chain(rules).map(|(name, value)| (name, value.to_string())).chain(form);
    with(file, subject, all.map(|(name, value)| (subject.setting(name), value)))
}

/// For people, with the colours of a terminal: what writes it elsewhere strips them.
impl fmt::Display for Comparison {
    fn fmt(&self, text: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (bold, dim) = (Style::new().bold(), Style::new().dimmed());
        let warn = AnsiColor::Red.on_default().bold();
        self.motor.write_model(text)?;
        let margin = self.phase_margin_deg;
        writeln!(text, "{:<10}each with a phase margin of {bold}{margin} degrees{bold:#}", "compared")?;
        writeln!(text)?;
        let row = |text: &mut fmt::Formatter<'_>, name: &str, cell: &dyn Fn(&Compared) -> Option<String>| {
            let cells = self.controllers.iter().map(|one| {
                let cell = cell(one).unwrap_or_else(|| "-".to_owned());
                format!(" {cell:>11}")
            });
            writeln!(text, "{name:<30}{}", cells.collect::<String>())
        };
        row(text, "", &|one| Some(one.name.to_owned()))?;
        for (place, name) in ["k1", "k2", "k3"].into_iter().enumerate() {
            row(text, name, &|one| Some(format!("{}", one.gains[place])))?;
        }
        for (name, number) in MARGINS {
            row(text, name, &|one| one.forecast.as_ref().and_then(number))?;
        }
        row(text, "least damping", &|one| one.forecast.as_ref().map(|forecast| format!("{:.2}", forecast.damping)))?;
        for (name, number, digits) in STEP {
            row(text, name, &|one| {
                let step = one.forecast.as_ref()?.small_step.as_ref()?;
                Some(format!("{:.digits$}", number(step)))
            })?;
        }
        if self.controllers.iter().any(|one| one.shown.is_some()) {
            row(text, "on the rig: step of, counts", &|one| step_of(one).map(|step| step.counts.to_string()))?;
            for ((_, number, digits), name) in STEP.into_iter().zip(["  rise, s", "  settling, s", "  overshoot, %"]) {
                row(text, name, &|one| {
                    let step = step_of(one)?.response.as_ref()?;
                    Some(format!("{:.digits$}", number(step)))
                })?;
            }
            let friction = format!("with friction of {} %:", 100.0 * self.friction);
            let moves: [(String, Shown); 2] = [
                (format!("{DISTANCE} counts:"), |one| one.shown.as_ref()),
                (friction, |one| one.with_friction.as_ref()),
            ];
            for (head, seen) in moves {
                writeln!(text, "{dim}{head}{dim:#}")?;
                for (name, number, digits) in MOVE {
                    row(text, name, &|one| number(seen(one)?).map(|number| format!("{number:.digits$}")))?;
                }
                row(text, "  verdict", &|one| seen(one)?.verdict.as_ref().map(ToString::to_string))?;
            }
        }
        for one in &self.controllers {
            if let Some(finding) = &one.finding {
                writeln!(text, "{warn}{}: {finding}{warn:#}", one.name)?;
            }
        }
        writeln!(text)?;
        let note = "as it is: with the board's rules against friction (docs/friction.md); the others are Eq 14 alone.";
        writeln!(text, "{dim}{note}{dim:#}")
    }
}

/// One of the moves on the rig.
type Shown = fn(&Compared) -> Option<&Seen>;
/// Times in s, and what was seen.
type Points = Vec<(f64, f64)>;

fn step_of(one: &Compared) -> Option<&SmallStep> {
    one.shown.as_ref()?.small_step.as_ref()
}

/// What is told of a move.
const MOVE: [Indicator<Seen, Option<f64>>; 4] = [
    ("  following error, counts", |seen| seen.following_error_counts, 0),
    ("  overshoot, counts", |seen| seen.overshoot_counts, 0),
    ("  in position after, s", |seen| seen.in_position_s, 2),
    ("  steady error, counts", |seen| seen.steady_error_counts, 0),
];

impl Comparison {
    /// The small step of each, foretold and on the rig; and the following error of the move, with and without friction.
    pub fn figure(&self) -> Figure {
        let panel = |y: &str, height: f64, series: Vec<Series>| Panel {
            x: "time, s".to_owned(),
            y: y.to_owned(),
            height,
            series,
        };
        let settled = |one: &Compared| one.forecast.as_ref()?.small_step.as_ref().map(|step| step.settling_s);
        // The quick ones must be seen, too.
        let mut settled: Vec<f64> = self.controllers.iter().filter_map(settled).collect();
        settled.sort_by(f64::total_cmp);
        let median = settled.get(settled.len() / 2).copied().unwrap_or(1.0);
        let last = settled.last().copied().unwrap_or(1.0).min(MEDIANS * median);
        let until = |points: &[(f64, f64)], last: f64| -> Vec<(f64, f64)> {
            points.iter().copied().filter(|(t, _)| *t <= last).collect()
        };
        let each = |style: Drawn, points: &dyn Fn(&Compared) -> Option<Points>| -> Vec<Series> {
            let one = |one: &Compared| Some(Series::new(one.name, style, points(one)?));
            self.controllers.iter().filter_map(one).collect()
        };
        let foretold = each(Drawn::Line, &|one| Some(until(&one.response, last)));
        let mut panels = vec![panel("small step, foretold", 0.75, foretold)];
        if self.controllers.iter().any(|one| one.shown.is_some()) {
            let stepped = each(Drawn::Steps, &|one| Some(until(&step_of(one)?.points, last)));
            panels.push(panel("small step, on the rig", 0.75, stepped));
            let error = |seen: &Seen| -> Vec<(f64, f64)> {
                // One that gives up has no set point any more.
                let goes = seen.wanted.windows(2).take_while(|pair| pair[1].1 >= pair[0].1).count() + 1;
                let pairs = seen.wanted.iter().zip(&seen.path).take(goes);
                until(&pairs.map(|((t, wanted), (_, y))| (*t, wanted - y)).collect::<Vec<_>>(), MOVE_SHOWN)
            };
            let plain = each(Drawn::Line, &|one| one.shown.as_ref().map(error));
            panels.push(panel("following error, counts", 0.75, plain));
            let rubbed = each(Drawn::Line, &|one| one.with_friction.as_ref().map(error));
            panels.push(panel(&format!("the same, {} % friction", 100.0 * self.friction), 0.75, rubbed));
        }
        Figure { title: format!("{}: P, PI, PD and PID", self.motor.subject), panels }
    }
}

/// So many times the median settling time of a small step is drawn.
const MEDIANS: f64 = 4.0;
/// So much of a move is drawn, in s: the move takes 3.6 s, and what an integral does comes after.
const MOVE_SHOWN: f64 = 8.0;
