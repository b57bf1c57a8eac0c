//! Numbers as the firmware reads and prints them: 32-bit floating point, eight digits.

/// More digits than this are not kept.
const DIGITS: usize = 8;

/// Reads the number at the start of `text`; gives it and what follows. There is no exponent.
pub(crate) fn read(text: &[u8]) -> Option<(f32, &[u8])> {
    let (negative, mut rest) = match text {
        [b'-', rest @ ..] => (true, rest),
        [b'+', rest @ ..] => (false, rest),
        _ => (false, text),
    };
    let (mut kept, mut digits, mut exponent, mut point) = (0u32, 0, 0i32, false);
    while let [c, after @ ..] = rest {
        match c {
            b'0'..=b'9' => {
                digits += 1;
                if digits <= DIGITS {
                    kept = kept * 10 + u32::from(c - b'0');
                    exponent -= i32::from(point);
                } else {
                    exponent += i32::from(!point);
                }
            }
            b'.' if !point => point = true,
            _ => break,
        }
        rest = after;
    }
    if digits == 0 {
        return None;
    }
    // In steps of two decimals, then one, as rounding depends on it.
    let mut value = kept as f32;
    for _ in 0..-exponent / 2 {
        value *= 0.01;
    }
    if exponent < 0 && exponent % 2 != 0 {
        value *= 0.1;
    }
    for _ in 0..exponent {
        value *= 10.0;
    }
    Some((if negative { -value } else { value }, rest))
}

/// A number as the chip makes an unsigned integer of it: cut off, a negative one as its complement. One that 32 bits do
/// not hold is 0.
pub(crate) fn unsigned(value: f32) -> u32 {
    let whole = libm::truncf(value);
    if whole.abs() < 4_294_967_296.0 { whole as i64 as u32 } else { 0 }
}

/// The same for a signed integer. One that 32 bits do not hold is the least that they hold.
pub(crate) fn signed(value: f32) -> i32 {
    let whole = libm::truncf(value);
    if whole.abs() < 2_147_483_648.0 { whole as i32 } else { i32::MIN }
}

/// Prints a number with so many decimals, half up.
pub(crate) fn print(value: f32, decimals: usize) -> String {
    let mut scaled = value.abs();
    for _ in 0..decimals / 2 {
        scaled *= 100.0;
    }
    if decimals % 2 == 1 {
        scaled *= 10.0;
    }
    let digits = format!("{:0width$}", signed(scaled + 0.5).unsigned_abs(), width = decimals + 1);
    let sign = if value < 0.0 { "-" } else { "" };
    let (whole, fraction) = digits.split_at(digits.len() - decimals);
    if decimals == 0 { format!("{sign}{whole}") } else { format!("{sign}{whole}.{fraction}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_as_far_as_they_go() {
        let value = |text: &str| read(text.as_bytes()).map(|(value, rest)| (value, rest.len()));
        assert_eq!(value("10.25X"), Some((10.25, 1)));
        assert_eq!(value("+3"), Some((3.0, 0)));
        assert_eq!(value("-.5"), Some((-0.5, 0)));
        assert_eq!(value("1."), Some((1.0, 0)));
        assert_eq!(value("1.2.3"), Some((1.2, 2)));
        assert_eq!(value("1E3"), Some((1.0, 2)));
        assert_eq!(value("123456789"), Some((123_456_780.0, 0)), "the ninth digit is not kept");
        assert_eq!(value("0.000000001"), Some((0.0, 0)));
        assert_eq!((value(""), value("-"), value("."), value("--1"), value("X")), (None, None, None, None, None));
    }

    #[test]
    fn numbers_are_printed_with_their_decimals() {
        assert_eq!(print(250.0, 3), "250.000");
        assert_eq!(print(-0.002, 3), "-0.002");
        assert_eq!(print(0.0005, 3), "0.001");
        assert_eq!(print(999.5, 0), "1000");
        assert_eq!(print(1.5, 1), "1.5");
        assert_eq!(print(0.25, 4), "0.2500");
    }

    #[test]
    fn a_number_too_large_to_print_is_cut_off() {
        assert_eq!(print(1e10, 3), "2147483.648");
    }

    #[test]
    fn integers_are_made_of_numbers_as_on_the_chip() {
        for (value, expected) in [(2.9, 2), (-1.0, u32::MAX), (4e9, 4_000_000_000), (4.3e9, 0), (f32::INFINITY, 0)] {
            assert_eq!(unsigned(value), expected, "{value}");
        }
        for (value, expected) in [(2.9, 2), (-1.5, -1), (2e9, 2_000_000_000), (3e9, i32::MIN), (-3e9, i32::MIN)] {
            assert_eq!(signed(value), expected, "{value}");
        }
    }
}
