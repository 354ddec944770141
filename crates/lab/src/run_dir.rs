//! The folder of a run: what is in it, how it is made, and how it survives a crash or a full disk.
//!
//! A folder appears under its name only when its first files are complete: they are written into a folder beside it, which is then
//! renamed. Later files are replaced atomically ([`atomic`]), logs grow by whole lines and are cut back on resumption ([`log`]).

pub mod atomic;
pub mod log;
pub(crate) mod tensorboard;

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use crate::config::RunConfig;

pub use log::RunLog;

/// The program's commit, or `unknown` if it was built without one at hand.
pub const COMMIT: &str = match option_env!("LANECRAFT_COMMIT") {
    Some(commit) => commit,
    None => "unknown",
};
/// Version of the layout of a run folder.
pub const RUN_SCHEMA: u32 = 1;
/// The file that says what a run is.
pub const MANIFEST: &str = "manifest.json";
/// The file with the complete configuration.
pub const CONFIG: &str = "config.toml";

/// Largest manifest that is read, bytes.
const MANIFEST_LIMIT: u64 = 1 << 20;

/// A run folder or a file in it cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunDirError {
    /// The folder exists and has something in it.
    #[error("{} exists already; choose another folder, or `--force` to replace it", path.display())]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// Something else than a run is in the way; it is never replaced.
    #[error("{} is not a run of this program (it has no readable {MANIFEST}), so it is left alone", path.display())]
    NotARun {
        /// The folder.
        path: PathBuf,
    },
    /// A run of another version of the layout.
    #[error("{} has schema {found}, but this version reads schema {RUN_SCHEMA}", path.display())]
    Schema {
        /// The manifest.
        path: PathBuf,
        /// Its schema.
        found: u32,
    },
    /// A file that cannot be understood.
    #[error("{} is broken: {message}", path.display())]
    Broken {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        message: String,
    },
    /// A log that is shorter than the checkpoint says.
    #[error("{} has {found} bytes, but the checkpoint counts on {expected}", path.display())]
    LogTooShort {
        /// The log.
        path: PathBuf,
        /// Its length.
        found: u64,
        /// The length at the checkpoint.
        expected: u64,
    },
    /// The operating system refused.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// What was tried.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// Why not, for example a full disk.
        source: io::Error,
    },
}

impl RunDirError {
    pub(crate) fn io(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { action, path, source }
    }
}

/// What a run is, in `manifest.json`. No time stamps: the same run gives the same file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// [`RUN_SCHEMA`] of the writer.
    pub schema: u32,
    /// Version of the program.
    pub version: String,
    /// Its commit, or `unknown` if it was built without one at hand.
    pub commit: String,
    /// The command that made the run, for example `train`.
    pub command: String,
    /// The preset under the configuration.
    pub preset: String,
    /// Seed of the run.
    pub seed: u64,
    /// SHA-256 of `config.toml`.
    pub config_sha256: String,
    /// Whether the run came to its end.
    pub finished: bool,
    /// SHA-256 of each file of a finished run, by name.
    pub files: BTreeMap<String, String>,
}

impl Manifest {
    /// The manifest of a run that starts now.
    pub fn new(command: &str, preset: &str, config: &RunConfig) -> Self {
        Self {
            schema: RUN_SCHEMA,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            commit: COMMIT.to_owned(),
            command: command.to_owned(),
            preset: preset.to_owned(),
            seed: config.training.seed,
            config_sha256: sha256_hex(config.to_toml().as_bytes()),
            finished: false,
            files: BTreeMap::new(),
        }
    }

    fn to_json(&self) -> Vec<u8> {
        let mut text = serde_json::to_vec_pretty(self).expect("a manifest has only names and numbers");
        text.push(b'\n');
        text
    }
}

/// What to do with a run that has the name already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// Leave it and refuse.
    Refuse,
    /// Replace it, if it is a run.
    Replace,
}

/// The folder of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunDir {
    path: PathBuf,
}

impl RunDir {
    /// Makes the folder with its manifest and configuration.
    ///
    /// # Errors
    /// If the folder holds something that may not be replaced, or cannot be written; nothing is left behind then.
    pub fn create(
        path: &Path,
        existing: Existing,
        manifest: &Manifest,
        config: &RunConfig,
    ) -> Result<Self, RunDirError> {
        let place = Self::place(path, existing)?;
        // A link stays; what it leads to is filled.
        let target = if place == Place::Free { path.to_owned() } else { real_path(path)? };
        if place == Place::Empty {
            Self::fill(&target, manifest, config)?;
            return Ok(Self { path: path.to_owned() });
        }
        let parent = atomic::folder_of(&target);
        fs::create_dir_all(parent).map_err(RunDirError::io("create", parent))?;
        let staging = atomic::partial_name(&target);
        let result = Self::stage(&staging, manifest, config).and_then(|()| match place {
            Place::Run => replace(&target, &staging),
            _ => fs::rename(&staging, &target).map_err(RunDirError::io("create", &target)),
        });
        if result.is_err() {
            // The first error is the one to report.
            let _ = fs::remove_dir_all(&staging);
        }
        result.and_then(|()| atomic::sync_folder(parent)).map(|()| Self { path: path.to_owned() })
    }

    /// Makes `parent/name`, or `parent/name-2`, `parent/name-3`, … if that exists.
    pub fn create_numbered(
        parent: &Path,
        name: &str,
        manifest: &Manifest,
        config: &RunConfig,
    ) -> Result<Self, RunDirError> {
        let mut number = 1_u32;
        loop {
            let numbered = if number == 1 { name.to_owned() } else { format!("{name}-{number}") };
            let path = parent.join(numbered);
            let free = fs::symlink_metadata(&path).is_err();
            if free {
                match Self::create(&path, Existing::Refuse, manifest, config) {
                    // Another process took the name in between.
                    Err(RunDirError::Exists { .. }) => {}
                    result => return result,
                }
            }
            number += 1;
        }
    }

    /// Opens a run that exists and clears away what an interrupted write left in it.
    pub fn open(path: &Path) -> Result<(Self, Manifest), RunDirError> {
        let run = Self { path: path.to_owned() };
        let manifest = run.manifest()?;
        atomic::clear_partial(path)?;
        Ok((run, manifest))
    }

    /// Whether a run can be made at `path`, to be asked before long work.
    ///
    /// # Errors
    /// As [`Self::create`], of which this is the first step.
    pub fn check(path: &Path, existing: Existing) -> Result<(), RunDirError> {
        Self::place(path, existing).map(drop)
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Reads the manifest.
    pub fn manifest(&self) -> Result<Manifest, RunDirError> {
        let path = self.path.join(MANIFEST);
        match fs::metadata(&path) {
            Ok(metadata) if metadata.len() <= MANIFEST_LIMIT => {}
            Ok(_) => return Err(RunDirError::NotARun { path: self.path.clone() }),
            Err(error) if error.kind() == io::ErrorKind::NotFound && self.path.is_dir() => {
                return Err(RunDirError::NotARun { path: self.path.clone() });
            }
            Err(error) => return Err(RunDirError::io("read", &path)(error)),
        }
        let text = fs::read(&path).map_err(RunDirError::io("read", &path))?;
        let broken = |error: serde_json::Error| RunDirError::Broken { path: path.clone(), message: error.to_string() };
        let value: serde_json::Value = serde_json::from_slice(&text).map_err(broken)?;
        if let Some(found) = value.get("schema").and_then(serde_json::Value::as_u64)
            && found != u64::from(RUN_SCHEMA)
        {
            return Err(RunDirError::Schema { path, found: u32::try_from(found).unwrap_or(u32::MAX) });
        }
        serde_json::from_value(value).map_err(broken)
    }

    /// Writes or replaces a file of the run, atomically.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<(), RunDirError> {
        atomic::write(&self.path.join(name), bytes)
    }

    /// Marks the run as finished and records the content of the named files in the manifest.
    pub fn finish(&self, files: &[&str]) -> Result<(), RunDirError> {
        let mut manifest = self.manifest()?;
        for &name in files {
            let path = self.path.join(name);
            let bytes = fs::read(&path).map_err(RunDirError::io("read", &path))?;
            manifest.files.insert(name.to_owned(), sha256_hex(&bytes));
        }
        manifest.finished = true;
        self.write(MANIFEST, &manifest.to_json())
    }

    /// What is at `path`; an error if it must stay.
    fn place(path: &Path, existing: Existing) -> Result<Place, RunDirError> {
        let entries = match fs::read_dir(path) {
            Ok(entries) => entries,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Place::Free),
            Err(error) => return Err(RunDirError::io("use", path)(error)),
        };
        if entries.count() == 0 {
            return Ok(Place::Empty);
        }
        match existing {
            Existing::Refuse => Err(RunDirError::Exists { path: path.to_owned() }),
            Existing::Replace => match (Self { path: path.to_owned() }).manifest() {
                Ok(_) | Err(RunDirError::Schema { .. }) => Ok(Place::Run),
                Err(_) => Err(RunDirError::NotARun { path: path.to_owned() }),
            },
        }
    }

    fn stage(staging: &Path, manifest: &Manifest, config: &RunConfig) -> Result<(), RunDirError> {
        fs::create_dir(staging).map_err(RunDirError::io("create", staging))?;
        Self::fill(staging, manifest, config)
    }

    /// Writes the first files, the manifest last, because it is what makes the folder a run.
    fn fill(folder: &Path, manifest: &Manifest, config: &RunConfig) -> Result<(), RunDirError> {
        let config_path = folder.join(CONFIG);
        atomic::write(&config_path, config.to_toml().as_bytes())?;
        atomic::write(&folder.join(MANIFEST), &manifest.to_json()).inspect_err(|_| {
            // The first error is the one to report.
            let _ = fs::remove_file(&config_path);
        })
    }
}

/// What is found where a run is to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    /// Nothing.
    Free,
    /// An empty folder, perhaps one that cannot be renamed, such as a mount point.
    Empty,
    /// A run that may be replaced.
    Run,
}

/// Puts the folder `new` in the place of `old`, which is removed only after that.
fn replace(old: &Path, new: &Path) -> Result<(), RunDirError> {
    let aside = new.with_extension("replaced");
    fs::rename(old, &aside).map_err(RunDirError::io("replace", old))?;
    if let Err(error) = fs::rename(new, old) {
        let _ = fs::rename(&aside, old);
        return Err(RunDirError::io("replace", old)(error));
    }
    fs::remove_dir_all(&aside).map_err(RunDirError::io("remove", &aside))
}

fn real_path(path: &Path) -> Result<PathBuf, RunDirError> {
    fs::canonicalize(path).map_err(RunDirError::io("use", path))
}

/// SHA-256 of `bytes` in hexadecimal digits.
pub fn sha256_hex(bytes: &[u8]) -> String {
    use std::fmt::Write as _;
    Sha256::digest(bytes).iter().fold(String::with_capacity(64), |mut text, byte| {
        write!(text, "{byte:02x}").expect("a string takes all");
        text
    })
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::{CONFIG, Existing, MANIFEST, Manifest, RunDir, RunDirError, sha256_hex};
    use crate::config::RunConfig;

    fn create(path: &Path, existing: Existing) -> Result<RunDir, RunDirError> {
        let config = RunConfig::default();
        RunDir::create(path, existing, &Manifest::new("train", "default", &config), &config)
    }

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn sha256_is_that_of_the_standard() {
        // FIPS 180-2, appendix B.1.
        assert_eq!(sha256_hex(b"abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }

    #[test]
    fn a_run_says_what_it_is() {
        let parent = tempfile::tempdir().unwrap();
        let run = create(&parent.path().join("deep/run"), Existing::Refuse).unwrap();
        assert_eq!(names(run.path()), [CONFIG, MANIFEST]);
        run.write("result.csv", b"a,b\n").unwrap();
        run.finish(&["result.csv", CONFIG]).unwrap();
        let (_, manifest) = RunDir::open(run.path()).unwrap();
        assert!(manifest.finished);
        assert_eq!(manifest.files[CONFIG], manifest.config_sha256);
        assert_eq!(manifest.files["result.csv"], sha256_hex(b"a,b\n"));
    }

    #[test]
    fn the_same_run_gives_the_same_bytes() {
        let parent = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "b"].map(|name| create(&parent.path().join(name), Existing::Refuse).unwrap());
        for name in [CONFIG, MANIFEST] {
            assert_eq!(fs::read(a.path().join(name)).unwrap(), fs::read(b.path().join(name)).unwrap());
        }
    }

    #[test]
    fn a_run_is_replaced_only_by_force_and_nothing_else_ever_is() {
        let parent = tempfile::tempdir().unwrap();
        let path = parent.path().join("run");
        let run = create(&path, Existing::Refuse).unwrap();
        run.write("old", b"").unwrap();
        assert!(matches!(create(&path, Existing::Refuse), Err(RunDirError::Exists { .. })));
        assert_eq!(names(&path), [CONFIG, MANIFEST, "old"]);
        create(&path, Existing::Replace).unwrap();
        assert_eq!(names(&path), [CONFIG, MANIFEST]);

        // An empty folder is as good as none.
        let home = parent.path().join("home");
        fs::create_dir(&home).unwrap();
        create(&home, Existing::Refuse).unwrap();
        assert_eq!(names(&home), [CONFIG, MANIFEST]);
        fs::remove_file(home.join(MANIFEST)).unwrap();
        assert!(matches!(create(&home, Existing::Replace), Err(RunDirError::NotARun { .. })));
        fs::write(home.join(MANIFEST), "{}").unwrap();
        assert!(matches!(create(&home, Existing::Replace), Err(RunDirError::NotARun { .. })));
        assert!(matches!(RunDir::open(&home), Err(RunDirError::Broken { .. })));
        fs::write(home.join(MANIFEST), r#"{"schema": 999}"#).unwrap();
        assert!(matches!(RunDir::open(&home), Err(RunDirError::Schema { found: 999, .. })));
        assert_eq!(names(parent.path()), ["home", "run"]);
    }

    #[cfg(unix)]
    #[test]
    fn a_link_to_a_run_stays_a_link() {
        let parent = tempfile::tempdir().unwrap();
        let [run, link] = ["run", "link"].map(|name| parent.path().join(name));
        create(&run, Existing::Refuse).unwrap();
        std::os::unix::fs::symlink(&run, &link).unwrap();
        create(&link, Existing::Replace).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(names(&run), [CONFIG, MANIFEST]);
    }

    #[test]
    fn runs_are_numbered() {
        let parent = tempfile::tempdir().unwrap();
        let config = RunConfig::default();
        let manifest = Manifest::new("quickstart", "default", &config);
        for _ in 0..3 {
            RunDir::create_numbered(parent.path(), "quickstart", &manifest, &config).unwrap();
        }
        assert_eq!(names(parent.path()), ["quickstart", "quickstart-2", "quickstart-3"]);
    }

    #[test]
    fn a_file_in_the_way_is_named() {
        let parent = tempfile::tempdir().unwrap();
        let file = parent.path().join("file");
        fs::write(&file, "mine").unwrap();
        for path in [file.clone(), file.join("run")] {
            let message = create(&path, Existing::Replace).unwrap_err().to_string();
            assert!(message.contains("file"), "{message}");
        }
        assert_eq!(fs::read(&file).unwrap(), b"mine");
        assert_eq!(names(parent.path()), ["file"]);
    }
}
