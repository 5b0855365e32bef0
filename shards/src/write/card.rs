//! The dataset card: `README.md` for the Hugging Face Hub and for users. Its columns come from the table of columns,
//! its snippets from `docs/reading.md`, which the tests run.

use std::fmt::Write as _;

use program::text::{grouped, percent, ratio};
use schema::{Approach, Rule};

use crate::format::summary::Manifest;
use crate::{DatasetInfo, Table};

const TITLE: &str = "Grasp attempts in simulation";
const READING: &str = include_str!("../../../docs/reading.md");

/// The Hub's value for an unspecified licence. Only the owners of the data can choose one; they edit the card, which is
/// then not overwritten.
const LICENCE: &str = "unknown";

/// The text of the card. The same dataset always has the same card.
pub(crate) fn card(info: &DatasetInfo, manifest: &Manifest) -> String {
    let totals = &manifest.totals;
    let lead = format!(
        "{attempts} parallel-jaw grasp attempts on {objects} objects in {scenes} random stacked scenes, executed in \
         physics and labelled by how they ended. Made by Graspmill \
         {version} from seed {seed}; `meta/info.json` holds everything needed to make it again, byte for byte.",
        attempts = grouped(totals.labels.attempts),
        objects = grouped(totals.objects),
        scenes = grouped(totals.scenes),
        version = info.code_version,
        seed = info.seed,
    );
    let labels = totals.labels;
    let held = format!(
        "Positives : negatives = **{}** ({} of attempts held the object). `graspmill dataset report` has outcomes, rules, sizes and \
         pictures.\n",
        ratio(labels.positives, labels.negatives()),
        percent(labels.positive_share())
    );
    let mut parts = vec![format!("# {TITLE}\n"), lead + "\n", held, "## Columns\n".to_owned()];
    for table in Table::ALL {
        parts.extend([format!("### {}\n", table.name()), table.described(info.form())]);
    }
    let has = |approach: Approach| Rule::all().any(|rule| rule.approach == approach && totals.rule(rule).attempts > 0);
    parts.extend(RULES.into_iter().filter(|(approach, _)| has(*approach)).map(|(_, text)| format!("{text}\n")));
    parts.extend((!info.models.is_empty()).then(|| format!("{MODELS}\n")));
    parts.push(format!("## Conventions\n\n{CONVENTIONS}\n"));
    format!("{}\n{}\n{}", front_matter(manifest), parts.join("\n"), nested(READING))
}

fn front_matter(manifest: &Manifest) -> String {
    let size = match manifest.totals.labels.attempts {
        0..1_000 => "n<1K",
        1_000..10_000 => "1K<n<10K",
        10_000..100_000 => "10K<n<100K",
        100_000..1_000_000 => "100K<n<1M",
        1_000_000..10_000_000 => "1M<n<10M",
        10_000_000..100_000_000 => "10M<n<100M",
        100_000_000..1_000_000_000 => "100M<n<1B",
        _ => "n>1B",
    };
    let mut text = format!(
        "---\npretty_name: {TITLE}\nlicense: {LICENCE}\ntask_categories:\n- robotics\ntags:\n- robotics\n- grasping\n\
         - simulation\n- parallel-jaw\n- tsdf\nsize_categories:\n- {size}\nconfigs:\n"
    );
    for table in Table::ALL {
        let name = table.name();
        let default = if table == Table::Attempts { "  default: true\n" } else { "" };
        let _ = write!(text, "- config_name: {name}\n{default}  data_files: \"{name}/*.parquet\"\n");
    }
    text.push_str("---\n");
    text
}

/// The meaning of some columns for grasps that no row of Appendix A drew.
const RULES: [(Approach, &str); 4] = [
    (
        Approach::Normal,
        "Rules that end in `_normal` are VGN's: the hand comes along the normal of a seen surface point, and several attempts in a row \
         share the point. There `approach_axis` and `closing_axis` are `normal`, `depth_m` is how far behind the surface the finger tips \
         end, and `turn_rad` is the yaw about the approach.",
    ),
    (
        Approach::Proposal,
        "Rules that end in `_proposal` are hands that touch what the cameras saw of their target, from any side, and stand free there. \
         Nothing but the pose is told of them: `approach_axis` and `closing_axis` are `proposal`, and the drawn values are 0.",
    ),
    (
        Approach::Displaced,
        "Rules that end in `_displaced` are hands that held another attempt of the same scene, moved and turned a little and executed again.",
    ),
    (
        Approach::Judged,
        "Rules that end in `_judged` are proposals that a judge, named by the digest of its weights in `meta/info.json`, held for the best \
         of their scene.",
    ),
];

const MODELS: &str = "\
The objects are models, and `shape` is a model's name. `models` in `meta/info.json` has them whole: mass, friction, and of each
convex part the corners in the object's frame. `size_x_m` and so on are the bounding box, `volume_m3` is the sum of the parts.";

const CONVENTIONS: &str = "\
SI units; a name carries its unit. Quaternions are xyzw. `workspace`: a cube, origin at a lower corner, z up. `grasp`:
origin midway between the finger tips, +z approach, +y closing; a half turn about z is the same grasp. Round objects
have flat facets everywhere. Frames, gripper and the attempt's procedure stand in `meta/info.json`.";

/// Markdown with every heading one level deeper, except inside code fences.
fn nested(markdown: &str) -> String {
    let mut in_fence = false;
    let mut text = String::with_capacity(markdown.len() + 64);
    for line in markdown.lines() {
        in_fence ^= line.starts_with("```");
        if line.starts_with('#') && !in_fence {
            text.push('#');
        }
        text.push_str(line);
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_go_down_and_code_stays() {
        assert_eq!(nested("# A\n```python\n# b\n```\n## C\n"), "## A\n```python\n# b\n```\n### C\n");
    }
}
