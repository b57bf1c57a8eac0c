//! Where an encoder's disc goes between two events of its board.

use torno_protocol::time::{Instant, Span};

use crate::encoder::Encoder;
use crate::plant::{PositionMotor, SpeedMotor};

/// A motor with its encoder, left to itself with the load as it is, and with the drive as it is but for what is on its
/// way.
#[derive(Clone, Debug)]
pub struct Motion {
    kind: Kind,
    /// What will drive the motor, and from when on, in order.
    coming: Vec<(Instant, f64)>,
}

#[derive(Clone, Debug)]
enum Kind {
    Speed(SpeedMotor, Encoder),
    Position { motor: Box<PositionMotor>, encoder: Encoder, along_slide: bool },
    None,
}

/// The share of a slot's pitch that is open; the rest is the bar before the next slot. (Ours: so the middle of a slot,
/// where the sensor begins, is no edge.)
const OPEN: f64 = 0.75;

impl Motion {
    const fn of(kind: Kind) -> Self {
        Self { kind, coming: Vec::new() }
    }

    pub(crate) const fn of_speed(motor: SpeedMotor, encoder: Encoder) -> Self {
        Self::of(Kind::Speed(motor, encoder))
    }

    pub(crate) fn of_position(motor: PositionMotor, encoder: Encoder, along_slide: bool) -> Self {
        Self::of(Kind::Position { motor: Box::new(motor), encoder, along_slide })
    }

    /// Of a plant that knows no time between two samples.
    pub(crate) const fn none() -> Self {
        Self::of(Kind::None)
    }

    /// The same with other drives on their way.
    pub(crate) fn with(self, coming: impl Iterator<Item = (Instant, f64)>) -> Self {
        Self { coming: coming.collect(), ..self }
    }

    /// How far its time has passed.
    pub(crate) fn at(&self) -> Instant {
        match &self.kind {
            Kind::Speed(motor, _) => motor.at(),
            Kind::Position { motor, .. } => motor.at(),
            Kind::None => Instant::START,
        }
    }

    /// The same at `t`.
    fn after(&self, t: Instant) -> Self {
        let mut after = self.clone();
        match &mut after.kind {
            Kind::Speed(motor, _) => motor.advance(t),
            Kind::Position { motor, .. } => motor.advance(t),
            Kind::None => {}
        }
        after
    }

    /// The number of the open part (even) or bar (odd) that the sensor sees.
    pub(crate) fn place(&self) -> i64 {
        let slots = match &self.kind {
            Kind::Speed(motor, encoder) => encoder.slots(motor.angle_rev()),
            Kind::Position { motor, encoder, along_slide: false } => encoder.slots(motor.position()),
            Kind::Position { motor, encoder, along_slide: true } => encoder.slots(motor.carriage()),
            Kind::None => 0.5,
        };
        let whole = libm::floor(slots);
        2 * whole as i64 + i64::from(slots - whole >= OPEN)
    }

    fn rate(&self) -> f64 {
        match &self.kind {
            Kind::Speed(motor, _) => motor.rate(),
            Kind::Position { motor, .. } => motor.rate(),
            Kind::None => 0.0,
        }
    }

    /// The instants up to `until` at which an edge of the disc passes the sensor, and the place behind each.
    pub(crate) fn edges(&self, until: Instant) -> Vec<(Instant, i64)> {
        let (mut motion, mut found) = (self.clone(), Vec::new());
        for (at, drive) in self.coming.iter().filter(|(at, _)| *at <= until) {
            found.extend(motion.edges_undisturbed(*at));
            motion = motion.after(*at);
            match &mut motion.kind {
                Kind::Speed(motor, _) => motor.drive(*drive),
                Kind::Position { motor, .. } => motor.drive(*drive),
                Kind::None => {}
            }
        }
        found.extend(motion.edges_undisturbed(until));
        found
    }

    /// The same, with the drive as it is.
    fn edges_undisturbed(&self, until: Instant) -> Vec<(Instant, i64)> {
        let (mut found, begin, end) = (Vec::new(), self.at(), self.after(until));
        if until <= begin {
            return found;
        }
        // With a constant drive it turns back once at the most.
        let turning = if self.rate() * end.rate() < 0.0 { self.turning(begin, until) } else { until };
        let there = self.after(turning);
        self.search((begin, self.place()), (turning, there.place()), &mut found);
        self.search((turning, there.place()), (until, end.place()), &mut found);
        found
    }

    /// The first instant at which it turns in another sense than at `from`.
    fn turning(&self, from: Instant, to: Instant) -> Instant {
        let (mut from, mut to) = (from, to);
        while let Some(middle) = middle(from, to) {
            if self.after(middle).rate() * self.rate() > 0.0 {
                from = middle;
            } else {
                to = middle;
            }
        }
        to
    }

    /// Halves an interval in which it turns one way until each edge is known to a nanosecond.
    fn search(&self, from: (Instant, i64), to: (Instant, i64), found: &mut Vec<(Instant, i64)>) {
        if from.1 == to.1 {
            return;
        }
        match middle(from.0, to.0) {
            Some(at) => {
                let middle = (at, self.after(at).place());
                self.search(from, middle, found);
                self.search(middle, to, found);
            }
            None => found.push(to),
        }
    }
}

fn middle(from: Instant, to: Instant) -> Option<Instant> {
    let half = to.since(from).as_nanos() / 2;
    (half > 0).then(|| from + Span::from_nanos(half))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The edges up to `until`, by steps of a microsecond.
    fn stepped(motion: &Motion, until: Instant) -> Vec<(Instant, i64)> {
        let (mut at, mut place, mut found) = (motion.clone(), motion.place(), Vec::new());
        while at.at() < until {
            at = at.after((at.at() + Span::from_micros(1)).min(until));
            if at.place() != place {
                place = at.place();
                found.push((at.at(), place));
            }
        }
        found
    }

    /// A motor that is at a second of full drive, and reverses within the interval, crosses a gap, or runs into a stop.
    #[test]
    fn edges_are_where_small_steps_find_them() {
        let motor = |end: f64, backlash: f64, friction: f64| {
            PositionMotor::new(0.05, 400.0, end).with_backlash(backlash).with_load(friction, 0.0, 1.0)
        };
        let any = &[400.0, 90.0, 0.0, -20.0, -400.0][..];
        for (motor, along_slide, drives) in [
            (motor(1e4, 0.0, 0.0), false, any),
            (motor(1e4, 0.0, 0.1), false, any),
            (motor(1e4, 6.0, 0.0), true, any),
            (motor(381.5, 0.0, 0.0), false, &any[..3]),
        ] {
            for drive in drives.iter().copied() {
                let mut motor = motor.clone();
                motor.drive(400.0);
                motor.advance(Instant::from_nanos(1_000_000_000));
                motor.drive(drive);
                let motion = Motion::of_position(motor, Encoder::new(1.0), along_slide);
                let all = stepped(&motion, Instant::from_nanos(1_100_000_000));
                // Where it comes back to where it began, nothing would be found without the turning.
                let back = all.iter().find(|(_, place)| *place == motion.place());
                let until = back.map_or(Instant::from_nanos(1_100_000_000), |(at, _)| *at);
                let (found, expected) = (motion.edges(until), stepped(&motion, until));
                let places = |edges: &[(Instant, i64)]| edges.iter().map(|(_, place)| *place).collect::<Vec<_>>();
                assert_eq!(places(&found), places(&expected), "{drive}");
                for ((at, _), (step, _)) in found.iter().zip(&expected) {
                    assert!(step.since(*at) <= Span::from_micros(2), "{drive}: {at} {step}");
                }
            }
        }
    }

    #[test]
    fn a_count_begins_with_an_open_part_and_a_motor_begins_in_one() {
        let mut motor = SpeedMotor::new(1.0, 0.001, core::f64::consts::TAU);
        let motion = |motor: &SpeedMotor| Motion::of_speed(motor.clone(), Encoder::new(4.0));
        assert_eq!(motion(&motor).place(), 0);
        motor.drive(core::f64::consts::TAU);
        let places: Vec<i64> =
            motion(&motor).edges(Instant::from_nanos(500_000_000)).iter().map(|(_, place)| *place).collect();
        // A revolution a second and four slots: two slots in half a second, from the middle of the first.
        assert_eq!(places, [1, 2, 3, 4]);
    }

    /// The motor stands until the first drive arrives, and turns back after the second one.
    #[test]
    fn drives_on_their_way_act_when_they_arrive() {
        let ms = |ms: u64| Instant::START + Span::from_millis(ms);
        let motor = PositionMotor::new(0.05, 400.0, 1e4);
        let still = Motion::of_position(motor.clone(), Encoder::new(1.0), false);
        assert_eq!(still.edges(ms(300)), []);
        let driven = still.with([(ms(50), 400.0), (ms(150), -400.0)].into_iter());
        let mut by_hand = motor;
        by_hand.advance(ms(50));
        by_hand.drive(400.0);
        let mut expected = Motion::of_position(by_hand.clone(), Encoder::new(1.0), false).edges(ms(150));
        by_hand.advance(ms(150));
        by_hand.drive(-400.0);
        expected.extend(Motion::of_position(by_hand, Encoder::new(1.0), false).edges(ms(300)));
        assert!(expected.len() > 40);
        assert_eq!(driven.edges(ms(300)), expected);
    }
}
