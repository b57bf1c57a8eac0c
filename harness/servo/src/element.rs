//! One element of a program: a way and a time.

/// One element of a program.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Element {
    /// `x10 t2`: at constant speed.
    Constant {
        /// The way, in mm; 0 is a rest.
        x: f64,
        /// The time, in s: above 0.
        t: f64,
    },
    /// `p0 k5 x2`: at constant acceleration.
    Accelerated {
        /// The speed at its beginning, in mm/s.
        p: f64,
        /// The speed at its end, in mm/s, of the same sign.
        k: f64,
        /// The way, in mm, of the same sign; not 0.
        x: f64,
    },
}

impl Element {
    /// The way, in mm.
    pub const fn way_mm(self) -> f64 {
        match self {
            Self::Constant { x, .. } | Self::Accelerated { x, .. } => x,
        }
    }

    /// The time, in s.
    pub fn seconds(self) -> f64 {
        match self {
            Self::Constant { t, .. } => t,
            Self::Accelerated { p, k, x } => 2.0 * x / (p + k),
        }
    }

    /// The speed at its beginning, in mm/s.
    pub fn speed_mm_s(self) -> f64 {
        match self {
            Self::Constant { x, t } => x / t,
            Self::Accelerated { p, .. } => p,
        }
    }

    /// The acceleration, in mm/s².
    pub fn acceleration_mm_s2(self) -> f64 {
        match self {
            Self::Constant { .. } => 0.0,
            Self::Accelerated { p, k, x } => (k * k - p * p) / (2.0 * x),
        }
    }

    /// The greatest speed, in mm/s, without a sign.
    pub fn greatest_speed_mm_s(self) -> f64 {
        match self {
            Self::Constant { x, t } => (x / t).abs(),
            Self::Accelerated { p, k, .. } => p.abs().max(k.abs()),
        }
    }

    /// The way after so many seconds of it, in mm.
    pub fn way_at(self, seconds: f64) -> f64 {
        self.speed_mm_s() * seconds + self.acceleration_mm_s2() * seconds * seconds / 2.0
    }
}
