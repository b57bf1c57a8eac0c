//! `--page` and `--browser`: of a rig that is up, and of a session that is watched.

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::net::SocketAddr;
use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use anyhow::Context;
use serde_json::json;
use torno::control::{Asker, Control};
use torno::pace::Pace;
use torno::page::Page;
use torno::rig::file::RigFile;
use torno::session::Audience;
pub(super) use torno::steering::Role;
use torno::steering::Shown;
use torno_port::made_folder;
use torno_trace::Header;

use super::print;

/// The program that opens a file in the user's browser (freedesktop.org, xdg-utils).
const OPENER: &str = "xdg-open";

/// A page.
#[derive(Debug, clap::Args)]
pub(super) struct PageOptions {
    /// Serves a page that shows the rig and steers it, to whoever knows its address, which is printed; at a free port
    /// of 127.0.0.1, unless an ADDRESS:PORT is given
    #[arg(long, value_name = "ADDR", num_args = 0..=1, require_equals = true, default_missing_value = "127.0.0.1:0")]
    page: Option<SocketAddr>,
    /// Opens the page in a browser
    #[arg(long, requires = "page")]
    browser: bool,
}

/// A page of a session that goes as fast as it can where nobody watches.
#[derive(Debug, clap::Args)]
pub(super) struct WatchOptions {
    #[command(flatten)]
    page: PageOptions,
    /// Virtual seconds per second while there is a page, or 'max' [default: 1]
    #[arg(long, requires = "page", value_name = "N|max")]
    pace: Option<Pace>,
}

/// The page that is open. Dropped, it is gone.
pub(super) struct Open {
    page: Page,
    redirect: Option<Redirect>,
}

/// The page of a session, and who watches the session for it; if there is a page.
pub(super) type Watched = (Option<Open>, Option<Box<dyn Audience>>);

impl PageOptions {
    /// Whether there is to be a page.
    pub(super) const fn is_asked(&self) -> bool {
        self.page.is_some()
    }

    /// How fast a session goes where nothing else is said: a person who watches wants to see it move.
    pub(super) const fn usual_pace(&self) -> Pace {
        if self.is_asked() { Pace::Times(1.0) } else { Pace::Max }
    }

    /// Serves the page of a rig that is asked by `asker`, if there is to be one.
    pub(super) fn open(&self, file: &RigFile, role: Role, asker: Asker) -> anyhow::Result<Option<Open>> {
        let Some(address) = self.page else { return Ok(None) };
        if !address.ip().is_loopback() {
            tracing::warn!(
                "the page at {address} can be reached over the network: whoever reads its address there, which nothing \
                 encrypts, can steer this rig"
            );
        }
        Ok(Some(Open { page: Page::open(address, file, role, asker)?, redirect: None }))
    }

    /// Lets a browser show it, if that is asked for.
    pub(super) fn browse(&self, open: &mut Open) -> anyhow::Result<()> {
        if self.browser {
            open.redirect = Some(browse(open.url())?);
        }
        Ok(())
    }

    /// Serves the page of a session that is about to run at this pace, if there is to be one. Gives the page, and who
    /// watches the session for it.
    pub(super) fn show(&self, file: &RigFile, header: &Header, role: Role, pace: Pace) -> anyhow::Result<Watched> {
        let control = Control::within();
        let Some(mut open) = self.open(file, role, control.asker())? else { return Ok((None, None)) };
        let shown = Shown::new(control, file, header.clone(), role, pace)?;
        self.browse(&mut open)?;
        Ok((Some(open), Some(Box::new(shown))))
    }
}

impl WatchOptions {
    /// Whether there is to be a page.
    pub(super) const fn is_asked(&self) -> bool {
        self.page.is_asked()
    }

    /// Serves the page of a session that is about to run, if there is to be one, and tells where. Gives the page, and
    /// who watches the session for it.
    pub(super) fn show(&self, file: &RigFile, header: &Header, role: Role, json: bool) -> anyhow::Result<Watched> {
        let pace = self.pace.unwrap_or(self.page.usual_pace());
        let (open, audience) = self.page.show(file, header, role, pace)?;
        if let Some(open) = &open {
            print(&open.announcement(pace, json))?;
        }
        Ok((open, audience))
    }
}

impl Open {
    /// Its address.
    pub(super) fn url(&self) -> &str {
        self.page.url()
    }

    /// What is told of it before a session begins at this pace.
    pub(super) fn announcement(&self, pace: Pace, json: bool) -> String {
        let url = self.url();
        match json {
            true => format!("{}\n", json!({ "page": url })),
            false => format!("page      {url}  (at pace {pace}; --pace chooses another)\n"),
        }
    }

    /// Tells browsers how the session has ended.
    pub(super) async fn end(self, outcome: &str) {
        self.page.end(outcome).await;
    }
}

/// A file that leads a browser to the page. Dropped, it is gone.
struct Redirect(PathBuf);

/// Opens a page in a browser, by a file that only this user can read: arguments can be read by all.
fn browse(url: &str) -> anyhow::Result<Redirect> {
    let path = made_folder()?.join(format!("page-{}.html", std::process::id()));
    let cannot = || format!("cannot write '{}', to open the page", path.display());
    // One that a killed rig has left.
    fs::remove_file(&path).ok();
    let mut file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(&path).with_context(cannot)?;
    let redirect = Redirect(path.clone());
    let html =
        format!("<!DOCTYPE html>\n<meta charset=\"utf-8\">\n<meta http-equiv=\"refresh\" content=\"0; url={url}\">\n");
    file.write_all(html.as_bytes()).with_context(cannot)?;
    let opened =
        Command::new(OPENER).arg(&path).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    if let Err(error) = opened {
        tracing::warn!(%error, "cannot start {OPENER} to open the page: open its address in a browser");
    }
    Ok(redirect)
}

impl Drop for Redirect {
    fn drop(&mut self) {
        fs::remove_file(&self.0).ok();
    }
}
