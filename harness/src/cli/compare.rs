//! `torno compare`

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::bail;
use torno::observe::Ledger;
use torno::play::Play;
use torno::report::{Comparison, Side};
use torno::rig::Driver;
use torno::rig::file::RigFile;
use torno_protocol::lathe::Program;

use super::{FAILED, INTERRUPTED, Interrupt, Loaded, load_program, print_result};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// A built-in rig or a rig file
    rig: String,
    /// Another
    other: String,
    /// A program: a text file with eight hexadecimal bytes a line, or G-code, which is planned for the first rig
    /// [default: a stepped shaft]
    program: Option<PathBuf>,
    /// Sets what the rig files could say, in each rig that has such a place (may be given several times)
    #[arg(long, value_name = "PLACE=VALUE")]
    set: Vec<String>,
    /// Prints the comparison as one line of JSON
    #[arg(long)]
    json: bool,
}

/// A rig and what has been set in it.
struct Candidate {
    file: RigFile,
    set: Vec<String>,
}

impl Candidate {
    fn load(rig: &str) -> anyhow::Result<Self> {
        let file = RigFile::load(rig)?;
        super::plays_frames(&file)?;
        Ok(Self { file, set: Vec::new() })
    }

    fn set(&mut self, text: &str) -> Result<(), String> {
        self.file = self.file.set(text)?;
        self.set.push(text.to_owned());
        Ok(())
    }

    async fn play(self, program: Program) -> anyhow::Result<Side> {
        let Self { file, set } = self;
        let mut ledger = Ledger::new(&file.layout, file.pc.dialect);
        let name = file.name.clone();
        let play = Play::new(file, program, Driver::InProcess);
        let played = play.run(|progress| ledger.add(progress.facts)).await?;
        Ok(Side {
            rig: name,
            set,
            outcome: played.outcome.name(),
            digest: played.digest.to_string(),
            virtual_s: played.end.as_secs_f64(),
            account: ledger.close(played.end),
        })
    }
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        let mut rigs = [Candidate::load(&self.rig)?, Candidate::load(&self.other)?];
        for text in &self.set {
            set(&mut rigs, text)?;
        }
        let Loaded { name, program, .. } = load_program(self.program.as_deref(), &rigs[0].file, None)?;
        let frames = program.frames.len();
        let mut interrupt = Interrupt::listen()?;
        let [a, b] = rigs;
        let plays = async { anyhow::Ok([a.play(program.clone()).await?, b.play(program).await?]) };
        let sides = tokio::select! {
            sides = plays => sides?,
            () = interrupt.received() => return Ok(ExitCode::from(INTERRUPTED)),
        };
        let comparison = Comparison::new(name, frames, sides);
        print_result(self.json, &comparison)?;
        Ok(if comparison.completed() { ExitCode::SUCCESS } else { ExitCode::from(FAILED) })
    }
}

/// Sets something in each of the rigs that has such a place. One of them must.
fn set(rigs: &mut [Candidate; 2], text: &str) -> anyhow::Result<()> {
    let set = rigs.each_mut().map(|rig| rig.set(text));
    if let [Err(a), Err(b)] = set {
        let [first, second] = rigs.each_ref().map(|rig| &rig.file.name);
        bail!("--set '{text}': on {first}, {a}; on {second}, {b}");
    }
    Ok(())
}
