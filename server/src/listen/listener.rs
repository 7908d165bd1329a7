//! What connections come in by.

use std::io;

use tokio::net::{TcpListener, TcpStream};

#[cfg(unix)]
use super::unix_socket::UnixSocket;
use crate::address::Address;

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
            Address::Tcp(addr) => Ok(Self::Tcp(TcpListener::bind(addr).await?)),
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
