//! Conversations recorded with the firmware, and what somebody else answers.

/// Plays a conversation, and says where the answers depart from the firmware's. `answers` sends bytes, and gives the
/// lines that come until nothing more does.
pub(crate) fn differences(transcript: &str, mut answers: impl FnMut(&[u8]) -> Vec<String>) -> Vec<String> {
    let mut differences = Vec::new();
    let mut lines = transcript.lines().peekable();
    while let Some(line) = lines.next() {
        let (_, rest) = line.trim_start().split_once(' ').unwrap_or_default();
        let Some(sent) = rest.strip_prefix('>') else { continue };
        let sent = sent.strip_prefix(' ').unwrap_or(sent);
        let mut expected = Vec::new();
        while let Some(line) = lines.next_if(|line| line.trim_start().split(' ').nth(1) != Some(">")) {
            expected.push(line.trim_start().splitn(3, ' ').nth(2).unwrap_or_default().to_owned());
        }
        let found = match sent.strip_prefix('[').and_then(|hex| u8::from_str_radix(hex.strip_suffix(']')?, 16).ok()) {
            Some(byte) => answers(&[byte]),
            None => answers(format!("{sent}\n").as_bytes()),
        };
        if found != expected {
            differences.push(format!("{sent:?}: found {found:?}, expected {expected:?}"));
        }
    }
    differences
}

/// Plays lines in blocks, each with a `board` of its own, and says where the last answer to a line, or the modes after
/// a block, depart from the firmware's.
pub(crate) fn differing_lines<B: FnMut(&[u8]) -> Vec<String>>(lines: &str, board: impl Fn() -> B) -> Vec<String> {
    let mut answers = board();
    let mut differences = Vec::new();
    for line in lines.lines() {
        if line.starts_with("# block") {
            answers = board();
        } else if let Some(modes) = line.strip_prefix("# [GC:") {
            let found = answers(b"$G\n");
            if found != [format!("[GC:{modes}"), "ok".to_owned()] {
                differences.push(format!("{found:?}, expected {modes:?}"));
            }
        } else if let Some((expected, sent)) = line.split_once('\t') {
            let found = answers(format!("{sent}\n").as_bytes());
            if found.last().map(String::as_str) != Some(expected) {
                differences.push(format!("{sent:?}: found {found:?}, expected {expected:?}"));
            }
        }
    }
    differences
}
