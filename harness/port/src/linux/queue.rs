//! What clients have done, in order, and no one has been told of.

use std::collections::VecDeque;

use super::event::{LineCoding, PortEvent};

#[derive(Debug, Default)]
pub(super) struct Queue {
    events: VecDeque<PortEvent>,
    /// So many events of it are of clients that have closed the port.
    left: usize,
    /// Whether XON/XOFF was on when the last of them was left.
    left_ixon: bool,
    /// So many are older than the client that was last told to have begun.
    older: usize,
    /// Whether the client that has the port open has written.
    began: bool,
}

impl Queue {
    /// The next event: data of no more than `max` bytes, and only if they were written in `coding`, if that is given.
    /// Then a break has to wait, too.
    pub(super) fn next(&mut self, max: usize, coding: Option<LineCoding>) -> Option<PortEvent> {
        // That another client has begun is told even if no one wants the bytes of the one before.
        if let Some(began) = self.events.iter().position(|event| *event == PortEvent::Began) {
            self.older = began;
            self.left -= usize::from(began < self.left);
            return self.events.remove(began);
        }
        match self.events.front_mut()? {
            PortEvent::Break(_) if coding.is_some() => None,
            PortEvent::Data { coding: at, .. } if max == 0 || coding.is_some_and(|coding| coding != *at) => None,
            PortEvent::Data { bytes, coding } if bytes.len() > max => {
                Some(PortEvent::Data { bytes: bytes.drain(..max).collect(), coding: *coding })
            }
            _ => {
                self.left = self.left.saturating_sub(1);
                self.older = self.older.saturating_sub(1);
                self.events.pop_front()
            }
        }
    }

    /// The client that has the port open has written these bytes.
    pub(super) fn put(&mut self, data: Vec<u8>, at: LineCoding) {
        if !core::mem::replace(&mut self.began, true) {
            self.events.push_back(PortEvent::Began);
        }
        let apart = self.events.len() <= self.left.max(self.older);
        match self.events.back_mut().filter(|_| !apart) {
            Some(PortEvent::Data { bytes, coding }) if *coding == at => bytes.extend(data),
            _ => self.events.push_back(PortEvent::Data { bytes: data, coding: at }),
        }
    }

    /// It wants the line held low, or no longer.
    pub(super) fn hold(&mut self, low: bool) {
        self.events.push_back(PortEvent::Break(low));
    }

    /// It has flushed its output.
    pub(super) fn flush(&mut self) {
        let hold = last_break(self.events.iter());
        self.events.clear();
        (self.left, self.older) = (0, 0);
        self.events.push_back(PortEvent::Flushed);
        // The line must not stay low because the end of a break is forgotten.
        self.events.extend(hold);
    }

    /// The last client has closed the port, with XON/XOFF on or off.
    pub(super) fn leave(&mut self, ixon: bool) {
        if self.events.len() > self.left {
            self.left_ixon = ixon;
        }
        self.left = self.events.len();
        self.began = false;
    }

    /// A client has opened the port: those before it have begun for no one.
    pub(super) fn forget_beginnings(&mut self) {
        let earlier = |n: &usize| self.events[*n] == PortEvent::Began;
        let (left, older) = ((0..self.left).filter(earlier).count(), (0..self.older).filter(earlier).count());
        self.left -= left;
        self.older -= older;
        self.events.retain(|event| *event != PortEvent::Began);
    }

    /// What the first byte was written in that no one has taken.
    pub(super) fn next_coding(&self) -> Option<LineCoding> {
        self.events
            .iter()
            .find_map(|event| if let PortEvent::Data { coding, .. } = event { Some(*coding) } else { None })
    }

    /// How many events it has.
    pub(super) fn len(&self) -> usize {
        self.events.len()
    }

    /// How many bytes clients have left that have closed the port.
    pub(super) fn leftover(&self) -> usize {
        self.events.range(..self.left).map(bytes).sum()
    }

    /// Whether these are to be held by XON/XOFF. None if there are none.
    pub(super) fn leftover_ixon(&self) -> Option<bool> {
        (self.leftover() > 0).then_some(self.left_ixon)
    }

    /// How many bytes are held of the client that has the port open.
    pub(super) fn held(&self) -> usize {
        self.events.range(self.left..).map(bytes).sum()
    }

    /// Forgets what is older than the client that was last told to have begun. Says how many bytes there were.
    pub(super) fn forget_leftover(&mut self) -> usize {
        let older: Vec<PortEvent> = self.events.drain(..self.older).collect();
        self.left = self.left.saturating_sub(core::mem::take(&mut self.older));
        if let Some(hold) = last_break(older.iter()) {
            self.events.push_front(hold);
        }
        older.iter().map(bytes).sum()
    }
}

fn bytes(event: &PortEvent) -> usize {
    if let PortEvent::Data { bytes, .. } = event { bytes.len() } else { 0 }
}

fn last_break<'a>(events: impl DoubleEndedIterator<Item = &'a PortEvent>) -> Option<PortEvent> {
    events.rev().find(|event| matches!(event, PortEvent::Break(_))).cloned()
}
