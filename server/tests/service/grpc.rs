//! gRPC, as tonic's client speaks it.

use std::thread;
use std::time::Duration;

use lidar::formats::{self, Format};
use proto::ErrorCode;
use proto::grpc::inference::grpc_inference_service_client::GrpcInferenceServiceClient;
use proto::grpc::inference::infer_parameter::ParameterChoice;
use proto::grpc::inference::model_infer_request::InferInputTensor;
use proto::grpc::inference::{
    InferParameter, InferTensorContents, ModelInferRequest, ModelMetadataRequest, ModelReadyRequest, ServerLiveRequest,
    ServerMetadataRequest, ServerReadyRequest,
};
use proto::grpc::scans::scans_client::ScansClient;
use proto::grpc::scans::{Mode, ScanRequest, ScanResponse};
use server::Config;
use tokio::runtime::Runtime;
use tokio_stream::iter;
use tonic::transport::{Channel, Endpoint};
use tonic::{Code, Request, Status};

use crate::load::half_sent;
use crate::support::{Result, Service, bin, config, scan, wait_until};

/// Name of the stand-in whose run takes longest: 64 × 2048.
const SLOW: &str = "hdl64e";

async fn channel(service: &Service) -> Result<Channel> {
    Ok(Endpoint::from_shared(service.url(""))?.connect().await?)
}

async fn models(service: &Service) -> Result<GrpcInferenceServiceClient<Channel>> {
    Ok(GrpcInferenceServiceClient::new(channel(service).await?).max_decoding_message_size(1 << 30))
}

/// Everything that a stream of these scans is answered, and what it ends with.
async fn stream(service: &Service, scans: Vec<ScanRequest>) -> Result<(Vec<ScanResponse>, Option<Status>)> {
    let mut client = ScansClient::new(channel(service).await?).max_decoding_message_size(1 << 30);
    let mut answers = client.scan(iter(scans)).await?.into_inner();
    let mut heard = Vec::new();
    loop {
        match answers.message().await {
            Ok(Some(answer)) => heard.push(answer),
            Ok(None) => return Ok((heard, None)),
            Err(status) => return Ok((heard, Some(status))),
        }
    }
}

fn numbered(number: u64, model: &str, mode: Mode) -> Result<ScanRequest> {
    Ok(ScanRequest { number, data: bin()?.into(), model: model.into(), mode: mode.into(), ..ScanRequest::default() })
}

/// A request for `scan`, its points raw.
fn points(body: &[u8], seed: i64) -> ModelInferRequest {
    let seed = InferParameter { parameter_choice: Some(ParameterChoice::Int64Param(seed)) };
    ModelInferRequest {
        model_name: "scan".into(),
        id: "frame-17".into(),
        parameters: [("seed".to_owned(), seed)].into(),
        inputs: vec![input("POINTS", &[body.len() as i64 / 16, 4])],
        raw_input_contents: vec![body.to_vec().into()],
        ..ModelInferRequest::default()
    }
}

fn input(name: &str, shape: &[i64]) -> InferInputTensor {
    InferInputTensor { name: name.into(), datatype: "FP32".into(), shape: shape.into(), ..InferInputTensor::default() }
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks::<4>().0.iter().map(|number| f32::from_le_bytes(*number)).collect()
}

/// The error of a call that fails.
fn refused<T>(answer: std::result::Result<T, Status>) -> Result<(Code, String, String)> {
    let status = answer.err().ok_or("not refused")?;
    let code = status.metadata().get("x-realbeam-error").ok_or("no x-realbeam-error")?.to_str()?.to_owned();
    assert!(status.metadata().contains_key("x-request-id"), "{status:?}");
    Ok((status.code(), code, status.message().to_owned()))
}

fn metrics(service: &Service) -> Result<String> {
    Ok(String::from_utf8(service.get("/metrics")?.success()?)?)
}

/// The whole number of a line of the metrics; 0 where there is none.
fn figure(text: &str, series: &str) -> usize {
    let line = text.lines().find_map(|line| line.strip_prefix(series)?.strip_prefix(' '));
    line.and_then(|number| number.parse().ok()).unwrap_or_default()
}

#[test]
fn the_service_and_its_models_say_what_they_say_over_http() -> Result {
    let service = Service::start()?;
    Runtime::new()?.block_on(async {
        let mut client = models(&service).await?;
        assert!(client.server_live(ServerLiveRequest {}).await?.into_inner().live);
        assert!(client.server_ready(ServerReadyRequest {}).await?.into_inner().ready);
        let server = client.server_metadata(ServerMetadataRequest {}).await?.into_inner();
        let over_http = service.get("/v2")?.json()?;
        assert_eq!((&over_http["name"], &over_http["version"]), (&server.name.into(), &server.version.into()));
        for (name, version, ready) in
            [("scan", "", true), ("passthrough", "1", true), ("scan", "9", false), ("x", "", false)]
        {
            let asked = ModelReadyRequest { name: name.into(), version: version.into() };
            assert_eq!(client.model_ready(asked).await?.into_inner().ready, ready, "{name} {version}");
        }
        for name in ["scan", "passthrough"] {
            let asked = ModelMetadataRequest { name: name.into(), version: String::new() };
            let model = client.model_metadata(asked).await?.into_inner();
            let over_http = service.get(&format!("/v2/models/{name}"))?.json()?;
            assert_eq!((&over_http["name"], &over_http["platform"]), (&model.name.into(), &model.platform.into()));
            assert_eq!(over_http["versions"], serde_json::to_value(model.versions)?);
            for (tensors, over_http) in [(model.inputs, &over_http["inputs"]), (model.outputs, &over_http["outputs"])] {
                let tensors = tensors
                    .iter()
                    .map(|t| serde_json::json!({ "name": t.name, "datatype": t.datatype, "shape": t.shape }));
                assert_eq!(*over_http, tensors.collect::<serde_json::Value>());
            }
        }
        let asked = ModelMetadataRequest { name: "x".into(), version: String::new() };
        let (status, code, message) = refused(client.model_metadata(asked).await)?;
        let over_http = service.get("/v2/models/x")?.error()?;
        assert_eq!((status, code, message), (Code::NotFound, "model_not_found".into(), over_http.error));
        Ok(())
    })
}

#[test]
fn tensors_come_back_as_over_http_raw_or_typed_as_they_were_sent() -> Result {
    let mut config = config()?;
    config.requests.max_points = 1 << 20;
    let service = Service::with(&config)?;
    let body = bin()?;
    let expected = service.scan("?seed=7", &[], &body)?.success()?;
    let (scan, noise) = (vec![7.5f32; 3 * 16 * 64], vec![0.25f32; 16 * 64]);
    let bytes = |values: &[f32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let head = r#"{"parameters":{"binary_data_output":true},"inputs":[
        {"name":"scan","shape":[1,3,16,64],"datatype":"FP32","parameters":{"binary_data_size":12288}},
        {"name":"noise","shape":[1,1,16,64],"datatype":"FP32","parameters":{"binary_data_size":4096}}]}"#;
    let over_http = service.post(
        "/v2/models/passthrough/infer",
        &[("inference-header-content-length", &head.len().to_string())],
        &[head.as_bytes(), &bytes(&scan), &bytes(&noise)].concat(),
    )?;
    let json = over_http.number("inference-header-content-length")? as usize;
    let over_http = over_http.success()?;
    Runtime::new()?.block_on(async {
        let mut client = models(&service).await?;
        let raw = client.model_infer(points(&body, 7)).await?.into_inner();
        assert_eq!((&*raw.model_name, &*raw.model_version, &*raw.id), ("scan", "2", "frame-17"));
        assert!(raw.raw_output_contents.concat() == expected);
        assert_eq!(raw.outputs[0].shape, [expected.len() as i64 / 16, 4]);
        let mut typed = points(&body, 7);
        typed.raw_input_contents.clear();
        typed.inputs[0].contents = Some(InferTensorContents { fp32_contents: floats(&body) });
        let typed = client.model_infer(typed).await?.into_inner();
        assert!(typed.raw_output_contents.is_empty());
        let contents = typed.outputs[0].contents.as_ref().ok_or("no contents")?;
        assert!(contents.fp32_contents == floats(&expected));

        let generator = ModelInferRequest {
            model_name: "passthrough".into(),
            inputs: vec![input("noise", &[1, 1, 16, 64]), input("scan", &[1, 3, 16, 64])],
            raw_input_contents: vec![bytes(&noise).into(), bytes(&scan).into()],
            ..ModelInferRequest::default()
        };
        let answer = client.model_infer(generator.clone()).await?.into_inner();
        assert_eq!(answer.outputs.len(), 3);
        assert!(answer.raw_output_contents.concat() == over_http[json..]);

        let less = ModelInferRequest { raw_input_contents: vec![bytes(&noise).into()], ..generator.clone() };
        let none = ModelInferRequest { raw_input_contents: vec![], ..generator.clone() };
        let unknown = ModelInferRequest { model_name: "x".into(), ..generator.clone() };
        let version = ModelInferRequest { model_version: "9".into(), ..generator };
        for (asked, expected, words) in [
            (less, Code::InvalidArgument, "there are 2 inputs, but raw_input_contents has 1"),
            (none, Code::InvalidArgument, "input `noise`: shape is [1, 1, 16, 64], but there are 0 elements"),
            (points(&body[..24], 7), Code::InvalidArgument, "shape is [1, 4], but there are 6 elements"),
            (unknown, Code::NotFound, "no model `x`"),
            (version, Code::NotFound, "9"),
        ] {
            let (code, _, message) = refused(client.model_infer(asked).await)?;
            assert_eq!(code, expected, "{message}");
            assert!(message.contains(words), "`{message}` has no `{words}`");
        }
        // Of as many points as a body may have: the way of a few may take less than a millisecond.
        let mut late = points(&body.repeat((7 << 20) / body.len()), 7);
        let slow = InferParameter { parameter_choice: Some(ParameterChoice::StringParam(SLOW.into())) };
        late.parameters.insert("model".into(), slow);
        client.model_infer(late.clone()).await?;
        let mut late = Request::new(late);
        late.metadata_mut().insert("x-deadline-ms", "1".parse()?);
        assert_eq!(refused(client.model_infer(late).await)?.0, Code::DeadlineExceeded);
        Ok::<_, Box<dyn std::error::Error>>(())
    })?;
    let metrics = metrics(&service)?;
    let route = "/inference.GRPCInferenceService/ModelInfer";
    for (code, count) in [("OK", 4), ("INVALID_ARGUMENT", 3), ("NOT_FOUND", 2), ("DEADLINE_EXCEEDED", 1)] {
        let series = format!(r#"realbeam_requests_total{{route="{route}",code="{code}"}}"#);
        assert_eq!(figure(&metrics, &series), count, "{metrics}");
    }
    Ok(())
}

#[test]
fn a_stream_answers_every_scan_as_the_scan_route_does_and_a_bad_one_with_what_is_wrong() -> Result {
    let service = Service::start()?;
    let body = bin()?;
    let pcd = formats::encode(Format::Pcd, &scan())?;
    let plain = |number| numbered(number, "", Mode::Every);
    let scans = vec![
        ScanRequest { seed: 7, ..plain(1)? },
        ScanRequest { data: body[..17].to_vec().into(), ..plain(2)? },
        ScanRequest { model: "x".into(), ..plain(3)? },
        ScanRequest { ring_counts: vec![1, 2], ..plain(4)? },
        ScanRequest { noise: "loud".into(), ..plain(5)? },
        ScanRequest { mode: 7, ..plain(6)? },
        ScanRequest { version: Some(1), seed: 8, frame: "carla".into(), ring_counts: vec![], ..plain(7)? },
        ScanRequest {
            data: pcd.clone().into(),
            content_type: "application/x-pcd".into(),
            accept: "application/x-npz".into(),
            ..plain(8)?
        },
    ];
    let (answers, ended) = Runtime::new()?.block_on(stream(&service, scans))?;
    assert!(ended.is_none(), "{ended:?}");
    assert_eq!(answers.iter().map(|answer| answer.number).collect::<Vec<_>>(), [1, 2, 3, 4, 5, 6, 7, 8]);

    let over_http = service.scan("?seed=7", &[], &body)?;
    let first = &answers[0];
    for (header, number) in [
        ("x-realbeam-seed", first.seed),
        ("x-realbeam-model-version", first.model_version),
        ("x-realbeam-points-in", first.points_in),
        ("x-realbeam-points-kept", first.points_kept),
        ("x-realbeam-points-dropped", first.points_dropped),
        ("x-realbeam-points-lost", first.points_lost),
        ("x-realbeam-points-invalid", first.points_invalid),
        ("x-realbeam-points-out-of-range", first.points_out_of_range),
        ("x-realbeam-points-added", first.points_added),
    ] {
        assert_eq!(over_http.number(header)?, number, "{header}");
    }
    assert_eq!((first.model_digest.as_str(), first.grid_coverage), (over_http.header("x-realbeam-model-digest"), 1.0));
    assert!(first.timing.contains("infer;dur="), "{}", first.timing);
    assert!(first.data == over_http.success()?);
    assert!(answers[6].data == service.scan("?seed=8&version=1&frame=carla", &[], &body)?.success()?);
    let types = [("content-type", "application/x-pcd"), ("accept", "application/x-npz")];
    assert!(answers[7].data == service.scan("", &types, &pcd)?.success()?);
    assert_eq!(answers[7].content_type, "application/x-npz");

    for (answer, code, status, words) in [
        (
            &answers[1],
            ErrorCode::MalformedScan,
            Code::InvalidArgument,
            service.scan("", &[], &body[..17])?.error()?.error,
        ),
        (&answers[2], ErrorCode::ModelNotFound, Code::NotFound, service.scan("?model=x", &[], &body)?.error()?.error),
        (&answers[3], ErrorCode::UnusableScan, Code::InvalidArgument, "ring_counts: ".into()),
        (
            &answers[4],
            ErrorCode::BadQuery,
            Code::InvalidArgument,
            service.scan("?noise=loud", &[], &body)?.error()?.error,
        ),
        (&answers[5], ErrorCode::BadQuery, Code::InvalidArgument, "mode: ".into()),
    ] {
        let failure = answer.failure.as_ref().ok_or("no failure")?;
        assert_eq!((&failure.code, failure.status), (&code.name(), status as i32), "{failure:?}");
        assert!(failure.message.starts_with(&words), "`{}` does not begin with `{words}`", failure.message);
        assert!(answer.data.is_empty());
    }
    let series = r#"realbeam_requests_total{route="/realbeam.v1.Scans/Scan/scan",code="OK"}"#;
    assert_eq!(figure(&metrics(&service)?, series), 3);
    Ok(())
}

#[test]
fn a_live_stream_gives_up_scans_that_wait_and_says_so() -> Result {
    let service = Service::start()?;
    let runtime = Runtime::new()?;
    for _ in 0..20 {
        let scans = (1..=20).map(|number| numbered(number, SLOW, Mode::Latest)).collect::<Result<_>>()?;
        let (answers, ended) = runtime.block_on(stream(&service, scans))?;
        assert!(ended.is_none(), "{ended:?}");
        assert_eq!(answers.iter().map(|answer| answer.number).collect::<Vec<_>>(), (1..=20).collect::<Vec<_>>());
        let given_up: Vec<_> = answers.iter().filter_map(|answer| answer.failure.as_ref()).collect();
        assert!(given_up.iter().all(|failure| failure.code == "superseded" && failure.status == Code::Aborted as i32));
        assert!(answers[19].failure.is_none(), "nothing comes after the last one");
        if !given_up.is_empty() {
            return Ok(());
        }
    }
    Err("in 20 streams no scan gave way to a later one".into())
}

#[test]
fn of_a_long_stream_no_more_scans_are_under_way_than_may_wait() -> Result {
    let mut config = config()?;
    config.workers.queue = 1;
    // Two scans that arrive or leave.
    (config.requests.max_body_bytes, config.requests.max_inflight_bytes) = (100_000, 200_000);
    let service = Service::with(&config)?;
    let scans = (1..=30).map(|number| numbered(number, "", Mode::Every)).collect::<Result<_>>()?;
    let (answers, ended) = Runtime::new()?.block_on(stream(&service, scans))?;
    assert!(ended.is_none(), "{ended:?}");
    assert_eq!(answers.len(), 30);
    assert!(answers.iter().all(|answer| answer.failure.is_none()), "nobody else is there to be in the way");
    Ok(())
}

#[test]
fn a_message_that_is_too_large_is_refused_before_it_is_read() -> Result {
    let mut config = config()?;
    config.requests.max_body_bytes = 100_000;
    let service = Service::with(&config)?;
    let large = vec![0; 160_000];
    Runtime::new()?.block_on(async {
        let mut client = models(&service).await?;
        let (status, code, message) = refused(client.model_infer(points(&large, 7)).await)?;
        assert_eq!((status, &*code), (Code::ResourceExhausted, "body_too_large"));
        assert_eq!(message, "the body has more than 100000 bytes");
        let scans = vec![
            numbered(1, "", Mode::Every)?,
            ScanRequest { data: large.clone().into(), ..numbered(2, "", Mode::Every)? },
            numbered(3, "", Mode::Every)?,
        ];
        let (answers, ended) = stream(&service, scans).await?;
        assert!(answers.len() == 1 && answers[0].failure.is_none(), "what came before it is answered");
        let ended = ended.ok_or("the stream went on")?;
        assert_eq!((ended.code(), ended.message()), (Code::ResourceExhausted, "the body has more than 100000 bytes"));
        Ok(())
    })
}

#[test]
fn where_there_is_no_memory_left_a_call_is_refused_and_a_stream_waits() -> Result {
    let mut config = config()?;
    (config.requests.max_body_bytes, config.requests.max_inflight_bytes) = (200_000, 250_000);
    // What is half sent stays so, however slow the machine.
    config.requests.body_time = Duration::from_mins(10);
    let service = Service::with(&config)?;
    let others = half_sent(&service, 192_000)?;
    let is_used =
        |bytes| wait_until("memory is taken", || Ok(figure(&metrics(&service)?, "realbeam_inflight_bytes") == bytes));
    is_used(192_000)?;
    Runtime::new()?.block_on(async {
        let (status, code, message) = refused(models(&service).await?.model_infer(points(&bin()?, 7)).await)?;
        assert_eq!((status, &*code), (Code::ResourceExhausted, "too_many_bytes"));
        assert!(message.contains("bodies of 192000 bytes are under way"), "{message}");
        let mut client = ScansClient::new(channel(&service).await?);
        let mut answers = client.scan(iter(vec![numbered(1, "", Mode::Every)?])).await?.into_inner();
        tokio::select! {
            answer = answers.message() => return Err(format!("there was no memory for {answer:?}").into()),
            () = tokio::time::sleep(Duration::from_millis(300)) => drop(others),
        }
        let answer = answers.message().await?.ok_or("no answer")?;
        assert!(answer.failure.is_none(), "{:?}", answer.failure);
        Ok::<_, Box<dyn std::error::Error>>(())
    })?;
    is_used(0)
}

#[test]
fn a_stream_whose_client_has_gone_leaves_nothing_behind() -> Result {
    let service = Service::start()?;
    let scans: Vec<_> = (1..=8).map(|number| numbered(number, SLOW, Mode::Every)).collect::<Result<_>>()?;
    Runtime::new()?.block_on(async {
        let mut client = ScansClient::new(channel(&service).await?).max_decoding_message_size(1 << 30);
        let mut answers = client.scan(iter(scans)).await?.into_inner();
        assert!(answers.message().await?.is_some());
        Ok::<_, Box<dyn std::error::Error>>(())
    })?;
    wait_until("nothing is under way", || Ok(figure(&metrics(&service)?, "realbeam_inflight_bytes") == 0))
}

#[test]
fn a_silent_stream_ends() -> Result {
    let mut config = config()?;
    config.connections.idle_time = Duration::from_millis(300);
    let service = Service::with(&config)?;
    Runtime::new()?.block_on(async {
        let mut client = ScansClient::new(channel(&service).await?);
        let mut answers = client.scan(tokio_stream::pending()).await?.into_inner();
        let ended = answers.message().await.err().ok_or("the stream ended well")?;
        assert_eq!((ended.code(), ended.message()), (Code::DeadlineExceeded, "no scan has come for 0.3 s"));
        Ok(())
    })
}

#[test]
fn a_service_that_stops_answers_the_scans_that_it_has_read() -> Result {
    let config = config()?;
    let stop = server::StopOptions { grace: Duration::from_mins(2), ..config.stop };
    let service = Service::with(&Config { stop, ..config })?;
    let runtime = Runtime::new()?;
    let (send, scans) = tokio::sync::mpsc::channel(64);
    let mut client = runtime.block_on(async {
        Ok::<_, Box<dyn std::error::Error>>(
            ScansClient::new(channel(&service).await?).max_decoding_message_size(1 << 30),
        )
    })?;
    let scans = tokio_stream::wrappers::ReceiverStream::new(scans);
    let mut answers = runtime.block_on(client.scan(scans))?.into_inner();
    // The workers start with the first scan.
    send.blocking_send(numbered(0, SLOW, Mode::Every)?)?;
    assert_eq!(runtime.block_on(answers.message())?.ok_or("no answer")?.number, 0);
    let mut sent = 0;
    let mut waiting = 0;
    wait_until("scans wait for the worker", || {
        for _ in 0..8 {
            sent += 1;
            if send.try_send(numbered(sent, SLOW, Mode::Every)?).is_err() {
                sent -= 1;
            }
        }
        waiting = figure(&metrics(&service)?, &format!(r#"realbeam_queue_depth{{name="{SLOW}",version="1"}}"#));
        Ok(waiting >= 2)
    })?;
    let server = service.server;
    let stopping = thread::spawn(move || server.stop().map_err(|error| error.to_string()));
    let mut heard = 0;
    let ended = loop {
        match runtime.block_on(answers.message()) {
            Ok(Some(answer)) => {
                heard += 1;
                assert!(answer.number == heard && answer.failure.is_none(), "{:?}", answer.failure);
            }
            Ok(None) => return Err("the stream ended as if all scans were answered".into()),
            Err(status) => break status,
        }
    };
    assert_eq!((ended.code(), ended.message()), (Code::Unavailable, "the service is stopping"));
    assert!(heard >= waiting as u64, "{heard} answers, though {waiting} scans waited");
    stopping.join().map_err(|_| "the stop panicked")??;
    Ok(())
}
