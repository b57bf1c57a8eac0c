//! Three axes and four, and machines whose axes move together.

use common::Board;
use torno_grbl::code::Alarm;
use torno_grbl::state::State;

mod common;

/// What a status says of the position.
fn position(board: &mut Board) -> String {
    let status = board.says(b"?").pop().unwrap_or_default();
    status.split(['|', '>']).find_map(|part| part.strip_prefix("MPos:")).unwrap_or_default().to_owned()
}

#[test]
fn without_an_a_axis_nothing_of_it_is_known() {
    let mut board = Board::new();
    assert_eq!(board.says(b"G0A1\n$103=1\n$133=1\n"), ["error:20", "error:3", "error:3"]);
    assert_eq!(position(&mut board), "0.000,0.000,0.000");
    assert!(!board.says(b"$$\n").iter().any(|line| line.starts_with("$103")));
    assert_eq!(board.says(b"$I\n$22=1\n$HX\n"), ["[VER:1.1h.20190830:]", "[OPT:V,15,128]", "ok", "ok", "error:3"]);
}

#[test]
fn an_a_axis_has_its_words_settings_and_fields() {
    let mut board = Board::with_a();
    assert_eq!(position(&mut board), "0.000,0.000,0.000,0.000");
    assert_eq!(board.says(b"$103=100\n$113=1000\n$123=50\n$133=360\n$104=1\n"), ["ok", "ok", "ok", "ok", "error:3"]);
    let settings = board.says(b"$$\n");
    for line in ["$102=250.000", "$103=100.000", "$113=1000.000", "$123=50.000", "$133=360.000"] {
        assert!(settings.iter().any(|found| found == line), "{line}");
    }
    assert_eq!(board.says(b"G10L2P1A10\nG92A5\nG28.1\n"), ["ok", "ok", "ok"]);
    assert_eq!(board.says(b"G43.1A1\nG0A1A2\nA\nB1\n"), ["error:37", "error:25", "error:2", "error:20"]);
    let places = board.says(b"$#\n");
    assert_eq!(places[0], "[G54:0.000,0.000,0.000,10.000]");
    assert_eq!(places[8], "[G92:0.000,0.000,0.000,-15.000]");
    assert_eq!(places[10], "[PRB:0.000,0.000,0.000,0.000:0]");
    board.controller.machine_mut().ends = [false, true, false, true];
    assert!(board.says(b"?")[0].contains("|Pn:YA|WCO:0.000,0.000,0.000,-5.000"));
}

#[test]
fn a_is_in_degrees_whatever_the_units_are() {
    let mut board = Board::with_a();
    board.says(b"G20\n");
    board.send(b"G1X1A90F100\n");
    assert_eq!(board.controller.machine().motions()[0].place, [25.4, 0.0, 0.0, 90.0]);
    assert_eq!(board.said(), ["ok"]);
    board.send(b"$J=G91G20A-45F100\n");
    assert_eq!(board.controller.machine().motions()[0].to, [6350, 0, 0, 11250]);
    board.said();
    assert_eq!(board.says(b"$13=1\n"), ["ok"]);
    assert_eq!(position(&mut board), "1.0000,0.0000,0.0000,45.000");
}

#[test]
fn a_goes_evenly_along_an_arc() {
    let mut board = Board::with_a();
    board.send(b"G2X10Y10R10A90F100\n");
    let places: Vec<_> = board.controller.machine().motions().iter().map(|motion| motion.place).collect();
    assert!(places.len() > 10);
    let steps: Vec<f32> = places.windows(2).map(|two| two[1][3] - two[0][3]).collect();
    assert!(steps.iter().all(|step| (step - steps[0]).abs() < 1e-3), "{steps:?}");
    board.said();
    assert_eq!(position(&mut board), "10.000,10.000,0.000,90.000");
    assert_eq!(board.says(b"G2A10R1F100\n"), ["error:32"]);
}

#[test]
fn the_soft_limits_of_a_are_its_travel() {
    let mut board = Board::with_a();
    board.says(b"$22=1\n$20=1\n$133=360\n");
    assert_eq!(board.says(b"$J=A-361F100\n"), ["error:15"]);
    assert_eq!(board.says(b"$J=A-359F100\n"), ["ok"]);
    board.said();
    assert_eq!(board.says(b"G0A-361\n")[0], "ALARM:2");
}

/// Their answers are the firmware's for three axes, and no line that the firmware refuses changes anything.
#[test]
fn lines_without_a_are_answered_as_by_a_firmware_without_it() {
    let mut board = Board::with_a();
    let (mut count, mut differences) = (0, Vec::new());
    for line in include_str!("transcripts/08-lines.txt").lines() {
        if line.starts_with("# block") {
            board = Board::with_a();
        } else if let Some((expected, sent)) = line.split_once('\t').filter(|(_, sent)| !sent.contains(['A', 'a'])) {
            board.send(format!("{sent}\n").as_bytes());
            count += 1;
            let found = board.said();
            if found.last().map(String::as_str) != Some(expected) {
                differences.push(format!("{sent:?}: found {found:?}, expected {expected:?}"));
            }
        }
    }
    assert!(count > 400 && differences.is_empty(), "{count}: {differences:#?}");
}

#[test]
fn the_machine_sees_its_settings_when_they_change() {
    let mut board = Board::with_a();
    board.says(b"$11=0.02\n$120=500\n$113=7\n$23=9\n$27=2\n$25=300\n");
    let settings = board.controller.machine().settings.clone();
    assert_eq!((settings.junction_deviation(), settings.acceleration[0], settings.max_rate[3]), (0.02, 500.0, 7.0));
    assert_eq!(settings.homes_negative(), [true, false, false, true]);
    assert_eq!((settings.pull_off(), settings.homing_rates()), (2.0, (25.0, 300.0)));
    board.says(b"$RST=$\n");
    assert_eq!(board.controller.machine().settings.acceleration[0], 10.0);
}

#[test]
fn an_abort_in_motion_leaves_the_position_where_the_machine_stands() {
    let mut board = Board::new();
    board.says(b"G1X10F100\n");
    board.controller.machine_mut().go_to([500, 0, 0, 0]);
    assert_eq!(board.says(&[0x18])[0], "ALARM:3");
    board.says(b"$X\n");
    board.send(b"G91G0X1\n");
    assert_eq!(board.controller.machine().motions()[0].place, [3.0, 0.0, 0.0, 0.0]);
}

#[test]
fn a_machine_that_fails_says_why_and_what_waits_is_answered() {
    let mut board = Board::new();
    // As many as there is room for, and one more.
    for x in 1..=16 {
        board.send(format!("G1X{x}F100\n").as_bytes());
    }
    assert_eq!(board.heard().len(), 15);
    board.send(b"G1Y1\n");
    board.controller.machine_mut().go_to([500, 0, 0, 0]);
    board.controller.machine_mut().fail(Alarm::Aborted, "Y stalled, 0.0145 mm short");
    assert_eq!(board.heard(), ["[MSG:Y stalled, 0.0145 mm short]", "ALARM:3", "error:9", "error:9"]);
    assert_eq!(board.controller.state(), State::Alarm);
    board.says(b"$X\n");
    board.send(b"G91G0X1\n");
    assert_eq!(board.controller.machine().motions()[0].place, [3.0, 0.0, 0.0, 0.0]);
}

#[test]
fn all_axes_are_homed_or_one() {
    let mut board = Board::with_a();
    board.says(b"$22=1\n$N0=G20\n");
    assert_eq!(board.says(b"$H\n"), [""; 0]);
    assert_eq!(board.controller.machine().homes, Some([true; 4]));
    board.controller.machine_mut().find();
    assert_eq!(board.heard(), [">G20:ok", "ok"]);
    assert_eq!(position(&mut board), "-1.000,-1.000,-1.000,-1.000");
    assert_eq!(board.says(b"$HA\n"), [""; 0]);
    assert_eq!(board.controller.machine().homes, Some([false, false, false, true]));
    board.controller.machine_mut().find();
    assert_eq!(board.heard(), ["ok"], "no startup lines");
    for line in ["$HB\n", "$HXY\n"] {
        assert_eq!(board.says(line.as_bytes()), ["error:3"]);
        board.says(b"\x18$X\n");
    }
    let info = board.says(b"$I\n");
    assert_eq!(info[1], "[OPT:VH,15,128]");
    board.says(b"$HX\n");
    board.controller.machine_mut().fail(Alarm::Aborted, "X finds no end");
    assert_eq!(board.heard(), ["[MSG:X finds no end]", "ALARM:3", "error:9"]);
}

/// Three axes: those of the firmware.
#[test]
fn without_an_a_axis_three_are_homed() {
    let mut board = Board::new();
    board.says(b"$22=1\n$H\n");
    assert_eq!(board.controller.machine().homes, Some([true, true, true, false]));
}
