//! Quantities over time: which of a board's belong together, by their roles and motors, and what of them is drawn.

use torno_protocol::board::{Description, Role, Signal};
use torno_protocol::time::Instant;

use crate::physical::{Physical, board};
use crate::rig::file::{Board, RigFile};
use torno_engine::Fact;
use torno_protocol::layout::BoardLayout;
use torno_protocol::time::Span;
use torno_trace::Trace;

/// A set point that has stood for so long is one to settle at. (Ours.)
const STANDS: Span = Span::from_millis(500);

/// What a quantity was, from each instant on.
pub type Course = Vec<(Instant, i64)>;

/// The courses of all quantities, by board and by the quantity's place in its description.
#[derive(Clone, Debug)]
pub struct Courses(Vec<Vec<Course>>);

/// A motor of a board: how fast it was, or where, and what became of what it was to do.
#[derive(Clone, Debug)]
pub struct Motion {
    /// The board's name, and the motor's, if it has several.
    pub name: String,
    /// `speed` or `position`.
    pub what: &'static str,
    /// The unit in which all but the drive and the speed are told.
    pub unit: String,
    /// The unit for people, if that is another.
    pub physical: Option<Physical>,
    /// How it went.
    pub got: Course,
    /// The set point, if one is told, or follows from what remains to go.
    pub asked: Option<Course>,
    /// The following error: the set point less what came of it.
    pub error: Option<Course>,
    /// What was left of it when the motor had settled: at the end of each stay of the set point, the largest.
    pub settled: Option<i64>,
    /// The drive, in LSB or what the unit for people is made of.
    pub drive: Option<(Option<Physical>, Course)>,
    /// How fast an axis moved, and in what unit it is told.
    pub speed: Option<(String, Option<Physical>, Course)>,
    /// How far the carriage is from where its board believes it to be, if it ever was.
    pub offset: Option<Course>,
}

impl Courses {
    /// What is told in a trace.
    pub fn new(trace: &Trace) -> Self {
        let initial = |board: &BoardLayout| {
            board.description.signals.iter().map(|signal| vec![(Instant::START, signal.initial)]).collect()
        };
        let mut courses: Vec<Vec<Course>> = trace.header.layout.boards.iter().map(initial).collect();
        for fact in &trace.facts {
            if let Fact::Telemetry { node, at, signal, value } = fact
                && let Some(course) = courses.get_mut(*node).and_then(|board| board.get_mut(usize::from(*signal)))
            {
                course.push((*at, *value));
            }
        }
        Self(courses)
    }

    /// The course of a board's quantity.
    pub fn of(&self, board: usize, signal: usize) -> Option<&Course> {
        self.0.get(board)?.get(signal)
    }

    /// The motors of a rig, in its order.
    pub fn motions(&self, trace: &Trace) -> Vec<Motion> {
        let file = RigFile::parse(&trace.header.rig, &trace.header.text).ok();
        let boards = trace.header.layout.boards.iter().enumerate();
        let until = trace.until();
        let of = |(n, known): (usize, &BoardLayout)| {
            motions(&known.name, board(file.as_ref(), n), &known.description, &self.0[n], until)
        };
        boards.flat_map(of).collect()
    }
}

/// Which of a board's quantities belong to a motion of one of its motors, by their places in the description.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Places {
    /// The motor.
    pub motor: u8,
    /// `speed` or `position`.
    pub what: &'static str,
    /// How it goes.
    pub got: usize,
    /// The set point, if one is told.
    pub asked: Option<usize>,
    /// What remains to go, if that is told and the set point is not.
    pub rest: Option<usize>,
    /// The drive.
    pub drive: Option<usize>,
    /// How fast an axis moves.
    pub speed: Option<usize>,
    /// How far the carriage is from where its board believes it to be.
    pub offset: Option<usize>,
}

impl Places {
    /// Those of one board, in the order in which the speeds and positions of its motors come.
    pub fn of(description: &Description) -> Vec<Self> {
        let mut found: Vec<(u8, Role)> = Vec::new();
        for signal in &description.signals {
            let (Some(motor), Role::Speed | Role::Position) = (signal.motor, signal.role) else { continue };
            // An axis's speed is shown beside its position.
            let of_axis = signal.role == Role::Speed && description.signal(motor, Role::Position, None).is_some();
            if !of_axis && !found.contains(&(motor, signal.role)) {
                found.push((motor, signal.role));
            }
        }
        found.into_iter().filter_map(|(motor, role)| Self::of_motor(description, motor, role)).collect()
    }

    fn of_motor(description: &Description, motor: u8, role: Role) -> Option<Self> {
        let find = |role: Role, unit: Option<&str>| description.signal(motor, role, unit).map(usize::from);
        let is_it = |signal: &&Signal| (signal.motor, signal.role) == (Some(motor), role);
        let units: Vec<&str> = description.signals.iter().filter(is_it).map(|signal| signal.unit.as_str()).collect();
        // Of a quantity in several units, the one that a set point is told in.
        let is_asked = |unit: &&&str| find(Role::SetPoint, Some(unit)).is_some();
        let unit = *units.iter().find(is_asked).or_else(|| units.first())?;
        let asked = find(Role::SetPoint, Some(unit));
        Some(Self {
            motor,
            what: if role == Role::Speed { "speed" } else { "position" },
            got: find(role, Some(unit))?,
            asked,
            rest: find(Role::Remaining, Some(unit)).filter(|_| asked.is_none()),
            drive: find(Role::Drive, None),
            speed: find(Role::Speed, None).filter(|_| role == Role::Position),
            offset: find(Role::Offset, Some(unit)),
        })
    }

    /// The unit for people, if another is told.
    pub fn physical(&self, board: Option<&Board>, description: &Description) -> Option<Physical> {
        Physical::of_position(board?, self.motor, &description.signals[self.got].unit)
            .filter(|_| self.what == "position")
    }

    /// The board's name, and the motor's, if it has several.
    pub fn name(&self, board: &str, description: &Description) -> String {
        description.motor_name(self.motor).map_or_else(|| board.to_owned(), |motor| format!("{board} {motor}"))
    }
}

/// What is left of an error at the end of each stay of the set point: the largest, if it ever stood for long enough.
fn settled(asked: &Course, error: &Course, until: Instant) -> Option<i64> {
    let stays = asked.chunk_by(|a, b| a.1 == b.1).map(|stay| stay[0].0);
    let ends = stays.clone().skip(1).chain([until]);
    let long = stays.zip(ends).filter(|(from, end)| end.since(*from) >= STANDS);
    let left = long.filter_map(|(_, end)| Some(error[..error.partition_point(|(at, _)| *at < end)].last()?.1));
    left.max_by_key(|left| left.unsigned_abs())
}

/// The motors of one board, in the order in which their speeds and positions come.
fn motions(
    name: &str,
    board: Option<&Board>,
    description: &Description,
    courses: &[Course],
    until: Instant,
) -> Vec<Motion> {
    let motion = |places: &Places| motion(places.name(name, description), board, description, courses, places, until);
    Places::of(description).iter().filter_map(motion).collect()
}

fn motion(
    name: String,
    board: Option<&Board>,
    description: &Description,
    courses: &[Course],
    places: &Places,
    until: Instant,
) -> Option<Motion> {
    let of = |place: Option<usize>| courses.get(place?);
    let unit = |place: usize| description.signals[place].unit.clone();
    let got = of(Some(places.got))?;
    let (asked, error) = match (of(places.asked), of(places.rest)) {
        (Some(asked), _) => (Some(asked.clone()), Some(merged(asked, got, i64::saturating_sub))),
        (None, Some(rest)) => (Some(merged(got, rest, i64::saturating_add)), Some(rest.clone())),
        (None, None) => (None, None),
    };
    let speed = |place: usize| {
        let unit = unit(place);
        let physical = board.and_then(|board| Physical::of_speed(board, places.motor, &unit));
        Some((unit, physical, of(Some(place))?.clone()))
    };
    let drive = of(places.drive).cloned();
    Some(Motion {
        name,
        what: places.what,
        unit: unit(places.got),
        physical: places.physical(board, description),
        settled: asked.as_ref().zip(error.as_ref()).and_then(|(asked, error)| settled(asked, error, until)),
        got: got.clone(),
        asked,
        error,
        drive: drive.map(|drive| (board.and_then(|board| Physical::of_drive(board, places.motor)), drive)),
        speed: places.speed.and_then(speed),
        offset: of(places.offset).filter(|course| course.iter().any(|(_, value)| *value != 0)).cloned(),
    })
}

/// Two courses as one: whenever either changes, what comes of both.
fn merged(a: &Course, b: &Course, of: impl Fn(i64, i64) -> i64) -> Course {
    let mut instants: Vec<Instant> = a.iter().chain(b).map(|(at, _)| *at).collect();
    instants.sort_unstable();
    instants.dedup();
    let (mut i, mut j) = (0, 0);
    let up_to = |course: &Course, place: &mut usize, at: Instant| {
        while course.get(*place + 1).is_some_and(|next| next.0 <= at) {
            *place += 1;
        }
        course.get(*place).map_or(0, |(_, value)| *value)
    };
    instants.into_iter().map(|at| (at, of(up_to(a, &mut i, at), up_to(b, &mut j, at)))).collect()
}

/// The time that each value lasted, in seconds, with the value.
pub fn lasting(course: &Course, until: Instant) -> impl Iterator<Item = (f64, i64)> + '_ {
    let ends = course.iter().skip(1).map(|(at, _)| *at).chain([until]);
    course.iter().zip(ends).map(|((at, value), end)| (end.since(*at).as_secs_f64(), *value))
}

/// A course as points of time in seconds and value: of what falls into one of so many columns, the first, the least,
/// the greatest and the last. Nothing that a line of that width could show is lost.
pub fn decimated(course: &Course, until: Instant, columns: u64) -> Vec<(f64, f64)> {
    let column = |at: Instant| u128::from(at.as_nanos()) * u128::from(columns) / u128::from(until.as_nanos().max(1));
    let mut points = Vec::new();
    for chunk in course.chunk_by(|a, b| column(a.0) == column(b.0)) {
        let places = 0..chunk.len();
        let least = places.clone().min_by_key(|place| chunk[*place].1).unwrap_or_default();
        let greatest = places.clone().max_by_key(|place| chunk[*place].1).unwrap_or_default();
        let mut kept = [0, least, greatest, places.end - 1];
        kept.sort_unstable();
        let mut before = None;
        for place in kept.into_iter().filter(|place| before.replace(*place) != Some(*place)) {
            points.push((chunk[place].0.as_secs_f64(), chunk[place].1 as f64));
        }
    }
    // What was told last stays so.
    let last = course.last().map(|(_, value)| (until.as_secs_f64(), *value as f64));
    points.extend(last);
    points
}

#[cfg(test)]
mod tests {
    use torno_protocol::board::Motor;

    use super::*;

    fn course(points: &[(u64, i64)]) -> Course {
        points.iter().map(|(ms, value)| (Instant::from_nanos(ms * 1_000_000), *value)).collect()
    }

    #[test]
    fn what_belongs_together_is_found_by_role_and_motor() {
        let of =
            |motor: u8, role: Role, unit: &str| Signal::new("name", 0).with_unit(unit).with_role(role).of_motor(motor);
        let (signals, courses): (Vec<Signal>, Vec<Course>) = [
            (of(0, Role::Speed, "counts"), course(&[(0, 0)])),
            (of(0, Role::Speed, "rpm"), course(&[(0, 0), (20, 7)])),
            (of(0, Role::SetPoint, "rpm"), course(&[(0, 0), (10, 5)])),
            (of(0, Role::Drive, "LSB"), course(&[(0, 3)])),
            (of(1, Role::Position, "counts"), course(&[(0, 0), (10, 2)])),
            (of(1, Role::Remaining, "counts"), course(&[(0, 0), (5, 3), (10, 1)])),
            (Signal::new("position_counts", 0), course(&[(0, 0)])),
        ]
        .into_iter()
        .unzip();
        let motor = |name: &str| Motor { name: name.to_owned(), capabilities: Vec::new() };
        let description = Description { signals, motors: vec![motor("s"), motor("x")], ..Description::default() };
        let found = motions("b", None, &description, &courses, Instant::from_nanos(1_000_000_000));
        let [speed, x] = &found[..] else { panic!("{found:?}") };
        assert_eq!((speed.name.as_str(), speed.what, speed.unit.as_str()), ("b s", "speed", "rpm"));
        assert_eq!(speed.error, Some(course(&[(0, 0), (10, 5), (20, -2)])));
        assert!(speed.drive.is_some() && x.drive.is_none());
        // Both change at one instant: the set point does not.
        assert_eq!(x.asked, Some(course(&[(0, 0), (5, 3), (10, 3)])));
        assert_eq!((x.name.as_str(), x.what), ("b x", "position"));
        let one = Description { motors: vec![motor("s")], ..description };
        assert_eq!(motions("b", None, &one, &courses, Instant::START)[0].name, "b");
    }

    #[test]
    fn what_is_left_of_an_error_counts_where_the_set_point_stands() {
        let ms = |ms: u64| Instant::from_nanos(ms * 1_000_000);
        // It goes for 100 ms, stands for a second with an error that shrinks to 3, and goes on.
        let asked = course(&[(0, 0), (50, 40), (100, 90), (400, 90), (1_100, 95), (1_150, 99)]);
        let error = course(&[(0, 0), (50, 40), (100, 70), (300, 9), (800, -3), (1_100, 2), (1_150, 6)]);
        assert_eq!(settled(&asked, &error, ms(1_200)), Some(-3));
        assert_eq!(settled(&asked, &error, ms(1_700)), Some(6));
        assert_eq!(settled(&asked[..3].to_vec(), &error, ms(300)), None);
    }

    #[test]
    fn decimation_keeps_the_extremes() {
        let long: Vec<(u64, i64)> = (0..10_000).map(|n| (n, if n == 5_003 { 900 } else { n as i64 % 7 })).collect();
        let points = decimated(&course(&long), Instant::from_nanos(10_000_000_000), 100);
        assert!(points.len() <= 401 && points.contains(&(5.003, 900.0)), "{}", points.len());
        assert!(points.windows(2).all(|pair| pair[0].0 <= pair[1].0));
        assert_eq!(decimated(&course(&[(0, 1), (5, 2)]), Instant::START, 10).last(), Some(&(0.0, 2.0)));
    }
}
