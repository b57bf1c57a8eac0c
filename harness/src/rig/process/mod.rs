//! Boards in processes of their own. Only Linux has them: elsewhere there is no [`BoardProcess`], and no [`Children`].

#[cfg(not(target_os = "linux"))]
mod elsewhere;
mod joined;
#[cfg(target_os = "linux")]
mod linux;

#[cfg(not(target_os = "linux"))]
use elsewhere as system;
#[cfg(target_os = "linux")]
use linux as system;

pub use joined::Joined;
pub(super) use system::{BoardProcess, Children, SUPPORTED, share_one_processor};
