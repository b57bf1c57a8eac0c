//! The lines that a client sends, whatever it sends.

use std::io;

use tokio::io::{AsyncBufReadExt, AsyncRead, BufReader};

/// The longest line, in bytes. (Ours: a fault is a few hundred.)
const LINE_MAX: usize = 64 << 10;

/// Why a line is none. The next one may be.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum BadLine {
    /// There is no end to it.
    #[error("expected a request of no more than {LINE_MAX} bytes, found a longer line: it is skipped")]
    TooLong,
    /// It is no text.
    #[error("expected a request in UTF-8, found something else at byte {0}")]
    NotText(usize),
}

/// Reads lines.
#[derive(Debug)]
pub(super) struct Lines<R> {
    input: BufReader<R>,
    line: Vec<u8>,
    /// It was too long, and has not ended yet.
    skipping: bool,
}

impl<R: AsyncRead + Unpin> Lines<R> {
    pub(super) fn new(input: R) -> Self {
        Self { input: BufReader::new(input), line: Vec::new(), skipping: false }
    }

    /// The next line, or what is wrong with it; none at the end. Cancel-safe.
    pub(super) async fn next(&mut self) -> io::Result<Option<Result<String, BadLine>>> {
        loop {
            let come = self.input.fill_buf().await?;
            if come.is_empty() {
                // The last line may lack its end.
                let last = !self.skipping && !self.line.is_empty();
                return Ok(last.then(|| self.finish()));
            }
            let end = come.iter().position(|byte| *byte == b'\n');
            let part = &come[..end.unwrap_or(come.len())];
            let fits = self.line.len() + part.len() <= LINE_MAX;
            if fits && !self.skipping {
                self.line.extend_from_slice(part);
            }
            let taken = part.len() + usize::from(end.is_some());
            self.input.consume(taken);
            let skipped = self.skipping;
            self.skipping = (skipped || !fits) && end.is_none();
            if !fits && !skipped {
                self.line.clear();
                return Ok(Some(Err(BadLine::TooLong)));
            }
            if end.is_some() && !skipped {
                return Ok(Some(self.finish()));
            }
        }
    }

    fn finish(&mut self) -> Result<String, BadLine> {
        let line = core::mem::take(&mut self.line);
        String::from_utf8(line).map_err(|error| BadLine::NotText(error.utf8_error().valid_up_to()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    async fn lines(bytes: &[u8]) -> Vec<Result<String, BadLine>> {
        let mut lines = Lines::new(bytes);
        let mut found = Vec::new();
        while let Some(line) = lines.next().await.unwrap() {
            found.push(line);
        }
        found
    }

    #[tokio::test]
    async fn a_bad_line_is_told_and_the_next_one_read() {
        let longest = "x".repeat(LINE_MAX);
        let text = |text: &str| Ok(text.to_owned());
        let long = [longest.as_bytes(), b"yz\nb\n"].concat();
        assert_eq!(lines(b"a\n\nb").await, [text("a"), text(""), text("b")]);
        assert_eq!(lines([longest.as_bytes(), b"\nb"].concat().as_slice()).await, [text(&longest), text("b")]);
        assert_eq!(lines(&long).await, [Err(BadLine::TooLong), text("b")]);
        // Its end is nowhere near.
        assert_eq!(lines(&[longest.as_bytes(), &long].concat()).await, [Err(BadLine::TooLong), text("b")]);
        assert_eq!(lines(longest.repeat(3).as_bytes()).await, [Err(BadLine::TooLong)]);
        assert_eq!(lines(b"ab\xff\nb\n").await, [Err(BadLine::NotText(2)), text("b")]);
    }
}
