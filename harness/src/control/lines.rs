//! The lines that a client sends, whatever it sends.

use std::io;

use bytes::{Bytes, BytesMut};
use futures_core::Stream;
use tokio::io::AsyncRead;
use tokio_util::codec::{AnyDelimiterCodec, AnyDelimiterCodecError, Decoder, FramedRead};

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

/// Cuts what a client sends into lines. What is wrong with a line is an item, too: an error would end the stream.
#[derive(Debug)]
struct Lines(AnyDelimiterCodec);

/// The lines of a client.
pub(super) fn lines<R: AsyncRead>(input: R) -> impl Stream<Item = io::Result<Result<String, BadLine>>> {
    let codec = AnyDelimiterCodec::new_with_max_length(b"\n".to_vec(), b"\n".to_vec(), LINE_MAX);
    FramedRead::new(input, Lines(codec))
}

impl Lines {
    fn line(decoded: Result<Option<Bytes>, AnyDelimiterCodecError>) -> io::Result<Option<Result<String, BadLine>>> {
        match decoded {
            Ok(line) => Ok(line.map(|line| {
                let text = core::str::from_utf8(&line).map(str::to_owned);
                text.map_err(|error| BadLine::NotText(error.valid_up_to()))
            })),
            Err(AnyDelimiterCodecError::MaxChunkLengthExceeded) => Ok(Some(Err(BadLine::TooLong))),
            Err(AnyDelimiterCodecError::Io(error)) => Err(error),
        }
    }
}

impl Decoder for Lines {
    type Item = Result<String, BadLine>;
    type Error = io::Error;

    fn decode(&mut self, come: &mut BytesMut) -> io::Result<Option<Self::Item>> {
        Self::line(self.0.decode(come))
    }

    fn decode_eof(&mut self, come: &mut BytesMut) -> io::Result<Option<Self::Item>> {
        Self::line(self.0.decode_eof(come))
    }
}

#[cfg(test)]
mod tests {
    use std::future::poll_fn;
    use std::pin::pin;

    use super::*;

    async fn found(bytes: &[u8]) -> Vec<Result<String, BadLine>> {
        let mut lines = pin!(lines(bytes));
        let mut found = Vec::new();
        while let Some(line) = poll_fn(|context| lines.as_mut().poll_next(context)).await {
            found.push(line.unwrap());
        }
        found
    }

    #[tokio::test]
    async fn a_bad_line_is_told_and_the_next_one_read() {
        let longest = "x".repeat(LINE_MAX);
        let text = |text: &str| Ok(text.to_owned());
        let long = [longest.as_bytes(), b"yz\nb\n"].concat();
        assert_eq!(found(b"a\n\nb").await, [text("a"), text(""), text("b")]);
        assert_eq!(found([longest.as_bytes(), b"\nb"].concat().as_slice()).await, [text(&longest), text("b")]);
        assert_eq!(found(&long).await, [Err(BadLine::TooLong), text("b")]);
        // Its end is nowhere near.
        assert_eq!(found(&[longest.as_bytes(), &long].concat()).await, [Err(BadLine::TooLong), text("b")]);
        assert_eq!(found(longest.repeat(3).as_bytes()).await, [Err(BadLine::TooLong)]);
        assert_eq!(found(b"ab\xff\nb\n").await, [Err(BadLine::NotText(2)), text("b")]);
    }
}
