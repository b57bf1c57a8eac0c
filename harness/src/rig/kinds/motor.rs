//! A board's motor as seen from its bench: how to drive it, what its encoder counts, what regulates it.

use torno_slaves::{LeadForm, PositionForm, SpindleSettings};

use super::{KindError, Settings, settings_of};

/// What telemetry tells of a motor's shaft.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoder {
    /// The counts of the window that ends at the sample.
    Window(&'static str),
    /// The count since the start.
    Position(&'static str),
}

/// What regulates a motor: its settings' names, with dots if they are in a table, and their values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law {
    /// A lead compensator: its zero, its pole (negated) and its gain.
    Lead([(&'static str, f64); 3]),
    /// A PID: K1, K2 and K3.
    Pid([(&'static str, f64); 3]),
    /// It is switched on and off.
    OnOff,
}

/// A board's motor as seen from its bench: how to drive it, and what its encoder counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motor {
    /// What its encoder tells.
    pub encoder: Encoder,
    /// The time between samples, in ms of the board's clock.
    pub period_ms: u32,
    /// What one count is, in `unit`.
    pub count: f64,
    /// The unit of its position.
    pub unit: &'static str,
    /// Full drive in `input_unit`, and in the unit of telemetry's `drive`.
    pub full: (f64, i64),
    /// The unit of its drive.
    pub input_unit: &'static str,
    /// How far it can go either way, in counts; None if it turns for ever, and that one way only.
    pub travel: Option<u32>,
    /// What regulates it.
    pub law: Law,
    /// Its law is in one of the forms that show what is wrong in the paper.
    pub printed: Option<Form>,
}

/// A form of a law that is not the working one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// A lead compensator without its integrator: Eq. 7 at its word, or with feed-forward.
    Lead,
    /// Eq. 15 at its word.
    Pid,
    /// Fig. 9, with its gain Kch in units of drive per count.
    Proportional(f64),
    /// No loop.
    Open,
}

/// The motor of a board of that kind with these settings (TOML); None if it has none. Of several motors, the one with
/// this name.
///
/// # Errors
/// [`KindError`] if there is no such kind, or its settings are wrong.
pub fn motor(kind: &str, settings: &str, which: Option<&str>) -> Result<Option<Motor>, KindError> {
    let settings = match (settings_of(kind, settings)?, which) {
        (Settings::Dspic(settings), Some("spindle")) => Settings::Spindle(settings.spindle),
        (Settings::Dspic(settings), Some("transverse")) => Settings::Transverse(settings.transverse),
        (Settings::Dspic(settings), Some("depth")) => Settings::Depth(settings.depth),
        (settings, _) => settings,
    };
    Ok(match settings {
        // The stand's axis begins at the end of its travel: there is no room for a bench.
        Settings::Master(_) | Settings::Dspic(_) | Settings::Servo(_) => None,
        Settings::Spindle(SpindleSettings { drive, encoder, controller, .. }) => Some(Motor {
            encoder: Encoder::Window("speed_counts"),
            period_ms: controller.window_ms,
            count: core::f64::consts::TAU / f64::from(encoder.pulses_per_rev),
            unit: "rad",
            full: (drive.supply_v, greatest(drive.bits)),
            input_unit: "V",
            travel: None,
            law: Law::Lead([
                ("controller.alpha", controller.alpha),
                ("controller.beta", controller.beta),
                ("controller.k", controller.k),
            ]),
            printed: (controller.form != LeadForm::Incremental).then_some(Form::Lead),
        }),
        Settings::Transverse(settings) => {
            let controller = &settings.controller;
            let full = greatest(settings.drive.bits);
            Some(Motor {
                encoder: Encoder::Position("position_counts"),
                period_ms: controller.sample_ms,
                count: 1.0,
                unit: "counts",
                full: (full as f64, full),
                input_unit: "LSB",
                travel: Some((settings.counts(settings.plant.travel_mm) / 2.0) as u32),
                law: Law::Pid([
                    ("controller.k1", controller.k1),
                    ("controller.k2", controller.k2),
                    ("controller.k3", controller.k3),
                ]),
                printed: match controller.form {
                    PositionForm::Pid => None,
                    PositionForm::Literal => Some(Form::Pid),
                    PositionForm::Characterisation => Some(Form::Proportional(controller.kch)),
                    PositionForm::Open => Some(Form::Open),
                },
            })
        }
        Settings::Depth(settings) => Some(Motor {
            encoder: Encoder::Position("position_counts"),
            period_ms: settings.controller.poll_ms,
            count: 1.0 / settings.slots_per_mm(),
            unit: "mm",
            full: (1.0, 1),
            input_unit: "on",
            travel: Some((settings.plant.travel_mm * settings.slots_per_mm() / 2.0) as u32),
            law: Law::OnOff,
            printed: None,
        }),
    })
}

/// The greatest number of so many bits.
const fn greatest(bits: u32) -> i64 {
    (1 << bits) - 1
}
