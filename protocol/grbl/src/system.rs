//! `$` lines: what they ask for, and in which states they may.

use crate::code::Code;
use crate::number;
use crate::state::State;

/// What a `$` line asks for.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Command {
    Help,
    Settings,
    Modes,
    Check,
    Unlock,
    Places,
    /// And what follows it: nothing, or the letter of an axis.
    Home {
        axis: Vec<u8>,
    },
    Sleep,
    Info,
    StoreInfo(String),
    Startup,
    StoreStartup {
        number: u8,
        block: Vec<u8>,
    },
    Store {
        number: u8,
        value: f32,
    },
    Restore(Restore),
    Jog(Vec<u8>),
}

/// `$RST=`
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Restore {
    Settings,
    Places,
    All,
}

/// Reads what follows the `$`.
pub(crate) fn read(text: &[u8], state: State) -> Result<Command, Code> {
    let rests = matches!(state, State::Idle | State::Alarm);
    match text {
        [] => Ok(Command::Help),
        [b'J', ..] if !matches!(state, State::Idle | State::Jog) => Err(Code::NotIdle),
        [b'J', b'=', words @ ..] => Ok(Command::Jog(words.to_vec())),
        [b'$'] if matches!(state, State::Run | State::Hold) => Err(Code::NotIdle),
        [b'$'] => Ok(Command::Settings),
        [b'G'] => Ok(Command::Modes),
        [b'C'] if !matches!(state, State::Idle | State::Check) => Err(Code::NotIdle),
        [b'C'] => Ok(Command::Check),
        [b'X'] => Ok(Command::Unlock),
        [b'J' | b'$' | b'G' | b'C' | b'X', ..] => Err(Code::InvalidStatement),
        _ if !rests => Err(Code::NotIdle),
        [b'#'] => Ok(Command::Places),
        [b'H', axis @ ..] => Ok(Command::Home { axis: axis.to_vec() }),
        [b'S', b'L', b'P'] => Ok(Command::Sleep),
        [b'I'] => Ok(Command::Info),
        [b'I', b'=', info @ ..] => Ok(Command::StoreInfo(String::from_utf8_lossy(info).into_owned())),
        [b'R', b'S', b'T', b'=', what] => Ok(Command::Restore(match what {
            b'$' => Restore::Settings,
            b'#' => Restore::Places,
            b'*' => Restore::All,
            _ => return Err(Code::InvalidStatement),
        })),
        [b'#' | b'S' | b'I' | b'R', ..] => Err(Code::InvalidStatement),
        [b'N'] => Ok(Command::Startup),
        [b'N', ..] if state != State::Idle => Err(Code::NotIdle),
        [b'N', assignment @ ..] => {
            let (number, block) = assign(assignment)?;
            Ok(Command::StoreStartup { number: number::unsigned(number) as u8, block: block.to_vec() })
        }
        assignment => {
            let (number, value) = assign(assignment)?;
            let (value, rest) = number::read(value).ok_or(Code::BadNumber)?;
            if !rest.is_empty() || number > f32::from(u8::MAX) {
                return Err(Code::InvalidStatement);
            }
            Ok(Command::Store { number: number::unsigned(number) as u8, value })
        }
    }
}

/// A number, `=`, and what is assigned.
fn assign(text: &[u8]) -> Result<(f32, &[u8]), Code> {
    match number::read(text).ok_or(Code::BadNumber)? {
        (number, [b'=', value @ ..]) => Ok((number, value)),
        _ => Err(Code::InvalidStatement),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_is_allowed_only_in_its_states() {
        let fails = |text: &str, state| read(text.as_bytes(), state).err();
        assert_eq!(fails("$", State::Run), Some(Code::NotIdle));
        assert_eq!(fails("$", State::Jog), None);
        assert_eq!(fails("G", State::Run), None);
        assert_eq!(fails("#", State::Run), Some(Code::NotIdle));
        assert_eq!(fails("#", State::Alarm), None);
        assert_eq!(fails("N0=G21", State::Alarm), Some(Code::NotIdle));
        assert_eq!(fails("C", State::Alarm), Some(Code::NotIdle));
        assert_eq!(fails("J=X1F1", State::Alarm), Some(Code::NotIdle));
    }

    #[test]
    fn what_is_no_command_is_refused() {
        let fails = |text: &str| read(text.as_bytes(), State::Idle).err();
        for text in ["GG", "XX", "J", "SL", "RST=", "RST=X", "RST", "1", "1=2A", "999=1", "I1"] {
            assert_eq!(fails(text), Some(Code::InvalidStatement), "${text}");
        }
        assert_eq!(fails("ABC"), Some(Code::BadNumber));
        assert_eq!(fails("1="), Some(Code::BadNumber));
        assert_eq!(fails("-1=1"), None);
    }
}
