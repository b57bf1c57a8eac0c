//! `torno gcode plan`, and G-code that is run and sent.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::common::{Up, folder, json, output};

const BUILT_IN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/builtin");

fn write(folder: &Path, name: &str, text: &str) -> String {
    let path: PathBuf = folder.join(name);
    fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

fn result(arguments: &[&str]) -> (Option<i32>, Value) {
    let output = output(arguments);
    (output.status.code(), json(&output))
}

/// A run in this process, which gives the same as one in many.
fn run(arguments: &[&str]) -> Value {
    let (code, summary) = result(&[&["run", "--in-process", "--json"], arguments].concat());
    assert_eq!(code, Some(0), "{summary}");
    summary
}

#[test]
fn the_demonstration_as_g_code_turns_the_same_part() {
    let [frames, code] = ["shaft.frames", "shaft.ngc"].map(|name| run(&[&format!("{BUILT_IN}/{name}")]));
    assert_eq!(frames["part"]["cylinders"], code["part"]["cylinders"]);
    assert_eq!((&frames["frames"]["total"], &code["frames"]["total"]), (&30.into(), &31.into()));
    assert_eq!((&frames["part"]["events"], &code["part"]["events"]), (&Value::Array(vec![]), &Value::Array(vec![])));
    let time = |summary: &Value| summary["virtual_s"].as_f64().unwrap();
    assert!((time(&frames) - 124.503).abs() < 1e-3 && (time(&code) - 126.123).abs() < 1e-3, "{code}");
}

#[test]
fn a_run_of_the_g_code_and_of_its_frames_have_one_digest() {
    let folder = folder();
    let frames = folder.path().join("x.frames").to_str().unwrap().to_owned();
    for (rig, set) in
        [("lathe", "pc.baud=9600"), ("lathe", "transverse.plant.pitch_mm=1"), ("lathe-dspic", "pc.baud=9600")]
    {
        let text = "G21 G18 G7\nM3 S800\nG0 X27 Z1\nG1 Z-3 F90\nG3 X29 Z-4 K-1\nG0 X30 Z0\nM2\n";
        let code = write(folder.path(), "x.ngc", text);
        let options = ["--rig", rig, "--set", set];
        let (status, plan) = result(&[&["gcode", "plan", &code, "-o", &frames, "--json"], &options[..]].concat());
        assert_eq!((status, plan["refused"].as_array().map(Vec::len)), (Some(0), Some(0)), "{plan}");
        let [code, frames] = [&code, &frames].map(|program| run(&[rig, program, "--set", set]));
        assert_eq!(code["digest"], frames["digest"]);
        assert_eq!((&plan["frames"], &plan["time_s"]), (&frames["frames"]["total"], &frames["virtual_s"]));
    }
}

#[test]
fn the_predicted_time_is_that_of_the_run() {
    let folder = folder();
    let taper = "G21 G18 G7\nM3 S800\nG1 X26 F60\nG1 X28.4 Z-12\nG0 X30 Z0\nM2\n";
    let facing = "G21 G18 G7\nM3 S800\nG0 X29 Z0.5\nG1 Z-0.5 F60\nG1 X10\nG0 Z1\nG0 X29\nM2\n";
    let rough = "O1\nG98 G97 M3 S800\nG0 X29. Z0.5\nG71 U1. R0.5\nG71 P1 Q2 U0. W0. F100\nN1 G0 X24.\nG1 Z-4.\n\
                 N2 X29.\nG0 Z1.\nM30\n";
    for (name, text) in [("taper.ngc", taper), ("facing.nc", facing), ("rough.tap", rough)] {
        let path = write(folder.path(), name, text);
        let (code, plan) = result(&["gcode", "plan", &path, "--json"]);
        assert_eq!(code, Some(0), "{plan}");
        assert_eq!((&plan["time_s"], &plan["outcome"]), (&run(&[&path])["virtual_s"], &"completed".into()));
    }
}

#[test]
fn what_is_refused_starts_nothing_and_writes_nothing() {
    let folder = folder();
    let path = write(folder.path(), "x.ngc", "G21 G18 G8\nM4 S500\n(x) G0 X12\nG33 K1\nG1 Y1 F60\nM2\n");
    let frames = folder.path().join("x.frames");
    let out = output(&["gcode", "plan", &path, "-o", frames.to_str().unwrap()]);
    let text = String::from_utf8(out.stdout).unwrap();
    let expected = [
        "2:1: M4: the spindle turns in one sense only (M3)",
        "3:8: the rapid cuts the part at Z 0.000, X 13.595 (radius)",
        "4:1: G33 is not supported yet: threads",
        "5:4: the lathe has no axis Y",
    ];
    for expected in expected {
        assert!(text.contains(&format!("{path}:{expected}")), "{text}");
    }
    assert!(out.status.code() == Some(2) && text.ends_with(" is refused (dialect linuxcnc)\n"), "{text}");
    let trace = folder.path().join("x.torno");
    let link = folder.path().join("nowhere");
    for arguments in [
        &["run", &path, "--record", trace.to_str().unwrap()][..],
        &["send", &path, "--port", link.to_str().unwrap()][..],
        &["compare", "lathe", "lathe-dspic", &path][..],
    ] {
        let out = output(arguments);
        let text = String::from_utf8(out.stderr).unwrap();
        assert_eq!((out.status.code(), out.stdout.len()), (Some(2), 0), "{text}");
        assert!(text.contains(&format!("{path}:{}", expected[0])), "{text}");
    }
    assert!(!frames.exists() && !trace.exists());
    let checked = |options: &[&str]| {
        let (code, found) = result(&[&["gcode", "check", &path, "--json"], options].concat());
        assert_eq!((code, &found["refused"]), (Some(2), &true.into()), "{found}");
        found["findings"].as_array().unwrap().len()
    };
    assert_eq!((checked(&[]), checked(&["--rig", "lathe"])), (1, 4));
    let (code, plan) = result(&["gcode", "plan", &path, "--json"]);
    let lines: Vec<_> = plan["refused"].as_array().unwrap().iter().map(|error| error["line"].as_u64()).collect();
    assert_eq!((code, &plan["frames"], lines), (Some(2), &0.into(), vec![Some(2), Some(3), Some(4), Some(5)]));
}

#[test]
fn a_rapid_through_what_a_refused_line_would_have_cut_is_no_error() {
    let folder = folder();
    let path = write(folder.path(), "x.ngc", "G21 G18 G8\nM3 S500\nG1 X13 F60 P1 Q[1/0]\nG0 X13 Z-5\nG0 Y1\nM2\n");
    let (_, plan) = result(&["gcode", "plan", &path, "--json"]);
    let lines: Vec<_> = plan["refused"].as_array().unwrap().iter().map(|error| error["line"].as_u64()).collect();
    assert_eq!(lines, [Some(3), Some(5)], "{plan}");
}

#[test]
fn a_place_has_another_name_and_g28_goes_to_the_park() {
    let folder = folder();
    let path = write(folder.path(), "x.ngc", "G21 G18 G8\nG28\nG0 Z21\nM2\n");
    let end = |options: &[&str]| {
        let (code, plan) = result(&[&["gcode", "plan", &path, "--json"], options].concat());
        assert_eq!(code, Some(0), "{plan}");
        let place = |axis: &str| (plan["end"][axis].as_f64().unwrap() * 100.0).round() / 100.0;
        (place("x"), place("z"))
    };
    assert_eq!(end(&[]), (14.36, 21.0));
    assert_eq!(end(&["--at", "30,20"]), (30.0, 21.0));
    assert_eq!(end(&["--at", "30,20", "--park", "35,25"]), (35.08, 21.0));
}

#[test]
fn a_side_can_be_chosen() {
    let folder = folder();
    let path = write(folder.path(), "x.ngc", "G21 G18 G8\nM3 S500\nG1 X13 F60\nG1 X14 Z-20\nM2\n");
    let worst = |side: &str| {
        let (_, plan) = result(&["gcode", "plan", &path, "--json", "--side", side]);
        plan["worst_x_mm"].as_f64().unwrap()
    };
    let half = 8.0 / 90.0 + 1e-9;
    assert!(worst("middle") <= half, "{}", worst("middle"));
    assert!(worst("outside") > half && worst("outside") <= 2.0 * half, "{}", worst("outside"));
}

#[test]
fn shorter_retracts_save_time_and_turn_the_same_part() {
    let folder = folder();
    let text = "O1\nG98 G97 M3 S800\nG0 X30. Z0.5\nG90 X27. Z-4. F200\nX26.\nX25.\nM30\n";
    let path = write(folder.path(), "x.nc", text);
    let frames = folder.path().join("x.frames").to_str().unwrap().to_owned();
    let (code, plan) = result(&["gcode", "plan", &path, "--optimise", "-o", &frames, "--json"]);
    let time = |result: &Value, name: &str| result[name].as_f64().unwrap();
    let (whole, short) = (run(&[&path]), run(&[&frames]));
    assert_eq!((code, &plan["time_s"]), (Some(0), &short["virtual_s"]));
    let saved = time(&whole, "virtual_s") - time(&short, "virtual_s");
    assert!((time(&plan, "saved_s") - saved).abs() < 1e-6 && saved > 15.0, "{plan}");
    let diameter = |summary: &Value| time(&summary["part"]["cylinders"][0], "diameter_mm");
    // Between two polls of its board the slide goes 2.7 µm, before that sees an edge.
    assert!((diameter(&whole) - diameter(&short)).abs() < 0.006, "{whole} {short}");
    assert_eq!(short["part"]["events"], whole["part"]["events"]);
}

#[test]
fn what_is_planned_is_executed_to_its_end() {
    let folder = folder();
    // The ends of travel.
    let ends = "G21 G18 G8\nG0 X94.08 Z79.89\nG1 Z-79.89 F1000\nG1 Z79.89 F1000\nG0 X-65.37\nG0 X20\nM2\n";
    run(&[&write(folder.path(), "ends.ngc", ends)]);
    // Anything, not far from the start: what is refused is left out.
    let mut state = 7_u32;
    let mut any = |least: f64, most: f64| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        least + (most - least) * f64::from(state >> 8) / f64::from(1_u32 << 24)
    };
    let mut executed = 0;
    for nth in 0..30 {
        let mut text = "G21 G18 G8\nM3 S600\n".to_owned();
        for _ in 0..6 {
            let (x, z) = (any(13.0, 16.0), any(-3.0, 3.0));
            text += &match any(0.0, 4.0) as u32 {
                0 => format!("G0 X{x:.3} Z{z:.3}\n"),
                1 => format!("G3 X{x:.3} Z{z:.3} R{:.3} F{:.1}\n", any(6.0, 20.0), any(5.0, 500.0)),
                2 => format!("G96 S{:.0} D1500\n", any(20.0, 120.0)),
                _ => format!("G1 X{x:.3} Z{z:.3} F{:.1}\n", any(5.0, 900.0)),
            };
        }
        let path = write(folder.path(), &format!("{nth}.ngc"), &(text + "M2\n"));
        let (code, plan) = result(&["gcode", "plan", &path, "--json"]);
        assert!(code == Some(2) || plan["outcome"] == "completed", "{plan}");
        executed += usize::from(code == Some(0));
    }
    assert!(executed >= 5, "{executed}");
}

#[test]
fn g_code_is_sent() {
    let up = Up::start(&["--pace", "max"]);
    let (code, summary) = result(&[
        "send",
        &format!("{BUILT_IN}/shaft.ngc"),
        "--json",
        "--rig",
        "lathe",
        "--port",
        up.link().to_str().unwrap(),
    ]);
    assert_eq!((code, &summary["outcome"]), (Some(0), &"completed".into()), "{summary}");
    assert_eq!((&summary["frames"]["total"], &summary["frames"]["accepted"]), (&31.into(), &31.into()));
}
