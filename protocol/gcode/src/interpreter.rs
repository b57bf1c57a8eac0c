//! From bytes to motions, line by line.
//!
//! A plain program needs no memory but for the line at hand. From the first O word on, the text is kept: loops and
//! calls go back in it, never before that line. It is executed when all of it is there.

use crate::block::{Block, Content};
use crate::canon::{Kind, Motion, Place};
use crate::dialect::Dialect;
use crate::execute::execute;
use crate::fanuc::cycles;
use crate::fanuc::{self, Next, Programs};
use crate::finding::{Fault, Finding, Read, Severity, column, fault};
use crate::flow::{self, Keyword, Mark, Marks};
use crate::lathe;
use crate::lexer::{Cursor, Lines};
use crate::machine::{LOCALS, Machine, Sink};

/// So many errors are told, and so many warnings.
const FINDINGS_MAX: usize = 20;
/// Calls are nested this deep at most, as in LinuxCNC.
const CALLS_MAX: usize = 10;
const ONLY_MOTIONS: &str = "a contour holds motions only";
const NO_VALUES: &str = "a contour gives no value to a parameter";

/// Executes a line of a contour aside, on this machine.
type ReadContour<'f> = &'f mut dyn FnMut(&Block, &[u8], &mut Machine, Sink<'_>) -> Read<()>;

/// How a program is read.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// The dialect; if none is given, the first block of bytes tells. Default: none.
    pub dialect: Option<Dialect>,
    /// Whether what is a warning otherwise is an error. Default: no.
    pub strict: bool,
    /// Whether blocks that begin with `/` are passed over: the switch "block delete". Default: no.
    pub skip_deleted: bool,
    /// Where the tool is when the program begins. Default: zero.
    pub start: Place,
    /// Where G28 and G30 go unless the program says otherwise, in the machine's coordinates. Default: zero.
    pub home: Place,
    /// A program with O words ends after so many lines at the latest. Default: ten million.
    pub steps_max: u64,
}

impl Default for Settings {
    fn default() -> Self {
        let (start, home) = (Place::default(), Place::default());
        Self { dialect: None, strict: false, skip_deleted: false, start, home, steps_max: 10_000_000 }
    }
}

/// What came of a program.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// The dialect that it was read in.
    pub dialect: Dialect,
    /// What is wrong with it, in the order in which it was found.
    pub findings: Vec<Finding>,
    /// Its lines.
    pub lines: usize,
    /// Lines executed, and motions of cycles.
    pub steps: u64,
    /// Motions that came of it.
    pub motions: u64,
}

impl Outcome {
    /// Whether the program is refused.
    pub fn is_refused(&self) -> bool {
        self.findings.iter().any(|finding| finding.severity == Severity::Error)
    }
}

/// Reads a program.
#[derive(Clone, Debug)]
pub struct Interpreter {
    lines: Lines,
    program: Program,
}

impl Interpreter {
    /// At the start of a program.
    pub fn new(settings: &Settings) -> Self {
        let program = Program {
            settings: settings.clone(),
            machine: Machine::new(settings.start, settings.home),
            block: Block::default(),
            fanuc: fanuc::State::default(),
            outcome: Outcome::default(),
            text: Text::default(),
            frames: Vec::new(),
            counts: Vec::new(),
            broken: None,
            continued: false,
            any_block: false,
            percent: false,
            begun: false,
            done: false,
        };
        Self { lines: Lines::default(), program }
    }

    /// Takes the next bytes of the text, cut anywhere.
    pub fn push(&mut self, bytes: &[u8], sink: &mut dyn FnMut(Motion)) {
        let Self { lines, program } = self;
        program.begin(bytes);
        lines.push(bytes, |number, line| program.line(number, line, sink));
    }

    /// Whether the rest of the text means nothing: the program has ended, or too much is wrong with it.
    pub const fn is_done(&self) -> bool {
        self.program.done
    }

    /// At the end of the text.
    pub fn finish(mut self, sink: &mut dyn FnMut(Motion)) -> Outcome {
        let Self { lines, program } = &mut self;
        lines.finish(|number, line| program.line(number, line, sink));
        program.finish(lines.count(), sink);
        self.program.outcome
    }
}

/// The motions of a whole text, and what is wrong with it.
pub fn interpret(text: &[u8], settings: &Settings) -> (Vec<Motion>, Outcome) {
    let mut motions = Vec::new();
    let mut sink = |motion| motions.push(motion);
    let mut interpreter = Interpreter::new(settings);
    interpreter.push(text, &mut sink);
    let outcome = interpreter.finish(&mut sink);
    (motions, outcome)
}

/// Lines that are kept.
#[derive(Clone, Debug, Default)]
struct Text {
    bytes: Vec<u8>,
    /// Where each line ends.
    ends: Vec<usize>,
    /// The number of the first one; 0 if no text is kept.
    first: usize,
    marks: Marks,
}

impl Text {
    fn push(&mut self, line: &[u8]) {
        self.bytes.extend_from_slice(line);
        self.ends.push(self.bytes.len());
    }

    fn line(&self, nth: usize) -> &[u8] {
        let start = nth.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.bytes[start..self.ends[nth]]
    }
}

/// A call.
#[derive(Clone, Debug)]
struct Frame {
    label: String,
    /// The line that follows it.
    back: usize,
    hidden: [f64; LOCALS],
}

#[derive(Clone, Debug)]
struct Program {
    settings: Settings,
    machine: Machine,
    block: Block,
    fanuc: fanuc::State,
    outcome: Outcome,
    text: Text,
    frames: Vec<Frame>,
    /// Of each `repeat` that runs: how deep the calls are, its line, how often it is still to come.
    counts: Vec<(usize, usize, u64)>,
    /// LinuxCNC remembers a `break` up to the next end of a loop `do`: the line of it.
    broken: Option<usize>,
    /// LinuxCNC remembers a `continue` of a loop `do` up to the next end of a loop `while`.
    continued: bool,
    any_block: bool,
    percent: bool,
    begun: bool,
    done: bool,
}

impl Program {
    /// Chooses the dialect, before the first line.
    fn begin(&mut self, bytes: &[u8]) {
        if self.begun || bytes.is_empty() {
            return;
        }
        self.begun = true;
        self.outcome.dialect = self.settings.dialect.unwrap_or_else(|| Dialect::guess(bytes));
        if self.outcome.dialect == Dialect::Fanuc {
            fanuc::begin(&mut self.machine);
        }
    }

    /// Takes a line of the text.
    #[inline]
    fn line(&mut self, number: usize, line: &[u8], sink: Sink<'_>) {
        if self.done {
            return;
        }
        if self.text.first != 0 {
            self.text.push(line);
            return;
        }
        self.outcome.steps += 1;
        self.machine.line = number;
        match self.block.read(line, &self.machine, self.settings.skip_deleted) {
            Ok(Content::Nothing) => {}
            Ok(Content::Words) if self.outcome.dialect == Dialect::Fanuc => {
                if fanuc::goes_elsewhere(&self.block) {
                    self.keep(number, line);
                } else if self.fanuc_words(line, sink) == Next::Return {
                    let message = "M99 in the main program repeats it for ever";
                    self.tell(line, Severity::Error, &Fault { at: 0, message: message.into() });
                    self.done = true;
                }
            }
            Ok(Content::Words) => self.words(line, None, sink),
            Ok(Content::Percent) if self.any_block || self.percent => self.done = true,
            Ok(Content::Percent) => self.percent = true,
            // The number of the program; another one follows its end.
            Ok(Content::OWord(_)) if self.outcome.dialect == Dialect::Fanuc => self.done = self.any_block,
            Ok(Content::OWord(_)) => self.keep(number, line),
            Err(fault) => self.refuse_line(line, &fault),
        }
    }

    /// Keeps the text from this line on.
    fn keep(&mut self, number: usize, line: &[u8]) {
        self.any_block = true;
        self.outcome.steps -= 1;
        self.text.first = number;
        self.text.push(line);
    }

    /// Executes the block that has been read; of a text that is kept, which line of it that is.
    #[inline]
    fn words(&mut self, line: &[u8], kept: Option<(&Text, usize)>, sink: Sink<'_>) {
        let result = match self.block_read(sink) {
            Ok(None) => Ok(()),
            Ok(Some(code)) => self.lathe_cycle(code, kept, sink),
            Err(fault) => Err(fault),
        };
        self.executed(line, result);
    }

    /// Cuts a contour that is a subroutine.
    #[cold]
    fn lathe_cycle(&mut self, code: u16, kept: Option<(&Text, usize)>, sink: Sink<'_>) -> Read<()> {
        let cycle = lathe::Cycle::of(&self.machine, &self.block, code)?;
        let label = cycle.sub.0.to_string();
        let found = kept.and_then(|(text, nth)| {
            let start = text.marks.sub(&label).filter(|sub| sub.line < nth)?.line;
            Some((text, start, text.marks.behind(&label, start, &[Keyword::EndSub])?.line))
        });
        let Some((text, start, end)) = found else {
            return fault(cycle.sub.1, format!("the subroutine o{label} is not in the file before this line"));
        };
        let mut reader = cycle.reader(&self.machine);
        let read =
            &mut |block: &Block, _: &[u8], reader: &mut Machine, sink: Sink<'_>| lathe::read(reader, block, sink);
        let Some(motions) = self.contour(text, start + 1..end, &mut reader, read) else { return Ok(()) };
        let before = self.machine.motions;
        let result = lathe::run(&cycle, &mut self.machine, &motions, sink);
        self.outcome.steps += self.machine.motions - before;
        result
    }

    /// The same in Fanuc's dialect; says where the program goes on.
    fn fanuc_words(&mut self, line: &[u8], sink: Sink<'_>) -> Next {
        let mut next = Next::Line;
        let Self { machine, fanuc, block, settings, .. } = self;
        let result = fanuc::execute(machine, fanuc, block, line, settings.strict, sink);
        let result = result.map(|found| next = found);
        self.executed(line, result);
        next
    }

    #[inline]
    fn executed(&mut self, line: &[u8], result: Read<()>) {
        self.any_block = true;
        if let Err(fault) = result {
            self.machine.lost |= Machine::has_axis(&self.block);
            self.tell(line, Severity::Error, &fault);
        }
        self.tell_warnings(line);
        self.done |= self.machine.ended;
    }

    #[inline]
    fn tell_warnings(&mut self, line: &[u8]) {
        if !self.machine.warnings.is_empty() {
            for fault in core::mem::take(&mut self.machine.warnings) {
                self.tell(line, Severity::Warning, &fault);
            }
        }
    }

    #[inline]
    fn block_read(&mut self, sink: Sink<'_>) -> Read<Option<u16>> {
        for (parameter, value, at) in &self.block.assignments {
            self.machine.assign(parameter, *value, *at)?;
        }
        execute(&mut self.machine, &self.block, self.settings.strict, sink)
    }

    /// Tells what is wrong with a line; each thing once, however often the line is executed.
    #[cold]
    fn tell(&mut self, line: &[u8], severity: Severity, fault: &Fault) {
        let severity = if self.settings.strict { Severity::Error } else { severity };
        let finding = Finding {
            line: self.machine.line,
            column: column(line, fault.at),
            severity,
            message: fault.message.clone().into_owned(),
        };
        let findings = &mut self.outcome.findings;
        // A warning is told where it is first deserved.
        let told = |other: &Finding| {
            other.message == finding.message && (other.line == finding.line || severity == Severity::Warning)
        };
        if findings.iter().any(told) {
            return;
        }
        let alike = findings.iter().filter(|other| other.severity == severity).count();
        if alike < FINDINGS_MAX {
            findings.push(finding);
        }
        self.done |= severity == Severity::Error && alike + 1 >= FINDINGS_MAX;
    }

    /// A line that cannot be read: perhaps the whole file is something else.
    #[cold]
    fn refuse_line(&mut self, line: &[u8], fault: &Fault) {
        let nothing_yet = self.machine.motions == 0;
        let other = if line.iter().any(|byte| matches!(byte, 0..=8 | 14..=16 | 20..=25 | 28..=31 | 127)) {
            Some("the file is binary: expected G-code")
        } else if nothing_yet && is_frame(line) {
            Some("the file is a program of frames: expected G-code")
        } else {
            None
        };
        self.any_block = true;
        if let Some(message) = other {
            self.outcome.findings.clear();
            self.tell(line, Severity::Error, &Fault { at: 0, message: message.into() });
            self.done = true;
            return;
        }
        let axes = line.iter().any(|byte| matches!(byte.to_ascii_lowercase(), b'x'..=b'z' | b'a'));
        self.machine.lost |= axes;
        self.tell(line, Severity::Error, fault);
    }

    fn finish(&mut self, lines: usize, sink: Sink<'_>) {
        self.outcome.lines = lines;
        if self.text.first != 0 {
            let text = core::mem::take(&mut self.text);
            match self.outcome.dialect {
                Dialect::LinuxCnc => self.run(text, sink),
                Dialect::Fanuc => self.run_fanuc(&text, sink),
            }
        }
        self.machine.line = self.machine.line.max(1);
        if !self.any_block {
            self.machine.line = 1;
            self.tell(b"", Severity::Error, &Fault { at: 0, message: "the file holds no G-code".into() });
        } else if let Some(corner) = self.fanuc.corner.take() {
            self.tell(b"", Severity::Error, &Fault { at: 0, message: corner.without_end().into() });
        } else if !self.done && !self.percent {
            let message = "the program has no end: expected M2, M30 or % in a line of its own";
            self.tell(b"", Severity::Warning, &Fault { at: 0, message: message.into() });
        }
        if !self.machine.ended {
            self.machine.emit(Kind::End, sink);
        }
        self.outcome.motions = self.machine.motions;
    }

    /// Executes the text that has been kept.
    fn run(&mut self, mut text: Text, sink: Sink<'_>) {
        for nth in 0..text.ends.len() {
            // Labels that are computed name only what is called.
            if let Some(mark) = mark(nth, text.line(nth), &self.machine) {
                text.marks.push(mark);
            }
        }
        let mut nth = 0;
        while nth < text.ends.len() && !self.done {
            let Some(line) = self.step_to(&text, nth) else { return };
            nth += 1;
            match self.block.read(line, &self.machine, self.settings.skip_deleted) {
                Ok(Content::Nothing) => {}
                Ok(Content::Words) => self.words(line, Some((&text, nth - 1)), sink),
                Ok(Content::Percent) => self.done = true,
                Ok(Content::OWord(at)) => match self.flow(&text, nth - 1, at) {
                    Ok(next) => {
                        nth = next;
                        self.tell_warnings(line);
                    }
                    Err(fault) => {
                        self.tell(line, Severity::Error, &fault);
                        nth = past(&text, nth - 1, &self.machine);
                    }
                },
                Err(fault) => self.refuse_line(line, &fault),
            }
        }
    }

    /// Goes to a line of a text that is kept, if it [may be executed](Self::may_step).
    fn step_to<'t>(&mut self, text: &'t Text, nth: usize) -> Option<&'t [u8]> {
        let line = text.line(nth);
        self.machine.line = text.first + nth;
        self.may_step(line).then_some(line)
    }

    /// Counts a line of a text that is kept; tells if there are too many.
    fn may_step(&mut self, line: &[u8]) -> bool {
        self.outcome.steps += 1;
        let most = self.settings.steps_max;
        if self.outcome.steps > most {
            let message = format!("more than {most} lines have been executed: the program may never end");
            self.tell(line, Severity::Error, &Fault { at: 0, message: message.into() });
            self.done = true;
        }
        !self.done
    }

    /// Executes the text that has been kept, in Fanuc's dialect.
    fn run_fanuc(&mut self, text: &Text, sink: Sink<'_>) {
        let programs = Programs::of((0..text.ends.len()).map(|nth| text.line(nth)));
        // Of each call: where it goes back to, where it begins, how often it is still to come.
        let mut calls: Vec<(usize, usize, u32)> = Vec::new();
        let mut nth = 0;
        while nth < text.ends.len() && !self.done {
            let Some(line) = self.step_to(text, nth) else { return };
            nth += 1;
            let next = match self.block.read(line, &self.machine, self.settings.skip_deleted) {
                Ok(Content::Nothing) => continue,
                Ok(Content::Words) => self.fanuc_words(line, sink),
                Ok(Content::Percent) => {
                    self.percent = true;
                    self.done = true;
                    continue;
                }
                Ok(Content::OWord(at)) => {
                    if !calls.is_empty() {
                        let message = "the program before this one has no M99";
                        self.tell(line, Severity::Error, &Fault { at, message: message.into() });
                    }
                    self.done = true;
                    continue;
                }
                Err(fault) => {
                    self.refuse_line(line, &fault);
                    continue;
                }
            };
            let refuse = |program: &mut Self, message: String| {
                let at = program.block.codes().first().map_or(0, |code| code.at);
                program.tell(line, Severity::Error, &Fault { at, message: message.into() });
            };
            match next {
                Next::Line => {}
                Next::Call { times: 0, .. } => {}
                Next::Call { program, times } => match programs.start(program) {
                    Some(_) if calls.len() == CALLS_MAX => {
                        refuse(self, format!("calls are nested more than {CALLS_MAX} deep"));
                    }
                    Some(start) => {
                        calls.push((nth, start, times - 1));
                        nth = start;
                    }
                    None => refuse(self, format!("the program O{program:04} does not follow in the file")),
                },
                Next::Return => match calls.last_mut() {
                    Some((_, start, left)) if *left > 0 => {
                        *left -= 1;
                        nth = *start;
                    }
                    Some((back, _, _)) => {
                        nth = *back;
                        calls.pop();
                    }
                    None => {
                        refuse(self, "M99 in the main program repeats it for ever".to_owned());
                        self.done = true;
                    }
                },
                Next::Contour(cycle) => match programs.contour(cycle.blocks, nth) {
                    Some((from, to)) => {
                        self.cycle(text, &cycle, (from, to), nth - 1, sink);
                        // What follows as the contour of a cycle is not executed again.
                        if from >= nth {
                            nth = to + 1;
                        }
                    }
                    None => {
                        let [from, to] = cycle.blocks;
                        refuse(self, format!("the contour N{from} to N{to} is not in the file behind the first cycle"));
                    }
                },
            }
        }
    }

    /// Cuts a contour: these lines of the text.
    fn cycle(&mut self, text: &Text, cycle: &cycles::Cycle, lines: (usize, usize), nth: usize, sink: Sink<'_>) {
        let mut aside = self.machine.clone();
        let mut state = self.fanuc.clone();
        let strict = self.settings.strict;
        let mut second_type = None;
        let read = &mut |block: &Block, line: &[u8], aside: &mut Machine, sink: Sink<'_>| {
            second_type = second_type.or(fanuc::names_axes(block));
            let next = fanuc::execute(aside, &mut state, block, line, strict, sink)?;
            if next == Next::Line { Ok(()) } else { fault(0, ONLY_MOTIONS) }
        };
        let Some(motions) = self.contour(text, lines.0..lines.1 + 1, &mut aside, read) else { return };
        if let Some(corner) = &state.corner {
            let fault = Fault { at: 0, message: corner.without_end().into() };
            self.tell(text.line(nth), Severity::Error, &fault);
            return;
        }
        let before = self.machine.motions;
        let result = cycles::run(cycle, &mut self.machine, &motions, second_type == Some(true), sink);
        self.outcome.steps += self.machine.motions - before;
        if let Err(fault) = result {
            self.tell(text.line(nth), Severity::Error, &fault);
        }
    }

    /// What the lines of a contour ask for, executed aside; none if one of them is refused.
    fn contour(
        &mut self,
        text: &Text,
        lines: core::ops::Range<usize>,
        aside: &mut Machine,
        execute: ReadContour<'_>,
    ) -> Option<Vec<Motion>> {
        let mut block = Block::default();
        let mut motions = Vec::new();
        let here = self.machine.line;
        for nth in lines {
            let line = text.line(nth);
            if !self.may_step(line) {
                return None;
            }
            aside.line = text.first + nth;
            let sink = &mut |motion| motions.push(motion);
            let result = match block.read(line, &*aside, self.settings.skip_deleted) {
                Ok(Content::Words) if !block.assignments.is_empty() => fault(block.assignments[0].2, NO_VALUES),
                Ok(Content::Words) => execute(&block, line, aside, sink),
                Ok(Content::Nothing) => Ok(()),
                Ok(_) => fault(0, ONLY_MOTIONS),
                Err(fault) => Err(fault),
            };
            self.machine.line = aside.line;
            let failed = result.is_err();
            if let Err(fault) = result {
                self.tell(line, Severity::Error, &fault);
            }
            for warning in core::mem::take(&mut aside.warnings) {
                self.tell(line, Severity::Warning, &warning);
            }
            self.machine.line = here;
            if failed {
                self.machine.lost = true;
                return None;
            }
        }
        Some(motions)
    }

    /// The line that follows an O word.
    fn flow(&mut self, text: &Text, nth: usize, at: usize) -> Read<usize> {
        let line = text.line(nth);
        let cursor = &mut Cursor { line, at };
        let (label, keyword) = flow::head(cursor, &self.machine)?;
        let arguments_at = cursor.at;
        let arguments = flow::arguments(cursor, &self.machine)?;
        let wanted = match keyword {
            Keyword::Call => 0..=LOCALS,
            Keyword::If | Keyword::ElseIf | Keyword::While | Keyword::Repeat => 1..=1,
            Keyword::EndSub | Keyword::Return => 0..=1,
            _ => 0..=0,
        };
        if !wanted.contains(&arguments.len()) {
            let values = if *wanted.end() == 1 { "one value in brackets" } else { "no value" };
            return fault(arguments_at, format!("expected {values}, found {}", arguments.len()));
        }
        let first = arguments.first().copied();
        let truth = first.is_some_and(|value| value != 0.0);
        let missing = |what: &str| fault(at, format!("o{label} has no {what}"));
        let marks = &text.marks;
        let end = |wanted: &[Keyword]| marks.behind(&label, nth, wanted).map(|mark| mark.line);
        let start = |wanted: &[Keyword]| marks.before(&label, nth, wanted);
        Ok(match keyword {
            Keyword::Sub => match end(&[Keyword::EndSub]) {
                Some(end) => end + 1,
                None => return missing("endsub"),
            },
            Keyword::EndSub | Keyword::Return => {
                let frame = match self.frames.pop() {
                    Some(frame) if frame.label == label => frame,
                    Some(frame) => {
                        let message = format!("o{label} ends here, inside of o{}", frame.label);
                        self.frames.push(frame);
                        return fault(at, message);
                    }
                    None => return fault(at, format!("o{label} has not been called")),
                };
                self.machine.leave(&frame.hidden);
                self.counts.retain(|count| count.0 <= self.frames.len());
                self.machine.returned = first;
                frame.back
            }
            Keyword::Call => {
                let Some(sub) = marks.sub(&label) else {
                    return fault(at, format!("the subroutine o{label} is not in the file"));
                };
                if self.frames.len() == CALLS_MAX {
                    return fault(at, format!("calls are nested more than {CALLS_MAX} deep"));
                }
                if marks.behind(&label, sub.line, &[Keyword::EndSub]).is_none() {
                    return missing("endsub");
                }
                let hidden = self.machine.enter(&arguments);
                self.machine.returned = None;
                self.frames.push(Frame { label, back: nth + 1, hidden });
                sub.line + 1
            }
            Keyword::If if truth => nth + 1,
            Keyword::If => {
                let mut from = nth;
                loop {
                    let next = marks.behind(&label, from, &[Keyword::ElseIf, Keyword::Else, Keyword::EndIf]);
                    match next {
                        None => return missing("endif"),
                        Some(mark) if mark.keyword != Keyword::ElseIf => break mark.line + 1,
                        Some(mark) => {
                            from = mark.line;
                            if self.condition(text, from)? {
                                break from + 1;
                            }
                        }
                    }
                }
            }
            // Whoever comes here from above has executed a branch.
            Keyword::ElseIf | Keyword::Else => match end(&[Keyword::EndIf]) {
                Some(end) if start(&[Keyword::If]).is_some() => end + 1,
                _ => return missing("if, or no endif"),
            },
            Keyword::EndIf => match start(&[Keyword::If]) {
                Some(_) => nth + 1,
                None => return missing("if"),
            },
            Keyword::While => match start(&[Keyword::Do, Keyword::While, Keyword::EndWhile]) {
                Some(mark) if mark.keyword == Keyword::Do => {
                    let broken = core::mem::take(&mut self.broken);
                    if truth && broken.is_some_and(|from| from <= mark.line || from > nth) {
                        let message = "LinuxCNC leaves this loop here: a break of an earlier loop has that effect";
                        self.machine.warn(at, message);
                    }
                    if truth && broken.is_none() { mark.line + 1 } else { nth + 1 }
                }
                _ if truth => nth + 1,
                _ => match end(&[Keyword::EndWhile]) {
                    Some(end) => {
                        self.continued = false;
                        end + 1
                    }
                    None => return missing("endwhile"),
                },
            },
            Keyword::EndWhile => match start(&[Keyword::While]) {
                Some(mark) => mark.line,
                None => return missing("while"),
            },
            Keyword::Do => nth + 1,
            Keyword::Repeat => {
                let Some(end) = end(&[Keyword::EndRepeat]) else { return missing("endrepeat") };
                let depth = self.frames.len();
                self.counts.retain(|count| (count.0, count.1) != (depth, nth));
                let times = libm::round(first.unwrap_or(0.0));
                if times >= 1.0 {
                    self.counts.push((depth, nth, times as u64 - 1));
                    nth + 1
                } else {
                    end + 1
                }
            }
            Keyword::EndRepeat => {
                let Some(mark) = start(&[Keyword::Repeat]) else { return missing("repeat") };
                let depth = self.frames.len();
                match self.counts.iter_mut().find(|count| (count.0, count.1) == (depth, mark.line)) {
                    Some((_, _, left)) if *left > 0 => {
                        *left -= 1;
                        mark.line + 1
                    }
                    _ => nth + 1,
                }
            }
            Keyword::Break | Keyword::Continue => {
                let around = start(&[Keyword::While, Keyword::Do, Keyword::Repeat]);
                let end = marks.behind(&label, nth, &[Keyword::EndWhile, Keyword::EndRepeat, Keyword::While]);
                let (Some(around), Some(end)) = (around, end) else { return missing("loop around this line") };
                if around.keyword == Keyword::Repeat {
                    return fault(at, "break and continue are for the loops while and do");
                }
                let of_do = end.keyword == Keyword::While;
                if keyword == Keyword::Continue {
                    self.continued = of_do;
                    return Ok(end.line);
                }
                self.broken = Some(nth);
                if of_do || core::mem::take(&mut self.continued) {
                    if !of_do {
                        let message = "LinuxCNC goes on with this loop: a continue of an earlier loop has that effect";
                        self.machine.warn(at, message);
                    }
                    end.line
                } else {
                    end.line + 1
                }
            }
        })
    }

    /// The condition of an `elseif`.
    fn condition(&mut self, text: &Text, nth: usize) -> Read<bool> {
        let line = text.line(nth);
        let cursor = &mut Cursor { line, at: o_word(line).unwrap_or(0) };
        flow::head(cursor, &self.machine)?;
        let values = flow::arguments(cursor, &self.machine)?;
        Ok(values.first().is_some_and(|value| *value != 0.0))
    }
}

/// Where an O word stands, if the line begins with one.
fn o_word(line: &[u8]) -> Option<usize> {
    let cursor = &mut Cursor::new(line);
    loop {
        match cursor.peek() {
            b'/' => cursor.skip(),
            b'(' => {
                cursor.skip();
                cursor.comment().ok()?;
            }
            b'n' => {
                cursor.skip();
                cursor.number().ok()?;
            }
            b'o' => return Some(cursor.at),
            _ => return None,
        }
    }
}

fn mark(nth: usize, line: &[u8], machine: &Machine) -> Option<Mark> {
    let cursor = &mut Cursor { line, at: o_word(line)? };
    let (label, keyword) = flow::head(cursor, machine).ok()?;
    Some(Mark { line: nth, label, keyword })
}

/// Where to go on behind an O word that is wrong: what it would have begun is passed over.
fn past(text: &Text, nth: usize, machine: &Machine) -> usize {
    let of = |mark: Mark| {
        let wanted = match mark.keyword {
            Keyword::If => Keyword::EndIf,
            Keyword::While => Keyword::EndWhile,
            Keyword::Repeat => Keyword::EndRepeat,
            _ => return None,
        };
        text.marks.behind(&mark.label, nth, &[wanted]).map(|end| end.line + 1)
    };
    mark(nth, text.line(nth), machine).and_then(of).unwrap_or(nth + 1)
}

/// A line of a program of frames: eight bytes as two hexadecimal digits each.
fn is_frame(line: &[u8]) -> bool {
    let line = line.split(|byte| *byte == b'#').next().unwrap_or_default();
    let mut words = line.split(|byte| byte.is_ascii_whitespace()).filter(|word| !word.is_empty());
    let byte = |word: &[u8]| word.len() == 2 && word.iter().all(u8::is_ascii_hexdigit);
    (0..8).all(|_| words.next().is_some_and(byte)) && words.next().is_none()
}
