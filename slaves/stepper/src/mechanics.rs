//! What the rotor moves: a screw (or a pinion on a rack), its backlash, the carriage, and what stops it.

/// Screw and carriage. Lengths are in units; the rotor's angle is one of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Mechanics {
    pub(crate) rotor: i64,
    pub(crate) carriage: i64,
    pub(crate) backlash: i64,
    /// How far a hit has bent the carriage from where the screw moves it.
    pub(crate) shift: i64,
    /// Where the carriage is stopped, backwards and forwards.
    stops: (i64, i64),
    /// The ends of the bed.
    bed: (i64, i64),
    /// The flank that a push holds the carriage against: 1 the one that pushes it forwards, −1 the other one, 0 none.
    pub(crate) flank: i64,
}

impl Mechanics {
    pub(crate) const fn new(backlash: i64, travel: i64) -> Self {
        let bed = (-(travel / 2), travel / 2);
        Self { rotor: 0, carriage: 0, backlash, shift: 0, stops: bed, bed, flank: 0 }
    }

    /// What an encoder measures: on the motor's shaft, or on the carriage.
    pub(crate) const fn sensed(&self, on_motor: bool) -> i64 {
        if on_motor { self.rotor } else { self.carriage }
    }

    /// How far the rotor can turn in this sense until the carriage meets a stop.
    pub(crate) fn room(&self, sense: i64) -> i64 {
        let screw = self.rotor + self.shift;
        let room = if sense > 0 { self.stops.1 - screw } else { screw + self.backlash - self.stops.0 };
        room.max(0)
    }

    /// How far the rotor turns in this sense until it takes the carriage along.
    pub(crate) fn gap(&self, sense: i64) -> i64 {
        if self.flank != 0 {
            return 0;
        }
        let ahead = self.carriage - (self.rotor + self.shift);
        if sense > 0 { ahead } else { self.backlash - ahead }
    }

    /// The rotor turns so far at once.
    pub(crate) fn turn(&mut self, by: i64) {
        self.rotor += by;
        self.mesh();
    }

    /// Puts the carriage to where the screw allows it to be.
    pub(crate) fn mesh(&mut self) {
        let screw = self.rotor + self.shift;
        self.carriage = match self.flank {
            0 => self.carriage.clamp(screw, screw + self.backlash),
            1 => screw,
            _ => screw + self.backlash,
        };
    }

    /// A hit bends the carriage by so much.
    pub(crate) fn bend(&mut self, by: i64) {
        self.shift += by;
        self.carriage += by;
    }

    /// Something hard is at this place; 0 takes it away. One that the carriage is beyond already is where it stands.
    pub(crate) fn stop(&mut self, at: i64) {
        if at == 0 {
            self.stops = self.bed;
        } else if at > 0 {
            self.stops.1 = at.min(self.bed.1).max(self.carriage);
        } else {
            self.stops.0 = at.max(self.bed.0).min(self.carriage);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_carriage_follows_once_the_gap_is_closed() {
        let mut axis = Mechanics::new(20, 10_000);
        assert_eq!([axis.gap(1), axis.gap(-1)], [0, 20]);
        axis.turn(100);
        assert_eq!((axis.rotor, axis.carriage), (100, 100));
        axis.turn(-15);
        assert_eq!((axis.carriage, axis.gap(1), axis.gap(-1)), (100, 15, 5));
        axis.turn(-15);
        assert_eq!((axis.rotor, axis.carriage), (70, 90));
        axis.flank = 1;
        axis.mesh();
        assert_eq!((axis.carriage, axis.gap(-1)), (70, 0));
    }

    #[test]
    fn stops_bound_the_carriage_and_not_the_screw() {
        let mut axis = Mechanics::new(20, 10_000);
        assert_eq!([axis.room(1), axis.room(-1)], [5_000, 5_020]);
        axis.stop(300);
        axis.stop(-200);
        assert_eq!([axis.room(1), axis.room(-1)], [300, 220]);
        axis.bend(50);
        assert_eq!((axis.carriage, axis.room(1), axis.room(-1)), (50, 250, 270));
        axis.turn(100);
        axis.stop(40);
        assert_eq!(axis.room(1), 0);
        axis.stop(0);
        assert_eq!(axis.room(1), 4_850);
    }
}
