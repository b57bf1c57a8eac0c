//! What is saved of a session that goes on: by `torno ctl save`, and by the page.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::common::browser::{Browser, FLAWS};
use crate::common::{Up, folder, json, kill, output, wait_until};

const FRAMES: &str = include_str!("../harness/builtin/shaft.frames");
const CIRCLE: &str = "G21 G91\nG1 Z-2.5 F600\nG2 X0 Y0 I-20 J0\nG0 Z2.5\n";

/// `torno ctl` of a rig.
fn ctl(up: &Up, arguments: &[&str]) -> std::process::Output {
    let control = up.ready["control"].as_str().unwrap();
    output(&[&["ctl", "--json", "--socket", control], arguments].concat())
}

/// It must end well; its answer.
fn asked(up: &Up, arguments: &[&str]) -> Value {
    let output = ctl(up, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    json(&output)
}

/// It must be refused; what it complains of.
fn refused(up: &Up, arguments: &[&str]) -> String {
    let output = ctl(up, arguments);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}");
    String::from_utf8(output.stderr).unwrap()
}

fn play(up: &Up, program: &str) {
    let folder = folder();
    let path = folder.path().join("program");
    fs::write(&path, program).unwrap();
    asked(up, &["play", path.to_str().unwrap()]);
}

fn program(up: &Up) -> Value {
    asked(up, &["state"])["program"].take()
}

fn save(up: &Up, what: &str, path: &Path) -> Value {
    asked(up, &["save", what, path.to_str().unwrap()])
}

fn repeats(trace: &Path) {
    let replayed = output(&["replay", trace.to_str().unwrap()]);
    let said = String::from_utf8(replayed.stdout).unwrap();
    assert!(said.starts_with("same digest "), "{}: {said}", trace.display());
}

fn end(mut up: Up) {
    kill("-INT", up.pid());
    assert!(up.child.wait().unwrap().success());
}

#[test]
fn what_has_happened_so_far_is_saved_while_the_rig_goes_on_and_repeats() {
    let folder = folder();
    let path = |name: &str| -> PathBuf { folder.path().join(name) };
    let whole = path("whole.torno");
    let up = Up::start(&["--in-process", "--pace", "40", "--record", whole.to_str().unwrap()]);
    play(&up, FRAMES);
    // In the middle of what is said and done.
    for n in 0..4 {
        wait_until("more is accepted", || program(&up)["accepted"].as_u64() > Some(2 * n));
        let trace = path(&format!("{n}.torno"));
        let saved = save(&up, "recording", &trace);
        let about = fs::metadata(&trace).unwrap();
        assert_eq!((saved["bytes"].as_u64(), saved["name"].as_str()), (Some(about.len()), Some("lathe.torno")));
        assert_eq!(about.permissions().mode() & 0o777, 0o600);
        repeats(&trace);
    }
    assert!(program(&up)["outcome"].is_null(), "it is still played");
    asked(&up, &["fault", "cut", "spindle_to_master", "--name", "wire", "--for", "1 ms"]);
    asked(&up, &["pace", "max"]);
    wait_until("the program ends", || program(&up)["outcome"].is_string());
    let read = |what: &str, name: &str| {
        save(&up, what, &path(name));
        fs::read_to_string(path(name)).unwrap()
    };
    let report = read("report", "a.html");
    assert!(report.contains("<section id=\"part\">") && report.contains("wire at "), "{}", report.len());
    assert!(read("part", "a.svg").contains("what was asked is not known"));
    assert!(read("vcd", "a.vcd").contains("pc_to_master"));
    let kept = &asked(&up, &["state"])["kept"];
    assert!(kept["bytes"].as_u64() > Some(0) && kept["of"] == 64 << 20 && kept["until"].is_null(), "{kept}");
    // What cannot be made leaves the file as it is.
    assert!(refused(&up, &["save", "path", path("a.vcd").to_str().unwrap()]).contains("where its axes are"));
    assert!(fs::read_to_string(path("a.vcd")).unwrap().contains("pc_to_master"));
    assert!(refused(&up, &["save", "everything", "x"]).contains("recording, report, part, vcd or path"));
    let text = output(&["ctl", "--socket", up.ready["control"].as_str().unwrap(), "save", "part", "-"]);
    assert!(text.stdout.starts_with(b"<svg") && String::from_utf8_lossy(&text.stderr).contains("happened before"));
    end(up);
    // Nothing of it has disturbed the session.
    repeats(&whole);
}

#[test]
fn what_is_saved_in_the_middle_of_a_character_repeats() {
    let folder = folder();
    let up = Up::start(&["--in-process"]);
    asked(&up, &["pause"]);
    play(&up, FRAMES);
    // Characters follow one another: each lasts for 1042 us.
    for n in 0..8 {
        let until = asked(&up, &["step", "330 us"])["ns"].as_u64().unwrap();
        let trace = folder.path().join(format!("{n}.torno"));
        assert!(save(&up, "recording", &trace)["ns"].as_u64().unwrap() >= until);
        repeats(&trace);
    }
    end(up);
}

#[test]
fn a_recording_in_which_there_is_no_more_room_says_up_to_where_it_goes() {
    let folder = folder();
    let trace = folder.path().join("a.torno");
    let up = Up::start(&["--in-process", "--pace", "200", "--keep", "1"]);
    // The spindle has much to tell for as long as it turns.
    play(&up, "4B E1 00 00 00 00 00 00");
    up.wait_for_log("no more is kept");
    let kept = asked(&up, &["state"])["kept"].take();
    let until = kept["until"].as_u64().unwrap();
    assert!(kept["bytes"].as_u64().unwrap() < 1_300_000 && until > 0, "{kept}");
    assert_eq!(save(&up, "recording", &trace)["ns"], until);
    let replayed = output(&["replay", trace.to_str().unwrap()]);
    assert!(String::from_utf8_lossy(&replayed.stdout).starts_with("the same as far as it is recorded"));
    end(up);
    let none = Up::start(&["--in-process", "--keep", "0"]);
    assert!(refused(&none, &["save", "recording", trace.to_str().unwrap()]).contains("--keep 0"));
    assert!(asked(&none, &["state"])["kept"].is_null());
    end(none);
}

#[test]
fn what_has_happened_is_saved_by_hand_on_the_page() {
    let Some(mut browser) = Browser::start() else { return };
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    let up = Up::start(&["engraver", "--page", "--in-process", "--pace", "20"]);
    browser.show(up.ready["page"].as_str().unwrap());
    browser.wait_until("document.getElementById('kept')?.textContent.endsWith('of 64 MiB are kept on disk.')");
    let kept_in = json!({ "behavior": "allow", "downloadPath": folder.path() });
    browser.call("Page.setDownloadBehavior", &kept_in);
    play(&up, CIRCLE);
    wait_until("the program is through", || program(&up)["outcome"] == "completed");
    let offered = browser.run("[...document.querySelectorAll('#save-what button')].map((it) => it.textContent)");
    assert_eq!(offered, json!(["Recording", "Report", "Lines (VCD)", "Path"]));
    let names = ["engraver.torno", "engraver-report.html", "engraver.vcd", "engraver-path.svg"];
    for (n, name) in names.into_iter().enumerate() {
        browser.run(&format!("document.querySelectorAll('#save-what button')[{n}].click()"));
        wait_until(name, || path(name).exists());
        browser.wait_until(&format!("!document.querySelectorAll('#save-what button')[{n}].disabled"));
    }
    repeats(&path("engraver.torno"));
    let read = |name: &str| fs::read_to_string(path(name)).unwrap();
    assert!(read("engraver-report.html").ends_with("</html>\n") && read("engraver.vcd").contains("$enddefinitions"));
    assert!(read("engraver-path.svg").contains("x, mm") && read("engraver-path.svg").ends_with("</svg>\n"));
    assert_eq!(browser.run("document.getElementById('alert').hidden"), true);
    assert_eq!(browser.run(FLAWS), json!([]));
    assert_eq!(browser.complaints, [""; 0]);
    end(up);
    // What has ended gives nothing more.
    browser.wait_until("document.getElementById('save').hidden");
    assert_eq!(browser.run("document.getElementById('program-start').disabled"), true);
}
