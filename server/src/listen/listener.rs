//! What connections come in by.

use std::io;
use std::net::SocketAddr;

use tokio::net::{TcpListener, TcpSocket, TcpStream};

#[cfg(unix)]
use super::unix_socket::UnixSocket;
use crate::address::Address;

/// Connections that may wait until they are accepted, if the system lets so many (Linux: `net.core.somaxconn`, 4096). With the 128 that
/// sockets have unless told otherwise, some of 1,000 clients that come at once are reset.
pub(super) const BACKLOG: u32 = 4096;

/// A TCP port or a Unix-domain socket.
#[derive(Debug)]
pub(crate) enum Listener {
    Tcp(TcpListener),
    #[cfg(unix)]
    Unix(UnixSocket),
}

/// A connection of either.
#[cfg(unix)]
pub(super) type Stream = tokio_util::either::Either<TcpStream, tokio::net::UnixStream>;
#[cfg(not(unix))]
pub(super) type Stream = TcpStream;

impl Listener {
    /// Begins to listen; a socket's file gets the mode.
    pub(crate) async fn bind(address: &Address, socket_mode: u32) -> io::Result<Self> {
        match address {
            Address::Tcp(addr) => Ok(Self::Tcp(bind(*addr)?)),
            #[cfg(unix)]
            Address::Unix(path) => Ok(Self::Unix(UnixSocket::bind(path, socket_mode).await?)),
            #[cfg(not(unix))]
            Address::Unix(_) => Err(io::ErrorKind::Unsupported.into()),
        }
    }

    /// Where it listens in fact.
    pub(crate) fn address(&self) -> io::Result<Address> {
        match self {
            Self::Tcp(listener) => listener.local_addr().map(Address::Tcp),
            #[cfg(unix)]
            Self::Unix(socket) => Ok(Address::Unix(socket.path().into())),
        }
    }

    pub(super) async fn accept(&self) -> io::Result<Stream> {
        match self {
            Self::Tcp(listener) => {
                let (stream, _) = listener.accept().await?;
                // Answers go out whole; without this the last packet may wait for an acknowledgement.
                let _ = stream.set_nodelay(true);
                #[cfg(unix)]
                let stream = Stream::Left(stream);
                Ok(stream)
            }
            #[cfg(unix)]
            Self::Unix(socket) => socket.accept().await.map(Stream::Right),
        }
    }
}

fn bind(addr: SocketAddr) -> io::Result<TcpListener> {
    let socket = if addr.is_ipv4() { TcpSocket::new_v4() } else { TcpSocket::new_v6() }?;
    // A service that is started anew need not wait until the connections of the one before are forgotten.
    #[cfg(unix)]
    socket.set_reuseaddr(true)?;
    socket.bind(addr)?;
    socket.listen(BACKLOG)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[tokio::test]
    async fn clients_that_come_at_once_wait_until_they_are_accepted() -> Result<(), Box<dyn std::error::Error>> {
        // As many as the system lets wait, or 500.
        let let_wait = std::fs::read_to_string("/proc/sys/net/core/somaxconn").ok().and_then(|n| n.trim().parse().ok());
        let clients = let_wait.unwrap_or(128).min(500);
        rlimit::increase_nofile_limit(2048)?;
        let listener = Listener::bind(&Address::Tcp((std::net::Ipv4Addr::LOCALHOST, 0).into()), 0o600).await?;
        let addr = listener.address()?.tcp().ok_or("no TCP address")?;
        // Nobody accepts: beyond the backlog, a client would wait for an answer in vain.
        let waiting: Vec<std::net::TcpStream> = (0..clients)
            .map(|_| std::net::TcpStream::connect_timeout(&addr, Duration::from_secs(20)))
            .collect::<Result<_, _>>()?;
        assert_eq!(waiting.len(), clients);
        Ok(())
    }
}
