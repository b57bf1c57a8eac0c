//! What limits a rig: grants, bytes, and where the wall time goes.

use std::fmt;
use std::time::Duration;

use anstyle::Style;
use serde::{Serialize, Serializer};

use crate::rig::{Bytes, Cost};

/// What a rig cost. Grants and bytes are counted and, at pace `max`, the same on every machine; times are measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Stats {
    /// All boards together.
    #[serde(flatten)]
    pub all: Shares,
    /// Wall seconds until all boards stood, and those after the end of the play.
    pub starting_s: f64,
    /// Wall seconds of the harness's own work from when all boards stood: time, lines, the PC, what is reported.
    pub own_s: f64,
    /// The boards, in the order of the rig.
    #[serde(serialize_with = "as_map")]
    pub boards: Vec<(String, Shares)>,
    /// The PC, which has no process of its own: it is part of the harness, and not of [`Stats::all`].
    pub pc: Shares,
}

/// What one board cost, or all of them, or the PC.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Shares {
    /// Grants given.
    pub grants: u64,
    /// Grants given per virtual second.
    pub grants_per_virtual_s: f64,
    /// Grants that took back something told before: the board had run ahead of what it then heard.
    pub redone: u64,
    /// The mean, where boards have processes of their own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes_per_grant: Option<BytesPerGrant>,
    /// Wall seconds of waiting for it or, where boards have no processes of their own, of running it. Of several boards
    /// that had a grant at once, each is waited for from the answer before its own.
    pub waiting_s: f64,
}

/// Bytes over a socket for one grant, on the mean.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BytesPerGrant {
    /// To the board.
    pub to_board: f64,
    /// From the board.
    pub from_board: f64,
}

impl Shares {
    fn new(costs: &[Cost], virtual_s: f64) -> Self {
        let grants = costs.iter().map(|cost| cost.statistics.grants).sum();
        let bytes = costs.iter().filter_map(|cost| cost.bytes).reduce(|a, b| a + b);
        let waiting: Duration = costs.iter().map(|cost| cost.wall).sum();
        Self {
            grants,
            grants_per_virtual_s: per(grants as f64, virtual_s),
            redone: costs.iter().map(|cost| cost.statistics.redone).sum(),
            bytes_per_grant: bytes.map(|Bytes { to, from }| BytesPerGrant {
                to_board: per(to as f64, grants as f64),
                from_board: per(from as f64, grants as f64),
            }),
            waiting_s: waiting.as_secs_f64(),
        }
    }
}

fn per(sum: f64, whole: f64) -> f64 {
    if whole > 0.0 { sum / whole } else { 0.0 }
}

fn as_map<S: Serializer>(boards: &[(String, Shares)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(boards.iter().map(|(name, shares)| (name, shares)))
}

impl Stats {
    /// Of a play that took so many virtual seconds, and of the wall time so much in all and so much from when all
    /// boards stood. The last of `costs` is the PC's.
    pub fn new(costs: &[Cost], virtual_s: f64, wall: Duration, measured: Duration) -> Self {
        let (boards, pc) = costs.split_at(costs.len().saturating_sub(1));
        let waiting = boards.iter().map(|cost| cost.wall).sum();
        let one = |cost: &Cost| (cost.name.clone(), Shares::new(std::slice::from_ref(cost), virtual_s));
        Self {
            all: Shares::new(boards, virtual_s),
            starting_s: wall.saturating_sub(measured).as_secs_f64(),
            own_s: measured.saturating_sub(waiting).as_secs_f64(),
            boards: boards.iter().map(one).collect(),
            pc: Shares::new(pc, virtual_s),
        }
    }

    /// The table for people.
    pub(super) fn write(&self, text: &mut fmt::Formatter<'_>, bold: Style) -> fmt::Result {
        let head = ["grants", "a virtual s", "redone", "bytes to it", "from it", "waited for"];
        let [grants, per_s, redone, to, from, waited] = head;
        let head = format!("{:<12} {grants:>8} {per_s:>12} {redone:>7} {to:>12} {from:>8} {waited:>12}", "cost");
        writeln!(text, "\n{bold}{head}{bold:#}")?;
        for (name, shares) in &self.boards {
            shares.write(text, name)?;
        }
        self.all.write(text, "all boards")?;
        self.pc.write(text, "pc")?;
        let [starting, waiting, own] = [self.starting_s, self.all.waiting_s, self.own_s].map(|s| s * 1e3);
        writeln!(text, "wall     {starting:.1} ms starting, {waiting:.1} ms waiting for boards, {own:.1} ms own work")
    }
}

impl Shares {
    fn write(&self, text: &mut fmt::Formatter<'_>, name: &str) -> fmt::Result {
        let Self { grants, grants_per_virtual_s: per_s, redone, bytes_per_grant, waiting_s } = *self;
        let redone = per(100.0 * redone as f64, grants as f64);
        let shown = |bytes: fn(BytesPerGrant) -> f64| match bytes_per_grant {
            Some(of) => format!("{:.0}", bytes(of)),
            None => "-".to_owned(),
        };
        let (to, from) = (shown(|bytes| bytes.to_board), shown(|bytes| bytes.from_board));
        let waited = waiting_s * 1e3;
        writeln!(text, "{name:<12} {grants:>8} {per_s:>12.2} {redone:>5.0} % {to:>12} {from:>8} {waited:>9.2} ms")
    }
}
