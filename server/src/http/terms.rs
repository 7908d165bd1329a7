//! The terms on which a request wants its answer, from its headers.

use std::fmt::Display;
use std::future::pending;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;

use axum::http::{Extensions, HeaderMap};
use proto::ErrorCode;
use tokio::time::{Instant, sleep_until};

use super::envelope::RequestId;
use super::error::ApiError;
use crate::streams::{Place, Streams, Superseded};

/// Longest id of a stream.
const MAX_ID_LENGTH: usize = 128;

/// Longest time that a request may be willing to wait, in milliseconds.
const MAX_DEADLINE_MS: u64 = 3_600_000;

/// What the headers ask for:
///
/// | header | meaning |
/// |---|---|
/// | `x-deadline-ms` | milliseconds after which nobody needs the answer any more; it is then 504 |
/// | `grpc-timeout` | the same in the words of gRPC: digits and a unit, `250m`; the earlier of the two counts |
/// | `x-stream-id` | the stream that the scan belongs to |
/// | `x-stream-mode` | `every` scan of the stream is answered, or only the `latest`: one that waits is given up for a newer one |
/// | `x-seed` | as `?seed=` |
#[derive(Clone, Debug, Default)]
pub(crate) struct Terms {
    pub(crate) deadline: Option<Instant>,
    pub(crate) stream: Option<String>,
    pub(crate) latest_only: bool,
    pub(crate) seed: Option<u64>,
}

impl Terms {
    /// Reads the headers.
    pub(crate) fn read(headers: &HeaderMap) -> Result<Self, ApiError> {
        let wrong = |name: &str, found: &dyn Display, expected: &str| {
            ApiError::new(ErrorCode::BadHeader, format!("header {name} is `{found}`, expected {expected}"))
        };
        let own = number(headers, "x-deadline-ms")?.map(|ms| deadline("header x-deadline-ms", ms)).transpose()?;
        let timeout = text(headers, "grpc-timeout")?.map(|text| {
            grpc_timeout(text).ok_or_else(|| wrong("grpc-timeout", &text, "1 to 8 digits and H, M, S, m, u or n"))
        });
        // One that lies beyond all time is none.
        let timeout = timeout.transpose()?.and_then(|time| Instant::now().checked_add(time));
        let stream = text(headers, "x-stream-id")?;
        let plain = |id: &&str| !id.is_empty() && id.len() <= MAX_ID_LENGTH && id.bytes().all(|b| b.is_ascii_graphic());
        if let Some(id) = stream.filter(|id| !plain(id)) {
            let shown: String = id.chars().take(80).collect();
            return Err(wrong("x-stream-id", &shown, &format!("1 to {MAX_ID_LENGTH} visible characters")));
        }
        let latest_only = match text(headers, "x-stream-mode")? {
            None | Some("every") => false,
            Some("latest") if stream.is_some() => true,
            Some("latest") => return Err(wrong("x-stream-mode", &"latest", "x-stream-id beside it")),
            Some(other) => return Err(wrong("x-stream-mode", &other, "every or latest")),
        };
        Ok(Self {
            deadline: own.into_iter().chain(timeout).min(),
            stream: stream.map(Into::into),
            latest_only,
            seed: number(headers, "x-seed")?,
        })
    }

    /// The seed, given the query's.
    pub(crate) fn seed_with(&self, query: Option<u64>) -> Result<u64, ApiError> {
        match (query, self.seed) {
            (Some(query), Some(header)) if query != header => {
                let message = format!("header x-seed is `{header}`, but query key `seed` is `{query}`");
                Err(ApiError::new(ErrorCode::BadHeader, message))
            }
            (query, header) => Ok(query.or(header).unwrap_or_default()),
        }
    }

    /// Whose canary the request is: its stream's, or its own.
    pub(crate) fn canary_key<'a>(&'a self, extensions: &'a Extensions) -> Option<&'a str> {
        self.stream.as_deref().or_else(|| extensions.get().map(|RequestId(id)| id.as_str()))
    }

    /// Takes the stream's place where only its latest scan counts.
    pub(crate) fn enter(&self, streams: &Arc<Streams>) -> (Option<Place>, Option<Superseded>) {
        match &self.stream {
            Some(id) if self.latest_only => {
                let (place, superseded) = streams.enter(id);
                (Some(place), Some(superseded))
            }
            _ => (None, None),
        }
    }

    /// Waits for work, but not beyond the deadline, nor once a later scan of the stream has come. Work that is given up is dropped.
    pub(crate) async fn wait<T, E: Into<ApiError>>(
        &self,
        superseded: Option<Superseded>,
        work: impl Future<Output = Result<T, E>>,
    ) -> Result<T, ApiError> {
        let superseded = async {
            let Some(superseded) = superseded else { return pending().await };
            if superseded.await.is_err() {
                pending::<()>().await;
            }
        };
        tokio::select! {
            done = work => {
                // Timers are coarse: the deadline may have passed and not rung yet.
                let in_time = self.deadline.is_none_or(|deadline| Instant::now() <= deadline);
                if in_time { done.map_err(Into::into) } else { Err(too_late()) }
            }
            () = superseded => {
                Err(ApiError::new(ErrorCode::Superseded, "a later scan of the same stream has come while this one waited"))
            }
            () = until(self.deadline) => Err(too_late()),
        }
    }
}

/// The deadline in so many milliseconds, as `name` asks for it.
pub(super) fn deadline(name: &str, ms: u64) -> Result<Instant, ApiError> {
    if !(1..=MAX_DEADLINE_MS).contains(&ms) {
        let message = format!("{name} is `{ms}`, expected 1 to {MAX_DEADLINE_MS}");
        return Err(ApiError::new(ErrorCode::BadHeader, message));
    }
    Ok(Instant::now() + Duration::from_millis(ms))
}

/// A time as gRPC's protocol over HTTP/2 writes it.
fn grpc_timeout(text: &str) -> Option<Duration> {
    let (digits, unit) = text.split_at_checked(text.len().checked_sub(1)?)?;
    let is_number = (1..=8).contains(&digits.len()) && digits.bytes().all(|digit| digit.is_ascii_digit());
    let number = if is_number { digits.parse().ok()? } else { return None };
    match unit {
        "H" => Some(Duration::from_secs(number * 3600)),
        "M" => Some(Duration::from_secs(number * 60)),
        "S" => Some(Duration::from_secs(number)),
        "m" => Some(Duration::from_millis(number)),
        "u" => Some(Duration::from_micros(number)),
        "n" => Some(Duration::from_nanos(number)),
        _ => None,
    }
}

/// Completes at the deadline, or never.
pub(super) async fn until(deadline: Option<Instant>) {
    match deadline {
        Some(deadline) => sleep_until(deadline).await,
        None => pending().await,
    }
}

/// The answer to a request whose deadline has passed.
pub(super) fn too_late() -> ApiError {
    ApiError::new(ErrorCode::DeadlineExceeded, "the request's deadline has passed")
}

/// A header that may come once.
pub(super) fn text<'h>(headers: &'h HeaderMap, name: &'static str) -> Result<Option<&'h str>, ApiError> {
    let mut values = headers.get_all(name).iter();
    let (value, another) = (values.next(), values.next());
    if another.is_some() {
        return Err(ApiError::new(ErrorCode::BadHeader, format!("header {name} is given twice")));
    }
    let plain = |_| ApiError::new(ErrorCode::BadHeader, format!("header {name} is not plain ASCII"));
    value.map(|value| value.to_str().map_err(plain)).transpose()
}

/// A header that is a whole number.
pub(super) fn number<T: FromStr>(headers: &HeaderMap, name: &'static str) -> Result<Option<T>, ApiError> {
    let wrong =
        |found| ApiError::new(ErrorCode::BadHeader, format!("header {name} is `{found}`, expected a whole number"));
    text(headers, name)?.map(|found| found.parse().map_err(|_| wrong(found))).transpose()
}

#[cfg(test)]
mod tests {
    use axum::http::{HeaderName, HeaderValue};
    use tokio::sync::oneshot;

    use super::*;

    fn read(pairs: &[(&'static str, &'static str)]) -> Result<Terms, String> {
        let headers =
            pairs.iter().map(|(name, value)| (HeaderName::from_static(name), HeaderValue::from_static(value)));
        Terms::read(&headers.collect()).map_err(|error| error.message)
    }

    fn problem(name: &'static str, value: &'static str) -> String {
        read(&[(name, value)]).err().unwrap_or_default()
    }

    #[test]
    fn terms_that_cannot_be_read_are_refused() -> Result<(), String> {
        let terms = read(&[("x-stream-id", "ego"), ("x-stream-mode", "latest"), ("x-seed", "7")])?;
        assert_eq!((terms.stream.as_deref(), terms.latest_only, terms.seed), (Some("ego"), true, Some(7)));
        assert_eq!(problem("x-seed", "-1"), "header x-seed is `-1`, expected a whole number");
        assert_eq!(problem("x-deadline-ms", "0"), "header x-deadline-ms is `0`, expected 1 to 3600000");
        assert_eq!(
            problem("grpc-timeout", "1.5S"),
            "header grpc-timeout is `1.5S`, expected 1 to 8 digits and H, M, S, m, u or n"
        );
        assert_eq!(
            ["99999999H", "1n", "", "S", "123456789S"].map(|text| grpc_timeout(text).is_some()),
            [true, true, false, false, false]
        );
        assert!(read(&[("grpc-timeout", "1S")])?.deadline < read(&[("x-deadline-ms", "60000")])?.deadline);
        assert!(
            read(&[("grpc-timeout", "1M"), ("x-deadline-ms", "1")])?.deadline
                < read(&[("grpc-timeout", "1S")])?.deadline
        );
        assert_eq!(grpc_timeout("250m"), Some(Duration::from_millis(250)));
        assert_eq!(problem("x-stream-id", "a b"), "header x-stream-id is `a b`, expected 1 to 128 visible characters");
        assert_eq!(
            problem("x-stream-mode", "latest"),
            "header x-stream-mode is `latest`, expected x-stream-id beside it"
        );
        assert_eq!(problem("x-stream-mode", "some"), "header x-stream-mode is `some`, expected every or latest");
        let twice = read(&[("x-seed", "1"), ("x-seed", "2")]);
        assert_eq!(twice.err().as_deref(), Some("header x-seed is given twice"));
        Ok(())
    }

    #[tokio::test(start_paused = true)]
    async fn who_waits_gives_up_at_the_deadline_or_for_a_later_scan() -> Result<(), String> {
        let terms = read(&[("x-deadline-ms", "50")])?;
        let code = |result: Result<(), ApiError>| result.err().map(|error| error.code);
        assert_eq!(code(terms.wait(None, pending::<Result<_, ApiError>>()).await), Some(ErrorCode::DeadlineExceeded));
        let (tell, superseded) = oneshot::channel();
        assert!(tell.send(()).is_ok());
        let waited = Terms::default().wait(Some(superseded), pending::<Result<_, ApiError>>()).await;
        assert_eq!(code(waited), Some(ErrorCode::Superseded));
        // A scan that is begun is no longer in anybody's way.
        let (begun, superseded) = oneshot::channel();
        drop(begun);
        let work = async {
            tokio::time::sleep(Duration::from_secs(1)).await;
            Ok::<_, ApiError>(())
        };
        assert_eq!(code(Terms::default().wait(Some(superseded), work).await), None);
        Ok(())
    }
}
