//! The progress bar: on standard error, and only if that is a terminal.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use torno_protocol::time::Instant;

/// The same bar as this template, which is part of the program, says.
fn drawn(bar: ProgressBar, template: &str) -> ProgressBar {
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    bar.with_style(style.progress_chars("━╸─"))
}

/// A bar that shows how much of a program has been executed.
pub struct Bar {
    bar: ProgressBar,
    wall: std::time::Instant,
}

impl Bar {
    /// A bar for so many frames or lines: `what` they are. `wall` is when the command started.
    pub fn new(what: &str, total: usize, wall: std::time::Instant) -> Self {
        let template = format!("{what} {{pos}} of {{len}} {{bar:32.cyan/blue}} {{msg}}");
        let bar = drawn(ProgressBar::new(total as u64), &template);
        // It ticks in a thread of its own: not for nothing.
        if !bar.is_hidden() {
            bar.enable_steady_tick(Duration::from_millis(250));
        }
        Self { bar, wall }
    }

    /// A bar for so many frames, from now on.
    #[expect(clippy::disallowed_methods, reason = "a bar shows wall time")]
    pub fn of_frames(frames: usize) -> Self {
        Self::new("frame", frames, std::time::Instant::now())
    }

    /// A bar for so many scenarios.
    #[expect(clippy::disallowed_methods, reason = "a bar shows wall time")]
    pub fn of_scenarios(scenarios: u64) -> Self {
        let bar = drawn(ProgressBar::new(scenarios), "scenario {pos} of {len} {bar:32.cyan/blue} {msg}");
        Self { bar, wall: std::time::Instant::now() }
    }

    /// A bar for a file of so many bytes.
    #[expect(clippy::disallowed_methods, reason = "a bar shows wall time")]
    pub fn of_bytes(bytes: u64) -> Self {
        let bar = drawn(ProgressBar::new(bytes), "{bytes} of {total_bytes} {bar:32.cyan/blue}");
        Self { bar, wall: std::time::Instant::now() }
    }

    /// So many are done.
    pub fn reach(&self, done: u64) {
        self.bar.set_position(done);
    }

    /// One more scenario is done.
    pub fn count(&self) {
        if self.bar.is_hidden() {
            return;
        }
        self.bar.inc(1);
        let (done, of) = (self.bar.position(), self.bar.length().unwrap_or_default());
        self.bar.set_message(left(done, of, self.wall.elapsed()));
    }

    /// Whether nobody sees it.
    pub fn is_hidden(&self) -> bool {
        self.bar.is_hidden()
    }

    /// So much has been executed by `now`, in virtual time if that is known; `also` comes before the time.
    pub fn update(&self, executed: usize, now: Option<Instant>, also: &str) {
        if self.bar.is_hidden() {
            return;
        }
        let wall = self.wall.elapsed().as_secs_f64();
        let message = match now {
            Some(now) => format!("{also}{:.1} s virtual, {wall:.1} s wall", now.as_secs_f64()),
            None => format!("{also}{wall:.1} s"),
        };
        self.bar.set_message(message);
        self.bar.set_position(executed as u64);
    }

    /// Does something with the bar out of the way: it may print on the same terminal.
    pub fn suspend<R>(&self, print: impl FnOnce() -> R) -> R {
        self.bar.suspend(print)
    }

    /// Takes the bar away.
    pub fn clear(&self) {
        self.bar.finish_and_clear();
    }
}

/// How long the rest of `of` things takes, if `done` of them took so long. Nothing before the first: that would be a
/// guess.
fn left(done: u64, of: u64, took: Duration) -> String {
    if done == 0 {
        return String::new();
    }
    let seconds = (took.as_secs_f64() / done as f64 * of.saturating_sub(done) as f64).round() as u64;
    let (hours, minutes, seconds) = (seconds / 3600, seconds / 60 % 60, seconds % 60);
    match (hours, minutes) {
        (0, 0) => format!("{seconds} s left"),
        (0, _) => format!("{minutes} min {seconds} s left"),
        _ => format!("{hours} h {minutes} min left"),
    }
}

/// A line in which a terminal shows how far things have come; nothing, if standard error is none.
#[derive(Debug)]
pub struct Status {
    line: ProgressBar,
}

impl Status {
    /// An empty line.
    pub fn new() -> Self {
        Self { line: drawn(ProgressBar::no_length(), "{msg}") }
    }

    /// Shows this, unless something has been shown just now.
    pub fn show(&self, text: impl FnOnce() -> String) {
        if !self.line.is_hidden() {
            self.line.set_message(text());
        }
    }

    /// Takes it off the terminal.
    pub fn clear(&self) {
        self.line.finish_and_clear();
    }
}

impl Default for Status {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_takes_as_long_for_each_as_what_is_done() {
        let left = |done, of, ms| left(done, of, Duration::from_millis(ms));
        assert_eq!(left(0, 600, 5_000), "");
        assert_eq!(left(9, 600, 900), "59 s left");
        assert_eq!(left(100, 600, 30_000), "2 min 30 s left");
        assert_eq!(left(1, 600, 60_000), "9 h 59 min left");
        assert_eq!(left(600, 600, 60_000), "0 s left");
    }
}
