//! Scenarios in Rust, for integration tests: the same things as in a scenario file, in the same words.
//!
//! What is written here is a scenario file ([`Prose::toml`]), and that file is what runs. So all checks and messages
//! are those of files, and a test that fails shows the file that repeats it. Fields that have no method of their own
//! are set with [`Clause::with`].
//!
//! ```
//! use torno::scenario::prose::{board, line, reply, scenario};
//!
//! scenario("a blocked depth axis is reported, and the spindle goes on")
//!     .seed(7)
//!     .fault(board("depth").breaks("stall").when(reply("ACK")))
//!     .fault(line("pc_to_master").breaks("noise").with("period", "10 s").with("at", "60 s"))
//!     .step("a frame moves both").send("0A 00 00 00 00 00 05 00")
//!     .step("the PC is told").wait(reply("CAN d s")).within("10 s")
//!     .finally(board("spindle").quantity("set_point_rpm").equals(200))
//!     .never(reply("NAK"))
//!     .must_pass();
//! ```

use std::error::Error;

use serde::Serialize;
use toml::{Table, Value};

use super::{Keep, Outcome, Scenario, ScenarioError, run_one};
use crate::rig::Driver;
use crate::scenario::{Tested, seed_text};

/// A scenario that is being written: what is in its file.
#[derive(Clone, Debug, Default, Serialize)]
#[must_use = "a scenario does nothing until it is run"]
pub struct Prose {
    name: String,
    rig: Option<String>,
    seed: Option<u32>,
    held: Option<bool>,
    end: Option<String>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    step: Vec<Table>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    fault: Vec<Clause>,
    expect: Expect,
}

#[derive(Clone, Debug, Default, Serialize)]
struct Expect {
    replies: Option<String>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    finally: Vec<Clause>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    always: Vec<Clause>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    never: Vec<Clause>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    part: Vec<Clause>,
}

/// Begins a scenario.
pub fn scenario(name: &str) -> Prose {
    Prose { name: name.to_owned(), ..Prose::default() }
}

impl Prose {
    /// The rig: a built-in one or a file. Default: the lathe.
    pub fn on(self, rig: &str) -> Self {
        Self { rig: Some(rig.to_owned()), ..self }
    }

    /// Where everything random comes from. Default: 0.
    pub fn seed(self, seed: u32) -> Self {
        Self { seed: Some(seed), ..self }
    }

    /// Whether `XOFF` and `XON` hold the PC. Default: as the rig's dialect says.
    pub fn held(self, held: bool) -> Self {
        Self { held: Some(held), ..self }
    }

    /// Ends here at the latest, even if the rig is not quiet. Default: 1000 s.
    pub fn ends_by(self, span: &str) -> Self {
        Self { end: Some(span.to_owned()), ..self }
    }

    /// Something breaks by itself.
    pub fn fault(mut self, fault: Clause) -> Self {
        self.fault.push(fault);
        self
    }

    /// Begins a step; the next call says what it does.
    pub fn step(mut self, does: &str) -> Self {
        self.step.push(Table::from_iter([("does".to_owned(), does.into())]));
        self
    }

    /// An action that follows another one is a step of its own.
    fn acts(mut self, action: &str, value: impl Into<Value>) -> Self {
        if self.step.last().is_none_or(|step| step.len() > 1) {
            self = self.step(action);
        }
        if let Some(step) = self.step.last_mut() {
            step.insert(action.to_owned(), value.into());
        }
        self
    }

    /// The PC sends a frame, in hexadecimal; or several, one a line.
    pub fn send(self, frames: &str) -> Self {
        let frames = frames.lines().map(str::trim).filter(|line| !line.is_empty());
        self.acts("send", frames.map(Value::from).collect::<Vec<_>>())
    }

    /// The PC sends bytes, in hexadecimal, which need not be frames.
    pub fn send_bytes(self, bytes: &str) -> Self {
        self.acts("bytes", bytes)
    }

    /// Time passes.
    pub fn run_for(self, span: &str) -> Self {
        self.acts("run", span)
    }

    /// Waits for something.
    pub fn wait(self, condition: Clause) -> Self {
        self.acts("wait", condition)
    }

    /// What the last step waits for must come within this time.
    pub fn within(mut self, span: &str) -> Self {
        if let Some(wait) = self.step.last_mut().and_then(|step| step.get_mut("wait")?.as_table_mut()) {
            wait.insert("within".to_owned(), span.into());
        }
        self
    }

    /// Something breaks now.
    pub fn break_it(self, fault: Clause) -> Self {
        self.acts("break", fault)
    }

    /// The fault of this name ends.
    pub fn heal(self, name: &str) -> Self {
        self.acts("heal", name)
    }

    /// Something must hold now.
    pub fn check(self, condition: Clause) -> Self {
        self.acts("check", condition)
    }

    /// All that the PC hears, in order: `ACK XOFF XON`.
    pub fn replies(mut self, replies: &str) -> Self {
        self.expect.replies = Some(replies.to_owned());
        self
    }

    /// What must hold at the end.
    pub fn finally(mut self, condition: Clause) -> Self {
        self.expect.finally.push(condition);
        self
    }

    /// What must hold throughout.
    pub fn always(mut self, condition: Clause) -> Self {
        self.expect.always.push(condition);
        self
    }

    /// What must not happen.
    pub fn never(mut self, condition: Clause) -> Self {
        self.expect.never.push(condition);
        self
    }

    /// The diameter that the part must have at the end, so far from its face: `"-20 mm"`, `"24 mm"`, `"0.4 mm"`.
    pub fn diameter(mut self, z: &str, diameter: &str, within: &str) -> Self {
        self.expect.part.push(Clause::new("z", z).with("diameter", diameter).with("within", within));
        self
    }

    /// The scenario as a file.
    pub fn toml(&self) -> String {
        // All of it is text, numbers and tables of them.
        toml::to_string(self).unwrap_or_default()
    }

    /// The scenario, checked against its rig.
    ///
    /// # Errors
    /// [`ScenarioError`]: where in the file that it makes, what was expected, what was found.
    pub fn scenario(&self) -> Result<Scenario, ScenarioError> {
        Scenario::parse(&self.name, &self.toml(), None)
    }

    /// Runs it, all boards in this process.
    ///
    /// # Errors
    /// If it is no scenario, or the rig itself breaks.
    pub fn run(&self) -> Result<Outcome, Box<dyn Error>> {
        Ok(self.tested()?.outcome)
    }

    fn tested(&self) -> Result<Tested, Box<dyn Error>> {
        Ok(run_one(&self.name, &self.scenario()?, &Driver::InProcess, Keep::Nothing)?)
    }

    /// Runs it; what does not hold fails the test that calls this, and is explained.
    ///
    /// # Panics
    /// If it does not pass, is no scenario, or the rig breaks.
    #[track_caller]
    pub fn must_pass(&self) {
        match self.tested() {
            Ok(tested) if tested.outcome.failures.is_empty() => {}
            Ok(tested) => panic!(
                "scenario '{}', seed {}:\n{}\nfor 'torno test':\n{}",
                self.name,
                seed_text(tested.seed, &tested.drawn),
                tested.outcome.failures.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"),
                self.toml()
            ),
            Err(error) => panic!("{error}\nin this scenario:\n{}", self.toml()),
        }
    }
}

/// A condition, a fault, or the beginning of either: the fields of its table.
#[derive(Clone, Debug, Serialize)]
#[serde(transparent)]
pub struct Clause(Table);

/// The PC hears a reply: `XON`, `NAK o`, `CAN d n`; `NAK` alone is any refusal, `CAN` any failure.
pub fn reply(reply: &str) -> Clause {
    Clause::new("reply", reply)
}

/// An event of the part, which a scenario can forbid: `stopped`, `rapid`, `chuck`, `deep`, `wall`.
pub fn part(event: &str) -> Clause {
    Clause::new("part", event)
}

/// A board, by its name; what it does or how it is follows.
pub fn board(name: &str) -> Clause {
    Clause::new("board", name)
}

/// A line, by its name; what happens on it follows.
pub fn line(name: &str) -> Clause {
    Clause::new("line", name)
}

impl Clause {
    fn new(field: &str, value: &str) -> Self {
        Self(Table::from_iter([(field.to_owned(), value.into())]))
    }

    /// Sets a field: of a fault `name`, `at`, `for`, `value` and others, of a condition its bounds.
    pub fn with(mut self, field: &str, value: impl Into<Value>) -> Self {
        self.0.insert(field.to_owned(), value.into());
        self
    }

    /// The board or the line has a fault of this kind: `stall`, `cut`.
    pub fn breaks(self, kind: &str) -> Self {
        self.with("kind", kind)
    }

    /// What a fault begins with.
    pub fn when(self, condition: Self) -> Self {
        self.with("when", condition)
    }

    /// What a fault is called, to be healed by.
    pub fn named(self, name: &str) -> Self {
        self.with("name", name)
    }

    /// The sender of the line sends its `nth` character, from 1.
    pub fn character(self, nth: u32) -> Self {
        self.with("character", nth)
    }

    /// The board reports an event.
    pub fn tells(self, event: &str) -> Self {
        self.with("event", event)
    }

    /// One of the board's quantities; its bounds follow.
    pub fn quantity(self, name: &str) -> Self {
        self.with("quantity", name)
    }

    /// It has this value.
    pub fn equals(self, value: i64) -> Self {
        self.with("equals", value)
    }

    /// It has this value or a greater one.
    pub fn at_least(self, value: i64) -> Self {
        self.with("at_least", value)
    }

    /// It has this value or a lesser one.
    pub fn at_most(self, value: i64) -> Self {
        self.with("at_most", value)
    }
}

impl From<Clause> for Value {
    fn from(clause: Clause) -> Self {
        clause.0.into()
    }
}
