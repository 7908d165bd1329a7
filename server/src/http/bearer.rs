//! Who is let in: whoever shows the listener's token.

use axum::Router;
use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderMap, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use proto::ErrorCode;

use super::body;
use super::error::ApiError;
use crate::token::Token;

/// A token, and the routes that do without it.
#[derive(Clone, Debug)]
struct Gate {
    token: Token,
    open: &'static [&'static str],
}

/// Asks for the token on every route but the `open` ones; what is no route asks for it too, so that nobody learns which there are.
pub(super) fn gated<S: Clone + Send + Sync + 'static>(
    router: Router<S>,
    token: Token,
    open: &'static [&'static str],
) -> Router<S> {
    router.layer(middleware::from_fn_with_state(Gate { token, open }, authorise))
}

/// Refuses by the head alone.
async fn authorise(State(gate): State<Gate>, request: Request, next: Next) -> Response {
    let open = request.extensions().get::<MatchedPath>().is_some_and(|path| gate.open.contains(&path.as_str()));
    if open || offered(request.headers()).is_some_and(|offered| gate.token.is(offered)) {
        return next.run(request).await;
    }
    // A client that waits to be told to send its body is told not to.
    if !request.headers().contains_key(header::EXPECT) {
        body::discard(request.into_body()).await;
    }
    ApiError::new(ErrorCode::Unauthorized, "header authorization is not `Bearer` with this service's token")
        .into_response()
}

/// What a request shows as its token.
fn offered(headers: &HeaderMap) -> Option<&str> {
    let (scheme, offered) = headers.get(header::AUTHORIZATION)?.to_str().ok()?.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| offered.trim())
}
