//! The settings by their numbers.

use crate::axes::Axes;
use crate::code::Code;
use crate::memory::{REAL, Settings, WHOLE};
use crate::number;

/// `$10`: what a status shows.
const STATUS: u8 = 10;
const INCHES: u8 = 13;
const SOFT_LIMITS: u8 = 20;
const HARD_LIMITS: u8 = 21;
pub(crate) const HOMING: u8 = 22;
const MODE: u8 = 32;
/// These are switches: whatever is not 0 is 1.
const SWITCHES: [u8; 7] = [4, 5, 6, INCHES, SOFT_LIMITS, HARD_LIMITS, HOMING];
/// The shortest step pulse, us.
const PULSE_LEAST: u8 = 3;

impl Settings {
    fn whole(&self, number: u8) -> u8 {
        WHOLE.iter().zip(self.whole).find(|((n, _), _)| *n == number).map_or(0, |(_, value)| value)
    }

    fn real(&self, number: u8) -> f32 {
        REAL.iter().zip(self.real).find(|((n, ..), _)| *n == number).map_or(0.0, |(_, value)| value)
    }

    /// Sets one of the whole numbers. Says whether there is such a setting.
    pub fn set_whole(&mut self, number: u8, value: u8) -> bool {
        let found = WHOLE.iter().position(|(n, _)| *n == number);
        found.map(|place| self.whole[place] = value).is_some()
    }

    /// Sets one of the others below `$100`. Says whether there is such a setting.
    pub fn set_real(&mut self, number: u8, value: f32) -> bool {
        let found = REAL.iter().position(|(n, ..)| *n == number);
        found.map(|place| self.real[place] = value).is_some()
    }

    /// Whether a status shows the machine's position, and not the program's.
    pub(crate) fn shows_machine_position(&self) -> bool {
        self.whole(STATUS) & 1 != 0
    }

    /// Whether a status shows the room in the buffers.
    pub(crate) fn shows_buffers(&self) -> bool {
        self.whole(STATUS) & 2 != 0
    }

    pub(crate) fn reports_inches(&self) -> bool {
        self.whole(INCHES) != 0
    }

    /// Whether the words of a lathe are known.
    pub(crate) fn lathe_mode(&self) -> bool {
        self.whole(MODE) == 2
    }

    pub(crate) fn soft_limits(&self) -> bool {
        self.whole(SOFT_LIMITS) != 0
    }

    pub(crate) fn homes(&self) -> bool {
        self.whole(HOMING) != 0
    }

    /// `$11`: mm.
    pub fn junction_deviation(&self) -> f32 {
        self.real(11)
    }

    /// `$12`: mm.
    pub fn arc_tolerance(&self) -> f32 {
        self.real(12)
    }

    /// `$23`: towards which end each axis homes: whether it is the negative one.
    pub fn homes_negative(&self) -> Axes<bool> {
        core::array::from_fn(|axis| self.whole(23) >> axis & 1 != 0)
    }

    /// `$24` and `$25`: how fast an end is found exactly, and looked for, mm a minute.
    pub fn homing_rates(&self) -> (f32, f32) {
        (self.real(24), self.real(25))
    }

    /// `$27`: how far a homed axis goes back, mm.
    pub fn pull_off(&self) -> f32 {
        self.real(27)
    }

    /// The spindle's fastest and slowest, rpm.
    pub(crate) fn spindle_rpm(&self) -> (f32, f32) {
        (self.real(30), self.real(31))
    }

    /// Whether a place, in machine coordinates, lies outside the travel: that is on the negative side.
    pub(crate) fn is_beyond(&self, place: Axes) -> bool {
        place.iter().zip(self.max_travel).any(|(place, travel)| *place > 0.0 || *place < -travel)
    }

    /// `$number=value`
    pub(crate) fn store(&mut self, number: u8, value: f32) -> Result<(), Code> {
        if value < 0.0 {
            return Err(Code::NegativeValue);
        }
        if number >= 100 {
            let (kind, axis) = ((number - 100) / 10, usize::from(number % 10));
            let axes = match kind {
                0 => &mut self.steps_per_mm,
                1 => &mut self.max_rate,
                2 => &mut self.acceleration,
                3 => &mut self.max_travel,
                _ => return Err(Code::InvalidStatement),
            };
            *axes[..self.axes].get_mut(axis).ok_or(Code::InvalidStatement)? = value;
            return Ok(());
        }
        if self.set_real(number, value) {
            return Ok(());
        }
        // What does not fit into a byte is cut off.
        let byte = number::unsigned(value) as u8;
        match number {
            0 if byte < PULSE_LEAST => return Err(Code::StepPulseTooShort),
            SOFT_LIMITS if byte != 0 && !self.homes() => return Err(Code::SoftLimitsNeedHoming),
            HOMING if byte == 0 => _ = self.set_whole(SOFT_LIMITS, 0),
            _ => {}
        }
        let value = if SWITCHES.contains(&number) { u8::from(byte != 0) } else { byte };
        // 1, the laser mode, is accepted and does nothing.
        let value = if number == MODE { value.min(1 + u8::from(self.lathe)) } else { value };
        self.set_whole(number, value).then_some(()).ok_or(Code::InvalidStatement)
    }

    /// The lines of `$$`.
    pub(crate) fn lines(&self) -> Vec<String> {
        let whole = WHOLE.iter().zip(self.whole).map(|((number, _), value)| (*number, value.to_string()));
        let real = REAL.iter().zip(self.real);
        let real = real.map(|((number, _, decimals), value)| (*number, number::print(value, *decimals)));
        let axes = [(100, self.steps_per_mm), (110, self.max_rate), (120, self.acceleration), (130, self.max_travel)];
        let axes = axes.iter().flat_map(|(first, values)| {
            (*first..).zip(values).take(self.axes).map(|(number, value)| (number, number::print(*value, 3)))
        });
        let mut all: Vec<(u8, String)> = whole.chain(real).chain(axes).collect();
        all.sort();
        all.into_iter().map(|(number, value)| format!("${number}={value}")).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_stored_where_they_are() {
        let mut settings = Settings::default();
        assert_eq!(settings.store(100, 5.625), Ok(()));
        assert_eq!(settings.store(132, 160.0), Ok(()));
        assert_eq!(settings.steps_per_mm[0], 5.625);
        assert_eq!(settings.max_travel[2], 160.0);
        for number in [7, 9, 14, 33, 99, 103, 133, 140, 255] {
            assert_eq!(settings.store(number, 1.0), Err(Code::InvalidStatement), "${number}");
        }
        assert_eq!(settings.store(1, 300.0), Ok(()));
        assert_eq!(settings.whole(1), 44);
    }

    #[test]
    fn soft_limits_go_with_homing() {
        let mut settings = Settings::default();
        assert_eq!(settings.store(20, 1.0), Err(Code::SoftLimitsNeedHoming));
        assert_eq!(settings.store(22, 1.0), Ok(()));
        assert_eq!(settings.store(20, 1.0), Ok(()));
        assert_eq!(settings.store(22, 0.0), Ok(()));
        assert!(!settings.soft_limits());
    }
}
