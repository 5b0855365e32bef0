//! Triangle meshes from files: Wavefront OBJ, STL (text and binary), PLY (text and binary, both byte orders), binary
//! glTF (GLB).
//!
//! Polygons are split as fans. Colours, normals, textures and materials are ignored.

use std::collections::BTreeSet;
use std::panic::catch_unwind;
use std::path::Path;

use glamx::{DMat4, DVec3};
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{DefaultElement, Encoding, Property};

use program::{ExitCode, Failure};

use crate::mesh::{CORNERS_MAX, Mesh, TRIANGLES_MAX};

/// Supported file extensions, in lower case.
pub(crate) const ENDINGS: [&str; 4] = ["obj", "stl", "ply", "glb"];
/// Reads a file's bytes.
type ReadMesh = fn(&[u8]) -> Result<Parts, String>;
/// The reader of each ending.
pub(crate) const READERS: [ReadMesh; 4] = [obj, stl, ply, glb];

/// Maximum file size.
pub(crate) const BYTES_MAX: u64 = 1 << 30;
/// Nodes of a glTF within nodes, at most.
const NODES_DEEP: usize = 100;

/// Why files cannot be read or used.
pub(crate) fn unusable(message: impl Into<String>) -> Failure {
    Failure::new(ExitCode::Config, message)
}

/// What is wrong in a file.
pub(crate) fn damaged(message: &str, file: &Path) -> Failure {
    Failure::new(ExitCode::Data, format!("{message}: {}", file.display()))
}

/// Corners in the file's units, and triangles as corner indices.
pub(crate) type Parts = (Vec<[f64; 3]>, Vec<[u32; 3]>);

/// Reads a mesh; one unit of the file is `scale_m` metres. If it was made of another file, `file` is that one, which
/// errors name.
///
/// # Errors
/// If the file cannot be read or is no mesh.
pub(crate) fn read_mesh(file: &Path, path: &Path, scale_m: f64) -> Result<Mesh, Failure> {
    let shown = file.display();
    let unread = |source| unusable(format!("failed to read it: {source}: {shown}"));
    let bytes = program::read(path, BYTES_MAX).map_err(unread)?;
    let ending = ending(path).unwrap_or_default();
    if ["urdf", "xml"].contains(&ending.as_str()) {
        let how = "pip install graspmill[descriptions], then run the same command";
        return Err(unusable(format!("the program of the Python package reads descriptions: {how}: {shown}")));
    }
    let Some(kind) = ENDINGS.iter().position(|one| *one == ending) else {
        let endings = ENDINGS.join(", .");
        return Err(unusable(format!("its name must end with .{endings}: {shown}")));
    };
    // A library that panics at one file must not end the others.
    let read = catch_unwind(|| READERS[kind](&bytes)).unwrap_or_else(|_| Err("its reader failed".to_owned()));
    let kind = ending.to_ascii_uppercase();
    let (corners, triangles) = read.map_err(|message| damaged(&format!("not a whole {kind} file: {message}"), file))?;
    Mesh::new(&corners, &triangles, scale_m).map_err(|message| damaged(&message, file))
}

/// The extension of a file's name in lower case.
pub(crate) fn ending(path: &Path) -> Option<String> {
    path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase())
}

/// The lines of an OBJ file that say where its triangles are; a backslash at its end continues a line. (Of texture and
/// normals faces may have any numbers; the library computes with them where there are such lines.)
fn geometry_of(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(bytes).replace("\\\r\n", " ").replace("\\\n", " ");
    let is_meant = |line: &&str| matches!(line.split_whitespace().next(), Some("v" | "f"));
    text.lines().filter(is_meant).flat_map(|line| [line, "\n"]).collect()
}

fn obj(bytes: &[u8]) -> Result<Parts, String> {
    let text = geometry_of(bytes);
    let options =
        tobj::LoadOptions { triangulate: true, ignore_points: true, ignore_lines: true, ..Default::default() };
    let no_materials = |_: &Path| Err(tobj::LoadError::OpenFileFailed);
    let (models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, no_materials).map_err(|e| e.to_string())?;
    let (mut corners, mut triangles) = (Vec::new(), Vec::new());
    for tobj::Model { mesh, .. } in models {
        let before = u32::try_from(corners.len()).map_err(|e| e.to_string())?;
        corners.extend(mesh.positions.chunks_exact(3).map(|p| [p[0], p[1], p[2]].map(f64::from)));
        triangles.extend(mesh.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]].map(|i| before.saturating_add(i))));
    }
    Ok((corners, triangles))
}

/// Bytes of a binary file's header, and of one triangle.
const STL_HEAD: usize = 84;
const STL_TRIANGLE: usize = 50;

fn stl(bytes: &[u8]) -> Result<Parts, String> {
    let promised = bytes.get(80..84).map_or(0, |n| u64::from(u32::from_le_bytes([n[0], n[1], n[2], n[3]])));
    let expected = STL_HEAD as u64 + promised * STL_TRIANGLE as u64;
    // Some binary files also begin with "solid", some have bytes after their triangles; letters as counts are huge.
    let is_binary = bytes.len() as u64 >= expected && (promised > 0 || bytes.len() == STL_HEAD);
    let corners = if is_binary {
        let (triangles, _) = bytes[STL_HEAD..expected as usize].as_chunks::<STL_TRIANGLE>();
        // After the normal; two bytes follow.
        triangles.iter().flat_map(|triangle| positions(triangle[12..48].as_chunks().0)).collect()
    } else if bytes.trim_ascii_start().get(..5).is_some_and(|start| start.eq_ignore_ascii_case(b"solid")) {
        text_stl(&String::from_utf8_lossy(bytes).to_ascii_lowercase())?
    } else {
        let got = bytes.len();
        return Err(format!("a binary one of {promised} triangles has {expected} bytes, got {got}"));
    };
    let count = corners.len() as u32 / 3; // files have less than a gigabyte
    Ok((corners, (0..count).map(|triangle| [3 * triangle, 3 * triangle + 1, 3 * triangle + 2]).collect()))
}

/// The corners of all facets of a text file, which may have several solids. The facets' normals are not used.
fn text_stl(text: &str) -> Result<Vec<[f64; 3]>, String> {
    let (mut corners, mut facets, mut is_open) = (Vec::new(), 0, false);
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            [] => {}
            [word, ..] if word.starts_with("solid") && is_open => {
                return Err("a solid begins before the last one ends".to_owned());
            }
            // The name may stand next to it.
            [word, ..] if word.starts_with("solid") => is_open = true,
            _ if !is_open => return Err(format!("the next line must begin with solid, got {line:?}")),
            ["facet" | "outer" | "endloop", ..] => {}
            ["vertex", x, y, z] => {
                let number = |word: &str| word.parse::<f32>().map_err(|e| format!("{e}: {line:?}")).map(f64::from);
                corners.push([number(x)?, number(y)?, number(z)?]);
            }
            ["endfacet", ..] if corners.len() == 3 * (facets + 1) => facets += 1,
            [word, ..] if word.starts_with("endsolid") && corners.len() == 3 * facets => is_open = false,
            _ => return Err(format!("a facet must have three corners and an end, got {line:?}")),
        }
    }
    if is_open { Err("it ends before its solid does".to_owned()) } else { Ok(corners) }
}

/// Points of three little-endian numbers each.
fn positions(words: &[[u8; 4]]) -> impl Iterator<Item = [f64; 3]> {
    words.chunks_exact(3).map(|p| [p[0], p[1], p[2]].map(|word| f32::from_le_bytes(word).into()))
}

fn ply(bytes: &[u8]) -> Result<Parts, String> {
    let parser = Parser::<DefaultElement>::new();
    let mut reader = Reader::new(bytes);
    let header = parser.read_header(&mut reader).map_err(|e| e.to_string())?;
    let mut rest = reader.into_inner();
    let (mut corners, mut triangles) = (Vec::new(), Vec::new());
    for (name, element) in &header.elements {
        // Each row takes at least one byte; otherwise a file of a hundred bytes could declare endless rows.
        if element.count > rest.len() || (element.properties.is_empty() && element.count > 0) {
            return Err(format!("its element `{name}` has more rows than there are bytes"));
        }
        for place in 0..element.count {
            let row = match header.encoding {
                Encoding::Ascii => parser.read_ascii_element(line_of(&mut rest)?, element),
                Encoding::BinaryBigEndian => parser.read_big_endian_element(&mut rest, element),
                Encoding::BinaryLittleEndian => parser.read_little_endian_element(&mut rest, element),
            };
            let row = row.map_err(|e| format!("{name} {place}: {e}"))?;
            match name.as_str() {
                "vertex" => {
                    let missing = || format!("vertex {place} must have x, y and z, each a float or double");
                    corners.push(position(&row).ok_or_else(missing)?);
                }
                "face" => fan(place, &ring(&row).ok_or("faces must have vertex_indices")?, &mut triangles)?,
                _ => {}
            }
        }
    }
    Ok((corners, triangles))
}

fn line_of<'a>(rest: &mut &'a [u8]) -> Result<&'a str, String> {
    let end = rest.iter().position(|byte| *byte == b'\n').map_or(rest.len(), |end| end + 1);
    let (line, after) = rest.split_at(end);
    *rest = after;
    if line.is_empty() { Err("it ends too early".to_owned()) } else { str::from_utf8(line).map_err(|e| e.to_string()) }
}

fn position(vertex: &DefaultElement) -> Option<[f64; 3]> {
    let coordinate = |axis: &str| match vertex.get(axis)? {
        Property::Float(value) => Some(f64::from(*value)),
        Property::Double(value) => Some(*value),
        _ => None,
    };
    Some([coordinate("x")?, coordinate("y")?, coordinate("z")?])
}

/// The corners' indices of a face.
fn ring(face: &DefaultElement) -> Option<Vec<i64>> {
    fn wide<N: Copy + Into<i64>>(ring: &[N]) -> Option<Vec<i64>> {
        Some(ring.iter().map(|index| (*index).into()).collect())
    }
    match face.get("vertex_indices").or_else(|| face.get("vertex_index"))? {
        Property::ListChar(ring) => wide(ring),
        Property::ListUChar(ring) => wide(ring),
        Property::ListShort(ring) => wide(ring),
        Property::ListUShort(ring) => wide(ring),
        Property::ListInt(ring) => wide(ring),
        Property::ListUInt(ring) => wide(ring),
        _ => None,
    }
}

/// The triangles of a polygon.
fn fan(place: usize, ring: &[i64], triangles: &mut Vec<[u32; 3]>) -> Result<(), String> {
    let number = |i: &i64| u32::try_from(*i).map_err(|_| format!("face {place} names corner {i}"));
    let ring = ring.iter().map(number).collect::<Result<Vec<_>, _>>()?;
    let [first, rest @ ..] = &ring[..] else { return Ok(()) };
    triangles.extend(rest.windows(2).map(|side| [*first, side[0], side[1]]));
    if triangles.len() > TRIANGLES_MAX {
        return Err(format!("it must have at most {TRIANGLES_MAX} triangles"));
    }
    Ok(())
}

/// The triangles of a binary glTF's scene, in its frame (y up).
fn glb(bytes: &[u8]) -> Result<Parts, String> {
    // The library takes 12 bytes from the length that the header says.
    if bytes.starts_with(b"glTF") && bytes.get(8..12).is_none_or(|said| said[0] < 12 && said[1..] == [0; 3]) {
        return Err("it must have a header that says its length".to_owned());
    }
    // What it requires explains all else that is missing. The library's own checks fail where an accessor is not there.
    let whole = gltf::Gltf::from_slice_without_validation(bytes).map_err(|e| e.to_string())?;
    if let Some(required) = whole.extensions_required().next() {
        return Err(format!("it requires {required}, which is not supported: write it without compression"));
    }
    let json = whole.as_json();
    let mut attributes = json.meshes.iter().flat_map(|mesh| &mesh.primitives).flat_map(|part| part.attributes.values());
    if attributes.any(|accessor| accessor.value() >= json.accessors.len()) {
        return Err("a primitive's accessors must be there".to_owned());
    }
    let gltf::Gltf { document, blob } = gltf::Gltf::from_slice(bytes).map_err(|e| e.to_string())?;
    if document.buffers().any(|buffer| matches!(buffer.source(), gltf::buffer::Source::Uri(_))) {
        return Err("its buffers must be in the file".to_owned());
    }
    let blob = blob.unwrap_or_default();
    let scene = document.default_scene().or_else(|| document.scenes().next()).ok_or("it must have a scene")?;
    let mut open: Vec<(gltf::Node<'_>, DMat4, usize)> = scene.nodes().map(|node| (node, DMat4::IDENTITY, 0)).collect();
    let (mut seen, (mut all, mut all_triangles)) = (BTreeSet::new(), Parts::default());
    while let Some((node, scene_from_parent, depth)) = open.pop() {
        if depth > NODES_DEEP || !seen.insert(node.index()) {
            return Err(format!("its nodes must be a tree of at most {NODES_DEEP} levels"));
        }
        let scene_from_node = scene_from_parent
            * DMat4::from_cols_array_2d(&node.transform().matrix().map(|column| column.map(f64::from)));
        open.extend(node.children().map(|child| (child, scene_from_node, depth + 1)));
        for primitive in node.mesh().into_iter().flat_map(|mesh| mesh.primitives()) {
            let (corners, triangles) = primitive_of(&primitive, &blob)?;
            let is_mirrored = scene_from_node.determinant() < 0.0;
            let turned = |[a, b, c]: [u32; 3]| if is_mirrored { [a, c, b] } else { [a, b, c] };
            let placed = |corner: [f64; 3]| scene_from_node.transform_point3(DVec3::from_array(corner)).to_array();
            // A file may name one mesh again and again.
            if all.len() + corners.len() > CORNERS_MAX || all_triangles.len() + triangles.len() > TRIANGLES_MAX {
                return Err(format!("it must have at most {TRIANGLES_MAX} triangles and {CORNERS_MAX} corners"));
            }
            let first = all.len() as u32;
            all.extend(corners.into_iter().map(placed));
            all_triangles.extend(triangles.into_iter().map(|t| turned(t.map(|corner| first.saturating_add(corner)))));
        }
    }
    Ok((all, all_triangles))
}

/// The bytes of each value of an accessor.
fn values<'a>(accessor: &gltf::Accessor<'_>, blob: &'a [u8]) -> Result<Vec<&'a [u8]>, String> {
    let all = || -> Option<Vec<&'a [u8]>> {
        let (view, size) = (accessor.view().filter(|_| accessor.sparse().is_none())?, accessor.size());
        let step = Some(view.stride().unwrap_or(size)).filter(|step| *step >= size)?;
        let bytes = blob.get(view.offset()..)?.get(..view.length())?.get(accessor.offset()..)?;
        (0..accessor.count()).map(|place| bytes.get(place.checked_mul(step)?..)?.get(..size)).collect()
    };
    let rule = "must lie within its view, that within the file, and it must not be sparse";
    all().ok_or_else(|| format!("accessor {} {rule}", accessor.index()))
}

/// The corners of a primitive in its node's frame, and its triangles.
fn primitive_of(primitive: &gltf::Primitive<'_>, blob: &[u8]) -> Result<Parts, String> {
    use gltf::accessor::{DataType, Dimensions};
    use gltf::mesh::Mode;
    let is_readable = |accessor: &gltf::Accessor<'_>| {
        accessor.data_type() == DataType::F32 && accessor.dimensions() == Dimensions::Vec3
    };
    let accessor = primitive.get(&gltf::Semantic::Positions).filter(is_readable);
    let accessor = accessor.ok_or("a primitive must have positions, three floats each")?;
    let corners: Vec<[f64; 3]> =
        values(&accessor, blob)?.into_iter().flat_map(|bytes| positions(bytes.as_chunks().0)).collect();
    let whole = |bytes: &[u8]| bytes.iter().rev().fold(0, |number, byte| number << 8 | u32::from(*byte));
    let indices: Vec<u32> = match primitive.indices() {
        Some(accessor) => {
            let is_readable = matches!(accessor.data_type(), DataType::U8 | DataType::U16 | DataType::U32)
                && accessor.dimensions() == Dimensions::Scalar;
            if !is_readable {
                return Err("a primitive's indices must be whole numbers without sign".to_owned());
            }
            values(&accessor, blob)?.into_iter().map(whole).collect()
        }
        None => (0..corners.len() as u32).collect(), // files have less than a gigabyte
    };
    let triangles = match primitive.mode() {
        Mode::Triangles => indices.as_chunks().0.to_vec(),
        Mode::TriangleStrip => {
            let turned = |(i, t): (usize, &[u32])| if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] };
            indices.windows(3).enumerate().map(turned).collect()
        }
        Mode::TriangleFan => {
            indices.get(1..).unwrap_or_default().windows(2).map(|t| [indices[0], t[0], t[1]]).collect()
        }
        Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => Vec::new(),
    };
    Ok((corners, triangles))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::closed_box;

    const SIZE: [f64; 3] = [0.25, 0.5, 1.0];

    fn read(name: &str, bytes: &[u8]) -> Result<Mesh, String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        read_mesh(&path, &path, 0.1).map_err(|e| e.to_string())
    }

    fn assert_is_the_box(mesh: &Mesh) {
        assert_eq!(mesh.corners_m.len(), 8);
        assert_eq!(mesh.triangles.len(), 12);
        assert!(mesh.seams.is_watertight());
        let [low, high] = mesh.bounds_m();
        let extents = (high - low).to_array();
        assert!(extents.iter().zip(SIZE).all(|(got, size)| (got - 0.1 * size).abs() < 1e-12), "{extents:?}");
    }

    fn obj_text() -> String {
        let (corners, _) = closed_box(SIZE);
        let mut text = String::from("# a box of quads\nmtllib none.mtl\no box\nusemtl red\n");
        corners.iter().for_each(|[x, y, z]| text += &format!("v {x} {y} {z}\n"));
        text + "f 1 3 4 2\nf 5/1 6/1 8/1 7/1\nf 1//2 2//2 6//2 5//2\ng other\nf 3 7 8 4\nf 1 5 7 3\nf -7 -5 -1 -3\n"
    }

    fn stl_bytes() -> Vec<u8> {
        let (corners, triangles) = closed_box(SIZE);
        let mut bytes = [b"solid but binary".as_slice(), &[0; 64]].concat();
        bytes.extend((triangles.len() as u32).to_le_bytes());
        for triangle in &triangles {
            bytes.extend([0; 12]);
            let corners = triangle.iter().flat_map(|i| corners[*i as usize]);
            bytes.extend(corners.flat_map(|x| (x as f32).to_le_bytes()));
            bytes.extend([0; 2]);
        }
        bytes
    }

    fn stl_text() -> String {
        let (corners, triangles) = closed_box(SIZE);
        let mut text = String::from("solid box\n");
        for triangle in &triangles {
            text += "facet normal 0 0 0\nouter loop\n";
            for [x, y, z] in triangle.map(|i| corners[i as usize]) {
                text += &format!("vertex {x} {y} {z}\n");
            }
            text += "endloop\nendfacet\n";
        }
        text + "endsolid box\n"
    }

    #[test]
    fn a_text_stl_may_hold_several_solids_and_none_of_them_is_lost() {
        let whole = stl_text();
        let facets: Vec<&str> = whole.split("facet normal 0 0 0").collect();
        let (first, second) = (facets[..7].join("facet normal nan 0 0"), facets[7..].join("facet normal 1 0 0"));
        let text = format!("  {first}endsolid\n\nsolid\nfacet normal 1 0 0{second}");
        assert_is_the_box(&read("a.stl", text.as_bytes()).unwrap());
        let cut = read("a.stl", &whole.as_bytes()[..whole.len() - 40]).unwrap_err();
        assert!(cut.contains("a.stl"), "{cut}");
        assert!(
            read("a.stl", text.replace("endsolid\n\n", "").as_bytes())
                .unwrap_err()
                .contains("before the last one ends")
        );
    }

    fn ply_text(count: usize) -> String {
        let (corners, triangles) = closed_box(SIZE);
        let mut text = format!(
            "ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty double y\nproperty float z\n\
             property uchar red\nelement face 12\nproperty list uchar int vertex_indices\nend_header\n"
        );
        corners.iter().for_each(|[x, y, z]| text += &format!("{x} {y} {z} 255\n"));
        triangles.iter().for_each(|[a, b, c]| text += &format!("3 {a} {b} {c}\n"));
        text
    }

    fn ply_bytes() -> Vec<u8> {
        let (corners, triangles) = closed_box(SIZE);
        let head = "ply\nformat binary_big_endian 1.0\nelement vertex 8\nproperty float x\nproperty float y\n\
                    property float z\nelement face 12\nproperty list uchar uint vertex_index\nend_header\n";
        let mut bytes = head.as_bytes().to_vec();
        bytes.extend(corners.iter().flatten().flat_map(|x| (*x as f32).to_be_bytes()));
        for triangle in &triangles {
            bytes.push(3);
            bytes.extend(triangle.iter().flat_map(|i| i.to_be_bytes()));
        }
        bytes
    }

    #[test]
    fn the_same_box_is_read_from_every_kind_of_file() {
        assert_is_the_box(&read("box.obj", obj_text().as_bytes()).unwrap());
        assert_is_the_box(&read("box.STL", &stl_bytes()).unwrap());
        assert_is_the_box(&read("box.stl", stl_text().as_bytes()).unwrap());
        assert_is_the_box(&read("box.ply", ply_text(8).as_bytes()).unwrap());
        assert_is_the_box(&read("box.ply", &ply_bytes()).unwrap());
    }

    #[test]
    fn files_that_are_cut_off_are_refused_and_named() {
        for (name, bytes) in [("box.stl", stl_bytes()), ("box.ply", ply_bytes())] {
            for end in (0..bytes.len()).step_by(7) {
                let message = read(name, &bytes[..end]).unwrap_err();
                assert!(message.contains("not a whole") && message.contains(name), "cut at {end}: {message}");
            }
        }
    }

    #[test]
    fn what_is_no_mesh_is_refused_with_the_reason() {
        let of = |name: &str, text: &str| read(name, text.as_bytes()).unwrap_err();
        assert!(of("a.obj", "").contains("it has no triangles"));
        assert!(of("a.obj", "v 0 0 0\nf 1 2 3\n").contains("not a whole OBJ file"));
        let not_a_number = obj_text().replace("v 0.25 0 0\n", "v nan 0 0\n");
        assert!(of("a.obj", &not_a_number).contains("coordinates must be numbers"), "{}", of("a.obj", &not_a_number));
        assert!(of("a.step", "x").contains("must end with .obj, .stl, .ply"));
        assert!(of("a.ply", &ply_text(1_000_000)).contains("more rows than there are bytes"));
        assert!(of("a.ply", &ply_text(8).replace("3 0 2 3", "3 0 2 -3")).contains("face 0 names corner -3"));
        let far = ply_text(8).replace("3 0 2 3", "3 0 2 99");
        assert!(of("a.ply", &far).contains("triangle 0 names corner 99"), "{}", of("a.ply", &far));
        let missing = read_mesh(Path::new("nowhere.obj"), Path::new("nowhere.obj"), 1.0).unwrap_err();
        assert!(
            missing.to_string().contains("failed to read it") && missing.exit_code() == ExitCode::Config,
            "{missing}"
        );
    }
}
