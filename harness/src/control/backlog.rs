//! What is told to somebody who watches, from when it is told until it is read.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde_json::json;
use tokio::sync::Notify;

/// So many bytes wait for a reader. (Ours: some 150 000 rows; whoever is further behind does not keep up.)
const ROOM: usize = 16 << 20;
/// So many bytes are handed out at once, and one row more.
const HELPING: usize = 64 << 10;

/// Rows that wait, and how many have been lost between them.
#[derive(Debug, Default)]
struct Backlog {
    waiting: VecDeque<Waiting>,
    bytes: usize,
    /// Nobody reads any more.
    closed: bool,
}

#[derive(Debug)]
enum Waiting {
    Row(String),
    Lost(u64),
}

impl Backlog {
    fn push(&mut self, row: String, room: usize) {
        if self.bytes + row.len() <= room {
            self.bytes += row.len();
            self.waiting.push_back(Waiting::Row(row));
        } else if let Some(Waiting::Lost(lost)) = self.waiting.back_mut() {
            *lost += 1;
        } else {
            self.waiting.push_back(Waiting::Lost(1));
        }
    }

    /// The next lines; none, if nothing waits.
    fn take(&mut self) -> Option<String> {
        let mut lines = String::new();
        while lines.len() < HELPING
            && let Some(next) = self.waiting.pop_front()
        {
            match next {
                Waiting::Row(row) => {
                    self.bytes -= row.len();
                    lines += &row;
                }
                Waiting::Lost(lost) => lines += &json!({ "lost": lost }).to_string(),
            }
            lines.push('\n');
        }
        (!lines.is_empty()).then_some(lines)
    }
}

#[derive(Debug, Default)]
struct Shared {
    backlog: Mutex<Backlog>,
    news: Notify,
}

impl Shared {
    fn backlog(&self) -> MutexGuard<'_, Backlog> {
        self.backlog.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Where rows go. Never waits: what a reader has no room for is lost, and it is told how many.
#[derive(Clone, Debug)]
pub struct Rows(Arc<Shared>);

/// Where they come out.
#[derive(Debug)]
pub(super) struct ToTell(Arc<Shared>);

/// A way for rows.
pub(super) fn backlog() -> (Rows, ToTell) {
    let shared = Arc::new(Shared::default());
    (Rows(Arc::clone(&shared)), ToTell(shared))
}

impl Rows {
    /// Tells a row, without the end of its line.
    pub fn tell(&self, row: String) {
        self.0.backlog().push(row, ROOM);
        self.0.news.notify_one();
    }

    /// Whether nobody reads them any more.
    pub fn is_closed(&self) -> bool {
        self.0.backlog().closed
    }
}

impl ToTell {
    /// Waits for the next lines. `{"lost": n}` stands where `n` rows would. Cancel-safe.
    pub(super) async fn next(&mut self) -> String {
        loop {
            let lines = self.0.backlog().take();
            match lines {
                Some(lines) => return lines,
                None => self.0.news.notified().await,
            }
        }
    }
}

impl Drop for ToTell {
    fn drop(&mut self) {
        *self.0.backlog() = Backlog { closed: true, ..Backlog::default() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_has_no_room_is_counted_where_it_would_have_been() {
        let mut backlog = Backlog::default();
        ["aa", "bb", "cc", "dd"].into_iter().for_each(|row| backlog.push(row.to_owned(), 5));
        assert_eq!(backlog.take().as_deref(), Some("aa\nbb\n{\"lost\":2}\n"));
        backlog.push("ee".to_owned(), 5);
        assert_eq!(backlog.take().as_deref(), Some("ee\n"));
        assert_eq!((backlog.take(), backlog.bytes), (None, 0));
    }

    #[test]
    fn a_helping_has_an_end() {
        let mut backlog = Backlog::default();
        (0..3).for_each(|_| backlog.push("x".repeat(HELPING - 1), ROOM));
        assert_eq!(
            (0..4).map(|_| backlog.take().map_or(0, |lines| lines.len())).collect::<Vec<_>>(),
            [HELPING, HELPING, HELPING, 0]
        );
    }

    #[tokio::test]
    async fn rows_come_in_order_until_nobody_reads_them() {
        let (rows, mut to_tell) = backlog();
        rows.tell("a".to_owned());
        rows.tell("b".to_owned());
        assert_eq!(to_tell.next().await, "a\nb\n");
        assert!(!rows.is_closed());
        drop(to_tell);
        assert!(rows.is_closed());
    }
}
