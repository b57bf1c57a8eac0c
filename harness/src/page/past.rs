//! What browsers were told lately, so that they can show the rig as it was: bounded, and the oldest is dropped.

use std::borrow::Cow;
use std::collections::VecDeque;

use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::{Value, json};

/// So many bytes are kept. (Ours: half an hour of the lathe's demonstration at pace 1.)
pub(super) const ROOM: usize = 64 << 20;
/// So many bytes at the most are given of what was told before an instant. (Ours: more than is drawn of it.)
const GIVEN: usize = 4 << 20;
/// What it costs to keep something, beside its text. (A guess that is too high.)
const EACH: usize = 64;

/// What is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// A look at the rig: how it is, and what has happened.
    Look,
    /// What has been made of the bar.
    Part,
}

/// What was told, the oldest first.
#[derive(Debug)]
pub(super) struct Past {
    told: VecDeque<Told>,
    bytes: usize,
    room: usize,
    /// What was told of the part before the oldest that is kept.
    part: Option<String>,
}

#[derive(Debug)]
struct Told {
    /// How far time had gone.
    ns: u64,
    kind: Kind,
    data: String,
}

impl Told {
    const fn bytes(&self) -> usize {
        self.data.len() + EACH
    }
}

/// The request for the rig as it was at an instant.
const NAME: &str = "past";

/// Which request it is. A long one is looked through, not copied.
#[derive(Deserialize)]
struct Named<'a> {
    #[serde(rename = "do", borrow)]
    name: Cow<'a, str>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Asked {
    #[serde(rename = "do")]
    _name: IgnoredAny,
    ns: u64,
}

/// The instant of the past that a browser asks for, or what is wrong with it. None, if it asks the rig for something.
pub(super) fn asked(request: &str) -> Option<serde_json::Result<u64>> {
    let named: Named<'_> = serde_json::from_str(request).ok()?;
    (named.name == NAME).then(|| serde_json::from_str(request).map(|Asked { ns, .. }| ns))
}

impl Past {
    /// One with room for so many bytes.
    pub(super) const fn new(room: usize) -> Self {
        Self { told: VecDeque::new(), bytes: 0, room, part: None }
    }

    /// Keeps what is told of this instant.
    pub(super) fn keep(&mut self, ns: u64, kind: Kind, data: String) {
        let told = Told { ns, kind, data };
        self.bytes += told.bytes();
        self.told.push_back(told);
        while self.bytes > self.room
            && let Some(oldest) = self.told.pop_front()
        {
            self.bytes -= oldest.bytes();
            if oldest.kind == Kind::Part {
                self.part = Some(oldest.data);
            }
        }
    }

    /// How much is kept, and from when on.
    pub(super) fn extent(&self) -> Value {
        let from = self.told.iter().find(|told| told.kind == Kind::Look).map(|told| told.ns);
        json!({ "from": from, "bytes": self.bytes, "room": self.room })
    }

    /// What was told up to `ns`, as far back as it is given: the looks in order, and the part as it was.
    pub(super) fn until(&self, ns: u64) -> String {
        let end = self.told.partition_point(|told| told.ns <= ns);
        let mut bytes = 0;
        let given = self.told.range(..end).rev().filter(|told| told.kind == Kind::Look);
        let mut looks: Vec<&str> = given
            .take_while(|told| {
                bytes += told.data.len();
                bytes <= GIVEN
            })
            .map(|told| told.data.as_str())
            .collect();
        looks.reverse();
        let part = self.told.range(..end).rev().find(|told| told.kind == Kind::Part).map(|told| &told.data);
        let part = part.or(self.part.as_ref()).map_or("null", String::as_str);
        format!("{{\"ok\":{{\"looks\":[{}],\"part\":{part}}}}}", looks.join(","))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn look(ns: u64) -> String {
        format!("{{\"n\":{ns},\"text\":\"{}\"}}", "x".repeat(100))
    }

    /// Of these instants, looks; a part at each fourth.
    fn past(room: usize, instants: u64) -> Past {
        let mut past = Past::new(room);
        for ns in 0..instants {
            past.keep(ns, Kind::Look, look(ns));
            if ns % 4 == 0 {
                past.keep(ns, Kind::Part, ns.to_string());
            }
        }
        past
    }

    fn given(past: &Past, ns: u64) -> (Vec<u64>, Value) {
        let mut answer: Value = serde_json::from_str(&past.until(ns)).unwrap();
        let looks = answer["ok"]["looks"].as_array().unwrap().iter();
        (looks.map(|look| look["n"].as_u64().unwrap()).collect(), answer["ok"]["part"].take())
    }

    #[test]
    fn the_rig_is_shown_as_it_was() {
        let past = past(ROOM, 20);
        assert_eq!(given(&past, 6), ((0..=6).collect(), json!(4)));
        assert_eq!(given(&past, u64::MAX), ((0..20).collect(), json!(16)));
        assert_eq!(given(&Past::new(ROOM), 6), (Vec::new(), Value::Null));
        assert_eq!(asked(r#"{"do":"past","ns":6}"#).unwrap().unwrap(), 6);
        assert!(asked(r#"{"do":"past","ns":-6}"#).unwrap().is_err());
        assert!(asked(r#"{"do":"fault","fault":"x"}"#).is_none());
    }

    #[test]
    fn no_more_is_kept_than_there_is_room_for_and_the_oldest_is_dropped() {
        let room = 10 * (look(100).len() + EACH);
        let past = past(room, 200);
        assert!(past.bytes <= room && past.bytes > room / 2, "{}", past.bytes);
        let held: usize = past.told.iter().map(Told::bytes).sum();
        assert_eq!(past.bytes, held);
        let (looks, part) = given(&past, u64::MAX);
        let from = past.extent()["from"].as_u64().unwrap();
        assert!(from > 185, "{from}");
        assert_eq!((looks, part), ((from..200).collect(), json!(196)));
        // The part is as it was, although it was told before the oldest that is kept.
        assert_eq!(given(&past, from).1, json!(from / 4 * 4));
        assert_eq!(given(&past, 3).0, [0; 0]);
        assert_eq!(
            (past.extent()["bytes"].as_u64(), past.extent()["room"].as_u64()),
            (Some(held as u64), Some(room as u64))
        );
    }

    #[test]
    fn what_lies_far_back_is_not_given_at_once() {
        let mut past = Past::new(ROOM);
        let long = "x".repeat(1 << 20);
        (0..20).for_each(|ns| past.keep(ns, Kind::Look, format!("{{\"n\":{ns},\"text\":\"{long}\"}}")));
        assert_eq!(given(&past, 12).0, [10, 11, 12]);
    }
}
