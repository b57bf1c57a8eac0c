//! Rapids: one axis after the other, around the part.

use torno_part::Place;

use crate::stock::Stock;

/// The least way away from the part is found by so many halvings.
const HALVINGS: u32 = 12;

/// The places over which a rapid goes, the last one included: one axis moves to each, or none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RapidPath {
    pub(crate) over: [Place; 3],
    /// Where it cuts, if it does in any case.
    pub(crate) meets: Option<Place>,
}

/// The way of a rapid: away from the part the infeed goes first, towards it the feed; the other way round if that cuts.
/// `away` is the side that is outside of the part: whether radii grow there. The stock is as the program has cut it.
///
/// Beside its tip, the nose leaves what it would scrape off where it goes along the bar. So it is lifted by its radius
/// if that is enough.
pub(crate) fn way(from: Place, to: Place, away: bool, stock: Option<(&Stock, Place)>) -> RapidPath {
    let infeed_first = Place { z: from.z, x: to.x };
    let feed_first = Place { z: to.z, x: from.x };
    let leaves = if away { to.x > from.x } else { to.x < from.x };
    let [usual, other] = if leaves { [infeed_first, feed_first] } else { [feed_first, infeed_first] };
    let by = |corner: Place| [corner, to, to];
    let Some((stock, shift)) = stock else { return RapidPath { over: by(usual), meets: None } };
    let on_bar = |place: Place| Place { z: place.z + shift.z, x: place.x + shift.x };
    let meets = |over: [Place; 3]| {
        let mut from = on_bar(from);
        over.map(on_bar).into_iter().find_map(|to| stock.meets(core::mem::replace(&mut from, to), to))
    };
    let Some(met) = meets(by(usual)) else { return RapidPath { over: by(usual), meets: None } };
    let radius = stock.nose.radius_mm();
    let lift = if away { from.x.max(to.x) + radius } else { from.x.min(to.x) - radius };
    let lifted = [Place { z: from.z, x: lift }, Place { z: to.z, x: lift }, to];
    let others = [Some(by(other)), (met.thickest <= radius).then_some(lifted)];
    match others.into_iter().flatten().find(|over| meets(*over).is_none()) {
        Some(over) => RapidPath { over, meets: None },
        None => RapidPath { over: by(usual), meets: Some(met.place) },
    }
}

/// A way between two cuts that leaves the part no further than it must; None if none is much shorter than one that goes
/// as far as `highest`. It is clear of the part by `clearance`, both in mm of radius.
pub(crate) fn shortcut(
    from: Place,
    to: Place,
    highest: f64,
    clearance: f64,
    away: bool,
    (stock, shift): (&Stock, Place),
) -> Option<[Place; 3]> {
    let on_bar = |place: Place| Place { z: place.z + shift.z, x: place.x + shift.x };
    // Of the jaws nothing is known but where they are.
    if on_bar(from).z.min(on_bar(to).z) < -stock.profile.out() {
        return None;
    }
    let (sign, base) = if away { (1.0, from.x.max(to.x)) } else { (-1.0, from.x.min(to.x)) };
    let room = (highest - base) * sign;
    let at = |z: f64, lift: f64| Place { z, x: base + sign * lift };
    let over = |lift: f64| [at(from.z, lift), at(to.z, lift), to];
    let meets = |from: Place, to: Place| stock.meets(on_bar(from), on_bar(to)).is_some();
    let is_clear = |lift: f64| {
        let [up, along, _] = over(lift);
        let low = lift - clearance;
        let passes = from.z == to.z || !meets(at(from.z, low), at(to.z, low));
        passes && !meets(from, up) && !meets(along, to)
    };
    if room <= clearance || !is_clear(room) {
        return None;
    }
    if is_clear(0.0) {
        return Some(over(0.0));
    }
    let (mut blocked, mut clear) = (0.0, room);
    for _ in 0..HALVINGS {
        let middle = f64::midpoint(blocked, clear);
        if is_clear(middle) { clear = middle } else { blocked = middle }
    }
    (room - clear > clearance).then(|| over(clear))
}

#[cfg(test)]
mod tests {
    use torno_part::{Limits, Nose, Profile};

    use super::*;

    const fn place(x: f64, z: f64) -> Place {
        Place { z, x }
    }

    /// A bar of 28 mm with a step of 20 mm, 10 mm long.
    fn stock() -> Stock {
        let nose = Nose::new(0.4, 90.0, 32.0).unwrap();
        let mut profile = Profile::bar(28.0, 60.0);
        for x in [13.0, 12.0, 11.0, 10.0] {
            profile.cut(&nose, place(x, 0.0), place(x, -10.0));
        }
        let limits = Limits { feed: 10.0, depth: None, chuck: None };
        Stock { profile, nose, limits, start: place(14.5, 0.0) }
    }

    fn found(from: Place, to: Place) -> (Place, bool) {
        let stock = stock();
        let RapidPath { over, meets } = way(from, to, true, Some((&stock, Place::default())));
        (over[0], meets.is_some())
    }

    #[test]
    fn out_first_and_in_last() {
        assert_eq!(found(place(10.0, -10.0), place(15.0, 1.0)), (place(15.0, -10.0), false));
        assert_eq!(found(place(15.0, -20.0), place(12.0, 1.0)), (place(15.0, 1.0), false));
        // In a bore it is the other way round.
        let bore = |from, to| way(from, to, false, None).over[0];
        assert_eq!(bore(place(10.0, -10.0), place(8.0, 1.0)), place(8.0, -10.0));
        assert_eq!(bore(place(8.0, 1.0), place(10.0, -2.0)), place(8.0, -2.0));
    }

    #[test]
    fn the_other_corner_is_taken_if_the_usual_one_cuts() {
        // In beside the step: the feed would run into the shoulder first.
        assert_eq!(found(place(15.0, -5.0), place(12.0, -8.0)), (place(15.0, -8.0), false));
        assert_eq!(found(place(12.0, 1.0), place(10.5, -8.0)), (place(12.0, -8.0), false));
        assert_eq!(found(place(13.9, 2.0), place(10.5, -10.0)), (place(13.9, -10.0), false));
        assert_eq!(found(place(15.0, 1.0), place(12.0, -20.0)), (place(15.0, -20.0), true));
        assert_eq!(found(place(10.5, -8.0), place(11.0, -15.0)), (place(11.0, -8.0), true));
    }

    #[test]
    fn where_it_cuts_is_told() {
        let stock = stock();
        let met = stock.meets(place(12.0, 1.0), place(12.0, -20.0)).unwrap();
        assert!((met.place.z + 10.0).abs() < 0.02 && met.place.x == 12.0, "{met:?}");
        assert!((met.thickest - 2.0).abs() < 1e-9, "{met:?}");
        assert_eq!(stock.meets(place(10.0, 0.0), place(10.0, -10.0)), None);
    }

    #[test]
    fn the_nose_is_lifted_over_what_it_has_left_beside_its_tip() {
        let mut stock = stock();
        stock.cut(place(12.0, -0.8), place(2.0, -0.8));
        let shift = Place::default();
        let back = |stock: &Stock, z: f64| way(place(2.0, -0.8), place(2.0, z), true, Some((stock, shift)));
        let lifted = [place(2.4, -0.8), place(2.4, 1.0), place(2.0, 1.0)];
        assert_eq!(back(&stock, 1.0), RapidPath { over: lifted, meets: None });
        // There is a wall.
        assert!(back(&stock, -2.0).meets.is_some());
        // What is left is higher than the nose's radius.
        stock.cut(place(12.0, -4.0), place(2.0, -4.0));
        assert!(way(place(2.0, -4.0), place(2.0, 1.0), true, Some((&stock, shift))).meets.is_some());
    }

    #[test]
    fn a_shortcut_clears_what_lies_between_and_no_more() {
        let stock = stock();
        let way = |from, to, highest| shortcut(from, to, highest, 0.3, true, (&stock, Place::default()));
        // Along the step that was turned.
        let [up, along, to] = way(place(10.0, -9.0), place(9.5, 1.0), 20.0).unwrap();
        assert!((up.x - 10.3).abs() < 0.02 && up.z == -9.0, "{up:?}");
        assert_eq!((along.x, along.z, to), (up.x, 1.0, place(9.5, 1.0)));
        // Over the bar.
        let [up, ..] = way(place(10.0, -9.0), place(14.5, -20.0), 20.0).unwrap();
        assert!((up.x - 14.5).abs() < 0.02, "{up:?}");
        // Nothing is won, the end is in the part, or it is beyond the jaws.
        assert_eq!(way(place(10.0, -9.0), place(9.5, 1.0), 10.4), None);
        assert_eq!(way(place(10.0, -9.0), place(12.0, -20.0), 20.0), None);
        assert_eq!(way(place(15.0, -61.0), place(15.0, 1.0), 20.0), None);
        // In the place where it stands.
        let there = place(10.2, -9.0);
        assert_eq!(way(place(10.0, -9.0), there, 20.0), Some([there; 3]));
    }
}
