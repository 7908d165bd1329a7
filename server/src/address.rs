//! Where a service listens.

use std::fmt;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::str::FromStr;

use thiserror::Error;

/// What the address of a Unix-domain socket begins with.
const UNIX: &str = "unix:";

/// Where a service listens: as text `127.0.0.1:8080`, `[::1]:8080` or `unix:/path/to.sock`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// An IP address and a port; port 0 takes a free one.
    Tcp(SocketAddr),
    /// The file of a Unix-domain socket.
    Unix(PathBuf),
}

/// A text that is no address.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("expected an IP address and a port, or `{UNIX}` and the path of a socket")]
pub struct AddressError;

impl Address {
    /// The IP address and port, where it is one.
    pub const fn tcp(&self) -> Option<SocketAddr> {
        match self {
            Self::Tcp(addr) => Some(*addr),
            Self::Unix(_) => None,
        }
    }
}

impl From<SocketAddr> for Address {
    fn from(addr: SocketAddr) -> Self {
        Self::Tcp(addr)
    }
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        match text.strip_prefix(UNIX) {
            Some("") => Err(AddressError),
            Some(path) => Ok(Self::Unix(path.into())),
            None => text.parse().map(Self::Tcp).map_err(|_| AddressError),
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tcp(addr) => addr.fmt(f),
            Self::Unix(path) => write!(f, "{UNIX}{}", path.display()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_read_as_it_is_written() -> Result<(), AddressError> {
        for text in ["127.0.0.1:8080", "[::1]:0", "unix:/run/realbeam/scan.sock"] {
            assert_eq!(text.parse::<Address>()?.to_string(), text);
        }
        for text in ["", "8080", "localhost:8080", "unix:", "/run/realbeam/scan.sock"] {
            assert_eq!(text.parse::<Address>(), Err(AddressError), "{text}");
        }
        Ok(())
    }
}
