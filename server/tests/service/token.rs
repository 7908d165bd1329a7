//! A service for those alone who have its token.

use std::io::{Read, Write};

use proto::ErrorCode;
use server::{Config, Token};

use crate::errors::assert_error;
use crate::support::{Result, Service, bin, config};

const TOKEN: &str = "fedcba9876543210";

/// Routes that answer whoever asks.
const OPEN: [&str; 3] = ["/", "/v2/health/live", "/v2/health/ready"];

fn locked() -> Result<Service> {
    Service::with(&Config { token: Some(Token::new(TOKEN)?), ..config()? })
}

#[test]
fn only_the_page_and_the_service_s_health_are_open_to_whoever_has_no_token() -> Result {
    let service = locked()?;
    for path in OPEN {
        assert_eq!(service.get(path)?.status, 200, "{path}");
    }
    let others =
        ["/info", "/metrics", "/sample", "/v2", "/v2/models/scan", "/v2/models/scan/ready", "/v2/health", "/x"];
    for path in others {
        let answer = service.get(path)?;
        assert_error(&answer, 401, ErrorCode::Unauthorized, "header authorization is not `Bearer`")?;
        assert_eq!(answer.header("www-authenticate"), "Bearer");
    }
    let wrong = ["Bearer", "Bearer ", "Bearer fedcba9876543211", "Basic fedcba9876543210", "fedcba9876543210"];
    for authorization in wrong {
        let answer = service.scan("", &[("authorization", authorization)], &bin()?)?;
        assert_error(&answer, 401, ErrorCode::Unauthorized, "header authorization")?;
    }
    for authorization in ["Bearer fedcba9876543210", "bearer  fedcba9876543210"] {
        service.scan("", &[("authorization", authorization)], &bin()?)?.success()?;
    }
    Ok(())
}

#[test]
fn a_page_that_is_not_there_is_not_open_either() -> Result {
    let service = Service::with(&Config { page: false, token: Some(Token::new(TOKEN)?), ..config()? })?;
    assert_eq!(service.get("/")?.status, 401);
    Ok(())
}

#[test]
fn a_body_without_the_token_is_not_asked_for() -> Result {
    let service = locked()?;
    let mut stream = service.connect()?;
    let head = "POST /v1/scan HTTP/1.1\r\nhost: x\r\ncontent-length: 1000000\r\nexpect: 100-continue\r\n\r\n";
    stream.write_all(head.as_bytes())?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer)?;
    assert!(answer.starts_with("HTTP/1.1 401 "), "{answer}");
    Ok(())
}
