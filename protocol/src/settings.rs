//! Settings of boards: each is declared once, with its default, its range, its unit and where it comes from.
//!
//! The macros make the struct that a rig file is read into, its default, its check, and a table of it for people.

use core::fmt::Display;
use core::ops::RangeInclusive;

/// A setting that is out of its range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {message}")]
pub struct OutOfRange {
    /// The setting, with the tables that it is in, and dots between.
    pub field: String,
    /// What was expected, and what was found.
    pub message: String,
}

impl OutOfRange {
    /// The same of a setting in this table.
    #[must_use]
    pub fn within(self, table: &str) -> Self {
        Self { field: format!("{}.{}", plain(table), self.field), ..self }
    }
}

/// A setting as it is declared.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Setting {
    /// Its name, with the tables that it is in, and dots between.
    pub name: String,
    /// What it is.
    pub about: String,
    /// Its unit; empty if it has none.
    pub unit: &'static str,
    /// What it may be.
    pub range: String,
    /// What it is if a rig file does not say.
    pub default: String,
    /// Where the default comes from: a paper's section or equation, a data sheet, or "ours".
    pub source: &'static str,
}

impl Setting {
    /// The same in this table.
    #[must_use]
    pub fn within(self, table: &str) -> Self {
        Self { name: format!("{}.{}", plain(table), self.name), ..self }
    }
}

/// A field's name as a rig file has it: one that is a word of Rust's own has a mark in the code.
fn plain(field: &str) -> &str {
    field.trim_start_matches("r#")
}

/// What a setting may be.
pub trait Range<T> {
    /// Accepts a value.
    ///
    /// # Errors
    /// What was expected, and what was found.
    fn accept(&self, found: &T) -> Result<(), String>;

    /// For people.
    fn text(&self) -> String;
}

/// Not-a-number and the infinities lie outside every range.
impl<T: Display + PartialOrd> Range<T> for RangeInclusive<T> {
    fn accept(&self, found: &T) -> Result<(), String> {
        if self.contains(found) { Ok(()) } else { Err(format!("expected {}, found {found}", Range::<T>::text(self))) }
    }

    fn text(&self) -> String {
        format!("{} to {}", self.start(), self.end())
    }
}

/// The names of a [`choice!`](crate::choice): reading a file finds what is none of them.
impl<T> Range<T> for &[&str] {
    fn accept(&self, _: &T) -> Result<(), String> {
        Ok(())
    }

    fn text(&self) -> String {
        self.join(", ")
    }
}

/// Declares a table of settings.
///
/// A field is a number or a [`choice!`](crate::choice) with its default, range, unit and source, or a table of its own.
/// `where RULE` behind the name is a function that checks what one setting says of another:
///
/// ```
/// use torno_protocol::settings;
///
/// settings! {
///     /// A motor.
///     pub struct Motor {
///         /// The time constant.
///         tau_s: f64 = 2.8, 0.01..=1_000.0, "s", "§4";
///     }
/// }
///
/// settings! {
///     /// A board.
///     pub struct Board {
///         /// What it drives.
///         motor: Motor;
///     }
/// }
///
/// let board = Board { motor: Motor { tau_s: 0.0 } };
/// assert_eq!(board.check().unwrap_err().to_string(), "motor.tau_s: expected 0.01 to 1000, found 0");
/// ```
#[macro_export]
macro_rules! settings {
    ($(#[$meta:meta])* $vis:vis struct $name:ident $(where $rule:path)? {
        $(
            $(#[doc = $about:literal])+
            $field:ident: $type:ty $(= $default:expr, $range:expr, $unit:literal, $source:literal)?;
        )+
    }) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq, ::serde::Serialize, ::serde::Deserialize)]
        #[serde(default, deny_unknown_fields)]
        $vis struct $name {
            $(
                $(#[doc = $about])+
                $(
                    #[doc = concat!(
                        "\n\n`", stringify!($range), "` ", $unit,
                        "; default `", stringify!($default), "` (", $source, ")."
                    )]
                )?
                $vis $field: $type,
            )+
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $crate::settings!(@default $($default)?)),+ }
            }
        }

        impl $name {
            /// Checks every setting's range, and what one says of another.
            ///
            /// # Errors
            /// The first setting that is out of its range.
            $vis fn check(&self) -> Result<(), $crate::settings::OutOfRange> {
                $($crate::settings!(@check self $field $($range)?)?;)+
                $($rule(self)?;)?
                Ok(())
            }

            /// The settings as they are declared, in their order.
            $vis fn declared() -> Vec<$crate::settings::Setting> {
                [$($crate::settings!(@declare $name $field $type [$($about)+] $(, $range, $unit, $source)?)),+].concat()
            }
        }
    };
    (@default) => { Default::default() };
    (@default $default:expr) => { $default };
    (@check $self:ident $field:ident) => {
        $self.$field.check().map_err(|wrong| wrong.within(stringify!($field)))
    };
    (@check $self:ident $field:ident $range:expr) => {
        $crate::settings::Range::accept(&$range, &$self.$field)
            .map_err(|message| $crate::settings::OutOfRange { field: stringify!($field).to_owned(), message })
    };
    (@declare $name:ident $field:ident $type:ty [$($about:literal)+]) => {
        <$type>::declared().into_iter().map(|setting| setting.within(stringify!($field))).collect::<Vec<_>>()
    };
    (@declare $name:ident $field:ident $type:ty [$($about:literal)+], $range:expr, $unit:literal, $source:literal) => {
        vec![$crate::settings::Setting {
            name: stringify!($field).to_owned(),
            about: concat!($($about),+).trim().to_owned(),
            unit: $unit,
            range: $crate::settings::Range::<$type>::text(&$range),
            default: $name::default().$field.to_string(),
            source: $source,
        }]
    };
}

/// Declares a setting that is one of several, each with the name that a rig file gives it. The first one is the
/// default.
#[macro_export]
macro_rules! choice {
    ($(#[$meta:meta])* $vis:vis enum $name:ident {
        $(#[$first_meta:meta])* $first:ident = $first_text:literal,
        $($(#[$other_meta:meta])* $other:ident = $other_text:literal,)*
    }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ::serde::Serialize, ::serde::Deserialize)]
        $vis enum $name {
            $(#[$first_meta])*
            #[default]
            #[serde(rename = $first_text)]
            $first,
            $($(#[$other_meta])* #[serde(rename = $other_text)] $other,)*
        }

        impl $name {
            /// The names in a rig file.
            $vis const NAMES: &[&str] = &[$first_text, $($other_text),*];
        }

        impl ::core::fmt::Display for $name {
            fn fmt(&self, f: &mut ::core::fmt::Formatter<'_>) -> ::core::fmt::Result {
                f.write_str(match self {
                    Self::$first => $first_text,
                    $(Self::$other => $other_text,)*
                })
            }
        }
    };
}

#[cfg(test)]
mod tests {
    choice! {
        /// A law.
        enum Law {
            /// Of three terms.
            Pid = "pid",
            /// None.
            NoLoop = "no-loop",
        }
    }

    settings! {
        /// A controller.
        struct Controller {
            /// The law.
            law: Law = Law::Pid, Law::NAMES, "", "ours";
            /// The gain,
            /// and more.
            k: f64 = 0.5, 0.0..=1_000.0, "V", "Eq. 7";
            /// The period.
            period_ms: u32 = 30, 5..=1_000, "ms", "§4";
        }
    }

    settings! {
        /// A board.
        struct Board {
            /// The firmware.
            controller: Controller;
        }
    }

    #[test]
    fn the_ends_belong_to_the_range_and_what_is_no_number_does_not() {
        let checked = |k: f64, period_ms: u32| {
            let controller = Controller { k, period_ms, ..Controller::default() };
            Board { controller }.check().map_err(|wrong| wrong.to_string())
        };
        assert_eq!(Board::default().check(), Ok(()));
        assert_eq!([checked(0.0, 5), checked(1_000.0, 1_000)], [Ok(()), Ok(())]);
        for (k, period_ms, expected) in [
            (-0.5, 5, "controller.k: expected 0 to 1000, found -0.5"),
            (1_000.5, 5, "controller.k: expected 0 to 1000, found 1000.5"),
            (f64::NAN, 5, "controller.k: expected 0 to 1000, found NaN"),
            (f64::INFINITY, 5, "controller.k: expected 0 to 1000, found inf"),
            (1.0, 4, "controller.period_ms: expected 5 to 1000, found 4"),
            (1.0, 1_001, "controller.period_ms: expected 5 to 1000, found 1001"),
        ] {
            assert_eq!(checked(k, period_ms), Err(expected.to_owned()));
        }
    }

    #[test]
    fn the_table_for_people_says_all_that_is_declared() {
        let declared: Vec<String> = Board::declared()
            .into_iter()
            .map(|s| [s.name, s.about, s.unit.to_owned(), s.range, s.default, s.source.to_owned()].join("|"))
            .collect();
        assert_eq!(
            declared,
            [
                "controller.law|The law.||pid, no-loop|pid|ours",
                "controller.k|The gain, and more.|V|0 to 1000|0.5|Eq. 7",
                "controller.period_ms|The period.|ms|5 to 1000|30|§4",
            ]
        );
    }
}
