//! What has a limit: memory, descriptors, the length of files.

use std::fs::{self, File};
use std::io::BufReader;
use std::process::{Command, Output};

use crate::common::{folder, output, torno};
use torno::rig::Driver;
use torno::rig::file::RigFile;
use torno::scenario::{self, Scenario};
use torno_protocol::time::{Instant, Span};
use torno_trace::{End, Writer};

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

/// The spindle turns for eight hours, and reports it all that time. Then it is given a frame.
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

#[test]
fn too_few_open_files_are_complained_of() {
    for files in 4..40 {
        for command in [&["run", "--in-process"][..], &["run"], &["ctl", "state"]] {
            let output = limited(&format!("-n {files}"), command);
            let text = text(&output);
            assert!(!text.contains("panicked"), "{files}: {text}");
            assert!(output.status.code().is_some_and(|code| code < 4), "{files}: {text}");
            if files == 6 {
                assert!(text.contains("expected a higher limit (ulimit -n)"), "{text}");
            }
        }
    }
}

#[test]
fn a_file_that_may_grow_no_further_is_an_error() {
    let folder = folder();
    let path = folder.path().join("file");
    let path = path.to_str().unwrap();
    for (option, code, why) in
        [("--record", 3, "cannot go on"), ("--vcd", 2, "cannot write"), ("--report", 2, "cannot write")]
    {
        fs::remove_file(path).ok();
        let output = limited("-f 8", &["run", "--in-process", option, path]);
        let text = text(&output);
        assert_eq!(output.status.code(), Some(code), "{option}: {text}");
        assert!(text.contains(why) && text.contains("File too large"), "{option}: {text}");
    }
}

#[test]
fn a_file_without_an_end_is_refused() {
    let zero = "/dev/zero";
    for arguments in [
        &["run", zero][..],
        &["run", "lathe", zero],
        &["run", "--faults", zero],
        &["up", "--faults", zero],
        &["test", zero],
        &["sweep", zero],
        &["identify", "--from", zero],
        &["servo", "check", zero],
    ] {
        let output = limited("-v 400000", arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", text(&output));
        let expected = "expected a text of no more than 128 MiB, found a longer one";
        assert!(text(&output).contains(expected), "{arguments:?}: {}", text(&output));
    }
    for arguments in [&["sweep", "--merge", zero][..], &["trace", zero], &["replay", zero]] {
        let output = limited("-v 400000", arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", text(&output));
    }
}

#[test]
fn what_is_told_of_a_long_line_grows_with_its_length_only() {
    let folder = folder();
    let path = folder.path().join("long.txt");
    let told = |words: usize| {
        fs::write(&path, "q ".repeat(words) + "\ne\n").unwrap();
        let output = output(&["servo", "check", path.to_str().unwrap()]);
        assert_eq!(output.status.code(), Some(1));
        output.stdout.len()
    };
    let (some, more) = (told(1_000), told(10_000));
    assert!(more < 11 * some && some < 1_000_000, "{some} {more}");
}

/// A recording says when it ends, and may be wrong: the motor that turns at its end would turn for centuries.
#[test]
fn a_replay_ends_even_if_its_recording_does_not() {
    let folder = folder();
    let [program, path] = ["turns.frames", "a.torno"].map(|name| folder.path().join(name));
    fs::write(&program, "4B 64 00 00 00 00 00 00\n").unwrap();
    let recorded = output(&["run", "lathe", program.to_str().unwrap(), "--record", path.to_str().unwrap()]);
    assert!(recorded.status.success());
    let layout = RigFile::layout_of;
    let (trace, damage) = torno_trace::read(BufReader::new(File::open(&path).unwrap()), layout).unwrap();
    assert!(damage.is_none());
    let mut writer = Writer::new(File::create(&path).unwrap(), &trace.header).unwrap();
    writer.note(&trace.inputs, &trace.facts, trace.settled).unwrap();
    let end = trace.end.unwrap();
    writer.finish(&End { at: Instant::from_nanos(i64::MAX as u64), ..end }).unwrap();
    for driver in [&[][..], &["--processes"]] {
        let replayed = limited("-v 400000", &[&["replay", path.to_str().unwrap()], driver].concat());
        assert_eq!(replayed.status.code(), Some(1), "{}", text(&replayed));
    }
}
