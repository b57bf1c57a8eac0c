//! The workpiece that a rig's tool turns: what a rig file says of it, and the way that the tool went.

mod part;
mod path;

pub use part::{Axis, Carriages, Follower, Part, RawPart, Source};
pub use path::{ToolPath, Turned};
