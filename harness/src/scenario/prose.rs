//! Scenarios in Rust, for integration tests: the same things as in a scenario file, in the same words.
//!
//! What is written here becomes a scenario file ([`Prose::toml`]), and that is what runs: so all checks and all
//! messages are those of files, and a test that fails shows the file that repeats it.
//!
//! ```
//! use torno::scenario::prose::{board, line, reply, scenario};
//!
//! scenario("a blocked depth axis is reported, and the spindle goes on")
//!     .seed(7)
//!     .fault(board("depth").stalls().when(reply("ACK")))
//!     .step("a frame moves both").send("0A 00 00 00 00 00 05 00")
//!     .step("the PC is told").wait(reply("CAN d s")).within("10 s")
//!     .finally(board("spindle").quantity("set_point_rpm").equals(200))
//!     .never(reply("NAK"))
//!     .must_pass();
//! ```

use toml::{Table, Value};

use super::{Outcome, Scenario, ScenarioError, run_all};
use crate::report::{Tested, seed_text};
use crate::rig::Driver;
use crate::session::SessionError;

/// A scenario that is being written.
#[derive(Clone, Debug)]
#[must_use = "a scenario does nothing until it is run"]
pub struct Prose {
    name: String,
    seed: Option<u64>,
    table: Table,
    faults: Vec<Value>,
    steps: Vec<Table>,
    expect: Table,
}

/// Why a scenario in prose cannot be run.
#[derive(Debug, thiserror::Error)]
pub enum ProseError {
    /// It is no scenario.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The rig broke.
    #[error(transparent)]
    Rig(#[from] SessionError),
}

/// Begins a scenario.
pub fn scenario(name: &str) -> Prose {
    let mut table = Table::new();
    table.insert("name".to_owned(), name.into());
    let (faults, steps, expect) = (Vec::new(), Vec::new(), Table::new());
    Prose { name: name.to_owned(), seed: None, table, faults, steps, expect }
}

impl Prose {
    fn says(mut self, field: &str, value: impl Into<Value>) -> Self {
        self.table.insert(field.to_owned(), value.into());
        self
    }

    /// The rig: a built-in one or a file; the lathe, if nothing is said.
    pub fn on(self, rig: &str) -> Self {
        self.says("rig", rig)
    }

    /// Where everything random comes from; 0, if nothing is said.
    pub fn seed(mut self, seed: u64) -> Self {
        self.seed = Some(seed);
        self
    }

    /// The PC heeds neither `XOFF` nor `XON`.
    pub fn heedless(self) -> Self {
        self.says("held", false)
    }

    /// Ends here at the latest, even if the rig is not quiet.
    pub fn ends_by(self, span: &str) -> Self {
        self.says("end", span)
    }

    /// Something that breaks by itself.
    pub fn fault(mut self, fault: Fault) -> Self {
        self.faults.push(fault.0.into());
        self
    }

    /// The next step; what it does is said next.
    pub fn step(mut self, does: &str) -> Self {
        self.steps.push(Table::from_iter([("does".to_owned(), does.into())]));
        self
    }

    fn acts(mut self, action: &str, value: impl Into<Value>) -> Self {
        if self.steps.last().is_none_or(|step| step.len() > 1) {
            self = self.step(action);
        }
        if let Some(step) = self.steps.last_mut() {
            step.insert(action.to_owned(), value.into());
        }
        self
    }

    /// The PC sends a frame, in hexadecimal; or several, one a line.
    pub fn send(self, frames: &str) -> Self {
        let frames: Vec<Value> =
            frames.lines().map(str::trim).filter(|line| !line.is_empty()).map(Value::from).collect();
        self.acts("send", frames)
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
    pub fn wait(self, condition: Condition) -> Self {
        self.acts("wait", condition.0)
    }

    /// What the last step waits for must come within this time.
    pub fn within(mut self, span: &str) -> Self {
        let wait = self.steps.last_mut().and_then(|step| step.get_mut("wait")).and_then(Value::as_table_mut);
        if let Some(wait) = wait {
            wait.insert("within".to_owned(), span.into());
        }
        self
    }

    /// Something breaks now.
    pub fn break_it(self, fault: Fault) -> Self {
        self.acts("break", fault.0)
    }

    /// The fault of this name ends.
    pub fn heal(self, name: &str) -> Self {
        self.acts("heal", name)
    }

    /// Something must hold now.
    pub fn check(self, condition: Condition) -> Self {
        self.acts("check", condition.0)
    }

    fn expects(mut self, when: &str, condition: Condition) -> Self {
        let all = self.expect.entry(when).or_insert_with(|| Value::Array(Vec::new()));
        if let Some(all) = all.as_array_mut() {
            all.push(condition.0.into());
        }
        self
    }

    /// All that the PC hears, in order: `ACK XOFF XON`.
    pub fn replies(mut self, replies: &str) -> Self {
        self.expect.insert("replies".to_owned(), replies.into());
        self
    }

    /// What must hold at the end.
    pub fn finally(self, condition: Condition) -> Self {
        self.expects("finally", condition)
    }

    /// What must hold throughout.
    pub fn always(self, condition: Condition) -> Self {
        self.expects("always", condition)
    }

    /// The diameter that the part must have at the end, so far from its face: `"-20 mm"`, `"24 mm"`, `"0.4 mm"`.
    pub fn diameter(self, z: &str, diameter: &str, within: &str) -> Self {
        let fields = [("z", z), ("diameter", diameter), ("within", within)];
        let fields = fields.map(|(name, value)| (name.to_owned(), Value::from(value)));
        self.expects("part", Condition(Table::from_iter(fields)))
    }

    /// What must not happen.
    pub fn never(self, condition: Condition) -> Self {
        self.expects("never", condition)
    }

    /// The scenario as a file.
    pub fn toml(&self) -> String {
        let mut table = self.table.clone();
        let mut put = |field: &str, value: Value| drop(table.insert(field.to_owned(), value));
        if let Some(seed) = self.seed {
            // As a file can have it: its integers are signed.
            put("seed", Value::Integer(i64::try_from(seed).unwrap_or(i64::MAX)));
        }
        if !self.steps.is_empty() {
            put("step", self.steps.iter().cloned().map(Value::from).collect::<Vec<_>>().into());
        }
        if !self.faults.is_empty() {
            put("fault", self.faults.clone().into());
        }
        if !self.expect.is_empty() {
            put("expect", self.expect.clone().into());
        }
        toml::to_string(&table).unwrap_or_default()
    }

    /// The scenario, checked against its rig.
    ///
    /// # Errors
    /// [`ScenarioError`]: where in the file that it makes, what was expected, what was found.
    pub fn scenario(&self) -> Result<Scenario, ScenarioError> {
        Scenario::parse(&self.name, &self.toml(), self.seed)
    }

    /// Runs it, all boards in this process.
    ///
    /// # Errors
    /// [`ProseError`] if it is no scenario, or the rig itself breaks.
    pub fn run(&self) -> Result<Outcome, ProseError> {
        Ok(self.tested()?.outcome)
    }

    fn tested(&self) -> Result<Tested, ProseError> {
        let named = [(self.name.clone(), self.scenario()?)];
        let mut tested = run_all(&named, &Driver::InProcess, 1, |_| ()).into_iter().collect::<Result<Vec<_>, _>>()?;
        Ok(tested.remove(0))
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

/// Something that happens, or a bound of a quantity.
#[derive(Clone, Debug)]
pub struct Condition(Table);

/// The PC hears a reply: `XON`, `NAK o`, `CAN d n`; `NAK` alone is any refusal, `CAN` any failure.
pub fn reply(reply: &str) -> Condition {
    Condition(Table::from_iter([("reply".to_owned(), reply.into())]))
}

/// An event of the part, which a scenario can forbid: `stopped`, `rapid`, `chuck`, `deep`.
pub fn part(event: &str) -> Condition {
    Condition(Table::from_iter([("part".to_owned(), event.into())]))
}

/// A board, by its name.
#[derive(Clone, Debug)]
pub struct Board(String);

/// A board, by its name.
pub fn board(name: &str) -> Board {
    Board(name.to_owned())
}

/// A board's quantity, which is to be bounded.
#[derive(Clone, Debug)]
pub struct Quantity(Table);

impl Quantity {
    fn bound(mut self, bound: &str, value: i64) -> Condition {
        self.0.insert(bound.to_owned(), value.into());
        Condition(self.0)
    }

    /// It has this value.
    pub fn equals(self, value: i64) -> Condition {
        self.bound("equals", value)
    }

    /// It has this value or a greater one.
    pub fn at_least(self, value: i64) -> Condition {
        self.bound("at_least", value)
    }

    /// It has this value or a lesser one.
    pub fn at_most(self, value: i64) -> Condition {
        self.bound("at_most", value)
    }

    /// It has a value from `least` to `most`.
    pub fn from_to(mut self, least: i64, most: i64) -> Condition {
        self.0.insert("at_least".to_owned(), least.into());
        self.bound("at_most", most)
    }
}

/// A line, by its name.
#[derive(Clone, Debug)]
pub struct Line(String);

/// A line, by its name.
pub fn line(name: &str) -> Line {
    Line(name.to_owned())
}

/// Something that breaks.
#[derive(Clone, Debug)]
pub struct Fault(Table);

impl Fault {
    fn new(place: &str, name: &str, kind: &str) -> Self {
        Self(Table::from_iter([(place.to_owned(), name.into()), ("kind".to_owned(), kind.into())]))
    }

    fn with(mut self, field: &str, value: impl Into<Value>) -> Self {
        self.0.insert(field.to_owned(), value.into());
        self
    }

    /// What it is called, to be healed by.
    pub fn named(self, name: &str) -> Self {
        self.with("name", name)
    }

    /// When it begins; a range (`1 s..3 s`) is drawn by lot, as in every field.
    pub fn at(self, span: &str) -> Self {
        self.with("at", span)
    }

    /// What it begins with.
    pub fn when(self, condition: Condition) -> Self {
        self.with("when", condition.0)
    }

    /// How long it lasts.
    pub fn lasting(self, span: &str) -> Self {
        self.with("for", span)
    }

    /// Which character from its beginning on it meets, from 1: of one that meets a character.
    pub fn nth(self, nth: i64) -> Self {
        self.with("nth", nth)
    }
}

impl Board {
    /// One of its quantities.
    pub fn quantity(self, name: &str) -> Quantity {
        Quantity(Table::from_iter([("board".to_owned(), self.0.into()), ("quantity".to_owned(), name.into())]))
    }

    /// It tells of an event.
    pub fn tells(self, event: &str) -> Condition {
        Condition(Table::from_iter([("board".to_owned(), self.0.into()), ("event".to_owned(), event.into())]))
    }

    fn fault(self, kind: &str) -> Fault {
        Fault::new("board", &self.0, kind)
    }

    /// Its firmware runs no more.
    pub fn crashes(self) -> Fault {
        self.fault("crash")
    }

    /// Its firmware stands still.
    pub fn hangs(self) -> Fault {
        self.fault("hang")
    }

    /// Its firmware starts anew.
    pub fn resets(self) -> Fault {
        self.fault("reset")
    }

    /// Its supply is gone.
    pub fn loses_power(self) -> Fault {
        self.fault("power-off")
    }

    /// Its supply is gone for a moment.
    pub fn browns_out(self) -> Fault {
        self.fault("brown-out")
    }

    /// It takes so long over everything.
    pub fn is_slow(self, by: &str) -> Fault {
        self.fault("slow").with("value", by)
    }

    /// Its oscillator is off by so much.
    pub fn clock_is_off(self, by: &str) -> Fault {
        self.fault("clock").with("value", by)
    }

    /// Its oscillator drifts by so much a second.
    pub fn drifts(self, by: &str) -> Fault {
        self.fault("drift").with("value", by)
    }

    /// Its encoder loses (negative) or invents counts.
    pub fn miscounts(self, counts: i64) -> Fault {
        self.fault("counts").with("value", counts)
    }

    /// Its motor's shaft is blocked.
    pub fn stalls(self) -> Fault {
        self.fault("stall")
    }

    /// Its motor has a load, as a share of its torque at standstill.
    pub fn is_loaded(self, share: &str) -> Fault {
        self.fault("load").with("value", share)
    }

    /// Its motor's supply is this share of the nominal one.
    pub fn is_supplied(self, share: &str) -> Fault {
        self.fault("supply").with("value", share)
    }

    /// So many counts lie between its motor and its carriage.
    pub fn has_backlash(self, counts: i64) -> Fault {
        self.fault("backlash").with("value", counts)
    }

    /// Something hard is so many counts from mid-travel.
    pub fn is_stopped_at(self, counts: i64) -> Fault {
        self.fault("end-stop").with("value", counts)
    }
}

impl Line {
    /// Its sender sends its `nth` character, from 1.
    pub fn character(self, nth: i64) -> Condition {
        Condition(Table::from_iter([("line".to_owned(), self.0.into()), ("character".to_owned(), nth.into())]))
    }

    fn fault(self, kind: &str) -> Fault {
        Fault::new("line", &self.0, kind)
    }

    /// It is cut, and idles.
    pub fn is_cut(self) -> Fault {
        self.fault("cut")
    }

    /// It is low.
    pub fn is_stuck_low(self) -> Fault {
        self.fault("stuck-low")
    }

    /// It is high.
    pub fn is_stuck_high(self) -> Fault {
        self.fault("stuck-high")
    }

    /// It touches another line.
    pub fn touches(self, other: &str) -> Fault {
        self.fault("short").with("with", other)
    }

    /// Pulses fall on it, so far apart in the mean, of this width at the most.
    pub fn is_noisy(self, period: &str, width: &str) -> Fault {
        self.fault("noise").with("period", period).with("width", width)
    }

    /// Pulses invert it for this share of the time.
    pub fn is_inverted_for(self, share: &str) -> Fault {
        self.fault("noise").with("value", share)
    }

    /// A bit of a character is flipped: 0 (start) to 9 (stop).
    pub fn flips(self, bit: i64) -> Fault {
        self.fault("flip").with("value", bit)
    }

    /// An edge of a character, from 0, is late.
    pub fn delays(self, edge: i64, by: &str) -> Fault {
        self.fault("delay").with("edge", edge).with("value", by)
    }

    /// A character is lost.
    pub fn drops(self) -> Fault {
        self.fault("drop")
    }

    /// A character comes twice.
    pub fn doubles(self) -> Fault {
        self.fault("double")
    }
}
