//! Whatever reaches the board, it goes on, and it says the same to the same.

use proptest::prelude::*;
use torno_grbl_board::{Grbl, GrblSettings};
use torno_protocol::board::{Board, Input, Output, Stimulus};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{ACK, CAN, NAK, XON};
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::Character;

/// So many deadlines a second are more than two lines and a dwell need.
const DEADLINES_PER_S: u64 = 20_000;

fn inputs() -> impl Strategy<Value = Input> {
    let usb = prop_oneof![any::<u8>(), prop::sample::select(&b"G01X1Z-2F100\n$J=H\x18!~?M3S500"[..]),];
    let machine = prop_oneof![any::<u8>(), prop::sample::select(&[ACK, XON, NAK, CAN, b't', b'd', b'e', b's'][..])];
    let character = |port| move |byte| Input::Character { port, character: Character::good(byte) };
    prop_oneof![
        8 => usb.prop_map(character(0)),
        4 => machine.prop_map(character(1)),
        1 => Just(Input::Stimulus(Stimulus::Reset)),
        1 => any::<bool>().prop_map(|on| Input::Stimulus(Stimulus::Power(on))),
    ]
}

/// Plays the inputs, each after a while; gives what the board does.
fn played(inputs: &[(u32, Input)]) -> Vec<(Instant, Output)> {
    let mut board = Grbl::new(&GrblSettings::default(), Clock::TRUE);
    let mut now = Instant::START;
    let mut outputs = Vec::new();
    for (micros, input) in inputs {
        let until = now + Span::from_micros(u64::from(*micros));
        let most = DEADLINES_PER_S * (1 + u64::from(*micros) / 1_000_000);
        let mut count = 0;
        while let Some(deadline) = board.poll_timeout().filter(|deadline| deadline.at < until) {
            board.handle_timeout(deadline.at);
            outputs.extend(std::iter::from_fn(|| board.poll_output()).map(|output| (deadline.at, output)));
            count += 1;
            assert!(count < most, "it does not come to rest: {deadline:?}");
        }
        now = until;
        board.handle_input(now, input.clone());
        outputs.extend(std::iter::from_fn(|| board.poll_output()).map(|output| (now, output)));
    }
    outputs
}

proptest! {
    #[test]
    fn whatever_reaches_it_the_board_goes_on(inputs in prop::collection::vec((0..2_000_000u32, inputs()), 0..200)) {
        prop_assert_eq!(played(&inputs), played(&inputs));
    }

    #[test]
    fn a_stream_of_bytes_is_taken_as_it_comes(bytes in prop::collection::vec(inputs(), 0..600)) {
        let inputs: Vec<(u32, Input)> = bytes.into_iter().map(|input| (90, input)).collect();
        played(&inputs);
    }
}
