//! The bytes that the firmware takes out of the stream as they come.

/// A command of one byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Realtime {
    /// `?`
    Status,
    /// `!`
    Hold,
    /// `~`
    Resume,
    /// 0x18
    Reset,
    /// 0x84
    Door,
    /// 0x85
    JogCancel,
    /// 0x90 to 0x97, 0x99 to 0x9d
    Override(Override),
    /// 0x9e
    SpindleStop,
    /// 0xa0
    Flood,
}

/// A change of an override. Percent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Override {
    /// The feed becomes 100 %.
    FeedReset,
    /// The feed changes by this.
    Feed(i8),
    /// Rapids become this.
    Rapid(u8),
    /// The spindle becomes 100 %.
    SpindleReset,
    /// The spindle changes by this.
    Spindle(i8),
}

/// What becomes of a byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// It is a command.
    Command(Realtime),
    /// It goes into the receive buffer.
    Buffered,
    /// It vanishes.
    Ignored,
}

/// What becomes of a byte that arrives.
pub const fn fate(byte: u8) -> Fate {
    Fate::Command(match byte {
        b'?' => Realtime::Status,
        b'!' => Realtime::Hold,
        b'~' => Realtime::Resume,
        0x18 => Realtime::Reset,
        0x84 => Realtime::Door,
        0x85 => Realtime::JogCancel,
        0x90 => Realtime::Override(Override::FeedReset),
        0x91 => Realtime::Override(Override::Feed(10)),
        0x92 => Realtime::Override(Override::Feed(-10)),
        0x93 => Realtime::Override(Override::Feed(1)),
        0x94 => Realtime::Override(Override::Feed(-1)),
        0x95 => Realtime::Override(Override::Rapid(100)),
        0x96 => Realtime::Override(Override::Rapid(50)),
        0x97 => Realtime::Override(Override::Rapid(25)),
        0x99 => Realtime::Override(Override::SpindleReset),
        0x9a => Realtime::Override(Override::Spindle(10)),
        0x9b => Realtime::Override(Override::Spindle(-10)),
        0x9c => Realtime::Override(Override::Spindle(1)),
        0x9d => Realtime::Override(Override::Spindle(-1)),
        0x9e => Realtime::SpindleStop,
        0xa0 => Realtime::Flood,
        0x00..=0x7f => return Fate::Buffered,
        0x80..=0xff => return Fate::Ignored,
    })
}
