//! `torno run lathe-grbl`: the sender in the rig, what it shows on the way, and the part that comes of it.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::common::{folder, json, output, torno};
use crate::send::on_a_terminal;

/// What comes of a program on the rig with the controller.
fn run(program: &Path, more: &[&str]) -> (Value, String) {
    let arguments = ["run", "lathe-grbl", program.to_str().unwrap(), "--in-process", "--json"];
    let output = output(&[&arguments, more].concat());
    (json(&output), String::from_utf8(output.stderr).unwrap())
}

/// The readout is for those who watch: nothing of it is part of what happens.
#[test]
fn a_terminal_shows_line_state_and_place_and_the_run_is_the_same() {
    let run = ["run", "lathe-grbl", "--in-process", "--json"];
    let (output, shown) = on_a_terminal(torno(&[&run[..], &["--pace", "100"]].concat()));
    for expected in [" of 39 ", " Run, X ", " Z -", " s virtual, "] {
        assert!(shown.contains(expected), "{expected:?} in {shown:?}");
    }
    let unseen = torno(&run).output().unwrap();
    assert_eq!(json(&output)["digest"], json(&unseen)["digest"]);
    let told = String::from_utf8(unseen.stderr).unwrap();
    assert_eq!(told, "before the program, to say where the tool stands: G10 L20 P1 X14.3556 Z0.0000\n");
}

#[test]
fn a_program_may_call_the_start_what_it_likes() {
    let folder = folder();
    let program = folder.path().join("there.nc");
    fs::write(&program, "G18\nG0 X20 Z-3\n").unwrap();
    let gone = |at: &[&str]| {
        let (summary, told) = run(&program, at);
        let gone = ["depth", "transverse"].map(|board| summary["boards"][board]["position_counts"].as_i64().unwrap());
        (gone, told)
    };
    let (gone_from, told) = gone(&["--at", "20,-3"]);
    assert_eq!(gone_from, [0, 0]);
    assert!(told.ends_with(": G10 L20 P1 X20.0000 Z-3.0000\n"), "{told}");
    assert_eq!(gone(&["--at", "19.6444,-4"]).0, [2, 450]);
    // A plan that is made before does the same.
    let program = program.to_str().unwrap();
    let planned = json(&output(&["run", "lathe", program, "--at", "19.6444,-4", "--in-process", "--json"]));
    assert_eq!(planned["boards"]["transverse"]["position_counts"], 450);
    let refused = output(&["run", "lathe", "--at", "20,5"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--at: frames say nothing of places"));
}

/// Radii at each hundredth of a millimetre along the part.
fn profile(rig: &str, folder: &Path) -> Vec<f64> {
    let shaft = format!("{}/builtin/shaft.nc", env!("CARGO_MANIFEST_DIR"));
    let csv = folder.join(rig);
    let run = output(&["run", rig, &shaft, "--in-process", "--profile", csv.to_str().unwrap()]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let text = fs::read_to_string(csv).unwrap();
    text.lines().skip(1).map(|line| line.split(',').nth(1).unwrap().parse().unwrap()).collect()
}

/// Radii are the same to 2 um, and shoulders stand within 0.03 mm: the controller cuts a long motion into frames, and
/// the carriage overshoots a short one by some counts.
#[test]
fn the_same_lines_turn_the_same_part_with_the_controller_and_planned() {
    let folder = folder();
    let [through, planned] = ["lathe-grbl", "lathe"].map(|rig| profile(rig, folder.path()));
    assert_eq!(through.len(), planned.len());
    for (n, radius) in through.iter().enumerate() {
        let near = &planned[n.saturating_sub(3)..(n + 4).min(planned.len())];
        let least = near.iter().copied().fold(f64::INFINITY, f64::min);
        let most = near.iter().copied().fold(0.0, f64::max);
        assert!((least - 0.002..=most + 0.002).contains(radius), "{radius} at {n}: {near:?}");
    }
}

/// Whatever breaks on the way: with processes, without, and when it is repeated.
#[test]
fn a_scenario_of_the_controller_is_the_same_wherever_its_boards_run() {
    for name in ["stall-in-mid-job", "slave-dies-in-mid-job", "noise-before-the-master", "reset-in-mid-frame"] {
        let folder = folder();
        let scenario = format!("{}/../tests/scenarios/grbl-{name}.toml", env!("CARGO_MANIFEST_DIR"));
        let traces = ["--in-process", "--processes"].map(|placement| {
            let trace = folder.path().join(placement).display().to_string();
            let tested = output(&["test", &scenario, placement, "--record", &trace]);
            assert!(tested.status.success(), "{name} {placement}: {}", String::from_utf8_lossy(&tested.stdout));
            trace
        });
        let same = output(&["diff", &traces[0], &traces[1]]);
        assert!(same.status.success(), "{name}: {}", String::from_utf8_lossy(&same.stdout));
        for trace in &traces {
            let repeated = output(&["replay", trace]);
            assert!(repeated.status.success(), "{name}: {}", String::from_utf8_lossy(&repeated.stderr));
        }
    }
}
