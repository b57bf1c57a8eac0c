//! The exit status of a command that fails.

use std::error::Error;

use torno::identify::bench::BenchError;
use torno::identify::tune::TuneError;
use torno::recorder::RecordingError;
use torno::replay::ReplayError;
use torno::rig::RigError;
use torno::send::SendError;
use torno::servo::{ControllerError, LineError};
use torno::session::SessionError;

/// A check failed: the program was not executed as it should have been.
pub(super) const FAILED: u8 = 1;
/// The command was used wrongly, or its input is broken.
pub(super) const USAGE: u8 = 2;
/// The rig itself broke.
const BROKEN: u8 = 3;
/// Ended by Ctrl-C, as shells count it.
pub(super) const INTERRUPTED: u8 = 130;

/// The exit status for an error. Where nothing is said about it here, the command was used wrongly.
pub(super) fn code(error: &anyhow::Error) -> u8 {
    fn of<E: Error + Send + Sync + 'static>(error: &anyhow::Error, code: impl FnOnce(&E) -> u8) -> Option<u8> {
        error.downcast_ref().map(code)
    }
    let broken = |is: bool| if is { BROKEN } else { USAGE };
    None.or_else(|| of(error, |_: &RigError| BROKEN))
        .or_else(|| of(error, |_: &RecordingError| BROKEN))
        .or_else(|| of(error, |_: &SessionError| BROKEN))
        .or_else(|| of(error, |error: &ReplayError| broken(matches!(error, ReplayError::Session(_)))))
        .or_else(|| of(error, |error: &BenchError| broken(matches!(error, BenchError::Session(_)))))
        .or_else(|| of(error, |error: &TuneError| broken(matches!(error, TuneError::Session(_)))))
        .or_else(|| of(error, of_port))
        .or_else(|| of(error, of_line))
        .or_else(|| of(error, of_controller))
        .unwrap_or(USAGE)
}

fn of_port(error: &SendError) -> u8 {
    match error {
        SendError::Open { .. } | SendError::NoPort { .. } => USAGE,
        SendError::Port { .. } => FAILED,
    }
}

fn of_line(error: &LineError) -> u8 {
    match error {
        LineError::Session(_) => BROKEN,
        LineError::Serial(error) => of_port(error),
    }
}

fn of_controller(error: &ControllerError) -> u8 {
    match error {
        ControllerError::Line(error) => of_line(error),
        _ => FAILED,
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::{Path, PathBuf};

    use super::*;

    fn sources(folder: &Path) -> Vec<PathBuf> {
        let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        entries.flat_map(|path| if path.is_dir() { sources(&path) } else { vec![path] }).collect()
    }

    #[test]
    fn a_rig_that_breaks_gives_3_in_every_command() {
        let rig = || RigError::Slow { board: "depth".to_owned() };
        let session = || SessionError::from(rig());
        let errors = [
            anyhow::Error::new(rig()),
            SessionError::from(rig()).into(),
            ReplayError::from(session()).into(),
            BenchError::from(session()).into(),
            anyhow::Error::new(TuneError::from(session())).context("spindle of lathe"),
            ControllerError::from(LineError::from(session())).into(),
        ];
        for error in errors {
            assert_eq!(code(&error), BROKEN, "{error:#}");
        }
        let wrong = BenchError::Seconds { found: 0.0 };
        assert_eq!(code(&wrong.into()), USAGE);
    }

    /// Each error that can be that of a rig or of its recording has its line in [`code`].
    #[test]
    fn no_error_that_wraps_that_of_a_rig_is_forgotten() {
        let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/src"));
        let ours = fs::read_to_string(root.join("cli/exit.rs")).unwrap();
        let ours = ours.split("mod tests").next().unwrap();
        let mut wrapping = Vec::new();
        for path in sources(root) {
            let text = fs::read_to_string(path).unwrap();
            for text in text.split("\npub enum ").skip(1) {
                let (name, rest) = text.split_once(' ').unwrap();
                let body = rest.split("\n}").next().unwrap();
                let inner = ["RigError)", "RecordingError)", "SessionError)", "LineError)"];
                if inner.iter().any(|inner| body.contains(inner)) {
                    wrapping.push(name.to_owned());
                }
            }
        }
        for known in ["SessionError", "BenchError", "LineError"] {
            assert!(wrapping.iter().any(|name| name == known), "{known}: {wrapping:?}");
        }
        for name in wrapping {
            assert!(ours.contains(&format!("&{name}")), "{name} has no exit status");
        }
    }
}
