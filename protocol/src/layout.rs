//! The layout of a rig: its boards, their ports, quantities and motors, and the lines between them.
//!
//! This is all that anything outside the boards knows of a rig. Traces carry it.

use serde::{Deserialize, Serialize};

use crate::board::Description;
use crate::clock::{Clock, Rate};
use crate::uart::ReceiverKind;

/// The kind of a gateway's UART, which joins the rig to the world outside. No board has it.
pub const GATEWAY: &str = "pc";

/// What a rig consists of.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Layout {
    /// The boards, in the order of the engine's numbers; behind them the gateways' UARTs.
    pub boards: Vec<BoardLayout>,
    /// The lines, in the order of the engine's numbers.
    pub lines: Vec<LineLayout>,
}

/// A board of a rig, or a gateway's UART.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BoardLayout {
    /// Its name, unique in the rig.
    pub name: String,
    /// Its kind; [`GATEWAY`] for a gateway's UART.
    pub kind: String,
    /// Its oscillator.
    pub clock: Clock,
    /// What it consists of.
    pub description: Description,
    /// The receiver of each port at the start, in the order of the ports; none if that is not known. A trace has them
    /// behind the layout: those that were written before there were any are still read.
    #[serde(skip)]
    pub receivers: Vec<ReceiverKind>,
}

/// A line of a rig: one direction of a link.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LineLayout {
    /// Its name: `pc_to_master`.
    pub name: String,
    /// What sends on it: the board's number and its port.
    pub from: (usize, u8),
    /// What receives from it: the board's number and its port.
    pub to: (usize, u8),
    /// Its speed at the start, in baud.
    pub baud: u32,
    /// The name of its dialect.
    pub dialect: String,
}

impl BoardLayout {
    /// Whether it is a gateway's UART.
    pub fn is_gateway(&self) -> bool {
        self.kind == GATEWAY
    }
}

impl Layout {
    /// The numbers of the gateways' UARTs.
    pub fn gateways(&self) -> impl Iterator<Item = usize> {
        self.boards.iter().enumerate().filter(|(_, board)| board.is_gateway()).map(|(number, _)| number)
    }

    /// Whether a line ends at a gateway's UART, at either end.
    pub fn is_outside(&self, line: &LineLayout) -> bool {
        self.sends_outside(line) || self.boards[line.to.0].is_gateway()
    }

    /// The receiver at a line's end; a hardware UART at the line's speed if that is not known.
    pub fn receiver(&self, line: &LineLayout) -> ReceiverKind {
        let (board, port) = line.to;
        let known = self.boards[board].receivers.get(usize::from(port)).copied();
        known.unwrap_or(ReceiverKind::Hardware { baud: Rate::hz(line.baud) })
    }

    /// Whether a gateway's UART sends on a line.
    pub fn sends_outside(&self, line: &LineLayout) -> bool {
        self.boards[line.from.0].is_gateway()
    }

    /// The number of the board of that name.
    pub fn board(&self, name: &str) -> Option<usize> {
        self.boards.iter().position(|board| board.name == name)
    }

    /// The number of the line of that name.
    pub fn line(&self, name: &str) -> Option<usize> {
        self.lines.iter().position(|line| line.name == name)
    }

    /// Whether every line's ends are boards and ports of this rig.
    pub fn is_sound(&self) -> bool {
        let end = |(board, port): (usize, u8)| {
            self.boards.get(board).is_some_and(|board| usize::from(port) < board.description.ports.len())
        };
        self.lines.iter().all(|line| end(line.from) && end(line.to))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A board with one port, and the gateway's UART with two.
    fn layout(from: (usize, u8), to: (usize, u8)) -> Layout {
        let board = |name: &str, kind: &str, ports: &[&str]| BoardLayout {
            name: name.to_owned(),
            kind: kind.to_owned(),
            clock: Clock::TRUE,
            description: Description {
                ports: ports.iter().map(|&port| port.to_owned()).collect(),
                ..Description::default()
            },
            receivers: Vec::new(),
        };
        let line = LineLayout { name: "line".to_owned(), from, to, baud: 9600, dialect: "lathe".to_owned() };
        Layout { boards: vec![board("master", "master", &["a"]), board("pc", GATEWAY, &["a", "b"])], lines: vec![line] }
    }

    #[test]
    fn both_ends_of_a_line_are_ports_of_boards() {
        assert!(layout((0, 0), (1, 1)).is_sound());
        for (from, to) in [((0, 1), (1, 0)), ((0, 0), (1, 2)), ((2, 0), (0, 0)), ((0, 0), (2, 0))] {
            assert!(!layout(from, to).is_sound(), "{from:?} to {to:?}");
        }
    }

    #[test]
    fn a_line_is_outside_if_either_end_is_a_gateway() {
        for (from, to, outside, sends) in
            [((0, 0), (0, 0), false, false), ((0, 0), (1, 0), true, false), ((1, 0), (0, 0), true, true)]
        {
            let layout = layout(from, to);
            let line = &layout.lines[0];
            assert_eq!((layout.is_outside(line), layout.sends_outside(line)), (outside, sends), "{from:?} to {to:?}");
        }
    }
}
