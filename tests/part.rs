//! The part that is turned: what `torno run` tells and draws of it, and what scenarios expect of it.

use std::fs;
use std::path::Path;

use crate::common::{boring, folder, json, output};
use serde_json::Value;
use torno::rig::file::RigFile;
use torno::scenario::prose::{Prose, board, part, reply, scenario};
use torno_machines::workpiece::Part;
use torno_protocol::lathe::Program;

/// A slot of the depth axis, in mm of diameter: within one it is in position.
const SLOT: f64 = 2.0 * 160.0 / 900.0;

/// What `torno run` says of the part, with these arguments.
fn run(arguments: &[&str]) -> Value {
    let output = output(&[&["run", "--in-process", "--json"], arguments].concat());
    assert_eq!(String::from_utf8_lossy(&output.stderr), "");
    json(&output)["part"].clone()
}

fn number(value: &Value, name: &str) -> f64 {
    value[name].as_f64().unwrap_or_else(|| panic!("{name} in {value}"))
}

fn events(part: &Value) -> Vec<&str> {
    part["events"].as_array().unwrap().iter().map(|event| event["event"].as_str().unwrap()).collect()
}

/// Writes a file of the folder; its path.
fn write(folder: &Path, name: &str, text: &str) -> String {
    let path = folder.join(name);
    fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

fn lathe() -> Part {
    RigFile::load("lathe").unwrap().part.unwrap()
}

#[test]
fn a_screw_or_an_encoder_of_another_kind_turns_another_part() {
    for rig in ["lathe", "lathe-dspic"] {
        let of = |board: &str| if rig == "lathe" { board.to_owned() } else { format!("dspic.{board}") };
        let pitch = format!("{}.plant.pitch_mm=1", of("transverse"));
        let slots = format!("{}.encoder.length_mm=153", of("depth"));
        let (nominal, short, fine) = (run(&[rig]), run(&[rig, "--set", &pitch]), run(&[rig, "--set", &slots]));
        let first = |part: &Value, name: &str| number(&part["cylinders"][0], name);
        assert!((first(&short, "length_mm") - first(&nominal, "length_mm") / 2.0).abs() < 0.03, "{short}");
        let off = |part: &Value| 28.0 - first(part, "diameter_mm");
        // The tool begins as far from the bar as ever.
        let clear = 4.0 * 160.0 / 900.0;
        // How far it coasts has nothing to do with its slots.
        assert!((off(&fine) + clear - (off(&nominal) + clear) * 153.0 / 160.0).abs() < 0.01, "{fine}\n{nominal}");
    }
}

#[test]
fn the_demonstration_turns_the_shaft_that_its_comments_promise() {
    let part = run(&[]);
    assert_eq!(events(&part), [""; 0]);
    // 16, 10 and 3 slots deep, ending 12, 26 and 40 mm from the face; the rest of the bar is as it was.
    let promised = [(16.0, 0.0, 12.0), (10.0, 12.0, 26.0), (3.0, 26.0, 40.0), (0.0, 40.0, 60.0)];
    for (list, off) in [("asked", 1e-3), ("cylinders", SLOT + 1e-3)] {
        let cylinders = part[list].as_array().unwrap();
        assert_eq!(cylinders.len(), 4, "{part}");
        for (cylinder, (slots, from, to)) in cylinders.iter().zip(promised) {
            assert!((number(cylinder, "diameter_mm") - (28.0 - SLOT * slots)).abs() <= off, "{list} {cylinder}");
            assert!((number(cylinder, "from_mm") + from).abs() <= 0.02, "{list} {cylinder}");
            assert!((number(cylinder, "length_mm") - (to - from)).abs() <= 0.02, "{list} {cylinder}");
            assert_eq!(cylinder["stock"], slots == 0.0, "{list} {cylinder}");
        }
    }
    assert!(number(&part["worst"], "diameter_mm").abs() <= SLOT, "{part}");
    // The slide stops just past an edge: short of the middle of its slot by 0.41 slots, from outside as from inside.
    let off = |place: usize| {
        let [got, asked] = ["cylinders", "asked"].map(|list| number(&part[list][place], "diameter_mm"));
        (got - asked) / SLOT
    };
    for (place, sense) in [(0, 1.0), (1, -1.0), (2, -1.0)] {
        assert!((0.405..0.425).contains(&(sense * off(place))), "{part}");
    }
}

#[test]
fn processes_make_the_same_part() {
    assert_eq!(json(&output(&["run", "--json"]))["part"], run(&[]));
}

#[test]
fn what_a_program_does_wrong_is_told() {
    let folder = folder();
    let tell = |frames: &str| run(&[&write(folder.path(), "a.frames", frames)]);
    let spindle = "4B 00 00 00 00 00 00 00\n";
    let into = "4B 00 00 00 00 00 05 01\n";
    let cut = |speed: &str| format!("4B {speed} 23 28 01 00 00 00\n");
    assert_eq!(events(&tell(&[spindle, into, &cut("46")].concat())), [""; 0]);
    assert_eq!(events(&tell(&[spindle, into, &cut("E1")].concat())), ["rapid"]);
    let stopped = [spindle, into, &cut("46")].concat().replace("4B ", "00 ");
    assert_eq!(events(&tell(&stopped)), ["stopped"]);
    assert_eq!(events(&tell(&[spindle, &into.replace("05", "0A"), &cut("46")].concat())), ["deep"]);
    // 62 mm towards the chuck, clear of the bar.
    let past = tell("4B 00 00 00 00 00 00 00\n4B E1 6C FC 01 00 00 00\n");
    assert_eq!(events(&past), ["chuck"]);
    assert!((number(&past["events"][0], "worst") - 2.0).abs() < 0.05, "{past}");
    assert!((number(&past["events"][0], "z_mm") + 60.0).abs() < 0.6, "{past}");
}

#[test]
fn both_axes_at_once_make_another_part_than_a_straight_way_asks() {
    let folder = folder();
    let program = "4B 00 00 00 00 00 00 00\n4B 46 11 94 01 00 08 01\n";
    let part = run(&[&write(folder.path(), "taper.frames", program)]);
    let worst = &part["worst"];
    // The feed arrives long before the depth axis does: what was to be a taper is left on.
    assert!(number(worst, "diameter_mm") > 0.5, "{part}");
    assert!((-10.0..0.0).contains(&number(worst, "z_mm")), "{part}");
}

#[test]
fn what_is_asked_comes_of_the_frames_alone() {
    let program = Program::parse("4B 46 23 28 01 00 05 01\n4B 46 23 28 02 00 05 01").unwrap();
    let asked = lathe().asked(&program);
    // Straight in over 20 mm to three slots below the surface; the second frame is refused.
    assert_eq!(asked.diameter(-7.0), Some(28.0));
    assert!((asked.diameter(-19.6).unwrap() - (28.0 - 3.0 * SLOT)).abs() < 0.03);
    assert_eq!(asked.diameter(-20.01), Some(28.0));
}

#[test]
fn people_are_told_in_words() {
    let output = output(&["run", "--in-process"]);
    let text = String::from_utf8(output.stdout).unwrap();
    let expected =
        "part     turned 22.46 x 12.00, 24.30 x 14.00, 26.78 x 14.00 mm (diameter x length, from the face)\n";
    assert!(text.contains(expected), "{text}");
    assert!(text.contains("\n         asked  22.31 x 12.00, 24.44 x 14.00, 26.93 x 14.00 mm\n"), "{text}");
    let worst = "\n         worst  0.15 mm of diameter too thin, at z = -26.06 mm; more than 0.05 mm, but no tolerance";
    assert!(text.contains(worst), "{text}");
}

#[test]
fn a_rig_without_a_part_turns_none() {
    let folder = folder();
    let text = include_str!("../harness/builtin/lathe.toml");
    let rig = write(folder.path(), "bare.toml", text.split("# What is turned.").next().unwrap());
    let program = write(folder.path(), "a.frames", "4B 00 00 00 00 00 00 00\n");
    assert_eq!(run(&[&rig, &program]), Value::Null);
    let drawing = folder.path().join("part.svg");
    let output = output(&["run", &rig, &program, "--part", drawing.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2));
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(said, "torno: --part: the rig 'lathe' turns no part: expected a [part] in its file\n");
    assert!(!drawing.exists());
}

/// The drawing that `torno run` makes with these arguments.
fn drawing(arguments: &[&str]) -> String {
    let folder = folder();
    let path = folder.path().join("part.svg");
    let output = output(&[&["run", "--in-process", "--part", path.to_str().unwrap()], arguments].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    fs::read_to_string(path).unwrap()
}

/// The corners of the lines of a class.
fn corners(svg: &str, class: &str) -> Vec<Vec<(f64, f64)>> {
    let begin = format!("<polyline class=\"{class}\" points=\"");
    let point = |text: &str| {
        let (x, y) = text.split_once(',').unwrap();
        (x.parse().unwrap(), y.parse().unwrap())
    };
    let lines = svg.split(&begin).skip(1).map(|rest| rest.split('"').next().unwrap());
    lines.map(|line| line.split(' ').map(point).collect()).collect()
}

#[test]
fn the_drawing_is_to_scale_and_the_same_on_both_sides_of_the_axis() {
    let svg = drawing(&[]);
    for class in ["got", "asked", "stock"] {
        let [above, below] = &corners(&svg, class)[..] else { panic!("{class}") };
        let axis = above[0].1;
        assert_eq!(above.len(), below.len());
        for (a, b) in above.iter().zip(below) {
            assert!(a.0 == b.0 && (a.1 - axis + (b.1 - axis)).abs() < 0.011, "{class}: {a:?} {b:?}");
        }
    }
    // At 2:1: the face, a shoulder, the bar.
    let got = &corners(&svg, "got")[0];
    let (face, axis) = got[0];
    let end = got.last().unwrap();
    assert!((face - end.0 - 120.0).abs() < 0.02 && (axis - end.1 - 28.0).abs() < 0.02, "{end:?}");
    assert!((axis - got[1].1 - (28.0 - 16.0 * SLOT)).abs() <= SLOT + 0.02, "{:?}", got[1]);
    assert!(got.iter().any(|(x, _)| (face - x - 24.0).abs() < 0.05), "{got:?}");
    for text in ["shaft.frames", "lathe", "2:1", "Ø22.46 (22.31)", "26.00 (26.00)", "-0.15 mm of diameter"] {
        assert!(svg.contains(text), "{text}");
    }
}

#[test]
fn a_profile_is_written_beside_the_one_that_was_asked_for() {
    let folder = folder();
    let path = folder.path().join("profile.csv");
    let read = |arguments: &[&str]| {
        let told = output(&[&["run", "--in-process", "--profile", path.to_str().unwrap()], arguments].concat());
        assert!(told.status.success(), "{}", String::from_utf8_lossy(&told.stderr));
        fs::read_to_string(&path).unwrap()
    };
    let text = read(&[]);
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!((lines.len(), lines[0], lines[1]), (6_002, "z_mm,radius_mm,radius_asked_mm", "0.00,11.2289,11.1556"));
    assert_eq!((lines[2_001], lines[6_001]), ("-20.00,12.1476,12.2222", "-60.00,14.0000,14.0000"));
    // A bar with a bore, turned on either side.
    let frames = write(folder.path(), "in.frames", "4B 00 00 00 00 00 05 00\n4B 46 23 28 01 00 00 00\n");
    let boring = boring(folder.path());
    let text = read(&[&boring, &frames]);
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[0], "z_mm,radius_mm,radius_asked_mm,bore_radius_mm,bore_radius_asked_mm");
    assert_eq!(lines[501].split(',').collect::<Vec<_>>()[..3], ["-5.00", "14.0000", "14.0000"]);
    assert!(lines[501].ends_with(",5.5333") && lines[2_501] == "-25.00,14.0000,14.0000,5.0000,5.0000", "{text}");
    let tube = fs::read_to_string(&boring).unwrap().replace(", cuts = \"inside\"", "").replace("= -0.355", "= 0.355");
    let text = read(&[&write(folder.path(), "tube.toml", &tube)]);
    assert_eq!(text.lines().nth(1).unwrap(), "0.00,11.2289,11.1556,5.0000,5.0000");
    // On standard output it stands alone.
    let told = output(&["run", "--in-process", "--profile", "-"]);
    assert!(String::from_utf8(told.stdout).unwrap().ends_with("\n-60.00,14.0000,14.0000\n"));
    assert!(String::from_utf8(told.stderr).unwrap().contains("\npart     turned 22.46 x 12.00"));
}

#[test]
fn names_with_marks_in_them_do_not_break_the_drawing() {
    let folder = folder();
    let program = write(folder.path(), "a<b&\"c\".frames", "4B 00 00 00 00 00 00 00\n");
    let svg = drawing(&[&program]);
    assert!(svg.contains("a&lt;b&amp;&quot;c&quot;.frames</title>"), "{}", &svg[..300]);
}

/// The picture in the documentation is the one that the command beside it draws.
#[test]
fn the_documentation_shows_the_demonstration_as_it_is() {
    let shown = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/part.svg")).unwrap();
    assert!(shown == drawing(&[]), "repeat: torno run --part docs/part.svg");
}

// --- what is required -----------------------------------------------------------------------------------------------

/// Six slots too deep: the depth axis has invented as many counts.
const SLIP: &str = "[[fault]]\nboard = \"depth\"\nkind = \"counts\"\nvalue = 6\nat = \"1 s\"\n";

#[test]
fn a_tolerance_is_a_verdict_in_text_json_report_and_exit_status() {
    let folder = folder();
    let slip = write(folder.path(), "slip.toml", SLIP);
    let page = write(folder.path(), "page.html", "");
    let run = |more: &[&str]| {
        let run = ["run", "--in-process", "--faults", &slip, "--report", &page];
        let told = output(&[&run[..], more].concat());
        let html = fs::read_to_string(&page).unwrap();
        (told.status.code(), String::from_utf8(told.stdout).unwrap(), html)
    };
    let thin = "worst  2.28 mm of diameter too thin, at z = -26.06 mm; ";
    let (code, text, html) = run(&[]);
    assert_eq!(code, Some(0), "nothing was required");
    assert!(text.contains(&format!("{thin}more than 0.05 mm, but no tolerance was required\n")), "{text}");
    assert!(text.ends_with("outcome  completed\n"), "{text}");
    let bad = "<dt>worst deviation</dt><dd class=\"bad\">-2.28 mm</dd>";
    assert!(html.contains(bad) && html.contains("but no tolerance was required"), "{html}");

    let (code, text, html) = run(&["--tolerance", "0.05"]);
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains(&format!("{thin}NOT within the tolerance of 0.05 mm\n")), "{text}");
    assert!(text.ends_with("outcome  completed, but the part is not within its tolerance\n"), "{text}");
    let problem = "<li>the part is NOT within the tolerance of 0.05 mm: 2.28 mm of diameter too thin";
    assert!(html.contains(bad) && html.contains(problem), "{html}");
    assert!(html.contains("<td id=\"figure-tolerance\">NOT within the tolerance of 0.05 mm</td>"), "{html}");

    let (code, text, html) = run(&["--tolerance", "3 mm"]);
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains(&format!("{thin}within the tolerance of 3 mm\n")), "{text}");
    assert!(html.contains(&bad.replace("bad", "good")), "{html}");

    for (tolerance, code, met) in [("50 um", 1, false), ("2.284", 0, true), ("2.283", 1, false)] {
        let told = output(&["run", "--in-process", "--json", "--faults", &slip, "--tolerance", tolerance]);
        assert_eq!(told.status.code(), Some(code), "{tolerance}");
        let part = &json(&told)["part"];
        assert_eq!(part["required"]["met"], met, "{part}");
    }
    let healthy = |more: &[&str]| json(&output(&[&["run", "--in-process", "--json"], more].concat()))["part"].clone();
    assert_eq!(healthy(&["--tolerance", "0.151"])["required"]["met"], true);
    assert_eq!(healthy(&["--tolerance", "0.15"])["required"]["met"], false);
    assert!(healthy(&[]).get("required").is_none());
}

#[test]
fn a_tolerance_is_a_length_of_a_part() {
    for (arguments, expected) in [
        (&["--tolerance", "5 s"][..], "expected mm, from 0 to 1000, such as 0.05 or '50 um'"),
        (&["--tolerance=-1"], "expected mm, from 0 to 1000"),
        (&["--tolerance", "nan"], "expected mm, from 0 to 1000"),
    ] {
        let told = output(&[&["run"], arguments].concat());
        let error = String::from_utf8(told.stderr).unwrap();
        assert_eq!(told.status.code(), Some(2), "{error}");
        assert!(error.contains(expected), "{error}");
    }
    let folder = folder();
    let bare = write(
        folder.path(),
        "bare.toml",
        include_str!("../harness/builtin/lathe.toml").split("# What is turned.").next().unwrap(),
    );
    let told = output(&["run", &bare, "--tolerance", "1"]);
    assert!(String::from_utf8(told.stderr).unwrap().contains("--tolerance: the rig 'lathe' turns no part"));
}

#[test]
fn a_step_checks_the_part_against_what_the_frames_ask_for() {
    let within = |mm: &str| part("as asked").with("within", mm);
    // On the way, and at its end.
    let turned = turns().check(within("0.15 mm")).send("4B 46 23 28 00 00 00 00").wait(reply("XON"));
    turned.clone().check(within("0.15 mm")).must_pass();
    assert_eq!(failures(&turns().check(within("0.14 mm"))).len(), 1);
    let slip = || board("depth").breaks("counts").with("value", 6).with("at", "100 ms");
    let off = turns().fault(slip()).check(within("0.05 mm"));
    let told = failures(&off);
    assert_eq!(told.len(), 1, "{told:?}");
    assert_eq!(told[0].0, "the part as asked within 0.05 mm");
    assert!(told[0].1.starts_with("1.98 mm of diameter too thin, at z = -"), "{told:?}");
    turns().fault(slip()).check(within("1.985 mm")).must_pass();
    // The same measure as of one diameter: six slots more than 26.933 mm.
    turns().fault(slip()).diameter("-10 mm", "26.933 mm", "1.985 mm").must_pass();
    assert_eq!(failures(&turns().fault(slip()).diameter("-10 mm", "26.933 mm", "1.975 mm")).len(), 1);

    let complaint = |scenario: Prose| scenario.scenario().unwrap_err().to_string();
    for (check, expected) in [
        (part("as asked"), "part: expected how near it must be, such as within = \"0.05 mm\""),
        (part("rapid").with("within", "1 mm"), "'rapid': expected \"as asked\", the whole part, here"),
        (within("1 s"), "'1 s': expected a length"),
        (within("29 mm"), "'29 mm': expected 0 mm to 28 mm"),
        (within("1 mm").with("equals", 3), "equals: means nothing beside part"),
    ] {
        let said = complaint(turns().check(check));
        assert!(said.contains(expected), "{said}");
    }
    let said = complaint(scenario("a stand").on("servo").check(within("1 mm")));
    assert!(said.contains("the rig 'servo' turns no part"), "{said}");
}

// --- scenarios ------------------------------------------------------------------------------------------------------

/// Turns 20 mm, three slots deep.
fn turns() -> Prose {
    scenario("a diameter")
        .send("4B 00 00 00 00 00 00 00")
        .wait(reply("XON"))
        .send("4B 00 00 00 00 00 05 01")
        .wait(reply("XON"))
        .send("4B 46 23 28 01 00 00 00")
        .wait(reply("XON"))
}

fn failures(scenario: &Prose) -> Vec<(String, String)> {
    let failures = scenario.run().unwrap().failures;
    failures.into_iter().map(|failure| (failure.expected, failure.came)).collect()
}

#[test]
fn a_scenario_expects_diameters_and_forbids_events() {
    let never =
        |scenario: Prose| ["stopped", "rapid", "chuck", "deep"].into_iter().fold(scenario, |s, e| s.never(part(e)));
    never(turns()).diameter("-10 mm", "26.9 mm", "0.4 mm").diameter("-21 mm", "28 mm", "0 mm").must_pass();
    let wrong = turns().diameter("-10 mm", "24 mm", "0.4 mm").diameter("-10000 um", "26.9 mm", "0.4 mm");
    let expected = "diameter at z = -10 mm is 24 mm within 0.4 mm";
    assert_eq!(failures(&wrong), [(expected.to_owned(), "27.082 mm".to_owned())]);
    let toml = turns().never(part("rapid")).toml().replace("4B 46", "4B E1");
    let scenario = torno::scenario::Scenario::parse("a.toml", &toml, None).unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let outcome = runtime.block_on(torno::scenario::run(&scenario, &torno::rig::Driver::InProcess)).unwrap();
    let [failure] = &outcome.failures[..] else { panic!("{:?}", outcome.failures) };
    assert_eq!(failure.expected, "never rapid into the stock");
    assert!(failure.came.starts_with("at z = -") && failure.came.ends_with(" mm/s"), "{}", failure.came);
    assert!(failure.at < outcome.end);
}

#[test]
fn a_bore_is_turned_told_drawn_and_checked() {
    let folder = folder();
    let rig = boring(folder.path());
    // Outwards into the wall, 20 mm along, and back to the middle.
    let frames = "4B 00 00 00 00 00 05 00\n4B 46 23 28 01 00 00 00\n4B 00 00 00 00 00 05 01\n";
    let program = write(folder.path(), "bore.frames", frames);
    let svg = folder.path().join("bore.svg");
    let told = output(&["run", "--in-process", &rig, &program, "--part", svg.to_str().unwrap()]);
    let text = String::from_utf8(told.stdout).unwrap();
    assert!(text.contains("\npart     bored  10.92 x 20.00 mm (diameter x length, from the face)\n"), "{text}");
    assert!(text.contains("\n         asked  11.07 x 20.00 mm\n"), "{text}");
    assert!(text.contains("worst  0.15 mm of diameter too narrow, at z = "), "{text}");
    let told = run(&[&rig, &program]);
    assert_eq!((&told["side"], events(&told).len()), (&"inside".into(), 0), "{told}");
    let svg = fs::read_to_string(svg).unwrap();
    assert!(svg.contains("Ø10.92 (11.07)") && svg.contains("bore Ø10"), "{svg}");

    let frames: Vec<&str> = frames.lines().collect();
    let bored = scenario("a bore").on(&rig).send(frames[0]).wait(reply("XON")).send(frames[1]).wait(reply("XON"));
    let never = ["stopped", "rapid", "chuck", "deep", "wall"].into_iter();
    let bored = never.fold(bored, |scenario, event| scenario.never(part(event)));
    bored.clone().diameter("-10 mm", "10.92 mm", "0.01 mm").diameter("-21 mm", "10 mm", "0 mm").must_pass();
    bored.clone().check(part("as asked").with("within", "0.15 mm")).must_pass();
    assert_eq!(failures(&bored.diameter("-10 mm", "11.07 mm", "0.1 mm"))[0].1, "10.920 mm");

    // A rapid into the wall, and through it.
    let crash = write(folder.path(), "crash.frames", &format!("{}\n{}\n", frames[0], frames[1].replace("46", "E1")));
    assert_eq!(events(&run(&[&rig, &crash])), ["rapid"]);
    let thin = write(folder.path(), "thin.frames", "4B 00 00 00 00 00 3A 00\n");
    assert!(events(&run(&[&rig, &thin])).contains(&"wall"));
}

#[test]
fn what_is_expected_of_the_part_changes_nothing_of_the_run() {
    let digest = |scenario: &Prose| scenario.run().unwrap().digest;
    assert_eq!(digest(&turns()), digest(&turns().diameter("-10 mm", "1 mm", "0.4 mm").never(part("chuck"))));
}

#[test]
fn complaints_about_what_is_expected_say_where_and_what() {
    let complaint = |scenario: Prose| scenario.scenario().unwrap_err().to_string();
    for (scenario, expected) in [
        (turns().never(part("rapit")), "there is no event 'rapit' of a part: did you mean 'rapid'?"),
        (turns().diameter("-70 mm", "24 mm", "0.4 mm"), "'-70 mm': expected -60 mm to 0 mm"),
        (turns().diameter("-7 mm", "29 mm", "0.4 mm"), "'29 mm': expected 0 mm to 28 mm"),
        (turns().diameter("-7", "24 mm", "0.4 mm"), "'-7': expected a length, such as \"-20 mm\" or \"50 um\""),
        (turns().wait(part("rapid")), "part: the part is cut when all is done: expected this alone, in expect.never"),
    ] {
        let said = complaint(scenario);
        assert!(said.contains(expected) && said.starts_with("a diameter:"), "{said}");
    }
    let folder = folder();
    let text = include_str!("../harness/builtin/lathe.toml");
    let bare = write(folder.path(), "bare.toml", text.split("# What is turned.").next().unwrap());
    let said = complaint(turns().on(&bare).never(part("rapid")));
    assert!(said.contains("the rig 'lathe' turns no part: expected a [part] in its file"), "{said}");
    let shallow = write(folder.path(), "shallow.toml", &text.replace("\ndeepest_mm = 1 ", "\n#"));
    let said = complaint(turns().never(part("wall")));
    assert!(said.contains("on this rig no wall is cut through: expected bore_mm in its [part]"), "{said}");
    let said = complaint(turns().on(&shallow).never(part("deep")));
    assert!(said.contains("on this rig no cut is too deep: expected deepest_mm in its [part]"), "{said}");
}
