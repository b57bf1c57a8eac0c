//! Quantities over time: which of a board's belong together, by their names, and what of them is drawn.
//!
//! A name is a role and a unit, `speed_rpm`, with whose it is before it where a board has several motors:
//! `spindle_speed_rpm`. Nothing else is known of a board here.

use torno_protocol::time::Instant;

use torno_engine::Fact;
use torno_protocol::layout::BoardLayout;
use torno_trace::Trace;

/// What a quantity was, from each instant on.
pub type Course = Vec<(Instant, i64)>;

/// The courses of all quantities, by board and by the quantity's place in its description.
#[derive(Clone, Debug)]
pub struct Courses(Vec<Vec<Course>>);

/// A motor of a board: how fast it was, or where, and what became of what it was to do.
#[derive(Clone, Debug)]
pub struct Motion {
    /// The board's name, and whose motor it is, if it has several.
    pub name: String,
    /// `speed` or `position`.
    pub what: &'static str,
    /// The unit of all but the drive.
    pub unit: String,
    /// How it went.
    pub got: Course,
    /// The set point, if one is told, or follows from what remains to go.
    pub asked: Option<Course>,
    /// The following error: the set point less what came of it.
    pub error: Option<Course>,
    /// The drive, in LSB.
    pub drive: Option<Course>,
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
        let boards = trace.header.layout.boards.iter().enumerate();
        boards.flat_map(|(n, board)| Quantities::new(board, &self.0[n]).motions(&board.name)).collect()
    }
}

/// The quantities of one board.
struct Quantities<'a>(Vec<(&'a str, &'a Course)>);

impl<'a> Quantities<'a> {
    fn new(board: &'a BoardLayout, courses: &'a [Course]) -> Self {
        Self(board.description.signals.iter().map(|signal| signal.name.as_str()).zip(courses).collect())
    }

    fn find(&self, name: &str) -> Option<&'a Course> {
        self.0.iter().find(|(known, _)| *known == name).map(|(_, course)| *course)
    }

    fn motions(&self, board: &str) -> Vec<Motion> {
        let mut found: Vec<(&str, &'static str)> = Vec::new();
        for (name, _) in &self.0 {
            for what in ["speed", "position"] {
                if let Some((whose, _)) = role(name, what)
                    && !found.contains(&(whose, what))
                {
                    found.push((whose, what));
                }
            }
        }
        found.into_iter().filter_map(|(whose, what)| self.motion(board, whose, what)).collect()
    }

    fn motion(&self, board: &str, whose: &str, what: &'static str) -> Option<Motion> {
        let named = |role: &str, unit: &str| self.find(&format!("{whose}{role}_{unit}"));
        let units = self.0.iter().filter_map(|(name, _)| role(name, what).filter(|(of, _)| *of == whose));
        let units: Vec<&str> = units.map(|(_, unit)| unit).collect();
        // Of a quantity in several units, the one that a set point is told in.
        let unit = *units.iter().find(|unit| named("set_point", unit).is_some()).or_else(|| units.first())?;
        let got = named(what, unit)?;
        let (asked, error) = match (named("set_point", unit), named("remaining", unit)) {
            (Some(asked), _) => (Some(asked.clone()), Some(merged(asked, got, i64::saturating_sub))),
            (None, Some(rest)) => (Some(merged(got, rest, i64::saturating_add)), Some(rest.clone())),
            (None, None) => (None, None),
        };
        let offset = named("carriage_offset", unit).filter(|course| course.iter().any(|(_, value)| *value != 0));
        let whose = whose.trim_end_matches('_');
        Some(Motion {
            name: if whose.is_empty() { board.to_owned() } else { format!("{board} {whose}") },
            what,
            unit: unit.replace('_', " "),
            got: got.clone(),
            asked,
            error,
            drive: self.find(&format!("{}drive", prefix(whose))).cloned(),
            offset: offset.cloned(),
        })
    }
}

fn prefix(whose: &str) -> String {
    if whose.is_empty() { String::new() } else { format!("{whose}_") }
}

/// Whose it is, and the unit, if a name has this role.
fn role<'a>(name: &'a str, role: &str) -> Option<(&'a str, &'a str)> {
    let (whose, rest) = name.split_once(role)?;
    let unit = rest.strip_prefix('_').filter(|unit| !unit.is_empty())?;
    (whose.is_empty() || whose.ends_with('_')).then_some((whose, unit))
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
    use super::*;

    fn course(points: &[(u64, i64)]) -> Course {
        points.iter().map(|(ms, value)| (Instant::from_nanos(ms * 1_000_000), *value)).collect()
    }

    fn motions(quantities: &[(&str, Course)]) -> Vec<Motion> {
        Quantities(quantities.iter().map(|(name, course)| (*name, course)).collect()).motions("b")
    }

    #[test]
    fn a_roles_name_tells_whose_it_is_and_its_unit() {
        assert_eq!(role("speed_rpm", "speed"), Some(("", "rpm")));
        assert_eq!(role("x_set_point_mm_per_s", "set_point"), Some(("x_", "mm_per_s")));
        assert_eq!((role("topspeed_rpm", "speed"), role("speed", "speed")), (None, None));
    }

    #[test]
    fn what_belongs_together_is_found_by_name() {
        let found = motions(&[
            ("speed_counts", course(&[(0, 0)])),
            ("speed_rpm", course(&[(0, 0), (20, 7)])),
            ("set_point_rpm", course(&[(0, 0), (10, 5)])),
            ("drive", course(&[(0, 3)])),
            ("x_position_counts", course(&[(0, 0), (10, 2)])),
            ("x_remaining_counts", course(&[(0, 0), (5, 3), (10, 1)])),
            ("frames", course(&[(0, 0)])),
        ]);
        let [speed, x] = &found[..] else { panic!("{found:?}") };
        assert_eq!((speed.name.as_str(), speed.what, speed.unit.as_str()), ("b", "speed", "rpm"));
        assert_eq!(speed.error, Some(course(&[(0, 0), (10, 5), (20, -2)])));
        assert!(speed.drive.is_some() && x.drive.is_none());
        // Both change at one instant: the set point does not.
        assert_eq!(x.asked, Some(course(&[(0, 0), (5, 3), (10, 3)])));
        assert_eq!((x.name.as_str(), x.what), ("b x", "position"));
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
