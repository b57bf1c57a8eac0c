//! The one binary: `torno`.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    #[expect(clippy::disallowed_methods, reason = "how long the whole command takes is told at its end")]
    let started = std::time::Instant::now();
    cli::main(started)
}
