//! By what clients reach a port, as it is written: `pty` or a URL.

use std::fmt;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::str::FromStr;

use serde::Deserialize;

/// By what clients reach a port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub enum Transport {
    /// A pseudo-terminal.
    #[default]
    Pty,
    /// A TCP socket at this address that carries the bytes and nothing else. Port 0: the system chooses one.
    Tcp(SocketAddr),
    /// A TCP socket at this address that carries RFC 2217: the bytes, and control of the serial port.
    Rfc2217(SocketAddr),
}

impl Transport {
    /// The address, if it has one.
    pub const fn address(self) -> Option<SocketAddr> {
        match self {
            Self::Pty => None,
            Self::Tcp(address) | Self::Rfc2217(address) => Some(address),
        }
    }
}

/// Why a text says no transport.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TransportError {
    /// It is neither `pty` nor a URL of a kind that is known.
    #[error("'{0}' is no transport: expected pty, tcp://ADDRESS:PORT or rfc2217://ADDRESS:PORT")]
    Unknown(String),
    /// What stands behind the scheme is no address.
    #[error(
        "'{0}': expected an IP address (or localhost) and a port, as in tcp://127.0.0.1:0; port 0 takes a free one"
    )]
    Address(String),
}

impl FromStr for Transport {
    type Err = TransportError;

    fn from_str(text: &str) -> Result<Self, TransportError> {
        let unknown = || TransportError::Unknown(text.to_owned());
        if text == "pty" {
            return Ok(Self::Pty);
        }
        let (scheme, address) = text.split_once("://").ok_or_else(unknown)?;
        let make = match scheme {
            "tcp" => Self::Tcp,
            "rfc2217" => Self::Rfc2217,
            _ => return Err(unknown()),
        };
        let local = address.strip_prefix("localhost:").and_then(|port| port.parse().ok());
        let local = local.map(|port| SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), port));
        let address = local.map_or_else(|| address.parse(), Ok);
        address.map(make).map_err(|_| TransportError::Address(text.to_owned()))
    }
}

impl TryFrom<String> for Transport {
    type Error = TransportError;

    fn try_from(text: String) -> Result<Self, TransportError> {
        text.parse()
    }
}

impl fmt::Display for Transport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Pty => f.write_str("pty"),
            Self::Tcp(address) => write!(f, "tcp://{address}"),
            Self::Rfc2217(address) => write!(f, "rfc2217://{address}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_transport_is_read_as_it_is_written() {
        for text in ["pty", "tcp://127.0.0.1:0", "tcp://[::1]:4001", "tcp://0.0.0.0:65535", "rfc2217://127.0.0.1:0"] {
            assert_eq!(text.parse::<Transport>().unwrap().to_string(), text);
        }
        assert_eq!("tcp://localhost:23".parse::<Transport>().unwrap().to_string(), "tcp://127.0.0.1:23");
    }

    #[test]
    fn what_is_none_is_named_with_what_was_expected() {
        for (text, expected) in [
            ("", "'' is no transport: expected pty, "),
            ("ptty", "'ptty' is no transport: expected pty, "),
            ("udp://127.0.0.1:0", "'udp://127.0.0.1:0' is no transport: expected pty, "),
            ("tcp://127.0.0.1", "'tcp://127.0.0.1': expected an IP address (or localhost) and a port"),
            ("tcp://host:1", "'tcp://host:1': expected an IP address (or localhost) and a port"),
            ("tcp://localhost:65536", "'tcp://localhost:65536': expected an IP address (or localhost) and a port"),
            ("tcp://127.0.0.1:1/", "'tcp://127.0.0.1:1/': expected an IP address (or localhost) and a port"),
        ] {
            let found = text.parse::<Transport>().unwrap_err().to_string();
            assert!(found.starts_with(expected), "{found}");
        }
    }
}
