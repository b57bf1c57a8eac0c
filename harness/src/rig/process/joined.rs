use std::sync::{Arc, Mutex, PoisonError};

use super::BoardProcess;

/// Boards that have joined and wait for their rig. Clones share them: a board takes part in one rig.
#[derive(Clone, Debug)]
pub struct Joined(Arc<Mutex<Vec<(String, BoardProcess)>>>);

impl From<Vec<(String, BoardProcess)>> for Joined {
    fn from(boards: Vec<(String, BoardProcess)>) -> Self {
        Self(Arc::new(Mutex::new(boards)))
    }
}

impl Joined {
    /// The board of this name, if it has joined and no rig has it yet.
    pub(in crate::rig) fn take(&self, board: &str) -> Option<BoardProcess> {
        let mut boards = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let place = boards.iter().position(|(name, _)| name == board)?;
        Some(boards.swap_remove(place).1)
    }
}
