//! What a rig costs, as far as it can be counted: that holds on any machine, and a clock need not be read.

use std::fs;

use crate::common::{folder, json, output, rig_of};
use serde_json::Value;

/// What `torno run --stats` tells, with what it costs at `stats`.
fn run(arguments: &[&str]) -> Value {
    let summary = json(&output(&[&["run", "--json", "--stats"], arguments].concat()));
    assert_eq!(summary["outcome"], "completed", "{summary}");
    summary
}

/// What is counted, and not measured.
fn counted(stats: &Value) -> Value {
    let mut counted = stats.clone();
    let shares = |shares: &mut Value| shares.as_object_mut().unwrap().remove("waiting_s").map(drop).unwrap();
    shares(&mut counted);
    shares(&mut counted["pc"]);
    counted["boards"].as_object_mut().unwrap().values_mut().for_each(shares);
    for measured in ["starting_s", "own_s"] {
        counted.as_object_mut().unwrap().remove(measured).unwrap();
    }
    counted
}

/// How many turns each had, and how many of them were redone.
fn turns(stats: &Value) -> Vec<(u64, u64)> {
    let boards = ["master", "spindle", "transverse", "depth"].map(|name| &stats["boards"][name]);
    let shares = [stats, &stats["pc"]].into_iter().chain(boards);
    shares.map(|shares| (shares["turns"].as_u64().unwrap(), shares["redone"].as_u64().unwrap())).collect()
}

#[test]
fn the_demonstration_takes_at_most_six_turns_of_boards_a_virtual_second() {
    let summary = run(&[]);
    let per_s = summary["stats"]["turns_per_virtual_s"].as_f64().unwrap();
    assert!(per_s <= 6.0, "{per_s}: {}", summary["stats"]);
    let sum: u64 = turns(&summary["stats"])[2..].iter().map(|(turns, _)| turns).sum();
    assert_eq!(summary["stats"]["turns"].as_u64(), Some(sum), "all boards, without the PC");
    let virtual_s = summary["virtual_s"].as_f64().unwrap();
    assert!((per_s - sum as f64 / virtual_s).abs() < 1e-9, "{summary}");
}

#[test]
fn what_is_counted_is_the_same_each_time_and_turns_are_the_same_without_processes() {
    let [processes, again] = [(); 2].map(|()| run(&[]));
    assert_eq!(counted(&processes["stats"]), counted(&again["stats"]));
    let in_process = run(&["--in-process"]);
    assert_eq!(turns(&processes["stats"]), turns(&in_process["stats"]));
    for board in ["master", "spindle", "transverse", "depth"] {
        for way in ["to_board", "from_board"] {
            let bytes = processes["stats"]["boards"][board]["bytes_per_turn"][way].as_f64().unwrap();
            // At least the length of a record, and what it is.
            assert!(bytes > 5.0, "{board} {way}: {bytes}");
        }
        assert!(in_process["stats"]["boards"][board].get("bytes_per_turn").is_none());
    }
    assert!(processes["stats"]["pc"].get("bytes_per_turn").is_none());
}

#[test]
fn asking_what_it_costs_changes_nothing_of_what_happens() {
    let plain = json(&output(&["run", "--json"]));
    assert!(plain.get("stats").is_none(), "{plain}");
    assert_eq!(run(&[])["digest"], plain["digest"]);
}

#[test]
fn wall_time_is_divided_into_starting_waiting_and_own_work() {
    let summary = run(&[]);
    let stats = &summary["stats"];
    let [starting, waiting, own] = ["starting_s", "waiting_s", "own_s"].map(|name| stats[name].as_f64().unwrap());
    assert!(starting > 0.0 && waiting > 0.0 && own > 0.0, "{stats}");
    assert!((starting + waiting + own - summary["wall_s"].as_f64().unwrap()).abs() < 1e-6, "{summary}");
    let boards = stats["boards"].as_object().unwrap().values();
    let sum: f64 = boards.map(|board| board["waiting_s"].as_f64().unwrap()).sum();
    assert!((sum - waiting).abs() < 1e-6, "{stats}");
}

#[test]
fn the_table_for_people_comes_after_the_summary_and_is_aligned() {
    for arguments in [&["run", "--stats"][..], &["run", "--stats", "--in-process"]] {
        let text = String::from_utf8(output(arguments).stdout).unwrap();
        let (_, table) = text.split_once("completed\n\n").unwrap_or_else(|| panic!("{text}"));
        let lines: Vec<&str> = table.lines().collect();
        let first = |line: &&str| line.split("  ").next().unwrap().trim().to_owned();
        let names: Vec<String> = lines.iter().map(first).collect();
        assert_eq!(names, ["cost", "master", "spindle", "transverse", "depth", "all boards", "pc", "wall"], "{text}");
        assert!(lines[..7].iter().all(|line| line.len() == lines[0].len()), "{table}");
        assert_eq!(lines[0].split_whitespace().nth(1), Some("turns"));
    }
}

#[test]
fn forty_boards_run_and_those_that_idle_take_next_to_no_turns() {
    let folder = folder();
    let path = folder.path().join("ten.toml");
    fs::write(&path, rig_of(10)).unwrap();
    let path = path.to_str().unwrap();
    let ten = run(&[path]);
    let boards = ten["stats"]["boards"].as_object().unwrap();
    assert_eq!(boards.len(), 40);
    assert_eq!(ten["boards"]["master0"]["frames_distributed"], 30);
    for (name, shares) in boards.iter().filter(|(name, _)| !name.ends_with('0')) {
        // The start, the master's enquiry, its answer.
        assert!(shares["turns"].as_u64().unwrap() <= 3, "{name}: {shares}");
    }
    // The one that works is served as if it were alone.
    let alone = run(&[]);
    for kind in ["master", "spindle", "transverse", "depth"] {
        let found = &ten["stats"]["boards"][format!("{kind}0")];
        assert_eq!(found["turns"], alone["stats"]["boards"][kind]["turns"], "{kind}");
    }
    assert_eq!(ten["virtual_s"], alone["virtual_s"]);
    let in_process = run(&[path, "--in-process"]);
    assert_eq!((&in_process["digest"], &in_process["stats"]["turns"]), (&ten["digest"], &ten["stats"]["turns"]));
}
