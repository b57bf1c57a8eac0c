//! Boards by hand: places in a rig that are left open, each with a socket at which a board joins.

use std::path::{Path, PathBuf};

use tokio::net::UnixStream;
use tokio::task::JoinSet;
use torno_protocol::board::Description;
use torno_protocol::record::Setup;
use torno_text::nearest;
use tracing::Instrument;

use super::file::RigFile;
use super::process::{BoardProcess, Joined};
use crate::socket::{OwnSocket, Purpose, SocketError};

/// So many that are not the board are refused at a place, before its rig is given up.
const REFUSED_MAX: usize = 16;
/// What the sockets are for.
const JOINING: Purpose = Purpose {
    busy: "a rig already waits for a board",
    option: "--await BOARD=PATH",
    failing: "no board can join the rig for now",
};

/// Why no board joins.
#[derive(Debug, thiserror::Error)]
pub enum AwaitError {
    /// The rig has no such board.
    #[error("there is no board '{board}'{known}")]
    Unknown {
        /// The name.
        board: String,
        /// Those that there are, or the nearest.
        known: String,
    },
    /// It is named twice.
    #[error("board '{board}' is named twice: expected each board once")]
    Twice {
        /// The name.
        board: String,
    },
    /// There is no socket for it.
    #[error(transparent)]
    Socket(#[from] SocketError),
    /// Too many have come that were not the board.
    #[error("board '{board}': {REFUSED_MAX} have been refused in its place; the last one: {why}")]
    Refused {
        /// The board.
        board: String,
        /// What was wrong with the last one.
        why: String,
    },
    /// The system refuses something.
    #[error("cannot wait for boards")]
    System(#[from] std::io::Error),
}

/// A board whose place is to be left open, and where it joins.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Awaited {
    /// The board's name.
    pub board: String,
    /// The path of its socket.
    pub socket: PathBuf,
}

/// The places that are open.
#[derive(Debug)]
pub struct OpenPlaces(Vec<OpenPlace>);

/// A place that is open: what the board must be, and where it joins.
#[derive(Debug)]
pub struct OpenPlace {
    setup: Setup,
    description: Description,
    socket: OwnSocket,
}

impl OpenPlaces {
    /// Opens the socket of each place.
    ///
    /// # Errors
    /// [`AwaitError`] if there is no such board, or no such socket.
    ///
    /// # Panics
    /// Outside a tokio runtime with I/O enabled.
    pub fn open(file: &RigFile, awaited: &[Awaited]) -> Result<Self, AwaitError> {
        let mut places: Vec<OpenPlace> = Vec::new();
        for Awaited { board: name, socket } in awaited {
            let Some(board) = file.boards.iter().find(|board| board.name == *name) else {
                let known: Vec<&str> = file.boards.iter().map(|board| board.name.as_str()).collect();
                return Err(AwaitError::Unknown { board: name.clone(), known: nearest(name, &known) });
            };
            if places.iter().any(|place| place.setup.name == *name) {
                return Err(AwaitError::Twice { board: name.clone() });
            }
            let (setup, description) = (super::setup(board), board.description.clone());
            places.push(OpenPlace { setup, description, socket: OwnSocket::open(socket, JOINING)? });
        }
        Ok(Self(places))
    }

    /// The places.
    pub fn iter(&self) -> impl Iterator<Item = &OpenPlace> {
        self.0.iter()
    }

    /// Waits until each place is taken. Whoever is not the board that belongs there is refused, with a warning. Dropped
    /// before, it lets the boards go that have joined.
    ///
    /// # Errors
    /// [`AwaitError::Refused`] if too many are refused.
    pub async fn wait(self) -> Result<Joined, AwaitError> {
        let mut joined = Vec::new();
        let mut waits: JoinSet<_> = self.0.into_iter().map(|place| place.wait().in_current_span()).collect();
        while let Some(waited) = waits.join_next().await {
            joined.push(waited.map_err(std::io::Error::from)??);
        }
        Ok(joined.into())
    }
}

impl OpenPlace {
    /// The board's name.
    pub fn board(&self) -> &str {
        &self.setup.name
    }

    /// Its kind.
    pub fn kind(&self) -> &str {
        &self.setup.kind
    }

    /// The path of the socket.
    pub fn socket(&self) -> &Path {
        self.socket.path()
    }

    /// The command that starts the board.
    pub fn command(&self) -> String {
        format!("torno board {} --join {}", self.kind(), self.socket().display())
    }

    async fn wait(self) -> Result<(String, BoardProcess), AwaitError> {
        let mut refused = 0;
        loop {
            let stream = self.socket.accept().await;
            match self.greet(stream).await {
                Ok(process) => {
                    let board = self.setup.name;
                    match process.pid() {
                        Some(pid) => tracing::info!("board '{board}' has joined (pid {pid})"),
                        None => tracing::info!("board '{board}' has joined"),
                    }
                    return Ok((board, process));
                }
                Err(why) => {
                    let board = self.board();
                    refused += 1;
                    if refused == REFUSED_MAX {
                        return Err(AwaitError::Refused { board: board.to_owned(), why });
                    }
                    tracing::warn!("what has joined as board '{board}' is refused: {why}; the rig still waits");
                }
            }
        }
    }

    async fn greet(&self, stream: UnixStream) -> Result<BoardProcess, String> {
        let fails = |error: std::io::Error| format!("cannot be set up: {error}");
        let mut process = BoardProcess::joined(stream, self.setup.clone()).map_err(fails)?;
        match process.check(&self.description).await {
            Ok(()) => Ok(process),
            Err(unfit) => Err(unfit.to_string()),
        }
    }
}
