//! What all browsers are told: one look at the rig for all, and a queue for each.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use bytes::Bytes;
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::sync::mpsc::{Receiver, Sender, channel};
use tokio::sync::{Notify, Semaphore, watch};
use tokio::time::{MissedTickBehavior, interval};

use super::past::{self, Kind, Past};
use crate::control::{Asker, Form, Request, Rows, ToTell, backlog};

/// The rig is looked at so often while somebody looks at the page: 25 times a second.
const LOOK: Duration = Duration::from_millis(40);
/// The part changes slowly, and its outline is long: it is told at every so many looks.
const LOOKS_PER_PART: u64 = 8;
/// Where nothing changes, a browser is told so at every so many looks: it sees that the rig is there.
const LOOKS_AT_LEAST: u64 = 25;
/// So many rows go with a look at the most, and so many of quantities: the last ones. (Ours: more than a person reads
/// in a second.)
const ROWS: usize = 300;
/// What a row of a quantity has in it.
const TELEMETRY: &str = "\"kind\":\"telemetry\"";
/// So many bytes wait for a browser: some seconds of a busy rig. (Ours.)
const ROOM: usize = 256 << 10;
/// What the page shows of what happens.
const KINDS: [&str; 5] = ["characters", "frames", "telemetry", "events", "inputs"];

/// Tells all browsers.
#[derive(Debug)]
pub(super) struct Hub {
    /// What each is told first: what the rig consists of.
    hello: String,
    turns: bool,
    /// The rig is looked at from the start, although nobody looks at the page yet.
    from_start: bool,
    /// What was told last of the part.
    part: Mutex<String>,
    browsers: Mutex<Vec<Rows>>,
    news: Notify,
    /// What was told.
    past: Mutex<Past>,
    /// Nothing more is told.
    over: watch::Sender<bool>,
    /// So many have asked for the past since then.
    asked: Semaphore,
}

/// What is wanted of the answer to [`Request::State`].
#[derive(Deserialize)]
struct Answered {
    ok: Now,
}

#[derive(Deserialize)]
struct Now {
    ns: u64,
}

/// What is told is an event that the server sends (WHATWG HTML, 9.2). `data` has no end of line in it.
fn event(kind: &str, data: &str) -> String {
    format!("event: {kind}\ndata: {data}\n")
}

fn held<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Hub {
    /// A hub of the rig that is described so. It may turn a part; and nothing is to be missed of it, although nobody
    /// looks at the page yet.
    pub(super) fn new(rig: &Value, turns: bool, from_start: bool) -> Self {
        let hello = event("rig", &rig.to_string());
        let (part, browsers) = (Mutex::new(String::new()), Mutex::new(Vec::new()));
        let past = Mutex::new(Past::new(past::ROOM));
        let (news, over, asked) = (Notify::new(), watch::Sender::new(false), Semaphore::new(0));
        Self { hello, turns, from_start, part, browsers, news, past, over, asked }
    }

    fn browsers(&self) -> MutexGuard<'_, Vec<Rows>> {
        held(&self.browsers)
    }

    /// What a browser is told from now on.
    pub(super) fn tell(&self) -> Receiver<Bytes> {
        let (rows, to_tell) = backlog(ROOM, |lost| event("lost", &lost.to_string()) + "\n");
        rows.tell(self.hello.clone());
        let part = held(&self.part).clone();
        if !part.is_empty() {
            rows.tell(part);
        }
        self.browsers().push(rows);
        self.news.notify_one();
        let (sender, receiver) = channel(1);
        tokio::spawn(hand_on(to_tell, sender, self.over.subscribe()));
        receiver
    }

    /// Tells everybody who still listens. Says whether anybody does.
    fn tell_all(&self, text: &str) -> bool {
        let mut browsers = self.browsers();
        browsers.retain(|rows| !rows.is_closed());
        browsers.iter().for_each(|rows| rows.tell(text.to_owned()));
        !browsers.is_empty()
    }

    /// Tells everybody how it has ended, and nothing more. Says how many listen.
    pub(super) fn end(&self, outcome: &str) -> u32 {
        self.tell_all(&event("end", &json!({ "outcome": outcome }).to_string()));
        self.over.send_replace(true);
        self.browsers().len() as u32
    }

    /// Waits until so many have asked for the past since the end: then they have what they can show of it.
    pub(super) async fn wait_for_askers(&self, count: u32) {
        drop(self.asked.acquire_many(count).await);
    }

    /// The rig as it was at an instant.
    pub(super) fn past(&self, ns: u64) -> String {
        if *self.over.borrow() {
            self.asked.add_permits(1);
        }
        held(&self.past).until(ns)
    }

    /// Tells everybody of this instant, and keeps that. Says whether anybody listens.
    fn tell_and_keep(&self, ns: u64, kind: Kind, data: String) -> bool {
        let name = match kind {
            Kind::Look => "look",
            Kind::Part => "part",
        };
        let told = self.tell_all(&event(name, &data));
        held(&self.past).keep(ns, kind, data);
        told
    }

    /// Looks at the rig for as long as it is there.
    pub(super) async fn run(&self, asker: &Asker) {
        while !asker.is_over() {
            if self.browsers().is_empty() && !self.from_start {
                tokio::select! {
                    () = self.news.notified() => {}
                    () = asker.ended() => return,
                }
            }
            self.look(asker).await;
        }
    }

    /// Looks at the rig for as long as somebody looks at the page, or nothing is to be missed.
    async fn look(&self, asker: &Asker) {
        let (rows, mut to_tell) = backlog(ROOM, |lost| format!("{{\"lost\":{lost}}}\n"));
        let kinds = KINDS.map(str::to_owned).to_vec();
        let watch = Request::Watch { lines: Vec::new(), boards: Vec::new(), kinds, form: Form::Json };
        let watched = asker.ask(watch, &rows).await;
        if watched.contains("\"error\"") && !asker.is_over() {
            tracing::warn!("the page shows no messages: {watched}");
        }
        let nothing = Rows::nowhere();
        let mut happened = Happened::default();
        let mut looks = interval(LOOK);
        looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut state = String::new();
        for look in 0_u64.. {
            loop {
                tokio::select! {
                    lines = to_tell.next() => happened.note(&lines),
                    _ = looks.tick() => break,
                }
            }
            let mut now = asker.ask(Request::State, &nothing).await;
            let ending = asker.ending();
            if asker.is_over() && ending.is_none() {
                return;
            }
            if let Some(ending) = ending {
                while let Some(lines) = to_tell.try_next() {
                    happened.note(&lines);
                }
                now.clone_from(&ending.state);
            }
            let ns = serde_json::from_str::<Answered>(&now).map_or(0, |answered| answered.ok.ns);
            let same = now == state && happened.is_empty() && look % LOOKS_AT_LEAST != 0;
            state = now;
            if !same {
                let data = happened.take(&state, &held(&self.past).extent());
                if !self.tell_and_keep(ns, Kind::Look, data) && !self.from_start {
                    return;
                }
            }
            if self.turns && (look % LOOKS_PER_PART == 0 || ending.is_some()) {
                let now = match ending.and_then(|ending| ending.part.clone()) {
                    Some(part) => part,
                    None => asker.ask(Request::Part, &nothing).await,
                };
                let part = event("part", &now);
                if part != *held(&self.part) {
                    self.tell_and_keep(ns, Kind::Part, now);
                    *held(&self.part) = part;
                }
            }
            if asker.is_over() {
                return;
            }
        }
    }
}

/// Hands what waits for a browser to its connection, as fast as that takes it.
async fn hand_on(mut to_tell: ToTell, sender: Sender<Bytes>, mut over: watch::Receiver<bool>) {
    loop {
        let lines = tokio::select! {
            lines = to_tell.next() => lines,
            () = async { drop(over.wait_for(|over| *over).await) } => match to_tell.try_next() {
                Some(lines) => lines,
                None => return,
            },
            () = sender.closed() => return,
        };
        if sender.send(lines.freeze()).await.is_err() {
            return;
        }
    }
}

/// The rows since the last look.
#[derive(Debug, Default)]
struct Happened {
    rows: VecDeque<String>,
    /// Those of quantities. Of what is drawn of them nothing is to be missing because many characters passed.
    quantities: VecDeque<String>,
    /// So many came before, and are not told.
    left_out: usize,
}

impl Happened {
    fn note(&mut self, lines: &[u8]) {
        for line in String::from_utf8_lossy(lines).lines() {
            let rows = if line.contains(TELEMETRY) { &mut self.quantities } else { &mut self.rows };
            rows.push_back(line.to_owned());
            if rows.len() > ROWS {
                rows.pop_front();
                self.left_out += 1;
            }
        }
    }

    fn is_empty(&self) -> bool {
        self.rows.is_empty() && self.quantities.is_empty()
    }

    /// What a browser is told of this look, and of how much is kept.
    fn take(&mut self, state: &str, kept: &Value) -> String {
        let Self { rows, mut quantities, left_out } = core::mem::take(self);
        quantities.extend(rows);
        let rows: Vec<String> = quantities.into();
        let rows = rows.join(",");
        format!("{{\"state\":{state},\"kept\":{kept},\"left_out\":{left_out},\"rows\":[{rows}]}}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_rows_the_last_are_told_and_the_others_counted() {
        let mut happened = Happened::default();
        (0..ROWS + 7).for_each(|n| happened.note(format!("{n}\n").as_bytes()));
        let told: Value = serde_json::from_str(&happened.take("{\"ok\":1}", &Value::Null)).unwrap();
        assert_eq!((told["left_out"].as_u64(), told["rows"].as_array().unwrap().len()), (Some(7), ROWS));
        assert_eq!((told["rows"][0].as_u64(), told["state"]["ok"].as_u64()), (Some(7), Some(1)));
        // Many characters leave the quantities their room.
        happened.note(b"{\"kind\":\"telemetry\",\"value\":7}\n");
        (0..2 * ROWS).for_each(|n| happened.note(format!("{n}\n").as_bytes()));
        let told: Value = serde_json::from_str(&happened.take("{\"ok\":1}", &Value::Null)).unwrap();
        assert_eq!((told["left_out"].as_u64(), told["rows"][0]["value"].as_u64()), (Some(300), Some(7)));
        assert_eq!(happened.take("1", &Value::Null), "{\"state\":1,\"kept\":null,\"left_out\":0,\"rows\":[]}");
    }

    #[tokio::test]
    async fn a_browser_that_does_not_read_costs_its_room_and_is_told_what_it_lost() {
        let hub = Hub::new(&Value::Null, false, false);
        let mut stalled = hub.tell();
        let long = event("look", &"x".repeat(1_000));
        let told = 2 * ROOM / long.len();
        for _ in 0..told {
            assert!(hub.tell_all(&long));
            tokio::task::yield_now().await;
        }
        let (mut bytes, mut last) = (0, Bytes::new());
        while !last.ends_with(b"\n\n") || !String::from_utf8_lossy(&last).contains("event: lost\n") {
            last = stalled.recv().await.unwrap();
            bytes += last.len();
        }
        assert!(bytes <= ROOM + (128 << 10), "{bytes}");
        let lost: usize = String::from_utf8_lossy(&last).rsplit("data: ").next().unwrap().trim().parse().unwrap();
        assert!(lost > told / 4 && lost < told, "{lost}");
        drop(stalled);
        tokio::task::yield_now().await;
        tokio::task::yield_now().await;
        assert!(!hub.tell_all("x"), "nobody listens any more");
    }
}
