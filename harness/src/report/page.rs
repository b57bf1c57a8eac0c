//! The report as one page (HTML) that needs nothing else: it is looked at, printed, sent to somebody.

use std::fmt::{self, Display, Write};

use torno_plot::{Chart, ChartRow, Series, Style, escaped};

use super::part::sizes;
use super::series::{Course, Courses, Motion, decimated, lasting};
use super::timeline::{Bus, BusMessage, PC_HELD};
use super::{Cut, FaultSummary, Shares, Stats, Summary};
use crate::physical::Physical;
use crate::session::INTERRUPTED;
use crate::speed::with_speeds;
use torno_trace::Trace;

const STYLE: &str = include_str!("page/style.css");
const SCRIPT: &str = include_str!("page/zoom.js");
/// Columns that a line is drawn in: two for each px of a chart, for whoever looks closer.
const COLUMNS: u64 = 2 * ChartRow::ALONG as u64;
/// So much of what was done to the rig is in the summary.
const NAMED: usize = 20;
/// So many kinds of messages of a line are told apart in the figures.
const KINDS: usize = 8;
/// So many rows of what was said are listed.
const LISTED: usize = 2_000;

/// What the report is of.
#[derive(Clone, Copy)]
pub struct Page<'a> {
    /// What happened.
    pub trace: &'a Trace,
    /// What it is called where no program has given it its name.
    pub title: &'a str,
    /// What is told at the end of a run; None of a recording.
    pub summary: Option<&'a Summary>,
    /// The part, if one was turned.
    pub cut: Option<&'a Cut>,
    /// The faults that have begun, by their names, which no recording has.
    pub faults: &'a [FaultSummary],
    /// What else there is to say of it: names and values.
    pub facts: &'a [(&'static str, String)],
}

impl Page<'_> {
    /// The page.
    pub fn html(&self) -> String {
        Page { trace: &with_speeds(self.trace), ..*self }.draw()
    }

    fn draw(&self) -> String {
        let courses = Courses::new(self.trace);
        let motions = courses.motions(self.trace);
        let bus = Bus::new(self.trace, &courses);
        let charts: Vec<String> = motions.iter().map(|motion| self.chart(motion).svg()).collect();
        let mut html = String::new();
        // Writing to a string cannot fail.
        let _ = self.write(&mut html, &motions, &charts, &bus);
        html
    }

    fn until(&self) -> f64 {
        self.trace.end.as_ref().map_or(self.trace.settled, |end| end.at).as_secs_f64()
    }

    fn program(&self) -> &str {
        self.trace.header.program.as_deref().unwrap_or(self.title)
    }

    fn write(&self, html: &mut String, motions: &[Motion], charts: &[String], bus: &Bus<'_>) -> fmt::Result {
        let (program, rig) = (escaped(self.program()), escaped(self.rig()));
        write!(
            html,
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; \
             script-src 'unsafe-inline'\">\n\
             <title>{program} on {rig}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n\
             <header>\n<h1>{program} <small>on {rig}</small></h1>\n"
        )?;
        self.write_cards(html, bus)?;
        self.write_problems(html)?;
        html.write_str("</header>\n")?;
        if let Some(cut) = self.cut {
            html.write_str("<section id=\"part\">\n<h2>The part</h2>\n<figure class=\"drawing\">\n")?;
            html.write_str(&cut.draw(self.rig(), self.program()))?;
            html.write_str("</figure>\n</section>\n")?;
        }
        html.write_str("<div class=\"zoomable\">\n<section id=\"motion\">\n<h2>Motion</h2>\n")?;
        html.write_str(
            "<p>As the boards' firmware has it. A following error is the set point less what came of it; after \
             settling, what is left of that at the end of each stay of the set point of half a second or more.</p>\n",
        )?;
        html.write_str("</section>\n")?;
        for (motion, chart) in motions.iter().zip(charts) {
            let count = motion.physical.filter(|physical| physical.is_counted);
            let count = count.map_or_else(String::new, |Physical { unit, worth, .. }| {
                format!(" <small>1 {unit} is {} counts</small>", (1e3 / worth).round() / 1e3)
            });
            write!(html, "<figure>\n<h3>{}{count}</h3>\n{chart}</figure>\n", escaped(&motion.name))?;
        }
        Self::write_bus(html, bus)?;
        html.write_str("</div>\n")?;
        Self::write_close_up(html, bus)?;
        Self::write_said(html, bus)?;
        html.write_str("<section id=\"figures\">\n<h2>Figures</h2>\n<div class=\"tables\">\n")?;
        self.write_summary(html, bus)?;
        self.write_motions(html, motions)?;
        self.write_lines(html, bus)?;
        self.write_boards(html)?;
        if let Some(stats) = self.summary.and_then(|summary| summary.stats.as_ref()) {
            write_stats(html, stats)?;
        }
        write!(
            html,
            "</div>\n</section>\n<footer>torno {}. Virtual time throughout, from the start of the rig.</footer>\n\
             </main>\n<script>\n{SCRIPT}</script>\n</body>\n</html>\n",
            escaped(&self.trace.header.torno)
        )
    }

    fn rig(&self) -> &str {
        self.summary.and_then(|summary| summary.rig.as_deref()).unwrap_or(&self.trace.header.rig)
    }

    /// One strip below the other: how it went, the error, the drive.
    fn chart(&self, motion: &Motion) -> Chart {
        let range = (0.0, self.until());
        let series = |(name, course): (&str, &Course), worth: f64| {
            let points = decimated(course, self.trace.until(), COLUMNS);
            Series::new(name, Style::Steps, points.into_iter().map(|(at, value)| (at, value * worth)).collect())
        };
        let mut rows = Vec::new();
        // The first of several courses is what the row is about.
        let mut add =
            |label: &str, unit: &str, physical: Option<Physical>, height: u32, courses: &[(&'static str, &Course)]| {
                let gap = if rows.is_empty() { 0 } else { 16 };
                let (unit, worth) = physical.map_or((unit, 1.0), |physical| (physical.unit, physical.worth));
                let keys = courses.iter().map(|(name, _)| *name).filter(|_| courses.len() > 1).collect();
                let series: Vec<Series> = courses.iter().map(|course| series(*course, worth)).collect();
                let (label, unit) = (label.to_owned(), unit.to_owned());
                rows.push(ChartRow { label, unit, keys, gap, ..ChartRow::of_series(&series, range, height, worth) });
            };
        let (unit, physical) = (&motion.unit, motion.physical);
        let mut courses = vec![(motion.what, &motion.got)];
        courses.extend(motion.asked.as_ref().map(|asked| ("set point", asked)));
        add(motion.what, unit, physical, 170, &courses);
        if let Some(error) = &motion.error {
            add("following error", unit, physical, 92, &[("error", error)]);
        }
        if let Some((unit, physical, speed)) = &motion.speed {
            add("speed", unit, *physical, 92, &[("speed", speed)]);
        }
        if let Some((physical, drive)) = &motion.drive {
            add("drive", "LSB", *physical, 92, &[("drive", drive)]);
        }
        if let Some(offset) = &motion.offset {
            add("carriage offset", unit, physical, 72, &[("offset", offset)]);
        }
        let id = format!("chart-{}-{}", slug(&motion.name), motion.what);
        Chart { id, title: format!("{}: {}", motion.name, motion.what), range, unit: "s", rows }
    }

    fn write_cards(&self, html: &mut String, bus: &Bus<'_>) -> fmt::Result {
        html.write_str("<dl class=\"cards\">\n")?;
        let mut card = |name: &str, class: &str, value: &str, more: &str| {
            let more = if more.is_empty() { String::new() } else { format!("<span>{}</span>", escaped(more)) };
            writeln!(html, "<div><dt>{name}</dt><dd class=\"{class}\">{}</dd>{more}</div>", escaped(value))
        };
        let outcome = self.trace.end.as_ref().map_or("not ended", |end| end.outcome.as_str());
        let class = match outcome {
            "completed" | "passed" => "good",
            "rejected" | "faulted" | "unanswered" | "failed" | INTERRUPTED => "bad",
            _ => "",
        };
        card("outcome", class, outcome, "")?;
        let speedup = self.summary.and_then(|summary| summary.speedup);
        let speedup = speedup.map_or_else(String::new, |speedup| format!("virtual, {speedup:.0} × real time"));
        card("time", "", &format!("{:.3} s", self.until()), &speedup)?;
        if let Some(Summary { frames: Some(frames), .. }) = self.summary {
            let more = format!("accepted of {}; {} held for a while", frames.total, frames.held);
            card("frames", "", &frames.accepted.to_string(), &more)?;
        }
        if let Some(Summary { lines: Some(lines), .. }) = self.summary {
            card("lines", "", &lines.accepted.to_string(), &format!("accepted of {}", lines.total))?;
        }
        if let Some(held) = bus.states.iter().find(|state| state.name == PC_HELD && !state.spans.is_empty()) {
            let (seconds, times) = (held.seconds(), held.spans.len());
            let times = format!("{seconds:.1} s in all, {times} times");
            card("the PC was held", "", &percent(seconds, self.until()), &times)?;
        }
        for (name, value) in self.facts {
            card(name, "", value, "")?;
        }
        if let Some((cut, worst)) = self.cut.and_then(|cut| Some((cut, cut.summary.worst?))) {
            let value =
                if worst.diameter_mm == 0.0 { "none".to_owned() } else { format!("{:+.2} mm", worst.diameter_mm) };
            let at = if worst.diameter_mm == 0.0 {
                "the part is as asked".to_owned()
            } else {
                format!("of diameter, at z = {:.2} mm", worst.z_mm)
            };
            let class = match cut.summary.required {
                _ if cut.summary.is_off() => "bad",
                Some(_) => "good",
                None => "",
            };
            let verdict = Some(cut.summary.verdict()).filter(|verdict| !verdict.is_empty());
            let more = verdict.map_or_else(|| at.clone(), |verdict| format!("{at}; {verdict}"));
            card("worst deviation", class, &value, &more)?;
        }
        html.write_str("</dl>\n")
    }

    /// What went wrong, before anything else.
    fn write_problems(&self, html: &mut String) -> fmt::Result {
        let mut problems: Vec<String> = Vec::new();
        if let Some(summary) = self.summary {
            problems.extend(summary.incidents.iter().chain(&summary.failures).cloned());
            let what = if summary.lines.is_some() { "line" } else { "frame" };
            problems.extend(summary.refusals().iter().map(|refusal| format!("a {what} was refused: {refusal}")));
        }
        if let Some(summary) = self.cut.map(|cut| &cut.summary).filter(|summary| !summary.is_as_required()) {
            let worst = summary.worst.map_or_else(String::new, |worst| format!(": {worst}"));
            problems.push(format!("the part is {}{worst}", summary.verdict()));
        }
        for event in self.cut.map_or(&[][..], |cut| &cut.summary.events) {
            let super::EventSummary { from_s, z_mm, worst, text, unit, .. } = event;
            problems.push(format!("{text} at {from_s:.3} s, z = {z_mm:.2} mm: {worst:.2} {unit}"));
        }
        if problems.is_empty() {
            return Ok(());
        }
        let items: String = problems.iter().map(|problem| format!("<li>{}</li>", escaped(problem))).collect();
        writeln!(html, "<ul class=\"problems\">{items}</ul>")
    }

    fn write_bus(html: &mut String, bus: &Bus<'_>) -> fmt::Result {
        if bus.lines.is_empty() {
            return Ok(());
        }
        write!(
            html,
            "<section id=\"bus\">\n<h2>The bus</h2>\n<p>Who sent what when. Each mark tells what was said when the \
             pointer rests on it.</p>\n</section>\n<figure>\n<div class=\"legend\">\
             <span><i></i>a frame, or a part of one</span><span><i class=\"control\"></i>a reply, an enquiry</span>\
             <span><i class=\"flaw\"></i>something wrong</span><span><i class=\"on\"></i>held, or busy</span></div>\n{}\
             </figure>\n",
            bus.chart().svg()
        )
    }

    fn write_close_up(html: &mut String, bus: &Bus<'_>) -> fmt::Result {
        let Some(chart) = bus.close_up() else { return Ok(()) };
        write!(html, "<figure>\n<h3>The first that was said, close up</h3>\n{}</figure>\n", chart.svg())
    }

    fn write_said(html: &mut String, bus: &Bus<'_>) -> fmt::Result {
        let mut said: Vec<&BusMessage> = bus.lines.iter().flat_map(|line| bus.said(*line)).collect();
        said.sort_by_key(|said| said.at);
        if said.is_empty() {
            return Ok(());
        }
        let shown = if said.len() > LISTED { format!(", of which the first {LISTED}") } else { String::new() };
        write!(
            html,
            "<details id=\"said\"><summary>All that was said ({}{shown})</summary>\n<table>\n<thead><tr>\
             <th class=\"n\">time, s</th><th>line</th><th>what</th></tr></thead>\n<tbody>\n",
            said.len()
        )?;
        let names: Vec<(usize, String)> = bus.lines.iter().map(|line| (*line, escaped(&bus.name(*line)))).collect();
        for said in said.iter().take(LISTED) {
            let name = names.iter().find(|(line, _)| *line == said.line).map_or("", |(_, name)| name);
            let class = if said.flaw { " class=bad" } else { "" };
            let (at, text) = (said.at.as_secs_f64(), escaped(&said.text));
            writeln!(html, "<tr><td class=n>{at:.6}<td>{name}<td{class}>{text}")?;
        }
        html.write_str("</tbody></table></details>\n")
    }

    fn write_summary(&self, html: &mut String, bus: &Bus<'_>) -> fmt::Result {
        html.write_str("<div><h3>Summary</h3><table id=\"summary\"><tbody>\n")?;
        let header = &self.trace.header;
        let mut row = |id: &str, name: &str, value: &dyn Display| {
            let value = escaped(&value.to_string());
            writeln!(html, "<tr><th>{name}</th><td id=\"figure-{id}\">{value}</td></tr>")
        };
        row("program", "program", &self.program())?;
        row("rig", "rig", &self.rig())?;
        if let Some(Summary { frames, lines, wall_s, .. }) = self.summary {
            if let Some(frames) = frames {
                row("total", "frames", &frames.total)?;
                row("sent", "sent", &frames.sent)?;
                row("accepted", "accepted", &frames.accepted)?;
                row("held", "held for a while", &frames.held)?;
                row("rejected", "rejected", &frames.rejected)?;
            }
            if let Some(lines) = lines {
                row("total", "lines", &lines.total)?;
                row("sent", "sent", &lines.sent)?;
                row("accepted", "accepted", &lines.accepted)?;
                row("rejected", "rejected", &lines.rejected)?;
            }
            row("wall", "wall time", &format_args!("{wall_s:.3} s"))?;
        }
        for (name, value) in self.facts {
            row(&slug(name), name, value)?;
        }
        row("virtual", "virtual time", &format_args!("{:.6} s", self.until()))?;
        if let Some(cut) = self.cut {
            row("turned", "turned, diameter × length", &sizes(&cut.summary.cylinders, "×"))?;
            if let Some(asked) = &cut.summary.asked {
                row("asked", "asked for", &sizes(asked, "×"))?;
            }
            if cut.summary.required.is_some() {
                row("tolerance", "worst deviation", &cut.summary.verdict())?;
            }
        }
        if let Some(faults) = FaultSummary::text(self.faults) {
            row("faults", "faults", &faults)?;
        } else if !bus.inputs.is_empty() {
            let named = bus.inputs.iter().take(NAMED).map(|(at, what)| format!("{what} at {:.3} s", at.as_secs_f64()));
            let more = bus.inputs.len().checked_sub(NAMED + 1).map(|more| format!("and {} more", more + 1));
            row("inputs", "done to the rig", &named.chain(more).collect::<Vec<_>>().join("; "))?;
        }
        row("seed", "seed", &header.seed)?;
        if let Some(end) = &self.trace.end {
            row("digest", "digest of everything", &end.digest)?;
            row("outcome", "outcome", &end.outcome)?;
        }
        html.write_str("</tbody></table></div>\n")
    }

    fn write_motions(&self, html: &mut String, motions: &[Motion]) -> fmt::Result {
        if motions.is_empty() {
            return Ok(());
        }
        html.write_str(
            "<div><h3>Motors</h3><table id=\"motors\"><thead><tr><th>motor</th><th>of it</th><th class=\"n\">least</th>\
             <th class=\"n\">greatest</th><th class=\"n\">worst following error</th>\
             <th class=\"n\">after settling</th><th class=\"n\">rms</th><th class=\"n\">fullest drive</th></tr>\
             </thead><tbody>\n",
        )?;
        for motion in motions {
            let values = || motion.got.iter().map(|(_, value)| *value);
            let worst =
                |course: &Course| course.iter().map(|(_, value)| *value).max_by_key(|value| value.unsigned_abs());
            let value = |value: i64| in_unit(value as f64, 0, &motion.unit, motion.physical);
            let error = motion.error.as_ref();
            let drive = motion.drive.as_ref().and_then(|(physical, drive)| Some((physical, worst(drive)?)));
            let cells = [
                values().min().map(value),
                values().max().map(value),
                error.and_then(worst).map(value),
                motion.settled.map(value),
                error.map(|error| in_unit(self.rms(error), 1, &motion.unit, motion.physical)),
                drive.map(|(physical, drive)| in_unit(drive as f64, 0, "LSB", *physical)),
            ];
            write!(html, "<tr><th>{}</th><td>{}</td>", escaped(&motion.name), motion.what)?;
            for cell in cells {
                write!(html, "<td class=\"n\">{}</td>", cell.as_deref().unwrap_or("–"))?;
            }
            html.write_str("</tr>\n")?;
        }
        html.write_str("</tbody></table></div>\n")
    }

    /// Over the whole time.
    fn rms(&self, course: &Course) -> f64 {
        let sum = lasting(course, self.trace.until()).map(|(seconds, value)| seconds * value as f64 * value as f64);
        if self.until() > 0.0 { (sum.sum::<f64>() / self.until()).sqrt() } else { 0.0 }
    }

    fn write_lines(&self, html: &mut String, bus: &Bus<'_>) -> fmt::Result {
        html.write_str(
            "<div><h3>Lines</h3><table id=\"lines\"><thead><tr><th>line</th><th class=\"n\">characters</th>\
             <th class=\"n\">in use</th><th>said</th></tr></thead><tbody>\n",
        )?;
        for line in &bus.lines {
            let count = bus.characters.iter().filter(|said| said.line == *line).count();
            let used = percent(count as f64 * bus.character_s(*line), self.until());
            let mut words: Vec<(&str, usize)> = Vec::new();
            for said in bus.messages.iter().filter(|said| said.line == *line) {
                match words.iter_mut().find(|(word, _)| *word == said.kind()) {
                    Some((_, count)) => *count += 1,
                    None => words.push((said.kind(), 1)),
                }
            }
            // Where each message is another, those that come most often are enough.
            let kinds = words.len();
            if kinds > KINDS {
                words.sort_by_key(|(_, count)| core::cmp::Reverse(*count));
            }
            let rest: usize = words.iter().skip(KINDS).map(|(_, count)| count).sum();
            let shown = words.iter().take(KINDS).map(|(word, count)| format!("{count} × {}", escaped(word)));
            let words: Vec<String> = shown.chain((rest > 0).then(|| format!("{rest} others"))).collect();
            let (name, words) = (escaped(&bus.name(*line)), words.join(", "));
            writeln!(
                html,
                "<tr><th>{name}</th><td class=\"n\">{count}</td><td class=\"n\">{used}</td><td>{words}</td></tr>"
            )?;
        }
        for state in &bus.states {
            let (name, times) = (escaped(&state.name), state.spans.len());
            let (share, seconds) = (percent(state.seconds(), self.until()), state.seconds());
            writeln!(
                html,
                "<tr><th>{name}</th><td class=\"n\"></td><td class=\"n\">{share}</td>\
                 <td>{seconds:.3} s, {times} times</td></tr>"
            )?;
        }
        html.write_str("</tbody></table></div>\n")
    }

    fn write_boards(&self, html: &mut String) -> fmt::Result {
        html.write_str("<div><h3>Boards at the end</h3><table id=\"boards\"><tbody>\n")?;
        let courses = Courses::new(self.trace);
        for (n, board) in self.trace.header.layout.boards.iter().enumerate() {
            let value = |signal: usize| courses.of(n, signal).and_then(|course| course.last()).map_or(0, |last| last.1);
            let told = board.description.signals.iter().enumerate();
            let told: Vec<String> = told.map(|(n, signal)| format!("{} {}", signal.name, value(n))).collect();
            writeln!(html, "<tr><th>{}</th><td>{}</td></tr>", escaped(&board.name), escaped(&told.join(", ")))?;
        }
        html.write_str("</tbody></table></div>\n")
    }
}

fn write_stats(html: &mut String, stats: &Stats) -> fmt::Result {
    html.write_str(
        "<div><h3>What it cost</h3><table id=\"cost\"><thead><tr><th></th><th class=\"n\">grants</th>\
         <th class=\"n\">a virtual s</th><th class=\"n\">redone</th><th class=\"n\">waited for</th></tr></thead>\
         <tbody>\n",
    )?;
    let boards = stats.boards.iter().map(|(name, shares)| (name.as_str(), shares));
    for (name, shares) in boards.chain([("all boards", &stats.all), ("pc", &stats.pc)]) {
        let Shares { grants, grants_per_virtual_s, redone, waiting_s, .. } = shares;
        writeln!(
            html,
            "<tr><th>{}</th><td class=\"n\">{grants}</td><td class=\"n\">{grants_per_virtual_s:.2}</td>\
             <td class=\"n\">{}</td><td class=\"n\">{:.2} ms</td></tr>",
            escaped(name),
            percent(*redone as f64, *grants as f64),
            waiting_s * 1e3
        )?;
    }
    html.write_str("</tbody></table></div>\n")
}

/// A value for people, with the counts beside it.
fn in_unit(value: f64, digits: usize, unit: &str, physical: Option<Physical>) -> String {
    let told = format!("{value:.digits$} {}", escaped(unit));
    match physical {
        Some(physical) if physical.is_counted => format!("{}<br><small>{told}</small>", physical.text(value)),
        Some(physical) => physical.text(value),
        None => told,
    }
}

fn percent(part: f64, whole: f64) -> String {
    let share = if whole > 0.0 { 100.0 * part / whole } else { 0.0 };
    if share >= 10.0 { format!("{share:.0} %") } else { format!("{share:.2} %") }
}

/// A name within the page.
fn slug(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect()
}
