//! From the bytes of a body to the bytes of an answer; the only connection between the service and the planner.

use std::time::Instant;

use axum::http::StatusCode;
use serde::Serialize;

use super::fault::Fault;
use crate::timing::ms_since;
use crate::{Planner, input};

/// A serialised answer.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Planned {
    /// JSON.
    pub(super) body: Vec<u8>,
    /// Times of the stages in the format of the header `Server-Timing`.
    pub(super) server_timing: String,
}

impl Planned {
    /// An answer, the milliseconds until its request was read, and those of the plan's stages.
    pub(super) fn new(answer: &impl Serialize, parse_ms: f64, timings_ms: &[(&str, f64)]) -> Result<Self, Fault> {
        let body = serde_json::to_vec(answer).map_err(|_| Fault::internal())?;
        let stages = [("parse", parse_ms)].into_iter().chain(timings_ms.iter().copied());
        let server_timing: Vec<String> = stages.map(|(name, ms)| format!("{name};dur={ms:.2}")).collect();
        Ok(Self { body, server_timing: server_timing.join(", ") })
    }
}

/// Parses a request, plans, and serialises the answer.
pub(super) fn plan_bytes(planner: &Planner, body: &[u8]) -> Result<Planned, Fault> {
    let started = Instant::now();
    // Text that is not JSON is 400; JSON that is not a request or has wrong values is 422.
    let request = input::from_json(body, planner.grid).map_err(|error| {
        let status = if error.is_syntax() { StatusCode::BAD_REQUEST } else { StatusCode::UNPROCESSABLE_ENTITY };
        Fault::new(status, error.to_string())
    })?;
    let parse_ms = ms_since(started);
    let plan = planner.plan(&request.observation, &request.options);
    let mut plan = plan.map_err(|error| Fault::new(StatusCode::UNPROCESSABLE_ENTITY, error.to_string()))?;
    plan.warnings.extend(request.warnings);
    Planned::new(&plan, parse_ms, &plan.timings_ms)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timings_are_a_header() {
        let planned = Planned::new(&7, 1.234, &[("fuse", 10.0)]).unwrap();
        assert_eq!((&planned.body[..], &planned.server_timing[..]), (&b"7"[..], "parse;dur=1.23, fuse;dur=10.00"));
    }
}
