//! The last step: moves become frames.

use torno_protocol::lathe::Frame;

/// A frame of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Planned {
    /// The line of the program that it comes from.
    pub line: usize,
    /// The frame.
    pub frame: Frame,
}

/// What a frame or more of them do: one axis moves, or none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Move {
    pub(crate) line: usize,
    /// Units of 20 rpm.
    pub(crate) spindle: u8,
    /// Counts, and units of speed.
    pub(crate) feed: (i64, u8),
    /// Slots.
    pub(crate) infeed: i64,
}

/// Joins moves of the infeed in the same sense, and cuts what is too long for a frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct Merge {
    /// It may grow.
    held: Option<Move>,
    /// It is complete, and a frame or more.
    whole: Option<Move>,
}

impl Merge {
    /// Takes a move. [`Merge::poll`] has given all frames.
    pub(crate) fn push(&mut self, next: Move) {
        if let Some(held) = &mut self.held
            && held.infeed.signum() * next.infeed.signum() > 0
            && held.spindle == next.spindle
        {
            held.infeed += next.infeed;
            return;
        }
        self.whole = self.held.replace(next);
    }

    /// Nothing follows. [`Merge::poll`] has given all frames.
    pub(crate) const fn end(&mut self) {
        self.whole = self.held.take();
    }

    /// The next frame.
    pub(crate) fn poll(&mut self) -> Option<Planned> {
        let Move { line, spindle, feed: (counts, speed), infeed } = self.whole?;
        let most = i64::from(u16::MAX);
        let (z, x) = (counts.clamp(-most, most), infeed.clamp(-most, most));
        let (more_z, more_x) = (counts - z, infeed - x);
        self.whole =
            (more_z != 0 || more_x != 0).then_some(Move { line, spindle, feed: (more_z, speed), infeed: more_x });
        Frame::moving(spindle, z as i32, speed, x as i32).ok().map(|frame| Planned { line, frame })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(moves: &[(i64, i64)]) -> Vec<(i64, i64)> {
        let mut merge = Merge::default();
        let mut found = Vec::new();
        let mut take = |merge: &mut Merge| {
            while let Some(Planned { frame, .. }) = merge.poll() {
                let (z, x) = (frame.transverse, frame.depth);
                let way = |sign: i64, distance: u16| sign * i64::from(distance);
                found.push((way(z.direction().sign(), z.distance()), way(x.direction().sign(), x.distance())));
            }
        };
        for (counts, slots) in moves {
            merge.push(Move { line: 1, spindle: 75, feed: (*counts, 225), infeed: *slots });
            take(&mut merge);
        }
        merge.end();
        take(&mut merge);
        found
    }

    #[test]
    fn slots_of_one_sense_become_one_frame() {
        assert_eq!(frames(&[(0, -1), (0, -2), (0, 3), (0, 1), (9, 0), (0, 1)]), [(0, -3), (0, 4), (9, 0), (0, 1)]);
    }

    #[test]
    fn what_is_too_long_becomes_several_frames() {
        let expected = [(-65_535, 0), (-65_535, 0), (-3, 0), (0, 65_535), (0, 1)];
        assert_eq!(frames(&[(-131_073, 0), (0, 40_000), (0, 25_536)]), expected);
    }

    #[test]
    fn counts_are_not_joined() {
        assert_eq!(frames(&[(5, 0), (5, 0)]), [(5, 0), (5, 0)]);
    }
}
