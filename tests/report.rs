//! The report: a page that agrees with what is told otherwise, stands alone, and shows its plots in a browser.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::common::browser::{Browser, FLAWS};
use crate::common::{folder, is_installed, json, output};
use serde_json::Value;
use torno::report::page::Page;
use torno::rig::file::RigFile;
use torno_trace::Trace;

/// The charts of the lathe.
const CHARTS: [&str; 5] =
    ["chart-spindle-speed", "chart-transverse-position", "chart-depth-position", "chart-bus", "chart-close"];
/// What a report may be large, in bytes.
const LARGEST: usize = 2_000_000;

/// The report of `torno run` with these arguments, and what it told besides.
fn report(arguments: &[&str]) -> (String, Value) {
    let folder = folder();
    let path = folder.path().join("report.html");
    let output = output(&[&["run", "--json", "--report", path.to_str().unwrap()], arguments].concat());
    assert_eq!(String::from_utf8_lossy(&output.stderr), "");
    (fs::read_to_string(path).unwrap(), json(&output))
}

fn write(folder: &Path, name: &str, text: &str) -> String {
    let path = folder.join(name);
    fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

/// The chart of that name, up to the next one.
fn chart<'a>(html: &'a str, id: &str) -> &'a str {
    let rest = html.split(&format!("<svg class=\"chart\" id=\"{id}\"")).nth(1).unwrap_or_else(|| panic!("{id}"));
    rest.split("</figure>").next().unwrap()
}

/// What stands at a name.
fn figure<'a>(html: &'a str, id: &str) -> &'a str {
    let rest = html.split(&format!("id=\"figure-{id}\">")).nth(1).unwrap_or_else(|| panic!("{id}"));
    rest.split('<').next().unwrap()
}

/// The cells of the row that begins with this, in a table.
fn row<'a>(html: &'a str, table: &str, first: &str) -> Vec<&'a str> {
    let table = html.split(&format!("<table id=\"{table}\">")).nth(1).unwrap().split("</table>").next().unwrap();
    let row = table.split(&format!("<tr><th>{first}</th>")).nth(1).unwrap().split("</tr>").next().unwrap();
    row.split("<td").skip(1).map(|cell| cell.split(['>', '<']).nth(1).unwrap()).collect()
}

#[test]
fn the_demonstrations_report_is_small_and_says_what_the_run_says() {
    let (html, told) = report(&[]);
    assert!(html.len() < LARGEST, "{} bytes", html.len());
    let plain = json(&output(&["run", "--json"]));
    for name in ["digest", "frames", "part", "virtual_s"] {
        assert_eq!(told[name], plain[name], "{name}");
    }
    for name in ["total", "sent", "accepted", "held", "rejected"] {
        assert_eq!(figure(&html, name), told["frames"][name].to_string(), "{name}");
    }
    for (id, name) in [("digest", "digest"), ("outcome", "outcome"), ("rig", "rig"), ("program", "program")] {
        assert_eq!(figure(&html, id), told[name].as_str().unwrap());
    }
    assert_eq!(figure(&html, "virtual"), format!("{:.6} s", told["virtual_s"].as_f64().unwrap()));
    let turned = told["part"]["cylinders"].as_array().unwrap().iter().filter(|of| of["stock"] == false);
    let size =
        |of: &Value| format!("{:.2} × {:.2}", of["diameter_mm"].as_f64().unwrap(), of["length_mm"].as_f64().unwrap());
    assert_eq!(figure(&html, "turned"), turned.map(size).collect::<Vec<_>>().join(", ") + " mm");
    // 30 frames of 8 characters; each is distributed to three slaves.
    assert_eq!(row(&html, "lines", "pc → master")[0], "240");
    assert_eq!(row(&html, "lines", "pc → master")[2], "30 × frame");
    for slave in ["spindle", "transverse", "depth"] {
        assert!(row(&html, "lines", &format!("master → {slave}"))[2].contains("30 × sub-frame"), "{slave}");
    }
}

#[test]
fn what_is_plotted_is_what_the_trace_tells() {
    let folder = folder();
    let [trace, html] = ["a.trace", "a.html"].map(|name| folder.path().join(name).to_str().unwrap().to_owned());
    assert!(output(&["run", "--in-process", "--record", &trace]).status.success());
    let recorded = output(&["trace", &trace, "--report", &html]);
    assert!(recorded.status.success() && recorded.stdout.is_empty());
    let html = fs::read_to_string(html).unwrap();
    // The same charts and the same part as the run itself reports.
    let (run, _) = report(&[]);
    for id in CHARTS {
        assert!(chart(&html, id) == chart(&run, id), "{id}");
    }
    let part = |html: &str| html.split("<figure class=\"drawing\">").nth(1).map(|rest| rest[..20_000].to_owned());
    assert!(part(&html).is_some() && part(&html) == part(&run));
    // Following errors, reckoned again from the exported telemetry.
    let csv = String::from_utf8(output(&["trace", &trace, "--csv", "--board", "transverse"]).stdout).unwrap();
    let (mut asked, mut got, mut worst, mut at) = (0_i64, 0_i64, 0_i64, "");
    for line in csv.lines().skip(1) {
        let [time, _, quantity, value] = line.split(',').collect::<Vec<_>>()[..] else { panic!("{line}") };
        if time != at {
            worst = if (asked - got).abs() > worst.abs() { asked - got } else { worst };
        }
        at = time;
        match quantity {
            "set_point_counts" => asked = value.parse().unwrap(),
            "position_counts" => got = value.parse().unwrap(),
            _ => {}
        }
    }
    // A count is 2 mm in 900.
    assert_eq!(row(&html, "motors", "transverse")[3], format!("{:.3} mm", worst as f64 / 450.0));
    assert!(html.contains(&format!(" mm<br><small>{worst} counts</small></td>")));
}

#[test]
fn a_report_is_in_units_for_people_and_names_what_was_done_to_the_rig() {
    let (html, _) = report(&["--in-process"]);
    // Full drive is 30 V of 1023 LSB, and 255 LSB.
    let [spindle, transverse, depth] = ["spindle", "transverse", "depth"].map(|board| row(&html, "motors", board));
    assert_eq!((spindle[2], spindle[6], transverse[6]), ("2005 rpm", "30.00 V", "100 %"), "{spindle:?} {transverse:?}");
    // It stands where it was to stand.
    assert_eq!((depth[2], depth[3], depth[4]), ("0.000 mm", "1.244 mm", "0.000 mm"), "{depth:?}");
    assert!(html.contains("<h3>transverse <small>1 mm is 450 counts</small></h3>"));
    let (html, _) = report(&["engraver"]);
    assert_eq!(row(&html, "motors", "engraver x")[1..3], ["-34.000 mm", "33.999 mm"]);
    assert!(row(&html, "motors", "engraver a")[2].ends_with(" deg"));
    assert!(!html.contains("nm</text>") && !html.contains("udeg</text>"));
    assert!(row(&html, "lines", "pc → engraver")[2].ends_with(" others"));
    let folder = folder();
    let faults = "[[fault]]\nline = \"master_to_depth\"\nkind = \"cut\"\nat = \"3 s\"\nfor = \"1 s\"\n\
                  [[fault]]\nname = \"chip\"\nboard = \"depth\"\nkind = \"stall\"\nat = \"8 s\"\nfor = \"1 s\"\n";
    let faults = write(folder.path(), "faults.toml", faults);
    let [path, trace] = ["report.html", "a.torno"].map(|name| folder.path().join(name));
    let [path, trace] = [&path, &trace].map(|path| path.to_str().unwrap());
    let run = output(&["run", "--in-process", "--faults", &faults, "--report", path, "--record", trace]);
    let named = "master_to_depth cut at 3.000 s, chip at 8.000 s";
    assert!(String::from_utf8(run.stdout).unwrap().contains(&format!("\nfaults   {named}\n")));
    assert_eq!(figure(&fs::read_to_string(path).unwrap(), "faults"), named);
    // A recording has no names.
    assert!(output(&["trace", trace, "--report", path]).status.success());
    let html = fs::read_to_string(path).unwrap();
    assert!(figure(&html, "inputs").contains("depth: shaft blocked at 8.000 s"), "{}", figure(&html, "inputs"));
}

#[test]
fn a_servo_run_is_reported_with_its_gains_and_its_error() {
    let folder = folder();
    let program = write(folder.path(), "ramps", "p0 k10 x5\nx30 t3\np10 k0 x5\nx0 t0.5\ne\n");
    let path = folder.path().join("a.html");
    let run = ["servo", "run", &program, "--kx", "20", "--kv", "0", "--json", "--report", path.to_str().unwrap()];
    let told = json(&output(&run));
    let html = fs::read_to_string(path).unwrap();
    assert_eq!(figure(&html, "gains"), "Kx 20, Kv 0");
    let greatest = told["greatest_error_counts"].as_i64().unwrap();
    assert_eq!(figure(&html, "greatest-error"), format!("{:.3} mm, {greatest} counts", greatest as f64 / 125.0));
    let drive = row(&html, "motors", "servo").pop().unwrap();
    let percent: i64 = drive.strip_suffix(" %").unwrap().parse().unwrap();
    assert!((50..=100).contains(&percent), "{drive}");
    // Kinds of messages, not their numbers, and not the first word of a phrase.
    let said = row(&html, "lines", "servo → pc").pop().unwrap();
    assert_eq!(said, "2 × the controller is there, 1 × Kx is, 1 × Kv is, 1100 × following error");
    assert!(row(&html, "lines", "pc → servo").pop().unwrap().contains("1 × run"));
}

#[test]
fn any_rig_has_a_report_and_names_do_not_break_it() {
    let folder = folder();
    let text = include_str!("../harness/builtin/lathe.toml");
    let bare = text.split("# What is turned.").next().unwrap();
    let rig = write(folder.path(), "bare.toml", bare);
    let program = write(folder.path(), "a<b&\"c\".frames", "4B 00 00 00 00 00 05 01\n");
    let (html, _) = report(&["--in-process", &rig, &program]);
    assert!(!html.contains("id=\"part\"") && !html.contains("a<b"), "{}", &html[..600]);
    assert!(figure(&html, "program").ends_with("a&lt;b&amp;&quot;c&quot;.frames"));
    assert!(
        CHARTS.iter().all(|id| chart(&html, id).contains("<polyline") || id.ends_with("bus") || id.ends_with("close"))
    );
    // Nothing has happened, and no one has written down how it ended.
    let trace = Trace::new(RigFile::load("lathe").unwrap().header("lathe", 0, None));
    let html = Page { trace: &trace, title: "a recording", summary: None, cut: None, faults: &[], facts: &[] }.html();
    assert!(html.contains("not ended") && html.contains("a recording") && !html.contains("NaN"));
}

#[test]
fn faults_and_failures_are_shown() {
    let folder = folder();
    let rig = include_str!("../harness/builtin/lathe.toml").replace("name = \"depth\"\nkind = \"depth\"", "");
    let rig: String =
        rig.replace("[[board]]\n\n", "").replace("[[link]]\nends = [\"master.depth\", \"depth.master\"]", "");
    let rig = write(folder.path(), "short.toml", rig.split("# What is turned.").next().unwrap());
    let path = folder.path().join("report.html");
    let output = output(&["run", "--in-process", &rig, "--report", path.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1), "{}", String::from_utf8_lossy(&output.stderr));
    let html = fs::read_to_string(path).unwrap();
    assert!(html.contains("<li>depth failed: no answer</li>"));
    assert!(chart(&html, "chart-bus").contains("class=\"flaw\""));
    assert!(html.contains("<dd class=\"bad\">"));
}

#[test]
fn a_report_that_cannot_be_written_costs_no_run() {
    let output = output(&["run", "--report", "/nowhere/report.html"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(output.stdout.is_empty());
    assert!(String::from_utf8_lossy(&output.stderr).starts_with("torno: cannot write '/nowhere/report.html'"));
}

// --- in a browser ---------------------------------------------------------------------------------------------------

/// Tells of scripts that fail.
const WATCH: &str = "<head>\n<script>\
    const note = (e) => document.documentElement.dataset.error = e.message || e.violatedDirective;\
    addEventListener(\"error\", note, true); addEventListener(\"securitypolicyviolation\", note);</script>";
/// Drags across a chart, and writes down how large the lines have come out.
const DRAG: &str = "<script>{
  const chart = document.getElementById(\"chart-spindle-speed\"), box = chart.getBoundingClientRect();
  const send = (to, type, share) => to.dispatchEvent(new PointerEvent(type,
    { clientX: box.left + share * box.width, clientY: box.top + 9, bubbles: true, pointerType: \"mouse\" }));
  const found = [...document.querySelectorAll(\"svg.chart .data polyline\")];
  const lines = found.map((line) => line.getBoundingClientRect());
  document.documentElement.dataset.visible = lines.filter((line) => line.width > 300 && line.height > 0).length;
  document.documentElement.dataset.lines = lines.length;
  send(chart, \"pointerdown\", 0.4); send(window, \"pointermove\", 0.5); send(window, \"pointerup\", 0.5);
}</script></body>";

/// The page as Chromium has it when its scripts have run.
fn opened(html: &str) -> Option<String> {
    if !is_installed("chromium", Command::new("chromium").arg("--version")) {
        return None;
    }
    let folder = folder();
    let page = write(folder.path(), "page.html", html);
    let profile = format!("--user-data-dir={}", folder.path().join("profile").display());
    let output = Command::new("chromium")
        .args(["--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1200,900", &profile, "--dump-dom"])
        .arg(format!("file://{page}"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8(output.stdout).unwrap())
}

fn data(dom: &str, name: &str) -> Option<String> {
    let begin = format!("data-{name}=\"");
    dom.split('>').nth(1)?.split(&begin).nth(1)?.split('"').next().map(str::to_owned)
}

#[test]
fn a_browser_shows_the_plots_and_looks_closer() {
    let (html, _) = report(&["--in-process"]);
    let html = html.replacen("<head>", WATCH, 1).replacen("</body>", DRAG, 1);
    let Some(dom) = opened(&html) else { return };
    assert_eq!(data(&dom, "error"), None);
    // Three motors with two lines of their own and two below, and the speed of the feed. What stands still is flat,
    // but long.
    assert_eq!(data(&dom, "lines").as_deref(), Some("13"));
    assert_eq!(data(&dom, "visible").as_deref(), Some("13"));
    for id in CHARTS {
        let chart = chart(&dom, id);
        let long = |line: &str| line.split('"').next().is_some_and(|points| points.len() > 100);
        assert!(id.ends_with("close") || id.ends_with("bus") || chart.split("points=\"").skip(1).any(long), "{id}");
        assert!(chart.contains("<title>") || chart.contains("<polyline"), "{id}");
    }
    // From 400 px of 1000, of which the axis begins at 176: 27.7 % of 124.50 s.
    assert!(dom.contains("shown: 34.4") && dom.contains("svg class=\"sheet\""), "{}", dom.len());
    assert!(!chart(&dom, "chart-bus").contains("viewBox=\"0 0 20000 2000\""));
    assert!(chart(&html, "chart-bus").contains("viewBox=\"0 0 20000 2000\""));
}

/// Words that are broken, but for those that no line has room for.
const BROKEN: &str = r"(() => {
  const broken = [], range = document.createRange();
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node; (node = walker.nextNode());) {
    const of = node.parentElement;
    if (of.closest('svg, script, #figure-digest, #figure-program') || !of.checkVisibility()) continue;
    for (const word of node.data.matchAll(/[^\s–-]+/g)) {
      range.setStart(node, word.index);
      range.setEnd(node, word.index + word[0].length);
      const lines = new Set([...range.getClientRects()].map((box) => Math.round(box.top)));
      if (lines.size > 1) broken.push(word[0]);
    }
  }
  return broken;
})()";

#[test]
fn a_report_has_room_at_every_width() {
    let Some(mut browser) = Browser::start() else { return };
    let folder = folder();
    for rig in ["lathe", "lathe-grbl", "engraver"] {
        let path = folder.path().join(format!("{rig}.html"));
        assert!(output(&["run", rig, "--in-process", "--report", path.to_str().unwrap()]).status.success());
        browser.show(&format!("file://{}", path.display()));
        browser.wait_until("!!document.querySelector('#zoom span')?.textContent");
        for (width, dark, scrolls) in [(1440, false, false), (1000, true, true), (400, false, true), (400, true, true)]
        {
            browser.resize(width, dark);
            assert_eq!(browser.run(FLAWS), serde_json::json!([]), "{rig} at {width} px");
            assert_eq!(browser.run(BROKEN), serde_json::json!([]), "{rig} at {width} px");
            // What scrolls says so, and nothing else does.
            let says = "[...document.querySelectorAll('figure')].map((figure) => [figure.scrollWidth > \
                        figure.clientWidth, getComputedStyle(figure, '::before').display !== 'none'])";
            let said = browser.run(says);
            let all = said.as_array().unwrap().iter().all(|said| *said == serde_json::json!([scrolls, scrolls]));
            assert!(all, "{rig} at {width} px: {said}");
            browser.picture_into("REPORT_PICTURES", rig, width, dark);
        }
    }
    assert_eq!(browser.complaints, [""; 0]);
}

#[test]
fn the_page_asks_for_nothing_from_elsewhere() {
    let (html, _) = report(&["--in-process"]);
    assert!(html.contains("default-src 'none'"));
    let names = html.replace("http://www.w3.org/2000/svg", "");
    for word in ["http:", "https:", "src=\"", "href", "@import", "url(http", "fetch(", "XMLHttpRequest"] {
        assert!(!names.contains(word), "{word}");
    }
}
