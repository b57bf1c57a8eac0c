//! `torno sweep`: tables over seeds and values, shards that make the whole, and the fewest faults that still fail.

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Output, Stdio};

use serde_json::Value;

use crate::common::{folder, kill, output, torno, wait_until_interruptible};

const NOISE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/sweeps/line-noise.toml");
const CLOCK: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/sweeps/clock-margin.toml");

const DEMONSTRATION: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/sweeps/demonstration.toml");

/// What a sweep prints, whether all passes or not.
fn text(arguments: &[&str]) -> String {
    let output = output(arguments);
    assert!(matches!(output.status.code(), Some(0 | 1)), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn the_table_has_a_row_for_each_combination_and_counts_every_seed() {
    let vary = ["--vary", "fault.noise.period=3 ms,1 s", "--vary", "board.depth.clock_ppm=-90000..0/2"];
    let csv = text(&[&["sweep", NOISE, "--seeds", "5", "--csv"][..], &vary].concat());
    let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    let verdicts = ["runs", "passed", "told", "untold", "inconclusive"];
    assert_eq!(rows[0], [&["fault.noise.period", "board.depth.clock_ppm"][..], &verdicts].concat());
    let cells: Vec<&[&str]> = rows[1..].iter().map(|row| &row[..3]).collect();
    let expected = [["3 ms", "-90000", "5"], ["3 ms", "0", "5"], ["1 s", "-90000", "5"], ["1 s", "0", "5"]];
    assert_eq!(cells, expected);
    // A clock that is 9 % slow never works, and the PC is told.
    assert!([1, 3].iter().all(|row| rows[*row][3..] == ["0", "5", "0", "0"]), "{csv}");
}

/// Retries can hide a line error from the verdict.
#[test]
fn line_errors_are_counted_if_that_is_asked_for_whatever_the_verdict() {
    let folder = folder();
    let sweep = ["sweep", CLOCK, "--line-errors", "--vary", "master.clock_ppm=0,-37000,-50000"];
    let csv = text(&[&sweep[..], &["--csv"]].concat());
    let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(rows[0].last(), Some(&"line errors"));
    let errors = |row: usize| rows[row][6].parse::<u64>().unwrap();
    assert_eq!((rows[1][2], errors(1)), ("1", 0), "{csv}");
    assert!(rows[2][2] == "1" && errors(2) > 0, "{csv}");
    assert!(rows[3][2] == "0" && errors(3) > errors(2), "{csv}");
    let files = shards(folder.path(), "errors", &sweep, 2);
    let whole = merged(&files.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(String::from_utf8(whole.stdout).unwrap(), csv);
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
    assert_eq!(csv.lines().collect::<Vec<_>>(), ["runs,passed,told,untold,inconclusive", "4,4,0,0,0"]);
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
        assert_eq!(merged.status.code(), Some(1), "{}", String::from_utf8_lossy(&merged.stderr));
        assert_eq!(String::from_utf8(merged.stdout).unwrap(), whole);
    }
    // More shards than runs: some have nothing to do.
    let files = shards(folder.path(), "few", &["sweep", DEMONSTRATION, "--seeds", "2"], 3);
    let merged = merged(&files.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(String::from_utf8(merged.stdout).unwrap(), "runs,passed,told,untold,inconclusive\n2,2,0,0,0\n");
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
        String::from_utf8(part.stdout)
            .unwrap()
            .starts_with("fault.noise.period,runs,passed,told,untold,inconclusive\n10 ms,1,")
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
        assert_eq!(rows[0][1..], ["0 %", "5", "5", "0", "0", "0"], "{csv}");
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

#[test]
fn a_merge_ends_as_the_whole_would() {
    let folder = folder();
    for (name, sweep, status) in [
        ("good", &["sweep", DEMONSTRATION, "--seeds", "3"][..], 0),
        ("varied", &["sweep", NOISE, "--seeds", "2", "--vary", "fault.noise.period=1 s"], 0),
        ("bad", &["sweep", NOISE, "--seeds", "2", "--vary", "fault.noise.period=3 ms,1 s"], 1),
        // In the second shard, nothing fails.
        ("half", &["sweep", CLOCK, "--vary", "depth.clock_ppm=-90000,0"], 1),
    ] {
        assert_eq!(output(sweep).status.code(), Some(status), "{name}");
        let files = shards(folder.path(), name, sweep, 2);
        let files: Vec<&str> = files.iter().map(String::as_str).collect();
        assert_eq!(merged(&files).status.code(), Some(status), "{name}");
    }
}

/// Starts a sweep that takes very long, and interrupts it when it has printed so many lines, or after a while. Gives
/// the exit status, standard output and standard error.
fn interrupted(more: &[&str], lines: usize) -> (Option<i32>, String, String) {
    let mut child = torno(&[&["sweep", NOISE, "--seeds", "1000000"], more].concat())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdout = BufReader::new(child.stdout.take().unwrap());
    let mut text = String::new();
    for _ in 0..lines {
        stdout.read_line(&mut text).unwrap();
    }
    if lines == 0 {
        wait_until_interruptible(u64::from(child.id()));
        std::thread::sleep(std::time::Duration::from_secs(1));
    }
    kill("-INT", u64::from(child.id()));
    stdout.read_to_string(&mut text).unwrap();
    let output = child.wait_with_output().unwrap();
    (output.status.code(), text, String::from_utf8(output.stderr).unwrap())
}

#[test]
fn json_comes_run_by_run_and_an_interrupt_gives_the_table_so_far() {
    let (code, out, err) = interrupted(&["--json"], 5);
    assert_eq!(code, Some(130), "{err}");
    let runs: Vec<Value> = out.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let numbers: Vec<u64> = runs.iter().map(|run| run["number"].as_u64().unwrap()).collect();
    assert_eq!(numbers, (0..runs.len() as u64).collect::<Vec<_>>());
    assert!(runs.len() >= 5 && runs.len() < 900_000, "{}", runs.len());
    let row: Vec<&str> = err.lines().nth(1).unwrap().split_whitespace().collect();
    assert_eq!((err.lines().next(), row[0]), (Some("runs  passed  told  untold"), &*runs.len().to_string()), "{err}");
    let told = format!("torno: interrupted: {} of 1000000 runs are done\n", runs.len());
    assert!(err.ends_with(&told), "{err}\n{told}");

    for form in [&[][..], &["--csv"]] {
        let (code, out, err) = interrupted(form, 0);
        assert_eq!(code, Some(130), "{err}");
        assert!(out.starts_with("runs") && out.lines().count() == 2, "{out}");
        assert!(err.contains("of 1000000 runs are done"), "{err}");
    }
}

#[test]
fn a_whole_sweep_has_its_table_beside_its_lines() {
    let output = output(&["sweep", DEMONSTRATION, "--seeds", "3", "--json"]);
    let table = "runs  passed  told  untold\n   3       3     0       0\n";
    assert_eq!(String::from_utf8_lossy(&output.stderr), table);
    assert_eq!(String::from_utf8(output.stdout).unwrap().lines().count(), 3);
}

#[test]
fn more_runs_than_one_command_does_are_refused() {
    let range = |line: &str| format!("line.{line}.noise=0..5%/1000");
    let lines = ["master_to_depth", "master_to_spindle", "depth_to_master"].map(range);
    let vary: Vec<&str> = lines.iter().flat_map(|vary| ["--vary", vary]).collect();
    for more in [&[][..], &["--shard", "7/999"]] {
        let output = output(&[&["sweep", NOISE], &vary[..], more].concat());
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!((output.status.code(), output.stdout.as_slice()), (Some(2), &b""[..]), "{error}");
        let expected = "make 1000000000 runs, and one command does at most 1000000: expected fewer, or --shard I/1000";
        assert!(error.contains(expected), "{error}");
    }
    let output = output(&["sweep", NOISE, "--seeds", &u64::MAX.to_string(), "--vary", &lines[0]]);
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn a_draw_whose_fault_has_not_fired_is_inconclusive() {
    let folder = folder();
    let path = folder.path().join("drawn.toml");
    let late = "\n[[fault]]\nname = \"late\"\nboard = \"pc\"\nkind = \"clock\"\nvalue = \"0 %\"\nat = \"0 s..30 s\"\n";
    let text = fs::read_to_string(CLOCK).unwrap().replacen("name = ", "end = \"20 s\"\nname = ", 1);
    fs::write(&path, text + late).unwrap();
    let path = path.to_str().unwrap();
    let run = output(&["sweep", path, "--seeds", "20", "--json"]);
    let lines = text_of(&run);
    let runs: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let count = |verdict: &str| runs.iter().filter(|run| run["verdict"] == verdict).count();
    let (passed, inconclusive) = (count("passed"), count("inconclusive"));
    assert!(passed > 0 && inconclusive > 0 && passed + inconclusive == 20, "{passed}, {inconclusive}");
    assert_eq!(run.status.code(), Some(0), "some have passed, and none has failed");
    let shown = text_of(&output(&["sweep", path, "--seeds", "20"]));
    let row: Vec<&str> = shown.lines().nth(1).unwrap().split_whitespace().collect();
    assert_eq!(row, ["20", &passed.to_string(), "0", "0", &inconclusive.to_string()], "{shown}");
    let seed = runs.iter().find(|run| run["verdict"] == "inconclusive").unwrap()["seed"].to_string();
    assert!(shown.contains(&format!("\nfirst inconclusive: seed {seed}, fault.late.at = ")), "{shown}");
    assert!(shown.contains("  came      it has not begun: all was over before "), "{shown}");
    assert_eq!(output(&["sweep", path, "--seed", &seed]).status.code(), Some(1), "nothing has passed");
}

/// As the page on scenarios says.
#[test]
fn of_a_thousand_faults_at_any_moment_none_fails_and_three_do_not_fire() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/scenarios/any-fault-at-any-moment.toml");
    let output = output(&["sweep", path, "--seeds", "1000", "--csv"]);
    assert_eq!(text_of(&output), "runs,passed,told,untold,inconclusive\n1000,997,0,0,3\n");
    assert_eq!(output.status.code(), Some(0));
}
