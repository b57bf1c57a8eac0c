//! Canonical motions: what a program asks of a machine, without modes, units and offsets.
//!
//! A motion is printed as one JSON object on one line, and read again from there: [`Motion`]'s `Display` and `FromStr`.

use std::fmt;
use std::str::FromStr;

/// A place of the machine: mm, and degrees for `a`. X is a radius on a lathe.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// Across the lathe's axis: a radius. The first axis elsewhere.
    pub x: f64,
    /// Not on a lathe.
    pub y: f64,
    /// Along the lathe's axis.
    pub z: f64,
    /// Around X, in degrees.
    pub a: f64,
}

impl Place {
    pub(crate) const fn axes(self) -> [f64; 4] {
        [self.x, self.y, self.z, self.a]
    }

    pub(crate) const fn of([x, y, z, a]: [f64; 4]) -> Self {
        Self { x, y, z, a }
    }
}

/// A plane, with its axes in the order that makes a counterclockwise turn positive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Plane {
    /// G17: X, Y.
    #[default]
    Xy,
    /// G18: Z, X.
    Zx,
    /// G19: Y, Z.
    Yz,
}

impl Plane {
    /// The numbers of its axes, and of the axis across it: 0 is X.
    pub(crate) const fn axes(self) -> [usize; 3] {
        match self {
            Self::Xy => [0, 1, 2],
            Self::Zx => [2, 0, 1],
            Self::Yz => [1, 2, 0],
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Xy => "xy",
            Self::Zx => "xz",
            Self::Yz => "yz",
        }
    }
}

/// How fast a cut goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Feed {
    /// mm a minute.
    PerMinute(f64),
    /// mm a revolution of the spindle.
    PerRevolution(f64),
}

/// The sense of an arc, seen against the axis across its plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// G2.
    Clockwise,
    /// G3.
    Counterclockwise,
}

/// The sense of the spindle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sense {
    /// M5.
    #[default]
    Off,
    /// M3.
    Clockwise,
    /// M4.
    Counterclockwise,
}

/// The speed of the spindle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Speed {
    /// Revolutions a minute.
    Constant(f64),
    /// At the tool, in m a minute: the speed of the spindle follows X.
    Surface {
        /// m a minute.
        m_per_min: f64,
        /// Revolutions a minute that the spindle does not exceed.
        most_rpm: Option<f64>,
    },
}

/// What the machine is to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// A move without a cut.
    Rapid {
        /// Where it ends.
        to: Place,
    },
    /// A straight cut.
    Feed {
        /// Where it ends.
        to: Place,
        /// How fast.
        feed: Feed,
    },
    /// A cut along an arc; along a helix, if the axis across the plane moves.
    Arc {
        /// Where it ends.
        to: Place,
        /// Its plane.
        plane: Plane,
        /// The centre: the coordinates of the plane's two axes, in their order.
        centre: [f64; 2],
        /// Its sense.
        turn: Turn,
        /// Turns, the last one included: 1 unless a P word asks for more.
        turns: u32,
        /// How fast.
        feed: Feed,
    },
    /// Waits.
    Dwell {
        /// Seconds.
        seconds: f64,
    },
    /// The spindle turns like this from here on.
    Spindle {
        /// Its sense.
        sense: Sense,
        /// Its speed.
        speed: Speed,
    },
    /// The plane of the arcs from here on.
    Plane(Plane),
    /// The coolant from here on.
    Coolant {
        /// M7.
        mist: bool,
        /// M8.
        flood: bool,
    },
    /// This tool is in use from here on.
    Tool(u32),
    /// Waits for the operator.
    Stop {
        /// M1: only if the operator has chosen so.
        optional: bool,
    },
    /// The program ends.
    End,
}

/// A canonical motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// The line of the program, from 1.
    pub line: usize,
    /// What the machine is to do.
    pub kind: Kind,
}

const NAMES: [char; 4] = ['x', 'y', 'z', 'a'];

impl fmt::Display for Motion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{{\"line\":{}", self.line)?;
        let kind = |f: &mut fmt::Formatter<'_>, kind: &str| write!(f, ",\"kind\":\"{kind}\"");
        let place = |f: &mut fmt::Formatter<'_>, to: Place| {
            NAMES.iter().zip(to.axes()).try_for_each(|(name, value)| write!(f, ",\"{name}\":{value}"))
        };
        let feed_of = |f: &mut fmt::Formatter<'_>, feed: Feed| match feed {
            Feed::PerMinute(feed) => write!(f, ",\"feed\":{feed}"),
            Feed::PerRevolution(feed) => write!(f, ",\"feed_per_rev\":{feed}"),
        };
        match self.kind {
            Kind::Rapid { to } => {
                kind(f, "rapid")?;
                place(f, to)?;
            }
            Kind::Feed { to, feed } => {
                kind(f, "feed")?;
                place(f, to)?;
                feed_of(f, feed)?;
            }
            Kind::Arc { to, plane, centre, turn, turns, feed } => {
                kind(f, "arc")?;
                place(f, to)?;
                let mut centres: Vec<_> = plane.axes().iter().map(|axis| NAMES[*axis]).zip(centre).collect();
                centres.sort_by_key(|(name, _)| *name);
                for (name, value) in centres {
                    write!(f, ",\"c{name}\":{value}")?;
                }
                write!(f, ",\"turn\":\"{}\"", if turn == Turn::Clockwise { "cw" } else { "ccw" })?;
                if turns != 1 {
                    write!(f, ",\"turns\":{turns}")?;
                }
                feed_of(f, feed)?;
            }
            Kind::Dwell { seconds } => {
                kind(f, "dwell")?;
                write!(f, ",\"seconds\":{seconds}")?;
            }
            Kind::Spindle { sense, speed } => {
                kind(f, "spindle")?;
                let sense = match sense {
                    Sense::Off => "off",
                    Sense::Clockwise => "cw",
                    Sense::Counterclockwise => "ccw",
                };
                write!(f, ",\"sense\":\"{sense}\"")?;
                match speed {
                    Speed::Constant(rpm) => write!(f, ",\"rpm\":{rpm}")?,
                    Speed::Surface { m_per_min, most_rpm } => {
                        write!(f, ",\"m_per_min\":{m_per_min}")?;
                        most_rpm.map_or(Ok(()), |most| write!(f, ",\"most_rpm\":{most}"))?;
                    }
                }
            }
            Kind::Plane(plane) => {
                kind(f, "plane")?;
                write!(f, ",\"plane\":\"{}\"", plane.name())?;
            }
            Kind::Coolant { mist, flood } => {
                kind(f, "coolant")?;
                write!(f, ",\"mist\":{},\"flood\":{}", u8::from(mist), u8::from(flood))?;
            }
            Kind::Tool(tool) => {
                kind(f, "tool")?;
                write!(f, ",\"tool\":{tool}")?;
            }
            Kind::Stop { optional } => {
                kind(f, "stop")?;
                write!(f, ",\"optional\":{}", u8::from(optional))?;
            }
            Kind::End => kind(f, "end")?,
        }
        f.write_str("}")
    }
}

/// A line is no canonical motion.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NotCanonical;

impl fmt::Display for NotCanonical {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("expected a canonical motion: one JSON object as 'torno gcode canon' prints it")
    }
}

impl core::error::Error for NotCanonical {}

/// The values of an object whose values are numbers and words.
struct Object<'a>(Vec<(&'a str, &'a str)>);

impl<'a> Object<'a> {
    fn parse(text: &'a str) -> Option<Self> {
        let body = text.trim().strip_prefix('{')?.strip_suffix('}')?;
        let pair = |pair: &'a str| {
            let (name, value) = pair.split_once(':')?;
            let name = name.trim().strip_prefix('"')?.strip_suffix('"')?;
            Some((name, value.trim()))
        };
        // No value holds a comma.
        body.split(',').map(pair).collect::<Option<Vec<_>>>().map(Self)
    }

    fn raw(&self, name: &str) -> Option<&'a str> {
        self.0.iter().find(|pair| pair.0 == name).map(|pair| pair.1)
    }

    fn word(&self, name: &str) -> Option<&'a str> {
        self.raw(name)?.strip_prefix('"')?.strip_suffix('"')
    }

    fn number<T: FromStr>(&self, name: &str) -> Option<T> {
        self.raw(name)?.parse().ok()
    }

    fn finite(&self, name: &str) -> Option<f64> {
        self.number(name).filter(|value: &f64| value.is_finite())
    }

    fn place(&self) -> Option<Place> {
        let of = |name| self.finite(name);
        Some(Place { x: of("x")?, y: of("y")?, z: of("z")?, a: of("a")? })
    }

    fn feed(&self) -> Option<Feed> {
        self.finite("feed").map(Feed::PerMinute).or_else(|| self.finite("feed_per_rev").map(Feed::PerRevolution))
    }

    fn arc(&self) -> Option<Kind> {
        let axis = |name| self.finite(name);
        let (plane, centre) = match (axis("cx"), axis("cy"), axis("cz")) {
            (Some(x), Some(y), None) => (Plane::Xy, [x, y]),
            (Some(x), None, Some(z)) => (Plane::Zx, [z, x]),
            (None, Some(y), Some(z)) => (Plane::Yz, [y, z]),
            _ => return None,
        };
        let turn = match self.word("turn")? {
            "cw" => Turn::Clockwise,
            "ccw" => Turn::Counterclockwise,
            _ => return None,
        };
        let turns = if self.raw("turns").is_some() { self.number("turns")? } else { 1 };
        Some(Kind::Arc { to: self.place()?, plane, centre, turn, turns, feed: self.feed()? })
    }

    fn spindle(&self) -> Option<Kind> {
        let sense = match self.word("sense")? {
            "off" => Sense::Off,
            "cw" => Sense::Clockwise,
            "ccw" => Sense::Counterclockwise,
            _ => return None,
        };
        let surface = |m_per_min| Speed::Surface { m_per_min, most_rpm: self.finite("most_rpm") };
        let speed = self.finite("rpm").map(Speed::Constant).or_else(|| self.finite("m_per_min").map(surface))?;
        Some(Kind::Spindle { sense, speed })
    }

    fn flag(&self, name: &str) -> Option<bool> {
        self.number::<u8>(name).map(|flag| flag != 0)
    }

    fn motion(&self) -> Option<Motion> {
        let kind = match self.word("kind")? {
            "rapid" => Kind::Rapid { to: self.place()? },
            "feed" => Kind::Feed { to: self.place()?, feed: self.feed()? },
            "arc" => self.arc()?,
            "dwell" => Kind::Dwell { seconds: self.finite("seconds")? },
            "spindle" => self.spindle()?,
            "plane" => Kind::Plane(match self.word("plane")? {
                "xy" => Plane::Xy,
                "xz" => Plane::Zx,
                "yz" => Plane::Yz,
                _ => return None,
            }),
            "coolant" => Kind::Coolant { mist: self.flag("mist")?, flood: self.flag("flood")? },
            "tool" => Kind::Tool(self.number("tool")?),
            "stop" => Kind::Stop { optional: self.flag("optional")? },
            "end" => Kind::End,
            _ => return None,
        };
        Some(Motion { line: self.number("line")?, kind })
    }
}

impl FromStr for Motion {
    type Err = NotCanonical;

    fn from_str(text: &str) -> Result<Self, NotCanonical> {
        Object::parse(text).and_then(|object| object.motion()).ok_or(NotCanonical)
    }
}
