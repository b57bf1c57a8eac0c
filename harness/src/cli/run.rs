//! `torno run`

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use torno::fault::{self, FaultFile};
use torno::job::{FrameJob, Job, LineJob, Outcome};
use torno::kept::KeptFile;
use torno::observe::stderr::say;
use torno::pace::Pace;
use torno::pins::pins;
use torno::play::{Play, PlayEnd, Played, Progress};
use torno::report::page::Page;
use torno::report::{Bar, BoardSummary, Cut, FaultSummary, Frames, Lines, Readout, Stats, Summary, failures};
use torno::rig::file::RigFile;
use torno::scenario::seed_text;
use torno::tracking::{Tracking, has_axes};
use torno_machines::workpiece::ToolPath;
use torno_part::{Place, Profile};
use torno_plot::{Colours, Format};
use torno_protocol::time::Span;
use torno_text::parse_length;
use torno_trace::Timescale;
use tracing::Instrument;

use super::gcode::plan::start;
use super::options::{Eeprom, Placement, drawing, keepers, time, timescale, write_kept};
use super::page::{PageOptions, Role};
use super::{
    FAILED, INTERRUPTED, Interrupt, Loaded, LoadedLines, OutputFile, load_lines, load_program, load_rig, print_beside,
    rig_and_program, rig_span, start_recording, wait_for_boards, written,
};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// A built-in rig or a rig file [default: lathe]
    rig: Option<String>,
    /// A program: a text file with eight hexadecimal bytes a line, or G-code (.ngc .nc .tap .gcode .cnc .gc), which is
    /// planned first, or sent as it is to a controller that takes it [default: a stepped shaft]
    program: Option<PathBuf>,
    /// What a program of G-code calls the place where the tool is at the start, in mm, X as a radius [default: what the
    /// rig's [part] says]
    #[arg(long, value_name = "X,Z", value_parser = start, allow_hyphen_values = true)]
    at: Option<Place>,
    /// Virtual seconds per second, or 'max'; with --page it is 1 [default: max]
    #[arg(long, value_name = "N|max")]
    pace: Option<Pace>,
    /// Where everything random comes from, that is faults [default: what their file says]
    #[arg(long)]
    seed: Option<u64>,
    /// Breaks what this file says: [[fault]] tables as in a scenario
    #[arg(long, value_name = "FILE")]
    faults: Option<PathBuf>,
    #[command(flatten)]
    placement: Placement,
    /// Leaves a board's place open, and waits until 'torno board KIND --join SOCKET' takes it (may be given several
    /// times) [default socket: RIG-BOARD-join in $XDG_RUNTIME_DIR/torno or /tmp/torno-UID]
    #[arg(long = "await", value_name = "BOARD[=SOCKET]")]
    awaited: Vec<String>,
    /// Sets what the rig file could say: BOARD.TABLE.FIELD, BOARD.clock_ppm or pc.FIELD (may be given several times)
    #[arg(long, value_name = "PLACE=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    eeprom: Eeprom,
    /// Writes every line of the rig as a one-bit signal (VCD)
    #[arg(long, value_name = "FILE")]
    vcd: Option<PathBuf>,
    /// Adds the pins between firmware and motors to --vcd: pulse-width modulator, H-bridge, encoder
    #[arg(long, requires = "vcd")]
    pins: bool,
    /// The unit of time of --vcd: 1, 10 or 100 of ns or us, or 1 ms
    #[arg(long, value_name = "TIME", default_value = "1 us", value_parser = timescale, requires = "vcd")]
    vcd_step: Timescale,
    /// Requires that no diameter of the part is further than so many mm from what the program asks for; if one is, the
    /// exit status is 1
    #[arg(long, value_name = "MM", value_parser = tolerance)]
    tolerance: Option<f64>,
    /// Draws the part that was turned (.svg): bar, asked and got, to scale
    #[arg(long, value_name = "FILE", value_parser = drawing)]
    part: Option<PathBuf>,
    /// Writes the profile of the part that was turned, beside the one that was asked for (CSV: z and radii in mm)
    #[arg(long, value_name = "FILE")]
    profile: Option<PathBuf>,
    /// Draws the way of the axes (.svg): asked and gone, and how far they were from it
    #[arg(long, value_name = "FILE", value_parser = drawing)]
    path: Option<PathBuf>,
    /// Writes a page to look at: motion, the bus, the part, the figures (HTML, one file)
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Also tells what limits the rig: grants, bytes, and where the time goes
    #[arg(long)]
    stats: bool,
    /// Records everything that happens, for 'torno trace', 'torno replay' and 'torno diff'; overwrites a trace
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Gives up when nothing of the program has been accepted for so long, in virtual time
    #[arg(long, default_value = "3600 s", value_name = "TIME", value_parser = time)]
    patience: Span,
    #[command(flatten)]
    page: PageOptions,
    /// Prints the summary as one line of JSON; before it, one for --await and one for --page
    #[arg(long)]
    json: bool,
}

/// The rig that is meant.
struct Chosen {
    /// As it was named.
    rig: String,
    file: RigFile,
    kept_files: Vec<KeptFile>,
}

impl Arguments {
    pub(super) async fn run(self, started: Instant) -> anyhow::Result<ExitCode> {
        [&self.vcd, &self.part, &self.profile, &self.path, &self.report]
            .into_iter()
            .flatten()
            .for_each(|path| OutputFile::empty(path));
        let (rig, program) = rig_and_program(self.rig.clone(), self.program.clone());
        let (kept_files, file) = self.eeprom.open(load_rig(&rig, &self.set)?)?;
        let span = rig_span(&file);
        self.play(started, Chosen { rig, file, kept_files }, program).instrument(span).await
    }

    async fn play(self, started: Instant, chosen: Chosen, program: Option<PathBuf>) -> anyhow::Result<ExitCode> {
        let file = &chosen.file;
        if file.pc.dialect.counts_characters() {
            let LoadedLines { name, job, asked } = load_lines(program.as_deref(), file, self.at)?;
            return self.play_job(started, chosen, name, job, asked).await;
        }
        super::plays_frames(file)?;
        let Loaded { name, program, asked } = load_program(program.as_deref(), file, self.at)?;
        let asked = asked.or_else(|| file.part.as_ref().map(|part| part.asked(&program)));
        self.play_job(started, chosen, name, FrameJob::new(program), asked).await
    }

    async fn play_job<J: JobSummary>(
        self,
        started: Instant,
        Chosen { rig, file, kept_files }: Chosen,
        program_name: String,
        job: J,
        asked: Option<Profile>,
    ) -> anyhow::Result<ExitCode> {
        let of_part = [
            ("--part", self.part.is_some()),
            ("--profile", self.profile.is_some()),
            ("--tolerance", self.tolerance.is_some()),
        ];
        if let Some((option, _)) = of_part.iter().find(|(_, given)| *given && file.part.is_none()) {
            anyhow::bail!("{option}: the rig '{}' turns no part: expected a [part] in its file", file.name);
        }
        let has_axes = file.boards.iter().any(|board| has_axes(&board.description));
        anyhow::ensure!(
            self.path.is_none() || has_axes,
            "--path: no board of the rig '{}' tells in nm where its axes are: expected a rig such as 'engraver'",
            file.name
        );
        let names = file.names();
        let FaultFile { seed, drawn, faults } = match &self.faults {
            Some(path) => fault::load(path, &names, self.seed)?,
            None => FaultFile { seed: self.seed.unwrap_or_default(), ..FaultFile::default() },
        };
        if !drawn.is_empty() {
            say(&format!("seed {}\n", seed_text(seed, &drawn)));
        }
        let [vcd, drawing, profile, report] =
            [&self.vcd, &self.part, &self.profile, &self.report].map(|path| path.as_ref().map(OutputFile::create));
        let (vcd, drawing) = (vcd.transpose()?, drawing.transpose()?);
        let (profile, report) = (profile.transpose()?, report.transpose()?);
        let path = self.path.as_ref().map(OutputFile::create).transpose()?;
        let asked = file.part.clone().zip(asked);
        let header = file.header(&rig, seed, Some(&program_name));
        let keep = (report.is_some() || path.is_some() || self.pins).then(|| header.clone());
        let recorder = self.record.as_deref().map(|path| start_recording(path, &header)).transpose()?;
        let (_, total) = job.reached();
        let mut readout = Readout::new(&file, J::STATES, self.at);
        let tail = file.margin();
        let rig = file.name.clone();
        let waveforms = vcd.is_some();
        let others = self.placement.or_processes()?;
        let mut interrupt = Interrupt::listen()?;
        let waited = wait_for_boards(&file, &self.awaited, others, self.json, &mut interrupt).await?;
        let Some((driver, waited)) = waited else { return Ok(ExitCode::from(INTERRUPTED)) };
        let started = started + waited;
        let pace = self.pace.unwrap_or(self.page.usual_pace());
        let measure = self.stats;
        let files = [&self.vcd, &self.part, &self.profile, &self.path, &self.report];
        let (page, audience) = self.page.show(&file, &header, Role::Run, pace)?;
        if let Some(page) = &page {
            print_beside(&files, &page.announcement(pace, self.json))?;
        }
        let patience = self.patience;
        let keepers = keepers(&kept_files);
        let play = Play { pace, faults, waveforms, measure, keep, keepers, patience, ..Play::of(file, job, driver) };

        let bar = Bar::new(J::UNIT, total, started);
        let progress = |progress: Progress<'_, J>| {
            if bar.is_hidden() {
                return;
            }
            readout.take(progress.facts);
            bar.update(progress.job.reached().0, Some(progress.now), &readout.text());
        };
        let mut played = play.show(recorder, audience, progress, interrupt.received()).await?;
        bar.clear();
        // That a browser is slow to hear of the end is no part of the run.
        let wall = started.elapsed();
        if let Some(page) = page {
            page.end(played.outcome()).await;
        }
        let started = started + (started.elapsed() - wall);
        write_kept(&kept_files, &played.kept)?;
        for unfired in &played.unfired {
            tracing::warn!("{unfired}");
        }
        if let (Some(waveforms), Some(trace)) = (&mut played.waveforms, played.trace.as_ref().filter(|_| self.pins)) {
            waveforms.add_pins(pins(trace)?);
        }
        if let (Some(file), Some(waveforms)) = (vcd, &played.waveforms) {
            file.write_by(|file| waveforms.write(file, played.end, tail, self.vcd_step))?;
        }
        let part = asked.zip(played.path.take().map(ToolPath::cut));
        let cut = part.map(|((part, asked), turned)| Cut::new(part, Some(asked), turned, self.tolerance));
        if let (Some(file), Some(cut)) = (drawing, &cut) {
            file.write(cut.draw(&rig, &program_name))?;
        }
        if let (Some(file), Some(cut)) = (profile, &cut) {
            file.write(cut.csv())?;
        }
        if let (Some(file), Some(trace)) = (path, &played.trace)
            && let Some(tracking) = Tracking::of(trace)?
        {
            let figure = tracking.figure(&format!("{program_name} on {rig}"));
            file.write(figure.encode(Format::Svg, &Colours::default())?)?;
        }
        let as_required = cut.as_ref().is_none_or(|cut| cut.summary.is_as_required());
        let code = match played.ended {
            PlayEnd::Interrupted => ExitCode::from(INTERRUPTED),
            PlayEnd::Over if played.outcome == Outcome::Completed && as_required => ExitCode::SUCCESS,
            PlayEnd::Over | PlayEnd::OutOfPatience => ExitCode::from(FAILED),
        };
        let (part, trace) = (cut.as_ref().map(|cut| cut.summary.clone()), played.trace.take());
        let summary = Summary { part, ..summary(played, rig, program_name, seed, started) };
        if let (Some(file), Some(trace)) = (report, trace) {
            let (title, faults) = (&summary.program, &summary.faults);
            let summary = Some(&summary);
            file.write(Page { trace: &trace, title, summary, cut: cut.as_ref(), faults, facts: &[] }.html())?;
        }
        print_beside(&files, &written(self.json, &summary)?)?;
        Ok(code)
    }
}

/// What is told of a job.
trait JobSummary: Job {
    /// What came of its frames or lines, and what failed.
    fn told(&self) -> (Option<Frames>, Option<Lines>, Vec<String>);
}

impl JobSummary for FrameJob {
    fn told(&self) -> (Option<Frames>, Option<Lines>, Vec<String>) {
        (Some(Frames::new(&self.tally, self.program.frames.len())), None, failures(&self.tally))
    }
}

impl JobSummary for LineJob {
    fn told(&self) -> (Option<Frames>, Option<Lines>, Vec<String>) {
        (None, Some(Lines::new(self)), self.alarm.iter().cloned().collect())
    }
}

/// So many mm; with or without the unit.
fn tolerance(text: &str) -> Result<f64, String> {
    let mm = text.parse().or_else(|_| parse_length(text)).ok().filter(|mm| (0.0..=1_000.0).contains(mm));
    mm.ok_or_else(|| "expected mm, from 0 to 1000, such as 0.05 or '50 um'".to_owned())
}

fn summary<J: JobSummary>(played: Played<J>, rig: String, program: String, seed: u64, started: Instant) -> Summary {
    let (frames, lines, failures) = played.job.told();
    let wall = started.elapsed();
    let wall_s = wall.as_secs_f64();
    let virtual_s = played.end.as_secs_f64();
    Summary {
        rig: Some(rig),
        port: None,
        program,
        outcome: played.outcome(),
        frames,
        lines,
        failures: failures.into_iter().chain(played.cut_short()).collect(),
        virtual_s: Some(virtual_s),
        idle_after_s: played.idle_after.map(Span::as_secs_f64),
        wall_s,
        speedup: Some(virtual_s / wall_s),
        seed: Some(seed),
        digest: Some(played.digest.to_string()),
        pid: std::process::id(),
        incidents: played.incidents.iter().map(|incident| format!("{}: {incident}", incident.at)).collect(),
        faults: FaultSummary::of(&played.begun),
        part: None,
        stats: played.measured.map(|measured| Stats::new(&played.costs, virtual_s, wall, measured)),
        order: played.boards.iter().map(|board| board.name.clone()).collect(),
        boards: played
            .boards
            .into_iter()
            .map(|board| (board.name, BoardSummary { pid: board.pid, telemetry: board.telemetry }))
            .collect(),
    }
}
