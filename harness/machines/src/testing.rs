//! Layouts of small rigs, for tests.

use torno_bus::PcUart;
use torno_protocol::board::Board;
use torno_protocol::clock::Clock;
use torno_protocol::layout::{BoardLayout, GATEWAY, Layout, LineLayout};

use crate::kinds;

/// A rig whose boards are named like their kinds; `pc` is a gateway. Each link gives two lines.
pub(crate) fn layout(dialect: &str, pc: &[(&str, &str)], links: &[(&str, &str)]) -> Layout {
    let links = || pc.iter().chain(links);
    let mut layout = Layout::default();
    for name in links().flat_map(|(a, b)| [*a, *b]) {
        if layout.board(name).is_none() {
            let (kind, description) = match name {
                "pc" => (GATEWAY, PcUart::new(9600, 1, Clock::TRUE).description()),
                kind => (kind, kinds::build(kind, "", Clock::TRUE).unwrap().description()),
            };
            let (name, kind) = (name.to_owned(), kind.to_owned());
            layout.boards.push(BoardLayout { name, kind, clock: Clock::TRUE, description, receivers: Vec::new() });
        }
    }
    let end = |name: &str| (layout.board(name).unwrap(), 0);
    let line = |from: &str, to: &str| LineLayout {
        name: format!("{from}_to_{to}"),
        from: end(from),
        to: end(to),
        baud: 9600,
        dialect: dialect.to_owned(),
    };
    layout.lines = links().flat_map(|(a, b)| [line(a, b), line(b, a)]).collect();
    layout
}
