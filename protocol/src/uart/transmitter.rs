//! Transmitters: a byte becomes all the edges of its character at the instant the shift register loads.

use std::collections::VecDeque;

use crate::clock::{Clock, Rate, Ticks};
use crate::line::{Edge, Level};
use crate::time::{Instant, Span};
use crate::uart::Format;

/// A UART transmitter with the firmware's send queue in front of it.
#[derive(Clone, Debug)]
pub struct Transmitter {
    pacing: Pacing,
    format: Format,
    queue: VecDeque<u8>,
    free_at: Instant,
}

#[derive(Clone, Copy, Debug)]
enum Pacing {
    /// Ticks are bit times, counted from the instant of loading.
    Hardware { bits: Ticks },
    /// Ticks are the interrupt's, counted from the start of the rig.
    Software { ticks: Ticks, per_bit: u64, latency: Span },
}

/// A character that has just been committed to the line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Loaded {
    /// The byte.
    pub byte: u8,
    /// Its edges, the start bit's first.
    pub edges: Vec<Edge>,
    /// The end of its stop bit: no other character can start before.
    pub end: Instant,
}

impl Transmitter {
    /// A hardware transmitter at `baud` in `clock`.
    pub fn hardware(baud: Rate, clock: Clock) -> Self {
        Self::new(Pacing::Hardware { bits: Ticks::new(Instant::START, baud, clock) })
    }

    pub(super) fn software(ticks: Ticks, per_bit: u64, latency: Span) -> Self {
        Self::new(Pacing::Software { ticks, per_bit, latency })
    }

    fn new(pacing: Pacing) -> Self {
        Self { pacing, format: Format::EIGHT_N_ONE, queue: VecDeque::new(), free_at: Instant::START }
    }

    /// Changes the speed from the next character on.
    pub fn retune(&mut self, baud: Rate, clock: Clock) {
        self.keep_pace_with(&Self::hardware(baud, clock));
    }

    /// Paces characters as `other` does, from the next one on.
    pub const fn keep_pace_with(&mut self, other: &Self) {
        self.pacing = other.pacing;
    }

    /// Changes the format of characters from the next one on.
    pub const fn set_format(&mut self, format: Format) {
        self.format = format;
    }

    /// How long a character that loads at `now` takes.
    pub fn character_from(&self, now: Instant) -> Span {
        self.bits_from(now)(self.format.bits()).since(now)
    }

    /// Queues a byte.
    pub fn push(&mut self, byte: u8) {
        self.queue.push_back(byte);
    }

    /// Forgets what is queued; the character on the line goes on.
    pub fn clear(&mut self) {
        self.queue.clear();
    }

    /// When the next queued byte can load, if one is queued.
    pub fn poll_timeout(&self) -> Option<Instant> {
        (!self.queue.is_empty()).then_some(self.free_at)
    }

    /// The end of the last character's stop bit, or the start of the rig.
    pub const fn free_at(&self) -> Instant {
        self.free_at
    }

    /// Nothing queued and nothing on the line at `now`.
    pub fn is_idle(&self, now: Instant) -> bool {
        self.queue.is_empty() && self.free_at <= now
    }

    /// Loads the shift register at `now`, if it is free and a byte is queued.
    #[inline]
    pub fn load(&mut self, now: Instant) -> Option<Loaded> {
        // Boards ask far more often than there is something to load.
        if now < self.free_at || self.queue.is_empty() { None } else { self.load_next(now) }
    }

    fn load_next(&mut self, now: Instant) -> Option<Loaded> {
        let byte = self.queue.pop_front()?;
        let (bit, format) = (self.bits_from(now), self.format);
        let end = bit(format.bits());
        let mut edges = Vec::with_capacity(format.bits() as usize);
        let mut last = Level::High;
        for n in 0..format.bits() {
            let level = format.level(byte, n);
            if level != last {
                edges.push(Edge { at: bit(n), level });
                last = level;
            }
        }
        self.free_at = end;
        Some(Loaded { byte, edges, end })
    }

    /// The instants at which the bits of a character that loads at `now` start.
    fn bits_from(&self, now: Instant) -> impl Fn(u64) -> Instant + use<> {
        let (ticks, first, per_bit, latency) = match self.pacing {
            Pacing::Hardware { bits } => (bits.from(now), 0, 1, Span::ZERO),
            Pacing::Software { ticks, per_bit, latency } => (ticks, ticks.first_from(now - latency), per_bit, latency),
        };
        move |n| ticks.at(first + n * per_bit) + latency
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::uart::TickTimer;

    fn load(transmitter: &mut Transmitter, byte: u8, now: u64) -> Loaded {
        transmitter.push(byte);
        transmitter.load(Instant::from_nanos(now)).unwrap()
    }

    #[test]
    fn a_character_is_drawn_from_its_origin() {
        let mut uart = Transmitter::hardware(Rate::hz(9600), Clock::TRUE);
        let loaded = load(&mut uart, 0x0f, 1_000);
        let ns: Vec<_> = loaded.edges.iter().map(|edge| (edge.at.as_nanos() - 1_000, edge.level)).collect();
        assert_eq!(ns, [(0, Level::Low), (104_167, Level::High), (520_833, Level::Low), (937_500, Level::High)]);
        assert_eq!(loaded.end.as_nanos(), 1_042_667);
    }

    #[test]
    fn the_next_character_waits_for_the_stop_bit() {
        let mut uart = Transmitter::hardware(Rate::hz(9600), Clock::TRUE);
        let first = load(&mut uart, 0, 0);
        uart.push(1);
        assert_eq!(uart.load(first.end - Span::from_nanos(1)), None);
        assert_eq!(uart.poll_timeout(), Some(first.end));
        assert!(uart.load(first.end).is_some());
    }

    #[test]
    fn every_byte_has_the_levels_of_its_bits_least_significant_first() {
        for byte in 0..=u8::MAX {
            let mut uart = Transmitter::hardware(Rate::hz(1_000_000), Clock::TRUE);
            let loaded = load(&mut uart, byte, 0);
            let mut line = crate::line::Waveform::idle();
            loaded.edges.iter().for_each(|edge| line.push(*edge));
            let bits = (0..10).map(|n| line.level_at(Instant::from_nanos(1_000 * n + 500)) == Level::High);
            let expected = [false].into_iter().chain((0..8).map(|n| byte & (1 << n) != 0)).chain([true]);
            assert!(bits.eq(expected), "{byte:02x}");
            assert_eq!((loaded.byte, loaded.end), (byte, Instant::from_nanos(10_000)));
        }
    }

    #[test]
    fn it_is_idle_when_nothing_is_queued_and_nothing_on_the_line() {
        let mut uart = Transmitter::hardware(Rate::hz(9600), Clock::TRUE);
        assert_eq!((uart.poll_timeout(), uart.free_at(), uart.is_idle(Instant::START)), (None, Instant::START, true));
        uart.push(1);
        assert_eq!((uart.poll_timeout(), uart.is_idle(Instant::START)), (Some(Instant::START), false));
        let end = uart.load(Instant::START).unwrap().end;
        assert_eq!((uart.poll_timeout(), uart.free_at()), (None, end));
        assert_eq!([end - Span::from_nanos(1), end].map(|now| uart.is_idle(now)), [false, true]);
        assert_eq!(uart.load(end), None, "nothing is queued");
    }

    #[test]
    fn what_is_queued_is_sent_in_order_and_can_be_forgotten() {
        let mut uart = Transmitter::hardware(Rate::hz(9600), Clock::TRUE);
        [1, 2, 3].into_iter().for_each(|byte| uart.push(byte));
        let first = uart.load(Instant::START).unwrap();
        assert_eq!((first.byte, uart.load(first.end).map(|second| second.byte)), (1, Some(2)));
        uart.clear();
        assert_eq!(uart.poll_timeout(), None);
    }

    #[test]
    fn another_speed_holds_from_the_next_character_on() {
        let mut uart = Transmitter::hardware(Rate::hz(1_000), Clock::TRUE);
        assert_eq!(load(&mut uart, 0, 0).end.as_nanos(), 10_000_000);
        uart.retune(Rate::hz(2_000), Clock::TRUE);
        assert_eq!(uart.free_at().as_nanos(), 10_000_000);
        assert_eq!(load(&mut uart, 0, 10_000_000).end.as_nanos(), 15_000_000);
    }

    #[test]
    fn another_format_holds_from_the_next_character_on() {
        let mut uart = Transmitter::hardware(Rate::hz(1_000_000), Clock::TRUE);
        assert_eq!(load(&mut uart, 0x01, 0).end.as_nanos(), 10_000);
        uart.set_format(Format { parity: crate::uart::Parity::Even, ..Format::EIGHT_N_ONE });
        let loaded = load(&mut uart, 0x01, 10_000);
        assert_eq!((loaded.edges.last().unwrap().at.as_nanos(), loaded.end.as_nanos()), (19_000, 21_000));
        assert_eq!(uart.character_from(loaded.end).as_nanos(), 11_000);
    }

    #[test]
    fn software_links_start_on_the_same_tick_one_after_the_other() {
        let timer = TickTimer::new(Rate::hz(9600), Clock::TRUE);
        let starts = [0, 1, 2].map(|n| load(&mut timer.transmitter(n), 0x55, 30_000).edges[0].at.as_nanos());
        // Ticks lie 34.722 µs apart; tick 1 is the first after 30 µs, and each link is served a little later.
        assert_eq!(starts, [37_722, 41_722, 45_722]);
    }

    #[test]
    fn software_characters_follow_one_another_without_a_gap() {
        let mut uart = TickTimer::new(Rate::hz(9600), Clock::from_ppb(-1_000_000).unwrap()).transmitter(0);
        let first = load(&mut uart, 0xa5, 123_456);
        let second = load(&mut uart, 0xa5, first.end.as_nanos());
        assert_eq!(second.edges[0].at, first.end);
    }

    #[test]
    fn a_retuned_timer_keeps_the_tick_that_is_set() {
        let mut timer = TickTimer::new(Rate::hz(9600), Clock::TRUE);
        let mut uart = timer.transmitter(0);
        timer.retune(Instant::from_nanos(1_000_000_000), Clock::from_ppb(100_000_000).unwrap());
        uart.keep_pace_with(&timer.transmitter(0));
        // Tick 28800 of the old grid is at 1 s; those after it are 31.566 µs apart.
        assert_eq!(load(&mut uart, 0, 1_000_010_000).edges[0].at.as_nanos(), 1_000_034_566);
    }
}
