//! The lathe mode, which the firmware has not: `$32=2` and its words.

use common::{Board, LATHE};
use torno_grbl::Rate;
use torno_grbl::memory::Settings;

mod common;

/// One whose `$32` is 2.
fn lathe() -> Board {
    let mut board = Board::with(LATHE, Settings::of_lathe());
    assert_eq!(board.says(b"$32=2\n"), ["ok"]);
    board
}

fn modes(board: &mut Board) -> String {
    board.says(b"$G\n").swap_remove(0)
}

/// The words, each in a block of its own.
const WORDS: [&str; 6] = ["G7", "G8", "G95", "G96S100", "G97", "G96S100D1000"];

#[test]
fn the_words_of_a_lathe_are_known_in_its_mode_only() {
    for mode in ["$32=0", "$32=1"] {
        let mut board = Board::with(LATHE, Settings::of_lathe());
        assert_eq!(board.says(format!("{mode}\n").as_bytes()), ["ok"]);
        for word in WORDS {
            assert_eq!(board.says(format!("{word}\n").as_bytes()), ["error:20"], "{mode} {word}");
        }
        assert_eq!(modes(&mut board), "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]");
    }
    let mut board = lathe();
    for word in WORDS {
        assert_eq!(board.says(format!("{word}\n").as_bytes()), ["ok"], "{word}");
    }
    for (block, answer) in [("G7G8", 21), ("G94G95", 21), ("G96G97S1", 21), ("G96", 28), ("D1", 36), ("G96S1D-1", 4)] {
        assert_eq!(board.says(format!("{block}\n").as_bytes()), [format!("error:{answer}")], "{block}");
    }
    for block in ["G7.1", "G96.1S1"] {
        assert_eq!(board.says(format!("{block}\n").as_bytes()), ["error:23"], "{block}");
    }
}

#[test]
fn without_a_lathe_the_setting_is_a_switch() {
    let mut board = Board::new();
    board.says(b"$32=2\n");
    assert!(board.says(b"$$\n").contains(&"$32=1".to_owned()));
    assert_eq!(board.says(b"G7\n"), ["error:20"]);
    assert!(lathe().says(b"$$\n").contains(&"$32=2".to_owned()));
}

#[test]
fn diameters_are_halved_and_reports_are_radii() {
    let mut board = lathe();
    board.send(b"G7\nG0X20Z-3\n");
    assert_eq!(board.controller.machine().motions()[0].place, [10.0, 0.0, -3.0, 0.0]);
    board.said();
    assert!(board.says(b"?")[0].contains("MPos:10.000,0.000,-3.000|"));
    board.send(b"G91G0X-2\n");
    assert_eq!(board.controller.machine().motions()[0].place, [9.0, 0.0, -3.0, 0.0]);
    board.said();
    // The present place gets a diameter of 30.
    assert_eq!(board.says(b"G10L20P1X30\n"), ["ok"]);
    assert_eq!(board.says(b"$#\n")[0], "[G54:-6.000,0.000,0.000]");
    board.send(b"G18G90G3X40Z-8K-5F100\n");
    board.said();
    assert!(board.says(b"?")[0].contains("MPos:14.000,0.000,-8.000|"), "K is no diameter");
}

#[test]
fn the_modes_are_told_and_end_with_the_lathe_mode() {
    let mut board = lathe();
    assert_eq!(modes(&mut board), "[GC:G0 G54 G17 G21 G90 G94 G8 G97 M5 M9 T0 F0 S0]");
    board.says(b"G7G95F0.125G96S100\n");
    assert_eq!(modes(&mut board), "[GC:G0 G54 G17 G21 G90 G95 G7 G96 M5 M9 T0 F0.125 S100]");
    board.says(b"$32=0\n");
    assert_eq!(modes(&mut board)[..34], "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0"[..34]);
    let mut board = lathe();
    board.says(b"G7G95F0.125G96S100\nM2\n");
    assert!(modes(&mut board).starts_with("[GC:G1 G54 G17 G21 G90 G94 G7 G97 M5"));
    board.says(&[0x18]);
    assert!(modes(&mut board).contains(" G94 G8 G97 "));
}

#[test]
fn a_feed_a_turn_needs_a_spindle_that_turns_and_a_feed_of_its_own() {
    let mut board = lathe();
    assert_eq!(board.says(b"G1F100\nG95\nG1Z-1\nG1Z-1F0.1\n"), ["ok", "ok", "error:22", "error:22"]);
    assert_eq!(board.says(b"M3S500\nG1Z-1F0.1\n"), ["ok", "ok"]);
    assert_eq!(board.controller.machine().motions()[0].rate, Rate::PerTurn(0.1));
    board.said();
    assert_eq!(board.says(b"G94G1Z-2\n"), ["error:22"]);
    board.said();
    assert_eq!(board.says(b"G20G95G1Z-0.1F1\n"), ["ok"]);
    assert_eq!(board.controller.machine().motions()[0].rate, Rate::PerTurn(25.4));
}

/// The spindle's speed as a status shows it.
fn rpm(board: &mut Board) -> u32 {
    let status = board.says(b"?").swap_remove(0);
    let feed_and_speed = status.split(['|', '>']).find_map(|part| part.strip_prefix("FS:")).unwrap_or_default();
    feed_and_speed.split(',').nth(1).and_then(|rpm| rpm.parse().ok()).unwrap_or_default()
}

#[test]
fn at_a_constant_surface_speed_the_spindle_follows_x() {
    let mut board = lathe();
    let mut after = |lines: &str| {
        board.send(lines.as_bytes());
        board.said();
        rpm(&mut board)
    };
    assert_eq!(after("$30=4000\nG0X20\nG96S100M3\n"), 796, "100 m/min at a radius of 20 mm");
    assert_eq!(after("G0X10\n"), 796, "a rapid cuts nothing");
    assert_eq!(after("G1Z-1F100\n"), 1592);
    assert_eq!(after("G1X9.6\n"), 1592, "the greater of the radii at the ends of a motion");
    assert_eq!(after("G1Z-2\n"), 1592, "within 5 % it does not follow");
    assert_eq!(after("G1X9Z-3\nG1Z-4\n"), 1768);
    assert_eq!(after("G1X0\nG1Z-5\n"), 4000, "in the middle it is as fast as it can");
    assert_eq!(after("G96S100D3000\n"), 3000);
    assert_eq!(after("G0X20\nG96S100D3000\nG1Z-6\n"), 796);
    assert_eq!(after("G97\n"), 796, "it goes on as it turns");
    assert_eq!(after("G97S500\n"), 500);
    assert_eq!(after("G20G96S328.084\n"), 796, "feet a minute");
    assert_eq!(after("G21G10L20P1X40\nG96S200\n"), 796, "the program's X is the radius");
}
