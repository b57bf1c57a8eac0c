//! Whole programs through `torno run`: what it prints, the digest, the waveforms.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use crate::common::play::*;
use crate::common::{ACK, CAN, XOFF, XON, folder, is_installed, json, output};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde_json::Value;
use torno::job::Careful;
use torno::rig::file::RigFile;
use torno::rig::{Driver, Rig};
use torno_bus::PcUart;
use torno_engine::Limit;
use torno_protocol::board::Stimulus;
use torno_protocol::time::{Instant, Span};
use torno_trace::Digest;

// --- what is printed ------------------------------------------------------------------------------------------------

#[test]
fn the_demonstration_completes_with_everything_in_its_json() {
    let output = output(&["run", "--json"]);
    assert_eq!(output.status.code(), Some(0));
    assert_eq!(String::from_utf8_lossy(&output.stderr), "");
    let summary = json(&output);
    assert_eq!(summary["rig"], "lathe");
    assert_eq!(summary["program"], "shaft.frames");
    assert_eq!(summary["outcome"], "completed");

    let frames = demonstration().frames.len() as u64;
    assert!(frames >= 20);
    for (name, expected) in [("sent", frames), ("accepted", frames), ("held", frames - 1), ("rejected", 0)] {
        assert_eq!(summary["frames"][name].as_u64(), Some(expected), "{name}");
    }
    let number = |name: &str| summary[name].as_f64().unwrap();
    assert!((120.0..=180.0).contains(&number("virtual_s")), "{summary}");
    assert_eq!(summary["seed"].as_u64(), Some(0));
    let digest = summary["digest"].as_str().unwrap();
    assert!(digest.len() == 32 && digest.bytes().all(|byte| byte.is_ascii_hexdigit()), "{digest}");

    let boards = summary["boards"].as_object().unwrap();
    assert_eq!(boards.keys().collect::<Vec<_>>(), ["depth", "master", "spindle", "transverse"]);
    assert_eq!(pids(&summary).len(), 5);
    // The tool ends where it began, and everything stands.
    for (board, quantity, expected) in [
        ("master", "frames_distributed", frames as i64),
        ("spindle", "speed_rpm", 0),
        ("transverse", "position_counts", 0),
        ("depth", "position_counts", 0),
    ] {
        assert_eq!(summary["boards"][board][quantity].as_i64(), Some(expected), "{board} {quantity}");
    }
}

#[test]
fn a_run_at_a_pace_is_no_faster_than_that_and_one_without_is_faster_than_the_machine() {
    let told = |arguments: &[&str]| {
        let summary = json(&output(&[&["run", "--json"], arguments].concat()));
        ["virtual_s", "wall_s", "speedup"].map(|name| summary[name].as_f64().unwrap())
    };
    for driver in [&[][..], &["--in-process"]] {
        let [virtual_s, wall_s, speedup] = told(&[&["--pace", "200"], driver].concat());
        assert!(wall_s >= virtual_s / 200.0, "{virtual_s} s in {wall_s} s");
        assert!(speedup <= 200.0, "{speedup}");
        let [.., speedup] = told(driver);
        assert!(speedup > 1.0, "{speedup}");
    }
}

/// The lead compensator as printed never brings the spindle to its speed: nothing ends by itself.
#[test]
fn a_program_that_gets_no_further_is_given_up() {
    let folder = folder();
    let trace = folder.path().join("run.trace");
    let endless = ["run", "--set", "spindle.controller.form=literal", "--patience", "90 s", "--record"];
    let output = |more: &[&str]| output(&[&endless[..], &[trace.to_str().unwrap()], more].concat());
    let text = output(&[]);
    assert_eq!(text.status.code(), Some(1));
    let text = String::from_utf8(text.stdout).unwrap();
    assert!(text.contains("\ngiven up: nothing has been accepted for long; master waits for spindle\n"), "{text}");
    assert!(text.ends_with("outcome  unanswered\n"), "{text}");
    let digests: BTreeSet<String> = [&["--json"][..], &["--json", "--in-process"], &["--json", "--pace", "2000"]]
        .map(|more| json(&output(more))["digest"].as_str().unwrap().to_owned())
        .into();
    assert_eq!(digests.len(), 1, "{digests:?}");
    let repeated = crate::common::output(&["replay", trace.to_str().unwrap()]);
    assert!(String::from_utf8_lossy(&repeated.stdout).starts_with("same digest"), "{repeated:?}");
    let wrong = crate::common::output(&["run", "--patience", "long"]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&wrong.stderr).contains("expected a time, such as"), "{wrong:?}");
}

#[test]
fn a_run_breaks_what_it_is_told_to() {
    let folder = folder();
    let (faults, trace) = (folder.path().join("faults.toml"), folder.path().join("run.trace"));
    let text = "[[fault]]\nline = \"depth_to_master\"\nkind = \"noise\"\nperiod = \"20 ms\"\n\
                [[fault]]\nname = \"chip\"\nboard = \"transverse\"\nkind = \"load\"\nvalue = \"5 %..20 %\"\n\
                when = { line = \"pc_to_master\", character = 24 }\nfor = \"2 s\"\n\
                [[fault]]\nname = \"late\"\nboard = \"spindle\"\nkind = \"stall\"\nat = \"1000 s\"\n";
    std::fs::write(&faults, text).unwrap();
    let broken = ["run", "--json", "--faults", faults.to_str().unwrap(), "--record", trace.to_str().unwrap()];
    let mut digests = BTreeSet::new();
    for more in [&["--in-process"][..], &["--pace", "500"], &[]] {
        let output = output(&[&broken[..], more].concat());
        let log = String::from_utf8_lossy(&output.stderr);
        assert!(log.starts_with("seed 0, fault.chip.value = "), "{log}");
        assert!(log.contains("fault 'chip' begins") && log.contains("the fault 'late' has not fired"), "{log}");
        digests.insert(json(&output)["digest"].as_str().unwrap().to_owned());
        let repeated = crate::common::output(&["replay", trace.to_str().unwrap()]);
        assert!(String::from_utf8_lossy(&repeated.stdout).starts_with("same digest"), "{repeated:?}");
    }
    assert_eq!(digests.len(), 1, "{digests:?}");
    let other = json(&output(&[&broken[..], &["--seed", "7"]].concat()));
    assert!(!digests.contains(other["digest"].as_str().unwrap()));
}

/// The processes of a summary: the harness's and the boards'.
fn pids(summary: &Value) -> BTreeSet<u64> {
    let boards = summary["boards"].as_object().unwrap().values();
    boards.chain([summary]).map(|process| process["pid"].as_u64().unwrap()).collect()
}

#[test]
fn the_summary_for_people_shows_five_processes_and_ends_with_completed() {
    let output = output(&["run"]);
    assert_eq!(output.status.code(), Some(0));
    let text = String::from_utf8(output.stdout).unwrap();
    let pid = |name: &str| {
        let line = text.lines().find(|line| line.starts_with(name)).unwrap_or_else(|| panic!("{name}: {text}"));
        line.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap()
    };
    let pids: BTreeSet<u64> = ["harness", "master", "spindle", "transverse", "depth"].map(pid).into();
    assert_eq!(pids.len(), 5, "{text}");
    assert!(text.ends_with("completed\n"), "{text}");
    assert!(!text.contains('\x1b'), "no colours where no one looks: {text}");
    assert!(text.contains("30 of 30 sent"), "{text}");
}

#[test]
fn in_one_process_there_is_one_process() {
    let summary = json(&output(&["run", "--json", "--in-process", "--seed", "7"]));
    assert_eq!(pids(&summary).len(), 1);
    assert_eq!((&summary["outcome"], summary["seed"].as_u64()), (&"completed".into(), Some(7)));
}

// --- the digest -----------------------------------------------------------------------------------------------------

fn digest(arguments: &[&str]) -> String {
    let output = output(&[&["run", "--json"], arguments].concat());
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    json(&output)["digest"].as_str().unwrap().to_owned()
}

#[test]
fn the_digest_is_the_same_in_processes_in_one_process_and_at_a_pace() {
    let first = digest(&[]);
    assert_eq!(digest(&[]), first);
    assert_eq!(digest(&["--in-process"]), first);
    assert_eq!(digest(&["--pace", "200"]), first);
    assert_eq!(digest(&["--in-process", "--pace", "500"]), first);
    let folder = folder();
    assert_eq!(digest(&["--vcd", folder.path().join("torno.vcd").to_str().unwrap()]), first);
}

#[test]
fn the_digest_is_the_same_while_all_cores_are_busy() {
    let idle = digest(&[]);
    let stop = AtomicBool::new(false);
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().unwrap().get() {
            scope.spawn(|| {
                while !stop.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        let busy: Vec<String> = (0..3).map(|_| digest(&[])).chain([digest(&["--pace", "200"])]).collect();
        stop.store(true, Ordering::Relaxed);
        assert_eq!(busy, [&*idle; 4]);
    });
}

#[test]
fn another_program_has_another_digest() {
    let folder = folder();
    let path = folder.path().join("other.frames");
    std::fs::write(&path, DEMONSTRATION.replacen("4B 46 46 50", "4B 46 46 51", 1)).unwrap();
    assert_ne!(digest(&[path.to_str().unwrap()]), digest(&[]));
}

/// The digest of the demonstration when time is cut into windows at random instants.
async fn digest_in_random_windows(driver: &Driver, seed: u64) -> String {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let file = RigFile::load("lathe").unwrap();
    let uart = PcUart::new(file.pc.baud, file.pc.tx_fifo, file.pc.clock).with_program(Careful::default());
    let mut rig = Rig::start(&file, driver, uart).await.unwrap();
    let pc = rig.pc();
    rig.stimulate(pc, seconds(0.01), Stimulus::Write(demonstration().bytes()));
    let mut digest = Digest::new(rig.layout());
    let mut until = Instant::START;
    while !rig.engine().is_quiet() {
        // Mostly near the next thing that happens, from a nanosecond to milliseconds after it: each order of magnitude
        // is as likely as any other. Sometimes much later.
        let magnitude = if random.next_u32() % 32 == 0 { 10 } else { 8 };
        let next = rig.engine().next_instant();
        let from = if next.is_never() { until } else { until.max(next) };
        until = from + Span::from_nanos(random.next_u64() % 10u64.pow(random.next_u32() % magnitude));
        let silence = if random.next_u32() % 2 == 0 { until } else { Instant::NEVER };
        for _ in 0..random.next_u32() % 4 {
            rig.step(Limit { until, silence }).await.unwrap();
        }
        if random.next_u32() % 2 == 0 {
            rig.advance(Limit::until(until)).await.unwrap();
        }
        rig.take_facts().iter().for_each(|fact| digest.add(fact));
        assert!(until < seconds(1000.0), "the rig never falls quiet");
    }
    let end = rig.engine().quiet_since();
    rig.catch_up(end.next()).await.unwrap();
    rig.take_facts().iter().for_each(|fact| digest.add(fact));
    digest.sum().to_string()
}

#[test]
fn the_digest_is_the_same_when_time_is_cut_at_random_instants() {
    let expected = digest(&[]);
    for seed in 0..6 {
        assert_eq!(block_on(digest_in_random_windows(&Driver::InProcess, seed)), expected, "seed {seed}");
    }
    assert_eq!(block_on(digest_in_random_windows(&processes(), 6)), expected, "in processes");
}

// --- the waveforms --------------------------------------------------------------------------------------------------

fn demonstration_dump(path: &Path) -> Dump {
    let summary = json(&output(&["run", "--json", "--vcd", path.to_str().unwrap(), "--vcd-step", "1 ns"]));
    assert_eq!(summary["outcome"], "completed");
    Dump::read(&std::fs::read_to_string(path).unwrap())
}

#[test]
fn the_dump_has_the_eight_lines_idle_high_around_all_characters() {
    let folder = folder();
    let dump = demonstration_dump(&folder.path().join("torno.vcd"));
    let names = SLAVE_LINES.iter().flat_map(|(to, from, _)| [*to, *from]).chain(PC_LINES).collect::<BTreeSet<_>>();
    assert_eq!(dump.wires.keys().map(String::as_str).collect::<BTreeSet<_>>(), names);
    for (wire, changes) in &dump.wires {
        assert_eq!(changes[0], (0, true), "{wire} is idle at 0");
        assert!(changes[1].0 > CHARACTER, "{wire} is idle for a character before the first start bit");
        assert!(changes[1..].windows(2).all(|two| two[0].1 != two[1].1), "{wire}: each change changes");
        let last = dump.characters(wire).last().unwrap().0;
        assert!(dump.end > last + CHARACTER, "{wire}: the dump goes on past the last stop bit");
        assert!(dump.level(wire, dump.end), "{wire} is idle at the end");
    }
}

#[test]
fn the_dump_has_room_around_the_characters_of_a_slow_line_too() {
    let folder = folder();
    let rig = folder.path().join("slow.toml");
    let path = folder.path().join("torno.vcd");
    for (baud, ppm) in [(50, -200_000), (300, 0), (300, -200_000), (300, 200_000), (1200, 0), (115_200, 0)] {
        let text = include_str!("../harness/builtin/lathe.toml");
        let text = text.replace("baud = 9600", &format!("baud = {baud}\nclock_ppm = {ppm}"));
        std::fs::write(&rig, text).unwrap();
        // The master does not understand that speed; it is the waveform that matters.
        output(&["run", rig.to_str().unwrap(), "--in-process", "--vcd", path.to_str().unwrap(), "--vcd-step", "1 ns"]);
        let dump = Dump::read(&std::fs::read_to_string(&path).unwrap());
        // The first byte is 4B: its start bit ends with an edge. Ten bits are a character.
        let changes = &dump.wires["pc_to_master"];
        let character = 10 * (changes[2].0 - changes[1].0);
        let nominal = 10 * SECOND / baud;
        assert!((nominal * 3 / 4..nominal * 4 / 3).contains(&character), "{baud}: {character} ns");
        assert!(changes[1].0 > character, "{baud} baud, {ppm} ppm: idle for a character before the first start bit");
        // Whatever the last edge is, what is left of its character is in the dump.
        let last = changes.last().unwrap();
        assert!(
            last.1 && dump.end > last.0 + character,
            "{baud} baud, {ppm} ppm: the dump goes on past the last stop bit"
        );
    }
}

#[test]
fn every_line_carries_exactly_what_it_must() {
    let folder = folder();
    let dump = demonstration_dump(&folder.path().join("torno.vcd"));
    let frames = demonstration().frames;
    assert_eq!(dump.bytes("pc_to_master"), frames.concat());
    // Every frame but the first is held.
    let mut replies = vec![ACK];
    frames.iter().skip(1).for_each(|_| replies.extend([XOFF, XON, ACK]));
    replies.push(XON);
    assert_eq!(dump.bytes("master_to_pc"), replies);

    let mut enquiries = 0;
    for (to, from, part) in SLAVE_LINES {
        let mut parts = Vec::new();
        // Asked at the start, it has just started.
        let mut answers = vec![CAN, b'r'];
        let mut bursts = dump.bursts(to).into_iter();
        assert_eq!(bursts.next().map(|(_, burst)| burst), Some(vec![ENQ]), "{to}");
        let mut done = (0..frames.len()).flat_map(|n| [ACK, if n % 2 == 0 { b'o' } else { b'e' }]);
        for (_, burst) in bursts {
            if burst == [ENQ] {
                enquiries += 1;
                answers.push(BEL);
            } else {
                // The last part is done before the next one comes.
                answers.extend(done.by_ref().take(if parts.is_empty() { 0 } else { 2 }));
                parts.push(burst);
            }
        }
        answers.extend(done);
        assert_eq!(parts, frames.iter().map(|frame| frame[part.clone()].to_vec()).collect::<Vec<_>>(), "{to}");
        assert_eq!(dump.bytes(from), answers, "{from}");
    }
    assert!(enquiries > 50, "a process is watched while it runs: only {enquiries} enquiries");
}

#[test]
fn sigrok_decodes_every_line_as_it_must_be() {
    if !is_installed("sigrok-cli", Command::new("sigrok-cli").arg("--version")) {
        return;
    }
    let folder = folder();
    let path = folder.path().join("torno.vcd");
    let dump = demonstration_dump(&folder.path().join("fine.vcd"));
    // What is written where nothing is said of the step is read without an option.
    assert_eq!(output(&["run", "--in-process", "--vcd", path.to_str().unwrap()]).status.code(), Some(0));
    for wire in dump.wires.keys() {
        let output = Command::new("sigrok-cli")
            .args(["-I", "vcd", "-i", path.to_str().unwrap()])
            .args(["-P", &format!("uart:rx={wire}:baudrate={BAUD}")])
            .args(["-A", "uart=rx-data:rx-warnings:rx-break"])
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8(output.stdout).unwrap();
        let byte = |line: &str| {
            let byte = line.strip_prefix("uart-1: ").and_then(|hex| u8::from_str_radix(hex, 16).ok());
            byte.unwrap_or_else(|| panic!("{wire}: {line}"))
        };
        let bytes: Vec<u8> = text.lines().map(byte).collect();
        // What these must be, the test above says.
        assert_eq!(bytes, dump.bytes(wire), "{wire}");
        assert!(wire != "pc_to_master" || bytes == demonstration().bytes());
    }
}
