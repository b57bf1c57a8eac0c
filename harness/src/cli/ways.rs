//! By what programs outside reach a rig that is up.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};
use torno::control::socket_beside;
use torno::port::{LinkPath, PcPort, Transport, made_folder};
use torno::rig::file::{Gateway, RigFile};
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
}

impl Ways {
    /// The transport of each gateway, in the order of the rig file.
    fn transports(&self, file: &RigFile) -> anyhow::Result<Vec<Transport>> {
        let gateways: Vec<&Gateway> = file.gateways().collect();
        let mut transports: Vec<Transport> = gateways.iter().map(|gateway| gateway.transport).collect();
        for text in &self.transport {
            let (name, transport) = text.split_once('=').map_or((None, &**text), |(name, rest)| (Some(name), rest));
            let transport: Transport = transport.parse().map_err(|error| anyhow::anyhow!("--transport: {error}"))?;
            let Some(name) = name else {
                let is_one = transport.address().is_some_and(|address| address.port() != 0);
                let names: Vec<&str> = gateways.iter().map(|gateway| gateway.name.as_str()).collect();
                ensure!(
                    !is_one || gateways.len() == 1,
                    "--transport '{text}': this rig has the gateways {}: expected GATEWAY={transport} for one of them, \
                     or port 0 for all",
                    names.join(", ")
                );
                transports.fill(transport);
                continue;
            };
            let Some(place) = gateways.iter().position(|gateway| gateway.name == name) else {
                let names: Vec<&str> = gateways.iter().map(|gateway| gateway.name.as_str()).collect();
                bail!("--transport '{text}': there is no gateway '{name}'{}", nearest(name, &names));
            };
            transports[place] = transport;
        }
        Ok(transports)
    }

    /// Opens the ports of all gateways. Gives them with the place of the control socket, unless another is chosen.
    pub(super) fn open(&self, file: &RigFile) -> anyhow::Result<(Vec<PcPort>, PathBuf)> {
        let mut ports = Vec::new();
        for (n, (gateway, transport)) in file.gateways().zip(self.transports(file)?).enumerate() {
            let link = match &self.link {
                Some(path) if n == 0 => LinkPath::Chosen(path.clone()),
                _ => LinkPath::Default { rig: file.name.clone(), gateway: gateway.name.clone() },
            };
            ports.push(open(transport, link, gateway)?);
        }
        ensure!(
            self.link.is_none() || ports[0].pty().is_some(),
            "--link is for a PC port that is a pty, and this one is at {}: leave --link out",
            ports[0].url()
        );
        let control = match ports[0].pty() {
            Some(port) => socket_beside(port.link()),
            None => socket_beside(&made_folder()?.join(format!("{}-pc", file.name))),
        };
        Ok((ports, control))
    }
}

fn open(transport: Transport, link: LinkPath, gateway: &Gateway) -> anyhow::Result<PcPort> {
    if let Some(address) = transport.address().filter(|address| !address.ip().is_loopback()) {
        warn_of(address, &gateway.name);
    }
    Ok(PcPort::open(transport, link, gateway.baud)?)
}

fn warn_of(address: SocketAddr, gateway: &str) {
    tracing::warn!(
        "{address} is not of this computer alone: whoever reaches it can use the port of the gateway '{gateway}', as \
         there is no password"
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
