//! `torno board`

use std::path::PathBuf;
use std::process::ExitCode;

use torno_machines::kinds;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The kind of board.
    #[arg(value_parser = clap::builder::PossibleValuesParser::new(kinds::names()))]
    kind: String,
    /// Joins the rig that waits for this board at this socket: 'torno up --await BOARD' tells which
    #[arg(long, value_name = "SOCKET")]
    join: Option<PathBuf>,
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        torno::seat::run(&self.kind, self.join.as_deref()).await?;
        Ok(ExitCode::SUCCESS)
    }
}
