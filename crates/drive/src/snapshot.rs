//! A running world or episode as bytes, which another process goes on from with the same bits.
//!
//! The bytes are a magic word, the format's version, the body's length, the body and a checksum (FNV-1a, 64 bits), numbers
//! little-endian. The body is MessagePack: a header with the configuration as TOML and the digest of the state, then the state. It
//! is self-describing, so that the tagged enums of configurations pass through it unchanged. Nothing is kept that follows from the
//! configuration at a cost of a millisecond, such as the controllers' tables of models.
//!
//! The checksum finds every accident, a single changed byte for certain; it is no protection against forged files.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::config::ConfigError;

/// Version of the format. It is raised whenever anything that is stored changes.
pub const SNAPSHOT_SCHEMA: u32 = 5;

const MAGIC: [u8; 8] = *b"LANESNAP";
/// Magic word, version and length of the body.
const HEAD_BYTES: usize = 20;
const CHECKSUM_BYTES: usize = 8;

/// Why a snapshot cannot be taken or gone on from.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SnapshotError {
    /// The bytes are something else.
    #[error("this is no snapshot: it does not begin with the letters LANESNAP")]
    Foreign,
    /// The bytes were written by another version of the format.
    #[error("the snapshot has version {found} of the format, but only version {SNAPSHOT_SCHEMA} can be read")]
    Version {
        /// Its version.
        found: u32,
    },
    /// Bytes are missing at the end, or there are too many.
    #[error("the snapshot has {found} bytes in place of {expected}; it was not copied whole")]
    Length {
        /// How many there should be.
        expected: u64,
        /// How many there are.
        found: u64,
    },
    /// Bytes have changed.
    #[error("the snapshot's checksum is wrong; its bytes have changed since it was written")]
    Checksum,
    /// It is a snapshot of the other kind.
    #[error("this is a snapshot of {found:?}, not of {expected:?}")]
    Kind {
        /// What was asked for.
        expected: SnapshotKind,
        /// What it is.
        found: SnapshotKind,
    },
    /// The state cannot be stored.
    #[error("the state cannot be stored")]
    Encode(#[from] rmp_serde::encode::Error),
    /// The body does not hold a state of this version.
    #[error("the snapshot holds no state that this version knows")]
    Decode(#[from] rmp_serde::decode::Error),
    /// The configuration cannot be stored.
    #[error("the configuration cannot be stored")]
    WriteConfig(#[from] toml::ser::Error),
    /// The stored configuration cannot be read.
    #[error("the snapshot's configuration cannot be read")]
    ReadConfig(#[from] toml::de::Error),
    /// The stored configuration is not valid.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The restored state is not the one that was stored.
    #[error("the restored state has digest {restored:016x} in place of {stored:016x}")]
    Digest {
        /// Of the state that was stored.
        stored: u64,
        /// Of the state that came of it.
        restored: u64,
    },
    /// The car is a user's own model, whose state only the user knows.
    #[error("an episode with an external plant cannot be stored; clone the environment instead")]
    ExternalPlant,
}

/// What a snapshot is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SnapshotKind {
    /// A whole episode, with the ego car and its driver.
    Episode,
    /// The traffic alone.
    World,
    /// An episode of the fast environment.
    Kinematic,
}

/// What stands before the state.
#[derive(Serialize, Deserialize)]
pub(crate) struct Header {
    pub(crate) kind: SnapshotKind,
    /// TOML; empty for a world, which holds its road and traffic itself.
    pub(crate) config: String,
    pub(crate) digest: u64,
}

impl Header {
    /// Whether `restored` is the digest of the state that was stored.
    pub(crate) fn check_digest(&self, restored: u64) -> Result<(), SnapshotError> {
        if restored == self.digest { Ok(()) } else { Err(SnapshotError::Digest { stored: self.digest, restored }) }
    }
}

/// A stored state: bytes whose frame and checksum are right.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Snapshot {
    bytes: Vec<u8>,
}

impl Snapshot {
    /// Takes bytes that were written by [`Self::as_bytes`].
    ///
    /// # Errors
    /// If they are foreign, of another version, cut off or changed.
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Self, SnapshotError> {
        if !bytes.starts_with(&MAGIC[..MAGIC.len().min(bytes.len())]) {
            return Err(SnapshotError::Foreign);
        }
        let cut = SnapshotError::Length { expected: HEAD_BYTES as u64, found: bytes.len() as u64 };
        let Some((head, _)) = bytes.split_first_chunk::<HEAD_BYTES>() else { return Err(cut) };
        let [_, _, _, _, _, _, _, _, version @ .., l0, l1, l2, l3, l4, l5, l6, l7] = *head;
        let found = u32::from_le_bytes(version);
        if found != SNAPSHOT_SCHEMA {
            return Err(SnapshotError::Version { found });
        }
        let body = u64::from_le_bytes([l0, l1, l2, l3, l4, l5, l6, l7]);
        let expected = body.saturating_add((HEAD_BYTES + CHECKSUM_BYTES) as u64);
        if expected != bytes.len() as u64 {
            return Err(SnapshotError::Length { expected, found: bytes.len() as u64 });
        }
        let sealed = bytes.split_last_chunk().is_some_and(|(rest, sum)| checksum(rest) == u64::from_le_bytes(*sum));
        if sealed { Ok(Self { bytes }) } else { Err(SnapshotError::Checksum) }
    }

    /// The bytes to store.
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes
    }

    pub(crate) fn of(header: &Header, state: &impl Serialize) -> Result<Self, SnapshotError> {
        let mut bytes = [&MAGIC[..], &SNAPSHOT_SCHEMA.to_le_bytes(), &[0; 8]].concat();
        rmp_serde::encode::write(&mut bytes, header)?;
        rmp_serde::encode::write(&mut bytes, state)?;
        let body = (bytes.len() - HEAD_BYTES) as u64;
        bytes[HEAD_BYTES - 8..HEAD_BYTES].copy_from_slice(&body.to_le_bytes());
        bytes.extend(checksum(&bytes).to_le_bytes());
        Ok(Self { bytes })
    }

    pub(crate) fn open<T: DeserializeOwned>(&self, expected: SnapshotKind) -> Result<(Header, T), SnapshotError> {
        let mut body = rmp_serde::Deserializer::from_read_ref(&self.bytes[HEAD_BYTES..]);
        let header = Header::deserialize(&mut body)?;
        if header.kind != expected {
            return Err(SnapshotError::Kind { expected, found: header.kind });
        }
        Ok((header, T::deserialize(&mut body)?))
    }
}

/// FNV-1a: each step is one-to-one in the hash so far, so that one changed byte always shows.
fn checksum(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xCBF2_9CE4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3))
}
