//! Which frames show one scene, and may therefore not be told apart by statistics.

use std::path::Path;

use super::{MIN_SCENES, SetError, folder};

/// Scenes that frames without a list are cut into, if there are enough.
const BLOCKS: usize = 10;

/// The scenes of a set and the scene of each frame.
#[derive(Debug)]
pub(super) struct Scenes {
    pub(super) names: Vec<String>,
    pub(super) of_frame: Vec<usize>,
}

/// The scenes that a list names, one line a frame in the frames' order; without a list, blocks of consecutive frames.
pub(super) fn read(list: &Path, frames: usize, notes: &mut Vec<String>) -> Result<Scenes, SetError> {
    let scenes = match folder::text(list)? {
        Some(text) => listed(list, text.trim_end(), frames)?,
        None => blocks(frames, notes),
    };
    note_few(scenes.names.len(), notes);
    Ok(scenes)
}

/// Says what cannot be claimed with so few scenes.
pub(super) fn note_few(scenes: usize, notes: &mut Vec<String>) {
    if scenes < MIN_SCENES {
        notes.push(format!(
            "{scenes} of {MIN_SCENES} scenes: discovering, tuning and confirming take a scene each, so nothing can be confirmed on a \
             scene never seen, and intervals over scenes mean nothing"
        ));
    }
}

fn listed(path: &Path, text: &str, frames: usize) -> Result<Scenes, SetError> {
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    let failed = |found: String| {
        let expected = format!("{frames} lines, one scene name for each frame in the order of the frames' names");
        Err(SetError::Scenes { path: path.into(), found, expected })
    };
    if lines.len() != frames {
        return failed(format!("{} lines", lines.len()));
    }
    if let Some(empty) = lines.iter().position(|line| line.is_empty()) {
        return failed(format!("line {} is empty", empty + 1));
    }
    let mut scenes = Scenes { names: Vec::new(), of_frame: Vec::with_capacity(frames) };
    let mut known = std::collections::HashMap::new();
    for line in lines {
        let scene = *known.entry(line).or_insert_with(|| {
            scenes.names.push(line.into());
            scenes.names.len() - 1
        });
        scenes.of_frame.push(scene);
    }
    Ok(scenes)
}

fn blocks(frames: usize, notes: &mut Vec<String>) -> Scenes {
    let size = frames.div_ceil(BLOCKS).max(1);
    let names: Vec<String> = (0..frames.div_ceil(size)).map(|block| format!("block-{block:02}")).collect();
    notes.push(format!(
        "no scenes.txt: {frames} frames are taken as {} scenes of {size} consecutive frames; neighbouring blocks may show one place",
        names.len()
    ));
    Scenes { names, of_frame: (0..frames).map(|frame| frame / size).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_without_a_list_are_cut_into_about_ten_blocks() {
        for (frames, scenes, last) in [(1, 1, 0), (3, 3, 2), (20, 10, 9), (24, 8, 7), (101, 10, 9)] {
            let mut notes = Vec::new();
            let found = blocks(frames, &mut notes);
            assert_eq!((found.names.len(), found.of_frame[frames - 1]), (scenes, last), "{frames} frames");
            assert!(notes[0].contains("no scenes.txt"), "{notes:?}");
        }
    }
}
