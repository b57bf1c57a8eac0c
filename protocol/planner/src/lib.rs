//! The lathe's planner: canonical motions in, frames out.
//!
//! A frame moves the feed at one of 225 speeds and the infeed at its only speed, started together and not synchronised.
//! So each frame moves one axis, and a taper or an arc becomes a staircase. [`Planner`] takes motions one by one and
//! gives the frames one by one; it keeps nothing of a program. [`plan`] does the same for motions that are at hand.
//!
//! Places are in mm: `x` is a radius. Nothing accumulates: counts are rounded from absolute places.

mod feed;
mod finding;
mod merge;
mod place;
mod plan;
mod rapid;
mod scale;
mod spindle;
mod stairs;
mod stock;

pub use finding::{Finding, Severity};
pub use place::Side;
pub use plan::{Plan, Planned, Planner, Report, Settings, Standing, plan};
pub use scale::{Feed, Infeed, Scale};
pub use stock::Stock;
