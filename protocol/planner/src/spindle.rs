//! The spindle: a change of its speed is a frame of its own, before the cut.

use core::f64::consts::TAU;

use torno_gcode::{Sense, Speed};
use torno_protocol::lathe::SpindleSubFrame;

use crate::finding::{Findings, Once};

/// The slowest and the fastest, in units.
const LEAST: f64 = 10.0;
const MOST: f64 = 200.0;
/// Constant surface speed is followed where the spindle is off by more.
const OFF: f64 = 0.05;

const UNIT: f64 = SpindleSubFrame::RPM_PER_UNIT as f64;

/// The spindle as the program wants it, and as it turns.
#[derive(Clone, Debug)]
pub(crate) struct Spindle {
    wanted: Option<Speed>,
    /// Where the program says so.
    line: usize,
    /// Units of 20 rpm.
    pub(crate) units: u8,
}

/// What the spindle does at a cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Turning {
    /// It stands.
    Not,
    /// It ought to turn at so many rpm, which is too slow for a cut.
    TooSlow(f64),
    /// It turns.
    Yes,
}

impl Spindle {
    pub(crate) const fn new() -> Self {
        Self { wanted: None, line: 0, units: 0 }
    }

    /// What the program wants from here on. Whether it is to stop.
    pub(crate) fn set(&mut self, line: usize, sense: Sense, speed: Speed, findings: &mut Findings) -> bool {
        if sense == Sense::Counterclockwise {
            findings.refuse(line, b'm', "M4: the spindle turns in one sense only (M3)");
        }
        self.line = line;
        self.wanted = (sense != Sense::Off).then_some(speed);
        self.wanted.is_none()
    }

    /// Turns as the program wants it for a cut at this radius.
    pub(crate) fn for_cut(&mut self, radius: f64, findings: &mut Findings) -> Turning {
        let Some(speed) = self.wanted else {
            self.units = 0;
            return Turning::Not;
        };
        let (rpm, follows) = match speed {
            Speed::Constant(rpm) => (rpm, false),
            Speed::Surface { m_per_min: 0.0, .. } => (0.0, true),
            Speed::Surface { m_per_min, most_rpm } => {
                let most = most_rpm.filter(|most| *most > 0.0).unwrap_or(MOST * UNIT).min(MOST * UNIT);
                // At the middle it is without limit.
                ((m_per_min * 1_000.0 / (TAU * radius.abs())).min(most), true)
            }
        };
        if rpm == 0.0 {
            self.units = 0;
            return Turning::Not;
        }
        let near = follows && (f64::from(self.units) * UNIT - rpm).abs() <= OFF * rpm;
        if !near {
            self.units = (rpm / UNIT).round().clamp(LEAST, MOST) as u8;
        }
        if rpm > (MOST + 0.5) * UNIT {
            findings.warn(Once::SpindleClamped, self.line, b's', || {
                format!("S asks for {rpm:.0} rpm: the spindle turns at {:.0}", MOST * UNIT)
            });
        }
        if rpm < LEAST * UNIT { Turning::TooSlow(rpm) } else { Turning::Yes }
    }

    /// The speed asked for is too low, and nothing is cut.
    pub(crate) fn tell_raised(&self, rpm: f64, findings: &mut Findings) {
        findings.warn(Once::SpindleRaised, self.line, b's', || {
            format!("S asks for {rpm:.0} rpm: the spindle turns at {:.0}", LEAST * UNIT)
        });
    }

    /// How fast it turns.
    pub(crate) fn rpm(&self) -> f64 {
        f64::from(self.units) * UNIT
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn units(speed: Speed, radii: &[f64]) -> Vec<u8> {
        let (mut spindle, findings) = (Spindle::new(), &mut Findings::default());
        spindle.set(1, Sense::Clockwise, speed, findings);
        let at = |radius: &f64| {
            spindle.for_cut(*radius, findings);
            spindle.units
        };
        radii.iter().map(at).collect()
    }

    #[test]
    fn a_speed_is_rounded_to_20_rpm_and_clamped() {
        let of = |rpm| units(Speed::Constant(rpm), &[10.0])[0];
        assert_eq!([200.0, 1_509.0, 1_511.0, 4_000.0, 6_000.0].map(of), [10, 75, 76, 200, 200]);
    }

    #[test]
    fn surface_speed_is_followed_where_it_is_off_by_more_than_5_percent() {
        let surface = |most_rpm| Speed::Surface { m_per_min: 100.0, most_rpm };
        // 1592, 1675 (4.5 % more than 1600), 1693 (5.5 % more) and 3183 rpm.
        assert_eq!(units(surface(None), &[10.0, 9.5, 9.4, 5.0, 0.0]), [80, 80, 85, 159, 200]);
        assert_eq!(units(surface(Some(2_000.0)), &[10.0, 5.0]), [80, 100]);
        assert_eq!(units(Speed::Surface { m_per_min: 0.0, most_rpm: None }, &[0.0]), [0]);
    }

    #[test]
    fn what_it_cannot_do_is_told() {
        let (mut spindle, findings) = (Spindle::new(), &mut Findings::default());
        assert_eq!(spindle.for_cut(10.0, findings), Turning::Not);
        assert!(!spindle.set(3, Sense::Clockwise, Speed::Constant(150.0), findings));
        assert_eq!(spindle.for_cut(10.0, findings), Turning::TooSlow(150.0));
        spindle.set(4, Sense::Counterclockwise, Speed::Constant(500.0), findings);
        assert!(findings.refused());
        assert!(spindle.set(5, Sense::Off, Speed::Constant(500.0), findings));
        assert_eq!((spindle.for_cut(10.0, findings), spindle.units), (Turning::Not, 0));
    }
}
