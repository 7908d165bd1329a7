//! What the file says of itself: names, symbols, metadata; and that it is the same each time.

use burn::tensor::{Device, Tensor};
use onnx::{Axis, Exporter, Sizes};

use crate::comparison::{At, Case};
use crate::dynamic::{Generator, scan};
use crate::sample::{Function, floats, scrambled};
use crate::{checker, runtime};

fn exporter() -> Exporter {
    let free = |name: &str, base: usize, axis: usize| Axis::new(name, base).on("scan", axis).on("noise", axis);
    Exporter::new()
        .input("scan")
        .input("noise")
        .output("range")
        .output("keep")
        .dynamic(free("batch", 1, 0))
        .dynamic(free("column", 16, 3).multiple_of(4))
}

fn at(sizes: &Sizes) -> At {
    At { batch: sizes["batch"], column: sizes["column"] }
}

fn generator(exporter: &Exporter) -> Vec<u8> {
    let module = scrambled(Generator::new(&Device::flex()), 11);
    exporter.export(&module, |sizes| scan(at(sizes)), Generator::forward).unwrap()
}

fn contains(file: &[u8], text: &str) -> bool {
    file.windows(text.len()).any(|bytes| bytes == text.as_bytes())
}

#[test]
fn the_same_module_gives_the_same_bytes() {
    let first = generator(&exporter());
    // Captures in other threads draw from the same counter of tensor numbers.
    let others: Vec<_> = (0..4).map(|_| std::thread::spawn(|| generator(&exporter()))).collect();
    for other in others {
        assert!(other.join().unwrap() == first);
    }
}

#[test]
fn parameters_keep_their_names() {
    let file = generator(&exporter());
    for name in
        ["stem.weight", "stem.bias", "stem_norm.gamma", "down_norm.running_var", "block_norm.beta", "keep.weight"]
    {
        assert!(contains(&file, name), "{name}");
    }
    assert!(contains(&file, "realbeam-onnx"));
}

#[test]
fn symbols_name_the_free_axes() {
    let file = generator(&exporter());
    let described = runtime::describe(&file);
    assert_eq!(
        described,
        [
            "scan: f32 [batch, 3, 8, column]",
            "noise: f32 [batch, 1, 8, column]",
            "range: f32 [batch, 1, 8, column]",
            "keep: f32 [batch, 1, 8, column]",
        ]
    );
}

#[test]
fn metadata_arrives() {
    let file = generator(&exporter().metadata("realbeam", "{\"rings\": 8}").metadata("licence", "MIT"));
    assert_eq!(runtime::metadata(&file, "realbeam").as_deref(), Some("{\"rings\": 8}"));
    assert_eq!(runtime::metadata(&file, "licence").as_deref(), Some("MIT"));
    assert_eq!(runtime::metadata(&file, "other"), None);
}

#[test]
fn every_opset_offered_passes_the_checker_and_agrees() {
    let module = scrambled(Generator::new(&Device::flex()), 11);
    let case = Case { module, inputs: scan, forward: Generator::forward, multiple: 4 };
    for opset in 18..=23 {
        let file = generator(&exporter().opset(opset));
        assert!(
            checker::verdict(&file).is_none_or(|verdict| verdict == "ok"),
            "{opset}: {:?}",
            checker::verdict(&file)
        );
        assert!(case.difference(&file) <= crate::comparison::TOLERANCE, "opset {opset}");
    }
}

#[test]
fn an_unused_input_stays_an_input() {
    let exporter = Exporter::new().input("used").input("unused").output("y");
    let exporter = exporter.dynamic(Axis::new("n", 4).on("used", 0).on("unused", 1));
    let inputs = |sizes: &Sizes| (floats([sizes["n"]], 1), floats([2, sizes["n"]], 2));
    let file = exporter.export(&Function {}, inputs, |_, (used, _): (Tensor<1>, Tensor<2>)| used * 2.0).unwrap();
    assert!(checker::verdict(&file).is_none_or(|verdict| verdict == "ok"));
    assert_eq!(runtime::describe(&file), ["used: f32 [n]", "unused: f32 [2, n]", "y: f32 [n]"]);
    let (used, unused) = (floats([6], 3), floats([2, 6], 4));
    let found = runtime::run(&file, &[used.clone().into_data(), unused.into_data()]);
    assert_eq!(found, [(used * 2.0).into_data()]);
}

#[test]
fn an_input_or_a_tensor_twice_may_be_an_output() {
    let exporter = ["same", "sum", "again"].into_iter().fold(Exporter::new().input("x"), Exporter::output);
    let forward = |_: &Function, x: Tensor<1>| {
        let sum = x.clone() + 1.0;
        (x, sum.clone(), sum)
    };
    let file = exporter.export(&Function {}, |_| floats([5], 1), forward).unwrap();
    assert!(checker::verdict(&file).is_none_or(|verdict| verdict == "ok"));
    let x = floats::<1>([5], 1);
    let sum = (x.clone() + 1.0).into_data();
    assert_eq!(runtime::run(&file, &[x.clone().into_data()]), [x.into_data(), sum.clone(), sum]);
}

/// A parameter may be called like an input: `range` of the generator is a layer and an output.
#[test]
fn a_name_taken_by_an_output_leaves_the_parameter_another() {
    #[derive(burn::module::Module, Debug)]
    struct Gain {
        y: burn::module::Param<Tensor<1>>,
    }
    let module = Gain { y: burn::module::Param::from_tensor(floats([5], 2)) };
    let forward = |gain: &Gain, x: Tensor<1>| x * gain.y.val();
    let file = Exporter::new().input("x").output("y").export(&module, |_| floats([5], 1), forward).unwrap();
    assert!(checker::verdict(&file).is_none_or(|verdict| verdict == "ok") && contains(&file, "y_1"));
    assert_eq!(runtime::run(&file, &[floats::<1>([5], 1).into_data()]), [forward(&module, floats([5], 1)).into_data()]);
}
