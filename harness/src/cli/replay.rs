//! `torno replay`

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use serde_json::json;
use torno::replay::{rig_of, show};
use torno::session::INTERRUPTED as ENDED;
use torno_trace::diff::{Extent, first_difference};

use super::options::Placement;
use super::page::{Role, WatchOptions};
use super::{FAILED, INTERRUPTED, Interrupt, USAGE, load_trace, print};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The trace that '--record' has written
    file: PathBuf,
    #[command(flatten)]
    placement: Placement,
    #[command(flatten)]
    watch: WatchOptions,
    /// Prints the result as one line of JSON; before it, one for --page
    #[arg(long)]
    json: bool,
}

impl Arguments {
    pub(super) async fn run(self, started: Instant) -> anyhow::Result<ExitCode> {
        let (trace, damage) = load_trace(&self.file)?;
        let driver = self.placement.or_in_process()?;
        let mut interrupt = Interrupt::listen()?;
        let (page, audience) = if self.watch.is_asked() {
            let (file, header) = rig_of(&trace)?;
            self.watch.show(&file, &header, Role::Replay, self.json)?
        } else {
            (None, None)
        };
        let again = tokio::select! {
            again = show(&trace, &driver, audience) => again?,
            () = interrupt.received() => {
                if let Some(page) = page {
                    page.end(ENDED).await;
                }
                let json = json!({ "outcome": ENDED, "same": null });
                print(&if self.json { format!("{json}\n") } else { format!("{ENDED}: nothing is compared\n") })?;
                return Ok(ExitCode::from(INTERRUPTED));
            }
        };
        let digest = again.digest.to_string();
        let (virtual_s, wall_s) = (trace.until().as_secs_f64(), started.elapsed().as_secs_f64());
        let same = trace.end.as_ref().map(|end| end.digest == digest);
        let extent = if same.is_some() { Extent::Whole } else { Extent::Beginning };
        let difference = if same == Some(true) {
            None
        } else {
            first_difference(&trace, &again.trace, extent, torno_machines::dialect)
        };
        let recorded = trace.end.as_ref().map(|end| end.digest.as_str());
        let is_same = same.unwrap_or(difference.is_none());
        let text = if self.json {
            let result = json!({
                "same": is_same,
                "digest": digest,
                "recorded": recorded,
                "virtual_s": virtual_s,
                "wall_s": wall_s,
                "difference": difference.as_ref().map(|difference| difference.json()),
            });
            format!("{result}\n")
        } else {
            let time = format!("{virtual_s:.3} s virtual repeated in {wall_s:.3} s");
            match (&difference, same) {
                (None, Some(true)) => format!("same digest {digest}: {time}\n"),
                (None, None) => format!("the same as far as it is recorded: {time}\n"),
                (None, Some(false)) => {
                    let recorded = recorded.unwrap_or_default();
                    format!("digest {digest} instead of {recorded}, and yet the facts are the same: {time}\n")
                }
                (Some(difference), _) => difference.text("recorded", "repeated"),
            }
        };
        if let Some(page) = page {
            page.end(if is_same { "the same" } else { "not the same" }).await;
        }
        print(&text)?;
        Ok(match is_same {
            // What cannot be read may differ.
            _ if damage.is_some() => ExitCode::from(USAGE),
            true => ExitCode::SUCCESS,
            false => ExitCode::from(FAILED),
        })
    }
}
