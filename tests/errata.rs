//! The page on what is wrong in the paper, and the exercises: their commands print what they say.

use std::fs;

use crate::common::torno;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// The words of a command line in which nothing is quoted.
fn words(line: &str) -> Vec<&str> {
    line.split_whitespace().collect()
}

#[test]
fn every_command_on_the_page_prints_what_stands_below_it() {
    check("paper-errata.md");
}

#[test]
fn every_command_of_an_exercise_prints_what_stands_below_it() {
    check("engraver-exercises.md");
}

fn check(page: &str) {
    let page = fs::read_to_string(format!("{ROOT}/docs/{page}")).unwrap();
    let blocks: Vec<&str> =
        page.split("```console\n$ torno ").skip(1).map(|b| b.split("```").next().unwrap()).collect();
    assert!(blocks.len() >= 9, "{}", blocks.len());
    for block in blocks {
        let (command, expected) = block.split_once('\n').unwrap();
        let output = torno(&words(command)).current_dir(ROOT).output().unwrap();
        // A figure of the paper that does not hold is a failure.
        let ended = matches!(output.status.code(), Some(0 | 1));
        assert!(ended, "{command}: {}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8(output.stdout).unwrap();
        let mut lines = text.lines();
        for line in expected.lines() {
            assert!(lines.any(|found| found.trim_end() == line), "{command} lacks, in its place,\n{line}\nin\n{text}");
        }
    }
}

#[test]
fn every_scenario_of_an_erratum_is_on_the_page() {
    let page = fs::read_to_string(format!("{ROOT}/docs/paper-errata.md")).unwrap();
    for entry in fs::read_dir(format!("{ROOT}/tests/errata")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        assert!(page.contains(&format!("tests/errata/{name}")), "{name}");
    }
}
