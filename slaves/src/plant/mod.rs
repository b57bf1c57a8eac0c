//! Plants: what the firmware drives and cannot know but through its encoder.

mod lag;
mod position;
mod sampled;
mod shaft;
mod speed;

pub(crate) use position::PositionMotor;
pub(crate) use sampled::SampledPlant;
pub(crate) use speed::SpeedMotor;
