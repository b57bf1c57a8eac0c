//! What the compiler does not check of the house rules.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::imports::{Circle, Sources, circles, ties, undeclared};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// A crate: the folder that it lies in, whether it is pure (all logic, no I/O), and which others it may depend on.
struct Crate {
    folder: &'static str,
    pure: bool,
    may_use: &'static [&'static str],
}

const CRATES: [Crate; 23] = [
    Crate { folder: "protocol", pure: true, may_use: &[] },
    Crate { folder: "protocol/gcode", pure: true, may_use: &[] },
    Crate { folder: "protocol/grbl", pure: true, may_use: &["protocol"] },
    Crate { folder: "protocol/motion", pure: true, may_use: &["protocol"] },
    Crate { folder: "protocol/part", pure: true, may_use: &[] },
    Crate { folder: "protocol/planner", pure: true, may_use: &["protocol", "gcode", "part"] },
    Crate { folder: "master", pure: true, may_use: &["protocol"] },
    Crate { folder: "slaves", pure: true, may_use: &["protocol"] },
    Crate { folder: "slaves/stepper", pure: true, may_use: &["protocol"] },
    Crate { folder: "master/dspic", pure: true, may_use: &["protocol", "master", "slaves"] },
    Crate { folder: "master/engraver", pure: true, may_use: &["protocol", "grbl", "motion", "grbl-board", "stepper"] },
    Crate { folder: "master/grbl", pure: true, may_use: &["protocol", "gcode", "grbl", "planner"] },
    Crate { folder: "harness/text", pure: true, may_use: &["protocol"] },
    Crate { folder: "harness/engine", pure: true, may_use: &["protocol"] },
    Crate { folder: "harness/bus", pure: true, may_use: &["protocol", "text", "engine"] },
    // It writes to whatever takes bytes, and reads from it.
    Crate { folder: "harness/trace", pure: false, may_use: &["protocol", "text", "engine", "bus"] },
    Crate { folder: "harness/identify", pure: true, may_use: &[] },
    // It is a server: it knows requests and texts, and no rig.
    Crate { folder: "harness/page", pure: false, may_use: &[] },
    Crate { folder: "harness/plot", pure: true, may_use: &["text"] },
    Crate { folder: "harness/port", pure: false, may_use: &["protocol", "bus"] },
    Crate { folder: "harness/servo", pure: true, may_use: &[] },
    Crate {
        folder: "harness/machines",
        pure: true,
        may_use: &[
            "protocol",
            "grbl",
            "text",
            "engine",
            "bus",
            "master",
            "slaves",
            "dspic",
            "grbl-board",
            "engraver",
            "part",
            "planner",
            "servo",
        ],
    },
    Crate {
        folder: "harness",
        pure: false,
        may_use: &[
            "protocol", "gcode", "text", "engine", "bus", "trace", "machines", "identify", "page", "part", "planner",
            "plot", "port", "servo",
        ],
    },
];

/// The crates whose modules still import one another in circles. None, and it is not to grow.
const STILL_CIRCULAR: [&str; 0] = [];

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

/// What a command of Cargo prints.
fn cargo(arguments: &[&str]) -> String {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    let output = Command::new(cargo).args(arguments).arg("--offline").current_dir(ROOT).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn sources() -> Vec<(PathBuf, String)> {
    let read = |path: PathBuf| (path.clone(), fs::read_to_string(path).unwrap());
    files(Path::new(ROOT), ".rs").into_iter().map(read).collect()
}

#[test]
fn the_core_does_no_io_and_knows_no_runtime() {
    let pure = CRATES.iter().filter(|row| row.pure);
    let core: Vec<PathBuf> = pure.map(|row| Path::new(ROOT).join(row.folder).join("src")).collect();
    let forbidden = ["std::fs", "std::net", "std::process", "std::thread", "std::env", "std::io", "std::time", "tokio"];
    for (path, text) in sources() {
        let in_core = core.iter().any(|folder| path.starts_with(folder));
        for word in forbidden.iter().filter(|_| in_core) {
            assert!(!text.contains(word), "{} uses {word}", path.display());
        }
    }
}

/// The packages of the workspace, as Cargo has them: where each lies, and on which of the others it depends.
fn packages() -> Vec<(String, String, Vec<String>)> {
    let output = cargo(&["metadata", "--no-deps", "--format-version", "1"]);
    let metadata: serde_json::Value = serde_json::from_str(&output).unwrap();
    let text = |value: &serde_json::Value| value.as_str().unwrap().to_owned();
    let root = fs::canonicalize(ROOT).unwrap();
    let package = |package: &serde_json::Value| {
        let folder = Path::new(package["manifest_path"].as_str().unwrap()).parent().unwrap().to_owned();
        let folder = folder.strip_prefix(&root).unwrap().to_str().unwrap().to_owned();
        let dependencies = package["dependencies"].as_array().unwrap().iter();
        // What only tests need may point anywhere.
        let dependencies = dependencies.filter(|dependency| dependency["kind"] != "dev");
        let own = dependencies.map(|dependency| text(&dependency["name"])).filter(|name| name.starts_with("torno"));
        (folder, text(&package["name"]), own.collect())
    };
    metadata["packages"].as_array().unwrap().iter().map(package).collect()
}

#[test]
fn dependencies_point_one_way() {
    let packages = packages();
    assert_eq!(packages.len(), CRATES.len(), "each crate has a row, and each row a crate");
    for (folder, name, dependencies) in packages {
        let row = CRATES.iter().find(|row| row.folder == folder);
        let allowed = row.unwrap_or_else(|| panic!("{name} has no row in the table")).may_use;
        for dependency in dependencies {
            let short = dependency.strip_prefix("torno-").unwrap_or(&dependency);
            assert!(allowed.contains(&short), "{folder} must not depend on {dependency}");
        }
    }
}

/// The sources of a crate, by their paths below its `src`.
fn sources_of(folder: &str) -> Sources {
    let src = Path::new(ROOT).join(folder).join("src");
    let below = |path: &Path| path.strip_prefix(&src).unwrap().to_str().unwrap().to_owned();
    files(&src, ".rs").into_iter().map(|path| (below(&path), fs::read_to_string(path).unwrap())).collect()
}

#[test]
fn the_modules_of_a_crate_import_one_another_in_no_circle() {
    for (folder, name, _) in packages() {
        let circles = circles(&ties(&name, &sources_of(&folder)));
        let shown: Vec<String> = circles.iter().map(Circle::to_string).collect();
        if STILL_CIRCULAR.contains(&&*folder) {
            assert!(!circles.is_empty(), "{folder} has no circle any more: take it from the list");
            println!("{folder}/src, still:\n{}", shown.join("\n"));
        } else {
            assert!(circles.is_empty(), "in {folder}/src a\n{}", shown.join("\nand a "));
        }
    }
}

#[test]
fn no_file_is_left_out() {
    for (folder, name, _) in packages() {
        assert_eq!(undeclared(&name, &sources_of(&folder)), [""; 0], "{folder}/src has files that no module declares");
    }
    let whole = Path::new(ROOT).join("tests");
    let name = |path: PathBuf| path.strip_prefix(&whole).unwrap().to_str().unwrap().to_owned();
    let of_the_bench = |path: &PathBuf| path.starts_with(whole.join("benches")) || path.starts_with(whole.join("fuzz"));
    let files = files(&whole, ".rs").into_iter().filter(|path| !of_the_bench(path));
    let sources = files.map(|path| (name(path.clone()), fs::read_to_string(path).unwrap())).collect();
    assert_eq!(undeclared("whole", &sources), [""; 0], "tests has files that main.rs does not declare");
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
    let arguments = ["tree", "--package", "torno-protocol", "--edges", "normal", "--prefix", "none", "--no-dedupe"];
    let mut packages: Vec<String> = cargo(&arguments).lines().map(str::to_owned).collect();
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
