//! What a rig costs, as far as it can be counted: that holds on any machine.

use std::fs;
use std::time::Duration;

use crate::common::{folder, json, output, rig_of};
use serde_json::Value;
use torno::report::{BytesPerGrant, Stats};
use torno::rig::{Bytes, Cost};
use torno_engine::Statistics;

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

/// How many grants each had, and how many of them were redone.
fn grants(stats: &Value) -> Vec<(u64, u64)> {
    let boards = ["master", "spindle", "transverse", "depth"].map(|name| &stats["boards"][name]);
    let shares = [stats, &stats["pc"]].into_iter().chain(boards);
    shares.map(|shares| (shares["grants"].as_u64().unwrap(), shares["redone"].as_u64().unwrap())).collect()
}

#[test]
fn the_demonstration_takes_at_most_six_turns_of_boards_a_virtual_second() {
    let summary = run(&[]);
    let per_s = summary["stats"]["grants_per_virtual_s"].as_f64().unwrap();
    assert!(per_s <= 6.0, "{per_s}: {}", summary["stats"]);
}

/// What a node has cost: wall time in seconds, grants, those redone, bytes.
fn cost(name: &str, wall_s: u64, grants: u64, redone: u64, bytes: Option<(u64, u64)>) -> Cost {
    Cost {
        name: name.to_owned(),
        statistics: Statistics { grants, redone },
        bytes: bytes.map(|(to, from)| Bytes { to, from }),
        wall: Duration::from_secs(wall_s),
    }
}

#[test]
fn costs_are_summed_over_the_boards_and_the_pc_is_the_harness_s_own_work() {
    let costs = [
        cost("master", 1, 10, 1, Some((100, 50))),
        cost("depth", 3, 30, 3, Some((300, 30))),
        cost("pc", 5, 1000, 500, None),
    ];
    let stats = Stats::new(&costs, 8.0, Duration::from_secs(20), Duration::from_secs(17));
    assert_eq!((stats.all.grants, stats.all.redone, stats.all.grants_per_virtual_s), (40, 4, 5.0));
    assert_eq!(stats.all.bytes_per_grant, Some(BytesPerGrant { to_board: 10.0, from_board: 2.0 }));
    assert_eq!((stats.starting_s, stats.all.waiting_s, stats.own_s), (3.0, 4.0, 13.0));
    let boards: Vec<_> = stats.boards.iter().map(|(name, of)| (&**name, of.grants, of.waiting_s)).collect();
    assert_eq!(boards, [("master", 10, 1.0), ("depth", 30, 3.0)]);
    assert_eq!((stats.pc.grants, stats.pc.grants_per_virtual_s, stats.pc.bytes_per_grant), (1000, 125.0, None));
    // What was over before it began has cost nothing.
    let none = Stats::new(&costs[2..], 0.0, Duration::ZERO, Duration::ZERO);
    assert_eq!((none.all.grants_per_virtual_s, none.starting_s, none.own_s), (0.0, 0.0, 0.0));
}

#[test]
fn what_is_counted_is_the_same_each_time_and_turns_are_the_same_without_processes() {
    let [processes, again] = [(); 2].map(|()| run(&[]));
    assert_eq!(counted(&processes["stats"]), counted(&again["stats"]));
    let in_process = run(&["--in-process"]);
    assert_eq!(grants(&processes["stats"]), grants(&in_process["stats"]));
    for board in ["master", "spindle", "transverse", "depth"] {
        for way in ["to_board", "from_board"] {
            let bytes = processes["stats"]["boards"][board]["bytes_per_grant"][way].as_f64().unwrap();
            // At least the length of a record, and what it is.
            assert!(bytes > 5.0, "{board} {way}: {bytes}");
        }
        assert!(in_process["stats"]["boards"][board].get("bytes_per_grant").is_none());
    }
    assert!(processes["stats"]["pc"].get("bytes_per_grant").is_none());
}

#[test]
fn asking_what_it_costs_changes_nothing_of_what_happens() {
    let plain = json(&output(&["run", "--json"]));
    assert!(plain.get("stats").is_none(), "{plain}");
    assert_eq!(run(&[])["digest"], plain["digest"]);
}

#[test]
#[expect(clippy::disallowed_methods, reason = "what is told of wall time is held against the wall clock")]
fn the_wall_time_that_is_told_is_within_what_the_command_took() {
    for arguments in [&[][..], &["--in-process"]] {
        let start = std::time::Instant::now();
        let summary = run(arguments);
        let took = start.elapsed().as_secs_f64();
        let stats = &summary["stats"];
        let [starting, waiting, own] = ["starting_s", "waiting_s", "own_s"].map(|name| stats[name].as_f64().unwrap());
        assert!(starting > 0.0 && waiting > 0.0 && own > 0.0, "{stats}");
        assert!(starting + waiting + own <= took, "{took} s: {stats}");
        // Each board has been waited for.
        let boards = stats["boards"].as_object().unwrap().values();
        assert!(boards.map(|board| board["waiting_s"].as_f64().unwrap()).all(|s| s > 0.0), "{stats}");
    }
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
        assert_eq!(lines[0].split_whitespace().nth(1), Some("grants"));
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
        assert!(shares["grants"].as_u64().unwrap() <= 3, "{name}: {shares}");
    }
    // The one that works is served as if it were alone.
    let alone = run(&[]);
    for kind in ["master", "spindle", "transverse", "depth"] {
        let found = &ten["stats"]["boards"][format!("{kind}0")];
        assert_eq!(found["grants"], alone["stats"]["boards"][kind]["grants"], "{kind}");
    }
    assert_eq!(ten["virtual_s"], alone["virtual_s"]);
    let in_process = run(&[path, "--in-process"]);
    assert_eq!((&in_process["digest"], &in_process["stats"]["grants"]), (&ten["digest"], &ten["stats"]["grants"]));
}
