//! The records between the harness and a board's process.
//!
//! A record is a length (four bytes, little-endian) and that many bytes of `postcard`. The harness opens with
//! [`ToBoard::Setup`], the board answers [`FromBoard::Ready`]; from then on each [`ToBoard::Grant`] is answered by one
//! [`FromBoard::Report`]. What is too much for one record goes ahead of it in [`ToBoard::Heard`] and
//! [`FromBoard::Told`]. The end of the stream ends the board.

use bytes::{Buf, BufMut, BytesMut};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::board::{Description, Kept, Output, Stimulus};
use crate::clock::Clock;
use crate::line::Edge;
use crate::time::Instant;
use crate::uart::Ear;

/// The version of these records. Harness and board must have the same: they are one program, and a board that runs
/// elsewhere says in its answer which version it speaks.
pub const VERSION: u16 = 8;

/// The longest record that is accepted, in bytes.
pub const LENGTH_MAX: usize = 16 << 20;

/// So many outputs, inputs and edges go in one record at the most; each is below 20 bytes.
const WEIGHT_MAX: usize = 500_000;

/// From the harness to a board.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ToBoard {
    /// What the board is to be.
    Setup(Setup),
    /// Time may go on.
    Grant(Grant),
    /// The beginning of what the board hears with the next grant.
    Heard(Vec<Heard>),
    /// The board is to say what it keeps without power, as everything before this instant leaves it.
    Keep(Instant),
}

/// From a board to the harness.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FromBoard {
    /// The board stands and is described.
    Ready {
        /// [`VERSION`].
        version: u16,
        /// What the board consists of.
        description: Description,
    },
    /// What came of a grant.
    Report(Report),
    /// The board cannot go on; why, for people.
    Broken(String),
    /// The beginning of what it does in the next report.
    Told(Vec<Timed>),
    /// What the board keeps without power.
    Kept(Option<Kept>),
}

/// What a board is to be.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Setup {
    /// [`VERSION`].
    pub version: u16,
    /// The board's name in the rig, for the log.
    pub name: String,
    /// The kind of board.
    pub kind: String,
    /// Its oscillator.
    pub clock: Clock,
    /// Its settings, as the rig file has them (TOML).
    pub settings: String,
}

/// A board's grant: what has become certain, what it hears, how far it must run.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Grant {
    /// Nothing that the board hears from now on matters before this instant.
    pub commit: Instant,
    /// Run at least everything before this instant, mute or not; less, if nothing is heard and the report is full.
    pub until: Instant,
    /// What the board hears, in order for each source.
    pub heard: Vec<Heard>,
}

/// What a board hears from the harness.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Heard {
    /// Edges on the line of a port.
    Edges {
        /// The port's number.
        port: u8,
        /// The edges, in order.
        edges: Vec<Edge>,
    },
    /// The line of a port goes idle; its edges from then on are withdrawn.
    Cut {
        /// The port's number.
        port: u8,
        /// When.
        at: Instant,
    },
    /// A stimulus.
    Stimulus {
        /// When.
        at: Instant,
        /// What.
        stimulus: Stimulus,
    },
}

/// What came of a grant.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Report {
    /// What was told before of this instant and later no longer holds.
    pub from: Instant,
    /// Everything before this instant has been run and told.
    pub horizon: Instant,
    /// If the board is mute: since when. Nothing leaves it by a port until something reaches it.
    pub mute_since: Option<Instant>,
    /// Where the board waits for the world outside to stay silent, in order.
    pub silences: Vec<Silence>,
    /// The state of each port's receiver, everything sent so far heard.
    pub ears: Vec<Ear>,
    /// What the board does, in order.
    pub outputs: Vec<Timed>,
}

impl Grant {
    /// The records that it goes in.
    pub fn into_records(mut self) -> impl Iterator<Item = ToBoard> {
        let (parts, last) = parted(core::mem::take(&mut self.heard), |heard| match heard {
            Heard::Edges { edges, .. } => 1 + edges.len(),
            Heard::Cut { .. } | Heard::Stimulus { .. } => 1,
        });
        parts.into_iter().map(ToBoard::Heard).chain([ToBoard::Grant(Self { heard: last, ..self })])
    }
}

impl Report {
    /// The records that it goes in.
    pub fn into_records(mut self) -> impl Iterator<Item = FromBoard> {
        let (parts, last) = parted(core::mem::take(&mut self.outputs), |told| match &told.output {
            Output::Character { edges, .. } => 1 + edges.len(),
            Output::Cut { .. } | Output::Telemetry { .. } | Output::Event { .. } => 1,
            Output::Pin { .. } => 3,
        });
        parts.into_iter().map(FromBoard::Told).chain([FromBoard::Report(Self { outputs: last, ..self })])
    }
}

/// Parts of at most [`WEIGHT_MAX`] each, and what is left for the last one.
fn parted<T>(all: Vec<T>, weight: impl Fn(&T) -> usize) -> (Vec<Vec<T>>, Vec<T>) {
    // Nearly always it is one.
    if all.len() < WEIGHT_MAX / 100 && all.iter().map(&weight).sum::<usize>() <= WEIGHT_MAX {
        return (Vec::new(), all);
    }
    let (mut parts, mut last, mut sum) = (Vec::new(), Vec::new(), 0);
    for one in all {
        sum += weight(&one);
        if sum > WEIGHT_MAX && !last.is_empty() {
            parts.push(core::mem::take(&mut last));
            sum = weight(&one);
        }
        last.push(one);
    }
    (parts, last)
}

/// A board waits for the world outside the rig to stay silent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Silence {
    /// Since when.
    pub from: Instant,
    /// When it draws its conclusion.
    pub deadline: Instant,
}

/// An output and when the board decided on it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Timed {
    /// When.
    pub at: Instant,
    /// What.
    pub output: Output,
}

/// Why a record could not be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RecordError {
    /// The length is beyond [`LENGTH_MAX`].
    #[error("a record of {0} bytes is longer than {LENGTH_MAX}")]
    TooLong(usize),
    /// The bytes are not a record of this version.
    #[error("not a record of version {VERSION}: {0}")]
    Malformed(postcard::Error),
}

/// Appends a record to `buffer`.
///
/// # Errors
/// [`RecordError`] if the record cannot be written, or is too long.
pub fn encode<R: Serialize>(record: &R, buffer: &mut BytesMut) -> Result<(), RecordError> {
    let start = buffer.len();
    buffer.put_u32_le(0);
    *buffer = postcard::to_extend(record, core::mem::take(buffer)).map_err(RecordError::Malformed)?;
    let length = buffer.len() - start - 4;
    let prefix = u32::try_from(length).ok().filter(|_| length <= LENGTH_MAX).ok_or(RecordError::TooLong(length))?;
    buffer[start..start + 4].copy_from_slice(&prefix.to_le_bytes());
    Ok(())
}

/// Takes the first record from `buffer`, if it is complete.
///
/// # Errors
/// [`RecordError`] if it is too long or not a record.
pub fn decode<R: DeserializeOwned>(buffer: &mut BytesMut) -> Result<Option<R>, RecordError> {
    let Some(prefix) = buffer.first_chunk::<4>() else { return Ok(None) };
    let length = u32::from_le_bytes(*prefix) as usize;
    if length > LENGTH_MAX {
        return Err(RecordError::TooLong(length));
    }
    if buffer.len() < 4 + length {
        return Ok(None);
    }
    buffer.advance(4);
    let record = buffer.split_to(length);
    postcard::from_bytes(&record).map(Some).map_err(RecordError::Malformed)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::board::{Capability, Motor, MotorStimulus, OutputPin, Role, Signal, Wait};
    use crate::line::Level;

    fn grant() -> ToBoard {
        let edges = vec![Edge { at: Instant::from_nanos(300), level: Level::Low }];
        let commit = Instant::from_nanos(128);
        ToBoard::Grant(Grant { commit, until: Instant::START, heard: vec![Heard::Edges { port: 2, edges }] })
    }

    /// Byte-exact: if this fails, the version must change, not the test.
    #[test]
    fn version_6_of_a_turn() {
        let mut buffer = BytesMut::new();
        encode(&grant(), &mut buffer).unwrap();
        assert_eq!(buffer[..], [11, 0, 0, 0, 1, 128, 1, 0, 1, 0, 2, 1, 172, 2, 0]);
    }

    /// Byte-exact, as the grant.
    #[test]
    fn version_6_of_a_description_and_of_what_happens_to_a_motor() {
        let bytes = |record: &[u8]| [&(record.len() as u32).to_le_bytes(), record].concat();
        let heard = Heard::Stimulus { at: Instant::from_nanos(5), stimulus: MotorStimulus::EndStop(-2).of(1) };
        let mut buffer = BytesMut::new();
        encode(&ToBoard::Heard(vec![heard]), &mut buffer).unwrap();
        assert_eq!(buffer[..], bytes(&[2, 1, 2, 5, 2, 1, 5, 3]));

        let signal = Signal::new("s", -1).with_unit("rpm").with_role(Role::Drive).of_motor(2);
        let motor = Motor { name: "m".to_owned(), capabilities: vec![Capability::Motor, Capability::Axis] };
        let description = Description {
            ports: vec!["p".to_owned()],
            signals: vec![signal, Signal::new("t", 0)],
            events: vec!["e".to_owned()],
            waits: vec![Wait { signal: 1, ports: vec![3] }],
            capabilities: vec![Capability::Reset],
            motors: vec![motor],
            pins: vec![OutputPin { name: "x".to_owned(), first: Level::High }],
        };
        let mut buffer = BytesMut::new();
        encode(&FromBoard::Ready { version: VERSION, description }, &mut buffer).unwrap();
        let parts: [&[u8]; 9] = [
            &[0, 8],
            b"\x01\x01p",
            b"\x02\x01s\x01\x03rpm\x03\x01\x02",
            b"\x01t\0\0\x08\0",
            b"\x01\x01e",
            &[1, 1, 1, 3],
            &[1, 0],
            b"\x01\x01m\x02\x01\x02",
            b"\x01\x01x\x01",
        ];
        assert_eq!(buffer[..], bytes(&parts.concat()));
    }

    #[test]
    fn a_record_is_read_when_it_is_complete() {
        let mut whole = BytesMut::new();
        encode(&grant(), &mut whole).unwrap();
        let mut part = BytesMut::new();
        for byte in &whole[..whole.len() - 1] {
            part.put_u8(*byte);
            assert_eq!(decode::<ToBoard>(&mut part), Ok(None));
        }
        part.put_u8(whole[whole.len() - 1]);
        assert_eq!(decode(&mut part), Ok(Some(grant())));
        assert!(part.is_empty());
    }

    #[test]
    fn a_record_that_is_too_long_is_refused() {
        let mut buffer = BytesMut::from(&[0xff, 0xff, 0xff, 0x7f, 0][..]);
        assert_eq!(decode::<ToBoard>(&mut buffer), Err(RecordError::TooLong(0x7fff_ffff)));
    }

    fn length(record: &impl Serialize) -> usize {
        let mut buffer = BytesMut::new();
        encode(record, &mut buffer).unwrap();
        buffer.len()
    }

    /// A board that is mute for days of virtual time has much to tell when it is woken.
    #[test]
    fn what_is_much_goes_in_several_records() {
        let telemetry = |n: u64| Timed {
            at: Instant::from_nanos(u64::MAX - n),
            output: Output::Telemetry { signal: 255, value: i64::MIN },
        };
        for count in [0, 1, 4_999, 5_000, 500_000, 500_001, 1_700_000] {
            let outputs: Vec<Timed> = (0..count).map(telemetry).collect();
            let report = Report { horizon: Instant::from_nanos(7), outputs: outputs.clone(), ..Report::default() };
            let mut told = Vec::new();
            for record in report.into_records() {
                assert!(length(&record) <= LENGTH_MAX);
                match record {
                    FromBoard::Told(part) => told.extend(part),
                    FromBoard::Report(report) if report.horizon == Instant::from_nanos(7) => {
                        told.extend(report.outputs)
                    }
                    other => panic!("{other:?}"),
                }
            }
            assert!(told == outputs, "{count}");
        }
    }

    fn noisy(port: u8, edges: usize) -> Heard {
        let edge = |n: u64| Edge { at: Instant::from_nanos(n), level: Level::Low };
        Heard::Edges { port, edges: (0..edges as u64).map(edge).collect() }
    }

    #[test]
    fn parts_are_as_heavy_as_they_may_be_and_no_heavier() {
        let parts = |weights: &[usize]| {
            let (mut parts, last) = parted(weights.to_vec(), |weight| *weight);
            parts.push(last);
            parts
        };
        const MAX: usize = WEIGHT_MAX;
        for (weights, expected) in [
            (vec![], vec![vec![]]),
            (vec![1, 2, 3], vec![vec![1, 2, 3]]),
            (vec![MAX - 1, 1], vec![vec![MAX - 1, 1]]),
            (vec![MAX, 1], vec![vec![MAX], vec![1]]),
            (vec![1, MAX, 2, MAX - 2, 1], vec![vec![1], vec![MAX], vec![2, MAX - 2], vec![1]]),
            // One that is too heavy goes alone.
            (vec![MAX + 1], vec![vec![MAX + 1]]),
            (vec![5, MAX + 1, 5], vec![vec![5], vec![MAX + 1], vec![5]]),
        ] {
            assert_eq!(parts(&weights), expected);
        }
    }

    #[test]
    fn edges_have_a_weight_and_so_has_what_they_are_in() {
        // Five times 100 000 edges would just fit.
        let heard = vec![noisy(0, 100_000); 5];
        let records = Grant { heard, ..Grant::default() }.into_records().map(|record| match record {
            ToBoard::Heard(heard) => heard.len(),
            ToBoard::Grant(grant) => grant.heard.len(),
            ToBoard::Setup(_) | ToBoard::Keep(_) => 0,
        });
        assert_eq!(records.collect::<Vec<_>>(), [4, 1]);
        let Heard::Edges { edges, .. } = noisy(0, 100_000) else { panic!() };
        let output = Output::Character { port: 0, edges, end: Instant::START };
        let outputs = vec![Timed { at: Instant::START, output }; 5];
        let records = Report { outputs, ..Report::default() }.into_records().map(|record| match record {
            FromBoard::Told(told) => told.len(),
            FromBoard::Report(report) => report.outputs.len(),
            FromBoard::Ready { .. } | FromBoard::Broken(_) | FromBoard::Kept(_) => 0,
        });
        assert_eq!(records.collect::<Vec<_>>(), [4, 1]);
    }

    #[test]
    fn a_record_goes_behind_what_is_in_the_buffer() {
        let mut buffer = BytesMut::new();
        let broken = |why: &str| FromBoard::Broken(why.to_owned());
        for why in ["first", "second"] {
            encode(&broken(why), &mut buffer).unwrap();
        }
        assert_eq!(decode(&mut buffer), Ok(Some(broken("first"))));
        assert_eq!(decode(&mut buffer), Ok(Some(broken("second"))));
        assert_eq!(decode::<FromBoard>(&mut buffer), Ok(None));
    }

    #[test]
    fn the_longest_record_is_written_and_read() {
        // Four bytes are the length of the text itself.
        let text = |length: usize| "x".repeat(length - 4);
        let mut buffer = BytesMut::new();
        encode(&text(LENGTH_MAX), &mut buffer).unwrap();
        assert_eq!(buffer.len(), 4 + LENGTH_MAX);
        assert!(decode::<String>(&mut buffer).is_ok_and(|read| read.is_some_and(|read| read.len() == LENGTH_MAX - 4)));
        assert_eq!(encode(&text(LENGTH_MAX + 1), &mut buffer), Err(RecordError::TooLong(LENGTH_MAX + 1)));
        let prefix = |length: u32| BytesMut::from(&length.to_le_bytes()[..]);
        assert_eq!(decode::<ToBoard>(&mut prefix(16 << 20)), Ok(None));
        let more = (16 << 20) + 1;
        assert_eq!(decode::<ToBoard>(&mut prefix(more)), Err(RecordError::TooLong(more as usize)));
    }

    #[test]
    fn noise_without_end_goes_in_several_records() {
        let edge = |n: u64| Edge { at: Instant::from_nanos(u64::MAX - n), level: Level::Low };
        let some = || Heard::Edges { port: 255, edges: (0..100_000).map(edge).collect() };
        let grant =
            Grant { commit: Instant::from_nanos(9), heard: (0..23).map(|_| some()).collect(), ..Grant::default() };
        let records: Vec<ToBoard> = grant.into_records().collect();
        assert!(records.iter().all(|record| length(record) <= LENGTH_MAX));
        let parts = records.iter().map(|record| match record {
            ToBoard::Heard(heard) => heard.len(),
            ToBoard::Grant(grant) if grant.commit == Instant::from_nanos(9) => grant.heard.len(),
            other => panic!("{other:?}"),
        });
        assert_eq!(parts.sum::<usize>(), 23);
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..64)) {
            let mut buffer = BytesMut::from(&bytes[..]);
            while let Ok(Some(_)) = decode::<FromBoard>(&mut buffer) {}
        }
    }
}
