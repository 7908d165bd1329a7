//! The description of the routes is of the routes that there are.

use serde_json::Value;

use crate::support::{Result, Service};

#[test]
fn every_route_of_the_document_answers_as_it_says() -> Result {
    let service = Service::start()?;
    let document: Value = serde_json::from_slice(&service.get("/api-doc/openapi.json")?.body)?;
    assert_eq!(document["openapi"], "3.1.0");
    let paths = document["paths"].as_object().ok_or("no paths")?;
    assert!(paths.len() > 15, "{}", paths.len());
    for (path, operations) in paths {
        let at = path.replace("{model}", "scan").replace("{version}", "1");
        for method in operations.as_object().ok_or("no operations")?.keys() {
            let answer = match method.as_str() {
                "get" => service.get(&at)?,
                _ => service.post(&at, &[("content-type", "application/x-npy")], b"no scan")?,
            };
            let said = &operations[method]["responses"][answer.status.to_string()];
            let kind = answer.header("content-type").split(';').next().unwrap_or_default();
            assert!(
                said["content"][kind].is_object(),
                "{method} {path}: {} as {kind} is not in the document",
                answer.status
            );
        }
    }
    Ok(())
}

#[test]
fn the_docs_are_a_page_without_scripts_that_names_every_route() -> Result {
    let answer = Service::start()?.get("/docs")?;
    let policy = answer.header("content-security-policy");
    assert!(policy.starts_with("default-src 'none'; style-src 'sha256-") && !policy.contains("unsafe"), "{policy}");
    let page = String::from_utf8(answer.body)?;
    assert!(page.contains("/v2/models/{model}/infer") && page.contains("x-ring-counts") && !page.contains("<script"));
    Ok(())
}
