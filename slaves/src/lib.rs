//! The boards that drive motors: plants, encoders, control laws, and the boards made of them, as pure state machines.
//! The lathe's three slaves, and the [`Servo`] stand's controller, which is made of the same parts.
//!
//! Source: Peña & Martínez, "Sistema electrónico de control de un torno CNC didáctico" (2009). What the paper leaves
//! open is marked "(Ours.)".
//!
//! A slave has two halves. The **machine** is a control law with an encoder and a plant: [`Spindle`] regulates the
//! main motor's speed (§4, Eq. 1–7), [`Transverse`] the feed axis's position (§4, Eq. 8–15), [`Depth`] switches the
//! infeed motor on and off (§4); a [`Task`] samples it and does what all have in common. The **link** is the same for
//! all three: it puts sub-frames together and answers the master. A board that needs no link, because no one sends it
//! sub-frames, runs the tasks.
//!
//! [`Slide`] is where the infeed's slide is between two of its counts, for who looks on from outside.
//!
//! A plant moves on only when something happens on its own board, in closed form over the time that has passed; so
//! no one can tell when somebody else looked.

mod control;
mod depth;
mod drive;
mod encoder;
mod link;
mod machine;
mod pins;
mod plant;
mod rehearsal;
mod schedule;
mod servo;
mod settings;
mod slave;
mod slide;
mod spindle;
mod task;
mod telemetry;
mod transverse;

pub use depth::{Depth, DepthTask};
pub use machine::{Machine, Progress};
pub use rehearsal::{FeedLaw, FeedSample, KEPT, Rehearsal, SpeedLaw, SpeedSample};
pub use schedule::Timing;
pub use servo::Servo;
pub use settings::{
    DepthController, DepthDrive, DepthEncoder, DepthPlant, DepthSettings, Eq12, JudgedBy, KvOn, LeadForm, PositionForm,
    PositionModel, ServoController, ServoDrive, ServoEncoder, ServoPlant, ServoSettings, SetPoint, SpindleController,
    SpindleDrive, SpindleEncoder, SpindlePlant, SpindleSettings, TransverseController, TransverseDrive,
    TransverseEncoder, TransversePlant, TransverseSettings,
};
pub use slide::Slide;
pub use spindle::{Spindle, SpindleTask};
pub use task::Task;
pub use transverse::{Transverse, TransverseTask};
