//! Is the PC on any serial port: sends a program frame by frame, honours the hold, listens to the replies.

use std::io;
use std::path::Path;
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio_serial::{SerialPortBuilderExt, SerialStream};
use torno_protocol::lathe::{Program, Reply, ReplyDecoder};

use crate::job::{Outcome, Tally};
use crate::platform::is_no_terminal;

/// What is to be sent, and where.
#[derive(Clone, Debug)]
pub struct Send {
    /// The program.
    pub program: Program,
    /// The serial port.
    pub port: String,
    /// Its speed in baud.
    pub baud: u32,
    /// How long a frame may go without any answer. While it is held or executed, the wait has no end.
    pub patience: Duration,
}

/// Why a program could not be sent to its end.
#[derive(Debug, thiserror::Error)]
pub enum SendError {
    /// The port cannot be opened.
    #[error("cannot open the serial port '{port}'")]
    Open {
        /// The port.
        port: String,
        /// Why.
        source: tokio_serial::Error,
    },
    /// It is something else.
    #[error("'{port}' is no serial port: expected a terminal, such as /dev/ttyUSB0 or the link that 'torno up' prints")]
    NoPort {
        /// What was opened.
        port: String,
    },
    /// The port failed.
    #[error("the serial port '{port}' failed")]
    Port {
        /// The port.
        port: String,
        /// Why.
        source: io::Error,
    },
}

/// Opens a serial port.
///
/// # Errors
/// [`SendError::Open`] and [`SendError::NoPort`].
pub fn open_port(port: &str, baud: u32) -> Result<SerialStream, SendError> {
    let port = port.to_owned();
    match tokio_serial::new(&port, baud).open_native_async() {
        Ok(stream) => Ok(stream),
        Err(_) if is_no_terminal(Path::new(&port)) => Err(SendError::NoPort { port }),
        Err(source) => Err(SendError::Open { port, source }),
    }
}

impl Send {
    /// Sends the program. A frame is sent when the one before it has been acknowledged: the master can hold one while
    /// the machine works. After a failure nothing more is sent: with a frame missing, the rest would turn another part.
    ///
    /// What is said goes into `conversation`, so that it is known where this is given up.
    ///
    /// # Errors
    /// [`SendError`] if the port cannot be opened or fails.
    pub async fn run(
        &self,
        conversation: &mut Tally,
        mut heard: impl FnMut(&Tally, Reply),
    ) -> Result<Outcome, SendError> {
        let mut port = open_port(&self.port, self.baud)?;
        let failed = |source| SendError::Port { port: self.port.clone(), source };
        let mut decoder = ReplyDecoder::default();
        let mut frames = self.program.frames.iter();
        loop {
            if conversation.may_send()
                && conversation.failures.is_empty()
                && let Some(frame) = frames.next()
            {
                port.write_all(frame).await.map_err(failed)?;
                conversation.sent();
            }
            if conversation.is_over() && (frames.len() == 0 || !conversation.failures.is_empty()) {
                break;
            }
            let Some(bytes) = self.listen(&mut port, conversation).await.map_err(failed)? else { break };
            for reply in bytes.into_iter().flat_map(|byte| decoder.push(byte)) {
                conversation.reply(reply);
                heard(conversation, reply);
            }
        }
        Ok(conversation.outcome(self.program.frames.len()))
    }

    /// The next bytes; `None` if a frame has gone without an answer for too long.
    async fn listen(&self, port: &mut SerialStream, conversation: &Tally) -> io::Result<Option<Vec<u8>>> {
        let mut bytes = [0; 64];
        let read = port.read(&mut bytes);
        let read = if conversation.stopped || conversation.unanswered() == 0 {
            read.await
        } else {
            match tokio::time::timeout(self.patience, read).await {
                Ok(read) => read,
                Err(_) => return Ok(None),
            }
        };
        match read? {
            0 => Err(io::ErrorKind::UnexpectedEof.into()),
            n => Ok(Some(bytes[..n].to_vec())),
        }
    }
}
