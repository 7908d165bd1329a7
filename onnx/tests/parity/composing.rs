//! Two files as one: it computes what the two compute one after the other, and comes apart again.

use burn::tensor::{Device, Tensor, TensorData};
use onnx::{Axis, ComposeError, Composition, Exporter, FileError, Sizes, base_of, cut};

use crate::comparison::{At, TOLERANCE, difference};
use crate::dynamic::{Generator, scan};
use crate::sample::{Function, floats, floats_between, scrambled};
use crate::{checker, runtime};

/// What the composed files carry; the base too, so that it can be compared with what comes back.
const LICENCE: (&str, &str) = ("licence", "MIT");

fn at(sizes: &Sizes) -> At {
    At { batch: sizes["batch"], column: sizes["column"] }
}

fn free(names: &[&str]) -> [Axis; 2] {
    let on = |axis: Axis, place: usize| names.iter().fold(axis, |axis, name| axis.on(name, place));
    [on(Axis::new("batch", 1), 0), on(Axis::new("column", 16).multiple_of(4), 3)]
}

fn exporter(inputs: &[&str], outputs: &[&str]) -> Exporter {
    let exporter = inputs.iter().fold(Exporter::new(), |exporter, name| exporter.input(name));
    let exporter = outputs.iter().fold(exporter, |exporter, name| exporter.output(name));
    free(inputs).into_iter().fold(exporter, Exporter::dynamic)
}

/// A network from `scan` and one channel of `noise` to `range` and `keep`.
fn base() -> Vec<u8> {
    let net = scrambled(Generator::new(&Device::flex()), 11);
    let exporter = exporter(&["scan", "noise"], &["range", "keep"]).metadata(LICENCE.0, LICENCE.1);
    exporter.export(&net, |sizes| scan(at(sizes)), Generator::forward).unwrap()
}

type Four = (Tensor<4>, Tensor<4>, Tensor<4>, Tensor<4>);

/// Inputs of the top: `scan`, two channels of `noise`, the base's `range` and `keep`.
fn top_inputs(at: At) -> Four {
    let channels = |n: usize, seed: u64| floats_between([at.batch, n, 8, at.column], seed, 0.0, 1.0);
    (channels(3, 1), channels(2, 5), channels(1, 6), channels(1, 7))
}

/// Effects behind a network: each input counts, and the two channels of noise in different ways.
fn effects(_: &Function, (scan, noise, range, keep): Four) -> (Tensor<4>, Tensor<4>, Tensor<4>) {
    let channel = |x: &Tensor<4>, i: usize| x.clone().narrow(1, i, 1);
    let moved = range * 1.01 + channel(&noise, 0) * 0.5 + channel(&scan, 1);
    (moved, channel(&noise, 1) * 0.3 + channel(&scan, 0) * 0.2, keep * (channel(&noise, 1) * 0.5 + 0.5))
}

fn top_exporter() -> Exporter {
    exporter(&["scan", "noise", "measured", "kept"], &["range", "reflectance", "keep"])
}

fn top() -> Vec<u8> {
    top_exporter().export(&Function {}, |sizes| top_inputs(at(sizes)), effects).unwrap()
}

fn composition() -> Composition {
    Composition::new().wire("range", "measured").wire("keep", "kept").split("noise").metadata(LICENCE.0, LICENCE.1)
}

fn whole() -> Vec<u8> {
    composition().compose(&base(), &top()).unwrap()
}

fn checked(file: &[u8]) {
    assert!(checker::verdict(file).is_none_or(|verdict| verdict == "ok"), "{:?}", checker::verdict(file));
}

fn agree(found: &[TensorData], expected: &[TensorData]) -> bool {
    found.len() == expected.len() && found.iter().zip(expected).all(|(a, b)| difference(b, a) <= TOLERANCE)
}

#[test]
fn the_whole_computes_what_base_and_top_compute_one_after_the_other() {
    let (base, top, whole) = (base(), top(), whole());
    checked(&whole);
    for (batch, column) in [(1, 12), (2, 16), (3, 44)] {
        let at = At { batch, column };
        let (scan, first) = scan(at);
        let others = floats([batch, 2, 8, column], 9);
        let between = runtime::run(&base, &[scan.clone().into_data(), first.clone().into_data()]);
        let scan = scan.into_data();
        let noise = Tensor::cat(vec![first.clone(), others.clone()], 1).into_data();
        let swapped = Tensor::cat(vec![others.clone(), first], 1).into_data();
        let expected = runtime::run(&top, &[scan.clone(), others.into_data(), between[0].clone(), between[1].clone()]);
        assert!(agree(&runtime::run(&whole, &[scan.clone(), noise]), &expected), "batch {batch}, column {column}");
        assert!(!agree(&runtime::run(&whole, &[scan, swapped]), &expected), "each file has its own channels of noise");
    }
}

#[test]
fn the_whole_takes_the_inputs_of_both_and_gives_the_tops_outputs() {
    let whole = whole();
    let expected = [
        "scan: f32 [batch, 3, 8, column]",
        "noise: f32 [batch, 3, 8, column]",
        "range: f32 [batch, 1, 8, column]",
        "reflectance: f32 [batch, 1, 8, column]",
        "keep: f32 [batch, 1, 8, column]",
    ];
    assert_eq!(runtime::describe(&whole), expected);
    assert_eq!(runtime::metadata(&whole, "licence").as_deref(), Some("MIT"));
    assert!(whole == self::whole(), "the same files give the same bytes");
}

#[test]
fn the_base_comes_back_to_the_byte_however_often_it_was_composed() {
    let (base, whole) = (base(), whole());
    assert!(base_of(&whole, &["range", "keep"]).unwrap() == base);
    // The whole as a base: its own noise has three channels, the new top's two.
    let twice = composition().compose(&whole, &top()).unwrap();
    checked(&twice);
    assert_eq!(runtime::describe(&twice)[1], "noise: f32 [batch, 5, 8, column]");
    assert!(base_of(&twice, &["range", "reflectance", "keep"]).unwrap() == whole);
}

#[test]
fn a_cut_file_gives_the_tensors_asked_for_and_needs_no_more_than_they_do() {
    let part = cut(&whole(), &["base/keep", "reflectance"]).unwrap();
    checked(&part);
    let expected = [
        "scan: f32 [batch, 3, 8, column]",
        "noise: f32 [batch, 3, 8, column]",
        "base/keep: f32 [batch, 1, 8, column]",
        "reflectance: f32 [batch, 1, 8, column]",
    ];
    assert_eq!(runtime::describe(&part), expected);
    let (scan, noise) = (scan(At { batch: 2, column: 20 }).0.into_data(), floats([2, 3, 8, 20], 9).into_data());
    let whole = runtime::run(&whole(), &[scan.clone(), noise.clone()]);
    assert!(agree(&runtime::run(&part, &[scan, noise])[1..], &whole[1..2]));
    // The network's head of ranges is gone, and so are the effects on them.
    let shorter = cut(&self::whole(), &["base/keep"]).unwrap();
    assert!(shorter.len() < part.len() && !shorter.windows(12).any(|bytes| bytes == b"range.weight"));
}

#[test]
fn an_axis_that_one_file_fixes_is_fixed_in_the_whole() {
    let fixed = ["scan", "noise", "measured", "kept"].into_iter().fold(Exporter::new(), Exporter::input);
    let fixed = ["range", "reflectance", "keep"].into_iter().fold(fixed, Exporter::output);
    let top = fixed.export(&Function {}, |_| top_inputs(At { batch: 1, column: 24 }), effects).unwrap();
    let whole = composition().compose(&base(), &top).unwrap();
    checked(&whole);
    assert_eq!(runtime::describe(&whole)[..2], ["scan: f32 [1, 3, 8, 24]", "noise: f32 [1, 3, 8, 24]"]);
    let error = composition().compose(&self::whole(), &top).and_then(|whole| {
        composition().compose(&whole, &{
            let inputs = |_: &Sizes| top_inputs(At { batch: 1, column: 32 });
            fixed.export(&Function {}, inputs, effects).unwrap()
        })
    });
    let error = error.unwrap_err();
    assert!(matches!(&error, ComposeError::Disagree { from, .. } if from == "scan"), "{error}");
    let expected =
        "`scan` of the base and `scan` of the top: one is float32 [1, 3, 8, 24], the other float32 [1, 3, 8, 32]";
    assert_eq!(error.to_string(), expected);
}

#[test]
fn files_that_do_not_go_together_are_told_apart_by_name() {
    let (base, top) = (base(), top());
    let error = |composition: Composition| composition.compose(&base, &top).unwrap_err().to_string();
    assert_eq!(
        error(Composition::new().wire("rnage", "measured")),
        "wire from `rnage`: the base has no such output; there are: range, keep"
    );
    assert_eq!(
        error(Composition::new().wire("range", "scna")),
        "wire to `scna`: the top has no such input; there are: scan, noise, measured, kept"
    );
    assert_eq!(error(composition().wire("keep", "measured")), "two wires lead to the top's input `measured`");
    // Without the split both would take one tensor.
    assert_eq!(
        error(Composition::new().wire("range", "measured").wire("keep", "kept")),
        "`noise` of the base and `noise` of the top: one is float32 [batch, 1, 8, column], the other float32 [batch, 2, 8, column]"
    );
    assert_eq!(
        error(Composition::new().wire("range", "scan").split("noise")),
        "`range` of the base and `scan` of the top: one is float32 [batch, 1, 8, column], the other float32 [batch, 3, 8, column]"
    );
    let newer = top_exporter().opset(20).export(&Function {}, |sizes| top_inputs(at(sizes)), effects).unwrap();
    assert_eq!(
        composition().compose(&base, &newer).unwrap_err().to_string(),
        "operator set `ai.onnx`: the base has version 18, the top 20"
    );
}

#[test]
fn what_cannot_be_cut_is_said_by_name() {
    let whole = whole();
    let error = |outputs: &[&str]| cut(&whole, outputs).unwrap_err().to_string();
    assert_eq!(error(&["base/rnage"]), "no node or constant of the file is called `base/rnage`");
    assert_eq!(error(&["scan"]), "no node or constant of the file is called `scan`");
    assert_eq!(error(&["base/keep", "base/keep"]), "the name `base/keep` stands for two tensors");
    let inside = "base/stem.weight";
    assert_eq!(
        error(&[inside]),
        format!("tensor `{inside}` cannot be an output: the file does not state its type and shape")
    );
    assert!(matches!(base_of(&base(), &["range"]), Err(FileError::NoTensor { tensor }) if tensor == "base/range"));
}

#[test]
fn damaged_files_are_refused_and_never_fatal() {
    let (base, top) = (base(), top());
    for length in (0..top.len()).step_by(7) {
        assert!(composition().compose(&base, &top[..length]).is_err(), "{length} bytes");
    }
    // A flipped bit may leave a file that is one; it must not end the program.
    let mut damaged = top.clone();
    for place in (0..top.len()).step_by(3) {
        damaged[place] ^= 1 << (place % 8);
        let _ = composition().compose(&base, &damaged).map(|whole| cut(&whole, &["range"]));
        damaged[place] = top[place];
    }
}
