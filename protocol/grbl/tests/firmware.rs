//! What the firmware's sources say of unusual lines and sequences, where no transcript shows it.

use common::Board;
use torno_grbl::Axes;
use torno_grbl::state::State;
use torno_protocol::time::{Instant, Span};

mod common;

const BANNER: [&str; 2] = ["", "Grbl 1.1h ['$' for help]"];
const UNLOCK: &str = "[MSG:'$H'|'$X' to unlock]";

fn status(board: &mut Board) -> String {
    board.says(b"?").pop().unwrap_or_default()
}

/// The state that a status names.
fn state(board: &mut Board) -> String {
    status(board).trim_start_matches('<').split('|').next().unwrap_or_default().to_owned()
}

/// A field of a status that has this one.
fn field(board: &mut Board, name: &str) -> String {
    let found = (0..30).find_map(|_| {
        let status = status(board);
        status.split(['|', '>']).find_map(|part| part.strip_prefix(name)).map(str::to_owned)
    });
    found.unwrap_or_default()
}

/// The answers to lines, each on a board that rests.
fn answers<const N: usize>(lines: [&str; N]) -> [String; N] {
    lines.map(|line| {
        let mut board = Board::new();
        board.send(line.as_bytes());
        board.send(b"\n");
        board.said().join(" ")
    })
}

#[test]
fn a_jog_is_checked_as_a_block_first_and_as_a_jog_then() {
    let lines = ["$J=", "$J=X1", "$J=X1F100S100", "$J=G80X1F100", "$J=G93X1F100", "$J=G91.1X1F100", "$J=G4P1X1F100"];
    let expected = ["error:22", "error:22", "error:36", "error:31", "error:16", "error:16", "error:16"];
    assert_eq!(answers(lines), expected);
    let lines = ["$J=G28.1X1F100", "$J=G10L2P1X1F100", "$J=G43.1Z1F100", "$J=G53X1F100", "$J=N5G20G91X1F100", "$JX1"];
    assert_eq!(answers(lines), ["error:16", "error:16", "error:16", "ok", "ok", "error:3"]);
}

#[test]
fn a_jog_without_axis_words_goes_to_the_machines_zero() {
    let mut board = Board::new();
    board.says(b"G0X10Y2\n");
    board.said();
    board.send(b"$J=F100\n");
    assert_eq!(board.controller.machine().motions()[0].to, Axes::<i32>::default());
}

#[test]
fn integers_are_those_of_the_chip() {
    let lines = ["N10000000", "N10000002", "N3000000000", "G256", "G5000000000X1", "T255", "T256", "G-1", "G-255X1"];
    // A line number that does not fit is negative, and a command that does not is G0.
    let expected = ["ok", "error:27", "ok", "error:23", "ok", "ok", "error:38", "error:20", "error:23"];
    assert_eq!(answers(lines), expected);
    let lines = ["$-1=1", "$255=1", "$256=1", "$1e=1", "$1=300"];
    assert_eq!(answers(lines), ["error:3", "error:3", "error:3", "error:3", "ok"]);
}

#[test]
fn startup_lines_have_numbers_of_a_byte() {
    let mut board = Board::new();
    assert_eq!(board.says(b"$N-1=G20\n$N5=G20\n"), ["ok", "ok"]);
    assert_eq!(board.says(b"$N\n"), ["$N0=", "$N1=", "ok"]);
    assert_eq!(board.says(b"$N256=G21\n$N1.9=G18\n"), ["ok", "ok"]);
    assert_eq!(board.says(b"$N\n"), ["$N0=G21", "$N1=G18", "ok"]);
}

#[test]
fn a_startup_line_that_moves_is_stored_when_it_has() {
    let mut board = Board::new();
    assert_eq!(board.says(b"$N0=G0X10\n"), [""; 0], "it is done to check it");
    assert_eq!(board.controller.state(), State::Run);
    assert_eq!(board.said(), ["ok"]);
}

#[test]
fn probing_cycles_without_a_probe() {
    let probe = |line: &str| {
        let mut board = Board::new();
        board.send(line.as_bytes());
        board.said()
    };
    let unmet = "[PRB:0.000,0.000,0.000:0]";
    assert_eq!(probe("G38.2Z-1F100\n"), ["ALARM:5", unmet, "ok"]);
    assert_eq!(probe("G38.3Z-1F100\n"), ["[PRB:0.000,0.000,-1.000:0]", "ok"]);
    assert_eq!(probe("G38.4Z-1F100\n"), ["ALARM:4", "ok"]);
    assert_eq!(probe("G38.5Z-1F100\n"), ["ALARM:4", "ok"]);
    assert_eq!(probe("$C\nG38.2Z-1F100\n"), ["[MSG:Enabled]", "ok", "ok"]);
    assert_eq!(probe("G38.2F100\n"), ["error:26"]);
    assert_eq!(probe("G38.2Z0F100\n"), ["error:33"]);
    assert_eq!(probe("G38.2Z-1\n"), ["error:22"]);
    assert_eq!(probe("G38.1Z-1F100\n"), ["error:20"]);
    assert_eq!(probe("G38.2G53Z-1F100\n"), ["error:30"]);
    // It stays the mode of motions.
    assert_eq!(probe("G38.3Z-1F100\nZ-2\n"), ["[PRB:0.000,0.000,-1.000:0]", "ok", "[PRB:0.000,0.000,-2.000:0]", "ok"]);
}

#[test]
fn words_that_nothing_or_two_things_want() {
    let lines = ["G53G2X1R1F100", "G53", "G53X1", "G92.1X1", "G92.1", "G92.2", "G43.1X1", "G43.1", "G43.1Z1", "G49X1"];
    let expected = ["error:30", "ok", "ok", "ok", "ok", "error:20", "error:37", "error:37", "ok", "ok"];
    assert_eq!(answers(lines), expected);
    let lines =
        ["M7", "M7.1", "M8M9", "M3M4", "G4", "G4P-1", "G4P0X1", "G28.2", "G10.1", "G0G28X1", "G80X1", "G80G28X1"];
    let expected = [
        "error:20", "error:23", "error:21", "error:21", "error:28", "error:4", "ok", "error:20", "error:23",
        "error:24", "error:31", "error:31",
    ];
    assert_eq!(answers(lines), expected);
    let lines = ["G2X1R1I1F100", "G2X1F100", "G2Z1R1F100", "G2R1F100", "X", "%", "G1X1F0", "G59.1", "G61.1", "G90.1"];
    let expected = [
        "error:36", "error:35", "error:32", "error:26", "error:2", "error:1", "error:22", "error:23", "error:20",
        "error:20",
    ];
    assert_eq!(answers(lines), expected);
}

#[test]
fn a_line_is_as_long_as_what_is_left_of_it() {
    let mut board = Board::new();
    let mut says = |line: String| board.says(format!("{line}\n").as_bytes()).join(" ");
    assert_eq!(says("G21".to_owned() + &" ".repeat(100)), "ok");
    assert_eq!(says(format!("G21({})", "c".repeat(100))), "ok");
    assert_eq!(says(format!("G21;{}", "c".repeat(100))), "ok");
    assert_eq!(says(format!("X{}(c)", "0".repeat(78))), "ok", "79 characters");
    assert_eq!(says(format!("X{}(c)", "0".repeat(79))), "error:11");
    assert_eq!(says(format!("X{}(c)\r", "0".repeat(79))), "error:11 ok", "CR ends it, LF another one");
    assert_eq!(says("(c\rG20)".to_owned()), "ok error:1", "a comment does not go on in the next line");
}

#[test]
fn check_mode_begins_at_rest_and_ends_in_a_reset() {
    let mut board = Board::new();
    assert_eq!(board.says(b"$C\n"), ["[MSG:Enabled]", "ok"]);
    // What moves, and what wants a machine that rests.
    assert_eq!(board.says(b"G1X1F100\nM3S100\nG4P9\nM0\n"), ["ok"; 4]);
    assert_eq!(board.says(b"$#\n$J=X1F1\n$10=1\n$SLP\n$RST=$\n"), ["error:8"; 5]);
    assert_eq!(board.says(b"$$\n").last().map(String::as_str), Some("ok"));
    assert_eq!(board.says(b"!~\x84\xa0\x9e"), [""; 0]);
    assert_eq!(state(&mut board), "Check");
    assert_eq!(board.says(b"$C\n"), ["[MSG:Disabled]", "ok", BANNER[0], BANNER[1]]);
    assert_eq!(state(&mut board), "Idle");
}

#[test]
fn sleep_ends_in_a_reset_only() {
    let mut board = Board::new();
    board.says(b"M3S500\nM8\n");
    assert_eq!(board.says(b"$SLP\n$X\n"), ["ok", "[MSG:Sleeping]"]);
    assert_eq!(field(&mut board, "FS:"), "0,0");
    assert_eq!(board.says(b"!~\x85\x9e\xa0"), [""; 0]);
    assert_eq!(board.says(&[0x84]), ["[MSG:Check Door]"], "which changes nothing");
    assert_eq!(state(&mut board), "Sleep");
    assert_eq!(board.says(&[0x18]), [BANNER[0], BANNER[1], UNLOCK]);
    assert_eq!(board.says(b"$SLPX\n$SL\n"), ["error:3", "error:3"]);
}

#[test]
fn restoring_everything_forgets_everything() {
    let mut board = Board::new();
    board.says(b"$110=9\n$N0=G18\n$I=MINE\nG10L2P1X5\nG28.1\n");
    assert_eq!(board.says(b"$RST=*\n")[..4], ["[MSG:Restoring defaults]", "ok", BANNER[0], BANNER[1]]);
    assert_eq!(board.says(b"$N\n$I\n")[..4], ["$N0=", "$N1=", "ok", "[VER:1.1h.20190830:]"]);
    assert!(board.says(b"$$\n").contains(&"$110=500.000".to_owned()));
    assert_eq!(board.says(b"$#\n")[0], "[G54:0.000,0.000,0.000]");
    assert_eq!(board.says(b"$RST=*X\n$RST\n$RST=&\n"), ["error:3", "error:3", "error:3"]);
}

#[test]
fn the_programs_end_restores_the_overrides() {
    for end in ["M2\n", "M30\n"] {
        let mut board = Board::new();
        board.says(b"M3S500\nM8\n\x91\x96\x9a");
        assert_eq!(field(&mut board, "Ov:"), "110,50,110");
        assert_eq!(board.says(end.as_bytes()), ["[MSG:Pgm End]", "ok"]);
        assert_eq!(field(&mut board, "Ov:"), "100,100,100");
        assert_eq!(board.says(b"$G\n")[0], "[GC:G1 G54 G17 G21 G90 G94 M5 M9 T0 F0 S500]");
    }
}

#[test]
fn overrides_are_taken_during_a_hold() {
    let mut board = Board::new();
    board.says(b"M3S500\nG1X10F100\n!");
    board.controller.machine_mut().stand();
    board.says(b"\x91\x97\x9b");
    assert_eq!(field(&mut board, "Ov:"), "110,25,90");
    assert_eq!(field(&mut board, "FS:"), "0,450");
    assert_eq!(state(&mut board), "Hold:0");
}

#[test]
fn the_spindle_stops_when_the_machine_stands() {
    let mut board = Board::new();
    board.says(b"M3S500\nG1X10F100\n\x9e");
    assert_eq!(field(&mut board, "FS:"), "0,500", "in a hold only");
    board.says(b"!\x9e");
    assert_eq!(field(&mut board, "FS:"), "0,500", "not before it stands");
    board.controller.machine_mut().stand();
    assert_eq!(field(&mut board, "FS:"), "0,0");
    assert_eq!(board.says(&[0x9e]), ["[MSG:Restoring spindle]"]);
    assert_eq!(field(&mut board, "FS:"), "0,500");
    board.says(&[0x9e]);
    assert_eq!(board.says(b"~"), ["[MSG:Restoring spindle]"]);
    assert_eq!(state(&mut board), "Run");
}

#[test]
fn the_door_forgets_that_the_spindle_was_stopped() {
    let mut board = Board::new();
    board.says(b"M3S500\n!\x9e");
    assert_eq!(board.says(&[0x84]), ["[MSG:Check Door]"]);
    board.says(b"~");
    board.said();
    assert_eq!(field(&mut board, "FS:"), "0,500");
    board.says(b"!");
    assert_eq!(board.says(&[0x9e]), [""; 0], "it is stopped, not restored");
    assert_eq!(field(&mut board, "FS:"), "0,0");
}

#[test]
fn coolant_is_switched_while_it_rests_runs_jogs_and_holds() {
    let switches = |bytes: &[u8], stands: bool| {
        let mut board = Board::new();
        board.says(bytes);
        if stands {
            board.controller.machine_mut().stand();
            board.heard();
        }
        board.says(&[0xa0]);
        field(&mut board, "A:")
    };
    for (bytes, stands) in
        [(&b""[..], false), (b"G1X10F100\n", false), (b"$J=X10F100\n", false), (b"G1X10F100\n!", true)]
    {
        assert_eq!(switches(bytes, stands), "F", "{:?}", String::from_utf8_lossy(bytes));
    }
    for bytes in [&b"$C\n"[..], b"\x84", b"$SLP\n", b"G1X10F100\n\x18"] {
        assert_eq!(switches(bytes, false), "", "{:?}", String::from_utf8_lossy(bytes));
    }
}

/// A line that waits for room has been read long before.
#[test]
fn coolant_that_is_switched_while_a_line_waits_stays_so() {
    let mut board = Board::new();
    for x in 1..=16 {
        board.send(format!("G1X{x}F100\n").as_bytes());
    }
    board.heard();
    board.says(&[0xa0]);
    board.said();
    assert!(board.says(b"$G\n")[0].contains(" M8 "));
    assert_eq!(field(&mut board, "A:"), "F");
}

#[test]
fn whatever_holds_a_jog_ends_it_and_the_door_opens_then() {
    for (byte, during, after) in [(b'!', "Jog", "Idle"), (0x85, "Jog", "Idle"), (0x84, "Jog", "Door:0")] {
        let mut board = Board::new();
        board.says(b"$J=X10F100\n");
        board.says(&[byte]);
        assert_eq!(state(&mut board), during, "{byte:#x}");
        board.controller.machine_mut().stand();
        board.heard();
        assert_eq!(state(&mut board), after, "{byte:#x}");
    }
}

#[test]
fn the_door_in_each_state() {
    let opened = |bytes: &[u8]| {
        let mut board = Board::new();
        board.says(bytes);
        let says = board.says(&[0x84]);
        (says, state(&mut board))
    };
    let message = || vec!["[MSG:Check Door]".to_owned()];
    assert_eq!(opened(b""), (message(), "Door:0".to_owned()));
    assert_eq!(opened(b"!"), (message(), "Door:0".to_owned()));
    assert_eq!(opened(b"\x84"), (message(), "Door:0".to_owned()));
    assert_eq!(opened(b"G1X10F100\n"), (message(), "Door:2".to_owned()));
    assert_eq!(opened(b"G1X10F100\n!"), (message(), "Door:2".to_owned()));
    assert_eq!(opened(b"$C\n"), (vec![], "Check".to_owned()));
    assert_eq!(opened(b"G1X10F100\n\x18"), (vec![], "Alarm".to_owned()));
    let homing =
        vec!["ALARM:7".to_owned(), "ok".to_owned(), BANNER[0].to_owned(), BANNER[1].to_owned(), UNLOCK.to_owned()];
    assert_eq!(opened(b"$22=1\n$H\n"), (homing, "Alarm".to_owned()));
}

#[test]
fn a_door_that_opens_while_the_spindle_comes_back_stops_it_again() {
    let mut board = Board::new();
    board.says(b"M3S500\n\x84");
    board.says(b"~");
    assert_eq!(state(&mut board), "Door:3");
    assert_eq!(board.says(b"!"), [""; 0]);
    assert_eq!(state(&mut board), "Door:3");
    assert_eq!(board.says(&[0x84]), ["[MSG:Check Door]"]);
    assert_eq!(state(&mut board), "Door:0");
    assert_eq!(field(&mut board, "FS:"), "0,0");
    board.says(b"~");
    board.said();
    assert_eq!(state(&mut board), "Idle");
    assert_eq!(field(&mut board, "FS:"), "0,500");
}

/// How long a line takes.
fn takes(board: &mut Board, line: &str) -> Span {
    let start = board.now;
    board.send(line.as_bytes());
    board.said();
    board.now.since(start)
}

#[test]
fn a_dwell_is_made_of_steps_of_50_ms_and_16_bits_count_them() {
    let mut board = Board::new();
    for (line, ms) in [("G4P0\n", 0), ("G4P0.01\n", 50), ("G4P1\n", 1_000), ("G4P1.01\n", 1_050), ("G4P3276.85\n", 50)]
    {
        assert_eq!(takes(&mut board, line), Span::from_millis(ms), "{line}");
    }
}

#[test]
fn a_hold_holds_a_dwell_up() {
    let mut board = Board::new();
    board.says(b"G4P2\n");
    board.now = Instant::START + Span::from_secs(1);
    board.says(b"!");
    assert_eq!(state(&mut board), "Hold:0");
    board.now = Instant::START + Span::from_secs(10);
    assert_eq!(board.says(b"~"), [""; 0]);
    assert_eq!(board.said(), ["ok"]);
    assert_eq!(board.now, Instant::START + Span::from_secs(11));
}

#[test]
fn beyond_the_soft_limits_the_spindle_stops() {
    let mut board = Board::new();
    board.says(b"$22=1\n$20=1\nM3S500\nM8\n");
    let before = board.controller.machine().spindle;
    assert_eq!(board.says(b"G0X1\n"), ["ALARM:2", "[MSG:Reset to continue]"]);
    assert_eq!((before, board.controller.machine().spindle), (500.0, 0.0));
}

#[test]
fn a_homing_command_that_is_none_leaves_the_firmware_homing() {
    let mut board = Board::new();
    assert_eq!(board.says(b"$HX\n"), ["error:5"]);
    board.says(b"$22=1\n");
    assert_eq!(board.says(b"$HX\n"), ["error:3"]);
    assert_eq!(state(&mut board), "Home");
    assert_eq!(board.says(b"$X\nG0X1\n$#\n"), ["ok", "ok", "error:8"]);
    assert_eq!(board.says(&[0x18]), ["ALARM:6", BANNER[0], BANNER[1], UNLOCK]);
}

#[test]
fn what_an_alarm_takes() {
    let mut board = Board::new();
    board.says(b"G1X10F100\n\x18");
    assert_eq!(board.says(b"G0X0\n$C\n$J=X1F1\n$N0=G20\n"), ["error:9", "error:8", "error:8", "error:8"]);
    assert_eq!(board.says(b"\n$N\n$10=1\n"), ["ok", "$N0=", "$N1=", "ok", "ok"]);
    assert_eq!(board.says(b"!~"), [""; 0]);
    assert_eq!(board.says(b"$G\n").len(), 2);
    assert_eq!(board.says(b"$SLP\n"), ["ok", "[MSG:Sleeping]"]);
    assert_eq!(board.says(&[0x18]), [BANNER[0], BANNER[1], UNLOCK]);
}

#[test]
fn what_a_run_and_a_jog_take() {
    let mut board = Board::new();
    board.says(b"G1X10F100\n");
    assert_eq!(board.says(b"$$\n$#\n$I\n$C\n$SLP\n$10=1\n$J=X1F1\n$RST=*\n"), ["error:8"; 8]);
    assert_eq!(board.says(b"$\n$X\n").len(), 3);
    let mut board = Board::new();
    board.says(b"$J=X10F100\n");
    assert_eq!(board.says(b"G1X1\n$#\n$C\n$H\n"), ["error:9", "error:8", "error:8", "error:8"]);
    assert_eq!(board.says(b"$J=X11F100\n"), ["ok"]);
    assert_eq!(board.says(b"$$\n").last().map(String::as_str), Some("ok"));
}

#[test]
fn places_follow_g92_and_its_end() {
    let mut board = Board::new();
    board.says(b"G0X10\n");
    board.said();
    board.says(b"G92X3\nG43.1Z-2\n");
    assert_eq!(field(&mut board, "WCO:"), "7.000,0.000,-2.000");
    // The motion goes where the words pointed before the end of G92.
    board.send(b"G92.1G1X0F100\n");
    assert_eq!(board.controller.machine().motions()[0].to, [1750, 0, 0, 0]);
    board.said();
    assert_eq!(board.says(b"$#\n")[8..10], ["[G92:0.000,0.000,0.000]", "[TLO:-2.000]"]);
    board.says(b"G49\n");
    assert_eq!(field(&mut board, "WCO:"), "0.000,0.000,0.000");
}
