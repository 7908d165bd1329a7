//! The committed code is what the `.proto` files say. To write it anew: `REALBEAM_GENERATE=1 cargo test -p proto --test generated`.

use std::fs;
use std::path::Path;

type Result<T = ()> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Generates the code into a folder; gives the names of its files.
fn generate(folder: &Path) -> Result<Vec<String>> {
    let protos = Path::new(env!("CARGO_MANIFEST_DIR")).join("protos");
    let files = protox::compile(["open_inference.proto", "scans.proto"], [protos])?;
    tonic_prost_build::configure()
        .build_server(false)
        .build_transport(false)
        .client_mod_attribute(".", "#[cfg(feature = \"client\")]")
        .bytes(".")
        .out_dir(folder)
        .compile_fds(files)?;
    let names = fs::read_dir(folder)?.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned()));
    names.collect()
}

#[test]
fn the_committed_code_is_what_the_protos_say() -> Result {
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/grpc");
    let folder = tempfile::tempdir()?;
    let names = generate(folder.path())?;
    assert_eq!(names.len(), 2, "{names:?}");
    for name in names {
        let generated = fs::read_to_string(folder.path().join(&name))?;
        if std::env::var_os("REALBEAM_GENERATE").is_some() {
            fs::write(committed.join(&name), generated)?;
        } else {
            assert!(fs::read_to_string(committed.join(&name))? == generated, "{name} is not what the protos say");
        }
    }
    Ok(())
}
