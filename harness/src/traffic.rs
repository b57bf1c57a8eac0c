//! How much goes between the harness and a board's process.

use std::ops::{Add, Sub};

/// Bytes over a socket.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Bytes {
    /// To the other end.
    pub to: u64,
    /// From the other end.
    pub from: u64,
}

impl Add for Bytes {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { to: self.to + other.to, from: self.from + other.from }
    }
}

impl Sub for Bytes {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self { to: self.to - other.to, from: self.from - other.from }
    }
}
