//! Loops beside one another: what an open one, fixed ones and a dynamic one make of a program.

use std::fmt;

use anstyle::Style;
use serde::Serialize;
use torno_plot::escaped;

const STYLE: &str = include_str!("page/style.css");

/// The clock of the engraver's controller, an STM32F217: cycles in a second.
const CPU_HZ: f64 = 120e6;
/// What one pass of a loop costs: entry and exit of an interrupt, a timer's register and its difference, two products
/// of 64 bits, a comparison, and the waits for flash memory. (Ours: the paper gives no figure.)
const CYCLES_PER_LOOP: f64 = 200.0;

/// What a loop has made of a program.
#[derive(Clone, Debug, Serialize)]
pub struct LoopRow {
    /// The loop, in words.
    pub name: &'static str,
    /// `completed`, or what else came of the program.
    pub outcome: &'static str,
    /// The largest deviation of a carriage from what was asked for, while the program moved it, mm.
    pub worst_mm: f64,
    /// The largest one at the end, mm.
    pub final_mm: f64,
    /// Corrections of all axes.
    pub corrections: i64,
    /// Checks in a second, of the axis that had most of them.
    pub loops_per_s: f64,
    /// What the loops of all axes take of the controller's time, percent.
    pub cpu_percent: f64,
    /// Until the controller was idle, s; none after an alarm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
    /// What stopped the machine, if something did.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alarm: Option<String>,
}

/// What so many passes of a loop in a second take of the controller's time, percent.
pub fn cpu_percent(loops_per_s: f64) -> f64 {
    100.0 * loops_per_s * CYCLES_PER_LOOP / CPU_HZ
}

/// The loops beside one another.
#[derive(Clone, Debug, Serialize)]
pub struct LoopComparison {
    /// The program.
    pub program: String,
    /// The loops.
    pub loops: Vec<LoopRow>,
}

impl LoopComparison {
    /// The comparison as a page (HTML) that needs nothing else, with a picture (SVG) of the ways.
    pub fn html(&self, picture: &str) -> String {
        let program = escaped(&self.program);
        let rows: String = self.loops.iter().map(LoopRow::html).collect();
        let numbers = ["worst, mm", "final, mm", "corrections", "loops/s", "CPU, %", "time, s"];
        let head = numbers.map(|number| format!("<th class=\"n\">{number}")).concat();
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>{program}: loops</title>\n\
             <style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n<header>\n\
             <h1>{program} <small>with each loop</small></h1>\n</header>\n\
             <section id=\"loops\">\n<h2>Loops</h2>\n<table>\n<tr><th>loop{head}<th></tr>\n{rows}</table>\n</section>\n\
             <section id=\"ways\">\n<h2>Ways</h2>\n<figure>\n{picture}</figure>\n</section>\n\
             </main>\n</body>\n</html>\n"
        )
    }
}

impl LoopRow {
    fn html(&self) -> String {
        let Self { name, worst_mm, final_mm, corrections, loops_per_s, cpu_percent, time_s, alarm, .. } = self;
        let time = time_s.map_or_else(String::new, |seconds| format!("{seconds:.3}"));
        let alarm = escaped(alarm.as_deref().unwrap_or_default());
        format!(
            "<tr><td>{name}<td class=\"n\">{worst_mm:.4}<td class=\"n\">{final_mm:.4}<td class=\"n\">{corrections}\
             <td class=\"n\">{loops_per_s:.0}<td class=\"n\">{cpu_percent:.3}<td class=\"n\">{time}<td>{alarm}</tr>\n"
        )
    }
}

impl fmt::Display for LoopComparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let bold = Style::new().bold();
        writeln!(f, "{bold}{}{bold:#}, mm and s", self.program)?;
        let [name, worst, last, corrections, loops, cpu, time] =
            ["loop", "worst", "final", "corrections", "loops/s", "CPU, %", "time"];
        writeln!(f, "{name:<14}{worst:>9}{last:>9}{corrections:>13}{loops:>9}{cpu:>9}{time:>10}")?;
        for row in &self.loops {
            let LoopRow { name, worst_mm, final_mm, corrections, loops_per_s, cpu_percent, time_s, alarm, .. } = row;
            write!(f, "{name:<14}{worst_mm:>9.4}{final_mm:>9.4}{corrections:>13}{loops_per_s:>9.0}{cpu_percent:>9.3}")?;
            match time_s {
                Some(seconds) => write!(f, "{seconds:>10.3}")?,
                None => write!(f, "{:>10}", "")?,
            }
            writeln!(f, "{}", alarm.as_ref().map_or_else(String::new, |alarm| format!("  {alarm}")))?;
        }
        Ok(())
    }
}
