//! The figures for Prometheus.

use lidar::formats::{self, Format};

use crate::support::{Result, Service, bin, config, scan};

/// The value of a line of the metrics.
fn value(text: &str, series: &str) -> Result<f64> {
    let line = text.lines().find_map(|line| line.strip_prefix(series)?.strip_prefix(' '));
    Ok(line.ok_or_else(|| format!("no `{series}` in\n{text}"))?.parse()?)
}

#[test]
fn what_was_asked_and_answered_is_counted() -> Result {
    let mut config = config()?;
    config.requests.max_points = 6000;
    let service = Service::with(&config)?;
    let mut cloud = scan();
    (cloud.x[0], cloud.y[1]) = (f32::NAN, f32::INFINITY);
    let answer = service.scan("", &[], &formats::encode(Format::Kitti, &cloud)?)?;
    let kept = answer.number("x-realbeam-points-kept")?;
    assert_eq!(answer.status, 200);
    assert_eq!(service.scan("", &[], &vec![1; 16 * 6001])?.status, 413);
    assert_eq!(service.scan("?sed=1", &[], &bin()?)?.status, 400);
    for path in ["/no/such/route", "/another", "/v2/models/no-such", "/v2/health/ready"] {
        service.get(path)?;
    }

    let answer = service.get("/metrics")?;
    assert!(answer.header("content-type").starts_with("application/openmetrics-text; version=1.0.0"));
    let text = String::from_utf8(answer.success()?)?;
    assert!(text.ends_with("# EOF\n"));
    let info = service.get("/info")?.json()?;
    let digest = info["models"][2]["digest"].as_str().unwrap_or_default();
    for (series, expected) in [
        (r#"realbeam_requests_total{route="/v1/scan",code="200"}"#, 1.0),
        (r#"realbeam_requests_total{route="/v1/scan",code="413"}"#, 1.0),
        (r#"realbeam_requests_total{route="none",code="404"}"#, 2.0),
        (r#"realbeam_requests_total{route="/v2/models/{model}",code="404"}"#, 1.0),
        (r#"realbeam_request_duration_seconds_count{route="/v1/scan"}"#, 3.0),
        (r#"realbeam_stage_duration_seconds_count{stage="infer"}"#, 1.0),
        (r#"realbeam_rejected_total{reason="too_many_points"}"#, 1.0),
        (r#"realbeam_points_total{dir="in"}"#, 5760.0),
        (r#"realbeam_points_total{dir="out"}"#, kept as f64),
        ("realbeam_nonfinite_points_total", 2.0),
        ("realbeam_connections", 1.0),
        ("realbeam_inflight_bytes", 0.0),
        (r#"realbeam_queue_depth{name="passthrough",version="2"}"#, 0.0),
        (&format!(r#"realbeam_model_info{{model="passthrough",version="2",digest="{digest}"}}"#), 1.0),
        (r#"realbeam_model_loads_total{model="passthrough",outcome="loaded"}"#, 1.0),
    ] {
        assert_eq!(value(&text, series)?, expected, "{series}");
    }
    let seconds = value(&text, r#"realbeam_request_duration_seconds_sum{route="/v1/scan"}"#)?;
    assert!((1e-4..60.0).contains(&seconds), "{seconds}");
    Ok(())
}
