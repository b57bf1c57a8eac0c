//! What tests with a serial client share: frames, a rig that logs every byte, a client that is held.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use rustix::pty::{OpenptFlags, openpt, ptsname, unlockpt};
use serialport::{FlowControl, SerialPort};

use super::{Pc, Up, comes_true, folder, torno};

/// Feed 225 counts, depth 1 slot out: about a second. The spindle stays at rest: stopping it takes ten.
pub(crate) const FEED: [u8; 8] = [0x00, 0xe1, 0x00, 0xe1, 0x00, 0x00, 0x01, 0x00];
/// Depth 5 slots out: about three seconds, time enough to do something while the slaves are busy.
pub(crate) const MEDIUM: [u8; 8] = [0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x05, 0x00];
/// Any user who is not root.
pub(crate) const NOBODY: u32 = 65_534;

pub(crate) fn times(up: &Up, text: &str) -> usize {
    up.log().matches(text).count()
}

pub(crate) fn wait_for_times(up: &Up, text: &str, n: usize) {
    let came = comes_true(|| times(up, text) >= n);
    assert!(came, "{text:?} is logged {} times, not {n}:\n{}", times(up, text), up.log());
}

/// Opens and closes a terminal that is not the rig's.
pub(crate) fn terminal() {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    unlockpt(&master).unwrap();
    let name = ptsname(&master, Vec::new()).unwrap();
    File::options().read(true).write(true).open(name.to_str().unwrap()).unwrap();
}

/// A rig that logs every byte that the PC's UART sends and receives.
pub(crate) fn traced(arguments: &[&str]) -> Up {
    let folder = folder();
    let mut command = torno(&["up", "--json", "--link", folder.path().join("pc").to_str().unwrap()]);
    command.args(arguments).env("RUST_LOG", "torno=trace");
    Up::launch(command, folder)
}

/// A client that leaves being held to its operating system.
pub(crate) fn pc_with_ixon(up: &Up) -> Pc {
    let mut pc = up.pc();
    pc.port.set_flow_control(FlowControl::Software).unwrap();
    pc
}

/// A program file with these frames.
pub(crate) fn program(folder: &Path, frames: &[[u8; 8]]) -> PathBuf {
    let line = |frame: &[u8; 8]| frame.map(|byte| format!("{byte:02x}")).join(" ");
    let path = folder.join("test.frames");
    fs::write(&path, frames.iter().map(line).collect::<Vec<_>>().join("\n")).unwrap();
    path
}
