//! The OpenAPI 3.1 description of the service, made from the handlers and their answer types.

use axum::response::{IntoResponse, Response};
use utoipa::OpenApi;

use super::fault::json_header;
use super::handlers;

/// This API description.
#[utoipa::path(
    get,
    path = "/openapi.json",
    tag = "handlers",
    responses((status = 200, description = "OpenAPI 3.1", body = serde_json::Value))
)]
pub(super) async fn openapi() -> Response {
    (json_header(), description()).into_response()
}

/// The description as JSON, pretty-printed.
fn description() -> String {
    // Maps with string keys, strings and numbers always serialise.
    serde_json::to_string_pretty(&Description::openapi()).unwrap_or_default()
}

#[derive(OpenApi)]
#[openapi(
    info(
        title = "Graspmill planner",
        version = env!("CARGO_PKG_VERSION"),
        description = "Ranked grasps from depth images, a TSDF or a point cloud. Metres; quaternions are x, y, z, w; \
                       cameras look along +z, x right, y down. Every error is {\"error\": \"…\", \"status\": 422}, \
                       of /predict {\"detail\": {\"error\": \"…\", \"message\": \"…\"}}."
    ),
    paths(
        handlers::plan,
        handlers::model,
        handlers::predict,
        handlers::config,
        handlers::version,
        handlers::healthz,
        handlers::readyz,
        handlers::metrics,
        openapi
    )
)]
struct Description;

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use serde_json::Value;

    use super::*;
    use crate::serve::metrics::ENDPOINTS;

    fn described() -> Value {
        serde_json::from_str(&description()).unwrap()
    }

    fn references<'a>(value: &'a Value, found: &mut BTreeSet<&'a str>) {
        match value {
            Value::Object(entries) => {
                found.extend(entries.get("$ref").and_then(Value::as_str));
                entries.values().for_each(|inner| references(inner, found));
            }
            Value::Array(items) => items.iter().for_each(|inner| references(inner, found)),
            _ => {}
        }
    }

    #[test]
    fn every_endpoint_is_described() {
        let described = described();
        assert!(described["openapi"].as_str().unwrap().starts_with("3.1"));
        assert_eq!(described["info"]["version"], env!("CARGO_PKG_VERSION"));
        let paths: BTreeSet<&str> = described["paths"].as_object().unwrap().keys().map(String::as_str).collect();
        assert_eq!(paths, BTreeSet::from(ENDPOINTS));
    }

    #[test]
    fn every_reference_leads_somewhere() {
        let described = described();
        let mut found = BTreeSet::new();
        references(&described, &mut found);
        assert!(found.contains("#/components/schemas/Answer"), "{found:?}");
        assert!(found.contains("#/components/schemas/ErrorAnswer"), "{found:?}");
        for reference in found {
            let pointer = reference.strip_prefix('#').unwrap();
            assert!(described.pointer(pointer).is_some(), "{reference} leads nowhere");
        }
    }
}
