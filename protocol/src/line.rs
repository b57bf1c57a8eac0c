//! Lines: one wire each, idle high, carrying edges.

use serde::{Deserialize, Serialize};

use crate::time::Instant;

/// The level of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Level {
    /// Space: a start bit, a data bit 0.
    Low,
    /// Mark: idle, a stop bit, a data bit 1.
    High,
}

/// A change of a line's level at an instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Edge {
    /// When the line changes.
    pub at: Instant,
    /// What it changes to.
    pub level: Level,
}

/// What a receiver knows of a line: its level at some instant and the edges after it, in order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Waveform {
    before: Level,
    edges: Vec<Edge>,
}

impl Default for Waveform {
    fn default() -> Self {
        Self::idle()
    }
}

impl Waveform {
    /// A line that has always been idle.
    pub const fn idle() -> Self {
        Self { before: Level::High, edges: Vec::new() }
    }

    /// Adds an edge. One that lies before the last known edge, or does not change the level, is left out. Two at one
    /// instant are none.
    pub fn push(&mut self, edge: Edge) {
        if self.last_level() == edge.level {
            return;
        }
        match self.edges.last() {
            Some(last) if last.at > edge.at => {}
            Some(last) if last.at == edge.at => drop(self.edges.pop()),
            _ => self.edges.push(edge),
        }
    }

    /// Adds edges, in order.
    pub fn extend(&mut self, edges: &[Edge]) {
        self.edges.reserve(edges.len());
        edges.iter().for_each(|edge| self.push(*edge));
    }

    /// Withdraws every edge at or after `at` and lets the line go idle there.
    pub fn cut(&mut self, at: Instant) {
        self.edges.retain(|edge| edge.at < at);
        self.push(Edge { at, level: Level::High });
    }

    /// The level at `t`; an edge at `t` counts.
    pub fn level_at(&self, t: Instant) -> Level {
        self.level_after(self.edges.partition_point(|edge| edge.at <= t))
    }

    /// A reader that stands at `t`.
    pub fn reader(&self, t: Instant) -> Reader<'_> {
        let n = self.edges.partition_point(|edge| edge.at < t);
        Reader { level: self.level_after(n), coming: &self.edges[n..] }
    }

    /// The first edge to low at or after `t`.
    pub fn falling_from(&self, t: Instant) -> Option<Instant> {
        self.first_from(t, Level::Low)
    }

    /// The first edge to high at or after `t`.
    pub fn rising_from(&self, t: Instant) -> Option<Instant> {
        self.first_from(t, Level::High)
    }

    /// Forgets the edges before `t`: no receiver will look there again.
    pub fn forget_before(&mut self, t: Instant) {
        let n = self.edges.partition_point(|edge| edge.at < t);
        if n > 0 {
            self.before = self.edges[n - 1].level;
            self.edges.drain(..n);
        }
    }

    /// How many edges are known.
    #[cfg(test)]
    pub(crate) const fn len(&self) -> usize {
        self.edges.len()
    }

    /// The instant of the last known edge.
    pub fn last_at(&self) -> Option<Instant> {
        self.edges.last().map(|edge| edge.at)
    }

    /// The level after the last known edge.
    pub fn last_level(&self) -> Level {
        self.edges.last().map_or(self.before, |edge| edge.level)
    }

    /// The level after the first `n` edges known.
    fn level_after(&self, n: usize) -> Level {
        n.checked_sub(1).map_or(self.before, |last| self.edges[last].level)
    }

    fn first_from(&self, t: Instant, level: Level) -> Option<Instant> {
        let n = self.edges.partition_point(|edge| edge.at < t);
        self.edges[n..].iter().find(|edge| edge.level == level).map(|edge| edge.at)
    }
}

/// Reads a waveform at instants of which none comes before the last.
#[derive(Clone, Debug)]
pub struct Reader<'a> {
    level: Level,
    coming: &'a [Edge],
}

impl Reader<'_> {
    /// The level just before `t`; an edge at `t` does not count.
    pub fn level_before(&mut self, t: Instant) -> Level {
        while let [edge, rest @ ..] = self.coming
            && edge.at < t
        {
            (self.level, self.coming) = (edge.level, rest);
        }
        self.level
    }

    /// The level just before `first`, if it is still that just before `last`.
    pub fn steady(&mut self, first: Instant, last: Instant) -> Option<Level> {
        let level = self.level_before(first);
        self.coming.first().is_none_or(|edge| edge.at >= last).then_some(level)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ns: u64) -> Instant {
        Instant::from_nanos(ns)
    }

    fn pulse() -> Waveform {
        let mut line = Waveform::idle();
        line.push(Edge { at: at(10), level: Level::Low });
        line.push(Edge { at: at(20), level: Level::High });
        line
    }

    #[test]
    fn an_edge_counts_from_its_instant() {
        let line = pulse();
        assert_eq!([9, 10, 19, 20].map(|t| line.level_at(at(t))), [Level::High, Level::Low, Level::Low, Level::High]);
        assert_eq!(line.falling_from(at(10)), Some(at(10)));
        assert_eq!(line.falling_from(at(11)), None);
    }

    #[test]
    fn what_a_sample_reads_is_the_level_before_it() {
        let line = pulse();
        let levels = [Level::High, Level::Low, Level::Low, Level::High];
        assert_eq!([10, 11, 20, 21].map(|t| line.reader(at(t)).level_before(at(t))), levels);
        let mut reader = line.reader(at(10));
        assert_eq!([10, 11, 20, 21].map(|t| reader.level_before(at(t))), levels);
        let steady = |first, last| line.reader(at(5)).steady(at(first), at(last));
        assert_eq!(steady(11, 20), Some(Level::Low));
        assert_eq!([(10, 11), (11, 21)].map(|(first, last)| steady(first, last)), [None, None]);
        assert_eq!([10, 20].map(|t| steady(t, t)), [Some(Level::High), Some(Level::Low)]);
    }

    #[test]
    fn edges_are_found_from_their_instant_on_and_by_their_sense() {
        let line = pulse();
        assert_eq!([0, 10, 11].map(|t| line.falling_from(at(t))), [Some(at(10)), Some(at(10)), None]);
        assert_eq!([0, 20, 21].map(|t| line.rising_from(at(t))), [Some(at(20)), Some(at(20)), None]);
        assert_eq!((line.last_at(), line.last_level()), (Some(at(20)), Level::High));
        assert_eq!((Waveform::idle().last_at(), Waveform::default().last_level()), (None, Level::High));
    }

    #[test]
    fn an_edge_before_the_last_one_is_left_out() {
        let mut line = pulse();
        line.push(Edge { at: at(15), level: Level::Low });
        assert_eq!(line, pulse());
    }

    #[test]
    fn two_edges_at_one_instant_are_none() {
        let mut line = pulse();
        line.push(Edge { at: at(20), level: Level::Low });
        assert_eq!((line.len(), line.last_level()), (1, Level::Low));
        line.push(Edge { at: at(21), level: Level::High });
        assert_eq!(line.rising_from(at(0)), Some(at(21)));
    }

    #[test]
    fn an_edge_that_changes_nothing_is_left_out() {
        let mut line = pulse();
        line.push(Edge { at: at(30), level: Level::High });
        assert_eq!(line, pulse());
    }

    #[test]
    fn a_cut_withdraws_what_lies_after_it() {
        let mut line = pulse();
        line.cut(at(15));
        assert_eq!(line.level_at(at(14)), Level::Low);
        assert_eq!(line.rising_from(at(0)), Some(at(15)));
    }

    #[test]
    fn a_cut_that_is_taken_back_leaves_nothing_behind() {
        let mut line = pulse();
        line.cut(at(15));
        line.push(Edge { at: at(15), level: Level::Low });
        line.push(Edge { at: at(20), level: Level::High });
        assert_eq!(line, pulse());
    }

    #[test]
    fn forgetting_keeps_the_level() {
        let mut line = pulse();
        line.forget_before(at(5));
        line.forget_before(at(10));
        assert_eq!(line, pulse());
        line.forget_before(at(15));
        assert_eq!(line.level_at(at(15)), Level::Low);
        assert_eq!(line.level_at(at(20)), Level::High);
        assert_eq!(line.len(), 1);
    }
}
