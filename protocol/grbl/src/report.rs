//! What the firmware says.

use crate::axes::{A, Axes, LETTERS};
use crate::machine::Overrides;
use crate::memory::{Memory, SYSTEMS, Settings};
use crate::modal::{FeedMode, Modal, Motion, Spindle};
use crate::number;
use crate::state::State;

const INCH_PER_MM: f32 = 0.039_370_08;
/// How often a status shows the origin and the overrides: each so many of them, while nothing moves and while it does.
const ORIGIN_EACH: (u8, u8) = (10, 30);
const OVERRIDES_EACH: (u8, u8) = (10, 20);

pub(crate) const BANNER: &str = "\r\nGrbl 1.1h ['$' for help]";
pub(crate) const HELP: &str = "[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]";

/// Messages in square brackets.
pub(crate) mod message {
    pub(crate) const RESET: &str = "Reset to continue";
    pub(crate) const LOCKED: &str = "'$H'|'$X' to unlock";
    pub(crate) const UNLOCKED: &str = "Caution: Unlocked";
    pub(crate) const ENABLED: &str = "Enabled";
    pub(crate) const DISABLED: &str = "Disabled";
    pub(crate) const DOOR: &str = "Check Door";
    pub(crate) const END: &str = "Pgm End";
    pub(crate) const DEFAULTS: &str = "Restoring defaults";
    pub(crate) const SPINDLE: &str = "Restoring spindle";
    pub(crate) const SLEEP: &str = "Sleeping";
}

/// Lengths in the units of the reports.
#[derive(Clone, Copy)]
struct Units {
    inches: bool,
    axes: usize,
}

impl Units {
    fn of(settings: &Settings) -> Self {
        Self { inches: settings.reports_inches(), axes: settings.axes }
    }

    fn length(self, mm: f32) -> String {
        if self.inches { number::print(mm * INCH_PER_MM, 4) } else { number::print(mm, 3) }
    }

    /// One for each axis; A is in degrees.
    fn axes(self, axes: Axes) -> String {
        let each = axes.iter().take(self.axes).enumerate();
        let each = each.map(|(axis, value)| if axis == A { number::print(*value, 3) } else { self.length(*value) });
        each.collect::<Vec<_>>().join(",")
    }

    fn rate(self, mm_per_min: f32) -> String {
        if self.inches { number::print(mm_per_min * INCH_PER_MM, 1) } else { number::print(mm_per_min, 0) }
    }
}

/// `$G`
pub(crate) fn modes(modal: &Modal, settings: &Settings) -> String {
    let motion = match modal.motion {
        Motion::Rapid => "0".to_owned(),
        Motion::Linear => "1".to_owned(),
        Motion::Arc { clockwise } => if clockwise { "2" } else { "3" }.to_owned(),
        Motion::Probe(probe) => format!("38.{}", 2 + u8::from(probe.no_error) + 2 * u8::from(probe.away)),
        Motion::None => "80".to_owned(),
    };
    let spindle = match modal.spindle {
        Spindle::Off => 5,
        Spindle::Clockwise => 3,
        Spindle::Counterclockwise => 4,
    };
    let units = Units::of(settings);
    let (feed_mode, feed) = match modal.feed_mode {
        FeedMode::PerMinute => (94, units.rate(modal.feed)),
        FeedMode::InverseTime => (93, units.rate(modal.feed)),
        FeedMode::PerTurn => (95, units.length(modal.feed)),
    };
    let lathe = if settings.lathe_mode() {
        format!(" G{} G{}", if modal.diameter { 7 } else { 8 }, if modal.surface { 96 } else { 97 })
    } else {
        String::new()
    };
    format!(
        "[GC:G{motion} G{} G{} G{} G{} G{feed_mode}{lathe} M{spindle} M{} T{} F{feed} S{}]",
        54 + modal.system,
        17 + modal.plane,
        if modal.inches { 20 } else { 21 },
        if modal.incremental { 91 } else { 90 },
        if modal.flood { 8 } else { 9 },
        modal.tool,
        number::print(modal.speed, 0),
    )
}

/// `$#`
pub(crate) fn places(modal: &Modal, memory: &Memory, probed: &str) -> Vec<String> {
    let units = Units::of(&memory.settings);
    let system = |n: usize| format!("[G{}:{}]", 54 + n, units.axes(memory.systems[n]));
    let mut lines: Vec<String> = (0..SYSTEMS).map(system).collect();
    lines.push(format!("[G28:{}]", units.axes(memory.homes[0])));
    lines.push(format!("[G30:{}]", units.axes(memory.homes[1])));
    lines.push(format!("[G92:{}]", units.axes(modal.shift)));
    lines.push(format!("[TLO:{}]", units.length(modal.tool_length)));
    lines.push(probed.to_owned());
    lines
}

/// Where the probe has been: it has met nothing.
pub(crate) fn probed(place: Axes, settings: &Settings) -> String {
    format!("[PRB:{}:0]", Units::of(settings).axes(place))
}

/// `$I`
pub(crate) fn info(memory: &Memory, single_homing: bool, planner: usize, receive: usize) -> [String; 2] {
    let options = if single_homing { "VH" } else { "V" };
    [format!("[VER:1.1h.20190830:{}]", memory.info), format!("[OPT:{options},{planner},{receive}]")]
}

/// What a status shows of the moment.
pub(crate) struct Status<'a> {
    pub(crate) state: State,
    /// It stands, or the door's work is done.
    pub(crate) complete: bool,
    /// It is about to go on after the door.
    pub(crate) restoring: bool,
    pub(crate) settings: &'a Settings,
    pub(crate) position: Axes,
    pub(crate) origin: Axes,
    /// Of the planner and of the receive buffer.
    pub(crate) room: (usize, usize),
    /// mm a minute.
    pub(crate) rate: f32,
    /// As the spindle is driven, rpm.
    pub(crate) speed: f32,
    pub(crate) spindle: Spindle,
    pub(crate) flood: bool,
    pub(crate) ends: Axes<bool>,
    pub(crate) overrides: Overrides,
}

/// What is shown now and then only.
#[derive(Clone, Debug, Default)]
pub(crate) struct Cadence {
    origin: u8,
    overrides: u8,
}

impl Cadence {
    /// The next status shows the origin.
    pub(crate) const fn origin_moved(&mut self) {
        self.origin = 0;
    }

    /// The next status shows the overrides.
    pub(crate) const fn overrides_changed(&mut self) {
        self.overrides = 0;
    }

    /// Whether this status shows the origin, and whether the overrides.
    fn due(&mut self, busy: bool) -> (bool, bool) {
        let each = |(idle, moving): (u8, u8)| if busy { moving - 1 } else { idle - 1 };
        let origin = self.origin == 0;
        if origin {
            self.origin = each(ORIGIN_EACH);
            // They come with the next one.
            self.overrides = self.overrides.max(1);
        } else {
            self.origin -= 1;
        }
        let overrides = self.overrides == 0;
        self.overrides = if overrides { each(OVERRIDES_EACH) } else { self.overrides - 1 };
        (origin, overrides)
    }
}

impl Status<'_> {
    fn name(&self) -> &'static str {
        match self.state {
            State::Idle => "Idle",
            State::Run => "Run",
            State::Hold if self.complete => "Hold:0",
            State::Hold => "Hold:1",
            State::Jog => "Jog",
            State::Home => "Home",
            State::Alarm => "Alarm",
            State::Check => "Check",
            State::Door if self.restoring => "Door:3",
            State::Door if self.complete => "Door:0",
            State::Door => "Door:2",
            State::Sleep => "Sleep",
        }
    }

    /// The line.
    pub(crate) fn line(&self, cadence: &mut Cadence) -> String {
        let units = Units::of(self.settings);
        let busy = matches!(self.state, State::Run | State::Hold | State::Jog | State::Home | State::Door);
        let mut parts = vec![self.name().to_owned()];
        parts.push(if self.settings.shows_machine_position() {
            format!("MPos:{}", units.axes(self.position))
        } else {
            let program = core::array::from_fn(|axis| self.position[axis] - self.origin[axis]);
            format!("WPos:{}", units.axes(program))
        });
        if self.settings.shows_buffers() {
            parts.push(format!("Bf:{},{}", self.room.0, self.room.1));
        }
        let rate = if busy { self.rate } else { 0.0 };
        parts.push(format!("FS:{},{}", units.rate(rate), number::print(self.speed, 0)));
        let ends = LETTERS.iter().zip(self.ends).filter(|(_, end)| *end);
        let ends: String = ends.map(|(axis, _)| char::from(*axis)).collect();
        if !ends.is_empty() {
            parts.push(format!("Pn:{ends}"));
        }
        let (origin, overrides) = cadence.due(busy);
        if origin {
            parts.push(format!("WCO:{}", units.axes(self.origin)));
        }
        if overrides {
            let Overrides { feed, rapid, spindle } = self.overrides;
            parts.push(format!("Ov:{feed},{rapid},{spindle}"));
            let turns = match self.spindle {
                _ if self.speed == 0.0 => "",
                Spindle::Off => "",
                Spindle::Clockwise => "S",
                Spindle::Counterclockwise => "C",
            };
            let flood = if self.flood { "F" } else { "" };
            if !turns.is_empty() || self.flood {
                parts.push(format!("A:{turns}{flood}"));
            }
        }
        format!("<{}>", parts.join("|"))
    }
}
