//! The secret in the page's address.

use std::fmt;
use std::io;

use subtle::ConstantTimeEq;

/// So many random bytes: as many as a key of AES-128 has.
const BYTES: usize = 16;

/// The secret in the page's address. Who does not know it is told nothing.
#[derive(Clone)]
pub(crate) struct Token(String);

impl Token {
    /// A new one, from the system's source of randomness.
    ///
    /// # Errors
    /// If the system has none.
    pub(crate) fn new() -> io::Result<Self> {
        let mut bytes = [0u8; BYTES];
        getrandom::fill(&mut bytes)?;
        Ok(Self(bytes.iter().map(|byte| format!("{byte:02x}")).collect()))
    }

    /// Whether this is the token. Takes as long for every text of its length.
    pub(crate) fn is(&self, text: &str) -> bool {
        self.0.as_bytes().ct_eq(text.as_bytes()).into()
    }
}

impl fmt::Display for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl fmt::Debug for Token {
    /// It must not get into a log.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_other_text_is_the_token() {
        let token = Token::new().unwrap();
        let text = token.to_string();
        assert_eq!(text.len(), 2 * BYTES);
        assert!(token.is(&text));
        let mut other = text.clone().into_bytes();
        other[BYTES] ^= 1;
        for wrong in ["", &text[1..], &format!("{text}0"), std::str::from_utf8(&other).unwrap()] {
            assert!(!token.is(wrong), "{wrong}");
        }
        assert!(!Token::new().unwrap().is(&text));
        assert!(!format!("{token:?}").contains(&text));
    }
}
