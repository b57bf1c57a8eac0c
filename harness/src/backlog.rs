//! Lines that wait for a reader who may be slow: what has no room is lost, and counted where it would have been.

use bytes::BytesMut;

/// Lines that wait, and how many have been lost behind them.
#[derive(Debug)]
pub(crate) struct Backlog {
    waiting: BytesMut,
    lost: u64,
    /// So many bytes wait at the most.
    room: usize,
    /// The line that stands for so many lost ones.
    note: fn(u64) -> String,
}

impl Backlog {
    /// One with room for so many bytes.
    pub(crate) fn new(room: usize, note: fn(u64) -> String) -> Self {
        Self { waiting: BytesMut::new(), lost: 0, room, note }
    }

    /// Takes a line, with its end.
    pub(crate) fn push(&mut self, line: &[u8]) {
        let note = if self.lost > 0 { (self.note)(self.lost) } else { String::new() };
        if self.waiting.len() + note.len() + line.len() > self.room {
            self.lost += 1;
            return;
        }
        self.waiting.extend_from_slice(note.as_bytes());
        self.waiting.extend_from_slice(line);
        self.lost = 0;
    }

    /// Whether nothing waits, and nothing has been lost that is not told.
    pub(crate) fn is_empty(&self) -> bool {
        self.waiting.is_empty() && self.lost == 0
    }

    /// The next lines: so many bytes at the most, or one line that is longer; none, if nothing waits.
    pub(crate) fn take(&mut self, most: usize) -> Option<BytesMut> {
        if self.waiting.is_empty() {
            let lost = core::mem::take(&mut self.lost);
            return (lost > 0).then(|| BytesMut::from((self.note)(lost).as_bytes()));
        }
        if self.waiting.len() <= most {
            return Some(core::mem::take(&mut self.waiting));
        }
        let is_end = |byte: &u8| *byte == b'\n';
        let last = self.waiting[..most].iter().rposition(is_end);
        let end = last.or_else(|| self.waiting.iter().position(is_end)).map_or(self.waiting.len(), |end| end + 1);
        Some(self.waiting.split_to(end))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn backlog(room: usize) -> Backlog {
        Backlog::new(room, |lost| format!("{lost} lost\n"))
    }

    fn taken(backlog: &mut Backlog, most: usize) -> Option<String> {
        backlog.take(most).map(|lines| String::from_utf8(lines.to_vec()).unwrap())
    }

    #[test]
    fn what_has_no_room_is_counted_where_it_would_have_been() {
        let mut backlog = backlog(14);
        ["aaaa\n", "bbbb\n", "cccc\n", "dd\n", "eeee\n"].iter().for_each(|line| backlog.push(line.as_bytes()));
        // What fits after others were lost brings their number with it, and must fit with that.
        assert_eq!(taken(&mut backlog, 5).as_deref(), Some("aaaa\n"));
        backlog.push(b"f\n");
        assert_eq!(taken(&mut backlog, 99).as_deref(), Some("bbbb\n3 lost\nf\n"));
        assert_eq!(taken(&mut backlog, 99), None);
        ["gggggg\n", "hhhhhh\n", "i\n"].iter().for_each(|line| backlog.push(line.as_bytes()));
        assert_eq!(taken(&mut backlog, 99).as_deref(), Some("gggggg\nhhhhhh\n"));
        assert_eq!(taken(&mut backlog, 99).as_deref(), Some("1 lost\n"));
        assert_eq!(taken(&mut backlog, 99), None);
    }

    #[test]
    fn a_helping_ends_with_a_line() {
        let mut backlog = backlog(99);
        ["aa\n", "bb\n", "cccccc\n", "d\n"].iter().for_each(|line| backlog.push(line.as_bytes()));
        let helpings: Vec<_> = core::iter::from_fn(|| taken(&mut backlog, 6)).collect();
        assert_eq!(helpings, ["aa\nbb\n", "cccccc\n", "d\n"]);
    }
}
