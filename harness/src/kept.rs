//! Files that hold what boards keep without power, from one session to the next: a line for each thing.

use std::fs::{self, File, OpenOptions, Permissions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use toml::{Table, Value};
use torno_machines::kinds::{self, KindError};
use torno_protocol::board::Kept;
use torno_protocol::time::Instant;
use torno_text::nearest;

use crate::platform::{owner_only, owners_permissions};
use crate::rig::file::{Board, RigFile};
use crate::text_file::{self, TextError};

/// More lines than any board keeps.
const LINES_MAX: usize = 500;

/// A file for what a board keeps.
#[derive(Debug)]
pub struct KeptFile {
    path: PathBuf,
    /// The board's place in the rig file, and its name.
    board: usize,
    name: String,
    /// Its permissions, where files have such.
    permissions: Option<Permissions>,
}

/// Why such a file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum KeptError {
    /// No board of the rig keeps anything, or it is not clear which is meant.
    #[error("{0}")]
    Board(String),
    /// It cannot be read.
    #[error("cannot read '{}'", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// It cannot be written.
    #[error("cannot write '{}'", path.display())]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A line is wrong.
    #[error("{}:{line}: {message}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// From 1.
        line: usize,
        /// What was expected, and what was found.
        message: String,
    },
}

impl KeptFile {
    /// The file that `FILE` or `BOARD=FILE` names, and the rig whose board keeps at the start what it says. Without the
    /// board, the rig has one that keeps something. A file that does not exist says nothing: the rig is as it was.
    ///
    /// # Errors
    /// [`KeptError`] if it cannot be had, or a line in it is wrong.
    pub fn open(text: &str, rig: &RigFile) -> Result<(Self, RigFile), KeptError> {
        let (board, setting, path) = named(text, rig)?;
        let unreadable = |source| KeptError::Unreadable { path: path.clone(), source };
        // What a link leads to is replaced, and not the link.
        let path = fs::canonicalize(&path).unwrap_or_else(|_| path.clone());
        let (permissions, text) = match fs::metadata(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => (owners_permissions(), None),
            Err(error) => return Err(unreadable(error)),
            Ok(found) if !found.is_file() => {
                return Err(unreadable(io::Error::other("expected a file that can be rewritten")));
            }
            Ok(found) => match text_file::read(&path) {
                Ok(text) => (Some(found.permissions()), Some(text)),
                Err(TextError::Unreadable(error)) => return Err(unreadable(error)),
                Err(TextError::NotText { line }) => {
                    return Err(KeptError::Line { path, line, message: "expected text (UTF-8)".to_owned() });
                }
            },
        };
        let file = Self { path, board, name: rig.boards[board].name.clone(), permissions };
        // A file that cannot be written must not cost a session.
        fs::remove_file(file.create(&[])?).map_err(|source| file.unwritable(source))?;
        let rig = match text {
            Some(text) => file.rig_with(&text, &setting, rig)?,
            None => rig.clone(),
        };
        Ok((file, rig))
    }

    /// The board's place in the rig file.
    pub const fn board(&self) -> usize {
        self.board
    }

    /// The board's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes what the board keeps. Whoever reads the file meanwhile reads all of the old one or of the new one.
    ///
    /// # Errors
    /// [`KeptError::Unwritable`].
    pub fn write(&self, kept: &Kept) -> Result<(), KeptError> {
        let new = self.create(&kept.lines)?;
        fs::rename(new, &self.path).map_err(|source| self.unwritable(source))
    }

    /// Writes a new file beside it.
    fn create(&self, lines: &[String]) -> Result<PathBuf, KeptError> {
        let name = self.path.file_name().unwrap_or_default().to_string_lossy();
        let new = self.path.with_file_name(format!(".{name}.{}", std::process::id()));
        let text: String = lines.iter().map(|line| format!("{line}\n")).collect();
        let write = |mut file: File| {
            // What the process forbids new files must not be taken from one that stands.
            self.permissions.clone().map_or(Ok(()), |permissions| file.set_permissions(permissions))?;
            file.write_all(text.as_bytes())?;
            file.sync_all()
        };
        let file = owner_only(OpenOptions::new().write(true).create(true).truncate(true)).open(&new);
        file.and_then(write).map_err(|source| self.unwritable(source))?;
        Ok(new)
    }

    fn unwritable(&self, source: io::Error) -> KeptError {
        KeptError::Unwritable { path: self.path.clone(), source }
    }

    /// The rig whose board keeps what the text says. Blank lines and those that begin with `#` say nothing.
    fn rig_with(&self, text: &str, setting: &str, rig: &RigFile) -> Result<RigFile, KeptError> {
        let lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
        let lines: Vec<(usize, &str)> = lines.take(LINES_MAX + 1).collect();
        let wrong = |line: usize, message| KeptError::Line { path: self.path.clone(), line, message };
        if let Some((line, _)) = lines.get(LINES_MAX) {
            return Err(wrong(*line, format!("expected no more than {LINES_MAX} lines")));
        }
        let values: Vec<&str> = lines.iter().map(|(_, line)| *line).collect();
        let board = &rig.boards[self.board];
        if let Some(message) = refused(board, setting, &values) {
            // A line may need another one that follows it.
            let good = (0..values.len()).rev().find(|n| refused(board, setting, &values[..*n]).is_none());
            let first = good.unwrap_or_default();
            let message = refused(board, setting, &values[..=first]).unwrap_or(message);
            return Err(wrong(lines.get(first).map_or(1, |(line, _)| *line), message));
        }
        let place = format!("{}.{setting}", board.name);
        rig.with_value(&place, value(&values)).map_err(|message| wrong(1, message))
    }
}

/// The board that is meant, its setting for what it keeps at the start, and the file.
fn named(text: &str, rig: &RigFile) -> Result<(usize, String, PathBuf), KeptError> {
    let keepers: Vec<(usize, &str, String)> = rig
        .boards
        .iter()
        .enumerate()
        .filter_map(|(n, board)| Some((n, board.name.as_str(), setting(board)?)))
        .collect();
    let names: Vec<&str> = keepers.iter().map(|(_, name, _)| *name).collect();
    let wrong = |message: String| Err(KeptError::Board(message));
    if let Some((name, path)) = text.split_once('=')
        && rig.boards.iter().any(|board| board.name == name)
    {
        return match keepers.iter().find(|(_, keeper, _)| *keeper == name) {
            Some((board, _, setting)) => Ok((*board, setting.clone(), PathBuf::from(path))),
            None => wrong(format!("the board '{name}' keeps nothing without power{}", nearest(name, &names))),
        };
    }
    match &keepers[..] {
        [(board, _, setting)] => Ok((*board, setting.clone(), PathBuf::from(text))),
        [] => wrong(format!("no board of the rig '{}' keeps anything without power", rig.name)),
        _ => wrong(format!("expected BOARD=FILE, where BOARD is one of {}", names.join(", "))),
    }
}

/// The setting that says what a board keeps at the start, if it keeps anything.
fn setting(board: &Board) -> Option<String> {
    let built = kinds::build(&board.kind, &board.settings, board.clock).ok()?;
    built.kept(Instant::START.next()).map(|kept| kept.setting)
}

/// What is wrong with a board that keeps these lines at the start, if it is.
fn refused(board: &Board, setting: &str, lines: &[&str]) -> Option<String> {
    let mut settings: Table = board.settings.parse().ok()?;
    settings.insert(setting.to_owned(), value(lines));
    let settings = toml::to_string(&settings).ok()?;
    match kinds::build(&board.kind, &settings, board.clock) {
        Ok(_) => None,
        Err(KindError::Settings { message, .. }) => {
            Some(message.strip_prefix(&format!("{setting}: ")).unwrap_or(&message).to_owned())
        }
        Err(error) => Some(error.to_string()),
    }
}

fn value(lines: &[&str]) -> Value {
    Value::Array(lines.iter().map(|line| Value::String((*line).to_owned())).collect())
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use tempfile::TempDir;

    use super::*;

    fn rig() -> RigFile {
        RigFile::load("lathe-grbl").unwrap()
    }

    fn file(text: &str) -> (TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("kept");
        fs::write(&path, text).unwrap();
        (folder, path)
    }

    fn refusal(text: &str) -> String {
        let (folder, path) = file(text);
        let error = KeptFile::open(path.to_str().unwrap(), &rig()).unwrap_err().to_string();
        error.replace(&format!("{}/", folder.path().display()), "")
    }

    #[test]
    fn a_board_keeps_what_the_file_says_and_a_recording_says_it_too() {
        let (_folder, path) = file("# by hand\n$20=1\n\n$22=1\n$N0=G18\n");
        let (kept, with) = KeptFile::open(path.to_str().unwrap(), &rig()).unwrap();
        assert!(with.boards[kept.board()].settings.contains("$N0=G18"));
        let again = RigFile::parse("again", &with.text).unwrap();
        assert_eq!(again.boards[kept.board()].settings, with.boards[kept.board()].settings);
    }

    #[test]
    fn a_line_that_is_wrong_is_told_with_its_number() {
        let unknown = "kept:2: '$133=1': expected a setting that the controller has (error:3)";
        assert_eq!(refusal("$10=3\n$133=1\n"), unknown);
        let needs = "expected $22=1 beside it, as soft limits need homing (error:10)";
        assert_eq!(refusal("\n$20=1\n$10=3\n"), format!("kept:2: '$20=1': {needs}"));
        // The first line needs the second one, and is not to blame.
        assert!(refusal("$20=1\n$22=1\nG0X1\n").starts_with("kept:3: 'G0X1' is nothing that is kept: expected"));
        assert_eq!(refusal(&"$10=1\n".repeat(501)), "kept:501: expected no more than 500 lines");
    }

    #[test]
    fn it_is_written_in_one_piece_for_its_owner_or_as_it_was() {
        let (folder, path) = file("$10=1\n");
        fs::set_permissions(&path, Permissions::from_mode(0o644)).unwrap();
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&path, &link).unwrap();
        let new = folder.path().join("new");
        let kept = Kept { setting: "eeprom".to_owned(), lines: vec!["$10=3".to_owned(), "$N0=G18".to_owned()] };
        for (named, written, mode) in [(&link, &path, 0o644), (&new, &new, 0o600)] {
            let (file, _) = KeptFile::open(named.to_str().unwrap(), &rig()).unwrap();
            file.write(&kept).unwrap();
            assert_eq!(fs::read_to_string(written).unwrap(), "$10=3\n$N0=G18\n");
            assert_eq!(fs::metadata(written).unwrap().permissions().mode() & 0o777, mode);
        }
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3, "nothing is left beside them");
    }

    #[test]
    fn a_board_or_a_file_that_cannot_be_meant_is_refused() {
        let refusal = |text: &str, rig: &RigFile| KeptFile::open(text, rig).unwrap_err().to_string();
        let lathe = RigFile::load("lathe").unwrap();
        assert_eq!(refusal("kept", &lathe), "no board of the rig 'lathe' keeps anything without power");
        assert!(refusal("master=kept", &rig()).starts_with("the board 'master' keeps nothing without power"));
        assert_eq!(refusal("/dev/null", &rig()), "cannot read '/dev/null'");
        assert_eq!(refusal("/nowhere/kept", &rig()), "cannot write '/nowhere/kept'");
        assert_eq!(
            KeptFile::open("grbl=/nowhere/kept", &rig()).unwrap_err().to_string(),
            "cannot write '/nowhere/kept'"
        );
    }
}
