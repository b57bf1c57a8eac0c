//! What the master tells the PC: one control character each, some followed by letters.

use core::fmt;

use crate::lathe::{ACK, CAN, NAK, Refusal, XOFF, XON};

/// A reply of the master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reply {
    /// The frame has been distributed to the slaves.
    Ack,
    /// The frame is held until the slaves are done.
    Xoff,
    /// All slaves are done.
    Xon,
    /// A frame is refused.
    Nak(Refusal),
    /// A slave or the master itself failed; what was held is not executed.
    Can(Party, Fault),
    /// No reply of this dialect.
    Unknown(u8),
}

/// A slave, as the replies name it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Slave {
    /// The main motor.
    Spindle,
    /// The feed axis, parallel to the work.
    Transverse,
    /// The infeed axis.
    Depth,
}

/// Who failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Party {
    /// The master itself: it has restarted.
    Master,
    /// A slave.
    Slave(Slave),
}

/// How a board failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Fault {
    /// It does not answer.
    NoAnswer,
    /// Its motor is driven and does not turn.
    Stalled,
    /// An axis ran into its end of travel.
    EndOfTravel,
    /// Its sub-frame did not reach it whole, and nothing of it was executed. Told only when asked: what is heard
    /// while no sub-frame is on its way is noise, and the master asks only while it waits for one.
    Garbled,
    /// It has restarted since, and what it was told before is lost. A slave tells it only when asked, too, and takes
    /// no sub-frame before.
    Restarted,
}

impl Slave {
    /// The slaves, in the order of their sub-frames in a frame.
    pub const ALL: [Self; 3] = [Self::Spindle, Self::Transverse, Self::Depth];

    /// The letter on the wire.
    pub const fn letter(self) -> u8 {
        match self {
            Self::Spindle => b's',
            Self::Transverse => b't',
            Self::Depth => b'd',
        }
    }

    /// The name, also of the board in the built-in rig.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Spindle => "spindle",
            Self::Transverse => "transverse",
            Self::Depth => "depth",
        }
    }
}

impl Party {
    /// The letter on the wire.
    pub const fn letter(self) -> u8 {
        match self {
            Self::Master => b'm',
            Self::Slave(slave) => slave.letter(),
        }
    }

    /// The name, also of the board in the built-in rig.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Master => "master",
            Self::Slave(slave) => slave.name(),
        }
    }

    fn from_letter(letter: u8) -> Option<Self> {
        let slaves = Slave::ALL.into_iter().map(Self::Slave);
        slaves.chain([Self::Master]).find(|party| party.letter() == letter)
    }
}

impl From<Slave> for Party {
    fn from(slave: Slave) -> Self {
        Self::Slave(slave)
    }
}

impl Fault {
    /// Every way.
    pub const ALL: [Self; 5] = [Self::NoAnswer, Self::Stalled, Self::EndOfTravel, Self::Garbled, Self::Restarted];

    /// The letter on the wire.
    pub const fn letter(self) -> u8 {
        match self {
            Self::NoAnswer => b'n',
            Self::Stalled => b's',
            Self::EndOfTravel => b'e',
            Self::Garbled => b'g',
            Self::Restarted => b'r',
        }
    }

    /// The fault that a letter stands for.
    pub fn from_letter(letter: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|fault| fault.letter() == letter)
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NoAnswer => "no answer",
            Self::Stalled => "stalled",
            Self::EndOfTravel => "end of travel",
            Self::Garbled => "garbled",
            Self::Restarted => "restarted",
        })
    }
}

impl fmt::Display for Reply {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ack => f.write_str("ACK"),
            Self::Xoff => f.write_str("XOFF"),
            Self::Xon => f.write_str("XON"),
            Self::Nak(refusal) => write!(f, "NAK {refusal}"),
            Self::Can(party, fault) => write!(f, "CAN {} {fault}", party.name()),
            Self::Unknown(byte) => write!(f, "?{byte:02x}"),
        }
    }
}

impl Reply {
    /// The bytes on the wire.
    pub fn emit(self) -> Vec<u8> {
        match self {
            Self::Ack => vec![ACK],
            Self::Xoff => vec![XOFF],
            Self::Xon => vec![XON],
            Self::Nak(refusal) => vec![NAK, refusal.letter()],
            Self::Can(party, fault) => vec![CAN, party.letter(), fault.letter()],
            Self::Unknown(byte) => vec![byte],
        }
    }
}

impl Reply {
    /// The reply as scenarios write it: its name, and its letters one by one.
    pub fn code(self) -> String {
        let name = match self {
            Self::Ack => "ACK",
            Self::Xoff => "XOFF",
            Self::Xon => "XON",
            Self::Nak(_) => "NAK",
            Self::Can(..) => "CAN",
            Self::Unknown(byte) => return format!("?{byte:02X}"),
        };
        let letters = self.emit().into_iter().skip(1).map(|letter| format!(" {}", char::from(letter)));
        core::iter::once(name.to_owned()).chain(letters).collect()
    }
}

/// Puts replies together from bytes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReplyDecoder {
    pending: Vec<u8>,
}

impl ReplyDecoder {
    /// Takes a byte; gives the replies that are complete or broken with it.
    pub fn push(&mut self, byte: u8) -> Vec<Reply> {
        self.pending.push(byte);
        let reply = match self.pending[..] {
            [ACK] => Some(Reply::Ack),
            [XOFF] => Some(Reply::Xoff),
            [XON] => Some(Reply::Xon),
            [NAK] | [CAN] => return Vec::new(),
            [CAN, party] if Party::from_letter(party).is_some() => return Vec::new(),
            [NAK, letter] => Refusal::from_letter(letter).map(Reply::Nak),
            [CAN, party, fault] => {
                Party::from_letter(party).zip(Fault::from_letter(fault)).map(|(party, fault)| Reply::Can(party, fault))
            }
            [byte] => Some(Reply::Unknown(byte)),
            _ => None,
        };
        let pending = core::mem::take(&mut self.pending);
        if let Some(reply) = reply {
            return vec![reply];
        }
        // Broken: the first byte is out of place; what follows may be a reply.
        let rest = pending[1..].iter().flat_map(|byte| self.push(*byte));
        core::iter::once(Reply::Unknown(pending[0])).chain(rest).collect()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn decoded(bytes: &[u8]) -> Vec<Reply> {
        let mut decoder = ReplyDecoder::default();
        bytes.iter().flat_map(|byte| decoder.push(*byte)).collect()
    }

    fn replies() -> impl Strategy<Value = Reply> {
        prop_oneof![
            Just(Reply::Ack),
            Just(Reply::Xoff),
            Just(Reply::Xon),
            Just(Reply::Nak(Refusal::CutShort)),
            prop::sample::select(Fault::ALL.to_vec()).prop_map(|fault| Reply::Can(Slave::Depth.into(), fault)),
            Just(Reply::Can(Party::Master, Fault::Restarted)),
        ]
    }

    #[test]
    fn a_broken_reply_does_not_swallow_the_next() {
        assert_eq!(decoded(&[CAN, b's', ACK]), [Reply::Unknown(CAN), Reply::Unknown(b's'), Reply::Ack]);
        assert_eq!(decoded(&[NAK, NAK, b'd']), [Reply::Unknown(NAK), Reply::Nak(Refusal::Direction)]);
    }

    #[test]
    fn parties_and_faults_have_these_letters_and_names() {
        let parties = Slave::ALL.map(Party::from).into_iter().chain([Party::Master]);
        let parties: Vec<_> = parties.map(|party| (party.letter(), party.name())).collect();
        assert_eq!(parties, [(b's', "spindle"), (b't', "transverse"), (b'd', "depth"), (b'm', "master")]);
        assert_eq!(Slave::ALL.map(|slave| (slave.letter(), slave.name())), parties[..3]);
        for slave in Slave::ALL {
            assert_eq!(Party::from_letter(slave.letter()), Some(Party::Slave(slave)));
        }
        assert_eq!(Party::from_letter(b'm'), Some(Party::Master));
        assert_eq!(Party::from_letter(b'x'), None);
        let faults = Fault::ALL.map(|fault| (fault.letter(), fault.to_string()));
        let words = ["no answer", "stalled", "end of travel", "garbled", "restarted"].map(str::to_owned);
        assert_eq!(faults.clone().map(|(_, word)| word), words);
        assert_eq!(faults.map(|(letter, _)| letter), *b"nsegr");
        assert_eq!(Fault::ALL.map(|fault| Fault::from_letter(fault.letter())), Fault::ALL.map(Some));
        assert_eq!(Fault::from_letter(b'x'), None);
    }

    #[test]
    fn each_reply_has_bytes_words_and_a_code() {
        let stop = Reply::Can(Slave::Transverse.into(), Fault::EndOfTravel);
        for (reply, bytes, words, code) in [
            (Reply::Ack, &[0x06][..], "ACK", "ACK"),
            (Reply::Xoff, &[0x13], "XOFF", "XOFF"),
            (Reply::Xon, &[0x11], "XON", "XON"),
            (Reply::Nak(Refusal::CutShort), &[0x15, b'c'], "NAK cut short", "NAK c"),
            (stop, &[0x18, b't', b'e'], "CAN transverse end of travel", "CAN t e"),
            (Reply::Can(Party::Master, Fault::Restarted), &[0x18, b'm', b'r'], "CAN master restarted", "CAN m r"),
            (Reply::Unknown(0x0a), &[0x0a], "?0a", "?0A"),
        ] {
            assert_eq!((&reply.emit()[..], reply.to_string(), reply.code()), (bytes, words.into(), code.into()));
            assert_eq!(decoded(bytes), [reply]);
        }
    }

    #[test]
    fn a_letter_that_stands_for_nothing_breaks_the_reply() {
        let unknown = |bytes: &[u8]| bytes.iter().map(|byte| Reply::Unknown(*byte)).collect::<Vec<_>>();
        for bytes in [&[NAK, b'x'][..], &[CAN, b'x'], &[CAN, b's', b'x'], b"e"] {
            assert_eq!(decoded(bytes), unknown(bytes));
        }
        assert_eq!(decoded(&[CAN, CAN, b'd', b'n'])[1], Reply::Can(Slave::Depth.into(), Fault::NoAnswer));
    }

    proptest! {
        #[test]
        fn what_is_emitted_is_decoded(replies in prop::collection::vec(replies(), 0..20)) {
            let bytes: Vec<u8> = replies.iter().flat_map(|reply| reply.emit()).collect();
            prop_assert_eq!(decoded(&bytes), replies);
        }

        #[test]
        fn no_byte_is_lost(bytes in prop::collection::vec(any::<u8>(), 0..40)) {
            let mut decoder = ReplyDecoder::default();
            let mut seen: Vec<u8> = bytes.iter().flat_map(|byte| decoder.push(*byte)).flat_map(Reply::emit).collect();
            seen.extend(&decoder.pending);
            prop_assert_eq!(seen, bytes);
        }
    }
}
