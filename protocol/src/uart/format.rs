//! The format of a character: how many bits it has, and which.

use serde::{Deserialize, Serialize};

use crate::line::Level;

/// The format of a character: a start bit, data bits (least significant first), a parity bit or none, stop bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Format {
    /// How many data bits.
    pub data: DataBits,
    /// The parity bit.
    pub parity: Parity,
    /// How many stop bits.
    pub stop: StopBits,
}

/// How many data bits a character has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum DataBits {
    /// 5.
    Five,
    /// 6.
    Six,
    /// 7.
    Seven,
    /// 8.
    #[default]
    Eight,
}

/// The parity bit of a character.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Parity {
    /// There is none.
    #[default]
    None,
    /// With it, the number of bits that are 1 is odd.
    Odd,
    /// With it, the number of bits that are 1 is even.
    Even,
    /// It is always 1.
    Mark,
    /// It is always 0.
    Space,
}

/// How many stop bits a character has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum StopBits {
    /// 1.
    #[default]
    One,
    /// 2.
    Two,
}

impl DataBits {
    /// So many; none if no UART has that.
    pub const fn from_number(bits: u8) -> Option<Self> {
        match bits {
            5 => Some(Self::Five),
            6 => Some(Self::Six),
            7 => Some(Self::Seven),
            8 => Some(Self::Eight),
            _ => None,
        }
    }

    /// How many.
    pub const fn number(self) -> u8 {
        match self {
            Self::Five => 5,
            Self::Six => 6,
            Self::Seven => 7,
            Self::Eight => 8,
        }
    }
}

impl Format {
    /// 8N1.
    pub const EIGHT_N_ONE: Self = Self { data: DataBits::Eight, parity: Parity::None, stop: StopBits::One };

    /// Bits from the start bit to the last stop bit.
    pub const fn bits(self) -> u64 {
        self.first_stop_bit()
            + match self.stop {
                StopBits::One => 1,
                StopBits::Two => 2,
            }
    }

    /// The place of the first stop bit, which receivers check; the start bit's is 0.
    pub(super) const fn first_stop_bit(self) -> u64 {
        let parity = if matches!(self.parity, Parity::None) { 0 } else { 1 };
        1 + self.data.number() as u64 + parity
    }

    /// The level of bit `n` of the character of `byte`.
    pub(super) const fn level(self, byte: u8, n: u64) -> Level {
        let data = self.data.number() as u64;
        let is_high = match n {
            0 => false,
            n if n <= data => byte >> (n - 1) & 1 == 1,
            n if n < self.first_stop_bit() => self.parity_bit(byte),
            _ => true,
        };
        if is_high { Level::High } else { Level::Low }
    }

    const fn parity_bit(self, byte: u8) -> bool {
        let unused = 8 - self.data.number();
        let is_odd = (byte << unused).count_ones() % 2 == 1;
        match self.parity {
            Parity::Even => is_odd,
            Parity::Odd => !is_odd,
            Parity::Mark | Parity::None => true,
            Parity::Space => false,
        }
    }
}

/// As `8N1`.
impl core::fmt::Display for Format {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let parity = match self.parity {
            Parity::None => 'N',
            Parity::Odd => 'O',
            Parity::Even => 'E',
            Parity::Mark => 'M',
            Parity::Space => 'S',
        };
        let stop = match self.stop {
            StopBits::One => 1,
            StopBits::Two => 2,
        };
        write!(f, "{}{parity}{stop}", self.data.number())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn format(data: u8, parity: Parity, stop: StopBits) -> Format {
        Format { data: DataBits::from_number(data).unwrap(), parity, stop }
    }

    /// The character of a byte as ones and zeros, the start bit first.
    fn drawn(format: Format, byte: u8) -> String {
        (0..format.bits()).map(|n| if format.level(byte, n) == Level::High { '1' } else { '0' }).collect()
    }

    #[test]
    fn a_format_says_every_bit_of_a_character() {
        use Parity::{Even, Mark, None, Odd, Space};
        use StopBits::{One, Two};
        for (data, parity, stop, byte, name, expected) in [
            (8, None, One, 0xa5, "8N1", "0101001011"),
            (8, Even, One, 0xa5, "8E1", "01010010101"),
            (8, Even, One, 0xa4, "8E1", "00010010111"),
            (8, Odd, One, 0xa5, "8O1", "01010010111"),
            (7, Even, Two, 0xff, "7E2", "01111111111"),
            (7, Odd, One, 0x7f, "7O1", "0111111101"),
            (5, None, Two, 0xe1, "5N2", "01000011"),
            (6, Space, One, 0x3f, "6S1", "011111101"),
            (8, Mark, One, 0x00, "8M1", "00000000011"),
        ] {
            let format = format(data, parity, stop);
            assert_eq!((format.to_string().as_str(), drawn(format, byte).as_str()), (name, expected));
        }
    }

    #[test]
    fn no_uart_has_four_data_bits_or_nine() {
        assert_eq!([4, 9].map(DataBits::from_number), [None, None]);
        assert_eq!((5..=8).filter_map(DataBits::from_number).map(DataBits::number).collect::<Vec<_>>(), [5, 6, 7, 8]);
    }
}
