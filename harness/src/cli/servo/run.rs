//! `torno servo run`

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use torno::observe::stderr::say;
use torno::pace::Pace;
use torno::report::Status;
use torno::report::page::Page;
use torno::servo::controller::parts;
use torno::servo::report::facts;
use torno::servo::{Controller, Report, RigLine, RunEnd, ServoLine};

use super::{
    FAILED, INTERRUPTED, Interrupt, OutputFile, Paint, Source, Stand, StandOptions, connected, draw, gains,
    print_beside, start_recording, write_file,
};
use crate::cli::options::{Placement, picture};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The motion program
    program: PathBuf,
    #[command(flatten)]
    place: StandOptions,
    #[command(flatten)]
    stand: Stand,
    /// Sets Kx before: 0 to 255
    #[arg(long, value_name = "N")]
    kx: Option<u8>,
    /// Sets Kv before: 0 to 255
    #[arg(long, value_name = "N")]
    kv: Option<u8>,
    /// Sends even a program that leaves the travel or is too fast for the motor
    #[arg(long)]
    force: bool,
    /// Virtual seconds per second, or 'max'
    #[arg(long, default_value = "max", value_name = "N|max", conflicts_with = "port")]
    pace: Pace,
    #[command(flatten)]
    placement: Placement,
    /// Records everything that happens, for 'torno trace', 'torno replay' and 'torno diff'; overwrites a trace
    #[arg(long, value_name = "FILE", conflicts_with = "port")]
    record: Option<PathBuf>,
    /// Writes a page to look at: motion, the line, the figures (HTML, one file)
    #[arg(long, value_name = "FILE", conflicts_with = "port")]
    report: Option<PathBuf>,
    /// Draws the run (.svg or .png): positions, and the following error of the last 4 s
    #[arg(short = 'o', long, alias = "out", value_name = "FILE", value_parser = picture)]
    plot: Option<PathBuf>,
    #[command(flatten)]
    paint: Paint,
    /// Writes the data, a line a tick; '-' is standard output
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Prints the report as one line of JSON
    #[arg(long)]
    json: bool,
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        let source = Source::load(&self.program, &self.stand)?;
        say(&source.findings(self.stand.lang));
        if source.compiled.program.is_none() {
            say(&format!("{}\n", source.compiled.verdict(self.stand.lang)));
            return Ok(ExitCode::from(FAILED));
        }
        if !(self.force || source.compiled.can_be_driven()) {
            say("nothing is sent to the controller\n");
            return Ok(ExitCode::from(FAILED));
        }
        if self.place.port.is_empty() {
            return self.on_rig(&source).await;
        }
        anyhow::ensure!(!self.placement.is_chosen(), "a stand at --port has no boards to place: leave the option out");
        match self.place.port(self.stand.lang).await? {
            Ok(mut controller) => {
                say(&format!("{}\n", connected(self.stand.lang, controller.line().name())));
                let ran = self.on(&mut controller, &source).await;
                // The port is free before anything is written.
                drop(controller.disconnect());
                self.tell(&ran?)
            }
            Err(code) => Ok(code),
        }
    }

    async fn on_rig(&self, source: &Source) -> anyhow::Result<ExitCode> {
        let file = self.place.rig()?;
        let header = file.header(&self.place.rig, 0, Some(&source.name));
        let recorder = self.record.as_deref().map(|path| start_recording(path, &header)).transpose()?;
        let page = self.report.as_ref().map(OutputFile::create).transpose()?;
        let mut line = RigLine::start(&file, &self.placement.or_processes()?).await?;
        line.set_pace(self.pace)?;
        if let Some(recorder) = recorder {
            line.session().record(recorder);
        }
        if page.is_some() {
            line.session().keep(header);
        }
        let mut controller = Controller::on(line);
        let ran = self.on(&mut controller, source).await;
        let outcome = ran.as_ref().map_or("failed", |report| report.ended.name());
        let left = controller.disconnect().end(outcome).await?;
        if let (Some(file), Some(trace)) = (page, &left.trace) {
            let (title, facts) = (&source.name, facts(trace));
            file.write(Page { trace, title, summary: None, cut: None, faults: &[], facts: &facts }.html())?;
        }
        self.tell(&Report { rig: Some((left.end, left.boards)), ..ran? })
    }

    /// Downloads the program and runs it; both can be interrupted.
    async fn on<L: ServoLine>(&self, controller: &mut Controller<L>, source: &Source) -> anyhow::Result<Report> {
        let program = source.compiled.program.as_ref().context("there is no program")?;
        controller.check_link().await?;
        let mut report = Report {
            program: source.name.clone(),
            on: controller.line().name().to_owned(),
            gains: gains(controller, self.kx, self.kv).await?,
            counts_per_mm: self.stand.counts_per_mm,
            ended: RunEnd::Completed,
            set_points: program.set_points(self.stand.counts_per_mm).collect(),
            samples: Vec::new(),
            rig: None,
        };
        let increments = program.increments(self.stand.counts_per_mm);
        let all = increments.len();
        let parts = parts(&increments);
        let mut interrupt = Interrupt::listen()?;
        let status = Status::new();
        for (n, part) in parts.iter().enumerate() {
            let of_parts = if parts.len() > 1 { format!("part {} of {}: ", n + 1, parts.len()) } else { String::new() };
            let before = report.samples.len();
            let samples = &mut report.samples;
            let drive = async {
                let progress = |gone, of| status.show(|| format!("{of_parts}download {gone} of {of} bytes"));
                controller.download(part, progress).await?;
                let heard = |mut sample: torno::servo::Sample| {
                    sample.tick += before;
                    samples.push(sample);
                    let (tick, shown) = (sample.tick, sample.shown);
                    status.show(|| format!("{of_parts}tick {tick} of {all}  error {shown:+4} counts"));
                    true
                };
                controller.run(part.len(), heard).await
            };
            report.ended = tokio::select! {
                ended = drive => ended?,
                () = interrupt.received() => {
                    controller.stop().await?;
                    RunEnd::Interrupted
                }
            };
            if report.ended != RunEnd::Completed {
                break;
            }
        }
        status.clear();
        Ok(report)
    }

    fn tell(&self, report: &Report) -> anyhow::Result<ExitCode> {
        if let Some(path) = &self.plot {
            draw(path, &report.figure(), &self.paint.colours())?;
        }
        if let Some(path) = &self.csv {
            write_file(path, report.csv())?;
        }
        let text = if self.json { format!("{}\n", report.json()) } else { report.text() };
        print_beside(&[&self.plot, &self.csv, &self.report], &text)?;
        Ok(match report.ended {
            RunEnd::Completed => ExitCode::SUCCESS,
            RunEnd::Early => ExitCode::from(FAILED),
            RunEnd::Interrupted => ExitCode::from(INTERRUPTED),
        })
    }
}
