//! The plant: the field turns the rotor, the rotor the screw, the screw moves the carriage.
//!
//! While the field moves one way at a constant rate, all of them stand or move evenly. A piece is as long as none of
//! them changes between the two. While the rotor swings, a piece is at most a substep.

use core::f64::consts::TAU;

use crate::drive::ScheduledTrain;
use crate::mechanics::Mechanics;
use crate::rotor::{Grip, Load, Next, start_limit, torque};
use crate::scale::Scale;
use crate::settings::AxisSettings;
use crate::swing::{Forces, Path, SUBSTEP_NS, Step, Swing};

/// A motor with what it moves. Lengths are in units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Plant {
    pub(crate) mechanics: Mechanics,
    field: i64,
    turn: i64,
    grip: Grip,
    /// The largest torque of the field.
    torque: f64,
    /// The speed of the field in mm/s, and its sense; and both of them in rad/s.
    speed: f64,
    sense: i64,
    field_speed: f64,
    corner: f64,
    start: f64,
    own_friction: f64,
    own_backlash: i64,
    load: Load,
    /// The supply, as a share of the nominal one.
    supply: f64,
    stalled: bool,
    /// The field runs away from the rotor.
    out_of_step: bool,
    /// None: the rotor is in closed form.
    swing: Option<Swing>,
    /// The substep under way of one that swings.
    step: Option<Step>,
    /// An electrical turn in mm, and a unit in radians of it.
    turn_mm: f64,
    unit: f64,
}

/// What moves with the field in a piece.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Piece {
    /// How far the field moves.
    pub(crate) units: i64,
    pub(crate) rotor: bool,
    pub(crate) carriage: bool,
    /// They swing instead.
    pub(crate) path: Option<Path>,
}

/// What a rotor does that can swing.
#[derive(Clone, Copy, Debug)]
enum Gait {
    /// It is locked to the field.
    Follow,
    /// It stands while the field moves so far.
    Stand(i64),
    /// It swings, and turns so fast, in rad/s.
    Swing(f64),
}

/// A substep is at most such a share of an electrical turn of the field.
pub(crate) const SUBSTEPS_OF_A_TURN: i64 = 16;

/// The nearest whole number, the farther one from 0 between two: as `libm::round`, which takes longer.
const fn nearest(x: f64) -> i64 {
    let whole = x as i64;
    let beyond = x - whole as f64;
    whole.saturating_add((beyond >= 0.5) as i64 - (beyond <= -0.5) as i64)
}

impl Plant {
    pub(crate) fn new(settings: &AxisSettings, scale: &Scale) -> Self {
        let AxisSettings { motor, mechanics, .. } = settings;
        let backlash = scale.units_of_mm(mechanics.backlash_mm);
        let mut plant = Self {
            mechanics: Mechanics::new(backlash, scale.units_of_mm(mechanics.travel_mm)),
            field: 0,
            turn: scale.turn,
            grip: Grip::stuck(scale.turn),
            torque: 1.0,
            speed: 0.0,
            sense: 1,
            field_speed: 0.0,
            corner: motor.corner_mm_per_s,
            start: motor.start_mm_per_s,
            own_friction: motor.friction,
            own_backlash: backlash,
            load: Load { friction: motor.friction, push: 0.0 },
            supply: 1.0,
            stalled: false,
            out_of_step: false,
            swing: Swing::new(motor),
            step: None,
            turn_mm: scale.turn as f64 / scale.pulse as f64 * scale.pulse_mm(),
            unit: TAU / scale.turn as f64,
        };
        plant.take_hold();
        plant
    }

    /// How the field holds the rotor from now on.
    fn take_hold(&mut self) {
        self.torque = self.supply * torque(self.speed, self.corner);
        self.grip = match self.stalled || self.out_of_step {
            true => Grip::stuck(self.turn),
            false => Grip::new(self.turn, self.torque, self.load),
        };
    }

    /// Whether the rotor would not follow a jump of the speed by so much, in mm/s.
    fn loses(&self, jump: f64) -> bool {
        let load = self.load.friction + self.sense as f64 * self.load.push;
        self.swing.is_none() && self.start > 0.0 && jump > self.start * start_limit(load)
    }

    /// The field moves at this speed from now on, which is another one by `jump`.
    pub(crate) fn run(&mut self, sense: i64, speed: f64, jump: f64) {
        self.release();
        // One that stands has to be taken along as from rest.
        let jump = if self.grip.holds_not(sense) { speed } else { jump };
        (self.sense, self.speed) = (sense, speed);
        self.field_speed = sense as f64 * speed / self.turn_mm * TAU;
        self.out_of_step = self.loses(jump);
        self.take_hold();
        self.rest();
    }

    /// The field stands from now on.
    pub(crate) fn stand(&mut self) {
        if self.speed == 0.0 {
            return;
        }
        self.release();
        (self.speed, self.field_speed) = (0.0, 0.0);
        self.out_of_step = false;
        self.take_hold();
        self.rest();
    }

    /// Changes what loads the rotor.
    pub(crate) fn disturb(&mut self, change: impl FnOnce(&mut Self)) {
        let held = self.grip.holds_not(self.sense);
        self.release();
        change(self);
        self.take_hold();
        if held && !self.grip.holds_not(self.sense) && self.loses(self.speed) {
            self.out_of_step = true;
            self.take_hold();
        }
        // A push beyond friction holds the carriage against a flank.
        let Load { friction, push } = self.load;
        self.mechanics.flank = if push > friction { 1 } else { -i64::from(push < -friction) };
        self.mechanics.mesh();
        self.rest();
    }

    pub(crate) fn stall(&mut self, stalled: bool) {
        self.stalled = stalled;
        if let Some(swing) = &mut self.swing
            && stalled
        {
            swing.speed = Some(0.0);
        }
    }

    /// Friction of so many per mille of the holding torque instead of its own; 0: its own.
    pub(crate) fn set_friction(&mut self, per_mille: u32) {
        self.load.friction = if per_mille == 0 { self.own_friction } else { f64::from(per_mille) / 1_000.0 };
    }

    pub(crate) fn set_push(&mut self, per_mille: i32) {
        self.load.push = f64::from(per_mille) / 1_000.0;
    }

    pub(crate) fn set_supply(&mut self, per_mille: u32) {
        self.supply = f64::from(per_mille) / 1_000.0;
    }

    /// Dead travel of so many units instead of its own.
    pub(crate) fn set_backlash(&mut self, units: Option<i64>) {
        self.mechanics.backlash = units.unwrap_or(self.own_backlash);
    }

    /// The rotor slips by so many electrical turns.
    pub(crate) fn slip(&mut self, turns: i32) {
        let by = i64::from(turns) * self.turn;
        self.mechanics.turn(by.clamp(-self.mechanics.room(-1), self.mechanics.room(1)));
    }

    const fn lag(&self) -> i64 {
        self.field - self.mechanics.rotor
    }

    /// Without the field's motion the rotor goes to where it can stand.
    fn rest(&mut self) {
        if self.swing.is_none() {
            self.mechanics.turn(self.way_to_rest());
        }
    }

    /// How far that is.
    fn way_to_rest(&self) -> i64 {
        match self.grip.slide(self.lag()) {
            0 => 0,
            way => way.clamp(-self.mechanics.room(-1), self.mechanics.room(1)),
        }
    }

    /// The train goes on by at most `most` units, as far as a piece goes. The drive does, or does not, take the next
    /// `part` of them, which are at least as many.
    pub(crate) fn piece(&mut self, run: &ScheduledTrain, lost: bool, part: i64, most: i64) -> Piece {
        match self.swing {
            Some(swing) => self.swinging(swing, run, lost, part, most),
            None if lost => Piece { units: most, rotor: false, carriage: false, path: None },
            None => self.rigid(most),
        }
    }

    /// The same of a rotor in closed form.
    fn rigid(&mut self, most: i64) -> Piece {
        let (sense, mechanics) = (self.sense, &mut self.mechanics);
        loop {
            let (room, behind) = (mechanics.room(sense), mechanics.room(-sense));
            match self.grip.next(sense, self.field - mechanics.rotor, room, behind) {
                Next::Slide(by) => mechanics.turn(sense * by),
                Next::Stand(units) => {
                    let units = units.min(most);
                    self.field += sense * units;
                    return Piece { units, rotor: false, carriage: false, path: None };
                }
                Next::Follow => return self.follow(most.min(room)),
            }
        }
    }

    /// Rotor and field move together by at most `most` units.
    fn follow(&mut self, most: i64) -> Piece {
        let (sense, mechanics) = (self.sense, &mut self.mechanics);
        let gap = mechanics.gap(sense);
        let carriage = gap == 0;
        let units = if carriage { most } else { most.min(gap) };
        self.field += sense * units;
        mechanics.rotor += sense * units;
        mechanics.carriage += if carriage { sense * units } else { 0 };
        Piece { units, rotor: true, carriage, path: None }
    }

    /// Units as radians of an electrical turn.
    const fn radians(&self, units: i64) -> f64 {
        units as f64 * self.unit
    }

    /// The substeps in which the rotor has been integrated.
    pub(crate) fn substeps(&self) -> u64 {
        self.swing.map_or(0, |swing| swing.substeps)
    }

    pub(crate) const fn can_swing(&self) -> bool {
        self.swing.is_some()
    }

    /// It does so, or is about to.
    pub(crate) fn swings(&self) -> bool {
        self.step.is_some() || self.swing.is_some_and(|swing| swing.speed.is_some_and(|speed| speed != 0.0))
    }

    /// Where the substep under way ends.
    pub(crate) fn substep_end(&self) -> Option<i64> {
        self.step.as_ref().map(|step| step.path.to)
    }

    /// Something changes: a substep under way ends here, and a rotor that is locked to the field is free.
    pub(crate) fn release(&mut self) {
        let field = self.field_speed;
        if let Some(swing) = &mut self.swing {
            let speed = self.step.take().map_or(swing.speed, |step| Some(step.speed()));
            swing.speed = Some(speed.unwrap_or(field));
        }
    }

    /// What the rotor does next if the field turns so fast, in rad/s.
    fn gait(&mut self, swing: &mut Swing, field: f64) -> Gait {
        let room = self.mechanics.room(self.sense);
        let Some(speed) = swing.speed else {
            if room > 0 && field == self.field_speed {
                return Gait::Follow;
            }
            // The carriage has met a stop, or the drive does not take a pulse.
            swing.speed = Some(if room > 0 { self.field_speed } else { 0.0 });
            return self.gait(swing, field);
        };
        // Whether its speed is near enough is known at less cost than whether its place is.
        let may_lock = swing.is_close(0.0, field - speed);
        if field == 0.0 {
            let way = if may_lock { self.way_to_rest() } else { i64::MAX };
            if !swing.is_close(self.radians(way), speed) {
                return Gait::Swing(speed);
            }
            self.mechanics.turn(way);
            swing.speed = Some(0.0);
            return Gait::Stand(i64::MAX);
        }
        if may_lock && let Some(lag) = self.grip.follows_at(self.sense) {
            let way = self.lag() - lag;
            let way = (way + self.turn / 2).rem_euclid(self.turn) - self.turn / 2;
            if self.sense * way < room && swing.is_close(self.radians(way), field - speed) {
                self.mechanics.turn(way);
                swing.speed = None;
                return Gait::Follow;
            }
        }
        if speed == 0.0 {
            let Load { friction, push } = self.load;
            let held = match self.stalled {
                true => self.grip,
                false => Grip::new(self.turn, self.torque, Load { friction, push: push - swing.pull(field) }),
            };
            let behind = self.mechanics.room(-self.sense);
            if let Next::Stand(units) = held.next(self.sense, self.lag(), room, behind) {
                return Gait::Stand(units);
            }
        }
        Gait::Swing(speed)
    }

    /// A substep begins, from one place to another in so many seconds, unless friction stops the rotor at once.
    fn begin_step(&mut self, swing: &mut Swing, (from, to): (i64, i64), seconds: f64, speed: f64, field: f64) {
        let forces = Forces { torque: self.torque, load: self.load, field };
        let lag = self.lag();
        let lag = if lag.abs() < self.turn { lag } else { lag % self.turn };
        let motion = swing.motion(&forces, self.radians(lag), speed, seconds);
        let turned = nearest(motion.turned / TAU * self.turn as f64);
        let way = turned.clamp(-self.mechanics.room(-1), self.mechanics.room(1));
        let end = if way == turned { motion.speed } else { 0.0 };
        let to = if motion.share < 1.0 { from + nearest(motion.share * (to - from) as f64) } else { to };
        if to == from {
            swing.speed = Some(0.0);
        } else {
            swing.substeps += 1;
            self.step = Some(Step::new(Path::new(from, to, &self.mechanics, way), (speed, end)));
        }
    }

    /// The substep under way goes on to a place, or to its end before that. Gives that place, and the path.
    fn go_on(&mut self, swing: &mut Swing, place: i64) -> Option<(i64, Path)> {
        let step = self.step.as_mut()?;
        let path = step.path;
        let place = place.min(path.to);
        step.at = place;
        self.mechanics = path.at(place, &self.mechanics);
        if place == path.to {
            swing.speed = Some(step.speed());
            self.step = None;
        }
        Some((place, path))
    }

    /// What a rotor that can swing does in a train.
    fn swinging(&mut self, mut swing: Swing, run: &ScheduledTrain, lost: bool, part: i64, most: i64) -> Piece {
        let (from, field) = (run.reached, if lost { 0.0 } else { self.field_speed });
        let mut piece = Piece { units: most, rotor: false, carriage: false, path: None };
        loop {
            if let Some((place, path)) = self.go_on(&mut swing, from + most) {
                (piece.units, piece.path) = (place - from, Some(path));
                break;
            }
            match self.gait(&mut swing, field) {
                Gait::Follow => {
                    self.swing = Some(swing);
                    return self.follow(most.min(self.mechanics.room(self.sense)));
                }
                Gait::Stand(units) => {
                    piece.units = units.min(most);
                    break;
                }
                Gait::Swing(speed) => {
                    let to = run.substep(from).min(from + part);
                    self.begin_step(&mut swing, (from, to), run.seconds(from, to), speed, field);
                }
            }
        }
        self.field += if lost { 0 } else { self.sense * piece.units };
        self.swing = Some(swing);
        piece
    }

    /// What it does without a train, from one instant to another or for a part of that: how far it comes, and how.
    /// None: it stands.
    pub(crate) fn idle(&mut self, from: i64, to: i64) -> Option<(i64, Path)> {
        let mut swing = self.swing?;
        let moved = loop {
            if let Some(moved) = self.go_on(&mut swing, to) {
                break Some(moved);
            }
            let Gait::Swing(speed) = self.gait(&mut swing, 0.0) else { break None };
            self.begin_step(&mut swing, (from, from + SUBSTEP_NS), SUBSTEP_NS as f64 / 1e9, speed, 0.0);
        };
        self.swing = Some(swing);
        moved
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_whole_number_is_that_of_libm() {
        let whole = [0.0, 0.5, 1.0, 1.5, 2.5, 3.0, 1e6 + 0.5, 4e15 + 0.5, 9e15, 1e18, 1e19];
        for x in whole.into_iter().flat_map(|x: f64| [x, x.next_down(), x.next_up()]).flat_map(|x| [x, -x]) {
            assert_eq!(nearest(x), libm::round(x) as i64, "{x}");
        }
        assert_eq!(nearest(f64::NAN), 0);
    }
}
