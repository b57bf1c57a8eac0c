//! Conditions: what can happen in a rig, and what can be said of its quantities.
//!
//! Scenarios wait for them and forbid them; faults begin with them.

mod file;

pub(crate) use file::{RawCondition, replies};

use torno_protocol::time::Instant;

use torno_bus::{RECEIVED, Replies};
use torno_engine::{NodeId, Sight, Watch};

/// Something that happens.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Condition {
    /// The PC hears a reply.
    Reply(String),
    /// A quantity is within bounds.
    Value(Claim),
    /// A board reports an event.
    Event {
        /// The board.
        node: NodeId,
        /// The event's number.
        event: u8,
        /// Its text, for people.
        text: String,
    },
    /// A board sends its `nth` character on a port, from 1.
    Character {
        /// The board.
        node: NodeId,
        /// Its port.
        port: u8,
        /// Which.
        nth: u64,
        /// The line, for people.
        line: String,
    },
}

/// A quantity lies within bounds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Claim {
    /// The board.
    pub node: NodeId,
    /// The quantity's number.
    pub signal: u8,
    /// The least value.
    pub least: i64,
    /// The greatest.
    pub most: i64,
    /// `board.quantity`, for people.
    pub name: String,
}

impl Claim {
    /// Whether a value is within the bounds.
    pub fn holds(&self, value: i64) -> bool {
        (self.least..=self.most).contains(&value)
    }
}

impl Condition {
    /// What to look out for.
    pub const fn watch(&self, pc: NodeId) -> Watch {
        match self {
            Self::Reply(_) => Watch { node: pc, what: Sight::Event(RECEIVED) },
            Self::Value(Claim { node, signal, least, most, .. }) => {
                let what = Sight::Telemetry { signal: *signal, least: *least, most: *most };
                Watch { node: *node, what }
            }
            Self::Event { node, event, .. } => Watch { node: *node, what: Sight::Event(*event) },
            Self::Character { node, port, .. } => Watch { node: *node, what: Sight::Character(*port) },
        }
    }

    /// How often what is looked out for must be seen.
    pub const fn occurrences(&self) -> u64 {
        if let Self::Character { nth, .. } = self { *nth } else { 1 }
    }

    /// Whether it holds by what each quantity of each board is: what happens in an instant never does.
    pub fn holds(&self, value: impl Fn(NodeId, u8) -> i64) -> bool {
        matches!(self, Self::Value(claim) if claim.holds(value(claim.node, claim.signal)))
    }

    /// Whether what was seen at `at` is what was meant, if the PC has heard these replies.
    pub fn is_met(&self, replies: &Replies, at: Instant) -> bool {
        match self {
            Self::Reply(expected) => replies.at(at).any(|reply| is_reply(reply, expected)),
            _ => true,
        }
    }
}

/// Whether a reply is one that was meant: `NAK` alone stands for any refusal, `CAN` for any failure.
pub fn is_reply(heard: &str, expected: &str) -> bool {
    heard == expected || heard.split(' ').next() == Some(expected)
}

impl std::fmt::Display for Claim {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match (self.least, self.most) {
            (least, most) if least == most => write!(f, "{} = {least}", self.name),
            (i64::MIN, most) => write!(f, "{} ≤ {most}", self.name),
            (least, i64::MAX) => write!(f, "{} ≥ {least}", self.name),
            (least, most) => write!(f, "{} from {least} to {most}", self.name),
        }
    }
}

impl std::fmt::Display for Condition {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Reply(reply) => write!(f, "the reply {reply}"),
            Self::Value(claim) => write!(f, "{claim}"),
            Self::Event { text, .. } => write!(f, "the event '{text}'"),
            Self::Character { nth, line, .. } => write!(f, "character {nth} on {line}"),
        }
    }
}
