//! A board's process: takes its turns from the harness over the socket that is its standard input.

use std::future::poll_fn;
use std::io;
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;

use rustix::process::Signal;
use torno_protocol::record::{FromBoard, Heard, Setup, ToBoard, VERSION};

use crate::channel::{Channel, is_gone};
use torno_machines::kinds::{self, Steps};

/// Why a board's process ended before its harness told it to.
#[derive(Debug, thiserror::Error)]
pub enum SeatError {
    /// Standard input is not a socket.
    #[error(
        "a board takes its turns from the harness, over a socket that it inherits as its standard input; \
         to bring up a rig with all its boards, use 'torno up' or 'torno run'"
    )]
    NoSocket,
    /// The socket failed.
    #[error("the harness cannot be understood")]
    Socket(#[from] io::Error),
}

/// Is a board of that kind until the harness closes the socket, or dies.
///
/// # Errors
/// [`SeatError`] if there is no harness, or it cannot be understood.
pub async fn run(kind: &str) -> Result<(), SeatError> {
    let stdin = io::stdin();
    if rustix::net::sockopt::socket_domain(stdin.as_fd()).is_err() {
        return Err(SeatError::NoSocket);
    }
    // The end of the socket is enough for a board that runs; this is for one that has been stopped.
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL)).map_err(io::Error::from)?;
    let mut channel = Channel::new(UnixStream::from(stdin.as_fd().try_clone_to_owned()?))?;
    let mut board: Option<Box<dyn Steps>> = None;
    let mut heard: Vec<Heard> = Vec::new();
    while let Some(record) = poll_fn(|context| channel.poll_receive(context)).await? {
        let answer = match (record, &mut board) {
            (ToBoard::Heard(beginning), _) => {
                heard.extend(beginning);
                continue;
            }
            (ToBoard::Turn(mut turn), Some(board)) => {
                heard.append(&mut turn.heard);
                turn.heard = core::mem::take(&mut heard);
                match board.turn(turn) {
                    Ok(batch) => {
                        batch.into_records().try_for_each(|record| send(&mut channel, &record))?;
                        continue;
                    }
                    Err(error) => FromBoard::Broken(error.to_string()),
                }
            }
            (ToBoard::Setup(setup), None) => match build(kind, &setup) {
                Ok(built) => {
                    let description = built.description();
                    board = Some(built);
                    FromBoard::Ready { version: VERSION, description }
                }
                Err(message) => FromBoard::Broken(message),
            },
            (ToBoard::Turn(_), None) => FromBoard::Broken("was given a turn before it was set up".to_owned()),
            (ToBoard::Setup(_), Some(_)) => FromBoard::Broken("was set up twice".to_owned()),
        };
        send(&mut channel, &answer)?;
    }
    Ok(())
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
    kinds::build(kind, &setup.settings, setup.clock).map_err(|error| error.to_string())
}
