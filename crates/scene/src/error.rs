//! The one error type; each kind has the exit code that scripts rely on.

/// What went wrong, for a person: what, where (file, JSON path, byte) and what to do.
#[derive(Debug, Clone, thiserror::Error)]
pub enum Error {
    /// Wrong flags or values on the command line. Exit code 64.
    #[error("{0}")]
    Usage(String),
    /// A scene, picture or part that cannot be used. Exit code 65.
    #[error("{0}")]
    Data(String),
    /// A named input that is not there. Exit code 66.
    #[error("{0}")]
    Missing(String),
    /// A bug of ours. Exit code 70.
    #[error("internal error: {0}; please report it")]
    Bug(String),
    /// An output that cannot be created. Exit code 73.
    #[error("{0}")]
    CannotCreate(String),
    /// A read or write that failed half-way. Exit code 74.
    #[error("{0}")]
    Io(String),
    /// Stopped by a signal with what there was saved. Exit code 75.
    #[error("{0}")]
    Interrupted(String),
    /// This host cannot do it: ISA, memory, Embree version. Exit code 76.
    #[error("{0}")]
    Host(String),
    /// Permission denied. Exit code 77.
    #[error("{0}")]
    Permission(String),
    /// A bad configuration file. Exit code 78.
    #[error("{0}")]
    Config(String),
}

impl Error {
    /// The process exit code of this error, after sysexits.h.
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

    /// An input that could not be read, by the reason that the system gives: missing, forbidden or failed.
    pub fn reading(path: &std::path::Path, error: &std::io::Error) -> Self {
        let text = format!("{}: cannot read: {error}", path.display());
        match error.kind() {
            std::io::ErrorKind::NotFound => Error::Missing(text),
            std::io::ErrorKind::PermissionDenied => Error::Permission(text),
            _ => Error::Io(text),
        }
    }
}

/// Shorthand for results with [`enum@Error`].
pub type Result<T> = std::result::Result<T, Error>;
