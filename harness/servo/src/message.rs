//! What is to be said about a program, in English and in the sheet's Polish.

/// What is wrong with a program.
#[derive(Clone, Debug, PartialEq)]
pub enum Problem {
    /// A symbol that is none of `p`, `k`, `x`, `t`, or not where it should be (§3.1).
    UnknownParameter,
    /// The element lacks a parameter: these (§3.1).
    MissingParameter(Vec<char>),
    /// p and k have different signs (§3.1).
    SignChange,
    /// What follows the symbol is no number.
    NotANumber,
    /// A number that no stand has a use for.
    OutOfRange,
    /// A parameter that is there twice.
    Repeated(char),
    /// A parameter too many: `t` beside `p` and `k`.
    Surplus(char),
    /// t is not above 0.
    NoTime,
    /// An acceleration over no way.
    NoWay,
    /// An acceleration from 0 to 0.
    NoSpeed,
    /// x and the speeds have different signs.
    WrongSense,
    /// So many increments a tick cannot be told in a byte.
    TooManyCounts(f64),
    /// The whole takes longer than can be.
    TooLong,
    /// There is no `e`.
    NoEnd,
    /// There is nothing before the `e`.
    Empty,
    /// It leaves the travel: to this place, in mm, where so much is the end.
    BeyondTravel {
        /// Where it goes, in mm.
        to_mm: f64,
        /// The length of the travel, in mm.
        travel_mm: f64,
    },
    /// Faster than the motor can.
    TooFast {
        /// The speed asked for, in mm/s.
        speed_mm_s: f64,
        /// The motor's, in mm/s.
        greatest_mm_s: f64,
    },
    /// Text behind the `e`, which is ignored.
    BehindEnd,
}

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// There is no program.
    Error,
    /// There is one, and Servo v1.0 would have run it; but it cannot be driven as it stands.
    Danger,
    /// It does no harm.
    Note,
}

/// The language of messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Language {
    /// English.
    #[default]
    English,
    /// Polish; the sheet's own messages to the letter.
    Polish,
}

/// Something found in a program.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// The line, from 1.
    pub line: usize,
    /// The character in the line, from 1.
    pub column: usize,
    /// What it is about, as it stands there.
    pub word: String,
    /// What is wrong.
    pub problem: Problem,
}

impl Problem {
    /// How bad it is.
    pub const fn severity(&self) -> Severity {
        match self {
            Self::BehindEnd => Severity::Note,
            Self::BeyondTravel { .. } | Self::TooFast { .. } => Severity::Danger,
            _ => Severity::Error,
        }
    }
}

impl Finding {
    /// The message. Servo v1.0 had three; the others are ours.
    pub fn message(&self, language: Language) -> String {
        match language {
            Language::English => self.english(),
            Language::Polish => self.polish(),
        }
    }

    fn english(&self) -> String {
        let (line, word) = (self.line, &self.word);
        match &self.problem {
            Problem::UnknownParameter => format!("unknown parameter '{word}' in line {line}: expected p, k, x or t"),
            Problem::MissingParameter(lacking) => format!("line {line} lacks {}", listed(lacking, " and ")),
            Problem::SignChange => format!("the speed changes its sign in line {line}"),
            Problem::NotANumber => format!("expected a number after the symbol in line {line}, found '{word}'"),
            Problem::OutOfRange => format!("'{word}' in line {line}: expected a number from -1000000 to 1000000"),
            Problem::Repeated(symbol) => format!("{symbol} is there twice in line {line}"),
            Problem::Surplus(symbol) => format!("{symbol} is too many in line {line}: p, k and x give the time"),
            Problem::NoTime => format!("expected a time above 0 in line {line}, found '{word}'"),
            Problem::NoWay => format!("line {line} accelerates over no way"),
            Problem::NoSpeed => format!("line {line} goes from speed 0 to speed 0: it would never end"),
            Problem::WrongSense => format!("x and the speeds have different signs in line {line}"),
            Problem::TooManyCounts(most) => {
                format!("line {line} is too fast: expected up to {most:.4} mm/s, which a byte can tell")
            }
            Problem::TooLong => format!("the program takes more than a day in line {line}"),
            Problem::NoEnd => format!("expected a line with 'e' after line {line}: the end of the program is missing"),
            Problem::Empty => format!("expected an element before the 'e' in line {line}, found none"),
            Problem::BeyondTravel { to_mm, travel_mm } => {
                format!("line {line} goes to {} mm: expected 0 to {} mm", short(*to_mm), short(*travel_mm))
            }
            Problem::TooFast { speed_mm_s, greatest_mm_s } => {
                let (speed, greatest) = (short(*speed_mm_s), short(*greatest_mm_s));
                format!("line {line} goes at {speed} mm/s: the motor can do {greatest} mm/s")
            }
            Problem::BehindEnd => format!("what follows 'e' is ignored, from line {line} on"),
        }
    }

    fn polish(&self) -> String {
        let (line, word) = (self.line, &self.word);
        match &self.problem {
            // The first three are the sheet's. Only one of them has the word "numer".
            Problem::UnknownParameter => format!("w linii {line} napotkano nieznany parametr"),
            Problem::MissingParameter(_) => format!("w linii {line} brak wymaganego parametru"),
            Problem::SignChange => format!("w linii numer {line} szybkość zmienia znak"),
            Problem::NotANumber => format!("w linii {line} oczekiwano liczby po symbolu, jest '{word}'"),
            Problem::OutOfRange => format!("w linii {line} liczba poza zakresem -1000000…1000000: '{word}'"),
            Problem::Repeated(symbol) => format!("w linii {line} parametr {symbol} jest powtórzony"),
            Problem::Surplus(symbol) => format!("w linii {line} parametr {symbol} jest zbędny"),
            Problem::NoTime => format!("w linii {line} czas musi być większy od zera"),
            Problem::NoWay => format!("w linii {line} przyspieszenie bez drogi"),
            Problem::NoSpeed => format!("w linii {line} obie szybkości są równe zeru"),
            Problem::WrongSense => format!("w linii {line} znak drogi nie zgadza się ze znakiem szybkości"),
            Problem::TooManyCounts(most) => {
                format!("w linii {line} zbyt duża szybkość: najwyżej {most:.4} mm/sek mieści się w bajcie")
            }
            Problem::TooLong => format!("w linii {line} program trwa dłużej niż dobę"),
            Problem::NoEnd => format!("po linii {line} brak znaku końca programu 'e'"),
            Problem::Empty => format!("w linii {line} program jest pusty"),
            Problem::BeyondTravel { to_mm, travel_mm } => {
                let (to, travel) = (short(*to_mm), short(*travel_mm));
                format!("w linii {line} ruch poza zakres 0…{travel} mm: do {to} mm")
            }
            Problem::TooFast { speed_mm_s, greatest_mm_s } => {
                let (speed, greatest) = (short(*speed_mm_s), short(*greatest_mm_s));
                format!("w linii {line} szybkość {speed} mm/sek przekracza możliwości silnika: {greatest} mm/sek")
            }
            Problem::BehindEnd => format!("od linii {line} tekst po znaku 'e' jest pomijany"),
        }
    }
}

fn listed(symbols: &[char], and: &str) -> String {
    symbols.iter().map(char::to_string).collect::<Vec<_>>().join(and)
}

/// A number without useless zeros.
fn short(value: f64) -> String {
    let text = format!("{value:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}
