//! The names that a rig gives to its parts.

use toml::Spanned;
use torno_protocol::board::{Capability, Description};
use torno_protocol::layout::Layout;

use crate::dialect::Dialect;
use torno_engine::{LineId, NodeId};
use torno_text::{Complaint, nearest};

/// The names that a rig gives to its parts.
#[derive(Clone, Debug)]
pub struct Names {
    /// What is said on its lines.
    pub dialect: &'static dyn Dialect,
    /// Boards, and last the PC.
    pub boards: Vec<String>,
    /// What each consists of.
    pub descriptions: Vec<Description>,
    /// Lines.
    pub lines: Vec<String>,
    /// What sends on each line: the board and its port.
    pub senders: Vec<(NodeId, u8)>,
}

impl Names {
    /// The names in a rig, in the order of the engine's numbers.
    pub fn of(layout: &Layout, dialect: &'static dyn Dialect) -> Self {
        Self {
            dialect,
            boards: layout.boards.iter().map(|board| board.name.clone()).collect(),
            descriptions: layout.boards.iter().map(|board| board.description.clone()).collect(),
            lines: layout.lines.iter().map(|line| line.name.clone()).collect(),
            senders: layout.lines.iter().map(|line| line.from).collect(),
        }
    }

    /// The number of a board.
    ///
    /// # Errors
    /// Where, and the nearest known name.
    pub fn board(&self, name: &Spanned<String>) -> Result<NodeId, Complaint> {
        find("board", name, &self.boards)
    }

    /// The number of a board or, as `BOARD.MOTOR`, of one of its several motors, too.
    ///
    /// # Errors
    /// Where, and the nearest known name.
    pub fn board_or_motor(&self, name: &Spanned<String>) -> Result<(NodeId, Option<u8>), Complaint> {
        let Some((board, motor)) = name.get_ref().split_once('.') else { return Ok((self.board(name)?, None)) };
        let node = self.board(&Spanned::new(name.span(), board.to_owned()))?;
        let description = &self.descriptions[node];
        let known: Vec<String> = (0..description.motors.len() as u8)
            .filter_map(|motor| description.motor_name(motor).map(str::to_owned))
            .collect();
        let motor = Spanned::new(name.span(), motor.to_owned());
        find(&format!("motor of '{board}'"), &motor, &known).map(|place| (node, Some(place as u8)))
    }

    /// The boards that can do something, by themselves or by their only motor, and the motors, as `BOARD.MOTOR`, of
    /// those that have several.
    pub fn capable(&self, what: Capability) -> Vec<String> {
        let mut names = Vec::new();
        for (board, description) in self.boards.iter().zip(&self.descriptions) {
            names.extend(description.capabilities.contains(&what).then(|| board.clone()));
            let motors = description.motors.iter().zip(0..).filter(|(motor, _)| motor.capabilities.contains(&what));
            names.extend(motors.map(|(_, motor)| match description.motor_name(motor) {
                Some(name) => format!("{board}.{name}"),
                None => board.clone(),
            }));
        }
        names
    }

    /// The number of a line.
    ///
    /// # Errors
    /// Where, and the nearest known name.
    pub fn line(&self, name: &Spanned<String>) -> Result<LineId, Complaint> {
        find("line", name, &self.lines)
    }

    /// The number of a board's quantity.
    ///
    /// # Errors
    /// Where, and the nearest known name.
    pub fn signal(&self, board: NodeId, name: &Spanned<String>) -> Result<u8, Complaint> {
        let known: Vec<String> = self.descriptions[board].signals.iter().map(|signal| signal.name.clone()).collect();
        find(&format!("quantity of '{}'", self.boards[board]), name, &known).map(|place| place as u8)
    }
}

fn find(what: &str, name: &Spanned<String>, known: &[String]) -> Result<usize, Complaint> {
    known.iter().position(|other| other == name.get_ref()).ok_or_else(|| {
        let known: Vec<&str> = known.iter().map(String::as_str).collect();
        (name.span(), format!("there is no {what} '{}'{}", name.get_ref(), nearest(name.get_ref(), &known)))
    })
}
