//! What goes over the lines of a rig: characters out of edges, messages out of characters by the dialect of each line,
//! and the UART with which a program outside the rig, or inside it, takes part.
//!
//! No machine is known here; each says in a [`Dialect`] what its lines mean.

mod dialect;
mod ear;
mod names;
mod pc;
mod replies;

pub use dialect::{
    Dialect, Dialects, Listener, Message, Phase, Reader, Readers, Reply, Stopwatch, hex, is_stray_byte, no_reply,
};
pub use ear::{Ears, LineCharacter};
pub use names::Names;
pub use pc::{Answer, BAUD, Conversation, Outside, PcEvent, PcUart, RECEIVED, STOPPED};
pub use replies::Replies;
