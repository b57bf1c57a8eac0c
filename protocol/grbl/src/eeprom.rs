//! What the EEPROM holds, as lines: those in which `$$`, `$#` and `$N` tell it, and `$I=`.

use crate::axes::Axes;
use crate::code::Code;
use crate::memory::{Memory, REAL, SYSTEMS, Settings, WHOLE};
use crate::settings::HOMING;

/// The longest startup line, and the longest text of `$I=`.
const LONGEST: usize = 79;

/// One thing that is kept.
#[derive(Clone, Debug, PartialEq)]
enum Kept {
    Setting { number: u8, value: f32 },
    Startup { number: usize, block: String },
    Info(String),
    System { system: usize, origin: Axes },
    Home { home: usize, place: Axes },
}

impl Memory {
    /// Keeps what the lines say.
    ///
    /// # Errors
    /// What is wrong with the first line that says nothing that could be kept.
    pub fn load<'a>(&mut self, lines: impl IntoIterator<Item = &'a str>) -> Result<(), String> {
        let axes = self.settings.axes;
        let kept = lines.into_iter().map(|line| read(line, axes).map(|kept| (line, kept)));
        let mut kept = kept.collect::<Result<Vec<_>, _>>()?;
        // Soft limits need homing, whose number is the higher one.
        kept.sort_by_key(|(_, kept)| !matches!(kept, Kept::Setting { number: HOMING, .. }));
        kept.into_iter().try_for_each(|(line, kept)| {
            self.keep(kept).map_err(|code| format!("'{line}': {} (error:{})", expected(code), code as u8))
        })
    }

    /// The lines that make a memory that has never been used hold the same.
    pub fn lines(&self) -> Vec<String> {
        let new = Self::new(self.defaults.clone());
        let settings = values(&self.settings).zip(values(&new.settings)).filter(|(now, new)| now != new);
        let settings = settings.map(|((number, value), _)| format!("${number}={value}"));
        let startup = self.startup.iter().enumerate().filter(|(_, block)| !block.is_empty());
        let startup = startup.map(|(number, block)| format!("$N{number}={block}"));
        let info = Some(&self.info).filter(|info| !info.is_empty()).map(|info| format!("$I={info}"));
        let numbers = (54..54 + SYSTEMS).chain([28, 30]);
        let places =
            numbers.zip(self.systems.iter().chain(&self.homes)).filter(|(_, place)| **place != Axes::default());
        let places = places.map(|(number, place)| {
            let values: Vec<String> = place.iter().take(self.settings.axes).map(|value| finite(*value)).collect();
            format!("[G{number}:{}]", values.join(","))
        });
        settings.chain(startup).chain(info).chain(places).collect()
    }

    fn keep(&mut self, kept: Kept) -> Result<(), Code> {
        match kept {
            Kept::Setting { number, value } => return self.settings.store(number, value),
            Kept::Startup { number, block } => self.startup[number] = block,
            Kept::Info(info) => self.info = info,
            Kept::System { system, origin } => self.systems[system] = origin,
            Kept::Home { home, place } => self.homes[home] = place,
        }
        Ok(())
    }
}

/// All settings by their numbers, as text that is read as the same value again.
fn values(settings: &Settings) -> impl Iterator<Item = (u8, String)> {
    let whole = WHOLE.iter().zip(settings.whole).map(|((number, _), value)| (*number, value.to_string()));
    let real = REAL.iter().zip(settings.real).map(|((number, ..), value)| (*number, finite(value)));
    let Settings { steps_per_mm, max_rate, acceleration, max_travel, .. } = *settings;
    let axes = [(100, steps_per_mm), (110, max_rate), (120, acceleration), (130, max_travel)];
    let count = settings.axes;
    let axes = axes.into_iter().flat_map(move |(first, values)| {
        (first..).zip(values).take(count).map(|(number, value)| (number, finite(value)))
    });
    whole.chain(real).chain(axes)
}

/// A number; what is none, or has no end, as a number that comes near.
fn finite(value: f32) -> String {
    let value = if value.is_nan() { 0.0 } else { value.clamp(-f32::MAX, f32::MAX) };
    value.to_string()
}

/// What a line should have been that cannot be kept.
const fn expected(code: Code) -> &'static str {
    match code {
        Code::NegativeValue => "expected no negative value",
        Code::StepPulseTooShort => "expected at least 3 us",
        Code::SoftLimitsNeedHoming => "expected $22=1 beside it, as soft limits need homing",
        _ => "expected a setting that the controller has",
    }
}

fn read(line: &str, axes: usize) -> Result<Kept, String> {
    let unknown = || format!("'{line}' is nothing that is kept: expected a line like $110=500, $N0=G20, [G54:0,0,0]");
    let line = line.trim();
    if let Some(place) = line.strip_prefix('[').and_then(|line| line.strip_suffix(']')) {
        let (name, values) = place.split_once(':').ok_or_else(unknown)?;
        let number: usize = name.strip_prefix('G').and_then(|name| name.parse().ok()).ok_or_else(unknown)?;
        let place = read_place(values, axes).ok_or_else(|| format!("'{line}': expected {axes} numbers"))?;
        return match number {
            28 | 30 => Ok(Kept::Home { home: usize::from(number == 30), place }),
            _ if (54..54 + SYSTEMS).contains(&number) => Ok(Kept::System { system: number - 54, origin: place }),
            _ => Err(unknown()),
        };
    }
    let (name, value) = line.strip_prefix('$').and_then(|line| line.split_once('=')).ok_or_else(unknown)?;
    let text = || {
        let fits = value.len() <= LONGEST && value.bytes().all(|c| matches!(c, b' '..=0x7f));
        if fits { Ok(value.to_owned()) } else { Err(format!("'{line}': expected at most {LONGEST} ASCII characters")) }
    };
    match name {
        "N0" | "N1" => Ok(Kept::Startup { number: usize::from(name == "N1"), block: text()? }),
        "I" => Ok(Kept::Info(text()?)),
        _ => {
            let number = name.parse().map_err(|_| unknown())?;
            let value = read_number(value).ok_or_else(|| format!("'{line}': expected a number"))?;
            Ok(Kept::Setting { number, value })
        }
    }
}

fn read_place(values: &str, axes: usize) -> Option<Axes> {
    let values = values.split(',').map(read_number).collect::<Option<Vec<f32>>>().filter(|all| all.len() == axes)?;
    Some(core::array::from_fn(|axis| values.get(axis).copied().unwrap_or_default()))
}

fn read_number(text: &str) -> Option<f32> {
    text.trim().parse().ok().filter(|number: &f32| number.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_the_lines_say_is_kept() {
        let mut memory = Memory::default();
        let lines = ["$20=1", "$22=1", "$110=512.5", "$N1=G20", "$I=bench 3", "[G55:1.5,-2,0]", "[G30:0,0,7]"];
        assert_eq!(memory.load(lines), Ok(()));
        assert_eq!((memory.settings.max_rate[0], memory.settings.soft_limits()), (512.5, true));
        assert_eq!((memory.systems[1], memory.homes[1]), ([1.5, -2.0, 0.0, 0.0], [0.0, 0.0, 7.0, 0.0]));
        assert_eq!((memory.startup[1].as_str(), memory.info.as_str()), ("G20", "bench 3"));
    }

    #[test]
    fn what_cannot_be_kept_is_told() {
        let wrong = |line: &str| Memory::default().load([line]).unwrap_err();
        let nothing = |line: &str| wrong(line).contains("is nothing that is kept");
        for line in ["", "ok", "G54", "[G92:0,0,0]", "[TLO:0]", "[G60:0,0,0]", "$x=1", "$300=1", "$N2=G20", "[G54]"] {
            assert!(nothing(line), "{line}: {}", wrong(line));
        }
        assert_eq!(wrong("[G54:0,0]"), "'[G54:0,0]': expected 3 numbers");
        assert_eq!(wrong("[G54:0,0,nan]"), "'[G54:0,0,nan]': expected 3 numbers");
        assert_eq!(wrong("$110=fast"), "'$110=fast': expected a number");
        assert_eq!(wrong("$133=1"), "'$133=1': expected a setting that the controller has (error:3)");
        assert_eq!(wrong("$20=1"), "'$20=1': expected $22=1 beside it, as soft limits need homing (error:10)");
        assert_eq!(wrong("$0=2"), "'$0=2': expected at least 3 us (error:6)");
        assert_eq!(wrong("$100=-1"), "'$100=-1': expected no negative value (error:4)");
        assert!(wrong(&format!("$N0={}", "X".repeat(80))).ends_with("expected at most 79 ASCII characters"));
        let mut memory = Memory::new(Settings::with_a());
        assert_eq!(memory.load(["[G54:0,0,0,90]", "$133=360"]), Ok(()));
    }

    #[test]
    fn nothing_has_to_be_told_of_a_memory_that_has_never_been_used() {
        assert_eq!(Memory::new(Settings::of_lathe()).lines(), [""; 0]);
        let mut memory = Memory::default();
        let lines = ["$12=0.0025", "$110=512.5", "$N1=G20", "$I=BENCH", "[G55:1.5,-2,0.0001]", "[G30:0,0,7]"];
        assert_eq!(memory.load(lines), Ok(()));
        assert_eq!(memory.lines(), lines);
    }

    #[test]
    fn what_has_no_end_is_kept_as_the_largest_number() {
        let mut memory = Memory::default();
        memory.settings.steps_per_mm[0] = f32::INFINITY;
        memory.systems[0] = [f32::NAN, f32::NEG_INFINITY, 0.0, 0.0];
        let mut other = Memory::default();
        assert_eq!(other.load(memory.lines().iter().map(String::as_str)), Ok(()));
        assert_eq!((other.settings.steps_per_mm[0], other.systems[0]), (f32::MAX, [0.0, f32::MIN, 0.0, 0.0]));
    }

    proptest! {
        #[test]
        fn another_memory_holds_the_same_after_its_lines(
            whole: [u8; WHOLE.len()],
            real in prop::array::uniform7(0.0..1e9f32),
            axes in prop::collection::vec(0.0..1e9f32, 16),
            places in prop::collection::vec(-1e6..1e6f32, 32),
            startup in "[A-Z0-9.]{0,20}",
            info in "[!-\x7f]{0,76}",
        ) {
            let mut memory = Memory::new(Settings { lathe: true, ..Settings::with_a() });
            for (number, value) in WHOLE.iter().map(|(number, _)| *number).rev().zip(whole) {
                // What cannot be stored is refused.
                memory.settings.store(number, f32::from(value)).ok();
            }
            memory.settings.real = real;
            let Settings { steps_per_mm, max_rate, acceleration, max_travel, .. } = &mut memory.settings;
            let all = [steps_per_mm, max_rate, acceleration, max_travel];
            all.into_iter().flatten().zip(axes).for_each(|(place, value)| *place = value);
            let all = memory.systems.iter_mut().chain(&mut memory.homes);
            all.flatten().zip(places).for_each(|(place, value)| *place = value);
            (memory.startup, memory.info) = ([String::new(), startup], info);
            let mut other = Memory::new(memory.defaults.clone());
            prop_assert_eq!(other.load(memory.lines().iter().map(String::as_str)), Ok(()));
            prop_assert_eq!(other, memory);
        }
    }
}
