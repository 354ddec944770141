//! The scenarios that come with the program, by name.

use std::path::{Path, PathBuf};

use include_dir::{Dir, File, include_dir};

use super::{LoadedScenario, ScenarioFileError};

static FILES: Dir = include_dir!("$CARGO_MANIFEST_DIR/../../scenarios");

/// Their names, sorted: `merge`, `splits/train`.
pub fn names() -> Vec<String> {
    let folders = FILES.dirs().flat_map(Dir::files);
    let files = FILES.files().chain(folders).map(File::path);
    let toml = files.filter(|path| path.extension().is_some_and(|extension| extension == "toml"));
    let mut names: Vec<String> = toml.map(|path| path.with_extension("").display().to_string()).collect();
    names.sort();
    names
}

/// The scenario of this name, or else of the file with this path.
///
/// # Errors
/// If there is neither, or the file is wrong.
pub fn named(name_or_path: &str) -> Result<LoadedScenario, ScenarioFileError> {
    let path = Path::new(name_or_path);
    let built_in = FILES.get_file(path.with_extension("toml")).filter(|_| path.extension().is_none());
    match built_in.and_then(|file| file.contents_utf8()) {
        Some(text) => LoadedScenario::checked(&PathBuf::from(name_or_path), text.to_owned()),
        None if path.exists() || path.extension().is_some() => LoadedScenario::read(path),
        None => Err(ScenarioFileError::NoSuchName { name: name_or_path.to_owned(), names: names() }),
    }
}
