//! The following error on the line: one byte of its two.

/// The byte that reports a following error of so many counts: its low one (§3.1).
pub const fn telemetry(error: i64) -> u8 {
    error as u8
}

/// The following error that the PC shows for such a byte, in counts.
pub const fn shown(byte: u8) -> i8 {
    byte as i8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beyond_its_range_it_wraps() {
        for (error, expected) in
            [(127, 127), (128, -128), (-128, -128), (-129, 127), (200, -56), (256, 0), (162, -94), (0, 0)]
        {
            assert_eq!(shown(telemetry(error)), expected, "{error}");
        }
    }
}
