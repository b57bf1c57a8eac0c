//! Dialects: what the bytes on a line mean.
//!
//! Whatever reads or writes lines (traces, scenarios, faults, the live rig) does so by the [`Dialect`] that the layout
//! names for each line.

use std::fmt::Debug;

use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::Character;

use crate::LineCharacter;
use torno_engine::LineId;
use torno_protocol::layout::Layout;
use torno_text::nearest;

/// What is said on the lines of a machine.
pub trait Dialect: Debug + Sync {
    /// Its name, as rig files say it.
    fn name(&self) -> &'static str;

    /// The speed of the lines between its boards, in baud.
    fn baud(&self) -> u32;

    /// Whether the controller holds a PC with `XON` and `XOFF`; if not, they are bytes like others.
    fn holds_the_pc(&self) -> bool;

    /// Whether a PC holds itself: by counting characters until the controller has answered their lines.
    fn counts_characters(&self) -> bool {
        false
    }

    /// Refuses what is no reply that the PC can hear, as scenarios write it: a word and its letters or numbers. The
    /// word alone stands for every reply that begins with it.
    ///
    /// # Errors
    /// The nearest that there is.
    fn check_reply(&self, code: &str) -> Result<(), String>;

    /// Somebody who listens at the PC's side of the cable.
    fn listener(&self) -> Box<dyn Listener>;

    /// Somebody who reads those lines of a rig that have this dialect.
    fn reader(&self, layout: &Layout) -> Box<dyn Reader>;

    /// Somebody who measures how long the controller takes; none if nothing is to be measured.
    fn stopwatch(&self) -> Option<Box<dyn Stopwatch>> {
        None
    }

    /// The bytes that stand for what a scenario lets the PC send.
    ///
    /// # Errors
    /// What is wrong with the text.
    fn bytes(&self, text: &str) -> Result<Vec<u8>, String>;

    /// The command that plays programs on such a rig; if there is none, the one that lets a program in.
    fn player(&self) -> &'static str {
        "torno up"
    }

    /// The command that plays one at the port of a rig that is up, if there is one.
    fn player_at_port(&self) -> Option<&'static str> {
        None
    }
}

/// Listens at the PC's side of the cable.
pub trait Listener: Debug + Send {
    /// The PC has sent a byte; gives what is complete with it, for people.
    fn sent(&mut self, at: Instant, byte: u8) -> Vec<String>;

    /// The PC has received a byte; gives the replies that are complete with it.
    fn received(&mut self, at: Instant, byte: u8) -> Vec<Reply>;
}

/// Measures, by the characters on the cable, how long the controller takes for what the PC asks for.
pub trait Stopwatch: Debug + Send {
    /// A character has come from the PC.
    fn sent(&mut self, at: Instant, character: Character);

    /// A byte has come from the controller; gives the phases that are over with it.
    fn received(&mut self, at: Instant, byte: u8) -> Vec<(Phase, Span)>;
}

/// A phase of the work on something that the PC asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// From its last byte to its acceptance, if it is not held.
    Answer,
    /// From the end of the hold to the acceptance of what was held.
    HeldAnswer,
    /// From its acceptance to the end of its execution.
    Execution,
    /// From its last byte to the end of its execution.
    Whole,
}

/// Makes messages of the characters on all lines of a rig.
pub trait Reader: Debug + Send {
    /// Takes characters that follow on those before, in order of time.
    fn hear(&mut self, characters: &[LineCharacter]);

    /// Nothing more will come.
    fn end(&mut self);

    /// The messages since the last call, in order of time. What is known to be cut short only by what follows it comes
    /// with that.
    fn take(&mut self) -> Vec<Message>;
}

/// A reply that the PC has heard.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reply {
    /// As scenarios and faults write it: a word, and letters or numbers after it.
    pub code: String,
    /// For people.
    pub text: String,
}

/// Something that was said over a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// When it was complete.
    pub at: Instant,
    /// The line.
    pub line: LineId,
    /// What was said.
    pub text: String,
    /// Something is wrong with it.
    pub flaw: bool,
}

/// Whether it stands for a byte that is no reply, as listeners put it: `?18`.
pub fn is_stray_byte(code: &str) -> bool {
    let digit = |byte: &u8| matches!(byte, b'0'..=b'9' | b'A'..=b'F');
    matches!(code.as_bytes(), [b'?', high, low] if digit(high) && digit(low))
}

/// The complaint about what is no reply.
pub fn no_reply(code: &str, known: &[&str]) -> String {
    format!("there is no reply '{code}'{}", nearest(code, known))
}

/// Finds a dialect by its name.
pub type Dialects = fn(&str) -> Option<&'static dyn Dialect>;

/// Reads all lines of a rig, each by its own dialect. A line whose dialect is not known is not read: a trace can come
/// from another version of torno.
#[derive(Debug)]
pub struct Readers {
    readers: Vec<(Vec<bool>, Box<dyn Reader>)>,
}

impl Readers {
    /// Readers of a rig with this layout.
    pub fn new(layout: &Layout, dialects: Dialects) -> Self {
        let mut names: Vec<&str> = layout.lines.iter().map(|line| line.dialect.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        let reader = |name: &str| {
            let lines = layout.lines.iter().map(|line| line.dialect == name).collect();
            Some((lines, dialects(name)?.reader(layout)))
        };
        Self { readers: names.into_iter().filter_map(reader).collect() }
    }

    /// Takes characters that follow on those before, in order of time.
    pub fn hear(&mut self, characters: &[LineCharacter]) {
        match &mut self.readers[..] {
            // Nearly always all lines have one dialect.
            [(lines, reader)] if lines.iter().all(|line| *line) => reader.hear(characters),
            readers => readers.iter_mut().for_each(|(lines, reader)| {
                let theirs: Vec<LineCharacter> = characters.iter().filter(|heard| lines[heard.line]).copied().collect();
                reader.hear(&theirs);
            }),
        }
    }

    /// Nothing more will come.
    pub fn end(&mut self) {
        self.readers.iter_mut().for_each(|(_, reader)| reader.end());
    }

    /// The messages since the last call, in order of time.
    pub fn take(&mut self) -> Vec<Message> {
        let mut messages: Vec<Message> = self.readers.iter_mut().flat_map(|(_, reader)| reader.take()).collect();
        messages.sort_by_key(|message| message.at);
        messages
    }

    /// The messages in these characters, which are in order of time; in order of time, too.
    pub fn messages(mut self, characters: &[LineCharacter]) -> Vec<Message> {
        self.hear(characters);
        self.end();
        self.take()
    }
}

/// Bytes as two digits each.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(" ")
}
