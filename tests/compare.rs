//! `torno compare`, and what it compares: the lathe of four boards and the one of one board.

use std::fs;
use std::path::Path;

use crate::common::play::DEMONSTRATION;
use crate::common::{folder, json, output};
use serde_json::Value;
use torno::job::Outcome;
use torno::play::Play;
use torno::rig::Driver;
use torno::rig::file::RigFile;
use torno_bus::PcEvent;
use torno_engine::Fact;
use torno_protocol::lathe::{Program, XON};

/// A taper by small steps: both axes at once.
const TAPER: &str = "
32 E1 0E 10 00 00 14 01   # the tool to the bar
32 32 02 58 01 00 02 00
32 32 02 58 01 00 02 00
32 32 02 58 01 00 02 00
32 E1 00 00 00 00 1A 00   # and back
00 E1 04 B0 01 00 00 00";
/// Nothing but odd distances at odd speeds, and standstills; it does not end where it began.
const ODD: &str = "
0B 01 00 07 00 00 00 00
C8 E1 7F FF 01 00 01 01
0A 71 03 E9 00 00 03 00
0A 03 00 01 01 00 00 01
00 00 00 00 00 00 07 01";

/// A rig's axes and its spindle, by the names of board and quantity: where they are, and what speed is wanted.
fn quantities(rig: &str) -> [(&'static str, &'static str); 3] {
    match rig {
        "lathe" => [("transverse", "position_counts"), ("depth", "position_counts"), ("spindle", "set_point_rpm")],
        _ => [
            ("dspic", "transverse_position_counts"),
            ("dspic", "depth_position_counts"),
            ("dspic", "spindle_set_point_rpm"),
        ],
    }
}

/// Where the axes are whenever the PC is told that all is done, and at the end; and the speeds that are wanted, one
/// after the other.
fn stations(rig: &str, program: &str) -> (Vec<[i64; 2]>, Vec<i64>) {
    let file = RigFile::load(rig).unwrap();
    let places = quantities(rig).map(|(board, quantity)| {
        let node = file.boards.iter().position(|other| other.name == board).unwrap();
        let signals = &file.boards[node].description.signals;
        (node, signals.iter().position(|signal| signal.name == quantity).unwrap())
    });
    let pc = file.boards.len();
    let play = Play::new(file, Program::parse(program).unwrap(), Driver::InProcess);
    let mut facts = Vec::new();
    let run = play.run(|progress| facts.extend(progress.facts.iter().cloned()));
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    assert_eq!(runtime.block_on(run).unwrap().outcome, Outcome::Completed);
    // Boards are settled one after the other.
    facts.retain(|fact| !matches!(fact, Fact::Edges { .. }));
    facts.sort_by_key(Fact::at);
    let (mut values, mut stations, mut speeds) = ([0; 2], Vec::new(), Vec::new());
    for fact in facts {
        match fact {
            Fact::Telemetry { node, signal, value, .. } => {
                let found = places.iter().position(|place| *place == (node, usize::from(signal)));
                match found {
                    Some(axis @ (0 | 1)) => values[axis] = value,
                    Some(_) => speeds.push(value),
                    None => {}
                }
            }
            Fact::Event { node, event, value, .. }
                if node == pc && PcEvent::from_numbers(event, value) == Some(PcEvent::Received(XON)) =>
            {
                stations.push(values);
            }
            _ => {}
        }
    }
    stations.push(values);
    (stations, speeds)
}

#[test]
fn the_same_programs_give_the_same_part() {
    for (program, frames) in [(DEMONSTRATION, 30), (TAPER, 6), (ODD, 5)] {
        let ((four, four_speeds), (one, one_speeds)) = (stations("lathe", program), stations("lathe-dspic", program));
        assert_eq!((four.len(), one.len()), (frames + 1, frames + 1));
        assert_eq!(four_speeds, one_speeds);
        for (n, (a, b)) in four.iter().zip(&one).enumerate() {
            let [z, x] = [0, 1].map(|axis| (a[axis] - b[axis]).abs());
            // In position is within a count, either side.
            assert!(z <= 2 && x <= 1, "after frame {}: {a:?} and {b:?}", n + 1);
        }
        let end = four.len() - 1;
        assert_eq!(four[end], one[end], "once everything has settled");
        assert!(four.iter().any(|station| station[0] != 0), "it moves");
    }
}

fn row<'a>(found: &'a Value, quantity: &str) -> &'a Value {
    found["rows"].as_array().unwrap().iter().find(|row| row["quantity"] == quantity).unwrap()
}

fn values(found: &Value, quantity: &str) -> [Option<f64>; 2] {
    let values = &row(found, quantity)["values"];
    [values[0].as_f64(), values[1].as_f64()]
}

fn near(found: Option<f64>, expected: f64, tolerance: f64) {
    let found = found.unwrap();
    assert!((found - expected).abs() <= tolerance, "{found}, expected {expected}");
}

/// One character is 1.042 ms.
#[test]
fn what_lies_between_boards_costs_the_characters_that_go_over_it() {
    let output = output(&["compare", "lathe", "lathe-dspic", "--json"]);
    assert_eq!(output.status.code(), Some(0));
    let found = json(&output);
    assert_eq!((&found["frames"], values(&found, "boards")), (&30.into(), [Some(4.0), Some(1.0)]));
    let [four, one] = values(&found, "last byte to ACK, not held");
    // The feed's part has four characters, which wait for a tick of the software UARTs.
    near(one, 1.0, 0.1);
    near(four, 5.2, 0.2);
    let [four, one] = values(&found, "XON to ACK of the frame held");
    near(one, 1.042, 0.01);
    near(four, 4.2, 0.1);
    let [four, one] = values(&found, "the PC is held").map(Option::unwrap);
    assert!(one < four && one > 100.0, "{one} {four}");
    assert_eq!(values(&found, "from the PC"), [Some(240.0), Some(240.0)]);
    let [to_four, to_one] = values(&found, "to the PC");
    assert_eq!(to_four, to_one, "30 ACK, 29 XOFF, 30 XON");
    assert_eq!(to_four, Some(89.0));
    // A part, a byte's enquiries, and nothing of it on one board.
    assert_eq!(values(&found, "between boards")[1], Some(0.0));
    let [parts, none] = values(&found, "  master_to_transverse");
    assert!(parts.unwrap() >= 4.0 * 30.0 && none.is_none());
    for quantity in ["transverse: ends at", "depth: ends at"] {
        assert_eq!(values(&found, quantity), [Some(0.0), Some(0.0)]);
    }
    let errors = values(&found, "transverse: worst following error").map(Option::unwrap);
    assert!(errors[0] > 0.0 && errors[0] == errors[1], "{errors:?}");
}

#[test]
fn a_rig_is_like_itself_and_the_text_says_so() {
    let folder = folder();
    let program = file(folder.path(), "odd.frames", ODD);
    let output = output(&["compare", "lathe", "lathe", &program]);
    assert_eq!(output.status.code(), Some(0));
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("odd.frames, 5 frames"), "{text}");
    let whole = text.lines().find(|line| line.starts_with("whole program, s")).unwrap();
    let words: Vec<&str> = whole.split_whitespace().skip(3).collect();
    assert!(words[0] == words[1] && words[2..] == ["+0.000", "1.000"], "{whole}");
}

#[test]
fn a_row_without_a_difference_ends_where_its_words_end() {
    let text = String::from_utf8(output(&["compare", "lathe", "lathe-dspic"]).stdout).unwrap();
    let row = text.lines().find(|line| line.contains("depth_to_master, bytes")).unwrap();
    assert!(row.ends_with(" -"), "{row:?}");
    assert!(text.lines().all(|line| line.trim_end() == line && !line.contains('\x1b')), "{text}");
}

fn file(folder: &Path, name: &str, text: &str) -> String {
    let path = folder.join(name);
    fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn what_is_set_goes_to_the_rigs_that_have_such_a_place() {
    let folder = folder();
    let program = file(folder.path(), "odd.frames", ODD);
    let set = |place: &str| output(&["compare", "lathe", "lathe-dspic", &program, "--json", "--set", place]);
    let found = json(&set("dspic.depth.plant.rpm=16"));
    assert_eq!(
        (&found["rigs"][0]["set"], &found["rigs"][1]["set"][0]),
        (&Value::Array(vec![]), &"dspic.depth.plant.rpm=16".into())
    );
    let [four, one] = values(&found, "ACK to XON").map(Option::unwrap);
    assert!(one < four, "a faster infeed: {one} {four}");
    let both = json(&set("pc.tx_fifo=1"));
    assert_eq!([0, 1].map(|rig| both["rigs"][rig]["set"][0] == "pc.tx_fifo=1"), [true; 2]);
    let neither = set("dspik.depth.plant.rpm=16");
    assert_eq!(neither.status.code(), Some(2));
    let error = String::from_utf8(neither.stderr).unwrap();
    assert!(error.contains("on lathe-dspic, there is no board 'dspik': did you mean 'dspic'?"), "{error}");
}

#[test]
fn a_program_that_fails_on_one_is_shown_and_is_no_success() {
    let folder = folder();
    // The motor of the infeed of one of them cannot move its slide.
    let program = file(folder.path(), "deep.frames", "0A 00 00 00 00 00 05 00\n0A 00 00 00 00 00 05 01");
    let arguments = ["compare", "lathe", "lathe-dspic", &program, "--set", "depth.plant.friction=2"];
    let output = output(&arguments);
    assert_eq!(output.status.code(), Some(1));
    let text = String::from_utf8(output.stdout).unwrap();
    let outcome: Vec<&str> =
        text.lines().find(|line| line.starts_with("outcome")).unwrap().split_whitespace().collect();
    assert_eq!(outcome, ["outcome", "faulted", "completed"]);
    assert!(text.contains("set      lathe: depth.plant.friction=2"), "{text}");
}

#[test]
fn what_cannot_be_compared_is_said() {
    for (arguments, expected) in [
        (&["compare", "lathe"][..], "<OTHER>"),
        (
            &["compare", "lathe", "late"],
            "cannot read the rig file 'late' (built-in rigs: lathe, lathe-dspic, servo, lathe-grbl, engraver, echo)",
        ),
        (&["compare", "lathe", "servo"], "the rig 'servo' speaks servo: use 'torno servo"),
        (&["compare", "lathe", "lathe-dspic", "none.frames"], "cannot read the program 'none.frames'"),
        (&["identify", "lathe-dspic", "dspic"], "board 'dspic' has several motors: expected one of dspic.spindle, "),
    ] {
        let output = output(arguments);
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && error.contains(expected), "{arguments:?}: {error}");
    }
}
