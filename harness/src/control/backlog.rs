//! What is told to somebody who watches, from when it is told until it is read.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bytes::BytesMut;
use serde_json::json;
use tokio::sync::Notify;

use crate::backlog::Backlog;

/// So many bytes wait for a reader. (Ours: some 40 000 rows; whoever is further behind does not keep up.)
pub(super) const ROOM: usize = 4 << 20;
/// So many bytes are handed out at once, or one row that is longer.
const HELPING: usize = 64 << 10;

#[derive(Debug)]
struct Shared {
    /// None, if no one reads any more.
    backlog: Mutex<Option<Backlog>>,
    news: Notify,
}

impl Shared {
    fn backlog(&self) -> MutexGuard<'_, Option<Backlog>> {
        self.backlog.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Where rows go. Never waits: what a reader has no room for is lost, and it is told how many.
#[derive(Clone, Debug)]
pub struct Rows(Arc<Shared>);

/// Where they come out.
#[derive(Debug)]
pub struct ToTell(Arc<Shared>);

/// The row that stands for so many lost ones.
pub(super) fn lost(lost: u64) -> String {
    format!("{}\n", json!({ "lost": lost }))
}

/// A way for rows: so many bytes wait at the most, and a note stands for those that are lost.
pub fn backlog(room: usize, note: fn(u64) -> String) -> (Rows, ToTell) {
    let backlog = Backlog::new(room, note);
    let shared = Arc::new(Shared { backlog: Mutex::new(Some(backlog)), news: Notify::new() });
    (Rows(Arc::clone(&shared)), ToTell(shared))
}

impl Rows {
    /// A way that leads nowhere, for requests on whose answer nothing follows.
    pub fn nowhere() -> Self {
        Self(Arc::new(Shared { backlog: Mutex::new(None), news: Notify::new() }))
    }

    /// Tells a row, without the end of its line.
    pub fn tell(&self, row: String) {
        if let Some(backlog) = &mut *self.0.backlog() {
            backlog.push((row + "\n").as_bytes());
        }
        self.0.news.notify_one();
    }

    /// Whether no one reads them any more.
    pub fn is_closed(&self) -> bool {
        self.0.backlog().is_none()
    }
}

impl ToTell {
    /// Waits for the next lines. `{"lost": n}` stands where `n` rows would. Cancel-safe.
    pub async fn next(&mut self) -> BytesMut {
        loop {
            match self.try_next() {
                Some(lines) => return lines,
                None => self.0.news.notified().await,
            }
        }
    }

    /// The next lines, if there are some by now.
    pub fn try_next(&mut self) -> Option<BytesMut> {
        self.0.backlog().as_mut().and_then(|backlog| backlog.take(HELPING))
    }
}

impl Drop for ToTell {
    fn drop(&mut self) {
        *self.0.backlog() = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn rows_come_in_order_until_nobody_reads_them() {
        let (rows, mut to_tell) = backlog(ROOM, lost);
        rows.tell("a".to_owned());
        rows.tell("b".to_owned());
        assert_eq!(to_tell.next().await, "a\nb\n");
        assert!(!rows.is_closed());
        drop(to_tell);
        assert!(rows.is_closed());
    }

    #[tokio::test]
    async fn a_reader_who_does_not_read_costs_no_more_than_the_room() {
        let (rows, mut to_tell) = backlog(ROOM, lost);
        let row = "x".repeat(99);
        (0..ROOM / 100 + 5).for_each(|_| rows.tell(row.clone()));
        let (mut bytes, mut last) = (0, BytesMut::new());
        while bytes < ROOM / 100 * 100 {
            last = to_tell.next().await;
            bytes += last.len();
            assert!(last.len() <= HELPING);
        }
        assert_eq!((bytes, last.ends_with(b"x\n")), (ROOM / 100 * 100, true));
        assert_eq!(to_tell.next().await, "{\"lost\":5}\n");
    }
}
