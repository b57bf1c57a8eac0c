//! Values: numbers, parameters, functions, expressions in brackets.
//!
//! They have a value when they are read, as in LinuxCNC: a line sees the parameters as they were before it.

use crate::finding::{Read, fault};
use crate::lexer::Cursor;

/// Brackets, functions and parameters of parameters may be nested this deep.
const DEPTH_MAX: usize = 60;
/// For EQ and NE, two numbers are equal if they differ by less, as in LinuxCNC 2.9.
const EQUAL: f64 = 1e-4;
/// A name of a parameter has at most this many bytes.
const NAME_MAX: usize = 100;

/// Where parameters come from.
pub(crate) trait Variables {
    /// A numbered parameter; none if there is no such number.
    fn numbered(&self, number: usize) -> Option<f64>;
    /// A named parameter, by its name in lower case.
    fn named(&self, name: &str) -> Option<f64>;
    /// Whether what a parameter is given may be an expression without brackets, as in a Fanuc's program.
    fn is_fanuc(&self) -> bool {
        false
    }
}

/// The name or number of a parameter.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Parameter {
    Numbered(usize),
    Named(String),
}

/// Reads values.
pub(crate) struct Reader<'a, 'c, V> {
    pub(crate) cursor: &'c mut Cursor<'a>,
    pub(crate) variables: &'c V,
    pub(crate) depth: usize,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Operator {
    End,
    Or,
    Xor,
    And,
    Eq,
    Ne,
    Gt,
    Ge,
    Lt,
    Le,
    Plus,
    Minus,
    Times,
    Divide,
    Modulo,
    Power,
}

impl Operator {
    const fn precedence(self) -> u8 {
        match self {
            Self::End => 0,
            Self::Or | Self::Xor | Self::And => 1,
            Self::Eq | Self::Ne | Self::Gt | Self::Ge | Self::Lt | Self::Le => 2,
            Self::Plus | Self::Minus => 3,
            Self::Times | Self::Divide | Self::Modulo => 4,
            Self::Power => 5,
        }
    }
}

/// A value at the cursor.
#[inline]
pub(crate) fn value<V: Variables>(cursor: &mut Cursor<'_>, variables: &V) -> Read<f64> {
    let byte = cursor.peek();
    let behind_sign = || matches!(cursor.line.get(cursor.at + 1), Some(b'0'..=b'9' | b'.'));
    match byte {
        // Nearly all are plain numbers.
        b'0'..=b'9' | b'.' => cursor.number(),
        b'-' if behind_sign() => cursor.number(),
        _ => Reader { cursor, variables, depth: 0 }.value(),
    }
}

impl<V: Variables> Reader<'_, '_, V> {
    pub(crate) fn value(&mut self) -> Read<f64> {
        let byte = self.cursor.peek();
        let start = self.cursor.at;
        self.depth += 1;
        if self.depth > DEPTH_MAX {
            return fault(start, format!("the expression is nested more than {DEPTH_MAX} deep"));
        }
        let value = match byte {
            b'[' => {
                self.cursor.skip();
                self.expression()?
            }
            b'#' => {
                self.cursor.skip();
                self.parameter(start)?
            }
            b'+' | b'-' => {
                self.cursor.skip();
                let next = self.cursor.peek();
                let value = if next.is_ascii_digit() || next == b'.' { self.cursor.number()? } else { self.value()? };
                if byte == b'-' { -value } else { value }
            }
            b'a'..=b'z' => self.function()?,
            _ => self.cursor.number()?,
        };
        self.depth -= 1;
        if !value.is_finite() {
            return fault(start, "the result is not a finite number");
        }
        Ok(value)
    }

    /// An expression, behind its bracket.
    fn expression(&mut self) -> Read<f64> {
        let start = self.cursor.at - 1;
        let value = self.operation(1, Some(start))?;
        // No operator binds so loosely, so that it stands here.
        self.cursor.take(b']');
        Ok(value)
    }

    /// What a parameter is given.
    pub(crate) fn given(&mut self) -> Read<f64> {
        if self.variables.is_fanuc() { self.operation(1, None) } else { self.value() }
    }

    /// A sum, product… up to the bracket that closes the one here, or up to the end of the line, that binds at least
    /// this tightly; from left to right.
    fn operation(&mut self, least: u8, start: Option<usize>) -> Read<f64> {
        let mut left = self.value()?;
        loop {
            self.cursor.peek();
            let at = self.cursor.at;
            let operator = self.operator(start)?;
            if operator.precedence() < least {
                // The caller reads it again.
                self.cursor.at = at;
                return Ok(left);
            }
            let right = self.operation(operator.precedence() + 1, start)?;
            left = apply(operator, left, right, at)?;
        }
    }

    fn operator(&mut self, start: Option<usize>) -> Read<Operator> {
        if start.is_none() && matches!(self.cursor.peek(), 0 | b';' | b'(') {
            return Ok(Operator::End);
        }
        let words: [(&[u8], Operator); 16] = [
            (b"]", Operator::End),
            (b"**", Operator::Power),
            (b"*", Operator::Times),
            (b"/", Operator::Divide),
            (b"+", Operator::Plus),
            (b"-", Operator::Minus),
            (b"mod", Operator::Modulo),
            (b"and", Operator::And),
            (b"xor", Operator::Xor),
            (b"or", Operator::Or),
            (b"eq", Operator::Eq),
            (b"ne", Operator::Ne),
            (b"gt", Operator::Gt),
            (b"ge", Operator::Ge),
            (b"lt", Operator::Lt),
            (b"le", Operator::Le),
        ];
        for (word, operator) in words {
            if self.cursor.take_word(word) {
                return Ok(operator);
            }
        }
        let end = match start {
            Some(start) if self.cursor.peek() == 0 => return fault(start, "the bracket is not closed"),
            Some(_) => "']'",
            None => "the end of the line",
        };
        let found = self.cursor.found();
        fault(self.cursor.at, format!("expected an operator or {end}, found {found}"))
    }

    /// A parameter's value, behind its `#`.
    fn parameter(&mut self, start: usize) -> Read<f64> {
        match self.place(start)? {
            Parameter::Numbered(number) => match self.variables.numbered(number) {
                Some(value) if value.is_nan() => fault(start, format!("#{number} has no value")),
                Some(value) => Ok(value),
                None => fault(start, format!("#{number} is out of range")),
            },
            Parameter::Named(name) => match self.variables.named(&name) {
                Some(value) => Ok(value),
                None => fault(start, format!("the parameter #<{name}> is not known")),
            },
        }
    }

    /// A parameter's number or name, behind its `#`.
    pub(crate) fn place(&mut self, start: usize) -> Read<Parameter> {
        if self.cursor.take(b'<') {
            return Ok(Parameter::Named(self.name(start)?));
        }
        let number = self.value()?;
        let whole = libm::round(number);
        if (number - whole).abs() > 1e-4 {
            return fault(start, format!("the number of a parameter is whole; it is {number}"));
        }
        if !(0.0..=1e6).contains(&whole) {
            return fault(start, format!("#{whole} is out of range"));
        }
        Ok(Parameter::Numbered(whole as usize))
    }

    /// A name, behind its `<`: without blanks, in lower case.
    pub(crate) fn name(&mut self, start: usize) -> Read<String> {
        let mut name = Vec::new();
        loop {
            match self.cursor.peek() {
                0 => return fault(start, "the name is not closed by '>'"),
                b'>' => break,
                byte => name.push(byte),
            }
            self.cursor.skip();
            if name.len() > NAME_MAX {
                return fault(start, format!("the name is longer than {NAME_MAX} bytes"));
            }
        }
        self.cursor.skip();
        Ok(String::from_utf8_lossy(&name).into_owned())
    }

    fn function(&mut self) -> Read<f64> {
        let start = self.cursor.at;
        let names: [&[u8]; 14] = [
            b"abs", b"acos", b"asin", b"atan", b"cos", b"exists", b"exp", b"fix", b"fup", b"ln", b"round", b"sin",
            b"sqrt", b"tan",
        ];
        let Some(name) = names.into_iter().find(|name| self.cursor.take_word(name)) else {
            let found = self.cursor.found();
            return fault(start, format!("expected a number, '[', '#' or a function, found {found}"));
        };
        if !self.cursor.take(b'[') {
            let name = String::from_utf8_lossy(name);
            return fault(start, format!("expected '[' behind {name}, found {}", self.cursor.found()));
        }
        if name == b"exists" {
            return self.exists(start);
        }
        let x = self.expression()?;
        let degrees = |radians: f64| radians * 180.0 / core::f64::consts::PI;
        let radians = x * core::f64::consts::PI / 180.0;
        Ok(match name {
            b"abs" => x.abs(),
            b"acos" | b"asin" if !(-1.0..=1.0).contains(&x) => {
                let name = String::from_utf8_lossy(name);
                return fault(start, format!("{name} of {x}: expected -1 to 1"));
            }
            b"acos" => degrees(libm::acos(x)),
            b"asin" => degrees(libm::asin(x)),
            b"atan" => {
                if !self.cursor.take(b'/') || !self.cursor.take(b'[') {
                    return fault(start, "expected atan[…]/[…]");
                }
                degrees(libm::atan2(x, self.expression()?))
            }
            b"cos" => libm::cos(radians),
            b"exp" => libm::exp(x),
            b"fix" => x.floor(),
            b"fup" => x.ceil(),
            b"ln" if x <= 0.0 => return fault(start, format!("ln of {x}: expected more than 0")),
            b"ln" => libm::log(x),
            b"round" => libm::trunc(x + if x < 0.0 { -0.5 } else { 0.5 }),
            b"sin" => libm::sin(radians),
            b"sqrt" if x < 0.0 => return fault(start, format!("sqrt of {x}: expected 0 or more")),
            b"sqrt" => libm::sqrt(x),
            _ => libm::tan(radians),
        })
    }

    fn exists(&mut self, start: usize) -> Read<f64> {
        if !self.cursor.take(b'#') {
            return fault(start, "expected exists[#…]");
        }
        let known = match self.place(start)? {
            Parameter::Numbered(number) => self.variables.numbered(number).is_some(),
            Parameter::Named(name) => self.variables.named(&name).is_some(),
        };
        if !self.cursor.take(b']') {
            return fault(start, "the bracket is not closed");
        }
        Ok(f64::from(u8::from(known)))
    }
}

fn apply(operator: Operator, a: f64, b: f64, at: usize) -> Read<f64> {
    let truth = |is: bool| f64::from(u8::from(is));
    let equal = (a - b).abs() < EQUAL;
    let value = match operator {
        Operator::Plus => a + b,
        Operator::Minus => a - b,
        Operator::Times => a * b,
        Operator::Divide | Operator::Modulo if b == 0.0 => return fault(at, "division by zero"),
        Operator::Divide => a / b,
        Operator::Modulo => {
            let rest = libm::fmod(a, b);
            if rest < 0.0 { rest + b.abs() } else { rest }
        }
        Operator::Power if a < 0.0 && b.floor() != b => {
            return fault(at, format!("{a} to the power of {b}: a negative number takes whole powers only"));
        }
        Operator::Power => libm::pow(a, b),
        Operator::And => truth(a != 0.0 && b != 0.0),
        Operator::Or => truth(a != 0.0 || b != 0.0),
        Operator::Xor => truth((a != 0.0) != (b != 0.0)),
        Operator::Eq => truth(equal),
        Operator::Ne => truth(!equal),
        Operator::Gt => truth(a > b),
        Operator::Ge => truth(a >= b),
        Operator::Lt => truth(a < b),
        Operator::Le => truth(a <= b),
        Operator::End => a,
    };
    if value.is_finite() { Ok(value) } else { fault(at, "the result is not a finite number") }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Some5;

    impl Variables for Some5 {
        fn numbered(&self, number: usize) -> Option<f64> {
            (1..=5602).contains(&number).then_some(number as f64)
        }

        fn named(&self, name: &str) -> Option<f64> {
            (name == "width").then_some(12.5)
        }
    }

    fn of(text: &str) -> Result<f64, String> {
        let mut cursor = Cursor::new(text.as_bytes());
        let value = value(&mut cursor, &Some5).map_err(|fault| format!("{}: {}", fault.at, fault.message))?;
        assert_eq!(cursor.peek(), 0, "{text}");
        Ok(value)
    }

    #[test]
    fn operators_bind_as_in_linuxcnc() {
        let cases = [
            ("[2+3*4**2]", 50.0),
            ("[2**3**2]", 64.0),
            ("[10-3-2]", 5.0),
            ("[20/2/5]", 2.0),
            ("[1+2 gt 2 and 3 lt 2]", 0.0),
            ("[1 or 0 and 0]", 0.0),
            ("[-7 MOD 3]", 2.0),
            ("[2*[3+4]]", 14.0),
            ("-[2]", -2.0),
            ("-#3", -3.0),
            ("##4", 4.0),
            ("#[1+2]", 3.0),
            ("#<W I dth>", 12.5),
            ("[1 eq 1.00009]", 1.0),
            ("[1 eq 1.00011]", 0.0),
            ("[1 xor 1]", 0.0),
            ("atan[1]/[1]", 45.0),
            ("round[-2.5]", -3.0),
            ("fix[-2.5]", -3.0),
            ("fup[2.1]", 3.0),
            ("exists[#<width>]", 1.0),
            ("exists[#<height>]", 0.0),
            ("[exists[#<height>] + 1]", 1.0),
            ("sqrt[abs[-16]]", 4.0),
            ("[#1 * 2 - #<width>/5]", -0.5),
        ];
        for (text, expected) in cases {
            let found = of(text).unwrap_or_else(|error| panic!("{text}: {error}"));
            assert!((found - expected).abs() < 1e-12, "{text}: {found}, not {expected}");
        }
    }

    #[test]
    fn what_cannot_be_computed_is_told() {
        let cases = [
            ("[1/0]", "2: division by zero"),
            ("[5 mod 0]", "3: division by zero"),
            ("#0", "0: #0 is out of range"),
            ("#5603", "0: #5603 is out of range"),
            ("#-1", "0: #-1 is out of range"),
            ("#1.5", "0: the number of a parameter is whole; it is 1.5"),
            ("#<depth>", "0: the parameter #<depth> is not known"),
            ("[1+2", "0: the bracket is not closed"),
            ("sqrt[-1]", "0: sqrt of -1: expected 0 or more"),
            ("ln[0]", "0: ln of 0: expected more than 0"),
            ("acos[2]", "0: acos of 2: expected -1 to 1"),
            ("[[-1]**0.5]", "5: -1 to the power of 0.5: a negative number takes whole powers only"),
            ("exp[1000]", "0: the result is not a finite number"),
            ("foo[1]", "0: expected a number, '[', '#' or a function, found 'f'"),
            ("[1 ! 2]", "3: expected an operator or ']', found '!'"),
        ];
        for (text, expected) in cases {
            match of(text) {
                Err(found) if found == expected => {}
                other => panic!("{text}: {other:?}, not {expected}"),
            }
        }
        let deep = format!("{}1{}", "[".repeat(100), "]".repeat(100));
        assert!(of(&deep).unwrap_err().contains("nested"));
    }
}
