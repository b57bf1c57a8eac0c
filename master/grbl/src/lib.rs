//! A GRBL controller as a board: the PC's G-code on one side, frames for the lathe's master on the other.

mod board;
mod lathe;
mod settings;

pub use board::Grbl;
pub use settings::GrblSettings;
