//! The engraver: four axes that go to and fro, 10 000 pulses a second each.

use std::fs;

use crate::common::folder;
use crate::{run, spread};

/// So often to and fro.
const TIMES: usize = 200;
/// One way takes so long, s, about.
const WAY_S: f64 = 2.2;

/// A kind of run: its name, and its arguments.
type Kind<'a> = (&'a str, Vec<&'a str>);

/// Virtual over wall time of whole commands, one of each in turn.
pub(crate) fn shuttle(n: usize) {
    let folder = folder();
    let write = |name: &str, text: String| {
        let path = folder.path().join(name);
        fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let there_and_back = "G0X50Y50Z50A600\nG0X-50Y-50Z-50A-600\n".repeat(TIMES);
    let program = write("shuttle.nc", format!("G21G91\nG0X-25Y-25Z-25\n{there_and_back}M2\n"));
    let shock = |n: usize| {
        format!(
            "[[fault]]\nname = \"shock {n}\"\nboard = \"engraver.x\"\nkind = \"load\"\nvalue = \"150 %\"\n\
             at = \"{}.5 s\"\nfor = \"30 ms\"\n",
            n + 3
        )
    };
    let seconds = (2.0 * WAY_S * TIMES as f64) as usize - 5;
    let shocks = write("shocks.toml", (0..seconds).map(shock).collect());
    let fast =
        ["engraver", &program, "--set", "engraver.a.degrees_per_s=300", "--set", "engraver.a.degrees_per_s2=2400"];
    let open = ["--set", "engraver.loop.mode=open"];
    let shocked = ["--faults", &shocks];
    let rigid = ["--in-process", "--set", "engraver.motor.rotor_hz=0"];
    let fine = ["--set", "engraver.drive.pulses_per_rev=20000"];
    let of = |more: &[&'static str]| -> Vec<&str> { more.to_vec() };
    let kinds: [Kind<'_>; 9] = [
        ("processes", of(&[])),
        ("in process", of(&["--in-process"])),
        ("in process, ten times the microsteps", [&["--in-process"], &fine[..]].concat()),
        ("in process, rotors do not swing", rigid.to_vec()),
        ("the same, a shock a second", [&rigid[..], &shocked[..]].concat()),
        ("in process, open loop", [&["--in-process"], &open[..]].concat()),
        ("in process, a shock a second", [&["--in-process"], &shocked[..]].concat()),
        ("in process, open, a shock a second", [&["--in-process"], &open[..], &shocked[..]].concat()),
        ("processes, a shock a second", shocked.to_vec()),
    ];
    let mut walls = kinds.each_ref().map(|_| Vec::new());
    let mut virtual_s = [0.0; 9];
    for _ in 0..n {
        for (kind, (_, arguments)) in kinds.iter().enumerate() {
            let (wall, summary) = run(&[&fast[..], arguments].concat());
            walls[kind].push(wall);
            virtual_s[kind] = summary["virtual_s"].as_f64().unwrap();
        }
    }
    println!("{:<38} {:>8}  found", "the engraver, 4 axes at 10 kHz", "");
    for (((name, _), walls), virtual_s) in kinds.iter().zip(walls).zip(virtual_s) {
        let (min, median, max) = spread(walls);
        println!(
            "{name:<38} {:>7.0}x  {virtual_s:.0} s in {median:.1} ms ({min:.1} to {max:.1}, {n} runs)",
            virtual_s * 1e3 / median
        );
    }
}
