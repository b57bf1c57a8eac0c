//! A machine that nothing but its own room and its line in the registry knows: it runs, is tested, recorded and read
//! like any other.

use std::path::Path;

use crate::common::{folder, output};

const HELLO: &str = r#"name = "hello"
rig = "echo"

[[step]]
does = "a byte comes back"
send = ["h"]

[[step]]
does = "after the time that its settings say"
wait = { reply = "ECHO 104", within = "5 ms" }

[[step]]
does = "so do two at once"
send = ["ey"]

[[step]]
does = "the last is back"
wait = { reply = "ECHO 121", within = "6 ms" }

[expect]
replies = "ECHO 104 ECHO 101 ECHO 121"

[[expect.finally]]
board = "echo"
quantity = "bytes_echoed"
equals = 3
"#;

/// What a command prints on standard output and on standard error, and its exit code.
fn run(arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = output(arguments);
    let [out, err] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    (output.status.code(), out, err)
}

/// The scenario with this change, run through the binary.
fn test(folder: &Path, from: &str, to: &str, arguments: &[&str]) -> (Option<i32>, String, String) {
    let path = folder.join("hello.toml");
    std::fs::write(&path, HELLO.replace(from, to)).unwrap();
    run(&[&["test", path.to_str().unwrap()], arguments].concat())
}

#[test]
fn a_scenario_on_a_machine_of_its_own_passes_with_processes_and_without() {
    let folder = folder();
    for arguments in [&[][..], &["--processes"]] {
        let (code, out, err) = test(folder.path(), "", "", arguments);
        assert_eq!(code, Some(0), "{out}{err}");
    }
    // It comes back a character and two milliseconds after it has come; its last sample is before its end.
    let (code, out, _) = test(folder.path(), "5 ms", "3 ms", &[]);
    assert!(code == Some(1) && out.contains("pc sends 68"), "{out}");
    let (code, _, err) = test(folder.path(), "ECHO 101", "ECHO 256", &[]);
    assert!(code == Some(2) && err.contains("there is no reply 'ECHO 256'"), "{err}");
}

#[test]
fn its_lines_are_read_and_what_happened_happens_again() {
    let folder = folder();
    let recording = folder.path().join("hello.torno");
    let recording = recording.to_str().unwrap();
    let (code, out, err) = test(folder.path(), "", "", &["--record", recording]);
    assert_eq!(code, Some(0), "{out}{err}");
    let (_, out, err) = run(&["trace", recording, "--kind", "frames"]);
    let told = |text: &str| out.matches(text).count();
    let expected = [("send 68 back", 1), ("68 is back", 1), ("79 is back", 1), ("is no echo", 0)];
    assert_eq!(expected.map(|(text, _)| (text, told(text))), expected, "{out}{err}");
    let (code, out, err) = run(&["replay", recording]);
    assert_eq!(code, Some(0), "{out}{err}");
}

#[test]
fn what_it_does_not_have_is_said() {
    for (arguments, expected) in [
        (&["run", "echo"][..], "the rig 'echo' speaks echo: use 'torno up'"),
        (&["identify", "echo", "echo"], "board 'echo' has no motor: no board of this rig has one"),
        (&["servo", "link", "--rig", "echo"], "the rig 'echo' speaks echo, not servo: use 'torno up'"),
    ] {
        let (code, _, err) = run(arguments);
        assert!(code == Some(2) && err.contains(expected), "{arguments:?}: {err}");
    }
}
