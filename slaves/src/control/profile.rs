//! The set-point generator of the transverse axis: a trapezoid of speed.

use crate::settings::SetPoint;

/// Moves a set point to its target with limited speed and acceleration, in whole counts.
///
/// (Ours: the paper sends a speed and a position and does not say how the one limits the other. A set point that
/// jumps or changes speed at once makes the axis overshoot by hundreds of counts.)
#[derive(Clone, Debug)]
pub(crate) struct Profile {
    form: SetPoint,
    accel: i64,
    /// It goes no further ahead of the axis; without end if 0.
    lead: i64,
    speed_max: i64,
    target: i64,
    set_point: i64,
    /// Signed, in counts per sample.
    speed: i64,
    acceleration: i64,
}

impl Profile {
    /// A set point that rests at 0; `accel` in counts per sample², at least 1. It waits for an axis that is `lead`
    /// counts behind, unless that is 0.
    pub(crate) fn new(form: SetPoint, accel: u32, lead: u32) -> Self {
        let (accel, lead) = (i64::from(accel.max(1)), i64::from(lead));
        Self { form, accel, lead, speed_max: 0, target: 0, set_point: 0, speed: 0, acceleration: 0 }
    }

    /// Puts set point and target to `count` at once.
    pub(crate) fn rest_at(&mut self, count: i64) {
        *self = Self { target: count, set_point: count, speed_max: 0, speed: 0, acceleration: 0, ..*self };
    }

    /// Moves the target by `distance`, at up to `speed` counts per sample.
    pub(crate) fn go(&mut self, distance: i64, speed: i64) {
        self.target = self.target.saturating_add(distance);
        self.speed_max = speed;
    }

    pub(crate) const fn target(&self) -> i64 {
        self.target
    }

    pub(crate) const fn set_point(&self) -> i64 {
        self.set_point
    }

    /// Counts per sample, signed.
    pub(crate) const fn speed(&self) -> i64 {
        self.speed
    }

    /// Counts per sample², signed: the last change of speed.
    pub(crate) const fn acceleration(&self) -> i64 {
        self.acceleration
    }

    /// The set point has come to rest at the target: nothing changes any more.
    pub(crate) const fn is_finished(&self) -> bool {
        self.set_point == self.target && self.speed == 0 && self.acceleration == 0
    }

    /// One sample, with the axis at `count`.
    pub(crate) fn step(&mut self, count: i64) {
        if self.form == SetPoint::Step {
            self.set_point = self.target;
            return;
        }
        let to_go = self.target - self.set_point;
        let mut speed = (self.speed.abs() + self.accel).min(self.speed_max).min(to_go.abs());
        // A few rounds at most: one acceleration slower than before always stops in time.
        while speed > 0 && self.braking(speed) > to_go.abs() {
            speed -= 1;
        }
        if self.lead > 0 {
            let ahead = (self.set_point - count) * to_go.signum();
            speed = speed.min((self.lead - ahead).max(0));
        }
        let speed = speed * to_go.signum();
        self.acceleration = speed - self.speed;
        self.speed = speed;
        self.set_point += speed;
    }

    /// The distance covered by this sample at `speed` and by stopping after it.
    const fn braking(&self, speed: i64) -> i64 {
        let more = speed / self.accel;
        speed * (more + 1) - self.accel * (more * (more + 1) / 2)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn steps(profile: &mut Profile) -> Vec<i64> {
        let mut speeds = Vec::new();
        loop {
            profile.step(profile.set_point());
            if profile.is_finished() {
                return speeds;
            }
            speeds.push(profile.speed());
        }
    }

    #[test]
    fn a_short_move_is_a_triangle() {
        let mut profile = Profile::new(SetPoint::Trapezoid, 3, 0);
        profile.go(-24, 112);
        assert_eq!(steps(&mut profile), [-3, -6, -8, -5, -2, 0]);
        assert_eq!(profile.set_point(), -24);
    }

    #[test]
    fn nine_thousand_counts_at_112_take_118_samples() {
        let mut profile = Profile::new(SetPoint::Trapezoid, 3, 0);
        profile.go(9_000, 112);
        let speeds = steps(&mut profile);
        // 9000/112 samples at full speed and half of two ramps of 112/3.
        assert!((117..=120).contains(&speeds.len()), "{}", speeds.len());
        assert_eq!(speeds.iter().max(), Some(&112));
    }

    #[test]
    fn a_step_is_there_at_once() {
        let mut profile = Profile::new(SetPoint::Step, 3, 0);
        profile.go(9_000, 1);
        profile.step(0);
        assert_eq!((profile.set_point(), profile.speed(), profile.is_finished()), (9_000, 0, true));
    }

    /// As with a load at the motor's no-load speed: the axis follows by 150 counts a sample.
    #[test]
    fn it_waits_for_an_axis_that_cannot_follow() {
        let mut profile = Profile::new(SetPoint::Trapezoid, 3, 170);
        profile.go(-18_000, 225);
        let mut count = 0;
        let mut samples = 0;
        while !profile.is_finished() {
            profile.step(count);
            assert!((profile.set_point() - count).abs() <= 170 && profile.set_point() >= -18_000);
            count -= (count - profile.set_point()).clamp(0, 150);
            samples += 1;
        }
        // Two ramps to the axis's own speed, and that speed between.
        assert!((165..=180).contains(&samples), "{samples}");
    }

    proptest! {
        #[test]
        fn it_arrives_within_its_limits(
            distance in -70_000..70_000i64,
            speed in 1..=225i64,
            accel in 1..=225u32,
            from in -36_000..36_000i64,
        ) {
            let mut profile = Profile::new(SetPoint::Trapezoid, accel, 0);
            profile.rest_at(from);
            profile.go(distance, speed);
            let mut before = 0;
            for now in steps(&mut profile) {
                prop_assert!(now.abs() <= speed && (now - before).abs() <= i64::from(accel), "{} {}", before, now);
                prop_assert!(now * distance >= 0);
                before = now;
            }
            prop_assert_eq!(profile.set_point(), from + distance);
        }
    }
}
