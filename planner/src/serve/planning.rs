//! From the bytes of a body to the bytes of an answer; the only connection between the service and the planner.

use std::time::Instant;

use axum::http::StatusCode;

use super::fault::Fault;
use crate::{Planners, input};

/// A serialised plan.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Planned {
    /// The plan in JSON.
    pub(super) body: Vec<u8>,
    /// Times of the stages in the format of the header `Server-Timing`.
    pub(super) server_timing: String,
}

/// Parses a request, plans, and serialises the answer.
pub(super) fn plan_bytes(planners: &Planners, body: &[u8]) -> Result<Planned, Fault> {
    let started = Instant::now();
    // Text that is not JSON is 400; JSON that is not a request or has wrong values is 422.
    let request = input::from_json(body, planners.own.grid).map_err(|error| {
        let status = if error.is_syntax() { StatusCode::BAD_REQUEST } else { StatusCode::UNPROCESSABLE_ENTITY };
        Fault::new(status, error.to_string())
    })?;
    let parsed_ms = started.elapsed().as_secs_f64() * 1e3;
    let planner = planners.of(request.config);
    let plan = planner.and_then(|planner| planner.plan(&request.observation, &request.options));
    let mut plan = plan.map_err(|error| Fault::new(StatusCode::UNPROCESSABLE_ENTITY, error.to_string()))?;
    plan.warnings.extend(request.warnings);
    Ok(Planned {
        body: serde_json::to_vec(&plan).map_err(|_| Fault::internal())?,
        server_timing: server_timing(std::iter::once(("parse", parsed_ms)).chain(plan.timings_ms.iter().copied())),
    })
}

pub(super) fn server_timing<'a>(stages: impl Iterator<Item = (&'a str, f64)>) -> String {
    stages.map(|(name, ms)| format!("{name};dur={ms:.2}")).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timings_are_a_header() {
        let stages = [("parse", 1.234), ("fuse", 10.0)];
        assert_eq!(server_timing(stages.into_iter()), "parse;dur=1.23, fuse;dur=10.00");
    }
}
