//! Which scenarios are meant.

use std::path::{Path, PathBuf};

use anyhow::Context;
use toml::Table;
use torno::scenario::Scenario;
use torno::text_file;

/// A scenario that is meant.
pub(super) struct Selected {
    /// Its file.
    pub(super) path: String,
    /// Its name, as far as the file can be read.
    pub(super) name: Option<String>,
    /// The scenario, or what is wrong with it.
    pub(super) scenario: anyhow::Result<Scenario>,
}

/// The scenarios in these files and folders, in the order of the arguments, and of a folder by their paths; only those
/// with `filter` in their names or paths, in capitals or not.
///
/// # Errors
/// There is none, or a folder cannot be read.
pub(super) fn select(paths: &[PathBuf], filter: Option<&str>, seed: Option<u64>) -> anyhow::Result<Vec<Selected>> {
    let mut selected = Vec::new();
    for path in paths {
        if !path.is_dir() {
            selected.push(load(path, seed));
            continue;
        }
        let mut found = Vec::new();
        find(path, &mut found)?;
        found.sort();
        let before = selected.len();
        selected.extend(found.iter().filter(|path| is_scenario(path)).map(|path| load(path, seed)));
        anyhow::ensure!(selected.len() > before, "{}: expected scenarios (*.toml), found none", path.display());
    }
    if let Some(filter) = filter {
        let wanted = filter.to_lowercase();
        let has = |text: &String| text.to_lowercase().contains(&wanted);
        // One whose name is not known may be meant.
        selected.retain(|selected| has(&selected.path) || selected.name.as_ref().is_none_or(has));
        anyhow::ensure!(!selected.is_empty(), "-k: no scenario has '{filter}' in its name or in the path of its file");
    }
    Ok(selected)
}

fn load(path: &Path, seed: Option<u64>) -> Selected {
    let scenario = Scenario::load(path, seed).map_err(anyhow::Error::from);
    let name = match &scenario {
        Ok(scenario) => Some(scenario.name.clone()),
        Err(_) => table(path).and_then(|table| Some(table.get("name")?.as_str()?.to_owned())),
    };
    Selected { path: path.display().to_string(), name, scenario }
}

fn table(path: &Path) -> Option<Table> {
    text_file::read(path).ok()?.parse().ok()
}

/// All files of a folder that end in `.toml`, and of the folders below. What is hidden is not looked at, and no link to
/// a folder is followed: it may lead back.
fn find(folder: &Path, found: &mut Vec<PathBuf>) -> anyhow::Result<()> {
    let cannot = || format!("cannot read the folder '{}'", folder.display());
    for entry in std::fs::read_dir(folder).with_context(cannot)? {
        let entry = entry.with_context(cannot)?;
        let path = entry.path();
        if entry.file_name().as_encoded_bytes().starts_with(b".") {
            continue;
        }
        if entry.file_type().with_context(cannot)?.is_dir() {
            find(&path, found)?;
        } else if path.extension().is_some_and(|extension| extension == "toml") && !path.is_dir() {
            found.push(path);
        }
    }
    Ok(())
}

/// Whether a file of a folder is a scenario, or is meant as one: it has a name, a step or an expectation, and is no
/// rig. One that cannot be read is meant as one: it is never left out without a word.
fn is_scenario(path: &Path) -> bool {
    let Some(table) = table(path) else { return true };
    let has = |key: &&str| table.contains_key(*key);
    let is = ["step", "expect"].iter().any(has) || has(&"name") && !["board", "pc", "link"].iter().any(has);
    if !is {
        tracing::info!("'{}' is no scenario", path.display());
    }
    is
}
