//! `torno sweep`: tables over seeds and values, shards that make the whole, and the fewest faults that still fail.

use std::fs;
use std::path::Path;
use std::process::Output;

use crate::common::{folder, output};

const NOISE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/sweeps/line-noise.toml");
const CLOCK: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/sweeps/clock-margin.toml");

const DEMONSTRATION: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/sweeps/demonstration.toml");

fn text(arguments: &[&str]) -> String {
    let output = output(arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn the_table_has_a_row_for_each_combination_and_counts_every_seed() {
    let vary = ["--vary", "fault.noise.period=3 ms,1 s", "--vary", "board.depth.clock_ppm=-90000..0/2"];
    let csv = text(&[&["sweep", NOISE, "--seeds", "5", "--csv"][..], &vary].concat());
    let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(rows[0], ["fault.noise.period", "board.depth.clock_ppm", "runs", "passed", "told", "untold"]);
    let cells: Vec<&[&str]> = rows[1..].iter().map(|row| &row[..3]).collect();
    let expected = [["3 ms", "-90000", "5"], ["3 ms", "0", "5"], ["1 s", "-90000", "5"], ["1 s", "0", "5"]];
    assert_eq!(cells, expected);
    // A clock that is 9 % slow never works, and the PC is told.
    assert!([1, 3].iter().all(|row| rows[*row][3..] == ["0", "5", "0"]), "{csv}");
}

#[test]
fn the_demonstration_can_be_swept() {
    let frames = |text: &str| -> Vec<String> {
        let lines = text.lines().map(|line| line.split('#').next().unwrap().trim().trim_matches([',', '"']));
        lines.filter(|line| line.len() == 23).map(str::to_owned).collect()
    };
    let program = include_str!("../harness/builtin/shaft.frames");
    assert_eq!(frames(&fs::read_to_string(DEMONSTRATION).unwrap()), frames(program), "it is the same program");
    assert_eq!(frames(program).len(), 30);
    let csv = text(&["sweep", DEMONSTRATION, "--seeds", "4", "--csv"]);
    assert_eq!(csv.lines().collect::<Vec<_>>(), ["runs,passed,told,untold", "4,4,0,0"]);
}

/// The sweep's shards, each in a file of its own.
fn shards(folder: &Path, name: &str, sweep: &[&str], of: usize) -> Vec<String> {
    let shard = |part| {
        let runs = text(&[sweep, &["--json", "--shard", &format!("{part}/{of}")]].concat());
        let path = folder.join(format!("{name}{part}.jsonl"));
        fs::write(&path, runs).unwrap();
        path.to_str().unwrap().to_owned()
    };
    (1..=of).map(shard).collect()
}

fn merged(files: &[&str]) -> Output {
    output(&[&["sweep", "--merge", "--csv"], files].concat())
}

#[test]
fn shards_make_the_whole_on_any_number_of_processors() {
    let folder = folder();
    let sweep = ["sweep", NOISE, "--seeds", "7", "--vary", "fault.noise.width=10us..500us/3"];
    let whole = text(&[&sweep[..], &["--csv", "--jobs", "1"]].concat());
    let files = shards(folder.path(), "", &sweep, 3);
    assert!(files.iter().all(|file| fs::read_to_string(file).unwrap().lines().count() == 7));
    // In whatever order: the table is that of the whole.
    for order in [[0, 1, 2], [2, 0, 1]] {
        let merged = merged(&order.map(|n: usize| files[n].as_str()));
        assert!(merged.status.success(), "{}", String::from_utf8_lossy(&merged.stderr));
        assert_eq!(String::from_utf8(merged.stdout).unwrap(), whole);
    }
    // More shards than runs: some have nothing to do.
    let files = shards(folder.path(), "few", &["sweep", DEMONSTRATION, "--seeds", "2"], 3);
    let merged = merged(&files.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(String::from_utf8(merged.stdout).unwrap(), "runs,passed,told,untold\n2,2,0,0\n");
}

#[test]
fn only_the_shards_of_one_sweep_are_merged_and_each_once() {
    let folder = folder();
    let vary = "fault.noise.period=10 ms,1 s";
    let of = |name: &str, sweep: &[&str]| shards(folder.path(), name, &[&["sweep"], sweep].concat(), 2);
    let ours = of("ours", &[NOISE, "--seeds", "2", "--vary", vary]);
    let other_file = folder.path().join("other.toml");
    fs::write(&other_file, fs::read_to_string(NOISE).unwrap().replace("300", "301")).unwrap();
    let seeds = of("seeds", &[NOISE, "--seeds", "3", "--vary", vary]);
    let values = of("values", &[NOISE, "--seeds", "2", "--vary", "fault.noise.period=10 ms,2 s"]);
    let file = of("file", &[other_file.to_str().unwrap(), "--seeds", "2", "--vary", vary]);
    for (second, expected) in [
        (&seeds[1], "are of different sweeps: one has 2 seeds, the other 3"),
        (&values[1], "one varies 'fault.noise.period=10 ms,1 s', the other 'fault.noise.period=10 ms,2 s'"),
        (&file[1], "their scenarios or rigs are not the same"),
        (&ours[0], "ours1.jsonl:1 are the same run, number 0 (seed 0): expected each shard once"),
    ] {
        let refused = merged(&[&ours[0], second]);
        let error = String::from_utf8(refused.stderr).unwrap();
        assert_eq!((refused.status.code(), refused.stdout.as_slice()), (Some(2), &b""[..]), "{error}");
        assert!(error.contains(expected), "{error}\nlacks {expected}");
    }
    // What is there is shown.
    let part = merged(&[&ours[1]]);
    let error = String::from_utf8(part.stderr).unwrap();
    assert_eq!(part.status.code(), Some(2), "{error}");
    assert!(error.contains("2 of 4 runs are missing, the first is number 0"), "{error}");
    assert!(
        String::from_utf8(part.stdout).unwrap().starts_with("fault.noise.period,runs,passed,told,untold\n10 ms,1,")
    );
    let nothing = folder.path().join("nothing.jsonl");
    fs::write(&nothing, "").unwrap();
    let refused = merged(&[nothing.to_str().unwrap()]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8(refused.stderr).unwrap().contains("there is no run in what is given"));
}

#[test]
fn a_failure_names_the_fewest_faults_that_cause_it() {
    let folder = folder();
    let path = folder.path().join("three.toml");
    let harmless = "\n[[fault]]\nboard = \"depth\"\nkind = \"clock\"\nvalue = \"1 %\"\n";
    let fatal = "\n[[fault]]\nname = \"cable\"\nline = \"depth_to_master\"\nkind = \"cut\"\nat = \"10 ms\"\n";
    let slow = "\n[[fault]]\nboard = \"spindle\"\nkind = \"slow\"\nvalue = \"10 us\"\n";
    fs::write(&path, fs::read_to_string(CLOCK).unwrap() + harmless + fatal + slow).unwrap();
    let output = output(&["sweep", path.to_str().unwrap(), "--seeds", "2"]);
    assert_eq!(output.status.code(), Some(1), "without a variation it is a test");
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("first failure: seed 0, by cable\n"), "{text}");
    assert!(text.contains("came      ACK XOFF CAN d n"), "{text}");
    assert!(text.ends_with(&format!("\n  again     torno test '{}' --seed 0\n", path.display())), "{text}");

    let varied = |more: &[&str]| text_of(&crate::common::output(&[&["sweep", path.to_str().unwrap()], more].concat()));
    let text = varied(&["--seeds", "2", "--vary", "fault.cable.at=10 ms,20 ms"]);
    let again = format!("torno sweep '{}' --seed 0 --vary 'fault.cable.at=10 ms'", path.display());
    assert!(text.ends_with(&format!("\n  again     {again}\n")), "{text}");
    let text = varied(&["--seed", "0", "--vary", "fault.cable.at=10 ms"]);
    assert!(text.contains("first failure: fault.cable.at = 10 ms, seed 0"), "{text}");
}

fn text_of(output: &std::process::Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

#[test]
fn the_noise_on_any_line_can_be_varied() {
    let csv = |vary: &str| text(&["sweep", NOISE, "--seeds", "5", "--csv", "--vary", vary]);
    let rows = |csv: &str| csv.lines().skip(1).map(str::to_owned).collect::<Vec<_>>();
    let of_fault = rows(&csv("fault.noise.value=0..5%/3"));
    assert_eq!(of_fault, rows(&csv("line.master_to_transverse.noise=0..5%/3")), "it is the same");
    // Pulses of up to 100 us: 50 us in 1 ms.
    assert_eq!(of_fault[2].replace("5 %", "950 us"), rows(&csv("fault.noise.period=950 us"))[0]);
    // One that the scenario has is set; another one comes to be, and goes when the last step is done.
    for line in ["master_to_transverse", "transverse_to_master"] {
        let vary = format!("line.{line}.noise=0..5%/2");
        let csv =
            text(&["sweep", NOISE, "--seeds", "5", "--csv", "--vary", "fault.noise.period=1000 s", "--vary", &vary]);
        let rows: Vec<Vec<&str>> = csv.lines().skip(1).map(|line| line.split(',').collect()).collect();
        assert_eq!(rows[0][1..], ["0 %", "5", "5", "0", "0"], "{csv}");
        assert_eq!(rows[1][1..3], ["5 %", "5"], "{csv}");
        assert_ne!(rows[1][3], "5", "{csv}");
        let all = text(&["sweep", NOISE, "--seeds", "5", "--vary", "fault.noise.period=1000 s", "--vary", &vary]);
        let noise = if line == "master_to_transverse" { "noise" } else { "transverse_to_master noise" };
        assert!(all.contains("noise = 5 %, seed ") && all.contains(&format!(", by {noise}\n")), "{all}");
    }
}

#[test]
fn what_cannot_be_varied_is_said_with_what_could_be_meant() {
    for (vary, expected) in [
        ("fault.nose.period=1 s", "there is no fault 'nose': did you mean 'noise'?"),
        ("board.spindel.clock_ppm=1", "there is no board 'spindel': did you mean 'spindle'?"),
        ("bord.spindle.clock_ppm=1", "there is no board 'bord': did you mean 'board'?"),
        ("fault.noise.period=1 s..2 %", "FROM and TO have different units"),
        ("fault.noise.period=1 s..2 ms", "FROM is above TO"),
        ("line.master_to_dept.noise=0..5%", "there is no line 'master_to_dept': did you mean 'master_to_depth'?"),
        ("line.master_to_depth.nose=0..5%", "there is no fault 'nose' of a line: did you mean 'noise'?"),
        ("line.master_to_depth=0..5%", "expected line.LINE.KIND"),
        (
            "line.master_to_depth.noise=60..80%/2",
            "--vary 'line.master_to_depth.noise = 60 %': '60 %': expected the share",
        ),
        ("fault.noise.period", "there is no '='"),
        ("fault.noise.period=7", "invalid type: integer `7`"),
        ("board.depth.clock_ppm=1e6", "expected -200000 to 200000"),
        (
            "depth.plant.rpn=8",
            "--vary 'depth.plant.rpn': settings of this depth: unknown field `rpn`: did you mean 'rpm'?",
        ),
    ] {
        let output = output(&["sweep", NOISE, "--vary", vary]);
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{vary}: {error}");
        assert!(error.contains(expected), "{vary}: {error}\nlacks {expected}");
    }
}
