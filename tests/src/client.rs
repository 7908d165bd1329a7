//! What a client of the service sends and gets.

use anyhow::{Context, Result, ensure};
use lidar::PointCloud;
use lidar::formats::{self, Format, Limits};
use proto::MediaType;
use serde_json::Value;

/// Largest answer that the client takes.
const MAX_ANSWER_BYTES: u64 = 256 << 20;

/// A client of one server.
#[derive(Clone, Debug)]
pub struct Client {
    agent: ureq::Agent,
    address: String,
}

/// An answer of any status.
#[derive(Clone, Debug)]
pub struct Answer {
    /// HTTP status.
    pub status: u16,
    /// Headers, names in lower case.
    pub headers: Vec<(String, String)>,
    /// The body.
    pub body: Vec<u8>,
}

impl Client {
    /// A client of the server at an address such as `http://127.0.0.1:8080`.
    pub fn new(address: &str) -> Self {
        let agent = ureq::Agent::config_builder().http_status_as_error(false).build().into();
        Self { agent, address: address.trim_end_matches('/').into() }
    }

    /// `GET` of a path.
    pub fn get(&self, path: &str) -> Result<Answer> {
        Answer::read(self.agent.get(format!("{}{path}", self.address)).call()?)
    }

    /// `POST /v1/scan` with a query such as `?seed=1`.
    pub fn scan(&self, query: &str, headers: &[(&str, &str)], body: &[u8]) -> Result<Answer> {
        let mut request = self.agent.post(format!("{}/v1/scan{query}", self.address));
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        Answer::read(request.send(body)?)
    }

    /// Sends a cloud in a format and gets one back in the same.
    pub fn convert(&self, query: &str, format: Format, cloud: &PointCloud) -> Result<(Answer, PointCloud)> {
        let media = MediaType::of_format(format).name;
        let answer = self.scan(query, &[("content-type", media)], &formats::encode(format, cloud)?)?;
        ensure!(answer.status == 200, "{} {}", answer.status, answer.text());
        let cloud = formats::decode(format, &answer.body, &Limits::default())?;
        Ok((answer, cloud))
    }
}

impl Answer {
    fn read(mut response: ureq::http::Response<ureq::Body>) -> Result<Self> {
        let headers = response
            .headers()
            .iter()
            .map(|(name, value)| (name.as_str().to_owned(), String::from_utf8_lossy(value.as_bytes()).into_owned()))
            .collect();
        let status = response.status().as_u16();
        let body = response.body_mut().with_config().limit(MAX_ANSWER_BYTES).read_to_vec()?;
        Ok(Self { status, headers, body })
    }

    /// A header's value.
    pub fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(n, _)| n == name).map(|(_, value)| value.as_str())
    }

    /// A header that counts something.
    pub fn count(&self, name: &str) -> Result<usize> {
        let value = self.header(name).with_context(|| format!("no header {name}"))?;
        value.parse().with_context(|| format!("header {name} is `{value}`"))
    }

    /// The body as text.
    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    /// The body as JSON.
    pub fn json(&self) -> Result<Value> {
        serde_json::from_slice(&self.body).with_context(|| format!("no JSON: {}", self.text()))
    }
}
