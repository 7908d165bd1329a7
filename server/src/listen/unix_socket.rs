//! A Unix-domain socket: its file appears with its mode, and goes when the service stops listening.

use std::ffi::OsString;
use std::fs::{self, DirBuilder, Metadata, Permissions};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{DirBuilderExt, FileTypeExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use tokio::net::{UnixListener, UnixStream};

use super::listener::BACKLOG;

/// A socket and its file.
#[derive(Debug)]
pub(crate) struct UnixSocket {
    listener: UnixListener,
    file: SocketFile,
}

/// The file; removed when dropped, unless another has taken its place.
#[derive(Debug)]
struct SocketFile {
    path: PathBuf,
    id: (u64, u64),
}

/// A folder beside the socket's place that only this user gets into, so that nobody connects before the mode is set; and as there is one
/// alone, no two servers take the place of the same dead one. Removed when dropped.
struct Room(PathBuf);

impl UnixSocket {
    /// Listens at a path, in place of a server that ended without removing its file, but not of one that listens, or of another file.
    pub(super) async fn bind(path: &Path, mode: u32) -> io::Result<Self> {
        let room = Room::beside(path)?;
        require_nobody(path).await?;
        let inside = room.socket();
        let socket = tokio::net::UnixSocket::new_stream()?;
        socket.bind(&inside)?;
        let listener = socket.listen(BACKLOG)?;
        fs::set_permissions(&inside, Permissions::from_mode(mode))?;
        let file = SocketFile { path: path.into(), id: id(&fs::symlink_metadata(&inside)?) };
        fs::rename(&inside, path)?;
        Ok(Self { listener, file })
    }

    pub(super) fn path(&self) -> &Path {
        &self.file.path
    }

    pub(super) async fn accept(&self) -> io::Result<UnixStream> {
        self.listener.accept().await.map(|(stream, _)| stream)
    }
}

/// Fails if somebody listens at the path, or if something else than a socket is there.
async fn require_nobody(path: &Path) -> io::Result<()> {
    match fs::symlink_metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(error),
        Ok(found) if !found.file_type().is_socket() => {
            return Err(io::Error::new(ErrorKind::AlreadyExists, "there is a file that is no socket"));
        }
        Ok(_) => {}
    }
    match UnixStream::connect(path).await {
        Err(error) if error.kind() == ErrorKind::ConnectionRefused => Ok(()),
        // Whoever is too busy to let this in is alive as well.
        Ok(_) => Err(io::Error::new(ErrorKind::AddrInUse, "another server listens there")),
        Err(error) => Err(io::Error::new(error.kind(), format!("there is a socket that may be another's: {error}"))),
    }
}

fn id(file: &Metadata) -> (u64, u64) {
    (file.dev(), file.ino())
}

impl Room {
    fn beside(path: &Path) -> io::Result<Self> {
        let mut room = OsString::from(path);
        room.push(".new");
        let room = PathBuf::from(room);
        DirBuilder::new().mode(0o700).create(&room).map_err(|error| {
            let why = if error.kind() == ErrorKind::AlreadyExists {
                "is there already: another server is starting, or was ended while it did; then remove it".into()
            } else {
                error.to_string()
            };
            io::Error::new(error.kind(), format!("folder {} {why}", room.display()))
        })?;
        Ok(Self(room))
    }

    fn socket(&self) -> PathBuf {
        self.0.join("s")
    }
}

impl Drop for Room {
    fn drop(&mut self) {
        // Of a socket that was renamed nothing is left here.
        let _ = fs::remove_file(self.socket());
        let _ = fs::remove_dir(&self.0);
    }
}

impl Drop for SocketFile {
    fn drop(&mut self) {
        if fs::symlink_metadata(&self.path).is_ok_and(|found| id(&found) == self.id) {
            let _ = fs::remove_file(&self.path);
        }
    }
}
