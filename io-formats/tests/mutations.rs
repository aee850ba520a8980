//! Damaged text and binary files of every foreign format: any answer will do but a panic, and whatever is read is sound.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "test code")]

mod common;

use std::path::Path;

use common::{data_bytes, hair_bytes, tfx_bytes};
use io_formats::bvh::Bvh;
use io_formats::hair::parse_hair;
use io_formats::mesh::{parse_obj, parse_stl};
use io_formats::tfx::parse_tfx;
use io_formats::usc::parse_data;
use io_formats::{Groom, LengthUnit, Result, Scene, TriMesh};

/// Damaged copies tried per format.
const N_COPIES: u64 = 20_000;

const OBJ: &str = "mtllib a.mtl\no a\nv 0 0 0\nv 1 0 0 1 1 1\nv 1 1 0\nv 0 1 1e0\nvt 0 0\nvn 0 0 1\ng b\nusemtl c\n\
    f 1/1/1 2//1 3 4\nf -1 -2 -3\nl 1 2\np 1\ns off\n";
const STL: &str = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1e0 0\nendloop\n\
    endfacet\nendsolid a\n";
const BVH: &str = "HIERARCHY\nROOT a\n{\nOFFSET 0 1 2\nCHANNELS 3 Xrotation Yposition Zrotation\nJOINT b\n{\n\
    OFFSET 0 1 2\nCHANNELS 1 Yrotation\nEnd Site\n{\nOFFSET 1 1 1\n}\n}\n}\nMOTION\nFrames: 2\nFrame Time: 0.1\n\
    1 2 3 4\n5 6e0 7 -8\n";
const SCENE: &str = "name = \"a\"\n[groom]\nfile = \"a.hair\"\nunit = 2.5\nnegate = [\"x\"]\n[head]\nmesh = \"b.obj\"\n\
    unit = \"m\"\n[head.motion]\nkeys = [{ t = 0 }, { t = 1, rotate_deg = [1, 2, 3] }]\n[[solid]]\nname = \"c\"\n\
    shape = { kind = \"sphere\", radius_cm = 1 }\n";

/// Copies of `whole` with one to four bytes replaced, repeated or removed, always the same ones.
fn damaged(whole: &[u8]) -> impl Iterator<Item = Vec<u8>> {
    let pieces = [0, 0xFF, 0x7F, b'-', b'9', b'/', b' ', b'\n', b'e', b'{'];
    (1..=N_COPIES).map(move |seed| {
        let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let mut next = move |n: usize| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 33) as usize % n
        };
        let mut bytes = whole.to_vec();
        for _ in 0..=next(4) {
            let at = next(bytes.len());
            match next(4) {
                0 => bytes[at] ^= 1 << next(8),
                1 => bytes[at] = pieces[next(pieces.len())],
                2 => bytes.insert(at, bytes[next(bytes.len())]),
                _ => drop(bytes.drain(at..bytes.len().min(at + 1 + next(6)))),
            }
            if bytes.is_empty() {
                break;
            }
        }
        bytes
    })
}

fn sound_groom(groom: &Result<Groom>) {
    if let Ok(groom) = groom {
        assert_eq!(*groom.offsets().last().unwrap(), groom.points.len());
        assert!(groom.points.iter().flatten().all(|x| x.is_finite()));
        let _ = groom.resample(8);
    }
}

fn sound_mesh(mesh: &Result<TriMesh>) {
    if let Ok(mesh) = mesh {
        mesh.validate(here()).unwrap();
        let _ = mesh.is_closed();
    }
}

fn here() -> &'static Path {
    Path::new("damaged")
}

#[test]
fn damaged_grooms_never_panic() {
    for bytes in damaged(&hair_bytes()) {
        sound_groom(&parse_hair(here(), &bytes, LengthUnit::M));
    }
    for version in [3.0, 4.0] {
        for bytes in damaged(&tfx_bytes(version, 2, 4)) {
            sound_groom(&parse_tfx(here(), &bytes, LengthUnit::M));
        }
    }
    for bytes in damaged(&data_bytes()) {
        sound_groom(&parse_data(here(), &bytes, LengthUnit::M));
    }
}

#[test]
fn damaged_meshes_never_panic() {
    sound_mesh(&Ok(parse_obj(here(), OBJ.as_bytes(), LengthUnit::M).unwrap()));
    sound_mesh(&Ok(parse_stl(here(), STL.as_bytes(), LengthUnit::M).unwrap()));
    for bytes in damaged(OBJ.as_bytes()) {
        sound_mesh(&parse_obj(here(), &bytes, LengthUnit::M));
    }
    for bytes in damaged(STL.as_bytes()) {
        sound_mesh(&parse_stl(here(), &bytes, LengthUnit::M));
    }
}

#[test]
fn damaged_motions_never_panic() {
    Bvh::parse(here(), BVH.as_bytes()).unwrap();
    for bytes in damaged(BVH.as_bytes()) {
        if let Ok(bvh) = Bvh::parse(here(), &bytes) {
            for joint in 0..bvh.n_joints() {
                assert!(bvh.world_pose(bvh.n_frames() - 1, joint).rotation.coords.iter().all(|x| x.is_finite()));
                let _ = bvh.initial_jump_deg_per_s(joint);
            }
        }
    }
}

#[test]
fn damaged_scenes_never_panic() {
    Scene::from_toml(SCENE, here()).unwrap();
    for bytes in damaged(SCENE.as_bytes()) {
        if let Ok(scene) = Scene::from_toml(&String::from_utf8_lossy(&bytes), here()) {
            let _ = scene.head_motion();
        }
    }
}
