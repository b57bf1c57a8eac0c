//! The plant: the field turns the rotor, the rotor the screw, the screw moves the carriage.
//!
//! While the field moves one way at a constant rate, all of them stand or move evenly. A piece is as long as none of
//! them changes between the two.

use crate::mechanics::Mechanics;
use crate::rotor::{Grip, Load, Next, start_limit, torque};
use crate::scale::Scale;
use crate::settings::AxisSettings;

/// A motor with what it moves. Lengths are in units.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plant {
    pub(crate) mechanics: Mechanics,
    field: i64,
    turn: i64,
    grip: Grip,
    /// The speed of the field in mm/s, and its sense.
    speed: f64,
    sense: i64,
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
}

/// What moves with the field in a piece.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Piece {
    /// How far the field moves.
    pub(crate) units: i64,
    pub(crate) rotor: bool,
    pub(crate) carriage: bool,
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
            speed: 0.0,
            sense: 1,
            corner: motor.corner_mm_per_s,
            start: motor.start_mm_per_s,
            own_friction: motor.friction,
            own_backlash: backlash,
            load: Load { friction: motor.friction, push: 0.0 },
            supply: 1.0,
            stalled: false,
            out_of_step: false,
        };
        plant.grip = plant.grip_now();
        plant
    }

    fn grip_now(&self) -> Grip {
        if self.stalled || self.out_of_step {
            return Grip::stuck(self.turn);
        }
        Grip::new(self.turn, self.supply * torque(self.speed, self.corner), self.load)
    }

    /// Whether the rotor would not follow a jump of the speed by so much, in mm/s.
    fn loses(&self, jump: f64) -> bool {
        let load = self.load.friction + self.sense as f64 * self.load.push;
        self.start > 0.0 && jump > self.start * start_limit(load)
    }

    /// The field moves at this speed from now on, which is another one by `jump`.
    pub(crate) fn run(&mut self, sense: i64, speed: f64, jump: f64) {
        // One that stands has to be taken along as from rest.
        let jump = if self.grip.holds_not(sense) { speed } else { jump };
        (self.sense, self.speed) = (sense, speed);
        self.out_of_step = self.loses(jump);
        self.grip = self.grip_now();
        self.rest();
    }

    /// The field stands from now on.
    pub(crate) fn stand(&mut self) {
        if self.speed == 0.0 {
            return;
        }
        self.speed = 0.0;
        self.out_of_step = false;
        self.grip = self.grip_now();
        self.rest();
    }

    /// Changes what loads the rotor.
    pub(crate) fn disturb(&mut self, change: impl FnOnce(&mut Self)) {
        let held = self.grip.holds_not(self.sense);
        change(self);
        self.grip = self.grip_now();
        if held && !self.grip.holds_not(self.sense) && self.loses(self.speed) {
            self.out_of_step = true;
            self.grip = self.grip_now();
        }
        // A push beyond friction holds the carriage against a flank.
        let Load { friction, push } = self.load;
        self.mechanics.flank = if push > friction { 1 } else { -i64::from(push < -friction) };
        self.mechanics.mesh();
        self.rest();
    }

    pub(crate) fn stall(&mut self, stalled: bool) {
        self.stalled = stalled;
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
        let way = self.grip.slide(self.lag());
        if way != 0 {
            self.mechanics.turn(way.clamp(-self.mechanics.room(-1), self.mechanics.room(1)));
        }
    }

    /// The field moves by at most so many units, as far as a piece goes.
    pub(crate) fn piece(&mut self, most: i64) -> Piece {
        let (sense, mechanics) = (self.sense, &mut self.mechanics);
        loop {
            let (room, behind) = (mechanics.room(sense), mechanics.room(-sense));
            match self.grip.next(sense, self.field - mechanics.rotor, room, behind) {
                Next::Slide(by) => mechanics.turn(sense * by),
                Next::Stand(units) => {
                    let units = units.min(most);
                    self.field += sense * units;
                    return Piece { units, rotor: false, carriage: false };
                }
                Next::Follow => {
                    let gap = mechanics.gap(sense);
                    let carriage = gap == 0;
                    let units = if carriage { most.min(room) } else { most.min(room).min(gap) };
                    self.field += sense * units;
                    mechanics.rotor += sense * units;
                    mechanics.carriage += if carriage { sense * units } else { 0 };
                    return Piece { units, rotor: true, carriage };
                }
            }
        }
    }
}
