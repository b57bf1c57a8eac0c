//! Loops beside one another: what an open one, fixed ones and a dynamic one make of a program.

use std::fmt;

use anstyle::Style;
use serde::Serialize;

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
    /// Until the controller was idle, s; none after an alarm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
    /// What stopped the machine, if something did.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alarm: Option<String>,
}

/// The loops beside one another.
#[derive(Clone, Debug, Serialize)]
pub struct LoopComparison {
    /// The program.
    pub program: String,
    /// The loops.
    pub loops: Vec<LoopRow>,
}

impl fmt::Display for LoopComparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let bold = Style::new().bold();
        writeln!(f, "{bold}{}{bold:#}, mm and s", self.program)?;
        let head = ["loop", "worst", "final", "corrections", "loops/s", "time"];
        writeln!(f, "{:<14}{:>9}{:>9}{:>13}{:>9}{:>10}", head[0], head[1], head[2], head[3], head[4], head[5])?;
        for LoopRow { name, worst_mm, final_mm, corrections, loops_per_s, time_s, alarm, .. } in &self.loops {
            write!(f, "{name:<14}{worst_mm:>9.4}{final_mm:>9.4}{corrections:>13}{loops_per_s:>9.0}")?;
            match time_s {
                Some(seconds) => write!(f, "{seconds:>10.3}")?,
                None => write!(f, "{:>10}", "")?,
            }
            writeln!(f, "{}", alarm.as_ref().map_or_else(String::new, |alarm| format!("  {alarm}")))?;
        }
        Ok(())
    }
}
