//! What the numbers in a frame are worth on the lathe's boards: for whoever plans frames.

use torno_dspic::DspicSettings;
use torno_planner::{Feed, Infeed};
use torno_protocol::lathe::Slave;
use torno_slaves::{DepthSettings, TransverseSettings};

use crate::kinds::{KindError, read, with};

/// The axes that a board moves, each with the place of its motor on the board.
#[derive(Clone, Copy, Debug, Default)]
pub struct Axes {
    /// The axis along the bar.
    pub feed: Option<(u8, Feed)>,
    /// The axis across it.
    pub infeed: Option<(u8, Infeed)>,
}

/// The axes that a board of that kind with these settings (TOML) moves.
///
/// # Errors
/// [`KindError`] if there is no such kind, or its settings are wrong.
pub fn axes(kind: &str, settings: &str) -> Result<Axes, KindError> {
    with(kind, settings, |_, settings| {
        Ok(match kind {
            "transverse" => {
                let settings = read(settings, TransverseSettings::check)?;
                Axes { feed: Some((0, feed(&settings))), infeed: None }
            }
            "depth" => {
                let settings = read(settings, DepthSettings::check)?;
                Axes { feed: None, infeed: Some((0, infeed(&settings))) }
            }
            "dspic" => {
                let settings = read(settings, DspicSettings::check)?;
                let place =
                    |slave: Slave| Slave::ALL.iter().position(|other| *other == slave).unwrap_or_default() as u8;
                Axes {
                    feed: Some((place(Slave::Transverse), feed(&settings.transverse))),
                    infeed: Some((place(Slave::Depth), infeed(&settings.depth))),
                }
            }
            _ => Axes::default(),
        })
    })
}

fn feed(settings: &TransverseSettings) -> Feed {
    Feed {
        mm_per_count: 1.0 / settings.counts(1.0),
        sample_s: settings.sample_s(),
        reach: (settings.counts(settings.plant.travel_mm) / 2.0) as i64,
    }
}

fn infeed(settings: &DepthSettings) -> Infeed {
    Infeed {
        mm_per_slot: 1.0 / settings.slots_per_mm(),
        mm_per_s: settings.speed_mm_per_s() * settings.drive.supply,
        overrun: settings.overrun_slots(),
        reach: (settings.plant.travel_mm * settings.slots_per_mm() / 2.0) as i64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(found: f64, expected: f64) {
        assert!((found - expected).abs() < 1e-9, "{found}, not {expected}");
    }

    #[test]
    fn a_frame_is_worth_what_the_boards_make_of_it() {
        let feed = axes("transverse", "").unwrap().feed.unwrap().1;
        close(feed.mm_per_count, 1.0 / 450.0);
        close(feed.unit(), 40.0 / 9.0);
        assert_eq!(feed.reach, 36_000);
        let infeed = axes("depth", "").unwrap().infeed.unwrap().1;
        close(infeed.mm_per_slot, 16.0 / 90.0);
        close(infeed.mm_per_s * 60.0, 16.0);
        close(infeed.overrun, 1.5 * 0.055);
        assert_eq!(infeed.reach, 450);
    }

    #[test]
    fn other_settings_and_another_board_have_other_worths() {
        let feed = axes("transverse", "plant.pitch_mm = 1\ncontroller.sample_ms = 15").unwrap().feed.unwrap().1;
        close(feed.mm_per_count, 1.0 / 900.0);
        close(feed.unit(), 40.0 / 9.0);
        let both = axes("dspic", "depth.plant.rpm = 4").unwrap();
        close(both.feed.unwrap().1.unit(), 40.0 / 9.0);
        close(both.infeed.unwrap().1.mm_per_s * 60.0, 8.0);
        assert_eq!((both.feed.unwrap().0, both.infeed.unwrap().0), (1, 2));
        assert!(axes("spindle", "").unwrap().feed.is_none() && axes("depht", "").is_err());
    }
}
