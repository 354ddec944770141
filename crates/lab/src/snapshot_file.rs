//! Snapshots as files: an episode stored by one process is gone on from by another.

use std::fs;
use std::path::{Path, PathBuf};

use lanecraft_drive::snapshot::{Snapshot, SnapshotError};

use crate::run_dir::{RunDirError, atomic};

/// Why a snapshot's file cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SnapshotFileError {
    /// The file cannot be read.
    #[error("cannot read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It holds no snapshot that can be gone on from.
    #[error("{}", path.display())]
    Snapshot {
        /// The file.
        path: PathBuf,
        /// Why.
        source: SnapshotError,
    },
}

/// Writes or replaces the file atomically.
///
/// # Errors
/// As [`atomic::write`].
pub fn write(path: &Path, snapshot: &Snapshot) -> Result<(), RunDirError> {
    atomic::write(path, snapshot.as_bytes())
}

/// Reads a file that was written by [`write()`].
///
/// # Errors
/// If it cannot be read, or is foreign, of another version, cut off or changed.
pub fn read(path: &Path) -> Result<Snapshot, SnapshotFileError> {
    let bytes = fs::read(path).map_err(|source| SnapshotFileError::Read { path: path.to_owned(), source })?;
    Snapshot::from_bytes(bytes).map_err(|source| SnapshotFileError::Snapshot { path: path.to_owned(), source })
}
