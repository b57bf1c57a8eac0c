//! The board.

use torno_grbl::Abilities;
use torno_grbl_board::Board;
use torno_protocol::clock::Clock;
use torno_protocol::time::Span;

use crate::machine::Machine;
use crate::settings::EngraverSettings;

/// The board.
pub type Engraver = Board<Machine>;

/// The board as at power-on, its carriages in mid-travel. The settings must have been
/// [checked](EngraverSettings::check).
pub fn engraver(settings: &EngraverSettings, clock: Clock) -> Engraver {
    let settings = settings.preset();
    let abilities = Abilities {
        axes: [true, true, true, settings.axes == 4],
        counterclockwise: true,
        single_homing: false,
        holds_slowly: false,
    };
    let boot = Span::from_millis(u64::from(settings.boot_ms));
    Board::wired(boot, settings.memory(), abilities, Machine::new(&settings), clock)
}
