//! Where the slide across the bar stands, and which slot to send it to.

use crate::scale::Infeed;

/// On which side of the ideal path the tool goes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Side {
    /// As near to it as can be: half a slot either way.
    #[default]
    Middle,
    /// Never in the part: up to a slot outside of it.
    Outside,
}

/// So many slots are the noise of floating point.
const NOISE: f64 = 1e-9;

/// The slide: the slot that it was sent to last, and the sense in which it came there.
///
/// It stops just past an edge of the slot, so the same slot is two places: one for each sense.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Slide {
    pub(crate) slot: i64,
    /// 0 before the first move: it stands in the middle of the slot.
    sense: i64,
    /// The radius at the middle of slot 0.
    zero: f64,
    mm_per_slot: f64,
    short: f64,
}

impl Slide {
    pub(crate) fn new(infeed: &Infeed, start: f64) -> Self {
        Self { slot: 0, sense: 0, zero: start, mm_per_slot: infeed.mm_per_slot, short: infeed.short() }
    }

    /// Where it has been sent to a slot in that sense.
    pub(crate) const fn standing(self, slot: i64, sense: i64) -> Self {
        Self { slot, sense, ..self }
    }

    /// The radius at which the tool stands.
    pub(crate) fn x(&self) -> f64 {
        self.zero + self.mm_per_slot * self.slots()
    }

    fn slots(&self) -> f64 {
        self.slot as f64 - self.sense as f64 * self.short
    }

    /// Slots are counted towards greater radii: 1; or towards smaller ones: −1.
    const fn outward(&self) -> i64 {
        if self.mm_per_slot > 0.0 { 1 } else { -1 }
    }

    /// Once it has gone to the next slot towards greater radii, or smaller ones.
    pub(crate) const fn next(&self, grows: bool) -> Self {
        let sense = if grows { self.outward() } else { -self.outward() };
        Self { slot: self.slot + sense, sense, ..*self }
    }

    /// Once it has gone to the place that is best for a radius; it stays where it is if that is as good. `away` is the
    /// side that is outside of the part: whether radii grow there.
    pub(crate) fn best(&self, x: f64, side: Side, away: bool) -> Self {
        let ideal = (x - self.zero) / self.mm_per_slot;
        let away = if away { self.outward() } else { -self.outward() };
        let allowed = |slide: &Self| side == Side::Middle || (slide.slots() - ideal) * away as f64 >= -NOISE;
        let come = |sense: i64| {
            let wanted = ideal + sense as f64 * self.short;
            let slot = match side {
                Side::Middle => wanted.round(),
                Side::Outside if away > 0 => (wanted - NOISE).ceil(),
                Side::Outside => (wanted + NOISE).floor(),
            } as i64;
            let slot = if sense > 0 { slot.max(self.slot + 1) } else { slot.min(self.slot - 1) };
            Self { slot, sense, ..*self }
        };
        let off = |slide: &Self| (slide.slots() - ideal).abs();
        let others = [come(1), come(-1)].into_iter().filter(allowed);
        let mut best = Some(*self).filter(allowed);
        for other in others {
            if best.is_none_or(|best| off(&other) < off(&best) - NOISE) {
                best = Some(other);
            }
        }
        best.unwrap_or(*self)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SLOT: f64 = 16.0 / 90.0;

    fn slide(mm_per_slot: f64) -> Slide {
        Slide::new(&Infeed { mm_per_slot, mm_per_s: 0.267, overrun: 0.0825, reach: 450 }, 14.0)
    }

    #[test]
    fn the_same_slot_is_two_places() {
        let start = slide(SLOT);
        assert_eq!(start.x(), 14.0);
        let inside = start.next(false).next(false);
        let back = inside.next(true);
        assert_eq!((inside.slot, back.slot), (-2, -1));
        assert!((start.next(false).x() - (14.0 - SLOT * (1.0 - 0.4175))).abs() < 1e-12);
        assert!((back.x() - (14.0 - SLOT * 1.4175)).abs() < 1e-12);
        assert!((back.x() - inside.x() - SLOT * (1.0 - 0.835)).abs() < 1e-12);
    }

    #[test]
    fn a_place_is_chosen_for_the_sense_in_which_it_is_reached() {
        // 13.2 mm lies 4.5 slots in: from outside the slide stops 0.4175 slots short of the middle of slot 5.
        assert_eq!(slide(SLOT).best(13.2, Side::Middle, true).slot, -5);
        let deep = slide(SLOT).best(12.0, Side::Middle, true);
        assert_eq!(deep.best(13.2, Side::Middle, true).slot, -4);
        assert_eq!(slide(-SLOT).best(13.2, Side::Middle, true).slot, 5);
    }

    #[test]
    fn it_stays_where_it_is_if_that_is_as_good() {
        let there = slide(SLOT).best(13.0, Side::Middle, true);
        assert_eq!(there.best(there.x(), Side::Middle, true), there);
    }

    proptest! {
        #[test]
        fn a_place_is_within_half_a_slot_or_up_to_one_outside(
            radii in proptest::collection::vec(-5.0..30.0, 1..20),
            outside: bool,
            away: bool,
            turned: bool,
            overrun in 0.0..=0.5,
        ) {
            let mm_per_slot = if turned { -SLOT } else { SLOT };
            let infeed = Infeed { mm_per_slot, mm_per_s: 0.267, overrun, reach: 450 };
            let mut slide = Slide::new(&infeed, 14.0);
            let side = if outside { Side::Outside } else { Side::Middle };
            for x in radii {
                slide = slide.best(x, side, away);
                let off = if away { slide.x() - x } else { x - slide.x() };
                let range = if outside { -1e-9..=SLOT + 1e-9 } else { -0.5 * SLOT - 1e-9..=0.5 * SLOT + 1e-9 };
                prop_assert!(range.contains(&off), "{off} at {x}");
            }
        }
    }
}
