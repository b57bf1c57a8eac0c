//! The replies that the PC hears, as scenarios and faults write them.

use torno_protocol::time::Instant;

use crate::dialect::{Dialect, Listener, Reply};

/// The replies that the PC has heard, and when.
#[derive(Debug)]
pub struct Replies {
    listener: Box<dyn Listener>,
    heard: Vec<(Instant, String)>,
}

impl Replies {
    /// Nothing has been heard yet of this dialect.
    pub fn new(dialect: &dyn Dialect) -> Self {
        Self { listener: dialect.listener(), heard: Vec::new() }
    }

    /// Takes a byte that the PC has sent: what it hears can depend on it. Gives what is complete with it, for people.
    pub fn send(&mut self, at: Instant, byte: u8) -> Vec<String> {
        self.listener.sent(at, byte)
    }

    /// Takes a byte that the PC has received; gives the replies that are complete with it.
    pub fn hear(&mut self, at: Instant, byte: u8) -> Vec<Reply> {
        let replies = self.listener.received(at, byte);
        self.heard.extend(replies.iter().map(|reply| (at, reply.code.clone())));
        replies
    }

    /// Those that were complete at an instant.
    pub fn at(&self, at: Instant) -> impl Iterator<Item = &str> {
        let then = self.heard.iter().rev().skip_while(move |(heard, _)| *heard > at);
        then.take_while(move |(heard, _)| *heard == at).map(|(_, reply)| reply.as_str())
    }

    /// All, from the `first` on.
    pub fn from(&self, first: usize) -> impl Iterator<Item = &str> {
        self.heard.iter().skip(first).map(|(_, reply)| reply.as_str())
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.heard.len()
    }

    /// Forgets all but the last `n`.
    pub fn keep_last(&mut self, n: usize) {
        self.heard.drain(..self.heard.len().saturating_sub(n));
    }
}
