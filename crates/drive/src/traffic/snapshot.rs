//! The traffic as bytes.

use super::World;
use crate::snapshot::{Header, Snapshot, SnapshotError, SnapshotKind};

impl World {
    /// The world as it stands between two steps, to be stored and gone on from in another process. What a scenario still has to
    /// happen is part of it, recordings in whole.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn snapshot(&self) -> Result<Snapshot, SnapshotError> {
        Snapshot::of(&Header { kind: SnapshotKind::World, config: String::new(), digest: self.digest() }, self)
    }

    /// The world that was stored: it goes on with the same bits.
    ///
    /// # Errors
    /// If the snapshot is not one of a world, or does not give the state that it was taken of.
    pub fn restore(snapshot: &Snapshot) -> Result<Self, SnapshotError> {
        let (header, world) = snapshot.open::<Self>(SnapshotKind::World)?;
        header.check_digest(world.digest())?;
        Ok(world)
    }
}
