//! Version 4 of the format: its boards have no output pins, and its facts report none.

use serde::Deserialize;
use torno_protocol::board::{Capability, Description, Motor, Signal, Wait};
use torno_protocol::clock::Clock;
use torno_protocol::layout::{BoardLayout, Layout, LineLayout};

use crate::Header;

/// The number of this version.
pub(crate) const VERSION: u16 = 4;

#[derive(Deserialize)]
struct HeaderV4 {
    torno: String,
    rig: String,
    text: String,
    seed: u64,
    program: Option<String>,
    layout: LayoutV4,
}

#[derive(Deserialize)]
struct LayoutV4 {
    boards: Vec<Board>,
    lines: Vec<LineLayout>,
}

#[derive(Deserialize)]
struct Board {
    name: String,
    kind: String,
    clock: Clock,
    description: DescriptionV4,
}

#[derive(Deserialize)]
struct DescriptionV4 {
    ports: Vec<String>,
    signals: Vec<Signal>,
    events: Vec<String>,
    waits: Vec<Wait>,
    capabilities: Vec<Capability>,
    motors: Vec<Motor>,
}

/// Takes a header; gives the bytes that follow it.
pub(crate) fn take_header(bytes: &[u8]) -> Option<(Header, &[u8])> {
    let (header, rest) = postcard::take_from_bytes::<HeaderV4>(bytes).ok()?;
    let HeaderV4 { torno, rig, text, seed, program, layout: LayoutV4 { boards, lines } } = header;
    let boards = boards.into_iter().map(Board::layout).collect();
    Some((Header { torno, rig, text, seed, program, layout: Layout { boards, lines } }, rest))
}

impl Board {
    fn layout(self) -> BoardLayout {
        let Self { name, kind, clock, description } = self;
        let DescriptionV4 { ports, signals, events, waits, capabilities, motors } = description;
        let description = Description { ports, signals, events, waits, capabilities, motors, pins: Vec::new() };
        BoardLayout { name, kind, clock, description, receivers: Vec::new() }
    }
}
