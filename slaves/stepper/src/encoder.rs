//! The encoder: a position becomes counts, as its lines are wired.

/// One of the encoder's two channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Channel {
    /// The one that leads in the positive sense.
    A,
    /// The other one.
    B,
}

/// What the encoder's channels show. A dead one is low.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Channels {
    /// Channel A, as it is wired.
    pub a: bool,
    /// Channel B, as it is wired.
    pub b: bool,
    /// The index mark: a count wide.
    pub z: bool,
}

/// An encoder in quadrature, of which all four edges of a line count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Encoder {
    /// A count in units.
    count: i64,
    /// Where in a count it begins.
    phase: i64,
    swapped: bool,
    dead: Option<Channel>,
    /// What is counted beyond the edges that are seen.
    skew: i64,
    /// The counts from one index mark (Z) to the next. There is one where it begins. (Ours.)
    turn: i64,
}

impl Encoder {
    pub(crate) fn new(count: i64, phase: f64, turn: i64) -> Self {
        let phase = (libm::floor(phase * count as f64) as i64).clamp(0, count - 1);
        Self { count, phase, swapped: false, dead: None, skew: 0, turn: turn.max(1) }
    }

    /// The whole counts that have passed at this position: never rounded to the nearest.
    pub(crate) const fn passed(&self, position: i64) -> i64 {
        (position + self.phase).div_euclid(self.count)
    }

    /// What has been counted at this position.
    pub(crate) const fn counted(&self, position: i64) -> i64 {
        self.skew.wrapping_add(self.edges(self.passed(position)))
    }

    /// What the edges make of so many counts.
    const fn edges(&self, passed: i64) -> i64 {
        let quarter = passed.rem_euclid(4);
        let seen = match self.dead {
            None => passed,
            // The edges of one channel alone are counted up and down again. In the four quarters of a line A is 0 1 1 0
            // and B is 0 0 1 1. With B low, A counts up as it rises; with A low, B counts down as it rises.
            Some(Channel::B) => (quarter == 1 || quarter == 2) as i64,
            Some(Channel::A) => -((quarter >= 2) as i64),
        };
        if self.swapped { -seen } else { seen }
    }

    /// Whether each count that passes counts one, and in which sense.
    pub(crate) const fn sense(&self) -> Option<i64> {
        match (self.dead, self.swapped) {
            (Some(_), _) => None,
            (None, swapped) => Some(if swapped { -1 } else { 1 }),
        }
    }

    /// A count in units, and where in one position 0 is.
    pub(crate) const fn line(&self) -> (i64, i64) {
        (self.count, self.phase)
    }

    /// How far it is from this position to where the next index mark begins, in this sense.
    pub(crate) const fn index_ahead(&self, position: i64, sense: i64) -> i64 {
        self.ahead(position, sense, self.count.saturating_mul(self.turn))
    }

    /// How far it is from this position to where the next count begins, in this sense.
    pub(crate) const fn edge_ahead(&self, position: i64, sense: i64) -> i64 {
        self.ahead(position, sense, self.count)
    }

    /// Backwards, the count before has begun one unit before the edge.
    const fn ahead(&self, position: i64, sense: i64, way: i64) -> i64 {
        let beyond = (position + self.phase).rem_euclid(way);
        if sense > 0 { way - beyond } else { beyond + 1 }
    }

    /// What has been counted beyond what has passed: less than half a turn, either way. With a dead channel unknown.
    pub(crate) const fn miscounted(&self, position: i64, total: i64) -> Option<i64> {
        match self.dead {
            Some(_) => None,
            None => {
                let beyond = total.wrapping_sub(self.passed(position)).wrapping_add(self.turn / 2);
                Some(beyond.rem_euclid(self.turn) - self.turn / 2)
            }
        }
    }

    /// A and B are exchanged, or not. What has been counted stays.
    pub(crate) const fn swap(&mut self, swapped: bool, position: i64) {
        let before = self.counted(position);
        self.swapped = swapped;
        self.invent(before - self.counted(position));
    }

    /// A channel is dead, or none. What has been counted stays.
    pub(crate) const fn cut(&mut self, dead: Option<Channel>, position: i64) {
        let before = self.counted(position);
        self.dead = dead;
        self.invent(before - self.counted(position));
    }

    /// So many counts more; fewer if negative.
    pub(crate) const fn invent(&mut self, counts: i64) {
        self.skew = self.skew.wrapping_add(counts);
    }

    /// What the channels show when so many counts have passed.
    pub(crate) const fn channels(&self, passed: i64) -> Channels {
        let quarter = passed.rem_euclid(4);
        let a = (quarter == 1 || quarter == 2) && !matches!(self.dead, Some(Channel::A));
        let b = quarter >= 2 && !matches!(self.dead, Some(Channel::B));
        let z = passed.rem_euclid(self.turn) == 0;
        if self.swapped { Channels { a: b, b: a, z } } else { Channels { a, b, z } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_count_lasts_from_edge_to_edge() {
        let encoder = Encoder::new(100, 0.5, 8_000);
        assert_eq!([-51, -50, 0, 49, 50, 149, 150].map(|at| encoder.counted(at)), [-1, 0, 0, 0, 1, 1, 2]);
        assert_eq!([0.0, 0.999_999].map(|phase| Encoder::new(100, phase, 8_000).counted(1)), [0, 1]);
    }

    /// What a counter of all edges (TIM encoder mode 3) makes of the levels, edge by edge.
    #[test]
    fn counts_are_what_a_timer_makes_of_the_levels() {
        for swapped in [false, true] {
            for dead in [None, Some(Channel::A), Some(Channel::B)] {
                let mut encoder = Encoder::new(100, 0.5, 8_000);
                encoder.swap(swapped, 0);
                encoder.cut(dead, 0);
                let way = (0..=30).chain((-30..30).rev()).chain(-30..=0).map(|count| count * 100);
                let channels = |position| encoder.channels(encoder.passed(position));
                let (mut total, mut before) = (encoder.counted(0), channels(0));
                for position in way {
                    let now = channels(position);
                    // A rises while B is low: up.
                    total += match (before.a != now.a, before.b != now.b) {
                        (true, false) => {
                            if now.a != now.b {
                                1
                            } else {
                                -1
                            }
                        }
                        (false, true) => {
                            if now.a == now.b {
                                1
                            } else {
                                -1
                            }
                        }
                        _ => 0,
                    };
                    before = now;
                    assert_eq!(encoder.counted(position), total, "{swapped} {dead:?} {position}");
                }
            }
        }
    }

    #[test]
    fn an_index_mark_is_passed_once_a_turn() {
        let encoder = Encoder::new(100, 0.5, 8);
        assert_eq!([-51, -50, -49, 0, 749, 750].map(|at| encoder.index_ahead(at, 1)), [1, 800, 799, 750, 1, 800]);
        // Backwards, the mark is left where the count before it begins.
        assert_eq!([-50, -49, 750].map(|at| encoder.index_ahead(at, -1)), [1, 2, 1]);
        assert_eq!(
            [(0, 1), (49, 1), (50, 1), (0, -1), (-50, -1)].map(|(at, sense)| encoder.edge_ahead(at, sense)),
            [50, 1, 100, 51, 1]
        );
        assert_eq!([-1, 0, 1, 8].map(|passed| encoder.channels(passed).z), [false, true, false, true]);
        assert_eq!([0, 3, -3, 8, 17].map(|beyond| encoder.miscounted(150, 2 + beyond)), [0, 3, -3, 0, 1].map(Some));
    }

    #[test]
    fn what_has_been_counted_stays() {
        let mut encoder = Encoder::new(100, 0.0, 8_000);
        encoder.swap(true, 730);
        assert_eq!([encoder.counted(730), encoder.counted(930)], [7, 5]);
        encoder.cut(Some(Channel::B), 930);
        assert_eq!(encoder.counted(930), 5);
        encoder.invent(-3);
        assert_eq!(encoder.counted(930), 2);
    }
}
