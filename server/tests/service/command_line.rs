//! The binary: what it prints, how it fails, how it stops.

use std::cell::RefCell;
use std::fs;
use std::io::{BufRead, BufReader, Lines, Read, Write};
use std::net::TcpStream;
use std::process::{Child, ChildStderr, Command, Output, Stdio};
use std::thread;
use std::time::Duration;

use crate::support::{Result, bin, data};

fn realbeam_server() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_realbeam-server"));
    command.env("REALBEAM_MODELS", data().join("models")).env_remove("RUST_LOG");
    command
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn inspect_prints_card_inputs_and_outputs_without_onnx_runtime() -> Result {
    let output = realbeam_server().args(["inspect", "passthrough"]).env("ORT_DYLIB_PATH", "/nowhere.so").output()?;
    assert!(output.status.success(), "{}", stderr(&output));
    let text = String::from_utf8(output.stdout)?;
    let digest = text.lines().find_map(|line| line.strip_prefix("SHA-256    ")).unwrap_or_default().to_owned();
    assert_eq!(digest.len(), 64);
    let expected = "\
passthrough, version 2: Element-wise stand-in for tests
SHA-256    DIGEST
licence    MIT OR Apache-2.0
sensor     16 rings for tests: 16 rings × 360 columns, 0.5–120 m, 10 Hz
elevation  +15.000 +13.000 +11.000 +9.000 +7.000 +5.000 +3.000 +1.000 -1.000 -3.000 -5.000 -7.000 -9.000 -11.000 -13.000 -15.000 deg
classes    unlabelled, car
input      scan float32 [batch, 3, 16, column]
input      noise float32 [batch, 1, 16, column]
output     range float32 [batch, 1, 16, column]
output     reflectance float32 [batch, 1, 16, column]
output     keep float32 [batch, 1, 16, column]
";
    assert_eq!(text, expected.replace("DIGEST", &digest));
    Ok(())
}

#[test]
fn without_onnx_runtime_the_error_says_the_command_that_mends_it() -> Result {
    for arguments in
        [&["serve", "--addr=127.0.0.1:0", "--default-model=passthrough"][..], &["convert", "a.bin", "b.bin"]]
    {
        let output = realbeam_server().args(arguments).env("ORT_DYLIB_PATH", "/nowhere/libonnxruntime.so").output()?;
        assert!(!output.status.success());
        let said = stderr(&output);
        assert!(said.contains("there is no /nowhere/libonnxruntime.so; run `scripts/fetch-onnxruntime.sh`"), "{said}");
    }
    let broken = tempfile::NamedTempFile::new()?;
    let output = realbeam_server().args(["convert", "a.bin", "b.bin"]).env("ORT_DYLIB_PATH", broken.path()).output()?;
    assert!(stderr(&output).contains("cannot be loaded") && stderr(&output).contains("scripts/fetch-onnxruntime.sh"));
    Ok(())
}

#[test]
fn convert_reports_failures_with_its_exit_code() -> Result {
    let folder = tempfile::tempdir()?;
    fs::write(folder.path().join("good.bin"), bin()?)?;
    let convert = |from: &str, to: &str| {
        let arguments = ["convert", "--model=passthrough", "--seed=1", from, to];
        realbeam_server().args(arguments).current_dir(folder.path()).output()
    };
    assert!(convert("good.bin", "out.ply")?.status.success());
    assert!(folder.path().join("out.ply").is_file());
    fs::create_dir(folder.path().join("in"))?;
    fs::write(folder.path().join("in/bad.bin"), [0; 5])?;
    let output = convert("in", "out")?;
    assert!(!output.status.success());
    assert!(stderr(&output).contains("1 of 1 files failed:\nin/bad.bin: scan: "), "{}", stderr(&output));
    Ok(())
}

#[test]
fn a_request_under_way_at_sigterm_is_answered() -> Result {
    let mut command = realbeam_server();
    let mut service = Serving::start(
        command.env("REALBEAM_ADDR", "127.0.0.1:0").env("REALBEAM_DEFAULT_MODEL", "passthrough"),
        plain,
    )?;
    let body = bin()?;
    let mut stream = TcpStream::connect(&service.addr)?;
    write!(stream, "POST /v1/scan HTTP/1.1\r\nhost: x\r\nconnection: close\r\ncontent-length: {}\r\n\r\n", body.len())?;
    stream.write_all(&body[..1000])?;
    thread::sleep(Duration::from_millis(200));
    assert!(Command::new("kill").arg(service.process.id().to_string()).status()?.success());
    thread::sleep(Duration::from_millis(200));
    stream.write_all(&body[1000..])?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer)?;
    assert!(answer.starts_with(b"HTTP/1.1 200"), "{}", String::from_utf8_lossy(&answer[..answer.len().min(200)]));
    assert!(service.process.wait()?.success());
    Ok(())
}

/// A served process; ended when dropped.
struct Serving {
    process: Child,
    addr: String,
    /// Held, so that the process can write on.
    log: Lines<BufReader<ChildStderr>>,
}

impl Serving {
    /// Starts it and waits for the line of its log in which `address` finds the address.
    fn start(command: &mut Command, address: impl Fn(&str) -> Option<String>) -> Result<Self> {
        let mut process = command.arg("serve").stderr(Stdio::piped()).spawn()?;
        let mut log = BufReader::new(process.stderr.take().ok_or("no stderr")?).lines();
        let mut said = String::new();
        for line in log.by_ref() {
            let line = line?;
            if let Some(addr) = address(&line) {
                return Ok(Self { process, addr, log });
            }
            said += &line;
        }
        Err(format!("the service ended before it listened: {said}").into())
    }
}

/// The address in a line of the log for people.
fn plain(line: &str) -> Option<String> {
    line.split_once("listening at http://").map(|(_, addr)| addr.trim().into())
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

#[test]
fn a_model_is_checked_by_the_binary_itself_and_loaded_by_whoever_has_the_token() -> Result {
    let folder = tempfile::tempdir()?;
    let publish = |file: &str| -> Result<String> {
        let place = folder.path().join("street/1");
        fs::create_dir_all(&place)?;
        fs::copy(data().join(file), place.join("model.onnx"))?;
        Ok(place.join("model.onnx").display().to_string())
    };
    let serve = |variables: &[(&str, &str)]| {
        let mut command = realbeam_server();
        command.env("REALBEAM_MODELS", folder.path()).env("REALBEAM_DEFAULT_MODEL", "street");
        command.env("REALBEAM_ADDR", "127.0.0.1:0").envs(variables.iter().copied());
        command
    };
    let refused = |variables: &[(&str, &str)], words: &str| -> Result {
        let output = serve(variables).arg("serve").output()?;
        let said = stderr(&output);
        assert!(!output.status.success() && said.contains(words), "`{said}` has no `{words}`");
        Ok(())
    };
    let file = publish("hostile/moody.onnx")?;
    refused(&[], &format!("model {file}: refused by its check: output `keep` is another one the second time"))?;
    publish("models/passthrough/1/model.onnx")?;
    let admin = ("REALBEAM_ADMIN", "127.0.0.1:0");
    refused(&[admin], "--admin needs a token: either REALBEAM_ADMIN_TOKEN or --admin-token-file")?;
    refused(&[admin, ("REALBEAM_ADMIN_TOKEN", "short")], "expected a token of 16 to 4096 visible ASCII characters")?;
    refused(
        &[("REALBEAM_ADMIN", "0.0.0.0:0"), ("REALBEAM_ADMIN_TOKEN", "0123456789abcdef")],
        "is not a loopback address",
    )?;
    refused(&[("REALBEAM_TLS_CERT", "cert.pem")], "--tls-cert and --tls-key go together; one of them is missing")?;
    refused(&[("REALBEAM_TLS_CERT", "c.pem"), ("REALBEAM_TLS_KEY", "k.pem")], "TLS file c.pem: No such file")?;
    refused(&[("REALBEAM_SOCKET_MODE", "rw")], "expected octal digits such as 660")?;
    refused(&[("REALBEAM_CANARY", "street=1:0.1,street=2:0.1")], "model `street` has two canaries")?;

    let token = folder.path().join("token");
    fs::write(&token, "0123456789abcdef\n")?;
    let token = token.display().to_string();
    let address = RefCell::new(None);
    let _service = Serving::start(&mut serve(&[admin, ("REALBEAM_ADMIN_TOKEN_FILE", &token)]), |line| {
        let said = line.split_once("models are loaded at ").map(|(_, url)| url.trim().to_owned());
        said.map(|url| address.replace(Some(url)));
        plain(line)
    })?;
    let url = format!("{}/v2/repository/models/street/load", address.take().ok_or("no admin listener in the log")?);
    publish("hostile/hungry.onnx")?;
    let agent = ureq::Agent::config_builder().http_status_as_error(false).build().new_agent();
    let load = || agent.post(&url).header("authorization", "Bearer 0123456789abcdef").send_empty();
    let mut answer = load()?;
    let said = answer.body_mut().read_to_string()?;
    assert!(answer.status() == 422 && said.contains("does not run on an empty scan"), "{said}");
    publish("models/passthrough/2/model.onnx")?;
    assert_eq!(load()?.status(), 200);
    Ok(())
}

#[test]
fn the_token_of_the_service_comes_from_a_file_or_a_variable_and_is_never_logged() -> Result {
    let folder = tempfile::tempdir()?;
    let (file, token) = (folder.path().join("token"), "0123456789abcdef");
    fs::write(&file, format!("{token}\n"))?;
    let serve = || {
        let mut command = realbeam_server();
        command
            .env("REALBEAM_DEFAULT_MODEL", "passthrough")
            .env("REALBEAM_ADDR", "127.0.0.1:0")
            .env("RUST_LOG", "trace");
        command
    };
    let both = serve().arg("serve").arg("--token-file").arg(&file).env("REALBEAM_TOKEN", token).output()?;
    assert!(stderr(&both).contains("a token in REALBEAM_TOKEN and in --token-file; expected one of them"));
    let short = serve().arg("serve").env("REALBEAM_TOKEN", "a secret").output()?;
    assert!(stderr(&short).contains("REALBEAM_TOKEN: expected a token of 16"), "{}", stderr(&short));
    assert!(!both.status.success() && !short.status.success() && !stderr(&short).contains("a secret"));

    for command in [serve().env("REALBEAM_TOKEN", token), serve().env("REALBEAM_TOKEN_FILE", &file)] {
        let mut service = Serving::start(command, plain)?;
        let ask = |token: &str| {
            let agent = ureq::Agent::config_builder().http_status_as_error(false).build().new_agent();
            let asked = agent.get(format!("http://{}/info", service.addr)).header("authorization", token);
            asked.call().map(|answer| answer.status().as_u16())
        };
        assert_eq!((ask(&format!("Bearer {token}"))?, ask("Bearer fedcba9876543210")?), (200, 401));
        assert!(Command::new("kill").arg(service.process.id().to_string()).status()?.success());
        let log = service.log.by_ref().collect::<std::io::Result<Vec<_>>>()?.concat();
        assert!(log.contains("/info") && !log.contains(token) && !log.contains("fedcba"), "{log}");
    }
    Ok(())
}

/// By processor time, so that a busy machine changes nothing.
#[test]
fn a_check_ends_with_its_time_and_takes_no_more_than_its_memory() -> Result {
    let check = |file: &str, limits: [&str; 2]| -> Result<Output> {
        let mut command = realbeam_server();
        Ok(command.arg("check-model").args(limits).stdin(fs::File::open(data().join(file))?).output()?)
    };
    let (memory, time) = ("--memory-bytes=4294967296", "--time-s=60");
    let good = "models/passthrough/2/model.onnx";
    assert!(check(good, [memory, time])?.status.success());
    let endless = check("hostile/endless.onnx", [memory, "--time-s=1"])?;
    assert_eq!(endless.status.code(), None, "ended by a signal: {}", endless.status);
    let hungry = check("hostile/hungry.onnx", [memory, time])?;
    assert!(String::from_utf8_lossy(&hungry.stdout).contains("Failed to allocate memory"), "{hungry:?}");
    // Too little for ONNX Runtime's library. With just enough for that, memory may end where Rust cannot report it and waits for ever,
    // which is for the service's clock to end.
    assert!(!check(good, ["--memory-bytes=20000000", time])?.status.success(), "the limit is one");
    Ok(())
}

#[test]
fn a_configuration_file_and_the_environment_say_what_the_command_line_does_not() -> Result {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("server.toml");
    let text = "addr = '127.0.0.1:0'\ndefault_model = 'no-such'\nmax_points = 7\nlog_format = 'json'\nqueue = 3\n\
                canary = ['passthrough=1:1.0']\nno_ui = true\n";
    fs::write(&file, text)?;
    let mut command = realbeam_server();
    let command = command.env("REALBEAM_CONFIG", &file).env("REALBEAM_DEFAULT_MODEL", "passthrough");
    let service = Serving::start(command, |line| {
        let line: serde_json::Value = serde_json::from_str(line).ok()?;
        line["message"].as_str()?.strip_prefix("listening at http://").map(Into::into)
    })?;
    let mut info = ureq::get(format!("http://{}/info", service.addr)).call()?;
    let info: serde_json::Value = serde_json::from_str(&info.body_mut().read_to_string()?)?;
    let page = ureq::get(format!("http://{}/", service.addr)).config().http_status_as_error(false).build().call()?;
    assert_eq!(page.status(), 404);
    assert_eq!((&info["default_model"], &info["max_points"]), (&"passthrough".into(), &7.into()));
    let scan =
        ureq::post(format!("http://{}/v1/scan", service.addr)).content_type("application/octet-stream").send_empty()?;
    assert_eq!(scan.headers().get("x-realbeam-model-version").and_then(|v| v.to_str().ok()), Some("1"), "the canary");

    fs::write(&file, "quue = 3")?;
    let output = realbeam_server().args(["serve", "--config"]).arg(&file).output()?;
    let said = stderr(&output);
    assert!(!output.status.success() && said.contains("server.toml: key `quue` is unknown; there are "), "{said}");
    Ok(())
}
