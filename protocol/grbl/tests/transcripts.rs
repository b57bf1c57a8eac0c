//! The controller against conversations recorded with the firmware 1.1h (20190830) on an ATmega328P at 115 200 baud.

use common::{Board, LATHE, transcript};
use torno_grbl::memory::Settings;

mod common;

const LINES: &str = include_str!("transcripts/08-lines.txt");

/// Plays a conversation, and says where the answers depart from the firmware's.
fn differences(mut board: Board, text: &str) -> Vec<String> {
    transcript::differences(text, |bytes| {
        board.send(bytes);
        board.said()
    })
}

fn assert_same(transcript: &str) {
    let differences = differences(Board::new(), transcript);
    assert!(differences.is_empty(), "{} differ:\n{}", differences.len(), differences.join("\n"));
}

#[test]
fn it_answers_a_sender_that_connects() {
    assert_same(include_str!("transcripts/01-connect.txt"));
}

#[test]
fn it_refuses_what_the_firmware_refuses() {
    assert_same(include_str!("transcripts/02-errors.txt"));
}

#[test]
fn it_checks_as_the_firmware_does() {
    assert_same(include_str!("transcripts/05-check.txt"));
}

#[test]
fn it_reads_long_lines_as_the_firmware_does() {
    assert_same(include_str!("transcripts/06-long.txt"));
}

#[test]
fn it_stores_settings_as_the_firmware_does() {
    assert_same(include_str!("transcripts/07-settings.txt"));
}

#[test]
fn it_answers_random_lines_as_the_firmware_does() {
    let differences = transcript::differing_lines(LINES, || {
        let mut board = Board::new();
        move |bytes: &[u8]| {
            board.send(bytes);
            board.said()
        }
    });
    assert!(differences.is_empty(), "{} differ:\n{}", differences.len(), differences.join("\n"));
}

/// What a lathe cannot do it refuses: these lines, and no others.
#[test]
fn on_a_lathe_only_what_it_cannot_do_is_another_answer() {
    let all = [
        include_str!("transcripts/01-connect.txt"),
        include_str!("transcripts/02-errors.txt"),
        include_str!("transcripts/05-check.txt"),
        include_str!("transcripts/06-long.txt"),
        include_str!("transcripts/07-settings.txt"),
    ];
    let found: Vec<String> =
        all.iter().flat_map(|text| differences(Board::with(LATHE, Settings::default()), text)).collect();
    let sent: Vec<&str> = found.iter().filter_map(|text| text.split('"').nth(1)?.split("   ").next()).collect();
    let refused = ["G2 X1 Y0 I0.5 F100", "G0X1(comment)Y1", "G1 X 1"];
    // The first of them would have set the motion and the feed for these.
    let after = ["G2 X10 R1", "G2 X5 Y5 I1 J1", "G53 X1"];
    let expected = [refused[0], after[0], after[1], after[2], refused[1], refused[2]];
    assert_eq!(sent, expected, "{found:#?}");
}
