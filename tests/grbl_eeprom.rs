//! The EEPROM of the GRBL controller in a file: from one session to the next.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use crate::common::{Pc, Up, folder, json, kill, output};

/// What the port says to a line, up to its answer.
fn says(pc: &mut Pc, line: &str) -> String {
    pc.write(format!("{line}\n").as_bytes());
    until(pc, "ok\r\n")
}

/// Everything up to this end.
fn until(pc: &mut Pc, end: &str) -> String {
    let mut text = String::new();
    while !text.ends_with(end) {
        text.extend(pc.read(1).iter().map(|byte| char::from(*byte)));
    }
    text
}

fn run(file: &Path, program: &Path, more: &[&str]) -> serde_json::Value {
    let run = ["run", "lathe-grbl", program.to_str().unwrap(), "--json", "--eeprom", file.to_str().unwrap()];
    json(&output(&[&run, more].concat()))
}

#[test]
fn what_a_run_stores_the_next_one_starts_with_and_a_recording_needs_no_file() {
    let folder = folder();
    let [file, program, trace] = ["eeprom", "a.nc", "a.torno"].map(|name| folder.path().join(name));
    fs::write(&program, "G18\nG10 L2 P2 Z-0.5\nG28.1\n").unwrap();
    run(&file, &program, &["--processes"]);
    let stored = "[G54:-14.355599,0,0]\n[G55:0,0,-0.5]\n";
    assert_eq!(fs::read_to_string(&file).unwrap(), stored);
    assert_eq!(fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o600);

    // The next run goes to where the first one has put the origin.
    fs::write(&program, "G18\nG55\nG0 Z0\n").unwrap();
    let gone = |summary: &serde_json::Value| summary["boards"]["transverse"]["position_counts"].as_i64().unwrap();
    let second = run(&file, &program, &["--in-process", "--record", trace.to_str().unwrap()]);
    assert_eq!(gone(&second), -225);
    assert_eq!(fs::read_to_string(&file).unwrap(), stored);
    fs::remove_file(&file).unwrap();
    let replayed = output(&["replay", trace.to_str().unwrap()]);
    assert!(replayed.status.success(), "{}", String::from_utf8_lossy(&replayed.stderr));
    assert_eq!(gone(&run(&file, &program, &["--in-process"])), 0, "without the file nothing is known of it");
}

#[test]
fn a_controller_at_the_port_keeps_its_eeprom_until_the_rig_is_up_again() {
    let folder = folder();
    let file = folder.path().join("eeprom");
    let up = |placement: &str| Up::start(&["lathe-grbl", placement, "--eeprom", file.to_str().unwrap()]);
    for (placement, more) in [("--processes", ""), ("--in-process", ">G18:ok\r\n")] {
        let mut up = up(placement);
        let mut pc = Pc::open(&up.link(), 115_200);
        let banner = until(&mut pc, "help]\r\n");
        assert!(banner.ends_with("Grbl 1.1h ['$' for help]\r\n"), "{banner}");
        assert_eq!(until(&mut pc, more), more);
        for line in ["$N0=G18", "$110=12.5", "$I=BENCH"] {
            assert_eq!(says(&mut pc, line), "ok\r\n");
        }
        drop(pc);
        kill("-INT", up.pid());
        assert!(up.child.wait().unwrap().success(), "{}", up.log());
        assert_eq!(fs::read_to_string(&file).unwrap(), "$110=12.5\n$N0=G18\n$I=BENCH\n");
    }
    // A controller that has died says nothing any more.
    let mut up = up("--processes");
    kill("-KILL", up.board("grbl"));
    up.wait_for_log("died");
    kill("-INT", up.pid());
    assert_eq!(up.child.wait().unwrap().code(), Some(1));
    assert!(up.log().contains("board 'grbl' cannot say what it keeps"), "{}", up.log());
    assert_eq!(fs::read_to_string(&file).unwrap(), "$110=12.5\n$N0=G18\n$I=BENCH\n");
}

#[test]
fn a_line_that_no_eeprom_holds_is_told_with_its_place() {
    let folder = folder();
    let file = folder.path().join("eeprom");
    fs::write(&file, "$10=3\n[G54:1,2]\n").unwrap();
    for command in ["run", "up"] {
        let refused = output(&[command, "lathe-grbl", "--eeprom", file.to_str().unwrap()]);
        assert_eq!(refused.status.code(), Some(2));
        let told = String::from_utf8(refused.stderr).unwrap();
        assert_eq!(told, format!("torno: --eeprom: {}:2: '[G54:1,2]': expected 3 numbers\n", file.display()));
    }
    assert_eq!(fs::read_to_string(&file).unwrap(), "$10=3\n[G54:1,2]\n");
    let refused = output(&["run", "--eeprom", file.to_str().unwrap()]);
    assert_eq!(refused.status.code(), Some(2));
    let told = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(told, "torno: --eeprom: no board of the rig 'lathe' keeps anything without power\n");
}
