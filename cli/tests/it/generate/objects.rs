//! User-defined objects: meshes to a catalogue, and a catalogue to a self-contained dataset.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use generator::{Config, Overrides};
use schema::ObjectShape;
use serde_json::Value;
use settings::Document;
use shards::Dataset;
use tempfile::TempDir;

use super::{check_fails, check_ok, files, run, workshop};

/// VGN's config at a size for tests, with a catalogue.
fn config() -> String {
    let config = include_str!("../../../../configs/generate/vgn.toml")
        .replace("shards = 64", "shards = 3")
        .replace("attempts = 200_000", "attempts = 72")
        .replace("attempts_per_scene = 60", "attempts_per_scene = 12")
        .replace("resolution = 40 ", "resolution = 16 ")
        .replace("[objects]\n", "[objects]\ncatalogue = \"my-objects.toml\"\n")
        .replace("counts = [1, 2, 3, 4, 5] ", "counts = [1, 2] ")
        .replace("count_weights = [1.0, 1.0, 1.3, 1.3, 1.3] ", "count_weights = [1.0, 1.0] ");
    let (before, objects) = config.split_once("[objects]").unwrap();
    let (objects, after) = objects.split_once("\n[").unwrap();
    let is_for_primitives =
        |line: &&str| ["shapes", "size_m", "density", "friction"].iter().any(|key| line.starts_with(key));
    let objects = objects.lines().filter(|line| !is_for_primitives(line)).collect::<Vec<_>>().join("\n");
    let config = format!("{before}[objects]{objects}\n[{after}");
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
    Command::new(env!("CARGO_BIN_EXE_graspmill")).current_dir(dir.path()).args(arguments).output().unwrap()
}

const IMPORT: [&str; 7] = ["objects", "import", "meshes", "--scale", "0.001", "--out", "my-objects.toml"];

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
    let cube = object("Cube");
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
    near(&object("wedge_piece")["volume_m3"], 0.5 * 0.05 * 0.035 * 0.06);
    assert_eq!(object("wedge_piece")["parts"], 1);
    for name in ["Cube", "ell", "wedge_piece"] {
        assert_eq!(object(name)["warnings"], Value::Array(Vec::new()), "{name}");
    }

    let text = fs::read_to_string(dir.path().join("my-objects.toml")).unwrap();
    let catalogue = generator::catalogue::Catalogue::parse(&text, Path::new("x")).unwrap();
    assert_eq!(catalogue.names(), ["Cube", "ell", "wedge_piece"]);
    assert_eq!(text.matches("\n[object.mesh]\n").count(), 3, "{text}");
    // A user's changes are not overwritten, and the meshes not even read.
    let refused = program(&dir, &["objects", "import", "nowhere.obj", "--out", "my-objects.toml"]);
    check_fails(&refused, 78, &["--force replaces it", "my-objects.toml"]);
    let table = check_ok(&import(&dir, &["--mass", "0.2", "--friction", "0.5", "--hulls-max", "1", "--force"]));
    assert!(table.contains("wedge_piece") && table.contains("warning: ell: the parts have"), "{table}");
    let text = fs::read_to_string(dir.path().join("my-objects.toml")).unwrap();
    assert_eq!(text.matches("mass_kg = 0.2\nfriction = 0.5\n").count(), 3, "{text}");
    // What is to be its hull is seen as that.
    assert_eq!((text.matches("[[object.part]]").count(), text.matches("[object.mesh]").count()), (3, 0));
}

#[test]
fn what_is_odd_about_a_mesh_is_said() {
    let dir = with_meshes();
    let of = |file: &str, scale: &str| {
        let file = format!("meshes/{file}");
        let words = ["objects", "import", &file, "--mass", "1", "--scale", scale, "--out", "odd.toml", "--force"];
        program(&dir, &words)
    };
    // Without --scale a cube of 40 mm is one of 40 m.
    check_fails(&of("Cube.obj", "1"), 78, &["at most 10 m long, got 40 m", "--scale 0.001", "Cube.obj"]);
    assert!(!dir.path().join("odd.toml").exists());
    let (corners, triangles) = prism(&SQUARE, &SQUARE_CAP, 40.0);
    let inwards = triangles.iter().map(|[a, b, c]| [*a, *c, *b]).chain([[0, 0, 1]]).collect();
    obj(&dir.path().join("meshes/inwards.obj"), (corners, inwards));
    let turned = check_ok(&of("inwards.obj", "0.001"));
    assert!(turned.contains("triangles were inside out"), "{turned}");
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

    // What cannot be used is listed, and the others become objects.
    fs::write(folder.join("cut.stl"), b"0123456789").unwrap();
    fs::write(folder.join("empty.obj"), "").unwrap();
    obj(&folder.join("flat.obj"), prism(&SQUARE, &SQUARE_CAP, 0.0));
    let nan = corners.iter().map(|[x, y, z]| [*x, *y, if *z > 0.0 { f64::NAN } else { 0.0 }]).collect();
    obj(&folder.join("nan.obj"), (nan, triangles));
    let problems =
        ["left out", "cut.stl", "it has no triangles", "empty.obj", "flat.obj", "must be numbers", "nan.obj"];
    let partly = import(&dir, &["--json"]);
    check_fails(&partly, 66, &problems);
    let told: Value = serde_json::from_slice(&partly.stdout).unwrap();
    let count = |key: &str| told[key].as_array().unwrap().len();
    assert_eq!((count("objects"), count("left_out")), (4, 4), "{told}");
    assert_eq!(String::from_utf8_lossy(&partly.stderr).matches("flat.obj").count(), 1, "each once: {partly:?}");
    let text = fs::read_to_string(dir.path().join("my-objects.toml")).unwrap();
    let catalogue = generator::catalogue::Catalogue::parse(&text, Path::new("x")).unwrap();
    assert_eq!(catalogue.names(), ["Cube", "ell", "open", "wedge_piece"]);
    // The mass of an open mesh is that of its hull, here of the whole cube.
    let open = told["objects"].as_array().unwrap().iter().find(|object| object["name"] == "open").unwrap();
    assert!((open["mass_kg"].as_f64().unwrap() - 400.0 * 0.04_f64.powi(3)).abs() < 1e-6, "{open}");

    let only = |files: &[&str], more: &[&str]| {
        program(&dir, &[&["objects", "import"], files, &["--out", "x.toml"], more].concat())
    };
    let none = only(&["meshes/cut.stl", "meshes/flat.obj"], &[]);
    check_fails(&none, 65, &["none of the files can be used", "cut.stl", "flat.obj"]);
    assert_eq!(String::from_utf8_lossy(&none.stderr).matches("flat.obj").count(), 1, "each once: {none:?}");
    check_fails(&only(&["nowhere.obj"], &[]), 78, &["nowhere.obj"]);
    fs::create_dir(dir.path().join("nothing")).unwrap();
    check_fails(&only(&["nothing"], &[]), 78, &["there is no .obj, .stl, .ply, .glb, .urdf or MuJoCo .xml file"]);
    check_fails(&only(&["meshes"], &["--scale=-1"]), 2, &["above 0"]);
    assert!(!dir.path().join("x.toml").exists());
}

/// What CAD programs and other exporters write: all of these are the box of 60 x 40 x 30 mm.
#[test]
fn oddities_of_exporters_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("meshes");
    fs::create_dir(&folder).unwrap();
    let outline = [[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.0, 0.04]];
    let whole = || prism(&outline, &SQUARE_CAP, 0.03);
    let (corners, triangles) = whole();
    let mut text = "solid box\n".to_owned();
    let mut binary = [[0_u8; 80].as_slice(), &(triangles.len() as u32).to_le_bytes()].concat();
    for (place, triangle) in triangles.iter().enumerate() {
        text += "facet normal 0 0 1\nouter loop\n";
        binary.extend([0; 12]);
        for corner in triangle.map(|i| corners[i]) {
            writeln!(text, "vertex {} {} {}", corner[0], corner[1], corner[2]).unwrap();
            // One rounding step further in every other triangle.
            let stepped = corner.map(|x| f32::from_bits((x as f32).to_bits() + (place % 2) as u32));
            binary.extend(stepped.iter().flat_map(|x| x.to_le_bytes()));
        }
        text += "endloop\nendfacet\n";
        binary.extend([0; 2]);
    }
    text += "endsolid box\n";
    fs::write(folder.join("upper.stl"), text.to_uppercase()).unwrap();
    let latin = [b"solid \xe4\n".as_slice(), text.split_once('\n').unwrap().1.as_bytes()].concat();
    fs::write(folder.join("latin.stl"), latin).unwrap();
    fs::write(folder.join("text.stl"), text).unwrap();
    fs::write(folder.join("stepped.stl"), &binary).unwrap();
    fs::write(folder.join("trailing.stl"), [binary.as_slice(), b"0123456789"].concat()).unwrap();
    obj(&folder.join("plain.obj"), whole());
    let text = fs::read_to_string(folder.join("plain.obj")).unwrap();
    let broken: String =
        text.lines().map(|line| line.replacen(' ', " \\\n", usize::from(line.starts_with('f'))) + "\n").collect();
    fs::write(folder.join("continued.obj"), broken.replace("\\\n", "\\\r\n")).unwrap();
    fs::write(folder.join("usemtl.obj"), format!("mtllib\nusemtl \no\ng\ns\n{text}")).unwrap();
    let told = check_ok(&program(&dir, &["objects", "import", "meshes", "--scale", "1", "--out", "x.toml", "--json"]));
    let told: Value = serde_json::from_str(&told).unwrap();
    let objects = told["objects"].as_array().unwrap();
    assert_eq!(objects.len(), 8, "{told}");
    for object in objects {
        let volume_m3 = object["volume_m3"].as_f64().unwrap_or(0.0);
        assert!((volume_m3 - 72e-6).abs() < 1e-10, "{object}");
        assert_eq!(object["is_watertight"], true, "{object}");
    }
}

#[test]
fn shells_that_overlap_weigh_what_their_parts_do() {
    let dir = tempfile::tempdir().unwrap();
    let (corners, triangles) = prism(&SQUARE, &SQUARE_CAP, 40.0);
    let (far, _) = prism(&SQUARE, &SQUARE_CAP, 40.0);
    let far = far.into_iter().map(|[x, y, z]| [x + 20.0, y, z]);
    let more = triangles.iter().map(|t| t.map(|i| i + corners.len()));
    let both = (corners.iter().copied().chain(far).collect(), triangles.iter().copied().chain(more).collect());
    obj(&dir.path().join("crossed.obj"), both);
    let doubled = [triangles.clone(), triangles.clone()].concat();
    obj(&dir.path().join("doubled.obj"), (corners, doubled));
    let files = ["crossed.obj", "doubled.obj"];
    let told = program(
        &dir,
        &[&["objects", "import"], &files[..], &["--scale", "0.001", "--out", "x.toml", "--json"]].concat(),
    );
    let told: Value = serde_json::from_str(&check_ok(&told)).unwrap();
    let mass_kg = |place: usize| told["objects"][place]["mass_kg"].as_f64().unwrap();
    let union_kg = 400.0 * 0.06 * 0.04 * 0.04;
    assert!((mass_kg(0) / union_kg - 1.0).abs() < 0.05, "{told}");
    assert_eq!(told["objects"][0]["volume_m3"], Value::Null);
    assert!((mass_kg(1) - 400.0 * 0.04_f64.powi(3)).abs() < 1e-6, "{told}");
    assert!(told.to_string().contains("its shells overlap"), "{told}");
}

/// Each of these once kept the importer busy for minutes, or for ever.
#[test]
fn small_files_that_are_made_to_keep_it_busy_end() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("meshes");
    fs::create_dir(&folder).unwrap();
    let (corners, triangles) = prism(&SQUARE, &SQUARE_CAP, 0.04);
    let corners: Vec<[f64; 3]> = corners.into_iter().map(|[x, y, z]| [0.001 * x, 0.001 * y, z]).collect();
    obj(&folder.join("repeated.obj"), (corners.clone(), [triangles.as_slice(); 500].concat()));
    for name in ["a", "b", "c"] {
        std::os::unix::fs::symlink(&folder, folder.join(name)).unwrap();
    }
    let imported = ["objects", "import", "meshes", "--scale", "1", "--out", "x.toml", "--json", "--mass", "0.1"];
    let told: Value = serde_json::from_str(&check_ok(&program(&dir, &imported))).unwrap();
    let objects = told["objects"].as_array().unwrap();
    assert_eq!(objects.len(), 1, "once, though three links lead back: {told}");
    assert!(objects.iter().all(|object| object["triangles"] == 12), "what is there many times counts once: {told}");
}

#[test]
fn a_mass_that_no_object_has_names_the_unit() {
    let dir = with_meshes();
    let tiny = program(&dir, &["objects", "import", "meshes/Cube.obj", "--scale", "0.00001", "--out", "x.toml"]);
    check_fails(
        &tiny,
        78,
        &["between 0.1 g and 100 kg, got 0.000 g", "0.4 mm long with 0.00001 m a unit", "--scale", "Cube.obj"],
    );
}

#[test]
fn a_mesh_whose_size_single_precision_would_change_is_refused() {
    let dir = with_meshes();
    let (corners, triangles) = prism(&SQUARE, &SQUARE_CAP, 40.0);
    let far = corners.into_iter().map(|[x, y, z]| [x + 1e7, y, z]).collect();
    obj(&dir.path().join("far.obj"), (far, triangles));
    let refused = program(&dir, &["objects", "import", "far.obj", "--scale", "0.001", "--out", "x.toml"]);
    check_fails(&refused, 78, &["at most 100 m from the origin of its file, got 10000", "far.obj"]);
}

#[test]
fn the_unit_is_guessed_and_said() {
    let dir = with_meshes();
    let told = check_ok(&program(&dir, &["objects", "import", "meshes", "--out", "x.toml"]));
    assert!(told.contains("one unit of a mesh file is 0.001 m (guessed from the sizes; --scale decides)"), "{told}");
    assert!(told.contains("40.0 x 40.0 x 40.0"), "{told}");
    let told = check_ok(&import(&dir, &[]));
    assert!(told.contains("one unit of a mesh file is 0.001 m (--scale)"), "{told}");
}

#[test]
fn folders_within_folders_name_what_files_do_not() {
    let dir = with_meshes();
    for (name, height) in [("002_can", 40.0), ("025_mug", 20.0)] {
        let folder = dir.path().join("ycb").join(name).join("google_16k");
        fs::create_dir_all(&folder).unwrap();
        obj(&folder.join("textured.obj"), prism(&SQUARE, &SQUARE_CAP, height));
    }
    let told = check_ok(&program(&dir, &["objects", "import", "ycb", "--out", "x.toml", "--scale", "0.001"]));
    assert!(told.contains("40.0 x 40.0 x 40.0") && told.contains("40.0 x 40.0 x 20.0"), "{told}");
    let text = fs::read_to_string(dir.path().join("x.toml")).unwrap();
    assert!(text.contains("name = \"002_can\"\nmass_kg = 0.0256\nfriction = 0.8\n"), "{text}");
    assert!(text.contains("name = \"025_mug\"\nmass_kg = 0.0128\nfriction = 0.8\n"), "{text}");
    // The files of a shell's pattern have the same names, and the catalogue says which is which.
    let listed = ["ycb/025_mug/google_16k/textured.obj", "ycb/002_can/google_16k/textured.obj"];
    let one_by_one = ["objects", "import", "--scale", "0.001", "--out", "listed.toml"];
    check_ok(&program(&dir, &[&one_by_one[..], &listed].concat()));
    let text = fs::read_to_string(dir.path().join("listed.toml")).unwrap();
    for (name, file) in [("025_mug", listed[0]), ("002_can", listed[1])] {
        let entry = text.split("[[object]]").find(|entry| entry.contains(&format!("name = \"{name}\""))).unwrap();
        assert!(entry.contains(&format!("source = \"{file}, 0.001 m a unit")), "{entry}");
    }
}

#[test]
fn descriptions_are_left_out_and_named_with_who_reads_them() {
    let dir = with_meshes();
    fs::write(dir.path().join("meshes/robot.urdf"), "<robot/>").unwrap();
    fs::write(dir.path().join("meshes/model.xml"), "<?xml version='1.0'?>\n<mujoco>\n</mujoco>").unwrap();
    fs::write(dir.path().join("meshes/package.xml"), "<package/>").unwrap();
    let told = import(&dir, &[]);
    check_fails(&told, 66, &["the program of the Python package reads descriptions", "robot.urdf", "model.xml"]);
    assert!(!String::from_utf8_lossy(&told.stderr).contains("package.xml"));
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
    let text = check_ok(&program(&dir, &["dataset", "repeat", "one"]));
    assert!(text.starts_with("72 attempts executed again") && text.contains(": 0 end otherwise"), "{text}");

    let dataset = Dataset::open(&at("one")).unwrap();
    let info = dataset.info();
    let images = generator::depth_images(info, &dataset.read_scene(1).unwrap()).unwrap();
    assert!(!images.is_empty() && images.iter().all(|image| image.depth_m.iter().any(|depth_m| *depth_m > 0.3)));
    assert_eq!(info.format_version, 6);
    // What cameras see is the mesh, and the parts are near it.
    let triangles: Vec<usize> = info.models.iter().flat_map(|model| &model.mesh).map(|m| m.triangles().len()).collect();
    assert_eq!(triangles, [12, 20, 8]);
    let names: Vec<&str> = info.models.iter().map(|model| model.name.as_str()).collect();
    assert_eq!(names, ["Cube", "ell", "wedge_piece"]);
    let mut seen = [0; 3];
    for shard in 0..3 {
        for rows in dataset.rows(shard, false).unwrap().map(Result::unwrap) {
            for object in rows.objects {
                let ObjectShape::Model { number, model } = &object.shape else { panic!("{object:?}") };
                assert_eq!((object.mass_kg, object.friction), (model.mass_kg, model.friction));
                seen[usize::from(*number)] += 1;
            }
            assert!(rows.attempts.iter().all(|a| a.rule.name() == "model_normal" && a.closing.is_none()));
        }
    }
    assert!(seen.iter().all(|count| *count > 0), "{seen:?}");
    let report = inspect::report(&dataset).unwrap();
    assert!(report.labels.positives > 0, "{:?}", report.outcomes);
    assert!(report.shapes.iter().map(|group| &group.name).eq(&names), "{:?}", report.shapes);
    assert!(report.rules.iter().map(|group| &group.name).eq(&["model_normal"]), "{:?}", report.rules);
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
    check_fails(&with("catalogue = ", "catalog = "), 78, &["objects.catalog is an unknown key"]);
    let small = with("size_m = 0.30 ", "size_m = 0.06 ");
    check_fails(&small, 78, &["objects.catalogue: ell must fit into grid.size_m 0.06 in any pose"]);
    let of_primitives = with("[objects]\n", "[objects]\nshapes = [\"cuboid\"]\nsize_m = [0.03, 0.08]\n");
    check_fails(
        &of_primitives,
        78,
        &["objects.shapes must be left out", "objects.size_m must be left out beside objects.catalogue"],
    );
    check_ok(&with("[objects]", "[objects]"));
    // Facts about primitives are not written for models.
    let info = fs::read_to_string(dir.path().join("ds/meta/info.json")).unwrap();
    assert!(info.contains("\"format_version\": 6") && !info.contains("density_kg_m3"), "{info}");
    fs::remove_dir_all(dir.path().join("ds")).unwrap();
    check_ok(&with("\"my-objects.toml\"", "\"everyday\""));
}

/// Nothing comes to rest within so short a time but what falls flat.
#[test]
fn too_much_that_does_not_rest_is_refused() {
    let dir = with_meshes();
    check_ok(&import(&dir, &[]));
    let hasty = config().replace("time_s_max = 4.0", "time_s_max = 0.35").replace("attempts = 72", "attempts = 1800");
    assert!(hasty.contains("0.35") && hasty.contains("1800"));
    fs::write(dir.path().join("config.toml"), &hasty).unwrap();
    let refused = run(&dir, "refused", &[]);
    check_fails(&refused, 78, &["were thrown away, more than --rejected-max 0.1"]);
    assert!(!dir.path().join("refused/_SUCCESS").exists());
    check_ok(&run(&dir, "allowed", &["--rejected-max", "1"]));
    assert!(dir.path().join("allowed/_SUCCESS").exists());
}

#[test]
fn household_objects_come_by_name() {
    let dir = workshop("");
    let read = |catalogue: &str| {
        let text = config().replace("catalogue = \"my-objects.toml\"", &format!("catalogue = {catalogue}"));
        Config::read(Document::parse(&text, &dir.path().join("config.toml")).unwrap(), Overrides::default())
    };
    let text = generator::catalogue::built_in("household-held-out").unwrap();
    fs::write(dir.path().join("copy.toml"), text).unwrap();
    let named = read("\"household-held-out\"").unwrap().objects.catalogue;
    assert_eq!((named.bodies().len(), &named), (920, &read("\"copy.toml\"").unwrap().objects.catalogue));
    let faults = read("\"household\"").unwrap_err().to_string();
    assert!(faults.contains("failed to read the objects"), "{faults}");
}
