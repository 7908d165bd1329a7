//! A service on the tests' models, a client for it, and scans to send.

use std::net::TcpStream;
use std::path::PathBuf;
use std::process::Command;
use std::thread;
use std::time::{Duration, Instant};

use lidar::PointCloud;
use lidar::cloud::{Column, Values};
use lidar::formats::{self, Format};
use proto::ErrorBody;
use server::{Config, RequestLimits, Server, WorkerOptions, serve};
use ureq::http::HeaderMap;

pub(crate) type Result<T = ()> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Rings and columns of the models called `passthrough`.
pub(crate) const RINGS: usize = 16;
pub(crate) const COLUMNS: usize = 360;

/// The folder of the tests' data.
pub(crate) fn data() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data")
}

/// A running service.
pub(crate) struct Service {
    pub(crate) server: Server,
    agent: ureq::Agent,
}

/// An answer, whatever its status.
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) headers: HeaderMap,
    pub(crate) body: Vec<u8>,
}

pub(crate) fn config() -> Result<Config> {
    Ok(Config {
        models: data().join("models"),
        default_model: "passthrough".into(),
        addr: "127.0.0.1:0".parse()?,
        workers: WorkerOptions { workers: 1, threads: 1.into(), batch: 1, queue: 64 },
        requests: RequestLimits {
            max_body_bytes: 8 << 20,
            max_points: 100_000,
            max_unpacked_bytes: 12 << 20,
            ..RequestLimits::default()
        },
        ..Config::default()
    })
}

impl Service {
    pub(crate) fn start() -> Result<Self> {
        Self::with(&config()?)
    }

    pub(crate) fn with(config: &Config) -> Result<Self> {
        let server = serve(config)?;
        let agent =
            ureq::Agent::config_builder().http_status_as_error(false).timeout_global(Some(Duration::from_mins(1)));
        Ok(Self { server, agent: ureq::Agent::new_with_config(agent.build()) })
    }

    /// A service on models that no check would let in.
    pub(crate) fn misbehaved() -> Result<Self> {
        let models = data().join("misbehaved");
        Self::with(&Config { models, default_model: "unruly".into(), ..config()? })
    }

    pub(crate) fn url(&self, path: &str) -> String {
        format!("http://{}{path}", self.server.addr())
    }

    /// A connection of its own.
    pub(crate) fn connect(&self) -> Result<TcpStream> {
        Ok(TcpStream::connect(self.server.addr().tcp().ok_or("no TCP address")?)?)
    }

    /// Posts a scan: `query` with its question mark, headers as (name, value).
    pub(crate) fn scan(&self, query: &str, headers: &[(&str, &str)], body: &[u8]) -> Result<Answer> {
        self.post(&format!("/v1/scan{query}"), headers, body)
    }

    pub(crate) fn post(&self, path: &str, headers: &[(&str, &str)], body: &[u8]) -> Result<Answer> {
        let mut request = self.agent.post(self.url(path));
        if !headers.iter().any(|(name, _)| name.eq_ignore_ascii_case("content-type")) {
            request = request.content_type("application/octet-stream");
        }
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        Answer::read(request.send(body)?)
    }

    /// Posts to the admin listener.
    pub(crate) fn admin(&self, path: &str, authorization: Option<&str>, body: &str) -> Result<Answer> {
        let addr = self.server.admin_addr().ok_or("no admin listener")?;
        let mut request = self.agent.post(format!("http://{addr}{path}")).content_type("application/json");
        if let Some(authorization) = authorization {
            request = request.header("authorization", authorization);
        }
        Answer::read(request.send(body)?)
    }

    pub(crate) fn get(&self, path: &str) -> Result<Answer> {
        Answer::read(self.agent.get(self.url(path)).call()?)
    }
}

impl Answer {
    fn read(response: ureq::http::Response<ureq::Body>) -> Result<Self> {
        let (head, mut body) = response.into_parts();
        let body = body.with_config().limit(1 << 30).read_to_vec()?;
        Ok(Self { status: head.status.as_u16(), headers: head.headers, body })
    }

    /// A header; empty where there is none.
    pub(crate) fn header(&self, name: &str) -> &str {
        self.headers.get(name).and_then(|value| value.to_str().ok()).unwrap_or_default()
    }

    pub(crate) fn number(&self, name: &str) -> Result<u64> {
        self.header(name).parse().map_err(|error| format!("header {name}: `{}`: {error}", self.header(name)).into())
    }

    pub(crate) fn json(&self) -> Result<serde_json::Value> {
        Ok(serde_json::from_slice(&self.body)?)
    }

    /// The body of an answer that is a success.
    pub(crate) fn success(self) -> Result<Vec<u8>> {
        match self.status {
            200 => Ok(self.body),
            status => Err(format!("{status}: {}", String::from_utf8_lossy(&self.body)).into()),
        }
    }

    /// The error of an answer that is none.
    pub(crate) fn error(&self) -> Result<ErrorBody> {
        let error: ErrorBody = serde_json::from_slice(&self.body)?;
        assert_eq!(self.status, error.code.status());
        assert_eq!(self.header("content-type"), "application/json");
        assert_eq!(self.header("x-request-id"), error.request_id);
        assert!(!error.request_id.is_empty());
        Ok(error)
    }
}

/// The Python that has these modules; none only outside CI, and then it says that a test is skipped.
pub(crate) fn python(modules: &str) -> Option<String> {
    let python = std::env::var("REALBEAM_PYTHON").unwrap_or_else(|_| "python3".into());
    let imported = Command::new(&python).args(["-c", &format!("import {modules}")]).output();
    if imported.as_ref().is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    assert!(std::env::var("CI").as_deref() != Ok("true"), "{python} cannot import {modules}: {imported:?}");
    eprintln!("skipped: {python} cannot import {modules}; set REALBEAM_PYTHON, or see scripts/python-env.sh");
    None
}

/// Waits until something is so, for as long as a busy machine may need.
pub(crate) fn wait_until(what: &str, mut is_so: impl FnMut() -> Result<bool>) -> Result {
    let until = Instant::now() + Duration::from_mins(2);
    while !is_so()? {
        if Instant::now() > until {
            return Err(format!("waited in vain until {what}").into());
        }
        thread::sleep(Duration::from_millis(10));
    }
    Ok(())
}

/// A scan with a point in the middle of each of the sensor's pixels, in no particular order, with every kind of field.
pub(crate) fn scan() -> PointCloud {
    let mut cloud = PointCloud::new(1.0);
    let (mut ring, mut label, mut time_s, mut echo) = (vec![], vec![], vec![], vec![]);
    for column in 0..COLUMNS {
        for row in 0..RINGS {
            let elevation = (15.0 - 2.0 * row as f32).to_radians();
            let azimuth = std::f32::consts::PI - (column as f32 + 0.5).to_radians();
            let range_m = 5.0 + ((row * 37 + column * 11) % 400) as f32 * 0.1;
            cloud.x.push(range_m * elevation.cos() * azimuth.cos());
            cloud.y.push(range_m * elevation.cos() * azimuth.sin());
            cloud.z.push(range_m * elevation.sin());
            cloud.intensity.push(((row + column) % 100) as f32 / 100.0);
            ring.push(row as u16);
            label.push(if column % 3 == 0 { ((column as u32) << 16) + 10 } else { 0 });
            time_s.push(column as f64 / 3600.0);
            echo.push((row * column) as u16);
        }
    }
    (cloud.ring, cloud.label, cloud.time_s) = (Some(ring), Some(label), Some(time_s));
    cloud.extra = vec![Column { name: "echo".into(), values: Values::U16(echo) }];
    cloud
}

/// The scan as `float32 x, y, z, intensity`.
pub(crate) fn bin() -> Result<Vec<u8>> {
    Ok(formats::encode(Format::Kitti, &scan())?)
}
