//! `torno up`

mod ways;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use serde::Serialize;
use serde_json::json;
use torno::control::Control;
use torno::fault::{self, FaultFile};
use torno::kept::KeptFile;
use torno::live::{Left, Live};
use torno::pace::Pace;
use torno::report::{Cut, FaultSummary};
use torno::rig::ProcessChange;
use torno::rig::file::{DEFAULT, RigFile};
use torno::saving::{SESSION, report, write_waveforms};
use torno::scenario::seed_text;
use torno::session::ENDED;
use torno::spool::Spool;
use torno_trace::Timescale;
use tracing::Instrument;

use super::options::{Eeprom, Placement, drawing, keepers, write_kept};
use super::output::OutputFile;
use super::page::{self, PageOptions, Role};
use super::{FAILED, INTERRUPTED, Interrupt, load_rig, print_beside, rig_span, start_recording, wait_for_boards};
use ways::{Open, Ports, Ways, attach, paths};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// A built-in rig or a rig file [default: lathe]
    rig: Option<String>,
    #[command(flatten)]
    ways: Ways,
    /// Virtual seconds per second, or 'max': as fast as the rig has something to do
    #[arg(long, default_value = "1", value_name = "N|max")]
    pace: Pace,
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
    /// Records everything that happens, for 'torno trace', 'torno replay' and 'torno diff'; overwrites a trace
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Draws the part that has been turned into this file (SVG), at the end; '-' is standard output
    #[arg(long, value_name = "FILE", value_parser = drawing)]
    part: Option<PathBuf>,
    /// Writes a report of the session into this file (HTML), at the end; '-' is standard output
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Writes every line into this file for a logic analyser (VCD), at the end; '-' is standard output
    #[arg(long, value_name = "FILE")]
    vcd: Option<PathBuf>,
    /// Keeps so many MiB of what happens, on disk, for 'torno ctl save' and the page; 0 keeps nothing
    #[arg(long, value_name = "MIB", default_value = "64")]
    keep: u32,
    /// Breaks what this file says: [[fault]] tables as in a scenario
    #[arg(long, value_name = "FILE")]
    faults: Option<PathBuf>,
    /// Where to put the socket that 'torno ctl' steers it by [default: beside the link, RIG-control]
    #[arg(long, value_name = "PATH")]
    control: Option<PathBuf>,
    #[command(flatten)]
    page: PageOptions,
    /// Prints where everything is as one line of JSON, when the rig is ready; before it, one for --await; at the end,
    /// one that says how it was
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Ready<'a> {
    rig: &'a str,
    pace: serde_json::Value,
    ports: BTreeMap<&'a str, Port<'a>>,
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    taps: BTreeMap<&'a str, Port<'a>>,
    /// The boards that are left out.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    open: &'a [String],
    control: &'a Path,
    #[serde(skip_serializing_if = "Option::is_none")]
    page: Option<&'a str>,
    pid: u32,
    boards: BTreeMap<&'a str, Board>,
}

#[derive(Serialize)]
struct Port<'a> {
    /// As pyserial opens it.
    port: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    path: Option<&'a Path>,
    #[serde(skip_serializing_if = "Option::is_none")]
    device: Option<&'a Path>,
    baud: u32,
}

#[derive(Serialize)]
struct Board {
    pid: u32,
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        let file = load_rig(self.rig.as_deref().unwrap_or(DEFAULT), &self.set)?;
        let (kept_files, file) = self.eeprom.open(file)?;
        let span = rig_span(&file);
        self.up(file, kept_files).instrument(span).await
    }

    async fn up(self, file: RigFile, kept_files: Vec<KeptFile>) -> anyhow::Result<ExitCode> {
        if let Some(name) = self.part.as_ref().filter(|_| file.part.is_none()).map(|_| &file.name) {
            anyhow::bail!("--part: the rig '{name}' turns no part: expected a [part] in its file");
        }
        let [drawing, report, vcd] =
            [&self.part, &self.report, &self.vcd].map(|path| path.as_ref().map(OutputFile::create).transpose());
        let made = Made { drawing: drawing?, report: report?, vcd: vcd? };
        // Before anything is announced, so that whoever reads the announcement may end the rig.
        let mut interrupt = Interrupt::listen()?;
        let open = self.ways.open_places(file, self.pace)?;
        let file = &open.file;
        let names = file.names();
        let FaultFile { seed, drawn, faults } =
            self.faults.as_deref().map_or(Ok(FaultFile::default()), |path| fault::load(path, &names, None))?;
        if self.faults.is_some() {
            tracing::info!("seed {}", seed_text(seed, &drawn));
        }
        let others = self.placement.or_processes()?;
        let waited = wait_for_boards(file, &self.awaited, others, self.json, &mut interrupt).await?;
        let Some((driver, _)) = waited else { return Ok(ExitCode::SUCCESS) };
        let Ports { gateways, taps, control } = self.ways.ports(&open)?;
        let socket = self.control.unwrap_or(control);
        let control = Control::open(&socket)?;
        let socket = control.path().unwrap_or(&socket).to_owned();
        let header = file.header(self.rig.as_deref().unwrap_or(DEFAULT), 0, None);
        let recorder = self.record.as_deref().map(|path| start_recording(path, &header)).transpose()?;
        let mut live = Live::start(file, &driver, self.pace, gateways).await?;
        live.tap(taps);
        live.wait_for(open.gateways());
        if let Some(recorder) = recorder {
            live.record(recorder);
        }
        if self.keep > 0 {
            match Spool::begin(&header, u64::from(self.keep) << 20) {
                Ok(spool) => live.spool(spool),
                Err(error) => tracing::warn!(%error, "nothing is kept for 'torno ctl save'"),
            }
        }
        live.plan(&faults);
        live.ask_at_the_end(keepers(&kept_files));
        let mut page = self.page.open(&open.file, Role::Up, control.asker())?;
        let turns = page.is_some() || made.drawing.is_some() || made.report.is_some();
        if let Some(part) = open.file.part.as_ref().filter(|_| turns) {
            live.turn(part);
        }
        if made.report.is_some() || made.vcd.is_some() {
            live.keep(header.clone());
        }
        if made.is_any() {
            live.finish_whole();
        }
        live.steer(control, header, names);
        let url = page.as_ref().map(page::Open::url);
        let files = [&self.part, &self.report, &self.vcd];
        print_beside(&files, &announcement(&open, &live, &socket, url, self.pace, self.json)?)?;
        if let Some(page) = &mut page {
            self.page.browse(page)?;
        }
        tokio::select! {
            ended = live.run() => match ended? {},
            () = interrupt.received() => {}
        }
        tokio::select! {
            left = live.end() => {
                let left = left?;
                if let Some(page) = page {
                    page.end(ENDED).await;
                }
                write_kept(&kept_files, &left.kept)?;
                for unfired in &left.unfired {
                    tracing::warn!("{unfired}");
                }
                made.write(file, &left)?;
                let died = left.incidents.iter().any(|incident| matches!(incident.what, ProcessChange::Died(_)));
                print_beside(&files, &farewell(&left, self.json))?;
                Ok(if died { ExitCode::from(FAILED) } else { ExitCode::SUCCESS })
            }
            // Who cannot wait for a board that does not answer has a trace without an end.
            () = interrupt.received() => Ok(ExitCode::from(INTERRUPTED)),
        }
    }
}

/// What is made of a session when it is over.
struct Made<'a> {
    drawing: Option<OutputFile<'a>>,
    report: Option<OutputFile<'a>>,
    vcd: Option<OutputFile<'a>>,
}

impl Made<'_> {
    /// Whether anything is.
    const fn is_any(&self) -> bool {
        self.drawing.is_some() || self.report.is_some() || self.vcd.is_some()
    }

    /// Writes it. What a program outside has asked for, no one knows.
    fn write(self, rig: &RigFile, left: &Left) -> anyhow::Result<()> {
        let cut = rig.part.clone().zip(left.turned.clone());
        let cut = cut.map(|(part, turned)| Cut::new(part, None, turned, None));
        if let (Some(file), Some(cut)) = (self.drawing, &cut) {
            file.write(cut.draw(&rig.name, SESSION))?;
        }
        let Some(trace) = &left.trace else { return Ok(()) };
        if let Some(file) = self.report {
            let faults = &FaultSummary::of(&left.begun);
            file.write(report(trace, cut.as_ref(), faults))?;
        }
        if let Some(file) = self.vcd {
            file.write_by(|file| write_waveforms(trace, Vec::new(), Timescale::MICROSECOND, file))?;
        }
        Ok(())
    }
}

/// What is told at the end.
fn farewell(left: &Left, json: bool) -> String {
    let incidents: Vec<String> = left.incidents.iter().map(|incident| format!("{}: {incident}", incident.at)).collect();
    let virtual_s = left.end.as_secs_f64();
    if json {
        let unfired: Vec<String> = left.unfired.iter().map(ToString::to_string).collect();
        let told = json!({"outcome": ENDED, "virtual_s": virtual_s, "incidents": incidents, "unfired": unfired});
        return format!("{told}\n");
    }
    let incidents: String = incidents.iter().map(|incident| format!("{incident}\n")).collect();
    format!("{incidents}{:<9}{virtual_s:.3} s virtual\n{:<9}{ENDED}\n", "time", "outcome")
}

fn announcement(
    open: &Open,
    live: &Live,
    control: &Path,
    page: Option<&str>,
    pace: Pace,
    json: bool,
) -> anyhow::Result<String> {
    let file = &open.file;
    let known = live.rig().nodes().iter().zip(&file.layout.boards).filter(|(_, board)| !board.is_gateway());
    let boards =
        known.map(|(node, _)| node).map(|node| (node.name.as_str(), node.pid.unwrap_or_else(std::process::id)));
    let gateways = || file.gateways().zip(live.ports());
    let speed = |line: &str| file.layout.line(line).map_or(0, |line| file.layout.lines[line].baud);
    if json {
        let port = |port, baud| {
            let (path, device) = paths(port);
            Port { port: port.url(), path, device, baud }
        };
        let ready = Ready {
            rig: &file.name,
            pace: match pace {
                // As it was typed: 1, not 1.0.
                Pace::Times(_) => serde_json::from_str(&pace.to_string())?,
                Pace::Max => "max".into(),
            },
            taps: live.taps().map(|(line, at)| (line, port(at, speed(line)))).collect(),
            open: &open.boards,
            ports: gateways().map(|(gateway, at)| (gateway.name.as_str(), port(at, gateway.baud))).collect(),
            control,
            page,
            pid: std::process::id(),
            boards: boards.map(|(name, pid)| (name, Board { pid })).collect(),
        };
        return Ok(serde_json::to_string(&ready)? + "\n");
    }
    let boards: Vec<String> = boards.map(|(name, pid)| format!("{name} {pid}")).collect();
    let mut ports = String::new();
    for (n, (gateway, port)) in gateways().enumerate() {
        let (baud, url) = (gateway.baud, port.url());
        let is_open = open.is_place(&gateway.name);
        let what = if n == 0 { "PC port".to_owned() } else { format!("{} port", gateway.name) };
        ports += &format!("{what:<9} {url}  ({baud} baud, 8N1)\n");
        ports += &format!("attach    {}\n", attach(port, baud));
        if let Some(player) = gateway.dialect.player_at_port().filter(|_| !is_open && port.pty().is_some()) {
            ports += &format!("or        {player} PROGRAM --port {url}\n");
        }
        if is_open {
            ports += &format!("waits     for a program in the place of '{}'; then time begins\n", gateway.name);
        }
    }
    for (line, port) in live.taps() {
        let baud = speed(line);
        ports += &format!("tap       {line} at {}  ({baud} baud, 8N1)\n", port.url());
        ports += &format!("attach    {}\n", attach(port, baud));
    }
    let usual = control == torno_port::default_folder().join(format!("{DEFAULT}-control"));
    let ctl = if usual { "torno ctl".to_owned() } else { format!("torno ctl --socket {}", control.display()) };
    let page = page.map_or_else(String::new, |url| format!("page      {url}\n"));
    Ok(format!(
        "{} is up at pace {pace}: {}\n\
         {ports}\
         {page}\
         look      {ctl} state\n\
         Ctrl-C ends it.\n",
        file.name,
        boards.join(", "),
    ))
}
