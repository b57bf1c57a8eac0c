//! The servo stand: the board and its loop over the real line, and the PC program on the rig.

#![allow(clippy::disallowed_methods, reason = "what is expected is not compared to the last digit")]

use std::cell::RefCell;
use std::fs;
use std::path::Path;
use std::process::Output;
use std::rc::Rc;

use crate::common::{folder, json, output, torno};
use torno::rig::Driver;
use torno::rig::file::RigFile;
use torno::servo::{Controller, Gain, RigLine, RunEnd, Sample, contour};
use torno_servo::contour::{Shape, Task};
use torno_servo::{Limits, compile};

/// What a run has come to.
struct Run {
    ended: RunEnd,
    samples: Vec<Sample>,
    set_points: Vec<i64>,
    /// The board's own following error each time it changed, without the PC's byte in between.
    told: Vec<i64>,
    position: i64,
}

/// Runs a program on the real board, over the real line, with these gains and settings.
fn run(text: &str, kx: u8, kv: u8, settings: &[&str]) -> Run {
    let file = RigFile::load("servo").unwrap();
    let file = settings.iter().fold(file, |file, set| file.set(set).unwrap());
    let program = compile(text, &Limits::default()).program.unwrap();
    let increments = program.increments(125.0);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let mut line = RigLine::start(&file, &Driver::InProcess).await.unwrap();
        let told = Rc::new(RefCell::new((Vec::new(), 0)));
        let seen = Rc::clone(&told);
        line.watch(Box::new(move |_, _, quantity, value| match quantity {
            "error_counts" => seen.borrow_mut().0.push(value),
            "position_counts" => seen.borrow_mut().1 = value,
            _ => {}
        }));
        let mut controller = Controller::connect(line).await.unwrap();
        assert_eq!(controller.set_gain(Gain::Kx, kx).await.unwrap(), kx);
        assert_eq!(controller.set_gain(Gain::Kv, kv).await.unwrap(), kv);
        controller.download(&increments, |_, _| {}).await.unwrap();
        let mut samples = Vec::new();
        let ended = controller.run(increments.len(), |sample| {
            samples.push(sample);
            true
        });
        let ended = ended.await.unwrap();
        // It settles.
        controller.check_link().await.unwrap();
        drop(controller);
        let (told, position) = Rc::try_unwrap(told).unwrap().into_inner();
        Run { ended, samples, set_points: program.set_points(125.0).collect(), told, position }
    })
}

fn mean(samples: &[Sample]) -> f64 {
    samples.iter().map(|sample| sample.error as f64).sum::<f64>() / samples.len() as f64
}

#[test]
fn the_steady_following_error_is_what_the_gains_predict() {
    for (kx, kv, expected) in [(16, 0, 76.2), (20, 0, 61.0), (32, 0, 38.1), (20, 98, 30.3), (20, 195, 0.0)] {
        let Run { ended, samples, .. } = run("x20 t2\ne", kx, kv, &[]);
        let found = mean(&samples[200..390]);
        assert!((found - expected).abs() <= 1.0, "Kx {kx}, Kv {kv}: {found}, expected {expected}");
        assert_eq!((ended, samples.len()), (RunEnd::Completed, 400));
    }
}

#[test]
fn beyond_a_byte_the_telemetry_wraps_and_the_error_is_found_again() {
    let Run { samples, told, .. } = run("x32 t2\ne", 12, 0, &[]);
    let Sample { error, shown, .. } = samples[349];
    assert!((error - 162).abs() <= 1, "{error}");
    assert_eq!(i64::from(shown), error - 256);
    // Each error that the PC makes of its bytes is one that the board had.
    assert!(samples.iter().all(|sample| told.contains(&sample.error)));
    // At Kx 16 it is right, once the motor has caught up.
    let Run { samples, .. } = run("x32 t2\ne", 16, 0, &[]);
    assert!(samples[100..].iter().all(|sample| sample.error == i64::from(sample.shown)));
}

#[test]
fn feed_forward_all_but_removes_the_error_of_ramps() {
    let greatest = |kv| {
        let samples = run("p0 k10 x5\nx10 t1\np10 k0 x5\ne", 20, kv, &[]).samples;
        samples.iter().map(|sample| sample.error.abs()).max().unwrap()
    };
    let (without, with) = (greatest(0), greatest(195));
    assert!((61..=63).contains(&without) && (2..=4).contains(&with), "{without} {with}");
}

/// Type 1, gain KV = 20.5 1/s: the mean of a parabola's error over its last tenth, beside the formula's.
#[test]
fn an_acceleration_lags_as_the_formula_says() {
    let Run { samples, .. } = run("p0 k5 x2\ne", 20, 0, &["servo.plant.tau_s=0.001"]);
    let kv = 20.0 / 16.0 * 16.404_199_48;
    let error = |t: f64| 6.25 / kv * (t - (1.0 - (-kv * t).exp()) / kv) * 125.0;
    let (from, to) = (140, 160);
    let expected = (from..to).map(|tick| error((tick + 1) as f64 * 0.005)).sum::<f64>() / (to - from) as f64;
    let found = mean(&samples[from..to]);
    // Half a count is the encoder's; the loop is sampled.
    assert!((found - expected).abs() < 1.0, "{found} {expected}");
}

#[test]
fn damping_lags_where_feed_forward_leads() {
    let steady = |kv_on: &str| {
        let set = format!("servo.controller.kv_on={kv_on}");
        mean(&run("x20 t2\ne", 20, 98, &[&set]).samples[200..390])
    };
    let (feed_forward, damping) = (steady("set-point"), steady("position"));
    assert!((feed_forward - 30.3).abs() <= 1.0 && (damping - 91.7).abs() <= 1.5, "{feed_forward} {damping}");
}

#[test]
fn every_program_of_the_sheet_ends_where_it_should() {
    for (text, start) in [
        ("x10 t2\nx0 t1\ne", 0),
        ("p0 k5 x2\nx10 t2\np5 k0 x2\nx0 t1\ne", 0),
        ("p5 k0 x1\np0 k-5 x-1\nx0 t1\ne", 0),
        ("p0 k3 x1\nx0 t1\ne", 0),
    ] {
        let Run { ended, set_points, position, .. } = run(text, 16, 0, &[]);
        let expected = start + set_points.last().unwrap();
        assert_eq!(ended, RunEnd::Completed, "{text}");
        assert!((position - expected).abs() <= 1, "{text}: {position}, expected {expected}");
    }
}

/// Each: the program, its ticks, its counts, the greatest increment.
#[test]
fn each_program_takes_its_time_and_goes_its_way() {
    for (text, ticks, counts, most) in [
        ("x10 t2\ne\n", 400, 1_250, 4),
        ("p0 k5 x2\ne\n", 160, 250, 3),
        ("p5 k0 x2\ne\n", 160, 250, 3),
        ("p5 k0 x1\np0 k-5 x-1\ne\n", 160, 0, 3),
        ("p0 k3 x1\ne\n", 134, 125, 2),
        ("p0 k5 x2\nx10 t2\np5 k0 x2\ne\n", 720, 1_750, 4),
    ] {
        let Run { ended, samples, set_points, told, .. } = run(text, 20, 0, &[]);
        assert_eq!((ended, samples.len(), set_points.len()), (RunEnd::Completed, ticks, ticks), "{text}");
        assert_eq!(set_points.last(), Some(&counts), "{text}");
        let steps = set_points.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        assert_eq!(steps.max(), Some(most), "{text}");
        // The board tells what changes, and it begins with 0.
        assert!(samples.iter().all(|sample| sample.error == 0 || told.contains(&sample.error)), "{text}");
        let settled = run(&text.replace("e\n", "x0 t1\ne\n"), 20, 0, &[]);
        assert!((settled.position - counts).abs() <= 1, "{text}: {}", settled.position);
    }
}

/// With Kx 0 nothing moves, and the error is the set point.
#[test]
fn the_byte_shows_each_error_as_the_sheet_says() {
    let file = RigFile::load("servo").unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let shown = runtime.block_on(async {
        let line = RigLine::start(&file, &Driver::InProcess).await.unwrap();
        let mut controller = Controller::connect(line).await.unwrap();
        let mut shown = Vec::new();
        // Away from the end of the travel first.
        for (kx, increments) in [(32, [4; 300]), (0, [1; 300]), (32, [0; 300]), (0, [-1; 300])] {
            controller.set_gain(Gain::Kx, kx).await.unwrap();
            controller.download(&increments, |_, _| {}).await.unwrap();
            let ended = controller.run(increments.len(), |sample| {
                shown.push((sample.error, i64::from(sample.shown)));
                true
            });
            assert_eq!(ended.await.unwrap(), RunEnd::Completed);
        }
        shown
    });
    for case in [(127, 127), (128, -128), (-128, -128), (-129, 127), (200, -56), (256, 0), (162, -94)] {
        assert!(shown.contains(&case), "{case:?}");
    }
}

/// The loop is stable up to Kx 401, and a byte holds 255.
#[test]
fn every_gain_that_can_be_set_is_stable() {
    let Run { samples, .. } = run("x2 t0.5\nx0 t1\ne\n", 255, 0, &[]);
    assert!(samples[200..].iter().all(|sample| sample.error.abs() <= 1), "{:?}", &samples[200..]);
}

/// A step of 80 counts in one tick, which does not fill the drive.
#[test]
fn a_step_overshoots_as_the_damping_says() {
    let Run { samples, .. } = run("x0.64 t0.005\nx0 t1\ne\n", 20, 0, &[]);
    let over = -samples.iter().map(|sample| sample.error).min().unwrap();
    let (gain, tau) = (20.0 / 16.0 * 16.404_199_48, 0.03_f64);
    let overshoot = |damping: f64| (-std::f64::consts::PI * damping / (1.0 - damping * damping).sqrt()).exp() * 80.0;
    let damping = 1.0 / (2.0 * (gain * tau).sqrt());
    // The loop acts half a tick late, which takes from its damping; a count is the encoder's.
    let late = damping * (1.0 - gain * 0.0025);
    assert!((overshoot(damping) - 1.0..overshoot(late) + 1.0).contains(&(over as f64)), "{over}");
}

#[test]
fn what_leaves_the_travel_ends_early() {
    let Run { ended, samples, position, .. } = run("x1 t1\nx-2 t2\ne", 16, 0, &[]);
    assert_eq!(ended, RunEnd::Early);
    assert!((399..=401).contains(&samples.len()) && position.abs() <= 1, "{} {position}", samples.len());
}

fn written(folder: &Path, text: impl AsRef<[u8]>) -> String {
    let path = folder.join("program.txt");
    fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

fn servo(arguments: &[&str]) -> Output {
    output(&[&["servo"], arguments].concat())
}

fn told(output: &Output) -> (Option<i32>, String, String) {
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

#[test]
fn check_underlines_each_fault_and_says_how_it_ended() {
    let folder = folder();
    let program = written(folder.path(), "x10 t2\r\n\tX10 t2\r\np5 k-5 x2\r\ne\r\n");
    let expected = format!(
        "{program}:2:2: w linii 2 napotkano nieznany parametr\n 2 | \tX10 t2\n   | \t^^^\n\
         {program}:3:1: w linii numer 3 szybkość zmienia znak\n 3 | p5 k-5 x2\n   | ^^^^^^^^^\n\
         kompilacja przerwana\n"
    );
    assert_eq!(told(&servo(&["check", "--lang", "pl", &program])), (Some(1), expected, String::new()));
    let program = written(folder.path(), "x10 t2\ne\n");
    let complete = |lang| told(&servo(&["check", "--lang", lang, &program])).1;
    assert_eq!((complete("pl"), complete("en")), ("kompilacja kompletna\n".into(), "compilation complete\n".into()));
    let found = json(&servo(&["check", "--json", &program]));
    assert_eq!((found["ticks"].as_u64(), found["seconds"].as_f64()), (Some(400), Some(2.0)));
}

/// The sheet's own lines and messages, to the letter; what is faulty is not run.
#[test]
fn the_sheets_own_examples_are_judged_as_it_says() {
    let folder = folder();
    let told_in = |language: &str, text: &str| {
        let program = written(folder.path(), text);
        let (code, out, error) = told(&servo(&["check", "--lang", language, &program]));
        let said = |line: &str| line.strip_prefix(&format!("{program}:")).map(|rest| rest.to_owned());
        let found: Vec<String> = out.lines().filter_map(said).collect();
        assert_eq!(error, "");
        (code, found.join("; "), out.lines().last().unwrap().to_owned())
    };
    for text in ["x10 t2", "x0 t1\nx-10 t2", "p0 k5 x2", "p5 k0 x2", "p0 k-5 x-2", "p5 k0 x1\np0 k-5 x-1"] {
        let (code, _, verdict) = told_in("pl", &format!("{text}\ne\n"));
        assert_eq!((code, verdict.as_str()), (Some(0), "kompilacja kompletna"), "{text}");
    }
    for (text, expected) in [
        ("p5 k0 1x\np0 k-5 x-1\ne", "1:7: w linii 1 napotkano nieznany parametr"),
        ("p5 k-5 x2\ne", "1:1: w linii numer 1 szybkość zmienia znak"),
        ("p5 k-5 x-2\ne", "1:1: w linii numer 1 szybkość zmienia znak"),
        ("x10 t2\nX10 t2\ne", "2:1: w linii 2 napotkano nieznany parametr"),
        ("x10\ne", "1:1: w linii 1 brak wymaganego parametru"),
        ("p0 k5\ne", "1:1: w linii 1 brak wymaganego parametru"),
    ] {
        let found = told_in("pl", text);
        assert_eq!(found, (Some(1), expected.to_owned(), "kompilacja przerwana".to_owned()), "{text}");
        let (code, english, verdict) = told_in("en", text);
        assert!(code == Some(1) && !english.is_empty() && verdict == "compilation aborted", "{text}: {english}");
        let (code, out, error) = told(&servo(&["run", "--lang", "pl", &written(folder.path(), text)]));
        assert!(code == Some(1) && out.is_empty() && error.ends_with("kompilacja przerwana\n"), "{error}");
    }
}

#[test]
fn a_file_that_is_no_text_or_not_there_is_broken_input() {
    let folder = folder();
    let program = written(folder.path(), b"x10 t2\n\xff\xfe\ne\n");
    let (code, out, error) = told(&servo(&["check", &program]));
    assert_eq!((code, out), (Some(2), String::new()));
    assert!(error.contains("line 2") || error.contains(":2"), "{error}");
    let (code, _, error) = told(&servo(&["check", "nothing.txt"]));
    assert!(code == Some(2) && error.contains("cannot read the program 'nothing.txt'"), "{error}");
}

#[test]
fn plot_draws_the_way_over_time() {
    let folder = folder();
    let program = written(folder.path(), "p0 k5 x2\nx10 t2\np5 k0 x2\ne\n");
    let picture = folder.path().join("out.svg");
    let (code, out, error) = told(&servo(&["plot", &program, "-o", picture.to_str().unwrap()]));
    assert_eq!((code, out, error), (Some(0), String::new(), String::new()));
    let svg = fs::read_to_string(picture).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains("s, mm") && svg.contains("t, s"));
    assert_eq!(told(&servo(&["plot", &program])).1, svg);
}

#[test]
fn a_picture_is_what_its_name_says_in_the_colours_that_are_asked_for() {
    let folder = folder();
    let program = written(folder.path(), "x10 t2\ne\n");
    let picture = folder.path().join("out.png");
    let colours = ["--colour", "background=102030", "--colour", "line1=ffcc00"];
    let plot = |more: &[&str]| servo(&[&["plot", &program], more, &colours[..]].concat());
    assert_eq!(told(&plot(&["-o", picture.to_str().unwrap()])), (Some(0), String::new(), String::new()));
    assert!(fs::read(picture).unwrap().starts_with(b"\x89PNG\r\n\x1a\n"));
    let svg = told(&plot(&[])).1;
    assert!(svg.contains("#102030") && svg.contains("#FFCC00") && !svg.contains("#FFFFFF"), "{svg}");
    let (code, _, error) = told(&servo(&["plot", &program, "--colour", "bakground=ffffff"]));
    assert!(code == Some(2) && error.contains("there is no part 'bakground': did you mean 'background'?"), "{error}");
}

/// The pictures in the documentation are what its commands draw.
#[test]
fn the_pictures_that_are_shown_are_those_that_are_drawn() {
    let folder = folder();
    fs::write(folder.path().join("ramps.txt"), "p0 k10 x5\nx10 t1\np10 k0 x5\nx0 t0.5\ne\n").unwrap();
    fs::write(folder.path().join("wrap.txt"), "x32 t2\nx0 t0.5\ne\n").unwrap();
    for (picture, arguments) in [
        ("servo-kv-0.svg", "run ramps.txt --kx 20 --kv 0"),
        ("servo-kv-195.svg", "run ramps.txt --kx 20 --kv 195"),
        ("servo-wrap.svg", "run wrap.txt --kx 12 --kv 0"),
        ("servo-contour.svg", "contour"),
    ] {
        let arguments: Vec<&str> = ["servo"].into_iter().chain(arguments.split(' ')).chain(["-o", "-"]).collect();
        let drawn = torno(&arguments).current_dir(folder.path()).output().unwrap();
        let shown = format!("{}/../docs/{picture}", env!("CARGO_MANIFEST_DIR"));
        let shown = fs::read(shown).unwrap_or_default();
        assert!(drawn.stdout == shown, "repeat: torno {} docs/{picture}", arguments[..arguments.len() - 1].join(" "));
    }
}

#[test]
fn run_reports_draws_and_writes_the_data() {
    let folder = folder();
    let program = written(folder.path(), "x32 t2\nx0 t0.5\ne\n");
    let [picture, data] = ["out.svg", "out.csv"].map(|name| folder.path().join(name));
    let files = ["-o", picture.to_str().unwrap(), "--csv", data.to_str().unwrap()];
    let report = json(&servo(&[&["run", &program, "--kx", "12", "--kv", "0", "--json"], &files[..]].concat()));
    assert_eq!((report["kx"].as_u64(), report["ticks"].as_u64()), (Some(12), Some(500)));
    assert_eq!((report["outcome"].as_str(), report["set_counts"].as_i64()), (Some("completed"), Some(4_000)));
    assert!(report["wrapped_samples"].as_u64().unwrap() > 300);
    assert!(fs::read_to_string(picture).unwrap().contains("as shown by one byte"));
    let data = fs::read_to_string(data).unwrap();
    assert_eq!(data.lines().count(), 501);
    assert!(data.starts_with("time_s,set_mm,actual_mm,error_counts,shown_counts\n0.005,0.080,0.000,10,10\n"), "{data}");
}

#[test]
fn a_run_is_recorded_traced_repeated_and_compared() {
    let folder = folder();
    let program = written(folder.path(), "x1 t0.1\ne\n");
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let [one, other, of_run, of_trace] = ["one", "other", "run.html", "trace.html"].map(path);
    let run = |more: &[&str]| json(&servo(&[&["run", &program, "--json"], more].concat()));
    let recorded = run(&["--record", &one, "--report", &of_run]);
    let board = recorded["rig"]["boards"]["servo"]["pid"].as_u64().unwrap();
    assert_ne!(board, u64::from(std::process::id()));
    let digest = recorded["rig"]["digest"].as_str().unwrap();

    let (code, out, _) = told(&output(&["trace", &one, "--kind", "frames"]));
    assert_eq!(code, Some(0));
    for said in ["> is somebody there?", "> a program of 20 increments, +125 counts", "> run", "> following error +6"] {
        assert!(out.contains(said), "{said}: {out}");
    }
    let again = json(&output(&["replay", &one, "--json"]));
    assert_eq!((again["same"].as_bool(), again["digest"].as_str()), (Some(true), Some(digest)));

    // In one process, and held back, the same happens.
    let paced = run(&["--record", &other, "--in-process", "--pace", "20"]);
    assert_eq!(paced["rig"]["digest"].as_str(), Some(digest));
    let (code, out, _) = told(&output(&["diff", &one, &other]));
    assert!(code == Some(0) && out.starts_with("identical"), "{out}");
    let further = run(&["--record", &other, "--kx", "20"]);
    assert_ne!(further["rig"]["digest"].as_str(), Some(digest));
    assert_eq!(told(&output(&["diff", &one, &other])).0, Some(1));

    assert_eq!(told(&output(&["trace", &one, "--report", &of_trace])).0, Some(0));
    let page = fs::read_to_string(of_run).unwrap();
    assert!(page.contains("following error") && page.contains("program.txt"));
    assert_eq!(page, fs::read_to_string(of_trace).unwrap());
}

#[test]
fn a_port_is_no_rig_to_record_or_to_hold_back() {
    for more in [["--record", "a"], ["--pace", "1"], ["--report", "a"]] {
        let (code, _, error) = told(&servo(&[&["run", "a.txt", "--port", "/dev/nowhere"], &more[..]].concat()));
        assert!(
            code == Some(2) && error.contains(&format!("'--port <PATH>' cannot be used with '{}", more[0])),
            "{error}"
        );
    }
}

/// 400 s are 80 000 increments, and the controller's memory takes 65 535.
#[test]
fn a_program_that_the_controller_cannot_hold_is_run_in_parts() {
    let folder = folder();
    let program = written(folder.path(), "x10 t2\nx0 t200\nx-5 t198\ne\n");
    let data = folder.path().join("out.csv");
    let report = json(&servo(&["run", &program, "--json", "--in-process", "--csv", data.to_str().unwrap()]));
    assert_eq!((report["outcome"].as_str(), report["ticks"].as_u64()), (Some("completed"), Some(80_000)));
    let ends = (report["set_counts"].as_i64(), report["rig"]["boards"]["servo"]["at_end"]["set_point_counts"].as_i64());
    assert_eq!(ends, (Some(625), Some(625)));
    assert_eq!(report["actual_counts"].as_i64().map(|actual| (actual - 625).abs() <= 4), Some(true), "{report}");
    let data = fs::read_to_string(data).unwrap();
    assert_eq!(data.lines().count(), 80_001);
    // Each tick has its time, over both parts.
    let times = data.lines().skip(1).map(|line| line.split(',').next().unwrap().parse::<f64>().unwrap());
    assert!(times.enumerate().all(|(n, time)| (time - (n + 1) as f64 * 0.005).abs() < 1e-6));
}

#[test]
fn what_cannot_be_driven_is_not_sent() {
    let folder = folder();
    let program = written(folder.path(), "x1 t1\nx-2 t2\ne\n");
    let (code, out, error) = told(&servo(&["run", &program]));
    assert_eq!((code, out), (Some(1), String::new()));
    assert!(
        error.contains("line 2 goes to -1 mm") && error.ends_with("nothing is sent to the controller\n"),
        "{error}"
    );
    let (code, out, _) = told(&servo(&["run", "--force", &program]));
    assert!(code == Some(1) && out.contains("ended early by the controller"), "{out}");
}

#[test]
fn each_machine_has_its_own_program() {
    let (code, _, error) = told(&output(&["run", "servo"]));
    let expected = "is for rigs that speak lathe, and the rig 'servo' speaks servo: use 'torno servo run'";
    assert!(code == Some(2) && error.contains(expected), "{error}");
    let folder = folder();
    let program = written(folder.path(), "x10 t2\ne\n");
    let (code, _, error) = told(&servo(&["run", "--rig", "lathe", &program]));
    assert!(code == Some(2) && error.contains("the rig 'lathe' speaks lathe, not servo: use 'torno run'"), "{error}");
}

#[test]
fn a_controller_that_falls_silent_in_mid_run_is_told() {
    let file = RigFile::load("servo").unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let line = RigLine::start(&file, &Driver::InProcess).await.unwrap();
        let mut controller = Controller::connect(line).await.unwrap();
        controller.download(&[4; 400], |_, _| {}).await.unwrap();
        let rig = controller.line();
        let (board, at) = (0, rig.now() + torno_protocol::time::Span::from_secs(1));
        rig.session().stimulate(board, at, torno_protocol::board::Stimulus::Power(false));
        let error = controller.run(400, |_| true).await.unwrap_err().to_string();
        assert_eq!(error, "the controller on the rig 'servo' has fallen silent after 200 of 400 ticks");
        assert!(controller.line().now() < at + torno_protocol::time::Span::from_secs(2));
    });
}

#[test]
fn a_run_that_is_stopped_ends_at_once() {
    let file = RigFile::load("servo").unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let line = RigLine::start(&file, &Driver::InProcess).await.unwrap();
        let mut controller = Controller::connect(line).await.unwrap();
        controller.download(&[4; 400], |_, _| {}).await.unwrap();
        let ended = controller.run(400, |sample| sample.tick < 100).await.unwrap();
        assert_eq!(ended, RunEnd::Interrupted);
        // It is at rest and answers again.
        controller.check_link().await.unwrap();
    });
}

/// A count is 0.008 mm; the loops are sampled, which takes a sixth of a corner's deviation that the formulas give.
#[test]
fn two_axes_leave_their_path_as_the_formulas_say() {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    for (tau, shape, kx, of_formula) in [
        (0.001, Shape::Corner, [20, 20], 0.008 + 0.0132),
        (0.03, Shape::Corner, [20, 20], 0.008 + 0.0132),
        (0.03, Shape::Line(45.0), [20, 18], 0.008),
        (0.03, Shape::Straight, [20, 18], 0.008),
        (0.001, Shape::Circle(10.0), [20, 20], 0.008),
        (0.03, Shape::Circle(10.0), [20, 20], 0.008),
        (0.001, Shape::Circle(5.0), [20, 20], 0.008),
    ] {
        let file = RigFile::load("servo").unwrap().set(&format!("servo.plant.tau_s={tau}")).unwrap();
        let task = Task { shape, speed_mm_s: 10.0 };
        let contour = runtime.block_on(contour::drive(&file, task, kx, tau)).unwrap();
        let (found, sampled) = (contour.measured, contour.sampled);
        let [_, formula] = contour.predicted.unwrap();
        assert!((found - sampled).abs() < 0.008, "{shape:?}, tau {tau}: {found}, sampled {sampled}");
        assert!((found - formula).abs() < of_formula, "{shape:?}, tau {tau}: {found}, formula {formula}");
        if shape == Shape::Corner && tau == 0.03 {
            // Past the corner by 0.0567 mm, says the formula for KV 20.
            let past = contour.driven.iter().map(|place| place.0 - 10.0).fold(0.0, f64::max);
            assert!((past - 0.0567).abs() < of_formula, "{past}");
        }
    }
    // From point to point the path is 4.5 mm off the line, which contour control keeps to within some hundredths.
    let file = RigFile::load("servo").unwrap();
    let task = Task { shape: Shape::Points, speed_mm_s: 10.0 };
    let contour = runtime.block_on(contour::drive(&file, task, [20, 18], 0.03)).unwrap();
    assert!((4.2..4.5).contains(&contour.measured), "{}", contour.measured);
}
