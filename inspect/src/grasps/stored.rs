//! Sets of grasps as `graspmill objects annotate` stores them: NAME.parquet and NAME.json.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use program::{Context as _, ExitCode, Failure};
use schema::{
    GraspSource, GripTest, Gripper, Margins, ObjectGrasp, ObjectGrasps, Outcome, PARTS_MAX, Polyhedron, Pose, Quat,
    StablePose, TriangleMesh, Vec3,
};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use shards::{PlainColumn, read_plain_table};

use super::{CONTACTS, TABLE};

/// The largest `NAME.json` that is read, and the most grasps.
const INFO_BYTES_MAX: u64 = 1 << 26;
pub(super) const GRASPS_MAX: usize = 1_000_000;
/// Quaternions have the length 1, up to this.
const LENGTH_ERROR_MAX: f32 = 1e-3;

/// The names of the sets in a folder, in order.
///
/// # Errors
/// [`Failure`] if the folder cannot be read.
pub fn grasp_sets(folder: &Path) -> Result<Vec<String>, Failure> {
    let names = program::names_in(folder).context(format_args!("failed to read {}", folder.display()))?;
    let stems = names.iter().filter_map(|name| name.strip_suffix(TABLE));
    let mut sets: Vec<String> =
        stems.filter(|stem| names.contains(&format!("{stem}.json"))).map(str::to_owned).collect();
    sets.sort();
    Ok(sets)
}

#[derive(Deserialize)]
struct Info {
    object: About,
    test: String,
    gripper: Gripper,
    coverage: Option<f32>,
    stable_poses: Vec<Stable>,
}

#[derive(Deserialize)]
struct About {
    name: String,
    file: String,
    scale_m: f64,
    #[serde(default)]
    warnings: Vec<String>,
    extents_m: [f32; 3],
    centre_of_mass_m: [f32; 3],
    parts_m: Vec<Vec<[f32; 3]>>,
    #[serde(default)]
    mesh: Option<Arc<TriangleMesh>>,
    mass_kg: f32,
    friction: f32,
}

#[derive(Deserialize)]
struct Stable {
    probability: f32,
    position_m: [f32; 3],
    quaternion_xyzw: [f32; 4],
}

/// The set of this name in a folder.
///
/// # Errors
/// [`Failure`] if a file cannot be read, is damaged, or says what cannot be.
pub fn read_grasp_set(folder: &Path, name: &str) -> Result<ObjectGrasps, Failure> {
    let path = folder.join(format!("{name}.json"));
    let wrong = |text: String, path: &Path| Failure::new(ExitCode::Data, format!("{text}: {}", path.display()));
    let bytes = program::read(&path, INFO_BYTES_MAX).context(format_args!("failed to read {}", path.display()))?;
    let info: Info = parse(&bytes).map_err(|text| wrong(text, &path))?;
    let rule = |what: &str| wrong(format!("{what} must be as graspmill objects annotate writes it"), &path);
    let test = GripTest::from_name(&info.test).ok_or_else(|| rule("test"))?;
    if let Some(fault) = info.gripper.faults().pop() {
        return Err(wrong(fault, &path));
    }
    let hull = |corners: &Vec<[f32; 3]>| {
        let corners_m: Vec<Vec3> = corners.iter().copied().map(Vec3::from_array).collect();
        let is_finite = corners_m.iter().all(|corner| corner.is_finite());
        Polyhedron::hull_of(&corners_m).ok().filter(|_| is_finite).ok_or_else(|| rule("object.parts_m"))
    };
    // What the file says cannot lead elsewhere.
    let table = folder.join(format!("{name}{TABLE}"));
    let About { name, file, scale_m, warnings, extents_m, centre_of_mass_m, parts_m, mesh, mass_kg, friction } =
        info.object;
    let is_solid = (1..=PARTS_MAX).contains(&parts_m.len()) && (mass_kg + friction).is_finite();
    if !(is_solid && mass_kg > 0.0 && friction >= 0.0) {
        return Err(rule("object"));
    }
    let parts = parts_m.iter().map(hull).collect::<Result<Vec<_>, _>>()?;
    let stable = |one: Stable| StablePose {
        table_from_object: pose(one.position_m, one.quaternion_xyzw),
        probability: one.probability,
    };
    let stable_poses: Vec<StablePose> = info.stable_poses.into_iter().map(stable).collect();
    let columns: BTreeMap<String, PlainColumn> = read_plain_table(&table, GRASPS_MAX)?.into_iter().collect();
    let grasps = grasps(&columns, stable_poses.len()).map_err(|text| wrong(text, &table))?;
    Ok(ObjectGrasps {
        name,
        file,
        scale_m,
        warnings,
        gripper: info.gripper,
        test,
        mass_kg,
        friction,
        extents_m: Vec3::from_array(extents_m),
        parts,
        mesh,
        centre_of_mass_m: Vec3::from_array(centre_of_mass_m),
        grasps,
        coverage: info.coverage,
        stable_poses,
    })
}

fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
    let value: Value = serde_json::from_slice(bytes).map_err(|error| format!("the file must be JSON, got {error}"))?;
    serde_json::from_value(value)
        .map_err(|error| format!("the file must be one of graspmill objects annotate: {error}"))
}

fn missing(name: &str) -> String {
    format!("the table must have the column {name}")
}

fn real<'a>(columns: &'a BTreeMap<String, PlainColumn>, name: &str) -> Result<&'a [Option<f32>], String> {
    match columns.get(name) {
        Some(PlainColumn::Real(values)) => Ok(values),
        _ => Err(missing(name)),
    }
}

/// The poses of a table's grasps.
pub(super) fn poses(columns: &BTreeMap<String, PlainColumn>) -> Result<Vec<Pose>, String> {
    let names = ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"];
    let place = names.iter().map(|name| real(columns, name)).collect::<Result<Vec<_>, _>>()?;
    let at = |row: usize| {
        let number = |column: &&[Option<f32>]| column.get(row).copied().flatten().filter(|number| number.is_finite());
        let at = place.iter().map(number).collect::<Option<Vec<f32>>>().ok_or("a grasp must have a pose")?;
        let at = pose([at[0], at[1], at[2]], [at[3], at[4], at[5], at[6]]);
        let is_rotation = (at.rotation.length() - 1.0).abs() <= LENGTH_ERROR_MAX;
        if is_rotation { Ok(at) } else { Err("a grasp must have a rotation".to_owned()) }
    };
    (0..place[0].len()).map(at).collect()
}

fn pose(position_m: [f32; 3], [x, y, z, w]: [f32; 4]) -> Pose {
    Pose::from_parts(Vec3::from_array(position_m), Quat::from_xyzw(x, y, z, w))
}

/// The rows of the table.
fn grasps(columns: &BTreeMap<String, PlainColumn>, stable_poses: usize) -> Result<Vec<ObjectGrasp>, String> {
    let real = |name: &str| real(columns, name);
    let text = |name: &str| match columns.get(name) {
        Some(PlainColumn::Text(values)) => Ok(values.as_slice()),
        _ => Err(missing(name)),
    };
    let all = |names: &[&str]| names.iter().map(|name| real(name)).collect::<Result<Vec<_>, _>>();
    let place = poses(columns)?;
    let contacts = [all(&CONTACTS[0])?, all(&CONTACTS[1])?];
    let (sources, outcomes, width) = (text("source")?, text("outcome")?, real("width_m")?);
    let motions = all(&["closing_moved_m", "closing_turned_rad", "test_moved_m", "test_turned_rad"])?;
    let margins = all(&["friction_min", "tug_max_g"])?;
    let unknown = vec![None; place.len()];
    let since = |name: &str, before: &str| match [name, before].into_iter().find(|one| columns.contains_key(*one)) {
        Some(there) => real(there),
        None => Ok(unknown.as_slice()),
    };
    // Up to 0.3.0 the share of the repeats of grasps that held.
    let p_held = since("p_held", "robust_share")?;
    let (clearance, pushed) = (since("clearance_m", "")?, since("pushed_m", "")?);
    let Some(PlainColumn::Whole(free)) = columns.get("free_on_table") else { return Err(missing("free_on_table")) };
    let vector = |of: &[&[Option<f32>]], row: usize| Some(Vec3::new(of[0][row]?, of[1][row]?, of[2][row]?));
    let grasp = |row: usize| {
        let motion = |first: usize| Some((motions[first][row]?, motions[first + 1][row]?));
        Ok(ObjectGrasp {
            object_from_grasp: place[row],
            source: GraspSource::from_name(&sources[row]).ok_or("a source must be known")?,
            outcome: Outcome::from_name(&outcomes[row]).ok_or("an outcome must be known")?,
            width_m: width[row],
            contacts_m: [0, 1].map(|side: usize| vector(&contacts[side][..3], row)),
            normals: [0, 1].map(|side: usize| vector(&contacts[side][3..], row)),
            closing: motion(0),
            test: motion(2),
            margins: margins[1][row].map(|tug_max_g| Margins { friction_min: margins[0][row], tug_max_g }),
            clearance_m: clearance[row],
            pushed_m: pushed[row],
            p_held: p_held[row],
            is_free_on_table: (0..stable_poses)
                .map(|bit| free[row].checked_shr(bit as u32).unwrap_or(0) & 1 == 1)
                .collect(),
        })
    };
    (0..outcomes.len()).map(grasp).collect()
}

#[cfg(test)]
pub(super) mod tests {
    use shards::plain_table;

    use super::*;
    use crate::grasps::{grasp_columns, grasps_info, grasps_table};

    /// A cube with a mesh of one of its sides.
    pub(in crate::grasps) fn set() -> ObjectGrasps {
        let corner = |c: u8| Vec3::new(f32::from(c & 1), f32::from(c >> 1 & 1), f32::from(c >> 2 & 1)) * 0.05;
        let corners_m: Vec<Vec3> = (0..8).map(corner).collect();
        let grasp = |number: u8| {
            let outcome = Outcome::ALL[usize::from(number) % Outcome::ALL.len()];
            let is_closed = number.is_multiple_of(2);
            let at_m = Vec3::splat(f32::from(number) * 1e-3);
            ObjectGrasp {
                object_from_grasp: Pose::from_translation(at_m),
                source: GraspSource::ALL[usize::from(number) % GraspSource::ALL.len()],
                outcome,
                width_m: is_closed.then_some(0.03),
                contacts_m: [is_closed.then_some(at_m), None],
                normals: [is_closed.then_some(Vec3::X), None],
                closing: is_closed.then_some((0.001, 0.1)),
                test: is_closed.then_some((0.002, 0.2)),
                margins: is_closed.then_some(Margins { friction_min: None, tug_max_g: 0.5 }),
                clearance_m: Some(0.001 * f32::from(number)),
                pushed_m: is_closed.then_some(0.0015),
                p_held: is_closed.then_some(0.25),
                is_free_on_table: vec![is_closed, true],
            }
        };
        let stable = |probability: f32| StablePose { table_from_object: Pose::IDENTITY, probability };
        ObjectGrasps {
            name: "cube".to_owned(),
            file: "cube.obj".to_owned(),
            scale_m: 0.001,
            warnings: vec!["one unit of its file is 0.001 m".to_owned()],
            gripper: Gripper::from_toml(Gripper::BUILT_IN[0].1).unwrap(),
            test: GripTest::Tug,
            mass_kg: 0.1,
            friction: 0.8,
            extents_m: Vec3::splat(0.05),
            parts: vec![Polyhedron::hull_of(&corners_m).unwrap()],
            mesh: Some(Arc::new(TriangleMesh::new(&corners_m[..4], vec![[0, 1, 2], [2, 1, 3]]).unwrap())),
            centre_of_mass_m: Vec3::splat(0.025),
            grasps: (0..12).map(grasp).collect(),
            coverage: Some(0.5),
            stable_poses: vec![stable(0.75), stable(0.25)],
        }
    }

    #[test]
    fn a_set_is_read_as_it_was_written_and_damage_is_an_error() {
        let (set, place) = (set(), tempfile::tempdir().unwrap());
        let write = |name: &str, bytes: &[u8]| std::fs::write(place.path().join(name), bytes).unwrap();
        let info = grasps_info(&set).to_string();
        write("cube.json", info.as_bytes());
        write("other.json", b"{}");
        write("cube.parquet", &grasps_table(&set).unwrap());
        assert_eq!(grasp_sets(place.path()).unwrap(), ["cube"]);
        let read = read_grasp_set(place.path(), "cube").unwrap();
        assert_eq!((&read.grasps, &read.mesh), (&set.grasps, &set.mesh));
        assert_eq!(grasps_table(&read).unwrap(), grasps_table(&set).unwrap());
        // As 0.3.0 wrote it.
        let mut columns = grasp_columns(&set);
        columns.retain(|(name, _)| !["clearance_m", "pushed_m"].contains(name));
        columns.iter_mut().filter(|(name, _)| *name == "p_held").for_each(|(name, _)| *name = "robust_share");
        write("cube.parquet", &plain_table(columns).unwrap());
        let lacks = |grasp: &ObjectGrasp| ObjectGrasp { clearance_m: None, pushed_m: None, ..grasp.clone() };
        let expected: Vec<ObjectGrasp> = set.grasps.iter().map(lacks).collect();
        assert_eq!(read_grasp_set(place.path(), "cube").unwrap().grasps, expected);
        // A hull that is made again may have its corners in another order.
        let without_parts = |set: &ObjectGrasps| {
            let mut info = grasps_info(set);
            let parts = info["object"].as_object_mut().unwrap().remove("parts_m").unwrap();
            let mut corners: Vec<String> = parts[0].as_array().unwrap().iter().map(ToString::to_string).collect();
            corners.sort();
            (info, corners)
        };
        assert_eq!(without_parts(&read), without_parts(&set));
        for (from, to, said) in [
            ("\"tug\"", "\"pull\"", "test"),
            ("\"mass_kg\":", "\"mass\":", "mass_kg"),
            ("0 1 2 2 1 3", "0 1 2 2 1 4", "a mesh's triangles must name its 4 corners from 0, got 4"),
            ("\"parts_m\":[[", "\"parts_m\":[[],[", "parts_m"),
            ("\"finger_force_n\":20.0", "\"finger_force_n\":-1.0", "finger_force_n must be between"),
        ] {
            assert!(info.contains(from), "{from}: {info}");
            write("cube.json", info.replace(from, to).as_bytes());
            let error = read_grasp_set(place.path(), "cube").unwrap_err();
            assert_eq!(error.exit_code(), ExitCode::Data, "{error}");
            assert!(error.to_string().contains(said), "{error}");
        }
        write("cube.json", info.replace("\"name\":\"cube\"", "\"name\":\"../cube\"").as_bytes());
        assert_eq!(read_grasp_set(place.path(), "cube").unwrap().grasps, expected);
        let mut turned = set;
        turned.grasps[3].object_from_grasp.rotation = Quat::from_xyzw(0.0, 0.0, 0.0, 1e30);
        write("cube.parquet", &grasps_table(&turned).unwrap());
        let error = read_grasp_set(place.path(), "cube").unwrap_err();
        assert_eq!(error.exit_code(), ExitCode::Data, "{error}");
        assert!(error.to_string().contains("a grasp must have a rotation"), "{error}");
    }
}
