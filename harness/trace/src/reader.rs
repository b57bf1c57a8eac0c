//! Reads a trace, as far as it is good.

use std::io::{self, Read};

use torno_protocol::time::Instant;
use xxhash_rust::xxh3::xxh3_64_with_seed;

use torno_protocol::layout::Layout;

use crate::format::{self, Entries, Entry, Header, MAGIC, PREFIX, ReadWhat, VERSION};
use crate::{Trace, v3, v4};

/// The oldest version that is read.
const OLDEST: u16 = v3::VERSION;

/// Why a trace cannot be read, or not to its end. What could be read is good.
#[derive(Debug, thiserror::Error)]
pub enum Damage {
    /// The system refuses.
    #[error("cannot be read")]
    Unreadable(#[from] io::Error),
    /// It is something else.
    #[error("is no trace: expected a file that '--record' of torno run, up or test has written")]
    Foreign,
    /// Its format is another one.
    #[error(
        "is a trace of version {0}, expected version {OLDEST} to {VERSION}: read it with the torno that has written it"
    )]
    Version(u16),
    /// It ends where it should go on.
    #[error("ends within a block at byte {byte}: its writer was ended, or it was cut; what is before is good")]
    Truncated {
        /// Where the block begins that is not whole.
        byte: u64,
    },
    /// It ends between two blocks.
    #[error("has no end: its writer was ended, or is still at it; what is there is good")]
    NoEnd,
    /// Something in it has been changed.
    #[error("is damaged: the block at byte {byte} is not what was written; what is before is good")]
    Corrupt {
        /// Where the block begins.
        byte: u64,
    },
}

/// Reads a trace: what could be read of it, and what is wrong with the rest. Without a good header there is none.
///
/// `layout` gives the layout of a rig from its name and its file's text, for what an old trace does not store; and the
/// text with what it meant when version 3 was written.
///
/// # Errors
/// [`Damage`] if not even the header is good.
pub fn read(
    input: impl Read,
    layout: impl Fn(&str, &str) -> Option<(Layout, String)>,
) -> Result<(Trace, Option<Damage>), Damage> {
    let mut blocks = Blocks { input, byte: 0, number: 0 };
    let (header, what) = blocks.header(layout)?;
    let mut trace = Trace::new(header);
    loop {
        let byte = blocks.byte;
        let whole = match blocks.next() {
            Ok(Some(payload)) => match add(&payload, &mut trace, what) {
                Some(()) => Ok(()),
                None => Err(Damage::Corrupt { byte }),
            },
            Ok(None) if trace.end.is_some() => return Ok((trace, None)),
            Ok(None) => Err(Damage::NoEnd),
            Err(damage) => Err(damage),
        };
        if let Err(damage) = whole {
            return Ok((trace, Some(damage)));
        }
    }
}

/// Adds a block to a trace, whole or not at all.
fn add(payload: &[u8], trace: &mut Trace, what: ReadWhat) -> Option<()> {
    if trace.end.is_some() {
        return None;
    }
    match payload.split_first()? {
        (&format::ENTRIES, rest) => {
            let (settled, entries) = rest.split_first_chunk()?;
            let settled = u64::from_le_bytes(*settled);
            i64::try_from(settled).ok()?;
            let (facts, inputs) = (trace.facts.len(), trace.inputs.len());
            if add_entries(entries, trace, what).is_none() {
                trace.facts.truncate(facts);
                trace.inputs.truncate(inputs);
                return None;
            }
            trace.settled = trace.settled.max(Instant::from_nanos(settled));
        }
        (&format::END, rest) => {
            let end: format::End = postcard::from_bytes(rest).ok()?;
            i64::try_from(end.at.as_nanos()).ok()?;
            trace.end = Some(end);
        }
        _ => return None,
    }
    Some(())
}

fn add_entries(entries: &[u8], trace: &mut Trace, what: ReadWhat) -> Option<()> {
    let mut entries = Entries::new(entries, what);
    while !entries.is_empty() {
        match entries.next(&trace.header)? {
            Entry::Fact(fact) => trace.facts.push(fact),
            Entry::Input(input) => trace.inputs.push(input),
        }
    }
    Some(())
}

struct Blocks<R> {
    input: R,
    /// Where the next block begins.
    byte: u64,
    number: u64,
}

impl<R: Read> Blocks<R> {
    /// The header, and how the rest of the file has what came from outside.
    fn header(
        &mut self,
        layout: impl Fn(&str, &str) -> Option<(Layout, String)>,
    ) -> Result<(Header, ReadWhat), Damage> {
        let start = self.take(MAGIC.len() as u64 + 2)?;
        let (magic, version) = start.split_at_checked(MAGIC.len()).ok_or(Damage::Foreign)?;
        if magic != MAGIC {
            return Err(Damage::Foreign);
        }
        let byte = self.byte;
        let version = match version {
            [a, b] => u16::from_le_bytes([*a, *b]),
            _ => return Err(Damage::Truncated { byte }),
        };
        if ![v3::VERSION, v4::VERSION, VERSION].contains(&version) {
            return Err(Damage::Version(version));
        }
        let payload = self.next()?.ok_or(Damage::Truncated { byte })?;
        let header = match payload.split_first() {
            Some((&format::HEADER, rest)) if version == v3::VERSION => v3::header(rest, layout),
            Some((&format::HEADER, rest)) if version == v4::VERSION => format::header(rest, v4::take_header, layout),
            Some((&format::HEADER, rest)) => format::header(rest, format::take_header, layout),
            _ => None,
        };
        let what = if version == v3::VERSION { v3::what } else { format::what };
        header.map(|header| (header, what as ReadWhat)).ok_or(Damage::Corrupt { byte })
    }

    /// The payload of the next block; none at the end.
    fn next(&mut self) -> Result<Option<Vec<u8>>, Damage> {
        let byte = self.byte;
        let prefix = self.take(PREFIX as u64)?;
        if prefix.is_empty() {
            return Ok(None);
        }
        let (length, checksum) = prefix.split_first_chunk().ok_or(Damage::Truncated { byte })?;
        let length = u64::from(u32::from_le_bytes(*length));
        let payload = self.take(length)?;
        if (payload.len() as u64) < length {
            return Err(Damage::Truncated { byte });
        }
        if checksum != xxh3_64_with_seed(&payload, self.number).to_le_bytes() {
            return Err(Damage::Corrupt { byte });
        }
        self.number += 1;
        Ok(Some(payload))
    }

    /// The next bytes, or fewer at the end. No more memory is taken than there are bytes.
    fn take(&mut self, length: u64) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.input.by_ref().take(length).read_to_end(&mut bytes)?;
        self.byte += bytes.len() as u64;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use torno_protocol::board::{MotorStimulus, PinOutput, Stimulus};
    use torno_protocol::line::{Edge, Level};
    use torno_protocol::time::Span;
    use torno_protocol::train::Train;
    use torno_protocol::uart::{Format, Parity};

    use super::*;
    use crate::analyser::rows;
    use crate::diff::{Extent, first_difference};
    use crate::rows::{Filter, Wanted};
    use crate::{End, Writer};
    use torno_engine::{Disturbance, Fact, Input, InputKind, Tampering};
    use torno_protocol::board::{Description, Signal};
    use torno_protocol::clock::{Clock, Rate};
    use torno_protocol::layout::{BoardLayout, GATEWAY, LineLayout};
    use torno_protocol::uart::ReceiverKind;

    fn header() -> Header {
        Header::new(layout(), "", "star", 7, Some("shaft.frames"))
    }

    /// A master with three slaves and a gateway: five boards, eight lines.
    fn layout() -> Layout {
        let description = Description {
            ports: ["a", "b", "c", "d"].map(str::to_owned).to_vec(),
            signals: vec![Signal::new("count", 0)],
            events: vec!["told {}".to_owned()],
            ..Description::default()
        };
        let board = |n: usize| BoardLayout {
            name: format!("board{n}"),
            kind: if n == 4 { GATEWAY } else { "toy" }.to_owned(),
            clock: Clock::TRUE,
            description: description.clone(),
            receivers: vec![ReceiverKind::Software { baud: Rate::hz(9600), link: n as u32 }; 4],
        };
        let line = |from: (usize, u8), to: (usize, u8)| LineLayout {
            name: format!("board{}_to_board{}", from.0, to.0),
            from,
            to,
            baud: 9600,
            dialect: "none".to_owned(),
        };
        let both = |n: usize| [line((0, n as u8 - 1), (n, 0)), line((n, 0), (0, n as u8 - 1))];
        Layout { boards: (0..5).map(board).collect(), lines: (1..5).flat_map(both).collect() }
    }

    /// Reads what this version has written.
    fn read(input: &[u8]) -> Result<(Trace, Option<Damage>), Damage> {
        super::read(input, |_, _| None)
    }

    fn at() -> impl Strategy<Value = Instant> {
        prop_oneof![0..1_000_000u64, 0..i64::MAX as u64].prop_map(Instant::from_nanos)
    }

    fn edges() -> impl Strategy<Value = Vec<Edge>> {
        let edge = (at(), any::<bool>())
            .prop_map(|(at, high)| Edge { at, level: if high { Level::High } else { Level::Low } });
        prop::collection::vec(edge, 1..12).prop_map(|mut edges| {
            edges.sort_by_key(|edge| edge.at);
            edges
        })
    }

    fn outputs() -> impl Strategy<Value = PinOutput> {
        prop_oneof![
            any::<bool>().prop_map(|high| PinOutput::Level(if high { Level::High } else { Level::Low })),
            (at(), any::<[u64; 4]>()).prop_map(|(first, [nanos, per, count, high])| {
                PinOutput::Pulses(Train { first, nanos, per, count, high: Span::from_nanos(high) })
            }),
        ]
    }

    fn facts() -> impl Strategy<Value = Fact> {
        prop_oneof![
            (0..8usize, edges()).prop_map(|(line, edges)| Fact::Edges { line, edges }),
            (0..5usize, at(), any::<u8>(), any::<i64>()).prop_map(|(node, at, signal, value)| Fact::Telemetry {
                node,
                at,
                signal,
                value
            }),
            (0..5usize, at(), any::<u8>(), any::<i64>()).prop_map(|(node, at, event, value)| Fact::Event {
                node,
                at,
                event,
                value
            }),
            (0..5usize, at(), any::<u8>(), outputs()).prop_map(|(node, at, pin, what)| Fact::Pin {
                node,
                at,
                pin,
                what: match what {
                    PinOutput::Pulses(train) => PinOutput::Pulses(Train { first: train.first.max(at), ..train }),
                    level => level,
                },
            }),
        ]
    }

    fn disturbances() -> impl Strategy<Value = Disturbance> {
        let span = || any::<u32>().prop_map(|ns| Span::from_nanos(u64::from(ns)));
        let tampering = prop_oneof![
            any::<u8>().prop_map(Tampering::Flip),
            (any::<u8>(), span()).prop_map(|(edge, by)| Tampering::Delay { edge, by }),
            Just(Tampering::Drop),
            Just(Tampering::Double),
        ];
        prop_oneof![
            Just(Disturbance::Cut),
            prop_oneof![Just(Level::Low), Just(Level::High)].prop_map(Disturbance::Stuck),
            (0..7usize).prop_map(Disturbance::Short),
            (span(), span(), any::<u64>()).prop_map(|(period, width, seed)| Disturbance::Noise { period, width, seed }),
            (any::<u64>(), tampering).prop_map(|(nth, what)| Disturbance::Character { nth, what }),
        ]
    }

    fn inputs() -> impl Strategy<Value = Input> {
        let stimulus = prop_oneof![
            any::<bool>().prop_map(Stimulus::Hang),
            any::<bool>().prop_map(Stimulus::Stop),
            any::<bool>().prop_map(|value| MotorStimulus::Stall(value).of(0)),
            Just(Stimulus::Reset),
            Just(Stimulus::Discard),
            any::<bool>().prop_map(Stimulus::Power),
            any::<u32>().prop_map(|ns| Stimulus::Slow(Span::from_nanos(u64::from(ns)))),
            any::<i32>().prop_map(|value| MotorStimulus::Counts(value).of(0)),
            any::<i32>().prop_map(|value| MotorStimulus::Load(value).of(0)),
            any::<u16>().prop_map(|value| MotorStimulus::Supply(value).of(0)),
            any::<u16>().prop_map(|value| MotorStimulus::Backlash(value).of(0)),
            any::<i32>().prop_map(|value| MotorStimulus::EndStop(value).of(0)),
            any::<i32>().prop_map(|value| MotorStimulus::Drive(value).of(0)),
            (any::<u8>(), any::<i32>()).prop_map(|(motor, load)| MotorStimulus::Load(load).of(motor)),
            prop::collection::vec(any::<u8>(), 0..20).prop_map(Stimulus::Write),
            (any::<u32>(), any::<bool>()).prop_map(|(baud, ixon)| Stimulus::Configure { baud, ixon }),
            any::<bool>().prop_map(Stimulus::Break),
            Just(Stimulus::Format(Format { parity: Parity::Even, ..Format::EIGHT_N_ONE })),
        ];
        let what = prop_oneof![
            (0..5usize, stimulus).prop_map(|(board, stimulus)| InputKind::Stimulus { board, stimulus }),
            (0..8usize, any::<u32>(), disturbances())
                .prop_map(|(line, fault, disturbance)| (line, fault, disturbance))
                .prop_filter("a line does not touch itself", |(line, _, what)| *what != Disturbance::Short(*line))
                .prop_map(|(line, fault, disturbance)| InputKind::Disturbed { line, fault, disturbance }),
            (0..8usize, any::<u32>()).prop_map(|(line, fault)| InputKind::Healed { line, fault }),
            (0..5usize, at()).prop_map(|(board, told)| InputKind::Stopped { board, told }),
            (0..5usize).prop_map(|board| InputKind::Continued { board }),
            (0..5usize, at()).prop_map(|(board, told)| InputKind::Died { board, told }),
        ];
        (at(), at(), what).prop_map(|(given, at, what)| Input { given, at, what })
    }

    fn traces() -> impl Strategy<Value = Trace> {
        let facts = prop::collection::vec(facts(), 0..40);
        let inputs = prop::collection::vec(inputs(), 0..20);
        (facts, inputs, at()).prop_map(|(facts, inputs, settled)| Trace {
            facts,
            inputs,
            settled,
            end: Some(End { digest: "8ae9".to_owned(), at: settled, outcome: "completed".to_owned() }),
            ..Trace::new(header())
        })
    }

    /// Written with a flush after every `chunk` entries.
    fn written(trace: &Trace, chunk: usize) -> Vec<u8> {
        let mut file = Vec::new();
        let mut writer = Writer::new(&mut file, &trace.header).unwrap();
        for inputs in trace.inputs.chunks(chunk) {
            writer.note(inputs, &[], Instant::START).unwrap();
            writer.flush().unwrap();
        }
        for facts in trace.facts.chunks(chunk) {
            writer.note(&[], facts, trace.settled).unwrap();
            writer.flush().unwrap();
        }
        writer.finish(trace.end.as_ref().unwrap()).unwrap();
        file
    }

    /// Whether all of `part` is what `whole` begins with.
    fn begins(whole: &Trace, part: &Trace) -> bool {
        whole.facts.starts_with(&part.facts) && whole.inputs.starts_with(&part.inputs)
    }

    fn small() -> Trace {
        let fact = |n: u64| Fact::Event { node: 1, at: Instant::from_nanos(100 * n), event: 2, value: -3 };
        let input = Input {
            given: Instant::START,
            at: Instant::from_nanos(5),
            what: InputKind::Stimulus { board: 4, stimulus: Stimulus::Write(vec![1, 2]) },
        };
        Trace {
            facts: (0..6).map(fact).collect(),
            inputs: vec![input],
            settled: Instant::from_nanos(501),
            end: Some(End { digest: "d".to_owned(), at: Instant::from_nanos(501), outcome: "completed".to_owned() }),
            ..Trace::new(header())
        }
    }

    /// Byte-exact: if this fails, the version must change, not the test.
    #[test]
    fn a_block_byte_for_byte() {
        let mut file = Vec::new();
        let mut writer = Writer::new(&mut file, &header()).unwrap();
        writer.finish(&small().end.unwrap()).unwrap();
        let without = file.len();
        let end = file.split_off(without - (PREFIX + 15));
        assert_eq!(end[PREFIX..], *b"\x02\x01d\xf5\x03\x09completed");

        let mut file = Vec::new();
        let mut writer = Writer::new(&mut file, &header()).unwrap();
        let edge = |at, level| Edge { at: Instant::from_nanos(at), level };
        let edges = Fact::Edges { line: 2, edges: vec![edge(300, Level::Low), edge(310, Level::High)] };
        let telemetry = Fact::Telemetry { node: 3, at: Instant::from_nanos(299), signal: 4, value: 6 };
        let facts = [small().facts[1].clone(), edges, telemetry];
        writer.note(&small().inputs, &facts, Instant::from_nanos(400)).unwrap();
        writer.flush().unwrap();
        let expected = [
            &[1, 0x90, 1, 0, 0, 0, 0, 0, 0][..],
            &[3, 10, 0, 0, 4, 3, 2, 1, 2],
            &[2 | 1 << 3, 0xbe, 1, 2, 5],
            &[2 << 3, 0x90, 3, 2, 0, 21],
            &[1 | 3 << 3, 1, 4, 12],
        ];
        assert_eq!(file[file.len() - expected.concat().len()..], expected.concat());
    }

    #[test]
    fn a_trace_cut_anywhere_is_read_up_to_there() {
        let trace = small();
        let file = written(&trace, 2);
        let mut lengths = Vec::new();
        for length in 0..file.len() {
            match read(&file[..length]) {
                Ok((part, damage)) => {
                    assert!(matches!(damage, Some(Damage::Truncated { .. } | Damage::NoEnd)), "{length}: {damage:?}");
                    assert!(begins(&trace, &part) && part.end.is_none());
                    lengths.push(part.facts.len());
                }
                Err(Damage::Foreign) => assert!(length < MAGIC.len(), "{length}"),
                Err(damage) => assert!(matches!(damage, Damage::Truncated { .. }), "{length}: {damage:?}"),
            }
        }
        lengths.dedup();
        assert_eq!(lengths, [0, 2, 4, 6]);
    }

    #[test]
    fn a_change_anywhere_is_noticed() {
        let trace = small();
        let file = written(&trace, 2);
        for bit in 0..8 * file.len() {
            let mut changed = file.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            match read(&changed[..]) {
                Ok((part, damage)) => assert!(damage.is_some() && begins(&trace, &part), "bit {bit}"),
                Err(damage) => assert!(!matches!(damage, Damage::Unreadable(_)), "bit {bit}"),
            }
        }
    }

    #[test]
    fn blocks_out_of_place_are_noticed() {
        let trace = small();
        let file = written(&trace, 6);
        let inputs_and_end = {
            // The block with the facts is the last but one: leave it out.
            let short = written(&Trace { facts: Vec::new(), ..trace.clone() }, 6);
            let end = PREFIX + 15;
            [&short[..short.len() - end], &file[file.len() - end..]].concat()
        };
        assert!(matches!(read(&inputs_and_end[..]), Ok((_, Some(Damage::Corrupt { .. })))));
        let twice = [&file[..], &file[file.len() - 27..]].concat();
        assert!(matches!(read(&twice[..]), Ok((_, Some(Damage::Corrupt { .. })))));
    }

    /// A trace of nothing that begins with this header.
    fn headed(header: &[u8]) -> Vec<u8> {
        let payload = [&[format::HEADER][..], header].concat();
        let length = u32::try_from(payload.len()).unwrap().to_le_bytes();
        let checksum = xxh3_64_with_seed(&payload, 0).to_le_bytes();
        [&MAGIC[..], &VERSION.to_le_bytes(), &length, &checksum, &payload].concat()
    }

    #[test]
    fn a_header_without_receivers_takes_those_of_the_same_rig_today() {
        let file = headed(&postcard::to_allocvec(&header()).unwrap());
        let mut today = layout();
        today.boards[3].kind = "another".to_owned();
        let (trace, _) =
            super::read(&file[..], |rig, _| (rig == "star").then(|| (today.clone(), String::new()))).unwrap();
        let expected = |n: usize| if n == 3 { Vec::new() } else { today.boards[n].receivers.clone() };
        (0..5).for_each(|n| assert_eq!(trace.header.layout.boards[n].receivers, expected(n), "{n}"));
        let lines = &trace.header.layout.lines;
        let hardware = ReceiverKind::Hardware { baud: Rate::hz(9600) };
        assert_eq!(
            [1, 4].map(|line| trace.header.layout.receiver(&lines[line])),
            [ReceiverKind::Software { baud: Rate::hz(9600), link: 0 }, hardware]
        );
        let (trace, _) = read(&file).unwrap();
        assert!(trace.header.layout.boards.iter().all(|board| board.receivers.is_empty()));
    }

    #[test]
    fn receivers_that_do_not_fit_the_ports_are_damage() {
        let with = |receivers: &[Vec<ReceiverKind>]| {
            let header = postcard::to_allocvec(&header()).unwrap();
            read(&headed(&[header, postcard::to_allocvec(receivers).unwrap()].concat()))
        };
        let kind = ReceiverKind::Hardware { baud: Rate::hz(0) };
        assert!(with(&vec![vec![kind; 4]; 5]).is_ok() && with(&vec![Vec::new(); 5]).is_ok());
        for receivers in [vec![vec![kind; 4]; 4], vec![vec![kind; 3]; 5], vec![vec![kind; 5]; 5]] {
            assert!(matches!(with(&receivers), Err(Damage::Corrupt { .. })), "{receivers:?}");
        }
    }

    #[test]
    fn a_newer_version_is_named() {
        let mut file = written(&small(), 2);
        file[MAGIC.len()] = 9;
        assert!(matches!(read(&file[..]), Err(Damage::Version(9))));
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(trace in traces(), chunk in 1..30usize) {
            let (read, damage) = read(&written(&trace, chunk)[..]).unwrap();
            prop_assert!(damage.is_none());
            let settled = if trace.facts.is_empty() { Instant::START } else { trace.settled };
            prop_assert_eq!(read, Trace { settled, ..trace });
        }

        /// Whatever a sound file says, it can be shown and compared.
        #[test]
        fn any_trace_is_shown_and_compared(a in traces(), mut b in traces()) {
            b.header.layout.lines.pop();
            b.facts.retain(|fact| !matches!(fact, Fact::Edges { line: 7, .. }));
            let on_line_7 = |what: &InputKind| match what {
                InputKind::Disturbed { line, .. } | InputKind::Healed { line, .. } => *line == 7,
                _ => false,
            };
            b.inputs.retain(|input| !on_line_7(&input.what));
            for trace in [&a, &b] {
                let kinds = ["edges", "characters", "frames", "telemetry", "events", "inputs", "pins"];
                let wanted = Wanted { kinds: kinds.map(str::to_owned).to_vec(), ..Wanted::default() };
                let filter = Filter::new(&trace.header, &wanted).unwrap();
                let rows = rows(trace, &filter, |_| None);
                prop_assert!(rows.is_sorted_by_key(|row| row.at));
                prop_assert!(rows.len() >= trace.inputs.len() + trace.facts.len());
                for row in rows {
                    let _ = (row.text(&trace.header, true), row.csv(&trace.header));
                    prop_assert_eq!(row.json(&trace.header)["ns"].as_u64(), Some(row.at.as_nanos()));
                }
            }
            prop_assert_eq!(first_difference(&a, &a, Extent::Whole, |_| None), None);
            let difference = first_difference(&a, &b, Extent::Whole, |_| None);
            prop_assert_eq!(difference.is_none(), a.facts.is_empty() && b.facts.is_empty());
            let _ = difference.map(|difference| (difference.text("a", "b"), difference.json()));
        }

        #[test]
        fn any_bytes_are_read_or_refused(
            bytes in prop::collection::vec(any::<u8>(), 0..200),
            settled: u64,
        ) {
            prop_assert!(read(&bytes[..]).is_err());
            // The same with a good checksum.
            let mut trace = Trace::new(header());
            let payload = [&[format::ENTRIES][..], &settled.to_le_bytes(), &bytes].concat();
            for what in [format::what, v3::what] {
                let _ = add(&payload, &mut trace, what);
            }
            for kind in [format::HEADER, format::END] {
                let _ = add(&[&[kind][..], &bytes].concat(), &mut trace, format::what);
            }
        }
    }
}
