//! Dialects: what is said on the lines of each machine.
//!
//! Here alone it is known which there are. Whatever reads or writes lines (traces, scenarios, faults, the live rig)
//! does so by the [`Dialect`] that the rig file names.

mod lathe;
mod servo;

use std::fmt::Debug;

use torno_protocol::time::Instant;

use crate::trace::Header;
use crate::trace::decode::Heard;
use torno_engine::LineId;
use torno_text::nearest;

/// The dialects that there are.
const ALL: [&dyn Dialect; 2] = [&lathe::Lathe, &servo::Servo];

/// What is said on the lines of a machine.
pub trait Dialect: Debug + Sync {
    /// Its name, as rig files say it.
    fn name(&self) -> &'static str;

    /// The speed of the lines between its boards, in baud.
    fn baud(&self) -> u32;

    /// Whether the controller holds a PC with `XON` and `XOFF`; if not, they are bytes like others.
    fn holds_the_pc(&self) -> bool;

    /// Refuses what is no reply that the PC can hear, as scenarios write it: a word and its letters or numbers. The
    /// word alone stands for every reply that begins with it.
    ///
    /// # Errors
    /// The nearest that there is.
    fn check_reply(&self, code: &str) -> Result<(), String>;

    /// Somebody who listens at the PC's side of the cable.
    fn listener(&self) -> Box<dyn Listener>;

    /// Somebody who reads the lines of a rig like this.
    fn reader(&self, header: &Header) -> Box<dyn Reader>;

    /// The bytes that stand for what a scenario lets the PC send.
    ///
    /// # Errors
    /// What is wrong with the text.
    fn bytes(&self, text: &str) -> Result<Vec<u8>, String>;

    /// The command that plays programs on such a rig.
    fn player(&self) -> &'static str;
}

/// Listens at the PC's side of the cable.
pub trait Listener: Debug + Send {
    /// The PC has sent a byte; gives what is complete with it, for people.
    fn sent(&mut self, at: Instant, byte: u8) -> Vec<String>;

    /// The PC has received a byte; gives the replies that are complete with it.
    fn received(&mut self, at: Instant, byte: u8) -> Vec<Reply>;
}

/// Makes messages of the characters on all lines of a rig.
pub trait Reader: Debug + Send {
    /// Takes characters that follow on those before, in order of time.
    fn hear(&mut self, characters: &[Heard]);

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
fn is_stray_byte(code: &str) -> bool {
    let digit = |byte: &u8| matches!(byte, b'0'..=b'9' | b'A'..=b'F');
    matches!(code.as_bytes(), [b'?', high, low] if digit(high) && digit(low))
}

/// The complaint about what is no reply.
fn no_reply(code: &str, known: &[&str]) -> String {
    format!("there is no reply '{code}'{}", nearest(code, known))
}

/// The dialect of that name.
///
/// # Errors
/// What was expected.
pub fn named(name: &str) -> Result<&'static dyn Dialect, String> {
    let known = ALL.map(Dialect::name);
    let found = ALL.into_iter().find(|dialect| dialect.name() == name);
    found.ok_or_else(|| format!("unknown dialect '{name}'{}", nearest(name, &known)))
}

/// Somebody who reads the lines of the rig that was recorded; None if its dialect is not known here: a trace can come
/// from another version of torno.
pub fn reader(header: &Header) -> Option<Box<dyn Reader>> {
    let rig: toml::Table = toml::from_str(&header.text).ok()?;
    Some(named(rig.get("dialect")?.as_str()?).ok()?.reader(header))
}

/// The messages in these characters, which are in order of time; in order of time, too.
pub fn messages(header: &Header, characters: &[Heard]) -> Vec<Message> {
    let Some(mut reader) = reader(header) else { return Vec::new() };
    reader.hear(characters);
    reader.end();
    reader.take()
}

/// Bytes as two digits each.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(" ")
}
