//! The lathe's dialect: what its PC, its master and its slaves say to one another.
//!
//! Peña & Martínez, "Sistema electrónico de control de un torno CNC didáctico" (2009), §3, gives the eight bytes of
//! a frame, the master that distributes them and the rule that the PC waits while a process runs. All else here (the
//! units, the order of the bytes, the replies and the enquiries) the paper leaves open; it is decided here.
//!
//! # Between the master and a slave
//!
//! The slave counts the sub-frames that it takes, from 0 at its start. It says `ACK` and the count's [`Parity`] when it
//! has executed one; asked with `ENQ`, the same if it is idle, `BEL` while it is busy, `CAN` and a letter while a fault
//! stands. The master counts the sub-frames that it gives. So an idle slave's answer tells whether it has executed its
//! sub-frame (and its `ACK` was lost) or was given nothing. An `ACK` alone tells neither, and the master asks again.
//!
//! - A parity that does not fit may be an answer that was under way when the sub-frame was sent, or spoilt. So the
//!   master asks once more, and only if it does not fit then either has the slave missed its sub-frame
//!   ([`Fault::Garbled`]).
//! - What begins like a sub-frame with the byte of `ENQ` and is cut there is answered like an enquiry. The parity tells
//!   that nothing has been executed.
//! - A slave that has restarted takes no sub-frame before it has said so: its count is 0 again, and what it was to
//!   hold is lost. It answers `CAN r` when asked; both count from 0 then.
//! - A restart or a loss of supply in the middle of a slave's reply leaves an `ACK` or a `CAN` without its letter. It
//!   tells nothing, and the master asks when the next enquiry is due.
//! - After any other fault, and while a slave does not answer, the master has no count; a fault stands until a
//!   sub-frame is taken, so that none can be missed unnoticed. It takes over the parity that it hears next.
//! - From its start on the master asks all slaves, and holds what the PC sends, until it knows what they are at and
//!   those that are busy are done.
//! - After `ENQ` the next sub-frame waits until its answer has come, at the latest: two characters after the slave's
//!   gap of three, behind two more if it was just reporting.
//!
//! # The master's start
//!
//! A master that restarts amid the machine's work has lost what it held, and does not know whether the PC is held.
//! It says `CAN m r`, as of every failure, and `XON` once all slaves are done, so that no PC stays held for ever. It
//! knows from its reset-cause register that it has not lost its supply, or, if it has, from a slave that has not. If
//! all have started with it, it says nothing: the machine has been switched on. (Ours.)

mod frame;
mod frame_decoder;
mod parity;
mod program;
mod reply;

use crate::clock::Rate;
use crate::time::Span;
use crate::uart::BITS_PER_CHARACTER;

pub use frame::{DepthSubFrame, Direction, Frame, Refusal, SpindleSubFrame, TransverseSubFrame};
pub use frame_decoder::FrameDecoder;
pub use parity::Parity;
pub use program::{Destination, Program, ProgramError};
pub use reply::{Fault, Party, Reply, ReplyDecoder, Slave};

/// The speed of every link, in baud; 8N1. (Ours.)
pub const BAUD: u32 = 9600;
/// The same, as a rate.
pub const RATE: Rate = Rate::hz(BAUD);
/// The time of one character at [`BAUD`].
pub const CHARACTER: Span = Span::from_nanos(BITS_PER_CHARACTER * 1_000_000_000 / BAUD as u64);
/// A longer silence in mid-frame discards what has come of the frame. (Ours: no delimiter exists.)
pub const FRAME_GAP: Span = Span::from_millis(50);

/// Done; a [`Parity`] follows. To the PC, alone: the frame has been distributed.
pub const ACK: u8 = 0x06;
/// The PC may go on.
pub const XON: u8 = 0x11;
/// The frame is held, and so is the PC.
pub const XOFF: u8 = 0x13;
/// A frame is refused; a letter follows that says why.
pub const NAK: u8 = 0x15;
/// Something failed; one or two letters follow that say what and how.
pub const CAN: u8 = 0x18;
/// Master to slave: are you there?
pub const ENQ: u8 = 0x05;
/// Slave to master: busy.
pub const BEL: u8 = 0x07;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_character_takes_ten_bit_times_at_9600_baud() {
        assert_eq!(CHARACTER.as_nanos(), 1_041_666);
    }
}
