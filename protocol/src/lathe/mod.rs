//! The lathe's dialect: what its PC, its master and its slaves say to one another.
//!
//! Peña & Martínez, "Sistema electrónico de control de un torno CNC didáctico" (2009), §3, gives the eight bytes of
//! a frame, the master that distributes them and the rule that the PC waits while a process runs. All else here (the
//! units, the order of the bytes, the replies and the enquiries) the paper leaves open; it is decided here.

mod conversation;
mod frame;
mod program;
mod reply;

use crate::clock::Rate;
use crate::time::Span;
use crate::uart::BITS_PER_CHARACTER;

pub use conversation::{Conversation, Outcome};
pub use frame::{DepthPart, Direction, Frame, Refusal, SpindlePart, TransversePart};
pub use program::{Destination, Program, ProgramError};
pub use reply::{Fault, Reply, ReplyDecoder, Slave};

/// The speed of every link, in baud; 8N1. (Ours.)
pub const BAUD: u32 = 9600;
/// The same, as a rate.
pub const RATE: Rate = Rate::hz(BAUD);
/// The time of one character at [`BAUD`].
pub const CHARACTER: Span = Span::from_nanos(BITS_PER_CHARACTER * 1_000_000_000 / BAUD as u64);
/// A longer silence in mid-frame discards the part received. (Ours: no delimiter exists.)
pub const FRAME_GAP: Span = Span::from_millis(50);

/// Done; waiting for new instructions. To the PC: the frame has been distributed.
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
