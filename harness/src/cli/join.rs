//! `--await`: places in a rig that are left open for boards by hand.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::Context;
use serde::Serialize;
use torno::rig::Driver;
use torno::rig::file::RigFile;
use torno::rig::join::{Awaited, OpenPlace, OpenPlaces};
use torno_port::made_folder;

use super::{Interrupt, print};

#[derive(Serialize)]
struct AwaitedBoards<'a> {
    #[serde(rename = "await")]
    boards: BTreeMap<&'a str, AwaitedBoard<'a>>,
}

#[derive(Serialize)]
struct AwaitedBoard<'a> {
    kind: &'a str,
    socket: &'a Path,
    command: String,
}

/// Opens the places of the boards that are `awaited`, each as BOARD or BOARD=SOCKET, and of those that the rig file
/// leaves open, tells how to start them, and waits until all have joined. Gives the driver of the rig and how long that
/// took; nothing, if it was interrupted.
pub(super) async fn wait_for_boards(
    file: &RigFile,
    awaited: &[String],
    others: Driver,
    json: bool,
    interrupt: &mut Interrupt,
) -> anyhow::Result<Option<(Driver, Duration)>> {
    let mut awaited: Vec<Awaited> = awaited.iter().map(|text| place(file, text)).collect::<Result<_, _>>()?;
    for board in file.boards.iter().filter(|board| board.awaited) {
        if awaited.iter().all(|named| named.board != board.name) {
            awaited.push(place(file, &board.name)?);
        }
    }
    if awaited.is_empty() {
        return Ok(Some((others, Duration::ZERO)));
    }
    let places = OpenPlaces::open(file, &awaited).context("--await")?;
    print(&announcement(&places, json)?)?;
    #[expect(clippy::disallowed_methods, reason = "how long a person takes is not how long the rig takes")]
    let began = Instant::now();
    tokio::select! {
        joined = places.wait() => {
            let driver = Driver::ByHand { joined: joined.context("--await")?, others: Box::new(others) };
            Ok(Some((driver, began.elapsed())))
        }
        () = interrupt.received() => Ok(None),
    }
}

fn place(file: &RigFile, text: &str) -> anyhow::Result<Awaited> {
    let (board, socket) = match text.split_once('=') {
        Some((board, path)) => (board, PathBuf::from(path)),
        None => (text, made_folder()?.join(format!("{}-{text}-join", file.name))),
    };
    Ok(Awaited { board: board.to_owned(), socket })
}

fn announcement(places: &OpenPlaces, json: bool) -> anyhow::Result<String> {
    if json {
        let place = |open| AwaitedBoard { kind: OpenPlace::kind(open), socket: open.socket(), command: open.command() };
        let boards = places.iter().map(|open| (open.board(), place(open))).collect();
        return Ok(serde_json::to_string(&AwaitedBoards { boards })? + "\n");
    }
    let mut text = String::new();
    for open in places.iter() {
        text += &format!("waits for board '{}': {}\n", open.board(), open.command());
    }
    Ok(text)
}
