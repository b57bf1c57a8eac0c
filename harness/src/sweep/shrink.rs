//! When a seed fails: the smallest set of its faults that still fails.

/// Leaves out one fault after the other as long as it still `fails`; gives what is left.
///
/// # Errors
/// Whatever `fails` gives.
pub fn shrink<E>(faults: &[String], mut fails: impl FnMut(&[String]) -> Result<bool, E>) -> Result<Vec<String>, E> {
    let mut left = faults.to_vec();
    let mut place = 0;
    while place < left.len() {
        let mut fewer = left.clone();
        fewer.remove(place);
        if fails(&fewer)? {
            left = fewer;
            place = 0;
        } else {
            place += 1;
        }
    }
    Ok(left)
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;

    #[test]
    fn what_does_not_matter_is_left_out() {
        let faults: Vec<String> = ["a", "b", "c", "d"].map(str::to_owned).to_vec();
        let fails = |set: &[String]| Ok::<_, Infallible>(["b", "d"].iter().all(|fault| set.iter().any(|f| f == fault)));
        assert_eq!(shrink(&faults, fails), Ok(vec!["b".to_owned(), "d".to_owned()]));
        assert_eq!(shrink(&faults, |_| Ok::<_, Infallible>(true)), Ok(vec![]));
    }
}
