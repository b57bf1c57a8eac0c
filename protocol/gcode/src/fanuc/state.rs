//! What a Fanuc's lines share.

use crate::block::{Block, mask};
use crate::fanuc::corner::Corner;
use crate::finding::{Read, fault};
use crate::machine::Machine;

/// What holds from line to line beside the modes of the machine.
#[derive(Clone, Debug, Default)]
pub(crate) struct State {
    /// The most revolutions a minute: G50 S.
    pub(crate) most_rpm: Option<f64>,
    /// G90 and G94: where their cuts end, and by how much they begin elsewhere.
    pub(crate) box_to: [Option<f64>; 2],
    pub(crate) box_taper: f64,
    /// G71 and G72: the depth of a cut, in mm; how far the tool is lifted; whether they are given.
    pub(crate) depth: Option<f64>,
    pub(crate) lift: f64,
    /// G73: how far the first pass stays away, and how many passes.
    pub(crate) away: [f64; 2],
    pub(crate) passes: Option<u32>,
    /// The cut that is held back until the next one is known.
    pub(crate) corner: Option<Corner>,
}

/// Where X, Z, U and W lead; none if the line has none of them.
pub(crate) fn target(machine: &Machine, block: &Block) -> Read<Option<[f64; 4]>> {
    let mut to = machine.at;
    for (axis, absolute, relative) in [(0, b'x', b'u'), (2, b'z', b'w')] {
        let scale = machine.scale(axis);
        match (block.get(absolute), block.get(relative)) {
            (Some(_), Some(_)) => {
                let [a, b] = [absolute, relative].map(|letter| letter.to_ascii_uppercase() as char);
                return fault(block.at(relative), format!("{a} and {b} exclude one another in a line"));
            }
            (Some(value), None) => to[axis] = value * scale,
            (None, Some(value)) => to[axis] += value * scale,
            (None, None) => {}
        }
    }
    Ok(block.has_any(const { mask(b"xzuw") }).then_some(to))
}

/// Whether a line names both axes; none if it names none.
pub(crate) const fn names_axes(block: &Block) -> Option<bool> {
    let [x, z] = [block.has_any(mask(b"xu")), block.has_any(mask(b"zw"))];
    if x || z { Some(x && z) } else { None }
}
