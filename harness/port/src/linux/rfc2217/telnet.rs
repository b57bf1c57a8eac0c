//! Telnet on the wire (RFC 854, RFC 855): what stands between the bytes of a stream.

/// Interpret as command.
pub(super) const IAC: u8 = 255;
const SE: u8 = 240;
const BREAK: u8 = 243;
const SB: u8 = 250;
const WILL: u8 = 251;
const WONT: u8 = 252;
const DO: u8 = 253;
const DONT: u8 = 254;

/// So much of a subnegotiation is kept. The longest that means anything has five bytes; a signature can be longer, and
/// is of no use here.
const LONGEST: usize = 64;

/// What the other end has said.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Received {
    /// Bytes of the stream.
    Data(Vec<u8>),
    /// It wants something of an option.
    Option(Verb, u8),
    /// A subnegotiation: the option and what follows; none if it was too long.
    Sub(u8, Option<Vec<u8>>),
    /// A break.
    Break,
}

/// What is wanted of an option.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verb {
    Will,
    Wont,
    Do,
    Dont,
}

impl Verb {
    const ALL: [(u8, Self); 4] = [(WILL, Self::Will), (WONT, Self::Wont), (DO, Self::Do), (DONT, Self::Dont)];

    fn from_byte(byte: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|(known, _)| *known == byte).map(|(_, verb)| verb)
    }

    /// With an option, as it is written.
    pub(super) fn of(self, option: u8) -> [u8; 3] {
        let byte = match self {
            Self::Will => WILL,
            Self::Wont => WONT,
            Self::Do => DO,
            Self::Dont => DONT,
        };
        [IAC, byte, option]
    }
}

/// A subnegotiation as it is written.
pub(super) fn sub(option: u8, content: &[u8]) -> Vec<u8> {
    let mut bytes = vec![IAC, SB, option];
    bytes.extend(escaped(content));
    bytes.extend([IAC, SE]);
    bytes
}

/// Bytes of the stream as they are written: IAC is doubled.
pub(super) fn escaped(bytes: &[u8]) -> impl Iterator<Item = u8> {
    bytes.iter().flat_map(|byte| core::iter::repeat_n(*byte, if *byte == IAC { 2 } else { 1 }))
}

/// Takes the stream apart, however it is cut.
#[derive(Clone, Debug, Default)]
pub(super) struct Decoder {
    state: State,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
enum State {
    #[default]
    Data,
    /// IAC has come.
    Command,
    /// IAC and a verb have come.
    Option(Verb),
    /// IAC SB has come.
    Sub(Sub),
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Sub {
    option: Option<u8>,
    content: Vec<u8>,
    too_long: bool,
    /// IAC has come in it.
    command: bool,
}

impl Decoder {
    pub(super) fn decode(&mut self, bytes: &[u8]) -> Vec<Received> {
        let mut said = Vec::new();
        for byte in bytes {
            self.take(*byte, &mut said);
        }
        said
    }

    fn take(&mut self, byte: u8, said: &mut Vec<Received>) {
        self.state = match (core::mem::take(&mut self.state), byte) {
            (State::Data, IAC) => State::Command,
            (State::Data, byte) => data(byte, said),
            (State::Command, byte) => command(byte, said),
            (State::Option(verb), option) => {
                said.push(Received::Option(verb, option));
                State::Data
            }
            (State::Sub(sub), byte) => sub.take(byte, said),
        };
    }
}

fn data(byte: u8, said: &mut Vec<Received>) -> State {
    if let Some(Received::Data(bytes)) = said.last_mut() {
        bytes.push(byte);
    } else {
        said.push(Received::Data(vec![byte]));
    }
    State::Data
}

/// What follows an IAC. Commands that mean nothing for a serial port are passed over.
fn command(byte: u8, said: &mut Vec<Received>) -> State {
    match byte {
        IAC => data(IAC, said),
        SB => State::Sub(Sub::default()),
        BREAK => {
            said.push(Received::Break);
            State::Data
        }
        byte => Verb::from_byte(byte).map_or(State::Data, State::Option),
    }
}

impl Sub {
    fn take(mut self, byte: u8, said: &mut Vec<Received>) -> State {
        match (core::mem::take(&mut self.command), byte) {
            (false, IAC) => {
                self.command = true;
                State::Sub(self)
            }
            (true, SE) => {
                if let Some(option) = self.option {
                    said.push(Received::Sub(option, (!self.too_long).then_some(self.content)));
                }
                State::Data
            }
            // The subnegotiation has no end: whoever sent it has gone on.
            (true, byte) if byte != IAC => command(byte, said),
            (_, byte) => {
                match self.option {
                    None => self.option = Some(byte),
                    Some(_) if self.content.len() < LONGEST => self.content.push(byte),
                    Some(_) => self.too_long = true,
                }
                State::Sub(self)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn decoded(bytes: &[u8]) -> Vec<Received> {
        Decoder::default().decode(bytes)
    }

    #[test]
    fn a_stream_is_taken_apart() {
        let data = |bytes: &[u8]| Received::Data(bytes.to_vec());
        for (bytes, expected) in [
            (&b"ab"[..], vec![data(b"ab")]),
            (&[b'a', IAC, IAC, b'b'], vec![data(&[b'a', IAC, b'b'])]),
            (&[b'a', IAC, WILL, 44, b'b'], vec![data(b"a"), Received::Option(Verb::Will, 44), data(b"b")]),
            (&[IAC, DONT, IAC, b'b'], vec![Received::Option(Verb::Dont, IAC), data(b"b")]),
            (&[IAC, SB, 44, 1, IAC, IAC, 2, IAC, SE], vec![Received::Sub(44, Some(vec![1, IAC, 2]))]),
            (&[IAC, SB, 44, IAC, SE], vec![Received::Sub(44, Some(vec![]))]),
            (&[IAC, SB, IAC, SE, b'a'], vec![data(b"a")]),
            (&[IAC, SB, 44, 1, IAC, WILL, 0, b'a'], vec![Received::Option(Verb::Will, 0), data(b"a")]),
            (&[IAC, BREAK, IAC, 241, IAC, SE, IAC, 0, b'a'], vec![Received::Break, data(b"a")]),
            (&[IAC, SB, 44, 1, 2, 3], vec![]),
        ] {
            assert_eq!(decoded(bytes), expected, "{bytes:?}");
        }
    }

    #[test]
    fn a_subnegotiation_without_end_is_not_kept() {
        let mut decoder = Decoder::default();
        assert_eq!(decoder.decode(&[&[IAC, SB, 44][..], &[7; 100_000]].concat()), []);
        let State::Sub(sub) = &decoder.state else { panic!("{decoder:?}") };
        assert_eq!(sub.content.len(), LONGEST);
        assert_eq!(decoder.decode(&[IAC, SE, 8]), [Received::Sub(44, None), Received::Data(vec![8])]);
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(
            bytes: Vec<u8>,
            option in 0..IAC,
            content in prop::collection::vec(any::<u8>(), 0..9),
        ) {
            let written: Vec<u8> = escaped(&bytes).chain(sub(option, &content)).collect();
            let said = decoded(&written);
            let data: Vec<u8> = said.iter().flat_map(|said| match said {
                Received::Data(data) => data.clone(),
                _ => Vec::new(),
            }).collect();
            prop_assert_eq!(data, bytes);
            prop_assert_eq!(said.last(), Some(&Received::Sub(option, Some(content))));
        }

        #[test]
        fn it_does_not_matter_how_the_stream_is_cut(
            bytes in prop::collection::vec(prop_oneof![Just(IAC), Just(SB), Just(SE), any::<u8>()], 0..200),
            cut in any::<prop::sample::Index>(),
        ) {
            let (first, second) = bytes.split_at(cut.index(bytes.len() + 1));
            let mut decoder = Decoder::default();
            let mut parts = decoder.decode(first);
            parts.extend(decoder.decode(second));
            let joined = |parts: Vec<Received>| parts.into_iter().fold(Vec::new(), |mut all: Vec<Received>, said| {
                match (all.last_mut(), said) {
                    (Some(Received::Data(before)), Received::Data(after)) => before.extend(after),
                    (_, said) => all.push(said),
                }
                all
            });
            prop_assert_eq!(joined(parts), joined(decoded(&bytes)));
        }
    }
}
