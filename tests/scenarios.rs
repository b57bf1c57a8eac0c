//! The scenarios in the folder beside this file: all hold, the same with processes and without, and what is wrong with
//! one is told.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crate::common::{output, test};
use torno::fault::{BOARD_KINDS, LINE_KINDS};
use torno::rig::Driver;
use torno::scenario::prose::{self, board, line, reply};
use torno::scenario::{self, Outcome, Scenario};
use torno::sweep::Scene;
use torno_protocol::time::Span;

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/scenarios");

/// In these, what happens depends on the seed.
const NOISY: [&str; 5] =
    ["noise-in-frames", "noise-in-answers", "noise-on-an-idle-line", "noise-on-all-slaves", "any-fault-at-any-moment"];
const SEEDS: u64 = 50;

fn paths() -> Vec<PathBuf> {
    let mut paths: Vec<PathBuf> = fs::read_dir(FOLDER).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
    paths.sort();
    paths
}

fn load(path: &Path, seed: Option<u64>) -> Scenario {
    Scenario::load(path, seed).unwrap_or_else(|error| panic!("{error}"))
}

fn named(name: &str, seed: Option<u64>) -> Scenario {
    load(&Path::new(FOLDER).join(format!("{name}.toml")), seed)
}

fn processes() -> Driver {
    Driver::Processes { exe: env!("CARGO_BIN_EXE_torno").into() }
}

fn run(scenario: &Scenario, driver: &Driver) -> Outcome {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(scenario::run(scenario, driver)).unwrap()
}

/// The same, no further than so far at once.
fn in_slices(scenario: &Scenario, slice: Span) -> Outcome {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(scenario::run_in_slices(scenario, &Driver::InProcess, slice)).unwrap()
}

/// Does so many things, two at once.
fn for_all(count: usize, act: impl Fn(usize) + Sync) {
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                while let Some(n) = Some(next.fetch_add(1, Ordering::Relaxed)).filter(|n| *n < count) {
                    act(n);
                }
            });
        }
    });
}

/// Every `kind` anywhere in a file.
fn kinds(value: &toml::Value, found: &mut BTreeSet<String>) {
    match value {
        toml::Value::Table(table) => {
            found.extend(table.get("kind").and_then(toml::Value::as_str).map(str::to_owned));
            table.values().for_each(|value| kinds(value, found));
        }
        toml::Value::Array(values) => values.iter().for_each(|value| kinds(value, found)),
        _ => {}
    }
}

#[test]
fn every_scenario_holds_and_twice_it_is_the_same() {
    let paths = paths();
    assert!(paths.len() >= 34, "only {}", paths.len());
    for_all(paths.len(), |n| {
        let scenario = load(&paths[n], None);
        let [once, twice] = [(); 2].map(|()| run(&scenario, &Driver::InProcess));
        let failures: Vec<String> = once.failures.iter().map(ToString::to_string).collect();
        assert!(failures.is_empty(), "{}\n{}", paths[n].display(), failures.join("\n"));
        assert_eq!((once.digest, once.end), (twice.digest, twice.end), "{}", paths[n].display());
    });
}

#[test]
fn every_kind_of_fault_occurs_in_a_scenario() {
    let mut found = BTreeSet::new();
    for path in paths() {
        kinds(&toml::from_str(&fs::read_to_string(path).unwrap()).unwrap(), &mut found);
    }
    let known: BTreeSet<String> = LINE_KINDS.iter().chain(&BOARD_KINDS).map(|kind| (*kind).to_owned()).collect();
    assert_eq!(found, known);
}

#[test]
fn names_are_unique_and_every_scenario_prescribes_something() {
    let mut names = BTreeSet::new();
    for path in paths() {
        let scenario = load(&path, None);
        assert!(names.insert(scenario.name.clone()), "two are called '{}'", scenario.name);
        assert!(scenario.replies.is_some() || !scenario.finally.is_empty(), "{}", path.display());
    }
}

#[test]
fn with_processes_it_is_the_same() {
    let sample = [
        "healthy-turn",
        "hold-the-pc-through-a-program",
        "overrun-the-master",
        "any-bytes-then-a-frame",
        "crashed-slave",
        "hung-slave",
        "powered-off-slave",
        "brown-out-slave",
        "slow-slave",
        "drift",
        "short",
        "double",
        "broken-at-the-tenth-character",
        "stalled-motor",
    ];
    for_all(sample.len(), |n| {
        let scenario = named(sample[n], None);
        let [inside, outside] = [Driver::InProcess, processes()].map(|driver| run(&scenario, &driver));
        assert_eq!((inside.digest, inside.end), (outside.digest, outside.end), "{}", sample[n]);
        assert_eq!(inside.replies, outside.replies, "{}", sample[n]);
        assert!(outside.failures.is_empty(), "{}: {:?}", sample[n], outside.failures);
    });
}

/// Whether a scenario holds with other seeds is not asked; what happens must be the same.
fn digests_of(name: &str, seeds: u64) -> BTreeSet<String> {
    let digests = std::sync::Mutex::new(BTreeSet::new());
    for_all(seeds as usize, |seed| {
        let scenario = named(name, Some(seed as u64));
        let [inside, outside] = [Driver::InProcess, processes()].map(|driver| run(&scenario, &driver));
        assert_eq!(inside.digest, outside.digest, "{name}, seed {seed}");
        // However time is cut into turns.
        let slice = Span::from_micros(333 + 977 * seed as u64);
        assert_eq!(inside.digest, in_slices(&scenario, slice).digest, "{name}, seed {seed}, {slice} at once");
        assert_eq!(inside.failures, outside.failures, "{name}, seed {seed}");
        digests.lock().unwrap().insert(inside.digest);
    });
    digests.into_inner().unwrap()
}

#[test]
fn a_seed_is_a_run_with_processes_and_without() {
    for name in NOISY {
        let digests = digests_of(name, SEEDS);
        assert!(digests.len() > 1, "{name}: the same with every seed");
    }
}

/// An edge and a sample meet in the same nanosecond once in a million characters or so.
#[test]
fn dense_noise_is_the_same_however_time_is_cut() {
    let lines = ["spindle_to_master", "master_to_depth", "pc_to_master"];
    for_all(4 * lines.len(), |n| {
        let (seed, line) = (n / lines.len(), lines[n % lines.len()]);
        let scenario = |step: &str| {
            let text = format!(
                "name = \"n\"\nseed = {seed}\nend = \"30 s\"\n{step}\
                 [[fault]]\nline = \"{line}\"\nkind = \"noise\"\nperiod = \"300 us\"\n"
            );
            Scenario::parse("noise.toml", &text, None).unwrap()
        };
        let whole = run(&scenario(""), &Driver::InProcess).digest;
        let step = scenario("[[step]]\ndoes = \"waits\"\nrun = \"29 s\"\n");
        assert_eq!(whole, run(&step, &Driver::InProcess).digest, "{line}, seed {seed}");
        assert_eq!(whole, in_slices(&step, Span::from_micros(2_777)).digest, "{line}, seed {seed}");
    });
}

#[test]
fn an_end_before_the_last_step_is_the_same_however_time_is_cut() {
    let run_for = |spans: &[u64]| {
        let step = |ns: &u64| format!("[[step]]\ndoes = \"waits\"\nrun = \"{ns} ns\"\n");
        let steps: String = spans.iter().map(step).collect();
        let text = format!(
            "name = \"e\"\nrig = \"servo\"\nend = \"1 ms\"\n\
             [[step]]\ndoes = \"sends\"\nsend = [\"X 20\"]\n{steps}"
        );
        let outcome = run(&Scenario::parse("end.toml", &text, None).unwrap(), &Driver::InProcess);
        (outcome.digest, outcome.end)
    };
    assert_eq!(run_for(&[1_416_000]), run_for(&[1_000_000, 416_000]));
}

#[test]
fn a_failure_shows_all_that_happened_before_it_in_its_order() {
    let text = "name = \"context\"\n[[step]]\ndoes = \"at rest\"\nsend = [\"00 00 00 00 00 00 00 00\"]\n\
                [[step]]\ndoes = \"for ever\"\nwait = { reply = \"CAN d n\", within = \"1 s\" }\n";
    let scenario = Scenario::parse("context.toml", text, None).unwrap();
    let [inside, sliced] =
        [run(&scenario, &Driver::InProcess), in_slices(&scenario, Span::from_micros(700))].map(|outcome| {
            let context = outcome.failures[0].context.clone();
            assert!(context.iter().any(|line| line.contains("spindle: done")), "{context:?}");
            let mut sorted = context.clone();
            sorted.sort();
            assert_eq!(context, sorted);
            context
        });
    assert_eq!(inside, sliced);
}

#[test]
fn a_failure_shows_frames_as_the_master_takes_them() {
    let text = "name = \"cut short\"\n[[step]]\ndoes = \"three of eight bytes\"\nbytes = \"0A E1 00\"\n\
                [[step]]\ndoes = \"silence\"\nwait = { reply = \"NAK c\", within = \"200 ms\" }\n\
                [[step]]\ndoes = \"a whole frame\"\nsend = [\"00 64 03 84 00 00 00 00\"]\n\
                [[step]]\ndoes = \"for ever\"\nwait = { reply = \"CAN d n\", within = \"1 s\" }\n";
    let outcome = run(&Scenario::parse("cut.toml", text, None).unwrap(), &Driver::InProcess);
    let context = &outcome.failures[0].context;
    let sent = context.iter().filter_map(|line| line.split_once("pc sends ")).map(|(_, frame)| frame);
    assert_eq!(sent.collect::<Vec<_>>(), ["00 64 03 84 00 00 00 00 (a frame)"], "{context:?}");
}

#[test]
fn a_busy_host_changes_nothing() {
    let stop = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                while !stop.load(Ordering::Relaxed) {
                    core::hint::spin_loop();
                }
            });
        }
        let busy = std::panic::catch_unwind(|| NOISY.map(|name| digests_of(name, 3)));
        stop.store(true, Ordering::Relaxed);
        let idle = NOISY.map(|name| digests_of(name, 3));
        assert_eq!(busy.unwrap(), idle);
    });
}

const TURN: &str = r#"name = "a turn"

[[step]]
does = "the carriage goes out"
send = ["00 64 03 84 00 00 00 00"]

[[step]]
does = "it is done"
wait = { reply = "XON", within = "500 ms" }

[expect]
replies = "ACK XON"
"#;

#[test]
fn a_wrong_expectation_is_explained() {
    let (code, out, _, path) = test(TURN);
    assert_eq!(code, Some(1), "{out}");
    // All but the wall time, which differs.
    let lines: Vec<&str> = out.lines().skip(1).collect();
    assert!(out.starts_with("FAILED  a turn "), "{out}");
    let expected = [
        "  seed      0",
        "  step 2    it is done",
        "  expected  the reply XON within 500 ms",
        "  came      ACK",
        "  at        0.510000s",
        "  before    0.017291s  pc sends 00 64 03 84 00 00 00 00 (a frame)",
        "            0.022472s  master: frame 1 distributed",
        "            0.023470s  pc hears ACK",
        "            0.030000s  spindle: done",
        "            0.060000s  depth: done",
        &format!("  again     torno test '{path}' --seed 0"),
        "1 failed, 0 passed",
    ];
    assert_eq!(lines, expected, "{out}");
}

#[test]
fn every_kind_of_expectation_can_fail() {
    let patient = TURN.replace("500 ms", "5 s");
    assert_eq!(test(&patient).0, Some(0));
    let claim = "\nboard = \"transverse\"\nquantity = \"position_counts\"\n";
    for (more, expected, came) in [
        ("[[expect.never]]\nreply = \"ACK\"\n".to_owned(), "never the reply ACK", "it happened"),
        ("[[expect.never]]\nboard = \"depth\"\nevent = \"done\"\n".to_owned(), "never the event 'done'", "it happened"),
        (
            "[[expect.never]]\nline = \"master_to_pc\"\ncharacter = 2\n".to_owned(),
            "never character 2 on master_to_pc",
            "it happened",
        ),
        (
            format!("[[expect.finally]]{claim}equals = 7\n"),
            "finally transverse.position_counts = 7",
            "transverse.position_counts = 900",
        ),
        (
            format!("[[expect.always]]{claim}at_most = 899\n"),
            "always transverse.position_counts ≤ 899",
            "transverse.position_counts = 901",
        ),
        (
            "[[fault]]\nname = \"far\"\nline = \"pc_to_master\"\nkind = \"drop\"\nnth = 9\n".to_owned(),
            "the fault 'far'",
            "it began at 0.000000s, but character 9 from then on was never sent on pc_to_master",
        ),
    ] {
        let (code, out, ..) = test(&format!("{patient}{more}"));
        assert_eq!(code, Some(1), "{out}");
        assert!(out.contains(&format!("  expected  {expected}\n  came      {came}\n")), "{out}");
    }
    let (_, out, ..) = test(&format!("{patient}[[expect.always]]{claim}at_most = 899\n"));
    assert!(out.contains("\n            0.060000s  depth: done\n  again"), "what happened before it is told: {out}");
    // A word alone stands for all replies that begin with it.
    let refused = patient.replace("[\"00 64", "[\"09 64").replace("reply = \"XON\"", "reply = \"NAK\"");
    let (code, out, ..) = test(&refused.replace("\"ACK XON\"", "\"NAK\""));
    assert_eq!(code, Some(0), "{out}");
    let replies = patient.replace("\"ACK XON\"", "\"ACK XOFF\"");
    let (code, out, ..) = test(&replies);
    assert_eq!(code, Some(1));
    assert!(out.contains("  expected  the replies ACK XOFF\n  came      ACK XON\n"), "{out}");
}

#[test]
fn what_is_drawn_is_told_first_and_stays_the_same_with_fewer_faults() {
    let file = "../tests/scenarios/any-fault-at-any-moment.toml";
    let told = |arguments: &[&str]| {
        let output = output(&[&["test", file], arguments].concat());
        String::from_utf8(output.stdout).unwrap()
    };
    let once = told(&["--seed", "5"]);
    let line = once.lines().next().unwrap();
    assert!(line.starts_with("a line is cut at any moment: seed 5, fault.there.at = "), "{once}");
    for place in ["fault.there.for = ", "fault.back.nth = ", "fault.back.value = ", "step.2.run = "] {
        assert!(line.contains(place), "{once}");
    }
    assert_ne!(once.lines().next(), told(&["--seed", "6"]).lines().next());
    assert!(once.lines().nth(1).unwrap().starts_with("passed  "), "{once}");
    let drawn: serde_json::Value = serde_json::from_str(&told(&["--seed", "5", "--json"])).unwrap();
    let at = drawn["drawn"]["fault.back.at"].as_str().unwrap();
    assert!(line.contains(&format!("fault.back.at = {at}")), "{line}");
    let scene = Scene::load(Path::new(file)).unwrap();
    let fewer = scene.without(&["there".to_owned()]).with(&[], 5).unwrap();
    assert!(fewer.drawn.contains(&("fault.back.at".to_owned(), at.to_owned())), "{:?}", fewer.drawn);
    assert!(fewer.drawn.iter().all(|(place, _)| !place.starts_with("fault.there")));

    let text = fs::read_to_string(file).unwrap();
    for (range, complaint) in [
        ("0 s..3 %", "10:6: '0 s..3 %': FROM and TO have different units"),
        ("3 s..1000 ms", "10:6: '3 s..1000 ms': FROM is above TO"),
    ] {
        let (code, _, err, _) = test(&text.replace("0 s..3 s", range));
        assert_eq!(code, Some(2));
        assert!(err.contains(&format!("a.toml:{complaint}")), "{err}");
    }
    // What is one seed's luck is refused with every seed.
    let (code, _, err, _) = test(&text.replace("\"0..9\"", "\"0..10\""));
    assert_eq!((code, err.contains("a.toml:18:9: expected the bit, 0 (start) to 9 (stop)")), (Some(2), true), "{err}");
    let (_, out, ..) = test(&text.replace("0 s..3 s", "100 ms..3 s"));
    let at: f64 = out.split("fault.there.at = ").nth(1).unwrap().split(" s").next().unwrap().parse().unwrap();
    assert!((0.1..=3.0).contains(&at), "{out}");
}

#[test]
fn a_scenario_in_prose_is_one_of_a_file() {
    let turn = || {
        prose::scenario("in prose")
            .step("a frame moves the carriage")
            .send("00 64 03 84 00 00 00 00")
            .step("it is on its way")
            .run_for("100 ms")
            .step("it has moved")
            .check(board("transverse").quantity("position_counts").at_least(1).at_most(400))
            .step("it is done")
            .wait(reply("XON"))
            .within("3 s")
            .replies("ACK XON")
            .finally(board("transverse").quantity("position_counts").equals(900))
            .never(reply("CAN"))
    };
    turn().must_pass();
    let outcome = turn().run().unwrap();
    let (code, out, ..) = test(&turn().toml());
    assert_eq!(code, Some(0), "{out}");
    let of_file = Scenario::parse("a.toml", &turn().toml(), None).unwrap();
    assert_eq!(run(&of_file, &Driver::InProcess).digest, outcome.digest);

    let broken = turn().fault(board("transverse").breaks("stall").when(line("pc_to_master").character(8)).named("jam"));
    let outcome = broken.run().unwrap();
    assert_eq!(outcome.failures[0].expected, "transverse.position_counts from 1 to 400");
    let panic = std::panic::catch_unwind(|| broken.must_pass()).unwrap_err();
    let message = panic.downcast::<String>().unwrap();
    assert!(message.contains("scenario 'in prose', seed 0:\n  step 3    it has moved"), "{message}");
    assert!(message.contains("[[fault]]\nboard = \"transverse\""), "{message}");
    let wrong = prose::scenario("wrong").fault(board("dept").breaks("crash")).scenario().unwrap_err();
    assert!(wrong.to_string().contains("did you mean 'depth'?"), "{wrong}");
}

#[test]
fn a_fault_that_has_not_begun_cannot_be_healed() {
    let heal = "[[step]]\ndoes = \"too early\"\nheal = \"late\"\n";
    let fault = "[[fault]]\nname = \"late\"\nboard = \"depth\"\nkind = \"stall\"\nwhen = { reply = \"XON\" }\n";
    let (code, out, ..) = test(&format!("name = \"early\"\n{heal}{fault}"));
    assert_eq!(code, Some(1), "{out}");
    assert!(
        out.contains("  step 1    too early\n  expected  the fault 'late'\n  came      it has not begun, or is over"),
        "{out}"
    );
}

#[test]
fn what_has_been_healed_can_break_again_by_its_name() {
    let step = |does: &str| format!("[[step]]\ndoes = \"d\"\n{does}\n");
    let (hang, heal) = (step("break = { name = \"x\", board = \"depth\", kind = \"hang\" }"), step("heal = \"x\""));
    let (code, _, err, _) = test(&format!("name = \"n\"\n{hang}{heal}{hang}{heal}"));
    assert_eq!(code, Some(0), "{err}");
    let (code, _, err, _) = test(&format!("name = \"n\"\n{hang}{heal}{hang}{hang}"));
    assert_eq!(code, Some(2), "{err}");
    assert!(err.contains("there is a fault 'x' already"), "{err}");
}

#[test]
fn what_is_wrong_with_a_file_is_told() {
    let step = |action: &str| format!("name = \"n\"\n[[step]]\ndoes = \"d\"\n{action}\n");
    let fault = |fields: &str| format!("name = \"n\"\n[[fault]]\n{fields}\n");
    let one_board = |fields: &str| format!("name = \"n\"\nrig = \"lathe-dspic\"\n[[fault]]\n{fields}\n");
    let claim = |fields: &str| format!("name = \"n\"\n[[expect.finally]]\n{fields}\n");
    for (text, place, message) in [
        (fault("line = \"pc_to_mastr\"\nkind = \"cut\""), "3:8", "no line 'pc_to_mastr': did you mean 'pc_to_master'?"),
        (fault("board = \"dept\"\nkind = \"crash\""), "3:9", "there is no board 'dept': did you mean 'depth'?"),
        (
            claim("board = \"depth\"\nquantity = \"position_count\"\nequals = 0"),
            "4:12",
            "there is no quantity of 'depth' 'position_count': did you mean 'position_counts'?",
        ),
        (
            step("wait = { board = \"depth\", event = \"dune\" }"),
            "4:35",
            "'depth' has no event 'dune': did you mean 'done'?",
        ),
        (step("wait = { reply = \"XOF\" }"), "4:18", "there is no reply 'XOF': did you mean 'XOFF'?"),
        (
            fault("line = \"pc_to_master\"\nkind = \"cutt\""),
            "4:8",
            "there is no fault 'cutt' of a line: did you mean 'cut'?",
        ),
        (
            fault("board = \"depth\"\nkind = \"power-of\""),
            "4:8",
            "there is no fault 'power-of' of a board: did you mean 'power-off'?",
        ),
        (fault("board = \"depth\"\nkind = \"cut\""), "4:8", "there is no fault 'cut' of a board"),
        (fault("board = \"depth\"\nkind = \"crash\"\nvalue = 7"), "5:9", "'crash' has no value"),
        (
            fault("line = \"pc_to_master\"\nkind = \"drop\"\nnth = 0"),
            "5:7",
            "expected which character, from 1, found 0",
        ),
        (
            fault("board = \"master\"\nkind = \"stall\""),
            "4:8",
            "'stall' means nothing to 'master': expected one of the boards spindle, transverse, depth",
        ),
        (fault("board = \"depth.spindle\"\nkind = \"stall\""), "3:9", "there is no motor of 'depth' 'spindle'"),
        (
            one_board("board = \"dspic\"\nkind = \"stall\""),
            "5:8",
            "'stall' means nothing to 'dspic': expected one of the boards dspic.spindle, dspic.transverse, dspic.depth",
        ),
        (
            one_board("board = \"dspic.deth\"\nkind = \"stall\""),
            "4:9",
            "there is no motor of 'dspic' 'deth': did you mean 'depth'?",
        ),
        (
            one_board("board = \"dspic.spindle\"\nkind = \"end-stop\"\nvalue = 3"),
            "5:8",
            "'end-stop' means nothing to 'dspic.spindle': expected one of the boards dspic.transverse, dspic.depth",
        ),
        (
            one_board("board = \"dspic.depth\"\nkind = \"hang\""),
            "5:8",
            "'hang' means nothing to 'dspic.depth': expected one of the boards dspic",
        ),
        (fault("board = \"pc\"\nkind = \"load\"\nvalue = \"3 %\""), "4:8", "'load' means nothing to 'pc'"),
        (fault("board = \"pc\"\nkind = \"reset\""), "4:8", "expected one of the boards master, spindle, transverse"),
        (
            fault("board = \"spindle\"\nkind = \"backlash\"\nvalue = 3"),
            "4:8",
            "'backlash' means nothing to 'spindle': expected one of the boards transverse, depth",
        ),
        (
            fault("name = \"x\"\nboard = \"pc\"\nkind = \"hang\"")
                + "[[fault]]\nname = \"x\"\nboard = \"pc\"\nkind = \"crash\"",
            "7:8",
            "there is a fault 'x' already: expected another name",
        ),
        (
            step("break = { board = \"depth\", kind = \"hang\" }\n[[fault]]\nboard = \"depth\"\nkind = \"hang\""),
            "4:35",
            "there is a fault 'depth hang' already",
        ),
        (step("wait = { reply = \"XON\", character = 2 }"), "4:37", "character: means nothing beside reply"),
        (step("wait = { line = \"pc_to_master\", character = 0 }"), "4:45", "from 1"),
        (fault("board = \"depth\"\nkind = \"crash\"\nfro = \"1 s\""), "5:1", "unknown field `fro`"),
        (step("wiat = \"1 s\""), "4:1", "unknown field `wiat`: did you mean 'wait'?"),
        (
            "name = \"n\"\nset = [\"depth.plant.rpn = 8\"]\n".to_owned(),
            "2:8",
            "unknown field `rpn`: did you mean 'rpm'?",
        ),
        (step("wait = { reply = \"XON\", within = \"5 m\" }"), "4:34", "'5 m': expected a time, such as"),
        (step("run = \"3 %\""), "4:7", "'3 %': expected a time, such as"),
        (
            fault("board = \"depth\"\nkind = \"clock\"\nvalue = \"3 ms\""),
            "5:9",
            "expected a ratio, such as \"3 %\" or \"-500 ppm\"",
        ),
        (fault("board = \"depth\"\nkind = \"clock\"\nvalue = \"30 %\""), "5:9", "-20 % to 20 %"),
        (fault("board = \"depth\"\nkind = \"counts\"\nvalue = \"3 %\""), "5:9", "expected so many counts"),
        (
            claim("board = \"depth\"\nquantity = \"drive\"\nat_least = \"3 ms\""),
            "5:12",
            "\"3 ms\": 'drive' has no unit: expected a whole number, such as 1",
        ),
        (
            claim("board = \"spindle\"\nquantity = \"speed_rpm\"\nequals = \"200 rmp\""),
            "5:10",
            "expected a whole number of rpm, such as 200 or \"200 rpm\": did you mean 'rpm'?",
        ),
        (
            claim("board = \"depth\"\nquantity = \"position_counts\"\nat_most = \"1.5 mm\""),
            "5:11",
            "\"1.5 mm\": expected a whole number of counts",
        ),
        (claim("board = \"depth\"\nquantity = \"drive\"\nequals = 0.5"), "5:10", "0.5: 'drive' has no unit"),
        (
            claim("board = \"depth\"\nreply = \"XON\"\nequals = 1"),
            "4:9",
            "expected a quantity of a board, and its bounds",
        ),
        (
            claim("board = \"depth\"\nquantity = \"drive\"\nat_least = 3\nat_most = 2"),
            "4:12",
            "at_least is above at_most",
        ),
        (step("run = \"1 s\"\nbytes = \"00\""), "2:1", "expected one of send, bytes, run, wait, break, heal, check"),
        (step(""), "2:1", "in this step, found 0"),
        (step("send = [\"00 01\"]"), "4:9", "expected 8 bytes, found 2"),
        (step("bytes = \"0x1\""), "4:9", "expected bytes of two hex digits"),
        (step("heal = \"quarz\""), "4:8", "there is no fault 'quarz' by now"),
        (
            step("heal = \"quarz\"\n[[fault]]\nname = \"quartz\"\nboard = \"depth\"\nkind = \"crash\""),
            "4:8",
            "did you mean 'quartz'?",
        ),
        (
            step("heal = \"x\"\n[[fault]]\nname = \"x\"\nboard = \"depth\"\nkind = \"reset\""),
            "4:8",
            "'x' is over at once: there is nothing to heal",
        ),
        (
            step("break = { name = \"x\", board = \"depth\", kind = \"hang\" }")
                + &"[[step]]\ndoes = \"d\"\nheal = \"x\"\n".repeat(2),
            "10:8",
            "'x' has been healed before this step",
        ),
        // What would be left out without a word.
        (
            step("break = { board = \"depth\", kind = \"hang\", when = { reply = \"XON\" } }"),
            "4:50",
            "expected neither at nor when here",
        ),
        (
            fault("board = \"depth\"\nkind = \"hang\"\nwhen = { reply = \"XON\", within = \"1 s\" }"),
            "5:34",
            "within: only a step that waits has so much time",
        ),
        (step("wait = { reply = \"XON\", equals = 3 }"), "4:34", "equals: means nothing beside reply"),
        (
            step("wait = { board = \"depth\", event = \"done\", at_least = 3 }"),
            "4:54",
            "at_least: means nothing beside event: expected event and board",
        ),
        (
            step("wait = { reply = \"XON\", event = \"done\" }"),
            "4:33",
            "event: expected either this or reply, not both",
        ),
        (step("wait = { reply = \"XON\", board = \"depth\" }"), "4:33", "board: means nothing beside reply"),
        (step("wait = { line = \"pc_to_master\", board = \"depth\" }"), "4:41", "board: means nothing beside line"),
        (step("wait = { event = \"done\" }"), "4:18", "event: expected its board, too"),
        (step("check = { quantity = \"drive\", equals = 0 }"), "4:22", "quantity: expected its board, too"),
        (
            step("run = \"1 s\"\n[[expect.never]]\npart = \"rapid\"\nequals = 3"),
            "7:10",
            "equals: means nothing beside part",
        ),
        (step("run = \"1 s\"\n[[expect.never]]\nreply = \"NAK\"\nwithin = \"1 s\""), "7:10", "expected none here"),
        (step("wait = { reply = \"XON\", within = \"0 s\" }"), "4:34", "within: nothing comes in no time"),
        (fault("board = \"depth\"\nkind = \"counts\"\nvalue = 3\nfor = \"1 s\""), "6:7", "'counts' is over at once"),
        (fault("board = \"depth\"\nkind = \"stall\"\nfor = \"0 s\""), "5:7", "what lasts no time breaks nothing"),
        (fault("board = \"depth\"\nkind = \"end-stop\"\nvalue = 0"), "5:9", "0 is on neither side"),
        (fault("board = \"depth\"\nkind = \"end-stop\"\nvalue = \"-9..9\""), "5:9", "0 is on neither side"),
        (
            fault("line = \"pc_to_master\"\nkind = \"noise\"\nvalue = \"3 %\"\nperiod = \"1 ms\""),
            "5:9",
            "expected either period or value, not both",
        ),
        (fault("line = \"pc_to_master\"\nkind = \"noise\""), "4:8", "expected period or value"),
        (fault("line = \"pc_to_master\"\nkind = \"noise\"\nvalue = \"51 %\""), "5:9", "0 % to 50 %"),
        // What no one can hear, or send.
        (step("wait = { reply = \"NAK z\" }"), "4:18", "there is no reply 'NAK z': did you mean 'NAK d'?"),
        (step("wait = { reply = \"CAN d\" }"), "4:18", "there is no reply 'CAN d': did you mean 'CAN d n'?"),
        (step("wait = { reply = \"ACK XON\" }"), "4:18", "expected one reply, found 2"),
        (
            step("run = \"1 s\"\n[expect]\nreplies = \"ACK XOFF AKC\""),
            "6:11",
            "there is no reply 'AKC': did you mean 'ACK'?",
        ),
        (
            step("run = \"1 s\"\n[expect]\nreplies = \"ACK 3\""),
            "6:11",
            "there is no reply 'ACK 3': did you mean 'ACK'?",
        ),
        (
            "name = \"n\"\nrig = \"servo\"\n[[step]]\ndoes = \"d\"\nwait = { reply = \"KX 256\" }".to_owned(),
            "5:18",
            "'KX 256': expected KX alone, or a value 0 to 255",
        ),
        (step("send = []"), "2:1", "send: expected something to send"),
        (step("send = [\"\"]"), "4:9", "expected at least one frame"),
        (step("bytes = \"\""), "4:9", "expected bytes of two hex digits"),
        (step("bytes = \"+1\""), "4:9", "expected bytes of two hex digits"),
        ("name = \"n\"\n".to_owned(), "1:1", "nothing is done and nothing breaks: expected a step, a fault, or an end"),
        ("name = \"n\"\nend = \"0 s\"\n".to_owned(), "2:7", "end: nothing happens in no time"),
        (
            "name = \"n\"\nrig = \"lathe-dspik\"\n".to_owned(),
            "2:7",
            "there is no rig and no rig file 'lathe-dspik': did you mean 'lathe-dspic'?",
        ),
    ] {
        let (code, out, err, path) = test(&text);
        assert_eq!((code, out.as_str()), (Some(2), ""), "{text}\n{err}");
        assert!(err.contains(&format!("{path}:{place}: ")), "expected {place}\n{text}\n{err}");
        assert!(err.contains(message), "expected {message}\n{text}\n{err}");
    }
}
