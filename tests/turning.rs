//! The worked page docs/turning.md: its commands, run as they stand there.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::common::folder;

const DOCS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs");

/// The page's commands, each with what it prints.
fn commands(page: &str) -> Vec<(String, String)> {
    let mut commands: Vec<(String, String)> = Vec::new();
    for block in page.split("```console\n").skip(1) {
        for line in block.split("```").next().unwrap().lines() {
            match (line.strip_prefix("$ "), commands.last_mut()) {
                (Some(command), _) => commands.push((command.to_owned(), String::new())),
                (None, Some((command, _))) if command.ends_with('\\') => *command += &format!("\n{line}"),
                (None, Some((_, printed))) => *printed += &format!("{line}\n"),
                (None, None) => panic!("{line} should be a command"),
            }
        }
    }
    commands
}

/// What is printed, without what differs from run to run: the processes' numbers and the real time.
fn lasting(printed: &str) -> Vec<String> {
    let processes = ["harness", "grbl", "master", "spindle", "transverse", "depth"];
    let lasting = |line: &str| match line.split_once(' ') {
        Some((name, rest)) if processes.contains(&name) => {
            rest.trim_start_matches(|c: char| c == ' ' || c.is_ascii_digit()).to_owned()
        }
        _ => line.split(" virtual in ").next().unwrap().to_owned(),
    };
    printed.lines().map(lasting).collect()
}

#[test]
fn the_worked_page_is_what_its_commands_print_and_draw() {
    let page = fs::read_to_string(format!("{DOCS}/turning.md")).unwrap();
    let root = folder();
    let docs = root.path().join("docs");
    fs::create_dir(&docs).unwrap();
    symlink(format!("{DOCS}/../harness"), root.path().join("harness")).unwrap();
    for name in ["handle.ngc", "handle.nc", "bore.ngc"] {
        let text = fs::read_to_string(format!("{DOCS}/{name}")).unwrap();
        assert!(name == "handle.nc" || page.contains(&text), "the page should show {name}");
        fs::write(docs.join(name), text).unwrap();
    }
    let bin = Path::new(env!("CARGO_BIN_EXE_torno")).parent().unwrap();
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
    let commands = commands(&page);
    assert!(commands.len() >= 8, "{commands:?}");
    for (command, shown) in commands {
        // Both streams in one, as a terminal shows them.
        let mut shell = Command::new("sh");
        shell.args(["-c", &format!("exec 2>&1; {command}")]).env("PATH", &path).env_remove("RUST_LOG");
        let output = shell.current_dir(&docs).stdin(Stdio::null()).output().unwrap();
        let printed = String::from_utf8(output.stdout).unwrap();
        assert_eq!(lasting(&printed), lasting(&shown), "{command}");
        let expected = if command.contains("thread.ngc") && command.starts_with("torno") { 2 } else { 0 };
        assert_eq!(output.status.code(), Some(expected), "{command}");
    }
    for picture in ["turning-plot.svg", "turning-part.svg", "turning-bore.svg"] {
        let [shown, drawn] = [Path::new(DOCS), &docs].map(|folder| fs::read(folder.join(picture)).unwrap());
        assert!(shown == drawn, "repeat the command of {picture} in the folder docs");
    }
}
