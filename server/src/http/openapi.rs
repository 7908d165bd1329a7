//! `GET /api-doc/openapi.json`: every route of the public listener, as `OpenAPI` 3.1.

#![allow(clippy::needless_pass_by_value, reason = "parts of the document are made to be given away")]

use std::collections::BTreeMap;
use std::sync::LazyLock;

use axum::Json;
use proto::ErrorCode;
use proto::media::{MEDIA_TYPES, VIEW_TYPES};
use serde_json::{Map, Value, json};

/// The document.
pub(super) async fn openapi() -> Json<&'static Value> {
    Json(&DOCUMENT)
}

/// The document, made once.
pub(super) static DOCUMENT: LazyLock<Value> = LazyLock::new(document);

/// What any request may meet.
const ANY: [ErrorCode; 3] = [ErrorCode::Unauthorized, ErrorCode::Internal, ErrorCode::TooManyConnections];

/// What whoever names a model may meet.
const NAMED: [ErrorCode; 3] = [ErrorCode::BadQuery, ErrorCode::ModelNotFound, ErrorCode::ModelFailed];

/// What a scan or tensors to work on may meet besides.
const WORK: [ErrorCode; 11] = [
    ErrorCode::BadHeader,
    ErrorCode::BadBody,
    ErrorCode::BodyTooSlow,
    ErrorCode::Superseded,
    ErrorCode::BodyTooLarge,
    ErrorCode::TooManyPoints,
    ErrorCode::UnusableScan,
    ErrorCode::Overloaded,
    ErrorCode::TooManyBytes,
    ErrorCode::NotReady,
    ErrorCode::DeadlineExceeded,
];

/// What scans alone may meet.
const SCAN: [ErrorCode; 5] = [
    ErrorCode::MalformedScan,
    ErrorCode::NotAcceptable,
    ErrorCode::UnsupportedMediaType,
    ErrorCode::UnsupportedEncoding,
    ErrorCode::UnencodableAnswer,
];

/// What tensors alone may meet.
const TENSORS: [ErrorCode; 4] =
    [ErrorCode::MalformedTensors, ErrorCode::UnusableTensors, ErrorCode::UnsupportedEncoding, ErrorCode::MalformedScan];

fn document() -> Value {
    let mut paths = Map::new();
    paths.insert("/v1/scan".into(), json!({ "post": scan() }));
    let get =
        |summary: &str, content: Value, codes: &[&[ErrorCode]]| json!({ "get": operation(summary, content, codes) });
    let object = || json!({ "application/json": { "schema": { "type": "object" } } });
    let text = |kind: &str| json!({ kind: { "schema": { "type": "string" } } });
    paths.insert(
        "/info".into(),
        get("What the service takes and offers: limits, media types, models with their cards.", object(), &[]),
    );
    paths.insert(
        "/metrics".into(),
        get("Counters and histograms for Prometheus.", text("application/openmetrics-text"), &[]),
    );
    paths.insert("/v2".into(), get("Open Inference Protocol: the server's name and extensions.", object(), &[]));
    paths.insert("/v2/health/live".into(), get("Open Inference Protocol: the server answers.", object(), &[]));
    let ready = get("Open Inference Protocol: the server takes requests.", object(), &[&[ErrorCode::NotReady]]);
    paths.insert("/v2/health/ready".into(), ready);
    paths.insert("/v2/models/stats".into(), get("Open Inference Protocol: statistics of all models.", object(), &[]));
    for (path, versioned) in [("/v2/models/{model}", false), ("/v2/models/{model}/versions/{version}", true)] {
        let parameters = in_path(versioned);
        for (end, summary) in [
            ("", "Open Inference Protocol: a model's inputs and outputs."),
            ("/ready", "Open Inference Protocol: a model takes requests."),
            ("/config", "Open Inference Protocol: a model's configuration, as Triton tells it."),
            ("/stats", "Open Inference Protocol: a model's statistics."),
        ] {
            let mut route = get(summary, object(), &[&NAMED, &[ErrorCode::NotReady]]);
            route["get"]["parameters"] = parameters.clone();
            paths.insert(format!("{path}{end}"), route);
        }
        let mut infer = infer();
        infer["parameters"] = parameters.as_array().cloned().into_iter().flatten().chain(terms()).collect();
        paths.insert(format!("{path}/infer"), json!({ "post": infer }));
    }
    json!({
        "openapi": "3.1.0",
        "info": {
            "title": "Realbeam",
            "version": env!("CARGO_PKG_VERSION"),
            "description": "A simulated lidar scan in, the scan that a real sensor would have measured out.",
            "license": { "name": "MIT OR Apache-2.0" },
        },
        "paths": paths,
        // Where the service has a token; health and the page are for everybody.
        "security": [{}, { "token": [] }],
        "components": { "securitySchemes": { "token": { "type": "http", "scheme": "bearer" } }, "schemas": { "Error": {
            "type": "object",
            "required": ["error", "code", "request_id"],
            "additionalProperties": false,
            "properties": {
                "error": { "type": "string", "description": "What went wrong, for a person." },
                "code": { "type": "string", "description": "What went wrong, for a program." },
                "request_id": { "type": "string", "description": "The answer's x-request-id; the service's log has the details under it." },
            },
        } } },
    })
}

/// `POST /v1/scan`.
fn scan() -> Value {
    let binary = || json!({ "schema": { "type": "string", "format": "binary" } });
    let bodies: Map<String, Value> = MEDIA_TYPES.iter().map(|media| (media.name.into(), binary())).collect();
    let mut answers = bodies.clone();
    answers.extend(VIEW_TYPES.iter().map(|media| {
        let is_json = media.name == "application/json";
        (media.name.into(), if is_json { json!({ "schema": { "type": "object" } }) } else { binary() })
    }));
    let summary = "A simulated scan in, a realistic one out; or what became of it, as picture, JSON or records.";
    let mut scan = operation(summary, Value::Object(answers), &[&NAMED, &WORK, &SCAN]);
    let query = |name: &str, schema: Value, description: &str| parameter("query", name, schema, description);
    let number = || json!({ "type": "integer", "minimum": 0, "maximum": u64::MAX });
    let parameters = [
        query("model", json!({ "type": "string" }), "Name of the model; the service's default where there is none."),
        query("version", json!({ "anyOf": [number(), { "const": "latest" }] }), "Version of the model."),
        query("seed", number(), "Seed of the ray drop and of all other chance; the same one gives the same answer."),
        query("noise", json!({ "enum": ["drawn", "median"] }), "median: range and reflectance without scatter."),
        query("frame", json!({ "enum": ["ros", "carla"] }), "Axes of the coordinates; carla: y points right."),
        query("tags", json!({ "enum": ["0.9.13", "0.9.14"] }), "Which of CARLA's tables its semantic tags are of."),
        header(
            "x-ring-counts",
            json!({ "type": "string", "pattern": r"^\d+(,\d+)*$" }),
            "Points of each ring, highest first.",
        ),
    ];
    scan["parameters"] = parameters.into_iter().chain(terms()).collect();
    scan["requestBody"] = json!({ "required": true, "content": bodies });
    scan
}

/// `POST …/infer`.
fn infer() -> Value {
    let content = json!({
        "application/json": { "schema": { "type": "object" } },
        "application/octet-stream": { "schema": { "type": "string", "format": "binary" } },
    });
    let summary = "Open Inference Protocol: tensors in, tensors out, as JSON or binary. The model scan is the whole way of a scan.";
    let mut infer = operation(summary, content, &[&NAMED, &WORK, &TENSORS]);
    infer["requestBody"] = json!({ "required": true, "content": {
        "application/json": { "schema": {
            "type": "object",
            "required": ["inputs"],
            "properties": {
                "id": { "type": "string" },
                "inputs": { "type": "array", "items": tensor() },
                "outputs": { "type": "array", "items": { "type": "object", "required": ["name"] } },
                "parameters": { "type": "object" },
            },
        } },
        "application/octet-stream": { "schema": { "type": "string", "format": "binary" } },
    } });
    infer
}

fn tensor() -> Value {
    json!({
        "type": "object",
        "required": ["name", "datatype", "shape"],
        "properties": {
            "name": { "type": "string" },
            "datatype": { "const": "FP32" },
            "shape": { "type": "array", "items": { "type": "integer", "minimum": 0 } },
            "data": { "type": "array" },
            "parameters": { "type": "object" },
        },
    })
}

/// An operation with its good answer, and its bad ones by their status.
fn operation(summary: &str, content: Value, codes: &[&[ErrorCode]]) -> Value {
    let mut by_status: BTreeMap<u16, Vec<String>> = BTreeMap::new();
    for code in codes.iter().copied().flatten().chain(&ANY) {
        by_status.entry(code.status()).or_default().push(format!("`{}`", code.name()));
    }
    let error = |(status, names): (u16, Vec<String>)| {
        let schema = json!({ "$ref": "#/components/schemas/Error" });
        (
            status.to_string(),
            json!({ "description": names.join(", "), "content": { "application/json": { "schema": schema } } }),
        )
    };
    let mut responses: Map<String, Value> = by_status.into_iter().map(error).collect();
    responses.insert("200".into(), json!({ "description": "Done.", "content": content }));
    json!({ "summary": summary, "responses": responses })
}

fn in_path(versioned: bool) -> Value {
    let mut parameters =
        vec![parameter("path", "model", json!({ "type": "string" }), "Name of a model, or scan for the whole way.")];
    if versioned {
        parameters.push(parameter(
            "path",
            "version",
            json!({ "type": "integer", "minimum": 0 }),
            "Version of the model.",
        ));
    }
    Value::Array(parameters)
}

/// Headers that every request with work in it takes.
fn terms() -> impl Iterator<Item = Value> {
    let id = || json!({ "type": "string", "minLength": 1, "maxLength": 128, "pattern": "^[!-~]+$" });
    [
        header(
            "x-request-id",
            json!({ "type": "string" }),
            "1 to 128 visible characters come back and stand in the service's log; anything else gives way to an id of its own.",
        ),
        header("x-stream-id", id(), "The stream that the scan is of."),
        header(
            "x-stream-mode",
            json!({ "enum": ["every", "latest"] }),
            "latest: a scan that waits is given up when a later one of its stream comes.",
        ),
        header(
            "x-deadline-ms",
            json!({ "type": "integer", "minimum": 1, "maximum": 3_600_000 }),
            "Milliseconds after which nobody wants the answer.",
        ),
        header(
            "x-seed",
            json!({ "type": "integer", "minimum": 0, "maximum": u64::MAX }),
            "The seed, where the query does not say it.",
        ),
    ]
    .into_iter()
}

fn header(name: &str, schema: Value, description: &str) -> Value {
    parameter("header", name, schema, description)
}

fn parameter(place: &str, name: &str, schema: Value, description: &str) -> Value {
    json!({ "in": place, "name": name, "required": place == "path", "schema": schema, "description": description })
}
