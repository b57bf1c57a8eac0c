//! `torno servo stop` and `torno servo home`

use std::process::ExitCode;

use torno::servo::{Controller, SerialDevice, ServoLine};

use super::print;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The serial port of the stand
    #[arg(long, value_name = "PATH")]
    port: String,
}

impl Arguments {
    /// What moves answers nothing, so it is stopped before it is asked whether it is there.
    pub(super) async fn stop(self) -> anyhow::Result<ExitCode> {
        let mut controller = Controller::on(SerialDevice::open(&self.port)?);
        controller.stop().await?;
        controller.check_link().await?;
        tell("stopped", &mut controller)
    }

    pub(super) async fn home(self) -> anyhow::Result<ExitCode> {
        let mut controller = Controller::connect(SerialDevice::open(&self.port)?).await?;
        controller.home().await?;
        controller.check_link().await?;
        tell("position is 0", &mut controller)
    }
}

/// The controller confirms neither: it answers behind it (§3.1: its LEDs show the rest).
fn tell(what: &str, controller: &mut Controller<SerialDevice>) -> anyhow::Result<ExitCode> {
    print(&format!("{what}: {}\n", controller.line().name()))?;
    Ok(ExitCode::SUCCESS)
}
