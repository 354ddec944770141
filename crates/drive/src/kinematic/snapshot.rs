//! An episode of the fast environment as bytes.

use std::sync::Arc;

use super::config::KinematicConfig;
use super::environment::KinematicEnv;
use crate::snapshot::{Header, Snapshot, SnapshotError, SnapshotKind};

impl KinematicEnv {
    /// The episode as it stands between two decisions, to be stored and gone on from in another process.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn snapshot(&self) -> Result<Snapshot, SnapshotError> {
        let config = toml::to_string(&*self.config)?;
        Snapshot::of(&Header { kind: SnapshotKind::Kinematic, config, digest: self.digest() }, self)
    }

    /// The episode that was stored: it goes on with the same bits.
    ///
    /// # Errors
    /// If the snapshot is not one of such an episode, or does not give the state that it was taken of.
    pub fn restore(snapshot: &Snapshot) -> Result<Self, SnapshotError> {
        let (header, mut env) = snapshot.open::<Self>(SnapshotKind::Kinematic)?;
        let config: KinematicConfig = toml::from_str(&header.config)?;
        config.validate()?;
        env.config = Arc::new(config);
        header.check_digest(env.digest())?;
        Ok(env)
    }
}
