//! The settings of the one board: those of the three that it takes the place of.

use serde::{Deserialize, Serialize};
use torno_slaves::{DepthSettings, SpindleSettings, TransverseSettings};

/// The settings of the one board.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DspicSettings {
    /// The main motor and its law.
    pub spindle: SpindleSettings,
    /// The feed axis and its law.
    pub transverse: TransverseSettings,
    /// The infeed axis and its law.
    pub depth: DepthSettings,
}

impl DspicSettings {
    /// Checks every field's range.
    ///
    /// # Errors
    /// The first field that is out of range: its name, what was expected, what was found.
    pub fn check(&self) -> Result<(), String> {
        let of = |motor: &'static str| move |message: String| format!("{motor}.{message}");
        self.spindle.check().map_err(of("spindle"))?;
        self.transverse.check().map_err(of("transverse"))?;
        self.depth.check().map_err(of("depth"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_out_of_range_is_told_with_its_motor() {
        assert_eq!(DspicSettings::default().check(), Ok(()));
        let mut settings = DspicSettings::default();
        settings.depth.plant.rpm = 0.0;
        assert_eq!(settings.check(), Err("depth.plant.rpm: expected 0.1 to 1000, found 0".to_owned()));
    }
}
