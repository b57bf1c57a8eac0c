//! Transfer functions in s, and how sure one is of them.

/// A number, and how far from it the true one may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The number.
    pub value: f64,
    /// Half of the interval that holds the true number in 95 of 100 cases. None if the method gives none.
    pub half: Option<f64>,
}

impl Estimate {
    /// A number of which no one says how sure it is.
    pub const fn bare(value: f64) -> Self {
        Self { value, half: None }
    }

    /// The interval that holds the true number in 95 of 100 cases.
    pub fn interval(&self) -> Option<[f64; 2]> {
        self.half.map(|half| [self.value - half, self.value + half])
    }

    /// Half of it, in % of the number.
    pub fn percent(&self) -> Option<f64> {
        self.half.map(|half| 100.0 * (half / self.value).abs())
    }
}

/// K/(τs + 1) from input to speed (Eq. 1 and 5); K/(s(τs + 1)) from input to position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstOrder {
    /// Speed per unit of input.
    pub gain: f64,
    /// The time constant, in s.
    pub tau: f64,
}

/// ωn²/(s² + 2ξωn·s + ωn²) (Eq. 8 and 11).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SecondOrder {
    /// The natural frequency, in rad/s.
    pub omega: f64,
    /// The damping.
    pub xi: f64,
}

impl SecondOrder {
    /// The open loop Km/(s(τs + 1)) of which this is the closed one with unity feedback: ωn² = Km/τ, 2ξωn = 1/τ.
    pub fn open_loop(&self) -> FirstOrder {
        let tau = 1.0 / (2.0 * self.xi * self.omega);
        FirstOrder { gain: self.omega * self.omega * tau, tau }
    }

    /// The closed loop of an open one with unity feedback.
    pub fn closing(open: &FirstOrder) -> Self {
        let omega = libm::sqrt(open.gain / open.tau);
        Self { omega, xi: 1.0 / (2.0 * open.tau * omega) }
    }
}

/// What a method makes of data.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// Speed per unit of input.
    pub gain: Estimate,
    /// The time constant, in s.
    pub tau: Estimate,
    /// The speed at the start, in units of speed: 0 if the motor was at rest.
    pub start: f64,
    /// Coulomb friction, in units of input; None if it was not looked for.
    pub friction: Option<Estimate>,
    /// What the sensor tells too much, in units of speed; None if it was not looked for.
    pub offset: Option<Estimate>,
    /// The dead time between drive and motor, in s; None if it was not looked for.
    pub dead: Option<Estimate>,
}

impl Fitted {
    /// Without anything said on how sure it is.
    pub const fn bare(gain: f64, tau: f64) -> Self {
        let (gain, tau) = (Estimate::bare(gain), Estimate::bare(tau));
        Self { gain, tau, start: 0.0, friction: None, offset: None, dead: None }
    }

    /// Takes the intervals of gain, time constant and dead time away: they are those of another motor.
    pub const fn forget_intervals(&mut self) {
        (self.gain.half, self.tau.half) = (None, None);
        if let Some(dead) = &mut self.dead {
            dead.half = None;
        }
    }

    /// The transfer function, without the dead time.
    pub const fn model(&self) -> FirstOrder {
        FirstOrder { gain: self.gain.value, tau: self.tau.value }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// §4, Eq. 8 to 11: what the paper's transverse motor is without the loop it was characterised in.
    #[test]
    fn the_open_loop_behind_eq_11() {
        let closed = SecondOrder { omega: 1.925_269, xi: 0.361_327 };
        let open = closed.open_loop();
        assert!((open.tau - 0.718_750).abs() < 1e-5 && (open.gain - 2.664_162).abs() < 1e-5, "{open:?}");
        let again = SecondOrder::closing(&open);
        assert!((again.omega - closed.omega).abs() < 1e-12 && (again.xi - closed.xi).abs() < 1e-12);
    }
}
