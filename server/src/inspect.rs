//! What a model says about itself, as text.

use std::fmt::Write as _;

use proto::card::{Dataset, Effect, Score};

use crate::model::Model;

/// The model's card, inputs and outputs, for a person to read.
pub fn describe(model: &Model) -> String {
    let card = &model.card;
    let sensor = &card.sensor;
    let (nearest_m, farthest_m) = sensor.range_limits_m();
    let elevations: Vec<String> =
        sensor.rings().iter().map(|ring| format!("{:+.3}", ring.elevation_rad.to_degrees())).collect();
    let version = model.version.map(|version| format!(", version {version}")).unwrap_or_default();
    let mut text = format!(
        "{}{version}: {}\nSHA-256    {}\nlicence    {}\nsensor     {}: {} rings × {} columns, {nearest_m}–{farthest_m} m, {} Hz\n\
         elevation  {} deg\nclasses    {}\n",
        model.name,
        card.summary,
        model.digest,
        card.licence,
        sensor.name,
        sensor.rings().len(),
        sensor.columns(),
        sensor.rotation_hz(),
        elevations.join(" "),
        card.classes.join(", "),
    );
    if card.adds_returns {
        list(&mut text, "returns", &["also on rays where the scan has none"], ToString::to_string);
    }
    list(&mut text, "input", &model.inputs, ToString::to_string);
    list(&mut text, "output", &model.outputs, ToString::to_string);
    list(&mut text, "ray drop", card.drop_bursts.as_slice(), ToString::to_string);
    list(&mut text, "effect", &card.effects, effect);
    list(&mut text, "learned", &card.trained_on, dataset);
    list(&mut text, "score", &card.scores, score);
    if !card.notes.is_empty() {
        list(&mut text, "notes", &[&card.notes], ToString::to_string);
    }
    text
}

fn list<T>(text: &mut String, title: &str, items: &[T], line: impl Fn(&T) -> String) {
    for item in items {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{title:<10} {}", line(item));
    }
}

fn effect(effect: &Effect) -> String {
    let parameters = effect.parameters.iter().map(|p| {
        let stderr = p.stderr.map(|stderr| format!(" ± {stderr}")).unwrap_or_default();
        format!("{} = {}{stderr}", p.name, p.value)
    });
    format!("{}: {}", effect.name, parameters.collect::<Vec<_>>().join(", "))
}

fn dataset(dataset: &Dataset) -> String {
    format!("{} ({}), {} scans, SHA-256 {}", dataset.name, dataset.licence, dataset.scans, dataset.sha256)
}

fn score(score: &Score) -> String {
    let Score { metric, unit, model, pass_through, scans } = score;
    let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
    format!("{metric}: {model}{unit} (doing nothing: {pass_through}{unit}), {scans} scans")
}
