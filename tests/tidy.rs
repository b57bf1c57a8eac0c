//! What the compiler does not check of the house rules.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// The crates that are pure: all logic, no I/O.
const CORE: [&str; 9] = [
    "protocol",
    "master",
    "master/dspic",
    "slaves",
    "harness/engine",
    "harness/identify",
    "harness/part",
    "harness/servo",
    "harness/text",
];

fn files(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() && name != "target" && !name.starts_with('.') {
            found.extend(files(&path, ending));
        } else if name.ends_with(ending) {
            found.push(path);
        }
    }
    found.sort();
    found
}

fn sources() -> Vec<(PathBuf, String)> {
    let read = |path: PathBuf| (path.clone(), fs::read_to_string(path).unwrap());
    files(Path::new(ROOT), ".rs").into_iter().map(read).collect()
}

#[test]
fn the_core_does_no_io_and_knows_no_runtime() {
    let forbidden = ["std::fs", "std::net", "std::process", "std::thread", "std::env", "std::io", "std::time", "tokio"];
    for (path, text) in sources() {
        let in_core = CORE.iter().any(|name| path.starts_with(Path::new(ROOT).join(name).join("src")));
        for word in forbidden.iter().filter(|_| in_core) {
            assert!(!text.contains(word), "{} uses {word}", path.display());
        }
    }
}

#[test]
fn dependencies_point_one_way() {
    let allowed = |name: &str| match name {
        "protocol" | "harness/identify" | "harness/part" | "harness/servo" => vec![],
        "master" | "slaves" | "harness/engine" | "harness/text" => vec!["torno-protocol"],
        "master/dspic" => vec!["torno-protocol", "torno-master", "torno-slaves"],
        _ => vec![
            "torno-protocol",
            "torno-master",
            "torno-slaves",
            "torno-dspic",
            "torno-engine",
            "torno-identify",
            "torno-part",
            "torno-servo",
            "torno-text",
        ],
    };
    for name in CORE.into_iter().chain(["harness"]) {
        let manifest = fs::read_to_string(Path::new(ROOT).join(name).join("Cargo.toml")).unwrap();
        for line in manifest.lines().filter(|line| line.starts_with("torno-")) {
            let dependency = line.split(['.', ' ']).next().unwrap();
            assert!(allowed(name).contains(&dependency), "{name} must not depend on {dependency}");
        }
    }
}

#[test]
fn only_one_room_of_the_harness_knows_the_boards() {
    for (path, text) in sources() {
        let in_the_room = path.components().any(|part| part.as_os_str() == "kinds");
        if path.starts_with(Path::new(ROOT).join("harness/src")) && !in_the_room {
            let boards = ["torno_master", "torno_slaves", "torno_dspic"];
            assert!(!boards.iter().any(|board| text.contains(board)), "{}", path.display());
        }
    }
}

#[test]
fn the_protocol_stays_light() {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    let arguments = ["tree", "--package", "torno-protocol", "--edges", "normal", "--prefix", "none", "--no-dedupe"];
    let output = Command::new(cargo).args(arguments).arg("--offline").current_dir(ROOT).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut packages: Vec<String> = String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect();
    packages.sort();
    packages.dedup();
    assert!(packages.len() <= 15, "{} packages: {packages:#?}", packages.len());
}

#[test]
fn no_line_and_no_file_is_too_long() {
    for (path, text) in sources() {
        let lines = text.lines().count();
        assert!(lines <= 800, "{} has {lines} lines: split it", path.display());
        for (n, line) in text.lines().enumerate() {
            assert!(line.chars().count() <= 120, "{}:{} is too long", path.display(), n + 1);
        }
    }
}

#[test]
fn links_lead_somewhere() {
    let docs = files(&Path::new(ROOT).join("docs"), "md");
    for path in docs.into_iter().chain([Path::new(ROOT).join("README.md")]) {
        let text = fs::read_to_string(&path).unwrap();
        for link in text.split("](").skip(1).map(|rest| rest.split([')', '#']).next().unwrap()) {
            let there = path.parent().unwrap().join(link);
            assert!(link.starts_with("http") || there.exists(), "{}: {link}", path.display());
        }
    }
}
