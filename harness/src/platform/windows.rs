use std::fs::{File, OpenOptions, Permissions};
use std::io::{self, Write};
use std::os::windows::io::AsHandle;
use std::path::Path;

use tokio::signal::windows::{
    CtrlBreak, CtrlC, CtrlClose, CtrlShutdown, ctrl_break, ctrl_c, ctrl_close, ctrl_shutdown,
};

/// The ways in which a person or the system ends a command: Ctrl-C, Ctrl-Break, the end of the console, or of the
/// system.
pub struct Interrupt {
    c: CtrlC,
    pause: CtrlBreak,
    close: CtrlClose,
    shutdown: CtrlShutdown,
}

impl Interrupt {
    /// Listens from here on.
    ///
    /// # Errors
    /// If the system refuses.
    ///
    /// # Panics
    /// Outside a tokio runtime.
    pub fn listen() -> io::Result<Self> {
        Ok(Self { c: ctrl_c()?, pause: ctrl_break()?, close: ctrl_close()?, shutdown: ctrl_shutdown()? })
    }

    /// Waits for one.
    pub async fn received(&mut self) {
        tokio::select! {
            _ = self.c.recv() => {}
            _ = self.pause.recv() => {}
            _ = self.close.recv() => {}
            _ = self.shutdown.recv() => {}
        }
    }
}

/// Whoever writes beyond a limit of a file's size gets an error in any case.
pub struct FileLimit;

impl FileLimit {
    /// Makes it so.
    ///
    /// # Errors
    /// None here.
    pub fn is_an_error() -> io::Result<Self> {
        Ok(Self)
    }
}

/// There is no limit of open files that is soon reached.
///
/// # Errors
/// None here.
pub fn has_room_for_files(_files: usize) -> io::Result<()> {
    Ok(())
}

/// Who may read a new file is a matter of its folder.
pub(crate) fn owner_only(options: &mut OpenOptions) -> &mut OpenOptions {
    options
}

/// As there.
pub(crate) fn owners_permissions() -> Option<Permissions> {
    None
}

/// It is left as it is: it would go when it is closed, and what has its name by then would go with it.
pub(crate) fn remove_open_file(_path: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// What is no serial port cannot be opened as one, and the error says so.
pub(crate) fn is_no_terminal(_path: &Path) -> bool {
    false
}

/// Whether standard error is a file, which takes all at once.
pub(crate) fn stderr_is_file() -> bool {
    let file = io::stderr().as_handle().try_clone_to_owned().map(File::from);
    file.and_then(|file| file.metadata()).is_ok_and(|found| found.is_file())
}

/// The standard library's, which knows how a console takes letters beyond ASCII.
pub(crate) struct Stderr;

impl Write for Stderr {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        io::stderr().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stderr().flush()
    }
}
