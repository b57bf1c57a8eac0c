//! What outlives a reset: the firmware's EEPROM.

use crate::axes::{self, Axes};

/// How many coordinate systems there are: G54 to G59.
pub(crate) const SYSTEMS: usize = 6;

/// The settings, `$0` to `$132`, in the units that they are printed in; to `$133` with an A axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// How many axes there are.
    pub(crate) axes: usize,
    /// Whether `$32=2` is the lathe mode. (Ours.) If not, `$32` is a switch as the firmware has it.
    pub(crate) lathe: bool,
    /// `$0` to `$6`, `$10`, `$13`, `$20` to `$23`, `$26`, `$32`: whole numbers. In the order of [`WHOLE`].
    pub(crate) whole: [u8; WHOLE.len()],
    /// `$11`, `$12`, `$24`, `$25`, `$27`, `$30`, `$31`. In the order of [`REAL`].
    pub(crate) real: [f32; REAL.len()],
    /// `$100` to `$103`: steps a mm, of A a degree.
    pub steps_per_mm: Axes,
    /// `$110` to `$113`: mm a minute.
    pub max_rate: Axes,
    /// `$120` to `$123`: mm/s².
    pub acceleration: Axes,
    /// `$130` to `$133`: mm.
    pub max_travel: Axes,
}

/// The numbers of the settings that are whole, and their defaults.
pub(crate) const WHOLE: [(u8, u8); 15] = [
    (0, 10),
    (1, 25),
    (2, 0),
    (3, 0),
    (4, 0),
    (5, 0),
    (6, 0),
    (10, 1),
    (13, 0),
    (20, 0),
    (21, 0),
    (22, 0),
    (23, 0),
    (26, 250),
    (32, 0),
];

/// The numbers of the settings that are not, their defaults and their decimals.
pub(crate) const REAL: [(u8, f32, usize); 7] =
    [(11, 0.01, 3), (12, 0.002, 3), (24, 25.0, 3), (25, 500.0, 3), (27, 1.0, 3), (30, 1000.0, 0), (31, 0.0, 0)];

impl Default for Settings {
    fn default() -> Self {
        Self {
            axes: 3,
            lathe: false,
            whole: WHOLE.map(|(_, default)| default),
            real: REAL.map(|(_, default, _)| default),
            steps_per_mm: [250.0; axes::MOST],
            max_rate: [500.0; axes::MOST],
            acceleration: [10.0; axes::MOST],
            max_travel: [200.0; axes::MOST],
        }
    }
}

impl Settings {
    /// The defaults of a firmware for X, Y, Z and A.
    pub fn with_a() -> Self {
        Self { axes: axes::MOST, ..Self::default() }
    }

    /// The defaults of a firmware that has a lathe mode.
    pub fn of_lathe() -> Self {
        Self { lathe: true, ..Self::default() }
    }
}

/// The settings, the coordinate systems, and what else is kept.
#[derive(Clone, Debug, PartialEq)]
pub struct Memory {
    /// `$$`.
    pub settings: Settings,
    /// G54 to G59: their origins in machine coordinates.
    pub(crate) systems: [Axes; SYSTEMS],
    /// G28 and G30: places in machine coordinates.
    pub(crate) homes: [Axes; 2],
    /// `$N0` and `$N1`.
    pub(crate) startup: [String; 2],
    /// What `$I=` has stored.
    pub(crate) info: String,
    /// What `$RST` restores.
    pub(crate) defaults: Settings,
}

impl Memory {
    /// That of a board with these settings that has never been used.
    pub fn new(settings: Settings) -> Self {
        Self {
            defaults: settings.clone(),
            settings,
            systems: Default::default(),
            homes: Default::default(),
            startup: Default::default(),
            info: String::new(),
        }
    }

    /// `$RST=$`
    pub(crate) fn restore_settings(&mut self) {
        self.settings = self.defaults.clone();
    }

    /// `$RST=#`
    pub(crate) fn restore_places(&mut self) {
        self.systems = Default::default();
        self.homes = Default::default();
    }

    /// `$RST=*`
    pub(crate) fn restore(&mut self) {
        *self = Self::new(self.defaults.clone());
    }
}

impl Default for Memory {
    fn default() -> Self {
        Self::new(Settings::default())
    }
}
