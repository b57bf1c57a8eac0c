//! Plans of whole programs: where the frames lead, held against the shape that the program asks for.

#![allow(clippy::unwrap_used, reason = "in a test, a panic is an answer")]

use proptest::prelude::*;
use torno_gcode::{Place as Point, Settings as Reading, interpret};
use torno_part::{Limits, Nose, Place, Profile};
use torno_planner::{Feed, Finding, Infeed, Planned, Report, Scale, Settings, Severity, Side, Stock, plan};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{Direction, Frame, FrameDecoder};
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::Character;

const COUNT: f64 = 1.0 / 450.0;
const SLOT: f64 = 16.0 / 90.0;
/// The slide stops this much past an edge: it coasts, and it is looked at every 10 ms.
const OVERRUN: f64 = 1.5 * (0.05 + 0.005);
const START: Place = Place { z: 0.0, x: 14.0 + 2.0 * SLOT };

fn settings() -> Settings {
    let feed = Feed { mm_per_count: COUNT, sample_s: 0.03, reach: 36_000 };
    let infeed = Infeed { mm_per_slot: SLOT, mm_per_s: 2.0 * 8.0 / 60.0, overrun: OVERRUN, reach: 450 };
    Settings {
        scale: Scale { feed, infeed },
        start: START,
        side: Side::Middle,
        bore: false,
        stock: None,
        optimise: false,
        frames_max: Settings::FRAMES_MAX,
    }
}

fn bar() -> Stock {
    let nose = Nose::new(0.4, 90.0, 32.0).unwrap();
    let limits = Limits { feed: 10.0, depth: None, chuck: None };
    Stock { profile: Profile::bar(28.0, 60.0), nose, limits, start: START }
}

fn planned(text: &str, settings: Settings) -> (Vec<Planned>, Report) {
    let start = Point { x: settings.start.x, z: settings.start.z, ..Point::default() };
    let (motions, outcome) = interpret(text.as_bytes(), &Reading { start, ..Reading::default() });
    assert!(!outcome.is_refused(), "{:?}", outcome.findings);
    let mut plan = plan(settings, motions.into_iter());
    let frames = plan.by_ref().collect();
    (frames, plan.report())
}

/// The ways of the tool, one for each frame: from where to where, and the number of the line.
fn ways(frames: &[Planned]) -> Vec<(Place, Place, usize)> {
    let (mut count, mut slot) = (0, 0_i64);
    let mut at = START;
    let mut found = Vec::new();
    let way = |direction: Direction, distance: u16| direction.sign() * i64::from(distance);
    for Planned { line, frame } in frames {
        let counts = way(frame.transverse.direction(), frame.transverse.distance());
        let slots = way(frame.depth.direction(), frame.depth.distance());
        assert!(counts == 0 || slots == 0, "one axis a frame");
        (count, slot) = (count + counts, slot + slots);
        let mut to = Place { z: START.z + COUNT * count as f64, ..at };
        if slots != 0 {
            to.x = START.x + SLOT * (slot as f64 - slots.signum() as f64 * (0.5 - OVERRUN));
        }
        found.push((at, to, *line));
        at = to;
    }
    found
}

/// The most that the tool is off a shape on the feeds of some lines, within a count of where it is: below and above.
fn off(frames: &[Planned], lines: std::ops::RangeInclusive<usize>, shape: impl Fn(f64) -> f64) -> (f64, f64) {
    let mut most = (0.0, 0.0);
    let mut feeds = 0;
    for (from, to, line) in ways(frames) {
        if !lines.contains(&line) || from.z == to.z {
            continue;
        }
        feeds += 1;
        for z in [from.z, to.z] {
            let near = [z - COUNT, z, z + COUNT].map(|z| from.x - shape(z));
            let (least, greatest) =
                (near.iter().copied().fold(f64::MAX, f64::min), near.iter().copied().fold(f64::MIN, f64::max));
            // Of the places within a count, the one that is best.
            let best = if least > 0.0 { least } else { greatest.min(0.0) };
            most = (f64::min(most.0, best), f64::max(most.1, best));
        }
    }
    assert!(feeds > 3, "{feeds}");
    most
}

fn assert_half_a_slot((below, above): (f64, f64), report: &Report) {
    let half = SLOT / 2.0 + 1e-9;
    assert!(below >= -half && above <= half, "{below} {above}");
    assert!(report.worst.x <= half && report.worst.x > SLOT / 4.0 && report.worst.z <= COUNT, "{:?}", report.worst);
    assert!(!report.refused, "{:?}", report.findings);
}

const HEAD: &str = "G21 G18 G8\nM3 S1500\n";

#[test]
fn a_taper_stays_within_half_a_slot() {
    for (x, to) in [(9.3, 13.1), (13.1, 9.3)] {
        let text = format!("{HEAD}G1 X{x} F100\nG1 X{to} Z-23.7\nM2\n");
        let (frames, report) = planned(&text, settings());
        let shape = |z: f64| x + (to - x) * (z / -23.7).clamp(0.0, 1.0);
        assert_half_a_slot(off(&frames, 4..=4, shape), &report);
        let end = ways(&frames).last().unwrap().1;
        assert!((end.z - report.end.z).abs() < 1e-9 && (end.x - report.end.x).abs() < 1e-9, "{report:?}");
        assert!((end.z + 23.7).abs() <= COUNT && (end.x - to).abs() <= SLOT / 2.0);
    }
}

#[test]
fn outside_a_tool_never_enters_the_part() {
    for (bore, x, to) in [(false, 9.3, 13.1), (false, 13.1, 9.3), (true, 9.3, 13.1), (true, 13.1, 9.3)] {
        let text = format!("{HEAD}G1 X{x} F100\nG1 X{to} Z-23.7\nM2\n");
        let (frames, report) = planned(&text, Settings { side: Side::Outside, bore, ..settings() });
        let shape = |z: f64| x + (to - x) * (z / -23.7).clamp(0.0, 1.0);
        let (below, above) = off(&frames, 4..=4, shape);
        let (inside, outside) = if bore { (above, -below) } else { (-below, above) };
        assert!(inside <= 1e-9 && outside <= SLOT + 1e-9 && outside > SLOT / 2.0, "{inside} {outside}");
        assert!(report.worst.x <= SLOT + 1e-9);
    }
}

#[test]
fn an_arc_of_each_quadrant_stays_within_half_a_slot() {
    // Around X 14, Z -10 with a radius of 6: from angle to angle, in quarter turns from +Z towards +X.
    let at = |quarter: i32| match quarter.rem_euclid(4) {
        0 => (14.0, -4.0),
        1 => (20.0, -10.0),
        2 => (14.0, -16.0),
        _ => (8.0, -10.0),
    };
    for quarter in 0..4 {
        for (from, to, code) in [(quarter, quarter + 1, 3), (quarter + 1, quarter, 2)] {
            let ((x, z), (to_x, to_z)) = (at(from), at(to));
            let (i, k) = (14.0 - x, -10.0 - z);
            let text = format!("{HEAD}G0 X{x} Z{z}\nG{code} X{to_x} Z{to_z} I{i} K{k} F100\nM2\n");
            let (frames, report) = planned(&text, settings());
            let above = quarter < 2;
            let shape = |z: f64| {
                let up = (36.0 - (z + 10.0) * (z + 10.0)).max(0.0).sqrt();
                14.0 + if above { up } else { -up }
            };
            assert_half_a_slot(off(&frames, 4..=4, shape), &report);
            assert!((report.end.x - to_x).abs() <= SLOT / 2.0 && (report.end.z - to_z).abs() <= COUNT, "{report:?}");
        }
    }
}

#[test]
fn an_arc_over_quadrants_turns_back_in_x_at_their_border() {
    let text = format!("{HEAD}G1 X13 Z-5 F100\nG2 X13 Z-15 I3 K-5\nM2\n");
    let (frames, report) = planned(&text, settings());
    let radius = libm::hypot(3.0, 5.0);
    let shape = |z: f64| 16.0 - (radius * radius - (z + 10.0) * (z + 10.0)).max(0.0).sqrt();
    assert_half_a_slot(off(&frames, 4..=4, shape), &report);
    let senses: Vec<i64> = frames
        .iter()
        .filter(|planned| planned.line == 4)
        .map(|planned| planned.frame.depth)
        .filter(|depth| depth.distance() != 0)
        .map(|depth| depth.direction().sign())
        .collect();
    assert!(senses.is_sorted() && senses.contains(&-1) && senses.contains(&1), "{senses:?}");
}

#[test]
fn roughing_cycles_of_a_fanuc_end_on_their_contour() {
    let head = "O0001\nG98 G21 G97 S1500 M3\nG0 X30. Z1.\n";
    let contour = "N10 G0 X16.\nG1 Z-8. F80\nX22. Z-18.\nG2 X26. Z-20. R2.\nN20 G1 X29.\n";
    let facing = "N10 G0 Z-6.\nG1 X20. F80\nX14. Z1.\nN20 Z1.5\n";
    for (cycle, contour) in [
        ("G71 U1. R0.5\nG71 P10 Q20 U0.4 W0.1 F100\n", contour),
        ("G71 P10 Q20 D1. U0.4 W0.1 F100\n", contour),
        ("G72 W1. R0.5\nG72 P10 Q20 U0.4 W0.1 F100\n", facing),
        ("G72 P10 Q20 D1. U0.4 W0.1 F100\n", facing),
    ] {
        let text = format!("{head}{cycle}{contour}G70 P10 Q20\nM30\n");
        let (frames, report) = planned(&text, Settings { stock: Some(bar()), ..settings() });
        assert!(!report.refused, "{cycle}: {:?}", report.findings);
        assert!(report.worst.x <= SLOT / 2.0 + 1e-9 && report.worst.z <= COUNT, "{:?}", report.worst);
        // What the frames cut is what the program asks for, within half a slot.
        let mut profile = bar().profile;
        for (from, to, _) in ways(&frames) {
            profile.cut(&bar().nose, from, to);
        }
        let asked = report.stock.unwrap().profile;
        let z = |point: usize| Profile::z(point);
        let steep = |point: usize| {
            asked.radii()[point.saturating_sub(2)..(point + 3).min(asked.radii().len())]
                .iter()
                .fold((f64::MAX, 0.0_f64), |(least, most), radius| (least.min(*radius), most.max(*radius)))
        };
        for (point, radius) in profile.radii().iter().enumerate() {
            let (least, most) = steep(point);
            let within = least - SLOT / 2.0 - 0.01..=most + SLOT / 2.0 + 0.01;
            assert!(within.contains(radius), "{cycle}: {radius} at {}, not {within:?}", z(point));
        }
    }
}

#[test]
fn a_groove_and_a_bore_are_planned() {
    let text = format!("{HEAD}G0 X14.5 Z-20\nG1 X10 F60\nG1 Z-22\nG0 X14.5\nG0 Z0\nM2\n");
    let (frames, report) = planned(&text, Settings { stock: Some(bar()), ..settings() });
    assert!(!report.refused, "{:?}", report.findings);
    let bottom: Vec<_> = ways(&frames).into_iter().filter(|(_, _, line)| *line == 5).collect();
    assert!(bottom.iter().all(|(from, to, _)| (from.x - 10.0).abs() <= SLOT / 2.0 && to.z == -22.0), "{bottom:?}");
    // In a bore a rapid leaves the wall before it goes along it.
    let text = format!("{HEAD}G0 X8 Z2\nG1 Z-10 F60\nG0 X7 Z2\nM2\n");
    let (frames, report) = planned(&text, Settings { bore: true, ..settings() });
    assert!(!report.refused);
    let out: Vec<bool> = frames
        .iter()
        .filter(|planned| planned.line == 5)
        .map(|planned| planned.frame.transverse.distance() == 0)
        .collect();
    assert_eq!(out, [true, false]);
}

#[test]
fn ten_thousand_relative_moves_end_exactly() {
    let text = format!("{HEAD}G91\nO1 repeat [10000]\nG1 X-0.0007 Z-0.0031 F50\nO1 endrepeat\nG90\nM2\n");
    let (frames, report) = planned(&text, settings());
    assert_eq!((report.end.z / COUNT).round() as i64, (-31.0 * 450.0) as i64);
    assert!((report.end.x - (START.x - 7.0)).abs() <= SLOT / 2.0, "{report:?}");
    let end = ways(&frames).last().unwrap().1;
    assert!((end.z + 31.0).abs() < 1e-9, "{end:?}");
    let (_, there) = planned(&format!("{HEAD}G1 X{} Z-31 F50\nM2\n", START.x - 7.0), settings());
    assert_eq!(there.end.z, report.end.z);
}

#[test]
fn a_spindle_change_is_a_frame_of_its_own_before_the_cut() {
    let text = format!("{HEAD}G0 Z1\nG1 Z-1 F100\nS2010\nG1 Z-2\nM5\nG0 Z0\nM2\n");
    let (frames, _) = planned(&text, settings());
    let seen: Vec<_> = frames
        .iter()
        .map(|planned| (planned.line, planned.frame.spindle.rpm(), planned.frame.transverse.distance()))
        .collect();
    let expected = [(3, 0, 450), (4, 1500, 0), (4, 1500, 900), (6, 2020, 0), (6, 2020, 450), (7, 0, 0), (8, 0, 900)];
    assert_eq!(seen, expected);
}

#[test]
fn at_the_end_the_spindle_stops() {
    for (end, line) in [("M2\n", 5), ("%\n", 5), ("", 4)] {
        let (frames, _) = planned(&format!("%\n{HEAD}G1 Z-1 F100\n{end}"), settings());
        let last = frames.last().unwrap();
        assert_eq!((last.frame.emit(), last.line), ([0; 8], line), "{end}");
    }
}

#[test]
fn optimised_retracts_are_short_and_cut_nothing() {
    let mut text = format!("{HEAD}G0 X15 Z0.5\n");
    for pass in 0..4 {
        let x = 13.5 - 0.5 * f64::from(pass);
        // The retract is a rapid, or part of a cut.
        let retract = if pass < 2 { format!("G1 X{}\nG0 X30", x + 0.5) } else { "G1 X30".to_owned() };
        text += &format!("G0 X{x}\nG1 Z-20 F100\n{retract}\nG0 Z0.5\n");
    }
    text += "G0 X40 Z5\nM2\n";
    let slots = |optimise: bool| {
        let (frames, report) = planned(&text, Settings { stock: Some(bar()), optimise, ..settings() });
        assert!(!report.refused, "{:?}", report.findings);
        let way: i64 = frames.iter().map(|planned| i64::from(planned.frame.depth.distance())).sum();
        // No way at the fastest feed cuts.
        let mut profile = bar().profile;
        for (planned, (from, to, _)) in frames.iter().zip(ways(&frames)) {
            let off = profile.cut(&bar().nose, from, to).thickest;
            assert!(planned.frame.transverse.speed() < 225 || off < 1e-6, "{off} on {from:?} {to:?}");
        }
        (way, report.end, report.stock.unwrap().profile)
    };
    let ((long, end, asked), (short, other_end, also_asked)) = (slots(false), slots(true));
    assert!(short < long / 3, "{short} of {long} slots");
    assert_eq!(asked, also_asked);
    assert!((end.x - other_end.x).abs() <= SLOT && end.z == other_end.z, "{end:?} {other_end:?}");
}

fn findings(text: &str) -> Vec<(usize, char, String)> {
    let (_, report) = planned(text, Settings { stock: Some(bar()), ..settings() });
    let errors = report.findings.into_iter().filter(|finding| finding.severity == Severity::Error);
    errors.map(|Finding { line, word, message, .. }| (line, char::from(word), message)).collect()
}

#[test]
fn what_cannot_be_done_is_refused_with_its_place() {
    let refused = |text: &str, word: char, message: &str| {
        let found = findings(&format!("G21 G18 G8\n{text}\nM2\n"));
        assert_eq!(found, [(2, word, message.to_owned())], "{text}");
    };
    refused("M4 S500", 'm', "M4: the spindle turns in one sense only (M3)");
    refused("G1 X13 F60", 'g', "this cuts, and the spindle stands");
    refused("M3 S150 G1 X13 F60", 's', "this cuts, and the spindle is to turn at 150 rpm: it cuts at 200 and more");
    refused("M3 S500 G1 Z-5 F4", 'f', "the feed is 4.00 mm a minute: the slowest is 4.44");
    refused("G0 Z81", 'z', "Z is to go to 81.000 mm: its travel is -79.90 to 79.90 mm");
    refused("G0 X-70", 'x', "X is to go to -70.000 mm, as a radius: its travel is -65.38 to 94.09 mm");
    refused("G0 X12", 'x', "the rapid cuts the part at Z 0.000, X 13.595 (radius)");
    refused("G0 Y1", 'y', "the lathe has no axis Y");
    refused("G0 A1", 'a', "the lathe has no axis A");
    refused("G17 G2 X14.35556 Y0 I-1 F50", 'g', "the lathe's arcs lie in the plane of X and Z (G18)");
    let found = findings(&format!("{HEAD}G1 X13 F60\nG1 Z-10 F700\nM2\n"));
    let why = "this cuts at 700 mm a minute: the part allows 600 (rapid_mm_per_s)";
    assert_eq!(found, [(4, 'f', why.to_owned())]);
    // In the air it may.
    assert_eq!(findings(&format!("{HEAD}G1 Z-10 F700\nM2\n")), []);
}

#[test]
fn one_error_does_not_hide_the_next_and_20_are_enough() {
    let text = "G0 Z90\nG0 Z-90\n".repeat(15);
    let (_, report) = planned(&format!("G18\n{text}M2\n"), settings());
    assert!(report.refused);
    assert_eq!(report.findings.len(), 20);
}

#[test]
fn what_is_rounded_is_told_once() {
    let text = format!("{HEAD}G1 Z-1 F6\nG1 Z-2 F6\nG1 Z-3 F1500\nG1 X14 Z-4 F1500\nS5000\nG1 Z-5\nG4 P1\nM0\nM2\n");
    let (_, report) = planned(&text, settings());
    let told: Vec<_> = report.findings.iter().map(|finding| (finding.line, char::from(finding.word))).collect();
    assert_eq!(told, [(3, 'f'), (5, 'f'), (6, 'f'), (7, 's'), (9, 'g'), (10, 'm')], "{:?}", report.findings);
    assert!(!report.refused);
}

#[test]
fn a_plan_has_an_end() {
    for text in ["O1 repeat [3000]\nG1 Z-1 F100\nG1 Z0\nO1 endrepeat\n", "G2 X14 Z0 K-0.0015 P1000000000 F100\n"] {
        let settings = Settings { frames_max: 5_000, ..settings() };
        let (frames, report) = planned(&format!("{HEAD}G1 X14 F100\n{text}M2\n"), settings);
        assert!(report.refused && frames.len() <= 5_001, "{}", frames.len());
    }
}

#[test]
fn another_machine_has_other_counts() {
    let base = settings();
    let feed = Feed { mm_per_count: -COUNT / 2.0, ..base.scale.feed };
    let infeed = Infeed { mm_per_slot: -SLOT, ..base.scale.infeed };
    let text = format!("{HEAD}G1 X13 Z-1 F100\nM2\n");
    let total = |settings: Settings| {
        let (frames, report) = planned(&text, settings);
        let mut sum = (0, 0);
        for Planned { frame: Frame { transverse, depth, .. }, .. } in frames {
            sum.0 += transverse.direction().sign() * i64::from(transverse.distance());
            sum.1 += depth.direction().sign() * i64::from(depth.distance());
        }
        (sum, report.end)
    };
    let (here, end) = total(base.clone());
    let (there, other_end) = total(Settings { scale: Scale { feed, infeed }, ..base });
    assert_eq!((here.0 * -2, -here.1), there);
    assert!((end.x - other_end.x).abs() < 1e-9 && (end.z - other_end.z).abs() < 1e-9);
}

fn words() -> impl Strategy<Value = String> {
    let place = || (-20.0..30.0_f64, -70.0..70.0_f64);
    prop_oneof![
        place().prop_map(|(x, z)| format!("G0 X{x:.3} Z{z:.3}")),
        (place(), 1.0..1200.0).prop_map(|((x, z), feed)| format!("G1 X{x:.3} Z{z:.3} F{feed:.2}")),
        (-20.0..30.0_f64).prop_map(|x| format!("G1 X{x:.3} F50")),
        (-70.0..70.0_f64).prop_map(|z| format!("G1 Z{z:.3} F50")),
        (place(), 20.0..200.0, 2..4).prop_map(|((x, z), r, code)| format!("G{code} X{x:.3} Z{z:.3} R{r:.3} F80")),
        (0.0..5000.0_f64).prop_map(|rpm| format!("G97 M3 S{rpm:.1}")),
        (1.0..300.0_f64).prop_map(|speed| format!("G96 D2500 S{speed:.1}")),
        Just("M5".to_owned()),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn what_is_accepted_the_master_takes(
        lines in proptest::collection::vec(words(), 1..12),
        outside: bool,
        bore: bool,
        optimise: bool,
    ) {
        let text = format!("G21 G18 G8 F50\n{}\nM2\n", lines.join("\n"));
        let start = Point { x: START.x, z: START.z, ..Point::default() };
        let (motions, _) = interpret(text.as_bytes(), &Reading { start, ..Reading::default() });
        let side = if outside { Side::Outside } else { Side::Middle };
        let stock = (!bore).then(bar);
        let mut plan = plan(Settings { side, bore, stock, optimise, ..settings() }, motions.into_iter());
        let frames: Vec<Planned> = plan.by_ref().collect();
        let report = plan.report();
        let mut decoder = FrameDecoder::new(Clock::TRUE);
        let mut now = Instant::START;
        for Planned { frame, .. } in &frames {
            let bytes = frame.emit();
            prop_assert_eq!(Frame::parse(bytes), Ok(*frame));
            let mut taken = None;
            for byte in bytes {
                now += Span::from_millis(1);
                taken = decoder.push(now, Character::good(byte)).or(taken);
            }
            prop_assert!(matches!(taken, Some(Ok(found)) if found == bytes));
        }
        if report.refused {
            return Ok(());
        }
        let bound = if outside { SLOT } else { SLOT / 2.0 };
        prop_assert!(report.worst.x <= bound + 1e-6 && report.worst.z <= COUNT, "{:?}", report.worst);
        for (_, to, _) in ways(&frames) {
            prop_assert!((to.z - START.z).abs() < 80.0 && (to.x - START.x).abs() < 80.0);
        }
    }
}
