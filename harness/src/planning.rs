//! What the planner of G-code has to know of a rig.

use torno_gcode::{Dialect, Interpreter, Motion, Outcome, Place as Position, Severity};
use torno_machines::axes;
use torno_machines::workpiece::{Part, Source};
use torno_part::{Place, Side as Surface};
use torno_planner::{Planned, Planner, Report, Scale, Settings, Side, Stock};
use torno_protocol::lathe::Program;

use crate::job::LineJob;
use crate::rig::file::RigFile;
use crate::toolpath::Asked;

/// Why no program can be planned for a rig.
#[derive(Debug, thiserror::Error)]
pub enum PlanningError {
    /// It takes no frames.
    #[error("G-code is planned for rigs that speak {}, and the rig '{rig}' speaks {dialect}", Program::DIALECT)]
    Dialect {
        /// The rig.
        rig: String,
        /// What is said on the PC's line.
        dialect: &'static str,
    },
    /// It has no such axis.
    #[error("the rig '{rig}' has no board that moves {axis}: expected the lathe's boards")]
    NoAxis {
        /// The rig.
        rig: String,
        /// The axis, in words.
        axis: &'static str,
    },
    /// The tool is moved by something else.
    #[error("the [part] of the rig '{rig}': {axis}, the tool is not moved by the board '{board}', which frames move")]
    OtherBoard {
        /// The rig.
        rig: String,
        /// The axis, in words.
        axis: &'static str,
        /// The board.
        board: String,
    },
}

const ALONG: &str = "along the bar";
const ACROSS: &str = "across the bar";

/// How a program is planned for a rig: what frames are worth there, what the tool meets, and where it stands at the
/// start, unless the program calls that place `start`.
///
/// # Errors
/// [`PlanningError`] if frames mean nothing on it, or something else.
pub fn settings(file: &RigFile, start: Option<Place>, side: Side) -> Result<Settings, PlanningError> {
    let rig = || file.name.clone();
    // A controller between the PC and the master speaks frames to it.
    if file.pc.dialect.name() != Program::DIALECT && !file.pc.dialect.counts_characters() {
        return Err(PlanningError::Dialect { rig: rig(), dialect: file.pc.dialect.name() });
    }
    // The settings have been checked with the file.
    let boards = file.boards.iter().enumerate();
    let boards: Vec<_> =
        boards.filter_map(|(node, board)| Some((node, axes(&board.kind, &board.settings).ok()?))).collect();
    let feed = boards.iter().find_map(|(node, axes)| Some(((*node, axes.feed?.0), axes.feed?.1)));
    let infeed = boards.iter().find_map(|(node, axes)| Some(((*node, axes.infeed?.0), axes.infeed?.1)));
    let (of_feed, mut feed) = feed.ok_or_else(|| PlanningError::NoAxis { rig: rig(), axis: ALONG })?;
    let (of_infeed, mut infeed) = infeed.ok_or_else(|| PlanningError::NoAxis { rig: rig(), axis: ACROSS })?;
    let mut stock = None;
    if let Some(part) = &file.part {
        for (axis, way, moved) in [(ALONG, &part.z.way, of_feed), (ACROSS, &part.x.way, of_infeed)] {
            if !is_moved_by(file, way, moved) {
                return Err(PlanningError::OtherBoard { rig: rig(), axis, board: file.boards[moved.0].name.clone() });
            }
        }
        (feed.mm_per_count, infeed.mm_per_slot) = (part.z.way.per_count, part.x.way.per_count);
        stock = Some(bar(part));
    }
    let here = stock.as_ref().map(|stock| stock.start).unwrap_or_default();
    Ok(Settings {
        scale: Scale { feed, infeed },
        start: start.unwrap_or(here),
        side,
        bore: file.part.as_ref().is_some_and(|part| part.side == Surface::Inside),
        stock,
        optimise: false,
        frames_max: Settings::FRAMES_MAX,
    })
}

/// The line that says to a controller where the tool stands at the start.
pub fn first_line(at: Place) -> String {
    format!("G10 L20 P1 X{:.4} Z{:.4}\n", at.x, at.z)
}

/// G-code that has been planned.
pub struct Plan {
    /// Its frames. Good for nothing, if it is refused.
    pub program: Program,
    /// The path that it asks for.
    pub asked: Asked,
    /// What the planner says.
    pub report: Report,
    /// What the interpreter says.
    pub outcome: Outcome,
}

impl Plan {
    /// Plans the G-code in a text, in a dialect, or the one that its first lines look like.
    pub fn new(text: &str, for_rig: Settings, dialect: Option<Dialect>) -> Self {
        let at = for_rig.stock.as_ref().map_or(for_rig.start, |stock| stock.start);
        let start = Position { x: for_rig.start.x, z: for_rig.start.z, ..Position::default() };
        let settings = torno_gcode::Settings { dialect, start, home: start, ..torno_gcode::Settings::default() };
        let mut asked = Asked::new(at, for_rig.start);
        let mut planner = Planner::new(for_rig);
        let mut interpreter = Interpreter::new(&settings);
        let mut frames = Vec::new();
        let mut note = |planner: &mut Planner| {
            frames.extend(core::iter::from_fn(|| planner.poll()).map(|Planned { frame, .. }| frame.emit()));
        };
        let mut take = |motion: Motion| {
            asked.take(&motion);
            planner.take(&motion);
            note(&mut planner);
        };
        interpreter.push(text.as_bytes(), &mut take);
        let outcome = interpreter.finish(&mut take);
        planner.finish();
        note(&mut planner);
        Self { program: Program { frames }, asked, report: planner.report(), outcome }
    }

    /// Whether it cannot be played.
    pub fn is_refused(&self) -> bool {
        self.outcome.is_refused() || self.report.refused
    }

    /// What is wrong with it, or strange, with its line.
    fn findings(&self) -> Vec<String> {
        let told = |line: usize, severity: Severity, message: &str| {
            let word = if severity == Severity::Error { "" } else { "warning: " };
            (line, format!("line {line}: {word}{message}"))
        };
        let found = self.outcome.findings.iter().map(|finding| told(finding.line, finding.severity, &finding.message));
        let planned = self.report.findings.iter().map(|finding| told(finding.line, finding.severity, &finding.message));
        let mut all: Vec<(usize, String)> = found.chain(planned).collect();
        all.sort_by_key(|(line, _)| *line);
        all.into_iter().map(|(_, text)| text).collect()
    }
}

/// The text of a program, as a rig takes it.
pub enum Text {
    /// Frames.
    Frames {
        /// They.
        program: Program,
        /// The path that the G-code asks for of which they have been planned, if they have.
        asked: Option<Asked>,
        /// What is strange about it, with its line.
        findings: Vec<String>,
    },
    /// Lines for a controller, with one before them that says where the tool stands.
    Lines(LineJob),
}

impl Text {
    /// Reads a program for a rig. Where the rig takes frames, G-code is planned.
    ///
    /// # Errors
    /// What is wrong with it, for people: one thing a line.
    pub fn read(file: &RigFile, text: &str) -> Result<Self, String> {
        let dialect = file.pc.dialect;
        let for_rig = settings(file, None, Side::default());
        if dialect.counts_characters() {
            let first = for_rig.map_or_else(|_| String::new(), |for_rig| first_line(for_rig.start));
            return Ok(Self::Lines(LineJob::new(&first, text)));
        }
        if dialect.name() != Program::DIALECT {
            let player = dialect.player_at_port().unwrap_or_else(|| dialect.player());
            return Err(format!("no program is played on this rig from here: use '{player}' at its port"));
        }
        if !is_gcode(text) {
            let program = Program::parse(text).map_err(|error| error.to_string())?;
            return Ok(Self::Frames { program, asked: None, findings: Vec::new() });
        }
        let plan = Plan::new(text, for_rig.map_err(|error| error.to_string())?, None);
        let findings = plan.findings();
        if plan.is_refused() {
            return Err(findings.join("\n"));
        }
        Ok(Self::Frames { program: plan.program, asked: Some(plan.asked), findings })
    }
}

/// The path that lines for a rig's controller ask for. None, if that is not known: what the interpreter refuses, the
/// controller may take.
pub fn asked_by_lines(file: &RigFile, text: &str) -> Option<Asked> {
    let plan = Plan::new(text, settings(file, None, Side::default()).ok()?, Some(Dialect::LinuxCnc));
    (!plan.outcome.is_refused()).then_some(plan.asked)
}

/// Whether a text is G-code rather than frames: it begins with neither a hexadecimal number nor a comment of theirs.
fn is_gcode(text: &str) -> bool {
    let first = text.trim_start_matches('\u{feff}').trim_start().chars().next();
    first.is_some_and(|c| !c.is_ascii_hexdigit() && c != '#')
}

/// Whether all quantities of a source are about one motor of a board.
fn is_moved_by(file: &RigFile, way: &Source, (node, motor): (usize, u8)) -> bool {
    let signals = &file.boards[node].description.signals;
    let about = |signal: &u8| signals.get(usize::from(*signal)).is_some_and(|signal| signal.motor == Some(motor));
    way.node == node && way.signals.iter().all(about)
}

fn bar(part: &Part) -> Stock {
    Stock { profile: part.bar(), nose: part.nose, limits: part.limits, start: part.place(0, 0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn planned(rig: &str, set: &[&str]) -> Result<Settings, PlanningError> {
        let file = set.iter().fold(RigFile::load(rig).unwrap(), |file, set| file.set(set).unwrap());
        settings(&file, None, Side::Middle)
    }

    #[test]
    fn what_a_frame_is_worth_comes_from_the_rig() {
        for rig in ["lathe", "lathe-dspic"] {
            let Settings { scale, start, .. } = planned(rig, &[]).unwrap();
            assert!((scale.feed.unit() - 40.0 / 9.0).abs() < 1e-9 && (start.x - 14.0 - 2.0 * 8.0 / 45.0).abs() < 1e-9);
            assert!((scale.infeed.mm_per_slot - 8.0 / 45.0).abs() < 1e-9);
        }
        let finer = planned("lathe", &["transverse.plant.pitch_mm=1"]).unwrap();
        assert!((finer.scale.feed.unit() - 20.0 / 9.0).abs() < 1e-9);
        let slower = planned("lathe", &["depth.plant.rpm=4"]).unwrap();
        assert!((slower.scale.infeed.mm_per_s * 60.0 - 8.0).abs() < 1e-9);
    }

    #[test]
    fn a_rig_without_a_part_is_planned_for_and_one_without_frames_is_not() {
        let text = include_str!("../builtin/lathe.toml").split("[part]").next().unwrap();
        let bare = RigFile::parse("my.toml", text).unwrap();
        assert!(settings(&bare, None, Side::Middle).unwrap().stock.is_none());
        assert!(matches!(planned("servo", &[]), Err(PlanningError::Dialect { .. })));
        let swapped = include_str!("../builtin/lathe.toml").replace("board = \"depth\"", "board = \"transverse\"");
        let swapped = RigFile::parse("my.toml", &swapped).unwrap();
        let message = settings(&swapped, None, Side::Middle).unwrap_err().to_string();
        assert!(message.contains("across the bar, the tool is not moved by the board 'depth'"), "{message}");
    }
}
