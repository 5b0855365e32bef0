//! Metrics for Prometheus. Labels come from fixed lists, so unknown paths create no new series.

use axum::http::StatusCode;
use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::{Registry, Unit};

/// Media type of [`Metrics::text`].
pub(super) const MEDIA_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// The service's paths; also the values of the label `endpoint`.
pub(super) const ENDPOINTS: [&str; 9] =
    ["/v1/plan", "/v1/model", "/predict", "/config", "/version", "/healthz", "/readyz", "/metrics", "/openapi.json"];

/// Upper bounds in seconds: a plan takes 10 to 40 ms on two cores; the larger ones cover overload.
const SECONDS: [f64; 12] = [0.005, 0.01, 0.02, 0.03, 0.05, 0.075, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0];
const GRASPS: [f64; 9] = [0.0, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0];

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct RequestLabels {
    endpoint: &'static str,
    status: u16,
}

/// The counters and the registry that prints them.
#[derive(Debug)]
pub(super) struct Metrics {
    registry: Registry,
    requests: Family<RequestLabels, Counter>,
    /// Requests that are not answered yet.
    pub(super) in_flight: Gauge,
    /// Plans refused because too many were waiting.
    pub(super) rejected: Counter,
    plan_seconds: Histogram,
    grasps: Histogram,
    empty_plans: Counter,
}

impl Metrics {
    pub(super) fn new() -> Self {
        let mut registry = Registry::with_prefix("planner");
        let (requests, in_flight, rejected) = (Family::default(), Gauge::default(), Counter::default());
        let (plan_seconds, grasps, empty_plans) = (Histogram::new(SECONDS), Histogram::new(GRASPS), Counter::default());
        registry.register("requests", "Requests answered, by endpoint and status", requests.clone());
        registry.register("requests_in_flight", "Requests not answered yet", in_flight.clone());
        registry.register("rejected_requests", "Plans refused because too many were waiting", rejected.clone());
        let what = "Time from body to plan, without the waiting time";
        registry.register_with_unit("plan_duration", what, Unit::Seconds, plan_seconds.clone());
        registry.register("grasps_per_plan", "Grasps of a plan", grasps.clone());
        registry.register("empty_plans", "Plans without a grasp", empty_plans.clone());
        Self { registry, requests, in_flight, rejected, plan_seconds, grasps, empty_plans }
    }

    /// Counts an answer.
    pub(super) fn answered(&self, path: &str, status: StatusCode) {
        let labels = RequestLabels { endpoint: endpoint_of(path), status: status.as_u16() };
        self.requests.get_or_create(&labels).inc();
    }

    /// Counts a plan.
    pub(super) fn planned(&self, seconds: f64, grasp_count: usize) {
        self.plan_seconds.observe(seconds);
        self.grasps.observe(grasp_count as f64);
        if grasp_count == 0 {
            self.empty_plans.inc();
        }
    }

    /// All metrics in the OpenMetrics text format.
    pub(super) fn text(&self) -> Result<String, std::fmt::Error> {
        let mut text = String::new();
        encode(&mut text, &self.registry)?;
        Ok(text)
    }
}

fn endpoint_of(path: &str) -> &'static str {
    ENDPOINTS.into_iter().find(|known| *known == path).unwrap_or("other")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_happened_stands_in_the_text() {
        let metrics = Metrics::new();
        metrics.answered("/v1/plan", StatusCode::OK);
        metrics.answered("/v1/plan", StatusCode::OK);
        metrics.answered("/wp-admin.php", StatusCode::NOT_FOUND);
        metrics.planned(0.015, 3);
        metrics.planned(0.5, 0);
        metrics.rejected.inc();
        let text = metrics.text().unwrap();
        for line in [
            "planner_requests_total{endpoint=\"/v1/plan\",status=\"200\"} 2",
            "planner_requests_total{endpoint=\"other\",status=\"404\"} 1",
            "planner_requests_in_flight 0",
            "planner_rejected_requests_total 1",
            "planner_plan_duration_seconds_count 2",
            "planner_plan_duration_seconds_bucket{le=\"0.02\"} 1",
            "planner_grasps_per_plan_sum 3.0",
            "planner_empty_plans_total 1",
            "# EOF",
        ] {
            assert!(text.lines().any(|written| written == line), "{line} is not in\n{text}");
        }
    }

    #[test]
    fn unknown_paths_make_no_series() {
        let metrics = Metrics::new();
        for at in 0..100 {
            metrics.answered(&format!("/{at}"), StatusCode::NOT_FOUND);
        }
        let series = metrics.text().unwrap().lines().filter(|line| line.starts_with("planner_requests_total")).count();
        assert_eq!(series, 1);
    }
}
