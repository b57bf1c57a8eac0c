//! Text that people write: what is wrong with them and where, quantities with units, values that are drawn from
//! a seed.

mod dice;
mod nearest;
mod quantity;
mod span;

pub use dice::Dice;
pub use nearest::nearest;
pub use quantity::{Range, Ratio, parse_length, parse_ratio, parse_span};
pub use span::{Complaint, Invalid, of_toml, span};
