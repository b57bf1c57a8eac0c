//! The receive buffer of a hardware UART.

use crate::uart::Character;

/// A two-deep receive buffer (DS39582B §10.2.2): a third character that completes before the firmware has fetched
/// one is lost, and so is everything after it until the buffer has been emptied (OERR).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Fifo {
    slots: [Option<Character>; 2],
    overrun: bool,
}

impl Fifo {
    /// Takes a character from the shift register.
    pub fn push(&mut self, character: Character) {
        match &mut self.slots {
            _ if self.overrun => {}
            [slot @ None, None] | [Some(_), slot @ None] => *slot = Some(character),
            _ => self.overrun = true,
        }
    }

    /// Whether there is nothing to fetch.
    pub const fn is_empty(&self) -> bool {
        self.slots[0].is_none()
    }

    /// What the firmware fetches next. After a loss every character carries the overrun flag until the buffer has been
    /// emptied: OERR can be read before a character is fetched, so none of them need be trusted.
    pub fn pop(&mut self) -> Option<Character> {
        let [first, second] = self.slots;
        self.slots = [second, None];
        let mut character = first?;
        character.overrun |= self.overrun;
        self.overrun &= second.is_some();
        Some(character)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fetched(bytes: &[u8]) -> Vec<(u8, bool)> {
        let mut fifo = Fifo::default();
        bytes.iter().for_each(|byte| fifo.push(Character::good(*byte)));
        core::iter::from_fn(|| fifo.pop()).map(|c| (c.byte, c.overrun)).collect()
    }

    #[test]
    fn holds_two() {
        assert_eq!(fetched(&[1, 2]), [(1, false), (2, false)]);
    }

    #[test]
    fn a_third_character_overruns_and_spoils_the_two_before_it() {
        assert_eq!(fetched(&[1, 2, 3, 4]), [(1, true), (2, true)]);
    }

    #[test]
    fn emptying_it_clears_the_overrun() {
        let mut fifo = Fifo::default();
        (1..=3).for_each(|byte| fifo.push(Character::good(byte)));
        while fifo.pop().is_some() {}
        fifo.push(Character::good(9));
        assert_eq!(fifo.pop(), Some(Character::good(9)));
    }
}
