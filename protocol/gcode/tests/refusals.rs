//! What is refused, and where; and programs that are no programs.

#![allow(clippy::unwrap_used, reason = "in a test, a panic is an answer")]

use torno_gcode::{Dialect, Kind, Motion, Place, Settings, Severity, interpret};

fn settings() -> Settings {
    Settings { dialect: Some(Dialect::LinuxCnc), steps_max: 10_000, ..Settings::default() }
}

/// What is told about a program, a line each; the motions.
fn told(text: &str) -> (String, Vec<Motion>) {
    let (motions, outcome) = interpret(text.as_bytes(), &settings());
    let told: Vec<String> = outcome.findings.iter().map(ToString::to_string).collect();
    (told.join("\n"), motions)
}

/// The program behind a usual head, with an end.
fn of(text: &str) -> String {
    told(&format!("G21 G18 G90 F100\n{text}\nM2\n")).0
}

#[test]
fn what_the_language_refuses_is_told_with_its_place() {
    let cases = [
        ("G33 Z-5 K1", "2:1: G33 is not supported yet: threads"),
        ("G76 P1", "2:1: G76 is not supported yet: threads"),
        ("G41", "2:1: G41 is not supported yet: the compensation of the tool's nose"),
        ("G71 Q100", "2:5: the subroutine o100 is not in the file before this line"),
        ("G71 X1", "2:1: the cycle needs a Q word: the subroutine of its contour"),
        ("G71 Q1.5", "2:5: the number of a subroutine is a whole number, 0 or more; it is 1.5"),
        ("G71 Q1 I0", "2:8: I of the cycle, the depth of a cut, is more than 0"),
        ("G72.1 Q1 D-1", "2:10: D of the cycle is 0 or more"),
        ("G71 Q1 P2", "2:8: G71 and G72 take no P word"),
        ("G70 Q1 I2", "2:8: G70 takes no I word"),
        ("G70 Q1 P0", "2:8: P of G70 is 1 to 10000"),
        ("G17 G71 Q1", "2:5: the cycle is for the plane X Z: expected G18 before it"),
        ("G91 G71 Q1", "2:5: the cycle goes with absolute coordinates (G90)"),
        ("G93 G71 Q1", "2:5: the cycle does not go with G93"),
        ("G71 Q1 M2", "2:1: a line with a cycle neither stops nor ends the program"),
        ("G81 Z1", "2:1: G81 is not supported yet: drilling and tapping cycles"),
        ("G10 L1 P1 X1", "2:5: G10 L1 is not supported yet: there is no table of tools"),
        ("G10 L2 P1 R30", "2:11: G10 with R is not supported yet: a rotated coordinate system"),
        ("M66 P1", "2:1: M66 is not supported yet: inputs and outputs"),
        ("M70", "2:1: M70 is not supported yet: modes that are saved"),
        ("M98 P100", "2:1: M98 is not supported yet in LinuxCNC's dialect: use O words"),
        ("G999", "2:1: G999 is not known"),
        ("G1 X1 B5", "2:7: the axis B is not supported"),
        ("G0 U5", "2:4: the axis U is not supported"),
        ("G0 G1 X1", "2:4: G0 and G1 exclude one another in a line"),
        ("M3 M4", "2:4: M3 and M4 exclude one another in a line"),
        ("G80 X1", "2:5: G80 takes no axes"),
        ("X1", "2:1: there is an axis, and no motion (G0 to G3) is in effect"),
        ("G28 G1 X1", "2:8: the line has two G words that take axes"),
        ("G92", "2:1: G52 and G92 need an axis"),
        ("G53 G2 X1 I1", "2:1: G53 goes with G0 or G1"),
        ("G91 G53 G0 X1", "2:1: G53 goes with absolute coordinates (G90)"),
        ("G1 X1 K2", "2:7: nothing in the line uses the K word"),
        ("G96", "2:1: G96 needs an S word"),
        ("F-1", "2:1: the feed is negative"),
        ("S-1", "2:1: the speed of the spindle is negative"),
        ("G4", "2:1: G4 needs a P word: seconds"),
        ("G4 P-1", "2:4: the time of G4 is negative"),
        ("F0 G1 X1", "2:7: a cut needs a feed: there is no F word, or it is 0"),
        ("G93 G1 X1", "2:8: each cut in G93 needs an F word"),
        ("G95 F1 G1 X1", "2:11: a cut in G95 needs a spindle that turns: there is no S word, or it is 0"),
        ("G2 X1", "2:4: an arc needs R, or I, J, K"),
        ("G2 X1 R1 I1", "2:7: an arc has R or I, J, K, not both"),
        ("G2 X10 R1", "2:8: the radius 1 mm is too small: the end is 10.0000 mm away"),
        ("G2 R1", "2:4: an arc with R needs an axis of its plane"),
        ("G2 X0 Z0 R1", "2:10: an arc with R cannot end where it starts"),
        (
            "G2 X10 I4",
            "2:8: the arc's radius is 4.0000 mm at its start and 6.0000 mm at its end: they differ by 2.0000",
        ),
        ("G17 G2 X1 K1", "2:11: K is across the plane of the arc: a lathe's program selects the plane X Z by G18"),
        ("G2 X1 I0.5 P0", "2:12: P of an arc is 1 or more"),
        ("G90.1 G2 X1 I0.5", "2:13: G90.1 needs both words of the centre"),
        ("G0 X99999999", "2:4: the place is further than 1e7 mm from zero"),
        ("G0 X[1/0]", "2:7: division by zero"),
        ("G0 X#<depth>", "2:5: the parameter #<depth> is not known"),
        ("G0 X#9999", "2:5: #9999 is out of range"),
        ("#0=1", "2:1: #0 is out of range"),
        ("#5221=1", "2:1: #5221 is not supported yet: a parameter of the machine is only read"),
        ("#<_x>=1", "2:1: #<_x> belongs to the machine: it is only read"),
        ("o1 call", "2:1: the subroutine o1 is not in the file"),
        ("o1 sub", "2:1: o1 has no endsub"),
        ("o1 endsub", "2:1: o1 has not been called"),
        ("o1 if [1]\no1 else", "3:1: o1 has no if, or no endif"),
        ("o1 if [0]", "2:1: o1 has no endif"),
        ("o1 if", "2:6: expected one value in brackets, found 0"),
        ("o1 endwhile", "2:1: o1 has no while"),
        ("o1 break", "2:1: o1 has no loop around this line"),
        ("o1 jump", "2:4: expected sub, call, if, while, do, repeat… behind the O word, found 'j'"),
        ("G1 (X (Y) Z1", "2:7: there is a comment in the comment"),
    ];
    for (text, expected) in cases {
        assert_eq!(of(text), expected, "{text}");
    }
}

#[test]
fn contours_of_cycles_are_refused_with_their_place() {
    let cases = [
        ("G0 X5 Z0", "G71 Q1", "6:1: the contour of the cycle needs a straight motion to its start, and one more"),
        ("G0 X5 Z0\nG1 Z-5 X6 M8", "G71 Q1", "5:11: a contour holds G0 to G3 only, not M8"),
        ("G0 X5 Z0\nG1 Z-5 T1", "G71 Q1", "5:8: a contour takes no T word"),
        ("G0 X5 Z0\n#1=3", "G71 Q1", "5:1: a contour gives no value to a parameter"),
        ("G0 X5 Z0\no2 if [1]", "G71 Q1", "5:1: a contour holds motions only"),
        ("X5 Z0", "G71 Q1", "4:1: there is an axis, and no motion (G0 to G3) is in effect"),
        ("G0 X5 Z0\nG3 X7 Z-2 R2\nX9 Z-4 R2", "G71 Q1", "6:1: an arc of a contour needs its G3 in the line"),
        ("G0 X5 Z0\nG2 X7 Z-2 R-2", "G71 Q1", "5:11: R of an arc of a contour is more than 0"),
        ("G0 X5 Z0\nG1 Z-5\nX8 Z-3\nX9 Z-9", "G71 Q1", "9:1: the contour of the cycle turns back in Z"),
        ("G0 X5 Z9\nG1 Z-5\nX8 Z-7", "G71 Q1", "8:1: the contour of the cycle turns back in Z, or starts behind"),
        ("G0 X5 Z0\nG1 Z-5\nX8 Z-7", "G71 X4 Q1", "8:1: the cycle starts inside of the contour"),
        ("G0 X5 Z0\nG1 Z-5\nX8 Z-7", "G71 Q1 I0.0001", "8:1: the cycle has more than 10000 passes"),
        ("G0 X5 Z0\nG1 Z-5\nG2 X7 Z-7 R2\nG1 X9", "G71 Q1 D2", "9:1: the contour of the cycle has no room for"),
        ("G0 X5 Z0\nG1 Z-5 F5\nX8 Z-7", "G71 Q1", "5:8: warning: F in a contour has no effect"),
    ];
    for (contour, cycle, expected) in cases {
        let found = of(&format!("G0 X10 Z1\no1 sub\n{contour}\no1 endsub\n{cycle}"));
        assert!(found.starts_with(expected), "{contour:?} {cycle}: {found}");
    }
    // Many cycles in a loop end, too.
    let text =
        "G0 X10 Z1 F9\no1 sub\nG0 X5 Z0\nG1 Z-5\nX8 Z-7\no1 endsub\no2 while [1]\nG0 X10 Z1\nG71 Q1 I0.01\no2 endwhile";
    assert!(of(text).contains("more than 10000 lines have been executed"), "{}", of(text));
}

#[test]
fn warnings_are_errors_if_asked_for() {
    let text = b"G21\nM131\nM31\nG43\nM2\n";
    let (_, outcome) = interpret(text, &settings());
    assert!(!outcome.is_refused() && outcome.findings.len() == 3, "{:?}", outcome.findings);
    assert_eq!(outcome.findings[0].to_string(), "2:1: warning: M131 is not known: it has no effect");
    let (_, outcome) = interpret(text, &Settings { strict: true, ..settings() });
    assert!(outcome.is_refused());
    assert_eq!(outcome.findings.iter().filter(|finding| finding.severity == Severity::Error).count(), 3);
    let (without_end, _) = told("G21\nG0 X1");
    assert_eq!(without_end, "2:1: warning: the program has no end: expected M2, M30 or % in a line of its own");
}

#[test]
fn one_error_does_not_hide_the_next_and_none_follows_from_another() {
    let (text, motions) = told("G21 G18 F9\nG0 Q1\nG1 X[1/0] Z-5\nG2 X20 Z-7 I2\nG0 X1 Z1\nG2 X5 I1\nM2");
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len(), 3, "{text}");
    assert!(lines[0].starts_with("2:4") && lines[1].starts_with("3:7") && lines[2].starts_with("6:7"), "{text}");
    assert_eq!(motions.last().unwrap().kind, Kind::End);
    let (text, _) = told(&"G999\n".repeat(100));
    assert_eq!(text.lines().count(), 20);
}

#[test]
fn a_program_that_never_ends_is_ended() {
    let (text, _) = told("o1 while [1]\nG4 P0\no1 endwhile\nM2");
    assert!(text.contains("more than 10000 lines have been executed"), "{text}");
    let (text, _) = told("o1 sub\no1 call\no1 endsub\no1 call\nM2");
    assert_eq!(text, "2:1: calls are nested more than 10 deep");
    // An error in a loop is told once.
    let (text, _) = told("o1 repeat [50]\nG0 X[1/0]\no1 endrepeat\nM2");
    assert_eq!(text, "2:7: division by zero");
}

#[test]
fn what_is_no_program_is_named() {
    for (text, expected) in [
        ("", "1:1: the file holds no G-code"),
        ("\n\n(a comment)\n%\n", "1:1: the file holds no G-code"),
        ("\u{7f}ELF\u{2}\u{1}\u{1}\0\0", "1:1: the file is binary: expected G-code"),
        ("# a shaft\n0A E1 00 E1 00 00 00 00\n", "2:1: the file is a program of frames: expected G-code"),
    ] {
        let (found, _) = told(text);
        assert_eq!(found, expected, "{text:?}");
    }
}

#[test]
fn the_tool_begins_where_it_is_put() {
    let start = Place { x: 20.0, z: 5.0, ..Place::default() };
    let (motions, _) = interpret(b"G91 G0 X-1\nM2", &Settings { start, ..settings() });
    assert_eq!(motions[0].kind, Kind::Rapid { to: Place { x: 19.0, ..start } });
}

#[test]
fn ten_thousand_relative_moves_end_where_they_must() {
    let text = format!("G91 G21\n{}M2", "G0 X0.001 Z-0.001\n".repeat(10_000));
    let (motions, _) = interpret(text.as_bytes(), &settings());
    let Kind::Rapid { to } = motions[9_999].kind else { panic!() };
    assert!((to.x - 10.0).abs() < 1e-9 && (to.z + 10.0).abs() < 1e-9, "{to:?}");
}

#[test]
fn deleted_blocks_are_passed_over_if_asked_for() {
    let text = b"/G0 X1\nG0 X2\nM2";
    assert_eq!(interpret(text, &settings()).1.motions, 3);
    assert_eq!(interpret(text, &Settings { skip_deleted: true, ..settings() }).1.motions, 2);
}
