//! Control laws.

mod lead;
mod on_off;
mod pid;
mod profile;

pub(crate) use lead::Lead;
pub(crate) use on_off::OnOff;
pub use pid::KEPT;
pub(crate) use pid::{Gains, Pid, STANDS_MS, Sample};
pub(crate) use profile::Profile;
