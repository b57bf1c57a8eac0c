//! The settings of the board.

use core::fmt;

use serde::{Deserialize, Serialize};
use torno_grbl::memory::{Memory, Settings};
use torno_planner::{Feed, Infeed, Scale};
use torno_protocol::settings;
use torno_protocol::settings::Range;

/// Lines of which each tells something that the EEPROM holds.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Eeprom(Vec<String>);

impl fmt::Display for Eeprom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.0)
    }
}

impl Eeprom {
    /// What its lines may be.
    pub const EXPECTED: &str = "lines of $$, $# and $N, and $I=";

    /// What is kept, with these settings where no line says something else.
    ///
    /// # Errors
    /// The line that cannot be, and what was expected.
    pub fn load(&self, settings: Settings) -> Result<Memory, String> {
        let mut memory = Memory::new(settings);
        memory.load(self.0.iter().map(String::as_str)).map(|()| memory)
    }
}

/// What a lathe's EEPROM can hold.
struct Lines;

impl Range<Eeprom> for Lines {
    fn accept(&self, found: &Eeprom) -> Result<(), String> {
        found.load(Settings::of_lathe()).map(|_| ())
    }

    fn text(&self) -> String {
        Eeprom::EXPECTED.to_owned()
    }
}

settings! {
    /// The board's settings in the rig file. What the machine is like must be what its boards are: the defaults are
    /// those of the built-in lathe.
    pub struct GrblSettings {
        /// The time from a reset to the banner.
        boot_ms: u32 = 300, 0..=10_000, "ms", "ours";
        /// How many motions the planner holds.
        blocks: u32 = 15, 1..=1_000, "", "GRBL 1.1h";
        /// A frame takes no longer than this, so that a hold does not.
        hold_s: f64 = 5.0, 0.1..=1_000.0, "s", "ours";
        /// A frame of a jog takes no longer than this.
        jog_s: f64 = 1.0, 0.1..=1_000.0, "s", "ours";
        /// A frame without an answer is given up so long after twice the time that its way takes. The main motor, which
        /// coasts, may take 20 s more than that.
        patience_s: f64 = 60.0, 1.0..=1_000.0, "s", "ours";
        /// What its EEPROM holds at the start. Without a line for it, a setting is as the others here make it.
        eeprom: Eeprom = Eeprom::default(), Lines, "", "ours";
        /// The axis across the bar: X.
        x: XSettings;
        /// The axis along the bar: Z.
        z: ZSettings;
        /// The main motor.
        spindle: SpindleRange;
    }
}

settings! {
    /// The axis across the bar.
    pub struct XSettings {
        /// The slots of its encoder in a mm.
        slots_per_mm: f64 = 5.625, 0.001..=100_000.0, "1/mm", "§4";
        /// Its only speed.
        mm_per_min: f64 = 16.0, 0.001..=100_000.0, "mm/min", "§4";
        /// It goes so much further than the edge at which it stops, in slots.
        overrun_slots: f64 = 0.0825, 0.0..=1.0, "slots", "ours";
        /// Its travel.
        travel_mm: f64 = 160.0, 1.0..=100_000.0, "mm", "§4";
    }
}

settings! {
    /// The axis along the bar.
    pub struct ZSettings {
        /// The counts of its encoder in a mm.
        counts_per_mm: f64 = 450.0, 0.001..=100_000.0, "1/mm", "§3.2";
        /// Its sampling period.
        sample_ms: f64 = 30.0, 1.0..=1_000.0, "ms", "§3.2";
        /// How fast it gains speed.
        mm_per_s2: f64 = 7.407, 0.001..=100_000.0, "mm/s2", "ours";
        /// Its travel.
        travel_mm: f64 = 160.0, 1.0..=100_000.0, "mm", "ours";
    }
}

settings! {
    /// What the main motor can do.
    pub struct SpindleRange {
        /// Its highest speed.
        most_rpm: u32 = 4_000, 20..=5_100, "rpm", "§3.1";
        /// Its lowest speed.
        least_rpm: u32 = 200, 20..=5_100, "rpm", "§3.1";
    }
}

impl GrblSettings {
    /// What the numbers in a frame are worth. The ends of travel are the machine's to find.
    pub(crate) fn scale(&self) -> Scale {
        let feed = Feed {
            mm_per_count: 1.0 / self.z.counts_per_mm,
            sample_s: self.z.sample_ms / 1_000.0,
            reach: i64::MAX / 2,
        };
        let infeed = Infeed {
            mm_per_slot: 1.0 / self.x.slots_per_mm,
            mm_per_s: self.x.mm_per_min / 60.0,
            overrun: self.x.overrun_slots,
            reach: i64::MAX / 2,
        };
        Scale { feed, infeed }
    }

    /// What the EEPROM holds at the start. The settings have been checked.
    pub(crate) fn memory(&self) -> Memory {
        self.eeprom.load(self.firmware()).unwrap_or_else(|_| Memory::new(self.firmware()))
    }

    /// The firmware's settings for this machine; Y is as the firmware has it.
    fn firmware(&self) -> Settings {
        let mut settings = Settings::of_lathe();
        settings.steps_per_mm[0] = self.x.slots_per_mm as f32;
        settings.steps_per_mm[2] = self.z.counts_per_mm as f32;
        settings.max_rate[0] = self.x.mm_per_min as f32;
        settings.max_rate[2] = self.scale().feed.most() as f32;
        settings.acceleration[2] = self.z.mm_per_s2 as f32;
        settings.max_travel[0] = self.x.travel_mm as f32;
        settings.max_travel[2] = self.z.travel_mm as f32;
        settings.set_real(30, self.spindle.most_rpm as f32);
        settings.set_real(31, self.spindle.least_rpm as f32);
        settings
    }
}
