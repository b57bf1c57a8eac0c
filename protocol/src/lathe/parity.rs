//! The parity of a slave's sub-frames: what tells "done" from "I was given nothing".

use core::fmt;

/// Whether a slave has taken an even or an odd number of sub-frames since its start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Parity {
    /// Also before the first sub-frame.
    #[default]
    Even,
    /// One sub-frame more.
    Odd,
}

impl Parity {
    /// The letter on the wire. (Ours: they differ in two bits, so that no single flipped one makes the other.)
    pub const fn letter(self) -> u8 {
        match self {
            Self::Even => b'e',
            Self::Odd => b'o',
        }
    }

    /// The parity that a letter stands for.
    pub const fn from_letter(letter: u8) -> Option<Self> {
        match letter {
            b'e' => Some(Self::Even),
            b'o' => Some(Self::Odd),
            _ => None,
        }
    }

    /// The parity with one sub-frame more.
    #[must_use]
    pub const fn next(self) -> Self {
        match self {
            Self::Even => Self::Odd,
            Self::Odd => Self::Even,
        }
    }
}

impl fmt::Display for Parity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Even => "even",
            Self::Odd => "odd",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_are_two_bits_apart_and_come_back() {
        assert_eq!((Parity::Even.letter() ^ Parity::Odd.letter()).count_ones(), 2);
        for parity in [Parity::Even, Parity::Odd] {
            assert_eq!(Parity::from_letter(parity.letter()), Some(parity));
            assert_eq!(parity.next().next(), parity);
        }
        assert_eq!(
            (Parity::default(), Parity::Even.next(), Parity::Odd.next()),
            (Parity::Even, Parity::Odd, Parity::Even)
        );
        assert_eq!([Parity::Even, Parity::Odd].map(Parity::letter), [b'e', b'o']);
        assert_eq!([b'E', b'd', 0].map(Parity::from_letter), [None; 3]);
        assert_eq!([Parity::Even, Parity::Odd].map(|parity| parity.to_string()), ["even", "odd"]);
    }
}
