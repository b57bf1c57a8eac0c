//! A board's process: takes its grants from the harness, over the socket that is its standard input or one that it
//! joins.

use std::future::poll_fn;
use std::io;
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};

use rustix::process::Signal;
use torno_protocol::record::{FromBoard, Heard, Setup, ToBoard, VERSION};

use crate::channel::{Channel, is_gone};
use torno_machines::kinds::{self, Steps};

/// Why a board's process ended before its harness told it to.
#[derive(Debug, thiserror::Error)]
pub enum SeatError {
    /// Standard input is not a socket.
    #[error(
        "a board takes its grants from the harness, over a socket that it inherits as its standard input; \
         to bring up a rig with all its boards, use 'torno up' or 'torno run', and to join one that waits for this \
         board, --join"
    )]
    NoSocket,
    /// No rig waits there.
    #[error("no rig waits for a board at {}: {cause}", path.display())]
    NoRig {
        /// The socket.
        path: PathBuf,
        /// Why it cannot be joined.
        cause: io::Error,
    },
    /// It has joined, and it is not the board that the rig waits for.
    #[error("this is not the board that the rig waits for: {0}")]
    Unfit(String),
    /// It has joined, and the rig has let it go.
    #[error("the rig let this board go before its first grant: the rig says why, or has ended")]
    LetGo,
    /// The socket failed.
    #[error("the harness cannot be understood")]
    Socket(#[from] io::Error),
}

/// Is a board of that kind until the harness closes the socket, or dies. The socket is standard input, or the one at
/// `join`, where a rig waits.
///
/// # Errors
/// [`SeatError`] if there is no harness, or it cannot be understood, or has no place for this board.
pub async fn run(kind: &str, join: Option<&Path>) -> Result<(), SeatError> {
    match join {
        None => take_turns(kind, inherited()?).await.map(|_| ()),
        Some(path) => {
            let socket = UnixStream::connect(path);
            let socket = socket.map_err(|cause| SeatError::NoRig { path: path.to_owned(), cause })?;
            match take_turns(kind, socket).await? {
                Closed::InRig => Ok(()),
                Closed::Unfit(message) => Err(SeatError::Unfit(message)),
                Closed::LetGo => Err(SeatError::LetGo),
            }
        }
    }
}

/// How it was when the harness closed the socket.
enum Closed {
    /// It had had a grant.
    InRig,
    /// It could not be what it was to be, for this reason.
    Unfit(String),
    /// It had had no grant.
    LetGo,
}

fn inherited() -> Result<UnixStream, SeatError> {
    let stdin = io::stdin();
    if rustix::net::sockopt::socket_domain(stdin.as_fd()).is_err() {
        return Err(SeatError::NoSocket);
    }
    // The end of the socket is enough for a board that runs; this is for one that has been stopped.
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL)).map_err(io::Error::from)?;
    Ok(UnixStream::from(stdin.as_fd().try_clone_to_owned().map_err(SeatError::Socket)?))
}

async fn take_turns(kind: &str, socket: UnixStream) -> Result<Closed, SeatError> {
    let mut channel = Channel::new(socket)?;
    let mut board: Option<Box<dyn Steps>> = None;
    let mut heard: Vec<Heard> = Vec::new();
    let mut ended = Closed::LetGo;
    while let Some(record) = poll_fn(|context| channel.poll_receive(context)).await? {
        let answer = match (record, &mut board) {
            (ToBoard::Heard(beginning), _) => {
                heard.extend(beginning);
                continue;
            }
            (ToBoard::Grant(mut grant), Some(board)) => {
                ended = Closed::InRig;
                heard.append(&mut grant.heard);
                grant.heard = core::mem::take(&mut heard);
                match board.grant(grant) {
                    Ok(report) => {
                        report.into_records().try_for_each(|record| send(&mut channel, &record))?;
                        continue;
                    }
                    Err(error) => FromBoard::Broken(error.to_string()),
                }
            }
            (ToBoard::Keep(until), Some(board)) => FromBoard::Kept(board.kept(until)),
            (ToBoard::Setup(setup), None) => match build(kind, &setup) {
                Ok(built) => {
                    let description = built.description();
                    board = Some(built);
                    FromBoard::Ready { version: VERSION, description }
                }
                Err(message) => {
                    ended = Closed::Unfit(message.clone());
                    FromBoard::Broken(message)
                }
            },
            (ToBoard::Grant(_) | ToBoard::Keep(_), None) => {
                FromBoard::Broken("was asked for something before it was set up".to_owned())
            }
            (ToBoard::Setup(_), Some(_)) => FromBoard::Broken("was set up twice".to_owned()),
        };
        send(&mut channel, &answer)?;
    }
    Ok(ended)
}

fn send(channel: &mut Channel, record: &FromBoard) -> io::Result<()> {
    match channel.send(record) {
        // The harness is gone: the next read says so too.
        Err(error) if is_gone(&error) => Ok(()),
        sent => sent,
    }
}

fn build(kind: &str, setup: &Setup) -> Result<Box<dyn Steps>, String> {
    if setup.version != VERSION {
        return Err(format!("speaks version {VERSION}, the harness version {}", setup.version));
    }
    if setup.kind != kind {
        return Err(format!("expected a board of kind '{}', found kind '{kind}'", setup.kind));
    }
    kinds::build(kind, &setup.settings, setup.clock).map_err(|error| error.to_string())
}
