//! MS08 Fig. 4: a solid torus and a thin shell collapse to a puddle under their weight and find their shape again when
//! their springs are stiffened, with altitude springs and without.
//!
//! Prints CSV: body, altitude springs, time (s), height and volume relative to rest, share of tetrahedra inverted,
//! those flat at rest not counted. For a shell the volume is the sum over the tetrahedra of its altitude springs.

#![allow(clippy::print_stdout, reason = "a program whose output is its table")]

use strand_sim::Error;
use strand_sim::network::primitives::{hemisphere_surface, solid_torus, torus_surface};
use strand_sim::network::{AltitudeMode, Network, NetworkMaterial, NetworkParams, NetworkState, NetworkWorkspace};

const DT: f64 = 0.01;
/// Share of the largest volume below which a shell's tetrahedron counts as flat at rest.
const FLAT: f64 = 1e-6;
const WEAK: NetworkMaterial =
    NetworkMaterial { edge_dyn: 10.0, bend_dyn: 10.0, altitude_dyn: 10.0, damping: 10.0, density: 1.0 };
const STIFF: NetworkMaterial =
    NetworkMaterial { edge_dyn: 3e6, bend_dyn: 3e6, altitude_dyn: 3e6, damping: 1000.0, density: 1.0 };

fn run(name: &str, mut network: Network, rest: &NetworkState, mode: AltitudeMode) -> Result<(), Error> {
    let params = NetworkParams { altitudes: mode, ..NetworkParams::standard() };
    let mut state = rest.clone();
    let mut workspace = NetworkWorkspace::default();
    let height = |s: &NetworkState| {
        let y = s.position.iter().map(|p| p.y);
        y.clone().fold(f64::MIN, f64::max) - y.fold(f64::MAX, f64::min)
    };
    let volumes_at_rest: Vec<f64> = network.volumes(&rest.position).collect();
    let (height_at_rest, volume_at_rest) = (height(rest), volumes_at_rest.iter().sum::<f64>());
    let flat = FLAT * volumes_at_rest.iter().fold(0.0, |a: f64, &b| a.max(b));
    for step in 0..=300_u32 {
        if step == 100 {
            network.set_material(STIFF)?;
        }
        if step % 10 == 0 {
            let (mut volume, mut inverted, mut counted) = (0.0, 0, 0);
            for (v, at_rest) in network.volumes(&state.position).zip(&volumes_at_rest) {
                volume += v;
                counted += u32::from(*at_rest > flat);
                inverted += u32::from(*at_rest > flat && v < 0.0);
            }
            println!(
                "{name},{mode:?},{:.2},{:.4},{:.4},{:.4}",
                f64::from(step) * DT,
                height(&state) / height_at_rest,
                volume / volume_at_rest,
                f64::from(inverted) / f64::from(counted),
            );
        }
        network.step(&mut state, DT, &params, &mut workspace);
    }
    Ok(())
}

fn main() -> Result<(), Error> {
    println!("body,altitudes,time_s,height,volume,inverted");
    for mode in [AltitudeMode::Signed, AltitudeMode::Unsigned, AltitudeMode::Off] {
        let (points, cells) = solid_torus(24, 2, 4.0, 1.2);
        run("torus", Network::tetrahedral_mesh(&points, &cells, WEAK)?, &NetworkState::still(&points), mode)?;
        let shell = NetworkMaterial { density: 0.1, ..WEAK };
        let (points, faces) = torus_surface(32, 12, 4.0, 1.2);
        run("torus shell", Network::thin_shell(&points, &faces, shell)?, &NetworkState::still(&points), mode)?;
        let (points, faces) = hemisphere_surface(24, 6, 3.0);
        run("hemisphere", Network::thin_shell(&points, &faces, shell)?, &NetworkState::still(&points), mode)?;
    }
    Ok(())
}
