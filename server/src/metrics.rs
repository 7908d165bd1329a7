//! What is counted and timed, for Prometheus.

use std::collections::BTreeMap;
use std::time::Duration;

use prometheus_client::encoding::text::{encode_eof, encode_registry};
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::{Histogram, exponential_buckets};
use prometheus_client::registry::{Registry, Unit};

use crate::catalogue::Catalogue;
use crate::pipeline::Fit;
use crate::stopwatch::{Stage, StageTimes};

/// Label name and value.
type Label<V> = (&'static str, V);

/// Seconds by the value of one label.
type Seconds<L> = Family<[Label<L>; 1], Histogram, fn() -> Histogram>;

/// Attempts to load a model, by its name and what came of it.
pub(crate) type Loads = Family<[Label<String>; 2], Counter>;

/// Everything that is counted from the start on.
#[derive(Debug)]
pub(crate) struct Metrics {
    registry: Registry,
    requests: Family<[Label<String>; 2], Counter>,
    request_seconds: Seconds<String>,
    stage_seconds: Seconds<&'static str>,
    rejected: Family<[Label<String>; 1], Counter>,
    points: Family<[Label<&'static str>; 1], Counter>,
    nonfinite_points: Counter,
    connections: Gauge,
    refused_connections: Counter,
    loads: Loads,
}

impl Metrics {
    pub(crate) fn new() -> Self {
        let mut registry = prefixed();
        let metrics = Self {
            requests: Family::default(),
            request_seconds: Family::new_with_constructor(histogram),
            stage_seconds: Family::new_with_constructor(histogram),
            rejected: Family::default(),
            points: Family::default(),
            nonfinite_points: Counter::default(),
            connections: Gauge::default(),
            refused_connections: Counter::default(),
            loads: Loads::default(),
            registry: Registry::default(),
        };
        registry.register(
            "requests",
            "Requests answered, by route and status of HTTP or gRPC",
            metrics.requests.clone(),
        );
        let help = "Time from a request's head to its answer's, by route";
        registry.register_with_unit("request_duration", help, Unit::Seconds, metrics.request_seconds.clone());
        let help = "Time of each stage of a scan's way";
        registry.register_with_unit("stage_duration", help, Unit::Seconds, metrics.stage_seconds.clone());
        registry.register("rejected", "Requests turned away, by the error's code", metrics.rejected.clone());
        registry.register("points", "Points of scans, in and out", metrics.points.clone());
        let help = "Points of scans that are NaN or infinite";
        registry.register("nonfinite_points", help, metrics.nonfinite_points.clone());
        registry.register("connections", "Connections open, on all listeners", metrics.connections.clone());
        let help = "Connections closed because there were too many";
        registry.register("refused_connections", help, metrics.refused_connections.clone());
        let help = "Attempts to load a model, by model and outcome";
        registry.register("model_loads", help, metrics.loads.clone());
        Self { registry, ..metrics }
    }

    /// Counts an answer.
    pub(crate) fn answered(&self, route: &str, status: &str, time: Duration) {
        self.requests.get_or_create(&[("route", route.into()), ("code", status.into())]).inc();
        self.request_seconds.get_or_create(&[("route", route.into())]).observe(time.as_secs_f64());
    }

    /// Counts a request that was turned away.
    pub(crate) fn rejected(&self, reason: String) {
        self.rejected.get_or_create(&[("reason", reason)]).inc();
    }

    /// Counts work that got through, a scan's way or a generator's run alone.
    pub(crate) fn worked(&self, times: &StageTimes, fit: Option<&Fit>) {
        for stage in Stage::ALL {
            self.stage_seconds.get_or_create(&[("stage", stage.name())]).observe(times.of(stage).as_secs_f64());
        }
        let Some(fit) = fit else { return };
        let points = |direction, number: usize| {
            self.points.get_or_create(&[("dir", direction)]).inc_by(number as u64);
        };
        points("in", fit.report.points_in);
        points("out", fit.kept + fit.added);
        self.nonfinite_points.inc_by(fit.report.non_finite as u64);
    }

    /// The number of connections that are open.
    pub(crate) fn connections(&self) -> Gauge {
        self.connections.clone()
    }

    /// The count of connections that were not let in.
    pub(crate) fn refused_connections(&self) -> Counter {
        self.refused_connections.clone()
    }

    /// The count of loaded models.
    pub(crate) fn loads(&self) -> Loads {
        self.loads.clone()
    }

    /// All figures in the text format of `OpenMetrics`, with those that are what they are now: bytes under way, the queues, the models.
    pub(crate) fn text(&self, catalogue: &Catalogue, inflight_bytes: usize) -> String {
        let mut now = prefixed();
        let inflight: Gauge = Gauge::default();
        inflight.set(inflight_bytes as i64);
        now.register("inflight_bytes", "Bytes of bodies and answers under way", inflight);
        let depth: Family<[Label<String>; 2], Gauge> = Family::default();
        let model: Family<[Label<String>; 3], Gauge> = Family::default();
        for offer in catalogue.models().values().flat_map(BTreeMap::values) {
            let (name, version) = (offer.model.name.clone(), offer.version.to_string());
            if let Some(waiting) = offer.waiting() {
                depth.get_or_create(&[("name", name.clone()), ("version", version.clone())]).set(waiting as i64);
            }
            let labels = [("model", name), ("version", version), ("digest", format!("sha256:{}", offer.model.digest))];
            model.get_or_create(&labels).set(1);
        }
        now.register("queue_depth", "Scans that wait for a worker, by model", depth);
        now.register("model_info", "Models on offer; always 1", model);
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = encode_registry(&mut text, &self.registry);
        let _ = encode_registry(&mut text, &now);
        let _ = encode_eof(&mut text);
        text
    }
}

fn prefixed() -> Registry {
    Registry::with_prefix("realbeam")
}

/// Half a millisecond to 16 seconds.
fn histogram() -> Histogram {
    Histogram::new(exponential_buckets(0.0005, 2.0, 16))
}
