//! The lines that a client sends, whatever it sends.

use std::io;

use bytes::{Bytes, BytesMut};
use futures_core::Stream;
use tokio::io::AsyncRead;
use tokio_util::codec::{AnyDelimiterCodec, AnyDelimiterCodecError, Decoder, FramedRead};

use crate::text_file::LENGTH_MAX;

/// The longest line, in bytes: the longest program, each character of which may be written as two.
pub(super) const LINE_MAX: usize = 2 * LENGTH_MAX as usize;

/// Why a line is none. The next one may be.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum BadLine {
    /// There is no end to it.
    #[error("expected a request of no more than {0} bytes, found a longer line: it is skipped")]
    TooLong(usize),
    /// It is no text.
    #[error("expected a request in UTF-8, found something else at byte {0}")]
    NotText(usize),
}

/// Cuts what a client sends into lines. What is wrong with a line is an item, too: an error would end the stream.
#[derive(Debug)]
struct Lines {
    codec: AnyDelimiterCodec,
    longest: usize,
}

/// The lines of a client, of at most so many bytes.
pub(super) fn lines<R: AsyncRead>(input: R, longest: usize) -> impl Stream<Item = io::Result<Result<String, BadLine>>> {
    let codec = AnyDelimiterCodec::new_with_max_length(b"\n".to_vec(), b"\n".to_vec(), longest);
    FramedRead::new(input, Lines { codec, longest })
}

impl Lines {
    fn line(
        &self,
        decoded: Result<Option<Bytes>, AnyDelimiterCodecError>,
    ) -> io::Result<Option<Result<String, BadLine>>> {
        match decoded {
            Ok(line) => Ok(line.map(|line| {
                let text = core::str::from_utf8(&line).map(str::to_owned);
                text.map_err(|error| BadLine::NotText(error.valid_up_to()))
            })),
            Err(AnyDelimiterCodecError::MaxChunkLengthExceeded) => Ok(Some(Err(BadLine::TooLong(self.longest)))),
            Err(AnyDelimiterCodecError::Io(error)) => Err(error),
        }
    }
}

impl Decoder for Lines {
    type Item = Result<String, BadLine>;
    type Error = io::Error;

    fn decode(&mut self, come: &mut BytesMut) -> io::Result<Option<Self::Item>> {
        let decoded = self.codec.decode(come);
        self.line(decoded)
    }

    fn decode_eof(&mut self, come: &mut BytesMut) -> io::Result<Option<Self::Item>> {
        let decoded = self.codec.decode_eof(come);
        self.line(decoded)
    }
}

#[cfg(test)]
mod tests {
    use std::future::poll_fn;
    use std::pin::pin;

    use super::*;

    const LONGEST: usize = 64 << 10;

    async fn found(bytes: &[u8]) -> Vec<Result<String, BadLine>> {
        let mut lines = pin!(lines(bytes, LONGEST));
        let mut found = Vec::new();
        while let Some(line) = poll_fn(|context| lines.as_mut().poll_next(context)).await {
            found.push(line.unwrap());
        }
        found
    }

    #[tokio::test]
    async fn a_bad_line_is_told_and_the_next_one_read() {
        let longest = "x".repeat(LONGEST);
        let text = |text: &str| Ok(text.to_owned());
        let long = [longest.as_bytes(), b"yz\nb\n"].concat();
        assert_eq!(found(b"a\n\nb").await, [text("a"), text(""), text("b")]);
        assert_eq!(found([longest.as_bytes(), b"\nb"].concat().as_slice()).await, [text(&longest), text("b")]);
        assert_eq!(found(&long).await, [Err(BadLine::TooLong(LONGEST)), text("b")]);
        // Its end is nowhere near.
        assert_eq!(found(&[longest.as_bytes(), &long].concat()).await, [Err(BadLine::TooLong(LONGEST)), text("b")]);
        assert_eq!(found(longest.repeat(3).as_bytes()).await, [Err(BadLine::TooLong(LONGEST))]);
        assert_eq!(found(b"ab\xff\nb\n").await, [Err(BadLine::NotText(2)), text("b")]);
    }
}
