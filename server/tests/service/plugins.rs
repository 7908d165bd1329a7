//! What simulators call: Python that needs nothing but its standard library.

use std::path::Path;
use std::process::Command;

use crate::support::{Result, Service, python};

#[test]
fn the_plugins_for_carla_and_ros_2_get_their_scans() -> Result {
    let Some(python) = python("unittest") else { return Ok(()) };
    let service = Service::start()?;
    let tests = Path::new(env!("CARGO_MANIFEST_DIR")).join("../plugins/test_plugins.py");
    let output = Command::new(python).arg(tests).env("REALBEAM_URL", service.url("")).output()?;
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    // unittest finds no test to be no failure.
    assert!(said.contains("Ran 10 tests"), "{said}");
    Ok(())
}
