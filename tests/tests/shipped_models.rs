//! The models in the repository: small, licensed, trained, and better than nothing.

use proto::card::Score;
use tests::models;

type Fact = Result<(), Box<dyn std::error::Error>>;

#[test]
fn every_shipped_model_has_a_card_and_beats_the_pass_through_on_held_out_scans() -> Fact {
    let repository = server::Repository::new(models());
    runtime::environment()?;
    for (name, licence) in [("hdl64e", "CC-BY-NC-SA-3.0"), ("hdl32e", "Apache-2.0")] {
        let bytes = std::fs::metadata(models().join(name).join("1/model.onnx"))?.len();
        assert!(bytes < 10_000_000, "{name} has {bytes} bytes");
        let card = repository.read(name, Some(1))?.card;
        assert_eq!((card.name.as_str(), card.licence.as_str()), (name, licence));
        assert!(card.trained_on.iter().all(|data| data.sha256.len() == 64 && data.scans > 0), "{name}");
        let score = |metric: &str| -> Result<&Score, String> {
            card.scores.iter().find(|s| s.metric == metric).ok_or_else(|| format!("{name}: no {metric}"))
        };
        for lower_is_better in ["keep log-loss", "keep log-loss (against the best constant)", "reflectance MAE"] {
            let s = score(lower_is_better)?;
            assert!(s.model < s.pass_through, "{name}: {s:?}");
        }
        let s = score("keep AUC")?;
        assert!(s.model > s.pass_through, "{name}: {s:?}");
    }
    Ok(())
}
