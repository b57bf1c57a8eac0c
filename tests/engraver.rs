//! The engraver from outside: its runs, its pins, and the way of its axes.

use torno::job::LineJob;
use torno::play::Play;
use torno::rig::Driver;
use torno::rig::file::RigFile;
use torno::tracking::Tracking;
use torno_plot::{Colours, Figure, Format, Panel, Series, Style};

use crate::common::play::{Dump, block_on};
use crate::common::{folder, json, output};

/// A program in a file of this folder.
fn written(folder: &std::path::Path, program: &str) -> String {
    let path = folder.join("job.nc");
    std::fs::write(&path, program).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn a_run_is_the_same_in_processes_in_one_process_and_replayed() {
    let folder = folder();
    let recording = folder.path().join("rosette.torno");
    let recording = recording.to_str().unwrap();
    let in_processes = json(&output(&["run", "engraver", "--json", "--record", recording]));
    let in_process = json(&output(&["run", "engraver", "--json", "--in-process"]));
    assert_eq!(in_processes["outcome"], "completed");
    assert_eq!(in_processes["digest"], in_process["digest"]);
    let boards = &in_processes["boards"]["engraver"];
    for axis in ["x", "y", "z", "a"] {
        assert_eq!(boards[format!("{axis}_corrections")], 0, "{axis}");
    }
    // The last motion ends the run.
    let [idle, end] = ["idle_after_s", "virtual_s"].map(|field| in_processes[field].as_f64().unwrap());
    assert!((81.0..81.2).contains(&idle) && end - idle < 0.5, "{idle} {end}");
    let again = json(&output(&["replay", recording, "--json"]));
    assert_eq!(again["digest"], in_processes["digest"]);
}

/// What a counter makes of two channels, all four edges of a line.
fn quadrature(dump: &Dump, a: &str, b: &str) -> i64 {
    let mut edges: Vec<(u64, bool, bool)> = Vec::new();
    edges.extend(dump.wires[a].iter().map(|(at, level)| (*at, true, *level)));
    edges.extend(dump.wires[b].iter().map(|(at, level)| (*at, false, *level)));
    edges.sort_unstable();
    let (mut levels, mut count) = ([false; 2], 0);
    for (at, is_a, level) in edges {
        let before = levels;
        levels[usize::from(!is_a)] = level;
        // The first values of a dump are no edges.
        if before == levels || at == 0 {
            continue;
        }
        // A leads in the positive sense.
        count += if (levels[0] != levels[1]) == is_a { 1 } else { -1 };
    }
    count
}

#[test]
fn the_pins_tell_the_same_way_as_the_axis_goes() {
    let folder = folder();
    let program = written(folder.path(), "G91\nG1 X10 F600\nX-4\nM2\n");
    let vcd = folder.path().join("pins.vcd");
    let arguments = ["run", "engraver", &program, "--pins", "--vcd-step", "1 ns", "--vcd", vcd.to_str().unwrap()];
    assert!(output(&arguments).status.success());
    let dump = Dump::read(&std::fs::read_to_string(&vcd).unwrap());
    let steps = dump.wires["engraver_x_step"].iter().filter(|(at, level)| *level && *at > 0);
    let way = |at: u64| if dump.level("engraver_x_direction", at) { -1 } else { 1 };
    let (mut forth, mut back) = (0, 0);
    for (at, _) in steps {
        if way(*at) > 0 {
            forth += 1;
        } else {
            back += 1;
        }
    }
    assert_eq!((forth, back), (4_000, 1_600));
    // 6 mm are 727.27 counts.
    assert_eq!(quadrature(&dump, "engraver_x_encoder_a", "engraver_x_encoder_b"), 727);
    assert_eq!(quadrature(&dump, "engraver_y_encoder_a", "engraver_y_encoder_b"), 0);
    // The index mark is where the carriage starts, a count wide.
    let marks = &dump.wires["engraver_x_encoder_z"];
    assert_eq!(marks.iter().map(|(_, level)| *level).collect::<Vec<_>>(), [true, false]);
}

/// Positions from GRBL 1.1h on an emulated ATmega328P, in steps of 0.004 mm, every 10 ms.
fn recorded(csv: &str) -> Vec<[f64; 3]> {
    let row = |line: &str| {
        let numbers: Vec<f64> = line.split(',').map(|number| number.parse().unwrap()).collect();
        [numbers[1] / 250.0, numbers[2] / 250.0, numbers[3] / 250.0]
    };
    csv.lines().skip(1).map(row).collect()
}

const SQUARE: &str = include_str!("../protocol/motion/tests/firmware/square.nc");
const CIRCLE: &str = include_str!("../protocol/motion/tests/firmware/circle.nc");

/// The rig with that firmware's settings.
const AS_GRBL: [&str; 9] = [
    "engraver.axes=3",
    "engraver.loop.mode=open",
    "engraver.x.mm_per_s=50",
    "engraver.x.mm_per_s2=500",
    "engraver.y.mm_per_s=50",
    "engraver.y.mm_per_s2=500",
    "engraver.z.mm_per_s=16.666666666666668",
    "engraver.z.mm_per_s2=200",
    "engraver.motor.rotor_hz=0",
];

/// Where the carriages are, every millisecond.
fn gone(program: &str) -> Vec<[f64; 3]> {
    let file = AS_GRBL.iter().fold(RigFile::load("engraver").unwrap(), |file, set| file.set(set).unwrap());
    let header = file.header("engraver", 0, None);
    let play = Play { keep: Some(header), ..Play::of(file, LineJob::new("", program), Driver::InProcess) };
    let trace = block_on(play.run(|_| ())).unwrap().trace.unwrap();
    let tracking = Tracking::of(&trace).unwrap().unwrap();
    assert!((tracking.at[1] - 0.001).abs() < 1e-9);
    (0..tracking.at.len()).map(|n| core::array::from_fn(|axis| tracking.axes[axis].places[n].1)).collect()
}

fn apart(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]) * (a[axis] - b[axis])).sum::<f64>().sqrt()
}

/// The first and the last instant of motion.
fn moves(places: &[[f64; 3]], ms: usize) -> (f64, f64) {
    let first = places.iter().position(|place| apart(place, &places[0]) > 0.002).unwrap();
    let last = places.iter().rposition(|place| apart(place, places.last().unwrap()) > 0.002).unwrap();
    ((first * ms) as f64, (last * ms) as f64)
}

#[test]
fn the_axes_go_as_grbls_firmware_moves_them() {
    let programs = [
        (SQUARE, include_str!("../protocol/motion/tests/firmware/square-steps.csv")),
        (CIRCLE, include_str!("../protocol/motion/tests/firmware/circle-steps.csv")),
    ];
    let mut panels = Vec::new();
    for (program, csv) in programs {
        let (theirs, ours) = (recorded(csv), gone(program));
        let (their_way, our_way) = (moves(&theirs, 10), moves(&ours, 1));
        let [their_time, our_time] = [their_way, our_way].map(|(first, last)| last - first);
        assert!((our_time / their_time - 1.0).abs() < 0.01, "{our_time} ms and {their_time} ms");
        // The board needs 300 ms to its banner, which the recording has not.
        let late = our_way.0 - their_way.0;
        let at = |n: usize, shift: f64| ((n as f64 * 10.0 + late + shift).max(0.0) as usize).min(ours.len() - 1);
        let worst = |shift: f64| {
            let apart = |n: usize| apart(&theirs[n], &ours[at(n, shift)]);
            (0..theirs.len()).map(apart).fold(0.0, f64::max)
        };
        let shifts = (-20..=20).map(f64::from);
        let (best, shift) = shifts.map(|ms| (worst(ms), ms)).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
        assert!(best < 0.05, "{best} mm apart");
        let seconds = |n: usize| n as f64 / 100.0;
        let course = |axis: usize, of: &dyn Fn(usize) -> [f64; 3]| {
            (0..theirs.len()).map(|n| (seconds(n), of(n)[axis])).collect()
        };
        let series = |axis: usize, name: &str| {
            let firmware = Series::new(format!("{name}, the firmware"), Style::Dots, course(axis, &|n| theirs[n]));
            [firmware, Series::new(format!("{name}, the engraver"), Style::Line, course(axis, &|n| ours[at(n, shift)]))]
        };
        let places = [series(0, "x"), series(1, "y")].concat();
        let panel = |y: &str, height, series| Panel { x: "t, s".to_owned(), y: y.to_owned(), height, series };
        panels.push(panel("place, mm", 0.8, places));
        let off = (0..theirs.len()).map(|n| (seconds(n), 1e3 * apart(&theirs[n], &ours[at(n, shift)])));
        panels.push(panel("apart, um", 0.4, vec![Series::new("", Style::Line, off.collect())]));
    }
    let title = "A square and two circles: GRBL 1.1h on an ATmega328P, and the engraver".to_owned();
    let drawn = Figure { title, panels }.encode(Format::Svg, &Colours::default()).unwrap();
    let shown = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/engraver-firmware.svg");
    if std::fs::read(shown).ok().as_ref() != Some(&drawn) {
        let path = std::env::temp_dir().join("engraver-firmware.svg");
        std::fs::write(&path, drawn).unwrap();
        panic!("{shown} is not what is drawn, which is in {}", path.display());
    }
}

#[test]
fn a_picture_is_drawn_of_axes_and_refused_without() {
    let folder = folder();
    let picture = folder.path().join("way.svg");
    let picture = picture.to_str().unwrap();
    let program = written(folder.path(), "G1 Z-1 F300\nX5 Y5\nZ1\nM2\n");
    assert!(output(&["run", "engraver", &program, "--path", picture]).status.success());
    let text = std::fs::read_to_string(picture).unwrap();
    assert!(["asked", "gone", "in the air", "x, mm", "t, s"].iter().all(|word| text.contains(word)));
    let refused = output(&["run", "lathe", "--path", picture]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("expected a rig such as 'engraver'"));
}

#[test]
fn loops_are_compared_and_the_open_one_does_not_see_what_it_has_lost() {
    let folder = folder();
    let picture = folder.path().join("loops.svg");
    let faults = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/tough-spots.toml");
    let page = folder.path().join("loops.html");
    let files = ["--plot", picture.to_str().unwrap(), "--report", page.to_str().unwrap()];
    let options = [&["--faults", faults, "--json"], &files[..]].concat();
    let compared = json(&output(&[&["engraver", "compare"], &options[..]].concat()));
    let loops = compared["loops"].as_array().unwrap();
    let of = |name: &str, field: &str| {
        let row = loops.iter().find(|row| row["name"] == name).unwrap();
        row[field].as_f64().unwrap()
    };
    assert_eq!(loops.len(), 5);
    assert!((of("open", "final_mm") - 0.3).abs() < 0.005 && of("open", "corrections") == 0.0);
    for name in ["fixed 1 ms", "fixed 10 ms", "fixed 50 ms", "dynamic"] {
        assert!(of(name, "final_mm") < 0.01 && of(name, "corrections") > 0.0, "{name}");
    }
    // No loop stops again and again for an error that is gone when it looks.
    for name in ["fixed 1 ms", "fixed 10 ms", "dynamic"] {
        assert!(of(name, "time_s") < 1.02 * of("open", "time_s"), "{name}: {}", of(name, "time_s"));
    }
    // 120 MHz, 200 cycles; a fixed loop looks at all four axes all the time.
    assert!((of("fixed 1 ms", "cpu_percent") - 100.0 * 4.0 * 200.0 / 120e3).abs() < 0.01);
    assert!(of("dynamic", "cpu_percent") < of("fixed 1 ms", "cpu_percent") && of("open", "cpu_percent") == 0.0);
    assert!(of("dynamic", "worst_mm") < 0.03 && of("fixed 50 ms", "worst_mm") > 0.1);
    let drawn = std::fs::read_to_string(&picture).unwrap();
    let page = std::fs::read_to_string(&page).unwrap();
    assert!(drawn.contains("pauses") && drawn.contains("slips, more than"));
    assert!(drawn.contains("times as much") && page.contains(&drawn) && page.contains("<td>fixed 50 ms<td"));
    for (arguments, expected) in [
        (["--rig", "lathe"], "expected one such as 'engraver'"),
        (["--set", "engraver.loop.mode=open"], "each row has a mode and a period of its own"),
        (["--set", "engraver.loop.period_ms=5"], "each row has a mode and a period of its own"),
    ] {
        let refused = output(&[&["engraver", "compare"], &arguments[..]].concat());
        assert_eq!(refused.status.code(), Some(2));
        assert!(String::from_utf8_lossy(&refused.stderr).contains(expected), "{arguments:?}");
    }
}

#[test]
fn a_preset_is_common_to_all_loops_and_leaves_each_its_mode() {
    let folder = folder();
    let program = written(folder.path(), "G21 G91\nG1 X10 F300\nM2\n");
    let compared = json(&output(&["engraver", "compare", &program, "--json", "--set", "engraver.preset=paper"]));
    let corrections: Vec<_> =
        compared["loops"].as_array().unwrap().iter().map(|row| row["corrections"].as_u64().unwrap()).collect();
    // The paper's scale takes 10 mm for 0.12 mm less.
    assert!(corrections[0] == 0 && corrections[1..].iter().all(|some| *some > 0), "{corrections:?}");
}
