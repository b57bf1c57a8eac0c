//! What the numbers in a frame are worth on a machine.

use torno_protocol::lathe::TransverseSubFrame;

/// What the numbers in a frame are worth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// The axis along the bar.
    pub feed: Feed,
    /// The axis across it.
    pub infeed: Infeed,
}

/// The axis along the bar: it has a speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feed {
    /// What a count is worth, in mm; below 0 if it counts towards the chuck.
    pub mm_per_count: f64,
    /// A unit of speed is a count in so many seconds.
    pub sample_s: f64,
    /// So many counts from the start, either way, an end of travel is.
    pub reach: i64,
}

/// The axis across the bar: it is switched on and off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Infeed {
    /// What a slot is worth, in mm; below 0 if it counts towards the bar's middle.
    pub mm_per_slot: f64,
    /// Its only speed, in mm/s.
    pub mm_per_s: f64,
    /// It goes so many slots further than the edge at which its count is the one that was asked for.
    pub overrun: f64,
    /// So many slots from the start, either way, an end of travel is.
    pub reach: i64,
}

impl Feed {
    /// A unit of feed, in mm a minute.
    pub fn unit(&self) -> f64 {
        self.mm_per_count.abs() / self.sample_s * 60.0
    }

    /// The fastest feed, in mm a minute.
    pub fn most(&self) -> f64 {
        self.unit() * f64::from(TransverseSubFrame::SPEED_MAX)
    }

    /// The nearest count to a way of so many mm.
    pub(crate) fn count(&self, mm: f64) -> i64 {
        (mm / self.mm_per_count).round() as i64
    }
}

impl Infeed {
    /// Where the slide stands before the middle of the slot that it was sent to, in slots and as seen from where it
    /// came: it stops just past the slot's first edge. Below 0 it stops behind the middle; then two places can be more
    /// than a slot apart.
    pub(crate) fn short(&self) -> f64 {
        (0.5 - self.overrun).clamp(-0.5, 0.5)
    }
}
