//! The speed of an axis, which its board does not tell: what its position gains in a sample.
//!
//! The boards tell the position of each sample in which it has changed. So the speed follows from that, for whoever is
//! shown it; in recordings and digests it would be there twice.

use torno_engine::{Fact, NodeId};
use torno_machines::kinds;
use torno_machines::motor::{Encoder, Law};
use torno_protocol::board::{Role, Signal};
use torno_protocol::time::{Instant, Span};
use torno_trace::Trace;

use crate::rig::file::RigFile;

/// No axis has more counts in a sample: the largest that a sub-frame's byte can ask for. A count that goes further, to
/// 0, has restarted with the supply.
const MOST: u64 = 255;

/// How fast an axis moves, in counts a sample.
#[derive(Clone, Debug)]
pub struct AxisSpeed {
    /// Its board.
    pub node: NodeId,
    /// The quantity, as if the board told it.
    pub signal: Signal,
    /// The place of the position among the board's quantities.
    position: u8,
    period: Span,
    /// The last position, and since when.
    last: (Instant, i64),
    speed: i64,
}

impl AxisSpeed {
    /// Those of all axes of a rig that are driven at a speed, standing.
    pub fn of(file: &RigFile) -> Vec<Self> {
        let axes = file.boards.iter().enumerate().flat_map(|(node, board)| {
            let description = &board.description;
            (0..description.motors.len() as u8).filter_map(move |place| {
                let motor = kinds::motor(&board.kind, &board.settings, place).ok()?.ok()?;
                let is_axis = motor.encoder == Encoder::Position && matches!(motor.law, Law::Pid(_));
                let position = description.signal(place, Role::Position, None).filter(|_| is_axis)?;
                let of = description.signals.get(usize::from(position))?;
                let period = Span::from_millis(u64::from(motor.period_ms));
                let signal = Signal::new(&of.name.replace("position", "speed"), 0)
                    .with_unit(&format!("{}/{} ms", of.unit, motor.period_ms))
                    .with_role(Role::Speed)
                    .of_motor(place);
                let period = board.clock.span(period);
                Some(Self { node, signal, position, period, last: (Instant::START, of.initial), speed: 0 })
            })
        });
        axes.collect()
    }

    /// Takes note of a fact; gives what the speed was since then, and before that if it was 0 for a while.
    pub fn note(&mut self, fact: &Fact) -> [Option<(Instant, i64)>; 2] {
        match *fact {
            Fact::Telemetry { node, at, signal, value } if (node, signal) == (self.node, self.position) => {
                let stood = self.stands(at);
                let before = stood.map(|since| (since, core::mem::take(&mut self.speed)));
                let gained = value.saturating_sub(self.last.1);
                let speed = if value == 0 && gained.unsigned_abs() > MOST { 0 } else { gained };
                let changed = speed != self.speed;
                (self.last, self.speed) = ((at, value), speed);
                [before.filter(|(_, was)| *was != 0).map(|(since, _)| (since, 0)), changed.then_some((at, speed))]
            }
            _ => [None; 2],
        }
    }

    /// The speed at an instant up to which everything has been noted.
    pub fn at(&self, now: Instant) -> i64 {
        if self.stands(now).is_some() { 0 } else { self.speed }
    }

    /// Since when no sample has had a count, if it has been more than one by `now`. A sample may come late by a half.
    fn stands(&self, now: Instant) -> Option<Instant> {
        let next = self.last.0 + self.period;
        (now.since(next) > Span::from_nanos(self.period.as_nanos() / 2)).then_some(next)
    }
}

/// A trace in which the boards tell the speeds of their axes too, to be shown. One of a rig that this version does not
/// know stays as it is.
pub fn with_speeds(trace: &Trace) -> Trace {
    let mut shown = trace.clone();
    let Ok(file) = RigFile::parse(&trace.header.rig, &trace.header.text) else { return shown };
    for mut axis in AxisSpeed::of(&file) {
        let Some(board) = shown.header.layout.boards.get_mut(axis.node) else { continue };
        let Ok(signal) = u8::try_from(board.description.signals.len()) else { continue };
        board.description.signals.push(axis.signal.clone());
        let node = axis.node;
        let told = |(at, value)| Fact::Telemetry { node, at, signal, value };
        let speeds = trace.facts.iter().flat_map(|fact| axis.note(fact)).flatten();
        let speeds: Vec<Fact> = speeds.map(told).collect();
        shown.facts.extend(speeds);
        let end = axis.stands(trace.until()).filter(|_| axis.speed != 0);
        shown.facts.extend(end.map(|since| told((since, 0))));
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: u64) -> Instant {
        Instant::START + Span::from_millis(ms)
    }

    #[test]
    fn a_speed_is_what_a_sample_gains_and_0_when_a_sample_gains_nothing() {
        let file = RigFile::load("lathe").unwrap();
        let mut axes = AxisSpeed::of(&file);
        let [axis] = &mut axes[..] else { panic!("the feed alone has a speed") };
        let node = file.layout.board("transverse").unwrap();
        assert_eq!((axis.node, axis.signal.name.as_str()), (node, "speed_counts"));
        assert_eq!(axis.signal.unit, "counts/30 ms");
        let mut told = |at: u64, value: i64| {
            let fact = Fact::Telemetry { node, at: ms(at), signal: axis.position, value };
            axis.note(&fact).into_iter().flatten().collect::<Vec<_>>()
        };
        assert_eq!(told(300, 3), [(ms(300), 3)]);
        assert_eq!(told(330, 9), [(ms(330), 6)]);
        assert_eq!(told(360, 15), []);
        // Four samples without a count.
        assert_eq!(told(510, 14), [(ms(390), 0), (ms(510), -1)]);
        // The supply is back, and the count at 0.
        assert_eq!(told(540, 2_000), [(ms(540), 1_986)]);
        assert_eq!(told(547, 0), [(ms(547), 0)]);
        assert_eq!(told(570, 7), [(ms(570), 7)]);
        assert_eq!((axis.at(ms(600)), axis.at(ms(616))), (7, 0));
    }
}
