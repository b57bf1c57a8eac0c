//! The command line: bad input is refused before anything runs, with a message that says where and what was expected.

use std::fs;
use std::io::{Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use crate::common::{folder, output, torno, wait_until};

const LATHE: &str = include_str!("../harness/builtin/lathe.toml");

/// A command is refused as it must be: exit code 2, nothing on standard output, and on standard error these words.
fn refused(arguments: &[&str], expected: &[&str]) {
    static MARK: AtomicU32 = AtomicU32::new(0);
    let mark = format!("TORNO_TEST_MARK={}.{}", std::process::id(), MARK.fetch_add(1, Ordering::Relaxed));
    let (name, value) = mark.split_once('=').unwrap();
    let output = torno(arguments).env(name, value).output().unwrap();
    is_refusal(&output, &arguments.join(" "), expected);
    wait_until("no process is left of it", || !is_anywhere(&mark));
}

/// Whether some process has this in its environment, as all have that were started by one that had it.
fn is_anywhere(mark: &str) -> bool {
    let has_it = |environment: Vec<u8>| environment.split(|byte| *byte == 0).any(|entry| entry == mark.as_bytes());
    let processes = fs::read_dir("/proc").unwrap().flatten();
    processes.filter_map(|process| fs::read(process.path().join("environ")).ok()).any(has_it)
}

fn is_refusal(output: &Output, what: &str, expected: &[&str]) {
    let text = String::from_utf8(output.stderr.clone()).unwrap();
    assert_eq!(output.status.code(), Some(2), "{what}: {text}");
    assert_eq!(String::from_utf8_lossy(&output.stdout), "", "{what}");
    assert!(!text.contains("panicked"), "{what}: {text}");
    for words in expected {
        assert!(text.contains(words), "{what}: {text}\nlacks: {words}");
    }
    says_everything_once(&text);
}

/// No part of a message is said twice, as happens when both an error and what wraps it tell the cause.
fn says_everything_once(text: &str) {
    for part in text.split([':', ';']).map(str::trim).filter(|part| part.len() > 20) {
        assert_eq!(text.matches(part).count(), 1, "said twice: {part}\n{text}");
    }
}

/// A file in the folder, and its path as a word of the command line.
fn file(folder: &Path, name: &str, content: impl AsRef<[u8]>) -> String {
    let path = folder.join(name);
    fs::write(&path, content).unwrap();
    path.to_str().unwrap().to_owned()
}

// --- rig files ------------------------------------------------------------------------------------------------------

#[test]
fn a_broken_rig_file_is_refused_with_file_line_and_what_was_expected() {
    let line_of = |text: &str| LATHE[..LATHE.find(text).unwrap()].matches('\n').count() + 1;
    // What is replaced by what, in which line the complaint is, and what it says.
    let depth = "kind = \"depth\"";
    for (from, to, line, expected) in [
        ("tx_fifo = 1", "tx_fivo = 1", line_of("tx_fifo"), "unknown field `tx_fivo`: did you mean 'tx_fifo'?"),
        ("[pc]", "[pc", line_of("[pc]"), "expected"),
        ("name = \"lathe\"", "name = lathe", line_of("name"), "expected"),
        ("name = \"lathe\"", "", 1, "missing field `name`"),
        ("name = \"lathe\"", "name = \"a/b\"", line_of("name"), "expected a name of 1 to 32"),
        (
            "dialect = \"lathe\"",
            "dialect = \"mill\"",
            line_of("dialect"),
            "unknown dialect 'mill': expected one of lathe, servo",
        ),
        ("baud = 9600", "baud = \"9600\"", line_of("baud"), "invalid type: string \"9600\", expected u32"),
        ("baud = 9600", "baud = 0", line_of("baud"), "baud = 0: expected 50 to 4000000"),
        ("baud = 9600", "baud = 5000000", line_of("baud"), "baud = 5000000: expected 50 to 4000000"),
        ("baud = 9600", "baud = -1", line_of("baud"), "expected u32"),
        ("tx_fifo = 1", "tx_fifo = 65", line_of("tx_fifo"), "tx_fifo = 65: expected 1 to 64"),
        ("tx_fifo = 1", "clock_ppm = nan", line_of("tx_fifo"), "expected -200000 to 200000"),
        (depth, "kind = \"milling\"", line_of(depth), "unknown kind of board 'milling': expected one of master, "),
        (depth, "kind = 4", line_of(depth), "invalid type: integer `4`, expected a string"),
        (depth, "kind = \"depth\"\nsettings.plant.rpm = 0", line_of(depth) + 1, "rpm: expected 0.1 to 1000, found 0"),
        (
            depth,
            "kind = \"depth\"\nsettings.plant.rpn = 8",
            line_of(depth) + 1,
            "unknown field `rpn`: did you mean 'rpm'?",
        ),
        (depth, "kind = \"depth\"\nsettings.rpm = 8", line_of(depth) + 1, "`rpm`: did you mean 'plant.rpm'?"),
        (depth, "kind = \"depth\"\nsettings.plant.rpm = \"8\"", line_of(depth) + 1, "expected f64"),
        ("name = \"depth\"", "name = \"master\"", line_of("name = \"depth\""), "'master' is already taken"),
        ("\"depth.master\"", "\"depth\"", line_of("\"depth.master\""), "'depth': expected board.port"),
        ("\"depth.master\"", "\"dept.master\"", line_of("\"depth.master\""), "expected one of master, spindle"),
        ("\"depth.master\"", "\"depth.pc\"", line_of("\"depth.master\""), "no port 'pc': expected one of master"),
        ("\"depth.master\"", "\"spindle.master\"", line_of("\"depth.master\""), "is already connected"),
        ("\"depth.master\"", "\"master.transverse\"", line_of("\"depth.master\""), "'master' is linked to itself"),
        ("name = \"depth\"", "name = \"pc\"", line_of("name = \"depth\""), "the name 'pc' is the PC's"),
        ("port = \"master.pc\"", "", line_of("[pc]"), "missing field `port`"),
    ] {
        let folder = folder();
        assert!(LATHE.contains(from), "{from}");
        let path = file(folder.path(), "my.toml", LATHE.replacen(from, to, 1));
        let place = format!("{path}:{line}:");
        for command in ["run", "up"] {
            refused(&[command, &path], &[&place, expected]);
        }
    }
}

#[test]
fn what_cannot_be_set_is_refused_with_the_nearest_name() {
    for (set, expected) in [
        ("spindle.controller.kk=1", "unknown field `kk`: did you mean 'k'?"),
        ("spindle.contoller.k=1", "unknown field `contoller`: did you mean 'controller'?"),
        ("spindel.controller.k=1", "there is no board 'spindel': did you mean 'spindle'?"),
        ("spindle.controller.form=litteral", "unknown variant `litteral`: did you mean 'literal'?"),
        ("spindle.controller.k=-1", "controller.k: expected 0 to 100, found -1"),
        ("spindle.controller.k", "expected PLACE=VALUE"),
    ] {
        for command in ["run", "up"] {
            refused(&[command, "--set", set], &[&format!("torno: --set '{set}': "), expected]);
        }
    }
}

#[test]
fn a_rig_file_that_is_no_text_is_refused_with_file_and_line() {
    let folder = folder();
    let path = file(folder.path(), "my.toml", [b"# one\n# two \xff\n", LATHE.as_bytes()].concat());
    refused(&["run", &path], &[&path, "UTF-8"]);
    refused(&["run", &path], &[&format!("{path}:2:")]);
}

#[test]
fn an_empty_rig_file_is_refused() {
    let folder = folder();
    let path = file(folder.path(), "my.toml", "");
    refused(&["run", &path], &[&path, "missing field `name`"]);
}

#[test]
fn a_rig_that_is_not_there_is_refused_and_the_built_in_ones_are_named() {
    refused(&["run", "/nowhere/my.toml"], &["cannot read the rig file '/nowhere/my.toml'", "No such file", "lathe"]);
    refused(&["up", "lathes"], &["cannot read the rig file 'lathes'", "built-in rigs: lathe"]);
    refused(&["run", "/"], &["cannot read the rig file '/'", "directory"]);
}

// --- programs -------------------------------------------------------------------------------------------------------

#[test]
fn a_broken_program_is_refused_with_file_line_and_what_was_expected() {
    let good = "# a comment\n\n0A 00 00 00 00 00 00 00\n";
    let long = "00 ".repeat(9);
    for (text, expected) in [
        (&b"0A 00 00 00 00 0G 00 00"[..], "line 4, column 16: expected a byte as two hexadecimal digits, found '0G'"),
        (b"0A 00 00 00 00 0 00 00", "line 4, column 16: expected a byte as two hexadecimal digits, found '0'"),
        (b"0A 00 00 00 00 000 00 00", "line 4, column 16: expected a byte as two hexadecimal digits, found '000'"),
        (b"0A 00 00 00 00 -1 00 00", "line 4, column 16: expected a byte as two hexadecimal digits, found '-1'"),
        (b"0A,00,00,00,00,00,00,00", "line 4, column 1: expected a byte as two hexadecimal digits, found '0A,"),
        (b"0A 00 00 00 00 00 00 # 00", "line 4: expected 8 bytes, found 7"),
        (long.as_bytes(), "line 4: expected 8 bytes, found 9"),
        (b"\n# \xff\xfe", "line 5: expected text (UTF-8)"),
        (b"0A 00 \xc3\x28 00 00 00 00 00", "line 4: expected text (UTF-8)"),
    ] {
        let folder = folder();
        let path = file(folder.path(), "my.frames", [good.as_bytes(), text].concat());
        refused(&["run", &path], &[&format!("{path}: {expected}")]);
        refused(&["run", "lathe", &path], &[&format!("{path}: {expected}")]);
        // Before the port is opened.
        refused(&["send", &path, "--port", "/nowhere"], &[&format!("{path}: {expected}")]);
    }
}

#[test]
fn a_program_without_frames_is_refused() {
    let folder = folder();
    for (name, text) in [("empty.frames", ""), ("comments.frames", "# nothing\n\n  # at all\n")] {
        let path = file(folder.path(), name, text);
        refused(&["run", &path], &[&path, "expected at least one frame", "found none"]);
    }
}

#[test]
fn a_program_that_is_not_there_is_refused() {
    refused(&["run", "/nowhere/my.frames"], &["cannot read the program '/nowhere/my.frames'", "No such file"]);
    refused(&["run", "lathe", "/"], &["cannot read the program '/'", "directory"]);
    refused(&["send", "/nowhere/my.frames", "--port", "/nowhere"], &["cannot read the program '/nowhere/my.frames'"]);
}

#[test]
fn a_program_with_crlf_and_no_last_newline_is_read() {
    let folder = folder();
    let path = file(folder.path(), "my.frames", "0a 00 00 00 00 00 00 00\r\n\r\n00 00 00 00 00 00 00 00 # stop");
    let output = output(&["run", &path, "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(crate::common::json(&output)["frames"]["accepted"], 2);
}

// --- links, dumps, ports --------------------------------------------------------------------------------------------

#[test]
fn a_link_that_exists_is_refused_and_left_alone() {
    let folder = folder();
    let taken = file(folder.path(), "file", "precious");
    let dangling = folder.path().join("dangling");
    std::os::unix::fs::symlink("/nowhere", &dangling).unwrap();
    let subfolder = folder.path().join("folder");
    fs::create_dir(&subfolder).unwrap();
    for path in [&taken, dangling.to_str().unwrap(), subfolder.to_str().unwrap()] {
        refused(&["up", "--link", path], &[path, "already exists", "--link"]);
    }
    assert_eq!(fs::read_to_string(&taken).unwrap(), "precious");
    assert_eq!(fs::read_link(&dangling).unwrap(), Path::new("/nowhere"));
}

#[test]
fn a_link_in_a_folder_that_is_not_there_or_cannot_be_written_is_refused() {
    let folder = folder();
    let no_folder = file(folder.path(), "file", "");
    // Not even root can write into /proc.
    for parent in ["/nowhere", &no_folder, "/proc"] {
        let path = format!("{parent}/pc");
        refused(&["up", "--link", &path], &[&format!("cannot put a link into the folder {parent}"), "--link"]);
    }
}

#[test]
fn a_dump_that_cannot_be_written_is_refused_before_anything_runs() {
    let folder = folder();
    let no_folder = file(folder.path(), "file", "");
    let paths = ["/nowhere/x.vcd".to_owned(), format!("{no_folder}/x.vcd"), "/proc/x.vcd".to_owned(), "/".to_owned()];
    for path in paths {
        // At pace 1 the program itself would take two minutes.
        let mut child = torno(&["run", "--pace", "1", "--vcd", &path])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        wait_until("it ends at once", || child.try_wait().unwrap().is_some());
        is_refusal(&child.wait_with_output().unwrap(), &path, &[&format!("cannot write '{path}'")]);
    }
}

#[test]
fn a_port_that_is_not_there_or_no_serial_port_is_refused() {
    let folder = folder();
    let program = file(folder.path(), "my.frames", "00 00 00 00 00 00 00 00");
    refused(&["send", &program, "--port", "/nowhere/pc"], &["cannot open the serial port '/nowhere/pc'"]);
    for port in [&program, "/dev/null", folder.path().to_str().unwrap()] {
        refused(&["send", &program, "--port", port], &[&format!("'{port}' is no serial port: expected a terminal")]);
    }
}

// --- words of the command line --------------------------------------------------------------------------------------

#[test]
fn a_pace_that_is_none_is_refused() {
    for command in ["run", "up"] {
        for pace in ["0", "-1", "fast", "", "nan", "inf", "1e9"] {
            refused(
                &[command, &format!("--pace={pace}")],
                &["--pace", "expected 'max' or a number from 0.001 to 100000"],
            );
        }
    }
}

#[test]
fn words_that_are_not_known_are_refused() {
    for (arguments, expected) in [
        (&["mill"][..], "unrecognized subcommand 'mill'"),
        (&["run", "--fast"], "unexpected argument '--fast'"),
        (&["run", "lathe", "a.frames", "b.frames"], "unexpected argument 'b.frames'"),
        (&["run", "--seed", "x"], "invalid value 'x' for '--seed"),
        (&["board"], "<KIND>"),
        (
            &["board", "mill"],
            "[possible values: master, spindle, transverse, depth, dspic, servo, grbl, engraver, echo]",
        ),
        (&["send", "a.frames"], "--port"),
        (&["send", "a.frames", "--port", "x", "--baud", "0"], "invalid value '0' for '--baud"),
        (&["run", "--part", "x.png"], "the drawing is SVG: expected a name that ends in .svg"),
        (&["identify", "lathe", "spindle", "--plot", "x.jpg"], "expected a name that ends in .svg or .png"),
        (&["tune", "lathe", "spindle", "-o", "x.pdf"], "expected a name that ends in .svg or .png"),
        (&["run", "--vcd", "x.vcd", "--vcd-step", "3 ns"], "expected 1, 10 or 100 of ns or us, or 1 ms"),
        (&["run", "--in-process", "--processes"], "cannot be used with"),
        (&["run", "--patience", "5 parsecs"], "expected a time, such as '1.5 s'"),
        (&["send", "a.frames", "--port", "x", "--patience", "0"], "expected 10 ms to 86400 s"),
    ] {
        refused(arguments, &[expected]);
    }
}

#[test]
fn a_dash_is_standard_output_and_the_summary_then_goes_to_standard_error() {
    let output = output(&["run", "--in-process", "--report", "-"]);
    let (page, text) = (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    assert!(output.status.success() && page.starts_with("<!DOCTYPE html>"), "{text}");
    assert!(page.trim_end().ends_with("</html>") && text.contains("completed"), "{text}");
    assert!(!Path::new("-").exists());
}

#[test]
fn a_picture_is_what_its_name_says() {
    let folder = folder();
    for (name, begins) in [("x.png", &b"\x89PNG"[..]), ("x.svg", b"<svg"), ("x.SVG", b"<svg")] {
        let path = folder.path().join(name);
        let picture = ["--plot", path.to_str().unwrap()];
        let step = ["identify", "lathe", "spindle", "--input", "step", "--for", "8 s"];
        assert!(output(&[&step[..], &picture].concat()).status.success());
        assert!(fs::read(&path).unwrap().starts_with(begins), "{name}");
    }
}

#[test]
fn a_value_of_another_type_is_named_where_it_is_refused() {
    let folder = folder();
    for (value, found) in [("300", "'300': expected a ratio"), ("true", "'true': expected a ratio")] {
        let faults = format!("[[fault]]\nboard = \"spindle\"\nkind = \"load\"\nvalue = {value}\n");
        let path = file(folder.path(), "faults.toml", faults);
        refused(&["run", "--faults", &path], &["faults.toml:4:9: ", found]);
    }
}

#[test]
fn a_bare_torno_says_in_five_lines_what_it_is_and_how_to_start() {
    let output = torno(&[]).output().unwrap();
    let (text, log) = (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    assert_eq!((output.status.code(), log.as_str()), (Some(0), ""));
    assert_eq!(text.lines().count(), 5, "{text}");
    assert!(text.lines().all(|line| line.chars().count() <= 100), "{text}");
    for words in ["torno emulates", "torno run", "torno up", "torno help", "cargo run -- run"] {
        assert!(text.contains(words), "{text}\nlacks: {words}");
    }
}

#[test]
fn the_help_names_what_there_is_and_fits_the_screen() {
    let help = |arguments: &[&str]| {
        let mut command = torno(arguments);
        let output = command.env_remove("COLUMNS").output().unwrap();
        assert_eq!(output.status.code(), Some(0));
        let text = String::from_utf8(output.stdout).unwrap();
        let widest = text.lines().map(|line| line.chars().count()).max().unwrap();
        assert!(widest <= 100, "{arguments:?}: {widest} columns");
        text
    };
    let contains = |text: &str, words: &[&str]| {
        words.iter().for_each(|words| assert!(text.contains(words), "{text}\nlacks: {words}"));
    };
    contains(
        &help(&["--help"]),
        &["run", "up", "send", "board", "Exit status: 0 ", ", 1 ", ", 2 ", ", 3 ", "RUST_LOG"],
    );
    let run = help(&["run", "--help"]);
    contains(&run, &["[default: lathe]", "[default: a stepped shaft]", "[default: max]", "--in-process", "--json"]);
    contains(&run, &["--seed", "[default: what", "--vcd"]);
    contains(&help(&["up", "--help"]), &["[default: lathe]", "[default: 1]", "--link", "RIG-pc", "--json"]);
    contains(&help(&["send", "--help"]), &["--port", "[default: 9600]", "[default: \"5 s\"]"]);
    help(&["board", "--help"]);
}

// --- board ----------------------------------------------------------------------------------------------------------

/// `torno board spindle` with this for its standard input.
fn board(stdin: Stdio) -> Command {
    let mut command = torno(&["board", "spindle"]);
    command.stdin(stdin).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

#[test]
fn a_board_that_a_person_starts_says_what_to_start_instead() {
    let pipe = || {
        let (reader, _writer) = std::io::pipe().unwrap();
        reader
    };
    for stdin in [Stdio::null(), fs::File::open("/etc/passwd").unwrap().into(), pipe().into()] {
        is_refusal(&board(stdin).output().unwrap(), "board", &["socket", "'torno up' or 'torno run'"]);
    }
}

#[test]
fn a_board_whose_harness_closes_the_socket_ends_without_complaint() {
    let (ours, theirs) = UnixStream::pair().unwrap();
    let child = board(OwnedFd::from(theirs).into()).spawn().unwrap();
    drop(ours);
    let output = child.wait_with_output().unwrap();
    assert_eq!((output.status.code(), &*output.stderr), (Some(0), &b""[..]));
}

#[test]
fn a_board_that_cannot_understand_its_harness_says_so() {
    for nonsense in [&[0xff; 64][..], b"\x04\0\0\0\xff\xff\xff\xff", b"GET / HTTP/1.1\r\n\r\n"] {
        let (mut ours, theirs) = UnixStream::pair().unwrap();
        let child = board(OwnedFd::from(theirs).into()).spawn().unwrap();
        ours.write_all(nonsense).unwrap();
        let output = child.wait_with_output().unwrap();
        is_refusal(&output, "board", &["the harness cannot be understood"]);
        let mut answer = Vec::new();
        ours.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        // The rest of what it was sent has not been read: the connection may end with an error.
        ours.read_to_end(&mut answer).ok();
        assert_eq!(answer, b"");
    }
}

// --- standard output ------------------------------------------------------------------------------------------------

#[test]
fn a_result_that_nobody_reads_is_no_error() {
    for arguments in [&["run"][..], &["run", "--json"]] {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = torno(arguments).stdout(writer).stderr(Stdio::piped()).output().unwrap();
        assert_eq!(String::from_utf8_lossy(&output.stderr), "", "{arguments:?}");
        assert_eq!(output.status.code(), Some(0), "{arguments:?}");
    }
}

#[test]
fn a_result_that_cannot_be_written_is_an_error() {
    let full = fs::File::options().write(true).open("/dev/full").unwrap();
    let output = torno(&["run", "--json"]).stdout(full).stderr(Stdio::piped()).output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && text.contains("cannot write the result"), "{text}");
}
