//! The settings of the one board: those of the three that it takes the place of.

use torno_protocol::settings;
use torno_slaves::{DepthSettings, SpindleSettings, TransverseSettings};

settings! {
    /// The settings of the one board.
    pub struct DspicSettings {
        /// The main motor and its law.
        spindle: SpindleSettings;
        /// The feed axis and its law.
        transverse: TransverseSettings;
        /// The infeed axis and its law.
        depth: DepthSettings;
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
        let wrong = settings.check().unwrap_err();
        assert_eq!(wrong.to_string(), "depth.plant.rpm: expected 0.1 to 1000, found 0");
    }
}
