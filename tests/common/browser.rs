//! Chromium without a window, steered by its own protocol over two pipes (Chrome DevTools Protocol).

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::{PATIENCE, is_installed};

const CHROMIUM: &str = "chromium";

/// What is wrong with how the page is laid out: texts below 11 px, and whatever makes it wider than its window.
pub(crate) const FLAWS: &str = r"(() => {
  const flaws = [];
  if (document.documentElement.scrollWidth > innerWidth) flaws.push(`${document.documentElement.scrollWidth} px wide`);
  if (/undefined|NaN|\[object/.test(document.body.innerText)) flaws.push(document.body.innerText);
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node; (node = walker.nextNode());) {
    const of = node.parentElement;
    if (!node.data.trim() || !of.checkVisibility()) continue;
    const drawn = of.ownerSVGElement;
    const scale = drawn ? drawn.getScreenCTM().a : 1;
    const px = parseFloat(getComputedStyle(of).fontSize) * scale;
    if (px < 11) flaws.push(`${px.toFixed(1)} px: ${node.data.trim()}`);
  }
  return flaws;
})()";

/// A browser with one page, until it is dropped.
pub(crate) struct Browser {
    child: Child,
    requests: File,
    answers: BufReader<File>,
    asked: u64,
    session: Option<String>,
    /// What its scripts have complained of.
    pub(crate) complaints: Vec<String>,
    _folder: tempfile::TempDir,
}

impl Browser {
    /// Starts it; None, where there is none, which is said.
    pub(crate) fn start() -> Option<Self> {
        if !is_installed(CHROMIUM, Command::new(CHROMIUM).arg("--version")) {
            return None;
        }
        let folder = super::folder();
        let [requests, answers] = ["requests", "answers"].map(|name| folder.path().join(name));
        let made = Command::new("mkfifo").args([&requests, &answers]).status().unwrap();
        assert!(made.success());
        // The protocol is on descriptors 3 and 4.
        let script = "exec \"$0\" \"$@\" 3<\"$REQUESTS\" 4>\"$ANSWERS\"";
        let mut command = Command::new("sh");
        command.args(["-c", script, CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run"]);
        command.args(["--disable-dev-shm-usage", "--remote-debugging-pipe", "about:blank"]);
        command.arg(format!("--user-data-dir={}", folder.path().join("profile").display()));
        command.env("REQUESTS", &requests).env("ANSWERS", &answers);
        let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let requests = OpenOptions::new().write(true).open(requests).unwrap();
        let answers = BufReader::new(File::open(answers).unwrap());
        let (complaints, session) = (Vec::new(), None);
        let mut browser = Self { child, requests, answers, asked: 0, session, complaints, _folder: folder };
        let target = browser.call("Target.createTarget", &json!({ "url": "about:blank" }))["targetId"].take();
        let attached = browser.call("Target.attachToTarget", &json!({ "targetId": target, "flatten": true }));
        browser.session = attached["sessionId"].as_str().map(str::to_owned);
        for domain in ["Page.enable", "Runtime.enable", "Log.enable"] {
            browser.call(domain, &json!({}));
        }
        Some(browser)
    }

    /// Asks for something of its protocol, and waits for the answer.
    pub(crate) fn call(&mut self, method: &str, parameters: &Value) -> Value {
        self.asked += 1;
        let mut request = json!({ "id": self.asked, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            request["sessionId"] = session.as_str().into();
        }
        self.requests.write_all(format!("{request}\0").as_bytes()).unwrap();
        loop {
            let mut answer = Vec::new();
            assert!(self.answers.read_until(0, &mut answer).unwrap() > 0, "the browser has ended");
            let mut answer: Value = serde_json::from_slice(&answer[..answer.len() - 1]).unwrap();
            if answer["id"] == self.asked {
                assert!(answer["error"].is_null(), "{method}: {answer}");
                return answer["result"].take();
            }
            // That a rig has ended is no fault of the page.
            let entry = &answer["params"]["entry"];
            let complains = answer["method"] == "Runtime.exceptionThrown"
                || (answer["method"] == "Log.entryAdded" && entry["level"] == "error" && entry["source"] != "network");
            if complains {
                self.complaints.push(answer["params"].to_string());
            }
        }
    }

    /// Shows an address.
    pub(crate) fn show(&mut self, url: &str) {
        self.call("Page.navigate", &json!({ "url": url }));
    }

    /// What a script gives.
    pub(crate) fn run(&mut self, script: &str) -> Value {
        let parameters = json!({ "expression": script, "awaitPromise": true, "returnByValue": true });
        let mut result = self.call("Runtime.evaluate", &parameters);
        assert!(result["exceptionDetails"].is_null(), "{script}: {}", result["exceptionDetails"]);
        result["result"]["value"].take()
    }

    /// Waits until a script gives true.
    pub(crate) fn wait_until(&mut self, script: &str) {
        let start = Instant::now();
        while self.run(script) != true {
            assert!(start.elapsed() < PATIENCE, "never came true: {script}\n{:?}", self.complaints);
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Gives its window a width, and the colours that its user prefers.
    pub(crate) fn resize(&mut self, width: u32, dark: bool) {
        let metrics = json!({ "width": width, "height": 900, "deviceScaleFactor": 1, "mobile": false });
        self.call("Emulation.setDeviceMetricsOverride", &metrics);
        let scheme = if dark { "dark" } else { "light" };
        let feature = json!({ "name": "prefers-color-scheme", "value": scheme });
        self.call("Emulation.setEmulatedMedia", &json!({ "features": [feature] }));
        self.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))");
    }

    /// Writes what it shows into the folder that this variable names, if any: for whoever wants to look at it.
    pub(crate) fn picture_into(&mut self, variable: &str, name: &str, width: u32, dark: bool) {
        let Some(folder) = std::env::var_os(variable) else { return };
        self.picture(&Path::new(&folder).join(format!("{name}-{width}{}.png", if dark { "-dark" } else { "" })));
        self.resize(width, dark);
    }

    /// Writes what it shows into a file (PNG), as long as the page is.
    fn picture(&mut self, path: &Path) {
        let width = self.run("innerWidth");
        let height = self.run("Math.min(document.documentElement.scrollHeight, 6000)");
        let metrics = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false });
        self.call("Emulation.setDeviceMetricsOverride", &metrics);
        self.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))");
        let picture = self.call("Page.captureScreenshot", &json!({ "format": "png" }));
        std::fs::write(path, base64(picture["data"].as_str().unwrap())).unwrap();
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
    }
}

/// The bytes of a text in Base64 (RFC 4648, 4).
fn base64(text: &str) -> Vec<u8> {
    const DIGITS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let digit = |byte: u8| DIGITS.iter().position(|digit| *digit == byte).unwrap() as u32;
    let digits: Vec<u32> = text.bytes().filter(|byte| *byte != b'=').map(digit).collect();
    let bytes = digits.chunks(4).flat_map(|four| {
        let bits = four.iter().fold(0, |bits, digit| bits << 6 | digit) << (6 * (4 - four.len()));
        bits.to_be_bytes()[1..four.len()].to_vec()
    });
    bytes.collect()
}
