//! Verdicts for CI: what `torno test` says of folders in which not everything passes, and how it ends.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::Value;

use crate::common::{folder, is_installed, kill, torno, wait_until_interruptible};

const SCHEMA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/junit-10.xsd");

const PASSES: &str = "name = \"a turn\"\n[[step]]\ndoes = \"out\"\nsend = [\"00 64 03 84 00 00 00 00\"]\n\
    [[step]]\ndoes = \"it is done\"\nwait = { reply = \"XON\", within = \"5 s\" }\n";
const BROKEN: &str = "name = \"a typo\"\n[[stpe]]\n";

fn fails() -> String {
    PASSES.replace("a turn", "a hasty <turn> & \\u0007").replace("5 s", "500 ms")
}

fn shows_nothing() -> String {
    let fault = "[[fault]]\nname = \"jam\"\nboard = \"depth\"\nkind = \"stall\"\nwhen = { reply = \"CAN\" }\n";
    PASSES.replace("a turn", "a jam") + fault
}

/// One that takes far longer than anybody waits.
fn never_ends() -> String {
    let noise = "[[fault]]\nline = \"pc_to_master\"\nkind = \"noise\"\nperiod = \"1 ms\"\n";
    format!("name = \"for ever\"\nend = \"10000000 s\"\n{noise}")
}

/// Files in a folder of their own.
fn tree(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = folder();
    for (name, text) in files {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
    folder
}

/// One of each kind, in folders below.
fn four() -> tempfile::TempDir {
    tree(&[
        ("b/pass.toml", PASSES),
        ("b/fail.toml", &fails()),
        ("a/deep/down/jam.toml", &shows_nothing()),
        ("broken.toml", BROKEN),
    ])
}

/// `torno test` in that folder.
fn test(folder: &Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    let Output { status, stdout, stderr } = torno(&["test"]).args(arguments).current_dir(folder).output().unwrap();
    let [out, err] = [stdout, stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    (status.code(), out, err)
}

/// The word and the file of each line that has a verdict.
fn verdicts(out: &str) -> Vec<(&str, &str)> {
    let words = ["passed ", "FAILED ", "INCONCLUSIVE ", "BROKEN "];
    let lines = out.lines().filter(|line| words.iter().any(|word| line.starts_with(word)));
    lines.map(|line| (line.split(' ').next().unwrap(), line.split(' ').next_back().unwrap())).collect()
}

#[test]
fn what_is_broken_is_told_and_the_others_run() {
    let folder = four();
    let (code, out, err) = test(folder.path(), &["."]);
    assert_eq!(code, Some(2), "{out}{err}");
    let expected = [
        ("INCONCLUSIVE", "./a/deep/down/jam.toml"),
        ("FAILED", "./b/fail.toml"),
        ("passed", "./b/pass.toml"),
        ("BROKEN", "./broken.toml"),
    ];
    assert_eq!(verdicts(&out), expected, "{out}");
    assert!(out.ends_with("\n1 failed, 1 broken, 1 inconclusive, 1 passed\n"), "{out}");
    assert!(err.starts_with("torno: ./broken.toml:2:3: unknown field `stpe`"), "{err}");
    let why =
        "  expected  the fault 'jam'\n  came      it has not begun: its condition was never met (the reply CAN)\n";
    assert!(out.contains(why), "{out}");

    let (code, out, _) = test(folder.path(), &[".", "--json"]);
    assert_eq!(code, Some(2));
    let lines: Vec<Value> = out.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let outcomes: Vec<&str> = lines.iter().map(|line| line["outcome"].as_str().unwrap()).collect();
    assert_eq!(outcomes, ["inconclusive", "failed", "passed", "broken"]);
    assert_eq!((&lines[3]["path"], &lines[3]["name"]), (&"./broken.toml".into(), &"a typo".into()));
    assert!(lines[3]["error"].as_str().unwrap().contains("unknown field `stpe`"), "{out}");
}

#[test]
fn each_verdict_has_its_exit_status() {
    let folder = four();
    for (files, status) in [
        (&["b/pass.toml"][..], 0),
        (&["b/fail.toml"], 1),
        (&["a/deep/down/jam.toml"], 1),
        (&["b/pass.toml", "a/deep/down/jam.toml"], 1),
        (&["broken.toml"], 2),
        (&["b/fail.toml", "broken.toml"], 2),
        (&["b/pass.toml", "missing.toml"], 2),
    ] {
        let (code, out, err) = test(folder.path(), files);
        assert_eq!(code, Some(status), "{files:?}\n{out}{err}");
    }
}

/// The names of a tag's attributes, for every tag of that name.
fn attributes<'a>(xml: &'a str, tag: &str) -> Vec<Vec<&'a str>> {
    let tags = xml.split('<').filter_map(|text| text.strip_prefix(tag)?.strip_prefix(' '));
    // No value has a quote or an angle bracket in it.
    let names = |text: &'a str| text.split('>').next().unwrap().split('"').step_by(2).map(str::trim);
    tags.map(|text| names(text).filter_map(|name| name.strip_suffix('=')).collect()).collect()
}

#[test]
fn junit_has_what_the_strict_schema_allows_and_what_readers_want() {
    let folder = four();
    let (code, ..) = test(folder.path(), &[".", "--junit", "out.xml"]);
    assert_eq!(code, Some(2));
    let xml = fs::read_to_string(folder.path().join("out.xml")).unwrap();
    assert_eq!(attributes(&xml, "testsuites"), [["name", "tests", "failures", "errors", "time"]], "{xml}");
    let of_a_suite = ["name", "tests", "skipped", "errors", "failures", "time", "file"];
    assert_eq!(attributes(&xml, "testsuite"), [of_a_suite; 4], "{xml}");
    assert_eq!(attributes(&xml, "testcase"), [["name", "classname", "time"]; 4], "{xml}");
    for kind in ["skipped", "failure", "error"] {
        assert_eq!(attributes(&xml, kind), [["message"]], "{xml}");
    }
    assert!(xml.contains("tests=\"4\" failures=\"1\" errors=\"1\""), "{xml}");
    let suites: Vec<&str> = xml.split("<testsuite ").skip(1).collect();
    for (suite, (name, path, what)) in suites.iter().zip([
        ("a jam", "./a/deep/down/jam.toml", "<skipped message=\"inconclusive: expected the fault 'jam'"),
        (
            "a hasty &lt;turn&gt; &amp; ",
            "./b/fail.toml",
            "<failure message=\"expected the reply XON within 500 ms, came",
        ),
        ("a turn", "./b/pass.toml", "/>"),
        ("a typo", "./broken.toml", "<error message=\"./broken.toml:2:3: unknown field `stpe`"),
    ]) {
        let path = &path[2..];
        assert!(suite.starts_with(&format!("name=\"{path}\" ")), "{suite}");
        let (_, case) = suite.split_once("<testcase ").unwrap();
        let class = path.replace(".toml", "").replace('/', ".");
        assert!(case.starts_with(&format!("name=\"{name}\" classname=\"{class}\" time=\"0.")), "{case}");
        assert!(suite.contains(&format!("file=\"{path}\"")), "{suite}");
        assert!(case.replace('\'', "&apos;").contains(&what.replace('\'', "&apos;")), "{case}\nlacks {what}");
    }
    if is_installed("xmllint", Command::new("xmllint").arg("--version")) {
        let checked = Command::new("xmllint")
            .args(["--noout", "--schema", SCHEMA, "out.xml"])
            .current_dir(folder.path())
            .output()
            .unwrap();
        assert!(checked.status.success(), "{}\n{xml}", String::from_utf8_lossy(&checked.stderr));
    }
}

#[test]
fn a_report_is_always_of_this_run() {
    let folder = four();
    let path = folder.path().join("out.xml");
    for (arguments, expected) in [
        (&["broken.toml"][..], "<error"),
        (&["missing.toml"], "missing.toml: cannot read the scenario"),
        (&["b", "-k", "nothing of the kind"], ""),
        (&["b", "--record", "/nowhere/a.trace"], ""),
    ] {
        fs::write(&path, "of an old run").unwrap();
        let (code, _, err) = test(folder.path(), &[arguments, &["--junit", "out.xml"]].concat());
        assert_eq!(code, Some(2), "{arguments:?}: {err}");
        let xml = fs::read_to_string(&path).unwrap();
        assert!(xml.contains(expected) && !xml.contains("of an old run"), "{arguments:?}: {xml}");
    }
}

#[test]
fn the_files_of_a_run_are_always_of_this_run() {
    let folder = tree(&[("page.html", ""), ("part.svg", ""), ("lines.vcd", "")]);
    let files = ["page.html", "part.svg", "lines.vcd"];
    for wrong in [&["no-such-rig"][..], &["lathe", "no-such.frames"], &["--set", "spindle.x=1"], &["servo"]] {
        files.iter().for_each(|file| fs::write(folder.path().join(file), "of an old run").unwrap());
        let mut command = torno(&["run", "--report", files[0], "--part", files[1], "--vcd", files[2]]);
        let output = command.args(wrong).current_dir(folder.path()).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{}", String::from_utf8_lossy(&output.stderr));
        for file in files {
            assert_eq!(fs::read_to_string(folder.path().join(file)).unwrap(), "", "{wrong:?}: {file}");
        }
    }
}

#[test]
fn an_interrupt_gives_the_results_so_far() {
    let folder = tree(&[("a.toml", PASSES), ("b.toml", &never_ends())]);
    let child = torno(&["test", ".", "--junit", "out.xml", "--jobs", "1"])
        .current_dir(folder.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    wait_until_interruptible(u64::from(child.id()));
    std::thread::sleep(std::time::Duration::from_secs(1));
    kill("-INT", u64::from(child.id()));
    let output = child.wait_with_output().unwrap();
    let [out, err] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    assert_eq!(output.status.code(), Some(130), "{out}{err}");
    assert!(out.ends_with("\n1 passed, 1 not run\n"), "{out}");
    assert!(err.ends_with("torno: interrupted: 1 of 2 scenarios are done\n"), "{err}");
    let xml = fs::read_to_string(folder.path().join("out.xml")).unwrap();
    assert_eq!(attributes(&xml, "testcase").len(), 1, "{xml}");
}

#[test]
fn a_folder_has_the_scenarios_of_all_folders_in_it_and_nothing_else() {
    let folder = tree(&[
        ("z.toml", PASSES),
        ("a/y.toml", PASSES),
        ("a/a/x.toml", PASSES),
        // None of these is meant as a scenario.
        ("a/rig.toml", include_str!("../harness/builtin/lathe.toml")),
        ("a/faults.toml", "seed = 3\n[[fault]]\nboard = \"depth\"\nkind = \"crash\"\n"),
        ("Cargo.toml", "[package]\nname = \"n\"\n"),
        ("notes.txt", BROKEN),
        (".git/broken.toml", BROKEN),
    ]);
    std::os::unix::fs::symlink("..", folder.path().join("a/back")).unwrap();
    let (code, out, err) = test(folder.path(), &["."]);
    assert_eq!(code, Some(0), "{out}{err}");
    let files: Vec<&str> = verdicts(&out).into_iter().map(|(_, file)| file).collect();
    assert_eq!(files, ["./a/a/x.toml", "./a/y.toml", "./z.toml"]);
    // What is named is meant.
    let (code, _, err) = test(folder.path(), &["a/rig.toml"]);
    assert_eq!(code, Some(2), "{err}");
    // What is no TOML could have been a scenario, and one without a name, too.
    for text in ["name = \"a", "[[step]]\ndoes = \"nothing\"\n", "[[stpe]]\nname = 3\n[expect]\n"] {
        let folder = tree(&[("a.toml", text), ("b.toml", PASSES)]);
        let (code, out, _) = test(folder.path(), &["."]);
        assert_eq!((code, verdicts(&out)[0]), (Some(2), ("BROKEN", "./a.toml")), "{text}\n{out}");
    }
    let (code, out, err) = test(folder.path(), &[".git", "z.toml"]);
    assert_eq!((code, out.lines().count()), (Some(2), 3), "a folder that is named is looked at: {out}{err}");
    let none = tree(&[("Cargo.toml", "[package]\n")]);
    let (code, _, err) = test(none.path(), &["."]);
    assert_eq!(code, Some(2));
    assert!(err.contains("expected scenarios (*.toml), found none"), "{err}");
}

#[test]
fn scenarios_are_chosen_by_a_text_in_their_name_or_file() {
    let folder = four();
    for (text, chosen) in [
        ("HASTY", &["./b/fail.toml"][..]),
        ("b/pa", &["./b/pass.toml"]),
        ("Jam", &["./a/deep/down/jam.toml"]),
        ("turn", &["./b/fail.toml", "./b/pass.toml"]),
    ] {
        let (_, out, err) = test(folder.path(), &[".", "-k", text]);
        let files: Vec<&str> = verdicts(&out).into_iter().map(|(_, file)| file).collect();
        assert_eq!((files.as_slice(), err.as_str()), (chosen, ""), "{text}");
    }
    // A broken one has a name, too.
    let (code, _, err) = test(folder.path(), &[".", "-k", "typo"]);
    assert!(code == Some(2) && err.contains("broken.toml:2:3"), "{err}");
    let (code, out, err) = test(folder.path(), &[".", "-k", "turnip"]);
    assert_eq!((code, out.as_str()), (Some(2), ""));
    assert!(err.contains("no scenario has 'turnip' in its name or in the path of its file"), "{err}");
    // Of one that is no TOML no one knows the name.
    let folder = tree(&[("a.toml", "name = \"turn"), ("b.toml", PASSES)]);
    let (code, out, _) = test(folder.path(), &[".", "-k", "turn"]);
    assert_eq!((code, verdicts(&out)), (Some(2), vec![("BROKEN", "./a.toml"), ("passed", "./b.toml")]));
}

#[test]
fn a_list_runs_nothing() {
    let folder = four();
    fs::remove_file(folder.path().join("broken.toml")).unwrap();
    fs::write(folder.path().join("c.toml"), never_ends()).unwrap();
    let (code, out, _) = test(folder.path(), &[".", "--list", "-k", "e"]);
    assert_eq!(code, Some(0));
    assert_eq!(out, "./a/deep/down/jam.toml  a jam\n./c.toml                for ever\n");
    let (code, out, _) = test(folder.path(), &[".", "--list", "--json", "-k", "ever"]);
    assert_eq!((code, out.as_str()), (Some(0), "{\"name\":\"for ever\",\"path\":\"./c.toml\"}\n"));
    fs::write(folder.path().join("broken.toml"), BROKEN).unwrap();
    let (code, out, err) = test(folder.path(), &[".", "--list"]);
    assert_eq!((code, out.lines().count()), (Some(2), 4), "{out}{err}");
    assert!(err.contains("broken.toml:2:3"), "{err}");
}

#[test]
fn fail_fast_ends_with_the_first_that_does_not_pass() {
    let folder = tree(&[("a.toml", PASSES), ("b.toml", &fails()), ("c.toml", PASSES), ("d.toml", BROKEN)]);
    for jobs in ["1", "4"] {
        let (code, out, _) = test(folder.path(), &[".", "--fail-fast", "--jobs", jobs, "--junit", "out.xml"]);
        assert_eq!((code, verdicts(&out)), (Some(1), vec![("passed", "./a.toml"), ("FAILED", "./b.toml")]), "{out}");
        assert!(out.ends_with("\n1 failed, 1 passed, 2 not run\n"), "{out}");
        let xml = fs::read_to_string(folder.path().join("out.xml")).unwrap();
        assert_eq!(attributes(&xml, "testcase").len(), 2, "{xml}");
    }
    fs::write(folder.path().join("a.toml"), shows_nothing()).unwrap();
    let (code, out, _) = test(folder.path(), &[".", "--fail-fast"]);
    assert_eq!((code, verdicts(&out)), (Some(1), vec![("INCONCLUSIVE", "./a.toml")]), "{out}");
}

/// With few open files there is room for the one board of the servo stand, and not for the four of the lathe.
#[test]
fn a_rig_that_breaks_costs_its_own_scenario_only() {
    let stand = "name = \"a stand\"\nrig = \"servo\"\n[[step]]\ndoes = \"a while\"\nrun = \"10 ms\"\n";
    let folder = tree(&[("a.toml", PASSES), ("b.toml", stand)]);
    let limited = |files: u32| {
        let command = "ulimit -n $1; exec \"$0\" test . --processes --jobs 1 --junit out.xml";
        let torno = env!("CARGO_BIN_EXE_torno");
        let mut shell = Command::new("sh");
        shell.args(["-c", command, torno, &files.to_string()]).env_remove("RUST_LOG").current_dir(folder.path());
        shell.output().unwrap()
    };
    let one = |output: &Output| String::from_utf8_lossy(&output.stdout).ends_with("\n1 broken, 1 passed\n");
    let output = (12..40).map(limited).find(one).unwrap();
    let err = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{err}");
    assert!(err.starts_with("torno: ./a.toml: cannot start board"), "{err}");
    let xml = fs::read_to_string(folder.path().join("out.xml")).unwrap();
    assert!(xml.contains("<error message=\"cannot start board") && xml.contains("errors=\"1\""), "{xml}");
}
