//! What can go wrong with an axis.

pub use crate::encoder::Channel;

/// Something that happens to an axis. Lengths are in picometres, shares of the holding torque in per mille.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Fault {
    /// The rotor is blocked (`true`) or free again.
    Stall(bool),
    /// Friction instead of the axis's own; 0: its own.
    Load(u32),
    /// A constant force in the negative sense whatever the motion; in the positive one if negative. One that exceeds
    /// torque and friction carries the axis to its end stop at once.
    Push(i32),
    /// The motor's supply, in per mille of the nominal one: the torque falls with it; 0: the drive is off. 1000 heals.
    Supply(u32),
    /// Dead travel instead of the axis's own; `None`: its own.
    Backlash(Option<u32>),
    /// Something hard stops the carriage so far from mid-travel, on the side given by the sign; one that it is beyond
    /// already, where it stands. 0 removes both.
    EndStop(i64),
    /// The encoder invents (loses if negative) so many counts at once, in the sense in which the program moved last. A
    /// tooth of the paper's belt is 363.64.
    Counts(i64),
    /// The rotor slips by so many electrical turns at once.
    Slip(i32),
    /// Every so many pulses the drive loses one; 0 heals.
    Skip(u32),
    /// A hit bends the mechanism for good: the carriage is so far from where the screw moves it.
    Shift(i64),
    /// A and B of the encoder are exchanged, or not.
    SwappedChannels(bool),
    /// A channel of the encoder is dead; `None` heals.
    DeadChannel(Option<Channel>),
}
