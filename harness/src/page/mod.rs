//! The live page of a rig that runs: what a browser is shown, and what it may ask.
//!
//! It asks the rig what the control socket asks, by the same requests: see [`control`](crate::control). What browsers
//! are shown comes from one watch and one look at the rig's state for all of them; each has a queue of its own, and one
//! that does not read loses updates, which it is told. What they were told is kept for a while, so that they can show
//! the rig as it was.

mod drawn;
mod hub;
mod past;

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use serde_json::json;
use tokio::sync::mpsc::Receiver;
use tokio::task::JoinHandle;
use torno_page::{Answer, Behind, PageError, Server};

use crate::control::{Asker, Rows, pieces};
use crate::rig::file::RigFile;
use crate::steering::Role;
use hub::Hub;

/// A browser that does not read is told of the end for so long at the most. (Ours.)
const FAREWELL: Duration = Duration::from_secs(1);

/// The page of a rig. Dropped, it is gone.
#[derive(Debug)]
pub struct Page {
    server: Server,
    hub: Arc<Hub>,
    telling: JoinHandle<()>,
}

/// What is behind the page.
#[derive(Clone)]
struct Rig {
    asker: Asker,
    hub: Arc<Hub>,
}

impl Page {
    /// Opens the page of the rig that is asked by `asker`, in this role.
    ///
    /// # Errors
    /// [`PageError`]: what to do.
    ///
    /// # Panics
    /// Outside a tokio runtime with I/O enabled.
    pub fn open(address: SocketAddr, file: &RigFile, role: Role, asker: Asker) -> Result<Self, PageError> {
        let hub = Arc::new(Hub::new(&drawn::rig(file, role), file.part.is_some(), role != Role::Up));
        let server = Server::open(address, Rig { asker: asker.clone(), hub: Arc::clone(&hub) })?;
        let told = Arc::clone(&hub);
        let telling = tokio::spawn(async move { told.run(&asker).await });
        Ok(Self { server, hub, telling })
    }

    /// The rig has ended: tells browsers how, and lets them go.
    pub async fn end(mut self, outcome: &str) {
        let farewell = async {
            (&mut self.telling).await.ok();
            let told = self.hub.end(outcome);
            self.hub.wait_for_askers(told).await;
            self.server.close().await;
        };
        if tokio::time::timeout(FAREWELL, farewell).await.is_err() {
            tracing::debug!("a browser does not read how it has ended");
        }
    }

    /// Its address, with its token.
    pub fn url(&self) -> &str {
        self.server.url()
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        self.telling.abort();
    }
}

impl Behind for Rig {
    async fn ask(&self, request: String) -> Answer {
        if let Some(instant) = past::asked(&request) {
            let refused = |error| json!({ "error": format!("expected a request: {error}") }).to_string();
            return Answer::Json(instant.map_or_else(refused, |ns| self.hub.past(ns)));
        }
        let reply = self.asker.ask_line(&request, &Rows::nowhere()).await;
        match reply.file {
            Some(file) => {
                Answer::File { name: file.name.clone(), media: file.media, bytes: file.bytes, pieces: pieces(file) }
            }
            None => Answer::Json(reply.line),
        }
    }

    fn tell(&self) -> Receiver<Bytes> {
        self.hub.tell()
    }
}
