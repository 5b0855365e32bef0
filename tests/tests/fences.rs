//! Which crate may see which: ARCHITECTURE.md's arrows, held against what cargo really links.

use std::collections::BTreeSet;

use workspace_tests::{assert_none, cargo_tree, member_names};

/// A crate and its fence.
struct Room {
    name: &'static str,
    /// Members that it may link, directly or through others.
    sees: &'static [&'static str],
    /// Families of outside crates that it must not link: `arrow` stands for `arrow` and `arrow-…`.
    never: &'static [&'static str],
}

const PHYSICS: &[&str] = &["rapier3d", "parry3d"];
const LEARNING: &[&str] = &["burn"];
/// What talks to other machines: `shards` alone, and who reads through it.
const NETWORK: &[&str] = &["object_store", "reqwest", "hyper", "tokio"];

const ROOMS: &[Room] = &[
    Room { name: "schema", sees: &[], never: &["rapier3d", "parry3d", "arrow", "parquet", "burn"] },
    Room { name: "program", sees: &[], never: &["rapier3d", "parry3d", "arrow", "parquet", "burn"] },
    Room { name: "report", sees: &["schema"], never: &["rapier3d", "parry3d", "arrow", "parquet", "burn"] },
    Room { name: "shards", sees: &["schema", "program", "report"], never: &["rapier3d", "parry3d", "burn"] },
    Room { name: "simulator", sees: &["schema"], never: &["arrow", "parquet", "burn"] },
    Room { name: "perception", sees: &["schema"], never: &["rapier3d", "parry3d", "arrow", "parquet", "burn"] },
    Room {
        name: "generator",
        sees: &["schema", "program", "report", "shards", "simulator", "perception"],
        never: LEARNING,
    },
    Room { name: "trainer", sees: &["schema", "program", "report", "shards"], never: PHYSICS },
    Room { name: "planner", sees: &["schema", "program", "report", "shards", "perception", "trainer"], never: PHYSICS },
    Room {
        name: "experiments",
        sees: &["schema", "program", "report", "shards", "simulator", "perception", "trainer", "planner", "generator"],
        never: &[],
    },
    Room { name: "workspace-tests", sees: &[], never: &["rapier3d", "parry3d", "arrow", "parquet", "burn"] },
];

/// What of `tree` (lines of `cargo tree`) lies beyond the room's fence. A member's line ends with its folder, which
/// tells it from a stranger of the same name: there is a crate `generator` on crates.io, too.
fn trespasses(room: &Room, tree: &[String]) -> Vec<String> {
    let reads = room.name == "shards" || room.sees.contains(&"shards");
    let never: Vec<&str> = room.never.iter().chain(if reads { &[] } else { NETWORK }).copied().collect();
    let forbidden = |line: &&String| {
        let name = line.split(' ').next().unwrap_or_default();
        if line.contains("(/") {
            name != room.name && !room.sees.contains(&name)
        } else {
            let of =
                |family: &str| name.strip_prefix(family).is_some_and(|rest| rest.is_empty() || rest.starts_with('-'));
            never.iter().any(|family| of(family))
        }
    };
    tree.iter().filter(forbidden).map(|line| format!("{} must not see {line}", room.name)).collect()
}

#[test]
fn no_crate_sees_beyond_its_fence() {
    let members: BTreeSet<String> = member_names().into_iter().collect();
    let mut problems = Vec::new();
    let mut checked = BTreeSet::new();
    for room in ROOMS.iter().filter(|room| members.contains(room.name)) {
        checked.insert(room.name.to_owned());
        problems.extend(trespasses(room, &cargo_tree(&["-p", room.name, "-e", "normal"])));
    }
    assert_none("fences", &problems);
    assert_eq!(checked, members, "every member needs its row in ROOMS");
}

#[test]
fn a_fence_stops_what_it_should() {
    let check = |name: &str, line: &str| {
        let room = ROOMS.iter().find(|room| room.name == name).unwrap();
        trespasses(room, &[line.to_owned()]).is_empty()
    };
    assert!(check("trainer", "trainer v0.1.0 (/home/me/graspmill/trainer)"));
    assert!(check("trainer", "shards v0.1.0 (/home/me/graspmill/shards)"));
    assert!(check("trainer", "burn-core v0.22.1"));
    assert!(check("trainer", "generator v0.8.11"));
    assert!(!check("trainer", "generator v0.1.0 (/home/me/graspmill/generator)"));
    assert!(!check("trainer", "parry3d v0.31.1"));
    assert!(!check("schema", "arrow-array v60.1.0"));
    assert!(check("schema", "arrowhead v1.0.0"));
    assert!(check("trainer", "tokio v1.54.1"));
    assert!(!check("simulator", "tokio-util v0.7.20"));
}
