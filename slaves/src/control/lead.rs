//! The lead compensator of the main motor (Eq. 7).

/// GD(z) = K(z − α)/(z + β), whose output is the *change* of the drive.
///
/// §4 says that it delivers the modification of the pulse's width. Taken as the width itself it would leave a standing
/// error of up to half the set point. The sum of the changes is the drive: an integrator that limits itself.
#[derive(Clone, Debug)]
pub(crate) struct Lead {
    alpha: f64,
    beta: f64,
    k: f64,
    limit: f64,
    state: State,
}

#[derive(Clone, Copy, Debug, Default)]
struct State {
    error: Option<f64>,
    change: f64,
    drive: f64,
}

impl Lead {
    /// A compensator with the drive at 0; it stays from 0 to `limit`. `k` is in units of drive per unit of error.
    pub(crate) fn new(alpha: f64, beta: f64, k: f64, limit: f64) -> Self {
        Self { alpha, beta, k, limit, state: State::default() }
    }

    /// One sample: c(k) = −β·c(k−1) + K·(e(k) − α·e(k−1)), u(k) = u(k−1) + c(k); gives u(k).
    pub(crate) fn step(&mut self, error: f64) -> f64 {
        // Before the first sample the error counts as having been what it is: no kick.
        let previous = self.state.error.unwrap_or(error);
        let change = self.k * (error - self.alpha * previous) - self.beta * self.state.change;
        let drive = (self.state.drive + change).max(0.0).min(self.limit);
        self.state = State { error: Some(error), change, drive };
        drive
    }

    /// Forgets everything; the drive is 0.
    pub(crate) fn reset(&mut self) {
        self.state = State::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn follows_the_difference_equation() {
        let mut lead = Lead::new(0.97, -0.6, 0.3, 30.0);
        let first = lead.step(10.0);
        assert!((first - 0.09).abs() < 1e-12);
        let change = 0.6 * 0.09 + 0.3 * (20.0 - 9.7);
        assert!((lead.step(20.0) - first - change).abs() < 1e-12);
    }

    #[test]
    fn a_standing_error_drives_to_the_limit_and_no_further() {
        let mut lead = Lead::new(0.97, -0.6, 0.3, 30.0);
        (0..1_000).for_each(|_| _ = lead.step(100.0));
        assert_eq!(lead.step(100.0), 30.0);
        // No wind-up: it leaves the limit as soon as the change is negative.
        assert!((0..5).any(|_| lead.step(-20.0) < 30.0));
        (0..1_000).for_each(|_| _ = lead.step(-100.0));
        assert_eq!(lead.step(-100.0), 0.0);
        lead.reset();
        assert!(lead.step(10.0) < 0.1);
    }
}
