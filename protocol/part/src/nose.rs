//! The nose of the tool: a circle between two straight edges.

/// So near to it, in mm, a point is on the upright edge: the noise of floating point does not push it off.
const NOISE: f64 = 5e-10;

/// The cutting edge: an arc, and the two straight edges that touch it.
///
/// What is programmed is the tool's theoretical tip: as near to the axis as the arc's lowest point, and as near to the
/// chuck as its foremost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nose {
    radius: f64,
    /// Slope of the edge towards the chuck; none if it is upright.
    lead: Option<f64>,
    /// Where it touches the arc: along the axis from the tip, and above it.
    lead_from: (f64, f64),
    trail: f64,
    trail_from: (f64, f64),
}

impl Nose {
    /// A nose of a radius in mm, at least 0, with the edges at angles from the bar's axis, in degrees: `lead`, towards
    /// the chuck, above 0 to 90 (upright: it leaves square shoulders), and `trail`, towards the face, above 0 and below
    /// 90.
    ///
    /// # Errors
    /// What was expected, the field's name first.
    pub fn new(radius_mm: f64, lead_deg: f64, trail_deg: f64) -> Result<Self, String> {
        if !(0.0..=10.0).contains(&radius_mm) {
            return Err(format!("radius_mm = {radius_mm}: expected 0 to 10"));
        }
        if !(1.0..=90.0).contains(&lead_deg) {
            return Err(format!("lead_deg = {lead_deg}: expected 1 to 90"));
        }
        if !(1.0..=89.0).contains(&trail_deg) {
            return Err(format!("trail_deg = {trail_deg}: expected 1 to 89"));
        }
        let (lead, trail) = (lead_deg.to_radians(), trail_deg.to_radians());
        let upright = lead_deg == 90.0;
        let touch = |angle: f64| (radius_mm * libm::sin(angle), radius_mm - radius_mm * libm::cos(angle));
        let (lead_way, lead_height) = if upright { (radius_mm, radius_mm) } else { touch(lead) };
        let (trail_way, trail_height) = touch(trail);
        Ok(Self {
            radius: radius_mm,
            lead: (!upright).then(|| libm::tan(lead)),
            lead_from: (radius_mm - lead_way, lead_height),
            trail: libm::tan(trail),
            trail_from: (radius_mm + trail_way, trail_height),
        })
    }

    /// The arc's radius, in mm.
    pub const fn radius_mm(&self) -> f64 {
        self.radius
    }

    /// How far above the tip the edge is, so far along the axis from it; infinite where there is no tool.
    pub(crate) fn height(&self, along: f64) -> f64 {
        if along < self.lead_from.0 - NOISE {
            self.lead.map_or(f64::INFINITY, |slope| self.lead_from.1 + (self.lead_from.0 - along) * slope)
        } else if along > self.trail_from.0 {
            self.trail_from.1 + (along - self.trail_from.0) * self.trail
        } else {
            let across = along - self.radius;
            self.radius - (self.radius * self.radius - across * across).max(0.0).sqrt()
        }
    }

    /// The slopes of the straight edges, along the axis: infinite if it is upright.
    pub(crate) fn slopes(&self) -> [f64; 2] {
        [self.lead.map_or(f64::NEG_INFINITY, |slope| -slope), self.trail]
    }

    /// Where they touch the arc, along the axis from the tip.
    pub(crate) const fn changes(&self) -> [f64; 2] {
        [self.lead_from.0, self.trail_from.0]
    }

    /// Where the edge has a slope: there it touches what it sweeps when it goes at that slope. Infinitely far, if it is
    /// steeper than the straight edges.
    pub(crate) fn touch(&self, slope: f64) -> f64 {
        if slope >= self.trail {
            f64::INFINITY
        } else if self.lead.is_some_and(|lead| slope <= -lead) {
            f64::NEG_INFINITY
        } else {
            self.radius + self.radius * slope / (1.0 + slope * slope).sqrt()
        }
    }

    /// How far the edge reaches from the tip towards the chuck, and towards the face, up to a height.
    pub(crate) fn reach(&self, height: f64) -> (f64, f64) {
        let lead = self.lead.map_or(0.0, |slope| (height - self.lead_from.1).max(0.0) / slope - self.lead_from.0);
        let trail = (height - self.trail_from.1).max(0.0) / self.trail + self.trail_from.0;
        (lead.max(0.0), trail)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_edge_is_an_arc_between_two_straight_edges() {
        let nose = Nose::new(0.4, 90.0, 45.0).unwrap();
        assert_eq!(nose.height(0.4), 0.0);
        assert_eq!(nose.height(0.0), 0.4);
        assert_eq!(nose.height(-1e-9), f64::INFINITY);
        // 45 degrees: the edge touches the arc at r + r/sqrt 2, r - r/sqrt 2 up.
        let corner = 0.4 * (1.0 + 0.5_f64.sqrt());
        assert!((nose.height(corner) - 0.4 * (1.0 - 0.5_f64.sqrt())).abs() < 1e-12);
        assert!((nose.height(corner + 1.0) - nose.height(corner) - 1.0).abs() < 1e-12);
        let slanted = Nose::new(0.0, 45.0, 45.0).unwrap();
        assert!((slanted.height(-2.0) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn nonsense_is_named() {
        assert_eq!(Nose::new(-1.0, 90.0, 30.0), Err("radius_mm = -1: expected 0 to 10".to_owned()));
        assert_eq!(Nose::new(0.4, 91.0, 30.0), Err("lead_deg = 91: expected 1 to 90".to_owned()));
        assert_eq!(Nose::new(0.4, 90.0, f64::NAN), Err("trail_deg = NaN: expected 1 to 89".to_owned()));
    }
}
