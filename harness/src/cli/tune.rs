//! `torno tune`
use std::process::ExitCode;
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {}
impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        Ok(ExitCode::SUCCESS)
    }
}
