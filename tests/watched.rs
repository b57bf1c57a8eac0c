//! Sessions that are watched through a page: runs, replays and scenarios. Nothing that comes of them depends on it.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, ChildStdout, Stdio};
use std::time::Instant;

use serde_json::{Value, json};
use torno::control::{Control, Form, Request, backlog};
use torno::pace::Pace;
use torno::rig::Driver;
use torno::scenario::{self, Scenario};
use torno::steering::{Role, Shown};

use crate::common::browser::{Browser, FLAWS};
use crate::common::{folder, kill, output, torno};
use crate::page::Page;

/// What the digest of the demonstration is, with or without a page.
const DEMONSTRATION: &str = "1e9c99d5e3eefee1d58994d7ee108996";
/// A program that is done after about a second: what is said of it as [`crate::common::SHORT`].
const SHORT: &str = "0A E1 00 E1 00 00 01 00\n";

/// A command that serves a page, once it has said where.
struct Watched {
    child: Child,
    output: BufReader<ChildStdout>,
    ready: Value,
}

impl Watched {
    fn start(arguments: &[&str]) -> Self {
        let mut child = torno(arguments).args(["--page", "--json"]).stdout(Stdio::piped()).spawn().unwrap();
        let mut output = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        output.read_line(&mut line).unwrap();
        let ready = serde_json::from_str(&line).unwrap_or_else(|_| panic!("not ready: {line:?}"));
        Self { child, output, ready }
    }

    fn page(&self) -> Page {
        Page::at(&self.ready)
    }

    /// Its result, and its exit status.
    fn end(mut self) -> (Value, Option<i32>) {
        let mut rest = String::new();
        self.output.read_to_string(&mut rest).unwrap();
        let code = self.child.wait().unwrap().code();
        (serde_json::from_str(&rest).unwrap_or_else(|_| panic!("{rest:?}")), code)
    }
}

fn refusal(answer: &Value) -> &str {
    answer["error"].as_str().unwrap_or_else(|| panic!("{answer}"))
}

/// Writes a program into a folder; gives its path.
fn program(folder: &Path, text: &str) -> String {
    let path = folder.join("a.frames");
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn a_run_is_watched_while_it_goes_and_nothing_of_it_is_another() {
    let run = Watched::start(&["run", "lathe", "--in-process", "--pace", "100"]);
    let page = run.page();
    let mut events = page.listen();
    assert_eq!(events.find("rig", |_| true)["role"], "run");
    events.find("look", |look| look["state"]["ok"]["program"]["accepted"].as_u64() > Some(2));
    let refused = page.ask(&json!({ "do": "play", "program": SHORT }));
    assert!(refusal(&refused).contains("a run plays its own program"), "{refused}");
    let before_all = page.ask(&json!({ "do": "past", "ns": -1 }));
    assert!(refusal(&before_all).contains("-1"), "{before_all}");
    // Time can be held, and a step be taken.
    page.ask(&json!({ "do": "pause" }));
    let stood = page.ask(&json!({ "do": "step", "span": "10 ms" }))["ok"]["ns"].as_u64().unwrap();
    events.find("look", |look| look["state"]["ok"]["ns"] == stood && look["state"]["ok"]["paused"] == true);
    page.ask(&json!({ "do": "pace", "pace": "max" }));
    page.ask(&json!({ "do": "resume" }));
    // All of it has been told when the end is.
    let whole = |look: &Value| look["state"]["ok"]["program"]["accepted"] == 30;
    events.find("look", whole);
    events.find("part", |part| part["ok"]["outline"].is_array());
    assert_eq!(events.find("end", |_| true), json!({ "outcome": "completed" }));
    let (summary, code) = run.end();
    assert_eq!((summary["digest"].as_str(), code), (Some(DEMONSTRATION), Some(0)));
}

#[test]
fn a_run_can_be_broken_and_the_recording_repeats_that() {
    let folder = folder();
    let (program, trace) = (program(folder.path(), SHORT), folder.path().join("a.torno"));
    let trace = trace.to_str().unwrap();
    let run = Watched::start(&["run", "lathe", &program, "--in-process", "--pace", "0.5", "--record", trace]);
    let page = run.page();
    let cut = json!({ "do": "fault", "fault": "line = \"depth_to_master\"\nkind = \"cut\"" });
    assert_eq!(page.ask(&cut)["ok"]["name"], "depth_to_master cut");
    page.ask(&json!({ "do": "pace", "pace": "max" }));
    let (summary, code) = run.end();
    assert_eq!((summary["outcome"].as_str(), code), (Some("faulted"), Some(1)), "{summary}");
    assert_eq!(summary["faults"][0]["name"], "depth_to_master cut", "{summary}");
    assert!(output(&["replay", trace]).status.success());
}

#[test]
#[expect(clippy::disallowed_methods, reason = "what is told of wall time is held against the wall clock")]
fn a_run_that_stands_still_can_be_interrupted() {
    let before = Instant::now();
    let run = Watched::start(&["run", "lathe", "--in-process"]);
    let page = run.page();
    let mut events = page.listen();
    page.ask(&json!({ "do": "pause" }));
    events.find("look", |look| look["state"]["ok"]["paused"] == true);
    kill("-INT", u64::from(run.child.id()));
    assert_eq!(events.find("end", |_| true), json!({ "outcome": "interrupted" }));
    let (summary, code) = run.end();
    assert_eq!((summary["outcome"].as_str(), code), (Some("interrupted"), Some(130)));
    // A second was waited for this browser, which does not ask for what it needs: that is no part of the run.
    let wall = summary["wall_s"].as_f64().unwrap();
    assert!(before.elapsed().as_secs_f64() > wall + 0.9, "{summary}");
}

#[test]
fn a_recording_is_played_as_it_was_and_cannot_be_broken() {
    let Some(mut browser) = Browser::start() else { return };
    let folder = folder();
    let (program, trace) = (program(folder.path(), SHORT), folder.path().join("a.torno"));
    let trace = trace.to_str().unwrap();
    assert!(output(&["run", "lathe", &program, "--in-process", "--record", trace]).status.success());
    let replay = Watched::start(&["replay", trace]);
    browser.show(replay.ready["page"].as_str().unwrap());
    let line = "[...document.querySelectorAll('.line')].find((line) => line.textContent === 'master to depth')";
    browser.wait_until(&format!("!!{line}?.getAttribute('aria-label')"));
    assert_eq!(browser.run("document.getElementById('program').hidden"), true);
    browser.run("document.getElementById('pause').click()");
    browser.wait_until("!document.getElementById('still').hidden");
    browser.run(&format!("{line}.dispatchEvent(new KeyboardEvent('keydown', {{ key: 'Enter' }}))"));
    browser.run("document.getElementById('break').click()");
    browser.wait_until("document.getElementById('alert').textContent.includes('a replay repeats what was recorded')");
    assert_eq!(browser.run(&format!("{line}.dataset.is")), "idle");
    browser.run("document.getElementById('pause').click()");
    browser.wait_until("document.getElementById('link').textContent === 'ended: the same'");
    assert_eq!(browser.run(FLAWS), json!([]));
    assert_eq!(browser.complaints, [""; 0]);
    let (result, code) = replay.end();
    assert_eq!((result["same"].as_bool(), code), (Some(true), Some(0)));
    assert!(result["wall_s"].as_f64() >= result["virtual_s"].as_f64(), "{result}");
}

const SCENARIO: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/scenarios/healthy-turn.toml");

#[test]
fn one_scenario_is_watched() {
    let test = Watched::start(&["test", SCENARIO, "--pace", "20"]);
    let page = test.page();
    let mut events = page.listen();
    let refused = page.ask(&json!({ "do": "power", "board": "depth", "on": false }));
    assert!(refusal(&refused).contains("a scenario says what is done"), "{refused}");
    page.ask(&json!({ "do": "pace", "pace": "max" }));
    assert_eq!(events.find("end", |_| true), json!({ "outcome": "passed" }));
    let (result, code) = test.end();
    assert_eq!((result["outcome"].as_str(), code), (Some("passed"), Some(0)));
    let several = output(&["test", SCENARIO, SCENARIO, "--page"]);
    let said = String::from_utf8(several.stderr).unwrap();
    assert!(said.contains("--page: expected one scenario, found 2"), "{said}");
    assert_eq!(several.status.code(), Some(2));
}

/// However time is cut, and whoever asks: the wall clock says where.
#[test]
fn a_scenario_that_is_watched_comes_to_the_same() {
    let paths = std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/scenarios")).unwrap();
    let paths = paths.map(|entry| entry.unwrap().path());
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let mut compared = 0;
    for path in paths.filter(|path| path.extension().is_some_and(|extension| extension == "toml")) {
        let scenario = Scenario::load(&path, None).unwrap();
        let driver = Driver::InProcess;
        let (alone, watched) = runtime.block_on(async {
            let alone = scenario::run(&scenario, &driver).await.unwrap();
            let control = Control::within();
            let asker = control.asker();
            let header = scenario.file.header(&scenario.rig, scenario.seed, None);
            let shown = Shown::new(control, &scenario.file, header, Role::Test, Pace::Times(2_000.0)).unwrap();
            let watching = async {
                let (rows, mut to_tell) = backlog(1 << 20, |lost| format!("{lost}\n"));
                let (lines, boards, kinds) = Default::default();
                asker.ask(Request::Watch { lines, boards, kinds, form: Form::Json }, &rows).await;
                while !asker.is_over() {
                    asker.ask(Request::State, &rows).await;
                    to_tell.try_next();
                }
            };
            let watched = scenario::show(&scenario, &driver, scenario::Keep::Nothing, Box::new(shown));
            let (watched, ()) = tokio::join!(watched, watching);
            (alone, watched.unwrap())
        });
        assert_eq!(watched.digest, alone.digest, "{}", path.display());
        assert_eq!(watched.verdict(), alone.verdict(), "{}", path.display());
        compared += 1;
    }
    assert!(compared > 50, "{compared}");
}

#[test]
fn the_rig_is_shown_as_it_was_while_it_goes_on_and_when_it_has_ended() {
    let Some(mut browser) = Browser::start() else { return };
    let run = Watched::start(&["run", "lathe", "--in-process", "--pace", "10"]);
    browser.show(run.ready["page"].as_str().unwrap());
    let time = "parseFloat(document.getElementById('time')?.textContent)";
    browser.wait_until(&format!("{time} > 20"));
    let kept = browser.run("document.getElementById('past-kept').textContent");
    assert!(kept.as_str().unwrap().contains(" MB of 64 MB, from 0."), "{kept}");
    let look_back = "(() => { const it = document.getElementById('past-at'); it.value = 12; \
                     it.dispatchEvent(new Event('input')); })()";
    // From 7 s to 16 s, the master has distributed three frames.
    let distributed = "[...document.querySelectorAll('#tables tr')].find((row) => row.firstChild.textContent === \
                       'frames distributed').children[1].textContent";
    browser.run(look_back);
    browser.wait_until("document.getElementById('past-time').textContent.startsWith('as it was at 1')");
    browser.wait_until(&format!("{distributed} === '3'"));
    let bar = "document.querySelector('path.bar').getAttribute('d')";
    let then = browser.run(bar);
    // What was cannot be broken.
    browser.run("document.querySelector('.line').dispatchEvent(new KeyboardEvent('keydown', { key: 'Enter' }))");
    let cannot_be_broken = "document.getElementById('break').disabled";
    assert_eq!(browser.run(cannot_be_broken), true);
    // Meanwhile the rig goes on.
    let now = browser.run(time).as_f64().unwrap();
    browser.wait_until(&format!("{time} > {}", now + 1.0));
    assert_eq!(browser.run(distributed), "3");
    browser.run("document.getElementById('past-live').click()");
    browser.wait_until(&format!("Number({distributed}) > 3"));
    assert_eq!(browser.run("document.getElementById('past-time').textContent"), "as it is");
    assert_eq!(browser.run(cannot_be_broken), false);
    let fast = "(() => { const it = document.getElementById('set-pace'); it.value = 'max'; \
                it.dispatchEvent(new Event('change')); })()";
    browser.run(fast);
    browser.wait_until("document.getElementById('link').textContent === 'ended: completed'");
    browser.wait_until(&format!("{distributed} === '30'"));
    assert_eq!(browser.run(cannot_be_broken), true);
    assert_ne!(browser.run(bar), then);
    let (summary, _) = run.end();
    assert_eq!(summary["digest"], DEMONSTRATION);
    // What has ended can still be looked at.
    browser.run(look_back);
    browser.wait_until(&format!("{distributed} === '3'"));
    assert_eq!(browser.run(FLAWS), json!([]));
    assert_eq!(browser.complaints, [""; 0]);
}
