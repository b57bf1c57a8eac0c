//! What a nose sweeps on lines and arcs, outside and in a bore.

#![allow(clippy::unwrap_used, reason = "part of tests")]
#![allow(clippy::disallowed_methods, reason = "what is compared with a tolerance may differ in its last digits")]

use proptest::prelude::*;
use torno_part::{Arc, Limits, Move, Nose, Path, Place, Profile, Resolution, Side, Turning, Violation};
use torno_part::{cylinders, deviation};

fn nose() -> Nose {
    Nose::new(0.4, 90.0, 32.0).unwrap()
}

fn place(z: f64, x: f64) -> Place {
    Place { z, x }
}

fn around(centre: Place, radius: f64, angle: f64) -> Place {
    place(centre.z + radius * angle.cos(), centre.x + radius * angle.sin())
}

/// An arc's begin, and the arc.
#[derive(Clone, Copy, Debug)]
struct Drawn {
    from: Place,
    arc: Arc,
    radius: f64,
    start: f64,
    swept: f64,
}

fn arcs() -> impl Strategy<Value = Drawn> {
    ((-20.0..3.0, 2.0..12.0), 0.05..9.0, 0.0..6.2, 0.01..6.2_f64, any::<bool>()).prop_map(
        |((z, x), radius, start, swept, clockwise)| {
            let swept = if clockwise { -swept } else { swept };
            let centre = place(z, x);
            let to = around(centre, radius, start + swept);
            let arc = Arc { to, centre, clockwise, turns: 1 };
            Drawn { from: around(centre, radius, start), arc, radius, start, swept }
        },
    )
}

fn noses() -> impl Strategy<Value = Nose> {
    (prop_oneof![Just(0.0), 0.0..1.5], prop_oneof![Just(90.0), 20.0..=90.0], 10.0..80.0)
        .prop_map(|(r, lead, trail)| Nose::new(r, lead, trail).unwrap())
}

fn ways() -> impl Strategy<Value = Vec<(Place, Place)>> {
    let place = || (-25.0..5.0, -1.0..9.0).prop_map(|(z, x)| Place { z, x });
    proptest::collection::vec((place(), place()), 1..6)
}

/// How many points are further apart than so many mm.
fn apart(one: &[f64], other: &[f64], by: f64) -> usize {
    assert_eq!(one.len(), other.len());
    one.iter().zip(other).filter(|(a, b)| (**a - **b).abs() > by).count()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// Of chords that leave the arc by no more than 3 µm.
    #[test]
    fn an_arc_is_its_many_chords(drawn in arcs(), nose in noses()) {
        let Drawn { from, arc, radius, start, swept } = drawn;
        let mut exact = Profile::bar(16.0, 20.0);
        let shaving = exact.cut_arc(&nose, from, &arc);
        let mut chords = Profile::bar(16.0, 20.0);
        let count = 4_000;
        for n in 0..count {
            let at = |n: u32| around(arc.centre, radius, start + swept * f64::from(n) / f64::from(count));
            chords.cut(&nose, at(n), at(n + 1));
        }
        // A straight edge of 80 degrees makes 6 of 1; an upright edge's very end may miss a point.
        prop_assert!(apart(&exact.radii(), &chords.radii(), 3e-5) <= 3);
        let lost: f64 = chords.radii().iter().map(|left| 8.0 - left).sum();
        prop_assert!((lost * 0.01 - shaving.area).abs() < 0.3);
        let places: Vec<Vec<Place>> = Path { start: from, moves: vec![Move::Arc(arc)] }.places(0.001).collect();
        let (first, last) = (places[0][0], *places[0].last().unwrap());
        prop_assert_eq!((first, last), (from, arc.to));
        for pair in places[0].windows(2) {
            let middle = place(f64::midpoint(pair[0].z, pair[1].z), f64::midpoint(pair[0].x, pair[1].x));
            let off = (middle.z - arc.centre.z).hypot(middle.x - arc.centre.x) - radius;
            prop_assert!(off.abs() <= 0.001 + 1e-6, "{off}");
        }
    }

    /// Straight ways, against very many noses that plunge to where they are.
    #[test]
    fn a_line_is_its_many_noses(
        (from, to) in (((-22.0..2.0), 2.0..9.0), ((-22.0..2.0), 2.0..9.0)),
        nose in noses(),
    ) {
        let (from, to) = (place(from.0, from.1), place(to.0, to.1));
        let mut swept = Profile::bar(16.0, 20.0);
        swept.cut(&nose, from, to);
        let mut noses = Profile::bar(16.0, 20.0);
        for n in 0..=4_000 {
            let share = f64::from(n) / 4_000.0;
            let tip = place(from.z + share * (to.z - from.z), from.x + share * (to.x - from.x));
            noses.cut(&nose, place(tip.z, 20.0), tip);
        }
        let (swept, noses) = (swept.radii(), noses.radii());
        prop_assert!(swept.iter().zip(&*noses).all(|(swept, noses)| *swept <= noses + 1e-9));
        prop_assert!(apart(&swept, &noses, 0.04) <= 2);
    }

    /// Lines and arcs.
    #[test]
    fn a_bore_is_the_mirror_image_of_an_outside(
        ways in ways(),
        drawn in arcs(),
        nose in noses(),
        (bar, wall) in (20.0..40.0, 2.0..9.0),
    ) {
        let mirrored = |it: Place| place(it.z, bar / 2.0 - it.x);
        let mut outside = Profile::bar(2.0 * wall, 20.0);
        let mut inside = Profile::tube(Side::Inside, bar, bar - 2.0 * wall, 20.0);
        for (from, to) in ways {
            let one = outside.cut(&nose, from, to);
            let other = inside.cut(&nose, mirrored(from), mirrored(to));
            prop_assert!((one.area - other.area).abs() < 1e-6 && (one.thickest - other.thickest).abs() < 1e-6);
        }
        let Drawn { from, arc, .. } = drawn;
        outside.cut_arc(&nose, from, &arc);
        let Arc { to, centre, clockwise, turns } = arc;
        let arc = Arc { to: mirrored(to), centre: mirrored(centre), clockwise: !clockwise, turns };
        inside.cut_arc(&nose, mirrored(from), &arc);
        let image: Vec<f64> = inside.radii().iter().map(|radius| bar / 2.0 - radius).collect();
        prop_assert!(apart(&outside.radii(), &image, 1e-6) <= 6);
    }
}

#[test]
fn a_way_of_lines_and_arcs_is_swept_in_order() {
    // Along, a quarter outwards around (-10, 13), and on.
    let quarter = Arc { to: place(-11.0, 13.0), centre: place(-10.0, 13.0), clockwise: true, turns: 1 };
    let moves = vec![Move::Line(place(-10.0, 12.0)), Move::Arc(quarter), Move::Line(place(-11.0, 15.0))];
    let mut part = Profile::bar(28.0, 60.0);
    part.sweep(&nose(), &Path { start: place(0.0, 12.0), moves });
    assert_eq!(part.diameter(-5.0), Some(24.0));
    // A fillet of the radius of both.
    let fillet = |z: f64| 2.0 * (13.4 - (1.4_f64 * 1.4 - (z + 9.6) * (z + 9.6)).sqrt());
    for z in [-9.8, -10.2, -10.6, -10.9] {
        assert!((part.diameter(z).unwrap() - fillet(z)).abs() < 1e-9, "{z}");
    }
    assert_eq!(part.diameter(-11.02), Some(28.0));
}

#[test]
fn a_whole_circle_goes_all_around_and_one_that_ends_beside_itself_gets_there() {
    let centre = place(-10.0, 14.0);
    let whole = Arc { to: place(-8.0, 14.0), centre, clockwise: false, turns: 1 };
    let mut part = Profile::bar(28.0, 60.0);
    part.cut_arc(&nose(), place(-8.0, 14.0), &whole);
    assert!((part.diameter(-9.6).unwrap() - 24.0).abs() < 1e-9);
    // Its radius is 0.08 mm larger at the end.
    let spiral = Arc { to: place(-12.02, 13.5), clockwise: true, ..whole };
    let mut part = Profile::bar(28.0, 60.0);
    part.cut_arc(&nose(), place(-8.0, 14.0), &spiral);
    assert!(part.diameter(-12.01).unwrap() < 28.0 && part.diameter(-12.03) == Some(28.0));
}

#[test]
fn a_bore_is_turned_to_its_shoulder_and_measured() {
    let mut bored = Profile::tube(Side::Inside, 28.0, 10.0, 60.0);
    bored.cut(&nose(), place(0.0, 7.0), place(-20.0, 7.0));
    assert_eq!((bored.stock(), bored.diameter(-10.0), bored.diameter(-20.01)), (10.0, Some(14.0), Some(10.0)));
    assert!((bored.diameter(-20.0).unwrap() - 2.0 * 6.6).abs() < 1e-12, "the nose's arc begins at the shoulder");
    let found = cylinders(&bored, 2.0);
    assert_eq!(found.len(), 2, "{found:?}");
    assert!((found[0].to + 20.0).abs() < 0.006 && found[1].stock && !found[0].stock, "{found:?}");
    assert!((found[0].diameter - 14.0).abs() < 1e-9);

    let mut asked = Profile::tube(Side::Inside, 28.0, 10.0, 60.0);
    asked.cut(&nose(), place(0.0, 7.1), place(-20.0, 7.1));
    let narrow = deviation(&bored, &asked);
    assert!(narrow.to_string().starts_with("0.20 mm of diameter too narrow, at z = -9."), "{narrow}");
    let wide = deviation(&asked, &bored);
    assert!(wide.to_string().starts_with("0.20 mm of diameter too wide, at z = -9."), "{wide}");
    // The axis side of the bore is no material.
    assert_eq!(bored.cut(&nose(), place(0.0, 4.9), place(-40.0, 4.9)).area, 0.0);
}

/// What happens when a tool goes to these places, slowly.
fn events(bar: Profile, start: Place, ways: &[Place]) -> Vec<(&'static str, f64)> {
    let limits = Limits { feed: 10.0, depth: None, chuck: None };
    let mut turning = Turning::new(bar, nose(), limits, Resolution::default(), start);
    turning.spin(1500.0);
    for (n, to) in ways.iter().enumerate() {
        turning.go(100.0 * (n + 1) as f64, *to);
    }
    turning.finish().1.iter().map(|it| (it.event.name(), it.worst)).collect()
}

#[test]
fn a_tool_that_comes_through_the_wall_is_told_of() {
    let tube = |side| Profile::tube(side, 28.0, 10.0, 60.0);
    let along = |x: f64| [place(0.0, x), place(-20.0, x)];
    assert_eq!(events(tube(Side::Inside), place(0.0, 4.0), &along(13.9)), []);
    assert_eq!(events(tube(Side::Outside), place(0.0, 15.0), &along(5.1)), []);
    for (side, from, to) in [(Side::Inside, 4.0, 14.5), (Side::Outside, 15.0, 4.5)] {
        let found = events(tube(side), place(0.0, from), &along(to));
        assert!(found[0].0 == Violation::Wall.name() && found.iter().all(|it| it.1 <= 0.5 + 1e-9), "{found:?}");
        assert!(found.iter().any(|it| it.1 > 0.5 - 1e-9), "{found:?}");
    }
    // A slanting edge cuts the rim of the bar; the tip is beyond the wall, and beside the bar.
    let slanting = Nose::new(0.4, 45.0, 32.0).unwrap();
    let shaving = tube(Side::Outside).cut(&slanting, place(1.0, 16.0), place(1.0, 4.5));
    assert!(shaving.area > 1.0 && shaving.through == 0.0, "{shaving:?}");
    // Without a bore there is no other side: a face is cut to the axis and beyond.
    assert_eq!(events(Profile::bar(28.0, 60.0), place(0.0, 15.0), &[place(0.0, -0.4)]), []);
}

/// What docs/part.md says of a nose that no one makes up for.
#[test]
fn a_taper_is_off_by_what_the_documentation_says() {
    for (degrees, rising, falling) in [(5.0, 0.067, 0.073), (15.0, 0.186, 0.243), (30.0, 0.338, 0.586)] {
        let (angle, nose) = (f64::to_radians(degrees), nose());
        let [one, other] = [place(0.0, 8.0), place(-8.0, 8.0 + 8.0 * angle.tan())];
        let off = |from: Place, to: Place| {
            let mut part = Profile::bar(28.0, 60.0);
            part.cut(&nose, from, to);
            part.diameter(-4.0).unwrap() - (from.x + to.x)
        };
        let found = off(one, other);
        assert!((found - 0.8 * (1.0 + angle.tan() - 1.0 / angle.cos())).abs() < 1e-9, "{degrees}");
        assert!((found - rising).abs() < 5e-4, "{degrees}: {found}");
        let found = -off(place(one.z, other.x), place(other.z, one.x));
        assert!((found - falling).abs() < 5e-4, "{degrees}: {found}");
    }
}
