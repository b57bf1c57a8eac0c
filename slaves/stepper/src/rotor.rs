//! The rotor in closed form: without inertia, it is where the field's torque and friction leave it.
//!
//! The torque is q·sin(2π(f − x)/E) in shares of the holding torque, with the field f, the rotor x and the electrical
//! turn E. The rotor moves forwards where it exceeds push + friction, and backwards where it is below push − friction;
//! in between it stands. So it follows the field with play: forwards at the load angle of push + friction, backwards
//! at that of push − friction. Half a turn behind, it may stand too, until the field pulls it either way.
//!
//! Angles are in units of length and taken modulo E. (All of this ours; the paper has no model of the motor.)

use core::f64::consts::{PI, TAU};

/// How far the field can hold the rotor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Grip {
    turn: i64,
    hold: Hold,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Hold {
    /// It stands whatever the field does.
    Stuck,
    /// It follows either way, forwards at the lag `ahead`, backwards at the lag `back`.
    Both { back: i64, ahead: i64 },
    /// It can be pulled forwards only.
    Ahead(i64),
    /// It can be pulled backwards only.
    Back(i64),
    /// It is pushed away, forwards (1) or backwards (−1).
    Away(i64),
}

/// What the rotor does while the field moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Next {
    /// It stands while the field moves so far.
    Stand(i64),
    /// It slides so far at once: positive in the field's sense.
    Slide(i64),
    /// It follows.
    Follow,
}

/// What the rotor is loaded with, in shares of the holding torque.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Load {
    pub(crate) friction: f64,
    /// Against the positive sense.
    pub(crate) push: f64,
}

/// q at this speed: 1/√(1 + (v/v_c)²); 1 without a corner.
pub(crate) fn torque(speed: f64, corner: f64) -> f64 {
    if corner > 0.0 { 1.0 / libm::sqrt(1.0 + (speed / corner) * (speed / corner)) } else { 1.0 }
}

/// The largest jump of the speed that the rotor follows under this load, as a share of that without load:
/// √(B/2), B = 2·cos a − L(π − 2a), a = asin L. (The energy that the field gives the rotor in half a turn.)
pub(crate) fn start_limit(load: f64) -> f64 {
    let load = load.clamp(0.0, 1.0);
    let a = libm::asin(load);
    libm::sqrt(((2.0 * libm::cos(a) - load * (PI - 2.0 * a)) / 2.0).max(0.0))
}

impl Grip {
    /// A rotor that is blocked.
    pub(crate) const fn stuck(turn: i64) -> Self {
        Self { turn, hold: Hold::Stuck }
    }

    /// `torque` is the largest that the field exerts.
    pub(crate) fn new(turn: i64, torque: f64, load: Load) -> Self {
        let (ahead, back) = (load.push + load.friction, load.push - load.friction);
        let lag = |force: f64| libm::round(libm::asin(force / torque) / TAU * turn as f64) as i64;
        let hold = if back > torque {
            Hold::Away(-1)
        } else if ahead < -torque {
            Hold::Away(1)
        } else {
            match (ahead < torque, back > -torque) {
                (true, true) => Hold::Both { back: lag(back), ahead: lag(ahead) },
                (true, false) => Hold::Ahead(lag(ahead)),
                (false, true) => Hold::Back(lag(back)),
                (false, false) => Hold::Stuck,
            }
        };
        Self { turn, hold }
    }

    /// Whether the field cannot move the rotor in this sense.
    pub(crate) const fn holds_not(&self, sense: i64) -> bool {
        match self.hold {
            Hold::Both { .. } => false,
            Hold::Ahead(_) => sense < 0,
            Hold::Back(_) => sense > 0,
            Hold::Stuck | Hold::Away(_) => true,
        }
    }

    /// The lag at which the rotor follows in this sense, if it does.
    pub(crate) const fn follows_at(&self, sense: i64) -> Option<i64> {
        match self.mirrored(sense) {
            Hold::Both { ahead, .. } | Hold::Ahead(ahead) => Some(sense * ahead),
            Hold::Stuck | Hold::Back(_) | Hold::Away(_) => None,
        }
    }

    /// The same with the senses exchanged.
    const fn mirrored(&self, sense: i64) -> Hold {
        match self.hold {
            hold if sense > 0 => hold,
            Hold::Both { back, ahead } => Hold::Both { back: -ahead, ahead: -back },
            Hold::Ahead(lag) => Hold::Back(-lag),
            Hold::Back(lag) => Hold::Ahead(-lag),
            Hold::Away(sense) => Hold::Away(-sense),
            Hold::Stuck => Hold::Stuck,
        }
    }

    /// What the rotor does next if the field moves in this sense: the rotor lags by `lag`, and has this much room in
    /// the field's sense and behind it.
    pub(crate) fn next(&self, sense: i64, lag: i64, room: i64, room_behind: i64) -> Next {
        let lag = sense * lag;
        // The torque changes its sense where a lag exceeds half a turn.
        let half = self.turn / 2;
        let from = |begin: i64| (lag - begin).rem_euclid(self.turn);
        let slip_back = |lag: i64| match (self.turn - lag).min(room_behind) {
            0 => Next::Stand(self.turn - lag),
            way => Next::Slide(-way),
        };
        match self.mirrored(sense) {
            Hold::Stuck => Next::Stand(i64::MAX),
            Hold::Away(1) if room > 0 => Next::Slide(room),
            Hold::Away(-1) if room_behind > 0 => Next::Slide(-room_behind),
            Hold::Away(_) => Next::Stand(i64::MAX),
            Hold::Both { back, ahead } => {
                let (lag, slips) = (from(back), half - 2 * back);
                let pulled = lag - (ahead - back);
                if pulled < 0 {
                    Next::Stand(-pulled)
                } else if pulled < half - 2 * ahead && room > 0 {
                    if pulled == 0 { Next::Follow } else { Next::Slide(pulled.min(room)) }
                } else if lag < slips {
                    Next::Stand(slips - lag)
                } else {
                    slip_back(lag)
                }
            }
            Hold::Ahead(ahead) => match from(ahead) {
                0 if room > 0 => Next::Follow,
                lag if 0 < lag && lag < half - 2 * ahead && room > 0 => Next::Slide(lag.min(room)),
                lag => Next::Stand(self.turn - lag),
            },
            Hold::Back(back) => {
                let (lag, slips) = (from(back), half - 2 * back);
                if lag < slips { Next::Stand(slips - lag) } else { slip_back(lag) }
            }
        }
    }

    /// How far the rotor slides, with its sign, if the field stands and the rotor lags by `lag`.
    pub(crate) fn slide(&self, lag: i64) -> i64 {
        let half = self.turn / 2;
        let from = |begin: i64| (lag - begin).rem_euclid(self.turn);
        let back_of = |begin: i64| {
            let lag = from(begin);
            if lag > half - 2 * begin { lag - self.turn } else { 0 }
        };
        let ahead_of = |begin: i64| {
            let lag = from(begin);
            if lag < half - 2 * begin { lag } else { 0 }
        };
        match self.hold {
            Hold::Stuck => 0,
            Hold::Away(sense) => sense * i64::MAX / 2,
            Hold::Ahead(ahead) => ahead_of(ahead),
            Hold::Back(back) => back_of(back),
            Hold::Both { back, ahead } => match ahead_of(ahead) {
                0 => back_of(back),
                way => way,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TURN: i64 = 40_000_000;

    fn load(friction: f64, push: f64) -> Load {
        Load { friction, push }
    }

    /// E/2π·asin F: in millionths of a pulse.
    #[test]
    fn the_load_angle_follows_friction() {
        for (friction, expected) in [(0.05, 318_443), (0.5, 3_333_333), (0.8, 5_903_345)] {
            let hold = Grip::new(TURN, 1.0, load(friction, 0.0)).hold;
            let Hold::Both { back, ahead } = hold else { panic!("{hold:?}") };
            assert!(ahead == -back && (ahead - expected).abs() <= 5, "{friction}: {ahead}");
        }
        assert_eq!([torque(0.0, 50.0), torque(10.0, 0.0)], [1.0, 1.0]);
        assert!((torque(50.0, 50.0) - 0.5_f64.sqrt()).abs() < 1e-12);
    }

    /// Without the corner, in shares of the 30.00 mm/s of a rotor that swings at 150 Hz: 27.62, 22.73 and 17.56 mm/s.
    #[test]
    fn the_start_limit_falls_with_the_load() {
        for (load, expected) in [(0.0, 30.0), (0.1, 27.62), (0.3, 22.73), (0.5, 17.56), (1.0, 0.0), (2.0, 0.0)] {
            assert!((30.0 * start_limit(load) - expected).abs() < 0.005, "{load}: {}", 30.0 * start_limit(load));
        }
    }

    #[test]
    fn a_rotor_stands_within_its_play_and_follows_at_its_ends() {
        let grip = Grip::new(TURN, 1.0, load(0.5, 0.0));
        let Hold::Both { ahead, .. } = grip.hold else { panic!() };
        let next = |sense, lag| grip.next(sense, lag, i64::MAX, i64::MAX);
        assert_eq!(next(1, 0), Next::Stand(ahead));
        assert_eq!([next(1, ahead), next(1, ahead + TURN), next(-1, -ahead)], [Next::Follow; 3]);
        assert_eq!(next(-1, ahead), Next::Stand(2 * ahead));
        // Two thirds of the way to half a turn it is pulled forwards, whichever way the field moves.
        assert_eq!(
            [next(1, 10_000_000), next(-1, 10_000_000)],
            [10_000_000 - ahead, ahead - 10_000_000].map(Next::Slide)
        );
        assert_eq!(grip.slide(10_000_000), 10_000_000 - ahead);
        // About half a turn behind it stands, until the field pulls it back.
        assert_eq!(next(1, TURN / 2), Next::Stand(ahead));
        assert_eq!(next(1, TURN / 2 + ahead), Next::Slide(ahead - TURN / 2 + ahead));
        assert_eq!([grip.slide(TURN / 2), grip.slide(TURN / 2 + ahead), grip.slide(0)], [0; 3]);
        assert_eq!(grip.slide(30_000_000), -(10_000_000 - ahead));
        assert_eq!(grip.slide(-10_000_000), -(10_000_000 - ahead));
        // At a stop it slips back once the field is half a turn ahead.
        assert_eq!(grip.next(1, ahead, 0, i64::MAX), Next::Stand(TURN / 2));
        assert_eq!(grip.next(1, TURN / 2 + ahead, 0, 5), Next::Slide(-5));
    }

    #[test]
    fn friction_above_the_torque_blocks_and_a_push_above_both_carries_away() {
        let next = |load, sense| Grip::new(TURN, 0.9, load).next(sense, 0, 7, 5);
        assert_eq!([next(load(0.9, 0.0), 1), next(load(1.5, 0.0), -1)], [Next::Stand(i64::MAX); 2]);
        assert_eq!([next(load(0.05, 1.0), 1), next(load(0.05, 1.0), -1)], [Next::Slide(-5), Next::Slide(7)]);
        assert_eq!(Grip::new(TURN, 0.9, load(0.05, -1.0)).next(1, 0, 7, 5), Next::Slide(7));
        assert_eq!(Grip::new(TURN, 0.9, load(0.05, -1.0)).next(1, 0, 0, 5), Next::Stand(i64::MAX));
    }

    #[test]
    fn a_rotor_that_is_only_pulled_back_loses_a_turn_for_a_turn() {
        // Forwards it takes 1.03, backwards 0.93.
        let grip = Grip::new(TURN, 1.0, load(0.05, 0.98));
        let Hold::Back(back) = grip.hold else { panic!() };
        assert!(grip.holds_not(1) && !grip.holds_not(-1));
        let next = |sense, lag| grip.next(sense, lag, i64::MAX, i64::MAX);
        assert_eq!(next(1, back), Next::Stand(TURN / 2 - 2 * back));
        assert_eq!(next(1, TURN / 2 - back), Next::Slide(-(TURN / 2 + 2 * back)));
        assert_eq!(next(-1, back), Next::Follow);
        assert_eq!(next(-1, back + 3), Next::Stand(3));
        assert_eq!((grip.slide(back), grip.slide(0)), (0, -back));
    }
}
