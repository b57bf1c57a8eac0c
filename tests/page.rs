//! The live page of a rig that is up: who may see it, what a browser is told, what it may do.

#![allow(clippy::disallowed_methods, reason = "a pace is measured by the wall clock")]

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::common::browser::{Browser, FLAWS};
use crate::common::{ACK, PATIENCE, SHORT, Up, json, kill, output, wait_until};

/// The page of a rig.
pub(crate) struct Page {
    host: String,
    token: String,
}

impl Page {
    fn of(up: &Up) -> Self {
        Self::at(&up.ready)
    }

    /// The page that is announced so.
    pub(crate) fn at(ready: &Value) -> Self {
        let url = ready["page"].as_str().unwrap();
        let (host, token) = url.strip_prefix("http://").unwrap().split_once('/').unwrap();
        Self { host: host.to_owned(), token: token.trim_end_matches('/').to_owned() }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.host).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    /// Sends a request as it is; gives the status and the rest.
    fn raw(&self, request: &str) -> (u16, String) {
        let mut stream = self.connect();
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        (answer.split(' ').nth(1).unwrap().parse().unwrap(), answer)
    }

    fn get(&self, path: &str, headers: &str) -> (u16, String) {
        self.raw(&format!("GET {path} HTTP/1.1\r\n{headers}Connection: close\r\n\r\n"))
    }

    fn post(&self, body: &str, headers: &str) -> (u16, String) {
        let length = body.len();
        self.raw(&format!(
            "POST /{}/ask HTTP/1.1\r\n{headers}Content-Length: {length}\r\nConnection: close\r\n\r\n{body}",
            self.token
        ))
    }

    /// What the page itself would say of where it comes from.
    fn own(&self) -> String {
        let host = &self.host;
        format!("Host: {host}\r\nOrigin: http://{host}\r\nContent-Type: application/json\r\n")
    }

    /// Asks as the page does.
    pub(crate) fn ask(&self, request: &Value) -> Value {
        let (status, answer) = self.post(&request.to_string(), &self.own());
        assert_eq!(status, 200, "{answer}");
        serde_json::from_str(answer.split("\r\n\r\n").nth(1).unwrap()).unwrap()
    }

    /// Listens to what a browser is told.
    pub(crate) fn listen(&self) -> Events {
        let mut stream = self.connect();
        write!(stream, "GET /{}/events HTTP/1.1\r\nHost: {}\r\n\r\n", self.token, self.host).unwrap();
        Events(BufReader::new(stream))
    }
}

/// What a browser is told.
pub(crate) struct Events(BufReader<TcpStream>);

impl Events {
    /// The next event: its kind and its data.
    fn next(&mut self) -> (String, Value) {
        let mut kind = String::new();
        loop {
            let mut line = String::new();
            assert!(self.0.read_line(&mut line).unwrap() > 0, "the stream has ended");
            if let Some(name) = line.strip_prefix("event: ") {
                name.trim().clone_into(&mut kind);
            } else if let Some(data) = line.strip_prefix("data: ") {
                return (kind, serde_json::from_str(data.trim()).unwrap());
            }
        }
    }

    /// The next one that has what is wanted.
    pub(crate) fn find(&mut self, wanted: &str, is_it: impl Fn(&Value) -> bool) -> Value {
        let start = Instant::now();
        loop {
            assert!(start.elapsed() < PATIENCE, "no such {wanted} came");
            let (kind, data) = self.next();
            if kind == wanted && is_it(&data) {
                return data;
            }
        }
    }
}

fn ctl(up: &Up, arguments: &[&str]) -> Value {
    let control = up.ready["control"].as_str().unwrap();
    json(&output(&[&["ctl", "--json", "--socket", control], arguments].concat()))
}

fn end(mut up: Up) {
    kill("-INT", up.pid());
    assert!(up.child.wait().unwrap().success());
}

#[test]
fn nobody_but_its_user_sees_the_page() {
    let up = Up::start(&["--page"]);
    let page = Page::of(&up);
    let (host, token) = (&page.host, &page.token);
    assert!(host.starts_with("127.0.0.1:") && token.len() == 32, "{host} {token}");
    let here = format!("Host: {host}\r\n");
    let (status, html) = page.get(&format!("/{token}/"), &here);
    assert!(status == 200 && html.contains("<!DOCTYPE html>"), "{html}");
    for header in ["content-security-policy: default-src 'none'", "referrer-policy: no-referrer", "no-store"] {
        assert!(html.contains(header), "{header}\n{html}");
    }
    let other: String = token.chars().rev().collect();
    for path in ["/", "/events", &format!("/{token}"), &format!("/{other}/"), &format!("/{}/", &token[..31])] {
        let (status, answer) = page.get(path, &here);
        assert!(status == 403 && !answer.contains("<!DOCTYPE"), "{path}: {answer}");
    }
    let (_, port) = host.split_once(':').unwrap();
    for wrong in [format!("evil.example:{port}"), "127.0.0.1".to_owned(), format!("127.0.0.1.evil.example:{port}")] {
        assert_eq!(page.get(&format!("/{token}/"), &format!("Host: {wrong}\r\n")).0, 403, "{wrong}");
        assert_eq!(page.get(&format!("/{token}/events"), &format!("Host: {wrong}\r\n")).0, 403, "{wrong}");
    }
    assert_eq!(page.get(&format!("/{token}/"), &format!("{here}Origin: http://evil.example\r\n")).0, 403);
    let ask = r#"{"do":"pause"}"#;
    let json = "Content-Type: application/json\r\n";
    for origin in ["", "Origin: null\r\n", "Origin: http://evil.example\r\n", &format!("Origin: https://{host}\r\n")] {
        assert_eq!(page.post(ask, &format!("{here}{json}{origin}")).0, 403, "{origin}");
    }
    // As a form of another site would be sent, if it had the rest.
    let form = page.own().replace("application/json", "text/plain");
    assert_eq!(page.post(ask, &form).0, 415);
    assert_eq!(ctl(&up, &["state"])["paused"], false);
    assert_eq!(page.get(&format!("/{token}/nothing.js"), &here).0, 404);
    assert!(page.post(ask, &page.own()).1.contains("{\"ok\":"));
    assert_eq!(ctl(&up, &["state"])["paused"], true);
    assert!(!up.log().contains(token.as_str()), "{}", up.log());
    end(up);
}

#[test]
fn a_browser_is_told_what_happens_and_may_ask_what_ctl_asks() {
    let up = Up::start(&["--page", "--pace", "20"]);
    let page = Page::of(&up);
    let mut events = page.listen();
    let (kind, rig) = events.next();
    assert_eq!(
        (kind.as_str(), rig["rig"].as_str(), rig["charts"].as_array().unwrap().len()),
        ("rig", Some("lathe"), 3)
    );
    events.find("look", |look| look["state"]["ok"]["boards"].as_array().is_some_and(|boards| boards.len() == 5));
    let mut pc = up.pc();
    pc.write(&SHORT);
    pc.expect(&[ACK]);
    let has = |look: &Value, what: &dyn Fn(&Value) -> bool| look["rows"].as_array().unwrap().iter().any(what);
    events.find("look", |look| has(look, &|row| row["kind"] == "frames" && row["line"] == "pc_to_master"));
    events.find("look", |look| has(look, &|row| row["kind"] == "telemetry" && row["board"] == "spindle"));
    // The same requests, the same refusals.
    let cut = json!({ "do": "fault", "fault": "line = \"master_to_depth\"\nkind = \"cut\"" });
    assert_eq!(page.ask(&cut)["ok"]["name"], "master_to_depth cut");
    assert_eq!(ctl(&up, &["state"])["faults"][0]["name"], "master_to_depth cut");
    events.find("look", |look| look["state"]["ok"]["faults"][0]["name"] == "master_to_depth cut");
    assert!(page.ask(&cut)["error"].as_str().unwrap().contains("there is a fault"), "{}", page.ask(&cut));
    page.ask(&json!({ "do": "heal", "name": "master_to_depth cut" }));
    assert_eq!(ctl(&up, &["state"])["faults"], json!([]));
    for (wrong, expected) in [("", "found an empty line"), ("{}", "expected a request"), (r#"{"do":"dance"}"#, "dance")]
    {
        let (status, answer) = page.post(wrong, &page.own());
        assert!(status == 200 && answer.contains(expected), "{answer}");
    }
    // Where time stands still, what is done is told at once.
    page.ask(&json!({ "do": "pause" }));
    events.find("look", |look| look["state"]["ok"]["paused"] == true);
    let stood = page.ask(&json!({ "do": "step", "span": "10 ms" }))["ok"]["ns"].as_u64().unwrap();
    events.find("look", |look| look["state"]["ok"]["ns"] == stood);
    end(up);
}

#[test]
fn a_browser_that_stalls_leaves_the_rig_as_it_is_and_is_told_what_it_lost() {
    let up = Up::start(&["--page", "--pace", "200"]);
    let page = Page::of(&up);
    let mut stalled = page.listen();
    rustix::net::sockopt::set_socket_recv_buffer_size(stalled.0.get_ref(), 4_096).unwrap();
    let mut reader = page.listen();
    stalled.next();
    let mut pc = up.pc();
    // The spindle has much to tell for as long as it turns.
    pc.write(&[0x4b, 0xe1, 0, 0, 0, 0, 0, 0]);
    pc.expect(&[ACK]);
    let ns = |look: &Value| look["state"]["ok"]["ns"].as_u64().unwrap();
    let (begun, first) = (Instant::now(), ns(&reader.find("look", |_| true)));
    let mut told = 0;
    let mut last = first;
    while told < 4 << 20 && begun.elapsed() < Duration::from_secs(20) {
        let look = reader.find("look", |_| true);
        told += look.to_string().len();
        last = ns(&look);
    }
    let went = (last - first) as f64 * 1e-9 / begun.elapsed().as_secs_f64();
    assert!((180.0..=220.0).contains(&went), "the pace was {went}");
    let lost = stalled.find("lost", |_| true);
    assert!(lost.as_u64().unwrap() > 0);
    // It goes on where it is then.
    let after = stalled.find("look", |_| true);
    assert!(ns(&after) > first);
    // Who closes is forgotten.
    drop((stalled, reader));
    wait_until("no one is looked at for", || page.ask(&json!({ "do": "state" }))["ok"]["ns"].as_u64() > Some(last));
    end(up);
}

#[test]
fn the_page_is_announced_and_another_address_is_warned_of() {
    let up = Up::start(&["--page=0.0.0.0:0", "--in-process"]);
    up.wait_for_log("can be reached over the network");
    end(up);
    let refused = output(&["up", "--page=nowhere"]);
    assert_eq!(refused.status.code(), Some(2));
    let alone = output(&["up", "--browser"]);
    assert_eq!(alone.status.code(), Some(2));
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap();
    let folder = crate::common::folder();
    let link = folder.path().join("pc");
    let busy = output(&["up", "--in-process", "--link", link.to_str().unwrap(), &format!("--page={address}")]);
    let said = String::from_utf8(busy.stderr).unwrap();
    assert!(said.contains("choose another address with --page=ADDRESS:PORT"), "{said}");
    assert_eq!(busy.status.code(), Some(2));
}

/// The program that has been played is over: how, and how much of it was accepted.
fn played(up: &Up) -> (String, u64) {
    let mut program = Value::Null;
    wait_until("the program ends", || {
        program = ctl(up, &["state"])["program"].take();
        program["outcome"].is_string()
    });
    (program["outcome"].as_str().unwrap().to_owned(), program["accepted"].as_u64().unwrap())
}

const FRAMES: &str = include_str!("../harness/builtin/shaft.frames");
const LINES: &str = include_str!("../harness/builtin/shaft.nc");

#[test]
fn a_program_is_played_from_the_page_and_the_part_is_seen_and_all_of_it_repeats() {
    let folder = crate::common::folder();
    let trace = folder.path().join("a.torno");
    let trace = trace.to_str().unwrap();
    for (rig, program, accepted) in [("lathe", FRAMES, 30), ("lathe-grbl", LINES, LINES.lines().count() as u64 + 1)] {
        let up = Up::start(&[rig, "--page", "--in-process", "--pace", "max", "--record", trace]);
        let page = Page::of(&up);
        let mut events = page.listen();
        assert!(page.ask(&json!({ "do": "play", "program": program }))["ok"]["ns"].is_u64());
        assert_eq!(played(&up), ("completed".to_owned(), accepted), "{rig}");
        let thinnest = |part: &Value| {
            let corners = part["ok"]["outline"].as_array().unwrap().iter();
            corners.map(|corner| corner[1].as_f64().unwrap()).fold(f64::MAX, f64::min)
        };
        // As the run of the same program says: 22.46 mm.
        let part = events.find("part", |part| (thinnest(part) - 11.23).abs() < 0.15);
        assert!(part["ok"]["events"].is_array());
        end(up);
        let replayed = output(&["replay", trace]);
        assert!(String::from_utf8(replayed.stdout).unwrap().starts_with("same digest "), "{rig}");
    }
}

#[test]
fn a_program_is_refused_while_a_program_outside_has_the_port() {
    let up = Up::start(&["--page", "--in-process", "--pace", "20"]);
    let page = Page::of(&up);
    let play = |program: &str| page.ask(&json!({ "do": "play", "program": program }));
    let refusal = |answer: Value| answer["error"].as_str().unwrap_or_else(|| panic!("{answer}")).to_owned();
    assert!(refusal(page.ask(&json!({ "do": "stop" }))).contains("no program is played"));
    assert!(refusal(play("0A E1")).contains("line 1"));
    let pc = up.pc();
    up.wait_for_log("has been opened");
    assert!(refusal(play(FRAMES)).contains("has the port"));
    drop(pc);
    up.wait_for_log("has been closed");
    assert!(play(FRAMES)["ok"].is_object());
    assert!(refusal(play(FRAMES)).contains("is played already"));
    assert!(page.ask(&json!({ "do": "stop" }))["ok"].is_object());
    assert_eq!(played(&up).0, "interrupted");
    // A program outside comes first.
    assert!(play(FRAMES)["ok"].is_object());
    let mut pc = up.pc();
    assert_eq!(played(&up).0, "interrupted");
    wait_until("the slaves are done", || ctl(&up, &["state"])["boards"][0]["waits_for"] == json!([]));
    std::thread::sleep(Duration::from_millis(100));
    pc.write(&crate::common::AT_REST);
    while pc.read(1) != [ACK] {}
    end(up);
    let servo = Up::start(&["servo", "--page", "--in-process"]);
    let refused = Page::of(&servo).ask(&json!({ "do": "play", "program": "x1" }));
    assert!(refused["error"].as_str().unwrap().contains("torno servo"), "{refused}");
    end(servo);
}

#[test]
fn what_a_program_outside_has_made_is_drawn_reported_and_dumped_at_the_end() {
    let folder = crate::common::folder();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (part, report, vcd, trace) = (path("part.svg"), path("a.html"), path("a.vcd"), path("a.torno"));
    let files = ["--part", &part, "--report", &report, "--vcd", &vcd, "--record", &trace];
    let up = Up::start(&[&["--in-process", "--pace", "50"][..], &files].concat());
    let mut pc = up.pc();
    // At 1500 rpm twelve slots in, and 5 mm along the bar.
    for frame in [[0x4b, 0, 0, 0, 0, 0, 12, 1], [0x4b, 20, 0x08, 0xca, 1, 0, 0, 0]] {
        pc.write(&frame);
        while pc.read(1) != [crate::common::XON] {}
    }
    drop(pc);
    end(up);
    let read = |path: &str| std::fs::read_to_string(path).unwrap();
    let drawing = read(&part);
    assert!(drawing.contains("what was asked is not known") && !drawing.contains("(asked)"), "{drawing}");
    // 28 mm, less ten slots of the twelve on either side, but for what the slide lacks of the last.
    assert!(drawing.contains("Ø24."), "{drawing}");
    let html = read(&report);
    assert!(html.contains("<section id=\"part\">") && html.contains("24."), "{}", html.len());
    assert!(html.contains("<title>a live session on lathe</title>"), "{}", &html[..600]);
    assert!(html.contains("<dd class=\"\">ended</dd>") && html.contains("id=\"figure-outcome\">ended<"));
    assert!(read(&vcd).contains("pc_to_master"));
    // The same from its recording.
    let again = path("again.html");
    assert!(output(&["trace", &trace, "--report", &again]).status.success());
    assert!(read(&again).contains("<title>the recording a.torno on lathe</title>"));
    let drawn = output(&["trace", &trace, "--part", "-"]);
    assert_eq!(String::from_utf8(drawn.stdout).unwrap(), drawing);
    let section = |html: &str| {
        let section = html.split("<section id=\"part\">").nth(1).and_then(|rest| rest.split("</section>").next());
        section.unwrap().replace("the recording a.torno", "a live session")
    };
    assert_eq!(section(&read(&again)), section(&html));
    let none = output(&["up", "servo", "--part", &part]);
    assert!(String::from_utf8(none.stderr).unwrap().contains("--part: the rig 'servo' turns no part"));
    assert_eq!(none.status.code(), Some(2));
}

/// The texts that some language lacks.
const UNSAID: &str = r"import('./texts.js').then(({ LANGUAGES, TEXTS }) => Object.keys(TEXTS).filter((key) =>
  TEXTS[key].length !== Object.keys(LANGUAGES).length || TEXTS[key].some((text) => !text)))";

const MOVES: &str = "p0 k10 x5\nx30 t3\np10 k0 x5\nx0 t0.5\ne\n";
const ROSETTE: &str = include_str!("../harness/builtin/rosette.nc");

/// Plays a program on a rig, and lets its time stand still at so many seconds, or at its end.
fn play_until(up: &Up, program: &str, seconds: f64) {
    let folder = crate::common::folder();
    let path = folder.path().join("program");
    std::fs::write(&path, program).unwrap();
    let path = path.to_str().unwrap();
    if up.ready["rig"] == "servo" {
        let link = up.link();
        let ran = output(&["servo", "run", path, "--port", link.to_str().unwrap(), "--json"]);
        assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    } else {
        ctl(up, &["play", path]);
    }
    wait_until("time has come so far", || ctl(up, &["state"])["ns"].as_f64() > Some(seconds * 1e9));
    ctl(up, &["pause"]);
}

#[test]
fn the_page_of_every_rig_has_room_at_every_width() {
    let Some(mut browser) = Browser::start() else { return };
    let mut said = false;
    for (rig, charts, program, seconds) in [
        ("lathe", 3, FRAMES, 90.0),
        ("lathe-dspic", 3, FRAMES, 90.0),
        ("lathe-grbl", 3, LINES, 90.0),
        ("servo", 1, MOVES, 4.0),
        ("engraver", 4, ROSETTE, 61.0),
    ] {
        // The servo stand's PC has no patience.
        let how = match rig {
            "servo" => &["--pace", "1"][..],
            "engraver" => &["--pace", "10", "--set", "engraver.tell_ms=20"],
            _ => &["--pace", "30"],
        };
        let up = Up::start(&[&[rig, "--page", "--in-process"], how].concat());
        browser.show(up.ready["page"].as_str().unwrap());
        browser.wait_until("document.getElementById('time')?.textContent.endsWith(' s') ?? false");
        assert_eq!(browser.run("document.querySelectorAll('#charts canvas').length"), charts, "{rig}");
        if !core::mem::replace(&mut said, true) {
            assert_eq!(browser.run(UNSAID), json!([]));
        }
        let typed = "const it = document.getElementById('program-text'); it.dispatchEvent(new Event('input'));";
        browser.run(&format!("document.getElementById('program-text').value = {}; {typed}", json!(program)));
        play_until(&up, program, seconds);
        browser.wait_until("!!document.querySelector('#preview svg')");
        for (width, dark) in [(1440, false), (1000, true), (400, false), (400, true)] {
            browser.resize(width, dark);
            for language in ["es", "pl", "zh", "en"] {
                let choose = format!(
                    "(() => {{ const it = document.getElementById('language'); it.value = '{language}'; \
                     it.dispatchEvent(new Event('change')); return document.documentElement.lang; }})()"
                );
                assert_eq!(browser.run(&choose), language);
                assert_eq!(browser.run(FLAWS), json!([]), "{rig} at {width} px in {language}");
            }
            browser.picture_into("PAGE_PICTURES", rig, width, dark);
        }
        end(up);
    }
    assert_eq!(browser.complaints, [""; 0]);
}

#[test]
fn a_line_is_cut_and_healed_by_hand_and_the_pc_is_told() {
    let Some(mut browser) = Browser::start() else { return };
    let up = Up::start(&["--page", "--in-process"]);
    browser.show(up.ready["page"].as_str().unwrap());
    let line = "[...document.querySelectorAll('.line')].find((line) => line.textContent === 'master to depth')";
    browser.wait_until(&format!("!!{line}?.getAttribute('aria-label')"));
    browser.run(&format!("{line}.dispatchEvent(new KeyboardEvent('keydown', {{ key: 'Enter' }}))"));
    browser.run("document.getElementById('break').click()");
    browser.wait_until(&format!("{line}.dataset.is === 'broken'"));
    let mut pc = up.pc();
    pc.write(&SHORT);
    // The master gives up on the depth board, and the page says so as it is said to the PC.
    pc.expect(&[ACK, crate::common::CAN]);
    browser.wait_until("document.getElementById('rows').textContent.includes('CAN')");
    browser.run("document.querySelector('#faults button').click()");
    browser.wait_until(&format!("{line}.dataset.is !== 'broken'"));
    assert_eq!(ctl(&up, &["state"])["faults"], json!([]));
    assert_eq!(browser.complaints, [""; 0]);
    end(up);
}

#[test]
fn a_program_is_typed_and_started_by_hand_and_the_part_is_drawn() {
    let Some(mut browser) = Browser::start() else { return };
    let up = Up::start(&["--page", "--in-process", "--pace", "max"]);
    browser.show(up.ready["page"].as_str().unwrap());
    browser.wait_until("!!document.querySelector('path.bar')?.getAttribute('d')");
    let bar = "document.querySelector('path.bar').getAttribute('d')";
    let uncut = browser.run(bar);
    browser.run("document.getElementById('program-text').value = 'G1 X3'");
    browser.run("document.getElementById('program-start').click()");
    browser.wait_until("document.getElementById('alert').textContent.includes('line 1')");
    browser.run(&format!("document.getElementById('program-text').value = {}", json!(FRAMES)));
    browser.run("document.getElementById('program-start').click()");
    browser.wait_until("document.getElementById('program-state').textContent.includes('completed')");
    browser.wait_until(&format!("{bar} !== {uncut} && {bar}.includes('11.2')"));
    assert_eq!(browser.run("document.getElementById('alert').hidden"), true);
    // The spindle stands, and the tool goes on into the bar.
    let stands = "00 00 00 00 00 00 14 01\n00 0A 00 FF 01 00 00 00";
    browser.run(&format!("document.getElementById('program-text').value = {}", json!(stands)));
    browser.run("document.getElementById('program-start').click()");
    browser.wait_until("document.getElementById('part-events').textContent.includes('with a stopped spindle')");
    assert_eq!(browser.run(FLAWS), json!([]));
    assert_eq!(browser.complaints, [""; 0]);
    end(up);
}

#[test]
fn the_way_of_the_engravers_tool_is_drawn_where_it_is_in_the_work() {
    let Some(mut browser) = Browser::start() else { return };
    let up = Up::start(&["engraver", "--page", "--in-process", "--pace", "20", "--set", "engraver.tell_ms=20"]);
    browser.show(up.ready["page"].as_str().unwrap());
    browser.wait_until("!!document.querySelector('svg.bed')?.getAttribute('aria-label')");
    // So many px are drawn of the way that was asked, and of the one that the carriages went.
    let inked = "['asked', 'got'].map((way) => { const { width, height } = document.querySelector(`canvas.${way}`); \
                 const { data } = document.querySelector(`canvas.${way}`).getContext('2d') \
                 .getImageData(0, 0, width, height); \
                 return data.filter((value, n) => n % 4 === 3 && value > 99).length; })";
    assert_eq!(browser.run(inked), json!([0, 0]));
    let played = |browser: &mut Browser, program: &str| {
        browser.run(&format!("document.getElementById('program-text').value = {}", json!(program)));
        browser.run("document.getElementById('program-start').click()");
        let lines = program.lines().count();
        wait_until("the program is through", || {
            let state = ctl(&up, &["state"]);
            let (program, axes) = (&state["program"], &state["boards"][0]["telemetry"]);
            program["accepted"] == lines
                && program["outcome"] == "completed"
                && axes["z_carriage_nm"].as_i64() > Some(1_990_000)
        });
        browser.wait_until("document.querySelector('.readout').textContent.includes('in the air')");
    };
    // In the air, nothing is drawn.
    played(&mut browser, "G21 G90\nG0 Z2\nG0 X20 Y0\n");
    assert_eq!(browser.run(inked), json!([0, 0]));
    played(&mut browser, "G21 G91\nG1 Z-2.5 F600\nG2 X0 Y0 I-20 J0\nG0 Z2.5\n");
    browser.wait_until(&format!("{inked}[0] > 1200"));
    browser.wait_until("document.querySelector('.readout').textContent.includes('in the air')");
    let lines = browser.run(inked);
    // A circle of 40 mm where 80 are shown: at more than 3 px a mm, lines of 4 and 1.4 px.
    let px = |n: usize| lines[n].as_u64().unwrap();
    assert!(px(1) > 300 && px(0) < 12_000, "{lines}");
    assert_eq!(browser.complaints, [""; 0]);
    end(up);
}
