//! Contouring: two stands as the axes of one machine, driven along a path.

use torno_servo::contour::{Axes, Point, Shape, Task};

use super::controller::{Controller, ControllerError, Gain, RunEnd};
use super::line::RigLine;
use crate::rig::Driver;
use crate::rig::file::RigFile;
use torno_plot::{Figure, Panel, Series, Style};

/// The fullest drive and the speed that it gives, by the sheet: counts/s per LSB, and the gains' sixteenths.
const COUNTS_PER_S_PER_LSB: f64 = 2_083.333_333_333 / 127.0;
const SIXTEENTHS: f64 = 16.0;
/// Counts of a mm.
const COUNTS_PER_MM: f64 = 125.0;
/// A set point is taken to a millionth of a µm first: what rounding errors make of it is far less.
const PARTS_PER_MM: f64 = 1e9;

/// What was driven, and what the formulas say of it.
#[derive(Clone, Debug)]
pub struct Contour {
    /// The path and its speed.
    pub task: Task,
    /// The axes.
    pub axes: Axes,
    /// Where the axes were at each tick.
    pub driven: Vec<Point>,
    /// How far that leaves the path, in mm.
    pub measured: f64,
    /// What the formulas say: without and with the motors' lag.
    pub predicted: Option<[f64; 2]>,
    /// What axes without rounding would leave it by, if their loops are sampled as these are.
    pub sampled: f64,
}

/// Two stands for the two axes: each a rig of its own, with its own board and line. They are told the same ticks.
///
/// # Errors
/// [`ControllerError`] if one of them does not do what it should.
pub async fn drive(file: &RigFile, task: Task, kx: [u8; 2], tau_s: f64) -> Result<Contour, ControllerError> {
    let path = task.path();
    let mut axes = [Vec::new(), Vec::new()];
    for (axis, driven) in axes.iter_mut().enumerate() {
        let mm = path.iter().map(|place| if axis == 0 { place.0 } else { place.1 });
        let counts: Vec<i64> = mm.map(nearest_count).collect();
        let before = core::iter::once(0).chain(counts.iter().copied());
        let increments: Vec<i8> = counts.iter().zip(before).map(|(to, from)| (to - from) as i8).collect();
        let mut controller = Controller::connect(RigLine::start(file, &Driver::InProcess).await?).await?;
        controller.set_gain(Gain::Kx, kx[axis]).await?;
        controller.download(&increments, |_, _| {}).await?;
        let run = controller.run(increments.len(), |sample| {
            driven.push((counts[sample.tick - 1] - sample.error) as f64 / COUNTS_PER_MM);
            true
        });
        if run.await? != RunEnd::Completed {
            let on = format!("axis {axis}");
            return Err(ControllerError::Silent { on, ticks: driven.len(), of: increments.len() });
        }
    }
    let [x, y] = axes;
    let driven: Vec<Point> = x.into_iter().zip(y).collect();
    let axes = Axes { kv: kx.map(|kx| f64::from(kx) / SIXTEENTHS * COUNTS_PER_S_PER_LSB), tau_s };
    Ok(Contour {
        task,
        axes,
        measured: task.measured(&driven),
        predicted: task.predicted(axes),
        sampled: task.measured(&task.sampled(axes)),
        driven,
    })
}

/// The nearest count; of two, the upper one, as in a motion program.
fn nearest_count(mm: f64) -> i64 {
    let parts = (mm * PARTS_PER_MM).round() as i64 * COUNTS_PER_MM as i64;
    let count = PARTS_PER_MM as i64;
    (parts + count / 2).div_euclid(count)
}

impl Contour {
    /// By how much the picture magnifies what leaves the path.
    fn times(&self) -> f64 {
        match self.task.shape {
            // Of a corner the picture is close up.
            Shape::Corner | Shape::Points => 1.0,
            Shape::Line(_) | Shape::Straight | Shape::Circle(_) => 100.0,
        }
    }

    /// The name of the path.
    pub const fn name(&self) -> &'static str {
        match self.task.shape {
            Shape::Corner => "corner",
            Shape::Line(_) => "line",
            Shape::Circle(_) => "circle",
            Shape::Points => "point to point",
            Shape::Straight => "contour",
        }
    }

    /// For people, in one line.
    pub fn text(&self) -> String {
        let formulas = self.predicted.map_or_else(String::new, |[ideal, lag]| {
            format!(", formula {ideal:7.4} mm, with the motors' lag {lag:7.4} mm")
        });
        let Self { measured, sampled, .. } = self;
        format!("{:<15} deviation {measured:7.4} mm; sampled loop {sampled:7.4} mm{formulas}\n", self.name())
    }

    /// The asked path and the driven one, with what it leaves magnified, and what else is to be seen beside them.
    fn panel(&self, beside: Option<Series>) -> Panel {
        let times = self.times();
        let driven = self.task.magnified(&self.driven, times);
        let name = if times > 1.0 { format!("driven, deviation x {times}") } else { "driven".to_owned() };
        let [kvx, kvy] = self.axes.kv;
        let asked = Series::new("asked", Style::Dashed, self.task.asked());
        let series: Vec<Series> = [asked, Series::new(name, Style::Line, driven)].into_iter().chain(beside).collect();
        Panel {
            x: format!("x, mm ({}, KV {kvx:.1} and {kvy:.1} 1/s)", self.name()),
            y: "y, mm".to_owned(),
            height: to_scale(&series),
            series,
        }
    }
}

/// The height at which a millimetre is as long upwards as along, about.
fn to_scale(series: &[Series]) -> f64 {
    let extent = |of: fn(&Point) -> f64| {
        let all = series.iter().flat_map(|series| series.points.iter().map(of));
        let (least, most) = all.fold((f64::MAX, f64::MIN), |(least, most), at| (least.min(at), most.max(at)));
        (most - least).max(f64::MIN_POSITIVE)
    };
    // A panel is 2 1/4 as wide as high, with its room for names and numbers.
    (0.2 + 2.25 * extent(|place| place.1) / extent(|place| place.0)).clamp(0.6, 2.6)
}

/// The pictures of several paths, one below the other. From point to point is seen beside contour control.
pub fn figure(contours: &[Contour]) -> Figure {
    let straight = contours.iter().find(|contour| contour.task.shape == Shape::Straight);
    let beside = |contour: &Contour| {
        let other = straight.filter(|_| contour.task.shape == Shape::Points)?;
        Some(Series::new("driven with contour control", Style::Line, other.task.magnified(&other.driven, 1.0)))
    };
    let panels = contours.iter().map(|contour| contour.panel(beside(contour))).collect();
    Figure { title: "Dynamic path deviation".to_owned(), panels }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tick at 10 mm/s is 0.05 mm: every second one lies half-way between two counts.
    #[test]
    fn a_half_rounds_up_whatever_floating_point_makes_of_it() {
        for tick in -4_000..=4_000_i64 {
            let (typed, summed) = (tick as f64 * 0.05, 10.0 * (tick as f64 / 200.0));
            let expected = (tick * 50 + 4).div_euclid(8);
            assert_eq!([typed, summed].map(nearest_count), [expected; 2], "{tick}");
        }
    }
}
