use proptest::prelude::*;

use super::telnet::IAC;
use super::*;

fn server() -> Server {
    let mut server = Server::new(LineCoding::at(9600), false);
    server.take_answers();
    server
}

/// What the server answers to a command of the option, and what it requests.
fn asked(server: &mut Server, content: &[u8]) -> (Vec<u8>, Vec<Request>) {
    let requests = server.receive(&sub(COM_PORT, content));
    (server.take_answers(), requests)
}

#[track_caller]
fn check(server: &mut Server, content: &[u8], answer: &[u8], requests: &[Request]) {
    let answer = if answer.is_empty() { Vec::new() } else { sub(COM_PORT, answer) };
    assert_eq!(asked(server, content), (answer, requests.to_vec()), "{content:?}");
}

fn coding(baud: u32, data: u8, parity: Parity, stop: StopBits) -> Request {
    let format = Format { data: DataBits::from_number(data).unwrap(), parity, stop };
    Request::Coding(LineCoding { baud, format })
}

#[test]
fn it_begins_and_agrees_to_what_it_knows_and_to_nothing_else() {
    let mut server = Server::new(LineCoding::at(9600), false);
    let start = [&[IAC, 251, 0, IAC, 251, 3][..], &[IAC, 253, 0, IAC, 253, 44]].concat();
    assert_eq!(server.take_answers(), start);
    // What it has asked for is not answered; the option has begun, so the modem's state is told.
    server.receive(&[IAC, 253, 0, IAC, 253, 3, IAC, 251, 0]);
    assert_eq!(server.take_answers(), [0_u8; 0]);
    server.receive(&[IAC, 251, 44]);
    assert_eq!(server.take_answers(), sub(44, &[107, 0xb0]));
    // The client may ask for it at this end, too. ECHO and what is not known is refused, once for each time.
    server.receive(&[IAC, 253, 44, IAC, 253, 1, IAC, 251, 1, IAC, 251, 77, IAC, 254, 77, IAC, 252, 77]);
    let expected =
        [&[IAC, 251, 44][..], &sub(44, &[107, 0xb0]), &[IAC, 252, 1, IAC, 254, 1, IAC, 254, 77][..]].concat();
    assert_eq!(server.take_answers(), expected);
    // What is so already is not answered.
    server.receive(&[IAC, 253, 44, IAC, 251, 44, IAC, 253, 0]);
    assert_eq!(server.take_answers(), [0_u8; 0]);
    server.receive(&[IAC, 254, 0, IAC, 254, 0, IAC, 253, 0]);
    assert_eq!(server.take_answers(), [IAC, 252, 0, IAC, 251, 0]);
}

#[test]
fn the_line_is_set_and_what_cannot_be_is_answered_with_what_is_in_force() {
    use {Parity::*, StopBits::*};
    let mut server = server();
    let baud = |baud: u32| [&[1][..], &baud.to_be_bytes()].concat();
    let answer = |baud: u32| [&[101][..], &baud.to_be_bytes()].concat();
    check(&mut server, &baud(0), &answer(9600), &[]);
    check(&mut server, &baud(115_200), &answer(115_200), &[coding(115_200, 8, None, One)]);
    check(&mut server, &baud(115_200), &answer(115_200), &[]);
    check(&mut server, &baud(49), &answer(115_200), &[]);
    check(&mut server, &baud(4_000_001), &answer(115_200), &[]);
    check(&mut server, &[1, 0, 0, 1], &[], &[]);
    check(&mut server, &[2, 0], &[102, 8], &[]);
    check(&mut server, &[2, 7], &[102, 7], &[coding(115_200, 7, None, One)]);
    check(&mut server, &[2, 9], &[102, 7], &[]);
    check(&mut server, &[2], &[], &[]);
    check(&mut server, &[3, 3], &[103, 3], &[coding(115_200, 7, Even, One)]);
    check(&mut server, &[3, 0], &[103, 3], &[]);
    check(&mut server, &[3, 6], &[103, 3], &[]);
    check(&mut server, &[4, 2], &[104, 2], &[coding(115_200, 7, Even, Two)]);
    check(&mut server, &[4, 3], &[104, 2], &[]);
    check(&mut server, &[4, 0], &[104, 2], &[]);
    // A speed that has IAC in it.
    check(&mut server, &baud(255), &answer(255), &[coding(255, 7, Even, Two)]);
}

#[test]
fn flow_control_break_and_modem_lines_have_states() {
    let mut server = server();
    check(&mut server, &[5, 0], &[105, 1], &[]);
    check(&mut server, &[5, 2], &[105, 2], &[Request::FlowControl(true)]);
    check(&mut server, &[5, 3], &[105, 2], &[]);
    check(&mut server, &[5, 13], &[105, 15], &[]);
    check(&mut server, &[5, 1], &[105, 1], &[Request::FlowControl(false)]);
    check(&mut server, &[5, 17], &[105, 1], &[]);
    check(&mut server, &[5, 16], &[105, 14], &[]);
    check(&mut server, &[5, 4], &[105, 6], &[]);
    check(&mut server, &[5, 5], &[105, 5], &[Request::Break(true)]);
    assert!(server.is_low());
    check(&mut server, &[5, 5], &[105, 5], &[]);
    check(&mut server, &[5, 4], &[105, 5], &[]);
    check(&mut server, &[5, 6], &[105, 6], &[Request::Break(false)]);
    check(&mut server, &[5, 7], &[105, 9], &[]);
    check(&mut server, &[5, 8], &[105, 8], &[Request::Dtr(true)]);
    check(&mut server, &[5, 8], &[105, 8], &[]);
    check(&mut server, &[5, 9], &[105, 9], &[Request::Dtr(false)]);
    check(&mut server, &[5, 10], &[105, 12], &[]);
    check(&mut server, &[5, 11], &[105, 11], &[]);
    check(&mut server, &[5, 10], &[105, 11], &[]);
    check(&mut server, &[5, 20], &[], &[]);
    // Telnet's own break.
    assert_eq!(server.receive(&[IAC, 243]), [Request::Break(true), Request::Break(false)]);
}

#[test]
fn states_are_told_as_far_as_they_are_wanted() {
    let mut server = server();
    server.tell_line_error(true);
    assert_eq!(server.take_answers(), [0_u8; 0], "nothing is wanted at the start");
    check(&mut server, &[10, 0x10], &[110, 0x10], &[]);
    server.tell_line_error(false);
    assert_eq!(server.take_answers(), [0_u8; 0]);
    server.tell_line_error(true);
    assert_eq!(server.take_answers(), sub(44, &[106, 0x10]));
    check(&mut server, &[10, 0xff], &[110, 0xff], &[]);
    server.tell_line_error(true);
    assert_eq!(server.take_answers(), sub(44, &[106, 0x18]));
    check(&mut server, &[7, 0], &[107, 0xb0], &[]);
    let (answers, _) = asked(&mut server, &[11, 0x30]);
    assert_eq!(answers, [sub(44, &[111, 0x30]), sub(44, &[107, 0x30])].concat());
    check(&mut server, &[11, 0], &[111, 0], &[]);
    check(&mut server, &[7], &[], &[]);
}

#[test]
fn purges_and_suspensions_are_passed_on_and_signatures_exchanged() {
    let mut server = server();
    check(&mut server, &[12, 1], &[112, 1], &[Request::PurgeReceived]);
    check(&mut server, &[12, 2], &[112, 2], &[Request::PurgeSent]);
    check(&mut server, &[12, 3], &[112, 3], &[Request::PurgeReceived, Request::PurgeSent]);
    check(&mut server, &[12, 4], &[], &[]);
    check(&mut server, &[8], &[], &[Request::Suspend(true)]);
    check(&mut server, &[9], &[], &[Request::Suspend(false)]);
    check(&mut server, &[0], b"\x64torno", &[]);
    check(&mut server, b"\0a client", &[], &[]);
    check(&mut server, &[], &[], &[]);
    check(&mut server, &[13, 1], &[], &[]);
    assert_eq!(server.receive(&sub(45, &[1])), [], "another option's");
}

/// With data that follow one another in one piece.
fn joined(requests: Vec<Request>) -> Vec<Request> {
    requests.into_iter().fold(Vec::new(), |mut all: Vec<Request>, request| {
        match (all.last_mut(), request) {
            (Some(Request::Data(before)), Request::Data(after)) => before.extend(after),
            (_, request) => all.push(request),
        }
        all
    })
}

/// Bytes in which much is telnet.
fn stream() -> impl Strategy<Value = Vec<u8>> {
    let piece = prop_oneof![
        prop::collection::vec(any::<u8>(), 0..12),
        prop::collection::vec(240..=255u8, 0..6),
        (0..16u8, prop::collection::vec(any::<u8>(), 0..6))
            .prop_map(|(command, value)| { sub(COM_PORT, &[&[command][..], &value].concat()) }),
        (251..=254u8, prop::sample::select(vec![0, 1, 3, 44, 255])).prop_map(|(verb, option)| vec![IAC, verb, option]),
    ];
    prop::collection::vec(piece, 0..20).prop_map(|pieces| pieces.concat())
}

proptest! {
    #[test]
    fn any_stream_cut_anywhere_gives_the_same(bytes in stream(), cut in any::<prop::sample::Index>()) {
        let (first, second) = bytes.split_at(cut.index(bytes.len() + 1));
        let (mut whole, mut parts) = (server(), server());
        let mut requests = parts.receive(first);
        requests.extend(parts.receive(second));
        prop_assert_eq!(joined(requests), joined(whole.receive(&bytes)));
        prop_assert_eq!(parts.take_answers(), whole.take_answers());
    }

    #[test]
    fn answers_are_no_more_than_four_times_what_was_said(bytes in stream()) {
        let mut server = server();
        server.receive(&bytes);
        prop_assert!(server.take_answers().len() <= 4 * bytes.len());
    }

    #[test]
    fn data_go_both_ways_unchanged(bytes: Vec<u8>) {
        let encoded: Vec<u8> = Server::encode(&bytes).collect();
        let expected = if bytes.is_empty() { Vec::new() } else { vec![Request::Data(bytes)] };
        prop_assert_eq!(server().receive(&encoded), expected);
    }

    #[test]
    fn what_is_answered_is_what_is_in_force(bytes in stream()) {
        let mut server = server();
        let mut coding = LineCoding::at(9600);
        // Whatever is under way then, these end it.
        for request in server.receive(&[&bytes[..], &[IAC, 241, IAC, 240]].concat()) {
            if let Request::Coding(next) = request {
                coding = next;
            }
        }
        server.take_answers();
        let baud = [&[101][..], &coding.baud.to_be_bytes()].concat();
        prop_assert_eq!(asked(&mut server, &[1, 0, 0, 0, 0]).0, sub(COM_PORT, &baud));
    }
}
