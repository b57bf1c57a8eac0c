//! `torno board`

use std::process::ExitCode;

use torno_machines::kinds;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The kind of board.
    #[arg(value_parser = clap::builder::PossibleValuesParser::new(kinds::names()))]
    kind: String,
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        torno::seat::run(&self.kind).await?;
        Ok(ExitCode::SUCCESS)
    }
}
