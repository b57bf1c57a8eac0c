//! The promise: a program with faults has one result at every pace, however time is cut and wherever the boards run,
//! and a recording repeats it.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::path::Path;

use proptest::prelude::*;
use proptest::sample::select;
use proptest::test_runner::{Config, RngSeed, TestCaseError, TestRunner};
use torno::fault::{self, Planned};
use torno::pace::Pace;
use torno::play::{Play, Played};
use torno::recorder::Recorder;
use torno::replay::replay;
use torno::rig::Driver;
use torno::rig::file::RigFile;
use torno::scenario::{self, Keep, Scenario};
use torno::servo::{Controller, Gain, RigLine};
use torno_engine::{Input, InputKind};
use torno_protocol::board::{Capability, MotorStimulus, Stimulus};
use torno_protocol::lathe::Program;
use torno_protocol::time::{Instant, Span};
use torno_trace::diff::{Extent, first_difference};
use torno_trace::{Digest, Trace};

use crate::common::play::{block_on, processes};
use crate::common::{Up, folder, kill};

/// Cases of each property, in process and in processes: PROPTEST_CASES says another number for both.
const CASES: u32 = 60;
const CASES_IN_PROCESSES: u32 = 12;
const CASES_UP: u32 = 8;
/// Nothing is played for longer after the last frame that was accepted.
const PATIENCE: Span = Span::from_secs(12);

fn check<T: std::fmt::Debug>(cases: u32, strategy: impl Strategy<Value = T>, holds: impl Fn(T) -> Result<(), String>) {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
    let cases = number("PROPTEST_CASES").and_then(|cases| u32::try_from(cases).ok()).unwrap_or(cases);
    let rng_seed = RngSeed::Fixed(number("PROPTEST_RNG_SEED").unwrap_or(1));
    let config = Config { cases, rng_seed, failure_persistence: None, ..Config::default() };
    let outcome = TestRunner::new(config).run(&strategy, |case| holds(case).map_err(TestCaseError::fail));
    outcome.unwrap_or_else(|failure| panic!("{failure}"));
}

/// Frames that are over soon; some are refused.
fn frames() -> impl Strategy<Value = Vec<[u8; 8]>> {
    let frame = (
        select(&[0, 0, 10, 19, 200, 7][..]),
        select(&[0, 45, 225][..]),
        0..400u16,
        select(&[0, 1, 0, 1, 2][..]),
        select(&[0, 0, 1, 2, 3][..]),
        0..2u8,
    );
    let frame = frame.prop_map(|(spindle, speed, counts, to, slots, depth_to)| {
        let counts = if speed == 0 { 0 } else { counts };
        let [high, low] = counts.to_be_bytes();
        [spindle, speed, high, low, to, 0, slots, depth_to]
    });
    prop::collection::vec(frame, 1..5)
}

/// Faults of any kind that a rig can have.
fn faults(rig: &'static str) -> impl Strategy<Value = String> {
    let fault = (place(rig), begins(rig), lasts()).prop_map(|((place, over_at_once), begins, lasts)| {
        let lasts = if over_at_once { "" } else { &lasts };
        format!("{place}{begins}{lasts}")
    });
    prop::collection::vec(fault, 1..4).prop_map(|faults| {
        let table = |(n, fault)| format!("[[fault]]\nname = \"f{n}\"\n{fault}");
        faults.iter().enumerate().map(table).collect()
    })
}

/// Where and what breaks; whether that is over at once.
fn place(rig: &str) -> impl Strategy<Value = (String, bool)> + use<> {
    let names = RigFile::load(rig).unwrap().names();
    let boards = || select(names.boards[..names.boards.len() - 1].to_vec());
    let capable = |what: Capability| select(names.capable(what));
    let line = || select(names.lines.clone());
    let of_a_line = prop_oneof![
        select(&["cut", "stuck-low", "stuck-high"][..]).prop_map(|kind| format!("kind = \"{kind}\"\n")),
        (1..300u32, 1..200u32)
            .prop_map(|(ms, us)| format!("kind = \"noise\"\nperiod = \"{ms} ms\"\nwidth = \"{us} us\"\n")),
        (1..12u32).prop_map(|n| format!("kind = \"flip\"\nnth = \"1..{n}\"\nvalue = \"0..9\"\n")),
        (1..12u32, 0..9u8, 0..900u32)
            .prop_map(|(nth, edge, us)| format!("kind = \"delay\"\nnth = {nth}\nedge = {edge}\nvalue = \"{us} us\"\n")),
        (1..12u32, select(&["drop", "double"][..])).prop_map(|(nth, kind)| format!("kind = \"{kind}\"\nnth = {nth}\n")),
    ];
    let of_a_board = prop_oneof![
        select(&["crash", "hang", "power-off", "brown-out"][..]).prop_map(|kind| format!("kind = \"{kind}\"\n")),
        (-9..=9i32).prop_map(|percent| format!("kind = \"clock\"\nvalue = \"{percent} %\"\n")),
        (-10..=10i32).prop_map(|permille| format!("kind = \"drift\"\nvalue = \"{} ppm\"\n", permille * 1000)),
        (0..3_000u32).prop_map(|us| format!("kind = \"slow\"\nvalue = \"{us} us\"\n")),
    ];
    let of_a_motor = prop_oneof![
        Just("kind = \"stall\"\n".to_owned()),
        (0..=150u32).prop_map(|percent| format!("kind = \"load\"\nvalue = \"{percent} %\"\n")),
        (0..=120u32).prop_map(|percent| format!("kind = \"supply\"\nvalue = \"{percent} %\"\n")),
    ];
    let of_an_axis = prop_oneof![
        (0..200u32).prop_map(|counts| format!("kind = \"backlash\"\nvalue = {counts}\n")),
        (1..300i32, select(&["", "-"][..]))
            .prop_map(|(counts, side)| format!("kind = \"end-stop\"\nvalue = {side}{counts}\n")),
    ];
    let short = (line(), line()).prop_filter("a line cannot touch itself", |(line, with)| line != with);
    let of_a_short = |(line, with)| (format!("line = \"{line}\"\nkind = \"short\"\nwith = \"{with}\"\n"), false);
    let counts = (capable(Capability::Motor), -60..60i32);
    let of_board = |(board, what): (String, String)| (format!("board = \"{board}\"\n{what}"), false);
    prop_oneof![
        4 => (line(), of_a_line).prop_map(|(line, what)| (format!("line = \"{line}\"\n{what}"), false)),
        1 => short.prop_map(of_a_short),
        3 => (boards(), of_a_board).prop_map(of_board),
        2 => (capable(Capability::Motor), of_a_motor).prop_map(of_board),
        1 => (capable(Capability::Axis), of_an_axis).prop_map(of_board),
        1 => capable(Capability::Reset).prop_map(|board| (format!("board = \"{board}\"\nkind = \"reset\"\n"), true)),
        1 => counts.prop_map(|(board, n)| (format!("board = \"{board}\"\nkind = \"counts\"\nvalue = {n}\n"), true)),
    ]
}

fn begins(rig: &str) -> impl Strategy<Value = String> + use<> {
    let names = RigFile::load(rig).unwrap().names();
    let (mut quantities, mut events) = (Vec::new(), Vec::new());
    for (board, of) in names.boards.iter().zip(&names.descriptions) {
        quantities
            .extend(of.signals.iter().map(|signal| format!("board = \"{board}\", quantity = \"{}\"", signal.name)));
        events.extend(of.events.iter().map(|event| format!("board = \"{board}\", event = \"{event}\"")));
    }
    let values = prop_oneof![-3..9i32, 0..400i32];
    let replies: &[&str] = if rig == "servo" { &["PRESENT"] } else { &["ACK", "XON", "XOFF", "NAK", "CAN"] };
    let condition = prop_oneof![
        if rig == "servo" { 0 } else { 3 } => select(replies).prop_map(|reply| format!("reply = \"{reply}\"")),
        3 => (select(quantities), select(&["at_least", "equals", "at_most"][..]), values)
            .prop_map(|(quantity, bound, n)| format!("{quantity}, {bound} = {n}")),
        1 => select(events),
        2 => (select(names.lines), 1..12u32).prop_map(|(line, n)| format!("line = \"{line}\", character = {n}")),
    ];
    prop_oneof![
        1 => Just(String::new()),
        3 => (0..4_000u32).prop_map(|ms| format!("at = \"{ms} ms\"\n")),
        1 => (1..4_000u32).prop_map(|ms| format!("at = \"0 s..{ms} ms\"\n")),
        5 => condition.prop_map(|condition| format!("when = {{ {condition} }}\n")),
    ]
}

fn lasts() -> impl Strategy<Value = String> {
    prop_oneof![
        2 => Just(String::new()),
        3 => (1..3_000u32).prop_map(|ms| format!("for = \"{ms} ms\"\n")),
        1 => (1..90_000u32).prop_map(|us| format!("for = \"{us} us\"\n")),
        1 => (2..2_000u32).prop_map(|ms| format!("for = \"1 ms..{ms} ms\"\n")),
    ]
}

/// How time is cut: the pace, and how far it goes at once.
type Cut = (Pace, Option<Span>);

const WHOLE: Cut = (Pace::Max, None);

fn planned(file: &RigFile, faults: &str, seed: u64) -> Result<Vec<Planned>, String> {
    let faults = fault::parse("faults.toml", faults, &file.names(), Some(seed));
    faults.map(|faults| faults.faults).map_err(|error| error.to_string())
}

/// A play: the program, what breaks, the seed, how far time goes at once in microseconds.
type Case = (Vec<[u8; 8]>, String, u64, u64);

fn plays() -> impl Strategy<Value = (&'static str, Case)> {
    let of =
        |rig: &'static str| (frames(), faults(rig), any::<u64>(), 1..2_000_000u64).prop_map(move |case| (rig, case));
    prop_oneof![4 => of("lathe"), 1 => of("lathe-dspic")]
}

/// Plays a program while this breaks, and keeps the trace.
fn play(rig: &str, (frames, faults, seed, _): &Case, driver: Driver, (pace, slice): Cut) -> Result<Played, String> {
    let file = RigFile::load(rig).unwrap();
    let faults = planned(&file, faults, *seed)?;
    let keep = Some(file.header(rig, *seed, Some("any.frames")));
    let program = Program { frames: frames.clone() };
    let play = Play { faults, keep, pace, slice, patience: PATIENCE, ..Play::new(file, program, driver) };
    block_on(play.run(|_| ())).map_err(|error| error.to_string())
}

/// What is told of a play.
fn told(played: &Played) -> String {
    let Played { digest, end, outcome, ended, unfired, .. } = played;
    format!("{digest} at {end}, {}, {ended:?}, unfired: {unfired:?}", outcome.name())
}

fn same(what: &str, one: &str, other: &str) -> Result<(), String> {
    if one == other { Ok(()) } else { Err(format!("{what}:\n  {other}\n  expected\n  {one}")) }
}

/// The digest of what a trace holds is the one that was told, nothing in it lies after its end, and it can be repeated.
fn is_whole(trace: &Trace, told: &str) -> Result<(), String> {
    let mut digest = Digest::new(&trace.header.layout);
    trace.facts.iter().for_each(|fact| digest.add(fact));
    same("the trace holds", told, &digest.sum().to_string())?;
    if let Some(late) = trace.facts.iter().find(|fact| fact.last() >= trace.until()) {
        return Err(format!("{late:?} lies after the end, {}", trace.until()));
    }
    let again = block_on(replay(trace, &Driver::InProcess)).map_err(|error| error.to_string())?;
    let difference = first_difference(trace, &again.trace, Extent::Whole, torno_machines::dialect);
    let difference = difference.map(|difference| difference.text("recorded", "repeated")).unwrap_or_default();
    same("the replay", told, &again.digest).map_err(|error| format!("{error}\n{difference}"))
}

fn with_context(error: String, rig: &str, (frames, faults, seed, slice): &Case) -> String {
    format!("{error}\non {rig}, seed {seed}, {slice} us at once\n{frames:02x?}\n{faults}")
}

fn check_plays(cases: u32, cuts: impl Fn(&Case) -> Vec<(Driver, Cut)>) {
    check(cases, plays(), |(rig, case)| {
        let context = |error: String| with_context(error, rig, &case);
        let played = play(rig, &case, Driver::InProcess, WHOLE).map_err(context)?;
        is_whole(played.trace.as_ref().unwrap(), &played.digest).map_err(context)?;
        for (driver, cut) in cuts(&case) {
            let again = play(rig, &case, driver.clone(), cut).map_err(context)?;
            same(&format!("{cut:?}, {driver:?}"), &told(&played), &told(&again)).map_err(context)?;
            is_whole(again.trace.as_ref().unwrap(), &again.digest).map_err(context)?;
        }
        Ok(())
    });
}

#[test]
fn a_faulted_run_has_one_result_however_time_is_cut_and_can_be_repeated() {
    check_plays(CASES, |(_, _, _, slice)| {
        let cuts = [*slice, slice % 50_000 + 1].map(|us| (Pace::Max, Some(Span::from_micros(us))));
        cuts.into_iter().chain([(Pace::Times(500.0), None)]).map(|cut| (Driver::InProcess, cut)).collect()
    });
}

#[test]
fn a_faulted_run_in_processes_has_the_same_result_at_every_pace() {
    let cuts = [WHOLE, (Pace::Times(500.0), None), (Pace::Times(20_000.0), None)];
    check_plays(CASES_IN_PROCESSES, |_| cuts.map(|cut| (processes(), cut)).to_vec());
}

#[test]
fn a_fault_with_when_and_for_lasts_as_long_as_it_says_at_every_pace() {
    let frames = vec![[0; 8], [0, 0x2d, 0, 0, 0, 0, 0, 0], [0x13, 0, 0, 0, 0, 0, 1, 1]];
    let fault =
        "[[fault]]\nboard = \"depth\"\nkind = \"backlash\"\nvalue = 3\nwhen = { reply = \"XON\" }\nfor = \"500 ms\"\n";
    let case = (frames, fault.to_owned(), 0, 0);
    let mut digests = BTreeSet::new();
    for driver in [Driver::InProcess, processes()] {
        for pace in [Pace::Max, Pace::Times(100.0), Pace::Times(500.0)] {
            let played = play("lathe", &case, driver.clone(), (pace, None)).unwrap();
            let trace = played.trace.unwrap();
            let stimuli = |input: &Input| match input.what {
                InputKind::Stimulus {
                    stimulus: Stimulus::Motor { what: MotorStimulus::Backlash(counts), .. }, ..
                } => Some((counts, input.at)),
                _ => None,
            };
            let given: Vec<(u16, Instant)> = trace.inputs.iter().filter_map(stimuli).collect();
            let [(3, begins), (0, ends)] = given[..] else { panic!("{given:?}") };
            assert_eq!(ends, begins + Span::from_millis(500), "{driver:?} at {pace}");
            digests.insert(played.digest);
        }
    }
    assert_eq!(digests.len(), 1, "{digests:?}");
}

#[test]
fn the_end_of_a_run_counts_in_the_digest_and_in_the_trace() {
    // The line goes high again after the last reply, and the run is not over before.
    let stuck = "[[fault]]\nline = \"depth_to_master\"\nkind = \"stuck-low\"\nat = \"10 ms\"\nfor = \"2 s\"\n";
    let case = (vec![[0; 8]], stuck.to_owned(), 0, 0);
    for cut in [WHOLE, (Pace::Times(100.0), None), (Pace::Max, Some(Span::from_millis(7)))] {
        let played = play("lathe", &case, processes(), cut).unwrap();
        assert_eq!(played.end, Instant::START + Span::from_millis(2_010), "{cut:?}");
        is_whole(played.trace.as_ref().unwrap(), &played.digest).unwrap();
    }
}

/// Steps of a scenario.
fn steps() -> impl Strategy<Value = String> {
    let step = prop_oneof![
        3 => frames().prop_map(|frames| {
            let hex = |frame: &[u8; 8]| frame.map(|byte| format!("{byte:02X}")).join(" ");
            let frames: Vec<String> = frames.iter().map(|frame| format!("\"{}\"", hex(frame))).collect();
            format!("send = [{}]\n", frames.join(", "))
        }),
        2 => (1..2_000u32).prop_map(|ms| format!("run = \"{ms} ms\"\n")),
        1 => (1..2_000u32).prop_map(|ms| format!("run = \"1 ms..{ms} ms\"\n")),
        2 => (select(&["ACK", "XON", "NAK"][..]), 1..4_000u32)
            .prop_map(|(reply, ms)| format!("wait = {{ reply = \"{reply}\", within = \"{ms} ms\" }}\n")),
        1 => place("lathe").prop_map(|(place, over_at_once)| {
            let fields: Vec<&str> = place.lines().collect();
            let heal = if over_at_once { "" } else { "heal" };
            format!("break = {{ name = \"b{heal}\", {} }}\n", fields.join(", "))
        }),
        1 => Just("heal = \"b\"\n".to_owned()),
    ];
    prop::collection::vec(step, 1..6).prop_map(|steps| {
        // What is broken has a name of its own, and only that can be healed, once.
        let (mut broken, mut lasting) = (0, Vec::<String>::new());
        let mut text = String::new();
        for step in steps {
            broken += 1;
            let name = format!("\"b{broken}\"");
            let step = match step.as_str() {
                step if step.starts_with("heal") => {
                    let Some(name) = lasting.pop() else { continue };
                    step.replace("\"b\"", &name)
                }
                step if step.contains("\"bheal\"") => {
                    lasting.push(name.clone());
                    step.replace("\"bheal\"", &name)
                }
                step => step.replace("\"b\"", &name),
            };
            text += &format!("[[step]]\ndoes = \"it\"\n{step}");
        }
        text
    })
}

fn scenario_told(outcome: &scenario::Outcome) -> String {
    let scenario::Outcome { failures, digest, end, replies, .. } = outcome;
    let failures: Vec<_> = failures.iter().map(|failure| (&failure.expected, &failure.came, failure.at)).collect();
    format!("{digest} at {end}, {replies:?}, {failures:?}")
}

/// Runs a scenario, and reads what was recorded of it.
fn recorded(scenario: &Scenario, driver: &Driver, path: &Path) -> Result<(scenario::Outcome, Trace), String> {
    let header = scenario.file.header(&scenario.rig, scenario.seed, None);
    let recorder = Recorder::begin(path, Recorder::open(path).unwrap(), &header).unwrap();
    let outcome =
        block_on(scenario::record(scenario, driver, Keep::Recording(recorder))).map_err(|error| error.to_string())?;
    let (trace, damage) = torno_trace::read(File::open(path).unwrap(), RigFile::layout_of).unwrap();
    assert!(damage.is_none(), "{damage:?}");
    Ok((outcome, trace))
}

fn scenarios() -> impl Strategy<Value = (String, u64, u64)> {
    (steps(), faults("lathe"), any::<u64>(), 1..3_000_000u64).prop_map(|(steps, faults, seed, slice)| {
        (format!("name = \"any\"\nend = \"20 s\"\n{steps}{faults}"), seed, slice)
    })
}

#[test]
fn a_scenario_has_one_result_however_time_is_cut_and_can_be_repeated() {
    let folder = folder();
    let path = folder.path().join("a.torno");
    check(CASES, scenarios(), |(text, seed, slice)| {
        let context = |error: String| format!("{error}\nseed {seed}, slice {slice} us\n{text}");
        let scenario = Scenario::parse("any.toml", &text, Some(seed)).map_err(|error| context(error.to_string()))?;
        let (outcome, trace) = recorded(&scenario, &Driver::InProcess, &path).map_err(context)?;
        is_whole(&trace, &outcome.digest).map_err(context)?;
        let slice = Span::from_micros(slice);
        let again = block_on(scenario::run_in_slices(&scenario, &Driver::InProcess, slice));
        let again = again.map_err(|error| context(error.to_string()))?;
        same("in slices", &scenario_told(&outcome), &scenario_told(&again)).map_err(context)
    });
}

#[test]
fn a_scenario_in_processes_has_the_same_result() {
    let folder = folder();
    let path = folder.path().join("a.torno");
    check(CASES_IN_PROCESSES, scenarios(), |(text, seed, _)| {
        let context = |error: String| format!("{error}\nseed {seed}\n{text}");
        let scenario = Scenario::parse("any.toml", &text, Some(seed)).map_err(|error| context(error.to_string()))?;
        let outcome =
            block_on(scenario::run(&scenario, &Driver::InProcess)).map_err(|error| context(error.to_string()))?;
        let (again, trace) = recorded(&scenario, &processes(), &path).map_err(context)?;
        same("in processes", &scenario_told(&outcome), &scenario_told(&again)).map_err(context)?;
        is_whole(&trace, &again.digest).map_err(context)
    });
}

/// What the PC program of the servo stand does while this breaks: what it says, and how the session ends.
fn drive(faults: &str, seed: u64, driver: &Driver, pace: Pace) -> Result<(String, torno::session::Ended), String> {
    let file = RigFile::load("servo").unwrap();
    let planned = planned(&file, faults, seed)?;
    let program =
        torno_servo::compile("p0 k5 x2\nx4 t0.6\np5 k0 x2\ne\n", &torno_servo::Limits::default()).program.unwrap();
    let increments = program.increments(125.0);
    block_on(async {
        let mut line = RigLine::start(&file, driver).await.map_err(|error| error.to_string())?;
        line.set_pace(pace).map_err(|error| error.to_string())?;
        line.session().keep(file.header("servo", seed, Some("any.txt")));
        line.session().plan(&planned);
        let mut controller = Controller::on(line);
        let mut said = Vec::new();
        said.push(format!("{:?}", controller.check_link().await));
        said.push(format!("{:?}", controller.set_gain(Gain::Kx, 16).await));
        said.push(format!("{:?}", controller.download(&increments, |_, _| {}).await));
        let mut samples = Vec::new();
        let ran = controller.run(increments.len(), |sample| {
            samples.push(sample.error);
            true
        });
        said.push(format!("{:?}", ran.await));
        said.push(format!("{samples:?}"));
        let ended = controller.disconnect().end("ended").await.map_err(|error| error.to_string())?;
        said.push(format!("{:?}", ended.end));
        Ok((said.join("\n"), ended))
    })
}

fn check_servo(cases: u32, cuts: &[(Driver, Pace)]) {
    check(cases, (faults("servo"), any::<u64>()), |(faults, seed)| {
        let context = |error: String| format!("{error}\nseed {seed}\n{faults}");
        let (said, ended) = drive(&faults, seed, &Driver::InProcess, Pace::Max).map_err(context)?;
        is_whole(ended.trace.as_ref().unwrap(), &ended.end.digest).map_err(context)?;
        for (driver, pace) in cuts {
            let (again, ended) = drive(&faults, seed, driver, *pace).map_err(context)?;
            same(&format!("at pace {pace}, {driver:?}"), &said, &again).map_err(context)?;
            is_whole(ended.trace.as_ref().unwrap(), &ended.end.digest).map_err(context)?;
        }
        Ok(())
    });
}

#[test]
fn a_faulted_servo_run_has_one_result_at_every_pace_and_can_be_repeated() {
    check_servo(CASES, &[500.0, 20_000.0].map(|pace| (Driver::InProcess, Pace::Times(pace))));
}

#[test]
fn a_faulted_servo_run_in_processes_has_the_same_result() {
    check_servo(CASES_IN_PROCESSES, &[Pace::Max, Pace::Times(500.0)].map(|pace| (processes(), pace)));
}

/// What a client does at its own time cannot come twice; what was recorded of it can be repeated.
#[test]
fn a_faulted_rig_that_was_up_can_be_repeated() {
    let folder = folder();
    let [file, path] = ["faults.toml", "a.torno"].map(|name| folder.path().join(name));
    let paces = select(&["max", "100", "500", "20000"][..]);
    check(CASES_UP, (frames(), faults("lathe"), any::<u32>(), paces, 0..60u64), |(frames, faults, seed, pace, ms)| {
        let context = |error: String| format!("{error}\nseed {seed}, pace {pace}\n{frames:02x?}\n{faults}");
        fs::write(&file, format!("seed = {seed}\n{faults}")).unwrap();
        let arguments = ["--pace", pace, "--faults", file.to_str().unwrap(), "--record", path.to_str().unwrap()];
        let mut up = Up::start(&arguments);
        let mut pc = up.pc();
        pc.write(&frames.concat());
        std::thread::sleep(std::time::Duration::from_millis(ms));
        kill("-INT", up.pid());
        let status = up.child.wait().unwrap();
        if !status.success() {
            return Err(context(format!("{status}\n{}", up.log())));
        }
        let (trace, damage) = torno_trace::read(File::open(&path).unwrap(), RigFile::layout_of).unwrap();
        assert!(damage.is_none(), "{damage:?}");
        let digest = trace.end.as_ref().map(|end| end.digest.clone()).unwrap_or_default();
        is_whole(&trace, &digest).map_err(context)
    });
}
