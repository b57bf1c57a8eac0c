//! `--page` and `--browser`.

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::net::SocketAddr;
use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use anyhow::Context;
use torno::control::Asker;
use torno::page::Page;
use torno::rig::file::RigFile;
use torno_port::made_folder;

/// The program that opens a file in the user's browser (freedesktop.org, xdg-utils).
const OPENER: &str = "xdg-open";

/// Serves the page of a rig that is asked by `asker`.
pub(super) fn open(address: SocketAddr, file: &RigFile, asker: Asker) -> anyhow::Result<Page> {
    if !address.ip().is_loopback() {
        tracing::warn!(
            "the page at {address} can be reached over the network: whoever reads its address there, which nothing \
             encrypts, can steer this rig"
        );
    }
    Ok(Page::open(address, file, asker)?)
}

/// A file that leads a browser to the page. Dropped, it is gone.
pub(super) struct Redirect(PathBuf);

/// Opens a page in a browser, by a file that only this user can read: arguments can be read by all.
pub(super) fn browse(url: &str) -> anyhow::Result<Redirect> {
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
