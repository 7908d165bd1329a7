//! The models in the repository: small, licensed, trained, and better than nothing.

use proto::card::Score;
use tests::models;

type Fact = Result<(), Box<dyn std::error::Error>>;

#[test]
fn every_shipped_model_has_a_card_and_beats_the_pass_through_on_held_out_scans() -> Fact {
    let repository = server::Repository::new(models());
    runtime::environment()?;
    // Translations have no twins to be scored on: what they are scored by is their distance from real scans. How many rays are lost ring by
    // ring says as much of the sky over a place as of the sensor; the card tells it, and nobody is the better for it.
    let twins: &[&str] = &["keep log-loss", "keep log-loss (against the best constant)", "reflectance MAE"];
    let distances: &[&str] = &["reflectance W1, from real", "range JSD, from real"];
    for (name, version, licence, lower_is_better) in [
        ("hdl64e", 3, "CC-BY-NC-SA-3.0", twins),
        ("hdl32e", 3, "Apache-2.0", twins),
        ("hdl64e-cls2r", 4, "CC-BY-NC-SA-3.0", distances),
    ] {
        let bytes = std::fs::metadata(models().join(name).join(version.to_string()).join("model.onnx"))?.len();
        assert!(bytes < 10_000_000, "{name} has {bytes} bytes");
        let card = repository.read(name, Some(version))?.card;
        assert_eq!((card.name.as_str(), card.licence.as_str()), (name, licence));
        assert!(card.trained_on.iter().all(|data| data.sha256.len() == 64 && data.scans > 0), "{name}");
        let score = |metric: &str| -> Result<&Score, String> {
            card.scores.iter().find(|s| s.metric == metric).ok_or_else(|| format!("{name}: no {metric}"))
        };
        for metric in lower_is_better {
            let s = score(metric)?;
            assert!(s.model < s.pass_through, "{name}: {s:?}");
        }
        if lower_is_better == twins {
            let s = score("keep AUC")?;
            assert!(s.model > s.pass_through, "{name}: {s:?}");
        }
    }
    Ok(())
}
