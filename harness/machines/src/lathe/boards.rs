//! The kinds of the lathe's boards, and their motors as seen from a bench.

use torno_dspic::{Dspic, DspicSettings};
use torno_master::{Master, MasterSettings};
use torno_protocol::lathe::Slave;
use torno_slaves::{
    Depth, DepthSettings, LeadForm, PositionForm, Rehearsal, Slide, Spindle, SpindleSettings, Transverse,
    TransverseSettings,
};

use crate::kinds::{Carriage, Kind, boxed, read};
use crate::motor::{Encoder, Form, Law, Motor, NO_MOTOR};

/// The kinds of the lathe's boards.
pub(super) const KINDS: [Kind; 5] = [
    Kind {
        name: "master",
        settings: MasterSettings::declared,
        build: |settings, clock| Ok(boxed(Master::new(&read(settings, MasterSettings::check)?, clock))),
        motor: |settings, _| read(settings, MasterSettings::check).map(|_| Err(NO_MOTOR)),
        rehearsal: |_, _| Ok(None),
        full_drive: |_, _| Ok(None),
        carriage: |settings, _| read(settings, MasterSettings::check).map(|_| None),
    },
    Kind {
        name: "spindle",
        settings: SpindleSettings::declared,
        build: |settings, clock| Ok(boxed(Spindle::new(&read(settings, SpindleSettings::check)?, clock))),
        motor: |settings, motor| {
            let settings = read(settings, SpindleSettings::check)?;
            Ok(if motor == 0 { Ok(spindle(&settings)) } else { Err(NO_MOTOR) })
        },
        rehearsal: |settings, _| Ok(Rehearsal::of_speed(&read(settings, SpindleSettings::check)?)),
        full_drive: |_, _| Ok(None),
        carriage: |settings, _| read(settings, SpindleSettings::check).map(|_| None),
    },
    Kind {
        name: "transverse",
        settings: TransverseSettings::declared,
        build: |settings, clock| Ok(boxed(Transverse::new(&read(settings, TransverseSettings::check)?, clock))),
        motor: |settings, motor| {
            let settings = read(settings, TransverseSettings::check)?;
            Ok(if motor == 0 { Ok(transverse(&settings)) } else { Err(NO_MOTOR) })
        },
        rehearsal: |settings, _| Ok(Rehearsal::of_feed(&read(settings, TransverseSettings::check)?)),
        full_drive: |_, _| Ok(None),
        carriage: |settings, motor| {
            let settings = read(settings, TransverseSettings::check)?;
            Ok((motor == 0).then(|| feed(&settings)))
        },
    },
    Kind {
        name: "depth",
        settings: DepthSettings::declared,
        build: |settings, clock| Ok(boxed(Depth::new(&read(settings, DepthSettings::check)?, clock))),
        motor: |settings, motor| {
            let settings = read(settings, DepthSettings::check)?;
            Ok(if motor == 0 { Ok(depth(&settings)) } else { Err(NO_MOTOR) })
        },
        rehearsal: |_, _| Ok(None),
        full_drive: |_, _| Ok(None),
        carriage: |settings, motor| {
            let settings = read(settings, DepthSettings::check)?;
            Ok((motor == 0).then(|| infeed(&settings)))
        },
    },
    Kind {
        name: "dspic",
        settings: DspicSettings::declared,
        build: |settings, clock| Ok(boxed(Dspic::new(&read(settings, DspicSettings::check)?, clock))),
        motor: |settings, motor| {
            let settings = read(settings, DspicSettings::check)?;
            Ok(match Slave::ALL.get(usize::from(motor)) {
                Some(Slave::Spindle) => Ok(spindle(&settings.spindle)),
                Some(Slave::Transverse) => Ok(transverse(&settings.transverse)),
                Some(Slave::Depth) => Ok(depth(&settings.depth)),
                None => Err(NO_MOTOR),
            })
        },
        rehearsal: |settings, motor| {
            let settings = read(settings, DspicSettings::check)?;
            Ok(match Slave::ALL.get(usize::from(motor)) {
                Some(Slave::Spindle) => Rehearsal::of_speed(&settings.spindle),
                Some(Slave::Transverse) => Rehearsal::of_feed(&settings.transverse),
                Some(Slave::Depth) | None => None,
            })
        },
        full_drive: |_, _| Ok(None),
        carriage: |settings, motor| {
            let settings = read(settings, DspicSettings::check)?;
            Ok(match Slave::ALL.get(usize::from(motor)) {
                Some(Slave::Transverse) => Some(feed(&settings.transverse)),
                Some(Slave::Depth) => Some(infeed(&settings.depth)),
                Some(Slave::Spindle) | None => None,
            })
        },
    },
];

fn feed(settings: &TransverseSettings) -> Carriage {
    let half = settings.plant.travel_mm / 2.0;
    Carriage { mm_per_count: 1.0 / settings.counts(1.0), bed_mm: Some((-half, half)), slide: None }
}

fn infeed(settings: &DepthSettings) -> Carriage {
    let half = settings.plant.travel_mm / 2.0;
    let slide = Some(Slide::new(settings));
    Carriage { mm_per_count: 1.0 / settings.slots_per_mm(), bed_mm: Some((-half, half)), slide }
}

fn spindle(SpindleSettings { plant, drive, encoder, controller }: &SpindleSettings) -> Motor {
    Motor {
        encoder: Encoder::Window,
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
        jitter_us: controller.jitter_us,
        dead_s: plant.dead_ms / 1_000.0,
        printed: (controller.form != LeadForm::Incremental).then_some(Form::Lead),
    }
}

fn transverse(settings: &TransverseSettings) -> Motor {
    let controller = &settings.controller;
    let full = greatest(settings.drive.bits);
    Motor {
        encoder: Encoder::Position,
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
        jitter_us: controller.jitter_us,
        dead_s: settings.plant.dead_ms / 1_000.0,
        printed: match controller.form {
            PositionForm::Pid => None,
            PositionForm::Literal => Some(Form::Pid),
            PositionForm::Characterisation => Some(Form::Proportional(controller.kch)),
            PositionForm::Open => Some(Form::Open),
        },
    }
}

fn depth(settings: &DepthSettings) -> Motor {
    Motor {
        encoder: Encoder::Position,
        period_ms: settings.controller.poll_ms,
        count: 1.0 / settings.slots_per_mm(),
        unit: "mm",
        full: (1.0, 1),
        input_unit: "on",
        travel: Some((settings.plant.travel_mm * settings.slots_per_mm() / 2.0) as u32),
        law: Law::OnOff,
        jitter_us: 0,
        dead_s: 0.0,
        printed: None,
    }
}

/// The greatest number of so many bits.
const fn greatest(bits: u32) -> i64 {
    (1 << bits) - 1
}
