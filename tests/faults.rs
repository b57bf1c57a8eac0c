//! Faults in time: when one begins and ends, which counts as fired, and what a rig that is up says of them.

use std::fs;
use std::process::Output;

use crate::common::{ACK, AT_REST, Up, XON, folder, kill, output, test, wait_until};
use serde_json::Value;
use torno::rig::Driver;
use torno::rig::file::RigFile;
use torno::scenario::{self, Outcome, Scenario};
use torno_engine::Fact;
use torno_protocol::line::Level;
use torno_protocol::time::Span;

/// The depth axis goes out by nine slots: some four seconds.
const OUT: &str = "name = \"out\"\n[[step]]\ndoes = \"it goes out\"\nsend = [\"00 00 00 00 00 00 09 00\"]\n";
const OUT_AND_WAIT: &str = "name = \"out\"\n[[step]]\ndoes = \"it goes out\"\nsend = [\"00 00 00 00 00 00 09 00\"]\n\
                            [[step]]\ndoes = \"it is there\"\nwait = { reply = \"XON\" }\n";

fn run(text: &str) -> Outcome {
    run_by(text, &Driver::InProcess, None)
}

fn run_by(text: &str, driver: &Driver, slice: Option<Span>) -> Outcome {
    let scenario = Scenario::parse("a.toml", text, None).unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        match slice {
            Some(slice) => scenario::run_in_slices(&scenario, driver, slice).await.unwrap(),
            None => scenario::run(&scenario, driver).await.unwrap(),
        }
    })
}

fn failures(outcome: &Outcome) -> Vec<(&str, &str)> {
    outcome.failures.iter().map(|failure| (failure.expected.as_str(), failure.came.as_str())).collect()
}

fn fault(fields: &str) -> String {
    format!("[[fault]]\nname = \"f\"\n{fields}\n")
}

#[test]
fn a_fault_whose_instant_never_comes_has_not_fired() {
    for kind in [
        "board = \"depth\"\nkind = \"stall\"",
        "board = \"depth\"\nkind = \"drift\"\nvalue = \"0.1 %\"",
        "line = \"pc_to_master\"\nkind = \"cut\"",
        "line = \"pc_to_master\"\nkind = \"noise\"\nvalue = \"1 %\"",
        "line = \"pc_to_master\"\nkind = \"drop\"",
    ] {
        let late = format!("end = \"50 s\"\n{OUT}{}", fault(&format!("{kind}\nat = \"60 s\"")));
        let (code, out, ..) = test(&late);
        assert_eq!(code, Some(1), "{kind}\n{out}");
        let came = "it has not begun: all was over before 60.000000s";
        assert!(out.contains(&format!("  expected  the fault 'f'\n  came      {came}\n")), "{kind}\n{out}");
        assert!(!out.contains("fault 'f' begins"), "{kind}\n{out}");
    }
}

#[test]
fn a_quiet_rig_waits_for_the_faults_that_are_still_to_begin_and_to_end() {
    let outcome = run(&format!("{OUT}{}", fault("board = \"depth\"\nkind = \"hang\"\nat = \"60 s\"\nfor = \"5 s\"")));
    assert_eq!(failures(&outcome), []);
    assert!((65.0..66.0).contains(&outcome.end.as_secs_f64()), "{}", outcome.end);
}

#[test]
fn what_holds_already_begins_a_fault_at_once() {
    let blocked = fault(
        "board = \"depth\"\nkind = \"stall\"\n\
         when = { board = \"depth\", quantity = \"position_counts\", at_most = 0 }",
    );
    let outcome = run(&format!("{OUT_AND_WAIT}[expect]\nreplies = \"ACK CAN d s XON\"\n{blocked}"));
    assert_eq!(failures(&outcome), []);
    // What does not hold yet begins it when it does.
    let blocked = blocked.replace("at_most = 0", "at_least = 4");
    let drive = "[[expect.finally]]\nboard = \"depth\"\nquantity = \"position_counts\"\nequals = 4\n";
    let outcome = run(&format!("{OUT_AND_WAIT}[expect]\nreplies = \"ACK CAN d s XON\"\n{drive}{blocked}"));
    assert_eq!(failures(&outcome), []);
}

#[test]
fn a_value_from_the_start_is_looked_at_like_any_other() {
    let claim = "board = \"spindle\"\nquantity = \"speed_rpm\"\n";
    // The spindle is told nothing, and tells nothing.
    for (expectation, expected, came) in [
        (format!("[[expect.always]]\n{claim}at_least = 1\n"), "always spindle.speed_rpm ≥ 1", "spindle.speed_rpm = 0"),
        (format!("[[expect.never]]\n{claim}equals = \"0 rpm\"\n"), "never spindle.speed_rpm = 0", "it happened"),
    ] {
        let outcome = run(&format!("{OUT}{expectation}"));
        assert_eq!(failures(&outcome), [(expected, came)]);
        assert_eq!(outcome.failures[0].at.as_nanos(), 0);
    }
    let fine = format!("{OUT}[[expect.always]]\n{claim}at_most = \"200 rpm\"\n[[expect.never]]\n{claim}at_least = 1\n");
    assert_eq!(failures(&run(&fine)), []);
}

#[test]
fn a_character_that_must_never_come_is_found_however_time_is_cut() {
    // The last reply comes when all steps are done: the PC hears ACK and XON.
    let never = |nth: u32| format!("{OUT}[[expect.never]]\nline = \"master_to_pc\"\ncharacter = {nth}\n");
    assert_eq!(failures(&run(&never(3))), []);
    let outcome = run(&never(2));
    assert_eq!(failures(&outcome), [("never character 2 on master_to_pc", "it happened")]);
    assert_eq!(outcome.failures[0].board.as_deref(), Some("master"));
    let processes = Driver::Processes { exe: env!("CARGO_BIN_EXE_torno").into() };
    for again in
        [run_by(&never(2), &processes, None), run_by(&never(2), &Driver::InProcess, Some(Span::from_micros(777)))]
    {
        assert_eq!((&again.digest, &again.failures), (&outcome.digest, &outcome.failures));
    }
    // To look for it changes nothing.
    assert_eq!(outcome.digest, run(OUT).digest);
}

#[test]
fn a_fault_that_ends_by_itself_can_be_healed_before() {
    let step = |action: &str| format!("[[step]]\ndoes = \"d\"\n{action}\n");
    let broken = |how: &str| step(&format!("break = {{ name = \"x\", {how}, for = \"9 s\" }}"));
    let go =
        step("run = \"1 s\"") + &step("send = [\"00 00 00 00 00 00 02 00\"]") + &step("wait = { reply = \"XON\" }");
    let there = step("check = { board = \"depth\", quantity = \"position_counts\", equals = 2 }");
    for (how, frames) in [
        // What has restarted takes no part before it has said so.
        ("board = \"depth\", kind = \"crash\"", 2),
        ("board = \"depth\", kind = \"power-off\"", 2),
        ("line = \"master_to_depth\", kind = \"cut\"", 1),
    ] {
        let healed = broken(how) + &step("run = \"1 s\"") + &step("heal = \"x\"");
        // Nor does its own end come any more: a board that restarts counts from 0.
        let go = go.repeat(frames);
        let outcome = run(&format!("name = \"n\"\n{healed}{go}{}{there}", step("run = \"20 s\"")));
        assert_eq!(failures(&outcome), [], "{how}");
        let twice = broken(how) + &step("run = \"10 s\"") + &step("heal = \"x\"");
        let outcome = run(&format!("name = \"n\"\n{twice}"));
        assert_eq!(failures(&outcome), [("the fault 'x'", "it has not begun, or is over")], "{how}");
    }
}

#[test]
fn a_fault_that_has_met_its_character_is_over() {
    let drop = "[[step]]\ndoes = \"d\"\nbreak = { name = \"x\", line = \"master_to_pc\", kind = \"double\" }\n";
    let heal = "[[step]]\ndoes = \"h\"\nheal = \"x\"\n";
    let (name, rest) = OUT_AND_WAIT.split_once('\n').unwrap();
    let outcome = run(&format!("{name}\n{drop}{rest}{heal}"));
    assert_eq!(failures(&outcome), [("the fault 'x'", "it has not begun, or is over")]);
}

#[test]
fn noise_inverts_a_line_for_the_share_of_the_time_that_it_says() {
    const SECONDS: f64 = 200.0;
    let folder = folder();
    let [file, trace] = ["a.toml", "a.torno"].map(|name| folder.path().join(name));
    for (value, width, share) in [("5 %", "50 us", 0.05), ("0.5 %", "300 us", 0.005), ("0 %", "50 us", 0.0)] {
        let noise = format!("line = \"pc_to_master\"\nkind = \"noise\"\nvalue = \"{value}\"\nwidth = \"{width}\"");
        fs::write(&file, format!("name = \"n\"\nend = \"{SECONDS} s\"\n{}", fault(&noise))).unwrap();
        let tested = output(&["test", file.to_str().unwrap(), "--record", trace.to_str().unwrap()]);
        assert!(tested.stdout.starts_with(b"n: seed 0\n"));
        let (trace, _) = torno_trace::read(fs::File::open(&trace).unwrap(), RigFile::layout_of).unwrap();
        let of_line = trace.header.layout.line("pc_to_master").unwrap();
        // The line idles: it is low while it is inverted.
        let (mut low, mut since) = (0.0, 0.0);
        for fact in &trace.facts {
            let Fact::Edges { line, edges } = fact else { continue };
            for edge in edges.iter().filter(|_| *line == of_line) {
                low += if edge.level == Level::High { edge.at.as_secs_f64() - since } else { 0.0 };
                since = edge.at.as_secs_f64();
            }
        }
        assert!((low / SECONDS - share).abs() < share / 20.0 + 1e-12, "{value}: {}", low / SECONDS);
    }
}

fn ctl(up: &Up, arguments: &[&str]) -> Output {
    output(&[&["ctl", "--json", "--socket", up.ready["control"].as_str().unwrap()], arguments].concat())
}

fn faults(up: &Up) -> Vec<String> {
    let state = crate::common::json(&ctl(up, &["state"]));
    let faults = state["faults"].as_array().unwrap().iter();
    faults.map(|fault| fault["name"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn a_state_tells_of_no_fault_that_is_over() {
    let up = Up::start(&["--pace", "20"]);
    let mut pc = up.pc();
    ctl(&up, &["fault", "reset", "master"]);
    ctl(&up, &["fault", "counts", "depth", "3"]);
    ctl(&up, &["fault", "double", "master_to_pc"]);
    assert_eq!(faults(&up), ["master_to_pc double"]);
    // The master has restarted and asks its slaves first.
    pc.write(&AT_REST);
    while pc.read(1) != [ACK] {}
    pc.expect(&[ACK, XON]);
    wait_until("it is over", || faults(&up).is_empty());
    ctl(&up, &["fault", "stall", "depth", "--for", "1000 s"]);
    assert_eq!(faults(&up), ["depth stall"]);
    assert!(ctl(&up, &["heal", "depth stall"]).status.success());
    assert_eq!(faults(&up), [""; 0]);
    // It holds already.
    let when = "{ board = \"depth\", quantity = \"drive\", at_most = 0 }";
    let begun: Value = crate::common::json(&ctl(&up, &["fault", "stall", "depth", "--when", when]));
    assert!(begun["since"].is_u64(), "{begun}");
}

#[test]
fn a_rig_that_is_up_tells_its_seed_first_and_what_never_fired_last() {
    let folder = folder();
    let path = folder.path().join("faults.toml");
    let faults = "seed = 4\n[[fault]]\nname = \"late\"\nboard = \"depth\"\nkind = \"stall\"\nat = \"9000 s..9999 s\"\n\
                  [[fault]]\nname = \"soon\"\nboard = \"depth\"\nkind = \"hang\"\nat = \"1 s\"\nfor = \"1 s\"\n";
    fs::write(&path, faults).unwrap();
    let mut up = Up::start(&["--pace", "20", "--faults", path.to_str().unwrap()]);
    assert!(up.log().contains("seed 4, fault.late.at = 9"), "{}", up.log());
    up.wait_for_log("fault 'soon' begins");
    kill("-INT", up.pid());
    assert!(up.child.wait().unwrap().success());
    assert!(up.log().contains("the fault 'late' has not fired"), "{}", up.log());
    assert!(!up.log().contains("the fault 'soon' has not fired"), "{}", up.log());
}

#[test]
fn at_full_speed_a_quiet_rig_goes_on_to_the_next_fault() {
    let folder = folder();
    let path = folder.path().join("faults.toml");
    let fault = "[[fault]]\nname = \"soon\"\nboard = \"depth\"\nkind = \"stall\"\nat = \"500 s\"\nfor = \"100 s\"\n";
    fs::write(&path, fault).unwrap();
    let up = Up::start(&["--pace", "max", "--faults", path.to_str().unwrap()]);
    up.wait_for_log("fault 'soon' begins");
    wait_until("it is over", || faults(&up).is_empty());
    let state = crate::common::json(&ctl(&up, &["state"]));
    assert!((600_000_000_000..700_000_000_000).contains(&state["ns"].as_u64().unwrap()), "{state}");
}
