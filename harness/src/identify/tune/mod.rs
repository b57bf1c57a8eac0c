//! From a motor that is known to a controller for it: proposed, foretold, and shown on the rig.

mod code;
mod compare;
mod error;
mod figure;
mod forecast;
mod rig;
mod text;

use serde::Serialize;
use torno_identify::{Finding, FirstOrder, response};
use torno_machines::motor::Law;

use super::bench::Subject;
use super::report::Identification;
use crate::rig::file::RigFile;
pub use code::{Code, Language};
pub use compare::{Compared, Comparison};
pub use error::TuneError;
pub use forecast::{Controller, Forecast, Indices};
use forecast::{present_loop, without_loop};
use rig::{FORM, SPEED, small_step, smooth, watch, watched, with_settings, working_form};
pub use rig::{Seen, SmallStep, Verdict};

/// The form of the compensator that, with a gain of 0, drives with what the set point takes.
const WITHOUT_LOOP: &str = "feed-forward";

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
    /// The dead time of the rig's plant, or without a rig of the data, in s: the forecasts do not have it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dead_s: Option<f64>,
    /// What it will do.
    pub forecast: Forecast,
    /// What the rig's own controller does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub present: Option<Forecast>,
    /// What is wrong with it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub present_finding: Option<String>,
    /// A speed that nothing regulates, foretold: the response to a small step of the drive.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub open_loop: Option<Indices>,
    /// On the rig, as foretold: the main motor from rest to 2000 rpm, the drive within its limits.
    pub foretold: Option<Indices>,
    /// On the rig, with what is proposed.
    pub shown: Option<Seen>,
    /// On the rig, as it is.
    pub shown_present: Option<Seen>,
    /// A speed on the rig without a loop: the drive is what the set point takes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shown_open: Option<Seen>,
    #[serde(skip)]
    controller: Controller,
    #[serde(skip)]
    foretold_path: Vec<(f64, f64)>,
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
        let open_loop = if motor.axis { None } else { without_loop(&model, period) };
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
        let dead_s = match on_rig {
            Some((_, subject)) => Some(subject.motor.dead_s).filter(|dead| *dead > 0.0),
            None => motor.result.dead_s,
        };
        let placed = |name: &str| on_rig.map_or_else(|| name.to_owned(), |(_, subject)| subject.setting(name));
        let settings: Vec<(String, f64)> = names.map(placed).into_iter().zip(controller.values()).collect();
        let mut tuning = Self {
            motor,
            law,
            form,
            settings,
            dead_s,
            forecast,
            present: None,
            present_finding: None,
            open_loop,
            foretold: None,
            shown: None,
            shown_present: None,
            shown_open: None,
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
        let mut shown = watch(&tuned, subject, seconds).await?;
        shown.small_step = small_step(&tuned, subject, &self.controller, seconds).await?;
        self.shown = Some(shown);
        let mut present = watch(file, subject, seconds).await?;
        if let Some(controller) = Controller::of(&subject.motor.law) {
            present.small_step = small_step(file, subject, &controller, seconds).await?;
        }
        self.shown_present = Some(present);
        if let Law::Lead([.., (gain, _)]) = subject.motor.law {
            let form = (subject.setting(FORM), WITHOUT_LOOP);
            let open = with_settings(file, subject, Some(&form), &[(subject.setting(gain), 0.0)])?;
            self.shown_open = Some(watch(&open, subject, seconds).await?);
        }
        Ok(())
    }
}
