//! Models that come, change and go while the service runs.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

use proto::ErrorCode;
use serde_json::{Value, json};
use server::{AdminOptions, Config, Token};
use sha2::{Digest, Sha256};
use tempfile::TempDir;

use crate::support::{Answer, Result, Service, bin, config, data, wait_until};

/// The stand-ins that give scans back as they are, and with noise.
const PLAIN: &str = "models/passthrough/1/model.onnx";
const NOISY: &str = "models/passthrough/2/model.onnx";

const TOKEN: &str = "0123456789abcdef";
const BEARER: Option<&str> = Some("Bearer 0123456789abcdef");

/// A folder of models.
struct Folder(TempDir);

impl Folder {
    /// With the plain stand-in as version 1 of the model `street`.
    fn new() -> Result<Self> {
        Self::of("street")
    }

    fn of(name: &str) -> Result<Self> {
        let folder = Self(tempfile::tempdir()?);
        folder.publish(name, 1, &fs::read(data().join(PLAIN))?)?;
        Ok(folder)
    }

    /// As whoever publishes should: beside its place, then renamed.
    fn publish(&self, name: &str, version: u64, file: &[u8]) -> Result<PathBuf> {
        let (hidden, place) = (self.dir(name, &format!(".{version}")), self.dir(name, &version.to_string()));
        fs::create_dir_all(&hidden)?;
        fs::write(hidden.join("model.onnx"), file)?;
        fs::rename(hidden, &place)?;
        Ok(place.join("model.onnx"))
    }

    fn dir(&self, name: &str, version: &str) -> PathBuf {
        self.0.path().join(name).join(version)
    }

    /// What a service is started with that serves this folder, checks with the real binary and has an admin listener.
    fn config(&self) -> Result<Config> {
        let mut config = config()?;
        (config.models, config.default_model) = (self.0.path().into(), "street".into());
        config.check.program = Some(env!("CARGO_BIN_EXE_realbeam-server").into());
        config.admin = Some(AdminOptions { addr: "127.0.0.1:0".parse()?, token: Token::new(TOKEN)? });
        Ok(config)
    }
}

impl Service {
    fn load(&self, name: &str) -> Result<Answer> {
        self.admin(&format!("/v2/repository/models/{name}/load"), BEARER, "")
    }

    fn unload(&self, name: &str) -> Result<Answer> {
        // As tritonclient says it.
        let body = r#"{"parameters":{"unload_dependents":false}}"#;
        self.admin(&format!("/v2/repository/models/{name}/unload"), BEARER, body)
    }

    fn index(&self, body: &str) -> Result<Value> {
        self.admin("/v2/repository/index", BEARER, body)?.json()
    }

    /// The version that answers a scan without points.
    fn version(&self, query: &str, headers: &[(&str, &str)]) -> Result<u64> {
        let answer = self.scan(query, headers, &[])?;
        let version = answer.number("x-realbeam-model-version");
        answer.success()?;
        version
    }

    fn metric(&self, series: &str) -> Result<Option<String>> {
        let text = String::from_utf8(self.get("/metrics")?.success()?)?;
        Ok(text.lines().find_map(|line| Some(line.strip_prefix(series)?.trim().to_owned())))
    }
}

fn sha256(bytes: &[u8]) -> String {
    let digits: Vec<String> = Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect();
    digits.concat()
}

/// Swaps under load: 30 of them, or as many as `REALBEAM_SWAPS` says.
#[test]
fn hot_swaps_under_load_fail_no_request_and_mix_no_versions() -> Result {
    let swaps: u64 = std::env::var("REALBEAM_SWAPS").map_or(Ok(30), |number| number.parse())?;
    let folder = Folder::of("swapped")?;
    let service = Service::with(&Config { default_model: "swapped".into(), ..folder.config()? })?;
    let body = bin()?;
    // Odd versions are plain, even ones noisy; their answers differ.
    let files = [fs::read(data().join(NOISY))?, fs::read(data().join(PLAIN))?];
    let digests = files.each_ref().map(|file| format!("sha256:{}", sha256(file)));
    let reference = Service::start()?;
    let bytes = |query: &str| reference.scan(query, &[], &body).and_then(Answer::success);
    let expected = [bytes("?seed=7&version=2")?, bytes("?seed=7&version=1")?];
    assert!(expected[0] != expected[1]);

    let (over, answered) = (AtomicBool::new(false), AtomicUsize::new(0));
    let client = || -> std::result::Result<(), String> {
        let (mut last, mut seen) = (0, 0);
        while !over.load(Ordering::Relaxed) || seen == 0 {
            let answer = service.scan("?seed=7", &[], &body).map_err(|error| error.to_string())?;
            let version = answer.number("x-realbeam-model-version").map_err(|error| error.to_string())?;
            let digest = answer.header("x-realbeam-model-digest").to_owned();
            let kind = (version % 2) as usize;
            if version < last
                || digest != digests[kind]
                || answer.success().map_err(|e| e.to_string())? != expected[kind]
            {
                return Err(format!(
                    "after version {last} an answer of version {version}, {digest}, is not as it should be"
                ));
            }
            (last, seen) = (version, seen + 1);
            answered.fetch_add(1, Ordering::Relaxed);
        }
        Ok(())
    };
    thread::scope(|scope| -> Result {
        let clients = [(); 3].map(|()| scope.spawn(client));
        let swapped = (2..swaps + 2).try_for_each(|version| -> Result {
            let file = &files[(version % 2) as usize];
            folder.publish("swapped", version, file)?;
            if version > 2 {
                fs::remove_dir_all(folder.dir("swapped", &(version - 2).to_string()))?;
            }
            let loaded = service.load("swapped")?.success()?;
            let loaded: Value = serde_json::from_slice(&loaded)?;
            assert_eq!(loaded["versions"][1]["digest"], format!("sha256:{}", sha256(file)));
            // Whoever asks after the answer of `load` gets the new one.
            assert_eq!(service.version("", &[])?, version);
            Ok(())
        });
        over.store(true, Ordering::Relaxed);
        for client in clients {
            client.join().map_err(|_| "a client panicked")??;
        }
        swapped
    })?;
    println!("{swaps} swaps, {} answers", answered.load(Ordering::Relaxed));
    assert_eq!(
        service.get("/v2/models/swapped")?.json()?["versions"],
        json!([swaps.to_string(), (swaps + 1).to_string()])
    );
    let loads = service.metric(r#"realbeam_model_loads_total{model="swapped",outcome="loaded"}"#)?;
    assert_eq!(loads, Some((swaps + 1).to_string()), "the first at the start");
    // Workers of versions that nobody asks any more end.
    #[cfg(target_os = "linux")]
    wait_until("only the workers of two versions are left", || {
        let threads = fs::read_dir("/proc/self/task")?;
        let names = threads.filter_map(|thread| fs::read_to_string(thread.ok()?.path().join("comm")).ok());
        // A thread of ONNX Runtime's own may have taken the name of the one that started it.
        Ok(names.filter(|name| name.trim() == "scan-swapped").count() <= 3)
    })?;
    Ok(())
}

#[test]
fn a_model_that_does_not_pass_is_refused_with_the_reason_and_the_old_one_serves_on() -> Result {
    let folder = Folder::new()?;
    let service = Service::with(&folder.config()?)?;
    let body = bin()?;
    let expected = service.scan("?seed=7", &[], &body)?.success()?;
    let whole = fs::read(data().join(NOISY))?;
    let file = |path: &str| fs::read(data().join(path));
    let refused = [
        (file("hostile/no-such-operator.onnx")?, "Teleport"),
        (file("hostile/moody.onnx")?, "output `keep` is another one the second time, for an empty scan"),
        (file("hostile/hungry.onnx")?, "does not run on an empty scan: ONNX Runtime"),
        (file("misbehaved/nan/1/model.onnx")?, "output `range` is not finite for 5760 of 5760 rays of a full scan"),
        (file("refused/external-data.onnx")?, "weight `elsewhere` is external data"),
        (file("refused/operator-of-the-runtime.onnx")?, "operator `com.microsoft.Gelu` is none of ONNX's own"),
        (file("refused/no-card.onnx")?, "has no card"),
        (file("refused/fifteen-rings.onnx")?, "graph and card disagree"),
        (whole[..whole.len() / 2].to_vec(), "not an ONNX file"),
        (Vec::new(), "not an ONNX file"),
    ];
    for (number, (bytes, words)) in refused.iter().enumerate() {
        let path = folder.publish("street", 2, bytes)?;
        let answer = service.load("street")?;
        let error = answer.error()?;
        assert_eq!((answer.status, error.code), (422, ErrorCode::ModelRefused), "{words}: {}", error.error);
        let place = format!("model {}: refused by its check: ", path.display());
        assert!(error.error.starts_with(&place) && error.error.contains(words), "`{}` has no `{words}`", error.error);
        let answer = service.scan("?seed=7", &[], &body)?;
        assert_eq!(answer.header("x-realbeam-model-version"), "1");
        assert!(answer.success()? == expected);
        let index = service.index("")?;
        assert_eq!((&index[0]["state"], &index[1]["state"]), (&"READY".into(), &"UNAVAILABLE".into()));
        assert!(index[1]["reason"].as_str().is_some_and(|reason| reason.contains(words)), "{index}");
        let count = service.metric(r#"realbeam_model_loads_total{model="street",outcome="refused"}"#)?;
        assert_eq!(count, Some((number + 1).to_string()));
        fs::remove_dir_all(folder.dir("street", "2"))?;
    }
    // What is too large is not even read for the check: no file of this length fits into memory.
    let path = folder.publish("street", 2, &[])?;
    fs::File::create(&path)?.set_len(1 << 36)?;
    let error = service.load("street")?.error()?.error;
    let words = "has 68719476736 bytes, expected at most 1073741824 (max_model_bytes)";
    assert_eq!(error, format!("model {}: {words}", path.display()));
    assert!(service.scan("?seed=7", &[], &body)?.success()? == expected);
    fs::remove_dir_all(folder.dir("street", "2"))?;
    // The same file without what was wrong with it.
    folder.publish("street", 2, &whole)?;
    service.load("street")?.success()?;
    assert_eq!(service.version("", &[])?, 2);
    let digest = sha256(&whole);
    let series = format!(r#"realbeam_model_info{{model="street",version="2",digest="sha256:{digest}"}}"#);
    assert_eq!(service.metric(&series)?.as_deref(), Some("1"));
    // A file that changes in its place is another model.
    fs::write(folder.dir("street", "2").join("model.onnx"), file(PLAIN)?)?;
    service.load("street")?.success()?;
    assert!(service.scan("?seed=7", &[], &body)?.success()? == expected);
    Ok(())
}

#[test]
fn a_check_that_crashes_or_does_not_end_is_survived() -> Result {
    let folder = Folder::new()?;
    // In the place of the real check one that does as it is told.
    let program = folder.0.path().join("check.sh");
    fs::write(
        &program,
        "#!/bin/sh\ncase \"$(cat \"$0.order\")\" in\ncrash) kill -SEGV $$ ;;\nhang) touch \"$0.hangs\"; exec sleep 1000 ;;\nesac\n",
    )?;
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755))?;
    let order = |order: &str| fs::write(folder.0.path().join("check.sh.order"), order);
    order("pass")?;
    let mut config = folder.config()?;
    (config.check.program, config.check.time) = (Some(program), Duration::from_secs(5));
    let service = Service::with(&config)?;
    folder.publish("street", 2, &fs::read(data().join(NOISY))?)?;
    for (told, words) in [("crash", "crashed its check (signal: 11"), ("hang", "its check was not done within 5 s")] {
        order(told)?;
        let error = service.load("street")?.error()?;
        assert!(error.error.contains(words), "`{}` has no `{words}`", error.error);
        assert_eq!(service.version("", &[])?, 1);
    }
    // A service that stops waits for no check.
    fs::remove_file(folder.0.path().join("check.sh.hangs"))?;
    config.check.time = Duration::from_hours(1);
    order("pass")?;
    folder.publish("other", 1, &fs::read(data().join(PLAIN))?)?;
    let service = Service::with(&config)?;
    fs::remove_dir_all(folder.dir("other", "1"))?;
    folder.publish("other", 1, &fs::read(data().join(NOISY))?)?;
    order("hang")?;
    let url = format!("http://{}/v2/repository/models/other/load", service.server.admin_addr().ok_or("no address")?);
    thread::scope(|scope| -> Result {
        let loading = scope.spawn(|| -> std::result::Result<String, ureq::Error> {
            let agent = ureq::Agent::config_builder().http_status_as_error(false).build().new_agent();
            agent
                .post(url)
                .header("authorization", BEARER.unwrap_or_default())
                .send_empty()?
                .body_mut()
                .read_to_string()
        });
        wait_until("the check has begun", || Ok(folder.0.path().join("check.sh.hangs").exists()))?;
        service.server.stop()?;
        let said = loading.join().map_err(|_| "the client panicked")??;
        assert!(said.contains("its check was given up, for the service is stopping"), "{said}");
        Ok(())
    })
}

#[test]
fn an_unloaded_model_is_404_until_it_is_loaded_again() -> Result {
    let folder = Folder::new()?;
    folder.publish("other", 7, &fs::read(data().join(NOISY))?)?;
    let service = Service::with(&folder.config()?)?;
    let ready = |name: &str, version: &str| json!({ "name": name, "version": version, "state": "READY", "reason": "" });
    assert_eq!(service.index("")?, json!([ready("other", "7"), ready("street", "1")]));
    assert_eq!(service.version("?model=other", &[])?, 7);

    service.unload("other")?.success()?;
    for answer in
        [service.scan("?model=other", &[], &[])?, service.get("/v2/models/other/ready")?, service.unload("other")?]
    {
        assert_eq!((answer.status, answer.error()?.code), (404, ErrorCode::ModelNotFound));
    }
    let unloaded = json!({ "name": "other", "version": "7", "state": "UNAVAILABLE", "reason": "unloaded" });
    assert_eq!(service.index("{}")?, json!([unloaded, ready("street", "1")]));
    assert_eq!(service.index(r#"{"ready":true}"#)?, json!([ready("street", "1")]));
    service.version("", &[])?;

    service.load("other")?.success()?;
    assert_eq!(service.version("?model=other", &[])?, 7);
    // Not even the default model is sacred; without it, whoever names none gets none.
    service.unload("street")?.success()?;
    assert_eq!(service.scan("", &[], &[])?.status, 404);
    assert_eq!(service.version("?model=other", &[])?, 7);
    assert_eq!(service.load("no-such")?.error()?.code, ErrorCode::ModelNotFound);
    assert_eq!(service.load("..%2Fstreet")?.error()?.code, ErrorCode::ModelNotFound);
    let with_file = r#"{"parameters":{"config":"{}","file:1/model.onnx":"AAAA"}}"#;
    let answer = service.admin("/v2/repository/models/other/load", BEARER, with_file)?;
    assert_eq!(answer.error()?.code, ErrorCode::BadBody, "files come from the folder alone");
    let long = format!(r#"{{"parameters":{{"x":"{}"}}}}"#, "x".repeat(10_000));
    assert_eq!(service.admin("/v2/repository/index", BEARER, &long)?.error()?.code, ErrorCode::BadBody);
    Ok(())
}

#[test]
fn the_admin_listener_lets_nobody_through_without_the_token_and_stands_alone() -> Result {
    let folder = Folder::new()?;
    let mut config = folder.config()?;
    let service = Service::with(&config)?;
    for authorization in
        [None, Some(""), Some("Bearer"), Some("Bearer 0123456789abcdee"), Some("Basic 0123456789abcdef"), Some(TOKEN)]
    {
        for path in ["/v2/repository/index", "/v2/repository/models/street/unload", "/no/such"] {
            let answer = service.admin(path, authorization, "")?;
            assert_eq!(
                (answer.status, answer.error()?.code),
                (401, ErrorCode::Unauthorized),
                "{authorization:?} {path}"
            );
            assert_eq!(answer.header("www-authenticate"), "Bearer");
        }
    }
    assert_eq!(service.version("", &[])?, 1, "nothing was unloaded");
    assert_eq!(service.admin("/v1/scan", BEARER, "")?.error()?.code, ErrorCode::RouteNotFound);
    for path in ["/v2/repository/index", "/v2/repository/models/street/load", "/v2/repository/models/street/unload"] {
        let answer = service.post(path, &[("authorization", "Bearer 0123456789abcdef")], &[])?;
        assert_eq!((answer.status, answer.error()?.code), (404, ErrorCode::RouteNotFound), "{path}");
    }
    config.admin = None;
    assert_eq!(Service::with(&config)?.server.admin_addr(), None);
    config.admin = Some(AdminOptions { addr: "0.0.0.0:0".parse()?, token: Token::new(TOKEN)? });
    let error = Service::with(&config).err().map(|error| error.to_string());
    assert_eq!(error.as_deref(), Some("the admin listener's address 0.0.0.0:0 is not a loopback address"));
    Ok(())
}

#[test]
fn polling_takes_what_is_published_and_nothing_that_is_only_half_there() -> Result {
    let folder = Folder::new()?;
    let mut config = folder.config()?;
    config.poll = Some(Duration::from_millis(20));
    let service = Service::with(&config)?;
    let noisy = fs::read(data().join(NOISY))?;
    for half in [".2", "2.part", "new", "02", "+2"] {
        fs::create_dir_all(folder.dir("street", half))?;
        fs::write(folder.dir("street", half).join("model.onnx"), &noisy)?;
    }
    fs::create_dir_all(folder.dir("street", "3"))?;
    fs::create_dir_all(folder.dir(".hidden", "1"))?;
    fs::write(folder.dir(".hidden", "1").join("model.onnx"), &noisy)?;
    // What has come after all of these has been seen, so they have been seen too.
    folder.publish("other", 1, &noisy)?;
    wait_until("`other` is served", || Ok(service.get("/v2/models/other")?.status == 200))?;
    assert_eq!(service.get("/v2/models/street")?.json()?["versions"], json!(["1"]));
    let names: Vec<Value> = service.index("")?.as_array().into_iter().flatten().map(|e| e["name"].clone()).collect();
    assert_eq!(names, ["other", "street"]);

    fs::rename(folder.dir("street", ".2"), folder.dir("street", "2"))?;
    wait_until("version 2 is served", || Ok(service.version("", &[])? == 2))?;
    // What is refused is tried once, and does not come between others.
    folder.publish("street", 4, b"no model")?;
    let refused = || service.metric(r#"realbeam_model_loads_total{model="street",outcome="refused"}"#);
    wait_until("version 4 is refused", || Ok(refused()?.is_some()))?;
    fs::remove_dir_all(folder.dir("other", "1"))?;
    wait_until("`other` is gone", || Ok(service.scan("?model=other", &[], &[])?.status == 404))?;
    assert_eq!((refused()?.as_deref(), service.version("", &[])?), (Some("1"), 2));
    fs::remove_dir_all(folder.dir("street", "4"))?;
    folder.publish("street", 5, &noisy)?;
    wait_until("version 5 is served", || Ok(service.version("", &[])? == 5))
}

#[test]
fn a_canary_gets_its_share_of_the_streams_and_always_the_same_ones() -> Result {
    let mut config = config()?;
    config.canaries = vec!["passthrough=2:0.25".parse()?];
    let service = Service::with(&config)?;
    let streams: Vec<String> = (0..400).map(|i| format!("ego-{i}")).collect();
    let version = |header: &'static str, id: &str| service.version("", &[(header, id)]);
    let mut canaries = Vec::new();
    for stream in &streams {
        let got = version("x-stream-id", stream)?;
        assert_eq!(version("x-stream-id", stream)?, got);
        assert_eq!(version("x-request-id", stream)?, got, "whoever has no stream goes by the request's id");
        canaries.extend((got == 2).then_some(stream));
    }
    // Five standard deviations of √(400 · 0.25 · 0.75) = 8.7.
    assert!(canaries.len().abs_diff(100) < 44, "{} of 400", canaries.len());
    // Requests without any id have one of their own each: that 200 fall on one side has a probability of 10⁻²⁵.
    let versions = (0..200).map(|_| service.version("", &[])).collect::<Result<Vec<_>>>()?;
    assert!(versions.contains(&1) && versions.contains(&2));

    // A canary is for those who name no version, on every route.
    let stream = [("x-stream-id", canaries[0].as_str()), ("inference-header-content-length", "0")];
    assert_eq!((service.version("?version=1", &stream)?, service.version("?version=latest", &stream)?), (1, 2));
    for (path, expected) in [("scan", r#""model_version":"2""#), ("scan/versions/1", r#""model_version":"1""#)] {
        let answer = service.post(&format!("/v2/models/{path}/infer"), &stream, &[])?.success()?;
        assert!(String::from_utf8_lossy(&answer).contains(expected), "{path}");
    }
    assert_eq!(service.get("/info")?.json()?["models"][2]["version"], 1, "what most get");
    config.canaries.push("passthrough=1:0.1".parse()?);
    let error = Service::with(&config).err().map(|error| error.to_string());
    assert_eq!(error.as_deref(), Some("model `passthrough` has two canaries"));
    Ok(())
}
