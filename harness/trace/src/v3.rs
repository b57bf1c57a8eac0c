//! Version 3 of the format: its header says less of the lines and nothing of the clocks.

use serde::Deserialize;
use torno_protocol::board::Description;
use torno_protocol::clock::Clock;
use torno_protocol::layout::{BoardLayout, Layout, LineLayout};

use crate::Header;

/// The number of this version.
pub(crate) const VERSION: u16 = 3;

/// The speed of the lines of a rig that cannot be built.
const UNKNOWN_BAUD: u32 = 9600;

#[derive(Deserialize)]
struct HeaderV3 {
    torno: String,
    rig: String,
    text: String,
    seed: u64,
    program: Option<String>,
    boards: Vec<Board>,
    lines: Vec<Line>,
}

#[derive(Deserialize)]
struct Board {
    name: String,
    kind: String,
    description: Description,
}

#[derive(Deserialize)]
struct Line {
    name: String,
    from: usize,
    to: usize,
}

/// Reads a header. What it does not say is what the rig that its text describes has today, as far as it can be built
/// and has the same boards and lines.
pub(crate) fn header(bytes: &[u8], layout: impl Fn(&str, &str) -> Option<Layout>) -> Option<Header> {
    let HeaderV3 { torno, rig, text, seed, program, boards, lines } = postcard::from_bytes(bytes).ok()?;
    if lines.iter().any(|line| line.from >= boards.len() || line.to >= boards.len()) {
        return None;
    }
    let today = layout(&rig, &text).filter(|layout| is_same(layout, &boards, &lines));
    let layout = today.unwrap_or_else(|| Layout {
        boards: boards
            .into_iter()
            .map(|Board { name, kind, description }| BoardLayout { name, kind, clock: Clock::TRUE, description })
            .collect(),
        lines: lines.into_iter().map(Line::alone).collect(),
    });
    Some(Header { torno, rig, text, seed, program, layout })
}

fn is_same(layout: &Layout, boards: &[Board], lines: &[Line]) -> bool {
    let same_board =
        |(a, b): (&BoardLayout, &Board)| (&a.name, &a.kind, &a.description) == (&b.name, &b.kind, &b.description);
    let same_line = |(a, b): (&LineLayout, &Line)| (&a.name, a.from.0, a.to.0) == (&b.name, b.from, b.to);
    layout.boards.len() == boards.len()
        && layout.lines.len() == lines.len()
        && layout.boards.iter().zip(boards).all(same_board)
        && layout.lines.iter().zip(lines).all(same_line)
}

impl Line {
    /// All that is known of it without its rig.
    fn alone(self) -> LineLayout {
        let Self { name, from, to } = self;
        LineLayout { name, from: (from, 0), to: (to, 0), baud: UNKNOWN_BAUD, dialect: String::new() }
    }
}
