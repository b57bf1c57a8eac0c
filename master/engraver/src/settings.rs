//! The settings of the board.

use torno_grbl::memory::{Memory, Settings};
use torno_grbl_board::Eeprom;
use torno_protocol::settings::{OutOfRange, Range};
use torno_protocol::{choice, settings};
use torno_stepper::{
    AxisSettings, CountScale, DriveSettings, EncoderSettings, Law, LoopSettings, MechanicsSettings, MotorSettings,
};

choice! {
    /// What the other axes do while one corrects.
    pub enum Others {
        /// They stand, so that the path is kept. (Ours.)
        Wait = "wait",
        /// They go on, and the one that corrects follows late.
        GoOn = "go-on",
    }
}

choice! {
    /// How motions become trains of pulses.
    pub enum Motion {
        /// As GRBL plans them: on a line, with ramps and look-ahead. (Ours.)
        Interpolated = "interpolated",
        /// As the paper has them: a timer for each axis, at one frequency, without ramps.
        Sequenced = "sequenced",
    }
}

choice! {
    /// Settings that belong together.
    pub enum Preset {
        /// None.
        None = "none",
        /// As the paper words it: a loop that corrects at once, with the paper's scale, while the other axes go on, and
        /// sequenced motion. It comes before the settings that it names; that the loop is dynamic is the default.
        Paper = "paper",
    }
}

settings! {
    /// The board's settings in the rig file. What all axes have in common stands beside what each has of its own.
    pub struct EngraverSettings where EngraverSettings::check_together {
        /// The time from a reset to the banner.
        boot_ms: u32 = 300, 0..=10_000, "ms", "ours";
        /// How many motions the planner holds.
        blocks: u32 = 15, 1..=1_000, "", "GRBL 1.1h";
        /// How many axes there are: X, Y, Z and, with 4, A, which turns.
        axes: u32 = 4, 3..=4, "", "paper";
        /// How motions become trains of pulses.
        motion: Motion = Motion::Interpolated, Motion::NAMES, "", "ours";
        /// Of sequenced motion: the timers count 120 MHz divided by this, or by more where a train is slow.
        timer_prescaler: u32 = 1, 1..=65_536, "", "STM32F217";
        /// What the other axes do while one corrects.
        others: Others = Others::Wait, Others::NAMES, "", "ours";
        /// While an axis moves, it is told so often where it is.
        tell_ms: u32 = 100, 1..=10_000, "ms", "ours";
        /// What its EEPROM holds at the start. Without a line for it, a setting is as the others here make it.
        eeprom: Eeprom = Eeprom::default(), Lines, "", "ours";
        /// Settings that belong together.
        preset: Preset = Preset::None, Preset::NAMES, "", "ours";
        /// The stepper motors.
        motor: MotorSettings;
        /// The drives.
        drive: DriveSettings;
        /// What the motors move. Each axis has its own travel.
        mechanics: MechanicsSettings;
        /// What the motion is measured with.
        encoder: EncoderSettings;
        /// The loops in the firmware.
        r#loop: LoopSettings;
        /// The axis X.
        x: TravelSettings;
        /// The axis Y.
        y: TravelSettings;
        /// The axis Z.
        z: TravelSettings;
        /// How the axis A turns.
        a: TurnSettings;
    }
}

settings! {
    /// What an axis has of its own.
    pub struct TravelSettings {
        /// The way from one end stop to the other; 0: 300, 200 and 60 mm for X, Y and Z.
        travel_mm: f64 = 0.0, 0.0..=100_000.0, "mm", "ours";
        /// Its fastest speed: `$110` to `$112` are that in mm a minute.
        mm_per_s: f64 = 25.0, 0.000_07..=2_000.0, "mm/s", "paper";
        /// How fast it gains speed: `$120` to `$122`.
        mm_per_s2: f64 = 200.0, 0.01..=100_000.0, "mm/s2", "ours";
    }
}

settings! {
    /// The axis that turns. Its lengths are degrees.
    pub struct TurnSettings {
        /// A revolution of the motor turns it so far: 6:1.
        degrees_per_rev: f64 = 60.0, 0.01..=360.0, "°", "ours";
        /// Its fastest speed.
        degrees_per_s: f64 = 90.0, 0.001..=10_000.0, "°/s", "ours";
        /// How fast it gains speed.
        degrees_per_s2: f64 = 720.0, 0.01..=1_000_000.0, "°/s2", "ours";
    }
}

/// What the EEPROM can hold: a board of three axes refuses what is about the fourth.
struct Lines;

impl Range<Eeprom> for Lines {
    fn accept(&self, found: &Eeprom) -> Result<(), String> {
        let three = found.load(Settings::default());
        three.or_else(|_| found.load(Settings::with_a())).map(|_| ())
    }

    fn text(&self) -> String {
        Eeprom::EXPECTED.to_owned()
    }
}

/// The travel of X, Y and Z, mm. (Ours.)
const TRAVEL_MM: [f64; 3] = [300.0, 200.0, 60.0];
/// The timers that count X, Y, Z and A: TIM3, TIM2, TIM4 and TIM5. The paper gives Y's.
const COUNTER_BITS: [u32; 4] = [16, 32, 16, 32];

impl EngraverSettings {
    /// With what the preset says.
    #[must_use]
    pub fn preset(&self) -> Self {
        let mut settings = self.clone();
        if self.preset == Preset::Paper {
            (settings.motion, settings.others) = (Motion::Sequenced, Others::GoOn);
            settings.r#loop = LoopSettings { law: Law::AtOnce, scale: CountScale::Paper, ..self.r#loop.clone() };
        }
        settings
    }

    /// What each axis is.
    pub fn axis(&self, axis: usize) -> AxisSettings {
        let own = [&self.x, &self.y, &self.z].get(axis).copied();
        let mut settings = match own {
            Some(own) => {
                let travel = if own.travel_mm == 0.0 { TRAVEL_MM[axis] } else { own.travel_mm };
                AxisSettings {
                    mechanics: MechanicsSettings { travel_mm: travel, ..self.mechanics.clone() },
                    encoder: self.encoder.clone(),
                    ..AxisSettings::default()
                }
            }
            None => {
                let mut turns = AxisSettings::rotary();
                turns.mechanics.lead_mm = self.a.degrees_per_rev;
                turns
            }
        };
        settings.encoder.counter_bits = COUNTER_BITS[axis];
        settings.motor = self.motor.clone();
        if own.is_none() {
            // Its motor is one of the same kind: what is mm/s at a screw is so many degrees a second here.
            let turned = settings.mechanics.mm_per_rev() / self.mechanics.mm_per_rev();
            let MotorSettings { corner_mm_per_s, start_mm_per_s, .. } = &mut settings.motor;
            *corner_mm_per_s = (*corner_mm_per_s * turned).min(10_000.0);
            *start_mm_per_s = (*start_mm_per_s * turned).min(10_000.0);
        }
        settings.drive = self.drive.clone();
        settings.control = self.r#loop.clone();
        settings
    }

    /// How fast an axis is at most, mm/s or °/s, and how fast it gains speed.
    fn motion(&self, axis: usize) -> (f64, f64) {
        match [&self.x, &self.y, &self.z].get(axis) {
            Some(own) => (own.mm_per_s, own.mm_per_s2),
            None => (self.a.degrees_per_s, self.a.degrees_per_s2),
        }
    }

    /// What the EEPROM holds at the start. The settings have been checked.
    pub(crate) fn memory(&self) -> Memory {
        self.eeprom.load(self.firmware()).unwrap_or_else(|_| Memory::new(self.firmware()))
    }

    /// The firmware's settings for this machine.
    fn firmware(&self) -> Settings {
        let mut settings = if self.axes == 4 { Settings::with_a() } else { Settings::default() };
        for axis in 0..self.axes as usize {
            let own = self.axis(axis);
            let (speed, acceleration) = self.motion(axis);
            settings.steps_per_mm[axis] = (1.0 / own.scale().pulse_mm()) as f32;
            settings.max_rate[axis] = (speed * 60.0) as f32;
            settings.acceleration[axis] = acceleration as f32;
            settings.max_travel[axis] = own.mechanics.travel_mm as f32;
        }
        settings
    }

    fn check_together(&self) -> Result<(), OutOfRange> {
        let settings = self.preset();
        let eeprom = self.eeprom.load(self.firmware());
        eeprom.map_err(|message| OutOfRange { field: "eeprom".to_owned(), message })?;
        for (axis, name) in ["x", "y", "z", "a"].into_iter().enumerate().take(self.axes as usize) {
            let own = settings.axis(axis);
            own.check().map_err(|mut wrong| {
                // A loop is under its own name here.
                if let Some(rest) = wrong.field.strip_prefix("control.") {
                    wrong.field = format!("loop.{rest}");
                }
                wrong
            })?;
            let field = if axis < 3 { format!("{name}.mm_per_s") } else { "a.degrees_per_s".to_owned() };
            let message = own.check_speed(settings.motion(axis).0);
            message.map_err(|message| OutOfRange { field, message })?;
        }
        Ok(())
    }
}
