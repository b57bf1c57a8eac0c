//! Steering a rig that runs: its control socket, and what is said over it.
//!
//! The socket is a Unix one (mode 0600) that serves no one but the user who runs the rig. Both ways go lines of JSON: a
//! request ([`Request`]) is answered by one line, `{"ok": ...}` or `{"error": "..."}`. After [`Request::Watch`] is
//! answered, lines of what happens follow, as `torno trace` shows them, until the socket is closed; where its reader is
//! too slow, `{"lost": n}` stands for `n` of them. A line that is no request is answered by an error, and the next one
//! is read.
//!
//! `torno ctl` is one client; `socat - UNIX-CONNECT:PATH` is another.

mod backlog;
mod lines;
mod path;
mod server;

pub use backlog::{Rows, ToTell, backlog};
pub use path::socket_beside;
pub(crate) use server::pieces;
pub use server::{Answer, Asker, Call, Control, Ending, Reply};

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::report::EventSummary;
use crate::saving::Product;

/// What is asked of a rig that runs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "do", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Request {
    /// How it is: answered by a [`State`].
    State,
    /// Something breaks: `fault` is what would stand under `[[fault]]` in a scenario (TOML). Answered by [`Begun`].
    Fault {
        /// The fault.
        fault: String,
    },
    /// The fault of this name ends, or will not begin. Answered by [`Done`].
    Heal {
        /// Which.
        name: String,
    },
    /// The supply of a board or the PC is gone or back. Answered by [`Done`].
    Power {
        /// The board.
        board: String,
        /// Whether it is on.
        on: bool,
    },
    /// Time stands still. Answered by [`Done`].
    Pause,
    /// Time goes on. Answered by [`Done`].
    Resume,
    /// Time goes on for so long (`10 ms`), at once, and then stands still. Answered by [`Done`] when it does; by an
    /// error, if a pause or a resume comes before.
    Step {
        /// How long.
        span: String,
    },
    /// How fast time goes: virtual seconds per second, or `max`. Answered by [`Done`].
    Pace {
        /// The pace.
        pace: String,
    },
    /// What has been made of the bar so far. Answered by a [`PartState`].
    Part,
    /// A program is looked at before it is played: what is wrong with it, and its way. Answered by a
    /// [`Preview`](crate::preview::Preview).
    Preview {
        /// The program's text.
        program: String,
    },
    /// A program is played at the PC's port, as a program outside would play it: frames as their files have them, or
    /// lines for a controller. Refused while a program outside has that port open. Answered by [`Done`].
    Play {
        /// The program's text.
        program: String,
    },
    /// No more of that program is sent. Answered by [`Done`].
    Stop,
    /// What has happened so far, as a file. Answered by [`File`], behind which its bytes follow.
    Save {
        /// What is made of it.
        what: Product,
    },
    /// What happens from now on, a line each. Answered by [`Done`].
    Watch {
        /// These lines; none and no boards: all.
        #[serde(default)]
        lines: Vec<String>,
        /// These boards; none and no lines: all.
        #[serde(default)]
        boards: Vec<String>,
        /// These kinds of rows, as `torno trace --kind` has them; none: all but edges.
        #[serde(default)]
        kinds: Vec<String>,
        /// In which form.
        #[serde(default)]
        form: Form,
    },
}

/// The form of what a watch tells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Form {
    /// A JSON object a line.
    #[default]
    Json,
    /// Text.
    Text,
    /// Text with colours.
    Colour,
}

/// Something has been done.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Done {
    /// When, in virtual nanoseconds: the instant from which it holds.
    pub ns: u64,
}

/// A file follows.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct File {
    /// It holds what happened before this, in virtual nanoseconds.
    pub ns: u64,
    /// What a person would call it.
    pub name: String,
    /// So many bytes follow.
    pub bytes: u64,
}

/// A fault has begun, or lies in wait.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Begun {
    /// What it is called, to be healed by.
    pub name: String,
    /// Since when, in virtual nanoseconds; none if it still waits for something.
    pub since: Option<u64>,
}

/// What has been made of the bar.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PartState {
    /// The corners of the surface that is cut, from the face on: along the bar and from its middle, in mm.
    pub outline: Vec<(f64, f64)>,
    /// What should not have happened.
    pub events: Vec<EventSummary>,
}

/// How a rig is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// The rig's name.
    pub rig: String,
    /// How far time has gone, in virtual nanoseconds.
    pub ns: u64,
    /// Virtual seconds per second, or `max`.
    pub pace: String,
    /// Time stands still.
    pub paused: bool,
    /// The boards, and last the PC.
    pub boards: Vec<BoardState>,
    /// Faults that last, or wait for something.
    pub faults: Vec<FaultState>,
    /// The program that was played last by [`Request::Play`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub program: Option<ProgramState>,
    /// What is kept of what has happened, for [`Request::Save`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kept: Option<KeptState>,
}

/// What is kept of what has happened.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeptState {
    /// So many bytes on disk.
    pub bytes: u64,
    /// So many there may be.
    pub of: u64,
    /// Nothing more is kept: what happened before this is, in virtual nanoseconds.
    pub until: Option<u64>,
}

/// How far a program is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProgramState {
    /// So much of it has been accepted: frames, or lines.
    pub accepted: usize,
    /// So much there is.
    pub of: usize,
    /// How it has ended, in the words of `torno run`; none while it is played.
    pub outcome: Option<String>,
}

/// How a board is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BoardState {
    /// Its name.
    pub name: String,
    /// Its process.
    pub pid: u32,
    /// Its process runs, is stopped, or has died.
    pub process: String,
    /// The boards that it waits for.
    pub waits_for: Vec<String>,
    /// Its quantities.
    pub telemetry: BTreeMap<String, i64>,
}

/// A fault that lasts, or waits for something.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FaultState {
    /// Its name.
    pub name: String,
    /// Since when, in virtual nanoseconds; none if it still waits for something.
    pub since: Option<u64>,
    /// When it ends by itself, in virtual nanoseconds.
    pub until: Option<u64>,
}
