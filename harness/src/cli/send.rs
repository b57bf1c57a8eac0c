//! `torno send`

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use torno::job::{Outcome, Tally};
use torno::report::{Bar, Frames, Summary, failures};
use torno::send::Send;
use torno::session;
use torno_protocol::lathe::BAUD;
use torno_protocol::time::Span;

use super::options::time;
use super::{DEFAULT, FAILED, INTERRUPTED, Interrupt, Loaded, load_program, load_rig, print, print_result};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The program: a text file with eight hexadecimal bytes a line, or G-code (.ngc .nc .tap .gcode .cnc .gc), which
    /// is planned first
    program: PathBuf,
    /// The rig that G-code is planned for: a built-in rig or a rig file
    #[arg(long, default_value = DEFAULT)]
    rig: String,
    /// The serial port: the link that 'torno up' prints, or a real machine's
    #[arg(long)]
    port: String,
    /// The port's speed in baud
    #[arg(long, default_value_t = BAUD, value_parser = clap::value_parser!(u32).range(50..=4_000_000))]
    baud: u32,
    /// How long a frame may go without any answer
    #[arg(long, alias = "timeout", default_value = "5 s", value_name = "TIME", value_parser = patience)]
    patience: Span,
    /// Prints the summary as one line of JSON
    #[arg(long)]
    json: bool,
}

fn patience(text: &str) -> Result<Span, String> {
    let span = time(text)?;
    let allowed = Span::from_millis(10)..=Span::from_secs(86_400);
    if allowed.contains(&span) { Ok(span) } else { Err("expected 10 ms to 86400 s".to_owned()) }
}

impl Arguments {
    pub(super) async fn run(self, started: Instant) -> anyhow::Result<ExitCode> {
        let rig = load_rig(&self.rig, &[])?;
        let Loaded { name: program_name, program, .. } = load_program(Some(&self.program), &rig, None)?;
        let frames = program.frames.len();
        let patience = Duration::from_nanos(self.patience.as_nanos());
        let send = Send { program, port: self.port.clone(), baud: self.baud, patience };
        let mut interrupt = Interrupt::listen()?;
        let bar = Bar::new("frame", frames, started);
        let mut conversation = Tally::default();
        let run = send.run(&mut conversation, |conversation, reply| {
            if self.json {
                tracing::info!("{reply}");
            } else {
                // The replies are part of the result.
                let line = format!("{:9.3} s  {reply}\n", started.elapsed().as_secs_f64());
                bar.suspend(|| print(&line)).ok();
            }
            bar.update(conversation.accepted, None, "");
        });
        let outcome = tokio::select! {
            ended = run => Some(ended?),
            () = interrupt.received() => None,
        };
        bar.clear();
        let summary = Summary {
            rig: None,
            port: Some(self.port),
            program: program_name,
            outcome: outcome.map_or(session::INTERRUPTED, Outcome::name),
            frames: Some(Frames::new(&conversation, frames)),
            lines: None,
            failures: failures(&conversation),
            virtual_s: None,
            idle_after_s: None,
            wall_s: started.elapsed().as_secs_f64(),
            speedup: None,
            seed: None,
            digest: None,
            pid: std::process::id(),
            incidents: Vec::new(),
            faults: Vec::new(),
            boards: BTreeMap::new(),
            part: None,
            stats: None,
            order: Vec::new(),
        };
        print_result(self.json, &summary)?;
        Ok(match outcome {
            Some(Outcome::Completed) => ExitCode::SUCCESS,
            Some(_) => ExitCode::from(FAILED),
            None => ExitCode::from(INTERRUPTED),
        })
    }
}
