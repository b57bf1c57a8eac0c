//! The servo stand's dialect: what the PC program and the controller of the positioning drive say to one another.
//!
//! Lab sheet "Napęd pozycjonujący liniowy z silnikiem prądu stałego" (Wrocław, exercise 2a): a PC with the program
//! Servo v1.0, an SAB80C535, RS-232. The sheet says what can be done over the line and what is confirmed; no byte of
//! it. The bytes are decided here. (Ours.)
//!
//! | command | bytes | answer |
//! |---|---|---|
//! | is somebody there? | `C` | `c` |
//! | set Kx, get Kx | `X` *v*, `x` | none, *v* |
//! | set Kv, get Kv | `V` *v*, `v` | none, *v* |
//! | download a program | `D` *low* *high* *dx1* … *dxn* | none |
//! | run it | `R` | one byte a tick of 5 ms, up to the end of the program |
//! | stop | `S` | none |
//! | here is 0 | `H` | none |
//!
//! *v* is one byte, 0 to 255; *low* and *high* are the number of increments, which are counts a tick, signed. So just
//! the three things are confirmed that the sheet names: Kx, Kv and the link. All else shows on the controller's LEDs.
//!
//! # During motion
//!
//! Each tick's byte is the low byte of the following error, which is a number of two bytes: shown with a sign, it is
//! right from −128 to 127, and wrong beyond without a sign of it (§3.1). See [`telemetry`] and [`shown`]. The sheet
//! calls −128 a limit like 128; but 128 is already shown as −128, and −128 is still right.
//!
//! A byte of telemetry cannot be told from an answer. So during motion the controller answers nothing, and acts on
//! nothing but `S`; what else comes is taken apart, so that no value in it is taken for an `S`, and dropped. The last
//! byte of a run is that of its last increment. Who wants to see the axis settle ends the program with a rest (`x0
//! t1`).
//!
//! Telemetry has every value that a byte can have, `XON` and `XOFF` among them: a PC must not let itself be held by
//! them.
//!
//! # What goes wrong on the line
//!
//! - **The line falls silent in mid-command** for more than [`GAP`]: what has come of it is dropped. A download that is
//!   cut short leaves no program at all, not the one before either: what runs is what was sent last, or nothing.
//! - **A byte is lost in a download**: it is short of one byte, and is cut short by the silence that follows.
//! - **A byte of its length is lost or garbled**: too long, it is cut short; too short, its rest would be commands. So
//!   a download is taken only when the line has been silent for [`PAUSE`] behind it. If it has not, it is dropped and
//!   leaves no program, and all that follows is dropped up to a silence of [`GAP`].
//! - **A character with a line error** drops the command that it is in, and all that follows up to a silence of
//!   [`GAP`]. Only `S` is obeyed even then: to stop is never wrong.
//! - **The link drops during motion**: the program is in the controller, which executes it to its end and holds the
//!   axis there. The PC's silence is no fault: it has nothing to say during a run.
//!
//! A PC that waits for [`PAUSE`] behind a download and then asks with `C` knows whether the controller has taken it for
//! one: if a byte was lost, the `C` is taken for the last increment and there is no answer. One that waits for [`GAP`]
//! between setting a gain and getting it cannot have its question taken for the value.

mod command;
mod telemetry;

use crate::clock::Rate;
use crate::time::Span;
use crate::uart::BITS_PER_CHARACTER;

pub use command::{Command, CommandDecoder, Flaw, Received};
pub use telemetry::{shown, telemetry};

/// The speed of the line, in baud; 8N1. Telemetry needs 2000. (Ours.)
pub const BAUD: u32 = 9600;
/// The same, as a rate.
pub const RATE: Rate = Rate::hz(BAUD);
/// The time of one character at [`BAUD`].
pub const CHARACTER: Span = Span::from_nanos(BITS_PER_CHARACTER * 1_000_000_000 / BAUD as u64);
/// The time between two increments, and between two bytes of telemetry: 200 a second (§3.1).
pub const TICK: Span = Span::from_millis(5);
/// A longer silence in mid-command drops what has come of it. (Ours.)
pub const GAP: Span = Span::from_millis(50);
/// A download is taken when nothing has come for so long behind it. (Ours.)
pub const PAUSE: Span = CHARACTER.times(3);
/// The answer to the question whether somebody is there. (Ours.)
pub const PRESENT: u8 = b'c';
/// Increments of the longest program: what two bytes can tell, 327 s.
pub const INCREMENTS_MAX: usize = u16::MAX as usize;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_character_takes_ten_bit_times_at_9600_baud() {
        assert_eq!((CHARACTER.as_nanos(), PAUSE.as_nanos()), (1_041_666, 3_124_998));
    }
}
