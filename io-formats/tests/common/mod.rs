//! Helpers of the format tests: small hand-made files, and where third-party data lies when it is there.
#![allow(dead_code, reason = "each test program uses some of them")]
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "test code")]

use std::path::{Path, PathBuf};

use io_formats::{MaterialRecord, SkinningModel, WeightPoly};

/// Third-party files are not part of the repository; a test that needs one is skipped where they are absent.
pub fn shared_data(relative: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data").join(relative);
    if path.exists() {
        return Some(path);
    }
    eprintln!("skipped: {relative} is not here");
    None
}

/// A `.hair` file of two strands with 3 and 2 points, with a segment array.
pub fn hair_bytes() -> Vec<u8> {
    let mut b = hair_header(2, 5, 3, 0);
    b.extend_from_slice(&2_u16.to_le_bytes());
    b.extend_from_slice(&1_u16.to_le_bytes());
    push_floats(&mut b, &[0., 0., 0., 0., 0., 1., 0., 0., 2., 1., 0., 0., 1., 0., 4.]);
    b
}

pub fn hair_header(strands: u32, points: u32, bits: u32, default_segments: u32) -> Vec<u8> {
    let mut b = b"HAIR".to_vec();
    for word in [strands, points, bits, default_segments] {
        b.extend_from_slice(&word.to_le_bytes());
    }
    b.resize(128, 0);
    b
}

/// A `.tfx` file of `strands` strands of `n` points on lines along z, 1 apart; before version 4 in the older layout.
pub fn tfx_bytes(version: f32, strands: u32, n: u32) -> Vec<u8> {
    let (header_bytes, offset_at) = if version < 4.0 { (296, 144) } else { (160, 12) };
    let mut b = version.to_le_bytes().to_vec();
    for word in [strands, n] {
        b.extend_from_slice(&word.to_le_bytes());
    }
    b.resize(header_bytes, 0);
    b[offset_at..offset_at + 4].copy_from_slice(&(header_bytes as u32).to_le_bytes());
    for s in 0..strands {
        for i in 0..n {
            push_floats(&mut b, &[s as f32, 0.0, i as f32]);
            if version >= 4.0 {
                push_floats(&mut b, &[1.0]);
            }
        }
    }
    b
}

/// A `.data` file of a strand of 3 points along z, a root without hair, and a strand of 2 points.
pub fn data_bytes() -> Vec<u8> {
    let mut b = 3_i32.to_le_bytes().to_vec();
    for (x, n) in [(0.0, 3), (5.0, 1), (1.0, 2)] {
        b.extend_from_slice(&i32::to_le_bytes(n));
        (0..n).for_each(|i| push_floats(&mut b, &[x, 0.0, i as f32]));
    }
    b
}

pub fn push_floats(b: &mut Vec<u8>, values: &[f32]) {
    for x in values {
        b.extend_from_slice(&x.to_le_bytes());
    }
}

/// A strand of `n` points at irregular distances, from a small generator seeded by `seed`.
pub fn random_strand(seed: u64, n: usize) -> Vec<[f32; 3]> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f32 / (1_u64 << 24) as f32 - 0.5
    };
    let mut p = [0.0; 3];
    (0..n)
        .map(|_| {
            let step = 0.1 + 4.0 * (next() + 0.5);
            for x in &mut p {
                *x += step * next();
            }
            p
        })
        .collect()
}

pub const MATERIAL: MaterialRecord = MaterialRecord {
    stretch_dyn: 3e5,
    bend: 30.0,
    twist: 30.0,
    stretch_damping: 10.0,
    bend_damping: 0.02,
    twist_damping: 0.02,
    friction: 0.3,
    linear_density_g_per_cm: 5e-5,
    air_drag_per_s: 1.0,
};

/// Two guides among three strands of three particles; every set is kept but {0, 1} on strand 2.
pub fn model() -> SkinningModel {
    let (n_strands, n_particles) = (3_u32, 3_u32);
    let line = |s: u32| (0..n_particles).flat_map(move |i| [s as f32, 0.0, i as f32]);
    let whole = WeightPoly { quad: 0.0, lin: 0.0, con: 1.0 }.to_bits();
    let half = WeightPoly { quad: 0.0, lin: 0.0, con: 0.5 }.to_bits();
    SkinningModel {
        provenance: 42,
        n_strands,
        n_particles,
        groom_in_head: [0, 2].into_iter().flat_map(line).collect(),
        rest_in_head: (0..n_strands).flat_map(line).collect(),
        guide_strands: vec![0, 2],
        eligible_start: vec![0, 1, 3, 5],
        eligible: vec![0, 0, 1, 0, 1],
        set_start: vec![0, 1, 4, 6],
        set_mask: vec![1, 1, 2, 3, 1, 2],
        set_rms_error_cm: vec![0.0, 0.2, 0.3, 0.1, 0.2, 0.0],
        coeff_start: vec![0, 1, 2, 3, 5, 6],
        coeffs: vec![whole, whole, whole, half, half, whole, whole],
        stand_in_start: vec![0, 1, 4, 7],
        stand_in: vec![0, 0, 1, 2, 0, 1, 0],
        pairs: vec![[0, 1]],
        position_scale: vec![0.5],
        velocity_scale: vec![2.0],
        velocity_weight: 5.0,
        max_distance: 7.5,
        release_distance: 9.0,
        blend: io_formats::guide_transform::Blend::Rigid,
        material: MATERIAL,
    }
}
