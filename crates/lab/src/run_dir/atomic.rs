//! Files that are either the old one or the new one, whole, whenever the power goes or the disk is full.
//!
//! The new content goes into a new file in the same folder, which is synced and then renamed over the old one; then the folder is synced.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use super::RunDirError;

/// End of the names of files that are being written.
const PARTIAL: &str = ".partial";

/// The steps of a write, in order; a test makes each of them fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Create,
    Write,
    Sync,
    Rename,
    SyncFolder,
}

/// Writes or replaces the file atomically. A link stays; the file it leads to is replaced.
///
/// # Errors
/// If something else than a file is in the way, or if any step fails, for example on a full disk; the old file, if there was one, is
/// untouched unless only the last step failed.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), RunDirError> {
    write_steps(&target(path)?, bytes, &mut |_| Ok(()))
}

/// The file to replace. A device is never replaced: renaming a file over `/dev/null` would take it away from everybody.
fn target(path: &Path) -> Result<PathBuf, RunDirError> {
    match fs::metadata(path) {
        Ok(metadata) if metadata.is_file() => fs::canonicalize(path).map_err(RunDirError::io("write", path)),
        Ok(_) => {
            let error = io::Error::new(io::ErrorKind::InvalidInput, "it is there already and is no file");
            Err(RunDirError::io("write", path)(error))
        }
        // What else is wrong shows when it is created.
        Err(_) => Ok(path.to_owned()),
    }
}

fn write_steps(path: &Path, bytes: &[u8], before: &mut dyn FnMut(Step) -> io::Result<()>) -> Result<(), RunDirError> {
    let partial = partial_name(path);
    let result = (|| {
        before(Step::Create)?;
        let mut file = create_new(&partial)?;
        before(Step::Write)?;
        file.write_all(bytes)?;
        before(Step::Sync)?;
        file.sync_all()?;
        before(Step::Rename)?;
        fs::rename(&partial, path)
    })();
    if result.is_err() {
        // The first error is the one to report.
        let _ = fs::remove_file(&partial);
    }
    result.map_err(RunDirError::io("write", path))?;
    before(Step::SyncFolder).map_err(RunDirError::io("write", path))?;
    sync_folder(folder_of(path))
}

/// A leftover of this name can only be from a process that is gone, because the name holds the number of the process.
fn create_new(partial: &Path) -> io::Result<File> {
    let create = || OpenOptions::new().write(true).create_new(true).open(partial);
    create().or_else(|error| match error.kind() {
        io::ErrorKind::AlreadyExists => fs::remove_file(partial).and_then(|()| create()),
        _ => Err(error),
    })
}

/// The name beside `path` under which it is prepared.
pub(super) fn partial_name(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.{}{PARTIAL}", std::process::id()))
}

/// The folder that holds `path`.
pub(super) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// Makes the names in `folder` durable, where the system can.
pub(super) fn sync_folder(folder: &Path) -> Result<(), RunDirError> {
    if cfg!(unix) {
        File::open(folder).and_then(|file| file.sync_all()).map_err(RunDirError::io("sync", folder))?;
    }
    Ok(())
}

/// Removes what interrupted writes left in `folder`.
pub(super) fn clear_partial(folder: &Path) -> Result<(), RunDirError> {
    for entry in fs::read_dir(folder).map_err(RunDirError::io("read", folder))? {
        let entry = entry.map_err(RunDirError::io("read", folder))?;
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if name.starts_with('.') && name.ends_with(PARTIAL) && entry.path().is_file() {
            fs::remove_file(entry.path()).map_err(RunDirError::io("remove", &entry.path()))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io;

    use super::{Step, clear_partial, write, write_steps};

    const STEPS: [Step; 5] = [Step::Create, Step::Write, Step::Sync, Step::Rename, Step::SyncFolder];

    #[test]
    fn a_failure_at_any_step_leaves_a_whole_file_and_nothing_else() {
        for failing in STEPS {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("checkpoint");
            write(&path, b"old").unwrap();
            let mut seen = Vec::new();
            let error = write_steps(&path, b"new", &mut |step| {
                seen.push(step);
                if step == failing { Err(io::Error::from(io::ErrorKind::StorageFull)) } else { Ok(()) }
            })
            .unwrap_err()
            .to_string();
            assert!(error.contains("checkpoint") && error.contains("no storage space"), "{error}");
            assert_eq!(seen.last(), Some(&failing));
            let expected: &[u8] = if failing == Step::SyncFolder { b"new" } else { b"old" };
            assert_eq!(fs::read(&path).unwrap(), expected, "{failing:?}");
            assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "{failing:?}");
        }
    }

    #[test]
    fn the_steps_are_in_the_order_that_survives_a_power_cut() {
        let folder = tempfile::tempdir().unwrap();
        let mut seen = Vec::new();
        write_steps(&folder.path().join("file"), b"", &mut |step| {
            seen.push(step);
            Ok(())
        })
        .unwrap();
        assert_eq!(seen, STEPS);
    }

    #[test]
    fn leftovers_are_cleared_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        for name in [".checkpoint.1.partial", "kept.partial", ".kept"] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        clear_partial(folder.path()).unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn what_is_no_file_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("taken");
        fs::create_dir(&path).unwrap();
        let message = write(&path, b"new").unwrap_err().to_string();
        assert!(message.contains("taken") && message.contains("no file"), "{message}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_and_a_device_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let [file, link, device] = ["file", "link", "device"].map(|name| folder.path().join(name));
        write(&file, b"old").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write(&link, b"new").unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&file).unwrap(), b"new");
        std::os::unix::fs::symlink("/dev/null", &device).unwrap();
        assert!(write(&device, b"new").unwrap_err().to_string().contains("no file"));
    }
}
