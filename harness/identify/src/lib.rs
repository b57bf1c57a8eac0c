//! From data to a transfer function, and from a transfer function to a controller. Pure: no I/O, no clock.
//!
//! What a motor was driven with and what its encoder counted are [`Data`]. The paper's methods are in [`step`] (Eq. 4,
//! main motor) and [`second_order`] (Eq. 8 to 10, transverse motor); [`nls`] and [`arx`] are those that do better on
//! an encoder's whole counts. [`wheel`] takes the error of its code wheel out of them. [`doubt`] asks of a fit whether
//! the motor is what it was taken for. [`discrete`] is the way from s to z, [`design`] the way from there to a
//! controller, [`response`] what it will do.
//!
//! Source: Peña & Martínez, "Sistema electrónico de control de un torno CNC didáctico" (2009). Its authors wished for
//! an automatic characterisation (§5) and do not say how; what is not theirs is marked "(Ours.)".

pub mod arx;
mod confidence;
mod data;
pub mod design;
pub mod discrete;
pub mod doubt;
mod finding;
mod model;
pub mod nls;
mod noise;
mod polynomial;
pub mod prbs;
pub mod response;
pub mod second_order;
mod simulate;
pub mod step;
pub mod wheel;

pub use data::{Data, Sample, Sensor};
pub use finding::Finding;
pub use model::{Estimate, FirstOrder, Fitted, SecondOrder};
pub use nalgebra::Complex;
pub use polynomial::Polynomial;
