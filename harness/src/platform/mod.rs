//! What each system does in its own way: timers, the signals that end a program, who may read a file, standard error.
//!
//! Whatever else needs a system is for Linux only: see the modules of the crate.

#[cfg(not(target_os = "linux"))]
mod sleep;
#[cfg(target_os = "linux")]
mod timerfd;
#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

#[cfg(not(target_os = "linux"))]
pub(crate) use sleep::Timer;
#[cfg(target_os = "linux")]
pub(crate) use timerfd::Timer;
#[cfg(unix)]
use unix as system;
#[cfg(windows)]
use windows as system;

pub use system::{FileLimit, Interrupt, has_room_for_files};
pub(crate) use system::{Stderr, is_no_terminal, owner_only, owners_permissions, remove_open_file, stderr_is_file};
