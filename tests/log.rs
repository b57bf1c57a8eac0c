//! The log on standard error: which boards, and in which form.

use serde_json::Value;

use crate::common::clients::program;
use crate::common::{SHORT, folder, torno};

/// The log of a short run.
fn log(wanted: &str, arguments: &[&str]) -> String {
    let folder = folder();
    let program = program(folder.path(), &[SHORT]);
    let mut command = torno(&["run", "--in-process", program.to_str().unwrap()]);
    let output = command.args(arguments).env("RUST_LOG", wanted).output().unwrap();
    assert!(output.status.success());
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn one_board_may_be_logged_alone() {
    let (all, depth) = (log("info", &[]), log("depth=info", &[]));
    let of_depth: String = all.split_inclusive('\n').filter(|line| line.contains(" INFO depth: ")).collect();
    assert!(!of_depth.is_empty() && of_depth.len() < all.len(), "{all}");
    assert_eq!(depth, of_depth);
}

#[test]
fn the_json_form_says_in_fields_what_the_text_says() {
    let (text, json) = (log("info", &[]), log("info", &["--log", "json"]));
    assert_eq!(text.lines().count(), json.lines().count());
    for (text, json) in text.lines().zip(json.lines()) {
        let said: Value = serde_json::from_str(json).unwrap();
        let (board, message) = (said["board"].as_str().unwrap(), said["message"].as_str().unwrap());
        assert!(text.ends_with(&format!("{} {board}: {message}", said["level"].as_str().unwrap())), "{text}\n{json}");
        assert!(said["ns"].is_u64() && said["event"].is_string() && said["value"].is_i64(), "{json}");
        assert_eq!(said["rig"]["name"], "lathe");
    }
}
