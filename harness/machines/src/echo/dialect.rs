//! The dialect: every byte comes back.

use std::collections::VecDeque;

use torno_bus::{Dialect, LineCharacter, Listener, Message, Reader, Reply, no_reply};
use torno_protocol::layout::Layout;
use torno_protocol::time::Instant;

/// The speed of the line, in baud.
pub(super) const BAUD: u32 = 9600;

/// The dialect.
#[derive(Debug)]
pub(super) struct Echo;

impl Dialect for Echo {
    fn name(&self) -> &'static str {
        "echo"
    }

    fn baud(&self) -> u32 {
        BAUD
    }

    fn holds_the_pc(&self) -> bool {
        false
    }

    /// `ECHO 65`, or `ECHO` for any byte.
    fn check_reply(&self, code: &str) -> Result<(), String> {
        match code.split_once(' ') {
            None if code == "ECHO" => Ok(()),
            Some(("ECHO", byte)) if byte.parse::<u8>().is_ok() => Ok(()),
            _ => Err(no_reply(code, &["ECHO"])),
        }
    }

    fn listener(&self) -> Box<dyn Listener> {
        Box::new(Cable)
    }

    fn reader(&self, layout: &Layout) -> Box<dyn Reader> {
        let from_pc = layout.lines.iter().map(|line| layout.sends_outside(line)).collect();
        Box::new(Lines { from_pc, sent: VecDeque::new(), messages: Vec::new() })
    }

    /// The text as it stands.
    fn bytes(&self, text: &str) -> Result<Vec<u8>, String> {
        Ok(text.as_bytes().to_vec())
    }
}

/// What goes over the PC's cable.
#[derive(Debug)]
struct Cable;

impl Listener for Cable {
    fn sent(&mut self, _: Instant, byte: u8) -> Vec<String> {
        vec![format!("{byte:02X}")]
    }

    fn received(&mut self, _: Instant, byte: u8) -> Vec<Reply> {
        vec![Reply { code: format!("ECHO {byte}"), text: format!("{byte:02X} again") }]
    }
}

/// Reads both lines together.
#[derive(Debug)]
struct Lines {
    /// For each line, whether the PC sends on it.
    from_pc: Vec<bool>,
    /// What has not come back.
    sent: VecDeque<u8>,
    messages: Vec<Message>,
}

impl Reader for Lines {
    fn hear(&mut self, characters: &[LineCharacter]) {
        for LineCharacter { at, line, character } in characters {
            let Some(byte) = character.ok() else { continue };
            let (text, flaw) = if self.from_pc[*line] {
                self.sent.push_back(byte);
                (format!("send {byte:02X} back"), false)
            } else {
                let flaw = self.sent.pop_front() != Some(byte);
                (if flaw { format!("{byte:02X} is no echo") } else { format!("{byte:02X} is back") }, flaw)
            };
            self.messages.push(Message { at: *at, line: *line, text, flaw });
        }
    }

    fn end(&mut self) {}

    fn take(&mut self) -> Vec<Message> {
        core::mem::take(&mut self.messages)
    }
}
