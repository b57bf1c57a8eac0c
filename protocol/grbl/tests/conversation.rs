//! What no transcript shows: holds, resets, overrides, full buffers, and any bytes at all.

use common::{Board, LATHE, answers};
use proptest::prelude::*;
use torno_grbl::controller::RECEIVE;
use torno_grbl::memory::Settings;
use torno_grbl::state::State;

mod common;

#[test]
fn a_hold_waits_for_the_machine_and_a_start_goes_on() {
    let mut board = Board::new();
    assert_eq!(board.says(b"G1X10F100\n"), ["ok"]);
    assert_eq!(board.controller.state(), State::Run);
    assert!(board.says(b"!?")[0].starts_with("<Hold:1|"));
    board.controller.machine_mut().stand();
    assert!(board.says(b"?")[0].starts_with("<Hold:0|"));
    assert_eq!(board.says(b"G4P0\n"), [""; 0], "nothing is read during a hold");
    assert_eq!(board.says(b"~"), [""; 0]);
    assert_eq!(board.controller.state(), State::Run);
    assert_eq!(board.said(), ["ok"]);
}

#[test]
fn a_start_before_it_stands_is_remembered_where_that_takes_seconds() {
    let after = |mut board: Board| {
        board.says(b"G1X10F100\n!~");
        assert_eq!(board.controller.state(), State::Hold);
        board.controller.machine_mut().stand();
        board.heard();
        board.controller.state()
    };
    assert_eq!(after(Board::with(LATHE, Settings::default())), State::Run);
    assert_eq!(after(Board::new()), State::Hold);
}

#[test]
fn a_reset_in_motion_locks_and_one_at_rest_does_not() {
    let banner = ["", "Grbl 1.1h ['$' for help]"];
    let mut board = Board::new();
    assert_eq!(board.says(&[0x18]), banner);
    board.says(b"G1X10F100\n");
    let unlock = "[MSG:'$H'|'$X' to unlock]";
    assert_eq!(board.says(&[0x18]), ["ALARM:3", banner[0], banner[1], unlock]);
    assert_eq!(board.says(b"G0X0\n"), ["error:9"]);
    assert_eq!(board.says(b"$X\n"), ["[MSG:Caution: Unlocked]", "ok"]);
    board.says(b"!");
    assert_eq!(board.says(&[0x18]), banner, "it stood");
}

/// What the firmware was doing is over, and it says so before it restarts.
#[test]
fn a_reset_answers_the_line_that_was_being_done() {
    let banner = ["", "Grbl 1.1h ['$' for help]"];
    let mut board = Board::new();
    board.says(b"G4P2\nG4P2\n");
    assert_eq!(board.says(&[0x18]), ["ok", banner[0], banner[1]], "the other line is discarded");
    board.says(b"$22=1\n$H\n");
    assert_eq!(board.says(&[0x18])[..3], ["ALARM:6", "ok", ""]);
    board.says(b"$X\n$20=1\nG0X1\n");
    assert_eq!(board.says(&[0x18])[..2], ["ok", ""], "a line beyond the soft limits, too");
}

#[test]
fn a_jog_that_is_cancelled_leaves_the_position_where_it_stands() {
    let mut board = Board::new();
    assert_eq!(board.says(b"$J=X10F100\n"), ["ok"]);
    assert_eq!(board.controller.state(), State::Jog);
    assert_eq!(board.says(b"G0X1\n"), ["error:9"]);
    board.says(&[0x85]);
    board.controller.machine_mut().stand();
    board.heard();
    assert_eq!(board.controller.state(), State::Idle);
    assert!(board.says(b"G0X10\n?").iter().any(|line| line == "ok"));
}

#[test]
fn overrides_are_shown_and_stay_in_their_ranges() {
    let mut board = Board::new();
    board.says(b"?");
    let shown = |board: &mut Board, byte: u8, times: usize| {
        board.says(&vec![byte; times]);
        let status = board.says(b"?");
        status[0].split('|').find_map(|part| part.strip_prefix("Ov:")).unwrap_or("").trim_end_matches('>').to_owned()
    };
    assert_eq!(shown(&mut board, 0x91, 1), "110,100,100");
    assert_eq!(shown(&mut board, 0x91, 20), "200,100,100");
    assert_eq!(shown(&mut board, 0x94, 1), "199,100,100");
    assert_eq!(shown(&mut board, 0x90, 1), "100,100,100");
    assert_eq!(shown(&mut board, 0x97, 1), "100,25,100");
    assert_eq!(shown(&mut board, 0x9b, 30), "100,25,10");
    assert_eq!(shown(&mut board, 0x99, 1), "100,25,100");
}

#[test]
fn a_pause_waits_for_the_operator() {
    let mut board = Board::new();
    assert_eq!(board.says(b"M0\nG4P0\n"), [""; 0]);
    assert_eq!(board.controller.state(), State::Hold);
    assert_eq!(board.says(b"~"), ["ok", "ok"]);
}

#[test]
fn a_program_beyond_the_soft_limits_leaves_nothing_but_a_reset() {
    let mut board = Board::new();
    for line in ["$22=1\n", "$20=1\n"] {
        assert_eq!(board.says(line.as_bytes()), ["ok"]);
    }
    assert_eq!(board.says(b"G0X1\n"), ["ALARM:2", "[MSG:Reset to continue]"]);
    assert_eq!(board.says(b"$X\n?"), [""; 0]);
    assert_eq!(board.says(&[0x18]).last().map(String::as_str), Some("[MSG:'$H'|'$X' to unlock]"));
    board.says(b"$X\n");
    assert_eq!(board.says(b"$J=X1F10\n"), ["error:15"]);
}

#[test]
fn startup_lines_are_done_after_a_reset() {
    let mut board = Board::new();
    assert_eq!(board.says(b"$N0=G20\n"), ["ok"]);
    assert_eq!(board.says(b"$N1=G1X\n"), ["error:2"]);
    assert_eq!(board.says(b"$N\n"), ["$N0=G20", "$N1=", "ok"]);
    assert_eq!(board.says(&[0x18]).last().map(String::as_str), Some(">G20:ok"));
    assert!(board.says(b"$G\n")[0].contains("G20"));
}

#[test]
fn with_the_main_loop_held_up_the_buffer_takes_what_it_holds_and_no_more() {
    let mut board = Board::new();
    board.send(b"G4P2\n");
    board.send(&[b'\n'; RECEIVE]);
    assert!(!board.controller.receive(board.now, b'\n'), "the next one is lost");
    assert_eq!(board.said().len(), 1 + RECEIVE);
}

#[test]
fn after_the_door_the_spindle_gets_four_seconds() {
    let mut board = Board::new();
    board.says(b"M3S500\n");
    assert_eq!(board.says(&[0x84]), ["[MSG:Check Door]"]);
    assert!(board.says(b"?")[0].starts_with("<Door:0|MPos:0.000,0.000,0.000|FS:0,0|"));
    let start = board.now;
    assert!(board.says(b"~?")[0].starts_with("<Door:3|"));
    board.said();
    assert_eq!(board.now.since(start).as_nanos(), 4_000_000_000);
    assert!(board.says(b"?")[0].starts_with("<Idle|"));
}

/// Lines that senders send, and what comes of them.
const LINES: [&str; 24] = [
    "G1X1F100\n",
    "G0X0Y0\n",
    "G2X1Y1R1F100\n",
    "G91G1X0.1F50\r\n",
    "$J=X1F100\n",
    "M0\n",
    "M2\n",
    "M3S500\n",
    "M5\n",
    "G4P2\n",
    "$C\n",
    "$X\n",
    "$H\n",
    "$SLP\n",
    "$RST=*\n",
    "$22=1\n",
    "$20=1\n",
    "$$\n",
    "$#\n",
    "$N0=M0\n",
    "$N1=G1X5F9\n",
    "$N0=\n",
    "G38.2X1F5\n",
    "\n",
];

#[test]
fn a_pause_beside_a_probe_that_fails_is_none() {
    answers::hold(b"M0G38.2X1F5\n\xc0G0X1\n");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10_000))]

    #[test]
    fn any_bytes_get_one_answer_a_line(
        parts in prop::collection::vec(
            prop_oneof![
                4 => prop::sample::select(&LINES[..]).prop_map(|line| line.as_bytes().to_vec()),
                4 => prop::sample::select(&answers::MACHINE[..]).prop_map(|byte| vec![byte]),
                2 => prop::sample::select(&b"?!~\x18\x84\x85\x90\x9e\xa0"[..]).prop_map(|byte| vec![byte]),
                1 => any::<u8>().prop_map(|byte| vec![byte]),
                1 => prop::collection::vec(prop::sample::select(&b"GMXYZF$0123.=-\r\n"[..]), 0..200),
            ],
            0..60,
        ),
    ) {
        answers::hold(&parts.concat());
    }
}

/// `cargo test -p torno-grbl --test conversation -- --ignored`
#[test]
#[ignore = "takes some seconds"]
fn ten_million_bytes_get_one_answer_a_line() {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut below = |n: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 33) as usize % n
    };
    let mut bytes = Vec::new();
    while bytes.len() < 10_000_000 {
        match below(16) {
            0..4 => bytes.extend(LINES[below(LINES.len())].bytes()),
            4..8 => bytes.push(answers::MACHINE[below(answers::MACHINE.len())]),
            8 => bytes.push(b"?!~\x18\x84\x85\x90\x9e\xa0"[below(9)]),
            9..12 => bytes.extend((0..below(100)).map(|_| b"GMXYZF$0123.=-\r\n"[below(16)]).collect::<Vec<_>>()),
            _ => bytes.push(below(256) as u8),
        }
    }
    answers::hold(&bytes);
}

proptest! {
    #[test]
    fn no_bytes_make_it_panic(
        bytes in prop::collection::vec(prop_oneof![any::<u8>(), prop::sample::select(&b"GXYZ$10\n\n"[..])], 0..400),
    ) {
        let mut board = Board::new();
        for byte in bytes {
            board.controller.receive(board.now, byte);
            board.said();
        }
        board.controller.receive(board.now, 0x18);
        prop_assert!(board.said().iter().any(|line| line.starts_with("Grbl 1.1h")));
    }
}
