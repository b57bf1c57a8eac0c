//! The machine behind the pins: trains of pulses go in, the encoder's counts come out.
//!
//! Time is gone through in stretches in which everything that moves, moves evenly. However it is cut, the same comes
//! out.

use torno_protocol::time::Instant;
use torno_protocol::train::Train;

use crate::drive::{Drive, ScheduledTrain};
use crate::encoder::{Channels, Encoder};
use crate::plant::{Piece, Plant, SUBSTEPS_OF_A_TURN};
use crate::scale::Scale;
use crate::settings::{AxisSettings, Sensor};
use crate::swing::{Path, SUBSTEP_NS};

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Machine {
    pub(crate) at: Instant,
    pub(crate) scale: Scale,
    pub(crate) plant: Plant,
    pub(crate) drive: Drive,
    pub(crate) encoder: Encoder,
    /// The encoder is on the motor's shaft.
    pub(crate) on_motor: bool,
    pub(crate) run: Option<ScheduledTrain>,
    /// A train that has not begun.
    next: Option<ScheduledTrain>,
    /// The end and the sense of the last train, and its last pulse.
    last: Option<(Instant, i64, Instant)>,
    /// Pulses of the program whose periods are over: with their sense, and all of them.
    pub(crate) program: i64,
    pub(crate) issued: i64,
    /// What the program's pulses less the carriage are where the deviation is 0, in units.
    zero: i64,
    /// The largest deviations, in units: while the program moves, and in its pauses.
    pub(crate) worst: i64,
    pub(crate) worst_paused: i64,
}

/// A time in which the sensor stands or moves evenly, or goes through a substep of a rotor that swings.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stretch<'a> {
    /// It begins not before, and ends not after that: see [`Self::times`].
    begin: Instant,
    end: Instant,
    /// The train under way, and how far it comes, in units.
    pub(crate) run: Option<(&'a ScheduledTrain, i64, i64)>,
    /// Where the sensor is at the beginning.
    pub(crate) sensed: i64,
    /// How the sensor moves while the train goes a unit: 1, 0 or −1.
    pub(crate) slope: i64,
    /// The rotor swings: this tells where the sensor is, which at the end is at [`Self::sensed`].
    pub(crate) path: Option<Path>,
}

impl Stretch<'_> {
    /// Where it begins and ends: in units of the train, or in nanoseconds without one.
    pub(crate) fn places(&self) -> (i64, i64) {
        self.run.map_or((place(self.begin), place(self.end)), |(_, from, to)| (from, to))
    }

    /// About when it has come to a place.
    pub(crate) fn instant(&self, place: i64) -> Instant {
        self.run.map_or(Instant::from_nanos(place.unsigned_abs()), |(run, ..)| run.when(place))
    }

    /// When it begins and ends.
    pub(crate) fn times(&self) -> (Instant, Instant) {
        let Some((run, from, to)) = self.run else { return (self.begin, self.end) };
        let end = if self.path.is_some() { run.when(to).min(self.end) } else { self.end };
        (run.when(from).max(self.begin), end)
    }

    /// The first place at which the sensor of a rotor that swings is where it is to be, if it is so at the end.
    pub(crate) fn first_place(&self, machine: &Machine, is_there: impl Fn(i64) -> bool) -> Option<i64> {
        let path = self.path.filter(|path| is_there(machine.senses(path, self.places().1)))?;
        let (mut before, mut there) = self.places();
        while there - before > 1 {
            let middle = before + (there - before) / 2;
            if is_there(machine.senses(&path, middle)) {
                there = middle;
            } else {
                before = middle;
            }
        }
        Some(there)
    }
}

/// An instant as a place on a path without a train.
fn place(at: Instant) -> i64 {
    i64::try_from(at.as_nanos()).unwrap_or(i64::MAX)
}

impl Machine {
    pub(crate) fn new(settings: &AxisSettings) -> Self {
        let (scale, sensor) = (settings.scale(), settings.control.sensor);
        Self {
            at: Instant::START,
            scale,
            plant: Plant::new(settings, &scale),
            drive: Drive::new(&settings.drive),
            encoder: Encoder::new(scale.count, settings.encoder.phase, settings.encoder.counts_per_index(sensor)),
            on_motor: sensor == Sensor::Motor,
            run: None,
            next: None,
            last: None,
            program: 0,
            issued: 0,
            zero: 0,
            worst: 0,
            worst_paused: 0,
        }
    }

    /// What the encoder measures, in units.
    pub(crate) const fn sensed(&self) -> i64 {
        self.plant.mechanics.sensed(self.on_motor)
    }

    /// What it measures at a place of this path.
    pub(crate) fn senses(&self, path: &Path, place: i64) -> i64 {
        path.at(place, &self.plant.mechanics).sensed(self.on_motor)
    }

    /// Something changes what moves the rotor.
    pub(crate) fn disturb(&mut self, change: impl FnOnce(&mut Plant)) {
        self.plant.disturb(change);
        self.note_deviation(0);
    }

    /// What the encoder has counted.
    pub(crate) const fn counted(&self) -> i64 {
        self.encoder.counted(self.sensed())
    }

    /// From now on every `every`th pulse is lost; 0 heals.
    pub(crate) fn skip(&mut self, every: u32) {
        self.drive.skip(every, self.run.as_ref());
        self.plant.release();
    }

    /// The program's pulses, with what is under way of one, less the carriage: in units.
    pub(crate) fn deviation(&self) -> i64 {
        let way = self.run.filter(|run| !run.extra).map_or(0, |run| run.sense * run.reached);
        self.program * self.scale.pulse + way - self.plant.mechanics.carriage - self.zero
    }

    /// There is no deviation now.
    pub(crate) fn zero(&mut self) {
        self.zero += self.deviation();
        (self.worst, self.worst_paused) = (0, 0);
    }

    /// Notes the deviation, which has grown by so much while everything has moved evenly: it is largest at the ends. In
    /// the midst of a substep it is not noted, so that it matters not how time is cut.
    pub(crate) fn note_deviation(&mut self, grown: i64) {
        if self.plant.substep_end().is_some() {
            return;
        }
        let now = self.deviation();
        let moves = self.run.is_some_and(|run| !run.extra);
        let worst = if moves { &mut self.worst } else { &mut self.worst_paused };
        *worst = (*worst).max(now.abs()).max((now - grown).abs());
    }

    /// The program's pulses whose periods are over, those of the train under way included: with their sense, and all.
    pub(crate) fn program_now(&self) -> (i64, i64) {
        let run = self.run.filter(|run| !run.extra);
        let (sense, completed) = run.map_or((0, 0), |run| (run.sense, run.completed()));
        (self.program + sense * completed, self.issued + completed)
    }

    /// The program's pulses that have begun before `t`, with their sense.
    pub(crate) fn begun(&self, t: Instant) -> i64 {
        let begun = |run: &ScheduledTrain| if run.extra { 0 } else { run.sense * run.begun(t) };
        self.program + [&self.run, &self.next].into_iter().flatten().map(begun).sum::<i64>()
    }

    /// Whether the period of a pulse of the program is over just now.
    pub(crate) fn has_issued(&self) -> bool {
        match &self.run {
            Some(run) if run.completed() > 0 => !run.extra && run.tick(run.completed()) == self.at,
            _ => self.last.is_some_and(|(end, ..)| end == self.at),
        }
    }

    /// When the trains are over.
    pub(crate) fn end(&self) -> Option<Instant> {
        self.next.or(self.run).map(|run| run.end)
    }

    /// Pulses come from now on, instead of those that have not begun.
    pub(crate) fn feed(&mut self, train: &Train, sense: i64, extra: bool) {
        self.cut();
        let lost = self.drive.misses(train);
        let substep = (SUBSTEP_NS, self.scale.turn / SUBSTEPS_OF_A_TURN);
        let next = ScheduledTrain::new(train, sense, extra, lost, self.scale.pulse, substep);
        if next.count() == 0 {
            return;
        }
        if let Some(run) = &mut self.run
            && next.first < run.end
        {
            run.end = next.first.max(self.at);
            self.plant.release();
        }
        self.next = Some(next);
    }

    /// No pulse begins from now on.
    pub(crate) fn cut(&mut self) {
        self.next = None;
        if let Some(run) = &mut self.run
            && !run.cut(self.at)
        {
            self.run = None;
        }
        if let Some(run) = &self.run
            && self.plant.substep_end() > Some(run.count() * self.scale.pulse)
        {
            self.plant.release();
        }
    }

    fn begin(&mut self, run: ScheduledTrain) {
        let speed = run.hz * self.scale.pulse_mm();
        let before = self.last.map_or(0.0, |(_, sense, last)| {
            let gap = run.first.since(last).as_secs_f64().max(1e-9);
            sense as f64 * self.scale.pulse_mm() / gap
        });
        // From pulse to pulse the speed has been this.
        let jump = (run.sense as f64 * speed - before).abs();
        self.plant.run(run.sense, speed, jump);
        self.run = Some(run);
    }

    fn over(&mut self, run: &ScheduledTrain) {
        self.drive.over(run);
        if !run.extra {
            self.program += run.sense * run.count();
            self.issued += run.count();
        }
        self.last = Some((run.end, run.sense, run.last()));
        self.run = None;
    }

    /// Lets the time up to `until` pass.
    pub(crate) fn advance(&mut self, until: Instant) {
        self.walk(until, |_, _| None);
    }

    /// Lets the time up to `until` pass, as far as `watch` does not find an instant in a stretch, which it then gives.
    pub(crate) fn walk(
        &mut self,
        until: Instant,
        mut watch: impl FnMut(&Self, &Stretch<'_>) -> Option<Instant>,
    ) -> Option<Instant> {
        loop {
            let Some(mut run) = self.run else {
                let next = self.next.filter(|next| next.first <= until);
                let end = next.map_or(until, |next| next.first.max(self.at));
                while end > self.at {
                    // No train has followed at once.
                    self.plant.stand();
                    self.note_deviation(0);
                    let begin = self.at;
                    let moved = self.plant.idle(place(begin), place(end));
                    let end = moved.map_or(end, |(place, _)| Instant::from_nanos(place.unsigned_abs()));
                    let path = moved.map(|(_, path)| path);
                    let idle = Stretch { begin, end, run: None, sensed: self.sensed(), slope: 0, path };
                    let found = watch(self, &idle);
                    if found.is_some() {
                        return found;
                    }
                    self.at = end;
                }
                let next = next?;
                self.next = None;
                self.begin(next);
                continue;
            };
            let to = run.at(until).max(run.reached);
            while run.reached < to {
                let found = self.piece(&mut run, to, until, &mut watch);
                if found.is_some() {
                    return found;
                }
            }
            if until < run.end {
                self.at = until;
                return None;
            }
            self.at = run.end;
            self.over(&run);
        }
    }

    /// What the encoder's channels do up to `until`: the instants at which one of them changes, and their levels then.
    pub(crate) fn edges(mut self, until: Instant) -> Vec<(Instant, Channels)> {
        let (encoder, mut passed) = (self.encoder, self.encoder.passed(self.sensed()));
        let mut edges = Vec::new();
        self.walk(until, |machine, stretch| {
            // A slide passes many edges at once.
            while passed != encoder.passed(stretch.sensed) {
                let step = (encoder.passed(stretch.sensed) - passed).signum();
                passed += step;
                let crossed = stretch.first_place(machine, |sensed| step * encoder.passed(sensed) >= step * passed);
                let at = crossed.map_or_else(|| stretch.times().0, |place| stretch.instant(place));
                edges.push((at, encoder.channels(passed)));
            }
            let (run, from, to) = stretch.run.filter(|_| stretch.slope != 0)?;
            let mut reached = from;
            loop {
                reached += encoder.edge_ahead(stretch.sensed + stretch.slope * (reached - from), stretch.slope);
                if reached > to {
                    break;
                }
                passed += stretch.slope;
                edges.push((run.when(reached), encoder.channels(passed)));
            }
            None
        });
        edges
    }

    /// Goes through a piece of the train, up to `to` at most, which it reaches at `until` or when the train ends.
    fn piece(
        &mut self,
        run: &mut ScheduledTrain,
        to: i64,
        until: Instant,
        watch: &mut impl FnMut(&Self, &Stretch<'_>) -> Option<Instant>,
    ) -> Option<Instant> {
        let from = run.reached;
        let (lost, part) = self.drive.part(run);
        let most = part.min(to - from);
        let Piece { units, rotor, carriage, path } = self.plant.piece(run, lost, part, most);
        let moves = if self.on_motor { rotor } else { carriage };
        let slope = if moves { run.sense } else { 0 };
        run.reached += units;
        // Where there is a substep at every place, when that is is reckoned only if it matters.
        let end = if run.reached == to || path.is_some() { until.min(run.end) } else { run.when(run.reached) };
        let sensed = self.sensed() - slope * units;
        let stretch = Stretch { begin: self.at, end, run: Some((run, from, run.reached)), sensed, slope, path };
        let found = watch(self, &stretch);
        if path.is_none() {
            self.at = end;
        }
        if let Some(own) = &mut self.run {
            own.reached = run.reached;
        }
        let asked = if run.extra || path.is_some() { 0 } else { run.sense * units };
        let moved = if carriage { run.sense * units } else { 0 };
        self.note_deviation(asked - moved);
        found
    }
}
