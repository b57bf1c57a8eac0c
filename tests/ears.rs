//! A trace marks exactly the line errors that the boards met, at the same instants: whatever their clocks, whatever
//! breaks.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use torno::rig::file::RigFile;
use torno_engine::Fact;
use torno_protocol::board::event_text;
use torno_protocol::lathe::Slave;
use torno_trace::Trace;

use crate::common::{folder, output};

/// The boards whose clocks can be off, in the order of the table in the documentation.
const CLOCKS: [&str; 5] = ["pc", "master", "spindle", "transverse", "depth"];

/// Many different bytes, in frames that end soon. The last one is refused.
const FRAMES: &str = "0A E1 00 E1 00 00 01 00\n15 55 01 2C 01 00 02 01\n00 10 00 AA 00 00 01 00\n";

/// Line errors, each with its instant in nanoseconds and its line.
type Errors = BTreeSet<(u64, String)>;

fn read(path: &Path) -> Trace {
    torno_trace::read(fs::File::open(path).unwrap(), RigFile::layout_of).unwrap().0
}

/// The errors that the trace marks.
pub(crate) fn marked(trace: &Trace) -> Errors {
    let bad = trace.characters().into_iter().filter(|heard| heard.character.ok().is_none() && heard.at < trace.until());
    bad.map(|heard| (heard.at.as_nanos(), trace.header.layout.lines[heard.line].name.clone())).collect()
}

/// The errors that the boards report.
pub(crate) fn told(trace: &Trace) -> Errors {
    let boards = &trace.header.layout.boards;
    let told = trace.facts.iter().filter_map(|fact| {
        let Fact::Event { node, at, event, value } = fact else { return None };
        let board = &boards[*node];
        let text = &board.description.events[usize::from(*event)];
        let text = if text.starts_with("received") { text.clone() } else { event_text(text, *value) };
        let line = match (board.name.as_str(), text.as_str()) {
            ("pc", "received with an error {}") => "master_to_pc".to_owned(),
            ("master", "framing error on the line from the PC") => "pc_to_master".to_owned(),
            ("master", text) => {
                let letter = text.strip_prefix("line error from slave '")?.chars().next()?;
                let slave = Slave::ALL.into_iter().find(|slave| char::from(slave.letter()) == letter)?;
                format!("{}_to_master", slave.name())
            }
            (slave, "framing error") => format!("master_to_{slave}"),
            _ => return None,
        };
        Some((at.as_nanos(), line))
    });
    told.collect()
}

/// The line errors while the frames are played on a lathe with this clock.
fn played(folder: &Path, board: &str, ppm: i32) -> Errors {
    let [program, trace] = ["a.frames", "a.torno"].map(|name| folder.join(name));
    fs::write(&program, FRAMES).unwrap();
    let clock = format!("{board}.clock_ppm={ppm}");
    let [program, path] = [&program, &trace].map(|path| path.to_str().unwrap());
    let played = output(&["run", "lathe", program, "--in-process", "--set", &clock, "--record", path]);
    assert!(played.status.code().is_some_and(|code| code < 2), "{clock}: {played:?}");
    let trace = read(&trace);
    let (marked, told) = (marked(&trace), told(&trace));
    assert_eq!(marked, told, "{clock}");
    told
}

/// The documentation has the table that comes out.
#[test]
fn a_trace_marks_the_line_errors_that_the_boards_tell_of_whatever_the_clocks() {
    let folder = folder();
    let mut table = String::new();
    for ppm in (-60_000..=60_000).step_by(5_000) {
        let errors = CLOCKS.map(|board| played(folder.path(), board, ppm).len());
        if ppm % 10_000 == 0 {
            let cells = errors.map(|errors| errors.to_string()).join(" | ");
            writeln!(table, "| {ppm} | {cells} |").unwrap();
        }
    }
    let page = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/trace.md")).unwrap();
    let rows: BTreeSet<&str> = page.lines().map(str::trim).collect();
    assert!(table.lines().all(|row| rows.contains(row)), "docs/trace.md should have these rows:\n{table}");
}

/// Every line is noisy, oscillators drift and are replaced, boards are reset and lose their supply.
#[test]
fn a_trace_marks_the_line_errors_that_the_boards_tell_of_whatever_breaks() {
    let folder = folder();
    let (file, path) = (folder.path().join("a.toml"), folder.path().join("a.torno"));
    let noise = ["pc_to_master", "master_to_pc"].map(str::to_owned).into_iter().chain(
        Slave::ALL
            .iter()
            .flat_map(|slave| [format!("master_to_{}", slave.name()), format!("{}_to_master", slave.name())]),
    );
    let mut faults = String::new();
    for line in noise {
        let noise = "kind = \"noise\"\nperiod = \"1 ms..20 ms\"\nwidth = \"20 us..400 us\"";
        writeln!(faults, "[[fault]]\nline = \"{line}\"\n{noise}").unwrap();
    }
    for board in &CLOCKS[1..] {
        for (kind, rest) in [
            ("clock", "at = \"0 s..1 s\"\nvalue = \"-6 %..6 %\""),
            ("drift", "at = \"1 s..2 s\"\nvalue = \"-1 %..1 %\""),
            ("power-off", "at = \"0 s..3 s\"\nfor = \"1 ms..500 ms\""),
            ("reset", "at = \"0 s..3 s\""),
        ] {
            writeln!(faults, "[[fault]]\nboard = \"{board}\"\nkind = \"{kind}\"\n{rest}").unwrap();
        }
    }
    let step = |send: &str| format!("[[step]]\ndoes = \"a frame\"\nsend = [\"{send}\"]\n");
    let pause = "[[step]]\ndoes = \"time passes\"\nrun = \"100 ms..900 ms\"\n";
    let steps: Vec<String> = FRAMES.lines().chain(FRAMES.lines()).map(step).collect();
    fs::write(&file, format!("name = \"n\"\nend = \"5 s\"\n{}{faults}", steps.join(pause))).unwrap();
    let mut lines = BTreeSet::new();
    for seed in 0..20 {
        let seed = seed.to_string();
        let [file, record] = [&file, &path].map(|path| path.to_str().unwrap());
        let tested = output(&["test", file, "--seed", &seed, "--record", record]);
        assert!(tested.status.code().is_some_and(|code| code < 2), "{tested:?}");
        let trace = read(&path);
        let (marked, told) = (marked(&trace), told(&trace));
        assert_eq!(marked, told, "seed {seed}");
        lines.extend(told.into_iter().map(|(_, line)| line));
    }
    assert_eq!(lines.len(), 8, "{lines:?}");
}

/// A software receiver is a part of the firmware: it hears nothing while that hangs.
#[test]
fn a_master_that_hangs_hears_nothing_of_its_slaves() {
    let folder = folder();
    let (file, path) = (folder.path().join("a.toml"), folder.path().join("a.torno"));
    let noise = |slave: &Slave| {
        let line = format!("[[fault]]\nline = \"{}_to_master\"\n", slave.name());
        line + "kind = \"noise\"\nperiod = \"2 ms\"\nwidth = \"2 ms\"\n"
    };
    let hang = "[[fault]]\nboard = \"master\"\nkind = \"hang\"\nat = \"1 s\"\nfor = \"1 s\"\n";
    let noise = Slave::ALL.iter().map(noise).collect::<String>();
    fs::write(&file, format!("name = \"n\"\nend = \"3 s\"\n{noise}{hang}")).unwrap();
    let tested = output(&["test", file.to_str().unwrap(), "--record", path.to_str().unwrap()]);
    assert_eq!(tested.status.code(), Some(0), "{tested:?}");
    let trace = read(&path);
    let errors = marked(&trace);
    assert_eq!(errors, told(&trace));
    let heard = |from: f64, to: f64| errors.iter().filter(|(ns, _)| (from..to).contains(&(*ns as f64 / 1e9))).count();
    assert!(heard(0.0, 1.0) > 20 && heard(1.0, 2.0) == 0 && heard(2.0, 3.0) > 20, "{errors:?}");
}
