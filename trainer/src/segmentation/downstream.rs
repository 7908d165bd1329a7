//! What labelled scans are worth to perception: networks learn from each folder alone, and are scored on real scans.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use burn::tensor::Device;
use lidar::{Projector, RangeImage};

use super::classes::{NAMES, merged};
use super::config::SegmentationConfig;
use super::labelled::labelled_scans;
use super::sampler::Sampler;
use super::score::SegmentationScore;
use super::streets::thin_out;
use super::train::fit;
use super::weights::{Segmentation, SegmentationCard};
use crate::seeds::{self, mean_with_interval};

/// What networks are asked.
#[derive(Clone, Debug)]
pub struct Question {
    /// Folder of the labelled real scans that they are scored on.
    pub real: PathBuf,
    /// Seeds of the networks of each folder.
    pub seeds: Vec<u64>,
    /// Whether they see reflectances, or 0 in all scans: what most do whose simulator has none that mean anything.
    pub reflectance: bool,
}

/// Trains a network of the config's size and budget on each folder with each seed, scores it on labelled real scans, and tells the
/// scores as a table; the config's own scans are not read.
///
/// Where it says that real scans were projected before they were published, every second scan that is learned from loses what such a
/// projection loses: holes must not tell one from the other.
pub fn downstream(config: &SegmentationConfig, folders: &[PathBuf], question: &Question) -> Result<String> {
    let Question { real, seeds, reflectance } = question;
    ensure!(!folders.is_empty() && !seeds.is_empty(), "no folders to learn from, or no seeds");
    let sensor = config.sensor()?;
    let scans = |folder: &Path| -> Result<Vec<RangeImage>> {
        let scans = labelled_scans(folder, &sensor)?;
        Ok(if *reflectance { scans } else { scans.iter().map(without_reflectance).collect() })
    };
    let real = scans(real)?;
    ensure!(known(&real), "none of the real scans' labels is of a class that is told apart");
    let mut coarse = config.projected_by()?.map(|grid| Projector::new(&grid).by_elevation());
    let mut out = String::from("| learned from | scans | pixel accuracy | mean IoU |");
    let held = &names(&real);
    held.iter().try_for_each(|name| write!(out, " {name} |"))?;
    write!(out, "\n|---|---|---|---|{}", "---|".repeat(held.len()))?;
    for folder in folders {
        let mut scans = scans(folder)?;
        ensure!(known(&scans), "{}: none of the labels is of a class that is told apart", folder.display());
        if let Some(coarse) = &mut coarse {
            let thin = |(k, scan)| if k % 2 == 0 { Ok(scan) } else { thin_out(scan, &sensor, coarse) };
            scans = scans.into_iter().enumerate().map(thin).collect::<Result<_>>()?;
        }
        let count = scans.len();
        let mut scores = vec![];
        for &seed in seeds {
            let config = SegmentationConfig { seed, ..config.clone() };
            let sampler = Sampler::new(vec![scans.clone()], &sensor, seed, config.batch, config.crop_columns);
            let network = fit(&config, &sampler).with_context(|| format!("{}, seed {seed}", folder.display()))?;
            let card = SegmentationCard::new("", "", "", sensor.clone(), config.network.clone());
            let score = Segmentation { network, card }.score("real", &real, &sensor, &Device::flex());
            tracing::info!(folder = %folder.display(), seed, score.pixel_accuracy, score.mean_iou, "learned");
            scores.push(score);
        }
        let over_seeds =
            |of: &dyn Fn(&SegmentationScore) -> f64| mean_with_interval(&scores.iter().map(of).collect::<Vec<f64>>());
        let (accuracy, mean_iou) = (over_seeds(&|score| score.pixel_accuracy), over_seeds(&|score| score.mean_iou));
        write!(out, "\n| {} | {count} | {accuracy} | {mean_iou} |", folder.display())?;
        for class in 0..held.len() {
            write!(out, " {} |", over_seeds(&|score| score.iou[class].1))?;
        }
    }
    let blind = if *reflectance { "" } else { ", reflectances unseen" };
    write!(
        out,
        "\n\n{} real scans; {} steps of {} cut-outs of {} columns, {}{blind}.\n",
        real.len(),
        config.steps,
        config.batch,
        config.crop_columns,
        seeds::said(seeds)
    )?;
    Ok(out)
}

/// The same scan, reflecting nothing.
fn without_reflectance(scan: &RangeImage) -> RangeImage {
    let nothing = vec![0.0; scan.range_m().len()];
    RangeImage::from_channels(scan.columns(), scan.range_m().to_vec(), nothing, scan.class().to_vec())
}

/// Whether anything can be learned from these scans' labels, or scored by them.
fn known(scans: &[RangeImage]) -> bool {
    !names(scans).is_empty()
}

/// The classes that scans hold, in the order in which a score tells them.
fn names(scans: &[RangeImage]) -> Vec<&'static str> {
    let held = |c: &usize| scans.iter().flat_map(RangeImage::class).any(|class| merged(*class) == Some(*c));
    (0..NAMES.len()).filter(held).map(|c| NAMES[c]).collect()
}
