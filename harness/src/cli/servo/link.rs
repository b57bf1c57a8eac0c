//! `torno servo link`

use std::process::ExitCode;

use serde_json::json;
use torno::rig::Driver;
use torno::servo::{Controller, RigLine, ServoLine};
use torno_servo::Language;

use super::{StandOptions, connected, gains, language, print};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    place: StandOptions,
    /// Sets Kx: 0 to 255
    #[arg(long, value_name = "N")]
    kx: Option<u8>,
    /// Sets Kv: 0 to 255
    #[arg(long, value_name = "N")]
    kv: Option<u8>,
    /// The language of what Servo v1.0 says about the link
    #[arg(long, default_value = "en", value_name = "en|pl", value_parser = language)]
    lang: Language,
    /// Prints the result as one line of JSON
    #[arg(long)]
    json: bool,
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        if self.place.port.is_empty() {
            let line = RigLine::start(&self.place.rig()?, &Driver::InProcess).await?;
            return self.on(Controller::connect(line).await?).await;
        }
        match self.place.port(self.lang).await? {
            Ok(controller) => self.on(controller).await,
            Err(code) => Ok(code),
        }
    }

    async fn on<L: ServoLine>(&self, mut controller: Controller<L>) -> anyhow::Result<ExitCode> {
        let (kx, kv) = gains(&mut controller, self.kx, self.kv).await?;
        let on = controller.line().name().to_owned();
        print(&if self.json {
            format!("{}\n", json!({ "on": on, "kx": kx, "kv": kv }))
        } else {
            format!("{}\nKx {kx}, Kv {kv}\n", connected(self.lang, &on))
        })?;
        Ok(ExitCode::SUCCESS)
    }
}
