//! How the ends of travel are found: Z first, then X and Y together, as GRBL does; and then the encoders' index marks.
//!
//! An end switch closes where the carriage comes to the end of its travel. The board knows of the carriage only by its
//! switch; the way to it is reckoned here, since nothing happens on it. From the end the carriage goes on to the first
//! index mark of its encoder and back: from then on lost counts are noticed at each mark.

use torno_grbl::Axes;
use torno_grbl::memory::Settings;

/// The axes that are looked for together, in their order. A turns and has no end: its zero is where it stands. (Ours.)
const GROUPS: [&[usize]; 2] = [&[2], &[0, 1]];
/// A switch that is further away than this after the way to it has not closed, mm.
const AT_END_MM: f64 = 0.05;

/// What is done next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Seek,
    PullOff,
    Mark,
    Back,
}

/// A search for the ends.
#[derive(Clone, Debug)]
pub(crate) struct Homing {
    axes: Axes<bool>,
    group: usize,
    stage: Stage,
    /// The axes whose index marks are still looked for.
    marks: Axes<bool>,
}

/// What a search has to know of the machine.
pub(crate) struct Surroundings<'a> {
    pub(crate) settings: &'a Settings,
    /// How far each axis is from the end at which it is looked for, with its sense, mm.
    pub(crate) to_end: Axes<f64>,
    /// The way from one index mark to the next, mm; 0 if nobody counts.
    pub(crate) mark: Axes<f64>,
    /// From end to end, mm.
    pub(crate) travel: Axes<f64>,
}

/// The next motion of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Leg {
    /// How far each axis goes, mm.
    pub(crate) way: Axes<f64>,
    /// mm a minute.
    pub(crate) rate: f64,
    /// The motion ends when these have passed an index mark.
    pub(crate) marks: Axes<bool>,
}

/// What comes next in a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Next {
    Leg(Leg),
    /// A switch has not closed.
    NoEnd,
    Done,
}

impl Homing {
    pub(crate) fn new(axes: Axes<bool>) -> Self {
        Self { axes, group: 0, stage: Stage::Seek, marks: [false; 4] }
    }

    /// What comes next, when all axes stand.
    pub(crate) fn next(&mut self, at: &Surroundings<'_>) -> Next {
        while let Some(group) = GROUPS.get(self.group) {
            let axes: Vec<usize> = group.iter().copied().filter(|axis| self.axes[*axis]).collect();
            let leg = self.leg(&axes, at);
            if self.stage == Stage::PullOff && axes.iter().any(|axis| at.to_end[*axis].abs() > AT_END_MM) {
                return Next::NoEnd;
            }
            (self.group, self.stage) = match self.stage {
                Stage::Seek => (self.group, Stage::PullOff),
                Stage::PullOff => (self.group, Stage::Mark),
                Stage::Mark => (self.group, Stage::Back),
                Stage::Back => (self.group + 1, Stage::Seek),
            };
            if leg.way.iter().any(|way| *way != 0.0) {
                self.marks = leg.marks;
                return Next::Leg(leg);
            }
        }
        Next::Done
    }

    fn leg(&self, axes: &[usize], at: &Surroundings<'_>) -> Leg {
        let (feed, seek) = at.settings.homing_rates();
        let pull_off = f64::from(at.settings.pull_off());
        let mut leg = Leg { way: [0.0; 4], rate: seek.into(), marks: [false; 4] };
        for &axis in axes {
            // Away from the end.
            let away = if at.settings.homes_negative()[axis] { 1.0 } else { -1.0 };
            leg.way[axis] = match self.stage {
                Stage::Seek => at.to_end[axis],
                Stage::PullOff => away * pull_off,
                Stage::Mark => {
                    leg.marks[axis] = at.mark[axis] > 0.0;
                    away * at.mark[axis].min(at.travel[axis] - 2.0 * pull_off).max(0.0)
                }
                Stage::Back if at.mark[axis] > 0.0 => at.to_end[axis] + away * pull_off,
                Stage::Back => 0.0,
            };
        }
        if self.stage == Stage::PullOff {
            leg.rate = feed.into();
        }
        // Each axis has the rate that is set.
        leg.rate *= (axes.len() as f64).sqrt();
        leg
    }

    /// An axis has passed an index mark. Says whether it was the last one that was looked for.
    pub(crate) fn passes_mark(&mut self, axis: usize) -> bool {
        core::mem::take(&mut self.marks[axis]) && self.marks == [false; 4]
    }

    /// Whether it looks for the end of this axis.
    pub(crate) const fn has(&self, axis: usize) -> bool {
        self.axes[axis]
    }
}

/// Where an axis is when its end has been found and it has pulled off, mm: as GRBL sets it.
pub(crate) fn found_at(settings: &Settings, axis: usize) -> f64 {
    let back = f64::from(settings.pull_off());
    if settings.homes_negative()[axis] { back - f64::from(settings.max_travel[axis]) } else { -back }
}
