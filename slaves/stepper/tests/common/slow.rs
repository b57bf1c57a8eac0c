//! An axis without any cleverness: the field is moved by a sixteenth of a pulse at a time, every edge of the encoder is
//! seen, and every check is made.

use std::collections::VecDeque;

use torno_protocol::time::{Instant, Span};
use torno_protocol::train::Train;
use torno_stepper::{
    Alarm, AxisSettings, Cause, Channel, CountScale, Fault, Law, LoopEvent, Mode, PAPER_COUNT_PM, Sensor,
};

use super::Driven;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    Watching,
    Settling(Instant),
    Adding { until: Instant, settle: bool, stop: i64 },
    Alarmed,
}

#[derive(Clone, Copy, Debug)]
struct Run {
    train: Train,
    sense: i64,
    extra: bool,
    lost: bool,
    /// Pulses that have come, with what is under way of one.
    reached: f64,
}

/// Lengths are in pulses.
#[derive(Clone, Debug)]
pub(crate) struct Slow {
    settings: AxisSettings,
    now: Instant,
    turn: f64,
    pulse_mm: f64,
    pulse_pm: i64,
    count: f64,
    count_pm: i64,
    n: i64,
    dead_band: i64,
    backlash_pulses: i64,
    field: f64,
    rotor: f64,
    carriage: f64,
    backlash: f64,
    shift: f64,
    stops: (f64, f64),
    bed: f64,
    friction: f64,
    push: f64,
    supply: f64,
    stalled: bool,
    out_of_step: bool,
    speed: f64,
    sense: i64,
    program_sense: i64,
    run: Option<Run>,
    coming: Option<Run>,
    /// The pulses of the correction that was over last.
    added: i64,
    /// Pulses for backlash that the motor's encoder counts.
    paid: i64,
    last: Option<(Instant, i64)>,
    skip: Option<(i64, i64)>,
    swapped: bool,
    dead: Option<Channel>,
    passed: i64,
    pub(crate) total: i64,
    program: i64,
    issued: i64,
    pub(crate) checks: u64,
    pub(crate) corrections: u64,
    pub(crate) worst: f64,
    /// The least distance of an edge from where the sensor was at a check, in counts.
    pub(crate) margin: f64,
    phase: Phase,
    tries: u32,
    vain: u32,
    best: Option<i64>,
    events: VecDeque<LoopEvent>,
}

impl Slow {
    pub(crate) fn new(settings: &AxisSettings) -> Self {
        let per_rev = settings.mechanics.mm_per_rev();
        let pulse_mm = per_rev / f64::from(settings.drive.pulses_per_rev);
        let encoder = &settings.encoder;
        let count_mm = match settings.control.sensor {
            Sensor::Belt => {
                f64::from(encoder.belt_teeth) * encoder.belt_pitch_mm / (4.0 * f64::from(encoder.belt_lines))
            }
            Sensor::Motor => per_rev / (4.0 * f64::from(encoder.motor_lines)),
            Sensor::Scale => encoder.scale_um / 1_000.0,
        };
        let pm = |mm: f64| (mm * 1e9).round() as i64;
        let count_pm = match settings.control.scale {
            CountScale::Exact => pm(count_mm),
            CountScale::Paper => PAPER_COUNT_PM,
            CountScale::Own => settings.control.count_pm as i64,
        };
        let pulse_pm = pm(pulse_mm);
        let least = (count_pm as f64 / pulse_pm as f64 - 1e-9).ceil() as i64;
        let n = if settings.control.pulses == 0 { least } else { settings.control.pulses.into() };
        let dead_band = settings.control.dead_band_pulses;
        let bed = settings.mechanics.travel_mm / 2.0 / pulse_mm;
        Self {
            now: Instant::START,
            turn: 4.0 * f64::from(settings.drive.pulses_per_rev) / f64::from(settings.motor.full_steps),
            pulse_mm,
            pulse_pm,
            count: count_mm / pulse_mm,
            count_pm,
            n,
            dead_band: match (dead_band, settings.control.pulses) {
                (0, 0) if settings.drive.pulses_per_rev > 2_000 => {
                    let per_coarse = f64::from(settings.drive.pulses_per_rev) / 2_000.0;
                    ((count_pm as f64 / pulse_pm as f64 / per_coarse - 1e-9).ceil() * per_coarse).ceil() as i64
                }
                (0, _) => n,
                (set, _) => set.into(),
            },
            backlash_pulses: (settings.control.backlash_mm / pulse_mm).round() as i64,
            field: 0.0,
            rotor: 0.0,
            carriage: 0.0,
            backlash: settings.mechanics.backlash_mm / pulse_mm,
            shift: 0.0,
            stops: (-bed, bed),
            bed,
            friction: settings.motor.friction,
            push: 0.0,
            supply: 1.0,
            stalled: false,
            out_of_step: false,
            speed: 0.0,
            sense: 1,
            program_sense: 1,
            run: None,
            coming: None,
            added: 0,
            paid: 0,
            last: None,
            skip: None,
            swapped: false,
            dead: None,
            passed: 0,
            total: 0,
            program: 0,
            issued: 0,
            checks: 0,
            corrections: 0,
            worst: 0.0,
            margin: 1.0,
            phase: Phase::Watching,
            tries: 0,
            vain: 0,
            best: None,
            events: VecDeque::new(),
            settings: settings.clone(),
        }
    }

    pub(crate) fn carriage_mm(&self) -> f64 {
        self.carriage * self.pulse_mm
    }

    pub(crate) fn advance(&mut self, until: Instant) {
        while self.now < until {
            match self.run {
                Some(run) if run.train.first <= self.now => {
                    let stop = until.min(run.train.end());
                    let reached = reached(&run.train, stop);
                    self.feed(reached);
                    self.now = stop;
                    if stop == run.train.end() {
                        self.over();
                    }
                }
                _ => match self.coming.filter(|run| run.train.first <= until) {
                    Some(run) => {
                        if run.train.first > self.now {
                            self.stand();
                        }
                        self.now = self.now.max(run.train.first);
                        self.coming = None;
                        self.begin(run);
                    }
                    None => {
                        self.stand();
                        self.now = until;
                    }
                },
            }
        }
        if let Some(run) = self.coming.filter(|run| self.run.is_none() && run.train.first <= self.now) {
            self.coming = None;
            self.begin(run);
        }
    }

    fn begin(&mut self, run: Run) {
        let speed = run.train.hz() * self.pulse_mm;
        let before = self.last.map_or(0.0, |(at, sense)| {
            sense as f64 * self.pulse_mm / run.train.first.since(at).as_secs_f64().max(1e-9)
        });
        let jump = if self.is_held(run.sense) { speed } else { (run.sense as f64 * speed - before).abs() };
        (self.sense, self.speed) = (run.sense, speed);
        self.out_of_step = self.loses(jump);
        self.run = Some(run);
        self.relax();
    }

    fn over(&mut self) {
        let run = self.run.take().unwrap();
        if !run.extra {
            self.program += run.sense * run.train.count as i64;
            self.issued += run.train.count as i64;
        } else {
            self.added = run.train.count as i64;
        }
        self.last = Some((run.train.ticks().at(run.train.count - 1), run.sense));
    }

    /// No train has followed at once.
    fn stand(&mut self) {
        (self.speed, self.out_of_step) = (0.0, false);
        self.relax();
    }

    fn loses(&self, jump: f64) -> bool {
        let load = (self.friction + self.sense as f64 * self.push).clamp(0.0, 1.0);
        let a = libm::asin(load);
        let b = 2.0 * libm::cos(a) - load * (core::f64::consts::PI - 2.0 * a);
        let start = self.settings.motor.start_mm_per_s;
        start > 0.0 && jump > start * (b.max(0.0) / 2.0).sqrt()
    }

    fn q(&self) -> f64 {
        let ratio = self.speed / self.settings.motor.corner_mm_per_s;
        self.supply / (1.0 + ratio * ratio).sqrt()
    }

    fn is_held(&self, sense: i64) -> bool {
        let against = self.friction + sense as f64 * self.push;
        self.stalled || self.out_of_step || against >= self.q() || -against > self.q() || {
            // Pushed away the other way.
            sense as f64 * self.push - self.friction > self.q()
        }
    }

    /// Moves the field on to where so many pulses have come.
    fn feed(&mut self, to: f64) {
        let mut most: f64 = 1.0 / 16.0;
        while let Some(run) = self.run.filter(|run| run.reached < to) {
            let to_pulse = run.reached.floor() + 1.0 - run.reached;
            let step = (to - run.reached).min(most).min(to_pulse);
            let mut next = self.clone();
            next.step(run, step, if step == to_pulse { run.reached.floor() + 1.0 } else { run.reached + step });
            // Where it slips is to be known better than that.
            if (next.rotor - self.rotor).abs() > 2.0 * step && step > 1e-9 {
                most = step / 2.0;
                continue;
            }
            most = 1.0 / 16.0;
            *self = next;
        }
    }

    fn step(&mut self, run: Run, step: f64, reached: f64) {
        self.run = Some(Run { reached, ..run });
        let skipped = match &mut self.skip {
            Some((every, number)) => {
                *number += i64::from(run.reached.fract() == 0.0);
                *number > 0 && *number % *every == 0
            }
            None => false,
        };
        if !run.lost && !skipped {
            self.field += run.sense as f64 * step;
            self.relax();
        }
        if !run.extra {
            let asked = self.program as f64 + run.sense as f64 * reached;
            self.worst = self.worst.max((asked - self.carriage).abs());
        }
    }

    /// Lets the rotor go where the torque takes it.
    fn relax(&mut self) {
        if self.stalled || self.out_of_step {
            return self.mesh();
        }
        let q = self.q();
        let net =
            |rotor: f64, field: f64| q * libm::sin(core::f64::consts::TAU * (field - rotor) / self.turn) - self.push;
        let screw_stops = (self.stops.0 - self.shift - self.backlash, self.stops.1 - self.shift);
        let here = net(self.rotor, self.field);
        let sense = if here > self.friction + 1e-12 {
            1.0
        } else if here < -self.friction - 1e-12 {
            -1.0
        } else {
            return self.mesh();
        };
        // In small steps, then by halves, to where friction holds it.
        let pulled = |rotor: f64| sense * net(rotor, self.field) > self.friction;
        let beyond = |rotor: f64| rotor <= screw_stops.0 && sense < 0.0 || rotor >= screw_stops.1 && sense > 0.0;
        let (mut from, mut to) = (self.rotor, self.rotor);
        while pulled(to) && !beyond(to) {
            (from, to) = (to, to + sense * 0.01);
        }
        for _ in 0..60 {
            let middle = (from + to) / 2.0;
            if pulled(middle) { from = middle } else { to = middle }
        }
        self.rotor =
            if sense > 0.0 { to.min(screw_stops.1.max(self.rotor)) } else { to.max(screw_stops.0.min(self.rotor)) };
        self.mesh();
    }

    fn mesh(&mut self) {
        let screw = self.rotor + self.shift;
        self.carriage = if self.push > self.friction {
            screw
        } else if self.push < -self.friction {
            screw + self.backlash
        } else {
            self.carriage.max(screw).min(screw + self.backlash)
        };
        let place = self.place();
        while self.passed != place.floor() as i64 {
            let before = self.levels();
            self.passed += if self.passed < place.floor() as i64 { 1 } else { -1 };
            let after = self.levels();
            // Encoder mode 3: the edge of one channel counts by the level of the other.
            let sense = match (before.0 != after.0, before.1 != after.1) {
                (true, _) => {
                    if after.0 != after.1 {
                        1
                    } else {
                        -1
                    }
                }
                (_, true) => {
                    if after.0 == after.1 {
                        1
                    } else {
                        -1
                    }
                }
                _ => 0,
            };
            self.total += sense;
        }
    }

    /// Counts that have passed, and what part of the next one.
    fn place(&self) -> f64 {
        let at = if self.settings.control.sensor == Sensor::Motor { self.rotor } else { self.carriage };
        // A place on an edge has passed it.
        at / self.count + self.settings.encoder.phase + 1e-10
    }

    fn levels(&self) -> (bool, bool) {
        let quarter = self.passed.rem_euclid(4);
        let a = (quarter == 1 || quarter == 2) && self.dead != Some(Channel::A);
        let b = quarter >= 2 && self.dead != Some(Channel::B);
        if self.swapped { (b, a) } else { (a, b) }
    }

    fn completed(&self) -> (i64, i64) {
        let run = self.run.filter(|run| !run.extra);
        let (sense, pulses) = run.map_or((0, 0), |run| (run.sense, run.reached.floor() as i64));
        (self.program + sense * pulses, self.issued + pulses)
    }

    fn error(&mut self) -> i64 {
        let place = self.place();
        self.margin = self.margin.min((place - place.round()).abs());
        (self.completed().0 + self.paid) * self.pulse_pm - self.total * self.count_pm
    }

    fn next_check(&self) -> Option<Instant> {
        match (self.settings.control.mode, self.phase) {
            (Mode::Open, _) => None,
            (Mode::Fixed, Phase::Watching) => {
                let period = (self.settings.control.period_ms * 1e6).round() as u64;
                // At rest nothing changes any more.
                let moves = self.run.is_some() || self.coming.is_some() || self.fresh();
                moves.then(|| Instant::from_nanos((self.now.as_nanos() / period + 1) * period))
            }
            (_, Phase::Watching) => self.next_multiple(false, self.issued),
            (_, Phase::Adding { .. }) => self.next_multiple(true, 0),
            _ => None,
        }
    }

    fn fresh(&self) -> bool {
        let mut copy = self.clone();
        copy.error().abs() >= self.dead_band * self.pulse_pm
    }

    fn next_multiple(&self, extra: bool, before: i64) -> Option<Instant> {
        let run = self.run.or(self.coming).filter(|run| run.extra == extra)?;
        let next = run.reached.floor() as i64 + 1;
        let next = next + (-(before + next)).rem_euclid(self.n);
        (next <= run.train.count as i64).then(|| run.train.ticks().at(next as u64))
    }

    /// No pulse begins from now on.
    fn cut(&mut self) {
        self.coming = None;
        if let Some(run) = &mut self.run {
            run.train.count = run.train.begun(self.now);
            if run.train.count == 0 {
                self.run = None;
            }
        }
    }

    fn check(&mut self) {
        self.checks += 1;
        let error = self.error();
        if error.abs() < self.dead_band * self.pulse_pm {
            return;
        }
        self.cut();
        self.events.push_back(LoopEvent::Stop);
        if error.abs() > self.stop_pm() {
            return self.give_up(Cause::TooFar);
        }
        (self.tries, self.best) = (0, None);
        self.phase = Phase::Settling(self.now + self.settle());
    }

    fn stop_pm(&self) -> i64 {
        (self.settings.control.stop_mm * 1e9).round() as i64
    }

    fn settle(&self) -> Span {
        Span::from_nanos((self.settings.control.settle_ms * 1e6).round() as u64)
    }

    fn settled(&mut self) {
        self.checks += 1;
        let error = self.error();
        if error.abs() > self.stop_pm() {
            return self.give_up(Cause::TooFar);
        }
        if error.abs() < self.dead_band * self.pulse_pm {
            let first = self.best.is_none();
            self.vain += u32::from(first);
            if !(first && self.vain >= 3 && 2 * error.abs() >= self.pulse_pm) {
                self.phase = Phase::Watching;
                return self.events.push_back(LoopEvent::Resume { ramp: true });
            }
        }
        self.vain = 0;
        match self.best {
            Some(best) if best - error.abs() < self.count_pm / 2 => self.tries += 1,
            _ => (self.tries, self.best) = (0, Some(error.abs())),
        }
        if self.tries > self.settings.control.tries {
            return self.give_up(Cause::Stalled);
        }
        self.corrections += 1;
        let pulses = (error.abs() as f64 / self.pulse_pm as f64).round() as i64;
        self.add(error.signum() * pulses, true);
    }

    fn add(&mut self, pulses: i64, settle: bool) {
        assert_eq!(self.settings.control.law, Law::Pause);
        let first = self.run.map_or(self.now, |run| run.train.end().max(self.now));
        let nanos = (1e9 / self.settings.control.correct_hz).round() as u64;
        let train = Train { first, nanos, per: 1, count: pulses.unsigned_abs(), high: Span::from_nanos(nanos / 2) };
        let (check, count) = (self.n * self.pulse_pm, self.count_pm / 2 * 2);
        let stop = (self.stop_pm() - check - count).max(self.error().abs() + count);
        self.phase = Phase::Adding { until: train.end(), settle, stop };
        self.events.push_back(LoopEvent::Correct { forward: pulses > 0, train });
        self.coming = Some(Run { train, sense: pulses.signum(), extra: true, lost: false, reached: 0.0 });
        self.advance(self.now);
    }

    fn give_up(&mut self, cause: Cause) {
        let error_pm = self.error();
        self.cut();
        self.phase = Phase::Alarmed;
        self.events.push_back(LoopEvent::Alarm(Alarm { cause, error_pm }));
    }
}

impl Driven for Slow {
    fn train(&mut self, now: Instant, forward: bool, train: Train) {
        self.advance(now);
        assert_eq!(self.phase, Phase::Watching);
        let sense = if forward { 1 } else { -1 };
        let changes = sense != self.program_sense;
        self.program_sense = sense;
        if changes && self.backlash_pulses > 0 {
            self.cut();
            self.events.push_back(LoopEvent::Stop);
            if self.settings.control.sensor == Sensor::Motor {
                self.paid += sense * self.backlash_pulses;
            }
            return self.add(sense * self.backlash_pulses, false);
        }
        let hz = train.hz();
        let low = 1e9 / hz - train.high.as_nanos() as f64;
        let least = self.settings.drive.min_pulse_us * 1e3;
        let high = train.high.as_nanos() as f64;
        let lost = hz > self.settings.drive.max_hz * (1.0 + 1e-9) || high < least || low < least * (1.0 - 1e-9);
        self.coming = Some(Run { train, sense, extra: false, lost, reached: 0.0 });
        self.advance(now);
    }

    fn end(&mut self, now: Instant) {
        self.advance(now);
        if self.settings.control.mode == Mode::Dynamic {
            self.check();
        }
    }

    fn deadline(&self) -> Option<Instant> {
        let check = self.next_check();
        match self.phase {
            Phase::Watching => check,
            Phase::Settling(until) => Some(until),
            Phase::Adding { until, .. } => Some(check.map_or(until, |check| check.min(until))),
            Phase::Alarmed => None,
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.advance(now);
        match self.phase {
            Phase::Watching => self.check(),
            Phase::Settling(_) => self.settled(),
            Phase::Adding { until, settle, stop } => {
                if self.settings.control.mode != Mode::Open && self.error().abs() > stop {
                    let run = self.run;
                    let pulses = run.map_or(self.added, |run| run.reached.floor() as i64);
                    if pulses % self.n == 0 {
                        return self.give_up(Cause::TooFar);
                    }
                }
                if now >= until {
                    self.phase = if settle { Phase::Settling(now + self.settle()) } else { Phase::Watching };
                    if !settle {
                        self.events.push_back(LoopEvent::Resume { ramp: true });
                    }
                }
            }
            Phase::Alarmed => {}
        }
    }

    fn poll_event(&mut self) -> Option<LoopEvent> {
        self.events.pop_front()
    }

    fn fault(&mut self, now: Instant, fault: Fault) {
        self.advance(now);
        let held = self.is_held(self.sense);
        let pulses = |pm: i64| pm as f64 / 1e9 / self.pulse_mm;
        match fault {
            Fault::Stall(stalled) => self.stalled = stalled,
            Fault::Load(0) => self.friction = self.settings.motor.friction,
            Fault::Load(load) => self.friction = f64::from(load) / 1e3,
            Fault::Push(push) => self.push = f64::from(push) / 1e3,
            Fault::Supply(supply) => self.supply = f64::from(supply) / 1e3,
            Fault::Backlash(Some(pm)) => self.backlash = pulses(pm.into()),
            Fault::Backlash(None) => self.backlash = self.settings.mechanics.backlash_mm / self.pulse_mm,
            Fault::EndStop(0) => self.stops = (-self.bed, self.bed),
            Fault::EndStop(pm) if pm > 0 => self.stops.1 = pulses(pm).min(self.bed).max(self.carriage),
            Fault::EndStop(pm) => self.stops.0 = pulses(pm).max(-self.bed).min(self.carriage),
            Fault::Counts(counts) => self.total += self.program_sense * counts,
            Fault::Slip(turns) => self.rotor += f64::from(turns) * self.turn,
            Fault::Skip(0) => self.skip = None,
            Fault::Skip(every) => self.skip = Some((every.into(), 0)),
            Fault::Shift(pm) => {
                let by = pulses(pm);
                self.shift += by;
                self.carriage += by;
            }
            Fault::SwappedChannels(swapped) => self.swapped = swapped,
            Fault::DeadChannel(dead) => self.dead = dead,
        }
        if held && !self.is_held(self.sense) && self.loses(self.speed) {
            self.out_of_step = true;
        }
        self.relax();
    }

    fn issued(&self, now: Instant) -> i64 {
        let begun = |run: &Run| if run.extra { 0 } else { run.sense * run.train.begun(now) as i64 };
        self.program + [&self.run, &self.coming].into_iter().flatten().map(begun).sum::<i64>()
    }

    fn is_ready(&self) -> bool {
        self.phase == Phase::Watching
    }
}

fn reached(train: &Train, at: Instant) -> f64 {
    let ticks = train.ticks();
    if at >= train.end() {
        return train.count as f64;
    }
    let n = (ticks.first_from(at.next()) - 1).min(train.count - 1);
    let (begin, end) = (ticks.at(n), ticks.at(n + 1));
    n as f64 + at.since(begin).as_nanos() as f64 / end.since(begin).as_nanos() as f64
}
