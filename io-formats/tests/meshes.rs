//! Laws of meshes and their readers, on hand-made input.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "test code")]

use std::path::Path;

use io_formats::mesh::{parse_obj, parse_stl};
use io_formats::{Error, LengthUnit, TriMesh, read_mesh, write_obj};

fn here() -> &'static Path {
    Path::new("test")
}

const TETRAHEDRON: &str = "v 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nv 0 0 1\r\nf 1 3 2\r\nf 1 2 4\r\nf 2 3 4\r\nf 1 4 3\r\n";

fn tetrahedron() -> TriMesh {
    parse_obj(here(), TETRAHEDRON.as_bytes(), LengthUnit::Cm).unwrap()
}

fn volume(mesh: &TriMesh) -> f32 {
    let det = |[a, b, c]: [[f32; 3]; 3]| {
        a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    mesh.triangles.iter().map(|t| det(t.map(|v| mesh.vertices[v as usize]))).sum::<f32>() / 6.0
}

fn binary_stl(mesh: &TriMesh) -> Vec<u8> {
    let mut b = vec![0; 80];
    b.extend_from_slice(&(mesh.triangles.len() as u32).to_le_bytes());
    for t in &mesh.triangles {
        b.extend_from_slice(&[0; 12]);
        for x in t.iter().flat_map(|&v| mesh.vertices[v as usize]) {
            b.extend_from_slice(&x.to_le_bytes());
        }
        b.extend_from_slice(&[0; 2]);
    }
    b
}

#[test]
fn a_tetrahedron_is_closed_and_without_one_face_has_three_boundary_edges() {
    let mut mesh = tetrahedron();
    assert_eq!((mesh.vertices.len(), mesh.triangles.len()), (4, 4));
    assert!(mesh.is_closed());
    mesh.triangles.pop();
    assert_eq!(mesh.boundary_edge_count(), 3);
    assert!(!TriMesh::default().is_closed());
}

#[test]
fn a_face_turned_round_opens_the_mesh() {
    let mut mesh = tetrahedron();
    mesh.triangles[0].swap(0, 1);
    assert_eq!(mesh.boundary_edge_count(), 3);
}

#[test]
fn seams_are_merged_and_polygons_become_triangles() {
    let text = "o a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\no b\nv 1 0 0 1 0.5 0\nv 2 0 0\nv 2 1 0\nv 1 1 -0\n\
                f -4/1/1 -3//2 -2 -1\nf 1 1 2\nl 1 2\n";
    let text = format!("vt 0 0\nvn 0 0 1\nvn 0 0 1\n{text}");
    let mesh = parse_obj(here(), text.as_bytes(), LengthUnit::Cm).unwrap();
    assert_eq!((mesh.vertices.len(), mesh.triangles.len()), (6, 4));
    assert_eq!(mesh.boundary_edge_count(), 6);
}

#[test]
fn corners_that_differ_in_the_last_bits_are_one_vertex_and_others_stay_apart() {
    let mut bytes = binary_stl(&tetrahedron().scaled(1.7));
    // The same corner, computed a little differently in each triangle.
    for i in 0..12 {
        let at = 84 + 50 * (i / 3) + 12 + 12 * (i % 3);
        let x = f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        bytes[at..at + 4].copy_from_slice(&(x + (i as f32 - 6.0) * 1e-7).to_le_bytes());
    }
    let mesh = parse_stl(here(), &bytes, LengthUnit::Cm).unwrap();
    assert!(mesh.is_closed());
    assert_eq!(mesh.vertices.len(), 4);
    // A ten-thousandth of the size is a feature.
    let thin = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1e-4\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";
    assert_eq!(parse_obj(here(), thin.as_bytes(), LengthUnit::Cm).unwrap().vertices.len(), 4);
}

#[test]
fn a_mirrored_mesh_still_faces_outwards() {
    let mesh = tetrahedron();
    assert!(volume(&mesh) > 0.0);
    let mirrored = mesh.transformed(2.0, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]], [3.0, 0.0, 0.0]);
    assert!((volume(&mirrored) - 8.0 * volume(&mesh)).abs() < 1e-4);
    assert_eq!(mirrored.bounds(), Some(([3.0, 0.0, -2.0], [5.0, 2.0, 0.0])));
    assert!((volume(&mesh.scaled(-1.0)) - volume(&mesh)).abs() < 1e-6);
}

#[test]
fn binary_and_ascii_stl_give_the_same_mesh() {
    let mesh = tetrahedron();
    let binary = parse_stl(here(), &binary_stl(&mesh), LengthUnit::Inch).unwrap();
    assert!(binary.is_closed());
    assert_eq!(binary.bounds(), Some(([0.0; 3], [2.54; 3])));
    let mut text = String::from("solid t\n");
    for t in &mesh.triangles {
        text += "facet normal 0 0 0\nouter loop\n";
        for [x, y, z] in t.map(|v| mesh.vertices[v as usize]) {
            text += &format!("vertex {x} {y} {z}\n");
        }
        text += "endloop\nendfacet\n";
    }
    text += "endsolid t\n";
    assert_eq!(parse_stl(here(), text.as_bytes(), LengthUnit::Inch).unwrap(), binary);
    // No cut of a text file may panic; what is left after a whole line may still be a smaller mesh.
    for n in 0..text.len() {
        if let Ok(part) = parse_stl(here(), &text.as_bytes()[..n], LengthUnit::Cm) {
            part.validate(here()).unwrap();
        }
    }
}

#[test]
fn every_cut_of_a_binary_stl_is_refused_and_a_count_beyond_the_file_too() {
    let whole = binary_stl(&tetrahedron());
    for n in 0..whole.len() {
        let error = parse_stl(here(), &whole[..n], LengthUnit::Cm).unwrap_err();
        assert!(matches!(error, Error::Truncated { .. }), "{n} bytes: {error}");
    }
    let mut lying = whole;
    lying[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    let error = parse_stl(here(), &lying, LengthUnit::Cm).unwrap_err().to_string();
    assert!(error.contains("triangles at byte 84"), "{error}");
    // A binary file whose free text begins like an ASCII file must not be trusted either.
    lying[..5].copy_from_slice(b"solid");
    assert!(parse_stl(here(), &lying, LengthUnit::Cm).is_err());
}

#[test]
fn no_cut_of_an_obj_panics_and_what_is_read_is_sound() {
    for n in 0..TETRAHEDRON.len() {
        if let Ok(part) = parse_obj(here(), &TETRAHEDRON.as_bytes()[..n], LengthUnit::Cm) {
            part.validate(here()).unwrap();
            assert!(part.triangles.len() <= 4);
        }
    }
}

#[test]
fn an_obj_with_bad_indices_or_numbers_is_refused() {
    for (text, expected) in [
        ("", "no triangles"),
        ("v 0 0 0\n", "no triangles"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "line 4: \"4\" names none of the 3 vertices"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999999999999\n", "line 4"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -9223372036854775808\n", "line 4"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "line 4"),
        ("f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n", "line 1"),
        ("v 0 0 NaN\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "triangle 0 is not finite"),
        ("v 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "line 1: a vertex needs three"),
        ("v 0 0 0\nv 1 x 0\nv 0 1 0\nf 1 2 3\n", "line 2: \"x\" is not a number"),
        ("v 0 0 0\nv 0 0 0\nv 0 1 0\nf 1 2 3\n", "no triangles"),
    ] {
        let error = parse_obj(here(), text.as_bytes(), LengthUnit::Cm).unwrap_err().to_string();
        assert!(error.contains(expected), "{text:?}: {error}");
    }
}

#[test]
fn writing_and_reading_an_obj_returns_the_same_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.OBJ");
    let mesh = tetrahedron().scaled(0.123_456_79);
    write_obj(&path, &mesh).unwrap();
    let back = read_mesh(&path, LengthUnit::Cm).unwrap();
    assert!(back.is_closed());
    assert_eq!(back.bounds(), mesh.bounds());
    let broken = TriMesh { triangles: vec![[0, 1, 9]], ..mesh };
    assert!(write_obj(&path, &broken).unwrap_err().to_string().contains("triangle 0"));
}
