//! A program before it is played: what is wrong with it, and the way that it asks for.
//!
//! A program for a machine is rehearsed on a rig of its own, in this process, as fast as can be, from where that rig
//! begins. So what its controller refuses, and what becomes of the part, is what `torno run` would say.

use std::time::Duration;

use serde::Serialize;
use torno_machines::workpiece::{Part, ToolPath};
use torno_part::Place;
use torno_plot::{Figure, Panel, Series};
use torno_protocol::time::{Instant, Span};
use torno_servo::{Finding, Language, Limits, Severity, compile};

use crate::job::{FrameJob, Job, LineJob};
use crate::planning::{Text, asked_by_lines};
use crate::play::{Play, PlayEnd, Played, Progress};
use crate::report::{EventSummary, failures};
use crate::rig::Driver;
use crate::rig::file::RigFile;
use crate::servo::report::graph;
use crate::toolpath::{Asked, Picture, stairs};
use crate::tracking::Tracking;

/// What is said on the line of a rig that takes motion programs.
const SERVO: &str = "servo";
/// A rehearsal takes no longer than this, in wall time. (Ours: a person waits so long.)
const LONGEST: Duration = Duration::from_secs(10);
/// A controller that has answered all lines has buffered motions left: they take no longer, in virtual time. (Ours.)
const BUFFERED: Span = Span::from_secs(120);
/// A longer text is not looked at, in bytes. (Ours: one of 40 MiB took 44 s and 1.1 GB.)
const LENGTH_MAX: usize = 8 << 20;
/// So many things that are wrong are told.
const TOLD: usize = 20;
/// So many points of a line are drawn, the first ones. (Ours: a browser draws them at once.)
const POINTS: usize = 50_000;
/// The bar as G-code would cut it, where there is none, and the way gone, where the rig is another one, say nothing.
const LEFT_OUT: [&str; 2] = ["wanted", "gone"];

/// What is known of a program before it is played.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Preview {
    /// It cannot be played.
    pub refused: bool,
    /// What is wrong with it, or strange, with its line.
    pub problems: Vec<String>,
    /// What should not happen to a part, and would.
    pub events: Vec<EventSummary>,
    /// How long it takes, in virtual seconds; none, if that is not known.
    pub seconds: Option<f64>,
    /// Its way, if it has one.
    pub drawing: Option<Drawing>,
}

/// Lines in one pair of axes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Drawing {
    /// What is on the horizontal axis, with its unit.
    pub x: String,
    /// What is on the vertical axis, with its unit.
    pub y: String,
    /// Both axes have one scale.
    pub equal: bool,
    /// The lines, the first below the others.
    pub lines: Vec<DrawnLine>,
}

/// A line in pieces.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DrawnLine {
    /// What it shows, as in the pictures of `torno gcode plot`, `torno run --path` and `torno servo plot`.
    pub name: String,
    /// Its pieces.
    pub pieces: Vec<Vec<(f64, f64)>>,
}

fn is_shown(series: &Series) -> bool {
    !LEFT_OUT.contains(&series.name.as_str())
}

impl Drawing {
    /// The first panel of a figure.
    fn first(figure: Figure, equal: bool) -> Option<Self> {
        let Panel { x, y, series, .. } = figure.panels.into_iter().next()?;
        let lines =
            series.into_iter().filter(is_shown).map(DrawnLine::from).filter(|line| !line.pieces.is_empty()).collect();
        Some(Self { x, y, equal, lines })
    }
}

impl From<Series> for DrawnLine {
    fn from(series: Series) -> Self {
        let is_gap = |(x, y): &(f64, f64)| x.is_nan() || y.is_nan();
        let fine = |value: f64| (value * 1e4).round() / 1e4;
        let piece = |piece: &[(f64, f64)]| piece.iter().map(|(x, y)| (fine(*x), fine(*y))).collect();
        let drawn = &series.points[..series.points.len().min(POINTS)];
        let pieces = drawn.split(is_gap).filter(|piece| piece.len() > 1).map(piece).collect();
        Self { name: series.name, pieces }
    }
}

impl Preview {
    /// What is known of the program in a text, for this rig. Takes some seconds at the most.
    pub fn of(file: &RigFile, text: &str) -> Self {
        if text.len() > LENGTH_MAX {
            let most = LENGTH_MAX >> 20;
            return Self::with(core::iter::once(format!("a program of more than {most} MiB is played, but not drawn")));
        }
        if file.pc.dialect.name() == SERVO {
            return Self::of_motions(text);
        }
        match Text::read(file, text) {
            Ok(Text::Frames { program, asked, findings }) => {
                let stairs = file.part.as_ref().map(|part| stairs(part, &program)).unwrap_or_default();
                let rehearsed = Rehearsed::of(file, FrameJob::new(program));
                let told = |job: &FrameJob| {
                    let refusals = job.tally.refusals.iter().map(ToString::to_string);
                    refusals.chain(failures(&job.tally)).collect()
                };
                rehearsed
                    .map_or_else(Self::unknown, |rehearsed| rehearsed.preview(file, findings, told, asked, &stairs))
            }
            Ok(Text::Lines(job)) => {
                let asked = asked_by_lines(file, text);
                let told = |LineJob { refused, alarm, .. }: &LineJob| {
                    let refused = refused.iter().map(|(line, why)| format!("line {line}: {why}"));
                    refused.chain(alarm.clone()).collect()
                };
                let rehearsed = Rehearsed::of(file, job);
                rehearsed.map_or_else(Self::unknown, |rehearsed| rehearsed.preview(file, Vec::new(), told, asked, &[]))
            }
            Err(why) => Self { refused: true, ..Self::with(why.lines().map(str::to_owned)) },
        }
    }

    fn of_motions(text: &str) -> Self {
        let compiled = compile(text, &Limits::default());
        let problem = |finding: &Finding| {
            let word = match finding.problem.severity() {
                Severity::Error => "",
                Severity::Danger => "warning: ",
                Severity::Note => "note: ",
            };
            format!("line {}: {word}{}", finding.line, finding.message(Language::English))
        };
        let mut preview = Self::with(compiled.findings.iter().map(problem));
        preview.refused = compiled.program.is_none();
        if let Some(program) = &compiled.program {
            preview.seconds = Some(program.seconds());
            preview.draw(graph("", program), false);
        }
        preview
    }

    /// Draws the first panel of a figure.
    fn draw(&mut self, figure: Figure, equal: bool) {
        let mut shown = figure.panels.first().into_iter().flat_map(|panel| &panel.series).filter(|it| is_shown(it));
        if shown.any(|series| series.points.len() > POINTS) {
            self.problems.push(format!("the drawing shows the first {POINTS} points of each way"));
        }
        self.drawing = Drawing::first(figure, equal);
    }

    /// Nothing is known of a program on a rig that cannot be built again.
    fn unknown() -> Self {
        Self::default()
    }

    fn with(problems: impl Iterator<Item = String>) -> Self {
        Self { problems: problems.take(TOLD).collect(), ..Self::default() }
    }
}

/// What has come of a rehearsal.
struct Rehearsed<J> {
    played: Played<J>,
    /// When the program was over, if it was.
    over: Option<Instant>,
}

impl<J: Job> Rehearsed<J> {
    /// Plays a program on a rig of its own, as fast as can be. None, if the rig breaks.
    fn of(file: &RigFile, job: J) -> Option<Self> {
        let keep = file.part.is_none().then(|| file.header(&file.name, 0, None));
        let play = Play { keep, quiet: true, ..Play::of(file.clone(), job, Driver::InProcess) };
        let after = if J::STATES.is_empty() { Span::ZERO } else { BUFFERED };
        let enough = tokio::sync::Notify::new();
        let mut over = None;
        let progress = |progress: Progress<'_, J>| {
            if !progress.job.is_over() {
                over = None;
            } else if progress.now >= *over.get_or_insert(progress.now) + after {
                enough.notify_one();
            }
        };
        let interrupted = async {
            tokio::select! {
                () = enough.notified() => {}
                () = tokio::time::sleep(LONGEST) => {}
            }
        };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().ok()?;
        let played = runtime.block_on(play.record(None, progress, interrupted)).ok()?;
        // What is seen at once may have happened long before.
        let over = over.filter(|_| played.ended != PlayEnd::OutOfPatience).map(|over| over.min(played.end));
        let idle = played.idle_after.map(|idle| Instant::START + idle);
        Some(Self { over: over.map(|over| idle.unwrap_or(over)), played })
    }

    fn preview(
        self,
        file: &RigFile,
        findings: Vec<String>,
        told: impl FnOnce(&J) -> Vec<String>,
        asked: Option<Asked>,
        stairs: &[Place],
    ) -> Preview {
        let Self { mut played, over } = self;
        let mut preview = Preview::with(findings.into_iter().chain(told(&played.job)));
        preview.seconds = over.map(Instant::as_secs_f64);
        match (&file.part, played.path.take()) {
            (Some(part), Some(path)) => draw_part(&mut preview, part, path, asked, stairs),
            _ => {
                let tracking = played.trace.as_ref().and_then(|trace| Tracking::of(trace).ok().flatten());
                if let Some(tracking) = tracking {
                    preview.draw(tracking.figure(""), true);
                }
            }
        }
        preview
    }
}

fn draw_part(preview: &mut Preview, part: &Part, path: ToolPath, asked: Option<Asked>, stairs: &[Place]) {
    let turned = path.cut();
    let at = part.place(0, 0);
    let asked = &asked.unwrap_or_else(|| Asked::new(at, at));
    let picture = Picture { title: "", asked, part, stairs, turned: Some(&turned.profile) };
    preview.draw(picture.figure(), true);
    preview.events = turned.happenings.iter().map(EventSummary::from).collect();
}

#[cfg(test)]
mod tests {
    use torno_plot::Style;

    use super::*;

    const FRAMES: &str = include_str!("../builtin/shaft.frames");
    const LINES: &str = include_str!("../builtin/shaft.nc");
    const NGC: &str = include_str!("../builtin/shaft.ngc");

    fn preview(rig: &str, text: &str) -> Preview {
        Preview::of(&RigFile::load(rig).unwrap(), text)
    }

    fn names(preview: &Preview) -> Vec<&str> {
        preview.drawing.as_ref().unwrap().lines.iter().map(|line| line.name.as_str()).collect()
    }

    fn least(preview: &Preview, line: &str) -> f64 {
        let lines = &preview.drawing.as_ref().unwrap().lines;
        let found = lines.iter().find(|drawn| drawn.name == line).unwrap();
        found.pieces.iter().flatten().filter(|(x, _)| *x < -1.0).map(|(_, y)| *y).fold(f64::MAX, f64::min)
    }

    #[test]
    fn the_part_that_frames_and_g_code_would_turn_is_drawn() {
        let frames = preview("lathe", FRAMES);
        assert_eq!((names(&frames), frames.problems.len()), (vec!["stock", "frames", "turned"], 0));
        let planned = preview("lathe", NGC);
        assert_eq!(names(&planned), ["stock", "frames", "turned", "rapid", "feed"]);
        let lines = preview("lathe-grbl", LINES);
        assert_eq!(names(&lines), ["stock", "turned", "rapid", "feed"]);
        // As the run of the same program says: 22.46 mm.
        for (name, preview) in [("frames", &frames), ("lines", &lines)] {
            let thinnest = least(preview, "turned");
            assert!(
                (thinnest - 11.23).abs() < 0.15 && preview.seconds.is_some_and(|s| (60.0..240.0).contains(&s)),
                "{name}: {thinnest}"
            );
        }
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        let refused = preview("lathe", "0A E1 00 E1 00 00 00 00\n0A E1");
        assert!(refused.refused && refused.problems[0].contains("line 2"), "{refused:?}");
        let planned = preview("lathe", "G21 G18\nG1 X20 Z-5 F60\nG99.9\n");
        let told = |wanted: &str| planned.problems.iter().any(|problem| problem.starts_with(wanted));
        assert!(planned.refused && told("line 2: warning: ") && told("line 3: G99.9 is not known"), "{planned:?}");
        let lines = preview("lathe-grbl", "G21\nG5 X3\nM2\n");
        assert_eq!((lines.refused, &lines.problems[..]), (false, &["line 2: error:20".to_owned()][..]));
        // The spindle stands, and the tool goes into the bar.
        let stands = preview("lathe", "00 00 00 00 00 00 14 01\n00 0A 00 FF 01 00 00 00");
        assert!(stands.events.iter().any(|event| event.event == "stopped"), "{:?}", stands.events);
        let servo = preview("servo", "x10 t1\nx1 q3\ne\n");
        assert!(servo.refused && servo.problems[0].starts_with("line 2: "), "{servo:?}");
    }

    #[test]
    fn a_program_that_would_take_minutes_is_not_looked_at() {
        let of_length = |length: usize| preview("servo", &"x".repeat(length));
        let long = of_length(LENGTH_MAX + 1);
        assert!(!long.refused && long.seconds.is_none() && long.problems[0].contains("8 MiB"), "{long:?}");
        assert!(of_length(LENGTH_MAX).refused);
    }

    #[test]
    fn of_a_long_way_the_beginning_is_drawn_and_that_is_told() {
        let drawn = |points: usize| {
            let points = (0..points).map(|n| (n as f64, 0.0)).collect();
            let series = vec![Series { name: "feed".to_owned(), style: Style::Line, points }];
            let panel = Panel { x: String::new(), y: String::new(), height: 1.0, series };
            let mut preview = Preview::default();
            preview.draw(Figure { title: String::new(), panels: vec![panel] }, false);
            (preview.drawing.unwrap().lines[0].pieces[0].len(), preview.problems)
        };
        assert_eq!(drawn(POINTS), (POINTS, Vec::new()));
        let (points, problems) = drawn(POINTS + 1);
        assert_eq!((points, problems.len()), (POINTS, 1));
    }

    #[test]
    fn a_way_over_a_bed_and_one_over_time_are_drawn() {
        let circle = preview("engraver", "G21 G91\nG1 Z-2.5 F600\nG2 X0 Y0 I-20 J0\nG0 Z2.5\n");
        let asked = circle.drawing.as_ref().unwrap().lines.iter().find(|line| line.name == "asked").unwrap();
        let leftmost = asked.pieces.iter().flatten().map(|(x, _)| *x).fold(f64::MAX, f64::min);
        assert!((leftmost + 40.0).abs() < 0.01 && circle.drawing.as_ref().unwrap().equal, "{leftmost}");
        assert!(!names(&circle).contains(&"gone"));
        let servo = preview("servo", "x10 t2\ne\n");
        let drawing = servo.drawing.unwrap();
        assert_eq!((drawing.lines[0].pieces[0].last(), servo.seconds), (Some(&(2.0, 10.0)), Some(2.0)));
    }
}
