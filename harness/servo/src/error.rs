//! The following error behind its wrapped byte.

/// Makes the following error of its low bytes.
///
/// A tick changes it by less than 128 counts, so that what the byte leaves out follows from the bytes before: it begins
/// where it is right. (Ours: the sheet leaves the wrap to the eye.)
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Unwrapped {
    error: i64,
}

impl Unwrapped {
    /// Takes the next byte, as shown; gives the error in counts.
    pub fn push(&mut self, shown: i8) -> i64 {
        let change = shown.wrapping_sub(self.error as i8);
        self.error += i64::from(change);
        self.error
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_that_wraps_is_found_again() {
        let errors: Vec<i64> = (0..=300).chain((-300..300).rev()).collect();
        let mut unwrapped = Unwrapped::default();
        let found: Vec<i64> = errors.iter().map(|error| unwrapped.push(*error as i8)).collect();
        assert_eq!(found, errors);
    }
}
