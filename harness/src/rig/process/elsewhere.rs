use std::convert::Infallible;
use std::io;
use std::path::Path;
use std::process::ExitStatus;
use std::task::{Context, Poll};

use torno_protocol::board::{Description, Kept};
use torno_protocol::record::{FromBoard, Setup, ToBoard};
use torno_protocol::time::Instant;

use crate::rig::{Bytes, ProcessChange, RigError};

/// Boards run in the harness's own process only.
pub(in crate::rig) const SUPPORTED: bool = false;

/// A board's process, which cannot be.
#[derive(Debug)]
pub struct BoardProcess(Infallible);

/// News of the processes that the harness has started, of which there can be none.
#[derive(Debug)]
pub(in crate::rig) struct Children(Infallible);

fn unsupported() -> io::Error {
    io::Error::new(io::ErrorKind::Unsupported, "boards run in processes of their own on Linux only")
}

impl Children {
    pub(in crate::rig) fn listen() -> io::Result<Self> {
        Err(unsupported())
    }

    pub(in crate::rig) fn poll_news(&mut self, _: &mut Context<'_>) -> Poll<()> {
        match self.0 {}
    }
}

impl BoardProcess {
    pub(in crate::rig) fn launch(_: &Path, _: Setup) -> io::Result<Self> {
        Err(unsupported())
    }

    pub(in crate::rig) const fn pid(&self) -> Option<u32> {
        match self.0 {}
    }

    pub(in crate::rig) async fn introduce(&mut self, _: &str, _: &Description) -> Result<(), RigError> {
        match self.0 {}
    }

    pub(in crate::rig) async fn kept(&mut self, _: Instant) -> io::Result<Option<Kept>> {
        match self.0 {}
    }

    pub(in crate::rig) fn bytes(&self) -> Bytes {
        match self.0 {}
    }

    pub(in crate::rig) fn send(&mut self, _: &ToBoard) -> io::Result<()> {
        match self.0 {}
    }

    pub(in crate::rig) fn poll_receive(&mut self, _: &mut Context<'_>) -> Poll<io::Result<Option<FromBoard>>> {
        match self.0 {}
    }

    pub(in crate::rig) fn change(&mut self) -> io::Result<Option<ProcessChange>> {
        match self.0 {}
    }

    pub(in crate::rig) fn poll_gone(&mut self, _: &mut Context<'_>) -> Poll<()> {
        match self.0 {}
    }

    pub(in crate::rig) async fn died(&mut self) -> io::Result<Option<ExitStatus>> {
        match self.0 {}
    }
}

pub(in crate::rig) fn share_one_processor<'a>(_: impl Iterator<Item = &'a BoardProcess>) {}
