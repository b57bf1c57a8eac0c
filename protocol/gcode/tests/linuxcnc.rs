//! The motions of this crate against the canonical calls of LinuxCNC's own interpreter.

#![allow(clippy::disallowed_methods, reason = "what is expected is not compared to the last digit")]
#![allow(clippy::unwrap_used, reason = "in a test, a panic is an answer")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use torno_gcode::{Feed, Kind, Motion, Plane, Sense, Settings, Speed, Turn, interpret};

const PROGRAMS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/programs");

/// In mm: `rs274` prints four digits.
const NEAR: f64 = 1e-4;

fn programs() -> Vec<PathBuf> {
    let entries = fs::read_dir(PROGRAMS).unwrap().map(|entry| entry.unwrap().path());
    let mut programs: Vec<PathBuf> = entries.filter(|path| path.extension().is_some_and(|end| end == "ngc")).collect();
    programs.sort();
    assert!(programs.len() >= 8, "{programs:?}");
    programs
}

/// What is compared: a name, and its numbers.
#[derive(Clone, Debug, PartialEq)]
struct Step {
    what: &'static str,
    numbers: Vec<f64>,
}

impl Step {
    fn new(what: &'static str, numbers: impl Into<Vec<f64>>) -> Self {
        Self { what, numbers: numbers.into() }
    }

    fn is_near(&self, other: &Self) -> bool {
        let near = |(a, b): (&f64, &f64)| (a - b).abs() <= NEAR;
        self.what == other.what
            && self.numbers.len() == other.numbers.len()
            && self.numbers.iter().zip(&other.numbers).all(near)
    }
}

const fn plane_of(plane: Plane) -> f64 {
    match plane {
        Plane::Xy => 17.0,
        Plane::Zx => 18.0,
        Plane::Yz => 19.0,
    }
}

/// Of this crate.
fn ours(motions: &[Motion]) -> Vec<Step> {
    let mut steps = Vec::new();
    let mut spindle = (Sense::Off, Speed::Constant(0.0));
    for Motion { kind, .. } in motions {
        let feed_of = |feed: Feed| match feed {
            Feed::PerMinute(feed) => [0.0, feed],
            Feed::PerRevolution(feed) => [1.0, feed],
        };
        steps.push(match *kind {
            Kind::Rapid { to } => Step::new("rapid", [to.x, to.y, to.z, to.a]),
            Kind::Feed { to, feed } => Step::new("feed", [&[to.x, to.y, to.z, to.a], &feed_of(feed)[..]].concat()),
            Kind::Arc { to, plane, centre, turn, turns, feed } => {
                let turns = f64::from(turns) * if turn == Turn::Clockwise { -1.0 } else { 1.0 };
                let place = [to.x, to.y, to.z, to.a];
                let rest = [plane_of(plane), centre[0], centre[1], turns];
                Step::new("arc", [&place[..], &rest, &feed_of(feed)].concat())
            }
            Kind::Dwell { seconds } => Step::new("dwell", [seconds]),
            Kind::Plane(plane) => Step::new("plane", [plane_of(plane)]),
            Kind::Spindle { sense, speed } => {
                if (sense, speed) == spindle {
                    continue;
                }
                spindle = (sense, speed);
                let sense = match sense {
                    Sense::Off => 0.0,
                    Sense::Clockwise => 1.0,
                    Sense::Counterclockwise => -1.0,
                };
                let (speed, surface) = match speed {
                    Speed::Constant(rpm) => (rpm, 0.0),
                    Speed::Surface { m_per_min, most_rpm } => (m_per_min, most_rpm.unwrap_or(1e30)),
                };
                Step::new("spindle", [sense, speed, surface])
            }
            Kind::Coolant { mist, flood } => Step::new("coolant", [mist, flood].map(|on| f64::from(u8::from(on)))),
            Kind::Tool(tool) => Step::new("tool", [f64::from(tool)]),
            Kind::Stop { optional } => Step::new("stop", [f64::from(u8::from(optional))]),
            Kind::End => Step::new("end", []),
        });
    }
    steps
}

/// A call: its name, its numbers, the word in it.
fn call(line: &str) -> Option<(&str, Vec<f64>, &str)> {
    let line = line.get(12..)?.trim_start();
    let (name, rest) = line.split_once('(')?;
    let inside = rest.strip_suffix(')')?;
    let numbers = inside.split([',', ' ']).filter_map(|word| word.parse().ok()).collect();
    Some((name, numbers, inside))
}

/// Of LinuxCNC's interpreter: its calls tell places in the program's units and coordinates, and each offset by itself.
fn theirs(calls: &str) -> Vec<Step> {
    let mut steps: Vec<Step> = Vec::new();
    let (mut unit, mut plane, mut feed) = (1.0, 17.0, [0.0, 0.0]);
    let mut offsets = [[0.0; 4]; 3];
    let (mut spindle, mut coolant) = ([0.0, 0.0, 0.0], [0.0, 0.0]);
    let mut told = spindle;
    // The end resets LinuxCNC's modes, each by a call: it is one motion here.
    let body: &str = calls.split("PROGRAM_END").next().unwrap_or_default();
    let lines: Vec<&str> = body[..body.rfind("SET_G5X_OFFSET").unwrap()].lines().collect();
    for (nth, line) in lines.iter().enumerate() {
        let Some((name, numbers, word)) = call(line) else { continue };
        let unit_of = |axis: usize| if axis == 3 { 1.0 } else { unit };
        let of_machine =
            |axis: usize, value: f64| value * unit_of(axis) + offsets.iter().map(|offset| offset[axis]).sum::<f64>();
        let place = |at: [f64; 4]| -> Vec<f64> { (0..4).map(|axis| of_machine(axis, at[axis])).collect() };
        let ends = || [numbers[0], numbers[1], numbers[2], numbers[3]];
        // Speed, mode and sense are three calls; this crate tells them at once, when all are known.
        let of_spindle = |name: &str| name.contains("SPINDLE");
        let of_block = |other: &&&str| other.get(6..12) == line.get(6..12);
        let next = lines.get(nth + 1).filter(of_block).and_then(|line| call(line)).map_or("", |call| call.0);
        match name {
            "USE_LENGTH_UNITS" => unit = if word.contains("MM") { 1.0 } else { 25.4 },
            "SET_G5X_OFFSET" => offsets[0] = core::array::from_fn(|axis| numbers[axis + 1] * unit_of(axis)),
            "SET_G92_OFFSET" => offsets[1] = core::array::from_fn(|axis| numbers[axis] * unit_of(axis)),
            "USE_TOOL_LENGTH_OFFSET" => offsets[2] = core::array::from_fn(|axis| numbers[axis] * unit_of(axis)),
            "SELECT_PLANE" => {
                plane = if word.contains("XZ") {
                    18.0
                } else if word.contains("YZ") {
                    19.0
                } else {
                    17.0
                };
                steps.push(Step::new("plane", [plane]));
            }
            "SET_FEED_MODE" => feed[0] = numbers[1],
            "SET_FEED_RATE" => feed[1] = numbers[0] * unit,
            "STRAIGHT_TRAVERSE" => steps.push(Step::new("rapid", place(ends()))),
            "STRAIGHT_FEED" => steps.push(Step::new("feed", [place(ends()), feed.to_vec()].concat())),
            "ARC_FEED" => {
                let [first, second, across] = match plane {
                    17.0 => [0, 1, 2],
                    18.0 => [2, 0, 1],
                    _ => [1, 2, 0],
                };
                let mut end = [0.0; 4];
                (end[first], end[second], end[across], end[3]) = (numbers[0], numbers[1], numbers[5], numbers[6]);
                let centre = [of_machine(first, numbers[2]), of_machine(second, numbers[3])];
                let rest = [plane, centre[0], centre[1], numbers[4], feed[0], feed[1]];
                steps.push(Step::new("arc", [place(end), rest.to_vec()].concat()));
            }
            "DWELL" => steps.push(Step::new("dwell", numbers)),
            "SET_SPINDLE_SPEED" => spindle[1] = numbers[1],
            "SET_SPINDLE_MODE" => spindle[2] = numbers[1],
            "START_SPINDLE_CLOCKWISE" => spindle[0] = 1.0,
            "START_SPINDLE_COUNTERCLOCKWISE" => spindle[0] = -1.0,
            "STOP_SPINDLE_TURNING" => spindle[0] = 0.0,
            "CHANGE_TOOL" | "CHANGE_TOOL_NUMBER" => steps.push(Step::new("tool", numbers)),
            "FLOOD_ON" => coolant[1] = 1.0,
            "MIST_ON" => coolant[0] = 1.0,
            // M9 is two calls: this one, then FLOOD_OFF.
            "MIST_OFF" => continue,
            "FLOOD_OFF" => coolant = [0.0, 0.0],
            "PROGRAM_STOP" => steps.push(Step::new("stop", [0.0])),
            "OPTIONAL_PROGRAM_STOP" => steps.push(Step::new("stop", [1.0])),
            _ => {}
        }
        if matches!(name, "FLOOD_ON" | "MIST_ON" | "FLOOD_OFF") {
            steps.push(Step::new("coolant", coolant));
        }
        if of_spindle(name) && !of_spindle(next) && spindle != told {
            told = spindle;
            steps.push(Step::new("spindle", spindle));
        }
    }
    steps.push(Step::new("end", []));
    steps
}

/// The motions of a program, which must be understood as a whole.
fn motions_of(path: &Path) -> Vec<Motion> {
    let (motions, outcome) = interpret(&fs::read(path).unwrap(), &Settings::default());
    assert!(!outcome.is_refused(), "{}: {:#?}", path.display(), outcome.findings);
    motions
}

fn compare(path: &Path, calls: &str) -> usize {
    let motions = motions_of(path);
    let (ours, theirs) = (ours(&motions), theirs(calls));
    for (nth, (ours, theirs)) in ours.iter().zip(&theirs).enumerate() {
        assert!(ours.is_near(theirs), "{}, step {nth}:\n{ours:?}, not\n{theirs:?}", path.display());
    }
    let (a, b) = (ours.len(), theirs.len());
    let rest = (ours.get(b), theirs.get(a));
    assert_eq!(a, b, "{}: {rest:?}", path.display());
    a
}

#[test]
fn motions_are_those_that_linuxcnc_has_printed() {
    let count = |path: PathBuf| compare(&path, &fs::read_to_string(path.with_extension("canon")).unwrap());
    let steps: usize = programs().into_iter().map(count).sum();
    println!("{steps} steps are alike");
    assert!(steps > 300, "{steps}");
}

#[test]
fn motions_are_those_of_the_linuxcnc_that_is_installed() {
    if Command::new("rs274").arg("-h").output().is_err() {
        assert!(std::env::var_os("CI").is_none(), "rs274 is not installed, and in CI nothing is skipped");
        println!("skipped: rs274 is not installed (Debian: linuxcnc-uspace)");
        return;
    }
    for path in programs() {
        let mut command = Command::new("rs274");
        command.args(["-t", "tools.tbl", "-g"]).arg(path.file_name().unwrap());
        let output = command.current_dir(PROGRAMS).output().unwrap();
        let calls = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(calls.contains("PROGRAM_END"), "{}: {}", path.display(), String::from_utf8_lossy(&output.stderr));
        compare(&path, &calls);
    }
}

#[test]
fn a_motion_that_is_printed_is_read_again() {
    for path in programs() {
        for motion in motions_of(&path) {
            assert_eq!(motion.to_string().parse(), Ok(motion));
        }
    }
}

#[test]
fn g70_leads_out_along_x_too() {
    // LinuxCNC 2.9.0~pre1 cuts into the part here; later ones do not.
    let text = "G18 G21 G8 F9\no1 sub\nG0 Z-8\nG1 X10\nZ-3\nX4\nZ0\no1 endsub\nG0 X20 Z1\nG70 Q1 D0.4 E0.4\nM2\n";
    let (motions, outcome) = interpret(text.as_bytes(), &Settings::default());
    assert!(!outcome.is_refused(), "{:?}", outcome.findings);
    let end = |motion: &Motion| match motion.kind {
        Kind::Rapid { to } | Kind::Feed { to, .. } | Kind::Arc { to, .. } => Some([to.x, to.z]),
        _ => None,
    };
    let places: Vec<[f64; 2]> = motions.iter().skip(2).filter_map(end).collect();
    // All along, 0.4 mm are left; corners that point outward are rounded.
    let wanted =
        [[20.0, 1.0], [20.0, 1.0], [20.0, -7.6], [10.4, -7.6], [10.4, -3.0], [10.0, -2.6], [4.4, -2.6], [4.4, 0.0]];
    assert_eq!(places.len(), wanted.len(), "{places:?}");
    let near = |(a, b): (&[f64; 2], &[f64; 2])| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
    assert!(places.iter().zip(&wanted).all(near), "{places:?}");
}
