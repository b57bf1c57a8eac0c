//! Recordings that earlier versions made, one of each command that records, are read, reported and replayed.
//!
//! The files are never made again: those of version 3 of the format lie in `recordings/v3`, and so on.
//!
//! - `run`: three short frames, `depth.clock_ppm=200`
//! - `run-faults`: the same frames with `--faults`: noise, a flipped bit, a late edge, a load, a drift, a reset
//! - `test`: the scenario `brown-out-slave`
//! - `servo-run`: a motion program of 14 mm and back, Kx 16, Kv 0
//! - `up`: a serial client at two speeds; `ctl fault`, `heal`, `power`, `pause`, `step`, `resume`; a board stopped,
//!   continued, killed
//! - `up-servo`: the same motion program from `servo run --port`
//! - `run-grbl` (from version 4): `run lathe-grbl`
//! - `up-grbl` (from version 4): a sender that counts characters, from its reset at opening

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::common::{folder, json, output};
use serde_json::Value;

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/recordings");

/// What a recording holds: its digest, and how many of each kind of row.
struct Held {
    name: &'static str,
    digest: &'static str,
    edges: usize,
    characters: usize,
    telemetry: usize,
    events: usize,
    inputs: usize,
}

const HELD: [Held; 8] = [
    Held {
        name: "run",
        digest: "c226910390026d6f81ce1b6554595906",
        edges: 470,
        characters: 111,
        telemetry: 739,
        events: 49,
        inputs: 1,
    },
    Held {
        name: "run-faults",
        digest: "b30b6154c732b0e8669a8c3e6a0b83a2",
        edges: 604,
        characters: 100,
        telemetry: 952,
        events: 44,
        inputs: 18,
    },
    Held {
        name: "test",
        digest: "ecda6f67c46432f163e6a7bbbc13712b",
        edges: 242,
        characters: 49,
        telemetry: 641,
        events: 19,
        inputs: 4,
    },
    Held {
        name: "servo-run",
        digest: "6fd127a78ec6d016cac4c31bbc6a0901",
        edges: 6926,
        characters: 1456,
        telemetry: 1729,
        events: 1459,
        inputs: 8,
    },
    Held {
        name: "up",
        digest: "abcfe1c6d0b77d6cf6c5ed7021a7d964",
        edges: 438,
        characters: 95,
        telemetry: 792,
        events: 38,
        inputs: 15,
    },
    Held {
        name: "up-servo",
        digest: "a043cd7c8b4ba01c4ce12759a6878e04",
        edges: 6928,
        characters: 1456,
        telemetry: 1729,
        events: 1459,
        inputs: 67,
    },
    Held {
        name: "run-grbl",
        digest: "7011f631add3f757106beabc3acdc12d",
        edges: 9462,
        characters: 1863,
        telemetry: 14747,
        events: 988,
        inputs: 1,
    },
    Held {
        name: "up-grbl",
        digest: "895f33f6649880476c1b69096c1997f9",
        edges: 9936,
        characters: 1881,
        telemetry: 1943,
        events: 1644,
        inputs: 32,
    },
];

/// The recordings of all versions, each with its version.
fn recordings() -> Vec<(u16, PathBuf)> {
    let entries = |path: &Path| -> Vec<PathBuf> {
        let mut paths: Vec<PathBuf> = fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        paths
    };
    let name = |path: &Path| path.file_name().unwrap().to_str().unwrap().to_owned();
    let of = |folder: PathBuf| {
        let version = name(&folder).strip_prefix('v').unwrap().parse::<u16>().unwrap();
        entries(&folder).into_iter().map(move |path| (version, path))
    };
    entries(Path::new(FOLDER)).into_iter().flat_map(of).collect()
}

fn held(path: &Path) -> &'static Held {
    let name = path.file_stem().unwrap().to_str().unwrap();
    HELD.iter().find(|held| held.name == name).unwrap_or_else(|| panic!("it is not said what {name} holds"))
}

/// A command on a recording, which must end well; what it printed.
fn said(arguments: &[&str]) -> String {
    let output = output(arguments);
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {complaint}{}", String::from_utf8_lossy(&output.stdout));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn there_is_one_of_each_command_and_it_is_of_the_version_that_its_folder_says() {
    let recordings = recordings();
    for held in &HELD {
        assert!(recordings.iter().any(|(_, path)| self::held(path).name == held.name), "{}", held.name);
    }
    for (version, path) in recordings {
        let bytes = fs::read(&path).unwrap();
        assert_eq!(bytes[8..10], version.to_le_bytes(), "{}", path.display());
    }
}

#[test]
fn recordings_of_earlier_versions_are_read() {
    for (_, path) in recordings() {
        let held = held(&path);
        let path = path.to_str().unwrap();
        let mut rows: BTreeMap<&str, usize> = BTreeMap::new();
        for kind in ["edges", "characters", "telemetry", "events", "inputs"] {
            rows.insert(kind, said(&["trace", "--json", "--kind", kind, path]).lines().count());
        }
        let expected = [
            ("edges", held.edges),
            ("characters", held.characters),
            ("telemetry", held.telemetry),
            ("events", held.events),
            ("inputs", held.inputs),
        ];
        assert_eq!(rows, BTreeMap::from(expected), "{path}");
        // Without a filter there is all but edges, and what the characters mean.
        let all = said(&["trace", path]).lines().count();
        assert!(all > held.characters + held.telemetry + held.events + held.inputs, "{path}: {all}");
    }
}

#[test]
fn recordings_of_earlier_versions_are_reported() {
    let folder = folder();
    let page = folder.path().join("report.html");
    for (_, path) in recordings() {
        let path = path.to_str().unwrap();
        said(&["trace", path, "--report", page.to_str().unwrap()]);
        let html = fs::read_to_string(&page).unwrap();
        assert!(html.contains(held(Path::new(path)).digest), "{path}: the page says which session it is of");
        assert!(html.matches("<svg").count() > 2, "{path}");
        fs::remove_file(&page).unwrap();
    }
}

#[test]
fn recordings_of_earlier_versions_are_replayed_with_the_same_digest() {
    for (_, path) in recordings() {
        let digest = held(&path).digest;
        for driver in [&[][..], &["--processes"]] {
            let path = path.to_str().unwrap();
            let output = output(&[&["replay", "--json", path], driver].concat());
            let replayed = json(&output);
            assert!(output.status.success(), "{path} {driver:?}: {replayed}");
            let told = ["digest", "recorded", "same", "difference"].map(|name| &replayed[name]);
            assert_eq!(told, [&digest.into(), &digest.into(), &true.into(), &Value::Null], "{path} {driver:?}");
        }
    }
}
