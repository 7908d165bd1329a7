//! Clients that ask for everything: scans in every format, views, tensors, what is there to read, what is wrong; some hang up.

use std::collections::BTreeMap;
use std::io::Write;
use std::net::TcpStream;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use lidar::formats::{self, Format};
use lidar::{PointCloud, Sensor};
use proto::MediaType;

use crate::Result;
use crate::street::street;

/// Clients at a time: one more than are served and may wait, so that some are turned away.
const CLIENTS: usize = 4;

/// Points of a scan, few so that many are asked for.
const POINTS: usize = 4000;

/// Pause of whoever is turned away, so that most requests are answered.
const PAUSE: Duration = Duration::from_millis(20);

/// Longest time in which silence is waited for.
const PATIENCE: Duration = Duration::from_mins(2);

/// Something to ask.
struct Question {
    what: String,
    kind: Kind,
}

enum Kind {
    /// A path, and its status.
    Get(String, u16),
    /// A path, headers, a body, and the status of its answer; it may also be 429, for there may be too many.
    Post(String, Vec<(&'static str, String)>, Vec<u8>, u16),
    /// Bytes, after which the client is gone.
    HangUp(Vec<u8>),
}

/// The clients, and what they were told.
pub(crate) struct Crowd {
    addr: String,
    questions: Vec<Question>,
    next: AtomicUsize,
    answers: Mutex<BTreeMap<(String, u16), usize>>,
    unexpected: Mutex<Vec<String>>,
}

impl Crowd {
    pub(crate) fn new(addr: &str, model: &str) -> Result<Self> {
        let questions = questions(model)?;
        Ok(Self {
            addr: addr.into(),
            questions,
            next: AtomicUsize::default(),
            answers: Mutex::default(),
            unexpected: Mutex::default(),
        })
    }

    /// Asks for so long; the number of requests.
    pub(crate) fn ask_for(&self, time: Duration) -> usize {
        let (started, asked) = (Instant::now(), AtomicUsize::new(0));
        let client = || {
            let agent = agent();
            while started.elapsed() < time {
                let question = &self.questions[self.next.fetch_add(1, Ordering::Relaxed) % self.questions.len()];
                let told = question.ask(&agent, &self.addr).map_err(|error| error.to_string());
                asked.fetch_add(1, Ordering::Relaxed);
                if told == Ok(429) {
                    std::thread::sleep(PAUSE);
                }
                self.book(question, told);
            }
        };
        std::thread::scope(|scope| (0..CLIENTS).for_each(|_| drop(scope.spawn(client))));
        asked.into_inner()
    }

    /// Waits until nothing is under way and no connection is open but the one that asks.
    pub(crate) fn wait_for_silence(&self) -> Result {
        let (agent, until) = (agent(), Instant::now() + PATIENCE);
        let silent = ["realbeam_inflight_bytes 0", "realbeam_connections 1"];
        loop {
            let metrics = agent.get(format!("http://{}/metrics", self.addr)).call()?.body_mut().read_to_string()?;
            if silent.iter().all(|line| metrics.lines().any(|found| found == *line)) {
                return Ok(());
            }
            if Instant::now() > until {
                return Err(format!("the service does not fall silent:\n{metrics}").into());
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// What was asked, the status of the answers (0: the client hung up), and how many there were.
    pub(crate) fn answers(&self) -> Result<Vec<(String, u16, usize)>> {
        let answers = self.answers.lock().map_err(|_| "a client panicked")?;
        Ok(answers.iter().map(|((what, status), number)| (what.clone(), *status, *number)).collect())
    }

    /// Answers that were not as they should be.
    pub(crate) fn unexpected(&self) -> Result<Vec<String>> {
        Ok(self.unexpected.lock().map_err(|_| "a client panicked")?.clone())
    }

    fn book(&self, question: &Question, told: std::result::Result<u16, String>) {
        let wrong = match &told {
            Ok(status) if question.may_be(*status) => None,
            Ok(status) => Some(format!("{}: {status}", question.what)),
            Err(error) => Some(format!("{}: {error}", question.what)),
        };
        if let (Ok(status), Ok(mut answers)) = (told, self.answers.lock()) {
            *answers.entry((question.what.clone(), status)).or_default() += 1;
        }
        if let (Some(wrong), Ok(mut unexpected)) = (wrong, self.unexpected.lock()) {
            unexpected.push(wrong);
        }
    }
}

impl Question {
    fn ask(&self, agent: &ureq::Agent, addr: &str) -> Result<u16> {
        let url = |path: &str| format!("http://{addr}{path}");
        let mut answer = match &self.kind {
            Kind::Get(path, _) => agent.get(url(path)).call()?,
            Kind::Post(path, headers, body, _) => {
                let request = agent.post(url(path));
                headers.iter().fold(request, |request, (name, value)| request.header(*name, value)).send(body)?
            }
            Kind::HangUp(bytes) => {
                TcpStream::connect(addr)?.write_all(bytes)?;
                return Ok(0);
            }
        };
        answer.body_mut().with_config().limit(1 << 30).read_to_vec()?;
        Ok(answer.status().as_u16())
    }

    fn may_be(&self, status: u16) -> bool {
        match self.kind {
            Kind::Get(_, expected) => status == expected,
            Kind::Post(_, _, _, expected) => [expected, 429].contains(&status),
            Kind::HangUp(_) => status == 0,
        }
    }
}

fn agent() -> ureq::Agent {
    ureq::Agent::config_builder().http_status_as_error(false).build().into()
}

/// Everything that is asked, in turns.
fn questions(model: &str) -> Result<Vec<Question>> {
    let cloud = street(&Sensor::builtin("hdl64e")?, POINTS);
    let mut questions = scans(&cloud)?;
    let bin = formats::encode(Format::Kitti, &cloud)?;
    let plain = || ("content-type", "application/octet-stream".to_owned());
    let mut ask = |what: &str, kind: Kind| questions.push(Question { what: what.into(), kind });
    for (view, accept) in [
        ("as a picture", "image/png"),
        ("as JSON", "application/json"),
        ("as records", "application/vnd.realbeam.points"),
    ] {
        let headers = vec![plain(), ("accept", accept.into())];
        ask(view, Kind::Post("/v1/scan?seed=1".into(), headers, bin.clone(), 200));
    }
    let raw = vec![("inference-header-content-length", "0".to_owned())];
    ask("raw tensor", Kind::Post("/v2/models/scan/infer".into(), raw, bin.clone(), 200));
    let shape = format!(r#"{{"inputs":[{{"name":"POINTS","shape":[{POINTS},4],"datatype":"FP32","data":"#);
    let numbers: Vec<String> = (0..POINTS * 4).map(|i| format!("{}.5", i % 40)).collect();
    let json = format!("{shape}[{}]}}]}}", numbers.join(","));
    ask("JSON tensor", Kind::Post("/v2/models/scan/infer".into(), Vec::new(), json.into(), 200));
    for path in ["/info", "/metrics", "/docs", "/api-doc/openapi.json", "/", "/v2", "/v2/health/ready"] {
        ask(path, Kind::Get(path.into(), 200));
    }
    for path in ["/sample", "/v2/models/stats"] {
        ask(path, Kind::Get(path.into(), 200));
    }
    ask("metadata", Kind::Get(format!("/v2/models/{model}"), 200));
    ask("no such route", Kind::Get("/no/such".into(), 404));
    let post = |path: &str, headers, body: &[u8], status| Kind::Post(path.into(), headers, body.to_vec(), status);
    ask("no such model", post("/v1/scan?model=no-such", vec![plain()], &bin, 404));
    ask("no such key", post("/v1/scan?sed=1", vec![plain()], &bin, 400));
    ask("no such type", post("/v1/scan", vec![("content-type", "text/plain".into())], &bin, 415));
    ask("too late", post("/v1/scan", vec![plain(), ("x-deadline-ms", "1".into())], &bin, 504));
    let head = format!("POST /v1/scan HTTP/1.1\r\nhost: x\r\ncontent-length: {}\r\n\r\n", bin.len());
    ask("half a head, then gone", Kind::HangUp(head.as_bytes()[..head.len() / 2].into()));
    ask("half a body, then gone", Kind::HangUp([head.as_bytes(), &bin[..bin.len() / 2]].concat()));
    ask("a scan, then gone", Kind::HangUp([head.as_bytes(), &bin].concat()));
    Ok(questions)
}

/// A scan in every format, whole, and cut so that it is none.
fn scans(cloud: &PointCloud) -> Result<Vec<Question>> {
    let mut questions = Vec::new();
    for format in Format::ALL {
        let bytes = formats::encode(format, cloud)?;
        let headers = vec![("content-type", MediaType::of_format(format).name.to_owned())];
        let cut = bytes[..bytes.len() / 2 - 1].to_vec();
        let kind = Kind::Post(format!("/v1/scan?seed={}", questions.len()), headers.clone(), bytes, 200);
        questions.push(Question { what: format.name().into(), kind });
        questions.push(Question {
            what: format!("half of {}", format.name()),
            kind: Kind::Post("/v1/scan".into(), headers, cut, 400),
        });
    }
    Ok(questions)
}
