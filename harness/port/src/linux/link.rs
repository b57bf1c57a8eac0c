use std::env;
use std::fs as files;
use std::io;
use std::path::{Path, PathBuf, absolute};

use rustix::fd::{AsFd, OwnedFd};
use rustix::fs::{self, AtFlags, FileType, FlockOperation, Mode, OFlags, Uid};
use rustix::io::Errno;
use rustix::process::geteuid;

use super::PortError;

/// Where the link to the port's device is to be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LinkPath {
    /// At this path, where nothing may be yet, in a folder that exists.
    Chosen(PathBuf),
    /// At the rig's usual place, `$XDG_RUNTIME_DIR/torno/<rig>-<gateway>`, or `/tmp/torno-<uid>/<rig>-<gateway>` if
    /// that variable is not set. The folder is made if need be. What a killed harness has left there is replaced.
    Default {
        /// The rig's name, which has no '/' in it.
        rig: String,
        /// The gateway's name.
        gateway: String,
    },
}

/// A link to a device. Dropped, it is removed, unless it leads elsewhere by then.
#[derive(Debug)]
pub(super) struct Link {
    path: PathBuf,
    target: PathBuf,
    /// Locked for as long as the default link is ours.
    lock: Option<OwnedFd>,
}

impl Link {
    pub(super) fn make(place: LinkPath, target: &Path) -> Result<Link, PortError> {
        match place {
            LinkPath::Chosen(path) => Link::at(&path, target),
            LinkPath::Default { rig, gateway } => Link::of_rig(&default_folder(), &rig, &gateway, target),
        }
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    fn at(path: &Path, target: &Path) -> Result<Link, PortError> {
        // Absolute, so that it is still found when it is to be removed.
        let path = absolute(path).map_err(|cause| PortError::Folder { folder: path.to_owned(), cause })?;
        match std::os::unix::fs::symlink(target, &path) {
            Ok(()) => Ok(Link { path, target: target.to_owned(), lock: None }),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Err(PortError::Exists { path }),
            Err(cause) => Err(PortError::Folder { folder: path.parent().unwrap_or(&path).to_owned(), cause }),
        }
    }

    /// The default link of `rig` in `folder`. Whoever holds the lock beside it may replace it.
    pub(super) fn of_rig(folder: &Path, rig: &str, gateway: &str, target: &Path) -> Result<Link, PortError> {
        if rig.is_empty() || rig.contains(['/', '\0']) {
            return Err(PortError::RigName { rig: rig.to_owned() });
        }
        let name = format!("{rig}-{gateway}");
        let path = folder.join(&name);
        let refused = |errno: Errno| PortError::Folder { folder: folder.to_owned(), cause: errno.into() };

        let within = private_folder(folder)?;
        let flags = OFlags::RDWR | OFlags::CREATE | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        let lock = fs::openat(&within, format!("{name}.lock"), flags, Mode::RUSR | Mode::WUSR).map_err(refused)?;
        match fs::flock(&lock, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => {}
            Err(Errno::WOULDBLOCK) => return Err(PortError::Busy { rig: rig.to_owned(), link: path }),
            Err(errno) => return Err(refused(errno)),
        }
        match fs::statat(&within, &name, AtFlags::SYMLINK_NOFOLLOW) {
            Ok(stat) if FileType::from_raw_mode(stat.st_mode) == FileType::Symlink => {
                fs::unlinkat(&within, &name, AtFlags::empty()).map_err(refused)?;
            }
            Ok(_) => return Err(PortError::Exists { path }),
            Err(Errno::NOENT) => {}
            Err(errno) => return Err(refused(errno)),
        }
        match fs::symlinkat(target, &within, &name) {
            Ok(()) => Ok(Link { path, target: target.to_owned(), lock: Some(lock) }),
            Err(Errno::EXIST) => Err(PortError::Exists { path }),
            Err(errno) => Err(refused(errno)),
        }
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        if files::read_link(&self.path).is_ok_and(|target| target == self.target) {
            // No one is left to tell if this fails; a stale default link is replaced by the next harness.
            let _ = files::remove_file(&self.path);
        }
        if let Some(lock) = &self.lock {
            // Not left to the close: a process being started has a copy of the descriptor until it runs its program.
            let _ = fs::flock(lock, FlockOperation::Unlock);
        }
    }
}

/// The folder of default links, the current user's own: `$XDG_RUNTIME_DIR/torno`, or `/tmp/torno-<uid>` without that
/// variable.
pub fn default_folder() -> PathBuf {
    match env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from) {
        Some(runtime) if runtime.is_absolute() => runtime.join("torno"),
        _ => PathBuf::from(format!("/tmp/torno-{}", geteuid().as_raw())),
    }
}

/// The same, made if need be.
///
/// # Errors
/// [`PortError`] if others can get at what is in it.
pub fn made_folder() -> Result<PathBuf, PortError> {
    let folder = default_folder();
    private_folder(&folder)?;
    Ok(folder)
}

/// Opens `folder`, made if need be, if no one but the current user can get at what is in it.
fn private_folder(folder: &Path) -> Result<OwnedFd, PortError> {
    let refused = |errno: Errno| PortError::Folder { folder: folder.to_owned(), cause: errno.into() };
    let not_private = |problem| PortError::NotPrivate { folder: folder.to_owned(), problem };
    match fs::mkdir(folder, Mode::RWXU) {
        Ok(()) | Err(Errno::EXIST) => {}
        Err(errno) => return Err(refused(errno)),
    }
    let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
    let opened = match fs::open(folder, flags, Mode::empty()) {
        Ok(opened) => opened,
        Err(Errno::NOTDIR | Errno::LOOP) => return Err(not_private("it is a link or a file")),
        Err(Errno::ACCESS) => return Err(not_private("it may not be read")),
        Err(errno) => return Err(refused(errno)),
    };
    let stat = fs::fstat(opened.as_fd()).map_err(refused)?;
    if Uid::from_raw(stat.st_uid) != geteuid() {
        return Err(not_private("it belongs to another user"));
    }
    if Mode::from_raw_mode(stat.st_mode).intersects(Mode::RWXG | Mode::RWXO) {
        return Err(not_private("others have access to it"));
    }
    Ok(opened)
}
