//! The folder that a calibration fills: as a whole or not at all.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

/// Files that a calibration writes; a folder with nothing else in it may be replaced by the next one.
pub const FILES: [&str; 4] = ["model.onnx", "card.md", "report.json", "report.html"];

/// Refuses a folder that is there and has anything in it but the files of an earlier calibration, which may be replaced.
pub fn check(folder: &Path) -> Result<()> {
    let entries = match std::fs::read_dir(folder) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        entries => entries.with_context(|| format!("{}", folder.display()))?,
    };
    for entry in entries {
        let name = entry?.file_name();
        if !FILES.iter().any(|file| name == *file) {
            bail!(
                "{} has `{}` in it, which no calibration wrote: give --out a new folder, or one of an earlier calibration",
                folder.display(),
                name.display()
            );
        }
    }
    Ok(())
}

/// Makes the folder one with these files and nothing else; they are written beside it, and it is renamed.
pub fn replace(folder: &Path, files: &[(&str, &[u8])]) -> Result<()> {
    check(folder)?;
    let folder = std::path::absolute(folder)?;
    let parent = folder.parent().with_context(|| format!("{} is no folder to write", folder.display()))?;
    std::fs::create_dir_all(parent).with_context(|| format!("cannot make {}", parent.display()))?;
    let beside = tempfile::Builder::new().prefix(".calibration-").tempdir_in(parent)?;
    let (new, old) = (beside.path().join("new"), beside.path().join("old"));
    std::fs::create_dir(&new)?;
    for (name, bytes) in files {
        lidar::formats::write_atomically(&new.join(name), bytes)?;
    }
    let failed = |path: &Path| {
        let path = PathBuf::from(path);
        move || format!("cannot replace {}", path.display())
    };
    if folder.exists() {
        std::fs::rename(&folder, &old).with_context(failed(&folder))?;
    }
    if let Err(error) = std::fs::rename(&new, &folder) {
        // Back as it was; the error that matters is the first one.
        let _ = std::fs::rename(&old, &folder);
        return Err(error).with_context(failed(&folder));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).expect("a folder").map(|e| e.expect("an entry").file_name());
        let mut names: Vec<String> = entries.map(|name| name.to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_calibration_takes_the_place_of_an_earlier_one_and_of_nothing_else() -> Result<()> {
        let root = tempfile::tempdir()?;
        let out = root.path().join("deep/out");
        replace(&out, &[("model.onnx", b"1"), ("report.html", b"old")])?;
        replace(&out, &[("model.onnx", b"2")])?;
        assert_eq!(std::fs::read(out.join("model.onnx"))?, b"2");
        assert_eq!(names(&out), ["model.onnx"], "nothing of the earlier one stays");
        std::fs::write(out.join("thesis.tex"), "ten years")?;
        let refused = replace(&out, &[("model.onnx", b"3")]).map_err(|e| e.to_string());
        assert!(refused.is_err_and(|e| e.contains("`thesis.tex`")));
        assert_eq!(names(&out), ["model.onnx", "thesis.tex"]);
        assert_eq!(names(&root.path().join("deep")), ["out"], "nothing half-written lies beside it");
        Ok(())
    }
}
