//! The speed profile of a block: ramp, cruise, ramp.

/// Speeds that differ by this share or less are the same: what is left of rounding.
const SAME: f64 = 1e-12;

/// A stretch of constant acceleration.
#[derive(Clone, Copy, Debug, Default)]
struct Phase {
    /// mm/s, at its start and at its end.
    from: f64,
    to: f64,
    /// s.
    time: f64,
    /// mm.
    length: f64,
}

impl Phase {
    /// A change of speed.
    fn ramp(from: f64, to: f64, acceleration: f64) -> Self {
        let time = (to - from).abs() / acceleration;
        Self { from, to, time, length: 0.5 * (from + to) * time }
    }

    /// The same change of speed, over a length that differs only by what was rounded.
    fn over(self, length: f64) -> Self {
        let mean = 0.5 * (self.from + self.to);
        Self { length, time: if mean > 0.0 { length / mean } else { 0.0 }, ..self }
    }

    fn cruise(speed: f64, length: f64) -> Self {
        let time = if length > 0.0 { length / speed } else { 0.0 };
        Self { from: speed, to: speed, time, length: length.max(0.0) }
    }

    /// mm and mm/s, after a part of its time.
    fn at(&self, time: f64) -> (f64, f64) {
        let speed = self.from + (self.to - self.from) * time / self.time;
        (0.5 * (self.from + speed) * time, speed)
    }

    /// How long the first part of its length takes, s.
    fn time_to(&self, length: f64) -> f64 {
        let share = length / self.length;
        let speed = libm::sqrt(self.from * self.from + (self.to * self.to - self.from * self.from) * share);
        2.0 * length / (self.from + speed)
    }
}

/// The fastest way along what is left of a block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Profile {
    phases: [Phase; 3],
    /// mm/s, at its end.
    exit: f64,
}

impl Profile {
    /// From `entry` over `length` to `exit`, at `nominal` at the most; mm, mm/s and mm/s².
    ///
    /// A speed above `nominal` is left as soon as possible. Where the length is too short to brake to `exit`, the end
    /// is faster, as after an override that GRBL has no room for. Where it is too short to reach `exit`, it is slower.
    pub(crate) fn new(entry: f64, length: f64, exit: f64, nominal: f64, acceleration: f64) -> Self {
        let square = |speed: f64| speed * speed;
        let reached = 2.0 * acceleration * length;
        // The square of the speed at which two ramps would meet.
        let peak = 0.5 * (square(entry) + square(exit) + reached);
        if peak <= square(entry) * (1.0 + SAME) {
            return Self::brake(entry, length, exit, acceleration);
        }
        if peak <= square(exit) * (1.0 + SAME) {
            let end = libm::sqrt(square(entry) + reached).min(exit);
            return Self::of(Phase::ramp(entry, end, acceleration).over(length));
        }
        let peak = libm::sqrt(peak);
        let top = peak.min(nominal);
        let first = Phase::ramp(entry, top, acceleration);
        let last = Phase::ramp(top, exit.min(top), acceleration);
        let cruise = length - first.length - last.length;
        // At the peak nothing is left but what was rounded.
        let cruise = if top < nominal { 0.0 } else { cruise };
        Self { phases: [first, Phase::cruise(top, cruise), last], exit: last.to }
    }

    /// To a stop, or to the end of the length.
    pub(crate) fn stop(entry: f64, length: f64, acceleration: f64) -> Self {
        let whole = Phase::ramp(entry, 0.0, acceleration);
        if whole.length <= length {
            return Self::of(whole);
        }
        Self::brake(entry, length, 0.0, acceleration)
    }

    /// Braking over the whole length, but not below `exit`.
    fn brake(entry: f64, length: f64, exit: f64, acceleration: f64) -> Self {
        let end = libm::sqrt((entry * entry - 2.0 * acceleration * length).max(0.0)).max(exit.min(entry));
        Self::of(Phase::ramp(entry, end, acceleration).over(length))
    }

    fn of(phase: Phase) -> Self {
        Self { phases: [phase, Phase::default(), Phase::default()], exit: phase.to }
    }

    /// s.
    pub(crate) fn time(&self) -> f64 {
        self.phases.iter().map(|phase| phase.time).sum()
    }

    /// mm.
    pub(crate) fn length(&self) -> f64 {
        self.phases.iter().map(|phase| phase.length).sum()
    }

    /// mm/s at its end.
    pub(crate) fn exit(&self) -> f64 {
        self.exit
    }

    /// How long the speed stays at first as it is, s.
    pub(crate) fn cruise(&self) -> f64 {
        let first = self.phases.iter().find(|phase| phase.time > 0.0);
        first.filter(|phase| phase.from == phase.to).map_or(0.0, |phase| phase.time)
    }

    /// mm and mm/s, `time` s after its start.
    pub(crate) fn at(&self, mut time: f64) -> (f64, f64) {
        let mut length = 0.0;
        for phase in self.phases.iter().filter(|phase| phase.time > 0.0) {
            if time < phase.time {
                let (part, speed) = phase.at(time);
                return (length + part, speed);
            }
            time -= phase.time;
            length += phase.length;
        }
        (length, self.exit())
    }

    /// How long the first `length` mm take, s.
    pub(crate) fn time_to(&self, mut length: f64) -> f64 {
        let mut time = 0.0;
        for phase in self.phases.iter().filter(|phase| phase.time > 0.0) {
            if length < phase.length {
                return time + phase.time_to(length);
            }
            length -= phase.length;
            time += phase.time;
        }
        time
    }
}
