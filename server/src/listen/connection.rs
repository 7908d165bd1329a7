//! One connection, from its first byte to its last.

use std::pin::pin;
use std::time::Duration;

use axum::Router;
use axum::extract::Request;
use hyper::body::Incoming;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use hyper_util::server::conn::auto::Builder;
use hyper_util::service::TowerToHyperService;
use proto::{ErrorBody, ErrorCode};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio_io_timeout::TimeoutStream;
use tokio_util::sync::CancellationToken;

use super::activity::{Activity, Sent};
use crate::config::ConnectionLimits;

/// Time in which a connection that is not let in has to take its answer.
const REFUSAL: Duration = Duration::from_secs(2);

/// Bytes that the head of a request may have, and that of its body are read at a time. HTTP/2's heads have their own limit, hyper's 16 KiB.
const MAX_HEAD_BYTES: usize = 64 << 10;

/// Serves HTTP/1.1 or HTTP/2 until the client ends it, a limit is hit, or the service stops and no request is under way.
///
/// hyper's own limit on the time of headers begins with the first byte; the watch on the connection's activity covers silence too.
pub(super) async fn serve<S>(stream: S, router: Router, limits: ConnectionLimits, stop: CancellationToken)
where
    S: AsyncRead + AsyncWrite + Send + 'static,
{
    let mut stream = TimeoutStream::new(stream);
    stream.set_write_timeout(Some(limits.write_time));
    let activity = Activity::new();
    let (router, requests) = (TowerToHyperService::new(router), activity.clone());
    let service = service_fn(move |request: Request<Incoming>| {
        let under_way = requests.begin();
        let answering = router.call(request);
        async move { answering.await.map(|answer| answer.map(|body| Sent::new(body, under_way))) }
    });
    let mut builder = Builder::new(TokioExecutor::new());
    builder.http1().timer(TokioTimer::new()).header_read_timeout(limits.idle_time).max_buf_size(MAX_HEAD_BYTES);
    builder.http2().timer(TokioTimer::new());
    let mut connection = pin!(builder.serve_connection(TokioIo::new(Box::pin(stream)), service));
    let mut idle = pin!(activity.idle_for(limits.idle_time));
    let mut stopping = false;
    loop {
        tokio::select! {
            ended = connection.as_mut() => {
                if let Err(error) = ended {
                    tracing::debug!("a connection ended badly: {error}");
                }
                return;
            }
            () = &mut idle => return,
            () = stop.cancelled(), if !stopping => {
                stopping = true;
                connection.as_mut().graceful_shutdown();
            }
        }
    }
}

/// Tells a client that there are too many already.
pub(super) async fn refuse<S: AsyncRead + AsyncWrite + Unpin>(mut stream: S, max: usize) {
    let error = format!("{max} connections are open already, and no more are taken; try again later");
    let body = ErrorBody { error, code: ErrorCode::TooManyConnections, request_id: String::new() };
    let body = serde_json::to_string(&body).unwrap_or_default();
    let status = ErrorCode::TooManyConnections.status();
    let answer = format!(
        "HTTP/1.1 {status} Service Unavailable\r\ncontent-type: application/json\r\ncontent-length: {}\r\nretry-after: 1\r\n\
         connection: close\r\n\r\n{body}",
        body.len()
    );
    let telling = async {
        stream.write_all(answer.as_bytes()).await?;
        stream.shutdown().await?;
        // A connection that is closed with unread bytes is reset, and its answer lost.
        let mut unread = [0; 4096];
        while stream.read(&mut unread).await? > 0 {}
        std::io::Result::Ok(())
    };
    // Whoever does not listen need not hear it.
    let _ = tokio::time::timeout(REFUSAL, telling).await;
}
