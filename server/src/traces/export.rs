//! Spans on their way to a collector: OTLP over HTTP, in batches, on a thread of their own.

use std::collections::HashMap;
use std::time::SystemTime;

use axum::http::HeaderValue;
use opentelemetry::propagation::TextMapPropagator;
use opentelemetry::trace::{Span, SpanKind, Status, TraceContextExt, Tracer, TracerProvider};
use opentelemetry::{Context, KeyValue};
use opentelemetry_otlp::{SpanExporter, WithExportConfig};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::propagation::TraceContextPropagator;
use opentelemetry_sdk::trace::{SdkTracer, SdkTracerProvider};

use super::{Answered, TracesError};
use crate::stopwatch::Stage;

/// Spans for one collector. The variables `OTEL_TRACES_SAMPLER`, `OTEL_BSP_…` and `OTEL_RESOURCE_ATTRIBUTES` hold as everywhere.
#[derive(Debug)]
pub(super) struct Export {
    provider: SdkTracerProvider,
    tracer: SdkTracer,
}

impl Export {
    pub(super) fn new(url: &str) -> Result<Self, TracesError> {
        let exporter = SpanExporter::builder().with_http().with_endpoint(url).build();
        let exporter =
            exporter.map_err(|error| TracesError::Exporter { url: url.into(), reason: error.to_string() })?;
        let resource = Resource::builder().with_service_name("realbeam").build();
        let provider = SdkTracerProvider::builder().with_batch_exporter(exporter).with_resource(resource).build();
        let tracer = provider.tracer("realbeam-server");
        Ok(Self { provider, tracer })
    }

    pub(super) fn add(&self, answered: &Answered<'_>) {
        let ended = SystemTime::now();
        let status = if answered.is_grpc { "rpc.grpc.status_code" } else { "http.response.status_code" };
        let span = self.tracer.span_builder(format!("{} {}", answered.method, answered.route));
        let span = span.with_kind(SpanKind::Server).with_start_time(ended - answered.time).with_attributes([
            KeyValue::new("http.request.method", answered.method.to_owned()),
            KeyValue::new("http.route", answered.route.to_owned()),
            KeyValue::new(status, answered.status.parse::<i64>().unwrap_or_default()),
            KeyValue::new("realbeam.request_id", answered.request_id.to_owned()),
        ]);
        let mut span = self.tracer.build_with_context(span, &parent(answered.parent));
        if answered.has_failed {
            span.set_status(Status::error(""));
        }
        let within = Context::new().with_remote_span_context(span.span_context().clone());
        // The last stage ends with the answer; each begins where the one before it ends.
        let stages = answered.stages.into_iter();
        let stages = stages.flat_map(|times| Stage::ALL.into_iter().rev().map(|stage| (stage, times.of(stage))));
        let mut until = ended;
        for (stage, time) in stages.filter(|(_, time)| !time.is_zero()) {
            let span = self.tracer.span_builder(stage.name()).with_start_time(until - time);
            self.tracer.build_with_context(span, &within).end_with_timestamp(until);
            until -= time;
        }
        span.end_with_timestamp(ended);
    }

    pub(super) fn end(&self) {
        if let Err(error) = self.provider.shutdown() {
            tracing::warn!("the last traces were not sent: {error}");
        }
    }
}

/// The client's span, if it names one.
fn parent(traceparent: Option<&HeaderValue>) -> Context {
    let header = traceparent.and_then(|value| value.to_str().ok()).map(|value| ("traceparent".into(), value.into()));
    TraceContextPropagator::new().extract_with_context(&Context::new(), &header.into_iter().collect::<HashMap<_, _>>())
}
