//! The access server of RFC 2217, "Telnet Com Port Control Option", without I/O: bytes in, bytes and requests out.
//!
//! Each request is answered with what is in force after it, whether that is what was asked for or not. What a UART of
//! the rig does not have stays as it is: 1.5 stop bits, flow control by modem lines, speeds that no UART takes.
//! The modem lines of the cable are looped at its end: CTS, DSR and DCD are on, RI is off, and none ever changes.
//!
//! Data are eight bits wide from the first byte, whether the client has agreed on that (RFC 856) or not. Options follow
//! RFC 1143: only what changes something is answered, so no two ends can talk for ever.

mod telnet;

use torno_bus::BAUD;
use torno_protocol::uart::{DataBits, Format, Parity, StopBits};

use super::event::LineCoding;
use telnet::{Decoder, Received, Verb, escaped, sub};

/// Transmit binary (RFC 856).
const BINARY: u8 = 0;
/// Suppress go ahead (RFC 858).
const SGA: u8 = 3;
/// Com port control (RFC 2217).
const COM_PORT: u8 = 44;

/// An answer's command is the request's and this.
const ANSWER: u8 = 100;

const SIGNATURE: u8 = 0;
const SET_BAUDRATE: u8 = 1;
const SET_DATASIZE: u8 = 2;
const SET_PARITY: u8 = 3;
const SET_STOPSIZE: u8 = 4;
const SET_CONTROL: u8 = 5;
const NOTIFY_LINESTATE: u8 = 6;
const NOTIFY_MODEMSTATE: u8 = 7;
const FLOWCONTROL_SUSPEND: u8 = 8;
const FLOWCONTROL_RESUME: u8 = 9;
const SET_LINESTATE_MASK: u8 = 10;
const SET_MODEMSTATE_MASK: u8 = 11;
const PURGE_DATA: u8 = 12;

/// The line state's bits for a break and for a framing error.
const BREAK_DETECTED: u8 = 1 << 4;
const FRAMING_ERROR: u8 = 1 << 3;
/// The modem state: DCD, DSR and CTS on.
const MODEM: u8 = 1 << 7 | 1 << 5 | 1 << 4;

/// What this server calls itself.
const NAME: &[u8] = b"torno";

/// What the client wants.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Request {
    /// These bytes are to be sent.
    Data(Vec<u8>),
    /// What is sent from now on is to be sent in this.
    Coding(LineCoding),
    /// `XON` and `XOFF` are to hold what is sent, or no longer.
    FlowControl(bool),
    /// The line is to be held low, or no longer.
    Break(bool),
    /// DTR has risen (`true`) or fallen.
    Dtr(bool),
    /// What has been received and not yet read is to be forgotten.
    PurgeReceived,
    /// What has not been sent yet is to be forgotten.
    PurgeSent,
    /// Nothing that is received is to be passed on for now (`true`), or it is again.
    Suspend(bool),
}

/// One end of a connection.
#[derive(Clone, Debug)]
pub struct Server {
    decoder: Decoder,
    /// Options at this end, and at the other.
    ours: [Choice; 3],
    theirs: [Choice; 3],
    coding: LineCoding,
    ixon: bool,
    low: bool,
    dtr: bool,
    rts: bool,
    line_mask: u8,
    modem_mask: u8,
    answers: Vec<u8>,
}

/// An option at one end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Choice {
    option: u8,
    state: State,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Off,
    On,
    /// This end has asked for it.
    Asked,
}

impl Choice {
    const fn new(option: u8, state: State) -> Self {
        Self { option, state }
    }

    /// The other end wants it on, or off. Says whether this end agrees, if that is to be said, as none has asked it.
    fn hear(&mut self, on: bool) -> Option<bool> {
        let before = core::mem::replace(&mut self.state, if on { State::On } else { State::Off });
        match (before, on) {
            (State::Off, true) => Some(true),
            (State::On, false) => Some(false),
            _ => None,
        }
    }
}

impl Server {
    /// A server for a line that is set to this. It begins to talk itself.
    pub fn new(coding: LineCoding, ixon: bool) -> Self {
        let ours =
            [Choice::new(BINARY, State::Asked), Choice::new(SGA, State::Asked), Choice::new(COM_PORT, State::Off)];
        let theirs =
            [Choice::new(BINARY, State::Asked), Choice::new(SGA, State::Off), Choice::new(COM_PORT, State::Asked)];
        let mut server = Self {
            decoder: Decoder::default(),
            ours,
            theirs,
            coding,
            ixon,
            low: false,
            dtr: false,
            rts: false,
            line_mask: 0,
            modem_mask: 0xff,
            answers: Vec::new(),
        };
        for (choices, verb) in [(ours, Verb::Will), (theirs, Verb::Do)] {
            let asked = choices.iter().filter(|choice| choice.state == State::Asked);
            asked.for_each(|choice| server.answers.extend(verb.of(choice.option)));
        }
        server
    }

    /// Takes what has come from the client. Says what it wants, in order.
    pub fn receive(&mut self, bytes: &[u8]) -> Vec<Request> {
        let mut requests = Vec::new();
        for said in self.decoder.decode(bytes) {
            match said {
                Received::Data(bytes) => requests.push(Request::Data(bytes)),
                Received::Break => requests.extend([true, self.low].map(Request::Break)),
                Received::Option(verb, option) => self.choose(verb, option),
                Received::Sub(COM_PORT, Some(content)) => {
                    if let Some((command, value)) = content.split_first() {
                        self.carry_out(*command, value, &mut requests);
                    }
                }
                Received::Sub(..) => {}
            }
        }
        requests
    }

    /// What is to be sent to the client, other than data.
    pub fn take_answers(&mut self) -> Vec<u8> {
        core::mem::take(&mut self.answers)
    }

    /// Data as they are sent to the client.
    pub fn encode(bytes: &[u8]) -> impl Iterator<Item = u8> {
        escaped(bytes)
    }

    /// A character has come with a framing error, or is a break. Tells the client, if it wants to know.
    pub fn tell_line_error(&mut self, is_break: bool) {
        let state = FRAMING_ERROR | if is_break { BREAK_DETECTED } else { 0 };
        if state & self.line_mask != 0 {
            self.answer(NOTIFY_LINESTATE, &[state & self.line_mask]);
        }
    }

    /// Whether the client holds the line low.
    pub const fn is_low(&self) -> bool {
        self.low
    }

    fn choose(&mut self, verb: Verb, option: u8) {
        let (choices, on, agree, refuse) = match verb {
            Verb::Do | Verb::Dont => (&mut self.ours, verb == Verb::Do, Verb::Will, Verb::Wont),
            Verb::Will | Verb::Wont => (&mut self.theirs, verb == Verb::Will, Verb::Do, Verb::Dont),
        };
        let known = choices.iter_mut().find(|choice| choice.option == option);
        let has_been_on = known.as_ref().is_some_and(|choice| choice.state == State::On);
        let answer = match known {
            Some(choice) => choice.hear(on).map(|agrees| if agrees { agree } else { refuse }),
            // What is not known is off, and stays so.
            None => on.then_some(refuse),
        };
        if let Some(verb) = answer {
            self.answers.extend(verb.of(option));
        }
        if option == COM_PORT && on && !has_been_on {
            self.tell_modem_state();
        }
    }

    fn tell_modem_state(&mut self) {
        if MODEM & self.modem_mask != 0 {
            self.answer(NOTIFY_MODEMSTATE, &[MODEM & self.modem_mask]);
        }
    }

    fn answer(&mut self, command: u8, value: &[u8]) {
        let content: Vec<u8> = [command + ANSWER].into_iter().chain(value.iter().copied()).collect();
        self.answers.extend(sub(COM_PORT, &content));
    }

    /// A command whose value has not the size that it should have is passed over.
    fn carry_out(&mut self, command: u8, value: &[u8], requests: &mut Vec<Request>) {
        match (command, value) {
            (SIGNATURE, []) => self.answer(SIGNATURE, NAME),
            (SET_BAUDRATE, value) => {
                let Ok(bytes) = <[u8; 4]>::try_from(value) else { return };
                let baud = u32::from_be_bytes(bytes);
                let baud = BAUD.contains(&baud).then_some(baud);
                self.set_coding(LineCoding { baud: baud.unwrap_or(self.coding.baud), ..self.coding }, requests);
                self.answer(SET_BAUDRATE, &self.coding.baud.to_be_bytes());
            }
            (SET_DATASIZE, &[value]) => {
                let data = DataBits::from_number(value).unwrap_or(self.coding.format.data);
                self.set_format(Format { data, ..self.coding.format }, requests);
                self.answer(SET_DATASIZE, &[data.number()]);
            }
            (SET_PARITY, &[value]) => {
                const ALL: [Parity; 5] = [Parity::None, Parity::Odd, Parity::Even, Parity::Mark, Parity::Space];
                let parity = self.set(value, &ALL, self.coding.format.parity, SET_PARITY);
                self.set_format(Format { parity, ..self.coding.format }, requests);
            }
            (SET_STOPSIZE, &[value]) => {
                let stop = self.set(value, &[StopBits::One, StopBits::Two], self.coding.format.stop, SET_STOPSIZE);
                self.set_format(Format { stop, ..self.coding.format }, requests);
            }
            (SET_CONTROL, &[value]) => self.control(value, requests),
            (NOTIFY_MODEMSTATE, [] | [_]) => self.tell_modem_state(),
            (FLOWCONTROL_SUSPEND, []) => requests.push(Request::Suspend(true)),
            (FLOWCONTROL_RESUME, []) => requests.push(Request::Suspend(false)),
            (SET_LINESTATE_MASK, &[mask]) => {
                self.line_mask = mask;
                self.answer(SET_LINESTATE_MASK, &[mask]);
            }
            (SET_MODEMSTATE_MASK, &[mask]) => {
                self.modem_mask = mask;
                self.answer(SET_MODEMSTATE_MASK, &[mask]);
                self.tell_modem_state();
            }
            (PURGE_DATA, &[what @ 1..=3]) => {
                if what & 1 != 0 {
                    requests.push(Request::PurgeReceived);
                }
                if what & 2 != 0 {
                    requests.push(Request::PurgeSent);
                }
                self.answer(PURGE_DATA, &[what]);
            }
            _ => {}
        }
    }

    /// Answers with what is in force: the value's place in `all`, counted from 1, if it has one, or what was before.
    fn set<T: Copy + PartialEq>(&mut self, value: u8, all: &[T], before: T, command: u8) -> T {
        let asked = value.checked_sub(1).and_then(|place| all.get(usize::from(place)).copied());
        let now = asked.unwrap_or(before);
        let number = all.iter().zip(1..).find(|(known, _)| **known == now).map_or(0, |(_, number)| number);
        self.answer(command, &[number]);
        now
    }

    fn set_format(&mut self, format: Format, requests: &mut Vec<Request>) {
        self.set_coding(LineCoding { format, ..self.coding }, requests);
    }

    fn set_coding(&mut self, coding: LineCoding, requests: &mut Vec<Request>) {
        if coding != self.coding {
            self.coding = coding;
            requests.push(Request::Coding(coding));
        }
    }

    /// `SET-CONTROL`: three states of two values each, and flow control.
    fn control(&mut self, value: u8, requests: &mut Vec<Request>) {
        let two = |off: u8, on: bool| if on { off } else { off + 1 };
        let answer = match value {
            1 | 2 => {
                if self.ixon != (value == 2) {
                    self.ixon = value == 2;
                    requests.push(Request::FlowControl(self.ixon));
                }
                value
            }
            // What is asked, and what there is not.
            0 | 3 | 17 | 19 => 1 + u8::from(self.ixon),
            4..=6 => {
                if value > 4 && self.low != (value == 5) {
                    self.low = value == 5;
                    requests.push(Request::Break(self.low));
                }
                two(5, self.low)
            }
            7..=9 => {
                if value > 7 && self.dtr != (value == 8) {
                    self.dtr = value == 8;
                    requests.push(Request::Dtr(self.dtr));
                }
                two(8, self.dtr)
            }
            10..=12 => {
                if value > 10 {
                    self.rts = value == 11;
                }
                two(11, self.rts)
            }
            13..=16 | 18 => 14 + u8::from(self.ixon),
            _ => return,
        };
        self.answer(SET_CONTROL, &[answer]);
    }
}

#[cfg(test)]
mod tests;
