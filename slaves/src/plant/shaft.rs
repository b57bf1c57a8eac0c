//! A motor's shaft: a first-order lag that is driven from a supply, against a load.

use torno_protocol::time::Span;

use crate::plant::lag::Lag;

/// Per mille of the whole.
const WHOLE: f64 = 1_000.0;

/// τ·dv/dt = s·u − p − L·sgn v − v, solved exactly for a drive u, a supply s, a push p and a load L that are held.
///
/// The load is Coulomb's: it opposes motion in either sense, and holds a shaft at standstill whose drive is no stronger
/// than it. It is constant; static friction is no larger than sliding friction. The push is a torque in the negative
/// sense, whatever the motion. (Ours.)
#[derive(Clone, Debug)]
pub(super) struct Shaft {
    lag: Lag,
    /// The speed that full drive at nominal supply tends to without a load.
    full: f64,
    drive: f64,
    supply: Supply,
    load: Load,
    blocked: bool,
}

/// A share of nominal that the rig has, and a share of that in per mille, which a fault leaves.
#[derive(Clone, Copy, Debug)]
struct Supply {
    own: f64,
    left: u16,
}

impl Supply {
    fn share(self) -> f64 {
        self.own * (f64::from(self.left) / WHOLE)
    }
}

/// In shares of the torque at standstill with full drive at nominal supply.
#[derive(Clone, Copy, Debug)]
struct Load {
    /// The motor's own, Coulomb's.
    friction: f64,
    /// A fault's, of the same kind, in per mille.
    added: u32,
    /// In the negative sense.
    push: f64,
}

impl Load {
    fn opposing(self) -> f64 {
        self.friction + f64::from(self.added) / WHOLE
    }
}

impl Shaft {
    /// At rest, without a load. `tau_s` in s.
    pub(super) const fn new(tau_s: f64, full: f64) -> Self {
        let (supply, load) = (Supply { own: 1.0, left: 1_000 }, Load { friction: 0.0, added: 0, push: 0.0 });
        Self { lag: Lag::new(tau_s), full, drive: 0.0, supply, load, blocked: false }
    }

    /// The motor's friction and a push in the negative sense, both in shares of the torque at standstill with full
    /// drive at nominal supply.
    pub(super) const fn with_load(mut self, friction: f64, push: f64) -> Self {
        self.load.friction = friction;
        self.load.push = push;
        self
    }

    /// The supply, as a share of nominal.
    pub(super) const fn with_supply(mut self, share: f64) -> Self {
        self.supply.own = share;
        self
    }

    /// The speed that the drive tends to from now on at nominal supply without a load.
    pub(super) const fn drive(&mut self, drive: f64) {
        self.drive = drive;
    }

    /// What is left of the supply from now on, in per mille.
    pub(super) const fn set_supply(&mut self, per_mille: u16) {
        self.supply.left = per_mille;
    }

    /// A load beyond friction from now on, in per mille of the torque at standstill with full drive; none below 0.
    pub(super) fn set_load(&mut self, per_mille: i32) {
        self.load.added = u32::try_from(per_mille).unwrap_or(0);
    }

    /// Blocks the shaft, which stops dead, or frees it.
    pub(super) const fn block(&mut self, blocked: bool) {
        self.blocked = blocked;
        if blocked {
            self.lag.stop();
        }
    }

    pub(super) const fn is_blocked(&self) -> bool {
        self.blocked
    }

    /// The drive cannot turn the shaft, however strong it gets.
    pub(super) fn is_overloaded(&self) -> bool {
        self.load.opposing() >= self.supply.share()
    }

    /// The speed.
    pub(super) const fn rate(&self) -> f64 {
        self.lag.rate()
    }

    /// Lets `dt` pass. Between two reversals the shaft turns one way; what it covers goes to `travel`, which may stop
    /// it there.
    pub(super) fn advance(&mut self, dt: Span, mut travel: impl FnMut(&mut Lag, f64)) {
        if self.blocked {
            return;
        }
        let lag = &mut self.lag;
        let toward = self.drive * self.supply.share() - self.full * self.load.push;
        let load = self.full * self.load.opposing();
        if load == 0.0 {
            let mut rest = dt;
            if let Some(turning) = lag.turning(toward).filter(|turning| *turning < dt) {
                let way = lag.step(turning, toward);
                travel(lag, way);
                rest = Span::from_nanos(dt.as_nanos() - turning.as_nanos());
            }
            let way = lag.step(rest, toward);
            return travel(lag, way);
        }
        let mut left_s = dt.as_secs_f64();
        loop {
            let sense = if lag.rate() != 0.0 { lag.rate().signum() } else { toward.signum() };
            let target = toward - sense * load;
            if lag.rate() == 0.0 && target * sense <= 0.0 {
                return;
            }
            match lag.standstill_s(target).filter(|standstill| *standstill < left_s) {
                Some(standstill_s) => {
                    let way = lag.come_to_rest(standstill_s, target);
                    travel(lag, way);
                    left_s -= standstill_s;
                }
                None => {
                    let way = lag.pass(left_s, target);
                    return travel(lag, way);
                }
            }
        }
    }

    /// What the shaft still covers if it is not driven from now on; infinite if the push turns it on and on.
    pub(super) fn coast(&self) -> f64 {
        let mut lag = self.lag.clone();
        let (push, load) = (-self.full * self.load.push, self.full * self.load.opposing());
        if self.blocked || (push == 0.0 && load == 0.0) {
            return lag.coast();
        }
        if push.abs() > load {
            return push.signum() * f64::INFINITY;
        }
        let target = push - lag.rate().signum() * load;
        lag.standstill_s(target).map_or(0.0, |standstill_s| lag.come_to_rest(standstill_s, target))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The same by small steps (midpoint rule), as a check: the way and the speed after `seconds`.
    fn integrated(mut rate: f64, tau: f64, toward: f64, load: f64, seconds: f64) -> (f64, f64) {
        let steps = 2_000_000;
        let h = seconds / f64::from(steps);
        let mut way = 0.0;
        for _ in 0..steps {
            let sense = if rate == 0.0 { toward.signum() } else { rate.signum() };
            let slope = |v: f64| (toward - sense * load - v) / tau;
            if rate == 0.0 && (toward - sense * load) * sense <= 0.0 {
                break;
            }
            let mut next = rate + h * slope(rate + h / 2.0 * slope(rate));
            if next * rate < 0.0 {
                next = 0.0;
            }
            way += h * (rate + next) / 2.0;
            rate = next;
        }
        (way, rate)
    }

    fn passed(shaft: &mut Shaft, seconds: f64) -> f64 {
        let mut covered = 0.0;
        shaft.advance(Span::from_nanos((seconds * 1e9) as u64), |_, way| covered += way);
        covered
    }

    #[test]
    fn a_loaded_shaft_goes_as_small_steps_say() {
        // From speed 2 (reached without a load): forwards, held, reversed, reversed but held, coasting.
        for (drive, load, supply) in [
            (3.0, 200, 1_000),
            (0.5, 200, 1_000),
            (-3.0, 200, 1_000),
            (-0.5, 200, 1_000),
            (0.0, 50, 1_000),
            (4.0, 100, 300),
        ] {
            let mut shaft = Shaft::new(0.5, 4.0);
            shaft.drive(2.0);
            passed(&mut shaft, 30.0);
            shaft.drive(drive);
            shaft.set_load(load);
            shaft.set_supply(supply);
            let toward = drive * f64::from(supply) / 1_000.0;
            let (way, rate) = integrated(shaft.rate(), 0.5, toward, 4.0 * f64::from(load) / 1_000.0, 1.5);
            let coast = integrated(shaft.rate(), 0.5, 0.0, 4.0 * f64::from(load) / 1_000.0, 20.0).0;
            assert!((shaft.coast() - coast).abs() < 1e-6, "{drive} {load}: {} {coast}", shaft.coast());
            let mut cut = shaft.clone();
            let found = passed(&mut shaft, 1.5);
            assert!((found - way).abs() < 1e-6 && (shaft.rate() - rate).abs() < 1e-5, "{drive} {load}: {found} {way}");
            let pieces: f64 = [0.01, 0.39, 0.1, 0.7, 0.3].iter().map(|seconds| passed(&mut cut, *seconds)).sum();
            assert!((pieces - found).abs() < 1e-9 && (cut.rate() - shaft.rate()).abs() < 1e-9, "{drive} {load}");
        }
    }

    #[test]
    fn a_load_as_strong_as_the_drive_holds_it_and_a_weaker_one_does_not() {
        let speed = |drive: f64, load| {
            let mut shaft = Shaft::new(0.5, 4.0);
            shaft.drive(drive);
            shaft.set_load(load);
            (passed(&mut shaft, 60.0), shaft.rate()).1
        };
        assert_eq!((speed(4.0, 1_000), speed(-1.0, 250), speed(0.0, 1)), (0.0, 0.0, 0.0));
        assert!((speed(-1.0, 249) + 0.004).abs() < 1e-9);
        assert!((speed(4.0, -5) - 4.0).abs() < 1e-9);
    }

    #[test]
    fn it_is_overloaded_if_full_drive_cannot_turn_it() {
        let overloaded = |load, supply| {
            let mut shaft = Shaft::new(0.5, 4.0);
            shaft.set_load(load);
            shaft.set_supply(supply);
            shaft.is_overloaded()
        };
        let found = [(0, 1_000), (999, 1_000), (1_000, 1_000), (0, 0), (300, 200)].map(|(l, s)| overloaded(l, s));
        assert_eq!(found, [false, false, true, true, true]);
    }

    #[test]
    fn a_push_moves_it_unless_friction_holds_it() {
        let passed_by = |friction: f64, push: f64| {
            let mut shaft = Shaft::new(0.5, 4.0).with_load(friction, push);
            let coast = shaft.coast();
            (passed(&mut shaft, 100.0), shaft.rate(), coast)
        };
        assert_eq!(passed_by(0.1, 0.1), (0.0, 0.0, 0.0));
        let (_, rate, coast) = passed_by(0.1, 0.2);
        assert!((rate + 0.4).abs() < 1e-9 && coast == f64::NEG_INFINITY, "{rate} {coast}");
        let (_, rate, coast) = passed_by(0.0, -0.2);
        assert!((rate - 0.8).abs() < 1e-9 && coast == f64::INFINITY, "{rate} {coast}");
        // Against the sense of motion it helps friction, in that sense it does not.
        let stops = |drive: f64| {
            let mut shaft = Shaft::new(0.5, 4.0);
            shaft.drive(drive);
            passed(&mut shaft, 30.0);
            shaft.with_load(0.2, 0.1)
        };
        for (drive, against) in [(2.0, 1.2), (-2.0, 0.4)] {
            let mut shaft = stops(drive);
            shaft.drive(0.0);
            let (coast, expected) = (shaft.coast(), integrated(drive, 0.5, 0.0, against, 20.0).0);
            assert!((coast - expected).abs() < 1e-6, "{coast} {expected}");
            assert!((passed(&mut shaft, 30.0) - coast).abs() < 1e-9);
        }
    }
}
