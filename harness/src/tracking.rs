//! How well axes follow: the way that was asked of them, and the way that they went, as a trace tells.
//!
//! A board tells where its axes are only now and then. Between inputs it is deterministic, so it runs once more here,
//! by itself, with all that it heard, and is looked at as often as a picture wants.

use torno_machines::kinds;
use torno_plot::{Figure, Panel, Series, Style};
use torno_protocol::board::{Description, Role};
use torno_protocol::time::{Instant, Span};
use torno_trace::Trace;

use crate::physical::{MILLION, UNITS};
use crate::pins::{PinsError, heard};
use crate::replay::{actions, rig_of};

/// At most so many looks: a picture has 960 points across.
const LOOKS: u64 = 20_000;
/// No finer than this: 25 µm at 25 mm/s.
const FINEST: Span = Span::from_millis(1);
/// What is so near to a straight way is on it.
const STRAIGHT_MM: f64 = 0.000_2;
/// So many columns of values are told apart in a picture.
const COLUMNS: usize = 900;

/// How far a way is off is drawn so many times as large, and no larger than this share of the picture.
const MAGNIFICATIONS: [f64; 10] = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1_000.0];
const LARGEST_SHARE: f64 = 0.05;

/// A pause in the work lasts so long: longer than a reversal, and as long as a loop settles.
const PAUSE_S: f64 = 0.015;
/// Half an electrical turn of the engraver's motors: an axis that is further off has slipped.
const SLIP_MM: f64 = 0.05;
/// A mark is so far from its middle, as a share of the picture.
const MARK_SHARE: f64 = 0.01;

type Point = (f64, f64);

/// An axis, in mm; or degrees, if it turns.
#[derive(Clone, Debug)]
pub struct Tracked {
    /// Its name.
    pub name: String,
    /// Its unit: `mm` or `deg`.
    pub unit: &'static str,
    /// What was asked of it, and where it was, at each look.
    pub places: Vec<(f64, f64)>,
}

impl Tracked {
    /// How far it was from what was asked of it at a look.
    fn off(&self, look: usize) -> f64 {
        let (asked, got) = self.places[look];
        (got - asked).abs()
    }
}

/// The axes of a board.
#[derive(Clone, Debug)]
pub struct Tracking {
    /// The instants of the looks, in s.
    pub at: Vec<f64>,
    /// The axes, in the order of the board.
    pub axes: Vec<Tracked>,
}

/// A motor of which a board tells set point and position: name, unit, and the numbers of the two.
type TrackedMotor = (String, &'static str, u8, u8);

fn tracked(description: &Description) -> Vec<TrackedMotor> {
    let of = |motor: u8, role: Role| {
        let mut signals = (0u8..).zip(&description.signals);
        let (n, signal) = signals.find(|(_, signal)| signal.motor == Some(motor) && signal.role == role)?;
        let (_, unit, _) = UNITS.iter().find(|(told, ..)| signal.unit == *told)?;
        Some((*unit, n))
    };
    let motors = (0u8..).zip(&description.motors);
    let told = motors.filter_map(|(n, motor)| {
        let ((unit, asked), (_, got)) = (of(n, Role::SetPoint)?, of(n, Role::Position)?);
        Some((motor.name.clone(), unit, asked, got))
    });
    told.collect()
}

/// Goes on to a place. What lies between on a straight way is left out.
fn extend(piece: &mut Vec<Point>, to: Point) {
    let length = |(x, y): Point| (x * x + y * y).sqrt();
    if let [.., (x, y), (from_x, from_y)] = piece[..] {
        let (along, across) = ((to.0 - x, to.1 - y), (from_x - x, from_y - y));
        let off = (along.0 * across.1 - along.1 * across.0).abs() / length(along);
        let goes_on = along.0 * across.0 + along.1 * across.1 > 0.0;
        if off < STRAIGHT_MM && goes_on && length(across) < 20.0 * length(along) {
            piece.pop();
        }
    }
    piece.push(to);
}

/// The least and the largest value in each of so many columns.
fn envelope(points: &[Point]) -> Vec<Point> {
    let columns = points.chunks(points.len().div_ceil(COLUMNS).max(1));
    let ends = columns.flat_map(|column| {
        let by_value = |a: &&Point, b: &&Point| a.1.total_cmp(&b.1);
        let mut ends: Vec<Point> =
            [column.iter().min_by(by_value), column.iter().max_by(by_value)].into_iter().flatten().copied().collect();
        ends.sort_by(|a, b| a.0.total_cmp(&b.0));
        ends
    });
    ends.collect()
}

/// A cross at a place.
fn cross((x, y): Point, size: f64) -> Vec<Vec<Point>> {
    vec![vec![(x - size, y - size), (x + size, y + size)], vec![(x - size, y + size), (x + size, y - size)]]
}

/// A square on its tip at a place.
fn diamond((x, y): Point, size: f64) -> Vec<Vec<Point>> {
    vec![vec![(x - size, y), (x, y + size), (x + size, y), (x, y - size), (x - size, y)]]
}

/// Whether a board with this description can be looked at so.
pub fn has_axes(description: &Description) -> bool {
    !tracked(description).is_empty()
}

impl Tracking {
    /// The axes of the first board in a trace that has any; None if there is none.
    ///
    /// # Errors
    /// [`PinsError`] if the boards in it are not of this program.
    pub fn of(trace: &Trace) -> Result<Option<Self>, PinsError> {
        let (file, _) = rig_of(trace)?;
        let actions = actions(&trace.inputs);
        let mut boards = file.boards.iter().enumerate();
        let Some((node, board)) = boards.find(|(_, board)| has_axes(&board.description)) else { return Ok(None) };
        let (heard, until) = heard(trace, &actions, node);
        let every = Span::from_nanos(until.as_nanos() / LOOKS).max(FINEST);
        let samples = kinds::build(&board.kind, &board.settings, board.clock)?.sample(&heard, until, every);
        let seconds = |at: &Instant| at.as_secs_f64();
        let axes = tracked(&board.description).into_iter().map(|(name, unit, asked, got)| {
            let value = |values: &[(u8, i64)], of: u8| values.iter().find(|(n, _)| *n == of).map_or(0, |(_, it)| *it);
            let mm = |values: &[(u8, i64)], of: u8| value(values, of) as f64 / MILLION;
            let places = samples.iter().map(|(_, values)| (mm(values, asked), mm(values, got))).collect();
            Tracked { name, unit, places }
        });
        Ok(Some(Self { axes: axes.collect(), at: samples.iter().map(|(at, _)| seconds(at)).collect() }))
    }

    /// How far the axes in mm are from what was asked of them at the end: the one that is furthest.
    pub fn last_mm(&self) -> f64 {
        let Some(last) = self.at.len().checked_sub(1) else { return 0.0 };
        self.axes.iter().filter(|axis| axis.unit == "mm").map(|axis| axis.off(last)).fold(0.0, f64::max)
    }

    /// The way in the work, seen from above: asked, and gone. How far they are apart is drawn so much larger that it
    /// can be seen; the legend says how much. Pauses and slips are marked. None without X and Y.
    pub fn magnified(&self, name: &str) -> Option<Panel> {
        let (x, y) = (self.axis("x")?, self.axis("y")?);
        let works = self.in_work();
        let worst = (0..self.at.len()).filter(|n| works(*n)).flat_map(|n| [x.off(n), y.off(n)]).fold(0.0, f64::max);
        let spread = |axis: &Tracked| {
            let places = axis.places.iter().map(|(asked, _)| *asked);
            places.clone().fold(f64::NEG_INFINITY, f64::max) - places.fold(f64::INFINITY, f64::min)
        };
        let spread = spread(x).max(spread(y));
        let most = spread * LARGEST_SHARE / worst.max(1e-9);
        let times = MAGNIFICATIONS.into_iter().rfind(|times| *times <= most).unwrap_or(1.0);
        let asked = self.pieces(&works, |axis, n| axis.places[n].0, (x, y));
        let gone =
            self.pieces(&works, |axis, n| axis.places[n].0 + times * (axis.places[n].1 - axis.places[n].0), (x, y));
        let mut series = vec![
            Series::pieces("asked", Style::Line, asked),
            Series::pieces(format!("gone, off by {times} times as much"), Style::Line, gone),
        ];
        let slips = [x, y].into_iter().flat_map(|axis| self.slips(axis)).filter(|n| works(*n)).collect();
        for (marks, what, shape) in [
            (self.pauses(&works), "pauses".to_owned(), cross as fn(Point, f64) -> _),
            (slips, format!("slips, more than {SLIP_MM} mm off"), diamond),
        ] {
            let place = |n: usize| (x.places[n].0, y.places[n].0);
            let drawn: Vec<_> = marks.into_iter().flat_map(|n| shape(place(n), spread * MARK_SHARE)).collect();
            if !drawn.is_empty() {
                series.push(Series::pieces(what, Style::Line, drawn));
            }
        }
        Some(Panel { x: format!("x, mm ({name})"), y: "y, mm".to_owned(), height: 1.0, series })
    }

    /// The looks at which the axes begin to stand in the work, if they go on later.
    fn pauses(&self, works: impl Fn(usize) -> bool) -> Vec<usize> {
        let stand = |a: usize, b: usize| self.axes.iter().all(|axis| axis.places[a].0 == axis.places[b].0);
        let (mut pauses, mut begin) = (Vec::new(), 0);
        for n in 1..self.at.len() {
            if !stand(begin, n) {
                if works(begin) && self.at[n - 1] - self.at[begin] >= PAUSE_S {
                    pauses.push(begin);
                }
                begin = n;
            }
        }
        pauses
    }

    /// The looks at which an axis has slipped.
    fn slips(&self, axis: &Tracked) -> Vec<usize> {
        (1..self.at.len()).filter(|n| axis.off(*n) > SLIP_MM && axis.off(n - 1) <= SLIP_MM).collect()
    }

    /// Whether the tool is in the work at a look: below where it was at the start.
    fn in_work(&self) -> impl Fn(usize) -> bool {
        let z = self.axis("z");
        move |n| z.is_none_or(|z| z.places[n].0 < z.places[0].0)
    }

    /// The places at the looks that are wanted, where those belong together that follow one another.
    fn pieces(
        &self,
        wanted: impl Fn(usize) -> bool,
        of: impl Fn(&Tracked, usize) -> f64,
        (x, y): (&Tracked, &Tracked),
    ) -> Vec<Vec<Point>> {
        let mut pieces: Vec<Vec<Point>> = Vec::new();
        let mut joined = false;
        for n in 0..self.at.len() {
            if !wanted(n) {
                joined = false;
                continue;
            }
            let place = (of(x, n), of(y, n));
            match pieces.last_mut().filter(|_| joined) {
                Some(piece) if piece.last() == Some(&place) => {}
                Some(piece) => extend(piece, place),
                None => pieces.push(vec![place]),
            }
            joined = true;
        }
        pieces
    }

    fn axis(&self, name: &str) -> Option<&Tracked> {
        self.axes.iter().find(|axis| axis.name == name)
    }

    /// The picture. Its first panel is the way seen from above, to scale, asked and gone, where the tool is in the
    /// work, which is below where it was at the start, and where it is not. The others show how far each axis was from
    /// what was asked of it.
    pub fn figure(&self, title: &str) -> Figure {
        let mut panels = Vec::new();
        if let (Some(x), Some(y)) = (self.axis("x"), self.axis("y")) {
            let works = self.in_work();
            let pieces = |wanted: bool, got: bool| {
                let of = |axis: &Tracked, n: usize| if got { axis.places[n].1 } else { axis.places[n].0 };
                self.pieces(|n| works(n) == wanted, of, (x, y))
            };
            let series = vec![
                Series::pieces("in the air", Style::Dashed, pieces(false, true)),
                Series::pieces("asked", Style::Line, pieces(true, false)),
                Series::pieces("gone", Style::Line, pieces(true, true)),
            ];
            let of = |name: &str| format!("{name}, mm");
            panels.push(Panel { x: of("x"), y: of("y"), height: 1.0, series }.to_scale());
        }
        for (_, unit, fine) in UNITS {
            // An axis that never moves is left out.
            let moves = |axis: &&Tracked| axis.places.iter().any(|place| *place != axis.places[0]);
            let axes = self.axes.iter().filter(|axis| axis.unit == unit).filter(moves);
            let off = axes.map(|axis| {
                let points = self.at.iter().zip(&axis.places).map(|(at, (asked, got))| (*at, (got - asked) * 1e3));
                Series::new(axis.name.clone(), Style::Line, envelope(&points.collect::<Vec<_>>()))
            });
            let (series, x, y) = (off.collect::<Vec<_>>(), "t, s".to_owned(), format!("gone - asked, {fine}"));
            if !series.is_empty() {
                panels.push(Panel { x, y, height: 0.6, series });
            }
        }
        Figure { title: title.to_owned(), panels }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pause_in_the_work_and_a_slip_are_marked() {
        // X goes a mm in 10 ms, stands for 20 ms, goes on, and is 0.1 mm off from then on.
        let asked = [0.0, 0.0, 1.0, 2.0, 2.0, 2.0, 3.0, 4.0, 4.0, 4.0, 4.0];
        let x = asked.iter().zip(0..).map(|(asked, n)| (*asked, *asked - if n > 5 { 0.1 } else { 0.0 }));
        let axis = |name: &str, places| Tracked { name: name.to_owned(), unit: "mm", places };
        let z = (0..11).map(|n| if n > 0 { (-1.0, -1.0) } else { (0.0, 0.0) });
        let axes = vec![axis("x", x.collect()), axis("y", vec![(0.0, 0.0); 11]), axis("z", z.collect())];
        let mut tracking = Tracking { at: (0..11).map(|n| f64::from(n) / 100.0).collect(), axes };
        assert_eq!((tracking.pauses(tracking.in_work()), tracking.slips(&tracking.axes[0])), (vec![3], vec![6]));
        assert_eq!(tracking.magnified("").unwrap().series.len(), 4);
        // In the air nobody minds.
        tracking.axes[2].places = vec![(0.0, 0.0); 11];
        assert_eq!(tracking.magnified("").unwrap().series.len(), 2);
    }
}
