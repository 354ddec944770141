//! Which part may use which: the order of the crates and, in `drive`, of the modules of the method.
//!
//! The ego stack (`predict` to `driver`) is given a scene; if it could name `traffic`, `perceive` or `scenario`, it could look at the truth.

#![allow(clippy::unwrap_used, reason = "a test")]

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Each module of `drive` with the modules it may name; any module may name itself.
const MODULES: &[(&str, &[&str])] = &[
    ("config", &[]),
    ("snapshot", &["config"]),
    ("road", &["config"]),
    ("vehicle", &["config", "road"]),
    ("models", &["config", "road", "vehicle"]),
    ("scene", &["config", "road", "vehicle", "models"]),
    // The world and what is seen of it.
    ("scenario", &["config", "road", "vehicle", "models", "scene"]),
    ("traffic", &["config", "snapshot", "road", "vehicle", "models", "scene", "scenario"]),
    ("perceive", &["config", "road", "vehicle", "models", "scene", "scenario", "traffic"]),
    // The ego car's mind.
    ("predict", &["config", "road", "vehicle", "models", "scene"]),
    ("plan", &["config", "road", "vehicle", "models", "scene", "predict"]),
    ("control", &["config", "road", "vehicle", "models", "scene", "predict", "plan"]),
    ("decide", &["config", "road", "vehicle", "models", "scene", "predict", "plan", "control"]),
    ("driver", &["config", "road", "vehicle", "models", "scene", "predict", "plan", "control", "decide"]),
    // Both, in a closed loop.
    ("env", ALL_BUT_ENV),
    // The world and a simple ego car, without the mind.
    ("kinematic", &["config", "snapshot", "road", "vehicle", "scene", "scenario", "traffic", "decide"]),
];
const ALL_BUT_ENV: &[&str] = &[
    "config", "snapshot", "road", "vehicle", "models", "scene", "scenario", "traffic", "perceive", "predict", "plan",
    "control", "decide", "driver",
];

/// Each crate with the crates of the workspace it may use.
const CRATES: &[(&str, &[&str])] = &[
    ("qp", &[]),
    ("net", &[]),
    ("learn", &["lanecraft-net"]),
    ("drive", &["lanecraft-qp", "lanecraft-net"]),
    // The random streams are in `net`.
    ("lab", &["lanecraft-drive", "lanecraft-learn", "lanecraft-net"]),
    ("cli", &["lanecraft-lab"]),
];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}

#[test]
fn modules_of_drive_name_only_those_below_them() {
    let source = root().join("crates/drive/src");
    let declared = top_modules(&source);
    let listed: BTreeSet<String> = MODULES.iter().map(|(name, _)| (*name).to_owned()).collect();
    assert_eq!(declared, listed, "the modules of crates/drive and the table of this test differ");
    for (module, allowed) in MODULES {
        for file in rust_files(&source, module) {
            for (line, used) in crate_paths(&fs::read_to_string(&file).unwrap()) {
                let known = listed.contains(&used);
                let may = used == *module || allowed.contains(&used.as_str());
                assert!(!known || may, "{}:{line}: `{module}` must not use `{used}`", file.display());
                assert!(known, "{}:{line}: `crate::{used}` is no module; name the module it is in", file.display());
            }
        }
    }
}

/// The Python package binds the lab, and the parts that can be used alone.
const PYTHON: &[&str] = &["lanecraft-lab", "lanecraft-drive", "lanecraft-learn", "lanecraft-qp"];

#[test]
fn the_python_package_uses_what_it_binds() {
    let manifest = root().join("python/Cargo.toml");
    for used in workspace_crates(&fs::read_to_string(&manifest).unwrap()) {
        assert!(PYTHON.contains(&used.as_str()), "{}: must not depend on `{used}`", manifest.display());
    }
}

#[test]
fn crates_use_only_those_below_them() {
    let folders: BTreeSet<String> = fs::read_dir(root().join("crates"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    let listed: BTreeSet<String> = CRATES.iter().map(|(name, _)| (*name).to_owned()).collect();
    assert_eq!(folders, listed, "the folders in crates/ and the table of this test differ");
    for (folder, allowed) in CRATES {
        let manifest = root().join("crates").join(folder).join("Cargo.toml");
        for used in workspace_crates(&fs::read_to_string(&manifest).unwrap()) {
            assert!(allowed.contains(&used.as_str()), "{}: must not depend on `{used}`", manifest.display());
        }
    }
}

/// The modules that `lib.rs` declares.
fn top_modules(source: &Path) -> BTreeSet<String> {
    let text = fs::read_to_string(source.join("lib.rs")).unwrap();
    text.lines()
        .filter_map(|line| line.trim_start_matches("pub ").strip_prefix("mod ")?.strip_suffix(';'))
        .map(str::to_owned)
        .collect()
}

/// The file or the folder of a module, with all files below it.
fn rust_files(source: &Path, module: &str) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let file = source.join(module).with_extension("rs");
    if file.exists() {
        files.push(file);
    }
    let mut folders = vec![source.join(module)];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).into_iter().flatten() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                files.push(path);
            }
        }
    }
    assert!(!files.is_empty(), "no file of module `{module}`");
    files
}

/// Line and first name of each path that starts with `crate::`, outside comments; `crate::{a, b::c}` gives `a` and `b`.
fn crate_paths(text: &str) -> Vec<(usize, String)> {
    let code: Vec<&str> = text.lines().map(|line| line.split("//").next().unwrap_or_default()).collect();
    let code = code.join("\n");
    let mut found = Vec::new();
    for (start, _) in code.match_indices("crate::") {
        if code[..start].ends_with(|before: char| before.is_alphanumeric() || before == '_' || before == '$') {
            continue;
        }
        let line = 1 + code[..start].matches('\n').count();
        let rest = &code[start + "crate::".len()..];
        let names = rest.strip_prefix('{').map_or_else(|| vec![first_name(rest)], names_in_braces);
        found.extend(names.into_iter().map(|name| (line, name)));
    }
    found
}

fn first_name(path: &str) -> String {
    path.trim_start().chars().take_while(|letter| letter.is_alphanumeric() || *letter == '_').collect()
}

/// The first names of a list in braces, of which the opening one is gone.
fn names_in_braces(list: &str) -> Vec<String> {
    let mut names = Vec::new();
    let mut depth = 1;
    let mut start = 0;
    for (at, letter) in list.char_indices() {
        match letter {
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
        if depth == 0 || (letter == ',' && depth == 1) {
            names.push(first_name(&list[start..at]));
            start = at + 1;
        }
        if depth == 0 {
            break;
        }
    }
    names.retain(|name| !name.is_empty());
    names
}

/// The crates of this workspace among the dependencies of a manifest (those of tests may be any).
fn workspace_crates(manifest: &str) -> Vec<String> {
    let mut in_dependencies = false;
    let mut names = Vec::new();
    for line in manifest.lines() {
        if line.starts_with('[') {
            in_dependencies = line.contains("dependencies") && !line.contains("dev-dependencies");
        } else if in_dependencies && line.starts_with("lanecraft") {
            names.push(line.split(['.', ' ', '=']).next().unwrap_or_default().to_owned());
        }
    }
    names
}

#[test]
fn the_reader_of_paths_sees_every_form() {
    let text = "use crate::road::Road;\nuse crate::{scene::{Scene, Neighbor}, traffic, config::check};\n\
                fn f(x: crate::plan::Path) {} // crate::env\nmacro_crate::no();\nuse crate::{\n    decide::X,\n};\n";
    let names: Vec<String> = crate_paths(text).into_iter().map(|(line, name)| format!("{line} {name}")).collect();
    assert_eq!(names, ["1 road", "2 scene", "2 traffic", "2 config", "3 plan", "5 decide"]);
}

#[test]
fn the_reader_of_manifests_leaves_out_the_dependencies_of_tests() {
    let manifest = "[package]\nname = \"lanecraft-x\"\n[dependencies]\nlanecraft-net.workspace = true\nlibm = \"1\"\n\
                    lanecraft-qp = { path = \"\" }\n[dev-dependencies]\nlanecraft-lab.workspace = true\n";
    assert_eq!(workspace_crates(manifest), ["lanecraft-net", "lanecraft-qp"]);
}
