//! The board with three axes against conversations recorded with the firmware 1.1h on an ATmega328P.

#![allow(clippy::unwrap_used, reason = "part of tests")]

mod common;
#[path = "../../../protocol/grbl/tests/common/transcript.rs"]
mod transcript;

use common::Bench;

/// The machine that the firmware's defaults are for.
const DEFAULTS: &str = "axes = 3
drive.pulses_per_rev = 1250
x = { mm_per_s = 8.333333333333334, mm_per_s2 = 10.0, travel_mm = 200.0 }
y = { mm_per_s = 8.333333333333334, mm_per_s2 = 10.0, travel_mm = 200.0 }
z = { mm_per_s = 8.333333333333334, mm_per_s2 = 10.0, travel_mm = 200.0 }
";

#[test]
fn it_answers_as_the_firmware_does() {
    let all = [
        include_str!("../../../protocol/grbl/tests/transcripts/01-connect.txt"),
        include_str!("../../../protocol/grbl/tests/transcripts/02-errors.txt"),
        include_str!("../../../protocol/grbl/tests/transcripts/05-check.txt"),
        include_str!("../../../protocol/grbl/tests/transcripts/06-long.txt"),
        include_str!("../../../protocol/grbl/tests/transcripts/07-settings.txt"),
    ];
    for text in all {
        let mut bench = Bench::new(DEFAULTS);
        let differences = transcript::differences(text, |bytes| bench.says(bytes));
        assert!(differences.is_empty(), "{} differ:\n{}", differences.len(), differences.join("\n"));
    }
}

#[test]
fn it_answers_random_lines_as_the_firmware_does() {
    let lines = include_str!("../../../protocol/grbl/tests/transcripts/08-lines.txt");
    let differences = transcript::differing_lines(lines, || {
        let mut bench = Bench::new(DEFAULTS);
        move |bytes: &[u8]| bench.says(bytes)
    });
    assert!(differences.is_empty(), "{} differ:\n{}", differences.len(), differences.join("\n"));
}
