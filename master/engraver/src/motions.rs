//! How motions become trains: as GRBL plans them, or as the paper has them.

use torno_motion::{Limits, Planner, Rate, Segment, Sequencer};
use torno_protocol::time::Instant;

use crate::settings::{EngraverSettings, Motion};

/// What plans the motions.
#[derive(Clone, Debug)]
pub(crate) enum Motions {
    Interpolated(Planner),
    Sequenced(Sequencer),
}

/// Asks whichever there is.
macro_rules! either {
    ($self:ident, $motions:ident => $answer:expr) => {
        match $self {
            Self::Interpolated($motions) => $answer,
            Self::Sequenced($motions) => $answer,
        }
    };
}

impl Motions {
    pub(crate) fn new(settings: &EngraverSettings, limits: Limits) -> Self {
        let blocks = settings.blocks as usize;
        match settings.motion {
            Motion::Interpolated => Self::Interpolated(Planner::new(limits, blocks)),
            Motion::Sequenced => Self::Sequenced(Sequencer::new(limits, blocks, settings.timer_prescaler)),
        }
    }

    pub(crate) fn set_limits(&mut self, limits: Limits) {
        either!(self, motions => motions.set_limits(limits));
    }

    pub(crate) fn room(&self) -> usize {
        either!(self, motions => motions.room())
    }

    pub(crate) fn is_empty(&self) -> bool {
        either!(self, motions => motions.is_empty())
    }

    pub(crate) fn push(&mut self, now: Instant, target: [i32; 4], rate: Rate) {
        either!(self, motions => motions.push(now, target, rate));
    }

    pub(crate) fn start(&mut self, now: Instant) {
        either!(self, motions => motions.start(now));
    }

    pub(crate) fn hold(&mut self, now: Instant) {
        either!(self, motions => motions.hold(now));
    }

    pub(crate) fn stop(&mut self, now: Instant) {
        either!(self, motions => motions.stop(now));
    }

    pub(crate) fn abort(&mut self, now: Instant) {
        either!(self, motions => motions.abort(now));
    }

    pub(crate) fn set_overrides(&mut self, now: Instant, feed: u8, rapid: u8) {
        either!(self, motions => motions.set_overrides(now, feed, rapid));
    }

    pub(crate) fn position(&self, now: Instant) -> [i32; 4] {
        either!(self, motions => motions.position(now))
    }

    pub(crate) fn rate(&self, now: Instant) -> f64 {
        either!(self, motions => motions.rate(now))
    }

    pub(crate) fn segment(&self) -> Option<&Segment> {
        either!(self, motions => motions.segment())
    }

    pub(crate) fn advance(&mut self, now: Instant) -> bool {
        either!(self, motions => motions.advance(now))
    }
}
