//! From text to a program, with everything that is wrong with it at once.

use crate::element::Element;
use crate::message::{Finding, Problem, Severity};
use crate::motion::{Motion, Program};
use crate::{Language, TICKS_PER_S};

/// No number is larger; the travel is 425 mm.
const NUMBER_MAX: f64 = 1e6;
/// No program takes longer, in s: a day.
const SECONDS_MAX: f64 = 86_400.0;
/// What rounding may add to a place or a speed, as a share of the limit.
const ROUNDING: f64 = 1e-9;
/// The increments that a signed byte can tell, in counts a tick.
const INCREMENT_MAX: f64 = 127.0;

/// What a program must keep to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Counts per mm: above 0. Default 125 (§2.3: 250 pulses a revolution, 2 mm a revolution).
    pub counts_per_mm: f64,
    /// The travel, from 0, in mm. Default 425 (§2.3).
    pub travel_mm: f64,
    /// The motor's greatest speed, in mm/s. Default 50/3: 500 rpm at 2 mm (§2.2; §2.3 says "about 17").
    pub speed_mm_s: f64,
    /// Where the program begins, in mm. Default 0.
    pub from_mm: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { counts_per_mm: 125.0, travel_mm: 425.0, speed_mm_s: 50.0 / 3.0, from_mm: 0.0 }
    }
}

/// What came of a text.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Compiled {
    /// The program, unless there is an error.
    pub program: Option<Program>,
    /// Everything found, in the order of lines.
    pub findings: Vec<Finding>,
}

impl Compiled {
    /// What Servo v1.0 says at the end.
    pub const fn verdict(&self, language: Language) -> &'static str {
        match (language, self.program.is_some()) {
            (Language::English, true) => "compilation complete",
            (Language::English, false) => "compilation aborted",
            (Language::Polish, true) => "kompilacja kompletna",
            (Language::Polish, false) => "kompilacja przerwana",
        }
    }

    /// Whether the stand can drive it: it is a program, and keeps to the limits.
    pub fn can_be_driven(&self) -> bool {
        self.findings.iter().all(|finding| finding.problem.severity() == Severity::Note)
    }
}

/// Compiles a program.
pub fn compile(text: &str, limits: &Limits) -> Compiled {
    let mut compiler =
        Compiler { limits, findings: Vec::new(), motions: Vec::new(), seconds: 0.0, mm: 0.0, lost: false };
    let ended = compiler.lines(text);
    let Compiler { findings, motions, .. } = &mut compiler;
    let lines = text.lines().count().max(1);
    let mut tell =
        |line, problem, word: &str| findings.push(Finding { line, column: 1, word: word.to_owned(), problem });
    match ended {
        None => tell(lines, Problem::NoEnd, text.lines().last().unwrap_or_default().trim_end()),
        // Lines that are wrong have been told; they are no emptiness.
        Some((line, column)) if motions.is_empty() && findings.is_empty() => {
            findings.push(Finding { line, column, word: "e".to_owned(), problem: Problem::Empty });
        }
        Some(_) => {}
    }
    let broken = findings.iter().any(|finding| finding.problem.severity() == Severity::Error);
    let program = (!broken).then(|| Program { motions: core::mem::take(motions) });
    Compiled { program, findings: compiler.findings }
}

struct Compiler<'a> {
    limits: &'a Limits,
    findings: Vec<Finding>,
    motions: Vec<Motion>,
    /// Where the next element begins.
    seconds: f64,
    mm: f64,
    /// An element is missing: where the others go is not known.
    lost: bool,
}

/// A word of a line.
#[derive(Clone, Copy)]
struct Word<'a> {
    text: &'a str,
    /// From 1, in characters.
    column: usize,
}

/// A parameter that is there.
#[derive(Clone, Copy)]
struct Parameter<'a> {
    symbol: char,
    value: f64,
    word: Word<'a>,
}

impl Compiler<'_> {
    /// Takes the lines up to the `e`; gives its line and its column.
    fn lines(&mut self, text: &str) -> Option<(usize, usize)> {
        // Editors of the sheet's time and system begin no file with a mark; today's do.
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut lines = (1..).zip(text.lines());
        while let Some((number, line)) = lines.next() {
            let words = words(line);
            match words[..] {
                [] => {}
                [Word { text: "e", column }] => {
                    if let Some((line, text)) = lines.find(|(_, line)| !line.trim().is_empty()) {
                        self.tell(line, 1, text.trim_end(), Problem::BehindEnd);
                    }
                    return Some((number, column));
                }
                _ => match self.element(number, line, &words) {
                    Some(element) => self.place(number, line, element),
                    None => self.lost = true,
                },
            }
        }
        None
    }

    fn tell(&mut self, line: usize, column: usize, word: &str, problem: Problem) {
        self.findings.push(Finding { line, column, word: word.to_owned(), problem });
    }

    fn tell_word(&mut self, line: usize, word: Word<'_>, problem: Problem) {
        self.tell(line, word.column, word.text, problem);
    }

    /// About a whole line.
    fn tell_line(&mut self, number: usize, line: &str, problem: Problem) {
        let text = line.trim();
        let column = line.chars().take_while(|c| c.is_whitespace()).count() + 1;
        self.tell(number, column, text, problem);
    }

    /// The element in a line, if nothing is wrong with it.
    fn element(&mut self, number: usize, line: &str, words: &[Word<'_>]) -> Option<Element> {
        let before = self.findings.len();
        let mut found: Vec<Parameter<'_>> = Vec::with_capacity(3);
        let mut unreadable: Vec<char> = Vec::new();
        for word in words {
            match parameter(*word) {
                Ok(parameter) if found.iter().any(|other| other.symbol == parameter.symbol) => {
                    self.tell_word(number, *word, Problem::Repeated(parameter.symbol));
                }
                Ok(parameter) => found.push(parameter),
                Err(problem) => {
                    unreadable.extend(word.text.chars().next().filter(|_| problem != Problem::UnknownParameter));
                    // The sheet stops at an unknown parameter: what a line lacks beside it is not told.
                    self.tell_word(number, *word, problem);
                }
            }
        }
        let of = |symbol: char| found.iter().find(|parameter| parameter.symbol == symbol);
        let there = |symbol: char| of(symbol).is_some() || unreadable.contains(&symbol);
        let accelerated = there('p') || there('k');
        let needed: &[char] = if accelerated { &['p', 'k', 'x'] } else { &['x', 't'] };
        let lacking: Vec<char> = needed.iter().copied().filter(|symbol| !there(*symbol)).collect();
        let unknown = self.findings[before..].iter().any(|finding| finding.problem == Problem::UnknownParameter);
        if !lacking.is_empty() && !unknown {
            self.tell_line(number, line, Problem::MissingParameter(lacking));
        }
        if let Some(surplus) = of('t').filter(|_| accelerated) {
            self.tell_word(number, surplus.word, Problem::Surplus('t'));
        }
        if self.findings.len() > before {
            return None;
        }
        let value = |symbol| of(symbol).map(|parameter| parameter.value);
        let element = if accelerated {
            Element::Accelerated { p: value('p')?, k: value('k')?, x: value('x')? }
        } else {
            Element::Constant { x: value('x')?, t: value('t')? }
        };
        let wrong = match element {
            Element::Constant { t, .. } if t <= 0.0 => Some(('t', Problem::NoTime)),
            Element::Accelerated { p, k, .. } if p * k < 0.0 => {
                self.tell_line(number, line, Problem::SignChange);
                return None;
            }
            Element::Accelerated { p, k, .. } if p == 0.0 && k == 0.0 => Some(('k', Problem::NoSpeed)),
            Element::Accelerated { x: 0.0, .. } => Some(('x', Problem::NoWay)),
            Element::Accelerated { p, k, x } if (p + k) * x < 0.0 => Some(('x', Problem::WrongSense)),
            _ => None,
        };
        match wrong {
            Some((symbol, problem)) => {
                let word = of(symbol)?.word;
                self.tell_word(number, word, problem);
                None
            }
            None => Some(element),
        }
    }

    /// Puts an element behind those before.
    fn place(&mut self, number: usize, line: &str, element: Element) {
        let Limits { counts_per_mm, travel_mm, speed_mm_s, from_mm } = *self.limits;
        let motion = Motion { element, line: number, from_s: self.seconds, from_mm: self.mm };
        self.seconds += element.seconds();
        self.mm += element.way_mm();
        let speed = element.greatest_speed_mm_s();
        let most = INCREMENT_MAX * TICKS_PER_S / counts_per_mm;
        let to_mm = from_mm + self.mm;
        if self.seconds > SECONDS_MAX {
            self.tell_line(number, line, Problem::TooLong);
            // Said once, not for each line that follows.
            self.seconds = f64::NEG_INFINITY;
        } else if speed > most {
            self.tell_line(number, line, Problem::TooManyCounts(most));
        } else if speed > speed_mm_s * (1.0 + ROUNDING) {
            self.tell_line(number, line, Problem::TooFast { speed_mm_s: speed, greatest_mm_s: speed_mm_s });
        }
        let beyond = to_mm < -travel_mm * ROUNDING || to_mm > travel_mm * (1.0 + ROUNDING);
        if beyond && !self.lost {
            self.tell_line(number, line, Problem::BeyondTravel { to_mm, travel_mm });
        }
        self.motions.push(motion);
    }
}

fn words(line: &str) -> Vec<Word<'_>> {
    let mut words = Vec::with_capacity(4);
    let (mut column, mut rest) = (1, line);
    loop {
        let text = rest.trim_start_matches([' ', '\t', '\r']);
        column += rest.len() - text.len();
        let end = text.find([' ', '\t', '\r']).unwrap_or(text.len());
        if end == 0 {
            return words;
        }
        let (word, behind) = text.split_at(end);
        words.push(Word { text: word, column });
        column += word.chars().count();
        rest = behind;
    }
}

fn parameter(word: Word<'_>) -> Result<Parameter<'_>, Problem> {
    let mut characters = word.text.chars();
    let symbol = characters.next().filter(|symbol| "pkxt".contains(*symbol)).ok_or(Problem::UnknownParameter)?;
    let text = characters.as_str();
    let value = number(text).ok_or(Problem::NotANumber)?;
    if value.abs() > NUMBER_MAX {
        return Err(Problem::OutOfRange);
    }
    Ok(Parameter { symbol, value, word })
}

/// A number as the grammar has it.
fn number(text: &str) -> Option<f64> {
    let digits = text.strip_prefix('-').unwrap_or(text);
    let mut parts = digits.split(['.', ',']);
    let whole = |part: &str| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit());
    let fits = parts.by_ref().take(2).all(whole) && parts.next().is_none();
    if !fits { None } else { text.replace(',', ".").parse().ok() }
}
