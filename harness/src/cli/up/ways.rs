//! By what programs outside reach a rig that is up.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use anyhow::{anyhow, bail, ensure};
use torno::control::socket_beside;
use torno::pace::Pace;
use torno::rig::file::{Gateway, RigFile};
use torno::rig::open::{Opened, open};
use torno_engine::LineId;
use torno_port::{LinkPath, PcPort, Transport, made_folder};
use torno_text::nearest;

/// By what programs outside reach a rig that is up.
#[derive(Debug, clap::Args)]
pub(super) struct Ways {
    /// Where to put the symbolic link to the PC port, if that is a pty [default: $XDG_RUNTIME_DIR/torno/RIG-pc, or
    /// /tmp/torno-UID/RIG-pc]
    #[arg(long, value_name = "PATH")]
    link: Option<PathBuf>,
    /// By what programs reach the rig: pty, tcp://ADDRESS:PORT or rfc2217://ADDRESS:PORT (port 0: a free one); of one
    /// gateway, or of all (may be given several times) [default: what the rig file says, or pty]
    #[arg(long, value_name = "[GATEWAY=]TRANSPORT")]
    transport: Vec<String>,
    /// Leaves a board out, and gives the other end of its link to a program of your own, which takes its place: as a
    /// pty that is linked at PATH, or by a transport (may be given several times) [default: a pty at RIG-BOARD]
    #[arg(long, value_name = "BOARD[=PATH|TRANSPORT]")]
    open: Vec<String>,
    /// Lets a program hear a line, master_to_depth for example: at a pty that is linked at PATH, or by a transport
    /// (may be given several times) [default: a pty at RIG-LINE]
    #[arg(long, value_name = "LINE[=PATH|TRANSPORT]")]
    tap: Vec<String>,
}

/// Where something is to be found, as a command line says it.
enum PortPlace {
    Default,
    Link(PathBuf),
    By(Transport),
}

/// The rig, with the places of boards that are left out.
pub(super) struct Open {
    pub(super) file: RigFile,
    /// The boards that are left out.
    pub(super) boards: Vec<String>,
    /// Where the gateways are in their places.
    places: BTreeMap<String, PortPlace>,
}

/// All ports of a rig.
pub(super) struct Ports {
    /// Those of the gateways.
    pub(super) gateways: Vec<PcPort>,
    pub(super) taps: Vec<(LineId, PcPort)>,
    /// Where the control socket is, unless another place is chosen.
    pub(super) control: PathBuf,
}

impl Open {
    /// The gateways in the places of boards, by their own places in the rig file.
    pub(super) fn gateways(&self) -> Vec<usize> {
        let gateways = self.file.gateways().enumerate();
        gateways.filter(|(_, gateway)| self.is_place(&gateway.name)).map(|(place, _)| place).collect()
    }

    /// Whether the gateway of this name is in the place of a board.
    pub(super) fn is_place(&self, gateway: &str) -> bool {
        self.places.contains_key(gateway)
    }
}

impl Ways {
    /// Leaves out the boards whose places are to be open.
    pub(super) fn open_places(&self, file: RigFile, pace: Pace) -> anyhow::Result<Open> {
        let mut opened = Open { file, boards: Vec::new(), places: BTreeMap::new() };
        for text in &self.open {
            let (board, place) = place(text, "--open")?;
            let without = open(&opened.file, board).map_err(|message| anyhow!("--open '{text}': {message}"))?;
            let Opened { file, gateways, lost_part } = without;
            if gateways.len() > 1 && !matches!(place, PortPlace::Default) {
                bail!("--open '{text}': '{board}' has the links {}: leave the place out", gateways.join(", "));
            }
            let part = if lost_part { ", nor of the part that the rig turns" } else { "" };
            tracing::warn!("'{board}' is left out: nothing will be known of its telemetry{part}");
            opened.file = file;
            opened.boards.push(board.to_owned());
            opened.places.extend(
                gateways.into_iter().zip([place].into_iter().chain(std::iter::repeat_with(|| PortPlace::Default))),
            );
        }
        if pace == Pace::Max && !opened.boards.is_empty() {
            tracing::warn!(
                "at pace max, deadlines pass in virtual time: a program in the place of a board has no time to answer; \
                 --pace 1 gives it as much as a board has"
            );
        }
        Ok(opened)
    }

    /// The transport of each gateway, in the order of the rig file.
    fn transports(&self, file: &RigFile) -> anyhow::Result<Vec<Transport>> {
        let gateways: Vec<&Gateway> = file.gateways().collect();
        let names = || gateways.iter().map(|gateway| gateway.name.as_str()).collect::<Vec<&str>>();
        let mut transports: Vec<Transport> = gateways.iter().map(|gateway| gateway.transport).collect();
        for text in &self.transport {
            let (name, transport) = text.split_once('=').map_or((None, &**text), |(name, rest)| (Some(name), rest));
            let transport: Transport = transport.parse().map_err(|error| anyhow!("--transport: {error}"))?;
            let Some(name) = name else {
                let is_one = transport.address().is_some_and(|address| address.port() != 0);
                ensure!(
                    !is_one || gateways.len() == 1,
                    "--transport '{text}': this rig has the gateways {}: expected GATEWAY={transport} for one of them, \
                     or port 0 for all",
                    names().join(", ")
                );
                transports.fill(transport);
                continue;
            };
            let Some(place) = gateways.iter().position(|gateway| gateway.name == name) else {
                bail!("--transport '{text}': there is no gateway '{name}'{}", nearest(name, &names()));
            };
            transports[place] = transport;
        }
        Ok(transports)
    }

    /// Opens all ports.
    pub(super) fn ports(&self, open: &Open) -> anyhow::Result<Ports> {
        let file = &open.file;
        let mut gateways = Vec::new();
        for (n, (gateway, transport)) in file.gateways().zip(self.transports(file)?).enumerate() {
            let name = &gateway.name;
            let (transport, link) = match open.places.get(name) {
                Some(PortPlace::Link(path)) => (Transport::Pty, Some(path)),
                Some(PortPlace::By(transport)) => (*transport, None),
                _ => (transport, self.link.as_ref().filter(|_| n == 0)),
            };
            gateways.push(port(file, name, transport, link.cloned(), gateway.baud)?);
        }
        ensure!(
            self.link.is_none() || gateways[0].pty().is_some(),
            "--link is for a PC port that is a pty, and this one is at {}: leave --link out",
            gateways[0].url()
        );
        let control = match gateways[0].pty() {
            Some(port) => socket_beside(port.link()),
            None => socket_beside(&made_folder()?.join(format!("{}-pc", file.name))),
        };
        let taps = self.tap.iter().map(|text| tap(file, text)).collect::<anyhow::Result<_>>()?;
        Ok(Ports { gateways, taps, control })
    }
}

fn tap(file: &RigFile, text: &str) -> anyhow::Result<(LineId, PcPort)> {
    let (name, place) = place(text, "--tap")?;
    let lines = &file.layout.lines;
    let Some(line) = file.layout.line(name) else {
        let known: Vec<&str> = lines.iter().map(|line| line.name.as_str()).collect();
        bail!("--tap '{text}': there is no line '{name}'{}", nearest(name, &known));
    };
    let (transport, link) = match place {
        PortPlace::Default => (Transport::Pty, None),
        PortPlace::Link(path) => (Transport::Pty, Some(path)),
        PortPlace::By(transport) => (transport, None),
    };
    Ok((line, port(file, name, transport, link, lines[line].baud)?))
}

/// A name, and behind a `=` where it is to be found.
fn place<'a>(text: &'a str, option: &str) -> anyhow::Result<(&'a str, PortPlace)> {
    let Some((name, place)) = text.split_once('=') else { return Ok((text, PortPlace::Default)) };
    let place = if place == "pty" {
        PortPlace::Default
    } else if place.contains("://") {
        PortPlace::By(place.parse().map_err(|error| anyhow!("{option}: {error}"))?)
    } else {
        PortPlace::Link(PathBuf::from(place))
    };
    Ok((name, place))
}

fn port(file: &RigFile, name: &str, transport: Transport, link: Option<PathBuf>, baud: u32) -> anyhow::Result<PcPort> {
    if let Some(address) = transport.address().filter(|address| !address.ip().is_loopback()) {
        warn_of(address, name);
    }
    let usual = || LinkPath::Default { rig: file.name.clone(), gateway: name.to_owned() };
    Ok(PcPort::open(transport, link.map_or_else(usual, LinkPath::Chosen), baud)?)
}

fn warn_of(address: SocketAddr, name: &str) {
    tracing::warn!(
        "{address} is not of this computer alone: whoever reaches it can use the port '{name}', as there is no password"
    );
}

/// How a program is attached to this port at `baud`, for people.
pub(super) fn attach(port: &PcPort, baud: u32) -> String {
    match port {
        PcPort::Pty(port) => format!("picocom -b {baud} {}", port.link().display()),
        PcPort::Tcp(port) if port.controls() => format!("python3 -m serial.tools.miniterm {} {baud}", port.url()),
        PcPort::Tcp(port) => format!("nc {} {}", port.address().ip(), port.address().port()),
    }
}

/// The link and the device, if it is a pty.
pub(super) fn paths(port: &PcPort) -> (Option<&Path>, Option<&Path>) {
    port.pty().map_or((None, None), |port| (Some(port.link()), Some(port.path())))
}
