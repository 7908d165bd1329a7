//! Every effect of the library reaches ONNX: ONNX Runtime draws the scans that Burn draws.

use std::collections::BTreeSet;
use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData, s};
use lidar::ray_drop::uniform;
use lidar::{RangeImage, Sensor};
use ort::value::TensorRef;
use proto::card::{Card, tensor};
use scene::street::{StreetConfig, street};
use scene::{Motion, Pose, cast};
use trainer::closed_loop::base::Base;
use trainer::closed_loop::declared;
use trainer::closed_loop::export::to_onnx;
use trainer::closed_loop::model::{SensorModel, Term};
use trainer::closed_loop::network::Generated;
use trainer::effects::{Effect, Image, NOISE_CHANNELS, Rays, Simulated, library};

type Fact = Result<(), Box<dyn std::error::Error>>;
type Maybe<T> = Result<T, Box<dyn std::error::Error>>;

const RINGS: usize = 16;
const COLUMNS: usize = 128;
const FRAMES: usize = 2;

/// Range, reflectance and keep of every ray.
type Drawn = [Vec<f32>; 3];

fn sensor() -> Result<Sensor, lidar::sensor::SensorError> {
    let elevations_deg = (0..RINGS).map(|k| 3.0 - 1.6 * k as f64);
    Sensor::from_elevations_deg("small", elevations_deg, COLUMNS, (1.0, 100.0), 10.0)
}

fn streets(sensor: &Sensor) -> Result<Vec<RangeImage>, Box<dyn std::error::Error>> {
    (0..FRAMES as u64)
        .map(|seed| {
            let street = street(seed, &StreetConfig::default());
            let pose = Pose::above_ground(&street, 0.0, 0.0, 0.2).ok_or("ground")?;
            Ok(cast(&street, sensor, &pose, &Motion::default()).image)
        })
        .collect()
}

/// Independent uniform numbers, `[frame, channel, ring, column]`.
fn noise() -> Vec<f32> {
    let mut noise = vec![0.0; FRAMES * NOISE_CHANNELS * RINGS * COLUMNS];
    for (channel, block) in (1..).zip(noise.chunks_mut(RINGS * COLUMNS)) {
        uniform(11, channel, COLUMNS, block);
    }
    noise
}

/// The scans as they are, every ray reported.
fn ideal(scans: &[RangeImage]) -> Vec<Generated> {
    scans.iter().map(|scan| Generated { image: scan.clone(), keep: vec![1.0; RINGS * COLUMNS] }).collect()
}

/// What a model's effects make of what a network generated.
fn behind(generated: &[Generated], model: &SensorModel, sensor: &Sensor) -> Drawn {
    let device = Device::flex();
    let images = |of: &dyn Fn(&Generated) -> Vec<f32>| {
        let values: Vec<f32> = generated.iter().flat_map(of).collect();
        Tensor::<3>::from_data(TensorData::new(values, [FRAMES, RINGS, COLUMNS]), &device)
    };
    let range_m = images(&|g| g.image.range_m().to_vec());
    let simulated = Simulated {
        reflectance: images(&|g| g.image.reflectance().to_vec()),
        class: images(&|g| g.image.class().iter().map(|class| f32::from(*class)).collect()),
        keep: images(&|g| g.keep.clone()),
        range_m,
        frame: Tensor::zeros([FRAMES, 1, 1], &device),
    };
    let noise = Tensor::<4>::from_data(TensorData::new(noise(), [FRAMES, NOISE_CHANNELS, RINGS, COLUMNS]), &device);
    let mut channels = noise.split(1, 1).into_iter().map(|c| c.reshape([FRAMES, RINGS, COLUMNS]));
    let noise = std::array::from_fn(|_| channels.next().unwrap_or_else(|| unreachable!("as many as are asked for")));
    let drawn = model.forward(Image::new(simulated, Rays::new(sensor, &device))).draw(noise);
    [drawn.range_m, drawn.reflectance, drawn.keep]
        .map(|x| x.expand([FRAMES, RINGS, COLUMNS]).into_data().iter::<f32>().collect())
}

fn in_onnx_runtime(onnx: &[u8], scans: &[RangeImage]) -> Result<Drawn, Box<dyn std::error::Error>> {
    let mut session = runtime::open(&runtime::environment()?, onnx, 1)?;
    let mut scan = vec![0.0; FRAMES * 3 * RINGS * COLUMNS];
    for (scan, block) in scans.iter().zip(scan.chunks_mut(3 * RINGS * COLUMNS)) {
        scan.write_tensor(block);
    }
    let noise = noise();
    let outputs = session.run(ort::inputs![
        tensor::SCAN => TensorRef::from_array_view(([FRAMES, 3, RINGS, COLUMNS], scan.as_slice()))?,
        tensor::NOISE => TensorRef::from_array_view(([FRAMES, NOISE_CHANNELS, RINGS, COLUMNS], noise.as_slice()))?
    ])?;
    let image = |name: &str| Ok::<_, ort::Error>(outputs[name].try_extract_tensor::<f32>()?.1.to_vec());
    Ok([image(tensor::RANGE)?, image(tensor::REFLECTANCE)?, image(tensor::KEEP)?])
}

fn card(sensor: &Sensor) -> Card {
    Card {
        schema: proto::card::SCHEMA,
        name: "effects".into(),
        summary: "A test".into(),
        licence: "MIT".into(),
        sensor: sensor.clone(),
        column_multiple: COLUMNS,
        noise_channels: NOISE_CHANNELS,
        adds_returns: true,
        drop_bursts: lidar::ray_drop::Bursts::default(),
        classes: vec![],
        effects: vec![],
        trained_on: vec![],
        scores: vec![],
        notes: String::new(),
    }
}

/// The effect so many of its fit's units away from its start.
fn at_work(effect: &Arc<dyn Effect>, units: f64) -> Term {
    let mut term = Term::new(Arc::clone(effect), RINGS);
    for (i, x) in term.fitted.iter_mut().enumerate() {
        *x = [0.83, -0.61, 0.47, 1.09][i % 4] * units;
    }
    term
}

/// Rays on which the two differ by more than rounding does.
///
/// Both compute in single precision, in orders of their own, so results differ by some units of 6e-8 of the numbers on the way: on
/// planes, whose neighbours' directions are nearly parallel, up to 1e-3 of a range.
fn rays_apart(found: &Drawn, expected: &Drawn) -> BTreeSet<usize> {
    let apart = |i: &usize| {
        let tolerances = [1e-3 * expected[0][*i].max(1.0), 1e-3, 1e-3];
        (0..3).any(|k| (found[k][*i] - expected[k][*i]).abs() > tolerances[k] || found[k][*i].is_nan())
    };
    (0..expected[0].len()).filter(apart).collect()
}

/// Rays that rounding decides: so near a choice (which plane has more votes, whether a return comes, which step a range is rounded to)
/// that Burn itself chooses otherwise where ranges change by a few units of their last place.
fn unsteady(generated: &[Generated], model: &SensorModel, sensor: &Sensor) -> BTreeSet<usize> {
    let expected = behind(generated, model, sensor);
    let nudged = |draw: u32| {
        let nudge = |g: &Generated| {
            let mut nudges = vec![0.0; RINGS * COLUMNS];
            uniform(u64::from(draw), 9, COLUMNS, &mut nudges);
            let range_m = g.image.range_m().iter().zip(nudges).map(|(r, u)| r * (1.0 + 6e-7 * (u - 0.5)));
            let (reflectance, class) = (g.image.reflectance().to_vec(), g.image.class().to_vec());
            let image = RangeImage::from_channels(COLUMNS, range_m.collect(), reflectance, class);
            Generated { image, keep: g.keep.clone() }
        };
        behind(&generated.iter().map(nudge).collect::<Vec<_>>(), model, sensor)
    };
    (0..8).flat_map(|draw| rays_apart(&nudged(draw), &expected)).collect()
}

/// What stands between ONNX Runtime's answer and Burn's, in words; nothing if both are the same but where rounding decides.
fn difference(
    onnx: &[u8],
    generated: &[Generated],
    scans: &[RangeImage],
    model: &SensorModel,
) -> Maybe<Option<String>> {
    let sensor = sensor()?;
    let apart = rays_apart(&in_onnx_runtime(onnx, scans)?, &behind(generated, model, &sensor));
    let unsteady = unsteady(generated, model, &sensor);
    let steady = apart.difference(&unsteady).count();
    let rays = FRAMES * RINGS * COLUMNS;
    eprintln!("{} of {rays} rays apart, {steady} of them steady; {} are not", apart.len(), unsteady.len());
    // Eight draws do not find every ray that rounding decides; and were there many, nothing would be shown.
    let same = steady * 1000 <= rays && unsteady.len() * 50 <= rays;
    Ok((!same).then(|| format!("{} of {rays} rays apart, {steady} steady, {} unsteady", apart.len(), unsteady.len())))
}

#[test]
fn onnx_runtime_draws_what_burn_draws_with_every_effect_and_with_all_of_them() -> Fact {
    let sensor = sensor()?;
    let scans = streets(&sensor)?;
    let generated = ideal(&scans);
    let floor = SensorModel::ideal(RINGS);
    let plain = behind(&generated, &floor, &sensor);
    let acts = |model: &SensorModel| !rays_apart(&plain, &behind(&generated, model, &sensor)).is_empty();
    let mut models = vec![("noise_floor", floor.clone())];
    let (mut whole, mut failures) = (floor.clone(), Vec::new());
    for effect in library() {
        let name = effect.about().name;
        let with = |units: f64| floor.with(&[at_work(&effect, units)]);
        // Some effects begin where they do nothing, many units from where they do something.
        let model = [1.0, 4.0, 16.0, 64.0].map(with).into_iter().find(acts);
        // A model has no frames: drift, which depends on nothing else, rests.
        if model.is_none() && effect.about().covariates != ["frame"] {
            failures.push(format!("{name} does nothing, so that nothing is shown"));
        }
        let model = model.unwrap_or_else(|| with(1.0));
        whole.terms.extend(model.effects().to_vec());
        models.push((name, model));
    }
    models.push(("all of them", whole));
    for (name, model) in &models {
        eprint!("{name}: ");
        match to_onnx(model, None, &card(&sensor)) {
            Ok(onnx) => {
                let difference = difference(&onnx, &generated, &scans, model)?;
                failures.extend(difference.map(|difference| format!("{name}: {difference}")));
            }
            Err(error) => failures.push(format!("{name}: {error:#}")),
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
    Ok(())
}

/// A network with noise of its own: half a metre too far in its median, and sure of returns everywhere.
#[derive(burn::module::Module, Debug)]
struct TooFar {}

fn too_far() -> Result<Vec<u8>, onnx::Error> {
    let device = Device::flex();
    onnx::Exporter::new()
        .input(tensor::SCAN)
        .input(tensor::NOISE)
        .output(tensor::RANGE)
        .output(tensor::REFLECTANCE)
        .output(tensor::KEEP)
        .dynamic(onnx::Axis::new("batch", 1).on(tensor::SCAN, 0).on(tensor::NOISE, 0))
        .metadata(proto::card::METADATA_KEY, &network_card().map_or_else(|_| String::new(), |card| card.to_json()))
        .export(
            &TooFar {},
            |sizes| {
                let image = |channels| Tensor::<4>::zeros([sizes["batch"], channels, RINGS, COLUMNS], &device);
                (image(3), image(2))
            },
            |_, (scan, noise)| {
                let channel = |x: &Tensor<4>, i: usize| x.clone().slice(s![.., i..i + 1, .., ..]);
                let range_m = channel(&scan, 0) + channel(&noise, 1);
                (range_m, channel(&scan, 1) * 0.5, channel(&scan, 1) * 0.0 + 0.9)
            },
        )
}

fn network_card() -> Result<Card, lidar::sensor::SensorError> {
    Ok(Card { noise_channels: 2, adds_returns: false, ..card(&sensor()?) })
}

#[test]
fn effects_behind_a_network_act_on_what_it_generates_and_come_off_again() -> Fact {
    let (folder, sensor) = (tempfile::tempdir()?, sensor()?);
    let scans = streets(&sensor)?;
    let written = |name: &str, onnx: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, onnx).map(|()| path)
    };
    let base = Base::read(&written("network.onnx", &too_far()?)?, &sensor)?;
    let network = base.network.as_ref().ok_or("a network")?;
    assert!(base.declared.effects().is_empty());
    let generated = network.generate(&scans, &sensor)?;
    for (scan, generated) in scans.iter().zip(&generated) {
        for (i, simulated_m) in scan.range_m().iter().enumerate() {
            let (range_m, keep) = (generated.image.range_m()[i], generated.keep[i]);
            if *simulated_m > 0.0 {
                assert!((range_m - simulated_m - 0.5).abs() < 1e-5 && (keep - 0.9).abs() < 1e-6, "{range_m}, {keep}");
            } else {
                assert_eq!(range_m, 0.0, "a return that the network does not add");
            }
        }
    }

    let offset = library().into_iter().find(|e| e.about().name == "elevation_offset").ok_or("in the library")?;
    let mut model = SensorModel::ideal(RINGS);
    model.terms.push(at_work(&offset, 3.0));
    let whole = Card { effects: declared::write(&model, &[]), ..card(&sensor) };
    let onnx = to_onnx(&model, Some(network), &whole)?;
    assert_eq!(difference(&onnx, &generated, &scans, &model)?, None);

    let again = Base::read(&written("whole.onnx", &onnx)?, &sensor)?;
    let names: Vec<&str> = again.declared.effects().iter().map(Term::name).collect();
    assert_eq!(names, ["elevation_offset"]);
    assert!((again.declared.effects()[0].physical()[0] - model.effects()[0].physical()[0]).abs() < 1e-9);
    let of_again = again.network.ok_or("the network")?.generate(&scans, &sensor)?;
    for (a, b) in of_again.iter().zip(&generated) {
        assert!(a.image == b.image && a.keep == b.keep, "the network as it was");
    }
    Ok(())
}

#[test]
fn a_model_of_another_sensor_is_refused_by_name() -> Fact {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("model.onnx");
    std::fs::write(&path, to_onnx(&SensorModel::ideal(RINGS), None, &card(&sensor()?))?)?;
    let refused = |other: &Sensor| Base::read(&path, other).map_or_else(|e| format!("{e:#}"), |_| String::new());
    let said = refused(&Sensor::builtin("vlp16")?.with_columns(COLUMNS)?);
    for wanted in ["model.onnx", "`small` (16 rings from 3.00°", "16 rings from 15.00°", "128 columns"] {
        assert!(said.contains(wanted), "`{wanted}` in: {said}");
    }
    let raised =
        Sensor::from_elevations_deg("up", (0..RINGS).map(|k| 3.05 - 1.6 * k as f64), COLUMNS, (1.0, 100.0), 10.0)?;
    assert!(refused(&raised).contains("`up`"));
    Ok(())
}
