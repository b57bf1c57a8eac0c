//! G-code: text to canonical motions.
//!
//! Two dialects: RS274/NGC as LinuxCNC 2.9 reads it, and that of a Fanuc lathe of G-code system A. LinuxCNC's sources
//! and manual say how its interpreter behaves; nothing is taken from them.
//!
//! ```
//! use torno_gcode::{Settings, interpret};
//!
//! let (motions, outcome) = interpret(b"G18 G7 G21\nG0 X20 Z1\nG1 Z-10 F60\nM2\n", &Settings::default());
//! assert!(!outcome.is_refused());
//! assert_eq!(motions[1].to_string(), r#"{"line":2,"kind":"rapid","x":10,"y":0,"z":1,"a":0}"#);
//! ```
//!
//! Pure: no I/O, no clock. One error does not hide the next.

mod arc;
mod block;
mod canon;
mod codes;
mod columns;
mod contour;
mod dialect;
mod execute;
mod expression;
mod fanuc;
mod finding;
mod flow;
mod interpreter;
mod lathe;
mod lexer;
mod machine;

pub use canon::{Feed, Kind, Motion, NotCanonical, Place, Plane, Sense, Speed, Turn};
pub use columns::Columns;
pub use dialect::Dialect;
pub use finding::{Finding, Severity};
pub use interpreter::{Interpreter, Outcome, Settings, interpret};
