use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;

use rustix::io::Errno;

/// Why the PC's port could not be opened. Each message says what to do; none is a fault of the rig (exit code 2).
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PortError {
    /// The chosen link is there already, whatever it is.
    #[error("{} already exists: remove it or choose another with --link", path.display())]
    Exists {
        /// The link asked for.
        path: PathBuf,
    },
    /// The link's folder does not exist, or may not be written.
    #[error(
        "cannot put a link into the folder {}: {cause}; create it, or choose another with --link",
        folder.display()
    )]
    Folder {
        /// The folder of the link asked for.
        folder: PathBuf,
        /// What the system said.
        cause: io::Error,
    },
    /// The folder of default links could be written by others, who could then lead PC software elsewhere.
    #[error(
        "folder {} must be yours alone (mode 0700), but {problem}: remove it, or choose a link with --link",
        folder.display()
    )]
    NotPrivate {
        /// The folder of default links.
        folder: PathBuf,
        /// What is wrong with it.
        problem: &'static str,
    },
    /// Another harness holds the default link.
    #[error("a rig '{rig}' is already up at {}: choose another link with --link", link.display())]
    Busy {
        /// The rig's name.
        rig: String,
        /// The link it holds.
        link: PathBuf,
    },
    /// The rig's name cannot be a file name.
    #[error("rig '{rig}': a name without '/' was expected, to name its link after it; choose a link with --link")]
    RigName {
        /// The rig's name.
        rig: String,
    },
    /// The rig's speed is not one a line can have.
    #[error("cannot run the port at {baud} baud: a speed from 1 to 4294967295 was expected")]
    Baud {
        /// The speed asked for, in baud.
        baud: u32,
    },
    /// The system refused to listen at an address.
    #[error("cannot listen at {address}: {cause}; choose another address or port, or 0 for a port that is free")]
    Listen {
        /// The address asked for.
        address: SocketAddr,
        /// What the system said.
        cause: io::Error,
    },
    /// The system refused a pty, or something that it takes.
    #[error("cannot {step}: {cause}; {advice}")]
    Pty {
        /// What was being done.
        step: &'static str,
        /// What the system said.
        cause: io::Error,
        /// Where to look.
        advice: &'static str,
    },
}

impl PortError {
    pub(super) fn pty(step: &'static str) -> impl Fn(Errno) -> PortError {
        move |errno| PortError::Pty {
            step,
            cause: errno.into(),
            advice: "see that devpts is mounted at /dev/pts and that ptys are left (/proc/sys/kernel/pty)",
        }
    }

    pub(super) fn watch(cause: io::Error) -> PortError {
        PortError::Pty {
            step: "watch who opens the port",
            cause,
            advice: "see /proc/sys/fs/inotify and the limit of open files (ulimit -n)",
        }
    }
}
