//! `torno identify` and `torno tune`: what a motor is, from its own encoder or a file, and a controller for it.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::common::{folder, json, output};
use serde_json::Value;

const LATHE: &str = include_str!("../harness/builtin/lathe.toml");

fn text(arguments: &[&str]) -> String {
    let output = output(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// What is wrong with the command, which must be wrong.
fn complaint(arguments: &[&str]) -> String {
    let output = output(arguments);
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {error}");
    assert!(output.stdout.is_empty());
    error
}

/// A lathe with other settings of one board.
fn rig(folder: &Path, kind: &str, settings: &str) -> String {
    let path = folder.join("rig.toml");
    let kind = format!("kind = \"{kind}\"");
    assert!(LATHE.contains(&kind));
    fs::write(&path, LATHE.replace(&kind, &format!("{kind}\n[board.settings]\n{settings}"))).unwrap();
    path.to_str().unwrap().to_owned()
}

fn near(value: &Value, expected: f64, percent: f64) {
    let found = value.as_f64().unwrap();
    assert!((found / expected - 1.0).abs() <= percent / 100.0, "{found}, expected {expected} within {percent} %");
}

/// The 95 % intervals of gain and time constant hold what is true.
fn holds(row: &Value, gain: f64, tau: f64) {
    for (name, truth) in [("gain_interval", gain), ("tau_s_interval", tau)] {
        let [low, high] = [0, 1].map(|end| row[name][end].as_f64().unwrap());
        assert!(low < truth && truth < high, "{name}: {low} to {high}, true {truth}");
    }
}

/// What a method made of the run that begins with `input`.
fn row<'a>(found: &'a Value, input: &str, method: &str) -> &'a Value {
    let runs = found["runs"].as_array().unwrap();
    let run = runs.iter().find(|run| run["input"].as_str().unwrap().starts_with(input)).unwrap();
    run["methods"].as_array().unwrap().iter().find(|row| row["method"] == method).unwrap()
}

/// §4, Eq. 5 and 6: 6.7857/(s + 0.3571); in z for the 30 ms of the text.
#[test]
fn the_main_motor_is_what_the_paper_says() {
    let found = json(&output(&["identify", "lathe", "spindle", "--json"]));
    let result = &found["result"];
    near(&result["gain"], 19.0, 0.02);
    near(&result["tau_s"], 2.8, 0.05);
    near(&result["s"][0][0], 6.785_714, 0.05);
    near(&result["s"][1][1], 0.357_143, 0.05);
    near(&result["z"][0][0], 0.202_485, 0.05);
    near(&result["z"][1][1], -0.989_343, 0.001);
    assert_eq!((result["method"].as_str(), found["units"]["speed"].as_str()), (Some("nls"), Some("rad/s")));
    // The paper's own method is near, plain ARX is not.
    near(&row(&found, "step", "eq4")["tau_s"], 2.8, 3.0);
    assert!(row(&found, "step", "arx-ls")["tau_s"].as_f64().unwrap() < 0.96 * 2.8);
    near(&row(&found, "PRBS", "arx-iv")["tau_s"], 2.8, 1.5);
    for (input, method) in [("step", "nls"), ("PRBS", "nls"), ("PRBS", "arx-iv")] {
        holds(row(&found, input, method), 19.0, 2.8);
    }
}

/// Fig. 8 as the paper's oscilloscope showed it: what comes back from the voltages is the same motor.
#[test]
fn the_papers_converter_shows_fig_8_in_volts() {
    let folder = folder();
    let picture = folder.path().join("fig-8.svg");
    let arguments = ["identify", "spindle", "--instrument", "dac", "--input", "step", "--json", "-o"];
    let found = json(&output(&[&arguments[..], &[picture.to_str().unwrap()]].concat()));
    near(&found["converter"]["volts_at_5500_rpm"], 4.980_469, 0.001);
    near(&found["converter"]["steps_per_count"], 1.854_545, 0.001);
    holds(row(&found, "step", "nls"), 19.0, 2.8);
    // It rounds once more than the counter.
    let width = |row: &Value| row["gain_interval"][1].as_f64().unwrap() - row["gain_interval"][0].as_f64().unwrap();
    assert!(width(row(&found, "step", "nls")) > 0.05, "{found}");
    let shown = format!("{}/../docs/fig-8.svg", env!("CARGO_MANIFEST_DIR"));
    assert!(
        fs::read(&picture).unwrap() == fs::read(shown).unwrap(),
        "repeat: torno {} docs/fig-8.svg",
        arguments.join(" ")
    );
    // One step a pulse, and nothing is lost; 20 V are 1.77 V.
    let plain = text(&["identify", "spindle", "--instrument", "dac-unscaled", "--input", "step"]);
    assert!(plain.contains("gain     19.000 rad/s") && plain.contains("ends at 1.77 V"), "{plain}");
    // At 30 V and 25 rad/s per V the ladder is at its end, which is no motor's.
    let most =
        complaint(&[&arguments[..6], &["--level", "30", "--set", "spindle.plant.km_rad_per_s_volt=25"]].concat());
    assert!(most.contains("saturates"), "{most}");
    let none = complaint(&["identify", "transverse", "--instrument", "dac"]);
    assert!(none.contains("board 'transverse' has no converter of frequency to voltage"), "{none}");
}

/// §4, Eq. 8 to 11: tp and ts give 1.925 rad/s and 0.361, and the motor behind it is 2.664/(s(0.71875 s + 1)).
#[test]
fn the_feed_motor_is_what_the_paper_says() {
    let found = json(&output(&["identify", "lathe", "transverse", "--json"]));
    near(&found["result"]["gain"], 7_500.0 / 255.0, 0.02);
    near(&found["result"]["tau_s"], 0.718_75, 0.05);
    assert_eq!(found["result"]["s"][1].as_array().unwrap().len(), 3, "there is an integrator");
    let paper = row(&found, "step", "peak-settling");
    near(&paper["omega_rad_per_s"], 1.925_269, 1.0);
    near(&paper["xi"], 0.361_327, 2.0);
    near(&row(&found, "step", "closed-nls")["xi"], 0.361_327, 0.2);
    near(&row(&found, "PRBS", "arx-iv")["gain"], 7_500.0 / 255.0, 0.2);
    // Rounding is the only noise here, and not random: an axis that has come to rest counts the same for ever.
    for (input, method) in [("step", "nls"), ("PRBS", "nls"), ("PRBS", "arx-iv")] {
        holds(row(&found, input, method), 7_500.0 / 255.0, 0.718_75);
    }
}

#[test]
fn another_motor_is_found_without_being_told() {
    let folder = folder();
    let path =
        rig(folder.path(), "spindle", "plant.km_rad_per_s_volt = 11.5\nplant.tau_s = 0.9\ncontroller.window_ms = 20");
    let found = json(&output(&["identify", &path, "spindle", "--input", "step", "--for", "5", "--json"]));
    near(&found["result"]["gain"], 11.5, 0.1);
    near(&found["result"]["tau_s"], 0.9, 0.2);
    near(&found["period_s"], 0.020, 1e-6);
    // A clock that is off makes longer windows; the firmware does not know, who listens from outside does.
    let path = folder.path().join("slow.toml");
    fs::write(&path, LATHE.replace("kind = \"spindle\"", "kind = \"spindle\"\nclock_ppm = -20000")).unwrap();
    let found = json(&output(&["identify", path.to_str().unwrap(), "spindle", "--input", "step", "--json"]));
    near(&found["period_s"], 0.030 / 0.98, 0.01);
    near(&found["result"]["tau_s"], 2.8, 0.05);
}

#[test]
fn the_same_seed_gives_the_same_and_another_another() {
    let run = |seed: &str| text(&["identify", "transverse", "--input", "prbs", "--seed", seed, "--json"]);
    assert_eq!(run("3"), run("3"));
    assert_ne!(run("3"), run("4"));
}

#[test]
fn a_person_gets_a_table_and_a_picture() {
    let folder = folder();
    let path = folder.path().join("spindle.svg");
    let table = text(&["identify", "spindle", "--plot", path.to_str().unwrap()]);
    for words in ["6.7858/(s + 0.35715)", "0.20249/(z - 0.98934)", "held and sampled every 30 ms", "Eq 4", "biased"] {
        assert!(table.contains(words), "{table}\nlacks {words}");
    }
    let svg = fs::read_to_string(&path).unwrap();
    for words in ["<svg", "speed, rad/s", "time, s", "input, V", "counted", "non-linear least squares"] {
        assert!(svg.contains(words), "{words}");
    }
    let only = text(&["identify", "spindle", "--input", "step", "--method", "eq4"]);
    assert!(only.contains("Eq 4 at 63 %") && !only.contains("biased"), "{only}");
}

/// Counts of a motor of 12 rad/s per V and 0.4 s behind 200 slots, every 20 ms.
fn measured(output: impl Fn(f64, f64) -> f64, column: &str) -> String {
    let angle = |t: f64| 60.0 * (t - 0.4 * (1.0 - libm::exp(-t / 0.4)));
    let count = |t: f64| (angle(t) * 200.0 / core::f64::consts::TAU).floor();
    let row = |n: u32| {
        let t = 0.02 * f64::from(n);
        format!("{t:.3},5,{}\n", output(count(t), count((t - 0.02).max(0.0))))
    };
    format!("# a real motor\ntime_s,input_v,{column}\n") + &(0..150).map(row).collect::<String>()
}

#[test]
fn a_real_motor_is_identified_from_a_file() {
    let folder = folder();
    let path = folder.path().join("data.csv");
    let path = path.to_str().unwrap();
    for (column, text) in
        [("counts", measured(|now, before| now - before, "counts")), ("position", measured(|now, _| now, "position"))]
    {
        fs::write(path, text).unwrap();
        let found = json(&output(&["identify", "--from", path, "--counts-per-rev", "200", "--json"]));
        near(&found["result"]["gain"], 12.0, 0.2);
        near(&found["result"]["tau_s"], 0.4, 1.0);
        assert_eq!(found["axis"], column == "position");
        assert_eq!(found["units"]["input"], "V");
    }
    let tuned = json(&output(&["tune", "--from", path, "--counts-per-rev", "200", "--json"]));
    assert_eq!(tuned["law"], "pid");
    near(&tuned["forecast"]["phase_margin_deg"], 60.0, 1.0);
}

#[test]
fn data_that_are_no_good_are_said_to_be_so() {
    let folder = folder();
    let path = folder.path().join("data.csv");
    let path = path.to_str().unwrap();
    let good = measured(|now, before| now - before, "counts");
    let after_ten = |text: &str, what: &str| {
        let mut lines: Vec<&str> = text.lines().collect();
        lines[12] = what;
        lines.join("\n")
    };
    for (text, expected) in [
        (good.replace("counts", "count"), "data.csv:2:16: unknown column 'count': did you mean 'counts'?"),
        (after_ten(&good, "0.2,5,x"), "data.csv:13:7: expected a number, found 'x'"),
        (after_ten(&good, "0.1,5,3"), "data.csv:13:1: expected a time above 0.18 s, found 0.1 s"),
        (good.lines().take(12).collect::<Vec<_>>().join("\n"), "the data are too short: expected at least 20 samples"),
        (measured(|_, _| 0.0, "counts"), "no response at all"),
        (good.replace(",5,", ",0,"), "the input is 0 from beginning to end"),
        (measured(|now, before| (now - before).min(25.0), "counts"), "the response saturates"),
        (measured(|now, before| if now > 1_500.0 { 0.0 } else { now - before }, "counts"), "stops dead"),
    ] {
        fs::write(path, text).unwrap();
        let found = complaint(&["identify", "--from", path]);
        assert!(found.contains(expected), "{found}\nlacks {expected}");
    }
}

#[test]
fn a_rig_that_cannot_be_identified_says_why() {
    let folder = folder();
    for (arguments, expected) in [
        (vec!["spindel"], "there is no board 'spindel' in the rig 'lathe': did you mean 'spindle'?"),
        (vec!["master"], "board 'master' has no motor: expected one of spindle, transverse, depth"),
        (vec!["spindle", "--level", "40"], "level 40: expected above 0 and up to 30 V"),
        (vec!["spindle", "--for", "0"], "0 s is no such time: expected 1 s to 3600 s"),
        (vec!["spindle", "--for", "2"], "the data are too short: they end after"),
        (vec!["servo", "servo"], "there is no room to drive it freely"),
        (vec!["lathe-dspic", "dspic"], "expected one of dspic.spindle, dspic.transverse, dspic.depth"),
        (vec!["lathe-dspic", "dspic.spindel"], "on board 'dspic': did you mean 'spindle'?"),
        (vec!["spindle.spindle"], "there is no motor 'spindle' on board 'spindle'"),
        (vec!["depth"], "the encoder is too coarse to see the lag"),
        (vec!["spindle", "--input", "step", "--method", "arx-iv"], "cannot be used on such data"),
        (vec![], "required"),
    ] {
        let found = complaint(&[&["identify"][..], &arguments].concat());
        assert!(found.contains(expected), "{found}\nlacks {expected}");
    }
    let path = rig(folder.path(), "transverse", "plant.travel_mm = 8.9");
    let found = complaint(&["identify", &path, "transverse", "--input", "step"]);
    assert!(found.contains("stops dead"), "{found}");
    assert!(complaint(&["tune", "depth"]).contains("too coarse"));
}

/// §4: the paper leaves α, β and K open.
#[test]
fn the_lead_compensator_does_on_the_rig_what_was_foretold() {
    let folder = folder();
    let path = folder.path().join("tune.svg");
    let found = json(&output(&["tune", "spindle", "--json", "--plot", path.to_str().unwrap()]));
    near(&found["forecast"]["phase_margin_deg"], 60.0, 0.5);
    let (shown, foretold) = (&found["shown"]["step"], &found["foretold"]);
    near(&shown["rise_s"], foretold["rise_s"].as_f64().unwrap(), 2.0);
    near(&shown["settling_s"], foretold["settling_s"].as_f64().unwrap(), 3.0);
    assert!(shown["overshoot_percent"].as_f64().unwrap() < 1.0);
    // The board's default: 61.9°, 22.1 dB.
    near(&found["present"]["phase_margin_deg"], 61.9, 0.3);
    near(&found["present"]["gain_margin_db"], 22.1, 0.3);
    let svg = fs::read_to_string(&path).unwrap();
    assert!(["speed, rpm", "foretold", "set point", "drive, LSB"].iter().all(|words| svg.contains(words)));
}

#[test]
fn the_pid_takes_the_carriage_there_and_holds_it() {
    let found = json(&output(&["tune", "transverse", "--json"]));
    near(&found["forecast"]["phase_margin_deg"], 60.0, 0.5);
    let shown = &found["shown"];
    assert!(shown["following_error_counts"].as_f64().unwrap() <= 20.0, "{shown}");
    assert!(shown["overshoot_counts"].as_f64().unwrap() <= 3.0 && shown["in_position_s"].as_f64().unwrap() < 1.0);
}

#[test]
fn gains_that_make_the_loop_unstable_are_found_to_do_so() {
    let folder = folder();
    let path = rig(folder.path(), "transverse", "controller.k1 = 40.0");
    let found = text(&["tune", &path, "transverse"]);
    let expected = "as it is: the loop is unstable: largest pole 1.";
    assert!(found.contains(expected), "{found}");
    // The paper's own loop is proportional; an integral that does nothing makes it no worse.
    let found = text(&["tune", "transverse", "--set", "transverse.controller.k2=0"]);
    assert!(!found.contains("unstable"), "{found}");
    assert!(complaint(&["tune", "spindle", "--phase-margin", "5"]).contains("expected 10 to 90"));
}

/// P, PI, PD and PID: stable or not as the board itself shows, and with the step that it shows.
#[test]
fn a_forecast_with_any_part_missing_is_what_the_board_does() {
    for (k2, k3, stable, wild) in
        [(0.0, 0.0, 0.5, 30.0), (0.02, 0.0, 0.3, 30.0), (0.0, 0.27, 1.5, 30.0), (0.5, 0.27, 1.5, 30.0)]
    {
        for k1 in [stable, wild] {
            let gains = [("k1", k1), ("k2", k2), ("k3", k3), ("k2_standing", k2), ("breakaway", 0.0)];
            let set = gains.map(|(name, value)| format!("transverse.controller.{name}={value}"));
            let set =
                set.iter().flat_map(|set| ["--set", set]).chain(["--set", "transverse.controller.dead_band_counts=0"]);
            let found = json(&output(&["tune", "transverse", "--json"].into_iter().chain(set).collect::<Vec<_>>()));
            let seen = &found["shown_present"];
            if k1 == wild {
                assert!(found["present_finding"].as_str().unwrap().contains("the loop is unstable"), "{found}");
                assert!(seen["in_position_s"].is_null() && seen["verdict"] == "busy", "{seen}");
                continue;
            }
            let (foretold, step) = (&found["present"]["small_step"], &seen["small_step"]["response"]);
            near(&step["rise_s"], foretold["rise_s"].as_f64().unwrap(), 6.0);
            // A count is a few per cent of the step.
            let [over, expected] = [step, foretold].map(|of| of["overshoot_percent"].as_f64().unwrap());
            assert!((over - expected).abs() < 6.0, "{k1} {k2} {k3}: {over}, foretold {expected}");
        }
    }
}

#[test]
fn the_structures_of_a_controller_are_compared() {
    let folder = folder();
    let path = folder.path().join("compared.svg");
    let found =
        json(&output(&["tune", "transverse", "--compare", "p,PI,pd,pid", "--json", "-o", path.to_str().unwrap()]));
    let all = found["controllers"].as_array().unwrap();
    let names: Vec<&str> = all.iter().map(|one| one["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["P", "PI", "PD", "PID", "as it is"]);
    for one in &all[..4] {
        near(&one["forecast"]["phase_margin_deg"], 60.0, 0.5);
    }
    let after = |one: &Value, of: &str| (one[of]["steady_error_counts"].as_f64().unwrap(), one[of]["verdict"].clone());
    // Friction stops what does not integrate; the PID of Eq 14 needs longer than the board's rules.
    assert!(after(&all[0], "with_friction").0 > 100.0 && after(&all[2], "with_friction").0 > 5.0);
    assert_eq!(after(&all[2], "with_friction").1["failed"], "CAN t s");
    for one in &all[3..] {
        let (error, verdict) = after(one, "with_friction");
        assert!(error.abs() <= 1.0 && verdict == "done", "{one}");
    }
    let needs = |one: &Value| one["with_friction"]["in_position_s"].as_f64().unwrap();
    assert!(needs(&all[4]) < 0.5 * needs(&all[3]));
    let svg = fs::read_to_string(&path).unwrap();
    assert!(["small step, foretold", "5 % friction", "as it is"].iter().all(|words| svg.contains(words)));
    assert!(complaint(&["tune", "spindle", "--compare", "p,pid"]).contains("--compare is for an axis"));
    assert!(complaint(&["tune", "transverse", "--compare", "p,q"]).contains("expected p, pi, pd or pid"));
}

/// The paper's reason for the compensator: the motor alone rises in 2.2·τ.
#[test]
fn the_open_loop_stands_beside_the_closed_one() {
    let found = json(&output(&["tune", "spindle", "--json"]));
    near(&found["open_loop"]["rise_s"], 6.152, 0.5);
    near(&found["open_loop"]["settling_s"], 10.95, 0.5);
    near(&found["shown_open"]["step"]["rise_s"], 6.15, 2.0);
    let damping = found["forecast"]["damping"].as_f64().unwrap();
    assert!((0.7..0.9).contains(&damping), "{damping}");
}

#[test]
fn a_dead_time_is_found() {
    for (board, gain, tau) in [("transverse", 7_500.0 / 255.0, 0.718_75), ("spindle", 19.0, 2.8)] {
        for dead_ms in [10.0, 50.0] {
            let set = format!("{board}.plant.dead_ms={dead_ms}");
            let found = json(&output(&["identify", board, "--set", &set, "--json"]));
            let result = &found["result"];
            assert_eq!(result["method"], "nls-dead", "{found}");
            near(&result["dead_s"], 1e-3 * dead_ms, 5.0);
            near(&result["gain"], gain, 0.1);
            near(&result["tau_s"], tau, 0.1);
            assert!(result["warnings"].as_array().unwrap().is_empty(), "{result}");
        }
        // A motor without dead time is what it was.
        let found = json(&output(&["identify", board, "--json"]));
        assert!(found["result"]["method"] != "nls-dead" && found["result"]["dead_s"].is_null(), "{found}");
        assert!(found["result"]["dead_s_interval"].is_null());
    }
    assert!(text(&["identify", "transverse"]).contains("\ndead     no dead time distinguishable from 0: at most 0.00"));
    let none = complaint(&["identify", "transverse", "--method", "nls-dead"]);
    assert!(none.contains("no dead time distinguishable from 0: at most "), "{none}");
    let found = text(&["identify", "transverse", "--set", "transverse.plant.dead_ms=50"]);
    assert!(found.contains("\ndead     0.0") && found.contains(" e^(-0.0"), "{found}");
}

/// The board itself says whether the delay margin holds.
#[test]
fn a_dead_time_is_held_against_the_delay_margin() {
    let tune = |dead_ms: u32, more: &[&str]| {
        let set = format!("transverse.plant.dead_ms={dead_ms}");
        text(&[&["tune", "transverse", "--set", &set][..], more].concat())
    };
    // The loop that is there has 73 ms.
    let found: Value = serde_json::from_str(&tune(50, &["--json"])).unwrap();
    assert_eq!(found["shown_present"]["verdict"], "done");
    let found: Value = serde_json::from_str(&tune(90, &["--json"])).unwrap();
    assert_eq!((&found["shown_present"]["verdict"], found["dead_s"].as_f64()), (&Value::from("busy"), Some(0.09)));
    assert!(tune(50, &[]).contains("the plant has 50 ms of dead time; proposed: "));
    assert!(tune(110, &[]).contains("ms beyond its delay margin: unstable"));
    let refused = complaint(&["tune", "transverse", "--set", "transverse.plant.dead_ms=-1"]);
    assert!(refused.contains("plant.dead_ms: expected 0 to 1000, found -1"), "{refused}");
    let refused = complaint(&["tune", "spindle", "--set", "spindle.controller.jitter_us=30001"]);
    assert!(refused.contains("controller.jitter_us: expected 0 to 30000"), "{refused}");
}

/// The C that is written does on its own vectors what the board did: it is compiled and run.
#[test]
fn a_controller_as_c_does_what_the_board_does() {
    let folder = folder();
    let (source, program) = (folder.path().join("law.c"), folder.path().join("law"));
    for arguments in [
        &["transverse"][..],
        &["spindle"],
        &["lathe-dspic", "dspic.transverse"],
        &["spindle", "--set", "spindle.controller.window_ms=32"],
        &["transverse", "--set", "transverse.controller.sample_ms=17"],
    ] {
        let tune = [&["tune"], arguments, &["--code", "c", "-o", source.to_str().unwrap()]].concat();
        text(&tune);
        let cc = Command::new("cc")
            .args(["-std=c99", "-Wall", "-Wextra", "-Werror", "-DTORNO_TEST", "-o"])
            .args([&program, &source])
            .output()
            .unwrap();
        assert!(cc.status.success(), "{}", String::from_utf8_lossy(&cc.stderr));
        let run = Command::new(&program).output().unwrap();
        let told = String::from_utf8_lossy(&run.stdout).into_owned();
        assert!(run.status.success() && told.contains(" vectors, "), "{arguments:?}: {told}");
    }
    // A coefficient that is wrong shows.
    let wrong = fs::read_to_string(&source).unwrap().replacen("#define K1 ", "#define K1 2 * ", 1);
    fs::write(&source, wrong).unwrap();
    let cc = Command::new("cc").args(["-DTORNO_TEST", "-o"]).args([&program, &source]).status().unwrap();
    assert!(cc.success() && !Command::new(&program).output().unwrap().status.success());
    assert!(complaint(&["tune", "spindle", "--code", "c", "-o", "x.svg"]).contains("a name that ends in .c"));
    assert!(complaint(&["tune", "spindle", "-o", "x.c"]).contains(".c is for --code"));
}

#[test]
fn friction_is_found_and_what_lacks_it_is_doubted() {
    let set = |place: &str, board: &str| json(&output(&["identify", board, "--set", place, "--json"]));
    let found = set("spindle.plant.friction=0.2", "spindle");
    near(&found["result"]["gain"], 19.0, 0.02);
    near(&found["result"]["tau_s"], 2.8, 0.05);
    // A fifth of 30 V.
    near(&found["result"]["friction"], 6.0, 0.02);
    assert_eq!(found["result"]["method"], "nls-friction");
    // At one level it cannot be told from a smaller gain; that it shows in another is said.
    let step = row(&found, "step", "nls");
    near(&step["gain"], 13.3, 0.1);
    assert!(
        step["gain_interval"].is_null() && step["doubts"][0].as_str().unwrap().starts_with("friction of 6.0000 shows")
    );
    // The carriage stands still in its loop before it is there, and that is no end of travel.
    let found = set("transverse.plant.friction=0.1", "transverse");
    near(&found["result"]["gain"], 7_500.0 / 255.0, 0.02);
    near(&found["result"]["friction"], 25.5, 0.02);
    near(&row(&found, "step", "nls-friction")["friction"], 25.5, 0.2);
    // Without friction there is nothing to be told of it.
    let good = text(&["identify", "spindle"]);
    assert!(!good.contains("friction") && !good.contains("warning"), "{good}");
}

#[test]
fn data_that_end_too_soon_are_no_ground_for_the_papers_method() {
    let found = complaint(&["identify", "transverse", "--input", "step", "--for", "1", "--method", "peak-settling"]);
    assert!(found.contains("the data end too soon for this method"), "{found}");
    let slow = json(&output(&["identify", "spindle", "--set", "spindle.plant.tau_s=30", "--json"]));
    for method in ["eq4", "eq4-mean", "log-linear"] {
        assert!(row(&slow, "step", method)["finding"].as_str().unwrap().contains("not settled"));
    }
    assert!(row(&slow, "step", "nls")["finding"].as_str().unwrap().contains("they end after 0.66 time constants"));
    near(&slow["result"]["tau_s"], 30.0, 0.1);
    // A fast one is at rest at the start, although its first window is full of counts.
    let fast = json(&output(&["identify", "spindle", "--input", "step", "--set", "spindle.plant.tau_s=0.1", "--json"]));
    near(&row(&fast, "step", "eq4")["tau_s"], 0.1, 1.0);
    near(&fast["result"]["tau_s"], 0.1, 0.2);
}

#[test]
fn an_experiment_that_fails_leaves_the_others() {
    let poor = ["identify", "transverse", "--method", "peak-settling", "--set", "transverse.plant.friction=0.1"];
    assert!(text(&poor).contains("the model explains 49 % of the response only"));
    // Room for the step, and too little for the sequence.
    let set = ["--set", "transverse.plant.travel_mm=24"];
    let found = json(&output(&[&["identify", "transverse", "--json"][..], &set].concat()));
    let runs = found["runs"].as_array().unwrap();
    assert!(runs[1]["finding"].as_str().unwrap().contains("stops dead"), "{runs:?}");
    near(&found["result"]["gain"], 7_500.0 / 255.0, 0.02);
    // The level of a loop's step is the drive that it begins with.
    let found = json(&output(&["identify", "transverse", "--input", "step", "--level", "100", "--json"]));
    assert!(found["runs"][0]["input"].as_str().unwrap().starts_with("step of 1104 counts"));
    let unknown = complaint(&["identify", "spindle", "--set", "spindle.plant.tau=3"]);
    assert!(unknown.contains("did you mean 'tau_s'?"), "{unknown}");
}

#[test]
fn what_contradicts_itself_is_said_to() {
    let folder = folder();
    let path = folder.path().join("data.csv");
    let path = path.to_str().unwrap();
    // Late by 40 ms.
    let row = |n: u32| {
        let t = 0.02 * f64::from(n);
        format!("{t:.2},5,{:.6}\n", 60.0 * -libm::expm1(-(t - 0.04).max(0.0) / 0.5))
    };
    let late: String = (0..200).map(row).collect();
    fs::write(path, format!("time_s,input_v,speed\n{late}")).unwrap();
    let found = json(&output(&["identify", "--from", path, "--json"]));
    let result = &found["result"];
    near(&result["dead_s"], 0.04, 0.1);
    near(&result["tau_s"], 0.5, 0.1);
    assert!(result["dead_s_interval"].is_array() && result["warnings"].as_array().unwrap().is_empty(), "{found}");
    assert!(text(&["tune", "--from", path]).contains("the plant has 40 ms of dead time; proposed: "));
    // Without the dead time in the model.
    let found = json(&output(&["identify", "--from", path, "--method", "nls", "--json"]));
    let result = &found["result"];
    assert!(result["warnings"][0].as_str().unwrap().contains("s late"), "{found}");
    assert!(result["tau_s_interval"].is_null() && result["dead_s"].is_null());
    // Counting backwards.
    fs::write(path, format!("time_s,input_v,speed\n{}", late.replace(",5,", ",-5,"))).unwrap();
    assert!(text(&["identify", "--from", path]).contains("the encoder counts backwards"));
    let refused = complaint(&["tune", "--from", path]);
    assert!(refused.contains("the encoder counts backwards"), "{refused}");
}

#[test]
fn the_papers_printed_laws_are_described() {
    let tune = |board: &str, set: &[&str]| {
        let set: Vec<&str> = set.iter().flat_map(|set| ["--set", set]).collect();
        text(&[&["tune", board][..], &set].concat())
    };
    let literal = tune("transverse", &["transverse.controller.form=literal", "transverse.controller.k2=1"]);
    assert!(literal.contains("as it is: the loop is unstable: largest pole 1.1412"), "{literal}");
    assert!(literal.contains("transverse.controller.form=pid"), "{literal}");
    let lead = tune("spindle", &["spindle.controller.form=literal"]);
    assert!(lead.contains("as it is: 70.1 % of the set point are missing in the end"), "{lead}");
    // What takes long is watched for long.
    let slow = tune("spindle", &["spindle.plant.tau_s=30"]);
    let rise = slow.lines().find(|line| line.starts_with("rise, s")).unwrap();
    assert!(!rise.contains(" - "), "{slow}");
    let calm = text(&["tune", "transverse", "--phase-margin", "90"]);
    assert!(calm.lines().any(|line| line.starts_with("small step: rise, s") && !line.contains(" - ")), "{calm}");
}

/// The laws and the motors are the same, and so is what is found.
#[test]
fn one_board_with_three_motors_is_identified_motor_by_motor() {
    for motor in ["spindle", "transverse"] {
        let alone = json(&output(&["identify", motor, "--json"]));
        let board = format!("dspic.{motor}");
        let found = json(&output(&["identify", "lathe-dspic", &board, "--json"]));
        for number in ["gain", "tau_s"] {
            near(&found["result"][number], alone["result"][number].as_f64().unwrap(), 0.01);
        }
    }
    let found = json(&output(&["tune", "lathe-dspic", "dspic.spindle", "--json"]));
    near(&found["shown"]["step"]["rise_s"], found["foretold"]["rise_s"].as_f64().unwrap(), 2.0);
    near(&found["present"]["phase_margin_deg"], 61.9, 0.3);
    assert_eq!(found["settings"][0][0], "dspic.spindle.controller.alpha");
}
