//! The lead compensator of the main motor (Eq. 7).

use crate::settings::LeadForm;

/// GD(z) = K(z − α)/(z + β), whose output is the *change* of the drive.
///
/// §4 says that it delivers the modification of the pulse's width. Taken as the width itself it would leave a standing
/// error of up to half the set point. The sum of the changes is the drive: an integrator that limits itself. The other
/// forms are there to be seen.
#[derive(Clone, Debug)]
pub(crate) struct Lead {
    form: LeadForm,
    alpha: f64,
    beta: f64,
    k: f64,
    limit: f64,
    state: State,
}

#[derive(Clone, Copy, Debug, Default)]
struct State {
    error: Option<f64>,
    output: f64,
    drive: f64,
}

impl Lead {
    /// A compensator with the drive at 0; it stays from 0 to `limit`. `k` is in units of drive per unit of error.
    pub(crate) fn new(form: LeadForm, alpha: f64, beta: f64, k: f64, limit: f64) -> Self {
        Self { form, alpha, beta, k, limit, state: State::default() }
    }

    /// One sample: c(k) = −β·c(k−1) + K·(e(k) − α·e(k−1)), and u(k) = u(k−1) + c(k), or what the form says; gives u(k).
    /// `feed_forward` is the drive that the set point takes.
    pub(crate) fn step(&mut self, error: f64, feed_forward: f64) -> f64 {
        // Before the first sample the error counts as having been what it is: no kick.
        let previous = self.state.error.unwrap_or(error);
        let output = self.k * (error - self.alpha * previous) - self.beta * self.state.output;
        let from = match self.form {
            LeadForm::Incremental => self.state.drive,
            LeadForm::FeedForward => feed_forward,
            LeadForm::Literal => 0.0,
        };
        let drive = (from + output).max(0.0).min(self.limit);
        self.state = State { error: Some(error), output, drive };
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
        let mut lead = Lead::new(LeadForm::Incremental, 0.97, -0.6, 0.3, 30.0);
        let first = lead.step(10.0, 0.0);
        assert!((first - 0.09).abs() < 1e-12);
        let change = 0.6 * 0.09 + 0.3 * (20.0 - 9.7);
        assert!((lead.step(20.0, 0.0) - first - change).abs() < 1e-12);
    }

    #[test]
    fn a_standing_error_drives_to_the_limit_and_no_further() {
        let mut lead = Lead::new(LeadForm::Incremental, 0.97, -0.6, 0.3, 30.0);
        (0..1_000).for_each(|_| _ = lead.step(100.0, 0.0));
        assert_eq!(lead.step(100.0, 0.0), 30.0);
        // No wind-up: it leaves the limit as soon as the change is negative.
        assert!((0..5).any(|_| lead.step(-20.0, 0.0) < 30.0));
        (0..1_000).for_each(|_| _ = lead.step(-100.0, 0.0));
        assert_eq!(lead.step(-100.0, 0.0), 0.0);
        lead.reset();
        assert!(lead.step(10.0, 0.0) < 0.1);
    }

    #[test]
    fn the_other_forms_add_it_to_what_the_set_point_takes_or_to_nothing() {
        for (form, from) in [(LeadForm::FeedForward, 8.0), (LeadForm::Literal, 0.0)] {
            let mut lead = Lead::new(form, 0.9, -0.5, 1.0, 30.0);
            let drives = [10.0, 10.0].map(|error| lead.step(error, 8.0));
            assert!((drives[0] - from - 1.0).abs() < 1e-12 && (drives[1] - from - 1.5).abs() < 1e-12, "{drives:?}");
        }
    }
}
