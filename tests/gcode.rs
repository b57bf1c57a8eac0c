//! `torno gcode`: what it prints, and its exit status.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use torno_gcode::Motion;

use crate::common::{boring, folder, json, output, torno};

const PROGRAMS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../protocol/gcode/tests/programs");

fn write(folder: &Path, text: &str) -> String {
    let path: PathBuf = folder.join("part.ngc");
    fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

fn out(arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = output(arguments);
    let [out, err] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    (output.status.code(), out, err)
}

#[test]
fn a_program_is_checked() {
    let shaft = format!("{PROGRAMS}/shaft.ngc");
    let (code, out_text, err) = out(&["gcode", "check", &shaft]);
    assert_eq!((code, err.as_str()), (Some(0), ""), "{out_text}");
    assert!(out_text.starts_with(&format!("{shaft} is understood: dialect linuxcnc, ")), "{out_text}");
    let result = json(&output(&["gcode", "check", &shaft, "--json"]));
    assert_eq!((&result["refused"], &result["dialect"]), (&false.into(), &"linuxcnc".into()), "{result}");
}

#[test]
fn errors_have_their_place_and_nothing_is_printed_of_a_program_that_is_refused() {
    let folder = folder();
    let path = write(folder.path(), "G21 G18\nG0 X[1/0]\nM131\nG41\nM2\n");
    let (code, text, _) = out(&["gcode", "check", &path]);
    assert_eq!(code, Some(2));
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[0], format!("{path}:2:7: division by zero"));
    assert_eq!(lines[1], format!("{path}:3:1: warning: M131 is not known: it has no effect"));
    assert!(lines[2].contains(":4:1: G41 is not supported yet"), "{text}");
    assert_eq!(lines[3], format!("{path} is refused (dialect linuxcnc)"));
    let (code, text, err) = out(&["gcode", "canon", &path]);
    assert_eq!((code, text.as_str()), (Some(2), ""));
    assert!(err.contains(":2:7: division by zero"), "{err}");
}

#[test]
fn canonical_motions_are_printed_one_a_line() {
    let folder = folder();
    let path = write(folder.path(), "G21 G18 G7\nT1 M6 M8\nG0 X20 Z1\nG1 Z-5 F60\nG3 X24 Z-7 K-2\nG4 P0.5\nM2\n");
    let (code, text, err) = out(&["gcode", "canon", &path]);
    assert_eq!((code, err.as_str()), (Some(0), ""));
    let expected = "{\"line\":1,\"kind\":\"plane\",\"plane\":\"xz\"}\n\
         {\"line\":3,\"kind\":\"rapid\",\"x\":10,\"y\":0,\"z\":1,\"a\":0}\n\
         {\"line\":4,\"kind\":\"feed\",\"x\":10,\"y\":0,\"z\":-5,\"a\":0,\"feed\":60}\n\
         {\"line\":5,\"kind\":\"arc\",\"x\":12,\"y\":0,\"z\":-7,\"a\":0,\
         \"cx\":10,\"cz\":-7,\"turn\":\"ccw\",\"feed\":60}\n\
         {\"line\":6,\"kind\":\"dwell\",\"seconds\":0.5}\n\
         {\"line\":7,\"kind\":\"end\"}\n";
    assert_eq!(text, expected);
    for line in text.lines() {
        assert_eq!(line.parse::<Motion>().unwrap().to_string(), line);
        assert!(serde_json::from_str::<serde_json::Value>(line).is_ok());
    }
    let (_, text, _) = out(&["gcode", "canon", &path, "--all"]);
    assert!(text.contains("\"tool\":1") && text.contains("\"flood\":1"), "{text}");
}

#[test]
fn a_dialect_is_guessed_or_chosen_and_input_may_come_through_a_pipe() {
    let folder = folder();
    let path = write(folder.path(), "O0001\nG98 G0 X20. Z1.\nG1 W-5. F60.\nM30\n");
    let (code, text, _) = out(&["gcode", "check", &path]);
    assert!(code == Some(0) && text.contains("dialect fanuc, 4 lines, 3 motions"), "{text}");
    assert_eq!(out(&["gcode", "check", &path, "--dialect", "linuxcnc"]).0, Some(2));
    let mut child =
        torno(&["gcode", "canon", "-", "--at", "5,-2"]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    child.stdin.take().unwrap().write_all(b"G91 G0 X1\nM2\n").unwrap();
    let output = child.wait_with_output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.starts_with("{\"line\":1,\"kind\":\"rapid\",\"x\":6,\"y\":0,\"z\":-2,\"a\":0}\n"), "{text}");
}

#[test]
fn what_is_no_program_is_refused() {
    let folder = folder();
    for (text, expected) in [
        ("", ":1:1: the file holds no G-code"),
        ("0A E1 00 E1 00 00 00 00\n", ":1:1: the file is a program of frames: expected G-code"),
        ("\0\0\u{1}", ":1:1: the file is binary: expected G-code"),
    ] {
        let path = write(folder.path(), text);
        let (code, text, _) = out(&["gcode", "check", &path]);
        assert!(code == Some(2) && text.contains(expected), "{text}");
    }
    let (code, _, err) = out(&["gcode", "check", "/no/such/file"]);
    assert!(code == Some(2) && err.contains("cannot read the program '/no/such/file'"), "{err}");
}

// --- what is asked, and what comes of it ----------------------------------------------------------------------------

/// A taper each way, and an arc of each quadrant.
const SHAPES: &str = "G21 G18 G7 G90 G94\nG97 S1500 M3\nG0 X27 Z0.5\nG1 Z-40 F300\nG0 X28.4\nG0 Z0.5\nG0 X24\nG1 Z0\n\
    G1 X26 Z-6\nG3 X26.6 Z-8 R4\nG1 Z-12\nG2 X25.4 Z-14 R4\nG1 X24.8 Z-18\nG3 X26 Z-21 R5\nG1 X27 Z-22\n\
    G1 X28.4\nG0 Z0.5\nM2\n";

/// A stepped bore with a taper and an arc.
const BORE: &str = "G21 G18 G7 G90 G94\nG97 S1500 M3\nG0 X10.6 Z0.5\nG1 Z-20 F200\nG0 X9.6\nG0 Z0.5\nG0 X12\nG1 Z0\n\
    G1 X11.4 Z-4\nG1 Z-8\nG3 X10.6 Z-10 R4\nG1 Z-20\nG1 X9.6\nG0 Z0.5\nM2\n";

#[test]
fn what_is_planned_is_turned_within_half_a_slot_of_what_is_asked() {
    let folder = folder();
    let bore = boring(folder.path());
    for (rig, program, turned) in [("lathe", SHAPES, "outside"), (&bore, BORE, "inside")] {
        let path = write(folder.path(), program);
        let told = output(&["run", rig, &path, "--in-process", "--json", "--tolerance", "0.19"]);
        let part = &json(&told)["part"];
        assert_eq!(
            (told.status.code(), &part["side"], &part["required"]["met"]),
            (Some(0), &turned.into(), &true.into())
        );
        let worst = part["worst"]["diameter_mm"].as_f64().unwrap().abs();
        assert!((0.1..0.19).contains(&worst), "{part}");
    }
}

#[test]
fn a_program_is_drawn_with_what_comes_of_it() {
    let folder = folder();
    let path = write(folder.path(), SHAPES);
    let (code, svg, err) = out(&["gcode", "plot", &path]);
    assert_eq!(code, Some(0), "{err}");
    for word in ["stock", "frames", "turned", "wanted", "rapid", "feed", "arc", "z, mm", "x, mm (radius)"] {
        assert!(svg.contains(&format!("\n{word}\n")), "{word}");
    }
    let (code, svg, _) = out(&["gcode", "plot", &path, "--asked"]);
    assert!(code == Some(0) && svg.contains("\nwanted\n") && !svg.contains("\nframes\n"));
    let png = folder.path().join("part.png");
    let (code, text, _) = out(&["gcode", "plot", &path, "-o", png.to_str().unwrap()]);
    assert_eq!((code, text.as_str()), (Some(0), ""));
    assert!(fs::read(png).unwrap().starts_with(b"\x89PNG"));
    // What cannot be planned is drawn as it is asked, if only that is wanted; what is not understood is not drawn.
    let crash = write(folder.path(), "G21 G18 G7 G90 G94\nM3 S1500\nG0 X20 Z-5\nG1 Z-6 F60\nM2\n");
    let (code, svg, err) = out(&["gcode", "plot", &crash]);
    assert!(code == Some(2) && svg.is_empty() && err.contains(":3:"), "{err}");
    assert_eq!(out(&["gcode", "plot", &crash, "--asked"]).0, Some(0));
    let wrong = write(folder.path(), "G21 G18\nG0 X[1/0]\nM2\n");
    let (code, svg, err) = out(&["gcode", "plot", &wrong]);
    assert!(code == Some(2) && svg.is_empty() && err.contains("division by zero"), "{err}");
    let (code, _, err) = out(&["gcode", "plot", &path, "--rig", "servo"]);
    assert!(code == Some(2) && err.contains("the rig 'servo' turns no part: expected a [part]"), "{err}");
}
