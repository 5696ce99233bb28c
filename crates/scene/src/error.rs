//! The error type. Each kind has an exit code, after sysexits.h, on which scripts rely.

/// An error with a message for the user: what is wrong, where (file, JSON path, byte), and what to do.
#[derive(Debug, Clone, thiserror::Error)]
pub enum Error {
    /// Wrong flags or values on the command line. Exit code 64.
    #[error("{0}")]
    Usage(String),
    /// A scene, a picture or a part that cannot be used. Exit code 65.
    #[error("{0}")]
    Data(String),
    /// An input that does not exist. Exit code 66.
    #[error("{0}")]
    Missing(String),
    /// A bug in this program. Exit code 70.
    #[error("internal error: {0}; please report it")]
    Bug(String),
    /// An output that cannot be created. Exit code 73.
    #[error("{0}")]
    CannotCreate(String),
    /// A failed read or write. Exit code 74.
    #[error("{0}")]
    Io(String),
    /// Stopped by a signal; the work so far was saved. Exit code 75.
    #[error("{0}")]
    Interrupted(String),
    /// Not possible on this host: instruction set, memory, Embree version. Exit code 76.
    #[error("{0}")]
    Host(String),
    /// Permission denied. Exit code 77.
    #[error("{0}")]
    Permission(String),
    /// An invalid configuration file. Exit code 78.
    #[error("{0}")]
    Config(String),
}

impl Error {
    /// The exit code of the process for this error.
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Usage(_) => 64,
            Error::Data(_) => 65,
            Error::Missing(_) => 66,
            Error::Bug(_) => 70,
            Error::CannotCreate(_) => 73,
            Error::Io(_) => 74,
            Error::Interrupted(_) => 75,
            Error::Host(_) => 76,
            Error::Permission(_) => 77,
            Error::Config(_) => 78,
        }
    }

    /// The error of an input that could not be read: [`Missing`](Self::Missing), [`Permission`](Self::Permission),
    /// [`Host`](Self::Host) (no memory) or [`Io`](Self::Io), by the kind of the system's error.
    pub fn reading(path: &std::path::Path, error: &std::io::Error) -> Self {
        let text = format!("{}: cannot read: {error}", path.display());
        match error.kind() {
            std::io::ErrorKind::NotFound => Error::Missing(text),
            std::io::ErrorKind::PermissionDenied => Error::Permission(text),
            std::io::ErrorKind::OutOfMemory => Error::Host(format!("{text}: not enough memory")),
            _ => Error::Io(text),
        }
    }
}

/// A result with [`enum@Error`].
pub type Result<T> = std::result::Result<T, Error>;
