//! The dialect of a Fanuc lathe: what its words ask for, and what is refused.

#![allow(clippy::unwrap_used, reason = "in a test, a panic is an answer")]

use torno_gcode::{Dialect, Feed, Kind, Motion, Sense, Settings, Speed, interpret};

fn read(text: &str) -> (Vec<Motion>, String) {
    let settings = Settings { dialect: Some(Dialect::Fanuc), steps_max: 100_000, ..Settings::default() };
    let (motions, outcome) = interpret(text.as_bytes(), &settings);
    let told: Vec<String> = outcome.findings.iter().map(ToString::to_string).collect();
    (motions, told.join("\n"))
}

/// A move in a few characters: its kind, X as a diameter, Z.
fn short(motions: &[Motion]) -> Vec<String> {
    let round = |value: f64| (value * 1e4).round() / 1e4 + 0.0;
    let place = |kind: &str, to: torno_gcode::Place| format!("{kind} {} {}", round(2.0 * to.x), round(to.z));
    let of = |motion: &Motion| match motion.kind {
        Kind::Rapid { to } => Some(place("R", to)),
        Kind::Feed { to, .. } => Some(place("F", to)),
        Kind::Arc { to, .. } => Some(place("A", to)),
        _ => None,
    };
    motions.iter().filter_map(of).collect()
}

/// The moves of a program without findings.
fn moves(text: &str) -> Vec<String> {
    let (motions, told) = read(text);
    assert_eq!(told, "", "{text}");
    assert_eq!(motions.last().unwrap().kind, Kind::End);
    short(&motions)
}

#[test]
fn x_is_a_diameter_and_u_and_w_are_relative() {
    let text = "%\nO0001 (SHAFT)\nN1 S500 M3\nG0 X20. Z2.\nG1 Z-10. F0.2\nU4. W-1.\nX30. W-2.5\nG28 U0 W0\nM30\n%\n";
    let expected = ["R 20 2", "F 20 -10", "F 24 -11", "F 30 -13.5", "R 30 -13.5", "R 0 0"];
    assert_eq!(moves(text), expected);
}

#[test]
fn arcs_have_radii() {
    let (motions, told) = read("G0 X20. Z0.\nG98 G3 X30. Z-5. R5. F100.\nG2 X40. Z-10. I5. K0.\nM30");
    assert_eq!(told, "");
    let Kind::Arc { centre, .. } = motions[1].kind else { panic!() };
    assert!((centre[0] + 5.0).abs() < 1e-9 && (centre[1] - 10.0).abs() < 1e-9, "{centre:?}");
    let Kind::Arc { centre, feed, .. } = motions[2].kind else { panic!() };
    assert_eq!((centre, feed), ([-5.0, 20.0], Feed::PerMinute(100.0)));
}

#[test]
fn g50_limits_the_spindle_or_sets_the_place() {
    let (motions, told) = read("G50 S2000\nG96 S150 M3\nG97 S500 M5\nG50 X100. Z50.\nG0 X80. Z40.\nM30");
    assert_eq!(told, "");
    let speed = Speed::Surface { m_per_min: 150.0, most_rpm: Some(2000.0) };
    assert_eq!(motions[0].kind, Kind::Spindle { sense: Sense::Clockwise, speed });
    assert_eq!(motions[1].kind, Kind::Spindle { sense: Sense::Off, speed: Speed::Constant(500.0) });
    assert_eq!(short(&motions), ["R -20 -10"]);
}

#[test]
fn cycles_of_one_cut_repeat_with_what_changes() {
    let text = "S500 M3\nG0 X50. Z2.\nG90 X46. Z-20. F0.2\nX42.\nG0 X60.\nG94 X10. Z-1. F0.1\nZ-2.\nM30";
    let expected = [
        "R 50 2", "R 46 2", "F 46 -20", "F 50 -20", "R 50 2", "R 42 2", "F 42 -20", "F 50 -20", "R 50 2", "R 60 2",
        "R 60 -1", "F 10 -1", "F 10 2", "R 60 2", "R 60 -2", "F 10 -2", "F 10 2", "R 60 2",
    ];
    assert_eq!(moves(text), expected);
}

#[test]
fn corners_are_rounded_or_cut_off() {
    let text = "S9 G0 X0. Z0.\nG1 X20. ,R2. F0.1\nW-10. ,C1.\nU10. Z-15. ,R1.\nF0.2 Z-30. ,R5.\nZ-40.\nM30";
    let (motions, told) = read(text);
    assert_eq!(told, "");
    // Where the taper of 45 degrees begins to be round: tan 22.5 degrees of the radius before the corner.
    let (needed, root) = (core::f64::consts::SQRT_2 - 1.0, core::f64::consts::FRAC_1_SQRT_2);
    let round = |value: f64| (value * 1e4).round() / 1e4;
    let taper = format!("F {} {}", round(30.0 - 2.0 * needed * root), round(-15.0 + needed * root));
    let expected = [
        "R 0 0",
        "F 16 0",
        "A 20 -2",
        "F 20 -9",
        &format!("F {} {}", round(20.0 + 2.0 * root), round(-10.0 - root)),
        &taper,
        &format!("A 30 {}", round(-15.0 - needed)),
        // Nothing to round between two cuts on one line.
        "F 30 -30",
        "F 30 -40",
    ];
    assert_eq!(short(&motions), expected);
    let lines: Vec<usize> = motions[1..10].iter().map(|motion| motion.line).collect();
    assert_eq!(lines, [1, 2, 2, 3, 3, 4, 4, 5, 6]);
    let Kind::Arc { centre, turn, feed, .. } = motions[3].kind else { panic!("{:?}", motions[3]) };
    assert_eq!((centre, turn, feed), ([-2.0, 8.0], torno_gcode::Turn::Counterclockwise, Feed::PerRevolution(0.1)));
    let Kind::Arc { centre, turn, .. } = motions[7].kind else { panic!("{:?}", motions[7]) };
    assert!((centre[0] + 15.0 + needed).abs() < 1e-9 && (centre[1] - 14.0).abs() < 1e-9, "{centre:?}");
    assert_eq!(turn, torno_gcode::Turn::Counterclockwise);
    let text = "S9 G0 X30. Z2.\nG71 U5. R1.\nG71 P1 Q2 U0 W0 F0.1\nN1 G0 X20.\nG1 Z-5. ,C1.\nN2 X30.\nM30";
    assert_eq!(moves(text).iter().filter(|line| *line == "F 22 -5" || *line == "F 20 -4").count(), 2);
}

const CONTOUR: &str = "N10 G0 X20.\nG1 Z-10. F0.1\nX30. Z-20.\nG2 X36. Z-23. R3.\nN20 G1 X40.\n";

#[test]
fn g71_cuts_level_by_level_and_g70_along_the_contour() {
    let text = format!("S500 M3\nG0 X40. Z2.\nG71 U4. R1.\nG71 P10 Q20 U0.4 W0.1 F0.3\n{CONTOUR}G70 P10 Q20\nM30");
    let expected = [
        // Levels: 32, 24 mm, then the contour 0.4 mm larger and 0.1 mm further out.
        "R 40 2",
        "R 32 2",
        "F 32 -21.9396",
        "R 34 -20.9396",
        "R 34 2",
        "R 24 2",
        "F 24 -13.5",
        "R 26 -12.5",
        "R 26 2",
        "R 20.4 2.1",
        "F 20.4 -9.9",
        "F 30.4 -19.9",
        "A 36.4 -22.9",
        "F 40.4 -22.9",
        "R 40 2",
        // Finishing.
        "R 20 2",
        "F 20 -10",
        "F 30 -20",
        "A 36 -23",
        "F 40 -23",
        "R 40 2",
    ];
    let found = moves(&text);
    let z = |text: &str| text.rsplit(' ').next().unwrap().parse::<f64>().unwrap();
    assert_eq!(found.len(), expected.len(), "{found:#?}");
    for (nth, (found, expected)) in found.iter().zip(expected).enumerate() {
        let head = |text: &str| text.rsplit_once(' ').unwrap().0.to_owned();
        assert_eq!(head(found), head(expected), "{nth}");
        assert!((z(found) - z(expected)).abs() < 1e-3, "{nth}: {found}, not {expected}");
    }
    // On the arc of radius 3 around X 36, Z -20, all 0.2 and 0.1 mm further out: X 32 is 15.8 in radius without them.
    let level = 15.8_f64;
    let along = -20.0 - (9.0 - (18.0 - level) * (18.0 - level)).sqrt() + 0.1;
    assert!((z(&found[2]) - along).abs() < 1e-3, "{}, not {along}", found[2]);
    // On the taper: X 24 is 11.8 in radius without what is left.
    assert!((z(&found[6]) - (-10.0 - (11.8 - 10.0) * 2.0 + 0.1)).abs() < 1e-3, "{}", found[6]);
}

#[test]
fn g71_and_g72_of_the_second_type_cut_pockets() {
    let expected = [
        "R 40 2", // Levels, from the start's side.
        "R 36 2",
        "F 36 -20",
        "R 37 -19.5",
        "R 37 2",
        "R 32 2",
        "F 32 -20",
        "R 33 -19.5",
        "R 33 2",
        "R 28 2",
        "F 28 -9",
        "R 29 -8.5",
        "R 29 2",
        "R 24 2",
        "F 24 -7",
        "R 25 -6.5",
        "R 25 2",
        // Along the contour, up to the pocket; its levels.
        "R 20 2",
        "F 20 0",
        "F 20 -5",
        "F 30 -10",
        "F 28 -11.6667",
        "F 28 -20",
        "R 29 -19.5",
        "R 29 -11.6667",
        "F 28 -11.6667",
        "F 24 -15",
        "F 24 -20",
        "F 40 -20",
        "R 40 2",
        // Along all of it.
        "R 20 0",
        "F 20 -5",
        "F 30 -10",
        "F 24 -15",
        "F 24 -20",
        "F 40 -20",
        "R 40 2",
    ];
    let contour = "N10 G0 X20. Z0.\nG1 Z-5.\nX30. Z-10.\nX24. Z-15.\nZ-20.\nN20 X40.\nM30";
    let two = format!("S9 G0 X40. Z2.\nG71 U2. R0.5\nG71 P10 Q20 U0 W0 F0.2\n{contour}");
    assert_eq!(moves(&two), expected);
    let one = format!("S9 G0 X40. Z2.\nG71 R0.5\nG71 P10 Q20 D2. F0.2\n{contour}");
    assert_eq!(moves(&one), expected);
    // The same with X and Z changed round: levels in Z, a pocket along X.
    let contour = "N10 G0 X60. Z-20.\nG1 X50.\nX40. Z-10.\nX30. Z-16.\nX20.\nN20 Z0.\nM30";
    let found = moves(&format!("S9 G0 X64. Z0.\nG72 W4. R0.5\nG72 P10 Q20 U0 W0 F0.2\n{contour}"));
    let expected = [
        "R 64 0",
        "R 64 -4",
        "F 20 -4",
        "R 21 -3.5",
        "R 64 -3.5",
        "R 64 -8",
        "F 20 -8",
        "R 21 -7.5",
        "R 64 -7.5",
        "R 64 -12",
        "F 42 -12",
        "R 43 -11.5",
        "R 64 -11.5",
        "R 64 -16",
        "F 46 -16",
        "R 47 -15.5",
        "R 64 -15.5",
        "R 64 -20",
        "F 60 -20",
        "F 50 -20",
        "F 40 -10",
        "F 36.6667 -12",
        "F 20 -12",
        "R 21 -11.5",
        "R 36.6667 -11.5",
        "F 36.6667 -12",
        "F 30 -16",
        "F 20 -16",
        "F 20 0",
        "R 64 0",
        "R 60 -20",
        "F 50 -20",
        "F 40 -10",
        "F 30 -16",
        "F 20 -16",
        "F 20 0",
        "R 64 0",
    ];
    assert_eq!(found, expected);
}

#[test]
fn g72_has_its_levels_in_z_and_g73_follows_the_contour() {
    let text =
        "S500 M3\nG0 X40. Z1.\nG72 W2. R0.5\nG72 P10 Q20 U0 W0 F0.2\nN10 G0 Z-5.\nN15 G1 X20. F0.1\nN20 Z0.\nM30";
    let expected = [
        "R 40 1",
        "R 40 -1",
        "F 20 -1",
        "R 21 -0.5",
        "R 40 -0.5",
        "R 40 -3",
        "F 20 -3",
        "R 21 -2.5",
        "R 40 -2.5",
        "R 40 -5",
        "F 20 -5",
        "F 20 0",
        "R 40 1",
    ];
    assert_eq!(moves(text), expected);
    let text = "S500 M3\nG0 X40. Z1.\nG73 U4. W1. R2\nG73 P10 Q20 U0.4 W0.1 F0.2\nN10 G0 X20. Z0.\nN20 G1 Z-5.\nM30";
    let expected = [
        "R 40 1",
        "R 48.4 2.1",
        "R 28.4 1.1",
        "F 28.4 -3.9",
        "R 40 1",
        "R 40.4 1.1",
        "R 20.4 0.1",
        "F 20.4 -4.9",
        "R 40 1",
    ];
    assert_eq!(moves(text), expected);
}

#[test]
fn pecks_lift_the_tool() {
    let text = "S500 M3\nG0 X20. Z1.\nG75 R0.5\nG75 X14. Z-3. P2000 Q2000 F0.05\nM30";
    let row = |z: &str| {
        let steps = ["R 20", "F 16", "R 17", "F 14", "R 20"];
        steps.map(|step| format!("{step} {z}")).to_vec()
    };
    let expected = [vec!["R 20 1".to_owned()], row("1"), row("-1"), row("-3"), vec!["R 20 1".to_owned()]].concat();
    assert_eq!(moves(text), expected);
}

#[test]
fn subprograms_are_called_and_repeated() {
    let text = "O0001\nG0 X10. Z0.\nM98 P0002 L2\nM98 P20003\nM30\nO0002\nG0 U1.\nM98 P3\nM99\nO0003\nG0 W-1.\nM99\n%";
    let expected = ["R 10 0", "R 11 0", "R 11 -1", "R 12 -1", "R 12 -2", "R 12 -3", "R 12 -4"];
    assert_eq!(moves(text), expected);
}

#[test]
fn variables_have_values_and_stand_in_words() {
    let text =
        "#1=10.\n#100=#1*2+ATAN[1.]/[1.]/45. (21)\n#1=[#1+2.]*-1\nG0 X#100 Z-#1\nU[#1/6.] Z-[SQRT[#100+4.]]\nM30";
    assert_eq!(moves(text), ["R 21 12", "R 19 -5"]);
    let text = "#1=0\nG0 X0. Z0.\nM98 P2 L3\nM30\nO2\n#1=#1+1\nG0 X#1\nM99";
    assert_eq!(moves(text), ["R 0 0", "R 1 0", "R 2 0", "R 3 0"]);
}

#[test]
fn coordinate_systems_move_the_origin() {
    let text = "G10 L2 P2 X10. Z-100.\nG10 L2 P2 U2. W-5.\nG0 X0. Z0.\nG55 X0. Z0.\nX20. Z5.\nG53 Z-1.\nG53 X8.\nU2.\n\
        G54 X1. Z1.\nG59 X1.\nG10 P1 X0 Z0. R0.\nM30";
    let expected = ["R 0 0", "R 12 -105", "R 32 -100", "R 32 -1", "R 8 -1", "R 10 -1", "R 1 1", "R 1 1"];
    assert_eq!(moves(text), expected);
}

#[test]
fn dwells_count_seconds_or_thousandths() {
    let (motions, told) = read("G4 X1.5\nG4 U0.5\nG04 P250\nM30");
    assert_eq!(told, "");
    let seconds = [1.5, 0.5, 0.25].map(|seconds| Kind::Dwell { seconds });
    assert_eq!(motions[..3].iter().map(|motion| motion.kind).collect::<Vec<_>>(), seconds);
}

#[test]
fn what_is_refused_is_told_with_its_place() {
    for (text, expected) in [
        ("G32 Z-5. F1.", "1:1: G32 is not supported yet: threads"),
        ("G92 X10. Z-5. F1.", "1:1: G92 is not supported yet: threads"),
        ("G76 P010060", "1:1: G76 is not supported yet: threads"),
        ("G42 G0 X1.", "1:1: G42 is not supported yet: the compensation of the tool's nose"),
        ("S9 G1 X9. ,R1. F1.\nG0 X9.", "2:1: the corner (,R or ,C) of line 1 needs a G1 behind it"),
        ("G0 X9. ,R1.", "1:8: a corner (,R or ,C) belongs to a cut by G1"),
        ("S9 G1 ,R1. F1.", "1:7: a corner (,R or ,C) belongs to a cut by G1"),
        ("S9 G1 X9. ,C0 F1.", "1:11: the size of a corner (,R or ,C) is more than 0"),
        ("S9 G1 X9. ,C1. F1.\nG3 X12. Z-2. R2.", "2:1: the corner (,R or ,C) of line 1 needs a G1 behind it"),
        ("S9 G1 X9. ,C1. F1.\nX9.", "2:1: the corner of line 1 lies between two cuts; one of them has no length"),
        ("S9 G1 X9. ,C1. F1.\nX0.", "2:1: the cut turns back behind line 1: there is no corner"),
        (
            "S9 G1 X9. ,R3. F1.\nZ-2.",
            "2:1: the corner of line 1 is too large: it needs 3.0000 mm of a cut of 2.0000 mm",
        ),
        (
            "S9 G0 X20. Z0.\nG1 X9. ,R3. F1.\nZ-4. ,C1.5\nX20.",
            "4:1: the corner of line 3 is too large: it needs 1.5000 mm of a cut of 1.0000 mm",
        ),
        (
            "S9 G0 X30. Z2.\nG71 P1 Q2 D1. F1.\nN1 G0 X10.\nG1 Z-5.\nN2 X30. ,R1.",
            "2:1: the corner (,R or ,C) of line 5 needs a G1 behind it",
        ),
        ("G0 X#1", "1:5: #1 has no value"),
        ("#2=3.\nG0 X[#1+1.]", "2:6: #1 has no value"),
        ("#1000=5", "1:1: #1000 is no variable: expected 1 to 33, 100 to 199 or 500 to 999"),
        ("G0 X#5041", "1:5: #5041 is out of range"),
        ("#1=1./0.", "1:6: division by zero"),
        ("#1=2.*", "1:7: expected a number, found the end of the line"),
        ("#1=2. G0", "1:7: expected an operator or the end of the line, found 'G'"),
        ("#<a>=2.", "1:1: a variable of a Fanuc has a number, not a name"),
        ("G10 L2 P7 X1.", "1:8: P of G10 L2 is 1 (G54) to 6 (G59)"),
        ("G10 L2 P1 X1. U1.", "1:15: a line of G10 names an axis twice"),
        ("G10 L20 P1 X1.", "1:5: G10 L20 is not supported yet: expected L2, or no L word"),
        ("G10 X1.", "1:1: G10 needs a P word: the number of what it sets"),
        ("G10 P1 X0. Z0.1 R0.", "1:12: a tool offset other than 0 is not supported yet: there is no table of tools"),
        ("G53 U1.", "1:5: G53 takes X and Z, not U and W"),
        ("G53 G1 X1.", "1:5: G53 is a rapid: it does not go with G1"),
        ("G53", "1:1: G53 needs X or Z"),
        ("G54 G55", "1:5: G54 and G55 exclude one another in a line"),
        ("G52 X1.", "1:1: G52 is not supported yet: further coordinate systems"),
        ("G0 X1. U1.", "1:8: X and U exclude one another in a line"),
        ("G0 X1. C2.", "1:8: the word C is not supported"),
        ("G1 X1. R2. F1.", "1:8: nothing in the line uses the R word"),
        ("M98 P77", "1:1: the program O0077 does not follow in the file"),
        ("G0 X1.\nM99", "2:1: M99 in the main program repeats it for ever"),
        ("G71 P1 Q2", "1:1: the depth of a cut is not known: expected U (G71), W (G72) or D before it"),
        ("G71 P1 Q2 D1. F1.", "1:1: the contour N1 to N2 is not in the file behind the first cycle"),
        (
            "S9 G0 X50. Z0.\nG71 P1 Q2 D1. F1.\nN1 G0 X20.\nG1 Z-5.\nX15. Z-9.\nN2 X50.",
            "2:1: the contour of the cycle has pockets: its first block needs both X (U) and Z (W) then",
        ),
        (
            "S9 G0 X50. Z0.\nG71 P1 Q2 D1. F1.\nN1 G0 X20. W0\nG1 Z-5.\nX25. Z-3.\nN2 X50.",
            "2:1: the contour of the cycle turns back in Z",
        ),
        (
            "S9 G0 X50. Z1.\nG72 P1 Q2 D1. F1.\nN1 G0 Z-9. U0\nG1 X20.\nX25. Z-5.\nN2 Z0.",
            "2:1: the contour of the cycle turns back in X",
        ),
        ("G0 X20", "1:4: warning: a number without a point is taken in whole units, not in thousandths"),
    ] {
        let text = format!("{text}\nM30");
        let (_, told) = read(&text);
        assert_eq!(told, expected, "{text}");
    }
    let (_, told) = read("M98 P1\nM30\nO1\nM98 P1\nM99");
    assert!(told.contains("more than 10 deep"), "{told}");
}
