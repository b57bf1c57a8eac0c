//! The lathe in one board: what Peña & Martínez (2009) propose at their end, the three slaves in one dsPIC, which takes
//! over the master's task with them.
//!
//! It is made of what the four boards are made of: the master's [`Reception`](torno_master::Reception) talks with the
//! PC, the slaves' three [tasks](torno_slaves::Task) drive the motors. What falls away is what lies between them: the
//! software UARTs, the sub-frames, the enquiries and everything that can go wrong with those.

mod dspic;
mod settings;

pub use dspic::Dspic;
pub use settings::DspicSettings;
