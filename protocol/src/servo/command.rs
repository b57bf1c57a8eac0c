//! What the PC tells the controller, and how the controller takes it apart.

use core::fmt;

use super::{GAP, INCREMENTS_MAX, PAUSE};
use crate::clock::Clock;
use crate::time::{Instant, Span};
use crate::uart::Character;

const LINK: u8 = b'C';
const SET_KX: u8 = b'X';
const GET_KX: u8 = b'x';
const SET_KV: u8 = b'V';
const GET_KV: u8 = b'v';
const DOWNLOAD: u8 = b'D';
const RUN: u8 = b'R';
const STOP: u8 = b'S';
const HOME: u8 = b'H';
/// Bytes of a download before its increments.
const HEAD: usize = 3;

/// A command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Command {
    /// Is somebody there?
    Link,
    /// Kx, in sixteenths of a drive's LSB per count: 0 to 255.
    SetKx(u8),
    /// What is Kx?
    GetKx,
    /// Kv, in sixteenths of a drive's LSB per count a tick: 0 to 255.
    SetKv(u8),
    /// What is Kv?
    GetKv,
    /// A program: increments of the set point, in counts a tick. At most [`INCREMENTS_MAX`].
    Download(Vec<i8>),
    /// Execute it.
    Run,
    /// Hold the axis at the set point as it is.
    Stop,
    /// Where the axis is is 0.
    Home,
}

/// What is wrong with what has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flaw {
    /// A byte that begins no command.
    Unknown(u8),
    /// The line has been silent in mid-command. `true`: it was a download.
    CutShort(bool),
    /// Something follows too soon on a download.
    Overlong,
    /// A character with a line error. `true`: in a download.
    LineError(bool),
}

impl Command {
    /// The bytes on the wire. Of a download, no more than [`INCREMENTS_MAX`] increments.
    pub fn emit(&self) -> Vec<u8> {
        match self {
            Self::Link => vec![LINK],
            Self::SetKx(value) => vec![SET_KX, *value],
            Self::GetKx => vec![GET_KX],
            Self::SetKv(value) => vec![SET_KV, *value],
            Self::GetKv => vec![GET_KV],
            Self::Download(increments) => {
                let increments = &increments[..increments.len().min(INCREMENTS_MAX)];
                let [low, high] = (increments.len() as u16).to_le_bytes();
                [DOWNLOAD, low, high].into_iter().chain(increments.iter().map(|dx| *dx as u8)).collect()
            }
            Self::Run => vec![RUN],
            Self::Stop => vec![STOP],
            Self::Home => vec![HOME],
        }
    }

    /// The command that is complete with these bytes.
    fn parse(bytes: &[u8]) -> Parsed {
        match *bytes {
            [LINK] => Parsed::Complete(Self::Link),
            [GET_KX] => Parsed::Complete(Self::GetKx),
            [GET_KV] => Parsed::Complete(Self::GetKv),
            [RUN] => Parsed::Complete(Self::Run),
            [STOP] => Parsed::Complete(Self::Stop),
            [HOME] => Parsed::Complete(Self::Home),
            [SET_KX, value] => Parsed::Complete(Self::SetKx(value)),
            [SET_KV, value] => Parsed::Complete(Self::SetKv(value)),
            [DOWNLOAD, low, high, ref increments @ ..]
                if increments.len() >= usize::from(u16::from_le_bytes([low, high])) =>
            {
                Parsed::Complete(Self::Download(increments.iter().map(|byte| *byte as i8).collect()))
            }
            [SET_KX | SET_KV | DOWNLOAD, ..] | [] => Parsed::Part,
            [byte, ..] => Parsed::None(byte),
        }
    }
}

enum Parsed {
    Complete(Command),
    Part,
    None(u8),
}

impl fmt::Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Link => write!(f, "is somebody there?"),
            Self::SetKx(value) => write!(f, "Kx is {value}"),
            Self::GetKx => write!(f, "what is Kx?"),
            Self::SetKv(value) => write!(f, "Kv is {value}"),
            Self::GetKv => write!(f, "what is Kv?"),
            Self::Download(increments) => {
                let way: i64 = increments.iter().map(|dx| i64::from(*dx)).sum();
                write!(f, "a program of {} increments, {way:+} counts", increments.len())
            }
            Self::Run => write!(f, "run"),
            Self::Stop => write!(f, "stop"),
            Self::Home => write!(f, "here is 0"),
        }
    }
}

impl fmt::Display for Flaw {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown(byte) => write!(f, "{byte:02X} begins no command"),
            Self::CutShort(true) => write!(f, "a download is cut short"),
            Self::CutShort(false) => write!(f, "a command is cut short"),
            Self::Overlong => write!(f, "a download goes on behind its end"),
            Self::LineError(true) => write!(f, "line error in a download"),
            Self::LineError(false) => write!(f, "line error"),
        }
    }
}

/// Takes the PC's characters apart, by their bytes and by the silences between them.
#[derive(Clone, Debug)]
pub struct CommandDecoder {
    gap: Span,
    pause: Span,
    pending: Vec<u8>,
    last: Instant,
    /// Something was wrong: until the line has been silent, nothing is a command.
    discarding: bool,
}

/// What has come: a command, or what is wrong.
pub type Received = Result<Command, Flaw>;

impl CommandDecoder {
    /// A decoder that measures silences with `clock`.
    pub fn new(clock: Clock) -> Self {
        let (gap, pause) = (clock.span(GAP), clock.span(PAUSE));
        Self { gap, pause, pending: Vec::new(), last: Instant::START, discarding: false }
    }

    /// Measures with `clock` from now on.
    pub fn retune(&mut self, clock: Clock) {
        (self.gap, self.pause) = (clock.span(GAP), clock.span(PAUSE));
    }

    /// Takes a character; gives what is complete with it. Silences that end with it are to be told before, by
    /// [`CommandDecoder::handle_timeout`].
    pub fn push(&mut self, now: Instant, character: Character) -> Option<Received> {
        self.last = now;
        let Some(byte) = character.ok() else {
            let told = (!self.discarding).then_some(Err(Flaw::LineError(self.is_download())));
            self.discard();
            return told;
        };
        if self.discarding {
            return (byte == STOP).then_some(Ok(Command::Stop));
        }
        if self.is_whole_download() {
            self.discard();
            return Some(Err(Flaw::Overlong));
        }
        self.pending.push(byte);
        if self.is_download() {
            return None;
        }
        let heard = match Command::parse(&self.pending) {
            Parsed::Part => return None,
            Parsed::Complete(command) => Ok(command),
            Parsed::None(byte) => Err(Flaw::Unknown(byte)),
        };
        self.pending.clear();
        Some(heard)
    }

    /// When the silence will tell something.
    pub fn poll_timeout(&self) -> Option<Instant> {
        if self.is_whole_download() {
            return Some(self.last + self.pause);
        }
        (self.discarding || !self.pending.is_empty()).then(|| self.last + self.gap)
    }

    /// What the silence up to `now` tells.
    pub fn handle_timeout(&mut self, now: Instant) -> Option<Received> {
        if self.poll_timeout().is_none_or(|at| at > now) {
            return None;
        }
        self.discarding = false;
        let pending = core::mem::take(&mut self.pending);
        match Command::parse(&pending) {
            Parsed::Complete(command) => Some(Ok(command)),
            Parsed::Part | Parsed::None(_) if pending.is_empty() => None,
            Parsed::Part | Parsed::None(_) => Some(Err(Flaw::CutShort(pending[0] == DOWNLOAD))),
        }
    }

    fn discard(&mut self) {
        self.pending.clear();
        self.discarding = true;
    }

    fn is_download(&self) -> bool {
        self.pending.first() == Some(&DOWNLOAD)
    }

    fn is_whole_download(&self) -> bool {
        match self.pending[..] {
            [DOWNLOAD, low, high, ..] => self.pending.len() - HEAD >= usize::from(u16::from_le_bytes([low, high])),
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::CHARACTER;
    use super::*;

    /// What is heard of bytes that follow one another without a gap; `None` is a silence of 60 ms.
    fn heard(bytes: &[Option<u8>]) -> Vec<Received> {
        let mut decoder = CommandDecoder::new(Clock::TRUE);
        let mut now = Instant::START;
        let mut heard = Vec::new();
        for byte in bytes {
            now += if byte.is_some() { CHARACTER } else { Span::from_millis(60) };
            heard.extend(decoder.handle_timeout(now));
            heard.extend(byte.and_then(|byte| decoder.push(now, Character::good(byte))));
        }
        heard.extend(decoder.handle_timeout(now + Span::from_secs(1)));
        heard
    }

    fn said(bytes: &[u8]) -> Vec<Option<u8>> {
        bytes.iter().copied().map(Some).collect()
    }

    #[test]
    fn commands_are_one_byte_or_have_a_value() {
        let found = heard(&said(b"CX\x14xV\xc3vRSH"));
        let expected =
            [Command::Link, Command::SetKx(20), Command::GetKx, Command::SetKv(195), Command::GetKv, Command::Run];
        let expected = expected.into_iter().chain([Command::Stop, Command::Home]).map(Ok);
        assert_eq!(found, expected.collect::<Vec<_>>());
        assert_eq!(heard(&said(b"q")), [Err(Flaw::Unknown(b'q'))]);
    }

    #[test]
    fn a_download_is_taken_when_the_line_falls_silent_behind_it() {
        let download = said(b"D\x02\x00\x03\xfe");
        assert_eq!(heard(&download), [Ok(Command::Download(vec![3, -2]))]);
        // A byte of it is lost; another follows that was not counted.
        assert_eq!(heard(&download[..4]), [Err(Flaw::CutShort(true))]);
        let more = [&download[..], &said(b"RR"), &[None], &said(b"C")].concat();
        assert_eq!(heard(&more), [Err(Flaw::Overlong), Ok(Command::Link)]);
        // An increment can look like a stop.
        assert_eq!(heard(&said(b"D\x01\x00S")), [Ok(Command::Download(vec![83]))]);
        assert_eq!(heard(&said(b"D\x00\x00")), [Ok(Command::Download(vec![]))]);
    }

    #[test]
    fn a_silence_cuts_a_command_short() {
        let cut = [&said(b"X")[..], &[None], &said(b"x")].concat();
        assert_eq!(heard(&cut), [Err(Flaw::CutShort(false)), Ok(Command::GetKx)]);
    }

    #[test]
    fn after_a_line_error_only_a_stop_is_obeyed_until_the_line_is_silent() {
        let mut decoder = CommandDecoder::new(Clock::TRUE);
        let bad = Character { byte: b'R', framing_error: true, overrun: false };
        assert_eq!(decoder.push(Instant::START, bad), Some(Err(Flaw::LineError(false))));
        let at = Instant::START + CHARACTER;
        assert_eq!(decoder.push(at, bad), None);
        assert_eq!(decoder.push(at, Character::good(b'R')), None);
        assert_eq!(decoder.push(at, Character::good(b'S')), Some(Ok(Command::Stop)));
        assert_eq!(decoder.handle_timeout(at + GAP), None);
        assert_eq!(decoder.push(at + GAP, Character::good(b'R')), Some(Ok(Command::Run)));
    }

    #[test]
    fn each_command_has_bytes_and_words() {
        for (command, bytes, words) in [
            (Command::Link, &b"C"[..], "is somebody there?"),
            (Command::SetKx(7), b"X\x07", "Kx is 7"),
            (Command::GetKx, b"x", "what is Kx?"),
            (Command::SetKv(200), b"V\xc8", "Kv is 200"),
            (Command::GetKv, b"v", "what is Kv?"),
            (Command::Download(vec![3, -5]), b"D\x02\x00\x03\xfb", "a program of 2 increments, -2 counts"),
            (Command::Run, b"R", "run"),
            (Command::Stop, b"S", "stop"),
            (Command::Home, b"H", "here is 0"),
        ] {
            assert_eq!((&command.emit()[..], command.to_string()), (bytes, words.to_owned()));
            assert_eq!(heard(&said(bytes)), [Ok(command)]);
        }
        let long = Command::Download(vec![1; INCREMENTS_MAX + 1]).emit();
        assert_eq!((long.len(), &long[..3]), (3 + INCREMENTS_MAX, &b"D\xff\xff"[..]));
    }

    #[test]
    fn each_flaw_has_words() {
        let flaws = [
            (Flaw::Unknown(0x0a), "0A begins no command"),
            (Flaw::CutShort(true), "a download is cut short"),
            (Flaw::CutShort(false), "a command is cut short"),
            (Flaw::Overlong, "a download goes on behind its end"),
            (Flaw::LineError(true), "line error in a download"),
            (Flaw::LineError(false), "line error"),
        ];
        flaws.iter().for_each(|(flaw, words)| assert_eq!(flaw.to_string(), *words));
    }

    #[test]
    fn silences_count_from_the_last_character_and_last_as_long_as_they_must() {
        let at = Instant::from_nanos(1_000_000_000);
        let nanosecond = Span::from_nanos(1);
        for (bytes, silence, told) in [
            (&b"X"[..], GAP, Err(Flaw::CutShort(false))),
            (b"D\x01", GAP, Err(Flaw::CutShort(true))),
            (b"D\x01\x00\x05", PAUSE, Ok(Command::Download(vec![5]))),
        ] {
            let mut decoder = CommandDecoder::new(Clock::TRUE);
            assert_eq!((decoder.poll_timeout(), decoder.handle_timeout(at)), (None, None));
            bytes.iter().for_each(|byte| assert_eq!(decoder.push(at, Character::good(*byte)), None));
            assert_eq!(decoder.poll_timeout(), Some(at + silence));
            assert_eq!(decoder.handle_timeout(at + silence - nanosecond), None);
            assert_eq!(decoder.handle_timeout(at + silence), Some(told));
            assert_eq!((decoder.poll_timeout(), decoder.handle_timeout(at + GAP)), (None, None));
        }
    }

    #[test]
    fn another_clock_measures_other_silences() {
        let mut decoder = CommandDecoder::new(Clock::TRUE);
        decoder.retune(Clock::from_ppb(-200_000_000).unwrap());
        decoder.push(Instant::START, Character::good(b'X'));
        assert_eq!(decoder.poll_timeout(), Some(Instant::from_nanos(62_500_000)));
        decoder.push(Instant::START, Character::good(20));
        b"D\x00\x00".iter().for_each(|byte| _ = decoder.push(Instant::START, Character::good(*byte)));
        assert_eq!(decoder.poll_timeout(), Some(Instant::from_nanos(3_906_247)));
    }

    #[test]
    fn a_line_error_in_a_download_drops_all_of_it_up_to_a_silence() {
        let mut decoder = CommandDecoder::new(Clock::TRUE);
        b"D\x02\x00".iter().for_each(|byte| assert_eq!(decoder.push(Instant::START, Character::good(*byte)), None));
        let bad = Character { overrun: true, ..Character::good(1) };
        assert_eq!(decoder.push(Instant::START, bad), Some(Err(Flaw::LineError(true))));
        assert_eq!(decoder.push(Instant::START, Character::good(b'C')), None);
        assert_eq!(
            (decoder.poll_timeout(), decoder.handle_timeout(Instant::START + GAP)),
            (Some(Instant::START + GAP), None)
        );
        assert_eq!(decoder.push(Instant::START + GAP, Character::good(b'C')), Some(Ok(Command::Link)));
    }

    proptest! {
        #[test]
        fn what_is_emitted_is_heard(increments in prop::collection::vec(any::<i8>(), 0..600), gain: u8) {
            let commands = [Command::SetKx(gain), Command::Download(increments), Command::SetKv(gain), Command::Run];
            let bytes = commands.iter().flat_map(|command| {
                let pause = matches!(command, Command::Download(_)).then_some(None);
                command.emit().into_iter().map(Some).chain(pause)
            });
            let found = heard(&bytes.collect::<Vec<_>>());
            prop_assert_eq!(found, commands.map(Ok).to_vec());
        }

        #[test]
        fn anything_can_be_said(bytes in prop::collection::vec(prop::option::weighted(0.9, any::<u8>()), 0..200)) {
            heard(&bytes);
        }
    }
}
