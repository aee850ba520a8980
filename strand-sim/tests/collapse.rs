//! MS08 Fig. 4: with altitude springs a body that collapsed to a plane or turned inside out finds its shape again, without
//! them or without the sign of their length it does not.

use nalgebra::Vector3;
use strand_sim::Error;
use strand_sim::network::primitives::{hemisphere_surface, solid_torus, torus_surface};
use strand_sim::network::{AltitudeMode, Network, NetworkMaterial, NetworkParams, NetworkState, NetworkWorkspace};

const DT: f64 = 0.01;
/// Long after the last motion: a stiff body stands again within ten steps.
const STEPS: usize = 120;
/// Far too weak to carry the body: 1 g/cm³ over 2 cm weighs 2000 dyn/cm².
const WEAK: NetworkMaterial =
    NetworkMaterial { edge_dyn: 10.0, bend_dyn: 10.0, altitude_dyn: 10.0, damping: 10.0, density: 1.0 };
/// Springs of 3e6 dyn sag by their own strain, 2000 dyn over some 1e6: a few tenths of a per cent.
const STIFF: NetworkMaterial =
    NetworkMaterial { edge_dyn: 3e6, bend_dyn: 3e6, altitude_dyn: 3e6, damping: 1000.0, density: 1.0 };
/// Height of a puddle relative to the body.
const PUDDLE: f64 = 0.01;
/// Recovered height, volume and distances under gravity, which alone costs a few tenths of a per cent.
const RECOVERED: f64 = 0.01;
/// Share of the largest volume below which a shell's tetrahedron is flat at rest and has no side to be turned to.
const FLAT: f64 = 1e-6;
/// Of momentum, relative to its parts: the linear solve is carried to 1e-12.
const SOLVER_ROUND_OFF: f64 = 1e-9;

struct Body {
    network: Network,
    rest: Vec<Vector3<f64>>,
    state: NetworkState,
    params: NetworkParams,
    workspace: NetworkWorkspace,
}

impl Body {
    fn new(network: Network, rest: Vec<Vector3<f64>>) -> Self {
        let state = NetworkState::still(&rest);
        Self { network, rest, state, params: NetworkParams::standard(), workspace: NetworkWorkspace::default() }
    }

    fn in_free_fall(mut self, altitudes: AltitudeMode) -> Self {
        self.params = NetworkParams { gravity: Vector3::zeros(), floor: false, altitudes, ..self.params };
        self
    }

    fn run(&mut self, steps: usize) {
        for _ in 0..steps {
            let report = self.network.step(&mut self.state, DT, &self.params, &mut self.workspace);
            assert!(report.converged);
        }
    }

    fn relative_height(&self) -> f64 {
        let height = |x: &[Vector3<f64>]| {
            let (low, high) = x.iter().fold((f64::MAX, f64::MIN), |(low, high), p| (low.min(p.y), high.max(p.y)));
            high - low
        };
        height(&self.state.position) / height(&self.rest)
    }

    fn relative_volume(&self) -> f64 {
        let volume = |x: &[Vector3<f64>]| self.network.volumes(x).sum::<f64>();
        volume(&self.state.position) / volume(&self.rest)
    }

    fn inverted(&self) -> usize {
        let largest = self.network.volumes(&self.rest).fold(0.0, f64::max);
        let pairs = self.network.volumes(&self.state.position).zip(self.network.volumes(&self.rest));
        pairs.filter(|&(now, rest)| rest > FLAT * largest && now <= 0.0).count()
    }

    /// Largest relative change of distance between any two particles that are not near neighbours: what a turn of the
    /// whole body, which nothing prevents in free fall, leaves alone.
    fn distortion(&self) -> f64 {
        let (now, rest) = (&self.state.position, &self.rest);
        let size = rest.iter().map(|p| (p - rest[0]).norm()).fold(0.0, f64::max);
        let mut worst = 0.0_f64;
        for i in 0..rest.len() {
            for j in 0..i {
                let length = (rest[i] - rest[j]).norm();
                if length > 0.1 * size {
                    worst = worst.max(((now[i] - now[j]).norm() / length - 1.0).abs());
                }
            }
        }
        worst
    }

    fn assert_recovered(&self) {
        assert!(self.distortion() < RECOVERED, "distortion {}", self.distortion());
        assert!((self.relative_volume() - 1.0).abs() < RECOVERED, "volume {}", self.relative_volume());
        assert_eq!(self.inverted(), 0);
    }
}

fn collapses_and_recovers(mut body: Body) {
    body.run(100);
    assert!(body.relative_height() < PUDDLE, "height {}", body.relative_height());
    assert!(body.relative_volume().abs() < PUDDLE, "volume {}", body.relative_volume());
    body.network.set_material(STIFF).expect("valid constants");
    body.run(STEPS);
    body.assert_recovered();
    assert!((body.relative_height() - 1.0).abs() < RECOVERED, "height {}", body.relative_height());
}

fn torus() -> Body {
    let (points, cells) = solid_torus(24, 2, 4.0, 1.2);
    Body::new(Network::tetrahedral_mesh(&points, &cells, WEAK).expect("a sound mesh"), points)
}

fn shell(mesh: (Vec<Vector3<f64>>, Vec<[u32; 3]>), material: NetworkMaterial) -> Body {
    let (points, faces) = mesh;
    let material = NetworkMaterial { density: 0.1, ..material };
    Body::new(Network::thin_shell(&points, &faces, material).expect("a sound mesh"), points)
}

#[test]
fn a_solid_torus_fallen_to_a_puddle_finds_its_shape_when_stiffened() {
    collapses_and_recovers(torus());
}

#[test]
fn thin_shells_fallen_to_a_puddle_find_their_shape_when_stiffened() {
    collapses_and_recovers(shell(torus_surface(32, 12, 4.0, 1.2), WEAK));
    collapses_and_recovers(shell(hemisphere_surface(24, 6, 3.0), WEAK));
}

#[test]
fn an_exactly_flat_body_stands_up_with_altitude_springs_and_stays_flat_without() {
    let stiff_torus = || {
        let mut body = torus();
        body.network.set_material(STIFF).expect("valid constants");
        body
    };
    let bodies: [fn() -> Body; 3] = [
        stiff_torus,
        || shell(torus_surface(32, 12, 4.0, 1.2), STIFF),
        || shell(hemisphere_surface(24, 6, 3.0), STIFF),
    ];
    for make in bodies {
        for altitudes in [AltitudeMode::Signed, AltitudeMode::Off] {
            let mut body = make().in_free_fall(altitudes);
            for p in &mut body.state.position {
                p.y = 0.0;
            }
            body.run(STEPS);
            if altitudes == AltitudeMode::Signed {
                body.assert_recovered();
            } else {
                assert!(body.state.position.iter().all(|p| p.y == 0.0));
            }
        }
    }
}

#[test]
fn a_torus_turned_inside_out_comes_back_with_signed_lengths_only() {
    for (altitudes, comes_back) in [(AltitudeMode::Signed, true), (AltitudeMode::Unsigned, false)] {
        let mut body = torus().in_free_fall(altitudes);
        body.network.set_material(STIFF).expect("valid constants");
        for p in &mut body.state.position {
            p.y = -p.y;
        }
        assert!((body.relative_volume() + 1.0).abs() < RECOVERED);
        body.run(STEPS);
        if comes_back {
            body.assert_recovered();
        } else {
            assert!((body.relative_volume() + 1.0).abs() < RECOVERED, "volume {}", body.relative_volume());
        }
    }
}

#[test]
fn one_inverted_tetrahedron_comes_back_with_the_signed_length_only() {
    let rest: Vec<_> = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(Vector3::from).to_vec();
    for corners in [[0, 1, 2, 3], [0, 2, 1, 3]] {
        for (altitudes, comes_back) in [(AltitudeMode::Signed, true), (AltitudeMode::Unsigned, false)] {
            let network = Network::tetrahedral_mesh(&rest, &[corners], STIFF).expect("a sound mesh");
            let mut body = Body::new(network, rest.clone()).in_free_fall(altitudes);
            body.state.position[0] = Vector3::new(0.7, 0.7, 0.7);
            assert_eq!(body.inverted(), 1);
            body.run(STEPS);
            assert_eq!(body.inverted() == 0, comes_back);
            assert!((body.relative_volume().abs() - 1.0).abs() < RECOVERED);
        }
    }
}

#[test]
fn momentum_is_kept_without_gravity_and_floor() {
    let mut body = torus().in_free_fall(AltitudeMode::Signed);
    body.network.set_material(STIFF).expect("valid constants");
    body.params.tolerance = 1e-12;
    for (i, v) in body.state.velocity.iter_mut().enumerate() {
        let phase = i as f64;
        *v = Vector3::new(phase.sin(), (1.3 * phase).cos(), (0.7 * phase).sin()) * 100.0;
    }
    let momentum =
        |b: &Body| -> Vector3<f64> { b.state.velocity.iter().zip(b.network.masses()).map(|(v, &m)| v * m).sum() };
    let scale: f64 = body.network.masses().iter().sum::<f64>() * 100.0;
    let before = momentum(&body);
    body.run(50);
    assert!((momentum(&body) - before).norm() < SOLVER_ROUND_OFF * scale);
}

#[test]
fn held_particles_stay_and_the_floor_holds_the_rest_above_it() {
    let mut body = torus();
    body.network.set_fixed(0, true).expect("a particle");
    let before = body.state.position[0];
    body.run(100);
    assert_eq!(body.state.position[0], before);
    // One part in a thousand of what a particle falls in one step at the speed gained over the torus' height.
    let deepest = 1e-3 * DT * (2.0 * 981.0 * 2.4_f64).sqrt();
    assert!(body.state.position.iter().all(|p| p.y > -deepest));
}

#[test]
fn bad_meshes_are_refused_by_name() {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(Vector3::from);
    let build = |points: &[Vector3<f64>], cells: &[[u32; 4]]| Network::tetrahedral_mesh(points, cells, WEAK);
    assert!(matches!(build(&corners, &[[0, 1, 2, 4]]), Err(Error::UnknownPoint { element: 0, point: 4, n_points: 4 })));
    let mut bad = corners;
    bad[2].x = f64::INFINITY;
    assert!(matches!(build(&bad, &[[0, 1, 2, 3]]), Err(Error::NonFinitePoint { point: 2 })));
    bad = corners;
    bad[3] = Vector3::new(1.0, 1.0, 0.0);
    assert!(matches!(build(&bad, &[[0, 1, 2, 3]]), Err(Error::FlatTetrahedron { tetrahedron: 0, .. })));
    assert!(matches!(build(&corners, &[[0, 1, 2, 2]]), Err(Error::FlatTetrahedron { tetrahedron: 0, .. })));
    assert!(matches!(build(&corners, &[]), Err(Error::LoosePoint { point: 0 })));

    let shell = |faces: &[[u32; 3]], material| Network::thin_shell(&corners, faces, material);
    assert!(matches!(shell(&[[0, 1, 1]], WEAK), Err(Error::FlatTriangle { triangle: 0, .. })));
    assert!(matches!(shell(&[[0, 1, 2], [0, 1, 2]], WEAK), Err(Error::CrowdedEdge { n_triangles: 2, .. })));
    assert!(matches!(
        shell(&[[0, 1, 2], [0, 1, 3]], NetworkMaterial { density: 0.0, ..WEAK }),
        Err(Error::BadMaterial { name: "density", .. })
    ));
}
