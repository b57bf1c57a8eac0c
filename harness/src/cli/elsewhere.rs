//! What Linux alone can do. Elsewhere each such command, and `--await`, says so.

use std::ffi::OsString;
use std::process::ExitCode;
use std::time::Duration;

use torno::pace::Pace;
use torno::rig::Driver;
use torno::rig::file::RigFile;
use torno::session::Audience;
use torno_trace::Header;

use super::Interrupt;

pub(super) mod board {
    pub(in crate::cli) use super::Arguments;
}

pub(super) mod ctl {
    pub(in crate::cli) use super::Arguments;
}

pub(super) mod join {
    pub(in crate::cli) use super::wait_for_boards;
}

pub(super) mod page {
    pub(in crate::cli) use super::{PageOptions, Role, WatchOptions};
}

pub(super) mod up {
    pub(in crate::cli) use super::Arguments;
}

const NEEDS: &str = "this command needs Linux: the ports, sockets and processes of a rig that is up are Linux's";

/// Whatever the command is given.
#[derive(Debug, clap::Args)]
#[command(after_help = NEEDS)]
pub(super) struct Arguments {
    #[arg(hide = true, trailing_var_arg = true, allow_hyphen_values = true)]
    _given: Vec<OsString>,
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        anyhow::bail!(NEEDS)
    }
}

/// There is no page.
#[derive(Debug, clap::Args)]
pub(super) struct PageOptions {}

/// There is nothing to watch.
#[derive(Debug, clap::Args)]
pub(super) struct WatchOptions {}

/// The page of a session, and who watches the session for it.
pub(super) type Watched = (Option<Open>, Option<Box<dyn Audience>>);

/// What a session is for.
#[derive(Clone, Copy, Debug)]
pub(super) enum Role {
    Run,
    Replay,
    Test,
}

/// A page that cannot be.
pub(super) enum Open {}

impl PageOptions {
    pub(super) const fn usual_pace(&self) -> Pace {
        Pace::Max
    }

    pub(super) fn show(&self, _file: &RigFile, _header: &Header, _role: Role, _pace: Pace) -> anyhow::Result<Watched> {
        Ok((None, None))
    }
}

impl WatchOptions {
    pub(super) const fn is_asked(&self) -> bool {
        false
    }

    pub(super) fn show(&self, _file: &RigFile, _header: &Header, _role: Role, _json: bool) -> anyhow::Result<Watched> {
        Ok((None, None))
    }
}

impl Open {
    pub(super) fn announcement(&self, _pace: Pace, _json: bool) -> String {
        match *self {}
    }

    pub(super) async fn end(self, _outcome: &str) {
        match self {}
    }
}

/// Gives the driver of the rig, as no board is waited for.
pub(super) async fn wait_for_boards(
    file: &RigFile,
    awaited: &[String],
    others: Driver,
    _json: bool,
    _interrupt: &mut Interrupt,
) -> anyhow::Result<Option<(Driver, Duration)>> {
    let of_file = file.boards.iter().find(|board| board.awaited).map(|board| &board.name);
    if let Some(board) = awaited.first().or(of_file) {
        anyhow::bail!("--await: a board such as '{board}' joins a rig on Linux only");
    }
    Ok(Some((others, Duration::ZERO)))
}
