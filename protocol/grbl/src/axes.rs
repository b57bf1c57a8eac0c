//! The axes: three of them, X, Y and Z, or four with A.

/// The most axes that there can be.
pub const MOST: usize = 4;

/// Something for each axis: X, Y, Z, A. Without an A axis, its entry is at rest: 0, or false.
pub type Axes<T = f32> = [T; MOST];

/// Their letters.
pub const LETTERS: Axes<u8> = *b"XYZA";

pub(crate) const X: usize = 0;
pub(crate) const Z: usize = 2;
/// It turns: its words are degrees, in whatever units the others are.
pub(crate) const A: usize = 3;

/// Which axis has the letter, if there are so many axes.
pub(crate) fn of_letter(letter: u8, count: usize) -> Option<usize> {
    LETTERS.iter().take(count).position(|axis| *axis == letter)
}
