//! What the service offers, and which files it refuses.

use std::fs;

use server::{Config, MAX_MODEL_BYTES, Model};
use sha2::{Digest, Sha256};

use crate::support::{Result, Service, config, data};

#[test]
fn info_lists_the_rings_to_simulate() -> Result {
    let info = Service::start()?.get("/info")?.json()?;
    assert_eq!(info["default_model"], "passthrough");
    let default = serde_json::json!({ "name": "application/octet-stream", "extension": "bin", "frame": "ros" });
    assert_eq!(info["media_types"][0], default);
    let names: Vec<_> = info["models"].as_array().into_iter().flatten().map(|m| m["name"].clone()).collect();
    assert_eq!(names, ["ghosts", "hdl64e", "passthrough"]);
    let model = &info["models"][2];
    assert_eq!((&model["version"], &model["versions"]), (&2.into(), &serde_json::json!([1, 2])));
    let sensor = &model["card"]["sensor"];
    assert_eq!(sensor["columns"], 360);
    let elevations: Vec<f64> = (0..16).map(|i| 15.0 - 2.0 * f64::from(i)).collect();
    assert_eq!(sensor["elevation_deg"], serde_json::json!(elevations));
    let digest = Sha256::digest(fs::read(data().join("models/passthrough/2/model.onnx"))?);
    let digest: Vec<String> = digest.iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(model["digest"], format!("sha256:{}", digest.concat()));
    Ok(())
}

#[test]
fn health_and_metadata_follow_the_open_inference_protocol() -> Result {
    let service = Service::start()?;
    assert_eq!(service.get("/v2/health/live")?.json()?, serde_json::json!({ "live": true }));
    assert_eq!(service.get("/v2/health/ready")?.json()?, serde_json::json!({ "ready": true }));
    let tensor = |name: &str, shape: [i64; 4]| serde_json::json!({ "name": name, "datatype": "FP32", "shape": shape });
    let metadata = service.get("/v2/models/passthrough")?.json()?;
    let outputs = ["range", "reflectance", "keep"].map(|name| tensor(name, [-1, 1, 16, -1]));
    let expected = serde_json::json!({
        "name": "passthrough",
        "versions": ["1", "2"],
        "platform": "onnxruntime_onnx",
        "inputs": [tensor("scan", [-1, 3, 16, -1]), tensor("noise", [-1, 1, 16, -1])],
        "outputs": outputs,
    });
    assert_eq!(metadata, expected);
    Ok(())
}

#[test]
fn files_that_break_the_contract_are_refused_with_what_is_wrong() {
    let problem = |file: &str| {
        let read = Model::read(&data().join("refused").join(file), MAX_MODEL_BYTES);
        read.map_err(|error| error.problem.to_string()).err()
    };
    for (file, words) in [
        ("no-card.onnx", "has no card: metadata property `realbeam` is missing"),
        (
            "fifteen-rings.onnx",
            "inputs are `scan float32 [batch, 3, 15, column]; noise float32 [batch, 1, 15, column]`",
        ),
        ("columns-of-another-sensor.onnx", "expected `scan float32 [batch, 3, 16, column or 360]`"),
        ("external-data.onnx", "weight `elsewhere` is external data"),
        ("operator-of-the-runtime.onnx", "operator `com.microsoft.Gelu` is none of ONNX's own"),
        ("no-such-file.onnx", "cannot be read"),
    ] {
        let problem = problem(file).unwrap_or_default();
        assert!(problem.contains(words), "{file}: {problem}");
    }
}

#[test]
fn a_damaged_file_is_never_a_model() -> Result {
    let whole = fs::read(data().join("models/passthrough/2/model.onnx"))?;
    assert!(Model::from_bytes(whole.clone()).is_ok());
    for length in 0..whole.len() {
        assert!(Model::from_bytes(whole[..length].to_vec()).is_err(), "cut to {length} bytes");
    }
    Ok(())
}

#[test]
fn a_service_does_not_start_on_a_model_that_is_damaged_or_not_there() -> Result {
    let folder = tempfile::tempdir()?;
    for (name, file) in [("good", "models/passthrough/2/model.onnx"), ("bad", "refused/fifteen-rings.onnx")] {
        let version = folder.path().join(name).join("1");
        fs::create_dir_all(&version)?;
        fs::copy(data().join(file), version.join("model.onnx"))?;
    }
    let mut config = config()?;
    (config.models, config.default_model) = (folder.path().into(), "good".into());
    let error = Service::with(&config).err().map(|error| error.to_string()).unwrap_or_default();
    let file = folder.path().join("bad/1/model.onnx");
    assert!(error.starts_with(&format!("model {}: graph and card disagree: ", file.display())), "{error}");
    config.default_model = "hdl64e".into();
    assert!(Service::with(&config).err().is_some_and(|e| e.to_string() == "no model `hdl64e`; there are: bad, good"));
    Ok(())
}

#[test]
fn a_file_larger_than_a_model_may_be_is_not_read() -> Result {
    let folder = tempfile::tempdir()?;
    let version = folder.path().join("street/1");
    fs::create_dir_all(&version)?;
    let file = version.join("model.onnx");
    let bytes = fs::copy(data().join("models/passthrough/2/model.onnx"), &file)?;
    let mut config = config()?;
    (config.models, config.default_model) = (folder.path().into(), "street".into());
    config.max_model_bytes = bytes;
    drop(Service::with(&config)?);
    let refused = |config: &Config| Service::with(config).err().map(|error| error.to_string()).unwrap_or_default();
    let place = format!("model {}: has", file.display());
    config.max_model_bytes = bytes - 1;
    let expected = format!("{place} {bytes} bytes, expected at most {} (max_model_bytes)", bytes - 1);
    assert_eq!(refused(&config), expected);
    // More than any memory, were it read; on the disk it is only said to be so large.
    let bytes = 1_u64 << 36;
    fs::File::create(&file)?.set_len(bytes)?;
    config.max_model_bytes = MAX_MODEL_BYTES;
    assert_eq!(refused(&config), format!("{place} {bytes} bytes, expected at most 1073741824 (max_model_bytes)"));
    let error = Model::read(&file, 7).map_err(|error| error.to_string()).err();
    assert_eq!(error, Some(format!("{place} {bytes} bytes, expected at most 7 (max_model_bytes)")));
    // A file that has no length of its own ends where a model may not go on.
    #[cfg(target_os = "linux")]
    assert!(
        Model::read("/dev/zero".as_ref(), 1000).is_err_and(|error| error.to_string().contains("has 1001 bytes")),
        "an endless file"
    );
    Ok(())
}
