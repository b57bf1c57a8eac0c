//! Who may ask: a browser lets other sites make requests too.
//!
//! - A site can give its own name the address of this computer (DNS rebinding). Its requests then have that name in
//!   `Host`: only an address or `localhost` is served.
//! - A site can send a form, or load a picture, from here. Such requests have another `Origin`, or `Sec-Fetch-Site`
//!   says so. What changes something must have our own `Origin`.

use std::net::{IpAddr, SocketAddr};

/// What a request says of where it comes from.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sender<'a> {
    /// `Host`.
    pub(crate) host: Option<&'a str>,
    /// `Origin`.
    pub(crate) origin: Option<&'a str>,
    /// `Sec-Fetch-Site`.
    pub(crate) site: Option<&'a str>,
}

impl Sender<'_> {
    /// Refuses what does not come from the page that is served at `address`. What `changes` something must say so.
    ///
    /// # Errors
    /// What was expected.
    pub(crate) fn check(self, address: SocketAddr, changes: bool) -> Result<(), &'static str> {
        let Some(host) = self.host.filter(|host| is_here(host, address)) else {
            return Err("expected the Host of the page's address");
        };
        let ours = |origin: &str| origin.strip_prefix("http://").is_some_and(|from| from.eq_ignore_ascii_case(host));
        match self.origin {
            Some(origin) if ours(origin) => {}
            None if !changes => {}
            _ => return Err("expected the Origin of the page's address"),
        }
        // A person who follows a link or types the address comes from no site.
        match self.site {
            None | Some("same-origin" | "none") => Ok(()),
            // By the redirect file, which is no site's.
            Some("cross-site") if !changes && self.origin.is_none() => Ok(()),
            Some(_) => Err("expected no request of another site"),
        }
    }
}

/// Whether a host is an address of this server: never a name, but `localhost` for loopback.
fn is_here(host: &str, address: SocketAddr) -> bool {
    let Some((name, port)) = host.rsplit_once(':') else { return false };
    if port != address.port().to_string() {
        return false;
    }
    let name = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
    match name.parse::<IpAddr>() {
        Ok(ip) => ip == address.ip() || address.ip().is_unspecified(),
        Err(_) => {
            name.eq_ignore_ascii_case("localhost") && (address.ip().is_loopback() || address.ip().is_unspecified())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(host: &str, origin: Option<&str>, changes: bool) -> Result<(), &'static str> {
        Sender { host: Some(host), origin, site: None }.check("127.0.0.1:4000".parse().unwrap(), changes)
    }

    #[test]
    fn only_an_address_of_ours_is_a_host() {
        for host in ["127.0.0.1:4000", "localhost:4000", "LocalHost:4000"] {
            assert_eq!(check(host, None, false), Ok(()), "{host}");
        }
        for host in ["", "127.0.0.1", "127.0.0.1:4001", "127.0.0.2:4000", "evil.example:4000", "localhost.evil:4000"] {
            assert!(check(host, None, false).unwrap_err().contains("Host"), "{host}");
        }
        let any = "[::]:80".parse().unwrap();
        let from = |host| Sender { host: Some(host), ..Sender::default() }.check(any, false);
        assert_eq!((from("[fe80::1]:80"), from("10.0.0.7:80")), (Ok(()), Ok(())));
        assert!(from("lab:80").is_err());
        assert!(Sender::default().check(any, false).is_err());
    }

    #[test]
    fn what_changes_something_comes_from_our_own_page() {
        let host = "127.0.0.1:4000";
        assert_eq!(check(host, Some("http://127.0.0.1:4000"), true), Ok(()));
        for origin in
            [None, Some("null"), Some("http://localhost:4000"), Some("https://127.0.0.1:4000"), Some("http://e")]
        {
            assert!(check(host, origin, true).unwrap_err().contains("Origin"), "{origin:?}");
        }
        assert!(check(host, Some("http://evil.example"), false).is_err());
    }

    #[test]
    fn another_site_may_lead_here_and_do_nothing_else() {
        let address = "127.0.0.1:4000".parse().unwrap();
        let sender = |site, origin| Sender { host: Some("127.0.0.1:4000"), origin, site: Some(site) };
        let ours = Some("http://127.0.0.1:4000");
        assert_eq!(sender("none", None).check(address, false), Ok(()));
        assert_eq!(sender("same-origin", ours).check(address, true), Ok(()));
        assert_eq!(sender("cross-site", None).check(address, false), Ok(()));
        assert!(sender("cross-site", ours).check(address, true).is_err());
        assert!(sender("same-site", None).check(address, false).is_err());
    }
}
