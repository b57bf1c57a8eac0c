//! The lathe's dialect: frames, the slaves' sub-frames, and replies.
//!
//! Where frames begin is not on the line; it follows from silences, from replies and from which slaves are busy. So the
//! characters of all lines are read together, by the rules of the boards.

use torno_protocol::lathe::{
    ACK, BAUD, BEL, CAN, CHARACTER, DepthSubFrame, ENQ, Fault, Frame, Parity, Party, Program, Refusal, Reply, Slave,
    SpindleSubFrame, TransverseSubFrame,
};
use torno_protocol::layout::{GATEWAY, Layout, LineLayout};
use torno_protocol::time::{Instant, Span};

use torno_bus::{Dialect, LineCharacter, Listener, Message, Reader, Stopwatch, hex, is_stray_byte, no_reply};
use torno_engine::LineId;

use super::cable::{Cable, ExchangeDecoder, Times};

/// The longest time from one character of a slave's sub-frame to the next.
const SUB_FRAME_GAP: Span = CHARACTER.times(3);

/// The lathe's dialect.
#[derive(Debug)]
pub(super) struct Lathe;

impl Dialect for Lathe {
    fn name(&self) -> &'static str {
        "lathe"
    }

    fn baud(&self) -> u32 {
        BAUD
    }

    fn holds_the_pc(&self) -> bool {
        true
    }

    fn check_reply(&self, code: &str) -> Result<(), String> {
        let words = ["ACK", "XOFF", "XON", "NAK", "CAN"];
        let parties = || Slave::ALL.map(Party::Slave).into_iter().chain([Party::Master]);
        let failures = parties().flat_map(|party| Fault::ALL.map(|fault| Reply::Can(party, fault)));
        let lettered: Vec<String> = Refusal::ALL.map(Reply::Nak).into_iter().chain(failures).map(Reply::code).collect();
        if words.contains(&code) || is_stray_byte(code) || lettered.iter().any(|known| known == code) {
            return Ok(());
        }
        // Of the many with letters, those that begin alike.
        let word = code.split(' ').next().unwrap_or_default();
        let alike = lettered.iter().map(String::as_str).filter(|known| known.split(' ').next() == Some(word));
        let alike: Vec<&str> = alike.collect();
        Err(no_reply(code, if alike.is_empty() { &words } else { &alike }))
    }

    fn listener(&self) -> Box<dyn Listener> {
        Box::new(Cable(ExchangeDecoder::new()))
    }

    fn reader(&self, layout: &Layout) -> Box<dyn Reader> {
        Box::new(Lines::new(layout))
    }

    fn stopwatch(&self) -> Option<Box<dyn Stopwatch>> {
        Some(Box::new(Times::new()))
    }

    fn bytes(&self, text: &str) -> Result<Vec<u8>, String> {
        Program::parse(text).map(|program| program.bytes()).map_err(|error| error.to_string())
    }

    fn player(&self) -> &'static str {
        "torno run"
    }

    fn player_at_port(&self) -> Option<&'static str> {
        Some("torno send")
    }
}

/// What a line is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Role {
    Frames,
    Replies,
    SubFrames(Slave),
    Answers(Slave),
    Unknown,
}

fn slave(kind: &str) -> Option<Slave> {
    Slave::ALL.into_iter().find(|slave| slave.name() == kind)
}

/// Reads the characters of all lines together.
#[derive(Clone, Debug)]
struct Lines {
    roles: Vec<Role>,
    talk: ExchangeDecoder,
    /// The line on which the PC sends, and when its last character came.
    pc: (LineId, Instant),
    slaves: [Conversation; 3],
    messages: Vec<Message>,
}

#[derive(Clone, Debug, Default)]
struct Partial {
    line: LineId,
    bytes: Vec<u8>,
    last: Instant,
}

#[derive(Clone, Debug, Default)]
struct Conversation {
    sub_frame: Partial,
    busy: bool,
    /// It has been given a sub-frame.
    given: bool,
    /// `ACK` or `CAN` has come, its letter has not.
    awaiting: Option<u8>,
}

impl Lines {
    /// Reads a rig's lines from the start.
    fn new(layout: &Layout) -> Self {
        let kind = |board: usize| layout.boards[board].kind.as_str();
        // The slave that belongs at this port of a master, whoever is there.
        let place = |(board, port): (usize, u8)| {
            let ports = &layout.boards[board].description.ports;
            let port = ports.get(usize::from(port)).filter(|_| kind(board) == "master");
            port.and_then(|name| slave(name))
        };
        let role = |line: &LineLayout| match (kind(line.from.0), kind(line.to.0)) {
            (GATEWAY, "master") if place(line.to).is_some() => place(line.to).map_or(Role::Unknown, Role::Answers),
            ("master", GATEWAY) if place(line.from).is_some() => {
                place(line.from).map_or(Role::Unknown, Role::SubFrames)
            }
            // A controller takes the PC's place.
            (GATEWAY | "grbl", _) => Role::Frames,
            (_, GATEWAY | "grbl") => Role::Replies,
            ("master", to) => slave(to).map_or(Role::Unknown, Role::SubFrames),
            (from, "master") => slave(from).map_or(Role::Unknown, Role::Answers),
            _ => Role::Unknown,
        };
        let roles: Vec<Role> = layout.lines.iter().map(role).collect();
        let pc = roles.iter().position(|role| *role == Role::Frames).unwrap_or_default();
        let slaves = Default::default();
        Self { roles, talk: ExchangeDecoder::new(), pc: (pc, Instant::START), slaves, messages: Vec::new() }
    }

    fn tell(&mut self, at: Instant, line: LineId, text: String, flaw: bool) {
        self.messages.push(Message { at, line, text, flaw });
    }

    fn hear_silence(&mut self, at: Instant) {
        if let Some(bytes) = self.talk.silence(at) {
            self.tell_cut_short(bytes);
        }
    }

    fn tell_cut_short(&mut self, bytes: usize) {
        let (line, last) = self.pc;
        self.tell(last, line, format!("frame cut short after {bytes} of {} bytes", Frame::LENGTH), true);
    }

    fn hear_pc(&mut self, heard: &LineCharacter) {
        self.pc.1 = heard.at;
        let Some(bytes) = self.talk.pc(heard.at, heard.character) else { return };
        let (text, flaw) = match Frame::parse(bytes) {
            Ok(frame) => (format!("frame: {}", frame_text(&frame)), false),
            Err(refusal) => (format!("frame out of range ({refusal}): {}", hex(&bytes)), true),
        };
        self.tell(heard.at, heard.line, text, flaw);
    }

    fn hear_reply(&mut self, heard: &LineCharacter) {
        let Some(byte) = heard.character.ok() else { return };
        for reply in self.talk.master(heard.at, byte) {
            let (text, flaw) = match reply {
                Reply::Ack => ("ACK: the frame has been distributed".to_owned(), false),
                Reply::Xoff => ("XOFF: a frame is held".to_owned(), false),
                Reply::Xon => ("XON: all slaves are done".to_owned(), false),
                Reply::Nak(refusal) => (format!("NAK: a frame is refused ({refusal})"), true),
                Reply::Can(party, fault) => (format!("CAN: {} failed ({fault})", party.name()), true),
                Reply::Unknown(byte) => (format!("{byte:02X} is no reply"), true),
            };
            self.tell(heard.at, heard.line, text, flaw);
        }
    }

    fn hear_sub_frame(&mut self, heard: &LineCharacter, slave: Slave) {
        let length = sub_frame_length(slave);
        let conversation = &self.slaves[slave as usize];
        if heard.at.since(conversation.sub_frame.last) > SUB_FRAME_GAP {
            self.end_sub_frame(slave);
        }
        let conversation = &mut self.slaves[slave as usize];
        conversation.sub_frame.line = heard.line;
        conversation.sub_frame.last = heard.at;
        let Some(byte) = heard.character.ok() else {
            conversation.sub_frame.bytes.clear();
            return;
        };
        if byte == ENQ && (length == 1 || conversation.busy) {
            self.tell(heard.at, heard.line, "ENQ: how is it going?".to_owned(), false);
            return;
        }
        conversation.sub_frame.bytes.push(byte);
        if conversation.sub_frame.bytes.len() == length {
            let bytes = core::mem::take(&mut conversation.sub_frame.bytes);
            (conversation.busy, conversation.given) = (true, true);
            let (text, flaw) = sub_frame_text(slave, &bytes);
            self.tell(heard.at, heard.line, text, flaw);
        }
    }

    /// The slave's line has been silent: what has come of a sub-frame is all.
    fn end_sub_frame(&mut self, slave: Slave) {
        let Partial { line, bytes, last } = core::mem::take(&mut self.slaves[slave as usize].sub_frame);
        match bytes[..] {
            [] => {}
            [ENQ] => self.tell(last, line, "ENQ: how is it going?".to_owned(), false),
            _ => {
                let (count, length) = (bytes.len(), sub_frame_length(slave));
                self.tell(last, line, format!("sub-frame cut short after {count} of {length} bytes"), true);
            }
        }
    }

    fn hear_answer(&mut self, heard: &LineCharacter, slave: Slave) {
        if self.slaves[slave as usize].sub_frame.bytes == [ENQ] {
            self.end_sub_frame(slave);
        }
        let conversation = &mut self.slaves[slave as usize];
        let begun = conversation.awaiting.take();
        let done = |parity| (format!("ACK: done ({parity})"), false);
        // Whoever has been given nothing has lost nothing.
        let failed = |fault| match fault {
            Fault::Restarted if !conversation.given => ("CAN: started".to_owned(), false),
            fault => (format!("CAN: failed ({fault})"), true),
        };
        let told = match (begun, heard.character.ok()) {
            (Some(ACK), Some(letter)) => Parity::from_letter(letter).map(done),
            (Some(CAN), Some(letter)) => Fault::from_letter(letter).map(failed),
            _ => None,
        };
        let Some((text, flaw)) = told else { return self.begin_answer(heard, slave, begun) };
        conversation.busy = false;
        self.tell(heard.at, heard.line, text, flaw);
    }

    /// What follows on an answer that is complete, or on one that has `begun` and is broken.
    fn begin_answer(&mut self, heard: &LineCharacter, slave: Slave, begun: Option<u8>) {
        let no_answer = |byte: u8| (format!("{byte:02X} is no answer"), true);
        if let Some(byte) = begun {
            let (text, flaw) = no_answer(byte);
            self.tell(heard.at, heard.line, text, flaw);
        }
        let conversation = &mut self.slaves[slave as usize];
        let (text, flaw) = match heard.character.ok() {
            None => return,
            Some(byte @ (ACK | CAN)) => {
                conversation.awaiting = Some(byte);
                return;
            }
            Some(BEL) => {
                conversation.busy = true;
                ("BEL: busy".to_owned(), false)
            }
            Some(byte) => no_answer(byte),
        };
        self.tell(heard.at, heard.line, text, flaw);
    }
}

impl Reader for Lines {
    fn hear(&mut self, characters: &[LineCharacter]) {
        for heard in characters {
            self.hear_silence(heard.at);
            match self.roles[heard.line] {
                Role::Frames => self.hear_pc(heard),
                Role::Replies => self.hear_reply(heard),
                Role::SubFrames(slave) => self.hear_sub_frame(heard, slave),
                Role::Answers(slave) => self.hear_answer(heard, slave),
                Role::Unknown => {}
            }
        }
    }

    fn take(&mut self) -> Vec<Message> {
        let mut messages = core::mem::take(&mut self.messages);
        messages.sort_by_key(|message| message.at);
        messages
    }

    fn end(&mut self) {
        if self.talk.unfinished() > 0 {
            self.tell_cut_short(self.talk.unfinished());
        }
        Slave::ALL.into_iter().for_each(|slave| self.end_sub_frame(slave));
    }
}

const fn sub_frame_length(slave: Slave) -> usize {
    match slave {
        Slave::Spindle => SpindleSubFrame::LENGTH,
        Slave::Transverse => TransverseSubFrame::LENGTH,
        Slave::Depth => DepthSubFrame::LENGTH,
    }
}

fn sub_frame_text(slave: Slave, bytes: &[u8]) -> (String, bool) {
    let text = match (slave, bytes) {
        (Slave::Spindle, [a]) => SpindleSubFrame::parse([*a]).map(spindle_text),
        (Slave::Transverse, [a, b, c, d]) => TransverseSubFrame::parse([*a, *b, *c, *d]).map(transverse_text),
        (Slave::Depth, [a, b, c]) => DepthSubFrame::parse([*a, *b, *c]).map(depth_text),
        _ => Err(Refusal::CutShort),
    };
    match text {
        Ok(text) => (format!("sub-frame: {text}"), false),
        Err(refusal) => (format!("sub-frame out of range ({refusal}): {}", hex(bytes)), true),
    }
}

fn frame_text(frame: &Frame) -> String {
    format!("{}, {}, {}", spindle_text(frame.spindle), transverse_text(frame.transverse), depth_text(frame.depth))
}

fn spindle_text(sub_frame: SpindleSubFrame) -> String {
    format!("spindle {} rpm", sub_frame.rpm())
}

fn transverse_text(sub_frame: TransverseSubFrame) -> String {
    match i64::from(sub_frame.distance()) * sub_frame.direction().sign() {
        0 => "transverse stays".to_owned(),
        counts => format!("transverse {counts:+} counts at {} per 30 ms", sub_frame.speed()),
    }
}

fn depth_text(sub_frame: DepthSubFrame) -> String {
    match i64::from(sub_frame.distance()) * sub_frame.direction().sign() {
        0 => "depth stays".to_owned(),
        slots => format!("depth {slots:+} slots"),
    }
}

#[cfg(test)]
mod tests {
    use torno_bus::Readers;
    use torno_protocol::lathe::{XOFF, XON};
    use torno_protocol::uart::Character;

    use super::*;
    use crate::testing::layout;

    /// What is said by characters on lines, a character time apart; `None` is a silence of 60 ms.
    fn said(characters: &[Option<(&str, u8)>]) -> Vec<String> {
        let slaves = ["spindle", "transverse", "depth"];
        let layout = layout("lathe", &[("pc", "master")], &slaves.map(|slave| ("master", slave)));
        let mut at = Instant::START;
        let mut heard = Vec::new();
        for character in characters {
            at += if character.is_some() { CHARACTER } else { Span::from_millis(60) };
            if let Some((line, byte)) = character {
                let line = layout.line(line).unwrap();
                heard.push(LineCharacter { at, line, character: Character::good(*byte) });
            }
        }
        Readers::new(&layout, crate::dialect).messages(&heard).into_iter().map(|message| message.text).collect()
    }

    fn on<'a>(line: &'a str, bytes: &[u8]) -> Vec<Option<(&'a str, u8)>> {
        bytes.iter().map(|byte| Some((line, *byte))).collect()
    }

    #[test]
    fn silence_in_mid_frame_cuts_it_short_unless_the_pc_is_held() {
        let begun = on("pc_to_master", &[0x0a, 0xe1, 0x00]);
        let rest = on("pc_to_master", &[0xe1, 0x01, 0x00, 0x01, 0x00]);
        let frame = "frame: spindle 200 rpm, transverse -225 counts at 225 per 30 ms, depth +1 slots";
        assert_eq!(said(&[&begun[..], &rest].concat()), [frame]);
        let cut = said(&[&begun[..], &[None], &rest].concat());
        assert_eq!(cut, ["frame cut short after 3 of 8 bytes", "frame cut short after 5 of 8 bytes"]);
        let stop = on("master_to_pc", &[XOFF]);
        let held = said(&[&stop[..], &begun[..2], &[None], &on("master_to_pc", &[XON]), &begun[2..], &rest].concat());
        assert_eq!(held, ["XOFF: a frame is held", "XON: all slaves are done", frame]);
        // A PC that has stopped, or should have, is silent on its own account.
        let late = said(&[&stop[..], &[None], &begun, &[None], &on("master_to_pc", &[XON]), &rest].concat());
        assert_eq!(late[1], "frame cut short after 3 of 8 bytes");
    }

    #[test]
    fn a_sub_frame_may_begin_with_the_byte_of_an_enquiry() {
        let line = "master_to_transverse";
        let sub_frame = said(&[&on(line, &[ENQ, 0, 9, 1])[..], &[None], &on(line, &[ENQ])].concat());
        assert_eq!(sub_frame, ["sub-frame: transverse -9 counts at 5 per 30 ms", "ENQ: how is it going?"]);
        let idle = said(&[&on(line, &[ENQ])[..], &[None], &on(line, &[5, 0, 9, 0])].concat());
        assert_eq!(idle, ["ENQ: how is it going?", "sub-frame: transverse +9 counts at 5 per 30 ms"]);
        let answers = said(&on("transverse_to_master", &[BEL, CAN, b'e', ACK, b'e', ACK, b'x']));
        let expected = ["BEL: busy", "CAN: failed (end of travel)", "ACK: done (even)", "06 is no answer"];
        assert_eq!(answers, [&expected[..], &["78 is no answer"]].concat());
    }

    #[test]
    fn what_comes_after_a_failure_is_no_frame_until_the_pc_has_been_silent() {
        let frame = on("pc_to_master", &[0; 8]);
        let failure = on("master_to_pc", b"\x18dn");
        let said = said(&[&failure[..], &frame, &[None], &frame].concat());
        assert_eq!(said, ["CAN: depth failed (no answer)", "frame: spindle 0 rpm, transverse stays, depth stays"]);
    }
}
