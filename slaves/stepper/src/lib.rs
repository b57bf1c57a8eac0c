//! One closed-loop stepper axis: a drive, a stepper motor, a screw, a carriage, a belt, an encoder, the timer that
//! counts it, and the loop that finds lost steps. Nothing here does I/O or reads a clock.
//!
//! After "Research on Low-Cost Implementation of Closed-loop Control Program for a Small Engraving Machine" (Lu and
//! others, 2016), called the paper here. The paper gives the parts, the counter and the idea of a loop whose period is
//! a number of pulses; the models of the motor and of what goes wrong, and what the loop does about an error, are ours.
//!
//! # No deadline a pulse, and none a check
//!
//! Pulses come as [trains](torno_protocol::train::Train) at a constant rate. While one lasts, field, rotor and carriage
//! stand or move evenly, in few pieces, so where they are at an instant is a formula, and the first check that finds an
//! error is found by arithmetic. Quiet checks are counted and not run. So finer microsteps cost nothing.
//!
//! A rotor that swings is integrated in substeps, but only while it swings; then it is locked to the field, and all of
//! this holds again. It is looked ahead until the train ends; at rest, and with a loop that looks there too, for a
//! second. Then a deadline looks on.
//!
//! # Driving it
//!
//! An [`Axis`] is told its trains at the beginning of each segment. When its loop finds an error, it stops the train by
//! itself ([`LoopEvent::Stop`]), adds pulses ([`LoopEvent::Correct`]), and says when the program may go on
//! ([`LoopEvent::Resume`]) or that it gives up ([`LoopEvent::Alarm`]). Whether the other axes wait meanwhile is up to
//! the board.

mod axis;
mod closed_loop;
mod drive;
mod encoder;
mod fault;
mod machine;
mod mechanics;
mod plant;
mod prediction;
mod rotor;
mod scale;
mod search;
mod settings;
mod swing;
mod timer;
mod watch;

pub use axis::{Alarm, Axis, LoopEvent, State, Stats};
pub use closed_loop::Cause;
pub use encoder::Channels;
pub use fault::{Channel, Fault};
pub use scale::{PAPER_COUNT_PM, Scale};
pub use settings::{
    AxisSettings, CountScale, DriveSettings, EncoderSettings, Law, LoopSettings, MechanicsSettings, Mode,
    MotorSettings, Sensor, Transmission,
};
pub use timer::{FASTEST_HZ, SLOWEST_HZ};
