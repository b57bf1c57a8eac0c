//! A tuned controller as C for a firmware: fixed point, with test vectors from the board that runs it.

mod lead;
mod pid;

use std::fmt;

use serde::Serialize;
use torno_identify::Finding;
use torno_machines::kinds;
use torno_machines::motor::{Law, Rehearsal};

use super::error::TuneError;
use super::forecast::Controller;
use super::rig::{FORM, with_settings, working_form};
use crate::identify::bench::Subject;
use crate::identify::report::Identification;
use crate::rig::file::RigFile;

/// Products of 32 bits stay below this: no other width is needed, and a chip of 8 bits has it in software.
const ROOM: f64 = 1_073_741_824.0;

/// A language that code can be had in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Language {
    /// C99, without a library but `stdint.h`.
    C,
}

/// A controller in a language.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Code {
    /// The motor.
    pub subject: String,
    /// `lead` or `pid`.
    pub law: &'static str,
    /// The language.
    pub language: Language,
    /// What is set on the board.
    pub settings: Vec<(String, f64)>,
    /// How many test vectors there are.
    pub vectors: usize,
    /// How far the fixed point can be from the board's law in these vectors before rounding, in LSB of drive.
    pub bound_lsb: f64,
    /// The source.
    pub source: String,
}

impl Code {
    /// Proposes a controller with this phase margin, in degrees, and writes it down.
    ///
    /// # Errors
    /// [`TuneError`] if there is none, or no rig whose board could rehearse it.
    pub fn of(
        motor: &Identification,
        on_rig: Option<&(RigFile, Subject)>,
        margin: f64,
        language: Language,
    ) -> Result<Self, TuneError> {
        let Some((file, subject)) = on_rig else { return Err(TuneError::NoRehearsal) };
        let (model, period) = (motor.result.model(), motor.period_s);
        let (Law::Lead(names) | Law::Pid(names)) = subject.motor.law else {
            return Err(TuneError::OnOff { board: subject.board.clone() });
        };
        if model.gain < 0.0 {
            return Err(Finding::Backwards { gain: model.gain }.into());
        }
        let controller = Controller::design(motor.axis, &model, period, margin)?;
        let settings: Vec<(String, f64)> =
            names.map(|(name, _)| subject.setting(name)).into_iter().zip(controller.values()).collect();
        let form = subject.motor.printed.map(|_| (subject.setting(FORM), working_form(&controller)));
        let tuned = with_settings(file, subject, form.as_ref(), &settings)?;
        let board = &tuned.boards[subject.node];
        let rehearsal = kinds::rehearsal(&board.kind, &board.settings, subject.place())
            .map_err(|error| TuneError::Settings { board: subject.board.clone(), message: error.to_string() })?;
        let head = format!("{}: {controller}, every {} ms", motor.subject, subject.motor.period_ms);
        let (law, vectors, Written { bound_lsb, source }) = match rehearsal.ok_or(TuneError::NoRehearsal)? {
            Rehearsal::Speed(law, samples) => ("lead", samples.len(), lead::written(&law, &samples, &head)),
            Rehearsal::Feed(law, samples) => ("pid", samples.len(), pid::written(&law, &samples, &head)),
        };
        let subject = motor.subject.clone();
        Ok(Self { subject, law, language, settings, vectors, bound_lsb, source })
    }
}

impl fmt::Display for Code {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.source)
    }
}

/// What a law has become.
struct Written {
    bound_lsb: f64,
    source: String,
}

/// A coefficient in fixed point.
struct Coefficient {
    name: &'static str,
    /// What it is, with its unit.
    about: &'static str,
    value: f64,
    /// Bits behind the point.
    fraction: u32,
}

impl Coefficient {
    fn fixed(&self) -> i64 {
        libm::round(libm::ldexp(self.value, self.fraction as i32)) as i64
    }

    /// What is lost.
    fn error(&self) -> f64 {
        libm::ldexp(self.fixed() as f64, -(self.fraction as i32)) - self.value
    }

    fn line(&self) -> String {
        let Self { name, about, value, fraction } = self;
        let what = format!("{about}: {value}, rounded by {:.1e} at 2^-{fraction}", self.error());
        format!("#define {name:<15} {:<12} /* {what} */\n", format!("{}L", self.fixed()))
    }
}

/// A number that is one already.
fn whole(name: &str, value: i64, about: &str) -> String {
    format!("#define {name:<15} {:<12} /* {about} */\n", format!("{value}L"))
}

/// The most bits behind the point with which `largest` times `factor` has room.
fn fraction(largest: f64, most: u32) -> u32 {
    (0..=most).rev().find(|bits| libm::ldexp(largest, *bits as i32) < ROOM).unwrap_or(0)
}

/// Helpers of both laws. No sign is ever shifted, because C does not say what comes of it.
const ROUNDED: &str = "\
/* x / 2^bits, to the nearest; a half goes away from 0 */
static int32_t rounded(int32_t x, uint8_t bits)
{
    uint32_t half = bits ? 1UL << (bits - 1) : 0;

    return x < 0 ? -(int32_t)(((uint32_t)-x + half) >> bits) : (int32_t)(((uint32_t)x + half) >> bits);
}

static int32_t limited(int32_t x, int32_t low, int32_t high)
{
    return x < low ? low : x > high ? high : x;
}
";

/// Runs the vectors; the status is 1 if a drive is further from the board's than rounding explains.
fn test(arguments: &[&str], rows: impl Iterator<Item = Vec<i64>>) -> String {
    let width = arguments.len() + 1;
    let rows: String = rows
        .map(|row| {
            let cells: Vec<String> = row.iter().map(i64::to_string).collect();
            format!("    {{{}}},\n", cells.join(", "))
        })
        .collect();
    let given: Vec<String> = (0..arguments.len()).map(|place| format!("vectors[n][{place}]")).collect();
    format!(
        "\
#ifdef TORNO_TEST
#include <stdio.h>

/* {}, drive: what the board's own law was given, and what it gave */
static const int16_t vectors[][{width}] = {{
{rows}}};

int main(void)
{{
    unsigned n, count = sizeof vectors / sizeof vectors[0], differ = 0;
    int32_t largest = 0;

    torno_reset();
    for (n = 0; n < count; n++) {{
        int32_t off = (int32_t)torno_step({}) - vectors[n][{}];

        if (off < 0)
            off = -off;
        if (off > 0)
            differ++;
        if (off > largest)
            largest = off;
    }}
    printf(\"%u vectors, %u differ, by %ld LSB at most\\n\", count, differ, (long)largest);
    return largest > 1;
}}
#endif
",
        arguments.join(", "),
        given.join(", "),
        arguments.len(),
    )
}
