//! What is left of a run: numbers, data, graphs.

use std::fmt::Write;

use serde_json::{Value, json};
use torno_servo::{Program, TICKS_PER_S};

use super::controller::{RunEnd, Sample};
use torno_trace::{End, Trace};

use crate::physical::{Physical, board};
use crate::report::series::Courses;
use crate::rig::file::RigFile;
use crate::session::{EndedBoard, INTERRUPTED};
use torno_plot::{Figure, Panel, Series, Style};

/// Samples of the window in which Servo v1.0 shows the following error: 4 s (§3.1).
pub const WINDOW: usize = 800;

/// The kind of the stand's board.
const STAND: &str = "servo";

/// A run, as far as it went.
#[derive(Clone, Debug)]
pub struct Report {
    /// The program's name.
    pub program: String,
    /// Where it ran.
    pub on: String,
    /// Kx and Kv, as the controller says.
    pub gains: (u8, u8),
    /// Counts of a mm.
    pub counts_per_mm: f64,
    /// How it ended.
    pub ended: RunEnd,
    /// The set point at each tick of the program, in counts from its beginning.
    pub set_points: Vec<i64>,
    /// What the controller told of each tick that took place.
    pub samples: Vec<Sample>,
    /// What is left of the rig, if it ran on one.
    pub rig: Option<(End, Vec<EndedBoard>)>,
}

impl RunEnd {
    /// The word for it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::Early => "ended early by the controller",
            Self::Interrupted => INTERRUPTED,
        }
    }
}

impl Report {
    fn mm(&self, counts: i64) -> f64 {
        counts as f64 / self.counts_per_mm
    }

    fn seconds(tick: usize) -> f64 {
        tick as f64 / TICKS_PER_S
    }

    /// Set point and actual position at each sample, in counts.
    fn positions(&self) -> impl Iterator<Item = (&Sample, i64, i64)> {
        let both = self.samples.iter().zip(&self.set_points);
        both.map(|(sample, set_point)| (sample, *set_point, set_point - sample.error))
    }

    /// The greatest following error either way, in counts.
    pub fn greatest_error(&self) -> i64 {
        self.samples.iter().map(|sample| sample.error).max_by_key(|error| error.abs()).unwrap_or(0)
    }

    /// Samples of which the byte shows something else than the error.
    pub fn wrapped(&self) -> usize {
        self.samples.iter().filter(|sample| sample.error != i64::from(sample.shown)).count()
    }

    /// The samples that the window shows: the last 4 s.
    pub fn window(&self) -> &[Sample] {
        &self.samples[self.samples.len().saturating_sub(WINDOW)..]
    }

    /// For people.
    pub fn text(&self) -> String {
        let (kx, kv) = self.gains;
        let (done, all) = (self.samples.len(), self.set_points.len());
        let greatest = self.greatest_error();
        let mut text = format!("program  {} on {}\n", self.program, self.on);
        let mut line = |name: &str, what: String| _ = writeln!(text, "{name:<8} {what}");
        line("gains", format!("Kx {kx}, Kv {kv}, as the controller says"));
        line("ticks", format!("{done} of {all}, {:.3} s", Self::seconds(done)));
        if let Some((_, set, actual)) = self.positions().last() {
            line("at end", format!("set {:.3} mm, actual {:.3} mm", self.mm(set), self.mm(actual)));
        }
        line("error", format!("up to {greatest} counts, {:.3} mm", self.mm(greatest)));
        if self.wrapped() > 0 {
            let wrapped = self.wrapped();
            line("wrap", format!("{wrapped} samples show another error than the true one: it lies beyond -128…127"));
        }
        if let Some((end, boards)) = &self.rig {
            let boards = boards.iter().map(|board| format!(", {} {}", board.name, board.pid));
            line("process", format!("harness {}{}", std::process::id(), boards.collect::<String>()));
            line("time", format!("{:.3} s virtual", end.at.as_secs_f64()));
            line("digest", end.digest.clone());
        }
        line("outcome", self.ended.name().to_owned());
        text
    }

    /// For programs.
    pub fn json(&self) -> Value {
        let end = self.positions().last();
        let rig = self.rig.as_ref().map(|(end, boards)| {
            let board =
                |board: &EndedBoard| (board.name.clone(), json!({ "pid": board.pid, "at_end": board.telemetry }));
            let boards: serde_json::Map<String, Value> = boards.iter().map(board).collect();
            json!({ "virtual_s": end.at.as_secs_f64(), "digest": end.digest, "boards": boards })
        });
        json!({
            "program": self.program,
            "on": self.on,
            "kx": self.gains.0,
            "kv": self.gains.1,
            "ticks": self.samples.len(),
            "of": self.set_points.len(),
            "seconds": Self::seconds(self.samples.len()),
            "set_counts": end.map(|(_, set, _)| set),
            "actual_counts": end.map(|(_, _, actual)| actual),
            "greatest_error_counts": self.greatest_error(),
            "wrapped_samples": self.wrapped(),
            "outcome": self.ended.name(),
            "rig": rig,
        })
    }

    /// The data: a line a tick.
    pub fn csv(&self) -> String {
        let mut text = "time_s,set_mm,actual_mm,error_counts,shown_counts\n".to_owned();
        for (sample, set, actual) in self.positions() {
            let Sample { tick, error, shown } = sample;
            let (time, set, actual) = (Self::seconds(*tick), self.mm(set), self.mm(actual));
            _ = writeln!(text, "{time:.3},{set:.3},{actual:.3},{error},{shown}");
        }
        text
    }

    /// The graphs: positions, and the following error in the window, true and as the telemetry shows it.
    pub fn figure(&self) -> Figure {
        let (kx, kv) = self.gains;
        let set = self.positions().map(|(sample, set, _)| (Self::seconds(sample.tick), self.mm(set)));
        let actual = self.positions().map(|(sample, _, actual)| (Self::seconds(sample.tick), self.mm(actual)));
        let window = self.window();
        let errors = |which: fn(&Sample) -> i64| {
            window.iter().map(|sample| (Self::seconds(sample.tick), which(sample) as f64)).collect()
        };
        let mut error = vec![Series::new("true", Style::Steps, errors(|sample| sample.error))];
        if window.iter().any(|sample| sample.error != i64::from(sample.shown)) {
            error.push(Series::new("as shown by one byte", Style::Dots, errors(|sample| i64::from(sample.shown))));
        }
        Figure {
            title: format!("{}: Kx {kx}, Kv {kv}", self.program),
            panels: vec![
                Panel {
                    x: "t, s".to_owned(),
                    y: "s, mm".to_owned(),
                    height: 1.0,
                    series: vec![
                        Series::new("set", Style::Dashed, set.collect()),
                        Series::new("actual", Style::Line, actual.collect()),
                    ],
                },
                Panel {
                    x: if window.len() < self.samples.len() { "t, s (the last 4 s)" } else { "t, s" }.to_owned(),
                    y: "following error, counts".to_owned(),
                    height: 0.8,
                    series: error,
                },
            ],
        }
    }
}

/// What a report says of the stands in a trace beside what each motor has done: the gains at the end, and the greatest
/// following error. Nothing, if there is no stand.
pub fn facts(trace: &Trace) -> Vec<(&'static str, String)> {
    let courses = Courses::new(trace);
    let file = RigFile::parse(&trace.header.rig, &trace.header.text).ok();
    let mut facts = Vec::new();
    for (node, of) in trace.header.layout.boards.iter().enumerate().filter(|(_, of)| of.kind == STAND) {
        let place = |name: &str| of.description.signals.iter().position(|signal| signal.name == name);
        let course = |name: &str| courses.of(node, place(name)?);
        let last = |name: &str| course(name).and_then(|course| course.last()).map_or(0, |(_, value)| *value);
        facts.push(("gains", format!("Kx {}, Kv {}", last("kx"), last("kv"))));
        let errors = course("error_counts").into_iter().flatten().map(|(_, error)| *error);
        let greatest = errors.max_by_key(|error| error.abs()).unwrap_or(0);
        let physical = board(file.as_ref(), node).and_then(|board| Physical::of_position(board, 0, "counts"));
        let mm = physical.map_or_else(String::new, |physical| format!("{}, ", physical.text(greatest as f64)));
        facts.push(("greatest error", format!("{mm}{greatest} counts")));
    }
    facts
}

/// The graph of a program: way over time (§3.1, "t-s").
pub fn graph(name: &str, program: &Program) -> Figure {
    let series = Series::new("set point", Style::Line, program.graph());
    let (x, y) = ("t, s".to_owned(), "s, mm".to_owned());
    Figure { title: name.to_owned(), panels: vec![Panel { x, y, height: 1.0, series: vec![series] }] }
}
