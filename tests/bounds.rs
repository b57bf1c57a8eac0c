//! What has a limit: memory, descriptors, the length of files.

use std::fs;
use std::process::{Command, Output};

use crate::common::{folder, torno};
use torno::rig::Driver;
use torno::scenario::{self, Scenario};
use torno_protocol::time::Span;

/// Runs it with a limit of the shell's `ulimit`.
fn limited(limit: &str, arguments: &[&str]) -> Output {
    let command = torno(arguments);
    let mut shell = Command::new("sh");
    shell.args(["-c", &format!("ulimit {limit} && exec \"$@\""), "sh"]).arg(command.get_program());
    shell.args(command.get_args()).env_remove("RUST_LOG").stdin(std::process::Stdio::null()).output().unwrap()
}

/// What came out, for people.
fn text(output: &Output) -> String {
    String::from_utf8_lossy(&[&output.stdout[..], &output.stderr].concat()).into_owned()
}

/// The spindle turns for eight hours, and tells of it. Then it is given a frame.
const LONG: &str = r#"
name = "a long run and then a frame"
end = "30100 s"
[[step]]
does = "the spindle turns"
send = ["4B 64 00 00 00 00 00 00"]
[[step]]
does = "it does"
wait = { reply = "XON", within = "20 s" }
[[step]]
does = "a long time"
run = "30000 s"
[[step]]
does = "it stands still"
send = ["00 64 00 00 00 00 00 00"]
[[step]]
does = "it does"
wait = { reply = "XON", within = "20 s" }
[expect]
replies = "ACK XON ACK XON"
"#;

#[test]
fn how_a_long_span_is_cut_does_not_show() {
    let folder = folder();
    let path = folder.path().join("long.toml");
    fs::write(&path, LONG.replace("30000 s", "2000 s")).unwrap();
    let scenario = Scenario::load(&path, None).unwrap();
    let processes = Driver::Processes { exe: env!("CARGO_BIN_EXE_torno").into() };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let whole = runtime.block_on(scenario::run(&scenario, &Driver::InProcess)).unwrap();
    assert!(whole.failures.is_empty(), "{:?}", whole.failures);
    let apart = runtime.block_on(scenario::run(&scenario, &processes)).unwrap();
    let in_slices = scenario::run_in_slices(&scenario, &Driver::InProcess, Span::from_secs(7));
    let in_slices = runtime.block_on(in_slices).unwrap();
    assert_eq!([apart.digest, in_slices.digest], [whole.digest.clone(), whole.digest]);
}

#[test]
fn memory_does_not_grow_with_the_virtual_time_in_which_a_motor_turns() {
    let folder = folder();
    let path = folder.path().join("long.toml");
    fs::write(&path, LONG).unwrap();
    for driver in [&[][..], &["--processes"]] {
        let output = limited("-v 100000", &[&["test", "--jobs", "1", path.to_str().unwrap()], driver].concat());
        assert!(output.status.success(), "{driver:?}: {}", text(&output));
    }
}
