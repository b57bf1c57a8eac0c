//! Drives: what a port's number and its pins become at the motor.

/// The greatest number of so many bits.
pub(crate) fn full(bits: u32) -> f64 {
    f64::from((1_u32 << bits.min(24)) - 1)
}

/// A drive in per mille of the fullest, in LSB: never more than the fullest, either way.
pub(crate) fn service(per_mille: i32, full: f64) -> i64 {
    (f64::from(per_mille.clamp(-1_000, 1_000)) / 1_000.0 * full).round() as i64
}

/// A pulse-width modulator on one transistor: it drives one way, or lets the motor coast (§4).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pwm {
    full: f64,
}

impl Pwm {
    pub(crate) fn new(bits: u32) -> Self {
        Self { full: full(bits) }
    }

    /// The nearest width to a share of the whole period, in LSB.
    pub(crate) fn width(self, share: f64) -> i64 {
        (share * self.full).round().max(0.0).min(self.full) as i64
    }

    /// The longest width, in LSB.
    pub(crate) fn full(self) -> f64 {
        self.full
    }

    /// The share of the whole period that a width is.
    pub(crate) fn share(self, width: i64) -> f64 {
        width as f64 / self.full
    }
}

/// An H-bridge: a magnitude of some bits, and a pin for each sense (§4). With neither pin it does not drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Bridge {
    magnitude: u32,
    forward: bool,
    backward: bool,
}

impl Bridge {
    /// What the firmware puts out for a drive with a sign.
    pub(crate) fn set(drive: i64) -> Self {
        let magnitude = u32::try_from(drive.unsigned_abs()).unwrap_or(u32::MAX);
        Self { magnitude, forward: drive > 0, backward: drive < 0 }
    }

    /// What drives the motor, in LSB: the magnitude in the sense of the pin that is set.
    pub(crate) fn drive(self) -> f64 {
        f64::from(self.magnitude) * (f64::from(u8::from(self.forward)) - f64::from(u8::from(self.backward)))
    }

    /// The largest drive of so many bits, in LSB.
    pub(crate) fn full(bits: u32) -> f64 {
        full(bits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_width_is_whole_and_within_its_bits() {
        let pwm = Pwm::new(10);
        assert_eq!([-0.5, 0.0, 0.27556, 0.9999, 7.0].map(|share| pwm.width(share)), [0, 0, 282, 1_023, 1_023]);
        assert_eq!((pwm.share(1_023), Pwm::new(8).width(1.0)), (1.0, 255));
    }

    #[test]
    fn the_service_mode_drives_in_per_mille_and_never_more_than_fully() {
        let drives = [0, 1, 500, -500, 1_000, -1_000, 1_001, i32::MAX, i32::MIN].map(|drive| service(drive, 255.0));
        assert_eq!(drives, [0, 0, 128, -128, 255, -255, 255, 255, -255]);
        assert_eq!(
            (Pwm::new(10).full(), Pwm::new(24).full(), Pwm::new(30).full()),
            (1_023.0, 16_777_215.0, 16_777_215.0)
        );
        assert_eq!(Pwm::new(10).share(256), 256.0 / 1_023.0);
    }

    #[test]
    fn one_pin_is_set_or_none() {
        let pins = |drive| (Bridge::set(drive).forward, Bridge::set(drive).backward);
        assert_eq!([3, 0, -3].map(pins), [(true, false), (false, false), (false, true)]);
        assert_eq!([255, 0, -255].map(|drive| Bridge::set(drive).drive()), [255.0, 0.0, -255.0]);
        assert_eq!(Bridge::full(8), 255.0);
    }
}
