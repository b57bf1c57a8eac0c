//! A program is looked at before it is played: by `torno ctl preview`, and on the page.

use std::path::Path;

use serde_json::{Value, json};

use crate::common::browser::{Browser, FLAWS};
use crate::common::{Up, folder, json, kill, output};

const FRAMES: &str = include_str!("../harness/builtin/shaft.frames");
const CIRCLE: &str = "G21 G91\nG1 Z-2.5 F600\nG2 X0 Y0 I-20 J0\nG0 Z2.5\nG0 X5\n";
const NGC: &str = include_str!("../harness/builtin/shaft.ngc");

fn ctl(up: &Up, arguments: &[&str]) -> std::process::Output {
    let control = up.ready["control"].as_str().unwrap();
    output(&[&["ctl", "--socket", control], arguments].concat())
}

fn program_of(up: &Up) -> Value {
    json(&ctl(up, &["--json", "state"]))["program"].take()
}

fn write(path: &Path, text: &str) -> String {
    std::fs::write(path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

fn end(mut up: Up) {
    kill("-INT", up.pid());
    assert!(up.child.wait().unwrap().success());
}

/// Types a program, as a person does.
fn typed(text: &str) -> String {
    format!(
        "(() => {{ const it = document.getElementById('program-text'); it.value = {}; \
         it.dispatchEvent(new Event('input')); }})()",
        json!(text)
    )
}

#[test]
fn a_program_is_looked_at_before_anything_is_sent() {
    let folder = folder();
    let file = |name: &str, text: &str| write(&folder.path().join(name), text);
    let up = Up::start(&["--in-process"]);
    let bad = ctl(&up, &["preview", &file("bad", "0A E1 00 E1 00 00 00 00\n0A E1\n")]);
    let said = String::from_utf8(bad.stdout).unwrap();
    assert!(bad.status.code() == Some(2) && said.contains("line 2") && said.contains("is refused"), "{said}");
    let good = ctl(&up, &["preview", &file("good", FRAMES)]);
    let said = String::from_utf8(good.stdout).unwrap();
    assert!(good.status.success() && said.contains(" takes 1"), "{said}");
    let stands = "00 00 00 00 00 00 14 01\n00 0A 00 FF 01 00 00 00";
    let deep = ctl(&up, &["preview", &file("deep", stands)]);
    assert!(String::from_utf8_lossy(&deep.stdout).contains("stopped at "), "{deep:?}");
    assert!(program_of(&up).is_null(), "nothing is sent");
    // G-code is planned for a rig that takes frames.
    let planned = ctl(&up, &["play", &file("shaft.ngc", NGC)]);
    assert!(planned.status.success(), "{planned:?}");
    assert!(program_of(&up)["of"].as_u64() > Some(10), "{}", program_of(&up));
    end(up);
}

#[test]
fn a_program_may_be_as_long_as_one_of_a_run() {
    let folder = folder();
    let frames = 1 << 17;
    let long = write(&folder.path().join("long"), &"00 00 00 00 00 00 00 00\n".repeat(frames));
    let up = Up::start(&["--in-process"]);
    // 3 MiB, where a fault has a few hundred bytes.
    let played = ctl(&up, &["play", &long]);
    assert!(played.status.success(), "{played:?}");
    assert_eq!(program_of(&up)["of"], frames);
    end(up);
}

#[test]
fn a_program_is_drawn_on_the_page_before_it_runs() {
    let Some(mut browser) = Browser::start() else { return };
    let lines = "[...document.querySelectorAll('#preview path.way')].map((it) => it.getAttribute('class'))";
    let said = "document.getElementById('preview').textContent";
    for (rig, program, drawn, takes) in [
        ("lathe", FRAMES, json!(["way stock", "way frames", "way turned"]), "It takes 1"),
        ("servo", "x10 t2\ne\n", json!(["way set-point"]), "It takes 2.000 s."),
        ("engraver", CIRCLE, json!(["way in-the-air", "way asked"]), ""),
    ] {
        let up = Up::start(&[rig, "--page", "--in-process"]);
        browser.show(up.ready["page"].as_str().unwrap());
        browser.wait_until("!!document.getElementById('program-hint')?.textContent");
        browser.run(&typed(program));
        browser.wait_until("!!document.querySelector('#preview svg')");
        assert_eq!(browser.run(lines), drawn, "{rig}");
        assert!(browser.run(said).as_str().unwrap().contains(takes), "{rig}: {}", browser.run(said));
        for width in [1440, 400] {
            browser.resize(width, false);
            assert_eq!(browser.run(FLAWS), json!([]), "{rig} at {width} px");
        }
        let bad = if rig == "engraver" { "G21\nG5 X3\n" } else { "00 00 00 00 00 00 00 00\n00 A\n" };
        browser.run(&typed(bad));
        browser.wait_until(&format!("{said}.includes('line 2') || {said}.includes('line 1')"));
        assert!(program_of(&up).is_null(), "{rig}: nothing is sent");
        // No program, no drawing.
        browser.run(&typed(""));
        browser.wait_until(&format!("{said} === ''"));
        end(up);
    }
    assert_eq!(browser.complaints, [""; 0]);
}
