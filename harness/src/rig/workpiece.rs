//! Tests of what rig files say of the workpiece, and of what is cut by it.

use torno_engine::Fact;
use torno_machines::workpiece::{ToolPath, Turned};
use torno_protocol::lathe::Program;
use torno_protocol::time::Instant;

use super::file::RigFile;

const LATHE: &str = include_str!("../../builtin/lathe.toml");

fn with(from: &str, to: &str) -> String {
    assert!(LATHE.contains(from), "{from}");
    let text = LATHE.replacen(from, to, 1);
    RigFile::parse("my.toml", &text).map(|_| "fine".to_owned()).unwrap_or_else(|error| error.to_string())
}

#[test]
fn a_rig_need_not_turn_a_part() {
    let text = LATHE.split("[part]").next().unwrap();
    assert!(RigFile::parse("my.toml", text).unwrap().part.is_none());
    assert!(RigFile::load("lathe").unwrap().part.is_some());
}

#[test]
fn complaints_say_where_and_what_was_expected() {
    for (from, to, expected) in [
        ("diameter_mm = 28", "diameter_mm = 0", "diameter_mm = 0: expected 1 to 1000"),
        ("out_mm = 60", "out_mm = 81", "out_mm = 81: expected 1 to 80"),
        ("lead_deg = 90", "lead_deg = 91", "lead_deg = 91: expected 1 to 90"),
        ("lead_deg = 90", "leed_deg = 90", "unknown field `leed_deg`"),
        ("rapid_mm_per_s = 10", "rapid_mm_per_s = nan", "rapid_mm_per_s = NaN: expected 0.001 to 1000"),
        (
            "[part.x]\nboard = \"depth\"",
            "[part.x]\nboard = \"dept\"",
            "there is no board 'dept': did you mean 'depth'?",
        ),
        ("\"speed_rpm\"", "\"speed_rpn\"", "there is no quantity of 'spindle' 'speed_rpn': did you mean 'speed_rpm'?"),
        ("[\"speed_rpm\"]", "[]", "expected quantities of 'spindle', found none"),
        ("rpm_per_count = 1", "rpm_per_count = 0", "rpm_per_count = 0: expected what one count is worth"),
        (
            "out_mm = 60",
            "bore_mm = 28\nout_mm = 60",
            "bore_mm = 28: expected more than 0, and less than diameter_mm, 28",
        ),
        ("out_mm = 60", "bore_mm = -1\nout_mm = 60", "bore_mm = -1: expected more than 0"),
        ("out_mm = 60", "bore_mm = nan\nout_mm = 60", "bore_mm = NaN: expected more than 0"),
        ("trail_deg = 32", "trail_deg = 32, cuts = \"inside\"", "cuts = \"inside\": expected bore_mm"),
        ("trail_deg = 32", "trail_deg = 32, cuts = \"outwards\"", "unknown variant `outwards`"),
    ] {
        let line = LATHE[..LATHE.find(from).unwrap()].matches('\n').count() + from.matches('\n').count() + 1;
        let found = with(from, to);
        assert!(found.starts_with(&format!("my.toml:{line}:")) && found.contains(expected), "{found}\n{expected}");
    }
}

/// The lathe with a boring bar, two slots clear of a bore of 10 mm.
fn boring() -> String {
    let text = LATHE.replacen("out_mm = 60", "bore_mm = 10\nout_mm = 60", 1);
    let text = text.replacen("trail_deg = 32 }", "trail_deg = 32, cuts = \"inside\" }", 1);
    text.replacen("start_mm = 0.35555555555556", "start_mm = -0.35555555555556", 1)
}

const TRANSVERSE: usize = 2;
const DEPTH: usize = 3;

fn told(node: usize, ms: u64, signal: u8, value: i64) -> Fact {
    Fact::Telemetry { node, at: Instant::from_nanos(ms * 1_000_000), signal, value }
}

fn cut(facts: &[Fact]) -> Turned {
    let mut path = ToolPath::new(RigFile::load("lathe").unwrap().part.as_ref().unwrap());
    facts.iter().for_each(|fact| path.add(fact));
    path.cut()
}

#[test]
fn the_carriage_is_where_it_is_and_not_where_the_firmware_believes_it_to_be() {
    // Seven slots in, two of them clear of the bar, and just over the edge of the last; the firmware has counted five.
    let [position, offset] = [0, 3];
    let turned = cut(&[
        told(DEPTH, 1_000, position, -5),
        told(DEPTH, 2_000, offset, -2),
        told(TRANSVERSE, 3_000, position, -900),
        told(TRANSVERSE, 3_000, 1, -70_000),
    ]);
    let slot = 160.0 / 900.0;
    assert!((turned.profile.diameter(-1.0).unwrap() - (28.0 - 2.0 * 4.5 * slot)).abs() < 1e-9);
    assert_eq!(turned.profile.diameter(-2.01), Some(28.0));
}

#[test]
fn a_slide_stands_where_it_has_coasted_to() {
    // At 1.5 slots a second it is over the third edge after 1.717 s, and coasts on for 0.075 slots.
    let [position, drive] = [0, 2];
    let turned = cut(&[
        told(DEPTH, 0, drive, -1),
        told(DEPTH, 390, position, -1),
        told(DEPTH, 1_060, position, -2),
        told(DEPTH, 1_720, position, -3),
        told(DEPTH, 1_720, drive, 0),
        told(TRANSVERSE, 3_000, position, -900),
    ]);
    let slot = 160.0 / 900.0;
    let gone = 1.5 * (1.72 - 0.05) + 0.075;
    assert!((turned.profile.diameter(-1.0).unwrap() - (28.0 - 2.0 * (gone - 2.0) * slot)).abs() < 1e-5);
}

#[test]
fn a_boring_bar_turns_the_bore() {
    let part = RigFile::parse("my.toml", &boring()).unwrap().part.unwrap();
    let slot = 160.0 / 900.0;
    assert!((part.place(0, 0).x - (5.0 - 2.0 * slot)).abs() < 1e-9);
    let mut path = ToolPath::new(&part);
    // Outwards, five slots: just over the edge of the last.
    [told(DEPTH, 1_000, 0, 5), told(TRANSVERSE, 3_000, 0, -9_000)].iter().for_each(|fact| path.add(fact));
    let turned = path.cut();
    assert!((turned.profile.diameter(-1.0).unwrap() - (10.0 + 2.0 * 2.5 * slot)).abs() < 1e-9);
    assert_eq!(turned.profile.diameter(-20.02), Some(10.0));
    let program = Program::parse("4B 00 00 00 00 00 05 00\n4B 46 23 28 01 00 00 00").unwrap();
    assert!((part.asked(&program).diameter(-1.0).unwrap() - (10.0 + 2.0 * 3.0 * slot)).abs() < 1e-9);
}

#[test]
fn in_what_order_boards_are_heard_does_not_matter() {
    let depth = [told(DEPTH, 10, 0, -4), told(DEPTH, 4_000, 0, 0)];
    let feed: Vec<Fact> = (1..100).map(|n| told(TRANSVERSE, 30 * n, 0, -50 * n as i64)).collect();
    let one = cut(&[&depth[..], &feed].concat());
    let other = cut(&[&feed[..], &depth].concat());
    assert_eq!(one.profile, other.profile);
    assert_eq!(one.happenings, other.happenings);
    assert!(one.profile.diameter(-1.0).unwrap() < 28.0);
}

#[test]
fn a_slip_that_the_sum_does_not_show_is_no_move() {
    // The encoder invents counts: what the firmware believes changes, where the carriage is does not.
    let slip = [told(DEPTH, 10, 0, -4), told(DEPTH, 10, 3, 4), told(TRANSVERSE, 20, 0, -900)];
    assert_eq!(cut(&slip).profile.diameter(-1.0), Some(28.0));
}
