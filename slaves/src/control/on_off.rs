//! The on/off law of the depth axis (§4).

/// Drives towards the target until no slot is left, then stays off.
///
/// It stays off within one slot of the target: coasting over an edge must not start a hunt. Further off than that, and
/// standing still, it drives again. (Ours.)
#[derive(Clone, Debug, Default)]
pub(crate) struct OnOff {
    drive: i64,
}

impl OnOff {
    /// The drive: −1, 0 or +1.
    pub(crate) const fn drive(&self) -> i64 {
        self.drive
    }

    /// Drives if slots are left.
    pub(crate) const fn start(&mut self, remaining: i64) {
        self.drive = remaining.signum();
    }

    /// Switches off.
    pub(crate) const fn stop(&mut self) {
        self.drive = 0;
    }

    /// One poll, with so many slots left; `standing` if no slot has passed for some polls.
    pub(crate) const fn step(&mut self, remaining: i64, standing: bool) {
        if self.drive == 0 && standing && remaining.abs() > 1 {
            self.start(remaining);
        }
        if self.drive * remaining.signum() <= 0 {
            self.stop();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_off_as_soon_as_no_slot_is_left() {
        let mut law = OnOff::default();
        law.start(-2);
        let drives = [-2, -1, 0].map(|remaining| {
            law.step(remaining, false);
            law.drive()
        });
        assert_eq!(drives, [-1, -1, 0]);
    }

    #[test]
    fn it_does_not_hunt_for_one_slot() {
        let mut law = OnOff::default();
        law.start(1);
        law.step(-1, false);
        law.step(-1, true);
        assert_eq!(law.drive(), 0);
        law.step(-2, false);
        assert_eq!(law.drive(), 0);
        law.step(-2, true);
        assert_eq!(law.drive(), -1);
    }
}
