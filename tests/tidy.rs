//! What the compiler does not check of the house rules.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// The crates that are pure: all logic, no I/O.
const CORE: [&str; 12] = [
    "protocol",
    "master",
    "master/dspic",
    "slaves",
    "harness/bus",
    "harness/engine",
    "harness/identify",
    "harness/machines",
    "harness/part",
    "harness/plot",
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
        "protocol" | "harness/identify" | "harness/part" | "harness/plot" | "harness/servo" => "",
        "master" | "slaves" | "harness/engine" | "harness/text" => "protocol",
        "master/dspic" => "protocol master slaves",
        "harness/bus" => "protocol text engine",
        "harness/trace" => "protocol text engine bus",
        "harness/machines" => "protocol text engine bus master slaves dspic part servo",
        _ => "protocol text engine bus trace machines identify part plot servo",
    };
    for name in CORE.into_iter().chain(["harness", "harness/trace"]) {
        let manifest = fs::read_to_string(Path::new(ROOT).join(name).join("Cargo.toml")).unwrap();
        for line in manifest.lines().filter(|line| line.starts_with("torno-")) {
            let dependency = line.split(['.', ' ']).next().unwrap();
            let known = allowed(name).split(' ').any(|known| format!("torno-{known}") == dependency);
            assert!(known, "{name} must not depend on {dependency}");
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
