//! burn-onnx makes a Burn model of an exported file that computes the same bits as the original.
//!
//! burn-onnx writes Rust, which has to be compiled before it can run: the test makes it anew, compares it with the copy that
//! was compiled in, and runs that with the weights just written. After a change to the exporter or to burn-onnx,
//! `UPDATE_READBACK=1 cargo test --release -p readback` renews the copy.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::path::Path;

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{Device, Tensor, TensorData};
use burn_onnx::{LoadStrategy, ModelGen};
use onnx::{Axis, Exporter};
use readback::Net;

/// What burn-onnx made of the file; not ours to format or to lint.
#[allow(warnings, clippy::all, clippy::pedantic, clippy::unwrap_used, clippy::expect_used)]
mod generated {
    include!("../generated/net.rs");
}

/// Numbers between 0 and 1 that look random and are the same in every run (the golden ratio's multiples).
fn numbers(start: usize) -> impl Iterator<Item = f32> {
    (start..).map(|n| (n as f64 * 0.618_033_988_749_895).fract() as f32)
}

/// Parameters that are the same in every run, norms and running statistics included.
struct Fill(usize);

impl ModuleMapper for Fill {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        self.0 += 1000;
        param.map(|tensor| {
            let values: Vec<f32> =
                numbers(self.0).take(tensor.shape().num_elements()).map(|number| number * 0.4 + 0.1).collect();
            Tensor::from_data(TensorData::new(values, tensor.shape()), &tensor.device())
        })
    }
}

fn inputs(batch: usize, column: usize) -> (Tensor<4>, Tensor<4>) {
    let device = Device::flex();
    let tensor = |channels: usize, start: usize| {
        let values: Vec<f32> = numbers(start).take(batch * channels * 8 * column).collect();
        Tensor::<4>::from_data(TensorData::new(values, [batch, channels, 8, column]), &device)
    };
    let range = tensor(1, 1) * 60.0;
    let range = range.clone().mask_fill(range.lower_elem(6.0), 0.0);
    (Tensor::cat(vec![range, tensor(1, 2), (tensor(1, 3) * 5.0).floor()], 1), tensor(1, 4))
}

fn export(net: &Net) -> Vec<u8> {
    let free = |symbol: &str, base: usize, axis: usize| Axis::new(symbol, base).on("scan", axis).on("noise", axis);
    let exporter = Exporter::new().input("scan").input("noise").output("range").output("keep");
    let exporter = exporter.dynamic(free("batch", 1, 0)).dynamic(free("column", 16, 3).multiple_of(2));
    exporter.export(net, |sizes| inputs(sizes["batch"], sizes["column"]), Net::forward).unwrap()
}

/// The generated source without the lines that name where it was generated.
fn source(path: &Path) -> String {
    let text = std::fs::read_to_string(path).unwrap();
    let lines: Vec<&str> = text.lines().filter(|line| !line.contains("Generated from ONNX")).collect();
    lines.join("\n") + "\n"
}

#[test]
fn burn_onnx_reads_an_exported_file_back_to_the_same_bits() {
    let device = Device::flex();
    let net = Net::new(&device).map(&mut Fill(0));
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("net.onnx");
    std::fs::write(&file, export(&net)).unwrap();
    ModelGen::new()
        .input(file.to_str().unwrap())
        .out_dir(dir.path().to_str().unwrap())
        .load_strategy(LoadStrategy::Bytes)
        .run_from_cli();

    let fresh = source(&dir.path().join("net.rs"));
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("generated/net.rs");
    if std::env::var_os("UPDATE_READBACK").is_some() {
        std::fs::write(&committed, &fresh).unwrap();
    }
    let stale =
        "generated/net.rs is stale: run UPDATE_READBACK=1 cargo test --release -p readback, then the test again";
    assert!(source(&committed) == fresh, "{stale}");
    assert!(include_str!("../generated/net.rs") == fresh, "{stale}");

    let weights = std::fs::read(dir.path().join("net.bpk")).unwrap();
    let read_back = generated::Model::from_bytes(burn::tensor::Bytes::from_bytes_vec(weights), &device);
    for (batch, column) in [(1, 16), (2, 22), (3, 64)] {
        let (scan, noise) = inputs(batch, column);
        let (range, keep) = net.forward((scan.clone(), noise.clone()));
        let (range_back, keep_back) = read_back.forward(scan.clone(), noise.clone());
        assert_eq!(bits(range), bits(range_back), "range at batch {batch}, column {column}");
        assert_eq!(bits(keep.clone()), bits(keep_back), "keep at batch {batch}, column {column}");
        // The comparison can fail: one input a millionth larger.
        let (_, other) = net.forward((scan * 1.000_001, noise));
        assert_ne!(bits(keep), bits(other));
    }
}

fn bits(tensor: Tensor<4>) -> Vec<u32> {
    tensor.into_data().iter::<f32>().map(f32::to_bits).collect()
}
