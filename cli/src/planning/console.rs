//! Terminal output.

use std::fmt::Write as _;

use planner::plan::{Plan, RankedGrasp};

/// Maximum number of grasps in the summary; the JSON has all.
const GRASPS_SHOWN: usize = 10;

/// The summary of a plan.
pub(crate) fn summary(plan: &Plan) -> String {
    let stages = plan.funnel.0.iter().map(|(name, count)| format!("{count} {}", name.replace('_', " ")));
    let mut text = format!("{}; {} objects\n", stages.collect::<Vec<_>>().join(", "), plan.objects.len());
    for warning in &plan.warnings {
        text += &format!("warning: {warning}\n");
    }
    if let Some(reason) = &plan.reason {
        text += &format!("no grasps: {reason}\n");
    } else {
        text += "rank  object  quality  rho, mm  width, mm   x, mm   y, mm   z, mm  from vertical\n";
        for ranked in plan.grasps.iter().take(GRASPS_SHOWN) {
            add_grasp(&mut text, ranked);
        }
        if plan.grasps.len() > GRASPS_SHOWN {
            text += &format!("and {} more\n", plan.grasps.len() - GRASPS_SHOWN);
        }
    }
    for (number, object) in plan.objects.iter().enumerate() {
        let at = object.centroid_m * 1e3;
        if let Some(reason) = &object.reason {
            text += &format!("object {number} at {:.0}, {:.0}, {:.0} mm: {reason}\n", at.x, at.y, at.z);
        }
    }
    let times: Vec<String> = plan.timings_ms.iter().map(|(stage, ms)| format!("{stage} {ms:.1}")).collect();
    text + &format!("ms: {}\n", times.join(", "))
}

fn add_grasp(text: &mut String, ranked: &RankedGrasp) {
    let or_dash = |value: Option<String>| value.unwrap_or_else(|| "-".to_owned());
    let pose = ranked.workspace_from_grasp;
    let at = pose.translation * 1e3;
    let down = -(pose.rotation * schema::Vec3::Z).z;
    // Writing into a String cannot fail.
    let _ = writeln!(
        text,
        "{:>4}{:>8}{:>9.3}{:>9}{:>11}{:>8.1}{:>8.1}{:>8.1}{:>12.0} deg{}",
        ranked.rank,
        or_dash(ranked.object.map(|object| object.to_string())),
        ranked.quality,
        or_dash(ranked.rho_m.map(|rho_m| format!("{:.1}", rho_m * 1e3))),
        or_dash(ranked.width_m.map(|width_m| format!("{:.1}", width_m * 1e3))),
        at.x,
        at.y,
        at.z,
        libm::acosf(down.clamp(-1.0, 1.0)).to_degrees(),
        ranked.doubt.map_or(String::new(), |doubt| format!("  {}", doubt.name().replace('_', " ")))
    );
}
