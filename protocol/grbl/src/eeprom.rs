//! What the EEPROM holds, as lines: those in which `$$`, `$#` and `$N` tell it, and `$I=`.

use crate::axes::Axes;
use crate::memory::{Memory, SYSTEMS};
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
        kept.into_iter().try_for_each(|(line, kept)| self.keep(kept).map_err(|why| format!("'{line}': {why}")))
    }

    fn keep(&mut self, kept: Kept) -> Result<(), String> {
        match kept {
            Kept::Setting { number, value } => {
                return self.settings.store(number, value).map_err(|code| format!("error:{}", code as u8));
            }
            Kept::Startup { number, block } => self.startup[number] = block,
            Kept::Info(info) => self.info = info,
            Kept::System { system, origin } => self.systems[system] = origin,
            Kept::Home { home, place } => self.homes[home] = place,
        }
        Ok(())
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
        let fits = value.len() <= LONGEST && value.bytes().all(|c| matches!(c, b' '..=b'~'));
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
    use crate::memory::Settings;

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
        assert_eq!(wrong("$133=1"), "'$133=1': error:3");
        assert_eq!(wrong("$20=1"), "'$20=1': error:10");
        assert!(wrong(&format!("$N0={}", "X".repeat(80))).ends_with("expected at most 79 ASCII characters"));
        let mut memory = Memory::new(Settings::with_a());
        assert_eq!(memory.load(["[G54:0,0,0,90]", "$133=360"]), Ok(()));
    }
}
