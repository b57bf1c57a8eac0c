//! UARTs: characters made into edges and edges sampled back into characters.
//!
//! Both ends exist in two kinds. A **hardware** UART (the USART of the PIC16F87XA, DS39582B §10) shifts out on its own
//! bit clock and samples at 16 times the baud rate with a majority vote of three. A **software** UART lives in a
//! timer interrupt: its edges and samples fall on that interrupt's ticks, a little late. Nothing here is drawn from
//! a probability: framing errors, garbled bytes and breaks come out of the waveform and the two ends' clocks.

mod fifo;
mod format;
mod kind;
mod receiver;
mod transmitter;

use serde::{Deserialize, Serialize};

pub use fifo::Fifo;
pub use format::{DataBits, Format, Parity, StopBits};
pub use kind::ReceiverKind;
pub use receiver::{Ear, Receiver};
pub use transmitter::{Loaded, Transmitter};

use crate::clock::{Clock, Rate, Ticks};
use crate::time::{Instant, Span};

/// Bits of a character on the wire in [8N1](Format::EIGHT_N_ONE): start, eight data (least significant first), stop.
pub const BITS_PER_CHARACTER: u64 = 10;

/// What a receiver hands over for one character.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Character {
    /// The data bits: eight, unless the receiver has another format.
    pub byte: u8,
    /// The stop bit was not high (FERR).
    pub framing_error: bool,
    /// At least one character near this one was lost because no one fetched it in time (OERR).
    pub overrun: bool,
}

impl Character {
    /// A character received without error.
    pub const fn good(byte: u8) -> Self {
        Self { byte, framing_error: false, overrun: false }
    }

    /// The byte, if there was no error.
    pub const fn ok(self) -> Option<u8> {
        if self.framing_error || self.overrun { None } else { Some(self.byte) }
    }
}

/// The timer interrupt in which a board runs its software UARTs.
///
/// All links of a board share the ticks; each is served a little later than the one before it.
#[derive(Clone, Copy, Debug)]
pub struct TickTimer {
    baud: Rate,
    ticks: Ticks,
    per_bit: u64,
}

impl TickTimer {
    /// Ticks per bit time: the least that can centre a sample. (Ours; the paper gives no figure.)
    pub const TICKS_PER_BIT: u64 = 3;
    /// From the timer's overflow to the first link's port access. (Ours: 15 instruction cycles of 200 ns.)
    const ENTRY: Span = Span::from_nanos(3_000);
    /// From one link's port access to the next one's. (Ours: 20 instruction cycles.)
    const PER_LINK: Span = Span::from_nanos(4_000);

    /// A timer for links at `baud`, counting in `clock`, started with the rig.
    pub fn new(baud: Rate, clock: Clock) -> Self {
        let ticks = Ticks::new(Instant::START, baud.times(Self::TICKS_PER_BIT), clock);
        Self { baud, ticks, per_bit: Self::TICKS_PER_BIT }
    }

    /// Counts in `clock` from now on: the tick that is set stays, those after it follow in the new rhythm.
    pub fn retune(&mut self, now: Instant, clock: Clock) {
        let set = self.ticks.at(self.ticks.first_from(now));
        self.ticks = Self::new(self.baud, clock).ticks.from(set);
    }

    /// The latency with which the `n`-th link served by this timer is reached.
    fn latency(n: u32) -> Span {
        Self::ENTRY + Self::PER_LINK.times(u64::from(n))
    }

    /// The transmitter of the `n`-th link.
    pub fn transmitter(&self, n: u32) -> Transmitter {
        Transmitter::software(self.ticks, self.per_bit, Self::latency(n))
    }

    /// The receiver of the `n`-th link.
    pub fn receiver(&self, n: u32) -> Receiver {
        let kind = ReceiverKind::Software { baud: self.baud, link: n };
        Receiver::software(kind, self.ticks, self.per_bit, Self::latency(n))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_character_with_either_error_has_no_byte() {
        let good = Character { byte: 0x41, framing_error: false, overrun: false };
        assert_eq!((Character::good(0x41), good.ok()), (good, Some(0x41)));
        assert_eq!(Character { framing_error: true, ..good }.ok(), None);
        assert_eq!(Character { overrun: true, ..good }.ok(), None);
    }

    #[test]
    fn each_link_is_served_a_little_later_than_the_one_before() {
        assert_eq!([0, 1, 2].map(|n| TickTimer::latency(n).as_nanos()), [3_000, 7_000, 11_000]);
    }
}
