//! Writes a cache of swaying strands and a turning plate as ASCII USD:
//! `cargo run --release -p io-formats --example usd_cache -- out.usda 5000 25 73`.
//!
//! Shows the streaming interface, and gives other software a file of known content: particle `i` of strand `s` stands at
//! `(s mod 100 * 0.2 + 0.02 i sin(0.1 frame), i, floor(s / 100) * 0.2)` in centimetres.

use std::error::Error;
use std::path::PathBuf;

use io_formats::{CurvesLook, TriMesh, UsdaTiming, UsdaWriter};
use nalgebra::{Isometry3, Vector3};

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let path = PathBuf::from(args.next().ok_or("usage: usd_cache OUT.usda [STRANDS [PARTICLES [FRAMES]]]")?);
    let mut count = |default: usize| args.next().map_or(Ok(default), |text| text.parse());
    let (n_strands, n_particles, n_frames) = (count(100)?, count(25)?, count(24)?);

    let mut writer = UsdaWriter::create(&path, UsdaTiming { fps: 24.0, start: 1, n_frames })?;
    let counts = vec![u32::try_from(n_particles)?; n_strands];
    writer.write_curves("hair", &counts, CurvesLook::brown(), |frame, points| {
        let sway = 0.02 * (0.1 * frame as f32).sin();
        for (index, p) in points.iter_mut().enumerate() {
            let (s, i) = (index / n_particles, (index % n_particles) as f32);
            *p = [(s % 100) as f32 * 0.2 + i * sway, i, (s / 100) as f32 * 0.2];
        }
        Ok(())
    })?;
    let plate = TriMesh {
        vertices: vec![[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]],
        triangles: vec![[0, 2, 1], [0, 3, 2]],
    };
    let poses: Vec<_> = (0..n_frames)
        .map(|f| Isometry3::new(Vector3::new(0.0, -2.0, 0.0), Vector3::new(0.0, 0.1 * f as f64, 0.0)))
        .collect();
    writer.write_mesh("plate", &plate, &poses)?;
    writer.finish()?;
    Ok(())
}
