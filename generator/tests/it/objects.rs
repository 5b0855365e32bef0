//! User-defined objects: meshes to a catalogue, and a catalogue to a self-contained dataset.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use schema::ObjectShape;
use serde_json::Value;
use shards::{Dataset, FormatVersion};
use tempfile::TempDir;

use crate::{check_fails, check_ok, files, run, workshop};

/// VGN's config at a size for tests, with a catalogue.
fn config() -> String {
    let config = include_str!("../../../configs/generate/vgn.toml")
        .replace("shards = 64", "shards = 3")
        .replace("attempts = 200_000", "attempts = 72")
        .replace("attempts_per_scene = 60", "attempts_per_scene = 12")
        .replace("resolution = 40 ", "resolution = 16 ")
        .replace("[objects]\n", "[objects]\ncatalogue = \"my-objects.toml\"\n")
        .replace("counts = [1, 2, 3, 4, 5] ", "counts = [1, 2] ")
        .replace("count_weights = [1.0, 1.0, 1.3, 1.3, 1.3] ", "count_weights = [1.0, 1.0] ");
    assert!(config.contains("catalogue") && config.contains("attempts = 72"), "{config}");
    config
}

/// Corners and outward triangles of a polygon pushed along z, in millimetres.
fn prism(outline: &[[f64; 2]], cap: &[[usize; 3]], height: f64) -> (Vec<[f64; 3]>, Vec<[usize; 3]>) {
    let n = outline.len();
    let corners = [0.0, height].into_iter().flat_map(|z| outline.iter().map(move |[x, y]| [*x, *y, z])).collect();
    let mut triangles: Vec<[usize; 3]> = cap.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
    triangles.extend(cap.iter().map(|triangle| triangle.map(|i| i + n)));
    triangles.extend((0..n).flat_map(|i| [[i, (i + 1) % n, (i + 1) % n + n], [i, (i + 1) % n + n, i + n]]));
    (corners, triangles)
}

fn obj(path: &Path, (corners, triangles): (Vec<[f64; 3]>, Vec<[usize; 3]>)) {
    let mut text = String::new();
    corners.iter().for_each(|[x, y, z]| writeln!(text, "v {x} {y} {z}").unwrap());
    triangles.iter().for_each(|t| writeln!(text, "f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1).unwrap());
    fs::write(path, text).unwrap();
}

fn stl(path: &Path, (corners, triangles): (Vec<[f64; 3]>, Vec<[usize; 3]>)) {
    let mut bytes = vec![0; 80];
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        bytes.extend([0; 12]);
        bytes.extend(triangle.iter().flat_map(|i| corners[*i]).flat_map(|x| (x as f32).to_le_bytes()));
        bytes.extend([0; 2]);
    }
    fs::write(path, bytes).unwrap();
}

fn ply(path: &Path, (corners, triangles): (Vec<[f64; 3]>, Vec<[usize; 3]>)) {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        corners.len(),
        triangles.len()
    );
    corners.iter().for_each(|[x, y, z]| writeln!(text, "{x} {y} {z}").unwrap());
    triangles.iter().for_each(|[a, b, c]| writeln!(text, "3 {a} {b} {c}").unwrap());
    fs::write(path, text).unwrap();
}

const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [40.0, 0.0], [40.0, 40.0], [0.0, 40.0]];
const SQUARE_CAP: [[usize; 3]; 2] = [[0, 1, 2], [0, 2, 3]];
const ELL: [[f64; 2]; 6] = [[0.0, 0.0], [60.0, 0.0], [60.0, 20.0], [20.0, 20.0], [20.0, 60.0], [0.0, 60.0]];
const ELL_CAP: [[usize; 3]; 4] = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]];
const WEDGE: [[f64; 2]; 3] = [[0.0, 0.0], [50.0, 0.0], [0.0, 35.0]];

/// A folder with a config, and three meshes in millimetres in `meshes`.
fn with_meshes() -> TempDir {
    let dir = workshop(&config());
    let folder = dir.path().join("meshes");
    fs::create_dir(&folder).unwrap();
    obj(&folder.join("Cube.obj"), prism(&SQUARE, &SQUARE_CAP, 40.0));
    stl(&folder.join("ell.stl"), prism(&ELL, &ELL_CAP, 30.0));
    ply(&folder.join("wedge piece.ply"), prism(&WEDGE, &[[0, 1, 2]], 60.0));
    fs::write(folder.join("readme.txt"), "not a mesh").unwrap();
    dir
}

fn program(dir: &TempDir, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_generator")).current_dir(dir.path()).args(arguments).output().unwrap()
}

const IMPORT: [&str; 6] = ["import-objects", "meshes", "--scale", "0.001", "--out", "my-objects.toml"];

fn import(dir: &TempDir, more: &[&str]) -> Output {
    program(dir, &[&IMPORT[..], more].concat())
}

#[test]
fn meshes_are_measured_and_become_a_catalogue() {
    let dir = with_meshes();
    let told = check_ok(&import(&dir, &["--density", "1000", "--json"]));
    let objects: Value = serde_json::from_str(&told).unwrap();
    let object = |name: &str| {
        let all = objects["objects"].as_array().unwrap();
        all.iter().find(|object| object["name"] == name).unwrap_or_else(|| panic!("{name} in {told}"))
    };
    let near = |got: &Value, expected: f64| {
        let got = got.as_f64().unwrap();
        assert!((got / expected - 1.0).abs() < 1e-6, "{got} instead of {expected}");
    };
    let cube = object("cube");
    assert_eq!((&cube["triangles"], &cube["is_watertight"], &cube["parts"]), (&12.into(), &true.into(), &1.into()));
    near(&cube["volume_m3"], 0.04_f64.powi(3));
    near(&cube["mass_kg"], 0.064);
    near(&cube["smallest_width_m"], 0.04);
    for axis in 0..3 {
        near(&cube["extents_m"][axis], 0.04);
        near(&cube["centre_of_mass_m"][axis], 0.02);
        near(&cube["inertia_kg_m2"][axis], 0.064 * 0.04 * 0.04 / 6.0);
    }
    let ell = object("ell");
    near(&ell["volume_m3"], (0.06 * 0.02 + 0.04 * 0.02) * 0.03);
    assert!((2..=4).contains(&ell["parts"].as_u64().unwrap()), "{ell}");
    assert!((ell["parts_volume_share"].as_f64().unwrap() - 1.0).abs() < 0.05, "{ell}");
    assert!(ell["parts_inertia_difference"].as_f64().unwrap() < 0.05, "{ell}");
    assert!(ell["parts_overlap_share"].as_f64().unwrap() < 0.05, "{ell}");
    near(&object("wedge_piece")["volume_m3"], 0.5 * 0.05 * 0.035 * 0.06);
    assert_eq!(object("wedge_piece")["parts"], 1);
    for name in ["cube", "ell", "wedge_piece"] {
        assert_eq!(object(name)["warnings"], Value::Array(Vec::new()), "{name}");
    }

    let text = fs::read_to_string(dir.path().join("my-objects.toml")).unwrap();
    let catalogue = generator::catalogue::Catalogue::parse(&text, Path::new("x")).unwrap();
    assert_eq!(catalogue.names(), ["cube", "ell", "wedge_piece"]);
    // The same again, without overwriting a user's changes.
    check_ok(&import(&dir, &["--density", "1000"]));
    check_fails(&import(&dir, &["--mass", "0.2"]), 78, &["--force replaces it", "my-objects.toml"]);
    let table = check_ok(&import(&dir, &["--mass", "0.2", "--friction", "0.5", "--hulls-max", "1", "--force"]));
    assert!(table.contains("wedge_piece") && table.contains("warning: ell: the parts have"), "{table}");
    let text = fs::read_to_string(dir.path().join("my-objects.toml")).unwrap();
    assert_eq!(text.matches("mass_kg = 0.2\nfriction = 0.5\n").count(), 3, "{text}");
    assert_eq!(text.matches("[[object.part]]").count(), 3);
}

#[test]
fn what_is_odd_about_a_mesh_is_said() {
    let dir = with_meshes();
    let of = |file: &str, scale: &str| {
        let file = format!("meshes/{file}");
        program(&dir, &["import-objects", &file, "--mass", "1", "--scale", scale, "--out", "odd.toml", "--force"])
    };
    // Without --scale a cube of 40 mm is one of 40 m.
    check_fails(&of("Cube.obj", "1"), 78, &["at most 10 m long, got 40 m", "--scale 0.001", "Cube.obj"]);
    assert!(!dir.path().join("odd.toml").exists());
    let large = check_ok(&of("Cube.obj", "0.05"));
    for part in ["2.000 m long: if the file is in millimetres", "the hand opens 80.0 mm", "bounding box's diagonal"] {
        assert!(large.contains(part), "{part}: {large}");
    }
    let small = check_ok(&of("Cube.obj", "0.0001"));
    assert!(small.contains("4.000 mm long: if the file is in metres"), "{small}");
    let (corners, triangles) = prism(&SQUARE, &SQUARE_CAP, 40.0);
    let inwards = triangles.iter().map(|[a, b, c]| [*a, *c, *b]).chain([[0, 0, 1]]).collect();
    obj(&dir.path().join("meshes/inwards.obj"), (corners, inwards));
    let turned = check_ok(&of("inwards.obj", "0.001"));
    for part in ["triangles were inside out", "1 triangles without an area were dropped"] {
        assert!(turned.contains(part), "{part}: {turned}");
    }
}

#[test]
fn files_that_are_no_meshes_are_told_together() {
    let dir = with_meshes();
    let folder = dir.path().join("meshes");
    let (corners, triangles) = prism(&SQUARE, &SQUARE_CAP, 40.0);
    obj(&folder.join("open.obj"), (corners.clone(), triangles[1..].to_vec()));
    let told = check_ok(&import(&dir, &[]));
    assert!(told.contains("warning: open: not watertight: 3 edges do not belong to two triangles"), "{told}");
    fs::remove_file(dir.path().join("my-objects.toml")).unwrap();

    fs::write(folder.join("cut.stl"), b"0123456789").unwrap();
    fs::write(folder.join("empty.obj"), "").unwrap();
    obj(&folder.join("flat.obj"), prism(&SQUARE, &SQUARE_CAP, 0.0));
    let nan = corners.iter().map(|[x, y, z]| [*x, *y, if *z > 0.0 { f64::NAN } else { 0.0 }]).collect();
    obj(&folder.join("nan.obj"), (nan, triangles));
    let problems =
        ["4 of the files", "cut.stl", "it has no triangles", "empty.obj", "flat.obj", "must be numbers", "nan.obj"];
    check_fails(&import(&dir, &[]), 65, &problems);
    assert!(!dir.path().join("my-objects.toml").exists());

    obj(&folder.join("CUBE.obj"), prism(&SQUARE, &SQUARE_CAP, 40.0));
    check_fails(&import(&dir, &[]), 78, &["two files make an object called cube"]);
    check_fails(&program(&dir, &["import-objects", "nowhere.obj", "--out", "x.toml"]), 78, &["nowhere.obj"]);
    fs::create_dir(dir.path().join("nothing")).unwrap();
    check_fails(
        &program(&dir, &["import-objects", "nothing", "--out", "x.toml"]),
        78,
        &["there is no .obj or .stl or .ply"],
    );
    check_fails(&program(&dir, &["import-objects", "meshes", "--out", "x.toml", "--scale=-1"]), 2, &["above 0"]);
}

#[test]
fn a_dataset_of_own_objects_is_made_verified_and_repeated_from_itself_alone() {
    let dir = with_meshes();
    check_ok(&import(&dir, &[]));
    check_ok(&run(&dir, "one", &["--threads", "1"]));
    check_ok(&run(&dir, "two", &["--threads", "2"]));
    let at = |name: &str| dir.path().join(name);
    assert!(files(&at("one")) == files(&at("two")), "threads must not change bytes");
    // The catalogue and the meshes are not needed any more.
    fs::remove_file(at("my-objects.toml")).unwrap();
    fs::remove_dir_all(at("meshes")).unwrap();
    assert!(shards::verify(&at("one"), |_| ()).unwrap().is_ok());
    let text = check_ok(&program(&dir, &["repeat", "one"]));
    assert!(text.starts_with("72 attempts executed again") && text.contains(": 0 end otherwise"), "{text}");
    check_ok(&program(&dir, &["depth", "one", "--scene", "1", "--out", "scene-1"]));
    assert!(at("scene-1/depth-0.png").exists());

    let dataset = Dataset::open(&at("one")).unwrap();
    let info = dataset.info();
    assert_eq!(info.format_version, FormatVersion::MODELS);
    let names: Vec<&str> = info.models.iter().map(|model| model.name.as_str()).collect();
    assert_eq!(names, ["cube", "ell", "wedge_piece"]);
    let mut seen = [0; 3];
    for shard in 0..3 {
        for object in dataset.read_objects(shard).unwrap() {
            let ObjectShape::Model { number, model } = &object.shape else { panic!("{object:?}") };
            assert_eq!((object.mass_kg, object.friction), (model.mass_kg, model.friction));
            seen[usize::from(*number)] += 1;
        }
        let attempts = dataset.read_attempts(shard).unwrap();
        assert!(attempts.iter().all(|a| a.rule.name() == "model_normal" && a.closing.is_none()));
    }
    assert!(seen.iter().all(|count| *count > 0), "{seen:?}");
    let report = shards::report(&dataset).unwrap();
    assert!(report.labels.positives > 0, "{:?}", report.outcomes);
}

#[test]
fn a_config_says_what_is_wrong_with_its_catalogue() {
    let dir = with_meshes();
    check_ok(&import(&dir, &[]));
    let with = |from: &str, to: &str| {
        let config = config();
        assert!(config.contains(from), "{from}");
        fs::write(dir.path().join("config.toml"), config.replace(from, to)).unwrap();
        run(&dir, "ds", &["--shard-index", "0"])
    };
    check_fails(
        &with("sampler = \"vgn\"", "sampler = \"rules\""),
        78,
        &["1 problem", "objects.catalogue needs sampler = \"vgn\", or \"mixed\" without rules"],
    );
    check_fails(
        &with("my-objects.toml", "other.toml"),
        78,
        &["objects.catalogue: failed to read the objects", "other.toml"],
    );
    check_fails(&with("\"my-objects.toml\"", "7"), 78, &["objects.catalogue must be a text, got 7"]);
    check_fails(&with("catalogue = ", "catalog = "), 78, &["objects.catalog is no key of this file"]);
    let small = with("size_m = 0.30 ", "size_m = 0.06 ");
    check_fails(&small, 78, &["objects.catalogue: ell must fit into grid.size_m 0.06 in any pose"]);
    let unnamed = with("shapes = [\"cuboid\", \"cylinder\", \"tri_prism\", \"half_cylinder\"]\n", "");
    check_ok(&unnamed);
    // Facts about primitives are not written for models.
    let info = fs::read_to_string(dir.path().join("ds/meta/info.json")).unwrap();
    assert!(info.contains("\"format_version\": 2") && !info.contains("density_kg_m3"), "{info}");
    fs::remove_dir_all(dir.path().join("ds")).unwrap();
    check_ok(&with("\"my-objects.toml\"", "\"everyday\""));
}
