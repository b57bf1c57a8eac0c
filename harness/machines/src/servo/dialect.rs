//! The servo stand's dialect: commands, answers and the following error.

use std::collections::VecDeque;

use torno_bus::{Dialect, LineCharacter, Listener, Message, Reader, Reply, is_stray_byte, no_reply};
use torno_protocol::clock::Clock;
use torno_protocol::layout::Layout;
use torno_protocol::servo::{BAUD, Command, CommandDecoder, PRESENT, Received, TICK, shown};
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::Character;
use torno_servo::{Language, Limits, compile};

/// A run whose telemetry has been silent for so long is over, whatever its program says.
const RUN_OVER: Span = TICK.times(5);

/// The servo stand's dialect.
#[derive(Debug)]
pub(super) struct Servo;

impl Dialect for Servo {
    fn name(&self) -> &'static str {
        "servo"
    }

    fn baud(&self) -> u32 {
        BAUD
    }

    fn holds_the_pc(&self) -> bool {
        false
    }

    fn check_reply(&self, code: &str) -> Result<(), String> {
        let values = [("LINK", None), ("KX", Some(0..=255)), ("KV", Some(0..=255)), ("ERROR", Some(-128..=127))];
        let (word, value) = code.split_once(' ').map_or((code, None), |(word, value)| (word, Some(value)));
        match (values.iter().find(|(known, _)| *known == word), value) {
            (None, None) if is_stray_byte(code) => Ok(()),
            (None, _) => Err(no_reply(word, &values.each_ref().map(|(known, _)| *known))),
            (Some(_), None) => Ok(()),
            (Some((_, Some(values))), Some(value)) => match value.parse::<i64>() {
                Ok(value) if values.contains(&value) => Ok(()),
                _ => Err(format!("'{code}': expected {word} alone, or a value {} to {}", values.start(), values.end())),
            },
            (Some((_, None)), Some(_)) => Err(format!("'{code}': expected {word} alone")),
        }
    }

    fn listener(&self) -> Box<dyn Listener> {
        Box::new(ExchangeDecoder::new())
    }

    fn reader(&self, layout: &Layout) -> Box<dyn Reader> {
        Box::new(Lines::new(layout))
    }

    /// The letter of a command, and its value or its program: `C`, `X 20`, `D x10 t2; e`.
    fn bytes(&self, text: &str) -> Result<Vec<u8>, String> {
        let (letter, rest) = text.trim().split_once(char::is_whitespace).unwrap_or((text.trim(), ""));
        let value = || rest.trim().parse().map_err(|_| format!("{letter} '{rest}': expected a value from 0 to 255"));
        let command = match letter {
            "C" => Command::Link,
            "X" => Command::SetKx(value()?),
            "x" => Command::GetKx,
            "V" => Command::SetKv(value()?),
            "v" => Command::GetKv,
            "D" => Command::Download(increments(rest)?),
            "R" => Command::Run,
            "S" => Command::Stop,
            "H" => Command::Home,
            _ => return Err(format!("there is no command '{letter}': expected one of C, X, x, V, v, D, R, S, H")),
        };
        Ok(command.emit())
    }

    fn player(&self) -> &'static str {
        "torno servo run"
    }

    fn player_at_port(&self) -> Option<&'static str> {
        Some("torno servo run")
    }
}

fn increments(text: &str) -> Result<Vec<i8>, String> {
    let limits = Limits::default();
    let compiled = compile(&text.replace(';', "\n"), &limits);
    match (compiled.program, compiled.findings.first()) {
        (Some(program), _) => Ok(program.increments(limits.counts_per_mm)),
        (None, Some(finding)) => Err(finding.message(Language::English)),
        (None, None) => Err("expected a program".to_owned()),
    }
}

/// What is said between the PC and the controller.
#[derive(Clone, Debug)]
struct ExchangeDecoder {
    commands: CommandDecoder,
    /// The increments of the program that the controller has been given.
    program: usize,
    /// The bytes of telemetry that are still to come, and when the last one came.
    to_come: usize,
    last: Instant,
    questions: VecDeque<Command>,
}

/// What the controller says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Answer {
    Present,
    Kx(u8),
    Kv(u8),
    Error(i8),
    Unknown(u8),
}

impl ExchangeDecoder {
    fn new() -> Self {
        let commands = CommandDecoder::new(Clock::TRUE);
        Self { commands, program: 0, to_come: 0, last: Instant::START, questions: VecDeque::new() }
    }

    /// A character from the PC.
    fn pc(&mut self, at: Instant, character: Character) -> Vec<Received> {
        let mut said = self.silence(at);
        let more = self.commands.push(at, character);
        more.iter().for_each(|said| self.understand(at, said));
        said.extend(more);
        said
    }

    /// What the PC's silence up to `at` completes.
    fn silence(&mut self, at: Instant) -> Vec<Received> {
        let said: Vec<Received> = self.commands.handle_timeout(at).into_iter().collect();
        said.iter().for_each(|said| self.understand(at, said));
        said
    }

    fn understand(&mut self, at: Instant, said: &Received) {
        if self.is_running(at) {
            if *said == Ok(Command::Stop) {
                self.to_come = 0;
            }
            return;
        }
        match said {
            Ok(Command::Download(increments)) => self.program = increments.len(),
            Ok(Command::Run) => (self.to_come, self.last) = (self.program, at),
            Ok(question @ (Command::Link | Command::GetKx | Command::GetKv)) => {
                self.questions.push_back(question.clone());
            }
            _ => {}
        }
    }

    fn is_running(&mut self, at: Instant) -> bool {
        if at.since(self.last) > RUN_OVER {
            self.to_come = 0;
        }
        self.to_come > 0
    }

    /// A byte from the controller.
    fn controller(&mut self, at: Instant, byte: u8) -> Answer {
        if self.is_running(at) {
            self.to_come -= 1;
            self.last = at;
            return Answer::Error(shown(byte));
        }
        match self.questions.pop_front() {
            Some(Command::Link) if byte == PRESENT => Answer::Present,
            Some(Command::GetKx) => Answer::Kx(byte),
            Some(Command::GetKv) => Answer::Kv(byte),
            _ => Answer::Unknown(byte),
        }
    }
}

impl Answer {
    fn code(self) -> String {
        match self {
            Self::Present => "LINK".to_owned(),
            Self::Kx(value) => format!("KX {value}"),
            Self::Kv(value) => format!("KV {value}"),
            Self::Error(counts) => format!("ERROR {counts}"),
            Self::Unknown(byte) => format!("?{byte:02X}"),
        }
    }

    fn text(self) -> String {
        match self {
            Self::Present => "the controller is there".to_owned(),
            Self::Kx(value) => format!("Kx is {value}"),
            Self::Kv(value) => format!("Kv is {value}"),
            Self::Error(counts) => format!("following error {counts:+}"),
            Self::Unknown(byte) => format!("{byte:02X} is no answer"),
        }
    }
}

impl Listener for ExchangeDecoder {
    fn sent(&mut self, at: Instant, byte: u8) -> Vec<String> {
        let said = self.pc(at, Character::good(byte));
        said.into_iter().map(|said| said.map_or_else(|flaw| flaw.to_string(), |command| command.to_string())).collect()
    }

    fn received(&mut self, at: Instant, byte: u8) -> Vec<Reply> {
        self.silence(at);
        let answer = self.controller(at, byte);
        vec![Reply { code: answer.code(), text: answer.text() }]
    }
}

/// Reads the two lines of the stand.
#[derive(Clone, Debug)]
struct Lines {
    /// For each line, whether the PC sends on it.
    from_pc: Vec<bool>,
    talk: ExchangeDecoder,
    /// The line on which the PC sends.
    line: usize,
    last: Instant,
    messages: Vec<Message>,
}

impl Lines {
    fn new(layout: &Layout) -> Self {
        let from_pc: Vec<bool> = layout.lines.iter().map(|line| layout.sends_outside(line)).collect();
        let line = from_pc.iter().position(|from_pc| *from_pc).unwrap_or_default();
        Self { from_pc, talk: ExchangeDecoder::new(), line, last: Instant::START, messages: Vec::new() }
    }

    fn tell(&mut self, at: Instant, said: Vec<Received>) {
        let message = |said: Received| {
            let (text, flaw) = match said {
                Ok(command) => (command.to_string(), false),
                Err(flaw) => (flaw.to_string(), true),
            };
            Message { at, line: self.line, text, flaw }
        };
        self.messages.extend(said.into_iter().map(message));
    }
}

impl Reader for Lines {
    fn hear(&mut self, characters: &[LineCharacter]) {
        for heard in characters {
            // A download is complete with the silence behind it; it is told where it ended.
            let said = self.talk.silence(heard.at);
            self.tell(self.last, said);
            if self.from_pc[heard.line] {
                self.last = heard.at;
                let said = self.talk.pc(heard.at, heard.character);
                self.tell(heard.at, said);
            } else if let Some(byte) = heard.character.ok() {
                let answer = self.talk.controller(heard.at, byte);
                let flaw = matches!(answer, Answer::Unknown(_));
                self.messages.push(Message { at: heard.at, line: heard.line, text: answer.text(), flaw });
            }
        }
    }

    fn end(&mut self) {
        let said = self.talk.silence(Instant::NEVER);
        self.tell(self.last, said);
    }

    fn take(&mut self) -> Vec<Message> {
        let mut messages = core::mem::take(&mut self.messages);
        messages.sort_by_key(|message| message.at);
        messages
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::layout;
    use torno_bus::Readers;

    /// What is read on the two lines: the PC's characters, a silence (`None`), and the controller's.
    fn said(characters: &[Option<(bool, u8)>]) -> Vec<String> {
        let layout = layout("servo", &[("pc", "servo")], &[]);
        let line = |from_pc: bool| usize::from(!from_pc);
        let mut at = Instant::START;
        let mut heard = Vec::new();
        for character in characters {
            at += if character.is_some() { Span::from_millis(1) } else { Span::from_millis(60) };
            let character = character.map(|(from_pc, byte)| (line(from_pc), Character::good(byte)));
            heard.extend(character.map(|(line, character)| LineCharacter { at, line, character }));
        }
        Readers::new(&layout, crate::dialect).messages(&heard).into_iter().map(|message| message.text).collect()
    }

    fn pc(bytes: &[u8]) -> Vec<Option<(bool, u8)>> {
        bytes.iter().map(|byte| Some((true, *byte))).collect()
    }

    fn controller(bytes: &[u8]) -> Vec<Option<(bool, u8)>> {
        bytes.iter().map(|byte| Some((false, *byte))).collect()
    }

    #[test]
    fn a_byte_means_what_was_asked_for_and_an_error_during_motion() {
        let found = said(
            &[
                pc(b"C"),
                controller(b"c"),
                pc(b"x"),
                controller(b"c"),
                pc(b"D\x02\x00\x03\x04"),
                vec![None],
                pc(b"R"),
                controller(b"c\xff"),
                controller(b"c"),
            ]
            .concat(),
        );
        let expected = [
            "is somebody there?",
            "the controller is there",
            "what is Kx?",
            "Kx is 99",
            "a program of 2 increments, +7 counts",
            "run",
            "following error +99",
            "following error -1",
            "63 is no answer",
        ];
        assert_eq!(found, expected);
    }

    #[test]
    fn a_run_that_has_fallen_silent_is_over() {
        let found = said(
            &[
                pc(b"D\x02\x00\x03\x04"),
                vec![None],
                pc(b"R"),
                controller(b"\x03"),
                vec![None],
                pc(b"C"),
                controller(b"c"),
            ]
            .concat(),
        );
        assert_eq!(found[2..], ["following error +3", "is somebody there?", "the controller is there"]);
    }

    #[test]
    fn scenarios_say_the_letter_and_what_belongs_to_it() {
        let bytes = |text: &str| Servo.bytes(text);
        assert_eq!(bytes("X 20"), Ok(vec![b'X', 20]));
        assert_eq!(bytes(" R "), Ok(vec![b'R']));
        assert_eq!(bytes("D x0 t0.01; e"), Ok(vec![b'D', 2, 0, 0, 0]));
        for (text, expected) in [
            ("X 300", "X '300': expected a value from 0 to 255"),
            ("Q", "there is no command 'Q': expected one of C, X, x, V, v, D, R, S, H"),
            ("D x1; e", "line 1 lacks t"),
        ] {
            assert_eq!(bytes(text), Err(expected.to_owned()));
        }
    }
}
