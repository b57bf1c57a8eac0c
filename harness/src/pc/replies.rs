//! The replies that the PC hears, as scenarios and faults write them.

use torno_protocol::lathe::{Reply, ReplyDecoder};
use torno_protocol::time::Instant;

/// The replies that the PC has heard, and when.
#[derive(Clone, Debug, Default)]
pub struct Replies {
    decoder: ReplyDecoder,
    heard: Vec<(Instant, String)>,
}

impl Replies {
    /// Takes a byte that the PC has received; gives the replies that are complete with it.
    pub fn hear(&mut self, at: Instant, byte: u8) -> Vec<Reply> {
        let replies = self.decoder.push(byte);
        self.heard.extend(replies.iter().map(|reply| (at, reply.code())));
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
