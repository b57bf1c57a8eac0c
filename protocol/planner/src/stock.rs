//! The bar that the program cuts, as far as the program itself is concerned: along the ideal path, before any rounding.

use torno_part::{Limits, Nose, Place, Profile};

/// Less is no cut, in mm of radius: it is what chords and decimals leave.
const TOUCH: f64 = 0.005;
/// The place where a cut begins is found by so many halvings of the way.
const HALVINGS: u32 = 20;

/// What the tool meets.
#[derive(Clone, Debug)]
pub struct Stock {
    /// The bar. After the plan, what the program asks for: the ideal path, swept by the nose.
    pub profile: Profile,
    /// The tool's nose.
    pub nose: Nose,
    /// What is allowed.
    pub limits: Limits,
    /// Where the tool stands at the start, from the bar's face and its middle.
    pub start: Place,
}

/// A cut that must not be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Met {
    /// Where it begins.
    pub(crate) place: Place,
    /// The most that it takes off, in mm of radius.
    pub(crate) thickest: f64,
}

impl Stock {
    /// Goes straight from one place of the bar to another; gives how much that took off, if it cut.
    pub(crate) fn cut(&mut self, from: Place, to: Place) -> Option<f64> {
        let off = self.profile.cut(&self.nose, from, to).thickest;
        (off > TOUCH).then_some(off)
    }

    /// Where a straight way would cut first, and how much at most.
    pub(crate) fn meets(&self, from: Place, to: Place) -> Option<Met> {
        if self.profile.is_clear(from, to) {
            return None;
        }
        let at = |share: f64| between(from, to, share);
        let off = |share: f64| self.profile.clone().cut(&self.nose, from, at(share)).thickest;
        let cuts = |share: f64| off(share) > TOUCH;
        let thickest = off(1.0);
        if thickest <= TOUCH {
            return None;
        }
        let (mut clear, mut cutting) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let middle = f64::midpoint(clear, cutting);
            if cuts(middle) { cutting = middle } else { clear = middle }
        }
        Some(Met { place: at(cutting), thickest })
    }

    /// From where on a straight way cuts nothing.
    pub(crate) fn clear_from(&self, from: Place, to: Place) -> Place {
        if self.meets(from, to).is_none() {
            return from;
        }
        let (mut cutting, mut clear) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let middle = f64::midpoint(cutting, clear);
            if self.meets(between(from, to, middle), to).is_none() { clear = middle } else { cutting = middle }
        }
        between(from, to, clear)
    }
}

fn between(from: Place, to: Place, share: f64) -> Place {
    Place { z: from.z + share * (to.z - from.z), x: from.x + share * (to.x - from.x) }
}
