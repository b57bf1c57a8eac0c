//! Rapids: one axis after the other, around the part.

use torno_part::Place;

use crate::stock::Stock;

/// The places over which a rapid goes: a corner, if both axes move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Way {
    pub(crate) corner: Place,
    /// Where it cuts, if it does whichever axis goes first.
    pub(crate) meets: Option<Place>,
}

/// The way of a rapid: away from the part the infeed goes first, towards it the feed; the other way round if that cuts.
/// `away` is the side that is outside of the part: whether radii grow there. The stock is as the program has cut it.
pub(crate) fn way(from: Place, to: Place, away: bool, stock: Option<(&Stock, Place)>) -> Way {
    let infeed_first = Place { z: from.z, x: to.x };
    let feed_first = Place { z: to.z, x: from.x };
    let leaves = if away { to.x > from.x } else { to.x < from.x };
    let corners = if leaves { [infeed_first, feed_first] } else { [feed_first, infeed_first] };
    let Some((stock, shift)) = stock else { return Way { corner: corners[0], meets: None } };
    let on_bar = |place: Place| Place { z: place.z + shift.z, x: place.x + shift.x };
    let meets = |corner: Place| {
        let (from, corner, to) = (on_bar(from), on_bar(corner), on_bar(to));
        stock.meets(from, corner).or_else(|| stock.meets(corner, to))
    };
    let first = meets(corners[0]);
    if first.is_none() || meets(corners[1]).is_some() {
        return Way { corner: corners[0], meets: first };
    }
    Way { corner: corners[1], meets: None }
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
        let Way { corner, meets } = way(from, to, true, Some((&stock, Place::default())));
        (corner, meets.is_some())
    }

    #[test]
    fn out_first_and_in_last() {
        assert_eq!(found(place(10.0, -10.0), place(15.0, 1.0)), (place(15.0, -10.0), false));
        assert_eq!(found(place(15.0, -20.0), place(12.0, 1.0)), (place(15.0, 1.0), false));
        // In a bore it is the other way round.
        let bore = |from, to| way(from, to, false, None).corner;
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
        assert!((met.z + 10.0).abs() < 0.02 && met.x == 12.0, "{met:?}");
        assert_eq!(stock.meets(place(10.0, 0.0), place(10.0, -10.0)), None);
    }
}
