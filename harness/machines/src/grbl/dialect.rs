//! The dialect: lines of G-code and commands of one byte, and lines back.

use torno_bus::{Dialect, LineCharacter, Listener, Message, Reader, Reply, no_reply};
use torno_grbl::realtime::{Fate, fate};
use torno_protocol::layout::Layout;
use torno_protocol::time::Instant;

/// The dialect.
#[derive(Debug)]
pub(super) struct Grbl;

/// The words that stand for replies; of a status, it is its state.
const WORDS: [&str; 18] = [
    "ok", "error", "ALARM", "Grbl", "message", "Idle", "Run", "Hold:0", "Hold:1", "Jog", "Home", "Alarm", "Check",
    "Door:0", "Door:1", "Door:2", "Door:3", "Sleep",
];

impl Dialect for Grbl {
    fn name(&self) -> &'static str {
        "grbl"
    }

    fn baud(&self) -> u32 {
        115_200
    }

    fn holds_the_pc(&self) -> bool {
        false
    }

    fn counts_characters(&self) -> bool {
        true
    }

    /// `ok`, `error 20`, `ALARM 1`, `Grbl`, `status idle`, `message`; a word alone stands for all that begin with it.
    fn check_reply(&self, code: &str) -> Result<(), String> {
        let known = match code.split_once(' ') {
            None => WORDS.contains(&code),
            Some(("error" | "ALARM", number)) => number.parse::<u8>().is_ok(),
            Some(_) => false,
        };
        if known { Ok(()) } else { Err(no_reply(code, &WORDS)) }
    }

    fn listener(&self) -> Box<dyn Listener> {
        Box::new(Cable::default())
    }

    fn reader(&self, layout: &Layout) -> Box<dyn Reader> {
        let from_pc = layout.lines.iter().map(|line| layout.sends_outside(line)).collect();
        Box::new(Lines { from_pc, cable: Cable::default(), messages: Vec::new() })
    }

    /// The text as it stands: a character up to U+00FF is a byte, so that `\u0018` resets.
    fn bytes(&self, text: &str) -> Result<Vec<u8>, String> {
        let byte =
            |c: char| u8::try_from(u32::from(c)).map_err(|_| format!("'{c}' is no byte: expected U+0000 to U+00FF"));
        text.chars().map(byte).collect()
    }
}

/// A line that has not ended.
#[derive(Clone, Debug, Default)]
struct Partial(Vec<u8>);

impl Partial {
    /// Takes a byte; gives the line that ends with it.
    fn push(&mut self, byte: u8) -> Option<String> {
        match byte {
            b'\n' => {
                let line = String::from_utf8_lossy(&core::mem::take(&mut self.0)).into_owned();
                Some(line.trim_end_matches('\r').to_owned())
            }
            byte => {
                self.0.push(byte);
                None
            }
        }
    }
}

/// What goes over the PC's cable.
#[derive(Clone, Debug, Default)]
struct Cable {
    sent: Partial,
    received: Partial,
}

impl Cable {
    /// What is complete with a byte of the PC.
    fn command(&mut self, byte: u8) -> Option<String> {
        match fate(byte) {
            Fate::Command(command) => Some(format!("{command:?}")),
            Fate::Ignored => None,
            Fate::Buffered => self.sent.push(byte),
        }
    }

    fn reply(&mut self, byte: u8) -> Option<Reply> {
        let text = self.received.push(byte).filter(|line| !line.is_empty())?;
        Some(Reply { code: code(&text), text })
    }
}

/// A reply as scenarios write it.
fn code(line: &str) -> String {
    match (line.split_once(':'), line.strip_prefix('<')) {
        (_, Some(status)) => status.split(['|', '>']).next().unwrap_or_default().to_owned(),
        (Some((word @ ("error" | "ALARM"), number)), _) => format!("{word} {number}"),
        _ if line == "ok" => line.to_owned(),
        _ if line.starts_with("Grbl ") => "Grbl".to_owned(),
        _ => "message".to_owned(),
    }
}

impl Listener for Cable {
    fn sent(&mut self, _: Instant, byte: u8) -> Vec<String> {
        self.command(byte).into_iter().collect()
    }

    fn received(&mut self, _: Instant, byte: u8) -> Vec<Reply> {
        self.reply(byte).into_iter().collect()
    }
}

/// Reads both lines.
#[derive(Debug)]
struct Lines {
    /// For each line, whether the PC sends on it.
    from_pc: Vec<bool>,
    cable: Cable,
    messages: Vec<Message>,
}

impl Reader for Lines {
    fn hear(&mut self, characters: &[LineCharacter]) {
        for LineCharacter { at, line, character } in characters {
            let Some(byte) = character.ok() else { continue };
            let said = if self.from_pc[*line] {
                self.cable.command(byte).map(|text| (text, false))
            } else {
                self.cable.reply(byte).map(|Reply { code, text }| {
                    let flaw = code.starts_with("error ") || code.starts_with("ALARM ");
                    (text, flaw)
                })
            };
            if let Some((text, flaw)) = said {
                self.messages.push(Message { at: *at, line: *line, text, flaw });
            }
        }
    }

    fn end(&mut self) {}

    fn take(&mut self) -> Vec<Message> {
        core::mem::take(&mut self.messages)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replies_have_codes() {
        for (line, expected) in [
            ("ok", "ok"),
            ("error:20", "error 20"),
            ("ALARM:1", "ALARM 1"),
            ("Grbl 1.1h ['$' for help]", "Grbl"),
            ("<Hold:1|MPos:0.000,0.000,0.000|FS:0,0>", "Hold:1"),
            ("[MSG:Pgm End]", "message"),
            ("$0=10", "message"),
        ] {
            assert_eq!(code(line), expected);
            assert_eq!(Grbl.check_reply(expected), Ok(()));
        }
        assert!(Grbl.check_reply("fine").is_err() && Grbl.check_reply("ok 1").is_err());
    }

    #[test]
    fn a_text_is_its_bytes() {
        assert_eq!(Grbl.bytes("?\u{18}\u{85}G0\n"), Ok(b"?\x18\x85G0\n".to_vec()));
        assert!(Grbl.bytes("\u{2192}").is_err());
    }
}
