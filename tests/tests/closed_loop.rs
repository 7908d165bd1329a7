//! The loop closes through the served model: what `calibrate` found on some streets, `convert` puts into the scans of others.

use std::path::{Path, PathBuf};
use std::process::Command;

use burn::tensor::{Device, Tensor};
use hidden::{Geometry, Recipe};
use lidar::formats::{self, Limits};
use lidar::ray_drop::uniform;
use lidar::{Projector, RangeImage, Sensor};
use tests::binary;
use trainer::closed_loop::base::Base;
use trainer::closed_loop::data::{Pair, batches};
use trainer::closed_loop::model::Term;
use trainer::closed_loop::split::Split;
use trainer::effects::NOISE_CHANNELS;
use trainer::sets::PairedSet;

type Fact = Result<(), Box<dyn std::error::Error>>;
type Maybe<T> = Result<T, Box<dyn std::error::Error>>;

const OFFSET_DEG: f64 = 0.3;

/// Streets of the set that is calibrated on; those after them are never seen.
const SEEN: usize = 6;

fn recipe(scenes: usize) -> Maybe<Recipe> {
    let elevations_deg = (0..24).map(|k| 3.0 - k as f64);
    let sensor = Sensor::from_elevations_deg("small", elevations_deg, 256, (1.0, 100.0), 10.0)?;
    let hidden = vec![Geometry::ElevationOffset { offset_deg: OFFSET_DEG }.into()];
    Ok(Recipe { scenes, ..Recipe::new(5, sensor, hidden) })
}

fn succeed(command: &mut Command) -> Maybe<String> {
    let output = command.output()?;
    let said = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    if output.status.success() { Ok(said) } else { Err(format!("{command:?}: {said}").into()) }
}

fn calibrate(set: &Path, model: &str, out: &Path) -> Maybe<String> {
    let mut command = Command::new(binary("realbeam-trainer")?);
    succeed(command.arg("calibrate").arg(set).args(["--model", model, "--out"]).arg(out))
}

/// Errors of what was predicted for rays that were measured, in m, without signs.
#[derive(Default)]
struct Errors(Vec<f32>);

impl Errors {
    fn add(&mut self, predicted: &RangeImage, measured: &RangeImage) {
        let both = predicted.range_m().iter().zip(measured.range_m()).filter(|(p, m)| **p > 0.0 && **m > 0.0);
        self.0.extend(both.map(|(p, m)| (p - m).abs()));
    }

    fn median_m(&mut self) -> f32 {
        let middle = self.0.len() / 2;
        *self.0.select_nth_unstable_by(middle, f32::total_cmp).1
    }
}

/// What a model says of a frame, in Burn: its median, or one draw.
fn predicted(base: &Base, pair: &Pair, sensor: &Sensor, seed: Option<u64>) -> RangeImage {
    let device = Device::flex();
    let batch = batches(&[pair], sensor, &device).remove(0);
    let size = [1, sensor.rings().len(), sensor.columns()];
    let noise = std::array::from_fn::<Tensor<3>, NOISE_CHANNELS, _>(|channel| {
        let mut block = vec![0.5; sensor.pixels()];
        if let Some(seed) = seed {
            uniform(seed, channel as u32 + 1, sensor.columns(), &mut block);
        }
        Tensor::<1>::from_floats(block.as_slice(), &device).reshape(size)
    });
    let drawn = base.declared.forward(batch.image).draw(noise);
    let numbers = |x: Tensor<3>| x.expand(size).into_data().iter::<f32>().collect::<Vec<_>>();
    // Rays that may be reported: which of them are is drawn elsewhere.
    let keep = numbers(drawn.keep);
    let range_m = numbers(drawn.range_m).into_iter().zip(keep).map(|(r, keep)| if keep > 0.0 { r } else { 0.0 });
    RangeImage::from_channels(sensor.columns(), range_m.collect(), numbers(drawn.reflectance), vec![0; sensor.pixels()])
}

fn image(path: &Path, sensor: &Sensor) -> Maybe<RangeImage> {
    Ok(Projector::new(sensor).project(&formats::read(path, &Limits::default())?)?.image)
}

#[test]
fn streets_never_seen_come_out_of_the_server_as_the_sensor_measures_them() -> Fact {
    let root = tempfile::tempdir()?;
    let at = |name: &str| root.path().join(name);
    let recipe_of_seen = recipe(SEEN)?;
    hidden::write(&recipe_of_seen, &at("set"))?;
    hidden::write(&recipe(SEEN + 4)?, &at("more"))?;

    let said = calibrate(&at("set"), "ideal", &at("out"))?;
    assert!(said.contains("elevation_offset"), "{said}");
    let model = at("out/model.onnx");
    let sensor = &recipe_of_seen.sensor;
    let base = Base::read(&model, sensor)?;
    let found: Vec<&str> = base.declared.effects().iter().map(Term::name).collect();
    assert_eq!(found.first(), Some(&"elevation_offset"));
    let found_deg = base.declared.effects()[0].physical()[0];
    assert!((found_deg - OFFSET_DEG).abs() < 0.02, "{found_deg}°");

    // The same folder as a model of a repository.
    std::fs::create_dir_all(at("models/small"))?;
    std::fs::rename(at("out"), at("models/small/1"))?;
    let set = PairedSet::read(&at("set"))?;
    let pairs = trainer::closed_loop::calibrate::pairs(&set);
    let confirm: Vec<&Pair> = Split::new(&pairs, 0).confirm.into_iter().map(|i| &pairs[i]).collect();
    let unseen = PairedSet::read(&at("more"))?;
    let unseen_pairs = trainer::closed_loop::calibrate::pairs(&unseen);
    let frames: Vec<usize> = (0..unseen.frames.len()).filter(|i| unseen.frames[*i].scene >= SEEN).collect();
    assert_eq!(frames.len(), 8);

    let mut before = Errors::default();
    for frame in &frames {
        before.add(&unseen.frames[*frame].simulated, &unseen.frames[*frame].measured);
    }
    let before_m = before.median_m();
    for (noise, seed) in [("median", None), ("drawn", Some(3))] {
        let (mut after, mut converted) = (Errors::default(), Errors::default());
        for pair in &confirm {
            after.add(&predicted(&base, pair, sensor, seed), &pair.measured);
        }
        let (mut apart, mut rays) = (0, 0);
        for frame in &frames {
            let name = &unseen.frames[*frame].name;
            let (from, to): (PathBuf, PathBuf) =
                (at(&format!("more/sim/{name}.ply")), at(&format!("{noise}-{name}.ply")));
            let mut convert = Command::new(binary("realbeam-server")?);
            convert.args(["convert", "--model", "small", "--noise", noise, "--seed", "3", "--models"]);
            succeed(convert.arg(at("models")).args([&from, &to]))?;
            let image = image(&to, sensor)?;
            converted.add(&image, &unseen.frames[*frame].measured);
            let in_burn = predicted(&base, &unseen_pairs[*frame], sensor, seed);
            for (served_m, in_burn_m) in image.range_m().iter().zip(in_burn.range_m()).filter(|(s, _)| **s > 0.0) {
                rays += 1;
                // A point cloud in single precision and back: some 1e-5 m at 100 m.
                apart += usize::from((served_m - in_burn_m).abs() > 1e-3 * in_burn_m.max(1.0));
            }
        }
        assert!(apart * 1000 < rays, "{noise}: {apart} of {rays} served rays are not what the loop's model says");
        let (after_m, converted_m) = (after.median_m(), converted.median_m());
        eprintln!("{noise}: median error {before_m} m before, {after_m} m on confirm scenes, {converted_m} m served");
        // Some 5000 rays on the confirm scenes: their median error is known to 2 %; streets differ in what is hard to predict.
        assert!((converted_m / after_m - 1.0).abs() < 0.15, "{noise}: {converted_m} m served, {after_m} m promised");
        assert!(converted_m < 0.4 * before_m, "{noise}: {converted_m} m of {before_m} m are left");
    }

    // What a model has is declared: on other scans it is refitted, and not found again.
    hidden::write(&Recipe { seed: 6, ..recipe(3)? }, &at("other"))?;
    calibrate(&at("other"), &at("models/small/1/model.onnx").to_string_lossy(), &at("again"))?;
    let again = Base::read(&at("again/model.onnx"), sensor)?;
    let names: Vec<&str> = again.declared.effects().iter().map(Term::name).collect();
    assert!(names.starts_with(&found), "{names:?} of a model that had {found:?}");
    let refitted_deg = again.declared.effects()[0].physical()[0];
    assert!(refitted_deg != found_deg && (refitted_deg - OFFSET_DEG).abs() < 0.03, "{refitted_deg}°");
    let card = again.file.ok_or("a file")?.card;
    let declared = format!("that were refitted: {}. Effects that were found: ", found.join(", "));
    assert!(card.notes.contains(&declared), "{}", card.notes);
    assert_eq!(card.trained_on.len(), 2, "both sets");
    Ok(())
}

#[test]
fn a_folder_with_something_else_in_it_is_left_alone() -> Fact {
    let root = tempfile::tempdir()?;
    std::fs::write(root.path().join("thesis.tex"), "ten years")?;
    let refused = calibrate(&root.path().join("no-set"), "ideal", root.path()).map_err(|e| e.to_string());
    assert!(refused.is_err_and(|e| e.contains("`thesis.tex`")));
    Ok(())
}
