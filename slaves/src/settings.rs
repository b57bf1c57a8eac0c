//! What the checks of all settings have in common.

/// Accepts `found` from `least` to `most`. Not-a-number and the infinities lie outside every range.
pub(crate) fn within(field: &str, found: impl Into<f64>, least: f64, most: f64) -> Result<(), String> {
    let found = found.into();
    if found >= least && found <= most {
        return Ok(());
    }
    Err(format!("{field}: expected {least} to {most}, found {found}"))
}

/// A drive in per mille of the largest, in LSB: never more than the largest, either way.
pub(crate) fn service_drive(per_mille: i32, largest: f64) -> i64 {
    (f64::from(per_mille.clamp(-1_000, 1_000)) / 1_000.0 * largest).round() as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_belong_to_the_range_and_nan_does_not() {
        assert_eq!(within("tau_s", 1.0, 1.0, 2.0), Ok(()));
        assert_eq!(within("tau_s", 2.0, 1.0, 2.0), Ok(()));
        assert_eq!(within("tau_s", 2.5, 1.0, 2.0), Err("tau_s: expected 1 to 2, found 2.5".to_owned()));
        assert!(within("tau_s", f64::NAN, 1.0, 2.0).is_err());
        assert!(within("tau_s", f64::INFINITY, 1.0, f64::MAX).is_err());
    }
}
