//! A trained network as `models/<name>/<version>/`: `model.onnx` with its card inside, and the card again for people.

mod verify;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use burn::module::{Module, ModuleDisplay};
use burn::tensor::{Device, Tensor};
use lidar::Sensor;
use lidar::label::CLASS_NAMES;
use lidar::ray_drop::Bursts;
use onnx::{Axis, Exporter, Sizes};
use proto::card::{Card, METADATA_KEY, SCHEMA, tensor};

use crate::config::{AnyConfig, DataConfig, TrainConfig};
use crate::data::Scans;
use crate::data::scans::classes_seen;
use crate::evaluate::Scores;
use crate::exported::with_measured;
use crate::generator::{Generator, Phased};
use crate::network::{COLUMN_MULTIPLE, Measurement, UNet};
use crate::train::{best_network, supervised};
use crate::translation::config::Split;
use crate::translation::training::{Trained, TranslationScores};
use crate::translation::{self, Domain, Method, TranslationConfig};

/// Columns that a graph is traced at; far more than any network's reach.
const TRACED_COLUMNS: usize = 128;

/// Writes a network and its card as ONNX bytes: physical units in and out, batch and column left free. Where the card has noise, that is
/// an input, and draws the reflectances.
pub fn to_onnx<G: Generator + Module>(network: &G, card: &Card) -> Result<Vec<u8>> {
    let (rings, device) = (card.sensor.rings().len(), Device::flex());
    let inputs = if card.noise_channels == 0 { vec![tensor::SCAN] } else { vec![tensor::SCAN, tensor::NOISE] };
    let on_all = |axis: Axis, place: usize| inputs.iter().fold(axis, |axis, name| axis.on(name, place));
    let column = Axis::new("column", TRACED_COLUMNS).multiple_of(card.column_multiple);
    let exporter = inputs
        .iter()
        .fold(Exporter::new(), |exporter, name| exporter.input(name))
        .output(tensor::RANGE)
        .output(tensor::REFLECTANCE)
        .output(tensor::KEEP)
        .dynamic(on_all(Axis::new("batch", 1), 0))
        .dynamic(on_all(column, 3))
        .metadata(METADATA_KEY, &card.to_json());
    let image =
        |sizes: &Sizes, channels| Tensor::<4>::zeros([sizes["batch"], channels, rings, sizes["column"]], &device);
    let outputs = |measured: Measurement| (measured.range_m, measured.reflectance, measured.keep);
    let scan = |sizes: &Sizes| image(sizes, tensor::SCAN_CHANNELS);
    Ok(if card.noise_channels == 0 {
        exporter.export(network, scan, |network, scan| outputs(network.measure(scan)))?
    } else {
        let with_noise = |sizes: &Sizes| (scan(sizes), image(sizes, card.noise_channels));
        exporter.export(network, with_noise, |network, (scan, noise)| outputs(network.measure(scan).drawn(&noise)))?
    })
}

/// The best network of a run, scored anew, as ONNX bytes that ONNX Runtime reads as Burn does, and its card.
pub fn export(run: &Path, data_root: &Path) -> Result<(Vec<u8>, Card)> {
    match AnyConfig::read(&run.join("config.toml"))? {
        AnyConfig::Supervised(config) => {
            let scores = supervised::scores(&config, run, data_root)?;
            let (network, card) = finish(&config, run, data_root, &scores)?;
            let (onnx, card) = verified(&network, card)?;
            with_measured(onnx, card, data_root, &config.train, true)
        }
        AnyConfig::Translation(config) => {
            let scores = translation::training::scores(&config, run, data_root)?;
            let card = translation_card(&config, data_root, &scores)?;
            let (_, phases) = config.served()?;
            let (onnx, card) = match translation::best_network(&config, run)? {
                Trained::Translator(network) => in_phases(*network, phases, card),
                Trained::UNet(network) => in_phases(*network, phases, card),
            }?;
            let answers_with_middle = config.learns_pairs() && !config.generator.scatter;
            with_measured(onnx, card, data_root, &config.real.train, answers_with_middle)
        }
        AnyConfig::BirdsEye(_) => bail!("{}: what is seen from above does not lead back to points", run.display()),
    }
}

fn in_phases<G: Generator + Module + ModuleDisplay>(network: G, phases: usize, card: Card) -> Result<(Vec<u8>, Card)> {
    if phases == 1 { verified(&network, card) } else { verified(&Phased::new(network, phases), card) }
}

fn verified<G: Generator + Module>(network: &G, card: Card) -> Result<(Vec<u8>, Card)> {
    let onnx = to_onnx(network, &card)?;
    verify::agrees(network, &onnx, &card)?;
    Ok((onnx, card))
}

fn translation_card(config: &TranslationConfig, data_root: &Path, scores: &TranslationScores) -> Result<Card> {
    let (grid, (sensor, phases)) = (config.grid()?, config.served()?);
    let learned = |split: &Split| Domain::load(data_root, &split.train, &grid);
    let mut trained_on = learned(&config.real)?.datasets;
    if config.method != Method::UNet {
        trained_on.extend(learned(&config.simulated)?.datasets);
    }
    Ok(Card {
        schema: SCHEMA,
        name: config.name.clone(),
        summary: config.summary.clone(),
        licence: config.licence.clone(),
        trained_on,
        column_multiple: config.multiple() * phases,
        sensor,
        noise_channels: usize::from(config.generator.scatter),
        adds_returns: false,
        drop_bursts: Bursts::default(),
        classes: CLASS_NAMES.iter().map(ToString::to_string).collect(),
        effects: vec![],
        scores: scores.to_card(),
        notes: config.notes.clone(),
    })
}

/// The best network of a run as it goes out, and its card.
pub fn finish(config: &TrainConfig, run: &Path, data_root: &Path, scores: &Scores) -> Result<(UNet, Card)> {
    let sensor = config.sensor()?;
    let load = |data: &DataConfig| Scans::load(data_root, data, &sensor);
    let learned: Vec<Scans> = config.train.iter().map(load).collect::<Result<_>>()?;
    let network = best_network(config, run)?.forget_unseen_classes(&classes_seen(&learned));
    Ok((network, card(config, sensor, learned, scores)))
}

fn card(config: &TrainConfig, sensor: Sensor, learned: Vec<Scans>, scores: &Scores) -> Card {
    Card {
        schema: SCHEMA,
        name: config.name.clone(),
        summary: config.summary.clone(),
        licence: config.licence.clone(),
        trained_on: learned.into_iter().map(|scans| scans.dataset).collect(),
        sensor,
        column_multiple: COLUMN_MULTIPLE,
        noise_channels: 0,
        adds_returns: false,
        drop_bursts: Bursts::default(),
        classes: CLASS_NAMES.iter().map(ToString::to_string).collect(),
        effects: vec![],
        scores: scores.to_card(),
        notes: config.notes.clone(),
    }
}

/// Publishes a model as the next version in `models/<name>/` and returns its folder; nobody ever sees it half-written.
pub fn publish(models: &Path, card: &Card, onnx: &[u8]) -> Result<PathBuf> {
    let folder = models.join(&card.name);
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let mut newest = 0;
    for entry in std::fs::read_dir(&folder)? {
        let version = entry?.file_name().to_str().and_then(|name| name.parse::<u32>().ok());
        newest = newest.max(version.unwrap_or(0));
    }
    let place = folder.join((newest + 1).to_string());
    let building = tempfile::Builder::new().prefix(".model-").tempdir_in(&folder)?;
    lidar::formats::write_atomically(&building.path().join("model.onnx"), onnx)?;
    lidar::formats::write_atomically(&building.path().join("card.md"), to_markdown(card).as_bytes())?;
    ensure!(!place.exists(), "{} appeared while it was being written", place.display());
    let building = building.keep();
    // A temporary folder is its owner's alone; a model is for whoever runs the server.
    #[cfg(unix)]
    std::fs::set_permissions(&building, std::os::unix::fs::PermissionsExt::from_mode(0o755))?;
    std::fs::rename(&building, &place).with_context(|| format!("cannot publish {}", place.display()))?;
    Ok(place)
}

/// The card for people.
pub fn to_markdown(card: &Card) -> String {
    let (near, far) = card.sensor.range_limits_m();
    let (rings, columns) = (card.sensor.rings().len(), card.sensor.columns());
    let mut out = format!(
        "# {}\n\n{}.\n\n- Licence: {}\n- Sensor: {}, {rings} rings × {columns} columns, {near} to {far} m\n- Input and output: see ARCHITECTURE.md, \"One model = one ONNX file\"\n",
        card.name,
        card.summary.trim_end_matches('.'),
        card.licence,
        card.sensor.name,
    );
    if !card.notes.is_empty() {
        let _ = write!(out, "\n{}\n", card.notes);
    }
    if !card.drop_bursts.is_empty() {
        out += "\n## Lost rays\n\nAlong a ring rays share their fate in bursts (ARCHITECTURE.md, \"One model = one ONNX file\").\n\n| share of the rays | length (° of azimuth) |\n|---|---|\n";
    }
    for burst in card.drop_bursts.as_slice() {
        let _ = writeln!(out, "| {} | {} |", burst.share, burst.azimuth_deg);
    }
    if !card.effects.is_empty() {
        out += "\n## Sensor effects\n\n| effect | parameter | value | standard error |\n|---|---|---|---|\n";
    }
    for effect in &card.effects {
        for p in &effect.parameters {
            let stderr = p.stderr.map_or_else(String::new, |stderr| format!("{stderr:.2e}"));
            let _ = writeln!(out, "| {} | {} | {} | {stderr} |", effect.name, p.name, (p.value * 1e6).round() / 1e6);
        }
    }
    out += "\n## Learned from\n\n| data | licence | scans | SHA-256 |\n|---|---|---|---|\n";
    for d in &card.trained_on {
        let _ =
            writeln!(out, "| {} | {} | {} | `{}…` |", d.name, d.licence, d.scans, &d.sha256[..16.min(d.sha256.len())]);
    }
    if card.scores.is_empty() {
        return out;
    }
    out += "\n## Held-out scores\n\n| metric | unit | pass-through | model | scans |\n|---|---|---|---|---|\n";
    for s in &card.scores {
        let _ = writeln!(out, "| {} | {} | {:.4} | {:.4} | {} |", s.metric, s.unit, s.pass_through, s.model, s.scans);
    }
    out
}
