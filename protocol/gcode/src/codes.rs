//! The G and M words of LinuxCNC, and their modal groups.

use crate::block::{Block, Code};
use crate::finding::{Read, fault};

/// A modal group of G words. A line holds one word of each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Group {
    Motion,
    Plane,
    Distance,
    ArcDistance,
    FeedMode,
    Units,
    Diameter,
    Compensation,
    Length,
    System,
    Path,
    SpindleMode,
    Retract,
    /// Words of one line only: G4, G10, G28, G53, G92…
    Once,
}

const GROUPS: usize = 14;

/// A modal group of M words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MGroup {
    Stop,
    Tool,
    Spindle,
    Coolant,
    Override,
}

const M_GROUPS: usize = 5;

/// The words of a line by their groups.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Codes {
    g: [u16; GROUPS],
    m: [u16; M_GROUPS],
    /// The first M word that is not known.
    pub(crate) unknown: Option<Code>,
}

const NONE: u16 = u16::MAX;

impl Codes {
    #[inline]
    pub(crate) fn g(&self, group: Group) -> Option<u16> {
        Some(self.g[group as usize]).filter(|code| *code != NONE)
    }

    #[inline]
    pub(crate) fn m(&self, group: MGroup) -> Option<u16> {
        Some(self.m[group as usize]).filter(|code| *code != NONE)
    }

    /// Sorts the words of a line.
    #[inline]
    pub(crate) fn of(block: &Block) -> Read<Self> {
        let mut codes = Self { g: [NONE; GROUPS], m: [NONE; M_GROUPS], unknown: None };
        for code in block.codes() {
            let place = if code.letter == b'g' {
                &mut codes.g[group(*code)? as usize]
            } else {
                match m_group(*code)? {
                    Some(group) => &mut codes.m[group as usize],
                    None => {
                        codes.unknown = codes.unknown.or(Some(*code));
                        continue;
                    }
                }
            };
            if *place != NONE {
                let other = Code { tenths: *place, ..*code };
                return fault(code.at, format!("{} and {} exclude one another in a line", other.name(), code.name()));
            }
            *place = code.tenths;
        }
        Ok(codes)
    }
}

impl Code {
    /// As it is written.
    pub(crate) fn name(self) -> String {
        let letter = self.letter.to_ascii_uppercase() as char;
        let (whole, tenth) = (self.tenths / 10, self.tenths % 10);
        if tenth == 0 { format!("{letter}{whole}") } else { format!("{letter}{whole}.{tenth}") }
    }
}

/// Whether a G word, in tenths, is a cycle.
pub(crate) const fn is_cycle(code: u16) -> bool {
    matches!(code, 700 | 710..=712 | 720..=722)
}

#[inline]
fn group(code: Code) -> Read<Group> {
    Ok(match code.tenths {
        0 | 10 | 20 | 30 | 800 => Group::Motion,
        tenths if is_cycle(tenths) => Group::Motion,
        170 | 180 | 190 => Group::Plane,
        900 | 910 => Group::Distance,
        901 | 911 => Group::ArcDistance,
        930 | 940 | 950 => Group::FeedMode,
        200 | 210 => Group::Units,
        70 | 80 => Group::Diameter,
        400 => Group::Compensation,
        430 | 431 | 490 => Group::Length,
        540 | 550 | 560 | 570 | 580 | 590..=593 => Group::System,
        610 | 611 | 640 => Group::Path,
        960 | 970 => Group::SpindleMode,
        980 | 990 => Group::Retract,
        40 | 100 | 280 | 281 | 300 | 301 | 520 | 530 | 920..=923 => Group::Once,
        _ => return not_understood(code),
    })
}

#[cold]
fn not_understood<T>(code: Code) -> Read<T> {
    let what = match code.tenths {
        330 | 331 | 760 => "threads",
        380..=385 => "probing",
        50..=53 | 60..=63 => "splines",
        410 | 411 | 420 | 421 => "the compensation of the tool's nose",
        432 => "further tool offsets",
        730 | 740 | 810 | 820 | 830 | 840 | 850 | 860 | 870 | 880 | 890 => "drilling and tapping cycles",
        171 | 181 | 191 => "planes of U, V and W",
        _ => return fault(code.at, format!("{} is not known", code.name())),
    };
    fault(code.at, format!("{} is not supported yet: {what}", code.name()))
}

#[inline]
fn m_group(code: Code) -> Read<Option<MGroup>> {
    Ok(Some(match code.tenths {
        0 | 10 | 20 | 300 | 600 => MGroup::Stop,
        60 | 610 => MGroup::Tool,
        30 | 40 | 50 => MGroup::Spindle,
        70 | 80 | 90 => MGroup::Coolant,
        480 | 490 | 500 | 510 | 520 | 530 => MGroup::Override,
        190 => return fault(code.at, "M19 is not supported yet: the orientation of the spindle"),
        620..=680 => return fault(code.at, format!("{} is not supported yet: inputs and outputs", code.name())),
        700 | 710 | 720 | 730 => {
            return fault(code.at, format!("{} is not supported yet: modes that are saved", code.name()));
        }
        980 | 990 => {
            return fault(code.at, format!("{} is not supported yet in LinuxCNC's dialect: use O words", code.name()));
        }
        _ => return Ok(None),
    }))
}
