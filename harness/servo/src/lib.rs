//! The servo stand's motion language: what the program Servo v1.0 of the lab sheet "Napęd pozycjonujący liniowy z
//! silnikiem prądu stałego" (Wrocław, exercise 2a) makes of a text file.
//!
//! ```text
//! program  = { line } , "e" , EOL ;                      (* what follows is ignored (Ours.) *)
//! line     = [ element ] , EOL ;                         (* blank lines are skipped, and counted (Ours.) *)
//! element  = constant | accel ;                          (* its parameters in any order (Ours.) *)
//! constant = "x" number ws "t" number ;                  (* mm, s *)
//! accel    = "p" number ws "k" number ws "x" number ;    (* mm/s, mm/s, mm *)
//! number   = [ "-" ] digit { digit } [ ( "." | "," ) digit { digit } ] ;   (* the fraction: ours *)
//! ws       = ( " " | TAB ) { " " | TAB } ;
//! ```
//!
//! At constant speed v = x/t; with acceleration t = 2x/(p + k) and a = (k² − p²)/2x. Elements may begin at another
//! speed than the one before ends with: the sheet's first example starts at 5 mm/s from rest.
//!
//! The sheet has `p5 k0 1x` in one example. It is a misprint of `x1`: each of the others has the symbol first. Here it
//! is an unknown parameter.
//!
//! Pure: no I/O. [`compile`] tells everything that is wrong at once.

mod compile;
pub mod contour;
mod element;
mod error;
mod message;
mod motion;
mod set_points;

pub use compile::{Compiled, Limits, compile};
pub use element::Element;
pub use error::Unwrapped;
pub use message::{Finding, Language, Problem, Severity};
pub use motion::{Motion, Program};

/// Increments a second: the rate of the telemetry, which the sheet gives; that of the set point it does not. (Ours.)
pub const TICKS_PER_S: f64 = RATE as f64;
/// The same as a whole number.
const RATE: u32 = 200;
