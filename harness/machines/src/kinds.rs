//! The kinds of boards: what each machine declares of its own, and how a board of any kind is built.

use std::ops::Range;

use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::de::{DeTable, DeValue, ValueDeserializer};
use toml::{Spanned, Table};
use torno_protocol::board::{Board, Description, Kept, Pin};
use torno_protocol::clock::Clock;
use torno_protocol::record::{Grant, Heard, Report, Timed};
use torno_protocol::settings::{OutOfRange, Setting};
use torno_protocol::stepping::{BrokenPromise, Cell, Stepper};
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::{Receiver, ReceiverKind};
use torno_slaves::Slide;
use torno_text::{Complaint, of_toml};

use crate::MACHINES;
use crate::motor::{Motor, OnBench, Rehearsal};

/// A board's settings, as part of the text that they were read from.
pub type Settings<'a> = Spanned<DeValue<'a>>;

/// A board of any kind.
type Built = Box<dyn Steps>;

/// A kind of board, as its machine declares it.
pub struct Kind {
    /// Its name, as rig files say it.
    pub(crate) name: &'static str,
    /// Its settings as they are declared.
    pub(crate) settings: fn() -> Vec<Setting>,
    /// Builds a board of this kind as at power-on.
    pub(crate) build: fn(&Settings<'_>, Clock) -> Result<Built, Complaint>,
    /// The motor at this place among such a board's, or why none can be driven freely.
    pub(crate) motor: fn(&Settings<'_>, u8) -> Result<OnBench, Complaint>,
    /// What the law of the motor at this place does, if it has one that firmware could do, too.
    pub(crate) rehearsal: fn(&Settings<'_>, u8) -> Result<Option<Rehearsal>, Complaint>,
    /// The fullest drive of a motor that cannot be driven freely, in the unit of telemetry's `drive`; None if it has
    /// none.
    pub(crate) full_drive: fn(&Settings<'_>, u8) -> Result<Option<i64>, Complaint>,
    /// The carriage of the motor at this place among such a board's; None if it moves none.
    pub(crate) carriage: fn(&Settings<'_>, u8) -> Result<Option<Carriage>, Complaint>,
}

/// A motor's carriage.
#[derive(Clone, Debug)]
pub struct Carriage {
    /// How far it goes for each count of its encoder, in mm.
    pub mm_per_count: f64,
    /// From where to where it can go, in mm from where it stands at the start; None, if it turns.
    pub bed_mm: Option<(f64, f64)>,
    /// What follows it between two counts, if they are far apart.
    pub slide: Option<Slide>,
}

/// A board of any kind with its stepper.
pub trait Steps: Send {
    /// What the board consists of.
    fn description(&self) -> Description;

    /// The receiver of each of its ports at the start.
    fn receivers(&self) -> Vec<ReceiverKind>;

    /// Takes a grant.
    ///
    /// # Errors
    /// See [`Stepper::grant`].
    fn grant(&mut self, grant: Grant) -> Result<Report, BrokenPromise>;

    /// What the board keeps without power: see [`Stepper::kept`].
    fn kept(&self, until: Instant) -> Option<Kept>;

    /// Runs the board by itself, with all that it hears before `until`: see [`Cell::watch`]. For one as at power-on.
    fn watch(&self, heard: &[Heard], until: Instant) -> (Vec<Timed>, Vec<Pin>);

    /// The same, with a look at its quantities every so often: see [`Cell::sample`].
    fn sample(&self, heard: &[Heard], until: Instant, every: Span) -> Vec<(Instant, Vec<(u8, i64)>)>;
}

impl<B: Board + Send> Steps for Stepper<B> {
    fn description(&self) -> Description {
        self.board().description()
    }

    fn receivers(&self) -> Vec<ReceiverKind> {
        self.board().receivers().iter().map(Receiver::kind).collect()
    }

    fn grant(&mut self, grant: Grant) -> Result<Report, BrokenPromise> {
        Self::grant(self, grant)
    }

    fn kept(&self, until: Instant) -> Option<Kept> {
        Self::kept(self, until)
    }

    fn watch(&self, heard: &[Heard], until: Instant) -> (Vec<Timed>, Vec<Pin>) {
        Cell::watch(self.board().clone(), heard, until)
    }

    fn sample(&self, heard: &[Heard], until: Instant, every: Span) -> Vec<(Instant, Vec<(u8, i64)>)> {
        Cell::sample(self.board().clone(), heard, until, every)
    }
}

/// Why a board cannot be built.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum KindError {
    /// There is no such kind.
    #[error("unknown kind of board '{kind}': expected one of {}", names().join(", "))]
    Unknown {
        /// The kind that was asked for.
        kind: String,
    },
    /// Its settings are wrong.
    #[error("settings of this {kind}: {message}")]
    Settings {
        /// The kind of board.
        kind: String,
        /// What was expected, and what was found.
        message: String,
        /// Where in their text.
        span: Range<usize>,
    },
}

/// The names of all kinds.
pub fn names() -> Vec<&'static str> {
    MACHINES.iter().flat_map(|machine| machine.kinds).map(|kind| kind.name).collect()
}

fn find(kind: &str) -> Result<&'static Kind, KindError> {
    let mut known = MACHINES.iter().flat_map(|machine| machine.kinds);
    known.find(|known| known.name == kind).ok_or_else(|| KindError::Unknown { kind: kind.to_owned() })
}

/// The settings of a board of that kind as they are declared, for people.
///
/// # Errors
/// [`KindError::Unknown`].
pub fn settings(kind: &str) -> Result<Vec<Setting>, KindError> {
    Ok((find(kind)?.settings)())
}

/// Builds a board as at power-on. `settings` is TOML.
///
/// # Errors
/// [`KindError`] if there is no such kind, or its settings are wrong.
pub fn build(kind: &str, settings: &str, clock: Clock) -> Result<Box<dyn Steps>, KindError> {
    with(kind, settings, |found, settings| (found.build)(settings, clock))
}

/// The same from settings that are part of a larger text: it is this text that an error's span lies in.
///
/// # Errors
/// As there.
pub fn build_parsed(kind: &str, settings: &Settings<'_>, clock: Clock) -> Result<Box<dyn Steps>, KindError> {
    (find(kind)?.build)(settings, clock).map_err(|complaint| wrong(kind, complaint))
}

/// The motor at this place among those of a board of that kind with these settings (TOML), or in words why none can be
/// driven freely ("has no motor").
///
/// # Errors
/// [`KindError`] if there is no such kind, or its settings are wrong.
pub fn motor(kind: &str, settings: &str, motor: u8) -> Result<OnBench, KindError> {
    with(kind, settings, |found, settings| (found.motor)(settings, motor))
}

/// The carriage of the motor at this place among those of a board of that kind; None if it moves none. `settings` is
/// TOML.
///
/// # Errors
/// [`KindError`] if there is no such kind, or its settings are wrong.
pub fn carriage(kind: &str, settings: &str, motor: u8) -> Result<Option<Carriage>, KindError> {
    with(kind, settings, |found, settings| (found.carriage)(settings, motor))
}

/// The fullest drive of the motor at this place, in the unit of telemetry's `drive`, and in V, if that is known. None
/// if no one knows it.
///
/// # Errors
/// [`KindError`] if there is no such kind, or its settings are wrong.
pub fn full_drive(kind: &str, settings: &str, motor: u8) -> Result<Option<(i64, Option<f64>)>, KindError> {
    with(kind, settings, |found, settings| {
        let of_motor = |motor: Motor| (motor.full.1, (motor.input_unit == "V").then_some(motor.full.0));
        match (found.motor)(settings, motor)? {
            Ok(motor) => Ok(Some(of_motor(motor))),
            Err(_) => Ok((found.full_drive)(settings, motor)?.map(|full| (full, None))),
        }
    })
}

/// What the law of the motor at this place does on a board of that kind with these settings (TOML); None if it has no
/// law in its working form.
///
/// # Errors
/// [`KindError`] if there is no such kind, or its settings are wrong.
pub fn rehearsal(kind: &str, settings: &str, motor: u8) -> Result<Option<Rehearsal>, KindError> {
    with(kind, settings, |found, settings| (found.rehearsal)(settings, motor))
}

pub(crate) fn with<T>(
    kind: &str,
    settings: &str,
    then: impl Fn(&Kind, &Settings<'_>) -> Result<T, Complaint>,
) -> Result<T, KindError> {
    let found = find(kind)?;
    let table = DeTable::parse(settings).map_err(|error| wrong(kind, of_toml(&error)))?;
    let settings = Spanned::new(table.span(), DeValue::Table(table.into_inner()));
    then(found, &settings).map_err(|complaint| wrong(kind, complaint))
}

/// The settings of a board, read and checked.
pub(crate) fn read<S: DeserializeOwned + Default + Serialize>(
    settings: &Settings<'_>,
    check: impl Fn(&S) -> Result<(), OutOfRange>,
) -> Result<S, Complaint> {
    let read = S::deserialize(ValueDeserializer::from(settings.clone())).map_err(|error| {
        let (span, message) = of_toml(&error);
        (span, elsewhere::<S>(&message).unwrap_or(message))
    })?;
    match check(&read) {
        Ok(()) => Ok(read),
        Err(wrong) => {
            let place = wrong.field.split('.').try_fold(settings, |table, word| table.get_ref().get(word));
            Err((place.map_or(settings.span(), Spanned::span), wrong.to_string()))
        }
    }
}

/// A complaint about a field that is unknown where it stands and known in another table, with the other place.
fn elsewhere<S: Default + Serialize>(message: &str) -> Option<String> {
    let name = message.strip_prefix("unknown field `")?.split('`').next()?;
    let table = Table::try_from(S::default()).ok()?;
    let place = place_of(&table, name)?;
    Some(format!("unknown field `{name}`: did you mean '{place}'?"))
}

fn place_of(table: &Table, name: &str) -> Option<String> {
    table.iter().find_map(|(table, value)| {
        let inner = value.as_table()?;
        let deeper = if inner.contains_key(name) { Some(name.to_owned()) } else { place_of(inner, name) };
        deeper.map(|deeper| format!("{table}.{deeper}"))
    })
}

fn wrong(kind: &str, (span, message): Complaint) -> KindError {
    KindError::Settings { kind: kind.to_owned(), message, span }
}

/// A board with its stepper.
pub(crate) fn boxed<B: Board + Send + 'static>(board: B) -> Box<dyn Steps> {
    Box::new(Stepper::new(board))
}

#[cfg(test)]
mod tests {
    use torno_protocol::board::{Capability, Role};

    use super::*;

    #[test]
    fn a_count_is_what_screw_and_encoder_make_of_it() {
        let worth = |kind: &str, settings: &str, motor: u8| {
            carriage(kind, settings, motor).unwrap().map(|carriage| carriage.mm_per_count)
        };
        assert_eq!(worth("transverse", "", 0), Some(2.0 / 900.0));
        assert_eq!(worth("transverse", "plant.pitch_mm = 1.0", 0), Some(1.0 / 900.0));
        assert_eq!(worth("depth", "encoder.slots = 450", 0), Some(160.0 / 450.0));
        assert_eq!(worth("dspic", "depth.encoder.slots = 600", 2), Some(160.0 / 600.0));
        assert_eq!(worth("dspic", "transverse.plant.pitch_mm = 4.0", 1), Some(4.0 / 900.0));
        assert_eq!(worth("servo", "", 0), Some(1.0 / 125.0));
        assert_eq!([0, 3].map(|motor| worth("dspic", "", motor)), [None, None]);
        assert_eq!(worth("depth", "", 1), None);
        assert_eq!(worth("spindle", "", 0), None);
        assert!(carriage("lathe", "", 0).is_err());
    }

    /// Whatever the board, it is the value that a complaint points at: by the type, by the range or by the names.
    #[test]
    fn a_setting_out_of_range_is_told_where_it_stands() {
        for kind in names() {
            let declared = settings(kind).unwrap();
            assert!(!declared.is_empty(), "{kind}");
            for Setting { name, .. } in declared {
                let text = format!("# Too much.\n{name} = 4294967295");
                let Err(KindError::Settings { message, span, .. }) = build(kind, &text, Clock::TRUE) else {
                    panic!("{kind}: {name} may be 4294967295")
                };
                assert_eq!(&text[span], "4294967295", "{kind}: {message}");
            }
        }
    }

    #[test]
    fn a_number_out_of_range_is_told_with_the_range() {
        let told = |kind, settings| match build(kind, settings, Clock::TRUE) {
            Err(KindError::Settings { message, .. }) => message,
            _ => panic!("{kind}: {settings} is accepted"),
        };
        assert_eq!(told("master", "answer_ms = 1"), "answer_ms: expected 8 to 1000, found 1");
        assert_eq!(told("dspic", "depth.plant.rpm = 0"), "depth.plant.rpm: expected 0.1 to 1000, found 0");
    }

    #[test]
    fn a_default_is_in_its_range_and_a_setting_has_a_source() {
        for kind in names() {
            build(kind, "", Clock::TRUE).unwrap();
            assert!(settings(kind).unwrap().iter().all(|setting| !setting.source.is_empty()), "{kind}");
        }
    }

    #[test]
    fn a_motors_quantities_say_which_motor_they_are_about() {
        for kind in names() {
            let description = build(kind, "", Clock::TRUE).unwrap().description();
            for (motor, named) in (0..).zip(&description.motors) {
                let is_told = |role| description.signal(motor, role, None).is_some();
                if named.capabilities.contains(&Capability::Stepper) {
                    // Its set point and its position are lengths, and no one drives it freely.
                    assert!(is_told(Role::SetPoint) && is_told(Role::Position), "{kind} {}", named.name);
                    assert!(carriage(kind, "", motor).unwrap().is_some(), "{kind} {}", named.name);
                    continue;
                }
                assert!(is_told(Role::Drive), "{kind} {}", named.name);
                let full = full_drive(kind, "", motor).unwrap();
                assert!(full.is_some_and(|(full, _)| full > 0), "{kind} {}: {full:?}", named.name);
                let at = [Role::Position, Role::Speed].map(|role| description.signal(motor, role, Some("counts")));
                let is_axis = named.capabilities.contains(&Capability::Axis);
                assert_eq!(at.map(|place| place.is_some()), [is_axis, !is_axis], "{kind} {}", named.name);
                assert_eq!(carriage(kind, "", motor).unwrap().is_some(), is_axis, "{kind} {}", named.name);
            }
            let motors = description.signals.iter().filter_map(|signal| signal.motor);
            assert!(motors.max().is_none_or(|most| usize::from(most) + 1 == description.motors.len()), "{kind}");
        }
    }
}
