//! What there would be without running ahead: a hub and four peers, each a process, that exchange one small record per
//! character time, over the same kind of sockets. Nothing is simulated, so it is the most that such a rig could reach.

use std::io::{Read, Write};
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Instant;

use rustix::thread::CpuSet;

/// The argument that makes this program a peer.
const PEER: &str = "--peer";
const PEERS: usize = 4;
/// Ten bits at 9600 baud, in seconds.
const CHARACTER_S: f64 = 10.0 / 9600.0;
/// As short as a grant without anything heard.
const RECORD: usize = 16;

/// If this process was started as a peer, is one until the hub has gone, and says so.
pub(crate) fn was_peer() -> bool {
    let peer = std::env::args().any(|argument| argument == PEER);
    if peer {
        let mut socket = UnixStream::from(std::io::stdin().as_fd().try_clone_to_owned().unwrap());
        let mut record = [0; RECORD];
        while socket.read_exact(&mut record).is_ok() && socket.write_all(&record).is_ok() {}
    }
    peer
}

/// Virtual over wall time of so many character times, from when all peers stand. The better of two ways: all on one
/// processor, or where the system puts them.
pub(crate) fn speed(characters: usize) -> f64 {
    let way = |pinned: bool| thread::spawn(move || once(characters, pinned)).join().unwrap();
    way(true).max(way(false))
}

fn once(characters: usize, pinned: bool) -> f64 {
    if pinned {
        // This thread's alone, and its children's.
        let mut cpus = CpuSet::new();
        cpus.set(rustix::thread::sched_getcpu());
        rustix::thread::sched_setaffinity(None, &cpus).unwrap();
    }
    let (mut peers, mut sockets): (Vec<Child>, Vec<UnixStream>) = (0..PEERS).map(|_| peer()).unzip();
    round(&mut sockets);
    let start = Instant::now();
    (0..characters).for_each(|_| round(&mut sockets));
    let wall = start.elapsed().as_secs_f64();
    drop(sockets);
    peers.iter_mut().for_each(|peer| assert!(peer.wait().unwrap().success()));
    characters as f64 * CHARACTER_S / wall
}

/// To all first, then from all: they may work at the same time.
fn round(sockets: &mut [UnixStream]) {
    let mut record = [0; RECORD];
    sockets.iter_mut().for_each(|socket| socket.write_all(&record).unwrap());
    sockets.iter_mut().for_each(|socket| socket.read_exact(&mut record).unwrap());
}

fn peer() -> (Child, UnixStream) {
    let (ours, theirs) = UnixStream::pair().unwrap();
    let mut command = Command::new(std::env::current_exe().unwrap());
    let child = command.arg(PEER).stdin(Stdio::from(OwnedFd::from(theirs))).spawn().unwrap();
    (child, ours)
}
