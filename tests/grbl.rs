//! A rig with a GRBL controller from outside: clients that know nothing of torno.

#![allow(clippy::disallowed_methods, reason = "the banner is measured by the wall clock")]

use std::time::{Duration, Instant};

use serde_json::Value;

use crate::common::{Pc, Up, folder, json, kill, output};
use crate::pc_port::pyserial;

/// A sender that waits for each answer, with holds and resets on the way.
#[test]
fn pyserial_finds_a_grbl_that_moves_a_machine() {
    // Slow enough to be seen in motion.
    let up = Up::start(&["lathe-grbl", "--pace", "20"]);
    let script = r"
import serial, sys, re
port = serial.Serial(sys.argv[1], 115200, timeout=20)

def line():
    text = port.readline()
    assert text, 'silence'
    return text.decode().strip()

def until(*ends):
    lines = [line()]
    while not any(lines[-1].startswith(end) for end in ends):
        lines.append(line())
    return lines

def ask(text):
    port.write(text.encode() + b'\n')
    return until('ok', 'error:', 'ALARM:')

def status():
    port.write(b'?')
    return until('<')[-1]

def wait_for(state):
    while not status().startswith('<' + state):
        pass

# Whoever opens the port restarts the controller.
assert until('Grbl 1.1h')[-1] == 'Grbl 1.1h [\'$\' for help]'
assert ask('$I')[0].startswith('[VER:1.1')
settings = dict(text.split('=') for text in ask('$$')[:-1])
assert settings['$100'] == '5.625' and settings['$102'] == '450.000' and settings['$30'] == '4000', settings
assert ask('$G')[0] == '[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]'
assert ask('G10 L20 P1 X14.3556 Z0') == ['ok']
assert ask('G1 Y1 F100') == ['error:33']
assert ask('M4 S500') == ['error:20']
for block in ['G18 M3 S600', 'G0 X13 Z1', 'G1 Z-5 F200', 'G0 X15', 'G0 Z0']:
    assert ask(block) == ['ok'], block
seen = set()
while True:
    text = status()
    seen.add(text[1:].split('|')[0])
    if text.startswith('<Idle'):
        break
assert 'Run' in seen, seen
x, y, z = re.search(r'MPos:([^|]*)', text).group(1).split(',')
assert z == '0.000' and y == '0.000' and abs(float(x) - 0.6444) < 0.1, text
# A hold, and on.
assert ask('G1 Z-10 F100') == ['ok']
port.write(b'!')
wait_for('Hold:0')
port.write(b'~')
wait_for('Idle')
# A reset in motion.
assert ask('G1 Z0 F20') == ['ok']
port.write(b'\x18')
assert until('[MSG:')[0] == 'ALARM:3'
assert ask('G0 X0') == ['error:9']
assert ask('$X') == ['[MSG:Caution: Unlocked]', 'ok']
";
    if pyserial(&up, script) {
        assert!(up.log().contains("master: frame 1 distributed"), "{}", up.log());
    }
}

/// The shaft as lines for the controller, and as frames that were planned from G-code.
#[test]
fn a_program_through_the_controller_turns_the_part_that_its_plan_turns() {
    let folder = folder();
    let trace = folder.path().join("run.torno");
    let shaft = |file: &str| format!("{}/builtin/{file}", env!("CARGO_MANIFEST_DIR"));
    let through = json(&output(&["run", "lathe-grbl", "--in-process", "--json", "--record", trace.to_str().unwrap()]));
    let planned = json(&output(&["run", "lathe", &shaft("shaft.ngc"), "--in-process", "--json"]));
    let diameters = |summary: &Value| {
        let cylinders = summary["part"]["cylinders"].as_array().unwrap().clone();
        cylinders.iter().map(|cylinder| (cylinder["diameter_mm"].as_f64().unwrap() * 100.0).round()).collect::<Vec<_>>()
    };
    assert_eq!(diameters(&through), diameters(&planned));
    assert_eq!(diameters(&through), [2246.0, 2430.0, 2678.0, 2800.0]);
    assert_eq!(through["lines"]["accepted"], through["lines"]["total"]);
    let processes = json(&output(&["run", "lathe-grbl", "--processes", "--json"]));
    assert_eq!(through["digest"], processes["digest"]);
    let replayed = output(&["replay", trace.to_str().unwrap()]);
    assert!(replayed.status.success(), "{}", String::from_utf8_lossy(&replayed.stderr));
}

/// Whatever screw the carriage has, the controller knows it from the rig.
#[test]
fn the_controller_knows_the_axes_of_its_rig() {
    let lengths = |set: &[&str]| {
        let arguments = [&["run", "lathe-grbl", "--in-process", "--json"][..], set].concat();
        let summary = json(&output(&arguments));
        let cylinders = summary["part"]["cylinders"].as_array().unwrap().clone();
        cylinders.iter().map(|cylinder| (cylinder["length_mm"].as_f64().unwrap() * 10.0).round()).collect::<Vec<_>>()
    };
    assert_eq!(lengths(&["--set", "transverse.plant.pitch_mm=1"]), lengths(&[]));
}

#[test]
fn lines_that_are_refused_are_told_with_their_numbers() {
    let folder = folder();
    let program = folder.path().join("bad.nc");
    std::fs::write(&program, "G18\nG5\nG1 Z-1 F100\nG1 Y1\n").unwrap();
    let output = crate::common::output(&["run", "lathe-grbl", program.to_str().unwrap(), "--in-process", "--json"]);
    assert_eq!(output.status.code(), Some(1));
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["outcome"], "rejected");
    assert_eq!(summary["lines"]["refusals"], serde_json::json!(["error:20 in line 2", "error:33 in line 4"]));
}

/// Everything up to the end of a line with this beginning.
fn read_line(pc: &mut Pc, beginning: &str) -> String {
    loop {
        let mut line = Vec::new();
        while line.last() != Some(&b'\n') {
            line.extend(pc.read(1));
        }
        let line = String::from_utf8(line).unwrap();
        if line.starts_with(beginning) {
            return line;
        }
    }
}

/// Whoever opens the port has that long to flush it, however fast time passes.
#[test]
fn the_banner_comes_300_ms_after_the_opening_at_every_pace_and_a_replay_resets_as_well() {
    for pace in ["1", "max"] {
        let folder = folder();
        let trace = folder.path().join("a.torno");
        let mut up = Up::start(&["lathe-grbl", "--pace", pace, "--record", trace.to_str().unwrap()]);
        let mut stored = "";
        for text in ["FIRST", "SECOND", "THIRD"] {
            let start = Instant::now();
            let mut pc = Pc::open(&up.link(), 115_200);
            read_line(&mut pc, "Grbl 1.1h");
            assert!(start.elapsed() >= Duration::from_millis(300), "at pace {pace}: {:?}", start.elapsed());
            // It is a reset, and no new board.
            pc.write(b"$I\n");
            assert_eq!(read_line(&mut pc, "[VER:"), format!("[VER:1.1h.20190830:{stored}]\r\n"));
            read_line(&mut pc, "ok");
            pc.write(format!("$I={text}\n").as_bytes());
            read_line(&mut pc, "ok");
            stored = text;
            drop(pc);
        }
        kill("-INT", up.pid());
        assert!(up.child.wait().unwrap().success());
        let told = String::from_utf8(output(&["trace", trace.to_str().unwrap()]).stdout).unwrap();
        assert_eq!(told.matches("< is reset").count(), 3, "{told}");
        for driver in [&[][..], &["--processes"]] {
            let replayed = output(&[&["replay", trace.to_str().unwrap()], driver].concat());
            assert!(replayed.status.success(), "{}", String::from_utf8_lossy(&replayed.stderr));
        }
    }
}
