//! The planner: a buffer of blocks, and the segments that they become.

use std::collections::VecDeque;

use torno_protocol::time::{Instant, Span};

use crate::block::{Block, Overrides, Rate};
use crate::junction;
use crate::limits::{AXES, Limits};
use crate::look_ahead::{Cursor, limit_entries, look_ahead, max_entry};
use crate::profile::Profile;
use crate::segment::{Segment, Stretch, WHOLE};
use crate::timer;

/// GRBL's segments on a ramp, s: 100 of them a second.
const SLICE: f64 = 0.01;
/// What is left of a block is not cut off if it is shorter than this, s.
const SHORTEST: f64 = 0.001;
/// So many of GRBL's segments are cut ahead, the one under way included. What is cut is not planned again.
const AHEAD: u64 = 5;
/// A segment has at least so many steps, so that it has one.
const LEAST_STEPS: f64 = 1.25;
/// The longest segment, s: three days, for the width of the numbers.
const LONGEST: f64 = 262_144.0;
const NANOS: f64 = 1e9;

/// What the planner does with its blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cycle {
    /// It waits for a start.
    Stopped,
    Running,
    /// It brakes.
    Holding,
}

/// A stretch of a block that has been cut off it.
#[derive(Clone, Copy, Debug)]
struct Cut {
    /// Where in the block it ends.
    to: u64,
    /// How long it takes.
    time: Span,
    /// How many of GRBL's segments it stands for, and how long each of them is.
    slices: u64,
    slice: Span,
    /// mm/s.
    speed: f64,
}

/// The segment under way.
#[derive(Clone, Copy, Debug)]
struct UnderWay {
    segment: Segment,
    cut: Cut,
}

/// Plans motions and cuts them into segments.
///
/// `now` never goes back from call to call.
#[derive(Clone, Debug)]
pub struct Planner {
    limits: Limits,
    capacity: usize,
    /// Front: the one under way.
    blocks: VecDeque<Block>,
    /// What has been cut and has not begun, in order.
    cuts: VecDeque<Cut>,
    under_way: Option<UnderWay>,
    /// Behind the last cut.
    cursor: Cursor,
    /// The entries of the blocks up to this one are final.
    planned: usize,
    cycle: Cycle,
    overrides: Overrides,
    /// Of the last block.
    direction: [f64; AXES],
    /// Where the last block ends.
    end: [i32; AXES],
    /// Where the segment under way starts, or the axes stand: steps, place in the front block and pulses given of it.
    position: [i32; AXES],
    place: u64,
    given: [u32; AXES],
}

impl Planner {
    /// A planner at position 0 with room for `blocks` motions; GRBL has 15.
    pub fn new(limits: Limits, blocks: usize) -> Self {
        Self {
            limits: limits.usable(),
            capacity: blocks,
            blocks: VecDeque::new(),
            cuts: VecDeque::new(),
            under_way: None,
            cursor: Cursor::default(),
            planned: 0,
            cycle: Cycle::Stopped,
            overrides: Overrides { feed: 100, rapid: 100 },
            direction: [0.0; AXES],
            end: [0; AXES],
            position: [0; AXES],
            place: 0,
            given: [0; AXES],
        }
    }

    /// Other limits, for the motions that are pushed from now on.
    pub fn set_limits(&mut self, limits: Limits) {
        self.limits = limits.usable();
    }

    /// How many more motions it takes. A motion gives its room back as soon as it has been cut into segments, up to
    /// 50 ms before its end, as in GRBL. So the room grows only when a segment ends.
    pub fn room(&self) -> usize {
        self.capacity.saturating_sub(self.blocks.len() - self.cursor.block)
    }

    /// Whether all motions are done.
    pub fn is_empty(&self) -> bool {
        self.blocks.is_empty()
    }

    /// Takes a motion to `target`, in steps from position 0, after all others. The segment under way stays as it is.
    ///
    /// A motion without a step is dropped. The caller minds the [room](Self::room). A motion does not start by itself
    /// unless others are under way.
    pub fn push(&mut self, now: Instant, target: [i32; AXES], rate: Rate) {
        self.catch_up(now);
        let steps = core::array::from_fn(|n| i64::from(target[n]) - i64::from(self.end[n]));
        let Some((mut block, direction)) = Block::new(steps, rate, &self.limits) else { return };
        if self.cursor.block == self.blocks.len() {
            // Whatever was before it has been cut up to a stop.
            self.cursor.left = block.length;
        } else {
            let before = self.blocks.back().map_or(0.0, |before| before.nominal(self.overrides));
            block.junction = junction::speed_squared(&self.direction, &direction, &self.limits);
            block.max_entry = max_entry(block.junction, block.nominal(self.overrides), before);
        }
        self.blocks.push_back(block);
        (self.direction, self.end) = (direction, target);
        self.planned = look_ahead(&mut self.blocks, self.cursor, self.planned);
        self.cut_ahead(now);
    }

    /// Starts the motions, or goes on after a [hold](Self::hold) or a [stop](Self::stop), or in the middle of a hold.
    /// Does nothing if they run, or if there are none.
    pub fn start(&mut self, now: Instant) {
        self.catch_up(now);
        if self.cycle != Cycle::Running {
            self.replan(now, Cycle::Running);
        }
    }

    /// Brakes from `now` on, with the acceleration of the blocks. The segment under way ends at `now`, and the next
    /// begins. What is left of the motions waits for a [start](Self::start).
    pub fn hold(&mut self, now: Instant) {
        self.catch_up(now);
        if self.cycle == Cycle::Running {
            self.replan(now, Cycle::Holding);
        }
    }

    /// Stands at once: no pulse after `now`, and no ramp. What is left of the motions waits for a
    /// [start](Self::start), and begins from rest.
    pub fn stop(&mut self, now: Instant) {
        self.cut_off(now);
        self.cursor.speed = 0.0;
        self.cycle = Cycle::Stopped;
        self.planned = look_ahead(&mut self.blocks, self.cursor, 0);
    }

    /// Stands at once, and forgets its motions. The next one begins at the position of `now`.
    pub fn abort(&mut self, now: Instant) {
        self.stop(now);
        self.blocks.clear();
        self.cursor = Cursor::default();
        (self.planned, self.place, self.given) = Default::default();
        self.end = self.position;
    }

    /// Overrides in percent, from `now` on. Too fast a motion brakes to its new speed. A [jog](Rate::Jog) has none.
    pub fn set_overrides(&mut self, now: Instant, feed: u8, rapid: u8) {
        let overrides = Overrides { feed, rapid };
        if overrides != self.overrides {
            self.overrides = overrides;
            self.catch_up(now);
            self.replan(now, self.cycle);
        }
    }

    /// The steps that have been given until `now`.
    pub fn position(&self, now: Instant) -> [i32; AXES] {
        let issued = self.segment().map_or([0; AXES], |segment| segment.issued(now));
        core::array::from_fn(|n| self.position[n].wrapping_add(issued[n]))
    }

    /// How fast the axes move together, mm a minute.
    pub fn rate(&self, now: Instant) -> f64 {
        let under_way = self.under_way.filter(|under_way| now < under_way.segment.end);
        under_way.map_or(0.0, |under_way| under_way.cut.speed * 60.0)
    }

    /// The segment under way. None while the axes stand.
    pub fn segment(&self) -> Option<&Segment> {
        self.under_way.as_ref().map(|under_way| &under_way.segment)
    }

    /// Goes to the next segment, if the one under way has ended until `now`; says whether it had.
    ///
    /// To be called at the end of each segment. After the last one the cycle waits for a [start](Self::start) again.
    pub fn advance(&mut self, now: Instant) -> bool {
        let Some(under_way) = self.under_way.take_if(|under_way| under_way.segment.end <= now) else { return false };
        self.take_pulses(&under_way.segment, under_way.segment.end);
        self.place = under_way.cut.to;
        if self.place == WHOLE {
            self.blocks.pop_front();
            self.cursor.block -= 1;
            self.planned = self.planned.saturating_sub(1);
            (self.place, self.given) = Default::default();
        }
        self.begin(under_way.segment.end);
        true
    }

    fn catch_up(&mut self, now: Instant) {
        while self.advance(now) {}
        self.cut_ahead(now);
    }

    /// Counts the pulses of a segment until `now`.
    fn take_pulses(&mut self, segment: &Segment, now: Instant) {
        let issued = segment.issued(now);
        self.position = core::array::from_fn(|n| self.position[n].wrapping_add(issued[n]));
        for (given, issued) in self.given.iter_mut().zip(issued) {
            *given += issued.unsigned_abs();
        }
    }

    /// The axes stand, or a segment has ended: the next one begins.
    fn begin(&mut self, now: Instant) {
        self.cut_ahead(now);
        let Some(cut) = self.cuts.pop_front() else {
            self.cycle = Cycle::Stopped;
            return;
        };
        let stretch = Stretch { from: self.place, to: cut.to, start: now, time: cut.time };
        let segment = stretch.segment(&self.blocks[0].steps, &self.given);
        self.under_way = Some(UnderWay { segment, cut });
    }

    /// Ends the segment under way at `now`, and takes everything back that was cut ahead.
    fn cut_off(&mut self, now: Instant) {
        self.catch_up(now);
        self.cuts.clear();
        let mut speed = self.cursor.speed;
        if let Some(under_way) = self.under_way {
            let Segment { start, end, .. } = under_way.segment;
            let part = |of: u64| {
                u128::from(of) * u128::from(now.since(start).as_nanos()) / u128::from(end.since(start).as_nanos())
            };
            self.take_pulses(&under_way.segment, now);
            self.under_way = None;
            self.place += part(under_way.cut.to - self.place) as u64;
            speed = under_way.cut.speed;
        }
        let left = self.blocks.front().map_or(0.0, |block| {
            let exit = self.blocks.get(1).map_or(0.0, |next| next.entry);
            let left = block.length * ((WHOLE - self.place) as f64 / WHOLE as f64);
            speed = speed.min(libm::sqrt(exit + 2.0 * block.acceleration * left));
            left
        });
        self.cursor = Cursor { block: 0, left, speed };
        self.planned = 0;
    }

    /// Goes on from `now` in another way.
    fn replan(&mut self, now: Instant, cycle: Cycle) {
        self.cut_off(now);
        self.cycle = cycle;
        limit_entries(&mut self.blocks, self.overrides);
        self.planned = look_ahead(&mut self.blocks, self.cursor, 0);
        self.begin(now);
    }

    /// Cuts what GRBL would have cut until `now`.
    fn cut_ahead(&mut self, now: Instant) {
        if self.cycle == Cycle::Stopped {
            return;
        }
        let left = |under_way: &UnderWay| {
            let left = under_way.segment.end.since(now).as_nanos();
            left.div_ceil(under_way.cut.slice.as_nanos())
        };
        let mut slices = self.under_way.as_ref().map_or(0, left);
        slices += self.cuts.iter().map(|cut| cut.slices).sum::<u64>();
        while slices < AHEAD
            && let Some(cut) = self.cut()
        {
            slices += cut.slices;
            self.cuts.push_back(cut);
        }
    }

    /// Cuts the next stretch off the block at the cursor.
    fn cut(&mut self) -> Option<Cut> {
        let cursor = self.cursor;
        let block = self.blocks.get(cursor.block)?;
        let profile = match self.cycle {
            Cycle::Holding if cursor.speed == 0.0 => return None,
            Cycle::Holding => Profile::stop(cursor.speed, cursor.left, block.acceleration),
            _ => {
                let exit = self.blocks.get(cursor.block + 1).map_or(0.0, |next| libm::sqrt(next.entry));
                Profile::new(cursor.speed, cursor.left, exit, block.nominal(self.overrides), block.acceleration)
            }
        };
        let least = LEAST_STEPS * block.length / block.most_steps() as f64;
        let slice = SLICE * libm::ceil(profile.time_to(least) / SLICE).max(1.0);
        let whole = profile.time();
        let cruise = profile.cruise();
        // GRBL's segments until the end of the profile, and the whole ones of the cruise.
        let slices = libm::ceil((whole - SHORTEST) / slice).max(1.0);
        let cruising = if cruise == whole { slices } else { libm::floor(cruise / slice) };
        // A cruise is cut where GRBL has cut all of the block: there its room comes back.
        let most = if slices > AHEAD as f64 { slices - AHEAD as f64 } else { slices };
        let count = libm::floor(cruising.min(most).min(LONGEST / slice)).max(1.0);
        let (time, length, speed, ends) = match count >= slices {
            true => (whole, profile.length().min(cursor.left), profile.exit(), true),
            false => {
                let (length, speed) = profile.at(count * slice);
                (count * slice, length, speed, false)
            }
        };
        let ends = ends && (self.cycle != Cycle::Holding || length >= cursor.left);
        let left = if ends { 0.0 } else { cursor.left - length };
        let to = if ends { WHOLE } else { WHOLE - ((left / block.length * WHOLE as f64) as u64).max(1) };
        let step = time * block.length / (length * block.most_steps() as f64);
        let time = Span::from_nanos(((time * timer::stretch(step) * NANOS + 0.5) as u64).max(1));
        let cut = Cut {
            to,
            time,
            slices: count as u64,
            slice: Span::from_nanos(time.as_nanos().div_ceil(count as u64)),
            speed: length / (time.as_nanos() as f64 / NANOS),
        };
        self.cursor = Cursor { left, speed, ..cursor };
        if ends {
            self.cursor.block += 1;
            self.cursor.left = self.blocks.get(self.cursor.block).map_or(0.0, |block| block.length);
            self.planned = self.planned.max(self.cursor.block);
        }
        Some(cut)
    }
}
