//! What holds from line to line: modes, offsets, parameters, the place of the tool.

use std::collections::BTreeMap;

use crate::block::{Block, mask};
use crate::canon::{Feed, Kind, Motion, Place, Plane, Sense, Speed};
use crate::expression::{Parameter, Variables};
use crate::finding::{Fault, Read, fault};

/// Where motions go.
pub(crate) type Sink<'s> = &'s mut dyn FnMut(Motion);

/// One more than the last numbered parameter.
const PARAMETERS: usize = 5602;
/// From here on, parameters belong to the machine.
const OWN_PARAMETERS: usize = 5001;
/// A call gives so many parameters of its own: #1 to #30.
pub(crate) const LOCALS: usize = 30;
/// So many named parameters.
const NAMES_MAX: usize = 10_000;
/// No place is further from zero, in mm or degrees.
const FAR: f64 = 1e7;
/// The axes, in the order of a place.
pub(crate) const AXES: [u8; 4] = [b'x', b'y', b'z', b'a'];

/// How the feed is given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum FeedMode {
    /// G93.
    InverseTime,
    /// G94.
    #[default]
    PerMinute,
    /// G95.
    PerRevolution,
}

/// The state of the interpreter.
#[derive(Clone, Debug)]
pub(crate) struct Machine {
    /// The line that is executed, from 1.
    pub(crate) line: usize,
    /// What is strange in it, but no error.
    pub(crate) warnings: Vec<Fault>,
    pub(crate) plane: Plane,
    /// G0 to G3, in tenths; none after G80.
    pub(crate) motion: Option<u16>,
    pub(crate) absolute: bool,
    pub(crate) arc_absolute: bool,
    pub(crate) diameter: bool,
    /// mm in a unit of the program.
    pub(crate) unit: f64,
    pub(crate) feed_mode: FeedMode,
    /// In mm.
    pub(crate) feed: f64,
    pub(crate) sense: Sense,
    /// As the S word has it.
    pub(crate) speed: f64,
    /// Constant surface speed, with the most revolutions a minute.
    pub(crate) surface: Option<Option<f64>>,
    pub(crate) coolant: (bool, bool),
    /// Where the tool is, in the program's coordinates.
    pub(crate) at: [f64; 4],
    /// A line with a motion was refused: where the tool is, is not known.
    pub(crate) lost: bool,
    /// G54 is 0.
    pub(crate) system: usize,
    pub(crate) systems: [[f64; 4]; 9],
    /// That of G92, while it applies.
    pub(crate) shift: [f64; 4],
    pub(crate) shifted: bool,
    pub(crate) saved_shift: [f64; 4],
    pub(crate) tool_offset: [f64; 4],
    /// The sum of the three that apply.
    offsets: [f64; 4],
    /// So many motions have come of the program.
    pub(crate) motions: u64,
    pub(crate) home: [[f64; 4]; 2],
    pub(crate) selected_tool: u32,
    pub(crate) tool: u32,
    pub(crate) ended: bool,
    /// Whether parameters are the variables of a Fanuc.
    pub(crate) fanuc: bool,
    /// Empty until a program gives a value to one.
    numbered: Vec<f64>,
    globals: BTreeMap<String, f64>,
    /// Those of the program, and of each call.
    locals: Vec<BTreeMap<String, f64>>,
    /// What the last call has returned.
    pub(crate) returned: Option<f64>,
}

impl Machine {
    pub(crate) fn new(start: Place, home: Place) -> Self {
        Self {
            line: 0,
            warnings: Vec::new(),
            plane: Plane::Xy,
            motion: None,
            absolute: true,
            arc_absolute: false,
            diameter: false,
            unit: 1.0,
            feed_mode: FeedMode::PerMinute,
            feed: 0.0,
            sense: Sense::Off,
            speed: 0.0,
            surface: None,
            coolant: (false, false),
            at: start.axes(),
            lost: false,
            system: 0,
            systems: [[0.0; 4]; 9],
            shift: [0.0; 4],
            shifted: false,
            saved_shift: [0.0; 4],
            tool_offset: [0.0; 4],
            offsets: [0.0; 4],
            motions: 0,
            home: [home.axes(); 2],
            selected_tool: 0,
            tool: 0,
            ended: false,
            fanuc: false,
            numbered: Vec::new(),
            globals: BTreeMap::new(),
            locals: vec![BTreeMap::new()],
            returned: None,
        }
    }

    /// What lies between the program's coordinates and the machine's.
    #[inline]
    pub(crate) const fn offset(&self, axis: usize) -> f64 {
        self.offsets[axis]
    }

    #[inline]
    pub(crate) const fn in_machine(&self, [x, y, z, a]: [f64; 4]) -> [f64; 4] {
        let [of_x, of_y, of_z, of_a] = self.offsets;
        [x + of_x, y + of_y, z + of_z, a + of_a]
    }

    /// An axis word in mm, X as a radius; degrees for A.
    #[inline]
    pub(crate) fn axis_word(&self, block: &Block, axis: usize) -> Option<f64> {
        let value = block.get(AXES[axis])?;
        Some(value * self.scale(axis))
    }

    /// mm in a unit of this axis.
    #[inline]
    pub(crate) fn scale(&self, axis: usize) -> f64 {
        match axis {
            0 if self.diameter => self.unit * 0.5,
            3 => 1.0,
            _ => self.unit,
        }
    }

    pub(crate) fn has_axis(block: &Block) -> bool {
        block.has_any(const { mask(&AXES) })
    }

    /// Moves the origin; the tool stays where it is.
    pub(crate) fn with_offsets(&mut self, change: impl FnOnce(&mut Self)) {
        let machine = self.in_machine(self.at);
        change(self);
        let system = self.systems[self.system];
        self.offsets = core::array::from_fn(|axis| system[axis] + self.shift[axis] + self.tool_offset[axis]);
        self.at = core::array::from_fn(|axis| machine[axis] - self.offset(axis));
    }

    /// Refuses a place that is out of all proportion.
    #[inline]
    pub(crate) fn is_near(place: &[f64]) -> bool {
        place.iter().all(|value| value.abs() < FAR)
    }

    #[inline]
    pub(crate) fn emit(&mut self, kind: Kind, sink: Sink<'_>) {
        self.motions += 1;
        sink(Motion { line: self.line, kind });
    }

    /// A straight motion to a place of the program.
    #[inline]
    pub(crate) fn go(&mut self, to: [f64; 4], feed: Option<Feed>, at: usize, sink: Sink<'_>) -> Read<()> {
        let machine = self.in_machine(to);
        if !Self::is_near(&machine) {
            return fault(at, format!("the place is further than {FAR:e} mm from zero"));
        }
        let to_machine = Place::of(machine);
        let kind = match feed {
            None => Kind::Rapid { to: to_machine },
            Some(feed) => Kind::Feed { to: to_machine, feed },
        };
        self.at = to;
        self.emit(kind, sink);
        Ok(())
    }

    pub(crate) fn warn(&mut self, at: usize, message: impl Into<std::borrow::Cow<'static, str>>) {
        self.warnings.push(Fault { at, message: message.into() });
    }

    pub(crate) fn spindle_speed(&self) -> Speed {
        match self.surface {
            None => Speed::Constant(self.speed),
            Some(most_rpm) => {
                // m a minute, or feet a minute.
                let m_per_min = if self.unit == 1.0 { self.speed } else { self.speed * 0.3048 };
                Speed::Surface { m_per_min, most_rpm }
            }
        }
    }

    /// Gives a value to a parameter.
    pub(crate) fn assign(&mut self, parameter: &Parameter, value: f64, at: usize) -> Read<()> {
        match parameter {
            Parameter::Numbered(number) if self.fanuc && !is_variable(*number) => {
                return fault(at, format!("#{number} is no variable: expected 1 to 33, 100 to 199 or 500 to 999"));
            }
            Parameter::Numbered(number @ 1..OWN_PARAMETERS) => {
                if self.numbered.is_empty() {
                    // A variable without a value is none.
                    self.numbered = vec![if self.fanuc { f64::NAN } else { 0.0 }; OWN_PARAMETERS];
                }
                self.numbered[*number] = value;
            }
            Parameter::Numbered(number) if (1..PARAMETERS).contains(number) => {
                return fault(at, format!("#{number} is not supported yet: a parameter of the machine is only read"));
            }
            Parameter::Numbered(number) => return fault(at, format!("#{number} is out of range")),
            Parameter::Named(_) if self.fanuc => return fault(at, "a variable of a Fanuc has a number, not a name"),
            Parameter::Named(name) => {
                if self.own(name).is_some() {
                    return fault(at, format!("#<{name}> belongs to the machine: it is only read"));
                }
                let globals = name.starts_with('_');
                let names = if globals { Some(&mut self.globals) } else { self.locals.last_mut() };
                if let Some(names) = names {
                    if names.len() >= NAMES_MAX && !names.contains_key(name) {
                        return fault(at, format!("there are more than {NAMES_MAX} named parameters"));
                    }
                    names.insert(name.clone(), value);
                }
            }
        }
        Ok(())
    }

    /// Begins a call; gives the parameters that it hides.
    pub(crate) fn enter(&mut self, arguments: &[f64]) -> [f64; LOCALS] {
        if self.numbered.is_empty() {
            self.numbered = vec![0.0; OWN_PARAMETERS];
        }
        let mut hidden = [0.0; LOCALS];
        hidden.copy_from_slice(&self.numbered[1..=LOCALS]);
        for number in 0..LOCALS {
            self.numbered[number + 1] = arguments.get(number).copied().unwrap_or(0.0);
        }
        self.locals.push(BTreeMap::new());
        hidden
    }

    /// Ends a call.
    pub(crate) fn leave(&mut self, hidden: &[f64; LOCALS]) {
        self.numbered[1..=LOCALS].copy_from_slice(hidden);
        self.locals.pop();
    }

    /// A named parameter of the machine.
    fn own(&self, name: &str) -> Option<f64> {
        let truth = |is: bool| f64::from(u8::from(is));
        let axis = |name: &str| AXES.iter().position(|axis| name.as_bytes() == [*axis]);
        let rest = name.strip_prefix('_')?;
        if let Some(axis) = axis(rest) {
            return Some(self.at[axis] / if axis == 3 { 1.0 } else { self.unit });
        }
        if let Some(axis) = rest.strip_prefix("abs_").and_then(axis) {
            return Some(self.in_machine(self.at)[axis] / if axis == 3 { 1.0 } else { self.unit });
        }
        Some(match rest {
            "vmajor" => 2.9,
            "vminor" | "task" => 0.0,
            "line" => self.line as f64,
            "motion_mode" => self.motion.map_or(800.0, f64::from),
            "plane" => match self.plane {
                Plane::Xy => 170.0,
                Plane::Zx => 180.0,
                Plane::Yz => 190.0,
            },
            "ccomp" => 400.0,
            "metric" => truth(self.unit == 1.0),
            "imperial" => truth(self.unit != 1.0),
            "absolute" => truth(self.absolute),
            "incremental" => truth(!self.absolute),
            "inverse_time" => truth(self.feed_mode == FeedMode::InverseTime),
            "units_per_minute" => truth(self.feed_mode == FeedMode::PerMinute),
            "units_per_rev" => truth(self.feed_mode == FeedMode::PerRevolution),
            "coord_system" => {
                let system = self.system as f64;
                if self.system < 6 { 540.0 + 10.0 * system } else { 585.0 + system }
            }
            "spindle_rpm_mode" => truth(self.surface.is_none()),
            "spindle_css_mode" => truth(self.surface.is_some()),
            "ijk_absolute_mode" => truth(self.arc_absolute),
            "lathe_diameter_mode" => truth(self.diameter),
            "lathe_radius_mode" => truth(!self.diameter),
            "spindle_on" => truth(self.sense != Sense::Off),
            "spindle_cw" => truth(self.sense == Sense::Clockwise),
            "mist" => truth(self.coolant.0),
            "flood" => truth(self.coolant.1),
            "feed" => self.feed / self.unit,
            "rpm" => self.speed,
            "current_tool" => f64::from(self.tool),
            "selected_tool" => f64::from(self.selected_tool),
            "value" => self.returned.unwrap_or(0.0),
            "value_returned" => truth(self.returned.is_some()),
            "call_level" => (self.locals.len() - 1) as f64,
            _ => return None,
        })
    }
}

/// A local or common variable of a Fanuc.
const fn is_variable(number: usize) -> bool {
    matches!(number, 1..=33 | 100..=199 | 500..=999)
}

impl Variables for Machine {
    fn numbered(&self, number: usize) -> Option<f64> {
        let axis = |place: [f64; 4], nth: usize| place.get(nth).copied().unwrap_or(0.0);
        if self.fanuc {
            let value = self.numbered.get(number).copied().unwrap_or(f64::NAN);
            return is_variable(number).then_some(value);
        }
        Some(match number {
            1..OWN_PARAMETERS => self.numbered.get(number).copied().unwrap_or(0.0),
            5161..=5169 => axis(self.home[0], number - 5161),
            5181..=5189 => axis(self.home[1], number - 5181),
            5210 => f64::from(u8::from(self.shifted)),
            5211..=5219 => axis(self.saved_shift, number - 5211),
            5220 => (self.system + 1) as f64,
            5221..=5399 if (number - 5221) % 20 < 9 => axis(self.systems[(number - 5221) / 20], (number - 5221) % 20),
            5400 => f64::from(self.tool),
            5401..=5409 => axis(self.tool_offset, number - 5401) / self.unit,
            5420..=5428 => {
                let nth = number - 5420;
                axis(self.at, nth) / if nth < 3 { self.unit } else { 1.0 }
            }
            _ if (1..PARAMETERS).contains(&number) => 0.0,
            _ => return None,
        })
    }

    fn is_fanuc(&self) -> bool {
        self.fanuc
    }

    fn named(&self, name: &str) -> Option<f64> {
        if self.fanuc {
            return None;
        }
        if name.starts_with('_') {
            return self.globals.get(name).copied().or_else(|| self.own(name));
        }
        self.locals.last().and_then(|names| names.get(name)).copied()
    }
}
