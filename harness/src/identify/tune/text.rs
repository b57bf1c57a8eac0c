//! A proposal, for people.

use std::fmt;

use anstyle::{AnsiColor, Style};

use super::Tuning;
use super::forecast::{Forecast, Indices};
use super::rig::{DISTANCE, SPEED, Seen, watched};
use crate::identify::report::{Identification, digits, short};

/// A line of a table: its name, its value, and with how many digits.
pub(super) type Indicator<T, N> = (&'static str, fn(&T) -> N, usize);

impl Identification {
    /// What is known of the motor, in a few lines.
    pub(super) fn write_model(&self, text: &mut fmt::Formatter<'_>) -> fmt::Result {
        let bold = Style::new().bold();
        let warn = AnsiColor::Red.on_default().bold();
        let Identification { subject, units, period_s, axis, result, .. } = self;
        let what = if *axis { "position" } else { "speed" };
        writeln!(text, "{:<10}{bold}{subject}{bold:#}: {what}, sampled every {} ms", "motor", short(1e3 * period_s))?;
        writeln!(text, "{:<10}{} {} per {}", "gain", digits(result.gain), units.speed, units.input)?;
        writeln!(text, "{:<10}{} s", "tau", digits(result.tau_s))?;
        for warning in &result.warnings {
            writeln!(text, "{warn}{:<10}{warning}{warn:#}", "warning")?;
        }
        Ok(())
    }
}

/// A cell of a table of loops.
type Cell = fn(&Forecast) -> Option<String>;

/// What a table shows of a loop.
pub(super) const MARGINS: [(&str, Cell); 5] = [
    ("crossover, rad/s", |f| f.crossover_rad_per_s.map(|omega| format!("{omega:.2}"))),
    ("phase margin, degrees", |f| f.phase_margin_deg.map(|phase| format!("{phase:.1}"))),
    ("gain margin, dB", |f| f.gain_margin_db.map(|db| format!("{db:.1}"))),
    ("delay margin, ms", |f| f.delay_margin_s.map(|delay| format!("{:.0}", 1e3 * delay))),
    ("largest pole", |f| f.poles.first().map(|[re, im]| format!("{:.4}", libm::hypot(*re, *im)))),
];

/// And of its response to a small step.
pub(super) const STEP: [Indicator<Indices, f64>; 3] = [
    ("small step: rise, s", |step| step.rise_s, 3),
    ("  settling (2 %), s", |step| step.settling_s, 3),
    ("  overshoot, %", |step| step.overshoot_percent, 1),
];

/// For people, with the colours of a terminal: what writes it elsewhere strips them.
impl fmt::Display for Tuning {
    fn fmt(&self, text: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (bold, dim) = (Style::new().bold(), Style::new().dimmed());
        let warn = AnsiColor::Red.on_default().bold();
        self.motor.write_model(text)?;
        let law = if self.motor.axis { "PID (Eq 13, 14)" } else { "lead compensator, incremental (Eq 7)" };
        writeln!(text, "{:<10}{law}: {bold}{}{bold:#}", "proposed", self.controller)?;
        writeln!(text)?;
        // Without a rig there is nothing beside it.
        let beside = |shown: bool, cell: String| if shown { format!(" {cell:>12}") } else { String::new() };
        let (on_rig, speed) = (self.shown.is_some(), self.open_loop.is_some());
        let heads = [beside(on_rig, "as it is".to_owned()), beside(speed, "open loop".to_owned())].concat();
        writeln!(text, "{dim}{:<30}{:>12}{heads}{dim:#}", "", "proposed")?;
        let present = self.present.as_ref();
        let of_open = |number: fn(&Indices) -> f64, digits: usize| {
            self.open_loop.as_ref().map_or("-".to_owned(), |step| format!("{:.digits$}", number(step)))
        };
        let mut line = |name: &str, number: &dyn Fn(&Forecast) -> Option<String>, open: String| {
            let of = |forecast: Option<&Forecast>| forecast.and_then(number).unwrap_or_else(|| "-".to_owned());
            let (present, open) = (beside(on_rig, of(present)), beside(speed, open));
            writeln!(text, "{name:<30}{:>12}{present}{open}", of(Some(&self.forecast)))
        };
        let none = || "-".to_owned();
        for (name, number) in MARGINS {
            line(name, &number, none())?;
        }
        // A lag does not oscillate.
        line("least damping", &|f| Some(format!("{:.2}", f.damping)), "1.00".to_owned())?;
        for (name, number, digits) in STEP {
            let of = |f: &Forecast| f.small_step.as_ref().map(|step| format!("{:.digits$}", number(step)));
            line(name, &of, of_open(number, digits))?;
        }
        if let Some(dead) = self.dead_s {
            let of = |name: &str, forecast: &Forecast| {
                let left = forecast.delay_margin_s.map(|margin| 1e3 * (margin - dead))?;
                let text = if left > 0.0 {
                    format!("{left:.0} ms of its delay margin are left")
                } else {
                    format!("{:.0} ms beyond its delay margin: unstable", -left)
                };
                Some(format!("{name}: {text}"))
            };
            let told: Vec<String> =
                [of("proposed", &self.forecast), present.and_then(|present| of("as it is", present))]
                    .into_iter()
                    .flatten()
                    .collect();
            writeln!(text, "the plant has {} ms of dead time; {}", short(1e3 * dead), told.join("; "))?;
        }
        for (name, forecast) in [("proposed", Some(&self.forecast)), ("as it is", present)] {
            let Some(forecast) = forecast else { continue };
            if forecast.crossover_rad_per_s.is_none() {
                writeln!(
                    text,
                    "{warn}{name}: the loop's gain is below 1 at every frequency: there are no margins{warn:#}"
                )?;
            }
            if forecast.small_step.is_none() {
                writeln!(
                    text,
                    "{warn}{name}: the small step does not settle within 8 time constants of its slowest pole{warn:#}"
                )?;
            }
            if let Some(error) = forecast.standing_error_percent {
                writeln!(text, "{warn}{name}: {error:.1} % of the set point are missing in the end{warn:#}")?;
            }
        }
        if let Some(finding) = &self.present_finding {
            writeln!(text, "{warn}as it is: {finding}{warn:#}")?;
        }
        if let (Some(shown), Some(present)) = (&self.shown, &self.shown_present) {
            writeln!(text)?;
            self.write_shown(text, shown, present, dim)?;
        }
        if let Some([proposed, present]) = self.slower() {
            let (proposed, present) = (short(proposed), short(present));
            writeln!(
                text,
                "{warn}slower: on the rig the proposed controller needs {proposed} s, what is there {present} s; a \
                 smaller --phase-margin makes it quicker{warn:#}"
            )?;
        }
        writeln!(text)?;
        writeln!(text, "{dim}to be set{dim:#}")?;
        // As `--set` takes it.
        if let Some((place, form)) = &self.form {
            writeln!(text, "  {place}={form}")?;
        }
        for (name, value) in &self.settings {
            writeln!(text, "  {name}={value:?}")?;
        }
        Ok(())
    }
}

impl Tuning {
    /// What the proposed controller and the present one need on the rig, in s, if the proposed one needs longer.
    fn slower(&self) -> Option<[f64; 2]> {
        let needs = |seen: &Seen| seen.in_position_s.or(seen.step.map(|step| step.settling_s));
        let both = [needs(self.shown.as_ref()?)?, needs(self.shown_present.as_ref()?)?];
        (both[0] > both[1]).then_some(both)
    }

    fn write_shown(&self, text: &mut fmt::Formatter<'_>, shown: &Seen, present: &Seen, dim: Style) -> fmt::Result {
        let cell = |number: Option<f64>, digits: usize| number.map_or("-".to_owned(), |n| format!("{n:.digits$}"));
        if self.motor.axis {
            let head = format!("{DISTANCE} counts on the rig");
            writeln!(text, "{dim}{head:<30}{:>12} {:>12}{dim:#}", "proposed", "as it is")?;
            let lines: [Indicator<Seen, Option<f64>>; 6] = [
                ("following error, counts", |seen| seen.following_error_counts, 0),
                ("overshoot, counts", |seen| seen.overshoot_counts, 0),
                ("in position after, s", |seen| seen.in_position_s, 2),
                ("small step, counts", |seen| Some(f64::from(seen.small_step.as_ref()?.counts)), 0),
                ("  settling (to a count), s", |seen| Some(seen.small_step.as_ref()?.response?.settling_s), 3),
                ("  overshoot, %", |seen| Some(seen.small_step.as_ref()?.response?.overshoot_percent), 1),
            ];
            for (name, number, digits) in lines {
                writeln!(text, "{name:<30}{:>12} {:>12}", cell(number(shown), digits), cell(number(present), digits))?;
            }
            for (name, seen) in [("proposed", shown), ("as it is", present)] {
                if seen.in_position_s.is_none() {
                    let seconds = watched(&self.motor.result.model());
                    writeln!(text, "{name}: it does not come to stay within a count in {seconds} s")?;
                }
            }
            let note = "The forecast is of Eq 14 alone; on the rig the board also has its rules against friction.";
            return writeln!(text, "{dim}{note}{dim:#}");
        }
        let head = format!("0 to {} rpm on the rig", u32::from(SPEED) * 20);
        writeln!(
            text,
            "{dim}{head:<30}{:>12} {:>12} {:>12} {:>12}{dim:#}",
            "proposed", "as it is", "open loop", "foretold"
        )?;
        let lines: [Indicator<Indices, f64>; 3] = [
            ("rise, s", |step| step.rise_s, 3),
            ("settling (2 %), s", |step| step.settling_s, 3),
            ("overshoot, %", |step| step.overshoot_percent, 1),
        ];
        for (name, number, digits) in lines {
            let of = |step: &Option<Indices>| cell(step.as_ref().map(number), digits);
            let open = of(&self.shown_open.as_ref().and_then(|open| open.step));
            let (shown, present, foretold) = (of(&shown.step), of(&present.step), of(&self.foretold));
            writeln!(text, "{name:<30}{shown:>12} {present:>12} {open:>12} {foretold:>12}")?;
        }
        for (name, step) in [("proposed", shown.step), ("as it is", present.step), ("foretold", self.foretold)] {
            if step.is_none() {
                let seconds = watched(&self.motor.result.model());
                writeln!(text, "{name}: it does not get there and stay within {seconds} s")?;
            }
        }
        Ok(())
    }
}
